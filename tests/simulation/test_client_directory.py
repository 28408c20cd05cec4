"""The directory of clients, and its callbacks for edits."""

from __future__ import annotations

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.scene import BodyId, Pose
from tests.kitchenette import kitchenette


def test_edit_callbacks_run_after_an_edit_is_published_and_not_after_motion() -> None:
    with Simulation(KnowledgeBase(), NullEngine(), shapes=False) as sim:
        revisions: list[int] = []
        remove = sim.clients.on_edit(lambda: revisions.append(sim.state.revision))
        sim.spawn(kitchenette())
        sim.undo_stack.move(BodyId("Mug"), Pose((1.0, 0.0, 1.0)))
        sim.step(0.1)
        sim.snapshot()
        assert revisions == [1, 2]
        remove()
        sim.clear()
        assert revisions == [1, 2]
