"""Path-traced pictures: `RenderScene` through Mitsuba 3, denoised, exposed and tone-mapped like a photograph.

Rendering proceeds in passes of a few samples per pixel, so that progress is reported and a budget of time is kept. A
picture depends only on the scene, the size, the samples and the seed, unless the budget is a time.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from importlib import import_module
from io import BytesIO
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.access.limits import Deadline
from mindstage.errors import InvalidArgumentError, RendererUnavailableError
from mindstage.ranges import Angle, Count, Finite, NotNegative, PictureSize, Seed, check_fields
from mindstage.rendering.camera import CameraPose
from mindstage.rendering.mitsuba_scene import NORMAL_SCALE, MitsubaScene, Sky, luminance, use_mitsuba
from mindstage.rendering.render_scene import RenderScene
from mindstage.scene import Color
from mindstage.scene.colors import linear_to_srgb
from mindstage.scene.transforms import Array

__all__ = [
    "PICTURE_SUFFIXES",
    "PathTracedPicture",
    "PathTracingSettings",
    "automatic_exposure",
    "check_renderer",
    "path_trace",
    "sun_azimuth",
    "tone_mapped",
]


PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".exr")
"""The formats of `PathTracedPicture.encode`."""

_PASS_SAMPLES = 4
_FEATURE_SAMPLES = 8
"""Samples per pixel of the albedo and normals for the denoiser."""
_POLL_S = 0.1
_MAX_RADIANCE_RATIO = 30.0
"""Brighter pixels of a pass are clamped, relative to the 99th percentile: the denoiser would spread single paths."""
_KEY = 0.34
"""The value that the log-average luminance is exposed to."""
_WHITE = 1.7
"""The exposed luminance that is nearly white (an sRGB value of 235)."""
_MAX_RAISE_FACTOR = 1.5
_CONTRAST, _SHOULDER = 1.35, 0.62
"""Exponent and offset of the tone curve; dimensionless."""
_OUTLINE_PX = 3
"""Width of the outline of highlighted bodies in a picture of 800 lines."""
_SUN_FROM_CAMERA_RAD = 1.0
"""Angle of the sun to the left of the direction from the subject to the camera."""

Progress = Callable[[float], None]


class PathTracingSettings(msgspec.Struct, frozen=True, kw_only=True):
    """The size and quality of a path-traced picture."""

    size: PictureSize = (1280, 800)
    """Width and height [px]."""
    samples: Count = 16
    """Samples per pixel; the largest number if there is a time budget."""
    seconds: Deadline | None = None
    """Time budget of the passes [s]; at least one pass is rendered. Denoising takes a few seconds more."""
    denoise: bool = True
    seed: Seed = 0
    max_depth: Count = 7
    """Longest light path, in surfaces; glass does not count."""
    exposure_ev: Finite = 0.0
    """Added to the automatic exposure, in stops."""
    exposure: NotNegative | None = None
    """A factor of the radiance instead of the automatic exposure: the pictures of a film share one."""
    sun_azimuth_rad: Angle | None = None
    """The direction of the sun, about z; by default to the left of the camera."""

    def __post_init__(self) -> None:
        check_fields(self)


class PathTracedPicture(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A picture, and how it came about."""

    radiance: NDArray[np.float32]
    """h x w x 3, linear sRGB [cd/m²]."""
    pixels: NDArray[np.uint8]
    """h x w x 3, sRGB."""
    samples: int
    """Samples per pixel."""
    exposure: float
    seconds: float
    """The time that rendering took, without reading the scene [s]."""
    notes: tuple[str, ...] = ()
    """What was added or assumed, such as a lamp in a dark room."""

    def encode(self, suffix: str = ".png") -> bytes:
        """The picture as a file.

        Args:
            suffix: one of `PICTURE_SUFFIXES`; `.exr` has the radiance.

        Raises:
            InvalidArgumentError: the suffix is none of these.
        """
        if suffix.lower() == ".exr":
            return _exr(self.radiance)
        formats = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".webp": "WEBP"}
        if suffix.lower() not in formats:
            remedy = f"there is {', '.join(PICTURE_SUFFIXES)}"
            raise InvalidArgumentError(suffix, cause="pictures cannot be written in this format", remedy=remedy)
        from PIL import Image

        buffer = BytesIO()
        Image.fromarray(self.pixels).save(buffer, formats[suffix.lower()], quality=92)
        return buffer.getvalue()


def check_renderer() -> None:
    """Checks that the libraries of the extra "render" are installed.

    Raises:
        RendererUnavailableError: one of them is missing, or cannot be loaded.
    """
    for name in ("mitsuba", "pyoidn"):
        try:
            import_module(name)
        except (ImportError, OSError) as error:
            remedy = "install it with: pip install 'mindstage[render]'"
            raise RendererUnavailableError(name, cause=str(error), remedy=remedy) from error


