"""The Python side of `episodes.pl`: the events of episodes as terms.

An event is named as in SPARQL, `urn:mindstage:episode:NAME#PickingUp_1`, and given also as `PickingUp_1` if one episode
only has an event of that name.
"""

from __future__ import annotations

from mindstage.errors import AmbiguousNameError
from mindstage.knowledge.event_graph import EPISODE_GRAPHS, concept_node, event_node, event_pattern, event_roles
from mindstage.knowledge.history import EventFilter, PastEvent, histories_of
from mindstage.prolog.predicates import Handler, text_of
from mindstage.prolog.swipl import FREE, Atom, Compound, Value
from mindstage.rdf.vocabulary import ms
from mindstage.scene import Iri
from mindstage.simulation import Simulation

__all__ = ["EpisodePredicates"]


class EpisodePredicates:
    """Handlers of the predicates about episodes."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self.handlers: dict[str, Handler] = {
            "episodes": self.episodes,
            "episode_events": self.events,
            "event_is": self.event_is,
            "event_agents": self.agents,
            "event_roles": self.roles,
            "event_tasks": self.tasks,
        }

    def episodes(self) -> Value:
        """The episodes as episode(Name, Begin, End)."""
        found = histories_of(self._simulation.knowledge.episodes)
        return [Compound("episode", (Atom(each.name), each.begin_s, each.end_s)) for each in found]

    def events(self, event: Value) -> Value:
        """Events as event(Event, Class, Begin, End, Episode)."""
        return [
            Compound(
                "event",
                (
                    _event_name(each),
                    Atom(ms(each.kind)),
                    each.begin_s,
                    Atom("none") if each.end_s is None else each.end_s,
                    Atom(each.episode),
                ),
            )
            for each in self._events(event)
        ]

    def event_is(self, event: Value, cls: Value) -> Value:
        """Whether an event is a member of a class or of a subclass."""
        index = self._simulation.knowledge.reasoner.classes
        return any(str(cls) in {ms(each.kind), *index.above(ms(each.kind))} for each in self._events(event))

    def agents(self, event: Value) -> Value:
        """Pairs of an event and its agent."""
        found = self._events(event)
        return [Compound("-", (_event_name(each), Atom(each.agent))) for each in found if each.agent is not None]

    def tasks(self) -> Value:
        """Pairs of an event and its task, or the type of a state or process."""
        return [Compound("-", (_event_name(each), Atom(concept_node(each).value))) for each in self._events(FREE)]

    def roles(self, event: Value) -> Value:
        """Pairs of an event and role(Task, Type of the task, Role, Class of the role, Participant, its class)."""
        found: list[Value] = []
        for each in self._events(event):
            task, kind = Atom(concept_node(each).value), Atom(event_pattern(each).concept)
            for role in event_roles(each):
                cls = self._class_of(role.participant)
                own = (task, kind, Atom(role.node.value), Atom(role.cls), Atom(role.participant), cls)
                found.append(Compound("-", (_event_name(each), Compound("role", own))))
        return found

    def _class_of(self, participant: Iri) -> Value:
        cls = self._simulation.knowledge.reasoner.class_of(participant)
        return Atom("none") if cls is None else Atom(cls)

    def _events(self, event: Value) -> list[PastEvent]:
        """The event with a name, or all.

        Raises:
            AmbiguousNameError: events of several episodes have that name.
            InvalidArgumentError: it is no name.
        """
        sources = self._simulation.knowledge.episodes
        if event is FREE:
            return [each for source in sources for each in source.find_events(EventFilter())]
        text = text_of(event, "event")
        graph, _, id = text.rpartition("#") if text.startswith(EPISODE_GRAPHS) else ("", "", text)
        found = [
            each
            for source in sources
            for each in source.find_events(EventFilter())
            if (_event_name(each) == text if graph else each.id == id)
        ]
        if len(found) > 1:
            raise AmbiguousNameError(text, entity_type="event", candidates=[Iri(_event_name(each)) for each in found])
        return found


def _event_name(event: PastEvent) -> Atom:
    return Atom(event_node(event.episode, event.id).value)
