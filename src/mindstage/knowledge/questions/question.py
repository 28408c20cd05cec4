"""Question: the declaration of one, which is all that any surface needs to ask it.

A question is a generator with a docstring. Its arguments, by their types, say what may be asked about; its rows say
what is answered. Every argument may be left out. What it knows beyond that hangs on it:

    @question
    def siblings(kb: KnowledgeBase, cls: ClassName | None = None) -> Iterator[Sibling]: ...

    @siblings.because           # why a row is an answer, line by line
    def _why(kb: KnowledgeBase, row: Sibling) -> Iterator[str]: ...

    @siblings.lacking           # what nobody has told yet, where there is no answer
    def _lacking(kb: KnowledgeBase, cls: ClassName | None = None) -> Iterator[Missing]: ...
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Generic, TypeVar, get_args, get_type_hints, overload

import msgspec

from mindstage.errors import ArgumentRefused, QuestionUnknown
from mindstage.knowledge.reasoning import NameKind
from mindstage.world import Iri

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = [
    "Answers",
    "Argument",
    "ClassName",
    "IndividualName",
    "MapName",
    "Missing",
    "PropertyName",
    "Question",
    "Row",
    "question",
    "question_named",
    "questions",
]

ClassName = Annotated[Iri, NameKind.CLASS]
IndividualName = Annotated[Iri, NameKind.INDIVIDUAL]
MapName = Annotated[Iri, NameKind.MAP]
PropertyName = Annotated[Iri, NameKind.PROPERTY]


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One answer. A field that is called like an argument has its value where that was given."""


R = TypeVar("R", bound=Row)


class Missing(msgspec.Struct, frozen=True):
    """What nobody has told, for want of which there is no answer."""

    cls: Iri
    property: Iri
    why: str


class Answers(Sequence[R]):
    """All answers, in the question's order; and where there is none, what is missing."""

    def __init__(
        self, question: Question[R], args: Mapping[str, object], rows: Sequence[R], missing: Sequence[Missing]
    ):
        self.question = question
        self.args = dict(args)
        """What was asked about, with names written out."""
        self.missing = tuple(missing)
        self._rows = tuple(rows)

    @overload
    def __getitem__(self, at: int) -> R: ...
    @overload
    def __getitem__(self, at: slice) -> Sequence[R]: ...
    def __getitem__(self, at: int | slice) -> R | Sequence[R]:
        """One answer, or some."""
        return self._rows[at]

    def __len__(self) -> int:
        return len(self._rows)

    def __repr__(self) -> str:
        return f"Answers({self.question.name}, {list(self._rows)!r}, missing={list(self.missing)!r})"


@dataclass(frozen=True, slots=True)
class Argument:
    """What a question may be asked about."""

    name: str
    kind: NameKind | type
    """What kind of name it is, or the type of a plain value."""
    default: object


