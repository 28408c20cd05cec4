"""Sensors that a URDF states for Gazebo: `<gazebo reference="LINK"><sensor>`, whose contents are SDF.

Cameras have their intrinsics, distortion, range, rate, noise and pose from there; of other sensors, the type and link.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np

from mindstage.errors import InvalidArgumentError
from mindstage.robots.models.robot_model import ModelNote, RobotSensor, SensorType
from mindstage.scene import Pose
from mindstage.scene.transforms import Array, quaternion_from_matrix
from mindstage.sensors.camera_model import CameraModel, CameraNoise

__all__ = ["OPTICAL_FROM_FORWARD", "read_gazebo_sensors"]

_TYPES = {
    "camera": SensorType.CAMERA,
    "wideanglecamera": SensorType.CAMERA,
    "depth": SensorType.DEPTH_CAMERA,
    "depth_camera": SensorType.DEPTH_CAMERA,
    "rgbd_camera": SensorType.DEPTH_CAMERA,
    "rgbd": SensorType.DEPTH_CAMERA,
    "ray": SensorType.LASER_SCANNER,
    "gpu_ray": SensorType.LASER_SCANNER,
    "lidar": SensorType.LASER_SCANNER,
    "gpu_lidar": SensorType.LASER_SCANNER,
    "imu": SensorType.IMU,
    "force_torque": SensorType.FORCE_TORQUE,
}
"""The types of sensors by their names in SDF."""
OPTICAL_FROM_FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""The axes of an optical frame (x right, y down, z forward), as columns, in a frame with x forward and z up."""


def read_gazebo_sensors(urdf: str, notes: list[ModelNote]) -> tuple[RobotSensor, ...]:
    """Reads the sensors of the links of a URDF.

    Args:
        urdf: its text, without xacro; empty for a robot that is not described by one.
        notes: gets what is left out.
    """
    if "<sensor" not in urdf:
        return ()
    root = ElementTree.fromstring(urdf.encode())
    found = []
    for link, element in _elements(root):
        name, kind = element.get("name", ""), element.get("type", "")
        type = _TYPES.get(kind)
        if type is None or not name:
            text = (
                f"the sensor {name or 'without a name'} of type {kind!r} is left out: the types are {', '.join(_TYPES)}"
            )
            notes.append(ModelNote(subject=link, text=text, is_guess=False))
            continue
        camera = None
        rotation, position = _pose(element.find("pose"))
        if type in {SensorType.CAMERA, SensorType.DEPTH_CAMERA}:
            try:
                camera = _camera(element, notes, link)
            except (ValueError, InvalidArgumentError) as error:
                text = f"the camera {name} is left out: {error}"
                notes.append(ModelNote(subject=link, text=text, is_guess=False))
                continue
            inner, offset = _pose(element.find("camera/pose"))
            position, rotation = position + rotation @ offset, rotation @ inner @ OPTICAL_FROM_FORWARD
        w, x, y, z = quaternion_from_matrix(rotation).tolist()
        px, py, pz = position.tolist()
        pose = Pose((px, py, pz), (w, x, y, z))
        found.append(RobotSensor(name=name, type=type, link=link, camera=camera, pose=pose))
    return tuple(found)


def _elements(root: ElementTree.Element) -> Iterator[tuple[str, ElementTree.Element]]:
    """The sensors with their links; those of joints are at the child link."""
    child = {
        joint.get("name", ""): link.get("link", "")
        for joint in root.iter("joint")
        if (link := joint.find("child")) is not None
    }
    for gazebo in root.iter("gazebo"):
        at = gazebo.get("reference", "")
        for element in gazebo.iter("sensor"):
            yield child.get(at, at), element


def _camera(element: ElementTree.Element, notes: list[ModelNote], link: str) -> CameraModel:
    camera = element.find("camera")
    if camera is None:
        raise ValueError("it has no element <camera>")
    width, height = (
        int(_number(camera, f"image/{side}", default)) for side, default in (("width", 320), ("height", 240))
    )
    others: dict[str, Any] = {
        "near_m": _number(camera, "clip/near", 0.1),
        "far_m": _number(camera, "clip/far", 100.0),
        "rate_hz": _number(element, "update_rate", 30.0) or 30.0,
        "noise": CameraNoise(color_std=_number(camera, "noise/stddev", 0.0)),
    }
    distortion = tuple(_number(camera, f"distortion/{key}", 0.0) for key in ("k1", "k2", "p1", "p2", "k3"))
    if any(distortion):
        others["distortion"] = distortion
    intrinsics = camera.find("lens/intrinsics")
    if intrinsics is not None:  # SDF counts pixels from the upper left corner of the image
        fx, fy, cx, cy = (_number(intrinsics, key, 0.0) for key in ("fx", "fy", "cx", "cy"))
        return CameraModel(width=width, height=height, fx=fx, fy=fy, cx=cx - 0.5, cy=cy - 0.5, **others)
    if others["noise"].color_std:
        notes.append(ModelNote(subject=link, text=f"its camera has the noise of the description: {others['noise']}"))
    return CameraModel.with_field_of_view(_number(camera, "horizontal_fov", 1.047), (width, height), **others)


def _number(element: ElementTree.Element, path: str, default: float) -> float:
    text = element.findtext(path)
    return default if text is None or not text.strip() else float(text)


def _pose(element: ElementTree.Element | None) -> tuple[Array, Array]:
    """Rotation and position of an SDF pose: x y z roll pitch yaw."""
    numbers = [0.0] * 6 if element is None or not element.text else [float(each) for each in element.text.split()]
    if len(numbers) != 6:
        numbers = (numbers + [0.0] * 6)[:6]
    roll, pitch, yaw = numbers[3:]
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(each), np.sin(each)) for each in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x, np.array(numbers[:3])
