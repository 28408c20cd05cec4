"""World desk: what is there, how time runs, and what is known of what a visitor has selected."""

from __future__ import annotations

import time
from collections.abc import Container, Iterator, Mapping, Sequence
from typing import Annotated

import msgspec

from mindstage.errors import BodyNotFoundError, MindstageError
from mindstage.stage import JointHandle, Simulation, SpawnRecord, StateSnapshot
from mindstage.stage.joints import poses_in
from mindstage.viewport.channel import RpcChannel
from mindstage.viewport.details import BodyDetails, StorageHint, body_details, live_details
from mindstage.viewport.outline import scene_tree
from mindstage.viewport.visitor import ClientSession
from mindstage.world import Body, BodyId, Iri, Joint, World

__all__ = ["SELECTED", "ClockMessage", "WorldHandler"]

SELECTED = "selected"
"""What a visitor has selected, in the visitor's `state`."""
_MAX_STEP_S = 10.0
_DETAILS_LIFETIME_S = 5.0
_DETAILS_INTERVAL_S = 0.03
_STORAGE_QUESTION = "storage_place_in_environment"
_MAX_STORAGE_PLACES = 12


class PlayRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Lets time pass."""

    speed: Annotated[float, msgspec.Meta(gt=0.0, le=20.0)] = 1.0


class StepRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Lets some time pass, and no more."""

    duration_s: Annotated[float, msgspec.Meta(gt=0.0, le=_MAX_STEP_S)] = 0.1


class EmptyRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What needs no more words."""


class DetailsRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A body."""

    id: BodyId


class ClockMessage(msgspec.Struct, frozen=True, kw_only=True):
    """How time runs."""

    time_s: float
    playing: bool
    speed: float
    real_time_factor: float
    """Simulated seconds in a second."""
    bodies: int
    fault: str


