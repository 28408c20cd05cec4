"""Who takes part in a stage's life from elsewhere."""

from __future__ import annotations

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.scene import BodyId, Pose
from tests.kitchenette import kitchenette


def test_who_watches_is_told_of_edits_when_the_frame_tells_of_them_and_of_nothing_else() -> None:
    with Simulation(KnowledgeBase(), NullEngine(), shapes=False) as stage:
        editions: list[int] = []
        farewell = stage.clients.on_edit(lambda: editions.append(stage.state.revision))
        stage.spawn(kitchenette())
        stage.undo_stack.move(BodyId("Mug"), Pose((1.0, 0.0, 1.0)))
        stage.step(0.1)
        stage.snapshot()
        assert editions == [1, 2]
        farewell()
        stage.clear()
        assert editions == [1, 2]
