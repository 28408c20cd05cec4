"""The verb `convert`: between dialects, and to other formats."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from mindstage.maps import save_map
from mindstage.maps.io.files import BUNDLED_KITCHEN
from tests.cli.runner import Run, WriteMap, json_output
from tests.kitchenette import kitchenette

SAMPLES = ("ameva-task-two", "iai-kitchen-original", "knowrob1-ccrl", "soma-iai-room")


@pytest.mark.parametrize("suffix", [".owl", ".rdf", ".ttl"])
def test_conversion_between_serializations_is_lossless(suffix: str, run: Run, tmp_path: Path) -> None:
    out = tmp_path / f"out{suffix}"
    result = run("convert", BUNDLED_KITCHEN, out, "--json")
    assert result.exit_code == 0
    assert json_output(result)["out"] == str(out)
    assert json_output(result)["bodies"] >= 120
    assert json_output(result)["notes"] == []
    assert run("compare", BUNDLED_KITCHEN, out).exit_code == 0


@pytest.mark.parametrize("dialect", ["same", "semlog", "soma"])
@pytest.mark.parametrize("name", SAMPLES)
def test_conversion_between_dialects_is_lossless(
    name: str, dialect: str, run: Run, shared_data: Path, tmp_path: Path
) -> None:
    source, out = shared_data / "maps" / f"{name}.owl", tmp_path / "out.owl"
    result = run("convert", source, out, "--dialect", dialect, "--json")
    assert result.exit_code == 0
    assert json_output(result)["format"] == "owl"
    assert json_output(run("compare", source, out, "--json"))["identical"] is True


def test_the_dialect_is_kept_by_default(run: Run, shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "maps" / "knowrob1-ccrl.owl"
    result = run("convert", source, tmp_path / "out.ttl")
    assert result.stdout.rstrip().endswith("out.ttl (ttl, KnowRob 1)")
    assert "mindstage.org" not in (tmp_path / "out.ttl").read_text(encoding="utf-8")


def test_a_converted_map_can_be_converted_back(run: Run, shared_data: Path, tmp_path: Path) -> None:
    source, si, back = shared_data / "maps" / "ameva-task-two.owl", tmp_path / "si.owl", tmp_path / "back.owl"
    assert run("convert", source, si, "--dialect", "semlog").exit_code == 0
    assert json_output(run("convert", si, back, "--dialect", "given", "--json"))["dialect"] == "AMEVA"
    assert ">166.296265 269.170685 23.462967<" in back.read_text(encoding="utf-8")
    assert run("check", si, "--engine", "null").exit_code == 0
    refused = run("convert", source, tmp_path / "out.owl", "--dialect", "given")
    assert refused.exit_code == 2
    assert "was not converted from another one" in refused.stderr


def test_a_note_lists_what_a_dialect_cannot_express(run: Run, tmp_path: Path) -> None:
    result = run("convert", BUNDLED_KITCHEN, tmp_path / "out.owl", "--dialect", "soma")
    assert result.exit_code == 0
    assert "which SOMA cannot express" in result.stderr


@pytest.mark.parametrize("suffix", [".xml", ".mjcf"])
def test_a_map_is_converted_to_a_mujoco_model(suffix: str, run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    out = tmp_path / f"out{suffix}"
    result = run("convert", write_map(), out, "--json")
    assert (result.exit_code, json_output(result)["dialect"]) == (0, None)
    model = mujoco.MjModel.from_xml_path(str(out))
    assert {model.body(number).name for number in range(model.nbody)} == {"world", "Mug1", "Mug2"}


def test_a_mujoco_model_has_the_meshes_of_its_bodies_and_replaces_those_of_an_earlier_one(
    run: Run, tmp_path: Path
) -> None:
    source, out, folder = tmp_path / "map.owl", tmp_path / "out.xml", tmp_path / "out_assets"
    save_map(kitchenette(), source)
    folder.mkdir()
    (folder / "old.obj").write_text("")
    assert run("convert", source, out).exit_code == 0
    assert not (folder / "old.obj").exists()
    model = mujoco.MjModel.from_xml_path(str(out))
    seen = {model.body(body).name for body in model.geom_bodyid[model.geom_group == 1]}
    assert seen == {body.id for body in kitchenette().bodies}
    (folder / "thesis.pdf").write_text("")
    before = out.read_bytes(), sorted(folder.iterdir())
    result = run("convert", source, out)
    assert result.exit_code == 2
    assert "thesis.pdf" in result.stderr
    assert (out.read_bytes(), sorted(folder.iterdir())) == before


def test_a_map_is_converted_to_a_gltf_scene(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    out = tmp_path / "out.glb"
    assert run("convert", write_map(), out).exit_code == 0
    assert out.read_bytes()[:4] == b"glTF"


def test_the_format_can_be_given(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    out = tmp_path / "out.xml"
    assert run("convert", write_map(), out, "--format", "owl").exit_code == 0
    assert run("compare", write_map(), out).exit_code == 0


def test_an_unknown_suffix_is_rejected(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    result = run("convert", write_map(), tmp_path / "out.docx")
    assert result.exit_code == 2
    assert "Traceback" not in result.output
    assert ".glb" in result.stderr
    assert not (tmp_path / "out.docx").exists()


def test_a_dialect_is_rejected_for_formats_without_dialects(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    result = run("convert", write_map(), tmp_path / "out.glb", "--dialect", "soma")
    assert result.exit_code == 2
    assert "glb has no dialects" in result.stderr
