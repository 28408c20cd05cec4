"""Generated homes: places with furniture, fronts that open, and things, as worlds of known truth."""

from typing import TYPE_CHECKING

from mindstage.lazy_names import lazy_names

if TYPE_CHECKING:
    from mindstage.homes.friction import ThingFriction, true_frictions
    from mindstage.homes.generator import generate_home
    from mindstage.homes.styles import HomeDialect, HomePart, HomeStyle
    from mindstage.homes.written_home import WrittenHome, write_home

__all__ = [
    "HomeDialect",
    "HomePart",
    "HomeStyle",
    "ThingFriction",
    "WrittenHome",
    "generate_home",
    "true_frictions",
    "write_home",
]

_MODULES = {
    "HomeDialect": "mindstage.homes.styles",
    "HomePart": "mindstage.homes.styles",
    "HomeStyle": "mindstage.homes.styles",
    "ThingFriction": "mindstage.homes.friction",
    "WrittenHome": "mindstage.homes.written_home",
    "generate_home": "mindstage.homes.generator",
    "true_frictions": "mindstage.homes.friction",
    "write_home": "mindstage.homes.written_home",
}

__getattr__, __dir__ = lazy_names(__name__, _MODULES)
