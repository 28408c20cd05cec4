"""Shading of pictures from buffers: daylight with shadows, sky light with ambient occlusion, lamps, reflections.

A rasterizer such as MuJoCo's writes color, normal, depth, sunlight and material of each pixel; this module computes the
light that reaches the camera, in linear color, and maps it to sRGB. Deferred shading: every light costs time
proportional to the pixels, whatever the number of triangles.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mindstage.rendering.camera import CameraPose
from mindstage.rendering.render_scene import RenderLight
from mindstage.scene.colors import srgb_to_linear

__all__ = ["PixelBuffers", "ViewFrame", "shade", "sun_direction"]

Image = NDArray[np.floating[Any]]
"""h x w x 3."""
Bytes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelBuffers:
    """What a rasterizer writes for each pixel."""

    color: Bytes
    """h x w x 3, the color without light, sRGB; 0 where nothing is."""
    normal: Bytes
    """h x w x 3, the unit normal in the world frame, mapped from -1…1 to 0…255."""
    depth: NDArray[np.floating[Any]]
    """h x w, the distance along the axis of the camera [m]; infinite where nothing is."""
    sun: Bytes
    """h x w, the cosine between normal and sun, 0 in shadow."""
    material: Bytes
    """h x w x 3: roughness, metalness and emission."""

    def rows(self, rows: slice) -> PixelBuffers:
        """Some rows of all buffers."""
        return PixelBuffers(
            color=self.color[rows],
            normal=self.normal[rows],
            depth=self.depth[rows],
            sun=self.sun[rows],
            material=self.material[rows],
        )


class ViewFrame:
    """The frame and the image plane of a camera."""

    def __init__(self, camera: CameraPose, size: tuple[int, int]) -> None:
        """Computes the axes of the camera.

        Args:
            camera: the camera.
            size: width and height of the picture [px].
        """
        self.width, self.height = size
        self.eye = np.array(camera.position, dtype=float)
        forward = np.array(camera.look_at, dtype=float) - self.eye
        self.forward = forward / max(float(np.linalg.norm(forward)), 1e-9)
        right = np.cross(self.forward, [0.0, 0.0, 1.0])
        if float(np.linalg.norm(right)) < 1e-6:  # straight down: the upper edge is north
            right = np.array([1.0, 0.0, 0.0])
        self.right = right / np.linalg.norm(right)
        self.up = np.cross(self.right, self.forward)
        half = float(np.tan(camera.field_of_view_rad / 2))
        self.half_width = half * self.width / self.height
        middle = -2.0 * half * camera.vertical_shift
        self.bottom, self.top = middle - half, middle + half

    def rays(self, step: int = 1) -> Image:
        """The direction of each pixel, with a component of 1 along the axis of the camera, h x w x 3.

        Args:
            step: every so many pixels in both directions.
        """
        x = (np.arange(self.width, dtype=np.float32)[::step] + 0.5) / self.width * 2 - 1
        y = 1 - (np.arange(self.height, dtype=np.float32)[::step] + 0.5) / self.height
        across = (x * self.half_width)[None, :, None] * self.right.astype(np.float32)
        along = (self.bottom + y * (self.top - self.bottom))[:, None, None] * self.up.astype(np.float32)
        rays: Image = across + along + self.forward.astype(np.float32)
        return rays.astype(np.float32)

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixel coordinates (from the upper left corner) and depth [m] of points, n x 3.

        Args:
            points: n x 3 [m].
        """
        local = (points - self.eye) @ np.stack([self.right, self.up, self.forward], axis=1)
        depth = np.where(np.abs(local[:, 2]) < 1e-9, 1e-9, local[:, 2])
        x = (local[:, 0] / depth / self.half_width + 1) / 2 * self.width
        y = (1 - (local[:, 1] / depth - self.bottom) / (self.top - self.bottom)) * self.height
        return np.stack([x, y, local[:, 2]], axis=1)


