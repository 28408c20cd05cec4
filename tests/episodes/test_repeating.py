"""The edits of a recording, made again in another simulation."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from mindstage.engines.mujoco import MujocoEngine
from mindstage.episodes import Episode, Recorder
from mindstage.episodes.recording import EpisodeEdit
from mindstage.episodes.repeating import repeat_edits
from mindstage.knowledge import KnowledgeBase
from mindstage.robots import add_robot, find_robot
from mindstage.scene import BodyId, Pose, diff
from mindstage.scene.edits import SetPoses, edit_to_json
from mindstage.simulation import Simulation
from tests.kitchenette import kitchenette

MUG, DRAWER, FRIDGE = BodyId("Mug"), BodyId("Drawer"), BodyId("Fridge")


def made() -> Simulation:
    sim = Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True, timeout_s=60.0)
    sim.spawn(kitchenette())
    return sim


def test_a_recording_can_be_executed_again_with_a_robot(tmp_path: Path) -> None:
    with made() as sim:
        with Recorder(sim, tmp_path / "run.mcap"):
            sim.edits.move(MUG, Pose((0.5, -2.0, 0.05)))
            sim.step(0.2)
            sim.edits.delete([FRIDGE], parts=True)
            sim.edits.undo()
            cup = replace(kitchenette().body("Mug"), id=BodyId("Cup"), pose=Pose((1.0, -2.0, 0.05)))
            sim.spawn(replace(kitchenette(), bodies=(cup,), joints=(), attachments=()), persistent=False)
            add_robot(sim, "mobile_manipulator", Pose((0.3, -1.5, 0.0)))
            sim.edits.attach(DRAWER, MUG)
            sim.edits.set_label(MUG, "cup of Ann")
            sim.step(0.1)
        after, actuators = sim.snapshot(), sim.engine.run(lambda engine: engine.actuator_states())
    with made() as again, Episode(tmp_path / "run.mcap") as episode:
        done = repeat_edits(episode, again)
        again.step(0.1)
        assert done[0] == "pose of Mug"
        assert done[-1] == "label of Mug"
        assert "robot mobile_manipulator added" in done
        assert diff(after, again.snapshot()).identical(1e-6)
        assert find_robot(again).exists
        assert again.engine.run(lambda engine: engine.actuator_states()).keys() == actuators.keys()


def test_a_robot_of_a_copy_is_committed_as_a_robot() -> None:
    with made() as sim:
        with sim.fork() as copy:
            robot = add_robot(copy, "mobile_manipulator", Pose((0.3, -1.5, 0.0)))
            pairs = copy.engine.run(lambda engine: set(engine._cache.builder.given_excluded_pairs))  # type: ignore[attr-defined]
            copy.commit()
        committed = find_robot(sim)
        assert committed.body_ids == robot.body_ids
        assert pairs
        assert sim.engine.run(lambda engine: set(engine._cache.builder.given_excluded_pairs)) == pairs  # type: ignore[attr-defined]
        height = committed.link_pose("head_pan_link")[2]
        sim.step(0.5)
        assert committed.link_pose("head_pan_link")[2] == pytest.approx(height, abs=0.01), "its drives hold it"
        sim.reset()
        assert committed.exists


def test_an_edit_is_the_same_as_a_value_and_as_json() -> None:
    move = SetPoses({BodyId("Mug"): Pose((1.0, 2.0, 3.0))})
    as_json = msgspec.json.decode(edit_to_json(move))
    for details in ({"edit": move}, {"edit": as_json}, {"edits": [as_json]}):
        assert EpisodeEdit(time_s=1.0, kind="set poses", details=details).edits(()) == (move,)
    assert EpisodeEdit(time_s=1.0, kind="question", details={"text": "where is it?"}).edits(()) == ()
