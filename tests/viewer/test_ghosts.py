"""Ghosts: where they are, what they are colored, and that none of another layer or of an ended copy remains."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.imagination import Outcome, Plan, ReplayFrame, SampleResult, Verdict, Wait
from mindstage.imagination.verdicts import IntervalKind
from mindstage.rendering.appearance import compute_appearance
from mindstage.scene import BodyId, Pose
from mindstage.viewer import ghosts as ghosts_module
from mindstage.viewer.ghosts import (
    FAILED_COLOR,
    GhostGroup,
    GhostNodes,
    ImaginationGhosts,
    ReplayGhosts,
    end_pose_ghosts,
    trail_ghosts,
)
from tests.cases import each_case
from tests.kitchenette import kitchenette
from tests.viewer.fake_server import FakeServer

KNOWLEDGE = KnowledgeBase()
WORLD = kitchenette()
APPEARANCES = compute_appearance(WORLD, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors)
MUG, DRAWER, FLOOR = BodyId("Mug"), BodyId("Drawer"), BodyId("Floor")


@pytest.fixture
def server() -> FakeServer:
    return FakeServer()


@pytest.fixture
def nodes(server: FakeServer) -> GhostNodes:
    return GhostNodes(server)  # type: ignore[arg-type]


def group(id: BodyId, *positions: tuple[float, float, float], color: tuple[float, ...] = (1.0, 0.0, 0.0)) -> GhostGroup:
    poses = np.array([(*position, 2.0, 0.0, 0.0, 0.0) for position in positions]).reshape(-1, 7)
    return GhostGroup(id, poses, np.array([color] * len(positions)).reshape(-1, 3))


def drawn(server: FakeServer) -> dict[str, list[list[float]]]:
    """The positions of the ghosts, by node."""
    return {
        name.removeprefix("/ghosts/"): np.asarray(vars(node)["batched_positions"]).tolist()
        for name, node in server.scene.nodes.items()
        if name.startswith("/ghosts/")
    }


# -- nodes -------------------------------------------------------------------------------------------------------------


def test_a_layer_is_replaced_and_other_layers_stay(server: FakeServer, nodes: GhostNodes) -> None:
    assert nodes.show("one", [group(MUG, (1, 0, 0), (2, 0, 0)), group(DRAWER, (3, 0, 0))], APPEARANCES) == ()
    assert nodes.show("two / b", [group(MUG, (4, 0, 0))], APPEARANCES) == ()
    assert drawn(server) == {
        "one/Mug": [[1, 0, 0], [2, 0, 0]],
        "one/Drawer": [[3, 0, 0]],
        "two%20%2F%20b/Mug": [[4, 0, 0]],
    }
    assert nodes.layers == {"one", "two / b"}
    nodes.show("one", [group(MUG, (5, 0, 0), (6, 0, 0))], APPEARANCES)
    assert drawn(server) == {"one/Mug": [[5, 0, 0], [6, 0, 0]], "two%20%2F%20b/Mug": [[4, 0, 0]]}
    nodes.show("one", [group(MUG, (7, 0, 0))], APPEARANCES)
    assert drawn(server)["one/Mug"] == [[7, 0, 0]], "another number of them"
    nodes.clear("one")
    assert drawn(server) == {"two%20%2F%20b/Mug": [[4, 0, 0]]}
    assert nodes.layers == {"two / b"}
    nodes.show("two / b", [group(MUG)], APPEARANCES)
    assert drawn(server) == {}
    assert nodes.layers == frozenset()


def test_ghosts_are_translucent_and_have_their_colors(server: FakeServer, nodes: GhostNodes) -> None:
    red_and_white = GhostGroup(MUG, group(MUG, (1, 0, 0), (2, 0, 0)).poses, np.array([[1.0, 0, 0], [1.0, 1, 1]]))
    nodes.show("one", [red_and_white], APPEARANCES)
    node = vars(server.scene.nodes["/ghosts/one/Mug"])
    assert node["batched_colors"].tolist() == [[255, 0, 0], [255, 255, 255]]
    assert all(0.0 < opacity < 1.0 for opacity in node["batched_opacities"])
    assert np.asarray(node["batched_wxyzs"]).tolist() == [[1.0, 0.0, 0.0, 0.0]] * 2, "normalized"


def test_only_moved_ghosts_are_not_drawn_again(server: FakeServer, nodes: GhostNodes) -> None:
    nodes.show("one", [group(MUG, (1, 0, 0))], APPEARANCES)
    with server.scene.recording() as messages:
        nodes.show("one", [group(MUG, (2, 0, 0))], APPEARANCES)
    assert {what for _, what in messages} == {"batched_positions", "batched_wxyzs"}
    other = compute_appearance(WORLD, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors)
    with server.scene.recording() as messages:
        nodes.show("one", [group(MUG, (2, 0, 0))], {MUG: other[MUG]})
    assert [what for _, what in messages] == ["remove", "add"], "its body looks otherwise now"


def test_what_cannot_be_drawn_is_reported_and_its_old_ghosts_are_removed(server: FakeServer, nodes: GhostNodes) -> None:
    nodes.show("one", [group(MUG, (1, 0, 0)), group(DRAWER, (1, 0, 0))], APPEARANCES)
    fewer = {id: appearance for id, appearance in APPEARANCES.items() if id != MUG}
    gone = BodyId("Gone")
    wanted = [group(MUG, (2, 0, 0)), group(gone, (2, 0, 0)), group(DRAWER, (2, 0, 0))]
    assert nodes.show("one", wanted, fewer) == (MUG, gone)
    assert drawn(server) == {"one/Drawer": [[2, 0, 0]]}


# -- samples -----------------------------------------------------------------------------------------------------------


def verdict(*results: SampleResult) -> Verdict:
    return Verdict(
        outcome=Outcome.UNKNOWN,
        probability=None,
        interval=(0.0, 1.0),
        interval_kind=IntervalKind.ALWAYS_VALID,
        began_in_collision=0,
        more_samples=None,
        sensitivity="",
        samples=len(results),
        succeeded=0,
        failed=0,
        unknown=0,
        seed=0,
        threshold=0.9,
        stopped="",
        first_failure=None,
        causes=(),
        assumptions=(),
        plan=Plan(steps=(Wait(duration_s=1.0),)),
        results=results,
    )


def test_every_sample_has_a_ghost_of_each_body_in_the_color_of_its_outcome() -> None:
    outcomes = [Outcome.SUCCEEDED, Outcome.FAILED, Outcome.UNKNOWN]
    results = [
        SampleResult(index=number, outcome=outcome, end_poses={"Mug": Pose((float(number), 0.0, 0.0))})
        for number, outcome in enumerate(outcomes)
    ]
    results[1].end_poses["Drawer"] = Pose((9.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))
    mug, drawer = end_pose_ghosts(verdict(*results))
    assert (mug.body, drawer.body) == (MUG, DRAWER)
    assert mug.poses.tolist() == [[x, 0, 0, 1, 0, 0, 0] for x in (0, 1, 2)]
    assert drawer.poses.tolist() == [[9, 0, 0, 0, 1, 0, 0]]
    green, red, yellow = mug.colors
    assert tuple(red) == FAILED_COLOR == tuple(drawer.colors[0])
    assert green[1] > max(green[0], green[2])
    assert yellow[0] > 0.8 > yellow[1] > 0.5 > yellow[2]


def test_of_many_samples_the_ghosts_are_evenly_chosen() -> None:
    results = [
        SampleResult(index=number, outcome=Outcome.SUCCEEDED, end_poses={"Mug": Pose((float(number), 0.0, 0.0))})
        for number in range(1000)
    ]
    (mug,) = end_pose_ghosts(verdict(*results))
    xs = mug.poses[:, 0]
    assert (xs[0], xs[-1]) == (0.0, 999.0)
    assert 10 < len(xs) < 1000
    assert np.ptp(np.diff(xs)) <= 1.0
    assert end_pose_ghosts(verdict()) == ()


def frame(time_s: float, mug_x: float, wxyz: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)) -> ReplayFrame:
    """The mug moves, the floor does not."""
    rows = [(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), (mug_x, 0.0, 0.0, *wxyz)]
    return ReplayFrame(time_s, (FLOOR, MUG), np.array(rows))


def test_a_replay_shows_what_moves_between_its_frames() -> None:
    replay = ReplayGhosts([frame(0.0, 0.0), frame(1.0, 1.0), frame(3.0, 5.0)])
    assert (replay.ids, replay.duration_s) == ((MUG,), 3.0)
    for time_s, x in (
        (-1.0, 0.0),
        (0.0, 0.0),
        (0.25, 0.25),
        (1.0, 1.0),
        (2.0, 3.0),
        (2.5, 4.0),
        (3.0, 5.0),
        (9.0, 5.0),
    ):
        (ghost,) = replay.at(time_s)
        assert ghost.body == MUG
        assert ghost.poses[0, :3] == pytest.approx([x, 0.0, 0.0])
        assert tuple(ghost.colors[0]) == FAILED_COLOR


def test_a_replay_turns_the_shorter_way() -> None:
    replay = ReplayGhosts([frame(0.0, 0.0), frame(1.0, 1.0, (-1.0, 0.0, 0.0, 0.0))])
    (ghost,) = replay.at(0.5)
    assert abs(ghost.poses[0, 3]) == pytest.approx(1.0), "both quaternions are the same orientation"


@each_case(
    ("frames", "moves"),
    [
        ([], False),
        ([frame(0.0, 0.0)], False),
        ([frame(0.0, 0.0), frame(1.0, 0.009)], False),
        ([frame(0.0, 0.0), frame(1.0, 0.011)], True),
        ([frame(0.0, 0.0), frame(1.0, 0.0, (0.99, 0.14, 0.0, 0.0))], True),
        ([frame(0.0, 0.0), frame(1.0, 0.0, (0.9999, 0.014, 0.0, 0.0))], False),
    ],
)
def test_only_what_moves_or_turns_visibly_is_a_ghost(frames: list[ReplayFrame], moves: bool) -> None:
    replay = ReplayGhosts(frames)
    assert replay.ids == ((MUG,) if moves else ())
    assert len(replay.at(0.0)) == moves
    assert replay.duration_s == (frames[-1].time_s if frames else 0.0)


def test_frames_with_other_bodies_are_left_out() -> None:
    other = ReplayFrame(0.5, (MUG,), np.array([[7.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]]))
    (ghost,) = ReplayGhosts([frame(0.0, 0.0), other, frame(1.0, 1.0)]).at(0.5)
    assert ghost.poses[0, 0] == pytest.approx(0.5)


def test_a_trail_has_the_moving_bodies_at_equal_distances_of_time() -> None:
    (trail,) = trail_ghosts([frame(0.0, 0.0), frame(7.0, 14.0)])
    assert trail.body == MUG
    assert trail.poses[:, 0] == pytest.approx([0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0])
    assert trail.colors.tolist() == [list(FAILED_COLOR)] * 8
    assert trail_ghosts([]) == ()


# -- open copies -------------------------------------------------------------------------------------------------------


@pytest.fixture
def sim() -> Iterator[Simulation]:
    with Simulation(KNOWLEDGE, NullEngine(), primitive_shapes=True) as sim:
        sim.spawn(WORLD)
        yield sim


def test_each_open_copy_is_a_layer_until_it_is_closed(
    sim: Simulation, server: FakeServer, nodes: GhostNodes, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = ImaginationGhosts(nodes)
    now = time.monotonic()

    def update() -> list[dict[str, object]] | None:
        nonlocal now
        now += 1.0
        monkeypatch.setattr(ghosts_module.time, "monotonic", lambda: now)
        return shown.update(sim, sim.state, APPEARANCES)

    assert update() == []
    nodes.show("end poses", [group(MUG, (8, 0, 0))], APPEARANCES)
    first, second = sim.fork(), sim.fork()
    first.edits.move(MUG, Pose((1.0, 0.0, 0.85)))
    second.edits.move(MUG, Pose((2.0, 0.0, 1.35)))
    second.edits.move(DRAWER, Pose((1.75, 0.0, 0.65)))
    second.step(0.5)
    found = update()
    assert found is not None
    assert [(each["number"], each["time_s"], each["differing"]) for each in found] == [
        (1, 0.0, 1),
        (2, 0.5, 3),
    ], "with the drawer its handle has moved"
    assert found[0]["color"] != found[1]["color"]
    assert drawn(server)["copy%201/Mug"] == [pytest.approx([1.0, 0.0, 0.85])]
    assert drawn(server)["copy%202/Mug"] == [pytest.approx([2.0, 0.0, 1.35])]
    assert nodes.layers == {"end poses", "copy 1", "copy 2"}
    assert shown.update(sim, sim.state, APPEARANCES) is None, "it is not due again"
    second.edits.undo()
    second.edits.undo()
    second.edits.delete([FLOOR])
    update()
    assert nodes.layers == {"end poses", "copy 1"}, "nothing is elsewhere in the second one any more"
    third = sim.fork()
    third.edits.move(MUG, Pose((3.0, 0.0, 0.85)))
    first.close()
    found = update()
    assert found is not None
    assert [each["number"] for each in found] == [2, 3], "a copy keeps its number"
    assert nodes.layers == {"end poses", "copy 3"}
    shown.is_shown = False
    found = update()
    assert found is not None
    assert [each["number"] for each in found] == [2, 3]
    assert nodes.layers == {"end poses"}
    shown.is_shown = True
    sim.edits.move(MUG, Pose((3.0, 0.0, 0.85)))
    found = update()
    assert found is not None
    assert [each["differing"] for each in found] == [1, 0], "the third one is now as the original"
    for copy in (second, third):
        copy.close()
    assert update() == []
    assert nodes.layers == {"end poses"}
