"""The photographed maps, and pictures of them by each renderer."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

import mindstage as ms
from mindstage.rendering import Screenshot
from tests.kitchenette import kitchenette
from tests.rendering.similarity import REFERENCES

if TYPE_CHECKING:
    from mindstage.simulation import Simulation

__all__ = ["MAPS", "RENDERERS", "SIZE", "photographed", "reference_path"]

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


def _by_page(sim: Simulation) -> NDArray[np.uint8]:
    import io

    from PIL import Image

    with ms.view(sim, port=0) as viewer:
        data = viewer.screenshot(Screenshot(size=SIZE, timeout_s=300.0))
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


RENDERERS: dict[str, Callable[[Simulation], NDArray[np.uint8]]] = {"mujoco": _by_mujoco, "page": _by_page}


def reference_path(name: str, renderer: str) -> Path:
    """The committed picture of a map."""
    return REFERENCES / f"{name}-{renderer}.webp"
