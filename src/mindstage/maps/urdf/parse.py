"""Reading of URDF and xacro files to a `UrdfRobot`.

Parsing is safe for untrusted files: document types are refused, so no entity is expanded or fetched, and size and depth
are limited. Files that contain xacro are refused, unless their expansion is asked for (see `xacro_process`). Invalid
values are replaced and reported as `UrdfIssue`.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Container, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple, TypeVar
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
from msgspec.structs import replace

from mindstage.errors import SourceParseError, XacroRefusedError, without_surrogates
from mindstage.maps.dialects.joints import to_vector
from mindstage.maps.io.ros_packages import RosPackagePath
from mindstage.maps.rdf_mapping import properties as codecs
from mindstage.maps.urdf.urdf_model import (
    UrdfGeometry,
    UrdfGeometryType,
    UrdfInertial,
    UrdfIssue,
    UrdfJoint,
    UrdfJointType,
    UrdfLink,
    UrdfMimic,
    UrdfRobot,
)
from mindstage.scene import IDENTITY, Color, Pose, Vector
from mindstage.scene.transforms import Array, normalized_pose_array, pose_from_array, pose_multiply, quat_multiply

__all__ = ["MeshBounds", "mesh_bounds", "parse_robot", "parse_xml", "read_urdf"]


_MAX_BYTES = 256 * 1024 * 1024
T = TypeVar("T")
Element = ElementTree.Element
_TOO_LARGE = 1e100
"""Numbers above this overflow when they are multiplied with each other."""
_GEOMETRY_TAGS = {geometry_type.value for geometry_type in UrdfGeometryType}
_SINGLE_AXIS_TYPES = (UrdfJointType.REVOLUTE, UrdfJointType.CONTINUOUS, UrdfJointType.PRISMATIC)
_JOINT_TYPES = {type.value for type in UrdfJointType}
LENGTH_LIMIT = 64 * 1024 * 1024
"""Maximum size of a file [bytes]; the largest robot descriptions have about two million."""
DEPTH_LIMIT = 200
"""Maximum depth of elements; URDF needs six, simulator extensions a few more."""
_XACRO_NAMESPACE = re.compile(r"https?://[\w.]*ros\.org/(?:\w+/)*xacro/?")
"""Namespaces that files bind to the prefix of xacro's elements; `xacro` itself looks at the prefix only."""
_XACRO_EXPRESSION = re.compile(r"\$[{(]")
"""The beginning of `${expression}` or `$(substitution)`, or of an escaped one, which xacro unescapes."""
_ONLY_ON_REQUEST = (
    "which is expanded only in a file that is named on the command line with --xacro or in Python with xacro=True; "
    "otherwise expand it first"
)


class MeshBounds(NamedTuple):
    """Axis-aligned bounding box in the frame and the units of the mesh."""

    center: Array
    size: Array


def mesh_bounds(name: str, urdf_path: Path, packages: RosPackagePath) -> MeshBounds | None:
    """Returns the bounding box of an STL or OBJ mesh, or None if the file is missing or cannot be measured."""
    try:
        path = _mesh_path(name, urdf_path, packages)
        measure = None if path is None else _FORMATS.get(path.suffix.lower())
        # Reading a pipe or a device might never end.
        if path is None or measure is None or not path.is_file() or path.stat().st_size > _MAX_BYTES:
            return None
        data = path.read_bytes()
    except (OSError, ValueError):
        return None
    points = measure(data)
    if points is None or not len(points) or not np.isfinite(points).all():
        return None
    low, high = points.min(axis=0), points.max(axis=0)
    return MeshBounds((low + high) / 2, high - low)


def _mesh_path(name: str, urdf_path: Path, packages: RosPackagePath) -> Path | None:
    if name.startswith("package:"):
        try:
            return packages.find(name)
        except ValueError:
            return None
    parts = urlsplit(name)
    if parts.scheme not in ("", "file"):
        return None
    return urdf_path.parent / unquote(parts.path)


