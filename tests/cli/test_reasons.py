"""Verbs say why they exit with 1, and like findings are one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.rdf import Finding, Severity
from mindstage.rdf.graphs import group_findings, group_name
from tests.cli.runner import Run, WriteMap, json_output
from tests.maps.dialect_maps import soma_map
from tests.maps.small_maps import body_turtle, room_map


def last_line(output: str) -> str:
    return output.strip().splitlines()[-1]


def test_a_clean_check_has_no_reasons(write_map: WriteMap, run: Run) -> None:
    output = json_output(run("check", write_map(), "--engine", "null", "--json"))
    assert (output["verdict"], output["reasons"], output["identical"]) == ("ok", [], True)
    assert last_line(run("check", write_map(), "--engine", "null").stdout) == "Identical at delta 0."


def test_check_says_that_findings_of_severity_error_are_the_reason(write_map: WriteMap, run: Run) -> None:
    path = write_map(mugs={"Mug1": "1.0 2.0 0.0", "Mug2": None})
    result = run("check", path, "--engine", "null", "--json")
    output = json_output(result)
    assert result.exit_code == 1
    assert (output["verdict"], output["identical"]) == ("incomplete", True)
    (reason,) = output["reasons"]
    assert (reason["kind"], reason["count"]) == ("findings", 1)
    assert "Mug2" in reason["text"]
    line = last_line(run("check", path, "--engine", "null").stdout)
    assert line.startswith("Identical at delta 0, but: 1 finding of severity error (Mug2: ")


@pytest.mark.parametrize("verb", [("spawn", "--no-viewer"), ("log", "--out", "logged.owl")])
def test_spawn_and_log_say_why_they_exit_with_1(
    verb: tuple[str, ...], write_map: WriteMap, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = write_map(mugs={"Mug1": "1.0 2.0 0.0", "Mug2": None})
    result = run(*verb, path, "--engine", "null")
    assert result.exit_code == 1
    assert last_line(result.stdout).startswith("Incomplete: 1 finding of severity error (Mug2: ")
    assert json_output(run(*verb, path, "--engine", "null", "--json"))["reasons"][0]["kind"] == "findings"


def test_check_names_the_bodies_that_moved(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "map.ttl"
    path.write_text(
        room_map(
            body_turtle("table", 'k:mobility "static"', *sizes(2.0, 2.0, 0.1), cls="k:Table", position="0.0 0.0 0.0"),
            body_turtle("cup", 'k:mobility "dynamic"', *sizes(0.1, 0.1, 0.1), position="0.0 0.0 2.0"),
        ),
        encoding="utf-8",
    )
    output = json_output(result := run("check", path, "--json"))
    assert result.exit_code == 1
    assert output["verdict"] == "incomplete"
    assert [(reason["kind"], reason["count"]) for reason in output["reasons"]] == [("moved", 1)]
    assert "cup" in output["reasons"][0]["text"]


def sizes(x: float, y: float, z: float) -> list[str]:
    names = ("depthOfObject", "widthOfObject", "heightOfObject")
    return [f'k:{name} "{extent}"^^xsd:float' for name, extent in zip(names, (x, y, z), strict=True)]


# -- groups ------------------------------------------------------------------------------------------------------------


def finding(individual: str, problem: str, severity: Severity = Severity.WARNING) -> Finding:
    return Finding(
        severity, f"http://example.org/room.owl#{individual}", "http://example.org/k#mass", problem, "ignored"
    )


def test_findings_that_differ_in_names_and_numbers_are_of_one_group() -> None:
    like = [
        finding("cup1", "'1,5' of cup1 is 3 times http://example.org/room.owl#jar"),
        finding("cup2", "'2,5' of spoon_2 is 4.5 times http://example.org/room.owl#pot"),
    ]
    other = finding("cup1", "it is missing")
    worse = finding("cup9", "it is missing", Severity.ERROR)
    groups = group_findings([*like, other, worse])
    assert [group.findings for group in groups] == [(worse,), tuple(like), (other,)]
    assert len({group_name(each) for each in (*like, other, worse)}) == 3


def many_mugs(count: int) -> dict[str, str | None]:
    return {f"Mug{number}": "1,0 2.0 0.0" if number % 2 else f"{number}.0 2.0 0.0" for number in range(2 * count)}


def test_like_findings_are_one_line_with_their_number_and_classes(write_map: WriteMap, run: Run) -> None:
    path = write_map(mugs=many_mugs(20))
    text = run("validate", path).stderr
    (line,) = [line for line in text.splitlines() if "decimals have a point" in line]
    assert "20 like this" in line
    assert "the first about Mug1" in line
    verbose = run("validate", path, "--verbose").stderr
    assert sum("decimals have a point" in line for line in verbose.splitlines()) == 20


def test_json_has_each_finding_with_its_group(write_map: WriteMap, run: Run) -> None:
    findings = json_output(run("validate", write_map(mugs=many_mugs(5)), "--json"))["findings"]
    commas = [each for each in findings if "decimals have a point" in each["problem"]]
    assert len(commas) == 5
    assert len({each["group"] for each in commas}) == 1
    assert len({each["group"] for each in findings}) > 1


def test_the_line_of_a_group_names_the_classes(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "map.ttl"
    cups = [body_turtle(f"cup{number}", 'k:mass "heavy"') for number in range(4)]
    spoons = [body_turtle(f"spoon{number}", 'k:mass "heavy"', cls="k:Spoon") for number in range(3)]
    path.write_text(room_map(*cups, *spoons), encoding="utf-8")
    assert "7 like this (4 Cup, 3 Spoon)" in run("validate", path).stderr


# -- advice ------------------------------------------------------------------------------------------------------------


def test_missing_mesh_files_are_one_finding_that_names_the_option(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "map.ttl"
    cups = [body_turtle(f"cup{at}", f'k:pathToCadModel "package://meshes/cup{at % 3}.dae"') for at in range(9)]
    path.write_text(room_map(*cups), encoding="utf-8")
    (found,) = json_output(run("validate", path, "--json"))["findings"]
    assert found["problem"].startswith("3 mesh files are missing, of 9 of 9 bodies, such as package://meshes/cup0.dae")
    assert "--assets" in found["action"]


def test_mesh_files_in_the_folder_of_assets_are_not_missing(tmp_path: Path, run: Run) -> None:
    path, folder = tmp_path / "map.ttl", tmp_path / "meshes"
    folder.mkdir()
    for at in range(2):
        (folder / f"cup{at}.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    cups = [body_turtle(f"cup{at}", f'k:pathToCadModel "package://meshes/cup{at}.dae"') for at in range(3)]
    path.write_text(room_map(*cups), encoding="utf-8")
    findings = json_output(run("spawn", path, "--no-viewer", "--engine", "null", "--assets", folder, "--json"))
    (found,) = findings["findings"]
    assert found["problem"].startswith("1 mesh file is missing, of 1 of 3 bodies, such as package://meshes/cup2.dae")


def test_a_map_of_links_without_a_robot_description_asks_for_it(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "apartment.ttl"
    links = "\n".join(f':shelf{at} a soma:Shelf ; urdf:hasBaseLinkName "shelf_{at}" .' for at in range(30))
    path.write_text(soma_map(links), encoding="utf-8")
    for verb in (("validate",), ("spawn", "--no-viewer", "--engine", "null"), ("check", "--engine", "null")):
        result = run(*verb, path, "--json")
        assert result.exit_code == 1
        errors = [each for each in json_output(result)["findings"] if each["severity"] == "error"]
        assert "30 individuals" in errors[0]["problem"]
        assert "--urdf" in errors[0]["action"]
        assert len({each["group"] for each in errors[1:]}) == 1  # each individual without a pose
        assert "--urdf" in last_line(run(*verb, path).stdout) or verb == ("validate",)


def test_a_circle_of_dependencies_is_a_finding(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "map.ttl"
    circle = ":cup e:depends-on :jar . :jar e:depends-on :pot . :pot e:depends-on :cup, :lid . :lid e:dependsOn :lid ."
    bodies = [body_turtle(name) for name in ("cup", "jar", "pot", "lid", "top")]
    path.write_text(room_map(*bodies, circle, ":top e:depends-on :cup ."), encoding="utf-8")
    findings = json_output(run("validate", path, "--json"))["findings"]
    circles = {
        each["individual"].rpartition("#")[2]: each["problem"] for each in findings if "itself" in each["problem"]
    }
    assert circles == {
        "cup": "it depends on itself: cup → jar → pot → cup",
        "lid": "it depends on itself: lid → lid",
    }


def test_dependencies_without_a_circle_are_no_finding(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "map.ttl"
    bodies = [body_turtle(name, position=f"{at}.0 0.0 0.0") for at, name in enumerate(("cup", "jar", "pot"))]
    path.write_text(room_map(*bodies, ":cup e:depends-on :jar, :pot . :jar e:depends-on :pot ."), encoding="utf-8")
    assert json_output(run("validate", path, "--json", "--mobility", "static"))["findings"] == []


@pytest.mark.parametrize("name", ["bundled:kitchn", "bundled:Kitchen", "bundled:kitchen.owl"])
def test_a_misspelled_bundled_map_is_answered_with_the_right_name(name: str, run: Run) -> None:
    result = run("validate", name)
    assert result.exit_code == 2
    assert "did you mean bundled:kitchen?" in result.stderr
