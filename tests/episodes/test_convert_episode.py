"""Episodes of format 1: refused by name of their converter, and converted by it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from mindstage.episodes import Episode
from mindstage.episodes.mcap_file import EpisodeFile, EpisodeFileWriter
from mindstage.episodes.messages import ChunkHead, EpisodeDecoder, EpisodeEncoder, EpisodeTopic, WorldRecord
from mindstage.errors import EpisodeFileError

ROOT = Path(__file__).resolve().parent.parent.parent
HEADER = {
    "format_version": 1, "episode": "e", "start_unix_s": 0.0, "engine": "mujoco", "rate_hz": 30.0,
    "has_joints": False, "has_contacts": False, "has_events": False,
}  # fmt: skip
OLD = {
    "world": {
        "iri": "urn:map",
        "constraints": [{"id": "slide", "linear": {"x": 1, "soft": {"enabled": True}}}],
        "lights": [{"id": "lamp", "kind": "point", "colour": [1.0, 0.5, 0.0]}],
    },
    "bodies": [{"id": "mug", "shape": {"kind": "sphere"}, "materials": [{"name": "Blue", "colour": [0.0, 0.0, 1.0]}]}],
}
NEW = {
    "world": {
        "iri": "urn:map",
        "joints": [{"id": "slide", "linear": {"x": 1, "soft_limit": {"enabled": True}}}],
        "lights": [{"id": "lamp", "type": "point", "color": [1.0, 0.5, 0.0]}],
    },
    "bodies": [{"id": "mug", "shape": {"type": "sphere"}, "materials": [{"name": "Blue", "color": [0.0, 0.0, 1.0]}]}],
}


@pytest.fixture
def old(tmp_path: Path) -> Path:
    """An episode as version 1 wrote it, with one world."""
    path = tmp_path / "old.mcap"
    writer = EpisodeFileWriter(path)
    writer.add_attachment("episode.json", "application/json", json.dumps(HEADER).encode())
    writer.add(EpisodeTopic.CHUNKS, 0, EpisodeEncoder.chunk(ChunkHead("e", 0, 0, 0, 0)))
    writer.add(EpisodeTopic.WORLD, 0, EpisodeEncoder.world(0, WorldRecord(0, True, json.dumps(OLD).encode())))
    writer.end_chunk()
    writer.close()
    return path


def test_an_episode_of_format_1_is_refused_in_one_line_that_names_the_converter(old: Path) -> None:
    with pytest.raises(
        EpisodeFileError, match=r"format version 1.*convert it with scripts/convert_episode\.py"
    ) as refused:
        Episode(old)
    assert "\n" not in str(refused.value)


def test_it_is_converted_to_the_names_of_today(old: Path, tmp_path: Path) -> None:
    new = tmp_path / "new.mcap"
    subprocess.run([sys.executable, ROOT / "scripts" / "convert_episode.py", old, new], check=True)
    file = EpisodeFile(new)
    assert json.loads(file.attachment("episode.json") or b"") == HEADER | {"format_version": 2}
    _, messages = file.read(0)
    (world,) = [EpisodeDecoder.world(each.data) for each in messages if each.topic is EpisodeTopic.WORLD]
    assert json.loads(world.json) == NEW
    file.close()
