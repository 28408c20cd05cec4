"""Questions about a place with a robot in it: the joints of a robot are neither doors nor drawers."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.questions import question_names
from mindstage.maps import bundled_kitchen
from mindstage.robots import add_robot
from mindstage.scene import Pose
from mindstage.simulation import Simulation
from mindstage.viewer.inspector import TourHandler
from mindstage.viewer.server import RpcChannel
from tests.cases import each_case
from tests.kitchenette import kitchenette
from tests.robots.rooms import robot_in
from tests.viewer.fake_page import FakePage

LISTING_ROBOTS = {"can", "in_room", "pose_of", "what_is", "where_is"}
"""Questions that answer with the bodies of a robot, or with its abilities, if they are asked without arguments."""


@pytest.fixture(scope="module")
def sim() -> Iterator[Simulation]:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    with Simulation(kb, MujocoEngine(), threaded=False) as sim:
        sim.spawn()
        yield sim


@pytest.fixture(scope="module")
def answers_before(sim: Simulation) -> dict[str, list[object]]:
    """The answers to all questions, before a robot is added."""
    found: dict[str, list[object]] = {name: list(sim.ask(name)) for name in question_names()}
    add_robot(sim, "mobile_manipulator", Pose((0.3, 0.2, 0.0)))
    return found


@each_case("name", sorted(set(question_names()) - LISTING_ROBOTS))
def test_a_robot_changes_no_answer_that_is_not_about_bodies(
    sim: Simulation, answers_before: dict[str, list[object]], name: str
) -> None:
    assert list(sim.ask(name)) == answers_before[name]


@pytest.mark.parametrize("name", ["in_room", "pose_of", "what_is", "where_is"])
def test_a_robot_adds_its_bodies_to_answers_about_bodies(
    sim: Simulation, answers_before: dict[str, list[object]], name: str
) -> None:
    assert len(sim.ask(name)) > len(answers_before[name]) > 0


@pytest.mark.usefixtures("answers_before")
def test_the_joints_of_a_robot_open_nothing(sim: Simulation) -> None:
    (column,) = sim.ask("articulated_parts", "base_link").missing
    assert "has no door, drawer or lid that a joint moves" in column.reason
    (lift,) = sim.ask("articulated_parts", part="lift_link").missing
    assert "opens nothing: it is no door, drawer or lid that a joint moves" in lift.reason
    assert not sim.ask("what opens base_link")


@pytest.mark.usefixtures("answers_before")
@pytest.mark.parametrize("question", ["can_open", "reachable_by_pull"])
@pytest.mark.parametrize("part", ["lift_link", "base_link", "gripper_link"])
def test_the_joints_of_a_robot_are_not_pulled_open(sim: Simulation, question: str, part: str) -> None:
    answers = sim.ask(question, part)
    assert [missing.reason for missing in answers.missing] == [
        f"{part} is a part of a robot, whose joints move no door or drawer"
    ]
    assert not answers


def test_the_tour_of_the_page_opens_no_joint_of_a_robot() -> None:
    with robot_in() as robot:
        session = robot.session
        assert isinstance(session, Simulation)
        channel = RpcChannel()
        TourHandler(session, channel, camera=lambda _: None)
        assert FakePage(channel).ask("tour.state")["part"] is None
        session.spawn(kitchenette())
        assert FakePage(channel).ask("tour.state")["part"] == "FridgeDoor"
        channel.close()
