"""Reading of robot descriptions, compared with MuJoCo's own reading of the same files."""

from __future__ import annotations

import pickle
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from mindstage.engines import NullEngine
from mindstage.engines.mujoco.engine import MujocoEngine
from mindstage.errors import RobotModelError, RobotNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.robots import add_robot, drives
from mindstage.robots.abilities import profile_of_model
from mindstage.robots.collisions import CollisionChecker
from mindstage.robots.models import catalog, reading
from mindstage.robots.models.catalog import find_model, list_models
from mindstage.robots.models.forward_kinematics import link_poses, rest_positions
from mindstage.robots.models.reading import load_model
from mindstage.robots.models.robot_model import BaseType, GripperType, RobotJointType, RobotModel
from mindstage.robots.standing import add_standing_robot
from mindstage.scene.transforms import quat_angle
from mindstage.simulation import Simulation
from tests.maps.hostile_urdf import HOSTILE, hostile_urdf
from tests.robots.models.installed import EXAMPLE_URDFS, EXAMPLES, known_model

URDF_MODELS = ["mobile_manipulator", "stretch", "panda", "pr2", "tiago", "ur5", "baxter"]

BOX = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
TWO_LINKS = f"""
<robot name="pair">
  <link name="a">{BOX}</link>
  <link name="b">{BOX}</link>
  <joint name="turn" type="revolute">
    <parent link="a"/><child link="b"/><origin xyz="0 0 1"/><axis xyz="0 0 2"/>
    <limit lower="-1" upper="2" effort="5" velocity="3"/><dynamics damping="0.5" friction="0.25"/>
  </joint>
</robot>
"""


def written(folder: Path, text: str, name: str = "robot.urdf") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def random_positions(model: RobotModel, seed: int) -> dict[str, float]:
    random = np.random.default_rng(seed)
    given = {
        joint.name: float(
            random.uniform(-2.0 if joint.lower is None else joint.lower, 2.0 if joint.upper is None else joint.upper)
        )
        for joint in model.actuated_joints
    }
    return rest_positions(model.joints, given)


# -- every example -----------------------------------------------------------------------------------------------------

LARGE = {f"{name}_description" for name in ("so_arm", "borinot", "g1", "hextilt", "b1", "centauro")}
"""Folders of examples with meshes of many megabytes, which only `make test-slow` reads."""
REFUSED = {"ur3.urdf": "the robot in it has no link"}
"""The examples that cannot be read, and why: this one is the output of a macro that was never called."""


def test_there_are_69_examples() -> None:
    assert len(EXAMPLE_URDFS) == 69


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(
            path,
            id=str(path.relative_to(EXAMPLES)),
            marks=pytest.mark.slow if path.parent.parent.name in LARGE else [],
        )
        for path in EXAMPLE_URDFS
    ],
)
def test_every_example_is_read_or_refused_for_a_true_reason(path: Path) -> None:
    stated = ElementTree.parse(path).getroot()
    if path.name in REFUSED:
        assert stated.findall("link") == []
        with pytest.raises(RobotModelError, match=REFUSED[path.name]):
            load_model(path)
        return
    model = load_model(path)
    assert {link.name for link in model.links} == {link.get("name") for link in stated.findall("link")}
    assert {joint.name for joint in model.joints} == {joint.get("name") for joint in stated.findall("joint")}
    for note in model.notes:
        assert "meshes were not found" not in note.text or "file:///usr/Romeo" in note.text
        assert "collision mesh" not in note.text


def test_the_example_that_is_refused_has_no_link() -> None:
    (path,) = (each for each in EXAMPLE_URDFS if each.name in REFUSED)
    assert "<link" not in path.read_text(encoding="utf-8")


# -- against MuJoCo ----------------------------------------------------------------------------------------------------


def mujoco_model(path: str, *, without_inertia: frozenset[str] | None = None) -> mujoco.MjModel:
    """The same URDF as MuJoCo reads it, without geometry, which it would look for elsewhere.

    Links in `without_inertia`, all by default, have no inertia: MuJoCo refuses invalid ones.
    """
    text = Path(path).read_text(encoding="utf-8")
    root = ElementTree.fromstring(re.sub(r"<!DOCTYPE[^>]*>", "", text))
    for link in root.findall("link"):
        is_light = without_inertia is None or link.get("name") in without_inertia
        for tag in ("visual", "collision", *(("inertial",) if is_light else ())):
            for each in link.findall(tag):
                link.remove(each)
    for tag in ("gazebo", "transmission", "material"):
        for each in root.findall(tag):
            root.remove(each)
    for axis in root.iter("axis"):
        if axis.get("xyz", "").split() == ["0", "0", "0"]:
            axis.set("xyz", "1 0 0")
    options = ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler")
    options.attrib.update(fusestatic="false", balanceinertia="true", boundmass="1e-9", boundinertia="1e-12")
    return mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))


@pytest.mark.parametrize("name", URDF_MODELS)
def test_links_are_where_mujoco_puts_them(name: str) -> None:
    model = known_model(name)
    expected = mujoco_model(model.source)
    data = mujoco.MjData(expected)
    for seed in range(5):
        positions = random_positions(model, seed)
        for joint, position in positions.items():
            row = mujoco.mj_name2id(expected, mujoco.mjtObj.mjOBJ_JOINT, joint)
            data.qpos[expected.jnt_qposadr[row]] = position
        mujoco.mj_kinematics(expected, data)
        poses = link_poses(model.joints, positions, model.root)
        for link in model.links[1:]:
            body = data.body(link.name)
            np.testing.assert_allclose(poses[link.name][:3], body.xpos, atol=1e-6, err_msg=link.name)
            assert quat_angle(poses[link.name][3:], body.xquat) < 1e-5, link.name


@pytest.mark.parametrize("name", URDF_MODELS)
def test_inertias_are_those_of_mujoco(name: str) -> None:
    model = known_model(name)
    corrected = frozenset(note.subject for note in model.notes if "moments of inertia" in note.text)
    expected = mujoco_model(model.source, without_inertia=corrected)
    compared = 0
    for link in model.links[1:]:
        if link.inertia is None or link.name in corrected:
            continue
        body = expected.body(link.name)
        assert body.mass[0] == pytest.approx(link.inertia.mass_kg, rel=1e-6)
        np.testing.assert_allclose(body.ipos, link.inertia.center, atol=1e-6)
        xx, yy, zz, xy, xz, yz = link.inertia.tensor
        moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        floor = 1e-6 * link.inertia.mass_kg  # no link is lighter than its mass within a millimeter
        np.testing.assert_allclose(moments, np.maximum(np.sort(body.inertia), floor), rtol=2e-3, atol=1e-8)
        compared += 1
    assert compared >= 5


