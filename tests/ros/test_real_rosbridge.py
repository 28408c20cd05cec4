"""At a real rosbridge that is running already: the one that `MINDSTAGE_ROSBRIDGE` names by its address.

It needs the packages of `ros/`, and no other simulation in the namespaces of these tests. `ROS_VERSION` is that
of the rosbridge, as a sourced ROS sets it. Tests with rospy need a ROS 1 that is sourced.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from mindstage.bridge import GoalStatus, RosbridgeClient
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import AdvertiseError, BridgeError, ServiceCallError, ServiceNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.msgs import RosVersion
from mindstage.ros import RosInterface
from mindstage.ros.interface import connected_clients
from mindstage.scene import BodyId, Pose
from mindstage.scene.edits import Detach, SetPoses
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, eventually
from tests.conftest import ROOT
from tests.kitchenette import kitchenette
from tests.ros.conftest import RunRospy
from tests.ros.ros_messages import diagnostic_texts, pose_message

HEAD = """
import json, math, sys, threading
import rospy
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA
rospy.init_node("caller", anonymous=True, disable_signals=True)
NAMESPACE = sys.argv[1] if len(sys.argv) > 1 else "/unreal"

found = {}

def call(service, type, /, **fields):
    full = service if service.startswith("/") else NAMESPACE + "/" + service
    rospy.wait_for_service(full, 20.0)
    return rospy.ServiceProxy(full, type)(**fields)

def do(service, type, /, **fields):
    found[service] = call(service, type, **fields).success

def pose(x, y, z):
    return Pose(position=Point(x, y, z), orientation=Quaternion(0, 0, math.sin(math.pi / 12), math.cos(math.pi / 12)))
"""

TOPICS = (
    HEAD
    + """
from mindstage_msgs.msg import HighlightGroup
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

def publish(topic, message):
    publisher = rospy.Publisher(NAMESPACE + "/" + topic, type(message), queue_size=5)
    while publisher.get_num_connections() == 0:
        rospy.sleep(0.02)
    publisher.publish(message)
    rospy.sleep(0.1)

def marker(id):
    new = Marker(ns="rospy", id=id, type=Marker.SPHERE, action=Marker.ADD, pose=pose(1, id, 1),
                 scale=Vector3(0.1, 0.1, 0.1), color=ColorRGBA(0, 1, 0, 1))
    new.header.frame_id = "world"
    return new

publish("highlight", HighlightGroup(ids=["Mug"], color=ColorRGBA(0, 0, 1, 1), label="from rospy"))
first = int(sys.argv[2])
publish("markers", MarkerArray(markers=[marker(first), marker(first + 1)]))
publish("marker", marker(first + 2))
expected, frames, complete = set(json.loads(sys.argv[3])), set(), threading.Event()

def on_frames(message):
    frames.update(each.child_frame_id for each in message.transforms)
    if expected <= frames:
        complete.set()

subscribers = [rospy.Subscriber(topic, TFMessage, on_frames) for topic in ("/tf", "/tf_static")]
complete.wait(20.0)
print(json.dumps(sorted(expected - frames)))
"""
)

ACTIONS = (
    HEAD
    + """
import actionlib
from actionlib_msgs.msg import GoalStatus
from mindstage_msgs.msg import SimulateAction, SimulateGoal
from simulation_interfaces.msg import SimulateStepsAction, SimulateStepsGoal

def run(name, type, goal, cancel):
    client = actionlib.SimpleActionClient(NAMESPACE + "/" + name, type)
    if not client.wait_for_server(rospy.Duration(20)):
        return "no server"
    heard = threading.Event()
    client.send_goal(goal, feedback_cb=lambda _: heard.set())
    fed = heard.wait(20.0) if cancel else None
    if cancel:
        client.cancel_goal()
    ended = client.wait_for_result(rospy.Duration(20))
    result = client.get_result()
    return [fed, ended, client.get_state(), client.get_goal_status_text(), result is not None]

print(json.dumps({
    "canceled": run("mindstage/simulate", SimulateAction, SimulateGoal(duration_s=1e4), True),
    "done": run("simulate_steps", SimulateStepsAction, SimulateStepsGoal(steps=20), False),
}))
"""
)

PLANS = (
    HEAD
    + """
import time
import actionlib
from mindstage_msgs.msg import EvaluatePlanAction, EvaluatePlanGoal

client = actionlib.SimpleActionClient(NAMESPACE + "/mindstage/evaluate_plan", EvaluatePlanAction)
assert client.wait_for_server(rospy.Duration(20))

