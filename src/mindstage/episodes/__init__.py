"""Episodes: a running world is recorded in a file, replayed, and asked about any moment.

`Episode`, `Recorder` and `EpisodeReplay` are imported when they are first used: the extra `episodes` may be missing,
and the last one imports the simulation.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from mindstage.episodes.detection import EventDetector, detect_events
from mindstage.episodes.recording import (
    EpisodeEdit,
    EpisodeEvent,
    EpisodeEventKind,
    EpisodeFrame,
    FrameRecording,
    Recording,
)
from mindstage.episodes.tracking import DetectionThresholds
from mindstage.knowledge.over_time import EpisodeAdapter, register_episode_adapter

if TYPE_CHECKING:
    from mindstage.episodes.episode import Episode
    from mindstage.episodes.mcap_file import EpisodeLoss
    from mindstage.episodes.recorder import Recorder, RecordingFolder
    from mindstage.episodes.replay import EpisodeReplay

__all__ = [
    "DetectionThresholds",
    "Episode",
    "EpisodeEdit",
    "EpisodeEvent",
    "EpisodeEventKind",
    "EpisodeFrame",
    "EpisodeLoss",
    "EpisodeReplay",
    "EventDetector",
    "FrameRecording",
    "Recorder",
    "Recording",
    "RecordingFolder",
    "detect_events",
]

_MODULES = {
    "Episode": "mindstage.episodes.episode",
    "EpisodeLoss": "mindstage.episodes.mcap_file",
    "EpisodeReplay": "mindstage.episodes.replay",
    "Recorder": "mindstage.episodes.recorder",
    "RecordingFolder": "mindstage.episodes.recorder",
}


def __getattr__(name: str) -> object:
    if name in _MODULES:
        return getattr(import_module(_MODULES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _adapter() -> EpisodeAdapter:
    from mindstage.episodes import history

    return history


register_episode_adapter(_adapter)
