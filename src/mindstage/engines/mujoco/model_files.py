"""Compiled models in the user's cache folder, so that a world that was spawned before need not be compiled again.

MuJoCo does not validate a binary model: one that someone has prepared could do anything. Files are therefore read from
a folder only that belongs to the user and that nobody else can write to, never from where maps or episodes are, and
each has a checksum. Their names are hashes of all that a model depends on, MuJoCo and this program included.
"""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from hashlib import blake2b
from pathlib import Path
from typing import Any

import msgspec
import mujoco
import numpy as np

from mindstage.engines.kinematic_tree import TreeJoint, is_ball, movable_axes
from mindstage.engines.mujoco.arena import new_data
from mindstage.engines.mujoco.compiler import ModelInput, arena_size, compile_model
from mindstage.engines.mujoco.state import CompiledModel, ModelActuators, ModelJoint
from mindstage.errors import EngineError
from mindstage.files import cache_dir, cached_content, is_own_folder, modules_of
from mindstage.scene import BodyId
from mindstage.scene.collision_shapes import primitive_collision_type

__all__ = ["stored_model"]

_MIN_BODIES = 50
"""Smaller models are compiled faster than read."""
_MAX_BYTES = 256 << 20
"""Total size from which the least recently used files are deleted."""
_DIGEST_BYTES = 16
_PACKAGES = ("", "engines", "engines/mujoco", "scene")
"""The folders with the modules that compile models."""


class _StoredModel(msgspec.Struct, frozen=True, array_like=True):
    """A compiled model, and where bodies and joints are in it."""

    model: bytes
    body_ids: dict[BodyId, int]
    scenery: list[int]
    joints: list[tuple[BodyId, int, int, int]]
    """The id of each joint, its addresses in `qpos` and `qvel`, and the number of the body that it moves."""
    free: dict[BodyId, tuple[int, int]]
    kinematic: dict[BodyId, tuple[int, int]]
    geom_rows: list[int]
    actuators: tuple[tuple[str, ...], list[int], list[int], list[float]]


def stored_model(model_input: ModelInput) -> CompiledModel:
    """The model of an input: read from the cache if it was compiled before, else compiled and stored.

    Raises:
        EngineUnavailableError: MuJoCo refuses the model, with its message as the cause.
    """
    if len(model_input.rows) < _MIN_BODIES:
        return compile_model(model_input)
    folder = cache_dir("models")
    if not is_own_folder(folder):
        return compile_model(model_input)
    compiled: list[CompiledModel] = []

    def make() -> bytes:
        compiled.append(compile_model(model_input))
        encoded = msgspec.msgpack.encode(_stored(compiled[0]))
        return _checksum(encoded) + encoded

    path = folder / f"{_digest(model_input)}.model"
    content = cached_content(path, make, max_bytes=_MAX_BYTES)
    if compiled:
        return compiled[0]
    with suppress(msgspec.DecodeError, ValueError, EngineError):  # it is damaged
        if content[:_DIGEST_BYTES] == _checksum(content[_DIGEST_BYTES:]):
            return _restored(msgspec.msgpack.decode(content[_DIGEST_BYTES:], type=_StoredModel), model_input)
    with suppress(OSError):
        path.unlink()
    return compile_model(model_input)


def _checksum(content: bytes) -> bytes:
    return blake2b(content, digest_size=_DIGEST_BYTES).digest()


def _stored(compiled: CompiledModel) -> _StoredModel:
    buffer = np.empty(mujoco.mj_sizeModel(compiled.model), dtype=np.uint8)
    mujoco.mj_saveModel(compiled.model, None, buffer)
    names, positions, dofs, signs = compiled.actuators
    return _StoredModel(
        buffer.tobytes(),
        compiled.body_ids,
        compiled.scenery.tolist(),
        [(id, each.qpos_address, each.dof_address, each.body_id) for id, each in compiled.joints.items()],
        compiled.free_joint_addresses,
        compiled.kinematic_addresses,
        compiled.geom_rows.tolist(),
        (names, positions, dofs, signs),
    )


def _restored(stored: _StoredModel, model_input: ModelInput) -> CompiledModel:
    name = "stored.mjb"
    model: Any = mujoco.MjModel.from_binary_path(name, {name: stored.model})
    forest, joints = model_input.forest, dict[BodyId, ModelJoint]()
    known = {each.joint.id: each for each in (*forest.tree_joints.values(), *forest.loop_joints)}
    for id, qpos, dof, body in stored.joints:
        axes = movable_axes(known[id].joint, is_reversed=known[id].is_reversed)
        joints[id] = ModelJoint(known[id], axes, is_ball(axes), qpos, dof, body)
    rows = model_input.rows
    order = np.fromiter((stored.body_ids.get(id, 0) for id in rows), dtype=np.intp, count=len(rows))
    scenery = np.array(stored.scenery, dtype=np.intp)
    return CompiledModel(
        model, new_data(model), rows, stored.body_ids, order, scenery, model_input.poses[scenery], joints, stored.free,
        stored.kinematic, np.array(stored.geom_rows, dtype=np.intp), ModelActuators(*stored.actuators),
        model_input.arena_cap_bytes,
    )  # fmt: skip


@cache
def _program() -> tuple[object, ...]:
    return mujoco.__version__, modules_of(Path(__file__).parents[2], _PACKAGES)


def _digest(model_input: ModelInput) -> str:
    """A hash of all that the model depends on."""
    builder, forest = model_input.builder, model_input.forest
    filtered, actuators = builder.collision_filter, builder.actuators

    def joint(each: TreeJoint) -> tuple[object, ...]:
        frames = builder.joint_frames[each.joint.id]
        return each.joint, each.parent, each.child, *(frame.tobytes() for frame in frames)

    def body(id: BodyId) -> tuple[object, ...]:
        described, geometry, attached = (
            model_input.bodies[id],
            builder.geometry.get(id),
            builder.attachment_poses.get(id),
        )
        shapes, _ = builder.collision_shapes(id)
        return (
            id, shapes, described.physics, primitive_collision_type(described), model_input.masses[id],
            None if geometry is None else (geometry.friction, geometry.restitution, geometry.density, geometry.inertia),
            id in filtered.non_colliding, builder.collides_with_ground(id), id in model_input.linked,
            id in actuators.weightless, None if attached is None else attached.tobytes(),
        )  # fmt: skip

    content = (
        _program(), model_input.timestep_s, model_input.kinematics_driven, model_input.has_mocap_bodies,
        model_input.is_divisible, arena_size(model_input, len(model_input.rows)), model_input.poses.tobytes(),
        model_input.sizes.tobytes(),
        [body(id) for id in model_input.rows],
        [(each.root, each.mobility, each.mass_kg, each.bodies) for each in forest.groups.values()],
        [(root, *joint(each)) for root, each in forest.tree_joints.items()],
        [joint(each) for each in forest.loop_joints],
        sorted(model_input.excluded_pairs), builder.ground, list(actuators.actuators.items()), actuators.axes,
    )  # fmt: skip
    return blake2b(msgspec.msgpack.encode(content), digest_size=_DIGEST_BYTES).hexdigest()
