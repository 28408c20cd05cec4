"""Nodes: call and provide services, publish and subscribe to topics, send and execute goals of actions.

`LocalNode` has the broker in its own process, `RosbridgeClient` is connected to a rosbridge server; both are a `Node`
with the same methods, which can be called from any thread.

`mindstage.bridge.calls` has their calls and goals.
"""

from __future__ import annotations

import logging
import threading
from collections import defaultdict
from collections.abc import Callable, Coroutine, Hashable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from functools import partial
from inspect import iscoroutinefunction
from itertools import count
from typing import Any, Protocol, TypeVar, cast

import msgspec

from mindstage.access.limits import DEFAULT_BRIDGE_LIMITS, UNHANDLED_MESSAGES, UNSENT_MESSAGES, BridgeLimits, Timeout
from mindstage.access.policies import EntryKind, EntryPoint, Policy
from mindstage.bridge.broker import PLAIN_FORMAT, Broker, GraphInfo, Peer, ReplyFormat, resolve_name, same_type
from mindstage.bridge.calls import (
    ActionHandler,
    BatchHandler,
    ClientGoalHandle,
    FeedbackHandler,
    HandlerDispatcher,
    PendingCalls,
    ServiceHandler,
    encode_values,
)
from mindstage.bridge.event_loop import EventLoopThread, KeyedSerialExecutor
from mindstage.bridge.protocol import (
    ActionFeedback,
    ActionResult,
    Advertise,
    AdvertiseAction,
    AdvertiseService,
    CallService,
    CancelActionGoal,
    Compression,
    MessageEncoder,
    Operation,
    Publish,
    SendActionGoal,
    ServiceResponse,
    Status,
    StatusLevel,
    Subscribe,
    Unadvertise,
    UnadvertiseAction,
    UnadvertiseService,
    Unsubscribe,
)
from mindstage.errors import (
    AdvertiseError,
    BridgeError,
    ConnectionLostError,
)
from mindstage.msgs import RosVersion
from mindstage.ranges import Index, checked

__all__ = [
    "CallbackTask",
    "LocalNode",
    "MessageHandler",
    "MessageSender",
    "Node",
    "Subscription",
]

_log = logging.getLogger("mindstage.bridge")
T = TypeVar("T")

MessageHandler = Callable[..., object]
"""Called with a message as plain values, in a worker thread and in the order of the messages; or a coroutine function,
which runs on the loop. With `with_sender`, it is also called with the `MessageSender`, or None if it is unknown.
"""


class MessageSender(Protocol):
    """Publisher of a message, at a broker in this process."""

    has_left: bool
    """Whether it has disconnected since."""

    def __hash__(self) -> int: ...

    def send_status(self, level: StatusLevel, message: str) -> None:
        """Sends a status message."""


