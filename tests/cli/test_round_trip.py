"""Check, log and convert: nothing is lost on the way round."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mindstage.knowledge.io.files import BUNDLED_KITCHEN
from mindstage.scene import World
from tests.cli.typed import Run, WriteMap, json_output


@pytest.mark.parametrize("engine", ["null", "mujoco"])
def test_the_bundled_kitchen_comes_back_whole(engine: str, run: Run) -> None:
    result = run("check", BUNDLED_KITCHEN, "--engine", engine, "--json")
    assert result.exit_code == 0, result.stdout
    verdict = json_output(result)
    assert verdict["identical"] is True
    assert verdict["identical_before_file"] is True
    assert verdict["max_error"] == 0.0
    assert verdict["lost_facts"] == 0
    assert verdict["engine"] == engine
    assert verdict["spawn"]["ok"] is True
    assert verdict["spawn"]["failed_bodies"] == verdict["spawn"]["failed_constraints"] == []
    assert {"load", "spawn", "log", "compare"} <= set(verdict["seconds"])
    assert all(spent > 0.0 for spent in verdict["seconds"].values())


def test_the_kitchen_of_the_thesis_comes_back_whole(run: Run, shared_data: Path) -> None:
    result = run("check", shared_data / "maps" / "iai-kitchen-original.owl", "--json")
    assert result.exit_code == 0, result.stdout
    assert json_output(result)["max_error"] == 0.0
    assert json_output(result)["lost_facts"] == 0


def test_check_tells_people_too(run: Run, write_map: WriteMap) -> None:
    result = run("check", write_map(), "--engine", "null")
    assert result.exit_code == 0
    assert result.stdout.rstrip().endswith("Identical at delta 0.")


def test_check_sees_what_an_engine_loses(run: Run, write_map: WriteMap, monkeypatch: pytest.MonkeyPatch) -> None:
    from mindstage.engines import NullEngine

    class Forgetful(NullEngine):
        def snapshot(self):  # type: ignore[no-untyped-def]
            import msgspec

            world = super().snapshot()
            return msgspec.structs.replace(world, bodies=world.bodies[1:])

    monkeypatch.setattr("mindstage.engines.NullEngine", Forgetful)
    result = run("check", write_map(), "--engine", "null", "--json")
    assert result.exit_code == 1
    verdict = json_output(result)
    assert verdict["identical"] is verdict["identical_before_file"] is False
    assert len(verdict["only_in_a"]) == 1


def test_check_sees_what_a_file_loses(run: Run, write_map: WriteMap, monkeypatch: pytest.MonkeyPatch) -> None:
    import msgspec

    from mindstage import knowledge

    save = knowledge.save_map
    monkeypatch.setattr(
        "mindstage.knowledge.save_map",
        lambda world, path, **more: save(msgspec.structs.replace(world, bodies=world.bodies[1:]), path, **more),
    )
    result = run("check", write_map(), "--engine", "null", "--json")
    assert result.exit_code == 1
    assert json_output(result)["identical_before_file"] is True
    assert json_output(result)["identical"] is False


def test_check_sees_a_statement_that_a_file_does_not_make(
    run: Run, write_map: WriteMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Such as a class, of which no world knows."""
    from mindstage import knowledge

    save = knowledge.save_map

    def save_less(world: World, path: Path, **more: object) -> None:
        save(world, path, **more)  # type: ignore[arg-type]
        text = path.read_text(encoding="utf-8")
        assert "owl:Ontology" in text
        path.write_text(re.sub("<owl:Ontology.*?/>", "", text), encoding="utf-8")

    monkeypatch.setattr("mindstage.knowledge.save_map", save_less)
    source = write_map()
    text = source.read_text(encoding="utf-8")
    ontology = '<owl:Ontology rdf:about="http://example.org/room.owl"/></rdf:RDF>'
    source.write_text(text.replace("</rdf:RDF>", ontology), encoding="utf-8")
    verdict = json_output(run("check", source, "--engine", "null", "--json"))
    assert verdict["identical"] is False
    assert verdict["lost_facts"] == len(verdict["lost"]) == 1
    assert "Ontology" in verdict["lost"][0]["said"]
    result = run("check", source, "--engine", "null")
    assert result.exit_code == 1
    assert "1 statements of the map are lost." in result.stdout


def test_the_log_of_a_world_that_stood_still_is_its_map(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "logged.owl"
    result = run("log", BUNDLED_KITCHEN, "-o", out, "--engine", "null", "--for", "1", "--json")
    assert result.exit_code == 0
    assert json_output(result)["simulated_s"] == 1.0
    assert run("compare", BUNDLED_KITCHEN, out).exit_code == 0


def test_the_log_of_a_world_in_which_something_fell(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    source, out = write_map(mugs={"Mug": "0.0 0.0 50.0"}), tmp_path / "logged.owl"
    text = source.read_text(encoding="utf-8").replace(">static<", ">dynamic<")
    source.write_text(text, encoding="utf-8")
    assert run("log", source, "-o", out, "--for", "0.5").exit_code == 0
    verdict = json_output(run("compare", source, out, "--json"))
    assert verdict["errors"]["translation_m"] == pytest.approx(0.5 * 9.81 * 0.5**2, rel=0.02)
    assert verdict["lost_facts"] == 0
