"""Pairs of links of a robot that touch in given states, by MuJoCo's contacts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import mujoco
import numpy as np

from mindstage.scene.mesh import convex_hull
from mindstage.scene.transforms import Array

__all__ = ["touching_shares"]


def touching_shares(
    shapes: Mapping[str, Sequence[Array]],
    states: Iterable[Mapping[str, Array]],
    *,
    ignored: Iterable[tuple[str, str]] = (),
) -> dict[tuple[str, str], float]:
    """The pairs of links that touch, the lower name first, with the part of the states in which they do.

    Args:
        shapes: the convex shapes of each link, as points n x 3 in its frame; those of flat ones are left out.
        states: the frames of the links, each seven numbers in a common frame.
        ignored: pairs of links that are not tested.
    """
    spec = mujoco.MjSpec()
    names = []
    for link, parts in shapes.items():
        hulls = [hull for points in parts if (hull := convex_hull(points)) is not None]
        if not hulls:
            continue
        body = spec.worldbody.add_body(name=link)
        body.add_freejoint()
        names.append(link)
        for number, hull in enumerate(hulls):
            mesh = spec.add_mesh(name=f"{link}/{number}", uservert=hull.points.ravel().tolist())
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name)
    if len(names) < 2:
        return {}
    for first, second in ignored:
        if first in names and second in names:
            spec.add_exclude(bodyname1=first, bodyname2=second)
    model = spec.compile()
    data = mujoco.MjData(model)
    counts: dict[tuple[str, str], int] = {}
    total = 0
    for frames in states:
        total += 1
        data.qpos[:] = np.concatenate([frames[name] for name in names])
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        contact = data.contact
        bodies = model.geom_bodyid[np.reshape(contact.geom, (-1, 2))[np.ravel(contact.dist) < 0.0]] - 1
        for a, b in {(min(pair), max(pair)) for pair in bodies.tolist()}:
            first, second = sorted((names[a], names[b]))
            counts[first, second] = counts.get((first, second), 0) + 1
    return {pair: count / total for pair, count in counts.items()}
