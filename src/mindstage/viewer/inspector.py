"""Status: how the world, its engine and its guests are, and what was assumed about its map.

The short state goes to all visitors a few times a second, and only if it changed. The long lists (findings,
assumptions, what became of each spawn) are asked for by whoever looks at them.

Details: all that is known of one body, as the page shows it.

Outline: a world as the tree that the page shows: rooms, furniture, what belongs to it, what hangs on that.

It is written in rows and numbers of rows, so that five thousand bodies are a few hundred kilobytes, once for all.
"""

from __future__ import annotations

import time
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from enum import IntEnum

import msgspec

from mindstage.knowledge import Severity
from mindstage.knowledge.rdf import local_name
from mindstage.scene import BlankNode, Body, BodyId, Color, Iri, IriRef, Literal, Pose, PropertyAssertion, Vector, World
from mindstage.scene.colors import hex_color
from mindstage.scene.kinematics import joint_reach
from mindstage.scene.transforms import Array, normalize, pose_from_array
from mindstage.simulation import ConnectedClient, EngineStats, JointAxisState, JointHandle, Simulation, StateSnapshot
from mindstage.viewer.server import ClientSession, EmptyRequest, RpcChannel

__all__ = [
    "BodyDetails",
    "FactRow",
    "JointDetails",
    "LiveDetails",
    "MaterialDetails",
    "ParentLink",
    "ReportEntry",
    "ReportGroup",
    "ReportMessage",
    "SceneTree",
    "SceneTreeRow",
    "StatusHandler",
    "StatusMessage",
    "StorageHint",
    "body_details",
    "live_details",
    "scene_tree",
]


_MAX_FACTS = 200
_POSITION_DIGITS = 4
_ROTATION_DIGITS = 5


class JointDetails(msgspec.Struct, frozen=True, kw_only=True):
    """A constraint that the body is part of."""

    id: BodyId
    other_body: BodyId
    """The other end."""
    moving: BodyId
    """The end that moves."""
    axes: tuple[JointAxisState, ...]


class MaterialDetails(msgspec.Struct, frozen=True, kw_only=True):
    """A surface."""

    name: str
    color: str | None
    """#rrggbb."""


class FactRow(msgspec.Struct, frozen=True, kw_only=True):
    """A statement, in short names."""

    property: str
    value: str
    id: BodyId | None = None
    """Of the body that the value is."""


class StorageHint(msgspec.Struct, frozen=True, kw_only=True):
    """Where things of such a class are kept."""

    class_name: str
    """The class of the place."""
    ids: tuple[BodyId, ...]
    """The bodies that are such places."""


class BodyDetails(msgspec.Struct, frozen=True, kw_only=True):
    """What does not change while the physics goes on."""

    id: BodyId
    iri: Iri
    label: str
    cls: str
    ancestors: tuple[str, ...]
    size: Vector | None
    mass: float | None
    mobility: str | None
    gravity: bool | None
    overlap_events: bool | None
    materials: tuple[MaterialDetails, ...]
    attached_to: BodyId | None
    attached_bodies: tuple[BodyId, ...]
    joints: tuple[JointDetails, ...]
    tags: tuple[tuple[str, str, str], ...]
    facts: tuple[FactRow, ...]
    storage_places: tuple[StorageHint, ...]
    geometry: str
    """What its geometry is and why, where it has one."""


class LiveDetails(msgspec.Struct, frozen=True, kw_only=True):
    """What changes all the time."""

    id: BodyId
    pose: Pose
    joints: Mapping[BodyId, Mapping[str, float]]


