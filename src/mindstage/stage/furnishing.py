"""Furnishing: things from a list come to stand where the list says, or where such things are kept."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import msgspec

from mindstage.errors import BodyUnknown, KnowledgeError, SpotMissing
from mindstage.knowledge.items import Item
from mindstage.knowledge.names import local_name
from mindstage.knowledge.reasoning import NameKind
from mindstage.stage.putting import Put
from mindstage.stage.stage import Stage
from mindstage.world import Body, BodyId, Iri

__all__ = ["Furnished", "Unplaced", "furnish"]


class Unplaced(msgspec.Struct, frozen=True):
    """An item for which there is no place."""

    id: str
    reason: str


class Furnished(msgspec.Struct, frozen=True):
    """What became of a list."""

    put: tuple[Put, ...]
    unplaced: tuple[Unplaced, ...]


def furnish(stage: Stage, items: Iterable[Item], *, progress: Callable[[int], None] = lambda done: None) -> Furnished:
    """Puts items into the running world, one after the other; what finds no place is left out, with the reason.

    Args:
        stage: a world is spawned in it.
        items: what, and where to if that is told. Otherwise it is asked where such things are kept, and the most
            special answer with room for it is taken.
        progress: told after each thing how many have been looked after.
    """
    put, unplaced, done = list[Put](), list[Unplaced](), 0
    for item in items:
        for iri in item.names:
            result = _place(stage, item, iri)
            if isinstance(result, Put):
                put.append(result)
            else:
                unplaced.append(result)
            done += 1
            progress(done)
    return Furnished(tuple(put), tuple(unplaced))


def _place(stage: Stage, item: Item, iri: Iri | None) -> Put | Unplaced:
    id = None if iri is None else local_name(iri)
    if id is not None and id in stage.frame.ids:
        return Unplaced(id, "something of that id is there already")
    try:
        like = stage.thing(item.cls, id=id, size=item.size)
        body = msgspec.structs.replace(like, iri=iri or like.iri, label=item.label, facts=item.facts)
        wanted = list(_wanted(stage, item))
    except KnowledgeError as error:
        return Unplaced(id or local_name(item.cls), str(error))
    reasons = []
    for holder, inside in wanted:
        try:
            return stage.put(body, into=holder) if inside else stage.put(body, on=holder)
        except (SpotMissing, BodyUnknown) as error:
            reasons.append(str(error))
    name = local_name(item.cls)
    nowhere = f"nobody told where it goes (ms:putOn, ms:putInto), and nothing here is known to keep {name}"
    return Unplaced(body.id, "; ".join(reasons) or nowhere)


def _wanted(stage: Stage, item: Item) -> Iterator[tuple[BodyId, bool]]:
    """Where an item may go, the best first: the holder's id, and whether into it."""
    if item.holder is not None:
        holder = _id_of(stage, item.holder)
        yield from ((holder, inside) for inside in (True, False) if item.inside in (inside, None))
        return
    kept = stage.ask("storage_place_in_environment", item=item.cls)
    for row in kept:
        yield _id_of(stage, row.individual), True
    for row in kept:
        yield _id_of(stage, row.individual), False


def _id_of(stage: Stage, holder: str) -> BodyId:
    """The body that an IRI or a name stands for.

    Raises:
        NameUnknown: nothing has that name.
        NameAmbiguous: several things have it.
    """
    if holder in stage.frame.ids:
        return BodyId(holder)
    iri = stage.knowledge.names.find(holder, NameKind.INDIVIDUAL)
    bodies: Iterator[Body] = (body for world in stage.worlds for body in world.bodies if body.iri == iri)
    return next((body.id for body in bodies), BodyId(local_name(iri)))
