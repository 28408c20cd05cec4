"""Places a list of items, read from a Turtle file, where the list or the knowledge base says.

    :milk a knowrob:CowsMilk .                                # placed where milk is stored
    :plates a knowrob:DinnerPlate ; ms:count 4 ; ms:putOn :Table1 .
    :spoon a knowrob:Spoon ; ms:putInto :CutleryDrawer ; ms:typicalSize "0.2 0.04 0.02" .

Other statements about an item become facts of its body.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import msgspec

from mindstage.errors import (
    BodyNotFoundError,
    KnowledgeError,
    NameNotFoundError,
    NoFreePlacementError,
    SourceParseError,
)
from mindstage.knowledge.knowledge_base import KnowledgeBase
from mindstage.knowledge.names import EntityType
from mindstage.rdf.graphs import Graph, local_name, read_named_graph
from mindstage.rdf.vocabulary import LABEL, OWL, RDF, RDFS, TYPE, ms
from mindstage.scene import Body, BodyId, FactValue, Iri, IriRef, Literal, PropertyAssertion, Vector
from mindstage.simulation.placement import PlacementResult
from mindstage.simulation.simulation import Simulation

__all__ = ["PlacementItem", "PlacementReport", "UnplacedItem", "load_items", "parse_item", "place_items"]


_ON, _INTO, _COUNT, _SIZE = ms("putOn"), ms("putInto"), ms("count"), ms("typicalSize")
_MAX_COUNT = 1000
_SCHEMA_NAMESPACES = (OWL, RDF, RDFS)
"""Instances of classes in these namespaces are classes, properties or ontologies, not items."""


class PlacementItem(msgspec.Struct, frozen=True, kw_only=True):
    """An item to place, or several equal ones."""

    iri: Iri | None = None
    """None to generate one."""
    cls: Iri
    """Its class."""
    support: str | None = None
    """Name or IRI of the holder; None to place it where the knowledge base says that its class is stored."""
    is_inside: bool | None = False
    """Whether it is placed in the holder or on it; None to try both, inside first."""
    count: int = 1
    label: str | None = None
    size: Vector | None = None
    """Extents [m]; None for the usual size of the class."""
    facts: tuple[PropertyAssertion, ...] = ()

    @property
    def iris(self) -> tuple[Iri | None, ...]:
        """The IRI of each of the `count` items."""
        if self.iri is None or self.count == 1:
            return (self.iri,) * self.count
        return tuple(Iri(f"{self.iri}_{number}") for number in range(1, self.count + 1))


def load_items(path: Path, knowledge: KnowledgeBase) -> tuple[PlacementItem, ...]:
    """Reads a list of items, and loads the classes that it defines into the knowledge base.

    Raises:
        SourceParseError: the file cannot be read, has no items, or an item has an invalid property.
    """
    knowledge.load((), ontologies=path)
    graph = read_named_graph(knowledge.store, Iri(knowledge.source_graph(path).value))
    items = tuple(_items(path, graph))
    if not items:
        raise SourceParseError(str(path), cause="there are no items in it; give each one a class (:mug a ms:Mug .)")
    return items


def parse_item(text: str, knowledge: KnowledgeBase) -> PlacementItem:
    """Parses CLASS or CLASS:HOLDER, such as "Mug", "Mug:table" or "Fork:drawer_1".

    Raises:
        NameNotFoundError: no class has that name.
        AmbiguousNameError: several classes have that name.
    """
    name, _, holder = text.rpartition(":")
    try:
        return PlacementItem(cls=knowledge.names.find(text, EntityType.CLASS))
    except NameNotFoundError:
        if not name:
            raise
    return PlacementItem(cls=knowledge.names.find(name, EntityType.CLASS), support=holder, is_inside=None)


def _items(path: Path, graph: Graph) -> Iterator[PlacementItem]:
    for subject, facts in graph.items():
        classes = [iri for fact in facts if fact.property == TYPE and (iri := _iri(fact.value))]
        item_classes = [cls for cls in classes if not cls.startswith(_SCHEMA_NAMESPACES)]
        if item_classes and not subject.startswith("_:"):
            yield _item(path, subject, item_classes, facts)


def _item(path: Path, iri: Iri, classes: Sequence[Iri], facts: Sequence[PropertyAssertion]) -> PlacementItem:
    on, into = _values(facts, _ON), _values(facts, _INTO)
    if len(on) + len(into) > 1:
        raise _error(path, iri, "it has several holders; give one ms:putOn or ms:putInto")
    holder = next(iter([*on, *into]), None)
    own = (_ON, _INTO, _COUNT, _SIZE, LABEL)
    kept = (fact for fact in facts if fact.property not in own and fact != PropertyAssertion(TYPE, IriRef(classes[0])))
    return PlacementItem(
        iri=iri,
        cls=classes[0],
        support=None if holder is None else (_iri(holder) or _text(holder)),
        is_inside=bool(into),
        count=_count(path, iri, facts),
        label=next((_text(value) for value in _values(facts, LABEL)), None),
        size=_size(path, iri, facts),
        facts=tuple(kept),
    )


def _count(path: Path, iri: Iri, facts: Sequence[PropertyAssertion]) -> int:
    for value in _values(facts, _COUNT):
        text = _text(value)
        if not text.isdecimal() or not 1 <= int(text) <= _MAX_COUNT:
            raise _error(path, iri, f'ms:count "{text}" is not an integer from 1 to {_MAX_COUNT}')
        return int(text)
    return 1


def _size(path: Path, iri: Iri, facts: Sequence[PropertyAssertion]) -> Vector | None:
    for value in _values(facts, _SIZE):
        try:
            x, y, z = map(float, _text(value).split())
        except ValueError:
            x = y = z = -1.0
        if not all(0.0 < extent < 100.0 for extent in (x, y, z)):
            raise _error(path, iri, f'ms:typicalSize "{_text(value)}" is not "depth width height" in meters')
        return x, y, z
    return None


def _values(facts: Sequence[PropertyAssertion], property: Iri) -> list[FactValue]:
    return [fact.value for fact in facts if fact.property == property]


def _iri(value: FactValue) -> Iri | None:
    return value.iri if isinstance(value, IriRef) else None


def _text(value: FactValue) -> str:
    return value.text if isinstance(value, Literal) else str(_iri(value) or "")


def _error(path: Path, iri: Iri, cause: str) -> SourceParseError:
    return SourceParseError(str(path), cause=f"{local_name(iri)}: {cause}")


class UnplacedItem(msgspec.Struct, frozen=True):
    """An item that could not be placed, and the reason."""

    id: str
    reason: str


class PlacementReport(msgspec.Struct, frozen=True):
    """The result of placing a list of items."""

    placed: tuple[PlacementResult, ...]
    unplaced: tuple[UnplacedItem, ...]


def place_items(
    simulation: Simulation, items: Iterable[PlacementItem], *, progress: Callable[[int], None] = lambda done: None
) -> PlacementReport:
    """Places items in a simulation, one after the other.

    Args:
        simulation: a simulation with a spawned world.
        items: the items. One without a holder is placed at the most specific storage place of its class that has room.
        progress: called after each item with the number of processed items.

    Returns:
        The placed items, and those that could not be placed, with the reason.
    """
    placed, unplaced, done = list[PlacementResult](), list[UnplacedItem](), 0
    for item in items:
        for iri in item.iris:
            result = _place_item(simulation, item, iri)
            if isinstance(result, PlacementResult):
                placed.append(result)
            else:
                unplaced.append(result)
            done += 1
            progress(done)
    return PlacementReport(tuple(placed), tuple(unplaced))


def _place_item(simulation: Simulation, item: PlacementItem, iri: Iri | None) -> PlacementResult | UnplacedItem:
    id = None if iri is None else local_name(iri)
    if id is not None and id in simulation.state.ids:
        return UnplacedItem(id, "the id is taken")
    try:
        body = simulation.make_body(item.cls, id=id, size=item.size)
        body = msgspec.structs.replace(body, iri=iri or body.iri, label=item.label, facts=item.facts)
        targets = list(_holders(simulation, item))
    except KnowledgeError as error:
        return UnplacedItem(id or local_name(item.cls), str(error))
    reasons = []
    for holder, inside in targets:
        try:
            return simulation.place(body, into=holder) if inside else simulation.place(body, on=holder)
        except (NoFreePlacementError, BodyNotFoundError) as error:
            reasons.append(str(error))
    name = local_name(item.cls)
    no_target = f"it has no holder (ms:putOn, ms:putInto), and no storage place for {name} is known in this world"
    return UnplacedItem(body.id, "; ".join(reasons) or no_target)


def _holders(simulation: Simulation, item: PlacementItem) -> Iterator[tuple[BodyId, bool]]:
    """The holders of an item, the best first, and whether it is placed inside."""
    if item.support is not None:
        holder = _find_body_id(simulation, item.support)
        yield from ((holder, inside) for inside in (True, False) if item.is_inside in (inside, None))
        return
    answers = simulation.ask("storage_place_in_environment", item=item.cls)
    for row in answers:
        yield _find_body_id(simulation, row.individual), True
    for row in answers:
        yield _find_body_id(simulation, row.individual), False


def _find_body_id(simulation: Simulation, name: str) -> BodyId:
    """Resolves the name or IRI of a body to its id.

    Raises:
        NameNotFoundError: no individual has that name.
        AmbiguousNameError: several individuals have that name.
    """
    if name in simulation.state.ids:
        return BodyId(name)
    iri = simulation.knowledge.names.find(name, EntityType.INDIVIDUAL)
    bodies: Iterator[Body] = (body for world in simulation.worlds for body in world.bodies if body.iri == iri)
    return next((body.id for body in bodies), BodyId(local_name(iri)))
