"""A robot at a real rosbridge: rospy and actionlib use it as a real one, with the messages of ROS 1."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from mindstage.bridge import RosbridgeClient
from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.msgs import RosVersion
from mindstage.robots import add_robot
from mindstage.ros import RosInterface
from mindstage.scene import Pose
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S
from tests.kitchenette import kitchenette
from tests.ros.conftest import RunRospy

ROSPY = """
import json, threading, time
import actionlib, rospy
from actionlib_msgs.msg import GoalStatus
from control_msgs.msg import FollowJointTrajectoryAction, FollowJointTrajectoryGoal
from control_msgs.msg import GripperCommandAction, GripperCommandGoal
from controller_manager_msgs.srv import ListControllers
from geometry_msgs.msg import PoseStamped, Twist
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectoryPoint

rospy.init_node("program", anonymous=True, disable_signals=True)
found = {}

def client(name, type):
    made = actionlib.SimpleActionClient(name, type)
    assert made.wait_for_server(rospy.Duration(20)), name
    return made

def positions():
    message = rospy.wait_for_message("/joint_states", JointState, 10)
    return dict(zip(message.name, message.position))

def trajectory(joint, target, duration):
    goal = FollowJointTrajectoryGoal()
    goal.trajectory.joint_names = [joint]
    point = JointTrajectoryPoint(positions=[target], velocities=[0], time_from_start=rospy.Duration(duration))
    goal.trajectory.points = [point]
    return goal

arm = client("/arm_controller/follow_joint_trajectory", FollowJointTrajectoryAction)
target = positions()["elbow_joint"] - 0.4
feedback = []
arm.send_goal(trajectory("elbow_joint", target, 1.0), feedback_cb=feedback.append)
arm.wait_for_result(rospy.Duration(20))
rospy.sleep(0.2)
found["reached"] = [arm.get_state(), arm.get_result().error_code, abs(positions()["elbow_joint"] - target) < 0.02,
                    len(feedback) > 3, feedback[-1].joint_names]

arm.send_goal(trajectory("elbow_joint", 99.0, 1.0))
arm.wait_for_result(rospy.Duration(20))
found["refused"] = [arm.get_state(), arm.get_result().error_code, arm.get_result().error_string]

begun = threading.Event()
arm.send_goal(trajectory("elbow_joint", target - 1.5, 4.0), feedback_cb=lambda _: begun.set())
assert begun.wait(20)
rospy.sleep(0.8)
start = time.monotonic()
arm.cancel_goal()
arm.wait_for_result(rospy.Duration(20))
found["cancel_s"] = time.monotonic() - start
rospy.sleep(0.3)
held = positions()["elbow_joint"]
rospy.sleep(0.3)
found["canceled"] = [arm.get_state(), abs(positions()["elbow_joint"] - held) < 0.005]

hand = client("/gripper_controller/gripper_cmd", GripperCommandAction)
goal = GripperCommandGoal()
goal.command.position, goal.command.max_effort = 0.03, 30.0
hand.send_goal(goal)
hand.wait_for_result(rospy.Duration(20))
found["gripper"] = [hand.get_state(), hand.get_result().reached_goal, round(hand.get_result().position, 2)]

base = client("/move_base", MoveBaseAction)
goal = MoveBaseGoal(target_pose=PoseStamped())
goal.target_pose.header.frame_id = "map"
goal.target_pose.pose.position.x, goal.target_pose.pose.position.y = -0.8, -0.3
goal.target_pose.pose.orientation.w = 1.0
base.send_goal(goal)
base.wait_for_result(rospy.Duration(40))
found["base"] = base.get_state()

velocity = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
def x():
    odometry = rospy.wait_for_message("/odom", Odometry, 10)
    return odometry.pose.pose.position.x, odometry.header.frame_id, odometry.child_frame_id
before = x()
command = Twist()
command.linear.x = -0.4
for _ in range(15):
    velocity.publish(command)
    rospy.sleep(0.1)
found["driven"] = [before[0] - x()[0] > 0.2, *before[1:]]

listed = rospy.ServiceProxy("/controller_manager/list_controllers", ListControllers)()
found["controllers"] = sorted(each.name for each in listed.controller if each.state == "running")
found["description"] = "base_footprint" in rospy.get_param("/robot_description")
frames = {each.child_frame_id: each.header.frame_id for each in rospy.wait_for_message("/tf", TFMessage, 10).transforms}
found["frames"] = [frames["base_footprint"], frames["lift_link"]]
print(json.dumps(found))
"""
SUCCEEDED, PREEMPTED, REJECTED = 3, 2, 5


@pytest.fixture(scope="module")
def simulation() -> Iterator[Simulation]:
    with KnowledgeBase() as knowledge, Simulation(knowledge, MujocoEngine()) as simulation:
        assert simulation.spawn(kitchenette()).ok
        add_robot(simulation, "mobile_manipulator", Pose((-0.3, 0.5, 0.0)))
        simulation.play()
        yield simulation


def test_rospy_uses_the_robot_as_a_real_one(real_rosbridge: str, run_rospy: RunRospy, simulation: Simulation) -> None:
    with RosbridgeClient(real_rosbridge) as client:
        client.wait_connected(TIMEOUT_S)
        with RosInterface(simulation, client, ros=RosVersion.ONE, namespace="plant"):
            found: dict[str, Any] = json.loads(run_rospy(ROSPY))
            refusals = [each for each in client.refusals if "plant" not in each.cause]
    assert refusals == []
    assert found["reached"] == [SUCCEEDED, 0, True, True, ["elbow_joint"]]
    assert found["refused"][:2] == [REJECTED, -1]
    assert "elbow_joint = 99 rad" in found["refused"][2]
    assert found["canceled"] == [PREEMPTED, True]
    assert found["gripper"] == [SUCCEEDED, True, 0.03]
    assert found["base"] == SUCCEEDED
    assert found["driven"] == [True, "odom", "base_footprint"]
    assert {"arm_controller", "gripper_controller", "head_controller"} <= set(found["controllers"])
    assert found["description"]
    assert found["frames"] == ["odom", "base_link"]
    print(f"a trajectory is canceled within {found['cancel_s']:.2f} s of wall time")
