"""Detects what happens to bodies while a plan is executed: falls, tilts, collisions, and bodies that leave the place.

The poses of all bodies are compared with reference poses, those at the start of the sample or after a step has set
them. One comparison costs a few operations on arrays, whatever the number of bodies.

Thresholds: a body fell if it and its lowest point are `FALL_M` lower than in its reference pose, and tipped if its
vertical axis has turned by `TIP_RAD`: what tips over where it stands does not fall, and what turns after it began to
fall does not tip over. Bodies on joints, such as doors and drawers, do neither. A contact counts from
`CONTACT_FORCE_N`, and a thing begins inside of another one from `OVERLAP_M`.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass
from math import acos, cos, pi
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.engines.base import Capability, Contact, Engine, PoseArray, SpawnNote, SpawnNoteKind
from mindstage.engines.environment_bounds import EnvironmentBounds
from mindstage.imagination.results import EventKind, ImaginedEvent
from mindstage.scene import BodyId, Mobility, World
from mindstage.scene.bounding_boxes import OrientedBoxes
from mindstage.scene.joint_kinematics import RigidGroups
from mindstage.scene.spatial import SpatialRelation, SpatialRelations
from mindstage.scene.transforms import Array, normalize, pose_from_array
from mindstage.simulation import Simulation
from mindstage.simulation.placement import enclosing_body_ids
from mindstage.simulation.state import WorldSession

__all__ = [
    "CONTACT_FORCE_N",
    "FALL_M",
    "MAX_CORRECTION_M",
    "MOVED_M",
    "OVERLAP_M",
    "TIP_RAD",
    "EventWatch",
    "Overlap",
    "WatchBasis",
]

FALL_M = 0.05
"""A body that is lower than its reference pose by this height, with its lowest point, fell [m]."""
TIP_RAD = pi / 4
"""A body whose vertical axis has turned by this angle tipped over [rad]."""
CONTACT_FORCE_N = 0.5
"""A lighter contact is no collision [N]."""
OVERLAP_M = 2e-3
"""A body that is set so deep into another one does not just touch it [m]."""
MAX_CORRECTION_M = 0.02
"""A pose that is given so deep in another body is not one that is meant [m]."""
_TIME_STEP_S = 0.002
"""Time in which contacts are computed that hardly changes a pose [s]."""
_STILL_M = 4e-4
"""A body that has moved by less since the last look is at rest [m]."""
_TIP_COSINE = cos(TIP_RAD)
_SUPPORTS = (SpatialRelation.ON, SpatialRelation.INSIDE)
MOVED_M = 0.01
"""A body that is farther from its first pose is reported with its end pose [m]."""


class _Layout(NamedTuple):
    """What does not change until a body is added or removed; rows are those of the poses."""

    ids: tuple[BodyId, ...]
    row_of: dict[BodyId, int]
    free_rows: NDArray[np.intp]
    """Rows of the bodies that can fall: the roots of dynamic groups that no joint holds."""
    group: NDArray[np.intp]
    """The row of the root of each body's rigid group."""
    half_sizes: Array
    """Of each body's box, n x 3 [m]; 0 without one."""


class Overlap(NamedTuple):
    """A thing that was set inside of another one."""

    thing: BodyId
    other: BodyId | None
    """None for the ground."""
    depth_m: float

    @property
    def text(self) -> str:
        """In words."""
        return f"{self.thing} is {self.depth_m:.3f} m inside of {self.other or 'the ground'}"


