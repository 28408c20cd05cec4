"""Actions: feedback, cancellation and the loss of the client, over rosbridge and actionlib."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from mindstage.bridge import ClientGoalHandle, GoalStatus, LocalNode, RosbridgeClient, RosbridgeServer
from mindstage.bridge.conversions import world_to_json
from mindstage.engines import NullEngine
from mindstage.engines.base import Applied
from mindstage.knowledge import KnowledgeBase
from mindstage.ros import RosInterface, RosVersion
from mindstage.scene.edits import Edit
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, RawClient, eventually
from tests.kitchenette import kitchenette

STEPS = "/unreal/simulate_steps"
STEPS_TYPE = "simulation_interfaces/SimulateSteps"
FOR_EVER = 10**9
ACTIVE, PREEMPTED, SUCCEEDED, ABORTED, REJECTED = 1, 2, 3, 4, 5


def stands_still(simulation: Simulation) -> bool:
    before = simulation.state.time_s
    time.sleep(0.05)
    return simulation.state.time_s == before


@pytest.fixture
def send(ros_interface: RosInterface, local_node: LocalNode) -> Iterator[Callable[..., ClientGoalHandle]]:
    sent: list[ClientGoalHandle] = []

    def send(action: str, args: dict[str, Any], **options: Any) -> ClientGoalHandle:
        type = STEPS_TYPE if action == STEPS else "mindstage_msgs/Simulate"
        sent.append(local_node.send_goal(action, type, args, **options))
        return sent[-1]

    yield send
    for goal in sent:
        goal.cancel()


# -- the way of ROS 2 --------------------------------------------------------------------------------------------------


def test_simulate_steps_sends_feedback(send: Any, simulation: Simulation) -> None:
    feedback_values: list[Any] = []
    before = simulation.state.time_s
    outcome = send(STEPS, {"steps": 50}, on_feedback=feedback_values.append).wait(TIMEOUT_S)
    assert outcome.status is GoalStatus.SUCCEEDED
    assert outcome.values == {"result": {"result": 1, "error_message": ""}}
    assert simulation.state.time_s - before == pytest.approx(0.1)
    assert feedback_values == [{"completed_steps": n, "remaining_steps": 50 - n} for n in range(1, 51)]


def test_a_long_goal_sends_feedback_periodically(send: Any, simulation: Simulation) -> None:
    feedback_values: list[Any] = []
    outcome = send(STEPS, {"steps": 1500}, on_feedback=feedback_values.append).wait(TIMEOUT_S)
    assert outcome.status is GoalStatus.SUCCEEDED
    assert feedback_values[0] == {"completed_steps": 0, "remaining_steps": 1500}
    assert feedback_values[-1] == {"completed_steps": 1500, "remaining_steps": 0}
    assert len(feedback_values) < 100


def test_simulate_sends_feedback(send: Any, simulation: Simulation) -> None:
    feedback_values: list[Any] = []
    before = simulation.state.time_s
    outcome = send("/unreal/mindstage/simulate", {"duration_s": 0.55}, on_feedback=feedback_values.append).wait(
        TIMEOUT_S
    )
    assert outcome.status is GoalStatus.SUCCEEDED
    assert outcome.values["time_s"] - before == pytest.approx(0.55, abs=2e-3)
    assert feedback_values[0] == {"elapsed_s": 0.0, "remaining_s": 0.55}


def test_canceling_a_goal_stops_the_simulation(send: Any, simulation: Simulation) -> None:
    feedback_values: list[Any] = []
    goal = send(STEPS, {"steps": FOR_EVER}, on_feedback=feedback_values.append)
    eventually(lambda: len(feedback_values) >= 2)
    goal.cancel()
    outcome = goal.wait(TIMEOUT_S)
    assert outcome.status is GoalStatus.CANCELED
    assert outcome.values["result"] == {"result": 4, "error_message": "it was canceled"}
    assert stands_still(simulation)


def test_feedback_is_sent_at_least_twice_a_second(send: Any) -> None:
    """The interval of 0.4 s is a constant; only the repetition is tested."""
    moments: list[float] = []
    goal = send(STEPS, {"steps": FOR_EVER}, on_feedback=lambda _: moments.append(time.monotonic()))
    eventually(lambda: len(moments) >= 4)
    goal.cancel()
    assert goal.wait(TIMEOUT_S).status is GoalStatus.CANCELED


def test_stepping_is_exclusive_and_not_allowed_while_playing(send: Any, simulation: Simulation) -> None:
    feedback_values: list[Any] = []
    first = send(STEPS, {"steps": FOR_EVER}, on_feedback=feedback_values.append)
    eventually(lambda: feedback_values)
    second = send(STEPS, {"steps": 1}).wait(TIMEOUT_S)
    assert second.status is GoalStatus.ABORTED
    assert second.values["result"]["result"] == 4
    assert "another call is stepping it" in second.values["result"]["error_message"]
    first.cancel()
    first.wait(TIMEOUT_S)
    simulation.play()
    assert send(STEPS, {"steps": 1}).wait(TIMEOUT_S).values["result"]["result"] == 4


def test_a_goal_times_out(simulation: Simulation) -> None:
    with LocalNode() as local_node, RosInterface(simulation, local_node, goal_timeout_s=0.2):
        goal = local_node.send_goal(STEPS, STEPS_TYPE, {"steps": FOR_EVER})
        with pytest.raises(Exception, match=r"simulate_steps did not finish within 0\.2 s"):
            goal.wait(TIMEOUT_S)
        assert local_node.call_service("/unreal/get_simulation_state")["result"]["result"] == 1


def test_an_invalid_goal_is_rejected_with_the_path(send: Any) -> None:
    with pytest.raises(Exception, match="steps: expected int, got str"):
        send(STEPS, {"steps": "many"}).wait(TIMEOUT_S)


def test_a_goal_whose_client_disconnected_is_canceled(
    make_raw_client: Callable[[], RawClient], simulation: Simulation
) -> None:
    client = make_raw_client()
    client.send_operation(
        op="send_action_goal", id="g", action=STEPS, action_type=STEPS_TYPE, args={"steps": FOR_EVER}, feedback=True
    )
    client.receive("action_feedback", id="g")
    client.kill()
    eventually(lambda: stands_still(simulation))


class SlowEngine(NullEngine):
    """Spawns only when the test allows it."""

    def __init__(self) -> None:
        super().__init__()
        self.spawning = threading.Event()
        self.go_on = threading.Event()

    def apply(self, edit: Edit) -> Applied:
        self.spawning.set()
        assert self.go_on.wait(TIMEOUT_S)
        return super().apply(edit)


def test_spawning_sends_feedback_and_is_undone_when_canceled(knowledge: KnowledgeBase) -> None:
    engine = SlowEngine()
    feedback_values: list[Any] = []
    with Simulation(knowledge, engine) as simulation, LocalNode() as local_node, RosInterface(simulation, local_node):
        goal = {"world": world_to_json(kitchenette())}
        sent = local_node.send_goal(
            "/unreal/mindstage/spawn_map", "mindstage_msgs/SpawnMap", goal, on_feedback=feedback_values.append
        )
        assert engine.spawning.wait(TIMEOUT_S)
        eventually(lambda: sum(each["phase"] == "spawning" for each in feedback_values) >= 3)
        sent.cancel()
        received = len(feedback_values)  # the loop delivers in order: feedback sent later shows that the cancel came
        eventually(lambda: len(feedback_values) >= received + 3)
        engine.go_on.set()
        assert sent.wait(TIMEOUT_S).status is GoalStatus.CANCELED
        assert simulation.state.ids == ()


# -- the five topics of ROS 1 ------------------------------------------------------------------------------------------


class Actionlib:
    """A client of actionlib: subscribes to three topics and publishes on two."""

    def __init__(self, client: RosbridgeClient, name: str, type: str) -> None:
        self.client, self.name, self.type = client, name, type
        self.received: dict[str, list[Any]] = {"status": [], "feedback": [], "result": []}
        for topic, messages in self.received.items():
            client.subscribe(f"{name}/{topic}", messages.append)

    def send(self, id: str, goal: Any, **more: Any) -> None:
        message = {"goal_id": {"id": id, **more}, "goal": goal}
        self.client.publish(f"{self.name}/goal", f"{self.type}ActionGoal", message)

    def cancel(self, **goal_id: Any) -> None:
        self.client.publish(f"{self.name}/cancel", "actionlib_msgs/GoalID", goal_id)

    def ended(self, id: str) -> Any:
        """Waits for the result of a goal."""
        eventually(lambda: any(each["status"]["goal_id"]["id"] == id for each in self.received["result"]))
        return next(each for each in self.received["result"] if each["status"]["goal_id"]["id"] == id)

    def has_feedback(self, id: str) -> bool:
        return any(each["status"]["goal_id"]["id"] == id for each in self.received["feedback"])


@pytest.fixture
def actionlib(client: RosbridgeClient) -> Iterator[Actionlib]:
    actionlib = Actionlib(client, STEPS, STEPS_TYPE)
    yield actionlib
    actionlib.cancel()


def test_an_actionlib_goal_succeeds(actionlib: Actionlib, simulation: Simulation) -> None:
    before = simulation.state.time_s
    actionlib.send("one", {"steps": 100})
    result = actionlib.ended("one")
    assert result["status"]["status"] == SUCCEEDED
    assert result["result"] == {"result": {"result": 1, "error_message": ""}}
    assert simulation.state.time_s - before == pytest.approx(0.2)
    assert actionlib.has_feedback("one")
    eventually(lambda: any(
        each["goal_id"]["id"] == "one" and each["status"] == SUCCEEDED
        for message in actionlib.received["status"] for each in message["status_list"]
    ))  # fmt: skip


def test_actionlib_goals_are_canceled_by_id_by_time_or_all(actionlib: Actionlib) -> None:
    for number, cancel in enumerate(({"id": "goal-0"}, {"stamp": {"sec": 100, "nanosec": 0}}, {})):
        name = f"goal-{number}"
        actionlib.send(name, {"steps": FOR_EVER}, stamp={"sec": 99, "nanosec": 0})
        eventually(lambda name=name: actionlib.has_feedback(name))
        actionlib.cancel(id="another")
        actionlib.cancel(**cancel)
        assert actionlib.ended(name)["status"]["status"] == PREEMPTED


def test_a_duplicate_actionlib_goal_is_ignored(actionlib: Actionlib, simulation: Simulation) -> None:
    before = simulation.state.time_s
    for _ in range(2):
        actionlib.send("twice", {"steps": 100})
    actionlib.ended("twice")
    actionlib.send("then", {"steps": 0})
    actionlib.ended("then")
    assert simulation.state.time_s - before == pytest.approx(0.2)
    assert len(actionlib.received["result"]) == 2


def test_an_invalid_actionlib_goal_is_rejected_with_the_path(actionlib: Actionlib) -> None:
    actionlib.send("bad", {"steps": "many"})
    status = actionlib.ended("bad")["status"]
    assert status["status"] == REJECTED
    assert "goal.steps: expected int, got str" in status["text"]
    actionlib.send("good", {"steps": 1})
    assert actionlib.ended("good")["status"]["status"] == SUCCEEDED


def test_an_invalid_actionlib_cancel_is_refused_or_published_on_the_diagnostics(
    actionlib: Actionlib, client: RosbridgeClient, local_node: LocalNode
) -> None:
    refusals: list[str] = []
    client.add_refusal_listener(lambda *refusal: refusals.append(str(refusal)))
    actionlib.cancel(which="all")
    eventually(lambda: any("which: it is not of the type actionlib_msgs" in each for each in refusals))
    # Messages of this process are not checked by the hub.
    published: list[Any] = []
    client.subscribe("/mindstage/diagnostics", published.append)
    name = f"{STEPS}/cancel"
    eventually(lambda: local_node.publish(name, "actionlib_msgs/GoalID", {"which": "all"}) or published)
    assert "which: actionlib_msgs/GoalID has no such field" in published[0]["status"][0]["message"]


def test_the_number_of_actionlib_goals_is_limited(actionlib: Actionlib) -> None:
    for number in range(100):
        actionlib.send(f"quick-{number}", {"steps": 0})
        actionlib.ended(f"quick-{number}")
    eventually(lambda: any("quick-99" in str(each) for each in actionlib.received["status"]))
    assert max(len(each["status_list"]) for each in actionlib.received["status"]) <= 64


def test_an_actionlib_goal_whose_client_disconnected_is_canceled(
    ros_interface: RosInterface, server: RosbridgeServer, simulation: Simulation, client: RosbridgeClient
) -> None:
    bystander = Actionlib(client, STEPS, STEPS_TYPE)
    with RosbridgeClient(server.url) as leaving:
        lost = Actionlib(leaving.wait_connected(TIMEOUT_S), STEPS, STEPS_TYPE)
        lost.send("lost", {"steps": FOR_EVER})
        eventually(lambda: lost.has_feedback("lost"))
    assert bystander.ended("lost")["status"]["status"] == PREEMPTED
    assert stands_still(simulation)


def test_ros_1_clients_receive_ros_1_fields(simulation: Simulation) -> None:
    with (
        LocalNode() as local_node,
        RosbridgeServer(local_node, port=0) as server,
        RosInterface(simulation, local_node, ros=RosVersion.ONE),
        RosbridgeClient(server.url) as client,
    ):
        actionlib = Actionlib(client.wait_connected(TIMEOUT_S), STEPS, STEPS_TYPE)
        actionlib.send("one", {"steps": 10}, stamp={"secs": 1, "nsecs": 2})
        status = actionlib.ended("one")["status"]
        assert status["goal_id"] == {"stamp": {"secs": 1, "nsecs": 2}, "id": "one"}
        assert status["status"] == SUCCEEDED
