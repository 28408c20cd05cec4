"""Names that are imported when they are first used, and calls after an import."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

__all__ = ["lazy_names", "when_imported"]


def lazy_names(
    package: str, modules: Sequence[str] | Mapping[str, str], *, packages: Sequence[str] = ()
) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """The functions `__getattr__` and `__dir__` (PEP 562) of a package that lists its names in `__all__`.

    Args:
        package: the name of the package.
        modules: the absolute names of the modules that define its names, searched in this order by their `__all__`; or
            the module of each name that the package does not import itself.
        packages: the names of sub-packages for users.
    """

    def get(name: str) -> object:
        namespace = vars(sys.modules[package])
        if name in packages:
            return import_module(f"{package}.{name}")
        if isinstance(modules, Mapping):
            candidates = [modules[name]] if name in modules else []
        else:
            candidates = list(modules) if name in namespace["__all__"] else []
        for module in map(import_module, candidates):
            if name in module.__all__:
                namespace[name] = getattr(module, name)
                return namespace[name]
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    def names() -> list[str]:
        return [*vars(sys.modules[package])["__all__"], *packages]

    return get, names


def when_imported(module: str, function: Callable[[ModuleType], object]) -> None:
    """Calls a function with a module at the end of its first import, at once if it has been imported.

    Args:
        module: the absolute name of a top-level module, which need not exist.
        function: called once; if it raises, the import of the module fails.
    """
    if module in sys.modules:
        function(sys.modules[module])
    else:
        sys.meta_path.insert(0, _ImportHook(module, function))


class _ImportHook:
    """Finds one module by the other finders, and calls a function once it has been executed."""

    def __init__(self, module: str, function: Callable[[ModuleType], object]) -> None:
        self._module, self._function = module, function

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The spec of the module with a loader that calls the function; None for other modules."""
        if fullname != self._module:
            return None
        others = (finder for finder in sys.meta_path if finder is not self)
        specs = (finder.find_spec(fullname, path, target) for finder in others)
        spec = next(filter(None, specs), None)
        loader: Any = spec.loader if spec is not None else None
        if hasattr(loader, "exec_module"):
            # Changing the loader itself keeps its type, by which resources and sources of the module are found.
            loader.exec_module = partial(self._execute, loader.exec_module)
        return spec

    def _execute(self, execute: Callable[[ModuleType], object], module: ModuleType) -> None:
        execute(module)
        if module.__name__ == self._module and self in sys.meta_path:  # a loader may be shared with other modules
            sys.meta_path.remove(self)
            self._function(module)
