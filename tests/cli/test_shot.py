"""The verb `shot`: pictures of maps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.cli.runner import Run, WriteMap, json_output


@pytest.mark.parametrize("suffix", ["png", "jpg", "webp"])
def test_a_picture_shows_highlighted_answers(run: Run, write_map: WriteMap, tmp_path: Path, suffix: str) -> None:
    picture = tmp_path / "new" / f"mugs.{suffix}"
    command = ("shot", write_map("mugs.owl", mugs={"X": "0 0 0", "Y": "0.3 0 0"}), "-o", picture, "--size", "240x160")
    command += (
        "--highlight",
        "individual_of_class cls=Mug",
        "--highlight",
        "Y",
        "--color",
        "#00ff00",
        "--color",
        "red",
    )
    result = run(*command, "--engine", "null", "--json")
    assert result.exit_code == 0, result.output
    answer = json_output(result)
    assert (answer["picture"], answer["size"], answer["spawn"]["ok"]) == (str(picture), [240, 160], True)
    assert [group["highlighted"] for group in answer["highlights"]] == [["X", "Y"], ["Y"]]
    image = Image.open(picture)
    assert image.format == {"png": "PNG", "jpg": "JPEG", "webp": "WEBP"}[suffix]
    pixels = np.asarray(image.convert("RGB")).astype(int)
    red, green, _ = np.moveaxis(pixels, -1, 0)
    assert pixels.shape == (160, 240, 3)
    assert np.count_nonzero(green > red + 60) > 100
    assert np.count_nonzero(red > green + 60) > 100


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--size", "big"), "'big' is not a size; give width and height, such as 1280x800"),
        (("--size", "0x100"), "size 0: it must be an integer from 1 to 8192"),
        (("--from", "1,2"), "'1,2' is not a point; give three numbers"),
        (("--from", "1,2,nan"), "is not a point"),
        (("--from", "1,2,3", "--to", "fridge"), "'fridge' is not a point"),
        (("--from", "1,2,3", "--to", "1,2,3"), "position and look_at are equal"),
        (("--top", "--to", "1,2,3"), "it defines the camera"),
        (("--labels", "some"), "there is none, selected, class, all"),
        (("--color", "red"), "there are 1 for 0 --highlight"),
        (("--highlight", "Mug", "--color", "redd"), "no color 'redd'; near: 'red'"),
        (("--highlight", "'Mug"), "cannot be read: No closing quotation"),
        (("--highlight", " "), "it is empty"),
    ],
)
def test_invalid_options_exit_2_before_the_map_is_read(
    run: Run, tmp_path: Path, options: tuple[str, ...], message: str
) -> None:
    result = run("shot", tmp_path / "none.owl", "-o", tmp_path / "x.png", *options)
    assert result.exit_code == 2
    assert message in result.stderr
    assert not (tmp_path / "x.png").exists()


def test_unknown_suffixes_are_errors(run: Run, tmp_path: Path) -> None:
    result = run("shot", tmp_path / "none.owl", "-o", tmp_path / "x.bmp")
    assert result.exit_code == 2
    assert ".bmp is no format of pictures; end it with .png, .jpg, .jpeg, .webp" in " ".join(result.stderr.split())


@pytest.mark.parametrize("option", ["--highlight", "--open", "--select", "--to"])
def test_unknown_bodies_are_errors(run: Run, write_map: WriteMap, tmp_path: Path, option: str) -> None:
    command = ("shot", write_map("mugs.owl", mugs={"X": "0 0 0"}), "-o", tmp_path / "x.png", "--engine", "null")
    result = run(*command, option, "Nothing")
    assert result.exit_code in {1, 2}
    assert "'Nothing'" in result.stderr
    assert not (tmp_path / "x.png").exists()


def test_unknown_bodies_cannot_be_highlighted_or_opened(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    command = ("shot", write_map("mugs.owl", mugs={"X": "0 0 0"}), "-o", tmp_path / "x.png", "--engine", "null")
    result = run(*command, "--highlight", "Mugg")
    assert result.exit_code == 2
    assert "no question, body or class 'Mugg' is known; near: 'Mug'" in result.stderr
    result = run(*command, "--open", "Door")
    assert result.exit_code == 1
    assert "no body 'Door'" in result.stderr


def test_a_missing_folder_of_meshes_is_an_error(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    command = ("shot", write_map("mugs.owl", mugs={"X": "0 0 0"}), "-o", tmp_path / "x.png")
    result = run(*command, "--engine", "null", "--assets", tmp_path / "meshes")
    assert result.exit_code == 2
    assert "there is no such folder; --assets takes folders of mesh files" in " ".join(result.stderr.split())
