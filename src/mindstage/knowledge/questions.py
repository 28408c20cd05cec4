"""The declaration of questions, from which every interface (Python, CLI, Prolog, ROS, viewer) is made.

A question is a generator function with a docstring. The types of its arguments declare what can be given, and its row
type declares the columns of the answers. Every argument is optional. Further functions are registered on it:

    @question
    def siblings(kb: QuestionContext, cls: ClassName | None = None) -> Iterator[SiblingClasses]: ...

    @siblings.explain           # why a row is an answer, line by line
    def _explain(kb: QuestionContext, row: SiblingClasses) -> Iterator[str]: ...

    @siblings.missing           # which statements are missing if there is no answer
    def _missing(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]: ...

    @question(sentences=("what is like {cls}",))  # plain sentences that ask it, see `mindstage.knowledge.sentences`

A question about the current state has the additional keyword argument `present: StateAccess`. It is passed by
`Question.ask` and is not part of any interface. Without a simulation, the state is that of the maps.

An argument that is an individual may be given as a class: the answers are then those for each of its individuals.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from copy import copy
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from itertools import islice, product
from math import prod
from operator import attrgetter
from threading import RLock
from types import MappingProxyType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Generic,
    NamedTuple,
    Protocol,
    TypeVar,
    get_args,
    get_type_hints,
    overload,
)

import msgspec
from msgspec import Meta

from mindstage.access.policies import Access
from mindstage.access.resources import is_outside_request
from mindstage.errors import AmbiguousNameError, InvalidArgumentError, NameNotFoundError, QuestionNotFoundError
from mindstage.knowledge.claims import Claim, ClaimKind
from mindstage.knowledge.history import (
    MAP_SOURCE,
    EpisodeSource,
    EventFilter,
    History,
    PastEvent,
    QuestionTime,
    WorldState,
    histories_of,
)
from mindstage.knowledge.names import EntityType, NamedThing, NameIndex, NameQuality
from mindstage.knowledge.reasoner import Reasoner
from mindstage.ranges import Range, check_number, range_of
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import EVENT, HAS_POSE, THING, TYPE
from mindstage.registry import Group, extensions, load_all
from mindstage.scene import (
    Body,
    Iri,
    IriRef,
    Joint,
    Light,
    Literal,
    Pose,
    PropertyAssertion,
    Tag,
    World,
)
from mindstage.scene.display import counted, html_table

if TYPE_CHECKING:
    from mindstage.knowledge.shape_rules import ShapeRule
    from mindstage.maps.dialects.map_statistics import MapStatistics

__all__ = [
    "MAP_SOURCE",
    "AnswerRow",
    "Answers",
    "AskedArguments",
    "ClassName",
    "Conclusion",
    "IndividualName",
    "MapName",
    "MissingKnowledge",
    "PropertyName",
    "Question",
    "QuestionArgument",
    "QuestionContext",
    "StateAccess",
    "ValueName",
    "WorldState",
    "answers_to_builtins",
    "cell_text",
    "get_question",
    "list_questions",
    "question",
    "question_names",
    "subject_column",
]

T = TypeVar("T")
ClassName = Annotated[Iri, EntityType.CLASS]
IndividualName = Annotated[Iri, EntityType.INDIVIDUAL]
MapName = Annotated[Iri, EntityType.MAP]
PropertyName = Annotated[Iri, EntityType.PROPERTY]
ValueName = Annotated[str, EntityType.VALUE]
_MAX_NAMED_ROWS = 3
"""The number of rows that are named in the repr of answers."""
_MAX_CONCLUDED = 12
"""The number of subjects that the sentence about answers names."""
_MAX_COMBINATIONS = 20_000
"""The maximum number of combinations of individuals, if arguments are given as classes."""
_FEW_COMBINATIONS = 8
"""The number of individuals that are asked about one by one, even if a question is a relation."""
_MAX_MISSING = 20
"""The maximum number of missing statements for the individuals of a class."""
_declared: dict[tuple[str, str], Question[Any]] = {}
"""The questions of all imported modules by module and name; most are entry points."""


class QuestionContext(Protocol):
    """The part of `KnowledgeBase` that questions use."""

    lock: RLock
    """Held while a question is answered, except for one that imagines."""

    @property
    def reasoner(self) -> Reasoner:
        """The reasoner over all loaded statements."""

    @property
    def names(self) -> NameIndex:
        """The index of names."""

    @property
    def episodes(self) -> Sequence[EpisodeSource]:
        """The sources of episodes that were added."""

    def maps(self) -> tuple[Iri, ...]:
        """The maps that are loaded."""

    def world(self, map: str | None = None) -> World:
        """One map as a world."""

    def facts_of(self, individual: Iri, *, runtime_only: bool = False) -> tuple[PropertyAssertion, ...]:
        """The assertions about an individual."""

    def statements(
        self, *, property: Iri | None = None, runtime_only: bool = False
    ) -> tuple[tuple[Iri, PropertyAssertion], ...]:
        """All asserted statements with a property, or all that were asserted at run time, with their subjects."""

    def scene_entity(self, individual: Iri, map: Iri) -> Body | Joint | Light | None:
        """The body, joint or light of a map that an individual describes."""

    def map_statistics(self, map: str | None = None) -> MapStatistics:
        """The statistics of one map."""

    def explain(self, question: Question[Any] | str, row: Any) -> tuple[str, ...]:
        """The statements that led to an answer."""

    def shape_rule(self, cls: Iri) -> ShapeRule:
        """The shape and the typical size of objects of a class."""

    def cached(self, key: object, make: Callable[[], T]) -> T:
        """A value that depends on the statements only, which is made once and kept until they change."""


class StateAccess:
    """Gives one question access to the current state, which is fetched at most once and only if it is used."""

    def __init__(
        self,
        kb: QuestionContext,
        fetch_state: Callable[[], WorldState] | None = None,
        *,
        simulation: object | None = None,
        episodes: Sequence[EpisodeSource] = (),
        time: QuestionTime = QuestionTime(),  # noqa: B008 - it is frozen
        past: tuple[History, float] | None = None,
    ) -> None:
        """Fetches nothing yet.

        Args:
            kb: provides the maps that no engine simulates.
            fetch_state: returns the engine's current state; None without an engine.
            simulation: the running `Simulation`, which questions that imagine copy; None without one.
            episodes: the episodes that questions about the past may use.
            time: the time that the question is about.
            past: the episode and the time in it [s] that `fetch_state` gives the state of; None for the present.
        """
        self.simulation = simulation
        self.time = time
        self.past = past
        self.episodes = tuple(episodes)
        self.memo: dict[tuple[object, ...], Any] = {}
        """What a question has computed, for its explanation of missing answers; kept for one question."""
        self._kb = kb
        self._fetch_state = fetch_state
        self._map_states: dict[Iri, WorldState] = {}

    def fetch(self) -> None:
        """Fetches the state of the engine now, which would otherwise happen at its first use."""
        self._engine_state  # noqa: B018 - cached from now on

    def states(self, map: Iri | None = None) -> tuple[WorldState, ...]:
        """The state of the simulated scene and of each map that is not spawned in it; of one map only, if given."""
        running = self._engine_state
        spawned = {world.iri for world in running.spawned} if running else set()
        here = [running] if running and (map is None or map in spawned) else []
        elsewhere = (each for each in self._kb.maps() if each not in spawned and map in {None, each})
        return (*here, *(self._map_state(each) for each in elsewhere))

    def running(self) -> WorldState | None:
        """The state of the simulated scene; None without a simulation."""
        return self._engine_state

    def histories(self) -> list[History]:
        """The episodes that the question is about.

        Raises:
            InvalidArgumentError: there is none with the name that was given.
        """
        return histories_of(self.episodes, self.time.episode)

    def find_events(
        self, kinds: Collection[str] | None = None, things: Collection[Iri] | None = None
    ) -> list[PastEvent]:
        """The events of these episodes in the time that the question is about.

        Args:
            kinds: the local names of their classes; None for all.
            things: individuals of which one must be the thing of the event; None for all.
        """
        time = self.time
        wanted = EventFilter(
            kinds=None if kinds is None else frozenset(kinds),
            things=None if things is None else frozenset(things),
            episode=time.episode,
            begin_s=time.at_s if time.at_s is not None else time.since_s,
            end_s=time.at_s if time.at_s is not None else time.until_s,
        )
        return [event for source in self.episodes for event in source.find_events(wanted)]

    def find_individual(self, name: str) -> Iri | None:
        """The IRI of a simulated body, by IRI or body id: it may have been spawned without any map."""
        state = self._engine_state
        if state is not None and name in state.individuals:
            return state.individuals[name]
        return next((each for source in self.episodes if (each := source.find_individual(name)) is not None), None)

    @cached_property
    def _engine_state(self) -> WorldState | None:
        return self._fetch_state() if self._fetch_state else None

    def _map_state(self, map: Iri) -> WorldState:
        if map not in self._map_states:
            world = self._kb.world(map)
            state = self._kb.cached(("state", map), lambda: WorldState(world=world, spawned=(world,)))
            self._map_states[map] = state if state.world is world else WorldState(world=world, spawned=(world,))
        return self._map_states[map]


class AnswerRow(msgspec.Struct, frozen=True, kw_only=True, dict=True):
    """One answer. A field with the name of a question argument has the value that was given for it.

    `subject` and `individual` depend on the arguments, so they exist on the rows of `Answers` only.
    """

    default_column: ClassVar[str] = ""
    """The field that is the subject if several arguments were left out; the first of those if empty."""

    @property
    def subject(self) -> Iri:
        """The IRI that the question asked for, which `highlight` uses: for `handle_of` with a door, its handle.

        Raises:
            AttributeError: the row does not belong to `Answers`, or contains no names.
        """
        column = self._origin().subject_column
        if column is None:
            raise AttributeError(f"an answer to {self._origin().question.name} has no subject: it holds no names")
        return Iri(str(getattr(self, column)))

    @property
    def subject_kind(self) -> EntityType:
        """The entity type of `subject`: an individual, a class, a map or a property.

        Raises:
            AttributeError: as for `subject`.
        """
        kind = self._origin().subject_kind
        if kind is None:
            raise AttributeError(f"an answer to {self._origin().question.name} has no subject: it holds no names")
        return kind

    @property
    def individual(self) -> Iri:
        """The IRI of the individual that the answer is about: `subject`, or the only member of the class `subject`.

        Rows with a field of this name have the field's value instead.

        Raises:
            NameNotFoundError: no individual of that class is loaded.
            AmbiguousNameError: several individuals of that class are loaded; see `instances`.
            AttributeError: as for `subject`; or it is neither an individual nor a class.
        """
        found = self.instances
        if len(found) == 1:
            return found[0]
        name = local_name(self.subject)
        if found:
            raise AmbiguousNameError(name, entity_type="individual", candidates=found)
        raise NameNotFoundError(name, entity_type="individual of the class")

    @property
    def instances(self) -> tuple[Iri, ...]:
        """The IRIs of the individuals that the answer is about: `subject`, or all members of the class `subject`.

        An answer about a class keeps the knowledge base in memory for this; one about an individual does not.

        Raises:
            AttributeError: as for `individual`.
        """
        if self.subject_kind is EntityType.INDIVIDUAL:
            return (self.subject,)
        if self.subject_kind is not EntityType.CLASS:
            raise AttributeError(f"{local_name(self.subject)} is a {self.subject_kind.value}, not an individual")
        return self._origin().members(self.subject)

    def __repr__(self) -> str:
        fields = ((name, getattr(self, name)) for name in self.__struct_fields__)
        return f"{type(self).__name__}({', '.join(f'{name}={cell_text(value)}' for name, value in fields)})"

    def _origin(self) -> _AnswerOrigin:
        origin: _AnswerOrigin | None = self.__dict__.get("_shared_origin")
        if origin is None:
            raise AttributeError(f"this {type(self).__name__} was not returned by a question")
        return origin


R = TypeVar("R", bound=AnswerRow)


class _AnswerOrigin:
    """What the rows of answers refer to; not `Answers`, so that no cycle waits for the garbage collector."""

    __slots__ = ("_kb", "question", "subject_column", "subject_kind")

    def __init__(self, question: Question[Any], subject_column: str | None, kb: QuestionContext | None) -> None:
        self.question, self.subject_column = question, subject_column
        kind = question.columns[subject_column] if subject_column is not None else None
        self.subject_kind = kind if isinstance(kind, EntityType) else None
        # Only rows about classes need their knowledge base, and keep it.
        self._kb = kb if kind is EntityType.CLASS else None

    def members(self, cls: Iri) -> tuple[Iri, ...]:
        """The individuals of a class in all loaded maps."""
        if self._kb is None:
            raise AttributeError(f"answers to {self.question.name} were made without a knowledge base")
        with self._kb.lock:
            reasoner = self._kb.reasoner
            found = (each for map in sorted(reasoner.members_by_map) for each in reasoner.members(cls, map))
            return tuple(dict.fromkeys(found))


class MissingKnowledge(msgspec.Struct, frozen=True):
    """A statement whose absence explains why a question has no answer."""

    cls: Iri
    property: Iri
    reason: str
    is_filler: bool = False
    """Whether `cls` is missing as the filler of the property, rather than as its subject."""
    claims: tuple[Claim, ...] = ()
    """What `reason` states about the graph and the state, or relies on, each of which is so."""


class Conclusion(NamedTuple):
    """What the answers to a question amount to."""

    sentence: str
    """The answer as a sentence."""
    truth: bool | None
    """Yes or no, or whether there is an answer; None if it is unknown."""


class Answers(Sequence[R]):
    """All answers to a question, in its order; if there are none, the missing statements."""

    def __init__(
        self,
        question: Question[R],
        args: Mapping[str, object],
        rows: Sequence[R],
        missing: Sequence[MissingKnowledge],
        *,
        kb: QuestionContext | None = None,
        classes: Mapping[str, Sequence[Iri]] | None = None,
        notes: Iterable[str] = (),
        conclusion: Conclusion | None = None,
    ) -> None:
        self.question = question
        self.args: Mapping[str, object] = MappingProxyType(dict(args))
        """The given arguments, with names resolved to IRIs."""
        self.classes: Mapping[str, Sequence[Iri]] = MappingProxyType(dict(classes or {}))
        """The arguments that are individuals but were given as a class, with the individuals that were asked about."""
        self.notes = tuple(notes)
        """How a sentence or a name was understood, if it was not given exactly."""
        self.missing = tuple(missing)
        self._rows = tuple(rows)
        self._conclusion = conclusion
        names = (EntityType.INDIVIDUAL,), (EntityType.CLASS, EntityType.PROPERTY), (EntityType.MAP,)
        self.subject_column = next((column for kinds in names if (column := self.answer_column(*kinds))), None)
        """The column that was asked for: an individual if there is one, else a class or property, else a map."""
        origin = _AnswerOrigin(question, self.subject_column, kb)
        for row in self._rows:
            row.__dict__["_shared_origin"] = origin

    @property
    def is_concluded(self) -> bool:
        """Whether the answer as a sentence is more than what the rows name, such as a yes or no."""
        return self._conclusion is not None

    @property
    def conclusion(self) -> Conclusion:
        """The answer as a sentence: that of the question, or what its rows name."""
        if self._conclusion is not None:
            return self._conclusion
        if self._rows:
            return Conclusion(f"{counted(len(self._rows), 'answer')}{self._named_rows()}.", truth=True)
        reasons = "; ".join(lack.reason for lack in self.missing[:_MAX_NAMED_ROWS])
        return Conclusion(f"No answer: {reasons}." if reasons else "No answer.", truth=False)

    def _named_rows(self) -> str:
        """The first different subjects of the rows."""
        if self.subject_column is None:
            return ""
        names = list(dict.fromkeys(local_name(str(getattr(row, self.subject_column))) for row in self._rows))
        more = f" and {len(names) - _MAX_CONCLUDED} more" if len(names) > _MAX_CONCLUDED else ""
        return f": {', '.join(names[:_MAX_CONCLUDED])}{more}"

    def to_dicts(self) -> list[dict[str, Any]]:
        """The rows as dicts of plain values (strings, numbers, lists): `pandas.DataFrame(answers.to_dicts())`."""
        return [msgspec.to_builtins(row) for row in self._rows]

    def answer_column(self, *value_types: object) -> str | None:
        """The column of one of these types that was asked for: for the handles of a given door, the handle.

        Of several arguments that were left out it is the row's `default_column`, or else the first; if all were given,
        the last. A question without such arguments has the row's `default_column`.
        """
        columns, default = self.question.columns, self.question.row.default_column
        names = [argument.name for argument in self.question.arguments if columns.get(argument.name) in value_types]
        if not names and columns.get(default) in value_types:
            names = [default]
        if self._rows:  # a column that is empty in all rows, such as the place of a count in the whole map, is none
            names = [name for name in names if any(getattr(row, name) is not None for row in self._rows)]
        free = [name for name in names if name not in self.args]
        return default if default in (free or names) else next(iter(free or names[-1:]), None)

    @overload
    def __getitem__(self, at: int) -> R: ...
    @overload
    def __getitem__(self, at: slice) -> Sequence[R]: ...
    def __getitem__(self, at: int | slice) -> R | Sequence[R]:
        """One answer, or a slice of them."""
        return self._rows[at]

    def __len__(self) -> int:
        return len(self._rows)

    def __repr__(self) -> str:
        asked = ", ".join(f"{name}={local_name(str(value))}" for name, value in self.args.items())
        lack = f", {len(self.missing)} missing" if self.missing else ""
        column, names = self.subject_column, ""
        if column is not None and self._rows:
            first = [local_name(str(getattr(row, column))) for row in self._rows[:_MAX_NAMED_ROWS]]
            names = f" ({', '.join(first)}{', …' if self._rows[_MAX_NAMED_ROWS:] else ''})"
        return f"<{type(self).__name__} to {self.question.name}({asked}): {counted(len(self), 'row')}{names}{lack}>"

    def _repr_html_(self) -> str:
        """A table for notebooks."""
        columns = self.question.row.__struct_fields__
        rows = [[cell_text(getattr(row, column)) for column in columns] for row in self._rows]
        missing = [lack.reason for lack in self.missing]
        return html_table(repr(self), columns, rows, notes=missing)


@dataclass(frozen=True, slots=True)
class QuestionArgument:
    """An argument of a question."""

    name: str
    value_type: EntityType | type
    """The entity type of a name, or the type of a plain value."""
    default: object
    range: Range | None = None
    """The range of a number."""

    @property
    def choices(self) -> tuple[str, ...]:
        """The allowed values of an enumeration; empty for other types."""
        is_closed = isinstance(self.value_type, type) and issubclass(self.value_type, Enum)
        return tuple(str(each.value) for each in self.value_type) if is_closed else ()  # type: ignore[union-attr]

    @property
    def type_text(self) -> str:
        """The type in words, for help texts and messages."""
        if isinstance(self.value_type, EntityType):
            return self.value_type.value
        return " | ".join(self.choices) or ("number" if self.value_type in {int, float} else self.value_type.__name__)


class AskedArguments:
    """The arguments of a question that has no answer: `asked.thing` is the name given for `thing`, None if none was."""

    def __init__(self, values: Mapping[str, object], present: StateAccess) -> None:
        self._values = values
        self.present = present
        """Access to the current state."""

    def __getattr__(self, name: str) -> Iri | None:
        value = self._values.get(name)
        if not isinstance(value, str | None):
            raise TypeError(f"{name} is not a name; see plain")
        return None if value is None else Iri(value)

    def needed(self, name: str) -> Iri:
        """The name given for an argument that the question needs."""
        return Iri(str(self._values[name]))

    def plain(self, name: str, value_type: type[T]) -> T | None:
        """An argument that is not a name, such as a number; None if it was not given."""
        value = self._values.get(name)
        return value if isinstance(value, value_type) else None


_FindMissing = Callable[["QuestionContext", AskedArguments], "Iterator[MissingKnowledge]"]


class Question(Generic[R]):
    """A declared question."""

    def __init__(
        self,
        function: Callable[..., Iterator[R]],
        *,
        sentences: Sequence[str] = (),
        needs: str = "",
        is_relation: bool = False,
        imagines: bool = False,
        about_past: bool = False,
        access: Access | None = None,
    ) -> None:
        self.name = function.__name__
        self.access = access
        self.module = function.__module__
        """The module that declares it."""
        self.sentences = tuple(sentences)
        """Templates of plain sentences that ask this question; `mindstage.knowledge.sentences` describes them."""
        self.needs = needs
        """The arguments that must be given, and why: "thing or other: all pairs are not listed"; empty for none."""
        self.is_relation = is_relation
        """Whether the answers for an individual are the rows with it among all answers, which are not many more.

        If so, a class is asked about at once, instead of each of its individuals.
        """
        self.imagines = imagines
        """Whether it simulates copies of the world, for seconds; the lock is then not held while it is answered."""
        self.about_past = about_past
        """Whether it is about episodes, not about the present; it uses `StateAccess.histories` or `find_events`."""
        self.text = inspect.cleandoc(function.__doc__ or "").partition("\n\nExamples:\n")[0]
        self.examples = tuple(
            line.strip() for line in inspect.cleandoc(function.__doc__ or "").partition("Examples:\n")[2].splitlines()
        )
        """Arguments of `mindstage ask`, one example per line."""
        self._function = function
        self._explain: Callable[[QuestionContext, R], Iterator[str]] | None = None
        self._find_missing: _FindMissing | None = None

    @cached_property
    def _hints(self) -> dict[str, Any]:
        return get_type_hints(self._function, localns={"KnowledgeBase": object}, include_extras=True)

    @cached_property
    def row(self) -> type[R]:
        """The type of its answers."""
        (row,) = get_args(self._hints["return"])
        return row  # type: ignore[no-any-return]

    @cached_property
    def arguments(self) -> tuple[QuestionArgument, ...]:
        """Its arguments, in the order of the declaration."""
        parameters = list(inspect.signature(self._function).parameters.values())[1:]
        asked = (each for each in parameters if each.kind is not each.KEYWORD_ONLY)
        return tuple(
            QuestionArgument(
                each.name, _value_type(self._hints[each.name]), each.default, range_of(self._hints[each.name])
            )
            for each in asked
        )

    @cached_property
    def _arguments_by_name(self) -> Mapping[str, QuestionArgument]:
        return {argument.name: argument for argument in self.arguments}

    @cached_property
    def _fields(self) -> frozenset[str]:
        return frozenset(self.row.__struct_fields__)

    @cached_property
    def _needed(self) -> tuple[frozenset[str], ...]:
        """Sets of arguments, of each of which one must be given."""
        words = self.needs.partition(":")[0]
        return tuple(frozenset(each.split(" or ")) for each in re.split(",? and ", words)) if words else ()

    @cached_property
    def uses_current_state(self) -> bool:
        """Whether the answers depend on the current state of a simulation."""
        return "present" in inspect.signature(self._function).parameters and not self.about_past

    def over_time(self, row: type[R]) -> Question[R]:
        """The same question with another type of rows, which has further columns: those of an interval."""
        other = copy(self)
        for name in ("columns", "_fields"):
            other.__dict__.pop(name, None)
        other.__dict__["row"] = row
        return other

    @property
    def has_explanation(self) -> bool:
        """Whether `explain_answer` gives reasons."""
        return self._explain is not None

    @cached_property
    def columns(self) -> Mapping[str, object]:
        """The fields of its rows, with the entity type of names and the Python type of plain values."""
        hints = get_type_hints(self.row, include_extras=True)
        return {name: _value_type(hints[name]) for name in self.row.__struct_fields__}

    def bind(self, positional: Sequence[object], named: Mapping[str, object]) -> dict[str, object]:
        """The arguments of a call by name; positional ones are in the order of the declaration.

        Raises:
            InvalidArgumentError: there are too many, or one is given twice.
        """
        names = [argument.name for argument in self.arguments]
        takes = f"it takes {', '.join(names)}" if names else "it takes no arguments"
        if len(positional) > len(names):
            cause = f"{positional[len(names)]!r} is one argument too many"
            raise InvalidArgumentError(self.name, cause=cause, remedy=takes)
        bound = dict(zip(names, positional, strict=False))
        if twice := next((name for name in bound if name in named), None):
            raise InvalidArgumentError(self.name, cause=f"{twice} is given twice", remedy=takes)
        return bound | dict(named)

    def explain(self, function: Callable[[QuestionContext, R], Iterator[str]]) -> Callable[..., Iterator[str]]:
        """Registers the function that explains an answer."""
        self._explain = function
        return function

    def missing(self, function: _FindMissing) -> _FindMissing:
        """Registers the function that finds the missing statements."""
        self._find_missing = function
        return function

    def ask(
        self,
        kb: QuestionContext,
        args: Mapping[str, object],
        *,
        present: StateAccess | None = None,
        notes: Iterable[str] = (),
    ) -> Answers[R]:
        """All answers.

        Args:
            kb: the knowledge base.
            args: names: local, with a prefix, or whole IRIs; None leaves an argument open. An individual may be given
                by its class: the answers are then those for all individuals of the class.
            present: access to the current state; without it, the state of the maps is used.
            notes: how the question was understood, for `Answers.notes`.

        Raises:
            InvalidArgumentError: the question has no such argument, or the value is not valid for it.
            NameNotFoundError: a name is unknown.
            AmbiguousNameError: several entities have a name.
        """
        now = present or StateAccess(kb)
        if self.about_past and not any(source.names() for source in now.episodes):
            for name in args:
                if (argument := self._arguments_by_name.get(name)) is None or argument.range is not None:
                    self._parse_argument(kb, now, name, args[name])
            reason = "there is no episode; add one with add_episode, or --episode FILE"
            return Answers(self, {}, (), (MissingKnowledge(Iri(EVENT), Iri(TYPE), reason),), kb=kb, notes=notes)
        if self.uses_current_state:
            now.fetch()  # before taking the lock, since the engine may take a while
        with nullcontext() if self.imagines else kb.lock:  # others ask while something is imagined
            return self._answers(kb, args, now, notes)

    def explain_answer(self, kb: QuestionContext, row: R) -> tuple[str, ...]:
        """The statements and classes that led to an answer, one per line."""
        with kb.lock:
            return tuple(self._explain(kb, row)) if self._explain else ()

    def _answers(
        self, kb: QuestionContext, args: Mapping[str, object], state_access: StateAccess, notes: Iterable[str]
    ) -> Answers[R]:
        found: dict[str, object] = {}
        classes: dict[str, Sequence[Iri]] = {}
        told = list(notes)
        for name in args:
            with kb.lock:
                value = self._parse_argument(kb, state_access, name, args[name])
            if isinstance(value, NamedThing):
                if value.members is not None:
                    classes[name] = value.members
                told += [f"{name}: {value.note}"] if value.note else []
                value = value.iri
            if value is not None:
                found[name] = value
        rows: dict[R, None] = {}
        if self.is_relation and {*classes} <= self._fields and prod(map(len, classes.values())) > _FEW_COMBINATIONS:
            given = {name: value for name, value in found.items() if name not in classes}
            members = [(attrgetter(name), frozenset(each)) for name, each in classes.items()]
            rows = dict.fromkeys(
                row for row in self._rows(kb, given, state_access) if all(value(row) in each for value, each in members)
            )
        else:
            for bound in self._combinations(found, classes):
                rows |= dict.fromkeys(self._rows(kb, bound, state_access))
        missing = () if rows else tuple(self._missing(kb, found, classes, state_access))
        conclusion = state_access.memo.get(("conclusion",))
        return Answers(self, found, tuple(rows), missing, kb=kb, classes=classes, notes=told, conclusion=conclusion)

    def _combinations(
        self, found: Mapping[str, object], classes: Mapping[str, Sequence[Iri]]
    ) -> Iterator[Mapping[str, object]]:
        """The arguments for each combination of individuals of the classes that were given.

        Raises:
            InvalidArgumentError: there are too many.
        """
        count = prod(map(len, classes.values()))
        if count > _MAX_COMBINATIONS:
            sizes = " and ".join(f"{counted(len(each), 'individual')} for {name}" for name, each in classes.items())
            cause = f"{sizes} are {count:,} combinations, more than {_MAX_COMBINATIONS:,}"
            raise InvalidArgumentError(self.name, cause=cause, remedy="give an individual, or a class with fewer")
        for members in product(*classes.values()):
            if len({*members}) == len(members):
                yield {**found, **dict(zip(classes, members, strict=True))}

    def _rows(self, kb: QuestionContext, args: Mapping[str, object], state_access: StateAccess) -> Iterable[R]:
        if any(names.isdisjoint(args) for names in self._needed):
            return ()
        view = {"present": state_access} if self.uses_current_state or self.about_past else {}
        rows = self._function(kb, **args, **view)
        bound = [name for name in args if name in self._fields]
        if not bound:
            return rows
        values_of, given = attrgetter(*bound), [args[name] for name in bound]
        wanted = given[0] if len(bound) == 1 else tuple(given)
        return (row for row in rows if values_of(row) == wanted)

    def _missing(
        self,
        kb: QuestionContext,
        found: Mapping[str, object],
        classes: Mapping[str, Sequence[Iri]],
        state_access: StateAccess,
    ) -> Iterator[MissingKnowledge]:
        for name, members in classes.items():
            if not members:
                cls = Iri(str(found[name]))
                reason = f"{local_name(cls)} has no individual: none of it or of a subclass is in a loaded map"
                yield MissingKnowledge(cls, TYPE, reason, claims=(Claim(kind=ClaimKind.NO_INSTANCE, object=cls),))
        if any(names.isdisjoint(found) for names in self._needed):
            yield MissingKnowledge(Iri(THING), Iri(HAS_POSE), f"give {self.needs}")
            return
        if self._find_missing is None:
            return
        asked = (AskedArguments(args, state_access) for args in self._combinations(found, classes))
        lacks = (lack for each in asked for lack in self._find_missing(kb, each))
        yield from islice(dict.fromkeys(islice(lacks, _MAX_COMBINATIONS)), _MAX_MISSING if classes else None)

    def _parse_argument(self, kb: QuestionContext, state_access: StateAccess, name: str, value: object) -> object:
        argument = self._arguments_by_name.get(name)
        if argument is None:
            known = ", ".join(argument.name for argument in self.arguments) or "none"
            raise InvalidArgumentError(self.name, cause=f"it has no argument {name!r}", remedy=f"there is {known}")
        if value is None:
            return None
        if isinstance(argument.value_type, EntityType):
            if isinstance(value, str) or argument.value_type is EntityType.VALUE:
                return self._resolve_name(kb, state_access, str(value), argument.value_type)
            raise InvalidArgumentError(
                f"{self.name}, {name}", cause=f"{value!r} is no {argument.value_type.value}'s name"
            )
        try:
            converted: Any = msgspec.convert(value, argument.value_type, strict=False)
        except msgspec.ValidationError as error:
            choices = ", ".join(argument.choices)
            cause = f"{value!r} is no {name if choices else argument.type_text}"
            remedy = f"there is {choices}" if choices else ""
            raise InvalidArgumentError(f"{self.name}, {name}", cause=cause, remedy=remedy) from error
        if argument.range is not None:
            check_number(converted, argument.range, f"{self.name}, {name}")
        return converted

    def _resolve_name(
        self, kb: QuestionContext, state_access: StateAccess, name: str, entity_type: EntityType
    ) -> NamedThing:
        """Resolves a name; for a question about the current state also that of a body which only the engine has."""
        may_be_spawned = (self.uses_current_state or self.about_past) and entity_type is EntityType.INDIVIDUAL
        if may_be_spawned and "://" in name and state_access.find_individual(name) == name:
            return NamedThing(Iri(name))  # without a search for similar names, if no map has it
        try:
            found = kb.names.find_thing(name, entity_type)
        except NameNotFoundError:
            if may_be_spawned and (spawned := state_access.find_individual(name)) is not None:
                return NamedThing(spawned)
            raise
        is_vague = found.quality is not NameQuality.EXACT or found.members == ()
        if is_vague and may_be_spawned and (spawned := state_access.find_individual(name)) is not None:
            return NamedThing(spawned)
        if self.about_past and found.members is not None:
            below = {found.iri, *kb.reasoner.classes.below(found.iri)}
            past = (iri for source in state_access.episodes for iri in source.individuals_of(below))
            return replace(found, members=tuple(dict.fromkeys((*found.members, *past))))
        return found


@overload
def question(function: Callable[..., Iterator[R]]) -> Question[R]: ...
@overload
def question(
    *,
    sentences: Sequence[str] = (),
    needs: str = "",
    is_relation: bool = False,
    imagines: bool = False,
    about_past: bool = False,
    access: Access | None = None,
) -> Callable[[Callable[..., Iterator[R]]], Question[R]]: ...
def question(
    function: Callable[..., Iterator[R]] | None = None,
    *,
    sentences: Sequence[str] = (),
    needs: str = "",
    is_relation: bool = False,
    imagines: bool = False,
    about_past: bool = False,
    access: Access | None = None,
) -> Question[R] | Callable[[Callable[..., Iterator[R]]], Question[R]]:
    """Declares a question under the function's name.

    Args:
        function: the generator function, if this is used without arguments.
        sentences: templates of plain sentences that ask the question, such as "where is {thing}"; see
            `mindstage.knowledge.sentences` for their syntax.
        needs: see `Question.needs`; without these arguments there are no answers, and they are what is missing.
        is_relation: see `Question.is_relation`.
        imagines: see `Question.imagines`.
        about_past: see `Question.about_past`.
        access: `Access.READ` offers a question that is no entry point to clients of ports; those of entry points
            declare it there.

    Raises:
        ValueError: another module declares a question of this name.
    """

    def declare(function: Callable[..., Iterator[R]]) -> Question[R]:
        declared = Question(
            function,
            sentences=sentences,
            needs=needs,
            is_relation=is_relation,
            imagines=imagines,
            about_past=about_past,
            access=access,
        )
        module, name = declared.module, declared.name
        installed = extensions(Group.QUESTIONS).get(name)
        others = {each for each, its_name in _declared if its_name == name} if installed is None else {installed.module}
        if others := others - {module}:
            raise ValueError(f"two questions {name}: of {module} and of {', '.join(sorted(others))}")
        _declared[module, name] = declared
        return declared

    return declare if function is None else declare(function)


def _questions_of_program() -> dict[str, Question[Any]]:
    """The questions of imported modules that are no entry points; for the client of a port those that are offered."""
    installed = extensions(Group.QUESTIONS)
    references = {(each.module, each.attribute) for each in installed.values()}
    return {
        each.name: each
        for key, each in tuple(_declared.items())
        if key not in references
        and each.name not in installed
        and (each.access is Access.READ or not is_outside_request())
    }


def list_questions() -> tuple[Question[Any], ...]:
    """All questions: those of installed packages by name, then those of this program."""
    return (*load_all(Group.QUESTIONS, Question).values(), *_questions_of_program().values())


def question_names() -> tuple[str, ...]:
    """The names of all questions, without importing the modules that declare them."""
    return (*extensions(Group.QUESTIONS), *_questions_of_program())


def get_question(name: str) -> Question[Any]:
    """The question with a name, in which hyphens stand for underscores.

    Only the module that declares it is imported.

    Raises:
        QuestionNotFoundError: there is no such question.
        ExtensionError: the package that adds it cannot be imported.
    """
    known = name.replace("-", "_")
    if (installed := extensions(Group.QUESTIONS).get(known)) is not None:
        return installed.load(Question)
    try:
        return _questions_of_program()[known]
    except KeyError:
        raise QuestionNotFoundError(name, known=question_names()) from None


def _value_type(hint: Any) -> EntityType | type:
    """The entity type or Python type of a type hint: CLASS for `ClassName | None`."""
    alternatives = [each for each in get_args(hint) if each is not type(None)]
    if hasattr(hint, "__metadata__"):
        kind: EntityType | type = hint.__metadata__[0]
        return get_args(hint)[0] if isinstance(kind, Meta) else kind
    if len(alternatives) == 1 and type(None) in get_args(hint):
        return _value_type(alternatives[0])
    return hint  # type: ignore[no-any-return]


# -- answers as plain values ------------------------------------------------------------------------------------------


def answers_to_builtins(kb: QuestionContext, answers: Answers[Any], *, explain: bool = False) -> dict[str, Any]:
    """The answers as dicts, lists, strings and numbers: the JSON schema of `mindstage ask --json`.

    Each answer has its fields and the `iri`, `id` and `class` of what was asked for (see `subject_column`). The class
    of a class is itself.
    """
    column = subject_column(answers)
    return {
        "question": answers.question.name,
        "args": dict(answers.args),
        "answers": [_answer(kb, answers, column, row, explain=explain) for row in answers],
        "missing": [
            {
                "class": lack.cls,
                "property": lack.property,
                "why": lack.reason,
                "claims": msgspec.to_builtins(lack.claims),
            }
            for lack in answers.missing
        ],
        "notes": list(answers.notes),
        "sentence": answers.conclusion.sentence,
        "truth": answers.conclusion.truth,
    }


def subject_column(answers: Answers[Any]) -> str | None:
    """The column that was asked for; a map, which most answers have besides, only if there is nothing else."""
    return answers.answer_column(EntityType.CLASS, EntityType.INDIVIDUAL, EntityType.PROPERTY) or answers.answer_column(
        EntityType.MAP
    )


def cell_text(value: object) -> str | int | float | None:  # noqa: PLR0911 (one per type)
    """A field as shown in a table: names shortened, numbers as numbers."""
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
        case Tag():
            return f"{value.key} {value.value}"
        case PropertyAssertion(property, IriRef(iri)):
            return f"{local_name(property)} {local_name(iri)}"
        case PropertyAssertion(property, Literal(text)):
            return f"{local_name(property)} {text}"
        case PropertyAssertion(property):
            return f"{local_name(property)} …"
        case msgspec.Struct() if type(value).__str__ is not msgspec.Struct.__str__:
            return str(value)
        case _:
            return msgspec.json.encode(value).decode()


def _numbers(numbers: tuple[float, ...]) -> str:
    return " ".join(f"{number:.6g}" for number in numbers)


def _answer(
    kb: QuestionContext, answers: Answers[Any], subject_column: str | None, row: AnswerRow, *, explain: bool
) -> dict[str, Any]:
    record: dict[str, Any] = {}
    if subject_column is not None:
        iri: Iri | None = getattr(row, subject_column)
        is_individual = answers.question.columns[subject_column] in {EntityType.INDIVIDUAL, EntityType.MAP}
        if iri is not None:
            record = {"iri": iri, "id": local_name(iri), "class": kb.reasoner.class_of(iri) if is_individual else iri}
    record |= msgspec.to_builtins(row)
    if explain:
        record["why"] = list(kb.explain(answers.question, row))
    return record
