"""The class hierarchy, including cycles."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.knowledge import KnowledgeBase
from mindstage.rdf.taxonomy import ClassHierarchy
from mindstage.scene import Iri
from tests.maps.small_maps import knowledge_base_from, knowrob_iri, room_map

A, B, C, D, E, F = (Iri(f"http://e#{name}") for name in "ABCDEF")


@pytest.fixture
def diamond() -> ClassHierarchy:
    """A above B and C, both above D, which is above E."""
    return ClassHierarchy([(D, C), (D, B), (C, A), (B, A), (E, D)])


def test_ancestors_come_nearest_first(diamond: ClassHierarchy) -> None:
    assert diamond.ancestors(E) == (D, B, C, A)
    assert diamond.ancestors(A) == diamond.ancestors(F) == ()


def test_descendants_are_found_at_any_depth(diamond: ClassHierarchy) -> None:
    assert diamond.descendants(A) == {B, C, D, E}
    assert diamond.descendants(E) == diamond.descendants(F) == frozenset()


def test_every_class_is_a_itself(diamond: ClassHierarchy) -> None:
    assert diamond.is_a(E, A)
    assert diamond.is_a(F, F)
    assert not diamond.is_a(A, E)


def test_a_cycle_is_handled() -> None:
    circle = ClassHierarchy([(A, B), (B, C), (C, A), (A, A), (D, A)])
    assert circle.ancestors(A) == (B, C)
    assert circle.descendants(A) == {B, C, D}
    assert circle.is_a(C, B)
    assert circle.most_specific([C, B]) == C
    assert circle.most_specific([C, D, B]) == D


def test_the_most_specific_of_unrelated_classes_is_the_first(diamond: ClassHierarchy) -> None:
    assert diamond.most_specific([C, B]) == C
    assert diamond.most_specific([A, C, B]) == C
    assert diamond.most_specific([A]) == A


def test_equivalent_classes_are_subclasses_of_each_other(tmp_path: Path) -> None:
    path = tmp_path / "map.ttl"
    path.write_text(room_map("k:Mug owl:equivalentClass k:Cup . k:Cup rdfs:subClassOf k:Vessel ."), encoding="utf-8")
    knowledge = knowledge_base_from(path)
    assert knowledge.ancestors(knowrob_iri("Mug")) == (knowrob_iri("Cup"), knowrob_iri("Vessel"))
    assert knowledge.descendants(knowrob_iri("Vessel")) == {knowrob_iri("Cup"), knowrob_iri("Mug")}


def test_the_bundled_ontology_is_loaded_by_default() -> None:
    latch, handle = Iri("http://mindstage.org/ontology#DoorLatch"), knowrob_iri("Handle")
    assert handle in KnowledgeBase().ancestors(latch)
    assert KnowledgeBase(bundled_ontology=False).ancestors(latch) == ()


def test_the_hierarchy_is_updated_after_loading(tmp_path: Path) -> None:
    first, second = tmp_path / "first.ttl", tmp_path / "second.ttl"
    first.write_text(room_map("k:Mug rdfs:subClassOf k:Cup ."), encoding="utf-8")
    second.write_text(room_map("k:Cup rdfs:subClassOf k:Vessel ."), encoding="utf-8")
    knowledge = knowledge_base_from(first)
    assert knowledge.ancestors(knowrob_iri("Mug")) == (knowrob_iri("Cup"),)
    knowledge.load([second])
    assert knowledge.ancestors(knowrob_iri("Mug")) == (knowrob_iri("Cup"), knowrob_iri("Vessel"))