class Subscription:
    """A subscription to a topic, until `close`."""

    def __init__(
        self,
        request: Subscribe,
        handler: MessageHandler,
        close: Callable[[Subscription], None],
        *,
        with_sender: bool,
        usual_type: str | None = None,
    ) -> None:
        self.request = request
        self.handler = handler
        self.is_async = iscoroutinefunction(handler)
        self.with_sender = with_sender
        self.usual_type = usual_type
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
        self._backlog = threading.BoundedSemaphore(UNSENT_MESSAGES.count)

    # -- services ------------------------------------------------------------------------------------------------------

    def create_service(
        self,
        name: str,
        type: str,
        handler: ServiceHandler | BatchHandler,
        *,
        quick: bool = False,
        batched: bool = False,
        policy: Policy | None = None,
    ) -> None:
        """Provides a service; if it exists, its handler is replaced.

        Args:
            name: such as `/unreal/spawn_model`.
            type: such as `world_control_msgs/SpawnModel`.
            handler: called with the arguments, returns the values of the response; an exception becomes `result:
                false`. A plain function runs in a worker thread, the calls of one caller in their order; a coroutine
                function runs on the bridge's loop and must not block.
            quick: whether a plain function never blocks, so that it can also run on the loop.
            batched: whether the handler is a `BatchHandler`, called with the arguments of all consecutive calls of one
                caller that wait.
            policy: the limits of its calls; those of an edit by default.

        Raises:
            AdvertiseError: the name is taken.
        """

        def add() -> None:
            self._declare(EntryKind.SERVICE, name, policy)
            self._advertise(("service", resolve_name(name)), AdvertiseService(service=name, type=type))
            self._dispatcher.services[resolve_name(name)] = handler
            (self._dispatcher.quick.add if quick else self._dispatcher.quick.discard)(resolve_name(name))
            self._dispatcher.batches.pop(resolve_name(name), None)
            if batched:
                self._dispatcher.batches[resolve_name(name)] = partial(
                    self._dispatcher.handle_batch, cast(BatchHandler, handler)
                )

        self._loop.call(add)

    def destroy_service(self, name: str) -> None:
        """Withdraws a service; running calls are answered."""

        def remove() -> None:
            self._dispatcher.services.pop(resolve_name(name), None)
            self._unadvertise(("service", resolve_name(name)), UnadvertiseService(service=name))

        self._loop.call(remove)

    @checked
    def call_service(self, name: str, args: object = None, *, timeout_s: Timeout = 10.0) -> Any:
        """Calls a service and waits for the response.

        Args:
            name: name of the service.
            args: values that JSON can represent: an object, a struct, or a list of the fields in order.

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

    @checked
    def call_service_async(self, name: str, args: object = None, *, timeout_s: Timeout = 10.0) -> Future[Any]:
        """Calls a service without waiting; the future receives the result or the exception of `call_service`.

        In a coroutine, await it with `asyncio.wrap_future`.
        """
        encoded = encode_values(args)
        future: Future[Any] = Future()
        self._loop.call(self._pending_calls.call_service, name, encoded, timeout_s, future)
        return future

    # -- actions -------------------------------------------------------------------------------------------------------

    def create_action_server(
        self, name: str, type: str, handler: ActionHandler, *, policy: Policy | None = None
    ) -> None:
        """Provides an action; its goals run concurrently.

        Args:
            name: such as `/unreal/simulate_steps`.
            type: such as `simulation_interfaces/SimulateSteps`.
            handler: called with the `ServerGoalHandle`; sends progress by `goal.feedback`, checks
                `goal.cancel_requested` regularly, and returns the values of the result or a `GoalResult`.
            policy: the limits of its goals; those of an edit by default.

        Raises:
            AdvertiseError: the name is taken.
        """

        def add() -> None:
            self._declare(EntryKind.ACTION, name, policy)
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
        return self._loop.call(self._pending_calls.send_goal, action, type, encode_values(args), on_feedback)

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
        operation = Publish(topic=topic, msg=encode_values(message))
        if self._loop.is_current_thread():
            self._send_if_possible(operation)
            return
        if self._loop.closed or not self._backlog.acquire(timeout=10.0):
            raise BridgeError("cannot publish: the bridge is closed or stuck")

        def publish() -> None:
            self._backlog.release()
            self._send_if_possible(operation)

        self._loop.call_soon(publish)

    @checked
    def subscribe(
        self,
        topic: str,
        handler: MessageHandler,
        *,
        type: str | None = None,
        throttle_ms: Index = 0,
        queue_length: Index = 0,
        compression: Compression = Compression.NONE,
        with_sender: bool = False,
        usual_type: str | None = None,
        policy: Policy | None = None,
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
            usual_type: the type in ROS 2, where a topic has one, if several are accepted here.
            policy: the limits of the messages of clients of this process; those of an edit by default.

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
            usual_type=usual_type or type,
        )

        def subscribe() -> None:
            self._declare(EntryKind.TOPIC, topic, policy)
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
                self._dispatcher.start_goal(resolve_name(operation.action), operation, sender)
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
        name = resolve_name(message.topic)
        if (refusal := self._dispatcher.refusal(EntryKind.TOPIC, name, message.msg, sender)) is not None:
            if sender is not None:
                sender.send_status(StatusLevel.ERROR, str(refusal))
            return
        for subscription in self._subscriptions[name]:
            task = CallbackTask(subscription, message, sender)
            if subscription.is_async:
                self._dispatcher.start_task(task.run())
            else:
                self._executor.submit(subscription, task, max_waiting=UNHANDLED_MESSAGES.count)

    def _declare(self, kind: EntryKind, name: str, policy: Policy | None) -> None:
        """Keeps the policy of an entry point; on the loop."""
        self._dispatcher.policies[kind, resolve_name(name)] = policy

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
        return self._node._dispatcher.withdraw(call)


class LocalNode(Node):
    """A node with a broker in its own process; `RosbridgeServer` connects clients with it.

    The thread of its event loop runs from its creation until `close`.
    """

    def __init__(self, *, limits: BridgeLimits = DEFAULT_BRIDGE_LIMITS, name: str = "/mindstage") -> None:
        """Creates a broker without other peers.

        Args:
            limits: limits of each client.
            name: name of this node, as introspection tools show it.
        """
        super().__init__(name="mindstage-node")
        self.limits = limits
        self.broker = Broker(self._loop.loop, limits)
        """The broker; it belongs to the loop."""
        self._starting = 0
        self._mirrors: list[Callable[[Operation], None]] = []
        self._local_peer = _LocalPeer(resolve_name(name), self)
        self._loop.call(self.broker.add_peer, self._local_peer)

    @property
    def name(self) -> str:
        """Name of this node in the graph."""
        return self._local_peer.name

    def mirror(self, tell: Callable[[Operation], None]) -> Callable[[], None]:
        """Calls a function, on the loop, with each operation by which this node advertises, withdraws or subscribes.

        It is called with those that hold now before this returns. A topic whose messages may have several types has the
        usual one.

        Returns:
            A function that ends it.
        """

        def begin() -> None:
            self._mirrors.append(tell)
            for operation in list(self._advertisements.values()):
                tell(self._with_type(operation))

        self._loop.call(begin)
        return lambda: self._mirrors.remove(tell) if tell in self._mirrors else None

    def call_soon(self, function: Callable[..., object], *args: object) -> None:
        """Calls a function on the loop, from any thread, without waiting."""
        self._loop.call_soon(function, *args)

    @property
    def is_starting(self) -> bool:
        """Whether some of its services are not created yet; servers answer 503 then."""
        return self._starting > 0

    @contextmanager
    def starting(self) -> Iterator[None]:
        """During the `with` block services are created, and servers accept no new clients."""
        self._starting += 1
        try:
            yield
        finally:
            self._starting -= 1

    def graph_info(self) -> GraphInfo:
        """Returns the current graph of nodes, services, actions and topics."""
        return self._loop.call(self.broker.graph_info)

    def entry_points(self) -> tuple[EntryPoint, ...]:
        """Everything that a client of this broker can reach: operations, and what this node offers and reads now."""
        graph, policies = self.graph_info(), self._dispatcher.policies
        found = [
            *((EntryKind.SERVICE, each.name) for each in graph.services if each.provider == self.name),
            *((EntryKind.ACTION, each.name) for each in graph.actions if each.provider == self.name),
            *((EntryKind.TOPIC, each.name) for each in graph.topics if self.name in each.subscribers),
        ]
        offered = (EntryPoint(kind, name, policies.get((kind, resolve_name(name)))) for kind, name in found)
        return (*self.broker.entry_points(), *offered)

    def _declare(self, kind: EntryKind, name: str, policy: Policy | None) -> None:
        super()._declare(kind, name, policy)
        if kind is EntryKind.SERVICE and policy is not None and policy.deadline_s is not None:
            self.broker.services.timeouts_s[resolve_name(name)] = policy.deadline_s

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

    def _advertise(self, key: Hashable, operation: Operation) -> None:
        super()._advertise(key, operation)
        for tell in self._mirrors:
            tell(self._with_type(operation))

    def _unadvertise(self, key: Hashable, operation: Operation) -> None:
        if key in self._advertisements:
            for tell in self._mirrors:
                tell(operation)
        super()._unadvertise(key, operation)

    def _with_type(self, operation: Operation) -> Operation:
        if not isinstance(operation, Subscribe) or operation.type is not None:
            return operation
        handlers = self._subscriptions[resolve_name(operation.topic)]
        usual = next((each.usual_type for each in handlers if each.request is operation), None)
        return msgspec.structs.replace(operation, type=usual)
