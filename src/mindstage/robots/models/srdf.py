"""Reading of SRDF: groups of joints, end effectors, virtual joints, named positions, disabled collisions.

The format is that of MoveIt (`srdfdom`). Names of links and joints that the robot does not have are ignored, since one
SRDF often serves several variants of a robot.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import msgspec

from mindstage.errors import RobotModelError, SourceParseError
from mindstage.maps.urdf.parse import parse_xml

__all__ = ["Srdf", "SrdfEndEffector", "SrdfGroup", "SrdfVirtualJoint", "read_srdf"]


class SrdfGroup(msgspec.Struct, frozen=True, kw_only=True):
    """A group of joints and links."""

    name: str
    chains: tuple[tuple[str, str], ...] = ()
    """Base link and tip link of each chain."""
    links: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()
    """Names of groups that it contains."""


class SrdfEndEffector(msgspec.Struct, frozen=True, kw_only=True):
    """An end effector."""

    name: str
    group: str
    parent_link: str
    parent_group: str = ""
    """The group of the arm; often left out."""


class SrdfVirtualJoint(msgspec.Struct, frozen=True, kw_only=True):
    """The joint between the world and the robot."""

    name: str
    type: str
    """"fixed", "planar" or "floating"."""
    child_link: str
    motion_model: str = ""
    """"diff_drive" or "holonomic", a property of planar joints; empty if not stated."""


class Srdf(msgspec.Struct, frozen=True, kw_only=True):
    """The contents of an SRDF file."""

    groups: tuple[SrdfGroup, ...] = ()
    end_effectors: tuple[SrdfEndEffector, ...] = ()
    virtual_joints: tuple[SrdfVirtualJoint, ...] = ()
    states: tuple[tuple[str, str, tuple[tuple[str, float], ...]], ...] = ()
    """Group, name, and positions by joint; only joints with one axis."""
    disabled_collisions: frozenset[tuple[str, str]] = frozenset()
    """Pairs of links, the lower name first."""

    def group(self, name: str) -> SrdfGroup | None:
        """The group of a name, or None."""
        return next((group for group in self.groups if group.name == name), None)


def read_srdf(path: Path) -> Srdf:
    """Reads an SRDF file.

    Raises:
        RobotModelError: it cannot be read, or is not SRDF.
    """
    remedy = "correct it, or leave it out"
    try:
        root = parse_xml(path, path.read_bytes())
    except OSError as error:
        raise RobotModelError(str(path), cause=error.strerror or str(error), remedy=remedy) from error
    except SourceParseError as error:
        raise RobotModelError(error.place, cause=error.cause, remedy=remedy) from error
    if root.tag != "robot":
        raise RobotModelError(str(path), cause=f"its root element is <{root.tag}>, not <robot>", remedy=remedy)
    motion_models = {
        each.get("joint_name", ""): each.get("value", "")
        for each in root.findall("joint_property")
        if each.get("property_name") == "motion_model"
    }
    pairs = ((each.get("link1", ""), each.get("link2", "")) for each in root.findall("disable_collisions"))
    return Srdf(
        groups=tuple(map(_group, root.findall("group"))),
        end_effectors=tuple(
            SrdfEndEffector(
                name=each.get("name", ""),
                group=each.get("group", ""),
                parent_link=each.get("parent_link", ""),
                parent_group=each.get("parent_group", ""),
            )
            for each in root.findall("end_effector")
        ),
        virtual_joints=tuple(
            SrdfVirtualJoint(
                name=each.get("name", ""),
                type=each.get("type", ""),
                child_link=each.get("child_link", ""),
                motion_model=motion_models.get(each.get("name", ""), ""),
            )
            for each in root.findall("virtual_joint")
        ),
        states=tuple(map(_state, root.findall("group_state"))),
        disabled_collisions=frozenset((min(pair), max(pair)) for pair in pairs if all(pair) and pair[0] != pair[1]),
    )


def _group(element: ElementTree.Element) -> SrdfGroup:
    def names(tag: str) -> tuple[str, ...]:
        return tuple(each.get("name", "") for each in element.findall(tag))

    chains = ((each.get("base_link", ""), each.get("tip_link", "")) for each in element.findall("chain"))
    return SrdfGroup(
        name=element.get("name", ""),
        chains=tuple(chains),
        links=names("link"),
        joints=names("joint"),
        groups=names("group"),
    )


def _state(element: ElementTree.Element) -> tuple[str, str, tuple[tuple[str, float], ...]]:
    positions = []
    for each in element.findall("joint"):
        words = each.get("value", "").split()
        try:
            numbers = [float(word) for word in words]
        except ValueError:
            continue
        if len(numbers) == 1:  # floating joints have seven, planar ones three
            positions.append((each.get("name", ""), numbers[0]))
    return element.get("group", ""), element.get("name", ""), tuple(positions)
