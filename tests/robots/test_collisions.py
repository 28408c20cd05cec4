"""Collisions in states that are not simulated, compared with distances that are known, and with the simulation."""

from __future__ import annotations

import numpy as np
import pytest

import mindstage as ms
from mindstage.engines.mujoco import MujocoEngine, regions
from mindstage.engines.mujoco.mujoco_kinematics import ContactModel
from mindstage.robots.collisions import Collision, CollisionChecker, HandChecker, find_part_collision
from mindstage.robots.planning import plan_path
from mindstage.robots.robot_kinematics import RobotKinematics
from mindstage.scene import Body, BodyId, Iri, Joint, Mobility, Pose, World
from mindstage.scene.edits import Attach, SetPoses
from tests.engines.scenes import prismatic_joint, revolute_joint
from tests.kitchenette import kitchenette
from tests.robots.rooms import box, contacts_with, joint_array, reaching, robot_in

HAND = (0.7, 0.0, 0.9)
"""Where the hand is when the arm reaches out."""


def test_a_state_that_is_free_has_no_collision() -> None:
    with robot_in(box("wall", (2.0, 0.0, 1.0), (0.1, 3.0, 2.0))) as robot:
        checker = CollisionChecker(robot, joints=robot.model.arms[0].joints)
        assert checker.find(checker.start) is None
        assert checker.find_at(reaching(robot, *HAND)) is None


def test_the_deepest_collision_names_both_bodies_and_the_distance() -> None:
    with robot_in(box("wall", (0.95, 0.0, 1.0), (0.5, 3.0, 2.0))) as robot:  # its front is at the grasp frame
        found = CollisionChecker(robot, joints=robot.model.arms[0].joints).find_at(reaching(robot, *HAND))
        assert found is not None
        assert found.obstacle == "wall"
        assert found.part in {robot.link_ids["left_finger_link"], robot.link_ids["right_finger_link"]}
        assert -0.1 < found.distance_m < 0.0
        assert str(found) == f"{found.part} is {-1000 * found.distance_m:.0f} mm inside wall"


@pytest.mark.parametrize("gap", [0.004, 0.006])
def test_the_clearance_is_kept_exactly(gap: float) -> None:
    with robot_in(box("wall", (2.0, 0.0, 1.0), (0.1, 3.0, 2.0))) as robot:
        checker = CollisionChecker(robot, joints=(), base_moves=True, clearance_m=0.005)
        near = [x for x in np.arange(1.0, 1.95, 0.001) if checker.find((), (float(x), 0.0, 0.0)) is not None]
        first = checker.find((), (near[0], 0.0, 0.0))
        assert first is not None
        touching = near[0] + first.distance_m  # the x at which it touches
        found = checker.find((), (touching - gap, 0.0, 0.0))
        assert (found is not None) == (gap < 0.005)


def test_states_are_those_of_the_simulation() -> None:
    with robot_in(box("wall", (1.0, 0.0, 1.0), (0.1, 3.0, 2.0))) as robot:
        joints = robot.model.arms[0].joints
        before = CollisionChecker(robot, joints=joints, base_moves=True, clearance_m=0.5, ignore={BodyId("floor")})
        assert robot.run(robot.moving_to(reaching(robot, *HAND)))
        assert robot.run(robot.driving([(-0.1, 0.2, 0.3)]))
        after = CollisionChecker(robot, joints=joints, base_moves=True, clearance_m=0.5, ignore={BodyId("floor")})
        now, base = robot.joint_positions(), robot.base_pose()
        predicted = before.find(joint_array(robot, now), base)
        after._allowed = {}
        measured = after.find(after.start)
        assert predicted is not None
        assert measured is not None
        assert (predicted.part, predicted.obstacle) == (measured.part, measured.obstacle)
        assert predicted.distance_m == pytest.approx(measured.distance_m, abs=1e-5)


def test_contacts_of_the_simulation_are_predicted() -> None:
    with robot_in(box("wall", (1.2, 0.0, 1.0), (0.1, 3.0, 2.0))) as robot:
        checker = CollisionChecker(robot, joints=(), base_moves=True, clearance_m=0.0)
        result = robot.run(robot.driving([(1.2, 0.0, 0.0)]))
        assert not result
        x, y, yaw = robot.base_pose()
        deepest = min(contacts_with(robot, {"wall"}), key=lambda each: -each.depth_m)
        found = checker.find((), (x, y, yaw))
        assert found is not None
        assert found.obstacle == "wall"
        assert found.distance_m == pytest.approx(-deepest.depth_m, abs=1e-3)
        assert checker.find((), (x - 0.01, y, yaw)) is None


