"""Ghosts: translucent copies of bodies at other poses, which no mouse event reaches.

Layers show the end poses of the samples of a plan, one sample over time, and the open copies of the simulation.
Only one thread may call into this module.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING
from urllib.parse import quote

import numpy as np
import viser
from numpy.typing import NDArray

from mindstage.access.limits import COPIED_BODIES, GHOSTS
from mindstage.rendering.appearance import BodyAppearance, merge_visuals
from mindstage.scene import BodyId, Color
from mindstage.scene.colors import srgb_to_linear
from mindstage.scene.transforms import Array, normalize

if TYPE_CHECKING:
    from mindstage.imagination import ReplayFrame, Verdict
    from mindstage.simulation import Simulation, StateSnapshot

__all__ = [
    "FAILED_COLOR",
    "GhostGroup",
    "GhostNodes",
    "ImaginationGhosts",
    "ReplayGhosts",
    "end_pose_ghosts",
    "trail_ghosts",
]

_OPACITY = 0.3
_SUCCEEDED_COLOR: Color = (0.13, 0.62, 0.33)
FAILED_COLOR: Color = (0.86, 0.2, 0.18)
_UNKNOWN_COLOR: Color = (0.93, 0.66, 0.1)
_TINTS: tuple[Color, ...] = ((0.2, 0.45, 0.9), (0.62, 0.3, 0.85), (0.05, 0.65, 0.7), (0.9, 0.45, 0.1))
"""Colors of open copies, in turn."""
_MOVED_M = 1e-3
_TURNED = 1e-3
"""A body of a copy is drawn if its position [m] or a component of its unit quaternion differs by more."""
_COPIES_INTERVAL_S = 0.1
_TRAIL = 8
"""Number of moments of a sample in a picture."""


@dataclass(frozen=True, slots=True, eq=False)
class GhostGroup:
    """The ghosts of one body."""

    body: BodyId
    poses: Array
    """n x 7."""
    colors: Array
    """n x 3, red, green and blue from 0 to 1."""


class GhostNodes:
    """The nodes of ghosts: one instanced node for each body of a layer."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Creates no nodes yet.

        Args:
            server: the server of the scene.
        """
        self._server = server
        self._nodes: dict[tuple[str, BodyId], tuple[viser.BatchedMeshHandle, BodyAppearance, int]] = {}

    @property
    def layers(self) -> frozenset[str]:
        """The layers that have nodes."""
        return frozenset(layer for layer, _ in self._nodes)

    def show(
        self, layer: str, groups: Iterable[GhostGroup], appearances: Mapping[BodyId, BodyAppearance]
    ) -> tuple[BodyId, ...]:
        """Shows these ghosts in a layer, and removes its other ones.

        Args:
            layer: the name of the layer.
            groups: one group for each body.
            appearances: how bodies are drawn.

        Returns:
            The bodies that cannot be drawn, since they have no appearance.
        """
        wanted = {group.body: group for group in groups if len(group.poses)}
        missing = tuple(id for id in wanted if id not in appearances or not appearances[id].visuals)
        with self._server.atomic():
            for (name, id), (node, _, _) in list(self._nodes.items()):
                if name == layer and (id not in wanted or id in missing):
                    node.remove()
                    del self._nodes[name, id]
            for id, group in wanted.items():
                if id not in missing:
                    self._draw(layer, group, appearances[id])
        return missing

    def clear(self, layer: str) -> None:
        """Removes all ghosts of a layer."""
        self.show(layer, (), {})

    def _draw(self, layer: str, group: GhostGroup, appearance: BodyAppearance) -> None:
        key = layer, group.body
        positions = np.ascontiguousarray(group.poses[:, :3], dtype=np.float32)
        quaternions = np.ascontiguousarray(normalize(group.poses[:, 3:]), dtype=np.float32)
        node, drawn, count = self._nodes.get(key, (None, None, 0))
        if node is not None and (drawn is not appearance or count != len(positions)):
            node.remove()
            node = None
        if node is not None:
            node.batched_positions, node.batched_wxyzs = positions, quaternions
            return
        mesh = merge_visuals(appearance.visuals)
        node = self._server.scene.add_batched_meshes_simple(
            f"/ghosts/{quote(layer, safe='')}/{quote(group.body, safe='')}",
            mesh.points.astype(np.float32),
            mesh.faces,
            quaternions,
            positions,
            batched_colors=_bytes(group.colors),
            batched_opacities=np.full(len(positions), _OPACITY, np.float32),
            opacity=1.0,  # enables transparency of instances
            cast_shadow=False,
        )
        self._nodes[key] = node, appearance, len(positions)


def end_pose_ghosts(verdict: Verdict) -> tuple[GhostGroup, ...]:
    """Where bodies end in the samples of a verdict, at most `limits.GHOSTS` of them, colored by outcome."""
    from mindstage.imagination import Outcome

    colors = {Outcome.SUCCEEDED: _SUCCEEDED_COLOR, Outcome.FAILED: FAILED_COLOR, Outcome.UNKNOWN: _UNKNOWN_COLOR}
    results = verdict.results
    chosen = sorted(set(np.linspace(0, len(results) - 1, min(len(results), GHOSTS.count)).round().astype(int).tolist()))
    poses: dict[BodyId, list[tuple[float, ...]]] = {}
    drawn: dict[BodyId, list[Color]] = {}
    for index in chosen:
        for id, pose in results[index].end_poses.items():
            poses.setdefault(BodyId(id), []).append((*pose.position, *pose.quaternion))
            drawn.setdefault(BodyId(id), []).append(colors[results[index].outcome])
    return tuple(GhostGroup(id, np.array(rows), np.array(drawn[id])) for id, rows in poses.items())


class ReplayGhosts:
    """The bodies that move in one sample, over time."""

    def __init__(self, frames: Sequence[ReplayFrame]) -> None:
        """Takes the frames of a sample; what is added or removed in it is not drawn."""
        ids = frames[0].ids if frames else ()
        kept = [frame for frame in frames if frame.ids == ids]
        self._times = np.array([frame.time_s for frame in kept])
        poses = np.array([frame.poses for frame in kept]).reshape(len(kept), len(ids), 7)
        self._rows = _moved_rows(poses)
        self.ids: tuple[BodyId, ...] = tuple(ids[row] for row in self._rows.tolist())
        """The bodies that move."""
        self._poses = poses[:, self._rows]

    @property
    def duration_s(self) -> float:
        """Simulated time of the sample [s]."""
        return float(self._times[-1]) if len(self._times) else 0.0

    def at(self, time_s: float) -> tuple[GhostGroup, ...]:
        """The ghosts at a simulated time since the start, between two frames interpolated."""
        if not len(self._times):
            return ()
        after = int(np.clip(np.searchsorted(self._times, time_s), 1, max(len(self._times) - 1, 1)))
        before = after - 1
        after = min(after, len(self._times) - 1)
        span = float(self._times[after] - self._times[before])
        share = float(np.clip((time_s - self._times[before]) / span, 0.0, 1.0)) if span > 0.0 else 1.0
        start, end = self._poses[before], self._poses[after].copy()
        end[:, 3:] *= np.where((start[:, 3:] * end[:, 3:]).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
        poses = (1.0 - share) * start + share * end
        color = np.array([FAILED_COLOR])
        return tuple(GhostGroup(id, poses[row : row + 1], color) for row, id in enumerate(self.ids))


def trail_ghosts(frames: Sequence[ReplayFrame]) -> tuple[GhostGroup, ...]:
    """The moving bodies of a sample at several moments, for a picture."""
    replay = ReplayGhosts(frames)
    moments = [replay.at(time_s) for time_s in np.linspace(0.0, replay.duration_s, _TRAIL).tolist()]
    return tuple(
        GhostGroup(id, np.concatenate([each[row].poses for each in moments]), np.array([FAILED_COLOR] * _TRAIL))
        for row, id in enumerate(replay.ids)
    )


class ImaginationGhosts:
    """The open copies of a simulation, each as a layer with the bodies that are elsewhere in it."""

    def __init__(self, nodes: GhostNodes) -> None:
        """Draws nothing yet.

        Args:
            nodes: the nodes of all ghosts.
        """
        self.is_shown = True
        """Whether copies are drawn."""
        self._nodes = nodes
        self._numbers: dict[int, int] = {}
        """The number of each copy, by its identity."""
        self._count = 0
        self._due_s = 0.0
        self._before: object = None

    def update(
        self, simulation: Simulation, snapshot: StateSnapshot, appearances: Mapping[BodyId, BodyAppearance]
    ) -> list[dict[str, object]] | None:
        """Draws the copies as they are now, at most ten times a second.

        Args:
            simulation: the original.
            appearances: how its bodies are drawn; what exists in a copy only is not drawn.

        Returns:
            The number, color, simulated time and number of differing bodies of each copy; None if it was not due.
        """
        if time.monotonic() < self._due_s:
            return None
        self._due_s = time.monotonic() + _COPIES_INTERVAL_S
        copies = simulation.forks
        self._numbers = {id(copy): self._numbers.get(id(copy), -1) for copy in copies}
        for key, number in self._numbers.items():
            if number < 0:
                self._count += 1
                self._numbers[key] = self._count
        shown = copies if self.is_shown else ()
        found, layers = [], set()
        for copy in copies:
            number, state = self._numbers[id(copy)], copy.state
            color, layer = _TINTS[(number - 1) % len(_TINTS)], f"copy {number}"
            differing = _differing_rows(snapshot, state)
            if copy in shown:
                layers.add(layer)
                rows, tint = differing[: COPIED_BODIES.count], np.array([color])
                groups = (GhostGroup(state.ids[row], state.poses[row : row + 1], tint) for row in rows)
                self._nodes.show(layer, groups, appearances)
            found.append({"number": number, "color": color, "time_s": state.time_s, "differing": len(differing)})
        for layer in self._nodes.layers - layers:
            if layer.startswith("copy "):
                self._nodes.clear(layer)
        return found


def _differing_rows(original: StateSnapshot, copy: StateSnapshot) -> list[int]:
    """The rows of a copy's bodies that are elsewhere than in the original, or exist in the copy only."""
    if copy.ids == original.ids:
        difference = np.abs(copy.poses - original.poses)
        far = (difference[:, :3].max(axis=1, initial=0.0) > _MOVED_M) | (
            difference[:, 3:].max(axis=1, initial=0.0) > _TURNED
        )
        return np.flatnonzero(far).tolist()
    row_of = {id: row for row, id in enumerate(original.ids)}
    found = []
    for row, id in enumerate(copy.ids):
        at = row_of.get(id)
        if at is None or np.abs(copy.poses[row] - original.poses[at]).max() > _MOVED_M:
            found.append(row)
    return found


def _moved_rows(poses: Array) -> NDArray[np.intp]:
    """The rows of bodies that move by more than a centimeter, or turn; frames x n x 7."""
    if not len(poses):
        return np.zeros(0, dtype=np.intp)
    spread = np.ptp(poses, axis=0)
    return np.flatnonzero((spread[:, :3].max(axis=1, initial=0.0) > 0.01) | (spread[:, 3:].max(axis=1) > 0.05))


def _bytes(colors: Array) -> NDArray[np.uint8]:
    return np.asarray(np.round(255 * np.clip(srgb_to_linear(colors), 0.0, 1.0)), dtype=np.uint8)
