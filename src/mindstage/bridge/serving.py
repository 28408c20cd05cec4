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

from mindstage.bridge.goals import GoalOutcome, ServedGoal
from mindstage.bridge.lanes import Lanes
from mindstage.bridge.loop import LoopThread
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

__all__ = ["MOST_GOALS", "ActionHandler", "ServiceHandler", "Serving"]

MOST_GOALS = 32
"""So many goals may be under way at one participant, whoever sent them; more are refused."""

ServiceHandler = Callable[[Any], object]
"""Gets the arguments as sent (an object, or a list of its fields) and returns the answer's values: whatever JSON can
say, structs included. May be a coroutine function. What it raises is told to the caller as `result: false`."""

ActionHandler = Callable[[ServedGoal], object]
"""Gets the goal and returns how it ended: a `GoalOutcome`, or just the values if it was reached. May be a coroutine
function."""

_log = logging.getLogger("mindstage.bridge")


class Serving:
    """Answers the calls and reaches the goals of one participant. Belongs to the loop."""

    def __init__(self, loop: LoopThread, lanes: Lanes, send: Callable[[Operation], None]) -> None:
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
        self._lanes = lanes
        self._send = send
        self._goals: dict[Id, ServedGoal] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._numbers = count(1)

    def call(self, name: str, call: CallService, caller: Hashable) -> None:
        """Answers one call of the service of that name."""
        handler = self.services.get(name)
        if handler is None:
            self._send(_failed_call(call, f"Service {call.service} does not exist"))
        elif iscoroutinefunction(handler):
            self.start(self._answer_async(handler, call))
        elif name in self.quick and not self._lanes.busy(caller):
            self._answer(handler, call)
        else:
            self._lanes.put(caller, lambda: self._answer(handler, call))

    def goal(self, name: str, order: SendActionGoal) -> None:
        """Begins to reach for one goal of the action of that name; goals do not wait for each other."""
        handler = self.actions.get(name)
        id = f"goal:{next(self._numbers)}" if order.id is None else order.id
        why = ""
        if id in self._goals:
            why = f"the goal {id!r} is under way"
        elif len(self._goals) >= MOST_GOALS:
            why = f"{MOST_GOALS} goals are under way already; wait until one has ended, or cancel one"
        if handler is None or why:
            self._send(_failed_goal(order, id, why or f"Action {order.action} does not exist"))
            return
        goal = self._goals[id] = ServedGoal(order.action, id, None, self._feedback(order))
        if iscoroutinefunction(handler):
            self.start(self._reach_async(handler, order, goal))
        else:
            work = (handler, order, goal)
            threading.Thread(target=self._reach, args=work, name="mindstage-goal", daemon=True).start()

    def cancel(self, order: CancelActionGoal) -> None:
        """Asks a goal's handler to give up; a goal that has ended needs nothing."""
        if goal := self._goals.get(order.id):
            goal.request_cancel()

    def cancel_all(self) -> None:
        """Asks all handlers to give up: whoever wanted the goals cannot hear of them any more."""
        for goal in self._goals.values():
            goal.request_cancel()

    def start(self, work: Coroutine[Any, Any, None]) -> None:
        """Runs a coroutine, which must not raise, beside everything else."""
        task = asyncio.ensure_future(work)
        self._tasks.add(task)  # the loop itself holds tasks but weakly
        task.add_done_callback(self._tasks.discard)

    # -- services ------------------------------------------------------------------------------------------------------

    def _answer(self, handler: ServiceHandler, call: CallService) -> None:
        try:
            values = _written(handler(_read(call.args)))
            response = ServiceResponse(id=call.id, service=call.service, values=values, result=True)
        except Exception as error:
            response = _failed_call(call, _told(call.service, error))
        self._loop.soon(self._send, response)

    async def _answer_async(self, handler: ServiceHandler, call: CallService) -> None:
        try:
            values = _written(await _awaited(handler(_read(call.args))))
            response = ServiceResponse(id=call.id, service=call.service, values=values, result=True)
        except Exception as error:
            response = _failed_call(call, _told(call.service, error))
        self._send(response)

    # -- actions -------------------------------------------------------------------------------------------------------

    def _feedback(self, order: SendActionGoal) -> Callable[[Id, object], None]:
        def feedback(id: Id, values: object) -> None:
            told = ActionFeedback(id=id, action=order.action, values=_written(values))
            self._loop.soon(self._tell, told)

        return feedback

    def _tell(self, feedback: ActionFeedback) -> None:
        if feedback.id in self._goals:  # whoever asked was told of the end already, and shall hear nothing after it
            self._send(feedback)

    def _reach(self, handler: ActionHandler, order: SendActionGoal, goal: ServedGoal) -> None:
        try:
            goal.args = _read(order.args)
            result = _ended(order, goal.id, handler(goal))
        except Exception as error:
            result = _failed_goal(order, goal.id, _told(order.action, error))
        self._loop.soon(self._end, result)

    async def _reach_async(self, handler: ActionHandler, order: SendActionGoal, goal: ServedGoal) -> None:
        try:
            goal.args = _read(order.args)
            result = _ended(order, goal.id, await _awaited(handler(goal)))
        except Exception as error:
            result = _failed_goal(order, goal.id, _told(order.action, error))
        self._end(result)

    def _end(self, result: ActionResult) -> None:
        if result.id is not None:
            self._goals.pop(result.id, None)
        self._send(result)


async def _awaited(result: object) -> object:
    return await result if isinstance(result, Awaitable) else result


def _read(args: msgspec.Raw | msgspec.UnsetType) -> Any:
    return msgspec.json.decode(content(args))


def _written(values: object) -> msgspec.Raw:
    return msgspec.Raw(b"{}" if values is None else msgspec.json.encode(values))


def _told(name: str, error: Exception) -> str:
    if isinstance(error, MindstageError):
        return str(error)
    _log.error("the handler of %s broke", name, exc_info=error)
    return f"{name} broke: {type(error).__name__}: {error}"


def _failed_call(call: CallService, why: str) -> ServiceResponse:
    return ServiceResponse(id=call.id, service=call.service, values=_written(why), result=False)


def _failed_goal(order: SendActionGoal, id: Id, why: str) -> ActionResult:
    return ActionResult(id=id, action=order.action, values=_written(why), status=GoalStatus.ABORTED, result=False)


def _ended(order: SendActionGoal, id: Id, outcome: object) -> ActionResult:
    if not isinstance(outcome, GoalOutcome):
        outcome = GoalOutcome(GoalStatus.SUCCEEDED, outcome)
    values = _written(outcome.values)
    return ActionResult(id=id, action=order.action, values=values, status=outcome.status, result=True)