def body_details(
    body: Body,
    world: World,
    *,
    ancestors: Sequence[Iri],
    joints: Iterable[JointHandle],
    storage_places: Iterable[StorageHint],
    geometry: str = "",
) -> BodyDetails:
    """What there is to know about a body.

    Args:
        body: as it is described.
        world: that it is in.
        ancestors: of its class, nearest first.
        joints: that it is part of.
        storage_places: where its kind is kept.
        geometry: what its geometry is and why.
    """
    ids = {str(other.iri): other.id for other in world.bodies}
    physics = body.physics
    return BodyDetails(
        id=body.id,
        iri=body.iri,
        label=body.label or "",
        cls=local_name(body.cls),
        ancestors=tuple(map(local_name, ancestors)),
        size=body.size,
        mass=physics.mass_kg,
        mobility=physics.mobility.value if physics.mobility else None,
        gravity=physics.gravity,
        overlap_events=physics.overlap_events,
        materials=tuple(MaterialDetails(name=each.name, color=_hex(each.color)) for each in body.materials),
        attached_to=next((hold.parent for hold in world.attachments if hold.child == body.id), None),
        attached_bodies=tuple(hold.child for hold in world.attachments if hold.parent == body.id),
        joints=tuple(_joint(joint, body.id) for joint in joints),
        tags=tuple((tag.type, tag.key, tag.value) for tag in body.tags),
        facts=tuple(_fact_row(fact, ids) for fact in body.facts[:_MAX_FACTS]),
        storage_places=tuple(storage_places),
        geometry=geometry,
    )


def live_details(id: BodyId, poses: Mapping[BodyId, Array], joints: Iterable[JointHandle]) -> LiveDetails:
    """Where a body and its joints are, in digits that a person reads: what trembles less than that is not told.

    Args:
        id: the body.
        poses: where all are, seven numbers each.
        joints: that it is part of.
    """
    x, y, z, *turn = poses[id].tolist()
    row = [round(number, _POSITION_DIGITS) + 0.0 for number in (x, y, z)]
    row += [round(number, _ROTATION_DIGITS) + 0.0 for number in normalize(turn).tolist()]
    return LiveDetails(
        id=id,
        pose=pose_from_array(row),
        joints={
            joint.joint.id: {
                axis: round(value, _POSITION_DIGITS) + 0.0 for axis, value in joint.positions(poses).items()
            }
            for joint in joints
        },
    )


def _joint(joint: JointHandle, id: BodyId) -> JointDetails:
    ends = (joint.joint.parent, joint.joint.child)
    other = ends[1] if ends[0] == id else ends[0]
    return JointDetails(id=joint.joint.id, other_body=other, moving=joint.moving_body, axes=joint.axes)


def _fact_row(fact: PropertyAssertion, ids: Mapping[str, BodyId]) -> FactRow:
    property = local_name(fact.property)
    match fact.value:
        case IriRef(iri):
            return FactRow(property=property, value=ids.get(iri) or local_name(iri), id=ids.get(iri))
        case Literal(text):
            return FactRow(property=property, value=text)
        case BlankNode(facts):
            return FactRow(
                property=property, value=", ".join(local_name(each.property) for each in facts) or "something"
            )


def _hex(color: Color | None) -> str | None:
    return None if color is None else hex_color(color)


class ParentLink(IntEnum):
    """What a body has to do with the one above it."""

    NONE = 0
    """Nothing is above it."""
    ATTACHED = 1
    JOINT = 2


class SceneTreeRow(msgspec.Struct, frozen=True, array_like=True):
    """One body."""

    id: BodyId
    label: str
    cls: int
    """A number of the classes."""
    parent: int
    """A number of a row, or -1."""
    link: ParentLink
    joint: BodyId | None
    """The constraint by which it is linked."""
    movable: bool
    """Whether the physics moves it."""
    encloses: bool
    """Whether it encloses the place, so that only its outline is drawn."""


class SceneTree(msgspec.Struct, frozen=True, kw_only=True):
    """All of a world."""

    name: str
    engine: str
    classes: tuple[str, ...]
    rows: tuple[SceneTreeRow, ...]
    joints: int
    """Constraints that let something move."""


