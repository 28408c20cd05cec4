"""Plans as JSON and YAML: reading with the place of each error, writing, the JSON schema, and a builder.

YAML is read by the rules of version 1.2: `on` is a text, not a truth value, and a key may occur only once. Aliases are
refused, since a short text with aliases can stand for a huge one.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import Any, ClassVar, Self, TypeAlias

import msgspec
import yaml

from mindstage.access.limits import Deadline, PositiveDuration
from mindstage.errors import PlanError
from mindstage.imagination.plans import (
    ChangePhysics,
    Check,
    Close,
    Move,
    Open,
    Perform,
    Place,
    Plan,
    PlanStep,
    Pull,
    Push,
    Uncertainty,
    Wait,
)
from mindstage.ranges import ForceVector, Fraction, Point, PositiveMass, checked
from mindstage.scene import BodyId, Mobility, PoseLike, as_pose
from mindstage.scene.edits import Attach, Detach

__all__ = ["PlanBuilder", "PlanFile", "PlanLike", "dump_plan", "load_plan", "plan_schema"]

_MAX_SIZE = 100_000
"""A longer text is refused; the longest plan of use has a few kilobytes."""
_MAX_DEPTH = 30


class PlanFile(msgspec.Struct, frozen=True, kw_only=True):
    """A plan, and where each of its parts is in the text that it was read from."""

    plan: Plan
    name: str
    """The path of the file, or what else errors name."""
    lines: dict[str, int]
    """The line of each part, such as "steps[0].thing"; the first line is 1."""

    def place(self, path: str) -> str:
        """What errors about a part of the plan name: "plan.yaml:12: steps[0].thing"."""
        return _place(self.name, self.lines, path)


PlanLike: TypeAlias = Plan | PlanFile | Mapping[str, Any] | str | os.PathLike[str]
"""What is accepted as a plan; see `load_plan`."""


def load_plan(source: PlanLike, *, name: str = "") -> PlanFile:
    """The plan that was given as such, as a dict, or as a file or text, which is read.

    Args:
        source: a plan; a dict of the form of a JSON plan; a path; or JSON or YAML text with more than one line or
            beginning with "{".
        name: what errors name; by default the path, or "the plan".

    Raises:
        PlanError: the file does not exist, or the content is no plan; with the line.
    """
    if isinstance(source, PlanFile):
        return source
    if isinstance(source, Plan):
        return PlanFile(plan=source, name=name, lines={})
    lines: dict[str, int] = {}
    if isinstance(source, str | os.PathLike):
        named, content, lines = _read_source(source, name)
        first = f"{named}:1"
    else:
        first = named = name or "the plan"
        try:
            content = msgspec.to_builtins(source, enc_hook=lambda array: array.tolist())
        except (AttributeError, TypeError) as error:
            raise PlanError(named, cause=f"it has a value that is none of JSON: {error}") from error
    if not isinstance(content, dict):
        raise PlanError(first, cause=f"it is {_kind(content)}; a plan is an object with the key `steps`")
    try:
        plan = msgspec.convert(content, Plan)
    except msgspec.ValidationError as error:
        cause, _, path = str(error).partition(" - at `$")
        raise PlanError(_place(named, lines, _resolved(path.rstrip("`"), lines)), cause=cause) from error
    return PlanFile(plan=plan, name=named, lines=lines)


def _read_source(source: str | os.PathLike[str], name: str) -> tuple[str, Any, dict[str, int]]:
    """What errors name, the content of a file or text, and the line of each path in it."""
    is_text = isinstance(source, str) and ("\n" in source or source.lstrip().startswith("{"))
    if is_text:
        text, named = str(source), name or "the plan"
    else:
        named = name or os.fspath(source)
        try:
            text = Path(source).read_text(encoding="utf-8")
        except OSError as error:
            raise PlanError(named, cause=f"it cannot be read: {error.strerror}") from error
        except UnicodeDecodeError as error:
            raise PlanError(named, cause=f"it is not UTF-8 text: {error.reason} at byte {error.start}") from error
    if len(text) > _MAX_SIZE:
        raise PlanError(named, cause=f"it has {len(text):,} characters; the limit is {_MAX_SIZE:,}")
    return named, *_read(text, named)


def dump_plan(plan: PlanLike, *, format: str = "yaml") -> str:
    """Writes a plan as "yaml" or "json"; what has its default value is left out."""
    plan = load_plan(plan).plan
    content = {"format_version": plan.format_version, **_without_defaults(plan)}
    if format == "json":
        return msgspec.json.format(msgspec.json.encode(content), indent=2).decode()
    if format != "yaml":
        raise ValueError(f"a plan is written as yaml or json, not {format!r}")
    return str(yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True))


def plan_schema() -> dict[str, Any]:
    """The JSON schema of plans."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **msgspec.json.schema(Plan)}


