"""Samples as worlds of a batch in MuJoCo Warp, on its CPU device or a GPU: equal to mechanics and other executors."""

from __future__ import annotations

import itertools
import os
import sys
import time
from collections.abc import Iterator
from math import acos, atan, cos, pi, sin

import numpy as np
import pytest

from mindstage.engines.base import DynamicsScale
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import ImaginationError, PlanError
from mindstage.imagination import (
    Attach,
    ChangePhysics,
    Check,
    Close,
    EventKind,
    InProcessExecutor,
    Job,
    Move,
    Open,
    Outcome,
    Place,
    Plan,
    PlanStep,
    Pull,
    Push,
    SampleResult,
    Uncertainty,
    Wait,
    evaluate_plan,
    wilson_interval,
)
from mindstage.imagination.verdicts import make_executor
from mindstage.scene import BodyId, Mobility, Pose
from mindstage.scene.edits import SetPoses
from mindstage.simulation import Simulation, SimulationImage
from tests.engines.scenes import body, prismatic_joint, revolute_joint
from tests.imagination.scenes import TABLE_HEIGHT_M, on_table, slope

if "CI" not in os.environ:
    pytest.importorskip("mujoco_warp")

import warp

from mindstage.imagination import warp_batch
from mindstage.imagination.warp_batch import BatchLimits, StepEnd, WarpBatch
from mindstage.imagination.warp_executor import WarpExecutor

pytestmark = pytest.mark.xdist_group("warp")  # kernels are compiled in one process only

DEVICE = os.environ.get("MINDSTAGE_WARP_DEVICE", "cpu")
"""The device of Warp; set MINDSTAGE_WARP_DEVICE=cuda:0 to test with a GPU."""
GRAVITY = 9.81
STEP_S = 0.002
BOX_Z = TABLE_HEIGHT_M + 0.05
BOX = body("box", (-0.5, 0.0, BOX_Z), (0.2, 0.1, 0.1), "dynamic", 1.0)
CABINET = body("cabinet", (-2.0, 0.0, 0.5), (0.5, 0.5, 1.0))
DRAWER = body("drawer", (-1.7, 0.0, 0.5), (0.1, 0.4, 0.2), "dynamic", 2.0)
SLIDE = prismatic_joint("slide", "cabinet", "drawer", (-1.7, 0.0, 0.5), limit=0.3)
DOOR = body("door", (-2.0, 0.55, 0.5), (0.5, 0.04, 0.6), "dynamic", 3.0)
HINGE = revolute_joint("hinge", "cabinet", "door", (-2.25, 0.55, 0.5), limit=pi / 2)
TRAY = body("tray", (-0.8, 0.3, TABLE_HEIGHT_M + 0.01), (0.2, 0.2, 0.02), "kinematic")
WALL = body("wall", (-1.45, 0.0, 0.5), (0.1, 0.5, 1.0))
NEAR_EDGE = Plan(
    steps=(Move(thing="box", to=Pose((-0.003, 0.0, BOX_Z))), Wait(duration_s=0.5)),
    uncertainty=(Uncertainty(thing="box", position_m=(0.02, 0.0, 0.0), mass=0.1, friction=0.1),),
)


@pytest.fixture(scope="module")
def sim() -> Iterator[Simulation]:
    """A table, a box and a tray on it, a cabinet with a drawer and a door, and a wall that blocks the drawer."""
    with on_table(BOX, TRAY, CABINET, DRAWER, SLIDE, DOOR, HINGE, WALL) as sim:
        sim.step(0.5)
        yield sim


def batch_of(sim: Simulation, worlds: int, scales: list[DynamicsScale] | None = None) -> WarpBatch:
    """A batch in the state of a simulation, in which the box of each world is scaled."""
    engine = sim.engine.run(lambda engine: engine.fork())
    assert isinstance(engine, MujocoEngine)
    start = engine.compiled().copy()
    start.set_state(start.state())
    if scales is None:
        return WarpBatch(start, start.model, worlds, device=DEVICE)
    models = []
    for scale in scales:
        scaled = engine.fork()
        scaled.scale_dynamics({BodyId("box"): scale})
        models.append(scaled.compiled().model)
    batch = WarpBatch(start, models[-1], worlds, device=DEVICE)
    for world, model in enumerate(models):
        batch.set_model(world, model)
    return batch


