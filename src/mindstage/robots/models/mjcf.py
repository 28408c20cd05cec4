"""Robots described as MJCF: bodies become links, and joints of one axis joints.

A body of MJCF may have several joints, at any point of it; a link has one, at its origin. Links without geometry are
added between, so that the frames of all bodies stay as they are. Above a root that moves is a link without geometry;
a free joint is left out, since the base of a robot is moved by its planar joint.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Iterable
from pathlib import Path

import msgspec
import numpy as np

from mindstage.engines.mujoco.mjcf_reading import (
    MjcfBody,
    MjcfGeom,
    MjcfGeomType,
    MjcfJoint,
    MjcfJointType,
    MjcfModel,
    read_mjcf,
)
from mindstage.errors import RobotModelError
from mindstage.robots.models.forward_kinematics import joint_motion
from mindstage.robots.models.link_geometry import PrimitivePart, hull_shape, primitive_mesh
from mindstage.robots.models.robot_model import (
    ModelNote,
    RobotJoint,
    RobotJointType,
    RobotLink,
    RobotMimic,
    RobotSensor,
    SensorType,
)
from mindstage.scene import (
    BodyGeometry,
    CollisionShape,
    CollisionShapeType,
    GeometrySource,
    PbrMaterial,
    VisualMesh,
)
from mindstage.scene.geometry import Inertia
from mindstage.scene.transforms import (
    Array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
    quat_rotate,
    rotation_matrix,
)
from mindstage.sensors.camera_model import CameraModel

__all__ = ["MjcfRobot", "read_mjcf_robot"]

_SHAPES = {
    MjcfGeomType.BOX: CollisionShapeType.BOX,
    MjcfGeomType.SPHERE: CollisionShapeType.SPHERE,
    MjcfGeomType.ELLIPSOID: CollisionShapeType.SPHERE,
    MjcfGeomType.CYLINDER: CollisionShapeType.CYLINDER,
}
_OPTICAL = (0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
"""The optical frame (y down, z forward) in the frame of a camera of MJCF (y up, z backward)."""
_CAMERA_SIZE_PX = (640, 480)
"""MJCF states the vertical field of view of a camera; its resolution is rarely given."""
_ONE_AXIS = (MjcfJointType.SLIDE, MjcfJointType.HINGE)
_WORLD = "world"
"""The link above a root that moves; MuJoCo gives no body this name."""
_COUPLING_ERRORS = {True: 1e-3, False: 0.02}
"""By how much a prismatic [m] or another joint [rad] may deviate from a linear coupling without a note."""


class MjcfRobot(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The links and joints of a robot described as MJCF."""

    name: str
    links: tuple[RobotLink, ...]
    joints: tuple[RobotJoint, ...]
    disabled_collisions: frozenset[tuple[str, str]]
    states: tuple[tuple[str, str, tuple[tuple[str, float], ...]], ...]
    """As `RobotModel.group_states`, with an empty group."""
    notes: tuple[ModelNote, ...]
    sensors: tuple[RobotSensor, ...] = ()
    """Its cameras."""


def read_mjcf_robot(path: Path, *, folders: Iterable[Path] = ()) -> MjcfRobot:
    """Reads a robot from an MJCF file, which may have other things in it.

    Args:
        path: the file.
        folders: where files that it names may be, besides its own folder.

    Raises:
        RobotModelError: MuJoCo cannot read it, or it has no body.
    """
    return _MjcfRobotReader(read_mjcf(path, folders=folders), path).read()


