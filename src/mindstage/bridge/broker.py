"""The broker between the nodes of a bridge: routes messages, service calls and action goals between peers.

A message on a topic goes to all its subscribers, in the order of publication. A service or an action has one provider;
every call gets exactly one response, with a timeout. Feedback and the result of a goal return to its client; if the
client disconnects, the goal is canceled, and if the provider does, the goal is aborted.

All classes belong to the event loop and never block; they send through `Peer` and do no I/O.
"""

from __future__ import annotations

import asyncio
import time
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from itertools import count
from typing import Any, Generic, NamedTuple, TypeVar

import msgspec

from mindstage.access.limits import QUEUE_LENGTH, BridgeLimits
from mindstage.access.policies import CONTROL, PAYLOAD, EntryKind, EntryPoint, Policy
from mindstage.access.visitors import Visitor
from mindstage.bridge.encodings import serialize, write_cbor_raw
from mindstage.bridge.protocol import (
    ActionFeedback,
    ActionResult,
    Advertise,
    AdvertiseAction,
    AdvertiseService,
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
    SetLevel,
    Status,
    StatusLevel,
    Subscribe,
    Unadvertise,
    UnadvertiseAction,
    UnadvertiseService,
    Unsubscribe,
    content,
)
from mindstage.errors import AdvertiseError, MessageValidationError, ServiceNotFoundError, TypeNotFoundError
from mindstage.msgs import Message, RosVersion, decode, message_type, type_name

__all__ = [
    "PLAIN_FORMAT",
    "ActionRouter",
    "Broker",
    "GraphInfo",
    "Peer",
    "PendingRequest",
    "Provider",
    "ProviderInfo",
    "ProviderTable",
    "ReplyFormat",
    "ServiceRouter",
    "ThrottledQueue",
    "Topic",
    "TopicInfo",
    "TopicRouter",
    "resolve_name",
    "same_type",
]

_RETRY_S = 0.02
"""Interval at which a congested peer is checked [s]."""


def resolve_name(name: str) -> str:
    """Returns a name in the root namespace: `tf` and `/tf` are the same."""
    return "/" + name.strip("/")


def same_type(first: str | None, second: str | None) -> bool:
    """Whether two type names, of ROS 1 (`std_msgs/String`) or 2 (`std_msgs/msg/String`), are equal or one is empty."""
    return not first or not second or _short_type_name(first) == _short_type_name(second)


def _short_type_name(type: str) -> tuple[str, str]:
    package, _, rest = type.partition("/")
    return package, rest.rpartition("/")[2]


class ReplyFormat(NamedTuple):
    """Encoding of the messages to a peer."""

    compression: Compression = Compression.NONE
    fragment_size: int | None = None


PLAIN_FORMAT = ReplyFormat()
"""JSON, not fragmented."""


class Peer(ABC):
    """A node at the broker; compared by identity."""

    is_local = False
    """Whether it is in this process. The names of its services and actions cannot be advertised by others."""

    def __init__(self, name: str) -> None:
        self.name = name
        """Name of the node, such as `/client_3`, as introspection tools show it."""
        self.has_left = False
        """Whether it has disconnected."""
        self.is_paused = False
        """Whether no operations are received from it, since too many of its calls are pending."""
        self.visitor: Visitor | None = None
        """Where its connection comes from; None for a node of this process."""
        self.needs_messages = False
        """Whether the values of a failed call have to be a message of its type, since it has no place for a text."""
        self.level = StatusLevel.ERROR
        """Severity of the status messages that it receives."""

    @property
    @abstractmethod
    def congested(self) -> bool:
        """Whether it reads more slowly than messages are queued."""

    @abstractmethod
    def deliver(
        self, outgoing: MessageEncoder, reply_format: ReplyFormat = PLAIN_FORMAT, *, sender: Peer | None = None
    ) -> None:
        """Sends an operation; never blocks.

        Args:
            outgoing: the operation.
            reply_format: encoding.
            sender: the peer from which the operation comes.
        """

    def answer(self, call: CallService, caller: Peer) -> ServiceResponse | None:
        """Answers a call at once, if it can; otherwise returns None, and the call is to be delivered."""
        return None

    def withdraw(self, call: CallService) -> bool | None:
        """Withdraws a call that was delivered, unless it has begun.

        Returns:
            Whether it was withdrawn, and is never carried out; None if the provider is another program.
        """
        return None

    def set_paused(self, paused: bool) -> None:
        """Stops to receive operations, since too many calls are pending, or continues."""
        self.is_paused = paused

    def send_status(self, level: StatusLevel, message: str, id: Id | None = None) -> None:
        """Sends a status message, if its level is high enough."""
        if self.level.includes(level):
            self.deliver(MessageEncoder(Status(id=id, level=level, msg=message)))


