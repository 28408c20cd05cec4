"""Simulates OWL semantic maps as physics worlds that answer questions and can be written back to maps.

    import mindstage as ms

    with ms.open("kitchen.owl") as sim:
        sim.step(1.0)
        for answer in sim.ask("storage_place", item="CowsMilk"):
            sim.highlight(answer.individual, color="green")
        sim.joint("fridge_door").open()
        sim.save("now.owl")
    print(ms.diff("kitchen.owl", "now.owl"))

Submodules are imported when one of their names is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mindstage.api import connect, diff, load, open, save, view  # noqa: A004
    from mindstage.engines import MujocoEngine, NullEngine
    from mindstage.imagination import imagine, try_first
    from mindstage.knowledge import KnowledgeBase
    from mindstage.scene import World
    from mindstage.simulation import Simulation
    from mindstage.viewer import Screenshot, Viewer

__all__ = [
    "KnowledgeBase",
    "MujocoEngine",
    "NullEngine",
    "Screenshot",
    "Simulation",
    "Viewer",
    "World",
    "__version__",
    "connect",
    "diff",
    "imagine",
    "load",
    "open",
    "save",
    "try_first",
    "view",
]

__version__ = "0.1.0"

_MODULES = {
    "KnowledgeBase": "mindstage.knowledge",
    "MujocoEngine": "mindstage.engines",
    "NullEngine": "mindstage.engines",
    "Screenshot": "mindstage.viewer",
    "Simulation": "mindstage.simulation",
    "Viewer": "mindstage.viewer",
    "World": "mindstage.scene",
    "connect": "mindstage.api",
    "diff": "mindstage.api",
    "imagine": "mindstage.imagination",
    "load": "mindstage.api",
    "open": "mindstage.api",
    "save": "mindstage.api",
    "try_first": "mindstage.imagination",
    "view": "mindstage.api",
}


def __getattr__(name: str) -> object:
    if name in _MODULES:
        return getattr(import_module(_MODULES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
