"""Geometry from mesh files of others: found, scaled to the body's size, and safe to import."""

import json
import os
import pickle
import struct
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from msgspec.structs import replace
from PIL import Image

from mindstage.assets import MeshLibrary, mesh_import
from mindstage.assets.mesh_import import _MeshWorker, import_meshes
from mindstage.scene import Body, BodyGeometry, BodyId, CollisionShapeType, GeometrySource, Iri, Pose, Vector
from mindstage.scene.collision_shapes import compile_geometry

MUG = (0.08, 0.1, 0.12)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "assets"
    made.mkdir()
    return made


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    made = tmp_path / "cache"
    made.mkdir()
    return made


def body(mesh: str | None = None, size: Vector | None = MUG, cls: str = "Mug") -> Body:
    iri = Iri("http://example.org/kitchen#Thing")
    return Body(
        id=BodyId("Thing"), iri=iri, cls=Iri(f"http://example.org/home#{cls}"), pose=Pose(), mesh=mesh, size=size
    )


def block(extents: Vector = MUG, at: Vector = (0.0, 0.0, 0.0)) -> trimesh.Trimesh:
    made = trimesh.creation.box(extents)
    made.apply_translation(at)
    return made


def geometry_for(folder: Path, cache: Path, of: Body, **more: object) -> tuple[BodyGeometry | None, str]:
    found = MeshLibrary([folder], cache=cache, **more).geometry_for([of])  # type: ignore[arg-type]
    return found.geometry.get(of.id), " | ".join(found.notes)


def extents(geometry: BodyGeometry) -> np.ndarray:
    points = np.concatenate([visual.points for visual in geometry.visuals])
    return np.ptp(points, axis=0)


def center(geometry: BodyGeometry) -> np.ndarray:
    points = np.concatenate([visual.points for visual in geometry.visuals])
    return (points.min(axis=0) + points.max(axis=0)) / 2


# -- finding files -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("file", "mesh_name", "by"),
    [
        ("things/cups/mug.stl", "package://home_meshes/things/cups/mug.stl", "path"),
        ("Things/Cups/MUG.STL", "package://home_meshes/things/cups/mug.stl", "path"),
        ("elsewhere/mug.stl", "package://home_meshes/things/cups/mug.dae", "name"),
        ("SM_BlueMug.stl", "BlueMug", "name"),
        ("bluemug.stl", "/Game/Kitchen/SM_BlueMug.SM_BlueMug".rpartition(".")[0], "name"),
        ("deep/below/sm_mug.stl", None, "class"),
        ("mug.stl", "NoSuchThing", "class"),
    ],
)
def test_a_mesh_is_found_by_its_path_then_its_name_then_its_class(
    folder: Path, cache: Path, file: str, mesh_name: str | None, by: str
) -> None:
    path = folder / file
    path.parent.mkdir(parents=True, exist_ok=True)
    block().export(path, file_type="stl")
    geometry, notes = geometry_for(folder, cache, body(mesh_name))
    assert geometry is not None
    assert geometry.source is GeometrySource.MESH
    assert geometry.reason == f"the mesh {path.name}, found by its {by}"
    assert not notes


def test_a_file_resolved_by_the_map_takes_precedence(folder: Path, cache: Path, tmp_path: Path) -> None:
    block().export(folder / "mug.stl")
    neighbor = tmp_path / "beside.stl"
    block().export(neighbor)
    geometry, _ = geometry_for(
        folder, cache, body("beside.stl"), find_file=lambda name: neighbor if name == "beside.stl" else None
    )
    assert geometry is not None
    assert "beside.stl" in geometry.reason


def test_the_format_with_the_best_materials_takes_precedence(folder: Path, cache: Path) -> None:
    for suffix in (".stl", ".obj", ".glb"):
        block().export(folder / f"mug{suffix}")
    geometry, _ = geometry_for(folder, cache, body())
    assert geometry is not None
    assert "mug.glb" in geometry.reason


