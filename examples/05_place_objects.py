"""Place new objects on furniture, or in it, where there is room for them and they stay."""

import mindstage as ms
from mindstage.errors import WorldError

with ms.open("bundled:kitchen") as sim:
    for cls in ("CoffeeMug", "DinnerPlate", "CoffeeMug"):
        placed = sim.put(cls, on="table")
        print(f"{placed.id} stands on {placed.holder} at {[round(part, 2) for part in placed.pose.position]}")
    milk = sim.put("CowsMilk", into="fridge")
    print(f"{milk.id} stands in {milk.holder}")
    try:
        sim.put("Refrigerator", on="table")
    except WorldError as error:  # the world does not allow it, and is as before
        print(error)
