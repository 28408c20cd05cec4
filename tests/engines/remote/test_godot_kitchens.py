"""Whole kitchens with geometry in Godot: no loss, at rest, and doors that open as in MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from mindstage.engines import Engine, SpawnReport
from mindstage.engines.mujoco import MujocoEngine
from mindstage.engines.remote.godot import GodotEngine
from mindstage.geometry import fit_geometry
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.maps.io.files import BUNDLED_KITCHEN
from mindstage.scene import AxisMotion, BodyId, GeometryMap, Joint, World, diff
from mindstage.scene.edits import Spawn
from mindstage.scene.joint_kinematics import joint_reach
from mindstage.scene.transforms import normalize, pose_inverse, quat_angle, quat_rotate
from tests.cli.conftest import run  # noqa: F401 - a fixture
from tests.cli.runner import Run, json_output
from tests.engines.contract import current_pose

SAME_M, SAME_RAD = 0.002, np.radians(0.5)
SAMPLES = ("iai-kitchen-original", "iai-kitchen-spawned", "ameva-task-two", "knowrob1-ccrl", "soma-iai-room")


class Kitchen(NamedTuple):
    """A map with the geometry of its bodies."""

    world: World
    geometry: GeometryMap

    def spawn(self, engine: Engine) -> SpawnReport:
        """Spawns it like a simulation."""
        return engine.apply(Spawn(self.world, geometry=self.geometry)).report


def read(path: Path) -> Kitchen:
    with KnowledgeBase() as knowledge:
        knowledge.load([path])
        world = knowledge.world()
        return Kitchen(world, fit_geometry(world, knowledge).geometry)


@pytest.fixture(scope="module")
def bundled() -> Kitchen:
    return read(bundled_kitchen())


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name == "ameva-task-two" else pytest.mark.slow) for name in SAMPLES]
)
def test_maps_of_all_dialects_are_returned_with_all_facts_and_tags(
    name: str, engine: GodotEngine, shared_data: Path
) -> None:
    kitchen = read(shared_data / "maps" / f"{name}.owl")
    assert kitchen.spawn(engine).ok
    assert diff(kitchen.world, engine.snapshot()).identical(0.0)


def test_the_bundled_kitchen_is_returned_unchanged_and_stays_at_rest(engine: GodotEngine, bundled: Kitchen) -> None:
    assert bundled.spawn(engine).ok
    assert diff(bundled.world, engine.snapshot()).identical(0.0)
    ids, before = engine.poses()
    engine.step(10.0)
    after = engine.poses()[1]
    moved = np.linalg.norm(after[:, :3] - before[:, :3], axis=1)
    assert moved.max() < 0.001, ids[int(moved.argmax())]
    snapshot = engine.snapshot()
    assert diff(bundled.world, snapshot).lost == ()
    assert snapshot.joints == bundled.world.joints


def test_check_finds_nothing_lost_in_godot(run: Run, godot: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    monkeypatch.setenv("GODOT", str(godot))
    result = run("check", BUNDLED_KITCHEN, "--engine", "godot", "--json")
    assert result.exit_code == 0
    found = json_output(result)
    assert (found["engine"], found["identical"], found["lost_facts"]) == ("godot", True, 0)
    assert found["spawn"]["ok"]


def test_a_map_is_exported_as_a_godot_scene(
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


def test_exporting_a_scene_without_godot_gives_installation_help(
    run: Run,  # noqa: F811
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("GODOT", str(tmp_path / "nowhere"))
    result = run("convert", BUNDLED_KITCHEN, tmp_path / "kitchen.tscn", "--json")
    assert result.exit_code == 2
    assert json_output(result)["error"]["code"] == "EngineUnavailableError"
    assert "install Godot" in json_output(result)["error"]["message"]
    assert not (tmp_path / "kitchen.tscn").exists()


# -- doors and drawers -------------------------------------------------------------------------------------------------


def handle_of(kitchen: World, moving: BodyId) -> BodyId:
    """The handle of a door or drawer, or the body itself."""
    classes = {body.id: body.cls for body in kitchen.bodies}
    stack = [moving]
    while stack:
        part = stack.pop()
        if "Handle" in classes[part] or "handle" in part:
            return part
        stack += [each.child for each in kitchen.attachments if each.parent == part]
    return moving


def opened(engine: Engine, joint: Joint, handle: BodyId, sign: int) -> float:
    """The displacement of a joint when its handle is pulled for three seconds [m or rad]."""
    slides = joint.linear.x is not AxisMotion.LOCKED
    axis = (1.0, 0, 0) if slides else ((0, 0, 1.0) if joint.angular.swing1 is not AxisMotion.LOCKED else (0, 1.0, 0))
    direction = quat_rotate(normalize(joint.pose.quaternion), axis)
    start = current_pose(engine, handle)
    for _ in range(30):
        pose = current_pose(engine, handle)[:3]
        force = direction if slides else np.cross(direction, pose - joint.pose.position)
        engine.apply_force(handle, tuple((sign * 35.0 * force / np.linalg.norm(force)).tolist()), tuple(pose.tolist()))
        engine.step(0.1)
    end = current_pose(engine, handle)
    if slides:
        return float(np.linalg.norm(end[:3] - start[:3]))
    return float(quat_angle(start[3:], end[3:]))


def doors_and_drawers(kitchen: World, engine: Engine) -> Iterator[tuple[Joint, BodyId]]:
    """Each movable joint, with the handle of the body that it moves."""
    movable = engine.joint_positions()
    moves = {body.id for body in kitchen.bodies if body.physics.is_dynamic}
    for joint in kitchen.joints:
        if joint.id in movable:
            yield joint, handle_of(kitchen, next(e for e in (joint.child, joint.parent) if e in moves))


def limit_of(joint: Joint) -> float:
    """The displacement of the fully open position."""
    return max(reach or 0.0 for reach in joint_reach(joint))


def opened_either_way(engine: Engine, kitchen: Kitchen, joint: Joint, handle: BodyId) -> float:
    """The displacement in the direction away from the furniture."""
    displacement = []
    for sign in (1, -1):
        engine.clear()
        kitchen.spawn(engine)
        displacement.append(opened(engine, joint, handle, sign))
        if abs(displacement[-1] - limit_of(joint)) < SAME_RAD:
            break
    return max(displacement)


def test_the_fridge_opens_by_its_handle_as_far_as_in_mujoco(engine: GodotEngine, bundled: Kitchen) -> None:
    mujoco = MujocoEngine()
    for each in (engine, mujoco):
        bundled.spawn(each)
    joints = dict(doors_and_drawers(bundled.world, engine))
    assert joints == dict(doors_and_drawers(bundled.world, mujoco))
    hinge = next(joint for joint in joints if joint.child == "fridge_door")
    angles = [opened_either_way(each, bundled, hinge, joints[hinge]) for each in (engine, mujoco)]
    assert min(angles) == pytest.approx(limit_of(hinge), abs=SAME_RAD)
    assert angles[0] == pytest.approx(angles[1], abs=SAME_RAD)


@pytest.mark.slow
def test_doors_and_drawers_open_to_their_limits_by_their_handles(engine: GodotEngine, bundled: Kitchen) -> None:
    bundled.spawn(engine)
    tested = 0
    for joint, handle in list(doors_and_drawers(bundled.world, engine))[::5]:
        slides = joint.linear.x is not AxisMotion.LOCKED
        displacement = opened_either_way(engine, bundled, joint, handle)
        assert displacement == pytest.approx(limit_of(joint), abs=SAME_M if slides else SAME_RAD), joint.id
        tested += 1
    assert tested >= 4


@pytest.mark.parametrize(
    ("moving", "holder", "inside"),
    [("fridge_door", "fridge", "milk_carton_1"), ("drawer_left_1", "drawer_left_1", "table_fork_1")],
)
def test_contents_stay_inside_while_furniture_is_opened(
    moving: str, holder: str, inside: str, engine: GodotEngine, bundled: Kitchen
) -> None:
    bundled.spawn(engine)
    joints = doors_and_drawers(bundled.world, engine)
    joint, handle = next(each for each in joints if moving in (each[0].parent, each[0].child))
    assert opened_either_way(engine, bundled, joint, handle) > 0.4
    free_space, item = current_pose(engine, holder), current_pose(engine, inside)
    away = quat_rotate(pose_inverse(free_space)[3:], item[:3] - free_space[:3])
    size = bundled.world.body(BodyId(holder)).size
    assert size is not None
    assert (np.abs(away) < np.array(size) / 2).all()
