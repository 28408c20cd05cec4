"""The web viewer: a page on which a simulation is seen, edited and queried in a browser."""

from mindstage.viewer.viewer import Viewer

__all__ = ["Viewer"]

__dir__ = __all__.copy