def run(cancel, **goal):
    done, heard = [], threading.Event()
    def on_feedback(feedback):
        done.append(feedback.done)
        heard.set()
    client.send_goal(EvaluatePlanGoal(**goal), feedback_cb=on_feedback)
    if cancel:
        assert heard.wait(20.0)
        start = time.monotonic()
        client.cancel_goal()
    ended = client.wait_for_result(rospy.Duration(20))
    result = client.get_result()
    return {"state": client.get_state(), "done": done, "outcome": result.outcome, "samples": result.samples,
            "thing": result.thing, "refusal": [result.refusal.code, result.refusal.reason], "ended": ended,
            "cancel_s": time.monotonic() - start if cancel else None}

opens, edge = sys.argv[2:4]
print(json.dumps([
    run(False, plan=opens),
    run(False, plan=edge, samples=20, seed=4),
    run(True, plan=edge, samples=100000),
    run(False, plan=opens.replace("FridgeDoor", "Frdge")),
]))
"""
)

SUCCEEDED, PREEMPTED = 3, 2


@pytest.fixture(scope="module")
def simulation(knowledge: KnowledgeBase) -> Iterator[Simulation]:
    with Simulation(knowledge, MujocoEngine()) as simulation:
        assert simulation.spawn(kitchenette()).ok
        yield simulation


@pytest.fixture(scope="module")
def client(real_rosbridge: str) -> Iterator[RosbridgeClient]:
    """The client of the simulation, for all tests: a rosbridge of ROS 1 keeps the services of a closed connection."""
    with RosbridgeClient(real_rosbridge) as client:
        yield client.wait_connected(TIMEOUT_S)


@pytest.fixture(scope="module")
def offered(client: RosbridgeClient, simulation: Simulation, ros_version: RosVersion) -> Iterator[RosInterface]:
    with RosInterface(simulation, client, ros=ros_version) as interface:
        yield interface


@pytest.fixture
def second(real_rosbridge: str, offered: RosInterface) -> Iterator[RosbridgeClient]:
    """Another client, which calls the simulation."""
    with RosbridgeClient(real_rosbridge) as second:
        second.wait_connected(TIMEOUT_S)
        eventually(lambda: poses_at(second, "Mug", namespace="unreal"), timeout_s=60.0)
        yield second


def poses_at(client: RosbridgeClient, body: str, *, namespace: str) -> bool:
    """Whether a simulation answers there."""
    try:
        return bool(client.call_service(f"/{namespace}/get_model_pose", {"id": body}, timeout_s=1.0)["success"])
    except BridgeError:
        return False


def test_services_answer_through_the_rosbridge(
    second: RosbridgeClient, client: RosbridgeClient, simulation: Simulation
) -> None:
    def call(service: str, /, **args: Any) -> Any:
        return second.call_service(f"/unreal/{service}", args, timeout_s=TIMEOUT_S)

    physics = {"mobility": 2, "gravity": True, "mass": 0.5}
    tags = [{"type": "SemLog", "key": "Class", "value": "Bowl"}]
    turned = pose_message(1, 2, 3, {"x": 0.0, "y": 0.0, "z": 0.2588190451, "w": 0.9659258263})
    details = {"id_first_model": "a", "id_second_model": "b"}
    joint = {"id": "hinge", "pose": pose_message(3, 5, 1), "constraint_details": details}
    points = [{"x": 0.0, "y": 0.0, "z": 1.0}, {"x": 1.0, "y": 0.0, "z": 1.0}]
    assert call("object_to_object_state", source_object_id="Mug", other_object_id="Cupboard")["state"] == "on"
    cup = {"name": "Cup", "id": "a", "pose": pose_message(1, 5, 1), "tags": tags, "physics_properties": physics}
    assert call("spawn_model", **cup)["id"] == "a"
    again = call("spawn_model", **cup)
    assert (again["success"], again["etype"]) == (False, "1")
    assert call("spawn_pro_mesh", id="b", width=0.3, depth=0.4, height=0.2, pose=pose_message(3, 5, 1))["id"] == "b"
    assert call("spawn_physics_constraint", constraint_description=joint)["success"]
    assert call("set_model_pose", id="a", pose=turned)["success"]
    pose = call("get_model_pose", id="a")["pose"]
    assert list(pose["position"].values()) == pytest.approx([1.0, 2.0, 3.0])
    assert pose["orientation"]["w"] == pytest.approx(0.9659258263)
    assert not call("get_model_pose", id="nothing")["success"]
    socket = call("get_model_socket_pose", id="Drawer", socket="DrawerHandle")["pose"]["position"]
    assert socket["x"] == pytest.approx(1.68, abs=0.001)
    assert call("set_physics_properties", id="a", physics_properties=physics)["success"]
    assert call("highlight_models", id="a", color=4)["success"]
    assert call("display_basic_marker", marker_type=2, scale=0.25, marker_id="ball")["marker_id"] == "ball"
    assert call("display_trajectory", marker_id="path", points=points)["marker_id"] == "path"
    assert call("remove_marker", marker_id="path")["success"]
    robot = "<robot name='r'><link name='base'/></robot>"
    assert call("spawn_robot", id="robot", name=robot)["id"] == "robot"
    assert call("delete_model", id="b")["success"]
    assert call("reset_level", id="")["success"]
    assert client.refusals == second.refusals == ()


def test_topics_pass_the_rosbridge_in_both_directions(second: RosbridgeClient, simulation: Simulation) -> None:
    frames: set[str] = set()

    def note(message: Any) -> None:
        frames.update(each["child_frame_id"] for each in message["transforms"])

    for topic in ("/tf", "/tf_static"):
        second.subscribe(topic, note, type="tf2_msgs/TFMessage")
    eventually(lambda: set(simulation.state.ids) <= frames)
    second.advertise("/unreal/highlight", "mindstage_msgs/HighlightGroup")
    color = {"r": 0.0, "g": 0.0, "b": 1.0, "a": 1.0}
    eventually(lambda: second.has_subscribers("/unreal/highlight"))
    second.publish(
        "/unreal/highlight", "mindstage_msgs/HighlightGroup", {"ids": ["Mug"], "color": color, "label": "blue"}
    )
    eventually(lambda: {group.label: group.ids for group in simulation.state.highlight_groups}.get("blue") == ("Mug",))


def test_a_goal_is_done_and_another_one_canceled(
    second: RosbridgeClient, simulation: Simulation, ros_version: RosVersion
) -> None:
    if ros_version is RosVersion.ONE:
        pytest.skip("a rosbridge of ROS 1 has no operations for actions; actionlib uses topics")
    before, feedback = simulation.state.time_s, list[Any]()
    steps = ("/unreal/simulate_steps", "simulation_interfaces/SimulateSteps")
    assert second.send_goal(*steps, {"steps": 20}).wait(TIMEOUT_S).status is GoalStatus.SUCCEEDED
    assert simulation.state.time_s == pytest.approx(before + 0.04)
    goal = second.send_goal(*steps, {"steps": 10**9}, on_feedback=feedback.append)
    eventually(lambda: feedback)
    goal.cancel()
    assert goal.wait(TIMEOUT_S).status is GoalStatus.CANCELED


def test_topics_and_actions_work_with_rospy(
    run_rospy: RunRospy, client: RosbridgeClient, offered: RosInterface, simulation: Simulation
) -> None:
    before = len(simulation.state.markers)
    missing_frames = run_rospy(TOPICS, "/unreal", "1", json.dumps(simulation.state.ids))
    assert json.loads(missing_frames) == []
    eventually(lambda: len(simulation.state.markers) == before + 3)
    eventually(lambda: [group.label for group in simulation.state.highlight_groups] == ["from rospy"])
    assert simulation.state.highlight_groups[0].ids == ("Mug",)
    outcomes = json.loads(run_rospy(ACTIONS))
    assert outcomes["canceled"] == [True, True, PREEMPTED, "", True]
    assert outcomes["done"] == [None, True, SUCCEEDED, "", True]
    assert client.refusals == ()


def test_plans_are_tried_canceled_and_refused_for_rospy(
    run_rospy: RunRospy, offered: RosInterface, simulation: Simulation
) -> None:
    opens = json.dumps({"steps": [{"do": "open", "thing": "FridgeDoor"}]})
    moved = {"do": "move", "thing": "Mug", "to": {"position": [1.72, 0.2, 0.85]}}
    uncertain = [{"thing": "Mug", "position_m": 0.03}]
    edge = json.dumps({"steps": [moved, {"do": "wait", "duration_s": 0.5}], "uncertainty": uncertain})
    mug = BodyId("Mug")  # other tests attach it elsewhere
    simulation.engine.run(lambda engine: engine.apply(Detach(mug)), edits=True)
    simulation.engine.run(lambda engine: engine.apply(SetPoses({mug: Pose(position=(2.0, 0.0, 0.85))})), edits=True)
    before, revision = simulation.state.time_s, simulation.state.revision
    succeeded, failed, canceled, refused = json.loads(run_rospy(PLANS, "/unreal", opens, edge))
    assert (succeeded["state"], succeeded["outcome"], succeeded["samples"]) == (SUCCEEDED, "succeeded", 1)
    assert (failed["state"], failed["outcome"], failed["thing"]) == (SUCCEEDED, "failed", "Mug")
    assert failed["done"] in ([10], [10, 20])  # the last feedback may arrive after the result
    assert (canceled["state"], canceled["ended"]) == (PREEMPTED, True)
    assert canceled["samples"] < 100_000
    assert refused["outcome"] == "unknown"
    assert refused["refusal"] == ["PlanError", "the plan:1: steps[0].thing"]
    assert (simulation.state.time_s, simulation.state.revision) == (before, revision)
    print(f"a plan is canceled within {canceled['cancel_s']:.2f} s")


def test_a_failed_call_returns(second: RosbridgeClient, client: RosbridgeClient, ros_version: RosVersion) -> None:
    malformed = {"question": "where_is", "args": "not JSON"}
    if ros_version is RosVersion.ONE:
        refusal = second.call_service("/mindstage/ask", malformed, timeout_s=TIMEOUT_S)["refusal"]
        assert (refusal["code"], "args" in refusal["text"]) == ("MessageValidationError", True)
    else:
        with pytest.raises(ServiceCallError, match="args: JSON is malformed"):
            second.call_service("/mindstage/ask", malformed, timeout_s=TIMEOUT_S)
    assert client.refusals == ()
    # A response that the rosbridge refuses is replaced by an empty one, since its caller would wait forever.
    second.create_service("/unreal/broken", "world_control_msgs/DeleteModel", lambda _: {"nonsense": 1})
    answers: list[Any] = []

    def answered() -> bool:
        try:
            answers.append(client.call_service("/unreal/broken", {"id": "x"}, timeout_s=TIMEOUT_S))
        except ServiceNotFoundError:  # it is not offered yet
            return False
        except BridgeError as error:
            answers.append(error)
        return True

    eventually(answered)
    if answers == [{"nonsense": 1}]:
        pytest.skip("this rosbridge does not compare messages with their types")
    eventually(lambda: second.refusals)
    assert [(each.operation, each.name) for each in second.refusals] == [("service_response", "/unreal/broken")]
    assert "nonsense" in second.refusals[0].cause


def test_refusals_are_shown(
    second: RosbridgeClient, client: RosbridgeClient, simulation: Simulation, ros_version: RosVersion
) -> None:
    diagnostics: list[Any] = []
    with RosInterface(simulation, second, namespace="second", ros=ros_version):
        before = second.refusals
        client.subscribe("/mindstage/diagnostics", diagnostics.append, type="diagnostic_msgs/DiagnosticArray")
        second.create_service("/second/unknown_type", "no_such_msgs/Nothing", dict)
        second.call_service("/unreal/get_model_pose", {"id": "Mug"}, timeout_s=TIMEOUT_S)  # after a refusal, if any
        if second.refusals == before:
            pytest.skip("this rosbridge does not look up types")
        second.advertise("/second/words", "not_a_type")
        second.subscribe("/second/more", print, type="no_such_msgs/Other")
        eventually(lambda: len(second.refusals) == len(before) + 3)
        refusals = second.refusals[len(before) :]
        assert [(each.operation, each.name) for each in refusals] == [
            ("advertise_service", "/second/unknown_type"),
            ("advertise", "/second/words"),
            ("subscribe", "/second/more"),
        ]
        assert all(each.cause for each in refusals)
        second.publish("/second/words", "not_a_type", {})  # not sent, or each of its messages would be refused
        assert not second.has_subscribers("/second/words")
        assert f"refused {len(before) + 3} operations, first" in connected_clients(second)[0].activity
        eventually(lambda: any("no_such_msgs" in text for _, text in diagnostic_texts(diagnostics)))


def test_a_second_simulation_must_have_another_namespace(
    second: RosbridgeClient, simulation: Simulation, ros_version: RosVersion
) -> None:
    try:
        second.call_service("/rosapi/services", {}, timeout_s=TIMEOUT_S)
    except ServiceNotFoundError:
        pytest.skip("there is no rosapi, which lists the names that are taken")
    with pytest.raises(AdvertiseError, match=r"'/unreal/\w+' cannot be advertised.* and \d+ more; .*--namespace"):
        RosInterface(simulation, second, ros=ros_version)
    with RosInterface(simulation, second, namespace="other", ros=ros_version) as other:
        eventually(lambda: poses_at(second, "Mug", namespace="other"), timeout_s=60.0)
        kept = {each.name for each in second.refusals}
        assert "/mindstage/ask" in kept
        assert all(name.startswith("/mindstage/") for name in kept)
        assert "use /other/mindstage/ask" in second.refusals[0].cause
        assert not kept.intersection(other.service_names)


def test_the_command_line_joins_a_rosbridge(
    real_rosbridge: str, second: RosbridgeClient, ros_version: RosVersion
) -> None:
    command = [sys.executable, "-m", "mindstage", "serve", "bundled:kitchen", "--namespace", "kitchen"]
    command += ["--connect", real_rosbridge, *(["--ros1"] if ros_version is RosVersion.ONE else [])]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
        try:
            eventually(lambda: poses_at(second, "fridge_door", namespace="kitchen"), timeout_s=60.0)
        finally:
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=60.0)
    assert "Traceback" not in errors
