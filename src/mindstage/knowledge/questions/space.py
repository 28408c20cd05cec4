"""Questions about where things are relative to one another, now."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from mindstage.knowledge.moment import MAP_SOURCE, StateAccess, WorldState
from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions.question import AnswerRow, IndividualName, MapName, MissingKnowledge, question
from mindstage.knowledge.vocabulary import HAS_POSE, knowrob
from mindstage.world import Iri
from mindstage.world.space import SpatialRelation, SpatialRelations

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = ["SpatialRelationRow", "source_text", "where_is"]

_RELATION_ORDER = {relation: at for at, relation in enumerate(SpatialRelation)}
_SIZE_PROPERTY = knowrob("depthOfObject")


class SpatialRelationRow(AnswerRow, frozen=True, kw_only=True):
    """How one thing stands to another."""

    thing: IndividualName
    relation: SpatialRelation
    other: IndividualName
    map: MapName
    """The map that the thing is described in."""
    gap: float
    """[m]: level for next_to, to the nearest side for inside, upright for the rest; negative where they overlap."""
    share: float
    """From 0 to 1: of the height for next_to, of the thing for inside, of the smaller footprint for the rest."""
    source: str
    """Who says so: the engine that runs the place, or "map" as it was told."""


@question
def where_is(
    kb: KnowledgeBase,
    thing: IndividualName | None = None,
    relation: SpatialRelation | None = None,
    other: IndividualName | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[SpatialRelationRow]:
    """Where a thing is relative to others: on, inside, above, below or next_to; the nearest of a kind first.

    It is measured, by the boxes around things and with down along -z. On: from 20 mm in it to 5 mm over it. Above and
    below: up to 3 m. Next to: no more than 0.25 m apart, at the same height. Inside: 80 % of it along each axis, the
    contents of fridges and drawers too; and the milk in the fridge is not next to the cup outside. What everything is
    in, such as walls, is left out, and what hangs on doors and drawers rests on nothing else.

    Asked of a running stage, things are where the engine has them; else where their maps tell.

    Examples:
        where_is milk_carton_1
        where_is _ on counter_left
        where_is plate_3 on
    """
    for moment in present.states(map):
        homes, ids = moment.map_of_body(), {body.iri: body.id for body in moment.world.bodies}
        if not {thing, other} <= {None, *ids}:
            continue
        found = SpatialRelations(moment.world).related(
            subjects=None if thing is None else (ids[thing],),
            others=None if other is None else (ids[other],),
            relations=tuple(SpatialRelation) if relation is None else (relation,),
        )
        for each in sorted(
            found, key=lambda each: (each.body.id, _RELATION_ORDER[each.relation], each.gap, each.other.id)
        ):
            yield SpatialRelationRow(
                thing=each.body.iri,
                relation=each.relation,
                other=each.other.iri,
                map=homes[each.body.id],
                gap=each.gap,
                share=each.overlap,
                source=moment.source,
            )


@where_is.explain
def _explain_relation(kb: KnowledgeBase, row: SpatialRelationRow) -> Iterator[str]:
    thing, other, gap, share = local_name(row.thing), local_name(row.other), f"{row.gap:g} m", f"{row.share:.0%}"
    match row.relation:
        case SpatialRelation.INSIDE:
            yield f"{share} of {thing} is in {other}, {gap} from its nearest side"
        case SpatialRelation.NEXT_TO:
            yield f"{gap} between {thing} and {other}, which share {share} of the smaller height"
        case SpatialRelation.BELOW:
            yield f"{gap} from the top of {thing} up to {other}, which share {share} of the smaller footprint"
        case _:
            yield f"{gap} from the top of {other} up to {thing}, which share {share} of the smaller footprint"
    yield source_text(row.source)


def source_text(source: str) -> str:
    """Who says how things are, in words."""
    return "as the map tells; no engine was asked" if source == MAP_SOURCE else f"as {source} has it now"


@where_is.missing
def _missing_relation(
    kb: KnowledgeBase,
    thing: Iri | None = None,
    relation: SpatialRelation | None = None,
    other: Iri | None = None,
    map: Iri | None = None,
    *,
    present: StateAccess,
) -> Iterator[MissingKnowledge]:
    moments = present.states(map)
    for each in (thing, other):
        cls = kb.reasoner.class_of(each) if each else None
        if each and cls:
            yield from _missing_pose(each, cls, moments)


def _missing_pose(individual: Iri, cls: Iri, world_states: tuple[WorldState, ...]) -> Iterator[MissingKnowledge]:
    bodies = [body for moment in world_states for body in moment.world.bodies if body.iri == individual]
    if not bodies:
        yield MissingKnowledge(
            cls, HAS_POSE, f"{local_name(individual)} is nowhere: no place that is looked at has a body of it"
        )
    elif all(body.size is None for body in bodies):
        yield MissingKnowledge(
            cls, _SIZE_PROPERTY, f"{local_name(individual)} has no size: neither it nor {local_name(cls)} tells one"
        )
