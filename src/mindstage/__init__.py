"""Mindstage turns what a robot knows about a place into a place it can act in."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mindstage.engines import MujocoEngine, NullEngine
    from mindstage.knowledge import KnowledgeBase
    from mindstage.stage import Stage
    from mindstage.viewport import Shot, Viewport
    from mindstage.world import World, difference

__all__ = [
    "KnowledgeBase",
    "MujocoEngine",
    "NullEngine",
    "Shot",
    "Stage",
    "Viewport",
    "World",
    "__version__",
    "difference",
]

__version__ = "0.1.0"

_ROOMS = {
    "KnowledgeBase": "mindstage.knowledge",
    "MujocoEngine": "mindstage.engines",
    "NullEngine": "mindstage.engines",
    "Shot": "mindstage.viewport",
    "Stage": "mindstage.stage",
    "Viewport": "mindstage.viewport",
    "World": "mindstage.world",
    "difference": "mindstage.world",
}


def __getattr__(name: str) -> object:
    # Each room loads when it is first used, so that importing the package alone costs nothing.
    if name in _ROOMS:
        return getattr(import_module(_ROOMS[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
