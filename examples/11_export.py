"""Export a map as MJCF, as glTF, and as Turtle in the vocabulary of SOMA."""

import tempfile
from pathlib import Path

import mindstage as ms

world = ms.load("bundled:kitchen")
with tempfile.TemporaryDirectory() as folder:
    for name, dialect in (("kitchen.mjcf", None), ("kitchen.glb", None), ("kitchen.ttl", "soma")):
        out = Path(folder, name)
        notes = ms.save(world, out, dialect=dialect)
        print(f"{name}: {out.stat().st_size:,} bytes, {len(notes)} notes")
