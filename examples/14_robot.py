"""Add a robot, drive it, and let it open a drawer by what the map states about it."""

import mindstage as ms
from mindstage.robots import add_robot

with ms.open("bundled:kitchen") as sim:
    sim.step(0.5)
    robot = add_robot(sim, "mobile_manipulator", (0.6, 0.6, 0.0))
    print(robot)
    moved = robot.run(robot.driving([(0.2, 0.6, 1.57)]))
    print("driven in", round(moved.duration_s, 1), "s to", [round(each, 2) for each in robot.base_pose()])
    robot.run(robot.moving_to({"head_pan_joint": 0.5}))
    robot.run(robot.gripping("gripper", 0.1))
    print("the gripper is open by", round(robot.opening(), 2), "m")
    result = robot.do("open drawer_left_2")
    for step in result.steps:
        print("  " * step.depth, step.text)
    print(f"open drawer_left_2: {result.outcome} after {result.duration_s:.0f} s")
    (drawer,) = sim.ask("articulated_parts", part="drawer_left_2")
    print("drawer_left_2 is", drawer.state)
