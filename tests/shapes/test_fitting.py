"""Forms fit the place: fronts where things are pulled, shelves where things stand, holes where sinks are let in."""

from __future__ import annotations

from math import cos, pi, sin
from typing import NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.knowledge import KnowledgeBase
from mindstage.shapes import Side
from mindstage.shapes.fitting import forms_for
from mindstage.shapes.fitting.facing import Faces
from mindstage.shapes.fitting.setting import Setting
from mindstage.world import (
    BodyId,
    LinearMotion,
    Quaternion,
    Vector,
)
from mindstage.world.geometry import conjugate, rotate
from tests.shapes.fitting_scenes import (
    QUARTERS,
    box_of,
    fit,
    is_free,
    open_sides,
    panel_side,
    slide,
    thing,
    world,
)


@pytest.fixture(scope="module")
def household() -> KnowledgeBase:
    return KnowledgeBase()


# -- drawers -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("handle", "front"),
    [
        ((0.32, 0.0, 0.0), Side.FRONT),
        ((-0.32, 0.0, 0.0), Side.BACK),
        ((0.0, 0.27, 0.0), Side.LEFT),
        ((0.0, -0.27, 0.0), Side.RIGHT),
    ],
)
def test_a_drawer_s_front_is_where_its_handle_is(household: KnowledgeBase, handle: Vector, front: Side) -> None:
    size = (0.6, 0.5, 0.2)
    bodies = (
        thing("drawer", "Drawer", (0, 0, 0), size, loose=True),
        thing("handle", "Handle", handle, (0.04, 0.04, 0.02)),
    )
    fitted = forms_for(world(bodies, holds=[("drawer", "handle")]), household)
    form = fitted.forms[BodyId("drawer")]
    assert panel_side(form, size) is front
    assert form.why.endswith("its front is where its handle is")
    assert fitted.notes == ()


def test_a_drawer_that_may_only_come_out_one_way_has_its_front_there(household: KnowledgeBase) -> None:
    size = (0.5, 0.5, 0.2)
    bodies = (
        thing("cupboard", "Cupboard", (0, 0, 0), (0.6, 0.6, 0.3)),
        thing("drawer", "Drawer", (0, 0, 0), size, loose=True),
    )
    for middle, front in ((0.2, Side.FRONT), (-0.2, Side.BACK)):
        forms = forms_for(world(bodies, [slide("cupboard", "drawer", middle=middle)]), household).forms
        assert panel_side(forms[BodyId("drawer")], size) is front


def test_roles_of_a_constraint_may_be_either_way_round(household: KnowledgeBase) -> None:
    size = (0.5, 0.5, 0.2)
    bodies = (
        thing("cupboard", "Cupboard", (0, 0, 0), (0.6, 0.6, 0.3)),
        thing("drawer", "Drawer", (0, 0, 0), size, loose=True),
    )
    # The middle is that of the child, which here is the cupboard: seen from it the drawer goes the other way.
    joint = slide("drawer", "cupboard", middle=0.2)
    assert panel_side(forms_for(world(bodies, [joint]), household).forms[BodyId("drawer")], size) is Side.BACK


@pytest.mark.parametrize("turn", QUARTERS)
def test_a_drawer_alone_in_a_cupboard_looks_out_of_it_on_the_way_on_which_it_slides(
    household: KnowledgeBase, turn: Quaternion
) -> None:
    size = (0.5, 0.4, 0.2)
    out = rotate(np.array(turn), (0.08, 0.0, 0.0)).tolist()
    bodies = (
        thing("cupboard", "Cupboard", (0, 0, 0), (0.6, 0.6, 0.3), turn=turn),
        thing("drawer", "Drawer", (out[0], out[1], 0.0), size, loose=True, turn=turn),
    )
    forms = forms_for(world(bodies, [slide("cupboard", "drawer", turn=turn)]), household).forms
    assert panel_side(forms[BodyId("drawer")], size) is Side.FRONT
    assert open_sides(forms[BodyId("cupboard")], (0.6, 0.6, 0.3)) == {Side.FRONT}


def test_a_drawer_s_floor_lies_right_under_what_is_in_it(household: KnowledgeBase) -> None:
    spoon = thing("spoon", "Teaspoon", (0.0, 0.0, -0.05), (0.14, 0.03, 0.02), loose=True)
    form = fit(household, thing("drawer", "Drawer", (0, 0, 0), (0.5, 0.5, 0.2)), spoon).forms[BodyId("drawer")]
    (place,) = form.places
    assert place.inside
    assert place.centre[2] == pytest.approx(-0.06, abs=1e-9)