def test_a_body_without_a_file_has_no_geometry(folder: Path, cache: Path) -> None:
    assert geometry_for(folder, cache, body("Cup", cls="Cup")) == (None, "")


# -- size and position ------------------------------------------------------------------------------------------------


def test_a_mesh_that_fits_is_not_changed(folder: Path, cache: Path) -> None:
    block().export(folder / "mug.stl")
    geometry, notes = geometry_for(folder, cache, body())
    assert geometry is not None
    assert extents(geometry) == pytest.approx(MUG, abs=1e-7)
    assert not notes


def test_a_mesh_is_scaled_and_centered_to_the_size_and_this_is_reported(folder: Path, cache: Path) -> None:
    block((8.0, 10.0, 12.0), at=(30.0, 0.0, 6.0)).export(folder / "mug.stl")
    geometry, notes = geometry_for(folder, cache, body())
    assert geometry is not None
    assert extents(geometry) == pytest.approx(MUG, abs=1e-6)
    assert center(geometry) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    assert "Thing: the mesh mug.stl is scaled by 0.01 to the map's size" in notes
    assert "is moved" in notes
    (shape,) = geometry.collision_shapes
    assert shape.type is CollisionShapeType.HULL
    assert shape.size == pytest.approx(MUG, abs=1e-6)


@pytest.mark.parametrize(
    ("count", "names"), [(1, "t0"), (3, "t0, t1, t2"), (4, "t0, t1, t2 and 1 more"), (6, "t0, t1, t2 and 3 more")]
)
def test_a_change_to_the_mesh_of_several_bodies_is_reported_once(
    folder: Path, cache: Path, count: int, names: str
) -> None:
    block((8.0, 10.0, 12.0)).export(folder / "mug.stl")
    bodies = [replace(body(), id=BodyId(f"t{number}")) for number in range(count)]
    (note,) = MeshLibrary([folder], cache=cache).geometry_for(bodies).notes
    assert note == f"{names}: the mesh mug.stl is scaled by 0.01 to the map's size"


def test_without_a_size_a_mesh_keeps_its_origin(folder: Path, cache: Path) -> None:
    block(at=(0.0, 0.0, 0.06)).export(folder / "mug.stl")
    geometry, notes = geometry_for(folder, cache, body(size=None))
    assert geometry is not None
    assert center(geometry) == pytest.approx((0.0, 0.0, 0.06), abs=1e-6)
    assert not notes


def test_a_file_without_an_up_axis_is_rotated_only_if_that_fits(folder: Path, cache: Path) -> None:
    block((0.08, 0.12, 0.1)).export(folder / "mug.obj")
    geometry, notes = geometry_for(folder, cache, body())
    assert geometry is not None
    assert extents(geometry) == pytest.approx(MUG, abs=1e-6)
    assert "is rotated from y up to z up" in notes
    assert "scaled" not in notes


def test_gltf_has_y_up_and_z_forward(folder: Path, cache: Path) -> None:
    """An arrow along glTF's z with a fin along y is imported along x, with its fin along z."""
    block((0.1, 0.12, 0.08)).export(folder / "mug.glb")
    geometry, notes = geometry_for(folder, cache, body())
    assert geometry is not None
    assert extents(geometry) == pytest.approx(MUG, abs=1e-6)
    assert not notes


def test_the_normals_of_a_stretched_mesh_stay_perpendicular_to_its_surface(folder: Path, cache: Path) -> None:
    """A sphere that its node stretches is an ellipsoid, whose normals are known."""
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    scene = trimesh.Scene()
    stretched = np.diag((0.5, 1.0, 2.0, 1.0))
    assert sphere.vertex_normals.shape == sphere.vertices.shape
    scene.add_geometry(sphere, transform=stretched)
    scene.export(folder / "mug.glb", include_normals=True)
    geometry, _ = geometry_for(folder, cache, body(size=None))
    assert geometry is not None
    (visual,) = geometry.visuals
    assert visual.normals is not None
    radii = np.ptp(visual.points, axis=0) / 2
    assert sorted(radii) == pytest.approx((0.5, 1.0, 2.0), abs=1e-6)
    gradient = visual.points / radii**2
    expected = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    assert np.abs(np.sum(visual.normals * expected, axis=1) - 1.0).max() < 2e-3


