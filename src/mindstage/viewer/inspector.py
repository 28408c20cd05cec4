"""Data of the page's panels: the scene tree, the details of one body, the status of simulation and map, the tour.

The status is published a few times a second if it has changed; the report of findings, assumptions and failed spawns is
sent on request. The scene tree refers to rows and classes by index: 5,000 bodies take a few hundred kilobytes.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from enum import IntEnum
from pathlib import Path

import msgspec

from mindstage.access.limits import FACTS, REPORT_ENTRIES
from mindstage.access.policies import READ
from mindstage.access.resources import without_paths
from mindstage.errors import MindstageError
from mindstage.rdf import Severity
from mindstage.rdf.graphs import local_name
from mindstage.scene import BlankNode, Body, BodyId, Color, Iri, IriRef, Literal, Pose, PropertyAssertion, Vector, World
from mindstage.scene.colors import hex_color
from mindstage.scene.joint_kinematics import is_robot_part, joint_reach
from mindstage.scene.transforms import Array, normalize, pose_from_array
from mindstage.simulation import ConnectedClient, EngineStats, JointAxisState, JointHandle, Simulation, StateSnapshot
from mindstage.viewer.answer_sentences import name_in_words
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
    "TourHandler",
    "TourState",
    "body_details",
    "live_details",
    "scene_tree",
    "world_title",
]


_POSITION_DIGITS = 4
_ROTATION_DIGITS = 5


class JointDetails(msgspec.Struct, frozen=True, kw_only=True):
    """A joint of the body."""

    id: BodyId
    other_body: BodyId
    """The other body of the joint."""
    moving: BodyId
    """The body that moves."""
    axes: tuple[JointAxisState, ...]


class MaterialDetails(msgspec.Struct, frozen=True, kw_only=True):
    """A material of the body."""

    name: str
    color: str | None
    """#rrggbb."""


class FactRow(msgspec.Struct, frozen=True, kw_only=True):
    """A property assertion, with local names."""

    property: str
    value: str
    id: BodyId | None = None
    """The body that the value refers to, if any."""


class StorageHint(msgspec.Struct, frozen=True, kw_only=True):
    """A storage place of bodies of this class."""

    class_name: str
    """The class of the storage place."""
    ids: tuple[BodyId, ...]
    """The bodies of that class."""


class BodyDetails(msgspec.Struct, frozen=True, kw_only=True):
    """The properties of a body that do not change while the simulation runs."""

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
    """Name of the geometry and the reason for it, if there is one."""


