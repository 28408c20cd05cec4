"""A small kitchen as a robot's description, in parts that tests put together."""

from __future__ import annotations

from pathlib import Path

from mindstage.knowledge import Finding
from mindstage.world import World
from tests.knowledge.maps import knowing

__all__ = ["KITCHEN", "Loaded", "box", "joint", "link", "load", "robot"]


class Loaded:
    """A description that was loaded alone."""

    def __init__(self, path: Path, *, bundled_ontology: bool = True, ontologies: tuple[Path, ...] = ()) -> None:
        self.knowledge = knowing(path, bundled_ontology=bundled_ontology, ontologies=ontologies)
        self.world: World = self.knowledge.world()
        self.findings: tuple[Finding, ...] = self.knowledge.findings()

    def about(self, name: str) -> str:
        """What was found about a link or a joint."""
        return "\n".join(str(finding) for finding in self.findings if finding.individual.endswith(f"#{name}"))


def load(file: Path, text: str) -> Loaded:
    file.write_text(text, encoding="utf-8")
    return Loaded(file)


def robot(*elements: str, name: str = "kitchen", more: str = "") -> str:
    """A description."""
    return (
        f'<?xml version="1.0"?>\n<!-- made by hand -->\n<robot name="{name}" {more}>' + "\n".join(elements) + "</robot>"
    )


def link(name: str, *elements: str) -> str:
    """One link."""
    return f'<link name="{name}">{"".join(elements)}</link>'


def box(size: str, *, xyz: str = "0 0 0", rpy: str = "0 0 0", role: str = "visual", more: str = "") -> str:
    """One box of a link."""
    origin = f'<origin xyz="{xyz}" rpy="{rpy}"/>'
    return f'<{role}>{origin}<geometry><box size="{size}"/></geometry>{more}</{role}>'


def joint(name: str, type: str, parent: str, child: str, *elements: str, xyz: str = "0 0 0", rpy: str = "0 0 0") -> str:
    """One joint."""
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
    return f'<joint name="{name}" type="{type}">{ends}{"".join(elements)}</joint>'


KITCHEN = robot(
    '<material name="steel"><color rgba="0.6 0.6 0.65 1"/></material>',
    link("world"),
    link(
        "counter_main",
        box("0.6 2.0 0.9", xyz="0 0 0.45", more='<material name="wood"><color rgba="0.7 0.5 0.3 1"/></material>'),
        box("0.65 2.05 0.04", xyz="0 0 0.92"),
        '<inertial><mass value="60"/></inertial>',
    ),
    link("counter_drawer_main", box("0.5 0.8 0.2"), '<inertial><mass value="4.5"/></inertial>'),
    link(
        "counter_drawer_handle",
        '<visual><geometry><cylinder radius="0.01" length="0.4"/></geometry><material name="steel"/></visual>',
    ),
    link("fridge", box("0.6 0.6 2.0")),
    link("fridge_door_link", box("0.04 0.6 1.9", xyz="0 -0.3 0"), '<inertial><mass value="8"/></inertial>'),
    link("lamp_42", '<collision><geometry><sphere radius="0.1"/></geometry></collision>'),
    joint("counter_fixed", "fixed", "world", "counter_main", xyz="1 0 0"),
    joint(
        "drawer_slide",
        "prismatic",
        "counter_main",
        "counter_drawer_main",
        '<axis xyz="-1 0 0"/><limit lower="0" upper="0.48" effort="1" velocity="1"/><dynamics damping="2.5"/>',
        xyz="-0.05 0.4 0.7",
    ),
    joint(
        "handle_fixed", "fixed", "counter_drawer_main", "counter_drawer_handle", xyz="-0.27 0 0", rpy="1.5707963 0 0"
    ),
    joint("fridge_fixed", "fixed", "world", "fridge", xyz="1 1.6 1"),
    joint(
        "fridge_hinge",
        "revolute",
        "fridge",
        "fridge_door_link",
        '<axis xyz="0 0 -1"/><limit lower="-0.1" upper="1.9" effort="1" velocity="1"/>',
        xyz="-0.33 0.3 0",
    ),
    joint("lamp_fixed", "fixed", "world", "lamp_42", xyz="0 0 2.4"),
    "<transmission name='drive'><type>simple</type></transmission>",
)
"""Two joints, five things that are fixed, a link of two boxes."""
