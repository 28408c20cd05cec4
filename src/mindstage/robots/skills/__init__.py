"""Skills of robots: what they do with things, by what a map states about them.

A module is imported when one of its names is first used: the declarations are cheap, motion planning is not.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mindstage.robots.skills.catalog import SKILLS, start_skill
    from mindstage.robots.skills.declaration import (
        ParameterType,
        SkillNeed,
        SkillOutcome,
        SkillParameter,
        SkillResult,
        SkillSpec,
        SkillState,
        SkillStep,
        split_command,
    )

__all__ = [
    "SKILLS",
    "ParameterType",
    "SkillNeed",
    "SkillOutcome",
    "SkillParameter",
    "SkillResult",
    "SkillSpec",
    "SkillState",
    "SkillStep",
    "split_command",
    "start_skill",
]


def __getattr__(name: str) -> object:
    for module in ("declaration", "catalog") if name in __all__ else ():
        found = import_module(f"{__name__}.{module}")
        if name in found.__all__:
            value: object = getattr(found, name)
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
