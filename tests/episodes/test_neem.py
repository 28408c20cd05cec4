"""NEEMs: what is written is read back, and uses the terms of SOMA and DUL."""

from __future__ import annotations

import contextlib
import json
import math
import re
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

import bson
import numpy as np
import pyoxigraph as ox
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from mindstage.episodes import EpisodeEvent, EpisodeFrame, FrameRecording, Recording
from mindstage.episodes.neem import read_neem, write_neem
from mindstage.errors import EpisodeError, EpisodeFileError
from mindstage.scene import Attachment, Body, BodyId, Iri, Pose, diff
from tests.episodes.episodes import EVENTS, MUG, episodes, kitchenette_episode
from tests.episodes.neem_files import dump, write_knowrob_neem
from tests.kitchenette import kitchenette

DUL = "http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#"
SOMA = "http://www.ease-crc.org/ont/SOMA.owl#"
TYPE, RDFS = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type", "http://www.w3.org/2000/01/rdf-schema#"
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


def test_a_neem_of_knowrob_is_read_for_a_known_map(tmp_path: Path) -> None:
    write_knowrob_neem(tmp_path)
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


@pytest.mark.parametrize("gzipped", [False, True])
def test_a_dump_of_the_neem_hub_is_read_like_its_documents(gzipped: bool, tmp_path: Path) -> None:
    write_knowrob_neem(tmp_path)
    expected = read_neem(tmp_path, kitchenette())
    dump(tmp_path, gzipped=gzipped)
    neem = read_neem(tmp_path, kitchenette())
    assert neem.events() == expected.events() != ()
    assert_equal_frames(neem, expected)
    assert neem.findings == expected.findings


def test_annotations_are_the_comments_of_events(tmp_path: Path) -> None:
    write_knowrob_neem(tmp_path)
    dump(tmp_path)
    comment = {"s": DUL + "Action_QWER", "p": RDFS + "comment", "v": "It held the mug."}
    (tmp_path / "annotations").mkdir()
    (tmp_path / "annotations" / "annotations.bson").write_bytes(bson.encode(comment))
    (event,) = read_neem(tmp_path, kitchenette()).events()
    assert event.evidence == ("It held the mug.",)


def test_statements_that_hold_for_a_time_only_are_reported(tmp_path: Path) -> None:
    write_knowrob_neem(tmp_path)
    dump(tmp_path)
    scope = {"time": {"since": 1600000001.0, "until": math.inf}}
    inside = {"s": "http://x.org#Mug", "p": SOMA + "isInsideOf", "o": "http://x.org#Fridge", "scope": scope}
    with (tmp_path / "triples" / "roslog" / "triples.bson").open("ab") as file:
        file.write(bson.encode(inside))
    findings = read_neem(tmp_path, kitchenette()).findings
    assert any(line.startswith("1 statement of the narrative") for line in findings)


GOOD = bson.encode({"s": "http://x.org#a", "p": RDFS + "comment", "o": "text"})


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (GOOD + GOOD[:-3], f"document 2, at byte {len(GOOD)}, is cut"),
        (GOOD + b"\x05", f"document 2, at byte {len(GOOD)}, is cut"),
        (b"\xff\xff\xff\x7f" + GOOD, "document 1, at byte 0, has the size 2,147,483,647"),
        (b"\x00\x00\x00\x80" + GOOD, "document 1, at byte 0, has the size -2,147,483,648"),
        (GOOD[:-1] + b"\x01", "document 1, at byte 0, is no BSON"),
        (bson.encode({"s": 1, "p": 2, "o": 3}), "document 1, at byte 0 is no triple"),
        (bson.encode({"s": "http://x.org#a"}), "document 1, at byte 0 is no triple"),
    ],
)
def test_a_damaged_dump_is_an_error_that_names_the_document(data: bytes, expected: str, tmp_path: Path) -> None:
    write_knowrob_neem(tmp_path)
    dump(tmp_path)
    (tmp_path / "triples" / "roslog" / "triples.bson").write_bytes(data)
    with pytest.raises(EpisodeFileError, match=re.escape(expected)):
        read_neem(tmp_path, kitchenette())


@given(st.binary(max_size=200), st.integers(0, 400))
def test_no_dump_breaks_the_reader(noise: bytes, at: int) -> None:
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_knowrob_neem(folder)
        dump(folder)
        for path in (folder / "ros_tf" / "roslog" / "tf.bson", folder / "triples" / "roslog" / "triples.bson"):
            data = path.read_bytes()
            path.write_bytes(data[:at] + noise + data[at + len(noise) :])
        with contextlib.suppress(EpisodeError):
            read_neem(folder, kitchenette())


def test_a_file_is_no_neem(tmp_path: Path) -> None:
    (tmp_path / "run.neem").write_text("")
    with pytest.raises(EpisodeFileError, match="no folder"):
        read_neem(tmp_path / "run.neem")
