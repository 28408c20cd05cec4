"""A software renderer in NumPy: triangles with a depth buffer, one soft light, and a shadow on the ground.

It is slow, but its result does not depend on graphics hardware or drivers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from mindstage.scene import BodyGeometry, VisualMesh

__all__ = ["Renderer"]

Array = NDArray[np.float64]

_SUPERSAMPLING = 2
"""Samples per pixel along each axis."""
_LIGHT = np.array([0.62, 0.22, 0.75])
_FILL_FRACTION = 0.74
"""Fraction of the image that the geometry takes up."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Renderer:
    """A camera with an orthographic projection, and a background color."""

    pixels: int = 180
    azimuth_rad: float = 0.6
    """Azimuth of the camera, from the front towards the left."""
    elevation_rad: float = 0.42
    background: tuple[int, int, int] = (250, 249, 246)

    def image(self, geometry: BodyGeometry) -> Image.Image:
        """Returns an image of the geometry on the ground, scaled to fit."""
        size = self.pixels * _SUPERSAMPLING
        view = self._view()
        points = np.concatenate([visual.points for visual in geometry.visuals])
        projected = points @ view.T
        low, high = projected.min(axis=0), projected.max(axis=0)
        scale = _FILL_FRACTION * size / float((high - low)[:2].max())
        center = (low + high) / 2
        canvas = _Canvas(size, view, scale, center, (np.array(self.background) / 255) ** 2.2)
        canvas.add_shadow(
            [visual for visual in geometry.visuals if visual.material.opacity > 0.5], float(points[:, 2].min())
        )
        for visual in sorted(geometry.visuals, key=lambda visual: -visual.material.opacity):
            canvas.draw(visual)
        return canvas.result(self.pixels)

    def _view(self) -> Array:
        """Returns the rotation into the camera frame; its rows are right, up and towards the camera."""
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


class _Canvas:
    """The color and depth buffers of an image, in linear light."""

    def __init__(self, size: int, view: Array, scale: float, center: Array, background: Array) -> None:
        self.size, self.view, self.scale, self.center = size, view, scale, center
        self.color = np.tile(background, (size, size, 1))
        self.depth = np.full((size, size), -np.inf)

    def add_shadow(self, visuals: list[VisualMesh], ground: float) -> None:
        """Darkens the blurred projection of the meshes onto the ground along the light."""
        mask = np.zeros((self.size, self.size))
        for visual in visuals:
            projected = visual.points - (visual.points[:, 2:] - ground) / _LIGHT[2] * _LIGHT * 0.6
            projected[:, 2] = ground
            corners = self._to_pixels(projected)[visual.faces]
            for triangle in corners:
                if (found := _covered(triangle, self.size)) is not None:
                    rows, columns, inside, _ = found
                    mask[rows, columns] = np.maximum(mask[rows, columns], inside)
        blurred = Image.fromarray((mask * 255).astype(np.uint8)).filter(ImageFilter.GaussianBlur(self.size / 70))
        self.color *= 1.0 - 0.4 * (np.asarray(blurred, dtype=np.float64) / 255)[..., None]

    def draw(self, visual: VisualMesh) -> None:
        """Draws a mesh with a depth test; a translucent one leaves the depth buffer unchanged."""
        corners = self._to_pixels(visual.points)[visual.faces]
        shade = self._shade(visual)
        is_translucent = visual.material.opacity < 1.0
        if is_translucent:  # from back to front
            order = np.argsort(corners[:, :, 2].mean(axis=1))
            corners, shade = corners[order], shade[order]
        for triangle, light in zip(corners, shade, strict=True):
            found = _covered(triangle, self.size)
            if found is None:
                continue
            rows, columns, inside, weights = found
            depth = weights @ triangle[:, 2]
            nearer = inside & (depth > self.depth[rows, columns])
            color = weights @ light
            old = self.color[rows, columns]
            opacity = visual.material.opacity if is_translucent else 1.0
            self.color[rows, columns] = np.where(nearer[..., None], old + (color - old) * opacity, old)
            if not is_translucent:
                self.depth[rows, columns] = np.where(nearer, depth, self.depth[rows, columns])

    def result(self, pixels: int) -> Image.Image:
        """Returns the image at its final size, with creases darkened (ambient occlusion from the depth buffer)."""
        depth = np.where(np.isfinite(self.depth), self.depth, np.nan)
        covered = ~np.isnan(depth)
        if covered.any():
            flat = np.where(covered, depth, np.nanmin(depth))
            reach = float(flat.max() - flat.min()) or 1.0
            gray = Image.fromarray((255 * (flat - flat.min()) / reach).astype(np.uint8))
            around = np.asarray(gray.filter(ImageFilter.GaussianBlur(self.size / 40)), dtype=np.float64) / 255
            crease = np.clip(around - (flat - flat.min()) / reach, 0.0, 0.25) * covered
            self.color *= 1.0 - 1.6 * crease[..., None]
        srgb = (np.clip(self.color, 0.0, 1.0) ** (1 / 2.2) * 255).round().astype(np.uint8)
        return Image.fromarray(srgb).resize((pixels, pixels), Image.Resampling.LANCZOS)

    def _to_pixels(self, points: Array) -> Array:
        projected = (points @ self.view.T - self.center) * self.scale
        return projected * [1.0, -1.0, 1.0] + [self.size / 2, self.size / 2, 0.0]

    def _shade(self, visual: VisualMesh) -> Array:
        """Returns the color of each corner of each face, m x 3 x 3."""
        corners = visual.points[visual.faces]
        if visual.normals is None:
            flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-30)
            normals = np.repeat(flat[:, None], 3, axis=1)
        else:
            normals = visual.normals[visual.faces]
        material = visual.material
        color = np.array(material.color) ** 2.2
        light = _LIGHT / np.linalg.norm(_LIGHT)
        towards = self.view[2]
        lambert = np.clip(normals @ light, 0.0, 1.0)[..., None]
        sky = 0.5 + 0.5 * normals[..., 2:]
        diffuse = color * (0.66 * lambert + 0.3 + 0.2 * sky)
        mirrored = 2 * (normals @ towards)[..., None] * normals - towards
        gloss = np.clip(mirrored @ light, 0.0, 1.0)[..., None] ** (4 + 60 * (1 - material.roughness) ** 2)
        around = 0.35 + 0.65 * np.clip(0.5 + 0.6 * mirrored[..., 2:], 0.0, 1.0)
        metal = color * (0.3 * diffuse.mean() + around) + 0.5 * gloss
        shine = diffuse + 0.45 * (1 - material.roughness) * gloss
        mixed = shine + (metal - shine) * material.metalness * 0.8
        return np.asarray(mixed + color * material.emission * 0.6)


def _covered(triangle: Array, size: int) -> tuple[slice, slice, NDArray[np.bool_], Array] | None:
    """Returns the bounding rectangle of a triangle, which pixels it covers, and the barycentric weights there."""
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
