"""Reading of MJCF files as plain records, by MuJoCo's own parser and compiler.

The compiler resolves defaults, includes, Euler angles, meshes and inertias; what is read here is the compiled model.
The frames are those of the bodies in the file. The files that it names must be in its folder, below it, or in folders
that the caller grants.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import NDArray

from mindstage.access.resources import is_inside
from mindstage.engines.mujoco.joint_couplings import joint_couplings, tendon_joints
from mindstage.errors import RobotModelError, without_surrogates
from mindstage.scene import Color
from mindstage.scene.transforms import Array

__all__ = ["MjcfBody", "MjcfGeom", "MjcfGeomType", "MjcfJoint", "MjcfJointType", "MjcfModel", "read_mjcf"]

_MAX_BYTES = 64 * 1024 * 1024
_MAX_INCLUDED = 1000
"""Largest number of MJCF files that make one model."""
_REMEDY = "correct the file, or give the files that it includes"


class MjcfJointType(StrEnum):
    """The types of joints."""

    FREE = "free"
    BALL = "ball"
    SLIDE = "slide"
    HINGE = "hinge"


class MjcfGeomType(StrEnum):
    """The types of geoms that have a convex shape."""

    SPHERE = "sphere"
    CAPSULE = "capsule"
    ELLIPSOID = "ellipsoid"
    CYLINDER = "cylinder"
    BOX = "box"
    MESH = "mesh"


@dataclass(frozen=True, slots=True, eq=False)
class MjcfJoint:
    """A joint of a body."""

    name: str
    type: MjcfJointType
    position: Array
    """A point on its axis, in the frame of the body [m]."""
    axis: Array
    """Unit vector in the frame of the body."""
    reference: float
    """Its position at which the body is at its given pose [m or rad]."""
    range: tuple[float, float] | None
    effort: float | None
    """The largest force or moment of its actuators, and of those of the joints that follow it; None if they have no
    limit, or there are none."""
    damping: float
    friction: float
    armature: float
    mimic: tuple[str, float, float] | None
    """The joint that it follows by equality constraints, the factor, and the offset; without a name if they hold it at
    the offset."""
    mimic_error: float
    """Largest distance from there, since a loop couples joints by other curves than lines [m or rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class MjcfGeom:
    """A geom of a body."""

    type: MjcfGeomType
    pose: Array
    """Seven numbers, in the frame of the body."""
    size: Array
    """Extents along its axes [m]; those of a capsule include its caps."""
    points: Array
    """The vertices of a mesh, n x 3, in the frame of `pose`; empty for other types."""
    faces: NDArray[np.uint32]
    color: Color
    collides: bool
    """Whether it is in contact with anything; others are visual."""


@dataclass(frozen=True, slots=True, eq=False)
class MjcfBody:
    """A body; its joints are between it and its parent, the first one nearest to the parent."""

    name: str
    parent: str
    """Empty for a child of the world."""
    pose: Array
    """Seven numbers, in the frame of the parent, with its joints at their references."""
    joints: tuple[MjcfJoint, ...]
    geoms: tuple[MjcfGeom, ...]
    mass_kg: float
    center: Array
    """Center of mass in the frame of the body [m]."""
    inertia_rotation: Array
    """The axes of `moments` in the frame of the body, as a quaternion."""
    moments: Array
    is_mocap: bool


@dataclass(frozen=True, slots=True, eq=False)
class MjcfCamera:
    """A camera; it looks along its negative z axis, with y up."""

    name: str
    body: str
    position: tuple[float, ...]
    """In the frame of the body [m]."""
    quaternion: tuple[float, ...]
    """w, x, y, z."""
    field_of_view_rad: float
    """Vertical."""


@dataclass(frozen=True, slots=True, eq=False)
class MjcfModel:
    """The contents of an MJCF file."""

    name: str
    bodies: tuple[MjcfBody, ...]
    """Parents before children, without the world."""
    keyframes: tuple[tuple[str, tuple[tuple[str, float], ...]], ...]
    """Name, and the positions of joints with one axis."""
    excluded_pairs: frozenset[tuple[str, str]]
    """Pairs of bodies that do not collide, the lower name first."""
    cameras: tuple[MjcfCamera, ...] = ()
    """The cameras on bodies that are fixed there."""


def read_mjcf(path: Path, *, folders: Iterable[Path] = ()) -> MjcfModel:
    """Reads an MJCF file.

    Args:
        path: the file.
        folders: where files that it names may be, besides its own folder.

    Raises:
        RobotModelError: MuJoCo cannot read or compile it, or it names a file that is not in these folders.
    """
    try:
        _References(path, (path.parent, *folders)).check()
        model = mujoco.MjModel.from_xml_path(str(path))
    except OSError as error:
        raise RobotModelError(str(path), cause=error.strerror or str(error), remedy=_REMEDY) from error
    except ValueError as error:
        raise RobotModelError(str(path), cause=" ".join(str(error).split()), remedy=_REMEDY) from error
    return _MjcfReader(model, without_surrogates(path.stem)).read()


class _Reference(NamedTuple):
    """A file that an MJCF file names."""

    name: str
    folder: Path
    """That of the file that names it."""
    is_mjcf: bool


class _References:
    """The files that an MJCF file, and those that it includes, name.

    MuJoCo tries several folders for a name, depending on settings that any of the files may change; here each
    combination counts that is an existing file.
    """

    def __init__(self, path: Path, granted: Iterable[Path]) -> None:
        self.path, self.granted = path, tuple(granted)
        self._files: dict[str, None] = {}
        self._references: dict[_Reference, None] = {}
        self._directories = {"": None}

    def check(self) -> None:
        """Checks that all are in granted folders.

        Raises:
            RobotModelError: one is not, or a file cannot be parsed.
            OSError: a file cannot be read.
        """
        self._add(self.path)
        counts = None
        while counts != (len(self._references), len(self._directories)):
            counts = len(self._references), len(self._directories)
            for reference in tuple(self._references):
                for file in self._candidates(reference):
                    if not any(is_inside(file, folder) for folder in self.granted):
                        cause = f"it names {reference.name!r}, which is not in its folder"
                        remedy = "copy that file into the folder, or give its folder as one of `folders`"
                        raise RobotModelError(str(self.path), cause=cause, remedy=remedy)
                    if reference.is_mjcf:
                        self._add(file)

    def _add(self, path: Path) -> None:
        """Adds what one MJCF file names."""
        if os.path.normpath(path) in self._files:
            return
        self._files[os.path.normpath(path)] = None
        if len(self._files) > _MAX_INCLUDED:
            raise RobotModelError(str(self.path), cause=f"it has more than {_MAX_INCLUDED} files", remedy=_REMEDY)
        if path.stat().st_size > _MAX_BYTES:
            raise RobotModelError(str(path), cause=f"it has more than {_MAX_BYTES // 1024**2} MB", remedy=_REMEDY)
        try:
            root = ElementTree.fromstring(path.read_bytes().lstrip())
        except (ElementTree.ParseError, ValueError, LookupError) as error:
            raise RobotModelError(str(path), cause=f"it is no XML: {error}", remedy=_REMEDY) from error
        for element in root.iter():
            for key, value in element.attrib.items():
                name = value.replace("\\", "/")
                if key.startswith("file"):
                    self._references[_Reference(name, path.parent, element.tag in ("include", "model"))] = None
                elif key.endswith("dir"):
                    self._directories[name] = None

    def _candidates(self, reference: _Reference) -> Iterator[Path]:
        """The existing files that a name may stand for."""
        names = dict.fromkeys((reference.name, reference.name.rpartition("/")[2]))  # `strippath`
        folders = dict.fromkeys((self.path.parent, reference.folder))
        for folder, directory, name in product(folders, self._directories, names):
            if name and (file := folder / directory / name).is_file():
                yield file


class _MjcfReader:
    """The conversion of one compiled model."""

    def __init__(self, model: Any, name: str) -> None:
        self.model, self.name = model, name
        self.body_names = [self._name(mujoco.mjtObj.mjOBJ_BODY, row) or f"body{row}" for row in range(model.nbody)]
        self.joint_names = [self._name(mujoco.mjtObj.mjOBJ_JOINT, row) or f"joint{row}" for row in range(model.njnt)]
        self.couplings = joint_couplings(model)

    def _name(self, type: Any, row: int) -> str:
        return mujoco.mj_id2name(self.model, type, row) or ""

    def read(self) -> MjcfModel:
        model = self.model
        keyframes = []
        for row in range(model.nkey):
            one_axis = [joint for joint in range(model.njnt) if model.jnt_type[joint] in _ONE_AXIS]
            positions = (
                (self.joint_names[each], float(model.key_qpos[row, model.jnt_qposadr[each]])) for each in one_axis
            )
            keyframes.append((self._name(mujoco.mjtObj.mjOBJ_KEY, row), tuple(positions)))
        signatures = [divmod(int(signature), 1 << 16) for signature in model.exclude_signature]
        pairs = [(self.body_names[first], self.body_names[second]) for first, second in signatures]
        name = model.names[: model.names.index(b"\0")].decode() or self.name
        return MjcfModel(
            name=name,
            bodies=tuple(self._body(row) for row in range(1, model.nbody)),
            keyframes=tuple(keyframes),
            excluded_pairs=frozenset((min(pair), max(pair)) for pair in pairs),
            cameras=tuple(
                MjcfCamera(
                    name=self._name(mujoco.mjtObj.mjOBJ_CAMERA, row) or f"camera{row}",
                    body=self.body_names[model.cam_bodyid[row]],
                    position=tuple(model.cam_pos[row].tolist()),
                    quaternion=tuple(model.cam_quat[row].tolist()),
                    field_of_view_rad=math.radians(float(model.cam_fovy[row])),
                )
                for row in range(model.ncam)
                if model.cam_mode[row] == mujoco.mjtCamLight.mjCAMLIGHT_FIXED and model.cam_bodyid[row] > 0
            ),
        )

    def _body(self, row: int) -> MjcfBody:
        model = self.model
        first, count = int(model.body_jntadr[row]), int(model.body_jntnum[row])
        geoms = range(int(model.body_geomadr[row]), int(model.body_geomadr[row]) + int(model.body_geomnum[row]))
        parent = int(model.body_parentid[row])
        return MjcfBody(
            name=self.body_names[row],
            parent=self.body_names[parent] if parent else "",
            pose=np.concatenate([model.body_pos[row], model.body_quat[row]]),
            joints=tuple(self._joint(first + number) for number in range(count)),
            geoms=tuple(geom for each in geoms if (geom := self._geom(each)) is not None),
            mass_kg=float(model.body_mass[row]),
            center=model.body_ipos[row].copy(),
            inertia_rotation=model.body_iquat[row].copy(),
            moments=model.body_inertia[row].copy(),
            is_mocap=int(model.body_mocapid[row]) >= 0,
        )

    def _joint(self, row: int) -> MjcfJoint:
        model = self.model
        dof, coupling = int(model.jnt_dofadr[row]), self.couplings.get(row)
        lower, upper = model.jnt_range[row].tolist()
        return MjcfJoint(
            name=self.joint_names[row],
            type=_JOINT_TYPES[int(model.jnt_type[row])],
            position=model.jnt_pos[row].copy(),
            axis=model.jnt_axis[row].copy(),
            reference=float(model.qpos0[model.jnt_qposadr[row]]) if model.jnt_type[row] in _ONE_AXIS else 0.0,
            range=(lower, upper) if model.jnt_limited[row] else None,
            effort=self._effort(row),
            damping=float(np.ravel(model.dof_damping[dof])[0]),
            friction=float(model.dof_frictionloss[dof]),
            armature=float(model.dof_armature[dof]),
            mimic=None if coupling is None else (self._leader(coupling.leader), coupling.multiplier, coupling.offset),
            mimic_error=0.0 if coupling is None else coupling.error,
        )

    def _leader(self, row: int) -> str:
        return self.joint_names[row] if row >= 0 else ""

    def _effort(self, joint: int) -> float | None:
        """The effort of a joint and those that follow it, by virtual work."""
        own = self._own_effort(joint)
        followers = ((row, each.multiplier) for row, each in self.couplings.items() if each.leader == joint)
        return own + sum(abs(multiplier) * self._own_effort(row) for row, multiplier in followers) or None

    def _own_effort(self, joint: int) -> float:
        """The limit of the joint, or the sum of the limits of its actuators; 0 without one."""
        model = self.model
        if model.jnt_actfrclimited[joint]:
            return float(np.abs(model.jnt_actfrcrange[joint]).max())
        total = 0.0
        for row in range(model.nu):
            target, ratio = int(model.actuator_trnid[row, 0]), 0.0
            if model.actuator_trntype[row] == mujoco.mjtTrn.mjTRN_JOINT:
                ratio = float(target == joint)
            elif model.actuator_trntype[row] == mujoco.mjtTrn.mjTRN_TENDON:
                ratio = abs(tendon_joints(model, target).get(joint, 0.0))
            gear = ratio * abs(float(model.actuator_gear[row, 0]))
            is_motor = model.actuator_biastype[row] == mujoco.mjtBias.mjBIAS_NONE
            if model.actuator_forcelimited[row]:
                total += gear * float(np.abs(model.actuator_forcerange[row]).max())
            elif is_motor and model.actuator_ctrllimited[row]:
                gain = abs(float(model.actuator_gainprm[row, 0]))
                total += gear * gain * float(np.abs(model.actuator_ctrlrange[row]).max())
        return total

    def _geom(self, row: int) -> MjcfGeom | None:
        model = self.model
        type = _GEOM_TYPES.get(int(model.geom_type[row]))
        if type is None:  # planes, height fields, signed distance fields
            return None
        radius, half, other = model.geom_size[row].tolist()
        size = {
            MjcfGeomType.SPHERE: (2 * radius,) * 3,
            MjcfGeomType.CAPSULE: (2 * radius, 2 * radius, 2 * (half + radius)),
            MjcfGeomType.CYLINDER: (2 * radius, 2 * radius, 2 * half),
        }.get(type, (2 * radius, 2 * half, 2 * other))
        points, faces = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.uint32)
        if type is MjcfGeomType.MESH:
            mesh = int(model.geom_dataid[row])
            start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
            points = np.asarray(model.mesh_vert[start : start + count], dtype=np.float64)
            start, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
            faces = np.asarray(model.mesh_face[start : start + count], dtype=np.uint32)
        material = int(model.geom_matid[row])
        red, green, blue, _ = (model.mat_rgba[material] if material >= 0 else model.geom_rgba[row]).tolist()
        return MjcfGeom(
            type=type,
            pose=np.concatenate([model.geom_pos[row], model.geom_quat[row]]),
            size=np.array(size),
            points=points,
            faces=faces,
            color=(red, green, blue),
            collides=bool(model.geom_contype[row] or model.geom_conaffinity[row]),
        )


_JOINT_TYPES = {
    int(mujoco.mjtJoint.mjJNT_FREE): MjcfJointType.FREE,
    int(mujoco.mjtJoint.mjJNT_BALL): MjcfJointType.BALL,
    int(mujoco.mjtJoint.mjJNT_SLIDE): MjcfJointType.SLIDE,
    int(mujoco.mjtJoint.mjJNT_HINGE): MjcfJointType.HINGE,
}
_ONE_AXIS = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
_GEOM_TYPES = {
    int(mujoco.mjtGeom.mjGEOM_SPHERE): MjcfGeomType.SPHERE,
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): MjcfGeomType.CAPSULE,
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): MjcfGeomType.ELLIPSOID,
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): MjcfGeomType.CYLINDER,
    int(mujoco.mjtGeom.mjGEOM_BOX): MjcfGeomType.BOX,
    int(mujoco.mjtGeom.mjGEOM_MESH): MjcfGeomType.MESH,
}
