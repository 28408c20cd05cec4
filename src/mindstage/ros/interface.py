"""`RosInterface` offers a simulation to ROS programs: services, topics and actions under a namespace.

Its node is a `LocalNode` in this process, or a `RosbridgeClient` at any rosbridge server; programs use both in the same
way.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Protocol

import msgspec

from mindstage.access.fair_queue import current_caller
from mindstage.access.limits import Timeout
from mindstage.access.policies import EDIT, QUERY
from mindstage.access.resources import from_outside
from mindstage.bridge import GraphInfo, LocalNode, Node, RosbridgeClient
from mindstage.errors import MessageValidationError, MindstageError
from mindstage.knowledge.queries import answers_to_builtins
from mindstage.knowledge.questions import question_names
from mindstage.msgs import RosVersion, diagnostic_msgs, mindstage_msgs, visualization_msgs
from mindstage.ranges import TimeStep, checked
from mindstage.ros.diagnostics import DiagnosticsPublisher, Publisher
from mindstage.ros.endpoints import Endpoints
from mindstage.ros.engine_services import EngineServices, RecordingServices
from mindstage.ros.named_poses import NamedPoseServices
from mindstage.ros.plan_actions import PlanActions
from mindstage.ros.publishers import HighlightSubscriber, PublishRates, StatePublisher
from mindstage.ros.queries import QueryServices, parse_arguments
from mindstage.ros.robot_description import DescriptionPublisher
from mindstage.ros.robot_interface import RobotInterfaces
from mindstage.ros.robot_skills import ROBOT_SUFFIXES, RobotSkills
from mindstage.ros.rosapi import ParameterServer, RosapiServices
from mindstage.ros.service import ServiceSpec, mapped, names_elsewhere
from mindstage.ros.simulation_interfaces import EntityServices, ResourceLoader, SpawnServices
from mindstage.ros.simulation_interfaces_control import SimulationControlServices, WorldServices
from mindstage.ros.state import StateReader
from mindstage.ros.unreal_vis import UnrealVisServices
from mindstage.ros.world_control import WorldControlServices
from mindstage.scene.display import counted
from mindstage.simulation import ConnectedClient, Simulation
from mindstage.simulation.question_pool import PooledAnswers, QuestionPool

__all__ = ["QuestionServices", "RosInterface", "connected_clients"]


_TRANSPORT = "ROS"
_QUESTION_NAMESPACE = "/mindstage"
_log = logging.getLogger("mindstage.ros")


def connected_clients(node: Node) -> tuple[ConnectedClient, ...]:
    """Returns the clients of a local node, or the rosbridge server to which a client is connected."""
    if isinstance(node, RosbridgeClient):
        refused = node.refusals
        more = f"; refused {counted(len(refused), 'operation')}, first {refused[0]}" if refused else ""
        return (ConnectedClient(name=node.url, transport=_TRANSPORT, activity=f"{node.state.value}{more}"),)
    if not isinstance(node, LocalNode) or node.closed:
        return ()
    try:
        return tuple(_hub_clients(node.graph_info(), node.name))
    except MindstageError:  # it is closed meanwhile, or does not respond
        return ()


def _hub_clients(graph: GraphInfo, own_name: str) -> Iterator[ConnectedClient]:
    subscriptions = Counter(name for topic in graph.topics for name in topic.subscribers)
    publications = Counter(name for topic in graph.topics for name in topic.publishers)
    services = Counter(each.provider for each in (*graph.services, *graph.actions))
    for peer in graph.peers:
        if peer != own_name:
            counts = (
                (subscriptions[peer], "subscription"),
                (publications[peer], "publication"),
                (services[peer], "service"),
            )
            activity = ", ".join(counted(number, noun) for number, noun in counts if number)
            yield ConnectedClient(name=peer, transport=_TRANSPORT, activity=activity or "calls only")


class QuestionServices:
    """The declared questions as services: all by `/mindstage/ask`, and each under its own name."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._pool = QuestionPool.of(simulation)

    def services(self) -> Iterator[ServiceSpec]:
        """Yields all services."""
        # Also relative to the namespace: of several simulations at one server, only one can have the absolute name.
        for name in (f"{_QUESTION_NAMESPACE}/ask", "mindstage/ask"):
            yield ServiceSpec(mindstage_msgs.Ask, self.handle_ask, QUERY, name=name)
        with from_outside():
            names = question_names()
        for name in names:
            yield ServiceSpec(
                mindstage_msgs.Ask, self._question_handler(name), QUERY, name=f"{_QUESTION_NAMESPACE}/{name}"
            )

    def handle_ask(
        self, request: mindstage_msgs.Ask.Request
    ) -> mindstage_msgs.Ask.Response | Future[mindstage_msgs.Ask.Response]:
        """Answers any question; an empty answer is a success."""
        question, args = request.question, parse_arguments(request.args)
        if self._pool.accepts(question, args):
            asked = self._pool.submit(question, args, client=current_caller())
            return mapped(asked.result, _pooled_response)
        answers = self._simulation.ask(question, **args)
        return _ask_response(msgspec.json.encode(answers_to_builtins(self._simulation.knowledge, answers)))

    def _question_handler(self, name: str) -> Callable[[mindstage_msgs.Ask.Request], Any]:
        """Returns the handler of the service of one question, whose name may be left out of the request."""

        def handle(request: mindstage_msgs.Ask.Request) -> object:
            if request.question.replace("-", "_") not in {"", name}:
                cause = f"this service is for {name}, not {request.question}"
                raise MessageValidationError(
                    "mindstage_msgs/AskRequest", path="question", cause=cause, remedy="leave it empty"
                )
            return self.handle_ask(msgspec.structs.replace(request, question=name))

        return handle


