"""The photographed maps, and pictures of them by each renderer."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

import mindstage as ms
from mindstage.rendering import Screenshot
from mindstage.rendering.path_tracing import PathTracingSettings, path_trace
from mindstage.rendering.render_scene import RenderScene
from mindstage.simulation.pictures import ScenePhotographer
from tests.kitchenette import kitchenette
from tests.rendering.similarity import REFERENCES
from tests.viewer.view_pictures import launch_browser, view_picture

if TYPE_CHECKING:
    from mindstage.simulation import Simulation

__all__ = ["MAPS", "RENDERERS", "SIZE", "by_page", "path_traced", "photographed", "reference_path"]

SIZE = (480, 300)
MAPS = {
    "kitchen": "bundled:kitchen",
    "kitchenette": "",
    "corridor-kitchen": "maps/knowrob1-ccrl.owl",
    "lab-kitchen": "maps/soma-iai-room.owl",
}
"""Maps by name: bundled, made by the tests, or paths of samples."""


@contextmanager
def photographed(name: str, samples: Path | None) -> Iterator[Simulation]:
    """A simulation of one of the maps, without physics.

    Args:
        name: a key of `MAPS`.
        samples: the folder of sample maps.
    """
    source = MAPS[name]
    if not source:
        with ms.open((), engine="null") as sim:
            sim.spawn(kitchenette())
            yield sim
        return
    if not source.startswith("bundled:"):
        assert samples is not None
        source = str(samples / source)
    with ms.open(source, engine="null") as sim:
        yield sim


def _by_mujoco(sim: Simulation) -> NDArray[np.uint8]:
    return ms.shot(sim, screenshot=Screenshot(size=SIZE))


def by_page(sim: Simulation, browser: Any) -> NDArray[np.uint8]:
    """A picture of the 3D view of the page."""
    with ms.view(sim, port=0) as viewer:
        data = view_picture(browser, viewer, SIZE)
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


def _by_new_browser(sim: Simulation) -> NDArray[np.uint8]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = launch_browser(playwright)
        picture = by_page(sim, browser)
        browser.close()
    return picture


def _by_path_tracing(sim: Simulation) -> NDArray[np.uint8]:
    return path_traced(ScenePhotographer.of(sim).scene(aspect=SIZE[0] / SIZE[1]))


def path_traced(scene: RenderScene, **changes: float) -> NDArray[np.uint8]:
    """A path-traced picture, small enough for a test: a few seconds of processor time."""
    settings = PathTracingSettings(size=(SIZE[0] // 2, SIZE[1] // 2), samples=16, seed=1)
    return path_trace(scene, msgspec.structs.replace(settings, **changes)).pixels


RENDERERS: dict[str, Callable[[Simulation], NDArray[np.uint8]]] = {
    "mujoco": _by_mujoco,
    "page": _by_new_browser,
    "path": _by_path_tracing,
}


def reference_path(name: str, renderer: str) -> Path:
    """The committed picture of a map."""
    return REFERENCES / f"{name}-{renderer}.webp"
