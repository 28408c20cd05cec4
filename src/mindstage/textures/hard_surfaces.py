"""Metals, glazes, minerals and building materials."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mindstage.textures.noise import Array, Grid, Recipe, Surface, smooth_step, tinted

__all__ = ["HARD_SURFACES"]


def _brushed_steel(grid: Grid) -> Surface:
    """Scratches along u, a few centimeters long and as fine as the image allows."""
    fine = grid.noise(0.05, 0.0004)
    long = grid.noise(0.25, 0.0012)
    streaks = 0.75 * fine + 0.5 * long
    return Surface(1.0 + 0.045 * streaks, 9e-6 * streaks, 0.80 + 0.10 * streaks + 0.03 * grid.noise(0.1))


def _polished_metal(grid: Grid) -> Surface:
    smudges = smooth_step(0.6, 2.0, grid.fractal(0.1, 0.008))
    return Surface(np.ones_like(smudges), 1.5e-6 * grid.fractal(0.1, 0.01), 0.72 + 0.28 * smudges)


def _cast_iron(grid: Grid) -> Surface:
    bumps = grid.fractal(0.004, 0.0007, slope=0.6)
    return Surface(1.0 + 0.07 * bumps, 4e-5 * bumps, 0.85 + 0.06 * bumps)


def _enamel(grid: Grid) -> Surface:
    waves = grid.fractal(0.03, 0.003)
    return Surface(1.0 + 0.003 * waves, 5e-6 * waves, 0.90 + 0.04 * grid.noise(0.05))


def _glazed_ceramic(grid: Grid) -> Surface:
    """Glaze that has run a little, with a few dark specks of the clay."""
    pool = grid.noise(0.06, 0.06)
    waves = grid.fractal(0.05, 0.008, slope=1.4)
    distance, _, number = grid.cells(0.009)
    specks = (number > 0.8) * (1.0 - smooth_step(0.02, 0.06, distance))
    return Surface(tinted(0.03 * (pool + 1.0) + 0.35 * specks, (0.6, 0.8, 1.0)), 2.2e-5 * waves, 0.88 + 0.05 * pool)


def _terracotta(grid: Grid) -> Surface:
    sand = grid.fractal(0.003, 0.0006, slope=0.4)
    cloud = grid.fractal(0.15, 0.02)
    distance, _, number = grid.cells(0.004)
    pits = (number > 0.7) * (1.0 - smooth_step(0.1, 0.25, distance))
    light = 0.08 * cloud + 0.06 * sand
    return Surface(
        tinted(0.16 - light + 0.25 * pits, (0.7, 0.95, 1.0)), 2.5e-5 * sand - 1.5e-4 * pits, 0.95 + 0.02 * sand
    )


def _glass(grid: Grid) -> Surface:
    smudges = smooth_step(1.0, 2.5, grid.fractal(0.12, 0.01))
    return Surface(np.ones_like(smudges), 2e-6 * grid.fractal(0.3, 0.03), 0.80 + 0.20 * smudges)


def _mirror(grid: Grid) -> Surface:
    flat = np.zeros((grid.pixels, grid.pixels), dtype=np.float32)
    return Surface(flat + 1.0, flat, flat + 1.0)


def _granite(grid: Grid) -> Surface:
    """Grains of feldspar, quartz and mica, polished to one plane."""
    blur = grid.noise(0.0016) * 0.0009
    shade: Array = np.full((grid.pixels, grid.pixels, 3), 0.78, dtype=np.float32)
    for length, share, tone in (
        (0.0060, 0.45, (1.02, 1.00, 0.96)),
        (0.0040, 0.35, (0.60, 0.58, 0.57)),
        (0.0032, 0.22, (0.90, 0.78, 0.68)),
        (0.0024, 0.22, (0.24, 0.24, 0.26)),
    ):
        distance, second, number = grid.cells(length)
        edge = smooth_step(0.0, 0.16, grid.shifted(second - distance, blur, blur))
        kept = (grid.shifted((number < share).astype(np.float32), blur, blur) * edge)[..., None]
        shade = shade * (1.0 - kept) + kept * np.array(tone, dtype=np.float32)
    shade = shade * (1.0 + 0.06 * grid.fractal(0.2, 0.004)[..., None])
    dark = 1.0 - shade.mean(axis=2)
    return Surface(shade.astype(np.float32), 1e-6 * grid.fractal(0.05, 0.004), 0.78 + 0.2 * dark)


def _marble(grid: Grid) -> Surface:
    swirl = 0.10 * grid.fractal(0.5, 0.02, slope=1.2)
    veins = np.zeros_like(swirl)
    for reach, strength in ((0.6, 0.5), (0.25, 0.3)):
        ridge = np.abs(grid.shifted(grid.fractal(reach, 0.01, slope=1.3), swirl, 0.7 * swirl))
        veins = np.maximum(veins, strength * (1.0 - smooth_step(0.0, 0.16, ridge)))
    cloud = 0.06 * (grid.fractal(0.5, 0.05) + 1.0)
    return Surface(tinted(veins + cloud, (1.0, 0.98, 0.92)), np.zeros_like(swirl), 0.85 + 0.15 * veins)


def _concrete(grid: Grid) -> Surface:
    cloud, grain = grid.fractal(0.6, 0.02), grid.fractal(0.006, 0.002, slope=0.3)
    distance, _, number = grid.cells(0.025)
    pores = (number > 0.6) * (1.0 - smooth_step(0.03, 0.09, distance))
    return Surface(1.0 + 0.06 * cloud + 0.03 * grain - 0.3 * pores, 4e-5 * grain - 4e-4 * pores, 0.92 + 0.04 * grain)


def _plaster(grid: Grid) -> Surface:
    """Paint applied with a roller: soft bumps of a few millimeters."""
    stipple = grid.fractal(0.010, 0.004, slope=0.5)
    waves = grid.fractal(0.5, 0.08)
    return Surface(1.0 + 0.010 * waves + 0.012 * stipple, 6e-5 * stipple + 2e-4 * waves, 0.95 + 0.03 * stipple)


def _tiles(grid: Grid, count: int, grout: float, *, cushion: float) -> tuple[Array, Array, Array]:
    """The number of each tile from 0 to 1, how much of each pixel is grout, and the height of cushioned edges [m]."""
    distances = []
    for share, extent in ((grid.u, grid.size[0]), (grid.v, grid.size[1])):
        phase = share * count - np.floor(share * count)
        distances.append(np.minimum(phase, 1.0 - phase) * (extent / count))
    edge = np.minimum(*distances).astype(np.float32)
    joint = 1.0 - smooth_step(0.4 * grout, 0.8 * grout, edge)
    tones = grid.rng.random((count, count), dtype=np.float32)
    tone = tones[np.floor(grid.v * count).astype(int) % count, np.floor(grid.u * count).astype(int) % count]
    height = cushion * smooth_step(0.4 * grout, 2.5 * grout, edge)
    return tone, joint, height


def _floor_tiles(grid: Grid) -> Surface:
    tone, joint, height = _tiles(grid, 3, 0.004, cushion=0.0008)
    cloud, grain = grid.fractal(0.25, 0.01), grid.fractal(0.006, 0.002, slope=0.3)
    shade = 1.0 + 0.10 * (tone - 0.5) + 0.06 * cloud + 0.02 * grain
    shade = shade * (1.0 - joint) + (0.62 + 0.03 * grain) * joint
    return Surface(shade, height + 1.5e-5 * grain * (1 + 4 * joint), 0.72 + 0.04 * cloud + 0.25 * joint)


def _wall_tiles(grid: Grid) -> Surface:
    tone, joint, height = _tiles(grid, 4, 0.003, cushion=0.0006)
    waves, grain = grid.noise(0.05), grid.fractal(0.004, 0.002, slope=0.3)
    shade = (1.0 + 0.03 * (tone - 0.5) + 0.006 * waves) * (1.0 - joint) + (0.72 + 0.03 * grain) * joint
    return Surface(shade, height + 3e-5 * waves * (1 - joint) + 3e-5 * grain * joint, 0.30 + 0.02 * waves + 0.7 * joint)


HARD_SURFACES: Mapping[str, Recipe] = {
    "brushed_steel": _brushed_steel,
    "polished_metal": _polished_metal,
    "cast_iron": _cast_iron,
    "enamel": _enamel,
    "glazed_ceramic": _glazed_ceramic,
    "terracotta": _terracotta,
    "glass": _glass,
    "mirror": _mirror,
    "granite": _granite,
    "marble": _marble,
    "concrete": _concrete,
    "plaster": _plaster,
    "floor_tiles": _floor_tiles,
    "wall_tiles": _wall_tiles,
}
