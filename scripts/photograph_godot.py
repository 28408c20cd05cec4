"""Takes a screenshot of a map in Godot, with highlighted bodies: `scripts/photograph_godot.py MAP -o picture.png`.

Requires Godot and, without a screen, Xvfb: `xvfb-run -a python scripts/photograph_godot.py …`. Rendering is done on the
CPU, so no GPU is needed.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from mindstage import KnowledgeBase, Simulation
from mindstage.cli.shot import pull_open
from mindstage.engines.remote.godot import GodotEngine
from mindstage.errors import MindstageError
from mindstage.scene import BodyId, Vector

OPTIONS = ("--rendering-method", "gl_compatibility", "--rendering-driver", "opengl3", "--audio-driver", "Dummy")
HIGHLIGHT_COLOR = (1.0, 0.55, 0.0)


def main() -> int:
    """Writes one picture; returns 2 if that fails."""
    arguments = _arguments()
    try:
        knowledge = KnowledgeBase()
        knowledge.load([arguments.map], ontologies=arguments.ontology)
        godot = GodotEngine(
            os.environ.get("GODOT"), window=True, options=OPTIONS, timeout_s=120.0, start_timeout_s=120.0
        )
        with Simulation(knowledge, godot, timeout_s=120.0) as sim:
            report = sim.spawn()
            print(f"{report.bodies} bodies in Godot {godot.version}", file=sys.stderr)
            pull_open(sim, knowledge.world(), arguments.open)
            if arguments.highlight:
                sim.highlight(arguments.highlight, HIGHLIGHT_COLOR)
            sim.engine.run(
                lambda engine: godot.screenshot(
                    arguments.output, eye=arguments.eye, target=arguments.target,
                    size=(arguments.width, arguments.height), fov_deg=arguments.fov,
                ),
                label="screenshot", timeout_s=120.0,
            )  # fmt: skip
    except MindstageError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("map", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--ontology", action="append", default=[], help="a file, a folder, or package://…")
    parser.add_argument(
        "--highlight", type=BodyId, action="append", default=[], metavar="ID", help="a body to highlight"
    )
    parser.add_argument(
        "--open", type=BodyId, action="append", default=[], metavar="ID", help="a door or drawer to open"
    )
    parser.add_argument(
        "--eye", type=_vector, default=(1.45, -0.95, 1.75), metavar="X,Y,Z", help="position of the camera [m]"
    )
    parser.add_argument(
        "--target",
        type=_vector,
        default=(-0.95, 1.2, 1.2),
        metavar="X,Y,Z",
        help="point at the center of the picture [m]",
    )
    parser.add_argument("--fov", type=float, default=55.0, help="vertical field of view [degrees]")
    parser.add_argument("--width", type=int, default=1280)
    parser.add_argument("--height", type=int, default=720)
    return parser.parse_args()


def _vector(text: str) -> Vector:
    x, y, z = map(float, text.split(","))
    return x, y, z


if __name__ == "__main__":
    sys.exit(main())
