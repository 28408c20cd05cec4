"""Simulates OWL semantic maps as physics worlds that answer questions and can be written back to maps.

    import mindstage as ms

    with ms.open("kitchen.owl") as sim:
        sim.step(1.0)
        for answer in sim.ask("storage_place", item="CowsMilk"):
            sim.highlight(answer.individual, color="green")
        sim.joint("fridge_door").open()
        sim.save("now.owl")
    print(ms.diff("kitchen.owl", "now.owl"))

Submodules are imported when one of their names is first used. The environments of Gymnasium are registered as soon as
it is imported, before or after this package; `gymnasium.make("mindstage:mindstage/Open-v0")` imports this package.
"""

from types import ModuleType
from typing import TYPE_CHECKING

from mindstage.lazy_names import lazy_names, when_imported

if TYPE_CHECKING:
    from mindstage.api import connect, diff, load, open, save, view  # noqa: A004
    from mindstage.engines import NullEngine
    from mindstage.engines.mujoco import MujocoEngine
    from mindstage.homes import generate_home, write_home
    from mindstage.imagination import evaluate_plan, try_first
    from mindstage.knowledge import KnowledgeBase
    from mindstage.pictures import shot
    from mindstage.rendering import Screenshot
    from mindstage.scene import World
    from mindstage.simulation import Simulation
    from mindstage.viewer import Viewer

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
    "evaluate_plan",
    "generate_home",
    "load",
    "open",
    "save",
    "shot",
    "try_first",
    "view",
    "write_home",
]

__version__ = "0.1.0"

_MODULES = {
    "KnowledgeBase": "mindstage.knowledge",
    "MujocoEngine": "mindstage.engines.mujoco",
    "NullEngine": "mindstage.engines",
    "Screenshot": "mindstage.rendering",
    "Simulation": "mindstage.simulation",
    "Viewer": "mindstage.viewer",
    "World": "mindstage.scene",
    "connect": "mindstage.api",
    "diff": "mindstage.api",
    "evaluate_plan": "mindstage.imagination",
    "generate_home": "mindstage.homes",
    "load": "mindstage.api",
    "open": "mindstage.api",
    "save": "mindstage.api",
    "shot": "mindstage.pictures",
    "try_first": "mindstage.imagination",
    "view": "mindstage.api",
    "write_home": "mindstage.homes",
}


_PACKAGES = (
    *("access", "assets", "bridge", "engines", "episodes", "errors", "geometry", "gym", "homes", "imagination"),
    *("knowledge", "maps", "msgs", "prolog", "rdf", "rendering", "robots", "ros", "scene", "sensors", "simulation"),
    *("textures", "viewer"),
)
"""Those with a page in the reference."""


__getattr__, __dir__ = lazy_names(__name__, _MODULES, packages=_PACKAGES)

_EPISODE_STEPS = {"Open": 300, "Pick": 300, "Place": 500, "PutAway": 1000}
"""The number of actions after which an episode is truncated, by the name of the environment."""


def _register_environments(gymnasium: ModuleType) -> None:
    """Registers `mindstage/Open-v0` and the others, without importing what they consist of."""
    for name, steps in _EPISODE_STEPS.items():
        id = f"mindstage/{name}-v0"
        if id not in gymnasium.registry:
            gymnasium.register(id, entry_point=f"mindstage.gym:{name}Env", max_episode_steps=steps)


when_imported("gymnasium", _register_environments)
