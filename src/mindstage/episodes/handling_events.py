"""What holds a body, and what happens to it meanwhile: grasping, picking up, transporting, putting down.

A body is held that is attached to an agent, that is touched by agents from opposite sides, or that moves against
gravity though nothing touches it, as one that a client pulls does. While it is held, one state machine per body follows
it:

    on a support -- it has left the support by `lift_m` --> in the air     picking up
    in the air   -- it is `transport_min_m` away        --> in the air     transporting begins
    in the air   -- it gets a support, for good         --> on a support   transporting ends, putting down

"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mindstage.episodes.contact_events import ContactTracker
from mindstage.episodes.event_log import EventLog, RelationLog
from mindstage.episodes.motion_events import FlightClock, free_flight_begin, heights_since, vertical_acceleration
from mindstage.episodes.recording import EpisodeEventKind
from mindstage.episodes.tracking import AgentTracker, BodyTable, DetectionThresholds, MotionSample
from mindstage.scene import BodyId
from mindstage.scene.transforms import Array

__all__ = ["HandlingDetector"]

Mask = NDArray[np.bool_]
Grasp = tuple[BodyId, BodyId | None]
"""A body and the mover that holds it; None for a force."""

_ROUNDING_S = 1e-6


@dataclass(slots=True, eq=False)
class _Carry:
    """A body that is held, or was until just now."""

    agent: BodyId | None
    begin_s: float
    in_air: bool = False
    left_s: float | None = None
    """When it left its support; None while it is on one."""
    left_support: tuple[BodyId | None] | None = None
    """What it left, in a tuple, since None is the ground."""
    left_place: Array | None = None
    path: list[tuple[float, Array]] = field(default_factory=list)
    """Where it has been since, about as often as the thresholds need [s, m]."""
    picked_up_s: float | None = None
    """When picking up was done."""
    transport: str | None = None
    landed_s: float | None = None
    """Since when it has had a support again."""
    released_s: float | None = None


class HandlingDetector:
    """Follows the bodies that are held."""

    def __init__(
        self, thresholds: DetectionThresholds, log: EventLog, contacts: ContactTracker, agents: AgentTracker
    ) -> None:
        self._limits = thresholds
        self._log = log
        self._contacts = contacts
        self._agents = agents
        self._attached_s: dict[Grasp, float] = {}
        """Since when a body has been attached to a mover [s]."""
        self._clock = FlightClock()
        self._pulled: dict[BodyId, float] = {}
        """Bodies that a force holds, and since when [s]."""
        self._let_go: dict[BodyId, float] = {}
        """When the force on a body that was held by one ended last [s]."""
        self._first_pull: dict[BodyId, float] = {}
        """Since when a body in the air does not fall [s]."""
        self._holders: dict[BodyId, BodyId] = {}
        """The mover of each body that is attached or gripped."""
        self._carries: dict[BodyId, _Carry] = {}
        self._evidence: dict[BodyId, str] = {}
        self._grasps: RelationLog[Grasp] = RelationLog(
            log, EpisodeEventKind.GRASP, min_duration_s=thresholds.min_duration_s, describe=self._describe
        )

    def update(self, sample: MotionSample) -> Mask:
        """Takes a sample, after the contacts have taken it; returns which bodies are attached or gripped."""
        table = sample.table
        for id in [id for id in self._carries if id not in table.row or sample.jumped[table.row[id]]]:
            self._drop(id, sample)
        is_agent = self._agents.update(sample)
        attached = {table.ids[row]: table.ids[table.mover[row]] for row in np.flatnonzero(table.mover >= 0).tolist()}
        self._attached_s = {pair: self._attached_s.get(pair, sample.time_s) for pair in attached.items()}
        holders = {id: mover for id, mover in attached.items() if is_agent[table.row[mover]]}
        for id, mover in holders.items():
            self._evidence[id] = f"It is attached to {mover}. {self._agents.reason(table, mover)}"
        for id, mover in self._gripped(table, is_agent).items():
            holders.setdefault(id, mover)
        held = np.zeros(len(table.ids), dtype=bool)
        held[[table.row[id] for id in holders]] = True
        self._let_go |= dict.fromkeys(self._holders.keys() - holders.keys(), sample.time_s)
        self._update_pulled(sample, held)
        self._holders = holders
        self._update_grasps(sample)
        for id in list(self._carries):
            self._follow(id, sample)
        self._grasps.settle(sample.time_s)
        return held

    def finish(self) -> None:
        """Ends what had ended when the recording did."""
        for id, carry in list(self._carries.items()):
            if carry.released_s is not None:
                self._end_transport(carry, carry.released_s)
                del self._carries[id]
        self._grasps.finish()

    @property
    def agents(self) -> Mapping[BodyId, str | None]:
        """The bodies that are held now, and by what."""
        return {id: carry.agent for id, carry in self._carries.items() if carry.released_s is None}

    # -- what holds a body ---------------------------------------------------------------------------------------------

    def _gripped(self, table: BodyTable, is_agent: Mask) -> dict[BodyId, BodyId]:
        """The bodies that agents touch from opposite sides, and one of these agents.

        What merely lifts a body from below, such as a table whose height is adjusted, is no side of a grip.
        """
        found: dict[BodyId, BodyId] = {}
        for id, touching in self._contacts.touching_agents(is_agent).items():
            sides = [
                (agent, normal)
                for agent, normal in touching
                if table.is_agent[table.row[agent]] or normal[2] > -self._limits.support_min_normal_z
            ]
            normals = np.array([normal for _, normal in sides]).reshape(-1, 3)
            if len(sides) > 1 and float((normals @ normals.T).min()) < _OPPOSITE:
                root = table.ids[table.group[table.row[sides[0][0]]]]
                found[id] = root if table.is_mover[table.row[root]] else sides[0][0]
                agents = dict.fromkeys(agent for agent, _ in sides)
                reasons = dict.fromkeys(self._agents.reason(table, agent) for agent in agents)
                self._evidence[id] = " ".join([f"{' and '.join(agents)} touch it on both sides.", *reasons])
        return found

    def _update_pulled(self, sample: MotionSample, held: Mask) -> None:
        """Bodies in the air that do not fall, and those of them that fall now or rest."""
        table, limits, time_s = sample.table, self._limits, sample.time_s
        counts = table.group_sums(self._contacts.contact_counts)
        flies = table.is_free & table.is_subject & table.has_gravity & ~held & (counts == 0)
        flies &= ~sample.jumped & ~sample.is_new
        self._clock.update(sample, flies)
        for id, since in list(self._pulled.items()):
            row = table.row.get(id)
            if row is None or held[row] or sample.jumped[row]:
                self._release(id, time_s)
            elif flies[row]:
                times, heights = heights_since(sample, row, max(since, time_s - _FLIGHT_SPAN_S))
                acceleration = vertical_acceleration(times, heights, limits.window_s)
                if acceleration is not None and acceleration < -limits.fall_min_acceleration_m_s2:
                    begin = free_flight_begin(times, heights, limits.window_s, limits.flight_tolerance_m)
                    self._release(id, time_s + begin)
            elif self._contacts.support_counts[row] and not sample.is_moving[row]:
                self._release(id, sample.rest_s(row, limits.still_m))
        self._first_pull = {
            id: since for id, since in self._first_pull.items() if id in table.row and flies[table.row[id]]
        }
        flying = np.flatnonzero(flies & (time_s - self._clock.since >= limits.held_min_s - _ROUNDING_S))
        for row in flying.tolist():
            id = table.ids[row]
            since = max(float(self._clock.since[row]), self._let_go.get(id, -np.inf))
            if id in self._pulled or time_s - since < limits.held_min_s - _ROUNDING_S:
                continue
            times, heights = heights_since(sample, row, max(since, time_s - _FLIGHT_SPAN_S))
            acceleration = vertical_acceleration(times, heights, limits.window_s)
            if acceleration is None:
                continue
            if acceleration <= -limits.fall_min_acceleration_m_s2:
                self._first_pull.pop(id, None)
                continue
            # A bounce between two samples looks the same, as long as the window includes it.
            if time_s - self._first_pull.setdefault(id, time_s) > limits.window_s + _ROUNDING_S:
                last = self._contacts.last_support.get(id)
                if last is not None and 0.0 <= since - last[1] <= limits.min_duration_s:
                    since = max(last[1], self._let_go.get(id, -np.inf))
                self._pulled[id] = since
                text = f"Nothing touches it, and its vertical acceleration is {acceleration:.1f} m/s²."
                self._evidence[id] = text

    def _release(self, id: BodyId, time_s: float) -> None:
        del self._pulled[id]
        self._let_go[id] = time_s
        self._grasps.cease((id, None), time_s)
        if id in self._carries and self._carries[id].agent is None:
            self._carries[id].released_s = time_s

    def _update_grasps(self, sample: MotionSample) -> None:
        time_s = sample.time_s
        for id, mover in self._holders.items():
            carry = self._carries.get(id)
            if carry is not None and carry.agent != mover and carry.released_s is None:
                self._grasps.cease((id, carry.agent), time_s)
                carry.agent = mover
            since_s = self._attached_s.get((id, mover), time_s)  # before it was clear that the mover is an agent
            if carry is None:
                self._carries[id] = self._new_carry(id, mover, since_s, sample)
            else:
                carry.agent, carry.released_s = mover, None
            self._grasps.begin((id, mover), since_s)
        for id, since in self._pulled.items():
            carry = self._carries.get(id)
            if carry is None:
                self._carries[id] = self._new_carry(id, None, since, sample)
            else:
                carry.agent, carry.released_s = None, None
            self._grasps.begin((id, None), since)
        for id, carry in self._carries.items():
            if carry.released_s is None and id not in self._holders and id not in self._pulled:
                carry.released_s = time_s
                self._grasps.cease((id, carry.agent), time_s)

    def _new_carry(self, id: BodyId, agent: BodyId | None, since_s: float, sample: MotionSample) -> _Carry:
        row = sample.table.row[id]
        carry = _Carry(agent, since_s)
        carry.path = [(at, poses[row, :3].copy()) for at, poses in sample.history if at >= since_s - _ROUNDING_S]
        if not self._supports(id, carry, sample.table):
            last = self._contacts.last_support.get(id)
            if last is not None and last[1] >= since_s - self._limits.min_duration_s:
                self._leave(carry, last[1], (last[0],))
            elif agent is not None or not sample.is_first:
                carry.in_air, carry.left_s = True, since_s
                carry.left_place = carry.path[0][1] if carry.path else sample.poses[row, :3].copy()
                carry.picked_up_s = since_s
        return carry

    # -- one held body -------------------------------------------------------------------------------------------------

    def _supports(self, id: BodyId, carry: _Carry, table: BodyTable) -> list[BodyId | None]:
        """What a body rests on, apart from what holds it."""
        row = None if carry.agent is None else table.row.get(carry.agent)  # None, too, if it was deleted
        agent = -1 if row is None else int(table.group[row])
        return [
            each for each in self._contacts.supports_of(id) if each is None or table.group[table.row[each]] != agent
        ]

    @staticmethod
    def _leave(carry: _Carry, time_s: float, support: tuple[BodyId | None]) -> None:
        carry.left_s, carry.left_support = time_s, support
        carry.path = [(at, place) for at, place in carry.path if at >= time_s - _ROUNDING_S] or carry.path[-1:]
        carry.left_place = carry.path[0][1] if carry.path else None

    def _follow(self, id: BodyId, sample: MotionSample) -> None:
        carry, limits, time_s = self._carries[id], self._limits, sample.time_s
        row = sample.table.row[id]
        place = sample.poses[row, :3].copy()
        if not carry.path or time_s - carry.path[-1][0] >= _PATH_STEP_S:
            carry.path.append((time_s, place))
        supports = self._supports(id, carry, sample.table)
        if supports:
            if carry.in_air:
                self._land(id, carry, supports[0], sample)
            else:
                carry.left_s = carry.left_support = carry.left_place = None
                carry.path = carry.path[-_RECENT:]
        else:
            carry.landed_s = None
            if carry.left_s is None:
                support, left_s = self._contacts.last_support.get(id, (None, time_s))
                self._leave(carry, max(left_s, carry.path[0][0]), (support,))
            if carry.left_place is None:
                carry.left_place = place
            if carry.released_s is None:
                self._move(id, carry, time_s, place)
        if carry.released_s is not None and carry.landed_s is None:
            waits = carry.in_air and time_s - carry.released_s < limits.release_s
            if not waits:
                self._end_transport(carry, carry.released_s)
                del self._carries[id]

    def _move(self, id: BodyId, carry: _Carry, time_s: float, place: Array) -> None:
        """Looks for the end of picking up and the begin of transporting."""
        limits = self._limits
        assert carry.left_s is not None
        assert carry.left_place is not None
        distance = float(np.linalg.norm(place - carry.left_place))
        if not carry.in_air and distance >= limits.lift_m:
            carry.in_air, carry.picked_up_s = True, time_s
            height = float(place[2] - carry.left_place[2])
            support = None if carry.left_support is None else carry.left_support[0]
            self._log.add(
                EpisodeEventKind.PICK_UP,
                carry.left_s,
                time_s,
                thing=id,
                other=support,
                agent=carry.agent,
                amount=height,
                evidence=(f"It was held, and moved {distance:.3f} m away from {support or 'the ground'}.",),
            )
        if carry.in_air and carry.transport is None and distance >= limits.transport_min_m:
            assert carry.picked_up_s is not None
            carry.transport = self._log.add(
                EpisodeEventKind.TRANSPORT,
                carry.picked_up_s,
                thing=id,
                other=None if carry.left_support is None else carry.left_support[0],
                agent=carry.agent,
            )

    def _land(self, id: BodyId, carry: _Carry, support: BodyId | None, sample: MotionSample) -> None:
        """Puts a body down when it has had a support for long enough."""
        limits = self._limits
        if carry.landed_s is None:
            carry.landed_s = self._contacts.support_begin_s(id, support)
        if sample.time_s - carry.landed_s < limits.min_duration_s - _ROUNDING_S:
            return
        landed = next((at for at in reversed(carry.path) if at[0] <= carry.landed_s + _ROUNDING_S), carry.path[0])
        away = [at for at, place in carry.path if at < landed[0] and np.linalg.norm(place - landed[1]) >= limits.lift_m]
        begin_s = away[-1] if away else carry.path[0][0]
        if carry.picked_up_s is not None:
            begin_s = max(begin_s, carry.picked_up_s)
        begin_s = min(begin_s, carry.landed_s)
        self._end_transport(carry, begin_s, landed[1])
        self._log.add(
            EpisodeEventKind.PUT_DOWN,
            begin_s,
            carry.landed_s,
            thing=id,
            other=support,
            agent=carry.agent,
            evidence=(f"It was held when it got {support or 'the ground'} as its support.",),
        )
        released_s = carry.released_s
        self._carries[id] = carry = _Carry(carry.agent, carry.begin_s, path=carry.path[-_RECENT:])
        carry.released_s = released_s

    def _end_transport(self, carry: _Carry, end_s: float, place: Array | None = None) -> None:
        if carry.transport is None:
            return
        assert carry.left_place is not None
        last = carry.path[-1][1] if place is None else place
        distance = float(np.linalg.norm(last - carry.left_place))
        if distance < self._limits.transport_min_m:
            self._log.withdraw(carry.transport)
            carry.transport = None
            return
        text = f"It was held and moved to a place {distance:.2f} m away."
        self._log.end(carry.transport, end_s, amount=distance, evidence=(text,))
        carry.transport = None

    def _drop(self, id: BodyId, sample: MotionSample) -> None:
        """Ends everything about a body that was deleted or put elsewhere."""
        carry = self._carries.pop(id)
        time_s = sample.time_s - sample.step_s
        self._end_transport(carry, time_s)
        self._grasps.cease((id, carry.agent), time_s, at_once=True)
        self._pulled.pop(id, None)

    def _describe(self, grasp: Grasp) -> dict[str, Any]:
        id, mover = grasp
        return {"thing": id, "agent": mover, "evidence": (self._evidence.get(id, "A force holds it."),)}


_OPPOSITE = -0.5
"""Cosine of the angle between the normals of two fingers from which they are on opposite sides: 120 degrees."""
_FLIGHT_SPAN_S = 0.2
"""The last part of a way through the air by which it is judged [s]."""
_PATH_STEP_S = 0.02
"""Least time between two places of a path [s]."""
_RECENT = 8
"""Number of places of a path that are kept while the body is on a support."""
