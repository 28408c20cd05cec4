"""Place new objects on or in furniture, in free poses where they stay at rest."""

import mindstage as ms
from mindstage.errors import WorldError

with ms.open("bundled:kitchen") as sim:
    for cls in ("CoffeeMug", "DinnerPlate", "CoffeeMug"):
        placed = sim.place(cls, on="table")
        print(f"{placed.id} is on {placed.support_id} at {[round(part, 2) for part in placed.pose.position]}")
    milk = sim.place("CowsMilk", into="fridge")
    print(f"{milk.id} is in {milk.support_id}")
    try:
        sim.place("Refrigerator", on="table")
    except WorldError as error:  # there is no free pose; the world is unchanged
        print(error)
