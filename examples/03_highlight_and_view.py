"""Highlight answers and serve the page on which they are seen. Run with --stay to keep the page open."""

import sys

import mindstage as ms

with ms.open("bundled:kitchen") as sim:
    for answer in sim.ask("storage_place", item="CowsMilk"):
        sim.highlight(answer.individual, color="green", label="milk is kept here")
    result = sim.highlight(sim.ask("handle_of", individual="oven"), "#f5c400")
    print("highlighted:", result.highlighted)
    page = ms.view(sim, port=0, block="--stay" in sys.argv)  # in a notebook: ms.view(sim)
    print(f"the page was at {page.url}" if sim.closed else f"the page is at {page.url}")
