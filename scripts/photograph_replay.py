"""Takes the picture of a replay for the documentation: milk is carried from the fridge to the table.

Usage: photograph_replay.py OUTPUT.png
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import mindstage as ms
from mindstage.episodes import EpisodeEventKind, FrameRecording, Recorder, detect_events
from mindstage.episodes.episode import Episode
from mindstage.episodes.replay import EpisodeReplay, knowledge_of
from mindstage.rendering.screenshot import Screenshot
from mindstage.scene import BodyId
from mindstage.viewer import Viewer

__all__ = ["main"]

MILK = BodyId("milk_carton_1")
PATH_M = ((-1.567, 1.5, 1.72), (-1.3, 0.75, 1.75), (-0.6, 0.0, 1.3), (-0.25, -0.35, 0.95), (-0.25, -0.35, 0.86))
"""Where the center of the milk is pulled to: out of the fridge, and onto the table."""
LEG_S = 1.2


def main() -> int:
    """Records, replays and photographs; returns 0."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "milk.mcap")
        record(path)
        with Episode(path) as episode:
            photograph(episode, Path(sys.argv[1]))
    return 0


def record(path: Path) -> None:
    """Records how the fridge is opened, and the milk is carried to the table."""
    with ms.open("bundled:kitchen") as sim:
        sim.step(0.5)
        with Recorder(sim, path):
            sim.step(0.5)
            sim.joint("fridge_door").open()
            start = sim.state.poses[sim.state.ids.index(MILK), :3]
            for goal in np.array(PATH_M):
                for share in np.linspace(0.0, 1.0, round(LEG_S * 30))[1:]:
                    x, y, z = (start + share * (goal - start)).tolist()
                    sim.pull(MILK, point=(0.0, 0.0, 0.08), target=(x, y, z + 0.08))
                    sim.step(1 / 30)
                start = goal
            sim.release()
            sim.step(0.5)
            sim.joint("fridge_door").close()
            sim.step(0.5)


def photograph(episode: Episode, picture: Path) -> None:
    """Shows the middle of the transport, with the path of the milk."""
    shown = FrameRecording(
        episode.frames(),
        name="milk.mcap",
        start_unix_s=episode.start_unix_s,
        geometry=episode.geometry,
        spawned=episode.spawned,
        events=detect_events(episode),
    )
    transport = next(each for each in shown.events() if each.kind is EpisodeEventKind.TRANSPORT)
    middle_s = transport.begin_s + 0.45 * ((transport.end_s or shown.end_s) - transport.begin_s)
    with EpisodeReplay(shown, knowledge_of(episode), at_s=middle_s) as replay, Viewer(replay, port=0) as viewer:
        viewer.show_path(MILK)
        picture.write_bytes(viewer.screenshot(Screenshot(with_panels=True, selected=MILK)))


if __name__ == "__main__":
    sys.exit(main())
