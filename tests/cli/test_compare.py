"""Everything in which two maps differ."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.typed import Run, WriteMap, json_output


def test_a_map_is_identical_to_itself(run: Run, write_map: WriteMap) -> None:
    path = write_map()
    result = run("compare", path, path, "--json")
    assert result.exit_code == 0
    verdict = json_output(result)
    assert verdict["identical"] is True
    assert verdict["max_error"] == 0.0
    assert verdict["only_in_a"] == verdict["only_in_b"] == verdict["changed"] == []
    assert verdict["lost_facts"] == 0


def test_a_mug_that_was_moved(run: Run, write_map: WriteMap) -> None:
    a = write_map("a.owl", mugs={"Mug": "1.0 2.0 0.0"})
    b = write_map("b.owl", mugs={"Mug": "1.0 2.5 0.0"})
    result = run("compare", a, b, "--json")
    assert result.exit_code == 1
    verdict = json_output(result)
    assert verdict["identical"] is False
    assert verdict["delta"] == 0.0
    assert verdict["errors"]["translation_m"] == pytest.approx(0.5)
    (change,) = verdict["changed"]
    assert change["id"] == "Mug"
    assert change["error"] == pytest.approx(0.5)
    assert run("compare", a, b, "--delta", "0.6").exit_code == 0


def test_a_mug_that_is_missing(run: Run, write_map: WriteMap) -> None:
    a = write_map("a.owl", mugs={"Mug": "1 2 0", "Spare": "1 1 1"})
    b = write_map("b.owl", mugs={"Mug": "1 2 0"})
    there, back = run("compare", a, b, "--json"), run("compare", b, a, "--json", "--delta", "1000")
    assert there.exit_code == back.exit_code == 1
    assert json_output(there)["only_in_a"] == json_output(back)["only_in_b"] == ["Spare"]


def test_people_get_tables_and_a_verdict(run: Run, write_map: WriteMap) -> None:
    a = write_map("a.owl", mugs={"Mug": "1.0 2.0 0.0"})
    b = write_map("b.owl", mugs={"Mug": "1.0 2.5 0.0"})
    result = run("compare", a, b)
    assert "Mug" in result.stdout
    assert result.stdout.rstrip().endswith("Different at delta 0; poses, masses and limits are not identical.")
    assert run("compare", a, a).stdout.rstrip().endswith("Identical at delta 0.")


def test_what_the_thesis_found_and_what_it_missed(run: Run, shared_data: Path) -> None:
    maps = [shared_data / "maps" / f"iai-kitchen-{name}.owl" for name in ("original", "spawned")]
    result = run("compare", *maps, "--delta", "2e-6", "--json")
    assert result.exit_code == 1
    verdict = json_output(result)
    assert verdict["errors"]["translation_m"] == pytest.approx(1e-6, abs=1e-9)
    assert verdict["identical_mechanics"] is True
    assert verdict["only_in_a"] == verdict["only_in_b"] == []
    # The panorama shrank from 177.51 m to 29.59 m, and one body lost its mesh.
    assert verdict["errors"]["size_m"] == pytest.approx(177.51 - 29.59, abs=0.01)
    assert "mesh" in {change["field"] for change in verdict["changed"]}
