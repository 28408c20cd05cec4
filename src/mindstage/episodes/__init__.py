"""Episodes: a running world is recorded in a file, replayed, and asked about any moment.

`Episode`, `Recorder` and `EpisodeReplay` are imported when they are first used: the extra `episodes` may be missing,
and the last one imports the simulation.
"""

from typing import TYPE_CHECKING

from mindstage.episodes.detection import EventDetector, detect_events
from mindstage.episodes.recording import (
    EpisodeEdit,
    EpisodeEvent,
    EpisodeEventKind,
    EpisodeFrame,
    EventState,
    FrameRecording,
    Recording,
)
from mindstage.episodes.tracking import DetectionThresholds
from mindstage.knowledge.over_time import EpisodeAdapter, register_episode_adapter
from mindstage.lazy_names import lazy_names

if TYPE_CHECKING:
    from mindstage.episodes.bags import RosBag
    from mindstage.episodes.episode import Episode
    from mindstage.episodes.mcap_file import EpisodeLoss
    from mindstage.episodes.memory import EpisodeMemory
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
    "EpisodeMemory",
    "EpisodeReplay",
    "EventDetector",
    "EventState",
    "FrameRecording",
    "Recorder",
    "Recording",
    "RecordingFolder",
    "RosBag",
    "detect_events",
]

_MODULES = {
    "Episode": "mindstage.episodes.episode",
    "EpisodeLoss": "mindstage.episodes.mcap_file",
    "EpisodeMemory": "mindstage.episodes.memory",
    "EpisodeReplay": "mindstage.episodes.replay",
    "Recorder": "mindstage.episodes.recorder",
    "RecordingFolder": "mindstage.episodes.recorder",
    "RosBag": "mindstage.episodes.bags",
}


__getattr__, __dir__ = lazy_names(__name__, _MODULES)


def _adapter() -> EpisodeAdapter:
    from mindstage.episodes import history

    return history


register_episode_adapter(_adapter)
