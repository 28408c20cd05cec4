"""Every number that a caller can give is declared with its range, and refused outside of it.

The inventory is of the declarations: the public functions, methods and records of all packages, the questions, the
skills, the options of the command line, and the requests of the page. A new one whose numbers have no range fails.
"""

from __future__ import annotations

import importlib
import inspect
import math
import pkgutil
import re
import sys
import types
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from enum import Enum
from functools import cache
from inspect import Parameter
from typing import Any, NamedTuple, get_args

import msgspec
import pytest
import typer
from typer.testing import CliRunner

import mindstage
from mindstage import KnowledgeBase
from mindstage.cli.app import app
from mindstage.errors import NumberRefusedError
from mindstage.knowledge.questions import list_questions
from mindstage.ranges import Range, range_of
from mindstage.robots.skills import skill_specs

HUGE = 10**400
NUMBER = re.compile(r"\b(float|int|Vector|Quaternion)\b")

DECODED_ONLY: Mapping[str, str] = {
    "mindstage.bridge.protocol": "operations of the wire, which are checked when they are decoded",
}
"""Modules of records without a check at their construction."""
_WORLD = "a map may have any number; the engine refuses the body or joint at a spawn or an edit, with the reason"
_RESULT = "made by Mindstage, not by its users"
_FILE = "read from a description of a robot; its bodies and drives are checked when the robot is added"
UNRANGED_RECORDS: Mapping[str, str] = {
    **dict.fromkeys(
        ("AngularLimits", "AttachedLight", "Body", "BodyGeometry", "BodyPhysics", "CollisionShape"), _WORLD
    ),
    **dict.fromkeys(("Inertia", "JointMimic", "Light", "LinearLimits", "PbrMaterial", "Pose", "SoftLimit"), _WORLD),
    **dict.fromkeys(("SupportSurface", "World"), _WORLD),
    **dict.fromkeys(
        ("ActuatedBodies", "CauseCount", "CompiledModel", "Contact", "EpisodeEdit", "EpisodeEvent"), _RESULT
    ),
    **dict.fromkeys(("EpisodeFrame", "ImaginedEvent", "Job", "JointAxis", "ModelJoint", "MovedBody"), _RESULT),
    **dict.fromkeys(("PlanFile", "RemoteUrl", "RobotWorld", "SampleResult", "SkillResult", "SkillState"), _RESULT),
    **dict.fromkeys(("BaseDrive", "JointDrive", "SkillStep", "SpawnReport", "Verdict", "WorldState"), _RESULT),
    **dict.fromkeys(("Arm", "Gripper", "RobotBase", "RobotJoint", "RobotMimic", "RobotModel", "RobotSensor"), _FILE),
    **dict.fromkeys(("UrdfGeometry", "UrdfInertial", "UrdfJoint", "UrdfLink", "UrdfMimic"), _FILE),
    "Check": "arguments of a question, which checks them",
    "Limit": "a range itself",
    "Move to": "checked as a pose; msgspec cannot constrain numbers of a list that may be a record",
    "Perform args": "arguments of a skill, which checks them",
    "TrajectoryPoint": "checked as a whole when the trajectory starts, against the limits of the robot",
    "Uncertainty position_m": "msgspec cannot constrain a number that may be a tuple; checked with the plan",
}
"""Records, or fields of them, without ranges; with the reason."""
_GOAL = "made by `Robot`, whose arguments are checked"
UNRANGED_FUNCTIONS: Mapping[str, str] = {
    **dict.fromkeys(("GripperGoal.__init__", "JointGoal.__init__", "PathGoal.__init__", "VelocityGoal.command"), _GOAL),
    "Gate.admit": "times of a clock",
    "Gate.request_denial": "times of a clock",
    "Gate.socket_denial": "times of a clock",
    "InProcessExecutor.run": "called by `evaluate_plan`, whose arguments are checked",
    "Limit.check": "the check itself, which names the limit",
    "MotionGoal.end": "called by controllers, with errors that they measure",
    "MujocoEngine.step_for wall_s": "may be infinite",
    "PlanBuilder.perform args": "arguments of a skill, which checks them",
    "WarpExecutor.run": "called by `evaluate_plan`, whose arguments are checked",
    "WorkerPoolExecutor.run": "called by `evaluate_plan`, whose arguments are checked",
    "_IndexedEpisode.__init__": "made by `EpisodeMemory`",
    **dict.fromkeys(
        ("_IndexedEpisode.resume", "_IndexedEpisode.state_at", "_IndexedEpisode.states"),
        "passed on to `EpisodeHistory`, which checks them",
    ),
    "ground_last": "arithmetic of an engine",
    "whole_steps": "arithmetic of an engine",
}
"""Functions, or parameters of them, without ranges; with the reason."""


