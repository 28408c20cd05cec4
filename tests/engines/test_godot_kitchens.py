"""Whole kitchens of forms in Godot: they come back, stand still, and their doors open as they do in MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from mindstage.engines import Engine, GodotEngine, MujocoEngine, SpawnReport
from mindstage.geometry import fit_geometry
from mindstage.knowledge import KnowledgeBase, bundled_kitchen
from mindstage.knowledge.io.files import BUNDLED_KITCHEN
from mindstage.scene import AxisMotion, BodyId, GeometryMap, Joint, World, diff
from mindstage.scene.transforms import normalize, pose_inverse, quat_angle, quat_rotate
from tests.cli.conftest import run  # noqa: F401 - a fixture
from tests.cli.runner import Run, json_output
from tests.engines.contract import current_pose

SAME_M, SAME_RAD = 0.002, np.radians(0.5)
SAMPLES = ("iai-kitchen-original", "iai-kitchen-spawned", "ameva-task-two", "knowrob1-ccrl", "soma-iai-room")


@pytest.fixture(scope="module")
def running(godot: Path) -> Iterator[GodotEngine]:
    with closing(GodotEngine(godot, timeout_s=60.0)) as engine:
        yield engine


@pytest.fixture
def engine(running: GodotEngine) -> Iterator[GodotEngine]:
    yield running
    running.clear()


class Kitchen(NamedTuple):
    """A map, and what its bodies are made of."""

    world: World
    forms: GeometryMap

    def spawn(self, engine: Engine) -> SpawnReport:
        """As a stage does."""
        return engine.spawn(self.world, geometry=self.forms)


def read(path: Path) -> Kitchen:
    with KnowledgeBase() as knowledge:
        knowledge.load([path])
        world = knowledge.world()
        return Kitchen(world, fit_geometry(world, knowledge).geometry)


@pytest.fixture(scope="module")
def bundled() -> Kitchen:
    return read(bundled_kitchen())


@pytest.mark.parametrize("name", SAMPLES)
def test_a_map_of_any_dialect_comes_back_with_every_fact_and_tag(
    name: str, engine: GodotEngine, shared_data: Path
) -> None:
    kitchen = read(shared_data / "maps" / f"{name}.owl")
    assert kitchen.spawn(engine).ok
    assert diff(kitchen.world, engine.snapshot()).identical(0.0)


def test_the_bundled_kitchen_comes_back_and_stays_as_it_is_when_left_alone(
    engine: GodotEngine, bundled: Kitchen
) -> None:
    assert bundled.spawn(engine).ok
    assert diff(bundled.world, engine.snapshot()).identical(0.0)
    ids, before = engine.poses()
    engine.step(10.0)
    after = engine.poses()[1]
    moved = np.linalg.norm(after[:, :3] - before[:, :3], axis=1)
    assert moved.max() < 0.001, ids[int(moved.argmax())]
    logged = engine.snapshot()
    assert diff(bundled.world, logged).lost == ()
    assert logged.joints == bundled.world.joints


def test_check_finds_nothing_lost_in_godot(run: Run, godot: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    monkeypatch.setenv("GODOT", str(godot))
    result = run("check", BUNDLED_KITCHEN, "--engine", "godot", "--json")
    assert result.exit_code == 0
    found = json_output(result)
    assert (found["engine"], found["identical"], found["lost_facts"]) == ("godot", True, 0)
    assert found["spawn"]["ok"]


def test_a_map_becomes_a_scene_of_godots(
    run: Run,  # noqa: F811
    godot: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("GODOT", str(godot))
    out = tmp_path / "kitchen.tscn"
    result = run("convert", BUNDLED_KITCHEN, out, "--json")
    assert result.exit_code == 0
    assert json_output(result)["format"] == "tscn"
    scene = out.read_text(encoding="utf-8")
    assert scene.startswith("[gd_scene")
    assert scene.count("[node ") > 120
    assert "fridge" in scene


def test_without_godot_there_is_no_scene_and_it_is_said_how_to_get_one(
    run: Run,  # noqa: F811
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("GODOT", str(tmp_path / "nowhere"))
    result = run("convert", BUNDLED_KITCHEN, tmp_path / "kitchen.tscn", "--json")
    assert result.exit_code == 2
    assert json_output(result)["error"]["kind"] == "EngineUnavailable"
    assert "install Godot" in json_output(result)["error"]["message"]
    assert not (tmp_path / "kitchen.tscn").exists()


# -- doors and drawers -------------------------------------------------------------------------------------------------


def handle_of(kitchen: World, moving: BodyId) -> BodyId:
    """The handle on a door or drawer, or that itself."""
    classes = {body.id: body.cls for body in kitchen.bodies}
    waiting = [moving]
    while waiting:
        part = waiting.pop()
        if "Handle" in classes[part] or "handle" in part:
            return part
        waiting += [each.child for each in kitchen.attachments if each.parent == part]
    return moving


def opened(engine: Engine, constraint: Joint, handle: BodyId, way: int) -> float:
    """How far a joint gets when its handle is pulled for three seconds [m or rad]."""
    slides = constraint.linear.x is not AxisMotion.LOCKED
    axis = (
        (1.0, 0, 0) if slides else ((0, 0, 1.0) if constraint.angular.swing1 is not AxisMotion.LOCKED else (0, 1.0, 0))
    )
    direction = quat_rotate(normalize(constraint.pose.quaternion), axis)
    start = current_pose(engine, handle)
    for _ in range(30):
        place = current_pose(engine, handle)[:3]
        force = direction if slides else np.cross(direction, place - constraint.pose.position)
        engine.apply_force(handle, tuple((way * 35.0 * force / np.linalg.norm(force)).tolist()), tuple(place.tolist()))
        engine.step(0.1)
    end = current_pose(engine, handle)
    if slides:
        return float(np.linalg.norm(end[:3] - start[:3]))
    return float(quat_angle(start[3:], end[3:]))


def doors_and_drawers(kitchen: World, engine: Engine) -> Iterator[tuple[Joint, BodyId]]:
    """Each constraint that can move, and the handle on what moves."""
    movable = engine.joint_positions()
    moves = {body.id for body in kitchen.bodies if body.physics.is_dynamic}
    for constraint in kitchen.joints:
        if constraint.id in movable:
            yield constraint, handle_of(kitchen, next(e for e in (constraint.child, constraint.parent) if e in moves))


def limit_of(constraint: Joint) -> float:
    angular = constraint.angular
    return constraint.linear.limit or max(angular.swing1_limit, angular.swing2_limit)


def opened_either_way(engine: Engine, kitchen: Kitchen, constraint: Joint, handle: BodyId) -> float:
    """How far it gets the way that is not into the furniture."""
    reached = []
    for way in (1, -1):
        engine.clear()
        kitchen.spawn(engine)
        reached.append(opened(engine, constraint, handle, way))
        if abs(reached[-1] - limit_of(constraint)) < SAME_RAD:
            break
    return max(reached)


def test_the_fridge_opens_by_its_handle_as_far_as_in_mujoco(engine: GodotEngine, bundled: Kitchen) -> None:
    mujoco = MujocoEngine()
    for each in (engine, mujoco):
        bundled.spawn(each)
    joints = dict(doors_and_drawers(bundled.world, engine))
    assert joints == dict(doors_and_drawers(bundled.world, mujoco))
    hinge = next(constraint for constraint in joints if constraint.child == "fridge_door")
    angles = [opened_either_way(each, bundled, hinge, joints[hinge]) for each in (engine, mujoco)]
    assert min(angles) == pytest.approx(limit_of(hinge), abs=SAME_RAD)
    assert angles[0] == pytest.approx(angles[1], abs=SAME_RAD)


def test_doors_and_drawers_open_to_their_limits_by_their_handles(engine: GodotEngine, bundled: Kitchen) -> None:
    bundled.spawn(engine)
    tried = 0
    for constraint, handle in list(doors_and_drawers(bundled.world, engine))[::5]:
        slides = constraint.linear.x is not AxisMotion.LOCKED
        reached = opened_either_way(engine, bundled, constraint, handle)
        assert reached == pytest.approx(limit_of(constraint), abs=SAME_M if slides else SAME_RAD), constraint.id
        tried += 1
    assert tried >= 4


@pytest.mark.parametrize(
    ("moving", "holder", "inside"),
    [("fridge_door", "fridge", "milk_carton_1"), ("drawer_left_1", "drawer_left_1", "table_fork_1")],
)
def test_what_is_inside_stays_inside_while_it_is_opened(
    moving: str, holder: str, inside: str, engine: GodotEngine, bundled: Kitchen
) -> None:
    bundled.spawn(engine)
    joints = doors_and_drawers(bundled.world, engine)
    constraint, handle = next(each for each in joints if moving in (each[0].parent, each[0].child))
    assert opened_either_way(engine, bundled, constraint, handle) > 0.4
    room, thing = current_pose(engine, holder), current_pose(engine, inside)
    away = quat_rotate(pose_inverse(room)[3:], thing[:3] - room[:3])
    size = bundled.world.body(BodyId(holder)).size
    assert size is not None
    assert (np.abs(away) < np.array(size) / 2).all()
