"""Geometry that depends on the scene: fronts, shelves, openings and cutouts."""

from __future__ import annotations

from math import cos, pi, sin
from typing import NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.geometry import BodySide
from mindstage.geometry.fit import fit_geometry
from mindstage.geometry.fit_context import SceneContext
from mindstage.geometry.orientation import OrientationSolver
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyId, LinearLimits, Quaternion, Vector
from mindstage.scene.transforms import quat_conjugate, quat_rotate
from tests.cases import each_case
from tests.geometry.fit_scenes import (
    QUARTERS,
    box_of,
    fit,
    has_clearance,
    make_body,
    open_sides,
    panel_side,
    slide_joint,
    world,
)


@pytest.fixture(scope="module")
def bundled_knowledge() -> KnowledgeBase:
    return KnowledgeBase()


# -- drawers -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("handle", "front"),
    [
        ((0.32, 0.0, 0.0), BodySide.FRONT),
        ((-0.32, 0.0, 0.0), BodySide.BACK),
        ((0.0, 0.27, 0.0), BodySide.LEFT),
        ((0.0, -0.27, 0.0), BodySide.RIGHT),
    ],
)
def test_the_front_of_a_drawer_is_where_its_handle_is(
    bundled_knowledge: KnowledgeBase, handle: Vector, front: BodySide
) -> None:
    size = (0.6, 0.5, 0.2)
    bodies = (
        make_body("drawer", "Drawer", (0, 0, 0), size, is_free=True),
        make_body("handle", "Handle", handle, (0.04, 0.04, 0.02)),
    )
    fitted = fit_geometry(world(bodies, attached=[("drawer", "handle")]), bundled_knowledge)
    geometry = fitted.geometry[BodyId("drawer")]
    assert panel_side(geometry, size) is front
    assert geometry.reason.endswith("its front is where its handle is")
    assert fitted.notes == ()


def test_the_front_of_a_drawer_is_in_its_only_opening_direction(bundled_knowledge: KnowledgeBase) -> None:
    size = (0.5, 0.5, 0.2)
    bodies = (
        make_body("cupboard", "Cupboard", (0, 0, 0), (0.6, 0.6, 0.3)),
        make_body("drawer", "Drawer", (0, 0, 0), size, is_free=True),
    )
    for middle, front in ((0.2, BodySide.FRONT), (-0.2, BodySide.BACK)):
        geometries = fit_geometry(
            world(bodies, [slide_joint("cupboard", "drawer", middle=middle)]), bundled_knowledge
        ).geometry
        assert panel_side(geometries[BodyId("drawer")], size) is front


def test_parent_and_child_of_a_slide_joint_may_be_swapped(bundled_knowledge: KnowledgeBase) -> None:
    size = (0.5, 0.5, 0.2)
    bodies = (
        make_body("cupboard", "Cupboard", (0, 0, 0), (0.6, 0.6, 0.3)),
        make_body("drawer", "Drawer", (0, 0, 0), size, is_free=True),
    )
    # The middle is that of the child, here the cupboard, so the drawer moves in the opposite direction.
    joint = slide_joint("drawer", "cupboard", middle=0.2)
    assert (
        panel_side(fit_geometry(world(bodies, [joint]), bundled_knowledge).geometry[BodyId("drawer")], size)
        is BodySide.BACK
    )


@pytest.mark.parametrize("turn", QUARTERS)
def test_a_drawer_in_a_cupboard_faces_outwards_along_its_slide(
    bundled_knowledge: KnowledgeBase, turn: Quaternion
) -> None:
    size = (0.5, 0.4, 0.2)
    out = quat_rotate(np.array(turn), (0.08, 0.0, 0.0)).tolist()
    bodies = (
        make_body("cupboard", "Cupboard", (0, 0, 0), (0.6, 0.6, 0.3), turn=turn),
        make_body("drawer", "Drawer", (out[0], out[1], 0.0), size, is_free=True, turn=turn),
    )
    geometries = fit_geometry(world(bodies, [slide_joint("cupboard", "drawer", turn=turn)]), bundled_knowledge).geometry
    assert panel_side(geometries[BodyId("drawer")], size) is BodySide.FRONT
    assert geometries[BodyId("drawer")].reason.endswith("its front is away from what it closes")
    assert open_sides(geometries[BodyId("cupboard")], (0.6, 0.6, 0.3)) == {BodySide.FRONT}


