"""Every verb that takes a map takes all options of how maps are read, and so do the functions of Python."""

from __future__ import annotations

import inspect
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
import typer

from mindstage import api
from mindstage.cli.app import app
from mindstage.cli.options import MapReading
from mindstage.maps import QuaternionOrder, UnitConventions
from mindstage.scene import MECHANICAL_KINDS
from tests.cases import each_case
from tests.cli.runner import Run, WriteMap, json_output

VERBS: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]
SHARED = {field.name for field in fields(MapReading)}
OPTIONS = {"--ontology", "--no-bundled-ontology", "--urdf", "--units", "--frame", "--quaternion", "--sizes"}

# A table of 2 x 1 x 0.8 stands upright with a quaternion x y z w; read as w x y z it lies on its head.
QUATERNION_MAP = """
@prefix : <http://example.org/room.owl#> . @prefix k: <http://knowrob.org/kb/knowrob.owl#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> . @prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
:room a k:SemanticEnvironmentMap .
:table a k:Table ; k:describedInMap :room ; k:mobility "static" ; k:pose [ a k:Pose ; k:translation "1.0 2.0 0.4" ;
    k:quaternion "0.0 0.0 0.70710678 0.70710678" ] .
"""
UPRIGHT = (0.70710678, 0.0, 0.0, 0.70710678)


def takes_maps(verb: Any) -> bool:
    """Whether a verb has an argument or an option for maps."""
    return any("MAP" in (each.metavar or "") and "=" not in (each.metavar or "") for each in verb.params) or any(
        each.metavar in {"A", "B"} for each in verb.params
    )


def test_the_verbs_that_take_maps_are_found() -> None:
    without = {name for name, verb in VERBS.items() if not takes_maps(verb)}
    assert without == {"demo", "doctor", "episode", "generate", "plugins", "questions", "ros2"}


@each_case("name", [name for name, verb in VERBS.items() if takes_maps(verb)])
def test_a_verb_that_takes_maps_takes_all_options_of_reading_them(name: str) -> None:
    verb = VERBS[name]
    assert {each.name for each in verb.params} >= SHARED
    assert {option.strip() for each in verb.params for option in (*each.opts, *each.secondary_opts)} >= OPTIONS


def test_every_convention_has_an_option() -> None:
    assert set(UnitConventions.__struct_fields__) <= SHARED


@each_case("name", ["open", "load", "diff", "connect", "load_knowledge"])
def test_a_function_that_takes_maps_takes_all_options_of_reading_them(name: str) -> None:
    parameters = inspect.signature(getattr(api, name)).parameters
    assert parameters.keys() >= {"ontologies", "bundled_ontology", "urdf", "conventions"}


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "table.ttl"
    path.write_text(QUATERNION_MAP, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "command",
    [
        ("analyze",),
        ("validate",),
        ("spawn", "--no-viewer", "--engine", "null"),
        ("ask", "what_is", "table", "--map"),
    ],
)
def test_the_order_of_quaternions_can_be_given_to(command: tuple[str, ...], table: Path, run: Run) -> None:
    for order in ("wxyz", "xyzw"):
        result = run(*command, table, "--quaternion", order, "--json")
        assert result.exit_code in (0, 1), result.output
        output = json_output(result)
        output = output["maps"][0] if "maps" in output else output
        assumed = {each["topic"]: each for each in output["assumptions"]}
        assert assumed["quaternion"]["value"] == order
        assert assumed["quaternion"]["overridden"]


def test_each_map_of_a_comparison_can_have_its_own_conventions(table: Path, tmp_path: Path, run: Run) -> None:
    other = tmp_path / "other.ttl"
    other.write_text(QUATERNION_MAP.replace("0.0 0.0 0.70710678 0.70710678", "0.70710678 0.0 0.0 0.70710678"))
    given = ("--quaternion", "xyzw", "--quaternion", "other.ttl=wxyz")
    assert json_output(run("compare", table, other, *given, "--json"))["identical_mechanics"]
    assert not json_output(run("compare", table, other, "--quaternion", "wxyz", "--json"))["identical_mechanics"]


def test_python_compares_maps_with_conventions(table: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.ttl"
    other.write_text(QUATERNION_MAP.replace("0.0 0.0 0.70710678 0.70710678", "0.70710678 0.0 0.0 0.70710678"))
    scalar_last, scalar_first = (
        UnitConventions(quaternion=order) for order in (QuaternionOrder.XYZW, QuaternionOrder.WXYZ)
    )
    assert api.load(table, conventions=scalar_last).bodies[0].pose.quaternion == pytest.approx(UPRIGHT)
    same = api.diff(table, other, conventions=[scalar_last, scalar_first])
    assert same.identical(kinds=MECHANICAL_KINDS)
    assert not api.diff(table, other, conventions=scalar_first).identical(kinds=MECHANICAL_KINDS)


def test_options_of_a_map_that_is_not_loaded_are_rejected(write_map: WriteMap, run: Run) -> None:
    result = run("shot", write_map(), "--output", "x.png", "--units", "other.owl=cm")
    assert result.exit_code == 2
    assert "no map 'other.owl' is loaded" in result.output