class _MjcfRobotReader:
    """The conversion of one file."""

    def __init__(self, model: MjcfModel, path: Path) -> None:
        self.model, self.path = model, path
        self.notes: list[ModelNote] = []
        self.links: list[RobotLink] = []
        self.joints: list[RobotJoint] = []

    def read(self) -> MjcfRobot:
        trees = self._trees()
        if not trees:
            raise RobotModelError(str(self.path), cause="it has no body", remedy="give the file of a robot")
        chosen = max(trees, key=lambda name: (sum(len(body.joints) for body in trees[name]), len(trees[name])))
        for name in trees:
            if name != chosen:
                text = f"it is left out, since it is not part of {chosen}"
                self.notes.append(ModelNote(subject=name, text=text, is_guess=False))
        prefix = _common_prefix(trees[chosen])
        root, *others = [_without_prefix(body, prefix) for body in trees[chosen]]
        if any(joint.type in _ONE_AXIS for joint in root.joints):
            self.links.append(RobotLink(name=_WORLD))
            others.insert(0, dataclasses.replace(root, parent=_WORLD))
        else:
            for joint in root.joints:
                text = "it moves the whole robot and is left out"
                self.notes.append(ModelNote(subject=joint.name, text=text))
            self.links.append(self._link(root))
        for body in others:
            self._add(body)
        names = {link.name for link in self.links}
        pairs = ((a.removeprefix(prefix), b.removeprefix(prefix)) for a, b in self.model.excluded_pairs)
        return MjcfRobot(
            name=self.model.name,
            links=tuple(self.links),
            joints=tuple(self.joints),
            disabled_collisions=frozenset(pair for pair in pairs if names.issuperset(pair)),
            states=tuple(
                ("", name, tuple((joint.removeprefix(prefix), position) for joint, position in positions))
                for name, positions in self.model.keyframes
            ),
            notes=tuple(self.notes),
            sensors=tuple(
                RobotSensor(
                    name=each.name,
                    type=SensorType.CAMERA,
                    link=each.body.removeprefix(prefix),
                    field_of_view_rad=each.field_of_view_rad,
                    pose=pose_from_array(pose_multiply([*each.position, *each.quaternion], _OPTICAL)),
                    camera=CameraModel.with_field_of_view(
                        2 * math.atan(math.tan(each.field_of_view_rad / 2) * _CAMERA_SIZE_PX[0] / _CAMERA_SIZE_PX[1]),
                        _CAMERA_SIZE_PX,
                    ),
                )
                for each in self.model.cameras
                if each.body.removeprefix(prefix) in names
            ),
        )

    def _trees(self) -> dict[str, list[MjcfBody]]:
        """The bodies below each child of the world, by its name."""
        root_of: dict[str, str] = {}
        trees: dict[str, list[MjcfBody]] = {}
        for body in self.model.bodies:
            root = root_of[body.name] = root_of[body.parent] if body.parent else body.name
            trees.setdefault(root, []).append(body)
        return {name: tree for name, tree in trees.items() if not tree[0].is_mocap}

    def _add(self, body: MjcfBody) -> None:
        """Adds the link of a body, and the joints to its parent."""
        joints = [joint for joint in body.joints if self._has_one_axis(joint)]
        parent, frame = body.parent, body.pose
        if not joints:
            self._add_joint(f"{body.name}_fixed", parent, body.name, frame)
        for number, joint in enumerate(joints):
            anchor = np.array([*joint.position, 1.0, 0.0, 0.0, 0.0])
            origin = pose_multiply(frame, anchor)
            is_last = number == len(joints) - 1
            is_at_origin = not joint.position.any()
            child = body.name if is_last and is_at_origin else f"{body.name}.{joint.name}"
            self._add_joint(joint.name, parent, child, origin, joint)
            if child != body.name:
                self.links.append(RobotLink(name=child))
            parent, frame = child, pose_inverse(anchor)
            if is_last and not is_at_origin:
                self._add_joint(f"{body.name}_fixed", parent, body.name, frame)
        self.links.append(self._link(body))

    def _has_one_axis(self, joint: MjcfJoint) -> bool:
        if joint.type in _ONE_AXIS:
            return True
        text = f"a {joint.type.value} joint has several axes; its links are connected rigidly"
        self.notes.append(ModelNote(subject=joint.name, text=text, is_guess=False))
        return False

    def _add_joint(self, name: str, parent: str, child: str, frame: Array, joint: MjcfJoint | None = None) -> None:
        if joint is None:
            origin = pose_from_array(frame)
            self.joints.append(
                RobotJoint(name=name, type=RobotJointType.FIXED, parent=parent, child=child, origin=origin)
            )
            return
        lower, upper = joint.range or (None, None)
        leader, multiplier, offset = joint.mimic or ("", 1.0, 0.0)
        type = RobotJointType.PRISMATIC
        if joint.type is MjcfJointType.HINGE:
            type = RobotJointType.CONTINUOUS if joint.range is None else RobotJointType.REVOLUTE
        x, y, z = joint.axis.tolist()
        made = RobotJoint(
            name=name,
            type=type,
            parent=parent,
            child=child,
            axis=(x, y, z),
            lower=lower,
            upper=upper,
            effort=joint.effort,
            damping=joint.damping,
            friction=joint.friction,
            armature=joint.armature,
            mimic=RobotMimic(joint=leader, multiplier=multiplier, offset=offset) if leader else None,
        )
        if joint.mimic is not None and not leader:
            text = "it is fixed, since equality constraints hold it"
            self.notes.append(ModelNote(subject=name, text=text))
            origin = pose_from_array(pose_multiply(frame, joint_motion(made, offset - joint.reference)))
            self.joints.append(
                RobotJoint(name=name, type=RobotJointType.FIXED, parent=parent, child=child, origin=origin)
            )
            return
        if joint.mimic_error > _COUPLING_ERRORS[made.is_prismatic]:
            text = f"it moves with {leader} by a loop; that it is {multiplier:.3g} times as far is off by at most"
            self.notes.append(ModelNote(subject=name, text=f"{text} {joint.mimic_error:.2g} {made.unit}"))
        # A body is at its given pose when the joint is at its reference, not at 0.
        origin = pose_from_array(pose_multiply(frame, joint_motion(made, -joint.reference)))
        self.joints.append(msgspec.structs.replace(made, origin=origin))

    def _link(self, body: MjcfBody) -> RobotLink:
        inertia = None
        if body.mass_kg > 0.0:
            rotation = rotation_matrix(body.inertia_rotation)
            (xx, xy, xz), (_, yy, yz), (_, _, zz) = (rotation @ np.diag(body.moments) @ rotation.T).tolist()
            a, b, c = body.center.tolist()
            inertia = Inertia(mass_kg=body.mass_kg, center=(a, b, c), tensor=(xx, yy, zz, xy, xz, yz))
        return RobotLink(name=body.name, geometry=_geometry(body.geoms, self.path.name), inertia=inertia)


