"""Crowds: many bodies in one and the same place, which is what a map looks like whose poses were never written."""

from __future__ import annotations

from collections import Counter

from mindstage.knowledge.findings import FindingSink, Severity
from mindstage.knowledge.vocabulary import HAS_POSE
from mindstage.world import World

__all__ = ["check_duplicate_poses"]

_MIN_DUPLICATES = 10
"""So many bodies in one place are a crowd; a door, its panel and its hinge may well share one."""


def check_duplicate_poses(world: World, report: FindingSink) -> None:
    """Reports the places that many bodies are in."""
    places = Counter(body.pose.position for body in world.bodies)
    for place, number in places.items():
        if number >= _MIN_DUPLICATES:
            where = " ".join(f"{part:g}" for part in place)
            report(
                Severity.WARNING,
                world.iri,
                HAS_POSE,
                f"{number:,} bodies are in one place ({where})",
                "they stay there",
            )
