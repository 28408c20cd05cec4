"""NEEMs as KnowRob writes them, and as the NEEM hub has them."""

from __future__ import annotations

import gzip
import json
import math
from datetime import UTC, datetime
from pathlib import Path

import bson

from tests.kitchenette import kitchenette

__all__ = ["dump", "write_knowrob_neem"]

_DUL = "http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#"
_SOMA = "http://www.ease-crc.org/ont/SOMA.owl#"
_TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"
_EVER = {"time": {"since": 0, "until": math.inf}}


def write_knowrob_neem(folder: Path, *, task: str = "PickingUp") -> None:
    """A NEEM as KnowRob's memory exports it with mongoexport: triples and transforms."""
    (folder / "triples").mkdir(parents=True)
    (folder / "ros_tf").mkdir()
    mug = kitchenette().body("Mug").iri
    action, interval = _DUL + "Action_QWER", _DUL + "TimeInterval_ASDF"
    triples = [
        (_SOMA + "Episode_X", _TYPE, _SOMA + "Episode"),
        (_SOMA + "Episode_X", _DUL + "isSettingFor", action),
        (action, _TYPE, _DUL + "Action"),
        (action, _DUL + "executesTask", _SOMA + "Task_1"),
        (_SOMA + "Task_1", _TYPE, _SOMA + task),
        (action, _DUL + "hasTimeInterval", interval),
        (interval, _SOMA + "hasIntervalBegin", {"$numberDecimal": "1600000001.5"}),
        (interval, _SOMA + "hasIntervalEnd", 1600000002.5),
        (action, _DUL + "hasParticipant", mug),
        (action, _SOMA + "isPerformedBy", "http://knowrob.org/kb/PR2.owl#PR2_0"),
    ]
    (folder / "triples" / "triples.json").write_text(
        "\n".join(json.dumps(dict(zip("spo", triple, strict=True))) for triple in triples)
    )
    documents = [
        {
            "header": {"seq": 0, "stamp": {"$date": date}, "frame_id": parent},
            "child_frame_id": child,
            "transform": {"translation": {"x": x, "y": 0.0, "z": 1.0}, "rotation": {"x": 0, "y": 0, "z": 0, "w": 1}},
        }
        for date, parent, child, x in (
            ("2020-09-13T12:26:41.000Z", "map", "base_link", 1.0),
            ("2020-09-13T12:26:41.000Z", "base_link", "Mug", 0.5),
            ({"$numberLong": "1600000003000"}, "base_link", "Mug", 0.7),
        )
    ]
    (folder / "ros_tf" / "tf.json").write_text("\n".join(map(json.dumps, documents)))


def dump(folder: Path, *, gzipped: bool = False) -> None:
    """Replaces the collections of a NEEM by what `mongodump` makes of them."""
    for name in ("triples/triples", "ros_tf/tf"):
        source = folder / f"{name}.json"
        documents = [json.loads(line) for line in source.read_text().splitlines()]
        for document in documents:
            document["_id"] = bson.ObjectId()
            if "header" in document:
                date = document["header"]["stamp"]["$date"]
                number = int(date["$numberLong"]) / 1000 if isinstance(date, dict) else None
                moment = datetime.fromisoformat(date) if number is None else datetime.fromtimestamp(number, UTC)
                document["header"] |= {"stamp": moment, "seq": bson.Int64(document["header"]["seq"])}
            else:
                document |= {"p*": [document["p"]], "graph": "user", "scope": _EVER}
                value = document["o"]
                if isinstance(value, dict):
                    document["o"] = float(next(iter(value.values())))
        target = source.parent / "roslog" / f"{source.stem}.bson"
        target.parent.mkdir()
        data = b"".join(map(bson.encode, documents))
        target.with_suffix(".metadata.json").write_text("{}")
        if gzipped:
            target.with_suffix(".bson.gz").write_bytes(gzip.compress(data))
        else:
            target.write_bytes(data)
        source.unlink()