def _stl_vertices(data: bytes) -> Array | None:
    if len(data) >= 84:
        (count,) = struct.unpack_from("<I", data, 80)
        if len(data) == 84 + 50 * count:
            dtype = np.dtype([("normal", "<f4", 3), ("points", "<f4", (3, 3)), ("rest", "<u2")])
            facets = np.frombuffer(data, dtype, count, 84)
            return np.asarray(facets["points"].reshape(-1, 3), dtype=np.float64)
    return _vertex_lines(data, b"vertex")


def _obj_vertices(data: bytes) -> Array | None:
    return _vertex_lines(data, b"v")


def _vertex_lines(data: bytes, keyword: bytes) -> Array | None:
    rows = [parts[1:4] for line in data.splitlines() if (parts := line.split())[:1] == [keyword]]
    try:
        return np.array(rows, dtype=np.float64).reshape(-1, 3)
    except ValueError:
        return None


_FORMATS = {".obj": _obj_vertices, ".stl": _stl_vertices}


def parse_robot(
    root: Element,
    path: Path,
    packages: RosPackagePath,
    *,
    measure_meshes: bool = True,
    packages_only: bool = False,
) -> UrdfRobot:
    """Parses a `<robot>` element; for the arguments see `read_urdf`.

    Raises:
        SourceParseError: it has no link.
    """
    schemes = () if not measure_meshes else ("package:",) if packages_only else ("",)
    return _UrdfParser(root, path, packages, measured=schemes).parse()


