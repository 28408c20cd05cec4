"""MindstageEngine: the engine of another Mindstage, with the whole contract and nothing lost on the way."""
# ruff: noqa: D102 - the contract documents an engine's methods, once for all

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from typing import Any, NamedTuple
from weakref import finalize

import msgspec

from mindstage.bridge.description import (
    colour_from,
    colour_message,
    forms_to_json,
    point_message,
    pose_message,
    pose_rows,
    to_json,
    vector_message,
    world_error,
    world_from_json,
)
from mindstage.engines.contract import Ability, Poses, SpawnReport, State
from mindstage.engines.inventory import placeable
from mindstage.engines.remote.address import Profile
from mindstage.engines.remote.engine import RemoteEngine
from mindstage.engines.remote.link import Link
from mindstage.engines.remote.parcel import packed, packed_forms
from mindstage.errors import EngineError, EngineUnavailable, PoseUnreachable, WorldError
from mindstage.msgs import Message, Service, encode, engine_service
from mindstage.msgs import mindstage_msgs as wire
from mindstage.world import NO_FORMS, BodyId, Colour, Form, Forms, Iri, Material, Physics, Pose, Vector, World

__all__ = ["MindstageEngine", "ShowForm"]

ShowForm = Callable[[Form], str]
"""Puts what a form looks like where the far engine can read it, and gives the name of that; empty if it cannot."""

_PART_S = 0.05
"""So much longer may a call take for each body or constraint that it is about [s]."""
_SLOWEST = 6.0
"""A simulated second may take so many times a call's timeout; the far side's stage is as patient."""
_GOODBYE_S = 1.0
_FORMAT_VERSION = World(iri=Iri("")).format_version


