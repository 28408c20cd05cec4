"""Plans are executed step by step: what each step does, how it fails, and what is noticed on the way."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.stats import binom, norm

from mindstage.engines import NullEngine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import PlanError
from mindstage.imagination import (
    Attach,
    ChangePhysics,
    Check,
    Close,
    Detach,
    EventKind,
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
    run_plan,
    validate_plan,
)
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.scene import BodyId, Mobility, Pose
from mindstage.simulation import Simulation, SimulationImage
from tests.engines.scenes import attachment, body, prismatic_joint
from tests.imagination.scenes import TABLE_HEIGHT_M, on_table
from tests.kitchenette import kitchenette

BOX_Z = TABLE_HEIGHT_M + 0.05
BOX = body("box", (-0.5, 0.0, BOX_Z), (0.2, 0.1, 0.1), "dynamic", 1.0)
CABINET = body("cabinet", (-2.0, 0.0, 0.5), (0.5, 0.5, 1.0))
DRAWER = body("drawer", (-1.7, 0.0, 0.5), (0.1, 0.4, 0.2), "dynamic", 2.0)
SLIDE = prismatic_joint("slide", "cabinet", "drawer", (-1.7, 0.0, 0.5), limit=0.3)


@pytest.fixture(scope="module")
def kitchen() -> Iterator[SimulationImage]:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with knowledge, Simulation(knowledge, MujocoEngine(), threaded=False) as sim:
        sim.spawn()
        sim.step(2.0)
        yield SimulationImage.capture(sim)


def execute(*steps: PlanStep, sim: Simulation | None = None, **options: object) -> SampleResult:
    """The result of steps in a world of a table, a box on it, and a drawer."""
    with sim or on_table(BOX, CABINET, DRAWER, SLIDE) as used:
        return run_plan(used, Plan(steps=steps, **options))


class TestSteps:
    def test_a_moved_thing_falls_from_where_it_was_put(self) -> None:
        result = execute(Move(thing="box", by=(0.7, 0.0, 0.0)))
        assert result.outcome is Outcome.FAILED
        assert result.cause is not None
        assert (result.cause.kind, result.cause.thing, result.cause.step) == (EventKind.FELL, "box", None)
        assert result.cause.amount == pytest.approx(TABLE_HEIGHT_M, abs=0.02)
        assert "box fell by 0.7" in result.cause.text
        assert result.end_poses["box"].position[2] == pytest.approx(0.05, abs=0.01)

    def test_waiting_takes_its_time_and_nothing_else_happens(self) -> None:
        result = execute(Wait(duration_s=1.25))
        assert (result.outcome, result.events, result.cause) == (Outcome.SUCCEEDED, (), None)
        assert 1.25 <= result.duration_s < 2.0
        assert result.end_poses == {}

    def test_an_existing_thing_and_a_new_one_are_placed(self) -> None:
        result = execute(Place(thing="box", on="floor"), Place(thing="Cup", on="table"), Wait(duration_s=0.5))
        assert result.outcome is Outcome.SUCCEEDED, result.cause
        assert result.end_poses["box"].position[2] == pytest.approx(0.05, abs=0.005)
        assert result.end_poses["Cup_1"].position[2] > TABLE_HEIGHT_M

    def test_a_thing_without_a_free_place_is_refused(self) -> None:
        result = execute(Place(thing="cabinet", on="box"))
        assert result.outcome is Outcome.FAILED
        assert result.cause is not None
        assert result.cause.kind is EventKind.REFUSED
        assert "cabinet cannot be placed on box" in result.cause.text

    def test_a_pushed_thing_moves_in_the_direction_of_the_force(self) -> None:
        result = execute(Push(thing="box", force=(0.0, 10.0, 0.0), duration_s=0.3))
        assert result.outcome is Outcome.SUCCEEDED
        x, y, _ = result.end_poses["box"].position
        assert y > 0.02 > abs(x + 0.5)
        tipped = execute(Push(thing="box", force=(0.0, 30.0, 0.0), point=(0.0, 0.0, 0.05), duration_s=0.4))
        assert tipped.cause is not None
        assert tipped.cause.kind is EventKind.TIPPED
        assert "tipped over" in tipped.cause.text

    def test_a_pulled_thing_arrives_or_jams(self) -> None:
        arrived = execute(Pull(thing="box", target=(-0.5, 0.2, BOX_Z + 0.03)))
        assert arrived.outcome is Outcome.SUCCEEDED
        jammed = execute(Pull(thing="drawer", target=(-1.7, 0.0, 1.5), deadline_s=1.0))
        assert jammed.cause is not None
        assert (jammed.cause.kind, jammed.cause.thing) == (EventKind.JAMMED, "drawer")
        assert jammed.cause.amount == pytest.approx(1.0, abs=0.05)

    def test_a_drawer_opens_and_closes(self) -> None:
        opened = execute(Open(thing="drawer", fraction=0.5))
        assert opened.outcome is Outcome.SUCCEEDED
        assert opened.end_poses["drawer"].position[0] == pytest.approx(-1.55, abs=0.015)
        closed = execute(Open(thing="slide"), Close(thing="slide"))
        assert closed.outcome is Outcome.SUCCEEDED
        assert closed.end_poses["drawer"].position[0] == pytest.approx(-1.7, abs=0.015)

    def test_a_blocked_drawer_jams_and_names_the_obstacle(self) -> None:
        wall = body("wall", (-1.45, 0.0, 0.5), (0.1, 0.5, 1.0))
        with on_table(CABINET, DRAWER, SLIDE, wall) as sim:
            result = run_plan(sim, Plan(steps=(Open(thing="drawer", deadline_s=4.0),)))
        assert result.outcome is Outcome.FAILED
        assert result.cause is not None
        assert (result.cause.kind, result.cause.thing, result.cause.other) == (EventKind.JAMMED, "drawer", "wall")
        assert result.cause.amount == pytest.approx(0.15 / 0.3, abs=0.05)
        hit = next(event for event in result.events if event.kind is EventKind.COLLIDED)
        assert (hit.thing, hit.other) == ("drawer", "wall")

    def test_a_sleeping_mug_that_hops_as_it_is_pushed_does_not_collide_with_what_it_is_on(self) -> None:
        with Simulation(KnowledgeBase(), MujocoEngine()) as sim:
            sim.spawn(kitchenette())
            sim.step(3.0)
            assert sim.state.stats is not None
            assert sim.state.stats.awake == 0
            for force_n in (3.0, 10.0):
                with sim.fork(threaded=False) as copy:
                    result = run_plan(copy, Plan(steps=(Push(thing="Mug", force=(force_n, 0, 0), duration_s=0.2),)))
                assert EventKind.FELL in {event.kind for event in result.events}
                assert EventKind.COLLIDED not in {event.kind for event in result.events}

    def test_attached_things_move_together_until_they_are_detached(self) -> None:
        together = execute(Attach(parent="drawer", child="box"), Open(thing="drawer"))
        assert together.end_poses["box"].position[0] > -0.25
        apart = execute(Attach(parent="drawer", child="box"), Detach(child="box"), Open(thing="drawer"))
        assert "box" not in apart.end_poses or apart.end_poses["box"].position[0] < -0.45

    def test_changed_physics_are_simulated(self) -> None:
        floating = execute(ChangePhysics(thing="box", gravity=False), Move(thing="box", by=(0.7, 0.0, 0.0)))
        assert floating.outcome is Outcome.SUCCEEDED
        fixed = execute(ChangePhysics(thing="box", mobility=Mobility.STATIC), Push(thing="box", force=(0, 500, 0)))
        assert fixed.outcome is Outcome.SUCCEEDED
        assert fixed.end_poses["box"].position == pytest.approx((-0.5, 0.0, BOX_Z), abs=1e-3)


class TestDeadlines:
    @pytest.mark.parametrize(
        "step",
        [
            Wait(duration_s=15.0),
            Wait(duration_s=40.0),
            Wait(duration_s=40.0, deadline_s=50.0),
            Push(thing="box", force=(0.1, 0.0, 0.0), duration_s=12.0),
        ],
    )
    def test_a_step_has_the_time_that_it_takes(self, step: Wait | Push) -> None:
        result = execute(step)
        assert result.outcome is Outcome.SUCCEEDED
        assert result.duration_s >= step.duration_s

    @pytest.mark.parametrize(
        ("steps", "deadline_s", "place"),
        [
            ((Wait(duration_s=3.0, deadline_s=0.5),), None, "steps[0].deadline_s: the step takes 3 s"),
            ((Wait(duration_s=3.0), Wait(duration_s=3.0)), 4.0, "deadline_s: the steps take 6 s"),
            ((Wait(duration_s=3.0, deadline_s=50.0),), 20.0, "steps[0].deadline_s: 50 s is later"),
            ((Pull(thing="box", target=(0.0, 0.0, 1.0), deadline_s=30.0),), 20.0, "steps[0].deadline_s: 30 s is later"),
        ],
    )
    def test_deadlines_that_contradict_durations_are_refused(
        self, steps: tuple[Wait, ...], deadline_s: float | None, place: str
    ) -> None:
        with pytest.raises(PlanError) as refused:
            execute(*steps, deadline_s=deadline_s)
        assert str(refused.value).startswith(place)

    def test_a_step_that_is_not_done_in_time_is_late(self) -> None:
        box = Pull(thing="box", target=(3.0, 0.0, TABLE_HEIGHT_M + 0.05), deadline_s=0.5)
        result = execute(box, Wait(duration_s=1.0))
        assert result.outcome is Outcome.FAILED
        assert result.duration_s <= 0.5

    def test_a_plan_ends_when_its_condition_holds_or_is_late(self) -> None:
        on_floor = Check(question="where_is", args={"thing": "box"}, expect={"relation": "on", "other": "floor"})
        falls = execute(Move(thing="box", by=(0.7, 0.0, 0.0)), until=on_floor, forbid=())
        assert falls.outcome is Outcome.SUCCEEDED
        assert falls.duration_s < 1.0
        waits = execute(Wait(duration_s=0.1), until=on_floor, deadline_s=1.0)
        assert waits.cause is not None
        assert waits.cause.kind is EventKind.LATE

    def test_a_sample_can_be_stopped(self) -> None:
        calls = iter([False] * 5 + [True] * 100)
        with on_table(BOX) as sim:
            result = run_plan(sim, Plan(steps=(Wait(duration_s=5.0),)), stop=lambda: next(calls))
        assert (result.outcome, result.is_interrupted) == (Outcome.UNKNOWN, True)
        assert result.duration_s <= 0.5


class TestOverlaps:
    """A thing that is set into a solid: what the physics corrects is no silent success."""

    @pytest.mark.parametrize(
        ("position", "other"),
        [
            ((2.0, 0.0, -0.05), "floor"),  # 10 cm
            ((-0.5, 0.0, 0.35), "table"),  # in the middle of it
            ((-1.05, 0.0, 0.06), "table"),  # 5 cm into its side
            ((-2.0, 0.0, 0.9), "cabinet"),
        ],
    )
    def test_a_pose_deep_in_a_solid_is_refused(self, position: tuple[float, float, float], other: str) -> None:
        result = execute(Move(thing="box", to=list(position)), Wait(duration_s=0.5))
        assert result.outcome is Outcome.FAILED
        assert result.cause is not None
        assert (result.cause.kind, result.cause.thing, result.cause.other) == (EventKind.REFUSED, "box", other)
        assert f"inside of {other}" in result.cause.text

    def test_what_is_corrected_by_the_physics_is_reported_with_both_ends(self) -> None:
        other = body("other", (-0.5, 0.3, BOX_Z), (0.2, 0.1, 0.1), "dynamic", 1.0)
        step = Move(thing="box", to=[-0.5, 0.21, BOX_Z])  # 1 cm into the other box
        with on_table(BOX, other) as sim:
            result = run_plan(sim, Plan(steps=(step, Wait(duration_s=1.0))))
            assert sim.snapshot().body("other").pose.position[1] > 0.302
        assert result.outcome is Outcome.SUCCEEDED, "by default they are allowed"
        assert result.began_in_collision
        kinds = {event.kind: event for event in result.events}
        assert kinds[EventKind.COLLIDED].amount == pytest.approx(0.01, abs=1e-3)
        assert (kinds[EventKind.CORRECTED].thing, kinds[EventKind.CORRECTED].other) == ("box", "other")
        assert (kinds[EventKind.MOVED].thing, kinds[EventKind.MOVED].other) == ("other", "box")
        total = (kinds[EventKind.CORRECTED].amount or 0.0) + (kinds[EventKind.MOVED].amount or 0.0)
        assert total == pytest.approx(0.01, abs=4e-3), "how far they had to part"
        for kind in ("corrected", "moved", "collided"):
            with on_table(BOX, other) as sim:
                assert run_plan(sim, Plan(steps=(step, Wait(duration_s=1.0)), forbid=(kind,))).outcome is Outcome.FAILED

    def test_what_only_touches_begins_in_no_collision(self) -> None:
        for position in ((-0.5, 0.0, BOX_Z - 0.001), (-1.1, 0.3, 0.05), (-0.5, 0.0, BOX_Z + 0.01)):
            result = execute(Move(thing="box", to=list(position)), Wait(duration_s=0.5), forbid=())
            assert not result.began_in_collision, position
            assert not {EventKind.CORRECTED, EventKind.MOVED} & {event.kind for event in result.events}

    def test_the_share_of_samples_that_begin_in_collision_is_that_of_the_noise(self) -> None:
        wall = body("wall", (0.5, 0.0, 0.5), (0.1, 2.0, 1.0))
        plan = Plan(
            steps=(Move(thing="box", to=[0.34, 0.0, 0.05]), Wait(duration_s=0.5)),  # 1 cm from the wall
            uncertainty=(Uncertainty(thing="box", position_m=(0.01, 0.0, 0.0)),),
        )
        with on_table(BOX, wall) as sim:
            verdict = evaluate_plan(sim, plan, samples=150, fixed=True)
        share = norm.sf((0.01 + 0.002) / 0.01)
        low, high = binom.ppf([0.0005, 0.9995], 150, share)
        assert low <= verdict.began_in_collision <= high
        assert f"{verdict.began_in_collision / 150:.0%} began in collision, such as: box is" in str(verdict)
        assert max(verdict.end_poses("box")[:, 0]) < 0.352, "all were pushed out"
        assert verdict.to_dict()["began_in_collision"] == verdict.began_in_collision


class TestEvents:
    def test_what_lies_on_a_pushed_thing_may_fall_and_that_is_named(self) -> None:
        cube = body("cube", (-0.5, 0.04, BOX_Z + 0.07), (0.04, 0.04, 0.04), "dynamic", 0.1)
        with on_table(BOX, cube) as sim:
            result = run_plan(sim, Plan(steps=(Push(thing="box", force=(0.0, -40.0, 0.0), duration_s=0.3),)))
        fell = [event for event in result.events if event.kind is EventKind.FELL]
        assert any(event.thing == "cube" and event.other == "box" for event in fell), result.events

    def test_an_event_is_reported_once_and_in_the_order_of_time(self) -> None:
        with on_table(BOX) as sim:
            result = run_plan(sim, Plan(steps=(Move(thing="box", by=(0.55, 0.0, 0.0)), Wait(duration_s=2.0))))
        keys = [(event.kind, event.thing) for event in result.events]
        assert len(keys) == len(set(keys))
        assert [event.time_s for event in result.events] == sorted(event.time_s for event in result.events)

    def test_allowed_events_are_reported_but_no_failure(self) -> None:
        result = execute(Move(thing="box", by=(0.7, 0.0, 0.0)), forbid=("tipped",))
        assert result.outcome is Outcome.SUCCEEDED
        assert result.events[0].kind is EventKind.FELL

    def test_a_thing_that_falls_out_of_the_world_has_left_the_place(self) -> None:
        with on_table(BOX) as sim:
            sim.edits.delete([BodyId("floor")])
            result = run_plan(sim, Plan(steps=(Move(thing="box", by=(0.7, 0.0, 0.0)), Wait(duration_s=3.0))))
        assert {event.kind for event in result.events} >= {EventKind.FELL, EventKind.LEFT}

    def test_an_opened_oven_door_neither_falls_nor_tips_in_the_kitchen(self, kitchen: SimulationImage) -> None:
        plan = Plan(steps=tuple(Open(thing=each) for each in ("fridge_door", "oven_door", "dishwasher_door")))
        with kitchen.restore() as sim:
            result = run_plan(sim, plan)
        assert result.outcome is Outcome.SUCCEEDED, result.cause
        assert not [event for event in result.events if event.kind in {EventKind.FELL, EventKind.TIPPED}]


class TestUncertainty:
    def test_start_poses_deviate_by_the_stated_amounts(self) -> None:
        positions, yaws = [], []
        image = SimulationImage.capture(on_table(BOX))
        plan = Plan(steps=(), check=Check(question="where_is", args={"thing": "box"}), uncertainty=(
            Uncertainty(thing="box", position_m=(0.02, 0.01, 0.0), yaw_rad=0.2),
        ))  # fmt: skip
        for index in range(200):
            with image.restore() as sim:
                pose = run_plan(sim, plan, index=index, seed=5).end_poses["box"]
            positions.append(pose.position)
            yaws.append(2 * np.arctan2(pose.quaternion[3], pose.quaternion[0]))
        deviation = np.std(positions, axis=0)
        assert deviation[:2] == pytest.approx((0.02, 0.01), rel=0.15)
        assert np.mean(positions, axis=0)[:2] == pytest.approx((-0.5, 0.0), abs=0.004)
        assert np.std(yaws) == pytest.approx(0.2, rel=0.15)

    def test_a_class_stands_for_its_bodies_and_a_body_precedes_it(self, kitchen: SimulationImage) -> None:
        plan = Plan(
            steps=(Wait(duration_s=0.05),),
            uncertainty=(
                Uncertainty(thing="ChairSeatH45", position_m=0.01),
                Uncertainty(thing="chair_1", position_m=0.03),
            ),
        )
        moved: dict[str, list[float]] = {"chair_1": [], "chair_2": []}
        with kitchen.restore() as sim:
            start = {id: sim.snapshot().body(BodyId(id)).pose.position[0] for id in moved}
        for index in range(40):
            with kitchen.restore() as sim:
                result = run_plan(sim, plan, index=index)
            for id, values in moved.items():
                values.append(result.end_poses[id].position[0] - start[id])
            assert len([id for id in result.end_poses if id.startswith("chair")]) >= 4
        assert np.std(moved["chair_1"]) > 1.8 * np.std(moved["chair_2"])

    def test_a_sample_depends_on_its_index_and_the_seed_only(self) -> None:
        image = SimulationImage.capture(on_table(BOX))
        plan = Plan(
            steps=(Move(thing="box", to=Pose((0.0, 0.0, BOX_Z))), Wait(duration_s=0.5)),
            uncertainty=(Uncertainty(thing="box", position_m=0.02, mass=0.5, friction=0.5),),
        )

        def sample(index: int, seed: int) -> SampleResult:
            with image.restore() as sim:
                return run_plan(sim, plan, index=index, seed=seed)

        first = sample(3, 1)
        assert sample(4, 1).end_poses != first.end_poses
        assert sample(3, 2).end_poses != first.end_poses
        assert sample(3, 1) == first


class TestValidation:
    @pytest.mark.parametrize(
        ("steps", "message"),
        [
            ([Place(thing="CofeeMug", on="table")], r"steps\[0\].thing: 'CofeeMug' is neither"),
            ([Place(thing="box")], r"steps\[0\]: .*either `on` or `into`"),
            ([Place(thing="box", on="tabel")], r"steps\[0\].on: there is no body 'tabel'; near: 'table'"),
            ([Wait(duration_s=1), Open(thing="box")], r"steps\[1\].thing: no joint"),
            ([Attach(parent="box", child="bx")], r"steps\[0\].child: .*'bx'"),
        ],
    )
    def test_a_plan_that_does_not_fit_the_world_is_refused(self, steps: list[PlanStep], message: str) -> None:
        with on_table(BOX) as sim, pytest.raises(PlanError, match=message):
            validate_plan(Plan(steps=tuple(steps)), sim)

    def test_a_thing_that_an_earlier_step_places_exists_for_later_ones(self) -> None:
        steps = (
            Place(thing="Cup", on="table"),
            Place(thing="Cup", on="table"),
            Move(thing="Cup_2", by=(0.0, 0.0, 0.3)),
        )
        with on_table(BOX) as sim:
            validate_plan(Plan(steps=steps), sim)
            with pytest.raises(PlanError, match="Cup_2"):
                validate_plan(Plan(steps=steps[1:]), sim)
            result = run_plan(sim, Plan(steps=steps))
        assert [event.thing for event in result.events] == ["Cup_2"]

    def test_an_engine_without_dynamics_refuses_uncertain_masses(self) -> None:
        plan = Plan(steps=(Wait(duration_s=1.0),), uncertainty=(Uncertainty(thing="box", mass=0.1),))
        with on_table(BOX, engine=NullEngine()) as sim, pytest.raises(PlanError, match="null cannot vary masses"):
            validate_plan(plan, sim)

    def test_attached_bodies_follow_a_move(self) -> None:
        cube = body("cube", (-0.5, 0.0, BOX_Z + 0.07), (0.04, 0.04, 0.04), "dynamic", 0.1)
        with on_table(BOX, cube, attachment("box", "cube")) as sim:
            result = run_plan(sim, Plan(steps=(Move(thing="box", by=(0.1, 0.0, 0.0)),)))
        assert result.outcome is Outcome.SUCCEEDED
        assert result.end_poses["cube"].position[0] == pytest.approx(-0.4, abs=0.01)
