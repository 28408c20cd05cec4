"""WarpExecutor: samples of a plan as worlds of one batch in MuJoCo Warp, thousands at once on a GPU.

Each sample is the same generator as in the other executors (`PlanRunner.begin`), with the same random numbers. Here it
waits until the whole batch has been stepped by the time that it asks for. A world whose sample has ended begins the
next one. Only plans can be run whose steps change states, masses and frictions, but not the model.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain
from typing import Any, NamedTuple, cast

import numpy as np
from msgspec.structs import replace

from mindstage.engines.base import Applied, Capability, Contact, DynamicsScale, Engine, PoseArray, SavedState, SpawnNote
from mindstage.engines.mujoco import CompiledState, MujocoEngine, whole_steps
from mindstage.errors import EngineError, ImaginationError, PlanError, SimulationDivergedError, WorldError
from mindstage.imagination.execution import PlanRunner, RunningSample, SampleStoppedError, never, resume
from mindstage.imagination.executors import Job
from mindstage.imagination.plans import ChangePhysics, Close, Move, Open, Perform, Place, Plan, PlanStep
from mindstage.imagination.results import SampleResult
from mindstage.imagination.warp_batch import BatchLimits, StepEnd, WarpBatch, load_warp, varied_fields
from mindstage.ranges import Count, checked
from mindstage.scene import BodyId, Vector, World
from mindstage.scene.edits import Attach, Detach, Edit, SetPhysics, SetPoses, counted_ids
from mindstage.scene.transforms import Array, pose_from_array
from mindstage.simulation import Simulation
from mindstage.simulation.engine_thread import EngineAccess
from mindstage.simulation.interaction import Perturbations, SpringPerturbation, spring_forces
from mindstage.simulation.joint_motion import find_joint
from mindstage.simulation.placement import PlacementResult
from mindstage.simulation.state import StateSnapshot, find_body

__all__ = ["WarpExecutor"]

_MAX_WORLDS, _MAX_WORLDS_ON_CPU = 1024, 64
_OTHERS = "run it in processes (workers=2) or on Ray (workers='ray')"
_NAME = re.compile(r"gpu(:cpu)?(:\d+)?")


class WarpExecutor:
    """Runs samples as worlds of a batch in MuJoCo Warp."""

    @checked
    def __init__(self, *, device: str | None = None, worlds: Count | None = None) -> None:
        """Chooses a device; nothing is allocated yet.

        Args:
            device: the name of a device of Warp, such as "cuda:1"; "cpu" for the processor, which is slower than the
                other executors; None for the first GPU.
            worlds: the largest number of worlds of a batch; None for 1,024, or 64 on the processor.

        Raises:
            ImaginationError: MuJoCo Warp is not installed, or there is no such device.
        """
        warp, _ = load_warp()
        if device is None:
            if not warp.is_cuda_available():
                text = "there is no GPU with CUDA here; run the samples in processes (workers=2), or, to try this "
                raise ImaginationError(text + "executor without one, on the processor (workers='gpu:cpu')")
            device = "cuda:0"
        try:
            self._device = warp.get_device(device)
        except (ValueError, RuntimeError) as error:
            known = ", ".join(str(each) for each in warp.get_devices())
            raise ImaginationError(f"Warp has no device {device!r}; there are {known}") from error
        self._worlds = worlds or (_MAX_WORLDS if self._device.is_cuda else _MAX_WORLDS_ON_CPU)

    @classmethod
    @checked
    def from_name(cls, name: str, samples: Count) -> WarpExecutor:
        """The executor of a name such as "gpu", "gpu:4096" (worlds), "gpu:cpu" or "gpu:cpu:16".

        Raises:
            ImaginationError: the name is another one; or see `__init__`.
        """
        match = _NAME.fullmatch(name)
        if match is None:
            raise ImaginationError(f"no executor is named {name!r}: give gpu, gpu:WORLDS, gpu:cpu or gpu:cpu:WORLDS")
        executor = cls(device="cpu" if match[1] else None, worlds=int(match[2][1:]) if match[2] else None)
        executor._worlds = min(executor._worlds, samples)
        return executor

    @property
    def name(self) -> str:
        """See `Executor`."""
        return f"{self._worlds:,} world{'' if self._worlds == 1 else 's'} in MuJoCo Warp on {self._where}"

    @property
    def notes(self) -> tuple[str, ...]:
        """See `Executor`."""
        text = (
            f"samples were simulated by MuJoCo Warp on {self._where}, with numbers of single precision, no sleep, "
            "no divided time steps for fast bodies, and no check whether a thing begins inside of another one"
        )
        apart = "bodies that began inside each other pass through each other also after they were apart"
        return (f"{text}; {apart}; a replay is simulated by MuJoCo, and may end otherwise in a close case",)

    @property
    def _where(self) -> str:
        return str(self._device.name) if self._device.is_cuda else "the processor"

    def run(
        self, job: Job, indices: Iterable[int], *, deadline_s: float, cancel: Callable[[], bool] = never
    ) -> Iterator[SampleResult]:
        """See `Executor`.

        Raises:
            PlanError: the plan has a step that changes the model.
        """

        def stop() -> bool:
            return time.monotonic() >= deadline_s or cancel()

        template = _Template(job)
        limits = BatchLimits.of(template.start)
        waiting = iter(indices)
        try:
            while True:
                batch = WarpBatch(
                    template.start, template.changed_model, self._worlds, device=str(self._device), limits=limits
                )
                overflowed = yield from _run_batch(batch, template, waiting, stop)
                if not overflowed:
                    return
                limits = batch.larger_limits()
                waiting = chain(overflowed, waiting)
        finally:
            template.close()

    def close(self) -> None:
        """Does nothing: memory is freed when `run` ends."""


def _run_batch(
    batch: WarpBatch, template: _Template, waiting: Iterator[int], stop: Callable[[], bool]
) -> Generator[SampleResult, None, list[int]]:
    """Runs samples until there are none; returns those that have to be run again, with more memory."""
    free, running, pulls = list(range(batch.worlds)), dict[int, _Slot](), list[_Pull]()
    while True:
        while free and not stop() and (index := next(waiting, None)) is not None:
            slot = _Slot(_BatchWorld(template, batch, free[-1], pulls), index)
            if (result := slot.go_on()) is None:
                running[free.pop()] = slot
            else:
                batch.reset(free[-1])
                yield result
        if not running:
            return []
        _apply_pulls(batch, pulls)
        steps = min(slot.steps_left for slot in running.values())
        match batch.step(steps, stop=stop):
            case StepEnd.STOPPED:
                yield from (slot.stop() for slot in running.values())
                return []
            case StepEnd.OVERFLOWED:
                return [slot.index for slot in running.values()]
        for row, slot in list(running.items()):
            if (result := slot.passed(steps)) is not None:
                del running[row]
                free.append(row)
                batch.reset(row)
                yield result


class _Pull(NamedTuple):
    """A pull on a body in one of the worlds, for the next step."""

    world: int
    body: int
    """MuJoCo's id."""
    spring: SpringPerturbation
    duration_s: float


