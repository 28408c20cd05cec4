"""Generated worlds are valid and varied, and the values of the model are immutable and serializable."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from itertools import pairwise

import msgspec
import pytest
from hypothesis import Phase, find, given, settings
from hypothesis import strategies as st
from tests.cases import each_case
from tests.kitchenette import MAP, kitchenette
from tests.worlds import worlds

from mindstage.errors import BodyNotFoundError
from mindstage.scene import AxisMotion, BlankNode, Body, IriRef, Literal, Mobility, Pose, PropertyAssertion, Tag, World
from mindstage.scene.transforms import pose_array

KITCHEN = kitchenette()
SEARCH = settings(max_examples=3000, database=None, derandomize=True, deadline=None, phases=[Phase.generate])


def parts(world: World) -> list:
    return [*world.bodies, *world.joints, *world.lights]


def all_facts(world: World) -> Iterator[tuple[str, tuple[PropertyAssertion, ...]]]:
    """Yields all facts by owner, including those of blank nodes."""
    waiting = [(owner.iri, owner.facts) for owner in (world, *parts(world), *world.resources)]
    while waiting:
        owner, facts = waiting.pop()
        yield owner, facts
        waiting.extend(("", fact.value.facts) for fact in facts if isinstance(fact.value, BlankNode))


def strings_in(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, list):
        for part in value:
            yield from strings_in(part)
    elif isinstance(value, dict):
        for part in value.values():
            yield from strings_in(part)


# -- invariants --------------------------------------------------------------------------------------------------------


def ids_are_unique(world: World) -> bool:
    return len({part.id for part in parts(world)}) == len(parts(world))


def iris_are_those_of_the_map(world: World) -> bool:
    return world.iri == MAP + world.name and all(part.iri == MAP + part.id for part in parts(world))


def joints_connect_two_bodies(world: World) -> bool:
    ids = {body.id for body in world.bodies}
    return all(c.parent != c.child and {c.parent, c.child} <= ids for c in world.joints)


def attachments_are_a_forest(world: World) -> bool:
    parents = {attachment.child: attachment.parent for attachment in world.attachments}
    if len(parents) < len(world.attachments) or not {*parents, *parents.values()} <= {b.id for b in world.bodies}:
        return False
    for start in parents:
        here, steps = start, 0
        while (here := parents.get(here)) is not None:
            steps += 1
            if steps > len(parents):
                return False
    return True


def numbers_are_within_bounds(world: World) -> bool:
    poses = pose_array(part.pose for part in parts(world))
    norms = (poses[:, 3:] ** 2).sum(axis=1) ** 0.5
    sizes = [extent for body in world.bodies for extent in body.size or ()]
    return bool(
        (abs(poses[:, :3]) <= 1000.0).all()
        and (abs(norms - 1.0) < 2e-6).all()
        and all(1e-3 <= extent <= 20.0 for extent in sizes)
        and all((body.physics.mass_kg or 0.0) >= 0.0 for body in world.bodies)
    )


def strings_are_valid_in_xml(world: World) -> bool:
    return not any(
        ord(letter) < 32 or 127 <= ord(letter) < 160 or 0xD800 <= ord(letter) < 0xE000 or letter in "\ufffe\uffff"
        for text in strings_in(msgspec.to_builtins(world))
        for letter in text
    )


def tags_fit_into_tags_data(world: World) -> bool:
    return all(
        tag.type and tag.key and not set(";,") & set(tag.type + tag.key + tag.value)
        for part in parts(world)
        for tag in part.tags
    )


def no_statement_is_repeated(world: World) -> bool:
    statements = [(owner, fact) for owner, facts in all_facts(world) if owner for fact in facts]
    return len(set(statements)) == len(statements) and len({r.iri for r in world.resources}) == len(world.resources)


def every_resource_has_facts(world: World) -> bool:
    return all(resource.facts for resource in world.resources)


RULES: list[Callable[[World], bool]] = [
    ids_are_unique,
    iris_are_those_of_the_map,
    joints_connect_two_bodies,
    attachments_are_a_forest,
    numbers_are_within_bounds,
    strings_are_valid_in_xml,
    tags_fit_into_tags_data,
    no_statement_is_repeated,
    every_resource_has_facts,
]


@given(world=worlds())
def test_generated_worlds_are_valid(world: World) -> None:
    for rule in RULES:
        assert rule(world), rule.__name__


def test_the_kitchenette_is_valid() -> None:
    for rule in RULES:
        assert rule(KITCHEN), rule.__name__


@given(world=worlds(min_bodies=2, max_bodies=3, max_joints=1, max_lights=0))
def test_a_generated_world_has_the_requested_size(world: World) -> None:
    assert 2 <= len(world.bodies) <= 3
    assert len(world.joints) <= 1
    assert world.lights == ()


# -- variants ----------------------------------------------------------------------------------------------------------


def same_class_two_sizes(world: World) -> bool:
    sizes = Counter(cls for cls, _ in {(body.cls, body.size) for body in world.bodies if body.size})
    return max(sizes.values(), default=0) > 1


def any_value(world: World, wanted: Callable[[PropertyAssertion], object]) -> bool:
    return any(wanted(fact) for _, facts in all_facts(world) for fact in facts)


VARIANTS: dict[str, Callable[[World], object]] = {
    "an unknown mobility": lambda w: any(b.physics.mobility is None for b in w.bodies),
    "two mobilities": lambda w: len({b.physics.mobility for b in w.bodies}) > 1,
    **{
        f"a {each} body": lambda w, each=each: any(b.physics.mobility is each for b in w.bodies)
        for each in list(Mobility)[:3]
    },
    "a mass of zero": lambda w: any(b.physics.mass_kg == 0.0 for b in w.bodies),
    "no size": lambda w: any(b.size is None for b in w.bodies),
    "one class with two sizes": same_class_two_sizes,
    "six digits": lambda w: any(abs(sum(x * x for x in b.pose.quaternion) - 1.0) > 1e-7 for b in w.bodies),
    "a negative scalar": lambda w: any(b.pose.quaternion[0] < 0.0 for b in w.bodies),
    "all motions at once": lambda w: any(set(AxisMotion) == {c.linear.x, c.linear.y, c.linear.z} for c in w.joints),
    "a limit of zero": lambda w: any(c.linear.x is AxisMotion.LIMITED and not c.linear.limit for c in w.joints),
    "two joints between the same bodies": lambda w: any(
        {a.parent, a.child} == {b.parent, b.child} for a, b in pairwise(w.joints)
    ),
    "a chain of attachments": lambda w: {a.parent for a in w.attachments} & {a.child for a in w.attachments},
    "a light": lambda w: w.lights,
    "tags of two types": lambda w: any(len({tag.type for tag in b.tags}) > 1 for b in w.bodies),
    "unicode": lambda w: any(not tag.value.isascii() for b in w.bodies for tag in b.tags),
    "a blank node": lambda w: any_value(w, lambda f: isinstance(f.value, BlankNode) and f.value.facts),
    "a language": lambda w: any_value(w, lambda f: isinstance(f.value, Literal) and f.value.language),
    "a datatype": lambda w: any_value(w, lambda f: isinstance(f.value, Literal) and f.value.datatype),
    "a body that a fact mentions": lambda w: any_value(
        w, lambda f: isinstance(f.value, IriRef) and f.value.iri in {b.iri for b in w.bodies}
    ),
}


@each_case("wanted", VARIANTS.values(), ids=VARIANTS.keys())
def test_generated_worlds_cover(wanted: Callable[[World], object]) -> None:
    find(worlds(), wanted, settings=SEARCH)


def test_blank_nodes_and_arbitrary_tags_are_generated_on_request() -> None:
    find(worlds(labels=True), lambda w: any(r.iri.startswith("_:") for r in w.resources), settings=SEARCH)
    find(worlds(wild_tags=True), lambda w: not tags_fit_into_tags_data(w), settings=SEARCH)


# -- values ------------------------------------------------------------------------------------------------------------


@given(world=worlds(wild_tags=True, labels=True))
def test_a_world_survives_json_exactly(world: World) -> None:
    again = msgspec.json.decode(msgspec.json.encode(world), type=World)
    assert again == world
    assert hash(again) == hash(world)
    assert repr(again) == repr(world)


def test_an_unknown_field_is_rejected_with_its_path() -> None:
    text = msgspec.json.encode(KITCHEN).replace(b'"mass_kg"', b'"mass"', 1)
    with pytest.raises(msgspec.ValidationError, match=r"unknown field `mass` - at `\$.bodies\[.*\].physics`"):
        msgspec.json.decode(text, type=World)


def test_parts_of_a_world_are_frozen_with_keyword_only_fields() -> None:
    with pytest.raises(TypeError, match="positional"):
        Tag("SemLog", "Id", "x")  # type: ignore[misc]
    with pytest.raises(AttributeError, match="immutable"):
        KITCHEN.name = "another"  # type: ignore[misc]
    assert isinstance(KITCHEN.body("Mug"), Body)


def test_a_missing_body_raises_an_error_with_a_suggestion() -> None:
    with pytest.raises(BodyNotFoundError, match="no body 'Mugg' in 'map'; near: 'Mug'"):
        KITCHEN.body("Mugg")


@given(position=st.tuples(*(st.floats(),) * 3))
def test_a_pose_keeps_its_values_unchanged(position: tuple[float, float, float]) -> None:
    assert Pose(position).position is position
