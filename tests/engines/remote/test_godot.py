"""GodotEngine beyond the contract: visual meshes, scene files, and Godot at another rosbridge server."""

from __future__ import annotations

import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mindstage.assets.cache import geometry_cache_dir
from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.engines.remote import RemoteEngine, connect
from mindstage.engines.remote.compiled import CompiledRemoteEngine
from mindstage.engines.remote.godot import GodotEngine
from mindstage.engines.remote.godot_process import GodotProcess, find_godot, prepare_project
from mindstage.errors import EngineUnavailableError, WorldError
from mindstage.geometry import build_geometry, template_by_name
from mindstage.scene import BodyGeometry, BodyId, CollisionShape, PbrMaterial, Pose, VisualMesh, diff
from mindstage.scene.edits import SetPoses, Spawn
from tests.engines.contract import current_pose
from tests.engines.geometries import bin_geometry
from tests.engines.scenes import FLOOR, body, room, world

TURNED = (0.9659258262890683, 0.0, 0.0, 0.25881904510252074)
MUG = BodyId("mug")
SKIN = VisualMesh(
    points=np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3]]),
    faces=np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], dtype=np.uint32),
    material=PbrMaterial(color=(1.0, 0.0, 0.0)),
)
FORM = BodyGeometry(
    key="feedfacecafebeef",
    visuals=(SKIN,),
    collision_shapes=(CollisionShape(size=(0.1, 0.2, 0.3)),),
    shape_name="wedge",
)


def test_an_asymmetric_pose_survives_the_axis_conversion(engine: GodotEngine) -> None:
    box = body("box", (1, 2, 3), (0.1, 0.2, 0.3), "dynamic", 1.0, quaternion=TURNED, gravity=False)
    engine.apply(Spawn(world(FLOOR, box)))
    engine.apply_force(BodyId("box"), (0.0, 0.0, 1e-9))  # so that the pose is computed by Godot
    engine.step(0.1)
    _, poses = engine.poses()
    np.testing.assert_allclose(poses[1], (1, 2, 3, *TURNED), atol=3 * engine.precision)


def test_visual_meshes_are_loaded_from_the_cache(engine: GodotEngine, tmp_path: Path) -> None:
    report = engine.apply(Spawn(world(FLOOR, body("mug", (0, 0, 1), (0.1, 0.2, 0.3))), geometry={MUG: FORM})).report
    assert report.ok
    assert not [note for note in report.notes if "mesh" in note.text]
    assert (geometry_cache_dir() / f"{FORM.key}.glb").is_file()
    engine.save_scene(tmp_path / "wedge.tscn")
    scene = (tmp_path / "wedge.tscn").read_text(encoding="utf-8")
    assert scene.count('mesh = SubResource("ArrayMesh') == 1  # the mug; the floor is a box


def test_textures_are_shared_files_that_materials_name(engine: GodotEngine, tmp_path: Path) -> None:
    oak = PbrMaterial(name="wood", color=(0.7, 0.5, 0.3), texture="oak_board")
    boards = [
        build_geometry(template_by_name("panel"), size, materials={"body": oak})
        for size in ((0.1, 0.2, 0.03), (0.2, 0.4, 0.03))
    ]
    bodies = [body(name, (0, place, 1), (0.1, 0.2, 0.03)) for place, name in enumerate(("one", "other"))]
    report = engine.apply(
        Spawn(world(FLOOR, *bodies), geometry={each.id: board for each, board in zip(bodies, boards, strict=True)})
    ).report
    assert report.ok
    engine.save_scene(tmp_path / "boards.tscn")
    scene = (tmp_path / "boards.tscn").read_text(encoding="utf-8")
    assert scene.count('type="PortableCompressedTexture2D"') == 3, "color, roughness and normal, once for both"
    assert scene.count("albedo_texture = ") == scene.count("normal_texture = ") == 2
    assert scene.count("roughness_texture_channel = 1") == 2
    assert {path.name for path in geometry_cache_dir().glob("oak_board-*.jpg")} == {
        f"oak_board-{map}.jpg" for map in ("color", "roughness", "normal")
    }


def test_a_broken_mesh_is_reported_and_replaced_by_collision_shapes(engine: GodotEngine) -> None:
    broken = replace(FORM, key="00000000deadbeef")
    (geometry_cache_dir() / f"{broken.key}.glb").write_bytes(b"glTF, or so it says")
    report = engine.apply(Spawn(world(FLOOR, body("mug", (0, 0, 1), (0.1, 0.2, 0.3))), geometry={MUG: broken})).report
    assert report.ok
    assert [note.ids for note in report.notes if broken.key in note.text or "mug" in note.ids] == [("mug",)]


def test_a_scene_cannot_be_saved_in_a_missing_folder(engine: GodotEngine, tmp_path: Path) -> None:
    with pytest.raises(WorldError):
        engine.save_scene(tmp_path / "no" / "such" / "folder" / "scene.tscn")


def test_a_screenshot_without_a_window_is_an_error(engine: GodotEngine, tmp_path: Path) -> None:
    with pytest.raises(WorldError, match="window"):
        engine.screenshot(tmp_path / "picture.png", eye=(3, 3, 3), target=(0, 0, 0))
    assert not (tmp_path / "picture.png").exists()


def test_a_godot_at_another_bridge_is_controlled_as_a_remote_engine(godot: Path) -> None:
    with LocalNode() as hub, RosbridgeServer(hub, port=0, token="secret") as server:
        found = find_godot(godot)
        process = GodotProcess(
            found,
            prepare_project(found),
            url=server.url,
            token="secret",
            namespace="lab/place",
            mesh_dir=geometry_cache_dir(),
        )
        try:
            engine = _connect_when_ready(f"ros://127.0.0.1:{server.port}/lab/place?token=secret", process)
            with closing(engine):
                assert isinstance(engine, CompiledRemoteEngine)
                assert engine.apply(Spawn(room())).report.ok
                engine.apply(SetPoses({BodyId("drawer"): Pose((0.2, 0, 0.3))}))
                assert diff(room(), engine.snapshot()).lost == ()
            assert process.is_running  # this process belongs to another server
        finally:
            process.terminate()
        assert not process.is_running


def _connect_when_ready(address: str, process: GodotProcess) -> RemoteEngine:
    """The engine, after Godot has connected."""
    deadline_s = time.monotonic() + 60.0
    while True:
        try:
            return connect(address)
        except EngineUnavailableError:
            if time.monotonic() > deadline_s or not process.is_running:
                raise
            time.sleep(0.1)


def test_thin_bodies_rest_on_each_other_and_thin_walls_stand_still(engine: GodotEngine) -> None:
    size, thin = (0.08, 0.08, 0.1), (0.2, 0.2, 0.003)
    shelf = body("shelf", (0, 0, 0.5), (1.5, 1.5, 0.003))
    cups = [body("standing", (1, 0, 0.05), size, "dynamic", 0.3), body("falling", (0, 0, 3.0), size, "dynamic", 0.3)]
    tray = body("tray", (0.4, 0.4, 4.0), thin, "dynamic", 0.3)
    cup = bin_geometry(size, wall=0.003)
    assert engine.apply(Spawn(world(FLOOR, shelf, *cups, tray), geometry={each.id: cup for each in cups})).report.ok
    engine.step(5.0)
    assert current_pose(engine, "standing") == pytest.approx((1, 0, 0.05, 1, 0, 0, 0), abs=1e-4)
    for moved_down in ("falling", "tray"):
        assert current_pose(engine, moved_down)[2] > 0.5
