"""Names: when two names mean one topic or service, and when two types are one."""

from __future__ import annotations

__all__ = ["resolve_name", "same_type"]


def resolve_name(name: str) -> str:
    """A name as the root namespace has it: `tf` and `/tf` are one."""
    return "/" + name.strip("/")


def same_type(first: str | None, second: str | None) -> bool:
    """Whether two names mean one type: ROS 1 says `std_msgs/String`, ROS 2 `std_msgs/msg/String`, and some say none."""
    return not first or not second or _short_type_name(first) == _short_type_name(second)


def _short_type_name(type: str) -> tuple[str, str]:
    package, _, rest = type.partition("/")
    return package, rest.rpartition("/")[2]
