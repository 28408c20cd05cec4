"""Expansion of xacro files: as by the library, but files from given functions, no evaluation by Python, and limits."""

from __future__ import annotations

import ast
import builtins
import io
from fnmatch import fnmatch
from typing import Any

import pytest

from mindstage.errors import SourceParseError
from mindstage.maps.urdf.xacro_expansion import XacroExpander
from tests.cases import each_case

xacro = pytest.importorskip("xacro")

YAML = """
joints:
  shoulder: {lower: !degrees -90, upper: !radians 1.5, names: [a, b]}
  elbow: {lower: -1, upper: 2}
date: 2020-01-02
offset: !millimeters 250
"""
PARTS = """<robot xmlns:xacro="http://ros.org/wiki/xacro" xmlns:more="http://example.org/more">
<xacro:property name="scale" value="2"/>
<xacro:macro name="joint" params="name limits:=${dict(lower=0, upper=1)} axis:='0 0 1' *origin **rest">
  <joint name="${prefix}${name}"><xacro:insert_block name="origin"/><axis xyz="${axis}"/>
  <limit lower="${limits['lower']}" upper="${limits['upper'] * scale}"/><xacro:insert_block name="rest"/></joint>
</xacro:macro>
</robot>"""
ROBOT = """<?xml version="1.0"?>
<robot xmlns:xacro="http://ros.org/wiki/xacro" name="robot">
<xacro:arg name="name" default="arm"/>
<xacro:arg name="simulated" default="true"/>
<xacro:include filename="parts.xacro"/>
<xacro:include filename="$(find parts)/*.urdf.xacro"/>
<xacro:include filename="missing.xacro" optional="true"/>
<xacro:include filename="$(find parts)/tools.xacro" ns="tools"/>
<xacro:property name="prefix" value="$(arg name)_"/>
<xacro:property name="config" value="${xacro.load_yaml('$(find parts)/joints.yaml')}"/>
<xacro:property name="half" value="${width / 2}"/>
<xacro:property name="width" value="0.3"/>
<xacro:macro name="chain" params="count">
  <xacro:if value="${count > 0}"><link name="link_${count}" width="${half * count}"/>
  <xacro:chain count="${count - 1}"/></xacro:if>
</xacro:macro>
<xacro:chain count="4"/>
<xacro:joint name="shoulder" limits="${config['joints']['shoulder']}">
<origin xyz="${'%.2f' % pi} 0 0"/><rest><a/><b/></rest>
</xacro:joint>
<xacro:joint name="elbow" limits="${config.joints.elbow}" axis="1 0 0"><origin/><rest/></xacro:joint>
<xacro:joint name="wrist"><origin rpy="${radians(90)} ${-pi/2} ${sin(0.5)}"/><rest/></xacro:joint>
<xacro:call macro="${'cha' + 'in'}" count="1"/>
<xacro:unless value="$(arg simulated)"><hardware/></xacro:unless>
<tool name="${tools.gripper}" offset="${config.offset}" made="${config.date}"/>
<names>${', '.join([n.upper() for n in config.joints.shoulder.names])} $${literal} $(optenv UNKNOWN some thing)</names>
<values a="${[1, 2.5, 'x']}" b="${xacro.tokenize('a, b;c')}" c="${python.sorted(config.joints.keys())}"
        d="${xacro.arg('name')}" e="$(eval 1 + 2)" f="${xacro.dotify(dict(a=dict(b=3))).a.b}" g="${True and 'true'}"
        h="${'%.3f' % (1.0 / 3)}" i="${max(1, 2) if 'arm' in prefix else min(1, 2)}" j="${1e400 > 1}"/>
<xacro:element xacro:name="${'dyn' + 'amic'}"><xacro:attribute name="size" value="${2 ** 8} m"/></xacro:element>
<!-- xacro:eval-comments -->
<!-- ${1 + 1} -->
</robot>"""
FILES = {
    "/robots/arm.urdf.xacro": ROBOT,
    "/robots/parts.xacro": PARTS,
    "/parts/one.urdf.xacro": "<robot><link name='one'/></robot>",
    "/parts/two.urdf.xacro": "<robot><link name='two'/></robot>",
    "/parts/tools.xacro": "<robot xmlns:xacro='x'><xacro:property name='gripper' value='two fingers'/></robot>",
    "/parts/joints.yaml": YAML,
}