def test_an_mjcf_robot_is_where_mujoco_puts_it() -> None:
    model = known_model("pr2_mjcf")
    expected = mujoco.MjModel.from_xml_path(model.source)
    data = mujoco.MjData(expected)
    for seed in range(5):
        positions = random_positions(model, seed)
        for joint, position in positions.items():
            row = mujoco.mj_name2id(expected, mujoco.mjtObj.mjOBJ_JOINT, joint)
            data.qpos[expected.jnt_qposadr[row]] = position
        mujoco.mj_kinematics(expected, data)
        root = data.body(model.root)
        np.testing.assert_allclose(root.xquat, (1.0, 0.0, 0.0, 0.0), atol=1e-9)
        for link, pose in link_poses(model.joints, positions, model.root).items():
            np.testing.assert_allclose(pose[:3] + root.xpos, data.body(link).xpos, atol=1e-7, err_msg=link)
            assert quat_angle(pose[3:], data.body(link).xquat) < 1e-6, link


def test_an_mjcf_robot_has_the_masses_limits_and_efforts_of_the_file() -> None:
    model = known_model("pr2_mjcf")
    expected = mujoco.MjModel.from_xml_path(model.source)
    assert len(model.actuated_joints) == 16
    assert sum(link.inertia.mass_kg for link in model.links if link.inertia) == pytest.approx(expected.body_mass.sum())
    for joint in model.actuated_joints:
        row = expected.joint(joint.name)
        if row.limited[0]:
            assert (joint.lower, joint.upper) == pytest.approx(tuple(row.range))
        assert joint.armature == pytest.approx(row.armature[0])


MJCF = """
<mujoco model="twin">
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="r:base" pos="0 0 0.2">
      <joint name="r:x" type="slide" axis="1 0 0"/><joint name="r:y" type="slide" axis="0 1 0"/>
      <geom type="box" size="0.2 0.2 0.1"/>
      <body name="r:arm" pos="0 0 0.3" euler="0 30 0">
        <joint name="r:pan" type="hinge" axis="0 0 1" range="-90 90" ref="20"/>
        <joint name="r:tilt" type="hinge" axis="0 1 0" pos="0.05 0 0.1" range="-10 60"/>
        <geom type="capsule" size="0.03 0.2"/>
      </body>
    </body>
    <body name="table" pos="2 0 0"><geom type="box" size="0.1 0.1 0.1"/></body>
  </worldbody>
</mujoco>
"""


def test_bodies_of_mjcf_with_several_joints_off_their_origin(tmp_path: Path) -> None:
    path = written(tmp_path, MJCF, "twin.xml")
    model = load_model(path)
    assert model.base.type is BaseType.PLANAR
    assert {link.name for link in model.links} >= {"base", "arm"}
    assert any(note.subject == "table" for note in model.notes)
    expected = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(expected)
    for pan, tilt in ((np.deg2rad(20.0), 0.0), (0.0, 0.0), (0.7, -0.1), (-1.2, 0.9)):
        data.joint("r:pan").qpos[0], data.joint("r:tilt").qpos[0] = pan, tilt
        mujoco.mj_kinematics(expected, data)
        pose = link_poses(model.joints, {"pan": pan, "tilt": tilt}, model.root)["arm"]
        np.testing.assert_allclose(pose[:3] + data.body("r:base").xpos, data.body("r:arm").xpos, atol=1e-9)
        assert quat_angle(pose[3:], data.body("r:arm").xquat) < 1e-7


ARM = '<mujoco><worldbody><body name="arm"><geom size="0.1" mass="1"/></body></worldbody></mujoco>'
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
BODY = '<worldbody><body name="arm"><geom type="mesh" mesh="m"/></body></worldbody>'
MESH = f'<asset><mesh name="m" file="{{}}"/></asset>{BODY}'
ATTACH = '<worldbody><attach model="s" prefix="p"/></worldbody>'
NAMING = {
    "include": '<include file="../other/arm.xml"/>',
    "backslashes": '<include file="..\\other\\arm.xml"/>',
    "absolute": '<include file="{other}/arm.xml"/>',
    "symbolic link": '<include file="link.xml"/>',
    "nested": '<include file="parts/nested.xml"/>',
    "model": f'<asset><model name="s" file="../other/arm.xml"/></asset>{ATTACH}',
    "mesh": MESH.format("../other/m.obj"),
    "folder of meshes": '<compiler meshdir="../other"/>' + MESH.format("m.obj"),
    "folder of an included file": '<include file="parts/folder.xml"/>' + MESH.format("m.obj"),
    "stripped path": '<compiler assetdir="../other" strippath="true"/>' + MESH.format("no/m.obj"),
}


@pytest.mark.parametrize("kind", NAMING)
def test_an_mjcf_file_names_files_of_its_folder_and_of_granted_ones_only(tmp_path: Path, kind: str) -> None:
    other, robot = tmp_path / "other", tmp_path / "robot"
    (robot / "parts").mkdir(parents=True)
    other.mkdir()
    (other / "arm.xml").write_text(ARM)
    (other / "m.obj").write_text(OBJ)
    (robot / "link.xml").symlink_to(other / "arm.xml")
    (robot / "parts" / "nested.xml").write_text('<mujoco><include file="../../other/arm.xml"/></mujoco>')
    (robot / "parts" / "folder.xml").write_text('<mujoco><compiler meshdir="../other"/></mujoco>')
    path = written(robot, f"<mujoco>{NAMING[kind].replace('{other}', str(other))}</mujoco>", "robot.xml")
    with pytest.raises(RobotModelError, match=r"it names '.*', which is not in its folder; copy that file"):
        load_model(path)
    assert any(link.name.endswith("arm") for link in load_model(path, folders=[other]).links)


def test_an_mjcf_file_names_files_below_its_folder(tmp_path: Path) -> None:
    (tmp_path / "parts" / "meshes").mkdir(parents=True)
    (tmp_path / "parts" / "meshes" / "m.obj").write_text(OBJ)
    compiler = '<compiler meshdir="parts/meshes"/>'
    (tmp_path / "parts" / "arm.xml").write_text(f"<mujoco>{compiler}{MESH.format('../meshes/m.obj')}</mujoco>")
    path = written(tmp_path, '<mujoco><include file="parts/arm.xml"/></mujoco>', "robot.xml")
    (link,) = (link for link in load_model(path).links if link.name == "arm")
    assert link.geometry.collision_shapes


# -- what a description says -------------------------------------------------------------------------------------------