class _UrdfParser:
    """Parser of one `<robot>` element."""

    def __init__(self, root: Element, path: Path, packages: RosPackagePath, *, measured: tuple[str, ...]) -> None:
        self.root, self.path, self.packages = root, path, packages
        self.measured = measured
        """How the names of meshes begin whose files are read."""
        self.issues: list[UrdfIssue] = []
        self.current_name = ""
        named = ((material.get("name", ""), self._color(material)) for material in root.findall("material"))
        self.colors = {name: color for name, color in named if color is not None}

    def parse(self) -> UrdfRobot:
        links = {link.name: link for link in self._parse_each("link", self._link)}
        joints = {joint.name: joint for joint in self._parse_each("joint", self._joint)}
        if not links:
            raise SourceParseError(str(self.path), cause="the robot in it has no link")
        connected = {name: joint for name, joint in joints.items() if self._has_ends(joint, links.keys())}
        rest = tuple(_element_text(each) for each in self.root if each.tag not in ("link", "joint"))
        name = self.root.get("name") or without_surrogates(self.path.name.split(".")[0])
        return UrdfRobot(
            name=name,
            links=tuple(links.values()),
            joints=tuple(self._with_master(joint, connected) for joint in connected.values()),
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
                problem = "its name is taken" if name else f"a {tag} has no name"
                self._add_issue(problem, "it is omitted", missing=True)
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
            inertial=None if not weight else self._inertial(element, weight),
            source_xml=_element_text(element),
        )

    def _inertial(self, element: Element, mass: float) -> UrdfInertial:
        inertial, tensor = element.find("inertial"), element.find("inertial/inertia")
        names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        numbers = [0.0 if tensor is None else self._number(tensor, name, 0.0) or 0.0 for name in names]
        xx, yy, zz, xy, xz, yz = numbers
        origin = IDENTITY if inertial is None else self._origin(inertial)
        return UrdfInertial(mass_kg=mass, origin=origin, tensor=(xx, yy, zz, xy, xz, yz))

    def _geometry(self, element: Element) -> UrdfGeometry | None:
        geometry = element.find("geometry")
        shape = None if geometry is None else next((child for child in geometry if child.tag in _GEOMETRY_TAGS), None)
        if shape is None:
            self._add_issue(f"a <{element.tag}> has no box, cylinder, sphere or mesh", "it is omitted", missing=True)
            return None
        geometry_type, size, mesh, center = UrdfGeometryType(shape.tag), None, None, IDENTITY
        scale = (1.0, 1.0, 1.0)
        origin = self._origin(element)
        if geometry_type is UrdfGeometryType.MESH:
            mesh = shape.get("filename") or None
            box = mesh_bounds(mesh, self.path, self.packages) if mesh and mesh.startswith(self.measured) else None
            if mesh is None:
                self._add_issue("a mesh has no file name", "it is omitted", missing=True)
                return None
            scale = self._vector(shape, "scale", scale)
            if box is not None:
                size, center = to_vector(np.abs(box.size * scale)), Pose(to_vector(box.center * scale))
        else:
            size = self._size(geometry_type, shape)
            if size is None:
                return None
        material, color = self._material(element.find("material"))
        return UrdfGeometry(
            geometry_type=geometry_type,
            origin=pose_from_array(pose_multiply(normalized_pose_array(origin), normalized_pose_array(center))),
            size=size,
            mesh=mesh,
            mesh_scale=scale,
            mesh_origin=IDENTITY if mesh is None else origin,
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
                f"a {geometry_type.value} has no size of numbers that are 0 or more", "it is omitted", missing=True
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
        rgba = [number for number in numbers if number is not None and 0.0 <= number <= 1.0]
        if color is not None and (len(rgba) != len(numbers) or len(rgba) not in (3, 4)):
            self._add_issue(f"the color {color.get('rgba', '')!r} is not four numbers from 0 to 1", "it has none")
            return None
        return None if color is None else (rgba[0], rgba[1], rgba[2])

    # -- joints --------------------------------------------------------------------------------------------------------

    def _joint(self, element: Element, name: str) -> UrdfJoint:
        ends = [end.get("link", "") if (end := element.find(role)) is not None else "" for role in ("parent", "child")]
        type_name = element.get("type", "")
        if type_name not in _JOINT_TYPES:
            self._add_issue(f"{type_name!r} is not a type of joint", "the two links are joined rigidly")
        type = UrdfJointType(type_name) if type_name in _JOINT_TYPES else UrdfJointType.FIXED
        axis_of = element.find("axis")
        axis = (1.0, 0.0, 0.0) if axis_of is None else self._vector(axis_of, "xyz", (1.0, 0.0, 0.0))
        if not any(axis):
            if type is not UrdfJointType.FIXED:  # exporters write it for these
                self._add_issue("its axis is 0 0 0", "1 0 0 is used")
            axis = (1.0, 0.0, 0.0)
        dynamics, limit = element.find("dynamics"), element.find("limit")
        return UrdfJoint(
            name=name,
            type=type,
            parent=ends[0],
            child=ends[1],
            origin=self._origin(element),
            axis=axis,
            range=self._joint_range(element, type),
            mimic=self._mimic(element, type),
            velocity=None if limit is None else self._number(limit, "velocity"),
            effort=None if limit is None else self._number(limit, "effort"),
            damping=(self._number(dynamics, "damping", 0.0) or 0.0) if dynamics is not None else 0.0,
            friction=(self._number(dynamics, "friction", 0.0) or 0.0) if dynamics is not None else 0.0,
            source_xml=_element_text(element),
        )

    def _mimic(self, element: Element, type: UrdfJointType) -> UrdfMimic | None:
        mimic = element.find("mimic")
        if mimic is None:
            return None
        if type not in _SINGLE_AXIS_TYPES:
            self._add_issue(f"a {type.value} joint mimics {mimic.get('joint', '')!r}", "it does not follow it")
            return None
        multiplier, offset = self._number(mimic, "multiplier", 1.0), self._number(mimic, "offset", 0.0)
        return UrdfMimic(
            joint=mimic.get("joint", ""), multiplier=1.0 if multiplier is None else multiplier, offset=offset or 0.0
        )

    def _with_master(self, joint: UrdfJoint, joints: Mapping[str, UrdfJoint]) -> UrdfJoint:
        """Returns a joint that mimics a joint with one axis, directly or by way of others, or does not mimic."""
        self.current_name = joint.name
        visited, master = {joint.name}, joint
        while master.mimic is not None:
            name = master.mimic.joint
            if name not in joints or joints[name].type not in _SINGLE_AXIS_TYPES:
                what = "which is not a joint with one axis"
            elif name in visited:
                what = "which mimics it in turn"
            else:
                visited.add(name)
                master = joints[name]
                continue
            self._add_issue(f"it mimics {name!r}, {what}", "it moves independently")
            return replace(joint, mimic=None)
        return joint

    def _joint_range(self, element: Element, type: UrdfJointType) -> tuple[float, float] | None:
        if type not in (UrdfJointType.REVOLUTE, UrdfJointType.PRISMATIC):
            return None
        limit = element.find("limit")
        if limit is None:
            self._add_issue("it has no limit", "it may move without limits")
            return None
        lower, upper = self._number(limit, "lower", 0.0), self._number(limit, "upper", 0.0)
        if lower is None or upper is None:
            return None
        if lower > upper:
            self._add_issue(f"its lower limit {lower:g} is above its upper limit {upper:g}", "the two are swapped")
            return upper, lower
        return lower, upper

    def _has_ends(self, joint: UrdfJoint, links: Container[str]) -> bool:
        self.current_name = joint.name
        missing = [end or "nothing" for end in (joint.parent, joint.child) if end not in links]
        if missing or joint.parent == joint.child:
            problem = (
                f"it joins {' and '.join(missing)}, which is not a link" if missing else "it joins a link to itself"
            )
            self._add_issue(problem, "it is omitted", missing=True)
        return not missing and joint.parent != joint.child

    # -- numbers -------------------------------------------------------------------------------------------------------

    def _origin(self, element: Element) -> Pose:
        """Reads `<origin>`; roll, pitch and yaw are rotations about the fixed axes x, y and z, in this order."""
        origin = element.find("origin")
        if origin is None:
            return IDENTITY
        quaternion = np.array([1.0, 0.0, 0.0, 0.0])
        for axis, angle in enumerate(self._vector(origin, "rpy", (0.0, 0.0, 0.0))):
            rotation = np.zeros(4)
            rotation[0], rotation[1 + axis] = np.cos(angle / 2), np.sin(angle / 2)
            quaternion = quat_multiply(rotation, quaternion)
        return pose_from_array([*self._vector(origin, "xyz", (0.0, 0.0, 0.0)), *quaternion])

    def _vector(self, element: Element, attribute: str, default: Vector) -> Vector:
        text = element.get(attribute)
        if text is None:
            return default
        vector = _parse_vector(text if len(text.split()) > 1 or attribute != "scale" else f"{text} {text} {text}")
        if vector is None:
            used = " ".join(f"{number:g}" for number in default)
            self._add_issue(f"{attribute}={text!r} is not three finite numbers below 1e100", f"{used} is used")
        return default if vector is None else vector

    def _number(self, element: Element, attribute: str, default: float | None = None) -> float | None:
        text = element.get(attribute)
        if text is None:
            return default
        number = _parse_number(text)
        if number is None:
            self._add_issue(
                f"{attribute}={text!r} of <{element.tag}> is not a finite number below 1e100", "it is ignored"
            )
        return number


def _parse_number(text: str) -> float | None:
    number = codecs.parse_number(text)
    return number if number is not None and abs(number) < _TOO_LARGE else None


def _parse_vector(text: str) -> Vector | None:
    numbers = [_parse_number(part) for part in text.split()]
    finite = [number for number in numbers if number is not None]
    return (finite[0], finite[1], finite[2]) if len(finite) == len(numbers) == 3 else None


def _element_text(element: Element) -> str:
    """Serializes an element, without surrounding white space."""
    return ElementTree.tostring(element, encoding="unicode").strip()


def read_urdf(
    path: Path,
    packages: RosPackagePath,
    *,
    xacro: Mapping[str, str] | bool | None = False,
    measure_meshes: bool = True,
    packages_only: bool = False,
) -> UrdfRobot:
    """Reads a robot description.

    Args:
        path: a URDF or xacro file.
        packages: where `package://` meshes and files included by xacro are searched.
        xacro: whether the file is expanded if it contains xacro, or the values of its `xacro:arg` elements, by name:
            only where the user has named it and asked for it, never for a text that comes from a port, nor for a file
            that another file refers to.
        measure_meshes: whether mesh files are read for the sizes of geometries.
        packages_only: whether only those in packages are read: for a text that comes from a port.

    Raises:
        SourceParseError: the file does not exist, is too long or not well-formed, contains a document type, or needs
            xacro, which is not installed or fails.
        XacroRefusedError: it contains xacro, which is not asked for.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SourceParseError(str(path), cause=error.strerror or str(error)) from error
    root = parse_xml(path, data)
    if root.tag != "robot":
        raise SourceParseError(str(path), cause=f"its root element is <{root.tag}>, not <robot>")
    if place := _find_xacro(root):
        if xacro is None or xacro is False:
            raise XacroRefusedError(str(path), cause=f"{place} is written in xacro, {_ONLY_ON_REQUEST}")
        from mindstage.maps.urdf.xacro_process import expand_xacro

        data = expand_xacro(path, packages, {} if xacro is True else xacro)
        root = parse_xml(path, data)
    robot = parse_robot(root, path, packages, measure_meshes=measure_meshes, packages_only=packages_only)
    return replace(robot, source_xml=data.decode("utf-8", "replace"))


def _find_xacro(root: Element) -> str | None:
    """Where a file is written in xacro: in an element, an attribute or a text; None if nowhere.

    A declaration of the namespace alone, which expanded files keep, needs no expansion. Texts count only beside such a
    declaration, since the parameters of a simulator's plugins may contain `$` for other reasons.
    """
    prefixes = {"xacro"}
    declares_namespace = False
    for element in root.iter():
        for name, value in element.attrib.items():
            if name.startswith("xmlns:") and (name == "xmlns:xacro" or _XACRO_NAMESPACE.fullmatch(value.strip())):
                declares_namespace = True
                prefixes.add(name.removeprefix("xmlns:"))
    for element in root.iter():
        for name in (element.tag, *element.attrib):
            if ":" in name and name.partition(":")[0] in prefixes:
                return f"<{element.tag}>" if name == element.tag else f"the attribute {name} of <{element.tag}>"
        for name, value in element.attrib.items():
            if _XACRO_EXPRESSION.search(value):
                return f"the attribute {name} of <{element.tag}>"
        texts = (element.text, element.tail) if declares_namespace else ()
        if any(_XACRO_EXPRESSION.search(text) for text in texts if text):
            return f"a text in or after <{element.tag}>"
    return None


def parse_xml(path: Path, data: bytes) -> ElementTree.Element:
    """Parses an XML document of bounded size and depth, without a document type.

    Raises:
        SourceParseError: it is too long, too deep, not well-formed, or has a document type.
    """
    if len(data) > LENGTH_LIMIT:
        cause = f"it has {len(data):,} bytes; at most {LENGTH_LIMIT:,} are allowed"
        raise SourceParseError(str(path), cause=cause)
    parser, builder, depth = expat.ParserCreate(), ElementTree.TreeBuilder(), 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEPTH_LIMIT:
            cause = f"its elements are nested more than {DEPTH_LIMIT} deep"
            raise SourceParseError(str(path), cause=cause, line=parser.CurrentLineNumber)
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*_: object) -> None:
        cause = "it has a document type (DOCTYPE), which robot descriptions do not need; remove it"
        raise SourceParseError(str(path), cause=cause, line=parser.CurrentLineNumber)

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        cause = f"it is not well-formed XML: {expat.ErrorString(error.code)}"
        raise SourceParseError(str(path), cause=cause, line=error.lineno) from error
    return builder.close()
