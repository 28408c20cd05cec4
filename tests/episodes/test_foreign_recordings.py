"""A recording that was not made here: a bag written by rosbags alone is asked, replayed and continued as an episode."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mindstage import KnowledgeBase
from mindstage.episodes import EpisodeEventKind
from mindstage.episodes.bags import RosBag
from mindstage.episodes.episode import Episode
from mindstage.episodes.recorder import write_episode
from mindstage.maps import save_map
from mindstage.scene import BodyId
from tests.episodes.bag_files import JointReading, Transform, matrix, write_bag
from tests.kitchenette import kitchenette

RATE_HZ = 30
ON_CUPBOARD, ON_FLOOR = (2.0, 0.0, 0.85), (0.5, 0.0, 0.05)
"""The centers of the mug, 10 cm high, on the cupboard and on the floor."""
LIFT_S, CARRY_S, LOWER_S, DOWN_S = 1.0, 2.0, 3.0, 4.0


def mug_at(time_s: float) -> tuple[float, float, float]:
    """The mug is lifted by 0.3 m from the cupboard, carried to another place, and lowered to the floor."""
    x, y, z = ON_CUPBOARD
    up = 0.3 * np.clip((time_s - LIFT_S) / (CARRY_S - LIFT_S), 0.0, 1.0)
    along = np.clip((time_s - CARRY_S) / (LOWER_S - CARRY_S), 0.0, 1.0) * (ON_FLOOR[0] - x)
    down = np.clip((time_s - LOWER_S) / (DOWN_S - LOWER_S), 0.0, 1.0) * (ON_FLOOR[2] - z - 0.3)
    return (float(x + along), y, float(z + up + down))


def drawer_at(time_s: float) -> float:
    """The drawer opens by 0.3 m from 4.5 to 5.5 s."""
    return -0.3 * float(np.clip(time_s - 4.5, 0.0, 1.0))


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> RosBag:
    """Six seconds, as the head of a robot sees the mug from a moving camera."""
    messages: list[Transform | JointReading] = []
    for number in range(6 * RATE_HZ + 1):
        time = number / RATE_HZ
        camera = matrix([0.2 * time, -1.0, 1.5], yaw=0.1 * time, pitch=0.3)
        messages += [
            Transform(time, "map", "camera", camera),
            Transform(time, "camera", "cup_1", np.linalg.inv(camera) @ matrix(mug_at(time))),
            JointReading(time, {"DrawerSlide": drawer_at(time)}),
        ]
    path = write_bag(tmp_path_factory.mktemp("bag"), "mcap", messages, start_s=1.7e9, name="lab")
    return RosBag(path, kitchenette(), bodies={"cup_1": BodyId("Mug")})


@pytest.fixture(scope="module")
def episode(bag: RosBag, tmp_path_factory: pytest.TempPathFactory) -> Episode:
    """The same as an episode file."""
    folder = tmp_path_factory.mktemp("episode")
    save_map(kitchenette(), folder / "map.owl")
    knowledge = KnowledgeBase()
    knowledge.load(folder / "map.owl")
    write_episode(bag, folder / "lab.mcap", knowledge=knowledge, source="lab")
    return Episode(folder / "lab.mcap")


def test_what_a_robot_saw_is_picked_up_carried_and_put_down(bag: RosBag) -> None:
    found = {(event.kind, event.thing): event for event in bag.events()}
    pick, put = found[EpisodeEventKind.PICK_UP, BodyId("Mug")], found[EpisodeEventKind.PUT_DOWN, BodyId("Mug")]
    assert pick.begin_s == pytest.approx(LIFT_S, abs=0.15)
    assert put.end_s == pytest.approx(DOWN_S, abs=0.15)
    supports = [
        (event.other, event.begin_s)
        for event in bag.events()
        if (event.kind, event.thing) == (EpisodeEventKind.SUPPORT, BodyId("Mug"))
    ]
    assert supports[0] == ("Cupboard", 0.0)
    assert supports[-1][0] in {"Floor", None}
    assert supports[-1][1] == pytest.approx(DOWN_S, abs=0.15)


def test_a_drawer_that_joint_states_open_is_opened(bag: RosBag) -> None:
    (opening,) = (event for event in bag.events() if event.kind is EpisodeEventKind.OPEN)
    assert (opening.thing, opening.joint) == ("Drawer", "DrawerSlide")
    assert opening.begin_s == pytest.approx(4.5, abs=0.15)
    assert opening.end_s == pytest.approx(5.5, abs=0.15)
    assert opening.amount == pytest.approx(0.3, abs=0.02)


def test_an_episode_made_of_a_bag_has_its_poses(bag: RosBag, episode: Episode) -> None:
    assert episode.start_unix_s == pytest.approx(1.7e9)
    for time in np.random.default_rng(0).uniform(0.0, bag.end_s, 40).tolist():
        one, other = bag.frame_at(time), episode.frame_at(time)
        assert one.ids == other.ids
        np.testing.assert_allclose(one.poses, other.poses, atol=1e-9)
        row = one.ids.index(BodyId("Mug"))
        np.testing.assert_allclose(one.poses[row][:3], mug_at(one.time_s), atol=1e-6)


def test_an_episode_made_of_a_bag_has_its_events(bag: RosBag, episode: Episode) -> None:
    def summary(events: tuple[object, ...]) -> list[tuple[object, ...]]:
        return [(each.kind, each.thing, each.other, round(each.begin_s, 3)) for each in events]  # type: ignore[attr-defined]

    assert summary(episode.events()) == summary(bag.events())


def test_questions_are_answered_at_any_time_of_a_bag(bag: RosBag, tmp_path: Path) -> None:
    save_map(kitchenette(), tmp_path / "map.owl")
    knowledge = KnowledgeBase()
    knowledge.load(tmp_path / "map.owl")
    knowledge.add_episode(bag)
    early, late = (
        {row.other.rpartition("#")[2] for row in knowledge.ask("where_is", "Mug", "on", at=time)} for time in (0.5, 5.0)
    )
    assert (early, late) == ({"Cupboard"}, {"Floor"})
    assert not list(knowledge.ask("where_is", "Mug", "on", at=2.5))
    picked = knowledge.ask("occurs", "PickingUp")
    assert len(picked) == 1


def test_an_episode_made_of_a_bag_can_be_continued(episode: Episode) -> None:
    with episode.resume(5.8) as simulation:
        before = {body.id: body.pose for body in simulation.snapshot().bodies}
        assert before[BodyId("Mug")].position == pytest.approx(ON_FLOOR, abs=1e-6)
        simulation.step(0.5)
        after = {body.id: body.pose for body in simulation.snapshot().bodies}
        assert after[BodyId("Mug")].position == pytest.approx(ON_FLOOR, abs=0.01)
        assert after[BodyId("Drawer")].position == pytest.approx((1.65, 0.0, 0.65), abs=0.03)
