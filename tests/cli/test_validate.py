"""`mindstage validate`, and the options that say how a map's numbers are meant."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.typed import Run, WriteMap, json_output


def test_a_map_without_oddities_is_clean(run: Run, write_map: WriteMap) -> None:
    result = run("validate", write_map(), "--json")
    assert result.exit_code == 0, result.stdout
    verdict = json_output(result)
    assert verdict["clean"] is True
    assert verdict["counts"] == {"error": 0, "warning": 0}
    assert verdict["findings"] == []
    (map,) = verdict["maps"]
    assert (map["bodies"], map["constraints"], map["attachments"], map["lights"]) == (2, 0, 0, 0)
    assert {each["about"]: each["value"] for each in map["assumptions"]} == {
        "units": "m",
        "frame": "ros",
        "quaternion": "wxyz",
    }
    assert all(each["evidence"] and not each["overridden"] for each in map["assumptions"])
    assert map["extent"]["size"] == [2.0, 0.0, 0.0]
    assert map["extent"]["tallest"] == "Mug1"


def test_findings_end_with_1_and_are_listed(run: Run, write_map: WriteMap) -> None:
    spoilt = write_map(mugs={"Mug1": "nan 2.0 0.0", "Mug2": "3.0 2.0 0.0", "Mug3": None})
    result = run("validate", spoilt, "--json")
    assert result.exit_code == 1
    verdict = json_output(result)
    assert verdict["clean"] is False
    assert verdict["counts"]["error"] == 2
    left_out = {
        finding["individual"].split("#")[1] for finding in verdict["findings"] if finding["severity"] == "error"
    }
    assert left_out == {"Mug1", "Mug3"}
    assert {"severity", "individual", "property", "what", "did"} == set(verdict["findings"][0])


@pytest.mark.parametrize("content", ["once upon a time", "<rdf:RDF xmlns:rdf='http://x#'>", ""])
def test_what_cannot_be_read_ends_with_2(content: str, run: Run, tmp_path: Path) -> None:
    path = tmp_path / "map.owl"
    path.write_text(content, encoding="utf-8")
    result = run("validate", path, "--json")
    assert result.exit_code == 2
    assert json_output(result)["error"]["kind"] == "SourceUnreadable"
    assert run("validate", tmp_path / "nowhere.owl").exit_code == 2


def test_people_see_tables(run: Run, write_map: WriteMap) -> None:
    result = run("validate", write_map(mugs={"Mug1": "1.0 2.0 0.0", "Mug2": None}))
    assert result.exit_code == 1
    for words in ("How the map was taken", "the default of SemLog maps", "What is odd", "1 finding", "Extent: 0 x 0 x 0 m"):
        assert words in result.stdout, result.stdout
    assert "Nothing odd was found." in run("validate", write_map()).stdout


def test_several_maps_are_validated_together(run: Run, write_map: WriteMap) -> None:
    maps = write_map("a.owl", maps=["Room"]), write_map("b.owl", maps=["Hall"], mugs={"Jug": "0.0 0.0 0.0"})
    verdict = json_output(run("validate", *maps, "--json"))
    assert [map["map"].split("#")[1] for map in verdict["maps"]] == ["Room", "Hall"]


# -- strict ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", ["validate", "spawn", "check", "convert", "log"])
def test_strict_refuses_what_is_odd(verb: str, run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    path = write_map(mugs={"Mug1": "1.0 2.0 0.0", "Mug2": None})
    out = tmp_path / "out.owl"
    more = {"convert": [out], "log": ["-o", out, "--engine", "null"], "spawn": ["--no-viewport", "--engine", "null"]}
    result = run(verb, path, *more.get(verb, []), "--strict", "--json")
    assert result.exit_code == 2
    error = json_output(result)["error"]
    assert error["kind"] == "MapRefused"
    assert "1 finding" in error["message"]
    assert "Mug2" in error["message"]
    assert not out.exists()


def test_strict_lets_a_clean_map_pass(run: Run, write_map: WriteMap) -> None:
    assert run("check", write_map(), "--engine", "null", "--strict").exit_code == 0


# -- numbers -----------------------------------------------------------------------------------------------------------


def test_numbers_are_taken_as_the_user_says(run: Run, write_map: WriteMap) -> None:
    result = run("validate", write_map(), "--units", "cm", "--frame", "unreal", "--quaternion", "xyzw", "--json")
    (map,) = json_output(result)["maps"]
    assert all(each["overridden"] for each in map["assumptions"])
    assert [each["value"] for each in map["assumptions"]] == ["cm", "unreal", "xyzw"]
    assert map["extent"]["low"] == pytest.approx([0.01, -0.02, 0.0])


def test_numbers_can_be_told_of_one_map_only(run: Run, write_map: WriteMap) -> None:
    maps = write_map("a.owl", maps=["Room"]), write_map("b.owl", maps=["Hall"], mugs={"Jug": "5.0 0.0 0.0"})
    verdict = json_output(run("validate", *maps, "--units", "b=cm", "--units", "mm", "--json"))
    units = {map["map"].split("#")[1]: map["assumptions"][0]["value"] for map in verdict["maps"]}
    assert units == {"Room": "mm", "Hall": "cm"}


@pytest.mark.parametrize(
    ("told_so", "hint"), [("furlong", "use m, cm, mm"), ("hall=cm", "no map 'hall' is loaded"), ("=cm", "no map ''")]
)
def test_numbers_that_mean_nothing_are_refused(told_so: str, hint: str, run: Run, write_map: WriteMap) -> None:
    result = run("check", write_map(), "--engine", "null", "--units", told_so, "--json")
    assert result.exit_code == 2
    assert hint in json_output(result)["error"]["message"]


@pytest.mark.parametrize("verb", ["spawn", "check"])
def test_a_wrong_guess_can_be_seen(verb: str, run: Run, write_map: WriteMap) -> None:
    more = ["--no-viewport"] if verb == "spawn" else []
    result = run(verb, write_map(), "--engine", "null", *more, "--units", "mm")
    assert "Extent: 0.002 x 0 x 0 m" in result.stdout
    assert "chosen by the user" in result.stdout
    verdict = json_output(run(verb, write_map(), "--engine", "null", *more, "--json"))
    assert verdict["extent"]["height_m"] == 0.0
    assert len(verdict["assumptions"]) == 3


def test_a_map_of_ameva_comes_back_whole(run: Run, shared_data: Path) -> None:
    result = run("check", shared_data / "maps" / "ameva-task-two.owl", "--json")
    assert result.exit_code == 0, result.stdout
    verdict = json_output(result)
    assert verdict["identical"] is True
    assert (verdict["max_error"], verdict["lost_facts"]) == (0.0, 0)
    assert [each["value"] for each in verdict["assumptions"]][:3] == ["cm", "unreal", "xyzw"]
    assert verdict["extent"]["height_m"] == pytest.approx(1.499, abs=1e-3)
