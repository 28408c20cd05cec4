"""Export to MJCF: the file has the same poses and joints, and simulates like the engine."""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from msgspec.structs import replace

from mindstage.engines.mujoco import MujocoEngine, world_to_mjcf
from mindstage.engines.mujoco.mjcf_reading import read_mjcf
from mindstage.errors import MapWriteError
from mindstage.scene import (
    AngularLimits,
    Attachment,
    AxisMotion,
    Body,
    BodyGeometry,
    BodyId,
    BodyPhysics,
    CollisionShapeType,
    Iri,
    Joint,
    Light,
    LightType,
    LinearLimits,
    Material,
    Mobility,
    PbrMaterial,
    Pose,
    Vector,
    VisualMesh,
    World,
)
from mindstage.scene.edits import Spawn
from mindstage.scene.transforms import normalize, pose_array, quat_angle
from tests.engines.geometries import bin_geometry, single_shape_geometry, wedge_geometry
from tests.kitchenette import kitchenette
from tests.worlds import worlds

M = "http://example.org/m.owl#"
TETRAHEDRON = "v 1 0 0\nv 2 0 0\nv 1 2 0\nv 1 0 3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
"""One unit wide, two deep, three high, and away from the origin."""


def item(id: str, *, at: Vector = (0.0, 0.0, 0.0), dynamic: bool = False, **more: object) -> Body:
    physics = BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=2.0) if dynamic else BodyPhysics(mobility=Mobility.STATIC)
    made = Body(id=BodyId(id), iri=Iri(M + id), cls=Iri(M + "Thing"), pose=Pose(at), size=(0.2, 0.3, 0.4))
    return replace(made, physics=physics, **more)


def world_of(*bodies: Body, **more: object) -> World:
    return replace(World(iri=Iri(M + "map"), name="map", bodies=bodies), **more)


def joint(linear: LinearLimits, angular: AngularLimits, *, at: tuple[float, float, float] = (0.5, 0.0, 0.0)) -> Joint:
    return Joint(
        id=BodyId("joint"),
        iri=Iri(M + "joint"),
        parent=BodyId("base"),
        child=BodyId("arm"),
        pose=Pose((0.5, 0.0, 0.0)),
        linear=linear,
        angular=angular,
    )


def loaded(world: World) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(world_to_mjcf(world).text)


def poses_of(model: mujoco.MjModel, names: list[str]) -> np.ndarray:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    numbers = [model.body(name).id for name in names]
    return np.concatenate([data.xpos[numbers], data.xquat[numbers]], axis=1)


def test_every_body_keeps_its_pose() -> None:
    world = kitchenette()
    found = poses_of(loaded(world), [body.id for body in world.bodies])
    described = pose_array(body.pose for body in world.bodies)
    np.testing.assert_allclose(found[:, :3], described[:, :3], atol=1e-12)
    assert quat_angle(found[:, 3:], normalize(described[:, 3:])).max() < 1e-12


@settings(max_examples=15, suppress_health_check=[HealthCheck.too_slow])
@given(world=worlds())
def test_any_world_that_can_be_spawned_can_be_loaded(world: World) -> None:
    engine = MujocoEngine()
    report = engine.apply(Spawn(world)).report
    spawned, _ = engine.poses()
    engine.close()
    written = world_to_mjcf(world)
    model = mujoco.MjModel.from_xml_string(written.text)
    assert {model.body(number).name for number in range(model.nbody)} >= {id for id in spawned if id != "world"}
    failures = (*report.failed_bodies, *report.failed_joints, *report.failed_attachments)
    assert all(any(failure.id in note for note in written.notes) for failure in failures)


