"""The declaration of skills: a typed generator is the declaration, from which every interface is made.

    @skill(needs=(SkillNeed.ARM, SkillNeed.GRIPPER))
    def pick(task: SkillTask, thing: ThingName) -> SkillMotion:
        "Grasps a thing and lifts it."

The name of the function, its docstring and the types of its parameters are the name, the documentation and the
arguments of the skill on the command line, in plans, over ROS and on the page.
"""

from __future__ import annotations

import inspect
import math
import shlex
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import suppress
from enum import StrEnum
from operator import attrgetter
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple, TypeAlias, get_args, get_type_hints

import msgspec

from mindstage.errors import InvalidArgumentError
from mindstage.ranges import Angle, Coordinate, Fraction, check_number, declared_range
from mindstage.registry import Group, catalog
from mindstage.scene import BodyId

__all__ = [
    "AngleRad",
    "ClassName",
    "FractionOpen",
    "LengthM",
    "ParameterType",
    "Skill",
    "SkillMotion",
    "SkillNeed",
    "SkillOutcome",
    "SkillParameter",
    "SkillResult",
    "SkillSpec",
    "SkillState",
    "SkillStep",
    "SkillValue",
    "SupportName",
    "ThingName",
    "skill",
    "skill_specs",
    "split_command",
]

SkillMotion: TypeAlias = Generator[float, None, None]
"""Yields the simulated times [s] by which the caller steps; it fails by raising."""
SkillValue: TypeAlias = str | float


class SkillOutcome(StrEnum):
    """The outcomes of a skill."""

    SUCCEEDED = "succeeded"
    FAILED = "failed"
    UNKNOWN = "unknown"
    """It ended, but whether it had its effect cannot be determined, or it was canceled."""


class SkillNeed(StrEnum):
    """What a robot needs for a skill."""

    MOBILE_BASE = "mobile base"
    ARM = "arm"
    GRIPPER = "gripper"
    HEAD = "head"


class ParameterType(StrEnum):
    """The types of the arguments of skills."""

    THING = "thing"
    """A body of the running world, by id, IRI or words; or a class with one instance in the world."""
    SUPPORT = "support"
    """A thing on or in which others can be put."""
    CLASS = "class"
    """A class, by name."""
    LENGTH = "length"
    """A coordinate in the world frame [m]."""
    ANGLE = "angle"
    """[rad]."""
    FRACTION = "fraction"
    """A number from 0 to 1."""

    @property
    def is_number(self) -> bool:
        """Whether values are numbers rather than names."""
        return self in {ParameterType.LENGTH, ParameterType.ANGLE, ParameterType.FRACTION}


ThingName = Annotated[str, ParameterType.THING]
SupportName = Annotated[str, ParameterType.SUPPORT]
ClassName = Annotated[str, ParameterType.CLASS]
LengthM = Annotated[float, ParameterType.LENGTH]
AngleRad = Annotated[float, ParameterType.ANGLE]
FractionOpen = Annotated[float, ParameterType.FRACTION]


_RANGES = {
    ParameterType.LENGTH: declared_range(Coordinate),
    ParameterType.ANGLE: declared_range(Angle),
    ParameterType.FRACTION: declared_range(Fraction),
}


class SkillParameter(msgspec.Struct, frozen=True, kw_only=True):
    """A parameter of a skill."""

    name: str
    type: ParameterType
    description: str
    required: bool
    default: SkillValue | None = None


class SkillStep(msgspec.Struct, frozen=True, kw_only=True):
    """A part of a performed skill, such as driving somewhere or closing the gripper."""

    name: str
    """A word, such as "drive" or "grasp"; for a skill within a skill its name."""
    text: str
    """What was done, in words, with names and numbers."""
    depth: int
    """0 for a step of the skill itself, 1 for one of a skill that it performs, and so on."""
    start_s: float
    """Simulated time since the start of the skill [s]."""
    end_s: float | None
    """None while it runs."""
    succeeded: bool | None
    """None while it runs."""