class PlanBuilder:
    """Builds a plan step by step.

    >>> plan = PlanBuilder("serve").place("CoffeeMug", on="table").wait(2.0).build()
    >>> len(plan.steps)
    2
    """

    def __init__(self, name: str = "") -> None:
        self._name = name
        self._steps: list[PlanStep] = []
        self._uncertainty: list[Uncertainty] = []
        self._options: dict[str, Any] = {}

    @checked
    def place(
        self, thing: str | Sequence[str], *, on: str | None = None, into: str | None = None, **options: Deadline
    ) -> Self:
        """Adds a `Place`; `options` is `deadline_s`, here and below."""
        things = thing if isinstance(thing, str) else tuple(thing)
        return self.add(Place(thing=things, on=on, into=into, **options))

    @checked
    def move(self, thing: str, *, to: PoseLike | None = None, by: Point | None = None, **options: Deadline) -> Self:
        """Adds a `Move`."""
        return self.add(Move(thing=thing, to=None if to is None else as_pose(to, "to"), by=by, **options))

    @checked
    def pull(self, thing: str, *, target: Point, point: Point = (0.0, 0.0, 0.0), **options: Deadline) -> Self:
        """Adds a `Pull`."""
        return self.add(Pull(thing=thing, target=target, point=point, **options))

    @checked
    def push(
        self,
        thing: str,
        *,
        force: ForceVector,
        point: Point | None = None,
        duration_s: PositiveDuration = 0.5,
        **options: Deadline,
    ) -> Self:
        """Adds a `Push`."""
        return self.add(Push(thing=thing, force=force, point=point, duration_s=duration_s, **options))

    @checked
    def open(self, thing: str, *, fraction: Fraction = 1.0, **options: Deadline) -> Self:
        """Adds an `Open`."""
        return self.add(Open(thing=thing, fraction=fraction, **options))

    @checked
    def close(self, thing: str, **options: Deadline) -> Self:
        """Adds a `Close`."""
        return self.add(Close(thing=thing, **options))

    @checked
    def wait(self, duration_s: PositiveDuration, **options: Deadline) -> Self:
        """Adds a `Wait`."""
        return self.add(Wait(duration_s=duration_s, **options))

    def attach(self, child: str, *, to: str) -> Self:
        """Adds an `Attach`."""
        return self.add(Attach(BodyId(to), BodyId(child)))

    def detach(self, child: str) -> Self:
        """Adds a `Detach`."""
        return self.add(Detach(BodyId(child)))

    @checked
    def change_physics(
        self,
        thing: str,
        *,
        mass_kg: PositiveMass | None = None,
        mobility: Mobility | None = None,
        gravity: bool | None = None,
        **options: Deadline,
    ) -> Self:
        """Adds a `ChangePhysics`."""
        return self.add(ChangePhysics(thing=thing, mass_kg=mass_kg, mobility=mobility, gravity=gravity, **options))

    @checked
    def perform(self, skill: str, *, robot: str = "", deadline_s: Deadline = 300.0, **args: str | float) -> Self:
        """Adds a `Perform`; `args` are the arguments of the skill."""
        return self.add(Perform(skill=skill, args=args, robot=robot, deadline_s=deadline_s))

    def add(self, step: PlanStep) -> Self:
        """Adds a step."""
        self._steps.append(step)
        return self

    def uncertain(self, thing: str, **deviations: Any) -> Self:
        """Adds an `Uncertainty`: `position_m`, `yaw_rad`, `mass`, `friction`, `joint_friction`."""
        self._uncertainty.append(Uncertainty(thing=thing, **deviations))
        return self

    def check(self, question: str, *, expect: Any = "any", **args: Any) -> Self:
        """Sets the check at the end."""
        self._options["check"] = Check(question=question, args=args, expect=expect)
        return self

    def until(self, question: str, *, expect: Any = "any", **args: Any) -> Self:
        """Sets the condition with which the plan ends."""
        self._options["until"] = Check(question=question, args=args, expect=expect)
        return self

    def forbid(self, *kinds: str) -> Self:
        """Sets the kinds of events with which a sample fails."""
        self._options["forbid"] = kinds
        return self

    @checked
    def deadline(self, deadline_s: Deadline) -> Self:
        """Sets the deadline of the whole plan [s of simulated time]."""
        self._options["deadline_s"] = deadline_s
        return self

    def build(self) -> Plan:
        """The plan."""
        return Plan(name=self._name, steps=tuple(self._steps), uncertainty=tuple(self._uncertainty), **self._options)