class _Correction(NamedTuple):
    """A pair that began inside one another, until both are at rest again."""

    overlap: Overlap
    start: dict[BodyId, Array]
    """The positions with which they began [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class WatchBasis:
    """What all samples that begin in the same state have in common."""

    world: World
    layout: _Layout
    poses: PoseArray
    bounds: EnvironmentBounds | None
    enclosing: frozenset[str]
    """Bodies that enclose the place, from which nothing falls."""
    robots: frozenset[BodyId] = frozenset()
    """The links of robots, which move as their drives do: they neither fall nor tip."""

    @classmethod
    def of(cls, simulation: Simulation) -> WatchBasis:
        """The basis of samples that begin in the current state of a simulation."""
        world, state = simulation.snapshot(), simulation.state
        sizes = {body.id: body.size for body in world.bodies}
        extents = np.array([sizes.get(id) or (0.0, 0.0, 0.0) for id in state.ids], dtype=float).reshape(-1, 3)
        bounds = EnvironmentBounds.from_boxes(OrientedBoxes.from_poses(state.poses, extents))
        robots = frozenset(id for robot in simulation.robots.values() for id in robot.body_ids)
        layout = _lay_out(world, state.ids, robots)
        return cls(world, layout, state.poses.copy(), bounds, enclosing_body_ids(simulation), robots)


class EventWatch:
    """Compares the state of a simulation with reference poses, and collects events."""

    def __init__(self, simulation: WorldSession, basis: WatchBasis) -> None:
        """Begins in the state of the basis, whose poses are the reference."""
        self._simulation = simulation
        self._start_s = simulation.state.time_s
        self._world, self._layout, self._bounds = basis.world, basis.layout, basis.bounds
        self._enclosing, self._robots = basis.enclosing, basis.robots
        self._reports_contacts = Capability.CONTACTS in simulation.engine.capabilities
        self._predicts_contacts = self._reports_contacts and Capability.FORK in simulation.engine.capabilities
        self._first_ids, self._first = basis.layout, basis.poses
        self._reference = basis.poses.copy()
        self._body_ups = _body_ups(self._reference[self._layout.free_rows])
        self._reported: set[tuple[EventKind, BodyId]] = set()
        self._touching: frozenset[tuple[BodyId, BodyId | None]] = frozenset()
        self._mover: frozenset[BodyId] = frozenset()
        self._is_baseline_due = False
        self._corrections: list[_Correction] = []
        self._previous: PoseArray | None = None
        self._known_notes = len(self._notes())
        self.events: list[ImaginedEvent] = []
        """All events so far, in the order of time."""
        self.began_in_collision = False
        """Whether a thing was set inside of another one."""
        self.step: int | None = None
        """Index of the step that is executed."""
        self.carried: Callable[[], Iterable[BodyId]] = tuple
        """Returns what robots hold: it neither falls nor tips before they let it go."""

    @property
    def time_s(self) -> float:
        """Simulated time since the start [s]."""
        return self._simulation.state.time_s - self._start_s

    def update(self) -> None:
        """Detects what has happened since the last call."""
        state = self._simulation.state
        if state.ids != self._layout.ids:
            self._follow_bodies(state.poses)
        if carried := [id for id in self.carried() if id in self._layout.row_of]:
            self.set_reference(carried)
        layout = self._layout
        rows = layout.free_rows
        poses = state.poses[rows]
        drop, cosines = self._motion_of(poses)
        fallen = np.flatnonzero(~(drop < FALL_M))  # a height that is no number counts, too
        for row in fallen.tolist():
            self._add_fall(layout.ids[rows[row]], float(drop[row]))
        for row in np.flatnonzero(cosines < _TIP_COSINE).tolist():
            id = layout.ids[rows[row]]
            if (EventKind.FELL, id) in self._reported:
                continue
            angle = acos(float(np.clip(cosines[row], -1.0, 1.0)))
            self._add(EventKind.TIPPED, id, f"{id} tipped over, by {np.degrees(angle):.0f} degrees", amount=angle)
        if len(fallen) and self._bounds is not None:
            for row in fallen[self._bounds.is_left(poses[fallen, :3])].tolist():
                self._add(EventKind.LEFT, layout.ids[rows[row]], f"{layout.ids[rows[row]]} left the place")
        if self._mover:
            self._detect_collisions()
        self._follow_corrections(state.poses)
        for note in self._notes()[self._known_notes :]:
            self._known_notes += 1
            if note.kind is SpawnNoteKind.FAST:
                self._add(EventKind.FAST, BodyId(note.ids[0]), note.text)

    def _notes(self) -> tuple[SpawnNote, ...]:
        return self._simulation.engine.run(lambda engine: engine.notes)

    def begin_motion(self, thing: BodyId) -> None:
        """From now on a new contact of the thing, and of what is attached to it, is a collision.

        Contacts of sleeping bodies are not reported; if the thing has none, those at the first update are old ones, and
        so are all with what it is on.
        """
        self._mover = self.group_of(thing)
        self._touching = frozenset((a, b) for a, b, _ in self._contacts())
        self._is_baseline_due = not any(a in self._mover or b in self._mover for a, b in self._touching)
        if self._is_baseline_due and thing in self._layout.row_of and self._is_free(thing):
            support = self._support_of(thing)  # a body that wakes up may hop on it
            self._touching |= {(each, support) for each in self._mover}
            if support is not None:
                self._touching |= {(support, each) for each in self._mover}

    def end_motion(self) -> None:
        """Ends `begin_motion`."""
        self._mover = frozenset()

    def overlaps(self, ids: Iterable[BodyId]) -> list[Overlap]:
        """What these bodies, and what is attached to them, are inside of by more than `OVERLAP_M`, the deepest first.

        Poses were just set: contacts are those of the next time step, in a copy. Without copies nothing is found.
        """
        if not self._predicts_contacts:
            return []
        groups = [(id, self.group_of(id)) for id in ids]
        contacts: tuple[Contact, ...] = self._simulation.engine.run(_next_contacts) if groups else ()
        found: dict[frozenset[BodyId | None], Overlap] = {}
        for each in contacts:
            if each.depth_m <= OVERLAP_M or (each.b is not None and each.b in self.group_of(each.a)):
                continue
            for id, group in groups:
                if each.a in group or each.b in group:
                    other = each.b if each.a in group else each.a
                    found.setdefault(frozenset({id, other}), Overlap(id, other, each.depth_m))
        return sorted(found.values(), key=lambda each: -each.depth_m)

    def begin_overlaps(self, ids: Iterable[BodyId]) -> None:
        """Reports what these bodies are inside of, and from now on where the physics moves both."""
        self._end_corrections()
        poses, row_of = self._simulation.state.poses, self._layout.row_of
        for overlap in self.overlaps(ids):
            self.began_in_collision = True
            self._add_event(EventKind.COLLIDED, overlap.thing, overlap.text, overlap.other, overlap.depth_m)
            ends = {id: poses[row_of[id], :3].copy() for id in (overlap.thing, overlap.other) if id is not None}
            self._corrections.append(_Correction(overlap, ends))

    def set_reference(self, ids: Iterable[BodyId]) -> None:
        """Takes the current poses of bodies as their reference, since they were set, with all that moves with them."""
        state = self._simulation.state
        if state.ids != self._layout.ids:
            self._follow_bodies(state.poses)
        named = tuple(ids)
        for id in named:
            rows = [self._layout.row_of[each] for each in self.group_of(id)]
            self._reference[rows] = state.poses[rows]
        self._body_ups = _body_ups(self._reference[self._layout.free_rows])
        for id in named:
            self._reported -= {(kind, each) for kind in EventKind for each in self.group_of(id)}

    def refresh(self) -> None:
        """Reads attachments and joints again, after they were changed."""
        self._world = self._simulation.snapshot()
        self._layout = _lay_out(self._world, self._simulation.state.ids, self._robots)
        if len(self._reference) == len(self._layout.ids):
            self._body_ups = _body_ups(self._reference[self._layout.free_rows])

    def group_of(self, id: BodyId) -> frozenset[BodyId]:
        """The body, and all bodies that are attached to it or that it is attached to."""
        row = self._layout.row_of.get(id)
        if row is None:
            return frozenset({id})
        rows = np.flatnonzero(self._layout.group == self._layout.group[row])
        return frozenset(self._layout.ids[each] for each in rows.tolist())

    def strongest_contact(self, thing: BodyId) -> tuple[BodyId | None, float] | None:
        """What presses hardest against a thing or what is attached to it, and its force [N]; None without contacts."""
        group = self.group_of(thing)
        found: dict[BodyId | None, float] = {}
        for a, b, force_n in self._contacts():
            if (a in group) != (b in group):
                other = b if a in group else a
                found[other] = found.get(other, 0.0) + force_n
        return max(found.items(), key=lambda item: item[1]) if found else None

    def moved_ids(self) -> list[BodyId]:
        """Bodies that are farther than `MOVED_M` from where they were first seen, in the order of the poses."""
        state, first = self._simulation.state, self._first_ids
        if state.ids == first.ids:
            far = ~(np.linalg.norm(state.poses[:, :3] - self._first[:, :3], axis=1) < MOVED_M)
            return [state.ids[row] for row in np.flatnonzero(far).tolist()]
        return [
            id
            for id, pose in zip(state.ids, state.poses, strict=True)
            if id not in first.row_of or not np.linalg.norm(pose[:3] - self._first[first.row_of[id], :3]) < MOVED_M
        ]

    def finish(self) -> None:
        """Gives the events of falls the whole height, which is not known before the end."""
        self._end_corrections()
        state, rows = self._simulation.state, self._layout.free_rows
        if state.ids != self._layout.ids:
            return
        drops = dict(zip(rows.tolist(), self._motion_of(state.poses[rows])[0].tolist(), strict=True))
        for number, event in enumerate(self.events):
            row = self._layout.row_of.get(event.thing) if event.thing is not None else None
            if event.kind is EventKind.FELL and row in drops:
                drop_m = max(drops[row], event.amount or 0.0)
                text = _fall_text(event.thing, drop_m, event.other)
                self.events[number] = replace(event, text=text, amount=drop_m)

    def add(self, event: ImaginedEvent) -> None:
        """Adds an event that the caller has detected."""
        self.events.append(event)

    # -- details -----------------------------------------------------------------------------------------------------

    def _motion_of(self, poses: PoseArray) -> tuple[Array, Array]:
        """How far each free body, and its lowest point, is below its reference [m], and the cosine of its tilt."""
        rows, ups = self._layout.free_rows, _body_ups(poses)
        half_sizes = self._layout.half_sizes[rows]
        drops = self._reference[rows, 2] - poses[:, 2]
        lowered = ((np.abs(ups) - np.abs(self._body_ups)) * half_sizes).sum(axis=1)
        return np.minimum(drops, drops + lowered), np.asarray((ups * self._body_ups).sum(axis=1))

    def _follow_corrections(self, poses: PoseArray) -> None:
        """Reports what was pushed out of one another, as soon as it is at rest."""
        before, self._previous = self._previous, poses if self._corrections else None
        if self._corrections and before is not None and before.shape == poses.shape:
            rows = [self._layout.row_of[id] for each in self._corrections for id in each.start]
            if not np.any(np.abs(poses[rows, :3] - before[rows, :3]) > _STILL_M):
                self._end_corrections()

    def _end_corrections(self) -> None:
        state = self._simulation.state
        row_of = {id: row for row, id in enumerate(state.ids)} if self._corrections else {}
        corrections, self._corrections = self._corrections, []
        for overlap, start in corrections:
            for id, position in start.items():
                way_m = float(np.linalg.norm(state.poses[row_of[id], :3] - position)) if id in row_of else 0.0
                if not way_m > OVERLAP_M / 2:
                    continue
                if id == overlap.thing:
                    inside = f"it was inside of {overlap.other or 'the ground'}"
                    text = f"{id} is {way_m:.3f} m from where it was set: {inside}"
                    self._add_event(EventKind.CORRECTED, id, text, overlap.other, way_m)
                else:
                    text = f"{id} was moved by {way_m:.3f} m: {overlap.thing} was set inside of it"
                    self._add_event(EventKind.MOVED, id, text, overlap.thing, way_m)

    def _add_event(self, kind: EventKind, thing: BodyId, text: str, other: BodyId | None, amount: float | None) -> None:
        event = ImaginedEvent(
            kind=kind, text=text, time_s=self.time_s, thing=thing, other=other, step=self.step, amount=amount
        )
        self.events.append(event)

    def _follow_bodies(self, poses: PoseArray) -> None:
        """Keeps the references of bodies that still exist; a new body begins with its current pose."""
        before, references = self._layout.row_of, self._reference
        self.refresh()
        self._reference = poses.copy()  # of a new body
        for row, id in enumerate(self._layout.ids):
            if id in before:
                self._reference[row] = references[before[id]]
        self._body_ups = _body_ups(self._reference[self._layout.free_rows])

    def _add_fall(self, id: BodyId, drop_m: float) -> None:
        if (EventKind.FELL, id) in self._reported:
            return
        source = self._support_of(id)
        self._add(EventKind.FELL, id, _fall_text(id, drop_m, source), other=source, amount=drop_m)

    def _is_free(self, id: BodyId) -> bool:
        """Whether nothing but its supports holds the rigid group of a body."""
        row = self._layout.group[self._layout.row_of[id]]
        return bool(np.isin(row, self._layout.free_rows))

    def is_prescribed(self, id: BodyId) -> bool:
        """Whether a body is kinematic, and on no joint."""
        if id not in self._layout.row_of or self._world.body(id).physics.mobility is not Mobility.KINEMATIC:
            return False
        return all(joint.child != id for joint in self._world.joints)

    def loads_of(self, id: BodyId) -> tuple[BodyId, ...]:
        """The loose bodies that stand on a body or in it, or on one of these."""
        if self._simulation.state.ids != self._layout.ids:
            self._follow_bodies(self._simulation.state.poses)
        group = self.group_of(id)
        supports = sorted(group & self._layout.row_of.keys())
        for support in supports:  # those found are appended, and read in turn
            relations = self._relations_near(support, self._simulation.state.poses)
            for pair in relations.related(others=[support], relations=_SUPPORTS):
                if pair.body.id not in supports and self._is_free(pair.body.id):
                    supports.append(pair.body.id)
        return tuple(each for each in supports if each not in group)

    def _support_of(self, id: BodyId) -> BodyId | None:
        """What a body was on or in at its reference pose, the smallest container first."""
        group = self.group_of(id)
        pairs = self._relations_near(id, self._reference).related(subjects=[id], relations=_SUPPORTS)
        found = [pair for pair in pairs if pair.other.id not in group]
        found.sort(key=lambda pair: (pair.relation is not SpatialRelation.ON, -pair.overlap, pair.other.id))
        return found[0].other.id if found else None

    def _relations_near(self, id: BodyId, poses: PoseArray) -> SpatialRelations:
        """The relations between a body and those near it."""
        layout, bodies = self._layout, {body.id: body for body in self._world.bodies}
        row = layout.row_of[id]
        half_sizes = np.array([np.linalg.norm(bodies[other].size or (0.0,)) / 2 for other in layout.ids])
        close = np.linalg.norm(poses[:, :3] - poses[row, :3], axis=1) <= half_sizes + half_sizes[row] + 0.05
        near = [
            replace(bodies[layout.ids[each]], pose=pose_from_array(poses[each]))
            for each in np.flatnonzero(close).tolist()
            if layout.ids[each] not in self._enclosing
        ]
        return SpatialRelations(replace(self._world, bodies=tuple(near), joints=(), attachments=(), lights=()))

    def _contacts(self) -> list[tuple[BodyId, BodyId | None, float]]:
        if not self._reports_contacts:
            return []
        contacts: tuple[Contact, ...] = self._simulation.engine.run(lambda engine: engine.contacts())
        return [(each.a, each.b, each.force_n) for each in contacts if each.force_n >= CONTACT_FORCE_N]

    def _detect_collisions(self) -> None:
        contacts = self._contacts()
        if self._is_baseline_due:
            self._touching |= {(a, b) for a, b, _ in contacts}
            self._is_baseline_due = False
        for a, b, force_n in contacts:
            if (a, b) in self._touching or (a in self._mover) == (b in self._mover):
                continue
            thing, other = (a, b) if a in self._mover else (b, a)
            if thing is None:  # the ground hit nothing
                continue
            self._touching |= {(a, b)}
            text = f"{thing} collided with {other or 'the ground'}, with {force_n:.1f} N"
            self._add_event(EventKind.COLLIDED, thing, text, other, None)

    def _add(
        self, kind: EventKind, thing: BodyId, text: str, *, other: BodyId | None = None, amount: float | None = None
    ) -> None:
        if (kind, thing) not in self._reported:
            self._reported.add((kind, thing))
            self._add_event(kind, thing, text, other, amount)


def _next_contacts(engine: Engine) -> tuple[Contact, ...]:
    copy = engine.fork()
    try:
        copy.step(_TIME_STEP_S)
        return copy.contacts()
    finally:
        copy.close()


def _fall_text(id: BodyId | None, drop_m: float, source: BodyId | None) -> str:
    return f"{id} fell by {drop_m:.2f} m" + (f" from {source}" if source else "")


def _body_ups(poses: Array) -> Array:
    """The vertical axis of the world in the frame of each body, n x 3; poses are n x 7."""
    w, x, y, z = normalize(poses[:, 3:]).T
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1)


def _lay_out(world: World, ids: tuple[BodyId, ...], robots: Container[BodyId]) -> _Layout:
    bodies = {body.id: row for row, body in enumerate(world.bodies)}
    groups = RigidGroups.from_world(world)
    rows = np.array([bodies[id] for id in ids], dtype=np.intp)
    row_of_body = np.empty(len(rows), dtype=np.intp)
    row_of_body[rows] = np.arange(len(rows))
    group = row_of_body[groups.root_row[rows]] if len(rows) else rows
    is_root = group == np.arange(len(rows))
    is_driven = np.array([id in robots for id in ids], dtype=bool)
    free_rows = np.flatnonzero(groups.is_dynamic[rows] & ~groups.is_jointed[rows] & is_root & ~is_driven)
    half_sizes = np.array([world.bodies[row].size or (0.0, 0.0, 0.0) for row in rows], dtype=float).reshape(-1, 3) / 2
    return _Layout(ids, {id: row for row, id in enumerate(ids)}, free_rows, group, half_sizes)
