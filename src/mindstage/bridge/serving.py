"""Serving: what one participant offers, and the handlers that answer for it.

A plain function runs in a worker thread, one call at a time for each caller and in the order they came; a coroutine
function runs on the loop, beside others. A goal may take hours and so has a thread of its own, lest calls wait for it.
Whatever a handler raises becomes an answer: nobody waits in vain.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Awaitable, Callable, Coroutine, Hashable
from inspect import iscoroutinefunction
from itertools import count
from typing import Any

import msgspec

from mindstage.bridge.goals import GoalResult, ServerGoalHandle
from mindstage.bridge.lanes import KeyedSerialExecutor
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
from mindstage.errors import MindstageError

__all__ = ["MAX_GOALS", "ActionHandler", "HandlerDispatcher", "ServiceHandler"]

MAX_GOALS = 32
"""So many goals may be under way at one participant, whoever sent them; more are refused."""

ServiceHandler = Callable[[Any], object]
"""Gets the arguments as sent (an object, or a list of its fields) and returns the answer's values: whatever JSON can
say, structs included. May be a coroutine function. What it raises is told to the caller as `result: false`."""

ActionHandler = Callable[[ServerGoalHandle], object]
"""Gets the goal and returns how it ended: a `GoalResult`, or just the values if it was reached. May be a coroutine
function."""

_log = logging.getLogger("mindstage.bridge")


class HandlerDispatcher:
    """Answers the calls and reaches the goals of one participant. Belongs to the loop."""

    def __init__(self, loop: EventLoopThread, lanes: KeyedSerialExecutor, send: Callable[[Operation], None]) -> None:
        """Nothing is offered yet.

        Args:
            loop: where it belongs.
            lanes: where plain functions run.
            send: how answers leave; called on the loop.
        """
        self.services: dict[str, ServiceHandler] = {}
        self.quick: set[str] = set()
        """Those whose handlers never wait, so that they need no thread, unless their caller's turn has not come yet."""
        self.actions: dict[str, ActionHandler] = {}
        self._loop = loop
        self._executor = lanes
        self._send = send
        self._goals: dict[Id, ServerGoalHandle] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._next_id = count(1)

    def call(self, name: str, call: CallService, caller: Hashable) -> None:
        """Answers one call of the service of that name."""
        handler = self.services.get(name)
        if handler is None:
            self._send(_call_error_response(call, f"Service {call.service} does not exist"))
        elif iscoroutinefunction(handler):
            self.start_task(self._handle_call_async(handler, call))
        elif name in self.quick and not self._executor.is_busy(caller):
            self._handle_call(handler, call)
        else:
            self._executor.submit(caller, lambda: self._handle_call(handler, call))

    def start_goal(self, name: str, request: SendActionGoal) -> None:
        """Begins to reach for one goal of the action of that name; goals do not wait for each other."""
        handler = self.actions.get(name)
        id = f"goal:{next(self._next_id)}" if request.id is None else request.id
        why = ""
        if id in self._goals:
            why = f"the goal {id!r} is under way"
        elif len(self._goals) >= MAX_GOALS:
            why = f"{MAX_GOALS} goals are under way already; wait until one has ended, or cancel one"
        if handler is None or why:
            self._send(_goal_error_result(request, id, why or f"Action {request.action} does not exist"))
            return
        goal = self._goals[id] = ServerGoalHandle(request.action, id, None, self._feedback_sender(request))
        if iscoroutinefunction(handler):
            self.start_task(self._run_goal_async(handler, request, goal))
        else:
            work = (handler, request, goal)
            threading.Thread(target=self._run_goal, args=work, name="mindstage-goal", daemon=True).start()

    def cancel(self, request: CancelActionGoal) -> None:
        """Asks a goal's handler to give up; a goal that has ended needs nothing."""
        if goal := self._goals.get(request.id):
            goal.request_cancel()

    def cancel_all(self) -> None:
        """Asks all handlers to give up: whoever wanted the goals cannot hear of them any more."""
        for goal in self._goals.values():
            goal.request_cancel()

    def start_task(self, work: Coroutine[Any, Any, None]) -> None:
        """Runs a coroutine, which must not raise, beside everything else."""
        task = asyncio.ensure_future(work)
        self._tasks.add(task)  # the loop itself holds tasks but weakly
        task.add_done_callback(self._tasks.discard)

    # -- services ------------------------------------------------------------------------------------------------------

    def _handle_call(self, handler: ServiceHandler, call: CallService) -> None:
        try:
            values = _encode_values(handler(_decode_args(call.args)))
            response = ServiceResponse(id=call.id, service=call.service, values=values, result=True)
        except Exception as error:
            response = _call_error_response(call, _error_reply(call.service, error))
        self._loop.call_soon(self._send, response)

    async def _handle_call_async(self, handler: ServiceHandler, call: CallService) -> None:
        try:
            values = _encode_values(await _await_if_needed(handler(_decode_args(call.args))))
            response = ServiceResponse(id=call.id, service=call.service, values=values, result=True)
        except Exception as error:
            response = _call_error_response(call, _error_reply(call.service, error))
        self._send(response)

    # -- actions -------------------------------------------------------------------------------------------------------

    def _feedback_sender(self, request: SendActionGoal) -> Callable[[Id, object], None]:
        def feedback(id: Id, values: object) -> None:
            told = ActionFeedback(id=id, action=request.action, values=_encode_values(values))
            self._loop.call_soon(self._send_feedback, told)

        return feedback

    def _send_feedback(self, feedback: ActionFeedback) -> None:
        if feedback.id in self._goals:  # whoever asked was told of the end already, and shall hear nothing after it
            self._send(feedback)

    def _run_goal(self, handler: ActionHandler, request: SendActionGoal, goal: ServerGoalHandle) -> None:
        try:
            goal.args = _decode_args(request.args)
            result = _goal_result(request, goal.id, handler(goal))
        except Exception as error:
            result = _goal_error_result(request, goal.id, _error_reply(request.action, error))
        self._loop.call_soon(self._send_result, result)

    async def _run_goal_async(self, handler: ActionHandler, request: SendActionGoal, goal: ServerGoalHandle) -> None:
        try:
            goal.args = _decode_args(request.args)
            result = _goal_result(request, goal.id, await _await_if_needed(handler(goal)))
        except Exception as error:
            result = _goal_error_result(request, goal.id, _error_reply(request.action, error))
        self._send_result(result)

    def _send_result(self, result: ActionResult) -> None:
        if result.id is not None:
            self._goals.pop(result.id, None)
        self._send(result)


