"""Try a plan in copies of the world, with uncertain poses, and read the verdict."""

import mindstage as ms

PLAN = """
steps:
  - {do: place, thing: milk_carton_1, on: table}
  - {do: push, thing: milk_carton_1, force: [0.0, 4.0, 0.0], duration_s: 0.3}
uncertainty:
  - {thing: milk_carton_1, position_m: 0.005, mass: 0.1}
"""

with ms.open("bundled:kitchen") as sim:
    sim.step(0.5)
    verdict = ms.evaluate_plan(sim, PLAN, samples=10, seed=1, fixed=True)
    print(verdict)
    if verdict.first_failure is not None:
        print("why:", verdict.first_failure.cause)
    for id, pose in verdict.results[0].end_poses.items():
        print("in the first sample,", id, "ends at", pose.position)
    print("the milk is still in the fridge:", sim.ask("where_is", "milk_carton_1", relation="inside")[0].other)
