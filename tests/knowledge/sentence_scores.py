"""Scores how sentences are understood: the corpus files of `sentences_corpus` against what the product answers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

from mindstage.errors import AmbiguousSentenceError, MindstageError
from mindstage.knowledge import KnowledgeBase
from mindstage.rdf.graphs import local_name

__all__ = ["CORPUS", "Entry", "Score", "entries", "score"]

CORPUS = Path(__file__).parent / "sentences_corpus"
_TRUTH = {"yes": True, "no": False, "unknown": None}


class Entry(NamedTuple):
    """A sentence and what is right."""

    sentence: str
    expected: str


class Score(NamedTuple):
    """How one sentence was answered."""

    entry: Entry
    verdict: str
    """right, wrong or refused."""
    got: str


def entries(name: str) -> Iterator[Entry]:
    """The sentences of a corpus file."""
    for line in (CORPUS / name).read_text(encoding="utf-8").splitlines():
        if line.strip() and not line.startswith("#"):
            sentence, _, expected = line.partition(" => ")
            yield Entry(sentence.strip(), expected.strip())


def score(kb: KnowledgeBase, entry: Entry, ids: Iterable[str]) -> Score:
    """Asks a sentence; an answer that is not right is wrong, an error is refused, which some sentences must be."""
    is_command = "do " in entry.expected.replace("refused|", "").replace("ambiguous|", "")[:3]
    try:
        if is_command or entry.expected in {"ambiguous", "ambiguous|refused", "refused|ambiguous"}:
            from mindstage.robots.commands import understand_command

            got = str(understand_command(kb, entry.sentence))
            return Score(entry, "right" if _is_command(entry.expected, got) else "wrong", got)
        answers = kb.ask(_as_sentence(entry.sentence))
    except AmbiguousSentenceError as error:
        return Score(entry, "right" if "ambiguous" in entry.expected else "refused", str(error))
    except MindstageError as error:
        return Score(entry, "right" if "refused" in entry.expected else "refused", str(error))
    expected = entry.expected.removeprefix("refused|")
    got = f"{answers.conclusion.truth} {answers.conclusion.sentence} [{'; '.join(answers.notes)}]"
    return Score(entry, "right" if _is_right(expected, answers, tuple(ids)) else "wrong", got)


def _as_sentence(text: str) -> str:
    return text if " " in text else f"{text}?"


def _is_command(expected: str, got: str) -> bool:
    words = [set(word.split("|")) for word in expected.split("do ", 1)[-1].split()]
    given = re.sub(r"\w+=", "", got).split()
    return len(words) == len(given) and all(each in word for each, word in zip(given, words, strict=True))


def _is_right(expected: str, answers: Any, ids: tuple[str, ...]) -> bool:
    if expected in _TRUTH:
        return bool(answers.conclusion.truth is _TRUTH[expected])
    if expected == "refused":
        return False
    if expected.startswith("{"):
        return _things(answers) in [set(_expanded(each, ids)) for each in _sets(expected)]
    return any(_is_number(each, answers) for each in expected.split("|"))


def _sets(expected: str) -> Iterator[str]:
    body = expected.strip("{}")
    yield from (body.split("|") if "|" in body else [body])


def _expanded(names: str, ids: tuple[str, ...]) -> Iterator[str]:
    for name in names.replace("{", " ").replace("}", " ").split():
        yield from [each for each in ids if fnmatchcase(each, name)] if {"*", "?"} & {*name} else [name]


def _things(answers: Any) -> set[str]:
    if answers.question.name == "in_words":
        is_place = any(row.other is not None for row in answers)
        return {local_name(row.other if is_place else row.thing) for row in answers if row.holds and row.thing}
    column = answers.subject_column
    return set() if column is None else {local_name(getattr(row, column)) for row in answers}


def _is_number(expected: str, answers: Any) -> bool:
    number, _, tolerance = expected.partition("~")
    values = [row.value for row in answers if getattr(row, "value", None) is not None]
    if not tolerance:
        return answers.question.name == "in_words" and not values and len(_things(answers)) == float(number)
    return bool(values) and all(abs(float(value) - float(number)) <= float(tolerance) for value in values)
