"""A robot's description as a world: links are bodies, joints constraints, and what is fixed is attached.

A body stands where the first piece of its link stands, since that is where its box is; further pieces are bodies of
their own, attached to it. A link that is only a frame is a body without any extent. The text of each link, joint and
other element stays a fact (`ms:urdf`).

Posture: where each link stands, and what it hangs on, with every joint at 0 or as near to it as its limits allow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple
from urllib.parse import quote

import numpy as np
from msgspec.structs import replace

from mindstage.knowledge.dialects.joints import JointType, joint_from_axis
from mindstage.knowledge.rdf import assign_ids, part_name
from mindstage.knowledge.urdf.model import (
    UrdfGeometry,
    UrdfGeometryType,
    UrdfIssue,
    UrdfJoint,
    UrdfJointType,
    UrdfLink,
    UrdfRobot,
)
from mindstage.knowledge.vocabulary import URDF_LINK, URDF_TEXT
from mindstage.scene import (
    IDENTITY,
    Attachment,
    Body,
    BodyId,
    BodyPhysics,
    Iri,
    Joint,
    Literal,
    Material,
    Mobility,
    PrimitiveShape,
    PrimitiveType,
    PropertyAssertion,
    World,
)
from mindstage.scene.transforms import Array, normalized_pose_array, pose_from_array, pose_multiply, quat_rotate

__all__ = ["RestPose", "UrdfWorld", "rest_pose", "urdf_to_world"]


class RestPose(NamedTuple):
    """A robot at rest."""

    link_poses: Mapping[str, Array]
    """By link, its frame in the world."""
    joint_states: Mapping[str, tuple[UrdfJoint, Array, float]]
    """By child: the joint that holds it, the joint's frame in the world, and where the joint stands [m or rad]."""
    movable_links: frozenset[str]
    """Links that a joint lets move, or that hang on such."""
    issues: tuple[UrdfIssue, ...]


def rest_pose(robot: UrdfRobot) -> RestPose:
    """Goes from the roots to the tips; a joint that would close a circle is left out."""
    holders: dict[str, UrdfJoint] = {}
    oddities: list[UrdfIssue] = []
    for joint in robot.joints:
        if joint.child in holders:
            what = f"{joint.child} already hangs on {holders[joint.child].parent} by {holders[joint.child].name}"
            oddities.append(UrdfIssue(joint.name, what, "it is left out", is_missing=True))
        else:
            holders[joint.child] = joint
    for joint in _loop_joints(holders):
        what = f"{joint.child} would hang on itself, by way of {joint.parent}"
        oddities.append(UrdfIssue(joint.name, what, "it is left out", is_missing=True))
        del holders[joint.child]
    roots = [link.name for link in robot.links if link.name not in holders]
    if len(roots) > 1:
        oddities.append(
            UrdfIssue("", f"{len(roots)} links hang on nothing: {', '.join(roots[:5])}", "all are at 0 0 0")
        )
    links: dict[str, Array] = {root: normalized_pose_array(IDENTITY) for root in roots}
    frames: dict[str, tuple[UrdfJoint, Array, float]] = {}
    moving: set[str] = set()
    children: dict[str, list[UrdfJoint]] = {}
    for joint in holders.values():
        children.setdefault(joint.parent, []).append(joint)
    waiting = list(roots)
    for parent in waiting:
        for joint in children.get(parent, ()):
            frame = pose_multiply(links[parent], normalized_pose_array(joint.origin))
            at = _rest_position(joint)
            frames[joint.child] = joint, frame, at
            links[joint.child] = pose_multiply(frame, _joint_transform(joint, at))
            if joint.type is not UrdfJointType.FIXED or parent in moving:
                moving.add(joint.child)
            waiting.append(joint.child)
    return RestPose(links, frames, frozenset(moving), tuple(oddities))


def _loop_joints(parent_joints: Mapping[str, UrdfJoint]) -> list[UrdfJoint]:
    """One joint of each circle: the one that holds the link which was told first."""
    closing, done = [], set[str]()
    for start in parent_joints:
        way: dict[str, None] = {}
        link = start
        while link in parent_joints and link not in way and link not in done:
            way[link] = None
            link = parent_joints[link].parent
        if link in way:
            closing.append(parent_joints[link])
        done.update(way)
    return closing


def _rest_position(joint: UrdfJoint) -> float:
    if joint.range is None or joint.range[0] <= 0.0 <= joint.range[1]:
        return 0.0
    return min(joint.range, key=abs)


def _joint_transform(joint: UrdfJoint, position: float) -> Array:
    """The child's frame in that of the joint."""
    axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
    if joint.type is UrdfJointType.PRISMATIC:
        return np.array([*(position * axis), 1.0, 0.0, 0.0, 0.0])
    return np.array([0.0, 0.0, 0.0, np.cos(position / 2), *(np.sin(position / 2) * axis)])


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


class UrdfWorld(NamedTuple):
    """What a description comes to."""

    world: World
    class_of_link: Mapping[str, Iri]
    """By link, the class that its name tells."""
    iris_by_name: Mapping[str, Iri]
    """By link and by joint, what it is called."""
    issues: Sequence[UrdfIssue]


def urdf_to_world(
    robot: UrdfRobot,
    *,
    map: Iri | None = None,
    known_links: Mapping[str, tuple[Iri, Iri]] | None = None,
    class_of: Callable[[str], Iri | None] = lambda link: None,
) -> UrdfWorld:
    """A robot standing in the origin, its root fixed to the world.

    Args:
        robot: the description.
        map: the map that it stands in; one named after the robot, if none.
        known: links that are individuals already: their names and classes.
        class_of: what a link is by its name.
    """
    return _UrdfWorldBuilder(robot, map, known_links or {}, class_of).build()


