"""The models of robots in installed packages, read once for all tests of this folder."""

from __future__ import annotations

from functools import cache
from importlib.metadata import distribution
from pathlib import Path

from mindstage.robots.models.reading import load_model
from mindstage.robots.models.robot_model import RobotModel

EXAMPLES = Path(str(distribution("example-robot-data").locate_file("cmeel.prefix/share/example-robot-data/robots")))
EXAMPLE_URDFS = sorted(EXAMPLES.rglob("*.urdf"))


@cache
def known_model(name: str) -> RobotModel:
    """A model of the catalog; meshes come from the user's cache after the first time."""
    return load_model(name)