def execute(
    sim: Simulation, plan: Plan, executor: WarpExecutor | InProcessExecutor, count: int = 1
) -> list[SampleResult]:
    job = Job(SimulationImage.capture(sim), plan, seed=3)
    results = list(executor.run(job, range(count), deadline_s=time.monotonic() + 100.0))
    return sorted(results, key=lambda each: each.index)


def on_cpu(worlds: int = 4) -> WarpExecutor:
    return WarpExecutor(device=DEVICE, worlds=worlds)


class TestMechanics:
    """States of a batch after some steps of the integrator, which adds the velocity after the acceleration."""

    def test_a_body_falls_as_in_free_fall_and_a_force_accelerates_it_by_its_mass(self, sim: Simulation) -> None:
        factors, steps, force = [0.5, 1.0, 2.0], 100, 3.0
        batch = batch_of(sim, 3, [DynamicsScale(mass=factor) for factor in factors])
        compiled = batch.compiled.copy()
        address, _ = compiled.free_joint_addresses[BodyId("box")]
        state = compiled.state()
        state.qpos[address : address + 3] = (1.0, 1.0, 2.0)
        state.qvel[:] = 0.0
        compiled.set_state(state)
        for world in range(3):
            batch.set_state(world, compiled)
            batch.set_force(world, {compiled.body_ids[BodyId("box")]: np.array([force, 0, 0, 0, 0, 0])})
        assert batch.step(steps, stop=lambda: False) is StepEnd.DONE
        travel = STEP_S**2 * steps * (steps + 1) / 2
        for world, factor in enumerate(factors):
            x, y, z = batch.state(world, time_s=0.0).qpos[address : address + 3]
            assert z == pytest.approx(2.0 - GRAVITY * travel, abs=2e-5)
            assert x == pytest.approx(1.0 + force / factor * travel, abs=2e-5)
            assert y == pytest.approx(1.0, abs=1e-6)

    def test_a_box_slides_down_a_slope_by_its_friction_in_each_world(self) -> None:
        angle, friction, duration_s = atan(0.5), 0.3, 0.6
        factors = [0.5, 1.0, 1.5, 2.0]  # the last one does not slide: 0.6 is more than 0.5
        with slope(angle, base_m=0.3, height_m=0.05, friction=friction) as sim:
            batch = batch_of(sim, 4, [DynamicsScale(friction=factor) for factor in factors])
            row = sim.state.ids.index(BodyId("box"))
            start = batch.poses(0)[row, :3]
            assert batch.step(round(duration_s / STEP_S), stop=lambda: False) is StepEnd.DONE
            moved = [float(np.linalg.norm(batch.poses(world)[row, :3] - start)) for world in range(4)]
        for factor, distance in zip(factors[:3], moved, strict=False):
            acceleration = GRAVITY * (sin(angle) - factor * friction * cos(angle))
            assert distance == pytest.approx(acceleration * duration_s**2 / 2, rel=0.03)
        assert moved[3] < 0.002

    def test_a_pulled_hinge_moves_as_in_mujoco(self, sim: Simulation) -> None:
        """The same force on the door in both, and poses at each look; of single and of double precision."""
        batch, compiled = batch_of(sim, 2), None
        engine = sim.engine.run(lambda engine: engine.fork())
        compiled = batch.compiled
        door, row = compiled.body_ids[BodyId("door")], compiled.rows[BodyId("door")]
        batch.set_force(1, {door: np.array([0.0, 4.0, 0.0, 0.0, 0.0, 0.0])})
        angles = []
        for _ in range(5):
            for _ in range(5):
                engine.apply_force(BodyId("door"), (0.0, 4.0, 0.0))
                engine.step(0.02)
            assert batch.step(50, stop=lambda: False) is StepEnd.DONE
            assert batch.poses(1)[row] == pytest.approx(engine.poses()[1][row], abs=1e-4)
            angles.append(2 * np.arccos(abs(batch.poses(1)[row, 3])))
        assert angles[-1] > 0.2
        assert batch.poses(0)[row] == pytest.approx(sim.state.poses[row], abs=1e-4)  # without the force