class MindstageEngine(RemoteEngine):
    """The contract, kept by whichever engine runs over there.

    That world may be stepped, edited and watched by others as well. Should it be started anew, every call says so
    until something is spawned, or all is cleared.
    """

    profile = Profile.MINDSTAGE

    def __init__(self, link: Link, *, holds_time: bool = True, show: ShowForm = lambda form: "") -> None:
        """Takes its time over, so that it passes by `step` only, until `close`.

        Args:
            link: to whom the services are offered.
            holds_time: False to look at a world that lives by itself.
            show: has the far engine see what bodies look like; by default it sees what can be touched of them.
        """
        super().__init__(link)
        self._show = show
        self._holds_time = holds_time
        self._speed_before = 0.0
        self._ids: tuple[BodyId, ...] = ()
        self._kept: set[_Place] = set()
        """States that the far side keeps for us."""
        self._dropped: deque[_Place] = deque()
        """Those that nobody here can bring back any more."""
        self._world_is_gone = False
        self._far = self._described()
        self._met = link.meetings
        self._hold_time()

    @classmethod
    def is_offered(cls, link: Link) -> bool:
        """Whether someone at the other end speaks so."""
        return link.is_offered(_name(link, wire.Describe), wire.Describe, wire.Describe.Request())

    @property
    def abilities(self) -> frozenset[Ability]:
        known = {each.value for each in Ability} - {Ability.STATISTICS.value}
        return frozenset(Ability(each) for each in self._far.abilities if each in known)

    @property
    def far_engine(self) -> str:
        """Which engine runs there, such as `mujoco`."""
        return self._far.engine

    @property
    def time_s(self) -> float:
        told: wire.Describe.Response = self._ask(wire.Describe, wire.Describe.Request())
        return told.time_s

    def ping(self) -> float:
        start = time.perf_counter()
        self._ask(wire.Describe, wire.Describe.Request(), in_any_world=True)
        return time.perf_counter() - start

    # -- the world -----------------------------------------------------------------------------------------------------

    def spawn(self, world: World, *, forms: Forms = NO_FORMS) -> SpawnReport:
        text, left_out = packed(world)
        usable, notes = packed_forms(forms if "forms" in self._far.takes else NO_FORMS)
        request = wire.SpawnWorld.Request(world=text, forms=forms_to_json(usable, mesh=self._show))
        report = self._spawn(request, parts=len(world.bodies) + len(world.constraints))
        return msgspec.structs.replace(
            report,
            failed_bodies=left_out.failed_bodies + report.failed_bodies,
            failed_constraints=left_out.failed_constraints + report.failed_constraints,
            notes=notes + report.notes,
        )

    def _spawn(self, request: wire.SpawnWorld.Request, *, parts: int) -> SpawnReport:
        patience_s = self._patience_s + _PART_S * parts
        reply: wire.SpawnWorld.Response = self._ask(wire.SpawnWorld, request, timeout_s=patience_s, in_any_world=True)
        with self._link.making_sense("spawn_world"):
            return msgspec.convert(encode(reply.report), SpawnReport)

    def delete(self, ids: Iterable[BodyId]) -> None:
        self._ask(wire.Delete, wire.Delete.Request(ids=tuple(ids)))

    def clear(self) -> None:
        self._ask(wire.Clear, wire.Clear.Request(), in_any_world=True)

    def attach(self, parent: BodyId, child: BodyId) -> None:
        self._ask(wire.Attach, wire.Attach.Request(parent=parent, child=child))

    def detach(self, child: BodyId) -> None:
        self._ask(wire.Detach, wire.Detach.Request(child=child))

    def log(self) -> World:
        reply: wire.LogWorld.Response = self._ask(wire.LogWorld, wire.LogWorld.Request())
        with self._link.making_sense("log_world"):
            return world_from_json(reply.world)

    # -- bodies --------------------------------------------------------------------------------------------------------

    def set_pose(self, id: BodyId, pose: Pose) -> None:
        if reason := placeable(pose):
            raise PoseUnreachable(id, reason=reason)  # the wire has no word for such numbers
        self._ask(wire.SetPose, wire.SetPose.Request(id=id, pose=pose_message(pose)))

    def set_physics(self, id: BodyId, physics: Physics) -> None:
        self._ask(wire.SetPhysics, wire.SetPhysics.Request(id=id, physics=to_json(physics)))

    def set_materials(self, id: BodyId, materials: tuple[Material, ...]) -> None:
        text = to_json(materials, tuple[Material, ...])
        self._ask(wire.SetMaterials, wire.SetMaterials.Request(id=id, materials=text))

    def highlight(self, ids: Iterable[BodyId], colour: Colour | None) -> None:
        lit = wire.Highlight.Request(ids=tuple(ids))
        if colour is not None:
            lit = msgspec.structs.replace(lit, lit=True, color=colour_message(colour))
        self._ask(wire.Highlight, lit)

    def highlights(self) -> Mapping[BodyId, Colour]:
        reply: wire.GetHighlights.Response = self._ask(wire.GetHighlights, wire.GetHighlights.Request())
        with self._link.making_sense("get_highlights"):
            return dict(zip(map(BodyId, reply.ids), map(colour_from, reply.colors), strict=True))

    def push(self, id: BodyId, force: Vector, at: Vector | None = None) -> None:
        push = wire.Push.Request(id=id, force=vector_message(force))
        if at is not None:
            push = msgspec.structs.replace(push, at_point=True, point=point_message(at))
        self._ask(wire.Push, push)

    # -- time and state ------------------------------------------------------------------------------------------------

    def step(self, duration_s: float) -> None:
        self._step(wire.Step.Request(duration_s=duration_s))

    def _step(self, request: wire.Step.Request) -> wire.Step.Response:
        patience_s = self._patience_s * (1.0 + _SLOWEST * max(0.0, request.duration_s))
        reply: wire.Step.Response = self._ask(wire.Step, request, timeout_s=patience_s)
        return reply

    def poses(self) -> tuple[tuple[BodyId, ...], Poses]:
        reply: wire.GetPoses.Response = self._ask(wire.GetPoses, wire.GetPoses.Request())
        with self._link.making_sense("get_poses"):
            rows = pose_rows(reply.poses)
            if len(rows) != len(reply.ids):
                raise ValueError(f"{len(reply.ids)} ids and {len(rows)} poses")
        if reply.ids != self._ids:
            self._ids = tuple(map(BodyId, reply.ids))
        return self._ids, rows

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        reply: wire.GetJointPositions.Response = self._ask(wire.GetJointPositions, wire.GetJointPositions.Request())
        return {
            BodyId(each.id): (each.x, each.y, each.z, each.twist, each.swing2, each.swing1) for each in reply.joints
        }

    def save(self) -> State:
        self._forget_dropped()
        reply: wire.SaveState.Response = self._ask(wire.SaveState, wire.SaveState.Request())
        saved = _Saved(self, _Place(self._far.session, reply.handle))
        self._kept.add(saved.place)
        finalize(saved, self._dropped.append, saved.place).atexit = False
        return State(saved)

    def restore(self, state: State) -> None:
        self._open()
        if not isinstance(state, _Saved) or state.engine is not self:
            raise TypeError(f"a state that this very engine's save made is needed, not {type(state).__name__}")
        if state.place not in self._kept:
            raise EngineUnavailable(self.name, cause="it was started anew, and the state went with its world")
        self._ask(wire.RestoreState, wire.RestoreState.Request(handle=state.place.handle))

    # -- asking --------------------------------------------------------------------------------------------------------

    @property
    def _patience_s(self) -> float:
        """How long a call may take in a world of this size [s]."""
        return self._link.timeout_s + _PART_S * len(self._ids)

    def _ask(
        self, service: type[Service], request: Message, *, timeout_s: float | None = None, in_any_world: bool = False
    ) -> Any:
        """Calls a service of the far engine; what the world refuses is raised.

        Args:
            service: which.
            request: with what.
            timeout_s: how long to wait [s].
            in_any_world: whether the call makes sense in a world that was started anew as well.
        """
        link = self._open()
        link.be_ready()
        if link.meetings != self._met:
            self._meet_again()
        if self._world_is_gone and not in_any_world:
            cause = "it was started anew since, and the world that it ran is gone"
            raise EngineUnavailable(self.name, cause=cause, remedy="spawn it again, or clear first")
        patience_s = self._patience_s if timeout_s is None else timeout_s
        reply = link.call(_name(link, service), service, request, timeout_s=patience_s)
        _raise_refusal(reply)
        if isinstance(reply, wire.SpawnWorld.Response | wire.Clear.Response):
            self._world_is_gone = False
        return reply

    def _meet_again(self) -> None:
        """Learns who is there after a loss; someone else than before has another world."""
        meetings = self._link.meetings
        far = self._described()
        if far.session != self._far.session:
            self._world_is_gone = True
            self._kept.clear()
        self._far, self._met = far, meetings
        self._hold_time()

    def _described(self) -> wire.Describe.Response:
        link = self._link
        far: wire.Describe.Response = link.call(_name(link, wire.Describe), wire.Describe, wire.Describe.Request())
        if far.format_version != _FORMAT_VERSION:
            cause = f"it reads worlds of the format {far.format_version}, and this Mindstage writes {_FORMAT_VERSION}"
            raise EngineUnavailable(self.name, cause=cause, remedy="use the same version on both sides")
        return far

    def _hold_time(self) -> None:
        if self._holds_time:
            reply: wire.SetSpeed.Response = self._link.call(
                _name(self._link, wire.SetSpeed), wire.SetSpeed, wire.SetSpeed.Request(speed=0.0)
            )
            self._speed_before = reply.before or self._speed_before

    def _forget_dropped(self) -> None:
        """The far side keeps only so many states."""
        while self._dropped:
            place = self._dropped.popleft()
            if place in self._kept:
                self._ask(wire.ForgetState, wire.ForgetState.Request(handle=place.handle))
                self._kept.discard(place)

    def _leave(self) -> None:
        link = self._link
        states = [wire.ForgetState.Request(handle=place.handle) for place in self._kept]
        speeds = [wire.SetSpeed.Request(speed=self._speed_before)] if self._speed_before else []
        with suppress(EngineError):  # whoever is gone keeps nothing, and its time is its own
            list(link.call_each(_name(link, wire.ForgetState), wire.ForgetState, states, timeout_s=_GOODBYE_S))
            list(link.call_each(_name(link, wire.SetSpeed), wire.SetSpeed, speeds, timeout_s=_GOODBYE_S))


class _Place(NamedTuple):
    """Where a state is kept."""

    session: str
    handle: str


class _Saved:
    """A state that is kept over there, for as long as somebody has this."""

    def __init__(self, engine: MindstageEngine, place: _Place) -> None:
        self.engine = engine
        self.place = place


def _name(link: Link, service: type[Service]) -> str:
    return engine_service(service, link.address.namespace)


def _raise_refusal(reply: Any) -> None:
    """Raises what the world refused with.

    Raises:
        WorldError: the reply says no.
    """
    if getattr(reply, "success", True):
        return
    if reply.refusal.kind:
        raise world_error(reply.refusal)
    if not isinstance(reply, wire.SpawnWorld.Response):  # whose report says what failed
        raise WorldError(reply.refusal.text or "the far engine's world refuses it, and does not say why")