class Provider(NamedTuple):
    """The provider of a service or an action."""

    name: str
    """Name as the provider wrote it, and as it is sent to the provider."""
    type: str
    peer: Peer


class PendingRequest:
    """A call or goal that was forwarded to a provider and has not ended."""

    def __init__(
        self, *, name: str, id: Id | None, caller: Peer, provider: Provider, reply_format: ReplyFormat
    ) -> None:
        self.name = name
        """Name of the service or action, as the caller wrote it."""
        self.id = id
        """Id that the caller chose; the provider receives one of the broker."""
        self.caller: Peer | None = caller
        """None after the caller disconnected, while the end of the goal is awaited."""
        self.provider = provider
        self.reply_format = reply_format


R = TypeVar("R", bound=PendingRequest)


class ProviderTable(Generic[R]):
    """Providers by name, and pending requests by the id that was sent to the provider."""

    def __init__(self, type_name: str, limits: BridgeLimits) -> None:
        self._type_name = type_name
        self._limits = limits
        self._providers: dict[str, Provider] = {}
        self._requests: dict[Id, R] = {}
        self._by_caller: Counter[Peer] = Counter()
        self._by_provider: Counter[Peer] = Counter()
        self._next_id = count(1)

    @property
    def providers(self) -> Iterator[Provider]:
        """All providers, sorted by name."""
        return (provider for _, provider in sorted(self._providers.items()))

    @property
    def names(self) -> tuple[str, ...]:
        """All names that are advertised."""
        return tuple(self._providers)

    def pending_count(self) -> int:
        """Returns the number of pending requests."""
        return len(self._requests)

    def register(self, peer: Peer, name: str, type: str) -> None:
        """Makes a peer the provider of a name; the previous provider receives a warning.

        Args:
            peer: the new provider.
            name: name of the service or action.

        Raises:
            AdvertiseError: the name belongs to the local node, or the peer exceeds the limit of advertisements.
        """
        previous = self._providers.get(resolve_name(name))
        if previous is not None and previous.peer.is_local and not peer.is_local:
            raise AdvertiseError(name, cause=f"this {self._type_name} belongs to the local node; choose another name")
        if previous is None or previous.peer is not peer:
            if self._by_provider[peer] >= self._limits.advertisements and not peer.is_local:
                cause = f"a client has at most {self._limits.advertisements} advertisements"
                raise AdvertiseError(name, cause=cause)
            self._by_provider[peer] += 1
        if previous is not None and previous.peer is not peer:
            self._remove_provider(previous.peer)
            text = f"{peer.name} is now the provider of the {self._type_name} {name}"
            previous.peer.send_status(StatusLevel.WARNING, text)
        self._providers[resolve_name(name)] = Provider(name, type, peer)

    def unregister(self, peer: Peer, name: str) -> None:
        """Withdraws a name; pending requests can still be answered."""
        provider = self._providers.get(resolve_name(name))
        if provider is None or provider.peer is not peer:
            peer.send_status(StatusLevel.WARNING, f"you did not advertise the {self._type_name} {name}")
            return
        del self._providers[resolve_name(name)]
        self._remove_provider(peer)

    def find(self, name: str) -> Provider | None:
        """Returns the provider of a name."""
        return self._providers.get(resolve_name(name))

    def request_count(self, caller: Peer) -> int:
        """Returns the number of pending requests of a caller."""
        return self._by_caller[caller]

    def add_request(self, request: R) -> Id:
        """Stores a request and returns the id to send to the provider."""
        id = f"{self._type_name}:{next(self._next_id)}"
        self._requests[id] = request
        if request.caller is not None:
            self._by_caller[request.caller] += 1
        return id

    def request(self, provider: Peer, id: Id | None) -> R | None:
        """Returns the pending request to which a provider refers; otherwise sends it a warning and returns None."""
        request = None if id is None else self._requests.get(id)
        if request is None or request.provider.peer is not provider:
            why = "it has ended or timed out, or the caller disconnected"
            provider.send_status(StatusLevel.WARNING, f"no pending {self._type_name} request {id!r}: {why}", id)
            return None
        return request

    def pending_request(self, id: Id) -> R | None:
        """Returns the pending request with an id of the broker."""
        return self._requests.get(id)

    def pop_request(self, id: Id) -> None:
        """Removes a request."""
        request = self._requests.pop(id)
        if request.caller is not None and request.caller in self._by_caller:
            self._by_caller[request.caller] -= 1

    def discard_request(self, id: Id) -> None:
        """Removes a request if it is pending."""
        if id in self._requests:
            self.pop_request(id)

    def remove_peer(self, peer: Peer) -> tuple[list[tuple[Id, R]], list[tuple[Id, R]]]:
        """Removes the names of a peer; returns the requests to it and the requests by it."""
        for name, provider in list(self._providers.items()):
            if provider.peer is peer:
                del self._providers[name]
        self._by_provider.pop(peer, None)
        self._by_caller.pop(peer, None)
        received = [(id, each) for id, each in self._requests.items() if each.provider.peer is peer]
        sent = [(id, each) for id, each in self._requests.items() if each.caller is peer]
        return received, sent

    def _remove_provider(self, provider: Peer) -> None:
        self._by_provider[provider] -= 1


