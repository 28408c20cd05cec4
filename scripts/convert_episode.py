"""Converts an episode that an earlier version recorded to the present format: convert_episode.py OLD NEW.

Format 1 has other names in JSON and MessagePack, such as `colour` and `constraints`. Poses, contacts, events and edits
are copied as they are; the old file is not changed.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import msgspec

from mindstage.episodes.mcap_file import FORMAT_VERSION, EpisodeFile, EpisodeFileWriter
from mindstage.episodes.messages import EpisodeDecoder, EpisodeEncoder, EpisodeTopic

__all__ = ["convert"]

_NAMES = {
    "colour": "color",
    "constraints": "joints",
    "soft": "soft_limit",
    "swing_soft": "swing_soft_limit",
    "twist_soft": "twist_soft_limit",
    "glow": "emission",
    "centre": "center",
    "urdf": "urdf",
}
_SURFACE_NAMES = {"height": "clearance", "inside": "is_inside", "up": "normal"}
_FINDING_NAMES = {"what": "problem", "did": "action"}
_GEOMETRY_SOURCES = {"knowledge": "ontology", "name": "class_name"}


def convert(old: Path, new: Path) -> None:
    """Writes an episode of format 1 in the present format.

    Raises:
        EpisodeFileError: the file is no episode, or the other one exists or cannot be written.
    """
    file, writer = EpisodeFile(old), EpisodeFileWriter(new)
    try:
        for name in file.attachment_names():
            content = file.attachment(name)
            if content is None:
                continue
            if name == "episode.json":
                content = msgspec.json.encode(msgspec.json.decode(content) | {"format_version": FORMAT_VERSION})
            elif name.endswith(".msgpack.zst"):
                values = msgspec.msgpack.decode(content)
                if name.startswith("knowledge"):
                    values["sources"] = msgspec.msgpack.encode(_renamed(msgspec.msgpack.decode(values["sources"])))
                content = msgspec.msgpack.encode(_renamed(values))
            writer.add_attachment(name, "application/octet-stream", content)
        for chunk in file.chunks:
            head, messages = file.read(chunk.number)
            writer.add(EpisodeTopic.CHUNKS, messages[0].time_ns if messages else 0, EpisodeEncoder.chunk(head))
            for message in messages:
                if message.topic is EpisodeTopic.WORLD:
                    record = EpisodeDecoder.world(message.data)
                    text = msgspec.json.encode(_renamed(msgspec.json.decode(record.json)))
                    writer.add(
                        message.topic,
                        message.time_ns,
                        EpisodeEncoder.world(message.time_ns, record._replace(json=text)),
                    )
                elif message.topic is not None:
                    writer.add(message.topic, message.time_ns, message.data)
            writer.end_chunk()
    finally:
        writer.close()
        file.close()


def _renamed(value: Any) -> Any:
    if isinstance(value, list):
        return [_renamed(each) for each in value]
    if not isinstance(value, dict):
        return value
    names = dict(_NAMES)
    if "centre" in value:
        names |= _SURFACE_NAMES
    if "severity" in value:
        names |= _FINDING_NAMES
    if "evidence" in value:
        names["about"] = "topic"
    if isinstance(value.get("kind"), str) and "problem" not in value:
        names["kind"] = "type"
    if isinstance(value.get("material"), str):
        names["material"] = "name"
    renamed = {names.get(key, key) if isinstance(key, str) else key: _renamed(each) for key, each in value.items()}
    if "reason" in renamed and renamed.get("source") in _GEOMETRY_SOURCES:
        renamed["source"] = _GEOMETRY_SOURCES[renamed["source"]]
    return renamed


if __name__ == "__main__":
    convert(Path(sys.argv[1]), Path(sys.argv[2]))
