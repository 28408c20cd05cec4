"""Topics: what anyone publishes goes to everyone who subscribed, in the order it came.

Names: when two names mean one topic or service, and when two types are one.

Peers: who is at the hub, as the hub sees them, whether behind a socket or in the same process.

Exchange: what services and actions have in common: one provider a name, and requests that wait for their end.

Actions: a goal goes to its provider, feedback and the result come back, a cancel follows it.

A goal whose sender is gone is canceled; one whose provider is gone ends as aborted.

Feeds: one topic's messages on their way to one peer, as fast as it wants and can take them.

A throttled feed keeps the newest messages while it waits, so that the last one always arrives; so does one with a
queue whose peer reads too slowly. One with neither sends at once, and the connection drops a peer that cannot follow.

Services: a call goes to its provider, the answer back to its caller; every call gets exactly one, in time.

Switchboard: what a hub does with each thing that a peer says. Belongs to the loop, and waits for nothing.

Switchboard: the routing inside a hub; knows peers and operations, and no socket.
"""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from itertools import count
from typing import Any, Generic, NamedTuple, TypeVar

import msgspec

from mindstage.bridge.protocol import (
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
from mindstage.errors import AdvertiseError, MessageValidationError, ServiceNotFoundError

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


def resolve_name(name: str) -> str:
    """A name as the root namespace has it: `tf` and `/tf` are one."""
    return "/" + name.strip("/")


def same_type(first: str | None, second: str | None) -> bool:
    """Whether two names mean one type: ROS 1 says `std_msgs/String`, ROS 2 `std_msgs/msg/String`, and some say none."""
    return not first or not second or _short_type_name(first) == _short_type_name(second)


def _short_type_name(type: str) -> tuple[str, str]:
    package, _, rest = type.partition("/")
    return package, rest.rpartition("/")[2]


class ReplyFormat(NamedTuple):
    """How a peer wants to be sent something."""

    compression: Compression = Compression.NONE
    fragment_size: int | None = None


PLAIN_FORMAT = ReplyFormat()
"""As JSON, and whole."""


class Peer(ABC):
    """Someone at the hub; compared by identity."""

    is_local = False
    """Whether it lives in this process: then its offers are the hub's own, and nobody else may take their names."""

    def __init__(self, name: str) -> None:
        self.name = name
        """Such as `/client_3`, as tools that look around show it."""
        self.has_left = False
        """Whether it has left."""
        self.level = StatusLevel.ERROR
        """Which remarks it wants to hear."""

    @property
    @abstractmethod
    def congested(self) -> bool:
        """Whether it reads more slowly than it is sent to; what can wait should wait."""

    @abstractmethod
    def deliver(
        self, outgoing: MessageEncoder, route: ReplyFormat = PLAIN_FORMAT, *, sender: Peer | None = None
    ) -> None:
        """Sends it something; never waits.

        Args:
            outgoing: what.
            route: how.
            sender: on whose behalf.
        """

    def send_status(self, level: StatusLevel, message: str, id: Id | None = None) -> None:
        """Tells it something about what it sent, if it wants to hear it."""
        if self.level.includes(level):
            self.deliver(MessageEncoder(Status(id=id, level=level, msg=message)))


class Provider(NamedTuple):
    """Someone who answers."""

    name: str
    """As the provider says it, who knows no other spelling."""
    type: str
    peer: Peer


class PendingRequest:
    """Something that was passed on to a provider and has not ended."""

    def __init__(
        self, *, name: str, id: Id | None, caller: Peer, provider: Provider, reply_format: ReplyFormat
    ) -> None:
        self.name = name
        """As the caller says it."""
        self.id = id
        """The caller's; the provider knows it by ours."""
        self.caller: Peer | None = caller
        """None once the caller is gone and only the provider is left to be heard."""
        self.provider = provider
        self.reply_format = reply_format


R = TypeVar("R", bound=PendingRequest)


class ProviderTable(Generic[R]):
    """Offers by name, and requests by the id that their provider was given."""

    def __init__(self, type_name: str, limits: BridgeLimits) -> None:
        self._type_name = type_name
        self._limits = limits
        self._offers: dict[str, Provider] = {}
        self._requests: dict[Id, R] = {}
        self._by_caller: Counter[Peer] = Counter()
        self._by_provider: Counter[Peer] = Counter()
        self._next_id = count(1)

    @property
    def providers(self) -> Iterator[Provider]:
        """All of them, by name."""
        return (offer for _, offer in sorted(self._offers.items()))

    @property
    def names(self) -> tuple[str, ...]:
        """What is offered."""
        return tuple(self._offers)

    def pending_count(self) -> int:
        """How many requests have not ended."""
        return len(self._requests)

    def register(self, peer: Peer, name: str, type: str) -> None:
        """Makes a peer the provider; whoever was it before is told.

        Raises:
            AdvertiseError: the hub itself provides it, or the peer offers too much.
        """
        former = self._offers.get(resolve_name(name))
        if former is not None and former.peer.is_local and not peer.is_local:
            raise AdvertiseError(name, cause=f"this {self._type_name} is the hub's own; choose another name")
        if former is None or former.peer is not peer:
            if self._by_provider[peer] >= self._limits.advertisements and not peer.is_local:
                raise AdvertiseError(name, cause=f"{self._limits.advertisements} offers of one client are enough")
            self._by_provider[peer] += 1
        if former is not None and former.peer is not peer:
            self._remove_provider(former.peer)
            former.peer.send_status(StatusLevel.WARNING, f"{peer.name} offers the {self._type_name} {name} now")
        self._offers[resolve_name(name)] = Provider(name, type, peer)

    def unregister(self, peer: Peer, name: str) -> None:
        """Ends a peer's offer; calls that it has already may still be answered."""
        offer = self._offers.get(resolve_name(name))
        if offer is None or offer.peer is not peer:
            peer.send_status(StatusLevel.WARNING, f"the {self._type_name} {name} was not offered by you")
            return
        del self._offers[resolve_name(name)]
        self._remove_provider(peer)

    def find(self, name: str) -> Provider | None:
        """Who provides it."""
        return self._offers.get(resolve_name(name))

    def request_count(self, caller: Peer) -> int:
        """How many of its requests wait."""
        return self._by_caller[caller]

    def add_request(self, request: R) -> Id:
        """Keeps a request until its end; the id is for the provider."""
        id = f"{self._type_name}:{next(self._next_id)}"
        self._requests[id] = request
        if request.caller is not None:
            self._by_caller[request.caller] += 1
        return id

    def request(self, provider: Peer, id: Id | None) -> R | None:
        """The request that a provider speaks of; None, and a remark, if it has none of that id (any more)."""
        request = None if id is None else self._requests.get(id)
        if request is None or request.provider.peer is not provider:
            why = "it had its end, timed out, or its caller left"
            provider.send_status(StatusLevel.WARNING, f"no {self._type_name} call waits for {id!r}: {why}", id)
            return None
        return request

    def pending_request(self, id: Id) -> R | None:
        """The request of one of our ids."""
        return self._requests.get(id)

    def pop_request(self, id: Id) -> None:
        """Forgets a request."""
        request = self._requests.pop(id)
        if request.caller is not None and request.caller in self._by_caller:
            self._by_caller[request.caller] -= 1

    def discard_request(self, id: Id) -> None:
        """Forgets a request, if it is still known."""
        if id in self._requests:
            self.pop_request(id)

    def remove_peer(self, peer: Peer) -> tuple[list[tuple[Id, R]], list[tuple[Id, R]]]:
        """Ends a peer's offers; gives what it had still to answer, and what it had asked of others."""
        for name, offer in list(self._offers.items()):
            if offer.peer is peer:
                del self._offers[name]
        self._by_provider.pop(peer, None)
        self._by_caller.pop(peer, None)
        owed = [(id, each) for id, each in self._requests.items() if each.provider.peer is peer]
        asked = [(id, each) for id, each in self._requests.items() if each.caller is peer]
        return owed, asked

    def _remove_provider(self, provider: Peer) -> None:
        self._by_provider[provider] -= 1


class _Goal(PendingRequest):
    wants_feedback = False


class ActionRouter:
    """All actions at the hub."""

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: BridgeLimits) -> None:
        self.providers: ProviderTable[_Goal] = ProviderTable("action", limits)
        self._loop = loop
        self._limits = limits
        self._sent: dict[tuple[Peer, Id], Id] = {}
        """Sender and its id, to ours: a cancel names the former."""

    def advertise(self, peer: Peer, offer: AdvertiseAction) -> None:
        """A peer becomes the provider."""
        self.providers.register(peer, offer.action, offer.type)

    def unadvertise(self, peer: Peer, offer: UnadvertiseAction) -> None:
        """It is no longer."""
        self.providers.unregister(peer, offer.action)

    def send_goal(self, caller: Peer, request: SendActionGoal) -> None:
        """Passes a goal on, or answers that nothing will come of it."""
        route = ReplyFormat(request.compression or Compression.NONE, request.fragment_size)
        offer = self.providers.find(request.action)
        why = ""
        if offer is None:
            why = f"Action {request.action} does not exist"
        elif self.providers.request_count(caller) >= self._limits.goals and not caller.is_local:
            why = f"{self._limits.goals} of your goals are under way already"
        elif request.id is not None and (caller, request.id) in self._sent:
            why = f"a goal {request.id!r} is under way already"
        if offer is None or why:
            _send_aborted(caller, request.action, request.id, route, why)
            return
        goal = _Goal(name=request.action, id=request.id, caller=caller, provider=offer, reply_format=route)
        goal.wants_feedback = request.feedback
        id = self.providers.add_request(goal)
        if request.id is not None:
            self._sent[caller, request.id] = id
        forwarded = SendActionGoal(
            id=id,
            action=offer.name,
            action_type=request.action_type,
            args=content(request.args),
            feedback=request.feedback,
        )
        offer.peer.deliver(MessageEncoder(forwarded), sender=caller)

    def cancel_goal(self, caller: Peer, request: CancelActionGoal) -> None:
        """Passes a cancel on; of a goal that has ended, nothing is left to cancel."""
        id = self._sent.get((caller, request.id))
        goal = None if id is None else self.providers.pending_request(id)
        if id is None or goal is None:
            caller.send_status(StatusLevel.WARNING, f"no goal {request.id!r} of yours is under way", request.id)
        else:
            _send_cancel(id, goal)

    def forward_feedback(self, provider: Peer, message: ActionFeedback) -> None:
        """Passes on how a goal goes, to a sender who wants to hear it."""
        goal = self.providers.request(provider, message.id)
        if goal is not None and goal.wants_feedback and goal.caller is not None and goal.id is not None:
            passed = ActionFeedback(id=goal.id, action=goal.name, values=content(message.values))
            goal.caller.deliver(MessageEncoder(passed), goal.reply_format)

    def forward_result(self, provider: Peer, result: ActionResult) -> None:
        """Passes on how a goal ended."""
        goal = self.providers.request(provider, result.id)
        if goal is None or result.id is None:
            return
        self._end_goal(result.id, goal)
        if goal.caller is not None:
            passed = ActionResult(
                id=goal.id, action=goal.name, values=content(result.values), status=result.status, result=result.result
            )
            goal.caller.deliver(MessageEncoder(passed), goal.reply_format)

    def remove_peer(self, peer: Peer) -> None:
        """Cancels what a peer wanted that is gone, and ends what it had still to reach."""
        owed, asked = self.providers.remove_peer(peer)
        for id, goal in owed:
            self._end_goal(id, goal)
            if goal.caller is not peer:
                text = f"the provider of {goal.provider.name} is gone"
                _send_aborted(goal.caller, goal.name, goal.id, goal.reply_format, text)
        for id, goal in asked:
            if goal.provider.peer is not peer:
                self._cancel_orphan(id, goal)

    def _cancel_orphan(self, id: Id, goal: _Goal) -> None:
        """Cancels a goal whose sender is gone, and waits for its end, but not for ever."""
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


