"""Stage: one knowledge base, one engine, one loop.

Everything that touches the engine goes through here and runs in the stage's own thread. Any thread may call; a call
takes its turn, has a timeout, and raises what the engine raised. What many watch (poses, lights, time) is published
as a `StateSnapshot` after each tick, which costs the watchers nothing and the world next to nothing.

Company: who takes part in a stage's life from elsewhere, such as a robot's programs over ROS.

Whoever lets others in introduces them once, by a function that says who is there; nothing has to be kept up to date.

Embodiment: the forms of all that is on a stage, and what the report of a spawn says of them.

Frame: what everybody sees of a stage, at one moment.

Showing: what a stage answers, and what it shows of the answers.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from functools import partial
from threading import Lock
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar, overload

import msgspec
from msgspec.structs import replace

from mindstage.engines.base import (
    Capability,
    Engine,
    SavedState,
    SpawnFailure,
    SpawnNote,
    SpawnNoteKind,
    SpawnReport,
)
from mindstage.errors import EngineClosedError, EngineError, InvalidArgumentError, SimulationError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import AnswerRow, Answers, Question, get_question
from mindstage.knowledge.questions import StateAccess, WorldState
from mindstage.scene import NO_GEOMETRY, Body, BodyGeometry, BodyId, Color, GeometryMap, GeometrySource, Vector, World
from mindstage.scene.colors import color_from
from mindstage.scene.display import counted, short_name
from mindstage.simulation.engine_thread import EngineThread, RealTimeClock
from mindstage.simulation.highlights import (
    HighlightResult,
    Highlights,
    Marker,
    MarkerStore,
    highlight_request,
)
from mindstage.simulation.interaction import Perturbations
from mindstage.simulation.joint_motion import SimulationJoint, find_joint
from mindstage.simulation.placement import PlacementResult, make_body, place_body
from mindstage.simulation.state import StateSnapshot
from mindstage.simulation.undo import UndoStack

if TYPE_CHECKING:
    from mindstage.geometry.fit import FittedGeometry, MeshProvider
    from mindstage.saving import FileDialect, FileFormat

__all__ = [
    "ClientDirectory",
    "ConnectedClient",
    "GeometryProvider",
    "Simulation",
    "with_geometry_notes",
]


class ConnectedClient(msgspec.Struct, frozen=True, kw_only=True):
    """One who is connected."""

    name: str
    transport: str
    """By which way, in a word or two: "ROS"."""
    activity: str = ""
    """What it does here, in a few words."""


class ClientDirectory:
    """All who are there; calls may come from any thread."""

    def __init__(self) -> None:
        self._sources: tuple[Callable[[], Iterable[ConnectedClient]], ...] = ()
        self._edit_callbacks: tuple[Callable[[], None], ...] = ()

    def add_client_source(self, source: Callable[[], Iterable[ConnectedClient]]) -> Callable[[], None]:
        """Lets a function tell who is there, from any thread; returns what takes it away again."""
        self._sources = (*self._sources, source)

        def farewell() -> None:
            self._sources = tuple(each for each in self._sources if each is not source)

        return farewell

    def clients(self) -> tuple[ConnectedClient, ...]:
        """Who is there now."""
        return tuple(guest for tell in self._sources for guest in tell())

    def on_edit(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Calls a function after each edit, when the frame tells of it; returns what ends that.

        It is called in the stage's thread, and must return at once.
        """
        self._edit_callbacks = (*self._edit_callbacks, callback)

        def farewell() -> None:
            self._edit_callbacks = tuple(each for each in self._edit_callbacks if each is not callback)

        return farewell

    def notify_edit(self) -> None:
        """Tells all who watch that bodies, materials or lights came, went or changed."""
        for react in self._edit_callbacks:
            react()


_SOURCE_TEXTS = {
    GeometrySource.MESH: "from meshes",
    GeometrySource.ONTOLOGY: "from what is known of their classes",
    GeometrySource.CLASS_NAME: "guessed by the names of their classes",
    GeometrySource.MAP: "plain, since nobody knows better",
}