class _BatchPulls(Perturbations):
    """The pulls in one world, whose forces are computed together with those of the others."""

    def __init__(self, pulls: list[_Pull], world: int, body_ids: Mapping[BodyId, int]) -> None:
        super().__init__()
        self._pulls, self._world, self._body_ids = pulls, world, body_ids

    def apply_forces(self, engine: Engine, duration_s: float) -> None:
        """See `Perturbations`."""
        for id, spring in self.items():
            if id in self._body_ids:
                self._pulls.append(_Pull(self._world, self._body_ids[id], spring, duration_s))


def _apply_pulls(batch: WarpBatch, pulls: list[_Pull]) -> None:
    """Applies the forces of pulls to the worlds, and removes the pulls."""
    if not pulls:
        return
    worlds, bodies, springs, durations_s = zip(*pulls, strict=True)
    held = batch.points(worlds, bodies, np.array([spring.point for spring in springs]))
    batch.add_forces(worlds, bodies, spring_forces(springs, held, np.array(durations_s)[:, None]), held)
    pulls.clear()


class _Slot:
    """A world of the batch, and the sample that runs in it."""

    def __init__(self, world: _BatchWorld, index: int) -> None:
        self.index = index
        self.steps_left = 0
        """Time steps after which the sample goes on."""
        self._world = world
        self._parts = _parts(world, world.template.runner.begin(world, index))
        self._steps, self._pending_s = 0, 0.0

    def go_on(self, reason: Exception | None = None) -> SampleResult | None:
        """Continues the sample, or ends it for a reason; None if it has not ended, and time must pass."""
        while True:
            part_s = resume(self._parts, reason)
            if isinstance(part_s, SampleResult):
                return part_s
            reason = None
            self._steps, self._pending_s = whole_steps(self._pending_s + part_s, self._world.timestep_s)
            if self._steps:
                self.steps_left = self._steps
                self._world.batched_engine.begin_step()
                return None

    def passed(self, steps: int) -> SampleResult | None:
        """Continues the sample if the time for which it waits has passed."""
        self.steps_left -= steps
        if self.steps_left:
            return None
        self._world.end_step(self._steps)
        return self.go_on(self._world.divergence())

    def stop(self) -> SampleResult:
        """Ends the sample before its end."""
        result = self.go_on(SampleStoppedError())
        assert result is not None
        return result