_RETRY_S = 0.02
"""A congested peer is looked at again after so long [s]."""


class ThrottledQueue:
    """The subscriptions of one peer to one topic, which it hears once however many they are."""

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
        """The topic as the peer says it."""

    def __len__(self) -> int:
        return len(self._requests)

    def add(self, request: Subscribe) -> None:
        """Another subscription, or the same one with other wishes."""
        self._requests[request.id] = request
        self.name = request.topic
        self._merge_options()

    def remove(self, id: Id | None) -> bool:
        """Ends one subscription, or all where no id is given; tells whether there was any."""
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
        """Sends a message now, or as soon as it is time."""
        if self._timer is None and not (self._queues and self._peer.congested):
            self._send(message, publisher)
            return
        self._waiting.append((message, publisher))
        if self._timer is None:
            self._timer = self._loop.call_later(_RETRY_S, self._flush)

    def stop(self) -> None:
        """Sends nothing more."""
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
        """One rate and one form for all subscriptions: the fastest, the longest queue, the smallest fragments."""
        requests = self._requests.values()
        self._throttle_s = min(each.throttle_rate or 0.0 for each in requests) / 1000.0
        length = max(each.queue_length or 0 for each in requests)
        self._queues = length > 0
        self._waiting = deque(self._waiting, maxlen=min(max(1, length), _MAX_QUEUE_LENGTH))
        compressions = {each.compression or Compression.NONE for each in requests}
        wanted = (Compression.CBOR, Compression.PNG, Compression.NONE)
        sizes = [each.fragment_size for each in requests if each.fragment_size is not None]
        self._reply_format = ReplyFormat(
            next(each for each in wanted if each in compressions), min(sizes, default=None)
        )


