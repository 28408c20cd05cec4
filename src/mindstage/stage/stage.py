"""Stage: one knowledge base, one engine, one loop.

Everything that touches the engine goes through here and runs in the stage's own thread. Any thread may call; a call
takes its turn, has a timeout, and raises what the engine raised. What many watch (poses, lights, time) is published
as a `Frame` after each tick, which costs the watchers nothing and the world next to nothing.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from typing import Any, TypeVar, overload

import msgspec

from mindstage.engines.contract import Ability, Engine, SpawnReport, State
from mindstage.errors import EngineClosed, EngineError, StageError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.moment import Moment, Present
from mindstage.knowledge.questions import Answers, Question, Row, question_named
from mindstage.stage.clock import Clock
from mindstage.stage.frame import Frame
from mindstage.stage.grip import GRIP_PIECE_S, Grip, mass_moved_with
from mindstage.stage.lights import Lights, Shown, wish_of
from mindstage.stage.loop import Loop
from mindstage.stage.markers import Marker, Markers
from mindstage.world import BodyId, Colour, Vector, World

__all__ = ["Frame", "Stage"]

T = TypeVar("T")
R = TypeVar("R", bound=Row)

_TICK_S = 1 / 60
"""How often a playing world is brought up to date; a drag feels smooth at this rate."""
_STEP_CHUNK_S = 0.1
"""Long steps are cut into pieces of this simulated length, so that other calls get their turn."""


class Stage:
    """Spawns what the knowledge base knows into an engine, and lets it live."""

    def __init__(self, knowledge: KnowledgeBase, engine: Engine, *, timeout_s: float = 10.0) -> None:
        """Takes over the engine; from now on only the stage may call it.

        Args:
            knowledge: what is known.
            engine: who runs it; closed together with the stage.
            timeout_s: how long a call may take before `StageTimedOut`.
        """
        self.knowledge = knowledge
        self.timeout_s = timeout_s
        self._engine = engine
        self._edition = 0
        self._worlds: tuple[World, ...] = ()
        self._reports: tuple[SpawnReport, ...] = ()
        self._spawned: State | None = None
        self._clock: Clock | None = None
        self._grips: dict[BodyId, Grip] = {}
        self._lights = Lights()
        self._markers = Markers()
        self._fault = ""
        self._lost: EngineError | None = None
        self._closed = False
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
        return self._worlds

    @property
    def reports(self) -> tuple[SpawnReport, ...]:
        """What became of each of the worlds when it was spawned."""
        return self._reports

    @property
    def frame(self) -> Frame:
        """The world as last published; reading it never waits."""
        return self._frame

    def spawn(self, world: World | str | None = None, *, timeout_s: float | None = None) -> SpawnReport:
        """Spawns a world, or the map of that name, or the only map that is known.

        The timeout grows with the world: 20 ms a body on top of the stage's own, unless given.
        """
        described = world if isinstance(world, World) else self.knowledge.world(world)

        def spawn(engine: Engine) -> SpawnReport:
            report = engine.spawn(described)
            self._worlds, self._reports = (*self._worlds, described), (*self._reports, report)
            self._remember(engine)
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
            return Moment(world=engine.log(), told=self._worlds, joints=joints, source=engine.name)

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
                    engine.spawn(world)
            self._lights.renew(engine)

        self.call(reset, what="reset", edits=True, timeout_s=self.timeout_s * 3)

    def clear(self) -> None:
        """Removes everything."""

        def clear(engine: Engine) -> None:
            engine.clear()
            self._worlds, self._reports, self._spawned = (), (), None
            self._grips.clear()

        self.call(clear, what="clear", edits=True)

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
                self._edition += edits
                self._publish()

        name = what or getattr(function, "__name__", "the call")
        return self._loop.call(run, what=name, timeout_s=self.timeout_s if timeout_s is None else timeout_s)

    # -- questions -----------------------------------------------------------------------------------------

    @overload
    def ask(self, question: Question[R], **args: object) -> Answers[R]: ...
    @overload
    def ask(self, question: str, **args: object) -> Answers[Any]: ...
    def ask(self, question: Question[Any] | str, **args: object) -> Answers[Any]:
        """All answers, for the place as it is now; see `KnowledgeBase.ask`.

        The engine is only asked by questions that look at the present, and once by each.
        """
        asked = question_named(question) if isinstance(question, str) else question
        return asked.ask(self.knowledge, args, present=Present(self.knowledge, self.moment))

    def show(
        self,
        shown: Answers[Any] | Iterable[str],
        colour: Colour | None,
        *,
        label: str = "",
        replace: bool = False,
    ) -> Shown:
        """Lights up what a question was answered with, and remembers why.

        It adds to what is lit already; a body that is shown twice has the later colour, and showing something again
        for the same reason replaces what that lit before.

        Args:
            shown: answers, or ids or IRIs. Of answers it is what was asked for: the handle of a door that was given.
            colour: how to light it; None puts it out.
            label: the reason, in one line; by default the question.
            replace: whether all else goes out first.

        Returns:
            What is lit, and what has no body, with the reason.
        """
        wish = wish_of(shown, label)
        light = partial(self._lights.show, wish=wish, colour=colour, replace=replace)
        return self.call(light, what="show", edits=True)

    def highlight(self, ids: Iterable[BodyId], colour: Colour | None) -> None:
        """Lights bodies up, or puts them out (None); `show` also says why.

        Raises:
            BodyUnknown: for the first id that is not there; nothing changes then.
        """
        lit = tuple(ids)
        self.call(lambda engine: engine.highlight(lit, colour), what="highlight", edits=True)

    def put_out(self) -> None:
        """Puts out everything that is lit."""
        self.call(lambda engine: engine.highlight(tuple(engine.highlights()), None), what="put out", edits=True)

    def mark(self, markers: Iterable[Marker], *, lifetime_s: float | None = None) -> None:
        """Shows markers, in the place of those of the same ids, for so long [s] or until they are taken away."""
        shown = tuple(markers)
        self.call(lambda _: self._markers.show(shown, lifetime_s=lifetime_s), what="mark")

    def unmark(self, ids: Iterable[str]) -> tuple[str, ...]:
        """Takes markers away; gives the ids of those that were there."""
        wanted = tuple(ids)
        return self.call(lambda _: self._markers.remove(wanted), what="unmark")

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
        self._fault = ""
        self._clock = Clock(speed)
        self.call(lambda engine: None, what="play")

    def pause(self) -> None:
        """Stops time; edits and single steps go on working."""
        self._clock = None
        self.call(lambda engine: None, what="pause")

    # -- hands ---------------------------------------------------------------------------------------------

    def grip(self, id: BodyId, *, point: Vector, target: Vector) -> None:
        """Pulls a point of a body towards a place until `release`; call again to move the place.

        Args:
            id: the body.
            point: where it is held, in the body's frame [m].
            target: where that point shall go, in the world [m].
        """
        held = self._grips.get(id)
        if held is None or held.point != point:
            self._grips[id] = Grip(id=id, point=point, target=target, mass_kg=mass_moved_with(id, self._worlds))
        else:
            held.target = target

    def release(self, id: BodyId | None = None) -> None:
        """Lets go of one body, or of all."""
        if id is None:
            self._grips.clear()
        else:
            self._grips.pop(id, None)

    # -- the end -------------------------------------------------------------------------------------------

    def close(self) -> None:
        """Ends the loop and the engine; any number of times."""
        if self._closed:
            return
        self._closed = True
        self._clock = None
        self._loop.stop()
        self._engine.close()
        self._lost = EngineClosed(self._engine.name)

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
        left_s = duration_s
        while self._grips and left_s > GRIP_PIECE_S:
            self._pull(GRIP_PIECE_S)
            self._engine.step(GRIP_PIECE_S)
            left_s -= GRIP_PIECE_S
        self._engine.step(left_s)

    def _pull(self, duration_s: float) -> None:
        ids, poses = self._engine.poses()
        rows = {id: row for row, id in enumerate(ids) if id in self._grips}
        for id, grip in list(self._grips.items()):
            if id in rows:
                self._engine.push(id, *grip.force(poses[rows[id]], duration_s))

    def _remember(self, engine: Engine) -> None:
        self._spawned = engine.save() if Ability.SAVE in engine.abilities else None

    def _publish(self) -> None:
        try:
            self._frame, self._lost = self._take_frame(), None
        except EngineError as error:
            self._lost, self._clock, self._fault = error, None, str(error)
            self._frame = msgspec.structs.replace(self._frame, playing=False, fault=self._fault)
            raise

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
            fault=self._fault,
        )