class WorldHandler:
    """Tells all pages of the world, and does what their buttons of time say."""

    def __init__(self, simulation: Simulation, channel: RpcChannel) -> None:
        """Offers what it does.

        Args:
            stage: whose world it is.
            channel: to the pages.
        """
        self._simulation, self._channel = simulation, channel
        self._world: World | None = None
        self._bodies: Mapping[BodyId, Body] = {}
        self._joint_by_id: Mapping[BodyId, Sequence[Joint]] = {}
        self._joints: dict[BodyId, JointHandle] = {}
        self._spawn_record = SpawnRecord({}, {})
        self._revisions = 0
        channel.register("play", PlayRequest, lambda _, wish: simulation.play(speed=wish.speed))
        channel.register("pause", EmptyRequest, lambda _, wish: simulation.pause())
        channel.register("step", StepRequest, self._step)
        channel.register("reset", EmptyRequest, lambda _, wish: simulation.editing.reset())
        channel.register("details", DetailsRequest, self._details, queue="details")

    # -- for the thread that follows the world -------------------------------------------------------------------------

    def on_rebuild(self, world: World, *, enclosing: Container[BodyId]) -> None:
        """Something came, went or changed."""
        constraints: dict[BodyId, list[Joint]] = {}
        for joint in world.joints:
            for end in (joint.parent, joint.child):
                constraints.setdefault(end, []).append(joint)
        self._bodies = {body.id: body for body in world.bodies}
        self._joint_by_id, self._joints = constraints, {}
        self._spawn_record = SpawnRecord.from_worlds(self._simulation.worlds)
        self._world = world
        self._channel.publish("scene_tree", scene_tree(world, engine=self._simulation.engine_name, enclosing=enclosing))
        # The outline is the same where only a mass has changed; whoever reads the details has to look again.
        self._revisions += 1
        self._channel.publish("details_changed", self._revisions)

    def publish(self, frame: StateSnapshot) -> None:
        """Tells what changes all the time; called some times in a second."""
        self._channel.publish("clock", _clock_message(frame))
        self._channel.publish("history", _undo_labels(self._simulation))
        told: dict[BodyId, object] = {}
        for visitor in self._channel.sessions:
            id = visitor.state.get(SELECTED)
            if id is not None and id in self._bodies:
                if id not in told:
                    told[id] = self._live(id, frame)
                if told[id] is not None:
                    visitor.publish_to("live_details", told[id])

    def joint(self, id: BodyId) -> JointHandle:
        """A constraint of the world.

        Raises:
            BodyNotFoundError: there is none of that id.
        """
        constraint = next((each for each in (self._world.joints if self._world else ()) if each.id == id), None)
        if constraint is None:
            raise BodyNotFoundError(id, known=[each.id for each in self._world.joints] if self._world else ())
        return self._joint_handle(constraint)

    # -- what is asked -------------------------------------------------------------------------------------------------

    def _step(self, _: ClientSession, request: StepRequest) -> None:
        self._simulation.pause()
        self._simulation.step(request.duration_s)

    def _details(self, _: ClientSession, request: DetailsRequest) -> BodyDetails:
        body, world = self._described_body(request.id)
        form = self._simulation.geometry.get(body.id)
        return body_details(
            body,
            world,
            ancestors=self._simulation.knowledge.ancestors(body.cls),
            joints=self._joints_of(body.id),
            storage_places=self._storage_places(body.cls),
            geometry="" if form is None else f"{form.shape_name}: {form.reason}" if form.reason else form.shape_name,
        )

    def _described_body(self, id: BodyId) -> tuple[Body, World]:
        """A body as it is described; what has just come is there a moment before it was looked at.

        Raises:
            BodyNotFoundError: there is none of that id.
        """
        end = time.monotonic() + _DETAILS_LIFETIME_S
        while id not in self._bodies and id in self._simulation.state.ids and time.monotonic() < end:
            time.sleep(_DETAILS_INTERVAL_S)
        world, body = self._world, self._bodies.get(id)
        if world is None or body is None:
            raise BodyNotFoundError(id, known=self._bodies, world=world.name if world else "")
        return body, world

    def _storage_places(self, cls: Iri) -> Iterator[StorageHint]:
        """Where such things are kept, as far as it is known."""
        ids = {body.iri: body.id for body in self._bodies.values()}
        places: dict[str, list[BodyId]] = {}
        try:
            rows = list(self._simulation.ask(_STORAGE_QUESTION, item=cls))
        except MindstageError:
            return  # a class that only the map names, of which nothing is known: no answer is no error here
        for row in rows[:_MAX_STORAGE_PLACES]:
            if row.individual in ids:
                places.setdefault(row.place, []).append(ids[row.individual])
        for place, found in places.items():
            yield StorageHint(class_name=place.rpartition("#")[2], ids=tuple(dict.fromkeys(found)))

    # -- joints --------------------------------------------------------------------------------------------------------

    def _live(self, id: BodyId, frame: StateSnapshot) -> object:
        wanted = {id, *(end for each in self._joint_by_id.get(id, ()) for end in (each.parent, each.child))}
        poses = poses_in(frame, wanted)
        return live_details(id, poses, self._joints_of(id)) if wanted <= poses.keys() else None

    def _joints_of(self, id: BodyId) -> list[JointHandle]:
        found = [
            self._joint_handle(each)
            for each in self._joint_by_id.get(id, ())
            if {each.parent, each.child} <= self._bodies.keys()
        ]
        return [joint for joint in found if joint.axes]

    def _joint_handle(self, joint: Joint) -> JointHandle:
        if joint.id not in self._joints:
            self._joints[joint.id] = JointHandle(joint, self._bodies, self._spawn_record)
        return self._joints[joint.id]


def _clock_message(frame: StateSnapshot) -> ClockMessage:
    return ClockMessage(
        time_s=round(frame.time_s, 2),
        playing=frame.playing,
        speed=frame.speed,
        real_time_factor=round(frame.real_time_factor, 2),
        bodies=len(frame.ids),
        fault=frame.error,
    )


def _undo_labels(simulation: Simulation) -> dict[str, str | None]:
    """What the two buttons would do."""
    history = simulation.editing.history
    return {"undo": next(iter(history.undo), None), "redo": next(iter(history.redo), None)}
