"""Conventions of maps whose numbers contradict the default of their dialect, in every dialect."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.knowledge import KnowledgeBase
from mindstage.maps import LengthUnit, QuaternionOrder, UnitConventions, save_map
from mindstage.maps.dialects.units import guess_quaternion_order
from mindstage.scene import World, diff
from mindstage.scene.transforms import quat_rotate
from tests.maps.dialect_maps import knowrob1_map, soma_map
from tests.maps.small_maps import body_turtle, knowledge_base_from, room_map

YAWS = (0.0, 1.5707963, -1.5707963, 3.1415927)
Rotation = tuple[float, float, float, float]


def yaw_quaternion(angle: float) -> Rotation:
    """w x y z."""
    return cos(angle / 2), 0.0, 0.0, sin(angle / 2)


def in_order(quaternion: Sequence[float], order: QuaternionOrder) -> str:
    w, x, y, z = quaternion
    return " ".join(f"{part:.6f}" for part in ((x, y, z, w) if order is QuaternionOrder.XYZW else (w, x, y, z)))


def semlog(order: QuaternionOrder, number: int = 12, *more: str) -> str:
    """A shelf of the layers and dividers of a shop, whose poses are resources of their own."""
    things = [
        body_turtle(
            f"thing{n}",
            cls="k:ShelfLayer" if n % 3 else "k:ShelfSeparator",
            position=f"0.2 {0.3 * n:.3f} 1.0",
            quaternion=in_order(yaw_quaternion(YAWS[n % 2]), order),
        )
        for n in range(number)
    ]
    return room_map(*things, *more)


def soma(order: QuaternionOrder, number: int = 12) -> str:
    return soma_map(
        *(
            f""":thing{n} a owl:NamedIndividual, soma:Cup ; soma:hasLocalization [ soma:hasSpaceRegion [
            k:quaternion "{in_order(yaw_quaternion(YAWS[n % 2]), order)}" ; k:translation "0 {n} 1" ] ] ."""
            for n in range(number)
        )
    )


def knowrob1(order: QuaternionOrder, number: int = 12) -> str:
    return knowrob1_map(
        *(
            f""":thing{n} a k:Cup ; k:describedInMap :old . :see{n} a k:SemanticMapPerception ;
            k:objectActedOn :thing{n} ; k:eventOccursAt [ k:translation "0 {n} 1" ;
            k:quaternion "{in_order(yaw_quaternion(YAWS[n % 2]), order)}" ] ."""
            for n in range(number)
        )
    )


DIALECTS = [pytest.param(semlog, id="SemLog"), pytest.param(soma, id="SOMA"), pytest.param(knowrob1, id="KnowRob 1")]


def load(folder: Path, text: str, **conventions: object) -> KnowledgeBase:
    path = folder / "map.ttl"
    path.write_text(text, encoding="utf-8")
    knowledge = KnowledgeBase(bundled_ontology=False)
    knowledge.load(path, conventions=UnitConventions(**conventions))  # type: ignore[arg-type]
    return knowledge


def quaternion_assumption(knowledge: KnowledgeBase) -> tuple[str, str]:
    [found] = [each for each in knowledge.assumptions() if each.topic == "quaternion"]
    return found.value, found.evidence


def upright_count(world: World) -> int:
    return sum(float(quat_rotate(body.pose.quaternion, np.array([0, 0, 1.0]))[2]) > 0.999 for body in world.bodies)


@pytest.mark.parametrize("order", QuaternionOrder)
@pytest.mark.parametrize("dialect", DIALECTS)
def test_everything_stands_upright_in_either_order(dialect: object, order: QuaternionOrder, tmp_path: Path) -> None:
    knowledge = load(tmp_path, dialect(order))  # type: ignore[operator]
    world = knowledge.world()
    assert upright_count(world) == len(world.bodies) == 12
    turned = [abs(body.pose.quaternion[3]) for body in world.bodies]
    assert sorted(turned) == pytest.approx([0.0] * 6 + [0.7071] * 6, abs=1e-4)
    value, evidence = quaternion_assumption(knowledge)
    assert value == order.value
    assert f"as {order.value} 12 of 12 are upright and 6 are not rotated" in evidence


@pytest.mark.parametrize("dialect", DIALECTS)
def test_the_assumption_names_the_default_that_it_replaces(dialect: object, tmp_path: Path) -> None:
    default = QuaternionOrder.XYZW if dialect is soma else QuaternionOrder.WXYZ
    other = next(order for order in QuaternionOrder if order is not default)
    knowledge = load(tmp_path, dialect(other))  # type: ignore[operator]
    knowledge.world()
    assert quaternion_assumption(knowledge)[1].startswith(f"not {default.value}, the default of ")
    assert knowledge.findings() == ()


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_map_read_against_its_default_is_written_as_it_was(dialect: object, tmp_path: Path) -> None:
    order = QuaternionOrder.WXYZ if dialect is soma else QuaternionOrder.XYZW
    world = load(tmp_path, dialect(order)).world()  # type: ignore[operator]
    save_map(world, tmp_path / "out.ttl")
    again = knowledge_base_from(tmp_path / "out.ttl").world(world.iri)
    found = diff(world, again)
    assert (found.only_in_a, found.only_in_b, found.changed, found.lost) == ((), (), (), ())


@pytest.mark.parametrize("dialect", DIALECTS)
def test_the_choice_of_the_user_outweighs_the_evidence(dialect: object, tmp_path: Path) -> None:
    world = load(tmp_path, dialect(QuaternionOrder.XYZW), quaternion=QuaternionOrder.WXYZ).world()  # type: ignore[operator]
    assert upright_count(world) == 6


def test_a_declaration_in_the_map_outweighs_the_evidence_which_is_reported(tmp_path: Path) -> None:
    text = semlog(QuaternionOrder.XYZW, 12, ':room ms:quaternionOrder "wxyz" .')
    knowledge = load(tmp_path, text)
    assert upright_count(knowledge.world()) == 6
    assert "declared in the map" in quaternion_assumption(knowledge)[1]
    assert "its numbers indicate xyzw" in knowledge.findings()[0].problem


def test_a_few_things_do_not_outweigh_the_default_and_are_reported(tmp_path: Path) -> None:
    knowledge = load(tmp_path, semlog(QuaternionOrder.XYZW, 8))
    assert upright_count(knowledge.world()) == 4
    assert quaternion_assumption(knowledge)[0] == "wxyz"
    assert "--quaternion xyzw would change that" in knowledge.findings()[0].action


def test_things_that_lie_do_not_hide_the_order_of_those_that_stand(tmp_path: Path) -> None:
    lying = body_turtle("pan", position="5 5 1", quaternion=in_order((0.7071, 0.7071, 0, 0), QuaternionOrder.XYZW))
    world = load(tmp_path, semlog(QuaternionOrder.XYZW, 12, lying)).world()
    assert upright_count(world) == 12


def test_a_map_in_which_nothing_is_rotated_decides_too(tmp_path: Path) -> None:
    things = [body_turtle(f"cup{n}", position=f"{n} 0 0", quaternion="0.0 0.0 0.0 1.0") for n in range(12)]
    assert load(tmp_path, room_map(*things)).world().body("cup0").pose.quaternion == (1.0, 0.0, 0.0, 0.0)
    some = room_map(*things[:6])
    assert load(tmp_path, some).world().body("cup0").pose.quaternion == (0.0, 0.0, 0.0, 1.0)


angles = st.floats(-3.1, 3.1).filter(lambda angle: abs(angle) > 0.1)
tilted = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda row: sum(part**2 for part in row) > 0.1)


@given(
    yaws=st.lists(angles, min_size=20, max_size=60),
    others=st.lists(tilted, max_size=2),
    order=st.sampled_from(QuaternionOrder),
)
def test_turned_things_always_decide_and_a_few_tilted_ones_never_do(
    yaws: list[float], others: list[Rotation], order: QuaternionOrder
) -> None:
    rows = [*map(yaw_quaternion, yaws), *others]
    given_rows = [(x, y, z, w) if order is QuaternionOrder.XYZW else (w, x, y, z) for w, x, y, z in rows]
    guess = guess_quaternion_order(given_rows)
    assert guess.value is order
    assert guess.is_overwhelming


@given(rows=st.lists(tilted, max_size=40))
def test_things_that_stand_in_neither_order_never_replace_a_default(rows: list[Rotation]) -> None:
    assert not guess_quaternion_order(rows).is_overwhelming or len(rows) >= 5


# -- units -------------------------------------------------------------------------------------------------------------

CLASSES = {"Cup": (0.08, 0.08, 0.1), "Pan": (0.3, 0.3, 0.06), "Table": (0.8, 1.4, 0.75), "Cupboard": (0.6, 0.6, 2.0)}


@pytest.fixture
def ontology(tmp_path: Path) -> Path:
    """An ontology that gives the sizes of four classes."""
    names = ("depth", "width", "height")
    parts = [
        f"k:{cls} rdfs:subClassOf [ a owl:Restriction ; owl:onProperty k:{name}OfObject ; "
        f'owl:hasValue "{extent}"^^xsd:float ] .'
        for cls, size in CLASSES.items()
        for name, extent in zip(names, size, strict=True)
    ]
    path = tmp_path / "sizes.ttl"
    text = room_map(*parts).replace(":room a owl:NamedIndividual, k:SemanticEnvironmentMap .", "")
    path.write_text(text, encoding="utf-8")
    return path


def extents(cls: str, per_meter: float) -> list[str]:
    return [f"{1.1 * extent * per_meter:.4f}" for extent in CLASSES[cls]]


def sized_semlog(per_meter: float) -> str:
    def facts(cls: str) -> list[str]:
        names = ("depth", "width", "height")
        return [f'k:{name}OfObject "{n}"' for name, n in zip(names, extents(cls, per_meter), strict=True)]

    return room_map(*(body_turtle(cls.lower(), *facts(cls), cls=f"k:{cls}") for cls in CLASSES))


def sized_knowrob1(per_meter: float) -> str:
    def thing(cls: str) -> str:
        depth, width, height = extents(cls, per_meter)
        return f""":{cls.lower()} a k:{cls} ; k:describedInMap :old ; k:depthOfObject "{depth}" ;
            k:widthOfObject "{width}" ; k:heightOfObject "{height}" . :see{cls} a k:SemanticMapPerception ;
            k:objectActedOn :{cls.lower()} ; k:eventOccursAt [
                k:translation "100 200 300" ; k:quaternion "1 0 0 0" ] ."""

    return knowrob1_map(*map(thing, CLASSES))


def sized_soma(per_meter: float) -> str:
    def thing(cls: str) -> str:
        depth, width, height = extents(cls, per_meter)
        return f""":{cls.lower()} a owl:NamedIndividual, k:{cls} ; soma:hasShape [ dul:hasRegion [ a soma:BoxShape ;
            soma:hasDepth {depth} ; soma:hasWidth {width} ; soma:hasHeight {height} ] ] ; soma:hasLocalization [
            soma:hasSpaceRegion [ k:quaternion "0 0 0 1" ; k:translation "100 200 300" ] ] ."""

    return soma_map(*map(thing, CLASSES))


@pytest.mark.parametrize("unit", LengthUnit)
@pytest.mark.parametrize(
    "dialect",
    [
        pytest.param(sized_semlog, id="SemLog"),
        pytest.param(sized_soma, id="SOMA"),
        pytest.param(sized_knowrob1, id="KnowRob 1"),
    ],
)
def test_known_sizes_of_classes_decide_the_units(
    dialect: object, unit: LengthUnit, ontology: Path, tmp_path: Path
) -> None:
    path = tmp_path / "map.ttl"
    path.write_text(dialect(unit.per_meter), encoding="utf-8")  # type: ignore[operator]
    knowledge = knowledge_base_from(path, ontologies=(ontology,))
    world = next(world for world in map(knowledge.world, (None,)) if world.bodies)
    assert world.body("cupboard").size == pytest.approx((0.66, 0.66, 2.2))
    [units] = [each for each in knowledge.assumptions() if each.topic == "units"]
    assert units.value == unit.value
    if unit is not LengthUnit.METERS:
        assert "the sizes of 4 of 4 classes agree with those in ontologies" in units.evidence


def test_a_semlog_map_in_centimeters_has_the_axes_of_unreal(ontology: Path, tmp_path: Path) -> None:
    path = tmp_path / "map.ttl"
    path.write_text(sized_semlog(100.0), encoding="utf-8")
    world = knowledge_base_from(path, ontologies=(ontology,)).world()
    assert world.body("cup").pose.position == pytest.approx((0.01, -0.02, 0.03))
