"""Answers: rows with a subject, conversion to plain values, tables for notebooks."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from weakref import ref

import msgspec
import pytest

from mindstage.errors import AmbiguousNameError, NameNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import Answers, StoragePlace, get_question, list_questions
from mindstage.scene import Iri
from tests.cases import each_case

KITCHEN = "http://mindstage.org/maps/kitchen.owl#"


@pytest.fixture(scope="module")
def kb() -> KnowledgeBase:
    knowledge = KnowledgeBase()
    knowledge.load("bundled:kitchen")
    return knowledge


@each_case(
    ("question", "args", "individual"),
    [
        ("storage_place_in_environment", {"item": "CowsMilk"}, "fridge"),
        ("storage_place", {"item": "CowsMilk"}, "fridge"),  # the only refrigerator of the map
        ("articulated_parts", {"thing": "fridge"}, "fridge_door"),
        ("articulated_parts", {"part": "fridge_door"}, "fridge"),
        ("where_is", {"thing": "milk_carton_1", "relation": "inside"}, "fridge"),
    ],
)
def test_a_row_has_the_individual_that_was_asked_for(
    kb: KnowledgeBase, question: str, args: dict[str, str], individual: str
) -> None:
    answers = kb.ask(question, **args)
    assert {row.individual for row in answers} == {KITCHEN + individual}
    assert {row.instances for row in answers} == {(KITCHEN + individual,)}


def test_the_subject_of_a_handle_is_the_handle(kb: KnowledgeBase) -> None:
    (row,) = kb.ask("handle_of", individual="fridge_door")
    assert (row.subject, row.individual) == (f"{KITCHEN}fridge_door_handle", f"{KITCHEN}fridge_door")


def test_a_row_about_a_class_has_its_members_as_instances(kb: KnowledgeBase) -> None:
    (row,) = kb.ask("individual_of_class", cls="Refrigerator")[:1]
    assert row.individual == f"{KITCHEN}fridge"
    several = kb.ask("subclass_of", superclass="Cupboard")
    with_members = next(row for row in several if len(row.instances) > 1)
    with pytest.raises(AmbiguousNameError):
        with_members.individual  # noqa: B018
    none = next(row for row in kb.ask("storage_place") if not row.instances)
    with pytest.raises(NameNotFoundError, match="no individual of the class"):
        none.individual  # noqa: B018


def test_a_row_without_a_question_has_no_subject(kb: KnowledgeBase) -> None:
    row = StoragePlace(item=Iri("a"), place=Iri("b"), because_of=Iri("c"), generality=0)
    with pytest.raises(AttributeError, match="not returned by a question"):
        row.subject  # noqa: B018
    with pytest.raises(AttributeError, match="is a map"):
        kb.ask("maps")[0].individual  # noqa: B018
    with pytest.raises(AttributeError, match="is a property"):
        kb.ask("class_properties", cls="Refrigerator", value="Perishable")[0].instances  # noqa: B018


@each_case("question", list_questions(), ids=lambda each: each.name)
def test_answers_to_every_question_convert_to_dicts_and_tables(kb: KnowledgeBase, question: object) -> None:
    answers = kb.ask(question)  # type: ignore[call-overload]
    dicts = answers.to_dicts()
    assert dicts == [msgspec.to_builtins(row) for row in answers]
    assert all(list(each) == list(answers.question.row.__struct_fields__) for each in dicts)
    assert answers._repr_html_().count("<tr>") == 1 + min(len(answers), 100)
    assert repr(answers).startswith(f"<Answers to {answers.question.name}(")
    assert "\n" not in repr(answers)
    for row in answers[:3]:
        assert repr(row).startswith(f"{type(row).__name__}(")
        assert msgspec.convert(msgspec.to_builtins(row), type(row)) == row, "the question is not part of a row"
        assert hash(row) == hash(msgspec.structs.replace(row))


def test_the_repr_of_a_knowledge_base_lists_its_maps(kb: KnowledgeBase, tmp_path: Path) -> None:
    assert repr(kb) == "<KnowledgeBase: 1 map (kitchen), 2 sources>"
    assert repr(KnowledgeBase(bundled_ontology=False)) == "<KnowledgeBase: 0 maps, 0 sources>"


def closed_base(question: str, **args: str) -> tuple[Answers[Any], ref[KnowledgeBase]]:
    """The answers of a knowledge base that was closed and is not referred to any more."""
    with KnowledgeBase() as knowledge:
        knowledge.load("bundled:kitchen")
        return knowledge.ask(question, **args), ref(knowledge)


def test_answers_about_classes_have_members_when_their_knowledge_base_is_gone() -> None:
    answers, base = closed_base("storage_place", item="CowsMilk")
    assert answers[0].instances == (f"{KITCHEN}fridge",)
    assert answers[0].individual == f"{KITCHEN}fridge"
    row = answers[0]
    del answers
    assert row.individual == f"{KITCHEN}fridge"
    del row
    assert base() is None, "it is freed with the answers, without a run of the garbage collector"


def test_answers_about_individuals_keep_no_knowledge_base_alive() -> None:
    answers, base = closed_base("articulated_parts", thing="fridge")
    assert base() is None
    assert {row.individual for row in answers} == {f"{KITCHEN}fridge_door"}


def test_answers_of_another_process_have_no_members() -> None:
    row = StoragePlace(item=Iri("a"), place=Iri("b"), because_of=Iri("c"), generality=0)
    answers = Answers(get_question("storage_place"), {}, [row], ())
    with pytest.raises(AttributeError, match="without a knowledge base"):
        answers[0].instances  # noqa: B018
