"""Open a semantic map as a running simulation and step it."""

import mindstage as ms

with ms.open("bundled:kitchen") as sim:  # or the path of an .owl, .ttl or .urdf file; engine="godot" for Godot
    print(sim)
    print(sim.reports[0])  # what could not be spawned, and what was assumed
    sim.step(1.0)  # simulated time [s]
    print(f"{sim.state.time_s:.1f} s have passed")
    mug = sim.snapshot().body("coffee_mug_1")
    print(mug.id, "is at", [round(part, 3) for part in mug.pose.position])
