"""Generates the bundled kitchen: `python scripts/make_kitchen.py`; --check only reports whether the file is current.

The kitchen is defined in `scripts/kitchen/`. Generation is deterministic.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from kitchen.dialect import map_text
from kitchen.goods import furnish
from kitchen.model import Scene
from kitchen.room import build_room

__all__ = ["main"]

KITCHEN = Path(__file__).parents[1] / "src/mindstage/maps/bundled/kitchen.owl"


def main() -> int:
    """Writes or checks the file; returns 0, or 1 if a checked file is stale."""
    parser = argparse.ArgumentParser(description="Generates the bundled kitchen.")
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 if the file is not current")
    check = parser.parse_args().check
    scene = Scene()
    build_room(scene)
    furnish(scene)
    text = map_text(scene)
    if check:
        current = KITCHEN.exists() and KITCHEN.read_text(encoding="utf-8") == text
        print(f"{KITCHEN} is {'current' if current else 'stale; run python scripts/make_kitchen.py'}")
        return 0 if current else 1
    KITCHEN.write_text(text, encoding="utf-8", newline="\n")
    print(f"{KITCHEN}: {len(scene.bodies)} bodies, {len(scene.joints)} joints")
    return 0


if __name__ == "__main__":
    sys.exit(main())