def scene_tree(world: World, *, engine: str, enclosing: Container[BodyId] = ()) -> SceneTree:
    """The tree of a world: what is attached is below its holder, what a joint holds below the joint's parent.

    Args:
        world: all that is there.
        engine: who runs it.
        shells: bodies that enclose the place.
    """
    numbers = {body.id: row for row, body in enumerate(world.bodies)}
    above: dict[BodyId, tuple[BodyId, ParentLink, BodyId | None]] = {}
    for joint in world.joints:
        # The map may have the roles upside down: what moves is shown below what it moves in.
        upside_down = _is_dynamic(world, numbers, joint.parent) and not _is_dynamic(world, numbers, joint.child)
        parent, child = (joint.child, joint.parent) if upside_down else (joint.parent, joint.child)
        if parent in numbers and child in numbers and child not in above:
            above[child] = (parent, ParentLink.JOINT, joint.id)
    above |= {
        hold.child: (hold.parent, ParentLink.ATTACHED, None)
        for hold in world.attachments
        if hold.parent in numbers and hold.child in numbers
    }
    above = _without_cycles(above)
    classes = {cls: number for number, cls in enumerate(dict.fromkeys(body.cls for body in world.bodies))}
    rows = []
    for body in world.bodies:
        parent, link, joint_id = above.get(body.id, (BodyId(""), ParentLink.NONE, None))
        rows.append(
            SceneTreeRow(
                id=body.id,
                label=body.label or "",
                cls=classes[body.cls],
                parent=numbers.get(parent, -1),
                link=link,
                joint=joint_id,
                movable=body.physics.is_dynamic,
                encloses=body.id in enclosing,
            )
        )
    return SceneTree(
        name=world.name or local_name(world.iri),
        engine=engine,
        classes=tuple(map(local_name, classes)),
        rows=tuple(rows),
        joints=sum(any(reach != 0.0 for reach in joint_reach(joint)) for joint in world.joints),
    )


def _is_dynamic(world: World, numbers: Mapping[BodyId, int], id: BodyId) -> bool:
    return id in numbers and world.bodies[numbers[id]].physics.is_dynamic


def _without_cycles(
    parents: Mapping[BodyId, tuple[BodyId, ParentLink, BodyId | None]],
) -> dict[BodyId, tuple[BodyId, ParentLink, BodyId | None]]:
    """Joints may go round in a circle, which has no top; the last link of it is left out."""
    kept: dict[BodyId, tuple[BodyId, ParentLink, BodyId | None]] = {}
    for child, link in parents.items():
        if child not in _ancestors(link[0], kept):
            kept[child] = link
    return kept


def _ancestors(id: BodyId, parents: Mapping[BodyId, tuple[BodyId, ParentLink, BodyId | None]]) -> Iterable[BodyId]:
    seen = dict.fromkeys([id])
    while id in parents and parents[id][0] not in seen:
        id = parents[id][0]
        seen[id] = None
    return seen


_MAX_ENTRIES = 5000
"""So many entries a page gets at once; how many there are it is told besides."""
_PUBLISH_INTERVAL_S = 0.5
"""Nobody reads numbers faster."""
_CLIENTS_INTERVAL_S = 2.0


class StatusMessage(msgspec.Struct, frozen=True, kw_only=True):
    """What is always in view."""

    engine: str
    time_s: float
    playing: bool
    speed: float
    real_time_factor: float
    fault: str
    bodies: int
    statistics: EngineStats | None
    """None where the engine does not say."""
    clients: tuple[ConnectedClient, ...]
    browsers: int
    report: int
    """Counts up when the report is another."""
    errors: int
    """Things of the map that are not there, and what could not be spawned."""
    warnings: int
    assumptions: int


class ReportGroup(msgspec.Struct, frozen=True):
    """A group of entries, as people call it."""

    name: str
    count: int


