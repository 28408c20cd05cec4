"""Individual shape templates: their parts, parameters and errors."""

from __future__ import annotations

import numpy as np
import pytest

from mindstage.errors import InvalidShapeError, NumberRefusedError, ShapeNotFoundError
from mindstage.geometry import SHAPE_TEMPLATES, BodySide, Cutout, build_geometry, template_by_name
from mindstage.scene import (
    AttachedLight,
    BodyGeometry,
    CollisionShapeType,
    GeometrySource,
    LightType,
    PbrMaterial,
    VisualMesh,
)
from mindstage.scene.transforms import Array, quat_rotate
from tests.cases import each_case
from tests.geometry.geometry_checks import is_closed, is_inside, visual_bounds, volume


def is_solid_at(geometry: BodyGeometry, x: float, y: float, z: float) -> bool:
    return any(is_inside(shape, np.array([x, y, z])) for shape in geometry.collision_shapes)


def visual_of(geometry: BodyGeometry, material: PbrMaterial) -> VisualMesh:
    return next(visual for visual in geometry.visuals if visual.material == material)


# -- containers --------------------------------------------------------------------------------------------------------


def test_a_drawer_is_five_boards_around_a_cavity_that_is_open_at_the_top() -> None:
    geometry = build_geometry(template_by_name("drawer"), (0.5, 0.6, 0.2))
    assert [shape.type for shape in geometry.collision_shapes] == [CollisionShapeType.BOX] * 5
    assert not any(is_solid_at(geometry, 0.0, 0.0, z) for z in np.linspace(-0.08, 0.1, 10))
    assert is_solid_at(geometry, 0.245, 0.0, 0.0), "its front"
    assert is_solid_at(geometry, 0.0, 0.0, -0.09), "its floor"
    (surface,) = geometry.support_surfaces
    assert surface.is_inside
    assert surface.center[2] == pytest.approx(-0.086)


@pytest.mark.parametrize("shape_name", ["tub", "basket"])
def test_movable_containers_stand_on_their_floor_only(shape_name: str) -> None:
    geometry = build_geometry(template_by_name(shape_name), (0.4, 0.3, 0.2))
    lowest = [shape for shape in geometry.collision_shapes if shape.pose.position[2] - shape.size[2] / 2 < -0.1 + 1e-4]
    assert len(geometry.collision_shapes) == 5
    assert [shape.size[:2] for shape in lowest] == [pytest.approx((0.4, 0.3))]


def test_the_floor_of_a_drawer_is_at_its_level_parameter() -> None:
    geometry = build_geometry(template_by_name("drawer", {"levels": [-0.05]}), (0.5, 0.6, 0.2))
    assert geometry.support_surfaces[0].center[2] == -0.05
    assert is_solid_at(geometry, 0.0, 0.0, -0.0501)
    assert not is_solid_at(geometry, 0.0, 0.0, -0.0499)


def test_a_tall_drawer_has_several_trays() -> None:
    geometry = build_geometry(template_by_name("drawer"), (0.53, 0.3, 1.32))
    levels = [surface.center[2] for surface in geometry.support_surfaces]
    assert len(levels) == 2
    assert levels == sorted(levels)


def test_a_drawer_has_trays_where_contents_stand() -> None:
    geometry = build_geometry(template_by_name("drawer", {"levels": [-0.6, -0.2, 0.3]}), (0.53, 0.3, 1.32))
    assert [surface.center[2] for surface in geometry.support_surfaces] == [-0.6, -0.2, 0.3]
    assert is_solid_at(geometry, 0.0, 0.0, -0.2001)
    assert not is_solid_at(geometry, 0.0, 0.0, 0.0)


