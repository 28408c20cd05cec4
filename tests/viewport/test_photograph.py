"""The script that makes the pictures of the documents."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from mindstage.knowledge import save_map
from tests.kitchenette import kitchenette

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "photograph.py"


def photograph(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


def test_a_map_is_photographed_with_its_drawer_open(chromium: Path, tmp_path: Path) -> None:
    save_map(kitchenette(), tmp_path / "map.owl")
    size = ("--browser", chromium, "--width", 800, "--height", 400)
    closed, opened = tmp_path / "new" / "closed.png", tmp_path / "new" / "opened.png"
    for picture, more in ((closed, ()), (opened, ("--open", "Drawer", "--select", "Mug"))):
        result = photograph(tmp_path / "map.owl", "-o", picture, *size, *more)
        assert (result.returncode, result.stderr) == (0, "")
    pixels = [np.asarray(Image.open(picture).convert("RGB")) for picture in (closed, opened)]
    assert pixels[0].shape == (400, 800, 3)
    assert len(np.unique(pixels[0].reshape(-1, 3), axis=0)) > 200
    view = np.s_[:, :400]
    assert np.any(pixels[0][view] != pixels[1][view], axis=2).mean() > 0.005


def test_trouble_is_one_line(chromium: Path, tmp_path: Path) -> None:
    result = photograph(tmp_path / "none.owl", "-o", tmp_path / "picture.png", "--browser", chromium)
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 1
    assert not (tmp_path / "picture.png").exists()
