"""Generated homes: places with furniture, fronts that open, and things, as worlds of known truth."""

from typing import TYPE_CHECKING

from mindstage.lazy_names import lazy_names

if TYPE_CHECKING:
    from mindstage.homes.generator import generate_home
    from mindstage.homes.styles import HomePart, HomeStyle

__all__ = ["HomePart", "HomeStyle", "generate_home"]

_MODULES = {
    "HomePart": "mindstage.homes.styles",
    "HomeStyle": "mindstage.homes.styles",
    "generate_home": "mindstage.homes.generator",
}

__getattr__, __dir__ = lazy_names(__name__, _MODULES)
