"""Robots on the page, in a real browser: adding, sliders, handles at grippers, driving, skills, and what is reached."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mindstage import KnowledgeBase, MujocoEngine, NullEngine, Simulation
from mindstage.robots import add_robot, find_robot
from mindstage.robots.robot import Robot
from mindstage.robots.skills import skill_specs
from mindstage.scene import Pose
from mindstage.scene.transforms import Array
from mindstage.viewer import Viewer
from tests.kitchenette import kitchenette
from tests.viewer.fake_page import FakePage, RequestFailedError
from tests.viewer.page_client import connect_page_client
from tests.viewer.page_tab import PageTab
from tests.viewer.waiting import wait_until

START = (0.0, -1.2)
NAME = "mobile_manipulator"


@pytest.fixture(scope="module")
def simulation() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        add_robot(simulation, NAME, Pose((*START, 0.0)))
        simulation.mark_start()
        yield simulation


@pytest.fixture(scope="module")
def viewer(simulation: Simulation) -> Iterator[Viewer]:
    with Viewer(simulation, port=0) as viewer:
        yield viewer


@pytest.fixture
def robot(simulation: Simulation) -> Iterator[Robot]:
    simulation.reset()
    simulation.play()
    yield find_robot(simulation, NAME)
    simulation.pause()


@pytest.fixture
def fake(viewer: Viewer, robot: Robot) -> Iterator[FakePage]:
    page = FakePage(viewer.channel)
    yield page
    page.ask("robots.stop", robot=robot.name)
    page.ask("robots.target", robot=robot.name, arm="arm", shown=False)
    page.ask("robots.region", robot=robot.name, arm="arm", shown=False)


@pytest.fixture
def tab(viewer: Viewer, open_page: Callable[..., PageTab], fake: FakePage) -> PageTab:
    tab = open_page(viewer, view=False)
    tab.open_panel("robot")
    return tab


def shown(tab: PageTab, role: str) -> str:
    return str(tab.page.locator(f"[data-role={role}]").inner_text())


def set_slider(tab: PageTab, selector: str, value: float) -> None:
    script = "(slider, value) => { slider.value = value; slider.dispatchEvent(new Event('change')); }"
    tab.page.locator(selector).evaluate(script, str(value))


def run_skill(tab: PageTab, name: str, **arguments: str) -> None:
    tab.page.locator("[data-role=skill]").select_option(name)
    for argument, value in arguments.items():
        tab.page.locator(f"[data-role=skill-form] input[data-argument={argument}]").fill(value)
    tab.click_button("run-skill")


def drag_handle(viewer: Viewer, pose: Array, phase: str = "update") -> None:
    (handle,) = viewer._robots._handles.values()
    handle._drag(SimpleNamespace(phase=phase, target=SimpleNamespace(position=pose[:3], wxyz=pose[3:])))  # type: ignore[arg-type]


def test_a_joint_moves_to_its_slider_and_the_slider_shows_where_it_is(tab: PageTab, robot: Robot) -> None:
    slider, joint = tab.page.locator("[data-robot-joint=head_pan_joint]"), robot.model.joint("head_pan_joint")
    assert [float(slider.get_attribute(name)) for name in ("min", "max")] == [joint.lower, joint.upper]
    set_slider(tab, "[data-robot-joint=head_pan_joint]", 0.6)
    wait_until(lambda: abs(robot.joint_positions()["head_pan_joint"] - 0.6) < 0.01, "the head turns")
    wait_until(lambda: abs(float(slider.input_value()) - 0.6) < 0.02, "the slider shows it")
    robot.start_trajectory(robot.trajectory_to({"head_pan_joint": -0.4}))
    wait_until(lambda: abs(float(slider.input_value()) + 0.4) < 0.02, "the slider shows what others command")


def test_every_joint_with_a_drive_has_a_slider(tab: PageTab, robot: Robot) -> None:
    names = tab.page.locator("[data-robot-joint]").evaluate_all("all => all.map(each => each.dataset.robotJoint)")
    assert sorted(names) == sorted(joint.name for joint in robot.model.actuated_joints)


def test_a_gripper_opens_as_far_as_its_slider(tab: PageTab, robot: Robot) -> None:
    set_slider(tab, "[data-gripper=gripper]", 0.08)
    wait_until(lambda: abs(robot.opening() - 0.08) < 0.004, "it opens")


def test_the_robot_drives_while_a_button_is_held(tab: PageTab, robot: Robot) -> None:
    before = robot.base_pose()
    tab.page.locator("[data-section=drive] summary").click()
    button = tab.page.locator("[data-drive=Forward]")
    button.dispatch_event("pointerdown")
    wait_until(lambda: robot.base_pose()[0] > before[0] + 0.3, "it drives forward")
    button.dispatch_event("pointerup")
    wait_until(lambda: abs(robot.odometry().vx) < 0.01, "it stops")
    assert abs(robot.base_pose()[1] - before[1]) < 0.05
    wait_until(lambda: f"x {round(robot.base_pose()[0], 2):g} m" in shown(tab, "base-pose"), "its place is shown")


def test_the_gripper_follows_its_handle(tab: PageTab, viewer: Viewer, robot: Robot) -> None:
    tab.page.locator("[data-action=drag-gripper]").check()
    wait_until(lambda: viewer._robots._handles, "the handle is shown")
    (handle,) = viewer._robots._handles.values()
    assert np.allclose(handle._node.position, robot.grasp_pose()[:3], atol=0.02)
    wanted = np.array([START[0] + 0.55, START[1], 0.9, 1.0, 0.0, 0.0, 0.0])
    drag_handle(viewer, wanted)
    wait_until(lambda: np.linalg.norm(robot.grasp_pose()[:3] - wanted[:3]) < 0.01, "the gripper is there")
    assert abs(robot.grasp_pose()[3:] @ wanted[3:]) > 0.999
    far = np.array([START[0] + 4.0, START[1], 0.9, 1.0, 0.0, 0.0, 0.0])
    drag_handle(viewer, far)
    wait_until(lambda: "reach" in shown(tab, "target-reason"), "the reason is shown")
    drag_handle(viewer, far, phase="end")
    wait_until(lambda: np.allclose(handle._node.position, robot.grasp_pose()[:3], atol=0.05), "it is at the gripper")
    tab.page.locator("[data-action=drag-gripper]").uncheck()
    wait_until(lambda: not viewer._robots._handles, "the handle is removed")


def test_a_skill_is_run_and_watched(tab: PageTab, robot: Robot) -> None:
    run_skill(tab, "go_to", x="0.6", y="-1.4", yaw="1.57")
    wait_until(lambda: "go to 0.6" in shown(tab, "skill-result"), "it is shown while it runs")
    wait_until(lambda: "succeeded" in shown(tab, "skill-result"), "it has ended")
    assert np.allclose(robot.base_pose(), (0.6, -1.4, 1.57), atol=0.03)


def test_a_skill_that_fails_says_why_and_what_to_try(tab: PageTab) -> None:
    run_skill(tab, "go_to", x="2.0", y="0.0", yaw="0")
    wait_until(lambda: "failed" in shown(tab, "skill-result"), "it fails")
    assert "Cupboard" in shown(tab, "skill-reason")
    assert "To try" in shown(tab, "skill-result")


def test_a_skill_is_stopped_and_the_robot_stands(tab: PageTab, robot: Robot) -> None:
    run_skill(tab, "go_to", x="-0.6", y="1.8", yaw="3")
    wait_until(lambda: abs(robot.odometry().vx) + abs(robot.odometry().vy) > 0.05, "it drives")
    tab.click_button("stop-robot")
    wait_until(lambda: "canceled" in shown(tab, "skill-result"), "it is canceled")
    place = robot.base_pose()
    assert np.linalg.norm(np.subtract(place[:2], (-0.6, 1.8))) > 0.3
    wait_until(lambda: abs(robot.odometry().vx) + abs(robot.odometry().vy) < 0.005, "it stands")


def test_the_forms_are_those_of_the_skills(tab: PageTab) -> None:
    options = tab.page.locator("[data-role=skill] option").evaluate_all("all => all.map(each => each.value)")
    assert options == list(skill_specs())
    for name, spec in skill_specs().items():
        tab.page.locator("[data-role=skill]").select_option(name)
        fields = tab.page.locator("[data-role=skill-form] [data-argument]")
        assert fields.evaluate_all("all => all.map(each => each.dataset.argument)") == [
            each.name for each in spec.parameters
        ]


def test_what_an_arm_reaches_is_shown(tab: PageTab, viewer: Viewer, robot: Robot) -> None:
    tab.page.locator("[data-action=show-region]").check()
    wait_until(lambda: viewer._robots._regions, "it is shown")
    (node,) = viewer._robots._regions.values()
    points = np.array(node.points)
    assert len(points) > 30
    assert np.allclose(points[:, 2], 0.9)
    assert 0.5 < np.linalg.norm(points[:, :2] - START, axis=1).max() < 1.5
    tab.page.locator("[data-action=show-region]").uncheck()
    wait_until(lambda: not viewer._robots._regions, "it is removed")


def test_robots_are_added_on_the_free_floor_and_removed(tab: PageTab, simulation: Simulation) -> None:
    tab.page.locator("[data-role=robot-model]").select_option(NAME)
    tab.click_button("add-robot")
    wait_until(lambda: len(simulation.robots) == 2, "there are two")
    added = find_robot(simulation, f"{NAME}_2")
    assert np.linalg.norm(np.subtract(added.base_pose()[:2], find_robot(simulation, NAME).base_pose()[:2])) > 0.5
    simulation.step(0.2)
    wait_until(lambda: added.name in tab.page.locator("[data-role=robot]").input_value(), "it is chosen")
    assert not simulation.engine.run(
        lambda engine: [
            each for each in engine.contacts() if each.a in added.body_ids and each.b not in (*added.body_ids, "Floor")
        ]
    )
    tab.click_button("remove-robot")
    wait_until(lambda: list(simulation.robots) == [NAME], "it is removed")
    wait_until(lambda: tab.page.locator("[data-role=robot]").input_value() == NAME, "the other one is chosen")


@pytest.mark.parametrize(
    ("method", "params", "message"),
    [
        ("move_joint", {"joint": "head_pan_joint", "position": 99.0}, "limit"),
        ("move_joint", {"joint": "tail", "position": 0.0}, "tail"),
        ("grip", {"gripper": "gripper", "opening_m": 0.9}, "opens from 0"),
        ("skill", {"skill": "fly"}, "fly"),
        ("skill", {"skill": "open", "args": {"thin": "Fridge"}}, "thin"),
        ("target", {"arm": "leg", "shown": True}, "no such arm"),
        ("stop", {"robot": "r2d2"}, "r2d2"),
        ("drive", {"velocity": [2.0, 0.0, 0.0]}, "velocity"),
    ],
)
def test_a_wrong_request_is_refused(fake: FakePage, method: str, params: dict[str, object], message: str) -> None:
    with pytest.raises(RequestFailedError, match=message):
        fake.ask(f"robots.{method}", **{"robot": NAME, **params})


def test_files_of_the_machine_are_no_models(fake: FakePage) -> None:
    with pytest.raises(RequestFailedError, match="catalog"):
        fake.ask("robots.add", model="/etc/passwd")
    with pytest.raises(RequestFailedError, match="choose one of mobile_manipulator, "):
        fake.ask("robots.add", model="/etc/passwd")


def test_a_robot_that_performs_a_skill_is_not_moved_by_hand(fake: FakePage, robot: Robot) -> None:
    fake.ask("robots.skill", robot=NAME, skill="go_to", args={"x": "-0.6", "y": "1.8", "yaw": "3"})
    with pytest.raises(RequestFailedError, match="performs go_to"):
        fake.ask("robots.move_joint", robot=NAME, joint="head_pan_joint", position=0.1)
    with pytest.raises(RequestFailedError, match="performs go_to"):
        fake.ask("robots.skill", robot=NAME, skill="park", args={})
    fake.ask("robots.stop", robot=NAME)
    fake.ask("robots.move_joint", robot=NAME, joint="head_pan_joint", position=0.1)


def test_an_engine_without_actuators_shows_robots_and_refuses_motions() -> None:
    with Simulation(KnowledgeBase(), NullEngine()) as simulation:
        simulation.spawn(kitchenette())
        with Viewer(simulation, port=0) as viewer:
            page = FakePage(viewer.channel)
            name = page.ask("robots.add", model=NAME, pose=[0.0, -1.2, 0.5])
            assert [each["name"] for each in page.latest_value("robots")] == [name]
            assert find_robot(simulation, name).base_pose() == pytest.approx((0.0, -1.2, 0.5))
            with pytest.raises(RequestFailedError, match="no actuators"):
                page.ask("robots.move_joint", robot=name, joint="head_pan_joint", position=0.1)
            page.ask("robots.remove", robot=name)
            assert page.latest_value("robots") == []


# -- without a browser -------------------------------------------------------------------------------------------------


def robot_state(viewer: Viewer, page: FakePage) -> dict[str, Any]:
    """What pages are told about the robot now."""
    viewer._robots.publish()
    return dict(page.latest_value("robot_states")[NAME])


@pytest.fixture
def listener(viewer: Viewer) -> Iterator[None]:
    """A page, without which states are not published."""
    with connect_page_client(viewer.url) as client:
        wait_until(lambda: viewer.channel.sessions, "it is connected")
        yield
        client.receive()  # a connection with unread messages is closed slowly


def test_a_page_gets_all_joints_with_their_limits_and_groups(fake: FakePage, robot: Robot) -> None:
    (found,) = fake.latest_value("robots")
    model = robot.model
    assert (found["name"], found["model"], found["base"]) == (NAME, model.name, {"type": model.base.type.value})
    assert found["arms"] == [{"name": "arm", "gripper": "gripper"}]
    (gripper,) = model.grippers
    assert found["grippers"] == [{"name": "gripper", "max_opening_m": gripper.max_opening_m}]
    (arm,) = model.arms
    groups = {
        **dict.fromkeys(arm.joints, "arm"),
        **dict.fromkeys(gripper.joints, "gripper"),
        "head_pan_joint": "head",
        "head_tilt_joint": "head",
    }
    assert found["joints"] == [
        {
            "name": joint.name,
            "lower": joint.lower,
            "upper": joint.upper,
            "is_prismatic": "prismatic" in joint.type.value,
            "group": groups.get(joint.name, ""),
        }
        for joint in model.actuated_joints
    ]
    assert any(each["is_prismatic"] for each in found["joints"])
    assert found["sensors"] == [f"{each.name} ({each.type.value})" for each in model.sensors] != []
    assert "/" not in found["source"]


def test_a_page_gets_the_installed_models_and_a_form_for_each_skill(fake: FakePage) -> None:
    offer = fake.ask("robots.offer")
    assert NAME in [each["name"] for each in offer["models"]]
    assert all(each["title"] for each in offer["models"])
    forms = {each["name"]: each for each in offer["skills"]}
    assert list(forms) == list(skill_specs())
    for name, spec in skill_specs().items():
        fields = forms[name]["arguments"]
        assert [(each["name"], each["required"]) for each in fields] == [
            (each.name, each.required) for each in spec.parameters
        ]
        assert all(each["text"] for each in (*fields, forms[name]))
    go_to = {each["name"]: each for each in forms["go_to"]["arguments"]}
    assert {go_to[name]["kind"] for name in ("x", "y", "yaw")} == {"number"}
    (thing,) = (each for each in forms["open"]["arguments"] if each["name"] == "thing")
    assert thing["completion"] == "INDIVIDUAL"


@pytest.mark.usefixtures("listener")
def test_the_state_of_a_robot_follows_its_joints_its_gripper_and_its_base(
    fake: FakePage, viewer: Viewer, robot: Robot
) -> None:
    start = robot_state(viewer, fake)
    assert start["positions"].keys() == robot.joint_positions().keys()
    assert start["held"] == {}
    assert start["skill"] is None or start["skill"]["state"] == "done"  # of a test before this one
    assert start["base"] == pytest.approx((*START, 0.0), abs=0.01)
    fake.ask("robots.move_joint", robot=NAME, joint="head_pan_joint", position=0.6)
    fake.ask("robots.grip", robot=NAME, gripper="gripper", opening_m=0.08)
    wait_until(lambda: abs(robot_state(viewer, fake)["positions"]["head_pan_joint"] - 0.6) < 0.01, "the head turns")
    wait_until(lambda: abs(robot_state(viewer, fake)["openings"]["gripper"] - 0.08) < 0.004, "the gripper opens")


@pytest.mark.parametrize(
    ("velocity", "expected"),
    [
        ((0.0, 0.5, 0.0), (0.0, 0.5, 0.0)),
        ((-1.0, -1.0, 0.0), (-(0.5**0.5), -(0.5**0.5), 0.0)),
        ((0, 0, -1), (0, 0, -1)),
    ],
)
def test_driving_is_in_shares_of_the_largest_velocities(
    fake: FakePage, robot: Robot, velocity: tuple[float, float, float], expected: tuple[float, float, float]
) -> None:
    base = robot.model.base

    def is_there() -> bool:
        fake.ask("robots.drive", robot=NAME, velocity=velocity)
        odometry = robot.odometry()
        found = (odometry.vx / base.velocity, odometry.vy / base.velocity, odometry.wz / base.turn_velocity)
        return bool(np.allclose(found, expected, atol=0.05))

    wait_until(is_there, "it drives as fast")


@pytest.mark.usefixtures("listener")
def test_the_state_of_a_skill_is_that_of_its_steps_and_its_end(fake: FakePage, viewer: Viewer, robot: Robot) -> None:
    def skill() -> dict[str, Any]:
        return dict(robot_state(viewer, fake)["skill"])

    args = {"x": "0.3", "y": "-1.3", "yaw": "0.5"}
    fake.ask("robots.skill", robot=NAME, skill="go_to", args=args)
    assert (skill()["state"], skill()["skill"], skill()["args"]) == ("running", "go_to", args)
    wait_until(lambda: skill()["step"] == "drive to (0.30, -1.30)", "its step is shown")
    wait_until(lambda: skill()["state"] == "done", "it ends")
    assert (skill()["outcome"], skill()["step"]) == ("succeeded", "")
    assert "stands at (0.30, -1.30)" in skill()["reason"]
    assert skill()["time_s"] > 0.3
    assert robot_state(viewer, fake)["base"] == pytest.approx((0.3, -1.3, 0.5), abs=0.03)
    fake.ask("robots.skill", robot=NAME, skill="go_to", args={"x": "2.0", "y": "0.0", "yaw": "0"})
    wait_until(lambda: skill()["state"] == "done", "it ends")
    assert skill()["outcome"] == "failed"
    assert "Cupboard" in skill()["reason"]
    assert skill()["suggestion"]
    fake.ask("robots.skill", robot=NAME, skill="go_to", args={"x": "-0.6", "y": "1.8", "yaw": "3"})
    fake.ask("robots.stop", robot=NAME)
    assert (skill()["state"], skill()["outcome"]) == ("done", "canceled")


@pytest.mark.usefixtures("listener")
def test_handles_and_regions_are_shown_until_they_are_hidden_or_the_robot_is_removed(
    fake: FakePage, viewer: Viewer, simulation: Simulation, robot: Robot
) -> None:
    second = fake.ask("robots.add", model=NAME, pose=[-1.0, 2.0, 0.0])
    for name in (NAME, second):
        fake.ask("robots.target", robot=name, arm="arm", shown=True)
        fake.ask("robots.region", robot=name, arm="arm", shown=True, height_m=0.8)
    states = fake.latest_value("robot_states")
    assert [states[name]["targets"]["arm"] for name in (NAME, second)] == [
        {"shown": True, "reason": "", "region": True}
    ] * 2
    fake.ask("robots.target", robot=second, arm="arm", shown=False)
    states = fake.latest_value("robot_states")
    assert [states[name]["targets"]["arm"]["shown"] for name in (NAME, second)] == [True, False]
    fake.ask("robots.remove", robot=second)
    assert [each["name"] for each in fake.latest_value("robots")] == [NAME]
    assert list(simulation.robots) == [NAME]
    assert fake.latest_value("robot_states").keys() == {NAME}
    again = fake.ask("robots.add", model=NAME, pose=[-1.0, 2.0, 0.0])
    assert again == second
    state = fake.latest_value("robot_states")[again]["targets"]["arm"]
    assert (state["shown"], state["region"]) == (False, False), "nothing of the removed one is left"
    fake.ask("robots.remove", robot=again)
    fake.ask("robots.region", robot=NAME, arm="arm", shown=False)
    assert not fake.latest_value("robot_states")[NAME]["targets"]["arm"]["region"]


@pytest.mark.usefixtures("listener")
def test_a_gripper_goes_where_its_handle_is_dragged_and_the_reason_is_published_if_it_cannot(
    fake: FakePage, viewer: Viewer, robot: Robot
) -> None:
    def reason() -> str:
        return str(robot_state(viewer, fake)["targets"]["arm"]["reason"])

    fake.ask("robots.target", robot=NAME, arm="arm", shown=True)
    wanted = np.array([START[0] + 0.55, START[1], 0.9, 1.0, 0.0, 0.0, 0.0])
    drag_handle(viewer, wanted)
    wait_until(lambda: np.linalg.norm(robot.grasp_pose()[:3] - wanted[:3]) < 0.02, "the gripper is there")
    assert reason() == ""
    drag_handle(viewer, np.array([START[0] + 4.0, START[1], 0.9, 1.0, 0.0, 0.0, 0.0]), phase="end")
    wait_until(lambda: "reach" in reason(), "the reason is published")
