"""Models for kinematic queries: chains of joints without geometry, and contacts in states that are not simulated.

A chain has one body for each of its links and a site at the frame of interest. It has neither shapes nor forces, so
that forward kinematics and Jacobians cost microseconds. A `ContactModel` is a copy of a running model in which joints
and bodies are put somewhere, and only the contacts of those that move are computed.
"""

from __future__ import annotations

import copy
from collections.abc import Collection, Iterable, Mapping, Sequence
from enum import StrEnum
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from mindstage.engines.mujoco.state import CompiledModel
from mindstage.scene import BodyId
from mindstage.scene.mesh import convex_hull
from mindstage.scene.transforms import Array, pose_inverse, pose_multiply, rotation_matrix

__all__ = ["FRAME_SITE", "ChainJoint", "ChainJointType", "ContactModel", "compile_chain", "touching_shares"]

FRAME_SITE = "frame"
"""The name of the site at the end of a chain."""


class ChainJointType(StrEnum):
    """The types of the joints of a chain."""

    HINGE = "hinge"
    SLIDE = "slide"


class ChainJoint(NamedTuple):
    """A joint of a chain, and the link that it moves."""

    name: str
    type: ChainJointType
    origin: Array
    """The joint frame in the link before, seven numbers; that of the link at position 0."""
    axis: tuple[float, float, float]
    """In the joint frame."""
    range: tuple[float, float] | None = None
    """[m or rad]."""