class Declared(NamedTuple):
    """A public function or method, or a record; `place` is its name."""

    place: str
    target: Any
    owner: type | None
    numbers: tuple[str, ...]


@cache
def modules() -> tuple[types.ModuleType, ...]:
    names = [each.name for each in pkgutil.walk_packages(mindstage.__path__, "mindstage.")]
    skipped = re.compile(r"\.(__main__|_generated|mesh_worker)\b")
    return tuple(importlib.import_module(name) for name in names if not skipped.search(name))


@cache
def classes_by_name() -> dict[str, type]:
    return {
        name: each
        for module in modules()
        for name, each in vars(module).items()
        if inspect.isclass(each) and each.__module__ == module.__name__
    }


def public_roots() -> Iterator[Any]:
    """What the packages, and the modules of the package itself, show."""
    for module in (mindstage, *modules()):
        if hasattr(module, "__path__") or module.__name__.count(".") == 1:
            yield from (getattr(module, name) for name in getattr(module, "__all__", ()))


def is_own(each: Any) -> bool:
    return str(getattr(each, "__module__", "")).startswith("mindstage.")


def is_record(each: Any) -> bool:
    return inspect.isclass(each) and (issubclass(each, msgspec.Struct) or is_dataclass(each))


def functions_of(each: Any) -> Iterator[tuple[str, Any, type | None]]:
    """The public functions of a function or a class, with the constructor of one that is no record."""
    if not inspect.isclass(each):
        yield each.__name__, each, None
        return
    for name, member in vars(each).items():
        function = member.__func__ if isinstance(member, classmethod | staticmethod) else member
        is_constructor = name == "__init__" and not is_record(each)
        if inspect.isfunction(function) and (is_constructor or not name.startswith("_")):
            yield f"{each.__name__}.{name}", function, each


def named_classes(annotation: object, names: Mapping[str, object]) -> Iterator[type]:
    """The classes that a type names, also by an alias of several, or where they are imported for type checking only."""
    for word in re.findall(r"[A-Za-z_]\w*", str(annotation)):
        yield from classes_in(names.get(word, classes_by_name().get(word)))


def classes_in(type: Any) -> Iterator[Any]:
    if inspect.isclass(type) and not get_args(type):
        yield type
    for each in get_args(type):
        yield from classes_in(each)


@cache
def public() -> tuple[Any, ...]:
    """The public functions and classes, and the classes of what they return."""
    found: dict[int, Any] = {}
    waiting = [each for each in public_roots() if is_own(each) and (inspect.isclass(each) or inspect.isfunction(each))]
    waiting += [cls for cls in classes_by_name().values() if {"spawn", "step", "apply_force"} <= vars(cls).keys()]
    while waiting:
        each = waiting.pop()
        if id(each) in found or (inspect.isclass(each) and issubclass(each, BaseException | Enum)):
            continue
        found[id(each)] = each
        for _, function, _ in functions_of(each):
            waiting += (cls for cls in named_classes(returned(function), names_of(function)) if is_own(cls))
        if inspect.isclass(each):
            waiting += (cls for cls in each.__subclasses__() if is_own(cls))
    return tuple(found.values())


def returned(function: Any) -> object:
    return inspect.signature(function).return_annotation


def is_protocol(cls: type | None) -> bool:
    return bool(getattr(cls, "_is_protocol", False))


def number_parameters(function: Any) -> tuple[str, ...]:
    return tuple(
        each.name
        for each in inspect.signature(function).parameters.values()
        if takes_number(each.annotation, names_of(function))
    )


def names_of(function: Any) -> dict[str, object]:
    return inspect.unwrap(function).__globals__


def takes_number(annotation: object, names: Mapping[str, object]) -> bool:
    text = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", str(annotation))
    if re.match(r"(\w+\.)?(Callable|Generator|Iterator)\b", text):
        return False
    return NUMBER.search(text) is not None or range_of(annotation, names) is not None


@cache
def declared_functions() -> tuple[Declared, ...]:
    return tuple(
        Declared(name, function, owner, numbers)
        for each in public()
        for name, function, owner in functions_of(each)
        if not is_protocol(owner) and (numbers := number_parameters(function))
    )


def record_fields(cls: type) -> Iterator[tuple[str, object, dict[str, object]]]:
    for base in reversed(cls.__mro__):
        for name, annotation in vars(base).get("__annotations__", {}).items():
            if "ClassVar" not in str(annotation):
                yield name, annotation, vars(sys.modules[base.__module__])


