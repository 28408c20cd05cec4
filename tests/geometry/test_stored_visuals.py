"""Visual meshes on the disk: the same arrays as computed ones, valid for one version of the code."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mindstage.geometry.procedural import build
from mindstage.geometry.procedural.build import build_geometry, template_by_name
from mindstage.scene import BodyGeometry


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MINDSTAGE_CACHE", str(tmp_path))
    return tmp_path / "shapes"


def built_anew() -> BodyGeometry:
    """A printed carton, as a new process builds it."""
    build._build_cached.cache_clear()
    return build_geometry(template_by_name("carton", {"word": "Milk"}), (0.07, 0.07, 0.2))


def same_meshes(one: BodyGeometry, other: BodyGeometry) -> bool:
    def parts(geometry: BodyGeometry) -> list[object]:
        arrays = [(each.points, each.faces, each.normals, each.uv, each.image) for each in geometry.visuals]
        return [None if array is None else (array.dtype, array.tolist()) for mesh in arrays for array in mesh]

    materials = [[each.material for each in geometry.visuals] for geometry in (one, other)]
    return one.key == other.key and materials[0] == materials[1] and parts(one) == parts(other)


def refuse(*_: object) -> None:
    raise AssertionError("the meshes are computed again")


def test_a_later_run_reads_the_same_meshes(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = built_anew()
    assert any(each.image is not None for each in first.visuals)
    monkeypatch.setattr(build, "_visuals", refuse)
    assert same_meshes(built_anew(), first)
    assert len(list(cache.iterdir())) == 1


def test_another_version_of_the_code_computes_them_again(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = built_anew()
    assert first.visuals
    monkeypatch.setattr(build, "_code_version", lambda: b"another")
    assert same_meshes(built_anew(), first)
    assert len(list(cache.iterdir())) == 2


def test_other_sizes_and_materials_have_files_of_their_own(cache: Path) -> None:
    carton, box = template_by_name("carton", {"word": "Milk"}), template_by_name("box")
    sizes = [build_geometry(carton, (0.07, 0.07, height)).key for height in (0.21, 0.22)]
    assert len({*sizes, build_geometry(box, (0.07, 0.07, 0.21)).key}) == 3
    assert len(list(cache.iterdir())) == 3


@pytest.mark.parametrize("damage", [lambda data: data[:100], lambda data: data.replace(b"<f8", b"<f4")])
def test_a_damaged_file_is_computed_again(cache: Path, damage: object) -> None:
    assert callable(damage)
    first = built_anew()
    assert first.visuals
    (path,) = cache.iterdir()
    path.write_bytes(damage(path.read_bytes()))
    assert same_meshes(built_anew(), first)


def test_meshes_are_built_without_a_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError("the disk is full")

    monkeypatch.setattr("mindstage.files.atomic_write", fail)
    build._build_cached.cache_clear()
    geometry = build_geometry(template_by_name("carton", {"word": "Milk"}), (0.071, 0.07, 0.2))
    assert all(np.isfinite(each.points).all() for each in geometry.visuals)
