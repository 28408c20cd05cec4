"""Generated homes: they rest, open and repeat, measured by bare MuJoCo."""

from __future__ import annotations

import os
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import msgspec
import mujoco
import numpy as np
import pytest

import mindstage as ms
from mindstage.engines.mujoco.mjcf import world_to_mjcf
from mindstage.errors import InvalidArgumentError
from mindstage.geometry import fit_geometry
from mindstage.homes import HomePart, HomeStyle, generate_home
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import write_map
from mindstage.scene import Mobility, World
from tests.cli.conftest import run
from tests.cli.runner import Run, json_output
from tests.referee import PlaceReferee

__all__ = ["run"]


@pytest.fixture(scope="module")
def kitchen() -> World:
    return generate_home(seed=11, clutter=0.15)


def referee_of(world: World) -> PlaceReferee:
    export = world_to_mjcf(world, geometry=fit_geometry(world, KnowledgeBase()).geometry)
    return PlaceReferee(mujoco.MjModel.from_xml_string(export.text, dict(export.files)))


@pytest.fixture
def referee(kitchen: World) -> PlaceReferee:
    return referee_of(kitchen)


def test_nothing_overlaps(referee: PlaceReferee) -> None:
    assert referee.overlaps() == set()


def overlapping_boxes(world: World) -> set[tuple[str, str]]:
    """The pairs of static bodies whose boxes overlap; all of them are turned by right angles."""
    still = [body for body in world.bodies if body.physics.mobility is Mobility.STATIC and body.size]
    center = np.array([body.pose.position for body in still])
    half = np.array([body.size for body in still]) / 2
    turned = np.abs([body.pose.quaternion[3] ** 2 - 0.5 for body in still]) < 0.1
    half[turned] = half[turned][:, [1, 0, 2]]
    room = (np.abs(center[:, None] - center) - half[:, None] - half).max(axis=2)
    first, second = np.nonzero(np.triu(room < -0.0005, 1))
    return {(still[a].id, still[b].id) for a, b in zip(first, second, strict=True)}


@pytest.mark.parametrize("style", HomeStyle)
def test_no_furniture_overlaps(style: HomeStyle) -> None:
    for seed in range(6):
        assert overlapping_boxes(generate_home(seed=seed, style=style, clutter=0)) == set()


def test_every_front_opens_over_its_whole_range(referee: PlaceReferee) -> None:
    assert len(referee.hinged) > 15
    assert referee.hit_while_opening() == set()


def test_nothing_moves_by_more_than_a_centimeter_in_five_seconds(referee: PlaceReferee) -> None:
    assert len(referee.loose) > 30
    assert referee.moved(5.0) == {}


def test_the_referee_notices_what_is_planted(kitchen: World) -> None:
    def moved(id: str, by: tuple[float, float, float]) -> World:
        bodies = []
        for body in kitchen.bodies:
            x, y, z = body.pose.position
            pose = msgspec.structs.replace(body.pose, position=(x + by[0], y + by[1], z + by[2]))
            bodies.append(msgspec.structs.replace(body, pose=pose) if body.id == id else body)
        return msgspec.structs.replace(kitchen, bodies=tuple(bodies))

    counter_top = next(body for body in kitchen.bodies if body.id.startswith("counter_top"))
    top = counter_top.pose.position[2] + (counter_top.size or (0.0,) * 3)[2] / 2
    loose = (body for body in kitchen.bodies if body.physics.is_dynamic and body.size)
    thing = next(each.id for each in loose if abs(each.pose.position[2] - (each.size or (0,) * 3)[2] / 2 - top) < 1e-4)
    lifted = referee_of(moved(thing, (0.0, 0.0, 0.05)))
    assert thing in lifted.moved(0.5)
    assert any(counter_top.id in pair for pair in overlapping_boxes(moved(counter_top.id, (0.0, 0.0, -0.01))))
    slide = next(joint for joint in kitchen.joints if joint.linear.x == 1)
    lamp = next(body for body in kitchen.bodies if body.id.startswith("ceiling_light"))
    turn = 2 * np.arctan2(slide.pose.quaternion[3], slide.pose.quaternion[0])
    before_it = np.array(slide.pose.position) + 0.3 * np.array([np.cos(turn), np.sin(turn), 0.0])
    x, y, z = before_it - lamp.pose.position
    in_the_way = referee_of(moved(lamp.id, (x, y, z)))
    assert any(slide.child in pair for pair in in_the_way.hit_while_opening())


