"""Meshes of links: hulls for contacts, visual meshes on demand, in a process of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from mindstage.assets.mesh_import import _MeshWorker, import_meshes
from mindstage.robots.models.link_geometry import hull_shape
from mindstage.robots.models.reading import load_model
from mindstage.scene import CollisionShapeType
from mindstage.scene.mesh import convex_hull
from tests.robots.models.installed import known_model


def l_shape() -> trimesh.Trimesh:
    """A concave mesh: two plates of 1 x 1 x 0.1 m at a right angle."""
    floor = trimesh.creation.box(extents=(1.0, 1.0, 0.1))
    wall = trimesh.creation.box(extents=(0.1, 1.0, 1.0))
    wall.apply_translation((-0.45, 0.0, 0.55))
    joined = trimesh.util.concatenate([floor, wall])
    assert isinstance(joined, trimesh.Trimesh)
    return joined


def test_a_mesh_may_be_one_hull_without_its_visuals(tmp_path: Path) -> None:
    path = tmp_path / "angle.stl"
    l_shape().export(path)
    options = {"folder": tmp_path / "cache", "decompose": False, "keep_axes": True}
    hulls, rejected = import_meshes([path], visuals=False, **options)  # type: ignore[arg-type]
    assert not rejected
    mesh = hulls[path]
    assert mesh.visuals == ()
    assert len(mesh.convex_parts) == 1
    hull = convex_hull(mesh.convex_parts[0])
    assert hull is not None
    assert hull.moments()[0] == pytest.approx(l_shape().convex_hull.volume, rel=1e-3)
    complete = import_meshes([path], **options)[0][path]  # type: ignore[arg-type]
    assert sum(len(visual.faces) for visual in complete.visuals) == 24
    # STL repeats the corners of every triangle; these are merged, and so are two that both plates have.
    assert sum(len(visual.points) for visual in complete.visuals) == 14
    np.testing.assert_allclose(complete.low, mesh.low, atol=1e-6)


def test_files_that_are_likely_next_are_imported_by_the_same_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[object] = []
    start = _MeshWorker.__init__
    monkeypatch.setattr(_MeshWorker, "__init__", lambda self: (started.append(self), start(self))[1])
    paths = [tmp_path / f"{name}.stl" for name in ("first", "second", "broken", "absent")]
    for size, path in enumerate(paths[:2], 1):
        trimesh.creation.box(extents=(size, 1.0, 1.0)).export(path)
    paths[2].write_bytes(b"solid nothing")
    options = {"folder": tmp_path / "cache", "decompose": False, "likely_next": paths}
    imported, rejected = import_meshes(paths[:1], **options)  # type: ignore[arg-type]
    assert (list(imported), rejected) == (paths[:1], {})
    imported, rejected = import_meshes(paths[1:], **options)  # type: ignore[arg-type]
    assert list(imported) == paths[1:2]
    assert imported[paths[1]].high[0] - imported[paths[1]].low[0] == pytest.approx(2.0)
    assert list(rejected) == [paths[3], paths[2]] or list(rejected) == [paths[2], paths[3]]
    assert "tried again" not in rejected[paths[2]]
    assert len(started) == 1


def test_the_visual_meshes_of_a_robot_are_imported_by_one_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[object] = []
    start = _MeshWorker.__init__
    monkeypatch.setattr(_MeshWorker, "__init__", lambda self: (started.append(self), start(self))[1])
    names = ("a", "b", "c")
    for size, name in enumerate(names, 1):
        trimesh.creation.box(extents=(size, 1.0, 1.0)).export(tmp_path / f"{name}.stl")
    links = (f'<link name="{each}"><visual><geometry><mesh filename="{each}.stl"/></geometry></visual></link>'
             for each in names)  # fmt: skip
    joints = (f'<joint name="to_{each}" type="fixed"><parent link="a"/><child link="{each}"/></joint>'
              for each in names[1:])  # fmt: skip
    (tmp_path / "r.urdf").write_text(f"<robot name='r'>{''.join((*links, *joints))}</robot>", encoding="utf-8")
    model = load_model(tmp_path / "r.urdf", cache=tmp_path / "cache")
    assert not started, "nothing is drawn yet"
    widths = [np.ptp(link.geometry.visuals[0].points, axis=0)[0] for link in model.links if link.geometry]
    assert widths == pytest.approx([1.0, 2.0, 3.0])
    assert len(started) == 1


def test_a_decomposed_mesh_is_imported_apart_from_its_hull(tmp_path: Path) -> None:
    path = tmp_path / "angle.stl"
    l_shape().export(path)
    one = import_meshes([path], folder=tmp_path / "cache", decompose=False)[0][path]
    several = import_meshes([path], folder=tmp_path / "cache")[0][path]
    assert len(one.convex_parts) == 1
    assert len(several.convex_parts) >= 2


def test_the_axes_of_a_collada_file_are_kept_if_asked(tmp_path: Path) -> None:
    path = tmp_path / "plate.glb"
    trimesh.creation.box(extents=(1.0, 2.0, 3.0)).export(path)
    kept = import_meshes([path], folder=tmp_path / "cache", keep_axes=True)[0][path]
    turned = import_meshes([path], folder=tmp_path / "cache")[0][path]
    np.testing.assert_allclose(kept.high - kept.low, (1.0, 2.0, 3.0), atol=1e-6)
    np.testing.assert_allclose(turned.high - turned.low, (3.0, 1.0, 2.0), atol=1e-6)


def test_a_hull_has_few_points_and_the_same_bounds() -> None:
    random = np.random.default_rng(1)
    points = random.normal(size=(5000, 3)) * (1.0, 0.2, 0.02) + (3.0, 0.0, -1.0)
    shape = hull_shape(points)
    assert shape is not None
    assert shape.type is CollisionShapeType.HULL
    assert len(shape.points) <= 96
    corners = np.array(shape.points) + shape.pose.position
    np.testing.assert_allclose(corners.min(axis=0), points.min(axis=0), atol=1e-12)
    np.testing.assert_allclose(corners.max(axis=0), points.max(axis=0), atol=1e-12)


def test_flat_points_are_a_box_and_none_are_nothing() -> None:
    flat = hull_shape(np.array([[0, 0, 1], [2, 0, 1], [2, 1, 1], [0, 1, 1]], dtype=float))
    assert flat is not None
    assert (flat.type, flat.size) == (CollisionShapeType.BOX, (2.0, 1.0, 0.0))
    assert hull_shape(np.zeros((0, 3))) is None


def test_hulls_of_a_real_arm_are_near_its_meshes() -> None:
    """The volume of the hull of each link of a Panda differs by at most 6 % from that of its visual mesh's hull."""
    model = known_model("panda")
    compared = 0
    for link in model.links:
        if link.geometry is None or len(link.geometry.collision_shapes) != 1:
            continue
        reduced = convex_hull(np.array(link.geometry.collision_shapes[0].points))
        drawn = convex_hull(np.concatenate([visual.points for visual in link.geometry.visuals]))
        assert reduced is not None
        assert drawn is not None
        assert reduced.moments()[0] == pytest.approx(drawn.moments()[0], rel=0.06), link.name
        compared += 1
    assert compared >= 9


def test_a_mesh_that_cannot_be_read_is_noted_and_left_out(tmp_path: Path) -> None:
    (tmp_path / "broken.stl").write_bytes(b"solid nothing")
    mesh = '<geometry><mesh filename="broken.stl"/></geometry>'
    path = tmp_path / "robot.urdf"
    path.write_text(
        f'<robot name="r"><link name="a"><visual>{mesh}</visual><collision>{mesh}</collision></link></robot>'
    )
    model = load_model(path, cache=tmp_path / "cache")
    (note,) = (note for note in model.notes if note.subject == "a")
    assert "broken.stl is left out" in note.text
    geometry = model.links[0].geometry
    assert geometry is not None
    assert geometry.collision_shapes == ()
    assert geometry.visuals == ()