# -- reading -----------------------------------------------------------------------------------------------------------


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """Reads scalars by YAML 1.2: no `on`, `yes`, sexagesimal or octal numbers; `1e3` is a number."""

    yaml_implicit_resolvers: ClassVar[dict[str, Any]] = {}


_Loader.add_implicit_resolver("tag:yaml.org,2002:null", re.compile(r"(?:~|null|Null|NULL|)$"), ["~", "n", "N", ""])
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:bool", re.compile(r"(?:true|True|TRUE|false|False|FALSE)$"), list("tTfF")
)
_Loader.add_implicit_resolver("tag:yaml.org,2002:int", re.compile(r"[-+]?[0-9]+$"), list("-+0123456789"))
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?$"),
    list("-+.0123456789"),
)


class _Dumper(yaml.SafeDumper):  # type: ignore[misc]
    """Writes what `_Loader` reads."""

    yaml_implicit_resolvers = _Loader.yaml_implicit_resolvers

    def ignore_aliases(self, data: Any) -> bool:
        """Writes equal values twice, since aliases are refused."""
        return True

    def analyze_scalar(self, scalar: str) -> yaml.emitter.ScalarAnalysis:
        """Has texts with a next-line character quoted twice, as a reader folds it to a space in other styles."""
        analysis = super().analyze_scalar(scalar)
        if "\x85" in scalar:
            analysis.special_characters = analysis.multiline = True
            analysis.allow_single_quoted = analysis.allow_block = False
            analysis.allow_flow_plain = analysis.allow_block_plain = False
        return analysis


def _read(text: str, name: str) -> tuple[Any, dict[str, int]]:
    """The content of a JSON or YAML text, and the line of each path in it.

    Raises:
        PlanError: it is neither, or it has a key twice, or an alias.
    """
    content = None
    if text.lstrip().startswith("{"):  # JSON has characters that YAML refuses
        with suppress(ValueError, RecursionError):
            content = json.loads(text, object_pairs_hook=_unique)
    try:
        found, lines = _read_yaml(text, name)
    except PlanError:
        if content is None:
            raise
        return content, {}
    return (found if content is None else content), lines


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len(found := dict(pairs)) < len(pairs):
        raise ValueError("a key occurs twice")  # for which YAML names the place
    return found


