"""Detects what happens to bodies while a plan is executed: falls, tilts, collisions, and bodies that leave the place.

The poses of all bodies are compared with reference poses, those at the start of the sample or after a step has set
them. One comparison costs a few operations on arrays, whatever the number of bodies.

Thresholds: a body fell if it is `FALL_M` lower than its reference, and tipped if its vertical axis has turned by
`TIP_RAD`. Bodies on joints, such as doors and drawers, do neither. A contact counts from `CONTACT_FORCE_N`.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass
from math import acos, cos, pi
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.engines.base import Capability, Contact, PoseArray, SpawnNote, SpawnNoteKind
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

__all__ = ["CONTACT_FORCE_N", "FALL_M", "MOVED_M", "TIP_RAD", "EventWatch", "WatchBasis"]

FALL_M = 0.05
"""A body that is lower than its reference pose by this height fell [m]."""
TIP_RAD = pi / 4
"""A body whose vertical axis has turned by this angle tipped over [rad]."""
CONTACT_FORCE_N = 0.5
"""A lighter contact is no collision [N]."""
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
        self._first_ids, self._first = basis.layout, basis.poses
        self._reference = basis.poses.copy()
        self._body_ups = _body_ups(self._reference[self._layout.free_rows])
        self._reported: set[tuple[EventKind, BodyId]] = set()
        self._touching: frozenset[tuple[BodyId, BodyId | None]] = frozenset()
        self._mover: frozenset[BodyId] = frozenset()
        self._is_baseline_due = False
        self._known_notes = len(self._notes())
        self.events: list[ImaginedEvent] = []
        """All events so far, in the order of time."""
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
        drop = self._reference[rows, 2] - poses[:, 2]
        fallen = np.flatnonzero(~(drop < FALL_M))  # a height that is no number counts, too
        for row in fallen.tolist():
            self._add_fall(layout.ids[rows[row]], float(drop[row]))
        cosines = _upright_cosines(self._body_ups, poses[:, 3:])
        for row in np.flatnonzero(cosines < _TIP_COSINE).tolist():
            id, angle = layout.ids[rows[row]], acos(float(np.clip(cosines[row], -1.0, 1.0)))
            self._add(EventKind.TIPPED, id, f"{id} tipped over, by {np.degrees(angle):.0f} degrees", amount=angle)
        if len(fallen) and self._bounds is not None:
            for row in fallen[self._bounds.is_left(poses[fallen, :3])].tolist():
                self._add(EventKind.LEFT, layout.ids[rows[row]], f"{layout.ids[rows[row]]} left the place")
        if self._mover:
            self._detect_collisions()
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
        state, row_of = self._simulation.state, self._layout.row_of
        for number, event in enumerate(self.events):
            row = row_of.get(event.thing) if event.thing is not None else None
            if event.kind is EventKind.FELL and row is not None and state.ids == self._layout.ids:
                drop_m = max(float(self._reference[row, 2] - state.poses[row, 2]), event.amount or 0.0)
                text = _fall_text(event.thing, drop_m, event.other)
                self.events[number] = replace(event, text=text, amount=drop_m)

    def add(self, event: ImaginedEvent) -> None:
        """Adds an event that the caller has detected."""
        self.events.append(event)

    # -- details -----------------------------------------------------------------------------------------------------

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
            self.events.append(
                ImaginedEvent(
                    kind=EventKind.COLLIDED, text=text, time_s=self.time_s, thing=thing, other=other, step=self.step
                )
            )

    def _add(
        self, kind: EventKind, thing: BodyId, text: str, *, other: BodyId | None = None, amount: float | None = None
    ) -> None:
        if (kind, thing) not in self._reported:
            self._reported.add((kind, thing))
            self.events.append(
                ImaginedEvent(
                    kind=kind, text=text, time_s=self.time_s, thing=thing, other=other, step=self.step, amount=amount
                )
            )


def _fall_text(id: BodyId | None, drop_m: float, source: BodyId | None) -> str:
    return f"{id} fell by {drop_m:.2f} m" + (f" from {source}" if source else "")


def _body_ups(poses: Array) -> Array:
    """The vertical axis of the world in the frame of each body, n x 3; poses are n x 7."""
    w, x, y, z = normalize(poses[:, 3:]).T
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1)


def _upright_cosines(ups: Array, quaternions: Array) -> Array:
    """The cosine of the angle between the vertical and a direction of each body that was vertical, n."""
    w, x, y, z = quaternions.T
    return np.asarray(
        2 * (x * z - w * y) * ups[:, 0] + 2 * (y * z + w * x) * ups[:, 1] + (1 - 2 * (x * x + y * y)) * ups[:, 2]
    )


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
    return _Layout(ids, {id: row for row, id in enumerate(ids)}, free_rows, group)
