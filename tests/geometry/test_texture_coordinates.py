"""Texture coordinates of procedural shapes: a metric scale on every template, no mirrored faces, readable prints."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mindstage.geometry import SHAPE_TEMPLATES, BodySide, build_geometry, template_by_name
from mindstage.scene import BodyGeometry, PbrMaterial, Vector, VisualMesh
from mindstage.scene.transforms import Array
from mindstage.textures import texture_info
from tests.cases import each_case
from tests.geometry.template_strategies import orientations, sizes, templates

OAK = PbrMaterial(name="wood", texture="oak_board")
TILES = PbrMaterial(name="tiles", texture="floor_tiles")


def frames(visual: VisualMesh, size: tuple[float, float]) -> tuple[Array, Array, Array, Array]:
    """For each face: its area, area on the texture [m²], direction of u in space, and normal."""
    assert visual.uv is not None
    a, b, c = (visual.points[visual.faces[:, corner]] for corner in range(3))
    ta, tb, tc = (visual.uv[visual.faces[:, corner]] * size for corner in range(3))
    across = np.cross(b - a, c - a)
    one, two = tb - ta, tc - ta
    turned = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along_u = ((b - a) * two[:, 1:] - (c - a) * one[:, 1:]) / turned[:, None]
    return np.linalg.norm(across, axis=1) / 2, turned / 2, along_u, across


def all_of(texture: PbrMaterial, shape_name: str) -> dict[str, PbrMaterial]:
    return dict.fromkeys(SHAPE_TEMPLATES[shape_name].roles, texture)


@each_case("shape_name", SHAPE_TEMPLATES)
@settings(max_examples=2, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(data=st.data(), size=sizes, orientation=orientations, material=st.sampled_from([OAK, TILES]))
def test_the_scale_of_textures_is_metric(
    shape_name: str,
    data: st.DataObject,
    size: Vector,
    orientation: tuple[BodySide, BodySide],
    material: PbrMaterial,
) -> None:
    geometry = build_geometry(
        data.draw(templates(shape_name)), size, up=orientation[0], front=orientation[1],
        materials=all_of(material, shape_name),
    )  # fmt: skip
    extent = texture_info(material.texture).size
    for visual in geometry.visuals:
        assert visual.uv is not None
        assert np.isfinite(visual.uv).all()
        if visual.image is not None:
            continue
        area, on_texture, _, _ = frames(visual, extent)
        large = area > 1e-9
        ratio = on_texture[large] / area[large]
        total = area[large].sum()
        # Oblique faces and cones are compressed; spheres also near their poles.
        assert (area[large] * (ratio > 0.0)).sum() > 0.97 * total, "faces are mirrored"
        assert (area[large] * ((ratio > 0.2) & (ratio < 3.5))).sum() > 0.85 * total


def test_the_grain_follows_the_longest_side_of_each_board() -> None:
    geometry = build_geometry(template_by_name("table"), (0.8, 1.4, 0.74), materials={"body": OAK})
    checked = set()
    for visual in geometry.visuals:
        area, _, along_u, normal = frames(visual, texture_info("oak_board").size)
        middle = visual.points[visual.faces].mean(axis=1)
        facing = np.abs(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12))
        large = area > 1e-3
        top = large & (middle[:, 2] > 0.36) & (facing[:, 2] > 0.9)
        legs = large & (middle[:, 2] < 0.2) & (facing[:, 2] < 0.1)
        for chosen, axis in ((top, 1), (legs, 2)):
            if chosen.any():
                directions = np.abs(along_u[chosen]) / np.linalg.norm(along_u[chosen], axis=1, keepdims=True)
                assert directions[:, axis].min() > 0.99
                checked.add(axis)
    assert checked == {1, 2}


def test_neighboring_boards_begin_at_different_places_of_the_texture() -> None:
    geometry = build_geometry(template_by_name("case"), (0.4, 1.0, 0.8), materials={"body": OAK})
    starts = set()
    for visual in geometry.visuals:
        area, _, _, normal = frames(visual, texture_info("oak_board").size)
        assert visual.uv is not None
        up = visual.faces[(normal[:, 2] > 0.999 * np.linalg.norm(normal, axis=1)) & (area > 1e-3)]
        offset = visual.uv[up[:, 0]] * texture_info("oak_board").size - visual.points[up[:, 0]][:, [1, 0]] * [1, -1]
        starts |= {tuple(row) for row in np.round(offset % np.array(texture_info("oak_board").size), 3).tolist()}
    assert len(starts) >= 2


def test_a_grid_is_aligned_over_all_parts_of_a_body() -> None:
    walls = build_geometry(template_by_name("shell"), (4.0, 3.0, 2.5), materials={"body": TILES})
    for visual in walls.visuals:
        assert visual.uv is not None
        height = visual.uv[:, 1] * texture_info("floor_tiles").size[1]
        sides = np.isclose(height, visual.points[:, 2])
        assert sides.mean() > 0.5, "v is the height on all sides"


def test_textures_change_neither_the_surface_nor_its_physics() -> None:
    plain = build_geometry(template_by_name("mug"), (0.08, 0.08, 0.1), materials={"body": PbrMaterial()})
    textured = build_geometry(template_by_name("mug"), (0.08, 0.08, 0.1), materials={"body": OAK})
    assert textured.collision_shapes == plain.collision_shapes
    for one, other in zip(plain.visuals, textured.visuals, strict=True):
        assert np.array_equal(one.points[one.faces], other.points[other.faces])
        assert one.uv is None
    assert textured.key != plain.key


def test_vertices_are_shared_where_the_coordinates_are_continuous() -> None:
    plain = build_geometry(template_by_name("case"), (0.6, 0.6, 0.9), materials={"body": PbrMaterial()})
    textured = build_geometry(template_by_name("case"), (0.6, 0.6, 0.9), materials={"body": OAK})
    for one, other in zip(plain.visuals, textured.visuals, strict=True):
        assert len(other.points) < 3 * len(one.points)
        assert len(other.faces) == len(one.faces)


# -- prints ------------------------------------------------------------------------------------------------------------


def printed(geometry: BodyGeometry) -> VisualMesh:
    return next(visual for visual in geometry.visuals if visual.image is not None)


def uv_at(visual: VisualMesh, normal: Vector) -> tuple[Array, Array]:
    """The points and texture coordinates of the faces towards a direction."""
    assert visual.uv is not None
    a, b, c = (visual.points[visual.faces[:, corner]] for corner in range(3))
    across = np.cross(b - a, c - a)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-15)
    rows = np.unique(visual.faces[across @ np.array(normal) > 0.999])
    return visual.points[rows], visual.uv[rows]


@each_case("side", [(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)])
@each_case("up", [BodySide.TOP, BodySide.LEFT])
def test_every_side_of_a_carton_is_readable(side: Vector, up: BodySide) -> None:
    """Seen from outside with its top upwards, u increases to the right and v upwards."""
    front = BodySide.FRONT
    geometry = build_geometry(template_by_name("carton", {"word": "milk"}), (0.08, 0.12, 0.2), up=up, front=front)
    turn = np.stack([front.vector, np.cross(up.vector, front.vector), up.vector], axis=1)
    outward = turn @ np.array(side)
    points, uv = uv_at(printed(geometry), tuple(outward))
    right = np.cross(-outward, up.vector)
    slope_u = np.polyfit(points @ right, uv[:, 0], 1)[0]
    slope_v = np.polyfit(points @ np.array(up.vector), uv[:, 1], 1)[0]
    assert slope_u > 0.0
    assert slope_v > 0.0
    assert np.ptp(uv[:, 1]) > 0.95


def test_the_front_of_a_carton_has_the_first_panel() -> None:
    visual = printed(build_geometry(template_by_name("carton", {"word": "milk"}), (0.08, 0.12, 0.2)))
    _, front = uv_at(visual, (1, 0, 0))
    assert front[:, 0].min() == pytest.approx(0.0, abs=0.01)
    assert front[:, 0].max() == pytest.approx(0.12 / 0.4, abs=0.01)


@pytest.mark.parametrize("shape_name", ["can", "jar", "bottle"])
def test_round_labels_are_readable_with_their_middle_in_front(shape_name: str) -> None:
    visual = printed(build_geometry(template_by_name(shape_name, {"word": "tomatoes"}), (0.08, 0.08, 0.12)))
    assert visual.uv is not None
    outside = np.hypot(*visual.points[:, :2].T) > 0.98 * np.hypot(*visual.points[:, :2].T).max()
    front = outside & (visual.points[:, 0] > 0.03) & (visual.uv[:, 0] > 0.1)
    assert np.polyfit(visual.points[front, 1], visual.uv[front, 0], 1)[0] > 0.0
    assert visual.uv[front, 0].mean() == pytest.approx(0.5, abs=0.02)
    assert np.polyfit(visual.points[front, 2], visual.uv[front, 1], 1)[0] > 0.0


def test_a_flat_package_is_printed_on_top_and_reads_from_the_front() -> None:
    visual = printed(build_geometry(template_by_name("carton", {"word": "pizza"}), (0.28, 0.28, 0.04)))
    points, uv = uv_at(visual, (0, 0, 1))
    assert np.polyfit(points[:, 1], uv[:, 0], 1)[0] > 0.0, "right of a viewer in front"
    assert np.polyfit(points[:, 0], uv[:, 1], 1)[0] < 0.0, "upper edge at the back"


def test_a_package_without_a_word_is_plain() -> None:
    geometry = build_geometry(template_by_name("carton"), (0.08, 0.12, 0.2))
    assert all(visual.image is None for visual in geometry.visuals)


def test_prints_are_part_of_the_key() -> None:
    milk, juice = (
        build_geometry(template_by_name("carton", {"word": word}), (0.08, 0.12, 0.2)) for word in ("milk", "juice")
    )
    assert milk.key != juice.key