class Files:
    """Files in memory."""

    def __init__(self, files: dict[str, str | bytes]) -> None:
        self.files, self.read = files, list[str]()

    def read_file(self, path: str) -> bytes:
        self.read.append(path)
        if path not in self.files:
            raise FileNotFoundError(2, "No such file or directory", path)
        content = self.files[path]
        return content.encode() if isinstance(content, str) else content

    def list_files(self, pattern: str) -> list[str]:
        return [path for path in self.files if fnmatch(path, pattern)]

    @staticmethod
    def find_package(name: str) -> str:
        if name != "parts":
            raise LookupError(f"no package {name!r}")
        return "/parts"

    def expand(self, path: str, **arguments: str) -> str:
        expander = XacroExpander(
            read_file=self.read_file, list_files=self.list_files, find_package=self.find_package, steps=500_000
        )
        return expander.expand(path, arguments)


def expand(elements: str, **files: str | bytes) -> str:
    text = f"<robot xmlns:xacro='http://ros.org/wiki/xacro'>{elements}</robot>"
    others = {f"/{name.replace('_', '.')}": content for name, content in files.items()}
    return Files({"/robot.xacro": text, **others}).expand("/robot.xacro")


@pytest.mark.parametrize(
    "use", ["<xacro:arg name='n' default='0'/>", "<a b='$(arg n)'/>", "<a b='$(eval n + 1)'/>", "${xacro.arg('n')}"]
)
def test_an_argument_is_one_that_a_description_declares_or_uses(use: str) -> None:
    files = Files({"/robot.xacro": f"<robot xmlns:xacro='http://ros.org/wiki/xacro'>{use}</robot>"})
    assert files.expand("/robot.xacro", n="1")
    with pytest.raises(SourceParseError, match=r"it has no argument 'other'; there is .*n"):
        files.expand("/robot.xacro", n="1", other="2")


def refused(elements: str, **files: str | bytes) -> str:
    with pytest.raises(SourceParseError) as caught:
        expand(elements, **files)
    assert "\n" not in caught.value.cause
    assert len(caught.value.cause) <= 2000
    return caught.value.cause


