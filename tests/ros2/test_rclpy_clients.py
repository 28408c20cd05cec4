"""Real rclpy clients of a simulation as a node of ROS 2: services, topics, actions, parameters, killed processes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys

from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.msgs.message_registry import is_ros1_only
from mindstage.ros2.environment import Ros2Environment
from mindstage.ros2.served_simulation import serve_simulation
from mindstage.scene import BodyId
from mindstage.simulation import Simulation
from tests.bridge.raw_client import eventually
from tests.conftest import ROOT
from tests.kitchenette import kitchenette
from tests.ros2.conftest import RunClient, Served

END_TIME_S = 30.0
"""Longest time until the end of a process is noticed, on a busy machine [s]."""


def short(name: str) -> str:
    """A type without `msg`, `srv` or `action`."""
    return f"{name.partition('/')[0]}/{name.rpartition('/')[2]}"


GRAPH = """
def offered():
    services = {name: types[0] for name, types in node.get_service_names_and_types_by_node("mindstage", "/")}
    topics = {name: types[0] for name, types in node.get_publisher_names_and_types_by_node("mindstage", "/")}
    taken = {name: types[0] for name, types in node.get_subscriber_names_and_types_by_node("mindstage", "/")}
    return services, topics, taken
wanted = json.loads(%r)
def complete():
    try:
        services, topics, taken = offered()
    except Exception:
        return False
    return all(set(wanted[kind]) <= set(there) for kind, there in zip(("services", "topics", "taken"), offered()))
is_complete = until(complete)
services, topics, taken = offered()
say(services=services, topics=topics, taken=taken, is_complete=is_complete)
"""


def test_everything_that_the_rosbridge_offers_is_in_the_graph_with_its_type(
    served: Served, run_client: RunClient
) -> None:
    graph = served.local_node.graph_info()
    own = served.local_node.name
    services = {each.name: short(each.type) for each in graph.services if not is_ros1_only(each.type)}
    topics = {
        each.name: short(each.type) for each in graph.topics if own in each.publishers and not is_ros1_only(each.type)
    }
    taken = {
        each.name: short(each.type)
        for each in graph.topics
        if own in each.subscribers and each.type and not is_ros1_only(each.type)
    }
    assert len(services) > 80
    wanted = {"services": services, "topics": topics, "taken": taken}
    found = run_client(GRAPH % json.dumps(wanted))
    assert found["is_complete"], {kind: set(names) - set(found[kind]) for kind, names in wanted.items()}
    for kind, names in wanted.items():
        assert {name: short(found[kind][name]) for name in names} == names
    actions = {f"{each.name}/_action/status" for each in graph.actions}
    assert actions <= set(found["topics"])
    # Nothing else is there: rclpy's own names, and those of actions, are known by their form.
    extra = {
        name
        for name in {*found["services"], *found["topics"], *found["taken"]} - {*services, *topics, *taken}
        if "/_action/" not in name and not name.startswith("/mindstage/")
    }
    assert extra <= {"/rosout", "/parameter_events", "/clock"}
    assert served.node.refusals == []


SERVICES = """
from world_control_msgs.srv import GetModelPose, SetModelPose
from simulation_interfaces.srv import GetEntities
from geometry_msgs.msg import Pose, Point, Quaternion
pose = Pose(position=Point(x=0.3, y=0.1, z=1.5), orientation=Quaternion(w=1.0))
same = []
for number in range(10):
    pose.position.x = 0.3 + 0.01 * number
    assert call(SetModelPose, "/unreal/set_model_pose", id="Mug", pose=pose).success
    same.append(call(GetModelPose, "/unreal/get_model_pose", id="Mug").pose.position.x - pose.position.x)
unknown = call(GetModelPose, "/unreal/get_model_pose", id="nobody")
entities = call(GetEntities, "/unreal/get_entities")
say(largest=max(map(abs, same)), unknown=unknown.success, code=entities.result.result, entities=list(entities.entities))
bad = Pose(position=Point(x=float("nan")), orientation=Quaternion(w=1.0))
say(nan=call(SetModelPose, "/unreal/set_model_pose", id="Mug", pose=bad).success)
"""


def test_services_answer_and_a_read_sees_the_edit_before_it(served: Served, run_client: RunClient) -> None:
    served.simulation.pause()
    found = run_client(SERVICES)
    assert found["largest"] < 1e-9
    assert found["unknown"] is False
    assert found["code"] == 1
    assert set(found["entities"]) == set(served.simulation.state.ids)
    assert found["nan"] is False


TOPICS = """
from rosgraph_msgs.msg import Clock
from tf2_msgs.msg import TFMessage
from sensor_msgs.msg import JointState
from diagnostic_msgs.msg import DiagnosticArray
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
best_effort = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
got = {}
def keep(name):
    return lambda message: got.setdefault(name, []).append(message)
