"""Veils: what stands between visitors and what is lit, so that it has to be seen through.

All else may stay as solid as it is: a whole kitchen of glass is hard to read.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mindstage.viewport.framing import corners
from mindstage.world.geometry import Array, normalize, rotation_matrix

__all__ = ["find_occluders"]

_SAMPLE_INSET = 0.8
"""Of what is lit so much is looked for, from its middle to its corners: its very edge may be behind something."""


def find_occluders(eye: Array, poses: Array, sizes: Array, highlighted: NDArray[np.intp]) -> NDArray[np.intp]:
    """The bodies that hide some of what is lit from an eye, or that it is in.

    Args:
        eye: where one looks from [m].
        poses: of all bodies, n x 7.
        sizes: of all bodies, n x 3 [m].
        lit: the rows of those that are lit.

    Returns:
        Rows, none of them lit.
    """
    points = np.concatenate([poses[highlighted, :3], corners(poses[highlighted], sizes[highlighted] * _SAMPLE_INSET)])
    turn = rotation_matrix(normalize(poses[:, 3:]))
    # In each body's own frame the line of sight to a point runs from `start` along `path`, which is 1 long.
    start = np.einsum("nji,nj->ni", turn, eye - poses[:, :3])[:, None]
    path = np.einsum("nji,npj->npi", turn, points[None] - poses[:, None, :3]) - start
    with np.errstate(divide="ignore", invalid="ignore"):
        enter, leave = ((sign * sizes[:, None] / 2 - start) / path for sign in (-1.0, 1.0))
    first = np.nanmax(np.minimum(enter, leave), axis=2)
    last = np.nanmin(np.maximum(enter, leave), axis=2)
    crossed = np.any(np.maximum(first, 0.0) < np.minimum(last, 1.0), axis=1)
    crossed[highlighted] = False
    return np.flatnonzero(crossed)
