"""Elements: what a description's XML says, one piece after the other; what makes no sense becomes an oddity."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator
from pathlib import Path
from typing import TypeVar
from xml.etree import ElementTree

import numpy as np

from mindstage.errors import SourceParseError
from mindstage.knowledge.readers.joint_frames import to_vector
from mindstage.knowledge.robots.mesh_sizes import mesh_bounds
from mindstage.knowledge.robots.robot import (
    UrdfGeometry,
    UrdfGeometryType,
    UrdfIssue,
    UrdfJoint,
    UrdfJointType,
    UrdfLink,
    UrdfRobot,
)
from mindstage.knowledge.sources.packages import RosPackagePath
from mindstage.knowledge.wording import words
from mindstage.world import IDENTITY, Color, Pose, Vector
from mindstage.world.geometry import normalized_pose_array, pose_from_array, pose_multiply, quat_multiply

__all__ = ["parse_robot"]

T = TypeVar("T")
Element = ElementTree.Element


def parse_robot(root: Element, path: Path, packages: RosPackagePath) -> UrdfRobot:
    """The robot that an element `robot` tells of.

    Raises:
        SourceParseError: it has no link.
    """
    return _UrdfParser(root, path, packages).parse()


class _UrdfParser:
    """One description."""

    def __init__(self, root: Element, path: Path, packages: RosPackagePath) -> None:
        self.root, self.path, self.packages = root, path, packages
        self.issues: list[UrdfIssue] = []
        self.current_name = ""
        named = ((material.get("name", ""), self._color(material)) for material in root.findall("material"))
        self.colors = {name: color for name, color in named if color is not None}

    def parse(self) -> UrdfRobot:
        links = {link.name: link for link in self._parse_each("link", self._link)}
        joints = {joint.name: joint for joint in self._parse_each("joint", self._joint)}
        if not links:
            raise SourceParseError(str(self.path), cause="the robot in it has no link")
        rest = tuple(_element_text(each) for each in self.root if each.tag not in ("link", "joint"))
        name = self.root.get("name") or self.path.name.split(".")[0]
        return UrdfRobot(
            name=name,
            links=tuple(links.values()),
            joints=tuple(joint for joint in joints.values() if self._has_ends(joint, links.keys())),
            other_elements=rest,
            issues=tuple(self.issues),
        )

    def _add_issue(self, problem: str, action: str, *, missing: bool = False) -> None:
        self.issues.append(UrdfIssue(self.current_name, problem, action, missing))

    # -- links ---------------------------------------------------------------------------------------------------------

    def _parse_each(self, tag: str, read: Callable[[Element, str], T]) -> Iterator[T]:
        seen: set[str] = set()
        for element in self.root.findall(tag):
            name = self.current_name = element.get("name", "")
            if not name or name in seen:
                why = "its name is taken" if name else f"a {tag} has no name"
                self._add_issue(why, "it is left out", missing=True)
                continue
            seen.add(name)
            yield read(element, name)

    def _link(self, element: Element, name: str) -> UrdfLink:
        mass = element.find("inertial/mass")
        weight = self._number(mass, "value") if mass is not None else None
        if weight is not None and weight < 0.0:
            self._add_issue(f"its mass is {weight:g} kg", "it has none")
            weight = None
        return UrdfLink(
            name=name,
            visuals=tuple(filter(None, map(self._geometry, element.findall("visual")))),
            collisions=tuple(filter(None, map(self._geometry, element.findall("collision")))),
            mass_kg=weight or None,
            source_xml=_element_text(element),
        )

    def _geometry(self, element: Element) -> UrdfGeometry | None:
        form = element.find("geometry")
        told = None if form is None else next((child for child in form if child.tag in _GEOMETRY_TAGS), None)
        if told is None:
            self._add_issue(f"a <{element.tag}> has no box, cylinder, sphere or mesh", "it is not there", missing=True)
            return None
        kind, size, mesh, middle = UrdfGeometryType(told.tag), None, None, IDENTITY
        origin = self._origin(element)
        if kind is UrdfGeometryType.MESH:
            mesh = told.get("filename") or None
            box = mesh_bounds(mesh, self.path, self.packages) if mesh else None
            if mesh is None:
                self._add_issue("a mesh has no file name", "it is not there", missing=True)
                return None
            if box is not None:
                scale = np.array(self._vector(told, "scale", (1.0, 1.0, 1.0)))
                size, middle = to_vector(np.abs(box.size * scale)), Pose(to_vector(box.center * scale))
        else:
            size = self._size(kind, told)
            if size is None:
                return None
        material, color = self._material(element.find("material"))
        return UrdfGeometry(
            geometry_type=kind,
            origin=pose_from_array(pose_multiply(normalized_pose_array(origin), normalized_pose_array(middle))),
            size=size,
            mesh=mesh,
            color=color,
            material=material,
        )

    def _size(self, geometry_type: UrdfGeometryType, element: Element) -> Vector | None:
        if geometry_type is UrdfGeometryType.BOX:
            size = _parse_vector(element.get("size", ""))
        else:
            radius = self._number(element, "radius")
            length = (
                self._number(element, "length") if geometry_type is UrdfGeometryType.CYLINDER else radius and 2 * radius
            )
            size = None if radius is None or length is None else (2 * radius, 2 * radius, length)
        if size is None or min(size) < 0.0:
            self._add_issue(
                f"a {geometry_type.value} has no size of numbers that are 0 or more", "it is not there", missing=True
            )
            return None
        return size

    def _material(self, material: Element | None) -> tuple[str, Color | None]:
        name = "" if material is None else material.get("name", "")
        own = None if material is None else self._color(material)
        return name, own or self.colors.get(name)

    def _color(self, material: Element) -> Color | None:
        color = material.find("color")
        numbers = [] if color is None else [_parse_number(part) for part in color.get("rgba", "").split()]
        told = [number for number in numbers if number is not None and 0.0 <= number <= 1.0]
        if color is not None and (len(told) != len(numbers) or len(told) not in (3, 4)):
            self._add_issue(f"the colour {color.get('rgba', '')!r} is not four numbers from 0 to 1", "it has none")
            return None
        return None if color is None else (told[0], told[1], told[2])

    # -- joints --------------------------------------------------------------------------------------------------------

    def _joint(self, element: Element, name: str) -> UrdfJoint:
        ends = [end.get("link", "") if (end := element.find(role)) is not None else "" for role in ("parent", "child")]
        kind = element.get("type", "")
        if kind not in _JOINT_TYPES:
            self._add_issue(f"{kind!r} is no type of joint", "it holds its two ends together")
        type = UrdfJointType(kind) if kind in _JOINT_TYPES else UrdfJointType.FIXED
        axis_of = element.find("axis")
        axis = (1.0, 0.0, 0.0) if axis_of is None else self._vector(axis_of, "xyz", (1.0, 0.0, 0.0))
        if not any(axis):
            self._add_issue("its axis is 0 0 0", "1 0 0 is taken")
            axis = (1.0, 0.0, 0.0)
        if (mimic := element.find("mimic")) is not None:
            self._add_issue(f"it mimics {mimic.get('joint', '')!r}", "it moves on its own")
        dynamics = element.find("dynamics")
        return UrdfJoint(
            name=name,
            type=type,
            parent=ends[0],
            child=ends[1],
            origin=self._origin(element),
            axis=axis,
            range=self._joint_range(element, type),
            damping=(self._number(dynamics, "damping", 0.0) or 0.0) if dynamics is not None else 0.0,
            source_xml=_element_text(element),
        )

    def _joint_range(self, element: Element, type: UrdfJointType) -> tuple[float, float] | None:
        if type not in (UrdfJointType.REVOLUTE, UrdfJointType.PRISMATIC):
            return None
        limit = element.find("limit")
        if limit is None:
            self._add_issue("it has no limit", "it may move without end")
            return None
        lower, upper = self._number(limit, "lower", 0.0), self._number(limit, "upper", 0.0)
        if lower is None or upper is None:
            return None
        if lower > upper:
            self._add_issue(f"its lower limit {lower:g} is above its upper limit {upper:g}", "the two change places")
            return upper, lower
        return lower, upper

    def _has_ends(self, joint: UrdfJoint, links: Container[str]) -> bool:
        self.current_name = joint.name
        missing = [end or "nothing" for end in (joint.parent, joint.child) if end not in links]
        if missing or joint.parent == joint.child:
            why = f"it joins {' and '.join(missing)}, which is no link" if missing else "it joins a link to itself"
            self._add_issue(why, "it is left out", missing=True)
        return not missing and joint.parent != joint.child

    # -- numbers -------------------------------------------------------------------------------------------------------

    def _origin(self, element: Element) -> Pose:
        """Fixed axes: first the turn about x, then y, then z."""
        origin = element.find("origin")
        if origin is None:
            return IDENTITY
        quaternion = np.array([1.0, 0.0, 0.0, 0.0])
        for axis, angle in enumerate(self._vector(origin, "rpy", (0.0, 0.0, 0.0))):
            turn = np.zeros(4)
            turn[0], turn[1 + axis] = np.cos(angle / 2), np.sin(angle / 2)
            quaternion = quat_multiply(turn, quaternion)
        return pose_from_array([*self._vector(origin, "xyz", (0.0, 0.0, 0.0)), *quaternion])

    def _vector(self, element: Element, attribute: str, default: Vector) -> Vector:
        text = element.get(attribute)
        if text is None:
            return default
        told = _parse_vector(text if len(text.split()) > 1 or attribute != "scale" else f"{text} {text} {text}")
        if told is None:
            taken = " ".join(f"{number:g}" for number in default)
            self._add_issue(f"{attribute}={text!r} is not three finite numbers below 1e100", f"{taken} is taken")
        return default if told is None else told

    def _number(self, element: Element, attribute: str, default: float | None = None) -> float | None:
        text = element.get(attribute)
        if text is None:
            return default
        number = _parse_number(text)
        if number is None:
            self._add_issue(
                f"{attribute}={text!r} of <{element.tag}> is not a finite number below 1e100", "it counts as not told"
            )
        return number


_TOO_LARGE = 1e100
"""What is larger cannot be multiplied with itself three times."""
_GEOMETRY_TAGS = {kind.value for kind in UrdfGeometryType}
_JOINT_TYPES = {type.value for type in UrdfJointType}


def _parse_number(text: str) -> float | None:
    number = words.parse_number(text)
    return number if number is not None and abs(number) < _TOO_LARGE else None


def _parse_vector(text: str) -> Vector | None:
    numbers = [_parse_number(part) for part in text.split()]
    told = [number for number in numbers if number is not None]
    return (told[0], told[1], told[2]) if len(told) == len(numbers) == 3 else None


def _element_text(element: Element) -> str:
    """An element as XML, without the blanks around it."""
    return ElementTree.tostring(element, encoding="unicode").strip()
