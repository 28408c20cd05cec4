"""Elements: what a description's XML says, one piece after the other; what makes no sense becomes an oddity."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator
from pathlib import Path
from typing import TypeVar
from xml.etree import ElementTree

import numpy as np

from mindstage.errors import SourceUnreadable
from mindstage.knowledge.readers.joint_frames import vector
from mindstage.knowledge.robots.mesh_sizes import mesh_box
from mindstage.knowledge.robots.robot import Geometry, GeometryKind, Joint, JointType, Link, Oddity, Robot
from mindstage.knowledge.sources.packages import Packages
from mindstage.knowledge.wording import words
from mindstage.world import IDENTITY, Colour, Pose, Vector
from mindstage.world.geometry import compose, multiply, pose_from, unit_pose

__all__ = ["robot_of"]

T = TypeVar("T")
Element = ElementTree.Element


def robot_of(root: Element, path: Path, packages: Packages) -> Robot:
    """The robot that an element `robot` tells of.

    Raises:
        SourceUnreadable: it has no link.
    """
    return _Elements(root, path, packages).robot()


class _Elements:
    """One description."""

    def __init__(self, root: Element, path: Path, packages: Packages) -> None:
        self.root, self.path, self.packages = root, path, packages
        self.oddities: list[Oddity] = []
        self.about = ""
        named = ((material.get("name", ""), self._rgb(material)) for material in root.findall("material"))
        self.colours = {name: colour for name, colour in named if colour is not None}

    def robot(self) -> Robot:
        links = {link.name: link for link in self._each("link", self._link)}
        joints = {joint.name: joint for joint in self._each("joint", self._joint)}
        if not links:
            raise SourceUnreadable(str(self.path), cause="the robot in it has no link")
        rest = tuple(_text(each) for each in self.root if each.tag not in ("link", "joint"))
        name = self.root.get("name") or self.path.name.split(".")[0]
        return Robot(
            name=name,
            links=tuple(links.values()),
            joints=tuple(joint for joint in joints.values() if self._has_ends(joint, links.keys())),
            rest=rest,
            oddities=tuple(self.oddities),
        )

    def _odd(self, what: str, did: str, *, missing: bool = False) -> None:
        self.oddities.append(Oddity(self.about, what, did, missing))

    # -- links ---------------------------------------------------------------------------------------------------------

    def _each(self, tag: str, read: Callable[[Element, str], T]) -> Iterator[T]:
        seen: set[str] = set()
        for element in self.root.findall(tag):
            name = self.about = element.get("name", "")
            if not name or name in seen:
                why = "its name is taken" if name else f"a {tag} has no name"
                self._odd(why, "it is left out", missing=True)
                continue
            seen.add(name)
            yield read(element, name)

    def _link(self, element: Element, name: str) -> Link:
        mass = element.find("inertial/mass")
        weight = self._number(mass, "value") if mass is not None else None
        if weight is not None and weight < 0.0:
            self._odd(f"its mass is {weight:g} kg", "it has none")
            weight = None
        return Link(
            name=name,
            visuals=tuple(filter(None, map(self._geometry, element.findall("visual")))),
            collisions=tuple(filter(None, map(self._geometry, element.findall("collision")))),
            mass_kg=weight or None,
            source=_text(element),
        )

    def _geometry(self, element: Element) -> Geometry | None:
        form = element.find("geometry")
        told = None if form is None else next((child for child in form if child.tag in _KINDS), None)
        if told is None:
            self._odd(f"a <{element.tag}> has no box, cylinder, sphere or mesh", "it is not there", missing=True)
            return None
        kind, size, mesh, middle = GeometryKind(told.tag), None, None, IDENTITY
        origin = self._origin(element)
        if kind is GeometryKind.MESH:
            mesh = told.get("filename") or None
            box = mesh_box(mesh, self.path, self.packages) if mesh else None
            if mesh is None:
                self._odd("a mesh has no file name", "it is not there", missing=True)
                return None
            if box is not None:
                scale = np.array(self._vector(told, "scale", (1.0, 1.0, 1.0)))
                size, middle = vector(np.abs(box.size * scale)), Pose(vector(box.middle * scale))
        else:
            size = self._size(kind, told)
            if size is None:
                return None
        material, colour = self._paint(element.find("material"))
        return Geometry(
            kind=kind,
            origin=pose_from(compose(unit_pose(origin), unit_pose(middle))),
            size=size,
            mesh=mesh,
            colour=colour,
            material=material,
        )

    def _size(self, kind: GeometryKind, told: Element) -> Vector | None:
        if kind is GeometryKind.BOX:
            size = _three(told.get("size", ""))
        else:
            radius = self._number(told, "radius")
            length = self._number(told, "length") if kind is GeometryKind.CYLINDER else radius and 2 * radius
            size = None if radius is None or length is None else (2 * radius, 2 * radius, length)
        if size is None or min(size) < 0.0:
            self._odd(f"a {kind.value} has no size of numbers that are 0 or more", "it is not there", missing=True)
            return None
        return size

    def _paint(self, material: Element | None) -> tuple[str, Colour | None]:
        name = "" if material is None else material.get("name", "")
        own = None if material is None else self._rgb(material)
        return name, own or self.colours.get(name)

    def _rgb(self, material: Element) -> Colour | None:
        colour = material.find("color")
        numbers = [] if colour is None else [_number_in(part) for part in colour.get("rgba", "").split()]
        told = [number for number in numbers if number is not None and 0.0 <= number <= 1.0]
        if colour is not None and (len(told) != len(numbers) or len(told) not in (3, 4)):
            self._odd(f"the colour {colour.get('rgba', '')!r} is not four numbers from 0 to 1", "it has none")
            return None
        return None if colour is None else (told[0], told[1], told[2])

    # -- joints --------------------------------------------------------------------------------------------------------

    def _joint(self, element: Element, name: str) -> Joint:
        ends = [end.get("link", "") if (end := element.find(role)) is not None else "" for role in ("parent", "child")]
        kind = element.get("type", "")
        if kind not in _TYPES:
            self._odd(f"{kind!r} is no type of joint", "it holds its two ends together")
        type = JointType(kind) if kind in _TYPES else JointType.FIXED
        axis_of = element.find("axis")
        axis = (1.0, 0.0, 0.0) if axis_of is None else self._vector(axis_of, "xyz", (1.0, 0.0, 0.0))
        if not any(axis):
            self._odd("its axis is 0 0 0", "1 0 0 is taken")
            axis = (1.0, 0.0, 0.0)
        if (mimic := element.find("mimic")) is not None:
            self._odd(f"it mimics {mimic.get('joint', '')!r}", "it moves on its own")
        dynamics = element.find("dynamics")
        return Joint(
            name=name,
            type=type,
            parent=ends[0],
            child=ends[1],
            origin=self._origin(element),
            axis=axis,
            range=self._range(element, type),
            damping=(self._number(dynamics, "damping", 0.0) or 0.0) if dynamics is not None else 0.0,
            source=_text(element),
        )

    def _range(self, element: Element, type: JointType) -> tuple[float, float] | None:
        if type not in (JointType.REVOLUTE, JointType.PRISMATIC):
            return None
        limit = element.find("limit")
        if limit is None:
            self._odd("it has no limit", "it may move without end")
            return None
        lower, upper = self._number(limit, "lower", 0.0), self._number(limit, "upper", 0.0)
        if lower is None or upper is None:
            return None
        if lower > upper:
            self._odd(f"its lower limit {lower:g} is above its upper limit {upper:g}", "the two change places")
            return upper, lower
        return lower, upper

    def _has_ends(self, joint: Joint, links: Container[str]) -> bool:
        self.about = joint.name
        missing = [end or "nothing" for end in (joint.parent, joint.child) if end not in links]
        if missing or joint.parent == joint.child:
            why = f"it joins {' and '.join(missing)}, which is no link" if missing else "it joins a link to itself"
            self._odd(why, "it is left out", missing=True)
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
            quaternion = multiply(turn, quaternion)
        return pose_from([*self._vector(origin, "xyz", (0.0, 0.0, 0.0)), *quaternion])

    def _vector(self, element: Element, attribute: str, default: Vector) -> Vector:
        text = element.get(attribute)
        if text is None:
            return default
        told = _three(text if len(text.split()) > 1 or attribute != "scale" else f"{text} {text} {text}")
        if told is None:
            taken = " ".join(f"{number:g}" for number in default)
            self._odd(f"{attribute}={text!r} is not three finite numbers below 1e100", f"{taken} is taken")
        return default if told is None else told

    def _number(self, element: Element, attribute: str, default: float | None = None) -> float | None:
        text = element.get(attribute)
        if text is None:
            return default
        number = _number_in(text)
        if number is None:
            self._odd(
                f"{attribute}={text!r} of <{element.tag}> is not a finite number below 1e100", "it counts as not told"
            )
        return number


_TOO_LARGE = 1e100
"""What is larger cannot be multiplied with itself three times."""
_KINDS = {kind.value for kind in GeometryKind}
_TYPES = {type.value for type in JointType}


def _number_in(text: str) -> float | None:
    number = words.number_in(text)
    return number if number is not None and abs(number) < _TOO_LARGE else None


def _three(text: str) -> Vector | None:
    numbers = [_number_in(part) for part in text.split()]
    told = [number for number in numbers if number is not None]
    return (told[0], told[1], told[2]) if len(told) == len(numbers) == 3 else None


def _text(element: Element) -> str:
    """An element as XML, without the blanks around it."""
    return ElementTree.tostring(element, encoding="unicode").strip()