def test_collada_states_its_up_axis(folder: Path, cache: Path) -> None:
    text = COLLADA.replace("UP", "Z_UP")
    (folder / "mug.dae").write_text(text)
    geometry, notes = geometry_for(folder, cache, body(size=(1.0, 2.0, 3.0)))
    assert geometry is not None, notes
    assert extents(geometry) == pytest.approx((1.0, 2.0, 3.0))
    (folder / "mug.dae").write_text(COLLADA.replace("UP", "Y_UP"))
    geometry, notes = geometry_for(folder, cache, body(size=(3.0, 1.0, 2.0)))
    assert geometry is not None, notes
    assert extents(geometry) == pytest.approx((3.0, 1.0, 2.0))
    assert "scaled" not in notes


# -- visual meshes ----------------------------------------------------------------------------------------------------


def test_colors_and_textures_are_imported(folder: Path, cache: Path) -> None:
    checkers = np.zeros((8, 8, 3), dtype=np.uint8)
    checkers[::2, ::2] = (250, 120, 10)
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] * 2)
    material = trimesh.visual.material.PBRMaterial(
        baseColorTexture=Image.fromarray(checkers), metallicFactor=0.25, roughnessFactor=0.5
    )
    textured = block()
    textured.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    textured.export(folder / "mug.glb")
    geometry, _ = geometry_for(folder, cache, body(size=None))
    assert geometry is not None
    (visual,) = geometry.visuals
    assert visual.image is not None
    assert visual.uv is not None
    assert visual.image.shape == (8, 8, 4)
    assert tuple(visual.image[0, 0]) == (250, 120, 10, 255)
    assert (visual.material.metalness, visual.material.roughness) == (0.25, 0.5)


def test_faces_of_several_colors_become_several_visual_meshes(folder: Path, cache: Path) -> None:
    (folder / "mug.mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\nd 0.5\n")
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    (folder / "mug.obj").write_text(
        f"mtllib mug.mtl\n{corners}usemtl red\nf 1 3 2\nf 1 2 4\nusemtl blue\nf 1 4 3\nf 2 3 4\n"
    )
    geometry, _ = geometry_for(folder, cache, body(size=None))
    assert geometry is not None
    assert sorted((visual.material.color, len(visual.faces)) for visual in geometry.visuals) == [
        ((0.0, 0.0, 1.0), 2),
        ((1.0, 0.0, 0.0), 2),
    ]


# -- collision shapes --------------------------------------------------------------------------------------------------


def test_an_open_box_is_decomposed_into_convex_parts_with_space_inside(folder: Path, cache: Path) -> None:
    pytest.importorskip("coacd")
    tray = trimesh.util.concatenate([
        block((0.4, 0.4, 0.02), at=(0.0, 0.0, -0.09)),
        block((0.02, 0.4, 0.2), at=(0.19, 0.0, 0.0)),
        block((0.02, 0.4, 0.2), at=(-0.19, 0.0, 0.0)),
        block((0.36, 0.02, 0.2), at=(0.0, 0.19, 0.0)),
        block((0.36, 0.02, 0.2), at=(0.0, -0.19, 0.0)),
    ])  # fmt: skip
    tray.export(folder / "tray.stl")
    geometry, _ = geometry_for(folder, cache, body(size=(0.4, 0.4, 0.2), cls="Tray"))
    assert geometry is not None
    assert 4 < len(geometry.collision_shapes) <= 24
    inside = [
        all(abs(center) < half for center, half in zip(shape.pose.position, np.array(shape.size) / 2, strict=True))
        for shape in geometry.collision_shapes
    ]
    assert not any(inside), "a part fills the space inside the tray"
    corners = np.array(
        [np.add(point, shape.pose.position) for shape in geometry.collision_shapes for point in shape.points]
    )
    assert np.abs(corners).max(axis=0) == pytest.approx((0.2, 0.2, 0.1)), "no part protrudes from the tray"


