"""What skills may call a success: forces come from contacts, contents stay inside, reasons name what is in the way."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import mujoco
import numpy as np
import pytest

import mindstage as ms
from mindstage.engines.base import Engine
from mindstage.robots import add_robot, find_robot
from mindstage.robots.robot import Robot
from mindstage.robots.skill_task import SkillTask
from mindstage.robots.skills import SkillOutcome, SkillResult, SkillStep, can_open, start_skill
from mindstage.robots.skills.doors import moving_part
from mindstage.robots.skills.manipulator import with_lift
from mindstage.scene import (
    AngularLimits,
    Attachment,
    AxisMotion,
    BodyId,
    Iri,
    Joint,
    LinearLimits,
    Mobility,
    Pose,
    Vector,
    World,
)
from mindstage.scene.edits import SetPoses
from mindstage.scene.transforms import quat_rotate
from tests.kitchenette import kitchenette
from tests.robots.models.installed import known_model
from tests.robots.rooms import box, robot_in


class Referee:
    """Reads MuJoCo's state at each step: what the skills themselves state is not used."""

    def __init__(self, robot: Robot, thing: str) -> None:
        self.fingers = {str(robot.link_ids[each]) for each in robot.model.grippers[0].finger_links}
        self.thing = thing
        self.nearest_m = np.inf
        """Least distance of the fingers from the thing."""
        self.helped: set[str] = set()
        """What moved bodies other than contacts, joints and drives."""

    def look(self, engine: Engine) -> None:
        compiled = engine.compiled()  # type: ignore[attr-defined]
        model, data = compiled.model, compiled.data
        names = {row: str(id) for id, row in compiled.rows.items()}
        of = [names.get(int(row), "") for row in compiled.geom_rows]
        for a in range(model.ngeom):
            for b in range(model.ngeom) if of[a] in self.fingers else ():
                if of[b] == self.thing:
                    self.nearest_m = min(self.nearest_m, mujoco.mj_geomDistance(model, data, a, b, 1.0, np.zeros(6)))
        if data.xfrc_applied.any() or data.qfrc_applied.any():
            self.helped.add("applied force")
        if (model.eq_type[data.eq_active.astype(bool)] == mujoco.mjtEq.mjEQ_WELD).any():
            self.helped.add("weld")
        hand = {model.body_rootid[compiled.body_ids[BodyId(each)]] for each in self.fingers}
        if model.body_rootid[compiled.body_ids.get(BodyId(self.thing), 0)] in hand:
            self.helped.add("attachment")


def perform(
    robot: Robot,
    name: str,
    thing: str,
    *,
    referee: Referee | None = None,
    on_step: Callable[[SkillStep], object] | None = None,
) -> SkillResult:
    """Performs a skill, with a look of the referee at each step."""
    motion = start_skill(robot, name, {"thing": thing}, on_step=on_step)
    while True:
        try:
            robot.session.step(next(motion))
        except StopIteration as end:
            result: SkillResult = end.value
            return result
        if referee is not None:
            robot.session.engine.run(referee.look, label="referee")


@contextmanager
def opened(world: World, folder: Path) -> Iterator[Robot]:
    """A robot in front of the small kitchen."""
    ms.save(world, folder / "map.owl")
    with ms.open(folder / "map.owl") as simulation:
        add_robot(simulation, "mobile_manipulator", Pose((0.6, 0.0, 0.0)))
        simulation.step(0.2)
        yield find_robot(simulation)


def with_size(world: World, id: str, size: Vector) -> World:
    bodies = tuple(msgspec.structs.replace(each, size=size) if each.id == id else each for each in world.bodies)
    return msgspec.structs.replace(world, bodies=bodies)


def with_body(world: World, id: str, position: Vector, size: Vector) -> World:
    return msgspec.structs.replace(world, bodies=(*world.bodies, box(id, position, size)))


def with_joint(world: World, joint: Joint) -> World:
    return msgspec.structs.replace(world, joints=(*world.joints, joint))


@pytest.mark.parametrize(
    ("handle", "is_held"),
    [((0.04, 0.2, 0.02), True), ((0.04, 0.02, 0.02), True), ((0.04, 0.04, 0.04), True), ((0.04, 0.3, 0.17), False)],
    ids=["bar", "pin", "knob", "slab"],
)
def test_a_drawer_is_opened_by_fingers_that_touch_its_handle_or_not_at_all(
    tmp_path: Path, handle: Vector, is_held: bool
) -> None:
    with opened(with_size(kitchenette(), "DrawerHandle", handle), tmp_path) as robot:
        referee = Referee(robot, "DrawerHandle")
        result = perform(robot, "open", "Drawer", referee=referee)
        robot.session.step(1.0)
        openness = robot.session.joint("Drawer").openness
    assert not referee.helped
    assert not result.assumptions
    assert bool(result) is is_held, result.reason
    assert openness > 0.94 if is_held else openness < 0.02
    assert not is_held or referee.nearest_m < 0.001


