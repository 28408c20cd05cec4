"""Textiles, paper, plastics, food and plants."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mindstage.textures.noise import Array, Grid, Recipe, Surface, smooth_step, tinted

__all__ = ["SOFT_SURFACES"]


def _weave(grid: Grid, threads: int, *, slubs: float) -> tuple[Array, Array, Array]:
    """A plain weave: the height of the upper thread (0 to 1), whether it runs along u, and its thickness."""
    count = threads // 2 * 2  # the pattern repeats after two threads
    warp_slubs, weft_slubs = grid.noise(0.3 * grid.size[0], 0.0008), grid.noise(0.0008, 0.3 * grid.size[1])
    bend = 0.12 * grid.size[0] / count
    u = grid.u + bend * grid.noise(0.02) / grid.size[0]
    v = grid.v + bend * grid.noise(0.02) / grid.size[1]
    x, y = u * count, v * count
    over = (np.floor(x) + np.floor(y)) % 2 == 0  # where the thread along u is on top
    across_u = 1.0 - np.abs(2.0 * (y - np.floor(y)) - 1.0) ** (2.6 - slubs * warp_slubs)
    across_v = 1.0 - np.abs(2.0 * (x - np.floor(x)) - 1.0) ** (2.6 - slubs * weft_slubs)
    rise_u = np.sin(np.pi * (x - np.floor(x))) ** 0.5
    rise_v = np.sin(np.pi * (y - np.floor(y))) ** 0.5
    height = np.where(over, across_u * (0.4 + 0.6 * rise_u), across_v * (0.4 + 0.6 * rise_v))
    thickness = np.where(over, warp_slubs, weft_slubs)
    return np.asarray(height, np.float32), over, np.asarray(thickness, np.float32)


def _linen(grid: Grid) -> Surface:
    height, _, slub = _weave(grid, 84, slubs=0.5)
    shade = 0.62 + 0.38 * smooth_step(0.0, 0.7, height) + 0.05 * slub + 0.03 * grid.noise(0.0006)
    return Surface(shade, 1.1e-4 * height, 0.97 + 0.0 * height)


def _upholstery(grid: Grid) -> Surface:
    height, over, slub = _weave(grid, 64, slubs=0.4)
    fibers = grid.noise(0.0007)
    shade = (0.55 + 0.45 * smooth_step(0.0, 0.7, height)) * np.where(over, 1.0, 0.86) + 0.06 * slub + 0.04 * fibers
    return Surface(np.asarray(shade, np.float32), 2.4e-4 * height, 0.98 + 0.0 * height)


def _terry(grid: Grid) -> Surface:
    distance, second, tone = grid.cells(0.0022)
    loops = smooth_step(0.0, 0.5, second - distance)
    rows = np.sin(2 * np.pi * 40 * grid.v)
    shade = 0.62 + 0.34 * loops + 0.1 * (tone - 0.5) + 0.03 * rows
    return Surface(np.asarray(shade, np.float32), 4e-4 * loops, 0.99 + 0.0 * loops)


def _carpet(grid: Grid) -> Surface:
    distance, second, tone = grid.cells(0.0035)
    tufts = smooth_step(0.0, 0.6, second - distance) + 0.2 * grid.noise(0.0015)
    lay = grid.fractal(0.2, 0.03)  # the pile leans in different directions
    shade = 0.62 + 0.28 * tufts + 0.16 * (tone - 0.5) + 0.05 * lay
    return Surface(shade, 8e-4 * tufts, 0.99 + 0.0 * tufts)


def _leather(grid: Grid) -> Surface:
    distance, second, tone = grid.cells(0.0024, jitter=1.0)
    grain = smooth_step(0.0, 0.35, second - distance)
    folds = grid.fractal(0.06, 0.01)
    shade = 0.84 + 0.16 * grain + 0.03 * folds + 0.04 * (tone - 0.5)
    return Surface(shade, 9e-5 * grain + 1e-4 * folds, 0.88 - 0.14 * grain + 0.03 * folds)


def _wicker(grid: Grid) -> Surface:
    """Willow rods that pass in front of and behind upright stakes."""
    rods, stakes = 20, 4
    row = np.floor(grid.v * rods)
    phase = grid.u * stakes + 0.5 * (row % 2)
    front = np.cos(2 * np.pi * phase)  # 1 in front of a stake, -1 behind the next one
    across = 2.0 * (grid.v * rods - row) - 1.0
    round_rod = np.sqrt(np.clip(1.0 - across**2, 0.0, 1.0))
    tones = grid.rng.random(rods, dtype=np.float32)[row.astype(int) % rods]
    fibers = grid.noise(0.03, 0.0006)
    depth = 0.5 + 0.5 * front
    shade = 0.30 + 0.40 * round_rod + 0.30 * depth * round_rod + 0.25 * (tones - 0.5) + 0.05 * fibers
    dark = np.clip(1.0 - shade, 0.0, 1.0)
    height = 0.0022 * round_rod * (0.45 + 0.55 * depth) + 3e-5 * fibers
    return Surface(
        tinted(np.asarray(dark, np.float32), (0.75, 0.9, 1.0)), np.asarray(height, np.float32), 0.8 + 0.2 * dark
    )


def _cardboard(grid: Grid) -> Surface:
    flutes = np.sin(2 * np.pi * 45 * grid.v).astype(np.float32)
    fibers = grid.noise(0.006, 0.001) + 0.5 * grid.noise(0.001)
    return Surface(
        tinted(0.08 + 0.03 * fibers + 0.012 * flutes, (0.8, 0.95, 1.0)),
        1.5e-5 * flutes + 6e-6 * fibers,
        0.96 + 0.02 * fibers,
    )


def _paper(grid: Grid) -> Surface:
    fibers = grid.fractal(0.006, 0.0008, slope=0.5)
    return Surface(1.0 + 0.010 * fibers, 5e-6 * fibers, 0.97 + 0.01 * fibers)


def _plastic(grid: Grid) -> Surface:
    grain = grid.fractal(0.002, 0.0006, slope=0.3)
    return Surface(1.0 + 0.006 * grain, 4e-6 * grain, 0.92 + 0.03 * grain)


def _rubber(grid: Grid) -> Surface:
    grain = grid.fractal(0.003, 0.0006, slope=0.3)
    return Surface(1.0 + 0.03 * grain, 1.2e-5 * grain, 0.95 + 0.03 * grain)


def _wax(grid: Grid) -> Surface:
    cloud = grid.fractal(0.04, 0.003)
    return Surface(1.0 + 0.02 * cloud, 2e-5 * cloud, 0.9 + 0.05 * cloud)


def _bread_crust(grid: Grid) -> Surface:
    bumps = grid.fractal(0.03, 0.0015, slope=0.9)
    browned = smooth_step(-0.6, 1.8, bumps + 0.8 * grid.fractal(0.12, 0.02))
    cracks = 1.0 - smooth_step(0.0, 0.14, np.abs(grid.fractal(0.04, 0.004)))
    dark = 0.08 + 0.5 * browned - 0.22 * cracks
    return Surface(tinted(dark, (0.62, 0.86, 1.0)), 2.5e-4 * bumps - 3e-4 * cracks, 0.75 + 0.2 * cracks)


def _fruit_skin(grid: Grid) -> Surface:
    distance, _, tone = grid.cells(0.0022)
    dots = (tone > 0.35) * (1.0 - smooth_step(0.08, 0.22, distance))
    blush = grid.fractal(0.05, 0.004)
    shade = 1.0 - 0.10 * blush[..., None] * np.array((0.2, 1.0, 0.7), np.float32) + 0.10 * dots[..., None]
    return Surface(shade.astype(np.float32), -4e-5 * dots + 3e-5 * grid.fractal(0.02, 0.003), 0.85 + 0.1 * dots)


def _sponge(grid: Grid) -> Surface:
    pores = np.zeros((grid.pixels, grid.pixels), dtype=np.float32)
    for length, share in ((0.006, 0.4), (0.003, 0.5), (0.0015, 0.6)):
        distance, _, number = grid.cells(length)
        pores = np.maximum(pores, (number < share) * (1.0 - smooth_step(0.15, 0.4, distance)))
    return Surface(1.0 - 0.5 * pores, -8e-4 * pores, 0.98 + 0.0 * pores)


def _leaf(grid: Grid) -> Surface:
    """A midrib along u and side veins that rise from it obliquely."""
    across = np.abs(2.0 * grid.v - 1.0)
    phase = 12.0 * (grid.u + 0.12 * across) - np.floor(12.0 * (grid.u + 0.12 * across))
    side = 1.0 - smooth_step(0.03, 0.10, np.minimum(phase, 1.0 - phase))
    veins = np.maximum(1.0 - smooth_step(0.02, 0.06, across), 0.7 * side)
    distance, second, _ = grid.cells(0.0015)
    cells = smooth_step(0.0, 0.4, second - distance)
    shade = 1.0 + 0.16 * veins + 0.05 * cells + 0.06 * grid.fractal(0.03, 0.003)
    return Surface(np.asarray(shade, np.float32), 3e-5 * cells - 1.2e-4 * veins, 0.85 + 0.1 * veins)


def _soil(grid: Grid) -> Surface:
    height = np.zeros((grid.pixels, grid.pixels), dtype=np.float32)
    for length in (0.009, 0.004, 0.002):
        distance, _, number = grid.cells(length)
        height = height + (length / 0.009) * number * (1.0 - smooth_step(0.0, 0.6, distance))
    shade = 0.45 + 0.4 * height + 0.1 * grid.fractal(0.05, 0.002)
    return Surface(shade, 2.5e-3 * height, np.ones_like(height))


SOFT_SURFACES: Mapping[str, Recipe] = {
    "linen": _linen,
    "upholstery": _upholstery,
    "terry": _terry,
    "carpet": _carpet,
    "leather": _leather,
    "wicker": _wicker,
    "cardboard": _cardboard,
    "paper": _paper,
    "plastic": _plastic,
    "rubber": _rubber,
    "wax": _wax,
    "bread_crust": _bread_crust,
    "fruit_skin": _fruit_skin,
    "sponge": _sponge,
    "leaf": _leaf,
    "soil": _soil,
}