class _Goal(PendingRequest):
    wants_feedback = False


class ActionRouter:
    """Routes goals, feedback and results of all actions."""

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: BridgeLimits) -> None:
        self.providers: ProviderTable[_Goal] = ProviderTable("action", limits)
        self._loop = loop
        self._limits = limits
        self._sent: dict[tuple[Peer, Id], Id] = {}
        """Client and its id to the id of the broker, for cancellation."""

    def advertise(self, peer: Peer, request: AdvertiseAction) -> None:
        """Makes a peer the provider of an action."""
        self.providers.register(peer, request.action, request.type)

    def unadvertise(self, peer: Peer, request: UnadvertiseAction) -> None:
        """Withdraws an action."""
        self.providers.unregister(peer, request.action)

    def send_goal(self, caller: Peer, request: SendActionGoal) -> None:
        """Forwards a goal to the provider, or returns an aborted result."""
        reply_format = ReplyFormat(request.compression or Compression.NONE, request.fragment_size)
        provider = self.providers.find(request.action)
        cause = ""
        if provider is None:
            cause = f"Action {request.action} does not exist"
        elif self.providers.request_count(caller) >= self._limits.goals and not caller.is_local:
            cause = f"you have {self._limits.goals} active goals already"
        elif request.id is not None and (caller, request.id) in self._sent:
            cause = f"the goal {request.id!r} is active already"
        if provider is None or cause:
            _send_aborted(caller, request.action, request.id, reply_format, cause)
            return
        goal = _Goal(name=request.action, id=request.id, caller=caller, provider=provider, reply_format=reply_format)
        goal.wants_feedback = request.feedback
        id = self.providers.add_request(goal)
        if request.id is not None:
            self._sent[caller, request.id] = id
        forwarded = SendActionGoal(
            id=id,
            action=provider.name,
            action_type=request.action_type,
            args=content(request.args),
            feedback=request.feedback,
        )
        provider.peer.deliver(MessageEncoder(forwarded), sender=caller)

    def cancel_goal(self, caller: Peer, request: CancelActionGoal) -> None:
        """Forwards a cancellation; of a goal that has ended, the caller receives a warning."""
        id = self._sent.get((caller, request.id))
        goal = None if id is None else self.providers.pending_request(id)
        if id is None or goal is None:
            caller.send_status(StatusLevel.WARNING, f"you have no active goal {request.id!r}", request.id)
        else:
            _send_cancel(id, goal)

    def forward_feedback(self, provider: Peer, message: ActionFeedback) -> None:
        """Forwards feedback to a client that requested it."""
        goal = self.providers.request(provider, message.id)
        if goal is not None and goal.wants_feedback and goal.caller is not None and goal.id is not None:
            forwarded = ActionFeedback(id=goal.id, action=goal.name, values=content(message.values))
            goal.caller.deliver(MessageEncoder(forwarded), goal.reply_format)

    def forward_result(self, provider: Peer, result: ActionResult) -> None:
        """Forwards the result of a goal."""
        goal = self.providers.request(provider, result.id)
        if goal is None or result.id is None:
            return
        self._end_goal(result.id, goal)
        if goal.caller is not None:
            values = content(result.values)
            values = values if goal.caller.needs_messages else _reason(result) or values
            forwarded = ActionResult(
                id=goal.id, action=goal.name, values=values, status=result.status, result=result.result
            )
            goal.caller.deliver(MessageEncoder(forwarded), goal.reply_format)

    def remove_peer(self, peer: Peer) -> None:
        """Cancels the goals that a disconnected peer sent, and aborts those that it executed."""
        received, sent = self.providers.remove_peer(peer)
        for id, goal in received:
            self._end_goal(id, goal)
            if goal.caller is not peer:
                text = f"the provider of {goal.provider.name} disconnected"
                _send_aborted(goal.caller, goal.name, goal.id, goal.reply_format, text)
        for id, goal in sent:
            if goal.provider.peer is not peer:
                self._cancel_orphan(id, goal)

    def _cancel_orphan(self, id: Id, goal: _Goal) -> None:
        """Cancels a goal whose client disconnected, and waits for its end with a timeout."""
        if goal.caller is not None and goal.id is not None:
            self._sent.pop((goal.caller, goal.id), None)
        goal.caller = None
        _send_cancel(id, goal)
        self._loop.call_later(self._limits.orphaned_goal_timeout_s, self.providers.discard_request, id)

    def _end_goal(self, id: Id, goal: _Goal) -> None:
        if goal.caller is not None and goal.id is not None:
            self._sent.pop((goal.caller, goal.id), None)
        self.providers.pop_request(id)