def test_the_group_of_the_head_is_its_head_whatever_its_joints_are_called(tmp_path: Path) -> None:
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for name, parent, child in (("pan", "a", "b"), ("tilt", "b", "c"), ("neck", "a", "d"))
    )
    links = "".join(f'<link name="{name}">{BOX}</link>' for name in "abcd")
    path = written(tmp_path, f'<robot name="r">{links}{joints}</robot>')
    head = load_model(path).head
    assert (head.joints, head.link) == (("neck",), "d"), "by its name"
    group = '<group name="head"><joint name="pan"/><joint name="tilt"/></group>'
    written(tmp_path, f'<robot name="r">{group}</robot>', "robot.srdf")
    head = load_model(path).head
    assert (head.joints, head.link) == (("pan", "tilt"), "c")


def test_limits_and_dynamics_of_a_joint(tmp_path: Path) -> None:
    model = load_model(written(tmp_path, TWO_LINKS))
    joint = model.joint("turn")
    assert (joint.lower, joint.upper, joint.effort, joint.velocity) == (-1.0, 2.0, 5.0, 3.0)
    assert (joint.damping, joint.friction) == (0.5, 0.25)
    assert joint.axis == (0.0, 0.0, 1.0)
    assert model.urdf == TWO_LINKS


def test_a_declared_namespace_is_not_xacro(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "xacro", None)
    text = TWO_LINKS.replace('name="pair"', 'name="pair" xmlns:xacro="http://www.ros.org/wiki/xacro"')
    assert load_model(written(tmp_path, text)).name == "pair"


def test_xacro_is_expanded(tmp_path: Path) -> None:
    text = TWO_LINKS.replace('name="pair"', 'name="pair" xmlns:xacro="http://www.ros.org/wiki/xacro"')
    text = text.replace('xyz="0 0 1"', 'xyz="0 0 ${height / 2}"')
    text = text.replace("<link name", '<xacro:property name="height" value="3.0"/><link name', 1)
    model = load_model(written(tmp_path, text, "robot.urdf.xacro"))
    assert model.joint("turn").origin.position == (0.0, 0.0, 1.5)
    assert "xacro:property" not in model.urdf
    assert "1.5" in model.urdf


def test_xacro_that_is_not_installed_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "xacro", None)
    text = TWO_LINKS.replace('"0 0 1"', '"0 0 ${1}"')
    with pytest.raises(RobotModelError, match=r"pip install mindstage\[xacro\]"):
        load_model(written(tmp_path, text), xacro=True)


@pytest.mark.parametrize("kind", HOSTILE)
def test_nothing_runs_in_a_model_that_is_loaded(tmp_path: Path, kind: str) -> None:
    marker = tmp_path / "marker"
    path = written(tmp_path, hostile_urdf(kind, marker))
    for source in (path, str(path)):
        with pytest.raises(RobotModelError, match="is written in xacro"):
            load_model(source)
    with Simulation(KnowledgeBase(), NullEngine()) as simulation:
        with pytest.raises(RobotModelError, match="is written in xacro"):
            add_robot(simulation, path)
        with pytest.raises(RobotModelError, match="is written in xacro"):
            add_standing_robot(simulation, path)
    assert not marker.exists()


def test_a_model_is_expanded_on_request_and_a_named_one_by_its_suffix(tmp_path: Path) -> None:
    text = TWO_LINKS.replace('"0 0 1"', '"0 0 ${1}"', 1)
    with pytest.raises(RobotModelError, match="--xacro"):
        load_model(written(tmp_path, text))
    assert load_model(written(tmp_path, text), xacro=True).name == "pair"
    (tmp_path / "robot.urdf").rename(tmp_path / "pair.xacro")
    assert load_model("pair", folders=[tmp_path]).name == "pair"
    with pytest.raises(RobotModelError, match="--xacro"):
        load_model("pair", folders=[tmp_path], xacro=False)


def test_a_description_makes_no_other_folder_readable_by_its_name(tmp_path: Path) -> None:
    secret = tmp_path / "secrets"
    secret.mkdir()
    (secret / "sizes.yaml").write_text("size: 2", encoding="utf-8")
    (tmp_path / "robot").mkdir()
    text = TWO_LINKS.replace('"0 0 1"', """"0 0 ${xacro.load_yaml('$(find secrets)/sizes.yaml').size}\"""", 1)
    with pytest.raises(RobotModelError, match="no package folder contains 'secrets'"):
        load_model(written(tmp_path / "robot", text), xacro=True)
    (secret / "package.xml").write_text("<package/>", encoding="utf-8")
    assert load_model(written(tmp_path / "robot", text), xacro=True).name == "pair"


def tetrahedron(scale: float = 1.0) -> str:
    corners = [(0, 0, 0), (scale, 0, 0), (0, scale, 0), (0, 0, scale)]
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    return "\n".join(lines) + "\n"


WITH_MESH = TWO_LINKS.replace(
    f'<link name="b">{BOX}',
    '<link name="b">{}'.format(
        "".join(
            f'<{tag}><origin xyz="0 0 1" rpy="0 0 1.5707963"/><geometry>'
            f'<mesh filename="package://shop/meshes/part.obj" scale="2 1 1"/></geometry></{tag}>'
            for tag in ("visual", "collision")
        )
    ),
)


def test_a_package_is_found_in_a_given_folder(tmp_path: Path) -> None:
    meshes = tmp_path / "ros" / "shop" / "meshes"
    meshes.mkdir(parents=True)
    written(meshes, tetrahedron(), "part.obj")
    path = written(tmp_path, WITH_MESH)
    missing = load_model(path)
    assert any("package://shop" in note.text and not note.is_guess for note in missing.notes)
    model = load_model(path, folders=[tmp_path / "ros"], cache=tmp_path / "cache")
    geometry = next(link.geometry for link in model.links if link.name == "b")
    assert geometry is not None
    (shape,) = geometry.collision_shapes
    corners = np.array(shape.points) + shape.pose.position
    # Scaled along x, then turned by a quarter about z: x of the mesh is y of the link.
    np.testing.assert_allclose(corners.min(axis=0), (-1.0, 0.0, 1.0), atol=1e-6)
    np.testing.assert_allclose(corners.max(axis=0), (0.0, 2.0, 2.0), atol=1e-6)
    (visual,) = geometry.visuals
    np.testing.assert_allclose(visual.points.min(axis=0), corners.min(axis=0), atol=1e-6)
    np.testing.assert_allclose(visual.points.max(axis=0), corners.max(axis=0), atol=1e-6)


def test_geometry_can_be_pickled_before_it_is_drawn() -> None:
    geometry = next(link.geometry for link in known_model("panda").links if link.name == "panda_link0")
    copy = pickle.loads(pickle.dumps(geometry))
    assert copy.collision_shapes == geometry.collision_shapes
    assert copy.key == geometry.key
    assert sum(len(visual.faces) for visual in copy.visuals) > 100


