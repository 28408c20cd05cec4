"""Lamps: the light that bodies give, as few lights as a browser draws with ease.

Only one thread may call it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from urllib.parse import quote

import numpy as np
import viser

from mindstage.viewport.looks import Look
from mindstage.world import BodyId, Glow
from mindstage.world.geometry import Array, compose, unit_pose

__all__ = ["Lamps"]

_MOST = 3
"""So many lights at most: each makes the drawing of everything slower."""
_TOGETHER = 4.0
"""How bright all of them are [cd]: the sky lights the place already, and no picture shall be too bright."""
_REACH_M = 6.0


class Lamps:
    """The lights of all bodies that give some; the brightest, where there are many."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """None yet.

        Args:
            scene: where they are.
        """
        self._scene = scene
        self._glows: dict[BodyId, Glow] = {}
        self._lights: dict[BodyId, viser.PointLightHandle] = {}

    def show(self, looks: Mapping[BodyId, Look]) -> None:
        """Lights the lamps among these bodies, and no others."""
        glows = [(glow.intensity, id, glow) for id, look in looks.items() for glow in look.glows[:1]]
        wanted = {id: glow for _, id, glow in sorted(glows, key=lambda each: -each[0])[:_MOST]}
        if wanted == self._glows:
            return
        for light in self._lights.values():
            light.remove()
        self._glows = wanted
        together = sum(glow.intensity for glow in wanted.values())
        self._lights = {
            id: self._light(id, glow, _TOGETHER * glow.intensity / max(together, 1e-9)) for id, glow in wanted.items()
        }

    def place(self, ids: Sequence[BodyId], rows: Array) -> None:
        """Moves the lights of the bodies that moved.

        Args:
            ids: which.
            rows: n x 7.
        """
        for id, row in zip(ids, rows, strict=True):
            if (light := self._lights.get(id)) is not None:
                light.position = compose(row, unit_pose(self._glows[id].pose))[:3]

    def _light(self, id: BodyId, glow: Glow, intensity: float) -> viser.PointLightHandle:
        red, green, blue = np.round(255 * np.clip(glow.colour, 0.0, 1.0)).astype(int).tolist()
        return self._scene.add_light_point(
            f"/lamps/{quote(id, safe='')}", color=(red, green, blue), intensity=intensity, distance=_REACH_M, decay=2.0
        )
