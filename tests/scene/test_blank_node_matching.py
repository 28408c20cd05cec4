"""Blank nodes and renamed resources: labels may differ between worlds, what they stand for may not."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.kitchenette import KNOWROB, MAP, RDFS, kitchenette
from tests.worlds import BLANK_NODE_IDS, blank_nodes, worlds

from mindstage.scene import (
    Attachment,
    BlankNode,
    BodyId,
    FactValue,
    Iri,
    IriRef,
    Literal,
    NamedResource,
    PropertyAssertion,
    World,
    WorldDiff,
    diff,
)

KITCHEN = kitchenette()


def fact(value: FactValue, property: str = "urn:p") -> PropertyAssertion:
    return PropertyAssertion(Iri(property), value)


def label(name: str) -> IriRef:
    return IriRef(Iri(f"_:{name}"))


def world_with_facts(*facts: PropertyAssertion, **resources: Sequence[PropertyAssertion]) -> World:
    """Returns a world with these facts about itself, and with facts about blank nodes."""
    return World(
        iri=Iri(MAP + "map"),
        facts=facts,
        resources=tuple(NamedResource(Iri(f"_:{name}"), tuple(own)) for name, own in resources.items()),
    )


def renamed(world: World, name: Callable[[str], str]) -> World:
    """Returns the world with renamed individuals; properties and classes keep their names."""

    def value(old: FactValue) -> FactValue:
        if isinstance(old, IriRef):
            return IriRef(Iri(name(old.iri)))
        return BlankNode(facts(old.facts)) if isinstance(old, BlankNode) else old

    def facts(old: tuple[PropertyAssertion, ...]) -> tuple[PropertyAssertion, ...]:
        return tuple(PropertyAssertion(fact.property, value(fact.value)) for fact in old)

    def parts(old: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(replace(part, iri=Iri(name(part.iri)), facts=facts(part.facts)) for part in old)

    return replace(
        world,
        iri=Iri(name(world.iri)),
        bodies=parts(world.bodies),
        joints=parts(world.joints),
        lights=parts(world.lights),
        facts=facts(world.facts),
        resources=parts(world.resources),
    )


@given(world=worlds(labels=True), order=st.permutations(BLANK_NODE_IDS), rng=st.randoms(use_true_random=False))
def test_blank_node_labels_may_differ_and_be_swapped(world: World, order: list[str], rng: random.Random) -> None:
    other = renamed(world, lambda name: dict(zip(BLANK_NODE_IDS, order, strict=True)).get(name, name))
    other = replace(other, resources=tuple(rng.sample(other.resources, len(other.resources))))
    assert diff(world, other) == WorldDiff()
    assert diff(other, world) == WorldDiff()


@given(world=worlds(labels=True), order=st.permutations(BLANK_NODE_IDS))
def test_with_other_labels_one_lost_fact_is_one_lost_fact(world: World, order: list[str]) -> None:
    richer = replace(world, facts=(*world.facts, fact(Literal("only here"))))
    other = renamed(world, lambda name: dict(zip(BLANK_NODE_IDS, order, strict=True)).get(name, name))
    assert diff(richer, other).lost_facts == 1


def worlds_of_blank_nodes() -> st.SearchStrategy[World]:
    """Worlds of one or two statements that mention several labels each, and of some about these."""
    properties = st.sampled_from(("urn:p", "urn:q"))
    references = st.sampled_from(BLANK_NODE_IDS).map(Iri).map(IriRef)
    pairs = st.lists(st.builds(fact, references, properties), min_size=2, max_size=2).map(blank_nodes)
    own = st.lists(st.builds(fact, pairs), min_size=1, max_size=1)
    described = st.dictionaries(st.sampled_from(("b0", "b1")), own)
    return st.builds(lambda first, more: world_with_facts(first, **more), st.builds(fact, pairs), described)


@given(world=worlds_of_blank_nodes(), order=st.permutations(BLANK_NODE_IDS))
def test_labels_may_be_swapped_however_often_they_are_mentioned(world: World, order: list[str]) -> None:
    other = renamed(world, lambda name: dict(zip(BLANK_NODE_IDS, order, strict=True)).get(name, name))
    assert diff(world, other) == WorldDiff()


def test_labels_of_one_statement_are_distinguished_by_their_places_in_it() -> None:
    def described(first: str, second: str) -> World:
        return world_with_facts(fact(blank_nodes((fact(label(first), "urn:p"), fact(label(second), "urn:q")))))

    assert diff(described("x", "y"), described("y", "x")) == WorldDiff()


def test_two_blank_nodes_differ_from_one() -> None:
    assert not diff(
        world_with_facts(fact(label("x")), fact(label("x"), "urn:q")),
        world_with_facts(fact(label("x")), fact(label("y"), "urn:q")),
    ).identical()


def test_blank_nodes_are_matched_by_their_facts_not_by_their_label() -> None:
    red, blue = [fact(Literal("red"))], [fact(Literal("blue"))]
    a = world_with_facts(fact(label("x")), fact(label("y"), "urn:q"), x=red, y=blue)
    b = world_with_facts(fact(label("y")), fact(label("x"), "urn:q"), x=blue, y=red)
    crossed = world_with_facts(fact(label("x")), fact(label("y"), "urn:q"), x=blue, y=red)
    assert diff(a, b) == WorldDiff()
    assert diff(a, crossed).lost_facts == 2


def test_a_blank_node_that_lost_a_fact_is_matched_by_its_mention_site() -> None:
    a = world_with_facts(
        fact(label("x")), x=[fact(Literal("red")), fact(label("y"), "urn:next")], y=[fact(Literal("blue"))]
    )
    b = world_with_facts(fact(label("1")), **{"1": [fact(label("2"), "urn:next")], "2": [fact(Literal("blue"))]})
    found = diff(a, b)
    assert [statement.id for statement in found.lost] == ["_:x"]
    assert found.gained == ()


def ring(*names: str) -> World:
    """Returns a world with a ring of blank nodes, each with facts about its two neighbors only."""
    links = {name: (names[index - 1], names[(index + 1) % len(names)]) for index, name in enumerate(names)}
    return world_with_facts(**{name: [fact(label(other)) for other in links[name]] for name in sorted(links)})


def test_a_ring_of_symmetric_blank_nodes_equals_a_permuted_ring() -> None:
    assert diff(ring("a", "b", "c", "d", "e", "f"), ring("c", "a", "f", "b", "d", "e")) == WorldDiff()


def test_two_rings_differ_from_one() -> None:
    two = replace(ring("a", "b", "c"), resources=(*ring("a", "b", "c").resources, *ring("d", "e", "f").resources))
    assert not diff(ring("a", "b", "c", "d", "e", "f"), two).identical()


def test_a_chain_of_thousands_of_blank_nodes_is_matched() -> None:
    def chain(name: Callable[[int], str]) -> World:
        return world_with_facts(
            fact(label(name(0))), **{name(index): [fact(label(name(index + 1)), "urn:next")] for index in range(3000)}
        )

    assert diff(chain(lambda index: f"a{index}"), chain(lambda index: f"b{3000 - index}")) == WorldDiff()


def test_thousands_of_indistinguishable_blank_nodes_are_matched() -> None:
    a = world_with_facts(*(fact(label(f"a{index}")) for index in range(2000)))
    b = world_with_facts(*(fact(label(f"b{index}")) for index in range(2000)))
    assert diff(a, b) == WorldDiff()
    assert diff(a, replace(b, facts=b.facts[1:])).lost_facts == 1


@given(world=worlds(labels=True))
def test_renaming_the_map_changes_only_the_name_of_the_map(world: World) -> None:
    # Loggers create a new IRI for the map each time, and each individual has a fact that refers to it.
    described = fact(IriRef(world.iri), "urn:describedInMap")
    world = replace(world, bodies=tuple(replace(body, facts=(*body.facts, described)) for body in world.bodies))
    other = renamed(world, lambda name: MAP + "new" if name == world.iri else name)
    found = diff(world, other)
    assert [(change.id, change.field) for change in found.changed] == [(world.iri, "iri")]
    assert found.lost_facts == 0


def with_pose_named(name: str, *more: PropertyAssertion, **resources: Sequence[PropertyAssertion]) -> World:
    """Returns the kitchenette with a named pose of the mug, as in maps."""
    facts = (fact(IriRef(Iri(name)), KNOWROB + "pose"), *more)
    return replace(
        KITCHEN,
        bodies=tuple(replace(body, facts=facts) if body.id == "Mug" else body for body in KITCHEN.bodies),
        resources=tuple(NamedResource(Iri(MAP + iri), tuple(own)) for iri, own in resources.items()),
    )


def test_a_pose_may_have_another_name_but_must_have_one() -> None:
    a, b = with_pose_named(MAP + "p1"), with_pose_named(MAP + "p2")
    assert diff(a, b) == WorldDiff()
    assert diff(a, KITCHEN).lost_facts == 1


def test_facts_of_a_renamed_pose_are_compared() -> None:
    precise = [fact(Literal("measured"), RDFS + "comment")]
    a = with_pose_named(MAP + "p1", p1=precise)
    assert diff(a, with_pose_named(MAP + "p2", p2=precise)) == WorldDiff()
    assert diff(a, with_pose_named(MAP + "p2", p2=[fact(Literal("guessed"), RDFS + "comment")])).lost_facts == 1
    assert diff(a, with_pose_named(MAP + "p2", p1=precise)).lost_facts == 1


def test_a_renamed_pose_is_matched_wherever_it_is_mentioned() -> None:
    a = with_pose_named(MAP + "p1", fact(IriRef(Iri(MAP + "p1")), "urn:seenAt"))
    assert diff(a, with_pose_named(MAP + "p2", fact(IriRef(Iri(MAP + "p2")), "urn:seenAt"))) == WorldDiff()
    assert diff(a, with_pose_named(MAP + "p2", fact(IriRef(Iri(MAP + "p1")), "urn:seenAt"))).lost_facts == 1


def test_other_renamed_resources_are_different_resources() -> None:
    wooden, made_of_steel = (
        replace(KITCHEN, facts=(fact(IriRef(Iri(MAP + name)), "urn:madeOf"),)) for name in ("Wood", "Steel")
    )
    assert diff(wooden, made_of_steel).lost_facts == 1


def test_two_resources_with_swapped_names_differ() -> None:
    swap = {MAP + "Mug": MAP + "Fridge", MAP + "Fridge": MAP + "Mug"}
    world = replace(KITCHEN, facts=(fact(IriRef(Iri(MAP + "Mug"))),))
    names_only = renamed(world, lambda name: swap.get(name, name))
    assert {(change.id, change.field) for change in diff(world, names_only).changed} == {
        ("Mug", "iri"),
        ("Fridge", "iri"),
    }
    meaning = replace(KITCHEN, facts=(fact(IriRef(Iri(MAP + "Fridge"))),))
    assert diff(world, meaning).lost_facts == 1


def test_a_reused_name_refers_to_its_new_owner() -> None:
    # In b the map has the IRI that the fact mentions, so the fact is about the map.
    world = replace(KITCHEN, facts=(fact(IriRef(Iri("urn:other"))),))
    other = replace(KITCHEN, iri=Iri("urn:other"), facts=(fact(IriRef(Iri("urn:other"))),))
    assert diff(world, other).lost_facts == 1


def with_generated_ids(prefix: str) -> World:
    """Returns the kitchenette with ids that a reader generated, and blank nodes."""
    ids = {
        part.id: BodyId(f"{prefix}{index}") for index, part in enumerate((*KITCHEN.bodies[::-1], *KITCHEN.joints[::-1]))
    }

    def part(old: Any, **more: Any) -> Any:
        return replace(old, id=ids[old.id], iri=Iri(f"_:{ids[old.id]}"), **more)

    return replace(
        KITCHEN,
        bodies=tuple(part(body) for body in KITCHEN.bodies),
        joints=tuple(part(c, parent=ids[c.parent], child=ids[c.child]) for c in KITCHEN.joints),
        attachments=tuple(Attachment(parent=ids[a.parent], child=ids[a.child]) for a in KITCHEN.attachments),
        facts=(fact(IriRef(Iri(f"_:{ids[BodyId('Mug')]}"))),),
    )


def test_generated_ids_may_differ() -> None:
    assert diff(with_generated_ids("a"), with_generated_ids("b")) == WorldDiff()


def test_the_bodies_of_joints_with_generated_ids_are_compared() -> None:
    a, b = with_generated_ids("a"), with_generated_ids("b")
    handle, other = b.attachments
    found = diff(a, replace(b, attachments=(replace(handle, parent=other.parent), other)))
    assert [change.field for change in found.changed] == ["attachment.parent"]
    hinge, slide = b.joints
    found = diff(a, replace(b, joints=(hinge, replace(slide, child=hinge.child))))
    assert len(found.only_in_a) == len(found.only_in_b) == 1
    found = diff(a, replace(b, facts=(fact(IriRef(b.bodies[0].iri)),)))
    assert found.lost_facts == 1


def test_a_resource_that_became_a_blank_node_is_lost() -> None:
    anonymous = replace(
        KITCHEN,
        bodies=tuple(replace(b, iri=Iri("_:b")) if b.id == "Mug" else b for b in KITCHEN.bodies),
    )
    for found in (diff(KITCHEN, anonymous), diff(anonymous, KITCHEN)):
        assert [(change.id, change.field) for change in found.changed] == [("Mug", "iri")]
