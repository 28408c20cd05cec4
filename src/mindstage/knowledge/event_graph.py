"""The statements of `urn:mindstage:episode:NAME`: the events of an episode, in the terms of SOMA's episodic memories.

    ?event a ms:PickingUp, dul:Action ; dul:hasTimeInterval ?interval ; dul:hasParticipant ?thing ;
        dul:executesTask ?task ; ms:beginTime 1.5 ; ms:endTime 2.0 .
    ?interval a dul:TimeInterval ; soma:hasIntervalBegin 1764000001.5 ; soma:hasIntervalEnd 1764000002.0 .
    ?task a soma:PickingUp ; dul:isTaskOf ?role .   ?role a soma:Patient ; dul:classifies ?thing .

- `ms:beginTime` and `ms:endTime` are seconds since the begin of the episode, and the ends of the interval seconds since
  1970, as in NEEMs, or since the begin if it is unknown when the episode was recorded. An event that had not ended has
  no end.
- An action executes a task, as above. A state or process is classified by a state or process type instead, which is
  the `soma:isStateTypeOf` or `soma:isProcessTypeOf` of the roles.
- The thing is the patient, the second participant has a role that depends on the event, and an agent that is a body
  performs it (`soma:isPerformedBy`); `ms:agent` is the name of any other agent.
- `<urn:mindstage:episode:NAME> a soma:Episode ; dul:isSettingFor ?event`.

Sources: github.com/ease-crc/soma, owl/SOMA.owl (2.0.0), SOMA-STATE.owl, SOMA-PROC.owl, docs/NEEM-handbook;
knowrob/knowrob, src/model/DUL/Event.pl for the property of the roles of a task.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple
from urllib.parse import quote

import pyoxigraph as ox

from mindstage.errors import EpisodeError
from mindstage.knowledge.history import EpisodeSource, EventFilter, History, PastEvent
from mindstage.knowledge.sparql_query import SparqlText
from mindstage.rdf.vocabulary import RDFS, SOMA, TYPE, dul, ms, soma
from mindstage.scene import Iri

__all__ = [
    "CONCEPT_ROLES",
    "EPISODE_GRAPHS",
    "EVENT_PATTERNS",
    "EventPattern",
    "EventRole",
    "concept_node",
    "episode_graph",
    "episode_statements",
    "event_node",
    "event_pattern",
    "event_roles",
    "event_statements",
]

EPISODE_GRAPHS = "urn:mindstage:episode:"
_MAX_EVENTS = 20_000
"""The largest number of events that are stated for one query."""


class EventPattern(NamedTuple):
    """How a kind of event is stated."""

    event: Iri
    """The class of events in DUL or SOMA."""
    concept: Iri
    """The class of the task, state type or process type of which it is an occurrence."""
    other: Iri = soma("Patient")
    """The class of the role of the second participant."""


_STATE_MODULE = "http://www.ease-crc.org/ont/SOMA-STATE.owl#"
_ACTION, _STATE, _PROCESS = dul("Action"), soma("State"), dul("Process")
EVENT_PATTERNS: Mapping[str, EventPattern] = {
    "Contact": EventPattern(_STATE, soma("ContactState")),
    "SupportedBy": EventPattern(_STATE, soma("SupportState"), soma("Supporter")),
    "ContainedIn": EventPattern(_STATE, Iri(_STATE_MODULE + "ContainmentState"), soma("Container")),
    "Grasping": EventPattern(_ACTION, soma("Grasping")),
    "PickingUp": EventPattern(_ACTION, soma("PickingUp"), soma("Supporter")),
    "PuttingDown": EventPattern(_ACTION, soma("PuttingDown"), soma("Supporter")),
    "Transporting": EventPattern(_ACTION, soma("Transporting"), soma("Location")),
    "Opening": EventPattern(_ACTION, soma("Opening")),
    "Closing": EventPattern(_ACTION, soma("Closing")),
    "Performing": EventPattern(_ACTION, soma("PhysicalTask")),
    "Sliding": EventPattern(_PROCESS, soma("Rubbing"), soma("Supporter")),
    "Falling": EventPattern(_PROCESS, soma("DirectedMotion")),
    "TippingOver": EventPattern(_PROCESS, soma("Motion")),
    "Colliding": EventPattern(_PROCESS, soma("Collision"), soma("Antagonist")),
}
"""The pattern of each kind of event."""
_OTHER_KINDS = EventPattern(dul("Event"), dul("EventType"))
_CONCEPT_OF = {_ACTION: dul("executesTask")}
CONCEPT_ROLES = {_ACTION: dul("isTaskOf"), _STATE: soma("isStateTypeOf"), _PROCESS: soma("isProcessTypeOf")}
"""The property from the concept of an event to the roles of its participants, by the class of the event."""
_NAMED = ("http://", "https://", "urn:")


def episode_graph(name: str) -> ox.NamedNode:
    """The name of the graph of an episode."""
    return ox.NamedNode(EPISODE_GRAPHS + quote(name))


def event_node(episode: str, id: str) -> ox.NamedNode:
    """The individual that stands for an event."""
    return ox.NamedNode(f"{EPISODE_GRAPHS}{quote(episode)}#{quote(id)}")


def event_statements(history: History, events: Iterable[PastEvent]) -> bytes:
    """The statements about an episode and some of its events, in N-Quads."""
    graph = episode_graph(history.name)
    triples = _triples(history, graph, events)
    quads = (ox.Quad(each.subject, each.predicate, each.object, graph) for each in triples)
    return ox.serialize(dict.fromkeys(quads), format=ox.RdfFormat.N_QUADS) or b""


def episode_statements(
    query: SparqlText, prefixes: Mapping[str, str], episodes: Sequence[EpisodeSource]
) -> dict[str, bytes]:
    """The statements of the episodes that a query is about, in N-Quads, by the names of their graphs.

    Raises:
        EpisodeError: these have too many events.
    """
    if not episodes:
        return {}
    wanted = {iri.partition("#")[0] for iri in query.iris(prefixes) if iri.startswith(EPISODE_GRAPHS)}
    takes_all = query.has_graph_variable()
    found: dict[str, bytes] = {}
    count = 0
    for source in episodes:
        for name in source.names():
            graph = episode_graph(name).value
            if graph in wanted or takes_all:
                events = list(source.find_events(EventFilter(episode=name)))
                count += len(events)
                if count > _MAX_EVENTS:
                    raise EpisodeError(f"these episodes have more than {_MAX_EVENTS:,} events; name the graphs of some")
                found[graph] = event_statements(source.history(name), events)
    return found


def _triples(history: History, graph: ox.NamedNode, events: Iterable[PastEvent]) -> Iterator[ox.Triple]:
    yield _triple(graph, TYPE, soma("Episode"))
    yield _triple(graph, RDFS + "label", ox.Literal(history.name))
    yield from _times(graph, history.begin_s, history.end_s, history.start_unix_s)
    for event in events:
        node = event_node(event.episode, event.id)
        yield _triple(graph, dul("isSettingFor"), node)
        yield from _event_triples(node, event, history.start_unix_s)


class EventRole(NamedTuple):
    """The role of a participant of an event."""

    node: ox.NamedNode
    cls: Iri
    participant: Iri


def event_pattern(event: PastEvent) -> EventPattern:
    """How an event is stated."""
    return EVENT_PATTERNS.get(event.kind, _OTHER_KINDS)


def concept_node(event: PastEvent) -> ox.NamedNode:
    """The individual that stands for the task, state type or process type of an event."""
    return ox.NamedNode(f"{event_node(event.episode, event.id).value}_type")


def event_roles(event: PastEvent) -> Iterator[EventRole]:
    """The roles of the things that took part in an event."""
    node = event_node(event.episode, event.id)
    patient = soma("Patient")
    named = (("thing", event.thing, patient), ("other", event.other, event_pattern(event).other))
    for label, participant, cls in (*named, ("joint", event.joint, patient)):
        if participant is not None and participant.startswith(_NAMED):
            yield EventRole(ox.NamedNode(f"{node.value}_{label}"), cls, participant)


def _event_triples(node: ox.NamedNode, event: PastEvent, start_unix_s: float | None) -> Iterator[ox.Triple]:
    pattern = event_pattern(event)
    yield _triple(node, TYPE, ms(event.kind))
    yield _triple(node, TYPE, pattern.event)
    yield from _times(node, event.begin_s, event.end_s, start_unix_s)
    concept = concept_node(event)
    yield _triple(node, _CONCEPT_OF.get(pattern.event, dul("isClassifiedBy")), concept)
    yield _triple(concept, TYPE, pattern.concept)
    for role in event_roles(event):
        yield _triple(node, dul("hasParticipant"), role.participant)
        yield _triple(concept, CONCEPT_ROLES.get(pattern.event, dul("defines")), role.node)
        yield _triple(role.node, TYPE, role.cls)
        yield _triple(role.node, dul("classifies"), role.participant)
    if event.agent is not None and event.agent.startswith(_NAMED):
        yield _triple(node, dul("hasParticipant"), Iri(event.agent))
        yield _triple(node, soma("isPerformedBy"), Iri(event.agent))
    elif event.agent is not None:
        yield _triple(node, ms("agent"), ox.Literal(event.agent))
    if event.amount is not None:
        yield _triple(node, ms("amount"), ox.Literal(float(event.amount)))
    for line in event.evidence:
        yield _triple(node, RDFS + "comment", ox.Literal(line))


def _times(node: ox.NamedNode, begin_s: float, end_s: float | None, start_unix_s: float | None) -> Iterator[ox.Triple]:
    interval = ox.NamedNode(f"{node.value}_interval")
    yield _triple(node, dul("hasTimeInterval"), interval)
    yield _triple(interval, TYPE, dul("TimeInterval"))
    for name, own, time_s in (("Begin", "beginTime", begin_s), ("End", "endTime", end_s)):
        if time_s is not None:
            yield _triple(interval, SOMA + f"hasInterval{name}", ox.Literal(float(time_s + (start_unix_s or 0.0))))
            yield _triple(node, ms(own), ox.Literal(float(time_s)))


def _triple(subject: ox.NamedNode, predicate: str, value: ox.NamedNode | ox.Literal | str) -> ox.Triple:
    return ox.Triple(subject, ox.NamedNode(predicate), ox.NamedNode(value) if isinstance(value, str) else value)
