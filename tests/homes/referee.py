"""A referee of generated homes: bare MuJoCo, which measures motion and the distances between all shapes.

Contact filters and sleeping are ignored: shapes are compared whatever may collide, and all bodies are simulated.
"""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray

from mindstage.engines.mujoco.mjcf import world_to_mjcf
from mindstage.geometry import fit_geometry
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import World

__all__ = ["Referee"]

TOUCHING_M = 0.0005


class Referee:
    """A home in MuJoCo."""

    def __init__(self, world: World) -> None:
        export = world_to_mjcf(world, geometry=fit_geometry(world, KnowledgeBase()).geometry)
        self.model = mujoco.MjModel.from_xml_string(export.text, dict(export.files))
        self.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        self.data = mujoco.MjData(self.model)
        mujoco.mj_kinematics(self.model, self.data)
        shown = (self.model.geom_contype > 0) | (self.model.geom_conaffinity > 0)
        self._shapes = np.flatnonzero(shown)
        self._body = self.model.geom_bodyid
        joints = self.model.jnt_type == mujoco.mjtJoint.mjJNT_FREE
        self.loose = {int(body) for body in self.model.jnt_bodyid[joints]}
        self.hinged = [int(joint) for joint in np.flatnonzero(~joints)]

    def moved(self, seconds: float) -> dict[str, float]:
        """How far bodies move [m], those that move by more than 1 cm."""
        start = self.data.xpos.copy()
        while self.data.time < seconds:
            mujoco.mj_step(self.model, self.data)
        distance = np.linalg.norm(self.data.xpos - start, axis=1)
        return {self.model.body(int(body)).name: float(distance[body]) for body in np.flatnonzero(distance > 0.01)}

    def overlaps(self) -> set[tuple[str, str]]:
        """The pairs of bodies whose shapes overlap in the current pose."""
        return {
            pair for shape in self._shapes for pair in self._overlaps_of(int(shape), self._shapes[self._shapes > shape])
        }

    def hit_while_opening(self) -> set[tuple[str, str]]:
        """The fronts that hit something that is not loose, with what they hit."""
        found = set()
        parents = self.model.body_parentid
        fixed = np.array([shape for shape in self._shapes if int(self._body[shape]) not in self.loose])
        for joint in self.hinged:
            root = self.model.jnt_bodyid[joint]
            own = (self._body[fixed] == root) | (parents[self._body[fixed]] == root)
            low, high = self.model.jnt_range[joint]
            for position in np.linspace(low, high, 6):
                self.data.qpos[:] = self.model.qpos0
                self.data.qpos[self.model.jnt_qposadr[joint]] = position
                mujoco.mj_kinematics(self.model, self.data)
                found |= {pair for shape in fixed[own] for pair in self._overlaps_of(int(shape), fixed[~own])}
        return found

    def _overlaps_of(self, shape: int, others: NDArray[np.int64]) -> Iterator[tuple[str, str]]:
        position, radius = self.data.geom_xpos, self.model.geom_rbound
        reach = radius[shape] + radius[others]
        others = others[np.linalg.norm(position[others] - position[shape], axis=1) <= reach]
        for other in others[self._body[others] != self._body[shape]]:
            if mujoco.mj_geomDistance(self.model, self.data, int(shape), int(other), 0.01, None) < -TOUCHING_M:
                names = [self.model.body(int(self._body[each])).name for each in (shape, other)]
                yield names[0], names[1]
