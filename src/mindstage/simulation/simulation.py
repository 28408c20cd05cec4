"""A simulation: one knowledge base and one engine, which runs in a thread of its own.

All access to the engine goes through `Simulation` and is executed in the engine thread. Calls may come from any thread;
they are queued, have a timeout, and raise what the engine raises. After each tick and call the poses, highlights and
time are published as a `StateSnapshot`, which is read without waiting.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar, overload

import msgspec
from msgspec.structs import replace

from mindstage.access.limits import Duration, Speed, Timeout
from mindstage.engines import is_remote
from mindstage.engines.base import (
    Applied,
    Capability,
    Engine,
    InterruptibleEngine,
    MovedBody,
    RebuildingEngine,
    SavedState,
    SpawnReport,
)
from mindstage.engines.edits import RestoreBodies
from mindstage.engines.environment_bounds import REST_CHECK_S, find_bodies_that_move
from mindstage.errors import (
    BodyNotFoundError,
    EngineClosedError,
    EngineError,
    InvalidArgumentError,
    MindstageError,
    SimulationError,
    SimulationFaultError,
    UnsupportedByEngineError,
)
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.history import NOW, WorldState, time_arguments
from mindstage.knowledge.over_time import argument_names, ask_over_time, recorded_so_far
from mindstage.knowledge.queries import AnswerRow, Answers, Question
from mindstage.knowledge.questions import StateAccess
from mindstage.knowledge.sentences import resolve_question
from mindstage.ranges import Coordinate, Point, Size, Time, checked
from mindstage.rdf import SparqlResult
from mindstage.scene import Body, BodyGeometry, BodyId, Color, GeometryMap, Iri, World
from mindstage.scene.colors import color_from
from mindstage.scene.display import counted, short_name
from mindstage.scene.edits import Edit, SetPoses, Spawn
from mindstage.simulation.controllers import EARLY_S, Controller, ControllerSchedule, SimulatedRobots, fault_error
from mindstage.simulation.engine_thread import (
    DirectCalls,
    EngineAccess,
    EngineThread,
    LateEndCallbacks,
    RealTimeClock,
    TickDelay,
)
from mindstage.simulation.geometry_provider import GeometryProvider, with_geometry_notes, with_immovable_notes
from mindstage.simulation.highlights import HighlightResult, Highlights, MarkerStore, highlight_request
from mindstage.simulation.imagined import (
    EditRecordingEngine,
    ForkOrigin,
    commit_edits,
    copied_engine,
    without_bodies,
    world_with_bodies,
)
from mindstage.simulation.interaction import Perturbations
from mindstage.simulation.joint_motion import SimulationJoint, find_joint
from mindstage.simulation.observation import (
    DEFAULT_CLIENT,
    ClientDirectory,
    ObservedEngine,
    Observers,
    current_client,
)
from mindstage.simulation.placement import PlacementResult, make_body, place_item, place_items
from mindstage.simulation.replacing import KeptWorld, ReplaceWorld, additions, edit_timeout_s, primitives
from mindstage.simulation.state import SessionEdit, SimulationBody, StateSnapshot, find_body
from mindstage.simulation.undo import Edits, StartState

if TYPE_CHECKING:
    from mindstage.geometry.fit import MeshProvider
    from mindstage.rendering.camera import CameraPose
    from mindstage.rendering.path_tracing import PathTracedPicture, PathTracingSettings
    from mindstage.saving import FileDialect
    from mindstage.scene import PoseLike
    from mindstage.sensors.camera import Camera
    from mindstage.sensors.camera_model import CameraModel
    from mindstage.sensors.stage import CameraSet

__all__ = ["Simulation"]

T = TypeVar("T")
R = TypeVar("R", bound=AnswerRow)

_PICKLED_FIELDS = (
    "knowledge",
    "timeout_s",
    "_geometry_provider",
    "_worlds",
    "_temporary_worlds",
    "_reports",
    "_grounded",
    "_controllers",
    "robots",
)
_TICK_S = 1 / 60
"""Interval at which a playing simulation is stepped and published [s]."""
_STEP_CHUNK_S = 0.1
"""Longer steps are divided into steps of this length [s], between which other calls are executed."""
_SLICE_WALL_S = 0.02
"""Wall time after which a step or a tick is interrupted, so that other calls are executed [s]."""
_MAX_PART_WALL_S = 0.15
"""The same for engines whose steps cannot be interrupted: longest wall time of a step before they become shorter [s].
It is above `_STEP_CHUNK_S`, since some engines run in real time."""
_MIN_PART_S = 0.002
"""Shortest step of such engines [s]."""
_PAUSE_WAIT_S = 0.15
"""How long `pause` waits for the tick that is running [s]."""


class Simulation:
    """Spawns worlds of a knowledge base into an engine, simulates them, and answers questions about their state."""

    @checked
    def __init__(
        self,
        knowledge: KnowledgeBase,
        engine: Engine,
        *,
        timeout_s: Timeout = 10.0,
        primitive_shapes: bool = False,
        meshes: MeshProvider | None = None,
        threaded: bool = True,
    ) -> None:
        """Starts the engine thread; from then on the engine must be used through the simulation only.

        Args:
            knowledge: the knowledge base.
            engine: the engine; closed together with the simulation.
            timeout_s: timeout of a call [s], after which it raises `SimulationTimeoutError`.
            primitive_shapes: whether bodies have primitive shapes, not geometry from the shape rules of their classes.
            meshes: the source of meshes, which take precedence over shape rules.
            threaded: whether the engine has a thread of its own; otherwise calls run in the thread of their caller,
                which must always be the same, and the simulation cannot play in real time.
        """
        self.knowledge = knowledge
        self.timeout_s = timeout_s
        self.clients = ClientDirectory()
        self.edits = Edits(self)
        self._longest_part_s: float = _STEP_CHUNK_S
        self._use_engine(engine)
        self._late_ends = LateEndCallbacks()
        self.engine = EngineAccess(lambda: self._engine, self._run, self._late_ends)
        self._geometry_provider = GeometryProvider(knowledge, primitive_shapes=primitive_shapes, meshes=meshes)
        self._revision = 0
        self._asked_state = WorldState(world=World(iri=Iri("")), spawned=())
        self._worlds: tuple[World, ...] = ()
        self._temporary_worlds: tuple[World, ...] = ()
        self._reports: tuple[SpawnReport, ...] = ()
        self._grounded = False
        self._initial_state: SavedState | None = None
        self._initial_state_is_due = False
        self._tick_delay = TickDelay()
        self._start: StartState | None = None
        self._clock: RealTimeClock | None = None
        self._perturbations = Perturbations()
        self._highlights = Highlights()
        self.markers = MarkerStore(lambda function, label: self.engine.run(lambda _: function(), label=label))
        self._caught: type[BaseException] = BaseException if threaded else Exception  # Ctrl-C is not a fault
        self._state_callbacks: tuple[Callable[[StateSnapshot], None], ...] = ()
        self.observers = Observers(on_fault=self._on_fault, caught=self._caught)
        self._controllers = ControllerSchedule(caught=self._caught)
        self.robots = SimulatedRobots(self._controllers)
        self._cameras: CameraSet | None = None
        self._error = ""
        self._fault: SimulationFaultError | None = None
        """What the next call from Python raises."""
        self._closed = False
        self._ticking = threading.RLock()  # held by the engine thread during a tick
        self._at_close = ExitStack()
        self._state = self._read_state()
        self._shown_state = (self._state, self._state)
        self._origin: ForkOrigin | None = None
        self._forks: tuple[Simulation, ...] = ()
        self._thread: EngineThread | DirectCalls = DirectCalls()
        if threaded:
            self._thread = EngineThread(
                self._tick,
                on_late_end=self._late_ends.notify,
                on_fault=lambda error: self._on_fault(self._as_fault(error)),
                last_rebuild=lambda: self._rebuilding_engine.last_rebuild if self._rebuilding_engine else None,
                expected_rebuild_s=lambda: self._state.expected_rebuild_s,
                called=self._called,
            )

    # -- the world -----------------------------------------------------------------------------------------

    @property
    def worlds(self) -> tuple[World, ...]:
        """The worlds that were spawned, in their initial state."""
        return (*self._worlds, *self._temporary_worlds)

    @property
    def reports(self) -> tuple[SpawnReport, ...]:
        """The report of each spawn."""
        return self._reports

    @property
    def state(self) -> StateSnapshot:
        """The latest published state; reading it does not block.

        A pause and an error are part of it at once, even while the engine is busy.
        """
        state, error = self._state, self._error
        playing = state.playing and self._clock is not None
        if state.playing == playing and state.error == error:
            return state
        shown = self._shown_state
        if shown[0] is not state or shown[1].playing != playing or shown[1].error != error:
            paused = {} if playing or not state.playing else {"playing": False, "speed": 1.0, "real_time_factor": 0.0}
            shown = self._shown_state = state, replace(state, error=error, **paused)
        return shown[1]

    def on_state(self, callback: Callable[[StateSnapshot], None]) -> Callable[[], None]:
        """Calls a function with each published state, before the call that led to it returns.

        It is called in the engine thread, and must be quick and not raise.

        Returns:
            A function that ends it.
        """
        self._state_callbacks = (*self._state_callbacks, callback)

        def remove() -> None:
            self._state_callbacks = tuple(each for each in self._state_callbacks if each is not callback)

        return remove

    @property
    def geometry(self) -> GeometryMap:
        """The geometry of the bodies that exist."""
        return self._geometry_provider.for_ids(self._state.ids)

    @property
    def immovable(self) -> frozenset[BodyId]:
        """Dynamic bodies that were spawned as static ones, since they cannot be loose."""
        return self._geometry_provider.immovable

    @checked
    def spawn(
        self,
        world: World | str | None = None,
        *,
        geometry: GeometryMap | None = None,
        persistent: bool = True,
        ground: bool = True,
        check_rest: bool = False,
        title: str = "",
        timeout_s: Timeout | None = None,
    ) -> SpawnReport:
        """Spawns a world, or a map of the knowledge base.

        Dynamic bodies that cannot be loose, such as walls, are simulated as static ones, and loose bodies are moved out
        of what they overlap. The report lists them; the snapshot has the statements of the map.

        Args:
            world: a world, or the name or IRI of a map; by default the only map.
            geometry: the geometry of its bodies, instead of fitting it.
            persistent: whether `reset` restores it; otherwise `reset` removes it.
            ground: whether a ground is assumed where nothing is below loose bodies.
            check_rest: whether the report names the bodies that move away in the first two simulated seconds, which
                are simulated for that and undone; see `check_rest`. Worlds of remote engines are not checked.
            title: the name of the edit in the undo history; without one it cannot be undone. With one, nothing is
                spawned if a part of it cannot be.
            timeout_s: timeout of the engine call [s]; by default that of the simulation plus 50 ms for each body and
                joint.

        Returns:
            What was spawned, what failed and why, and what was assumed.

        Raises:
            MapNotFoundError: no map has that name.
            AmbiguousMapError: several maps are loaded, and no name is given.
            SpawnRefusedError: a part of it cannot be spawned, and there is a title.
        """
        make = partial(self.edits.apply if title else self.apply, timeout_s=timeout_s)
        options: Any = {"ground": ground, "whole": bool(title), "persistent": persistent, "title": title}
        with self._tick_delay.preparing():
            description = world if isinstance(world, World) else self.knowledge.world(world)
        report = self._spawn(description, make, self._geometry_provider, geometry=geometry, **options)
        if check_rest:
            report = self.with_rest(report)
        return replace(report, expected_rebuild_s=self._state.expected_rebuild_s)

    def with_rest(self, report: SpawnReport) -> SpawnReport:
        """The report of a spawn with the bodies that move away, as `spawn` returns it with `check_rest`."""
        if is_remote(self.engine.name):
            return report
        checked = replace(report, moved=self.check_rest(), rest_checked_s=REST_CHECK_S)
        self._reports = (*self._reports[:-1], checked)
        return checked

    def _spawn(
        self,
        world: World,
        make: Callable[[Spawn], Applied],
        provider: GeometryProvider,
        *,
        geometry: GeometryMap | None = None,
        **options: Any,
    ) -> SpawnReport:
        """Fits geometry to a world, makes the edit that spawns it, and keeps the report of both."""
        with self._tick_delay.preparing():
            fitted = provider.fit(world, geometry=geometry)
            immovable, uncertain = provider.find_immovable(world), provider.find_uncertain_poses(world)
        spawn = Spawn(world, geometry=fitted.geometry, immovable=immovable.ids, uncertain_poses=uncertain, **options)
        applied = make(spawn)
        report = with_immovable_notes(applied.report, immovable)
        report = with_geometry_notes(report, fitted, (body.id for body in world.bodies))
        self._reports = tuple(report if each is applied.report else each for each in self._reports)
        return report

    def replace_world(
        self,
        world: World | str | None = None,
        *,
        knowledge: KnowledgeBase | None = None,
        geometry: GeometryMap | None = None,
        title: str = "",
    ) -> SpawnReport:
        """Replaces all worlds, with their robots, by one: `sim.replace_world(knowledge=other)` loads another map.

        It is one step of the undo history. Undoing it restores what was there before, bit for bit: worlds, robots,
        knowledge base, and the state of the engine. The last 3 can be undone, and none if the engine cannot save its
        state; the history begins after any other.

        Args:
            world: a world, or the name or IRI of a map; by default the only map.
            knowledge: the knowledge base from then on, which must stay open as long as it can be undone or redone;
                by default the present one.
            geometry: the geometry of bodies; by default it is fitted.
            title: the name of the edit in the undo history.

        Returns:
            What was spawned, what failed and why, and what was assumed.

        Raises:
            MapNotFoundError: no map has that name.
            AmbiguousMapError: several maps are loaded, and no name is given.
        """
        source = self.knowledge if knowledge is None else knowledge
        description = world if isinstance(world, World) else source.world(world)
        contents = self._no_worlds(source)
        label = title or f"{description.name or short_name(description.iri)} loaded"

        def make(spawn: Spawn) -> Applied:
            edit = ReplaceWorld(KeptWorld(self, contents, spawn=spawn), title=label)
            return self.edits.apply(edit)

        report = self._spawn(description, make, contents["_geometry_provider"], geometry=geometry, ground=True)
        return replace(report, expected_rebuild_s=self._state.expected_rebuild_s)

    def _no_worlds(self, knowledge: KnowledgeBase) -> dict[str, Any]:
        """The attributes that are about the worlds, without any."""
        controllers = ControllerSchedule(caught=self._caught)
        return {
            "knowledge": knowledge,
            "_geometry_provider": self._geometry_provider.for_knowledge(knowledge),
            "_worlds": (),
            "_temporary_worlds": (),
            "_reports": (),
            "_grounded": False,
            "_initial_state": None,
            "_initial_state_is_due": False,
            "_start": None,
            "_controllers": controllers,
            "robots": SimulatedRobots(controllers),
            "_highlights": Highlights(),
        }

    def _replace(self, edit: ReplaceWorld, engine: Engine) -> Applied:
        """Makes the edit, in the engine thread; nothing has changed if it fails, if the engine can save its state."""
        new, report = edit.world, SpawnReport()
        if new.owner is not self:
            raise InvalidArgumentError("the world", cause="another simulation keeps it")
        if new.spawn is None and new.state is None:
            raise UnsupportedByEngineError(engine.name, what="restore a world", remedy="load the map again")
        state = engine.save_state() if Capability.SAVE in engine.capabilities else None
        former = KeptWorld(self, {name: getattr(self, name) for name in new.contents}, state=state)
        if new.spawn is not None:
            engine.clear()
        try:
            if new.state is not None:
                engine.restore_state(new.state)
            self._perturbations.clear()
            self.__dict__ |= new.contents
            if new.spawn is not None:
                report = engine.apply(new.spawn).report
                self._keep(new.spawn, report)
            self._highlights.reapply(engine)
        except BaseException:
            if state is not None:
                engine.restore_state(state)
                self.__dict__ |= former.contents
            raise
        return Applied(edit=edit, inverse=ReplaceWorld(former, title=edit.label), report=report)

    @checked
    def apply(
        self,
        edit: Edit,
        *,
        engine: Engine | None = None,
        leads_to: SavedState | None = None,
        timeout_s: Timeout | None = None,
    ) -> Applied:
        """Makes an edit, which is no step of the undo history; see `Edits.apply`.

        Args:
            edit: the edit.
            engine: what a function has got that runs in the engine thread; None in any other thread.
            leads_to: the state to which the edit leads, if the engine has saved that: it is restored instead.
            timeout_s: by default that of the simulation, plus 50 ms for each body and joint that is spawned [s].

        Raises:
            WorldError: the world does not allow it, as stated at the class of the edit; nothing changes then.
        """
        if engine is None:
            for addition in additions(edit):
                self._geometry_provider.require_granted(addition.world)
            return self._run(
                lambda engine: self.apply(edit, engine=engine),
                label=edit.kind,
                timeout_s=edit_timeout_s(edit, self.timeout_s) if timeout_s is None else timeout_s,
                edits=not isinstance(edit, SetPoses),
                saves_first=not any(isinstance(each, Spawn) and each.persistent for each in primitives(edit)),
            )
        if isinstance(edit, ReplaceWorld):
            return self._replace(edit, engine)
        if isinstance(edit, RestoreBodies) and not edit.geometry:
            edit = replace(edit, geometry=self._geometry_provider.for_world(edit.world))
        if leads_to is None:
            applied = engine.apply(edit)
        else:
            applied = Applied(edit=edit, inverse=edit)
            if isinstance(engine, ObservedEngine):
                engine.restore_before(edit, leads_to)
            else:
                engine.restore_state(leads_to)
            self._highlights.reapply(engine)
        for each in primitives(edit):
            self._keep(each, applied.report)
        if isinstance(edit, SessionEdit):
            known = set(self.robots)
            edit.complete(self, engine)
            self._initial_state_is_due |= not known.issuperset(self.robots)  # with the actuators
        return applied

    def _keep(self, edit: Edit, report: SpawnReport) -> None:
        """Keeps what `reset` and questions need of an edit that was made."""
        if isinstance(edit, RestoreBodies):
            self._geometry_provider.restore(edit.geometry)
        if not isinstance(edit, Spawn) or any(edit.world is each for each in self.worlds):
            return
        self._geometry_provider.add(edit, report.failed_bodies)
        self._grounded |= edit.ground
        self._reports = (*self._reports, report)
        if not edit.persistent:
            self._temporary_worlds = (*self._temporary_worlds, edit.world)
            return
        self._worlds = (*self._worlds, edit.world)
        self._initial_state_is_due = True
        if self._start is None:
            self._save_initial_state()
            self._start = self._start_state()

    def check_rest(self) -> tuple[MovedBody, ...]:
        """The bodies that move away in the next two simulated seconds, farthest first; the world is then as before.

        The worlds of an engine that cannot save its state are spawned again instead.
        """

        def check(engine: Engine) -> tuple[MovedBody, ...]:
            before = engine.save_state() if Capability.SAVE in engine.capabilities else None
            try:
                return find_bodies_that_move(engine, self.worlds)
            finally:
                self._restore(engine, before, self._worlds)

        return self.engine.run(check, label="check rest", timeout_s=self.timeout_s * 6 * (1 + REST_CHECK_S))

    def snapshot(self) -> World:
        """The current state as a world."""
        return self.engine.run(lambda engine: engine.snapshot(), label="snapshot")

    def current_state(self) -> WorldState:
        """The current world, joint positions and geometry, for questions about them."""

        def take(engine: Engine) -> WorldState:
            world, spawned, geometry = engine.snapshot(), self.worlds, self.geometry
            joints = engine.joint_positions() if Capability.JOINTS in engine.capabilities else None
            state = WorldState(
                world=world, spawned=spawned, joint_positions=joints, source=engine.name, geometry=geometry
            )
            self._asked_state = state.following(self._asked_state)
            return self._asked_state

        return self.engine.run(take, label="current state")

    def reset(self, *, to_start: bool = False, keep_spawned: bool = False) -> None:
        """Restores the state after the last persistent spawn, or the start; highlights remain.

        Args:
            to_start: whether the start is restored (see `mark_start`): what was spawned later is removed, and the undo
                history is cleared.
            keep_spawned: whether bodies that were spawned after the start, and exist now, are spawned again at their
                first poses.
        """

        def reset(engine: Engine) -> None:
            start, present = self._start or StartState(), set(engine.poses()[0])
            self._perturbations.clear()
            self._error, self._fault = "", None
            if to_start:
                self._restore(engine, start.state, (*start.worlds, *start.temporary_worlds))
            else:
                self._restore(engine, self._initial_state, self._worlds)
            self._controllers.reset(engine)
            if to_start:
                self._return_to(start, engine, kept=present if keep_spawned else None)
            self._highlights.reapply(engine)

        self.engine.run(reset, label="reset", edits=True, timeout_s=self.timeout_s * 3)
        if to_start:
            self.edits.clear()

    def _return_to(self, start: StartState, engine: Engine, *, kept: set[BodyId] | None) -> None:
        """Forgets what came after the start, except for the bodies that are kept, which are spawned again."""
        self._initial_state = start.state
        self.robots.forget_former()
        if kept is not None:
            later = (*self._worlds[len(start.worlds) :], *self._temporary_worlds[len(start.temporary_worlds) :])
            added = kept - self.start_ids
            self._respawn(engine, (world_with_bodies(world, added, self.start_ids) for world in later))
        else:
            self._worlds, self._temporary_worlds = start.worlds, start.temporary_worlds
            self._reports = self._reports[: start.report_count]

    def _restore(self, engine: Engine, state: SavedState | None, worlds: Iterable[World]) -> None:
        """Restores a saved state; without one, worlds are spawned again."""
        if state is not None:
            engine.restore_state(state)
        else:
            engine.clear()
            self._respawn(engine, worlds)

    def _respawn(self, engine: Engine, worlds: Iterable[World]) -> None:
        """Spawns worlds that were spawned before."""
        for world in worlds:
            engine.apply(self._geometry_provider.respawn(world, ground=self._grounded))

    @property
    def start_ids(self) -> frozenset[BodyId]:
        """The bodies of the start, to which `reset` can return."""
        start = self._start or StartState()
        return frozenset(body.id for world in (*start.worlds, *start.temporary_worlds) for body in world.bodies)

    def mark_start(self) -> None:
        """Makes the current state the start; without a call it is the state after the first persistent spawn."""

        def mark(_: Engine) -> None:
            self._initial_state_is_due = True
            self._save_initial_state()
            self._start = self._start_state()

        self.engine.run(mark, label="mark start")

    def clear(self) -> None:
        """Removes all worlds, and clears the undo history."""

        def clear(engine: Engine) -> None:
            engine.clear()
            self._perturbations.clear()
            self.__dict__ |= self._no_worlds(self.knowledge)

        self.engine.run(clear, label="clear", edits=True)
        self.edits.clear()

    def _run(
        self,
        function: Callable[[Engine], T],
        *,
        label: str,
        timeout_s: float | None,
        edits: bool,
        saves_first: bool = True,
    ) -> T:
        """See `EngineAccess.run`; a persistent spawn does not need the state before it to be saved first."""
        if self._closed:
            raise SimulationError("the simulation is closed; make a new one")
        timeout_s = self.timeout_s if timeout_s is None else timeout_s
        client = current_client()
        if client == DEFAULT_CLIENT:
            self._raise_fault()

        def run() -> T:
            try:
                if saves_first:
                    self._save_initial_state()
                if not self.observers:
                    return function(self._engine)
                with self.observers.editing(self._engine, label=label, client=client) as engine:
                    return function(engine)
            finally:
                if edits and self._is_rebuild_pending():
                    self._tick_delay.add_edit()
                self._publish(edits=edits)

        return self._thread.run(run, label=label, timeout_s=timeout_s)

    # -- questions -----------------------------------------------------------------------------------------

    @overload
    def ask(self, question: Question[R], /, *positional: object, **args: object) -> Answers[R]: ...
    @overload
    def ask(self, question: str, /, *positional: object, **args: object) -> Answers[Any]: ...
    def ask(self, question: Question[Any] | str, /, *positional: object, **args: object) -> Answers[Any]:
        """All answers to a question or a plain sentence, for the current state; see `KnowledgeBase.ask`.

        The state is read from the engine at most once, and only by questions about it. With `at`, `during`, `since`,
        `until` or `episode` the question is about an episode of the knowledge base, or what is being recorded, and not
        about the present.
        """
        time, args = time_arguments(args, declared=argument_names(question))
        present = StateAccess(self.knowledge, self.current_state, simulation=self)
        resolved, known, notes = resolve_question(
            self.knowledge,
            question,
            args,
            positional=positional,
            find_body=present.find_individual,
            is_past=time != NOW,
        )
        if time != NOW or resolved.about_past:
            with recorded_so_far(self.observers.recorder) as running:
                episodes = (*self.knowledge.episodes, *running)
                return ask_over_time(self.knowledge, resolved, known, time=time, episodes=episodes, notes=notes)
        answers = resolved.ask(self.knowledge, known, present=present, notes=notes)
        if self.observers:
            self.observers.report_answers(answers)
        return answers

    @checked
    def sparql(
        self,
        query: str,
        *,
        timeout_s: Timeout = 30.0,
        allow_service: bool = False,
        at: Time | None = None,
        episode: str | None = None,
    ) -> SparqlResult:
        """Runs a SPARQL query; see `KnowledgeBase.sparql`.

        The graph `urn:mindstage:present`, which a query names with FROM or GRAPH, has the current state: poses, joint
        positions, attachments, and what is on or in what. All other graphs are as loaded.
        """
        present = StateAccess(self.knowledge, self.current_state)
        return self.knowledge.sparql(
            query, timeout_s=timeout_s, allow_service=allow_service, present=present, at=at, episode=episode
        )

    def highlight(
        self,
        shown: str | AnswerRow | Answers[Any] | Iterable[str | AnswerRow],
        color: Color | str | None,
        *,
        label: str = "",
        replace: bool = False,
        missing_ok: bool = False,
    ) -> HighlightResult:
        """Highlights bodies in a color, or removes their highlight.

        Highlights add up; a body that is highlighted twice has the later color, and highlighting something again with
        the same label replaces what was highlighted with it before.

        Args:
            shown: the id or IRI of a body, an answer, several of these, or all answers to a question. Of answers it is
                the first column of individuals that was not an argument, such as the handle of a given door.
            color: a name ("green"), "#rrggbb", or red, green and blue from 0 to 1; None or "none" removes the
                highlight.
            label: the reason, in one line; for `Answers` by default the question.
            replace: whether all other highlights are removed first.
            missing_ok: whether an unknown id is listed in the result, as an IRI is, instead of raising.

        Returns:
            The highlighted bodies, and the items without a body, with the reason.

        Raises:
            BodyNotFoundError: for the first unknown id, unless `missing_ok`; nothing changes then.
            InvalidColorError: the color is invalid.
        """
        request = highlight_request(shown, label)
        rgb = color_from(color)
        apply = partial(self._highlights.apply, request=request, color=rgb, replace=replace, strict=not missing_ok)
        return self.engine.run(apply, label="highlight", edits=True)

    def clear_highlights(self) -> None:
        """Removes all highlights."""
        self.engine.run(
            lambda engine: engine.highlight(tuple(engine.highlights()), None), label="clear highlights", edits=True
        )

    # -- copies --------------------------------------------------------------------------------------------

    def fork(self, *, threaded: bool = True, physics: bool = False) -> Simulation:
        """Copies the simulation: `with sim.fork() as copy`. Nothing that happens in the copy affects the original.

        The copy starts in exactly the same state if the engine can be forked; otherwise it is simulated by MuJoCo from
        a snapshot, and `origin.notes` lists the differences. The knowledge base is shared. `commit` makes the edits of
        the copy in the original; closing it throws it away.

        Args:
            threaded: whether the copy has a thread of its own; otherwise it is used from the calling thread only, and
                cannot play in real time.
            physics: whether the copy of an engine without physics is simulated by MuJoCo, from a snapshot.
        """
        provider = self._geometry_provider

        def fork(engine: Engine) -> tuple[Engine, ForkOrigin, ControllerSchedule]:
            spawn = partial(provider.respawn, ground=self._grounded)
            copied, notes = copied_engine(engine, worlds=self.worlds, spawn=spawn, physics=physics)
            ids, poses = engine.poses()
            return copied, ForkOrigin(self, self._revision, ids, poses, notes), self._controllers.copy()

        engine, origin, controllers = self.engine.run(fork, label="fork")
        self.observers.report("imagination", details={"notes": origin.notes})
        recorded = EditRecordingEngine(engine)
        copy = Simulation(self.knowledge, recorded.as_engine(), timeout_s=self.timeout_s, threaded=threaded)
        copy._geometry_provider, copy._origin = provider.copy(), origin
        copy._worlds, copy._temporary_worlds, copy._reports = self._worlds, self._temporary_worlds, self._reports
        copy._grounded, copy._controllers = self._grounded, controllers
        if self._cameras is not None:
            copy._camera_set().copy_from(self._cameras)
        controllers.caught = copy._caught
        copies = {name: each.in_copy(copy, controllers) for name, each in self.robots.items()}
        copy.robots = SimulatedRobots(controllers, copies)
        if self._initial_state is not None and not origin.notes:
            copy._initial_state = recorded.own_state(self._initial_state)
        if threaded:
            self._forks = (*self._forks, copy)
            copy.on_close(lambda: self._forget_fork(copy))
        return copy

    @property
    def origin(self) -> ForkOrigin | None:
        """The simulation that this one is a copy of, and its state then; None if it is no copy."""
        return self._origin

    @property
    def forks(self) -> tuple[Simulation, ...]:
        """The copies that are open and have threads of their own, in the order in which they were made."""
        return self._forks

    def commit(self) -> tuple[str, ...]:
        """Makes the edits of this copy in its original: spawned, deleted, moved and attached bodies, moved joints.

        All of them are made, with bodies and joints where they were in the copy, or none: time that passed in the copy
        is not stepped in the original, and what it has moved there cannot be attached or detached here. Joints are
        moved by pulling again.

        Returns:
            The edits that were made, in words.

        Raises:
            CommitError: this is not a copy, or the original has changed since it was copied, or an edit is not possible
                there, or has another result; nothing was done.
        """
        joints = self.engine.run(lambda engine: engine.joint_positions())
        return commit_edits(self._engine, self._origin, joints)

    def __getstate__(self) -> dict[str, Any]:
        """What another process needs to make an equal copy; only copies without a thread can be pickled."""
        if not isinstance(self._thread, DirectCalls) or not isinstance(self._engine, EditRecordingEngine):
            raise TypeError("only a copy that was made with `fork(threaded=False)` can be pickled")
        state = {name: getattr(self, name) for name in _PICKLED_FIELDS}
        return {**state, "engine": self._engine.engine, "notes": self._origin.notes if self._origin else ()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        engine = EditRecordingEngine(state.pop("engine")).as_engine()
        notes = state.pop("notes")
        Simulation.__init__(self, state.pop("knowledge"), engine, timeout_s=state.pop("timeout_s"), threaded=False)
        self.__dict__ |= state
        self._origin = ForkOrigin(self, self._revision, self._state.ids, self._state.poses, notes)

    def _forget_fork(self, copy: Simulation) -> None:
        self._forks = tuple(each for each in self._forks if each is not copy)

    # -- time ----------------------------------------------------------------------------------------------

    @checked
    def step(self, duration_s: Duration, *, progress: Callable[[float], None] | None = None) -> None:
        """Advances simulated time as fast as the engine can; other calls are executed in between.

        `pause` does not end it: that is about `play`. A simulation that is closed does.

        Args:
            duration_s: simulated time [s].
            progress: called repeatedly with the time simulated so far [s].

        Raises:
            InvalidArgumentError: the duration is not a number, negative, or more than an hour.
            SimulationFaultError: a controller raised; it was removed, and the time until then has passed.
            SimulationDivergedError: the state is no longer finite.
        """
        done = 0.0
        while done < duration_s:
            longest = self.observers.step_s(_STEP_CHUNK_S)
            chunk = left = min(longest, duration_s - done)
            timeout_s = self.timeout_s * (1 if self._interruptible_engine is not None else 6)
            while left > 0.0:
                left = self.engine.run(partial(self._step_slice, left), label="step", timeout_s=timeout_s)
            done = done + chunk if duration_s - done > longest else duration_s
            if progress is not None:
                progress(done)

    @checked
    def play(self, *, speed: Speed = 1.0) -> None:
        """Starts to advance simulated time at a multiple of real time, in the background.

        Ticks are bounded by wall time: with a speed that the engine does not reach, time advances as fast as it can.

        Raises:
            InvalidArgumentError: the speed is 0, not a number, or out of range.
        """
        if speed == 0.0:
            raise InvalidArgumentError("speed", cause="it must be above 0", remedy="use `pause`")
        if isinstance(self._thread, DirectCalls):
            raise SimulationError("a simulation without a thread cannot play; use `step`, or copy it with `threaded`")
        if current_client() == DEFAULT_CLIENT:
            self._raise_fault()
        self._error, self._fault, self._clock = "", None, RealTimeClock(speed)
        self.engine.run(lambda engine: None, label="play")

    def pause(self) -> None:
        """Stops the simulated time; edits and single steps remain possible.

        It is published at once, and no tick begins afterwards. A tick that is running ends first, within two hundredths
        of a second or one time step of the engine; while the engine rebuilds its model, this does not wait for it.

        Raises:
            SimulationError: the simulation is closed, or its thread has ended.
        """
        if self._closed:
            raise SimulationError("the simulation is closed; make a new one")
        self._thread.check_alive("pause")
        self._clock = None
        if self._thread.is_current:
            self._publish()
            return
        if self._ticking.acquire(timeout=_PAUSE_WAIT_S):
            self._ticking.release()
        self._thread.post(self._publish_if_possible, label="pause")

    # -- bodies and joints ---------------------------------------------------------------------------------

    @checked
    def make_body(self, cls: str, *, id: str | None = None, size: Size | None = None) -> Body:
        """Creates a body of a class for `place`, which raises the same errors, by default of the class's size [m]."""
        return make_body(self, cls, id=id, size=size)

    @overload
    def place(
        self,
        item: Body | str,
        *,
        on: str | None = None,
        into: str | None = None,
        near: Point | None = None,
        title: str = "",
    ) -> PlacementResult: ...

    @overload
    def place(
        self,
        item: list[str] | tuple[Body | str, ...],
        *,
        on: str | None = None,
        into: str | None = None,
        title: str = "",
        room_for: Sequence[Body | str] = (),
    ) -> tuple[PlacementResult, ...]: ...

    @checked
    def place(
        self,
        item: Body | str | list[str] | tuple[Body | str, ...],
        *,
        on: str | None = None,
        into: str | None = None,
        near: Point | None = None,
        title: str = "",
        room_for: Sequence[Body | str] = (),
    ) -> PlacementResult | tuple[PlacementResult, ...]:
        """Spawns a body on or in another one, at a free pose at which it stays; an existing body is moved there.

        Several bodies are placed at once, where all of them fit.

        Args:
            item: a body, whose pose is ignored, the id of one that exists, or the name of a class for a new one; or a
                list or tuple of them.
            on: the id of the body to place it on.
            into: the id of the body to place it in, including its parts and drawers.
            near: a point that it is placed near, in the world frame [m].
            title: the name of the edit in the undo history; without one it cannot be undone.
            room_for: with a list or tuple, what is to be placed there afterwards, and for which room is left.

        Raises:
            BodyNotFoundError: the holder does not exist.
            NoFreePlacementError: no level surface is large enough and free, or the body is stable on none.
            NameNotFoundError: no class has that name.
            InvalidArgumentError: not exactly one of `on` and `into` is given, or the size of the class is unknown.
        """
        if not isinstance(item, Body | str):
            if near is not None:
                raise InvalidArgumentError("near", cause="only one thing is placed near a point")
            return place_items(self, item, on=on, into=into, room_for=room_for, title=title)
        placed = place_item(self, item, on=on, into=into, near=near, title=title)
        return replace(placed, expected_rebuild_s=self._state.expected_rebuild_s)

    def fit_geometry(self, body: Body) -> BodyGeometry | None:
        """The geometry that a body would have, without fitting it to other bodies."""
        return self._geometry_provider.fit(World(iri=body.iri, bodies=(body,))).geometry.get(body.id)

    def body(self, id: str) -> SimulationBody:
        """A body whose state can be read: `sim.body("cup").pose`.

        Args:
            id: the id or IRI of a body.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        found = find_body(self, id)
        if found is None:
            raise BodyNotFoundError(id, known=self.state.ids)
        return SimulationBody(self, found)

    def joint(self, id: str) -> SimulationJoint:
        """A joint that can be opened, closed and moved: `sim.joint("fridge_door").open()`.

        Args:
            id: the id or IRI of a joint, or of the door, drawer or other body that it moves.

        Raises:
            NameNotFoundError: no movable joint or body has that name.
            AmbiguousNameError: several joints move that body.
        """
        record = self._engine.add_joint_motion if isinstance(self._engine, EditRecordingEngine) else None
        return find_joint(self, id, on_pull=record)

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        format: str | None = None,
        dialect: FileDialect | str | None = None,
        assets: str | os.PathLike[str] | Iterable[str | os.PathLike[str]] = (),
        primitive_shapes: bool = False,
        robots: bool = False,
    ) -> tuple[str, ...]:
        """Writes the current state to a file; the suffix determines the format (see `mindstage.save`).

        Robots are written only if `robots` is true, in MJCF with their actuators; what they hold is always written.

        Returns:
            Notes, one sentence each, on what the format cannot express.

        Raises:
            MapWriteError: the suffix is unknown, the format cannot express the world, or the file cannot be written.
        """
        from mindstage.saving import save_world

        parts = frozenset() if robots else frozenset(id for robot in self.robots.values() for id in robot.body_ids)
        world = without_bodies(self.snapshot(), parts)
        actuated = [robot.actuated_bodies() for robot in self.robots.values()] if robots else []
        options: Any = {"format": format, "dialect": dialect, "assets": assets, "primitive_shapes": primitive_shapes}
        return save_world(world, path, knowledge=self.knowledge, actuated=actuated, **options)

    @checked
    def render(
        self,
        camera: CameraPose | None = None,
        settings: PathTracingSettings | None = None,
        *,
        clip_height: Coordinate | None = None,
    ) -> PathTracedPicture:
        """Renders a path-traced picture of the current state: `sim.render().encode(".png")`; the simulation may run.

        Args:
            camera: by default the first view of the page.
            settings: size, quality and exposure.
            clip_height: nothing above this height is drawn [m].

        Raises:
            RendererUnavailableError: the extra "render" is not installed.
        """
        from mindstage.simulation.pictures import render_picture

        return render_picture(self, camera, settings, clip_height=clip_height)

    # -- sensors -------------------------------------------------------------------------------------------

    def camera(self, name: str = "") -> Camera:
        """A camera of a robot, or one that was added: `sim.camera("head").rgb()`.

        Args:
            name: its name, also after that of the robot and "/"; the beginning before "_" is enough if no other one
                begins so. By default that of the only camera.

        Raises:
            NameNotFoundError: there is no such camera.
            InvalidArgumentError: several cameras have that name.
        """
        return self._camera_set().camera(name)

    @property
    def cameras(self) -> tuple[str, ...]:
        """The names of all cameras: those that were added, then ROBOT/NAME."""
        return tuple(self._camera_set().mounts())

    def add_camera(self, name: str, model: CameraModel | None = None, *, at: PoseLike, on: str | None = None) -> Camera:
        """Adds a camera, which is no body and stays until the simulation is closed; copies have it too.

        Args:
            name: its name; a camera that was added under it is replaced.
            model: its intrinsics, range, rate and noise; by default 640 x 480 px with 63 degrees across.
            at: the pose of its optical frame (x right, y down, z forward), in the frame of the body or the world [m].
            on: the id or IRI of a body that carries it; by default the world.

        Raises:
            BodyNotFoundError: there is no such body.
            InvalidArgumentError: the pose is none.
        """
        return self._camera_set().add(name, model, at=at, on=None if on is None else self.body(on).id)

    def _camera_set(self) -> CameraSet:
        if self._cameras is None:
            from mindstage.sensors.stage import CameraSet

            self._cameras = CameraSet(self)
            self.on_close(self._cameras.close)
        return self._cameras

    # -- robots and controllers ----------------------------------------------------------------------------

    def add_controller(self, name: str, controller: Controller) -> Callable[[], None]:
        """Adds a controller of actuators, which is copied and reset together with the simulation.

        Returns:
            A function that removes it.
        """
        self.engine.run(lambda _: self._controllers.add(name, controller), label="add controller")
        return lambda: self.engine.run(lambda _: self._controllers.remove(name, controller), label="remove controller")

    # -- perturbations -------------------------------------------------------------------------------------

    @checked
    def pull(self, id: BodyId, *, point: Point, target: Point) -> None:
        """Pulls a point of a body towards a target until `release`; call again to move the target.

        Args:
            id: the body.
            point: where the force acts, in the body frame [m].
            target: where the point is pulled to, in the world frame [m].

        Raises:
            BodyNotFoundError: there is no such body.
        """
        is_new = id not in self._perturbations
        if is_new and id not in self._state.ids:
            raise BodyNotFoundError(id, known=self._state.ids)
        self._perturbations.pull(id, point=point, target=target, worlds=self.worlds)
        if is_new:
            self.observers.report("pull", ids=(id,), details={"point": point, "target": target})

    def release(self, id: BodyId | None = None) -> None:
        """Ends the pull on one body, or all pulls."""
        if released := tuple(self._perturbations) if id is None else (id,):
            self.observers.report("release", ids=released)
        self._perturbations.release(id)

    # -- closing -------------------------------------------------------------------------------------------

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._closed

    def on_close(self, callback: Callable[[], None]) -> None:
        """Registers a callback that `close` calls first, in reverse order of registration."""
        self._at_close.callback(callback)

    def close(self) -> None:
        """Stops the engine thread and closes the engine; may be called repeatedly."""
        if self._closed:
            return
        self._fault = None
        try:
            self._at_close.close()
        finally:
            self._closed = True
            self._clock = None
            self._thread.stop()
            self._engine.close()
            self.engine.error = EngineClosedError(self._engine.name)

    def __repr__(self) -> str:
        snapshot = self._state
        maps = "".join(f" {world.name or short_name(world.iri)}" for world in self.worlds)
        state = "closed" if self._closed else "playing" if snapshot.playing else "paused"
        bodies = counted(len(snapshot.ids), "body")
        return f"<{type(self).__name__}{maps}: {bodies}, {self.engine.name}, {state} at {snapshot.time_s:.2f} s>"

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- in the engine thread ------------------------------------------------------------------------------

    def _tick(self) -> float | None:
        clock = self._clock
        if clock is None:
            return self._expire_markers()
        hold_s = self._tick_delay.remaining_s()
        if hold_s > 0.0:
            return hold_s
        with self._ticking:
            if self._clock is not clock:
                return 0.0
            try:
                delay_s = self._play(clock)
            except EngineError as error:
                self._error, self._clock, delay_s = str(error), None, None
            self._publish_if_possible()
            return delay_s

    def _play(self, clock: RealTimeClock) -> float:
        """Advances time by what is due, or as far as it can within the wall time of a tick."""
        end_s = time.monotonic() + _SLICE_WALL_S
        self.markers.expire()
        self._save_initial_state()
        is_rebuild_pending = self._is_rebuild_pending()
        with self._tick_delay.rebuilding():
            if is_rebuild_pending and self._rebuilding_engine is not None:
                self._rebuilding_engine.rebuild()
        if is_rebuild_pending:
            return 0.0  # it took its time: other calls are executed first, which may pause
        due_s = clock.due_s()
        while due_s > 0.0:
            part_s = self.observers.step_s(due_s)
            if part_s > due_s * (1.0 - 1e-9):
                part_s = due_s
            left_s = self._advance(part_s, end_s=end_s)
            clock.advance(part_s - left_s)
            due_s -= part_s - left_s
            if time.monotonic() >= end_s or self._clock is not clock:
                break
            if due_s > 0.0:
                self._publish_if_possible()
        if self._clock is None:
            return 0.0
        return 0.0 if due_s > 0.0 else _TICK_S

    def _expire_markers(self) -> float | None:
        if self.markers.expire():
            self._publish_if_possible()
        return self.markers.next_expiry_s()

    def _step_slice(self, duration_s: float, _: Engine) -> float:
        """Advances time for a step, or a part of it; returns the time that is left [s]."""
        has_others = not isinstance(self._thread, DirectCalls)
        try:
            return self._advance(duration_s, end_s=time.monotonic() + _SLICE_WALL_S if has_others else math.inf)
        except SimulationFaultError as error:
            self._clock, self._error = None, str(error)
            raise

    def _advance(self, duration_s: float, *, end_s: float) -> float:
        """Advances time, at least by one part of a step; returns what is left at a time of the wall clock [s]."""
        left_s = duration_s
        while True:
            part_s = self._controllers.update(self._engine, left_s)
            done_s = self._step_engine(part_s, end_s=end_s)
            self._controllers.elapse(done_s)
            left_s -= done_s
            if left_s < EARLY_S:
                return 0.0
            if time.monotonic() >= end_s:
                return left_s

    def _step_engine(self, duration_s: float, *, end_s: float) -> float:
        """Steps the engine while the perturbations act; returns by how much [s]."""
        try:
            if self._perturbations:
                done_s = 0.0
                for part_s in self._perturbations.substeps(self._engine, duration_s):
                    self._engine.step(part_s)
                    done_s += part_s
                    if time.monotonic() >= end_s:
                        break
                return done_s
            if self._interruptible_engine is not None:
                wall_s = end_s - time.monotonic()
                return duration_s - self._interruptible_engine.step_for(duration_s, wall_s=wall_s)
            return self._step_uninterrupted(duration_s)
        except MindstageError:
            raise
        except self._caught as error:
            raise self._as_fault(error) from error

    def _step_uninterrupted(self, duration_s: float) -> float:
        """Steps an engine whose steps cannot be interrupted; returns by how much [s], which is less if it is slow."""
        part_s = min(duration_s, self._longest_part_s)
        began_s = time.monotonic()
        self._engine.step(part_s)
        took_s = time.monotonic() - began_s
        if took_s > _MAX_PART_WALL_S:
            self._longest_part_s = max(_MIN_PART_S, part_s * _MAX_PART_WALL_S / took_s / 3)
        elif took_s < _MAX_PART_WALL_S / 4 and part_s == self._longest_part_s:
            self._longest_part_s *= 2.0
        return part_s

    # -- faults: what is raised in the engine thread -------------------------------------------------------

    def _as_fault(self, error: BaseException) -> SimulationFaultError:
        """The error to report for what the engine, or anything else that a tick calls, raised."""
        if isinstance(error, SimulationFaultError):
            return error
        remedy = "reset the simulation, or make a new one"
        fault = fault_error(f"the engine {self._engine.name!r}", error, remedy=remedy)
        fault.__cause__ = error
        return fault

    def _on_fault(self, fault: SimulationFaultError) -> None:
        """Pauses the simulation; publishes the error, and raises it at the next call from Python."""
        self._clock, self._error, self._fault = None, str(fault), fault
        self._thread.post(self._publish_if_possible, label="error")

    def _raise_fault(self) -> None:
        if self._fault is not None and not self._thread.is_current:
            fault, self._fault = self._fault, None
            raise fault

    def _called(self) -> str:
        """What the engine thread is waiting for, for errors; called in any thread."""
        if name := self._controllers.called:
            return f"the controller {name!r}, which does not return"
        if name := self.observers.called:
            return f"the observer {name}, which does not return"
        rebuild = self._rebuilding_engine.last_rebuild if self._rebuilding_engine is not None else None
        return "a rebuild of its model" if rebuild is not None and rebuild.ended_s is None else ""

    def _save_initial_state(self) -> None:
        """Saves the state after the last persistent spawns, before anything changes it."""
        if self._initial_state_is_due:
            self._initial_state_is_due = False
            saves = Capability.SAVE in self._engine.capabilities
            self._initial_state = self._engine.save_state() if saves else None

    def _use_engine(self, engine: Engine) -> None:
        self._engine = engine
        self._rebuilding_engine: RebuildingEngine | None = engine if isinstance(engine, RebuildingEngine) else None
        self._interruptible_engine: InterruptibleEngine | None = None
        if isinstance(engine, InterruptibleEngine):
            self._interruptible_engine = engine
        self._longest_part_s = _STEP_CHUNK_S

    def _is_rebuild_pending(self) -> bool:
        return self._rebuilding_engine is not None and self._rebuilding_engine.rebuild_pending

    def _start_state(self) -> StartState:
        return StartState(self._worlds, self._temporary_worlds, len(self._reports), self._initial_state)

    def _publish(self, *, edits: bool = False) -> None:
        self._revision += edits
        try:
            self._state, self.engine.error = self._read_state(), None
        except EngineError as error:
            self.engine.error, self._clock, self._error = error, None, str(error)
            self._state = msgspec.structs.replace(self._state, playing=False, error=self._error)
            raise
        for callback in self._state_callbacks:
            callback(self._state)
        if self.observers:
            pending = self._is_rebuild_pending()
            self.observers.publish(self._state, self._engine, edited=edits, rebuild_pending=pending)
        if edits and (raised := self.clients.notify_edit(caught=self._caught)) is not None:
            fault = fault_error("a callback of edits", raised, remedy="it was removed")
            fault.__cause__ = raised
            self._on_fault(fault)

    def _publish_if_possible(self) -> None:
        with suppress(EngineError):  # reported by `state.error` and `engine.error`
            self._publish()

    def _read_state(self) -> StateSnapshot:
        ids, poses = self._engine.poses()
        poses.flags.writeable = False
        clock, highlights = self._clock, self._engine.highlights()
        return StateSnapshot(
            time_s=self._engine.time_s,
            ids=ids,
            poses=poses,
            highlights=highlights,
            highlight_groups=self._highlights.sync(highlights),
            markers=self.markers.markers,
            revision=self._revision,
            playing=clock is not None,
            speed=clock.speed if clock else 1.0,
            real_time_factor=clock.real_time_factor if clock else 0.0,
            stats=self._engine.stats() if Capability.STATISTICS in self._engine.capabilities else None,
            error=self._error,
            expected_rebuild_s=self._rebuilding_engine.expected_rebuild_s if self._rebuilding_engine else 0.0,
        )
