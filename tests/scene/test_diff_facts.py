"""The comparison of statements: numbers, strings, blank nodes, and repetitions."""

from __future__ import annotations

from decimal import Decimal

from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.cases import each_case
from tests.kitchenette import kitchenette
from tests.worlds import worlds

from mindstage.scene import (
    BlankNode,
    FactValue,
    Iri,
    IriRef,
    Literal,
    NamedResource,
    PropertyAssertion,
    Statement,
    Tag,
    World,
    WorldDiff,
    diff,
)

XSD = "http://www.w3.org/2001/XMLSchema#"
KITCHEN = kitchenette()


def fact(value: FactValue, property: str = "urn:p") -> PropertyAssertion:
    return PropertyAssertion(Iri(property), value)


def number(text: str, kind: str = "float") -> Literal:
    return Literal(text, Iri(XSD + kind))


def world_with_facts(*facts: PropertyAssertion) -> World:
    """Returns a world with these facts about itself."""
    return World(iri=Iri("urn:map"), facts=facts)


def are_equal(a: FactValue, b: FactValue) -> bool:
    return diff(world_with_facts(fact(a)), world_with_facts(fact(b))).identical()


# -- literals ----------------------------------------------------------------------------------------------------------


@each_case(
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
@each_case("kind", ["float", "double", "decimal", "integer"])
def test_numbers_are_compared_by_value(a: str, b: str, kind: str) -> None:
    assert are_equal(number(a, kind), number(b, kind))
    assert are_equal(number(b, kind), number(a, kind))


@each_case(
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
def test_different_numbers_and_malformed_ones_are_different(a: str, b: str) -> None:
    assert not are_equal(number(a), number(b))
    assert are_equal(number(a), number(a))


@given(value=st.floats(allow_nan=False, allow_infinity=False), other=st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_are_equal_if_they_are_equal_in_python(value: float, other: float) -> None:
    assert are_equal(number(repr(value)), number(f"{value:.20e}")) == (
        float(f"{value:.20e}") == value and _is_exact(value)
    )
    assert are_equal(number(repr(value)), number(repr(other))) == (value == other)


def _is_exact(value: float) -> bool:
    """Returns whether 21 digits represent exactly the number of the shortest repr."""
    return Decimal(repr(value)) == Decimal(f"{value:.20e}")


def test_a_number_differs_from_a_string_with_the_same_text() -> None:
    assert not are_equal(number("1"), number("1", "integer"))
    assert not are_equal(number("1"), Literal("1"))
    assert not are_equal(Literal("1.0"), Literal("1"))
    assert not are_equal(number("1", "boolean"), number("true", "boolean"))


def test_a_plain_literal_equals_a_literal_of_type_string() -> None:
    assert are_equal(Literal("a"), number("a", "string"))
    assert not are_equal(Literal("1"), number("1.0", "string"))


def test_language_tags_are_compared_without_case() -> None:
    assert are_equal(Literal("a", language="en-GB"), Literal("a", language="en-gb"))
    assert not are_equal(Literal("a", language="en"), Literal("a", language="de"))
    assert not are_equal(Literal("a", language="en"), Literal("a"))


def test_an_iri_differs_from_a_literal_with_its_text() -> None:
    assert not are_equal(Literal("urn:a"), IriRef(Iri("urn:a")))


# -- blank nodes -------------------------------------------------------------------------------------------------------


def test_blank_nodes_are_equal_if_their_facts_are_in_any_order() -> None:
    a, b = fact(number("1.0")), fact(Literal("x"), "urn:q")
    assert are_equal(BlankNode((a, b)), BlankNode((b, fact(number("1")))))
    assert not are_equal(BlankNode((a, b)), BlankNode((a,)))
    assert not are_equal(BlankNode((a, a)), BlankNode((a,)))
    assert not are_equal(BlankNode(), IriRef(Iri("_:x")))


def nested(depth: int, end: str) -> FactValue:
    value: FactValue = Literal(end)
    for place in range(depth):
        value = BlankNode((fact(Literal(str(place)), "urn:first"), fact(value, "urn:rest")))
    return value


def test_a_nested_list_of_thousands_is_compared() -> None:
    assert are_equal(nested(5000, "end"), nested(5000, "end"))
    found = diff(world_with_facts(fact(nested(5000, "end"))), world_with_facts(fact(nested(5000, "END"))))
    assert found.lost_facts == found.gained_facts == 1
    assert len(found.to_json()) < 5000


# -- repetitions -------------------------------------------------------------------------------------------------------


@given(world=worlds(min_bodies=1), data=st.data())
def test_removing_a_fact_loses_one(world: World, data: st.DataObject) -> None:
    extra = fact(Literal("only here"))
    body = data.draw(st.sampled_from(world.bodies))
    richer = replace(world, bodies=tuple(replace(b, facts=(*b.facts, extra)) if b is body else b for b in world.bodies))
    found = diff(richer, world)
    assert found.lost_facts == 1
    assert found.lost == (Statement(body.id, extra),)
    assert found.gained == ()
    assert not found.identical(1e9)
    assert diff(world, richer).gained == found.lost


@given(world=worlds(min_bodies=1, wild_tags=True), tag=st.builds(Tag, type=st.text(), key=st.text(), value=st.text()))
def test_removing_a_tag_loses_one(world: World, tag: Tag) -> None:
    first, *rest = world.bodies
    richer = replace(world, bodies=(replace(first, tags=(tag, *first.tags)), *rest))
    assert diff(richer, world).lost == (Statement(first.id, tag),)
    assert [change.field for change in diff(richer, world).changed] == ["tags"]


def test_a_repeated_fact_that_loses_one_copy_is_lost_once() -> None:
    once = fact(Literal("x"))
    found = diff(world_with_facts(once, once), world_with_facts(once))
    assert (found.lost_facts, found.gained_facts) == (1, 0)


def test_a_changed_fact_is_lost_and_gained() -> None:
    found = diff(world_with_facts(fact(number("1.5"))), world_with_facts(fact(number("1.25"))))
    assert (found.lost_facts, found.gained_facts) == (1, 1)
    (change,) = found.changed
    assert (change.a, change.b) == ((fact(number("1.5")),), (fact(number("1.25")),))


def test_facts_of_one_resource_in_two_entries_are_merged() -> None:
    a, b = fact(Literal("a")), fact(Literal("b"))
    apart = World(iri=Iri("urn:map"), resources=(NamedResource(Iri("urn:r"), (a,)), NamedResource(Iri("urn:r"), (b,))))
    together = World(iri=Iri("urn:map"), resources=(NamedResource(Iri("urn:r"), (b, a)),))
    assert diff(apart, together) == WorldDiff()


@each_case(
    ("statement", "line"),
    [
        (fact(IriRef(Iri("urn:a"))), "<urn:p> <urn:a>"),
        (fact(IriRef(Iri("_:x"))), "<urn:p> _:x"),
        (fact(Literal('say "a"')), '<urn:p> "say \\"a\\""'),
        (fact(Literal("Tür", language="de")), '<urn:p> "Tür"@de'),
        (fact(number("1.0")), f'<urn:p> "1.0"^^<{XSD}float>'),
        (fact(BlankNode()), "<urn:p> []"),
        (
            fact(BlankNode((fact(Literal("a")), fact(Literal("b"), "urn:q")))),
            '<urn:p> [ <urn:p> "a" ; <urn:q> "b" ]',
        ),
        (Tag(type="SemLog", key="Id", value="x"), "SemLog;Id,x"),
    ],
    ids=str,
)
def test_a_statement_is_formatted_as_one_line(statement: PropertyAssertion | Tag, line: str) -> None:
    assert str(Statement("body", statement)) == line
