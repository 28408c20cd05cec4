"""Takes the pictures of the viewer for the documentation; needs Chromium, and some minutes without a GPU.

Pictures of the 3D view are those of `mindstage shot`, which needs no browser.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from tests.viewer.view_pictures import launch_browser, page_picture  # noqa: E402
from tests.viewer.waiting import wait_until  # noqa: E402

import mindstage as ms  # noqa: E402
from mindstage.cli.shot import pull_open  # noqa: E402
from mindstage.episodes import EpisodeEventKind, FrameRecording, Recorder, detect_events  # noqa: E402
from mindstage.episodes.episode import Episode  # noqa: E402
from mindstage.episodes.replay import EpisodeReplay, knowledge_of  # noqa: E402
from mindstage.scene import BodyId  # noqa: E402
from mindstage.viewer import Viewer  # noqa: E402

__all__ = ["main"]

PICTURES = ROOT / "docs" / "images"
SIZE = (1280, 800)
"""Size of pictures of the page [px]."""
SHOTS = {
    "kitchen-answer.png": ("--size", "1000x640", "--highlight", "storage_place_in_environment item=CowsMilk"),
    "kitchen-plan.png": ("--size", "1000x640", "--top", "--section", "1.3"),
    "plan.png": (
        *("--size", "840x520", "--for", "2", "--plan"),
        """{"steps": [{"do": "move", "thing": "milk_carton_1", "to": {"position": [-0.1, -0.155, 0.85]}},
                      {"do": "wait", "duration_s": 1}],
            "uncertainty": [{"thing": "milk_carton_1", "position_m": 0.01}]}""",
    ),
}
"""Options of `mindstage shot` by file."""
MILK = BodyId("milk_carton_1")
PATH_M = ((-1.567, 1.5, 1.72), (-1.3, 0.75, 1.75), (-0.6, 0.0, 1.3), (-0.25, -0.35, 0.95), (-0.25, -0.35, 0.86))
"""Where the center of the milk is pulled to: out of the fridge, and onto the table."""
LEG_S = 1.2
"""Time from one point of the path to the next [s]."""


def main() -> int:
    """Writes all pictures; returns 0."""
    for name, options in SHOTS.items():
        command = [sys.executable, "-m", "mindstage", "shot", "bundled:kitchen", "-o", str(PICTURES / name), *options]
        subprocess.run(command, check=True)
    with sync_playwright() as playwright, TemporaryDirectory() as folder:
        browser = launch_browser(playwright)
        photograph_kitchen(browser, PICTURES / "kitchen.png")
        path = Path(folder, "milk.mcap")
        record(path)
        with Episode(path) as episode:
            photograph_replay(browser, episode, PICTURES / "replay.png")
        browser.close()
    return 0


def photograph_kitchen(browser: Any, picture: Path) -> None:
    """Shows the kitchen with an open and selected fridge, and its details."""
    with ms.open("bundled:kitchen") as sim, Viewer(sim, port=0) as viewer:
        pull_open(sim, sim.snapshot(), ["fridge_door"])
        wait_until(lambda: viewer.views.is_drawn, "the scene is drawn")
        viewer.select(BodyId("fridge"))
        picture.write_bytes(page_picture(browser, viewer, SIZE, panel="details"))


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


def photograph_replay(browser: Any, episode: Episode, picture: Path) -> None:
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
        wait_until(lambda: viewer.views.is_drawn, "the scene is drawn")
        viewer.show_path(MILK)
        viewer.select(MILK)
        picture.write_bytes(page_picture(browser, viewer, SIZE))


if __name__ == "__main__":
    sys.exit(main())
