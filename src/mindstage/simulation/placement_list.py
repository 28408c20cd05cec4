"""Items: things to be put somewhere in a place, as a Turtle file lists them.

    :milk a knowrob:CowsMilk .                                # it goes where milk is kept
    :plates a knowrob:DinnerPlate ; ms:count 4 ; ms:putOn :Table1 .
    :spoon a knowrob:Spoon ; ms:putInto :CutleryDrawer ; ms:typicalSize "0.2 0.04 0.02" .

Whatever else is said of an item stays with it as facts.

Furnishing: things from a list come to stand where the list says, or where such things are kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import msgspec
import pyoxigraph as ox

from mindstage.errors import (
    BodyNotFoundError,
    KnowledgeError,
    NameNotFoundError,
    NoFreePlacementError,
    SourceParseError,
)
from mindstage.knowledge.knowledge_base import KnowledgeBase
from mindstage.knowledge.names import EntityType
from mindstage.knowledge.rdf import Graph, graph_from_quads, local_name
from mindstage.knowledge.vocabulary import LABEL, OWL, RDF, RDFS, TYPE, ms
from mindstage.scene import Body, BodyId, FactValue, Iri, IriRef, Literal, PropertyAssertion, Vector
from mindstage.simulation.placement import PlacementResult
from mindstage.simulation.simulation import Simulation

__all__ = ["PlacementItem", "PlacementReport", "UnplacedItem", "load_items", "parse_item", "place_items"]


_ON, _INTO, _COUNT, _SIZE = ms("putOn"), ms("putInto"), ms("count"), ms("typicalSize")
_MAX_COUNT = 1000
_SCHEMA_NAMESPACES = (OWL, RDF, RDFS)
"""What is of a class of these is a class or a property itself, or the file."""


class PlacementItem(msgspec.Struct, frozen=True, kw_only=True):
    """One thing, or several alike."""

    iri: Iri | None = None
    """None where any will do."""
    cls: Iri
    support: str | None = None
    """On what, or in what; None where knowledge shall say it."""
    is_inside: bool | None = False
    """Whether it goes into that; None where either will do."""
    count: int = 1
    label: str | None = None
    size: Vector | None = None
    facts: tuple[PropertyAssertion, ...] = ()

    @property
    def iris(self) -> tuple[Iri | None, ...]:
        """The IRI of each of them."""
        if self.iri is None or self.count == 1:
            return (self.iri,) * self.count
        return tuple(Iri(f"{self.iri}_{number}") for number in range(1, self.count + 1))


def load_items(path: Path, knowledge: KnowledgeBase) -> tuple[PlacementItem, ...]:
    """Reads a list of items; classes that it defines are known from then on.

    Raises:
        SourceParseError: it cannot be read, lists nothing, or says something of an item that cannot be.
    """
    knowledge.load((), ontologies=path)
    source = ox.NamedNode(path.resolve().as_uri())
    graph = graph_from_quads(knowledge.store.quads_for_pattern(None, None, None, source), set())
    items = tuple(_items(path, graph))
    if not items:
        raise SourceParseError(str(path), cause="there are no things in it; say of each what it is (:mug a ms:Mug .)")
    return items


def parse_item(text: str, knowledge: KnowledgeBase) -> PlacementItem:
    """A thing of a class: "Mug", or "Mug:table" for one that goes onto the table, "Fork:drawer_1" into the drawer.

    Raises:
        NameNotFoundError: there is no such class.
        AmbiguousNameError: there are several.
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
        things = [cls for cls in classes if not cls.startswith(_SCHEMA_NAMESPACES)]
        if things and not subject.startswith("_:"):
            yield _item(path, subject, things, facts)


def _item(path: Path, iri: Iri, classes: Sequence[Iri], facts: Sequence[PropertyAssertion]) -> PlacementItem:
    on, into = _values(facts, _ON), _values(facts, _INTO)
    if len(on) + len(into) > 1:
        raise _error(path, iri, "it is to be put in several places; say one ms:putOn or ms:putInto")
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
            raise _error(path, iri, f'ms:count "{text}" is no number from 1 to {_MAX_COUNT}')
        return int(text)
    return 1