def test_moments_of_no_rigid_body_are_corrected_and_noted(tmp_path: Path) -> None:
    inertial = '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="9" ixy="0" ixz="0" iyz="0"/></inertial>'
    model = load_model(written(tmp_path, TWO_LINKS.replace('<link name="b">', f'<link name="b">{inertial}')))
    link = next(link for link in model.links if link.name == "b")
    assert link.inertia is not None
    assert link.inertia.tensor[:3] == pytest.approx((11 / 3,) * 3)
    assert any(note.subject == "b" and "no rigid body" in note.text for note in model.notes)


def test_equal_limits_fix_a_joint_and_huge_ones_are_none(tmp_path: Path) -> None:
    fixed = load_model(written(tmp_path, TWO_LINKS.replace('lower="-1" upper="2"', 'lower="0" upper="0"')))
    assert fixed.joint("turn").type is RobotJointType.FIXED
    free = load_model(written(tmp_path, TWO_LINKS.replace('lower="-1" upper="2"', 'lower="-1e16" upper="1e16"')))
    assert free.joint("turn").type is RobotJointType.CONTINUOUS
    assert free.joint("turn").lower is None


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("<robot name='x'/>", "has no link"),
        ("<sdf/>", "root element is <sdf>"),
        ("<robot>", "not well-formed"),
        ("", "not well-formed"),
        ("<!DOCTYPE robot><robot/>", "document type"),
        ("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>", "mass and inertia|Error"),
        ("<mujoco/>", "has no body"),
    ],
)
def test_a_description_that_cannot_be_read_has_a_reason(tmp_path: Path, text: str, cause: str) -> None:
    with pytest.raises(RobotModelError, match=cause) as caught:
        load_model(written(tmp_path, text))
    assert "robot.urdf" in str(caught.value)


# -- parts of a robot --------------------------------------------------------------------------------------------------


def test_the_parts_of_the_bundled_robot() -> None:
    model = known_model("mobile_manipulator")
    assert model.base.type is BaseType.PLANAR
    assert model.base.radius_m == pytest.approx(0.28, abs=0.002)
    (arm,) = model.arms
    assert len(arm.joints) == 8
    assert arm.joints[0] == "lift_joint"
    assert arm.gripper == "gripper"
    (gripper,) = model.grippers
    assert gripper.type is GripperType.PARALLEL
    assert gripper.max_opening_m == pytest.approx(0.12)
    assert gripper.max_force_n == model.joint("left_finger_joint").effort / 2, "two fingers share it"
    assert gripper.grasp_pose.position == pytest.approx((0.115, 0.0, 0.0), abs=1e-6)
    assert gripper.finger_links == ("left_finger_link", "right_finger_link")
    assert model.head is not None
    assert model.head.joints == ("head_pan_joint", "head_tilt_joint")
    assert {"head_camera_optical_frame", "base_laser_link"} <= {sensor.link for sensor in model.sensors}


@pytest.mark.parametrize(
    ("name", "base", "arms", "openings"),
    [
        ("stretch", BaseType.DIFFERENTIAL, {"arm": 5}, [0.219]),
        ("panda", BaseType.FIXED, {"arm": 7}, [0.08]),
        ("pr2", BaseType.PLANAR, {"l_arm": 7, "r_arm": 7}, [0.092, 0.092]),
        ("tiago_no_hand", BaseType.DIFFERENTIAL, {"arm": 8}, []),
        ("ur5", BaseType.FIXED, {"manipulator": 6}, []),
        ("pr2_mjcf", BaseType.PLANAR, {"l_arm": 7, "r_arm": 7}, []),
        ("stretch_se3", BaseType.DIFFERENTIAL, {"arm": 5}, [0.191]),
        # Fingers 1.5 cm wide on slides of 2.08 cm each, with tips of two kinds.
        ("baxter", BaseType.FIXED, {"right_arm": 7, "left_arm": 7}, [0.048, 0.058]),
        ("tiago_pro", BaseType.PLANAR, {"left_arm": 7, "right_arm": 7}, [0.079, 0.079]),
        ("talos", BaseType.FIXED, {"l_arm": 7, "r_arm": 7}, [0.092, 0.092]),
        ("tiago", BaseType.DIFFERENTIAL, {"arm": 8}, [0.049]),
    ],
)
def test_the_parts_of_known_robots(
    name: str, base: BaseType, arms: dict[str, int], openings: list[float] | None
) -> None:
    model = known_model(name)
    assert model.base.type is base
    assert {arm.name: len(arm.joints) for arm in model.arms} == arms
    movable = {joint.name for joint in model.actuated_joints}
    assert all(movable.issuperset(arm.joints) for arm in model.arms)
    if openings is not None:
        assert [gripper.max_opening_m for gripper in model.grippers] == pytest.approx(openings, abs=0.003)


def test_the_grasp_frame_of_a_panda_is_its_tool_center_point() -> None:
    (gripper,) = known_model("panda").grippers
    assert gripper.link == "panda_hand"
    assert gripper.grasp_pose.position == pytest.approx((0.0, 0.0, 0.1034), abs=1e-4)
    # x of the grasp frame is z of the hand, and y is y: the fingers slide along y.
    assert quat_angle(gripper.grasp_pose.quaternion, (2**-0.5, 0.0, -(2**-0.5), 0.0)) < 1e-6
    assert gripper.open_positions == pytest.approx((0.04,))
    assert gripper.closed_positions == pytest.approx((0.0,), abs=1e-4)


def test_fingers_on_parallel_cranks_are_a_pair_of_tips() -> None:
    gripper = known_model("tiago_pro").grippers[0]
    assert gripper.type is GripperType.PARALLEL
    assert gripper.finger_links == ("gripper_left_fingertip_left_link", "gripper_left_fingertip_right_link")
    assert gripper.joints == ("gripper_left_finger_joint",)


def test_a_hand_has_the_drives_that_the_real_one_has() -> None:
    model = known_model("tiago")
    (hand,) = model.grippers
    assert hand.joints == ("hand_thumb_joint", "hand_index_joint", "hand_mrl_joint")
    assert len(hand.finger_links) == 5
    mimic = model.joint("hand_thumb_flex_1_joint").mimic
    assert mimic is not None
    assert (mimic.joint, mimic.multiplier) == ("hand_thumb_joint", pytest.approx(1 / 2.5))
    assert model.joint("hand_thumb_joint").upper == pytest.approx(2.5 * 0.785398163397)
    assert not model.joint("hand_middle_abd_joint").is_movable, "no motor moves it"
    assert any("used as a gripper" in note.text for note in model.notes)


