"""The verbs `check` and `log`: lossless round trips."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mindstage.maps.io.files import BUNDLED_KITCHEN
from mindstage.scene import World
from tests.cli.runner import Run, WriteMap, json_output


@pytest.mark.parametrize("engine", ["null", "mujoco"])
def test_the_round_trip_of_the_bundled_kitchen_is_lossless(engine: str, run: Run) -> None:
    result = run("check", BUNDLED_KITCHEN, "--engine", engine, "--json")
    assert result.exit_code == 0, result.stdout
    output = json_output(result)
    assert output["identical"] is True
    assert output["identical_before_file"] is True
    assert output["max_error"] == 0.0
    assert output["lost_facts"] == 0
    assert output["engine"] == engine
    assert output["spawn"]["ok"] is True
    assert output["spawn"]["failed_bodies"] == output["spawn"]["failed_joints"] == []
    assert {"load", "spawn", "log", "compare"} <= set(output["seconds"])
    assert all(spent > 0.0 for spent in output["seconds"].values())


def test_the_round_trip_of_the_kitchen_of_the_thesis_is_lossless(run: Run, shared_data: Path) -> None:
    result = run("check", shared_data / "maps" / "iai-kitchen-original.owl", "--json")
    assert result.exit_code == 0, result.stdout
    assert json_output(result)["max_error"] == 0.0
    assert json_output(result)["lost_facts"] == 0


def test_check_prints_a_summary(run: Run, write_map: WriteMap) -> None:
    result = run("check", write_map(), "--engine", "null")
    assert result.exit_code == 0
    assert result.stdout.rstrip().endswith("Identical at delta 0.")


def test_check_detects_what_an_engine_loses(run: Run, write_map: WriteMap, monkeypatch: pytest.MonkeyPatch) -> None:
    import msgspec

    from mindstage.engines import NullEngine

    whole = NullEngine.snapshot
    monkeypatch.setattr(
        NullEngine, "snapshot", lambda engine: msgspec.structs.replace(whole(engine), bodies=whole(engine).bodies[1:])
    )
    result = run("check", write_map(), "--engine", "null", "--json")
    assert result.exit_code == 1
    output = json_output(result)
    assert output["identical"] is output["identical_before_file"] is False
    assert len(output["only_in_a"]) == 1


def test_check_detects_what_a_file_loses(run: Run, write_map: WriteMap, monkeypatch: pytest.MonkeyPatch) -> None:
    import msgspec

    from mindstage import maps

    save = maps.save_map
    monkeypatch.setattr(
        "mindstage.maps.save_map",
        lambda world, path, **more: save(msgspec.structs.replace(world, bodies=world.bodies[1:]), path, **more),
    )
    result = run("check", write_map(), "--engine", "null", "--json")
    assert result.exit_code == 1
    assert json_output(result)["identical_before_file"] is True
    assert json_output(result)["identical"] is False


def test_check_detects_a_lost_statement(run: Run, write_map: WriteMap, monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as the header of the ontology, which is not part of a world."""
    from mindstage import maps

    save = maps.save_map

    def save_lossy(world: World, path: Path, **more: object) -> None:
        save(world, path, **more)  # type: ignore[arg-type]
        text = path.read_text(encoding="utf-8")
        assert "owl:Ontology" in text
        path.write_text(re.sub("<owl:Ontology.*?/>", "", text), encoding="utf-8")

    monkeypatch.setattr("mindstage.maps.save_map", save_lossy)
    source = write_map()
    text = source.read_text(encoding="utf-8")
    ontology = '<owl:Ontology rdf:about="http://example.org/room.owl"/></rdf:RDF>'
    source.write_text(text.replace("</rdf:RDF>", ontology), encoding="utf-8")
    output = json_output(run("check", source, "--engine", "null", "--json"))
    assert output["identical"] is False
    assert output["lost_facts"] == len(output["lost"]) == 1
    assert "Ontology" in output["lost"][0]["note"]
    result = run("check", source, "--engine", "null")
    assert result.exit_code == 1
    assert "1 statement of the map is lost." in result.stdout


def test_the_log_of_a_static_world_equals_its_map(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "logged.owl"
    result = run("log", BUNDLED_KITCHEN, "-o", out, "--engine", "null", "--for", "1", "--json")
    assert result.exit_code == 0
    assert json_output(result)["simulated_s"] == 1.0
    assert run("compare", BUNDLED_KITCHEN, out).exit_code == 0


def test_the_log_of_a_simulation_has_the_moved_poses(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    source, out = write_map(mugs={"Mug": "0.0 0.0 50.0"}), tmp_path / "logged.owl"
    text = source.read_text(encoding="utf-8").replace(">static<", ">dynamic<")
    source.write_text(text, encoding="utf-8")
    result = run("log", source, "-o", out, "--for", "0.5", "--no-ground")
    assert result.exit_code == 1, "it falls"
    assert "not at rest: Mug moved by" in result.stderr
    output = json_output(run("compare", source, out, "--json"))
    assert output["errors"]["translation_m"] == pytest.approx(0.5 * 9.81 * 0.5**2, rel=0.02)
    assert output["lost_facts"] == 0
