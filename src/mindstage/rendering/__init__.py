"""Pictures of worlds: the appearance of bodies, cameras, and renderers."""

from mindstage.rendering.camera import CameraPose, FramingTarget
from mindstage.rendering.screenshot import LabelMode, Screenshot

__all__ = ["CameraPose", "FramingTarget", "LabelMode", "Screenshot"]
