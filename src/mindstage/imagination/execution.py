"""Executes a plan in a copy of a simulation: one sample, with its random numbers, events and outcome.

The random numbers of a sample depend on the seed and the index of the sample only, so that it can be repeated alone, in
any process. They are drawn in the order of the bodies for the start, and then in the order of the steps.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import partial
from itertools import takewhile
from math import cos, sin
from typing import Any, NoReturn, Protocol, TypeAlias, TypeVar, cast

import msgspec
import numpy as np
from msgspec.structs import replace

from mindstage.engines.base import Capability, DynamicsScale, Engine, PoseArray
from mindstage.errors import (
    EngineError,
    InvalidArgumentError,
    KnowledgeError,
    MindstageError,
    NoFreePlacementError,
    PlanError,
    RobotError,
    SimulationError,
    WorldError,
    suggestion,
)
from mindstage.imagination.guesses import Guess, Guesses, GuessKind
from mindstage.imagination.plan_files import PlanFile, PlanLike, load_plan
from mindstage.imagination.plans import (
    MAX_DEVIATION,
    ChangePhysics,
    Check,
    Close,
    Move,
    Open,
    Perform,
    Place,
    Plan,
    PlanStep,
    Pull,
    Push,
    Uncertainty,
    Wait,
)
from mindstage.imagination.results import EventKind, ImaginedEvent, Outcome, SampleResult
from mindstage.imagination.watch import MAX_CORRECTION_M, EventWatch, WatchBasis
from mindstage.knowledge.names import EntityType
from mindstage.ranges import Index, Seed, checked
from mindstage.rdf.graphs import local_name
from mindstage.robots import find_robot
from mindstage.robots.robot import Robot
from mindstage.robots.skill_declaration import ParameterType, SkillOutcome, SkillResult, SkillStep
from mindstage.scene import BodyId, Iri, Pose, Vector, as_pose
from mindstage.scene.edits import Attach, Detach, Edit, SetPhysics, SetPoses
from mindstage.scene.transforms import (
    Array,
    normalize,
    pose_from_array,
    pose_inverse,
    pose_multiply,
    quat_multiply,
    quat_rotate,
)
from mindstage.simulation import Simulation
from mindstage.simulation.joint_motion import find_joint
from mindstage.simulation.placement import PlacementResult
from mindstage.simulation.state import EngineSession, WorldSession, find_body

__all__ = [
    "PlanRunner",
    "RunningSample",
    "SampleSession",
    "SampleStoppedError",
    "is_stopped",
    "is_uncertain",
    "named_bodies",
    "run_plan",
    "stopping",
    "validate_plan",
]

T = TypeVar("T")

_CHUNK_S = 0.1
"""Simulated time between two looks at the world [s]."""
_FORCE_CHUNK_S = 0.02
"""A force is applied anew after this time, since the point where it acts moves along [s]."""
_ARRIVED_M = 0.01
"""A pulled point arrived if it is as near to its target [m]."""
_INTEGRAL_GAIN, _MAX_LEAD_M = 0.15, 0.5
"""A pull leads by this part of the error in each chunk, up to this distance [m], against weight and friction."""
_REST_M = 4e-4
"""Bodies that move by less in `_CHUNK_S` are at rest [m]."""
_REST_CHUNKS = 3
_MAX_SETTLE_S = 5.0
"""Without a condition, a plan ends after this time although something still moves [s]."""
_NAME_FIELDS = ("thing", "on", "into", "parent", "child")
_MIN_FACTOR = 0.05
"""The smallest factor of a mass or friction; smaller random ones are replaced by it."""


def never() -> bool:
    """Does not stop."""
    return False


_STOP: ContextVar[Callable[[], bool]] = ContextVar("stop of imagination", default=never)


@contextmanager
def stopping(stop: Callable[[], bool]) -> Iterator[None]:
    """In the context, trials of questions that are asked, as of checks, end when `stop` returns true."""
    token = _STOP.set(stop)
    try:
        yield
    finally:
        _STOP.reset(token)


def is_stopped() -> bool:
    """Whether trials have to end; see `stopping`."""
    return _STOP.get()()


def is_uncertain(plan: PlanLike) -> bool:
    """Whether samples of a plan differ: a plan without uncertainty has one outcome only."""
    given = load_plan(plan).plan
    return given.guesses or any(
        np.any(each.position_m) or each.yaw_rad or each.mass or each.friction or each.joint_friction
        for each in given.stated
    )


@checked
def run_plan(
    simulation: Simulation,
    plan: PlanLike,
    *,
    index: Index = 0,
    seed: Seed = 0,
    stop: Callable[[], bool] = never,
    on_poses: Callable[[float, tuple[BodyId, ...], PoseArray], None] | None = None,
) -> SampleResult:
    """Executes a plan in a simulation, which changes it; see `PlanRunner` for many samples.

    Args:
        simulation: usually a copy, `sim.fork(threaded=False)`.
        plan: the plan; see `load_plan`.
        index: the number of the sample.
        seed: the seed of all samples.
        stop: asked at least every 0.1 s of simulated time; the outcome is unknown if it returns true.
        on_poses: called with the time since the start [s], the ids and the poses (n x 7), at least every 0.1 s.

    Raises:
        PlanError: the plan does not fit the world.
    """
    return PlanRunner(simulation, plan, seed=seed).run(simulation, index, stop=stop, on_poses=on_poses)


def validate_plan(plan: PlanLike, simulation: Simulation) -> None:
    """Checks that a plan fits a world, before anything runs.

    Args:
        simulation: the world, as it is before the first step.

    Raises:
        PlanError: a body, class, joint or question does not exist, or an argument is missing; with the line of a file.
    """
    _Validator(load_plan(plan), simulation).check()


def named_bodies(plan: Plan, simulation: WorldSession) -> frozenset[BodyId]:
    """The bodies that the steps of a plan name, and those that move on joints that they name."""
    values = [getattr(step, field) for step in plan.steps for field in _NAME_FIELDS if hasattr(step, field)]
    values += [value for step in plan.steps if isinstance(step, Perform) for value in step.args.values()]
    names = {
        name for each in values for name in (each if isinstance(each, tuple) else (each,)) if isinstance(name, str)
    }
    found = {find_body(simulation, name) for name in names}
    ends = {end for joint in simulation.snapshot().joints if joint.id in names for end in (joint.parent, joint.child)}
    return frozenset(id for id in found | ends if id is not None)


class SampleSession(WorldSession, Protocol):
    """The world of a sample, such as a `Simulation`; who has begun the sample steps it."""

    def place(
        self, item: list[str], *, on: str | None = None, into: str | None = None, room_for: Sequence[str] = ()
    ) -> tuple[PlacementResult, ...]:
        """See `Simulation.place`."""

    def ask(self, question: str, /, **args: Any) -> Iterable[Any]:
        """The answers to a question about the current state, as rows."""


class SampleStoppedError(Exception):
    """Thrown into a running sample to end it."""


RunningSample: TypeAlias = Generator[float, None, SampleResult]
"""See `PlanRunner.begin`."""
_SimulatedTime: TypeAlias = Generator[float, None, None]


class PlanRunner:
    """Executes one plan again and again, in simulations that begin in the same state."""

    @checked
    def __init__(
        self, simulation: Simulation, plan: PlanLike, *, seed: Seed = 0, fixed_guesses: Collection[Guess] = ()
    ) -> None:
        """Prepares what all samples have in common.

        Args:
            simulation: a simulation in the state in which all samples begin.
            seed: the seed of all samples.
            fixed_guesses: guesses that are kept at their value in a plan whose guesses vary.

        Raises:
            PlanError: the plan does not fit the world.
        """
        file = load_plan(plan)
        validate_plan(file, simulation)
        plan = file.plan
        self._plan, self._seed = plan, seed
        self._basis = WatchBasis.of(simulation)
        self._guesses = Guesses.of(simulation) if plan.guesses else Guesses()
        self._fixed_guesses = fixed_guesses
        self._uncertainty = _uncertainty_by_body(plan, simulation, self._basis)
        layout = self._basis.layout
        self._free = frozenset(layout.ids[row] for row in layout.free_rows.tolist())

    @checked
    def run(
        self,
        simulation: Simulation,
        index: Index,
        *,
        stop: Callable[[], bool] = never,
        on_poses: Callable[[float, tuple[BodyId, ...], PoseArray], None] | None = None,
    ) -> SampleResult:
        """Executes one sample in a simulation that is in the initial state; see `run_plan`."""
        return complete(self.begin(simulation, index, on_poses=on_poses), simulation.step, stop=stop)

    @property
    def uncertainty(self) -> Mapping[BodyId, Uncertainty]:
        """The uncertainty of each body that has any at the start."""
        return self._uncertainty

    @property
    def moved_at_start(self) -> tuple[BodyId, ...]:
        """The bodies that have another pose at the start of each sample."""
        return tuple(id for id, each in self._uncertainty.items() if id in self._free and _moves(each))

    @checked
    def begin(
        self,
        world: SampleSession,
        index: Index,
        *,
        on_poses: Callable[[float, tuple[BodyId, ...], PoseArray], None] | None = None,
        on_step: Callable[[SkillStep], object] | None = None,
    ) -> RunningSample:
        """Begins one sample in a world that is in the initial state, and that the caller steps.

        Args:
            index: the number of the sample.
            on_poses: see `run_plan`.
            on_step: called when a step of a skill begins, and when it ends.

        Returns:
            A generator of the times by which the caller has to step the world [s], at most 0.1 s each. It returns the
            result. If `SampleStoppedError` or an error of the engine is thrown into it, the outcome is unknown.
        """
        rng = np.random.default_rng([self._seed, index])
        sample = _Sample(world, self._plan, self._basis, self._uncertainty, self._free, rng, on_poses)
        sample.on_step = on_step
        sample.guessed = self._guesses.factors(self._seed, index, self._fixed_guesses)
        return sample.run(index)


def resume(sample: RunningSample, reason: Exception | None = None) -> float | SampleResult:
    """Continues a running sample, or throws the reason of its end into it; the next time [s], or its result."""
    try:
        return next(sample) if reason is None else sample.throw(reason)
    except StopIteration as end:
        result: SampleResult = end.value
        return result


def complete(
    sample: RunningSample, let_pass: Callable[[float], object], *, stop: Callable[[], bool] = never
) -> SampleResult:
    """Runs a sample from its begin to its end.

    Args:
        let_pass: lets simulated time pass [s], such as `simulation.step`.
        stop: asked before each time; true ends the sample, whose outcome is unknown then.
    """
    reason: Exception | None = None
    try:
        while True:
            duration_s = resume(sample, reason)
            if isinstance(duration_s, SampleResult):
                return duration_s
            reason = SampleStoppedError() if stop() else None
            if reason is None:
                try:
                    let_pass(duration_s)
                except (EngineError, SimulationError) as error:
                    reason = error
    finally:
        sample.close()  # after any other error: robots stop


# -- one sample --------------------------------------------------------------------------------------------------------


class _StepFailedError(Exception):
    """A step, or the plan, failed for the reason in an event."""

    def __init__(self, event: ImaginedEvent, *, is_known: bool = True) -> None:
        super().__init__(event.text)
        self.event = event
        self.is_known = is_known
        """Whether it certainly failed."""


class _Sample:
    def __init__(
        self,
        simulation: SampleSession,
        plan: Plan,
        basis: WatchBasis,
        uncertainty: Mapping[BodyId, Uncertainty],
        free: frozenset[BodyId],
        rng: np.random.Generator,
        on_poses: Callable[[float, tuple[BodyId, ...], PoseArray], None] | None,
    ) -> None:
        self.simulation, self.plan = simulation, plan
        self.uncertainty, self.free, self.rng = uncertainty, free, rng
        self.on_poses = on_poses
        self.watch = EventWatch(simulation, basis)
        self.named: set[BodyId] = set(uncertainty)
        self.limit_s = plan.time_limit_s
        self.answers: tuple[dict[str, object], ...] = ()
        self.skills: list[SkillResult] = []
        self.on_step: Callable[[SkillStep], object] | None = None
        self.guessed: Mapping[BodyId, Mapping[GuessKind, float]] = {}

    def run(self, index: int) -> RunningSample:
        outcome, cause, is_interrupted = Outcome.SUCCEEDED, None, False
        try:
            self._perturb_start()
            for number, step in enumerate(self.plan.steps):
                self.watch.step = number
                yield from self._execute(step)
            self.watch.step, self.limit_s = None, self.plan.time_limit_s
            yield from self._finish()
            self._ask_check()
        except _StepFailedError as failed:
            self.watch.add(failed.event)
            if not failed.is_known:
                outcome, cause = Outcome.UNKNOWN, failed.event
        except SampleStoppedError:
            outcome, cause = Outcome.UNKNOWN, self._event(EventKind.LOST, "it was stopped before its end")
            is_interrupted = True
        except (EngineError, SimulationError) as error:
            outcome, cause = Outcome.UNKNOWN, self._event(EventKind.LOST, f"the engine failed: {error}")
        self.watch.finish()
        if outcome is not Outcome.UNKNOWN:
            cause = next((event for event in self.watch.events if self._is_failure(event)), None)
            outcome = Outcome.SUCCEEDED if cause is None else Outcome.FAILED
        return SampleResult(
            index=index,
            outcome=outcome,
            events=tuple(self.watch.events),
            cause=cause,
            duration_s=round(self.watch.time_s, 9),
            end_poses=self._end_poses(),
            is_interrupted=is_interrupted,
            began_in_collision=self.watch.began_in_collision,
            answers=self.answers,
            skills=tuple(self.skills),
        )

    # -- uncertainty -------------------------------------------------------------------------------------------------

    def _perturb_start(self) -> None:
        try:
            self._perturb()
        except (WorldError, InvalidArgumentError) as error:  # a number that the engine refuses
            raise _StepFailedError(self._event(EventKind.REFUSED, f"a random start: {error}")) from error

    def _perturb(self) -> None:
        scales = {id: _scale(factors) for id, factors in self.guessed.items()}
        poses: list[tuple[BodyId, Pose]] = []
        for id, each in self.uncertainty.items():
            pose_noise, factors = self.rng.standard_normal(4), self.rng.standard_normal(3)
            deviations = np.array([each.mass, each.friction, each.joint_friction])
            if deviations.any():
                random = np.maximum(1.0 + deviations * factors, _MIN_FACTOR).tolist()
                stated = {kind: factor for kind, factor in zip(GuessKind, random, strict=True) if factor != 1.0}
                scales[id] = _scale({**self.guessed.get(id, {}), **stated})
            if id in self.free and _moves(each):
                poses.append((id, _perturbed(self._pose(id), each, pose_noise)))

        def perturb(engine: Engine) -> None:
            if scales:
                engine.scale_dynamics(scales)
            if poses:
                engine.apply(SetPoses(dict(poses)))

        if scales or poses:
            self.simulation.engine.run(perturb, label="perturb", edits=True)
            self.watch.set_reference(id for id, _ in poses)
            self.watch.begin_overlaps(id for id, _ in poses)

    def _noisy(self, id: BodyId, pose: Pose) -> Pose:
        """A pose that a step gives a body, with the deviation of its pose."""
        each = self.uncertainty.get(id)
        if each is None or not _moves(each):
            return pose
        return _perturbed(_array(pose), each, self.rng.standard_normal(4))

    # -- time --------------------------------------------------------------------------------------------------------

    def _advance(self, duration_s: float) -> _SimulatedTime:
        """Lets time pass [s], watches, and ends the sample if it is late."""
        done = 0.0
        while duration_s - done > 1e-9:
            chunk = min(_CHUNK_S, duration_s - done)
            if self.watch.time_s + chunk > self.limit_s + 1e-6:
                text = f"not done after {self.limit_s:g} s"
                raise _StepFailedError(self._event(EventKind.LATE, text))
            yield chunk
            done += chunk
            self.watch.update()
            if self.on_poses is not None:
                self.on_poses(self.watch.time_s, self.simulation.state.ids, self.simulation.state.poses)

    def _finish(self) -> _SimulatedTime:
        """Lets time pass until the condition of the plan holds, or until everything is at rest."""
        start_s, still, before = self.watch.time_s, 0, self.simulation.state.poses
        while True:
            if self.plan.until is not None:
                if self._answer(self.plan.until)[0]:
                    return
            elif still >= _REST_CHUNKS or self._is_asleep(start_s):
                return
            elif self.watch.time_s + _CHUNK_S > min(self.limit_s, start_s + _MAX_SETTLE_S):
                return  # all steps are done in time
            yield from self._advance(_CHUNK_S)
            poses = self.simulation.state.poses
            same = poses.shape == before.shape and not np.any(np.abs(poses[:, :3] - before[:, :3]) > _REST_M)
            still, before = still + 1 if same else 0, poses

    def _is_asleep(self, start_s: float) -> bool:
        """Whether nothing moves; a body that was moved at the start [s] wakes up in the next step only."""
        stats = self.simulation.state.stats
        return stats is not None and stats.awake == 0 and self.watch.time_s > start_s

    # -- steps -------------------------------------------------------------------------------------------------------

    def _execute(self, step: PlanStep) -> _SimulatedTime:
        if not isinstance(step, Edit):  # which takes no time
            self.limit_s = min(self.plan.time_limit_s, self.watch.time_s + step.time_limit_s)
        try:
            yield from self._do(step)
        except (WorldError, KnowledgeError, RobotError) as error:
            raise _StepFailedError(self._event(EventKind.REFUSED, f"{type(step).__name__.lower()}: {error}")) from error

    def _do(self, step: PlanStep) -> _SimulatedTime:
        match step:
            case Wait():
                yield from self._advance(step.duration_s)
            case Move():
                id = self._body(step.thing)
                self._set_pose(id, self._target(id, step))
            case Place():
                self._place(step)
            case Push():
                yield from self._push(step)
            case Pull():
                yield from self._pull(step)
            case Open() | Close():
                yield from self._move_joint(step)
            case Attach():
                self._edit(replace(step, parent=self._body(step.parent), child=self._body(step.child)))
            case Detach():
                self._edit(replace(step, child=self._body(step.child)))
            case ChangePhysics():
                self._change_physics(step)
            case Perform():
                yield from self._perform(step)

    def _target(self, id: BodyId, step: Move) -> Pose:
        if step.to is not None:
            return as_pose(step.to)
        pose = self._pose(id)
        pose[:3] += np.asarray(step.by)
        return pose_from_array(pose)

    def _place(self, step: Place) -> None:
        items = [self._find(each) or each for each in step.things]
        on = None if step.on is None else self._body(step.on)
        into = None if step.into is None else self._body(step.into)
        known = set(self.simulation.state.ids)
        for placed in self._places(items, self._placed_next(step), on=on, into=into):
            self.named.add(placed.id)
            if placed.id not in known and placed.id not in self.uncertainty:
                self.uncertainty = {**self.uncertainty, **self._uncertainty_of_new(placed.id)}
            self._set_pose(placed.id, placed.pose)

    def _placed_next(self, step: Place) -> list[str]:
        """What the steps right after this one put on or into the same holder."""
        following = self.plan.steps[(self.watch.step or 0) + 1 :]
        places = takewhile(lambda each: isinstance(each, Place), following)
        same = takewhile(lambda each: (each.on, each.into) == (step.on, step.into), cast("Iterator[Place]", places))
        return [self._find(thing) or thing for each in same for thing in each.things]

    def _places(
        self, items: list[str], later: list[str], *, on: str | None, into: str | None
    ) -> tuple[PlacementResult, ...]:
        with suppress(NoFreePlacementError):  # then the next step says what does not fit
            if later:
                return self.simulation.place(items, on=on, into=into, room_for=later)
        return self.simulation.place(items, on=on, into=into)

    def _uncertainty_of_new(self, id: BodyId) -> dict[BodyId, Uncertainty]:
        body = next(each for world in self.simulation.worlds for each in world.bodies if each.id == id)
        merged = _merged([each for each in self.plan.stated if _is_about(each, id, body.cls, self.simulation)])
        return {} if merged is None else {id: merged}

    def _set_pose(self, id: BodyId, pose: Pose) -> None:
        """Sets the pose of a thing, at rest, with those of what stands on it, and then adds its deviation."""
        loads = self.watch.loads_of(id)
        self._set_exactly(id, pose, loads)
        for overlap in self.watch.overlaps((id, *loads)):
            if overlap.depth_m > MAX_CORRECTION_M:
                event = self._event(EventKind.REFUSED, f"the given pose is not free: {overlap.text}")
                raise _StepFailedError(msgspec.structs.replace(event, thing=overlap.thing, other=overlap.other))
        noisy = self._noisy(id, pose)
        if noisy is not pose:
            self._set_exactly(id, noisy, loads)
        self.watch.begin_overlaps((id, *loads))

    def _set_exactly(self, id: BodyId, pose: Pose, loads: Iterable[BodyId]) -> None:
        poses = {id: pose}
        new_from_old = pose_multiply(_array(pose), pose_inverse(self._pose(id)))
        for load in loads:
            poses[load] = pose_from_array(pose_multiply(new_from_old, self._pose(load)))
        self._edit(SetPoses(poses, {} if self.watch.is_prescribed(id) else None))  # {}: it is there at once
        self.watch.set_reference(poses)

    def _push(self, step: Push) -> _SimulatedTime:
        id = self._body(step.thing)
        with self._motion_of(id):
            done = 0.0
            while step.duration_s - done > 1e-9:
                chunk = min(_FORCE_CHUNK_S, step.duration_s - done)
                point: Vector | None = None
                if step.point is not None:
                    pose = self._pose(id)
                    x, y, z = (pose[:3] + quat_rotate(pose[3:], step.point)).tolist()
                    point = (x, y, z)
                self.simulation.engine.run(partial(_apply_force, id, step.force, point))
                yield from self._advance(chunk)
                done += chunk

    def _pull(self, step: Pull) -> _SimulatedTime:
        id = self._body(step.thing)
        start_s, lead = self.watch.time_s, np.zeros(3)
        try:
            with self._motion_of(id):
                while True:
                    pose = self._pose(id)
                    error = np.asarray(step.target) - pose[:3] - quat_rotate(pose[3:], step.point)
                    distance_m = float(np.linalg.norm(error))
                    if distance_m <= _ARRIVED_M:
                        return
                    if self.watch.time_s - start_s + _CHUNK_S > step.time_limit_s:
                        raise _StepFailedError(
                            self._jam(id, f"{distance_m:.3f} m before its target", amount=distance_m)
                        )
                    lead = np.clip(lead + _INTEGRAL_GAIN * error, -_MAX_LEAD_M, _MAX_LEAD_M)  # against weight
                    x, y, z = (np.asarray(step.target) + lead).tolist()
                    self.simulation.pull(id, point=step.point, target=(x, y, z))
                    yield from self._advance(_CHUNK_S)
        finally:
            self.simulation.release(id)

    def _move_joint(self, step: Open | Close) -> _SimulatedTime:
        joint = find_joint(cast("EngineSession", self.simulation), step.thing)  # `moving_to` does not step it
        self.named.add(joint.body)
        timeout_s = max(0.0, self.limit_s - self.watch.time_s - 1e-3)
        with self._motion_of(joint.body):
            target = joint.position_at(step.fraction) if isinstance(step, Open) else joint.closed_position
            moved = yield from self._watched(joint.moving_to(target, timeout_s=timeout_s))
        if not moved.arrived:
            wanted = f"{step.fraction:.0%}" if isinstance(step, Open) else "closed"
            where = f"{joint.openness:.0%} open instead of {wanted}"
            raise _StepFailedError(self._jam(joint.body, where, amount=joint.openness))
        if moved.duration_s == 0.0:
            self.watch.set_reference([joint.body])

    def _perform(self, step: Perform) -> _SimulatedTime:
        from mindstage.robots.skill_performance import start_skill  # takes a second, and few plans have skills

        if not isinstance(self.simulation, Simulation):
            raise _StepFailedError(self._event(EventKind.REFUSED, "perform: there are no robots in this world"))
        robot = find_robot(self.simulation, step.robot)
        self.named.update(id for value in step.args.values() if (id := self._find(str(value))) is not None)
        motion = start_skill(
            robot,
            step.skill,
            step.args,
            deadline_s=max(0.0, self.limit_s - self.watch.time_s - 1e-3),
            seed=int(self.rng.integers(2**31)),
            on_step=self.on_step,
        )

        self.watch.carried = _Held(robot, self.watch)
        try:
            done = yield from self._watched(motion)
        finally:
            self.watch.carried = tuple
            self.watch.refresh()  # what is held by a weld is attached
        self.skills.append(done)
        self.named.update(done.state.held.values(), done.state.supports, done.state.openness)
        if not done:
            text = f"{robot.name} {_failed_to(done)}: {done.reason}; {done.state.text}"
            thing = self._find(str(step.args.get("thing", "")))
            event = msgspec.structs.replace(self._event(EventKind.SKILL, text), thing=thing)
            raise _StepFailedError(event, is_known=done.outcome is SkillOutcome.FAILED)

    def _watched(self, motion: Generator[float, None, T]) -> Generator[float, None, T]:
        """Lets the times pass that a motion yields; returns what it returns."""
        while True:
            try:
                duration_s = next(motion)
            except StopIteration as end:
                result: T = end.value
                return result
            try:
                yield from self._advance(duration_s)
            except BaseException:
                motion.close()  # ends the pull at once, as an exception in the motion would
                raise

    def _change_physics(self, step: ChangePhysics) -> None:
        id = self._body(step.thing)
        changes = {name: getattr(step, name) for name in ("mass_kg", "mobility", "gravity")}
        given = {name: value for name, value in changes.items() if value is not None}
        before = self.simulation.snapshot().body(id).physics
        physics = msgspec.structs.replace(before, **given)
        self._edit(SetPhysics(id, physics))

    def _edit(self, edit: Edit) -> None:
        self.simulation.apply(edit)
        if not isinstance(edit, SetPoses):
            self.watch.refresh()

    @contextmanager
    def _motion_of(self, id: BodyId) -> Iterator[None]:
        self.watch.begin_motion(id)
        try:
            yield
        finally:
            self.watch.end_motion()

    def _jam(self, id: BodyId, where: str, *, amount: float) -> ImaginedEvent:
        against = self.watch.strongest_contact(id)
        blocked = "" if against is None else f", against {against[0] or 'the ground'} with {against[1]:.0f} N"
        event = self._event(EventKind.JAMMED, f"{id} jammed: it is {where}{blocked}")
        other = None if against is None else against[0]
        return msgspec.structs.replace(event, thing=id, other=other, amount=amount)

    # -- names and poses ---------------------------------------------------------------------------------------------

    def _find(self, name: str) -> BodyId | None:
        return find_body(self.simulation, name)

    def _body(self, name: str) -> BodyId:
        id = self._find(name)
        if id is None:
            text = f"{name!r} does not exist (any more)"
            raise _StepFailedError(self._event(EventKind.REFUSED, text))
        self.named.add(id)
        return id

    def _pose(self, id: BodyId) -> Array:
        state = self.simulation.state
        pose: Array = state.poses[state.ids.index(id)].copy()
        pose[3:] = normalize(pose[3:])
        return pose

    def _end_poses(self) -> dict[str, Pose]:
        state = self.simulation.state
        ids = dict.fromkeys([*(id for id in state.ids if id in self.named), *self.watch.moved_ids()])
        rows = {id: row for row, id in enumerate(state.ids)}
        return {id: pose_from_array(state.poses[rows[id]]) for id in ids if np.isfinite(state.poses[rows[id]]).all()}

    # -- checks ------------------------------------------------------------------------------------------------------

    def _ask_check(self) -> None:
        if self.plan.check is None:
            return
        try:
            holds, self.answers = self._answer(self.plan.check)
        except KnowledgeError as error:  # what it asks for does not exist at the end
            self.watch.add(self._event(EventKind.CHECK, f"{self.plan.check.question} cannot be answered: {error}"))
            return
        if not holds:
            expected = self.plan.check.expect
            wanted = expected if isinstance(expected, str) else f"one with {expected}"
            found = f"{len(self.answers)} answers" if self.answers else "no answer"
            text = f"{self.plan.check.question} has {found}, expected was {wanted}"
            self.watch.add(self._event(EventKind.CHECK, text))

    def _answer(self, check: Check) -> tuple[bool, tuple[dict[str, object], ...]]:
        """Whether the answers to a question are as expected, and the answers as plain data."""
        from mindstage.knowledge.queries import get_question

        rows = self.simulation.ask(check.question, **check.args)
        if is_stopped() and get_question(check.question).imagines:
            raise SampleStoppedError  # the answers rest on too few samples
        plain = tuple({name: msgspec.to_builtins(getattr(row, name)) for name in row.__struct_fields__} for row in rows)
        if isinstance(check.expect, str):
            return bool(plain) is (check.expect == "any"), plain
        return any(_matches(row, check.expect) for row in plain), plain

    def _is_failure(self, event: ImaginedEvent) -> bool:
        always = {EventKind.JAMMED, EventKind.LATE, EventKind.REFUSED, EventKind.SKILL, EventKind.CHECK}
        return event.kind in always or event.kind in self.plan.forbid

    def _event(self, kind: EventKind, text: str) -> ImaginedEvent:
        return ImaginedEvent(kind=kind, text=text, time_s=self.watch.time_s, step=self.watch.step)


def _scale(factors: Mapping[GuessKind, float]) -> DynamicsScale:
    mass, friction, joint_friction = (factors.get(kind, 1.0) for kind in GuessKind)
    return DynamicsScale(mass=mass, friction=friction, joint_friction=joint_friction)


def _apply_force(id: BodyId, force: Vector, point: Vector | None, engine: Engine) -> None:
    engine.apply_force(id, force, point)


class _Held:
    """What a robot holds, asked for every 0.1 s only, since contacts of the whole world are searched for it."""

    def __init__(self, robot: Robot, watch: EventWatch) -> None:
        self._robot, self._watch = robot, watch
        self._known: tuple[BodyId, ...] = ()
        self._next_s = 0.0

    def __call__(self) -> tuple[BodyId, ...]:
        if self._watch.time_s >= self._next_s:
            self._known, self._next_s = tuple(self._robot.held.values()), self._watch.time_s + _CHUNK_S
        return self._known


def _failed_to(done: SkillResult) -> str:
    """Which skill failed, with its arguments, or is not known to have succeeded."""
    what = " ".join([done.skill, *map(str, done.args.values())])
    return f"failed to {what}" if done.outcome is SkillOutcome.FAILED else f"may not have done {what}"


def _matches(row: Mapping[str, object], expected: Mapping[str, str | float | bool]) -> bool:
    """Whether a row has the expected values; an IRI may be given by its local name, numbers may differ by 0.1 %."""
    for name, value in expected.items():
        found = row.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float):
            if found != value and not (isinstance(found, str) and local_name(Iri(found)) == value):
                return False
        elif not isinstance(found, int | float) or abs(found - value) > 1e-3 * max(1.0, abs(value)):
            return False
    return True


def _array(pose: Pose) -> Array:
    return np.array([*pose.position, *pose.quaternion])


def _moves(uncertainty: Uncertainty) -> bool:
    return bool(np.any(uncertainty.position_m) or uncertainty.yaw_rad)


def _perturbed(pose: Array, uncertainty: Uncertainty, noise: Array) -> Pose:
    """A pose with a random displacement and rotation about the vertical axis, from four standard normal numbers."""
    deviation = uncertainty.position_m
    x, y, z = deviation if isinstance(deviation, tuple) else (deviation, deviation, 0.0)
    yaw = uncertainty.yaw_rad * float(noise[3]) / 2
    turned = quat_multiply(np.array([cos(yaw), 0.0, 0.0, sin(yaw)]), normalize(pose[3:]))
    return pose_from_array(np.concatenate([pose[:3] + np.array([x, y, z]) * noise[:3], normalize(turned)]))


# -- names -------------------------------------------------------------------------------------------------------------


def _uncertainty_by_body(plan: Plan, simulation: Simulation, basis: WatchBasis) -> dict[BodyId, Uncertainty]:
    """The uncertainty of each body, in the order of the poses; what is stated for a body precedes that of its class."""
    if not plan.stated:
        return {}
    bodies = {body.id: body for body in basis.world.bodies}
    found = {}
    for id in basis.layout.ids:
        merged = _merged([each for each in plan.stated if _is_about(each, id, bodies[id].cls, simulation)])
        if merged is not None:
            found[id] = merged
    return found


def _is_about(uncertainty: Uncertainty, id: BodyId, cls: str, simulation: WorldSession) -> bool:
    name = uncertainty.thing
    if name == id or find_body(simulation, name) == id:
        return True
    if find_body(simulation, name) is not None:
        return False
    try:
        wanted = simulation.knowledge.names.find(name, EntityType.CLASS)
    except MindstageError:
        return False
    return wanted == cls or simulation.knowledge.is_a(Iri(cls), wanted)


def _merged(stated: list[Uncertainty]) -> Uncertainty | None:
    """One uncertainty from several: of each property the last one that is not 0."""
    if not stated:
        return None
    values: dict[str, Any] = {"thing": stated[-1].thing}
    for each in stated:
        for name in ("position_m", "yaw_rad", "mass", "friction", "joint_friction"):
            if np.any(getattr(each, name)):
                values[name] = getattr(each, name)
    return Uncertainty(**values)


class _Validator:
    def __init__(self, file: PlanFile, simulation: Simulation) -> None:
        self.plan, self.simulation, self.place = file.plan, simulation, file.place
        self.new_ids: set[str] = set()

    def check(self) -> None:
        if not self.plan.steps and self.plan.check is None:
            raise PlanError(self.place("steps"), cause="the plan has neither steps nor a check")
        for number, step in enumerate(self.plan.steps):
            self._check_step(f"steps[{number}]", step)
        self._check_times()
        if self.plan.guesses and Capability.SCALE_DYNAMICS not in self.simulation.engine.capabilities:
            self._fail("uncertainty", f"{self.simulation.engine.name} cannot vary masses and frictions; use mujoco")
        kinds = tuple(EventKind)
        for number, kind in enumerate(self.plan.forbid):
            if kind not in kinds:
                self._fail(f"forbid[{number}]", f"{kind!r} is no kind of event; {suggestion(kind, kinds)}")
        for number, each in enumerate(self.plan.stated):
            self._check_uncertainty(f"uncertainty[{number}]", each)
        for name, check in (("check", self.plan.check), ("until", self.plan.until)):
            if check is not None:
                self._check_question(name, check)

    def _check_times(self) -> None:
        """Checks that durations and deadlines do not contradict one another."""
        limit_s, total_s = self.plan.deadline_s, 0.0
        for number, step in enumerate(self.plan.steps):
            if isinstance(step, Edit):
                continue
            path, given_s = f"steps[{number}].deadline_s", step.deadline_s
            total_s += step.given_duration_s
            if given_s is not None and given_s < step.given_duration_s:
                self._fail(path, f"the step takes {step.given_duration_s:g} s, and is to end after {given_s:g} s")
            if limit_s is not None and given_s is not None and given_s > limit_s and not isinstance(step, Perform):
                self._fail(path, f"{given_s:g} s is later than the deadline of the plan, {limit_s:g} s")
        if limit_s is not None and limit_s < total_s:
            self._fail("deadline_s", f"the steps take {total_s:g} s, and the plan is to end after {limit_s:g} s")

    def _check_step(self, path: str, step: PlanStep) -> None:
        match step:
            case Place():
                self._check_place(path, step)
            case Move():
                if (step.to is None) is (step.by is None):
                    self._fail(path, "a thing is moved either `to` a pose or `by` a displacement")
                self._check_body(f"{path}.thing", step.thing)
            case Open() | Close():
                if step.thing not in self.new_ids:
                    try:
                        find_joint(self.simulation, step.thing)
                    except (WorldError, KnowledgeError) as error:
                        self._fail(f"{path}.thing", str(error), error)
            case Push() | Pull() | ChangePhysics():
                self._check_body(f"{path}.thing", step.thing)
            case Attach():
                self._check_body(f"{path}.parent", step.parent)
                self._check_body(f"{path}.child", step.child)
            case Detach():
                self._check_body(f"{path}.child", step.child)
            case Perform():
                self._check_skill(path, step)

    def _check_place(self, path: str, step: Place) -> None:
        if (step.on is None) is (step.into is None):
            self._fail(path, "a thing is placed either `on` or `into` another one")
        self._check_body(f"{path}.{'on' if step.on is not None else 'into'}", step.on or step.into or "")
        if not step.things:
            self._fail(f"{path}.thing", "nothing is placed")
        for thing in step.things:
            if not self._exists(thing):
                self._check_new(f"{path}.thing", thing)
            elif step.things.count(thing) > 1:
                self._fail(f"{path}.thing", f"{thing!r} is placed twice")

    def _check_skill(self, path: str, step: Perform) -> None:
        from mindstage.robots.skill_declaration import skill_specs  # few plans have skills

        known = skill_specs()
        spec = known.get(step.skill)
        if spec is None:
            self._fail(f"{path}.skill", f"there is no skill {step.skill!r}; {suggestion(step.skill, known)}")
        try:
            args = spec.check(step.args)
        except InvalidArgumentError as error:
            self._fail(f"{path}.args", str(error), error)
        try:
            find_robot(self.simulation, step.robot)
        except RobotError as error:
            self._fail(f"{path}.robot", str(error), error)
        for name, value in args.items():
            if not spec.parameter(name).type.is_number:
                self._check_named(f"{path}.args.{name}", str(value), spec.parameter(name).type)

    def _check_named(self, path: str, name: str, type: ParameterType) -> None:
        """Checks a name that a skill resolves: of a body, or of a class or individual of the knowledge base."""
        if type is not ParameterType.CLASS and self._exists(name):
            return
        kind = EntityType.CLASS if type is ParameterType.CLASS else EntityType.INDIVIDUAL
        try:
            self.simulation.knowledge.names.find_thing(name, kind)
        except KnowledgeError as error:
            similar = getattr(error, "suggestions", ())
            near = "" if similar or kind is EntityType.CLASS else f"; {suggestion(name, self.simulation.state.ids)}"
            self._fail(path, f"{error}{near}", error)

    def _check_new(self, path: str, cls: str) -> None:
        try:
            body = self.simulation.make_body(cls)
        except (KnowledgeError, WorldError) as error:
            near = suggestion(cls, self.simulation.state.ids)
            self._fail(path, f"{cls!r} is neither a body nor a class of which one can be made: {error}; {near}", error)
        name, number = body.id, 1
        while name in self.new_ids:  # the id that the next body of this class will get
            number += 1
            name = BodyId(f"{body.id.rpartition('_')[0]}_{number}")
        self.new_ids.add(name)

    def _check_uncertainty(self, path: str, each: Uncertainty) -> None:
        if not np.all(np.asarray(each.position_m) >= 0.0) or not np.all(np.asarray(each.position_m) <= MAX_DEVIATION):
            self._fail(f"{path}.position_m", f"a standard deviation is a number from 0 to {MAX_DEVIATION:g}")
        if (each.mass or each.friction or each.joint_friction) and (
            Capability.SCALE_DYNAMICS not in self.simulation.engine.capabilities
        ):
            self._fail(path, f"{self.simulation.engine.name} cannot vary masses and frictions; use mujoco")
        if not self._exists(each.thing):
            try:
                self.simulation.knowledge.names.find(each.thing, EntityType.CLASS)
            except KnowledgeError as error:
                near = suggestion(each.thing, self.simulation.state.ids)
                self._fail(f"{path}.thing", f"{each.thing!r} is neither a body nor a class; {near}", error)

    def _check_question(self, path: str, check: Check) -> None:
        from mindstage.knowledge.queries import get_question

        try:
            question = get_question(check.question)
            question.bind((), check.args)
            if self.new_ids.isdisjoint(map(str, check.args.values())):  # else they can be asked for only later
                with stopping(lambda: True):  # what imagines only resolves its names
                    self.simulation.ask(check.question, **check.args)
        except KnowledgeError as error:
            self._fail(path, str(error), error)
        columns = question.row.__struct_fields__
        if not isinstance(check.expect, str):
            for name in check.expect:
                if name not in columns:
                    self._fail(f"{path}.expect", f"the answers have no column {name!r}; {suggestion(name, columns)}")

    def _exists(self, name: str) -> bool:
        return name in self.new_ids or find_body(self.simulation, name) is not None

    def _check_body(self, path: str, name: str) -> None:
        if not self._exists(name):
            known = [*self.simulation.state.ids, *self.new_ids]
            self._fail(path, f"there is no body {name!r}; {suggestion(name, known)}")

    def _fail(self, path: str, cause: str, error: Exception | None = None) -> NoReturn:
        raise PlanError(self.place(path), cause=cause) from error
