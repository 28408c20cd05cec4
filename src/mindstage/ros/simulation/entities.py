"""Entities: which there are, where they are and what they are.

An entity is a body, and its name is the body's id.
"""

from __future__ import annotations

from collections.abc import Iterator

from mindstage.bridge.description import pose_array_messages, pose_from_message
from mindstage.errors import BodyNotFoundError, PoseUnreachableError
from mindstage.knowledge.names import local_name
from mindstage.msgs import builtin_interfaces, geometry_msgs, std_msgs
from mindstage.msgs import simulation_interfaces as wire
from mindstage.ros.offer import ServiceSpec
from mindstage.ros.results import OK, ResultError, unsupported
from mindstage.ros.sight import StateReader
from mindstage.ros.simulation.filters import category_of, filter_entities, tags_of
from mindstage.world import BodyId

__all__ = ["WORLD_FRAME", "EntityServices", "bounds_of"]

WORLD_FRAME = "world"
"""What the world's frame is called in replies."""


class EntityServices:
    """Tells of bodies and moves them."""

    def __init__(self, state_reader: StateReader) -> None:
        self._state_reader = state_reader
        self._simulation = state_reader.simulation

    def services(self) -> Iterator[ServiceSpec]:
        """All services."""
        yield ServiceSpec(wire.GetEntities, self.get_entities)
        yield ServiceSpec(wire.GetEntitiesStates, self.get_states)
        yield ServiceSpec(wire.GetEntityState, self.get_state, quick=True)
        yield ServiceSpec(wire.SetEntityState, self.set_state)
        yield ServiceSpec(wire.GetEntityInfo, self.get_info)
        yield ServiceSpec(wire.SetEntityInfo, self.set_info)
        yield ServiceSpec(wire.GetEntityBounds, self.get_bounds)
        yield ServiceSpec(wire.DeleteEntity, self.delete)

    def get_entities(self, request: wire.GetEntities.Request) -> wire.GetEntities.Response:
        """The names of those that pass the filters."""
        return wire.GetEntities.Response(result=OK, entities=filter_entities(self._state_reader, request.filters))

    def get_states(self, request: wire.GetEntitiesStates.Request) -> wire.GetEntitiesStates.Response:
        """The same with where they are."""
        ids = filter_entities(self._state_reader, request.filters)
        frame = self._state_reader.state()
        rows = self._state_reader.row_by_id(frame)
        there = tuple(id for id in ids if id in rows)
        poses = pose_array_messages(frame.poses[[rows[id] for id in there]].reshape(-1, 7))
        header = self._header()
        states = tuple(wire.EntityState(header=header, pose=pose) for pose in poses)
        return wire.GetEntitiesStates.Response(result=OK, entities=there, states=states)

    def get_state(self, request: wire.GetEntityState.Request) -> wire.GetEntityState.Response:
        """Where one is. Engines do not tell how fast a body is, so twist and acceleration are zero."""
        (pose,) = pose_array_messages(self._state_reader.pose(request.entity)[None])
        return wire.GetEntityState.Response(result=OK, state=wire.EntityState(header=self._header(), pose=pose))

    def set_state(self, request: wire.SetEntityState.Request) -> wire.SetEntityState.Response:
        """Puts one somewhere else, at rest; the pose may be told in the frame of another one."""
        self._state_reader.require([request.entity])
        if request.set_twist or request.set_acceleration:
            raise unsupported("only the pose of an entity can be set, not how it moves")
        if request.set_pose:
            state, id = request.state, BodyId(request.entity)
            try:
                pose = self._state_reader.to_world_frame(pose_from_message(state.pose), state.header.frame_id)
                self._simulation.run_on_engine(lambda engine: engine.set_pose(id, pose), label="set pose")
            except (BodyNotFoundError, PoseUnreachableError) as error:
                raise ResultError(wire.SetEntityStateCode.INVALID_POSE, str(error)) from error
        return wire.SetEntityState.Response(result=OK)

    def get_info(self, request: wire.GetEntityInfo.Request) -> wire.GetEntityInfo.Response:
        """What one is: its label or else its class; among the tags, its class is the first."""
        body = self._state_reader.body(request.entity)
        info = wire.EntityInfo(
            category=wire.EntityCategory(category=category_of(body)),
            description=body.label or local_name(body.cls),
            tags=tags_of(body),
        )
        return wire.GetEntityInfo.Response(result=OK, info=info)

    def set_info(self, request: wire.SetEntityInfo.Request) -> wire.SetEntityInfo.Response:
        """Refuses: what a thing is stands in its map."""
        self._state_reader.require([request.entity])
        raise unsupported("what an entity is comes from its map; tell the knowledge base more instead")

    def get_bounds(self, request: wire.GetEntityBounds.Request) -> wire.GetEntityBounds.Response:
        """How much room one takes, seen from itself; empty where nobody told its size."""
        return wire.GetEntityBounds.Response(result=OK, bounds=bounds_of(self._state_reader.body(request.entity).size))

    def delete(self, request: wire.DeleteEntity.Request) -> wire.DeleteEntity.Response:
        """Takes one away."""
        id = BodyId(request.entity)
        self._simulation.run_on_engine(lambda engine: engine.delete((id,)), label="delete", edits=True)
        return wire.DeleteEntity.Response(result=OK)

    def _header(self) -> std_msgs.Header:
        return std_msgs.Header(stamp=builtin_interfaces.Time.at(self._simulation.state.time_s), frame_id=WORLD_FRAME)


def bounds_of(size: tuple[float, float, float] | None) -> wire.Bounds:
    """The box around a body, in its own frame: the upper and the lower corner."""
    if size is None:
        return wire.Bounds()
    x, y, z = (extent / 2 for extent in size)
    return wire.Bounds(
        type=wire.BoundsType.TYPE_BOX,
        points=(geometry_msgs.Vector3(x=x, y=y, z=z), geometry_msgs.Vector3(x=-x, y=-y, z=-z)),
    )