class ReportEntry(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that was found, assumed or decided."""

    group: str
    text: str
    ids: tuple[str, ...] = ()
    """Bodies that it is about."""
    is_error: bool = False
    """Whether something is missing because of it."""


class ReportMessage(msgspec.Struct, frozen=True, kw_only=True):
    """All of them, the gravest first."""

    groups: tuple[ReportGroup, ...]
    entries: tuple[ReportEntry, ...]
    total: int


class StatusHandler:
    """Tells the channel's visitors how things are."""

    def __init__(self, simulation: Simulation, channel: RpcChannel) -> None:
        """Offers `status.report`, and publishes `status` whenever it is told of a frame.

        Args:
            stage: whose status it is.
            channel: to the pages.
        """
        self._simulation, self._channel = simulation, channel
        self._due = self._clients_due = 0.0
        self._clients: tuple[ConnectedClient, ...] = ()
        self._last_message: tuple[object, str] = ((), "")
        self._last_report_key: object = None
        self._counts: tuple[int, int, int, int] = (0, 0, 0, 0)
        channel.register("status.report", EmptyRequest, self._get_report, queue="status")

    def publish(self, frame: StateSnapshot) -> None:
        """Publishes the state, if it is time, or bodies came or went, or the world came to a stop."""
        now = time.monotonic()
        if now < self._due and self._last_message[0] is frame.ids and self._last_message[1] == frame.error:
            return
        self._due, self._last_message = now + _PUBLISH_INTERVAL_S, (frame.ids, frame.error)
        if now >= self._clients_due:
            self._clients, self._clients_due = self._simulation.clients.clients(), now + _CLIENTS_INTERVAL_S
        self._update_report()
        self._channel.publish("status", self._message(frame))

    def _update_report(self) -> None:
        """Looks again at what there is to report, if there may be more or less of it."""
        knowledge = self._simulation.knowledge
        now = (self._simulation.reports, knowledge.findings(), len(knowledge.assumptions()))
        if now != self._last_report_key:
            self._last_report_key = now
            entries = list(report_entries(self._simulation))
            grave = sum(entry.is_error for entry in entries)
            assumed = sum(entry.group == _ASSUMPTION for entry in entries)
            self._counts = (self._counts[0] + 1, grave, len(entries) - grave - assumed, assumed)

    def _message(self, frame: StateSnapshot) -> StatusMessage:
        report, errors, warnings, assumptions = self._counts
        return StatusMessage(
            engine=self._simulation.engine_name,
            time_s=round(frame.time_s, 1),
            playing=frame.playing,
            speed=frame.speed,
            real_time_factor=round(frame.real_time_factor, 2),
            fault=frame.error,
            bodies=len(frame.ids),
            statistics=frame.stats,
            clients=self._clients,
            browsers=len(self._channel.sessions),
            report=report,
            errors=errors,
            warnings=warnings,
            assumptions=assumptions,
        )

    def _get_report(self, _: ClientSession, __: EmptyRequest) -> ReportMessage:
        return simulation_report(self._simulation)


_MAP_ERROR = "map error"
_MAP_WARNING = "map warning"
_NOT_SPAWNED = "not spawned"
_ASSUMPTION = "assumption"


def simulation_report(simulation: Simulation) -> ReportMessage:
    """All that is to be told about what is on a stage."""
    entries = sorted(report_entries(simulation), key=lambda entry: not entry.is_error)
    counts = dict.fromkeys((entry.group for entry in entries), 0)
    for entry in entries:
        counts[entry.group] += 1
    groups = tuple(ReportGroup(name, count) for name, count in counts.items())
    return ReportMessage(groups=groups, entries=tuple(entries[:_MAX_ENTRIES]), total=len(entries))


def report_entries(simulation: Simulation) -> Iterator[ReportEntry]:
    """What was found odd in the maps, assumed about them, and decided when they were spawned."""
    by_iri = {str(body.iri): body.id for world in simulation.worlds for body in world.bodies}
    for finding in simulation.knowledge.findings():
        grave = finding.severity is Severity.ERROR
        about = ", ".join(local_name(name) for name in (finding.individual, finding.property) if name)
        text = f"{about}: {finding.problem}; {finding.action}"
        ids = (by_iri[finding.individual],) if finding.individual in by_iri else ()
        yield ReportEntry(group=_MAP_ERROR if grave else _MAP_WARNING, text=text, ids=ids, is_error=grave)
    for assumption in simulation.knowledge.assumptions():
        how = "set" if assumption.overridden else "assumed"
        text = f"{local_name(assumption.map)}: {assumption.topic} {how} to {assumption.value}, {assumption.evidence}"
        yield ReportEntry(group=_ASSUMPTION, text=text)
    for report in simulation.reports:
        for failure in (*report.failed_bodies, *report.failed_joints, *report.failed_attachments):
            yield ReportEntry(group=_NOT_SPAWNED, text=f"{failure.id}: {failure.reason}", is_error=True)
        for note in report.notes:
            yield ReportEntry(group=note.kind.value, text=note.text, ids=note.ids)
