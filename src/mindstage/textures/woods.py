"""Wood: growth rings, fibers and pores, with the grain along u; boards, staves and parquet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from mindstage.textures.noise import Array, Grid, Recipe, Surface, smooth_step, tinted

__all__ = ["WOODS"]

_DARKEST = 0.8
"""Largest darkness: wood is nowhere black."""


class _Species(NamedTuple):
    rings: int
    """Number of growth rings across the texture."""
    figure: float
    """How far the rings wander [rings]: arches where it is large."""
    contrast: float
    """Darkness of late wood."""
    fibers: float
    pores: float
    """Darkness of pores."""
    pore_length: float
    """[m]."""
    clouds: float
    """Slow changes of the tone along the board."""
    tint: tuple[float, float, float]
    """How much red, green and blue the dark parts absorb."""


_OAK = _Species(34, 8.0, 0.36, 0.12, 0.46, 0.014, 0.07, (0.62, 0.82, 1.0))
_WALNUT = _Species(18, 6.0, 0.42, 0.12, 0.40, 0.010, 0.16, (0.72, 0.86, 1.0))
_BEECH = _Species(30, 3.0, 0.10, 0.06, 0.30, 0.0022, 0.04, (0.55, 0.85, 1.0))
_PINE = _Species(22, 6.0, 0.36, 0.05, 0.0, 0.01, 0.04, (0.40, 0.75, 1.0))


def _rings(grid: Grid, species: _Species) -> tuple[Array, Array]:
    """Late wood, from 0 to 1, and the number of rings from the edge at each pixel."""
    length = grid.size[0]
    wander = grid.noise(0.9 * length, 0.35 * grid.size[1]) + 0.10 * grid.noise(0.25 * length, 0.06 * grid.size[1])
    spacing = 0.30 * grid.noise(2.0 * length, 0.1 * grid.size[1])
    number = species.rings * grid.v + species.figure * (wander + spacing)
    phase = (number - np.floor(number)).astype(np.float32)
    # Dense late wood grows slowly at the end of the year; then the next ring begins abruptly.
    late = phase**2.2 * (1.0 - smooth_step(0.88, 1.0, phase))
    return late / 0.75, number.astype(np.float32)


def _board(grid: Grid, species: _Species) -> tuple[Array, Array]:
    """The darkness of a board, from 0 to 1, and its height [m]."""
    late, _ = _rings(grid, species)
    fibers = grid.noise(0.06, 0.0009) + 0.7 * grid.noise(0.02, 0.0005)
    clouds = grid.noise(0.5 * grid.size[0], 0.15 * grid.size[1])
    dark = species.contrast * late * (1.0 + 0.25 * fibers) + species.fibers * 0.5 * (fibers + 1.0)
    dark = dark + species.clouds * clouds + 0.10
    height = 1.5e-5 * fibers - 2e-5 * late
    if species.pores:
        streaks = grid.noise(species.pore_length, 0.0005)
        pores = smooth_step(1.1, 2.1, streaks + 0.9 * (0.5 - late))
        dark = dark + species.pores * pores
        height = height - 7e-5 * pores
    return np.asarray(np.clip(dark, 0.0, _DARKEST), dtype=np.float32), np.asarray(height, dtype=np.float32)


def _plank(species: _Species) -> Recipe:
    def recipe(grid: Grid) -> Surface:
        dark, height = _board(grid, species)
        return Surface(tinted(dark, species.tint), height, 0.82 + 0.25 * dark)

    return recipe


def _joined(grid: Grid, dark: Array, height: Array, row: Array, column: Array, *, tone: float) -> tuple[Array, Array]:
    """Rearranges a board as many pieces, each cut from another place of it and a little darker or lighter."""
    number = (row * 8 + column).astype(np.int64)
    count = int(number.max()) + 1
    right, up = grid.rng.random((2, count), dtype=np.float32)
    tones = tone * (grid.rng.random(count, dtype=np.float32) - 0.5)
    moved = right[number] * grid.size[0], up[number] * grid.size[1]
    shown = grid.shifted(dark, *moved) + tones[number]
    return np.asarray(np.clip(shown, 0.0, _DARKEST), dtype=np.float32), grid.shifted(height, *moved)


def _gap(share: Array, count: int, extent: float, width: float) -> Array:
    """1 in the joints between `count` equal pieces along an axis, otherwise 0."""
    phase = share * count - np.floor(share * count)
    distance = np.minimum(phase, 1.0 - phase) * (extent / count)
    return 1.0 - smooth_step(0.3 * width, width, np.asarray(distance, dtype=np.float32))


def _staves(species: _Species, count: int, *, tone: float = 0.16) -> Recipe:
    """Narrow boards glued side by side."""

    def recipe(grid: Grid) -> Surface:
        dark, height = _board(grid, species)
        row = np.floor(grid.v * count)
        dark, height = _joined(grid, dark, height, row, np.zeros_like(row), tone=tone)
        joint = _gap(grid.v, count, grid.size[1], 0.0008)
        return Surface(tinted(dark + 0.18 * joint, species.tint), height - 2e-5 * joint, 0.82 + 0.25 * dark)

    return recipe


def _bamboo(grid: Grid) -> Surface:
    count = 15  # strips of 20 mm
    fibers = grid.noise(0.25, 0.0012) + 0.6 * grid.noise(0.08, 0.0006)
    dots = smooth_step(0.9, 2.0, grid.noise(0.05, 0.0006))
    row = np.floor(grid.v * count)
    places = grid.rng.random((count, 2), dtype=np.float32)[row.astype(np.int64) % count]
    distance = np.abs(grid.u - places[..., 0])
    node = 1.0 - smooth_step(0.001, 0.005, np.minimum(distance, 1.0 - distance) * grid.size[0])
    dark = 0.14 + 0.05 * fibers + 0.2 * dots + 0.35 * node + 0.14 * (places[..., 1] - 0.5)
    joint = _gap(grid.v, count, grid.size[1], 0.0007)
    height = 8e-6 * fibers + 3e-5 * node - 2e-5 * joint
    return Surface(tinted(dark + 0.2 * joint, (0.55, 0.8, 1.0)), height, 0.85 + 0.15 * node)


def _parquet(grid: Grid) -> Surface:
    rows, columns = 8, 2
    dark, height = _board(grid, _OAK)
    row = np.floor(grid.v * rows)
    stagger = np.array([0.0, 0.5, 0.2, 0.75, 0.4, 0.9, 0.3, 0.65], dtype=np.float32)[row.astype(np.int64) % rows]
    along = (grid.u + stagger / columns) % 1.0
    dark, height = _joined(grid, dark, height, row, np.floor(along * columns), tone=0.30)
    joint = np.maximum(
        _gap(grid.v, rows, grid.size[1], 0.0028),
        _gap(np.asarray(along, dtype=np.float32), columns, grid.size[0], 0.0034),
    )
    shade = tinted(dark, _OAK.tint) * (1.0 - 0.62 * joint[..., None])
    return Surface(shade, height - 3e-4 * joint, np.clip(0.8 + 0.2 * dark + 0.3 * joint, 0.0, 1.0))


def _painted(grid: Grid) -> Surface:
    brush = grid.noise(0.12, 0.0012) + 0.6 * grid.noise(0.05, 0.003)
    dark, _ = _board(grid, _PINE)
    return Surface(1.0 + 0.008 * brush - 0.05 * dark, 1.6e-5 * brush - 4e-5 * dark, 0.88 + 0.03 * brush)


def _lacquered(grid: Grid) -> Surface:
    """Orange peel: paint that was sprayed and has nearly leveled."""
    peel = grid.fractal(0.03, 0.004, slope=1.0)
    return Surface(1.0 + 0.004 * peel, 1.6e-5 * peel, 0.93 + 0.02 * grid.noise(0.08))


WOODS: Mapping[str, Recipe] = {
    "oak_board": _plank(_OAK),
    "oak_staves": _staves(_OAK, 8),
    "walnut_board": _plank(_WALNUT),
    "beech_board": _plank(_BEECH),
    "pine_board": _plank(_PINE),
    "bamboo_staves": _bamboo,
    "parquet": _parquet,
    "painted_wood": _painted,
    "lacquered_board": _lacquered,
}
