"""Calls and goals of one node: those that wait for a response, and the handlers of those from others.

Plain functions as handlers run in worker threads, the calls of one caller in their order; coroutine functions run
on the event loop. Each goal has a thread of its own, since it may take hours. An exception of a handler becomes an
error response. Every call and every goal ends: with a response, an error, a timeout, or the loss of the connection.
"""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import Awaitable, Callable, Coroutine, Hashable
from concurrent.futures import Future
from functools import partial
from inspect import iscoroutinefunction
from itertools import count
from typing import Any, TypeVar

import msgspec

from mindstage.access.fair_queue import handling_for
from mindstage.access.limits import NODE_GOALS, Timeout
from mindstage.access.policies import EDIT, EntryKind, Policy
from mindstage.access.resources import without_paths
from mindstage.bridge.event_loop import EventLoopThread, KeyedSerialExecutor
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
    non_finite_path,
)
from mindstage.errors import (
    BridgeError,
    FailureResponseError,
    MessageValidationError,
    MindstageError,
    RequestLimitError,
    ServiceCallError,
    ServiceNotFoundError,
    ServiceTimeoutError,
)
from mindstage.ranges import checked
from mindstage.unicode_json import encode_json

__all__ = [
    "ActionHandler",
    "BatchHandler",
    "ClientGoalHandle",
    "FeedbackHandler",
    "GoalResult",
    "HandlerDispatcher",
    "PendingCalls",
    "ServerGoalHandle",
    "ServiceHandler",
    "encode_values",
]

_MARGIN_S = 1.0
"""Added to the timeout that is sent to the provider, so that the timeout on this side ends first [s]."""
_log = logging.getLogger("mindstage.bridge")
T = TypeVar("T")


class GoalResult(msgspec.Struct, frozen=True):
    """Result of a goal that ended without an error: succeeded, canceled, or aborted by its handler."""

    status: GoalStatus
    values: Any
    """The result of the action, as plain values."""


class ClientGoalHandle:
    """A goal on the side of its client."""

    def __init__(self, action: str, id: Id, cancel: Callable[[Id], None]) -> None:
        self.action = action
        self.id = id
        self.future: Future[GoalResult] = Future()
        """Completes when the goal ends, with the result or the exception of `wait`."""
        self._cancel = cancel

    @property
    def done(self) -> bool:
        """Whether the goal has ended."""
        return self.future.done()

    def cancel(self) -> None:
        """Requests cancellation; the result of `wait` has the final status."""
        self._cancel(self.id)

    @checked
    def wait(self, timeout_s: Timeout = 10.0) -> GoalResult:
        """Waits for the result.

        Raises:
            ServiceTimeoutError: the goal is still active; cancel it, or wait again.
            ServiceNotFoundError: the action is not advertised.
            ServiceCallError: the action returned an error.
            ConnectionLostError: the connection was lost, and the status of the goal is unknown.
        """
        try:
            return self.future.result(timeout_s)
        except TimeoutError:
            if self.future.done():
                return self.future.result()
            raise ServiceTimeoutError(self.action, timeout_s=timeout_s) from None


class ServerGoalHandle:
    """A goal on the side of the handler that executes it."""

    def __init__(self, action: str, id: Id, args: Any, feedback: Callable[[Id, object], None]) -> None:
        self.action = action
        self.id = id
        self.args = args
        """The goal as it was sent: an object, or a list of its fields in order."""
        self._feedback = feedback
        self._cancelled = threading.Event()
        self._lock = threading.Lock()
        self._on_cancel: list[Callable[[], object]] = []

    @property
    def cancel_requested(self) -> bool:
        """Whether cancellation was requested, or the client has disconnected."""
        return self._cancelled.is_set()

    @checked
    def wait_for_cancel(self, timeout_s: Timeout) -> bool:
        """Sleeps, at most until cancellation is requested; returns whether it was."""
        return self._cancelled.wait(timeout_s)

    def feedback(self, values: object) -> None:
        """Sends feedback, from any thread."""
        self._feedback(self.id, values)

    def on_cancel(self, callback: Callable[[], object]) -> None:
        """Registers a callback that is called when cancellation is requested, or now if it was.

        It is called in the thread that receives the request, so that nothing waits for the thread of the handler; it
        must return at once.
        """
        with self._lock:
            if not self._cancelled.is_set():
                self._on_cancel.append(callback)
                return
        callback()

    def request_cancel(self) -> None:
        """Sets `cancel_requested`."""
        with self._lock:
            self._cancelled.set()
            callbacks, self._on_cancel = self._on_cancel, []
        for callback in callbacks:
            callback()

    @staticmethod
    def succeeded(values: object = None) -> GoalResult:
        """Returns the result of a goal that succeeded; a handler may also return the values alone."""
        return GoalResult(GoalStatus.SUCCEEDED, values)

    @staticmethod
    def canceled(values: object = None) -> GoalResult:
        """Returns the result of a goal that was canceled."""
        return GoalResult(GoalStatus.CANCELED, values)

    @staticmethod
    def aborted(values: object = None) -> GoalResult:
        """Returns the result of a goal that failed; to add a message, raise an exception instead."""
        return GoalResult(GoalStatus.ABORTED, values)