@pytest.mark.parametrize(("side", "front"), [(0.24, BodySide.FRONT), (-0.24, BodySide.BACK)])
def test_a_drawer_with_a_handle_at_a_corner_faces_along_its_slide(
    bundled_knowledge: KnowledgeBase, side: float, front: BodySide
) -> None:
    size = (0.5, 0.4, 0.2)
    bodies = (
        make_body("cupboard", "Cupboard", (0, 0, 0), (0.6, 0.6, 0.3)),
        make_body("drawer", "Drawer", (0, 0, 0), size, is_free=True),
        make_body("handle", "Handle", (side, 0.22, 0.0), (0.04, 0.04, 0.02)),
    )
    fitted = fit_geometry(
        world(bodies, [slide_joint("cupboard", "drawer")], attached=[("drawer", "handle")]), bundled_knowledge
    )
    assert panel_side(fitted.geometry[BodyId("drawer")], size) is front


def test_the_floor_of_a_drawer_is_right_below_its_contents(bundled_knowledge: KnowledgeBase) -> None:
    spoon = make_body("spoon", "Teaspoon", (0.0, 0.0, -0.05), (0.14, 0.03, 0.02), is_free=True)
    geometry = fit(bundled_knowledge, make_body("drawer", "Drawer", (0, 0, 0), (0.5, 0.5, 0.2)), spoon).geometry[
        BodyId("drawer")
    ]
    (surface,) = geometry.support_surfaces
    assert surface.is_inside
    assert surface.center[2] == pytest.approx(-0.06, abs=1e-9)


# -- cabinets ----------------------------------------------------------------------------------------------------------


@each_case("side", [BodySide.FRONT, BodySide.BACK, BodySide.LEFT, BodySide.RIGHT])
@each_case("turn", QUARTERS[:2])
def test_a_cupboard_is_open_where_its_door_is(
    bundled_knowledge: KnowledgeBase, side: BodySide, turn: Quaternion
) -> None:
    size = (0.6, 0.5, 0.8)
    at = [0.0, 0.0, 0.0]
    at[side.axis] = side.sign * (size[side.axis] / 2 + 0.012)
    extent = [0.58, 0.48, 0.78]
    extent[side.axis] = 0.02
    spot = quat_rotate(np.array(turn), at).tolist()
    bodies = (
        make_body("cupboard", "Cupboard", (0, 0, 0), size, turn=turn),
        make_body(
            "door", "Door", (spot[0], spot[1], spot[2]), (extent[0], extent[1], extent[2]), is_free=True, turn=turn
        ),
    )
    joint = replace(slide_joint("cupboard", "door"), linear=LinearLimits())
    for joints in ([joint], []):  # connected by a joint, or only in front of it
        fitted = fit_geometry(world(bodies, joints), bundled_knowledge)
        assert open_sides(fitted.geometry[BodyId("cupboard")], size) == {side}
        assert fitted.notes == ()


@pytest.mark.parametrize("turn", QUARTERS)
def test_an_oven_has_a_panel_with_a_display_between_its_door_knobs_and_top(
    bundled_knowledge: KnowledgeBase, turn: Quaternion
) -> None:
    def turned(*point: float) -> Vector:
        x, y, z = quat_rotate(np.array(turn), np.array(point)).tolist()
        return (x, y, z)

    bodies = (
        make_body("oven", "RegularOven", (0, 0, 0), (0.6, 0.6, 0.7), turn=turn),
        make_body("door", "Door", turned(0.31, 0.0, -0.1), (0.02, 0.58, 0.48), is_free=True, turn=turn),
        make_body("knob", "ControlKnob", turned(0.315, 0.1, 0.2), (0.03, 0.04, 0.04), is_free=True, turn=turn),
    )
    joint = replace(slide_joint("oven", "door"), linear=LinearLimits())
    geometry = fit_geometry(world(bodies, [joint]), bundled_knowledge).geometry
    oven, door = geometry[BodyId("oven")], geometry[BodyId("door")]
    (display,) = (mesh for mesh in oven.visuals if mesh.image is not None)
    assert display.points[:, 0].max() == pytest.approx(0.3)
    assert 0.22 < display.points[:, 2].min() < display.points[:, 2].max() < 0.334, "between the knob and the top board"
    assert not has_clearance(oven, (0.297, 0.2, 0.2)), "the panel closes what the door leaves open"
    assert has_clearance(oven, (0.297, 0.0, 0.0))
    assert all(mesh.image is None for mesh in door.visuals)


