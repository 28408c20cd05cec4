"""How many sentences are understood rightly: by corpora whose results were derived from the map file by hand."""

from __future__ import annotations

import hashlib
from collections import Counter

import pytest

from mindstage.errors import AmbiguousSentenceError, SentenceNotUnderstoodError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.grammar import IGNORED_WORDS, OPERATORS, PAST_WORDS
from mindstage.knowledge.queries.worded import read_question
from mindstage.knowledge.sentences import understand
from mindstage.maps import bundled_kitchen
from tests.knowledge.sentence_scores import CORPUS, Score, entries, score

HELD_OUT_SHA256 = "b0d0721190e40c4c411b7411a3c22abc43aeebfb11ca2167895cdee88f1c5a80"
"""Of the sentences that were written before the grammar, and that nothing may be tuned on."""


@pytest.fixture(scope="module")
def kitchen() -> KnowledgeBase:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    return knowledge


def scores(kitchen: KnowledgeBase, name: str) -> list[Score]:
    ids = [body.id for body in kitchen.world().bodies]
    return [score(kitchen, each, ids) for each in entries(name)]


def test_sentences_of_development_are_answered_rightly(kitchen: KnowledgeBase) -> None:
    failed = [each for each in scores(kitchen, "development.txt") if each.verdict != "right"]
    assert failed == []


def test_sentences_kept_apart_are_answered_rightly(kitchen: KnowledgeBase) -> None:
    assert hashlib.sha256((CORPUS / "held_out.txt").read_bytes()).hexdigest() == HELD_OUT_SHA256
    counts = Counter(each.verdict for each in scores(kitchen, "held_out.txt"))
    assert counts["right"] >= 0.85 * counts.total(), counts


def pairs() -> list[tuple[str, str]]:
    lines = (CORPUS / "minimal_pairs.txt").read_text(encoding="utf-8").splitlines()
    return [(one.strip(), two.strip()) for one, _, two in (line.partition("|") for line in lines if line[:1] != "#")]


def reading(kitchen: KnowledgeBase, sentence: str) -> str:
    try:
        return str(understand(kitchen, sentence))
    except (SentenceNotUnderstoodError, AmbiguousSentenceError):
        return ""


def test_sentences_that_differ_in_a_word_are_not_understood_alike(kitchen: KnowledgeBase) -> None:
    readings = {pair: [reading(kitchen, each) for each in pair] for pair in pairs()}
    assert len(readings) >= 150
    assert [pair for pair, (one, two) in readings.items() if one == two] == []
    assert sum(bool(one) for one, _ in readings.values()) > 0.9 * len(readings)  # refusing all would differ, too


@pytest.mark.parametrize("name", ["development.txt", "held_out.txt"])
def test_a_reading_is_understood_as_itself(kitchen: KnowledgeBase, name: str) -> None:
    differing = []
    for each in entries(name):
        question = read_question(kitchen, each.sentence)
        if question is not None and read_question(kitchen, str(question)) != question:
            differing.append((each.sentence, str(question), str(read_question(kitchen, str(question)))))
    assert differing == []


def test_ignored_words_change_no_answer() -> None:
    assert len(IGNORED_WORDS) <= 30
    numbers = {"one", "two", "three", "exactly", "both", "half"}
    prepositions = {"in", "on", "under", "above", "over", "by", "near", "of", "to", "with", "between", "left", "right"}
    assert not IGNORED_WORDS & (OPERATORS | PAST_WORDS | numbers | prepositions | {"was", "will", "than", "as"})
