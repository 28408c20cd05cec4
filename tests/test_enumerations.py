"""Enumerations compare equal to their values, and are encoded as these."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from enum import Enum, IntEnum, StrEnum

import msgspec

import mindstage
from tests.cases import each_case

INTERNAL = {"EpisodeTopic", "ResourceErrorType", "Unbound"}
"""Enumerations without words, which are not part of any interface."""


def enumerations() -> list[type[Enum]]:
    found: dict[str, type[Enum]] = {}
    for module in pkgutil.walk_packages(mindstage.__path__, "mindstage."):
        if module.name.rpartition(".")[2] in {"__main__"} or module.name.endswith("_process"):
            continue
        loaded = importlib.import_module(module.name)
        for name, each in inspect.getmembers(loaded, inspect.isclass):
            if issubclass(each, Enum) and each.__module__.startswith("mindstage."):
                found[f"{each.__module__}.{name}"] = each
    return sorted(found.values(), key=lambda each: f"{each.__module__}.{each.__qualname__}")


@each_case("kind", [each for each in enumerations() if each.__name__ not in INTERNAL], ids=str)
def test_a_member_equals_its_value(kind: type[Enum]) -> None:
    assert issubclass(kind, StrEnum | IntEnum)
    for member in kind:
        assert member == member.value
        assert msgspec.json.decode(msgspec.json.encode(member)) == member.value
        assert type(msgspec.to_builtins(member)) in {str, int}
        assert msgspec.convert(member.value, kind) is member
    if issubclass(kind, StrEnum):
        assert sorted(kind) == sorted(member.value for member in kind)
        assert dict.fromkeys(kind, 1).keys() == {str(member.value) for member in kind}
        assert all(f"{member}" == member.value for member in kind)
