"""An episode as one HTML file that plays by itself: viser's own page with the recorded messages of the scene in it.

The file needs no server and no network. It is drawn as in the viewer; poses are sent as often as asked for, and only
those that change.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from urllib.parse import quote

import msgspec
import viser

from mindstage.access.limits import PUBLISH_RATE, SPEED
from mindstage.episodes.recording import EpisodeEventKind, EpisodeFrame, Recording
from mindstage.errors import EpisodeFileError, InvalidArgumentError, without_surrogates
from mindstage.files import atomic_write
from mindstage.knowledge.knowledge_base import KnowledgeBase
from mindstage.rendering.appearance import BodyAppearance, compute_appearance
from mindstage.rendering.camera import CameraPose, ground_height, initial_target
from mindstage.scene import BodyId
from mindstage.viewer.scene import Clickable, Pick, ViewerScene
from mindstage.viewer.server import RpcChannel, serve, shut_down

__all__ = ["HtmlReport", "write_html"]


class HtmlReport(msgspec.Struct, frozen=True, kw_only=True):
    """What a page contains."""

    frames: int
    """Number of times at which poses were written."""
    duration_s: float
    """How long it plays [s]."""
    size_bytes: int
    """Size of the file."""


def write_html(
    recording: Recording,
    path: str | PathLike[str],
    *,
    knowledge: KnowledgeBase | None = None,
    rate_hz: float = 30.0,
    speed: float = 1.0,
    camera: CameraPose | None = None,
) -> HtmlReport:
    """Writes an episode as a page that plays it in a loop, with a timeline to drag.

    Args:
        recording: the episode.
        path: the file, such as `run.html`.
        knowledge: gives the shapes and colors of classes; by default the bundled ontology does.
        rate_hz: the most poses of a body per second of the episode; fewer make the file smaller.
        speed: how many seconds of the episode are played per second.
        camera: the camera at the begin; by default it shows what can move, as in the viewer.

    Raises:
        EpisodeFileError: the file cannot be written.
        ViewerUnavailableError: viser cannot listen on the loopback address, which it does while it draws the scene.
    """
    # Nobody connects: the server exists because viser's scenes belong to one. A token that is never shown keeps others
    # from seeing the scene meanwhile.
    server = serve(
        "127.0.0.1", 0, title=without_surrogates(recording.name), channel=RpcChannel(), token=secrets.token_urlsafe(32)
    )
    try:
        page, frames, duration_s = _record(server, recording, knowledge or KnowledgeBase(), rate_hz, speed, camera)
    finally:
        shut_down(server)
    content = page.encode()
    try:
        atomic_write(Path(path), content)
    except OSError as error:
        raise EpisodeFileError(str(path), cause=error.strerror or str(error)) from error
    return HtmlReport(frames=frames, duration_s=duration_s, size_bytes=len(content))


def _record(
    server: viser.ViserServer,
    recording: Recording,
    knowledge: KnowledgeBase,
    rate_hz: float,
    speed: float,
    camera: CameraPose | None,
) -> tuple[str, int, float]:
    """The page, the number of its frames, and its duration [s]."""
    PUBLISH_RATE.check(rate_hz)
    if SPEED.check(speed) == 0.0 or rate_hz == 0.0:
        raise InvalidArgumentError("speed" if rate_hz else "rate", cause="it must be above 0")
    frames = _thinned(recording, rate_hz)
    first = next(frames)
    scene = ViewerScene(server, on_node=_not_clickable, has_scripts=False)
    appearances = _show(scene, first, recording, knowledge)
    world = first.world()
    scene.set_ground(ground_height(world, appearances))
    if camera is not None or appearances:
        scene.set_initial_camera(camera or initial_target(world, appearances).camera())
    labels = _EventLabels(server.scene, recording)
    labels.show(first)
    serializer = server.get_scene_serializer()
    before, count = first, 1
    for frame in frames:
        serializer.insert_sleep((frame.time_s - before.time_s) / speed)
        if frame.ids != before.ids:
            _show(scene, frame, recording, knowledge)
        else:
            scene.move(frame.poses)
        labels.show(frame)
        before, count = frame, count + 1
    return serializer.as_html(), count, (before.time_s - first.time_s) / speed


_RELATIONS = frozenset({EpisodeEventKind.CONTACT, EpisodeEventKind.SUPPORT, EpisodeEventKind.CONTAINMENT})
"""Kinds that last for most of an episode, and would cover the scene with labels."""


class _EventLabels:
    """The names of the events that go on, above their bodies."""

    def __init__(self, scene: viser.SceneApi, recording: Recording) -> None:
        self._scene = scene
        self._events = [event for event in recording.events() if event.kind not in _RELATIONS]
        self._shown: dict[BodyId, viser.LabelHandle] = {}

    def show(self, frame: EpisodeFrame) -> None:
        """Shows the labels of one time, one for each body."""
        rows = {id: row for row, id in enumerate(frame.ids)}
        running: dict[BodyId, list[str]] = {}
        for event in self._events:
            has_ended = event.end_s is not None and event.end_s <= frame.time_s
            if event.begin_s <= frame.time_s and not has_ended and event.thing in rows:
                running.setdefault(event.thing, []).append(event.kind.value)
        for id in self._shown.keys() - running.keys():
            self._shown.pop(id).remove()
        for id, kinds in running.items():
            text = ", ".join(dict.fromkeys(kinds))
            if id not in self._shown:
                self._shown[id] = self._scene.add_label(f"/events/{quote(id, safe='')}", text)
            x, y, z = frame.poses[rows[id]][:3].tolist()
            self._shown[id].text, self._shown[id].position = text, (x, y, z)


def _show(
    scene: ViewerScene, frame: EpisodeFrame, recording: Recording, knowledge: KnowledgeBase
) -> dict[BodyId, BodyAppearance]:
    appearances = compute_appearance(
        frame.world(), knowledge.shape_rule, knowledge.ancestors, geometry=recording.geometry
    )
    scene.show(appearances, frame.ids, frame.poses, draggable=())
    return appearances


def _not_clickable(node: Clickable, pick: Pick, *, draggable: bool) -> None:
    """The page has no server that a click could be sent to."""


def _thinned(recording: Recording, rate_hz: float) -> Iterator[EpisodeFrame]:
    """The first and the last frame, and those between at most at a rate."""
    period, kept, waiting = 0.999 / rate_hz, -float("inf"), None
    for frame in recording.frames():
        waiting = frame
        if frame.time_s - kept >= period:
            yield frame
            kept, waiting = frame.time_s, None
    if waiting is not None:
        yield waiting