class LiveDetails(msgspec.Struct, frozen=True, kw_only=True):
    """The properties of a body that change while the simulation runs."""

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
    """Collects the details of a body.

    Args:
        world: the world that contains it.
        ancestors: superclasses of its class, nearest first.
        storage_places: storage places of its class.
        geometry: name of its geometry and the reason for it.
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
        attached_to=next((link.parent for link in world.attachments if link.child == body.id), None),
        attached_bodies=tuple(link.child for link in world.attachments if link.parent == body.id),
        joints=tuple(_joint(joint, body.id) for joint in joints),
        tags=tuple((tag.type, tag.key, tag.value) for tag in body.tags),
        facts=tuple(_fact_row(fact, ids) for fact in body.facts[: FACTS.count]),
        storage_places=tuple(storage_places),
        geometry=geometry,
    )


def live_details(id: BodyId, poses: Mapping[BodyId, Array], joints: Iterable[JointHandle]) -> LiveDetails:
    """Collects the pose and joint positions of a body, rounded so that numerical noise causes no updates.

    Args:
        poses: poses of the body and of those it is joined to, 7 each.
    """
    x, y, z, *quaternion = poses[id].tolist()
    row = [round(number, _POSITION_DIGITS) + 0.0 for number in (x, y, z)]
    row += [round(number, _ROTATION_DIGITS) + 0.0 for number in normalize(quaternion).tolist()]
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
                property=property, value=", ".join(local_name(each.property) for each in facts) or "a blank node"
            )


def _hex(color: Color | None) -> str | None:
    return None if color is None else hex_color(color)


class ParentLink(IntEnum):
    """How a body is linked to its parent in the tree."""

    NONE = 0
    """It has no parent."""
    ATTACHED = 1
    JOINT = 2


class SceneTreeRow(msgspec.Struct, frozen=True, array_like=True):
    """One body of the tree."""

    id: BodyId
    label: str
    cls: int
    """Index of its class in `SceneTree.classes`."""
    parent: int
    """Index of the parent row, or -1."""
    link: ParentLink
    joint: BodyId | None
    """The joint that links it to the parent, if any."""
    movable: bool
    """Whether it is dynamic."""
    encloses: bool
    """Whether it encloses the scene, so that only its outline is drawn."""


class SceneTree(msgspec.Struct, frozen=True, kw_only=True):
    """All bodies of a world as a tree."""

    name: str
    engine: str
    classes: tuple[str, ...]
    class_words: tuple[str, ...]
    """What people call the members of each class."""
    rows: tuple[SceneTreeRow, ...]
    joints: int
    """Number of joints that are not fixed."""


_OPAQUE = re.compile(
    r"map|world|environment|SemanticEnvironmentMap.*|.*[_-](?=\w*\d)(?=\w*[A-Za-z])\w{4,}|\w{12,}", re.ASCII
)
"""Names of maps that say nothing to people."""


def world_title(world: World, sources: Iterable[Path]) -> str:
    """The name of a world for people: its label, or its name, or that of its file if the name is an opaque id.

    Args:
        world: the world.
        sources: the files that are loaded; the one of the map is not known to be any but the last.
    """
    for fact in world.facts:
        if fact.property.endswith("#label") and isinstance(fact.value, Literal) and fact.value.text:
            return fact.value.text
    name = world.name or local_name(world.iri)
    if _OPAQUE.fullmatch(name) and (files := tuple(sources)):
        return files[-1].stem
    return name


def scene_tree(
    world: World, *, engine: str, enclosing: Container[BodyId] = (), sources: Iterable[Path] = ()
) -> SceneTree:
    """Builds the tree of a world: parents are the bodies that others are attached or joined to.

    Args:
        engine: name of the engine.
        enclosing: bodies that enclose the scene.
        sources: see `world_title`.
    """
    rows_by_id = {body.id: row for row, body in enumerate(world.bodies)}
    links: dict[BodyId, tuple[BodyId, ParentLink, BodyId | None]] = {}
    for joint in world.joints:
        # Parent and child may be swapped in the map; in the tree, the static body is the parent.
        swapped = _is_dynamic(world, rows_by_id, joint.parent) and not _is_dynamic(world, rows_by_id, joint.child)
        parent, child = (joint.child, joint.parent) if swapped else (joint.parent, joint.child)
        if parent in rows_by_id and child in rows_by_id and child not in links:
            links[child] = (parent, ParentLink.JOINT, joint.id)
    links |= {
        each.child: (each.parent, ParentLink.ATTACHED, None)
        for each in world.attachments
        if each.parent in rows_by_id and each.child in rows_by_id
    }
    links = _without_cycles(links)
    classes = {cls: number for number, cls in enumerate(dict.fromkeys(body.cls for body in world.bodies))}
    rows = []
    for body in world.bodies:
        parent, link, joint_id = links.get(body.id, (BodyId(""), ParentLink.NONE, None))
        rows.append(
            SceneTreeRow(
                id=body.id,
                label=body.label or "",
                cls=classes[body.cls],
                parent=rows_by_id.get(parent, -1),
                link=link,
                joint=joint_id,
                movable=body.physics.is_dynamic,
                encloses=body.id in enclosing,
            )
        )
    return SceneTree(
        name=world_title(world, sources),
        engine=engine,
        classes=tuple(map(local_name, classes)),
        class_words=tuple(name_in_words(local_name(cls)) for cls in classes),
        rows=tuple(rows),
        joints=sum(any(reach != 0.0 for reach in joint_reach(joint)) for joint in world.joints),
    )


def _is_dynamic(world: World, rows_by_id: Mapping[BodyId, int], id: BodyId) -> bool:
    return id in rows_by_id and world.bodies[rows_by_id[id]].physics.is_dynamic


def _without_cycles(
    parents: Mapping[BodyId, tuple[BodyId, ParentLink, BodyId | None]],
) -> dict[BodyId, tuple[BodyId, ParentLink, BodyId | None]]:
    """Removes the last link of each cycle that joints and attachments form."""
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


_PUBLISH_INTERVAL_S = 0.5
"""Minimum time between two status messages [s]."""
_CLIENTS_INTERVAL_S = 2.0


class StatusMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The status of the simulation; the topic `status`."""

    engine: str
    time_s: float
    playing: bool
    speed: float
    real_time_factor: float
    fault: str
    bodies: int
    statistics: EngineStats | None
    """None if the engine reports none."""
    clients: tuple[ConnectedClient, ...]
    browsers: int
    report: int
    """Revision of the report."""
    errors: int
    """Number of errors in maps and of failed spawns."""
    warnings: int
    assumptions: int


