"""The rasterizer: shadows, relief and roughness of textures, what is behind what, sections, and missing libraries."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from mindstage.errors import RendererUnavailableError
from mindstage.rendering import CameraPose, gl_context, rasterizer
from mindstage.rendering.camera import ViewFrame
from mindstage.rendering.rasterizer import render_picture, sun_direction
from mindstage.rendering.render_scene import RenderItem, RenderLabel, RenderLight, RenderScene
from mindstage.scene import BodyId, LightType, PbrMaterial, Pose, Vector, VisualMesh
from mindstage.scene.mesh import box
from tests.cases import each_case

SIZE = (240, 160)
CAMERA = CameraPose((0.0, -4.0, 3.0), (0.0, 0.0, 0.3), 0.6)
MATT = PbrMaterial(color=(0.6, 0.6, 0.6), roughness=1.0)


def item(id: str, at: Vector, size: Vector, material: PbrMaterial = MATT, **fields: object) -> RenderItem:
    mesh = box(size)
    visual = VisualMesh(mesh.points, mesh.faces, material, mesh.normals)
    return RenderItem(id=BodyId(id), visuals=(visual,), pose=Pose(at), size=size, **fields)


def floor(half: float, material: PbrMaterial, repeat: float = 1.0) -> RenderItem:
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    points = np.column_stack([corners, np.zeros(4)])
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
    visual = VisualMesh(points, faces, material, np.tile([0.0, 0.0, 1.0], (4, 1)), uv=corners / repeat)
    return RenderItem(id=BodyId("floor"), visuals=(visual,), pose=Pose((0, 0, 0)), size=(2 * half, 2 * half, 0.01))


def scene(*items: RenderItem, camera: CameraPose = CAMERA, **fields: object) -> RenderScene:
    return RenderScene(items=items, lights=(), ground_height=None, camera=camera, **fields)


def pixel(at: Vector, camera: CameraPose = CAMERA) -> tuple[int, int]:
    """The row and the column of a point."""
    x, y, _ = ViewFrame(camera, SIZE).project(np.array([at]))[0]
    return int(y), int(x)


def around(picture: NDArray[np.uint8], at: Vector) -> NDArray[np.float64]:
    """The mean color near a point of the scene."""
    row, column = pixel(at)
    mean: NDArray[np.float64] = picture[row - 1 : row + 2, column - 1 : column + 2].astype(float).mean(axis=(0, 1))
    return mean


@each_case("extent", [1.0, 12.0, 80.0])
@each_case("azimuth", [0.0, 1.8, 3.6])
def test_surfaces_have_no_dots_of_their_own_shadow(extent: float, azimuth: float) -> None:
    distance = 2.2 * extent
    eye = (distance * np.cos(azimuth), distance * np.sin(azimuth), 1.3 * extent)
    camera = CameraPose(eye, (0.0, 0.0, 0.4 * extent), 0.6)
    block = item("block", (0.0, 0.0, 0.4 * extent), (extent, extent, 0.8 * extent))
    picture = render_picture(scene(block, camera=camera), SIZE).astype(float).mean(axis=2)
    # Of a convex body no point is in a shadow: the brightness of each side is smooth.
    view = ViewFrame(camera, SIZE)
    for axis, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0)):
        normal = np.zeros(3)
        normal[axis] = sign
        center = np.array([0.0, 0.0, 0.4 * extent]) + normal * (0.4 if axis == 2 else 0.5) * extent
        if float(normal @ (view.eye - center)) < 0.3 * extent:
            continue
        across = [each for each in range(3) if each != axis]
        grid = np.zeros((2601, 3)) + center
        u, v = (part.ravel() for part in np.meshgrid(np.linspace(-0.3, 0.3, 51), np.linspace(-0.3, 0.3, 51)))
        grid[:, across[0]] += u * extent
        grid[:, across[1]] += v * extent
        x, y, _ = view.project(grid).T
        brightness = picture[y.astype(int), x.astype(int)].reshape(51, 51)
        steps = [np.abs(np.diff(brightness, axis=each)).max() for each in (0, 1)]
        assert max(steps) < 6.0, f"the side {normal} has dots"


def test_a_body_casts_a_shadow_away_from_the_sun() -> None:
    sun = sun_direction(CAMERA)
    shadow = -0.35 * sun / sun[2]
    picture = render_picture(scene(floor(2.0, MATT), item("block", (0, 0, 0.35), (0.2, 0.2, 0.7))), SIZE)
    in_shadow, in_sun = (around(picture, (sign * shadow[0], sign * shadow[1], 0.0)).mean() for sign in (1, -1))
    assert in_shadow < 0.75 * in_sun
    light = item("block", (0, 0, 0.35), (0.2, 0.2, 0.7), casts_shadow=False)
    without = render_picture(scene(floor(2.0, MATT), light), SIZE)
    assert around(without, (shadow[0], shadow[1], 0.0)).mean() > 0.9 * in_sun


def levels_of(normal: Vector, roughness: float) -> Callable[[str, int], list[NDArray[np.uint8]]]:
    """A texture of one color, normal and roughness."""
    surface = np.rint([(normal[0] + 1) * 127.5, (normal[1] + 1) * 127.5, roughness * 255, 255]).astype(np.uint8)
    level = np.stack([np.full((1, 1, 4), 255, np.uint8), surface.reshape(1, 1, 4)])
    return lambda name, pixels: [level]


def with_texture(monkeypatch: pytest.MonkeyPatch, normal: Vector, roughness: float = 1.0) -> float:
    monkeypatch.setattr(rasterizer, "texture_levels", levels_of(normal, roughness))
    picture = render_picture(scene(floor(2.0, replaced(MATT, texture="oak_board"))), SIZE)
    return float(around(picture, (0.2, 0.2, 0.0)).mean())


def replaced(material: PbrMaterial, **fields: object) -> PbrMaterial:
    return msgspec.structs.replace(material, **fields)


def test_normal_maps_turn_the_surface_in_the_frame_of_the_texture(monkeypatch: pytest.MonkeyPatch) -> None:
    sun = sun_direction(CAMERA)
    x, y = 0.5 * sun[:2] / np.linalg.norm(sun[:2])
    toward, flat, away = (with_texture(monkeypatch, (s * x, s * y, 0.0)) for s in (1.0, 0.0, -1.0))
    assert toward > flat + 5
    assert flat > away + 15
    aside = [with_texture(monkeypatch, (-s * y, s * x, 0.0)) for s in (1.0, -1.0)]
    assert abs(aside[0] - aside[1]) < 8, "both are turned from the sun alike"


def test_roughness_maps_change_the_reflections(monkeypatch: pytest.MonkeyPatch) -> None:
    smooth, rough = (with_texture(monkeypatch, (0.0, 0.0, 0.0), roughness) for roughness in (0.1, 1.0))
    assert abs(smooth - rough) > 2


def test_a_body_in_a_closed_one_is_not_seen_and_one_in_glass_is() -> None:
    red = replaced(MATT, color=(0.9, 0.05, 0.05))
    glass = replaced(MATT, color=(0.9, 0.95, 1.0), opacity=0.2)
    inside = item("inside", (0, 0, 0.3), (0.3, 0.3, 0.3), red)
    closed = [item("case", (0, 0, 0.3), (0.6, 0.6, 0.6)), inside]
    empty = render_picture(scene(closed[0]), SIZE)
    assert np.array_equal(render_picture(scene(*closed), SIZE), empty)
    picture = render_picture(scene(item("case", (0, 0, 0.3), (0.6, 0.6, 0.6), glass), inside), SIZE)
    red_, green, _ = around(picture, (0, 0, 0.45))
    assert red_ > 2 * green


def test_highlighted_bodies_are_outlined_through_what_is_in_front() -> None:
    inside = item("inside", (0, 0, 0.3), (0.3, 0.3, 0.3), highlight=(0.0, 1.0, 0.0))
    picture = render_picture(scene(item("case", (0, 0, 0.3), (0.6, 0.6, 0.6)), inside), SIZE)
    red, green, blue = around(picture, (0, 0, 0.45))
    assert green > max(red, blue) + 20


def test_a_label_is_drawn_only_where_its_body_is_seen() -> None:
    hidden, front = item("hidden", (0.0, 1.0, 0.3), (0.3, 0.3, 0.3)), item("front", (0.0, 0.0, 0.3), (1.5, 0.1, 1.2))
    label = RenderLabel(text="hidden", point=(0.0, 1.0, 0.3), id=BodyId("hidden"), radius=0.26)
    open_view, blocked = scene(hidden), scene(hidden, front)
    drawn = [
        np.any(render_picture(each, SIZE) != render_picture(msgspec.structs.replace(each, labels=(label,)), SIZE))
        for each in (open_view, blocked)
    ]
    assert drawn == [True, False]


def test_a_section_shows_the_inside_dark() -> None:
    block = item("block", (0, 0, 0.3), (0.6, 0.6, 0.6))
    picture = render_picture(scene(block, clip_height=0.4), SIZE)
    assert around(picture, (0.0, 0.2, 0.4)).max() < 60
    assert around(render_picture(scene(block), SIZE), (0.0, 0.2, 0.6)).min() > 100


def test_pictures_of_nothing_show_the_background() -> None:
    picture = render_picture(scene(), SIZE)
    assert picture.shape == (160, 240, 3)
    assert picture.min() > 150


def test_missing_libraries_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str, **_: object) -> None:
        raise OSError(f"{name} is not here")

    monkeypatch.setattr(gl_context.ctypes, "CDLL", missing)
    with pytest.raises(RendererUnavailableError, match=r"EGL: libEGL.* is not here; OSMesa: .*not installed.*libegl1"):
        render_picture(scene(), SIZE)


def test_an_old_opengl_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gl_context, "_LEAST_VERSION", (9, 9))
    with pytest.raises(RendererUnavailableError, match=r"OpenGL .* is needed"):
        render_picture(scene(), SIZE)


def turned_block(yaw: float) -> RenderItem:
    """A block of 1 m, turned about the vertical."""
    block = item("block", (0.0, 0.0, 0.5), (1.0, 1.0, 1.0))
    return msgspec.structs.replace(
        block, pose=Pose((0.0, 0.0, 0.5), (float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2))))
    )


def sides(yaw: float) -> list[NDArray[np.float64]]:
    """The normals of the sides that the camera sees, of a turned block: two vertical ones, and the top."""
    normals = [np.array([np.cos(angle), np.sin(angle), 0.0]) for angle in yaw + np.arange(4) * np.pi / 2]
    eye = np.array(CAMERA.position) - (0.0, 0.0, 0.5)
    return [*(each for each in normals if each @ eye > 0.9), np.array([0.0, 0.0, 1.0])]


@each_case("yaw", [-0.6, -0.25, 0.25, 0.6, 2.2])
def test_a_side_is_brighter_the_more_it_faces_the_sun(yaw: float) -> None:
    sun = sun_direction(CAMERA)
    picture = render_picture(scene(turned_block(yaw)), SIZE)
    found = [
        (float(normal @ sun), around(picture, (0.0, 0.0, 0.5) + 0.5 * normal).mean()) for normal in sides(yaw)[:-1]
    ]
    assert len(found) == 2
    (less, dark), (more, bright) = sorted(found)
    assert more - less > 0.1
    assert bright > dark + 3.0


@pytest.mark.parametrize("place", [(-3.0, -3.0, 1.5), (3.0, -3.0, 1.5), (0.0, 0.0, 4.0)])
def test_a_lamp_lights_the_sides_that_face_it(place: Vector) -> None:
    yaw = np.pi / 4
    dark = scene(turned_block(yaw))
    lamp = RenderLight(type=LightType.POINT, pose=Pose(place), color=(1.0, 1.0, 1.0), intensity=400.0)
    before, after = (render_picture(each, SIZE) for each in (dark, msgspec.structs.replace(dark, lights=(lamp,))))
    gains, faced = [], []
    for normal in sides(yaw):
        center = np.array([0.0, 0.0, 0.5]) + 0.5 * normal
        gains.append(around(after, center).mean() - around(before, center).mean())
        faced.append(float(normal @ (np.array(place) - center)))
    assert int(np.argmax(gains)) == int(np.argmax(faced))
    for gain, distance in zip(gains, faced, strict=True):
        assert gain > 5.0 or distance < 1.0
        assert gain < 5.0 or distance > 0.0


def test_the_outline_of_a_body_is_centered_at_the_body() -> None:
    camera = CameraPose((0.0, -6.0, 1.0), (0.0, 0.0, 1.0), np.radians(40.0))
    cube = item("cube", (0.0, 0.0, 1.0), (1.0, 1.0, 1.0), highlight=(0.0, 1.0, 0.0))
    red, green, blue = np.moveaxis(render_picture(scene(cube, camera=camera), (121, 121)).astype(int), 2, 0)
    is_tinted = green > np.maximum(red, blue) + 15
    for axis in (0, 1):
        lines = np.flatnonzero(is_tinted.any(axis=axis))
        assert lines[0] + lines[-1] == pytest.approx(120, abs=1)
        assert 20 < lines[-1] - lines[0] < 60
