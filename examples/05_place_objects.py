"""Place new objects on furniture, or in it, where there is room for them and they stay."""

import mindstage as ms
from mindstage.errors import WorldError

with ms.open("bundled:kitchen") as sim:
    for cls in ("CoffeeMug", "DinnerPlate", "CoffeeMug"):
        placed = sim.place(cls, on="table")
        print(f"{placed.id} stands on {placed.support_id} at {[round(part, 2) for part in placed.pose.position]}")
    milk = sim.place("CowsMilk", into="fridge")
    print(f"{milk.id} stands in {milk.support_id}")
    try:
        sim.place("Refrigerator", on="table")
    except WorldError as error:  # the world does not allow it, and is as before
        print(error)
