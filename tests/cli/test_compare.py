"""The verb `compare`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.runner import Run, WriteMap, json_output


def test_a_map_is_identical_to_itself(run: Run, write_map: WriteMap) -> None:
    path = write_map()
    result = run("compare", path, path, "--json")
    assert result.exit_code == 0
    output = json_output(result)
    assert output["identical"] is True
    assert output["max_error"] == 0.0
    assert output["only_in_a"] == output["only_in_b"] == output["changed"] == []
    assert output["lost_facts"] == 0


def test_a_moved_mug(run: Run, write_map: WriteMap) -> None:
    a = write_map("a.owl", mugs={"Mug": "1.0 2.0 0.0"})
    b = write_map("b.owl", mugs={"Mug": "1.0 2.5 0.0"})
    result = run("compare", a, b, "--json")
    assert result.exit_code == 1
    output = json_output(result)
    assert output["identical"] is False
    assert output["delta"] == 0.0
    assert output["errors"]["translation_m"] == pytest.approx(0.5)
    (change,) = output["changed"]
    assert change["id"] == "Mug"
    assert change["error"] == pytest.approx(0.5)
    assert run("compare", a, b, "--delta", "0.6").exit_code == 0


def test_a_missing_mug(run: Run, write_map: WriteMap) -> None:
    a = write_map("a.owl", mugs={"Mug": "1 2 0", "Spare": "1 1 1"})
    b = write_map("b.owl", mugs={"Mug": "1 2 0"})
    forward, backward = run("compare", a, b, "--json"), run("compare", b, a, "--json", "--delta", "1000")
    assert forward.exit_code == backward.exit_code == 1
    assert json_output(forward)["only_in_a"] == json_output(backward)["only_in_b"] == ["Spare"]


def test_the_default_output_is_tables_and_a_summary(run: Run, write_map: WriteMap) -> None:
    a = write_map("a.owl", mugs={"Mug": "1.0 2.0 0.0"})
    b = write_map("b.owl", mugs={"Mug": "1.0 2.5 0.0"})
    result = run("compare", a, b)
    assert "Mug" in result.stdout
    assert result.stdout.rstrip().endswith("Different at delta 0; poses, masses and limits are not identical.")
    assert run("compare", a, a).stdout.rstrip().endswith("Identical at delta 0.")


def test_the_differences_found_and_missed_in_the_thesis(run: Run, shared_data: Path) -> None:
    maps = [shared_data / "maps" / f"iai-kitchen-{name}.owl" for name in ("original", "spawned")]
    result = run("compare", *maps, "--delta", "2e-6", "--json")
    assert result.exit_code == 1
    output = json_output(result)
    assert output["errors"]["translation_m"] == pytest.approx(1e-6, abs=1e-9)
    assert output["identical_mechanics"] is True
    assert output["only_in_a"] == output["only_in_b"] == []
    # The panorama shrank from 126 m to 21 m (turned by 50 degrees: bounds of 177.51, 29.59 m); a body lost its mesh.
    assert output["errors"]["size_m"] == pytest.approx(126.0 - 21.0, abs=0.01)
    assert "mesh" in {change["field"] for change in output["changed"]}
