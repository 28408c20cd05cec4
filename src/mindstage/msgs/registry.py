"""Registry: every type that is known, by its ROS name in either spelling."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from functools import cache
from types import ModuleType
from typing import Any, NamedTuple, TypeVar

from mindstage.errors import TypeUnknown
from mindstage.msgs import (
    actionlib_msgs,
    builtin_interfaces,
    diagnostic_msgs,
    geometry_msgs,
    mindstage_msgs,
    modul_spawner_msgs,
    rosapi,
    rosgraph_msgs,
    sensor_msgs,
    simulation_interfaces,
    std_msgs,
    std_srvs,
    tf2_msgs,
    unreal_vis_msgs,
    visualization_msgs,
    world_control_msgs,
)
from mindstage.msgs.actionlib_msgs import ActionFeedback, ActionGoal, ActionResult
from mindstage.msgs.message import Action, Message, Service
from mindstage.msgs.naming import PACKAGE_NAMES, type_name

__all__ = [
    "ActionTypes",
    "ServiceTypes",
    "action_type",
    "action_types",
    "message_type",
    "message_types",
    "service_type",
    "service_types",
]

MODULES: tuple[ModuleType, ...] = (
    actionlib_msgs,
    builtin_interfaces,
    diagnostic_msgs,
    geometry_msgs,
    mindstage_msgs.actions,
    mindstage_msgs.messages,
    mindstage_msgs.services,
    modul_spawner_msgs,
    rosapi,
    rosgraph_msgs,
    sensor_msgs,
    simulation_interfaces.messages,
    simulation_interfaces.services,
    std_msgs,
    std_srvs,
    tf2_msgs,
    unreal_vis_msgs,
    visualization_msgs,
    world_control_msgs.messages,
    world_control_msgs.services,
)

T = TypeVar("T")


class ServiceTypes(NamedTuple):
    """The two messages of a service."""

    request: type[Message]
    response: type[Message]


class ActionTypes(NamedTuple):
    """The three messages of an action."""

    goal: type[Message]
    result: type[Message]
    feedback: type[Message]


def message_type(name: str) -> type[Message]:
    """The message of that name, such as `geometry_msgs/Pose` or `geometry_msgs/msg/Pose`.

    What ROS 1 carries on an action's topics is there too: `simulation_interfaces/SimulateStepsActionGoal`.

    Raises:
        TypeUnknown: there is none.
    """
    return _found(name, "msg", "message", message_types())


def service_type(name: str) -> ServiceTypes:
    """The request and the response of the service of that name.

    Raises:
        TypeUnknown: there is none.
    """
    return _found(name, "srv", "service", service_types())


def action_type(name: str) -> ActionTypes:
    """The goal, the result and the feedback of the action of that name.

    Raises:
        TypeUnknown: there is none.
    """
    return _found(name, "action", "action", action_types())


@cache
def message_types() -> dict[str, type[Message]]:
    """All messages by their short name; those of services and actions are found with them."""
    plain = {type_name(cls): cls for cls in _classes(Message) if not hasattr(cls, "__parameters__")}
    topics = {type_name(topic): topic for action in _classes(Action) for topic in _topics(action)}
    return plain | topics


@cache
def service_types() -> dict[str, ServiceTypes]:
    """All services by their short name."""
    return {type_name(cls): ServiceTypes(cls.Request, cls.Response) for cls in _classes(Service)}


@cache
def action_types() -> dict[str, ActionTypes]:
    """All actions by their short name."""
    return {type_name(cls): ActionTypes(cls.Goal, cls.Result, cls.Feedback) for cls in _classes(Action)}


def _classes(kind: type[T]) -> Iterator[type[T]]:
    for module in MODULES:
        for _, cls in inspect.getmembers(module, inspect.isclass):
            if cls.__module__ == module.__name__ and issubclass(cls, kind):
                yield cls


def _topics(action: Any) -> tuple[Any, Any, Any]:
    return ActionGoal[action.Goal], ActionResult[action.Result], ActionFeedback[action.Feedback]


def _found(name: str, kind: str, word: str, known: dict[str, T]) -> T:
    parts = name.split("/")
    short = "/".join((PACKAGE_NAMES.get(parts[0], parts[0]), parts[-1]))
    if short in known and (len(parts) == 2 or (len(parts) == 3 and parts[1] == kind)):
        return known[short]
    raise TypeUnknown(name, kind=word, known=known)
