"""Lamps: the light that bodies give, as few lights as a browser draws with ease.

Only one thread may call it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from urllib.parse import quote

import numpy as np
import viser

from mindstage.viewport.looks import BodyAppearance
from mindstage.world import AttachedLight, BodyId
from mindstage.world.geometry import Array, normalized_pose_array, pose_multiply

__all__ = ["LightNodes"]

_MAX_LIGHTS = 3
"""So many lights at most: each makes the drawing of everything slower."""
_TOTAL_INTENSITY = 4.0
"""How bright all of them are [cd]: the sky lights the place already, and no picture shall be too bright."""
_LIGHT_RANGE_M = 6.0


class LightNodes:
    """The lights of all bodies that give some; the brightest, where there are many."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """None yet.

        Args:
            scene: where they are.
        """
        self._scene = scene
        self._attached_lights: dict[BodyId, AttachedLight] = {}
        self._lights: dict[BodyId, viser.PointLightHandle] = {}

    def show(self, appearances: Mapping[BodyId, BodyAppearance]) -> None:
        """Lights the lamps among these bodies, and no others."""
        glows = [(glow.intensity, id, glow) for id, look in appearances.items() for glow in look.lights[:1]]
        wanted = {id: glow for _, id, glow in sorted(glows, key=lambda each: -each[0])[:_MAX_LIGHTS]}
        if wanted == self._attached_lights:
            return
        for light in self._lights.values():
            light.remove()
        self._attached_lights = wanted
        together = sum(glow.intensity for glow in wanted.values())
        self._lights = {
            id: self._add_light(id, glow, _TOTAL_INTENSITY * glow.intensity / max(together, 1e-9))
            for id, glow in wanted.items()
        }

    def set_poses(self, ids: Sequence[BodyId], rows: Array) -> None:
        """Moves the lights of the bodies that moved.

        Args:
            ids: which.
            rows: n x 7.
        """
        for id, row in zip(ids, rows, strict=True):
            if (light := self._lights.get(id)) is not None:
                light.position = pose_multiply(row, normalized_pose_array(self._attached_lights[id].pose))[:3]

    def _add_light(self, id: BodyId, attached_light: AttachedLight, intensity: float) -> viser.PointLightHandle:
        red, green, blue = np.round(255 * np.clip(attached_light.color, 0.0, 1.0)).astype(int).tolist()
        return self._scene.add_light_point(
            f"/lamps/{quote(id, safe='')}",
            color=(red, green, blue),
            intensity=intensity,
            distance=_LIGHT_RANGE_M,
            decay=2.0,
        )
