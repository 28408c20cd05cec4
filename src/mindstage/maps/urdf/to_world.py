"""Conversion of a robot description to a world: links become bodies, and fixed joints attachments.

The pose of a body is that of the first geometry of its link, to which its size belongs. Further geometries become
bodies attached to it, and a link without geometry becomes a body of size 0. The XML of each element is kept as a fact
(`ms:urdf`). Every joint is at position 0, or at the limit closest to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple
from urllib.parse import quote

import numpy as np
from msgspec.structs import replace

from mindstage.maps.dialects.joints import JointType, joint_from_axis
from mindstage.maps.urdf.urdf_model import (
    UrdfGeometry,
    UrdfGeometryType,
    UrdfIssue,
    UrdfJoint,
    UrdfJointType,
    UrdfLink,
    UrdfRobot,
)
from mindstage.rdf.graphs import assign_ids, part_name
from mindstage.rdf.vocabulary import URDF_LINK, URDF_TEXT
from mindstage.scene import (
    IDENTITY,
    Attachment,
    Body,
    BodyId,
    BodyPhysics,
    Iri,
    Joint,
    JointMimic,
    Literal,
    Material,
    Mobility,
    PrimitiveShape,
    PrimitiveType,
    PropertyAssertion,
    World,
)
from mindstage.scene.transforms import (
    Array,
    axis_displacement,
    normalized_pose_array,
    pose_from_array,
    pose_multiply,
    quat_rotate,
)

__all__ = ["RestPose", "UrdfWorld", "rest_pose", "urdf_to_world"]


_PRIMITIVE_SHAPES = {
    UrdfGeometryType.BOX: None,
    UrdfGeometryType.MESH: None,
    UrdfGeometryType.SPHERE: PrimitiveShape(type=PrimitiveType.SPHERE),
    UrdfGeometryType.CYLINDER: PrimitiveShape(type=PrimitiveType.CYLINDER),
}
_JOINT_TYPES = {
    UrdfJointType.REVOLUTE: JointType.REVOLUTE,
    UrdfJointType.CONTINUOUS: JointType.REVOLUTE,
    UrdfJointType.PRISMATIC: JointType.PRISMATIC,
    UrdfJointType.FLOATING: JointType.FLOATING,
    UrdfJointType.PLANAR: JointType.PLANAR,
}


class RestPose(NamedTuple):
    """Forward kinematics of a robot at rest."""

    link_poses: Mapping[str, Array]
    """Frame of each link in the world."""
    joint_states: Mapping[str, tuple[UrdfJoint, Array, float]]
    """By child link: its joint, the joint frame in the world, and the joint position [m or rad]."""
    movable_links: frozenset[str]
    """Links that can move relative to their root."""
    issues: tuple[UrdfIssue, ...]


def rest_pose(robot: UrdfRobot) -> RestPose:
    """Computes the forward kinematics from the roots; a joint that would close a loop is omitted and reported."""
    parent_joints: dict[str, UrdfJoint] = {}
    issues: list[UrdfIssue] = []
    for joint in robot.joints:
        if joint.child in parent_joints:
            parent_joint = parent_joints[joint.child]
            problem = f"{joint.child} is already a child of {parent_joint.parent} by {parent_joint.name}"
            issues.append(UrdfIssue(joint.name, problem, "it is omitted", is_missing=True))
        else:
            parent_joints[joint.child] = joint
    for joint in _loop_joints(parent_joints):
        problem = f"{joint.child} would be its own ancestor, by way of {joint.parent}"
        issues.append(UrdfIssue(joint.name, problem, "it is omitted", is_missing=True))
        del parent_joints[joint.child]
    roots = [link.name for link in robot.links if link.name not in parent_joints]
    if len(roots) > 1:
        issues.append(UrdfIssue("", f"{len(roots)} links have no parent: {', '.join(roots[:5])}", "all are at 0 0 0"))
    links: dict[str, Array] = {root: normalized_pose_array(IDENTITY) for root in roots}
    joint_states: dict[str, tuple[UrdfJoint, Array, float]] = {}
    movable: set[str] = set()
    children: dict[str, list[UrdfJoint]] = {}
    for joint in parent_joints.values():
        children.setdefault(joint.parent, []).append(joint)
    positions, mimic_issues = _rest_positions(parent_joints.values())
    issues += mimic_issues
    queue = list(roots)
    for parent in queue:
        for joint in children.get(parent, ()):
            frame = pose_multiply(links[parent], normalized_pose_array(joint.origin))
            position = positions[joint.name]
            joint_states[joint.child] = joint, frame, position
            is_prismatic = joint.type is UrdfJointType.PRISMATIC
            displacement = axis_displacement(joint.axis, position, is_prismatic=is_prismatic)
            links[joint.child] = pose_multiply(frame, displacement)
            if joint.type is not UrdfJointType.FIXED or parent in movable:
                movable.add(joint.child)
            queue.append(joint.child)
    return RestPose(links, joint_states, frozenset(movable), tuple(issues))


def _loop_joints(parent_joints: Mapping[str, UrdfJoint]) -> list[UrdfJoint]:
    """Returns one joint of each loop: the parent joint of the loop's first link."""
    closing, done = [], set[str]()
    for start in parent_joints:
        chain: dict[str, None] = {}
        link = start
        while link in parent_joints and link not in chain and link not in done:
            chain[link] = None
            link = parent_joints[link].parent
        if link in chain:
            closing.append(parent_joints[link])
        done.update(chain)
    return closing


