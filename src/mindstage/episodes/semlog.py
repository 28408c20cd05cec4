"""The events of an episode in SemLog's OWL, as the Unreal plugin USemLog writes them to `NAME_ED.owl`.

A file has an experiment, its events as sub-actions, the objects that take part, and time points named by their seconds:
`log:timepoint_12.5`. It has no poses. The words are those of USemLog since 2018, in KnowRob's namespace; the older ones
in `knowrob_u` and its namespaces of logs are read too.

Sources: github.com/robcog-iai/USemLog, `SLOwlExperimentStatics.cpp` (classes and properties), `SLOwlExperiment.h` (the
experiment) and `SL…Event.cpp` (which event has which properties).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote, unquote

import msgspec

from mindstage.episodes.recording import EpisodeEvent, EpisodeEventKind, Recording
from mindstage.episodes.transform_recording import listed
from mindstage.errors import EpisodeFileError, KnowledgeError, without_surrogates
from mindstage.maps.dialects.serialize import DocumentSection, SubjectBlock
from mindstage.maps.io.files import read_statements
from mindstage.maps.io.write import save_statements
from mindstage.rdf.graphs import Graph, local_name
from mindstage.rdf.vocabulary import (
    NAMED_INDIVIDUAL,
    OBJECT_ACTED_ON,
    ONTOLOGY,
    OWL_CLASS,
    START_TIME,
    THING,
    TYPE,
    knowrob,
    xsd,
)
from mindstage.scene import BodyId, FactValue, Iri, IriRef, Literal, World
from mindstage.scene.display import counted
from mindstage.scene.world_model import PropertyAssertion

__all__ = ["SemlogEvents", "read_semlog", "write_semlog"]

_LOG = "http://knowrob.org/kb/unreal_log.owl"
_NAMESPACES = ("http://knowrob.org/kb/knowrob.owl#", "http://knowrob.org/kb/knowrob_u.owl#")
_END_TIME, _PERFORMED_BY, _IN_CONTACT = knowrob("endTime"), knowrob("performedBy"), knowrob("inContact")
_SUPPORTED, _SUPPORTING = knowrob("isSupported"), knowrob("isSupporting")
_EXPERIMENT, _SUB_ACTION, _IN_EPISODE = knowrob("experiment"), knowrob("subAction"), knowrob("inEpisode")
_UNREAL_EXPERIMENT, _TIME_POINT = knowrob("UnrealExperiment"), knowrob("TimePoint")
_EXPERIMENT_CLASSES = frozenset({"UnrealExperiment", "AmevaExperiment", "KitchenEpisode"})
_MANIPULATION = "ContainerManipulation"
_MANIPULATION_TYPE = knowrob("type")


class _Word(NamedTuple):
    """How SemLog states a kind of event."""

    cls: str
    thing: Iri = OBJECT_ACTED_ON
    other: Iri | None = None
    """The property of the second participant; None if SemLog does not state it."""
    type: str = ""
    """The type of a manipulation of a container."""


_WORDS: Mapping[EpisodeEventKind, _Word] = {
    EpisodeEventKind.CONTACT: _Word("TouchingSituation", _IN_CONTACT, _IN_CONTACT),
    EpisodeEventKind.SUPPORT: _Word("SupportedBySituation", _SUPPORTED, _SUPPORTING),
    EpisodeEventKind.GRASP: _Word("GraspingSomething"),
    EpisodeEventKind.PICK_UP: _Word("PickUpSituation"),
    EpisodeEventKind.PUT_DOWN: _Word("PutDownSituation"),
    EpisodeEventKind.SLIDE: _Word("SlidingSituation"),
    EpisodeEventKind.TRANSPORT: _Word("TransportingSituation"),
    EpisodeEventKind.OPEN: _Word(_MANIPULATION, type="Opening"),
    EpisodeEventKind.CLOSE: _Word(_MANIPULATION, type="Closing"),
}
"""SemLog has no words for being contained, falling, tipping over and colliding."""


class SemlogEvents(msgspec.Struct, frozen=True, kw_only=True):
    """The events of one file."""

    name: str
    begin_s: float
    """Time of the begin [s]."""
    end_s: float
    """Time of the end [s]."""
    events: tuple[EpisodeEvent, ...]
    """In the order of their begin."""
    findings: tuple[str, ...]
    """What was irregular or has no counterpart, one sentence each."""


# -- writing -----------------------------------------------------------------------------------------------------------


def write_semlog(recording: Recording, path: str | PathLike[str]) -> tuple[str, ...]:
    """Writes the events of an episode in SemLog's OWL.

    Args:
        recording: the episode.
        path: a file `.owl`, or `.ttl` for Turtle.

    Returns:
        What SemLog cannot express and is left out, one sentence each.

    Raises:
        MapWriteError: the suffix is unknown, or the file cannot be written.
    """
    known = [event for event in recording.events() if event.kind in _WORDS]
    document = _Document(recording)
    for event in known:
        document.add(event)
    save_statements(path, Iri(_LOG), document.sections(recording))
    return tuple(_losses(recording.events(), known))


def _losses(events: Sequence[EpisodeEvent], known: Sequence[EpisodeEvent]) -> Iterable[str]:
    for kind in sorted({event.kind for event in events} - _WORDS.keys()):
        count = sum(event.kind is kind for event in events)
        yield f"SemLog has no word for {kind.value}; {counted(count, 'event')} of that kind left out"
    for count, text in (
        (sum(event.end_s is None for event in known), "had not ended; the end of the episode is their end"),
        (
            sum(event.other is not None and _WORDS[event.kind].other is None for event in known),
            "have a second participant, which SemLog does not state",
        ),
        (sum(event.joint is not None for event in known), "are about a joint, which SemLog does not state"),
        (
            sum(event.amount is not None or bool(event.evidence) for event in known),
            "have an amount or evidence, which SemLog does not state",
        ),
        (
            sum(event.agent is not None and event.kind in _RELATIONS for event in known),
            "are relations with an agent, which SemLog does not state",
        ),
    ):
        if count:
            yield f"{counted(count, 'event')} {text}"


_RELATIONS = frozenset({EpisodeEventKind.CONTACT, EpisodeEventKind.SUPPORT})


class _Document:
    """The statements of a file."""

    def __init__(self, recording: Recording) -> None:
        structure = recording.frame_at(recording.end_s).structure
        self._classes = {str(body.id): body.cls for world in recording.spawned for body in world.bodies}
        self._classes |= {str(body.id): body.cls for body in structure.bodies}
        self._end_s = recording.end_s
        self._experiment = _individual(recording.name)
        self._events: dict[Iri, list[PropertyAssertion]] = {}
        self._objects: dict[Iri, Iri] = {}
        self._times: dict[Iri, None] = {}

    def add(self, event: EpisodeEvent) -> None:
        """Adds an event of a kind that SemLog has."""
        word = _WORDS[event.kind]
        facts = self._events.setdefault(_individual(event.id), [])

        def state(property: Iri, value: Iri) -> None:
            facts.append(PropertyAssertion(property, IriRef(value)))

        state(TYPE, NAMED_INDIVIDUAL)
        state(TYPE, knowrob(word.cls))
        state(START_TIME, self._time(event.begin_s))
        state(_END_TIME, self._time(self._end_s if event.end_s is None else event.end_s))
        if event.agent is not None and event.kind not in _RELATIONS:
            state(_PERFORMED_BY, self._object(event.agent))
        state(word.thing, self._object(event.thing))
        if word.other is not None and event.other is not None:
            state(word.other, self._object(event.other))
        if word.type:
            state(_MANIPULATION_TYPE, knowrob(word.type))
        state(_IN_EPISODE, self._experiment)

    def sections(self, recording: Recording) -> tuple[DocumentSection, ...]:
        """The sections, in the order in which USemLog writes them."""
        experiment: list[tuple[Iri, FactValue]] = [
            (TYPE, IriRef(NAMED_INDIVIDUAL)),
            (TYPE, IriRef(_UNREAL_EXPERIMENT)),
            (_EXPERIMENT, Literal(recording.name, xsd("string"))),
            (START_TIME, IriRef(self._time(recording.begin_s))),
            (_END_TIME, IriRef(self._time(recording.end_s))),
            *((_SUB_ACTION, IriRef(event)) for event in self._events),
        ]
        classes = dict.fromkeys([_UNREAL_EXPERIMENT, _TIME_POINT, *(knowrob(word.cls) for word in _WORDS.values())])
        return (
            DocumentSection("Ontologies", [_block(Iri(_LOG), [(TYPE, IriRef(ONTOLOGY))])]),
            DocumentSection("Class Definitions", [_block(cls, [(TYPE, IriRef(OWL_CLASS))]) for cls in classes]),
            DocumentSection("Event Individuals", [SubjectBlock(iri, facts) for iri, facts in self._events.items()]),
            DocumentSection("Timepoint Individuals", [_typed(iri, _TIME_POINT) for iri in self._times]),
            DocumentSection("Object Individuals", [_typed(iri, cls) for iri, cls in self._objects.items()]),
            DocumentSection("Experiment Individual", [_block(self._experiment, experiment)]),
        )

    def _time(self, time_s: float) -> Iri:
        iri = _individual(f"timepoint_{time_s!r}")
        self._times[iri] = None
        return iri

    def _object(self, name: str) -> Iri:
        iri = _individual(name)
        self._objects[iri] = self._classes.get(name, THING)
        return iri


def _individual(name: str) -> Iri:
    return Iri(f"{_LOG}#{quote(name, safe='')}")


def _typed(iri: Iri, cls: Iri) -> SubjectBlock:
    return _block(iri, [(TYPE, IriRef(NAMED_INDIVIDUAL)), (TYPE, IriRef(cls))])


def _block(subject: Iri, facts: Iterable[tuple[Iri, FactValue]]) -> SubjectBlock:
    return SubjectBlock(subject, [PropertyAssertion(property, value) for property, value in facts])


# -- reading -----------------------------------------------------------------------------------------------------------


def read_semlog(path: str | PathLike[str], world: World | None = None) -> SemlogEvents:
    """Reads the events of a file that USemLog or `write_semlog` wrote.

    Args:
        path: the file, RDF/XML or Turtle.
        world: the map; objects that it does not have are findings.

    Raises:
        EpisodeFileError: the file cannot be read, or has no event and no experiment.
    """
    try:
        graph = read_statements(Path(path))
    except KnowledgeError as error:
        raise EpisodeFileError(str(path), cause=f"it cannot be read: {error}") from error
    return _Reader(graph, world, str(path)).read()


class _Reader:
    def __init__(self, graph: Graph, world: World | None, path: str) -> None:
        self._graph, self._path = graph, path
        self._findings: list[str] = []
        self._known = None if world is None else {body.id for body in world.bodies}
        self._missing: dict[str, None] = {}
        self._kinds = {word.cls: kind for kind, word in _WORDS.items() if not word.type}
        self._types = {word.type: kind for kind, word in _WORDS.items() if word.type}

    def read(self) -> SemlogEvents:
        """The events and the experiment."""
        experiments = [subject for subject in self._graph if self._classes(subject) & _EXPERIMENT_CLASSES]
        events = [event for subject in self._graph if (event := self._event(subject)) is not None]
        if not experiments and not events and not self._findings:
            raise EpisodeFileError(
                self._path, cause="it has no experiment and no event of SemLog", remedy="give a file NAME_ED.owl"
            )
        times = [time for event in events for time in (event.begin_s, event.end_s) if time is not None]
        name = without_surrogates(Path(self._path).stem)
        begin_s, end_s = min(times, default=0.0), max(times, default=0.0)
        for experiment in experiments[:1]:
            texts = [value.text for value in self._values(experiment, _EXPERIMENT) if isinstance(value, Literal)]
            name = next(iter(texts), unquote(local_name(experiment)))
            begin_s = self._time(experiment, START_TIME, begin_s)
            end_s = self._time(experiment, _END_TIME, end_s)
        if len(experiments) > 1:
            self._findings.append(f"there are {len(experiments)} experiments; times are those of {name}")
        if self._missing:
            self._findings.append(f"{listed(list(self._missing))}: no body of the map")
        return SemlogEvents(
            name=name,
            begin_s=begin_s,
            end_s=end_s,
            events=tuple(sorted(events, key=lambda each: (each.begin_s, each.id))),
            findings=tuple(self._findings),
        )

    def _event(self, subject: Iri) -> EpisodeEvent | None:
        """The event that a subject is, if it is one of a known kind with a begin and a participant."""
        classes = self._classes(subject)
        times = self._names(subject, START_TIME)
        if not times or classes & _EXPERIMENT_CLASSES:
            return None
        name = unquote(local_name(subject))
        kind = next((self._kinds[cls] for cls in sorted(classes) if cls in self._kinds), None)
        if _MANIPULATION in classes:
            type = next(iter(self._names(subject, _MANIPULATION_TYPE)), "")
            kind = self._types.get(type)
        if kind is None:
            self._findings.append(f"{name} ({', '.join(sorted(classes)) or 'no class'}) is no kind of event here")
            return None
        word = _WORDS[kind]
        things = self._names(subject, word.thing)
        others = (
            things[1:] if word.other == word.thing else [] if word.other is None else self._names(subject, word.other)
        )
        agents = self._names(subject, _PERFORMED_BY)
        begin_s = _seconds(times[0])
        if not things or begin_s is None:
            self._findings.append(f"{name} has no {'object' if begin_s is not None else 'valid begin'}; it is left out")
            return None
        ends = [time for text in self._names(subject, _END_TIME) if (time := _seconds(text)) is not None]
        if self._known is not None:
            self._missing |= dict.fromkeys(each for each in (*things, *others) if each not in self._known)
        return EpisodeEvent(
            id=name,
            kind=kind,
            begin_s=begin_s,
            end_s=next(iter(ends), None),
            thing=BodyId(things[0]),
            other=BodyId(others[0]) if others else None,
            agent=next(iter(agents), None),
        )

    def _time(self, subject: Iri, property: Iri, otherwise: float) -> float:
        times = [time for text in self._names(subject, property) if (time := _seconds(text)) is not None]
        return next(iter(times), otherwise)

    def _classes(self, subject: Iri) -> set[str]:
        """The local names of its classes in KnowRob's namespaces."""
        values = self._values(subject, TYPE)
        return {
            local_name(value.iri) for value in values if isinstance(value, IriRef) and value.iri.startswith(_NAMESPACES)
        }

    def _names(self, subject: Iri, property: Iri) -> list[str]:
        """The local names of the values of a property, in either of KnowRob's namespaces, in the order of the file."""
        return [
            unquote(local_name(value.iri)) if isinstance(value, IriRef) else value.text
            for value in self._values(subject, property)
            if isinstance(value, IriRef | Literal)
        ]

    def _values(self, subject: Iri, property: Iri) -> list[FactValue]:
        same = {namespace + local_name(property) for namespace in _NAMESPACES} | {property}
        return [fact.value for fact in self._graph.get(subject, ()) if fact.property in same]


def _seconds(time_point: str) -> float | None:
    try:
        return float(time_point.removeprefix("timepoint_"))
    except ValueError:
        return None
