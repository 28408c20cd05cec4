"""Viewport: the page in a browser, to see a world and reach into it."""

from mindstage.viewer.camera import LabelMode
from mindstage.viewer.screenshot import Screenshot
from mindstage.viewer.viewer import Viewer

__all__ = ["LabelMode", "Screenshot", "Viewer"]
