"""Nesting frames: whether a part's pose is told in the frame of the map, or in that of what it is a part of.

Maps do not say it, but only one of the two puts parts near their wholes.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mindstage.knowledge.readers.rewording import DialectNormalizer
from mindstage.world import Iri, Pose
from mindstage.world.geometry import Array, normalized_pose_array, pose_from_array, pose_multiply

__all__ = ["resolve_pose_frames"]


def resolve_pose_frames(
    normalizer: DialectNormalizer, poses: Mapping[Iri, Pose], parents: Mapping[Iri, Iri]
) -> Mapping[Iri, Pose]:
    """The poses in the frame of the map, whichever frame they are told in.

    Args:
        rewording: where the decision is said aloud.
        poses: as told.
        wholes: what each part is a part of.
    """
    parts = {part: whole for part, whole in parents.items() if part in poses and whole in poses}
    if not parts:
        return poses
    rows = {individual: normalized_pose_array(pose) for individual, pose in poses.items()}
    within = _compose_along_parents(parts, rows)
    nearer = 0
    for part, whole in parts.items():
        as_map = float(np.linalg.norm(rows[part][:3] - rows[whole][:3]))
        as_part = float(np.linalg.norm(within[part][:3] - within[whole][:3]))
        nearer += as_part < as_map
    evidence = f"{len(parts) - nearer} of {len(parts)} parts are not farther from their wholes this way than the other"
    if 2 * nearer <= len(parts):
        normalizer.source_map.record_assumption("poses of parts", "in the frame of the map", evidence)
        return poses
    evidence = f"{nearer} of {len(parts)} parts are nearer to their wholes this way than the other"
    normalizer.source_map.record_assumption("poses of parts", "in the frame of what they are parts of", evidence)
    return {part: pose_from_array(within[part]) if part in parts else pose for part, pose in poses.items()}


def _compose_along_parents(parents: Mapping[Iri, Iri], poses: Mapping[Iri, Array]) -> Mapping[Iri, Array]:
    """Where things are if each part is told within its whole; a circle ends where it would begin again."""
    found: dict[Iri, Array] = {}
    for start in poses:
        way: dict[Iri, None] = {}
        here = start
        while here in parents and here not in found and here not in way:
            way[here] = None
            here = parents[here]
        row = found.setdefault(here, poses[here])
        for part in reversed(way):
            if part not in found:
                row = found[part] = pose_multiply(row, poses[part])
    return found
