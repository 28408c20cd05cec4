"""Furnishing: things from a list come to stand where the list says, or where such things are kept."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import msgspec

from mindstage.errors import BodyNotFoundError, KnowledgeError, NoFreePlacementError
from mindstage.knowledge.items import PlacementItem
from mindstage.knowledge.names import local_name
from mindstage.knowledge.reasoning import EntityType
from mindstage.stage.putting import PlacementResult
from mindstage.stage.stage import Simulation
from mindstage.world import Body, BodyId, Iri

__all__ = ["PlacementReport", "UnplacedItem", "place_items"]


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