@pytest.mark.parametrize("style", HomeStyle)
def test_every_style_has_a_home_of_250_to_5000_bodies(style: HomeStyle) -> None:
    for seed in range(3):
        world = generate_home(seed=seed, style=style)
        assert 250 <= len(world.bodies) <= 5000
        assert len({body.id for body in world.bodies} | {joint.id for joint in world.joints}) == len(
            world.bodies
        ) + len(world.joints)


def test_all_kinds_of_fronts_occur() -> None:
    axes = {
        axis
        for style in HomeStyle
        for seed in range(4)
        for joint in generate_home(seed=seed, style=style, clutter=0).joints
        for axis in ("x", "y", "swing1", "swing2")
        for limits in (joint.linear if len(axis) == 1 else joint.angular,)
        if getattr(limits, axis) == 1
        for axis in (f"{axis}{'+' if getattr(limits, f'{axis}_middle') > 0 else '-'}",)
    }
    assert axes == {"x+", "y+", "y-", "swing1+", "swing1-", "swing2+", "swing2-"}


@pytest.mark.parametrize("part", HomePart)
def test_parts_can_be_left_out(part: HomePart) -> None:
    full, reduced = (generate_home(seed=5, style="flat", without=parts) for parts in ((), (part,)))
    assert len(reduced.bodies) < len(full.bodies)
    if part is HomePart.DOORS:
        assert reduced.joints == ()
    if part is HomePart.HANDLES:
        assert not [body for body in reduced.bodies if "handle" in body.id or "knob" in body.id]
    if part is HomePart.THINGS:
        assert len(reduced.bodies) < 0.7 * len(full.bodies)


def test_options_change_the_home() -> None:
    assert len(generate_home(style="flat", rooms=8).bodies) > len(generate_home(style="flat", rooms=2).bodies)
    assert len(generate_home(clutter=2).bodies) > len(generate_home(clutter=0.15).bodies)
    assert generate_home(seed=1) != generate_home(seed=2)


def test_the_file_is_the_same_in_every_process(tmp_path: Path) -> None:
    text = write_map(generate_home(seed=7))
    program = (
        "import sys; from hashlib import sha256; from mindstage.homes import generate_home\n"
        "from mindstage.maps import write_map\n"
        "print(sha256(write_map(generate_home(seed=7)).encode()).hexdigest())"
    )
    for hash_seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
        result = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
        )
        assert result.stdout.strip() == sha256(text.encode()).hexdigest()
    assert "generatorVersion" in text


def test_the_verb_writes_a_map_that_is_read_back(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "home.owl"
    result = run("generate", "home", "--seed", "7", "-o", out, "--json")
    assert result.exit_code == 0, result.stderr
    knowledge = ms.KnowledgeBase()
    knowledge.load(out)
    read = knowledge.world()
    assert len(read.bodies) == json_output(result)["bodies"]
    assert ms.diff(generate_home(seed=7), read).identical()


@pytest.mark.parametrize(
    "arguments", [{"style": "castle"}, {"seed": -1}, {"clutter": 9.0}, {"rooms": 0}, {"without": ["roof"]}]
)
def test_what_is_unknown_or_beyond_its_range_is_refused(arguments: dict[str, object]) -> None:
    with pytest.raises(InvalidArgumentError):
        generate_home(**arguments)  # type: ignore[arg-type]
