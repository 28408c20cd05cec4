"""The cache of glTF files: one complete file for each key, and a limit of the total size."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mindstage.assets.cache import cache_geometry_glb, geometry_cache_dir
from mindstage.errors import CacheError
from mindstage.scene import BodyGeometry, PbrMaterial, VisualMesh

VISUAL = VisualMesh(
    points=np.array([[1.0, 0, 0], [0, 2, 0], [0, 0, 3], [0, 0, 0]]),
    faces=np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]], dtype=np.uint32),
    material=PbrMaterial(color=(1.0, 0.0, 0.0), roughness=0.25),
)
GEOMETRY = BodyGeometry(key="00112233445566778899aabb", visuals=(VISUAL,), collision_shapes=())


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return geometry_cache_dir()


def test_cached_geometry_has_godots_axes(folder: Path) -> None:
    name = cache_geometry_glb(GEOMETRY)
    assert name == "00112233445566778899aabb.glb"
    scene = trimesh.load(folder / name)
    np.testing.assert_allclose(scene.bounds, [[-2.0, 0.0, -1.0], [0.0, 3.0, 0.0]], atol=1e-6)
    assert [path.name for path in folder.iterdir()] == [name]


def test_an_existing_file_is_not_written_again(folder: Path) -> None:
    path = folder / cache_geometry_glb(GEOMETRY)
    path.write_bytes(b"as it was")
    assert cache_geometry_glb(GEOMETRY) == path.name
    assert path.read_bytes() == b"as it was"


@pytest.mark.parametrize("key", ["", "../../up", "0011", "G" * 16, "a" * 65])
def test_geometry_without_a_digest_gets_no_file(key: str, folder: Path) -> None:
    assert cache_geometry_glb(replace(GEOMETRY, key=key)) == ""
    assert list(folder.parent.rglob("*.glb")) == []


def test_geometry_without_visual_meshes_gets_no_file(folder: Path) -> None:
    assert cache_geometry_glb(replace(GEOMETRY, visuals=())) == ""
    assert list(folder.iterdir()) == []


def test_the_least_recently_used_files_are_deleted(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = [cache_geometry_glb(replace(GEOMETRY, key=f"{number:016x}")) for number in range(4)]
    for age, name in enumerate(names):
        os.utime(folder / name, (1000.0 + age, 1000.0 + age))
    cache_geometry_glb(replace(GEOMETRY, key=f"{0:016x}"))  # just used
    size = (folder / names[0]).stat().st_size
    monkeypatch.setattr("mindstage.assets.cache._MAX_BYTES", 3 * size)
    newest = cache_geometry_glb(replace(GEOMETRY, key=f"{9:016x}"))
    assert {path.name for path in folder.iterdir()} == {names[0], names[3], newest}


def test_a_full_disk_is_an_error_that_names_the_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(CacheError, match=r"the cache .* cannot be written: No space left on device; free space"):
        cache_geometry_glb(GEOMETRY)
    assert not list(folder.iterdir())
    monkeypatch.undo()
