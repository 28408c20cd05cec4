"""Recordings of robots: their joints with efforts, what they were commanded, and their skills as events."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from mindstage.engines.mujoco import MujocoEngine
from mindstage.episodes import Recorder
from mindstage.episodes.episode import Episode
from mindstage.episodes.recording import EpisodeEventKind
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.robots import add_robot
from mindstage.robots.robot import Robot
from mindstage.scene import Pose
from mindstage.simulation import Simulation
from tests.kitchenette import kitchenette


@pytest.fixture
def sim() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        yield sim


@pytest.fixture
def robot(sim: Simulation) -> Robot:
    return add_robot(sim, "mobile_manipulator", Pose((0.0, -4.0, 0.0)))


def test_joint_states_are_recorded_with_velocities_and_efforts(sim: Simulation, robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with Recorder(sim, path):
        start = robot.joint_states()
        goal = robot.start_trajectory(robot.trajectory_to({"lift_joint": 0.8}))
        sim.step(0.6)
        middle = robot.joint_states()
        assert robot.run(robot.waiting(goal))
        end = robot.joint_states()
    with Episode(path) as episode:
        frames = list(episode.frames())
        assert frames[0].drives["lift_joint"].position == pytest.approx(start["lift_joint"].position, abs=1e-6)
        at_middle = episode.frame_at(0.6 + 1e-6).drives
        for name, state in middle.items():
            assert at_middle[name] == pytest.approx((state.position, state.velocity, state.effort), abs=1e-3)
        assert at_middle["lift_joint"].velocity > 0.1
        assert frames[-1].drives["lift_joint"].position == pytest.approx(end["lift_joint"].position, abs=1e-6)
        assert frames[-1].drives.keys() == set(robot.joint_ids)
    with path.open("rb") as file:  # as other programs read them
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        messages = [each.ros_msg for *_, each in _decoded(reader)]
    assert len(messages) > 20
    last = dict(zip(messages[-1].name, messages[-1].position, strict=True))
    assert last["lift_joint"] == pytest.approx(0.8, abs=0.002)
    assert len(messages[0].effort) == len(messages[0].velocity) == len(messages[0].name)


def _decoded(reader) -> Iterator[tuple[object, ...]]:
    for schema, channel, message, ros_msg in reader.iter_decoded_messages(topics=["/robot_joint_states"]):
        yield schema, channel, message, type("Message", (), {"ros_msg": ros_msg})


def test_a_robot_at_rest_is_not_written_in_each_frame(sim: Simulation, robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "rest.mcap"
    sim.step(1.0)
    with Recorder(sim, path):
        sim.step(3.0)
    with path.open("rb") as file:
        count = sum(1 for _ in make_reader(file).iter_messages(topics=["/robot_joint_states"]))
    assert count < 30  # of 90 frames


def test_commands_and_how_they_ended_are_recorded(sim: Simulation, robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with Recorder(sim, path):
        robot.run(robot.moving_to({"lift_joint": 0.6}))
        goal = robot.start_driving([(1.0, -4.0, 0.0)])
        sim.step(0.3)
        goal.cancel()
        for _ in range(5):
            robot.drive(0.0, 0.0, 0.3)
            sim.step(0.1)
        robot.run(robot.gripping("", 0.05))
    with Episode(path) as episode:
        edits = [each for each in episode.edits() if each.kind in {"command", "motion"}]
    commands = [each.details["motion"] for each in edits if each.kind == "command"]
    assert commands == ["trajectory", "path", "velocity", "gripper"]
    assert edits[0].details["positions"] == {"lift_joint": pytest.approx(0.6)}
    assert edits[0].ids == ("base_footprint",)
    ends = {each.details["motion"]: each.details["outcome"] for each in edits if each.kind == "motion"}
    assert ends["trajectory"] == "succeeded"
    assert ends["path"] == "canceled"
    assert edits[1].client == robot.name


def test_a_skill_is_an_event_with_its_outcome(sim: Simulation, robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with Recorder(sim, path):
        sim.step(0.2)
        with robot.performing("pick", {"thing": "Mug"}) as finish:
            sim.step(1.0)
            finish("failed", "the mug is out of reach")
        sim.step(0.5)
        with robot.performing("park", {}):  # closed before it ended
            sim.step(0.3)
        with robot.performing("look_at", {"thing": "Mug"}):
            sim.step(0.1)
    with Episode(path) as episode:
        events = [each for each in episode.events() if each.kind is EpisodeEventKind.PERFORM]
    assert [each.id for each in events] == ["Performing_1", "Performing_2", "Performing_3"]
    pick, park, _ = events
    assert (pick.begin_s, pick.end_s) == pytest.approx((0.2, 1.2), abs=0.05)
    assert (pick.thing, pick.agent) == ("Mug", "base_footprint")
    assert pick.evidence == ("mobile_manipulator performs pick thing=Mug", "failed: the mug is out of reach")
    assert (park.thing, park.evidence[-1]) == ("base_footprint", "canceled")


def test_skills_are_asked_for_as_actions(tmp_path: Path) -> None:
    knowledge, path = KnowledgeBase(), tmp_path / "run.mcap"
    knowledge.load(bundled_kitchen())
    with knowledge, Simulation(knowledge, MujocoEngine(), primitive_shapes=True) as sim:
        sim.spawn()
        robot = add_robot(sim, "mobile_manipulator", Pose((0.0, -4.0, 0.0)))
        with Recorder(sim, path), robot.performing("pick", {"thing": "milk_carton_1"}) as finish:
            sim.step(0.3)
            finish("succeeded", "")
        knowledge.add_episode(Episode(path), name="run")
        actions = knowledge.ask("occurs", "Action", "milk_carton_1", episode="run")
        assert "Performing_1" in [row.name for row in actions]
        (row,) = knowledge.ask("occurs", "Performing", episode="run")
        assert row.thing.endswith("#milk_carton_1")
        assert row.agent.endswith("#base_footprint")


def test_the_links_of_a_robot_are_not_things_that_it_handles(sim: Simulation, robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with Recorder(sim, path):
        robot.run(robot.moving_to({"lift_joint": 0.7, "head_pan_joint": 0.5}))
        robot.run(robot.driving([(0.3, -4.0, 0.5)]))
    with Episode(path) as episode:
        assert not [each for each in episode.events() if each.thing in robot.body_ids]