def _read_yaml(text: str, name: str) -> tuple[Any, dict[str, int]]:
    """The content of a JSON or YAML text, and the line of each path in it.

    Raises:
        PlanError: it is neither, or it has a key twice, or an alias.
    """
    try:
        depth = 0
        for event in yaml.parse(text, Loader=_Loader):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > _MAX_DEPTH:  # the time for deeper nesting grows with its square
                raise PlanError(
                    f"{name}:{event.start_mark.line + 1}", cause=f"more than {_MAX_DEPTH} levels of nesting"
                )
            if isinstance(event, yaml.AliasEvent):
                raise PlanError(f"{name}:{event.start_mark.line + 1}", cause=f"aliases are refused: *{event.anchor}")
        node = yaml.compose(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        line = f":{error.problem_mark.line + 1}" if error.problem_mark else ""
        cause = f"neither JSON nor YAML: {error.problem or error.context}"
        raise PlanError(f"{name}{line}", cause=cause) from error
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise PlanError(name, cause=f"neither JSON nor YAML: {error}") from error
    lines: dict[str, int] = {}
    if node is None:
        return None, lines
    return _content(node, "", name, lines), lines


_SCALARS: dict[str, Any] = {
    "tag:yaml.org,2002:null": lambda text: None,
    "tag:yaml.org,2002:bool": lambda text: text.lower() == "true",
    "tag:yaml.org,2002:int": int,
    "tag:yaml.org,2002:float": float,
    "tag:yaml.org,2002:str": str,
}


def _content(node: yaml.Node, path: str, name: str, lines: dict[str, int]) -> Any:
    lines[path] = node.start_mark.line + 1
    if isinstance(node, yaml.SequenceNode):
        return [_content(child, f"{path}[{number}]", name, lines) for number, child in enumerate(node.value)]
    if isinstance(node, yaml.MappingNode):
        found: dict[str, Any] = {}
        for key, value in node.value:
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode):
                raise PlanError(f"{name}:{line}", cause="a key must be a text")
            inner = f"{path}.{key.value}" if path else key.value
            if key.value in found:
                raise PlanError(f"{name}:{line}: {inner}", cause="the key occurs twice")
            found[key.value] = _content(value, inner, name, lines)
            lines[inner] = line
        return found
    convert = _SCALARS.get(node.tag)
    if convert is None:
        raise PlanError(f"{name}:{lines[path]}: {path}", cause=f"the tag {node.tag!r} is refused")
    return convert(node.value)


def _resolved(path: str, lines: dict[str, int]) -> str:
    """The path of a validation error without the leading dot; `[...]` stands for a key or an index of any value."""
    path = path.removeprefix(".").replace("[...]", "")
    while lines and path and path not in lines:
        path = path.rpartition("." if path.rfind(".") > path.rfind("[") else "[")[0]
    return path


def _place(name: str, lines: dict[str, int], path: str) -> str:
    known = path
    while known and known not in lines:
        known = known.rpartition("." if known.rfind(".") > known.rfind("[") else "[")[0]
    line = lines.get(known)
    return ": ".join(part for part in (name if line is None else f"{name}:{line}", path) if part)


def _kind(value: object) -> str:
    return {list: "a list", str: "a text", type(None): "empty", bool: "a truth value"}.get(type(value), "a number")


# -- writing -----------------------------------------------------------------------------------------------------------


def _without_defaults(value: Any) -> Any:
    if isinstance(value, msgspec.Struct):
        tag = {"do": value.__struct_config__.tag} if value.__struct_config__.tag_field == "do" else {}
        fields = msgspec.structs.fields(value)
        given = {}
        for each in fields:
            current = getattr(value, each.name)
            default = each.default if each.default is not msgspec.NODEFAULT else None
            if each.default_factory is not msgspec.NODEFAULT:
                default = each.default_factory()
            if each.required or current != default:
                given[each.encode_name] = _without_defaults(current)
        return {**tag, **given}
    if isinstance(value, dict):
        return {key: _without_defaults(each) for key, each in value.items()}
    if isinstance(value, Iterable) and not isinstance(value, str):
        return [_without_defaults(each) for each in value]
    return value.value if isinstance(value, StrEnum) else value
