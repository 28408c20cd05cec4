"""Stage: one knowledge base, one engine, one loop.

Everything that touches the engine goes through here and runs in the stage's own thread. Any thread may call; a call
takes its turn, has a timeout, and raises what the engine raised. What many watch (poses, lights, time) is published
as a `Frame` after each tick, which costs the watchers nothing and the world next to nothing.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import msgspec

from mindstage.engines.contract import Ability, Engine, SpawnReport, State
from mindstage.errors import ArgumentRefused, EngineClosed, EngineError, StageError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.moment import Moment
from mindstage.knowledge.questions import Row
from mindstage.stage.clock import Clock
from mindstage.stage.company import Company
from mindstage.stage.editing import Editing
from mindstage.stage.embodiment import Embodiment, told_of
from mindstage.stage.frame import Frame
from mindstage.stage.grip import Grips
from mindstage.stage.joint_motion import SimulationJoint, find_joint
from mindstage.stage.lights import Lights
from mindstage.stage.loop import Loop
from mindstage.stage.markers import Markers
from mindstage.stage.putting import Put, put, thing_of
from mindstage.stage.showing import Showing
from mindstage.world import Body, BodyId, Forms, Vector, World
from mindstage.world.display import counted, short_name

if TYPE_CHECKING:
    from mindstage.saving import FileDialect, FileFormat
    from mindstage.shapes.fitting import MeshSource

__all__ = ["Frame", "Stage"]

T = TypeVar("T")
R = TypeVar("R", bound=Row)

_TICK_S = 1 / 60
"""How often a playing world is brought up to date; a drag feels smooth at this rate."""
_STEP_CHUNK_S = 0.1
"""Long steps are cut into pieces of this simulated length, so that other calls get their turn."""


class Stage(Showing):
    """Spawns what the knowledge base knows into an engine, and lets it live."""

    def __init__(
        self,
        knowledge: KnowledgeBase,
        engine: Engine,
        *,
        timeout_s: float = 10.0,
        shapes: bool = True,
        meshes: MeshSource | None = None,
    ) -> None:
        """Takes over the engine; from now on only the stage may call it.

        Args:
            knowledge: what is known.
            engine: who runs it; closed together with the stage.
            timeout_s: how long a call may take before `StageTimedOut`.
            shapes: whether bodies get the forms that are known of their classes; else they are plain.
            meshes: who finds the mesh files of bodies, which come before what is known.
        """
        self.knowledge = knowledge
        self.timeout_s = timeout_s
        self.company = Company()
        self.editing = Editing(self)
        self._engine = engine
        self._embodiment = Embodiment(knowledge, shapes=shapes, meshes=meshes)
        self._edition = 0
        self._worlds: tuple[World, ...] = ()
        self._passing: tuple[World, ...] = ()
        self._reports: tuple[SpawnReport, ...] = ()
        self._spawned: State | None = None
        self._clock: Clock | None = None
        self._grips = Grips()
        self._lights = Lights()
        self._markers = Markers()
        self._fault = ""
        self._lost: EngineError | None = None
        self._closed = False
        self._at_close = ExitStack()
        self._frame = self._take_frame()
        self._loop = Loop(self._tick)

    # -- the world -----------------------------------------------------------------------------------------

    @property
    def engine_name(self) -> str:
        """Which engine runs the world."""
        return self._engine.name

    @property
    def abilities(self) -> frozenset[Ability]:
        """What the engine can do beyond the contract."""
        return self._engine.abilities

    @property
    def worlds(self) -> tuple[World, ...]:
        """What was spawned, as it was given."""
        return (*self._worlds, *self._passing)

    @property
    def reports(self) -> tuple[SpawnReport, ...]:
        """What became of each of the worlds when it was spawned."""
        return self._reports

    @property
    def frame(self) -> Frame:
        """The world as last published; reading it never waits."""
        return self._frame

    @property
    def forms(self) -> Forms:
        """What the bodies that are there are made of."""
        return self._embodiment.of(self._frame.ids)

    def spawn(
        self,
        world: World | str | None = None,
        *,
        forms: Forms | None = None,
        lasting: bool = True,
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
        fitted = self._embodiment.fit(described, given=forms)

        def spawn(engine: Engine) -> SpawnReport:
            spawned = engine.spawn(described, forms=fitted.forms)
            report = told_of(spawned, fitted, engine.poses()[0])
            self._embodiment.add(fitted.forms, failed=spawned.failed_bodies)
            self._reports = (*self._reports, report)
            if lasting:
                self._worlds = (*self._worlds, described)
                self._remember(engine)
            else:
                self._passing = (*self._passing, described)
            return report

        patience = self.timeout_s + 0.02 * (len(described.bodies) + len(described.constraints))
        return self.call(spawn, what="spawn", timeout_s=patience if timeout_s is None else timeout_s, edits=True)

    def log(self) -> World:
        """The world as it is now, as a description."""
        return self.call(lambda engine: engine.log(), what="log")

    def moment(self) -> Moment:
        """The place as it is now, for questions that look at it."""

        def take(engine: Engine) -> Moment:
            joints = engine.joint_positions() if Ability.JOINTS in engine.abilities else None
            return Moment(world=engine.log(), told=self.worlds, joints=joints, source=engine.name)

        return self.call(take, what="moment")

    def reset(self) -> None:
        """Brings back the world as it was right after it was spawned; what is lit stays lit."""

        def reset(engine: Engine) -> None:
            self._grips.clear()
            self._fault = ""
            if self._spawned is not None:
                engine.restore(self._spawned)
            else:
                engine.clear()
                for world in self._worlds:
                    engine.spawn(world, forms=self._embodiment.all_of(world))
            self._lights.renew(engine)

        self.call(reset, what="reset", edits=True, timeout_s=self.timeout_s * 3)

    def clear(self) -> None:
        """Removes everything."""

        def clear(engine: Engine) -> None:
            engine.clear()
            self._worlds, self._passing, self._reports, self._spawned = (), (), (), None
            self._embodiment.clear()
            self._grips.clear()

        self.call(clear, what="clear", edits=True)
        self.editing.forget()

    def learn(self, knowledge: KnowledgeBase) -> None:
        """Removes everything; from now on the stage knows something else."""
        self.clear()
        self.knowledge = knowledge
        self._embodiment.learn(knowledge)

    @property
    def lost(self) -> EngineError | None:
        """Why the engine could not be asked when it last was; None while it answers."""
        return self._lost

    def ping(self, *, timeout_s: float | None = None) -> float:
        """Asks the engine for a sign of life, and gives how long that took [s].

        Raises:
            EngineError: it is lost.
            StageTimedOut: it is at something else that long, or hangs.
        """
        start = time.perf_counter()
        self.call(lambda engine: engine.time_s, what="ping", timeout_s=timeout_s)
        return time.perf_counter() - start

    def call(
        self, function: Callable[[Engine], T], *, what: str = "", timeout_s: float | None = None, edits: bool = False
    ) -> T:
        """Runs any function on the engine in the stage's thread: `stage.call(lambda engine: engine.save())`.

        Args:
            function: gets the engine; it must not keep it.
            what: names the call in errors.
            timeout_s: instead of the stage's own.
            edits: whether bodies, materials or lights may have changed, so that watchers look again.

        Raises:
            StageTimedOut: the call did not finish in time.
            StageError: the stage is closed.
        """
        if self._closed:
            raise StageError("the stage is closed; make a new one")

        def run() -> T:
            try:
                return function(self._engine)
            finally:
                self._publish(edits=edits)

        name = what or getattr(function, "__name__", "the call")
        return self._loop.call(run, what=name, timeout_s=self.timeout_s if timeout_s is None else timeout_s)

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
            self.call(partial(self._advance, piece), what="step", timeout_s=self.timeout_s * 6)
            done = done + piece if duration_s - done > _STEP_CHUNK_S else duration_s
            if progress is not None:
                progress(done)

    def play(self, *, speed: float = 1.0) -> None:
        """Lets time pass by itself, at a multiple of real time."""
        if not speed > 0:
            raise ValueError(f"speed must be above 0, not {speed}")
        self._fault, self._clock = "", Clock(speed)
        self.call(lambda engine: None, what="play")

    def pause(self) -> None:
        """Stops time; edits and single steps go on working."""
        self._clock = None
        self.call(lambda engine: None, what="pause")

    # -- things ----------------------------------------------------------------------------------------------

    def thing(self, cls: str, *, id: str | None = None, size: Vector | None = None) -> Body:
        """A thing of a class that could be put somewhere; of its usual size, unless another is given [m].

        Raises:
            NameUnknown: there is no such class.
            ArgumentRefused: nobody knows how large things of that class are.
        """
        return thing_of(self, cls, id=id, size=size)

    def put(self, thing: Body | str, *, on: str | None = None, into: str | None = None) -> Put:
        """Puts a new thing on something, or into it, on a free spot on which it stays.

        Args:
            thing: what; the name of a class for a thing of that class.
            on: the id of what it shall stand on; or
            into: the id of what it shall be in, or in a part or drawer of.

        Raises:
            BodyUnknown: there is no such holder.
            SpotMissing: nothing there is free, large enough and level, or the thing does not stay.
            NameUnknown, ArgumentRefused: as for `thing`; or it is not told where it goes.
        """
        if (on is None) is (into is None):
            raise ArgumentRefused("put", cause="it goes on something or into it", remedy="give one of on and into")
        body = thing if isinstance(thing, Body) else self.thing(thing)
        form = self._embodiment.fit(World(iri=body.iri, bodies=(body,))).forms.get(body.id)
        return put(self, body, form, where=on or into or "", inside=into is not None)

    def joint(self, id: str) -> SimulationJoint:
        """A joint that can be opened, closed and moved: `sim.joint("fridge_door").open()`.

        Args:
            id: the id or IRI of a joint, or of the door, drawer or other body that it moves.

        Raises:
            NameUnknown: nothing movable has that name.
            NameAmbiguous: several joints move that body.
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
            MapUnwritable: no format has this suffix, the world holds something that the format cannot, or the file
                cannot be written.
        """
        from mindstage.saving import save_world

        return save_world(
            self.log(),
            path,
            knowledge=self.knowledge,
            format=format,
            dialect=dialect,
            assets=assets,
            plain_shapes=plain_shapes,
        )

    # -- hands ---------------------------------------------------------------------------------------------

    def grip(self, id: BodyId, *, point: Vector, target: Vector) -> None:
        """Pulls a point of a body towards a place until `release`; call again to move the place.

        Args:
            id: the body.
            point: where it is held, in the body's frame [m].
            target: where that point shall go, in the world [m].
        """
        self._grips.hold(id, point=point, target=target, worlds=self.worlds)

    def release(self, id: BodyId | None = None) -> None:
        """Lets go of one body, or of all."""
        self._grips.let_go(id)

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
            self._loop.stop()
            self._engine.close()
            self._lost = EngineClosed(self._engine.name)

    def __repr__(self) -> str:
        frame = self._frame
        maps = "".join(f" {world.name or short_name(world.iri)}" for world in self.worlds)
        state = "closed" if self._closed else "playing" if frame.playing else "paused"
        bodies = counted(len(frame.ids), "body")
        return f"<{type(self).__name__}{maps}: {bodies}, {self.engine_name}, {state} at {frame.time_s:.2f} s>"

    def __enter__(self) -> Stage:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- inside the thread ---------------------------------------------------------------------------------

    def _tick(self) -> float | None:
        clock = self._clock
        if clock is None:
            return self._expire_markers()
        owed = clock.owed_s()
        if owed > 0.0:
            self._markers.expire()
            try:
                self._advance(owed)
            except EngineError as error:
                self._fault, self._clock = str(error), None
            clock.paid(owed)
            self._publish_if_possible()
        return _TICK_S if self._clock is not None else None

    def _expire_markers(self) -> float | None:
        if self._markers.expire():
            self._publish_if_possible()
        return self._markers.due_s()

    def _advance(self, duration_s: float, _: Engine | None = None) -> None:
        self._grips.step(self._engine, duration_s)

    def _remember(self, engine: Engine) -> None:
        self._spawned = engine.save() if Ability.SAVE in engine.abilities else None

    def _publish(self, *, edits: bool = False) -> None:
        self._edition += edits
        try:
            self._frame, self._lost = self._take_frame(), None
        except EngineError as error:
            self._lost, self._clock, self._fault = error, None, str(error)
            self._frame = msgspec.structs.replace(self._frame, playing=False, fault=self._fault)
            raise
        if edits:
            self.company.tell_of_edit()

    def _publish_if_possible(self) -> None:
        with suppress(EngineError):  # the frame and `lost` tell of it
            self._publish()

    def _take_frame(self) -> Frame:
        ids, poses = self._engine.poses()
        clock, highlights = self._clock, self._engine.highlights()
        return Frame(
            time_s=self._engine.time_s,
            ids=ids,
            poses=poses,
            highlights=highlights,
            lit=self._lights.follow(highlights),
            markers=self._markers.all,
            edition=self._edition,
            playing=clock is not None,
            speed=clock.speed if clock else 1.0,
            real_time_factor=clock.real_time_factor if clock else 0.0,
            statistics=self._engine.statistics() if Ability.STATISTICS in self._engine.abilities else None,
            fault=self._fault,
        )
