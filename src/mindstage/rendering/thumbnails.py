"""Thumbnails: small pictures of single bodies, rendered on the CPU with a depth buffer and without another program."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray

from mindstage.knowledge.shape_rules import ShapeRule
from mindstage.rendering.appearance import compute_appearance
from mindstage.scene import Body, BodyGeometry, VisualMesh, World
from mindstage.scene.mesh import face_cross_products
from mindstage.scene.transforms import Array

__all__ = ["render_thumbnail"]

_EYE = np.array([1.0, -0.75, 0.62])
"""The direction to the camera, from the front and above; fronts of furniture face +x."""
_LIGHT = np.array([0.55, -0.75, 1.1])
_AMBIENT_SHARE = 0.5
_OVERSAMPLING_FACTOR = 3
_MARGIN_FRACTION = 0.06


def render_thumbnail(body: Body, geometry: BodyGeometry | None, rule: ShapeRule, *, size: int = 96) -> bytes:
    """Renders a body in a parallel projection.

    Args:
        body: the body; its pose is ignored.
        geometry: its geometry; without it, it is drawn as its primitive shape.
        rule: the shape rule of its class.
        size: width and height [px].

    Returns:
        A PNG file with a transparent background.
    """
    from PIL import Image

    known = {} if geometry is None else {body.id: geometry}
    world = World(iri=body.iri, bodies=(body,))
    appearance = compute_appearance(world, lambda _: rule, geometry=known)[body.id]
    visuals = appearance.whole_visuals or appearance.visuals
    pixels = _rasterize(visuals, size * _OVERSAMPLING_FACTOR)
    picture = Image.fromarray(pixels, "RGBA").resize((size, size), Image.Resampling.BOX)
    file = io.BytesIO()
    picture.save(file, "PNG", optimize=True)
    return file.getvalue()


def _rasterize(visuals: tuple[VisualMesh, ...], size: int) -> NDArray[np.uint8]:
    """Draws flat-shaded triangles, size x size x 4."""
    back = _EYE / np.linalg.norm(_EYE)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(back, right), back])
    meshes = [(visual.points @ axes.T, visual) for visual in visuals if len(visual.faces)]
    pixels = np.zeros((size, size, 4), dtype=np.uint8)
    if not meshes:
        return pixels
    points = np.concatenate([at for at, _ in meshes])
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    scale = size * (1.0 - 2 * _MARGIN_FRACTION) / max(float((high - low).max()), 1e-6)
    depth = np.full((size, size), -np.inf)
    light = _LIGHT / np.linalg.norm(_LIGHT)
    # Transparent parts last, so that what is behind them is seen.
    for at, visual in sorted(meshes, key=lambda pair: -pair[1].material.opacity):
        screen = at.copy()
        screen[:, :2] = (at[:, :2] - (low + high) / 2) * scale + size / 2
        screen[:, 1] = size - screen[:, 1]
        normals = face_cross_products(visual.points, visual.faces)
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
        bright = _AMBIENT_SHARE + (1.0 - _AMBIENT_SHARE) * np.maximum(normals @ light, 0.0)
        colors = np.clip(np.array(visual.material.color) * bright[:, None] * 1.08, 0.0, 1.0) * 255
        facing = normals @ back > 0.0
        opacity = max(visual.material.opacity, 0.35)
        for face in np.flatnonzero(facing).tolist():
            _fill(pixels, depth, screen[visual.faces[face]], colors[face], opacity)
    return pixels


def _fill(pixels: NDArray[np.uint8], depth: Array, corners: Array, color: Array, opacity: float) -> None:
    """Fills one triangle where it is in front."""
    size = len(depth)
    low = np.clip(np.floor(corners[:, :2].min(axis=0)).astype(int), 0, size)
    high = np.clip(np.ceil(corners[:, :2].max(axis=0)).astype(int) + 1, 0, size)
    (x0, y0), (x1, y1), (x2, y2) = corners[:, :2].tolist()
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if abs(area) < 1e-9 or (high <= low).any():
        return
    x = np.arange(low[0], high[0])[None] + 0.5
    y = np.arange(low[1], high[1])[:, None] + 0.5
    one = ((x - x0) * (y2 - y0) - (x2 - x0) * (y - y0)) / area
    two = ((x1 - x0) * (y - y0) - (x - x0) * (y1 - y0)) / area
    z = corners[0, 2] + one * (corners[1, 2] - corners[0, 2]) + two * (corners[2, 2] - corners[0, 2])
    window = (slice(low[1], high[1]), slice(low[0], high[0]))
    shown = (one >= -1e-6) & (two >= -1e-6) & (one + two <= 1.0 + 1e-6) & (z > depth[window])
    if not shown.any():
        return
    target = pixels[window]
    before = target[shown]
    covered = before[:, 3:4] / 255.0
    total = opacity + covered * (1.0 - opacity)
    mixed = (color * opacity + before[:, :3] * covered * (1.0 - opacity)) / total
    target[shown] = np.concatenate([mixed, total * 255], axis=1).astype(np.uint8)
    if opacity >= 1.0:
        depth[window][shown] = z[shown]
