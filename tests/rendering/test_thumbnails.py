"""Small pictures of classes."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mindstage import KnowledgeBase
from mindstage.rendering.thumbnails import render_thumbnail
from mindstage.scene import (
    Body,
    BodyGeometry,
    BodyId,
    CollisionShape,
    CollisionShapeType,
    Color,
    Iri,
    Material,
    Pose,
    Vector,
)

RED: Color = (1.0, 0.0, 0.0)


def picture_of(*shapes: CollisionShape, size: int = 64) -> NDArray[np.uint8]:
    body = Body(
        id=BodyId("it"),
        iri=Iri("http://a/it"),
        cls=Iri("http://a/Thing"),
        pose=Pose(),
        materials=(Material(name="red", color=RED),),
    )
    geometry = BodyGeometry("k", (), shapes)
    png = render_thumbnail(body, geometry, KnowledgeBase().shape_rule(body.cls), size=size)
    return np.array(Image.open(io.BytesIO(png)))


def box(size: Vector, at: Vector = (0.0, 0.0, 0.0)) -> CollisionShape:
    return CollisionShape(size=size, pose=Pose(at))


def test_a_box_has_three_visible_sides_of_its_color_from_bright_to_dark() -> None:
    pixels = picture_of(box((0.4, 0.4, 0.4)))
    assert pixels.shape == (64, 64, 4)
    solid = pixels[pixels[..., 3] == 255]
    assert 0.4 < len(solid) / 64**2 < 0.9
    assert (solid[:, 1:3] == 0).all(), "nothing else is drawn"
    shades, counts = np.unique(solid[:, 0], return_counts=True)
    sides = [int(shade) for shade, count in zip(shades, counts, strict=True) if count > 0.1 * len(solid)]
    assert len(sides) == 3
    top, bottom = pixels[12, 32, 0], pixels[50, (16, 48), 0]
    assert (bottom < top).all(), "the top is the brightest"


def test_a_picture_is_filled_and_the_background_is_transparent() -> None:
    for size in ((0.4, 0.4, 0.4), (0.05, 0.05, 1.0), (1.0, 1.0, 0.05)):
        alpha = picture_of(box(size))[..., 3]
        rows, columns = np.flatnonzero(alpha.any(axis=1)), np.flatnonzero(alpha.any(axis=0))
        assert max(np.ptp(rows), np.ptp(columns)) >= 54, "it is as large as the picture, but for a margin"
        assert abs((rows[0] + rows[-1]) / 2 - 31.5) < 1.5
        assert abs((columns[0] + columns[-1]) / 2 - 31.5) < 1.5
        assert not alpha[[0, 0, -1, -1], [0, -1, 0, -1]].any()


def test_what_is_nearer_hides_what_is_behind() -> None:
    ball = CollisionShape(type=CollisionShapeType.SPHERE, size=(0.2, 0.2, 0.2))
    alone = picture_of(box((0.4, 0.4, 0.4)))
    for shapes in ((ball, box((0.4, 0.4, 0.4))), (box((0.4, 0.4, 0.4)), ball)):
        assert (picture_of(*shapes) == alone).all(), "the ball is inside the box"
