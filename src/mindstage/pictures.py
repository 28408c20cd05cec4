"""Pictures of simulations, rendered by OpenGL without a browser or a display, and picture files.

shot(sim, "kitchen.png")
shot(sim, "milk.webp", Screenshot(size=(1600, 1000), focus=("milk",)))
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from mindstage.errors import BodyNotFoundError, InvalidArgumentError
from mindstage.files import atomic_write

if TYPE_CHECKING:
    from numpy import uint8
    from numpy.typing import NDArray

    from mindstage.imagination import Verdict
    from mindstage.rendering import Screenshot
    from mindstage.rendering.render_scene import RenderItem, RenderScene
    from mindstage.scene import BodyId, Color, VisualMesh
    from mindstage.simulation import Simulation

__all__ = ["PICTURE_FORMATS", "encode_picture", "picture_format", "shot", "simulation_scene"]


PICTURE_FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".webp": "WEBP"}
"""The formats of picture files by suffix, by their names in Pillow."""
_QUALITY = 90
"""Of JPEG and WebP, a percentage."""
_GHOST_OPACITY = 0.35


def shot(
    simulation: Simulation,
    path: str | os.PathLike[str] | None = None,
    screenshot: Screenshot | None = None,
    *,
    verdict: Verdict | None = None,
) -> NDArray[uint8]:
    """Renders a picture of a simulation; no browser, display or GPU is needed.

    Args:
        simulation: the simulation, with its highlights.
        path: the file to write, .png, .jpg or .webp; by default none.
        screenshot: what the picture shows; by default the home view.
        verdict: the outcome of a plan: where bodies end in its samples is drawn, and framed by default.

    Returns:
        The picture, h x w x 3, sRGB.

    Raises:
        InvalidArgumentError: the suffix is unknown.
        BodyNotFoundError: a body of the screenshot does not exist.
        RendererUnavailableError: there is no OpenGL library.
        OSError: the file cannot be written; an existing one is unchanged.
    """
    from mindstage.rendering import Screenshot
    from mindstage.rendering.rasterizer import render_picture

    wanted = screenshot or Screenshot()
    format = None if path is None else picture_format(path)
    picture = render_picture(simulation_scene(simulation, wanted, verdict=verdict), wanted.size)
    if path is not None and format is not None:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        atomic_write(Path(path), encode_picture(picture, format))
    return picture


def simulation_scene(simulation: Simulation, screenshot: Screenshot, *, verdict: Verdict | None = None) -> RenderScene:
    """What a picture of the current state of a simulation shows.

    Args:
        screenshot: camera, selection, labels and clipping plane.
        verdict: the outcome of a plan.

    Raises:
        BodyNotFoundError: a body of the screenshot does not exist.
    """
    from dataclasses import replace as replace_fields

    from msgspec.structs import replace

    from mindstage.rendering.appearance import compute_appearance
    from mindstage.rendering.render_scene import described_world, render_scene
    from mindstage.rendering.screenshot import label_texts, screenshot_camera
    from mindstage.simulation import SpawnNoteKind
    from mindstage.simulation.marker_items import marker_items, marker_labels

    current, knowledge, geometry = simulation.snapshot(), simulation.knowledge, simulation.geometry
    world = described_world(current, simulation.worlds)
    enclosing = {id for report in simulation.reports for id in report.ids_with_note(SpawnNoteKind.ENCLOSURE)}
    appearances = compute_appearance(
        world, knowledge.shape_rule, knowledge.ancestors, geometry=geometry, enclosing=enclosing
    )
    if screenshot.selected is not None and screenshot.selected not in appearances:
        raise BodyNotFoundError(screenshot.selected, known=appearances, world=world.name)
    poses = {body.id: body.pose for body in current.bodies}
    framed, markers = screenshot, simulation.state.markers
    visuals = {id: each.whole_visuals for id, each in appearances.items()}
    ghosts: tuple[RenderItem, ...] = ()
    if verdict is not None:
        ghosts = tuple(_ghosts(verdict, visuals))
        placed = screenshot.position or screenshot.look_at or screenshot.focus or screenshot.from_above
        if not placed and ghosts:
            framed = replace_fields(screenshot, focus_points=tuple(each.pose.position for each in ghosts))
    scene = render_scene(
        world,
        geometry,
        knowledge,
        camera=screenshot_camera(framed, world, appearances, poses),
        poses=poses,
        highlights=simulation.state.highlights,
        selected=screenshot.selected,
        labels=label_texts(screenshot, world, appearances),
        clip_height=screenshot.clip_height,
        appearances=appearances,
        ghosts=(*ghosts, *marker_items(markers, visuals)),
    )
    return replace(scene, labels=(*scene.labels, *marker_labels(markers)))


def _ghosts(verdict: Verdict, visuals: dict[BodyId, tuple[VisualMesh, ...]]) -> Iterator[RenderItem]:
    """Translucent copies of bodies where they end in the samples of a plan, and of the first failing one over time."""
    from mindstage.rendering.render_scene import RenderItem
    from mindstage.scene.transforms import pose_from_array
    from mindstage.viewer.ghosts import end_pose_ghosts, trail_ghosts

    trail = () if verdict.first_failure is None else trail_ghosts(verdict.replay().frames)
    for group in (*end_pose_ghosts(verdict), *trail):
        for pose, color in zip(group.poses, group.colors.tolist(), strict=True):
            red, green, blue = color
            painted = tuple(_ghost_visuals(visuals.get(group.body, ()), (red, green, blue)))
            yield RenderItem(
                id=group.body, visuals=painted, pose=pose_from_array(pose), size=(0.1, 0.1, 0.1), casts_shadow=False
            )


def _ghost_visuals(visuals: Iterable[VisualMesh], color: Color) -> Iterator[VisualMesh]:
    from mindstage.scene import PbrMaterial, VisualMesh

    material = PbrMaterial(color=color, opacity=_GHOST_OPACITY)
    for visual in visuals:
        yield VisualMesh(visual.points, visual.faces, material, visual.normals)


def picture_format(path: str | os.PathLike[str]) -> str:
    """The format of a picture file, by its suffix.

    Raises:
        InvalidArgumentError: the suffix is unknown.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in PICTURE_FORMATS:
        remedy = f"end it with {', '.join(PICTURE_FORMATS)}"
        raise InvalidArgumentError(str(path), cause=f"{suffix or 'no suffix'} is no format of pictures", remedy=remedy)
    return PICTURE_FORMATS[suffix]


def encode_picture(picture: NDArray[uint8], format: str) -> bytes:
    """The bytes of a picture file.

    Args:
        picture: h x w x 3, sRGB.
        format: PNG, JPEG or WEBP.
    """
    from PIL import Image

    file = io.BytesIO()
    options = {"compress_level": 4} if format == "PNG" else {"quality": _QUALITY}
    Image.fromarray(picture).save(file, format, **options)
    return file.getvalue()
