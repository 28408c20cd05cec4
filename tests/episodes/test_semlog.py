"""SemLog's event OWL: what it can express is read back, and what it cannot is reported."""

from __future__ import annotations

from pathlib import Path

import pyoxigraph as ox
import pytest
from hypothesis import given, settings
from msgspec.structs import replace

from mindstage.episodes import EpisodeEvent, EpisodeEventKind, FrameRecording
from mindstage.episodes.semlog import read_semlog, write_semlog
from mindstage.errors import EpisodeFileError, MapWriteError
from tests.episodes.episodes import EVENTS, episodes, kitchenette_episode
from tests.kitchenette import kitchenette

EXPRESSIBLE = {
    EpisodeEventKind.CONTACT,
    EpisodeEventKind.SUPPORT,
    EpisodeEventKind.GRASP,
    EpisodeEventKind.PICK_UP,
    EpisodeEventKind.PUT_DOWN,
    EpisodeEventKind.SLIDE,
    EpisodeEventKind.TRANSPORT,
    EpisodeEventKind.OPEN,
    EpisodeEventKind.CLOSE,
}
RELATIONS = {EpisodeEventKind.CONTACT, EpisodeEventKind.SUPPORT}


def expressible(event: EpisodeEvent, end_s: float) -> EpisodeEvent:
    """What remains of an event."""
    is_relation = event.kind in RELATIONS
    return replace(
        event,
        end_s=end_s if event.end_s is None else event.end_s,
        other=None if not is_relation or (event.kind == "Contact" and event.other == event.thing) else event.other,
        agent=None if is_relation else event.agent,
        joint=None,
        amount=None,
        evidence=(),
    )


