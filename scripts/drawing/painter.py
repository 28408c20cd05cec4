"""Painter: one form as a picture, in NumPy: triangles over a depth buffer, a soft light, a shadow on the ground.

It is slow and simple, and the same everywhere: pictures in the documents do not depend on anybody's graphics.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from mindstage.scene import BodyGeometry, VisualMesh

__all__ = ["Painter"]

Array = NDArray[np.float64]

_FINE = 2
"""Each pixel is the mean of so many by so many."""
_LIGHT = np.array([0.62, 0.22, 0.75])
_FILLED = 0.74
"""How much of the picture the form takes up."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Painter:
    """A camera and a sheet of paper."""

    pixels: int = 180
    azimuth_rad: float = 0.6
    """From the front towards the left."""
    elevation_rad: float = 0.42
    paper: tuple[int, int, int] = (250, 249, 246)

    def picture(self, form: BodyGeometry) -> Image.Image:
        """The form on its ground, as large as fits."""
        size = self.pixels * _FINE
        view = self._view()
        points = np.concatenate([skin.points for skin in form.visuals])
        seen = points @ view.T
        low, high = seen.min(axis=0), seen.max(axis=0)
        scale = _FILLED * size / float((high - low)[:2].max())
        center = (low + high) / 2
        sheet = _Sheet(size, view, scale, center, (np.array(self.paper) / 255) ** 2.2)
        sheet.shadow([skin for skin in form.visuals if skin.material.opacity > 0.5], float(points[:, 2].min()))
        for skin in sorted(form.visuals, key=lambda skin: -skin.material.opacity):
            sheet.paint(skin)
        return sheet.finished(self.pixels)

    def _view(self) -> Array:
        """Rows: right, up and towards the camera."""
        out = np.array(
            [
                np.cos(self.elevation_rad) * np.cos(self.azimuth_rad),
                np.cos(self.elevation_rad) * np.sin(self.azimuth_rad),
                np.sin(self.elevation_rad),
            ]
        )
        right = np.cross([0.0, 0.0, 1.0], out)
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(out, right), out])