async def _await_if_needed(result: object) -> object:
    return await result if isinstance(result, Awaitable) else result


def _decode_args(args: msgspec.Raw | msgspec.UnsetType) -> Any:
    return msgspec.json.decode(content(args))


def _encode_values(values: object) -> msgspec.Raw:
    return msgspec.Raw(b"{}" if values is None else msgspec.json.encode(values))


def _error_reply(name: str, error: Exception) -> str:
    if isinstance(error, MindstageError):
        return str(error)
    _log.error("the handler of %s broke", name, exc_info=error)
    return f"{name} broke: {type(error).__name__}: {error}"


def _call_error_response(call: CallService, reason: str) -> ServiceResponse:
    return ServiceResponse(id=call.id, service=call.service, values=_encode_values(reason), result=False)


def _goal_error_result(order: SendActionGoal, id: Id, reason: str) -> ActionResult:
    return ActionResult(
        id=id, action=order.action, values=_encode_values(reason), status=GoalStatus.ABORTED, result=False
    )


def _goal_result(order: SendActionGoal, id: Id, outcome: object) -> ActionResult:
    if not isinstance(outcome, GoalResult):
        outcome = GoalResult(GoalStatus.SUCCEEDED, outcome)
    values = _encode_values(outcome.values)
    return ActionResult(id=id, action=order.action, values=values, status=outcome.status, result=True)
