"""Participant: someone at a hub, who offers and calls services, publishes and subscribes, sends and reaches goals.

`LocalNode` is one for everything in its own process, `Client` is one at somebody else's hub; whoever is written against
`MarkerNode` works with both. Every method may be called from any thread.

Goals: what is asked of an action, from the side that asks and from the side that does it.

Calling: what one participant has asked for and waits to hear of; everything it began ends, in time.

Serving: what one participant offers, and the handlers that answer for it.

A plain function runs in a worker thread, one call at a time for each caller and in the order they came; a coroutine
function runs on the loop, beside others. A goal may take hours and so has a thread of its own, lest calls wait for it.
Whatever a handler raises becomes an answer: nobody waits in vain.

Subscription: one topic's messages on their way to whoever handles them here.

Hub: where clients and this process meet, as rosbridge_server with a ROS master behind it.

Clients advertise services, topics and actions to each other through it. This process takes part by the same words:
the hub itself is a `MarkerNode`, and its offers are answered without leaving the process.
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
    MessageValidationError,
    MindstageError,
    ServiceCallError,
    ServiceNotFoundError,
    ServiceTimeoutError,
)

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


MAX_GOALS = 32
"""So many goals may be under way at one participant, whoever sent them; more are refused."""

ServiceHandler = Callable[[Any], object]
"""Gets the arguments as sent (an object, or a list of its fields) and returns the answer's values: whatever JSON can
say, structs included. May be a coroutine function. What it raises is told to the caller as `result: false`."""

ActionHandler = Callable[[ServerGoalHandle], object]
"""Gets the goal and returns how it ended: a `GoalResult`, or just the values if it was reached. May be a coroutine
function."""


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


MessageHandler = Callable[..., object]
"""Gets a message as plain values, in a worker thread and in order; or is a coroutine function, and runs on the loop.
One that asked for it gets the `MessageSender` too, or None where nobody knows who that is."""


class MessageSender(Protocol):
    """Whoever published a message, at a hub in this process."""

    has_left: bool
    """Whether it has left since."""

    def __hash__(self) -> int: ...


class Subscription:
    """Handles one topic's messages until `close`."""

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
        """Where it listens."""
        return self.request.topic

    def close(self) -> None:
        """Ends it, any number of times; what is being handled is handled to its end."""
        self._close(self)


class CallbackTask:
    """One message for one handler, read where it is handled."""

    def __init__(self, subscription: Subscription, message: Publish, sender: MessageSender | None) -> None:
        self._subscription = subscription
        self._message = message
        self._sender = sender

    def __call__(self) -> None:
        """Handles it, whatever comes of it."""
        try:
            self._handle()
        except Exception:
            self._log_error()

    async def run(self) -> None:
        """The same where the handler is a coroutine function."""
        try:
            await self._handle()
        except Exception:
            self._log_error()

    def _handle(self) -> Any:
        values = msgspec.json.decode(self._message.msg)
        senders = (self._sender,) if self._subscription.with_sender else ()
        return self._subscription.handler(values, *senders)

    def _log_error(self) -> None:
        _log.exception("the handler of messages on %s broke", self._message.topic)


_MAX_UNSENT = 256
"""So many published messages may wait for the loop; whoever publishes faster than that waits as well."""
_MAX_UNHANDLED = 1024
"""So many messages may wait for a slow handler; beyond, the oldest are dropped."""