def test_a_joint_has_its_name_its_axis_and_its_range() -> None:
    slide = LinearLimits(x=AxisMotion.LIMITED, limit=0.2, x_middle=0.2)
    rotated_pose = Pose((0.5, 0.0, 0.0), (0.5**0.5, 0.0, 0.0, 0.5**0.5))
    drawer = replace(joint(slide, AngularLimits()), pose=rotated_pose)
    model = loaded(world_of(item("base"), item("arm", at=(1.0, 0.0, 0.0), dynamic=True), joints=(drawer,)))
    found = model.joint("joint")
    assert found.type == mujoco.mjtJoint.mjJNT_SLIDE
    np.testing.assert_allclose(found.axis, (0.0, 1.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(found.range, (0.0, 0.4), atol=1e-12)


def test_each_axis_of_a_joint_has_a_name() -> None:
    angular = AngularLimits(swing1=AxisMotion.LIMITED, swing1_limit=0.5, twist=AxisMotion.FREE)
    door = joint(LinearLimits(z=AxisMotion.LIMITED, limit=0.1), angular)
    model = loaded(world_of(item("base"), item("arm", dynamic=True), joints=(door,)))
    assert {model.joint(number).name for number in range(model.njnt)} == {"joint:z", "joint:swing1", "joint:twist"}


def test_the_exported_model_moves_like_the_engine() -> None:
    """A door swings down and a box falls onto the floor."""
    door = joint(LinearLimits(), AngularLimits(swing2=AxisMotion.LIMITED, swing2_limit=1.2))
    world = world_of(
        item("floor", at=(0.0, 0.0, -1.1), size=(9.0, 9.0, 0.2)),
        item("base", at=(0.2, 0.0, 0.0)),
        item("arm", at=(1.0, 0.0, 0.0), dynamic=True),
        item("box", at=(-2.0, 0.0, 0.5), dynamic=True),
        joints=(door,),
    )
    names = [body.id for body in world.bodies]
    engine = MujocoEngine()
    engine.apply(Spawn(world))
    engine.apply_force(BodyId("arm"), (0.0, 0.0, -4000.0))
    engine.step(0.002)
    engine.step(0.998)
    _, in_engine = engine.poses()
    engine.close()
    model = loaded(world)
    data = mujoco.MjData(model)
    data.xfrc_applied[model.body("arm").id, 2] = -4000.0
    mujoco.mj_step(model, data)
    data.xfrc_applied[:] = 0.0
    mujoco.mj_step(model, data, nstep=499)
    mujoco.mj_kinematics(model, data)
    in_file = np.array([data.xpos[model.body(name).id] for name in names])
    np.testing.assert_allclose(in_file, in_engine[:, :3], atol=2e-3)  # bodies at rest fall asleep in the engine
    assert in_engine[3, 2] < -0.7
    assert in_engine[2, 2] < -0.05


def test_the_exported_model_has_the_options_of_the_engine_and_falls_asleep_like_it() -> None:
    world = kitchenette()
    engine = MujocoEngine()
    engine.apply(Spawn(world))
    engine.step(3.0)
    model, awake = loaded(world), engine.stats().awake
    for name in ("timestep", "integrator", "cone", "impratio", "enableflags", "disableflags", "gravity"):
        np.testing.assert_array_equal(getattr(model.opt, name), getattr(engine.compiled().model.opt, name), name)
    engine.close()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=1500)
    assert (awake, int(np.count_nonzero(data.tree_asleep < 0))) == (0, 0)
    assert model.ntree > 2


def test_an_exported_model_is_read_back(tmp_path: Path) -> None:
    world = kitchenette()
    path = tmp_path / "world.xml"
    path.write_text(world_to_mjcf(world).text, encoding="utf-8")
    read = read_mjcf(path)
    assert {each.name for each in read.bodies} >= {body.id for body in world.bodies}


def test_attached_bodies_are_nested() -> None:
    world = world_of(
        item("cup", dynamic=True),
        item("handle", at=(0.2, 0.0, 0.0)),
        attachments=(Attachment(parent=BodyId("cup"), child=BodyId("handle")),),
    )
    model = loaded(world)
    assert model.body_parentid[model.body("handle").id] == model.body("cup").id


def test_lights_and_colors_are_exported() -> None:
    lamp = Light(id=BodyId("lamp"), iri=Iri(M + "lamp"), type=LightType.SPOT, pose=Pose((0.0, 0.0, 2.0)))
    red = Material(name="red", color=(0.75, 0.25, 0.0))
    model = loaded(world_of(item("cup", materials=(red,)), lights=(lamp,)))
    np.testing.assert_allclose(model.geom_rgba[0], (0.75, 0.25, 0.0, 1.0))
    np.testing.assert_allclose(model.light("lamp").dir, (0.0, 0.0, -1.0), atol=1e-12)


def test_a_mesh_is_referenced_and_scaled_to_its_body(tmp_path: Path) -> None:
    (tmp_path / "t.obj").write_text(TETRAHEDRON, encoding="utf-8")
    world = world_of(item("rock", at=(5.0, 6.0, 7.0), mesh="package://x/t.obj", size=(0.5, 1.0, 1.5)))
    written = world_to_mjcf(world, find_mesh=lambda name: tmp_path / name.removeprefix("package://x/"))
    assert str(tmp_path / "t.obj") in written.text
    model = mujoco.MjModel.from_xml_string(written.text)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    geom = int(np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)[0])
    points = model.mesh_vert @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
    np.testing.assert_allclose(points.min(axis=0), (5.5, 6.0, 7.0), atol=1e-6)
    np.testing.assert_allclose(points.max(axis=0), (6.0, 7.0, 8.5), atol=1e-6)
    assert not model.geom_contype[geom]


