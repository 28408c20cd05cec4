"""Contacts between bodies over time, and the events that follow from them: contact, support, collision, containment.

The contacts of a frame are those of bodies that are awake. A contact that is no longer among them persists until one of
its bodies has moved relative to the other, since they may have fallen asleep. Between bodies that no engine simulates
(a thing in a gripper and the table below it), in recordings without contacts, and of bodies that come to rest without
any reported contact, shapes decide (`shape_contacts`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.base import Contact
from mindstage.episodes.event_log import EventLog, RelationLog
from mindstage.episodes.recording import EpisodeEventKind
from mindstage.episodes.shape_contacts import ShapeContacts
from mindstage.episodes.tracking import BodyTable, DetectionThresholds, MotionSample, lengths
from mindstage.scene import BodyId, GeometryMap
from mindstage.scene.bounding_boxes import Indices
from mindstage.scene.transforms import Array

__all__ = ["ContactTracker"]

Pair = tuple[BodyId, BodyId | None]
"""Two bodies, in the order of their rows; None for the ground of the engine."""

_MIN_INSIDE_FRACTION = 0.8
"""As in `scene.spatial`."""


@dataclass(slots=True, eq=False)
class _Touch:
    """The contact of one pair."""

    begin_s: float
    is_initial: bool
    """Whether it existed in the first frame, or one of the bodies was put there."""
    normal: Array
    """The normal from the first to the second body."""
    missing_s: float | None = None
    """Since when the engine has not reported it; None while it does."""
    away_s: float | None = None
    """Since when the bodies have been apart from where they last touched."""
    anchor: tuple[Array, Array] | None = None
    """The poses of both bodies when it was reported last."""
    impulse_n_s: float = 0.0
    peak_n: float = 0.0
    approach_m_s: float = 0.0
    """Speed along the normal before it began."""
    momentum_n_s: float | None = None
    """The momentum that a free body had along the normal before, if its mass is known."""
    known_force: bool = False
    """Whether the engine has reported it."""
    ended_s: float = np.inf
    supports: set[tuple[BodyId, BodyId | None]] = field(default_factory=set)
    sides: tuple[bool, bool, BodyTable] | None = None
    """What the supports were concluded from: whether the first body is below, whether the second one is, and the
    bodies."""


class ContactTracker:
    """Follows the contacts of all bodies, and adds the events that they mean to a log."""

    def __init__(self, thresholds: DetectionThresholds, geometry: GeometryMap, log: EventLog) -> None:
        self._limits = thresholds
        self._log = log
        self._shapes = ShapeContacts(
            geometry, margin_m=thresholds.contact_gap_m[1], max_depth_m=thresholds.max_contact_depth_m
        )
        self._touches: dict[Pair, _Touch] = {}
        self._of_body: dict[BodyId, dict[Pair, None]] = {}
        self._reported: dict[Pair, None] = {}
        self._unreported: set[Pair] = set()
        self._measured: dict[Pair, None] = {}
        """Contacts whose impulse is being integrated."""
        self._collided: dict[Pair, float] = {}
        """When the last collision of a pair ended."""
        self._inside: dict[BodyId, dict[BodyId, None]] = {}
        """For each body, those that it is inside of."""
        self._contents: dict[BodyId, dict[BodyId, None]] = {}
        self._anchors = np.zeros((0, 7))
        """The poses for which shapes were compared last."""
        self._was_moving = np.zeros(0, dtype=bool)
        self._table: BodyTable | None = None
        self._ended: dict[Pair, _Touch] = {}
        """Contacts that ended a moment ago."""
        self._awake = np.zeros(0, dtype=bool)
        duration = thresholds.min_duration_s
        self._contacts: RelationLog[Pair] = RelationLog(
            log, EpisodeEventKind.CONTACT, min_duration_s=duration, describe=self._describe_contact
        )
        self._supports: RelationLog[tuple[BodyId, BodyId | None]] = RelationLog(
            log, EpisodeEventKind.SUPPORT, min_duration_s=duration, describe=self._describe_support
        )
        self._containments: RelationLog[tuple[BodyId, BodyId]] = RelationLog(
            log, EpisodeEventKind.CONTAINMENT, min_duration_s=duration, describe=self._describe_containment
        )
        self.contact_counts = np.zeros(0, dtype=np.intp)
        """Number of contacts of each body."""
        self.support_counts = np.zeros(0, dtype=np.intp)
        """Number of supports of each body."""
        self.last_support: dict[BodyId, tuple[BodyId | None, float]] = {}
        """The support that each body lost last, and when [s]."""

    # -- what other detectors ask --------------------------------------------------------------------------------------

    def supports_of(self, id: BodyId) -> list[BodyId | None]:
        """What a body rests on now; None for the ground."""
        return [
            support
            for pair in self._of_body.get(id, ())
            for thing, support in self._touches[pair].supports
            if thing == id
        ]

    def is_supported_by(self, id: BodyId, support: BodyId | None) -> bool:
        """Whether a body rests on another one, or on the ground, now."""
        return self._supports.holds((id, support))

    def support_begin_s(self, id: BodyId, support: BodyId | None) -> float:
        """Since when a body has rested on another one [s]; it must."""
        return self._supports.begin_s((id, support))

    def support_end_s(self, id: BodyId, support: BodyId | None, default_s: float) -> float:
        """When a body ceased to rest on another one within the last seconds [s], or a default if it is unknown."""
        last = self.last_support.get(id)
        return last[1] if last is not None and last[0] == support else default_s

    def touching_agents(self, is_agent: NDArray[np.bool_]) -> dict[BodyId, list[tuple[BodyId, Array]]]:
        """For each body that agents touch and could hold, these agents and the normals towards them."""
        found: dict[BodyId, list[tuple[BodyId, Array]]] = {}
        table = self._table
        assert table is not None
        can_be_held = table.is_handled & ~table.is_mover
        for row in np.flatnonzero(is_agent & (self.contact_counts > 0)).tolist():
            agent = table.ids[row]
            for a, b in self._of_body.get(agent, ()):
                other = b if a == agent else a
                if other is not None and can_be_held[table.row[other]]:
                    normal = self._touches[a, b].normal
                    found.setdefault(other, []).append((agent, -normal if a == agent else normal))
        return found

    # -- one sample ----------------------------------------------------------------------------------------------------

    def update(self, sample: MotionSample, contacts: tuple[Contact, ...] | None) -> None:
        """Takes the contacts of a sample; None if they are unknown."""
        self._set_bodies(sample)
        for row in np.flatnonzero(sample.jumped).tolist():
            self._put_elsewhere(sample.table.ids[row], sample.time_s)
        reported: dict[Pair, Contact] = {}
        if contacts is not None:
            reported = self._pairs(contacts, sample.table)
            self._take_reported(sample, reported)
        self._find_awake(sample, has_contacts=contacts is not None)
        self._compare_shapes(sample, contacts is not None)
        if contacts is not None:
            self._end_unreported(sample)
        self._measure(sample, reported)
        for log in (self._contacts, self._supports, self._containments):
            log.settle(sample.time_s)
        for pair in [pair for pair, touch in self._ended.items() if touch.ended_s < sample.time_s - _BOUNCE_S]:
            del self._ended[pair]

    def finish(self) -> None:
        """Ends what had ended when the recording did."""
        for log in (self._contacts, self._supports, self._containments):
            log.finish()

    def _set_bodies(self, sample: MotionSample) -> None:
        table = sample.table
        if table is self._table:
            return
        n = len(table.ids)
        if self._table is not None:
            for id in self._table.row.keys() - table.row.keys():
                self._put_elsewhere(id, sample.time_s)
            rows = table.rows_before(self._table)
            known = rows >= 0
            anchors, was_moving = np.full((n, 7), np.nan), np.zeros(n, dtype=bool)
            anchors[known], was_moving[known] = self._anchors[rows[known]], self._was_moving[rows[known]]
            holder = np.full(n, -1)
            holder[known] = self._table.mover[rows[known]]
            held = table.mover != holder
            anchors[held] = np.nan
        else:
            anchors, was_moving = np.full((n, 7), np.nan), np.zeros(n, dtype=bool)
        same_bodies = self._table is not None and self._table.ids == table.ids
        self._anchors, self._was_moving, self._table = anchors, was_moving, table
        if not same_bodies:
            self._shapes.set_bodies(table, sample.poses)
            self.contact_counts, self.support_counts = np.zeros(n, dtype=np.intp), np.zeros(n, dtype=np.intp)
            for id, pairs in self._of_body.items():
                self.contact_counts[table.row[id]] = len(pairs)
                self.support_counts[table.row[id]] = len(self.supports_of(id))

    def _find_awake(self, sample: MotionSample, *, has_contacts: bool) -> None:
        """Finds the bodies whose contacts the engine reports: it simulates them, and they move or touch something."""
        table = sample.table
        self._awake = np.zeros(len(table.ids), dtype=bool)
        if has_contacts:
            before = sample.history[-1][1] if sample.history else sample.poses
            changed = lengths(sample.poses - before) > self._limits.changed_m
            changed[[table.row[id] for pair in self._reported for id in pair if id is not None]] = True
            self._awake = table.is_dynamic & (table.group_sums(changed) > 0)

    @staticmethod
    def _pairs(contacts: Iterable[Contact], table: BodyTable) -> dict[Pair, Contact]:
        return {
            (each.a, each.b): each
            for each in contacts
            if each.a in table.row and (each.b is None or each.b in table.row)
        }

    def _take_reported(self, sample: MotionSample, reported: dict[Pair, Contact]) -> None:
        table = sample.table
        now = {self._ordered(pair, table): pair for pair in reported}
        moving = {table.ids[row] for row in np.flatnonzero(sample.is_moving | (sample.turning > 0.1)).tolist()}
        for pair, given in now.items():
            contact = reported[given]
            touch = self._touches.get(pair)
            if touch is None or touch.missing_s is not None or pair[0] in moving or pair[1] in moving:
                normal = np.array(contact.normal) * (1.0 if given == pair else -1.0)
                if touch is None:
                    touch = self._begin(pair, sample, known_force=True, normal=normal)
                touch.missing_s = touch.away_s = touch.anchor = None
                touch.normal = normal
                self._set_supports(pair, touch, sample, float(normal[2]), -float(normal[2]))
        for pair in self._reported:
            missing = self._touches.get(pair) if pair not in now else None
            if missing is not None:
                missing.missing_s, missing.away_s = sample.time_s, None
                missing.anchor = self._last_poses(pair, sample)
                self._unreported.add(pair)
        self._reported = dict.fromkeys(now)
        self._unreported -= now.keys()

    @staticmethod
    def _ordered(pair: Pair, table: BodyTable) -> Pair:
        a, b = pair
        return (b, a) if b is not None and table.row[b] < table.row[a] else pair

    def _last_poses(self, pair: Pair, sample: MotionSample) -> tuple[Array, Array]:
        """The poses of both bodies in the sample before."""
        poses = sample.history[-1][1] if sample.history else sample.poses
        a, b = pair
        return poses[sample.table.row[a]].copy(), _ORIGIN if b is None else poses[sample.table.row[b]].copy()

    def _end_unreported(self, sample: MotionSample) -> None:
        """Ends contacts that the engine no longer reports, unless the bodies may have fallen asleep."""
        table, limits = sample.table, self._limits
        changed = [table.ids[row] for row in np.flatnonzero(self._awake).tolist()]
        near = dict.fromkeys(pair for id in changed for pair in self._of_body.get(id, ()) if pair in self._unreported)
        pairs = [pair for pair in near if self._is_observed(pair, table)]
        touching = {id for pair in self._reported for id in pair}
        for pair, gap in zip(pairs, self._gaps_of(pairs, sample), strict=True):
            touch = self._touches[pair]
            assert touch.missing_s is not None
            if gap <= self._limits.touching_gap_m:
                touch.away_s = None
                continue
            if touch.away_s is None:
                touch.away_s = sample.time_s
            # A body that touches something is awake; another one may only seem to move.
            is_awake = any(id in touching and table.is_dynamic[table.row[id]] for id in pair if id is not None)
            if gap > (self._limits.touching_gap_m if is_awake else limits.contact_gap_m[1]):
                # Bodies that were awake parted when the contact ceased, others when they moved.
                soon = touch.away_s - touch.missing_s <= limits.min_duration_s
                self._end(pair, touch.missing_s if soon else touch.away_s)

    def _gaps_of(self, pairs: list[Pair], sample: MotionSample) -> list[float]:
        """The gap of each pair; of bodies without shapes, how far they have moved since they touched [m]."""
        row = sample.table.row
        found: dict[Pair, float] = {}
        known = [(row[a], row[b]) for a, b in pairs if b is not None]
        if known:
            self._shapes.move(np.unique(known), sample.poses)
            near = self._shapes.gaps(*np.array(known, dtype=np.intp).T, deeper=sample.steps)
            ids = sample.table.ids
            for i, j, gap in zip(near.a.tolist(), near.b.tolist(), near.gap.tolist(), strict=True):
                found[ids[i], ids[j]] = gap
        result = []
        for pair in pairs:
            a, b = pair
            if b is not None and self._shapes.has_shapes(row[a], row[b]):
                result.append(found.get(pair, np.inf))
                continue
            anchor_a, anchor_b = self._touches[pair].anchor or self._poses_of(pair, sample)
            pose_a, pose_b = self._poses_of(pair, sample)
            result.append(float(np.linalg.norm((pose_a - anchor_a - pose_b + anchor_b)[:3])))
        return result

    def _is_observed(self, pair: Pair, table: BodyTable) -> bool:
        """Whether the engine would report a contact of a pair: it simulates one of the two, which is awake."""
        return any(id is not None and bool(self._awake[table.row[id]]) for id in pair)

    # -- begin and end of contacts -------------------------------------------------------------------------------------

    def _begin(self, pair: Pair, sample: MotionSample, *, known_force: bool, normal: Array) -> _Touch:
        table, rows = sample.table, [sample.table.row[id] for id in pair if id is not None]
        is_initial = sample.is_first or any(sample.jumped[row] or sample.is_new[row] for row in rows)
        touch = _Touch(sample.time_s, is_initial, normal, known_force=known_force)
        self._touches[pair] = touch
        for id in pair:
            if id is not None:
                self._of_body.setdefault(id, {})[pair] = None
                self.contact_counts[table.row[id]] += 1
        if not is_initial:
            before = self._velocity_before(rows[0], sample)
            if len(rows) > 1:
                before = before - self._velocity_before(rows[1], sample)
            touch.approach_m_s = max(float(before @ normal), 0.0)
            touch.momentum_n_s = self._momentum(rows, sample, touch)
            earlier = self._ended.get(pair)
            if earlier is not None:  # it has bounced
                touch.impulse_n_s, touch.peak_n = earlier.impulse_n_s, earlier.peak_n
            self._measured[pair] = None
        self._contacts.begin(pair, sample.time_s)
        return touch

    def _end(self, pair: Pair, time_s: float, *, at_once: bool = False) -> None:
        touch = self._touches.pop(pair)
        table = self._table
        assert table is not None
        for id in pair:
            if id is not None:
                self._of_body[id].pop(pair, None)
                if not self._of_body[id]:
                    del self._of_body[id]
                if id in table.row:
                    self.contact_counts[table.row[id]] -= 1
        for thing, support in list(touch.supports):
            self._drop_support(touch, thing, support, time_s, at_once=at_once)
        self._unreported.discard(pair)
        self._reported.pop(pair, None)
        touch.ended_s = max(time_s, touch.begin_s)
        self._ended[pair] = touch
        self._contacts.cease(pair, time_s, at_once=at_once)

    def _put_elsewhere(self, id: BodyId, time_s: float) -> None:
        """Ends all relations of a body that was deleted or put elsewhere."""
        for pair in list(self._of_body.get(id, ())):
            self._end(pair, time_s, at_once=True)
        for outer in list(self._inside.get(id, ())):
            self._set_inside(id, outer, time_s, holds=False, at_once=True)
        for inner in list(self._contents.get(id, ())):
            self._set_inside(inner, id, time_s, holds=False, at_once=True)

    # -- supports ------------------------------------------------------------------------------------------------------

    def _set_supports(self, pair: Pair, touch: _Touch, sample: MotionSample, a_below: float, b_below: float) -> None:
        """Sets which body of a contact supports the other one, by the vertical parts of the normals."""
        a, b = pair
        table, least = sample.table, self._limits.support_min_normal_z
        sides = (a_below >= least, b_below >= least, table)
        if sides == touch.sides:
            return
        touch.sides = sides
        found: list[tuple[BodyId, BodyId | None]] = []
        if a_below >= least and b is not None and self._can_support(b, a, table):
            found.append((b, a))
        if b_below >= least and self._can_support(a, b, table):
            found.append((a, b))
        for thing, support in touch.supports.difference(found):
            self._drop_support(touch, thing, support, sample.time_s)
        for thing, support in [each for each in found if each not in touch.supports]:
            touch.supports.add((thing, support))
            self.support_counts[table.row[thing]] += 1
            self._supports.begin((thing, support), sample.time_s)

    @staticmethod
    def _can_support(thing: BodyId, support: BodyId | None, table: BodyTable) -> bool:
        row = table.row[thing]
        if not (table.is_free[row] or table.mover[row] >= 0):
            return False
        return support is None or table.group[row] != table.group[table.row[support]]

    def _drop_support(
        self, touch: _Touch, thing: BodyId, support: BodyId | None, time_s: float, *, at_once: bool = False
    ) -> None:
        touch.supports.discard((thing, support))
        assert self._table is not None
        if thing in self._table.row:
            self.support_counts[self._table.row[thing]] -= 1
        self.last_support[thing] = (support, time_s)
        self._supports.cease((thing, support), time_s, at_once=at_once)

    # -- shapes --------------------------------------------------------------------------------------------------------

    def _compare_shapes(self, sample: MotionSample, has_contacts: bool) -> None:
        """Contacts and containment of bodies that have moved since they were compared last."""
        table = sample.table
        is_loose = table.is_handled
        moved = ~(lengths(sample.poses - self._anchors) <= _COMPARED_M)  # NaN has moved
        rows = np.flatnonzero(moved & table.can_move if not sample.is_first else moved)
        stopped = self._was_moving & ~sample.is_moving & is_loose & (self.contact_counts == 0)
        self._was_moving = sample.is_moving
        if not len(rows) and not stopped.any():
            return
        self._shapes.move(rows, sample.poses)
        self._anchors[rows] = sample.poses[rows]
        rows = rows[table.can_move[rows]]
        rows = np.union1d(rows, np.flatnonzero(stopped))
        a, b = self._shapes.near(rows)
        self._update_containment(sample, rows, a, b)
        touching = ~(table.is_enclosing[a] | table.is_enclosing[b]) & (table.group[a] != table.group[b])
        touching &= is_loose[a] | is_loose[b]
        if has_contacts:
            unknown = sample.is_first | stopped | sample.is_new | sample.jumped
            touching &= ~(self._awake[a] | self._awake[b]) | unknown[a] | unknown[b]
        a, b = a[touching], b[touching]
        swapped = a > b
        a, b = np.where(swapped, b, a), np.where(swapped, a, b)
        self._update_touches(sample, rows, a, b, has_contacts=has_contacts)

    def _update_touches(
        self, sample: MotionSample, rows: Indices, a: Indices, b: Indices, *, has_contacts: bool
    ) -> None:
        table, enter = sample.table, self._limits.contact_gap_m[0]
        gaps = self._shapes.gaps(a, b, deeper=sample.steps)
        near: set[Pair] = set()
        for i, j, gap, normal, a_below, b_below in zip(*(column.tolist() for column in gaps), strict=True):
            pair = (table.ids[i], table.ids[j])
            touch = self._touches.get(pair)
            if touch is None:
                simulated = has_contacts and bool(table.is_dynamic[i] or table.is_dynamic[j])
                if gap > (self._limits.touching_gap_m if simulated else enter):
                    continue
                touch = self._begin(pair, sample, known_force=False, normal=np.array(normal))
                if has_contacts:
                    touch.missing_s, touch.anchor = sample.time_s, self._poses_of(pair, sample)
                    self._unreported.add(pair)
            near.add(pair)
            if gap <= enter:
                touch.away_s = None
                self._set_supports(pair, touch, sample, a_below, b_below)
            elif touch.away_s is None:
                touch.away_s = sample.time_s
        for id in [table.ids[row] for row in rows.tolist()]:
            for pair in list(self._of_body.get(id, ())):
                if pair[1] is None or pair in near or self._is_observed(pair, table):
                    continue
                away_s = self._touches[pair].away_s
                self._end(pair, sample.time_s if away_s is None else away_s)

    def _poses_of(self, pair: Pair, sample: MotionSample) -> tuple[Array, Array]:
        a, b = pair
        return (
            sample.poses[sample.table.row[a]].copy(),
            _ORIGIN if b is None else sample.poses[sample.table.row[b]].copy(),
        )

    # -- containment ---------------------------------------------------------------------------------------------------

    def _update_containment(self, sample: MotionSample, rows: Indices, a: Indices, b: Indices) -> None:
        table = sample.table
        related = ~(table.is_enclosing[a] | table.is_enclosing[b]) & (table.group[a] != table.group[b])
        related &= ~(table.is_robot_part[a] | table.is_robot_part[b])
        outer, inner = self._shapes.contained(a[related], b[related], min_fraction=_MIN_INSIDE_FRACTION)
        now = dict.fromkeys((table.ids[i], table.ids[o]) for o, i in zip(outer.tolist(), inner.tolist(), strict=True))
        for id in [table.ids[row] for row in rows.tolist()]:
            for around in list(self._inside.get(id, ())):
                if (id, around) not in now:
                    self._set_inside(id, around, sample.time_s, holds=False)
            for content in list(self._contents.get(id, ())):
                if (content, id) not in now:
                    self._set_inside(content, id, sample.time_s, holds=False)
        for content, around in now:
            self._set_inside(content, around, sample.time_s, holds=True)

    def _set_inside(self, inner: BodyId, outer: BodyId, time_s: float, *, holds: bool, at_once: bool = False) -> None:
        if holds:
            self._inside.setdefault(inner, {})[outer] = None
            self._contents.setdefault(outer, {})[inner] = None
            self._containments.begin((inner, outer), time_s)
        else:
            for index, key, value in ((self._inside, inner, outer), (self._contents, outer, inner)):
                index[key].pop(value, None)
                if not index[key]:
                    del index[key]
            self._containments.cease((inner, outer), time_s, at_once=at_once)

    # -- impulses and collisions ---------------------------------------------------------------------------------------

    def _measure(self, sample: MotionSample, reported: dict[Pair, Contact]) -> None:
        """Integrates the forces of contacts that have just begun."""
        for pair in list(self._measured):
            touch = self._touches.get(pair) or self._ended.get(pair)
            if touch is None:
                del self._measured[pair]
                continue
            a, b = pair
            contact = reported.get(pair)
            if contact is None and b is not None:
                contact = reported.get((b, a))
            if contact is not None:
                touch.impulse_n_s += contact.force_n * sample.step_s
                touch.peak_n = max(touch.peak_n, contact.force_n)
            if sample.time_s - touch.begin_s >= self._limits.impulse_window_s - 1e-6 or pair in self._ended:
                del self._measured[pair]
                self._judge_collision(pair, touch, sample)

    def _velocity_before(self, row: int, sample: MotionSample) -> Array:
        """The velocity of a body before a contact that has just begun [m/s]: in flight, gravity has gone on."""
        table, velocity = sample.table, np.array(sample.last_velocities[row])
        # The contact itself is counted already.
        if table.is_free[row] and table.has_gravity[row] and self.contact_counts[row] <= 1:
            flight_s = 1.5 * sample.step_s if velocity[2] < -_GRAVITY_M_S2 * sample.step_s else 0.0
            velocity[2] -= _GRAVITY_M_S2 * flight_s
        return velocity

    @staticmethod
    def _momentum(rows: list[int], sample: MotionSample, touch: _Touch) -> float | None:
        """The momentum that the lightest free body of a contact loses if it stops [N s]; None if no mass is known."""
        masses = [float(sample.table.masses[row]) for row in rows if sample.table.is_free[row]]
        known = [mass for mass in masses if np.isfinite(mass)]
        return min(known) * touch.approach_m_s if known else None

    def _judge_collision(self, pair: Pair, touch: _Touch, sample: MotionSample) -> None:
        limits = self._limits
        ended_s = self._collided.get(pair)
        if touch.approach_m_s < limits.collision_min_speed_m_s:
            return
        if ended_s is not None and touch.begin_s - ended_s < limits.collision_repeat_s:
            self._collided[pair] = sample.time_s
            return
        impulse = self._impulse(touch)
        if impulse is not None and impulse < limits.collision_min_impulse_n_s:
            return
        self._collided[pair] = sample.time_s
        thing, other = self._by_role(pair)
        evidence = [f"They approached at {touch.approach_m_s:.2f} m/s."]
        if touch.known_force:
            evidence.append(f"The force was up to {touch.peak_n:.1f} N.")
        self._log.add(
            EpisodeEventKind.COLLISION,
            touch.begin_s,
            max(min(sample.time_s, touch.begin_s + limits.impulse_window_s), touch.begin_s),
            thing=thing,
            other=other,
            amount=impulse,
            evidence=tuple(evidence),
        )

    def _impulse(self, touch: _Touch) -> float | None:
        """The impulse of a contact [N s]; None if neither forces nor masses are known.

        The peak of the force of an impact is shorter than a frame, so that of a free body its momentum is used.
        """
        if touch.momentum_n_s is not None and touch.approach_m_s >= self._limits.collision_min_speed_m_s:
            return touch.momentum_n_s
        return touch.impulse_n_s if touch.known_force else touch.momentum_n_s

    # -- events --------------------------------------------------------------------------------------------------------

    def _by_role(self, pair: Pair) -> tuple[BodyId, BodyId | None]:
        """The body that an event of a pair is about, and the other one."""
        a, b = pair
        table = self._table
        assert table is not None
        if b is not None and b in table.row and a in table.row:
            row_a, row_b = table.row[a], table.row[b]
            if (table.is_handled[row_b], table.can_move[row_b]) > (table.is_handled[row_a], table.can_move[row_a]):
                return b, a
        return a, b

    def _describe_contact(self, pair: Pair) -> dict[str, Any]:
        thing, other = self._by_role(pair)
        touch = self._touches.get(pair) or self._ended.get(pair)
        amount = None if touch is None or touch.is_initial else self._impulse(touch)
        source = "The engine reported the contact." if touch is None or touch.known_force else "Their shapes touch."
        return {"thing": thing, "other": other, "amount": amount, "evidence": (source,)}

    def _describe_support(self, relation: tuple[BodyId, BodyId | None]) -> dict[str, Any]:
        thing, support = relation
        below = "the ground" if support is None else support
        return {"thing": thing, "other": support, "evidence": (f"{thing} touches {below}, which is below it.",)}

    @staticmethod
    def _describe_containment(relation: tuple[BodyId, BodyId]) -> dict[str, Any]:
        inner, outer = relation
        share = f"{_MIN_INSIDE_FRACTION:.0%}"
        return {"thing": inner, "other": outer, "evidence": (f"At least {share} of {inner} is in the box of {outer}.",)}


_ORIGIN = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
_GRAVITY_M_S2 = 9.81
_BOUNCE_S = 0.2
"""A contact that begins again within this time goes on [s]."""
_COMPARED_M = 0.001
"""Shapes are compared again when a body has moved by more [m]; as well the change of a component of its quaternion."""
