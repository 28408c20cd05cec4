"""Place: the running world, as Prolog spawns it, hangs things on one another and lights them up."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import msgspec

from mindstage.engines import SpawnReport
from mindstage.errors import InvalidArgumentError
from mindstage.knowledge.names import local_name
from mindstage.knowledge.reasoning import EntityType
from mindstage.prolog.requests import Handler
from mindstage.prolog.terms import Atom, Compound, Value
from mindstage.stage import Simulation
from mindstage.world import Attachment, BodyId, Color, Iri, Joint, World
from mindstage.world.colors import parse_color

__all__ = ["WorldPredicates"]


class WorldPredicates:
    """What a stage is told to do."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._failed: tuple[Value, ...] = ()
        self.handlers: dict[str, Handler] = {
            "contents": self.contents,
            "spawn": self.spawn,
            "spawn_models": self.spawn_models,
            "spawn_constraints": self.spawn_constraints,
            "spawn_relations": self.spawn_relations,
            "failed_items": self.failed_items,
            "attach": self.attach,
            "highlight": self.highlight,
            "unhighlight": self.unhighlight,
        }

    # -- spawning ------------------------------------------------------------------------------------------------------

    def contents(self, map: Value) -> Value:
        """What can be spawned of a map: its bodies, its constraints, and who hangs on whom as two lists."""
        world = self._world(map)
        iris = {body.id: Atom(body.iri) for body in world.bodies}
        constraints = [Atom(each.iri) for each in world.joints]
        parents = [iris[each.parent] for each in world.attachments]
        children = [iris[each.child] for each in world.attachments]
        return Compound("contents", (list(iris.values()), constraints, parents, children))

    def spawn(self, map: Value) -> Value:
        """Spawns all of a map; whether nothing failed."""
        return self._spawn(self._world(map))

    def spawn_models(self, map: Value, models: Sequence[Value]) -> Value:
        """Spawns some bodies of a map; whether nothing failed."""
        world = self._world(map)
        there = {body.iri: body for body in world.bodies}
        chosen = tuple(there[iri] for iri in self._select(models, there, "bodies", world))
        return self._spawn(msgspec.structs.replace(world, bodies=chosen, joints=(), attachments=()))

    def spawn_constraints(self, map: Value, constraints: Sequence[Value]) -> Value:
        """Joins bodies that stand there already; whether nothing failed."""
        world = self._world(map)
        there: dict[Iri, Joint] = {each.iri: each for each in world.joints}
        chosen = tuple(there[iri] for iri in self._select(constraints, there, "constraints", world))
        return self._spawn(World(iri=world.iri, name=world.name, joints=chosen))

    def spawn_relations(self, map: Value, parents: Sequence[Value], children: Sequence[Value]) -> Value:
        """Hangs each child on the parent that stands at its place of the other list; whether nothing failed."""
        if len(parents) != len(children):
            cause = f"{len(parents)} parents and {len(children)} children are no pairs"
            raise InvalidArgumentError("spawn_relations", cause=cause, remedy="give each child its parent")
        world = self._world(map)
        ids = {body.iri: body.id for body in world.bodies}
        above = [ids[iri] for iri in self._select(parents, ids, "bodies", world)]
        below = [ids[iri] for iri in self._select(children, ids, "bodies", world)]
        pairs = tuple(Attachment(parent=one, child=other) for one, other in zip(above, below, strict=True))
        return self._spawn(World(iri=world.iri, name=world.name, attachments=pairs))

    def failed_items(self) -> Value:
        """What could not be spawned the last time, as failed(Kind, Id, Reason)."""
        return self._failed

    def _world(self, map: Value) -> World:
        knowledge = self._simulation.knowledge
        return knowledge.world(knowledge.names.find(_name(map, "map"), EntityType.MAP))

    def _spawn(self, world: World) -> bool:
        report = self._simulation.spawn(world)
        self._failed = tuple(_failures(report))
        return report.ok

    def _select(self, names: Sequence[Value], candidates: Collection[Iri], type_name: str, world: World) -> list[Iri]:
        find = self._simulation.knowledge.names.find
        iris = [find(_name(name, "individual"), EntityType.INDIVIDUAL) for name in names]
        for iri in iris:
            if iri not in candidates:
                raise InvalidArgumentError(local_name(iri), cause=f"it is none of the {type_name} of {world.name}")
        return iris

    # -- what stands there ---------------------------------------------------------------------------------------------

    def attach(self, parent: Value, child: Value) -> Value:
        """Hangs a body on another one, where it is."""
        above, below = self._body(parent), self._body(child)
        self._simulation.run_on_engine(lambda engine: engine.attach(above, below), label="attach", edits=True)
        return True

    def highlight(self, individuals: Sequence[Value], color: Value, reason: Value) -> Value:
        """Lights bodies up, or puts them out; how many they were, and what has no body, each as dark(Name, Reason)."""
        names = [self._body_or_name(each) for each in individuals]
        shown = self._simulation.highlight(names, _color(color), label=str(reason), missing_ok=True)
        dark = [Compound("not_highlighted", (Atom(each.id), each.reason)) for each in shown.unhighlighted]
        return Compound("highlighted", (len(shown.highlighted), dark))

    def unhighlight(self) -> Value:
        """Puts all lights out."""
        self._simulation.clear_highlights()
        return True

    def _body_or_name(self, individual: Value) -> str:
        """The id of a body, where it is one, or else the whole name."""
        name = _name(individual, "individual")
        return (
            name
            if name in self._simulation.state.ids
            else self._simulation.knowledge.names.find(name, EntityType.INDIVIDUAL)
        )

    def _body(self, individual: Value) -> BodyId:
        """Its id in the running world, or else its local name, so that the engine can say that it is not there."""
        name = self._body_or_name(individual)
        bodies = (body for world in self._simulation.worlds for body in world.bodies)
        return next((body.id for body in bodies if body.iri == name), BodyId(local_name(name)))


def _failures(report: SpawnReport) -> Iterator[Value]:
    for kind, failures in (
        ("body", report.failed_bodies),
        ("constraint", report.failed_joints),
        ("attachment", report.failed_attachments),
    ):
        for failure in failures:
            yield Compound("failed", (Atom(kind), Atom(failure.id), failure.reason))


def _name(value: Value, description: str) -> str:
    if isinstance(value, str):
        return str(value)
    raise InvalidArgumentError(f"the {description}", cause=f"{value!r} is no name")


def _color(value: Value) -> Color | None:
    match value:
        case Compound("rgb", parts):
            return parse_color(",".join(map(str, parts)))
        case _:
            return parse_color(str(value))
