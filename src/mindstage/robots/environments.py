"""The names of the environments of Gymnasium, registered without importing what they consist of."""

from __future__ import annotations

__all__ = ["register_environments"]

_STEPS = {"Open": 300, "Pick": 300, "Place": 500, "PutAway": 1000}
"""The number of actions after which an episode is truncated, by the name of the environment."""


def register_environments() -> None:
    """Registers `mindstage/Open-v0` and the others, once."""
    import gymnasium

    for name, steps in _STEPS.items():
        id = f"mindstage/{name}-v0"
        if id not in gymnasium.registry:
            gymnasium.register(id, entry_point=f"mindstage.robots.gym:{name}Env", max_episode_steps=steps)
