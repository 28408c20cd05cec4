"""Participant: someone at a hub, who offers and calls services, publishes and subscribes, sends and reaches goals.

`LocalNode` is one for everything in its own process, `Client` is one at somebody else's hub; whoever is written against
`MarkerNode` works with both. Every method may be called from any thread.
"""

from __future__ import annotations

import logging
import threading
from collections import defaultdict
from collections.abc import Hashable, Iterator
from concurrent.futures import Future
from itertools import count
from typing import Any

import msgspec

from mindstage.bridge.calling import FeedbackHandler, PendingCalls
from mindstage.bridge.goals import ClientGoalHandle
from mindstage.bridge.lanes import KeyedSerialExecutor
from mindstage.bridge.loop import EventLoopThread
from mindstage.bridge.names import resolve_name, same_type
from mindstage.bridge.protocol import (
    ActionFeedback,
    ActionResult,
    Advertise,
    AdvertiseAction,
    AdvertiseService,
    CallService,
    CancelActionGoal,
    Compression,
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
)
from mindstage.bridge.serving import ActionHandler, HandlerDispatcher, ServiceHandler
from mindstage.bridge.subscription import CallbackTask, MessageHandler, MessageSender, Subscription
from mindstage.errors import AdvertiseError, BridgeError, ConnectionLostError

__all__ = ["MessageHandler", "Node", "Subscription"]

_MAX_UNSENT = 256
"""So many published messages may wait for the loop; whoever publishes faster than that waits as well."""
_MAX_UNHANDLED = 1024
"""So many messages may wait for a slow handler; beyond, the oldest are dropped."""
_log = logging.getLogger("mindstage.bridge")


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
