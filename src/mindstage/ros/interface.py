"""RosFace: a stage as a robot's programs see it: services, topics and actions under a namespace.

It stands at a hub of ours, or at somebody else's rosbridge by way of a client; the programs cannot tell.

Guests: which programs are connected over rosbridge, as a stage's own people see it.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol, TypeVar

from mindstage.bridge import GraphInfo, LocalNode, Node, RosbridgeClient, Subscription
from mindstage.errors import MindstageError
from mindstage.msgs import Message, RosVersion, decode, diagnostic_msgs, mindstage_msgs, type_name, visualization_msgs
from mindstage.ros.actionlib import ActionlibServer
from mindstage.ros.diagnostics import DiagnosticsPublisher, Publisher
from mindstage.ros.engine_services import EngineServices
from mindstage.ros.publishers import HighlightSubscriber, PublishRates, StatePublisher
from mindstage.ros.queries import QuestionServices
from mindstage.ros.rosapi import RosapiServices
from mindstage.ros.service import ActionSpec, ServiceSpec, action_handler, service_handler
from mindstage.ros.simulation_interfaces import EntityServices, ResourceLoader, SpawnServices
from mindstage.ros.simulation_interfaces_control import SimulationControlServices, WorldServices
from mindstage.ros.state import StateReader
from mindstage.ros.unreal_vis import UnrealVisServices
from mindstage.ros.world_control import WorldControlServices
from mindstage.simulation import ConnectedClient, Simulation

__all__ = ["RosInterface", "connected_clients"]


_TRANSPORT = "ROS"


def connected_clients(node: Node) -> tuple[ConnectedClient, ...]:
    """Who is connected to a hub of ours, or the rosbridge that we are connected to."""
    if isinstance(node, RosbridgeClient):
        return (ConnectedClient(name=node.url, transport=_TRANSPORT, activity=node.state.value),)
    if not isinstance(node, LocalNode) or node.closed:
        return ()
    try:
        return tuple(_hub_clients(node.graph_info(), node.name))
    except MindstageError:  # it is being closed, or has better things to do
        return ()


def _hub_clients(graph: GraphInfo, own_name: str) -> Iterator[ConnectedClient]:
    hears = Counter(name for topic in graph.topics for name in topic.subscribers)
    says = Counter(name for topic in graph.topics for name in topic.publishers)
    offers = Counter(each.provider for each in (*graph.services, *graph.actions))
    for peer in graph.peers:
        if peer != own_name:
            parts = ((hears[peer], "topics heard"), (says[peer], "told"), (offers[peer], "services offered"))
            does = ", ".join(f"{count} {what}" for count, what in parts if count)
            yield ConnectedClient(name=peer, transport=_TRANSPORT, activity=does or "calls only")


M = TypeVar("M", bound=Message)

_log = logging.getLogger("mindstage.ros")


class _ServiceGroup(Protocol):
    def services(self) -> Iterator[ServiceSpec]: ...


class RosInterface:
    """Offers everything from when it is made until `close`; the stage and the participant live on."""

    def __init__(
        self,
        simulation: Simulation,
        node: Node,
        *,
        namespace: str = "unreal",
        ros: RosVersion = RosVersion.TWO,
        rates: PublishRates | None = None,
        step_s: float = 0.002,
        goal_timeout_s: float = 3600.0,
        folder: Path | None = None,
        on_quit: Callable[[], object] | None = None,
    ) -> None:
        """Offers it all.

        Args:
            stage: whose face it is.
            participant: a `LocalNode` in this process, or a `Client` at any rosbridge.
            namespace: what the names of this stage's own services and topics begin with.
            ros: whose words to use where ROS 1 and ROS 2 differ; both are understood.
            rates: how often topics are told; None is the usual.
            step_s: how long one step of simulation_interfaces is [s].
            goal_timeout_s: how long a goal of an action may take [s].
            folder: maps and robots in it may be loaded and spawned by anyone who can call; None is none.
            on_quit: called when somebody wants the simulation to end; None where nobody may.

        Raises:
            AdvertiseError: one of the names is taken.
        """
        self.simulation = simulation
        self.namespace = namespace
        self._node = node
        self._ros = ros
        self._goal_timeout_s = goal_timeout_s
        self._services: list[str] = []
        self._actions: list[str] = []
        self._closed = False
        self._remove_client_source = simulation.clients.add_client_source(lambda: connected_clients(node))
        self._diagnostics_publisher = Publisher(
            node, "/mindstage/diagnostics", diagnostic_msgs.DiagnosticArray, ros=ros
        )
        self._diagnostics = diagnostics = DiagnosticsPublisher(self._diagnostics_publisher, simulation)
        self._state_reader = sight = StateReader(simulation)
        self._engine_services = EngineServices(sight, diagnostics)
        self._control_services = SimulationControlServices(simulation, step_s=step_s, on_quit=on_quit)
        self._unreal_vis = UnrealVisServices(sight, diagnostics)
        self._service_groups = self._make_service_groups(ResourceLoader(simulation.knowledge, folder), step_s=step_s)
        self._action_topics: list[ActionlibServer] = []
        self._subscriptions: list[Subscription] = []
        self._state_publisher: StatePublisher | None = None
        try:
            self._open()
            self._state_publisher = StatePublisher(
                node, sight, namespace=namespace, ros=ros, rates=rates or PublishRates(), extra_tick=self._tick
            )
        except BaseException:
            self.close()  # half a face is none
            raise

    def close(self) -> None:
        """Takes it all back; any number of times."""
        if self._closed:
            return
        self._closed = True
        self._remove_client_source()
        if self._state_publisher is not None:
            self._state_publisher.close()
        for topics in self._action_topics:
            topics.close()
        for inlet in self._subscriptions:
            inlet.close()
        for action in self._actions:
            self._node.destroy_action_server(action)
        for service in self._services:
            self._node.destroy_service(service)
        self._diagnostics_publisher.close()

    def __enter__(self) -> RosInterface:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _make_service_groups(self, resources: ResourceLoader, *, step_s: float) -> tuple[_ServiceGroup, ...]:
        """Everything that offers services, each for a part of what a stage can do."""
        stage, sight, diagnostics = self.simulation, self._state_reader, self._diagnostics
        looking = (RosapiServices(self._node, stage, ros=self._ros),) if isinstance(self._node, LocalNode) else ()
        return (
            WorldControlServices(sight, diagnostics),
            self._unreal_vis,
            EntityServices(sight),
            WorldServices(stage, resources, diagnostics),
            SpawnServices(sight, resources, diagnostics, step_s=step_s),
            self._control_services,
            self._engine_services,
            QuestionServices(stage),
            *looking,
        )

    # -- offering ------------------------------------------------------------------------------------------------------

    def _open(self) -> None:
        for room in self._service_groups:
            for service in room.services():
                self._create_service(service)
        for action in (*self._engine_services.actions(), *self._control_services.actions()):
            self._create_action(action)
        highlights = HighlightSubscriber(self.simulation, self._diagnostics)
        self._subscribe("highlight", mindstage_msgs.LitBodies, highlights.on_highlight)
        self._subscribe("markers", visualization_msgs.MarkerArray, self._unreal_vis.on_markers)
        self._subscribe("marker", visualization_msgs.Marker, self._unreal_vis.on_marker)

    def _create_service(self, spec: ServiceSpec) -> None:
        name = spec.full_name(self.namespace)
        handler = service_handler(name, spec.type, spec.handler, diagnostics=self._diagnostics, ros=self._ros)
        self._node.create_service(name, type_name(spec.type, self._ros), handler, quick=spec.quick)
        if spec.timeout_s is not None and isinstance(self._node, LocalNode):
            self._node.set_service_timeout(name, spec.timeout_s)
        self._services.append(name)

    def _create_action(self, spec: ActionSpec) -> None:
        name = spec.full_name(self.namespace)
        handler = action_handler(
            name, spec, diagnostics=self._diagnostics, ros=self._ros, timeout_s=self._goal_timeout_s
        )
        self._node.create_action_server(name, type_name(spec.type, self._ros), handler)
        topics = ActionlibServer(self._node, name, spec.type, handler, diagnostics=self._diagnostics, ros=self._ros)
        self._action_topics.append(topics)
        self._actions.append(name)

    def _subscribe(self, name: str, type: type[M], handler: Callable[[M], None]) -> None:
        """Acts on messages; what is wrong with one is told on the diagnostics, since nobody waits for a reply."""
        topic = "/".join(("", *filter(None, self.namespace.split("/")), name))

        def on_message(message: Any) -> None:
            try:
                handler(decode(type, message))
            except MindstageError as error:
                self._diagnostics.report_error(name, error)

        self._subscriptions.append(self._node.subscribe(topic, on_message, type=type_name(type, self._ros)))

    def _tick(self) -> None:
        for topics in self._action_topics:
            topics.publish_status()
