"""Place: the running world, as Prolog spawns it, hangs things on one another and lights them up."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import msgspec

from mindstage.engines import SpawnReport
from mindstage.errors import ArgumentRefused
from mindstage.knowledge.names import local_name
from mindstage.knowledge.reasoning import NameKind
from mindstage.prolog.requests import Handler
from mindstage.prolog.terms import Atom, Compound, Value
from mindstage.stage import Stage
from mindstage.world import Attachment, BodyId, Colour, Constraint, Iri, World
from mindstage.world.colours import colour_from

__all__ = ["Place"]


class Place:
    """What a stage is told to do."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
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
        constraints = [Atom(each.iri) for each in world.constraints]
        parents = [iris[each.parent] for each in world.attachments]
        children = [iris[each.child] for each in world.attachments]
        return Compound("contents", (list(iris.values()), constraints, parents, children))

    def spawn(self, map: Value) -> Value:
        """Spawns all of a map; whether nothing failed."""
        return self._spawned(self._world(map))

    def spawn_models(self, map: Value, models: Sequence[Value]) -> Value:
        """Spawns some bodies of a map; whether nothing failed."""
        world = self._world(map)
        there = {body.iri: body for body in world.bodies}
        chosen = tuple(there[iri] for iri in self._found(models, there, "bodies", world))
        return self._spawned(msgspec.structs.replace(world, bodies=chosen, constraints=(), attachments=()))

    def spawn_constraints(self, map: Value, constraints: Sequence[Value]) -> Value:
        """Joins bodies that stand there already; whether nothing failed."""
        world = self._world(map)
        there: dict[Iri, Constraint] = {each.iri: each for each in world.constraints}
        chosen = tuple(there[iri] for iri in self._found(constraints, there, "constraints", world))
        return self._spawned(World(iri=world.iri, name=world.name, constraints=chosen))

    def spawn_relations(self, map: Value, parents: Sequence[Value], children: Sequence[Value]) -> Value:
        """Hangs each child on the parent that stands at its place of the other list; whether nothing failed."""
        if len(parents) != len(children):
            cause = f"{len(parents)} parents and {len(children)} children are no pairs"
            raise ArgumentRefused("spawn_relations", cause=cause, remedy="give each child its parent")
        world = self._world(map)
        ids = {body.iri: body.id for body in world.bodies}
        above = [ids[iri] for iri in self._found(parents, ids, "bodies", world)]
        below = [ids[iri] for iri in self._found(children, ids, "bodies", world)]
        pairs = tuple(Attachment(parent=one, child=other) for one, other in zip(above, below, strict=True))
        return self._spawned(World(iri=world.iri, name=world.name, attachments=pairs))

    def failed_items(self) -> Value:
        """What could not be spawned the last time, as failed(Kind, Id, Reason)."""
        return self._failed

    def _world(self, map: Value) -> World:
        knowledge = self._stage.knowledge
        return knowledge.world(knowledge.names.find(_name(map, "map"), NameKind.MAP))

    def _spawned(self, world: World) -> bool:
        report = self._stage.spawn(world)
        self._failed = tuple(_failures(report))
        return report.ok

    def _found(self, names: Sequence[Value], among: Collection[Iri], kind: str, world: World) -> list[Iri]:
        find = self._stage.knowledge.names.find
        iris = [find(_name(name, "individual"), NameKind.INDIVIDUAL) for name in names]
        for iri in iris:
            if iri not in among:
                raise ArgumentRefused(local_name(iri), cause=f"it is none of the {kind} of {world.name}")
        return iris

    # -- what stands there ---------------------------------------------------------------------------------------------

    def attach(self, parent: Value, child: Value) -> Value:
        """Hangs a body on another one, where it is."""
        above, below = self._body(parent), self._body(child)
        self._stage.call(lambda engine: engine.attach(above, below), what="attach", edits=True)
        return True

    def highlight(self, individuals: Sequence[Value], colour: Value, reason: Value) -> Value:
        """Lights bodies up, or puts them out; how many they were, and what has no body, each as dark(Name, Reason)."""
        names = [self._called(each) for each in individuals]
        shown = self._stage.highlight(names, _colour(colour), label=str(reason), missing_ok=True)
        dark = [Compound("not_highlighted", (Atom(each.id), each.reason)) for each in shown.not_lit]
        return Compound("highlighted", (len(shown.lit), dark))

    def unhighlight(self) -> Value:
        """Puts all lights out."""
        self._stage.put_out()
        return True

    def _called(self, individual: Value) -> str:
        """The id of a body, where it is one, or else the whole name."""
        name = _name(individual, "individual")
        return name if name in self._stage.frame.ids else self._stage.knowledge.names.find(name, NameKind.INDIVIDUAL)

    def _body(self, individual: Value) -> BodyId:
        """Its id in the running world, or else its local name, so that the engine can say that it is not there."""
        name = self._called(individual)
        bodies = (body for world in self._stage.worlds for body in world.bodies)
        return next((body.id for body in bodies if body.iri == name), BodyId(local_name(name)))


def _failures(report: SpawnReport) -> Iterator[Value]:
    for kind, failures in (
        ("body", report.failed_bodies),
        ("constraint", report.failed_constraints),
        ("attachment", report.failed_attachments),
    ):
        for failure in failures:
            yield Compound("failed", (Atom(kind), Atom(failure.id), failure.reason))


def _name(value: Value, what: str) -> str:
    if isinstance(value, str):
        return str(value)
    raise ArgumentRefused(f"the {what}", cause=f"{value!r} is no name")


def _colour(value: Value) -> Colour | None:
    match value:
        case Compound("rgb", parts):
            return colour_from(",".join(map(str, parts)))
        case _:
            return colour_from(str(value))