def _send_cancel(id: Id, goal: _Goal) -> None:
    goal.provider.peer.deliver(MessageEncoder(CancelActionGoal(id=id, action=goal.provider.name)))


def _send_aborted(caller: Peer | None, action: str, id: Id | None, reply_format: ReplyFormat, text: str) -> None:
    if caller is not None:
        values = msgspec.Raw(msgspec.json.encode(text))
        status = GoalStatus.ABORTED
        caller.deliver(
            MessageEncoder(ActionResult(id=id, action=action, values=values, status=status, result=False)), reply_format
        )


class ThrottledQueue:
    """Messages of one topic to one peer, which receives each message once even with several subscriptions.

    With a throttle rate, the newest messages are kept while it waits, so that the last message is always delivered;
    with a queue length, messages are also kept while the peer is congested. Otherwise messages are sent at once, and
    the connection drops a peer that reads too slowly.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, peer: Peer) -> None:
        self._loop = loop
        self._peer = peer
        self._requests: dict[Id | None, Subscribe] = {}
        self._timer: asyncio.TimerHandle | None = None
        self._waiting: deque[tuple[MessageEncoder, Peer | None]] = deque(maxlen=1)
        self._throttle_s = 0.0
        self._queues = False
        self._reply_format = PLAIN_FORMAT
        self.name = ""
        """Name of the topic, as the peer wrote it."""

    def __len__(self) -> int:
        return len(self._requests)

    @property
    def is_raw(self) -> bool:
        """Whether messages are sent as ROS serializes them."""
        return self._reply_format.compression is Compression.CBOR_RAW

    def send_status(self, level: StatusLevel, text: str) -> None:
        """Sends a status message to the subscriber."""
        self._peer.send_status(level, text)

    def add(self, request: Subscribe) -> None:
        """Adds a subscription, or replaces the options of one with the same id."""
        self._requests[request.id] = request
        self.name = request.topic
        self._merge_options()

    def remove(self, id: Id | None) -> bool:
        """Removes one subscription, or all if no id is given; returns whether there was any."""
        if id is None:
            found = bool(self._requests)
            self._requests.clear()
        else:
            found = self._requests.pop(id, None) is not None
        if self._requests:
            self._merge_options()
        else:
            self.stop()
        return found

    def push(self, message: MessageEncoder, publisher: Peer | None = None) -> None:
        """Sends a message now, or queues it."""
        if self._timer is None and not (self._queues and self._peer.congested):
            self._send(message, publisher)
            return
        self._waiting.append((message, publisher))
        if self._timer is None:
            self._timer = self._loop.call_later(_RETRY_S, self._flush)

    def stop(self) -> None:
        """Discards the queued messages and sends nothing more."""
        self._waiting.clear()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _send(self, message: MessageEncoder, publisher: Peer | None) -> None:
        self._peer.deliver(message, self._reply_format, sender=publisher)
        if self._throttle_s > 0.0:
            self._timer = self._loop.call_later(self._throttle_s, self._flush)

    def _flush(self) -> None:
        self._timer = None
        while self._waiting and self._timer is None:
            if self._queues and self._peer.congested:
                self._timer = self._loop.call_later(_RETRY_S, self._flush)
            else:
                self._send(*self._waiting.popleft())

    def _merge_options(self) -> None:
        """Combines the options of all subscriptions: highest rate, longest queue, smallest fragments."""
        requests = self._requests.values()
        self._throttle_s = min(each.throttle_rate or 0.0 for each in requests) / 1000.0
        length = max(each.queue_length or 0 for each in requests)
        self._queues = length > 0
        self._waiting = deque(self._waiting, maxlen=min(max(1, length), QUEUE_LENGTH.count))
        compressions = {each.compression or Compression.NONE for each in requests}
        preference = (Compression.CBOR_RAW, Compression.CBOR, Compression.PNG, Compression.NONE)
        sizes = [each.fragment_size for each in requests if each.fragment_size is not None]
        self._reply_format = ReplyFormat(
            next(each for each in preference if each in compressions), min(sizes, default=None)
        )


class _Call(PendingRequest):
    timer: asyncio.TimerHandle
    forwarded: CallService
    """The call as the provider received it."""
    is_extended = False
    """Whether the timeout starts anew whenever another call of the caller ends."""


class ServiceRouter:
    """Routes the calls and responses of all services.

    A call of a local service whose time is over is withdrawn, unless it has begun: then it is answered at its end. The
    timeout of a call without one is extended while other calls of its caller end. A client with too many pending calls
    of local services is not read from until some of them have ended.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: BridgeLimits) -> None:
        self.providers: ProviderTable[_Call] = ProviderTable("service", limits)
        self.timeouts_s: dict[str, float] = {}
        """Default timeouts of services that take longer than the limits' `call_timeout_s` [s]."""
        self._loop = loop
        self._limits = limits
        self._last_ends_s: dict[Peer, float] = {}
        """When the last call of each caller ended [s]."""

    def advertise(self, peer: Peer, request: AdvertiseService) -> None:
        """Makes a peer the provider of a service."""
        self.providers.register(peer, request.service, request.type)

    def unadvertise(self, peer: Peer, request: UnadvertiseService) -> None:
        """Withdraws a service."""
        self.providers.unregister(peer, request.service)

    def forward_call(self, caller: Peer, call: CallService) -> None:
        """Forwards a call to the provider, or returns an error response."""
        reply_format = (
            PLAIN_FORMAT
            if call.compression is None and call.fragment_size is None
            else ReplyFormat(call.compression or Compression.NONE, call.fragment_size)
        )
        provider = self.providers.find(call.service)
        if provider is None:
            unknown = ServiceNotFoundError(call.service, known=self.providers.names)
            _send_error_response(caller, call.service, call.id, reply_format, str(unknown))
        elif (response := provider.peer.answer(call, caller)) is not None:
            caller.deliver(MessageEncoder(_checked(response, provider, call, caller)), reply_format)
        elif self.providers.request_count(caller) < self._limits.calls or provider.peer.is_local or caller.is_local:
            self._forward(caller, call, provider, reply_format)
        else:
            text = f"you have {self._limits.calls} pending calls already"
            _send_error_response(caller, call.service, call.id, reply_format, text)

    def forward_response(self, provider: Peer, response: ServiceResponse) -> None:
        """Forwards a response; if the call has ended, the provider receives a warning."""
        call = self.providers.request(provider, response.id)
        if call is None or response.id is None:
            return
        self._end(response.id, call)
        if call.caller is not None:
            forwarded = _checked(response, call.provider, call, call.caller)
            call.caller.deliver(MessageEncoder(forwarded), call.reply_format)

    def remove_peer(self, peer: Peer) -> None:
        """Withdraws the calls of a disconnected peer, and answers the calls to it with an error."""
        received, sent = self.providers.remove_peer(peer)
        for id, call in sent:
            call.provider.peer.withdraw(call.forwarded)
            self._end(id, call)
        for id, call in received:
            if call.caller is not peer:
                self._end(id, call)
                text = f"the provider of {call.provider.name} disconnected"
                _send_error_response(call.caller, call.name, call.id, call.reply_format, text)
        self._last_ends_s.pop(peer, None)

    def _forward(self, caller: Peer, call: CallService, provider: Provider, reply_format: ReplyFormat) -> None:
        default_s = self.timeouts_s.get(resolve_name(provider.name), self._limits.call_timeout_s)
        timeout_s = min(default_s if call.timeout is None else call.timeout, self._limits.max_call_timeout_s)
        request = _Call(name=call.service, id=call.id, caller=caller, provider=provider, reply_format=reply_format)
        id = self.providers.add_request(request)
        request.is_extended = call.timeout is None and provider.peer.is_local
        request.timer = self._loop.call_later(timeout_s, self._time_out, id, request, timeout_s)
        request.forwarded = CallService(id=id, service=provider.name, args=content(call.args), timeout=timeout_s)
        if provider.peer.is_local and self.providers.request_count(caller) >= self._limits.calls:
            caller.set_paused(True)
        provider.peer.deliver(MessageEncoder(request.forwarded), sender=caller)

    def _time_out(self, id: Id, call: _Call, timeout_s: float) -> None:
        if call.is_extended and call.caller is not None:
            last_end_s = self._last_ends_s.get(call.caller, 0.0)
            remaining_s = last_end_s + timeout_s - self._loop.time()
            if remaining_s > 0.0:
                call.timer = self._loop.call_later(remaining_s, self._time_out, id, call, timeout_s)
                return
        was_withdrawn = call.provider.peer.withdraw(call.forwarded)
        if was_withdrawn is False:
            return  # it is answered at its end
        self._end(id, call)
        text = f"{call.provider.name} did not answer within {timeout_s:g} s"
        if was_withdrawn:
            text = f"{call.provider.name} did not begin within {timeout_s:g} s; it was withdrawn"
        _send_error_response(call.caller, call.name, call.id, call.reply_format, text)

    def _end(self, id: Id, call: _Call) -> None:
        call.timer.cancel()
        self.providers.pop_request(id)
        caller = call.caller
        if caller is None or caller.has_left:
            return
        self._last_ends_s[caller] = self._loop.time()
        if caller.is_paused and self.providers.request_count(caller) <= self._limits.calls // 2:
            caller.set_paused(False)