def _rest_position(joint: UrdfJoint) -> float:
    if joint.range is None or joint.range[0] <= 0.0 <= joint.range[1]:
        return 0.0
    return min(joint.range, key=abs)


def _rest_positions(joints: Iterable[UrdfJoint]) -> tuple[dict[str, float], list[UrdfIssue]]:
    """Returns the position of each joint at rest, where followers are where their masters put them [m or rad]."""
    by_name = {joint.name: joint for joint in joints}
    positions = {joint.name: _rest_position(joint) for joint in by_name.values() if joint.mimic is None}
    issues = []
    for joint in by_name.values():
        chain: list[UrdfJoint] = []
        here: UrdfJoint | None = joint
        while here is not None and here.name not in positions:
            chain.append(here)
            here = None if here.mimic is None else by_name.get(here.mimic.joint)
        for follower in reversed(chain):
            mimic = follower.mimic
            if mimic is None or mimic.joint not in positions:  # its master would close a loop, and is omitted
                positions[follower.name] = _rest_position(follower)
                continue
            positions[follower.name] = position = mimic.multiplier * positions[mimic.joint] + mimic.offset
            if follower.range is not None and not follower.range[0] - 1e-6 <= position <= follower.range[1] + 1e-6:
                problem = f"it mimics {mimic.joint!r}, whose rest position puts it at {position:g}, out of its range"
                issues.append(UrdfIssue(follower.name, problem, "it is there, and its range extends to it"))
    return positions, issues


class UrdfWorld(NamedTuple):
    """The world of a robot description, and the correspondence of names."""

    world: World
    class_of_link: Mapping[str, Iri]
    """Class inferred from the name of each link."""
    iris_by_name: Mapping[str, Iri]
    """IRI of each link and joint."""
    issues: Sequence[UrdfIssue]


def urdf_to_world(
    robot: UrdfRobot,
    *,
    map: Iri | None = None,
    known_links: Mapping[str, tuple[Iri, Iri]] | None = None,
    class_of: Callable[[str], Iri | None] = lambda link: None,
) -> UrdfWorld:
    """Converts a robot description to a world, with its root at the origin and static.

    Args:
        robot: the robot description.
        map: IRI of the map; derived from the robot's name if None.
        known_links: IRI and class of each link that is an individual already.
        class_of: returns the class of a link from its name, or None.
    """
    return _UrdfWorldBuilder(robot, map, known_links or {}, class_of).build()


