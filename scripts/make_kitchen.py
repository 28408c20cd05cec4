"""Generates the bundled kitchen: `python scripts/make_kitchen.py`; --check only reports whether the file is current.

The kitchen is defined in `scripts/kitchen/`. Generation is deterministic.
"""

from __future__ import annotations

import sys
from pathlib import Path

from generated import write_or_compare
from kitchen.dialect import map_text
from kitchen.goods import furnish
from kitchen.model import Scene
from kitchen.room import build_room

__all__ = ["main"]

KITCHEN = Path(__file__).resolve().parents[1] / "src/mindstage/maps/bundled/kitchen.owl"


def main() -> int:
    """Writes or checks the file; returns 0, or 1 if a checked file is stale."""
    scene = Scene()
    build_room(scene)
    furnish(scene)
    return write_or_compare({KITCHEN: map_text(scene)})


if __name__ == "__main__":
    sys.exit(main())