# -- cupboards and their like ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [Side.FRONT, Side.BACK, Side.LEFT, Side.RIGHT])
@pytest.mark.parametrize("turn", QUARTERS[:2])
def test_a_cupboard_is_open_where_its_door_is(household: KnowledgeBase, side: Side, turn: Quaternion) -> None:
    size = (0.6, 0.5, 0.8)
    at = [0.0, 0.0, 0.0]
    at[side.axis] = side.sign * (size[side.axis] / 2 + 0.012)
    extent = [0.58, 0.48, 0.78]
    extent[side.axis] = 0.02
    spot = rotate(np.array(turn), at).tolist()
    bodies = (
        thing("cupboard", "Cupboard", (0, 0, 0), size, turn=turn),
        thing("door", "Door", (spot[0], spot[1], spot[2]), (extent[0], extent[1], extent[2]), loose=True, turn=turn),
    )
    joint = replace(slide("cupboard", "door"), linear=LinearMotion())
    for joints in ([joint], []):  # told to be held by it, or just standing before it
        fitted = forms_for(world(bodies, joints), household)
        assert open_sides(fitted.forms[BodyId("cupboard")], size) == {side}
        assert fitted.notes == ()


def test_a_chest_is_open_at_the_top_where_its_lid_is(household: KnowledgeBase) -> None:
    bodies = (
        thing("freezer", "Refrigerator-Freezer", (0, 0, 0), (0.6, 0.9, 0.8)),
        thing("lid", "Door", (0, 0, 0.415), (0.58, 0.88, 0.03), loose=True),
    )
    joint = replace(slide("freezer", "lid"), linear=LinearMotion())
    forms = forms_for(world(bodies, [joint]), household).forms
    assert open_sides(forms[BodyId("freezer")], (0.6, 0.9, 0.8)) == {Side.TOP}


def test_shelves_are_where_things_stand(household: KnowledgeBase) -> None:
    milk = thing("milk", "CowsMilk", (0.0, 0.1, 0.2), (0.07, 0.07, 0.2), loose=True)
    cheese = thing("cheese", "Cheese", (0.0, -0.1, -0.3), (0.1, 0.1, 0.06), loose=True)
    on_top = thing("butter", "Butter", (0.0, -0.1, -0.25), (0.08, 0.08, 0.04), loose=True)  # it stands on the cheese
    fridge = thing("fridge", "Refrigerator", (0, 0, 0), (0.6, 0.6, 1.4))
    form = fit(household, fridge, milk, cheese, on_top).forms[BodyId("fridge")]
    inside = sorted(round(place.centre[2], 6) for place in form.places if place.inside)
    assert inside[1:] == [-0.33, 0.1]
    for each in (milk, cheese, on_top):
        assert is_free(form, each.pose.position)


def test_a_fridge_with_nothing_in_it_has_as_many_shelves_as_are_known(household: KnowledgeBase) -> None:
    form = fit(household, thing("fridge", "Refrigerator", (0, 0, 0), (0.6, 0.6, 1.4))).forms[BodyId("fridge")]
    assert sum(place.inside for place in form.places) == 1 + 3  # its floor and three


def test_walls_give_way_to_what_stands_close_to_them(household: KnowledgeBase) -> None:
    box = thing("box", "CardboardBox", (0.0, 0.148, 0.0), (0.2, 0.2, 0.2), loose=True)
    form = fit(household, thing("cupboard", "Cupboard", (0, 0, 0), (0.5, 0.5, 0.5)), box).forms[BodyId("cupboard")]
    for corner in ((-0.0999, 0.2479, -0.0999), (0.0999, 0.2479, 0.0999)):
        assert is_free(form, corner)


def test_a_lying_cupboard_has_its_shelves_level(household: KnowledgeBase) -> None:
    turned: Quaternion = (cos(pi / 4), sin(pi / 4), 0.0, 0.0)  # about x: its y looks up
    cupboard = thing("cupboard", "Cupboard", (0, 0, 0), (0.5, 0.8, 0.5), turn=turned)
    can = thing("can", "DrinkingCan", (0, 0, 0.06), (0.07, 0.07, 0.12), loose=True)
    form = fit(household, cupboard, can).forms[BodyId("cupboard")]
    places = [place for place in form.places if place.inside]
    assert {place.up for place in places} == {(0.0, 1.0, 0.0)}
    assert min(abs(place.centre[1]) for place in places) < 1e-9


# -- openings ----------------------------------------------------------------------------------------------------------


def test_a_counter_leaves_room_for_the_sink_in_it(household: KnowledgeBase) -> None:
    counter = thing("counter", "CounterTop", (0, 0, 0), (0.6, 2.0, 0.04))
    sink = thing("sink", "Sink", (0.0, 0.5, -0.08), (0.4, 0.5, 0.2))
    form = fit(household, counter, sink).forms[BodyId("counter")]
    assert is_free(form, (0.0, 0.5, 0.0), room=0.18)
    assert not is_free(form, (0.0, -0.5, 0.0))


def test_a_wall_leaves_its_windows_free(household: KnowledgeBase) -> None:
    wall = thing("wall", "WallOfAConstruction", (0, 0, 1.25), (0.1, 4.0, 2.5))
    window = thing("window", "Window", (0.0, 1.0, 1.4), (0.06, 1.2, 1.0))
    form = fit(household, wall, window).forms[BodyId("wall")]
    assert is_free(form, (0.0, 1.0, 0.15), room=0.45)
    assert not is_free(form, (0.0, -1.0, 0.15))