_MAX_QUEUE_LENGTH = 1000
"""No queue is longer, whatever was asked for."""


class _Call(PendingRequest):
    timer: asyncio.TimerHandle


class ServiceRouter:
    """All services at the hub."""

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: BridgeLimits) -> None:
        self.providers: ProviderTable[_Call] = ProviderTable("service", limits)
        self.timeouts_s: dict[str, float] = {}
        """Instead of the limits' `call_timeout_s`, for services that are known to take longer [s]."""
        self._loop = loop
        self._limits = limits

    def advertise(self, peer: Peer, offer: AdvertiseService) -> None:
        """A peer becomes the provider."""
        self.providers.register(peer, offer.service, offer.type)

    def unadvertise(self, peer: Peer, offer: UnadvertiseService) -> None:
        """It is no longer."""
        self.providers.unregister(peer, offer.service)

    def forward_call(self, caller: Peer, call: CallService) -> None:
        """Passes a call on, or answers it with an error."""
        route = ReplyFormat(call.compression or Compression.NONE, call.fragment_size)
        offer = self.providers.find(call.service)
        if offer is None:
            unknown = ServiceNotFoundError(call.service, known=self.providers.names)
            _send_error_response(caller, call.service, call.id, route, str(unknown))
        elif self.providers.request_count(caller) >= self._limits.calls and not caller.is_local:
            _send_error_response(
                caller, call.service, call.id, route, f"{self._limits.calls} of your calls wait already"
            )
        else:
            self._forward(caller, call, offer, route)

    def forward_response(self, provider: Peer, response: ServiceResponse) -> None:
        """Passes an answer on; one that nobody waits for any more is dropped with a remark."""
        call = self.providers.request(provider, response.id)
        if call is None or response.id is None:
            return
        self._end(response.id, call)
        values = content(response.values)
        if response.result and not bytes(values).startswith((b"{", b"[")):
            text = f"the answer of {call.provider.name} is no object"
            provider.send_status(StatusLevel.ERROR, text, response.id)
            _send_error_response(call.caller, call.name, call.id, call.reply_format, text)
        elif call.caller is not None:
            answer = ServiceResponse(id=call.id, service=call.name, values=values, result=response.result)
            call.caller.deliver(MessageEncoder(answer), call.reply_format)

    def remove_peer(self, peer: Peer) -> None:
        """Answers those who wait for a peer that is gone."""
        owed, asked = self.providers.remove_peer(peer)
        for id, call in asked:
            self._end(id, call)
        for id, call in owed:
            if call.caller is not peer:
                self._end(id, call)
                text = f"the provider of {call.provider.name} is gone"
                _send_error_response(call.caller, call.name, call.id, call.reply_format, text)

    def _forward(self, caller: Peer, call: CallService, provider: Provider, reply_format: ReplyFormat) -> None:
        usual_s = self.timeouts_s.get(resolve_name(provider.name), self._limits.call_timeout_s)
        timeout_s = min(usual_s if call.timeout is None else call.timeout, self._limits.max_call_timeout_s)
        request = _Call(name=call.service, id=call.id, caller=caller, provider=provider, reply_format=reply_format)
        id = self.providers.add_request(request)
        request.timer = self._loop.call_later(timeout_s, self._time_out, id, request, timeout_s)
        forwarded = CallService(id=id, service=provider.name, args=content(call.args), timeout=timeout_s)
        provider.peer.deliver(MessageEncoder(forwarded), sender=caller)

    def _time_out(self, id: Id, call: _Call, timeout_s: float) -> None:
        self._end(id, call)
        text = f"{call.provider.name} did not answer within {timeout_s:g} s"
        _send_error_response(call.caller, call.name, call.id, call.reply_format, text)

    def _end(self, id: Id, call: _Call) -> None:
        call.timer.cancel()
        self.providers.pop_request(id)


