"""Services, actions, subscriptions and publishers that are withdrawn together.

An action is offered as ROS 2 does, by operations of rosbridge, and as ROS 1 does, by its five topics; at a rosbridge of
`rosbridge_suite` as the one that it can transmit.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, TypeVar

import msgspec

from mindstage.access.limits import MASTER_TIME
from mindstage.access.policies import Policy
from mindstage.bridge import LocalNode, Node, RosbridgeClient, Subscription
from mindstage.errors import MindstageError
from mindstage.msgs import Message, RosVersion, message_types, type_name
from mindstage.ros.actionlib import ActionlibServer
from mindstage.ros.diagnostics import DiagnosticsPublisher, Publisher
from mindstage.ros.service import (
    ActionSpec,
    ServiceSpec,
    action_handler,
    batch_handler,
    decode_request,
    service_handler,
)
from mindstage.simulation.observation import as_client

__all__ = ["Endpoints"]

_log = logging.getLogger("mindstage.ros")
M = TypeVar("M", bound=Message)


class Endpoints:
    """What a part of the interface offers at a node, in one namespace."""

    def __init__(
        self, node: Node, *, namespace: str, ros: RosVersion, diagnostics: DiagnosticsPublisher, goal_timeout_s: float
    ) -> None:
        """Offers nothing yet.

        Args:
            namespace: namespace of all names that do not begin with a slash.
            ros: version of ROS for names and formats.
            diagnostics: publishes errors.
            goal_timeout_s: largest duration of the goal of an action [s].
        """
        self.namespace = namespace
        self.ros = ros
        self.diagnostics = diagnostics
        self._node = node
        self._goal_timeout_s = goal_timeout_s
        self._services: list[str] = []
        self._actions: list[str] = []
        self._action_servers: list[ActionlibServer] = []
        self._subscriptions: list[Subscription] = []
        self._publishers: list[Publisher[Any]] = []

    def in_namespace(self, namespace: str) -> Endpoints:
        """Returns endpoints at the same node in another namespace, which are withdrawn on their own."""
        return Endpoints(
            self._node,
            namespace=namespace,
            ros=self.ros,
            diagnostics=self.diagnostics,
            goal_timeout_s=self._goal_timeout_s,
        )

    @property
    def service_names(self) -> tuple[str, ...]:
        """Absolute names of the services."""
        return tuple(self._services)

    @property
    def action_names(self) -> tuple[str, ...]:
        """Absolute names of the actions."""
        return tuple(dict.fromkeys((*self._actions, *(server.name for server in self._action_servers))))

    @property
    def only_version(self) -> RosVersion | None:
        """The version of ROS whose types the server has; None at a server that has those of both."""
        return self.ros if isinstance(self._node, RosbridgeClient) and self._node.needs_packages else None

    def full_name(self, name: str) -> str:
        """Returns an absolute name."""
        return name if name.startswith("/") else "/".join(("", *filter(None, self.namespace.split("/")), name))

    def create_service(self, spec: ServiceSpec) -> None:
        """Provides a service, unless the server cannot have its type.

        Raises:
            AdvertiseError: the name is taken.
        """
        if not self._has_type(spec):
            return
        name = spec.full_name(self.namespace)
        make_handler = batch_handler if spec.batched else service_handler
        handler = make_handler(name, spec.type, spec.handler, diagnostics=self.diagnostics, ros=self.ros)
        type = type_name(spec.type, self.ros)
        self._node.create_service(name, type, handler, quick=spec.quick, batched=spec.batched, policy=spec.policy)
        self._services.append(name)

    def create_action(self, spec: ActionSpec) -> None:
        """Provides an action.

        Raises:
            AdvertiseError: the name is taken.
        """
        name = spec.full_name(self.namespace)
        timeout_s = min(self._goal_timeout_s, spec.policy.deadline_s or self._goal_timeout_s)
        handler = action_handler(name, spec, diagnostics=self.diagnostics, ros=self.ros, timeout_s=timeout_s)
        # rosbridge_suite has only topics for actions in ROS 1, and no types for these topics in ROS 2.
        has_both = self.only_version is None
        if has_both or self.ros is RosVersion.TWO:
            self._node.create_action_server(name, type_name(spec.type, self.ros), handler, policy=spec.policy)
            self._actions.append(name)
        if has_both or self.ros is RosVersion.ONE:
            self._action_servers.append(
                ActionlibServer(
                    self._node, name, spec.type, handler, spec.policy, diagnostics=self.diagnostics, ros=self.ros
                )
            )

    def subscribe(
        self, name: str, type: type[M], handler: Callable[[M], object], policy: Policy, *, other: Any = None
    ) -> None:
        """Subscribes to a topic; errors are published on the diagnostics, since messages have no response.

        Args:
            name: name of the topic.
            type: type of its messages.
            handler: called with each message.
            policy: its limits.
            other: another type that messages may have at a node in this process, which has no type for the topic then.
        """
        topic = self.full_name(name)
        is_open = other is not None and isinstance(self._node, LocalNode)

        def on_message(message: Any) -> None:
            try:
                with as_client(f"ROS: {topic}"):
                    decode_and_handle(message)
            except MindstageError as error:
                self.diagnostics.report_error(topic, error)

        def decode_and_handle(message: Any) -> None:
            is_other = is_open and isinstance(message, dict) and not message.keys() <= set(type.__struct_fields__)
            handler(decode_request(other if is_other else type, message))

        expected = None if is_open else type_name(type, self.ros)
        self._subscriptions.append(
            self._node.subscribe(topic, on_message, type=expected, usual_type=type_name(type, self.ros), policy=policy)
        )

    def publisher(self, name: str, type: type[M], *, latch: bool = False) -> Publisher[M]:
        """Announces a topic.

        Raises:
            AdvertiseError: the topic has another type.
        """
        publisher = Publisher(self._node, self.full_name(name), type, ros=self.ros, latch=latch)
        self._publishers.append(publisher)
        return publisher

    def set_parameter(self, name: str, value: str) -> None:
        """Sets a parameter at the master of ROS 1 behind another server, without waiting; elsewhere does nothing."""
        if isinstance(self._node, RosbridgeClient) and self.only_version is RosVersion.ONE:
            args = {"name": self.full_name(name), "value": msgspec.json.encode(value).decode()}
            self._node.call_service_async("/rosapi/set_param", args, timeout_s=MASTER_TIME.maximum)

    def publish_status(self) -> None:
        """Publishes the status of the goals in ROS 1; to be called regularly."""
        for server in self._action_servers:
            server.publish_status()

    def close(self) -> None:
        """Withdraws everything and cancels all goals; calling it again is harmless."""
        for server in self._action_servers:
            server.close()
        for subscription in self._subscriptions:
            subscription.close()
        for publisher in self._publishers:
            publisher.close()
        for action in self._actions:
            self._node.destroy_action_server(action)
        for service in self._services:
            self._node.destroy_service(service)
        for each in (self._action_servers, self._subscriptions, self._publishers, self._actions, self._services):
            each.clear()

    def _has_type(self, spec: ServiceSpec) -> bool:
        """Whether the server can have the type; in ROS 1, catkin cannot build a service with the name of a message."""
        if self.only_version is not RosVersion.ONE or type_name(spec.type) not in message_types():
            return True
        _log.info("%s is not offered: ROS 1 has no service %s", spec.full_name(self.namespace), type_name(spec.type))
        return False
