"""How bodies are drawn: what is open, what is seen through, what is round."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase
from mindstage.knowledge import bundled_kitchen
from mindstage.viewport.looks import ASSUMED_SIZE_M, Form, Look, decide_looks
from mindstage.world import (
    Attachment,
    Body,
    BodyId,
    Constraint,
    Iri,
    Mobility,
    Physics,
    Pose,
    Shape,
    ShapeKind,
    Vector,
    World,
)
from tests.kitchenette import KNOWROB, kitchenette

TURNED_LEFT = (np.cos(pi / 4), 0.0, 0.0, np.sin(pi / 4))


def body(
    id: str,
    cls: str,
    at: Vector,
    size: Vector | None,
    *,
    loose: bool = False,
    turned: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0),
    shape: ShapeKind | None = None,
) -> Body:
    return Body(
        id=BodyId(id),
        iri=Iri(f"http://x.org#{id}"),
        cls=Iri(KNOWROB + cls),
        pose=Pose(at, turned),
        size=size,
        shape=Shape(kind=shape) if shape else None,
        physics=Physics(mobility=Mobility.DYNAMIC if loose else Mobility.STATIC),
    )


def world(*bodies: Body, joints: tuple[tuple[str, str], ...] = (), holds: tuple[tuple[str, str], ...] = ()) -> World:
    return World(
        iri=Iri("http://x.org#map"),
        bodies=bodies,
        constraints=tuple(
            Constraint(
                id=BodyId(f"{a}-{b}"), iri=Iri(f"http://x.org#{a}-{b}"), parent=BodyId(a), child=BodyId(b), pose=Pose()
            )
            for a, b in joints
        ),
        attachments=tuple(Attachment(parent=BodyId(a), child=BodyId(b)) for a, b in holds),
    )


def looks_of(*bodies: Body, shells: tuple[str, ...] = (), **joined: tuple[tuple[str, str], ...]) -> dict[BodyId, Look]:
    return decide_looks(world(*bodies, **joined), lambda cls: (), shells=[BodyId(id) for id in shells])


def look_of(*bodies: Body, **joined: tuple[tuple[str, str], ...]) -> Look:
    return looks_of(*bodies, **joined)[bodies[0].id]


# -- the small kitchen -------------------------------------------------------------------------------------------------


@pytest.fixture
def kitchen() -> dict[BodyId, Look]:
    return decide_looks(kitchenette(), lambda cls: ())


def test_a_cupboard_is_open_where_its_drawer_comes_out(kitchen: dict[BodyId, Look]) -> None:
    assert kitchen[BodyId("Cupboard")].openings == ((0, -1),)


def test_a_fridge_is_open_behind_its_door(kitchen: dict[BodyId, Look]) -> None:
    assert kitchen[BodyId("Fridge")].openings == ((0, -1),)


def test_a_drawer_is_open_at_the_top_and_a_door_is_a_board(kitchen: dict[BodyId, Look]) -> None:
    assert kitchen[BodyId("Drawer")].openings == ((2, 1),)
    assert kitchen[BodyId("FridgeDoor")].form is Form.BOX


def test_a_cup_is_round_and_hollow(kitchen: dict[BodyId, Look]) -> None:
    assert kitchen[BodyId("Mug")].form is Form.VESSEL


def test_only_the_floor_is_the_building(kitchen: dict[BodyId, Look]) -> None:
    assert [id for id, look in kitchen.items() if look.building] == ["Floor"]
    assert [id for id, look in kitchen.items() if look.floor] == ["Floor"]


def test_upside_down_roles_of_a_joint_change_nothing(kitchen: dict[BodyId, Look]) -> None:
    upside_down = [replace(joint, parent=joint.child, child=joint.parent) for joint in kitchenette().constraints]
    assert decide_looks(replace(kitchenette(), constraints=tuple(upside_down)), lambda cls: ()) == kitchen


# -- rules -------------------------------------------------------------------------------------------------------------


def test_a_drawer_far_inside_still_opens_the_side_of_its_handle() -> None:
    cabinet = body("cabinet", "Cupboard", (0.0, 0.0, 0.45), (0.8, 1.2, 0.9))
    drawer = body("drawer", "Drawer", (-0.03, -0.3, 0.5), (0.55, 0.59, 0.2), loose=True)
    handle = body("handle", "Handle", (-0.34, -0.3, 0.5), (0.06, 0.5, 0.02), loose=True)
    look = look_of(cabinet, drawer, handle, joints=(("cabinet", "drawer"),), holds=(("drawer", "handle"),))
    assert look.openings == ((0, -1),)


def test_a_box_with_something_loose_in_it_is_open_at_the_top() -> None:
    chest = body("chest", "Chest", (0.0, 0.0, 0.3), (0.6, 0.4, 0.6))
    ball = body("ball", "Ball", (0.0, 0.0, 0.2), (0.1, 0.1, 0.1), loose=True)
    assert look_of(chest, ball).openings == ((2, 1),)
    assert look_of(chest).form is Form.BOX


def test_the_top_is_where_up_is_however_the_box_lies() -> None:
    lying = body("chest", "Chest", (0.0, 0.0, 0.3), (0.6, 0.4, 0.6), turned=(np.cos(pi / 4), 0.0, np.sin(pi / 4), 0.0))
    ball = body("ball", "Ball", (0.0, 0.0, 0.2), (0.1, 0.1, 0.1), loose=True)
    assert look_of(lying, ball).openings == ((0, -1),)


def test_what_stands_on_a_box_does_not_open_it() -> None:
    table = body("table", "Table", (0.0, 0.0, 0.35), (1.0, 1.0, 0.7))
    assert look_of(table, body("mug", "Mug", (0.0, 0.0, 0.75), (0.1, 0.1, 0.1), loose=True)).form is Form.BOX


def test_things_above_the_bottom_of_a_cupboard_stand_on_shelves() -> None:
    cupboard = body("cupboard", "Cupboard", (0.0, 0.0, 1.0), (0.4, 0.6, 1.0))
    door = body("door", "Door", (0.21, 0.0, 1.0), (0.02, 0.6, 1.0), loose=True)
    high = body("high", "Box", (0.0, 0.0, 1.3), (0.1, 0.1, 0.2), loose=True)
    low = body("low", "Box", (0.0, 0.2, 0.62), (0.1, 0.1, 0.2), loose=True)
    look = look_of(cupboard, door, high, low, joints=(("cupboard", "door"),))
    assert look.openings == ((0, 1),)
    assert look.levels == (0.2,)


def test_a_sink_is_let_into_the_worktop() -> None:
    worktop = body("worktop", "CounterTop", (0.0, 0.0, 0.88), (0.6, 2.0, 0.04), turned=TURNED_LEFT)
    sink = body("sink", "Sink", (0.3, 0.0, 0.8), (0.4, 0.5, 0.2), turned=TURNED_LEFT)
    (hole,) = look_of(worktop, sink).holes
    assert hole == pytest.approx((-0.2, 0.2, -0.55, -0.05), abs=1e-9)


def test_a_tray_that_stands_on_a_table_makes_no_hole() -> None:
    table = body("table", "Table", (0.0, 0.0, 0.7), (1.0, 1.0, 0.04))
    assert look_of(table, body("tray", "Tray", (0.0, 0.0, 0.74), (0.4, 0.3, 0.04))).holes == ()


@pytest.mark.parametrize(("at", "side"), [((-2.0, 0.0, 1.25), (0, 1)), ((2.0, 0.0, 1.25), (0, -1))])
def test_a_wall_is_drawn_from_the_side_of_the_room(at: Vector, side: tuple[int, int]) -> None:
    look = look_of(body("wall", "Wall", at, (0.1, 4.0, 2.5)), body("table", "Table", (0.0, 0.0, 0.4), (1.0, 1.0, 0.8)))
    assert (look.form, look.openings) == (Form.INSIDE, (side,))


def test_a_pillar_is_no_thin_wall() -> None:
    assert look_of(body("pillar", "Pillar", (0.0, 0.0, 1.0), (0.3, 0.3, 2.0))).form is Form.BOX


def test_a_lamp_up_there_is_drawn_from_below_only() -> None:
    things = [body(f"table{n}", "Table", (n, 0.0, 0.4), (0.5, 0.5, 0.8)) for n in range(9)]
    lamp = body("lamp", "CeilingLight", (0.0, 0.0, 2.5), (1.0, 0.2, 0.1))
    assert look_of(lamp, *things).openings == ((2, -1),)
    assert look_of(replace(lamp, pose=Pose((0.0, 0.0, 0.3))), *things).form is Form.BOX


def test_the_door_of_a_room_is_drawn_like_its_wall_and_that_of_a_cupboard_is_not() -> None:
    wall = body("wall", "Wall", (0.0, 0.0, 1.2), (0.1, 1.0, 2.4))
    door = body("door", "Door", (0.0, 1.0, 1.0), (0.04, 0.9, 2.0), loose=True)
    latch = body("latch", "Handle", (0.0, 1.4, 1.0), (0.1, 0.12, 0.02))
    table = body("table", "Table", (2.0, 0.0, 0.4), (1.0, 1.0, 0.8))
    looks = looks_of(wall, door, latch, table, joints=(("wall", "door"),), holds=(("door", "latch"),))
    look = looks[BodyId("door")]
    assert (look.form, look.openings, look.building) == (Form.INSIDE, ((0, 1),), True)
    assert (look_of(door).form, look_of(door).building) == (Form.BOX, False)
    assert looks[BodyId("latch")].form is Form.BOX, "by its handle it can be opened from outside, too"


def test_what_the_engine_calls_a_shell_is_an_outline() -> None:
    area = body("area", "Cupboard", (0.0, 0.0, 0.5), (2.0, 2.0, 1.0))
    assert looks_of(area, shells=("area",))[BodyId("area")].form is Form.OUTLINE


def test_what_is_as_large_as_a_room_is_an_outline_whatever_the_engine_says() -> None:
    assert look_of(body("cube", "Cube", (0.0, 0.0, 0.0), (13.0, 12.0, 5.5))).form is Form.OUTLINE
    assert look_of(body("floor", "Floor", (0.0, 0.0, 0.0), (13.0, 12.0, 0.2))).form is Form.BOX


@pytest.mark.parametrize(
    ("cls", "shape", "form"),
    [
        ("Bottle", None, Form.CYLINDER),
        ("Bottle", ShapeKind.BOX, Form.BOX),
        ("Apple", None, Form.BALL),
        ("Thing", ShapeKind.SPHERE, Form.BALL),
        ("Thing", ShapeKind.CYLINDER, Form.CYLINDER),
        ("Mug", ShapeKind.CYLINDER, Form.VESSEL),
        ("Thing", None, Form.BOX),
    ],
)
def test_a_shape_that_was_told_comes_before_what_the_class_suggests(
    cls: str, shape: ShapeKind | None, form: Form
) -> None:
    assert look_of(body("it", cls, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1), shape=shape)).form is form


def test_a_body_without_a_size_is_drawn_small() -> None:
    assert look_of(body("it", "Thing", (0.0, 0.0, 0.0), None)).size == ASSUMED_SIZE_M


def test_a_circle_of_attachments_and_an_end_that_is_not_there_do_no_harm() -> None:
    a, b = body("a", "Table", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), body("b", "Mug", (0.0, 0.0, 1.0), (0.1, 0.1, 0.1))
    looks = looks_of(a, b, joints=(("a", "gone"),), holds=(("a", "b"), ("b", "a"), ("gone", "a")))
    assert set(looks) == {"a", "b"}


def test_an_empty_world_has_no_looks() -> None:
    assert looks_of() == {}


# -- the large kitchen -------------------------------------------------------------------------------------------------


def test_every_door_and_drawer_of_the_bundled_kitchen_has_an_open_box_behind_it() -> None:
    knowledge = KnowledgeBase()
    knowledge.load([bundled_kitchen()])
    kitchen = knowledge.world()
    looks = decide_looks(kitchen, knowledge.ancestors)
    by_id = {body.id: body for body in kitchen.bodies}
    for joint in kitchen.constraints:
        frame, front = sorted((joint.parent, joint.child), key=lambda end: by_id[end].physics.simulates)
        if not looks[frame].building:
            assert looks[frame].openings == ((0, 1),), f"{frame} behind {front}"
