"""Open a URDF file as a map, move its joint, and save it as a semantic map."""

import tempfile
from pathlib import Path

import mindstage as ms

URDF = """<robot name="gate">
  <link name="post"><visual><geometry><box size="0.1 0.1 1"/></geometry></visual></link>
  <link name="leaf">
    <visual><origin xyz="0.4 0 0"/><geometry><box size="0.8 0.04 0.8"/></geometry></visual>
    <collision><origin xyz="0.4 0 0"/><geometry><box size="0.8 0.04 0.8"/></geometry></collision>
    <inertial><origin xyz="0.4 0 0"/><mass value="4"/>
      <inertia ixx="0.2" iyy="0.4" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="hinge" type="revolute"><parent link="post"/><child link="leaf"/><origin xyz="0.05 0 0"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="1.5" effort="10" velocity="1"/></joint>
</robot>"""

with tempfile.TemporaryDirectory() as folder:
    robot = Path(folder, "gate.urdf")
    robot.write_text(URDF)
    with ms.open(robot) as sim:
        hinge = sim.joint("hinge")
        print(hinge)
        print(hinge.move_to(1.0))
        sim.save(Path(folder, "gate.owl"))
    print(ms.load(Path(folder, "gate.owl")))
