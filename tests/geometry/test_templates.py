"""Every kind of shape, in random sizes, with random parameters, lying any way: what is true of all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mindstage.geometry import SHAPE_TEMPLATES, BodySide, ShapeTemplate, build_geometry, template_by_name
from mindstage.scene import BodyGeometry, Vector
from tests.geometry.template_strategies import orientations, sizes, templates
from tests.geometry.geometry_checks import is_closed, is_convex, is_inside, shape_bounds, visual_bounds, volume

each_kind = pytest.mark.parametrize("kind", SHAPE_TEMPLATES)
few = settings(max_examples=5, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


@each_kind
@few
@given(data=st.data(), size=sizes, way=orientations)
def test_visuals_fill_the_size_are_closed_and_face_outwards(
    kind: str, data: st.DataObject, size: Vector, way: tuple[BodySide, BodySide]
) -> None:
    form = _built(kind, data, size, way)
    low, high = visual_bounds(form)
    half = np.array(size) / 2
    assert np.allclose(low, -half, rtol=0, atol=1e-9)
    assert np.allclose(high, half, rtol=0, atol=1e-9)
    for skin in form.visuals:
        assert is_closed(skin)
        assert volume(skin) > 0.0
        if skin.normals is not None:
            assert np.allclose(np.linalg.norm(skin.normals, axis=1), 1.0)


@each_kind
@few
@given(data=st.data(), size=sizes, way=orientations)
def test_collision_shapes_are_convex_and_within_the_size(
    kind: str, data: st.DataObject, size: Vector, way: tuple[BodySide, BodySide]
) -> None:
    form = _built(kind, data, size, way)
    half = np.array(size) / 2
    assert form.collision_shapes
    for solid in form.collision_shapes:
        assert is_convex(solid)
        low, high = shape_bounds(solid)
        assert np.all(low >= -half - 1e-9)
        assert np.all(high <= half + 1e-9)


@each_kind
@few
@given(data=st.data(), size=sizes, way=orientations)
def test_support_surfaces_are_within_the_body_with_their_clearance(
    kind: str, data: st.DataObject, size: Vector, way: tuple[BodySide, BodySide]
) -> None:
    form = _built(kind, data, size, way)
    half = np.array(size) / 2
    for place in form.support_surfaces:
        center, up = np.array(place.center), np.array(way[0].vector)
        assert place.normal == way[0].vector
        across = np.insert(np.array(place.size), way[0].axis, 0.0)
        assert np.all(np.abs(center) + across / 2 <= half + 1e-9)
        above = [1e-6] if place.clearance is None else np.linspace(1e-6, place.clearance - 1e-6, 5)
        for height in above:
            spot = center + height * up
            assert not any(is_inside(solid, spot, margin=1e-7) for solid in form.collision_shapes)
        beneath = [center - depth * up for depth in (1e-7, 1e-5)]
        assert any(is_inside(solid, spot) for solid in form.collision_shapes for spot in beneath), "nothing holds it up"


@each_kind
@few
@given(data=st.data(), size=sizes, other=sizes)
def test_equal_geometry_has_equal_keys_and_different_geometry_does_not(
    kind: str, data: st.DataObject, size: Vector, other: Vector
) -> None:
    design = data.draw(templates(kind))
    form = build_geometry(design, size)
    assert build_geometry(_copied(design), size, reason="for another reason").key == form.key
    assert (build_geometry(design, other).key == form.key) == (size == other)
    assert build_geometry(design, size, friction=0.25).key != form.key


def _built(kind: str, data: st.DataObject, size: Vector, way: tuple[BodySide, BodySide]) -> BodyGeometry:
    return build_geometry(data.draw(templates(kind)), size, up=way[0], front=way[1])


def _copied(design: ShapeTemplate) -> ShapeTemplate:
    return type(design)(**{name: getattr(design, name) for name in design.__struct_fields__})


def test_visuals_and_key_are_computed_once_on_first_access() -> None:
    form = build_geometry(template_by_name("mug"), (0.08, 0.08, 0.0937))
    with pytest.raises(AttributeError):
        object.__getattribute__(form, "visuals")
    with pytest.raises(AttributeError, match="color"):
        form.color  # type: ignore[attr-defined]  # noqa: B018
    assert form.visuals is form.visuals
    assert form.key == build_geometry(template_by_name("mug"), (0.08, 0.08, 0.0937), reason="again").key
    assert replace(form, friction=0.5).visuals is form.visuals
