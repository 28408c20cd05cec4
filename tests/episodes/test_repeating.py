"""The edits of a recording, made again in another simulation."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.engines.mujoco import MujocoEngine, regions
from mindstage.episodes import Episode, Recorder
from mindstage.episodes.recording import EpisodeEdit
from mindstage.episodes.repeating import repeat_edits
from mindstage.knowledge import KnowledgeBase
from mindstage.robots import add_robot, find_robot
from mindstage.scene import BodyId, Pose, diff
from mindstage.scene.edits import Delete, Edit, SetPoses, Spawn, edit_to_json
from mindstage.simulation import Simulation
from tests.engines.contract import apply_force_for
from tests.engines.scenes import body, prismatic_joint, world
from tests.kitchenette import kitchenette
from tests.viewer.waiting import wait_until

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


def test_a_recording_of_a_world_of_several_regions_gives_the_same_bits_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The partition and its handovers are functions of the edits and of the state, so that they are not recorded."""
    monkeypatch.setattr(regions, "REGION_BODIES", 5)
    row = [body(f"box{n}", (0.4 * n, 0.0, 0.1), (0.2, 0.2, 0.2), "dynamic", 1.0) for n in range(24)]
    position = world(
        body("floor", (5, 0, -0.05), (30, 20, 0.1)), body("ram", (-1, 0, 0.1), (0.2,) * 3, "kinematic"), *row
    )
    poses = []
    for again in (False, True):
        with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True, timeout_s=60.0) as sim:
            sim.spawn(position)
            if again:
                with Episode(tmp_path / "run.mcap") as episode:
                    repeat_edits(episode, sim)
            else:
                with Recorder(sim, tmp_path / "run.mcap"):
                    sim.step(0.1)
                    for cycle in range(40):
                        sim.apply(SetPoses({BodyId("ram"): Pose((-1.0 + 0.05 * cycle, 0.0, 0.1))}))
                        sim.step(0.02)
                    sim.edits.delete([BodyId("box7")])
                    sim.step(0.1)
                    sim.spawn(world(body("late", (2.4, 0.0, 0.5), (0.2, 0.2, 0.2), "dynamic", 1.0)))
            sim.step(1.0)
            counts = sim.engine.run(lambda engine: len(engine._cache.regions))  # type: ignore[attr-defined]
            assert counts > 2
            poses.append(sim.state.poses)
    assert float(poses[0][2][0]) > 0.3, "the ram has pushed the row"
    np.testing.assert_array_equal(*poses)


@pytest.mark.parametrize("is_played", [False, True])
def test_overlapping_pairs_and_regions_of_a_recording_give_the_same_bits_again(
    is_played: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bodies are added inside others, leave them, and are pushed against them, from one region to the next.

    While time passes by itself, edits are made at any time; with each one, the time is recorded at which it was made,
    which is that of the change of the models.
    """
    monkeypatch.setattr(regions, "REGION_BODIES", 5)
    row = [body(f"box{n}", (0.5 * n, 0.0, 0.1), (0.2, 0.2, 0.2), "dynamic", 1.0) for n in range(20)]
    rail, arm = body("rail", (0, -1.0, 0.2), (0.1,) * 3), body("arm", (0, -1.0, 0.5), (0.6, 0.04, 0.04), "dynamic", 1.0)
    position = world(
        body("floor", (5, 0, -0.05), (30, 20, 0.1)), body("ram", (-0.5, 0, 0.1), (0.2,) * 3, "kinematic"), *row,
        rail, arm, prismatic_joint("slide", "rail", "arm", (0, -1.0, 0.5)),
    )  # fmt: skip

    def edits() -> Iterator[Edit]:
        block = body("block", (0.37, -1.0, 0.5), (0.2, 0.2, 0.2))
        inside = body("inside", (4.6, 0.0, 0.1), (0.2, 0.2, 0.2), "dynamic", 1.0)  # two of the row
        yield Spawn(world(block, inside), settle=False)
        for cycle in range(12):
            yield SetPoses({BodyId("ram"): Pose((-0.5 + 0.08 * cycle, 0.0, 0.1))})
            if cycle == 5:
                yield SetPoses({BodyId("arm"): Pose((-0.2, -1.0, 0.5))})
                yield Delete((BodyId("box17"),))
            if cycle == 8:
                yield SetPoses({BodyId("inside"): Pose((4.5, 1.0, 0.1))})

    def pairs(sim: Simulation) -> set[tuple[str, str]]:
        return sim.engine.run(lambda engine: set(engine._cache.builder.collision_filter.temporary_pairs))  # type: ignore[attr-defined]

    poses, left, seen, times = [], [], set[tuple[str, str]](), []
    for again in (False, True):
        with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True, timeout_s=60.0) as sim:
            sim.spawn(position)
            if again:
                with Episode(tmp_path / "run.mcap") as episode:
                    repeat_edits(episode, sim)
                sim.step(round(times[0] - sim.state.time_s, 9))
            else:
                with Recorder(sim, tmp_path / "run.mcap"):
                    for each in edits():
                        if is_played:
                            sim.play()
                            reached_s = sim.state.time_s + 0.02
                            wait_until(lambda due=reached_s: sim.state.time_s >= due, "time passes")
                        else:
                            sim.step(0.03)
                        sim.apply(each)
                        seen |= pairs(sim)
                    sim.pause()
                    sim.step(0.5)
            times.append(sim.state.time_s)
            assert sim.engine.run(lambda engine: len(engine._cache.regions)) > 2  # type: ignore[attr-defined]
            left.append(pairs(sim))
            poses.append(sim.state.poses)
    assert ("arm", "block") in seen
    assert any("inside" in pair for pair in seen)
    assert left == [set(), set()], "they were apart"
    assert times[0] == times[1]
    np.testing.assert_array_equal(*poses)


def test_what_touches_when_a_recording_is_continued_collides_though_it_began_inside_each_other(tmp_path: Path) -> None:
    """An arm is out of the block into which it was put, and at its face: it is not pushed into it again."""
    rail, arm = body("rail", (0, 0, 0.2), (0.1,) * 3), body("arm", (0, 0, 0.5), (0.6, 0.04, 0.04), "dynamic", 1.0)
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True, timeout_s=60.0) as sim:
        sim.spawn(world(rail, arm, prismatic_joint("slide", "rail", "arm", (0, 0, 0.5))))
        with Recorder(sim, tmp_path / "run.mcap"):
            sim.spawn(world(body("block", (0.37, 0, 0.5), (0.2, 0.2, 0.2))))
            sim.step(0.1)
            for x in (-0.2, -0.0299):
                sim.apply(SetPoses({BodyId("arm"): Pose((x, 0.0, 0.5))}))
                sim.step(0.1)
    with Episode(tmp_path / "run.mcap") as episode, episode.resume(episode.end_s) as resumed:
        resumed.engine.run(lambda engine: apply_force_for(engine, "arm", (8.0, 0.0, 0.0), 1.0))
        assert resumed.engine.run(lambda engine: float(engine.poses()[1][1][0])) == pytest.approx(-0.03, abs=1e-3)


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
