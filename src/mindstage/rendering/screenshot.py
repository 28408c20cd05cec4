"""What a picture shows: camera, clipping plane, selection and labels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

import numpy as np
from msgspec import Meta

from mindstage.errors import BodyNotFoundError, InvalidArgumentError
from mindstage.ranges import Coordinate, Point, check_fields
from mindstage.rdf.graphs import local_name
from mindstage.rendering.appearance import BodyAppearance, VisiblePart
from mindstage.rendering.camera import CameraPose, corners, focus_camera, initial_target
from mindstage.scene import BodyId, Pose, World
from mindstage.scene.transforms import pose_array

__all__ = ["DEFAULT_CAMERA", "LabelMode", "Screenshot", "label_texts", "placed_camera", "screenshot_camera"]


_Side = Annotated[int, Meta(ge=1, le=8192)]
"""Width or height [px]; OpenGL renders no more."""
DEFAULT_CAMERA = CameraPose((2.5, -2.5, 2.0), (0.0, 0.0, 0.5), 0.63)
"""The camera for an empty scene."""
_MIN_HORIZONTAL_M = 1e-3
"""Minimum horizontal part of a view direction: straight down, the up direction would be undefined."""
_MIN_FOCUS_SIZE_M = 0.25
"""Smallest extent that the camera zooms to [m]."""
_MAX_LABELS = 300
"""Maximum number of labels; the largest bodies are labeled first."""


class LabelMode(StrEnum):
    """Which bodies are labeled."""

    NONE = "none"
    SELECTED = "selected"
    CLASS = "class"
    """All bodies with the same label as the selected one."""
    ALL = "all"


@dataclass(frozen=True, slots=True, kw_only=True)
class Screenshot:
    """What a picture shows."""

    size: tuple[_Side, _Side] = (1280, 800)
    """Width and height [px]."""
    position: Point | None = None
    """Position of the camera [m]; without this and `look_at`, the home view."""
    look_at: Point | None = None
    """Point in the center of the picture [m]."""
    from_above: bool = False
    """Whether the camera looks straight down, as on a floor plan."""
    focus: tuple[BodyId, ...] = ()
    """Bodies that the camera frames."""
    focus_points: tuple[Point, ...] = ()
    """Points that the camera frames [m]."""
    clip_height: Coordinate | None = None
    """Height of the clipping plane: nothing above it is drawn [m]."""
    selected: BodyId | None = None
    """The selected body, which is outlined."""
    labels: LabelMode = LabelMode.NONE

    @property
    def aspect(self) -> float:
        """Width / height."""
        return self.size[0] / self.size[1]

    def __post_init__(self) -> None:
        """Checks size and view.

        Raises:
            InvalidArgumentError: one of them is invalid.
        """
        check_fields(self)
        if self.position is not None and self.position == self.look_at:
            raise InvalidArgumentError(
                "a picture's view", cause="position and look_at are equal", remedy="give two different points"
            )


def placed_camera(screenshot: Screenshot, default: CameraPose) -> CameraPose:
    """The camera of a screenshot; a missing point is that of the default, moved with the other one."""
    x, y, z = default.position
    (to_x, to_y, to_z) = default.look_at
    if screenshot.position is None and screenshot.look_at is not None:
        to_x, to_y, to_z, x, y, z = (
            *screenshot.look_at,
            *(
                end + eye - middle
                for end, eye, middle in zip(screenshot.look_at, default.position, default.look_at, strict=True)
            ),
        )
    elif screenshot.position is not None:
        x, y, z = screenshot.position
        to_x, to_y, to_z = screenshot.look_at or default.look_at
    height = abs(z - to_z)
    if abs(x - to_x) + abs(y - to_y) < _MIN_HORIZONTAL_M * height:
        y -= _MIN_HORIZONTAL_M * height
    return CameraPose((x, y, z), (to_x, to_y, to_z), default.field_of_view_rad)


def screenshot_camera(
    screenshot: Screenshot, world: World, appearances: Mapping[BodyId, BodyAppearance], poses: Mapping[BodyId, Pose]
) -> CameraPose:
    """The camera of a picture.

    Args:
        screenshot: what it shows.
        world: the world, with the poses of its description.
        appearances: how its bodies are drawn.
        poses: the current poses of all bodies.

    Raises:
        BodyNotFoundError: a body of the focus does not exist.
    """
    if not appearances:
        return placed_camera(screenshot, DEFAULT_CAMERA)
    target = initial_target(world, appearances)
    home = target.camera(screenshot.aspect)
    if screenshot.focus:
        for id in screenshot.focus:
            if id not in appearances:
                raise BodyNotFoundError(id, known=appearances, world=world.name)
        sizes = np.array([appearances[id].size for id in screenshot.focus], dtype=float)
        boxes = pose_array(poses[id] for id in screenshot.focus)
        points = corners(boxes, np.maximum(sizes, _MIN_FOCUS_SIZE_M))
        return focus_camera(points, home.position, home.look_at, screenshot.aspect)
    if screenshot.focus_points:
        boxes = pose_array(Pose(point) for point in screenshot.focus_points)
        points = corners(boxes, np.full((len(boxes), 3), _MIN_FOCUS_SIZE_M))
        return focus_camera(points, home.position, home.look_at, screenshot.aspect)
    if screenshot.from_above:
        return target.top_camera(screenshot.aspect)
    if screenshot.position is not None or screenshot.look_at is not None:
        return placed_camera(screenshot, home)
    return target.upright_camera(screenshot.aspect)


def label_texts(
    screenshot: Screenshot, world: World, appearances: Mapping[BodyId, BodyAppearance]
) -> dict[BodyId, str]:
    """The texts of the labeled bodies, those of the largest bodies.

    Args:
        screenshot: which bodies are labeled.
        appearances: how its bodies are drawn.
    """
    texts = {
        body.id: body.label or local_name(body.cls)
        for body in world.bodies
        if body.id in appearances and appearances[body.id].part is not VisiblePart.OUTLINE
    }
    selected = screenshot.selected
    match screenshot.labels:
        case LabelMode.ALL:
            largest = sorted(texts, key=lambda each: -float(np.prod(appearances[each].size)))
            return {id: texts[id] for id in largest[:_MAX_LABELS]}
        case LabelMode.CLASS if selected in texts:
            return {id: text for id, text in texts.items() if text == texts[selected]}
        case LabelMode.SELECTED if selected in texts:
            return {selected: texts[selected]}
    return {}
