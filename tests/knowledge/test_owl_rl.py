"""Statements derived by the rules of OWL 2 RL."""

from __future__ import annotations

import os
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from mindstage.errors import ReasonerUnavailableError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import list_questions
from mindstage.maps import bundled_kitchen
from mindstage.rdf.graphs import local_name
from tests.maps.small_maps import ROOM_NAMESPACE, body_turtle, individual, knowledge_base_from, room_map

_SAME = f"SELECT ?other {{ <{ROOM_NAMESPACE}a> owl:sameAs ?other }}"


@pytest.fixture
def reasoner() -> None:
    """The library that applies the rules."""
    if find_spec("reasonable") is None:
        reason = "reasonable is not installed (the extra closure)"
        pytest.fail(reason) if os.environ.get("CI") else pytest.skip(reason)


@pytest.fixture
def kb(reasoner: None, tmp_path: Path) -> KnowledgeBase:
    """A map with a functional property: two owners of the same object are the same individual."""
    path = tmp_path / "map.ttl"
    path.write_text(
        room_map(
            "e:ownedBy a owl:ObjectProperty, owl:FunctionalProperty . e:Cat a owl:Class .",
            ":mouse e:ownedBy :a, :b .",
            body_turtle("a", cls="k:Cup"),
            body_turtle("b", cls="e:Cat"),
            body_turtle("box", "k:properPhysicalParts :lid"),
            body_turtle("lid", "k:properPhysicalParts :knob"),
            body_turtle("knob"),
            "k:properPhysicalParts a owl:TransitiveProperty .",
        ),
        encoding="utf-8",
    )
    return knowledge_base_from(path)


def members_of(kb: KnowledgeBase, cls: str) -> list[str]:
    return [local_name(row.individual) for row in kb.ask("individual_of_class", cls=cls)]


def test_same_individuals_are_derived_and_forgotten(kb: KnowledgeBase) -> None:
    before = {str(quad) for quad in kb._store.quads_for_pattern(None, None, None)}
    assert members_of(kb, "Cat") == ["b"]
    count = kb.materialize()
    assert count == len(list(kb._store.quads_for_pattern(None, None, None))) - len(before)
    assert [local_name(str(row[0].value)) for row in kb.sparql(_SAME).rows] == ["b"]
    assert members_of(kb, "Cat") == ["a", "b"]
    (row,) = kb.ask("individual_of_class", cls="Cat", individual="a")
    assert kb.explain("individual_of_class", row) == ("a type Cat, by the rules of OWL 2 RL",)
    assert kb.forget_derived()
    assert not kb.forget_derived()
    assert {str(quad) for quad in kb._store.quads_for_pattern(None, None, None)} == before
    assert members_of(kb, "Cat") == ["b"]


def test_asserted_classes_come_before_derived_ones(kb: KnowledgeBase) -> None:
    kb.tell("e:BigCat", "subClassOf", "Cat")
    kb.tell("e:LazyCat", "subClassOf", "e:BigCat")
    kb.tell("b", "type", "e:LazyCat")
    kb.materialize()
    (row,) = kb.ask("everything_in_map", individual="a")
    assert local_name(row.cls) == "Cup"
    (row,) = kb.ask("what_is", individual="a")
    assert [local_name(cls) for cls in row.classes] == ["Cup", "LazyCat"]


def test_deriving_twice_adds_nothing(kb: KnowledgeBase) -> None:
    assert kb.materialize() == kb.materialize() > 0


def test_the_depth_of_a_part_comes_from_asserted_statements(kb: KnowledgeBase) -> None:
    before = list(kb.ask("part_of", whole="box"))
    kb.materialize()
    assert list(kb.ask("part_of", whole="box")) == before
    assert [row.depth for row in before] == [1, 2]


def test_retractions_drop_derived_statements_and_assertions_do_not(kb: KnowledgeBase) -> None:
    kb.materialize()
    kb.tell("knob", "type", "Cat")
    assert members_of(kb, "Cat") == ["a", "b", "knob"]
    kb.retract(individual("mouse"), "ownedBy", "b")
    assert members_of(kb, "Cat") == ["b", "knob"]
    assert kb.materialize() > 0
    assert members_of(kb, "Cat") == ["b", "knob"]


def test_a_derived_statement_can_be_asserted(kb: KnowledgeBase) -> None:
    kb.materialize()
    assert kb.tell("a", "type", "Cat")
    kb.forget_derived()
    assert members_of(kb, "Cat") == ["a", "b"]


def test_the_usual_questions_do_not_need_derivation(reasoner: None) -> None:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    world, before = (
        kb.world(),
        {declared.name: list(kb.ask(declared)) for declared in list_questions() if not declared.uses_current_state},
    )
    assert kb.materialize() > 1000
    assert {name: list(kb.ask(name)) for name in before} == before
    assert kb.world() == world


def test_a_missing_library_is_reported_with_the_extra_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "reasonable", None)
    with pytest.raises(ReasonerUnavailableError, match=r"pip install 'mindstage\[closure\]'"):
        KnowledgeBase().materialize()