def test_a_case_is_open_at_the_front_with_shelves_at_its_levels() -> None:
    geometry = build_geometry(template_by_name("case", {"levels": [-0.2, 0.1]}), (0.4, 0.6, 0.8))
    assert not is_solid_at(geometry, 0.199, 0.0, 0.0)
    assert is_solid_at(geometry, -0.199, 0.0, 0.0)
    inside = sorted(surface.center[2] for surface in geometry.support_surfaces if surface.is_inside)
    assert inside == pytest.approx([-0.384, -0.2, 0.1])
    assert is_solid_at(geometry, 0.0, 0.0, 0.0999)
    assert not is_solid_at(geometry, 0.0, 0.0, 0.1001)


def test_a_tall_shelf_has_its_boards_where_its_contents_stand() -> None:
    geometry = build_geometry(template_by_name("shelf", {"levels": [-0.4, 0.2]}), (0.4, 0.8, 1.8))
    inside = sorted(surface.center[2] for surface in geometry.support_surfaces if surface.is_inside)
    assert inside == pytest.approx([-0.87, -0.4, 0.2])
    assert is_solid_at(geometry, 0.0, 0.0, 0.1999)
    assert not is_solid_at(geometry, 0.0, 0.0, 0.2001)


def test_the_floor_of_a_case_extends_to_a_level_just_above_it() -> None:
    geometry = build_geometry(template_by_name("case", {"levels": [-0.375]}), (0.4, 0.6, 0.8))
    assert [surface.center[2] for surface in geometry.support_surfaces if surface.is_inside] == [-0.375]
    assert is_solid_at(geometry, 0.0, 0.0, -0.3751)


def test_walls_of_a_case_have_individual_thicknesses() -> None:
    geometry = build_geometry(template_by_name("case", {"walls": [["+x", 0.03], ["+z", 0.0]]}), (0.4, 0.6, 0.8))
    assert is_solid_at(geometry, 0.171, 0.0, 0.0)
    assert not is_solid_at(geometry, 0.0, 0.0, 0.399)


def test_shelves_without_room_are_omitted_with_a_note() -> None:
    geometry = build_geometry(template_by_name("case", {"shelves": 9}), (0.4, 0.6, 0.2))
    assert geometry.reason == "room for 2 of 9 shelves"


@each_case(
    ("shape_name", "size"),
    [
        ("mug", (0.084, 0.084, 0.096)),
        ("mug", (0.12, 0.084, 0.096)),
        ("glass", (0.07, 0.07, 0.12)),
        ("bowl", (0.16, 0.2, 0.07)),
        ("pot", (0.24, 0.24, 0.16)),
        ("pan", (0.45, 0.28, 0.05)),
        ("sink", (0.5, 0.8, 0.2)),
        ("basket", (0.26, 0.4, 0.15)),
        ("tub", (0.3, 0.4, 0.2)),
        ("plate", (0.26, 0.26, 0.024)),
    ],
)
def test_a_vessel_is_hollow_and_contains_its_contents(shape_name: str, size: tuple[float, float, float]) -> None:
    geometry = build_geometry(template_by_name(shape_name), size)
    surface = next(surface for surface in geometry.support_surfaces if surface.is_inside)
    x, y, level = surface.center
    assert level < 0.0
    assert not any(is_solid_at(geometry, x, y, z) for z in np.linspace(level + 1e-6, size[2] / 2, 8))
    assert is_solid_at(geometry, x, y, level - 1e-4)
    angles = np.linspace(0.1, 2 * np.pi, 8, endpoint=False)  # not along a seam
    for turn in angles:  # every horizontal ray from the center hits a wall
        direction = np.array([np.cos(turn), np.sin(turn), 0.0])
        path = [
            np.array(surface.center) + [0.0, 0.0, 0.3 * size[2]] + direction * out for out in np.linspace(0.0, 0.6, 200)
        ]
        assert any(is_solid_at(geometry, *spot) for spot in path)


def test_a_vessel_with_high_contents_is_solid_up_to_them() -> None:
    geometry = build_geometry(template_by_name("bowl", {"level": 0.03}), (0.16, 0.16, 0.07))
    assert len(geometry.collision_shapes) == 1
    assert is_solid_at(geometry, 0.0, 0.0, 0.0299)
    assert not is_solid_at(geometry, 0.0, 0.0, 0.0301)


