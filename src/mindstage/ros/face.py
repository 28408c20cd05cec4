"""RosFace: a stage as a robot's programs see it: services, topics and actions under a namespace.

It stands at a hub of ours, or at somebody else's rosbridge by way of a client; the programs cannot tell.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol, TypeVar

from mindstage.bridge import Hub, Participant, Subscription
from mindstage.errors import MindstageError
from mindstage.msgs import Message, RosVersion, decode, diagnostic_msgs, mindstage_msgs, type_name, visualization_msgs
from mindstage.ros.action_topics import ActionTopics
from mindstage.ros.asking import Asking
from mindstage.ros.broadcast import Broadcast, Rates
from mindstage.ros.diagnostics import Diagnostics
from mindstage.ros.far_engine import FarEngine
from mindstage.ros.guests import guests_at
from mindstage.ros.highlights import Highlights
from mindstage.ros.offer import ActionOffer, ServiceOffer
from mindstage.ros.outcomes import answering
from mindstage.ros.outlet import Outlet
from mindstage.ros.reaching import reaching
from mindstage.ros.resources import Resources
from mindstage.ros.rosapi import Rosapi
from mindstage.ros.sight import Sight
from mindstage.ros.simulation import Entities, Running, Spawning, Worlds
from mindstage.ros.unreal_vis import UnrealVis
from mindstage.ros.world_control import WorldControl
from mindstage.stage import Stage

__all__ = ["RosFace"]

M = TypeVar("M", bound=Message)

_log = logging.getLogger("mindstage.ros")


class _Room(Protocol):
    def offers(self) -> Iterator[ServiceOffer]: ...


class RosFace:
    """Offers everything from when it is made until `close`; the stage and the participant live on."""

    def __init__(
        self,
        stage: Stage,
        participant: Participant,
        *,
        namespace: str = "unreal",
        ros: RosVersion = RosVersion.TWO,
        rates: Rates | None = None,
        step_s: float = 0.002,
        goal_timeout_s: float = 3600.0,
        folder: Path | None = None,
        on_quit: Callable[[], object] | None = None,
    ) -> None:
        """Offers it all.

        Args:
            stage: whose face it is.
            participant: a `Hub` in this process, or a `Client` at any rosbridge.
            namespace: what the names of this stage's own services and topics begin with.
            ros: whose words to use where ROS 1 and ROS 2 differ; both are understood.
            rates: how often topics are told; None is the usual.
            step_s: how long one step of simulation_interfaces is [s].
            goal_timeout_s: how long a goal of an action may take [s].
            folder: maps and robots in it may be loaded and spawned by anyone who can call; None is none.
            on_quit: called when somebody wants the simulation to end; None where nobody may.

        Raises:
            OfferRefused: one of the names is taken.
        """
        self.stage = stage
        self.namespace = namespace
        self._participant = participant
        self._ros = ros
        self._goal_timeout_s = goal_timeout_s
        self._services: list[str] = []
        self._actions: list[str] = []
        self._closed = False
        self._farewell = stage.company.introduce(lambda: guests_at(participant))
        self._outlet = Outlet(participant, "/mindstage/diagnostics", diagnostic_msgs.DiagnosticArray, ros=ros)
        self._diagnostics = diagnostics = Diagnostics(self._outlet, stage)
        self._sight = sight = Sight(stage)
        self._far = FarEngine(sight, diagnostics)
        self._running = Running(stage, step_s=step_s, on_quit=on_quit)
        self._vis = UnrealVis(sight, diagnostics)
        self._rooms = self._furnished(Resources(stage.knowledge, folder), step_s=step_s)
        self._action_topics: list[ActionTopics] = []
        self._inlets: list[Subscription] = []
        self._broadcast: Broadcast | None = None
        try:
            self._open()
            self._broadcast = Broadcast(
                participant, sight, namespace=namespace, ros=ros, rates=rates or Rates(), also=self._tick
            )
        except BaseException:
            self.close()  # half a face is none
            raise

    def close(self) -> None:
        """Takes it all back; any number of times."""
        if self._closed:
            return
        self._closed = True
        self._farewell()
        if self._broadcast is not None:
            self._broadcast.close()
        for topics in self._action_topics:
            topics.close()
        for inlet in self._inlets:
            inlet.close()
        for action in self._actions:
            self._participant.withdraw_action(action)
        for service in self._services:
            self._participant.withdraw_service(service)
        self._outlet.close()

    def __enter__(self) -> RosFace:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _furnished(self, resources: Resources, *, step_s: float) -> tuple[_Room, ...]:
        """Everything that offers services, each for a part of what a stage can do."""
        stage, sight, diagnostics = self.stage, self._sight, self._diagnostics
        looking = (Rosapi(self._participant, stage, ros=self._ros),) if isinstance(self._participant, Hub) else ()
        return (
            WorldControl(sight, diagnostics),
            self._vis,
            Entities(sight),
            Worlds(stage, resources, diagnostics),
            Spawning(sight, resources, diagnostics, step_s=step_s),
            self._running,
            self._far,
            Asking(stage),
            *looking,
        )

    # -- offering ------------------------------------------------------------------------------------------------------

    def _open(self) -> None:
        for room in self._rooms:
            for service in room.offers():
                self._offer_service(service)
        for action in (*self._far.actions(), *self._running.actions()):
            self._offer_action(action)
        highlights = Highlights(self.stage, self._diagnostics)
        self._listen("highlight", mindstage_msgs.LitBodies, highlights.on_highlight)
        self._listen("markers", visualization_msgs.MarkerArray, self._vis.on_markers)
        self._listen("marker", visualization_msgs.Marker, self._vis.on_marker)

    def _offer_service(self, offer: ServiceOffer) -> None:
        name = offer.place(self.namespace)
        handler = answering(name, offer.type, offer.answer, diagnostics=self._diagnostics, ros=self._ros)
        self._participant.offer_service(name, type_name(offer.type, self._ros), handler, quick=offer.quick)
        if offer.patience_s is not None and isinstance(self._participant, Hub):
            self._participant.be_patient(name, offer.patience_s)
        self._services.append(name)

    def _offer_action(self, offer: ActionOffer) -> None:
        name = offer.place(self.namespace)
        handler = reaching(name, offer, diagnostics=self._diagnostics, ros=self._ros, timeout_s=self._goal_timeout_s)
        self._participant.offer_action(name, type_name(offer.type, self._ros), handler)
        topics = ActionTopics(
            self._participant, name, offer.type, handler, diagnostics=self._diagnostics, ros=self._ros
        )
        self._action_topics.append(topics)
        self._actions.append(name)

    def _listen(self, name: str, type: type[M], handle: Callable[[M], None]) -> None:
        """Acts on messages; what is wrong with one is told on the diagnostics, since nobody waits for a reply."""
        topic = "/".join(("", *filter(None, self.namespace.split("/")), name))

        def on_message(message: Any) -> None:
            try:
                handle(decode(type, message))
            except MindstageError as error:
                self._diagnostics.broke(name, error)

        self._inlets.append(self._participant.subscribe(topic, on_message, type=type_name(type, self._ros)))

    def _tick(self) -> None:
        for topics in self._action_topics:
            topics.tick()
