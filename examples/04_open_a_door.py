"""Open a door by pulling it with a force, and read the position of its hinge."""

import math

import mindstage as ms

with ms.open("bundled:kitchen") as sim:
    door = sim.joint("fridge_door")  # the body that moves, or the joint itself: "fridge_door_hinge"
    print(door)
    if door.open():
        print(f"open by {abs(math.degrees(door.position)):.0f} degrees, {door.openness:.0%} of its range")
    for answer in sim.ask("articulated_parts", thing="fridge"):
        print("the question `articulated_parts` returns:", answer.state)
    door.open(0.5)
    print(f"half open: {door.openness:.0%}")
    print("closed again:", bool(door.close()))
