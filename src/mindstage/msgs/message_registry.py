"""Registry of ROS types: lookup by name, and their definitions as rosapi and `.msg` files write them."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from functools import cache
from typing import Any, Generic, NamedTuple, TypeVar

from mindstage.errors import TypeNotFoundError
from mindstage.msgs import _generated
from mindstage.msgs._generated.actionlib_msgs import GoalID, GoalStatus
from mindstage.msgs._generated.builtin_interfaces import Duration, Time
from mindstage.msgs._generated.rosapi import TypeDef
from mindstage.msgs._generated.std_msgs import Header
from mindstage.msgs.schema.base import (
    Action,
    FieldInfo,
    Message,
    RosVersion,
    Service,
    constants_of,
    fields_of,
    short_name,
    struct_of,
    type_name,
)

__all__ = [
    "ActionFeedback",
    "ActionGoal",
    "ActionResult",
    "ActionType",
    "ServiceType",
    "action_type",
    "action_types",
    "definition_text",
    "field_layout",
    "interface_text",
    "is_ros1_only",
    "message_type",
    "message_types",
    "packages",
    "packages_in",
    "service_type",
    "service_types",
    "type_definitions",
]

PACKAGE_ALIASES = {"rosapi_msgs": "rosapi", "tf": "tf2_msgs"}
"""Other names of packages: rosapi's types are in `rosapi_msgs` in ROS 2, TFMessage is in `tf` in old ROS 1."""

SEPARATOR = "=" * 80
INTEGERS = ("int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64")
EXAMPLES = dict.fromkeys(INTEGERS, "0") | {"bool": "False", "string": "", "float32": "0.0", "float64": "0.0"}

T = TypeVar("T")
M = TypeVar("M")


class ServiceType(NamedTuple):
    """The two messages of a service."""

    request: type[Message]
    response: type[Message]


class ActionType(NamedTuple):
    """The three messages of an action."""

    goal: type[Message]
    result: type[Message]
    feedback: type[Message]


# -- the topics of an action in ROS 1, where the definition of an action generates three more messages -----------------


class ActionGoal(Message, Generic[M], frozen=True, kw_only=True):
    """The topic `goal`: `SimulateStepsActionGoal` is `ActionGoal[SimulateSteps.Goal]`."""

    header: Header = Header()
    goal_id: GoalID = GoalID()
    goal: M


class ActionResult(Message, Generic[M], frozen=True, kw_only=True):
    """The topic `result`."""

    header: Header = Header()
    status: GoalStatus = GoalStatus()
    result: M


class ActionFeedback(Message, Generic[M], frozen=True, kw_only=True):
    """The topic `feedback`."""

    header: Header = Header()
    status: GoalStatus = GoalStatus()
    feedback: M


# -- lookup ------------------------------------------------------------------------------------------------------------


def message_type(name: str) -> type[Message]:
    """Returns the message type of a name such as `geometry_msgs/Pose` or `geometry_msgs/msg/Pose`.

    The messages on the topics of an action in ROS 1 are included: `simulation_interfaces/SimulateStepsActionGoal`.

    Raises:
        TypeNotFoundError: there is no message type of this name.
    """
    return _lookup(name, "msg", "message", message_types())


def service_type(name: str) -> ServiceType:
    """Returns the request and the response type of a service.

    Raises:
        TypeNotFoundError: there is no service type of this name.
    """
    return _lookup(name, "srv", "service", service_types())


def action_type(name: str) -> ActionType:
    """Returns the goal, the result and the feedback type of an action.

    Raises:
        TypeNotFoundError: there is no action type of this name.
    """
    return _lookup(name, "action", "action", action_types())


@cache
def message_types() -> dict[str, type[Message]]:
    """Returns all message types by short name, without the parts of services and actions."""
    messages = {type_name(cls): cls for cls in _classes(Message)}
    topics = {type_name(topic): topic for action in _classes(Action) for topic in _action_topics(action)}
    return messages | topics


@cache
def service_types() -> dict[str, ServiceType]:
    """Returns all service types by short name."""
    return {type_name(cls): ServiceType(cls.Request, cls.Response) for cls in _classes(Service)}


@cache
def action_types() -> dict[str, ActionType]:
    """Returns all action types by short name."""
    return {type_name(cls): ActionType(cls.Goal, cls.Result, cls.Feedback) for cls in _classes(Action)}


def _classes(kind: type[T]) -> Iterator[type[T]]:
    for package in _generated.__all__:
        module = getattr(_generated, package)
        for _, cls in inspect.getmembers(module, inspect.isclass):
            if cls.__module__ == module.__name__ and issubclass(cls, kind):
                yield cls


def _action_topics(action: Any) -> tuple[Any, Any, Any]:
    return ActionGoal[action.Goal], ActionResult[action.Result], ActionFeedback[action.Feedback]


def _lookup(name: str, kind: str, word: str, known: dict[str, T]) -> T:
    parts = name.split("/")
    short = "/".join((PACKAGE_ALIASES.get(parts[0], parts[0]), parts[-1]))
    if short in known and (len(parts) == 2 or (len(parts) == 3 and parts[1] == kind)):
        return known[short]
    raise TypeNotFoundError(name, interface_type=word, known=known)


# -- definitions -------------------------------------------------------------------------------------------------------


