"""Offer: a service or an action as a part of the face declares it: a type, and a function over its messages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mindstage.msgs import Action, Service, snake_case
from mindstage.ros.job import GoalContext

__all__ = ["ActionSpec", "ServiceSpec"]


@dataclass(frozen=True, slots=True)
class ServiceSpec:
    """One service."""

    type: type[Service]
    handler: Callable[[Any], Any]
    """Gets the type's request and gives its response; what it raises tells how else it ended."""
    name: str = ""
    """Below the namespace, or from the root where it begins with a slash; by default the type's own, in snake case."""
    quick: bool = False
    """Whether it never waits, not even for the stage."""
    timeout_s: float | None = None
    """How long callers wait who do not say it; by default as long as the hub has it [s]."""

    def full_name(self, namespace: str) -> str:
        """Its full name."""
        return _full_name(self.name or snake_case(self.type), namespace)


@dataclass(frozen=True, slots=True)
class ActionSpec:
    """One action."""

    type: type[Action]
    handler: Callable[[Any, GoalContext], Any]
    """Gets the type's goal and what is needed to reach for it, and gives its result."""
    name: str = ""
    """As of a service."""

    def full_name(self, namespace: str) -> str:
        """Its full name."""
        return _full_name(self.name or snake_case(self.type), namespace)


def _full_name(name: str, namespace: str) -> str:
    return name if name.startswith("/") else "/".join(("", *filter(None, namespace.split("/")), name))
