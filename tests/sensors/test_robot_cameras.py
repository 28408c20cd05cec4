"""Cameras that descriptions of robots state: of Gazebo in URDF, and of MJCF."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mindstage.robots.models.reading import load_model
from mindstage.robots.models.robot_model import RobotSensor
from mindstage.scene.transforms import rotation_matrix
from tests.robots.rooms import box, robot_in

URDF = """<robot name="r"><link name="base_link"/>
<gazebo reference="base_link">
  <sensor name="eye" type="camera"><pose>0.1 0 0.2 0 0 1.5707963</pose><update_rate>15</update_rate>
    <camera><image><width>320</width><height>200</height></image><clip><near>0.1</near><far>8</far></clip>
      <lens><intrinsics><fx>300</fx><fy>290</fy><cx>160</cx><cy>100</cy></intrinsics></lens>
      <distortion><k1>-0.1</k1><p2>0.001</p2></distortion>
      <noise><type>gaussian</type><stddev>0.007</stddev></noise></camera></sensor>
  <sensor name="sonar" type="sonar"/>
  <sensor name="blind" type="camera"><camera><image><width>0</width><height>200</height></image></camera></sensor>
</gazebo></robot>"""
MJCF = """<mujoco><worldbody><body name="base"><geom size="0.1"/>
<camera name="eye" pos="0 0 0.3" fovy="60" xyaxes="0 -1 0 0 0 1"/></body></worldbody></mujoco>"""


def axes(sensor: RobotSensor) -> np.ndarray:
    """The columns are the directions right, down and forward of a camera, in the frame of its link."""
    return np.asarray(rotation_matrix(np.array(sensor.pose.quaternion))).round(6)


def test_a_camera_of_gazebo_has_its_intrinsics_pose_and_noise_and_others_are_named(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(URDF)
    model = load_model(tmp_path / "r.urdf")
    (eye,) = model.sensors
    assert eye.camera is not None
    assert (eye.camera.width, eye.camera.fx, eye.camera.cx, eye.camera.cy) == (320, 300.0, 159.5, 99.5)
    assert (eye.camera.near_m, eye.camera.far_m, eye.camera.rate_hz) == (0.1, 8.0, 15.0)
    assert eye.camera.distortion == (-0.1, 0.0, 0.0, 0.001, 0.0)
    assert eye.camera.noise.color_std == 0.007
    assert eye.pose.position == pytest.approx((0.1, 0.0, 0.2))
    assert axes(eye)[:, 2] == pytest.approx([0.0, 1.0, 0.0], abs=1e-6), "x of the sensor is forward, turned to y"
    assert axes(eye)[:, 1] == pytest.approx([0.0, 0.0, -1.0], abs=1e-6)
    notes = " ".join(each.text for each in model.notes)
    assert "the sensor sonar of type 'sonar' is left out" in notes
    assert "the camera blind is left out: size 0" in notes


def test_a_camera_of_mjcf_looks_along_its_negative_z_axis(tmp_path: Path) -> None:
    (tmp_path / "r.xml").write_text(MJCF)
    (eye,) = load_model(tmp_path / "r.xml").sensors
    assert eye.camera is not None
    assert eye.camera.height / 2 / eye.camera.fy == pytest.approx(np.tan(np.radians(30.0)))
    assert axes(eye)[:, 2] == pytest.approx([1.0, 0.0, 0.0], abs=1e-6)
    assert axes(eye)[:, 1] == pytest.approx([0.0, 0.0, -1.0], abs=1e-6)


def test_the_head_of_the_bundled_robot_sees_what_is_ahead_and_not_its_housing() -> None:
    with robot_in(box("wall", (2.0, 0.0, 1.0), (0.2, 6.0, 4.0)), at=(0.0, 0.0, 0.0)) as robot:
        camera = robot.session.camera("head")
        image = camera.capture()
        seen = image.segmentation.at(240, 320)
        assert seen is not None
        assert seen.id == "wall"
        assert image.depth[240, 320] == pytest.approx(1.9 - camera.pose.position[0], abs=1e-3)
        assert robot.session.cameras == (f"{robot.name}/head_camera", f"{robot.name}/hand_camera")
        assert robot.session.camera("hand").segmentation().seen()