FeedbackHandler = Callable[[Any], object]
"""Called with the feedback of a goal, on the bridge's thread: it must not block."""


class _Call:
    def __init__(self, service: str, future: Future[Any], timer: asyncio.TimerHandle) -> None:
        self.service = service
        self.future = future
        self.timer = timer


class PendingCalls:
    """Calls and goals of one node that have not ended. Belongs to the loop."""

    def __init__(self, loop: EventLoopThread, send: Callable[[Operation], None]) -> None:
        self._loop = loop
        self._send = send
        self._calls: dict[Id, _Call] = {}
        self._goals: dict[Id, tuple[ClientGoalHandle, FeedbackHandler | None]] = {}
        self._next_id = count(1)

    def call_service(self, service: str, args: msgspec.Raw, timeout_s: float, future: Future[Any]) -> None:
        """Sends a call; the future receives the values of the response, or the error."""
        id = f"call_service:{service}:{next(self._next_id)}"
        timer = self._loop.loop.call_later(timeout_s, self._time_out, id, timeout_s)
        self._calls[id] = _Call(service, future, timer)
        try:
            self._send(CallService(id=id, service=service, args=args, timeout=timeout_s + _MARGIN_S))
        except BridgeError as error:
            self._end_call(id, error)

    def send_goal(
        self, action: str, type: str, args: msgspec.Raw, on_feedback: FeedbackHandler | None
    ) -> ClientGoalHandle:
        """Sends a goal."""
        id = f"send_action_goal:{action}:{next(self._next_id)}"
        goal = ClientGoalHandle(action, id, partial(self._loop.call_soon, self._cancel))
        self._goals[id] = (goal, on_feedback)
        try:
            wants_feedback = on_feedback is not None
            self._send(SendActionGoal(id=id, action=action, action_type=type, args=args, feedback=wants_feedback))
        except BridgeError as error:
            del self._goals[id]
            goal.future.set_exception(error)
        return goal

    def on_response(self, response: ServiceResponse) -> None:
        """Completes a call; a response to a call that has ended is ignored."""
        call = None if response.id is None else self._calls.get(response.id)
        if call is None or response.id is None:
            _log.debug("a response of %s to a call that has ended", response.service)
            return
        try:
            values = _values(call.service, response.values, response.result)
        except BridgeError as error:
            self._end_call(response.id, error)
        else:
            self._end_call(response.id, values)

    def on_feedback(self, message: ActionFeedback) -> None:
        """Calls the feedback handler of a goal."""
        _, handler = self._goals.get(message.id, (None, None))
        if handler is None:
            return
        try:
            handler(_decode_values(message.values))
        except Exception:
            _log.exception("the feedback handler of %s failed", message.action)

    def on_result(self, result: ActionResult) -> None:
        """Completes a goal."""
        goal, _ = self._goals.pop("" if result.id is None else result.id, (None, None))
        if goal is None:
            _log.debug("a result of %s for a goal that has ended", result.action)
            return
        try:
            values = _values(result.action, result.values, result.result)
        except BridgeError as error:
            goal.future.set_exception(error)
        else:
            goal.future.set_result(GoalResult(GoalStatus(result.status), values))

    def fail_all(self, error: BridgeError) -> None:
        """Fails all calls and goals, since the connection is lost."""
        for id in (*self._calls, *self._goals):
            self.fail(id, error)

    def fail(self, id: Id, error: BridgeError) -> bool:
        """Fails a call or a goal that the server rejected; returns whether it was pending."""
        if id in self._calls:
            self._end_call(id, error)
            return True
        goal, _ = self._goals.pop(id, (None, None))
        if goal is not None:
            goal.future.set_exception(error)
        return goal is not None

    def _cancel(self, id: Id) -> None:
        if id in self._goals:
            try:
                self._send(CancelActionGoal(id=id, action=self._goals[id][0].action))
            except BridgeError as error:
                _log.debug("a goal could not be canceled: %s", error)  # the goal fails with the connection

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
        raise MessageValidationError(f"the response of {name}", cause=str(error)) from None
    if succeeded:
        return values
    cause = values if isinstance(values, str) else str(values or "no reason given")
    if cause.startswith((f"Service {name} does not exist", f"Action {name} does not exist")):
        raise ServiceNotFoundError(name)
    raise ServiceCallError(name, cause=cause)


