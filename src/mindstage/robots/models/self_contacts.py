"""What touches in random states of a robot, as MoveIt's setup assistant finds it.

A pair that touches in nearly all of them says nothing about collisions, such as a bearing and what turns in it. One
that is near in the tree of links and touches in some of them often does so only since the convex hull of one fills a
hollow in which the other moves.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from mindstage.engines.mujoco.touching_links import touching_shares
from mindstage.robots.models.forward_kinematics import rest_positions
from mindstage.robots.models.link_tree import LinkTree

__all__ = ["SelfContacts", "find_self_contacts"]

_STATES, _SEED = 150, 1
"""Number of random states, and what they begin from."""
_ALWAYS = 0.9
"""The part of the states from which on a pair always touches; about that of MoveIt's setup assistant."""
_OFTEN = 0.1
"""The part from which on a pair that is near in the tree is looked at: dividing a mesh takes seconds."""
_NEAR_JOINTS = 2
"""Number of joints between two links that are near in the tree."""


class SelfContacts(NamedTuple):
    """Pairs of links that touch in random states, the lower name first."""

    always: frozenset[tuple[str, str]]
    often: dict[tuple[str, str], float]
    """Those near in the tree that move and touch in some states, with the part of these."""


def find_self_contacts(tree: LinkTree, *, ignored: Collection[tuple[str, str]]) -> SelfContacts:
    """Finds the pairs of links that touch in random states.

    Args:
        ignored: pairs that are not tested, such as neighbors.
    """
    random = np.random.default_rng(_SEED)
    drives = [joint for joint in tree.joints.values() if joint.is_actuated]
    low, high = np.clip(np.array([joint.limits for joint in drives]).reshape(-1, 2), -np.pi, np.pi).T
    rows = random.uniform(low, high, (_STATES, len(drives)))
    positions = (dict(zip((joint.name for joint in drives), row.tolist(), strict=True)) for row in rows)
    states = (tree.poses(rest_positions(tree.joints.values(), each)) for each in positions)
    shares = touching_shares({link: tree.shape_points(link) for link in tree.links}, states, ignored=ignored)
    return SelfContacts(
        frozenset(pair for pair, share in shares.items() if share >= _ALWAYS),
        {pair: share for pair, share in shares.items() if share >= _OFTEN and _are_near(tree, *pair)},
    )


def _are_near(tree: LinkTree, first: str, second: str) -> bool:
    chain = tree.chain(first, second) or tree.chain(second, first)
    return chain is not None and 0 < sum(joint.is_movable for joint in chain) <= _NEAR_JOINTS
