"""Shells: bodies that everything is in, such as walls or a panorama.

Maps give each body the box around it, and the box around the walls of a kitchen holds the whole kitchen. Such a body
is where things are, not one of them.
"""

from __future__ import annotations

from collections.abc import Container

import numpy as np
from numpy.typing import NDArray

from mindstage.world.boxes import Indices, OrientedBoxes

__all__ = ["ENCLOSURE_MIN_CONTENTS", "ENCLOSURE_MIN_SIZE_M", "find_enclosing_bodies"]

ENCLOSURE_MIN_SIZE_M = (1.0, 2.0, 2.0)
"""A shell is at least so large along its shortest, middle and longest side: one can stand in it."""
ENCLOSURE_MIN_CONTENTS = 3
"""A shell holds at least so many pieces of furniture that do not hang on it."""


def find_enclosing_bodies(
    boxes: OrientedBoxes,
    containing_pairs: tuple[Indices, Indices],
    *,
    is_dynamic: NDArray[np.bool_],
    is_free: NDArray[np.bool_],
    group: NDArray[np.intp],
    jointed_pairs: Container[tuple[int, int]],
) -> dict[int, int]:
    """Shells, and how many pieces of furniture each holds.

    Args:
        boxes: all bodies.
        holds: pairs (outer, inner) of bodies of different assemblies, of which the one holds the other.
        moves: for each body, whether the physics moves it.
        loose: for each body, whether it stands on its own and could be taken away; all others are furniture.
        assembly: for each body, the number of those that hang together rigidly.
        joined: pairs of assemblies, in one order or the other, that a constraint joins.
    """
    large = np.all(np.sort(2 * boxes.half_extents, axis=1) >= ENCLOSURE_MIN_SIZE_M, axis=1) & ~is_dynamic
    outer, inner = containing_pairs
    furniture = large[outer] & ~is_free[inner]
    held: dict[int, set[int]] = {}
    for o, i in zip(outer[furniture].tolist(), group[inner[furniture]].tolist(), strict=True):
        held.setdefault(o, set()).add(i)
    found = {}
    for o, inside in sorted(held.items()):
        own = int(group[o])
        if (
            sum((own, i) not in jointed_pairs and (i, own) not in jointed_pairs for i in inside)
            >= ENCLOSURE_MIN_CONTENTS
        ):
            found[o] = len(inside)
    return found
