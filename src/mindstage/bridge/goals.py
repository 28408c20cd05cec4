"""Goals: what is asked of an action, from the side that asks and from the side that does it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import msgspec

from mindstage.bridge.protocol import GoalStatus, Id
from mindstage.errors import ServiceTimeoutError

__all__ = ["ClientGoalHandle", "GoalResult", "ServerGoalHandle"]


class GoalResult(msgspec.Struct, frozen=True):
    """How a goal ended without an error: it was reached, given up, or the action itself says that it failed."""

    status: GoalStatus
    values: Any
    """The action's result, as plain values."""


class ClientGoalHandle:
    """A goal under way, as the one who sent it sees it."""

    def __init__(self, action: str, id: Id, cancel: Callable[[Id], None]) -> None:
        self.action = action
        self.id = id
        self.future: Future[GoalResult] = Future()
        """Its end, for those who do not want to block; it raises what `wait` raises."""
        self._cancel = cancel

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self.future.done()

    def cancel(self) -> None:
        """Asks to give the goal up; `wait` tells whether it was."""
        self._cancel(self.id)

    def wait(self, timeout_s: float = 10.0) -> GoalResult:
        """Waits for the end.

        Raises:
            ServiceTimeoutError: it goes on; cancel it, or wait again.
            ServiceNotFoundError: nobody offers the action.
            ServiceCallError: it broke.
            ConnectionLostError: nobody knows.
        """
        try:
            return self.future.result(timeout_s)
        except TimeoutError:
            if self.future.done():
                return self.future.result()
            raise ServiceTimeoutError(self.action, timeout_s=timeout_s) from None


class ServerGoalHandle:
    """A goal under way, as the handler that reaches for it sees it."""

    def __init__(self, action: str, id: Id, args: Any, feedback: Callable[[Id, object], None]) -> None:
        self.action = action
        self.id = id
        self.args = args
        """As sent: an object, or a list of its fields in order."""
        self._feedback = feedback
        self._cancelled = threading.Event()

    @property
    def cancel_requested(self) -> bool:
        """Whether it shall be given up, because someone said so or because whoever wanted it is gone."""
        return self._cancelled.is_set()

    def wait_for_cancel(self, timeout_s: float) -> bool:
        """Sleeps, and wakes early when the goal shall be given up; tells whether it shall."""
        return self._cancelled.wait(timeout_s)

    def feedback(self, values: object) -> None:
        """Tells how it goes, from any thread."""
        self._feedback(self.id, values)

    def request_cancel(self) -> None:
        """Makes `cancel_requested` true."""
        self._cancelled.set()

    @staticmethod
    def succeeded(values: object = None) -> GoalResult:
        """What the handler returns when the goal was reached; plain values mean the same."""
        return GoalResult(GoalStatus.SUCCEEDED, values)

    @staticmethod
    def canceled(values: object = None) -> GoalResult:
        """What the handler returns when it gave the goal up."""
        return GoalResult(GoalStatus.CANCELED, values)

    @staticmethod
    def aborted(values: object = None) -> GoalResult:
        """What the handler returns when the goal cannot be reached; to say why in words, raise an error instead."""
        return GoalResult(GoalStatus.ABORTED, values)