def _common_prefix(bodies: Iterable[MjcfBody]) -> str:
    """What all names begin with, up to the first ":" or "/", by which files with several robots tell them apart."""
    names = [name for body in bodies for name in (body.name, *(joint.name for joint in body.joints))]
    ends = [position for sign in ":/" if (position := names[0].find(sign)) > 0]
    prefix = names[0][: min(ends) + 1] if ends else ""
    return prefix if all(name.startswith(prefix) for name in names) else ""


def _without_prefix(body: MjcfBody, prefix: str) -> MjcfBody:
    joints = []
    for joint in body.joints:
        mimic = joint.mimic
        if mimic is not None:
            mimic = (mimic[0].removeprefix(prefix), *mimic[1:])
        joints.append(dataclasses.replace(joint, name=joint.name.removeprefix(prefix), mimic=mimic))
    name, parent = body.name.removeprefix(prefix), body.parent.removeprefix(prefix)
    return dataclasses.replace(body, name=name, parent=parent, joints=tuple(joints))


def _geometry(geoms: Iterable[MjcfGeom], reason: str) -> BodyGeometry | None:
    """The geometry of a body; None if it has no geom."""
    geoms = tuple(geoms)
    if not geoms:
        return None
    solid = [geom for geom in geoms if geom.collides]
    visual = [geom for geom in geoms if not geom.collides] or solid
    shapes = tuple(shape for shape in map(_collision_shape, solid) if shape is not None)
    meshes = tuple(map(_visual_mesh, visual))
    digest = hashlib.sha256(repr(shapes).encode())
    for mesh in meshes:
        digest.update(mesh.points.tobytes() + mesh.faces.tobytes() + repr(mesh.material).encode())
    return BodyGeometry(
        key=digest.hexdigest()[:32],
        visuals=meshes,
        collision_shapes=shapes,
        source=GeometrySource.MESH,
        reason=reason,
        shape_name="mesh",
    )


def _collision_shape(geom: MjcfGeom) -> CollisionShape | None:
    if geom.type is MjcfGeomType.MESH:
        return hull_shape(quat_rotate(geom.pose[3:], geom.points) + geom.pose[:3])
    return _primitive(geom)


def _primitive(geom: MjcfGeom) -> CollisionShape:
    x, y, z = geom.size.tolist()
    if geom.type is MjcfGeomType.CAPSULE:
        hull = hull_shape(quat_rotate(geom.pose[3:], _capsule_points(x / 2, z / 2)) + geom.pose[:3])
        assert hull is not None
        return hull
    return CollisionShape(type=_SHAPES[geom.type], size=(x, y, z), pose=pose_from_array(geom.pose))


def _capsule_points(radius: float, half: float) -> Array:
    """Points on a capsule along z; `half` includes the cap."""
    around = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    points = []
    for up in np.linspace(-np.pi / 2, np.pi / 2, 8):
        offset = (half - radius) * np.sign(up)
        for angle in around:
            ring = radius * np.cos(up)
            points.append([ring * np.cos(angle), ring * np.sin(angle), radius * np.sin(up) + offset])
    return np.array(points)


def _visual_mesh(geom: MjcfGeom) -> VisualMesh:
    if geom.type is MjcfGeomType.MESH:
        points = quat_rotate(geom.pose[3:], geom.points) + geom.pose[:3]
        return VisualMesh(points, geom.faces, PbrMaterial(color=geom.color, roughness=0.6))
    return primitive_mesh(PrimitivePart(_primitive(geom), geom.color))
