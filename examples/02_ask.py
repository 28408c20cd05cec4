"""Ask declared questions: where milk is stored, what is on the table, and why."""

import mindstage as ms

with ms.open("bundled:kitchen", engine="null") as sim:
    for answer in sim.ask("storage_place_in_environment", item="CowsMilk"):
        print("milk is stored in", answer.individual)
        for line in sim.knowledge.explain("storage_place_in_environment", answer):
            print("   because", line)

    for answer in sim.ask("where_is", relation="on", other="table"):
        print(answer)
        assert answer.relation == "on"  # enumerations compare equal to their words

    nothing = sim.ask("storage_place", item="Radiator")
    print(nothing, "-", nothing.missing[0].reason)