def _parts(world: _BatchWorld, sample: RunningSample) -> RunningSample:
    """A running sample, whose times are divided where the forces of its pulls change."""
    reason: Exception | None = None
    while True:
        duration_s = resume(sample, reason)
        if isinstance(duration_s, SampleResult):
            return duration_s
        try:
            yield from world.perturbations.substeps(world.batched_engine.as_engine(), duration_s)
            reason = None
        except (SampleStoppedError, EngineError) as error:
            reason = error


class _BatchWorld:
    """One world of a batch, as the `SampleSession` of one sample."""

    def __init__(self, template: _Template, batch: WarpBatch, row: int, pulls: list[_Pull]) -> None:
        self.template, self.batch, self.row = template, batch, row
        self.knowledge = template.simulation.knowledge
        self.timestep_s = batch.timestep_s
        self.batched_engine = _WorldEngine(self)
        self.engine = EngineAccess(
            self.batched_engine.as_engine, lambda function, **_: function(self.batched_engine.as_engine())
        )
        self.perturbations = _BatchPulls(pulls, row, batch.compiled.body_ids)
        self.time_s = template.simulation.state.time_s
        self._state: StateSnapshot | None = None

    # -- `SampleSession` -----------------------------------------------------------------------------------------------

    @property
    def worlds(self) -> tuple[World, ...]:
        """The worlds that were spawned."""
        return self.template.simulation.worlds

    @property
    def state(self) -> StateSnapshot:
        """The current state."""
        if self._state is None:
            poses = self.batch.poses(self.row)
            self._state = replace(self.template.simulation.state, time_s=self.time_s, poses=poses, stats=None)
        return self._state

    def snapshot(self) -> World:
        """The current state as a world."""
        with self.simulation() as simulation:
            return simulation.snapshot()

    def pull(self, id: BodyId, *, point: Vector, target: Vector) -> None:
        """Pulls a point of a body towards a target [m]."""
        self.perturbations.pull(id, point=point, target=target, worlds=self.worlds)

    def release(self, id: BodyId | None = None) -> None:
        """Ends the pull on one body, or all pulls."""
        self.perturbations.release(id)

    def place(
        self, item: list[str], *, on: str | None = None, into: str | None = None, room_for: Sequence[str] = ()
    ) -> tuple[PlacementResult, ...]:
        """The poses at which bodies that exist can be placed; the caller moves them there."""
        with self.simulation() as simulation:
            return simulation.place(item, on=on, into=into, room_for=room_for)

    def ask(self, question: str, /, **args: Any) -> Iterable[Any]:
        """The answers to a question."""
        with self.simulation() as simulation:
            return tuple(simulation.ask(question, **args))

    # -- the batch -----------------------------------------------------------------------------------------------------

    @contextmanager
    def simulation(self) -> Iterator[Simulation]:
        """A simulation in the state of this world, for what needs more than states and forces."""

        def load(engine: Engine) -> None:
            for edit in self.batched_engine.physics:
                engine.apply(edit)
            for id in self.template.driven:
                engine.apply(SetPoses({id: pose_from_array(self.state.poses[self.state.ids.index(id)])}))
            if self.batched_engine.scales:
                engine.scale_dynamics(self.batched_engine.scales)
            cast("MujocoEngine", engine).compiled().set_state(self.batch.state(self.row, time_s=self.time_s))

        with self.template.restore() as simulation:
            simulation.engine.run(load, label="load", edits=True)
            yield simulation

    def end_step(self, steps: int) -> None:
        """Follows the batch, which has made some time steps."""
        self.time_s += steps * self.timestep_s
        self.batched_engine.end_step()
        self._state = None

    def divergence(self) -> SimulationDivergedError | None:
        """The error of a world whose state is no longer finite."""
        if self.batch.is_finite(self.row):
            return None
        return SimulationDivergedError(time_s=self.time_s, what="the state is not finite or far too large")

    def apply(
        self,
        edit: Edit,
        *,
        engine: Engine | None = None,
        leads_to: SavedState | None = None,
        timeout_s: float | None = None,
    ) -> Applied:
        """Sets poses, or the physics of a body.

        Raises:
            WorldError: a body cannot take a pose.
            ImaginationError: other edits change the model.
        """
        match edit:
            case SetPoses():
                self.template.set_poses(self.batch.state(self.row, time_s=self.time_s), edit)
                self.batch.set_state(self.row, self.template.engine.compiled())
                self._state = None
            case SetPhysics():
                self.batched_engine.set_physics(edit)
            case _:
                raise ImaginationError(f"a world of a batch on a GPU cannot {edit.kind}; {_OTHERS}")
        return Applied(edit=edit, inverse=edit)


