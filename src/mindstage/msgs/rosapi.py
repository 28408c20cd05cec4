"""rosapi: what tools ask to look around: topics, services, types, nodes, and the definitions of types."""
# ruff: noqa: D106 - Request and Response say what they are

from __future__ import annotations

from typing import ClassVar

from mindstage.msgs.builtin_interfaces import Time
from mindstage.msgs.message import Message, Ros, Service
from mindstage.msgs.primitives import Bool, Int32, String, Uint8

__all__ = [
    "ActionFeedbackDetails",
    "ActionGoalDetails",
    "ActionResultDetails",
    "ActionType",
    "GetActionServers",
    "GetParam",
    "GetParamNames",
    "GetROSVersion",
    "GetTime",
    "HasParam",
    "Interfaces",
    "MessageDetails",
    "NodeDetails",
    "Nodes",
    "Publishers",
    "ServiceNode",
    "ServiceProviders",
    "ServiceRequestDetails",
    "ServiceResponseDetails",
    "ServiceType",
    "Services",
    "ServicesForType",
    "Subscribers",
    "TopicType",
    "Topics",
    "TopicsAndRawTypes",
    "TopicsForType",
    "TypeDef",
]

Names = tuple[String, ...]


class TypeDef(Message, frozen=True):
    """One type; the lists of fields and the lists of constants run in parallel."""

    type: String = ""
    fieldnames: Names = ()
    fieldtypes: Names = ()
    fieldarraylen: tuple[Int32, ...] = ()
    """-1 for one value, 0 for any number of them, else their number."""
    examples: Names = ()
    constnames: Names = ()
    constvalues: Names = ()


class Topics(Service):
    """All topics and their types."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        topics: Names = ()
        types: Names = ()


class TopicsForType(Service):
    """Topics of one type."""

    class Request(Message, frozen=True):
        type: String = ""

    class Response(Message, frozen=True):
        topics: Names = ()


class TopicsAndRawTypes(Service):
    """All topics, their types, and what those types are made of, as text."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        topics: Names = ()
        types: Names = ()
        typedefs_full_text: Names = ()


class TopicType(Service):
    """A topic's type."""

    class Request(Message, frozen=True):
        topic: String = ""

    class Response(Message, frozen=True):
        type: String = ""


class Publishers(Service):
    """Who publishes a topic."""

    class Request(Message, frozen=True):
        topic: String = ""

    class Response(Message, frozen=True):
        publishers: Names = ()


class Subscribers(Service):
    """Who listens to a topic."""

    class Request(Message, frozen=True):
        topic: String = ""

    class Response(Message, frozen=True):
        subscribers: Names = ()


class Services(Service):
    """All services."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        services: Names = ()


class ServicesForType(Service):
    """Services of one type."""

    class Request(Message, frozen=True):
        type: String = ""

    class Response(Message, frozen=True):
        services: Names = ()


class ServiceType(Service):
    """A service's type."""

    class Request(Message, frozen=True):
        service: String = ""

    class Response(Message, frozen=True):
        type: String = ""


class ServiceProviders(Service):
    """Who offers a service."""

    class Request(Message, frozen=True):
        service: String = ""

    class Response(Message, frozen=True):
        providers: Names = ()


class ServiceNode(Service):
    """The node that offers a service."""

    class Request(Message, frozen=True):
        service: String = ""

    class Response(Message, frozen=True):
        node: String = ""


class Nodes(Service):
    """All nodes."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        nodes: Names = ()


class NodeDetails(Service):
    """What a node does."""

    class Request(Message, frozen=True):
        node: String = ""

    class Response(Message, frozen=True):
        subscribing: Names = ()
        publishing: Names = ()
        services: Names = ()


class GetActionServers(Service):
    """All actions."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        action_servers: Names = ()


class ActionType(Service):
    """An action's type."""

    class Request(Message, frozen=True):
        action: String = ""

    class Response(Message, frozen=True):
        type: String = ""


class Interfaces(Service):
    """All types that are known."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        interfaces: Names = ()


class GetTime(Service):
    """What time it is."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        time: Time = Time()


class GetROSVersion(Service):
    """Which ROS speaks here."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        version: Uint8 = 0
        distro: String = ""


class GetParamNames(Service):
    """All parameters."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        names: Names = ()


class GetParam(Service):
    """A parameter's value, as JSON."""

    class Request(Message, frozen=True):
        spellings: ClassVar = {"default_value": "default"}

        name: String = ""
        default: String = ""

    class Response(Message, frozen=True):
        only_in: ClassVar = {"successful": Ros.TWO, "reason": Ros.TWO}

        value: String = ""
        successful: Bool = False
        reason: String = ""


class HasParam(Service):
    """Whether there is such a parameter."""

    class Request(Message, frozen=True):
        name: String = ""

    class Response(Message, frozen=True):
        exists: Bool = False


class MessageDetails(Service):
    """What a message is made of, down to its primitives."""

    class Request(Message, frozen=True):
        type: String = ""

    class Response(Message, frozen=True):
        typedefs: tuple[TypeDef, ...] = ()


class ServiceRequestDetails(Service):
    """What a service is asked with."""

    class Request(Message, frozen=True):
        type: String = ""

    class Response(Message, frozen=True):
        typedefs: tuple[TypeDef, ...] = ()


class ServiceResponseDetails(Service):
    """What a service replies."""

    class Request(Message, frozen=True):
        type: String = ""

    class Response(Message, frozen=True):
        typedefs: tuple[TypeDef, ...] = ()


class ActionGoalDetails(Service):
    """What an action's goal is made of."""

    class Request(Message, frozen=True):
        type: String = ""

    class Response(Message, frozen=True):
        typedefs: tuple[TypeDef, ...] = ()


class ActionResultDetails(Service):
    """What an action's result is made of."""

    class Request(Message, frozen=True):
        type: String = ""

    class Response(Message, frozen=True):
        typedefs: tuple[TypeDef, ...] = ()


class ActionFeedbackDetails(Service):
    """What an action's feedback is made of."""

    class Request(Message, frozen=True):
        type: String = ""

    class Response(Message, frozen=True):
        typedefs: tuple[TypeDef, ...] = ()
