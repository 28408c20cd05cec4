"""Supports and the assumed ground, against worlds whose supports are known by construction.

The generator states for each loose body what has to happen to it, by mechanics on paper: a box stays on an edge if its
center of mass is above the support, a stack if that holds at each level, and what has nothing below it falls to the
ground, at the lowest side of the large fixed bodies near loose ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from math import cos, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.engines.base import SpawnNoteKind, SpawnReport
from mindstage.engines.mujoco import MujocoEngine
from mindstage.scene import BodyId, Pose, World
from mindstage.scene.edits import Delete, SetPoses, Spawn
from tests.engines.scenes import body, world

SEEDS = range(240)


@dataclass
class Place:
    """A world under construction, and what has to happen in it."""

    rng: np.random.Generator
    yaw: float
    ground_m: float | None = None
    parts: list[object] = field(default_factory=list)
    rests: dict[str, float] = field(default_factory=dict)
    """Bodies that stay where they are."""
    falls: dict[str, float] = field(default_factory=dict)
    """Bodies that fall flat, and the height of what they land on [m]."""
    tips: dict[str, float] = field(default_factory=dict)
    """Bodies that tip over an edge, and the height of what they end on [m]."""
    needs: set[str] = field(default_factory=set)
    """Bodies for which a ground has to be assumed."""

    def add(self, id: str, low: tuple[float, float, float], size: tuple[float, float, float], kind: str) -> None:
        """Adds a box by its lowest corner; the whole place is then turned about the vertical axis."""
        x, y, z = (corner + extent / 2 for corner, extent in zip(low, size, strict=True))
        x, y = x * cos(self.yaw) - y * sin(self.yaw), x * sin(self.yaw) + y * cos(self.yaw)
        turn = (cos(self.yaw / 2), 0.0, 0.0, sin(self.yaw / 2))
        self.parts.append(body(id, (x, y, z), size, kind, 0.5 if kind == "dynamic" else None, quaternion=turn))

    def fixed(self, id: str, low: tuple[float, float, float], size: tuple[float, float, float]) -> None:
        self.add(id, low, size, "static")

    def item(
        self, id: str, x: float, y: float, bottom: float, size: tuple[float, float, float] = (0.2, 0.2, 0.2)
    ) -> None:
        self.add(id, (x - size[0] / 2, y - size[1] / 2, bottom), size, "dynamic")

    def uniform(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))


def table(place: Place, x: float, y: float, bottom: float, name: str = "table") -> float:
    """A table 1.2 m x 0.8 m whose right edge is at x + 0.6; returns its height."""
    place.fixed(name, (x - 0.6, y - 0.4, bottom), (1.2, 0.8, 0.72))
    return bottom + 0.72


def on_table(place: Place, x: float, y: float, top: float, below: float, name: str) -> None:
    """Boxes on a table: one in the middle, one over the right edge, a stack over the left one."""
    place.item(f"{name}cup", x, y, top)
    place.rests[f"{name}cup"] = top
    stays = place.rng.random() < 0.5
    out = place.uniform(0.1, 0.4) if stays else place.uniform(0.6, 0.9)  # the part of the box beyond the edge
    place.item(f"{name}edge", x + 0.6 - 0.1 + 0.2 * out, y, top)
    (place.rests if stays else place.tips)[f"{name}edge"] = top if stays else below
    lower, upper = place.uniform(-0.6, 0.6), place.uniform(-0.6, 0.6)
    # The centers of mass of both, and of the upper one alone, have to be at least 2 cm from the edges below them.
    if abs(upper) > 0.8 or abs((lower + (lower + upper)) / 2) < 0.1:
        return
    edge = x - 0.6
    place.item(f"{name}book", edge - lower * 0.2, y, top)
    place.item(f"{name}box", edge - (lower + upper * 0.5) * 0.2, y, top + 0.2)
    together = (lower + lower + upper * 0.5) / 2
    if together < -0.08 and lower < 0.45 and abs(upper * 0.5) < 0.42:
        place.rests |= {f"{name}book": top, f"{name}box": top + 0.2}
    elif together > 0.08 and 0.08 < lower < 0.42:
        place.tips |= {f"{name}book": below, f"{name}box": below}
    else:
        del place.parts[-2:]


def floor(place: Place, z: float) -> None:
    place.fixed("floor", (-3.0, -3.0, z - 0.1), (6.0, 6.0, 0.1))
    place.item("mug", place.uniform(-2.5, -1.5), place.uniform(-1, 1), z, (0.08, 0.08, 0.1))
    place.rests["mug"] = z
    place.item("lamp", place.uniform(-2.5, -1.5), place.uniform(2, 2.5), z + place.uniform(0.3, 2.0))
    place.falls["lamp"] = z


def beyond(place: Place, z: float, height: float, side: float = 4.5) -> None:
    """A box beyond the floor, with nothing below it."""
    place.item("beyond", -side, place.uniform(-1, 1), z + height)
    place.falls["beyond"] = place.ground_m if place.ground_m is not None else z
    place.needs.add("beyond")


def place_with_floor(place: Place, z: float) -> None:
    floor(place, z)
    on_table(place, 0.0, 0.0, table(place, 0.0, 0.0, z), z, "")
    place.fixed("pipe", (-0.05, 2.9, z - 0.6), (0.1, 0.1, 0.5))  # too small to say anything about the ground
    if place.rng.random() < 0.7:
        place.ground_m = z - 0.1
        beyond(place, z, place.uniform(0.2, 2.5))


def place_without_floor(place: Place, z: float) -> None:
    place.ground_m = z
    on_table(place, 0.0, 0.0, table(place, 0.0, 0.0, z), z, "")
    place.needs |= place.tips.keys()
    for number, side in enumerate((-1.0, 1.0)):
        place.item(f"chair{number}", 0.0, side, z, (0.45, 0.45, 0.9))
        place.rests[f"chair{number}"] = z
        place.needs.add(f"chair{number}")
    place.fixed("hill", (40.0, -50.0, z - 20.0), (60.0, 100.0, 1.0))  # scenery, and far from all loose bodies


def place_with_basement(place: Place, z: float) -> None:
    floor(place, z)
    place.fixed("cellar", (-3.0, -3.0, z - 2.6), (6.0, 6.0, 0.1))
    place.item("crate", 0.0, 0.0, z - 2.5, (0.5, 0.4, 0.3))
    place.rests["crate"] = z - 2.5
    place.ground_m = z - 2.6
    beyond(place, z, place.uniform(0.2, 1.5))


def place_above_a_deep_valley(place: Place, z: float) -> None:
    """What is far from loose bodies says nothing about the ground, but what falls there must not stop above it."""
    floor(place, z)
    place.fixed("valley", (3.5, -8.0, z - 6.2), (16.0, 16.0, 0.2))
    place.ground_m = z - 0.1
    beyond(place, z, place.uniform(0.2, 1.5))
    place.item("stone", 9.0, 0.0, z + 1.0)
    place.falls["stone"] = z - 6.0


def place_with_storeys(place: Place, z: float) -> None:
    floor(place, z)
    place.fixed("upper", (-2.0, -3.0, z + 2.6), (4.0, 6.0, 0.2))
    on_table(place, 0.0, 0.0, table(place, 0.0, 0.0, z), z, "")
    top = table(place, 0.3, 1.5, z + 2.8, "desk")
    place.item("vase", 0.3, 1.5, top)
    place.rests["vase"] = top
    place.ground_m = z - 0.1
    beyond(place, z, place.uniform(2.0, 4.0))


def place_with_stairs(place: Place, z: float) -> None:
    """Steps that lead away from the floor into a cellar: those near loose bodies are above the others."""
    floor(place, z)
    steps = [(3.0 + 0.3 * number, z - 0.25 * (number + 1)) for number in range(16)]
    for number, (x, top) in enumerate(steps):
        place.fixed(f"step{number}", (x, -0.5, top - 0.1), (0.3, 1.0, 0.1))
    place.item("ball", 2.5, 0.0, z)
    place.rests["ball"] = z
    near = [top - 0.1 for x, top in steps if (x - 2.6) ** 2 + max(z - top, 0.0) ** 2 <= 3.0**2]
    place.ground_m = min(near)
    place.yaw = 0.0
    beyond(place, z, place.uniform(0.2, 1.5))


def place_of_loose_bodies(place: Place, z: float) -> None:
    place.ground_m = z
    for number in range(int(place.rng.integers(1, 5))):
        place.item(f"cup{number}", number * 0.5, 0.0, z)
        place.rests[f"cup{number}"] = z
        place.needs.add(f"cup{number}")
    place.item("saucer", 0.0, 0.0, z + 0.2, (0.15, 0.15, 0.02))
    place.rests["saucer"] = z + 0.2
    place.needs.add("saucer")


PLACES = (
    place_with_floor,
    place_without_floor,
    place_with_basement,
    place_above_a_deep_valley,
    place_with_storeys,
    place_with_stairs,
    place_of_loose_bodies,
)


def generate(seed: int) -> Place:
    rng = np.random.default_rng([seed, 32])
    place = Place(rng, yaw=float(rng.uniform(-3.1, 3.1)))
    make = PLACES[seed % len(PLACES)]
    if make is place_with_stairs:
        place.yaw = 0.0
    make(place, float(rng.uniform(-2.0, 2.0)))
    if seed % 3 == 0:
        place.fixed("sky", (-4.1e4, -4.1e4, -4.1e4), (8.2e4, 8.2e4, 8.2e4))
    order = rng.permutation(len(place.parts))
    place.parts = [place.parts[row] for row in order]
    return place


def ground_ids(report: SpawnReport) -> set[str]:
    return {str(id) for id in report.ids_with_note(SpawnNoteKind.GROUND)}


def heights(engine: MujocoEngine) -> dict[str, float]:
    ids, poses = engine.poses()
    return dict(zip(map(str, ids), poses[:, 2].tolist(), strict=True))


def check(place: Place) -> Iterator[str]:
    """What happened otherwise than by construction."""
    described: World = world(*place.parts)  # type: ignore[arg-type]
    sizes = {str(each.id): each.size for each in described.bodies}
    with closing(MujocoEngine()) as engine:
        report = engine.apply(Spawn(described, ground=True)).report
        if ground_ids(report) != place.needs:
            yield f"a ground for {ground_ids(report)}, not for {place.needs}"
        expected = f"at a height of {place.ground_m:.3f} m" if place.needs else None
        if (expected is None) != (not engine.assumptions) or (expected and expected not in engine.assumptions[0]):
            yield f"{engine.assumptions}, not {expected}"
        ids, before = engine.poses()
        engine.step(3.0)
        _, after = engine.poses()
    for id, first, last in zip(map(str, ids), before, after, strict=True):
        size = sizes[id] or (0.0, 0.0, 0.0)
        moved = float(np.linalg.norm(last[:3] - first[:3]))
        if id in place.rests and moved > 0.005:
            yield f"{id} moved by {moved:.3f} m"
        if id in place.falls and abs(last[2] - size[2] / 2 - place.falls[id]) > 0.01:
            yield f"{id} fell to {last[2] - size[2] / 2:.3f}, not to {place.falls[id]:.3f} m"
        lowest, highest = min(size) / 2, float(np.linalg.norm(size)) / 2
        if id in place.tips and not lowest - 0.01 < last[2] - place.tips[id] < highest + 2 * lowest + 0.01:
            yield f"{id} is at {last[2]:.3f} m, and had to fall to {place.tips[id]:.3f} m"


@pytest.mark.parametrize("kind", range(len(PLACES)), ids=[each.__name__ for each in PLACES])
def test_each_body_stays_tips_or_falls_as_constructed(kind: int) -> None:
    wrong = {seed: found for seed in SEEDS if seed % len(PLACES) == kind and (found := list(check(generate(seed))))}
    assert not wrong


ROOM = body("floor", (0, 0, -0.05), (4, 4, 0.1))
CRATE = body("crate", (5, 0, 0.5), (0.2, 0.2, 0.2), "dynamic", 1.0)


def test_the_ground_and_what_is_assumed_are_part_of_states_forks_and_undo() -> None:
    with closing(MujocoEngine()) as engine:
        engine.apply(Spawn(world(ROOM), ground=True))
        empty = engine.save_state()
        applied = engine.apply(Spawn(world(CRATE), ground=True))
        assumed = engine.assumptions
        assert assumed == ("a ground is assumed at a height of -0.100 m, since the map has none below crate",)
        with closing(engine.fork()) as fork:
            assert fork.assumptions == assumed
            fork.step(2.0)
            assert heights(fork)["crate"] == pytest.approx(0.0, abs=1e-3)
        state = engine.save_state()
        engine.restore_state(empty)
        assert engine.assumptions == ()
        engine.restore_state(state)
        engine.step(2.0)
        assert (engine.assumptions, heights(engine)["crate"]) == (assumed, pytest.approx(0.0, abs=1e-3))
        engine.apply(applied.inverse)
        engine.apply(applied.edit)
        engine.step(2.0)
        assert heights(engine)["crate"] == pytest.approx(0.0, abs=1e-3)


def test_a_body_below_the_ground_is_not_thrown_out_and_comes_back_so_after_deletion() -> None:
    """A cellar that is added later, below a ground that others stand on."""
    cellar = body("cellar", (40, 0, -5.05), (4, 4, 0.1))
    cask = body("cask", (40, 0, -4.75), (0.5, 0.5, 0.5), "dynamic", 5.0)
    with closing(MujocoEngine()) as engine:
        engine.apply(Spawn(world(ROOM, CRATE), ground=True))
        engine.step(2.0)
        engine.apply(Spawn(world(cellar, cask), ground=True))
        engine.step(1.0)
        assert heights(engine) == pytest.approx({**heights(engine), "crate": 0.0, "cask": -4.75}, abs=2e-3)
        engine.apply(engine.apply(Delete((BodyId("cask"),))).inverse)
        engine.step(1.0)
        assert heights(engine)["cask"] == pytest.approx(-4.75, abs=2e-3)


def test_a_ground_stays_while_bodies_are_added_that_need_it_too() -> None:
    with closing(MujocoEngine()) as engine:
        for number in range(12):
            cup = body(f"cup{number}", (0.3 * number, 0, 1.0 + number / 10), (0.1, 0.1, 0.1), "dynamic", 0.2)
            report = engine.apply(Spawn(world(cup), ground=True)).report
            assert ground_ids(report) == {f"cup{number}"}
            engine.step(0.2)
        engine.step(1.0)
        assert heights(engine) == pytest.approx(dict.fromkeys(heights(engine), 1.0), abs=2e-3)


def test_things_roll_down_stairs_below_the_assumed_ground() -> None:
    """The steps go on where the ground for a body beside the house is cut off."""
    rng = np.random.default_rng(1)
    place = Place(rng, yaw=0.0)
    place_with_stairs(place, 0.0)
    with closing(MujocoEngine()) as engine:
        engine.apply(Spawn(world(*place.parts), ground=True))  # type: ignore[arg-type]
        engine.step(1.0)
        engine.apply(SetPoses({BodyId("ball"): Pose((3.0 + 0.3 * 15 + 0.15, 0.0, -0.25 * 16 + 0.1))}))
        engine.step(1.0)
        assert heights(engine)["ball"] == pytest.approx(-3.9, abs=2e-3)


@given(st.integers(0, 2**31))
def test_sky_spheres_change_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    radius = float(rng.uniform(40.0, 8.2e4))
    sky = body("sky", tuple(rng.uniform(-5.0, 5.0, 3).tolist()), (radius,) * 3)
    with closing(MujocoEngine()) as engine:
        engine.apply(Spawn(world(ROOM, CRATE, sky), ground=True))
        assert "-0.100 m" in engine.assumptions[0]
        engine.step(1.0)
        assert heights(engine)["crate"] == pytest.approx(0.0, abs=1e-3)


def test_the_ground_is_not_where_the_map_is_doubtful() -> None:
    """A wall whose mesh has its origin at the top hangs 4 m below the floor; a later spawn, a copy and undo agree."""
    wall = body("wall", (3, 1, -2), (4, 0.2, 4))
    doubtful = frozenset({wall.id})
    with closing(MujocoEngine()) as engine:
        engine.apply(Spawn(world(ROOM, CRATE, wall), ground=True))
        assert "-4.000 m" in engine.assumptions[0], "without the finding"
        engine.clear()
        engine.apply(Spawn(world(ROOM, wall), ground=True, uncertain_poses=doubtful))
        engine.apply(engine.apply(Delete((wall.id,))).inverse)
        with closing(engine.fork()) as fork:
            for each in (engine, fork):
                each.apply(Spawn(world(CRATE), ground=True))
                assert "-0.100 m" in each.assumptions[0]
                each.step(1.0)
                assert heights(each)["crate"] == pytest.approx(0.0, abs=1e-3)


def test_doubtful_bodies_count_if_there_is_nothing_else() -> None:
    with closing(MujocoEngine()) as engine:
        engine.apply(Spawn(world(ROOM, CRATE), ground=True, uncertain_poses=frozenset({CRATE.id, ROOM.id})))
        assert "-0.100 m" in engine.assumptions[0]
