"""NEEMs: what is written is read back, and uses the terms of SOMA and DUL."""

from __future__ import annotations

import gzip
import json
import math
import re
import shutil
import struct
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import bson
import bson.json_util
import numpy as np
import pyoxigraph as ox
import pytest
from bson.datetime_ms import DatetimeMS
from bson.decimal128 import Decimal128
from bson.objectid import ObjectId
from bson.regex import Regex
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from mindstage.episodes import EpisodeEvent, EpisodeFrame, FrameRecording, Recording
from mindstage.episodes.neem import read_neem, write_neem
from mindstage.errors import EpisodeError, EpisodeFileError
from mindstage.scene import Attachment, Body, BodyId, Iri, Pose, diff
from tests.episodes.episodes import EVENTS, MUG, episodes, kitchenette_episode
from tests.kitchenette import kitchenette

DUL = "http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#"
SOMA = "http://www.ease-crc.org/ont/SOMA.owl#"
TYPE, RDFS = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type", "http://www.w3.org/2000/01/rdf-schema#"
DOUBLE = ox.NamedNode("http://www.w3.org/2001/XMLSchema#double")
TIME_TOLERANCE_S = 1e-6
"""The resolution of a Unix time as a double, doubled."""


def assert_equal_events(found: tuple[EpisodeEvent, ...], expected: tuple[EpisodeEvent, ...]) -> None:
    def key(event: EpisodeEvent) -> str:
        return event.id

    assert [key(each) for each in sorted(found, key=key)] == [key(each) for each in sorted(expected, key=key)]
    for one, other in zip(sorted(found, key=key), sorted(expected, key=key), strict=True):
        assert replace(one, begin_s=0.0, end_s=None) == replace(other, begin_s=0.0, end_s=None)
        assert one.begin_s == pytest.approx(other.begin_s, abs=TIME_TOLERANCE_S)
        assert one.end_s == pytest.approx(other.end_s, abs=TIME_TOLERANCE_S)


def assert_equal_frames(found: Recording, expected: Recording) -> None:
    pairs = list(zip(found.frames(), expected.frames(), strict=True))
    for one, other in pairs:
        assert one.time_s == pytest.approx(other.time_s, abs=1e-8)
        assert one.ids == other.ids
        np.testing.assert_allclose(one.poses, other.poses, atol=1e-9)


def test_a_simulated_episode_is_read_back(tmp_path: Path) -> None:
    episode = kitchenette_episode()
    losses = write_neem(episode, tmp_path / "run.neem")
    neem = read_neem(tmp_path / "run.neem")
    assert isinstance(neem, Recording)
    assert neem.name == "run"
    assert neem.start_unix_s == pytest.approx(episode.start_unix_s, abs=1e-6)
    assert_equal_frames(neem, episode)
    assert_equal_events(neem.events(), EVENTS)
    assert any("contacts" in line for line in losses)


