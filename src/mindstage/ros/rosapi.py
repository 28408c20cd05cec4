"""The services of rosapi, by which tools introspect a `LocalNode`. Another rosbridge server has its own.

Parameters are a tree, as at the master of ROS 1: the value of `/robot` has those of `/robot/name` as parts. Values are
JSON, as in rosapi; a parameter that does not exist has the given default, or else null.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import deepcopy
from threading import Lock
from typing import Any, NamedTuple

import msgspec

from mindstage.access.limits import PARAMETER_CHARACTERS, PARAMETERS
from mindstage.access.policies import EDIT, READ
from mindstage.bridge import GraphInfo, LocalNode, TopicInfo
from mindstage.bridge.broker import resolve_name, same_type
from mindstage.errors import MessageValidationError, TypeNotFoundError
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

__all__ = ["ParameterServer", "RosapiServices"]

_NAMESPACE = "/rosapi"


class ParameterServer:
    """A tree of parameters; may be used from any thread."""

    def __init__(self) -> None:
        self._root: dict[str, Any] = {}
        self._lock = Lock()

    def set(self, name: str, value: Any) -> None:
        """Sets a parameter; an object replaces the whole branch.

        Raises:
            MessageValidationError: the name is empty, or there would be too many parameters.
        """
        *branches, leaf = _name_parts(name)
        with self._lock:
            if len(_leaves(self._root, "")) + len(_leaves(value, "x")) > PARAMETERS.count:
                cause = f"there would be more than {PARAMETERS.count} parameters"
                raise MessageValidationError("set_param", path="value", cause=cause, remedy="delete some")
            branch = self._root
            for part in branches:
                if not isinstance(branch.get(part), dict):
                    branch[part] = {}
                branch = branch[part]
            branch[leaf] = value

    def set_computed(self, name: str, compute: Callable[[], str]) -> None:
        """Sets a parameter that is computed when it is read; in a branch it is left out."""
        self.set(name, _Computed(compute))

    def get(self, name: str) -> Any:
        """Returns a value, or the branch below a name.

        Raises:
            KeyError: it does not exist.
        """
        with self._lock:
            value: Any = self._root
            for part in filter(None, name.split("/")):
                if not isinstance(value, dict):
                    raise KeyError(name)
                value = value[part]
            copy = _without_computed(value)
        return copy.compute() if isinstance(copy, _Computed) else copy

    def has(self, name: str) -> bool:
        """Whether a parameter exists."""
        try:
            self.get(name)
        except KeyError:
            return False
        return True

    def delete(self, name: str) -> bool:
        """Deletes a parameter, or the branch below a name; returns whether it existed."""
        *branches, leaf = _name_parts(name)
        with self._lock:
            branch: Any = self._root
            for part in branches:
                branch = branch.get(part) if isinstance(branch, dict) else None
            if not isinstance(branch, dict) or leaf not in branch:
                return False
            del branch[leaf]
            return True

    def names(self) -> tuple[str, ...]:
        """Returns the absolute names of all values."""
        with self._lock:
            return tuple(sorted(_leaves(self._root, "")))

    def search(self, name: str) -> str:
        """Returns the absolute name of a parameter in a namespace, or else in one above it; empty if there is none."""
        *spaces, leaf = _name_parts(name)
        for length in range(len(spaces), -1, -1):
            found = "/".join(("", *spaces[:length], leaf))
            if self.has(found):
                return found
        return ""


class _Computed(NamedTuple):
    compute: Callable[[], str]


def _without_computed(value: Any) -> Any:
    """Returns a copy of a value without the computed ones in it."""
    if not isinstance(value, dict):
        return value if isinstance(value, _Computed) else deepcopy(value)
    return {key: _without_computed(part) for key, part in value.items() if not isinstance(part, _Computed)}


def _name_parts(name: str) -> list[str]:
    parts = [part for part in name.split("/") if part]
    if not parts:
        raise MessageValidationError("parameter", path="name", cause="it is empty", remedy="name a parameter")
    return parts


def _leaves(value: Any, name: str) -> list[str]:
    if isinstance(value, dict) and value:
        return [leaf for key, part in value.items() for leaf in _leaves(part, f"{name}/{key}")]
    return [name] if name else []


class RosapiServices:
    """Services that return the graph of nodes, services, actions and topics."""

    def __init__(
        self, node: LocalNode, simulation: Simulation, parameters: ParameterServer, *, ros: RosVersion
    ) -> None:
        self._node = node
        self._parameters = parameters
        self._simulation = simulation
        self._ros = ros

    def services(self) -> Iterator[ServiceSpec]:
        """Yields all services."""
        for name, type, answer in (
            *self._topic_services(),
            *self._service_services(),
            *self._parameter_services(),
            *self._other_services(),
        ):
            policy = EDIT if name.startswith(("set_", "delete_")) else READ
            yield ServiceSpec(type, answer, policy, name=f"{_NAMESPACE}/{name}")

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
        for name, type, part in (
            ("message_details", wire.MessageDetails, message_type),
            ("service_request_details", wire.ServiceRequestDetails, lambda name: service_type(name).request),
            ("service_response_details", wire.ServiceResponseDetails, lambda name: service_type(name).response),
            ("action_goal_details", wire.ActionGoalDetails, lambda name: action_type(name).goal),
            ("action_result_details", wire.ActionResultDetails, lambda name: action_type(name).result),
            ("action_feedback_details", wire.ActionFeedbackDetails, lambda name: action_type(name).feedback),
        ):
            yield name, type, self._details(type, part)

    def _parameter_services(self) -> Iterator[tuple[str, Any, Callable[[Any], Message]]]:
        parameters = self._parameters
        yield (
            "get_param_names",
            wire.GetParamNames,
            lambda _: wire.GetParamNames.Response(names=parameters.names()),
        )
        yield "has_param", wire.HasParam, lambda request: wire.HasParam.Response(exists=parameters.has(request.name))
        yield "get_param", wire.GetParam, self._get_parameter
        yield "set_param", wire.SetParam, self._set_parameter
        yield "delete_param", wire.DeleteParam, self._delete_parameter
        if self._ros is RosVersion.ONE:
            yield (
                "search_param",
                wire.SearchParam,
                lambda request: wire.SearchParam.Response(global_name=parameters.search(request.name)),
            )

    def _get_parameter(self, request: wire.GetParam.Request) -> wire.GetParam.Response:
        try:
            value = self._parameters.get(request.name)
        except KeyError:
            if not request.default:
                return wire.GetParam.Response(value="null", reason=f"there is no parameter {request.name}")
            try:
                value = msgspec.json.decode(request.default)
            except (msgspec.DecodeError, RecursionError):
                value = request.default
        return wire.GetParam.Response(value=msgspec.json.encode(value).decode(), successful=True)

    def _set_parameter(self, request: wire.SetParam.Request) -> wire.SetParam.Response:
        subject, remedy = "set_param", 'send JSON, such as 7, "text" or {"x": 1}'
        if len(request.value) > PARAMETER_CHARACTERS.count:
            raise MessageValidationError(
                subject, path="value", cause=f"it has more than {PARAMETER_CHARACTERS.count} characters"
            )
        try:
            value = msgspec.json.decode(request.value)
        except (msgspec.DecodeError, RecursionError) as error:
            raise MessageValidationError(subject, path="value", cause=str(error), remedy=remedy) from error
        self._parameters.set(request.name, value)
        return wire.SetParam.Response(successful=True)

    def _delete_parameter(self, request: wire.DeleteParam.Request) -> wire.DeleteParam.Response:
        if self._parameters.delete(request.name):
            return wire.DeleteParam.Response(successful=True)
        return wire.DeleteParam.Response(reason=f"there is no parameter {request.name}")

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
