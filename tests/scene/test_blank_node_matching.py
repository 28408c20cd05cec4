"""Names that mean something only inside one world: they may differ, what they stand for may not."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.kitchenette import KNOWROB, MAP, RDFS, kitchenette
from tests.worlds import BLANK_NODE_IDS, worlds

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


def saying(*facts: PropertyAssertion, **resources: Sequence[PropertyAssertion]) -> World:
    """A world that says this of itself, and that of some labels."""
    return World(
        iri=Iri(MAP + "map"),
        facts=facts,
        resources=tuple(NamedResource(Iri(f"_:{name}"), tuple(said)) for name, said in resources.items()),
    )


def renamed(world: World, name: Callable[[str], str]) -> World:
    """The same world with other names for things; what is a property or a class keeps its own."""

    def value(old: FactValue) -> FactValue:
        if isinstance(old, IriRef):
            return IriRef(Iri(name(old.iri)))
        return BlankNode(facts(old.facts)) if isinstance(old, BlankNode) else old

    def facts(old: tuple[PropertyAssertion, ...]) -> tuple[PropertyAssertion, ...]:
        return tuple(PropertyAssertion(fact.property, value(fact.value)) for fact in old)

    def things(old: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(replace(thing, iri=Iri(name(thing.iri)), facts=facts(thing.facts)) for thing in old)

    return replace(
        world,
        iri=Iri(name(world.iri)),
        bodies=things(world.bodies),
        joints=things(world.joints),
        lights=things(world.lights),
        facts=facts(world.facts),
        resources=things(world.resources),
    )


@given(world=worlds(labels=True), order=st.permutations(BLANK_NODE_IDS), chance=st.randoms(use_true_random=False))
def test_blank_node_labels_may_differ_and_be_swapped(world: World, order: list[str], chance: random.Random) -> None:
    other = renamed(world, lambda name: dict(zip(BLANK_NODE_IDS, order, strict=True)).get(name, name))
    other = replace(other, resources=tuple(chance.sample(other.resources, len(other.resources))))
    assert diff(world, other) == WorldDiff()
    assert diff(other, world) == WorldDiff()


@given(world=worlds(labels=True), order=st.permutations(BLANK_NODE_IDS))
def test_with_other_labels_one_lost_fact_is_one_lost_fact(world: World, order: list[str]) -> None:
    richer = replace(world, facts=(*world.facts, fact(Literal("only here"))))
    other = renamed(world, lambda name: dict(zip(BLANK_NODE_IDS, order, strict=True)).get(name, name))
    assert diff(richer, other).lost_facts == 1


def test_two_blank_nodes_differ_from_one() -> None:
    assert not diff(
        saying(fact(label("x")), fact(label("x"), "urn:q")), saying(fact(label("x")), fact(label("y"), "urn:q"))
    ).identical()


def test_blank_nodes_are_matched_by_their_facts_not_by_their_label() -> None:
    red, blue = [fact(Literal("red"))], [fact(Literal("blue"))]
    a = saying(fact(label("x")), fact(label("y"), "urn:q"), x=red, y=blue)
    b = saying(fact(label("y")), fact(label("x"), "urn:q"), x=blue, y=red)
    crossed = saying(fact(label("x")), fact(label("y"), "urn:q"), x=blue, y=red)
    assert diff(a, b) == WorldDiff()
    assert diff(a, crossed).lost_facts == 2


def test_a_blank_node_that_lost_a_fact_is_matched_by_its_mention_site() -> None:
    a = saying(fact(label("x")), x=[fact(Literal("red")), fact(label("y"), "urn:next")], y=[fact(Literal("blue"))])
    b = saying(fact(label("1")), **{"1": [fact(label("2"), "urn:next")], "2": [fact(Literal("blue"))]})
    found = diff(a, b)
    assert [statement.id for statement in found.lost] == ["_:x"]
    assert found.gained == ()


def ring(*names: str) -> World:
    """Each knows its two neighbors, and nothing else tells them apart."""
    links = {name: (names[place - 1], names[(place + 1) % len(names)]) for place, name in enumerate(names)}
    return saying(**{name: [fact(label(other)) for other in links[name]] for name in sorted(links)})


def test_a_ring_of_symmetric_blank_nodes_equals_a_permuted_ring() -> None:
    assert diff(ring("a", "b", "c", "d", "e", "f"), ring("c", "a", "f", "b", "d", "e")) == WorldDiff()


def test_two_rings_differ_from_one() -> None:
    two = replace(ring("a", "b", "c"), resources=(*ring("a", "b", "c").resources, *ring("d", "e", "f").resources))
    assert not diff(ring("a", "b", "c", "d", "e", "f"), two).identical()


def test_a_chain_of_thousands_of_blank_nodes_is_matched() -> None:
    def chain(name: Callable[[int], str]) -> World:
        return saying(
            fact(label(name(0))), **{name(place): [fact(label(name(place + 1)), "urn:next")] for place in range(3000)}
        )

    assert diff(chain(lambda place: f"a{place}"), chain(lambda place: f"b{3000 - place}")) == WorldDiff()


def test_thousands_of_indistinguishable_blank_nodes_are_matched() -> None:
    a = saying(*(fact(label(f"a{place}")) for place in range(2000)))
    b = saying(*(fact(label(f"b{place}")) for place in range(2000)))
    assert diff(a, b) == WorldDiff()
    assert diff(a, replace(b, facts=b.facts[1:])).lost_facts == 1


@given(world=worlds(labels=True))
def test_renaming_the_map_changes_only_the_name_of_the_map(world: World) -> None:
    # A logger makes a new name for the map each time, and every individual says in which map it is described.
    said = fact(IriRef(world.iri), "urn:describedInMap")
    world = replace(world, bodies=tuple(replace(body, facts=(*body.facts, said)) for body in world.bodies))
    other = renamed(world, lambda name: MAP + "new" if name == world.iri else name)
    found = diff(world, other)
    assert [(change.id, change.field) for change in found.changed] == [(world.iri, "iri")]
    assert found.lost_facts == 0


def with_pose_named(name: str, *more: PropertyAssertion, **resources: Sequence[PropertyAssertion]) -> World:
    """The mug of a kitchen that gives its pose a name, as maps do."""
    said = (fact(IriRef(Iri(name)), KNOWROB + "pose"), *more)
    return replace(
        KITCHEN,
        bodies=tuple(replace(body, facts=said) if body.id == "Mug" else body for body in KITCHEN.bodies),
        resources=tuple(NamedResource(Iri(MAP + iri), tuple(facts)) for iri, facts in resources.items()),
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
    # In b the map is called as the mug in a, and the fact is about the map.
    world = replace(KITCHEN, facts=(fact(IriRef(Iri("urn:other"))),))
    other = replace(KITCHEN, iri=Iri("urn:other"), facts=(fact(IriRef(Iri("urn:other"))),))
    assert diff(world, other).lost_facts == 1


def made_on_the_fly(prefix: str) -> World:
    """The kitchenette as if its ids had been made up by whoever read it."""
    ids = {
        thing.id: BodyId(f"{prefix}{place}")
        for place, thing in enumerate((*KITCHEN.bodies[::-1], *KITCHEN.joints[::-1]))
    }

    def thing(old: Any, **more: Any) -> Any:
        return replace(old, id=ids[old.id], iri=Iri(f"_:{ids[old.id]}"), **more)

    return replace(
        KITCHEN,
        bodies=tuple(thing(body) for body in KITCHEN.bodies),
        joints=tuple(thing(c, parent=ids[c.parent], child=ids[c.child]) for c in KITCHEN.joints),
        attachments=tuple(Attachment(parent=ids[a.parent], child=ids[a.child]) for a in KITCHEN.attachments),
        facts=(fact(IriRef(Iri(f"_:{ids[BodyId('Mug')]}"))),),
    )


def test_generated_ids_may_differ() -> None:
    assert diff(made_on_the_fly("a"), made_on_the_fly("b")) == WorldDiff()


def test_the_bodies_of_joints_with_generated_ids_are_compared() -> None:
    a, b = made_on_the_fly("a"), made_on_the_fly("b")
    handle, other = b.attachments
    found = diff(a, replace(b, attachments=(replace(handle, parent=other.parent), other)))
    assert [change.field for change in found.changed] == ["attachment.parent"]
    hinge, slide = b.joints
    found = diff(a, replace(b, joints=(hinge, replace(slide, child=hinge.child))))
    assert len(found.only_in_a) == len(found.only_in_b) == 1
    found = diff(a, replace(b, facts=(fact(IriRef(b.bodies[0].iri)),)))
    assert found.lost_facts == 1


def test_a_resource_that_became_a_blank_node_is_lost() -> None:
    nameless = replace(
        KITCHEN,
        bodies=tuple(replace(b, iri=Iri("_:b")) if b.id == "Mug" else b for b in KITCHEN.bodies),
    )
    for found in (diff(KITCHEN, nameless), diff(nameless, KITCHEN)):
        assert [(change.id, change.field) for change in found.changed] == [("Mug", "iri")]
