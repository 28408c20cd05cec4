"""Cameras of a running simulation: color, depth, segmentation and normals as arrays, all of one state.

image = sim.camera("head").capture()
image.depth[240, 320], image.segmentation.at(240, 320)
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.errors import BodyNotFoundError, InvalidArgumentError
from mindstage.ranges import Index, checked
from mindstage.rendering.sensor_view import PinholeView, SensorImages, SensorLighting
from mindstage.scene import BodyId, Iri, Pose
from mindstage.scene.transforms import Array, normalized_pose_array, pose_from_array, pose_multiply, rotation_matrix
from mindstage.sensors.camera_model import CameraModel, CameraMount, undistorted

__all__ = ["Camera", "CameraImages", "SeenBody", "Segmentation"]

_SMOOTH_COSINE = 0.995
"""Cosine between the normals of neighboring pixels above which no edge is between them."""
_GRAZING = 1e-3
"""Cosine between a ray and a surface below which it is seen from the side."""
_MAX_STEP = 0.1
"""Largest change of the depth of a surface within a pixel, as a part of it."""
_MARGIN_PX = 2
"""Around the undistorted image from which a distorted one is made."""


class SeenBody(msgspec.Struct, frozen=True, kw_only=True):
    """What a label of a segmented image stands for."""

    id: BodyId
    iri: Iri
    cls: Iri


class Segmentation(NamedTuple):
    """Which body each pixel shows."""

    labels: NDArray[np.uint32]
    """h x w: 0 for nothing and for the ground, else the key of `legend`."""
    legend: Mapping[int, SeenBody]
    """All bodies that have a label, seen or not; labels and IRIs correspond one to one."""

    @checked
    def at(self, row: Index, column: Index) -> SeenBody | None:
        """The body that a pixel shows.

        Raises:
            InvalidArgumentError: the image has no such pixel.
        """
        height, width = self.labels.shape
        if row >= height or column >= width:
            raise InvalidArgumentError(f"pixel {row}, {column}", cause=f"the image has {height} rows of {width}")
        return self.legend.get(int(self.labels[row, column]))

    def mask(self, body: str) -> NDArray[np.bool_]:
        """Where a body is seen, h x w.

        Args:
            body: its id or IRI.

        Raises:
            BodyNotFoundError: no body of the legend has it.
        """
        for label, each in self.legend.items():
            if body in (each.id, each.iri):
                return np.asarray(self.labels == label)
        raise BodyNotFoundError(body, known=[each.id for each in self.legend.values()])

    def seen(self) -> dict[BodyId, int]:
        """The bodies that are seen, with their numbers of pixels."""
        labels, counts = np.unique(self.labels, return_counts=True)
        pixels = dict(zip(labels.tolist(), counts.tolist(), strict=True))
        return {self.legend[label].id: count for label, count in pixels.items() if label}

    def classes(self) -> tuple[NDArray[np.uint32], tuple[Iri, ...]]:
        """The classes of what pixels show: 1 + the index of a class, h x w, and the classes; 0 for no body."""
        names = tuple(sorted({each.cls for each in self.legend.values()}))
        of_label = np.zeros(max(self.legend, default=0) + 1, dtype=np.uint32)
        for label, each in self.legend.items():
            of_label[label] = names.index(each.cls) + 1
        return of_label[self.labels], names


class CameraImages(NamedTuple):
    """What a camera took at one time."""

    time_s: float
    """Simulated time of the exposure [s]."""
    pose: Pose
    """Of the optical frame in the world frame."""
    model: CameraModel
    rgb: NDArray[np.uint8]
    """h x w x 3, sRGB."""
    depth: NDArray[np.float32]
    """Distance along the optical axis, h x w [m]; infinite where nothing is, NaN where the sensor fails."""
    segmentation: Segmentation
    normals: NDArray[np.float32]
    """Unit normals in the optical frame, h x w x 3; 0 where nothing is."""


class Camera:
    """A camera of a simulation; made by `Simulation.camera`. Images are of the latest published state."""

    def __init__(self, mount: CameraMount, stage: Any) -> None:
        """Takes no image yet.

        Args:
            mount: where it is, and how it projects.
            stage: what renders the simulation, a `CameraStage`.
        """
        self.mount = mount
        self.lighting = SensorLighting()
        """The light in which it takes images; assign another one for other times of the day."""
        self._stage = stage

    @property
    def name(self) -> str:
        """Its name."""
        return self.mount.name

    @property
    def model(self) -> CameraModel:
        """Its intrinsics, distortion, range, rate and noise."""
        return self.mount.model

    @property
    def pose(self) -> Pose:
        """The optical frame (x right, y down, z forward) in the world frame.

        Raises:
            BodyNotFoundError: the body that it is on was deleted.
        """
        return pose_from_array(self._stage.freeze(self.mount)[1])

    def rgb(self) -> NDArray[np.uint8]:
        """The image, h x w x 3, sRGB; as all images see `capture` for errors."""
        return self._take(color=True).rgb

    def depth(self) -> NDArray[np.float32]:
        """Distances along the optical axis, h x w [m]; infinite where nothing is, NaN where the sensor fails."""
        return self._take(geometry=True).depth

    def segmentation(self) -> Segmentation:
        """Which body each pixel shows."""
        return self._take(geometry=True).segmentation

    def normals(self) -> NDArray[np.float32]:
        """Unit normals in the optical frame, h x w x 3; 0 where nothing is."""
        return self._take(geometry=True, normals=True).normals

    def capture(self) -> CameraImages:
        """All images of one state, with the time of the exposure.

        Raises:
            BodyNotFoundError: the body that it is on was deleted.
            InvalidArgumentError: it is inside of a body, such as a wall.
            RendererUnavailableError: there is no OpenGL library.
        """
        return self._take(color=True, geometry=True, normals=True)

    def _take(self, *, color: bool = False, geometry: bool = False, normals: bool = False) -> CameraImages:
        model = self.model
        state, pose = self._stage.freeze(self.mount)
        view = _view(model, pose)
        is_distorted = any(model.distortion)
        asked = {"color": color, "geometry": geometry, "normals": normals or (geometry and is_distorted)}
        images, legend = self._stage.render(self.mount, view, state, lighting=self.lighting, **asked)
        if is_distorted:
            images = _resampled(images, model)
        random = np.random.default_rng([model.noise.seed, zlib.crc32(self.name.encode()), round(state.time_s * 1e6)])
        empty = np.zeros((0, 0))
        return CameraImages(
            time_s=state.time_s,
            pose=pose_from_array(pose),
            model=model,
            rgb=empty.astype(np.uint8) if images.rgb is None else _noisy_color(images.rgb, model, random),
            depth=empty.astype(np.float32) if images.depth is None else _noisy_depth(images.depth, model, random),
            segmentation=Segmentation(empty.astype(np.uint32) if images.numbers is None else images.numbers, legend),
            normals=empty.astype(np.float32) if images.normals is None else images.normals,
        )


def optical_pose(mount: CameraMount, body_pose: Array | None) -> Array:
    """The pose of the optical frame of a camera in the world frame: x y z [m], w x y z."""
    own = normalized_pose_array(mount.pose)
    return own if body_pose is None else pose_multiply(body_pose, own)


# -- distortion --------------------------------------------------------------------------------------------------------


def _view(model: CameraModel, pose: Array) -> PinholeView:
    """The camera without its distortion, which sees all that the distorted one does."""
    size, center = (model.width, model.height), (model.cx, model.cy)
    if any(model.distortion):
        _, size, center = _undistorted_image(model)
    return PinholeView(
        position=pose[:3],
        rotation=rotation_matrix(pose[3:]),
        size=size,
        focal=(model.fx, model.fy),
        center=center,
        near=model.near_m,
        far=model.far_m,
    )


@lru_cache(maxsize=16)
def _undistorted_image(model: CameraModel) -> tuple[Array, tuple[int, int], tuple[float, float]]:
    """Where each pixel of a distorted image is in one without distortion (h x w x 2), the size of that, its center."""
    at = undistorted(model) * [model.fx, model.fy]
    low = np.floor(at.min(axis=(0, 1))) - _MARGIN_PX
    width, height = (np.ceil(at.max(axis=(0, 1))) - low).astype(int) + 1 + _MARGIN_PX
    return at - low, (int(width), int(height)), (float(-low[0]), float(-low[1]))


def _resampled(images: SensorImages, model: CameraModel) -> SensorImages:
    """Distorts images. Depths are those between four pixels of one body, else on the plane of the nearest pixel."""
    at, _, _ = _undistorted_image(model)
    column, row = np.floor(at).astype(np.intp).transpose(2, 0, 1)
    right, down = np.moveaxis(at - np.floor(at), 2, 0)
    corners = [
        (row + i, column + j, (down if i else 1 - down) * (right if j else 1 - right)) for i in (0, 1) for j in (0, 1)
    ]
    near_row, near_column = np.rint(at[..., 1]).astype(np.intp), np.rint(at[..., 0]).astype(np.intp)
    rgb = depth = numbers = normals = None
    if images.normals is not None:
        normals = images.normals[near_row, near_column]
    if images.rgb is not None:
        mixed = sum(images.rgb[i, j] * weight[..., None] for i, j, weight in corners)
        rgb = np.rint(np.asarray(mixed)).astype(np.uint8)
    if images.depth is not None and images.numbers is not None and images.normals is not None:
        assert normals is not None
        numbers = images.numbers[near_row, near_column]
        # Along a line of the image, the inverse of the depth of a plane is linear.
        inverse = np.asarray(sum(weight / images.depth[i, j] for i, j, weight in corners))
        is_smooth = [(images.normals[i, j] * normals).sum(axis=-1) > _SMOOTH_COSINE for i, j, _ in corners]
        same = np.logical_and.reduce([*is_smooth, *(images.numbers[i, j] == numbers for i, j, _ in corners)])
        _, _, center = _undistorted_image(model)
        nearest = (np.stack([near_column, near_row], axis=-1) - center) / [model.fx, model.fy]
        slopes = [(normals[..., :2] * rays).sum(axis=-1) + normals[..., 2] for rays in (nearest, undistorted(model))]
        flat = np.abs(slopes[1]) > _GRAZING
        on_plane = np.where(flat, slopes[0] / np.where(flat, slopes[1], 1.0), 1.0)
        on_plane = np.clip(on_plane, 1 - _MAX_STEP, 1 + _MAX_STEP) * images.depth[near_row, near_column]
        with np.errstate(divide="ignore"):
            depth = np.where(same, 1.0 / inverse, on_plane).astype(np.float32)
    return SensorImages(rgb, depth, numbers, normals)


# -- noise -------------------------------------------------------------------------------------------------------------


def _noisy_color(rgb: NDArray[np.uint8], model: CameraModel, random: np.random.Generator) -> NDArray[np.uint8]:
    std = model.noise.color_std
    if not std:
        return rgb
    return np.clip(np.rint(rgb + random.normal(0.0, 255 * std, rgb.shape)), 0, 255).astype(np.uint8)


def _noisy_depth(depth: NDArray[np.float32], model: CameraModel, random: np.random.Generator) -> NDArray[np.float32]:
    noise = model.noise
    if noise.depth_std_m or noise.depth_std_per_m:
        finite = np.where(np.isfinite(depth), depth, 0.0)
        std = noise.depth_std_m + noise.depth_std_per_m * (finite - noise.depth_offset_m) ** 2
        depth = (depth + std * random.standard_normal(depth.shape)).astype(np.float32)
    if noise.dropout:
        depth = np.where(random.random(depth.shape) < noise.dropout, np.float32(np.nan), depth)
    return depth
