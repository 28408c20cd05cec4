"""Robot descriptions in xacro."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from mindstage.errors import SourceParseError
from mindstage.knowledge.io.ros_packages import RosPackagePath
from mindstage.knowledge.urdf.parse import expand_xacro
from tests.knowledge.small_urdf import LoadedRobot, box_urdf, link_urdf, load_robot, robot_urdf

BASE = link_urdf("base", box_urdf("1 1 1"))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "kitchen.urdf"


_XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'


def test_macros_are_expanded_and_packages_found(tmp_path: Path) -> None:
    package = tmp_path / "packages" / "kitchen_parts"
    package.mkdir(parents=True)
    macro = (
        "<xacro:macro name='block' params='name size'><link name='${name}'>"
        + box_urdf("${size} ${2*size} 1")
        + "</link>"
    )
    (package / "parts.xacro").write_text(
        robot_urdf(macro + "</xacro:macro>", extra_attributes=_XACRO), encoding="utf-8"
    )
    include = '<xacro:include filename="$(find kitchen_parts)/parts.xacro"/><xacro:block name="table" size="0.5"/>'
    path = tmp_path / "kitchen.urdf.xacro"
    path.write_text(robot_urdf(include, extra_attributes=_XACRO), encoding="utf-8")
    world = LoadedRobot(path, ontologies=(tmp_path / "packages",)).world
    assert world.body("table").size == (0.5, 1.0, 1.0)
    with pytest.raises(SourceParseError, match="no package folder contains 'kitchen_parts'"):
        LoadedRobot(path)


def test_invalid_macros_are_refused(file: Path) -> None:
    with pytest.raises(SourceParseError, match="xacro cannot expand it"):
        load_robot(file, robot_urdf("<link name='${1/0}'/>", extra_attributes=_XACRO))


def test_without_xacro_the_error_names_the_extra_to_install(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(SourceParseError, match=r"pip install mindstage\[xacro\]"):
        load_robot(file, robot_urdf("<link name='${1+1}'/>", extra_attributes=_XACRO))


EXPANDED = [
    pytest.param(BASE, id="the declaration only"),
    pytest.param(BASE + "<!-- <xacro:block name='${name}'/> -->", id="a macro in a comment"),
    pytest.param(BASE + "<gazebo><plugin>costs $5 (more or less)</plugin></gazebo>", id="a dollar in a text"),
    pytest.param(
        BASE + "<gazebo xmlns:controller='http://playerstage.sourceforge.net/c'><controller:audio/></gazebo>",
        id="another namespace",
    ),
]
UNEXPANDED = [
    pytest.param("<xacro:property name='a' value='1'/>" + BASE, id="a property"),
    pytest.param("<link name='${base}'/>", id="an expression"),
    pytest.param("<link name='$(arg base)'/>", id="a substitution"),
    pytest.param(BASE + "<gazebo><plugin>${plugin}</plugin></gazebo>", id="an expression in a text"),
    pytest.param(BASE + "<gazebo xacro:if='1'/>", id="an attribute"),
    pytest.param("<x:block xmlns:x='http://wiki.ros.org/xacro'/>" + BASE, id="another prefix"),
]


@pytest.mark.parametrize("elements", EXPANDED)
def test_a_file_that_only_declares_the_namespace_loads_without_xacro(
    file: Path, monkeypatch: pytest.MonkeyPatch, elements: str
) -> None:
    monkeypatch.setitem(sys.modules, "xacro", None)
    assert load_robot(file, robot_urdf(elements, extra_attributes=_XACRO)).world.body("base").size == (1.0, 1.0, 1.0)


@pytest.mark.parametrize("elements", UNEXPANDED)
def test_every_use_of_xacro_is_found(file: Path, monkeypatch: pytest.MonkeyPatch, elements: str) -> None:
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(SourceParseError, match=r"pip install mindstage\[xacro\]"):
        load_robot(file, robot_urdf(elements, extra_attributes=_XACRO))


def test_the_expansion_of_macros_has_a_time_limit(file: Path) -> None:
    file.write_text(robot_urdf("<link name='${9**9**9}'/>", extra_attributes=_XACRO), encoding="utf-8")
    with pytest.raises(SourceParseError, match="did not expand it within 2 s"):
        expand_xacro(file, RosPackagePath(), timeout_s=2.0)