FINGERS = """
<robot name="hand">
  <link name="palm">{box}</link><link name="left">{box}</link><link name="right">{box}</link>
  <joint name="motor" type="revolute">
    <parent link="palm"/><child link="left"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="follower" type="revolute">
    <parent link="palm"/><child link="right"/><axis xyz="0 0 1"/>
    <limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>
  </joint>
  <gazebo><plugin name="mimic" filename="libroboticsgroup_gazebo_mimic_joint_plugin.so">
    <joint>motor</joint><mimicJoint>follower</mimicJoint>
    <multiplier>{multiplier}</multiplier><offset>{offset}</offset>
  </plugin></gazebo>
</robot>
"""


@pytest.mark.parametrize(
    ("multiplier", "offset", "lower", "upper", "motor"),
    [
        (1.0, 0.0, -0.25, 0.5, (-0.25, 0.5)),
        (-1.0, 0.0, -0.25, 0.5, (-0.5, 0.25)),  # it turns the other way, and so do its limits
        (2.0, 0.0, -0.25, 0.5, (-0.125, 0.25)),
        (-2.0, 0.5, -0.25, 0.5, (0.0, 0.375)),
        (0.5, 0.0, -2.0, 0.25, (-1.0, 0.5)),  # below, the motor stops first
    ],
)
def test_a_motor_turns_as_far_as_the_joint_that_follows_it(
    tmp_path: Path, multiplier: float, offset: float, lower: float, upper: float, motor: tuple[float, float]
) -> None:
    text = FINGERS.format(box=BOX, multiplier=multiplier, offset=offset, lower=lower, upper=upper)
    model = load_model(written(tmp_path, text))
    assert (model.joint("motor").lower, model.joint("motor").upper) == pytest.approx(motor)
    follower = model.joint("follower")
    assert follower.mimic is not None
    assert (follower.mimic.joint, follower.mimic.multiplier, follower.mimic.offset) == ("motor", multiplier, offset)
    assert [joint.name for joint in model.actuated_joints] == ["motor"]
    notes = {note.subject: note.text for note in model.notes}
    assert notes["follower"] == f"it moves with motor, times {multiplier:.3g}, as a plugin of Gazebo moves it"
    assert f"its range is {motor[0]:.3g} to {motor[1]:.3g}" in notes["motor"]


def test_the_tips_of_fingers_are_among_their_links() -> None:
    gripper = known_model("baxter").grippers[0]
    assert {"r_gripper_l_finger_tip", "r_gripper_r_finger_tip"} <= set(gripper.finger_links)


def test_an_assumed_range_is_reported() -> None:
    model = known_model("stretch_se3")
    assert (model.joint("joint_gripper_finger_left").lower, model.joint("joint_gripper_finger_left").upper) == (
        -0.6,
        0.6,
    )
    assert any("its range is not stated" in note.text for note in model.notes)


def test_sections_of_a_telescope_move_together() -> None:
    model = known_model("stretch")
    for number in (2, 1, 0):
        mimic = model.joint(f"joint_arm_l{number}").mimic
        assert mimic is not None
        assert mimic.joint == "joint_arm_l3"
    assert not any("wheel" in joint.name for joint in model.actuated_joints)


@pytest.mark.parametrize(
    ("urdf", "srdf"),
    [
        ("talos_data/robots/talos_reduced.urdf", "talos.srdf"),
        ("ur_description/urdf/ur5_robot.urdf", "ur5.srdf"),
        ("ur_description/urdf/ur5_gripper.urdf", "ur5_gripper.srdf"),
        ("pr2_description/urdf/pr2.urdf", "pr2.srdf"),
        ("ur_description/urdf/ur10_robot.urdf", None),
    ],
)
def test_the_srdf_near_a_description_is_found(urdf: str, srdf: str | None) -> None:
    notes = [note.text for note in load_model(EXAMPLES / urdf).notes if "SRDF" in note.text]
    assert notes == ([] if srdf is None else [f"{srdf} is its SRDF, by its name"])


def test_guesses_without_srdf_are_noted(tmp_path: Path) -> None:
    source = known_model("panda").source
    model = load_model(Path(source), srdf=written(tmp_path, '<robot name="panda"/>', "empty.srdf"))
    assert [arm.joints for arm in model.arms] == [tuple(f"panda_joint{number}" for number in range(1, 8))]
    assert model.grippers[0].max_opening_m == pytest.approx(0.08, abs=0.002)
    guesses = {note.subject for note in model.notes if note.is_guess}
    assert {"arm", "gripper"} <= guesses


def test_links_beside_one_joint_cannot_collide() -> None:
    disabled = known_model("mobile_manipulator").disabled_collisions
    assert ("forearm_link", "upper_arm_roll_link") in disabled
    # The column is fixed to the base, on which the lift slides.
    assert ("column_link", "lift_link") in disabled
    assert all(first < second for first, second in disabled)
    assert ("base_link", "gripper_link") not in disabled


# -- grippers, measured ------------------------------------------------------------------------------------------------

LINKED = """
<mujoco model="linked">
  <compiler angle="radian"/>
  <default><geom mass="0.1"/></default>
  <worldbody>
    <body name="hand"><geom type="box" size="0.02 0.05 0.03"/>
      <body name="a" pos="0.02 0.03 0"><joint name="a_crank" axis="0 0 -1" range="0 0.8"/>
        <geom type="box" size="0.02 0.005 0.01" pos="0.02 0.01 0"/>
        <body name="a_end" pos="0.05 0.02 0"><joint name="a_end_joint" axis="0 0 -1" range="-0.9 0.9"/>
          <geom name="a_pad" type="box" size="0.025 0.005 0.012" pos="0.025 -0.005 0"/></body></body>
      <body name="a_rod" pos="0.02 0.015 0"><joint name="a_rod_joint" axis="0 0 -1" range="-0.9 0.9"/>
        <geom type="box" size="0.02 0.003 0.008" pos="0.025 0.01 0"/></body>
      <body name="b" pos="0.02 -0.03 0"><joint name="b_crank" axis="0 0 1" range="0 0.8"/>
        <geom type="box" size="0.02 0.005 0.01" pos="0.02 -0.01 0"/>
        <body name="b_end" pos="0.05 -0.02 0"><joint name="b_end_joint" axis="0 0 1" range="-0.9 0.9"/>
          <geom name="b_pad" type="box" size="0.025 0.005 0.012" pos="0.025 0.005 0"/></body></body>
      <body name="b_rod" pos="0.02 -0.015 0"><joint name="b_rod_joint" axis="0 0 1" range="-0.9 0.9"/>
        <geom type="box" size="0.02 0.003 0.008" pos="0.025 -0.01 0"/></body>
    </body>
  </worldbody>
  <contact><exclude body1="hand" body2="a_rod"/><exclude body1="hand" body2="b_rod"/></contact>
  <tendon>
    <fixed name="a_level"><joint joint="a_crank" coef="1"/><joint joint="a_end_joint" coef="1"/></fixed>
    <fixed name="b_level"><joint joint="b_crank" coef="1"/><joint joint="b_end_joint" coef="1"/></fixed>
  </tendon>
  <equality>
    {equalities}
    <joint joint1="{first}" joint2="{second}" polycoef="0 1 0 0 0"/>
  </equality>
  <actuator><position name="grip" joint="{drive}" kp="20" ctrlrange="0 0.8" forcerange="-4 4"/></actuator>
</mujoco>
"""
TENDONS = """
  <tendon tendon1="a_level"/><tendon tendon1="b_level"/>
  <joint joint1="a_rod_joint" joint2="a_crank"/><joint joint1="b_rod_joint" joint2="b_crank"/>
"""
LOOPS = """
  <connect body1="a_rod" body2="a_end" anchor="0.05 0.02 0"/>
  <connect body1="b_rod" body2="b_end" anchor="0.05 -0.02 0"/>
"""


