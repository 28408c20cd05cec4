"""At a real rosbridge: rosbridge_suite of ROS 1 with rospy clients, the original message packages, and those of `ros/`.

Each test must leave no error in the log of the rosbridge, unless it provokes one.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from mindstage.bridge import ConnectionState, RosbridgeClient
from mindstage.engines import MujocoEngine
from mindstage.errors import AdvertiseError
from mindstage.knowledge import KnowledgeBase
from mindstage.msgs import RosVersion
from mindstage.ros import RosInterface
from mindstage.ros.interface import connected_clients
from mindstage.scene import BodyId, Pose
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, eventually
from tests.kitchenette import kitchenette
from tests.ros.real_rosbridge import ROOT, RealRosbridge
from tests.ros.ros_messages import diagnostic_texts

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

ALL_SERVICES = (
    HEAD
    + """
import unreal_vis_msgs.srv as vis
import modul_spawner_msgs.srv as modul
import world_control_msgs.srv as srv
from world_control_msgs.msg import *

physics = PhysicsProperties(mobility=2, gravity=True, mass=0.5)
tag = Tag(type="SemLog", key="Class", value="Bowl")
constraint = ConstraintDescription(id="hinge", pose=pose(3, 5, 1), constraint_details=PhysicsConstraintDetails(
    id_first_model="a", id_second_model="b",
    linear_limits=LinearLimits(x_motion=1, y_motion=2, z_motion=2, limit=0.1),
    angular_limits=AngularLimits(swing_1_motion=2, swing_2_motion=2, twist_motion=2)))
r = call("object_to_object_state", srv.ObjectToObjectState, source_object_id="Mug", other_object_id="Cupboard")
found["object_to_object_state"] = [r.success, r.state]
r = call("spawn_semantic_map", srv.SpawnSemanticMap,
    models=[ModelDescription(name="Bowl", id="bowl", pose=pose(0, 5, 1), tags=[tag], physics_properties=physics),
            ModelDescription(name="Table", id="table", pose=pose(0, 6, 1)),
            ModelDescription(name="Cup", id="Mug")],
    relations=[RelationDescription(parent_id="table", child_id="bowl")])
found["spawn_semantic_map"] = [r.success, r.failed_model_ids, r.failed_constraint_ids, len(r.failed_relations)]
r = call("spawn_model", srv.SpawnModel, name="Cup", id="a", pose=pose(1, 5, 1), tags=[tag], physics_properties=physics)
found["spawn_model"] = [r.success, r.id, r.etype]
r = call("spawn_model", srv.SpawnModel, name="Cup", id="a", pose=pose(1, 5, 1))
found["spawn_model twice"] = [r.success, r.id, r.etype]
r = call("spawn_pro_mesh", srv.SpawnProMesh, id="b", width=0.3, depth=0.4, height=0.2, pose=pose(3, 5, 1))
found["spawn_pro_mesh"] = [r.success, r.id]
do("spawn_physics_constraint", srv.SpawnPhysicsConstraint, constraint_description=constraint)
do("attach_model_to_parent", srv.AttachModelToParent, parent_id="table", child_id="Mug")
do("set_model_pose", srv.SetModelPose, id="table", pose=pose(1, 2, 3))
r = call("get_model_pose", srv.GetModelPose, id="table")
p, q = r.pose.position, r.pose.orientation
found["get_model_pose"] = [r.success, [round(each, 4) for each in (p.x, p.y, p.z, q.x, q.y, q.z, q.w)]]
found["get_model_pose of nothing"] = call("get_model_pose", srv.GetModelPose, id="nothing").success
r = call("get_model_socket_pose", srv.GetModelSocketPose, id="Drawer", socket="DrawerHandle")
found["get_model_socket_pose"] = [r.success, round(r.pose.position.x, 3)]
do("set_physics_properties", srv.SetPhysicsProperties, id="a", physics_properties=physics)
do("change_material", srv.SetMaterial, id="a", material_names=["Red"], material_paths=[""])
do("highlight_models", srv.HighlightModel, id="a", color=4)
do("checkpoint", srv.Checkpoint, command="save", args="here")
do("move_object", srv.MoveObject, Name="table", pose=pose(1, 2, 4))
found["display_basic_marker"] = call("display_basic_marker", vis.DisplayBasicMarker, marker_type=2, scale=0.25,
    pose=pose(0, 0, 2), color=ColorRGBA(1, 0, 0, 1), marker_id="ball").marker_id
