"""Hypothesis strategies for valid worlds.

`worlds()` generates what an engine must be able to simulate and a map must be able to represent: ids are unique and
valid in an IRI, references resolve, attachments form a forest, strings are valid in XML, and no statement is repeated.
It includes unusual but valid values: masses of 0, quaternions with six digits, overlapping bodies, one class with
several sizes, spaces at the ends of strings.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from math import pi

import msgspec
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy
from msgspec.structs import replace

from mindstage.scene import (
    AngularLimits,
    Attachment,
    AxisMotion,
    BlankNode,
    Body,
    BodyId,
    BodyPhysics,
    FactValue,
    Iri,
    IriRef,
    Joint,
    JointMimic,
    Light,
    LightType,
    LinearLimits,
    Literal,
    Material,
    Mobility,
    NamedResource,
    Pose,
    PrimitiveShape,
    PrimitiveType,
    PropertyAssertion,
    Quaternion,
    SoftLimit,
    Tag,
    Vector,
    World,
)
from mindstage.scene.blank_node_matching import StatementCanonicalizer
from tests.kitchenette import KNOWROB, MAP, RDFS, kitchenette

__all__ = [
    "blank_nodes",
    "bodies",
    "facts",
    "ids",
    "joints",
    "kitchenette",
    "lights",
    "masses",
    "materials",
    "physics",
    "poses",
    "quaternions",
    "sizes",
    "tags",
    "texts",
    "worlds",
]

A_BODY = BodyId("body")
BLANK_NODE_IDS = ("_:b0", "_:b1", "_:b2", "_:b3")
AXES = ("swing1", "swing2", "twist")
TERMS = "http://example.org/terms#"
XSD = "http://www.w3.org/2001/XMLSchema#"

CLASSES = tuple(
    Iri(KNOWROB + name) for name in ("Cup", "Drawer", "Cupboard", "Handle", "Refrigerator", "Table-PieceOfFurniture")
)

# -- numbers -----------------------------------------------------------------------------------------------------------


def numbers(low: float, high: float) -> SearchStrategy[float]:
    """Finite numbers, some rounded to six digits as in maps."""
    exact = st.floats(low, high, allow_subnormal=False)
    return exact | exact.map(lambda number: min(max(round(number, 6), low), high))


def vectors(low: float, high: float) -> SearchStrategy[Vector]:
    """Vectors of three numbers."""
    return st.tuples(numbers(low, high), numbers(low, high), numbers(low, high))


def sizes() -> SearchStrategy[Vector]:
    """Sizes from a millimeter to twenty meters."""
    return vectors(1e-3, 20.0)


def masses() -> SearchStrategy[float | None]:
    """Masses [kg], including None and 0, as in maps."""
    return st.sampled_from((None, 0.0)) | numbers(1e-3, 2000.0)


@st.composite
def quaternions(draw: st.DrawFn) -> Quaternion:
    """Rotations as in maps: exact, rounded to six digits, or negated."""
    w, x, y, z = draw(
        st.sampled_from(((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 1.0), (1.0, -1.0, 1.0, 1.0)))
        | st.tuples(*(st.floats(-1.0, 1.0, allow_subnormal=False),) * 4).filter(lambda q: max(map(abs, q)) > 0.1)
    )
    norm = (w * w + x * x + y * y + z * z) ** 0.5 * draw(st.sampled_from((1.0, -1.0)))
    w, x, y, z = w / norm, x / norm, y / norm, z / norm
    return (round(w, 6), round(x, 6), round(y, 6), round(z, 6)) if draw(st.booleans()) else (w, x, y, z)


def poses() -> SearchStrategy[Pose]:
    """Poses within a kilometer."""
    return st.builds(Pose, vectors(-1000.0, 1000.0), quaternions())


# -- strings -----------------------------------------------------------------------------------------------------------

LETTERS = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-"


def texts(*, without: str = "", min_size: int = 0) -> SearchStrategy[str]:
    """Strings that are valid in XML: no control characters, surrogates or noncharacters."""
    anything = st.characters(exclude_categories=("Cc", "Cs"), exclude_characters="\ufffe\uffff" + without)
    plain = st.characters(codec="ascii", exclude_categories=("Cc",), exclude_characters=without)
    return st.text(plain, min_size=min_size, max_size=8) | st.text(anything, min_size=min_size, max_size=8)


def ids() -> SearchStrategy[BodyId]:
    """Local names: mostly ASCII as in logged maps, some with other letters."""
    return st.text(st.sampled_from(LETTERS + "üñ名"), min_size=1, max_size=22).map(BodyId)


def tags(*, wild: bool = False) -> SearchStrategy[Tag]:
    """Tags that fit into `tagsData`, which cannot represent `;` and `,`; wild ones may contain anything."""
    word = texts() if wild else texts(without=";,", min_size=1)
    value = texts() if wild else texts(without=";,")
    kind = st.sampled_from(("SemLog", "Mindstage")) | word
    return st.builds(Tag, type=kind, key=st.sampled_from(("Id", "Class")) | word, value=value)


# -- facts -------------------------------------------------------------------------------------------------------------

PROPERTIES = tuple(
    Iri(name) for name in (TERMS + "near", TERMS + "notes", TERMS + "größe", KNOWROB + "contains", RDFS + "comment")
)
NAMED_RESOURCES = (
    Iri(KNOWROB + "Milk"),
    Iri(TERMS + "thing"),
    Iri("http://example.org/a/b?c=d&e=f"),
    Iri("urn:uuid:f81d4fae"),
)


def _numerals() -> SearchStrategy[Literal]:
    whole = st.sampled_from(("0", "007", "-12", "+3")) | st.integers(-(10**12), 10**12).map(str)
    real = st.sampled_from(("0.0", "-0.0", "1.0E0", "177.512833", "1e-7", "NaN", "INF")) | st.floats(
        allow_nan=False, allow_infinity=False
    ).map(repr)
    return (
        whole.map(lambda text: Literal(text, Iri(XSD + "integer")))
        | st.builds(Literal, real, st.sampled_from((Iri(XSD + "float"), Iri(XSD + "double"))))
        | st.sampled_from(("0.10", "-3", "5.000000")).map(lambda text: Literal(text, Iri(XSD + "decimal")))
    )


def _literals() -> SearchStrategy[Literal]:
    others = (
        Literal("true", Iri(XSD + "boolean")),
        Literal("1", Iri(XSD + "boolean")),
        Literal("2019-03-14T09:26:53.500Z", Iri(XSD + "dateTime")),
        Literal("http://example.org/", Iri(XSD + "anyURI")),
        Literal("about 3", Iri(TERMS + "estimate")),
    )
    localized = st.builds(Literal, texts(), language=st.sampled_from(("en", "de", "pt-br")))
    return st.builds(Literal, texts()) | localized | _numerals() | st.sampled_from(others)


def blank_nodes(facts: Sequence[PropertyAssertion]) -> BlankNode:
    """Returns a blank node with sorted facts."""
    return BlankNode(tuple(sorted(facts, key=lambda fact: (fact.property, msgspec.json.encode(fact.value)))))


@cache
def facts(
    names: tuple[str, ...] = (), *, min_size: int = 0, max_size: int = 3, nested: int = 1
) -> SearchStrategy[tuple[PropertyAssertion, ...]]:
    """Distinct facts about one resource; `names` are IRIs that they may mention."""
    references = st.sampled_from((*map(Iri, names), *NAMED_RESOURCES)).map(IriRef)
    values: SearchStrategy[FactValue] = references | _literals()
    if nested:
        values = values | facts(names, max_size=2, nested=nested - 1).map(blank_nodes)
    one = st.builds(PropertyAssertion, st.sampled_from(PROPERTIES), values)
    canonicalizer = StatementCanonicalizer()
    return st.lists(
        one, min_size=min_size, max_size=max_size, unique_by=lambda fact: canonicalizer.canonical_id(fact, {})
    ).map(tuple)


# -- parts -------------------------------------------------------------------------------------------------------------


def materials() -> SearchStrategy[Material]:
    """Named materials."""
    color = st.none() | vectors(0.0, 1.0)
    return st.builds(Material, name=texts(min_size=1), path=st.just("") | texts(), color=color)


def physics() -> SearchStrategy[BodyPhysics]:
    """All mobilities, with values that a map may omit."""
    flag = st.sampled_from((None, False, True))
    mobility = st.sampled_from((None, *Mobility))
    return st.builds(BodyPhysics, mobility=mobility, gravity=flag, overlap_events=flag, mass_kg=masses())


def bodies(id: BodyId = A_BODY, *, wild_tags: bool = False) -> SearchStrategy[Body]:
    """Bodies with that id."""
    return _bodies(wild_tags, ()).map(lambda body: replace(body, id=id, iri=Iri(MAP + id)))


def joints(id: BodyId, parent: BodyId, child: BodyId, *, wild_tags: bool = False) -> SearchStrategy[Joint]:
    """Joints with any combination of free, limited and locked axes."""
    return _joint_lists(wild_tags, ()).map(
        lambda joint: replace(joint, id=id, iri=Iri(MAP + id), parent=parent, child=child)
    )


def lights(id: BodyId, *, wild_tags: bool = False) -> SearchStrategy[Light]:
    """Lights with that id."""
    return _lights(wild_tags, ()).map(lambda light: replace(light, id=id, iri=Iri(MAP + id)))


@cache
def _bodies(wild_tags: bool, labels: tuple[str, ...]) -> SearchStrategy[Body]:
    return st.builds(
        Body,
        id=st.just(A_BODY),
        iri=st.just(Iri(MAP + A_BODY)),
        cls=st.sampled_from(CLASSES),
        label=st.none() | texts(),
        pose=poses(),
        size=st.none() | sizes(),
        mesh=st.sampled_from((None, "Cup", "package://maps/Cup/Cup.dae")) | texts(min_size=1),
        shape=st.sampled_from((None, *(PrimitiveShape(type=kind) for kind in PrimitiveType))),
        physics=physics(),
        materials=st.lists(materials(), max_size=2).map(tuple),
        tags=st.lists(tags(wild=wild_tags), max_size=3).map(tuple),
        facts=facts(labels),
    )


@cache
def _joint_lists(wild_tags: bool, labels: tuple[str, ...]) -> SearchStrategy[Joint]:
    motion = st.sampled_from(tuple(AxisMotion))
    limit, angle_limit = (st.just(0.0) | numbers(0.0, high) for high in (10.0, pi))
    middle, angle_middle = (st.just(0.0) | numbers(-high, high) for high in (10.0, pi))
    suffixes = (("", motion), ("_limit", angle_limit), ("_middle", angle_middle))
    soft = st.just(SoftLimit()) | st.builds(
        SoftLimit, enabled=st.booleans(), stiffness=numbers(0.0, 1e4), damping=numbers(0.0, 1e4)
    )
    return st.builds(
        Joint,
        id=st.just(A_BODY),
        iri=st.just(Iri(MAP + A_BODY)),
        parent=st.just(A_BODY),
        child=st.just(A_BODY),
        pose=poses(),
        linear=st.builds(
            LinearLimits,
            **dict.fromkeys(("x", "y", "z"), motion),
            **dict.fromkeys(("x_middle", "y_middle", "z_middle"), middle),
            limit=limit,
            soft_limit=soft,
        ),
        angular=st.builds(
            AngularLimits,
            **{f"{axis}{suffix}": value for axis in AXES for suffix, value in suffixes},
            swing_soft_limit=soft,
            twist_soft_limit=soft,
        ),
        disable_collision=st.sampled_from((None, False, True)),
        tags=st.lists(tags(wild=wild_tags), max_size=2).map(tuple),
        facts=facts(labels, max_size=2),
    )


@cache
def _lights(wild_tags: bool, labels: tuple[str, ...]) -> SearchStrategy[Light]:
    return st.builds(
        Light,
        id=st.just(A_BODY),
        iri=st.just(Iri(MAP + A_BODY)),
        type=st.sampled_from(tuple(LightType)),
        pose=poses(),
        color=vectors(0.0, 1.0),
        intensity=numbers(0.0, 1e5),
        tags=st.lists(tags(wild=wild_tags), max_size=2).map(tuple),
        facts=facts(labels, max_size=2),
    )


# -- worlds ------------------------------------------------------------------------------------------------------------


@st.composite
def worlds(
    draw: st.DrawFn,
    *,
    min_bodies: int = 0,
    max_bodies: int = 5,
    max_joints: int = 3,
    max_lights: int = 1,
    wild_tags: bool = False,
    labels: bool = False,
) -> World:
    """Generates a valid world.

    Args:
        draw: passed by hypothesis.
        min_bodies: the smallest number of bodies.
        max_bodies: the largest number of bodies.
        max_joints: the largest number of joints, which need two bodies.
        max_lights: the largest number of lights.
        wild_tags: whether tags may contain what `tagsData` cannot represent.
        labels: whether facts may mention and describe blank nodes (`_:…`).
    """
    count = draw(st.integers(min_bodies, max_bodies))
    joints = draw(st.integers(0, max_joints)) if count > 1 else 0
    lamps = draw(st.integers(0, max_lights))
    everything = count + joints + lamps
    drawn = draw(st.lists(ids().filter("map".__ne__), min_size=everything, max_size=everything, unique=True))
    body_ids, joint_ids, light_ids = drawn[:count], drawn[count : count + joints], drawn[count + joints :]
    blank_ids = BLANK_NODE_IDS if labels else ()
    things = [draw(_bodies(wild_tags, blank_ids)) for _ in body_ids]
    return World(
        iri=Iri(MAP + "map"),
        name="map",
        bodies=tuple(
            replace(body, id=id, iri=Iri(MAP + id), facts=(*body.facts, *draw(_neighbors(body_ids))))
            for id, body in zip(body_ids, things, strict=True)
        ),
        joints=tuple(
            replace(draw(_joints(id, body_ids, _joint_lists(wild_tags, blank_ids))), mimic=draw(_mimics(id, joint_ids)))
            for id in joint_ids
        ),
        attachments=draw(_forests(body_ids)),
        lights=tuple(replace(draw(_lights(wild_tags, blank_ids)), id=id, iri=Iri(MAP + id)) for id in light_ids),
        facts=draw(facts(blank_ids)),
        resources=draw(_resources(blank_ids)),
    )


@st.composite
def _joints(draw: st.DrawFn, id: BodyId, body_ids: Sequence[BodyId], any_joint: SearchStrategy[Joint]) -> Joint:
    first = draw(st.integers(0, len(body_ids) - 1))
    second = (first + draw(st.integers(1, len(body_ids) - 1))) % len(body_ids)
    parent, child = body_ids[first], body_ids[second]
    return replace(draw(any_joint), id=id, iri=Iri(MAP + id), parent=parent, child=child)


def _mimics(id: BodyId, joint_ids: Sequence[BodyId]) -> SearchStrategy[JointMimic | None]:
    """A joint that follows another one, or none."""
    others = [other for other in joint_ids if other != id]
    if not others:
        return st.none()
    return st.none() | st.builds(
        JointMimic, joint=st.sampled_from(others), multiplier=numbers(-10.0, 10.0), offset=numbers(-1.0, 1.0)
    )


def _neighbors(body_ids: Sequence[BodyId]) -> SearchStrategy[tuple[PropertyAssertion, ...]]:
    """At most one fact that relates a body to a body."""
    facts = [(PropertyAssertion(Iri(TERMS + "beside"), IriRef(Iri(MAP + id))),) for id in body_ids]
    return st.sampled_from([(), *facts])


@st.composite
def _forests(draw: st.DrawFn, body_ids: Sequence[BodyId]) -> tuple[Attachment, ...]:
    """Attachments to an earlier body in a random order: no cycles, at most one parent each."""
    order = draw(st.permutations(body_ids))
    parents = [draw(st.sampled_from((None, *order[:index]))) for index in range(len(order))]
    return tuple(
        Attachment(parent=parent, child=child)
        for parent, child in zip(parents, order, strict=True)
        if parent is not None
    )


@st.composite
def _resources(draw: st.DrawFn, blank_ids: tuple[str, ...]) -> tuple[NamedResource, ...]:
    """Described classes, other resources and blank nodes."""
    iris = draw(st.lists(st.sampled_from((*CLASSES, *NAMED_RESOURCES, *map(Iri, blank_ids))), max_size=4, unique=True))
    return tuple(NamedResource(iri, draw(facts(blank_ids, min_size=1, max_size=2))) for iri in iris)
