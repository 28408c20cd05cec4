"""Carry: what was moving goes on moving when the model is made anew.

An edit gives a new model. Joint coordinates, velocities and sleep come from the old one by name; what hangs on a new
joint gets its coordinates from where it stands.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import cast

import mujoco
import numpy as np
from numpy.typing import NDArray

from mindstage.engines.joints import place_of
from mindstage.engines.mujoco.live import Joint, Live
from mindstage.world import BodyId
from mindstage.world.geometry import Array, compose, conjugate, invert, rotate

__all__ = ["carry", "coordinates", "put", "wake"]


def _update_sleep() -> Callable[[int, int], object] | None:
    """MuJoCo's own function that makes everything else agree with `tree_asleep`.

    The library exports it, its Python binding does not. Without it, what slept before an edit wakes up and falls
    asleep again by itself.
    """
    for path in Path(mujoco.__file__).parent.glob(f"*mujoco*{mujoco.__version__}*"):
        if path.suffix in {".dll", ".dylib"} or ".so" in path.name:
            function = getattr(ctypes.CDLL(str(path)), "mj_updateSleep", None)
            if function is not None:
                function.argtypes, function.restype = (ctypes.c_void_p, ctypes.c_void_p), None
                return cast("Callable[[int, int], object]", function)
    return None


_UPDATE_SLEEP = _update_sleep()
_WIDE_AWAKE = -(1 + mujoco.mjMINAWAKE)
"""From here MuJoCo counts up, once a step, while a tree does not move; at 0 it sleeps."""


def carry(
    old: Live | None,
    new: Live,
    where: Mapping[BodyId, Array],
    ends: Mapping[BodyId, tuple[Array, Array]],
    at_rest: set[BodyId],
    disturbed: NDArray[np.float64],
) -> None:
    """Sets the state of a new model.

    Args:
        old: the model before, if there was one.
        new: the model to set.
        where: poses of all bodies [m, w x y z].
        ends: the frames of constraints, as in the blueprint.
        at_rest: bodies that were just put somewhere and have no velocity.
        disturbed: k x 2 x 3, boxes (lower and upper corner) in which something changed; what sleeps there wakes up.
    """
    data = new.data
    for top, (_, velocity) in new.free.items():
        if old is not None and top in old.numbers and top not in at_rest:  # scenery had no velocity
            data.qvel[velocity : velocity + 6] = _velocity(old, top)
            if top in old.free:
                before = old.free[top][1]
                data.qacc_warmstart[velocity : velocity + 6] = old.data.qacc_warmstart[before : before + 6]
    for id, joint in new.joints.items():
        if old is not None and not _copy_joint(old, new, id, joint, at_rest):  # a first model stands as spawned
            put(new, joint, coordinates(joint, where, ends[id]))
    mujoco.mj_forward(new.model, data)
    if old is not None:
        _sleep_on(old, new, disturbed)


def coordinates(joint: Joint, where: Mapping[BodyId, Array], ends: tuple[Array, Array]) -> Array:
    """Six coordinates of a joint, from where the two bodies stand; then the quaternion, for a ball."""
    of_parent, of_child = joint.branch.seen_from_root(ends)
    fixed, moving = compose(where[joint.branch.parent], of_parent), compose(where[joint.branch.child], of_child)
    relative = compose(invert(fixed), moving)
    return np.concatenate([place_of(relative, joint.axes), relative[3:]])


def put(live: Live, joint: Joint, place: Array) -> None:
    """Sets a joint's coordinates; its velocity becomes zero."""
    position = joint.position
    for axis in joint.axes:
        if axis.slides or not joint.ball:
            live.data.qpos[position] = place[axis.index]
            position += 1
    if joint.ball:
        live.data.qpos[position : position + 4] = place[6:]
    live.data.qvel[joint.velocity : joint.velocity + len(joint.axes)] = 0.0