def type_definitions(cls: Any, *, ros: RosVersion = RosVersion.TWO) -> tuple[TypeDef, ...]:
    """Returns the definition of a message type, followed by those of all message types in it, each once."""
    return tuple(_definition(each, ros) for each in _with_nested(cls, ros))


def definition_text(cls: Any, *, ros: RosVersion = RosVersion.TWO) -> str:
    """Returns the same as concatenated `.msg` files, the format of rosbag and of rosapi's raw types."""
    first, *nested = _with_nested(cls, ros)
    parts = [each for each in nested if not _is_builtin(each, ros)]
    texts = [f"{SEPARATOR}\nMSG: {short_name(each, ros)}\n{_text(each, ros)}" for each in parts]
    return "".join([_text(first, ros), *texts])


def interface_text(cls: Any, *, ros: RosVersion = RosVersion.TWO) -> str:
    """Returns one message as a `.msg` file; in ROS 2, field names are in lower case, as rosidl requires."""
    return _text(cls, ros) if ros is RosVersion.ONE else _text(cls, ros, lower=True)


def packages() -> tuple[str, ...]:
    """Returns the names of all packages."""
    return tuple(sorted(_generated.__all__))


def packages_in(cls: Any, *, ros: RosVersion = RosVersion.TWO) -> frozenset[str]:
    """Returns the packages of the messages that a message consists of."""
    nested = (field.message for _, field in _fields(cls, ros) if field.message)
    return frozenset(short_name(each, ros).partition("/")[0] for each in nested)


@cache
def field_layout(cls: Any) -> tuple[tuple[str, str, Any], ...]:
    """Returns the fields of a message in ROS 2 as `get_fields_and_field_types` of rclpy names them.

    Each is its name, its type, and for a message the layout of that, else None.
    """
    return tuple(
        (name.lower(), _rclpy_type(field), field_layout(field.message) if field.message else None)
        for name, field in _fields(cls, RosVersion.TWO)
    )


def _rclpy_type(field: FieldInfo) -> str:
    names = {"bool": "boolean", "byte": "octet", "char": "uint8", "float32": "float", "float64": "double"}
    element = _field_type(field, RosVersion.TWO)
    element = names.get(element, element)
    if field.length is None:
        return element
    return f"{element}[{field.length}]" if field.length else f"sequence<{element}>"


@cache
def is_ros1_only(name: str) -> bool:
    """Whether a type exists only in ROS 1, or is that of a service of a rosbridge: actionlib's, and rosapi's."""
    package = name.partition("/")[0]
    if package in {"actionlib_msgs", "rosapi", "rosapi_msgs", "move_base_msgs"}:
        return True
    short = f"{package}/{name.rpartition('/')[2]}"
    return any(short == type_name(topic) for action in _classes(Action) for topic in _action_topics(action))


def _definition(cls: Any, ros: RosVersion) -> TypeDef:
    fields = list(_fields(cls, ros))
    constants = list(constants_of(cls))
    return TypeDef(
        type=_name(cls, ros),
        fieldnames=tuple(name for name, _ in fields),
        fieldtypes=tuple(_field_type(field, ros) for _, field in fields),
        fieldarraylen=tuple(-1 if field.length is None else field.length for _, field in fields),
        examples=tuple(_example(field) for _, field in fields),
        constnames=tuple(name for name, _ in constants),
        constvalues=tuple(str(value) for _, value in constants),
    )


def _text(cls: Any, ros: RosVersion, *, lower: bool = False) -> str:
    constant_type = next((field.primitive for field in fields_of(cls) if field.enum), "uint8")
    lines = [f"{constant_type} {name}={value}" for name, value in constants_of(cls)]
    for name, field in _fields(cls, ros):
        length = "" if field.length is None else f"[{field.length or ''}]"
        lines.append(f"{_field_type(field, ros)}{length} {name.lower() if lower else name}")
    return "".join(f"{line}\n" for line in lines)


def _with_nested(cls: Any, ros: RosVersion) -> list[Any]:
    found: dict[Any, None] = {}

    def visit(each: Any) -> None:
        if each not in found:
            found[each] = None
            for _, field in _fields(each, ros):
                if field.message:
                    visit(field.message)

    visit(cls)
    return list(found)


def _fields(cls: Any, ros: RosVersion) -> Iterator[tuple[str, FieldInfo]]:
    struct = struct_of(cls)
    for field in fields_of(cls):
        if struct.only_in.get(field.name, ros) is ros:
            yield (struct.ros1_names.get(field.name, field.name) if ros is RosVersion.ONE else field.name), field


def _is_builtin(cls: Any, ros: RosVersion) -> bool:
    """Whether the type is a primitive in this version of ROS: `time` and `duration` are in ROS 1."""
    return ros is RosVersion.ONE and cls in {Time, Duration}


def _name(cls: Any, ros: RosVersion) -> str:
    return str(cls.__name__).lower() if _is_builtin(cls, ros) else short_name(cls, ros)


def _field_type(field: FieldInfo, ros: RosVersion) -> str:
    return _name(field.message, ros) if field.message else field.primitive


def _example(field: FieldInfo) -> str:
    if field.length is not None:
        return "[]"
    return "{}" if field.message else EXAMPLES[field.primitive]
