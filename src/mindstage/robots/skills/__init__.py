"""Skills of robots: what they do with things, by what a map states about them."""

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