found["display_trajectory"] = call("display_trajectory", vis.DisplayTrajectory, marker_id="path",
    points=[Point(0, 0, 1), Point(1, 0, 1)], color_begin=ColorRGBA(1, 0, 0, 1),
    color_end=ColorRGBA(0, 0, 1, 1)).marker_id
do("remove_marker", vis.RemoveMarker, marker_id="path")
r = call("spawn_robot", modul.SpawnRobot, id="robot", name="<robot name='r'><link name='base'/></robot>")
found["spawn_robot"] = [r.success, r.id]
do("delete_model", srv.DeleteModel, id="b")
do("delete_all", srv.DeleteAll, type_to_delete="SemLog", key_to_delete="Class", value_to_delete="Bowl")
do("reset_level", srv.ResetLevel, id="")
print(json.dumps(found))
"""
)

TOPICS = (
    HEAD
    + """
from mindstage_msgs.msg import LitBodies
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

publish("highlight", LitBodies(ids=["Mug"], color=ColorRGBA(0, 0, 1, 1), label="from rospy"))
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
from mindstage_msgs.msg import TryPlanAction, TryPlanGoal

client = actionlib.SimpleActionClient(NAMESPACE + "/mindstage/try_plan", TryPlanAction)
assert client.wait_for_server(rospy.Duration(20))

