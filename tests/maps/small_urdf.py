"""A small kitchen as a robot description, and functions that create its elements."""

from __future__ import annotations

from pathlib import Path

from mindstage.rdf import Finding
from mindstage.scene import World
from tests.maps.small_maps import knowledge_base_from

__all__ = ["KITCHEN_URDF", "LoadedRobot", "box_urdf", "joint_urdf", "link_urdf", "load_robot", "robot_urdf"]


class LoadedRobot:
    """A knowledge base with one robot description."""

    def __init__(self, path: Path, *, bundled_ontology: bool = True, ontologies: tuple[Path, ...] = ()) -> None:
        self.knowledge = knowledge_base_from(path, bundled_ontology=bundled_ontology, ontologies=ontologies)
        self.world: World = self.knowledge.world()
        self.findings: tuple[Finding, ...] = self.knowledge.findings()

    def findings_for(self, name: str) -> str:
        """Returns the findings about a link or a joint as one text."""
        return "\n".join(str(finding) for finding in self.findings if finding.individual.endswith(f"#{name}"))


def load_robot(file: Path, text: str) -> LoadedRobot:
    file.write_text(text, encoding="utf-8")
    return LoadedRobot(file)


def robot_urdf(*elements: str, name: str = "kitchen", extra_attributes: str = "") -> str:
    """Returns a robot description."""
    return (
        f'<?xml version="1.0"?>\n<!-- made by hand -->\n<robot name="{name}" {extra_attributes}>'
        + "\n".join(elements)
        + "</robot>"
    )


def link_urdf(name: str, *elements: str) -> str:
    """Returns a link."""
    return f'<link name="{name}">{"".join(elements)}</link>'


def box_urdf(size: str, *, xyz: str = "0 0 0", rpy: str = "0 0 0", role: str = "visual", extra: str = "") -> str:
    """Returns a box geometry."""
    origin = f'<origin xyz="{xyz}" rpy="{rpy}"/>'
    return f'<{role}>{origin}<geometry><box size="{size}"/></geometry>{extra}</{role}>'


def joint_urdf(
    name: str, type: str, parent: str, child: str, *elements: str, xyz: str = "0 0 0", rpy: str = "0 0 0"
) -> str:
    """Returns a joint."""
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
    return f'<joint name="{name}" type="{type}">{ends}{"".join(elements)}</joint>'


KITCHEN_URDF = robot_urdf(
    '<material name="steel"><color rgba="0.6 0.6 0.65 1"/></material>',
    link_urdf("world"),
    link_urdf(
        "counter_main",
        box_urdf("0.6 2.0 0.9", xyz="0 0 0.45", extra='<material name="wood"><color rgba="0.7 0.5 0.3 1"/></material>'),
        box_urdf("0.65 2.05 0.04", xyz="0 0 0.92"),
        '<inertial><mass value="60"/></inertial>',
    ),
    link_urdf("counter_drawer_main", box_urdf("0.5 0.8 0.2"), '<inertial><mass value="4.5"/></inertial>'),
    link_urdf(
        "counter_drawer_handle",
        '<visual><geometry><cylinder radius="0.01" length="0.4"/></geometry><material name="steel"/></visual>',
    ),
    link_urdf("fridge", box_urdf("0.6 0.6 2.0")),
    link_urdf("fridge_door_link", box_urdf("0.04 0.6 1.9", xyz="0 -0.3 0"), '<inertial><mass value="8"/></inertial>'),
    link_urdf("lamp_42", '<collision><geometry><sphere radius="0.1"/></geometry></collision>'),
    joint_urdf("counter_fixed", "fixed", "world", "counter_main", xyz="1 0 0"),
    joint_urdf(
        "drawer_slide",
        "prismatic",
        "counter_main",
        "counter_drawer_main",
        '<axis xyz="-1 0 0"/><limit lower="0" upper="0.48" effort="1" velocity="1"/><dynamics damping="2.5"/>',
        xyz="-0.05 0.4 0.7",
    ),
    joint_urdf(
        "handle_fixed", "fixed", "counter_drawer_main", "counter_drawer_handle", xyz="-0.27 0 0", rpy="1.5707963 0 0"
    ),
    joint_urdf("fridge_fixed", "fixed", "world", "fridge", xyz="1 1.6 1"),
    joint_urdf(
        "fridge_hinge",
        "revolute",
        "fridge",
        "fridge_door_link",
        '<axis xyz="0 0 -1"/><limit lower="-0.1" upper="1.9" effort="1" velocity="1"/>',
        xyz="-0.33 0.3 0",
    ),
    joint_urdf("lamp_fixed", "fixed", "world", "lamp_42", xyz="0 0 2.4"),
    "<transmission name='drive'><type>simple</type></transmission>",
)
"""Two movable joints, five fixed links, and a link with two boxes."""
