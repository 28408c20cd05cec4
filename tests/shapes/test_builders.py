"""Every kind of shape, in random sizes, with random parameters, lying any way: what is true of all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mindstage.shapes import DESIGNS, Design, Side, build, design_of
from mindstage.world import Form, Vector
from tests.shapes.designs import designs_of, orientations, sizes
from tests.shapes.judging import is_closed, is_convex, is_inside, reach, seen_extents, volume

each_kind = pytest.mark.parametrize("kind", DESIGNS)
few = settings(max_examples=5, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


@each_kind
@few
@given(data=st.data(), size=sizes, way=orientations)
def test_a_form_is_as_large_as_its_body_closed_and_looks_outwards(
    kind: str, data: st.DataObject, size: Vector, way: tuple[Side, Side]
) -> None:
    form = _built(kind, data, size, way)
    low, high = seen_extents(form)
    half = np.array(size) / 2
    assert np.allclose(low, -half, rtol=0, atol=1e-9)
    assert np.allclose(high, half, rtol=0, atol=1e-9)
    for skin in form.skins:
        assert is_closed(skin)
        assert volume(skin) > 0.0
        if skin.normals is not None:
            assert np.allclose(np.linalg.norm(skin.normals, axis=1), 1.0)


@each_kind
@few
@given(data=st.data(), size=sizes, way=orientations)
def test_what_can_be_touched_is_convex_and_within_the_size(
    kind: str, data: st.DataObject, size: Vector, way: tuple[Side, Side]
) -> None:
    form = _built(kind, data, size, way)
    half = np.array(size) / 2
    assert form.solids
    for solid in form.solids:
        assert is_convex(solid)
        low, high = reach(solid)
        assert np.all(low >= -half - 1e-9)
        assert np.all(high <= half + 1e-9)


@each_kind
@few
@given(data=st.data(), size=sizes, way=orientations)
def test_a_place_is_in_the_body_and_has_the_room_above_it_that_it_says(
    kind: str, data: st.DataObject, size: Vector, way: tuple[Side, Side]
) -> None:
    form = _built(kind, data, size, way)
    half = np.array(size) / 2
    for place in form.places:
        centre, up = np.array(place.centre), np.array(way[0].vector)
        assert place.up == way[0].vector
        across = np.insert(np.array(place.size), way[0].axis, 0.0)
        assert np.all(np.abs(centre) + across / 2 <= half + 1e-9)
        above = [1e-6] if place.height is None else np.linspace(1e-6, place.height - 1e-6, 5)
        for height in above:
            spot = centre + height * up
            assert not any(is_inside(solid, spot, margin=1e-7) for solid in form.solids)
        beneath = [centre - depth * up for depth in (1e-7, 1e-5)]
        assert any(is_inside(solid, spot) for solid in form.solids for spot in beneath), "nothing holds it up"


@each_kind
@few
@given(data=st.data(), size=sizes, other=sizes)
def test_the_same_form_has_the_same_key_and_another_one_another(
    kind: str, data: st.DataObject, size: Vector, other: Vector
) -> None:
    design = data.draw(designs_of(kind))
    form = build(design, size)
    assert build(_copied(design), size, why="for another reason").key == form.key
    assert (build(design, other).key == form.key) == (size == other)
    assert build(design, size, friction=0.25).key != form.key


def _built(kind: str, data: st.DataObject, size: Vector, way: tuple[Side, Side]) -> Form:
    return build(data.draw(designs_of(kind)), size, up=way[0], front=way[1])


def _copied(design: Design) -> Design:
    return type(design)(**{name: getattr(design, name) for name in design.__struct_fields__})


def test_skins_and_key_are_computed_when_first_read_and_only_once() -> None:
    form = build(design_of("mug"), (0.08, 0.08, 0.0937))
    with pytest.raises(AttributeError):
        object.__getattribute__(form, "skins")
    with pytest.raises(AttributeError, match="colour"):
        form.colour  # type: ignore[attr-defined]  # noqa: B018
    assert form.skins is form.skins
    assert form.key == build(design_of("mug"), (0.08, 0.08, 0.0937), why="again").key
    assert replace(form, friction=0.5).skins is form.skins