@cache
def input_records() -> tuple[type, ...]:
    """The records that public functions take, and those in their fields."""
    found: dict[type, None] = {}
    waiting = [
        cls
        for each in public()
        for _, function, _ in functions_of(each)
        for parameter in inspect.signature(function).parameters.values()
        for cls in named_classes(parameter.annotation, names_of(function))
        if not str(parameter.annotation).startswith("Callable")
    ]
    while waiting:
        cls = waiting.pop()
        if cls in found or not is_record(cls) or not is_own(cls) or cls.__module__ in DECODED_ONLY:
            continue
        found[cls] = None
        for _, annotation, names in record_fields(cls):
            waiting += named_classes(annotation, names)
    return tuple(found)


# -- functions and records --------------------------------------------------------------------------------------------


def beyond(range: Range) -> list[float]:
    """Numbers that a range does not have."""
    edges = [math.nextafter(range.low, -math.inf), math.nextafter(range.high, math.inf), -1e308, 1e308]
    return [math.nan, math.inf, -math.inf, HUGE, -HUGE, True, *(each for each in edges if each not in range)]


def shaped(number: float, annotation: object, range: Range) -> Any:
    """The number as an element of what the type contains, where it contains numbers."""
    if not range.contained:
        return number
    return {"x": number} if re.search(r"Mapping|dict", str(annotation)) else (0.5, number, 0.5)


def undeclared_functions(functions: tuple[Declared, ...]) -> list[str]:
    return [
        f"{each.place} {name}"
        for each in functions
        for name in each.numbers
        if range_of(inspect.signature(each.target).parameters[name].annotation, names_of(each.target)) is None
        and each.place not in UNRANGED_FUNCTIONS
        and f"{each.place} {name}" not in UNRANGED_FUNCTIONS
    ]


def undeclared_fields(records: tuple[type, ...]) -> list[str]:
    return [
        f"{cls.__name__} {name}"
        for cls in records
        for name, annotation, names in record_fields(cls)
        if takes_number(annotation, names)
        and range_of(annotation, names) is None
        and cls.__name__ not in UNRANGED_RECORDS
        and f"{cls.__name__} {name}" not in UNRANGED_RECORDS
    ]


def refusal(function: Any, /, *args: Any, **kwargs: Any) -> str:
    """The text of the error with which a call is refused; empty if it is not refused because of a number."""
    try:
        function(*args, **kwargs)
    except NumberRefusedError as error:
        return str(error)
    except Exception as error:
        return f"not checked: {type(error).__name__}: {error}"
    return "not refused"


def test_the_inventory_has_what_users_call() -> None:
    places = {each.place for each in declared_functions()}
    assert {"Simulation.step", "SimulationJoint.open", "Robot.drive", "evaluate_plan", "Episode.state_at"} <= places
    assert {"NullEngine.step", "MujocoEngine.step", "MindstageRemoteEngine.step", "UnrealEngine.step"} <= places
    assert {"Marker", "Push", "Uncertainty", "PublishRates", "Actuator"} <= {cls.__name__ for cls in input_records()}


def test_every_number_of_a_public_function_has_a_range() -> None:
    assert undeclared_functions(declared_functions()) == []


def test_every_number_of_a_record_that_users_give_has_a_range() -> None:
    assert undeclared_fields(input_records()) == []


def test_the_exceptions_exist() -> None:
    functions = {each.place for each in declared_functions()}
    records = {cls.__name__ for cls in input_records()}
    assert {name.split()[0] for name in UNRANGED_FUNCTIONS} <= functions
    assert {name.split()[0] for name in UNRANGED_RECORDS} <= records


def test_a_new_function_or_record_without_a_range_is_found() -> None:
    def lift(height_m: float, *, speed: int = 1) -> None: ...

    class Lift(msgspec.Struct):
        height_m: float

    assert undeclared_functions((Declared("lift", lift, None, number_parameters(lift)),)) == [
        "lift height_m",
        "lift speed",
    ]
    assert undeclared_fields((Lift,)) == ["Lift height_m"]


def test_every_public_function_refuses_numbers_beyond_its_ranges() -> None:
    wrong = []
    for each in declared_functions():
        parameters = inspect.signature(each.target).parameters
        others = {
            name: None if name in each.numbers else object()
            for name, other in parameters.items()
            if other.default is other.empty and other.kind not in {other.VAR_KEYWORD, other.VAR_POSITIONAL}
        }
        for name in each.numbers:
            found = range_of(parameters[name].annotation, names_of(each.target))
            if found is None:
                continue
            named = "deadline_s" if parameters[name].kind is Parameter.VAR_KEYWORD else name
            for number in beyond(found):
                given = {**others, named: shaped(number, parameters[name].annotation, found)}
                positional = [
                    given.pop(key) for key, other in parameters.items() if other.kind is other.POSITIONAL_ONLY
                ]
                text = refusal(each.target, *positional, **given)
                if named not in text or found.text not in text:
                    wrong.append(f"{each.place} {named}={str(number)[:20]}: {text}")
    assert wrong == []


