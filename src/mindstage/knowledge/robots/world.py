"""A robot's description as a world: links are bodies, joints constraints, and what is fixed is attached.

A body stands where the first piece of its link stands, since that is where its box is; further pieces are bodies of
their own, attached to it. A link that is only a frame is a body without any extent. The text of each link, joint and
other element stays a fact (`ms:urdf`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple
from urllib.parse import quote

import numpy as np
from msgspec.structs import replace

from mindstage.knowledge.names import ids_for, part_name
from mindstage.knowledge.readers.joint_frames import JointKind, joint_along
from mindstage.knowledge.reading.other_words import URDF_LINK
from mindstage.knowledge.robots.posture import Posture, posture_of
from mindstage.knowledge.robots.robot import Geometry, GeometryKind, Joint, JointType, Link, Oddity, Robot
from mindstage.knowledge.vocabulary import URDF_TEXT
from mindstage.world import (
    Attachment,
    Body,
    BodyId,
    Constraint,
    Fact,
    Iri,
    Literal,
    Material,
    Mobility,
    Physics,
    Shape,
    ShapeKind,
    World,
)
from mindstage.world.geometry import Array, compose, pose_from, rotate, unit_pose

__all__ = ["RobotWorld", "robot_world"]

_SHAPES = {
    GeometryKind.BOX: None,
    GeometryKind.MESH: None,
    GeometryKind.SPHERE: Shape(kind=ShapeKind.SPHERE),
    GeometryKind.CYLINDER: Shape(kind=ShapeKind.CYLINDER),
}
_KINDS = {
    JointType.REVOLUTE: JointKind.HINGE,
    JointType.CONTINUOUS: JointKind.HINGE,
    JointType.PRISMATIC: JointKind.SLIDE,
    JointType.FLOATING: JointKind.FLOATING,
    JointType.PLANAR: JointKind.PLANAR,
}


class RobotWorld(NamedTuple):
    """What a description comes to."""

    world: World
    classes: Mapping[str, Iri]
    """By link, the class that its name tells."""
    names: Mapping[str, Iri]
    """By link and by joint, what it is called."""
    oddities: Sequence[Oddity]


def robot_world(
    robot: Robot,
    *,
    map: Iri | None = None,
    known: Mapping[str, tuple[Iri, Iri]] | None = None,
    class_of: Callable[[str], Iri | None] = lambda link: None,
) -> RobotWorld:
    """A robot standing in the origin, its root fixed to the world.

    Args:
        robot: the description.
        map: the map that it stands in; one named after the robot, if none.
        known: links that are individuals already: their names and classes.
        class_of: what a link is by its name.
    """
    return _Standing(robot, map, known or {}, class_of).world()


class _Standing:
    """One robot on its way to a world."""

    def __init__(
        self,
        robot: Robot,
        map: Iri | None,
        known: Mapping[str, tuple[Iri, Iri]],
        class_of: Callable[[str], Iri | None],
    ) -> None:
        self.robot, self.known, self.class_of = robot, known, class_of
        self.posture: Posture = posture_of(robot)
        base = f"http://mindstage.org/urdf/{_plain(robot.name)}.owl#" if map is None else f"{map.rpartition('#')[0]}#"
        taken = {iri for iri, _ in known.values()} | ({map} if map else set())
        self.iris: dict[str, Iri] = {}
        for link in robot.links:
            self.iris[link.name] = self._named(base + _plain(link.name), taken, known.get(link.name, (None,))[0])
        self.joint_iris = {joint.name: self._named(base + _plain(joint.name), taken) for joint in robot.joints}
        self.map = map or self._named(base + _plain(robot.name), taken)
        self.taken = taken
        self.classes: dict[str, Iri] = {}
        self.bodies: list[Body] = []
        self.attachments: list[tuple[Iri, Iri]] = []

    @staticmethod
    def _named(name: str, taken: set[Iri], given: Iri | None = None) -> Iri:
        iri = given or (Iri(name) if name not in taken else part_name(Iri(name), "joint", taken))
        taken.add(iri)
        return iri

    def world(self) -> RobotWorld:
        for link in self.robot.links:
            self._add(link)
        joints: list[tuple[Iri, Joint, Array, float]] = []
        for child, (joint, frame, at) in self.posture.joints.items():
            if joint.type is JointType.FIXED:
                self.attachments.append((self.iris[joint.parent], self.iris[child]))
            else:
                joints.append((self.joint_iris[joint.name], joint, frame, at))
        ids = ids_for({}, [self.map, *(body.iri for body in self.bodies), *(iri for iri, *_ in joints)])
        world = World(
            iri=self.map,
            name=self.map.rpartition("#")[2],
            bodies=tuple(_with_id(body, ids[body.iri]) for body in self.bodies),
            constraints=tuple(self._constraint(ids, *each) for each in joints),
            attachments=tuple(Attachment(parent=ids[parent], child=ids[child]) for parent, child in self.attachments),
            facts=tuple(Fact(URDF_TEXT, Literal(text)) for text in self.robot.rest),
        )
        oddities = (*self.robot.oddities, *self.posture.oddities)
        return RobotWorld(world, self.classes, self.joint_iris | self.iris, oddities)

    # -- bodies --------------------------------------------------------------------------------------------------------

    def _add(self, link: Link) -> None:
        pieces = _pieces(link)
        masses = _shares(link.mass_kg, pieces)
        iri, frame = self.iris[link.name], self.posture.links[link.name]
        facts = [Fact(URDF_TEXT, Literal(link.source))]
        if link.name in self.posture.joints and self.posture.joints[link.name][0].type is JointType.FIXED:
            facts.append(Fact(URDF_TEXT, Literal(self.posture.joints[link.name][0].source)))
        mobility = Mobility.DYNAMIC if link.name in self.posture.moving else Mobility.STATIC
        for number, (piece, mass) in enumerate(zip(pieces, masses, strict=True), 1):
            own = iri if number == 1 else self._named(f"{iri}-piece{number}", self.taken)
            if number > 1:
                self.attachments.append((iri, own))
            self.bodies.append(
                Body(
                    id=BodyId(own),
                    iri=own,
                    cls=self._class(link.name) if number == 1 else URDF_LINK,
                    pose=pose_from(frame if piece is None else compose(frame, unit_pose(piece.origin))),
                    size=(0.0, 0.0, 0.0) if piece is None else piece.size,
                    mesh=None if piece is None else piece.mesh,
                    shape=None if piece is None else _SHAPES[piece.kind],
                    physics=Physics(mobility=mobility, mass_kg=mass),
                    materials=() if piece is None else _materials(piece),
                    facts=tuple(facts) if number == 1 else (),
                )
            )

    def _class(self, link: str) -> Iri:
        if link in self.known:
            return self.known[link][1]
        told = self.class_of(link)
        if told is not None:
            self.classes[link] = told
        return told or URDF_LINK

    # -- joints --------------------------------------------------------------------------------------------------------

    def _constraint(self, ids: Mapping[Iri, BodyId], iri: Iri, joint: Joint, frame: Array, at: float) -> Constraint:
        axis = rotate(frame[3:], np.array(joint.axis))
        range = None if joint.range is None else (joint.range[0] - at, joint.range[1] - at)
        made = joint_along(_KINDS[joint.type], frame[:3], axis, range, damping=joint.damping)
        return Constraint(
            id=ids[iri],
            iri=iri,
            parent=ids[self.iris[joint.parent]],
            child=ids[self.iris[joint.child]],
            pose=made.pose,
            linear=made.linear,
            angular=made.angular,
            facts=(Fact(URDF_TEXT, Literal(joint.source)),),
        )


def _pieces(link: Link) -> Sequence[Geometry | None]:
    """What of a link becomes bodies: what is seen, unless only what is bumped into tells its extents."""
    seen, solid = link.visuals, link.collisions
    measured = [pieces for pieces in (seen, solid) if pieces and all(piece.size is not None for piece in pieces)]
    pieces = measured[0] if measured else seen or solid
    if pieces is solid and seen and seen[0].mesh and len(solid) == 1 and seen[0].origin == solid[0].origin:
        return [_dressed(solid[0], seen[0])]
    return pieces or [None]


def _dressed(solid: Geometry, seen: Geometry) -> Geometry:
    """A solid piece that looks like the mesh around it."""
    return Geometry(
        kind=solid.kind,
        origin=solid.origin,
        size=solid.size,
        mesh=seen.mesh,
        colour=seen.colour,
        material=seen.material,
    )


def _shares(mass: float | None, pieces: Sequence[Geometry | None]) -> Sequence[float | None]:
    """A link's mass over its pieces, by their boxes."""
    if mass is None or len(pieces) == 1:
        return [mass] * len(pieces)
    volumes = np.array([np.prod(piece.size) if piece and piece.size else 0.0 for piece in pieces])
    shares = volumes / volumes.sum() if volumes.sum() > 0.0 else np.full(len(pieces), 1 / len(pieces))
    return [float(mass * share) or None for share in shares]


def _materials(piece: Geometry) -> tuple[Material, ...]:
    if not piece.material and piece.colour is None:
        return ()
    return (Material(name=piece.material, colour=piece.colour),)


def _with_id(body: Body, id: BodyId) -> Body:
    return replace(body, id=id)


def _plain(name: str) -> str:
    return quote(name, safe="-._~") or "robot"