class _UrdfWorldBuilder:
    """Conversion of one robot."""

    def __init__(
        self,
        robot: UrdfRobot,
        map: Iri | None,
        known_links: Mapping[str, tuple[Iri, Iri]],
        class_of: Callable[[str], Iri | None],
    ) -> None:
        self.robot, self.known_links, self.class_of = robot, known_links, class_of
        self.rest_pose: RestPose = rest_pose(robot)
        base = (
            f"http://mindstage.org/urdf/{_url_quoted(robot.name)}.owl#" if map is None else f"{map.rpartition('#')[0]}#"
        )
        taken = {iri for iri, _ in known_links.values()} | ({map} if map else set())
        self.link_iris: dict[str, Iri] = {}
        for link in robot.links:
            self.link_iris[link.name] = self._unused_iri(
                base + _url_quoted(link.name), taken, known_links.get(link.name, (None,))[0]
            )
        self.joint_iris = {
            joint.name: self._unused_iri(base + _url_quoted(joint.name), taken) for joint in robot.joints
        }
        self.map = map or self._unused_iri(base + _url_quoted(robot.name), taken)
        self.used_iris = taken
        self.simulated_joints: set[str] = set()
        """Names of the joints of the world."""
        self.classes: dict[str, Iri] = {}
        self.bodies: list[Body] = []
        self.attachments: list[tuple[Iri, Iri]] = []

    @staticmethod
    def _unused_iri(name: str, used_iris: set[Iri], preferred: Iri | None = None) -> Iri:
        iri = preferred or (Iri(name) if name not in used_iris else part_name(Iri(name), "joint", used_iris))
        used_iris.add(iri)
        return iri

    def build(self) -> UrdfWorld:
        for link in self.robot.links:
            self._add_link(link)
        joints: list[tuple[Iri, UrdfJoint, Array, float]] = []
        for child, (joint, frame, joint_position) in self.rest_pose.joint_states.items():
            if joint.type is UrdfJointType.FIXED:
                self.attachments.append((self.link_iris[joint.parent], self.link_iris[child]))
            else:
                joints.append((self.joint_iris[joint.name], joint, frame, joint_position))
        self.simulated_joints = {joint.name for _, joint, _, _ in joints}
        ids = assign_ids({}, [self.map, *(body.iri for body in self.bodies), *(iri for iri, *_ in joints)])
        world = World(
            iri=self.map,
            name=self.map.rpartition("#")[2],
            bodies=tuple(_with_id(body, ids[body.iri]) for body in self.bodies),
            joints=tuple(self._joint(ids, *each) for each in joints),
            attachments=tuple(Attachment(parent=ids[parent], child=ids[child]) for parent, child in self.attachments),
            facts=tuple(PropertyAssertion(URDF_TEXT, Literal(text)) for text in self.robot.other_elements),
        )
        issues = (*self.robot.issues, *self.rest_pose.issues)
        return UrdfWorld(world, self.classes, self.joint_iris | self.link_iris, issues)

    # -- bodies --------------------------------------------------------------------------------------------------------

    def _add_link(self, link: UrdfLink) -> None:
        geometries = _body_geometries(link)
        masses = _distribute_mass(link.mass_kg, geometries)
        iri, frame = self.link_iris[link.name], self.rest_pose.link_poses[link.name]
        facts = [PropertyAssertion(URDF_TEXT, Literal(link.source_xml))]
        if (
            link.name in self.rest_pose.joint_states
            and self.rest_pose.joint_states[link.name][0].type is UrdfJointType.FIXED
        ):
            facts.append(PropertyAssertion(URDF_TEXT, Literal(self.rest_pose.joint_states[link.name][0].source_xml)))
        mobility = Mobility.DYNAMIC if link.name in self.rest_pose.movable_links else Mobility.STATIC
        for number, (geometry, mass) in enumerate(zip(geometries, masses, strict=True), 1):
            body_iri = iri if number == 1 else self._unused_iri(f"{iri}-piece{number}", self.used_iris)
            if number > 1:
                self.attachments.append((iri, body_iri))
            self.bodies.append(
                Body(
                    id=BodyId(body_iri),
                    iri=body_iri,
                    cls=self._class(link.name) if number == 1 else URDF_LINK,
                    pose=pose_from_array(
                        frame if geometry is None else pose_multiply(frame, normalized_pose_array(geometry.origin))
                    ),
                    size=(0.0, 0.0, 0.0) if geometry is None else geometry.size,
                    mesh=None if geometry is None else geometry.mesh,
                    shape=None if geometry is None else _PRIMITIVE_SHAPES[geometry.geometry_type],
                    physics=BodyPhysics(mobility=mobility, mass_kg=mass),
                    materials=() if geometry is None else _materials(geometry),
                    facts=tuple(facts) if number == 1 else (),
                )
            )

    def _class(self, link: str) -> Iri:
        if link in self.known_links:
            return self.known_links[link][1]
        cls = self.class_of(link)
        if cls is not None:
            self.classes[link] = cls
        return cls or URDF_LINK

    # -- joints --------------------------------------------------------------------------------------------------------

    def _joint(
        self, ids: Mapping[Iri, BodyId], iri: Iri, joint: UrdfJoint, frame: Array, joint_position: float
    ) -> Joint:
        axis = quat_rotate(frame[3:], np.array(joint.axis))
        range = None
        if joint.range is not None:
            lower, upper = min(joint.range[0], joint_position), max(joint.range[1], joint_position)
            range = lower - joint_position, upper - joint_position
        mimic = None
        if joint.mimic is not None and joint.mimic.joint in self.simulated_joints:
            mimic = JointMimic(joint=ids[self.joint_iris[joint.mimic.joint]], multiplier=joint.mimic.multiplier)
        limits = joint_from_axis(_JOINT_TYPES[joint.type], frame[:3], axis, range, damping=joint.damping)
        return Joint(
            id=ids[iri],
            iri=iri,
            parent=ids[self.link_iris[joint.parent]],
            child=ids[self.link_iris[joint.child]],
            pose=limits.pose,
            linear=limits.linear,
            angular=limits.angular,
            mimic=mimic,
            facts=(PropertyAssertion(URDF_TEXT, Literal(joint.source_xml)),),
        )