def _decode_values(raw: msgspec.Raw | msgspec.UnsetType) -> Any:
    return msgspec.json.decode(content(raw))


def _decode_arguments(name: str, raw: msgspec.Raw | msgspec.UnsetType) -> Any:
    """The arguments of a call or goal.

    Raises:
        MessageValidationError: they have a number that no float can hold.
    """
    try:
        return _decode_values(raw)
    except msgspec.DecodeError as error:
        path = non_finite_path(bytes(content(raw)).decode())
        raise MessageValidationError(f"the arguments of {name}", path=path, cause=str(error)) from None


ServiceHandler = Callable[[Any], object]
"""Called with the arguments as they were sent (an object, or a list of its fields); returns the response as values that
JSON can represent, structs included, or a future of them, during which it occupies no thread. May be a coroutine
function. Its exception becomes a response with `result: false`.
"""

BatchHandler = Callable[[list[Any]], list[object]]
"""Called with the arguments of several calls; returns the values or the exception of each."""

ActionHandler = Callable[[ServerGoalHandle], object]
"""Called with the goal; returns a `GoalResult`, or the values of the result if the goal succeeded. May be a coroutine
function.
"""


class HandlerDispatcher:
    """Runs the service and action handlers of one node. Belongs to the loop."""

    def __init__(self, loop: EventLoopThread, executor: KeyedSerialExecutor, send: Callable[[Operation], None]) -> None:
        """Creates the dispatcher without handlers.

        Args:
            executor: runs handlers that are plain functions.
            send: sends responses; called on the loop.
        """
        self.services: dict[str, ServiceHandler] = {}
        self.policies: dict[tuple[EntryKind, str], Policy | None] = {}
        """The limits of services, actions and topics by their names; None for those of an edit."""
        self.quick: set[str] = set()
        """Services whose handlers never block: they run on the loop, unless an earlier call of the caller waits."""
        self.batches: dict[str, Callable[[list[tuple[Hashable, CallService]]], None]] = {}
        """Services whose consecutive calls are handled together: runs waiting calls of one caller."""
        self._unanswered: dict[Hashable, int] = {}
        """The number of calls of each caller whose responses are still to be sent; others wait behind them."""
        self.actions: dict[str, ActionHandler] = {}
        self._loop = loop
        self._executor = executor
        self._send = send
        self.queued: dict[int, CallService] = {}
        """The calls that have not begun, by identity; a call that is popped is never carried out (from any thread)."""
        self._futures: dict[int, Future[object]] = {}
        """What the handlers of calls have returned, by the identity of the call, until it has ended."""
        self._goals: dict[Id, ServerGoalHandle] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._next_id = count(1)

    def answer(self, name: str, call: CallService, caller: Hashable) -> ServiceResponse | None:
        """Calls the handler of a quick service now and returns its response; None if it has to wait, or is another."""
        if name not in self.quick or caller in self._unanswered:
            return None
        if (refusal := self.refusal(EntryKind.SERVICE, name, call.args, caller)) is not None:
            return _call_error_response(call, refusal)
        return _call_handler(self.services[name], call)

    def refusal(
        self, kind: EntryKind, name: str, raw: msgspec.Raw | msgspec.UnsetType, caller: object
    ) -> RequestLimitError | None:
        """Counts a request, and returns why it is beyond the limits of its policy; None if it is not."""
        try:
            policy, visitor = self.policies.get((kind, name)) or EDIT, getattr(caller, "visitor", None)
            policy.admit(name, len(bytes(content(raw))), visitor, time.monotonic())
        except RequestLimitError as error:
            return error
        return None

    def call(self, name: str, call: CallService, caller: Hashable) -> None:
        """Calls the handler of a service and sends the response."""
        handler = self.services.get(name)
        if handler is None:
            self._send(_call_error_response(call, ServiceNotFoundError(call.service)))
        elif (response := self.answer(name, call, caller)) is not None:
            self._send(response)
        elif (refusal := self.refusal(EntryKind.SERVICE, name, call.args, caller)) is not None:
            self._send(_call_error_response(call, refusal))
        elif iscoroutinefunction(handler):
            self.start_task(self._handle_call_async(handler, call))
        else:
            self.queued[id(call)] = call
            self._unanswered[caller] = self._unanswered.get(caller, 0) + 1
            if batch := self.batches.get(name):
                self._executor.submit_to_batch(caller, batch, (caller, call))
            else:
                self._executor.submit(caller, partial(self._handle_call, handler, caller, call))

    def start_goal(self, name: str, request: SendActionGoal, caller: object = None) -> None:
        """Starts the handler of an action; goals run concurrently."""
        handler = self.actions.get(name)
        id = f"goal:{next(self._next_id)}" if request.id is None else request.id
        cause = ""
        if id in self._goals:
            cause = f"the goal {id!r} is active already"
        elif len(self._goals) >= NODE_GOALS.count:
            cause = f"{NODE_GOALS.count} goals are active already; wait until one has ended, or cancel one"
        elif (refusal := self.refusal(EntryKind.ACTION, name, request.args, caller)) is not None:
            cause = str(refusal)
        if handler is None or cause:
            error = BridgeError(cause or f"Action {request.action} does not exist")
            self._send(_goal_error_result(request, id, error))
            return
        goal = self._goals[id] = ServerGoalHandle(request.action, id, None, self._feedback_sender(request))
        if iscoroutinefunction(handler):
            self.start_task(self._run_goal_async(handler, request, goal))
        else:
            args = (handler, request, goal)
            threading.Thread(target=self._run_goal, args=args, name="mindstage-goal", daemon=True).start()

    def cancel(self, request: CancelActionGoal) -> None:
        """Requests cancellation of a goal; does nothing if it has ended."""
        if goal := self._goals.get(request.id):
            goal.request_cancel()

    def cancel_all(self) -> None:
        """Requests cancellation of all goals, since their clients have disconnected."""
        for goal in self._goals.values():
            goal.request_cancel()

    def start_task(self, coroutine: Coroutine[Any, Any, None]) -> None:
        """Runs a coroutine, which must not raise, as a task."""
        task = asyncio.ensure_future(coroutine)
        self._tasks.add(task)  # the loop has weak references only
        task.add_done_callback(self._tasks.discard)

    # -- services ------------------------------------------------------------------------------------------------------

    def _handle_call(self, handler: ServiceHandler, caller: Hashable, call: CallService) -> None:
        if self.queued.pop(id(call), None) is None:  # it was withdrawn
            self._loop.call_soon(self._end_call, caller, None)
            return
        with handling_for(caller):
            result = _call(handler, call)
        if isinstance(result, Future):
            self._futures[id(call)] = result
            result.add_done_callback(lambda done: self._end_future(done, caller, call))
        else:
            self._loop.call_soon(self._end_call, caller, _response(call, result))

    def withdraw(self, call: CallService) -> bool:
        """Withdraws a call, unless it has begun; returns whether it is never carried out."""
        if self.queued.pop(id(call), None) is not None:
            return True
        future = self._futures.get(id(call))
        return future is not None and future.cancel()

    def _end_future(self, done: Future[object], caller: Hashable, call: CallService) -> None:
        self._futures.pop(id(call), None)
        if done.cancelled():
            self._loop.call_soon(self._end_call, caller, None)
            return
        try:
            result = done.result()
        except Exception as error:
            result = error
        self._loop.call_soon(self._end_call, caller, _response(call, result))

    def _end_call(self, caller: Hashable, response: ServiceResponse | None) -> None:
        """Sends the response to a call, unless it was withdrawn."""
        if self._unanswered[caller] > 1:
            self._unanswered[caller] -= 1
        else:
            del self._unanswered[caller]
        if response is not None:
            self._send(response)

    def handle_batch(self, handler: BatchHandler, items: list[tuple[Hashable, CallService]]) -> None:
        """Handles consecutive calls of one caller, each with the caller, and sends the responses in their order."""
        begun = [call for _, call in items if self.queued.pop(id(call), None) is not None]
        results, arguments = dict[int, object](), dict[int, Any]()
        for call in begun:
            try:
                arguments[id(call)] = _decode_arguments(call.service, call.args)
            except MessageValidationError as error:
                results[id(call)] = error
        try:
            if arguments:
                results |= zip(arguments, handler(list(arguments.values())), strict=True)
        except Exception as error:
            results |= dict.fromkeys(arguments, error)
        responses = {id(call): _response(call, results[id(call)]) for call in begun}
        for caller, call in items:
            self._loop.call_soon(self._end_call, caller, responses.get(id(call)))

    async def _handle_call_async(self, handler: ServiceHandler, call: CallService) -> None:
        try:
            result = await _await_if_needed(handler(_decode_arguments(call.service, call.args)))
        except Exception as error:
            result = error
        self._send(_response(call, result))

    # -- actions -------------------------------------------------------------------------------------------------------

    def _feedback_sender(self, request: SendActionGoal) -> Callable[[Id, object], None]:
        def feedback(id: Id, values: object) -> None:
            message = ActionFeedback(id=id, action=request.action, values=encode_values(values))
            self._loop.call_soon(self._send_feedback, message)

        return feedback

    def _send_feedback(self, feedback: ActionFeedback) -> None:
        if feedback.id in self._goals:  # no feedback after the result
            self._send(feedback)

    def _run_goal(self, handler: ActionHandler, request: SendActionGoal, goal: ServerGoalHandle) -> None:
        try:
            goal.args = _decode_arguments(request.action, request.args)
            result = _goal_result(request, goal.id, handler(goal))
        except Exception as error:
            result = _goal_error_result(request, goal.id, error)
        self._loop.call_soon(self._send_result, result)

    async def _run_goal_async(self, handler: ActionHandler, request: SendActionGoal, goal: ServerGoalHandle) -> None:
        try:
            goal.args = _decode_arguments(request.action, request.args)
            result = _goal_result(request, goal.id, await _await_if_needed(handler(goal)))
        except Exception as error:
            result = _goal_error_result(request, goal.id, error)
        self._send_result(result)

    def _send_result(self, result: ActionResult) -> None:
        if result.id is not None:
            self._goals.pop(result.id, None)
        self._send(result)