def test_a_door_over_the_whole_front_of_a_microwave_has_the_display(bundled_knowledge: KnowledgeBase) -> None:
    bodies = (
        make_body("microwave", "MicrowaveOven", (0, 0, 0), (0.38, 0.5, 0.3)),
        make_body("door", "Door", (0.2, 0.0, 0.0), (0.02, 0.497, 0.292), is_free=True),
    )
    joint = replace(slide_joint("microwave", "door"), linear=LinearLimits())
    geometry = fit_geometry(world(bodies, [joint]), bundled_knowledge).geometry
    (display,) = (mesh for mesh in geometry[BodyId("door")].visuals if mesh.image is not None)
    assert display.points[:, 0].max() == pytest.approx(0.01)
    assert all(mesh.image is None for mesh in geometry[BodyId("microwave")].visuals)


def test_a_chest_is_open_at_the_top_where_its_lid_is(bundled_knowledge: KnowledgeBase) -> None:
    bodies = (
        make_body("freezer", "Refrigerator-Freezer", (0, 0, 0), (0.6, 0.9, 0.8)),
        make_body("lid", "Door", (0, 0, 0.415), (0.58, 0.88, 0.03), is_free=True),
    )
    joint = replace(slide_joint("freezer", "lid"), linear=LinearLimits())
    geometries = fit_geometry(world(bodies, [joint]), bundled_knowledge).geometry
    assert open_sides(geometries[BodyId("freezer")], (0.6, 0.9, 0.8)) == {BodySide.TOP}


def test_shelves_are_at_the_heights_of_contents(bundled_knowledge: KnowledgeBase) -> None:
    milk = make_body("milk", "CowsMilk", (0.0, 0.1, 0.2), (0.07, 0.07, 0.2), is_free=True)
    cheese = make_body("cheese", "Cheese", (0.0, -0.1, -0.3), (0.1, 0.1, 0.06), is_free=True)
    on_top = make_body("butter", "Butter", (0.0, -0.1, -0.25), (0.08, 0.08, 0.04), is_free=True)  # on the cheese
    fridge = make_body("fridge", "Refrigerator", (0, 0, 0), (0.6, 0.6, 1.4))
    geometry = fit(bundled_knowledge, fridge, milk, cheese, on_top).geometry[BodyId("fridge")]
    inside = sorted(round(surface.center[2], 6) for surface in geometry.support_surfaces if surface.is_inside)
    assert inside[1:] == [-0.33, 0.1]
    for each in (milk, cheese, on_top):
        assert has_clearance(geometry, each.pose.position)


def test_an_empty_fridge_has_the_number_of_shelves_in_its_rule(bundled_knowledge: KnowledgeBase) -> None:
    geometry = fit(bundled_knowledge, make_body("fridge", "Refrigerator", (0, 0, 0), (0.6, 0.6, 1.4))).geometry[
        BodyId("fridge")
    ]
    assert sum(surface.is_inside for surface in geometry.support_surfaces) == 1 + 3  # its floor and three shelves


def test_walls_are_thinner_next_to_close_contents(bundled_knowledge: KnowledgeBase) -> None:
    box = make_body("box", "CardboardBox", (0.0, 0.148, 0.0), (0.2, 0.2, 0.2), is_free=True)
    geometry = fit(bundled_knowledge, make_body("cupboard", "Cupboard", (0, 0, 0), (0.5, 0.5, 0.5)), box).geometry[
        BodyId("cupboard")
    ]
    for corner in ((-0.0999, 0.2479, -0.0999), (0.0999, 0.2479, 0.0999)):
        assert has_clearance(geometry, corner)