@pytest.fixture(scope="module")
def room() -> Iterator[Robot]:
    """A counter with a mug, and a block that is too wide for the gripper."""
    bodies = (
        box("counter", (1.2, 0.0, 0.35), (0.6, 1.6, 0.7)),
        box("mug", (1.0, 0.0, 0.76), (0.06, 0.06, 0.12), Mobility.DYNAMIC, 0.2),
        box("block", (1.05, 0.48, 0.78), (0.16, 0.16, 0.16), Mobility.DYNAMIC, 0.3),
        box("card", (0.98, -0.4, 0.7015), (0.085, 0.054, 0.003), Mobility.DYNAMIC, 0.01),
        box("vase", (1.05, -0.6, 0.76), (0.06, 0.06, 0.12)),
    )
    with robot_in(*bodies, floor=(4.0, 4.0), at=(0.45, 0.0, 0.0)) as robot:
        robot.session.step(0.2)
        yield robot


@pytest.mark.parametrize("gap_m", [0.002, 0.033, 0.16])
def test_fingers_that_close_beside_a_thing_hold_nothing(room: Robot, gap_m: float) -> None:
    room.session.reset()
    room.session.step(0.2)
    referee = Referee(room, "mug")

    def move_away(step: SkillStep) -> None:
        """Puts the mug beside the open fingers, just before they close."""
        if step.name == "close gripper" and step.end_s is None:
            pose = room.session.snapshot().body("mug").pose
            aside = quat_rotate(room.grasp_pose()[3:], (0.0, 1.0, 0.0)) * (0.06 + 0.02 + 0.03 + gap_m)
            x, y, _ = (np.array(pose.position) + aside).tolist()
            room.session.apply(SetPoses({BodyId("mug"): Pose((x, y, pose.position[2]), pose.quaternion)}))

    result = perform(room, "grasp", "mug", referee=referee, on_step=move_away)
    assert result.outcome is SkillOutcome.FAILED
    assert result.reason == "the gripper closed without mug between its fingers"
    assert not result.state.held
    assert not referee.helped


def test_what_is_too_wide_is_not_picked_up_and_the_reason_has_both_widths(room: Robot) -> None:
    room.session.reset()
    room.session.step(0.2)
    result = perform(room, "pick", "block")
    assert result.outcome is SkillOutcome.FAILED
    assert "0.160 m across, the opening is 0.120 m" in result.reason


@pytest.mark.parametrize("skill", ["pick", "grasp"])
def test_what_is_fixed_is_not_said_to_slip(room: Robot, skill: str) -> None:
    room.session.reset()
    result = perform(room, skill, "vase")
    assert result.outcome is SkillOutcome.FAILED
    assert result.reason == "vase is fixed: its mobility is static"
    assert not result.steps


def test_a_torso_that_two_arms_share_moves_with_the_arm_of_a_skill_and_stays_when_it_is_folded() -> None:
    model = known_model("pr2")
    arm = with_lift(model, model.arms[0])
    assert arm.joints == (*model.arms[0].joints, "torso_lift_joint")
    assert "torso_lift_joint" not in dict(zip(arm.joints, arm.rest_positions, strict=False))
    own = known_model("mobile_manipulator")
    assert with_lift(own, own.arms[0]) == own.arms[0]


def test_a_door_that_is_open_by_more_is_open_enough_to_get_at_what_is_behind_it(tmp_path: Path) -> None:
    with opened(kitchenette(), tmp_path) as robot:
        robot.session.joint("FridgeDoor").open()
        task = SkillTask(robot)
        part = task.surroundings().articulated_part(BodyId("FridgeDoor"))
        assert list(moving_part(task, part, 0.7, at_least=True)) == []
        assert next(moving_part(task, part, 0.7), None) is not None


def _slide(id: str, **limits: float) -> Joint:
    motion = {"x": AxisMotion.LIMITED, "limit": limits["limit"]} if limits else {"x": AxisMotion.FREE}
    return Joint(
        id=BodyId(id), iri=Iri(f"http://example.org/{id}"), parent=BodyId("Fridge"), child=BodyId("FridgeDoor"),
        pose=Pose((1.68, 1.3, 0.9)), linear=LinearLimits(**motion),  # type: ignore[arg-type]
    )  # fmt: skip


def test_a_door_that_slides_along_its_front_is_opened_from_before_it(tmp_path: Path) -> None:
    world = kitchenette()
    slide = msgspec.structs.replace(
        _slide("FridgeSlide", limit=0.4), linear=LinearLimits(y=AxisMotion.LIMITED, limit=0.4)
    )
    rest = [each for each in world.joints if each.id != "FridgeHinge"]
    world = msgspec.structs.replace(world, joints=(*rest, slide))
    pointing: list[float] = []

    def look(step: SkillStep) -> None:
        if step.name == "close gripper":
            pointing.append(float(quat_rotate(robot.grasp_pose()[3:], (1.0, 0.0, 0.0))[0]))

    with opened(world, tmp_path) as robot:
        result = perform(robot, "open", "FridgeDoor", on_step=look)
        openness = robot.session.joint("FridgeDoor").openness
    assert result, result.reason
    assert openness > 0.94
    assert min(pointing) > 0.95  # not along its motion, where its neighbors are