def test_links_that_collide_with_each_other_are_found() -> None:
    with robot_in() as robot:
        checker = CollisionChecker(robot, joints=robot.model.arms[0].joints)
        limits = np.array([RobotKinematics(robot.model).limits(joint) for joint in checker.joints])
        own, others = set(robot.link_ids.values()), {"floor"}
        generator = np.random.default_rng(2)
        found = [checker.find(generator.uniform(limits[:, 0], limits[:, 1])) for _ in range(100)]
        pairs = {(each.part, each.obstacle) for each in found if each is not None}
        assert {a for a, _ in pairs} <= own
        assert {b for _, b in pairs} <= own | others
        assert any(b in own for _, b in pairs)
        assert None in found


def test_the_fingers_of_a_closed_gripper_may_press_on_each_other() -> None:
    with robot_in(robot="stretch") as robot:
        gripper = robot.model.grippers[0]
        checker = CollisionChecker(robot, joints=gripper.joints)
        assert checker.find(gripper.closed_positions) is None


def test_bodies_that_are_ignored_are_no_obstacles() -> None:
    with robot_in(box("wall", (0.9, 0.0, 1.0), (0.5, 3.0, 2.0))) as robot:
        joints, state = robot.model.arms[0].joints, reaching(robot, *HAND)
        assert CollisionChecker(robot, joints=joints).find_at(state) is not None
        assert CollisionChecker(robot, joints=joints, ignore={BodyId("wall")}).find_at(state) is None


def test_only_the_hand_may_touch_what_it_grasps() -> None:
    with robot_in() as free:
        now = {**free.joint_positions(), **reaching(free, *HAND)}
        forearm = RobotKinematics(free.model).pose("forearm_roll_link", now)[:3].tolist()
    for position, is_allowed in ((HAND, True), (tuple(forearm), False)):
        with robot_in(box("handle", position, (0.04, 0.04, 0.04))) as robot:
            checker = CollisionChecker(robot, joints=robot.model.arms[0].joints, touch={BodyId("handle")})
            found = checker.find_at(reaching(robot, *HAND))
            assert (found is None) == is_allowed, found


def test_what_is_attached_to_the_hand_collides_too() -> None:
    x, y, z = HAND
    rod = box("rod", (x + 0.1, 2.0, z), (0.3, 0.02, 0.02), Mobility.DYNAMIC, 0.1, floats=True)
    with robot_in(box("wall", (x + 0.55, 0.0, 1.0), (0.5, 3.0, 2.0)), rod) as robot:  # 0.05 m in front of the rod
        assert robot.run(robot.moving_to(reaching(robot, x, y, z)))
        joints, state = robot.model.arms[0].joints, reaching(robot, x + 0.1, y, z)
        assert CollisionChecker(robot, joints=joints, ignore={BodyId("rod")}).find_at(state) is None
        grip = robot.link_ids["gripper_link"]
        robot.session.engine.run(
            lambda engine: engine.apply(SetPoses({BodyId("rod"): Pose((x + 0.1, y, z))})), edits=True
        )
        robot.session.engine.run(lambda engine: engine.apply(Attach(grip, BodyId("rod"))), edits=True)
        holding = CollisionChecker(robot, joints=joints)
        assert holding.find_at(reaching(robot, x, y, z + 0.05)) is None
        found = holding.find_at(state)
        assert found is not None
        assert (found.part, found.obstacle) == ("rod", "wall")
        assert found.distance_m == pytest.approx(-0.05, abs=0.003)


def test_a_thing_held_by_friction_moves_with_the_hand() -> None:
    x, y, z = HAND
    carton = box("carton", (x, y, z), (0.06, 0.06, 0.2), Mobility.DYNAMIC, 0.3)
    table = box("table", (x + 0.1, y, (z - 0.1) / 2), (0.3, 1.0, z - 0.1))
    with robot_in(carton, table) as robot:
        assert robot.run(robot.gripping("gripper", 0.12))
        assert robot.run(robot.moving_to(reaching(robot, x - 0.25, y, z)))
        assert robot.run(robot.following(plan_path(robot, "", [Pose(HAND)], touch={BodyId("carton")})))
        assert robot.run(robot.gripping("gripper", 0.0))
        assert robot.held == {"gripper": "carton"}
        checker = CollisionChecker(robot, joints=robot.model.arms[0].joints)
        now = robot.joint_positions()
        assert checker.find_at({**now, "lift_joint": now["lift_joint"] + 0.1}) is None
        found = checker.find_at({**now, "lift_joint": now["lift_joint"] - 0.05})
        assert found is not None
        assert (found.part, found.obstacle) == ("carton", "table")
        assert found.distance_m == pytest.approx(-0.05, abs=0.004)