def _send_error_response(
    caller: Peer | None, service: str, id: Id | None, reply_format: ReplyFormat, text: str
) -> None:
    if caller is not None:
        values = msgspec.Raw(msgspec.json.encode(text))
        caller.deliver(
            MessageEncoder(ServiceResponse(id=id, service=service, values=values, result=False)), reply_format
        )


class Topic:
    """One of them; it exists while anyone publishes or listens."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.type = ""
        """Empty until someone says it."""
        self.publishers: dict[Peer, bool] = {}
        """And whether each one's last message is kept."""
        self.latched: dict[Peer, Publish] = {}
        self.queues: dict[Peer, ThrottledQueue] = {}


class TopicRouter:
    """All topics at the hub."""

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: BridgeLimits) -> None:
        self._loop = loop
        self._limits = limits
        self._topics: dict[str, Topic] = {}
        self._subscriptions: Counter[Peer] = Counter()
        self._advertisements: Counter[Peer] = Counter()

    def all(self) -> list[Topic]:
        """By name."""
        return [topic for _, topic in sorted(self._topics.items())]

    def has_subscribers(self, name: str) -> bool:
        """Whether anyone would hear a message."""
        topic = self._topics.get(resolve_name(name))
        return topic is not None and bool(topic.queues)

    def advertise(self, peer: Peer, offer: Advertise) -> None:
        """A peer will publish.

        Raises:
            AdvertiseError: the topic is of another type, or the peer offers too much.
        """
        known = self._topics.get(resolve_name(offer.topic))
        if known is not None and not same_type(known.type, offer.type):
            raise AdvertiseError(offer.topic, cause=f"it is of the type {known.type}, not {offer.type}")
        if known is None or peer not in known.publishers:
            if self._advertisements[peer] >= self._limits.advertisements and not peer.is_local:
                raise AdvertiseError(
                    offer.topic, cause=f"{self._limits.advertisements} topics of one client are enough"
                )
            self._advertisements[peer] += 1
        topic = self._topic(offer.topic)
        topic.type = topic.type or offer.type
        topic.publishers[peer] = offer.latch

    def unadvertise(self, peer: Peer, offer: Unadvertise) -> None:
        """It will not any more."""
        topic = self._topics.get(resolve_name(offer.topic))
        if topic is None or peer not in topic.publishers:
            peer.send_status(StatusLevel.WARNING, f"you did not advertise {offer.topic}", offer.id)
            return
        self._remove_subscriber(topic, peer)

    def publish(self, peer: Peer, message: Publish) -> None:
        """Passes a message on to all who listen.

        Raises:
            MessageValidationError: nobody ever said what the topic's messages are.
        """
        topic = self._topics.get(resolve_name(message.topic))
        if topic is None or not (topic.type or topic.publishers):
            raise MessageValidationError(
                "publish", path="topic", cause=f"{message.topic} is not known", remedy="advertise it first"
            )
        if message.latch or topic.publishers.get(peer):
            topic.publishers.setdefault(peer, True)
            topic.latched[peer] = message
        spelled: dict[str, MessageEncoder] = {}
        for feed in list(topic.queues.values()):
            if feed.name not in spelled:
                spelled[feed.name] = MessageEncoder(Publish(topic=feed.name, msg=message.msg))
            feed.push(spelled[feed.name], peer)

    def subscribe(self, peer: Peer, request: Subscribe) -> None:
        """A peer listens from now on; it gets what was latched at once.

        Raises:
            MessageValidationError: the topic is of another type, or the peer has too many subscriptions.
        """
        known = self._topics.get(resolve_name(request.topic))
        if known is not None and not same_type(known.type, request.type):
            cause = f"{request.topic} is of the type {known.type}, not {request.type}"
            raise MessageValidationError("subscribe", path="type", cause=cause)
        if self._subscriptions[peer] >= self._limits.subscriptions and not peer.is_local:
            cause = f"{self._limits.subscriptions} subscriptions of one client are enough"
            raise MessageValidationError("subscribe", cause=cause)
        topic = self._topic(request.topic)
        topic.type = topic.type or request.type or ""
        feed = topic.queues.get(peer)
        if feed is None:
            feed = topic.queues[peer] = ThrottledQueue(self._loop, peer)
        before = len(feed)
        feed.add(request)
        self._subscriptions[peer] += len(feed) - before
        if not before:
            for publisher, message in topic.latched.items():
                feed.push(MessageEncoder(Publish(topic=feed.name, msg=message.msg)), publisher)

    def unsubscribe(self, peer: Peer, request: Unsubscribe) -> None:
        """It does not listen any more, or one of its subscriptions ends."""
        topic = self._topics.get(resolve_name(request.topic))
        feed = None if topic is None else topic.queues.get(peer)
        before = 0 if feed is None else len(feed)
        if topic is None or feed is None or not feed.remove(request.id):
            peer.send_status(StatusLevel.WARNING, f"you are not subscribed to {request.topic}", request.id)
            return
        self._subscriptions[peer] -= before - len(feed)
        if not feed:
            del topic.queues[peer]
            self._remove_if_unused(topic)

    def remove_peer(self, peer: Peer) -> None:
        """Forgets a peer that is gone."""
        for topic in self.all():
            if feed := topic.queues.pop(peer, None):
                feed.stop()
            self._remove_subscriber(topic, peer)
        self._subscriptions.pop(peer, None)
        self._advertisements.pop(peer, None)

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


