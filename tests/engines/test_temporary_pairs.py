"""Bodies that are added inside others do not collide with these until they were apart once.

An arm slides along x; blocks are added that its tip is in. How deep it is in them follows from its position on paper.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from contextlib import closing

import pytest

from mindstage.engines.base import SpawnNoteKind
from mindstage.engines.mujoco import MujocoEngine, regions
from mindstage.scene import BodyId
from mindstage.scene.edits import Delete, SetLabel, SetPoses, Spawn
from mindstage.scene.world_model import Pose
from tests.engines.contract import apply_force_for, current_pose
from tests.engines.scenes import body, prismatic_joint, world

ARM = world(
    body("rail", (0, 0, 0.2), (0.1, 0.1, 0.1)),
    body("arm", (0, 0, 0.5), (0.6, 0.04, 0.04), "dynamic", 1.0),
    prismatic_joint("slide", "rail", "arm", (0, 0, 0.5)),
)
TIP_M = 0.3
"""From the middle of the arm."""
FACE_M = 0.27
"""The face of the blocks, in which the tip begins."""
BLOCKS = [body(f"block{side}", (FACE_M + 0.1, 0.09 * side, 0.5), (0.2, 0.17, 0.2)) for side in (-1, 1)]
LATE = "they collide from now on"


@pytest.fixture
def engine() -> Iterator[MujocoEngine]:
    with closing(MujocoEngine()) as engine:
        engine.apply(Spawn(ARM))
        yield engine


def depth_m(engine: MujocoEngine) -> float:
    return float(current_pose(engine, "arm")[0]) + TIP_M - FACE_M


def push(engine: MujocoEngine, force_n: float, duration_s: float = 0.5) -> None:
    apply_force_for(engine, "arm", (force_n, 0.0, 0.0), duration_s)


def add_blocks(engine: MujocoEngine) -> None:
    report = engine.apply(Spawn(world(*BLOCKS))).report
    assert any("they do not collide" in note.text for note in report.notes)
    assert [text.split(" began")[0] for text in engine.assumptions] == ["arm and block-1", "arm and block1"]


def late_notes(engine: MujocoEngine) -> list[tuple[str, ...]]:
    return [note.ids for note in engine.notes if note.kind is SpawnNoteKind.OVERLAP and LATE in note.text]


def test_the_arm_passes_on_until_it_was_out_and_never_again(engine: MujocoEngine) -> None:
    add_blocks(engine)
    push(engine, 8.0)
    assert depth_m(engine) > 0.05
    push(engine, -8.0)
    push(engine, -8.0)
    assert depth_m(engine) < -0.001
    assert engine.assumptions == ()
    assert late_notes(engine) == [("arm", "block-1"), ("arm", "block1")]
    push(engine, 8.0, 1.5)
    assert -0.001 < depth_m(engine) < 0.001
    assert {contact.b for contact in engine.contacts() if contact.a == "arm"} == {"block-1", "block1"}


def test_it_is_the_same_in_a_world_of_several_regions(engine: MujocoEngine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(regions, "REGION_BODIES", 5)
    row = [body(f"box{n}", (n, 9.0, 0.1), (0.2, 0.2, 0.2), "dynamic", 1.0) for n in range(20)]
    engine.apply(Spawn(world(body("floor", (10, 9, -0.05), (30, 2, 0.1)), *row)))
    add_blocks(engine)
    push(engine, -8.0)
    push(engine, -8.0)
    assert len(engine._cache.regions) > 2
    assert late_notes(engine) == [("arm", "block-1"), ("arm", "block1")]
    engine.apply(SetPoses({BodyId("box3"): Pose((-2.0, 9.0, 0.1))}))
    push(engine, 8.0, 1.5)
    assert -0.001 < depth_m(engine) < 0.001


def test_each_pair_counts_for_itself(engine: MujocoEngine) -> None:
    engine.apply(Spawn(world(*BLOCKS, body("mast", (0.0, 0.1, 0.5), (0.1, 0.2, 0.2)))))
    engine.step(0.1)
    engine.apply(SetPoses({BodyId("arm"): Pose((-0.1, 0.0, 0.5))}))  # still in the mast
    assert len(engine.assumptions) == 1
    assert engine.assumptions[0].startswith("arm and mast began inside each other")
    push(engine, 8.0, 1.5)
    assert -0.001 < depth_m(engine) < 0.001


def test_it_is_part_of_states_forks_undo_and_edits(engine: MujocoEngine) -> None:
    add_blocks(engine)
    inside = engine.save_state()
    with closing(engine.fork()) as copy:
        push(copy, -8.0, 1.0)
        assert (copy.assumptions, len(engine.assumptions)) == ((), 2)
        outside = copy.save_state()
        push(engine, 8.0)
        assert depth_m(engine) > 0.05, "the fork has shared its model"
        engine.restore_state(pickle.loads(pickle.dumps(outside)))
        engine.apply(SetLabel(BodyId("arm"), "arm"))
        engine.apply(Spawn(world(body("far", (3, 0, 0.1), (0.1, 0.1, 0.1)))))  # which compiles the model anew
        push(engine, 8.0, 1.5)
        assert -0.001 < depth_m(engine) < 0.001
        engine.restore_state(inside)
        push(engine, 8.0)
        assert depth_m(engine) > 0.05
        assert len(engine.assumptions) == 2
        engine.apply(engine.apply(Delete((BodyId("block1"), BodyId("block-1")))).inverse)
        push(engine, 4.0, 0.2)
        assert (depth_m(engine) > 0.05, len(engine.assumptions)) == (True, 2)
        push(engine, -8.0, 2.0)
        assert engine.assumptions == ()


def test_a_pose_that_is_set_counts_too(engine: MujocoEngine) -> None:
    add_blocks(engine)
    engine.step(0.1)
    engine.apply(SetPoses({BodyId("arm"): Pose((-0.2, 0.0, 0.5))}))
    assert engine.assumptions == ()
    push(engine, 8.0, 2.0)
    assert -0.001 < depth_m(engine) < 0.001


def test_parts_that_one_world_describes_inside_each_other_stay_excluded() -> None:
    """A drawer and the neighbor of its casing: it has to return to where it was."""
    with closing(MujocoEngine()) as engine:
        engine.apply(Spawn(world(*ARM.bodies, *ARM.joints, *BLOCKS)))
        assert engine.assumptions == ()
        push(engine, -8.0, 1.0)
        push(engine, 8.0, 1.5)
        assert depth_m(engine) > 0.05


def test_loose_bodies_inside_each_other_collide_once_they_were_apart() -> None:
    floor = body("floor", (0, 0, -0.05), (4, 4, 0.1))
    crate = body("crate", (0, 0, 0.25), (0.5, 0.5, 0.5), "dynamic", 5.0)
    core = body("core", (0.02, 0, 0.2), (0.4, 0.4, 0.4), "dynamic", 2.0)
    with closing(MujocoEngine()) as engine:
        engine.apply(Spawn(world(floor, crate, core)))
        engine.step(0.5)
        assert len(engine.assumptions) == 1
        engine.apply(SetPoses({BodyId("core"): Pose((0.0, 0.0, 0.75))}))
        engine.step(1.0)
        assert engine.assumptions == ()
        assert current_pose(engine, "core")[2] == pytest.approx(0.7, abs=2e-3)


def test_the_same_calls_have_the_same_result_bit_for_bit() -> None:
    ends = []
    for _ in range(2):
        with closing(MujocoEngine()) as engine:
            engine.apply(Spawn(ARM))
            add_blocks(engine)
            for force_n in (-8.0, 8.0, 3.0, -2.0):
                push(engine, force_n, 0.7)
            ends.append(engine.poses()[1].tobytes())
    assert ends[0] == ends[1]
