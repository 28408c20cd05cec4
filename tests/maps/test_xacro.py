"""Robot descriptions in xacro: when they are expanded, and what their expansion can reach."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import msgspec
import pytest

import mindstage as ms
from mindstage.errors import SourceParseError, XacroRefusedError
from mindstage.knowledge import KnowledgeBase
from mindstage.maps.io.ros_packages import RosPackagePath
from mindstage.maps.urdf import xacro_process
from mindstage.maps.urdf.parse import read_urdf
from mindstage.maps.urdf.xacro_process import (
    Expansion,
    FileRequest,
    Reply,
    Request,
    Task,
    XacroRequest,
    expand_xacro,
    read_message,
    write_message,
)
from tests.maps.hostile_urdf import HOSTILE, hostile_urdf
from tests.maps.small_urdf import LoadedRobot, box_urdf, link_urdf, load_robot, robot_urdf

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
    world = LoadedRobot(path, ontologies=(tmp_path / "packages",)).world  # its suffix asks for it
    assert world.body("table").size == (0.5, 1.0, 1.0)
    with pytest.raises(SourceParseError, match="no package folder contains 'kitchen_parts'"):
        LoadedRobot(path)


def test_invalid_macros_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceParseError, match="xacro cannot expand it"):
        load_robot(tmp_path / "kitchen.xacro", robot_urdf("<link name='${1/0}'/>", extra_attributes=_XACRO))


def test_without_xacro_the_error_names_the_extra_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(SourceParseError, match=r"pip install mindstage\[xacro\]"):
        load_robot(tmp_path / "kitchen.xacro", robot_urdf("<link name='${1+1}'/>", extra_attributes=_XACRO))


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
def test_every_use_of_xacro_is_found(file: Path, elements: str) -> None:
    with pytest.raises(XacroRefusedError, match=r"is written in xacro.*--xacro.*xacro=True"):
        load_robot(file, robot_urdf(elements, extra_attributes=_XACRO))


# -- on request --------------------------------------------------------------------------------------------------------


@pytest.fixture
def doubled(file: Path) -> Path:
    """A description with an expression, under a name without the suffix."""
    file.write_text(robot_urdf(link_urdf("base", box_urdf("${2*0.5} 1 1"))), encoding="utf-8")
    return file


def _load(path: Path, xacro: XacroRequest) -> ms.World:
    with KnowledgeBase() as knowledge:
        knowledge.load(path, xacro=xacro)
        return knowledge.world()


def _opened(path: Path, xacro: XacroRequest) -> ms.World:
    with ms.open(path, engine="null", xacro=xacro) as simulation:
        return simulation.snapshot()


DOORS: dict[str, Callable[[Path, bool | None], ms.World]] = {
    "KnowledgeBase.load": _load,
    "ms.load": lambda path, xacro: ms.load(path, xacro=xacro),
    "ms.open": _opened,
}


@pytest.mark.parametrize("door", DOORS)
def test_a_file_is_expanded_by_its_suffix_or_on_request_and_never_against_it(doubled: Path, door: str) -> None:
    read = DOORS[door]
    with pytest.raises(XacroRefusedError, match="the attribute size of <box>"):
        read(doubled, None)
    assert read(doubled, True).body("base").size == (1.0, 1.0, 1.0)
    named = doubled.rename(doubled.with_suffix(".urdf.XACRO"))
    assert read(named, None).body("base").size == (1.0, 1.0, 1.0)
    with pytest.raises(XacroRefusedError):
        read(named, False)
    link = named.with_name("link.urdf")
    link.symlink_to(named)
    with pytest.raises(XacroRefusedError):
        read(link, None)  # the name that is given counts


def test_a_plain_file_stays_as_it_is_even_on_request(file: Path) -> None:
    text = robot_urdf(link_urdf("base", box_urdf("1 1 1")), "<gazebo><plugin>costs ${5}</plugin></gazebo>")
    file.write_text(text, encoding="utf-8")
    assert read_urdf(file, RosPackagePath(), xacro=True).source_xml == text


LINKED = """
@prefix : <http://example.org/linked.owl#> .
@prefix urdf: <http://knowrob.org/kb/urdf.owl#> .
:cooler a <http://www.ease-crc.org/ont/SOMA.owl#Refrigerator> ; urdf:hasBaseLinkName "base" .
"""


def test_descriptions_beside_maps_are_expanded_alike(doubled: Path, tmp_path: Path) -> None:
    map = tmp_path / "linked.ttl"
    map.write_text(LINKED, encoding="utf-8")
    with KnowledgeBase() as knowledge:
        with pytest.raises(XacroRefusedError):
            knowledge.load(map, urdf=doubled)
        knowledge.load(map, urdf=doubled, xacro=True)
        assert [body.size for body in knowledge.world().bodies] == [(1.0, 1.0, 1.0)]


def test_a_store_keeps_what_was_expanded_and_expands_nothing_when_it_is_opened(tmp_path: Path) -> None:
    path = tmp_path / "kitchen.xacro"
    path.write_text(robot_urdf(link_urdf("base", box_urdf("${2*0.5} 1 1"))), encoding="utf-8")
    with KnowledgeBase(store=tmp_path / "store") as knowledge:
        knowledge.load(path)
    path.write_text(robot_urdf(link_urdf("base", box_urdf("${2*0.7} 1 1"))), encoding="utf-8")
    with KnowledgeBase(store=tmp_path / "store") as knowledge:
        assert knowledge.world().body("base").size == (1.0, 1.0, 1.0)
        (finding,) = [each for each in knowledge.findings() if "it has changed since it was stored" in each.problem]
        assert "is written in xacro" in finding.problem
        assert finding.action == "the stored version is used"


# -- hostile files -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", HOSTILE)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_nothing_runs_in_a_description_that_is_loaded(tmp_path: Path, kind: str, encoding: str) -> None:
    marker, path = tmp_path / "marker", tmp_path / "robot.urdf"
    path.write_bytes(hostile_urdf(kind, marker).encode(encoding))
    with pytest.raises(SourceParseError):
        ms.load(path)
    with pytest.raises(XacroRefusedError, match="is written in xacro"):
        read_urdf(path, RosPackagePath())
    assert not marker.exists()


@pytest.mark.parametrize("kind", HOSTILE)
def test_nothing_runs_in_a_description_that_is_expanded_on_request(tmp_path: Path, kind: str) -> None:
    marker, path = tmp_path / "marker", tmp_path / "robot.urdf"
    path.write_text(hostile_urdf(kind, marker), encoding="utf-8")
    with suppress(SourceParseError):  # some of it expands to a valid description
        assert "root:" not in read_urdf(path, RosPackagePath(), xacro=True).source_xml
    assert not marker.exists()


@pytest.mark.parametrize("suffix", [".urdf", ".xacro", ".urdf.xacro"])
def test_nothing_runs_in_what_a_map_refers_to(tmp_path: Path, suffix: str) -> None:
    marker, package = tmp_path / "marker", tmp_path / "parts"
    package.mkdir()
    (package / "package.xml").write_text("<package/>", encoding="utf-8")
    robot = package / f"robot{suffix}"
    robot.write_text(hostile_urdf("an expression", marker), encoding="utf-8")
    text = robot_urdf(
        link_urdf("base", f"<visual><geometry><mesh filename='package://parts/{robot.name}'/></geometry></visual>")
    )
    (tmp_path / "meshes.urdf").write_text(text, encoding="utf-8")
    imports = "".join(
        f"<http://example.org/m.owl> owl:imports <{each}> .\n"
        for each in (robot.as_uri(), "package://parts/robot" + suffix)
    )
    (tmp_path / "m.ttl").write_text(
        f"@prefix owl: <http://www.w3.org/2002/07/owl#> .\n<http://example.org/m.owl> a owl:Ontology .\n{imports}",
        encoding="utf-8",
    )
    with KnowledgeBase() as knowledge:
        knowledge.load([tmp_path / "meshes.urdf", tmp_path / "m.ttl"], ontologies=tmp_path)
        assert any("it imports" in finding.problem for finding in knowledge.findings())
        knowledge.world()
    assert not marker.exists()


# -- the process -------------------------------------------------------------------------------------------------------


def test_the_expansion_of_macros_has_a_time_limit(file: Path) -> None:
    file.write_text(robot_urdf("<link name='${1}'/>", extra_attributes=_XACRO), encoding="utf-8")
    with pytest.raises(SourceParseError, match=r"did not expand it within 0\.001 s"):
        expand_xacro(file, RosPackagePath(), timeout_s=0.001)


def test_a_process_that_reads_no_task_is_a_failure_of_the_expansion(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file.write_text(robot_urdf("<link name='${1}'/>", extra_attributes=_XACRO), encoding="utf-8")

    def start() -> subprocess.Popen[bytes]:
        process = subprocess.Popen(["true"], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        return process

    monkeypatch.setattr("mindstage.maps.urdf.xacro_process._start", start)
    with pytest.raises(SourceParseError, match="its process ended with"):
        expand_xacro(file, RosPackagePath())


def _include(folder: Path, *names: str) -> SourceParseError | None:
    """Reads a description in a folder that includes files; returns the error."""
    folder.mkdir(exist_ok=True)
    text = "".join(f"<xacro:include filename='{name}'/>" for name in names) + BASE
    path = folder / "robot.xacro"
    path.write_text(robot_urdf(text, extra_attributes=_XACRO), encoding="utf-8")
    try:
        read_urdf(path, RosPackagePath([folder.parent / "granted"]), xacro=True)
    except SourceParseError as error:
        return error
    return None


def test_files_are_read_from_granted_folders_only(tmp_path: Path) -> None:
    for folder in ("granted", "other", "robot"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "parts.xacro").write_text("<robot><link name='part'/></robot>", encoding="utf-8")
    robot = tmp_path / "robot"
    assert _include(robot, "parts.xacro", f"{tmp_path}/granted/parts.xacro", "../granted/*.xacro") is None
    outside = [f"{tmp_path}/other/parts.xacro", "../other/parts.xacro", f"{tmp_path}/granted/../other/parts.xacro"]
    (robot / "link.xacro").symlink_to(tmp_path / "other" / "parts.xacro")
    (robot / "folder").symlink_to(tmp_path / "other")
    for name in (*outside, "link.xacro", "folder/parts.xacro", "../other/*.xacro", "/*/passwd"):
        error = _include(robot, name)
        assert error is not None, name
        assert "outside of the folders that may be read" in error.cause, name
        assert f"--ontology {tmp_path / 'other'}" in error.cause or name.startswith("/*"), name
    secret = _include(robot, "/etc/passwd")
    assert secret is not None
    assert "--ontology /etc" in secret.cause
    assert "root:" not in secret.cause
    assert "no such file" in str(_include(robot, "missing.xacro"))


def test_the_package_of_the_file_is_granted(tmp_path: Path) -> None:
    (tmp_path / "arm" / "config").mkdir(parents=True)
    (tmp_path / "arm" / "package.xml").write_text("<package/>", encoding="utf-8")
    (tmp_path / "arm" / "config" / "sizes.yaml").write_text("width: 0.25", encoding="utf-8")
    assert _include(tmp_path / "arm" / "urdf") is None
    path = tmp_path / "arm" / "urdf" / "sized.xacro"
    size = "${xacro.load_yaml('../config/sizes.yaml').width} 1 1"
    path.write_text(robot_urdf(link_urdf("base", box_urdf(size)), extra_attributes=_XACRO), encoding="utf-8")
    assert ms.load(path).body("base").size == (0.25, 1.0, 1.0)


def test_a_file_that_is_too_large_or_no_file_is_not_read(tmp_path: Path) -> None:
    robot = tmp_path / "robot"
    robot.mkdir()
    with (robot / "large.xacro").open("wb") as large:
        large.truncate(20 * 1024 * 1024)
    assert "bytes" in str(_include(robot, "large.xacro"))
    if sys.platform == "linux":
        (robot / "device.xacro").symlink_to("/dev/zero")
        assert "outside of the folders" in str(_include(robot, "device.xacro"))
    many = _include(robot, *["robot.xacro"] * 3)  # a file that includes itself
    assert many is not None


_PLANTED = """
import json, os, socket, sys
sys.path += json.loads(sys.argv[1])
from mindstage.maps.urdf import xacro_expansion, xacro_worker