class GeometryProvider:
    """Works forms out, and keeps them as long as somebody may bring their bodies back."""

    def __init__(self, knowledge: KnowledgeBase, *, shapes: bool, meshes: MeshProvider | None) -> None:
        """Has none yet.

        Args:
            knowledge: who knows how classes are shaped.
            shapes: whether it is asked; else a body without a mesh is its shape in its size.
            meshes: who finds mesh files.
        """
        self._knowledge = knowledge
        self._shapes, self._meshes = shapes, meshes
        self._geometry: dict[BodyId, BodyGeometry] = {}
        self._cached: tuple[tuple[BodyId, ...], GeometryMap] = ((), NO_GEOMETRY)
        self._lock = Lock()

    def set_knowledge(self, knowledge: KnowledgeBase) -> None:
        """Asks somebody else from now on."""
        self._knowledge = knowledge

    def fit(self, world: World, *, geometry: GeometryMap | None = None) -> FittedGeometry:
        """The forms of a world that is about to be spawned, unless they are given; a large one takes a while."""
        from mindstage.geometry.fit import FitNote, FittedGeometry, fit_geometry

        if geometry is not None:
            return FittedGeometry(geometry)
        if self._shapes:
            return fit_geometry(world, self._knowledge, meshes=self._meshes)
        if self._meshes is None:
            return FittedGeometry(NO_GEOMETRY)
        found = self._meshes.geometry_for(world.bodies)
        return FittedGeometry(found.geometry, tuple(FitNote((), text) for text in found.notes))

    def add(self, geometry: GeometryMap, *, failed: Iterable[SpawnFailure] = ()) -> None:
        """Keeps the forms of what was spawned; what failed may be called like something that is there already."""
        without = {failure.id for failure in failed}
        with self._lock:
            self._geometry = {**self._geometry, **{id: form for id, form in geometry.items() if id not in without}}
            self._cached = ((), NO_GEOMETRY)

    def for_world(self, world: World) -> GeometryMap:
        """The forms with which a world was spawned."""
        return {body.id: self._geometry[body.id] for body in world.bodies if body.id in self._geometry}

    def clear(self) -> None:
        """Forgets all of them."""
        with self._lock:
            self._geometry, self._cached = {}, ((), NO_GEOMETRY)

    def for_ids(self, ids: tuple[BodyId, ...]) -> GeometryMap:
        """The forms of bodies that are there; the same object for the same tuple."""
        with self._lock:
            known, forms = self._cached
            if known is not ids:
                forms = MappingProxyType({id: self._geometry[id] for id in ids if id in self._geometry})
                self._cached = (ids, forms)
            return forms


def with_geometry_notes(report: SpawnReport, fitted: FittedGeometry, ids: Iterable[BodyId]) -> SpawnReport:
    """The same report with what was decided about the forms of these bodies."""
    there = set(ids) - {failure.id for failure in report.failed_bodies}
    count = Counter(form.source for id, form in fitted.geometry.items() if id in there)
    notes = [SpawnNote(SpawnNoteKind.SHAPE, remark.ids, remark.text) for remark in fitted.notes]
    if count:
        words = ", ".join(f"{count[source]} {text}" for source, text in _SOURCE_TEXTS.items() if count[source])
        notes.insert(0, SpawnNote(SpawnNoteKind.SHAPE, (), f"forms: {words}"))
    return replace(report, notes=(*report.notes, *notes)) if notes else report


T = TypeVar("T")
R = TypeVar("R", bound=AnswerRow)


_TICK_S = 1 / 60
"""How often a playing world is brought up to date; a drag feels smooth at this rate."""
_STEP_CHUNK_S = 0.1
"""Long steps are cut into pieces of this simulated length, so that other calls get their turn."""


