"""The statements of `urn:mindstage:present`: the current state of each map in the map's own vocabulary.

A query about the map also works on this graph: it has everything that the map would have if it were saved now, such as
classes, sizes, attachments and poses. In addition it has

- what a body is on or in, as `where_is` measures it: `knowrob:on-Physical` and `knowrob:in-ContGeneric`, or, for a map
  in the vocabulary of KnowRob 2, `soma:isSupportedBy` and `soma:isInsideOf`;
- the positions of joints [m] or [rad], if an engine measures them: `?joint soma:hasJointState ?state` with
  `?state soma:hasJointPosition ?position ; ms:axis ?axis`, where the axis is x, y, z, twist, swing2 or swing1;
- where the state comes from: `<urn:mindstage:present> ms:source ?name`, the name of the engine, or "map".

A query about another time has the state of that time in this graph.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Protocol

import pyoxigraph as ox
from msgspec.structs import replace

from mindstage.knowledge.questions import QuestionContext, StateAccess, WorldState
from mindstage.maps.io.formats import MapFormat
from mindstage.maps.io.graph_diff import SourceMapView
from mindstage.maps.io.write import write_map
from mindstage.rdf.graphs import PRESENT_GRAPH
from mindstage.rdf.vocabulary import HAS_LOCALIZATION, TYPE, knowrob, ms, soma
from mindstage.scene import AxisMotion, Body, BodyId, Iri, Joint, World
from mindstage.scene.spatial import SpatialRelation

__all__ = ["present_statements"]

_ON, _INSIDE = SpatialRelation.ON, SpatialRelation.INSIDE
_KNOWROB_RELATIONS = {_ON: knowrob("on-Physical"), _INSIDE: knowrob("in-ContGeneric")}
_SOMA_RELATIONS = {_ON: soma("isSupportedBy"), _INSIDE: soma("isInsideOf")}
_SOURCE, _AXIS = ox.NamedNode(ms("source")), ox.NamedNode(ms("axis"))
_HAS_STATE, _HAS_POSITION = ox.NamedNode(soma("hasJointState")), ox.NamedNode(soma("hasJointPosition"))
_JOINT_STATE = ox.NamedNode(soma("JointState"))
_LINEAR_AXES, _ANGULAR_AXES = ("x", "y", "z"), ("twist", "swing2", "swing1")


class MapContext(QuestionContext, Protocol):
    """The part of `KnowledgeBase` that the state is written with."""

    def source_view(self, map: str | None = None) -> SourceMapView:
        """The statements of one map as its sources contain them."""


def present_statements(kb: MapContext, present: StateAccess) -> bytes:
    """The statements of the current state of all maps, in N-Quads.

    Raises:
        MapWriteError: the state has a value that a map cannot contain, such as an infinite mass.
        SimulationError: the engine does not give its state.
    """
    present.fetch()  # before taking the lock, since the engine may take a while
    with kb.lock:
        triples = [triple for state in present.states() for triple in _state_triples(kb, state)]
    distinct = dict.fromkeys(triples)
    quads = (ox.Quad(each.subject, each.predicate, each.object, PRESENT_GRAPH) for each in distinct)
    return ox.serialize(quads, format=ox.RdfFormat.N_QUADS) or b""


def _state_triples(kb: MapContext, state: WorldState) -> Iterator[ox.Triple]:
    yield ox.Triple(PRESENT_GRAPH, _SOURCE, ox.Literal(state.source))
    maps = set(kb.maps())
    terms: Mapping[SpatialRelation, Iri] = _KNOWROB_RELATIONS
    for world in _worlds_by_map(state, maps):
        view = kb.source_view(world.iri) if world.iri in maps else None
        text = write_map(world, format=MapFormat.TURTLE, source_view=view)
        triples = [quad.triple for quad in ox.parse(text, ox.RdfFormat.TURTLE, rename_blank_nodes=True)]
        if any(triple.predicate.value == HAS_LOCALIZATION for triple in triples):
            terms = _SOMA_RELATIONS
        yield from triples
    for pair in state.relations.related(relations=(_ON, _INSIDE)):
        predicate = ox.NamedNode(terms[pair.relation])
        yield ox.Triple(ox.NamedNode(pair.body.iri), predicate, ox.NamedNode(pair.other.iri))
    for joint in state.world.joints if state.joint_positions else ():
        yield from _joint_triples(joint, state.joint_positions or {})


def _worlds_by_map(state: WorldState, maps: set[Iri]) -> list[World]:
    """The current state of each map; bodies that were spawned without a map are added to the first one."""
    worlds = {world.iri: world for world in reversed(state.spawned) if world.iri in maps}
    home = next((world.iri for world in state.spawned if world.iri in maps), state.world.iri)
    worlds.setdefault(home, World(iri=home))
    map_of_body = {id: map if map in worlds else home for id, map in state.map_of_body.items()}
    map_of_light = {light.iri: world.iri for world in worlds.values() for light in world.lights}
    now = state.world
    parts: dict[Iri, dict[BodyId, Body]] = {iri: {} for iri in worlds}
    for body in now.bodies:
        parts[map_of_body[body.id]][body.id] = body
    return [
        replace(
            world,
            bodies=tuple(parts[iri].values()),
            joints=tuple(each for each in now.joints if {each.parent, each.child} <= parts[iri].keys()),
            attachments=tuple(each for each in now.attachments if {each.parent, each.child} <= parts[iri].keys()),
            lights=tuple(each for each in now.lights if map_of_light.get(each.iri, home) == iri),
        )
        for iri, world in worlds.items()
    ]


def _joint_triples(joint: Joint, positions: Mapping[BodyId, tuple[float, ...]]) -> Iterator[ox.Triple]:
    """One state for each axis that can move, with its displacement since the map's pose."""
    for axis, position in zip((*_LINEAR_AXES, *_ANGULAR_AXES), positions.get(joint.id, ()), strict=False):
        limits = joint.linear if axis in _LINEAR_AXES else joint.angular
        if getattr(limits, axis) is not AxisMotion.LOCKED:
            node = ox.BlankNode()
            yield ox.Triple(ox.NamedNode(joint.iri), _HAS_STATE, node)
            yield ox.Triple(node, ox.NamedNode(TYPE), _JOINT_STATE)
            yield ox.Triple(node, _HAS_POSITION, ox.Literal(float(position)))
            yield ox.Triple(node, _AXIS, ox.Literal(axis))
