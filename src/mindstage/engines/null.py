"""NullEngine: an engine without physics.

It implements the `Engine` protocol for worlds in which nothing moves by simulation: nothing falls or collides, and
attached bodies follow their parents. It serves for tests and as the reference implementation for authors of engines.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NoReturn

from mindstage.access.limits import Duration
from mindstage.engines.base import (
    DEFAULT_SPAWN_OPTIONS,
    Actuator,
    ActuatorState,
    Capability,
    Contact,
    DynamicsScale,
    EngineFactory,
    EngineStats,
    PoseArray,
    SavedState,
    SpawnNote,
    SpawnOptions,
    SpawnReport,
)
from mindstage.engines.kinematic_tree import coupled_body_poses
from mindstage.engines.registry import EntityRegistry
from mindstage.errors import EngineClosedError, UnsupportedByEngineError
from mindstage.ranges import Finite, ForceVector, Point, checked
from mindstage.scene import NO_GEOMETRY, BodyId, BodyPhysics, Color, GeometryMap, Material, Pose, World
from mindstage.scene.transforms import (
    Array,
    normalized_pose_array,
    pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
)

__all__ = ["NULL_ENGINE", "NullEngine"]


class NullEngine:
    """An engine in which `step` advances the time and nothing else."""

    name = "null"
    capabilities = frozenset({Capability.SAVE, Capability.FORK, Capability.STATISTICS})

    def __init__(self) -> None:
        self._registry = EntityRegistry()
        self._joint_frames: dict[BodyId, tuple[Array, Array]] = {}
        """Frame of each joint in its parent and in its child, since it was spawned."""
        self._time_s = 0.0
        self._closed = False

    @property
    def time_s(self) -> float:
        """See `Engine`; the same holds for the methods below."""
        return self._require_open()._time_s

    def spawn(
        self, world: World, *, geometry: GeometryMap = NO_GEOMETRY, options: SpawnOptions = DEFAULT_SPAWN_OPTIONS
    ) -> SpawnReport:
        added = self._require_open()._registry.add(world)
        bodies = self._registry.bodies
        for id in added.joints:
            joint = self._registry.joints[id]
            frame = normalized_pose_array(joint.pose)
            self._joint_frames[id] = (
                pose_multiply(pose_inverse(normalized_pose_array(bodies[joint.parent].pose)), frame),
                pose_multiply(pose_inverse(normalized_pose_array(bodies[joint.child].pose)), frame),
            )
        return added.report()

    @property
    def notes(self) -> tuple[SpawnNote, ...]:
        return ()

    def delete(self, ids: Iterable[BodyId]) -> None:
        self._require_open()._registry.remove(ids)

    def clear(self) -> None:
        self._require_open()._registry = EntityRegistry()
        self._time_s = 0.0

    def attach(self, parent: BodyId, child: BodyId) -> None:
        self._require_open()._registry.attach(parent, child)

    def detach(self, child: BodyId) -> None:
        self._require_open()._registry.detach(child)

    def set_pose(self, id: BodyId, pose: Pose) -> None:
        self._move(id, pose)
        registry = self._registry
        poses = {each: normalized_pose_array(body.pose) for each, body in registry.bodies.items()}
        coupled = coupled_body_poses(registry.joints, self._joint_frames, registry.bodies, poses, id)
        for other, row in coupled.items():
            self._move(other, pose_from_array(row))

    def _move(self, id: BodyId, pose: Pose) -> None:
        """Moves a body and all bodies that are attached to it."""
        registry = self._require_open()._registry
        old = registry.body(id).pose
        registry.replace(id, pose=pose)
        new_from_old = pose_multiply(normalized_pose_array(pose), pose_inverse(normalized_pose_array(old)))
        for child in registry.attached_descendants(id):
            registry.replace(
                child,
                pose=pose_from_array(pose_multiply(new_from_old, normalized_pose_array(registry.body(child).pose))),
            )

    def set_physics(self, id: BodyId, physics: BodyPhysics) -> None:
        self._require_open()._registry.replace(id, physics=physics)

    def set_materials(self, id: BodyId, materials: tuple[Material, ...]) -> None:
        self._require_open()._registry.replace(id, materials=materials)

    def set_label(self, id: BodyId, label: str) -> None:
        self._require_open()._registry.replace(id, label=label)

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
        return SavedState(_NullState(self._require_open()._registry.copy(), dict(self._joint_frames), self._time_s))

    def restore_state(self, state: SavedState) -> None:
        if not isinstance(state, _NullState):
            raise TypeError(f"expected a state from NullEngine.save_state, not {type(state).__name__}")
        self._require_open()._registry, self._time_s = state.registry.copy(), state.time_s
        self._joint_frames = dict(state.joint_frames)

    def fork(self) -> NullEngine:
        forked = NullEngine()
        forked.restore_state(self.save_state())
        return forked

    def scale_dynamics(self, scales: Mapping[BodyId, DynamicsScale]) -> None:
        raise UnsupportedByEngineError(self.name, what="scale masses and frictions", remedy="use mujoco")

    def set_actuators(self, actuators: Iterable[Actuator], *, without_weight: Iterable[BodyId] = ()) -> None:
        self._refuse_actuators()

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
    time_s: float