def test_an_unreadable_mesh_is_reported(tmp_path: Path) -> None:
    (tmp_path / "t.obj").write_text("v 1 2 3\n", encoding="utf-8")
    written = world_to_mjcf(world_of(item("rock", mesh="t.obj")), find_mesh=lambda name: tmp_path / name)
    assert any("t.obj" in note for note in written.notes)
    mujoco.MjModel.from_xml_string(written.text)


def test_names_that_mujoco_or_xml_forbid_are_changed_and_reported() -> None:
    written = world_to_mjcf(world_of(item("world"), item("a\x01b"), item("ab"), item('"<&>')))
    model = mujoco.MjModel.from_xml_string(written.text)
    names = {model.body(number).name for number in range(model.nbody)}
    assert names == {"world", "world-2", "ab", "ab-2", '"<&>'}
    assert len([note for note in written.notes if "is named" in note]) == 3


def test_the_class_of_each_body_is_a_custom_text() -> None:
    texts = ElementTree.fromstring(world_to_mjcf(world_of(item("cup"))).text).iter("text")
    assert {text.get("name"): text.get("data") for text in texts} == {"map": M + "map", "class of cup": M + "Thing"}


def test_a_chain_that_is_too_long_is_refused() -> None:
    links = [item(f"link{number}", at=(float(number), 0.0, 0.0), dynamic=True) for number in range(450)]
    pairs = [Attachment(parent=a.id, child=b.id) for a, b in pairwise(links)]
    with pytest.raises(MapWriteError, match="bodies are nested"):
        world_to_mjcf(world_of(*links, attachments=tuple(pairs)))
    assert mujoco.MjModel.from_xml_string(world_to_mjcf(world_of(*links[:390], attachments=tuple(pairs[:389]))).text)


def test_geometry_is_exported_and_simulates_the_same() -> None:
    """A ball rolls down a hull onto the floor of a bouncy crate, in the engine and from the file, step by step."""
    geometry = {
        BodyId("ramp"): wedge_geometry((0.6, 0.4, 0.3), friction=0.3),
        BodyId("crate"): bin_geometry((0.5, 0.5, 0.2), restitution=0.6),
        BodyId("ball"): single_shape_geometry(CollisionShapeType.SPHERE, (0.1, 0.1, 0.1)),
        BodyId("arm"): wedge_geometry((0.3, 0.2, 0.1)),
    }
    world = world_of(
        replace(item("ramp", at=(0.0, 0.0, 0.4)), size=(0.6, 0.4, 0.3)),
        replace(item("crate", at=(-0.5, 0.0, 0.1)), size=(0.5, 0.5, 0.2)),
        replace(item("ball", at=(0.1, 0.0, 0.7), dynamic=True), size=(0.1, 0.1, 0.1)),
        replace(item("arm", at=(-0.5, 0.1, 0.5), dynamic=True), size=(0.3, 0.2, 0.1)),
    )
    model = mujoco.MjModel.from_xml_string(world_to_mjcf(world, geometry=geometry).text)
    data = mujoco.MjData(model)
    engine = MujocoEngine()
    engine.apply(Spawn(world, geometry=geometry))
    rows = [engine.poses()[0].index(BodyId(name)) for name in ("ball", "arm")]
    numbers = [model.body(name).id for name in ("ball", "arm")]
    for _ in range(8):
        engine.step(0.1)
        mujoco.mj_step(model, data, nstep=50)
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(data.xpos[numbers], engine.poses()[1][rows, :3], atol=2e-3)
    assert data.xpos[numbers[0]][0] < -0.2, "the ball did not roll"


