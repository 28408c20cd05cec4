"""Generated homes: places with furniture, fronts that open, and things, as worlds of known truth."""

from typing import TYPE_CHECKING

from mindstage.lazy_names import lazy_names

if TYPE_CHECKING:
    from mindstage.homes.generator import generate_home
    from mindstage.homes.styles import HomeDialect, HomePart, HomeStyle
    from mindstage.homes.written_home import WrittenHome, write_home

__all__ = ["HomeDialect", "HomePart", "HomeStyle", "WrittenHome", "generate_home", "write_home"]

_MODULES = {
    "HomeDialect": "mindstage.homes.styles",
    "HomePart": "mindstage.homes.styles",
    "HomeStyle": "mindstage.homes.styles",
    "WrittenHome": "mindstage.homes.written_home",
    "generate_home": "mindstage.homes.generator",
    "write_home": "mindstage.homes.written_home",
}

__getattr__, __dir__ = lazy_names(__name__, _MODULES)
