"""Texts that are no valid IRIs where one is expected, such as the classes and names of bodies of foreign worlds."""

from __future__ import annotations

import pytest

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.maps import bundled_kitchen
from mindstage.rdf.vocabulary import LABEL
from mindstage.scene import Body, BodyId, GeometrySource, Iri, Pose, World
from tests.cases import each_case

INVALID = ["", "a b", "<x>", "http://x y", "http://x/{y}", "x\x00", "_:b 1", "\ud800"]


@pytest.fixture(scope="module")
def knowledge() -> KnowledgeBase:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    return knowledge


@each_case("text", INVALID)
def test_nothing_is_stated_about_a_text_that_is_no_iri(knowledge: KnowledgeBase, text: str) -> None:
    assert knowledge.statements(property=LABEL)
    assert knowledge.statements(property=Iri(text)) == ()
    assert knowledge.facts_of(Iri(text)) == ()
    assert knowledge.stated_classes(text) == ()
    assert not knowledge.is_a(text, "Cup") if text else True


@each_case("text", INVALID)
def test_a_body_whose_class_and_name_are_no_iris_is_simulated(text: str) -> None:
    body = Body(id=BodyId("thing"), iri=Iri(text), cls=Iri(text), pose=Pose((0.0, 0.0, 0.05)), size=(0.1, 0.1, 0.1))
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        assert simulation.spawn(World(iri=Iri("http://w"), bodies=(body,))).ok
        assert simulation.geometry["thing"].source is not GeometrySource.MESH
        simulation.step(0.1)
        assert simulation.snapshot().body("thing").cls == text
        assert [row.individual for row in simulation.ask("what_is")] == [text]