node.create_subscription(TFMessage, "/tf", keep("tf"), 10)
node.create_subscription(TFMessage, "/tf_static", keep("tf_static"), latched)
node.create_subscription(JointState, "/unreal/joint_states", keep("joints"), 10)
node.create_subscription(DiagnosticArray, "/mindstage/health", keep("health"), latched)
node.create_subscription(Clock, "/clock", keep("clock"), best_effort)
node.create_subscription(Clock, "/clock", keep("reliable_clock"), 10)
def have_all():
    return all(len(got.get(name, ())) >= 3 for name in ("tf", "joints", "clock")) and len(got) >= 5
assert until(have_all), got.keys()
stamps = [each.clock.sec + each.clock.nanosec * 1e-9 for each in got["clock"]]
say(
    stamps=stamps,
    frames=[each.child_frame_id for each in got["tf"][-1].transforms],
    static=[each.child_frame_id for each in got["tf_static"][-1].transforms],
    heights=[each.transform.translation.z for each in got["tf"][-1].transforms],
    joints=dict(zip(got["joints"][-1].name, got["joints"][-1].position)),
    health=got["health"][-1].status[0].name,
    reliable=len(got.get("reliable_clock", ())),
)
"""


def test_topics_arrive_late_subscribers_get_latched_ones_and_incompatible_ones_nothing(
    served: Served, run_client: RunClient
) -> None:
    served.simulation.play()
    try:
        found = run_client(TOPICS)
    finally:
        served.simulation.pause()
    assert found["stamps"] == sorted(found["stamps"])
    assert found["stamps"][-1] > found["stamps"][0]
    assert "Mug" in found["frames"]
    assert "world" in found["static"]
    assert not set(found["frames"]) & set(found["static"])
    assert len(found["joints"]) == 2
    assert found["health"]
    assert found["reliable"] == 0, "the clock is published best effort, as rclcpp subscribes to it"


MESSAGES = """
from mindstage_msgs.msg import HighlightGroup
from std_msgs.msg import ColorRGBA
publisher = node.create_publisher(HighlightGroup, "/unreal/highlight", 10)
assert until(lambda: publisher.get_subscription_count() == 1)
publisher.publish(HighlightGroup(ids=["Mug"], color=ColorRGBA(r=1.0, a=1.0), label="asked for"))
assert until(lambda: False, 0.5) is False
"""


def test_a_message_of_a_client_is_handled(served: Served, run_client: RunClient) -> None:
    assert BodyId("Mug") not in served.simulation.state.highlights
    run_client(MESSAGES)
    eventually(lambda: served.simulation.state.highlights.get(BodyId("Mug")) == (1.0, 0.0, 0.0))


ACTIONS = """
from action_msgs.msg import GoalStatus
from simulation_interfaces.action import SimulateSteps
from mindstage_msgs.action import Simulate
steps = action(SimulateSteps, "/unreal/simulate_steps")
feedback = []
goal = wait(steps.send_goal_async(SimulateSteps.Goal(steps=200), feedback_callback=feedback.append))
result = wait(goal.get_result_async())
say(accepted=goal.accepted, status=result.status, code=result.result.result.result, feedback=len(feedback))
last = feedback[-1].feedback if feedback else None
say(completed=last.completed_steps if last else -1)

first = wait(steps.send_goal_async(SimulateSteps.Goal(steps=100_000_000)))
ended = first.get_result_async()
until(lambda: False, 0.3)
canceled = wait(first.cancel_goal_async())
say(canceling=len(canceled.goals_canceling), canceled=wait(ended).status)

again = wait(steps.send_goal_async(SimulateSteps.Goal(steps=10)))
say(after=wait(again.get_result_async()).status)
"""


def test_goals_have_feedback_results_and_can_be_canceled(served: Served, run_client: RunClient) -> None:
    served.simulation.pause()
    before_s = served.simulation.state.time_s
    found = run_client(ACTIONS)
    assert (found["accepted"], found["status"], found["code"]) == (True, 4, 1)
    assert found["feedback"] >= 1
    assert 1 <= found["completed"] <= 200
    assert (found["canceling"], found["canceled"]) == (1, 5)
    assert found["after"] == 4
    assert served.simulation.state.time_s > before_s + 210 * 0.002 - 1e-9


PARAMETERS = """
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
def set_to(name, **value):
    types = {"bool_value": 1, "double_value": 3, "string_value": 4}
    value = ParameterValue(type=types[next(iter(value))], **value)
    answer = call(SetParameters, "/mindstage/set_parameters", parameters=[Parameter(name=name, value=value)])
    return [answer.results[0].successful, answer.results[0].reason]
