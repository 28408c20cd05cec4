"""Nesting frames: whether a part's pose is told in the frame of the map, or in that of what it is a part of.

Maps do not say it, but only one of the two puts parts near their wholes.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mindstage.knowledge.readers.rewording import Rewording
from mindstage.world import Iri, Pose
from mindstage.world.geometry import Array, compose, pose_from, unit_pose

__all__ = ["told_within"]


def told_within(rewording: Rewording, poses: Mapping[Iri, Pose], wholes: Mapping[Iri, Iri]) -> Mapping[Iri, Pose]:
    """The poses in the frame of the map, whichever frame they are told in.

    Args:
        rewording: where the decision is said aloud.
        poses: as told.
        wholes: what each part is a part of.
    """
    parts = {part: whole for part, whole in wholes.items() if part in poses and whole in poses}
    if not parts:
        return poses
    rows = {individual: unit_pose(pose) for individual, pose in poses.items()}
    within = _descended(parts, rows)
    nearer = 0
    for part, whole in parts.items():
        as_map = float(np.linalg.norm(rows[part][:3] - rows[whole][:3]))
        as_part = float(np.linalg.norm(within[part][:3] - within[whole][:3]))
        nearer += as_part < as_map
    evidence = f"{len(parts) - nearer} of {len(parts)} parts are not farther from their wholes this way than the other"
    if 2 * nearer <= len(parts):
        rewording.excerpt.assume("poses of parts", "in the frame of the map", evidence)
        return poses
    evidence = f"{nearer} of {len(parts)} parts are nearer to their wholes this way than the other"
    rewording.excerpt.assume("poses of parts", "in the frame of what they are parts of", evidence)
    return {part: pose_from(within[part]) if part in parts else pose for part, pose in poses.items()}


def _descended(parts: Mapping[Iri, Iri], rows: Mapping[Iri, Array]) -> Mapping[Iri, Array]:
    """Where things are if each part is told within its whole; a circle ends where it would begin again."""
    found: dict[Iri, Array] = {}
    for start in rows:
        way: dict[Iri, None] = {}
        here = start
        while here in parts and here not in found and here not in way:
            way[here] = None
            here = parts[here]
        row = found.setdefault(here, rows[here])
        for part in reversed(way):
            if part not in found:
                row = found[part] = compose(row, rows[part])
    return found
