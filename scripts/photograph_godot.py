"""Photographs a map in Godot, with what a question finds lit: `scripts/photograph_godot.py MAP -o screenshot.png`.

It needs Godot and, without a screen, Xvfb: `xvfb-run -a python scripts/photograph_godot.py …`. The processor draws, so
no GPU is needed either.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from mindstage import KnowledgeBase, Simulation
from mindstage.cli.shot import pull_open
from mindstage.engines import GodotEngine
from mindstage.errors import MindstageError
from mindstage.scene import BodyId, Vector

OPTIONS = ("--rendering-method", "gl_compatibility", "--rendering-driver", "opengl3", "--audio-driver", "Dummy")
LIT = (1.0, 0.55, 0.0)


def main() -> int:
    """Takes one picture."""
    arguments = _arguments()
    try:
        knowledge = KnowledgeBase()
        knowledge.load([arguments.map], ontologies=arguments.ontology)
        godot = GodotEngine(
            os.environ.get("GODOT"), window=True, options=OPTIONS, timeout_s=120.0, start_timeout_s=120.0
        )
        with Simulation(knowledge, godot, timeout_s=120.0) as stage:
            report = stage.spawn()
            print(f"{report.bodies} bodies in Godot {godot.version}", file=sys.stderr)
            pull_open(stage, knowledge.world(), arguments.open)
            if arguments.light:
                stage.highlight(arguments.light, LIT)
            stage.run_on_engine(
                lambda engine: godot.screenshot(
                    arguments.output, eye=arguments.eye, target=arguments.target,
                    size=(arguments.width, arguments.height), fov_deg=arguments.fov,
                ),
                label="photograph", timeout_s=120.0,
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
    parser.add_argument("--light", type=BodyId, action="append", default=[], metavar="ID", help="a body that is lit")
    parser.add_argument("--open", type=BodyId, action="append", default=[], metavar="ID", help="what is pulled open")
    parser.add_argument("--eye", type=_place, default=(1.45, -0.95, 1.75), metavar="X,Y,Z", help="from where [m]")
    parser.add_argument("--target", type=_place, default=(-0.95, 1.2, 1.2), metavar="X,Y,Z", help="at what [m]")
    parser.add_argument("--fov", type=float, default=55.0, help="from the upper to the lower edge [degrees]")
    parser.add_argument("--width", type=int, default=1280)
    parser.add_argument("--height", type=int, default=720)
    return parser.parse_args()


def _place(text: str) -> Vector:
    x, y, z = map(float, text.split(","))
    return x, y, z


if __name__ == "__main__":
    sys.exit(main())