def square(size: float, image: np.ndarray | None = None, **material: object) -> VisualMesh:
    """A square and one triangle below it, with texture coordinates."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, -1]], dtype=float) * size
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 4, 1]], dtype=np.uint32)
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.25, 0.125]], dtype=float)
    return VisualMesh(points, faces, PbrMaterial(**material), uv=uv, image=image)  # type: ignore[arg-type]


def with_visuals(*visuals: VisualMesh) -> BodyGeometry:
    geometry = wedge_geometry((0.6, 0.4, 0.3))
    return dataclasses.replace(geometry, key=str([visual.material for visual in visuals]), visuals=visuals)


def test_visual_meshes_and_textures_are_files_that_mujoco_reads() -> None:
    image = np.zeros((8, 4, 4), dtype=np.uint8)
    image[:4] = (255, 0, 0, 255)
    image[4:] = (0, 0, 255, 255)
    oak = square(1.0, name="wood", texture="oak_board", color=(1.0, 0.5, 0.25), opacity=0.9)
    geometry = with_visuals(oak, square(0.5, image, name="paper"))
    shapes = {BodyId(name): geometry for name in ("table", "bench")}
    world = world_of(
        replace(item("table"), size=(0.6, 0.4, 0.3)), replace(item("bench", at=(2.0, 0.0, 0.0)), size=(0.6, 0.4, 0.3))
    )
    written = world_to_mjcf(world, geometry=shapes, visuals_folder="x_assets")
    model = mujoco.MjModel.from_xml_string(written.text, dict(written.files))
    visual = np.flatnonzero(model.geom_group == 1)
    assert model.geom_group.tolist().count(1) == 4
    assert set(model.geom_group[model.geom_contype > 0]) == {3}
    assert not model.geom_contype[visual].any()
    assert len(written.files) == 4, "two meshes and two pictures, shared by both bodies"
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    first = visual[0]
    mesh = model.geom_dataid[first]
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    points = model.mesh_vert[start : start + count] @ data.geom_xmat[first].reshape(3, 3).T + data.geom_xpos[first]
    np.testing.assert_allclose(np.unique(points.round(5), axis=0), np.unique(oak.points, axis=0), atol=1e-5)
    # MuJoCo's pictures begin with the top row, and its texture coordinates at the top.
    coordinates = model.mesh_texcoord[model.mesh_texcoordadr[mesh] : model.mesh_texcoordadr[mesh] + 5]
    assert {tuple(row) for row in coordinates.tolist()} == {(0, 1), (1, 1), (1, 0), (0, 0), (0.25, 0.875)}
    wood, paper = (model.mat(int(model.geom_matid[row])) for row in visual[:2])
    np.testing.assert_allclose(wood.rgba, (1.0, 0.5, 0.25, 0.9), atol=1e-6)
    pixels = model.tex_data[model.tex_adr[model.mat_texid[paper.id][1]] :][: 8 * 4 * 3].reshape(8, 4, 3)
    assert (pixels == image[..., :3]).all()


def test_a_color_of_the_body_replaces_that_of_solid_meshes_without_a_picture() -> None:
    image = np.full((4, 4, 4), 255, dtype=np.uint8)
    geometry = with_visuals(
        square(1.0, color=(0.5, 0.5, 0.5)), square(1.0, opacity=0.3), square(1.0, image, name="print")
    )
    red = Material(name="red", color=(0.75, 0.25, 0.0))
    world = world_of(replace(item("cup", materials=(red,)), size=(0.6, 0.4, 0.3)))
    written = world_to_mjcf(world, geometry={BodyId("cup"): geometry}, visuals_folder="x_assets")
    model = mujoco.MjModel.from_xml_string(written.text, dict(written.files))
    colors = model.mat_rgba[model.geom_matid[model.geom_group == 1]]
    np.testing.assert_allclose(colors[:, 0], (0.75, 0.8, 0.8), atol=1e-6)


def test_a_mesh_without_an_area_is_left_out_and_reported() -> None:
    flat = square(0.0)
    world = world_of(replace(item("cup"), size=(0.6, 0.4, 0.3)))
    shapes = {BodyId("cup"): with_visuals(flat, square(1.0, name="metal"))}
    written = world_to_mjcf(world, geometry=shapes, visuals_folder="x_assets")
    assert any("1 visual mesh" in note for note in written.notes)
    mujoco.MjModel.from_xml_string(written.text, dict(written.files))


def test_a_mesh_has_its_texture_although_another_one_of_its_material_has_no_coordinates() -> None:
    oak = square(1.0, texture="oak_board")
    world = world_of(replace(item("cup"), size=(0.6, 0.4, 0.3)))
    shapes = {BodyId("cup"): with_visuals(dataclasses.replace(oak, uv=None), oak)}
    written = world_to_mjcf(world, geometry=shapes, visuals_folder="x_assets")
    model = mujoco.MjModel.from_xml_string(written.text, dict(written.files))
    textures = model.mat_texid[model.geom_matid[model.geom_group == 1]].max(axis=1)
    assert textures[0] == -1
    assert model.tex(int(textures[1])).name == "oak_board"