def settled_opening(path: Path, command: float) -> float:
    """The distance of the pads when MuJoCo holds the actuator at a command [m]: the referee."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.gravity[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    data.ctrl[0] = command
    mujoco.mj_step(model, data, nstep=3000)
    return mujoco.mj_geomDistance(model, data, model.geom("a_pad").id, model.geom("b_pad").id, 1.0, None)


@pytest.mark.parametrize("drive", ["a_crank", "b_crank"])
@pytest.mark.parametrize("equalities", [TENDONS, LOOPS], ids=["tendons", "loops"])
def test_a_linked_gripper_of_mjcf_has_one_drive_and_the_opening_that_mujoco_settles_at(
    tmp_path: Path, equalities: str, drive: str
) -> None:
    others = {"a_crank": "b_crank", "b_crank": "a_crank"}
    text = LINKED.format(equalities=equalities, first=drive, second=others[drive], drive=drive)
    path = written(tmp_path, text, "linked.xml")
    (gripper,) = load_model(path).grippers
    assert gripper.type is GripperType.PARALLEL
    assert gripper.joints == (drive,)
    assert gripper.max_opening_m == pytest.approx(0.08, abs=1e-3), "2 x (0.03 + 0.02 - 0.01)"
    assert gripper.max_opening_m == pytest.approx(settled_opening(path, gripper.open_positions[0]), abs=1e-3)
    assert settled_opening(path, gripper.closed_positions[0]) == pytest.approx(0.0, abs=1e-3)
    assert {"a_end", "b_end"} <= set(gripper.finger_links)


def test_rods_that_overlap_do_not_hold_a_linked_gripper_open(tmp_path: Path) -> None:
    text = LINKED.format(equalities=TENDONS, first="a_crank", second="b_crank", drive="a_crank")
    thick = text.replace("0.02 0.003 0.008", "0.02 0.015 0.008")
    model = load_model(written(tmp_path, thick, "thick.xml"))
    assert ("a_rod", "b_rod") in model.disabled_collisions
    assert ("a_end", "b_end") not in model.disabled_collisions, "the fingers hold what is between them"
    assert any("a_rod and b_rod" in note.text for note in model.notes)
    with Simulation(KnowledgeBase(), engine=MujocoEngine(), threaded=False) as sim:
        robot = add_robot(sim, model)
        assert robot.run(robot.gripping("gripper", 0.0))
        assert robot.opening("gripper") == pytest.approx(0.0, abs=0.003)


JAW = """
<robot name="jaw">
  <link name="base">{box}</link>
  <link name="wrist">
    <collision><origin xyz="0.05 0 0"/><geometry><box size="0.1 0.02 0.02"/></geometry></collision>
  </link>
  <link name="{child}">
    <collision><origin xyz="0.05 0.005 0"/><geometry><box size="0.1 0.01 0.02"/></geometry></collision>
  </link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="wrist"/><axis xyz="1 0 0"/></joint>
  <joint name="{joint}" type="revolute">
    <parent link="wrist"/><child link="{child}"/><origin xyz="0 0.01 0"/><axis xyz="0 0 {sign}"/>
    <limit lower="{lower}" upper="{upper}" effort="2" velocity="1"/>
  </joint>
