"""NullEngine: an engine without physics.

It implements the `Engine` protocol for worlds in which nothing moves by simulation: nothing falls or collides, and
attached bodies follow their parents. It serves for tests and as the reference implementation for authors of engines.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NoReturn

import msgspec
import numpy as np

from mindstage.access.limits import Duration
from mindstage.engines.base import (
    ActuatorState,
    Applied,
    Capability,
    Contact,
    DynamicsScale,
    EngineFactory,
    EngineStats,
    PoseArray,
    SavedState,
    SpawnNote,
)
from mindstage.engines.editing import EditingEngine, Performed, pose_row
from mindstage.engines.edits import RestoreBodies, SetActuators, SimulatedBodies
from mindstage.engines.entity_registry import EntityRegistry
from mindstage.engines.kinematic_tree import coupled_body_poses
from mindstage.errors import EngineClosedError, UnsupportedByEngineError
from mindstage.ranges import Finite, ForceVector, Point, checked
from mindstage.scene import BodyGeometry, BodyId, Color, Joint, Pose, World
from mindstage.scene.edits import Attach, BodyEdit, Delete, Detach, Edit, Spawn
from mindstage.scene.transforms import (
    Array,
    normalized_pose_array,
    pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
)

__all__ = ["NULL_ENGINE", "NullEngine"]


class NullEngine(EditingEngine):
    """An engine in which `step` advances the time and nothing else."""

    name = "null"
    capabilities = frozenset({Capability.SAVE, Capability.FORK, Capability.STATISTICS})

    def __init__(self) -> None:
        self._registry = EntityRegistry()
        self._joint_frames: dict[BodyId, tuple[Array, Array]] = {}
        """Frame of each joint in its parent and in its child, since it was spawned."""
        self._geometry: dict[BodyId, BodyGeometry] = {}
        self._key = object()
        self._time_s = 0.0
        self._closed = False

    @property
    def time_s(self) -> float:
        """See `Engine`; the same holds for the methods below."""
        return self._require_open()._time_s

    @property
    def state_key(self) -> object:
        return self._key

    @property
    def notes(self) -> tuple[SpawnNote, ...]:
        return ()

    def clear(self) -> None:
        self._require_open()._registry = EntityRegistry()
        self._time_s, self._key, self._geometry = 0.0, object(), {}

    # -- edits ---------------------------------------------------------------------------------------------------------

    def apply(self, edit: Edit) -> Applied:
        applied = super().apply(edit)
        self._key = object()
        return applied

    def _entities(self) -> EntityRegistry:
        return self._require_open()._registry

    def _perform(self, edit: Edit) -> Performed:
        registry = self._registry
        match edit:
            case Spawn():
                added = registry.add(edit.world)
                self._geometry |= {id: edit.geometry[id] for id in added.bodies if id in edit.geometry}
                for id in added.joints:
                    self._joint_frames[id] = self._frames_of(registry.joints[id])
                return Performed(added.report())
            case Delete():
                registry.remove(edit.bodies)
            case Attach():
                registry.attach(edit.parent, edit.child)
            case Detach():
                registry.detach(edit.child)
            case BodyEdit():
                registry.change(edit)
            case SetActuators():
                self._refuse_actuators()
        return Performed()

    def _frames_of(self, joint: Joint) -> tuple[Array, Array]:
        frame, bodies = normalized_pose_array(joint.pose), self._registry.bodies
        of_parent, of_child = (
            pose_multiply(pose_inverse(normalized_pose_array(bodies[end].pose)), frame)
            for end in (joint.parent, joint.child)
        )
        return of_parent, of_child

    def _decisions(self, ids: Collection[BodyId]) -> tuple[SimulatedBodies, Mapping[BodyId, BodyGeometry]]:
        joints = {joint.id for joint in self._registry.fragment(ids).joints}
        frames = {id: (pose_row(a), pose_row(b)) for id, (a, b) in self._joint_frames.items() if id in joints}
        return SimulatedBodies(joint_frames=frames), {id: self._geometry[id] for id in ids if id in self._geometry}

    def _restore(self, edit: RestoreBodies, displaced: Mapping[BodyId, Array]) -> None:
        bodies = (
            body if tuple(edit.poses[body.id]) == (*body.pose.position, *body.pose.quaternion)
            else msgspec.structs.replace(body, pose=pose_from_array(edit.poses[body.id]))
            for body in edit.world.bodies
        )  # fmt: skip
        self._registry.restore(msgspec.structs.replace(edit.world, bodies=tuple(bodies)))
        self._geometry |= edit.geometry
        self._joint_frames |= {id: (np.array(a), np.array(b)) for id, (a, b) in edit.decisions.joint_frames.items()}
        for id, row in displaced.items():
            self._move(id, pose_from_array(row))

    def _actuators_inverse(self, edit: SetActuators) -> SetActuators:
        self._refuse_actuators()

    def _set_pose(self, id: BodyId, pose: Pose, *, restores: bool) -> None:
        self._move(id, pose)
        registry = self._registry
        if not any(joint.mimic for joint in registry.joints.values()):
            return
        poses = {each: normalized_pose_array(body.pose) for each, body in registry.bodies.items()}
        coupled = coupled_body_poses(registry.joints, self._joint_frames, registry.bodies, poses, id)
        for other, row in coupled.items():
            self._move(other, pose_from_array(row))

    def _move(self, id: BodyId, pose: Pose) -> None:
        """Moves a body and all bodies that are attached to it."""
        registry = self._registry
        old = registry.body(id).pose
        registry.move(id, pose)
        new_from_old = pose_multiply(normalized_pose_array(pose), pose_inverse(normalized_pose_array(old)))
        for child in registry.attached_descendants(id):
            registry.move(
                child,
                pose_from_array(pose_multiply(new_from_old, normalized_pose_array(registry.body(child).pose))),
            )

    # -- the rest of the protocol --------------------------------------------------------------------------------------

    def highlight(self, ids: Iterable[BodyId], color: Color | None) -> None:
        self._require_open()._registry.highlight(ids, color)

    def highlights(self) -> Mapping[BodyId, Color]:
        return MappingProxyType(self._require_open()._registry.highlighted)

    @checked
    def apply_force(self, id: BodyId, force: ForceVector, point: Point | None = None) -> None:
        self._require_open()._registry.body(id)

    @checked
    def step(self, duration_s: Duration) -> None:
        self._require_open()._time_s += duration_s
        self._key = object()

    def poses(self) -> tuple[tuple[BodyId, ...], PoseArray]:
        bodies = self._require_open()._registry.bodies
        return self._registry.ids, pose_array(body.pose for body in bodies.values())

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        return {}

    def stats(self) -> EngineStats:
        self._require_open()
        return EngineStats(movable=0, awake=0, contacts=0)

    def snapshot(self) -> World:
        return self._require_open()._registry.to_world(joint_frames=self._joint_frames)

    def save_state(self) -> SavedState:
        registry = self._require_open()._registry.copy()
        return SavedState(_NullState(registry, dict(self._joint_frames), dict(self._geometry), self._time_s, self._key))

    def restore_state(self, state: SavedState) -> None:
        if not isinstance(state, _NullState):
            raise TypeError(f"expected a state from NullEngine.save_state, not {type(state).__name__}")
        self._require_open()._registry, self._time_s = state.registry.copy(), state.time_s
        self._joint_frames, self._geometry = dict(state.joint_frames), dict(state.geometry)
        self._key = state.key

    def fork(self) -> NullEngine:
        forked = NullEngine()
        forked.restore_state(self.save_state())
        return forked

    def scale_dynamics(self, scales: Mapping[BodyId, DynamicsScale]) -> None:
        raise UnsupportedByEngineError(self.name, what="scale masses and frictions", remedy="use mujoco")

    @checked
    def set_commands(self, commands: Mapping[str, Finite]) -> None:
        self._refuse_actuators()

    def actuator_states(self) -> Mapping[str, ActuatorState]:
        self._refuse_actuators()

    def _refuse_actuators(self) -> NoReturn:
        self._require_open()
        raise UnsupportedByEngineError(self.name, what="drive joints", remedy="use mujoco")

    def contacts(self) -> tuple[Contact, ...]:
        raise UnsupportedByEngineError(self.name, what="report contacts", remedy="use mujoco")

    def close(self) -> None:
        self._closed = True

    def _require_open(self) -> NullEngine:
        if self._closed:
            raise EngineClosedError(self.name)
        return self


NULL_ENGINE = EngineFactory(("null",), lambda name, settings: NullEngine())


@dataclass(frozen=True, slots=True)
class _NullState:
    registry: EntityRegistry
    joint_frames: dict[BodyId, tuple[Array, Array]]
    geometry: dict[BodyId, BodyGeometry]
    time_s: float
    key: object
