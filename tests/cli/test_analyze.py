"""The verb `analyze`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.runner import Run, WriteMap, json_output

COUNTS = ("classes", "individuals", "objects", "constraints", "relations")


@pytest.mark.parametrize("name", ["original", "spawned"])
def test_the_counts_equal_those_of_the_thesis(name: str, run: Run, shared_data: Path) -> None:
    result = run("analyze", shared_data / "maps" / f"iai-kitchen-{name}.owl", "--json")
    assert result.exit_code == 0
    assert [json_output(result)[count] for count in COUNTS] == [64, 136, 114, 22, 55]


def test_a_map_of_two_mugs(run: Run, write_map: WriteMap) -> None:
    result = run("analyze", write_map(), "--json")
    assert result.exit_code == 0
    analysis = json_output(result)
    assert analysis["map"] == "http://example.org/room.owl#Room"
    assert [analysis[count] for count in COUNTS] == [1, 2, 2, 0, 0]


def test_several_maps_are_a_list(run: Run, write_map: WriteMap) -> None:
    result = run("analyze", write_map(maps=["Kitchen", "Cellar"]), "--json")
    assert {analysis["map"].split("#")[1]: analysis["objects"] for analysis in json_output(result)} == {
        "Kitchen": 2,
        "Cellar": 0,
    }


def test_one_of_several_maps_is_an_object(run: Run, write_map: WriteMap) -> None:
    result = run("analyze", write_map(maps=["Kitchen", "Cellar"]), "--map-name", "Cellar", "--json")
    assert json_output(result)["objects"] == 0


def test_two_files_in_one_knowledge_base(run: Run, write_map: WriteMap) -> None:
    first = write_map("first.owl", maps=["First"], mugs={"A": "0 0 0"})
    second = write_map("second.owl", maps=["Second"], mugs={"B": "0 0 0", "C": "1 1 1"})
    result = run("analyze", first, second, "--json")
    assert sorted(analysis["objects"] for analysis in json_output(result)) == [1, 2]


def test_the_default_output_is_a_table(run: Run, write_map: WriteMap) -> None:
    result = run("analyze", write_map())
    assert result.exit_code == 0
    assert "objects" in result.stdout
    assert "{" not in result.stdout


def test_a_missing_import_is_a_warning_that_names_it(run: Run, write_map: WriteMap) -> None:
    path = write_map()
    wanted = '<owl:Ontology rdf:about="http://example.org/room.owl">'
    imports = f'{wanted}<owl:imports rdf:resource="package://no_such_package/owl/things.owl"/></owl:Ontology>'
    text = path.read_text(encoding="utf-8").replace(wanted.replace(">", "/>"), imports)
    path.write_text(text, encoding="utf-8")
    result = run("analyze", path)
    assert result.exit_code == 0
    assert "no_such_package" in result.stderr
    assert "no_such_package" in str(json_output(run("analyze", path, "--json"))["findings"])


def test_packages_are_found_in_ros_package_path(
    run: Run, write_map: WriteMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ontology = tmp_path / "workspace" / "my_package" / "owl" / "things.owl"
    ontology.parent.mkdir(parents=True)
    ontology.write_text(
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"></rdf:RDF>\n', encoding="utf-8"
    )
    path = write_map()
    head = '<owl:Ontology rdf:about="http://example.org/room.owl"'
    imports = f'{head}><owl:imports rdf:resource="package://my_package/owl/things.owl"/></owl:Ontology>'
    path.write_text(path.read_text(encoding="utf-8").replace(f"{head}/>", imports), encoding="utf-8")
    assert "my_package" in run("analyze", path).stderr
    assert run("analyze", path, "--ontology", tmp_path / "workspace").stderr == ""
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{tmp_path / 'nowhere'}:{tmp_path / 'workspace'}")
    assert run("analyze", path).stderr == ""