def test_a_lying_cupboard_has_horizontal_shelves(bundled_knowledge: KnowledgeBase) -> None:
    turned: Quaternion = (cos(pi / 4), sin(pi / 4), 0.0, 0.0)  # about x: its y axis points up
    cupboard = make_body("cupboard", "Cupboard", (0, 0, 0), (0.5, 0.8, 0.5), turn=turned)
    can = make_body("can", "DrinkingCan", (0, 0, 0.06), (0.07, 0.07, 0.12), is_free=True)
    geometry = fit(bundled_knowledge, cupboard, can).geometry[BodyId("cupboard")]
    surfaces = [surface for surface in geometry.support_surfaces if surface.is_inside]
    assert {surface.normal for surface in surfaces} == {(0.0, 1.0, 0.0)}
    assert min(abs(surface.center[1]) for surface in surfaces) < 1e-9


# -- openings ----------------------------------------------------------------------------------------------------------


def test_a_counter_has_a_cutout_for_its_sink(bundled_knowledge: KnowledgeBase) -> None:
    counter = make_body("counter", "CounterTop", (0, 0, 0), (0.6, 2.0, 0.04))
    sink = make_body("sink", "Sink", (0.0, 0.5, -0.08), (0.4, 0.5, 0.2))
    geometry = fit(bundled_knowledge, counter, sink).geometry[BodyId("counter")]
    assert has_clearance(geometry, (0.0, 0.5, 0.0), clearance=0.18)
    assert not has_clearance(geometry, (0.0, -0.5, 0.0))


def test_a_wall_has_openings_for_its_windows(bundled_knowledge: KnowledgeBase) -> None:
    wall = make_body("wall", "WallOfAConstruction", (0, 0, 1.25), (0.1, 4.0, 2.5))
    window = make_body("window", "Window", (0.0, 1.0, 1.4), (0.06, 1.2, 1.0))
    geometry = fit(bundled_knowledge, wall, window).geometry[BodyId("wall")]
    assert has_clearance(geometry, (0.0, 1.0, 0.15), clearance=0.45)
    assert not has_clearance(geometry, (0.0, -1.0, 0.15))


def test_the_shell_of_a_room_is_hollow_with_openings_for_intersecting_bodies(
    bundled_knowledge: KnowledgeBase,
) -> None:
    walls = make_body("walls", "WallOfAConstruction", (0, 0, 1.25), (5.0, 4.0, 2.5))
    cupboard = make_body("cupboard", "Cupboard", (2.4, 0.0, 0.5), (0.6, 0.6, 1.0))
    fitted = fit(bundled_knowledge, walls, cupboard)
    geometry = fitted.geometry[BodyId("walls")]
    assert geometry.shape_name == "shell"
    assert has_clearance(geometry, (0.0, 0.0, 0.0), clearance=1.5)
    assert has_clearance(geometry, (2.45, 0.0, -0.75), clearance=0.2)
    assert not has_clearance(geometry, (2.45, 1.5, 0.0))


def test_what_lies_loose_in_a_room_changes_neither_its_walls_nor_their_openings(
    bundled_knowledge: KnowledgeBase,
) -> None:
    walls = make_body("walls", "WallOfAConstruction", (0, 0, 1.25), (5.0, 4.0, 2.5))
    cupboard = make_body("cupboard", "Cupboard", (2.4, 0.0, 0.5), (0.6, 0.6, 1.0))
    cup = make_body("cup", "Cup", (2.0, 1.5, 0.05), (0.1, 0.1, 0.1), is_free=True)
    empty, furnished = (fit(bundled_knowledge, walls, cupboard, *more) for more in ((), (cup,)))
    geometry = furnished.geometry[BodyId("walls")]
    assert [note for note in furnished.notes if "walls" in note.ids] == []
    assert geometry.collision_shapes == empty.geometry[BodyId("walls")].collision_shapes
    assert has_clearance(geometry, (2.45, 0.0, -0.75), clearance=0.2)


# -- orientation -------------------------------------------------------------------------------------------------------


class FrontCase(NamedTuple):
    """A body, and the direction of its front in the world."""

    cls: str
    at: Vector
    size: Vector
    front: Vector


