"""Replay: a recording as a simulation that shows one moment of it, or plays it at any speed.

An `EpisodeReplay` is used like any `Simulation`: questions are answered for the shown moment, copies of it are
simulated by MuJoCo, and the viewer and ROS show it. Only edits are refused, until `resume` continues from that moment.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import NoReturn, Protocol, runtime_checkable

import msgspec

from mindstage.access.limits import Duration, Speed, Timeout
from mindstage.engines.base import (
    ActuatorState,
    Applied,
    Capability,
    Contact,
    DynamicsScale,
    Engine,
    EngineStats,
    PoseArray,
    SavedState,
    SpawnNote,
    SpawnReport,
)
from mindstage.episodes.recording import EpisodeEvent, EpisodeEventKind, EpisodeFrame, Recording
from mindstage.errors import (
    BodyNotFoundError,
    EngineClosedError,
    EngineError,
    EpisodeError,
    EpisodeTimeError,
    InvalidArgumentError,
    UnsupportedByEngineError,
)
from mindstage.files import atomic_write
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import write_map
from mindstage.ranges import Finite, ForceVector, Point, Time, checked
from mindstage.scene import BodyId, Color, World
from mindstage.scene.edits import Edit, Spawn
from mindstage.simulation.imagined import copied_engine
from mindstage.simulation.simulation import Simulation
from mindstage.simulation.state import StateSnapshot

__all__ = ["EpisodeReplay", "ReplayEngine", "knowledge_of"]

_REFUSAL = "this is a recording; continue from the shown moment with Resume (EpisodeReplay.resume)"
_EVENT_TOLERANCE_S = 1e-6
"""An event that begins so near to the shown time is at it [s]."""


class ReplayEngine:
    """An engine whose state is a frame of a recording; `step` shows a later one. It refuses all edits."""

    name = "replay"

    @checked
    def __init__(self, recording: Recording, *, begin_s: Time | None = None, end_s: Time | None = None) -> None:
        """Shows the begin of a recording.

        Args:
            recording: the recording; it is not closed with the engine.
            begin_s: the first time that can be shown [s]; before the recording begins, its first frame is shown.
            end_s: the last time that can be shown [s]; after the recording has ended, its last frame is shown.
        """
        self.on_end: Callable[[], None] = lambda: None
        """Called by a step that ends at the end."""
        self.begin_s = recording.begin_s if begin_s is None else min(begin_s, recording.begin_s)
        """The first time that can be shown [s]."""
        self.end_s = recording.end_s if end_s is None else max(end_s, recording.end_s)
        """The last time that can be shown [s]."""
        self.not_spawned: tuple[World, ...] = tuple(recording.spawned)
        """The worlds of the begin that `spawn` has still to be called for."""
        self._recording = recording
        self._highlighted: dict[BodyId, Color] = {}
        self._highlights: Mapping[BodyId, Color] = MappingProxyType({})
        self._ids: tuple[BodyId, ...] = ()
        self._structure: World | None = None
        self._world: tuple[EpisodeFrame, World] | None = None
        self._closed = False
        self.show(self.begin_s)

    @checked
    def show(self, time_s: Time) -> None:
        """Shows the recording at a time [s].

        Raises:
            EpisodeTimeError: the recording has no state at that time.
        """
        recording = self._require_open()._recording
        if not self.begin_s <= time_s <= self.end_s:
            raise EpisodeTimeError(recording.name, time_s=time_s, begin_s=self.begin_s, end_s=self.end_s)
        frame = recording.frame_at(min(max(time_s, recording.begin_s), recording.end_s))
        self._time_s, self._frame = time_s, frame
        # The same objects as before as long as they are equal: others take that to mean that nothing was edited.
        if frame.ids is not self._ids and frame.ids != self._ids:
            self._ids = frame.ids
            self._show_highlights()
        if frame.structure is not self._structure and frame.structure != self._structure:
            self._structure = frame.structure

    @property
    def frame(self) -> EpisodeFrame:
        """The frame that is shown."""
        return self._frame

    @property
    def structure(self) -> World | None:
        """The world apart from its poses; the same object until a body, joint or attachment changes."""
        return self._structure

    @property
    def capabilities(self) -> frozenset[Capability]:
        """See `Engine`; the same holds for the methods below."""
        found = {Capability.SAVE}
        if self._frame.joint_positions is not None:
            found.add(Capability.JOINTS)
        if self._frame.contacts is not None:
            found.add(Capability.CONTACTS)
        return frozenset(found)

    @property
    def time_s(self) -> float:
        return self._require_open()._time_s

    @property
    def notes(self) -> tuple[SpawnNote, ...]:
        return ()

    @property
    def state_key(self) -> object:
        return None

    def apply(self, edit: Edit) -> Applied:
        """Accepts the worlds of the recording, once each; their bodies exist already."""
        self._require_open()
        if not isinstance(edit, Spawn) or not any(edit.world is each for each in self.not_spawned):
            self._refuse(edit.kind)
        world = edit.world
        self.not_spawned = tuple(each for each in self.not_spawned if each is not world)
        report = SpawnReport(bodies=len(world.bodies), joints=len(world.joints), attachments=len(world.attachments))
        return Applied(edit=edit, inverse=edit, report=report)

    def clear(self) -> None:
        self._refuse("remove its bodies")

    @checked
    def apply_force(self, id: BodyId, force: ForceVector, point: Point | None = None) -> None:
        self._refuse("push bodies")

    def scale_dynamics(self, scales: Mapping[BodyId, DynamicsScale]) -> None:
        self._refuse("scale masses and frictions")

    @checked
    def set_commands(self, commands: Mapping[str, Finite]) -> None:
        self._refuse("drive joints")

    def actuator_states(self) -> Mapping[str, ActuatorState]:
        self._refuse("drive joints")

    def highlight(self, ids: Iterable[BodyId], color: Color | None) -> None:
        found = tuple(ids)
        for id in found:
            if id not in self._require_open()._ids:
                raise BodyNotFoundError(id, known=self._ids)
        for id in found:
            self._highlighted.pop(id, None)
            if color is not None:
                self._highlighted[id] = color
        self._show_highlights()

    def highlights(self) -> Mapping[BodyId, Color]:
        return self._require_open()._highlights

    def _show_highlights(self) -> None:
        existing = set(self._ids)
        self._highlights = MappingProxyType({id: each for id, each in self._highlighted.items() if id in existing})

    @checked
    def step(self, duration_s: Duration) -> None:
        try:
            self.show(min(self._require_open()._time_s + duration_s, self.end_s))
        except EpisodeError as error:  # the frames of that time are lost; an engine's errors pause the simulation
            raise EngineError(str(error)) from error
        if self._time_s >= self.end_s:
            self.on_end()

    def poses(self) -> tuple[tuple[BodyId, ...], PoseArray]:
        return self._require_open()._ids, self._frame.poses.copy()

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        return self._require_open()._frame.joint_positions or {}

    def contacts(self) -> tuple[Contact, ...]:
        if self._require_open()._frame.contacts is None:
            raise UnsupportedByEngineError(self.name, what="report contacts", remedy="they were not recorded")
        return self._frame.contacts or ()

    def stats(self) -> EngineStats:
        raise UnsupportedByEngineError(self.name, what="report statistics")

    def snapshot(self) -> World:
        self._require_open()
        if self._world is None or self._world[0] is not self._frame:
            self._world = self._frame, self._frame.world()
        return self._world[1]

    def save_state(self) -> SavedState:
        return SavedState(_ReplayState(self.time_s))

    def restore_state(self, state: SavedState) -> None:
        if not isinstance(state, _ReplayState):
            raise TypeError(f"expected a state from ReplayEngine.save_state, not {type(state).__name__}")
        self.show(state.time_s)

    def fork(self) -> Engine:
        raise UnsupportedByEngineError(self.name, what="be forked", remedy="a copy of it is simulated by mujoco")

    def close(self) -> None:
        self._closed = True

    def _refuse(self, what: str) -> NoReturn:
        self._require_open()
        raise UnsupportedByEngineError(self.name, what=what, remedy=_REFUSAL)

    def _require_open(self) -> ReplayEngine:
        if self._closed:
            raise EngineClosedError(self.name)
        return self


@dataclass(frozen=True, slots=True)
class _ReplayState:
    time_s: float


@runtime_checkable
class _SpawnRecording(Protocol):
    """A recording in which worlds may have been spawned later."""

    def spawned_at(self, time_s: float) -> tuple[World, ...]: ...


@runtime_checkable
class _KnowledgeRecording(Protocol):
    """A recording with the statements of its maps and ontologies."""

    def knowledge(self) -> KnowledgeBase: ...


def knowledge_of(recording: Recording, *, worlds_only: bool = False) -> KnowledgeBase:
    """The knowledge base of a recording.

    Args:
        worlds_only: whether it is made from the recorded worlds and the bundled ontology, as it is for a recording
            without a knowledge base.

    Raises:
        EpisodeFileError: the recorded knowledge base is lost or damaged.
    """
    if isinstance(recording, _KnowledgeRecording) and not worlds_only:
        return recording.knowledge()
    knowledge = KnowledgeBase()
    with TemporaryDirectory(prefix="mindstage-") as folder:
        for number, world in enumerate(recording.spawned):
            path = Path(folder, f"recorded-{number}.owl")
            atomic_write(path, write_map(world).encode())
            knowledge.load(path)
    return knowledge


class EpisodeReplay(Simulation):
    """A simulation that shows a moment of a recording; `play` replays it, `resume` continues from there.

    `state.time_s` is the shown time [s]. Playing ends at the end of the recording.
    """

    @checked
    def __init__(
        self,
        recording: Recording,
        knowledge: KnowledgeBase | None = None,
        *,
        at_s: Time | None = None,
        beside: Recording | None = None,
        timeout_s: Timeout = 10.0,
        threaded: bool = True,
    ) -> None:
        """Shows a recording.

        Args:
            recording: the recording; it is not closed with the replay.
            knowledge: answers questions; by default one with the map of the recording, which becomes its episode, so
                that questions can be about other times than the shown one.
            at_s: the time that is shown first [s]; by default the begin.
            beside: a second recording, which a viewer shows beside the first one, at the same time.
            timeout_s: see `Simulation`.
            threaded: see `Simulation`.

        Raises:
            EpisodeTimeError: the recording has no state at that time.
        """
        self.recording = recording
        self.beside = beside
        times = {} if beside is None else {"begin_s": beside.begin_s, "end_s": beside.end_s}
        self._replay_engine = ReplayEngine(recording, **times)
        self._spawned_then: tuple[World | None, tuple[World, ...]] = (None, ())
        self._published_structure: World | None = None
        self._live: _LiveState | None = None
        self._owns_knowledge = knowledge is None
        knowledge = knowledge_of(recording) if knowledge is None else knowledge
        super().__init__(knowledge, self._replay_engine, timeout_s=timeout_s, threaded=threaded)
        self._replay_engine.on_end = self.pause
        for world in self._replay_engine.not_spawned:
            self.spawn(world, geometry=recording.geometry or None)
        with suppress(InvalidArgumentError):  # it has an episode of that name
            name = knowledge.add_episode(recording)
            self.on_close(lambda: knowledge.remove_episode(name))
        if at_s is not None:
            self.seek(at_s)

    @property
    def worlds(self) -> tuple[World, ...]:
        """The worlds that had been spawned at the shown time, in their initial state."""
        recording, frame = self.recording, self._replay_engine.frame
        if self._live is not None or not isinstance(recording, _SpawnRecording):
            return super().worlds
        spawned = self._spawned_then
        if spawned[0] is not frame.structure:
            spawned = self._spawned_then = frame.structure, recording.spawned_at(frame.time_s)
        return spawned[1]

    # -- time --------------------------------------------------------------------------------------------------------

    @property
    def begin_s(self) -> float:
        """The first time that can be shown [s]."""
        return self._replay_engine.begin_s

    @property
    def end_s(self) -> float:
        """The last time that can be shown [s]."""
        return self._replay_engine.end_s

    @checked
    def seek(self, time_s: Time) -> None:
        """Shows the recording at a time [s]; playing goes on from there.

        Raises:
            EpisodeTimeError: the recording has no state at that time.
            EpisodeError: the replay was resumed, so that the world is not that of the recording.
        """

        def seek(_: Engine) -> None:
            self._require_recording()
            self._replay_engine.show(time_s)

        self.engine.run(seek, label="seek")

    @checked
    def play(self, *, speed: Speed = 1.0) -> None:
        """Plays the recording at a multiple of its speed, from the shown time, or from the begin if it is at the end.

        Args:
            speed: recorded time per wall time.
        """
        if self._live is None and self.state.time_s >= self.end_s:
            self.seek(self.begin_s)
        super().play(speed=speed)

    def seek_event(
        self, *, back: bool = False, kinds: Collection[EpisodeEventKind] | None = None
    ) -> EpisodeEvent | None:
        """Shows the begin of the next event, or with `back` of the previous one; does nothing if there is none.

        What lasts from the begin to the end, such as most contacts, is left out.

        Args:
            back: whether to go back in time.
            kinds: the kinds of events to stop at; by default all.

        Returns:
            The event, or None if there is none.
        """
        now_s = self.state.time_s
        begin_s = self.recording.begin_s
        events = [
            each
            for each in self.recording.events()
            if (kinds is None or each.kind in kinds) and not (each.begin_s <= begin_s and each.end_s is None)
        ]
        if back:
            found = [each for each in events if each.begin_s < now_s - _EVENT_TOLERANCE_S]
            event = max(found, key=lambda each: each.begin_s, default=None)
        else:
            found = [each for each in events if each.begin_s > now_s + _EVENT_TOLERANCE_S]
            event = min(found, key=lambda each: each.begin_s, default=None)
        if event is not None:
            self.seek(event.begin_s)
        return event

    # -- continuing --------------------------------------------------------------------------------------------------

    @property
    def resumed_at_s(self) -> float | None:
        """The time at which `resume` continued [s]; None while the recording is shown."""
        return None if self._live is None else self._live.resumed_at_s

    def resume(self) -> tuple[str, ...]:
        """Continues from the shown moment: from now on this is a live simulation, by MuJoCo, that can be edited.

        It starts paused and at rest. Its time goes on from the shown one; `reset` returns to the shown moment, and
        `return_to_recording` ends it. The recording stays as it is.

        Returns:
            What the simulation does not have in common with the recording, one sentence each.

        Raises:
            EpisodeError: it was resumed already.
        """

        def resume(engine: Engine) -> tuple[str, ...]:
            self._require_recording()
            worlds = self.worlds
            spawn = partial(Spawn, geometry=self.geometry, immovable=self.immovable, ground=True)
            live, notes = copied_engine(engine, worlds=worlds, spawn=spawn)
            for id, color in engine.highlights().items():
                live.highlight([id], color)
            self._live = _LiveState(engine.time_s, live, (self._worlds, self._temporary_worlds, self._reports))
            self._worlds, self._temporary_worlds = worlds, ()
            self._set_engine(live)
            return notes

        self.pause()
        return self.engine.run(resume, label="resume", edits=True, timeout_s=6 * self.timeout_s)

    def return_to_recording(self) -> None:
        """Ends the simulation that `resume` began, and shows the recording at that moment; else it does nothing."""

        def end(_: Engine) -> None:
            if self._live is not None:
                live, self._live = self._live, None
                self._worlds, self._temporary_worlds, self._reports = live.spawned
                self._set_engine(self._replay_engine)
                live.engine.close()

        self.pause()
        self.engine.run(end, label="return", edits=True)
        self.edits.clear()

    @checked
    def pull(self, id: BodyId, *, point: Point, target: Point) -> None:
        """See `Simulation.pull`.

        Raises:
            UnsupportedByEngineError: the recording is shown.
        """
        if self._live is None:
            raise UnsupportedByEngineError(self.engine.name, what="push bodies", remedy=_REFUSAL)
        super().pull(id, point=point, target=target)

    def close(self) -> None:
        """See `Simulation.close`."""
        super().close()
        self._replay_engine.close()
        if self._owns_knowledge:
            self.knowledge.close()

    def _require_recording(self) -> None:
        if self._live is not None:
            raise EpisodeError(
                f"the world was continued from {self.recording.name} at {self._live.resumed_at_s:g} s; "
                "return to the recording first (EpisodeReplay.return_to_recording)"
            )

    # -- in the engine thread ----------------------------------------------------------------------------------------

    def _set_engine(self, engine: Engine) -> None:
        """Continues with another engine, whose state is the start; the one before is not closed."""
        self._use_engine(engine)
        self._perturbations.clear()
        self._error, self._initial_state_is_due = "", True
        self._save_initial_state()
        self._start = self._start_state()

    def _publish(self, *, edits: bool = False) -> None:
        structure = self._replay_engine.structure
        if structure is not self._published_structure:
            self._published_structure, edits = structure, True
        super()._publish(edits=edits)

    def _read_state(self) -> StateSnapshot:
        state = super()._read_state()
        if self._live is None:
            return state
        return msgspec.structs.replace(state, time_s=self._live.resumed_at_s + state.time_s)


@dataclass(frozen=True, slots=True, eq=False)
class _LiveState:
    resumed_at_s: float
    engine: Engine
    spawned: tuple[tuple[World, ...], tuple[World, ...], tuple[SpawnReport, ...]]
    """The worlds and reports before."""
