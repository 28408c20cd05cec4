"""Viewport: the page in a browser, to see a world and reach into it."""

from mindstage.viewport.photograph import Shot
from mindstage.viewport.sights import Labels
from mindstage.viewport.viewport import Viewport

__all__ = ["Labels", "Shot", "Viewport"]