class Question(Generic[R]):
    """One declared question."""

    def __init__(self, function: Callable[..., Iterator[R]]) -> None:
        self.name = function.__name__
        self.text = inspect.cleandoc(function.__doc__ or "").partition("\n\nExamples:\n")[0]
        self.examples = tuple(
            line.strip() for line in inspect.cleandoc(function.__doc__ or "").partition("Examples:\n")[2].splitlines()
        )
        """What to type after `mindstage ask`."""
        self._function = function
        self._because: Callable[[KnowledgeBase, R], Iterator[str]] | None = None
        self._lacking: Callable[..., Iterator[Missing]] | None = None

    @cached_property
    def _hints(self) -> dict[str, Any]:
        return get_type_hints(self._function, localns={"KnowledgeBase": object}, include_extras=True)

    @cached_property
    def row(self) -> type[R]:
        """What its answers are."""
        (row,) = get_args(self._hints["return"])
        return row  # type: ignore[no-any-return]

    @cached_property
    def arguments(self) -> tuple[Argument, ...]:
        """In the order of the declaration."""
        parameters = list(inspect.signature(self._function).parameters.values())[1:]
        return tuple(Argument(each.name, _kind(self._hints[each.name]), each.default) for each in parameters)

    @cached_property
    def columns(self) -> Mapping[str, object]:
        """The fields of its rows: what kind of name each is, or the type of a plain value."""
        hints = get_type_hints(self.row, include_extras=True)
        return {name: _kind(hints[name]) for name in self.row.__struct_fields__}

    def because(self, function: Callable[[KnowledgeBase, R], Iterator[str]]) -> Callable[..., Iterator[str]]:
        """Declares how it explains an answer."""
        self._because = function
        return function

    def lacking(self, function: Callable[..., Iterator[Missing]]) -> Callable[..., Iterator[Missing]]:
        """Declares how it tells what is missing; the function takes the question's arguments."""
        self._lacking = function
        return function

    def ask(self, kb: KnowledgeBase, args: Mapping[str, object]) -> Answers[R]:
        """All answers.

        Args:
            kb: who is asked.
            args: names short, with prefix or whole; None leaves an argument free.

        Raises:
            ArgumentRefused: it has no such argument, or the argument no such value.
            NameUnknown: nothing has that name.
            NameAmbiguous: several things have it.
        """
        found = {name: value for name in args if (value := self._found(kb, name, args[name])) is not None}
        columns = self.row.__struct_fields__
        bound = {name: value for name, value in found.items() if name in columns}
        rows = [
            row
            for row in dict.fromkeys(self._function(kb, **found))
            if all(getattr(row, name) == value for name, value in bound.items())
        ]
        missing = () if rows or self._lacking is None else tuple(self._lacking(kb, **found))
        return Answers(self, found, rows, missing)

    def why(self, kb: KnowledgeBase, row: R) -> tuple[str, ...]:
        """The statements and classes that led to an answer, one a line."""
        return tuple(self._because(kb, row)) if self._because else ()

    def _found(self, kb: KnowledgeBase, name: str, value: object) -> object:
        argument = next((argument for argument in self.arguments if argument.name == name), None)
        if argument is None:
            known = ", ".join(argument.name for argument in self.arguments) or "none"
            raise ArgumentRefused(self.name, cause=f"it has no argument {name!r}", remedy=f"there is {known}")
        if value is None:
            return None
        if isinstance(argument.kind, NameKind):
            if isinstance(value, str):
                return kb.names.find(value, argument.kind)
            raise ArgumentRefused(f"{self.name}, {name}", cause=f"{value!r} is no {argument.kind.value}'s name")
        try:
            return msgspec.convert(value, argument.kind, strict=False)
        except msgspec.ValidationError as error:
            raise ArgumentRefused(f"{self.name}, {name}", cause=f"{value!r}: {error}") from error


_QUESTIONS: dict[str, Question[Any]] = {}


def question(function: Callable[..., Iterator[R]]) -> Question[R]:
    """Declares a question; its name must be new."""
    declared = Question(function)
    if declared.name in _QUESTIONS:
        raise ValueError(f"there are two questions {declared.name}")
    _QUESTIONS[declared.name] = declared
    return declared


def questions() -> tuple[Question[Any], ...]:
    """All questions, in the order of their declaration."""
    return tuple(_QUESTIONS.values())


def question_named(name: str) -> Question[Any]:
    """One question; its name may be written with hyphens.

    Raises:
        QuestionUnknown: there is none.
    """
    try:
        return _QUESTIONS[name.replace("-", "_")]
    except KeyError:
        raise QuestionUnknown(name, known=_QUESTIONS) from None


def _kind(hint: Any) -> NameKind | type:
    """What a type means for people: `ClassName | None` is a class."""
    alternatives = [each for each in get_args(hint) if each is not type(None)]
    if hasattr(hint, "__metadata__"):
        return hint.__metadata__[0]  # type: ignore[no-any-return]
    if len(alternatives) == 1 and type(None) in get_args(hint):
        return _kind(alternatives[0])
    return hint  # type: ignore[no-any-return]
