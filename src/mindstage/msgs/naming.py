"""Naming: what a type is called in ROS, in both spellings.

`geometry_msgs/Pose` and `geometry_msgs/msg/Pose` are one type; so are a service's `world_control_msgs/SpawnModel` and
`world_control_msgs/srv/SpawnModel`. The parts of a service and of an action have names of their own.
"""

from __future__ import annotations

import re
from typing import Any

from mindstage.msgs.message import Action, Message, Ros, Service

__all__ = ["PACKAGE_NAMES", "engine_service", "short_name", "snake_case", "type_name"]

PACKAGE_NAMES = {"rosapi_msgs": "rosapi", "tf": "tf2_msgs"}
"""Other names of packages: ROS 2 splits rosapi, and an old ROS 1 has `tf`."""

ROOT = __name__.rpartition(".")[0]


def type_name(cls: Any, ros: Ros = Ros.ONE) -> str:
    """The name of a message, of a part of a service or an action, or of a service or an action itself.

    Args:
        cls: the class; a goal on actionlib's topic is called after the action.
        ros: whose spelling; ROS 1's has no kind in the middle.
    """
    package, name = _place(cls, "" if ros is Ros.ONE else "_")
    return f"{package}/{name}" if ros is Ros.ONE else f"{package}/{_kind(cls)}/{name}"


def short_name(cls: Any, ros: Ros = Ros.ONE) -> str:
    """The name without the kind, as rosapi writes it in either ROS."""
    package, name = _place(cls, "" if ros is Ros.ONE else "_")
    return f"{package}/{name}"


def snake_case(cls: type[Service] | type[Action]) -> str:
    """What a service or an action is called where nothing else is agreed: `SpawnModel` is `spawn_model`."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", cls.__name__).lower()


def engine_service(cls: type[Service] | type[Action], namespace: str) -> str:
    """Where a stage under a namespace offers a service or an action of mindstage_msgs, and an engine far away calls it.

    `SpawnWorld` under `unreal` is `/unreal/mindstage/spawn_world`.
    """
    return "/".join(("", *filter(None, namespace.split("/")), "mindstage", snake_case(cls)))


def _place(cls: Any, joint: str) -> tuple[str, str]:
    """The package, and the name in it."""
    if about := getattr(cls, "__args__", None):
        package, name = _place(about[0], joint)
        return package, name[: -len(joint + about[0].__name__)] + cls.__origin__.__name__
    package = cls.__module__.removeprefix(f"{ROOT}.").partition(".")[0]
    return package, cls.__qualname__.replace(".", joint)


def _kind(cls: Any) -> str:
    if hasattr(cls, "__args__"):
        return "action"
    if issubclass(cls, Message) and "." in cls.__qualname__:
        return "srv" if cls.__name__ in {"Request", "Response"} else "action"
    return "srv" if issubclass(cls, Service) else "action" if issubclass(cls, Action) else "msg"