class SkillState(msgspec.Struct, frozen=True, kw_only=True):
    """The state in which a skill left the robot and the things that it was about."""

    base: tuple[float, float, float] | None
    """x, y [m] and yaw [rad] in the world frame; None for a robot without a mobile base."""
    held: dict[str, BodyId]
    """The body in each gripper that holds one."""
    supports: dict[BodyId, str]
    """Where each thing that the skill moved is now, in words, such as "on kitchen_table"."""
    openness: dict[BodyId, float]
    """By how much the doors and drawers that it used are open, from 0 to 1."""

    @property
    def text(self) -> str:
        """The state in one sentence."""
        parts = [f"the {gripper} holds {body}" for gripper, body in self.held.items()] or ["nothing is held"]
        parts += [f"{thing} is {where}" for thing, where in self.supports.items()]
        for body, fraction in self.openness.items():
            parts.append(f"{body} is closed" if fraction < 0.02 else f"{body} is {fraction:.0%} open")
        if self.base is not None:
            parts.append(f"the robot stands at ({self.base[0]:.2f}, {self.base[1]:.2f})")
        return "; ".join(parts)


class SkillResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a skill; truthy if it succeeded."""

    outcome: SkillOutcome
    skill: str
    args: dict[str, SkillValue]
    reason: str
    """Why it failed, or is unknown, with names and numbers; empty if it succeeded."""
    assumptions: tuple[str, ...]
    """What was assumed, such as that no better place to stand would have been found with more time."""
    suggestion: str
    """What to try after a failure; empty if it succeeded."""
    state: SkillState
    duration_s: float
    """Simulated time [s]."""
    steps: tuple[SkillStep, ...]

    def __bool__(self) -> bool:
        return self.outcome is SkillOutcome.SUCCEEDED


class SkillSpec(msgspec.Struct, frozen=True, kw_only=True):
    """A declared skill."""

    name: str
    summary: str
    """The first sentence of its documentation."""
    documentation: str
    parameters: tuple[SkillParameter, ...]
    alternatives: tuple[tuple[str, ...], ...]
    """Groups of parameters of which exactly one has to be given, such as a thing or coordinates."""
    needs: frozenset[SkillNeed]
    wordings: tuple[str, ...] = ()
    """Sentences that command it, such as "put {thing} on {on}"."""

    def parameter(self, name: str) -> SkillParameter:
        """The parameter of that name.

        Raises:
            InvalidArgumentError: there is none.
        """
        for each in self.parameters:
            if each.name == name:
                return each
        names = ", ".join(each.name for each in self.parameters)
        raise InvalidArgumentError(
            self.name, cause=f"it has no argument {name!r}", remedy=f"it takes {names or 'none'}"
        )

    def check(self, args: Mapping[str, object]) -> dict[str, SkillValue]:
        """The arguments with numbers converted and those that are None left out.

        Raises:
            InvalidArgumentError: an argument is unknown, missing, of the wrong type or out of range.
        """
        checked = {
            name: self._converted(self.parameter(name), value) for name, value in args.items() if value is not None
        }
        for each in self.parameters:
            if each.required and each.name not in checked:
                raise InvalidArgumentError(
                    self.name, cause=f"{each.name} is missing", remedy=f"give {each.description}"
                )
        self._check_alternatives(checked)
        return checked

    def _check_alternatives(self, args: Mapping[str, object]) -> None:
        if not self.alternatives:
            return
        given = [group for group in self.alternatives if any(name in args for name in group)]
        choices = " or ".join(" and ".join(group) for group in self.alternatives)
        if len(given) != 1:
            cause = "no destination is given" if not given else "several destinations are given"
            raise InvalidArgumentError(self.name, cause=cause, remedy=f"give {choices}")
        if absent := [name for name in given[0] if name not in args and self.parameter(name).default is None]:
            raise InvalidArgumentError(self.name, cause=f"{absent[0]} is missing", remedy=f"give {choices}")

    def _converted(self, parameter: SkillParameter, value: object) -> SkillValue:
        place = f"{self.name} {parameter.name}"
        if not parameter.type.is_number:
            if not isinstance(value, str) or not value.strip():
                raise InvalidArgumentError(place, cause=f"{value!r} is no name", remedy=f"give {parameter.description}")
            return value.strip()
        number = value
        if isinstance(value, str):
            with suppress(ValueError):
                number = float(value)
        check_number(number, _RANGES[parameter.type], place)
        return float(number)  # type: ignore[arg-type]

    def parse(self, words: Iterable[str], given: Mapping[str, object] = MappingProxyType({})) -> dict[str, SkillValue]:
        """The arguments of a command: values in the order of the parameters, and `name=value`.

        Args:
            words: the words after the name of the skill.
            given: further arguments by name.

        Raises:
            InvalidArgumentError: as for `check`, or there are too many values.
        """
        names = [each.name for each in self.parameters]
        args = {name: value for name, value in given.items() if value is not None}
        for word in words:
            name, equals, value = word.partition("=")
            if not equals or name not in names:
                free = [each for each in names if each not in args]
                if not free:
                    cause = f"{word!r} is one argument too many"
                    raise InvalidArgumentError(self.name, cause=cause, remedy=f"it takes {', '.join(names) or 'none'}")
                name, value = free[0], word
            if name in args:
                raise InvalidArgumentError(self.name, cause=f"{name} is given twice", remedy="give it once")
            args[name] = value
        is_first = "thing" in args and "thing" not in given
        if self.alternatives and is_first and _is_number(str(args["thing"])):  # `go_to 1 2 0`
            numbers = [name for name in names if self.parameter(name).type.is_number]
            values = [value for name, value in args.items() if name == "thing" or name in numbers]
            args = dict(zip(numbers, values, strict=False))
        return self.check(args)


class Skill(NamedTuple):
    """A declared skill with the function that performs it; the entry points `mindstage.skills` name these."""

    spec: SkillSpec
    function: Callable[..., SkillMotion]
    """Called with the `SkillTask` and the arguments."""


def skill_specs() -> Mapping[str, SkillSpec]:
    """All skills by name; those that perform them are not imported, which would take a second."""
    return catalog(Group.SKILLS, Skill, attrgetter("spec"), SkillSpec)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def split_command(command: str) -> tuple[str, list[str]]:
    """The name of the skill and the words after it, of a command such as `"put_away milk_1"`.

    Raises:
        InvalidArgumentError: it is empty, or has a quote that is not closed.
    """
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise InvalidArgumentError(command, cause=str(error), remedy="close the quotes") from error
    if not words:
        raise InvalidArgumentError("a command", cause="it is empty", remedy="give a skill and its arguments")
    return words[0].replace("-", "_"), words[1:]


def skill(
    *,
    needs: Iterable[SkillNeed],
    alternatives: tuple[tuple[str, ...], ...] = (),
    name: str = "",
    wordings: Iterable[str] = (),
) -> Callable[[Callable[..., SkillMotion]], Skill]:
    """Declares a skill.

    Args:
        needs: what a robot must have to perform it.
        alternatives: groups of parameters of which exactly one has to be given.
        name: its name; by default that of the function.
        wordings: sentences that command it; each argument in them is in braces.
    """

    def declare(function: Callable[..., SkillMotion]) -> Skill:
        documentation = inspect.cleandoc(function.__doc__ or "")
        spec = SkillSpec(
            name=name or function.__name__,
            summary=documentation.split("\n\n")[0].replace("\n", " "),
            documentation=documentation,
            parameters=tuple(_parameters(function, documentation)),
            alternatives=alternatives,
            needs=frozenset(needs),
            wordings=tuple(wordings),
        )
        return Skill(spec, function)

    return declare


def _parameters(function: Callable[..., SkillMotion], documentation: str) -> Iterable[SkillParameter]:
    hints: Mapping[str, Any] = get_type_hints(function, include_extras=True)
    texts = _descriptions(documentation)
    for name, parameter in list(inspect.signature(function).parameters.items())[1:]:
        default = None if parameter.default is inspect.Parameter.empty else parameter.default
        yield SkillParameter(
            name=name,
            type=_parameter_type(hints[name]),
            description=texts.get(name, name),
            required=parameter.default is inspect.Parameter.empty,
            default=default,
        )


def _parameter_type(hint: object) -> ParameterType:
    """The declared type, also of an optional argument."""
    for each in get_args(hint):
        if isinstance(each, ParameterType):
            return each
    return next(found for each in get_args(hint) if get_args(each) and (found := _parameter_type(each)))


def _descriptions(documentation: str) -> dict[str, str]:
    """The texts of the section "Args" of a docstring by parameter."""
    found: dict[str, str] = {}
    name = ""
    for line in documentation.partition("Args:\n")[2].splitlines():
        if not line.strip():
            break
        if line.startswith("    ") and not line.startswith("     "):
            name, _, text = line.strip().partition(": ")
            found[name] = text
        elif name:
            found[name] += f" {line.strip()}"
    return {name: text.rstrip(".") for name, text in found.items()}
