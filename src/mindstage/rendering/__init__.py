"""Pictures of worlds: the appearance of bodies, cameras, and renderers."""

from typing import TYPE_CHECKING

from mindstage.lazy_names import lazy_names
from mindstage.rendering.camera import CameraPose, FramingTarget
from mindstage.rendering.screenshot import LabelMode, Screenshot

if TYPE_CHECKING:
    from mindstage.rendering.path_tracing import PathTracedPicture, PathTracingSettings

__all__ = ["CameraPose", "FramingTarget", "LabelMode", "PathTracedPicture", "PathTracingSettings", "Screenshot"]

_PATH_TRACING = "mindstage.rendering.path_tracing"

__getattr__, __dir__ = lazy_names(__name__, {"PathTracedPicture": _PATH_TRACING, "PathTracingSettings": _PATH_TRACING})