def test_a_pair_that_is_too_near_at_the_start_may_stay_so() -> None:
    with robot_in(box("wall", (2.0, 0.0, 1.0), (0.1, 3.0, 2.0))) as far:
        checker = CollisionChecker(far, joints=(), base_moves=True)
        near = next(x for x in np.arange(1.0, 1.95, 0.001) if checker.find((), (float(x), 0.0, 0.0)) is not None)
    with robot_in(box("wall", (2.0, 0.0, 1.0), (0.1, 3.0, 2.0)), at=(float(near), 0.0, 0.0)) as robot:
        checker = CollisionChecker(robot, joints=(), base_moves=True)
        assert checker.find((), (float(near), 0.0, 0.0)) is None
        assert checker.find((), (float(near) - 0.1, 0.0, 0.0)) is None
        assert checker.find((), (float(near) + 0.003, 0.0, 0.0)) is not None


def test_a_joint_of_the_place_can_be_moved() -> None:
    with robot_in(at=(0.4, 1.0, 0.0)) as robot:
        assert not robot.session.spawn(kitchenette()).failed_joints
        checker = CollisionChecker(robot, joints=(), base_moves=True)
        place = (1.15, 0.75, 0.0)
        assert checker.find((), place) is None
        found = []
        for position in (-0.7, 0.7):
            checker.set_joint(BodyId("FridgeHinge"), position)
            found.append(checker.find((), place))
        towards = [each for each in found if each is not None]
        assert [each.obstacle for each in towards] in (["FridgeDoor"], ["FridgeHandle"])


def test_what_rests_in_a_drawer_moves_with_it_and_what_stands_above_does_not() -> None:
    inside, above = ("coffee_mug_1", "coffee_mug_2", "coffee_mug_3"), ("wooden_pepper_mill_1", "red_apple_1")
    with ms.open("bundled:kitchen") as sim:
        drawer = sim.joint("drawer_right_1")
        sim.step(0.5)
        contacts = sim.engine.run(lambda engine: ContactModel(engine.compiled(), moving=()))

        def positions(*ids: str) -> np.ndarray:
            return np.array([contacts.pose(BodyId(id))[:3] for id in ids])

        moved, still = positions("drawer_right_1", *inside), positions(*above)
        for part in (0.3, 0.8, 0.0):
            contacts.set_joint(drawer.id, part * drawer.open_position)
            contacts.update()
            ways = positions("drawer_right_1", *inside) - moved
            assert np.linalg.norm(ways[0]) == pytest.approx(part * abs(drawer.open_position), abs=1e-3)
            assert ways == pytest.approx(np.tile(ways[0], (len(ways), 1)), abs=1e-9)
            assert (positions(*above) == still).all()


def test_own_links_keep_apart_but_those_of_a_telescope_are_closer() -> None:
    """Stretch rolls its gripper beside its arm, with the telescope drawn in."""
    with robot_in(robot="stretch") as robot:
        rest = robot.joint_positions()
        checker = CollisionChecker(robot)
        assert checker.find_at(rest) is None
        rolls = np.arange(1.8, 2.4, 0.005).tolist()
        turned = (checker.find_at({**rest, "joint_wrist_yaw": 2.0, "joint_wrist_roll": roll}) for roll in rolls)
        first = next(found for found in turned if found is not None)
        assert {first.part, first.obstacle} == {robot.link_ids["link_arm_l0"], robot.link_ids["link_straight_gripper"]}
        assert 0.0005 < first.distance_m < first.least_m


def hall(rng: np.random.Generator, places: int = 60) -> tuple[list[Body], list[Joint]]:
    """Tables with boxes on them, cabinets with doors, and chests with drawers, along a hall of 60 m."""
    bodies, joints = list[Body](), list[Joint]()
    for n in range(places):
        x, y = float(n - places / 2 + rng.uniform(-0.2, 0.2)), float(rng.choice([-1.2, 1.2]))
        side = float(np.sign(y))
        kind = rng.choice(["table", "door", "drawer", "loose"])
        if kind == "table":
            bodies.append(box(f"table{n}", (x, y, 0.4), (0.6, 0.8, 0.8)))
            bodies.append(box(f"cup{n}", (x, y - side * 0.2, 0.86), (0.08, 0.08, 0.12), Mobility.DYNAMIC, 0.3))
        elif kind == "loose":
            size = tuple(rng.uniform(0.15, 0.5, 3).tolist())
            bodies.append(box(f"box{n}", (x, y * 0.8, size[2] / 2), size, Mobility.DYNAMIC, 3.0))
        else:
            part, size = (f"{kind}{n}", (0.5, 0.02, 0.7) if kind == "door" else (0.45, 0.5, 0.15))
            front = y - side * (0.31 if kind == "door" else 0.02)
            bodies.append(box(f"case{n}", (x, y + side * 0.05, 0.4), (0.55, 0.6, 0.8 if kind == "door" else 0.3)))
            bodies.append(box(part, (x, front, 0.4 if kind == "door" else 0.65), size, Mobility.DYNAMIC, 2.0))
            at = (x - 0.25, front, 0.4) if kind == "door" else (x, front, 0.65)
            make = revolute_joint if kind == "door" else prismatic_joint
            joints.append(make(f"joint{n}", f"case{n}", part, at))
            if kind == "door" and rng.random() < 0.5:
                bodies.append(box(f"post{n}", (x + 0.1, front - side * 0.2, 0.5), (0.05, 0.05, 1.0)))
    return bodies, joints


