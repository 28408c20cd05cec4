"""NEEMs, the episodic memories of KnowRob 2: a folder with a narrative in OWL and an experience of poses.

The narrative follows the NEEM handbook and KnowRob's NEEM interface: a `soma:Episode` is the setting for events with a
`dul:TimeInterval` in Unix time. Actions execute tasks; states and processes are classified by state and process types.
Participants have roles of these concepts. Each event also has its class in Mindstage's vocabulary, since SOMA has no
word for each kind. The experience is a MongoDB collection `tf` as JSON documents, one a line. The map is written beside
it, as the environment that KnowRob loads separately.

Sources: github.com/ease-crc/soma (owl/2.0.0: SOMA.owl, SOMA-STATE.owl, SOMA-PROC.owl; docs/NEEM-handbook, "pose data"
and "NEEM-narrative"), and neem-interface.pl (`mem_episode_start`, `add_subaction_with_task`, `task_role`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from os import PathLike
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike

from mindstage.episodes.mongo_collections import find_collection, read_collection
from mindstage.episodes.recording import EpisodeEvent, EpisodeEventKind, Recording
from mindstage.episodes.transform_recording import TransformLog, TransformRecording, listed
from mindstage.errors import EpisodeFileError, KnowledgeError, MapWriteError, without_surrogates
from mindstage.files import atomic_folder, atomic_write
from mindstage.knowledge.event_graph import CONCEPT_ROLES, EVENT_PATTERNS
from mindstage.knowledge.knowledge_base import KnowledgeBase
from mindstage.maps.dialects.serialize import DocumentSection, SubjectBlock
from mindstage.maps.io.files import read_statements
from mindstage.maps.io.write import save_map, save_statements
from mindstage.rdf.graphs import Graph, local_name
from mindstage.rdf.vocabulary import (
    IMPORTS,
    LABEL,
    NAMED_INDIVIDUAL,
    ONTOLOGY,
    RDFS,
    SOMA,
    SUBCLASS_OF,
    TYPE,
    dul,
    ms,
    soma,
    xsd,
)
from mindstage.scene import NO_GEOMETRY, Body, BodyId, FactValue, GeometryMap, Iri, IriRef, Literal, World
from mindstage.scene.display import counted
from mindstage.scene.transforms import Array
from mindstage.scene.world_model import PropertyAssertion

__all__ = ["Neem", "read_neem", "write_neem"]

_NS = 1e-9
_ROOT, _CLOCK = "map", "world"
_COMMENT = Iri(RDFS + "comment")
_ACTION = dul("Action")
_WITHOUT_OWN_TERM = {
    EpisodeEventKind.PERFORM,
    EpisodeEventKind.FALL,
    EpisodeEventKind.TIP_OVER,
    EpisodeEventKind.SLIDE,
}
"""Kinds whose terms in SOMA are wider: a task of any kind, as that of a whole NEEM is, and motions of any kind."""
_KIND_OF_CONCEPT = {
    pattern.concept: EpisodeEventKind(kind) for kind, pattern in EVENT_PATTERNS.items() if kind not in _WITHOUT_OWN_TERM
} | {
    soma("ContainmentState"): EpisodeEventKind.CONTAINMENT,
    soma("Holding"): EpisodeEventKind.GRASP,
    soma("Lifting"): EpisodeEventKind.PICK_UP,
    soma("Placing"): EpisodeEventKind.PUT_DOWN,
    soma("Fetching"): EpisodeEventKind.TRANSPORT,
    soma("Delivering"): EpisodeEventKind.TRANSPORT,
}
_KIND_OF_CLASS = {ms(kind.value): kind for kind in EpisodeEventKind}
_THING, _OTHER, _JOINT, _AGENT = "thing", "other", "joint", "agent"
"""Labels of roles, by which the participants of our own NEEMs are told apart."""


class Neem(TransformRecording):
    """A NEEM as a `Recording`."""


# -- writing -----------------------------------------------------------------------------------------------------------


def write_neem(recording: Recording, path: str | PathLike[str]) -> tuple[str, ...]:
    """Writes an episode as a folder: `ontology.ttl`, `tf.json`, `map.owl`.

    Args:
        recording: the episode; its frames are read twice.
        path: the folder, such as `run.neem`; its files of these names are replaced.

    Returns:
        What a NEEM cannot express and is left out, one sentence each.

    Raises:
        EpisodeFileError: the folder cannot be written.
        MapWriteError: the map cannot be written as OWL.
    """
    folder = Path(path)
    world, losses = _environment(recording)
    first_ns = _unix_ns(recording, recording.begin_s)
    try:
        with atomic_folder(folder) as part:
            save_map(world, part / "map.owl")
            documents = b"".join(msgspec.json.encode(each) + b"\n" for each in _documents(recording, world))
            atomic_write(part / "tf.json", documents)
            narrative = _Narrative(recording, world, first_ns)
            save_statements(part / "ontology.ttl", narrative.ontology, narrative.sections())
    except OSError as error:
        raise EpisodeFileError(str(folder), cause=error.strerror or str(error)) from error
    except MapWriteError as error:
        raise MapWriteError(str(folder / Path(error.subject).name), cause=error.cause, remedy=error.remedy) from error
    return losses


def _environment(recording: Recording) -> tuple[World, tuple[str, ...]]:
    """The world of the first frame with all bodies that come later, and what of its changes is lost."""
    bodies: dict[BodyId, Body] = {}
    first: World | None = None
    ids: set[BodyId] = set()
    appeared: set[BodyId] = set()
    removed: set[BodyId] = set()
    last, attachments_changed, with_contacts, with_joints = None, False, False, False
    for frame in recording.frames():
        with_contacts |= frame.contacts is not None
        with_joints |= bool(frame.joint_positions)
        if frame.structure is not last:
            attachments_changed |= last is not None and last.attachments != frame.structure.attachments
            last = frame.structure
            first = first or last
            for body in last.bodies:
                bodies.setdefault(body.id, body)
        if ids != set(frame.ids):
            if ids:
                appeared |= set(frame.ids) - ids
                removed |= ids - set(frame.ids)
            ids = set(frame.ids)
    assert first is not None, "a recording has a frame"
    losses = [
        text
        for is_lost, text in (
            (appeared, f"{listed(sorted(appeared))} came later; a NEEM has them from the begin"),
            (removed, f"{listed(sorted(removed))} were deleted; a NEEM keeps them where they were last"),
            (attachments_changed, "attachments changed; the map has those of the begin"),
            (with_contacts, "contacts with their forces are no part of a NEEM"),
            (with_joints, "positions of joints are no part of a NEEM; the poses of their bodies are"),
            (recording.edits(), f"{counted(len(recording.edits()), 'edit')} and requests are no part of a NEEM"),
        )
        if is_lost
    ]
    return replace(first, bodies=tuple(bodies.values())), tuple(losses)


def _unix_ns(recording: Recording, time_s: float) -> int:
    """A time of an episode in nanoseconds since 1970; episodes without a date begin in 1970."""
    # A product with 1e9 would be off by 256 ns.
    fraction, seconds = math.modf(recording.start_unix_s or 0.0)
    return int(seconds) * 1_000_000_000 + round(fraction * 1e9) + round(time_s * 1e9)


def _documents(recording: Recording, world: World) -> Iterator[dict[str, Any]]:
    """The documents of the collection `tf`: each pose that changes, with the one before it."""
    names = {body.id: _frame_name(body) for body in world.bodies}
    sequence = 0
    written: dict[BodyId, Array] = {}
    rested: set[BodyId] = set()
    before_ns = 0

    def document(child: str, row: ArrayLike, at_ns: int) -> dict[str, Any]:
        nonlocal sequence
        x, y, z, w, i, j, k = np.asarray(row, dtype=np.float64).tolist()
        sequence += 1
        seconds, rest_ns = divmod(at_ns, 1_000_000_000)
        moment = datetime.fromtimestamp(seconds, UTC) + timedelta(milliseconds=rest_ns // 1_000_000)
        date = moment.isoformat(timespec="milliseconds")
        return {
            "header": {
                "seq": sequence - 1,
                "stamp": {"$date": date.replace("+00:00", "Z")},
                "stamp_ns": at_ns,  # dates of MongoDB have milliseconds
                "frame_id": _ROOT,
            },
            "child_frame_id": child,
            "transform": {
                "translation": {"x": x, "y": y, "z": z},
                "rotation": {"x": i, "y": j, "z": k, "w": w},
            },
        }

    for frame in recording.frames():
        at_ns, moved = _unix_ns(recording, frame.time_s), False
        for id, row in zip(frame.ids, frame.poses, strict=True):
            last = written.get(id)
            if last is not None and np.array_equal(last, row):
                rested.add(id)
                continue
            if last is not None and id in rested:
                # Readers interpolate; the end of a rest keeps the body from leaving early.
                yield document(names[id], last, before_ns)
            rested.discard(id)
            written[id], moved = row.copy(), True
            yield document(names[id], row, at_ns)
        if not moved:
            yield document(_CLOCK, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), at_ns)
        before_ns = at_ns


def _frame_name(body: Body) -> str:
    return body.iri if body.id in {_ROOT, _CLOCK} or body.id.startswith("/") else body.id


class _Narrative:
    """The statements of a narrative."""

    def __init__(self, recording: Recording, world: World, first_ns: int) -> None:
        self._recording = recording
        self._iris: dict[str, Iri] = {str(body.id): body.iri for body in world.bodies} | {
            joint.id: joint.iri for joint in world.joints
        }
        self._zero_s = first_ns * _NS - recording.begin_s
        namespace = f"http://mindstage.org/episodes/{quote(recording.name, safe='')}.owl"
        self.ontology = Iri(namespace)
        self._namespace = namespace + "#"
        self._blocks: dict[Iri, dict[PropertyAssertion, None]] = {}

    def sections(self) -> tuple[DocumentSection, ...]:
        """The ontology, then all individuals."""
        recording = self._recording
        episode = self._individual("Episode", soma("Episode"))
        self._add(episode, LABEL, Literal(recording.name))
        action = self._individual("Episode_action", _ACTION)
        self._link(episode, dul("isSettingFor"), action)
        self._interval(action, recording.begin_s, recording.end_s)
        self._link(action, dul("executesTask"), self._individual("Episode_task", soma("PhysicalTask")))
        for event in recording.events():
            iri = self._event(event, action)
            self._link(episode, dul("isSettingFor"), iri)
            self._link(action, dul("hasConstituent"), iri)
        blocks = [SubjectBlock(subject, list(facts)) for subject, facts in self._blocks.items()]
        imported = PropertyAssertion(IMPORTS, IriRef(Iri(SOMA.rstrip("#"))))
        header = SubjectBlock(self.ontology, [PropertyAssertion(TYPE, IriRef(ONTOLOGY)), imported])
        return DocumentSection("Ontologies", [header]), DocumentSection("Individuals", blocks)

    def _event(self, event: EpisodeEvent, episode_action: Iri) -> Iri:
        pattern = EVENT_PATTERNS[event.kind]
        iri = self._individual(event.id, pattern.event)
        self._link(iri, TYPE, ms(event.kind.value))
        self._interval(iri, event.begin_s, event.end_s)
        concept = self._individual(f"{event.id}_concept", pattern.concept)
        if pattern.event == _ACTION:
            self._link(iri, dul("executesTask"), concept)
        else:
            self._link(concept, dul("classifies"), iri)
        self._participant(event, concept, iri, _THING, event.thing, soma("Patient"))
        if event.other is not None:
            self._participant(event, concept, iri, _OTHER, event.other, pattern.other)
        if event.joint is not None:
            self._participant(event, concept, iri, _JOINT, event.joint, soma("LinkedObject"))
        if event.agent is not None:
            agent = self._participant(event, concept, iri, _AGENT, event.agent, soma("AgentRole"))
            if pattern.event == _ACTION:
                self._link(iri, soma("isPerformedBy"), agent)
                self._link(episode_action, soma("isPerformedBy"), agent)
        if event.amount is not None:
            region = self._individual(f"{event.id}_amount", dul("Amount"))
            self._link(iri, dul("hasRegion"), region)
            self._add(region, dul("hasRegionDataValue"), Literal(repr(float(event.amount)), xsd("double")))
        if event.evidence:
            self._add(iri, _COMMENT, Literal("\n".join(event.evidence)))
        return iri

    def _participant(self, event: EpisodeEvent, concept: Iri, iri: Iri, label: str, name: str, role_class: Iri) -> Iri:
        participant = self._iris.get(name)
        if participant is None:
            participant = self._individual(f"Agent_{name}", dul("Agent" if label == _AGENT else "Object"))
            self._add(participant, LABEL, Literal(name))
        role = self._individual(f"{event.id}_{label}", role_class)
        self._add(role, LABEL, Literal(label))
        self._link(iri, dul("hasParticipant"), participant)
        self._link(participant, dul("hasRole"), role)
        self._link(concept, CONCEPT_ROLES[EVENT_PATTERNS[event.kind].event], role)
        return participant

    def _interval(self, event: Iri, begin_s: float, end_s: float | None) -> None:
        interval = self._individual(f"{unquote(local_name(event))}_interval", dul("TimeInterval"))
        self._link(event, dul("hasTimeInterval"), interval)
        end = "INF" if end_s is None else repr(self._zero_s + end_s)
        self._add(interval, soma("hasIntervalBegin"), Literal(repr(self._zero_s + begin_s), xsd("double")))
        self._add(interval, soma("hasIntervalEnd"), Literal(end, xsd("double")))

    def _individual(self, name: str, cls: Iri) -> Iri:
        iri = Iri(self._namespace + quote(name, safe=""))
        self._link(iri, TYPE, NAMED_INDIVIDUAL)
        self._link(iri, TYPE, cls)
        return iri

    def _link(self, subject: Iri, property: Iri, value: Iri) -> None:
        self._add(subject, property, IriRef(value))

    def _add(self, subject: Iri, property: Iri, value: FactValue) -> None:
        self._blocks.setdefault(subject, {})[PropertyAssertion(property, value)] = None


# -- reading -----------------------------------------------------------------------------------------------------------

_NARRATIVES = ("ontology.ttl", "ontology.owl")
_TRIPLES = ("triples", "inferred", "annotations")
"""KnowRob's collections of statements."""
_MAX_STAMP_NS = 7_258_118_400_000_000_000
"""Of a transform: the begin of 2200; nanoseconds since 1970 fit in 64 bits until 2262."""
_MAPS = ("map.owl", "map.ttl")


