"""Calling: what one participant has asked for and waits to hear of; everything it began ends, in time."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from itertools import count
from typing import Any

import msgspec

from mindstage.bridge.goals import ClientGoalHandle, GoalResult
from mindstage.bridge.loop import EventLoopThread
from mindstage.bridge.protocol import (
    ActionFeedback,
    ActionResult,
    CallService,
    CancelActionGoal,
    GoalStatus,
    Id,
    Operation,
    SendActionGoal,
    ServiceResponse,
    content,
)
from mindstage.errors import (
    BridgeError,
    MessageValidationError,
    ServiceCallError,
    ServiceNotFoundError,
    ServiceTimeoutError,
)

__all__ = ["FeedbackHandler", "PendingCalls"]

FeedbackHandler = Callable[[Any], object]
"""Told how a goal goes, on the bridge's thread: it must not take long."""

_TIMEOUT_MARGIN_S = 1.0
"""The far side is given this much longer, so that our own clock decides."""
_log = logging.getLogger("mindstage.bridge")


class _Call:
    def __init__(self, service: str, future: Future[Any], timer: asyncio.TimerHandle) -> None:
        self.service = service
        self.future = future
        self.timer = timer


class PendingCalls:
    """Calls and goals of one participant that have no answer yet. Belongs to the loop."""

    def __init__(self, loop: EventLoopThread, send: Callable[[Operation], None]) -> None:
        self._loop = loop
        self._send = send
        self._calls: dict[Id, _Call] = {}
        self._goals: dict[Id, tuple[ClientGoalHandle, FeedbackHandler | None]] = {}
        self._next_id = count(1)

    def call_service(self, service: str, args: msgspec.Raw, timeout_s: float, future: Future[Any]) -> None:
        """Asks; the future gets the answer's values, or the error."""
        id = f"call_service:{service}:{next(self._next_id)}"
        timer = self._loop.loop.call_later(timeout_s, self._time_out, id, timeout_s)
        self._calls[id] = _Call(service, future, timer)
        try:
            self._send(CallService(id=id, service=service, args=args, timeout=timeout_s + _TIMEOUT_MARGIN_S))
        except BridgeError as error:
            self._end_call(id, error)

    def send_goal(
        self, action: str, type: str, args: msgspec.Raw, on_feedback: FeedbackHandler | None
    ) -> ClientGoalHandle:
        """Sends a goal on its way."""
        id = f"send_action_goal:{action}:{next(self._next_id)}"
        goal = ClientGoalHandle(action, id, partial(self._loop.call_soon, self._cancel))
        self._goals[id] = (goal, on_feedback)
        try:
            told = on_feedback is not None
            self._send(SendActionGoal(id=id, action=action, action_type=type, args=args, feedback=told))
        except BridgeError as error:
            del self._goals[id]
            goal.future.set_exception(error)
        return goal

    def on_response(self, response: ServiceResponse) -> None:
        """Gives a call its answer; one that nobody waits for any more is no harm."""
        call = None if response.id is None else self._calls.get(response.id)
        if call is None or response.id is None:
            _log.debug("an answer of %s that nobody waits for", response.service)
            return
        try:
            values = _values(call.service, response.values, response.result)
        except BridgeError as error:
            self._end_call(response.id, error)
        else:
            self._end_call(response.id, values)

    def on_feedback(self, message: ActionFeedback) -> None:
        """Passes on how a goal goes."""
        _, handler = self._goals.get(message.id, (None, None))
        if handler is None:
            return
        try:
            handler(_decode_values(message.values))
        except Exception:
            _log.exception("the feedback handler of %s broke", message.action)

    def on_result(self, result: ActionResult) -> None:
        """Ends a goal."""
        goal, _ = self._goals.pop("" if result.id is None else result.id, (None, None))
        if goal is None:
            _log.debug("a result of %s that nobody waits for", result.action)
            return
        try:
            values = _values(result.action, result.values, result.result)
        except BridgeError as error:
            goal.future.set_exception(error)
        else:
            goal.future.set_result(GoalResult(_goal_status(result.status), values))

    def fail_all(self, error: BridgeError) -> None:
        """Ends everything: whoever could answer is gone."""
        for id in list(self._calls):
            self._end_call(id, error)
        goals, self._goals = self._goals, {}
        for goal, _ in goals.values():
            goal.future.set_exception(error)

    def _cancel(self, id: Id) -> None:
        if id in self._goals:
            try:
                self._send(CancelActionGoal(id=id, action=self._goals[id][0].action))
            except BridgeError as error:
                _log.debug("a goal could not be cancelled: %s", error)  # its end tells of the loss

    def _time_out(self, id: Id, timeout_s: float) -> None:
        self._end_call(id, ServiceTimeoutError(self._calls[id].service, timeout_s=timeout_s))

    def _end_call(self, id: Id, outcome: object) -> None:
        call = self._calls.pop(id)
        call.timer.cancel()
        if call.future.cancelled():
            return
        if isinstance(outcome, BridgeError):
            call.future.set_exception(outcome)
        else:
            call.future.set_result(outcome)


def _values(name: str, raw: msgspec.Raw | msgspec.UnsetType, succeeded: bool) -> Any:
    try:
        values = _decode_values(raw)
    except msgspec.DecodeError as error:
        raise MessageValidationError(f"the answer of {name}", cause=str(error)) from None
    if succeeded:
        return values
    cause = values if isinstance(values, str) else str(values or "no reason was given")
    if cause.startswith((f"Service {name} does not exist", f"Action {name} does not exist")):
        raise ServiceNotFoundError(name)
    raise ServiceCallError(name, cause=cause)


def _decode_values(raw: msgspec.Raw | msgspec.UnsetType) -> Any:
    return msgspec.json.decode(content(raw))


def _goal_status(status: int) -> GoalStatus:
    try:
        return GoalStatus(status)
    except ValueError:
        return GoalStatus.UNKNOWN