class _Sheet:
    """A picture while it is painted, in linear light."""

    def __init__(self, size: int, view: Array, scale: float, center: Array, paper: Array) -> None:
        self.size, self.view, self.scale, self.center = size, view, scale, center
        self.color = np.tile(paper, (size, size, 1))
        self.depth = np.full((size, size), -np.inf)

    def shadow(self, skins: list[VisualMesh], ground: float) -> None:
        """What stands in the light's way, laid on the ground and blurred."""
        mask = np.zeros((self.size, self.size))
        for skin in skins:
            fallen = skin.points - (skin.points[:, 2:] - ground) / _LIGHT[2] * _LIGHT * 0.6
            fallen[:, 2] = ground
            corners = self._on_sheet(fallen)[skin.faces]
            for triangle in corners:
                if (found := _covered(triangle, self.size)) is not None:
                    rows, columns, inside, _ = found
                    mask[rows, columns] = np.maximum(mask[rows, columns], inside)
        blurred = Image.fromarray((mask * 255).astype(np.uint8)).filter(ImageFilter.GaussianBlur(self.size / 70))
        self.color *= 1.0 - 0.4 * (np.asarray(blurred, dtype=np.float64) / 255)[..., None]

    def paint(self, skin: VisualMesh) -> None:
        """Paints what is nearer than what is there; what can be seen through leaves the depth as it is."""
        corners = self._on_sheet(skin.points)[skin.faces]
        shade = self._shades(skin)
        clear = skin.material.opacity < 1.0
        if clear:  # the far side first
            order = np.argsort(corners[:, :, 2].mean(axis=1))
            corners, shade = corners[order], shade[order]
        for triangle, light in zip(corners, shade, strict=True):
            found = _covered(triangle, self.size)
            if found is None:
                continue
            rows, columns, inside, weights = found
            depth = weights @ triangle[:, 2]
            nearer = inside & (depth > self.depth[rows, columns])
            painted = weights @ light
            old = self.color[rows, columns]
            amount = skin.material.opacity if clear else 1.0
            self.color[rows, columns] = np.where(nearer[..., None], old + (painted - old) * amount, old)
            if not clear:
                self.depth[rows, columns] = np.where(nearer, depth, self.depth[rows, columns])

    def finished(self, pixels: int) -> Image.Image:
        """The picture with its creases darkened, at its final size."""
        depth = np.where(np.isfinite(self.depth), self.depth, np.nan)
        there = ~np.isnan(depth)
        if there.any():
            flat = np.where(there, depth, np.nanmin(depth))
            reach = float(flat.max() - flat.min()) or 1.0
            gray = Image.fromarray((255 * (flat - flat.min()) / reach).astype(np.uint8))
            around = np.asarray(gray.filter(ImageFilter.GaussianBlur(self.size / 40)), dtype=np.float64) / 255
            crease = np.clip(around - (flat - flat.min()) / reach, 0.0, 0.25) * there
            self.color *= 1.0 - 1.6 * crease[..., None]
        shown = (np.clip(self.color, 0.0, 1.0) ** (1 / 2.2) * 255).round().astype(np.uint8)
        return Image.fromarray(shown).resize((pixels, pixels), Image.Resampling.LANCZOS)

    def _on_sheet(self, points: Array) -> Array:
        seen = (points @ self.view.T - self.center) * self.scale
        return seen * [1.0, -1.0, 1.0] + [self.size / 2, self.size / 2, 0.0]

    def _shades(self, skin: VisualMesh) -> Array:
        """The light of each corner of each face, m x 3 x 3."""
        corners = skin.points[skin.faces]
        if skin.normals is None:
            flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-30)
            normals = np.repeat(flat[:, None], 3, axis=1)
        else:
            normals = skin.normals[skin.faces]
        surface = skin.material
        color = np.array(surface.color) ** 2.2
        light = _LIGHT / np.linalg.norm(_LIGHT)
        towards = self.view[2]
        lit = np.clip(normals @ light, 0.0, 1.0)[..., None]
        sky = 0.5 + 0.5 * normals[..., 2:]
        diffuse = color * (0.66 * lit + 0.3 + 0.2 * sky)
        mirrored = 2 * (normals @ towards)[..., None] * normals - towards
        gloss = np.clip(mirrored @ light, 0.0, 1.0)[..., None] ** (4 + 60 * (1 - surface.roughness) ** 2)
        around = 0.35 + 0.65 * np.clip(0.5 + 0.6 * mirrored[..., 2:], 0.0, 1.0)
        metal = color * (0.3 * diffuse.mean() + around) + 0.5 * gloss
        shine = diffuse + 0.45 * (1 - surface.roughness) * gloss
        mixed = shine + (metal - shine) * surface.metalness * 0.8
        return np.asarray(mixed + color * surface.emission * 0.6)


def _covered(triangle: Array, size: int) -> tuple[slice, slice, NDArray[np.bool_], Array] | None:
    """The rectangle of pixels round a triangle, which of them it covers, and the weights of its corners there."""
    (ax, ay), (bx, by), (cx, cy) = triangle[:, :2].tolist()
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    left, right = max(int(min(ax, bx, cx)), 0), min(int(max(ax, bx, cx)) + 2, size)
    top, bottom = max(int(min(ay, by, cy)), 0), min(int(max(ay, by, cy)) + 2, size)
    if abs(area) < 1e-9 or left >= right or top >= bottom:
        return None
    x = np.arange(left, right) + 0.5
    y = (np.arange(top, bottom) + 0.5)[:, None]
    first = ((bx - x) * (cy - y) - (cx - x) * (by - y)) / area
    second = ((cx - x) * (ay - y) - (ax - x) * (cy - y)) / area
    weights = np.stack([first, second, 1.0 - first - second], axis=-1)
    return slice(top, bottom), slice(left, right), (weights >= -1e-6).all(axis=-1), weights
