"""Skills of robots: what they do with things, by what a map states about them.

A module is imported when one of its names is first used: the declarations are cheap, motion planning is not.
"""

from typing import TYPE_CHECKING

from mindstage.lazy_names import lazy_names

if TYPE_CHECKING:
    from mindstage.robots.skill_declaration import (
        ParameterType,
        SkillNeed,
        SkillOutcome,
        SkillParameter,
        SkillResult,
        SkillSpec,
        SkillState,
        SkillStep,
        skill_specs,
        split_command,
    )
    from mindstage.robots.skill_performance import start_skill
    from mindstage.robots.skills.part_motion import OpeningReach, OpeningStep, PartContact, can_open

__all__ = [
    "OpeningReach",
    "OpeningStep",
    "ParameterType",
    "PartContact",
    "SkillNeed",
    "SkillOutcome",
    "SkillParameter",
    "SkillResult",
    "SkillSpec",
    "SkillState",
    "SkillStep",
    "can_open",
    "skill_specs",
    "split_command",
    "start_skill",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    ["mindstage.robots.skill_declaration", "mindstage.robots.skill_performance", f"{__name__}.part_motion"],
)