def _pooled_response(done: Future[PooledAnswers]) -> mindstage_msgs.Ask.Response:
    found = done.result()
    return _ask_response(found.json if found.state is None else found.json_with(state=found.state))


def _ask_response(answers: bytes) -> mindstage_msgs.Ask.Response:
    return mindstage_msgs.Ask.Response(success=True, answers=answers.decode())


class _ServiceGroup(Protocol):
    def services(self) -> Iterator[ServiceSpec]: ...


class RosInterface:
    """Offers its services, topics and actions until `close`; the simulation and the node are not closed."""

    @checked
    def __init__(
        self,
        simulation: Simulation,
        node: Node,
        *,
        namespace: str = "unreal",
        ros: RosVersion = RosVersion.TWO,
        rates: PublishRates | None = None,
        step_s: TimeStep = 0.002,
        goal_timeout_s: Timeout = 3600.0,
        folder: Path | None = None,
        episodes: Path | None = None,
        on_quit: Callable[[], object] | None = None,
    ) -> None:
        """Creates all services, topics and actions.

        Args:
            node: a `LocalNode` in this process, or a `RosbridgeClient` at any rosbridge server.
            namespace: namespace of the services and topics of this simulation.
            ros: version of ROS for types and formats that differ in ROS 1 and ROS 2; both are accepted.
            rates: rates of the topics; None for the defaults.
            step_s: length of one step of simulation_interfaces [s].
            goal_timeout_s: largest duration of the goal of an action [s].
            folder: folder with maps and robots that every client may load and spawn; None for no files.
            episodes: folder in which every client may record episodes; None for no recordings.
            on_quit: called when a client ends the simulation; None if clients may not.

        Raises:
            AdvertiseError: one of the names is taken.
        """
        self.simulation = simulation
        self.namespace = namespace
        self.parameters = ParameterServer()
        """The parameters that rosapi returns at a local node."""
        self.parameters.set("use_sim_time", True)
        self._node = node
        self._ros = ros
        self._closed = False
        self._remove_client_source = simulation.clients.add_client_source(lambda: connected_clients(node))
        if simulation.worlds:
            simulation.mark_start()
        if isinstance(node, LocalNode):
            node.set_ros(ros, lambda: simulation.state.time_s)
        self._diagnostics_publisher = Publisher(
            node, "/mindstage/diagnostics", diagnostic_msgs.DiagnosticArray, ros=ros
        )
        self._diagnostics = diagnostics = DiagnosticsPublisher(self._diagnostics_publisher, simulation)
        self._remove_late_end = simulation.engine.on_late_end(diagnostics.report_late_end)
        self._remove_refusal_listener: Callable[[], None] = lambda: None
        if isinstance(node, RosbridgeClient):
            self._remove_refusal_listener = node.add_refusal_listener(diagnostics.report_server_refusal)
        self._endpoints = Endpoints(
            node, namespace=namespace, ros=ros, diagnostics=diagnostics, goal_timeout_s=goal_timeout_s
        )
        self._state_reader = state_reader = StateReader(simulation, has_root=bool(namespace.strip("/")))
        self._engine_services = EngineServices(state_reader, diagnostics)
        self._control_services = SimulationControlServices(simulation, step_s=step_s, on_quit=on_quit)
        self._unreal_vis = UnrealVisServices(state_reader, diagnostics)
        self._recordings = RecordingServices(simulation, episodes)
        resources = ResourceLoader(simulation.knowledge, folder)
        self._skills = RobotSkills(
            simulation, lambda name: resources.find_file(name, ROBOT_SUFFIXES), on_added=self._update_robots
        )
        self._service_groups = self._make_service_groups(resources, step_s=step_s)
        self._state_publisher: StatePublisher | None = None
        self._descriptions: DescriptionPublisher | None = None
        self._robots: RobotInterfaces | None = None
        try:
            with node.starting() if isinstance(node, LocalNode) else nullcontext():
                self._open()
                self._robots = RobotInterfaces(self._endpoints, state_reader, self.parameters, self._skills)
                self._start_publishers(rates or PublishRates())
        except BaseException:
            self.close()
            raise

    @property
    def service_names(self) -> tuple[str, ...]:
        """Absolute names of the services that it offers."""
        return self._endpoints.service_names

    def close(self) -> None:
        """Withdraws everything; calling it again is harmless."""
        if self._closed:
            return
        self._closed = True
        self._remove_client_source()
        self._remove_late_end()
        self._remove_refusal_listener()
        if self._state_publisher is not None:
            self._state_publisher.close()
        if self._descriptions is not None:
            self._descriptions.close()
        if self._robots is not None:
            self._robots.close()
        self._endpoints.close()
        self._diagnostics_publisher.close()

    def __enter__(self) -> RosInterface:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _make_service_groups(self, resources: ResourceLoader, *, step_s: float) -> tuple[_ServiceGroup, ...]:
        """Returns all objects that provide services."""
        simulation, state_reader, diagnostics = self.simulation, self._state_reader, self._diagnostics
        rosapi: tuple[RosapiServices, ...] = ()
        if isinstance(self._node, LocalNode):
            rosapi = (RosapiServices(self._node, simulation, self.parameters, ros=self._ros),)
        return (
            WorldControlServices(state_reader, diagnostics),
            self._unreal_vis,
            EntityServices(state_reader),
            NamedPoseServices(state_reader),
            WorldServices(simulation, self._control_services, resources, diagnostics),
            SpawnServices(state_reader, resources, diagnostics, step_s=step_s),
            self._control_services,
            self._engine_services,
            self._recordings,
            self._skills,
            QuestionServices(simulation),
            QueryServices(simulation),
            *rosapi,
        )

    def _start_publishers(self, rates: PublishRates) -> None:
        assert self._robots is not None
        node, reader, ros = self._node, self._state_reader, self._ros
        self._descriptions = DescriptionPublisher(node, reader, self.parameters, namespace=self.namespace, ros=ros)
        self._state_publisher = StatePublisher(
            node,
            reader,
            namespace=self.namespace,
            ros=ros,
            rates=rates,
            publish_robots=self._robots.publish,
            extra_tick=self._tick,
        )
        if isinstance(node, RosbridgeClient) and node.connected and not node.wait_advertised():
            _log.warning("%s has not yet accepted everything that is offered", node.url)

    # -- creation ------------------------------------------------------------------------------------------------------

    def _open(self) -> None:
        services = [service for group in self._service_groups for service in group.services()]
        elsewhere: frozenset[str] = frozenset()
        if isinstance(self._node, RosbridgeClient):
            names = [service.full_name(self.namespace) for service in services]
            elsewhere = names_elsewhere(self._node, names, namespace=self.namespace, ros=self._ros)
        for service in services:
            if service.full_name(self.namespace) not in elsewhere:
                self._endpoints.create_service(service)
        plans = PlanActions(self.simulation)
        for action in (
            *self._engine_services.actions(),
            *self._control_services.actions(),
            *plans.actions(),
            *self._skills.actions(),
        ):
            self._endpoints.create_action(action)
        highlights = HighlightSubscriber(self.simulation, self._diagnostics)
        self._endpoints.subscribe("highlight", mindstage_msgs.HighlightGroup, highlights.on_highlight, EDIT)
        self._endpoints.subscribe("markers", visualization_msgs.MarkerArray, self._unreal_vis.on_markers, EDIT)
        self._endpoints.subscribe("marker", visualization_msgs.Marker, self._unreal_vis.on_marker, EDIT)

    def _tick(self) -> None:
        self._endpoints.publish_status()
        self._update_robots()
        if self._robots is not None:
            self._robots.publish_status()

    def _update_robots(self) -> None:
        if self._robots is not None:
            self._robots.update()
