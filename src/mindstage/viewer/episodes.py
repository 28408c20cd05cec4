"""Episodes on the page: recording the simulation, and the timeline of a replay.

The timeline seeks, shows events and the path of a body as ghosts, and continues from the shown moment. Playing and
pausing are requests of every simulation; see `handlers`. Events are detected in a thread of their own, as that takes
long for a recording without them.
"""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np
import viser
from msgspec import Meta

from mindstage.access.limits import TRAIL_GHOSTS, TRAIL_POINTS
from mindstage.access.policies import EDIT, FILE, READ
from mindstage.access.resources import without_paths
from mindstage.episodes.recording import EpisodeEvent, EpisodeEventKind, EpisodeFrame, Recording
from mindstage.episodes.replay import EpisodeReplay
from mindstage.errors import BodyNotFoundError, InvalidArgumentError, MindstageError
from mindstage.knowledge import KnowledgeBase
from mindstage.rendering.appearance import BodyAppearance, VisiblePart, compute_appearance
from mindstage.rendering.camera import corners
from mindstage.scene import BodyId, Color, Vector, World
from mindstage.scene.transforms import Array, normalize
from mindstage.simulation import Marker, MarkerType, Simulation, StateSnapshot
from mindstage.viewer.ghosts import GhostGroup, GhostNodes
from mindstage.viewer.scene import BodyNodes, Clickable, Pick
from mindstage.viewer.server import ClientSession, EmptyRequest, RpcChannel

if TYPE_CHECKING:
    from mindstage.episodes.recorder import Recorder, RecordingFolder

__all__ = ["RecordingHandler", "TimelineHandler", "path_of"]

_TOPIC = "timeline"
_TRAIL = "trail"
"""The layer of ghosts, and the marker, of a path."""
_TRAIL_COLOR: Color = (0.76, 0.25, 0.05)
_TRAIL_WIDTH_M = 0.005
_MIN_STEP_M = 0.002
"""Shorter motions are not drawn as segments of a path [m]."""
_QUEUE = "timeline"
_BESIDE = "/beside"
"""The node of the second recording."""
_GAP_M = 0.5
"""Distance between two recordings [m], besides a tenth of the width of the first one."""
_SHOWN_EVENTS = 4
"""The number of events that the page shows while it is recorded."""
_LATE_S = 2.0
"""Smallest delay of events that the page shows [s]."""
_STATES = {EpisodeEventKind.CONTACT, EpisodeEventKind.SUPPORT, EpisodeEventKind.CONTAINMENT}
"""Kinds that are not shown while it is recorded: they are too many."""
_log = logging.getLogger(__name__)

_Seconds = Annotated[float, Meta(ge=-1e12, le=1e12)]