class TestOutcomes:
    """Samples end as in the executor of this process, for the same reason, and at nearly the same poses."""

    @pytest.mark.parametrize(
        ("steps", "tolerance_m"),
        [
            ((Push(thing="box", force=(0.0, 10.0, 0.0), duration_s=0.3),), 6e-3),
            ((Push(thing="box", force=(0.0, 30.0, 0.0), point=(0.0, 0.0, 0.05), duration_s=0.4),), None),
            ((Move(thing="box", by=(0.7, 0.0, 0.0)),), 5e-3),
            ((Move(thing="tray", by=(0.3, -0.3, 0.2)), Wait(duration_s=0.1), Move(thing="box", by=(0, 0, 0.3))), 5e-3),
            ((Place(thing="box", on="floor"), Wait(duration_s=0.2)), 1e-3),
            ((Pull(thing="box", target=(-0.5, 0.2, BOX_Z + 0.03)),), 5e-3),
            ((Pull(thing="box", point=(0.09, 0.0, 0.0), target=(-0.45, 0.15, BOX_Z)),), 1e-2),
            ((Open(thing="door", fraction=0.4), Close(thing="hinge")), 5e-3),
            ((Open(thing="drawer", deadline_s=2.5),), 5e-3),
            ((Wait(duration_s=1.0, deadline_s=0.3),), 1e-3),
            ((ChangePhysics(thing="box", gravity=False), Move(thing="box", by=(0.7, 0.0, 0.0))), 1e-3),
            ((ChangePhysics(thing="box", mass_kg=5.0), Push(thing="box", force=(0.0, 40.0, 0.0))), 2e-3),
        ],
        ids=[
            "push", "tip", "fall", "tray", "place", "pull", "pull an end", "open and close", "jam", "late", "gravity",
            "mass",
        ],
    )  # fmt: skip
    def test_a_sample_ends_as_in_this_process(
        self, sim: Simulation, steps: tuple[PlanStep, ...], tolerance_m: float | None
    ) -> None:
        plan = Plan(steps=steps)
        (ours,), (theirs,) = execute(sim, plan, on_cpu(1)), execute(sim, plan, InProcessExecutor())
        assert ours.outcome is theirs.outcome, (ours.cause, theirs.cause)
        kinds = [
            [(each.kind, each.thing, each.other, each.step) for each in result.events] for result in (ours, theirs)
        ]
        assert kinds[0] == kinds[1]
        if tolerance_m is not None:
            assert ours.end_poses.keys() == theirs.end_poses.keys()
            for id, pose in ours.end_poses.items():
                expected = theirs.end_poses[id]
                assert pose.position == pytest.approx(expected.position, abs=tolerance_m), id
                turned = 2 * acos(min(1.0, abs(float(np.dot(pose.quaternion, expected.quaternion)))))
                assert turned < 10.0 * tolerance_m + 0.002, id

    def test_the_probability_of_an_uncertain_plan_agrees_and_so_do_the_samples(self, sim: Simulation) -> None:
        ours = evaluate_plan(sim, NEAR_EDGE, samples=48, seed=7, fixed=True, workers=on_cpu(16))
        theirs = evaluate_plan(sim, NEAR_EDGE, samples=48, seed=7, fixed=True)
        assert (ours.unknown, theirs.unknown) == (0, 0)
        assert 5 < theirs.succeeded < 43
        where = "the processor" if DEVICE == "cpu" else warp.get_device(DEVICE).name
        assert f"MuJoCo Warp on {where}" in ours.assumptions[-1]
        low, high = wilson_interval(theirs.succeeded, 48)
        assert ours.probability is not None
        assert low <= ours.probability <= high
        equal = sum(a.outcome is b.outcome for a, b in zip(ours.results, theirs.results, strict=True))
        assert equal >= 46  # a box that is balanced on the edge may end on either side
        for a, b in zip(ours.results, theirs.results, strict=True):
            if a.outcome is b.outcome is Outcome.SUCCEEDED:
                assert a.end_poses["box"].position == pytest.approx(b.end_poses["box"].position, abs=2e-3)

    def test_a_question_at_the_end_is_asked_in_the_world_of_the_sample(self, sim: Simulation) -> None:
        on_floor = Check(question="where_is", args={"thing": "box"}, expect={"relation": "on", "other": "floor"})
        falls = Plan(steps=(Move(thing="box", by=(0.7, 0.0, 0.0)), Wait(duration_s=0.6)), forbid=(), check=on_floor)
        (fallen,) = execute(sim, falls, on_cpu(1))
        assert fallen.outcome is Outcome.SUCCEEDED
        assert str(fallen.answers[0]["other"]).endswith("#floor")
        (ended,) = execute(sim, Plan(steps=falls.steps[:1], forbid=(), until=on_floor), on_cpu(1))
        assert ended.outcome is Outcome.SUCCEEDED
        assert 0.3 < ended.duration_s < 0.6
        (stays,) = execute(sim, Plan(steps=(Wait(duration_s=0.1),), check=on_floor), on_cpu(1))
        assert stays.cause is not None
        assert stays.cause.kind is EventKind.CHECK

    def test_a_world_that_diverges_is_unknown_and_leaves_the_others_as_they_are(self, sim: Simulation) -> None:
        plan = Plan(steps=(Push(thing="box", force=(0.0, 0.0, 1e12), duration_s=0.1), Wait(duration_s=0.2)))
        (lost,) = execute(sim, plan, on_cpu(2))
        assert lost.outcome is Outcome.UNKNOWN
        assert lost.cause is not None
        assert "not finite" in lost.cause.text


