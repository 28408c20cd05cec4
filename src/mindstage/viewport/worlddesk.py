"""World desk: what is there, how time runs, and what is known of what a visitor has selected."""

from __future__ import annotations

import time
from collections.abc import Container, Iterator, Mapping, Sequence
from typing import Annotated

import msgspec

from mindstage.errors import BodyUnknown, MindstageError
from mindstage.stage import Frame, Joint, Spawned, Stage
from mindstage.stage.joints import poses_in
from mindstage.viewport.channel import Channel
from mindstage.viewport.details import Details, Kept, details_of, live_of
from mindstage.viewport.outline import outline_of
from mindstage.viewport.visitor import Visitor
from mindstage.world import Body, BodyId, Constraint, Iri, World

__all__ = ["SELECTED", "Clock", "WorldDesk"]

SELECTED = "selected"
"""What a visitor has selected, in the visitor's `state`."""
_LONGEST_STEP_S = 10.0
_LOOKED_AT_WITHIN_S = 5.0
_LOOK_S = 0.03
_QUESTION = "storage_place_in_environment"
_MOST_KEPT = 12


class Play(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Lets time pass."""

    speed: Annotated[float, msgspec.Meta(gt=0.0, le=20.0)] = 1.0


class Step(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Lets some time pass, and no more."""

    duration_s: Annotated[float, msgspec.Meta(gt=0.0, le=_LONGEST_STEP_S)] = 0.1


class Nothing(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What needs no more words."""


class About(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A body."""

    id: BodyId


class Clock(msgspec.Struct, frozen=True, kw_only=True):
    """How time runs."""

    time_s: float
    playing: bool
    speed: float
    real_time_factor: float
    """Simulated seconds in a second."""
    bodies: int
    fault: str


class WorldDesk:
    """Tells all pages of the world, and does what their buttons of time say."""

    def __init__(self, stage: Stage, channel: Channel) -> None:
        """Offers what it does.

        Args:
            stage: whose world it is.
            channel: to the pages.
        """
        self._stage, self._channel = stage, channel
        self._world: World | None = None
        self._bodies: Mapping[BodyId, Body] = {}
        self._constraints: Mapping[BodyId, Sequence[Constraint]] = {}
        self._joints: dict[BodyId, Joint] = {}
        self._spawned = Spawned({}, {})
        self._editions = 0
        channel.offer("play", Play, lambda _, wish: stage.play(speed=wish.speed))
        channel.offer("pause", Nothing, lambda _, wish: stage.pause())
        channel.offer("step", Step, self._step)
        channel.offer("reset", Nothing, lambda _, wish: stage.editing.reset())
        channel.offer("details", About, self._details, lane="details")

    # -- for the thread that follows the world -------------------------------------------------------------------------

    def rebuilt(self, world: World, *, shells: Container[BodyId]) -> None:
        """Something came, went or changed."""
        constraints: dict[BodyId, list[Constraint]] = {}
        for joint in world.constraints:
            for end in (joint.parent, joint.child):
                constraints.setdefault(end, []).append(joint)
        self._bodies = {body.id: body for body in world.bodies}
        self._constraints, self._joints = constraints, {}
        self._spawned = Spawned.of(self._stage.worlds)
        self._world = world
        self._channel.publish("scene_tree", outline_of(world, engine=self._stage.engine_name, shells=shells))
        # The outline is the same where only a mass has changed; whoever reads the details has to look again.
        self._editions += 1
        self._channel.publish("details_changed", self._editions)

    def tell(self, frame: Frame) -> None:
        """Tells what changes all the time; called some times in a second."""
        self._channel.publish("clock", _clock(frame))
        self._channel.publish("history", _next_ones(self._stage))
        told: dict[BodyId, object] = {}
        for visitor in self._channel.visitors:
            id = visitor.state.get(SELECTED)
            if id is not None and id in self._bodies:
                if id not in told:
                    told[id] = self._live(id, frame)
                if told[id] is not None:
                    visitor.let_see("live_details", told[id])

    def joint(self, id: BodyId) -> Joint:
        """A constraint of the world.

        Raises:
            BodyUnknown: there is none of that id.
        """
        constraint = next((each for each in (self._world.constraints if self._world else ()) if each.id == id), None)
        if constraint is None:
            raise BodyUnknown(id, known=[each.id for each in self._world.constraints] if self._world else ())
        return self._joint(constraint)

    # -- what is asked -------------------------------------------------------------------------------------------------

    def _step(self, _: Visitor, wish: Step) -> None:
        self._stage.pause()
        self._stage.step(wish.duration_s)

    def _details(self, _: Visitor, wish: About) -> Details:
        body, world = self._described(wish.id)
        form = self._stage.forms.get(body.id)
        return details_of(
            body,
            world,
            ancestors=self._stage.knowledge.ancestors(body.cls),
            joints=self._joints_of(body.id),
            storage_places=self._kept(body.cls),
            geometry="" if form is None else f"{form.kind}: {form.why}" if form.why else form.kind,
        )

    def _described(self, id: BodyId) -> tuple[Body, World]:
        """A body as it is described; what has just come is there a moment before it was looked at.

        Raises:
            BodyUnknown: there is none of that id.
        """
        end = time.monotonic() + _LOOKED_AT_WITHIN_S
        while id not in self._bodies and id in self._stage.frame.ids and time.monotonic() < end:
            time.sleep(_LOOK_S)
        world, body = self._world, self._bodies.get(id)
        if world is None or body is None:
            raise BodyUnknown(id, known=self._bodies, world=world.name if world else "")
        return body, world

    def _kept(self, cls: Iri) -> Iterator[Kept]:
        """Where such things are kept, as far as it is known."""
        ids = {body.iri: body.id for body in self._bodies.values()}
        places: dict[str, list[BodyId]] = {}
        try:
            rows = list(self._stage.ask(_QUESTION, item=cls))
        except MindstageError:
            return  # a class that only the map names, of which nothing is known: no answer is no error here
        for row in rows[:_MOST_KEPT]:
            if row.individual in ids:
                places.setdefault(row.place, []).append(ids[row.individual])
        for place, found in places.items():
            yield Kept(class_name=place.rpartition("#")[2], ids=tuple(dict.fromkeys(found)))

    # -- joints --------------------------------------------------------------------------------------------------------

    def _live(self, id: BodyId, frame: Frame) -> object:
        wanted = {id, *(end for each in self._constraints.get(id, ()) for end in (each.parent, each.child))}
        poses = poses_in(frame, wanted)
        return live_of(id, poses, self._joints_of(id)) if wanted <= poses.keys() else None

    def _joints_of(self, id: BodyId) -> list[Joint]:
        found = [
            self._joint(each)
            for each in self._constraints.get(id, ())
            if {each.parent, each.child} <= self._bodies.keys()
        ]
        return [joint for joint in found if joint.axes]

    def _joint(self, constraint: Constraint) -> Joint:
        if constraint.id not in self._joints:
            self._joints[constraint.id] = Joint(constraint, self._bodies, self._spawned)
        return self._joints[constraint.id]


def _clock(frame: Frame) -> Clock:
    return Clock(
        time_s=round(frame.time_s, 2),
        playing=frame.playing,
        speed=frame.speed,
        real_time_factor=round(frame.real_time_factor, 2),
        bodies=len(frame.ids),
        fault=frame.fault,
    )


def _next_ones(stage: Stage) -> dict[str, str | None]:
    """What the two buttons would do."""
    history = stage.editing.history
    return {"undo": next(iter(history.undo), None), "redo": next(iter(history.redo), None)}