def path_trace(
    scene: RenderScene, settings: PathTracingSettings | None = None, *, progress: Progress | None = None
) -> PathTracedPicture:
    """Renders a picture. An interrupt ends it within a second; then there is no picture.

    Args:
        scene: what it shows.
        settings: size and quality.
        progress: called repeatedly with the part that is done, from 0 to 1.

    Raises:
        RendererUnavailableError: the extra "render" is not installed.
        InvalidArgumentError: a setting is out of range.
    """
    settings = settings or PathTracingSettings()
    _check(settings)
    check_renderer()
    start = time.monotonic()
    azimuth = settings.sun_azimuth_rad
    sky = Sky(sun_azimuth_rad=sun_azimuth(scene.camera) if azimuth is None else azimuth)
    made = MitsubaScene(scene, sky=sky)
    report = progress or (lambda _: None)
    radiance, samples = _passes(made, scene.camera, settings, report, start)
    if settings.denoise:
        radiance = _denoised(radiance, _features(made, scene.camera, settings))
    factor = settings.exposure or automatic_exposure(radiance) * 2.0**settings.exposure_ev
    pixels = _outlined(tone_mapped(radiance * factor), _coverage(made, scene.camera, settings))
    report(1.0)
    return PathTracedPicture(
        radiance=radiance,
        pixels=pixels,
        samples=samples,
        exposure=factor,
        seconds=time.monotonic() - start,
        notes=tuple(made.notes),
    )


def automatic_exposure(radiance: Array | NDArray[np.float32]) -> float:
    """The factor that exposes a picture: its log-average luminance, without extremes, becomes a medium gray.

    A picture without bright parts, such as one of a kitchen on gray ground, gets more light: its brightest surfaces
    become nearly white.
    """
    values = luminance(np.asarray(radiance, dtype=np.float64)).ravel()
    values = values[values > 0.0]
    if not values.size:
        return 1.0
    low, high = np.quantile(values, (0.03, 0.97))
    middle = values[(values >= low) & (values <= high)]
    factor = _KEY / np.exp(np.log(middle).mean())
    return float(factor * np.clip(_WHITE / (factor * high), 1.0, _MAX_RAISE_FACTOR))


def tone_mapped(exposed: Array | NDArray[np.float32]) -> NDArray[np.uint8]:
    """Maps linear values to sRGB with a curve like that of film: contrast in the middle, soft highlights.

    The curve, x^c / (x^c + s), is that of photoreceptors (Naka and Rushton, 1966). It is applied to the channels and to
    the luminance, and both are blended: bright colors become pale, but keep their hue.
    """
    linear = np.clip(np.asarray(exposed, dtype=np.float64), 0.0, None)

    def curve(value: Array) -> Array:
        raised: Array = value**_CONTRAST
        mapped: Array = raised / (raised + _SHOULDER) * (1.0 + _SHOULDER * 0.12)
        return mapped

    light = luminance(linear)[..., None]
    by_light = linear * (curve(light) / np.maximum(light, 1e-9))
    mapped = 0.65 * curve(linear) + 0.35 * np.minimum(by_light, 1.0)
    return (linear_to_srgb(np.clip(mapped, 0.0, 1.0)) * 255.0 + 0.5).astype(np.uint8)


def _check(settings: PathTracingSettings) -> None:
    if min(settings.size) < 8:
        raise InvalidArgumentError("size", cause=f"{settings.size} is out of range", remedy="give 8 to 16384 pixels")


def sun_azimuth(camera: CameraPose) -> float:
    """The direction of the sun for a camera, about z: to its left, so that shadows are seen [rad]."""
    x, y = np.subtract(camera.position, camera.look_at)[:2]
    return float(np.arctan2(y, x)) - _SUN_FROM_CAMERA_RAD


# -- passes ------------------------------------------------------------------------------------------------------------


def _passes(
    made: MitsubaScene, camera: CameraPose, settings: PathTracingSettings, report: Progress, start: float
) -> tuple[NDArray[np.float32], int]:
    """The mean radiance of all passes, and the samples per pixel."""
    mitsuba = use_mitsuba()
    # Only this integrator samples the sun through window panes.
    integrator = mitsuba.load_dict({"type": "volpath", "max_depth": settings.max_depth, "rr_depth": 4})
    sensor = made.sensor(camera, settings.size)
    total, done = np.zeros((settings.size[1], settings.size[0], 3), dtype=np.float64), 0
    while done < settings.samples:
        count = min(_PASS_SAMPLES, settings.samples - done)
        image = _render(made.native, sensor, integrator, count, _seed(settings.seed, done))
        limit = _MAX_RADIANCE_RATIO * float(np.quantile(image, 0.99)) + 1e-6
        total += np.clip(np.nan_to_num(image, nan=0.0, posinf=limit), 0.0, limit) * count
        done += count
        spent = time.monotonic() - start
        by_time = 0.0 if settings.seconds is None else spent / settings.seconds
        report(0.98 * min(1.0, max(done / settings.samples, by_time)))
        if settings.seconds is not None and spent * (1 + count / done) > settings.seconds:
            break
    return (total / done).astype(np.float32), done


