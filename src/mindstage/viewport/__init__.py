"""Viewport: the page in a browser, to see a world and reach into it."""

from mindstage.viewport.viewport import Viewport

__all__ = ["Viewport"]
