"""Robot descriptions (URDF) as maps, and as sources of links for maps."""

from __future__ import annotations

from pathlib import Path

from tests.cli.runner import Run, json_output
from tests.maps.small_urdf import KITCHEN_URDF

LINKED = """
@prefix : <http://example.org/linked.owl#> .
@prefix urdf: <http://knowrob.org/kb/urdf.owl#> .
:cooler a <http://www.ease-crc.org/ont/SOMA.owl#Refrigerator> ; urdf:hasBaseLinkName "fridge" .
"""


def kitchen(folder: Path) -> str:
    path = folder / "kitchen.urdf"
    path.write_text(KITCHEN_URDF, encoding="utf-8")
    return str(path)


def test_a_robot_description_is_spawned_and_checked_like_a_map(run: Run, tmp_path: Path) -> None:
    spawned = run("spawn", kitchen(tmp_path), "--no-viewer", "--json")
    assert spawned.exit_code == 0
    assert (json_output(spawned)["spawn"]["bodies"], json_output(spawned)["spawn"]["joints"]) == (8, 2)
    checked = run("check", kitchen(tmp_path), "--json")
    assert (checked.exit_code, json_output(checked)["identical"], json_output(checked)["lost_facts"]) == (0, True, 0)


def test_a_map_takes_poses_from_a_robot_description(run: Run, tmp_path: Path) -> None:
    map = tmp_path / "linked.ttl"
    map.write_text(LINKED, encoding="utf-8")
    checked = run("check", str(map), "--urdf", kitchen(tmp_path), "--json")
    assert (checked.exit_code, json_output(checked)["identical"], json_output(checked)["spawn"]["bodies"]) == (
        0,
        True,
        8,
    )
    alone = run("check", str(map), "--json")
    assert alone.exit_code == 1
    assert "--urdf FILE" in str(json_output(alone)["findings"])


def test_an_invalid_robot_description_exits_2(run: Run, tmp_path: Path) -> None:
    map = tmp_path / "linked.ttl"
    map.write_text(LINKED, encoding="utf-8")
    result = run("spawn", str(map), "--urdf", str(map), "--no-viewer")
    assert result.exit_code == 2
    assert "not well-formed XML" in result.stderr