class RecordingHandler:
    """Handles `recording.start` and `recording.stop`, and publishes the state as the topic `recording`."""

    def __init__(self, simulation: Simulation, channel: RpcChannel, *, folder: Path | None = None) -> None:
        """Registers the requests.

        Args:
            simulation: the simulation that is recorded.
            channel: the channel of the pages.
            folder: the folder of the files; by default the working directory.
        """
        self._simulation, self._channel, self._folder = simulation, channel, folder
        self._files: RecordingFolder | None = None
        self._recorder: Recorder | None = None
        channel.register("recording.start", EmptyRequest, self._start, FILE, queue="recording")
        channel.register("recording.stop", EmptyRequest, self._stop, FILE, queue="recording")
        self.publish()

    def publish(self) -> None:
        """Publishes whether it is recording, to which file and for how long, its first fault, and its last events.

        Called several times a second.
        """
        recorder = self._recorder
        state: dict[str, object] = {
            "path": None,
            "time_s": 0.0,
            "failed": False,
            "fault": None,
            "events": [],
            "late_s": 0,
        }
        if recorder is not None:
            fault = None if recorder.error is None else without_paths(str(recorder.error))
            state = {
                "path": recorder.path.name,
                "time_s": round(recorder.time_s),
                "failed": not recorder.recording,
                "fault": fault,
                "events": [
                    {
                        "id": each.id,
                        "kind": each.kind,
                        "thing": each.thing,
                        "other": each.other,
                        "begin_s": each.begin_s,
                    }
                    for each in recorder.live_events
                    if each.kind not in _STATES
                ][-_SHOWN_EVENTS:],
                "late_s": round(late_s) if (late_s := recorder.events_delay_s) > _LATE_S else 0,
            }
        self._channel.publish("recording", state)

    def close(self) -> None:
        """Ends a recording that was begun here."""
        if self._files is not None and self._recorder is not None:
            try:
                self._files.stop()
            except MindstageError as error:
                _log.error("the recording could not be finished: %s", error)

    def _start(self, _: ClientSession, __: EmptyRequest) -> str:
        """Returns the name of the file, which is named like the world with the local date and time."""
        if self._files is None:
            from mindstage.episodes.recorder import RecordingFolder

            self._files = RecordingFolder(self._simulation, self._folder or Path.cwd())
        name = next((world.name for world in self._simulation.worlds if world.name), "")
        plain = re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.")[:60] or "episode"
        path = self._files.start(f"{plain}-{datetime.now().astimezone():%Y-%m-%d-%H-%M-%S}")
        self._recorder = self._files.recorder
        self.publish()
        return path.name

    def _stop(self, _: ClientSession, __: EmptyRequest) -> dict[str, object]:
        """Returns the name of the file, its duration [s] and its size [B]."""
        recorder, self._recorder = self._recorder, None
        if self._files is None or recorder is None:
            raise InvalidArgumentError("the recording", cause="there is none", remedy="start one")
        try:
            path = self._files.stop()
        finally:
            self.publish()
        return {"path": path.name, "time_s": recorder.time_s, "size_bytes": path.stat().st_size}


class SeekRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `timeline.seek`: a time of the recording [s]; one outside of it is its begin or end."""

    time_s: _Seconds


class StepToEventRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `timeline.step_event`: the direction, and the kinds of events to stop at, by default all."""

    back: bool = False
    kinds: tuple[EpisodeEventKind, ...] | None = None


class TrailRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `timeline.trail`: the body whose path is drawn; None draws none."""

    id: BodyId | None = None


def path_of(recording: Recording, id: BodyId) -> Array:
    """The poses of a body over a whole recording, n x 7, at most 2,000; repeated ones are left out.

    Raises:
        BodyNotFoundError: the recording never has that body.
    """
    rows: list[Array] = []
    ids: tuple[BodyId, ...] = ()
    row: int | None = None
    known: set[BodyId] = set()
    for frame in recording.frames():
        if frame.ids is not ids:
            ids = frame.ids
            known.update(ids)
            row = ids.index(id) if id in ids else None
        if row is None:
            continue
        pose = frame.poses[row]
        if not rows or np.abs(pose[:3] - rows[-1][:3]).max() > _MIN_STEP_M:
            rows.append(pose.copy())
    if id not in known:
        raise BodyNotFoundError(id, known=known, world=recording.name)
    chosen = np.linspace(0, len(rows) - 1, min(len(rows), TRAIL_POINTS.count)).round().astype(int)
    path: Array = np.array(rows)[chosen]
    return path


class _BesideWorld:
    """A second recording, drawn beside the first one in a frame of its own, with the names of both above them."""

    def __init__(
        self, recording: Recording, first: Recording, knowledge: KnowledgeBase, server: viser.ViserServer
    ) -> None:
        self._recording, self._first, self._knowledge, self._server = recording, first, knowledge, server
        self._nodes = BodyNodes(server.scene, on_node=_no_callback, parent=_BESIDE)
        self._offset: Array | None = None
        self._frame: EpisodeFrame | None = None
        self._structure: World | None = None

    def update(self, snapshot: StateSnapshot, appearances: Mapping[BodyId, BodyAppearance]) -> Array | None:
        """Draws the recording at the time of a snapshot.

        Returns:
            How far it is moved from where it was recorded [m], when it is drawn first; else None.
        """
        recording = self._recording
        frame = recording.frame_at(min(max(snapshot.time_s, recording.begin_s), recording.end_s))
        if frame is self._frame or not appearances:
            return None
        self._frame, moved = frame, None
        with self._server.atomic():
            if frame.structure is not self._structure:
                self._structure = frame.structure
                look = compute_appearance(
                    frame.structure,
                    self._knowledge.shape_rule,
                    self._knowledge.ancestors,
                    geometry=recording.geometry,
                )
                if self._offset is None:
                    moved = self._place(_extent(snapshot.ids, snapshot.poses, appearances), frame, look)
                self._nodes.show(look, draggable=())
            poses = frame.poses.copy()
            poses[:, 3:] = normalize(poses[:, 3:])
            self._nodes.set_poses(frame.ids, poses)
        return moved

    def _place(self, first: Array, frame: EpisodeFrame, look: Mapping[BodyId, BodyAppearance]) -> Array:
        """Chooses the place along the shorter side of the first world."""
        second = _extent(frame.ids, frame.poses, look)
        axis = int(np.argmin(first[1, :2] - first[0, :2]))
        gap = _GAP_M + 0.1 * float(first[1, axis] - first[0, axis])
        self._offset = np.zeros(3)
        self._offset[axis] = first[1, axis] + gap - second[0, axis]
        scene = self._server.scene
        scene.add_frame(_BESIDE, show_axes=False, position=self._offset)
        for number, (recording, box) in enumerate(((self._first, first), (self._recording, second + self._offset))):
            top = (*box.mean(axis=0)[:2], box[1, 2] + 0.2)
            scene.add_label(f"/episode names/{number}", recording.name, position=top)
        return self._offset


def _extent(ids: Sequence[BodyId], poses: Array, appearances: Mapping[BodyId, BodyAppearance]) -> Array:
    """The lowest and the highest corner of the bodies that are drawn whole, 2 x 3 [m]."""
    rows = [row for row, id in enumerate(ids) if id in appearances and appearances[id].part is not VisiblePart.OUTLINE]
    if not rows:
        return np.zeros((2, 3))
    points = corners(poses[rows], np.array([appearances[ids[row]].size for row in rows]))
    return np.array([points.min(axis=0), points.max(axis=0)])


def _no_callback(node: Clickable, pick: Pick, *, draggable: bool) -> None:
    """Registers nothing: a click in the second world selects nothing."""


class TimelineHandler:
    """Handles the requests `timeline.…`, and publishes the recording as the topic `timeline`.

    The topic `timeline_state` has what changes while it is shown.
    """

    def __init__(
        self,
        replay: EpisodeReplay,
        channel: RpcChannel,
        server: viser.ViserServer,
        nodes: GhostNodes,
        *,
        on_beside: Callable[[Array], None],
    ) -> None:
        """Registers the requests, and begins to detect events.

        Args:
            channel: the channel of the pages.
            server: the server of the scene.
            nodes: the nodes of ghosts, which only `update` uses.
            on_beside: called in the thread of `update` when a second recording is drawn first, with the distance from
                where it was recorded, three numbers [m].
        """
        self._replay, self._channel, self._nodes = replay, channel, nodes
        self._trail: tuple[GhostGroup, ...] = ()
        self._drawn_trail: tuple[GhostGroup, ...] = ()
        self._drawn_revision = -1
        self._trail_id: BodyId | None = None
        self._notes: tuple[str, ...] = ()
        self._on_beside = on_beside
        self._beside: _BesideWorld | None = None
        if replay.beside is not None:
            self._beside = _BesideWorld(replay.beside, replay.recording, replay.knowledge, server)
        channel.register("timeline.seek", SeekRequest, self._seek, READ, queue=_QUEUE)
        channel.register("timeline.step_event", StepToEventRequest, self._step_to_event, READ, queue=_QUEUE)
        channel.register(
            "timeline.trail", TrailRequest, lambda _, request: self.show_trail(request.id), READ, queue="timeline.trail"
        )
        channel.register("timeline.resume", EmptyRequest, self._resume, EDIT)
        channel.register("timeline.return", EmptyRequest, self._return, EDIT)
        self._publish_recording(None)
        threading.Thread(target=self._find_events, name="mindstage-episode-events", daemon=True).start()

    def show_trail(self, id: BodyId | None) -> int:
        """Shows the path of a body over the whole recording, as a line and ghosts; None removes it.

        Returns:
            The number of points of the path.

        Raises:
            BodyNotFoundError: the recording never has that body.
            InvalidArgumentError: the body does not move.
        """
        if id is None:
            self._trail, self._trail_id = (), None
            self._replay.markers.remove([_TRAIL])
            return 0
        path = path_of(self._replay.recording, id)
        if len(path) < 2:
            raise InvalidArgumentError(
                id, cause="it does not move in this recording", remedy="select a body that moves"
            )
        chosen = np.linspace(0, len(path) - 1, min(len(path), TRAIL_GHOSTS.count)).round().astype(int)
        colors = np.tile(np.array(_TRAIL_COLOR), (len(chosen), 1))
        self._trail = (GhostGroup(id, path[chosen], colors),)
        self._trail_id = id
        line = Marker(
            id=_TRAIL,
            type=MarkerType.LINE_STRIP,
            size=(_TRAIL_WIDTH_M, 0.0, 0.0),
            color=_TRAIL_COLOR,
            points=tuple(_vector(row) for row in path[:, :3]),
        )
        self._replay.markers.add([line])
        return len(path)

    # -- for the drawing thread ----------------------------------------------------------------------------------------

    def update(self, snapshot: StateSnapshot, appearances: Mapping[BodyId, BodyAppearance]) -> None:
        """Draws the ghosts of the path, and the second recording."""
        if self._beside is not None and (offset := self._beside.update(snapshot, appearances)) is not None:
            self._on_beside(offset)
        if self._trail is self._drawn_trail and snapshot.revision == self._drawn_revision:
            return
        self._drawn_trail, self._drawn_revision = self._trail, snapshot.revision
        self._nodes.show(_TRAIL, self._drawn_trail, appearances)

    def publish(self, snapshot: StateSnapshot) -> None:
        """Publishes the shown time; called several times a second."""
        state = {
            "time_s": snapshot.time_s,
            "playing": snapshot.playing,
            "speed": snapshot.speed,
            "resumed_at_s": self._replay.resumed_at_s,
            "notes": self._notes,
            "trail": self._trail_id,
        }
        self._channel.publish("timeline_state", state)

    # -- events --------------------------------------------------------------------------------------------------------

    def _find_events(self) -> None:
        found = [self._events_of(self._replay.recording)]
        if self._replay.beside is not None:
            found.append(self._events_of(self._replay.beside))
        self._publish_recording(found)

    def _events_of(self, recording: Recording) -> tuple[tuple[EpisodeEvent, ...], str]:
        """The events of a recording, and the reason if they could not be found."""
        try:
            return recording.events(), ""
        except MindstageError as error:
            return (), without_paths(str(error))
        except Exception as error:
            _log.exception("the events of %s could not be found", recording.name)
            return (), without_paths(f"{type(error).__name__}: {error}; this is a defect of Mindstage")

    def _publish_recording(self, found: Sequence[tuple[tuple[EpisodeEvent, ...], str]] | None) -> None:
        """Publishes the recordings; without events, they are still being looked for."""
        replay, recordings = self._replay, []
        for number, recording in enumerate(filter(None, (replay.recording, replay.beside))):
            events, error = (None, "") if found is None else found[number]
            times = {"begin_s": recording.begin_s, "end_s": recording.end_s, "start_unix_s": recording.start_unix_s}
            recordings.append({"name": recording.name, **times, "events": events, "error": error})
        self._channel.publish(_TOPIC, {"begin_s": replay.begin_s, "end_s": replay.end_s, "recordings": recordings})

    # -- requests ------------------------------------------------------------------------------------------------------

    def _seek(self, _: ClientSession, request: SeekRequest) -> float:
        time_s = min(max(request.time_s, self._replay.begin_s), self._replay.end_s)
        self._replay.seek(time_s)
        return time_s

    def _step_to_event(self, _: ClientSession, request: StepToEventRequest) -> str | None:
        """Returns the id of the event."""
        kinds = None if request.kinds is None else frozenset(request.kinds)
        event = self._replay.seek_event(back=request.back, kinds=kinds)
        return None if event is None else event.id

    def _resume(self, _: ClientSession, __: EmptyRequest) -> tuple[str, ...]:
        """Returns notes."""
        self._notes = self._replay.resume()
        return self._notes

    def _return(self, _: ClientSession, __: EmptyRequest) -> None:
        self._replay.return_to_recording()
        self._notes = ()


def _vector(row: Array) -> Vector:
    x, y, z = row.tolist()
    return x, y, z
