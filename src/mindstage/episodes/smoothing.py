"""Noise of recorded positions: how large it is, and what is left of it after smoothing.

The positions of a body are smoothed by the longest window of which a polynomial explains them within the noise: a line
over `LINE_S` to both sides (rest, or steady motion), else a parabola over `PARABOLA_S` (as of a fall), else the median
of three frames, which also removes single outliers. The choice of the longest window that agrees with the data is that
of O. V. Lepski (1991) and of A. Goldenshluger and A. Nemirovski: On spatially adaptive estimation of nonparametric
regression, Mathematical Methods of Statistics 6(2), 1997. Where positions have no noise, only the median is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from mindstage.engines.base import PoseArray
from mindstage.episodes.recording import EpisodeFrame, Recording
from mindstage.episodes.tracking import DetectionThresholds
from mindstage.scene import BodyId, Mobility
from mindstage.scene.bounding_boxes import Indices
from mindstage.scene.transforms import Array, normalize

__all__ = ["LINE_S", "estimate_noise", "smoothed_poses", "thresholds_for"]

LINE_S = 0.27
"""Half of the longest window [s]."""
PARABOLA_S = 0.14
_MIN_NOISE_M = 0.0003
"""Noise below this counts as none [m]."""
_FRAMES = 900
"""Number of frames by which noise is estimated."""
_EXCESS = 1.25
"""How much larger than the noise residuals may be, as root mean square: 2.5 standard deviations for 17 frames."""
_UNIT_TOLERANCE = 1e-9
"""By how much the squared norm of a unit quaternion may differ from 1; dimensionless."""


def estimate_noise(recording: Recording) -> tuple[float, float]:
    """The noise of the positions of bodies that can move, and the time between frames.

    The noise is the median over the bodies of the median deviation of a position from the line between its neighbors in
    time, as standard deviation along an axis. Motions matter little, since most of them are steady most of the time.

    Returns:
        The noise [m], 0 if it is below 0.3 mm; and the median of the time between frames [s].
    """
    rows_of: dict[BodyId, list[Array]] = {}
    steps: list[float] = []
    before: list[EpisodeFrame] = []
    rows: Indices = np.zeros(0, dtype=np.intp)
    for frame in islice(recording.frames(), _FRAMES):
        if before and frame.time_s <= before[-1].time_s:
            continue
        if before and frame.ids != before[-1].ids:
            before = []
        if not before:
            movable = {body.id for body in frame.structure.bodies if body.physics.mobility is not Mobility.STATIC}
            rows = np.array([row for row, id in enumerate(frame.ids) if id in movable], dtype=np.intp)
        before = [*before[-2:], frame]
        if len(before) < 3:
            continue
        one, middle, other = before
        steps.append(other.time_s - middle.time_s)
        share = (middle.time_s - one.time_s) / (other.time_s - one.time_s)
        line = (1.0 - share) * one.poses[rows, :3] + share * other.poses[rows, :3]
        deviation = (middle.poses[rows, :3] - line) / np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)
        for row, each in zip(rows.tolist(), deviation, strict=True):
            rows_of.setdefault(frame.ids[row], []).append(each)
    if not rows_of:
        return 0.0, 0.0
    deviations = [np.nanmedian(np.abs(np.array(each))) for each in rows_of.values()]
    noise_m = float(np.nanmedian(deviations)) / _NORMAL_MEDIAN
    return (noise_m if noise_m >= _MIN_NOISE_M else 0.0), float(np.median(steps))


_NORMAL_MEDIAN = 0.6745
"""The median of the absolute value of a standard normal variable."""


def thresholds_for(thresholds: DetectionThresholds, noise_m: float, step_s: float) -> DetectionThresholds:
    """Thresholds that smoothed positions with noise do not exceed by chance.

    Args:
        thresholds: those without noise.
        noise_m: the standard deviation of positions along an axis [m].
        step_s: time between frames [s].
    """
    if not noise_m:
        return thresholds
    left_m = noise_m / np.sqrt(max(2.0 * LINE_S / max(step_s, 1e-3), 1.0))  # the noise of a mean over the window
    return replace(
        thresholds,
        still_m=max(thresholds.still_m, 6.0 * left_m),
        rest_m=max(thresholds.rest_m, 3.5 * left_m),
        contact_gap_m=tuple(gap + 4.0 * left_m for gap in thresholds.contact_gap_m),
        touching_gap_m=thresholds.touching_gap_m + 6.0 * left_m,
        changed_m=4.0 * noise_m,
        flight_tolerance_m=thresholds.flight_tolerance_m + 2.0 * noise_m,
        move_m_s=tuple(speed + 15.0 * left_m for speed in thresholds.move_m_s),
    )


def smoothed_poses(frames: Sequence[EpisodeFrame], index: int, *, noise_m: float) -> PoseArray:
    """The poses of one of several successive frames, with smoothed positions and unit quaternions; n x 7."""
    frame = frames[index]
    poses = np.array(frame.poses, dtype=np.float64)
    off = np.abs(np.einsum("ij,ij->i", poses[:, 3:], poses[:, 3:]) - 1.0) > _UNIT_TOLERANCE
    if off.any():
        poses[off, 3:] = normalize(poses[off, 3:])
    first, last = index, index
    while first and frames[first - 1].ids == frame.ids and frames[first - 1].time_s >= frame.time_s - LINE_S:
        first -= 1
    while (
        last + 1 < len(frames)
        and frames[last + 1].ids == frame.ids
        and frames[last + 1].time_s <= frame.time_s + LINE_S
    ):
        last += 1
    near = [frames[each] for each in (index - 1, index + 1) if 0 <= each < len(frames)]
    if len(near) == 2 and near[0].ids == frame.ids == near[1].ids:
        one, other = near[0].poses[:, :3], near[1].poses[:, :3]
        poses[:, :3] = np.clip(poses[:, :3], np.minimum(one, other), np.maximum(one, other))
    if not noise_m:
        return poses
    around = [frames[each] for each in range(first, last + 1)]
    times = np.array([each.time_s for each in around]) - frame.time_s
    window = np.stack([each.poses[:, :3] for each in around])
    left = np.flatnonzero((window != window[0]).any(axis=(0, 2)))  # others rest, without noise
    for span_s, degree in ((LINE_S, 1), (PARABOLA_S, 2)):
        inside = np.abs(times) <= span_s + 1e-9
        count = int(inside.sum())
        if not len(left) or count < degree + 3:
            continue
        powers = np.vander(times[inside], degree + 1)
        data = window[inside][:, left].reshape(count, -1)
        if not np.isfinite(data).all():
            continue
        fit, *_ = np.linalg.lstsq(powers, data, rcond=None)
        residual = (data - powers @ fit).reshape(count, -1, 3)
        rms = np.sqrt((residual**2).sum(axis=(0, 2)) / (3 * (count - degree - 1)))
        agrees = rms <= _EXCESS * noise_m
        poses[left[agrees], :3] = fit[-1].reshape(-1, 3)[agrees]
        left = left[~agrees]
    return poses