def test_what_a_mesh_is_built_of_is_kept_where_it_is_convex(folder: Path, cache: Path) -> None:
    """Each board of a rack is a part, with its extents; screws, and a plug within a board, are none."""
    pytest.importorskip("coacd")
    boards = [((0.02, 0.3, 0.8), (-0.29, 0, 0)), ((0.02, 0.3, 0.8), (0.29, 0, 0))]
    boards += [((0.56, 0.3, 0.02), (0, 0, z)) for z in (-0.39, 0.0, 0.35)]
    small = [((0.012, 0.012, 0.012), (0.29, 0.1, 0.2)), ((0.01, 0.2, 0.01), (-0.29, 0, 0))]
    rack = trimesh.util.concatenate([block(size, at) for size, at in boards + small])
    rack.export(folder / "rack.stl")
    geometry, _ = geometry_for(folder, cache, body(size=(0.6, 0.3, 0.8), cls="Rack"))
    assert geometry is not None
    found = sorted(np.round((*each.size, *each.pose.position), 4).tolist() for each in geometry.collision_shapes)
    np.testing.assert_allclose(found, sorted([*size, *at] for size, at in boards), atol=2e-4)


def test_a_pipe_of_one_piece_stays_hollow_and_a_dented_block_is_one_part(folder: Path, cache: Path) -> None:
    pytest.importorskip("coacd")
    trimesh.creation.annulus(r_min=0.08, r_max=0.1, height=0.2).export(folder / "pipe.stl")
    geometry, _ = geometry_for(folder, cache, body(size=None, cls="Pipe"))
    assert geometry is not None
    assert compile_geometry(geometry.collision_shapes).volume < 0.7 * np.pi * 0.1**2 * 0.2
    dented = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    dented.vertices[np.argmax(dented.vertices[:, 2])] *= 0.96
    dented.export(folder / "stone.stl")
    geometry, _ = geometry_for(folder, cache, body(size=None, cls="Stone"))
    assert geometry is not None
    assert len(geometry.collision_shapes) == 1