def test_every_record_refuses_numbers_beyond_its_ranges() -> None:
    wrong = []
    for cls in input_records():
        fields = list(record_fields(cls))
        if cls.__name__ in UNRANGED_RECORDS:
            continue
        required = dict.fromkeys(required_fields(cls))
        for name, annotation, names in fields:
            found = range_of(annotation, names)
            for number in beyond(found) if found is not None else ():
                text = refusal(cls, **{**required, name: shaped(number, annotation, found)})
                if name not in text or found.text not in text:
                    wrong.append(f"{cls.__name__} {name}={str(number)[:20]}: {text}")
    assert wrong == []


def required_fields(cls: type) -> list[str]:
    return [
        name
        for name, each in inspect.signature(cls).parameters.items()
        if each.default is each.empty and each.kind is not each.VAR_KEYWORD
    ]


# -- questions, skills, requests of the page --------------------------------------------------------------------------


def test_every_number_of_a_question_has_a_range_and_is_refused_beyond_it() -> None:
    knowledge, wrong = KnowledgeBase(), []
    for question in list_questions():
        for argument in question.arguments:
            if argument.value_type not in {int, float}:
                continue
            assert argument.range is not None, f"{question.name} {argument.name}"
            for number in beyond(argument.range)[:5]:
                for given in (number, str(number)):
                    text = refusal(knowledge.ask, question, **{argument.name: given})
                    if f"{question.name}, {argument.name}" not in text:
                        wrong.append(f"{question.name} {argument.name}={str(given)[:20]}: {text}")
    assert wrong == []


def test_every_number_of_a_skill_is_refused_beyond_its_range() -> None:
    wrong = []
    for spec in skill_specs().values():
        for parameter in spec.parameters:
            for number in (
                (math.nan, math.inf, -math.inf, HUGE, 1e308, -1e308, "nan") if parameter.type.is_number else ()
            ):
                text = refusal(spec.check, {parameter.name: number})
                if f"{spec.name} {parameter.name}" not in text or "from" not in text:
                    wrong.append(f"{spec.name} {parameter.name}={str(number)[:20]}: {text}")
    assert wrong == []


def test_every_number_of_a_request_of_the_page_has_a_range() -> None:
    requests = tuple(
        cls for name, cls in classes_by_name().items() if name.endswith("Request") and ".viewer." in cls.__module__
    )
    nested = tuple(
        inner
        for cls in requests
        for _, annotation, names in record_fields(cls)
        for inner in named_classes(annotation, names)
        if is_record(inner) and ".viewer." in inner.__module__
    )
    assert len(requests) > 30
    assert undeclared_fields((*requests, *nested)) == []


# -- the command line -------------------------------------------------------------------------------------------------


def numeric_options() -> Iterator[tuple[str, Any, list[str]]]:
    """Each option with a number, with the verb and the words that it needs besides."""
    group: Any = typer.main.get_command(app)
    for verb, command in sorted(group.commands.items()):
        needed = [
            word
            for each in command.params
            if each.required
            for word in ((each.opts[0], "x") if each.param_type_name == "option" else ("x",))
        ]
        for each in command.params:
            if each.param_type_name == "option" and re.search(r"^(int|float)", each.type.name, re.IGNORECASE):
                yield verb, each, needed


@pytest.mark.parametrize("number", ["nan", "inf", "-inf", "1" + "0" * 400])
def test_every_number_on_the_command_line_is_refused_if_it_is_not_finite(number: str) -> None:
    options = list(numeric_options())
    assert len(options) > 50
    wrong = []
    for verb, option, needed in options:
        result = CliRunner().invoke(app, [verb, *needed, f"{option.opts[0]}={number}"])
        text = re.sub(r"[│╭╮╰╯─\s]+", " ", result.output)
        if result.exit_code != 2 or option.opts[0] not in text or not re.search(r"range|is not a|valid", text):
            wrong.append(f"{verb} {option.opts[0]}={number[:5]}: {result.exit_code} {text[-200:]}")
    assert wrong == []


def test_every_number_on_the_command_line_is_refused_beyond_its_bounds() -> None:
    wrong = []
    for verb, option, needed in numeric_options():
        low, high = getattr(option.type, "min", None), getattr(option.type, "max", None)
        for number in [low - 1 if low is not None else None, high + 1 if high is not None else None]:
            if number is not None:
                result = CliRunner().invoke(app, [verb, *needed, f"{option.opts[0]}={number}"])
                if result.exit_code != 2 or option.opts[0] not in result.output or "range" not in result.output:
                    wrong.append(f"{verb} {option.opts[0]}={number}: {result.exit_code} {result.output[-200:]}")
    assert wrong == []
