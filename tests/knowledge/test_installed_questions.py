"""Questions are entry points: each declared one is installed, and is found without importing all others."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import mindstage
from mindstage.access.policies import Access
from mindstage.access.resources import from_outside
from mindstage.errors import QuestionNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge import questions as declarations
from mindstage.knowledge.questions import (
    AnswerRow,
    IndividualName,
    Question,
    QuestionContext,
    get_question,
    list_questions,
    question,
    question_names,
)
from mindstage.knowledge.sentences import questions_with_words, sentence_patterns, understand
from mindstage.registry import Group, extensions
from mindstage.scene import Iri
from tests.cases import each_case

INSTALLED = extensions(Group.QUESTIONS)
SOURCES = Path(mindstage.__file__).parent
DECLARED = [each for each in list_questions() if each.module.startswith("mindstage.")]


class Cheer(AnswerRow, frozen=True):
    thing: IndividualName


@pytest.fixture
def cheers() -> Iterator[Question[Cheer]]:
    """A question of a user's program, which is no entry point."""

    @question(sentences=("what cheers for {thing}",))
    def what_cheers(kb: QuestionContext, thing: IndividualName | None = None) -> Iterator[Cheer]:
        """What cheers."""
        yield Cheer(thing=Iri(thing or "urn:nobody"))

    yield what_cheers
    del declarations._declared[what_cheers.module, what_cheers.name]


def test_every_declared_question_is_an_entry_point_that_ports_offer() -> None:
    declared = {
        (".".join(["mindstage", *path.relative_to(SOURCES).with_suffix("").parts]), node.name)
        for path in SOURCES.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
        for decorator in node.decorator_list
        if ast.unparse(decorator).partition("(")[0] == "question"
    }
    assert declared == {(each.module, each.attribute) for each in INSTALLED.values() if each.is_offered}
    assert {each.name: each.module for each in DECLARED} == {each.name: each.module for each in INSTALLED.values()}


@each_case("declared", DECLARED, ids=lambda each: each.name)
def test_every_wording_of_a_question_leads_to_it(declared: Question[AnswerRow]) -> None:
    for pattern in sentence_patterns(declared):
        for words in pattern.word_sets():
            assert declared in questions_with_words(words), pattern.text()
            assert declared in questions_with_words({*words, "milk", "carton"})


@each_case("declared", DECLARED, ids=lambda each: each.name)
def test_words_that_no_wording_has_lead_to_no_question(declared: Question[AnswerRow]) -> None:
    sets = {words for pattern in sentence_patterns(declared) for words in pattern.word_sets()}
    smallest = min(sets, key=len, default=frozenset())  # the grammar reads some without wordings
    for absent in smallest:
        rest = smallest - {absent}
        assert (declared in questions_with_words(rest)) == any(words <= rest for words in sets)


@each_case(
    ("sentence", "question"),
    [
        ("what is left of fridge", "direction_of"),
        ("which things are to the left of the fridge?", "direction_of"),
        ("what is beside milk_carton_1", "in_words"),
        ("is the fridge closed?", "in_words"),
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
    assert {*loaded} & {each.module for each in INSTALLED.values()} == {"mindstage.knowledge.queries.storage"}


def test_the_order_of_imports_does_not_change_the_order_of_questions() -> None:
    code = (
        "import mindstage.imagination.trial_questions, mindstage.knowledge.queries.visibility\n"
        "from mindstage.knowledge.questions import list_questions\n"
        "print(*(each.name for each in list_questions()))"
    )
    listed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert listed == sorted(INSTALLED)


def test_a_question_of_a_users_program_needs_no_entry_point(cheers: Question[Cheer]) -> None:
    assert get_question("what-cheers") is cheers
    assert question_names() == (*INSTALLED, "what_cheers")
    assert list_questions()[-1] is cheers
    kb = KnowledgeBase()
    kb.load("bundled:kitchen")
    answers = kb.ask("what cheers for milk_carton_1?")
    assert answers.question is cheers
    assert [row.thing.rpartition("#")[2] for row in answers] == ["milk_carton_1"]


def test_a_question_of_a_users_program_is_not_offered_to_clients_of_ports(cheers: Question[Cheer]) -> None:
    with from_outside():
        assert cheers not in list_questions()
        assert "what_cheers" not in question_names()
        with pytest.raises(QuestionNotFoundError):
            get_question("what_cheers")
        assert not [each for each in questions_with_words({"what", "cheers", "for", "milk"}) if each is cheers]


def test_a_question_of_a_users_program_is_offered_if_it_declares_that_it_reads() -> None:
    @question(access=Access.READ)
    def what_glows(kb: QuestionContext, thing: IndividualName | None = None) -> Iterator[Cheer]:
        """What glows."""
        yield Cheer(thing=Iri("urn:lamp"))

    try:
        with from_outside():
            assert get_question("what_glows") is what_glows
    finally:
        del declarations._declared[what_glows.module, what_glows.name]


def test_a_question_of_a_users_program_hides_no_installed_one() -> None:
    def nearest(kb: QuestionContext, thing: IndividualName | None = None) -> Iterator[Cheer]:
        """Another question of that name."""
        yield Cheer(thing=Iri("urn:nobody"))

    with pytest.raises(ValueError, match=r"two questions nearest: .*and of mindstage\.knowledge\.queries\.proximity"):
        question(nearest)
    assert get_question("nearest").module == "mindstage.knowledge.queries.proximity"
    assert [each.name for each in list_questions()].count("nearest") == 1


def test_an_unknown_question_is_an_error_with_the_nearest_name() -> None:
    with pytest.raises(QuestionNotFoundError, match="near: 'storage_place'"):
        get_question("storage_plaze")
