"""Reading of robot descriptions to a `RobotModel`: URDF and xacro, with SRDF beside them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from mindstage.errors import RobotModelError, SourceParseError
from mindstage.knowledge.io.ros_packages import RosPackagePath
from mindstage.knowledge.urdf.model import UrdfInertial, UrdfJoint, UrdfJointType, UrdfRobot
from mindstage.knowledge.urdf.parse import read_urdf
from mindstage.robots.model import (
    ModelNote,
    RobotJoint,
    RobotJointType,
    RobotLink,
    RobotMimic,
    RobotModel,
)
from mindstage.robots.models.link_geometry import read_link_geometries
from mindstage.robots.models.link_tree import LinkTree, sorted_tree
from mindstage.robots.models.srdf import Srdf, read_srdf
from mindstage.robots.models.structure import find_structure
from mindstage.scene import Vector
from mindstage.scene.geometry import Inertia
from mindstage.scene.transforms import normalized_pose_array, rotation_matrix

__all__ = ["BUNDLED_FOLDER", "load_model"]

BUNDLED_FOLDER = Path(__file__).resolve().parent.parent / "bundled"
"""The folder of the bundled models."""
_JOINT_TYPES = {
    UrdfJointType.FIXED: RobotJointType.FIXED,
    UrdfJointType.REVOLUTE: RobotJointType.REVOLUTE,
    UrdfJointType.CONTINUOUS: RobotJointType.CONTINUOUS,
    UrdfJointType.PRISMATIC: RobotJointType.PRISMATIC,
}
_MIN_INERTIA = 1e-9


def load_model(
    source: str | Path,
    *,
    name: str | None = None,
    srdf: Path | None = None,
    folders: Iterable[Path] = (),
    cache: Path | None = None,
) -> RobotModel:
    """Reads a robot description.

    Args:
        source: the path of a URDF or xacro file, or the name of a bundled model, "mobile_manipulator".
        name: the name of the robot; by default that in the description.
        srdf: its SRDF; by default one of the same name beside the description, or in a folder `srdf` near it.
        folders: where `package://` meshes are searched.
        cache: directory for imported meshes; by default in the user's cache.

    Raises:
        RobotModelError: it cannot be read.
    """
    path = _path(source)
    packages = RosPackagePath((*folders, *_parent_folders(path)))
    try:
        urdf = read_urdf(path, packages, measure_meshes=False)
    except SourceParseError as error:
        raise RobotModelError(error.place, cause=error.cause, remedy="give a URDF or xacro file") from error
    geometries, notes = read_link_geometries(urdf, path, packages, cache=cache)
    links = [
        RobotLink(
            name=link.name,
            geometry=geometries.get(link.name),
            inertia=None if link.inertial is None else _inertia(link.inertial),
        )
        for link in urdf.links
    ]
    joints, joint_notes = _joints(urdf)
    ordered_links, ordered_joints, tree_notes = sorted_tree(links, joints)
    found = srdf or _srdf_beside(path)
    semantic = Srdf() if found is None else read_srdf(found)
    tree = LinkTree(ordered_links, ordered_joints)
    structure = find_structure(tree, semantic, name=name or urdf.name)
    names = {link.name for link in ordered_links}
    issues = [
        ModelNote(subject=issue.subject, text=f"{issue.problem}: {issue.action}", is_guess=not issue.is_missing)
        for issue in urdf.issues
    ]
    return RobotModel(
        name=name or urdf.name,
        links=ordered_links,
        joints=ordered_joints,
        base=structure.base,
        arms=structure.arms,
        grippers=structure.grippers,
        head=structure.head,
        sensors=structure.sensors,
        group_states=semantic.states,
        disabled_collisions=frozenset(pair for pair in semantic.disabled_collisions if names.issuperset(pair)),
        home_positions=structure.home_positions,
        source=str(path),
        urdf=urdf.source_xml,
        notes=(*issues, *joint_notes, *tree_notes, *notes, *structure.notes),
    )


def _path(source: str | Path) -> Path:
    bundled = BUNDLED_FOLDER / f"{source}.urdf"
    return bundled if bundled.is_file() else Path(source)


def _parent_folders(path: Path) -> list[Path]:
    """Folders above a description that may contain its package: at most four levels up."""
    return list(path.resolve().parents)[:5][:-1]


def _srdf_beside(path: Path) -> Path | None:
    """The SRDF of the same name beside a description, or in a folder `srdf` beside or above it."""
    stem = path.name.split(".")[0]
    candidates = [path.with_name(f"{stem}.srdf")]
    candidates += [folder / "srdf" / f"{stem}.srdf" for folder in list(path.parents)[:2]]
    return next((each for each in candidates if each.is_file()), None)


def _inertia(inertial: UrdfInertial) -> Inertia:
    """The inertia along the axes of the link."""
    row = normalized_pose_array(inertial.origin)
    xx, yy, zz, xy, xz, yz = inertial.tensor
    rotation = rotation_matrix(row[3:])
    tensor = rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ rotation.T
    a, b, c = row[:3].tolist()
    return Inertia(
        mass_kg=inertial.mass_kg,
        center=(a, b, c),
        tensor=(
            float(tensor[0, 0]),
            float(tensor[1, 1]),
            float(tensor[2, 2]),
            float(tensor[0, 1]),
            float(tensor[0, 2]),
            float(tensor[1, 2]),
        ),
    )


def _joints(urdf: UrdfRobot) -> tuple[list[RobotJoint], list[ModelNote]]:
    notes, joints = [], []
    for joint in urdf.joints:
        type = _JOINT_TYPES.get(joint.type)
        if type is None:
            text = f"a {joint.type.value} joint has more than one axis; its links are connected rigidly"
            notes.append(ModelNote(subject=joint.name, text=text, is_guess=False))
            type = RobotJointType.FIXED
        joints.append(_joint(joint, type))
    return joints, notes


def _joint(joint: UrdfJoint, type: RobotJointType) -> RobotJoint:
    lower, upper = joint.range or (None, None)
    is_movable = type is not RobotJointType.FIXED
    mimic = joint.mimic if is_movable else None
    return RobotJoint(
        name=joint.name,
        type=type,
        parent=joint.parent,
        child=joint.child,
        origin=joint.origin,
        axis=_unit(joint.axis),
        lower=lower,
        upper=upper,
        velocity=joint.velocity or None,
        effort=joint.effort or None,
        damping=max(joint.damping, 0.0),
        friction=max(joint.friction, 0.0),
        mimic=None
        if mimic is None
        else RobotMimic(joint=mimic.joint, multiplier=mimic.multiplier, offset=mimic.offset),
    )


def _unit(axis: Vector) -> Vector:
    x, y, z = (np.array(axis) / np.linalg.norm(axis)).tolist()
    return x, y, z