_SUN_AZIMUTH_RAD = np.radians(38.0)
"""Angle between the sun and the camera, about z: shadows fall beside what casts them."""
_SUN_ELEVATION_RAD = np.radians(52.0)


def sun_direction(camera: CameraPose) -> NDArray[np.float64]:
    """The unit vector to the sun: behind the camera and beside it, so that it shines into the room.

    Args:
        camera: the camera.
    """
    away = np.subtract(camera.position, camera.look_at)
    azimuth = float(np.arctan2(away[1], away[0])) + _SUN_AZIMUTH_RAD
    flat = np.cos(_SUN_ELEVATION_RAD)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(_SUN_ELEVATION_RAD)])


_SKY = np.array([0.80, 0.88, 1.0], dtype=np.float32)
_FLOOR_LIGHT = np.array([0.60, 0.55, 0.50], dtype=np.float32)
"""Light from below: daylight that the floor has reflected."""
_AMBIENT = 0.62
_SUN = np.array([1.0, 0.94, 0.85], dtype=np.float32) * 1.25
_LAMP_SUM_CD = 2.2
"""Sum of the intensities of the lamps: by day they only add warmth."""
_MAX_LAMPS = 4
_LAMP_RADIUS_M = 0.25
_EXPOSURE = 1.0
_GROUND_FADE = (1.1, 3.2)
"""Distances between which the ground fades into the background, in radii of the scene."""
_BACKDROP_LOW, _BACKDROP_HIGH = (0.905, 0.912, 0.92), (0.74, 0.82, 0.90)
"""Colors of the background at the horizon and above, sRGB."""
_STRIP_ROWS = 32
"""Pixels are shaded in strips, in threads; those of a strip fit into the processor's cache."""
_LINEAR = srgb_to_linear(np.arange(256) / 255.0).astype(np.float32)


def shade(
    buffers: PixelBuffers,
    view: ViewFrame,
    *,
    sun: NDArray[np.float64],
    lamps: tuple[RenderLight, ...] = (),
    ground: tuple[float, NDArray[np.float64], float] | None = None,
    cut: bool = False,
) -> Bytes:
    """Computes a picture.

    Args:
        buffers: what the rasterizer wrote.
        view: the camera.
        sun: unit vector to the sun.
        lamps: lights of the scene; the brightest are used.
        ground: the height of the ground, the center of the scene and its radius [m]: the ground fades into the
            background around it.
        cut: whether the scene is clipped: what faces away from the camera is then drawn as a dark section.

    Returns:
        h x w x 3, sRGB.
    """
    rays, eye, to_sun = view.rays(), view.eye.astype(np.float32), sun.astype(np.float32)
    length = np.sqrt(np.einsum("ijk,ijk->ij", rays, rays))
    solid = np.isfinite(buffers.depth)
    normal = buffers.normal.astype(np.float32) * np.float32(2 / 255) - 1
    normal /= np.maximum(np.sqrt(np.einsum("ijk,ijk->ij", normal, normal)), 1e-3)[..., None]
    away = np.einsum("ijk,ijk->ij", normal, rays) > 0.05 * length
    normal[away] *= -1
    occlusion = _ambient_occlusion(buffers.depth, normal, view)
    result = np.empty(buffers.color.shape, dtype=np.float32)

    def shade_rows(rows: slice) -> None:
        strip, seen = buffers.rows(rows), solid[rows, :, None]
        toward = rays[rows] / -length[rows, :, None]
        background = _background(-toward)
        points = rays[rows] * np.where(seen, strip.depth[..., None], 0.0) + eye
        picture = _reflected_light(strip, normal[rows], toward, points, occlusion[rows], lamps, to_sun)
        if cut:
            picture[away[rows] & seen[..., 0]] = 0.09
        picture = _tone_map(picture)
        if ground is not None:
            picture = _fade_ground(picture, background, points, ground)
        result[rows] = np.where(seen, picture, background)

    starts = range(0, view.height, _STRIP_ROWS)
    with ThreadPoolExecutor() as pool:
        list(pool.map(shade_rows, [slice(start, start + _STRIP_ROWS) for start in starts]))
    return np.asarray(np.clip(_smooth_edges(result) * 255 + 0.5, 0, 255), dtype=np.uint8)