@given(episode=episodes())
@settings(max_examples=30)
def test_what_semlog_can_express_is_read_back(
    episode: FrameRecording, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("semlog") / "run_ED.owl"
    write_semlog(episode, path)
    found = read_semlog(path, kitchenette())
    assert found.name == episode.name
    assert (found.begin_s, found.end_s) == (episode.begin_s, episode.end_s)
    assert found.findings == ()
    assert set(found.events) == {
        expressible(event, episode.end_s) for event in episode.events() if event.kind in EXPRESSIBLE
    }


def test_what_semlog_cannot_express_is_reported(tmp_path: Path) -> None:
    fall = EpisodeEvent(id="Falling_1", kind=EpisodeEventKind.FALL, begin_s=0.0, end_s=0.5, thing=EVENTS[0].thing)
    frames = list(kitchenette_episode().frames())
    losses = write_semlog(FrameRecording(frames, events=(fall, *EVENTS)), tmp_path / "run.owl")
    text = "\n".join(losses)
    assert "no word for Falling; 1 event" in text
    assert "1 event had not ended" in text
    assert "1 event are about a joint" in text
    assert "Falling_1" not in {event.id for event in read_semlog(tmp_path / "run.owl").events}


def test_the_file_has_the_words_of_usemlog(tmp_path: Path) -> None:
    path = tmp_path / "run_ED.owl"
    write_semlog(kitchenette_episode(), path)
    text = path.read_text()
    for line in (
        '<rdf:type rdf:resource="&knowrob;SupportedBySituation"/>',
        "<knowrob:isSupported rdf:resource=",
        "<knowrob:isSupporting rdf:resource=",
        '<rdf:type rdf:resource="&knowrob;GraspingSomething"/>',
        "<knowrob:performedBy rdf:resource=",
        "<knowrob:objectActedOn rdf:resource=",
        "<knowrob:subAction rdf:resource=",
        '<rdf:type rdf:resource="&knowrob;UnrealExperiment"/>',
    ):
        assert line in text, line
    assert "timepoint_0.25" in text
    assert text.count("<knowrob:inContact rdf:resource=") == 2
    assert "http://knowrob.org/kb/unreal_log.owl#" in text


# A file as the logger of RobCoG wrote it in 2017, with the words of knowrob_u.
ROBCOG = """<?xml version="1.0"?>
<!DOCTYPE rdf:RDF [
  <!ENTITY knowrob "http://knowrob.org/kb/knowrob.owl#"> <!ENTITY knowrob_u "http://knowrob.org/kb/knowrob_u.owl#">
  <!ENTITY log "http://knowrob.org/kb/unreal_log.owl#"> ]>
<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:owl="http://www.w3.org/2002/07/owl#"
  xmlns:knowrob="http://knowrob.org/kb/knowrob.owl#" xmlns:knowrob_u="http://knowrob.org/kb/knowrob_u.owl#">
<owl:NamedIndividual rdf:about="&log;TouchingSituation_icaO">
  <rdf:type rdf:resource="&knowrob_u;TouchingSituation"/>
  <knowrob:startTime rdf:resource="&log;timepoint_0.302039"/>
  <knowrob_u:inContact rdf:resource="&log;Drawer"/>
  <knowrob_u:inContact rdf:resource="&log;Bowl3_9w2Y"/>
  <knowrob:endTime rdf:resource="&log;timepoint_0.331089"/>
</owl:NamedIndividual>
<owl:NamedIndividual rdf:about="&log;GraspingSomething_YK3q">
  <rdf:type rdf:resource="&knowrob;GraspingSomething"/>
  <knowrob:startTime rdf:resource="&log;timepoint_3.5"/>
  <knowrob:endTime rdf:resource="&log;timepoint_7.25"/>
  <knowrob:performedBy rdf:resource="&log;RightHand_BRmZ"/>
  <knowrob:objectActedOn rdf:resource="&log;Mug"/>
</owl:NamedIndividual>
<owl:NamedIndividual rdf:about="&log;ParticleTranslation_1">
  <rdf:type rdf:resource="&knowrob_u;ParticleTranslation"/>
  <knowrob:startTime rdf:resource="&log;timepoint_4"/>
</owl:NamedIndividual>
<owl:NamedIndividual rdf:about="&log;UnrealExperiment_BRmZ">
  <rdf:type rdf:resource="&knowrob_u;UnrealExperiment"/>
  <knowrob:experiment>rcg_5</knowrob:experiment>
  <knowrob:startTime rdf:resource="&log;timepoint_0.0"/>
  <knowrob:endTime rdf:resource="&log;timepoint_12.5"/>
  <knowrob:subAction rdf:resource="&log;GraspingSomething_YK3q"/>
</owl:NamedIndividual>
</rdf:RDF>
"""


def test_a_file_of_robcog_is_read(tmp_path: Path) -> None:
    path = tmp_path / "EventData.owl"
    path.write_text(ROBCOG)
    found = read_semlog(path, kitchenette())
    assert (found.name, found.begin_s, found.end_s) == ("rcg_5", 0.0, 12.5)
    touch, grasp = found.events
    assert (touch.kind, touch.thing, touch.other) == ("Contact", "Drawer", "Bowl3_9w2Y")
    assert (touch.begin_s, touch.end_s) == (0.302039, 0.331089)
    assert (grasp.kind, grasp.thing, grasp.agent, grasp.end_s) == ("Grasping", "Mug", "RightHand_BRmZ", 7.25)
    assert any("ParticleTranslation" in line for line in found.findings)
    assert any("Bowl3_9w2Y: no body of the map" in line for line in found.findings)


def test_a_file_without_events_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "map.ttl"
    path.write_text("<http://a#b> <http://a#c> <http://a#d> .")
    with pytest.raises(EpisodeFileError, match="no experiment and no event"):
        read_semlog(path)
    with pytest.raises(EpisodeFileError, match="no such file"):
        read_semlog(tmp_path / "none.owl")


def test_an_unknown_suffix_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(MapWriteError, match=r"\.docx"):
        write_semlog(kitchenette_episode(), tmp_path / "run.docx")


# -- the statements, by another RDF parser -----------------------------------------------------------------------------

LOG, KNOWROB = "http://knowrob.org/kb/unreal_log.owl#", "http://knowrob.org/kb/knowrob.owl#"
RDF_TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"
ROLES = {
    "SupportedBy_1": {"startTime": "timepoint_0.0", "endTime": "timepoint_1.0"}
    | {"isSupported": "Mug", "isSupporting": "Cupboard"},
    "Contact_1": {"startTime": "timepoint_0.1", "endTime": "timepoint_0.9", "inContact": "Drawer Mug"},
    "Opening_1": {"startTime": "timepoint_0.25", "endTime": "timepoint_1.0"}
    | {"performedBy": "viewer", "objectActedOn": "Drawer", "type": "Opening"},
    "Grasping_1": {"startTime": "timepoint_0.5", "endTime": "timepoint_0.75"}
    | {"performedBy": "DrawerHandle", "objectActedOn": "DrawerHandle"},
}
"""What each event states, written by hand from `EVENTS`; the episode ends at 1 s."""
CLASSES = {
    "SupportedBy_1": "SupportedBySituation",
    "Contact_1": "TouchingSituation",
    "Opening_1": "ContainerManipulation",
    "Grasping_1": "GraspingSomething",
    "Mug": "Cup",
    "Cupboard": "Cupboard",
    "Drawer": "Drawer",
    "DrawerHandle": "Handle",
    "kitchenette": "UnrealExperiment",
    "timepoint_0.25": "TimePoint",
}


@pytest.mark.parametrize("suffix", [".owl", ".ttl"])
def test_each_event_states_its_participants_in_their_roles_and_its_times(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run_ED{suffix}"
    write_semlog(kitchenette_episode(), path)
    format = ox.RdfFormat.RDF_XML if suffix == ".owl" else ox.RdfFormat.TURTLE
    quads = ox.parse(path=path, format=format)
    triples = [(quad.subject.value, quad.predicate.value, quad.object.value) for quad in quads]
    for id, roles in ROLES.items():
        found: dict[str, list[str]] = {}
        for subject, property, value in triples:
            if subject == LOG + id and property.startswith(KNOWROB):
                found.setdefault(property.removeprefix(KNOWROB), []).append(value.split("#")[-1])
        assert found.pop("inEpisode") == ["kitchenette"]
        assert {property: " ".join(sorted(values)) for property, values in found.items()} == roles
    for id, cls in CLASSES.items():
        assert (LOG + id, RDF_TYPE, KNOWROB + cls) in triples, id
    experiment = [(p.removeprefix(KNOWROB), v.split("#")[-1]) for s, p, v in triples if s == LOG + "kitchenette"]
    assert {value for property, value in experiment if property == "subAction"} == set(ROLES)
    assert {value for property, value in experiment if property == "experiment"} == {"kitchenette"}
    assert {value for property, value in experiment if property == "startTime"} == {"timepoint_0.0"}
    assert {value for property, value in experiment if property == "endTime"} == {"timepoint_1.0"}


def test_irregular_files_are_read_as_far_as_possible_and_everything_left_out_is_named(tmp_path: Path) -> None:
    path = tmp_path / "EventData.owl"
    kind = '<rdf:type rdf:resource="&knowrob;{cls}"/>'
    event = f'<owl:NamedIndividual rdf:about="&log;{{id}}">{kind}{{more}}</owl:NamedIndividual>'
    start = '<knowrob:startTime rdf:resource="&log;timepoint_{}"/>'
    thing = '<knowrob:objectActedOn rdf:resource="&log;Mug"/>'
    more = (
        event.format(id="Slide_1", cls="SlidingSituation", more=start.format(2.5) + thing),
        event.format(id="Slide_2", cls="SlidingSituation", more=start.format("soon") + thing),
        event.format(id="Slide_3", cls="SlidingSituation", more=start.format(2.5)),
        event.format(id="Dance_1", cls="Dancing", more=start.format(2.5) + thing),
        event.format(id="Second", cls="UnrealExperiment", more=start.format(9.0)),
    )
    path.write_text(ROBCOG.replace("</rdf:RDF>", "\n".join((*more, "</rdf:RDF>"))))
    found = read_semlog(path, kitchenette())
    slide = next(each for each in found.events if each.id == "Slide_1")
    assert (slide.begin_s, slide.end_s, slide.thing, slide.other, slide.agent) == (2.5, None, "Mug", None, None)
    assert not {"Slide_2", "Slide_3", "Dance_1", "Second"} & {each.id for each in found.events}
    assert set(found.findings) == {
        "ParticleTranslation_1 (ParticleTranslation) is no kind of event here",
        "Dance_1 (Dancing) is no kind of event here",
        "Slide_2 has no valid begin; it is left out",
        "Slide_3 has no object; it is left out",
        "there are 2 experiments; times are those of rcg_5",
        "Bowl3_9w2Y: no body of the map",
    }
    assert (found.name, found.begin_s, found.end_s) == ("rcg_5", 0.0, 12.5)