@each_case(
    "case",
    [
        FrontCase("Chair-PieceOfFurniture", (1.0, 0.0, 0.45), (0.45, 0.45, 0.9), (-1, 0, 0)),
        FrontCase("Chair-PieceOfFurniture", (0.0, 1.0, 0.45), (0.45, 0.45, 0.9), (0, -1, 0)),
        FrontCase("Sofa-PieceOfFurniture", (0.0, -2.4, 0.4), (2.0, 0.9, 0.8), (0, 1, 0)),
        FrontCase("Refrigerator", (-2.6, -1.0, 0.9), (0.6, 0.6, 1.8), (1, 0, 0)),
        FrontCase("Poster", (-2.9, 0.3, 1.5), (0.01, 0.7, 0.5), (1, 0, 0)),
        FrontCase("Tap-PlumbingFixture", (-2.5, 1.0, 1.1), (0.2, 0.05, 0.2), (1, 0, 0)),
    ],
    ids=lambda case: case.cls,
)
@each_case("turn", QUARTERS[:2])
def test_furniture_faces_the_side_from_which_it_is_used(
    bundled_knowledge: KnowledgeBase, case: FrontCase, turn: Quaternion
) -> None:
    x, y, _ = quat_rotate(quat_conjugate(turn), case.size).tolist()
    bodies = (
        make_body("it", case.cls, case.at, (abs(x), abs(y), case.size[2]), turn=turn),
        make_body("table", "Table-PieceOfFurniture", (0, 0, 0.375), (0.9, 0.9, 0.75)),
        make_body("sink", "Sink", (-2.0, 1.0, 0.8), (0.5, 0.6, 0.2)),
        make_body("west", "WallOfAConstruction", (-2.96, 0.0, 1.25), (0.1, 6.0, 2.5)),
        make_body("south", "WallOfAConstruction", (0.0, -2.9, 1.25), (6.0, 0.1, 2.5)),
    )
    context = SceneContext(world(bodies), {body.cls: bundled_knowledge.shape_rule(body.cls) for body in bodies})
    neighborhoods, _ = context.neighborhoods(np.ones(len(bodies), dtype=bool))
    orientation = OrientationSolver(context, neighborhoods).orientation_of(0)
    assert quat_rotate(np.array(turn), orientation.front.vector) == pytest.approx(case.front)
    assert not orientation.is_guess


def test_a_handle_faces_away_from_its_body(bundled_knowledge: KnowledgeBase) -> None:
    door = make_body("door", "Door", (0, 0, 0), (0.02, 0.6, 0.8))
    for sign in (1, -1):
        handle = make_body("handle", "Handle", (sign * 0.03, 0.2, 0.0), (0.04, 0.02, 0.3))
        for attached in ([("door", "handle")], []):
            geometry = fit_geometry(world([door, handle], attached=attached), bundled_knowledge).geometry[
                BodyId("handle")
            ]
            bar = max(
                (box_of(shape) for shape in geometry.collision_shapes), key=lambda box: float(box[1][2] - box[0][2])
            )
            assert np.sign((bar[0] + bar[1])[0]) == sign


def test_an_unknown_front_is_guessed_with_a_note(bundled_knowledge: KnowledgeBase) -> None:
    fitted = fit(
        bundled_knowledge,
        make_body("cupboard", "Cupboard", (0, 0, 0), (0.4, 0.8, 0.8)),
        make_body("mat", "FloorMat", (3, 0, 0), (1, 1, 0.01)),
    )
    assert open_sides(fitted.geometry[BodyId("cupboard")], (0.4, 0.8, 0.8)) == {BodySide.FRONT}
    (note,) = fitted.notes
    assert note.ids == ("cupboard",)
    assert "with an unknown front" in note.text


def test_a_table_with_separate_leg_bodies_is_only_its_top(bundled_knowledge: KnowledgeBase) -> None:
    top = make_body("table", "KitchenTable", (0, 0, 0.73), (0.8, 1.4, 0.04))
    leg = make_body("leg", "TableLeg", (0.3, 0.6, 0.355), (0.06, 0.06, 0.71))
    geometries = fit_geometry(world([top, leg], attached=[("table", "leg")]), bundled_knowledge).geometry
    assert (geometries[BodyId("table")].shape_name, geometries[BodyId("leg")].shape_name) == ("counter", "leg")
