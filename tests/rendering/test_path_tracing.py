"""Path-traced pictures: energy, directions, projection, textures, noise, highlights, films."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

pytest.importorskip("mitsuba", reason="needs the extra render")

from mindstage.engines import NullEngine
from mindstage.errors import InvalidArgumentError, RendererUnavailableError
from mindstage.knowledge import KnowledgeBase
from mindstage.rendering import path_tracing
from mindstage.rendering.camera import CameraPose
from mindstage.rendering.films import FilmWriter
from mindstage.rendering.mitsuba_scene import MitsubaScene, Sky, luminance, use_mitsuba
from mindstage.rendering.path_tracing import PathTracingSettings, automatic_exposure, path_trace, tone_mapped
from mindstage.rendering.render_scene import RenderItem, RenderLight, RenderScene
from mindstage.scene import Body, BodyId, Color, Iri, LightType, Material, PbrMaterial, Pose, Vector, VisualMesh, World
from mindstage.scene.mesh import box
from mindstage.scene.transforms import Array
from mindstage.simulation import Simulation

GRAY: Color = (0.5, 0.5, 0.5)
SIZE = (60, 60)


def item(
    id: str,
    size: Vector,
    position: Vector,
    color: Color = GRAY,
    *,
    highlight: Color | None = None,
    opacity: float = 1.0,
) -> RenderItem:
    """A box of a dull material."""
    mesh = box(size)
    material = PbrMaterial(color=color, roughness=1.0, opacity=opacity)
    visual = VisualMesh(mesh.points, mesh.faces, material, mesh.normals)
    return RenderItem(id=BodyId(id), visuals=(visual,), pose=Pose(position), size=size, key=id, highlight=highlight)


def scene_of(*items: RenderItem, camera: CameraPose, lights: tuple[RenderLight, ...] = ()) -> RenderScene:
    """A scene without a ground."""
    return RenderScene(items=items, lights=lights, ground_height=None, camera=camera)


FLOOR = item("floor", (8.0, 8.0, 0.1), (0.0, 0.0, -0.05))
FROM_ABOVE = CameraPose((0.0, -0.001, 10.0), (0.0, 0.0, 0.0), math.radians(40.0))


def settings(**changes: object) -> PathTracingSettings:
    """Settings of a small picture with noise."""
    return PathTracingSettings(**{"size": SIZE, "samples": 16, "denoise": False, "sun_azimuth_rad": 0.0} | changes)


def test_a_level_surface_has_the_radiance_of_its_illuminance() -> None:
    picture = path_trace(scene_of(FLOOR, camera=FROM_ABOVE), settings(samples=24))
    middle = luminance(picture.radiance[20:40, 20:40].astype(float)).mean()
    sky = Sky(sun_azimuth_rad=0.0)
    illuminance = sky.sky_lx + sky.sun_lx * math.sin(sky.sun_elevation_rad)
    albedo = 0.214  # of sRGB 0.5
    assert middle == pytest.approx(albedo * illuminance / math.pi, rel=0.2)


def test_a_white_body_reflects_no_more_light_than_it_receives() -> None:
    white = item("floor", (8.0, 8.0, 0.1), (0.0, 0.0, -0.05), (1.0, 1.0, 1.0))
    picture = path_trace(scene_of(white, camera=FROM_ABOVE), settings(samples=24))
    middle = luminance(picture.radiance[20:40, 20:40].astype(float)).mean()
    sky = Sky(sun_azimuth_rad=0.0)
    illuminance = sky.sky_lx + sky.sun_lx * math.sin(sky.sun_elevation_rad)
    assert 0.8 * illuminance / math.pi < middle < 1.1 * illuminance / math.pi


@pytest.mark.parametrize("azimuth_rad", [0.0, math.pi / 2, -2.5])
def test_shadows_fall_away_from_the_sun(azimuth_rad: float) -> None:
    pole = item("pole", (0.5, 0.5, 2.0), (0.0, 0.0, 1.0))
    picture = path_trace(scene_of(FLOOR, pole, camera=FROM_ABOVE), settings(sun_azimuth_rad=azimuth_rad))
    away = np.array([math.cos(azimuth_rad), math.sin(azimuth_rad)])
    shadow, lit = (_at(picture.radiance, -side * 1.2 * away) for side in (1, -1))
    assert shadow < 0.6 * lit


def _at(radiance: NDArray[np.float32], point: Array) -> float:
    """The mean luminance about a point of the floor, seen from above."""
    scale = SIZE[1] / 2 / math.tan(math.radians(20.0)) / 10.0
    column, row = SIZE[0] / 2 + scale * point[0], SIZE[1] / 2 - scale * point[1]
    part = radiance[int(row) - 1 : int(row) + 2, int(column) - 1 : int(column) + 2]
    return float(luminance(part.astype(float)).mean())


@pytest.mark.parametrize("shift", [0.0, 0.25])
def test_a_body_is_drawn_where_the_camera_projects_it(shift: float) -> None:
    point = np.array([1.0, 0.7, 0.4])
    red = item("red", (0.2, 0.2, 0.2), (1.0, 0.7, 0.4), (0.9, 0.02, 0.02))
    camera = CameraPose((4.0, -3.0, 2.5), (0.2, 0.1, 0.3), math.radians(45.0), shift)
    width, height = 160, 100
    picture = path_trace(scene_of(FLOOR, red, camera=camera), settings(size=(width, height)))
    ahead = np.subtract(camera.look_at, camera.position)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    local = point - camera.position
    depth, focal = local @ ahead, height / 2 / math.tan(camera.field_of_view_rad / 2)
    expected = (
        width / 2 + focal * (local @ right) / depth,
        height / 2 - focal * (local @ np.cross(right, ahead)) / depth - shift * height,
    )
    pixels = picture.pixels.astype(int)
    rows, columns = np.nonzero(pixels[..., 0] > 2 * pixels[..., 1] + 20)
    assert rows.size > 10
    assert (columns.mean() + 0.5, rows.mean() + 0.5) == pytest.approx(expected, abs=1.0)


def test_of_surfaces_in_one_plane_that_of_the_smaller_body_is_drawn() -> None:
    turn = (math.cos(0.15), 0.0, 0.0, math.sin(0.15))
    bodies = (
        item("blue", (2.4, 1.7, 1.03), (0.0, 0.0, 0.0), (0.02, 0.02, 0.9)),
        item("red", (2.0, 1.9, 1.03), (0.0, 0.0, 0.0), (0.9, 0.02, 0.02)),
    )
    turned = [replace(each, pose=Pose((0.37, 0.21, 0.515), turn)) for each in bodies]
    camera = CameraPose((2.0, -3.0, 3.4), (0.37, 0.21, 1.03), math.radians(10.0))
    pixels = path_trace(scene_of(FLOOR, *turned, camera=camera), settings()).pixels.astype(int)
    assert np.all(np.argmax(pixels, axis=2) == 0)


def test_a_section_removes_what_is_above_and_shows_insides_dark() -> None:
    tower = item("tower", (2.0, 2.0, 2.0), (0.0, 0.0, 1.1), (0.9, 0.9, 0.9))
    whole = scene_of(FLOOR, tower, camera=FROM_ABOVE)
    top = _at(path_trace(whole, settings()).radiance, np.zeros(2))
    cut = path_trace(replace(whole, clip_height=1.0), settings()).radiance
    above = path_trace(replace(whole, clip_height=2.5), settings()).radiance
    assert _at(cut, np.zeros(2)) < 0.1 * top, "the inside of the bottom"
    assert _at(cut, np.array([2.0, 0.0])) > 0.1 * top, "the floor"
    assert _at(above, np.zeros(2)) == pytest.approx(top, rel=0.1)


def test_an_image_is_neither_mirrored_nor_upside_down() -> None:
    image = np.full((2, 2, 4), 255, dtype=np.uint8)
    image[0, 0, :3], image[0, 1, :3] = (255, 0, 0), (0, 255, 0)  # upper left, upper right
    image[1, 0, :3], image[1, 1, :3] = (0, 0, 255), (40, 40, 40)
    points = np.array([[-1.0, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
    uv = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    visual = VisualMesh(points, faces, PbrMaterial(color=(1.0, 1.0, 1.0), roughness=1.0), uv=uv, image=image)
    poster = RenderItem(id=BodyId("poster"), visuals=(visual,), pose=Pose(), size=(2.0, 0.01, 2.0))
    camera = CameraPose((0.0, -5.0, 0.0), (0.0, 0.0, 0.0), math.radians(22.0))
    pixels = path_trace(scene_of(poster, camera=camera), settings(sun_azimuth_rad=-1.5)).pixels.astype(int)
    low, high = SIZE[0] // 4, 3 * SIZE[0] // 4
    assert np.argmax(pixels[low, low]) == 0
    assert np.argmax(pixels[low, high]) == 1
    assert np.argmax(pixels[high, low]) == 2
    assert np.ptp(pixels[high, high]) < 40


def test_equal_seeds_give_equal_pictures() -> None:
    scene = scene_of(FLOOR, item("pole", (0.5, 0.5, 2.0), (0.0, 0.0, 1.0)), camera=FROM_ABOVE)
    first, second, other = (path_trace(scene, settings(samples=2, seed=seed)) for seed in (1, 1, 2))
    assert np.array_equal(first.radiance, second.radiance)
    assert not np.array_equal(first.radiance, other.radiance)


def test_the_denoiser_lowers_the_error() -> None:
    camera = CameraPose((3.0, -3.0, 2.5), (0.0, 0.0, 0.5), math.radians(45.0))
    scene = scene_of(FLOOR, item("pole", (0.5, 0.5, 1.0), (0.0, 0.0, 0.5), (0.8, 0.3, 0.2)), camera=camera)
    reference = path_trace(scene, settings(samples=96, seed=9)).radiance
    noisy, clean = (path_trace(scene, settings(samples=4, denoise=denoise)).radiance for denoise in (False, True))
    errors = [float(np.sqrt(np.mean((each - reference) ** 2))) for each in (noisy, clean)]
    assert errors[1] < 0.6 * errors[0]


def test_a_highlighted_body_is_outlined_also_behind_others_which_become_gray() -> None:
    blue: Color = (0.1, 0.2, 0.9)
    hidden = item("hidden", (0.4, 0.4, 0.4), (0.0, 0.6, 0.5), highlight=blue)
    front = item("front", (1.6, 0.1, 1.6), (0.0, -0.4, 0.8), (0.9, 0.1, 0.1))
    camera = CameraPose((0.0, -5.0, 1.0), (0.0, 0.0, 0.7), math.radians(30.0))
    picture = path_trace(scene_of(FLOOR, front, hidden, camera=camera), settings(size=(120, 120), samples=8))
    pixels = picture.pixels.astype(int)
    assert np.count_nonzero(np.abs(pixels - np.array([26, 51, 230])).max(axis=-1) < 30) > 20
    assert np.count_nonzero(pixels.min(axis=-1) > 250) > 20
    assert np.count_nonzero(pixels[..., 0] > pixels[..., 1] + 90) == 0


@pytest.mark.parametrize("opacity", [1.0, 0.6])
def test_a_marker_keeps_its_color_beside_highlighted_bodies_and_is_no_glass(opacity: float) -> None:
    blue: Color = (0.1, 0.2, 0.9)
    chosen = item("chosen", (0.5, 0.5, 0.5), (1.2, 0.0, 0.25), highlight=blue)
    marker = replace(
        item("marker m", (0.6, 0.6, 0.6), (-0.8, 0.0, 0.3), (0.9, 0.1, 0.1), opacity=opacity), is_marker=True
    )
    camera = CameraPose((0.0, -5.0, 2.0), (0.0, 0.0, 0.3), math.radians(30.0))
    picture = path_trace(scene_of(FLOOR, chosen, marker, camera=camera), settings(size=(120, 80), samples=16))
    pixels = picture.pixels.astype(int)
    red = pixels[..., 0] > pixels[..., 1] + (90 if opacity == 1.0 else 40)
    assert np.count_nonzero(red[:, :60]) > 200
    assert np.count_nonzero(red[:, 60:]) == 0


def _room(*, with_lamp: bool) -> RenderScene:
    walls = [
        item("floor", (4.0, 4.0, 0.1), (0.0, 0.0, -0.05)),
        item("ceiling", (4.0, 4.0, 0.1), (0.0, 0.0, 2.45)),
        *(item(f"wall_{x}", (0.1, 4.2, 2.6), (2.0 * x, 0.0, 1.2)) for x in (-1, 1)),
        *(item(f"side_{y}", (4.2, 0.1, 2.6), (0.0, 2.0 * y, 1.2)) for y in (-1, 1)),
    ]
    lamp = RenderLight(type=LightType.POINT, pose=Pose((0.0, 0.0, 2.0)), color=(1.0, 1.0, 1.0), intensity=60.0)
    camera = CameraPose((-1.2, -1.2, 1.6), (1.0, 1.0, 1.0), math.radians(60.0))
    return scene_of(*walls, camera=camera, lights=(lamp,) if with_lamp else ())


def test_a_closed_room_without_a_lamp_gets_one_which_is_reported() -> None:
    dark, lit = (path_trace(_room(with_lamp=lamp), settings(samples=8)) for lamp in (False, True))
    assert "has no lamp" in " ".join(dark.notes)
    assert not lit.notes
    assert min(dark.pixels.mean(), lit.pixels.mean()) > 60


def test_a_lamp_gives_the_illuminance_of_its_intensity() -> None:
    room = _room(with_lamp=True)
    native = MitsubaScene(room, sky=Sky(sun_azimuth_rad=0.0))
    integrator = use_mitsuba().load_dict({"type": "volpath", "max_depth": 2})
    camera = CameraPose((0.0, -0.001, 1.9), (0.0, 0.0, 0.0), math.radians(10.0))
    image = path_tracing._render(native.native, native.sensor(camera, SIZE), integrator, 64, 1)
    direct = 60.0 / 2.0**2  # [lx]
    assert luminance(image.astype(float)).mean() == pytest.approx(0.214 * direct / math.pi, rel=0.2)


def test_the_sun_shines_through_a_pane_of_glass() -> None:
    pane = item("pane", (6.0, 6.0, 0.01), (0.0, 0.0, 2.0), (0.95, 0.95, 0.95), opacity=0.15)
    camera = CameraPose((3.0, -2.0, 1.5), (0.0, 0.0, 0.0), math.radians(20.0))
    open_air, behind = (path_trace(scene_of(*items, camera=camera), settings()) for items in ((FLOOR,), (FLOOR, pane)))
    assert 0.6 < behind.radiance.mean() / open_air.radiance.mean() < 1.0


def _pane(opacity: float) -> RenderItem:
    """A pane of glass between the camera and the middle of the floor; its shadow is elsewhere."""
    return item("pane", (0.4, 0.4, 0.01), (0.0, 0.0, 9.0), (0.3, 0.3, 0.3), opacity=opacity)


@pytest.mark.parametrize("opacity", [0.2, 0.5, 0.8])
def test_a_pane_absorbs_light_once_though_it_has_two_surfaces(opacity: float) -> None:
    scene = scene_of(FLOOR, camera=FROM_ABOVE)
    bare, through = (
        luminance(path_trace(each, settings(samples=32)).radiance[25:35, 25:35].astype(float)).mean()
        for each in (scene, replace(scene, items=(FLOOR, _pane(opacity))))
    )
    color = 0.073  # of sRGB 0.3
    kept = (1 - opacity + opacity * color) * (1 - 0.5 * opacity)
    reflected = 0.077  # by each surface
    zenith = luminance(Sky(sun_azimuth_rad=0.0).image()[0].astype(float)).mean()
    expected = kept * (1 - reflected) ** 2 * bare + reflected * (1 + kept) * zenith
    assert through == pytest.approx(expected, rel=0.08)


def test_the_denoiser_sees_the_form_of_glass_and_the_color_behind_it() -> None:
    red = item("floor", (8.0, 8.0, 0.1), (0.0, 0.0, -0.05), (0.9, 0.1, 0.1))
    pane = replace(_pane(0.3), pose=Pose((0.0, 0.0, 9.0), (math.cos(math.pi / 8), math.sin(math.pi / 8), 0.0, 0.0)))
    made = MitsubaScene(scene_of(red, pane, camera=FROM_ABOVE), sky=Sky(sun_azimuth_rad=0.0))
    albedo, normal = path_tracing._features(made, FROM_ABOVE, settings())
    tilted = [0.0, -math.sin(math.pi / 4), math.cos(math.pi / 4)]
    assert normal[28:32, 28:32].mean(axis=(0, 1)) == pytest.approx(tilted, abs=0.05)
    assert normal[5, 5] == pytest.approx([0.0, 0.0, 1.0], abs=0.05)
    assert albedo[28:32, 28:32].mean(axis=(0, 1)) == pytest.approx(albedo[5, 5], abs=0.02)


def test_a_picture_without_bright_parts_gets_more_light() -> None:
    gray = np.full((20, 20, 3), 100.0)
    dull, bright = gray.copy(), gray.copy()
    dull[:2], bright[:2] = 200.0, 1000.0
    factors = [automatic_exposure(each) for each in (dull, bright)]
    assert tone_mapped(dull[:2] * factors[0]).max() < 250
    assert factors[0] > 1.3 * factors[1]


def test_a_budget_of_time_ends_the_passes() -> None:
    scene = scene_of(FLOOR, camera=FROM_ABOVE)
    picture = path_trace(scene, settings(samples=100_000, seconds=0.2))
    assert 4 <= picture.samples < 100_000


def test_tone_mapping_is_monotonic_and_keeps_gray() -> None:
    values = np.linspace(0.0, 20.0, 400)[:, None] * np.ones(3)
    mapped = tone_mapped(values).astype(int)
    assert np.all(np.diff(mapped[:, 0]) >= 0)
    assert np.all(np.ptp(mapped, axis=1) <= 1)
    assert mapped[0, 0] == 0
    assert mapped[-1, 0] > 245


@pytest.mark.parametrize("channel", [0, 1, 2])
def test_bright_lights_of_a_pure_color_are_still_distinguished(channel: int) -> None:
    values = np.zeros((5, 3))
    values[:, channel] = (0.5, 1.0, 1.5, 2.0, 3.0)
    mapped = tone_mapped(values).astype(int)
    assert np.all(np.diff(mapped[:, channel]) > 3)
    assert mapped[-1, channel] < 253
    assert not np.delete(mapped, channel, axis=1).any()


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp", ".exr"])
def test_a_picture_is_a_file_of_its_size(suffix: str, tmp_path: Path) -> None:
    picture = path_trace(scene_of(FLOOR, camera=FROM_ABOVE), settings(size=(40, 24), samples=1))
    path = tmp_path / f"picture{suffix}"
    path.write_bytes(picture.encode(suffix))
    if suffix == ".exr":
        read = np.array(use_mitsuba().Bitmap(str(path)))
        assert np.allclose(read, picture.radiance, rtol=1e-3)
    else:
        from PIL import Image

        with Image.open(path) as image:
            assert image.size == (40, 24)


def test_an_unknown_suffix_and_a_bad_size_are_refused() -> None:
    scene = scene_of(FLOOR, camera=FROM_ABOVE)
    picture = path_trace(scene, settings(size=(16, 16), samples=1))
    with pytest.raises(InvalidArgumentError, match=r"there is \.png"):
        picture.encode(".bmp")
    with pytest.raises(InvalidArgumentError, match="size"):
        path_trace(scene, settings(size=(4, 100_000)))


def test_a_missing_library_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ModuleNotFoundError(f"No module named {name!r}")

    monkeypatch.setattr(path_tracing, "import_module", missing)
    with pytest.raises(RendererUnavailableError, match=r"mindstage\[render\]"):
        path_tracing.check_renderer()


@pytest.mark.parametrize("suffix", [".mp4", ".webp"])
def test_a_film_has_its_frames_and_size(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"film{suffix}"
    frames = [np.full((32, 48, 3), 40 * number, dtype=np.uint8) for number in range(5)]
    with FilmWriter(path, size=(48, 32), frame_rate_hz=10.0) as film:
        for frame in frames:
            film.add(frame)
    brightness = [float(frame.mean()) for frame in _frames(path)]
    assert len(brightness) == 5
    assert brightness == pytest.approx([0, 40, 80, 120, 160], abs=8)
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def _frames(path: Path) -> list[NDArray[np.uint8]]:
    if path.suffix == ".webp":
        from PIL import Image, ImageSequence

        with Image.open(path) as image:
            return [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(image)]
    import av

    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def test_an_interrupted_film_leaves_no_file(tmp_path: Path) -> None:
    def interrupted() -> None:
        with FilmWriter(tmp_path / "film.mp4", size=(48, 32), frame_rate_hz=10.0) as film:
            film.add(np.zeros((32, 48, 3), dtype=np.uint8))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert not list(tmp_path.iterdir())


def test_a_film_of_an_odd_size_is_refused(tmp_path: Path) -> None:
    for size in ((47, 32), (48, 31)):
        with pytest.raises(InvalidArgumentError, match=f"even numbers, not {size[0]}x{size[1]}"):
            FilmWriter(tmp_path / "film.mp4", size=size, frame_rate_hz=10.0)
    assert not list(tmp_path.iterdir())


def test_a_wide_picture_of_a_simulation_shows_a_square_as_a_square() -> None:
    iri = Iri("http://example.org/room")
    red = Material(name="red", color=(0.9, 0.02, 0.02))
    plate = Body(
        id=BodyId("plate"),
        iri=Iri(f"{iri}#plate"),
        cls=Iri(f"{iri}#Plate"),
        pose=Pose(),
        size=(2.0, 2.0, 0.1),
        materials=(red,),
    )
    with Simulation(KnowledgeBase(), NullEngine(), primitive_shapes=True, threaded=False) as simulation:
        simulation.spawn(World(iri=iri, bodies=(plate,)))
        found = simulation.render(FROM_ABOVE, PathTracingSettings(size=(90, 45), samples=4, denoise=False))
    assert found.pixels.shape == (45, 90, 3)
    is_red = found.radiance[..., 0] > 3.0 * found.radiance[..., 1]
    height, width = (int(is_red.any(axis=axis).sum()) for axis in (1, 0))
    assert height == pytest.approx(45 / (10.0 * math.tan(math.radians(20.0))), abs=2)
    assert width == pytest.approx(height, abs=1)


def test_a_glowing_shade_has_the_luminance_of_the_light_that_is_in_it() -> None:
    mesh = box((0.4, 0.4, 0.4))
    white = VisualMesh(mesh.points, mesh.faces, PbrMaterial(color=(1.0, 1.0, 1.0), emission=0.5), mesh.normals)
    shades = [
        RenderItem(id=BodyId(id), visuals=(white,), pose=Pose((0.0, y, 1.0)), size=(0.4, 0.4, 0.4), key=id)
        for id, y in (("lit", 0.0), ("alone", 30.0))
    ]
    lights = (RenderLight(type=LightType.POINT, pose=Pose((0.0, 0.0, 1.0)), color=(1.0, 1.0, 1.0), intensity=90e3),)

    def radiance(y: float) -> float:
        camera = CameraPose((3.0, y, 1.0), (0.0, y, 1.0), math.radians(3.0))
        found = path_trace(scene_of(*shades, camera=camera, lights=lights), settings(samples=4))
        return float(luminance(found.radiance.astype(float)).mean())

    # Its flux of 4 pi I leaves through the six sides, each of which emits pi times its luminance.
    by_day = radiance(30.0)
    assert 0.5 * 4000.0 < by_day < 30e3
    assert radiance(0.0) - by_day == pytest.approx(4.0 * 90e3 / (6 * 0.4**2), rel=0.1)


def test_each_of_several_images_is_on_its_own_surface() -> None:
    points = np.array([[-1.0, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
    uv = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    posters = []
    for number, x in enumerate((-1.1, 1.1)):
        image = np.full((2, 2, 4), 255, dtype=np.uint8)
        image[..., 1 - number] = image[..., 2] = 20  # red on the left, green on the right
        visual = VisualMesh(points, faces, PbrMaterial(color=(1.0, 1.0, 1.0), roughness=1.0), uv=uv, image=image)
        id = BodyId(f"poster {number}")
        posters.append(RenderItem(id=id, visuals=(visual,), pose=Pose((x, 0.0, 0.0)), size=(2.0, 0.01, 2.0), key=id))
    camera = CameraPose((0.0, -10.0, 0.0), (0.0, 0.0, 0.0), math.radians(26.0))
    pixels = path_trace(scene_of(*posters, camera=camera), settings(sun_azimuth_rad=-1.5)).pixels.astype(int)
    half = SIZE[0] // 2
    assert [int(np.argmax(pixels[half, column])) for column in (half // 2, half + half // 2)] == [0, 1]
