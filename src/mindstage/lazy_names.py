"""Names of a package whose modules are imported when one of their names is first used (PEP 562)."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from importlib import import_module

__all__ = ["lazy_names"]


def lazy_names(package: str, modules: Sequence[str]) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """The functions `__getattr__` and `__dir__` of a package that lists its names in `__all__`.

    Args:
        package: the name of the package.
        modules: the absolute names of the modules that define its names, searched in this order by their `__all__`.
    """

    def get(name: str) -> object:
        namespace = vars(sys.modules[package])
        for module in map(import_module, modules if name in namespace["__all__"] else ()):
            if name in module.__all__:
                namespace[name] = getattr(module, name)
                return namespace[name]
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    def names() -> list[str]:
        namespace = vars(sys.modules[package])
        return sorted({*namespace, *namespace["__all__"]})

    return get, names
