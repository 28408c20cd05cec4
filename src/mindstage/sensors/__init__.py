"""Sensors: what cameras measure in a running simulation, in the terms of ROS and OpenCV."""

from typing import TYPE_CHECKING

from mindstage.lazy_names import lazy_names
from mindstage.sensors.camera_model import CameraModel, CameraMount, CameraNoise

if TYPE_CHECKING:
    from mindstage.rendering.sensor_view import SensorLighting
    from mindstage.sensors.camera import Camera, CameraImages, Segmentation

__all__ = ["Camera", "CameraImages", "CameraModel", "CameraMount", "CameraNoise", "Segmentation", "SensorLighting"]

_CAMERA = "mindstage.sensors.camera"

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "Camera": _CAMERA,
        "CameraImages": _CAMERA,
        "Segmentation": _CAMERA,
        "SensorLighting": "mindstage.rendering.sensor_view",
    },
)
