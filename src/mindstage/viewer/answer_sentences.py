"""Answers as one sentence, which people read before the table: "Milk carton 1 is in the fridge."."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from mindstage.knowledge.queries import Answers, subject_column
from mindstage.rdf.graphs import local_name

__all__ = ["answer_sentence", "listed", "name_in_words"]

_LISTED = 3
"""The number of things that a sentence names; of more, the others are counted."""
_RELATIONS = {"inside": "in", "left of": "left of", "right of": "right of"}
_YES_OR_NO = re.compile(r"(is|are|can|does|do|has|have|will)\b", re.IGNORECASE)
_MEASURES = re.compile(r"([WHDL]\d+)+$")


def name_in_words(name: str) -> str:
    """A name as people say it: "milk carton 1" of `milk_carton_1`, "base cupboard" of `BaseCupboardW60H86`."""
    name = _MEASURES.sub("", name) or name
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    words = [word if word.isupper() and len(word) > 1 else word.lower() for word in re.split(r"[\s_]+", name) if word]
    return " ".join(words)


def listed(names: Sequence[str]) -> str:
    """Names as a list: "a, b and 3 more"."""
    unique = list(dict.fromkeys(names))
    shown = unique if len(unique) <= _LISTED + 1 else [*unique[:_LISTED], f"{len(unique) - _LISTED} more"]
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} and {shown[-1]}"


def answer_sentence(answers: Answers[Any], labels: Mapping[str, str], *, asked: str) -> str:
    """A sentence that names the result.

    Args:
        answers: the answers.
        labels: labels of bodies by IRI.
        asked: what was asked, as a person put it.
    """

    def say(value: object) -> str:
        text = str(value)
        return labels.get(text) or name_in_words(local_name(text) if "://" in text else text)

    if answers.is_concluded:
        return _with_names(answers, labels, say)
    name = answers.question.name
    is_yes_or_no = name in _DECIDED_BY_ROWS and _YES_OR_NO.match(asked) is not None
    if not answers:
        reason = answers.missing[0].reason if answers.missing else "nothing in this world matches"
        return f"{'No' if is_yes_or_no else 'No answer'}: {reason}."
    text = _SENTENCES.get(name, _reasons if "why" in answers[0].__struct_fields__ else _things)(answers, say)
    if is_yes_or_no:
        text = f"yes: {text}"
    return f"{text[:1].upper()}{text[1:]}."


Say = Callable[[object], str]


def _with_names(answers: Answers[Any], labels: Mapping[str, str], say: Say) -> str:
    """The sentence of a question, with labels and words instead of the ids of the individuals in its rows."""
    values = (getattr(row, field) for row in answers for field in row.__struct_fields__)
    named = {local_name(each): say(each) for each in (*labels, *(str(each) for each in values if "://" in str(each)))}
    sentence = answers.conclusion.sentence
    if named:
        words = "|".join(map(re.escape, sorted(named, key=len, reverse=True)))
        sentence = re.sub(rf"(?<![\w-])({words})(?![\w-])", lambda found: named[found[0]], sentence)
    return f"{sentence[:1].upper()}{sentence[1:]}"


def _the(text: str) -> str:
    """A name with an article, unless it ends with a number: "the fridge", "drawer 2"."""
    return text if text[-1:].isdigit() else f"the {text}"


def _are(names: Sequence[str]) -> str:
    return "is" if len(dict.fromkeys(names)) == 1 else "are"


def _where(answers: Answers[Any], say: Say) -> str:
    """Of each thing the first relation, which is the closest; things with the same one together."""
    if "other" in answers.args and "thing" not in answers.args:
        names = [say(row.thing) for row in answers]
        first = answers[0]
        return f"{_relation(first.relation)} {_the(say(first.other))} {_are(names)} {listed(names)}"
    places: dict[object, Any] = {}
    for row in answers:
        if (known := places.get(row.thing)) is None or (not _holds(known) and _holds(row)):
            places[row.thing] = row
    groups: dict[tuple[str, str], list[str]] = {}
    for thing, row in places.items():
        groups.setdefault((_relation(row.relation), say(row.other)), []).append(say(thing))
    parts = [f"{listed(names)} {_are(names)} {word} {_the(other)}" for (word, other), names in groups.items()]
    more = len(parts) - _LISTED
    return "; ".join([*parts[:_LISTED], *([f"{more} more places are in the table"] if more > 0 else [])])


def _holds(row: Any) -> bool:
    return str(row.relation) in {"on", "inside"}


def _relation(relation: object) -> str:
    text = str(relation).replace("_", " ")
    return _RELATIONS.get(text, text)


def _stored(answers: Answers[Any], say: Say) -> str:
    first = answers[0]
    place = "individual" if "individual" in first.__struct_fields__ else "place"
    names = [_the(say(getattr(row, place))) for row in answers]
    return f"{say(first.item)} is kept in {listed(names)}"


def _count(answers: Answers[Any], say: Say) -> str:
    first = answers[0]
    where = "" if first.place is None else f" on or in {_the(say(first.place))}"
    name = say(first.cls)
    if first.count == 1:
        return f"there is 1 {name}{where}"
    return f"there are {first.count} {name if name.endswith('s') else f'{name}s'}{where}"


def _states(answers: Answers[Any], say: Say) -> str:
    groups: dict[str, list[str]] = {}
    for row in answers:
        groups.setdefault(str(row.state).replace("_", " "), []).append(say(row.part))
    return "; ".join(f"{listed(names)} {_are(names)} {state}" for state, names in groups.items())


def _reasons(answers: Answers[Any], say: Say) -> str:
    """Of answers that may be a no, such as whether something can be opened: what is said of each."""
    column = subject_column(answers)
    parts = [f"{say(getattr(row, column))}: {row.why}" if column else str(row.why) for row in answers[:_LISTED]]
    more = len(answers) - _LISTED
    return "; ".join([*parts, *([f"{more} more answers are in the table"] if more > 0 else [])]).rstrip(".")


def _kind(answers: Answers[Any], say: Say) -> str:
    classes = [name for row in answers for name in map(say, row.classes)]
    return f"{say(answers[0].individual)} is of the class {listed(classes)}"


def _things(answers: Answers[Any], say: Say) -> str:
    column = subject_column(answers) or next(iter(answers.question.columns), None)
    if column is None:
        return f"{len(answers)} answers"
    names = [say(getattr(row, column)) for row in answers]
    return listed(names) if len(answers) == 1 else f"{len(answers)} answers: {listed(names)}"


_SENTENCES: Mapping[str, Callable[[Answers[Any], Say], str]] = {
    "where_is": _where,
    "storage_place": _stored,
    "storage_place_in_environment": _stored,
    "how_many": _count,
    "articulated_parts": _states,
    "what_is": _kind,
}
"""By the name of the question; the others are answered with the names of what they are about."""
_DECIDED_BY_ROWS = {"where_is", "articulated_parts", "storage_place", "storage_place_in_environment"}
"""Questions that are true of exactly what is answered: "is the fridge open?" is yes if there is a row."""