def _checked(response: ServiceResponse, provider: Provider, call: CallService | _Call, caller: Peer) -> ServiceResponse:
    """Returns the response as the caller receives it; if it is not an object, the provider receives a status."""
    values = content(response.values)
    name = call.service if isinstance(call, CallService) else call.name
    if not response.result or bytes(memoryview(values)[:1]) in (b"{", b"["):
        values = values if caller.needs_messages else _reason(response) or values
        return ServiceResponse(id=call.id, service=name, values=values, result=response.result)
    text = f"the response of {provider.name} is not an object"
    provider.peer.send_status(StatusLevel.ERROR, text, response.id)
    return ServiceResponse(id=call.id, service=name, values=msgspec.Raw(msgspec.json.encode(text)), result=False)


def _send_error_response(
    caller: Peer | None, service: str, id: Id | None, reply_format: ReplyFormat, text: str
) -> None:
    if caller is not None:
        values = msgspec.Raw(msgspec.json.encode(text))
        caller.deliver(
            MessageEncoder(ServiceResponse(id=id, service=service, values=values, result=False)), reply_format
        )


def _reason(response: ServiceResponse | ActionResult) -> msgspec.Raw | None:
    """Returns the error message of a failed call or goal, if it is not already its values."""
    if response.result or response.reason is None:
        return None
    return msgspec.Raw(msgspec.json.encode(response.reason))