class ProviderInfo(msgspec.Struct, frozen=True):
    """A service or an action, and who provides it."""

    name: str
    type: str
    provider: str


class TopicInfo(msgspec.Struct, frozen=True):
    """A topic, and who is at its ends."""

    name: str
    type: str
    """Empty where nobody said it."""
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...]


class GraphInfo(msgspec.Struct, frozen=True):
    """Who and what is at a hub at one moment."""

    peers: tuple[str, ...]
    services: tuple[ProviderInfo, ...]
    actions: tuple[ProviderInfo, ...]
    topics: tuple[TopicInfo, ...]


class Broker:
    """Brings peers together."""

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: BridgeLimits) -> None:
        self.services = ServiceRouter(loop, limits)
        self.actions = ActionRouter(loop, limits)
        self.topics = TopicRouter(loop, limits)
        self._peers: list[Peer] = []
        self._handlers: Mapping[type, Callable[[Peer, Any], None]] = {
            Advertise: self.topics.advertise,
            Unadvertise: self.topics.unadvertise,
            Publish: self.topics.publish,
            Subscribe: self.topics.subscribe,
            Unsubscribe: self.topics.unsubscribe,
            AdvertiseService: self.services.advertise,
            UnadvertiseService: self.services.unadvertise,
            CallService: self.services.forward_call,
            ServiceResponse: self.services.forward_response,
            AdvertiseAction: self.actions.advertise,
            UnadvertiseAction: self.actions.unadvertise,
            SendActionGoal: self.actions.send_goal,
            CancelActionGoal: self.actions.cancel_goal,
            ActionFeedback: self.actions.forward_feedback,
            ActionResult: self.actions.forward_result,
            SetLevel: _set_level,
        }

    def add_peer(self, peer: Peer) -> None:
        """A peer is here."""
        self._peers.append(peer)

    def remove_peer(self, peer: Peer) -> None:
        """A peer is gone: its offers end, its goals are canceled, and whoever waits for it is told."""
        if peer in self._peers:
            self._peers.remove(peer)
            peer.has_left = True
            self.services.remove_peer(peer)
            self.actions.remove_peer(peer)
            self.topics.remove_peer(peer)

    def handle(self, peer: Peer, operation: Operation) -> None:
        """Does what a peer says.

        Raises:
            AdvertiseError: it cannot offer that.
            MessageValidationError: it cannot say that.
        """
        way = self._handlers.get(type(operation))
        if way is None:
            peer.send_status(StatusLevel.WARNING, f"a {type(operation).__name__} makes no sense here", operation.id)
        else:
            way(peer, operation)

    def graph_info(self) -> GraphInfo:
        """Who and what is here now."""
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