class Simulation:
    """Spawns what the knowledge base knows into an engine, and lets it live."""

    def __init__(
        self,
        knowledge: KnowledgeBase,
        engine: Engine,
        *,
        timeout_s: float = 10.0,
        shapes: bool = True,
        meshes: MeshProvider | None = None,
    ) -> None:
        """Takes over the engine; from now on only the stage may call it.

        Args:
            knowledge: what is known.
            engine: who runs it; closed together with the stage.
            timeout_s: how long a call may take before `SimulationTimeoutError`.
            shapes: whether bodies get the forms that are known of their classes; else they are plain.
            meshes: who finds the mesh files of bodies, which come before what is known.
        """
        self.knowledge = knowledge
        self.timeout_s = timeout_s
        self.clients = ClientDirectory()
        self.editing = UndoStack(self)
        self._engine = engine
        self._geometry_provider = GeometryProvider(knowledge, shapes=shapes, meshes=meshes)
        self._revision = 0
        self._worlds: tuple[World, ...] = ()
        self._temporary_worlds: tuple[World, ...] = ()
        self._reports: tuple[SpawnReport, ...] = ()
        self._initial_state: SavedState | None = None
        self._clock: RealTimeClock | None = None
        self._perturbations = Perturbations()
        self._highlights = Highlights()
        self._markers = MarkerStore()
        self._error = ""
        self._engine_error: EngineError | None = None
        self._closed = False
        self._at_close = ExitStack()
        self._state = self._read_state()
        self._thread = EngineThread(self._tick)

    # -- the world -----------------------------------------------------------------------------------------

    @property
    def engine_name(self) -> str:
        """Which engine runs the world."""
        return self._engine.name

    @property
    def capabilities(self) -> frozenset[Capability]:
        """What the engine can do beyond the contract."""
        return self._engine.capabilities

    @property
    def worlds(self) -> tuple[World, ...]:
        """What was spawned, as it was given."""
        return (*self._worlds, *self._temporary_worlds)

    @property
    def reports(self) -> tuple[SpawnReport, ...]:
        """What became of each of the worlds when it was spawned."""
        return self._reports

    @property
    def state(self) -> StateSnapshot:
        """The world as last published; reading it never waits."""
        return self._state

    @property
    def geometry(self) -> GeometryMap:
        """What the bodies that are there are made of."""
        return self._geometry_provider.for_ids(self._state.ids)

    def spawn(
        self,
        world: World | str | None = None,
        *,
        geometry: GeometryMap | None = None,
        persistent: bool = True,
        timeout_s: float | None = None,
    ) -> SpawnReport:
        """Spawns a world, or the map of that name, or the only map that is known.

        Args:
            world: a world, or the name of a map.
            forms: what its bodies are made of, instead of what is known about them.
            lasting: whether `reset` brings it back; what somebody only adds meanwhile is gone then.
            timeout_s: for the engine; by default the stage's own and 20 ms a body.
        """
        described = world if isinstance(world, World) else self.knowledge.world(world)
        fitted = self._geometry_provider.fit(described, geometry=geometry)

        def spawn(engine: Engine) -> SpawnReport:
            spawned = engine.spawn(described, geometry=fitted.geometry)
            report = with_geometry_notes(spawned, fitted, engine.poses()[0])
            self._geometry_provider.add(fitted.geometry, failed=spawned.failed_bodies)
            self._reports = (*self._reports, report)
            if persistent:
                self._worlds = (*self._worlds, described)
                self._save_initial_state(engine)
            else:
                self._temporary_worlds = (*self._temporary_worlds, described)
            return report

        patience = self.timeout_s + 0.02 * (len(described.bodies) + len(described.joints))
        return self.run_on_engine(
            spawn, label="spawn", timeout_s=patience if timeout_s is None else timeout_s, edits=True
        )

    def snapshot(self) -> World:
        """The world as it is now, as a description."""
        return self.run_on_engine(lambda engine: engine.snapshot(), label="log")

    def current_state(self) -> WorldState:
        """The place as it is now, for questions that look at it."""

        def take(engine: Engine) -> WorldState:
            joints = engine.joint_positions() if Capability.JOINTS in engine.capabilities else None
            return WorldState(world=engine.snapshot(), spawned=self.worlds, joint_positions=joints, source=engine.name)

        return self.run_on_engine(take, label="moment")

    def reset(self) -> None:
        """Brings back the world as it was right after it was spawned; what is lit stays lit."""

        def reset(engine: Engine) -> None:
            self._perturbations.clear()
            self._error = ""
            if self._initial_state is not None:
                engine.restore_state(self._initial_state)
            else:
                engine.clear()
                for world in self._worlds:
                    engine.spawn(world, geometry=self._geometry_provider.for_world(world))
            self._highlights.reapply(engine)

        self.run_on_engine(reset, label="reset", edits=True, timeout_s=self.timeout_s * 3)

    def clear(self) -> None:
        """Removes everything."""

        def clear(engine: Engine) -> None:
            engine.clear()
            self._worlds, self._temporary_worlds, self._reports, self._initial_state = (), (), (), None
            self._geometry_provider.clear()
            self._perturbations.clear()

        self.run_on_engine(clear, label="clear", edits=True)
        self.editing.clear()

    def set_knowledge(self, knowledge: KnowledgeBase) -> None:
        """Removes everything; from now on the stage knows something else."""
        self.clear()
        self.knowledge = knowledge
        self._geometry_provider.set_knowledge(knowledge)

    @property
    def engine_error(self) -> EngineError | None:
        """Why the engine could not be asked when it last was; None while it answers."""
        return self._engine_error

    def ping(self, *, timeout_s: float | None = None) -> float:
        """Asks the engine for a sign of life, and gives how long that took [s].

        Raises:
            EngineError: it is lost.
            SimulationTimeoutError: it is at something else that long, or hangs.
        """
        start = time.perf_counter()
        self.run_on_engine(lambda engine: engine.time_s, label="ping", timeout_s=timeout_s)
        return time.perf_counter() - start

    def run_on_engine(
        self, function: Callable[[Engine], T], *, label: str = "", timeout_s: float | None = None, edits: bool = False
    ) -> T:
        """Runs any function on the engine in the stage's thread: `stage.call(lambda engine: engine.save())`.

        Args:
            function: gets the engine; it must not keep it.
            what: names the call in errors.
            timeout_s: instead of the stage's own.
            edits: whether bodies, materials or lights may have changed, so that watchers look again.

        Raises:
            SimulationTimeoutError: the call did not finish in time.
            SimulationError: the stage is closed.
        """
        if self._closed:
            raise SimulationError("the stage is closed; make a new one")

        def run() -> T:
            try:
                return function(self._engine)
            finally:
                self._publish(edits=edits)

        name = label or getattr(function, "__name__", "the call")
        return self._thread.run(run, label=name, timeout_s=self.timeout_s if timeout_s is None else timeout_s)

    # -- questions -----------------------------------------------------------------------------------------

    @overload
    def ask(self, question: Question[R], **args: object) -> Answers[R]: ...
    @overload
    def ask(self, question: str, **args: object) -> Answers[Any]: ...
    def ask(self, question: Question[Any] | str, **args: object) -> Answers[Any]:
        """All answers, for the place as it is now; see `KnowledgeBase.ask`.

        The engine is only asked by questions that look at the present, and once by each.
        """
        asked = get_question(question) if isinstance(question, str) else question
        return asked.ask(self.knowledge, args, present=StateAccess(self.knowledge, self.current_state))

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
        the same label replaces what was highlighted with it before. An IRI, or an answer, that has no body here is
        listed in the result with the reason.

        Args:
            shown: a body's id or IRI, an answer, several of these, or all answers to a question. Of answers it is what
                was asked for: the handle of a door that was given.
            color: a name ("green"), "#rrggbb", or red, green and blue from 0 to 1; None or "none" removes the
                highlight.
            label: the reason, in one line; of `Answers` by default the question.
            replace: whether all other highlights are removed first.
            missing_ok: whether an id that is not there is listed in the result, as an IRI is, instead of raising.

        Returns:
            What is highlighted, and what has no body, with the reason.

        Raises:
            BodyNotFoundError: for the first id that is not there, unless `missing_ok`; nothing changes then.
            InvalidColorError: the color is none.
        """
        wish = highlight_request(shown, label)
        rgb = color_from(color)
        light = partial(self._highlights.apply, request=wish, color=rgb, replace=replace, strict=not missing_ok)
        return self.run_on_engine(light, label="highlight", edits=True)

    def clear_highlights(self) -> None:
        """Puts out everything that is lit."""
        self.run_on_engine(
            lambda engine: engine.highlight(tuple(engine.highlights()), None), label="put out", edits=True
        )

    def add_markers(self, markers: Iterable[Marker], *, lifetime_s: float | None = None) -> None:
        """Shows markers, in the place of those of the same ids, for so long [s] or until they are taken away."""
        shown = tuple(markers)
        self.run_on_engine(lambda _: self._markers.add(shown, lifetime_s=lifetime_s), label="mark")

    def remove_markers(self, ids: Iterable[str]) -> tuple[str, ...]:
        """Takes markers away; gives the ids of those that were there."""
        wanted = tuple(ids)
        return self.run_on_engine(lambda _: self._markers.remove(wanted), label="unmark")

    # -- time ----------------------------------------------------------------------------------------------

    def step(self, duration_s: float, *, progress: Callable[[float], None] | None = None) -> None:
        """Lets simulated time pass as fast as the engine can; other calls get their turn in between.

        Args:
            duration_s: how long [s].
            progress: told after each piece how much has passed [s].
        """
        done = 0.0
        while done < duration_s:
            piece = min(_STEP_CHUNK_S, duration_s - done)
            self.run_on_engine(partial(self._advance, piece), label="step", timeout_s=self.timeout_s * 6)
            done = done + piece if duration_s - done > _STEP_CHUNK_S else duration_s
            if progress is not None:
                progress(done)

    def play(self, *, speed: float = 1.0) -> None:
        """Lets time pass by itself, at a multiple of real time."""
        if not speed > 0:
            raise ValueError(f"speed must be above 0, not {speed}")
        self._error, self._clock = "", RealTimeClock(speed)
        self.run_on_engine(lambda engine: None, label="play")

    def pause(self) -> None:
        """Stops time; edits and single steps go on working."""
        self._clock = None
        self.run_on_engine(lambda engine: None, label="pause")

    # -- things ----------------------------------------------------------------------------------------------

    def make_body(self, cls: str, *, id: str | None = None, size: Vector | None = None) -> Body:
        """A thing of a class that could be put somewhere; of its usual size, unless another is given [m].

        Raises:
            NameNotFoundError: there is no such class.
            InvalidArgumentError: nobody knows how large things of that class are.
        """
        return make_body(self, cls, id=id, size=size)

    def place(self, item: Body | str, *, on: str | None = None, into: str | None = None) -> PlacementResult:
        """Puts a new thing on something, or into it, on a free spot on which it stays.

        Args:
            thing: what; the name of a class for a thing of that class.
            on: the id of what it shall stand on; or
            into: the id of what it shall be in, or in a part or drawer of.

        Raises:
            BodyNotFoundError: there is no such holder.
            NoFreePlacementError: nothing there is free, large enough and level, or the thing does not stay.
            NameNotFoundError, InvalidArgumentError: as for `thing`; or it is not told where it goes.
        """
        if (on is None) is (into is None):
            raise InvalidArgumentError("put", cause="it goes on something or into it", remedy="give one of on and into")
        body = item if isinstance(item, Body) else self.make_body(item)
        form = self._geometry_provider.fit(World(iri=body.iri, bodies=(body,))).geometry.get(body.id)
        return place_body(self, body, form, support_id=on or into or "", inside=into is not None)

    def joint(self, id: str) -> SimulationJoint:
        """A joint that can be opened, closed and moved: `sim.joint("fridge_door").open()`.

        Args:
            id: the id or IRI of a joint, or of the door, drawer or other body that it moves.

        Raises:
            NameNotFoundError: nothing movable has that name.
            AmbiguousNameError: several joints move that body.
        """
        return find_joint(self, id)

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        format: FileFormat | str | None = None,
        dialect: FileDialect | str | None = None,
        assets: str | os.PathLike[str] | Iterable[str | os.PathLike[str]] = (),
        plain_shapes: bool = False,
    ) -> tuple[str, ...]:
        """Writes the world as it is now to a file; the suffix determines the format (see `mindstage.save`).

        Returns:
            Notes, one sentence each, on what the file cannot hold.

        Raises:
            MapWriteError: no format has this suffix, the world holds something that the format cannot, or the file
                cannot be written.
        """
        from mindstage.saving import save_world

        return save_world(
            self.snapshot(),
            path,
            knowledge=self.knowledge,
            format=format,
            dialect=dialect,
            assets=assets,
            plain_shapes=plain_shapes,
        )

    # -- hands ---------------------------------------------------------------------------------------------

    def pull(self, id: BodyId, *, point: Vector, target: Vector) -> None:
        """Pulls a point of a body towards a place until `release`; call again to move the place.

        Args:
            id: the body.
            point: where it is held, in the body's frame [m].
            target: where that point shall go, in the world [m].
        """
        self._perturbations.pull(id, point=point, target=target, worlds=self.worlds)

    def release(self, id: BodyId | None = None) -> None:
        """Lets go of one body, or of all."""
        self._perturbations.release(id)

    # -- the end -------------------------------------------------------------------------------------------

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._closed

    def on_close(self, callback: Callable[[], None]) -> None:
        """Registers a function that `close` calls first, the latest one before the others."""
        self._at_close.callback(callback)

    def close(self) -> None:
        """Ends the loop and the engine; any number of times."""
        if self._closed:
            return
        try:
            self._at_close.close()
        finally:
            self._closed = True
            self._clock = None
            self._thread.stop()
            self._engine.close()
            self._engine_error = EngineClosedError(self._engine.name)

    def __repr__(self) -> str:
        frame = self._state
        maps = "".join(f" {world.name or short_name(world.iri)}" for world in self.worlds)
        state = "closed" if self._closed else "playing" if frame.playing else "paused"
        bodies = counted(len(frame.ids), "body")
        return f"<{type(self).__name__}{maps}: {bodies}, {self.engine_name}, {state} at {frame.time_s:.2f} s>"

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- inside the thread ---------------------------------------------------------------------------------

    def _tick(self) -> float | None:
        clock = self._clock
        if clock is None:
            return self._expire_markers()
        owed = clock.due_s()
        if owed > 0.0:
            self._markers.expire()
            try:
                self._advance(owed)
            except EngineError as error:
                self._error, self._clock = str(error), None
            clock.advance(owed)
            self._publish_if_possible()
        return _TICK_S if self._clock is not None else None

    def _expire_markers(self) -> float | None:
        if self._markers.expire():
            self._publish_if_possible()
        return self._markers.next_expiry_s()

    def _advance(self, duration_s: float, _: Engine | None = None) -> None:
        self._perturbations.step(self._engine, duration_s)

    def _save_initial_state(self, engine: Engine) -> None:
        self._initial_state = engine.save_state() if Capability.SAVE in engine.capabilities else None

    def _publish(self, *, edits: bool = False) -> None:
        self._revision += edits
        try:
            self._state, self._engine_error = self._read_state(), None
        except EngineError as error:
            self._engine_error, self._clock, self._error = error, None, str(error)
            self._state = msgspec.structs.replace(self._state, playing=False, error=self._error)
            raise
        if edits:
            self.clients.notify_edit()

    def _publish_if_possible(self) -> None:
        with suppress(EngineError):  # the frame and `lost` tell of it
            self._publish()

    def _read_state(self) -> StateSnapshot:
        ids, poses = self._engine.poses()
        clock, highlights = self._clock, self._engine.highlights()
        return StateSnapshot(
            time_s=self._engine.time_s,
            ids=ids,
            poses=poses,
            highlights=highlights,
            highlight_groups=self._highlights.sync(highlights),
            markers=self._markers.markers,
            revision=self._revision,
            playing=clock is not None,
            speed=clock.speed if clock else 1.0,
            real_time_factor=clock.real_time_factor if clock else 0.0,
            stats=self._engine.stats() if Capability.STATISTICS in self._engine.capabilities else None,
            error=self._error,
        )
