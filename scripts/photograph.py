"""Photographs the page of a map, as a visitor sees it: `scripts/photograph.py MAP -o picture.png`.

It needs Chromium or Chrome and the package playwright (`pip install mindstage[dev]`), but neither a screen nor a GPU.
The world stands still while the picture is taken, so that the same map gives the same picture.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

from mindstage import KnowledgeBase, MujocoEngine, Stage
from mindstage.errors import MindstageError
from mindstage.viewport import Viewport
from mindstage.world import BodyId, Vector, World

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
BROWSER_ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
STILL_S = 2.0
"""A picture that has not changed for so long is finished."""
REACH_M = 0.6
"""How far a hand pulls what is to be opened."""


def main() -> int:
    """Takes one picture."""
    arguments = _arguments()
    browser = arguments.browser or next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        print(f"no browser: install one of {', '.join(BROWSERS)}, or name it with --browser", file=sys.stderr)
        return 2
    try:
        knowledge = KnowledgeBase()
        knowledge.load([arguments.map], ontologies=arguments.ontology)
        with Stage(knowledge, MujocoEngine()) as stage:
            world = knowledge.world()
            stage.spawn(world)
            open_up(stage, world, arguments.open)
            with Viewport(stage, port=0) as viewport:
                viewport.select(arguments.select)
                picture = photograph(viewport.url, browser=browser, size=(arguments.width, arguments.height))
    except MindstageError as error:
        print(error, file=sys.stderr)
        return 2
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_bytes(picture)
    return 0


def open_up(stage: Stage, world: World, ids: Iterable[BodyId]) -> None:
    """Pulls doors and drawers open, one after the other, as a hand would."""
    frames = {joint.child: joint.parent for joint in world.constraints}
    frames |= {joint.parent: joint.child for joint in world.constraints if joint.parent in ids}
    for id in ids:
        front, frame = world.body(id).pose.position, world.body(frames.get(id, id)).pose.position
        grip = next((hold.child for hold in world.attachments if hold.parent == id), id)
        target = np.add(world.body(grip).pose.position, _outwards(front, frame))
        x, y, z = target.tolist()
        stage.grip(grip, point=(0.0, 0.0, 0.0), target=(x, y, z))
        stage.step(3.0)
        stage.release(grip)
    stage.step(0.5)


def photograph(url: str, *, browser: str, size: tuple[int, int]) -> bytes:
    """The page as PNG, once nothing on it changes any more."""
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser, args=BROWSER_ARGUMENTS)
        page = chromium.new_page(viewport={"width": size[0], "height": size[1]})
        page.goto(f"{url}/?fixedDpr=2")  # drawn twice as large and shrunk: smooth edges
        page.wait_for_selector("canvas")
        # A browser without a GPU is warned about being slow; that is no part of the picture.
        page.add_style_tag(content=".mantine-Notifications-root { display: none }")
        return _when_still(page)


def _when_still(page: Page) -> bytes:
    picture, since = b"", time.monotonic()
    while time.monotonic() - since < STILL_S:
        time.sleep(0.5)
        newer = page.screenshot(timeout=120_000)
        if newer != picture:
            picture, since = newer, time.monotonic()
    return picture


def _outwards(front: Vector, frame: Vector) -> np.ndarray:
    """From the middle of a piece of furniture to its front, level, as far as a hand reaches."""
    away = np.subtract(front, frame)
    away[np.argmin(np.abs(away[:2]))] = 0.0
    away[2] = 0.0
    return REACH_M * away / max(float(np.linalg.norm(away)), 1e-9)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("map", help="a semantic map, such as src/mindstage/knowledge/bundled/kitchen.owl")
    parser.add_argument("-o", "--output", type=Path, required=True, help="the PNG to write")
    parser.add_argument("--ontology", action="append", default=[], help="may be repeated")
    parser.add_argument("--open", action="append", default=[], metavar="ID", help="pull a door or drawer open first")
    parser.add_argument("--select", metavar="ID", help="the body to name in the panel")
    parser.add_argument("--width", type=int, default=1280)
    parser.add_argument("--height", type=int, default=800)
    parser.add_argument("--browser", help="the executable, if it is not found by itself")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