@given(episode=episodes())
@settings(max_examples=15)
def test_any_episode_is_read_back(episode: FrameRecording, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("neem") / "run"
    assert write_neem(episode, folder) == ()
    neem = read_neem(folder)
    assert_equal_frames(neem, episode)
    assert_equal_events(neem.events(), episode.events())
    assert [line for line in neem.findings if "without a frame" not in line] == []
    shutil.rmtree(folder)


def test_the_map_is_part_of_the_folder(tmp_path: Path) -> None:
    write_neem(kitchenette_episode(), tmp_path)
    world = read_neem(tmp_path).world
    assert diff(kitchenette_episode().frame_at(0.0).structure, world).identical


def test_a_body_that_rests_and_moves_on_stays_in_between(tmp_path: Path) -> None:
    world = kitchenette()
    ids = tuple(body.id for body in world.bodies)
    poses = np.array([(*body.pose.position, *body.pose.quaternion) for body in world.bodies])
    frames = []
    for number in range(12):
        poses = poses.copy()
        if number in {2, 9}:
            poses[-1, 0] += 1.0
        frames.append(EpisodeFrame(time_s=number / 20, structure=world, ids=ids, poses=poses))
    episode = FrameRecording(frames)
    write_neem(episode, tmp_path)
    assert_equal_frames(read_neem(tmp_path), episode)
    documents = (tmp_path / "tf.json").read_text().splitlines()
    assert sum('"Mug"' in line for line in documents) == 5  # begin; before and after each of two motions
    assert sum('"Floor"' in line for line in documents) == 1


def test_what_a_neem_cannot_express_is_reported(tmp_path: Path) -> None:
    world = kitchenette()
    extra = Body(
        id=BodyId("Plate"), iri=Iri("http://example.org/m#Plate"), cls=Iri("http://example.org/m#Plate"), pose=Pose()
    )
    more = replace(
        world,
        bodies=(*(body for body in world.bodies if body.id != MUG), extra),
        attachments=(*world.attachments, Attachment(parent=BodyId("Drawer"), child=BodyId("Plate"))),
    )
    frames = [
        EpisodeFrame(
            time_s=float(time),
            structure=structure,
            ids=tuple(body.id for body in structure.bodies),
            poses=np.array([(*body.pose.position, *body.pose.quaternion) for body in structure.bodies]),
        )
        for time, structure in enumerate((world, more))
    ]
    losses = "\n".join(write_neem(FrameRecording(frames), tmp_path))
    assert "Plate came later" in losses
    assert "Mug were deleted" in losses
    assert "attachments changed" in losses
    assert {body.id for body in read_neem(tmp_path).world.bodies} == {body.id for body in (*world.bodies, extra)}


# -- the layout --------------------------------------------------------------------------------------------------------


class Graph:
    """The statements of a file, by an RDF parser."""

    def __init__(self, path: Path) -> None:
        self.quads = list(ox.parse(path=path))
        self.triples = {(quad.subject.value, quad.predicate.value, quad.object.value) for quad in self.quads}

    def subjects(self, property: str, value: str) -> list[str]:
        return sorted(s for s, p, o in self.triples if (p, o) == (property, value))

    def objects(self, subject: str, property: str) -> list[str]:
        return sorted(o for s, p, o in self.triples if (s, p) == (subject, property))

    def classes(self, subjects: list[str]) -> set[str]:
        return {cls for subject in subjects for cls in self.objects(subject, TYPE)}


def graph_of(folder: Path) -> Graph:
    return Graph(folder / "ontology.ttl")


def test_the_narrative_has_the_pattern_of_knowrobs_interface(tmp_path: Path) -> None:
    write_neem(kitchenette_episode(), tmp_path)
    graph = graph_of(tmp_path)
    (episode,) = graph.subjects(TYPE, SOMA + "Episode")
    (opening,) = graph.subjects(TYPE, SOMA + "Opening")
    (action,) = graph.subjects(DUL + "executesTask", opening)
    assert (episode, DUL + "isSettingFor", action) in graph.triples
    assert (action, TYPE, DUL + "Action") in graph.triples
    (interval,) = graph.objects(action, DUL + "hasTimeInterval")
    assert (interval, TYPE, DUL + "TimeInterval") in graph.triples
    (begin,) = (
        quad.object for quad in graph.quads if quad.subject.value == interval and "Begin" in quad.predicate.value
    )
    assert begin.datatype.value == "http://www.w3.org/2001/XMLSchema#double"
    assert float(begin.value) == pytest.approx(1_750_000_000.5, abs=1e-6)
    drawer = kitchenette().body("Drawer").iri
    assert drawer in graph.objects(action, DUL + "hasParticipant")
    roles = graph.objects(opening, DUL + "isTaskOf")
    assert graph.classes(roles) >= {SOMA + "Patient", SOMA + "AgentRole"}
    assert set(roles) & set(graph.objects(drawer, DUL + "hasRole"))
    (agent,) = graph.objects(action, SOMA + "isPerformedBy")
    assert graph.objects(agent, RDFS + "label") == ["viewer"]
    assert DUL + "Agent" in graph.classes([agent])
    assert DUL + "Object" not in graph.classes([agent])
    (whole,) = graph.subjects(DUL + "hasConstituent", action)
    assert (episode, DUL + "isSettingFor", whole) in graph.triples
    assert SOMA + "PhysicalTask" in graph.classes(graph.objects(whole, DUL + "executesTask"))


def test_states_are_classified_by_state_types(tmp_path: Path) -> None:
    write_neem(kitchenette_episode(), tmp_path)
    graph = graph_of(tmp_path)
    (concept,) = graph.subjects(TYPE, SOMA + "SupportState")
    (state,) = graph.objects(concept, DUL + "classifies")
    assert (state, TYPE, SOMA + "State") in graph.triples
    (interval,) = graph.objects(state, DUL + "hasTimeInterval")
    assert graph.objects(interval, SOMA + "hasIntervalEnd") == ["INF"]  # as KnowRob states what has not ended
    roles = graph.objects(concept, SOMA + "isStateTypeOf")
    (role,) = (role for role in roles if SOMA + "Supporter" in graph.classes([role]))
    assert role in graph.objects(kitchenette().body("Cupboard").iri, DUL + "hasRole")


def test_poses_are_the_documents_of_the_handbook(tmp_path: Path) -> None:
    write_neem(kitchenette_episode(), tmp_path)
    documents = [json.loads(line) for line in (tmp_path / "tf.json").read_text().splitlines()]
    assert [each["header"]["seq"] for each in documents] == list(range(len(documents)))
    mug = next(each for each in documents if each["child_frame_id"] == "Mug")
    assert mug["header"]["frame_id"] == "map"
    assert re.fullmatch(r"2025-06-15T15:06:40\.250Z", mug["header"]["stamp"]["$date"])
    pose = kitchenette_episode().frame_at(0.0).world().body("Mug").pose
    assert mug["transform"]["translation"] == dict(zip("xyz", pose.position, strict=True))
    assert mug["transform"]["rotation"] == dict(zip("wxyz", pose.quaternion, strict=True))


def test_each_term_of_soma_and_dul_exists_there(shared_data: Path, tmp_path: Path) -> None:
    ontologies = [
        path
        for path in (shared_data / "ontology").rglob("*.owl")
        if path.name in {"SOMA.owl", "DUL.owl", "SOMA-ALL.owl"}
    ]
    if not ontologies:
        pytest.skip(f"no SOMA.owl and DUL.owl in {shared_data / 'ontology'}")
    kinds = {f"http://www.w3.org/2002/07/owl#{name}" for name in ("Class", "ObjectProperty", "DatatypeProperty")}
    defined = {s for path in ontologies for s, p, o in Graph(path).triples if p == TYPE and o in kinds}
    write_neem(kitchenette_episode(), tmp_path)
    used = {o for _, p, o in graph_of(tmp_path).triples if p == TYPE} | {p for _, p, _ in graph_of(tmp_path).triples}
    assert {term for term in used if term.startswith((SOMA, DUL))} <= defined


# -- NEEMs of others ---------------------------------------------------------------------------------------------------


def write_collection(folder: Path, name: str, documents: list[dict[str, Any]], ending: str) -> Path:
    """A collection as mongoexport or mongodump writes it, by pymongo's encoders.

    Args:
        folder: the folder of the collection.
        name: of the collection.
        documents: as pymongo has them.
        ending: of the file; mongodump puts it into a folder that is named like the database.
    """
    place = folder / "roslog" if "bson" in ending else folder
    place.mkdir(parents=True, exist_ok=True)
    path = place / f"{name}{ending}"
    if "bson" in ending:
        data = b"".join(bson.encode(each) for each in documents)
        (place / f"{name}.metadata.json").write_text('{"options": {}, "indexes": []}')
    else:
        data = "\n".join(bson.json_util.dumps(each) for each in documents).encode()
    path.write_bytes(gzip.compress(data) if ending.endswith(".gz") else data)
    return path


def knowrob_triples(task: str) -> list[dict[str, Any]]:
    mug = kitchenette().body("Mug").iri
    action, interval = DUL + "Action_QWER", DUL + "TimeInterval_ASDF"
    triples = [
        (SOMA + "Episode_X", TYPE, SOMA + "Episode"),
        (SOMA + "Episode_X", DUL + "isSettingFor", action),
        (action, TYPE, DUL + "Action"),
        (action, DUL + "executesTask", SOMA + "Task_1"),
        (SOMA + "Task_1", TYPE, task if "#" in task else SOMA + task),
        (action, DUL + "hasTimeInterval", interval),
        (interval, SOMA + "hasIntervalBegin", Decimal128("1600000001.5")),
        (interval, SOMA + "hasIntervalEnd", 1600000002.5),
        (action, DUL + "hasParticipant", mug),
        (action, SOMA + "isPerformedBy", "http://knowrob.org/kb/PR2.owl#PR2_0"),
    ]
    return [
        {"_id": ObjectId(), **dict(zip("spo", triple, strict=True)), "graph": "user", "scope": {"time": {"since": 0.0}}}
        for triple in triples
    ]


def knowrob_transforms() -> list[dict[str, Any]]:
    return [
        {
            "_id": ObjectId(),
            "header": {"seq": 0, "stamp": datetime.fromtimestamp(at_s, UTC), "frame_id": parent},
            "child_frame_id": child,
            "transform": {"translation": {"x": x, "y": 0.0, "z": 1.0}, "rotation": {"x": 0, "y": 0, "z": 0, "w": 1}},
            "__recorded": datetime.fromtimestamp(at_s, UTC),
            "__topic": "/tf",
        }
        for at_s, parent, child, x in (
            (1_600_000_001, "map", "base_link", 1.0),
            (1_600_000_001, "base_link", "Mug", 0.5),
            (1_600_000_003, "base_link", "Mug", 0.7),
        )
    ]


def write_knowrob_neem(folder: Path, *, task: str = "PickingUp", ending: str = ".json") -> None:
    """A NEEM as KnowRob's memory exports it: triples and transforms."""
    write_collection(folder / "triples", "triples", knowrob_triples(task), ending)
    write_collection(folder / "ros_tf", "tf", knowrob_transforms(), ending)


@pytest.mark.parametrize("ending", [".json", ".bson", ".json.gz", ".bson.gz"])
def test_a_neem_of_knowrob_is_read_for_a_known_map(tmp_path: Path, ending: str) -> None:
    write_knowrob_neem(tmp_path, ending=ending)
    neem = read_neem(tmp_path, kitchenette())
    (event,) = neem.events()
    assert (event.kind, event.thing, event.agent) == ("PickingUp", "Mug", "PR2_0")
    assert (event.begin_s, event.end_s) == (pytest.approx(0.5, abs=1e-6), pytest.approx(1.5, abs=1e-6))
    assert neem.end_s == pytest.approx(2.0)
    assert neem.frame_at(0.0).world().body("Mug").pose.position == pytest.approx((1.5, 0.0, 2.0))
    assert neem.frame_at(2.0).world().body("Mug").pose.position == pytest.approx((1.7, 0.0, 2.0))
    assert neem.unmatched_frames == ("base_link",)


@pytest.mark.parametrize("place", ["Supporter", "Container", "Location", "Destination", "Origin"])
def test_participants_without_labels_are_told_apart_by_the_classes_of_their_roles(tmp_path: Path, place: str) -> None:
    write_knowrob_neem(tmp_path)
    triples = tmp_path / "triples" / "triples.json"
    bodies = {each.id: each.iri for each in kitchenette().bodies}
    task, action = SOMA + "Task_1", DUL + "Action_QWER"
    more = [(action, DUL + "hasParticipant", bodies["Fridge"])]
    for body, role in (("Mug", "Patient"), ("Fridge", place)):
        more += [
            (task, DUL + "isTaskOf", SOMA + f"{role}_1"),
            (bodies[body], DUL + "hasRole", SOMA + f"{role}_1"),
            (SOMA + f"{role}_1", TYPE, SOMA + role),
        ]
    lines = [json.dumps(dict(zip("spo", triple, strict=True))) for triple in more]
    triples.write_text("\n".join([*lines, triples.read_text()]))  # the place is the first participant
    (event,) = read_neem(tmp_path, kitchenette()).events()
    assert (event.thing, event.other, event.agent) == ("Mug", "Fridge", "PR2_0")


def test_a_task_that_is_no_kind_of_event_is_reported(tmp_path: Path) -> None:
    write_knowrob_neem(tmp_path, task="Navigating")
    triples = tmp_path / "triples" / "triples.json"
    whole = {"s": DUL + "Action_0", "p": DUL + "hasConstituent", "o": DUL + "Action_QWER"}
    triples.write_text(triples.read_text() + "\n" + json.dumps(whole))
    neem = read_neem(tmp_path, kitchenette())
    assert neem.events() == ()
    assert any("Action_QWER (Navigating)" in line for line in neem.findings)


def test_a_dump_has_the_events_of_the_ontology_and_the_transforms_of_the_json_of_the_same_episode(
    tmp_path: Path,
) -> None:
    write_neem(kitchenette_episode(), tmp_path / "own")
    expected = read_neem(tmp_path / "own")
    dump, map_owl = tmp_path / "own_dump", (tmp_path / "own" / "map.owl").read_bytes()
    triples = [
        {
            "s": quad.subject.value,
            "p": quad.predicate.value,
            "o": float(quad.object.value) if getattr(quad.object, "datatype", None) == DOUBLE else quad.object.value,
        }
        for quad in graph_of(tmp_path / "own").quads
    ]
    is_annotation = [each["p"].startswith(RDFS) for each in triples]
    annotations = [
        {"s": each["s"], "p": each["p"], "v": each["o"]}
        for each, is_one in zip(triples, is_annotation, strict=True)
        if is_one
    ]
    rest = [each for each, is_one in zip(triples, is_annotation, strict=True) if not is_one]
    lines = (tmp_path / "own" / "tf.json").read_text().splitlines()
    transforms = [bson.json_util.loads(line) for line in lines]
    for name, documents in {"triples": rest, "annotations": annotations}.items():
        write_collection(dump / name, f"5f22_{name}", documents, ".bson")
    write_collection(dump / "ros_tf", "5f22_tf", transforms, ".bson")
    (dump / "map.owl").write_bytes(map_owl)
    found = read_neem(dump)
    assert annotations
    assert len(expected.events()) == len(EVENTS)
    assert_equal_events(found.events(), expected.events())
    assert_equal_frames(found, expected)


def test_a_task_of_a_class_below_one_of_soma_is_of_its_kind(tmp_path: Path) -> None:
    own = "http://example.org/lab.owl#PickingUpFromShelf"
    between = "http://example.org/lab.owl#ShelfTask"
    write_knowrob_neem(tmp_path / "stated", task=own, ending=".bson")
    path = tmp_path / "stated" / "triples" / "roslog" / "triples.bson"
    above = "http://www.w3.org/2000/01/rdf-schema#subClassOf"
    more = [{"s": own, "p": above, "o": between}, {"s": between, "p": above, "o": SOMA + "PickingUp"}]
    more += [{"s": SOMA + "PickingUp", "p": above, "o": own}]  # a circle
    path.write_bytes(path.read_bytes() + b"".join(map(bson.encode, more)))
    triples = knowrob_triples(own)
    next(each for each in triples if each["o"] == own)["o*"] = [SOMA + "PhysicalTask", SOMA + "PickingUp", own]
    write_knowrob_neem(tmp_path / "stored", ending=".bson")
    write_collection(tmp_path / "stored" / "triples", "triples", triples, ".bson")
    for folder in ("stated", "stored"):
        (event,) = read_neem(tmp_path / folder, kitchenette()).events()
        assert (event.kind, event.thing) == ("PickingUp", "Mug")


@pytest.mark.parametrize("term", ["DirectedMotion", "Motion", "Rubbing", "PhysicalTask"])
def test_a_term_that_is_wider_than_a_kind_is_no_event_of_it(tmp_path: Path, term: str) -> None:
    write_knowrob_neem(tmp_path, task=term, ending=".bson")
    assert read_neem(tmp_path, kitchenette()).events() == ()


def test_messages_of_tf_that_are_stored_whole_are_read(tmp_path: Path) -> None:
    write_knowrob_neem(tmp_path, ending=".bson")
    expected = read_neem(tmp_path, kitchenette())
    write_collection(tmp_path / "ros_tf", "tf", [{"transforms": knowrob_transforms()}], ".bson")
    assert_equal_frames(read_neem(tmp_path, kitchenette()), expected)


def test_statements_that_hold_for_a_time_only_are_reported(tmp_path: Path) -> None:
    write_knowrob_neem(tmp_path, ending=".bson")
    triples = next(tmp_path.rglob("triples.bson"))
    scope = {"time": {"since": 1600000001.0, "until": math.inf}}
    inside = {"s": "http://x.org#Mug", "p": SOMA + "isInsideOf", "o": "http://x.org#Fridge", "scope": scope}
    triples.write_bytes(triples.read_bytes() + bson.encode(inside))
    findings = read_neem(tmp_path, kitchenette()).findings
    assert [line for line in findings if "always true" in line] == [
        "read as if always true, without its time: 1 statement of the narrative"
    ]


def test_dumps_of_several_episodes_in_one_folder_are_refused_by_name(tmp_path: Path) -> None:
    write_knowrob_neem(tmp_path, ending=".bson")
    write_collection(tmp_path / "ros_tf", "other_tf", knowrob_transforms(), ".bson")
    with pytest.raises(EpisodeFileError, match=r"several collections tf: .*other_tf\.bson, .*roslog/tf\.bson"):
        read_neem(tmp_path, kitchenette())


def nested(levels: int) -> bytes:
    """A document that is in a document, and so on."""
    heads = [struct.pack("<i", 5 + 8 * level) + b"\x03a\x00" for level in range(levels, 0, -1)]
    return b"".join(heads) + b"\x05\0\0\0\0" + bytes(levels)


def changed_transform(**values: object) -> bytes:
    return bson.encode(knowrob_transforms()[2] | values)


@pytest.mark.parametrize(
    ("last", "expected"),
    [
        (lambda: b"\x10\x00", "document 3, at byte {at}, is cut off: the file ends after 2 bytes"),
        (lambda: changed_transform()[:-1], "document 3, at byte {at}, is cut off"),
        (lambda: struct.pack("<i", 2**31 - 1), "document 3, at byte {at}, has a length of 2147483647 bytes"),
        (lambda: struct.pack("<i", -5), "document 3, at byte {at}, has a length of -5 bytes"),
        (lambda: bytes(8), "document 3, at byte {at}, has a length of 0 bytes"),
        (lambda: changed_transform()[:-1] + b"\x07", "document 3, at byte {at}, is no BSON document"),
        (lambda: nested(100_000), "document 3, at byte {at}, is no BSON document"),
        (lambda: bson.encode({"a": 1}), "document 3, at byte {at} is no transform"),
        (lambda: changed_transform(transform=[1, 2]), "is no transform"),
        (lambda: changed_transform(header="map"), "is no transform"),
        (lambda: changed_transform(child_frame_id=7), "is no transform.*a frame has no name"),
        (lambda: bson.encode({"transforms": "all"}), "is no transform"),
        *(
            (
                lambda stamp=stamp: changed_transform(header={"stamp": stamp, "frame_id": "map"}),
                "document 3, at byte {at} is no transform",
            )
            for stamp in (math.inf, math.nan, "soon", DatetimeMS(2**62), DatetimeMS(-(2**62)), None, Regex("a"))
        ),
    ],
)
def test_a_damaged_dump_is_an_error_with_its_place(tmp_path: Path, last: Callable[[], bytes], expected: str) -> None:
    write_knowrob_neem(tmp_path, ending=".bson")
    path = tmp_path / "ros_tf" / "roslog" / "tf.bson"
    good = b"".join(bson.encode(each) for each in knowrob_transforms()[:2])
    path.write_bytes(good + last())
    with pytest.raises(EpisodeFileError, match=expected.format(at=len(good))) as error:
        read_neem(tmp_path, kitchenette())
    assert str(path) in str(error.value)


@given(at=st.integers(0, 2000), bit=st.integers(0, 7), cut=st.booleans(), name=st.sampled_from(["tf", "triples"]))
@settings(max_examples=60)
def test_a_dump_with_a_wrong_bit_or_end_is_read_or_refused(
    at: int, bit: int, cut: bool, name: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("dump")
    write_knowrob_neem(folder, ending=".bson")
    (path,) = folder.rglob(f"{name}.bson")
    data = bytearray(path.read_bytes())
    at %= len(data)
    if cut:
        del data[at:]
    else:
        data[at] ^= 1 << bit
    path.write_bytes(data)
    with suppress(EpisodeError):
        neem = read_neem(folder, kitchenette())
        assert len(neem.events()) <= 1
        assert all(np.isfinite(frame.poses).all() for frame in neem.frames())
    shutil.rmtree(folder)


def test_damaged_gzip_data_is_an_error(tmp_path: Path) -> None:
    write_knowrob_neem(tmp_path, ending=".bson.gz")
    path = tmp_path / "ros_tf" / "roslog" / "tf.bson.gz"
    data = path.read_bytes()
    for damaged in (data[: len(data) // 2], b"BSON" + data, data[:30] + b"\xff" * 20 + data[50:]):
        path.write_bytes(damaged)
        with pytest.raises(EpisodeFileError, match=r"tf\.bson\.gz.*gzip data is damaged"):
            read_neem(tmp_path, kitchenette())


def test_a_neem_without_a_narrative_has_no_events_and_says_so(tmp_path: Path) -> None:
    write_neem(kitchenette_episode(), tmp_path)
    (tmp_path / "ontology.ttl").unlink()
    neem = read_neem(tmp_path)
    assert neem.events() == ()
    assert any("no narrative" in line for line in neem.findings)


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("tf.json", None, "no experience"),
        ("map.owl", None, "no map"),
        ("tf.json", "", "no transform"),
        ("tf.json", '{"header": {}}', "line 1 is no transform"),
        ("tf.json", "{", "line 1 is no JSON document"),
        ("ontology.ttl", "<a> <b> .", "cannot be read"),
        ("map.owl", "<rdf:RDF", "map cannot be read"),
    ],
)
def test_a_damaged_folder_is_an_error(name: str, content: str | None, expected: str, tmp_path: Path) -> None:
    write_neem(kitchenette_episode(), tmp_path)
    if content is None:
        (tmp_path / name).unlink()
    else:
        (tmp_path / name).write_text(content)
    with pytest.raises(EpisodeFileError, match=expected):
        read_neem(tmp_path)


def test_a_file_is_no_neem(tmp_path: Path) -> None:
    (tmp_path / "run.neem").write_text("")
    with pytest.raises(EpisodeFileError, match="no folder"):
        read_neem(tmp_path / "run.neem")