class ReportGroup(msgspec.Struct, frozen=True):
    """A group of entries."""

    name: str
    count: int


class ReportEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A finding, assumption or note."""

    group: str
    text: str
    ids: tuple[str, ...] = ()
    """The bodies that it concerns."""
    is_error: bool = False
    """Whether a part of the map is missing because of it."""


class ReportMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The report, errors first; the response to `status.report`."""

    groups: tuple[ReportGroup, ...]
    entries: tuple[ReportEntry, ...]
    total: int


class StatusHandler:
    """Publishes the topic `status`, and handles `status.report`."""

    def __init__(self, simulation: Simulation, channel: RpcChannel) -> None:
        """Registers `status.report`.

        Args:
            channel: the channel of the pages.
        """
        self._simulation, self._channel = simulation, channel
        self._due = self._clients_due = 0.0
        self._clients: tuple[ConnectedClient, ...] = ()
        self._last_message: tuple[object, str] = ((), "")
        self._last_report_key: object = None
        self._counts: tuple[int, int, int, int] = (0, 0, 0, 0)
        channel.register("status.report", EmptyRequest, self._get_report, READ, queue="status")

    def publish(self, snapshot: StateSnapshot) -> None:
        """Publishes the status at intervals, and at once if bodies were added or removed or the simulation failed."""
        now = time.monotonic()
        if now < self._due and self._last_message[0] is snapshot.ids and self._last_message[1] == snapshot.error:
            return
        self._due, self._last_message = now + _PUBLISH_INTERVAL_S, (snapshot.ids, snapshot.error)
        if now >= self._clients_due:
            self._clients, self._clients_due = self._simulation.clients.clients(), now + _CLIENTS_INTERVAL_S
        self._update_report()
        self._channel.publish("status", self._message(snapshot))

    def _update_report(self) -> None:
        """Counts the entries of the report again if it may have changed."""
        knowledge = self._simulation.knowledge
        key = (self._simulation.reports, knowledge.findings(), len(knowledge.assumptions()))
        if key != self._last_report_key:
            self._last_report_key = key
            entries = list(report_entries(self._simulation))
            errors = sum(entry.is_error for entry in entries)
            assumptions = sum(entry.group == _ASSUMPTION for entry in entries)
            self._counts = (self._counts[0] + 1, errors, len(entries) - errors - assumptions, assumptions)

    def _message(self, snapshot: StateSnapshot) -> StatusMessage:
        report, errors, warnings, assumptions = self._counts
        return StatusMessage(
            engine=self._simulation.engine.name,
            time_s=round(snapshot.time_s, 1),
            playing=snapshot.playing,
            speed=snapshot.speed,
            real_time_factor=round(snapshot.real_time_factor, 2),
            fault=without_paths(snapshot.error),
            bodies=len(snapshot.ids),
            statistics=snapshot.stats,
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
    """Builds the report of a simulation."""
    entries = sorted(report_entries(simulation), key=lambda entry: not entry.is_error)
    counts = dict.fromkeys((entry.group for entry in entries), 0)
    for entry in entries:
        counts[entry.group] += 1
    groups = tuple(ReportGroup(name, count) for name, count in counts.items())
    return ReportMessage(groups=groups, entries=tuple(entries[: REPORT_ENTRIES.count]), total=len(entries))


def report_entries(simulation: Simulation) -> Iterator[ReportEntry]:
    """Yields findings and assumptions about the maps, and failures and notes of spawning them."""
    by_iri = {str(body.iri): body.id for world in simulation.worlds for body in world.bodies}
    for finding in simulation.knowledge.findings():
        is_error = finding.severity is Severity.ERROR
        about = ", ".join(local_name(name) for name in (finding.individual, finding.property) if name)
        text = f"{about}: {finding.problem}; {finding.action}"
        ids = (by_iri[finding.individual],) if finding.individual in by_iri else ()
        yield ReportEntry(group=_MAP_ERROR if is_error else _MAP_WARNING, text=text, ids=ids, is_error=is_error)
    for assumption in simulation.knowledge.assumptions():
        verb = "set" if assumption.overridden else "assumed"
        text = f"{local_name(assumption.map)}: {assumption.topic} {verb} to {assumption.value}, {assumption.evidence}"
        yield ReportEntry(group=_ASSUMPTION, text=text)
    for report in simulation.reports:
        for failure in (*report.failed_bodies, *report.failed_joints, *report.failed_attachments):
            yield ReportEntry(group=_NOT_SPAWNED, text=f"{failure.id}: {failure.reason}", is_error=True)
        for note in report.notes:
            yield ReportEntry(group=note.kind.value, text=note.text, ids=note.ids)


class TourState(msgspec.Struct, frozen=True, kw_only=True):
    """What the tour of the page needs in order to notice that a step was done."""

    camera: tuple[Vector, Vector] | None
    """Where the camera of the page is, and what it looks at [m]; None without a 3D view."""
    part: BodyId | None
    """The door that the tour opens: that of a refrigerator, or else any door or drawer; None if there is none."""
    openness: float
    """How far it is open: 0 is closed, 1 open."""


class TourHandler:
    """Handles `tour.state`."""

    def __init__(
        self,
        simulation: Simulation,
        channel: RpcChannel,
        *,
        camera: Callable[[ClientSession], tuple[Vector, Vector] | None],
    ) -> None:
        """Registers the request.

        Args:
            channel: the channel of the pages.
            camera: returns where the camera of a session is, and what it looks at.
        """
        self._simulation, self._camera = simulation, camera
        self._refrigerator_door: tuple[object, BodyId | None] = (None, None)
        channel.register("tour.state", EmptyRequest, self._state, READ, queue="status")

    def _state(self, session: ClientSession, _: EmptyRequest) -> TourState:
        part, openness = self._find_refrigerator_door(), 0.0
        if part is not None:
            try:
                openness = self._simulation.joint(part).openness
            except MindstageError:
                part = None  # deleted in the meantime
        return TourState(camera=self._camera(session), part=part, openness=openness)

    def _find_refrigerator_door(self) -> BodyId | None:
        ids = self._simulation.state.ids
        if self._refrigerator_door[0] is not ids:
            worlds = self._simulation.worlds
            joints = [joint for world in worlds for joint in world.joints]
            joints = [joint for joint in joints if any(reach != 0.0 for reach in joint_reach(joint))]
            classes = {body.id: body.cls for world in worlds for body in world.bodies if not is_robot_part(body)}
            joints = [joint for joint in joints if joint.parent in classes and joint.child in classes]
            refrigerators = {id for id, cls in classes.items() if self._is_refrigerator(cls)}
            joints.sort(key=lambda joint: not {joint.parent, joint.child} & refrigerators)
            first = next(iter(joints), None)
            part = None if first is None else first.parent if first.child in refrigerators else first.child
            self._refrigerator_door = (ids, part)
        return self._refrigerator_door[1]

    def _is_refrigerator(self, cls: Iri) -> bool:
        return any(local_name(each) == "Refrigerator" for each in (cls, *self._simulation.knowledge.ancestors(cls)))