def read_neem(
    path: str | PathLike[str],
    world: World | None = None,
    *,
    bodies: Mapping[str, BodyId] | None = None,
    map_frame: str | None = None,
    geometry: GeometryMap = NO_GEOMETRY,
) -> Neem:
    """Reads a NEEM that `write_neem` or KnowRob wrote.

    The narrative is `ontology.ttl` or `ontology.owl`, or else the collections `triples`, `inferred` and `annotations`,
    the experience the collection `tf`. Collections are files `.bson` of mongodump or `.json` of mongoexport, also with
    gzip, here or up to two folders below, such as `ros_tf/roslog/tf.bson` in KnowRob's dumps.

    Args:
        path: the folder.
        world: the map of the environment; by default `map.owl` in the folder.
        bodies: see `TransformRecording`.
        map_frame: see there.
        geometry: see there.

    Raises:
        EpisodeFileError: a file is missing or damaged.
        EpisodeError: the frame of the map is not clear.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise EpisodeFileError(str(folder), cause="it is no folder", remedy="a NEEM is a folder with tf.json")
    world = world or _read_map(folder)
    experience = find_collection(folder, "tf")
    if experience is None:
        remedy = "the experience is a collection tf: tf.json, tf.bson, or ros_tf/roslog/tf.bson"
        raise EpisodeFileError(str(folder), cause="it has no experience", remedy=remedy)
    log = _read_transforms(experience)
    events: tuple[EpisodeEvent, ...] = ()
    if paths := _narrative(folder):
        reader = _EventReader(_read_graph(paths, log.findings), world, _first_stamp_ns(log) * _NS)
        events = reader.events()
        log.findings += reader.findings
    else:
        names = ", ".join((*_NARRATIVES, *(f"a collection {name}" for name in _TRIPLES[:1])))
        log.findings.append(f"the folder has no narrative ({names}), so there are no events")
    return Neem(
        log,
        world,
        name=without_surrogates(folder.stem),
        bodies=bodies,
        map_frame=map_frame,
        rate_hz=None,
        geometry=geometry,
        events=lambda _: events,
    )


def _narrative(folder: Path) -> list[Path]:
    """The files of the narrative: an ontology, or else KnowRob's collections, of which the triples are needed."""
    ontology = next((folder / name for name in _NARRATIVES if (folder / name).is_file()), None)
    if ontology is not None:
        return [ontology]
    found = [find_collection(folder, name) for name in _TRIPLES]
    return [path for path in found if path is not None] if found[0] is not None else []