</robot>
"""


@pytest.mark.parametrize(("sign", "lower", "upper"), [(1, 0.0, 1.5), (-1, -1.5, 0.0), (1, -0.2, 1.5)])
@pytest.mark.parametrize(("joint", "child"), [("gripper", "moving_part"), ("j6", "jaw")])
def test_an_only_jaw_closes_on_what_carries_it(
    tmp_path: Path, joint: str, child: str, sign: int, lower: float, upper: float
) -> None:
    text = JAW.format(box=BOX, joint=joint, child=child, sign=sign, lower=lower, upper=upper)
    model = load_model(written(tmp_path, text))
    (gripper,) = model.grippers
    assert gripper.joints == (joint,)
    assert set(gripper.finger_links) == {"wrist", child}
    assert abs(gripper.closed_positions[0]) < 0.02, "where the jaws touch, not where the range ends"
    # The jaw is a plate of 0.1 m: at angle q its lower side is tan(q) x above the wrist, up to x = 0.1 m cos(q).
    x = gripper.grasp_pose.position[0] + 0.008
    angle = abs(gripper.open_positions[0])
    assert x <= 0.1 * np.cos(angle) + 0.01 * np.sin(angle) + 0.02
    assert gripper.max_opening_m == pytest.approx(np.tan(angle) * gripper.grasp_pose.position[0], abs=0.02)
    assert 0.04 < gripper.max_opening_m < 0.1
    assert any("its only finger closes on wrist" in note.text for note in model.notes)


def hand(names: tuple[str, ...], *, toward: float, visual: bool = False) -> str:
    """A palm with two plates on slides, 0.1 m apart at 0, which move by 0.04 m each."""
    shape = '<geometry><box size="0.04 0.01 0.02"/></geometry>'
    tag = "visual" if visual else "collision"
    palm, left, right = names
    fingers = "".join(
        f'<link name="{name}"><{tag}><origin xyz="0.05 0 0"/>{shape}</{tag}></link>'
        f'<joint name="{name}_j" type="prismatic"><parent link="{palm}"/><child link="{name}"/>'
        f'<origin xyz="0 {side * 0.055} 0"/><axis xyz="0 {-side * toward} 0"/>'
        '<limit lower="0" upper="0.04" effort="10" velocity="0.1"/></joint>'
        for name, side in ((left, 1), (right, -1))
    )
    return f'<robot name="r"><link name="{palm}">{BOX}</link>{fingers}</robot>'


def test_fingers_are_found_by_what_they_do(tmp_path: Path) -> None:
    model = load_model(written(tmp_path, hand(("p", "u", "v"), toward=1.0)))
    (gripper,) = model.grippers
    assert gripper.max_opening_m == pytest.approx(0.1)
    assert set(gripper.joints) == {"u_j", "v_j"}
    assert any("since these close on each other" in note.text for note in model.notes)
    away = load_model(written(tmp_path, hand(("p", "u", "v"), toward=-1.0)))
    assert away.grippers[0].max_opening_m == pytest.approx(0.18)
    assert any("still 100 mm apart when it is closed" in note.text for note in away.notes)


def test_fingers_without_collision_shapes_get_those_of_their_visual_meshes(tmp_path: Path) -> None:
    model = load_model(written(tmp_path, hand(("palm", "left_finger", "right_finger"), toward=1.0, visual=True)))
    assert model.grippers[0].max_opening_m == pytest.approx(0.1)
    assert {note.subject for note in model.notes if "no collision shapes" in note.text} == {
        "left_finger",
        "right_finger",
    }


def test_a_spring_drives_no_gripper(tmp_path: Path) -> None:
    text = hand(("palm", "left_finger", "right_finger"), toward=1.0)
    spring = (
        '<link name="pad"><collision><geometry><box size="0.01 0.01 0.01"/></geometry></collision></link>'
        '<joint name="finger_spring_joint" type="prismatic"><parent link="left_finger"/><child link="pad"/>'
        '<origin xyz="0.06 0 0"/><axis xyz="0 1 0"/>'
        '<limit lower="-0.001" upper="0.001" effort="1" velocity="1"/></joint>'
    )
    model = load_model(written(tmp_path, text.replace("</robot>", f"{spring}</robot>")))
    assert set(model.grippers[0].joints) == {"left_finger_j", "right_finger_j"}
    assert any(note.subject == "finger_spring_joint" and "spring" in note.text for note in model.notes)


def test_a_suction_cup_is_no_gripper_and_the_robot_says_so(tmp_path: Path) -> None:
    cup = '<link name="suction_cup"/><joint name="j" type="fixed"><parent link="b"/><child link="suction_cup"/></joint>'
    model = load_model(written(tmp_path, TWO_LINKS.replace("</robot>", f"{cup}</robot>")))
    assert model.grippers == ()
    (note,) = (note for note in model.notes if note.subject == "suction_cup")
    assert "is not simulated" in note.text


def test_a_gripper_that_nothing_moves_is_none_and_the_robot_says_so(tmp_path: Path) -> None:
    tool = (
        '<link name="gripper_body"/><joint name="j" type="fixed"><parent link="b"/><child link="gripper_body"/></joint>'
    )
    model = load_model(written(tmp_path, TWO_LINKS.replace("</robot>", f"{tool}</robot>")))
    assert model.grippers == ()
    (note,) = (note for note in model.notes if note.subject == "gripper_body")
    assert "no joint moves it" in note.text


def test_fingers_that_overlap_are_no_gripper_and_nothing_can_be_picked_up(tmp_path: Path) -> None:
    thick = hand(("palm", "left_finger", "right_finger"), toward=1.0).replace("0.04 0.01 0.02", "0.04 0.12 0.02")
    model = load_model(written(tmp_path, thick))
    assert [each.max_opening_m for each in model.grippers] == [0.0]
    assert any("at most 0 mm apart" in note.text for note in model.notes)
    classes = {str(cls) for part in profile_of_model(model).components for cls in part.classes}
    assert not any(name in cls for cls in classes for name in ("Gripper", "Hand", "GraspController"))


@given(st.integers(0, 10_000))
@settings(deadline=None)
def test_no_description_of_a_hand_ends_in_a_traceback(seed: int) -> None:
    random = np.random.default_rng(seed)
    words = ("gripper", "finger", "jaw", "spring", "hook", "link", "proximal", "thumb", "wrist")
    parts = [f'<link name="l0">{BOX}</link>']
    for number in range(1, int(random.integers(2, 8))):
        name = f"{random.choice(words)}_{number}"
        parent = ["l0", *re.findall(r'<link name="(\w+_\d)"', "".join(parts))][int(random.integers(0, number))]
        shape = f"<{random.choice(['collision', 'visual'])}>"
        size = " ".join(f"{each:.3f}" for each in random.uniform(0.0, 0.1, 3).round(2))
        body = (
            f'{shape}<geometry><box size="{size}"/></geometry>{shape.replace("<", "</")}'
            if random.random() < 0.7
            else ""
        )
        kind = random.choice(["revolute", "continuous", "prismatic", "fixed", "floating"])
        mimic = '<mimic joint="l0"/>' if random.random() < 0.1 else ""
        if number > 1 and random.random() < 0.3:
            mimic = f'<mimic joint="j{int(random.integers(1, number))}" multiplier="-1"/>'
        low, high = sorted(random.uniform(-2.0, 2.0, 2).round(int(random.integers(0, 3))))
        axis = random.choice(["1 0 0", "0 1 0", "0 0 -1", "1 1 0"])
        offset = " ".join(map(str, random.uniform(-0.1, 0.1, 3).round(2)))
        parts.append(
            f'<link name="{name}">{body}</link><joint name="j{number}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{name}"/><origin xyz="{offset}"/><axis xyz="{axis}"/>{mimic}'
            f'<limit lower="{low}" upper="{high}" effort="1" velocity="1"/></joint>'
        )
    with TemporaryDirectory() as folder:
        model = load_model(written(Path(folder), f'<robot name="r">{"".join(parts)}</robot>'))
    for gripper in model.grippers:
        assert gripper.max_opening_m >= 0.0
        assert (gripper.type is GripperType.PARALLEL) == (gripper.max_opening_m > 0.0)
        assert drives.finger_links_by_finger(model, gripper)


# -- bases that joints move --------------------------------------------------------------------------------------------


def test_joints_that_move_the_whole_robot_become_one_planar_joint(tmp_path: Path) -> None:
    order = (("x", "prismatic", "1 0 0"), ("y", "prismatic", "0 1 0"), ("yaw", "continuous", "0 0 1"))
    joints, parent = "", "odom"
    for name, kind, axis in order:
        child = "a" if name == "yaw" else f"moved_{name}"
        joints += (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
            '<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
        )
        parent = child
    links = "".join(f'<link name="{name}"/>' for name in ("odom", "moved_x", "moved_y"))
    model = load_model(written(tmp_path, TWO_LINKS.replace("</robot>", f"{links}{joints}</robot>")))
    assert (model.base.type, model.root) == (BaseType.PLANAR, "a")
    assert [joint.name for joint in model.joints] == ["turn"]
    assert any("instead of by x, y, yaw" in note.text for note in model.notes)


def test_one_slide_is_a_rail_and_no_driving_base(tmp_path: Path) -> None:
    text = MJCF.replace('<joint name="r:y" type="slide" axis="0 1 0"/>', "")
    model = load_model(written(tmp_path, text, "rail.xml"))
    assert model.base.type is BaseType.FIXED
    assert [joint.name for joint in model.actuated_joints] == ["x", "pan", "tilt"]


# -- self-collisions ---------------------------------------------------------------------------------------------------


def channel() -> str:
    """An OBJ file: a back plate and two side walls, open to the front; its hull is the whole box."""
    boxes = (
        ((-0.11, -0.09), (-0.15, 0.15)),
        ((-0.11, 0.1), (-0.15, -0.13)),
        ((-0.11, 0.1), (0.13, 0.15)),
    )
    meshes = [trimesh.creation.box(bounds=np.array([[x0, y0, -0.1], [x1, y1, 0.1]])) for (x0, x1), (y0, y1) in boxes]
    return trimesh.util.concatenate(meshes).export(file_type="obj")


IN_A_CHANNEL = """
<robot name="r">
  <link name="base">{box}</link>
  <link name="torso"><collision><geometry><mesh filename="channel.obj"/></geometry></collision></link>
  <link name="pan"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>
  <link name="bar">
    <collision><origin xyz="0.1 0 0"/><geometry><box size="0.2 0.02 0.02"/></geometry></collision>
  </link>
  {more}
  <joint name="up" type="fixed"><parent link="base"/><child link="torso"/><origin xyz="0 0 0.5"/></joint>
  <joint name="turn" type="revolute"><parent link="torso"/><child link="pan"/><axis xyz="0 0 1"/>{limit}</joint>
  <joint name="nod" type="revolute"><parent link="pan"/><child link="bar"/><axis xyz="0 1 0"/>{limit}</joint>
