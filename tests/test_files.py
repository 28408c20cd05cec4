"""Files: atomic writing, and where the cache directory is."""

from __future__ import annotations

import os
import stat
import threading
from pathlib import Path

import pytest

from mindstage.files import atomic_write, cache_dir, file_lock

durable_or_not = pytest.mark.parametrize("durable", [False, True])


def test_the_cache_lies_where_it_is_wanted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINDSTAGE_CACHE", str(tmp_path / "here"))
    assert cache_dir("meshes") == tmp_path / "here" / "meshes"
    monkeypatch.delenv("MINDSTAGE_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "there"))
    assert cache_dir("meshes") == tmp_path / "there" / "mindstage" / "meshes"
    assert (tmp_path / "there" / "mindstage" / "meshes").is_dir()


@durable_or_not
def test_a_file_is_written_and_replaced(tmp_path: Path, durable: bool) -> None:
    path = tmp_path / "map.owl"
    for content in (b"first", b"", b"second"):
        atomic_write(path, content, durable=durable)
        assert path.read_bytes() == content
    assert os.listdir(tmp_path) == ["map.owl"]


@durable_or_not
def test_a_failed_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, durable: bool
) -> None:
    path = tmp_path / "map.owl"
    atomic_write(path, b"old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="No space left on device") as raised:
        atomic_write(path, b"new", durable=durable)
    assert (raised.value.errno, raised.value.filename) == (28, str(path))
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["map.owl"]


def test_an_interrupted_write_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        atomic_write(tmp_path / "map.owl", b"new")
    assert os.listdir(tmp_path) == []


def test_a_missing_folder_is_named_by_the_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as raised:
        atomic_write(tmp_path / "nowhere" / "map.owl", b"")
    assert raised.value.filename == str(tmp_path / "nowhere" / "map.owl")


def test_a_name_as_long_as_a_name_can_be_is_written(tmp_path: Path) -> None:
    for name in ("m" * 255, "ü" * 127):
        atomic_write(tmp_path / name, b"x")
        assert (tmp_path / name).read_bytes() == b"x"


def test_readers_see_one_content_or_the_other(tmp_path: Path) -> None:
    path, contents = tmp_path / "map.owl", (b"a" * 100_000, b"b" * 100_000)
    atomic_write(path, contents[0])

    def write(content: bytes) -> None:
        for _ in range(50):
            atomic_write(path, content)

    writers = [threading.Thread(target=write, args=(content,)) for content in contents]
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers):
        assert path.read_bytes() in contents
    assert os.listdir(tmp_path) == ["map.owl"]


@pytest.mark.skipif(os.name != "posix", reason="permissions and symbolic links as on Linux and macOS")
@durable_or_not
def test_a_file_keeps_its_permissions_and_a_link_stays_a_link(tmp_path: Path, durable: bool) -> None:
    target, link = tmp_path / "there" / "map.owl", tmp_path / "link.owl"
    target.parent.mkdir()
    target.write_bytes(b"old")
    target.chmod(0o640)
    link.symlink_to(Path("there") / "map.owl")
    atomic_write(link, b"new", durable=durable)
    assert link.is_symlink()
    assert target.read_bytes() == b"new"
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    assert os.listdir(target.parent) == ["map.owl"]
    dangling = tmp_path / "dangling.owl"
    dangling.symlink_to(tmp_path / "there" / "created.owl")
    atomic_write(dangling, b"x")
    assert (tmp_path / "there" / "created.owl").read_bytes() == b"x"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
def test_a_device_is_written_to_and_not_replaced() -> None:
    atomic_write(Path("/dev/null"), b"x")
    assert not Path("/dev/null").is_file()
    with pytest.raises(OSError, match="No space left on device") as raised:
        atomic_write(Path("/dev/full"), b"x")
    assert raised.value.filename == "/dev/full"


def test_a_lock_excludes_other_threads_and_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "count"
    path.write_text("0")

    def count() -> None:
        for _ in range(20):
            with file_lock(path):
                path.write_text(str(int(path.read_text()) + 1))

    threads = [threading.Thread(target=count) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert path.read_text() == "80"
    assert os.listdir(tmp_path) == ["count"]


def test_a_lock_that_is_held_for_too_long_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "told.ttl"
    held = file_lock(path, timeout_s=0.05)
    with file_lock(path), pytest.raises(OSError, match="being written by another process") as raised:
        held.__enter__()
    assert raised.value.filename == str(path)
    with file_lock(path, timeout_s=0.05):
        pass
    with pytest.raises(OSError, match="No such file"), file_lock(tmp_path / "nowhere" / "told.ttl"):
        pass
