"""The verb `validate`, and the options for units, frames and quaternion orders."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.runner import Run, WriteMap, json_output


def test_a_map_without_findings_is_clean(run: Run, write_map: WriteMap) -> None:
    result = run("validate", write_map(), "--json")
    assert result.exit_code == 0, result.stdout
    output = json_output(result)
    assert output["clean"] is True
    assert output["counts"] == {"error": 0, "warning": 0}
    assert output["findings"] == []
    (map,) = output["maps"]
    assert (map["bodies"], map["joints"], map["attachments"], map["lights"]) == (2, 0, 0, 0)
    assert {each["topic"]: each["value"] for each in map["assumptions"]} == {
        "units": "m",
        "frame": "ros",
        "quaternion": "wxyz",
    }
    assert all(each["evidence"] and not each["overridden"] for each in map["assumptions"])
    assert map["extent"]["size"] == [2.0, 0.0, 0.0]
    assert map["extent"]["tallest"] == "Mug1"


def test_findings_are_listed_and_exit_1(run: Run, write_map: WriteMap) -> None:
    invalid = write_map(mugs={"Mug1": "nan 2.0 0.0", "Mug2": "3.0 2.0 0.0", "Mug3": None})
    result = run("validate", invalid, "--json")
    assert result.exit_code == 1
    output = json_output(result)
    assert output["clean"] is False
    assert output["counts"]["error"] == 2
    skipped = {finding["individual"].split("#")[1] for finding in output["findings"] if finding["severity"] == "error"}
    assert skipped == {"Mug1", "Mug3"}
    assert {"severity", "individual", "property", "problem", "action", "group"} == set(output["findings"][0])


@pytest.mark.parametrize("content", ["once upon a time", "<rdf:RDF xmlns:rdf='http://x#'>", ""])
def test_an_unreadable_map_exits_2(content: str, run: Run, tmp_path: Path) -> None:
    path = tmp_path / "map.owl"
    path.write_text(content, encoding="utf-8")
    result = run("validate", path, "--json")
    assert result.exit_code == 2
    assert json_output(result)["error"]["code"] == "SourceParseError"
    assert run("validate", tmp_path / "nowhere.owl").exit_code == 2


def test_the_default_output_is_tables(run: Run, write_map: WriteMap) -> None:
    result = run("validate", write_map(mugs={"Mug1": "1.0 2.0 0.0", "Mug2": None}))
    assert result.exit_code == 1
    for words in (
        "Conventions of the map",
        "the default of SemLog maps",
        "Findings",
        "1 finding",
        "Extent: 0 x 0 x 0 m",
    ):
        assert words in result.stdout, result.stdout
    assert "No findings." in run("validate", write_map()).stdout


def test_several_maps_are_validated_together(run: Run, write_map: WriteMap) -> None:
    maps = write_map("a.owl", maps=["Room"]), write_map("b.owl", maps=["Hall"], mugs={"Jug": "0.0 0.0 0.0"})
    output = json_output(run("validate", *maps, "--json"))
    assert [map["map"].split("#")[1] for map in output["maps"]] == ["Room", "Hall"]


# -- strict ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", ["validate", "spawn", "check", "convert", "log"])
def test_strict_rejects_a_map_with_findings(verb: str, run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    path = write_map(mugs={"Mug1": "1.0 2.0 0.0", "Mug2": None})
    out = tmp_path / "out.owl"
    more = {"convert": [out], "log": ["-o", out, "--engine", "null"], "spawn": ["--no-viewer", "--engine", "null"]}
    result = run(verb, path, *more.get(verb, []), "--strict", "--json")
    assert result.exit_code == 2
    error = json_output(result)["error"]
    assert error["code"] == "MapRejectedError"
    assert "1 finding" in error["message"]
    assert "Mug2" in error["message"]
    assert not out.exists()


def test_strict_accepts_a_clean_map(run: Run, write_map: WriteMap) -> None:
    assert run("check", write_map(), "--engine", "null", "--strict").exit_code == 0


# -- conventions -------------------------------------------------------------------------------------------------------


def test_conventions_can_be_given(run: Run, write_map: WriteMap) -> None:
    result = run("validate", write_map(), "--units", "cm", "--frame", "unreal", "--quaternion", "xyzw", "--json")
    (map,) = json_output(result)["maps"]
    assert all(each["overridden"] for each in map["assumptions"])
    assert [each["value"] for each in map["assumptions"]] == ["cm", "unreal", "xyzw"]
    assert map["extent"]["low"] == pytest.approx([0.01, -0.02, 0.0])


def test_conventions_can_be_given_for_one_map(run: Run, write_map: WriteMap) -> None:
    maps = write_map("a.owl", maps=["Room"]), write_map("b.owl", maps=["Hall"], mugs={"Jug": "5.0 0.0 0.0"})
    output = json_output(run("validate", *maps, "--units", "b=cm", "--units", "mm", "--json"))
    units = {map["map"].split("#")[1]: map["assumptions"][0]["value"] for map in output["maps"]}
    assert units == {"Room": "mm", "Hall": "cm"}


@pytest.mark.parametrize(
    ("units", "message"), [("furlong", "use m, cm, mm"), ("hall=cm", "no map 'hall' is loaded"), ("=cm", "no map ''")]
)
def test_invalid_conventions_are_rejected(units: str, message: str, run: Run, write_map: WriteMap) -> None:
    result = run("check", write_map(), "--engine", "null", "--units", units, "--json")
    assert result.exit_code == 2
    assert message in json_output(result)["error"]["message"]


@pytest.mark.parametrize("verb", ["spawn", "check"])
def test_the_extent_and_the_conventions_are_printed(verb: str, run: Run, write_map: WriteMap) -> None:
    more = ["--no-viewer"] if verb == "spawn" else []
    result = run(verb, write_map(), "--engine", "null", *more, "--units", "mm")
    assert "Extent: 0.002 x 0 x 0 m" in result.stdout
    assert "chosen by the user" in result.stdout
    output = json_output(run(verb, write_map(), "--engine", "null", *more, "--json"))
    assert output["extent"]["height_m"] == 0.0
    assert len(output["assumptions"]) == 3


def test_the_round_trip_of_an_ameva_map_is_lossless(run: Run, shared_data: Path) -> None:
    result = run("check", shared_data / "maps" / "ameva-task-two.owl", "--json")
    assert result.exit_code == 0, result.stdout
    output = json_output(result)
    assert output["identical"] is True
    assert (output["max_error"], output["lost_facts"]) == (0.0, 0)
    assert [each["value"] for each in output["assumptions"]][:3] == ["cm", "unreal", "xyzw"]
    assert output["extent"]["height_m"] == pytest.approx(1.499, abs=1e-3)
