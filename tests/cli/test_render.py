"""The verb `render`: path-traced pictures and films."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

import mindstage as ms
from tests.cli.runner import Run, WriteMap, json_output

pytest.importorskip("mitsuba", reason="needs the extra render")

from mindstage.episodes import Recorder
from mindstage.rendering.path_tracing import PathTracingSettings
from mindstage.scene import Pose
from mindstage.simulation import Marker, MarkerType

DATA_MAPS = ("iai-kitchen-original.owl", "soma-iai-room.owl", "knowrob1-ccrl.owl")
QUICK = ("--samples", 1, "--size", "64x40", "--engine", "null", "--json")


def test_a_picture_of_the_kitchen_shows_highlights(run: Run, tmp_path: Path) -> None:
    picture = tmp_path / "new" / "kitchen.png"
    result = run("render", "bundled:kitchen", "-o", picture, *QUICK, "--highlight", "fridge", "--color", "red")
    assert result.exit_code == 0, result.output
    answer = json_output(result)
    assert (answer["picture"], answer["size"], answer["samples"]) == (str(picture), [64, 40], 1)
    assert [group["highlighted"] for group in answer["highlights"]] == [["fridge"]]
    pixels = np.asarray(Image.open(picture).convert("RGB")).astype(int)
    assert pixels.shape == (40, 64, 3)
    assert 60 < pixels.mean() < 220
    assert np.count_nonzero(pixels[..., 0] > pixels[..., 1] + 90) > 5


@pytest.mark.parametrize("name", DATA_MAPS)
def test_maps_of_others_are_rendered_with_contrast(name: str, run: Run, shared_data: Path, tmp_path: Path) -> None:
    picture = tmp_path / "picture.png"
    result = run("render", shared_data / "maps" / name, "-o", picture, *QUICK)
    assert result.exit_code == 0, result.output
    pixels = np.asarray(Image.open(picture).convert("L")).astype(float)
    assert 50 < pixels.mean() < 225
    assert pixels.std() > 8


def test_a_turntable_is_a_film_of_its_length(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    film = tmp_path / "film.webp"
    command = ("render", write_map("mugs.owl", mugs={"X": "0 0 0"}), "-o", film, "--turntable", "--fps", 5)
    result = run(*command, "--length", 1, *QUICK)
    assert result.exit_code == 0, result.output
    assert json_output(result)["frames"] == 5
    with Image.open(film) as image:
        assert (image.n_frames, image.size) == (5, (64, 40))


def test_a_flight_has_its_frames_and_begins_at_its_first_stop(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    stops, film, still = tmp_path / "stops.txt", tmp_path / "film.webp", tmp_path / "still.png"
    stops.write_text("0.4 0 0.2  0 0 0\n0.4 0 0.2  5 0 3\n", encoding="utf-8")
    path = write_map("mugs.owl", mugs={"X": "0 0 0"})
    result = run("render", path, "-o", film, "--flight", stops, "--fps", 4, "--length", 1, *QUICK)
    assert result.exit_code == 0, result.output
    assert json_output(result)["frames"] == 4
    assert run("render", path, "-o", still, "--from=0.4,0,0.2", "--to=0,0,0", *QUICK).exit_code == 0
    with Image.open(film) as image:
        frames = [np.asarray(frame.convert("RGB")).astype(int) for frame in ImageSequence.Iterator(image)]
    first = np.asarray(Image.open(still).convert("RGB")).astype(int)
    near, far = (np.abs(frame - first).mean() for frame in (frames[0], frames[-1]))
    assert near < 12 < far


def test_a_moment_of_an_episode_is_rendered(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    episode = tmp_path / "fall.mcap"
    with ms.open(write_map("mugs.owl", mugs={"X": "-0.3 0 1.8"}), engine="null") as sim, Recorder(sim, episode):
        sim.step(0.2)
        sim.edits.move(sim.snapshot().bodies[0].id, Pose((0.3, 0.0, 1.8)))
        sim.step(0.3)
    pictures = []
    for at in (0.0, 0.4):
        picture = tmp_path / f"{at}.png"
        command = ("render", episode, "--at", at, "-o", picture, "--from=0,-1.5,2.4", "--to=0,0,1.8")
        result = run(*command, "--samples", 4, "--size", "160x100", "--json")
        assert result.exit_code == 0, result.output
        assert json_output(result)["at_s"] == at
        pictures.append(np.asarray(Image.open(picture).convert("L")).astype(float))
    changed = np.abs(pictures[1] - pictures[0]).max(axis=0)
    assert changed[:70].max() > 30, "where the mug was"
    assert changed[-70:].max() > 30, "where it is later"


def test_a_door_that_is_opened_changes_the_picture(run: Run, tmp_path: Path) -> None:
    pictures = []
    for number, options in enumerate(((), ("--open", "fridge_door=0.8"))):
        picture = tmp_path / f"{number}.png"
        command = ("render", "bundled:kitchen", "-o", picture, *QUICK, "--to", "fridge", *options)
        assert run(*command).exit_code == 0
        pictures.append(np.asarray(Image.open(picture)).astype(int))
    assert np.abs(pictures[1] - pictures[0]).mean() > 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--size", "big"), "'big' is not a size"),
        (("-o", "x.bmp"), "pictures cannot be written as .bmp; there is .png"),
        (("-o", "x.mp4"), "give --turntable or --flight for a film"),
        (("-o", "x.png", "--turntable"), "films cannot be written as .png; there is .mp4"),
        (("-o", "x.mp4", "--turntable", "--flight", "f.txt"), "give one of them"),
        (("--camera", "head"), "give --robot"),
        (("--top", "--to", "1,2,3"), "it defines the camera"),
        (("--at", "1"), "give a .mcap file"),
        (("--open", "fridge_door=wide"), "'wide' is not a part of the range"),
        (("--open", "nothing"), "nothing"),
        (("-o", "x.mp4", "--flight", "missing.txt"), "cannot be read"),
    ],
)
def test_bad_options_are_refused(options: tuple[str, ...], message: str, run: Run, tmp_path: Path) -> None:
    result = run("render", "bundled:kitchen", *(() if "-o" in options else ("-o", tmp_path / "x.png")), *options)
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())
    assert not list(tmp_path.iterdir())


def test_a_running_simulation_is_rendered_from_one_snapshot() -> None:
    with ms.open("bundled:kitchen") as sim:
        sim.highlight("fridge", "blue")
        red = {"size": (0.8, 0.8, 0.8), "color": (1.0, 0.0, 0.0)}
        sim.markers.add([Marker(id="red", type=MarkerType.CUBE, pose=Pose((0.3, 0.3, 1.2)), **red)])
        sim.play()
        picture = sim.render(settings=PathTracingSettings(size=(48, 30), samples=1))
        assert sim.state.playing
    assert picture.pixels.shape == (30, 48, 3)
    pixels = picture.pixels.astype(int)
    assert np.count_nonzero(pixels[..., 2] > pixels[..., 0] + 60) > 3
    assert np.count_nonzero(pixels[..., 0] > pixels[..., 2] + 60) > 10, "the marker is drawn"