def _reflected_light(
    buffers: PixelBuffers,
    normal: Image,
    toward: Image,
    points: Image,
    occlusion: NDArray[np.floating[Any]],
    lamps: tuple[RenderLight, ...],
    sun: NDArray[np.floating[Any]],
) -> Image:
    """The light that reaches the camera, linear."""
    facing = np.clip(np.abs(np.einsum("ijk,ijk->ij", normal, toward)), 0.02, 1.0)
    light = _light(buffers, normal, points, occlusion, lamps)
    albedo, emission = _LINEAR[buffers.color], buffers.material[..., 2:] * np.float32(1 / 255)
    metalness = buffers.material[..., 1:2] * np.float32(1 / 255)
    shine = _reflection(buffers, normal, toward, facing, albedo, metalness, sun)
    result: Image = albedo * (1 - metalness) * light + shine * occlusion[..., None] + albedo * emission * 1.6
    return result


def _background(directions: Image) -> Image:
    """The studio backdrop behind everything, sRGB: from a light gray at the horizon to a pale blue above."""
    height = np.clip(directions[..., 2:] * 1.6 + 0.12, 0.0, 1.0)
    low, high = (np.array(color, dtype=np.float32) for color in (_BACKDROP_LOW, _BACKDROP_HIGH))
    picture: Image = low + (high - low) * height
    return picture


def _light(
    buffers: PixelBuffers,
    normal: Image,
    points: Image,
    occlusion: NDArray[np.floating[Any]],
    lamps: tuple[RenderLight, ...],
) -> Image:
    """The light that falls on each pixel."""
    up = (normal[..., 2:] + 1) / 2
    light = (_FLOOR_LIGHT + (_SKY - _FLOOR_LIGHT) * up) * (_AMBIENT * occlusion[..., None])
    light += (buffers.sun * np.float32(1 / 255) * (0.55 + 0.45 * occlusion))[..., None] * _SUN
    brightest = sorted((lamp for lamp in lamps if lamp.intensity > 0), key=lambda lamp: -lamp.intensity)[:_MAX_LAMPS]
    total = sum(lamp.intensity for lamp in brightest)
    for lamp in brightest:
        offset = np.array(lamp.pose.position, dtype=np.float32) - points
        square = np.einsum("ijk,ijk->ij", offset, offset) + _LAMP_RADIUS_M**2
        cosine = np.einsum("ijk,ijk->ij", normal, offset) / np.sqrt(square)
        strength = _LAMP_SUM_CD * lamp.intensity / total * np.clip(cosine, 0, 1) / square * occlusion
        light += strength[..., None] * srgb_to_linear(np.array(lamp.color)).astype(np.float32)
    result: Image = light
    return result


def _reflection(
    buffers: PixelBuffers,
    normal: Image,
    toward: Image,
    facing: NDArray[np.floating[Any]],
    albedo: Image,
    metalness: Image,
    sun: NDArray[np.floating[Any]],
) -> Image:
    """The light that is mirrored to the camera: that of a simple room around, and the highlight of the sun.

    Fresnel with roughness after Lazarov ("Getting more physical in Call of Duty: Black Ops II", 2013).
    """
    roughness = np.clip(buffers.material[..., :1] * np.float32(1 / 255), 0.08, 1.0)
    base = 0.04 + (albedo - 0.04) * metalness
    fresnel = base + (np.maximum(1 - roughness, base) - base) * ((1 - facing) ** 5)[..., None]
    mirrored = 2 * facing[..., None] * normal - toward
    up = mirrored[..., 2:]
    # Blurred by the roughness: a bright ceiling, walls of medium gray, a darker floor.
    edge = 0.08 + 0.9 * roughness
    room = 0.42 + 0.50 * np.clip((up - 0.25) / edge, -0.6, 1.0)
    half = toward + sun
    half /= np.sqrt(np.einsum("ijk,ijk->ij", half, half))[..., None]
    cosine = np.clip(np.einsum("ijk,ijk->ij", normal, half), 0, 1)[..., None]
    power = np.minimum(2 / roughness**4, 600.0)
    glint = (power + 8) / 25 * cosine**power * (buffers.sun[..., None] * np.float32(1 / 255))
    shine: Image = fresnel * (room * (1 - 0.55 * roughness * (1 - metalness)) + np.minimum(glint, 4.0) * _SUN * 0.5)
    return shine