class TestSamples:
    def test_a_seed_determines_the_verdict_whatever_the_size_of_the_batch(self, sim: Simulation) -> None:
        first = evaluate_plan(sim, NEAR_EDGE, samples=12, seed=1, fixed=True, workers=on_cpu(12))
        again = evaluate_plan(sim, NEAR_EDGE, samples=12, seed=1, fixed=True, workers=on_cpu(5))
        other = evaluate_plan(sim, NEAR_EDGE, samples=12, seed=2, fixed=True, workers=on_cpu(12))
        assert [each.outcome for each in again.results] == [each.outcome for each in first.results]
        assert other.to_json() != first.to_json()
        if DEVICE == "cpu":  # on a GPU, the last digits differ from run to run
            assert again.to_json() == first.to_json()

    def test_worlds_are_used_again_from_the_start(self, sim: Simulation) -> None:
        """One world after another in one slot: pushes, masses and contacts of a sample do not remain for the next."""
        plan = Plan(
            steps=(Push(thing="box", force=(0.0, 8.0, 0.0), duration_s=0.1),),
            uncertainty=(Uncertainty(thing="box", mass=0.3),),
        )
        alone = [execute(sim, plan, on_cpu(1), count=3)[index] for index in range(3)]
        together = execute(sim, plan, on_cpu(3), count=3)
        assert [each.end_poses for each in alone] == [each.end_poses for each in together]

    def test_contacts_of_an_earlier_sample_are_forgotten(self, sim: Simulation) -> None:
        plan = Plan(
            steps=(Open(thing="drawer", deadline_s=1.2),),
            uncertainty=(Uncertainty(thing="drawer", joint_friction=0.1),),
        )
        for result in execute(sim, plan, on_cpu(1), count=2):
            assert (EventKind.COLLIDED, "drawer", "wall") in {
                (event.kind, event.thing, event.other) for event in result.events
            }

    def test_the_original_is_as_it_was(self, sim: Simulation) -> None:
        before = sim.state.poses.tobytes()
        execute(sim, NEAR_EDGE, on_cpu(2), count=2)
        assert sim.state.poses.tobytes() == before

    def test_more_contacts_than_expected_take_more_memory(
        self, sim: Simulation, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        enough = execute(sim, NEAR_EDGE, on_cpu(3), count=3)
        sizes: list[BatchLimits] = []
        create = WarpBatch.__init__

        def record(self: WarpBatch, *args: object, limits: BatchLimits, **options: object) -> None:
            sizes.append(limits)
            create(self, *args, limits=limits, **options)  # type: ignore[arg-type]

        monkeypatch.setattr(WarpBatch, "__init__", record)
        lifted = SimulationImage.capture(sim).restore()
        lifted.engine.run(lambda engine: engine.apply(SetPoses({BodyId("box"): Pose((-0.5, 0.0, 1.0))})), edits=True)
        monkeypatch.setattr(warp_batch, "_MIN_CONTACT_COUNT", 1)
        monkeypatch.setattr(warp_batch, "_MARGIN", 1)
        assert execute(sim, NEAR_EDGE, on_cpu(3), count=3) == enough
        with lifted:
            (fallen,) = execute(lifted, Plan(steps=(Wait(duration_s=0.5),), forbid=()), on_cpu(1))
        assert fallen.outcome is Outcome.SUCCEEDED
        assert len(sizes) > 2
        assert sizes[-1].contacts >= 2 * sizes[-2].contacts

    def test_a_world_with_far_too_many_contacts_is_refused(self) -> None:
        limits = BatchLimits(contacts=15_000, constraints=100)
        with pytest.raises(ImaginationError, match=r"more than 15,000 contacts.*in processes"):
            limits.doubled(contacts=True, constraints=False)


class TestEnd:
    def test_samples_that_do_not_end_in_time_are_unknown(self, sim: Simulation) -> None:
        plan = Plan(steps=(Wait(duration_s=900.0, deadline_s=1000.0),), uncertainty=NEAR_EDGE.uncertainty)
        execute(sim, NEAR_EDGE, on_cpu(4), count=1)  # compiles the kernels
        verdict = evaluate_plan(sim, plan, samples=8, budget_s=0.8, workers=on_cpu(4))
        assert (verdict.outcome, verdict.succeeded, verdict.failed) == (Outcome.UNKNOWN, 0, 0)
        assert verdict.unknown == verdict.samples == 4
        assert "budget" in verdict.stopped

    def test_a_canceled_trial_ends_at_once(self, sim: Simulation) -> None:
        plan = Plan(steps=(Wait(duration_s=900.0, deadline_s=1000.0),), uncertainty=NEAR_EDGE.uncertainty)
        asked = itertools.count()
        verdict = evaluate_plan(sim, plan, samples=8, workers=on_cpu(4), cancel=lambda: next(asked) >= 20)
        assert verdict.stopped == "canceled"


class TestRefusals:
    @pytest.mark.parametrize(
        ("step", "message"),
        [
            (Attach(parent="drawer", child="box"), "attach: attachments are part of the model"),
            (Place(thing="Cup", on="table"), "place: a new body changes the model"),
            (Move(thing="table", by=(0.0, 0.0, 0.1)), "move: moving 'table' changes the model"),
            (ChangePhysics(thing="box", mobility=Mobility.STATIC), "set_physics: the mobility of a body"),
        ],
        ids=lambda each: type(each).__name__ if isinstance(each, PlanStep) else "",
    )
    def test_a_step_that_changes_the_model_is_refused_with_where_it_can_be_run(
        self, sim: Simulation, step: PlanStep, message: str
    ) -> None:
        plan = Plan(steps=(Wait(duration_s=0.1), step))
        with pytest.raises(PlanError, match=message) as caught:
            evaluate_plan(sim, plan, workers=on_cpu(1))
        assert caught.value.place == "steps[1]"
        assert "in processes (workers=2) or on Ray" in str(caught.value)

    def test_names_choose_the_device_and_the_number_of_worlds(self) -> None:
        executor = make_executor("gpu:cpu:12", samples=100)
        assert executor.name == "12 worlds in MuJoCo Warp on the processor"
        assert make_executor("gpu:cpu", samples=3).name.startswith("3 worlds")
        with pytest.raises(ImaginationError, match="give gpu, gpu:WORLDS, gpu:cpu"):
            make_executor("gpu:fast")
        with pytest.raises(ImaginationError, match=f"no device 'tpu'; there are .*{DEVICE}"):
            WarpExecutor(device="tpu")

    def test_without_a_gpu_the_processor_is_used_only_if_it_is_asked_for(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(warp, "is_cuda_available", lambda: False)
        with pytest.raises(ImaginationError, match=r"no GPU with CUDA.*processes.*gpu:cpu"):
            make_executor("gpu")

    def test_without_the_extra_its_name_is_given(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "mujoco_warp", None)
        with pytest.raises(ImaginationError, match=r"install mindstage\[gpu\]"):
            make_executor("gpu:cpu")