def _body_geometries(link: UrdfLink) -> Sequence[UrdfGeometry | None]:
    """Returns the geometries that become bodies: the visual ones, unless only the collision ones have sizes."""
    visuals, collisions = link.visuals, link.collisions
    sized = [each for each in (visuals, collisions) if each and all(geometry.size is not None for geometry in each)]
    geometries = sized[0] if sized else visuals or collisions
    if (
        geometries is collisions
        and visuals
        and visuals[0].mesh
        and len(collisions) == 1
        and visuals[0].origin == collisions[0].origin
    ):
        return [_with_visual(collisions[0], visuals[0])]
    return geometries or [None]


def _with_visual(collision: UrdfGeometry, visual: UrdfGeometry) -> UrdfGeometry:
    """Returns a collision geometry with the mesh and the material of a visual one."""
    return UrdfGeometry(
        geometry_type=collision.geometry_type,
        origin=collision.origin,
        size=collision.size,
        mesh=visual.mesh,
        color=visual.color,
        material=visual.material,
    )


def _distribute_mass(mass: float | None, geometries: Sequence[UrdfGeometry | None]) -> Sequence[float | None]:
    """Distributes the mass of a link over its geometries, in proportion to their bounding boxes."""
    if mass is None or len(geometries) == 1:
        return [mass] * len(geometries)
    volumes = np.array([np.prod(each.size) if each and each.size else 0.0 for each in geometries])
    shares = volumes / volumes.sum() if volumes.sum() > 0.0 else np.full(len(geometries), 1 / len(geometries))
    return [float(mass * share) or None for share in shares]


def _materials(geometry: UrdfGeometry) -> tuple[Material, ...]:
    if not geometry.material and geometry.color is None:
        return ()
    return (Material(name=geometry.material, color=geometry.color),)


def _with_id(body: Body, id: BodyId) -> Body:
    return replace(body, id=id)


def _url_quoted(name: str) -> str:
    return quote(name, safe="-._~") or "robot"