def attempt(action):
    try:
        action()
    except OSError:
        return "denied"
    return "done"

def expand(self, path, arguments=None):
    read = self._read_file(path)
    found = [attempt(lambda: open("/etc/passwd")), attempt(socket.socket), attempt(os.fork)]
    found += [attempt(lambda: os.execv("/bin/sh", ["sh"])), attempt(lambda: os.posix_spawn("/bin/sh", ["sh"], {}))]
    return json.dumps([read.decode(), *found])

xacro_expansion.XacroExpander.expand = expand
xacro_worker.main()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux denies all of it")
def test_code_in_the_process_can_do_nothing_but_ask_for_files() -> None:
    process = subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", _PLANTED, json.dumps([path for path in sys.path if path])],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={},
    )
    assert process.stdin is not None
    assert process.stdout is not None
    with process, process.stdin, process.stdout:
        write_message(process.stdin, Task(path="robot.xacro", cpu_s=60, result_limit=1000))
        asked = msgspec.msgpack.decode(read_message(process.stdout), type=Request)
        assert asked == FileRequest(path="robot.xacro")
        write_message(process.stdin, Reply(data=b"sent"))
        outcome = msgspec.msgpack.decode(read_message(process.stdout), type=Request)
    assert isinstance(outcome, Expansion)
    assert json.loads(outcome.text) == ["sent", *["denied"] * 5]


def test_without_a_sandbox_nothing_is_expanded(doubled: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    unconfined = "import mindstage.sandbox as s; s.confine = lambda: 'no such kernel'; "
    monkeypatch.setattr(
        xacro_process, "_START", xacro_process._START.replace("from mindstage", unconfined + "from mindstage", 1)
    )
    with pytest.raises(SourceParseError, match="only in a confined process: no such kernel"):
        ms.load(doubled, xacro=True)


def test_arguments_are_given_by_a_mapping_which_asks_for_the_expansion(file: Path) -> None:
    text = "<xacro:arg name='size' default='1.0'/>" + link_urdf("base", box_urdf("$(arg size) 1 1"))
    file.write_text(robot_urdf(text, extra_attributes=_XACRO), encoding="utf-8")
    for read in (_load, _opened):
        assert read(file, True).body("base").size == (1.0, 1.0, 1.0)
        assert read(file, {"size": "0.25"}).body("base").size == (0.25, 1.0, 1.0)
        with pytest.raises(XacroRefusedError):
            read(file, None)