class _UrdfWorldBuilder:
    """One robot on its way to a world."""

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
        for child, (joint, frame, at) in self.rest_pose.joint_states.items():
            if joint.type is UrdfJointType.FIXED:
                self.attachments.append((self.link_iris[joint.parent], self.link_iris[child]))
            else:
                joints.append((self.joint_iris[joint.name], joint, frame, at))
        ids = assign_ids({}, [self.map, *(body.iri for body in self.bodies), *(iri for iri, *_ in joints)])
        world = World(
            iri=self.map,
            name=self.map.rpartition("#")[2],
            bodies=tuple(_with_id(body, ids[body.iri]) for body in self.bodies),
            joints=tuple(self._constraint(ids, *each) for each in joints),
            attachments=tuple(Attachment(parent=ids[parent], child=ids[child]) for parent, child in self.attachments),
            facts=tuple(PropertyAssertion(URDF_TEXT, Literal(text)) for text in self.robot.other_elements),
        )
        oddities = (*self.robot.issues, *self.rest_pose.issues)
        return UrdfWorld(world, self.classes, self.joint_iris | self.link_iris, oddities)

    # -- bodies --------------------------------------------------------------------------------------------------------

    def _add_link(self, link: UrdfLink) -> None:
        pieces = _body_geometries(link)
        masses = _distribute_mass(link.mass_kg, pieces)
        iri, frame = self.link_iris[link.name], self.rest_pose.link_poses[link.name]
        facts = [PropertyAssertion(URDF_TEXT, Literal(link.source_xml))]
        if (
            link.name in self.rest_pose.joint_states
            and self.rest_pose.joint_states[link.name][0].type is UrdfJointType.FIXED
        ):
            facts.append(PropertyAssertion(URDF_TEXT, Literal(self.rest_pose.joint_states[link.name][0].source_xml)))
        mobility = Mobility.DYNAMIC if link.name in self.rest_pose.movable_links else Mobility.STATIC
        for number, (piece, mass) in enumerate(zip(pieces, masses, strict=True), 1):
            own = iri if number == 1 else self._unused_iri(f"{iri}-piece{number}", self.used_iris)
            if number > 1:
                self.attachments.append((iri, own))
            self.bodies.append(
                Body(
                    id=BodyId(own),
                    iri=own,
                    cls=self._class(link.name) if number == 1 else URDF_LINK,
                    pose=pose_from_array(
                        frame if piece is None else pose_multiply(frame, normalized_pose_array(piece.origin))
                    ),
                    size=(0.0, 0.0, 0.0) if piece is None else piece.size,
                    mesh=None if piece is None else piece.mesh,
                    shape=None if piece is None else _PRIMITIVE_SHAPES[piece.geometry_type],
                    physics=BodyPhysics(mobility=mobility, mass_kg=mass),
                    materials=() if piece is None else _materials(piece),
                    facts=tuple(facts) if number == 1 else (),
                )
            )

    def _class(self, link: str) -> Iri:
        if link in self.known_links:
            return self.known_links[link][1]
        told = self.class_of(link)
        if told is not None:
            self.classes[link] = told
        return told or URDF_LINK

    # -- joints --------------------------------------------------------------------------------------------------------

    def _constraint(
        self, ids: Mapping[Iri, BodyId], iri: Iri, joint: UrdfJoint, frame: Array, joint_position: float
    ) -> Joint:
        axis = quat_rotate(frame[3:], np.array(joint.axis))
        range = None if joint.range is None else (joint.range[0] - joint_position, joint.range[1] - joint_position)
        made = joint_from_axis(_JOINT_TYPES[joint.type], frame[:3], axis, range, damping=joint.damping)
        return Joint(
            id=ids[iri],
            iri=iri,
            parent=ids[self.link_iris[joint.parent]],
            child=ids[self.link_iris[joint.child]],
            pose=made.pose,
            linear=made.linear,
            angular=made.angular,
            facts=(PropertyAssertion(URDF_TEXT, Literal(joint.source_xml)),),
        )


def _body_geometries(link: UrdfLink) -> Sequence[UrdfGeometry | None]:
    """What of a link becomes bodies: what is seen, unless only what is bumped into tells its extents."""
    seen, solid = link.visuals, link.collisions
    measured = [pieces for pieces in (seen, solid) if pieces and all(piece.size is not None for piece in pieces)]
    pieces = measured[0] if measured else seen or solid
    if pieces is solid and seen and seen[0].mesh and len(solid) == 1 and seen[0].origin == solid[0].origin:
        return [_with_visual(solid[0], seen[0])]
    return pieces or [None]


def _with_visual(collision: UrdfGeometry, visual: UrdfGeometry) -> UrdfGeometry:
    """A solid piece that looks like the mesh around it."""
    return UrdfGeometry(
        geometry_type=collision.geometry_type,
        origin=collision.origin,
        size=collision.size,
        mesh=visual.mesh,
        color=visual.color,
        material=visual.material,
    )


def _distribute_mass(mass: float | None, geometries: Sequence[UrdfGeometry | None]) -> Sequence[float | None]:
    """A link's mass over its pieces, by their boxes."""
    if mass is None or len(geometries) == 1:
        return [mass] * len(geometries)
    volumes = np.array([np.prod(piece.size) if piece and piece.size else 0.0 for piece in geometries])
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