class Node:
    """What a hub and a client have in common; they differ in how an operation leaves."""

    def __init__(self, *, name: str) -> None:
        self._loop = EventLoopThread(name)
        self._executor = KeyedSerialExecutor(name=f"{name}-worker")
        self._dispatcher = HandlerDispatcher(self._loop, self._executor, self._send_if_possible)
        self._pending_calls = PendingCalls(self._loop, self._send)
        self._advertisements: dict[Hashable, Operation] = {}
        """What is said again to a new peer: offers and subscriptions, in the order they were made."""
        self._subscriptions: defaultdict[str, list[Subscription]] = defaultdict(list)
        self._next_id = count(1)
        self._backlog = threading.BoundedSemaphore(_MAX_UNSENT)

    # -- services ------------------------------------------------------------------------------------------------------

    def create_service(self, name: str, type: str, handler: ServiceHandler, *, quick: bool = False) -> None:
        """Answers calls of a service from now on; offering it again changes its handler.

        Args:
            name: such as `/unreal/spawn_model`.
            type: such as `world_control_msgs/SpawnModel`.
            handler: gets the arguments, returns the answer's values; what it raises is told as `result: false`. A
                plain function runs in a worker thread, each caller's calls in their order; a coroutine function runs
                on the bridge's loop and must not block.
            quick: whether a plain function never waits, so that it may run on the loop too when it is its turn.

        Raises:
            AdvertiseError: the name is taken.
        """

        def offer() -> None:
            self._advertise(("service", resolve_name(name)), AdvertiseService(service=name, type=type))
            self._dispatcher.services[resolve_name(name)] = handler
            (self._dispatcher.quick.add if quick else self._dispatcher.quick.discard)(resolve_name(name))

        self._loop.call(offer)

    def destroy_service(self, name: str) -> None:
        """Ends an offer; what is being answered is answered."""

        def withdraw() -> None:
            self._dispatcher.services.pop(resolve_name(name), None)
            self._unadvertise(("service", resolve_name(name)), UnadvertiseService(service=name))

        self._loop.call(withdraw)

    def call_service(self, name: str, args: object = None, *, timeout_s: float = 10.0) -> Any:
        """Calls a service and waits for its answer.

        Args:
            name: which.
            args: whatever JSON can say: an object, a struct, or a list of the fields in order.
            timeout_s: how long to wait [s].

        Returns:
            The answer's values. Whether they tell of a success is between caller and service.

        Raises:
            ServiceNotFoundError: nobody offers it.
            ServiceTimeoutError: it did not answer in time; whether it did it, nobody knows.
            ServiceCallError: the answer is an error.
            ConnectionLostError: there is no connection, or none any more.
        """
        self._require_other_thread("call_service")
        return self.call_service_async(name, args, timeout_s=timeout_s).result(timeout_s + 10.0)

    def call_service_async(self, name: str, args: object = None, *, timeout_s: float = 10.0) -> Future[Any]:
        """Calls a service without waiting: the future gets what `call_service` returns or raises.

        In a coroutine, await it with `asyncio.wrap_future`.
        """
        written = _encode_value(args)
        future: Future[Any] = Future()
        self._loop.call(self._pending_calls.call_service, name, written, timeout_s, future)
        return future

    # -- actions -------------------------------------------------------------------------------------------------------

    def create_action_server(self, name: str, type: str, handler: ActionHandler) -> None:
        """Takes goals of an action from now on; each runs by itself, beside the others.

        Args:
            name: such as `/unreal/simulate_steps`.
            type: such as `simulation_interfaces/SimulateSteps`.
            handler: gets the `ServerGoalHandle`; it tells of its progress by `goal.feedback`, looks at
                `goal.cancel_requested` now and then, and returns the result's values or a `GoalResult`.

        Raises:
            AdvertiseError: the name is taken.
        """

        def offer() -> None:
            self._advertise(("action", resolve_name(name)), AdvertiseAction(action=name, type=type))
            self._dispatcher.actions[resolve_name(name)] = handler

        self._loop.call(offer)

    def destroy_action_server(self, name: str) -> None:
        """Takes no more goals; those under way go on."""

        def withdraw() -> None:
            self._dispatcher.actions.pop(resolve_name(name), None)
            self._unadvertise(("action", resolve_name(name)), UnadvertiseAction(action=name))

        self._loop.call(withdraw)

    def send_goal(
        self, action: str, type: str, args: object = None, *, on_feedback: FeedbackHandler | None = None
    ) -> ClientGoalHandle:
        """Sends a goal; wait for its end with `ClientGoalHandle.wait`, give it up with `ClientGoalHandle.cancel_goal`.

        Args:
            action: which.
            type: of the action.
            args: the goal.
            on_feedback: told how it goes, on the bridge's thread.
        """
        return self._loop.call(self._pending_calls.send_goal, action, type, _encode_value(args), on_feedback)

    # -- topics --------------------------------------------------------------------------------------------------------

    def advertise(self, topic: str, type: str, *, latch: bool = False) -> None:
        """Says that messages of that type will come on a topic.

        Args:
            topic: which.
            type: of all its messages.
            latch: whether those who subscribe later get the last message at once.

        Raises:
            AdvertiseError: the topic is of another type.
        """
        request = Advertise(topic=topic, type=type, latch=latch)
        self._loop.call(self._advertise, ("topic", resolve_name(topic)), request)

    def unadvertise(self, topic: str) -> None:
        """Says that no more messages will come."""
        self._loop.call(self._unadvertise, ("topic", resolve_name(topic)), Unadvertise(topic=topic))

    def publish(self, topic: str, type: str, message: object) -> None:
        """Publishes a message, and advertises the topic first if that was not done.

        It is written as JSON here, in the caller's thread, and then waits for nobody, unless the loop is far behind.
        Without a connection it is dropped, as a message on a topic that nobody listens to.

        Args:
            topic: where.
            type: the message's type.
            message: whatever JSON can say, structs included.

        Raises:
            AdvertiseError: the topic is of another type.
            BridgeError: the loop is stuck or closed.
        """
        self._advertise_once(topic, type)
        operation = Publish(topic=topic, msg=_encode_value(message))
        if self._loop.is_current_thread():
            self._send_if_possible(operation)
            return
        if self._loop.closed or not self._backlog.acquire(timeout=10.0):
            raise BridgeError("nothing can be published: the bridge is closed or stuck")

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
        throttle_ms: float = 0.0,
        queue_length: int = 0,
        compression: Compression = Compression.NONE,
        with_sender: bool = False,
    ) -> Subscription:
        """Handles a topic's messages from now on.

        Args:
            topic: which; nobody needs to publish there yet.
            handler: gets each message, in order; if it is slower than they come, the oldest are dropped.
            type: what the messages should be; at a far hub, a topic of another type is refused with a status.
            throttle_ms: the least time between two messages.
            queue_length: how many messages the sender may keep back while it throttles; it drops the oldest.
            compression: how they travel.
            tells_sender: whether the handler gets the `MessageSender` as well.

        Raises:
            MessageValidationError: here at the hub, the topic is of another type.
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
            request, handler, lambda it: self._loop.call(self._unsubscribe, it), with_sender=with_sender
        )

        def subscribe() -> None:
            handlers = self._subscriptions[resolve_name(topic)]
            handlers.append(subscription)  # first: what is latched comes at once
            try:
                self._advertise(request.id, request)
            except BridgeError:
                handlers.remove(subscription)
                raise

        self._loop.call(subscribe)
        return subscription

    def has_subscribers(self, topic: str) -> bool:
        """Whether anyone may hear a message; asks without waiting."""
        raise NotImplementedError

    # -- what a kind of participant says ---------------------------------------------------------------------------

    def _send(self, operation: Operation) -> None:
        """Has an operation leave. On the loop.

        Raises:
            ConnectionLostError: there is nobody to send it to.
        """
        raise NotImplementedError

    def _send_if_possible(self, operation: Operation) -> None:
        try:
            self._send(operation)
        except ConnectionLostError as error:
            _log.debug("nobody is there to be told: %s", error)

    def _on_status(self, status: Status) -> None:
        """The other side remarks something about what was sent."""
        _log.log(logging.WARNING if status.level.value == "error" else logging.INFO, "the hub says: %s", status.msg)

    def _advertise_once(self, topic: str, type: str) -> None:
        known = self._advertisements.get(("topic", resolve_name(topic)))
        if not isinstance(known, Advertise):
            self.advertise(topic, type)
        elif not same_type(known.type, type):
            raise AdvertiseError(topic, cause=f"it is of the type {known.type}, not {type}")

    # -- on the loop ---------------------------------------------------------------------------------------------------

    def _receive(self, operation: Operation, sender: MessageSender | None = None) -> None:
        """Takes what the other side says; `sender` names the client on whose behalf, where that is known."""
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
                _log.debug("a %s makes no sense here", type(operation).__name__)

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
            handling = CallbackTask(subscription, message, sender)
            if subscription.is_async:
                self._dispatcher.start_task(handling.run())
            else:
                self._executor.submit(subscription, handling, max_waiting=_MAX_UNHANDLED)

    def _require_other_thread(self, what: str) -> None:
        if self._loop.is_current_thread():
            raise BridgeError(
                f"{what} would wait for itself on the bridge's own thread; there, start_call and await the answer"
            )

    def _close(self, error: BridgeError) -> None:
        """Ends everything this participant waits for or works at."""
        if not self._loop.closed:
            self._loop.call(self._pending_calls.fail_all, error)
            self._loop.call(self._dispatcher.cancel_all)
        self._executor.close()
        self._loop.close()


def _encode_value(value: object) -> msgspec.Raw:
    return msgspec.Raw(b"{}" if value is None else msgspec.json.encode(value))


T = TypeVar("T")


class _LocalPeer(Peer):
    """The hub's own process, as a peer at the hub."""

    is_local = True

    def __init__(self, name: str, hub: LocalNode) -> None:
        super().__init__(name)
        self._hub = hub

    @property
    def congested(self) -> bool:
        return False

    def deliver(
        self, outgoing: MessageEncoder, route: ReplyFormat = PLAIN_FORMAT, *, sender: Peer | None = None
    ) -> None:
        self._hub._receive(outgoing.operation, sender)