def run(cancel, **goal):
    done, heard = [], threading.Event()
    def on_feedback(feedback):
        done.append(feedback.done)
        heard.set()
    client.send_goal(TryPlanGoal(**goal), feedback_cb=on_feedback)
    if cancel:
        assert heard.wait(20.0)
        start = time.monotonic()
        client.cancel_goal()
    ended = client.wait_for_result(rospy.Duration(20))
    result = client.get_result()
    return {"state": client.get_state(), "done": done, "outcome": result.outcome, "samples": result.samples,
            "thing": result.thing, "refusal": [result.refusal.kind, result.refusal.reason], "ended": ended,
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

MALFORMED = (
    HEAD
    + """
from mindstage_msgs.srv import Ask
from simulation_interfaces.srv import StepSimulation
from world_control_msgs.srv import SetModelPose, DeleteModel

nan = float("nan")
found["nan"] = call("set_model_pose", SetModelPose, id="Mug", pose=pose(nan, 0, 0)).success
answer = call("/mindstage/ask", Ask, question="where_is", args="not JSON")
found["ask"] = [answer.success, answer.refusal.kind, answer.refusal.text]
if len(sys.argv) > 2:
    do("broken", DeleteModel, id="x")
print(json.dumps(found))
"""
)

SUCCEEDED, PREEMPTED = 3, 2


@pytest.fixture(autouse=True)
def expected_errors(real_rosbridge: RealRosbridge) -> Iterator[list[str]]:
    """Parts of error messages that the test provokes; any other error in the log of the rosbridge is a failure."""
    expected: list[str] = []
    before = len(real_rosbridge.log_errors)
    yield expected
    errors = (
        real_rosbridge.log_errors[before:] if before <= len(real_rosbridge.log_errors) else real_rosbridge.log_errors
    )
    assert [line for line in errors if not any(part in line for part in expected)] == []


@pytest.fixture(scope="module")
def simulation(knowledge: KnowledgeBase) -> Iterator[Simulation]:
    with Simulation(knowledge, MujocoEngine()) as simulation:
        assert simulation.spawn(kitchenette()).ok
        yield simulation


@pytest.fixture(scope="module")
def client(real_rosbridge: RealRosbridge) -> Iterator[RosbridgeClient]:
    """The client of the simulation, for all tests: a rosbridge of ROS 1 keeps the services of a closed connection."""
    with RosbridgeClient(real_rosbridge.url, max_reconnect_delay_s=0.5) as client:
        yield client.wait_connected(TIMEOUT_S)


@pytest.fixture(scope="module")
def offered(client: RosbridgeClient, simulation: Simulation) -> Iterator[RosInterface]:
    with RosInterface(simulation, client, ros=RosVersion.ONE) as interface:
        yield interface


@pytest.fixture
def second(real_rosbridge: RealRosbridge, offered: RosInterface) -> Iterator[RosbridgeClient]:
    """Another client."""
    with RosbridgeClient(real_rosbridge.url) as second:
        yield second.wait_connected(TIMEOUT_S)


def services_at(client: RosbridgeClient) -> set[str]:
    return set(client.call_service("/rosapi/services", {}, timeout_s=TIMEOUT_S)["services"])


def all_offered(client: RosbridgeClient, interface: RosInterface) -> bool:
    return set(interface.service_names) <= services_at(client)


def test_every_service_answers_rospy_with_the_original_definitions(
    real_rosbridge: RealRosbridge, client: RosbridgeClient, offered: RosInterface, simulation: Simulation
) -> None:
    eventually(lambda: all_offered(client, offered))
    found = json.loads(real_rosbridge.run(ALL_SERVICES))
    assert client.refusals == ()
    assert found == {
        "spawn_semantic_map": [False, ["Mug"], [], 0],
        "spawn_model": [True, "a", ""],
        "spawn_model twice": [False, "a", "1"],
        "spawn_pro_mesh": [True, "b"],
        "spawn_physics_constraint": True,
        "attach_model_to_parent": True,
        "set_model_pose": True,
        "get_model_pose": [True, [1.0, 2.0, 3.0, 0.0, 0.0, 0.2588, 0.9659]],
        "get_model_pose of nothing": False,
        "get_model_socket_pose": [True, 1.68],
        "set_physics_properties": True,
        "change_material": True,
        "highlight_models": True,
        "object_to_object_state": [True, "on"],
        "checkpoint": True,
        "move_object": True,
        "display_basic_marker": "ball",
        "display_trajectory": "path",
        "remove_marker": True,
        "spawn_robot": [True, "robot"],
        "delete_model": True,
        "delete_all": True,
        "reset_level": True,
    }


def test_topics_and_actions_work_with_rospy(
    real_rosbridge: RealRosbridge, client: RosbridgeClient, offered: RosInterface, simulation: Simulation
) -> None:
    before = len(simulation.state.markers)
    missing_frames = real_rosbridge.run(TOPICS, "/unreal", "1", json.dumps(simulation.state.ids))
    assert json.loads(missing_frames) == []
    eventually(lambda: len(simulation.state.markers) == before + 3)
    eventually(lambda: [group.label for group in simulation.state.highlight_groups] == ["from rospy"])
    assert simulation.state.highlight_groups[0].ids == ("Mug",)
    outcomes = json.loads(real_rosbridge.run(ACTIONS))
    assert outcomes["canceled"] == [True, True, PREEMPTED, "", True]
    assert outcomes["done"] == [None, True, SUCCEEDED, "", True]
    assert client.refusals == ()


def test_plans_are_tried_canceled_and_refused_for_rospy(
    real_rosbridge: RealRosbridge, offered: RosInterface, simulation: Simulation
) -> None:
    opens = json.dumps({"steps": [{"do": "open", "thing": "FridgeDoor"}]})
    moved = {"do": "move", "thing": "Mug", "to": {"position": [1.72, 0.2, 0.85]}}
    uncertain = [{"thing": "Mug", "position_m": 0.03}]
    edge = json.dumps({"steps": [moved, {"do": "wait", "duration_s": 0.5}], "uncertainty": uncertain})
    mug = BodyId("Mug")  # other tests attach it elsewhere
    simulation.run_on_engine(lambda engine: engine.detach(mug), edits=True)
    simulation.run_on_engine(lambda engine: engine.set_pose(mug, Pose(position=(2.0, 0.0, 0.85))), edits=True)
    before, revision = simulation.state.time_s, simulation.state.revision
    succeeded, failed, canceled, refused = json.loads(real_rosbridge.run(PLANS, "/unreal", opens, edge))
    assert (succeeded["state"], succeeded["outcome"], succeeded["samples"]) == (SUCCEEDED, "succeeded", 1)
    assert (failed["state"], failed["outcome"], failed["thing"]) == (SUCCEEDED, "failed", "Mug")
    assert failed["done"] in ([10], [10, 20])  # the last feedback may arrive after the result
    assert (canceled["state"], canceled["ended"]) == (PREEMPTED, True)
    assert canceled["samples"] < 100_000
    assert refused["outcome"] == "unknown"
    assert refused["refusal"] == ["PlanError", "the plan:1: steps[0].thing"]
    assert (simulation.state.time_s, simulation.state.revision) == (before, revision)
    print(f"a plan is canceled within {canceled['cancel_s']:.2f} s")


def test_a_failed_call_returns(
    real_rosbridge: RealRosbridge,
    client: RosbridgeClient,
    second: RosbridgeClient,
    expected_errors: list[str],
) -> None:
    found = json.loads(real_rosbridge.run(MALFORMED))
    assert found["nan"] is False
    success, kind, text = found["ask"]
    assert (success, kind) == (False, "MessageRefused")
    assert "args" in text
    assert client.refusals == ()
    # A response that the rosbridge refuses is replaced by an empty one, since its caller would wait forever.
    expected_errors.append("does not have a field nonsense")
    second.create_service("/unreal/broken", "world_control_msgs/DeleteModel", lambda _: {"nonsense": 1})
    assert json.loads(real_rosbridge.run(MALFORMED, "/unreal", "broken"))["broken"] is False
    eventually(lambda: second.refusals)
    assert [(each.operation, each.name) for each in second.refusals] == [("service_response", "/unreal/broken")]
    assert "nonsense" in second.refusals[0].cause


def test_refusals_are_shown(
    second: RosbridgeClient, client: RosbridgeClient, simulation: Simulation, expected_errors: list[str]
) -> None:
    expected_errors += ["no_such_msgs", "not_a_type"]
    diagnostics: list[Any] = []
    with RosInterface(simulation, second, namespace="second", ros=RosVersion.ONE):
        before = second.refusals
        topic = "/mindstage/diagnostics"
        client.subscribe(topic, diagnostics.append, type="diagnostic_msgs/DiagnosticArray")
        eventually(lambda: client.call_service("/rosapi/subscribers", {"topic": topic})["subscribers"])
        second.create_service("/second/unknown_type", "no_such_msgs/Nothing", dict)
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


def test_everything_is_offered_again_after_the_rosbridge_was_killed(
    real_rosbridge: RealRosbridge, client: RosbridgeClient, offered: RosInterface, simulation: Simulation
) -> None:
    eventually(lambda: all_offered(client, offered))
    real_rosbridge.kill()
    eventually(lambda: client.state is ConnectionState.LOST)
    real_rosbridge.start()
    eventually(lambda: client.connected and all_offered(client, offered))
    before = len(simulation.state.markers)
    real_rosbridge.run(TOPICS, "/unreal", "11", json.dumps(simulation.state.ids))
    eventually(lambda: len(simulation.state.markers) == before + 3)
    assert json.loads(real_rosbridge.run(MALFORMED))["nan"] is False
    assert client.refusals == ()


def test_a_second_simulation_must_have_another_namespace(
    client: RosbridgeClient, second: RosbridgeClient, offered: RosInterface, simulation: Simulation
) -> None:
    eventually(lambda: all_offered(client, offered))
    with pytest.raises(AdvertiseError, match=r"'/unreal/\w+' cannot be advertised.* and \d+ more; .*--namespace"):
        RosInterface(simulation, second, ros=RosVersion.ONE)
    with RosInterface(simulation, second, namespace="other", ros=RosVersion.ONE) as other:
        eventually(lambda: all_offered(second, other))
        kept = {each.name for each in second.refusals}
        assert "/mindstage/ask" in kept
        assert all(name.startswith("/mindstage/") for name in kept)
        assert "use /other/mindstage/ask" in second.refusals[0].cause
        assert not kept.intersection(other.service_names)


def test_the_command_line_joins_a_rosbridge(
    real_rosbridge: RealRosbridge, second: RosbridgeClient, run_ros: Callable[..., str]
) -> None:
    command = [sys.executable, "-m", "mindstage", "serve", "bundled:kitchen", "--ros1", "--namespace", "kitchen"]
    with subprocess.Popen(
        [*command, "--connect", real_rosbridge.url], cwd=ROOT, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            eventually(lambda: "/kitchen/mindstage/ask" in services_at(second), timeout_s=60.0)
            assert "/kitchen/spawn_model" in run_ros("rosservice", "list").split()
            found = run_ros("rosservice", "call", "/kitchen/get_model_pose", "id: fridge_door")
            assert "success: True" in found
            assert "child_frame_id" in run_ros("rostopic", "echo", "-n1", "/tf")
        finally:
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=TIMEOUT_S)
    assert (
        "refused" not in errors.replace("use /kitchen/mindstage/ask", "").split("another client")[0]
        or "another client" in errors
    )


@pytest.fixture
def run_ros(real_rosbridge: RealRosbridge) -> Callable[..., str]:
    """Runs one of ROS's own commands."""

    def run(program: str, *arguments: str) -> str:
        done = subprocess.run(
            ["/usr/bin/python3", f"/usr/bin/{program}", *arguments],
            env=real_rosbridge.environment(),
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run