@pytest.fixture
def library_files(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets the library itself read the files in memory."""
    files = Files(dict(FILES))

    def opened(path: str) -> io.StringIO:
        return io.StringIO(files.read_file(path).decode())

    monkeypatch.setattr(xacro, "open", opened, raising=False)
    monkeypatch.setattr(xacro.glob, "glob", files.list_files)
    monkeypatch.setattr("xacro.substitution_args._eval_find", files.find_package)


@pytest.mark.usefixtures("library_files")
@pytest.mark.parametrize("arguments", [{}, {"name": "other", "simulated": "false"}])
def test_a_file_expands_as_by_the_library(arguments: dict[str, str]) -> None:
    expected = xacro.process_file("/robots/arm.urdf.xacro", mappings=dict(arguments)).toxml()
    assert Files(dict(FILES)).expand("/robots/arm.urdf.xacro", **arguments) == expected
    assert f'name="{arguments.get("name", "arm")}_shoulder"' in expected
    assert "A, B ${literal} some thing" in expected


def test_all_files_are_read_by_the_given_functions() -> None:
    files = Files(dict(FILES))
    files.expand("/robots/arm.urdf.xacro")
    assert set(files.read) == {*FILES, "/robots/missing.xacro"}


def test_nothing_is_evaluated_or_opened_by_python(monkeypatch: pytest.MonkeyPatch) -> None:
    original = builtins.compile

    def parse_only(*arguments: Any, **keywords: Any) -> Any:
        flags = keywords.get("flags", arguments[3] if len(arguments) > 3 else 0)
        assert flags & ast.PyCF_ONLY_AST, "code is compiled"
        return original(*arguments, **keywords)

    def fail(*_: object, **__: object) -> None:
        raise AssertionError("Python evaluates or opens something")

    files = Files(dict(FILES))
    expander = XacroExpander(read_file=files.read_file, list_files=files.list_files, find_package=files.find_package)
    with monkeypatch.context() as patch:
        patch.setattr(builtins, "compile", parse_only)
        for name in ("eval", "exec", "open"):
            patch.setattr(builtins, name, fail)
        patch.setattr("glob.glob", fail)
        patch.setattr("os.open", fail)
        text = expander.expand("/robots/arm.urdf.xacro")
    assert 'name="arm_elbow"' in text


@each_case(
    "place",
    [
        "<link name='${EXPRESSION}'/>",
        "<link>${EXPRESSION}</link>",
        "<xacro:if value='${EXPRESSION}'/>",
        "<xacro:unless value='${EXPRESSION}'/>",
        "<xacro:property name='a' value='${EXPRESSION}'/><link name='${a}'/>",
        "<xacro:property name='a' default='${EXPRESSION}'/><link name='${a}'/>",
        "<xacro:property name='a' lazy_eval='false' value='${EXPRESSION}'/>",
        "<xacro:property name='a' scope='global' value='${EXPRESSION}'/>",
        "<xacro:property name='${EXPRESSION}' value='1'/>",
        "<xacro:arg name='a' default='${EXPRESSION}'/>",
        "<xacro:macro name='m' params='a:=${EXPRESSION}'><link name='${a}'/></xacro:macro><xacro:m/>",
        "<xacro:macro name='m' params='a'><link name='${a}'/></xacro:macro><xacro:m a='${EXPRESSION}'/>",
        "<xacro:call macro='${EXPRESSION}'/>",
        "<xacro:element xacro:name='${EXPRESSION}'/>",
        "<link><xacro:attribute name='a' value='${EXPRESSION}'/></link>",
        "<xacro:include filename='${EXPRESSION}'/>",
        "<xacro:include filename='/other.xacro' ns='${EXPRESSION}'/>",
        "<xacro:include filename='/other.xacro'/>",
        "<!-- xacro:eval-comments --><!-- ${EXPRESSION} -->",
        "<link name='${xacro.load_yaml(&quot;/units.yaml&quot;)}'/>",
    ],
)
@each_case(
    "expression",
    ["[].__class__", "(lambda: 1) and 1 or 2", "__import__", "''.format_map", "10**10**10"],
)
def test_an_escape_is_refused_wherever_an_expression_may_stand(place: str, expression: str) -> None:
    quoted = expression.replace("'", "&quot;").replace("<", "&lt;")
    expected = r"begins with _|lambda functions|after a dot|is not supported|__|bits of an integer|SyntaxError|syntax"
    with pytest.raises(SourceParseError, match=expected):
        expand(
            place.replace("EXPRESSION", quoted),
            other_xacro=f"<robot xmlns:xacro='x'><link name='${{{quoted}}}'/></robot>",
            units_yaml=f"a: !degrees {expression!r}",
        )


EXPONENTIAL = [
    pytest.param(
        "".join(f"<xacro:property name='p{i}' value='${{p{i - 1}}}${{p{i - 1}}}'/>" for i in range(1, 60))
        + "<xacro:property name='p0' value='x y'/><a b='${p59}'/>",
        id="doubled texts",
    ),
    pytest.param(
        "".join(f"<xacro:property name='p{i}' value='${{[p{i - 1}] * 1000}}'/>" for i in range(1, 40))
        + "<xacro:property name='p0' value='${[1]}'/><a b='${p39}'/>",
        id="nested lists",
    ),
    pytest.param(
        "".join(f"<xacro:macro name='m{i}'><xacro:m{i - 1}/><xacro:m{i - 1}/></xacro:macro>" for i in range(1, 60))
        + "<xacro:macro name='m0'><a/></xacro:macro><xacro:m59/>",
        id="macros",
    ),
    pytest.param(
        "<xacro:macro name='m' params='n **b'><xacro:if value='${n > 0}'><xacro:m n='${n - 1}'><c>"
        "<xacro:insert_block name='b'/><xacro:insert_block name='b'/></c></xacro:m></xacro:if>"
        "<xacro:insert_block name='b'/></xacro:macro><xacro:m n='40'><c><d/></c></xacro:m>",
        id="blocks",
    ),
    pytest.param(
        "<xacro:arg name='a' default='" + "x" * 1000 + "'/>"
        "<xacro:property name='p' value='${&quot;arg a) $$(&quot; * 10000}'/><a b='$(${p}arg a)'/>",
        id="substitutions",
    ),
    pytest.param("<xacro:macro name='m'><xacro:m/></xacro:macro><xacro:m/>", id="recursion"),
    pytest.param("<xacro:include filename='/robot.xacro'/>", id="a file that includes itself"),
    pytest.param("<xacro:property name='a' value='${b}'/><xacro:property name='b' value='${a}'/>${a}", id="circle"),
    pytest.param("<xacro:macro name='m' params=\"a:=" + "x" * 60 + "'\"/><xacro:m/>", id="pattern of parameters"),
    pytest.param("<a b='${" + "(" * 500 + "}'/>", id="parentheses"),
    pytest.param("<a>" * 2000 + "</a>" * 2000, id="nested elements"),
]


@each_case("elements", EXPONENTIAL)
def test_growth_without_bounds_is_refused(elements: str) -> None:
    assert refused(elements)


ALIASES = "a0: &a0 [x]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12))
MERGES = "a0: &a0 {x: 1}\n" + "".join(f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 9)}]}}\n" for i in range(1, 12))


@each_case(
    ("yaml", "cause"),
    [
        (ALIASES, "characters and elements of a value"),
        (MERGES, "steps"),
        ("a: &a [*a]", "levels of nested lists"),
        ("a: !!binary aGVsbG8=", "bytes"),
        ("a: !!python/object/apply:os.system [ls]", "could not determine a constructor"),
        ("a: !degrees '__import__'", "begins with __"),
    ],
)
def test_a_yaml_file_has_plain_data_of_limited_size(yaml: str, cause: str) -> None:
    assert cause in refused("<a b='${xacro.load_yaml(&quot;/a.yaml&quot;)}'/>", a_yaml=yaml)


def test_a_document_type_is_refused_in_every_file() -> None:
    entities = "<!DOCTYPE a [<!ENTITY x 'y'>]><robot>&x;</robot>"
    assert "DOCTYPE" in refused("<xacro:include filename='/a.xacro'/>", a_xacro=entities)
    with pytest.raises(SourceParseError, match="DOCTYPE"):
        Files({"/a": entities}).expand("/a")


def test_the_environment_is_empty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SECRET", "hidden")
    assert 'b="none"' in expand("<a b='$(optenv SECRET none)'/>")
    assert "not set" in refused("<a b='$(env SECRET)'/>")
    assert "hidden" not in refused("<a b='$(eval env(\"SECRET\")'/>")


def test_a_missing_file_is_named() -> None:
    assert "No such file or directory: '/nowhere.xacro'" in refused("<xacro:include filename='nowhere.xacro'/>")
    assert "No such file or directory: '/nowhere.yaml'" in refused("${xacro.load_yaml('nowhere.yaml')}")


def test_a_file_in_another_encoding_is_read() -> None:
    text = "<?xml version='1.0' encoding='iso-8859-1'?><robot name='Löffel'/>".encode("latin-1")
    assert 'name="Löffel"' in Files({"/a": text}).expand("/a")


def test_a_message_of_a_file_is_dropped_and_a_fatal_one_ends_the_expansion(capsys: pytest.CaptureFixture[str]) -> None:
    assert 'b=""' in expand("<a b='${xacro.warning(&quot;old&quot;)}'/>")
    assert capsys.readouterr() == ("", "")
    assert "no such hand: 3" in refused("${xacro.fatal('no such hand:', 3)}")


def test_the_library_is_as_before_after_an_expansion() -> None:
    before = dict(vars(xacro))
    refused("${1 / 0}")
    changed = {name for name, value in vars(xacro).items() if before[name] is not value}
    assert changed <= {"filestack", "macrostack"}
