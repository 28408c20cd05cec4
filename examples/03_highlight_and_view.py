"""Highlight answers and open the viewer. Run with --stay to keep the viewer open."""

import sys

import mindstage as ms

with ms.open("bundled:kitchen") as sim:
    for answer in sim.ask("storage_place", item="CowsMilk"):
        sim.highlight(answer.individual, color="green", label="milk is stored here")
    result = sim.highlight(sim.ask("handle_of", individual="oven"), "#f5c400")
    print("highlighted:", result.highlighted)
    viewer = ms.view(sim, port=0, block="--stay" in sys.argv)  # in a notebook: ms.view(sim)
    print(f"viewer at {viewer.url}")
