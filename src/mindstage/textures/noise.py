"""Periodic noise and patterns on a grid: whatever leaves at one edge comes in at the opposite one.

Noise is white noise filtered in the frequency domain, which is periodic by construction. All lengths are in meters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Grid", "Recipe", "Surface", "smooth_step", "tinted"]

Array = NDArray[np.floating[Any]]
"""Single precision, mostly."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """What a recipe computes, each h x w."""

    shade: Array
    """Relative linear light, h x w or h x w x 3; only ratios matter."""
    height: Array
    """[m]."""
    roughness: Array
    """Relative to the roughness of the material, from 0 to 1."""


def tinted(dark: Array, tint: tuple[float, float, float]) -> Array:
    """The light that is left where a fraction is absorbed, h x w x 3; `tint` is how much of each color is absorbed."""
    return np.asarray(1.0 - np.clip(dark, 0.0, 1.0)[..., None] * np.array(tint, dtype=np.float32), dtype=np.float32)


def smooth_step(low: float, high: float, values: Array) -> Array:
    """0 below `low`, 1 above `high`, and smooth in between; reversed if `high` is less than `low`."""
    share = np.clip((values - low) / (high - low), 0.0, 1.0)
    return np.asarray(share * share * (3.0 - 2.0 * share), dtype=np.float32)


class Grid:
    """The pixels of a texture, and reproducible noise on them. Rows run from the top (v = 1) to the bottom."""

    def __init__(self, seed: int, size: tuple[float, float], pixels: int) -> None:
        """Creates a square grid.

        Args:
            seed: seed of the noise.
            size: width and height of one repeat [m].
            pixels: number of rows and of columns.
        """
        self.size, self.pixels = size, pixels
        self.rng = np.random.default_rng(seed)
        steps = (np.arange(pixels, dtype=np.float32) + 0.5) / pixels
        self.u = np.broadcast_to(steps, (pixels, pixels))
        """From 0 to 1 along the width."""
        self.v = np.broadcast_to(1.0 - steps[:, None], (pixels, pixels))
        """From 0 to 1 along the height, upwards."""
        self._fx = np.fft.rfftfreq(pixels, size[0] / pixels).astype(np.float32)[None]
        self._fy = np.fft.fftfreq(pixels, size[1] / pixels).astype(np.float32)[:, None]

    def noise(self, length_u: float, length_v: float | None = None) -> Array:
        """Smooth noise with mean 0 and standard deviation 1.

        Args:
            length_u: about the size of its spots along u [m].
            length_v: the same along v; by default equal.
        """
        along, across = length_u, length_u if length_v is None else length_v
        weight = np.exp(-((self._fx * along) ** 2) - (self._fy * across) ** 2)
        return self._filtered(weight)

    def fractal(self, largest: float, smallest: float, *, slope: float = 1.0, stretch: float = 1.0) -> Array:
        """Noise on all scales between two lengths, mean 0 and standard deviation 1.

        Args:
            largest: length of the largest spots [m].
            smallest: length of the smallest ones [m].
            slope: exponent of the decrease of the amplitude with the frequency.
            stretch: how much longer the spots are along u.
        """
        frequency = np.sqrt((self._fx * stretch) ** 2 + self._fy**2)
        weight = (frequency + 1.0 / largest) ** -(slope + 1.0) * np.exp(-((frequency * smallest) ** 2))
        return self._filtered(weight)

    def _filtered(self, weight: Array) -> Array:
        white = self.rng.standard_normal((self.pixels, self.pixels), dtype=np.float32)
        spectrum = np.fft.rfft2(white) * weight
        spectrum[0, 0] = 0.0
        found = np.fft.irfft2(spectrum, s=(self.pixels, self.pixels)).astype(np.float32)
        return np.asarray(found / max(float(found.std()), 1e-12), dtype=np.float32)

    def cells(self, length: float, *, jitter: float = 0.9) -> tuple[Array, Array, Array]:
        """Voronoi cells: distances to the nearest and the second nearest seed [cell lengths], and a number per cell.

        Args:
            length: about the size of a cell [m].
            jitter: how irregular the seeds are, from 0 to 1.
        """
        columns, rows = (max(round(extent / length), 2) for extent in self.size)
        spots = 0.5 + jitter * (self.rng.random((rows, columns, 2), dtype=np.float32) - 0.5)
        values = self.rng.random((rows, columns), dtype=np.float32)
        x, y = self.u * columns, self.v * rows
        column, row = np.minimum(x.astype(np.int32), columns - 1), np.minimum(y.astype(np.int32), rows - 1)
        at_x, at_y = np.arange(-1, columns + 1) % columns, np.arange(-1, rows + 1) % rows
        seeds_x = (spots[..., 0] + np.arange(columns, dtype=np.float32))[at_y][:, at_x]
        seeds_y = (spots[..., 1] + np.arange(rows, dtype=np.float32)[:, None])[at_y][:, at_x]
        seeds_x[:, 0] -= columns
        seeds_x[:, -1] += columns
        seeds_y[0] -= rows
        seeds_y[-1] += rows
        flat_x, flat_y, flat_value = seeds_x.ravel(), seeds_y.ravel(), values[at_y][:, at_x].ravel()
        first = row * (columns + 2) + column
        nearest = np.full(x.shape, np.inf, dtype=np.float32)
        second, owner = nearest.copy(), np.zeros(x.shape, dtype=np.int32)
        for down in range(3):
            for right in range(3):
                index = first + (down * (columns + 2) + right)
                distance = (flat_x[index] - x) ** 2 + (flat_y[index] - y) ** 2
                closer = distance < nearest
                second = np.where(closer, nearest, np.minimum(second, distance))
                owner = np.where(closer, index, owner)
                nearest = np.minimum(nearest, distance)
        nearest, second, value = np.sqrt(nearest), np.sqrt(second), flat_value[owner]
        return nearest, second, value.astype(np.float32)

    def shifted(self, image: Array, right: Array | float, up: Array | float) -> Array:
        """The image displaced by lengths [m] that may differ from pixel to pixel, interpolated linearly."""
        x = (self.u - np.asarray(right) / self.size[0]) * self.pixels - 0.5
        y = (1.0 - self.v + np.asarray(up) / self.size[1]) * self.pixels - 0.5
        left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        fx, fy = (x - left).astype(np.float32), (y - top).astype(np.float32)
        left, top = left % self.pixels, top % self.pixels
        after, below = (left + 1) % self.pixels, (top + 1) % self.pixels
        upper = image[top, left] * (1 - fx) + image[top, after] * fx
        lower = image[below, left] * (1 - fx) + image[below, after] * fx
        return np.asarray(upper * (1 - fy) + lower * fy, dtype=np.float32)


Recipe = Callable[[Grid], Surface]
"""Computes a texture."""
