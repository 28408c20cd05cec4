"""Properties of every shape template, for random sizes, parameters and orientations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mindstage.geometry import SHAPE_TEMPLATES, BodySide, ShapeTemplate, build_geometry, template_by_name
from mindstage.scene import BodyGeometry, Vector
from tests.geometry.geometry_checks import is_closed, is_convex, is_inside, shape_bounds, visual_bounds, volume
from tests.geometry.template_strategies import orientations, sizes, templates

EACH_SHAPE = pytest.mark.parametrize("shape_name", SHAPE_TEMPLATES)
FEW_EXAMPLES = settings(max_examples=5, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


@EACH_SHAPE
@FEW_EXAMPLES
@given(data=st.data(), size=sizes, orientation=orientations)
def test_visuals_fill_the_size_are_closed_and_face_outwards(
    shape_name: str, data: st.DataObject, size: Vector, orientation: tuple[BodySide, BodySide]
) -> None:
    geometry = _built(shape_name, data, size, orientation)
    low, high = visual_bounds(geometry)
    half = np.array(size) / 2
    assert np.allclose(low, -half, rtol=0, atol=1e-9)
    assert np.allclose(high, half, rtol=0, atol=1e-9)
    for visual in geometry.visuals:
        assert is_closed(visual)
        assert volume(visual) > 0.0
        if visual.normals is not None:
            assert np.allclose(np.linalg.norm(visual.normals, axis=1), 1.0)


@EACH_SHAPE
@FEW_EXAMPLES
@given(data=st.data(), size=sizes, orientation=orientations)
def test_collision_shapes_are_convex_and_within_the_size(
    shape_name: str, data: st.DataObject, size: Vector, orientation: tuple[BodySide, BodySide]
) -> None:
    geometry = _built(shape_name, data, size, orientation)
    half = np.array(size) / 2
    assert geometry.collision_shapes
    for shape in geometry.collision_shapes:
        assert is_convex(shape)
        low, high = shape_bounds(shape)
        assert np.all(low >= -half - 1e-9)
        assert np.all(high <= half + 1e-9)


@EACH_SHAPE
@FEW_EXAMPLES
@given(data=st.data(), size=sizes, orientation=orientations)
def test_support_surfaces_are_within_the_body_with_their_clearance(
    shape_name: str, data: st.DataObject, size: Vector, orientation: tuple[BodySide, BodySide]
) -> None:
    geometry = _built(shape_name, data, size, orientation)
    half = np.array(size) / 2
    for surface in geometry.support_surfaces:
        center, up = np.array(surface.center), np.array(orientation[0].vector)
        assert surface.normal == orientation[0].vector
        across = np.insert(np.array(surface.size), orientation[0].axis, 0.0)
        assert np.all(np.abs(center) + across / 2 <= half + 1e-9)
        above = [1e-6] if surface.clearance is None else np.linspace(1e-6, surface.clearance - 1e-6, 5)
        for height in above:
            point = center + height * up
            assert not any(is_inside(shape, point, margin=1e-7) for shape in geometry.collision_shapes)
        beneath = [center - depth * up for depth in (1e-7, 1e-5)]
        assert any(is_inside(shape, point) for shape in geometry.collision_shapes for point in beneath), (
            "nothing holds it up"
        )


@EACH_SHAPE
@FEW_EXAMPLES
@given(data=st.data(), size=sizes, other=sizes)
def test_equal_geometry_has_equal_keys_and_different_geometry_does_not(
    shape_name: str, data: st.DataObject, size: Vector, other: Vector
) -> None:
    template = data.draw(templates(shape_name))
    geometry = build_geometry(template, size)
    assert build_geometry(_copied(template), size, reason="for another reason").key == geometry.key
    assert (build_geometry(template, other).key == geometry.key) == (size == other)
    assert build_geometry(template, size, friction=0.25).key != geometry.key


def _built(shape_name: str, data: st.DataObject, size: Vector, orientation: tuple[BodySide, BodySide]) -> BodyGeometry:
    return build_geometry(data.draw(templates(shape_name)), size, up=orientation[0], front=orientation[1])


def _copied(template: ShapeTemplate) -> ShapeTemplate:
    return type(template)(**{name: getattr(template, name) for name in template.__struct_fields__})


def test_visuals_and_key_are_computed_once_on_first_access() -> None:
    geometry = build_geometry(template_by_name("mug"), (0.08, 0.08, 0.0937))
    with pytest.raises(AttributeError):
        object.__getattribute__(geometry, "visuals")
    with pytest.raises(AttributeError, match="color"):
        geometry.color  # type: ignore[attr-defined]  # noqa: B018
    assert geometry.visuals is geometry.visuals
    assert geometry.key == build_geometry(template_by_name("mug"), (0.08, 0.08, 0.0937), reason="again").key
    assert replace(geometry, friction=0.5).visuals is geometry.visuals
