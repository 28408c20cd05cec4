"""Nodes: call and provide services, publish and subscribe to topics, send and execute goals of actions.

`LocalNode` has the broker in its own process, `RosbridgeClient` is connected to a rosbridge server; both are a `Node`
with the same methods, which can be called from any thread.

Plain functions as handlers run in worker threads, the calls of one caller in their order; coroutine functions run
on the event loop. Each goal has a thread of its own, since it may take hours. An exception of a handler becomes an
error response. Every call and every goal ends: with a response, an error, a timeout, or the loss of the connection.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import defaultdict
from collections.abc import Awaitable, Callable, Coroutine, Hashable, Iterator
from concurrent.futures import Future
from functools import partial
from inspect import iscoroutinefunction
from itertools import count
from typing import Any, Protocol, TypeVar

import msgspec

from mindstage.bridge.broker import PLAIN_FORMAT, Broker, GraphInfo, Peer, ReplyFormat, resolve_name, same_type
from mindstage.bridge.event_loop import EventLoopThread, KeyedSerialExecutor
from mindstage.bridge.protocol import (
    DEFAULT_LIMITS,
    ActionFeedback,
    ActionResult,
    Advertise,
    AdvertiseAction,
    AdvertiseService,
    BridgeLimits,
    CallService,
    CancelActionGoal,
    Compression,
    GoalStatus,
    Id,
    MessageEncoder,
    Operation,
    Publish,
    SendActionGoal,
    ServiceResponse,
    Status,
    Subscribe,
    Unadvertise,
    UnadvertiseAction,
    UnadvertiseService,
    Unsubscribe,
    content,
)
from mindstage.errors import (
    AdvertiseError,
    BridgeError,
    ConnectionLostError,
    FailureResponseError,
    MessageValidationError,
    MindstageError,
    ServiceCallError,
    ServiceNotFoundError,
    ServiceTimeoutError,
)
from mindstage.msgs import RosVersion

__all__ = [
    "MAX_GOALS",
    "ActionHandler",
    "CallbackTask",
    "ClientGoalHandle",
    "FeedbackHandler",
    "GoalResult",
    "HandlerDispatcher",
    "LocalNode",
    "MessageHandler",
    "MessageSender",
    "Node",
    "PendingCalls",
    "ServerGoalHandle",
    "ServiceHandler",
    "Subscription",
]

_TIMEOUT_MARGIN_S = 1.0
"""Added to the timeout that is sent to the provider, so that the timeout on this side ends first [s]."""
_log = logging.getLogger("mindstage.bridge")
MAX_GOALS = 32
"""Largest number of active goals at one node; more are rejected."""
_MAX_UNSENT = 256
"""Largest number of published messages that wait for the loop; beyond it, `publish` blocks."""
_MAX_UNHANDLED = 1024
"""Largest number of messages that wait for a slow handler; beyond it, the oldest are dropped."""
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

    def wait(self, timeout_s: float = 10.0) -> GoalResult:
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

    @property
    def cancel_requested(self) -> bool:
        """Whether cancellation was requested, or the client has disconnected."""
        return self._cancelled.is_set()

    def wait_for_cancel(self, timeout_s: float) -> bool:
        """Sleeps, at most until cancellation is requested; returns whether it was."""
        return self._cancelled.wait(timeout_s)

    def feedback(self, values: object) -> None:
        """Sends feedback, from any thread."""
        self._feedback(self.id, values)

    def request_cancel(self) -> None:
        """Sets `cancel_requested`."""
        self._cancelled.set()

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
            self._send(CallService(id=id, service=service, args=args, timeout=timeout_s + _TIMEOUT_MARGIN_S))
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


ServiceHandler = Callable[[Any], object]
"""Called with the arguments as they were sent (an object, or a list of its fields); returns the response as values that
JSON can represent, structs included. May be a coroutine function. Its exception becomes a response with `result:
false`.
"""

ActionHandler = Callable[[ServerGoalHandle], object]
"""Called with the goal; returns a `GoalResult`, or the values of the result if the goal succeeded. May be a coroutine
function.
"""


class HandlerDispatcher:
    """Runs the service and action handlers of one node. Belongs to the loop."""

    def __init__(self, loop: EventLoopThread, executor: KeyedSerialExecutor, send: Callable[[Operation], None]) -> None:
        """Creates the dispatcher without handlers.

        Args:
            loop: the loop.
            executor: runs handlers that are plain functions.
            send: sends responses; called on the loop.
        """
        self.services: dict[str, ServiceHandler] = {}
        self.quick: set[str] = set()
        """Services whose handlers never block: they run on the loop, unless an earlier call of the caller waits."""
        self.actions: dict[str, ActionHandler] = {}
        self._loop = loop
        self._executor = executor
        self._send = send
        self.queued: dict[int, CallService] = {}
        """The calls that have not begun, by identity; a call that is popped is never carried out (from any thread)."""
        self._goals: dict[Id, ServerGoalHandle] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._next_id = count(1)

    def answer(self, name: str, call: CallService, caller: Hashable) -> ServiceResponse | None:
        """Calls the handler of a quick service now and returns its response; None if it has to wait, or is another."""
        if name not in self.quick or self._executor.is_busy(caller):
            return None
        return _response(self.services[name], call)

    def call(self, name: str, call: CallService, caller: Hashable) -> None:
        """Calls the handler of a service and sends the response."""
        handler = self.services.get(name)
        if handler is None:
            self._send(_call_error_response(call, ServiceNotFoundError(call.service)))
        elif iscoroutinefunction(handler):
            self.start_task(self._handle_call_async(handler, call))
        elif (response := self.answer(name, call, caller)) is not None:
            self._send(response)
        else:
            self.queued[id(call)] = call
            self._executor.submit(caller, partial(self._handle_call, handler, call))

    def start_goal(self, name: str, request: SendActionGoal) -> None:
        """Starts the handler of an action; goals run concurrently."""
        handler = self.actions.get(name)
        id = f"goal:{next(self._next_id)}" if request.id is None else request.id
        cause = ""
        if id in self._goals:
            cause = f"the goal {id!r} is active already"
        elif len(self._goals) >= MAX_GOALS:
            cause = f"{MAX_GOALS} goals are active already; wait until one has ended, or cancel one"
        if handler is None or cause:
            self._send(_goal_error_result(request, id, cause or f"Action {request.action} does not exist"))
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

    def _handle_call(self, handler: ServiceHandler, call: CallService) -> None:
        if self.queued.pop(id(call), None) is not None:  # else it was withdrawn
            self._loop.call_soon(self._send, _response(handler, call))

    async def _handle_call_async(self, handler: ServiceHandler, call: CallService) -> None:
        try:
            values = _encode_values(await _await_if_needed(handler(_decode_values(call.args))))
            response = ServiceResponse(id=call.id, service=call.service, values=values, result=True)
        except Exception as error:
            response = _call_error_response(call, error)
        self._send(response)

    # -- actions -------------------------------------------------------------------------------------------------------

    def _feedback_sender(self, request: SendActionGoal) -> Callable[[Id, object], None]:
        def feedback(id: Id, values: object) -> None:
            message = ActionFeedback(id=id, action=request.action, values=_encode_values(values))
            self._loop.call_soon(self._send_feedback, message)

        return feedback

    def _send_feedback(self, feedback: ActionFeedback) -> None:
        if feedback.id in self._goals:  # no feedback after the result
            self._send(feedback)

    def _run_goal(self, handler: ActionHandler, request: SendActionGoal, goal: ServerGoalHandle) -> None:
        try:
            goal.args = _decode_values(request.args)
            result = _goal_result(request, goal.id, handler(goal))
        except Exception as error:
            result = _goal_error_result(request, goal.id, _error_reply(request.action, error))
        self._loop.call_soon(self._send_result, result)

    async def _run_goal_async(self, handler: ActionHandler, request: SendActionGoal, goal: ServerGoalHandle) -> None:
        try:
            goal.args = _decode_values(request.args)
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


def _encode_values(values: object) -> msgspec.Raw:
    return msgspec.Raw(b"{}" if values is None else msgspec.json.encode(values))


def _response(handler: ServiceHandler, call: CallService) -> ServiceResponse:
    """Calls a handler that is a plain function."""
    try:
        values = _encode_values(handler(_decode_values(call.args)))
        return ServiceResponse(id=call.id, service=call.service, values=values, result=True)
    except Exception as error:
        return _call_error_response(call, error)


def _error_reply(name: str, error: Exception) -> str:
    if isinstance(error, MindstageError):
        return str(error)
    _log.error("the handler of %s failed", name, exc_info=error)
    return f"{name} failed: {type(error).__name__}: {error}"


def _call_error_response(call: CallService, error: Exception) -> ServiceResponse:
    text = _error_reply(call.service, error)
    if isinstance(error, FailureResponseError):
        values, reason = _encode_values(error.response), text
    else:
        values, reason = _encode_values(text), None
    return ServiceResponse(id=call.id, service=call.service, values=values, result=False, reason=reason)


def _goal_error_result(request: SendActionGoal, id: Id, reason: str) -> ActionResult:
    return ActionResult(
        id=id, action=request.action, values=_encode_values(reason), status=GoalStatus.ABORTED, result=False
    )


def _goal_result(request: SendActionGoal, id: Id, outcome: object) -> ActionResult:
    if not isinstance(outcome, GoalResult):
        outcome = GoalResult(GoalStatus.SUCCEEDED, outcome)
    values = _encode_values(outcome.values)
    return ActionResult(id=id, action=request.action, values=values, status=outcome.status, result=True)


MessageHandler = Callable[..., object]
"""Called with a message as plain values, in a worker thread and in the order of the messages; or a coroutine function,
which runs on the loop. With `with_sender`, it is also called with the `MessageSender`, or None if it is unknown.
"""


class MessageSender(Protocol):
    """Publisher of a message, at a broker in this process."""

    has_left: bool
    """Whether it has disconnected since."""

    def __hash__(self) -> int: ...


class Subscription:
    """A subscription to a topic, until `close`."""

    def __init__(
        self, request: Subscribe, handler: MessageHandler, close: Callable[[Subscription], None], *, with_sender: bool
    ) -> None:
        self.request = request
        self.handler = handler
        self.is_async = iscoroutinefunction(handler)
        self.with_sender = with_sender
        self._close = close

    @property
    def topic(self) -> str:
        """Name of the topic."""
        return self.request.topic

    def close(self) -> None:
        """Ends the subscription; calling it again is harmless. A running handler is not interrupted."""
        self._close(self)


class CallbackTask:
    """A message and the handler that it is for; the message is decoded when the handler is called."""

    def __init__(self, subscription: Subscription, message: Publish, sender: MessageSender | None) -> None:
        self._subscription = subscription
        self._message = message
        self._sender = sender

    def __call__(self) -> None:
        """Calls the handler; an exception is logged."""
        try:
            self._handle()
        except Exception:
            self._log_error()

    async def run(self) -> None:
        """Calls a handler that is a coroutine function."""
        try:
            await self._handle()
        except Exception:
            self._log_error()

    def _handle(self) -> Any:
        values = msgspec.json.decode(self._message.msg)
        senders = (self._sender,) if self._subscription.with_sender else ()
        return self._subscription.handler(values, *senders)

    def _log_error(self) -> None:
        _log.exception("the handler of messages on %s failed", self._message.topic)


class Node:
    """Base class of nodes; subclasses define how an operation is sent."""

    def __init__(self, *, name: str) -> None:
        self._loop = EventLoopThread(name)
        self._executor = KeyedSerialExecutor(name=f"{name}-worker")
        self._dispatcher = HandlerDispatcher(self._loop, self._executor, self._send_if_possible)
        self._pending_calls = PendingCalls(self._loop, self._send)
        self._advertisements: dict[Hashable, Operation] = {}
        """Operations that are sent again after a reconnection, in order: advertisements and subscriptions."""
        self._subscriptions: defaultdict[str, list[Subscription]] = defaultdict(list)
        self._next_id = count(1)
        self._backlog = threading.BoundedSemaphore(_MAX_UNSENT)

    # -- services ------------------------------------------------------------------------------------------------------

    def create_service(self, name: str, type: str, handler: ServiceHandler, *, quick: bool = False) -> None:
        """Provides a service; if it exists, its handler is replaced.

        Args:
            name: such as `/unreal/spawn_model`.
            type: such as `world_control_msgs/SpawnModel`.
            handler: called with the arguments, returns the values of the response; an exception becomes `result:
                false`. A plain function runs in a worker thread, the calls of one caller in their order; a coroutine
                function runs on the bridge's loop and must not block.
            quick: whether a plain function never blocks, so that it can also run on the loop.

        Raises:
            AdvertiseError: the name is taken.
        """

        def add() -> None:
            self._advertise(("service", resolve_name(name)), AdvertiseService(service=name, type=type))
            self._dispatcher.services[resolve_name(name)] = handler
            (self._dispatcher.quick.add if quick else self._dispatcher.quick.discard)(resolve_name(name))

        self._loop.call(add)

    def destroy_service(self, name: str) -> None:
        """Withdraws a service; running calls are answered."""

        def remove() -> None:
            self._dispatcher.services.pop(resolve_name(name), None)
            self._unadvertise(("service", resolve_name(name)), UnadvertiseService(service=name))

        self._loop.call(remove)

    def call_service(self, name: str, args: object = None, *, timeout_s: float = 10.0) -> Any:
        """Calls a service and waits for the response.

        Args:
            name: name of the service.
            args: values that JSON can represent: an object, a struct, or a list of the fields in order.
            timeout_s: timeout [s].

        Returns:
            The values of the response, whose meaning depends on the type of the service.

        Raises:
            ServiceNotFoundError: the service is not advertised.
            ServiceTimeoutError: there was no response in time; the service may or may not have been executed.
            ServiceCallError: the response is an error.
            ConnectionLostError: there is no connection, or it was lost.
        """
        self._require_other_thread("call_service")
        return self.call_service_async(name, args, timeout_s=timeout_s).result(timeout_s + 10.0)

    def call_service_async(self, name: str, args: object = None, *, timeout_s: float = 10.0) -> Future[Any]:
        """Calls a service without waiting; the future receives the result or the exception of `call_service`.

        In a coroutine, await it with `asyncio.wrap_future`.
        """
        encoded = _encode_values(args)
        future: Future[Any] = Future()
        self._loop.call(self._pending_calls.call_service, name, encoded, timeout_s, future)
        return future

    # -- actions -------------------------------------------------------------------------------------------------------

    def create_action_server(self, name: str, type: str, handler: ActionHandler) -> None:
        """Provides an action; its goals run concurrently.

        Args:
            name: such as `/unreal/simulate_steps`.
            type: such as `simulation_interfaces/SimulateSteps`.
            handler: called with the `ServerGoalHandle`; sends progress by `goal.feedback`, checks
                `goal.cancel_requested` regularly, and returns the values of the result or a `GoalResult`.

        Raises:
            AdvertiseError: the name is taken.
        """

        def add() -> None:
            self._advertise(("action", resolve_name(name)), AdvertiseAction(action=name, type=type))
            self._dispatcher.actions[resolve_name(name)] = handler

        self._loop.call(add)

    def destroy_action_server(self, name: str) -> None:
        """Withdraws an action; active goals continue."""

        def remove() -> None:
            self._dispatcher.actions.pop(resolve_name(name), None)
            self._unadvertise(("action", resolve_name(name)), UnadvertiseAction(action=name))

        self._loop.call(remove)

    def send_goal(
        self, action: str, type: str, args: object = None, *, on_feedback: FeedbackHandler | None = None
    ) -> ClientGoalHandle:
        """Sends a goal; wait for the result with `ClientGoalHandle.wait`, cancel with `ClientGoalHandle.cancel`.

        Args:
            action: name of the action.
            type: type of the action.
            args: the goal.
            on_feedback: called with feedback, on the bridge's thread.
        """
        return self._loop.call(self._pending_calls.send_goal, action, type, _encode_values(args), on_feedback)

    # -- topics --------------------------------------------------------------------------------------------------------

    def advertise(self, topic: str, type: str, *, latch: bool = False) -> None:
        """Announces messages on a topic.

        Args:
            topic: name of the topic.
            type: type of all its messages.
            latch: whether later subscribers receive the last message.

        Raises:
            AdvertiseError: the topic has another type.
        """
        request = Advertise(topic=topic, type=type, latch=latch)
        self._loop.call(self._advertise, ("topic", resolve_name(topic)), request)

    def unadvertise(self, topic: str) -> None:
        """Ends the announcement of a topic."""
        self._loop.call(self._unadvertise, ("topic", resolve_name(topic)), Unadvertise(topic=topic))

    def publish(self, topic: str, type: str, message: object) -> None:
        """Publishes a message, and advertises the topic first if necessary.

        The message is encoded in the thread of the caller; the call then returns at once, unless the loop is far
        behind. Without a connection the message is dropped, as one without subscribers.

        Args:
            topic: name of the topic.
            type: type of the message.
            message: values that JSON can represent, structs included.

        Raises:
            AdvertiseError: the topic has another type.
            BridgeError: the loop is stuck or closed.
        """
        self._advertise_once(topic, type)
        operation = Publish(topic=topic, msg=_encode_values(message))
        if self._loop.is_current_thread():
            self._send_if_possible(operation)
            return
        if self._loop.closed or not self._backlog.acquire(timeout=10.0):
            raise BridgeError("cannot publish: the bridge is closed or stuck")

        def publish() -> None:
            self._backlog.release()
            self._send_if_possible(operation)

        self._loop.call_soon(publish)

    def subscribe(
        self,
        topic: str,
        handler: MessageHandler,
        *,
        type: str | None = None,
        throttle_ms: int = 0,
        queue_length: int = 0,
        compression: Compression = Compression.NONE,
        with_sender: bool = False,
    ) -> Subscription:
        """Subscribes to a topic.

        Args:
            topic: name of the topic, which need not have a publisher yet.
            handler: called with each message, in order; if it is slower than the messages, the oldest are dropped.
            type: expected type; at another server, a topic of another type is rejected with a status message.
            throttle_ms: least time between two messages [ms]; an integer, as rosbridge requires.
            queue_length: number of messages that the sender keeps while it throttles; it drops the oldest.
            compression: encoding of the messages.
            with_sender: whether the handler is also called with the `MessageSender`.

        Raises:
            MessageValidationError: the topic has another type, at a broker in this process.
        """
        request = Subscribe(
            id=f"subscribe:{topic}:{next(self._next_id)}",
            topic=topic,
            type=type,
            throttle_rate=throttle_ms,
            queue_length=queue_length,
            compression=compression,
        )
        subscription = Subscription(
            request,
            handler,
            lambda subscription: self._loop.call(self._unsubscribe, subscription),
            with_sender=with_sender,
        )

        def subscribe() -> None:
            handlers = self._subscriptions[resolve_name(topic)]
            handlers.append(subscription)  # before subscribing, since latched messages are sent at once
            try:
                self._advertise(request.id, request)
            except BridgeError:
                handlers.remove(subscription)
                raise

        self._loop.call(subscribe)
        return subscription

    def has_subscribers(self, topic: str) -> bool:
        """Whether a message might be received; does not block."""
        raise NotImplementedError

    # -- overridden by subclasses --------------------------------------------------------------------------------------

    def _send(self, operation: Operation) -> None:
        """Sends an operation; called on the loop.

        Raises:
            ConnectionLostError: there is no connection.
        """
        raise NotImplementedError

    def _send_if_possible(self, operation: Operation) -> None:
        try:
            self._send(operation)
        except ConnectionLostError as error:
            _log.debug("not sent: %s", error)

    def _on_status(self, status: Status) -> None:
        """Handles a status message about an operation that was sent."""
        _log.log(logging.WARNING if status.level.value == "error" else logging.INFO, "status message: %s", status.msg)

    def _advertise_once(self, topic: str, type: str) -> None:
        known = self._advertisements.get(("topic", resolve_name(topic)))
        if not isinstance(known, Advertise):
            self.advertise(topic, type)
        elif not same_type(known.type, type):
            raise AdvertiseError(topic, cause=f"its type is {known.type}, not {type}")

    # -- on the loop ---------------------------------------------------------------------------------------------------

    def _receive(self, operation: Operation, sender: MessageSender | None = None) -> None:
        """Handles a received operation; `sender` is the client from which it comes, if that is known."""
        match operation:
            case Publish():
                self._handle_message(operation, sender)
            case CallService():
                self._dispatcher.call(resolve_name(operation.service), operation, sender)
            case ServiceResponse():
                self._pending_calls.on_response(operation)
            case SendActionGoal():
                self._dispatcher.start_goal(resolve_name(operation.action), operation)
            case CancelActionGoal():
                self._dispatcher.cancel(operation)
            case ActionFeedback():
                self._pending_calls.on_feedback(operation)
            case ActionResult():
                self._pending_calls.on_result(operation)
            case Status():
                self._on_status(operation)
            case _:
                _log.debug("%s is not valid here", type(operation).__name__)

    def _advertise_operations(self) -> Iterator[Operation]:
        yield from self._advertisements.values()

    def _advertise(self, key: Hashable, operation: Operation) -> None:
        self._send_if_possible(operation)
        self._advertisements[key] = operation

    def _unadvertise(self, key: Hashable, operation: Operation) -> None:
        if self._advertisements.pop(key, None) is not None:
            self._send_if_possible(operation)

    def _unsubscribe(self, subscription: Subscription) -> None:
        request = subscription.request
        handlers = self._subscriptions[resolve_name(request.topic)]
        if subscription in handlers:
            handlers.remove(subscription)
            self._unadvertise(request.id, Unsubscribe(id=request.id, topic=request.topic))

    def _handle_message(self, message: Publish, sender: MessageSender | None) -> None:
        for subscription in self._subscriptions[resolve_name(message.topic)]:
            task = CallbackTask(subscription, message, sender)
            if subscription.is_async:
                self._dispatcher.start_task(task.run())
            else:
                self._executor.submit(subscription, task, max_waiting=_MAX_UNHANDLED)

    def _require_other_thread(self, method: str) -> None:
        if self._loop.is_current_thread():
            raise BridgeError(
                f"{method} would block the bridge's own thread; there, use call_service_async and await the result"
            )

    def _close(self, error: BridgeError) -> None:
        """Fails everything that is pending, and ends the threads."""
        if not self._loop.closed:
            self._loop.call(self._pending_calls.fail_all, error)
            self._loop.call(self._dispatcher.cancel_all)
        self._executor.close()
        self._loop.close()


class _LocalPeer(Peer):
    """The local node as a peer of its broker."""

    is_local = True

    def __init__(self, name: str, node: LocalNode) -> None:
        super().__init__(name)
        self._node = node

    @property
    def congested(self) -> bool:
        return False

    def deliver(
        self, outgoing: MessageEncoder, reply_format: ReplyFormat = PLAIN_FORMAT, *, sender: Peer | None = None
    ) -> None:
        self._node._receive(outgoing.operation, sender)

    def answer(self, call: CallService, caller: Peer) -> ServiceResponse | None:
        return self._node._dispatcher.answer(resolve_name(call.service), call, caller)

    def withdraw(self, call: CallService) -> bool:
        return self._node._dispatcher.queued.pop(id(call), None) is not None


class LocalNode(Node):
    """A node with a broker in its own process; `RosbridgeServer` connects clients with it.

    The thread of its event loop runs from its creation until `close`.
    """

    def __init__(self, *, limits: BridgeLimits = DEFAULT_LIMITS, name: str = "/mindstage") -> None:
        """Creates a broker without other peers.

        Args:
            limits: limits of each client.
            name: name of this node, as introspection tools show it.
        """
        super().__init__(name="mindstage-node")
        self.limits = limits
        self.broker = Broker(self._loop.loop, limits)
        """The broker; it belongs to the loop."""
        self._local_peer = _LocalPeer(resolve_name(name), self)
        self._loop.call(self.broker.add_peer, self._local_peer)

    @property
    def name(self) -> str:
        """Name of this node in the graph."""
        return self._local_peer.name

    def graph_info(self) -> GraphInfo:
        """Returns the current graph of nodes, services, actions and topics."""
        return self._loop.call(self.broker.graph_info)

    def set_service_timeout(self, service: str, timeout_s: float) -> None:
        """Sets the timeout of a service for calls without one, instead of the limits' `call_timeout_s` [s]."""
        self._loop.call(self.broker.services.timeouts_s.__setitem__, resolve_name(service), timeout_s)

    def set_ros(self, ros: RosVersion, now: Callable[[], float]) -> None:
        """Sets the binary format and the clock [s] of messages to subscribers with the compression `cbor-raw`."""
        self.broker.topics.ros, self.broker.topics.now = ros, now

    def has_subscribers(self, topic: str) -> bool:
        """Whether the topic has subscribers; does not block."""
        return self.broker.topics.has_subscribers(topic)

    @property
    def closed(self) -> bool:
        """Whether the node was closed."""
        return self._loop.closed

    def run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Runs a coroutine on the loop and waits for its result."""
        return self._loop.run(coroutine)

    def close(self) -> None:
        """Closes the node; calling it again is harmless. Close its servers first."""
        self._close(ConnectionLostError("the local node", cause="it was closed"))

    def __enter__(self) -> LocalNode:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _send(self, operation: Operation) -> None:
        self.broker.handle(self._local_peer, operation)