def test_the_parts_of_a_round_wall_are_rotated_copies() -> None:
    geometry = build_geometry(template_by_name("bowl"), (0.16, 0.16, 0.07))
    hulls = [shape for shape in geometry.collision_shapes if shape.type is CollisionShapeType.HULL]
    assert len(hulls) == 8
    assert len({shape.points for shape in hulls}) == 1
    assert {shape.type for shape in build_geometry(template_by_name("glass"), (0.07, 0.07, 0.12)).collision_shapes} == {
        CollisionShapeType.BOX,
        CollisionShapeType.CYLINDER,
    }


# -- buildings and furniture -------------------------------------------------------------------------------------------


def test_a_wall_is_open_at_its_openings_and_solid_elsewhere() -> None:
    door = Cutout(low=(-1.0, -0.4, -1.25), high=(1.0, 0.5, 0.8))
    geometry = build_geometry(template_by_name("wall", {"free": [door]}), (0.1, 3.2, 2.5))
    assert not is_solid_at(geometry, 0.0, 0.0, 0.0)
    assert is_solid_at(geometry, 0.0, 0.0, 0.81)
    assert is_solid_at(geometry, 0.0, -0.41, 0.0)
    assert volume(geometry.visuals[0]) == pytest.approx(0.1 * (3.2 * 2.5 - 0.9 * 2.05))
    assert is_closed(geometry.visuals[0])


def test_openings_that_meet_at_a_corner_leave_the_mesh_closed() -> None:
    low = Cutout(low=(-1.0, -0.5, -1.0), high=(1.0, 0.0, 0.0))
    high = Cutout(low=(-1.0, 0.0, 0.0), high=(1.0, 0.5, 1.0))
    geometry = build_geometry(template_by_name("wall", {"free": [low, high]}), (0.1, 3.2, 2.5))
    assert is_closed(geometry.visuals[0])
    assert volume(geometry.visuals[0]) == pytest.approx(0.1 * (3.2 * 2.5 - 2 * 0.5))


def test_a_cutout_goes_through_a_countertop_and_its_block() -> None:
    cutout = Cutout(low=(-0.2, -0.3, 0.3), high=(0.2, 0.3, 0.5))
    geometry = build_geometry(template_by_name("counter", {"free": [cutout]}), (0.64, 1.8, 0.9))
    assert not any(is_solid_at(geometry, 0.0, 0.0, z) for z in np.linspace(-0.44, 0.44, 9))
    assert is_solid_at(geometry, 0.0, 0.5, 0.44)
    assert all(abs(surface.center[1]) > 0.3 or abs(surface.center[0]) > 0.2 for surface in geometry.support_surfaces)


def test_a_frame_is_open_in_the_middle_and_without_a_sill_at_the_bottom() -> None:
    assert is_solid_at(build_geometry(template_by_name("frame"), (0.1, 1.0, 2.1)), 0.0, 0.0, -1.04)
    geometry = build_geometry(template_by_name("frame", {"sill": False}), (0.1, 1.0, 2.1))
    assert not any(is_solid_at(geometry, 0.0, 0.0, z) for z in np.linspace(-1.05, 0.98, 9))
    assert is_solid_at(geometry, 0.0, 0.0, 1.04)


def test_a_table_has_legs_unless_it_is_too_low() -> None:
    assert len(build_geometry(template_by_name("table"), (0.8, 1.4, 0.74)).collision_shapes) == 5
    board = build_geometry(template_by_name("table"), (0.8, 1.4, 0.04))
    assert len(board.collision_shapes) == 1
    assert board.reason == "too low for legs: only the top"


def test_the_support_surface_of_a_chair_is_in_front_of_its_backrest() -> None:
    geometry = build_geometry(template_by_name("chair"), (0.45, 0.45, 0.9))
    (seat,) = geometry.support_surfaces
    assert seat.center[2] == pytest.approx(0.0)
    assert seat.center[0] > 0.0
    assert is_solid_at(geometry, -0.22, 0.0, 0.3)


