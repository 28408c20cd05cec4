"""Viewport: the page in a browser, to see a world and reach into it."""

from mindstage.viewport.photograph import Screenshot
from mindstage.viewport.sights import LabelMode
from mindstage.viewport.viewport import Viewer

__all__ = ["LabelMode", "Screenshot", "Viewer"]
