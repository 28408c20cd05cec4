"""Writes the bundled kitchen: `python scripts/make_kitchen.py`; with --check it only says whether the file is current.

The kitchen is described in `scripts/kitchen/`. The same description gives the same file, to the letter.
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

KITCHEN = Path(__file__).parents[1] / "src/mindstage/knowledge/bundled/kitchen.owl"


def main() -> int:
    """Writes or checks the file; 0 when all is well, 1 when it is stale."""
    parser = argparse.ArgumentParser(description="Writes the bundled kitchen.")
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
    print(f"{KITCHEN}: {len(scene.things)} things, {len(scene.joints)} joints")
    return 0


if __name__ == "__main__":
    sys.exit(main())
