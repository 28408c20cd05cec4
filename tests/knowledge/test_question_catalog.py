"""The catalog of questions agrees with the declarations, and a question is found without importing all others."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import mindstage
from mindstage.errors import QuestionNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge import questions as declarations
from mindstage.knowledge.question_catalog import CATALOG
from mindstage.knowledge.questions import (
    DECLARING_MODULES,
    AnswerRow,
    IndividualName,
    Question,
    QuestionContext,
    get_question,
    list_questions,
    question,
    question_names,
    questions_with_words,
)
from mindstage.knowledge.sentences import sentence_patterns, understand
from mindstage.scene import Iri

SOURCES = Path(mindstage.__file__).parent
DECLARED = [each for each in list_questions() if each.module.startswith("mindstage.")]


class Cheer(AnswerRow, frozen=True):
    thing: IndividualName


@pytest.fixture
def cheers() -> Iterator[Question[Cheer]]:
    """A question of a user's program, which no catalog has."""

    @question(sentences=("what cheers for {thing}",))
    def what_cheers(kb: QuestionContext, thing: IndividualName | None = None) -> Iterator[Cheer]:
        """What cheers."""
        yield Cheer(thing=Iri(thing or "urn:nobody"))

    yield what_cheers
    del declarations._QUESTIONS[what_cheers.name]


def test_the_catalog_has_the_declared_questions_in_their_order() -> None:
    assert [(name, entry.module) for name, entry in CATALOG.items()] == [(each.name, each.module) for each in DECLARED]


def test_every_module_that_declares_questions_is_listed() -> None:
    declaring = {
        ".".join(["mindstage", *path.relative_to(SOURCES).with_suffix("").parts])
        for path in SOURCES.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
        for decorator in node.decorator_list
        if ast.unparse(decorator).partition("(")[0] == "question"
    }
    assert declaring == {*DECLARING_MODULES}


@pytest.mark.parametrize("declared", DECLARED, ids=lambda each: each.name)
def test_every_wording_of_a_question_leads_to_it(declared: Question[AnswerRow]) -> None:
    for pattern in sentence_patterns(declared):
        for words in pattern.word_sets():
            assert declared in questions_with_words(words), pattern.text()
            assert declared in questions_with_words({*words, "milk", "carton"})


@pytest.mark.parametrize("declared", DECLARED, ids=lambda each: each.name)
def test_words_that_no_wording_has_lead_to_no_question(declared: Question[AnswerRow]) -> None:
    sets = {words for pattern in sentence_patterns(declared) for words in pattern.word_sets()}
    smallest = min(sets, key=len)
    for absent in smallest:
        rest = smallest - {absent}
        assert (declared in questions_with_words(rest)) == any(words <= rest for words in sets)


@pytest.mark.parametrize(
    ("sentence", "question"),
    [
        ("what is left of fridge", "direction_of"),
        ("which things are to the left of the fridge?", "direction_of"),
        ("what is nextto milk_carton_1", "where_is"),
        ("what is beside milk_carton_1", "where_is"),
        ("is the fridge closed?", "openings"),
    ],
)
def test_values_of_enumerations_are_words_of_a_question(sentence: str, question: str) -> None:
    kb = KnowledgeBase()
    kb.load("bundled:kitchen")
    assert understand(kb, sentence).question.name == question


def test_a_sentence_without_a_value_of_an_enumeration_does_not_import_its_question() -> None:
    assert "direction_of" not in {each.name for each in questions_with_words({"where", "is", "milk"})}


def test_a_question_is_found_without_importing_those_of_other_modules() -> None:
    code = (
        "import sys\n"
        "from mindstage.knowledge.questions import get_question\n"
        "assert get_question('storage-place').name == 'storage_place'\n"
        "print(*(name for name in sys.modules if name.startswith('mindstage.')))"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert {*loaded} & {*DECLARING_MODULES} == {"mindstage.knowledge.queries.storage"}


def test_the_order_of_imports_does_not_change_the_order_of_questions() -> None:
    code = (
        "import mindstage.imagination.trial_questions, mindstage.knowledge.queries.visibility\n"
        "from mindstage.knowledge.questions import list_questions\n"
        "print(*(each.name for each in list_questions()))"
    )
    listed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert listed == [*CATALOG]


def test_a_question_of_a_users_program_needs_no_entry(cheers: Question[Cheer]) -> None:
    assert get_question("what-cheers") is cheers
    assert question_names() == (*CATALOG, "what_cheers")
    assert list_questions()[-1] is cheers
    kb = KnowledgeBase()
    kb.load("bundled:kitchen")
    answers = kb.ask("what cheers for milk_carton_1?")
    assert answers.question is cheers
    assert [row.thing.rpartition("#")[2] for row in answers] == ["milk_carton_1"]


def test_an_unknown_question_is_an_error_with_the_nearest_name() -> None:
    with pytest.raises(QuestionNotFoundError, match="near: 'storage_place'"):
        get_question("storage_plaze")
