"""Statements compared by what they say, and names that mean something only inside one world."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.kitchenette import MAP, kitchenette
from tests.worlds import LABELS, worlds

from mindstage.world import (
    Anonymous,
    Attachment,
    BodyId,
    Difference,
    Fact,
    FactValue,
    Iri,
    Literal,
    Reference,
    Resource,
    Statement,
    Tag,
    World,
    difference,
)

XSD = "http://www.w3.org/2001/XMLSchema#"
KITCHEN = kitchenette()


def fact(value: FactValue, property: str = "urn:p") -> Fact:
    return Fact(Iri(property), value)


def number(text: str, kind: str = "float") -> Literal:
    return Literal(text, Iri(XSD + kind))


def label(name: str) -> Reference:
    return Reference(Iri(f"_:{name}"))


def saying(*facts: Fact, **resources: Sequence[Fact]) -> World:
    """A world that says this of itself, and that of some labels."""
    return World(
        iri=Iri(MAP + "map"),
        facts=facts,
        resources=tuple(Resource(Iri(f"_:{name}"), tuple(said)) for name, said in resources.items()),
    )


def same(a: FactValue, b: FactValue) -> bool:
    return difference(saying(fact(a)), saying(fact(b))).identical()


# -- literals ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("0.0", "0"),
        ("0.0", "-0.00"),
        ("1.0E0", "1"),
        ("1e2", "100.0"),
        ("0.10", ".1"),
        ("5.", "+5"),
        ("-12.50", "-1250e-2"),
        (" 7 ", "007"),
        ("1" + "0" * 5000, "1e5000"),
    ],
)
@pytest.mark.parametrize("kind", ["float", "double", "decimal", "integer"])
def test_numbers_are_compared_by_value(a: str, b: str, kind: str) -> None:
    assert same(number(a, kind), number(b, kind))
    assert same(number(b, kind), number(a, kind))


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("0.1", "0.10000000000000001"),
        ("1", "-1"),
        ("1e400", "INF"),
        ("1e400", "1e401"),
        ("1e-400", "0"),
        ("1_000", "1000"),
        ("\u0661", "1"),
        ("1,5", "1.5"),
        ("", "0"),
        (".", "0"),
        ("e1", "0"),
        ("10", "1"),
        ("0.01", "0.1"),
    ],
)
def test_other_numbers_and_what_is_no_number_are_told_apart(a: str, b: str) -> None:
    assert not same(number(a), number(b))
    assert same(number(a), number(a))


@given(value=st.floats(allow_nan=False, allow_infinity=False), other=st.floats(allow_nan=False, allow_infinity=False))
def test_two_numbers_are_the_same_when_python_says_so(value: float, other: float) -> None:
    assert same(number(repr(value)), number(f"{value:.20e}")) == (float(f"{value:.20e}") == value and _short(value))
    assert same(number(repr(value)), number(repr(other))) == (value == other)


def _short(value: float) -> bool:
    """Whether 21 digits say exactly the same number as the shortest text that rounds to it."""
    from decimal import Decimal

    return Decimal(repr(value)) == Decimal(f"{value:.20e}")


def test_a_number_is_not_the_text_that_it_is_written_with() -> None:
    assert not same(number("1"), number("1", "integer"))
    assert not same(number("1"), Literal("1"))
    assert not same(Literal("1.0"), Literal("1"))
    assert not same(number("1", "boolean"), number("true", "boolean"))


def test_a_plain_text_may_say_that_it_is_a_string() -> None:
    assert same(Literal("a"), number("a", "string"))
    assert not same(Literal("1"), number("1.0", "string"))


def test_a_language_is_part_of_a_text_whatever_its_case() -> None:
    assert same(Literal("a", language="en-GB"), Literal("a", language="en-gb"))
    assert not same(Literal("a", language="en"), Literal("a", language="de"))
    assert not same(Literal("a", language="en"), Literal("a"))


def test_a_thing_is_not_its_name_as_a_text() -> None:
    assert not same(Literal("urn:a"), Reference(Iri("urn:a")))


# -- things without a name ---------------------------------------------------------------------------------------------


def test_a_thing_without_a_name_is_what_is_said_of_it_in_any_order() -> None:
    a, b = fact(number("1.0")), fact(Literal("x"), "urn:q")
    assert same(Anonymous((a, b)), Anonymous((b, fact(number("1")))))
    assert not same(Anonymous((a, b)), Anonymous((a,)))
    assert not same(Anonymous((a, a)), Anonymous((a,)))
    assert not same(Anonymous(), label("x"))


def nested(depth: int, end: str) -> FactValue:
    value: FactValue = Literal(end)
    for place in range(depth):
        value = Anonymous((fact(Literal(str(place)), "urn:first"), fact(value, "urn:rest")))
    return value


def test_a_list_of_thousands_is_no_difficulty() -> None:
    assert same(nested(5000, "end"), nested(5000, "end"))
    found = difference(saying(fact(nested(5000, "end"))), saying(fact(nested(5000, "END"))))
    assert found.lost_facts == found.gained_facts == 1
    assert len(found.to_json()) < 5000


# -- counting ----------------------------------------------------------------------------------------------------------


@given(world=worlds(min_bodies=1), data=st.data())
def test_removing_a_fact_loses_one(world: World, data: st.DataObject) -> None:
    extra = fact(Literal("only here"))
    body = data.draw(st.sampled_from(world.bodies))
    richer = replace(world, bodies=tuple(replace(b, facts=(*b.facts, extra)) if b is body else b for b in world.bodies))
    found = difference(richer, world)
    assert found.lost_facts == 1
    assert found.lost == (Statement(body.id, extra),)
    assert found.gained == ()
    assert not found.identical(1e9)
    assert difference(world, richer).gained == found.lost


@given(world=worlds(min_bodies=1, wild_tags=True), tag=st.builds(Tag, type=st.text(), key=st.text(), value=st.text()))
def test_removing_a_tag_loses_one(world: World, tag: Tag) -> None:
    first, *rest = world.bodies
    richer = replace(world, bodies=(replace(first, tags=(tag, *first.tags)), *rest))
    assert difference(richer, world).lost == (Statement(first.id, tag),)
    assert [change.field for change in difference(richer, world).changed] == ["tags"]


def test_what_is_said_twice_and_then_once_is_lost_once() -> None:
    once = fact(Literal("x"))
    found = difference(saying(once, once), saying(once))
    assert (found.lost_facts, found.gained_facts) == (1, 0)


def test_a_changed_fact_is_lost_and_gained() -> None:
    found = difference(saying(fact(number("1.5"))), saying(fact(number("1.25"))))
    assert (found.lost_facts, found.gained_facts) == (1, 1)
    (change,) = found.changed
    assert (change.a, change.b) == ((fact(number("1.5")),), (fact(number("1.25")),))


def test_what_is_said_of_one_resource_in_two_places_counts_together() -> None:
    a, b = fact(Literal("a")), fact(Literal("b"))
    apart = World(iri=Iri("urn:map"), resources=(Resource(Iri("urn:r"), (a,)), Resource(Iri("urn:r"), (b,))))
    together = World(iri=Iri("urn:map"), resources=(Resource(Iri("urn:r"), (b, a)),))
    assert difference(apart, together) == Difference()


@pytest.mark.parametrize(
    ("said", "line"),
    [
        (fact(Reference(Iri("urn:a"))), "<urn:p> <urn:a>"),
        (fact(label("x")), "<urn:p> _:x"),
        (fact(Literal('say "a"')), '<urn:p> "say \\"a\\""'),
        (fact(Literal("Tür", language="de")), '<urn:p> "Tür"@de'),
        (fact(number("1.0")), f'<urn:p> "1.0"^^<{XSD}float>'),
        (fact(Anonymous()), "<urn:p> []"),
        (
            fact(Anonymous((fact(Literal("a")), fact(Literal("b"), "urn:q")))),
            '<urn:p> [ <urn:p> "a" ; <urn:q> "b" ]',
        ),
        (Tag(type="SemLog", key="Id", value="x"), "SemLog;Id,x"),
    ],
    ids=str,
)
def test_a_statement_can_be_read(said: Fact | Tag, line: str) -> None:
    assert str(Statement("body", said)) == line


# -- names -------------------------------------------------------------------------------------------------------------


def renamed(world: World, name: Callable[[str], str]) -> World:
    """The same world with other names for things; what is a property or a class keeps its own."""

    def value(old: FactValue) -> FactValue:
        if isinstance(old, Reference):
            return Reference(Iri(name(old.iri)))
        return Anonymous(facts(old.facts)) if isinstance(old, Anonymous) else old

    def facts(old: tuple[Fact, ...]) -> tuple[Fact, ...]:
        return tuple(Fact(fact.property, value(fact.value)) for fact in old)

    def things(old: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(replace(thing, iri=Iri(name(thing.iri)), facts=facts(thing.facts)) for thing in old)

    return replace(
        world,
        iri=Iri(name(world.iri)),
        bodies=things(world.bodies),
        constraints=things(world.constraints),
        lights=things(world.lights),
        facts=facts(world.facts),
        resources=things(world.resources),
    )


@given(world=worlds(labels=True), order=st.permutations(LABELS), chance=st.randoms(use_true_random=False))
def test_labels_may_be_others_and_even_change_places(world: World, order: list[str], chance: random.Random) -> None:
    other = renamed(world, lambda name: dict(zip(LABELS, order, strict=True)).get(name, name))
    other = replace(other, resources=tuple(chance.sample(other.resources, len(other.resources))))
    assert difference(world, other) == Difference()
    assert difference(other, world) == Difference()


@given(world=worlds(labels=True), order=st.permutations(LABELS))
def test_under_other_labels_one_lost_fact_is_one_lost_fact(world: World, order: list[str]) -> None:
    richer = replace(world, facts=(*world.facts, fact(Literal("only here"))))
    other = renamed(world, lambda name: dict(zip(LABELS, order, strict=True)).get(name, name))
    assert difference(richer, other).lost_facts == 1


def test_two_labels_are_not_one() -> None:
    assert not difference(
        saying(fact(label("x")), fact(label("x"), "urn:q")), saying(fact(label("x")), fact(label("y"), "urn:q"))
    ).identical()


def test_a_label_is_what_is_said_of_it_and_not_its_text() -> None:
    red, blue = [fact(Literal("red"))], [fact(Literal("blue"))]
    a = saying(fact(label("x")), fact(label("y"), "urn:q"), x=red, y=blue)
    b = saying(fact(label("y")), fact(label("x"), "urn:q"), x=blue, y=red)
    crossed = saying(fact(label("x")), fact(label("y"), "urn:q"), x=blue, y=red)
    assert difference(a, b) == Difference()
    assert difference(a, crossed).lost_facts == 2


def test_a_label_that_lost_a_fact_is_still_found_at_its_place() -> None:
    a = saying(fact(label("x")), x=[fact(Literal("red")), fact(label("y"), "urn:next")], y=[fact(Literal("blue"))])
    b = saying(fact(label("1")), **{"1": [fact(label("2"), "urn:next")], "2": [fact(Literal("blue"))]})
    found = difference(a, b)
    assert [statement.id for statement in found.lost] == ["_:x"]
    assert found.gained == ()


def ring(*names: str) -> World:
    """Each knows its two neighbours, and nothing else tells them apart."""
    links = {name: (names[place - 1], names[(place + 1) % len(names)]) for place, name in enumerate(names)}
    return saying(**{name: [fact(label(other)) for other in links[name]] for name in sorted(links)})


def test_a_ring_of_labels_that_all_look_alike_is_the_ring_in_another_order() -> None:
    assert difference(ring("a", "b", "c", "d", "e", "f"), ring("c", "a", "f", "b", "d", "e")) == Difference()


def test_two_rings_are_not_one() -> None:
    two = replace(ring("a", "b", "c"), resources=(*ring("a", "b", "c").resources, *ring("d", "e", "f").resources))
    assert not difference(ring("a", "b", "c", "d", "e", "f"), two).identical()


def test_a_chain_of_thousands_of_labels_is_followed() -> None:
    def chain(name: Callable[[int], str]) -> World:
        return saying(
            fact(label(name(0))), **{name(place): [fact(label(name(place + 1)), "urn:next")] for place in range(3000)}
        )

    assert difference(chain(lambda place: f"a{place}"), chain(lambda place: f"b{3000 - place}")) == Difference()


def test_thousands_of_labels_that_nothing_tells_apart_are_the_same() -> None:
    a = saying(*(fact(label(f"a{place}")) for place in range(2000)))
    b = saying(*(fact(label(f"b{place}")) for place in range(2000)))
    assert difference(a, b) == Difference()
    assert difference(a, replace(b, facts=b.facts[1:])).lost_facts == 1


@given(world=worlds(labels=True))
def test_another_name_of_the_map_changes_only_the_name_of_the_map(world: World) -> None:
    # A logger makes a new name for the map each time, and every individual says in which map it is described.
    said = fact(Reference(world.iri), "urn:describedInMap")
    world = replace(world, bodies=tuple(replace(body, facts=(*body.facts, said)) for body in world.bodies))
    other = renamed(world, lambda name: MAP + "new" if name == world.iri else name)
    found = difference(world, other)
    assert [(change.id, change.field) for change in found.changed] == [(world.iri, "iri")]
    assert found.lost_facts == 0


def test_two_things_that_swapped_their_names_are_not_the_same() -> None:
    swap = {MAP + "Mug": MAP + "Fridge", MAP + "Fridge": MAP + "Mug"}
    world = replace(KITCHEN, facts=(fact(Reference(Iri(MAP + "Mug"))),))
    names_only = renamed(world, lambda name: swap.get(name, name))
    assert {(change.id, change.field) for change in difference(world, names_only).changed} == {
        ("Mug", "iri"),
        ("Fridge", "iri"),
    }
    meaning = replace(KITCHEN, facts=(fact(Reference(Iri(MAP + "Fridge"))),))
    assert difference(world, meaning).lost_facts == 1


def test_a_name_that_another_thing_took_over_stands_for_that_thing() -> None:
    # In b the map is called as the mug in a, and the fact is about the map.
    world = replace(KITCHEN, facts=(fact(Reference(Iri("urn:other"))),))
    other = replace(KITCHEN, iri=Iri("urn:other"), facts=(fact(Reference(Iri("urn:other"))),))
    assert difference(world, other).lost_facts == 1


def made_on_the_fly(prefix: str) -> World:
    """The kitchenette as if its ids had been made up by whoever read it."""
    ids = {
        thing.id: BodyId(f"{prefix}{place}")
        for place, thing in enumerate((*KITCHEN.bodies[::-1], *KITCHEN.constraints[::-1]))
    }

    def thing(old: Any, **more: Any) -> Any:
        return replace(old, id=ids[old.id], iri=Iri(f"_:{ids[old.id]}"), **more)

    return replace(
        KITCHEN,
        bodies=tuple(thing(body) for body in KITCHEN.bodies),
        constraints=tuple(thing(c, parent=ids[c.parent], child=ids[c.child]) for c in KITCHEN.constraints),
        attachments=tuple(Attachment(parent=ids[a.parent], child=ids[a.child]) for a in KITCHEN.attachments),
        facts=(fact(Reference(Iri(f"_:{ids[BodyId('Mug')]}"))),),
    )


def test_ids_made_on_the_fly_may_differ() -> None:
    assert difference(made_on_the_fly("a"), made_on_the_fly("b")) == Difference()


def test_what_ids_made_on_the_fly_connect_may_not_differ() -> None:
    a, b = made_on_the_fly("a"), made_on_the_fly("b")
    handle, other = b.attachments
    found = difference(a, replace(b, attachments=(replace(handle, parent=other.parent), other)))
    assert [change.field for change in found.changed] == ["attachment.parent"]
    hinge, slide = b.constraints
    found = difference(a, replace(b, constraints=(hinge, replace(slide, child=hinge.child))))
    assert len(found.only_in_a) == len(found.only_in_b) == 1
    found = difference(a, replace(b, facts=(fact(Reference(b.bodies[0].iri)),)))
    assert found.lost_facts == 1


def test_a_name_that_became_a_label_is_lost() -> None:
    nameless = replace(
        KITCHEN,
        bodies=tuple(replace(b, iri=Iri("_:b")) if b.id == "Mug" else b for b in KITCHEN.bodies),
    )
    for found in (difference(KITCHEN, nameless), difference(nameless, KITCHEN)):
        assert [(change.id, change.field) for change in found.changed] == [("Mug", "iri")]