class _WorldEngine:
    """The part of the `Engine` protocol that a world of a batch has."""

    name = "mujoco_warp"
    capabilities = frozenset({Capability.CONTACTS, Capability.SCALE_DYNAMICS, Capability.JOINTS})

    def __init__(self, world: _BatchWorld) -> None:
        self._world = world
        self._wrenches: dict[int, Array] = {}
        self.scales: dict[BodyId, DynamicsScale] = {}
        self.physics: tuple[SetPhysics, ...] = ()
        """The changes of physical properties, in their order."""

    notes: tuple[SpawnNote, ...] = ()
    """See `Engine`: none, since nothing is checked while time passes."""

    def as_engine(self) -> Engine:
        """This object, as those see it who need a part of an engine only."""
        return cast("Engine", self)

    def __getattr__(self, name: str) -> Any:
        raise ImaginationError(f"a world of a batch on a GPU cannot do {name!r}; {_OTHERS}")

    def poses(self) -> tuple[tuple[BodyId, ...], PoseArray]:
        """See `Engine`; the same holds for the methods below."""
        state = self._world.state
        return state.ids, state.poses

    def apply_force(self, id: BodyId, force: Vector, point: Vector | None = None) -> None:
        world = self._world
        body = world.batch.compiled.body_ids.get(id)
        if body is None:
            return
        wrench = self._wrenches.setdefault(body, np.zeros(6))
        wrench[:3] += force
        if point is not None:
            wrench[3:] += np.cross(np.asarray(point) - world.batch.center_of_mass(world.row, body), force)

    def apply(self, edit: Edit) -> Applied:
        return self._world.apply(edit)

    def scale_dynamics(self, scales: Mapping[BodyId, DynamicsScale]) -> None:
        self.scales |= scales
        self._set_model()

    def set_physics(self, edit: SetPhysics) -> None:
        """Changes a body."""
        self.physics += (edit,)
        self._set_model()

    def contacts(self) -> tuple[Contact, ...]:
        world = self._world
        return world.batch.contacts(world.row).contacts(world.state.ids)

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        with self._world.simulation() as simulation:
            return simulation.engine.run(lambda engine: engine.joint_positions())

    def begin_step(self) -> None:
        """Applies the forces until `end_step`."""
        if self._wrenches:
            self._world.batch.set_force(self._world.row, self._wrenches)

    def end_step(self) -> None:
        """Ends the forces."""
        self._wrenches = {}
        self._world.batch.set_force(self._world.row, None)

    def _set_model(self) -> None:
        model = self._world.template.model_with(self.physics, self.scales)
        self._world.batch.set_model(self._world.row, model)