def test_a_hull_has_the_extents_of_its_mesh(folder: Path, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mindstage.assets.mesh_import._can_decompose", lambda: False)
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    ball.export(folder / "ball.stl")
    geometry, _ = geometry_for(folder, cache, body(size=(0.1, 0.1, 0.1), cls="Ball"))
    assert geometry is not None
    (shape,) = geometry.collision_shapes
    assert shape.size == pytest.approx((0.1, 0.1, 0.1), rel=0.01)
    assert 100 < len(shape.points) < 600


def test_the_hull_of_a_tilted_cylinder_has_the_volume_of_the_cylinder(
    folder: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """STL files have single precision, so the corners of a cap are not exactly in one plane."""
    monkeypatch.setattr("mindstage.assets.mesh_import._can_decompose", lambda: False)
    tilted = trimesh.creation.cylinder(radius=0.03, height=0.2, sections=32)
    tilted.apply_transform(trimesh.transformations.rotation_matrix(0.7, (0.3, 0.9, 0.2), (1.0, 2.0, 3.0)))
    tilted.export(folder / "mug.stl")
    geometry, _ = geometry_for(folder, cache, body(size=None))
    assert geometry is not None
    assert compile_geometry(geometry.collision_shapes).volume == pytest.approx(tilted.volume, rel=1e-3)


# -- cache -------------------------------------------------------------------------------------------------------------


def test_an_imported_file_is_loaded_from_the_cache(folder: Path, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    block().export(folder / "mug.stl")
    first, _ = geometry_for(folder, cache, body())

    def no_process(*_: object, **__: object) -> None:
        raise AssertionError("a process was started")

    monkeypatch.setattr("mindstage.assets.mesh_import.subprocess", SimpleNamespace(Popen=no_process))
    again, _ = geometry_for(folder, cache, body())
    assert first is not None
    assert again is not None
    assert first.key == again.key
    assert np.array_equal(first.visuals[0].points, again.visuals[0].points)


def test_two_processes_may_import_a_file_at_the_same_time(
    folder: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    block().export(folder / "cup.stl")
    read, written = _MeshWorker.read, []

    def read_in_two_processes(worker: _MeshWorker, path: Path, out: Path, **options: Any) -> Any:
        if not written:  # another process imports the same file, and has not ended yet
            written.append(out)
            import_meshes([path], folder=cache)
            assert not out.exists(), "it writes to another file"
        written.append(out)
        return read(worker, path, out, **options)

    monkeypatch.setattr(_MeshWorker, "read", read_in_two_processes)
    imported, rejected = import_meshes([folder / "cup.stl"], folder=cache)
    assert (list(imported), rejected) == ([folder / "cup.stl"], {})
    assert len(set(written)) == 2
    assert [each.suffix for each in cache.iterdir()] == [".npz"]


def test_a_changed_file_is_imported_again(folder: Path, cache: Path) -> None:
    block().export(folder / "mug.stl")
    first, _ = geometry_for(folder, cache, body(size=None))
    block((0.2, 0.2, 0.2)).export(folder / "mug.stl")
    again, _ = geometry_for(folder, cache, body(size=None))
    assert first is not None
    assert again is not None
    assert first.key != again.key
    assert extents(again) == pytest.approx((0.2, 0.2, 0.2), abs=1e-6)


def test_a_corrupt_cache_file_is_replaced(folder: Path, cache: Path) -> None:
    block().export(folder / "mug.stl")
    geometry_for(folder, cache, body())
    for cached in cache.iterdir():
        cached.write_bytes(b"PK\x03\x04 but no more than that")
    geometry, notes = geometry_for(folder, cache, body())
    assert geometry is not None
    assert not notes


@pytest.mark.parametrize(
    ("ends", "why"),
    [("time.sleep(600)", "took longer than 10 s; remove "), ("os.abort()", "crashes the importer (SIGABRT); remove ")],
)
def test_a_mesh_whose_decomposition_fails_is_its_hull_with_the_reason_also_from_the_cache(
    ends: str, why: str, folder: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    worker = folder / "worker.py"
    worker.write_text(
        "import json, os, sys, time\n"
        "from mindstage.assets import mesh_worker\n"
        "def decompose(*_):\n"
        f"    {ends}\n"
        "mesh_worker._convex_parts = decompose\n"
        "sys.exit(mesh_worker.main())\n"
    )
    start = subprocess.Popen
    monkeypatch.setattr(
        "mindstage.assets.mesh_import.subprocess.Popen",
        lambda command, **options: start([command[0], str(worker)], **options),
    )
    monkeypatch.setattr(mesh_import, "_can_decompose", lambda: True)
    block().export(folder / "mug.stl")
    made = import_meshes([folder / "mug.stl"], folder=cache, timeout_s=10.0)[0][folder / "mug.stl"]
    assert len(made.convex_parts) == 1
    assert why in made.hull_reason
    geometry, notes = geometry_for(folder, cache, body())
    assert geometry is not None
    assert (
        f"nothing fits into hollows of mug.stl, whose collision shape is the convex hull: {made.hull_reason}" in notes
    )


def test_meshes_that_are_hulls_without_the_extra_for_decomposition_are_reported(
    folder: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    block().export(folder / "mug.stl")
    monkeypatch.setattr(mesh_import, "_can_decompose", lambda: False)
    for _ in range(2):  # imported, and from the cache
        assert "coacd is not installed (extra `pieces`)" in geometry_for(folder, cache, body())[1]
    monkeypatch.setattr(mesh_import, "_can_decompose", lambda: True)
    assert not geometry_for(folder, cache, body())[1]


# -- corrupt and malicious files ---------------------------------------------------------------------------------------


def stl_of_nothing() -> bytes:
    return b"\0" * 80 + struct.pack("<I", 0)


def stl_that_promises_much() -> bytes:
    return b"\0" * 80 + struct.pack("<I", 4_000_000_000)


def stl_of_no_numbers() -> bytes:
    return b"\0" * 80 + struct.pack("<I", 1) + struct.pack("<12f", *[float("nan")] * 12) + b"\0\0"


def gltf_that_reads_elsewhere() -> bytes:
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "../../../../../../etc/passwd", "byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    return json.dumps(document).encode()


def collada_that_explodes() -> bytes:
    entities = "".join(f'<!ENTITY e{n} "{f"&e{n - 1};" * 12}">' for n in range(1, 12))
    return f'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY e0 "boom">{entities}]><COLLADA>&e11;</COLLADA>'.encode()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("mug.stl", stl_of_nothing()),
        ("mug.stl", stl_that_promises_much()),
        ("mug.stl", stl_of_no_numbers()),
        ("mug.stl", b"solid but nothing of it"),
        ("mug.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99\n"),
        ("mug.obj", b"v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n"),
        ("mug.obj", os.urandom(4096)),
        ("mug.glb", b"glTF" + struct.pack("<II", 2, 2**31)),
        ("mug.gltf", gltf_that_reads_elsewhere()),
        ("mug.gltf", b"[" * 100_000),
        ("mug.dae", collada_that_explodes()),
        ("mug.dae", b"<COLLADA/>"),
    ],
)
def test_a_corrupt_or_malicious_file_is_rejected_by_name(folder: Path, cache: Path, name: str, content: bytes) -> None:
    (folder / name).write_bytes(content)
    block().export(folder / "cup.stl")
    cup = body(cls="Cup")
    found = MeshLibrary([folder], cache=cache).geometry_for([body(), Body(**{**fields(cup), "id": BodyId("Cup")})])
    assert set(found.geometry) == {"Cup"}, "other files are not affected"
    (note,) = found.notes
    assert f"the mesh {name} is left out: " in note


def answer_of(name: str, text: str, *, kind: str) -> str:
    """A line of a worker that answers a request."""
    answer = {"path": "", name: text, "kind": kind}
    return f"print({json.dumps(json.dumps(answer))}, flush=True)"


def test_a_file_that_crashes_the_worker_affects_no_other_file(
    folder: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A reader that hangs: a pipe instead of a file is rejected at once, and a slow import after its timeout."""
    os.mkfifo(folder / "mug.stl")
    block().export(folder / "cup.stl")
    with (folder / "cup.stl").open("rb") as file:
        assert file.read(1)
    imported, rejected = import_meshes([folder / "cup.stl"], folder=cache, timeout_s=0.0)
    assert not imported
    assert "longer than 0 s" in rejected[folder / "cup.stl"]
    assert "tried again next time" in rejected[folder / "cup.stl"]
    assert not list(cache.glob("*.rejected")), "a slow machine is no property of the file"
    assert import_meshes([folder / "cup.stl"], folder=cache)[0]


@pytest.mark.parametrize(
    ("end", "message", "remembered"),
    [
        ("os.kill(os.getpid(), 9)", "the importer was ended by SIGKILL; it is tried again next time", False),
        ("os.abort()", "it crashes the importer (SIGABRT)", True),
        ("sys.exit(3)", "the importer exited with 3; it is tried again next time", False),
        (answer_of("why", "no space", kind="cache"), "cannot be written: no space; free space, or set", False),
        (answer_of("why", "I/O error", kind="transient"), "I/O error; it is tried again next time", False),
        (answer_of("why", "no triangles", kind="file"), "no triangles", True),
    ],
)
def test_only_causes_in_the_file_are_remembered(
    end: str, message: str, remembered: bool, folder: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    block().export(folder / "cup.stl")
    worker = folder / "worker.py"
    worker.write_text(f"import json, os, sys\nsys.stdin.readline()\n{end}\n")
    start, started = subprocess.Popen, []
    monkeypatch.setattr(
        "mindstage.assets.mesh_import.subprocess.Popen",
        lambda command, **options: (started.append(1), start([command[0], str(worker)], **options))[1],
    )
    cache.mkdir(exist_ok=True)
    _, rejected = import_meshes([folder / "cup.stl"], folder=cache)
    assert message in rejected[folder / "cup.stl"]
    assert bool(list(cache.glob("*.rejected"))) is remembered
    started.clear()
    assert message in import_meshes([folder / "cup.stl"], folder=cache)[1][folder / "cup.stl"]
    assert (not started) is remembered


def test_files_are_imported_by_several_processes_at_once(
    folder: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each worker answers a request only when another one has begun with a request, too."""
    paths = [folder / f"cup{number}.stl" for number in range(4)]
    for path in paths:
        block().export(path)
    worker = folder / "worker.py"
    worker.write_text(MEETING_WORKER.format(folder=str(folder)))
    start = subprocess.Popen
    monkeypatch.setattr(
        "mindstage.assets.mesh_import.subprocess.Popen",
        lambda command, **options: start([command[0], str(worker)], **options),
    )
    monkeypatch.setattr("mindstage.assets.mesh_import.os.cpu_count", lambda: 2)
    calls: list[tuple[int, int]] = []
    imported, rejected = import_meshes(
        paths, folder=cache, timeout_s=60.0, decompose=False, progress=lambda done, total: calls.append((done, total))
    )
    assert not imported
    assert list(rejected) == paths, "in the order in which they were asked for"
    assert all("met the other" in reason for reason in rejected.values())
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_a_library_with_progress_can_be_sent_to_another_process(folder: Path, cache: Path) -> None:
    block().export(folder / "cup.stl")
    library = MeshLibrary([folder], find_file={}.get, cache=cache, progress=lambda done, total: None)
    cup = Body(id=BodyId("cup"), iri=Iri("http://x.org#cup"), cls=Iri("http://x.org#Cup"), pose=Pose())
    assert set(pickle.loads(pickle.dumps(library)).geometry_for([cup]).geometry) == {"cup"}


MEETING_WORKER = """
import json, os, pathlib, sys, time
folder, own = pathlib.Path({folder!r}), f"began.{{os.getpid()}}"
for line in sys.stdin:
    (folder / own).touch()
    end = time.monotonic() + 30
    while len(list(folder.glob("began.*"))) < 2 and time.monotonic() < end:
        time.sleep(0.01)
    why = "met the other" if len(list(folder.glob("began.*"))) == 2 else "is alone"
    print(json.dumps({{"path": "", "why": why, "kind": "file"}}), flush=True)
"""


def test_an_interrupted_import_leaves_no_process(folder: Path, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths = [folder / f"cup{number}.stl" for number in range(4)]
    for path in paths:
        block().export(path)
    start, processes = subprocess.Popen, []

    def record(command: list[str], **options: Any) -> Any:
        processes.append(start(command, **options))
        return processes[-1]

    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("mindstage.assets.mesh_import.subprocess.Popen", record)
    with pytest.raises(KeyboardInterrupt):
        import_meshes(paths, folder=cache, decompose=False, progress=interrupt)
    assert processes
    for process in processes:
        process.wait(timeout=20.0)


def fields(of: Body) -> dict[str, object]:
    return {name: getattr(of, name) for name in of.__struct_fields__}


COLLADA = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
 <asset><unit name="meter" meter="1"/><up_axis>UP</up_axis></asset>
 <library_geometries><geometry id="g"><mesh>
  <source id="p"><float_array id="a" count="12">0 0 0 1 0 0 0 2 0 0 0 3</float_array>
   <technique_common><accessor source="#a" count="4" stride="3">
    <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
   </accessor></technique_common></source>
  <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
  <triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
 </mesh></geometry></library_geometries>
 <library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node></visual_scene>
 </library_visual_scenes>
 <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
"""


def test_a_path_that_is_a_folder_is_rejected_with_the_reason_of_the_system(folder: Path, cache: Path) -> None:
    (folder / "mug.stl").mkdir()
    _, rejected = import_meshes([folder / "mug.stl"], folder=cache)
    assert rejected == {folder / "mug.stl": "Is a directory"}