def test_the_box_round_the_walls_of_a_room_is_hollow_and_lets_out_what_cuts_through_it(
    household: KnowledgeBase,
) -> None:
    walls = thing("walls", "WallOfAConstruction", (0, 0, 1.25), (5.0, 4.0, 2.5))
    cupboard = thing("cupboard", "Cupboard", (2.4, 0.0, 0.5), (0.6, 0.6, 1.0))
    fitted = fit(household, walls, cupboard)
    form = fitted.forms[BodyId("walls")]
    assert form.kind == "shell"
    assert is_free(form, (0.0, 0.0, 0.0), room=1.5)
    assert is_free(form, (2.45, 0.0, -0.75), room=0.2)
    assert not is_free(form, (2.45, 1.5, 0.0))


# -- fronts of the rest ------------------------------------------------------------------------------------------------


class Placed(NamedTuple):
    """Something, and where the front of it must be, in the world."""

    cls: str
    at: Vector
    size: Vector
    looks: Vector


@pytest.mark.parametrize(
    "placed",
    [
        Placed("Chair-PieceOfFurniture", (1.0, 0.0, 0.45), (0.45, 0.45, 0.9), (-1, 0, 0)),
        Placed("Chair-PieceOfFurniture", (0.0, 1.0, 0.45), (0.45, 0.45, 0.9), (0, -1, 0)),
        Placed("Sofa-PieceOfFurniture", (0.0, -2.4, 0.4), (2.0, 0.9, 0.8), (0, 1, 0)),
        Placed("Refrigerator", (-2.6, -1.0, 0.9), (0.6, 0.6, 1.8), (1, 0, 0)),
        Placed("Poster", (-2.9, 0.3, 1.5), (0.01, 0.7, 0.5), (1, 0, 0)),
        Placed("Tap-PlumbingFixture", (-2.5, 1.0, 1.1), (0.2, 0.05, 0.2), (1, 0, 0)),
    ],
    ids=lambda placed: placed.cls,
)
@pytest.mark.parametrize("turn", QUARTERS[:2])
def test_furniture_looks_where_it_is_used_from(household: KnowledgeBase, placed: Placed, turn: Quaternion) -> None:
    away = conjugate(turn)
    x, y, _ = rotate(away, placed.size).tolist()
    bodies = (
        thing("it", placed.cls, placed.at, (abs(x), abs(y), placed.size[2]), turn=turn),
        thing("table", "Table-PieceOfFurniture", (0, 0, 0.375), (0.9, 0.9, 0.75)),
        thing("sink", "Sink", (-2.0, 1.0, 0.8), (0.5, 0.6, 0.2)),
        thing("west", "WallOfAConstruction", (-2.96, 0.0, 1.25), (0.1, 6.0, 2.5)),
        thing("south", "WallOfAConstruction", (0.0, -2.9, 1.25), (6.0, 0.1, 2.5)),
    )
    described = world(bodies)
    setting = Setting(described, {body.cls: household.shape_rule(body.cls) for body in bodies})
    around, _ = setting.around(np.ones(len(bodies), dtype=bool))
    facing = Faces(setting, around).of(0)
    assert rotate(np.array(turn), facing.front.vector) == pytest.approx(placed.looks)
    assert not facing.guessed


def test_a_handle_stands_out_from_what_it_is_on(household: KnowledgeBase) -> None:
    door = thing("door", "Door", (0, 0, 0), (0.02, 0.6, 0.8))
    for sign in (1, -1):
        handle = thing("handle", "Handle", (sign * 0.03, 0.2, 0.0), (0.04, 0.02, 0.3))
        for holds in ([("door", "handle")], []):
            form = forms_for(world([door, handle], holds=holds), household).forms[BodyId("handle")]
            bar = max((box_of(solid) for solid in form.solids), key=lambda box: float(box[1][2] - box[0][2]))
            assert np.sign((bar[0] + bar[1])[0]) == sign


def test_what_nothing_tells_is_guessed_and_told(household: KnowledgeBase) -> None:
    fitted = fit(
        household,
        thing("cupboard", "Cupboard", (0, 0, 0), (0.4, 0.8, 0.8)),
        thing("mat", "FloorMat", (3, 0, 0), (1, 1, 0.01)),
    )
    assert open_sides(fitted.forms[BodyId("cupboard")], (0.4, 0.8, 0.8)) == {Side.FRONT}
    (note,) = fitted.notes
    assert note.ids == ("cupboard",)
    assert "nothing tells where its front is" in note.text


def test_a_table_whose_legs_are_bodies_is_its_top_alone(household: KnowledgeBase) -> None:
    top = thing("table", "KitchenTable", (0, 0, 0.73), (0.8, 1.4, 0.04))
    leg = thing("leg", "TableLeg", (0.3, 0.6, 0.355), (0.06, 0.06, 0.71))
    forms = forms_for(world([top, leg], holds=[("table", "leg")]), household).forms
    assert (forms[BodyId("table")].kind, forms[BodyId("leg")].kind) == ("counter", "leg")
