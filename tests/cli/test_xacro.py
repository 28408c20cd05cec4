"""Descriptions in xacro on the command line: expanded by their suffix or with --xacro, and never otherwise."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.runner import Run, json_output
from tests.maps.hostile_urdf import hostile_urdf
from tests.maps.small_urdf import box_urdf, link_urdf, robot_urdf

DOUBLED = robot_urdf(link_urdf("base", box_urdf("${2*0.5} 1 1")))
MAP = "bundled:kitchen"


def _verbs(path: Path) -> list[tuple[object, ...]]:
    """Every verb that takes a description, as a map, beside a map, or as a robot."""
    out = path.parent / "out.owl"
    return [
        ("validate", path),
        ("spawn", path, "--no-viewer"),
        ("check", path),
        ("ask", "storage-place", "CowsMilk", "--map", path),
        ("convert", path, out),
        ("compare", path, path),
        ("sparql", "ASK {}", "--map", path),
        ("validate", MAP, "--urdf", path),
        ("do", "go_to x=1 y=0", MAP, "--robot", path),
        ("serve", "--robot", path, "--port", "0", "--for", "0"),
        ("serve", path, "--port", "0", "--for", "0"),
    ]


@pytest.mark.parametrize("kind", ["an expression", "a substitution", "another prefix"])
def test_nothing_runs_on_any_verb(run: Run, tmp_path: Path, kind: str) -> None:
    path, marker = tmp_path / "robot.urdf", tmp_path / "marker"
    path.write_text(hostile_urdf(kind, marker), encoding="utf-8")
    for verb in _verbs(path):
        for flags in ((), ("--xacro",)):
            result = run(*verb, *flags)
            assert result.exit_code == 2, (verb, flags, result.output)
            assert str(path) in result.stderr, (verb, result.stderr)
            if not flags:
                assert "is written in xacro" in result.stderr
                assert "--xacro" in result.stderr
            assert not marker.exists(), verb


def test_a_description_is_expanded_by_its_suffix_or_with_the_flag(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(DOUBLED, encoding="utf-8")
    assert run("spawn", path, "--no-viewer").exit_code == 2
    assert json_output(run("spawn", path, "--no-viewer", "--json", "--xacro"))["spawn"]["bodies"] == 1
    named = path.rename(tmp_path / "robot.urdf.xacro")
    assert json_output(run("spawn", named, "--no-viewer", "--json"))["spawn"]["bodies"] == 1


def test_arguments_of_descriptions_are_given_by_name(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    argument = "<xacro:arg name='n' default='0'/><xacro:if value='$(arg n)'><link name='more'/></xacro:if>"
    text = f"<robot name='r' xmlns:xacro='http://www.ros.org/wiki/xacro'>{argument}<link name='base'/>"
    joint = "<joint name='j' type='fixed'><parent link='base'/><child link='more'/></joint>"
    joint = f"<xacro:if value='$(arg n)'>{joint}</xacro:if>"
    path.write_text(f"{text}{joint}</robot>", encoding="utf-8")
    for flags, bodies in ((("--xacro",), 1), (("--xacro-arg", "n:=1"), 2)):
        assert json_output(run("spawn", path, "--no-viewer", "--json", *flags))["spawn"]["bodies"] == bodies
    for wrong in (("n=1",), (":=1",), ("n:=1", "--xacro-arg", "n:=0")):
        result = run("spawn", path, "--no-viewer", "--xacro-arg", *wrong)
        assert result.exit_code == 2
        assert "--xacro-arg" in result.stderr
    result = run("spawn", path, "--no-viewer", "--xacro-arg", "m:=1")
    assert result.exit_code == 2
    assert "it has no argument 'm'; there is n" in " ".join(result.stderr.split())