@pytest.mark.parametrize("seed", range(2))
def test_in_a_world_of_many_regions_verdicts_are_those_of_one_model_of_all(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The referee compiles the whole world; the robot stands anywhere, moves its arm and holds something."""
    monkeypatch.setattr(regions, "REGION_BODIES", 8)
    rng = np.random.default_rng(seed)
    bodies, joints = hall(rng)
    position = World(iri=Iri("http://example.org/room#hall"), bodies=tuple(bodies), joints=tuple(joints))
    rod = box("rod", (-29.0, 3.0, 1.0), (0.3, 0.02, 0.02), Mobility.DYNAMIC, 0.1, floats=True)
    with robot_in(rod, at=(-29.0, 0.0, 0.0), floor=(80.0, 8.0)) as robot:
        assert not robot.session.spawn(position).failed_joints
        x, y, z = robot.link_pose("gripper_link")[:3].tolist()
        robot.session.apply(SetPoses({BodyId("rod"): Pose((x + 0.2, y, z))}))
        robot.session.apply(Attach(robot.link_ids["gripper_link"], BodyId("rod")))
        robot.session.step(0.1)
        arm, gripper = robot.model.arms[0].joints, robot.model.grippers[0]

        def checkers() -> tuple[CollisionChecker, HandChecker]:
            return CollisionChecker(robot, joints=arm, base_moves=True), HandChecker(robot, gripper)

        def stops() -> list[tuple[int, Collision] | None]:
            ways = {each: np.linspace(0.0, -1.0 if "door" in each.child else 0.4, 9).tolist() for each in joints}
            return [find_part_collision(robot, [each.child], each.id, way) for each, way in ways.items()]

        near, near_hand = checkers()
        near_stops = stops()
        monkeypatch.setattr(MujocoEngine, "compiled_near", lambda engine, ids, **options: engine.compiled())
        far, far_hand = checkers()
        far_stops = stops()
        monkeypatch.undo()
        limits = np.array([RobotKinematics(robot.model).limits(joint) for joint in arm]).clip(-3.0, 3.0)
        fingers = dict(zip(gripper.joints, gripper.open_positions, strict=True))
        verdicts, counts = list[bool](), list[int]()
        for number in range(80):
            if number % 20 == 10:
                opened, position_m = joints[rng.integers(len(joints))].id, float(rng.uniform(-0.6, 0.6))
                for checker in (near, far, near_hand, far_hand):
                    checker.set_joint(opened, position_m)
            values = rng.uniform(limits[:, 0], limits[:, 1]) if number % 2 else np.array(near.start)
            base = (float(rng.uniform(-30.0, 30.0)), float(rng.uniform(-0.9, 0.9)), float(rng.uniform(-3.0, 3.0)))
            expected = far.find(values, base)
            assert_same(near.find(values, base), expected)
            verdicts.append(expected is None)
            counts.append(len(near._vicinities.last.ids))
            hand = Pose(tuple(rng.uniform((-30.0, -1.2, 0.3), (30.0, 1.2, 1.2)).tolist()))
            assert_same(near_hand.find(hand, fingers), far_hand.find(hand, fingers))
        assert 10 < sum(verdicts) < 70
        assert len(set(counts)) > 5
        assert np.median(counts) < len(far._vicinities.last.ids) * 0.6, "30 are the robot's own links"
        for found, stop in zip(near_stops, far_stops, strict=True):
            assert_same(None if found is None else found[1], None if stop is None else stop[1])
            assert found is None or stop is None or found[0] == stop[0]
        assert any(stop is not None for stop in far_stops)


def assert_same(found: Collision | None, expected: Collision | None) -> None:
    if found is None or expected is None:
        assert found == expected
    else:
        assert (found.part, found.obstacle) == (expected.part, expected.obstacle)
        assert found.distance_m == pytest.approx(expected.distance_m, abs=1e-9)