</robot>
"""
LIMIT = '<limit lower="-1.2" upper="1.2" effort="1" velocity="1"/>'


def arm_in_a_channel(folder: Path) -> str:
    """A robot whose arm moves in the hollow of its torso; writes the mesh of that."""
    (folder / "channel.obj").write_text(channel())
    small, more = BOX.replace("0.1 0.1 0.1", "0.02 0.02 0.02"), ""
    for parent, child in pairwise(("bar", "l1", "l2", "l3")):
        more += (
            f'<link name="{child}">{small}</link><joint name="{child}_j" type="revolute"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="0.2 0 0"/><axis xyz="0 1 0"/>{LIMIT}</joint>'
        )
    return IN_A_CHANNEL.format(box=BOX, more=more, limit=LIMIT)


def test_an_arm_moves_in_the_hollow_of_a_torso_and_not_through_its_walls(tmp_path: Path) -> None:
    path = written(tmp_path, arm_in_a_channel(tmp_path))
    hull = load_model(path, cache=tmp_path / "cache")
    assert ("bar", "torso") in hull.disabled_collisions, "they always touch by their hulls, as for MoveIt"
    model = load_model(path, cache=tmp_path / "cache", divide=True)
    assert any(note.subject == "bar, torso" and "divided" in note.text for note in model.notes)
    assert ("bar", "torso") not in model.disabled_collisions
    sim = Simulation(KnowledgeBase(), engine=MujocoEngine())
    checker = CollisionChecker(add_robot(sim, model))
    assert checker.find_at({"turn": 0.0}) is None
    assert checker.find_at({"turn": 0.4}) is None
    hit = checker.find_at({"turn": 1.0})
    assert hit is not None
    assert {str(hit.part), str(hit.obstacle)} == {"bar", "torso"}
    sim.close()


def test_what_touches_is_computed_once_for_each_robot_unless_the_file_is_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed = list[int]()
    original = reading.touching_shares

    def counted(*args: object, **options: object) -> dict[tuple[str, str], float]:
        computed.append(1)
        return original(*args, **options)  # type: ignore[arg-type]

    monkeypatch.setenv("MINDSTAGE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(reading, "touching_shares", counted)
    text = arm_in_a_channel(tmp_path)
    first, again = (load_model(written(tmp_path, text)) for _ in range(2))
    known = len(computed)
    assert known > 0
    assert (first.disabled_collisions, first.notes) == (again.disabled_collisions, again.notes)
    turned = load_model(written(tmp_path, text.replace('lower="-1.2" upper="1.2"', 'lower="1.1" upper="1.2"', 1)))
    assert len(computed) == known + 1, "another range of a joint"
    assert turned.joints != first.joints
    for file in (tmp_path / "cache" / "self-contacts").iterdir():
        file.write_bytes(b"[[")
    assert load_model(written(tmp_path, text)).disabled_collisions == first.disabled_collisions
    assert len(computed) == known + 2


# -- the catalog -------------------------------------------------------------------------------------------------------


def test_every_installed_model_is_read() -> None:
    installed = [model for model in list_models() if model.is_installed]
    assert len(installed) >= 18
    for each in installed:
        assert known_model(each.name).name == each.name
    assert len({each.name for each in list_models()}) == len(list_models())


def test_a_model_that_is_not_installed_names_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise catalog.PackageNotFoundError(name)

    monkeypatch.setattr(catalog, "distribution", missing)
    with pytest.raises(RobotNotFoundError, match="pip install example-robot-data"):
        find_model("panda")
    assert find_model("mobile_manipulator").path.is_file()


def test_an_unknown_name_lists_what_is_near() -> None:
    with pytest.raises(RobotNotFoundError, match="near: panda"):
        find_model("pandas")
    with pytest.raises(RobotModelError, match="give the path of a URDF, xacro or MJCF file"):
        load_model(Path("/nowhere/robot.urdf"))
    with pytest.raises(RobotNotFoundError, match="the file does not exist"):
        find_model("/nowhere/robot.urdf")


def test_a_description_is_found_by_name_in_a_folder(tmp_path: Path) -> None:
    folder = tmp_path / "pair_description" / "urdf"
    folder.mkdir(parents=True)
    path = written(folder, TWO_LINKS, "pair.urdf")
    assert find_model("pair", folders=[tmp_path]).path == path
    assert load_model("pair", folders=[tmp_path]).name == "pair"


def test_the_code_of_the_document_prints_what_it_says() -> None:
    text = (Path(__file__).parents[3] / "docs" / "how-to" / "robot-models.md").read_text(encoding="utf-8")
    code = "\n".join(re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL))
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert run.returncode == 0, run.stderr
    said = re.findall(r"  # (.*)$", code, re.MULTILINE)
    assert run.stdout.splitlines()[: len(said)] == said
    names = {name for row in re.findall(r"^\| `[a-z-]+` \| (.*) \|$", text, re.MULTILINE) for name in row.split(", ")}
    assert {name.strip("`") for name in names} == {model.name for model in list_models() if model.package}