class LocalNode(Node):
    """Starts its thread when made; `Server` lets clients in, `close` ends it all."""

    def __init__(self, *, limits: BridgeLimits = DEFAULT_LIMITS, name: str = "/mindstage") -> None:
        """A hub that nobody has joined yet.

        Args:
            limits: what each client may ask for.
            name: of this process, as tools that look around show it.
        """
        super().__init__(name="mindstage-hub")
        self.limits = limits
        self.broker = Broker(self._loop.loop, limits)
        """Where clients are plugged in; it belongs to the loop."""
        self._local_peer = _LocalPeer(resolve_name(name), self)
        self._loop.call(self.broker.add_peer, self._local_peer)

    @property
    def name(self) -> str:
        """Of this process, in the directory."""
        return self._local_peer.name

    def graph_info(self) -> GraphInfo:
        """Who and what is here now: what `rosapi` tells."""
        return self._loop.call(self.broker.graph_info)

    def set_service_timeout(self, service: str, timeout_s: float) -> None:
        """Gives a service longer than the limits' `call_timeout_s` where the caller does not say how long it waits."""
        self._loop.call(self.broker.services.timeouts_s.__setitem__, resolve_name(service), timeout_s)

    def has_subscribers(self, topic: str) -> bool:
        """Whether anyone subscribed; asks without waiting, so that making a message may be left out."""
        return self.broker.topics.has_subscribers(topic)

    @property
    def closed(self) -> bool:
        """Whether nothing goes on here any more."""
        return self._loop.closed

    def run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Runs a coroutine on the hub's loop and waits for its end: how a server starts and stops."""
        return self._loop.run(coroutine)

    def close(self) -> None:
        """Ends it, any number of times; close its servers first."""
        self._close(ConnectionLostError("the hub", cause="it was closed"))

    def __enter__(self) -> LocalNode:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _send(self, operation: Operation) -> None:
        self.broker.handle(self._local_peer, operation)