def _size(path: Path, iri: Iri, facts: Sequence[PropertyAssertion]) -> Vector | None:
    for value in _values(facts, _SIZE):
        try:
            x, y, z = map(float, _text(value).split())
        except ValueError:
            x = y = z = -1.0
        if not all(0.0 < extent < 100.0 for extent in (x, y, z)):
            raise _error(path, iri, f'ms:typicalSize "{_text(value)}" is not "depth width height" in metres')
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
    """An item for which there is no place."""

    id: str
    reason: str


class PlacementReport(msgspec.Struct, frozen=True, rename={"placed": "put"}):
    """What became of a list."""

    placed: tuple[PlacementResult, ...]
    unplaced: tuple[UnplacedItem, ...]


def place_items(
    simulation: Simulation, items: Iterable[PlacementItem], *, progress: Callable[[int], None] = lambda done: None
) -> PlacementReport:
    """Puts items into the running world, one after the other; what finds no place is left out, with the reason.

    Args:
        stage: a world is spawned in it.
        items: what, and where to if that is told. Otherwise it is asked where such things are kept, and the most
            special answer with room for it is taken.
        progress: told after each thing how many have been looked after.
    """
    put, unplaced, done = list[PlacementResult](), list[UnplacedItem](), 0
    for item in items:
        for iri in item.iris:
            result = _place_item(simulation, item, iri)
            if isinstance(result, PlacementResult):
                put.append(result)
            else:
                unplaced.append(result)
            done += 1
            progress(done)
    return PlacementReport(tuple(put), tuple(unplaced))


def _place_item(simulation: Simulation, item: PlacementItem, iri: Iri | None) -> PlacementResult | UnplacedItem:
    id = None if iri is None else local_name(iri)
    if id is not None and id in simulation.state.ids:
        return UnplacedItem(id, "something of that id is there already")
    try:
        like = simulation.make_body(item.cls, id=id, size=item.size)
        body = msgspec.structs.replace(like, iri=iri or like.iri, label=item.label, facts=item.facts)
        wanted = list(_target_surfaces(simulation, item))
    except KnowledgeError as error:
        return UnplacedItem(id or local_name(item.cls), str(error))
    reasons = []
    for holder, inside in wanted:
        try:
            return simulation.place(body, into=holder) if inside else simulation.place(body, on=holder)
        except (NoFreePlacementError, BodyNotFoundError) as error:
            reasons.append(str(error))
    name = local_name(item.cls)
    nowhere = f"nobody told where it goes (ms:putOn, ms:putInto), and nothing here is known to keep {name}"
    return UnplacedItem(body.id, "; ".join(reasons) or nowhere)


def _target_surfaces(simulation: Simulation, item: PlacementItem) -> Iterator[tuple[BodyId, bool]]:
    """Where an item may go, the best first: the holder's id, and whether into it."""
    if item.support is not None:
        holder = _find_body_id(simulation, item.support)
        yield from ((holder, inside) for inside in (True, False) if item.is_inside in (inside, None))
        return
    kept = simulation.ask("storage_place_in_environment", item=item.cls)
    for row in kept:
        yield _find_body_id(simulation, row.individual), True
    for row in kept:
        yield _find_body_id(simulation, row.individual), False


def _find_body_id(simulation: Simulation, name: str) -> BodyId:
    """The body that an IRI or a name stands for.

    Raises:
        NameNotFoundError: nothing has that name.
        AmbiguousNameError: several things have it.
    """
    if name in simulation.state.ids:
        return BodyId(name)
    iri = simulation.knowledge.names.find(name, EntityType.INDIVIDUAL)
    bodies: Iterator[Body] = (body for world in simulation.worlds for body in world.bodies if body.iri == iri)
    return next((body.id for body in bodies), BodyId(local_name(iri)))
