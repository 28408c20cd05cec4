"""Writes the reference pictures of tests/rendering/photographs; with --check only compares.

Usage: make_photographs.py [--check] [RENDERER...]

The renderers are those of tests/rendering/photographs.py. Maps that are missing here are left out, with a line.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from tests.rendering.photographs import MAPS, RENDERERS, photographed, reference_path  # noqa: E402
from tests.rendering.similarity import picture_similarity, read_picture  # noqa: E402

from mindstage.pictures import encode_picture  # noqa: E402

LEAST_SIMILARITY = 0.9


def main(arguments: list[str]) -> int:
    """Runs the script; returns 1 if a picture differs from its reference."""
    check = "--check" in arguments
    renderers = [each for each in arguments if not each.startswith("--")] or list(RENDERERS)
    samples = Path(os.environ.get("MINDSTAGE_DATA") or ROOT.parent / "shared" / "data")
    failed = False
    for name, source in MAPS.items():
        if source.startswith("maps/") and not (samples / source).is_file():
            print(f"{name}: {samples / source} is missing", file=sys.stderr)
            continue
        for renderer in renderers:
            with photographed(name, samples) as sim:
                picture = RENDERERS[renderer](sim)
            path = reference_path(name, renderer)
            if check:
                similarity = picture_similarity(picture, read_picture(path))
                failed |= similarity < LEAST_SIMILARITY
                print(f"{path.name}: similarity {similarity:.3f}")
            else:
                path.parent.mkdir(exist_ok=True)
                path.write_bytes(encode_picture(picture, "WEBP"))
                print(f"{path.name}: {path.stat().st_size} bytes")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