class _Template:
    """What all samples of a job have in common: the model, and the state in which they begin."""

    def __init__(self, job: Job) -> None:
        """Prepares a job.

        Raises:
            PlanError: a step cannot be executed in a batch.
        """
        self._image = job.image
        self.simulation = job.image.restore()
        self.runner = PlanRunner(self.simulation, job.plan, seed=job.seed)
        engine = self.simulation.engine.run(lambda engine: engine.fork())
        if not isinstance(engine, MujocoEngine):
            raise ImaginationError(f"the worlds of {engine.name} cannot be simulated by MuJoCo Warp; {_OTHERS}")
        engine.join_regions()
        self.engine = engine
        """An engine for edits of one world at a time."""
        self.driven: list[BodyId] = []
        """Kinematic bodies that the plan moves."""
        self._engines: dict[tuple[SetPhysics, ...], MujocoEngine] = {}
        self._check(job.plan)
        self.changed_model = self._probe(job.plan)
        self._engines[()] = engine.fork()
        self.start = engine.compiled().copy()
        """The model and the state at the start, awake."""
        self.start.set_state(self.start.state())

    def restore(self) -> Simulation:
        """Another simulation in the state at the start."""
        return self._image.restore()

    def close(self) -> None:
        """Ends the simulation."""
        self.simulation.close()

    def set_poses(self, state: CompiledState, edit: SetPoses) -> None:
        """Moves bodies in a state; `engine` then has the result.

        Raises:
            WorldError: a body cannot take its pose.
        """
        compiled = self.engine.compiled()
        compiled.set_state(state, contacts=False)
        self.engine.apply(edit)
        if self.engine.rebuild_pending or self.engine.compiled().model is not compiled.model:
            raise ImaginationError(
                f"moving {counted_ids(edit.ids)} changes the model, which all worlds of a batch share; {_OTHERS}"
            )

    def model_with(self, physics: tuple[SetPhysics, ...], scales: Mapping[BodyId, DynamicsScale]) -> Any:
        """The MuJoCo model after some changes."""
        if physics not in self._engines:
            changed = self.engine.fork()
            for edit in physics:
                changed.apply(edit)
            changed.compiled()
            self._engines[physics] = changed
        scaled = self._engines[physics].fork()
        scaled.scale_dynamics(scales)
        return scaled.compiled().model

    # -- what can be executed ------------------------------------------------------------------------------------------

    def _check(self, plan: Plan) -> None:
        if plan.guesses:
            raise PlanError(
                "uncertainty", cause=f"guesses vary the frictions of all bodies, the model's own; {_OTHERS}"
            )
        for number, step in enumerate(plan.steps):
            if reason := self._obstacle(step):
                cause = f"{step.__struct_config__.tag}: {reason}, which all worlds of a batch on a GPU share; {_OTHERS}"
                raise PlanError(f"steps[{number}]", cause=cause)
        for id in self.runner.moved_at_start:
            if not self._is_movable(id):
                cause = f"moving {id!r} changes the model, which all worlds of a batch on a GPU share; {_OTHERS}"
                raise PlanError("uncertainty", cause=cause)

    def _obstacle(self, step: PlanStep) -> str:
        """Why a step cannot be executed in a batch; empty if it can."""
        match step:
            case Attach() | Detach():
                return "attachments are part of the model"
            case Place() | Move():
                for thing in step.things if isinstance(step, Place) else (step.thing,):
                    id = find_body(self.simulation, thing)
                    if id is None or not self._is_movable(id):
                        return f"{'a new body' if id is None else f'moving {id!r}'} changes the model"
            case Open() | Close():
                body = find_joint(self.simulation, step.thing).body
                is_pulled = self.simulation.snapshot().body(body).physics.is_dynamic
                return "" if is_pulled or self._is_movable(body) else f"moving {body!r} changes the model"
            case ChangePhysics() if step.mobility is not None:
                return "the mobility of a body is part of the model"
            case Perform():
                return "a robot's controllers command the engine"
        return ""

    def _is_movable(self, id: BodyId) -> bool:
        """Whether a body can be moved without a new model; kinematic ones can after this call."""
        state = self.simulation.state
        pose, model = pose_from_array(state.poses[state.ids.index(id)]), self.engine.compiled().model
        trial = self.engine.fork()
        try:
            trial.apply(SetPoses({id: pose}))
        except WorldError:
            return True  # a joint allows only some poses, and the sample reports others
        if trial.rebuild_pending:
            return False
        if trial.compiled().model is not model:
            self.engine.apply(SetPoses({id: pose}))
            self.driven.append(id)
        return True

    def _probe(self, plan: Plan) -> Any:
        """A MuJoCo model in which everything has changed that differs between worlds."""
        probe, model = self.engine.fork(), self.engine.compiled().model
        for number, step in enumerate(plan.steps):
            if isinstance(step, ChangePhysics):
                id = find_body(self.simulation, step.thing)
                assert id is not None  # the plan is valid
                given = {"mass_kg": step.mass_kg, "gravity": step.gravity}
                before = probe.snapshot().body(id).physics
                changed = {name: each for name, each in given.items() if each is not None}
                probe.apply(SetPhysics(id, replace(before, **changed)))
                try:
                    varied_fields(model, probe.compiled().model)
                except ValueError as error:
                    cause = (
                        f"set_physics: it changes {error} of the model, which all worlds of a batch share; {_OTHERS}"
                    )
                    raise PlanError(f"steps[{number}]", cause=cause) from error
        probe.scale_dynamics(
            {
                id: DynamicsScale(
                    mass=1.0 + bool(each.mass),
                    friction=1.0 + bool(each.friction),
                    joint_friction=1.0 + bool(each.joint_friction),
                )
                for id, each in self.runner.uncertainty.items()
            }
        )
        return probe.compiled().model
