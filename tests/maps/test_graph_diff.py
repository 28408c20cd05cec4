"""Lost statements: exactly those that a written file does not contain."""

from __future__ import annotations

from pathlib import Path

import pyoxigraph as ox
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mindstage.maps import MapFormat, lost_statements, write_map
from mindstage.scene import Statement
from tests.kitchenette import kitchenette
from tests.maps.small_maps import body_turtle, individual, knowledge_base_from, room_map, slide_joint

ROOM = room_map(
    body_turtle("table", ':e e:of [ e:a 1 ; e:b [ e:c "d" ] ]'.removeprefix(":e ")),
    body_turtle("cup", 'k:mass "0.50"^^xsd:float', "k:parent :table"),
    slide_joint("slide", "table", "cup"),
    ':cup e:near _:x . _:x e:is "something" . :table e:near _:x .',
)


def lost(before: str, after: str, folder: Path) -> tuple[Statement, ...]:
    origins = []
    for name, text in (("before", before), ("after", after)):
        (folder / f"{name}.ttl").write_text(text, encoding="utf-8")
        origins.append(knowledge_base_from(folder / f"{name}.ttl").source_view())
    return lost_statements(*origins)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder for all examples of Hypothesis, which overwrite their files."""
    return tmp_path_factory.mktemp("losses")


ALIKE = {
    "digits": ('"0.50"^^', '"5.0E-1"^^'),
    "a pose's digits": ('"1.0 2.0 3.0"', '"1 2.000 3e0"'),
    "the name of a pose": (":cup-pose", ":cup-pose-2"),
    "the name of a limit": (":slide-linear", ":slide-linear-7"),
    "a label": ("_:x", "_:other"),
    "more statements": (":cup e:near", ':cup e:more "stated" . :cup e:near'),
}
OTHERWISE = {
    "a number": ('"0.50"^^', '"0.51"^^'),
    "a pose's number": ('"1.0 2.0 3.0"', '"1.0 2.0 3.1"'),
    "a limit": ('"0.45"^^', '"0.46"^^'),
    "a text": ('"something"', '"something else"'),
    "deep inside": ('"d"', '"e"'),
    "a relation": ("k:parent :table ", "k:parent :cup "),
    "a class": ("k:Cup ;", "k:Mug ;"),
}


@pytest.mark.parametrize("what", ALIKE)
def test_an_equivalent_statement_is_not_a_loss(what: str, tmp_path: Path) -> None:
    old, new = ALIKE[what]
    assert old in ROOM
    assert lost(ROOM, ROOM.replace(old, new), tmp_path) == ()


@pytest.mark.parametrize("what", OTHERWISE)
def test_a_changed_statement_is_a_loss(what: str, tmp_path: Path) -> None:
    old, new = OTHERWISE[what]
    assert old in ROOM
    assert lost(ROOM, ROOM.replace(old, new), tmp_path)


def test_a_pose_can_be_named_or_blank(tmp_path: Path) -> None:
    pose = ':cup-pose a owl:NamedIndividual, k:Pose ; k:translation "1.0 2.0 3.0" ; k:quaternion "1.0 0.0 0.0 0.0" .'
    assert pose in ROOM
    nameless = ROOM.replace(pose, "").replace(":cup-pose", f"[ {pose.removeprefix(':cup-pose ').rstrip(' .')} ]")
    assert lost(nameless, ROOM, tmp_path) == ()
    (line, *_) = lost(nameless, ROOM.replace(pose, pose.replace("3.0", "4.0")), tmp_path)
    assert line.id == individual("cup")


@settings(max_examples=25)
@given(at=st.integers(min_value=0))
def test_every_omitted_statement_is_found(at: int, folder: Path) -> None:
    world = kitchenette()
    quads = list(ox.parse(write_map(world, format=MapFormat.TURTLE).encode(), ox.RdfFormat.TURTLE))
    gone = quads.pop(at % len(quads))
    origins = []
    for name, statements in (("before", [*quads, gone]), ("after", quads)):
        ox.serialize(statements, folder / f"{name}.nt", ox.RdfFormat.N_TRIPLES)
        origins.append(knowledge_base_from(folder / f"{name}.nt").source_view(world.iri))
    assert lost_statements(*origins)


def test_rounding_by_the_engine_is_not_a_loss(tmp_path: Path) -> None:
    after = ROOM.replace('"1.0 2.0 3.0"', '"1.0 2.0 3.000001"').replace('"0.50"^^', '"0.6"^^')
    for name, text in (("before", ROOM), ("after", after)):
        (tmp_path / f"{name}.ttl").write_text(text, encoding="utf-8")
    before, rounded = (knowledge_base_from(tmp_path / f"{name}.ttl").source_view() for name in ("before", "after"))
    assert lost_statements(before, rounded, moved={individual("cup"), individual("table"), individual("slide")}) == ()
    assert {line.id for line in lost_statements(before, rounded, moved={individual("cup")})} == {
        individual("table"),
        individual("slide"),
    }