names = call(ListParameters, "/mindstage/list_parameters").result.names
described = call(DescribeParameters, "/mindstage/describe_parameters", names=["speed", "rates.tf"]).descriptors
say(
    names=list(names),
    range=[described[0].floating_point_range[0].from_value, described[0].floating_point_range[0].to_value],
    description=described[0].description,
    play=set_to("paused", bool_value=False),
    faster=set_to("speed", double_value=2.0),
    too_fast=set_to("speed", double_value=1e9),
    rate=set_to("rates.tf", double_value=1.0),
)
values = call(GetParameters, "/mindstage/get_parameters", names=["paused", "speed", "rates.tf"]).values
say(values=[values[0].bool_value, values[1].double_value, values[2].double_value])
sys.stdin.readline()
assert until(lambda: call(GetParameters, "/mindstage/get_parameters", names=["paused"]).values[0].bool_value)
"""


def test_parameters_follow_the_simulation_and_set_it(served: Served, run_client: RunClient) -> None:
    served.simulation.pause()
    process = run_client.start(PARAMETERS)
    assert process.stdout is not None
    lines = [process.stdout.readline(), process.stdout.readline()]
    assert all(lines), process.communicate()[1]
    found = json.loads(lines[0]) | json.loads(lines[1])
    assert {"paused", "speed", "rates.tf", "use_sim_time", "robot_description", "stamped_cmd_vel"} <= set(
        found["names"]
    )
    assert found["range"] == [0.0, 1000.0]
    assert found["description"]
    assert found["play"][0]
    assert found["faster"][0]
    assert not found["too_fast"][0]
    assert not found["rate"][0]
    assert "read-only" in found["rate"][1]
    assert found["values"] == [False, 2.0, 30.0]
    assert served.simulation.state.playing
    assert served.simulation.state.speed == 2.0
    served.simulation.pause()
    _, errors = process.communicate("paused\n", timeout=60.0)
    assert process.returncode == 0, errors


TWO = """
from world_control_msgs.srv import GetModelPose
say(first=call(GetModelPose, "/unreal/get_model_pose", id="Mug").success)
say(second=call(GetModelPose, "/other/get_model_pose", id="Mug").success)
"""


def test_two_simulations_are_in_one_domain(
    served: Served, environment: Ros2Environment, domain: int, run_client: RunClient
) -> None:
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        with serve_simulation(
            simulation, namespace="other", environment=environment, domain=domain, name="second"
        ) as second:
            found = run_client(TWO)
            assert (found["first"], found["second"]) == (True, False), "the other one is empty"
        assert second.node.error == ""


GOAL = """
from simulation_interfaces.action import SimulateSteps
steps = action(SimulateSteps, "/{namespace}/simulate_steps")
goal = wait(steps.send_goal_async(SimulateSteps.Goal(steps=100_000_000)))
ended = goal.get_result_async()
say(accepted=goal.accepted)
began_s = time.monotonic()
until(ended.done, 60.0)
say(done=ended.done(), status=ended.result().status if ended.done() else -1)
"""


def test_goals_end_when_the_process_of_the_node_is_killed(
    environment: Ros2Environment, domain: int, run_client: RunClient
) -> None:
    reasons: list[str] = []
    with (
        Simulation(KnowledgeBase(), MujocoEngine()) as simulation,
        serve_simulation(
            simulation, namespace="mortal", environment=environment, domain=domain, name="mortal", on_end=reasons.append
        ) as served,
    ):
        simulation.spawn(kitchenette())
        process = run_client.start(GOAL.format(namespace="mortal"))
        assert process.stdout is not None
        assert json.loads(process.stdout.readline()) == {"accepted": True}
        eventually(lambda: simulation.state.time_s > 0.0)
        os.kill(served.node.pid, signal.SIGKILL)
        eventually(lambda: bool(reasons))
        assert "ended" in served.node.error
        eventually(lambda: not _advances(simulation))
        process.kill()
        process.communicate()


def _advances(simulation: Simulation) -> bool:
    """Whether simulated time goes on between two round trips to the engine."""
    before_s = simulation.state.time_s
    simulation.engine.ping()
    simulation.engine.ping()
    return simulation.state.time_s > before_s


def test_goals_end_when_the_simulation_is_killed(
    environment: Ros2Environment, domain: int, run_client: RunClient
) -> None:
    command = (sys.executable, "-m", "mindstage", "serve", "--ros2", "--ros2-python", str(environment.python))
    options = ("--port", "0", "--namespace", "victim", "--ros2-domain", str(domain), "--paused", "--json")
    names = ("--ros-args", "-r __node:=victim")
    server = subprocess.Popen((*command, *options, *names), stdout=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        assert server.stdout is not None
        process = run_client.start(GOAL.format(namespace="victim"))
        assert process.stdout is not None
        assert json.loads(process.stdout.readline()) == {"accepted": True}
        server.kill()
        out, errors = process.communicate(timeout=END_TIME_S + 60.0)
        assert json.loads(out) == {"done": True, "status": 6}, errors
    finally:
        server.kill()
        server.communicate()
