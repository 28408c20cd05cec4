"""Telling: answers as plain values and as short texts, whatever surface they go to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import msgspec

from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions.question import Answers, Row
from mindstage.knowledge.reasoning import NameKind
from mindstage.world import Fact, Iri, Literal, Pose, Reference, Tag

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = ["answers_to_builtins", "cell_text"]


def answers_to_builtins(kb: KnowledgeBase, answers: Answers[Any], *, why: bool = False) -> dict[str, Any]:
    """What `mindstage ask --json` promises, as dicts, lists, texts and numbers.

    Each answer has its fields, and besides `iri`, `id` and `class` of what was asked for: the first argument that was
    left out, or else the last one. The class of a class is itself.
    """
    about = _about(answers)
    return {
        "question": answers.question.name,
        "args": answers.args,
        "answers": [_answer(kb, answers, about, row, why=why) for row in answers],
        "missing": [{"class": lack.cls, "property": lack.property, "why": lack.why} for lack in answers.missing],
    }


def cell_text(value: object) -> str | int | float | None:  # noqa: PLR0911 (one a kind)
    """A field as people read it in a table: names short, numbers as numbers."""
    match value:
        case bool():
            return "yes" if value else "no"
        case None | int() | float():
            return value
        case str():
            return local_name(value) if "://" in value else value
        case tuple():
            return ", ".join(str(cell_text(each)) for each in value)
        case Pose(position, quaternion):
            return f"{_numbers(position)} turned {_numbers(quaternion)}"
        case Tag():
            return f"{value.key} {value.value}"
        case Fact(property, Reference(iri)):
            return f"{local_name(property)} {local_name(iri)}"
        case Fact(property, Literal(text)):
            return f"{local_name(property)} {text}"
        case Fact(property):
            return f"{local_name(property)} …"
        case _:
            return msgspec.json.encode(value).decode()


def _numbers(numbers: tuple[float, ...]) -> str:
    return " ".join(f"{number:.6g}" for number in numbers)


def _about(answers: Answers[Any]) -> str | None:
    columns = answers.question.columns
    names = [name for argument in answers.question.arguments if (name := argument.name) in columns]
    return next((name for name in names if name not in answers.args), names[-1] if names else None)


def _answer(kb: KnowledgeBase, answers: Answers[Any], about: str | None, row: Row, *, why: bool) -> dict[str, Any]:
    told: dict[str, Any] = {}
    if about is not None:
        iri: Iri = getattr(row, about)
        is_individual = answers.question.columns[about] in {NameKind.INDIVIDUAL, NameKind.MAP}
        told = {"iri": iri, "id": local_name(iri), "class": kb.index.class_of(iri) if is_individual else iri}
    told |= msgspec.to_builtins(row)
    if why:
        told["why"] = list(kb.why(answers.question, row))
    return told
