"""The verb `render`: path-traced pictures and films of a map, or of one moment of an episode.

The file appears when it is complete: an interrupted command leaves none.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import (
    DEFAULT_PICTURE,
    DEFAULT_SPAWN,
    AsJson,
    ExitCode,
    MapArguments,
    MapSpawning,
    PictureOptions,
)
from mindstage.cli.output import (
    print_failures,
    print_json,
    print_line,
    progress_bar,
    progress_spinner,
    report_json,
    step_with_progress,
    warn,
)
from mindstage.cli.setup import exclusive, knowledge_base, make_engine, simulation_from_options
from mindstage.cli.shot import highlight_targets, parse_numbers, parse_point, parse_size
from mindstage.errors import InvalidArgumentError
from mindstage.ranges import Count, Finite, Time
from mindstage.ranges import Seed as SeedNumber

if TYPE_CHECKING:
    from mindstage.maps.urdf.xacro_process import XacroRequest
    from mindstage.rendering import CameraPose
    from mindstage.rendering.path_tracing import PathTracingSettings
    from mindstage.rendering.render_scene import RenderScene
    from mindstage.simulation import HighlightResult, Simulation
    from mindstage.simulation.pictures import ScenePhotographer

__all__ = ["render"]


_EPISODE_SUFFIX = ".mcap"
_AXIS_OF_LINK, _AXIS_OF_OPTICS = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
"""The direction of a camera in the frame of its link, and in an optical frame (REP 103)."""

Output = Annotated[
    Path,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE",
        help="The file to write: .png, .jpg, .webp or .exr; with --turntable or --flight .mp4 or .webp.",
        show_default=False,
    ),
]
Samples = Annotated[
    Count | None,
    typer.Option("--samples", metavar="N", help="Samples per pixel; by default 16, and 4 in films."),
]
Budget = Annotated[
    float | None,
    typer.Option(
        "--seconds",
        metavar="S",
        min=0.1,
        help="Stop taking samples after this time, for each picture; then the default of --samples is 1024.",
        show_default=False,
    ),
]
Opened = Annotated[
    list[str] | None,
    typer.Option(
        "--open",
        metavar="ID[=PART]",
        help="Open a door or drawer first, by its joint or body, fully or by a part of its range; may be repeated.",
        show_default=False,
    ),
]
At = Annotated[
    Time | None,
    typer.Option("--at", metavar="SECONDS", help="The time of an episode (.mcap); by default its end."),
]
RobotSource = Annotated[
    str | None,
    typer.Option("--robot", metavar="NAME|FILE", help="Add a robot at a free place on the floor.", show_default=False),
]
CameraName = Annotated[
    str | None,
    typer.Option(
        "--camera",
        metavar="SENSOR",
        help="See with a camera of the robot, by name; 'first' for the first one.",
        show_default=False,
    ),
]
FieldOfView = Annotated[
    float | None,
    typer.Option(
        "--fov", metavar="DEGREES", min=1.0, max=150.0, help="The vertical field of view.", show_default=False
    ),
]
Turntable = Annotated[bool, typer.Option("--turntable", help="A film: once around what the camera looks at.")]
Flight = Annotated[
    Path | None,
    typer.Option(
        "--flight",
        metavar="FILE",
        help="A film: a flight through cameras, one in each line: x y z and the point that it looks at, x y z.",
        show_default=False,
    ),
]
FrameRate = Annotated[float, typer.Option("--fps", metavar="RATE", min=1.0, max=120.0, help="Frames per second.")]
Length = Annotated[float, typer.Option("--length", metavar="SECONDS", min=0.1, max=600.0, help="The length of a film.")]
Seed = Annotated[SeedNumber, typer.Option("--seed", metavar="N", help="The seed of the samples.")]
Exposure = Annotated[Finite, typer.Option("--exposure", metavar="STOPS", help="Brighter (1) or darker (-1) by stops.")]
Denoise = Annotated[bool, typer.Option(" /--no-denoise", help="Do not remove noise.", show_default=False)]


def render(
    maps: MapArguments,
    *,
    output: Output,
    view: PictureOptions = DEFAULT_PICTURE,
    field_of_view: FieldOfView = None,
    opened: Opened = None,
    at: At = None,
    robot: RobotSource = None,
    camera: CameraName = None,
    turntable: Turntable = False,
    flight: Flight = None,
    frame_rate_hz: FrameRate = 25.0,
    length_s: Length = 6.0,
    samples: Samples = None,
    budget_s: Budget = None,
    denoise: Denoise = True,
    exposure_ev: Exposure = 0.0,
    seed: Seed = 0,
    options: MapSpawning = DEFAULT_SPAWN,
    as_json: AsJson = False,
) -> ExitCode:
    """Render a path-traced picture or film of a map, like a photograph; no display, GPU or browser is needed."""
    from msgspec import convert

    from mindstage.rendering.path_tracing import PathTracingSettings, check_renderer

    is_film = turntable or flight is not None
    _check_options(output, is_film=is_film, both=turntable and flight is not None)
    _check_camera(camera, has_robot=robot is not None, is_placed=bool(view.position or view.look_at or view.top))
    count = samples or (1024 if budget_s is not None else 4 if is_film else 16)
    quality = {"samples": count, "seconds": budget_s, "denoise": denoise, "seed": seed, "exposure_ev": exposure_ev}
    settings = convert({"size": parse_size(view.size), **quality}, PathTracingSettings)
    targets = highlight_targets(view.highlights or [], view.colors or [])
    check_renderer()  # before the map is read, so that a missing library fails at once
    moves = bool(opened) or robot is not None or view.simulated_s > 0.0
    with _scene(maps, at, options, decompose=moves) as (sim, summary):
        _open(sim, opened or [])
        own = None if robot is None else _add_robot(sim, robot, xacro=options.xacro_request)
        step_with_progress(sim, view.simulated_s)
        results = [target.apply(sim) for target in targets]
        taken = _Shooting(sim, settings, own, camera, clip_height=view.section)
        first = taken.camera(
            view.position, view.look_at, top=view.top, field_of_view=field_of_view, upright=not is_film
        )
        film = {"length_s": length_s, "frame_rate_hz": frame_rate_hz}
        summary |= taken.film(output, first, flight, **film) if is_film else taken.picture(output, first)
    _print_result({**summary, "picture": str(output), "size": settings.size}, results, as_json=as_json)
    return ExitCode.OK


class _Shooting:
    """Takes pictures and films of the present state of a simulation."""

    def __init__(
        self,
        simulation: Simulation,
        settings: PathTracingSettings,
        robot: str | None,
        camera: str | None,
        *,
        clip_height: float | None,
    ) -> None:
        from mindstage.scene import BodyId
        from mindstage.simulation.pictures import ScenePhotographer

        with progress_spinner("preparing"):
            self._photographer: ScenePhotographer = ScenePhotographer.of(simulation)
        self._simulation, self._settings, self._robot, self._camera = simulation, settings, robot, camera
        self._aspect, self._clip_height = settings.size[0] / settings.size[1], clip_height
        self._hidden = frozenset[BodyId]()

    def camera(
        self, position: str | None, look_at: str | None, *, top: bool, field_of_view: float | None, upright: bool
    ) -> CameraPose:
        """The camera of the options; without any that of the first view, upright or tilted.

        Raises:
            InvalidArgumentError: they are mutually exclusive, or a value is invalid.
        """
        from math import radians

        from msgspec.structs import replace

        if top and (position or look_at):
            raise InvalidArgumentError("--top", cause="it defines the camera", remedy="omit --from and --to")
        if self._camera is not None:
            found = self._robot_camera(self._camera)
        elif top:
            found = self._photographer.top_camera(self._aspect)
        elif not position and not look_at:
            found = self._photographer.first_camera(self._aspect, upright=upright)
        else:
            found = self._placed_camera(position, look_at)
        return found if field_of_view is None else replace(found, field_of_view_rad=radians(field_of_view))

    def picture(self, output: Path, camera: CameraPose) -> dict[str, object]:
        """Writes a picture; returns how it came about."""
        from mindstage.files import atomic_write
        from mindstage.rendering.path_tracing import path_trace

        with progress_bar("rendering") as progress:
            scene = self._scene(camera)
            picture = path_trace(scene, self._settings, progress=progress)
        output.parent.mkdir(parents=True, exist_ok=True)
        atomic_write(output, picture.encode(output.suffix))
        return {"samples": picture.samples, "seconds": round(picture.seconds, 2), "notes": list(picture.notes)}

    def film(
        self, output: Path, first: CameraPose, flight: Path | None, *, length_s: float, frame_rate_hz: float
    ) -> dict[str, object]:
        """Writes a film, whose pictures have one exposure and one sun; returns how it came about."""
        from msgspec.structs import replace

        from mindstage.rendering.films import FilmWriter
        from mindstage.rendering.path_tracing import path_trace, sun_azimuth
        from mindstage.simulation.pictures import flight as cameras_through
        from mindstage.simulation.pictures import turntable

        count = max(2, round(length_s * frame_rate_hz))
        cameras = turntable(first, count) if flight is None else cameras_through(_stops(flight, first), count)
        settings, notes = replace(self._settings, sun_azimuth_rad=sun_azimuth(cameras[0])), dict[str, None]()
        writer = FilmWriter(output, size=settings.size, frame_rate_hz=frame_rate_hz)
        with writer, progress_bar("rendering") as progress:
            for number, camera in enumerate(cameras):
                scene = self._scene(camera)
                picture = path_trace(scene, settings)
                settings = replace(settings, exposure=picture.exposure, exposure_ev=0.0)
                writer.add(picture.pixels)
                notes |= dict.fromkeys(picture.notes)
                progress((number + 1) / count)
        return {"frames": count, "notes": list(notes)}

    def _scene(self, camera: CameraPose) -> RenderScene:
        return self._photographer.scene(camera, aspect=self._aspect, hidden=self._hidden, clip_height=self._clip_height)

    def _placed_camera(self, position: str | None, look_at: str | None) -> CameraPose:
        from msgspec.structs import replace

        first = self._photographer.first_camera(self._aspect)
        point = None if look_at is None else parse_numbers(look_at)
        if look_at is not None and point is None:
            focused = self._photographer.camera_to(look_at, self._aspect)
            if position is None:
                return focused
            point = self._photographer.center_of(look_at)
        if position is not None:
            eye = parse_point("--from", position)
            if eye == (point or first.look_at):
                raise InvalidArgumentError("--from", cause="it is the point that --to names", remedy="move one of them")
            return replace(first, position=eye, look_at=point or first.look_at)
        if point is None:
            return first
        x, y, z = (eye + to - at for eye, to, at in zip(first.position, point, first.look_at, strict=True))
        return replace(first, position=(x, y, z), look_at=point)

    def _robot_camera(self, name: str) -> CameraPose:
        """The camera of the robot; its own bodies do not hide the view.

        Raises:
            InvalidArgumentError: it has none of that name.
        """
        from mindstage.robots import find_robot
        from mindstage.robots.models.robot_model import SensorType

        robot = find_robot(self._simulation, self._robot or "")
        kinds = (SensorType.CAMERA, SensorType.DEPTH_CAMERA)
        sensors = [sensor for sensor in robot.model.sensors if sensor.type in kinds]
        chosen = [sensor for sensor in sensors if name in (sensor.name, sensor.link)] or (
            sensors[:1] if name == "first" else []
        )
        if not chosen:
            known = ", ".join(sensor.name for sensor in sensors) or "no camera"
            raise InvalidArgumentError(
                "--camera", cause=f"{robot.name} has no camera {name!r}", remedy=f"it has {known}"
            )
        sensor = chosen[0]
        body = robot.link_ids[sensor.link]
        self._hidden = frozenset({body})
        forward = _AXIS_OF_OPTICS if sensor.is_optical else _AXIS_OF_LINK
        return self._photographer.camera_of_link(body, forward=forward, field_of_view_rad=sensor.field_of_view_rad)


@contextmanager
def _scene(
    maps: Sequence[str], at: float | None, options: MapSpawning, *, decompose: bool
) -> Iterator[tuple[Simulation, dict[str, object]]]:
    """A simulation of the map, or of a moment of an episode, and what JSON has of it.

    Raises:
        InvalidArgumentError: a time is given without an episode.
    """
    episodes = [map for map in maps if map.lower().endswith(_EPISODE_SUFFIX)]
    if episodes:
        from mindstage.episodes.history import open_episode

        if len(maps) > 1:
            raise InvalidArgumentError(episodes[0], cause="an episode has its own map", remedy="give it alone")
        with progress_spinner("reading"):
            history = open_episode(episodes[0])
        try:
            time_s = history.end_s if at is None else at
            with history.resume(time_s) as sim:
                yield sim, {"episode": episodes[0], "at_s": time_s, "engine": sim.engine.name}
        finally:
            history.close()
        return
    if at is not None:
        raise InvalidArgumentError("--at", cause="no episode is given", remedy="give a .mcap file, or omit it")
    running = make_engine(options.engine)
    with progress_spinner("reading"):
        knowledge = knowledge_base(maps, options)
        world = knowledge.world(options.map_name)
    with simulation_from_options(knowledge, running, options, decompose=decompose) as sim, exclusive(sim):
        with progress_spinner("spawning"):
            report = sim.spawn(world)
        print_failures(report)
        yield sim, {"map": world.iri, "engine": sim.engine.name, "spawn": report_json(report)}


def _open(simulation: Simulation, texts: Sequence[str]) -> None:
    """Opens doors and drawers.

    Raises:
        InvalidArgumentError: a part is not a number from 0 to 1.
        NameNotFoundError: no movable joint or body has that name.
    """
    for text in texts:
        name, equals, part = text.rpartition("=")
        try:
            fraction = float(part) if equals else 1.0
        except ValueError:
            cause, remedy = f"{part!r} is not a part of the range", "give 0 to 1, such as fridge_door=0.5"
            raise InvalidArgumentError("--open", cause=cause, remedy=remedy) from None
        motion = simulation.joint(name if equals else text).open(fraction)
        if not motion:
            warn(f"not opened as far as wanted: {motion}")


def _add_robot(simulation: Simulation, source: str, *, xacro: XacroRequest) -> str:
    from mindstage.robots.standing import add_standing_robot

    with progress_spinner("adding the robot"):
        return add_standing_robot(simulation, source, xacro=xacro).name


def _stops(path: Path, first: CameraPose) -> list[CameraPose]:
    """The cameras of a file.

    Raises:
        InvalidArgumentError: the file cannot be read, or a line is not six numbers.
    """
    from msgspec.structs import replace

    try:
        lines = path.read_text().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidArgumentError("--flight", cause=f"{path} cannot be read: {error}") from error
    found = []
    for number, line in enumerate(lines, start=1):
        text = line.partition("#")[0].replace(",", " ").split()
        if not text:
            continue
        eye, point = (parse_numbers(",".join(part)) for part in (text[:3], text[3:]))
        if eye is None or point is None or eye == point:
            cause = f"line {number} of {path} is not a camera: {line.strip()!r}"
            raise InvalidArgumentError("--flight", cause=cause, remedy="give two different points: 2 -3 1.6 0 0 1")
        found.append(replace(first, position=eye, look_at=point))
    return found


def _check_options(output: Path, *, is_film: bool, both: bool) -> None:
    """Checks the suffix before anything is read.

    Raises:
        InvalidArgumentError: it is none that can be written, or options are mutually exclusive.
    """
    from mindstage.rendering.films import FILM_SUFFIXES
    from mindstage.rendering.path_tracing import PICTURE_SUFFIXES

    if both:
        raise InvalidArgumentError("--flight", cause="--turntable is another film", remedy="give one of them")
    allowed = FILM_SUFFIXES if is_film else PICTURE_SUFFIXES
    if output.suffix.lower() not in allowed:
        remedy = f"there is {', '.join(allowed)}"
        if output.suffix.lower() in FILM_SUFFIXES:
            remedy = f"give --turntable or --flight for a film; for a picture {remedy}"
        cause = f"{'films' if is_film else 'pictures'} cannot be written as {output.suffix or 'a file without suffix'}"
        raise InvalidArgumentError("--output", cause=cause, remedy=remedy)


def _check_camera(camera: str | None, *, has_robot: bool, is_placed: bool) -> None:
    if camera is not None and (not has_robot or is_placed):
        raise InvalidArgumentError(
            "--camera", cause="it is a camera of a robot", remedy="give --robot, and omit --from, --to and --top"
        )


def _print_result(summary: dict[str, object], results: Sequence[HighlightResult], *, as_json: bool) -> None:
    if as_json:
        groups = [
            {
                "highlighted": list(result.highlighted),
                "not_highlighted": {item.id: item.reason for item in result.unhighlighted},
            }
            for result in results
        ]
        print_json(summary | {"highlights": groups})
        return
    for result in results:
        for item in result.unhighlighted:
            warn(f"not highlighted: {item.id}: {item.reason}")
    notes = summary["notes"]
    assert isinstance(notes, list)
    for note in notes:
        warn(note)
    print_line(f"picture → {summary['picture']}")
