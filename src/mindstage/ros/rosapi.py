"""The services of rosapi, by which tools introspect a `LocalNode`. Another rosbridge server has its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from mindstage.bridge import GraphInfo, LocalNode, TopicInfo
from mindstage.bridge.broker import resolve_name, same_type
from mindstage.errors import TypeNotFoundError
from mindstage.msgs import (
    Message,
    RosVersion,
    action_type,
    builtin_interfaces,
    definition_text,
    message_type,
    message_types,
    service_type,
    type_definitions,
)
from mindstage.msgs import rosapi as wire
from mindstage.ros.service import ServiceSpec
from mindstage.simulation import Simulation

__all__ = ["RosapiServices"]

_NAMESPACE = "/rosapi"


class RosapiServices:
    """Services that return the graph of nodes, services, actions and topics."""

    def __init__(self, node: LocalNode, simulation: Simulation, *, ros: RosVersion) -> None:
        self._node = node
        self._simulation = simulation
        self._ros = ros

    def services(self) -> Iterator[ServiceSpec]:
        """Yields all services."""
        for name, type, answer in (*self._topic_services(), *self._service_services(), *self._other_services()):
            yield ServiceSpec(type, answer, name=f"{_NAMESPACE}/{name}")

    def _topic_services(self) -> Iterator[tuple[str, Any, Callable[[Any], Message]]]:
        yield "topics", wire.Topics, lambda _: wire.Topics.Response(**self._topics())
        yield "topics_and_raw_types", wire.TopicsAndRawTypes, self._raw_types
        yield (
            "topics_for_type",
            wire.TopicsForType,
            lambda request: wire.TopicsForType.Response(
                topics=tuple(
                    topic.name
                    for topic in self._graph_info().topics
                    if topic.type and same_type(topic.type, request.type)
                )
            ),
        )
        yield (
            "topic_type",
            wire.TopicType,
            lambda request: wire.TopicType.Response(type=self._topic(request.topic).type),
        )
        yield (
            "publishers",
            wire.Publishers,
            lambda request: wire.Publishers.Response(publishers=self._topic(request.topic).publishers),
        )
        yield (
            "subscribers",
            wire.Subscribers,
            lambda request: wire.Subscribers.Response(subscribers=self._topic(request.topic).subscribers),
        )

    def _service_services(self) -> Iterator[tuple[str, Any, Callable[[Any], Message]]]:
        yield (
            "services",
            wire.Services,
            lambda _: wire.Services.Response(services=tuple(each.name for each in self._graph_info().services)),
        )
        yield (
            "services_for_type",
            wire.ServicesForType,
            lambda request: wire.ServicesForType.Response(
                services=tuple(each.name for each in self._graph_info().services if same_type(each.type, request.type))
            ),
        )
        yield (
            "service_type",
            wire.ServiceType,
            lambda request: wire.ServiceType.Response(type=self._of_service(request.service, "type")),
        )
        yield (
            "service_node",
            wire.ServiceNode,
            lambda request: wire.ServiceNode.Response(node=self._of_service(request.service, "provider")),
        )
        yield (
            "service_providers",
            wire.ServiceProviders,
            lambda request: wire.ServiceProviders.Response(
                providers=tuple(
                    {each.provider: 0 for each in self._graph_info().services if same_type(each.type, request.service)}
                )
            ),
        )
        yield (
            "action_servers",
            wire.GetActionServers,
            lambda _: wire.GetActionServers.Response(
                action_servers=tuple(each.name for each in self._graph_info().actions)
            ),
        )
        yield (
            "action_type",
            wire.ActionType,
            lambda request: wire.ActionType.Response(
                type=next(
                    (each.type for each in self._graph_info().actions if each.name == resolve_name(request.action)), ""
                )
            ),
        )

    def _other_services(self) -> Iterator[tuple[str, Any, Callable[[Any], Message]]]:
        yield "nodes", wire.Nodes, lambda _: wire.Nodes.Response(nodes=self._graph_info().peers)
        yield "node_details", wire.NodeDetails, self._node_details
        yield "interfaces", wire.Interfaces, lambda _: wire.Interfaces.Response(interfaces=tuple(message_types()))
        yield (
            "get_time",
            wire.GetTime,
            lambda _: wire.GetTime.Response(time=builtin_interfaces.Time.at(self._simulation.state.time_s)),
        )
        yield (
            "get_ros_version",
            wire.GetROSVersion,
            lambda _: wire.GetROSVersion.Response(version=self._ros.value, distro="mindstage"),
        )
        yield "get_param_names", wire.GetParamNames, lambda _: wire.GetParamNames.Response()
        yield (
            "get_param",
            wire.GetParam,
            lambda request: wire.GetParam.Response(
                value=request.default,
                successful=bool(request.default),
                reason="" if request.default else "there are no parameters",
            ),
        )
        yield "has_param", wire.HasParam, lambda _: wire.HasParam.Response()
        for name, type, part in (
            ("message_details", wire.MessageDetails, message_type),
            ("service_request_details", wire.ServiceRequestDetails, lambda name: service_type(name).request),
            ("service_response_details", wire.ServiceResponseDetails, lambda name: service_type(name).response),
            ("action_goal_details", wire.ActionGoalDetails, lambda name: action_type(name).goal),
            ("action_result_details", wire.ActionResultDetails, lambda name: action_type(name).result),
            ("action_feedback_details", wire.ActionFeedbackDetails, lambda name: action_type(name).feedback),
        ):
            yield name, type, self._details(type, part)

    # -- the graph -----------------------------------------------------------------------------------------------------

    def _graph_info(self) -> GraphInfo:
        return self._node.graph_info()

    def _topics(self) -> dict[str, tuple[str, ...]]:
        topics = self._graph_info().topics
        return {"topics": tuple(each.name for each in topics), "types": tuple(each.type for each in topics)}

    def _topic(self, name: str) -> TopicInfo:
        found = (topic for topic in self._graph_info().topics if topic.name == resolve_name(name))
        return next(found, TopicInfo(resolve_name(name), "", (), ()))

    def _of_service(self, name: str, field: str) -> str:
        found = (str(getattr(each, field)) for each in self._graph_info().services if each.name == resolve_name(name))
        return next(found, "")

    def _raw_types(self, _: wire.TopicsAndRawTypes.Request) -> wire.TopicsAndRawTypes.Response:
        topics = self._topics()
        texts = tuple(self._definition(type) for type in topics["types"])
        return wire.TopicsAndRawTypes.Response(**topics, typedefs_full_text=texts)

    def _definition(self, type: str) -> str:
        """Returns the definition of a type; empty for a type that is not registered."""
        try:
            return definition_text(message_type(type), ros=self._ros)
        except TypeNotFoundError:
            return ""

    def _node_details(self, request: wire.NodeDetails.Request) -> wire.NodeDetails.Response:
        graph, node = self._graph_info(), resolve_name(request.node)
        return wire.NodeDetails.Response(
            subscribing=tuple(topic.name for topic in graph.topics if node in topic.subscribers),
            publishing=tuple(topic.name for topic in graph.topics if node in topic.publishers),
            services=tuple(each.name for each in graph.services if each.provider == node),
        )

    def _details(self, type: Any, part: Callable[[str], Any]) -> Callable[[Any], Message]:
        def handle(request: Any) -> Message:
            response: Message = type.Response(typedefs=type_definitions(part(request.type), ros=self._ros))
            return response

        return handle