def _copy_joint(old: Live, new: Live, id: BodyId, joint: Joint, at_rest: set[BodyId]) -> bool:
    """Takes a joint's state over as it was; False if it was not the same joint, or its bodies were moved by hand."""
    before = old.joints.get(id)
    if before is None or before.branch.parent != joint.branch.parent or before.axes != joint.axes:
        return False
    if joint.branch.child in at_rest and joint.branch.parent not in at_rest:
        return False
    degrees = len(joint.axes)
    here = slice(joint.position, joint.position + degrees + joint.ball)
    there = slice(before.position, before.position + degrees + joint.ball)
    new.data.qpos[here] = old.data.qpos[there]
    here, there = slice(joint.velocity, joint.velocity + degrees), slice(before.velocity, before.velocity + degrees)
    new.data.qvel[here] = old.data.qvel[there]
    new.data.qacc_warmstart[here] = old.data.qacc_warmstart[there]
    return True


def _velocity(old: Live, id: BodyId) -> Array:
    """A body's velocity as a free joint has it: linear in the world, angular in the body."""
    if id in old.free:
        start = old.free[id][1]
        return np.array(old.data.qvel[start : start + 6])
    number = old.numbers[id]
    both = np.zeros(6)
    mujoco.mj_objectVelocity(old.model, old.data, mujoco.mjtObj.mjOBJ_XBODY, number, both, 0)
    quaternion = np.array(old.data.xquat[number])
    return np.concatenate([both[3:], rotate(conjugate(quaternion), both[:3])])


def _roots(live: Live) -> dict[BodyId, int]:
    """The tree of each body that the physics moves."""
    trees = live.model.body_treeid
    return {id: int(trees[number]) for id, number in live.numbers.items() if trees[number] >= 0}


def _sleep_on(old: Live, new: Live, disturbed: NDArray[np.float64]) -> None:
    """Trees that slept go on sleeping; MuJoCo links those that fell asleep together in a circle.

    A circle is kept only if each of its trees is still there and nothing changed near any of them.
    """
    trees = _roots(new)
    asleep = old.data.tree_asleep
    next_of: dict[int, int] = {}
    tree_of_old: dict[int, int] = {}
    for id, before in _roots(old).items():
        if id in trees:
            tree_of_old.setdefault(before, trees[id])
    for before, now in tree_of_old.items():
        neighbour = int(asleep[before])
        if neighbour >= 0 and neighbour in tree_of_old:
            next_of[now] = tree_of_old[neighbour]
    stirred = _stirred(new, disturbed)
    kept: set[int] = set()
    for start, following in next_of.items():
        circle, here = [start], following
        while here != start and here in next_of and len(circle) <= len(next_of):
            circle.append(here)
            here = next_of[here]
        if here == start and not stirred.intersection(circle):
            kept.update(circle)
    if kept and _UPDATE_SLEEP is not None:
        for tree in kept:
            new.data.tree_asleep[tree] = next_of[tree]
        _UPDATE_SLEEP(new.model._address, new.data._address)


def wake(live: Live, disturbed: NDArray[np.float64]) -> None:
    """Wakes all that sleeps near some boxes (k x 2 x 3), and all that fell asleep together with it.

    MuJoCo itself wakes what has a velocity; this one is too small to matter. What is about to fall asleep begins to
    count anew.
    """
    for tree in _stirred(live, disturbed):
        if live.data.tree_asleep[tree] >= 0:
            live.data.qvel[live.model.tree_dofadr[tree]] += 1e-12
        else:
            live.data.tree_asleep[tree] = _WIDE_AWAKE


def _stirred(live: Live, disturbed: NDArray[np.float64]) -> set[int]:
    """Trees whose bodies reach into a box in which something changed."""
    if not len(disturbed) or not live.model.nbody:
        return set()
    trees = live.model.body_treeid
    moving = np.flatnonzero(trees >= 0)
    geoms = np.flatnonzero(trees[live.model.geom_bodyid] >= 0)
    reach = live.model.geom_rbound[geoms, None] + 0.02
    centre = live.data.geom_xpos[geoms]
    stirred: set[int] = set()
    for low, high in disturbed:
        near = np.all((centre + reach >= low) & (centre - reach <= high), axis=1)
        stirred.update(trees[live.model.geom_bodyid[geoms[near]]].tolist())
    return stirred if len(moving) else set()
