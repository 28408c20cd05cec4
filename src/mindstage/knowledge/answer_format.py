"""Telling: answers as plain values and as short texts, whatever surface they go to."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from typing import TYPE_CHECKING, Any

import msgspec

from mindstage.knowledge.names import EntityType
from mindstage.knowledge.queries.individuals import JointSummary
from mindstage.knowledge.questions import AnswerRow, Answers
from mindstage.knowledge.rdf import local_name
from mindstage.scene import AxisMotion, Iri, IriRef, Literal, Pose, PropertyAssertion, Tag

if TYPE_CHECKING:
    from mindstage.knowledge.knowledge_base import KnowledgeBase

__all__ = ["answers_to_builtins", "cell_text", "subject_column"]


def answers_to_builtins(kb: KnowledgeBase, answers: Answers[Any], *, explain: bool = False) -> dict[str, Any]:
    """What `mindstage ask --json` promises, as dicts, lists, texts and numbers.

    Each answer has its fields, and besides `iri`, `id` and `class` of what was asked for (see `subject_column`). The
    class of a class is itself.
    """
    about = subject_column(answers)
    return {
        "question": answers.question.name,
        "args": dict(answers.args),
        "answers": [_answer(kb, answers, about, row, explain=explain) for row in answers],
        "missing": [{"class": lack.cls, "property": lack.property, "why": lack.reason} for lack in answers.missing],
    }


def subject_column(answers: Answers[Any]) -> str | None:
    """The column of what was asked for; maps, which most answers name besides, only where there is nothing else."""
    return answers.answer_column(EntityType.CLASS, EntityType.INDIVIDUAL, EntityType.PROPERTY) or answers.answer_column(
        EntityType.MAP
    )


def cell_text(value: object) -> str | int | float | None:  # noqa: PLR0911 (one a kind)
    """A field as people read it in a table: names short, numbers as numbers."""
    match value:
        case bool():
            return "yes" if value else "no"
        case None | int() | float():
            return value
        case Enum():
            return str(value.value)
        case str():
            return local_name(value) if "://" in value else value
        case tuple():
            return ", ".join(str(cell_text(each)) for each in value)
        case Pose(position, quaternion):
            return f"{_numbers(position)} turned {_numbers(quaternion)}"
        case JointSummary(parent=parent, child=child):
            return f"{local_name(parent)} to {local_name(child)}, {', '.join(_unlocked_axes(value)) or 'fixed'}"
        case Tag():
            return f"{value.key} {value.value}"
        case PropertyAssertion(property, IriRef(iri)):
            return f"{local_name(property)} {local_name(iri)}"
        case PropertyAssertion(property, Literal(text)):
            return f"{local_name(property)} {text}"
        case PropertyAssertion(property):
            return f"{local_name(property)} …"
        case _:
            return msgspec.json.encode(value).decode()


def _unlocked_axes(joint: JointSummary) -> Iterator[str]:
    """The axes that are not locked."""
    linear, angular = joint.linear, joint.angular
    for axis in ("x", "y", "z", "twist", "swing2", "swing1"):
        slides = axis in {"x", "y", "z"}
        motion = getattr(linear if slides else angular, axis)
        limit = f" {linear.limit:g} m" if slides else f" {getattr(angular, f'{axis}_limit', 0.0):g} rad"
        if motion is not AxisMotion.LOCKED:
            yield f"{axis} {motion.name.lower()}{limit if motion is AxisMotion.LIMITED else ''}"


def _numbers(numbers: tuple[float, ...]) -> str:
    return " ".join(f"{number:.6g}" for number in numbers)


def _answer(
    kb: KnowledgeBase, answers: Answers[Any], subject_column: str | None, row: AnswerRow, *, explain: bool
) -> dict[str, Any]:
    told: dict[str, Any] = {}
    if subject_column is not None:
        iri: Iri = getattr(row, subject_column)
        is_individual = answers.question.columns[subject_column] in {EntityType.INDIVIDUAL, EntityType.MAP}
        told = {"iri": iri, "id": local_name(iri), "class": kb.reasoner.class_of(iri) if is_individual else iri}
    told |= msgspec.to_builtins(row)
    if explain:
        told["why"] = list(kb.explain(answers.question, row))
    return told