class Topic:
    """A topic; exists while it has a publisher or a subscriber."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.type = ""
        """Type of its messages; empty until it is known."""
        self.publishers: dict[Peer, bool] = {}
        """Publishers, each with whether its last message is latched."""
        self.latched: dict[Peer, Publish] = {}
        self.queues: dict[Peer, ThrottledQueue] = {}


class TopicRouter:
    """Routes the messages of all topics."""

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: BridgeLimits) -> None:
        self._loop = loop
        self._limits = limits
        self._topics: dict[str, Topic] = {}
        self.ros = RosVersion.TWO
        """Version of ROS in whose binary format messages are sent to subscribers with the compression `cbor-raw`."""
        self.now: Callable[[], float] = time.time
        """Returns the time at which those messages are received [s]."""
        self._subscriptions: Counter[Peer] = Counter()
        self._advertisements: Counter[Peer] = Counter()

    def all(self) -> list[Topic]:
        """Returns all topics, sorted by name."""
        return [topic for _, topic in sorted(self._topics.items())]

    def has_subscribers(self, name: str) -> bool:
        """Whether the topic has subscribers."""
        topic = self._topics.get(resolve_name(name))
        return topic is not None and bool(topic.queues)

    def advertise(self, peer: Peer, request: Advertise) -> None:
        """Makes a peer a publisher of a topic.

        Raises:
            AdvertiseError: the topic has another type, or the peer exceeds the limit of advertisements.
        """
        known = self._topics.get(resolve_name(request.topic))
        if known is not None and not same_type(known.type, request.type):
            raise AdvertiseError(request.topic, cause=f"its type is {known.type}, not {request.type}")
        if known is None or peer not in known.publishers:
            if self._advertisements[peer] >= self._limits.advertisements and not peer.is_local:
                raise AdvertiseError(
                    request.topic, cause=f"{self._limits.advertisements} topics of one client are enough"
                )
            self._advertisements[peer] += 1
        topic = self._topic(request.topic)
        topic.type = topic.type or request.type
        topic.publishers[peer] = request.latch

    def unadvertise(self, peer: Peer, request: Unadvertise) -> None:
        """Removes a publisher of a topic."""
        topic = self._topics.get(resolve_name(request.topic))
        if topic is None or peer not in topic.publishers:
            peer.send_status(StatusLevel.WARNING, f"you did not advertise {request.topic}", request.id)
            return
        self._remove_subscriber(topic, peer)

    def publish(self, peer: Peer, message: Publish) -> None:
        """Sends a message to all subscribers.

        Raises:
            MessageValidationError: the topic was not advertised, or the message is not of its type.
        """
        topic = self._topics.get(resolve_name(message.topic))
        if topic is None or not (topic.type or topic.publishers):
            raise MessageValidationError(
                "publish", path="topic", cause=f"{message.topic} is not advertised", remedy="advertise it first"
            )
        if not peer.is_local:
            _check_type(topic, message)
        if message.latch or topic.publishers.get(peer):
            topic.publishers.setdefault(peer, True)
            topic.latched[peer] = message
        encoded: dict[tuple[str, bool], MessageEncoder | None] = {}
        for queue in list(topic.queues.values()):
            key = (queue.name, queue.is_raw)
            if key not in encoded:
                encoded[key] = self._encoder(topic, queue, message)
            if (encoder := encoded[key]) is not None:
                queue.push(encoder, peer)

    def subscribe(self, peer: Peer, request: Subscribe) -> None:
        """Adds a subscription; latched messages are sent at once.

        Raises:
            MessageValidationError: the topic has another type, or the peer exceeds the limit of subscriptions.
        """
        known = self._topics.get(resolve_name(request.topic))
        if known is not None and not same_type(known.type, request.type):
            cause = f"the type of {request.topic} is {known.type}, not {request.type}"
            raise MessageValidationError("subscribe", path="type", cause=cause)
        type = (known.type if known is not None else "") or request.type or ""
        if request.compression is Compression.CBOR_RAW and _registered_type(type) is None:
            cause = f"the type of {request.topic} is {type or 'unknown'}, of which this server has no definition"
            raise MessageValidationError("subscribe", path="compression", cause=cause, remedy="use cbor")
        if self._subscriptions[peer] >= self._limits.subscriptions and not peer.is_local:
            cause = f"a client has at most {self._limits.subscriptions} subscriptions"
            raise MessageValidationError("subscribe", cause=cause)
        topic = self._topic(request.topic)
        topic.type = topic.type or request.type or ""
        queue = topic.queues.get(peer)
        if queue is None:
            queue = topic.queues[peer] = ThrottledQueue(self._loop, peer)
        before = len(queue)
        queue.add(request)
        self._subscriptions[peer] += len(queue) - before
        if not before:
            for publisher, message in topic.latched.items():
                if (encoder := self._encoder(topic, queue, message)) is not None:
                    queue.push(encoder, publisher)

    def unsubscribe(self, peer: Peer, request: Unsubscribe) -> None:
        """Removes all subscriptions of a peer to a topic, or the one with the id."""
        topic = self._topics.get(resolve_name(request.topic))
        queue = None if topic is None else topic.queues.get(peer)
        before = 0 if queue is None else len(queue)
        if topic is None or queue is None or not queue.remove(request.id):
            peer.send_status(StatusLevel.WARNING, f"you are not subscribed to {request.topic}", request.id)
            return
        self._subscriptions[peer] -= before - len(queue)
        if not queue:
            del topic.queues[peer]
            self._remove_if_unused(topic)

    def remove_peer(self, peer: Peer) -> None:
        """Removes the subscriptions and advertisements of a disconnected peer."""
        for topic in self.all():
            if queue := topic.queues.pop(peer, None):
                queue.stop()
            self._remove_subscriber(topic, peer)
        self._subscriptions.pop(peer, None)
        self._advertisements.pop(peer, None)

    def _encoder(self, topic: Topic, queue: ThrottledQueue, message: Publish) -> MessageEncoder | None:
        """Returns the encoder of a message to a subscriber; None, after a status message, if it cannot be encoded."""
        operation = Publish(topic=queue.name, msg=message.msg)
        if not queue.is_raw:
            return MessageEncoder(operation)
        try:
            decoded = _decode(_registered_type(topic.type), message.msg)
            data = serialize(decoded, ros=self.ros)
            raw = write_cbor_raw(queue.name, data, time_s=self.now())
        except MessageValidationError as error:
            queue.send_status(StatusLevel.ERROR, f"a message on {queue.name} cannot be serialized: {error}")
            return None
        return MessageEncoder(operation, raw=raw, serialized=data)

    def _topic(self, name: str) -> Topic:
        return self._topics.setdefault(resolve_name(name), Topic(resolve_name(name)))

    def _remove_subscriber(self, topic: Topic, peer: Peer) -> None:
        if topic.publishers.pop(peer, None) is not None:
            self._advertisements[peer] -= 1
        topic.latched.pop(peer, None)
        self._remove_if_unused(topic)

    def _remove_if_unused(self, topic: Topic) -> None:
        if not topic.publishers and not topic.queues:
            self._topics.pop(topic.name, None)


@lru_cache(maxsize=1024)
def _registered_type(name: str) -> type[Message] | None:
    """Returns the message type of a name; None if it is not registered."""
    try:
        return message_type(name)
    except TypeNotFoundError:
        return None


def _decode(type: type[Message] | None, raw: msgspec.Raw) -> Message:
    """Decodes a message with the names of the fields in either version of ROS.

    Raises:
        MessageValidationError: the type is not registered, or the message is not of this type.
    """
    if type is None:
        raise MessageValidationError("message", cause="its type is not registered")
    try:
        return msgspec.json.decode(raw, type=type)
    except msgspec.ValidationError:  # names of ROS 1, or an error that `decode` explains
        return decode(type, msgspec.json.decode(raw))
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise MessageValidationError(type_name(type), cause=str(error)) from error


def _check_type(topic: Topic, message: Publish) -> None:
    """Checks a message against the type of its topic, as rosbridge_suite does; other types are forwarded unchecked.

    Raises:
        MessageValidationError: it is not of this type.
    """
    type = _registered_type(topic.type)
    if type is not None:
        try:
            _decode(type, message.msg)
        except MessageValidationError as error:
            path = f"msg.{error.path}" if error.path else "msg"
            cause = f"it is not of the type {topic.type}: {error.cause}"
            raise MessageValidationError("publish", path=path, cause=cause, remedy=error.remedy) from error


class ProviderInfo(msgspec.Struct, frozen=True):
    """A service or an action and its provider."""

    name: str
    type: str
    provider: str


class TopicInfo(msgspec.Struct, frozen=True):
    """A topic, its publishers and its subscribers."""

    name: str
    type: str
    """Type of its messages; empty if it is unknown."""
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...]


class GraphInfo(msgspec.Struct, frozen=True):
    """The graph of nodes, services, actions and topics at one time."""

    peers: tuple[str, ...]
    services: tuple[ProviderInfo, ...]
    actions: tuple[ProviderInfo, ...]
    topics: tuple[TopicInfo, ...]


class Broker:
    """Routes the operations of all peers."""

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: BridgeLimits) -> None:
        self.services = ServiceRouter(loop, limits)
        self.actions = ActionRouter(loop, limits)
        self.topics = TopicRouter(loop, limits)
        self._peers: list[Peer] = []
        self.handlers: Mapping[type[Operation], tuple[Policy, Callable[[Peer, Any], None]]] = {
            Advertise: (CONTROL, self.topics.advertise),
            Unadvertise: (CONTROL, self.topics.unadvertise),
            Publish: (PAYLOAD, self.topics.publish),
            Subscribe: (CONTROL, self.topics.subscribe),
            Unsubscribe: (CONTROL, self.topics.unsubscribe),
            AdvertiseService: (CONTROL, self.services.advertise),
            UnadvertiseService: (CONTROL, self.services.unadvertise),
            CallService: (PAYLOAD, self.services.forward_call),
            ServiceResponse: (PAYLOAD, self.services.forward_response),
            AdvertiseAction: (CONTROL, self.actions.advertise),
            UnadvertiseAction: (CONTROL, self.actions.unadvertise),
            SendActionGoal: (PAYLOAD, self.actions.send_goal),
            CancelActionGoal: (CONTROL, self.actions.cancel_goal),
            ActionFeedback: (PAYLOAD, self.actions.forward_feedback),
            ActionResult: (PAYLOAD, self.actions.forward_result),
            SetLevel: (CONTROL, _set_level),
        }
        """The policy and the handler of each operation."""

    def add_peer(self, peer: Peer) -> None:
        """Adds a peer."""
        self._peers.append(peer)

    def remove_peer(self, peer: Peer) -> None:
        """Removes a disconnected peer: its services end, its goals are canceled, and calls to it fail."""
        if peer in self._peers:
            self._peers.remove(peer)
            peer.has_left = True
            self.services.remove_peer(peer)
            self.actions.remove_peer(peer)
            self.topics.remove_peer(peer)

    def entry_points(self) -> Iterator[EntryPoint]:
        """Yields the operations."""
        for operation, (policy, _) in self.handlers.items():
            yield EntryPoint(EntryKind.OPERATION, str(operation.__struct_config__.tag), policy)

    def handle(self, peer: Peer, operation: Operation, size: int = 0) -> None:
        """Handles an operation of a peer.

        Args:
            size: its size as it was received [B].

        Raises:
            RequestLimitError: it is larger than its policy allows.
            AdvertiseError: the peer cannot advertise this.
            MessageValidationError: the operation is not valid now.
        """
        policy, handler = self.handlers.get(type(operation), (CONTROL, None))
        policy.admit(type(operation).__name__, size, None, 0.0)
        if handler is None:
            peer.send_status(StatusLevel.WARNING, f"{type(operation).__name__} is not valid here", operation.id)
        else:
            handler(peer, operation)

    def graph_info(self) -> GraphInfo:
        """Returns the current graph."""
        return GraphInfo(
            peers=tuple(peer.name for peer in self._peers),
            services=tuple(
                ProviderInfo(each.name, each.type, each.peer.name) for each in self.services.providers.providers
            ),
            actions=tuple(
                ProviderInfo(each.name, each.type, each.peer.name) for each in self.actions.providers.providers
            ),
            topics=tuple(
                TopicInfo(
                    topic.name,
                    topic.type,
                    tuple(peer.name for peer in topic.publishers),
                    tuple(peer.name for peer in topic.queues),
                )
                for topic in self.topics.all()
            ),
        )


def _set_level(peer: Peer, request: SetLevel) -> None:
    peer.level = request.level