def compile_chain(joints: Sequence[ChainJoint], frame: Array) -> Any:
    """Compiles a chain, whose coordinates are the positions of the joints in their order.

    Args:
        joints: the joints from the base to the tip.
        frame: the frame of interest in the last link, seven numbers.

    Returns:
        An `MjModel` with the site `FRAME_SITE`.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    body = spec.worldbody
    for joint in joints:
        body = body.add_body(pos=joint.origin[:3], quat=joint.origin[3:])
        body.explicitinertial, body.mass, body.inertia = True, 1.0, np.ones(3)
        kind = mujoco.mjtJoint.mjJNT_HINGE if joint.type is ChainJointType.HINGE else mujoco.mjtJoint.mjJNT_SLIDE
        added = body.add_joint(name=joint.name, type=kind, axis=joint.axis)
        if joint.range is not None:
            added.limited, added.range = True, joint.range
    body.add_site(name=FRAME_SITE, pos=frame[:3], quat=frame[3:])
    return spec.compile()


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


_RESTING_UP, _RESTING_M = 0.5, 0.001
"""Least vertical component of the contact normal, and largest distance [m], of a body that rests on another one."""
_MOVING_BIT = 8
"""The bit of `contype` and `conaffinity` of the contacts that are computed; `compiler` uses 1, 2 and 4."""


class ContactModel:
    """A copy of a compiled model for the contacts of some bodies in given states; the original is not changed."""

    def __init__(
        self,
        compiled: CompiledModel,
        *,
        moving: Collection[BodyId],
        ignored: Collection[BodyId] = (),
        carried: Mapping[BodyId, BodyId] | None = None,
        clearance_m: float = 0.0,
    ) -> None:
        """Copies the model and its state.

        Args:
            compiled: the model.
            moving: the bodies of which contacts are computed, with one another and with all others; bodies that are
                attached to them are included.
            ignored: bodies whose contacts are left out.
            carried: loose bodies, each with the one by which it is held and with which it moves.
            clearance_m: pairs that are nearer than this are reported [m].
        """
        self._compiled = compiled
        self.model: Any = copy.copy(compiled.model)
        self.data: Any = mujoco.MjData(self.model)
        self.data.qpos[:] = compiled.data.qpos
        self.ids: tuple[BodyId | None, ...] = (*compiled.rows, None)
        """The bodies; the last one, also at row -1, is a ground plane that the engine has added."""
        self._carried: list[tuple[int, int, Array]] = []
        self._resting: dict[int, list[tuple[int, Array]]] = {}
        """For bodies on joints that were moved, the addresses of what rests on them, and its pose there."""
        self.update()
        self._roots = roots = {
            compiled.body_ids[id]: address for id, (address, _) in compiled.free_joint_addresses.items()
        }
        """The address in `qpos` of each loose body."""
        welds = {self._weld(id) for id in moving} - {0}
        for id, holder in (carried or {}).items():
            if (root := self._weld(id)) in roots:
                pose = pose_multiply(pose_inverse(self.pose(holder)), self._pose_of(root))
                self._carried.append((roots[root], compiled.body_ids[holder], pose))
                welds.add(root)
        is_moving = np.isin(self.model.body_weldid[self.model.geom_bodyid], list(welds))
        self._set_contacts(is_moving, ignored, clearance_m)
        rows = set(compiled.geom_rows[is_moving].tolist())
        self.moving = frozenset(id for id, row in compiled.rows.items() if row in rows or id in moving)
        """The bodies of which contacts are computed."""

    @property
    def loose(self) -> frozenset[BodyId]:
        """The bodies that are neither fixed nor on joints."""
        return frozenset(id for id in self._compiled.rows if self._weld(id) in self._roots)

    def _weld(self, id: BodyId) -> int:
        """The MuJoCo body that is the root of the rigid group of a body; 0 for those that are fixed."""
        return int(self.model.body_weldid[self._compiled.body_ids.get(id, 0)])

    def _set_contacts(self, is_moving: NDArray[np.bool_], ignored: Collection[BodyId], clearance_m: float) -> None:
        """Leaves only the contacts of the geoms that move."""
        model, rows = self.model, self._compiled.rows
        is_ignored = np.isin(self._compiled.geom_rows, [rows[id] for id in ignored if id in rows])
        collides = ((model.geom_contype != 0) | (model.geom_conaffinity != 0)) & ~is_ignored
        model.geom_contype[:] = np.where(collides & is_moving, _MOVING_BIT, 0)
        model.geom_conaffinity[:] = np.where(collides, _MOVING_BIT, 0)
        model.geom_margin[is_moving] = clearance_m

    def has_joint(self, joint: BodyId) -> bool:
        """Whether a joint is simulated in the model."""
        return joint in self._compiled.joints

    def address(self, joint: BodyId) -> tuple[int, float]:
        """Where the position of a joint with one axis is in `data.qpos`, and its sign there.

        Positions are relative to the spawned one [m or rad]; `update` makes changes effective.

        Raises:
            KeyError: the joint is not simulated.
        """
        each = self._compiled.joints[joint]
        return each.qpos_address, -1.0 if each.tree_joint.is_reversed else 1.0

    def set_joint(self, joint: BodyId, position: float) -> None:
        """Moves a joint with one axis, such as that of a drawer, and the loose bodies that rest on what it moves.

        `update` makes it effective.

        Args:
            joint: the joint.
            position: relative to its spawned position [m or rad].

        Raises:
            KeyError: the joint is not simulated.
        """
        address, sign = self.address(joint)
        holder = self._compiled.joints[joint].body_id
        if holder not in self._resting:
            self._resting[holder] = self._resting_on(holder)
        self.data.qpos[address] = sign * position
        if not self._resting[holder]:
            return
        self.update()
        for free_address, relative in self._resting[holder]:
            self.data.qpos[free_address : free_address + 7] = pose_multiply(self._pose_of(holder), relative)

    def _resting_on(self, holder: int) -> list[tuple[int, Array]]:
        """The addresses of the loose bodies that rest on a body, or on one that does, and their poses in its frame."""
        model = self._compiled.model  # its contacts are those of all bodies
        mujoco.mj_collision(model, self.data)
        contact = self.data.contact
        bodies = model.body_weldid[model.geom_bodyid[np.array(contact.geom, dtype=np.intp).reshape(-1, 2)]]
        up = np.array(contact.frame, dtype=float).reshape(-1, 9)[:, 2]
        rests = (np.abs(up) > _RESTING_UP) & (np.array(contact.dist) < _RESTING_M)
        ends = np.where(up[:, None] > 0.0, bodies, bodies[:, ::-1])[rests]
        carried = {address for address, _, _ in self._carried}
        found, count = {int(model.body_weldid[holder])}, 0
        while len(found) > count:
            count = len(found)
            found.update(above for below, above in ends.tolist() if below in found and above in self._roots)
        return [
            (self._roots[root], pose_multiply(pose_inverse(self._pose_of(holder)), self._pose_of(root)))
            for root in found
            if root in self._roots and root != holder and self._roots[root] not in carried
        ]

    def set_planar_pose(self, joint: BodyId, x: float, y: float, yaw: float) -> None:
        """Puts the body on a joint with two horizontal slides and a vertical hinge somewhere on the floor.

        Args:
            joint: the joint.
            x: of the origin of the body that it moves [m].
            y: of the same [m].
            yaw: direction of the x axis of the body [rad].

        Raises:
            KeyError: the joint is not simulated.
        """
        each = self._compiled.joints[joint]
        slides = [each.qpos_address + offset for offset, axis in enumerate(each.axes) if axis.is_prismatic]
        hinges = [each.qpos_address + offset for offset, axis in enumerate(each.axes) if not axis.is_prismatic]
        first = int(self.model.body_jntadr[each.body_id])
        directions = np.array(self.data.xaxis[first : first + len(slides)])[:, :2].T
        up = float(self.data.xaxis[first + len(slides), 2])
        forward = self.data.xmat[each.body_id].reshape(3, 3)[:, 0]
        turn = yaw - float(np.arctan2(forward[1], forward[0]))
        self.data.qpos[hinges[0]] += np.sign(up) * ((turn + np.pi) % (2 * np.pi) - np.pi)
        mujoco.mj_kinematics(self.model, self.data)
        away = np.array([x, y]) - self.data.xpos[each.body_id][:2]
        self.data.qpos[slides] += np.linalg.solve(directions, away)

    def update(self) -> None:
        """Computes the poses of all bodies from the joints."""
        mujoco.mj_kinematics(self.model, self.data)

    def carry(self) -> None:
        """Puts what is carried where its holder has it; `update` comes before."""
        if not self._carried:
            return
        for address, holder, relative in self._carried:
            self.data.qpos[address : address + 7] = pose_multiply(self._pose_of(holder), relative)
        self.update()

    def move_rigidly(self, ids: Collection[BodyId], transform: Array) -> None:
        """Moves some bodies as one rigid body, whatever joints they are on; until the next `update`.

        Args:
            ids: the bodies.
            transform: a pose of seven numbers that is applied to them in the world frame.
        """
        data = self.data
        bodies = np.isin(self.model.body_weldid, [self._weld(id) for id in ids])
        geoms = bodies[self.model.geom_bodyid]
        rotation = rotation_matrix(transform[3:])
        for points, matrices, chosen in (
            (data.xpos, data.xmat, bodies),
            (data.xipos, data.ximat, bodies),
            (data.geom_xpos, data.geom_xmat, geoms),
        ):
            points[chosen] = transform[:3] + points[chosen] @ rotation.T
            matrices[chosen] = (rotation @ matrices[chosen].reshape(-1, 3, 3)).reshape(-1, 9)

    def pose(self, id: BodyId) -> Array:
        """The pose of a body, seven numbers."""
        if (body_id := self._compiled.body_ids.get(id)) is None:
            row = self._compiled.rows[id]
            return np.array(self._compiled.scenery_poses[self._compiled.scenery == row][0])
        return self._pose_of(body_id)

    def _pose_of(self, body_id: int) -> Array:
        return np.concatenate([self.data.xpos[body_id], self.data.xquat[body_id]])

    def moving_bounds(self) -> Array:
        """The axis-aligned box around spheres about the geoms of `moving`, 2 x 3 [m]."""
        rows = [self._compiled.rows[id] for id in self.moving]
        geoms = np.isin(self._compiled.geom_rows, rows)
        centers, radii = self.data.geom_xpos[geoms], self.model.geom_rbound[geoms, None]
        return np.array([(centers - radii).min(axis=0), (centers + radii).max(axis=0)])

    def near_geoms(self) -> tuple[NDArray[np.intp], Array]:
        """The pairs of geoms that are nearer than the clearance, n x 2, and their distances [m]."""
        mujoco.mj_collision(self.model, self.data)
        contact = self.data.contact
        return np.array(contact.geom, dtype=np.intp).reshape(-1, 2), np.array(contact.dist, dtype=float)

    def body_rows(self, geoms: NDArray[np.intp]) -> NDArray[np.intp]:
        """The row of the body of each geom in `ids`."""
        return np.asarray(self._compiled.geom_rows[geoms])