def _seed(seed: int, done: int) -> int:
    return (seed * 1_000_003 + done + 1) % 2**31


def _render(native: Any, sensor: Any, integrator: Any, samples: int, seed: int) -> NDArray[np.float32]:
    """Renders in another thread, so that an interrupt cancels it."""
    mitsuba, result, errors = use_mitsuba(), [], []

    def run() -> None:
        try:
            image = mitsuba.render(native, sensor=sensor, integrator=integrator, spp=samples, seed=seed)
            result.append(np.array(image, dtype=np.float32))
        except Exception as error:
            errors.append(error)

    thread = threading.Thread(target=run, name="mindstage-render", daemon=True)
    thread.start()
    try:
        while thread.is_alive():
            thread.join(_POLL_S)
    except BaseException:
        integrator.cancel()
        thread.join()
        raise
    if errors:
        raise errors[0]
    image: NDArray[np.float32] = result[0]
    return image


# -- denoising ---------------------------------------------------------------------------------------------------------


def _features(
    made: MitsubaScene, camera: CameraPose, settings: PathTracingSettings
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Albedo and normals of the first surfaces."""
    integrator = use_mitsuba().load_dict({"type": "path", "max_depth": 1})
    sensor, seed = made.sensor(camera, settings.size, alpha=True), _seed(settings.seed, -1)
    albedo = _render(made.albedo, sensor, integrator, _FEATURE_SAMPLES, seed)
    normal = _render(made.normal, sensor, integrator, _FEATURE_SAMPLES, seed)
    # A background has no normal.
    turned = (normal[..., :3] - 0.5 * normal[..., 3:]) / NORMAL_SCALE
    return np.clip(np.nan_to_num(albedo[..., :3]), 0.0, 1.0), np.clip(np.nan_to_num(turned), -1.0, 1.0)


def _denoised(
    radiance: NDArray[np.float32], features: tuple[NDArray[np.float32], NDArray[np.float32]]
) -> NDArray[np.float32]:
    import pyoidn  # type: ignore[import-untyped]

    albedo, normal = (np.ascontiguousarray(each, dtype=np.float32) for each in features)
    result = pyoidn.denoise(np.ascontiguousarray(radiance), albedo=albedo, normal=normal, hdr=True)
    clean: NDArray[np.float32] = np.clip(result, 0.0, None)
    return clean


# -- highlights --------------------------------------------------------------------------------------------------------


def _coverage(
    made: MitsubaScene, camera: CameraPose, settings: PathTracingSettings
) -> Mapping[Color, NDArray[np.float32]]:
    """How much of each pixel highlighted bodies cover, seen through everything else, by color."""
    integrator = use_mitsuba().load_dict({"type": "depth"})
    sensor = made.sensor(camera, settings.size, alpha=True)
    return {color: _render(mask, sensor, integrator, _FEATURE_SAMPLES, 0)[..., 3] for color, mask in made.masks.items()}


def _outlined(pixels: NDArray[np.uint8], coverage: Mapping[Color, NDArray[np.float32]]) -> NDArray[np.uint8]:
    """Draws an outline in the color of the highlight around each body, between two thin white lines."""
    drawn = pixels.astype(np.float64)
    width = max(1.5, _OUTLINE_PX * pixels.shape[0] / 800)
    for color, covered in coverage.items():
        if not covered.any():
            continue
        away = _distances(covered >= 0.5, int(width) + 3) - 0.5 - np.clip(covered, 0.0, 0.5)
        for reach, paint in ((width + 1.5, (1.0, 1.0, 1.0)), (width, color)):
            alpha = (np.clip(reach + 0.5 - away, 0.0, 1.0) * np.clip(1.0 - covered, 0.0, 1.0))[..., None]
            drawn = drawn * (1 - alpha) + np.array(paint) * 255.0 * alpha
    return (drawn + 0.5).astype(np.uint8)


def _distances(mask: NDArray[np.bool_], reach: int) -> Array:
    """The distance of each pixel to the nearest one of a mask, up to a reach [px]."""
    height, width = mask.shape
    padded = np.pad(mask, reach)
    nearest = np.full(mask.shape, float(reach))
    for row in range(-reach, reach + 1):
        for column in range(-reach, reach + 1):
            moved = padded[reach + row : reach + row + height, reach + column : reach + column + width]
            np.minimum(nearest, np.where(moved, float(np.hypot(row, column)), float(reach)), out=nearest)
    return nearest


def _exr(radiance: NDArray[np.float32]) -> bytes:
    mitsuba = use_mitsuba()
    stream = mitsuba.MemoryStream()
    mitsuba.Bitmap(np.ascontiguousarray(radiance)).write(stream, mitsuba.Bitmap.FileFormat.OpenEXR)
    data: bytes = stream.raw_buffer()
    return data