def test_a_door_with_two_joints_concerns_only_skills_about_that_door(tmp_path: Path) -> None:
    with opened(with_joint(kitchenette(), _slide("SecondSlide", limit=0.2)), tmp_path) as robot:
        assert can_open(robot, "Drawer")
        result = perform(robot, "open", "FridgeDoor")
    assert result.outcome is SkillOutcome.FAILED
    assert "may be any of 2 joint names: FridgeHinge, SecondSlide" in result.reason


def test_of_two_joints_the_one_with_a_range_opens_a_door(tmp_path: Path) -> None:
    with opened(with_joint(kitchenette(), _slide("FreeSlide")), tmp_path) as robot:
        assert can_open(robot, "Drawer")
        assert can_open(robot, "FridgeDoor").part == "FridgeDoor"


def test_a_door_without_a_range_says_so_and_others_open(tmp_path: Path) -> None:
    world = kitchenette()
    hinge = msgspec.structs.replace(world.joints[1], angular=AngularLimits(swing1=AxisMotion.FREE))
    with opened(msgspec.structs.replace(world, joints=(world.joints[0], hinge)), tmp_path) as robot:
        assert can_open(robot, "Drawer")
        result = perform(robot, "open", "FridgeDoor")
    assert "no joint of it has a range" in result.reason


def test_what_falls_out_of_a_drawer_fails_the_skill_that_opened_it(tmp_path: Path) -> None:
    with opened(kitchenette(), tmp_path) as robot:
        mug = BodyId("Mug")
        robot.session.place(mug, into="Drawer")
        robot.session.step(0.2)
        ride = perform(robot, "open", "Drawer")
        robot.session.reset()
        robot.session.place(mug, into="Drawer")
        robot.session.step(0.2)

        def take_out(step: SkillStep) -> None:
            if step.name == "open" and step.end_s is not None:
                robot.session.apply(SetPoses({mug: Pose((0.5, 1.5, 0.05))}))

        lost = perform(robot, "open", "Drawer", on_step=take_out)
        openness = robot.session.joint("Drawer").openness
    assert ride, ride.reason
    assert lost.outcome is SkillOutcome.FAILED
    assert "what was inside did not stay there: Mug is on Floor" in lost.reason
    assert openness > 0.9


def test_what_stops_a_drawer_on_its_way_is_named(tmp_path: Path) -> None:
    pillar = with_body(kitchenette(), "Pillar", (1.48, 0.23, 0.65), (0.04, 0.03, 0.1))  # 0.2 m before the front
    with opened(pillar, tmp_path) as robot:
        reach = can_open(robot, "Drawer")
        result = perform(robot, "open", "Drawer")
        openness = robot.session.joint("Drawer").openness
    assert not reach
    assert reach.obstacle == "Pillar"
    assert "inside Pillar" in reach.reason
    assert reach.openness == pytest.approx(openness, abs=0.1)
    assert result.outcome is SkillOutcome.FAILED
    assert "Pillar" in result.reason


@pytest.mark.parametrize("overlap_m", [0.0, 0.005])
def test_closed_fronts_that_touch_do_not_block_each_other(tmp_path: Path, overlap_m: float) -> None:
    world = kitchenette()
    front = (0.5, 0.5, 0.2)
    lower = box("LowerDrawer", (1.95, 0.0, 0.45 + overlap_m), front, Mobility.DYNAMIC, 4.0)
    lower = msgspec.structs.replace(lower, cls=world.body("Drawer").cls)
    joint = msgspec.structs.replace(
        world.joints[0], id=BodyId("LowerSlide"), iri=Iri("http://example.org/LowerSlide"), child=BodyId("LowerDrawer"),
        pose=Pose((1.95, 0.0, 0.45 + overlap_m)),
    )  # fmt: skip
    world = msgspec.structs.replace(world, bodies=(*world.bodies, lower), joints=(*world.joints, joint))
    with opened(world, tmp_path) as robot:
        assert can_open(robot, "Drawer")
        result = perform(robot, "open", "Drawer")
        lower_moved = robot.session.joint("LowerDrawer").openness
    assert result, result.reason
    assert lower_moved < 0.05


def test_a_knob_that_is_attached_to_a_front_is_its_handle(tmp_path: Path) -> None:
    world = kitchenette()
    knob = world.body("DrawerHandle").cls.replace("#Handle", "#ControlKnob")
    bodies = [
        msgspec.structs.replace(each, cls=Iri(knob)) if each.id == "DrawerHandle" else each for each in world.bodies
    ]
    rack = box("Rack", (2.22, 0.0, 0.65), (0.03, 0.2, 0.03), Mobility.KINEMATIC)  # behind the drawer
    attached = Attachment(parent=BodyId("Drawer"), child=BodyId("Rack"))
    world = msgspec.structs.replace(world, bodies=(*bodies, rack), attachments=(*world.attachments, attached))
    with opened(world, tmp_path) as robot:
        part = SkillTask(robot).surroundings().articulated_part(BodyId("Drawer"))
        assert part.handle == "DrawerHandle"
        assert can_open(robot, "Drawer")