def _tone_map(picture: Image) -> Image:
    """Maps linear color to sRGB; bright parts approach white (after Narkowicz' fit of the ACES curve)."""
    x = picture * np.float32(_EXPOSURE * 0.72)
    mapped = np.clip(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0.0, 1.0)
    # The square root of sRGB's curve without its linear part: the difference is below one percent from 0.02 on.
    encoded: Image = np.maximum(1.055 * mapped ** np.float32(1 / 2.4) - 0.055, 0.0)
    return encoded


def _fade_ground(
    picture: Image,
    background: Image,
    points: Image,
    ground: tuple[float, NDArray[np.float64], float],
) -> Image:
    height, center, radius = ground
    flat = np.hypot(points[..., 0] - center[0], points[..., 1] - center[1]) / max(radius, 1e-6)
    near, far = _GROUND_FADE
    fade = np.clip((flat - near) / (far - near), 0.0, 1.0)
    fade = fade * fade * (3 - 2 * fade)
    is_ground = np.abs(points[..., 2] - height) < 0.01 + 2e-3 * radius * np.maximum(flat, 1.0)
    weight = np.where(is_ground, fade, 0.0)[..., None]
    faded: Image = picture + (background - picture) * weight
    return faded


_OCCLUSION_RADIUS_M = 0.35
_OCCLUSION_SAMPLES = 16
_OCCLUSION_STRENGTH = 1.5
_OCCLUSION_STEP = 2
"""Every so many pixels; ambient occlusion is smooth."""


def _ambient_occlusion(depth: NDArray[np.floating[Any]], normal: Image, view: ViewFrame) -> NDArray[np.floating[Any]]:
    """The part of the sky light that each pixel receives, from the depths around it, h x w.

    Samples a spiral in the image plane whose size is that of a ball around the pixel, and counts how far each sample
    rises above the tangent plane ("Scalable Ambient Obscurance", McGuire et al. 2012).
    """
    step = _OCCLUSION_STEP
    low = np.where(np.isfinite(depth), depth, 1e4)[::step, ::step].astype(np.float32)
    rays, towards = view.rays(step), normal[::step, ::step]
    height, width = low.shape
    points = rays * low[..., None]
    pixels = width / (2 * view.half_width) * _OCCLUSION_RADIUS_M / low
    rows, columns = np.indices((height, width), dtype=np.int32)
    turn = ((rows & 3) * 4 + (columns & 3)).astype(np.float32) * np.float32(2 * np.pi / 16)
    reach = np.clip(pixels, 1.0, 60.0)
    total = np.zeros((height, width), dtype=np.float32)
    limit = np.float32(_OCCLUSION_RADIUS_M**2)
    for sample in range(_OCCLUSION_SAMPLES):
        part = (sample + 0.5) / _OCCLUSION_SAMPLES
        angle = turn + np.float32(part * 2 * np.pi * 7)
        at_row = np.clip(rows + (reach * part * np.sin(angle)).astype(np.int32), 0, height - 1)
        at_column = np.clip(columns + (reach * part * np.cos(angle)).astype(np.int32), 0, width - 1)
        offset = points[at_row, at_column] - points
        square = np.einsum("ijk,ijk->ij", offset, offset)
        rise = np.einsum("ijk,ijk->ij", offset, towards) - 0.01
        total += np.maximum(1 - square / limit, 0.0) * np.maximum(rise, 0.0) / np.sqrt(square + 1e-4)
    open_part = np.clip(1 - _OCCLUSION_STRENGTH * 2 * total / _OCCLUSION_SAMPLES, 0.0, 1.0)
    return _upsampled(_box_blur(open_part, low), depth.shape)