def test_a_handle_has_clearance_between_its_standoffs() -> None:
    geometry = build_geometry(template_by_name("handle"), (0.04, 0.16, 0.012))
    assert is_solid_at(geometry, 0.015, 0.0, 0.0), "the bar"
    assert not is_solid_at(geometry, -0.01, 0.0, 0.0), "room for fingers"
    assert len(geometry.collision_shapes) == 3


# -- all shapes --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("front", [BodySide.FRONT, BodySide.BACK, BodySide.LEFT, BodySide.RIGHT])
def test_the_front_panel_of_a_drawer_is_on_the_requested_side(front: BodySide) -> None:
    geometry = build_geometry(template_by_name("drawer"), (0.5, 0.5, 0.2), front=front)
    low, high = points_of(geometry, "lacquered wood")
    middle = (low + high) / 2
    assert np.allclose(middle, 0.241 * np.array(front.vector), atol=1e-9)


def points_of(geometry: BodyGeometry, material: str) -> tuple[Array, Array]:
    points = np.concatenate([visual.points for visual in geometry.visuals if visual.material.name == material])
    return points.min(axis=0), points.max(axis=0)


def test_a_lying_body_has_support_surfaces_on_its_upper_side() -> None:
    geometry = build_geometry(template_by_name("tub"), (0.2, 0.3, 0.4), up=BodySide.BACK, front=BodySide.TOP)
    (surface,) = geometry.support_surfaces
    assert surface.normal == (-1.0, 0.0, 0.0)
    assert surface.center[0] == pytest.approx(0.092)
    assert surface.size == pytest.approx((0.284, 0.384))  # along y and z


def test_materials_are_assigned_to_roles_and_inherited_by_dependent_roles() -> None:
    oak, steel = PbrMaterial(name="oak"), PbrMaterial(name="steel")
    geometry = build_geometry(
        template_by_name("case"), (0.4, 0.6, 0.8), materials={"body": oak, "shelf": steel, "wheels": steel}
    )
    assert {visual.material for visual in geometry.visuals} == {oak}
    geometry = build_geometry(
        template_by_name("case", {"shelves": 1}), (0.4, 0.6, 0.8), materials={"body": oak, "shelf": steel}
    )
    assert {visual.material for visual in geometry.visuals} == {oak, steel}


def test_an_attached_light_is_at_the_bulb() -> None:
    geometry = build_geometry(
        template_by_name("lamp", {"style": "floor"}), (0.3, 0.3, 1.6), light=AttachedLight(), front=BodySide.LEFT
    )
    (light,) = geometry.lights
    low, high = points_of(geometry, "glass")
    assert np.all(low < light.pose.position)
    assert np.all(light.pose.position < high)


def test_a_spot_light_is_at_the_bulb_and_shines_away_from_the_upper_side_of_its_lamp() -> None:
    template, size = template_by_name("lamp", {"style": "ceiling"}), (0.3, 0.3, 0.2)
    (light,) = build_geometry(template, size, light=AttachedLight(type=LightType.SPOT)).lights
    x, y, z = light.pose.position
    assert (x, y) == pytest.approx((0.0, 0.0))
    assert z < 0.0, "below the mount"
    for up, front in ((BodySide.BACK, BodySide.TOP), (BodySide.LEFT, BodySide.FRONT), (BodySide.BOTTOM, BodySide.LEFT)):
        extents = tuple(0.2 if each == up.axis else 0.3 for each in range(3))
        (turned,) = build_geometry(
            template, extents, light=AttachedLight(type=LightType.SPOT), up=up, front=front
        ).lights
        assert turned.pose.position == pytest.approx(z * np.array(up.vector), abs=1e-6)
        assert quat_rotate(np.array(turned.pose.quaternion), (0.0, 0.0, -1.0)) == pytest.approx(-np.array(up.vector))
    (bulb,) = build_geometry(template, extents, light=AttachedLight(), up=up, front=front).lights
    assert bulb.pose.quaternion == (1.0, 0.0, 0.0, 0.0), "a point light shines in all directions"