async def _await_if_needed(result: object) -> object:
    return await result if isinstance(result, Awaitable) else result


def encode_values(values: object) -> msgspec.Raw:
    """Returns values as JSON; none are an empty object."""
    return msgspec.Raw(b"{}" if values is None else encode_json(values))


def _call_handler(handler: ServiceHandler, call: CallService) -> ServiceResponse:
    """Calls a handler that is a plain function, and returns at once."""
    return _response(call, _call(handler, call))


def _call(handler: ServiceHandler, call: CallService) -> object:
    """The result of a handler that is a plain function, or its exception."""
    try:
        return handler(_decode_arguments(call.service, call.args))
    except Exception as error:
        return error


def _response(call: CallService, result: object) -> ServiceResponse:
    """Returns the response with the values or the exception of a call."""
    if not isinstance(result, Exception):
        try:
            return ServiceResponse(id=call.id, service=call.service, values=encode_values(result), result=True)
        except Exception as error:
            result = error
    return _call_error_response(call, result)


def _error_reply(name: str, error: Exception) -> str:
    if isinstance(error, FailureResponseError):  # its text was made for the client
        return str(error)
    if isinstance(error, MindstageError):
        return without_paths(str(error))
    _log.error("the handler of %s failed", name, exc_info=error)
    return without_paths(f"{name} failed: {type(error).__name__}: {error}")


def _error_values(name: str, error: Exception) -> tuple[msgspec.Raw, str | None]:
    """The values of a failed call or goal and the reason: the failure of its type with a reason, or the text alone."""
    text = _error_reply(name, error)
    if isinstance(error, FailureResponseError):
        return encode_values(error.response), text
    return encode_values(text), None


def _call_error_response(call: CallService, error: Exception) -> ServiceResponse:
    values, reason = _error_values(call.service, error)
    return ServiceResponse(id=call.id, service=call.service, values=values, result=False, reason=reason)


def _goal_error_result(request: SendActionGoal, id: Id, error: Exception) -> ActionResult:
    values, reason = _error_values(request.action, error)
    status = GoalStatus.ABORTED
    return ActionResult(id=id, action=request.action, values=values, status=status, result=False, reason=reason)


def _goal_result(request: SendActionGoal, id: Id, outcome: object) -> ActionResult:
    if not isinstance(outcome, GoalResult):
        outcome = GoalResult(GoalStatus.SUCCEEDED, outcome)
    values = encode_values(outcome.values)
    return ActionResult(id=id, action=request.action, values=values, status=outcome.status, result=True)