def _box_blur(values: NDArray[np.floating[Any]], depth: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """Averages over 4 x 4 pixels of similar depth, which removes the pattern of the samples."""
    total, weight = np.zeros_like(values), np.full_like(values, 1e-6)
    for rows in range(-2, 2):
        for columns in range(-2, 2):
            near = np.roll(depth, (rows, columns), (0, 1))
            similar = (np.abs(near - depth) < 0.03 * depth).astype(np.float32)
            total += similar * np.roll(values, (rows, columns), (0, 1))
            weight += similar
    blurred: NDArray[np.floating[Any]] = np.where(weight > 0.5, total / weight, values)
    return blurred


def _upsampled(values: NDArray[np.floating[Any]], shape: tuple[int, ...]) -> NDArray[np.floating[Any]]:
    height, width = shape
    enlarged = values.repeat(_OCCLUSION_STEP, axis=0).repeat(_OCCLUSION_STEP, axis=1)[:height, :width]
    return np.ascontiguousarray(enlarged)


_EDGE_CONTRAST, _EDGE_CONTRAST_OF_MAX = 0.04, 0.1
"""Smallest contrast of edges that are smoothed, absolute and as a part of the brightness around."""
_EDGE_REACH_PX = 8.0
_LUMA = np.array([0.299, 0.587, 0.114], dtype=np.float32)


def _smooth_edges(picture: Image) -> Image:
    """Smooths the steps of edges: averages along them, where the contrast is high (FXAA, Lottes 2009)."""
    luma = picture @ _LUMA
    padded = np.pad(luma, 1, mode="edge")
    northwest, northeast = padded[:-2, :-2], padded[:-2, 2:]
    southwest, southeast = padded[2:, :-2], padded[2:, 2:]
    corners = np.stack([northwest, northeast, southwest, southeast, luma])
    low, high = corners.min(axis=0), corners.max(axis=0)
    rows, columns = np.nonzero(high - low > np.maximum(_EDGE_CONTRAST, _EDGE_CONTRAST_OF_MAX * high))
    nw, ne, sw, se = (each[rows, columns] for each in (northwest, northeast, southwest, southeast))
    across, along = -((nw + ne) - (sw + se)), (nw + sw) - (ne + se)
    scale = 1 / (np.minimum(np.abs(across), np.abs(along)) + np.maximum((nw + ne + sw + se) / 32, 1 / 128))
    x = np.clip(across * scale, -_EDGE_REACH_PX, _EDGE_REACH_PX)
    y = np.clip(along * scale, -_EDGE_REACH_PX, _EDGE_REACH_PX)
    near = (_sampled(picture, rows + y * part, columns + x * part) for part in (-1 / 6, 1 / 6))
    inner = sum(near) / 2
    far = sum(_sampled(picture, rows + y * part, columns + x * part) for part in (-0.5, 0.5)) / 4 + inner / 2
    brightness = far @ _LUMA
    outside = (brightness < low[rows, columns]) | (brightness > high[rows, columns])
    result: Image = picture.copy()
    result[rows, columns] = np.where(outside[:, None], inner, far)
    return result


def _sampled(picture: Image, rows: Image, columns: Image) -> Image:
    """Bilinear samples, n x 3, at coordinates of pixel centers."""
    height, width, _ = picture.shape
    rows, columns = np.clip(rows, 0, height - 1.001), np.clip(columns, 0, width - 1.001)
    top, left = rows.astype(np.intp), columns.astype(np.intp)
    down, right = (rows - top)[:, None], (columns - left)[:, None]
    upper = picture[top, left] * (1 - right) + picture[top, left + 1] * right
    lower = picture[top + 1, left] * (1 - right) + picture[top + 1, left + 1] * right
    sampled: Image = upper * (1 - down) + lower * down
    return sampled
