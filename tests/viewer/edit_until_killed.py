"""A process that edits a world, with autosave, until it is killed; prints each edit after it was made.

Arguments: the wall time between two edits [s], and whether the world moves.
"""

from __future__ import annotations

import sys
import time

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.scene import BodyId
from mindstage.viewer import Viewer
from tests.kitchenette import kitchenette

with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
    simulation.spawn(kitchenette())
    with Viewer(simulation, port=0, autosave=True):
        if sys.argv[2] == "moving":
            simulation.play()
        for number in range(100_000):
            if number % 7 == 3:
                simulation.edits.delete([BodyId("Mug")])
                simulation.edits.undo()
            simulation.edits.set_label(BodyId("Fridge"), str(number))
            print(time.time(), number, flush=True)
            time.sleep(float(sys.argv[1]))