def _read_map(folder: Path) -> World:
    path = next((folder / name for name in _MAPS if (folder / name).is_file()), None)
    if path is None:
        remedy = f"give the one that was recorded, or put it there as {' or '.join(_MAPS)}"
        raise EpisodeFileError(str(folder), cause="it has no map", remedy=remedy)
    knowledge = KnowledgeBase()
    try:
        knowledge.load(path)
        return knowledge.world()
    except KnowledgeError as error:
        raise EpisodeFileError(str(folder), cause=f"its map cannot be read: {error}") from error
    finally:
        knowledge.close()


def _read_transforms(path: Path) -> TransformLog:
    log = TransformLog()
    for place, entry in read_collection(path):
        # KnowRob's `mongodb_log` stored each message of /tf as one document.
        documents = entry.get("transforms", [entry])
        if not isinstance(documents, list):
            documents = [documents]
        for document in documents:
            try:
                header, transform = document["header"], document["transform"]
                at, turn = transform["translation"], transform["rotation"]
                pose = [float(each) for each in (at["x"], at["y"], at["z"], turn["w"], turn["x"], turn["y"], turn["z"])]
                stamp_ns = int(header["stamp_ns"]) if "stamp_ns" in header else _stamp_ns(header["stamp"])
                child, parent = document["child_frame_id"], header["frame_id"]
                if not (isinstance(child, str) and isinstance(parent, str)):
                    raise TypeError("a frame has no name")
                if not 0 <= stamp_ns <= _MAX_STAMP_NS:
                    raise ValueError(f"the stamp {stamp_ns * _NS:g} s is not after 1970 and before 2200")
            except (KeyError, TypeError, ValueError, OverflowError) as error:
                raise EpisodeFileError(
                    str(path),
                    cause=f"{place} is no transform: {error!r}",
                    remedy="it needs header.stamp, header.frame_id, child_frame_id and transform",
                ) from error
            log.add_transform(child, parent, pose, stamp_ns=stamp_ns, logged_ns=stamp_ns)
    if not log:
        raise EpisodeFileError(str(path), cause="it has no transform")
    return log


