"""Generated homes: places with furniture, fronts that open, and things, as worlds of known truth."""

from mindstage.homes.generator import HomePart, HomeStyle, generate_home

__all__ = ["HomePart", "HomeStyle", "generate_home"]

__dir__ = __all__.copy
