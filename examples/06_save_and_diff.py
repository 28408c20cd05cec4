"""Save a simulation as a map, and compare every field and statement of the two maps."""

import tempfile
from pathlib import Path

import mindstage as ms

with tempfile.TemporaryDirectory() as folder:
    now = Path(folder, "now.owl")
    with ms.open("bundled:kitchen") as sim:
        sim.save(now)
        print("nothing moved:", ms.diff("bundled:kitchen", now))
        sim.joint("drawer_left_1").open()
        sim.save(now)
    difference = ms.diff("bundled:kitchen", now)  # paths, worlds and simulations, in any combination
    print(difference)
    moved = {change.id for change in difference.changed if change.kind == "translation_m" and (change.error or 0) > 0.1}
    print("moved by more than 10 cm:", *sorted(moved))