def _stamp_ns(stamp: Any) -> int:
    """A time as MongoDB's tools and KnowRob write it: a date, milliseconds, seconds and nanoseconds, or seconds."""
    if isinstance(stamp, Mapping) and "$date" in stamp:
        date = stamp["$date"]
        if isinstance(date, str):
            return round(datetime.fromisoformat(date).timestamp() * 1000) * 1_000_000
        milliseconds = date["$numberLong"] if isinstance(date, Mapping) else date
        return int(milliseconds) * 1_000_000
    if isinstance(stamp, Mapping):
        seconds = stamp.get("secs", stamp.get("sec", 0))
        return int(seconds) * 1_000_000_000 + int(stamp.get("nsecs", stamp.get("nanosec", 0)))
    return round(float(stamp) * 1e9)


def _first_stamp_ns(log: TransformLog) -> int:
    return min(stamp for samples in log.moving.values() for stamp in samples.stamps)


def _read_graph(paths: Sequence[Path], findings: list[str]) -> Graph:
    """The statements of a file of RDF, or of KnowRob's collections of triples and annotations.

    KnowRob stores with a triple the properties and classes that are above its own (`p*`, `o*`); these are read, too.
    """
    graph: dict[Iri, dict[PropertyAssertion, None]] = {}
    limited = 0
    for path in paths:
        if path.suffix in {".ttl", ".owl"}:
            try:
                return read_statements(path)
            except KnowledgeError as error:
                raise EpisodeFileError(str(path), cause=f"it cannot be read: {error}") from error
        for place, document in read_collection(path):
            subject, property = document.get("s"), document.get("p")
            if not isinstance(subject, str) or not isinstance(property, str) or not {"o", "v"} & set(document):
                raise EpisodeFileError(str(path), cause=f"{place} is no triple", remedy="it needs s, p, and o or v")
            value = document["o"] if "o" in document else document["v"]
            values = [value, *_texts(document, "o*")] if property == TYPE else [value]
            limited += _is_limited(document.get("scope"))
            facts = graph.setdefault(Iri(subject), {})
            for each in dict.fromkeys((property, *_texts(document, "p*"))):
                facts |= dict.fromkeys(PropertyAssertion(Iri(each), _json_value(one)) for one in values)
    if limited:
        findings.append(f"read as if always true, without its time: {counted(limited, 'statement')} of the narrative")
    return {subject: list(facts) for subject, facts in graph.items()}