def test_a_body_too_thin_for_its_walls_is_a_plain_box_with_a_reason() -> None:
    geometry = build_geometry(template_by_name("case"), (0.4, 0.6, 0.004), reason="because it is one")
    assert geometry.shape_name == "box"
    assert geometry.reason == "because it is one; too small for its walls, so a plain box"
    assert len(geometry.collision_shapes) == 1


def test_equal_geometry_is_built_once_with_individual_reasons() -> None:
    one = build_geometry(template_by_name("mug"), (0.08, 0.08, 0.1), source=GeometrySource.CLASS_NAME, reason="a")
    other = build_geometry(template_by_name("mug", {}), (0.08, 0.08, 0.1), reason="b")
    assert one.visuals is other.visuals
    assert one.key == other.key
    assert (one.source, one.reason, other.reason) == (GeometrySource.CLASS_NAME, "a", "b")


def test_parameters_can_be_given_as_text() -> None:
    assert template_by_name("drawer", {"wall": "0.02", "trays": "3"}) == template_by_name(
        "drawer", {"wall": 0.02, "trays": 3}
    )
    assert template_by_name("lever", {"towards": "-y"}) == template_by_name("lever", {"towards": BodySide.RIGHT})


def test_an_unknown_shape_name_raises_an_error_with_a_suggestion() -> None:
    with pytest.raises(ShapeNotFoundError, match="no shape 'drawr'; near: 'drawer'"):
        template_by_name("drawr")
    with pytest.raises(ShapeNotFoundError, match="there is appliance, bag"):
        template_by_name("x")


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"wal": 0.1}, "it has no parameter 'wal'; near: 'wall'"),
        ({"wall": -1.0}, "0.0001"),
        ({"wall": "thick"}, "wall"),
        ({"wall": float("nan")}, "0.0001"),
    ],
)
def test_invalid_parameters_raise_an_error(parameters: dict[str, object], words: str) -> None:
    with pytest.raises(InvalidShapeError, match=words):
        template_by_name("drawer", parameters)


@pytest.mark.parametrize(
    "size", [(0.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, float("nan")), (1.0, float("inf"), 1.0)]
)
def test_an_invalid_size_raises_an_error(size: tuple[float, float, float]) -> None:
    with pytest.raises((InvalidShapeError, NumberRefusedError), match=r"its size is|size .*: it must be"):
        build_geometry(template_by_name("box"), size)


def test_front_and_top_on_one_axis_raise_an_error() -> None:
    with pytest.raises(InvalidShapeError, match="on one axis"):
        build_geometry(template_by_name("box"), (1.0, 1.0, 1.0), up=BodySide.TOP, front=BodySide.BOTTOM)


def test_every_shape_has_a_description_and_a_body_material() -> None:
    for shape_name, template in SHAPE_TEMPLATES.items():
        assert template.shape_name() == shape_name
        assert (template.__doc__ or "").splitlines()[0].endswith(".")
        assert "body" in template.roles
        for default in template.roles.values():
            assert isinstance(default, PbrMaterial) or default in template.roles


def test_no_shape_is_scaled_much_to_fit_its_size() -> None:
    usual = {"pan": (0.45, 0.28, 0.05), "tap": (0.2, 0.06, 0.3), "kettle": (0.22, 0.16, 0.25), "mug": (0.1, 0.09, 0.1)}
    for shape_name, size in usual.items():
        points = np.concatenate(
            [visual.points for visual in build_geometry(template_by_name(shape_name), size).visuals]
        )
        low, high = visual_bounds(build_geometry(template_by_name(shape_name), size))
        assert np.allclose(high - low, size)
        assert np.ptp(points, axis=0) == pytest.approx(size)