def _is_limited(scope: Any) -> bool:
    """Whether the scope of a triple in KnowRob's store is only a part of all time."""
    time = scope.get("time") if isinstance(scope, Mapping) else None
    if not isinstance(time, Mapping):
        return False
    return time.get("since") not in {None, 0} or time.get("until") not in {None, math.inf, "Infinity"}


def _texts(document: Mapping[str, Any], key: str) -> list[str]:
    values = document.get(key)
    return [each for each in values if isinstance(each, str)] if isinstance(values, list) else []


def _json_value(value: Any) -> FactValue:
    """A value of a triple in KnowRob's store: an IRI, other text, or a number in one of Mongo's notations."""
    if isinstance(value, Mapping) and len(value) == 1:
        (value,) = value.values()
    if isinstance(value, str) and "://" in value and not any(map(str.isspace, value)):
        return IriRef(Iri(value))
    return Literal(str(value).replace("Infinity", "INF"))


@dataclass(slots=True)
class _Participants:
    thing: BodyId | None = None
    other: BodyId | None = None
    joint: BodyId | None = None
    agent: str | None = None
    unknown: list[str] = field(default_factory=list)


class _EventReader:
    """Finds the events of a narrative."""

    def __init__(self, graph: Graph, world: World, zero_s: float) -> None:
        self._graph, self._zero_s = graph, zero_s
        self._entities: dict[Iri, BodyId] = {body.iri: body.id for body in world.bodies}
        self._entities |= {joint.iri: joint.id for joint in world.joints}
        self._joints = {joint.id for joint in world.joints}
        self.findings: list[str] = []
        self._concepts: dict[Iri, list[Iri]] = {}
        for subject, facts in graph.items():
            for fact in facts:
                if isinstance(fact.value, IriRef):
                    if fact.property in {dul("executesTask"), dul("isClassifiedBy"), soma("isOccurrenceOf")}:
                        self._concepts.setdefault(subject, []).append(fact.value.iri)
                    elif fact.property == dul("classifies"):
                        self._concepts.setdefault(fact.value.iri, []).append(subject)

    def events(self) -> tuple[EpisodeEvent, ...]:
        """The events that have a kind and a body, in the order of their begin."""
        found = []
        constituents, settings = (
            {
                value.iri
                for facts in self._graph.values()
                for value in self._values(facts, dul(property))
                if isinstance(value, IriRef)
            }
            for property in ("hasConstituent", "isSettingFor")
        )
        for subject, facts in self._graph.items():
            intervals = [
                value.iri for value in self._values(facts, dul("hasTimeInterval")) if isinstance(value, IriRef)
            ]
            kind = self._kind(subject)
            if not intervals:
                continue
            if kind is None:
                if subject in constituents or subject not in settings:
                    classes = [
                        next(cls for cls in [*self._types(concept), None] if cls != NAMED_INDIVIDUAL)
                        for concept in self._concepts.get(subject, ())
                    ]
                    names = ", ".join(local_name(cls) for cls in classes if cls) or "no concept"
                    self.findings.append(f"{local_name(subject)} ({names}) is no kind of event here; it is left out")
                continue
            event = self._event(subject, facts, kind, intervals[0])
            if event is not None:
                found.append(event)
        return tuple(sorted(found, key=lambda each: (each.begin_s, each.id)))

    def _event(
        self, subject: Iri, facts: Sequence[PropertyAssertion], kind: EpisodeEventKind, interval: Iri
    ) -> EpisodeEvent | None:
        name = unquote(local_name(subject))
        times = [self._number(interval, soma(end)) for end in ("hasIntervalBegin", "hasIntervalEnd")]
        if times[0] is None or not math.isfinite(times[0]):
            self.findings.append(f"{name} has no begin; it is left out")
            return None
        people = self._participants(subject, facts)
        if people.unknown:
            self.findings.append(f"{listed(people.unknown)}, in {name}, is no body of the map")
        if people.thing is None:
            self.findings.append(f"{name} has no participant that is a body of the map; it is left out")
            return None
        amounts = [
            self._number(value.iri, dul("hasRegionDataValue"))
            for value in self._values(facts, dul("hasRegion"))
            if isinstance(value, IriRef)
        ]
        comments = [value.text for value in self._values(facts, _COMMENT) if isinstance(value, Literal)]
        return EpisodeEvent(
            id=name,
            kind=kind,
            begin_s=times[0] - self._zero_s,
            end_s=None if times[1] is None or math.isinf(times[1]) else times[1] - self._zero_s,
            thing=people.thing,
            other=people.other,
            agent=people.agent,
            joint=people.joint,
            amount=next(iter(amounts), None),
            evidence=tuple(line for comment in comments for line in comment.split("\n")),
        )

    def _participants(self, subject: Iri, facts: Sequence[PropertyAssertion]) -> _Participants:
        """The participants, by the labels of their roles in this event, else by the classes of the roles."""
        found = _Participants()
        concepts = self._concepts.get(subject, [])
        roles_here = {
            value.iri
            for concept in concepts
            for property in CONCEPT_ROLES.values()
            for value in self._values(self._graph.get(concept, ()), property)
            if isinstance(value, IriRef)
        }
        agents = [value.iri for value in self._values(facts, soma("isPerformedBy")) if isinstance(value, IriRef)]
        participants = [value.iri for value in self._values(facts, dul("hasParticipant")) if isinstance(value, IriRef)]
        rest: list[BodyId] = []
        for participant in dict.fromkeys([*participants, *agents]):
            labels = [
                label
                for value in self._values(self._graph.get(participant, ()), dul("hasRole"))
                if isinstance(value, IriRef) and value.iri in roles_here
                for label in self._role_labels(value.iri)
            ]
            name = self._name(participant)
            for label in labels or ([_AGENT] if participant in agents else [""]):
                if label == _AGENT:
                    found.agent = name
                elif participant not in self._entities and label not in {_THING, _OTHER, _JOINT}:
                    found.unknown.append(name)
                elif label == _THING:
                    found.thing = BodyId(name)
                elif label == _OTHER:
                    found.other = BodyId(name)
                elif label == _JOINT or name in self._joints:
                    found.joint = BodyId(name)
                else:
                    rest.append(BodyId(name))
        if found.thing is None and rest:
            found.thing = rest.pop(0)
        if found.other is None and rest:
            found.other = rest.pop(0)
        return found

    def _role_labels(self, role: Iri) -> Iterator[str]:
        facts = self._graph.get(role, ())
        labels = {value.text for value in self._values(facts, LABEL) if isinstance(value, Literal)}
        if known := labels & {_THING, _OTHER, _JOINT, _AGENT}:
            yield from sorted(known)
            return
        classes = set(self._classes(role))
        if soma("AgentRole") in classes:
            yield _AGENT
        elif classes & {soma("Supporter"), soma("Container"), soma("Location"), soma("Destination"), soma("Origin")}:
            yield _OTHER
        elif soma("Patient") in classes:
            yield _THING

    def _name(self, iri: Iri) -> str:
        if iri in self._entities:
            return self._entities[iri]
        labels = [value.text for value in self._values(self._graph.get(iri, ()), LABEL) if isinstance(value, Literal)]
        return labels[0] if labels else unquote(local_name(iri))

    def _kind(self, subject: Iri) -> EpisodeEventKind | None:
        """The kind by the class of the event itself, or by that of its task or type, or by a class above that."""
        own = [_KIND_OF_CLASS[cls] for cls in self._types(subject) if cls in _KIND_OF_CLASS]
        concepts = [cls for concept in self._concepts.get(subject, ()) for cls in self._classes(concept)]
        return next(iter([*own, *(_KIND_OF_CONCEPT[cls] for cls in concepts if cls in _KIND_OF_CONCEPT)]), None)

    def _classes(self, subject: Iri) -> list[Iri]:
        """The classes of an individual, then those above them as far as the narrative states them, nearest first."""
        found = dict.fromkeys(self._types(subject))
        nearest = list(found)
        while nearest:
            above = [
                value.iri
                for cls in nearest
                for value in self._values(self._graph.get(cls, ()), SUBCLASS_OF)
                if isinstance(value, IriRef)
            ]
            nearest = [cls for cls in dict.fromkeys(above) if cls not in found]
            found |= dict.fromkeys(nearest)
        return list(found)

    def _types(self, subject: Iri) -> list[Iri]:
        return [value.iri for value in self._values(self._graph.get(subject, ()), TYPE) if isinstance(value, IriRef)]

    def _number(self, subject: Iri, property: Iri) -> float | None:
        for value in self._values(self._graph.get(subject, ()), property):
            if isinstance(value, Literal):
                try:
                    return float(value.text)
                except ValueError:
                    self.findings.append(f"{local_name(subject)} has {local_name(property)} {value.text!r}, no number")
        return None

    def _values(self, facts: Iterable[PropertyAssertion], property: Iri) -> list[FactValue]:
        return [fact.value for fact in facts if fact.property == property]
