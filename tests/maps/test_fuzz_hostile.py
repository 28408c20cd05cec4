"""Malicious files: each is refused or read within its limits, without network access or reading of other files."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.maps.dialect_maps import soma_map
from tests.maps.fuzz_supervisor import WorkerSupervisor
from tests.maps.small_maps import body_turtle, room_map, slide_joint
from tests.maps.small_urdf import box_urdf, joint_urdf, link_urdf, robot_urdf

MANY = 1500
"""So many that an algorithm of quadratic or exponential time exceeds the limit."""


@pytest.fixture(scope="module")
def supervisor(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WorkerSupervisor]:
    with WorkerSupervisor(tmp_path_factory.mktemp("worker")) as supervisor:
        yield supervisor


@pytest.fixture
def tcp_server() -> Iterator[tuple[str, list[str]]]:
    """A TCP server and the clients that have connected to it."""
    connections: list[str] = []
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.1)
        over = threading.Event()

        def serve() -> None:
            while not over.is_set():
                try:
                    connection, address = server.accept()
                except TimeoutError:
                    continue
                connections.append(str(address))
                connection.close()

        thread = threading.Thread(target=serve)
        thread.start()
        yield f"127.0.0.1:{server.getsockname()[1]}", connections
        over.set()
        thread.join(timeout=30)


def owl(doctype: str = "", *elements: str, label: str = "x") -> str:
    """Returns RDF/XML with a map and one individual."""
    return f"""<?xml version="1.0"?>
<!DOCTYPE rdf:RDF {doctype}>
<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:owl="http://www.w3.org/2002/07/owl#"
    xmlns:k="http://knowrob.org/kb/knowrob.owl#" xmlns:rdfs="http://www.w3.org/2000/01/rdf-schema#">
<k:SemanticEnvironmentMap rdf:about="http://example.org/m.owl#room"><rdfs:label>{label}</rdfs:label></k:SemanticEnvironmentMap>
{"".join(elements)}</rdf:RDF>
"""


def imports(iri: str) -> str:
    """Returns a map that imports an IRI."""
    return owl(
        "", f'<owl:Ontology rdf:about="http://example.org/m.owl"><owl:imports rdf:resource="{iri}"/></owl:Ontology>'
    )


# -- network and files -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "create_map",
    [
        lambda at: owl(f'[<!ENTITY a SYSTEM "http://{at}/a">]', label="&a;"),
        lambda at: owl(f'[<!ENTITY a PUBLIC "a" "http://{at}/a">]', label="&a;"),
        lambda at: owl(f'[<!ENTITY % a SYSTEM "http://{at}/a"> %a;]'),
        lambda at: owl(f'SYSTEM "http://{at}/a.dtd"'),
        lambda at: owl("", f'<?xml-stylesheet href="http://{at}/a.xsl"?>'),
        lambda at: imports(f"http://{at}/a.owl"),
        lambda at: imports(f"file://{at}/a.owl"),
        lambda at: imports(f"ftp://{at}/a.owl"),
        lambda at: imports(f"package://{at}/a.owl"),
        lambda at: owl(
            "", f'<rdf:Description rdf:about="http://{at}/a"><k:child rdf:resource="http://{at}/b"/></rdf:Description>'
        ),
        lambda at: f"@prefix a: <http://{at}/> . a:room a <http://{at}/Map> ; <http://{at}/imports> a: .",
    ],
    ids=[
        *("entity", "public entity", "parameter entity", "document type", "style sheet"),
        *("import", "import of a file elsewhere", "import by ftp", "import of a package", "names", "Turtle"),
    ],
)
def test_nothing_is_downloaded(
    create_map: Callable[[str], str], tmp_path: Path, supervisor: WorkerSupervisor, tcp_server: tuple[str, list[str]]
) -> None:
    at, connections = tcp_server
    text = create_map(at)
    file = tmp_path / ("map.owl" if text.startswith("<") else "map.ttl")
    file.write_text(text, encoding="utf-8")
    assert supervisor.read(file, ontologies=[tmp_path]).defect == ""
    assert connections == []


def test_meshes_of_robot_descriptions_are_not_downloaded(
    tmp_path: Path, supervisor: WorkerSupervisor, tcp_server: tuple[str, list[str]]
) -> None:
    at, connections = tcp_server
    meshes = (
        f'<visual><geometry><mesh filename="{scheme}://{at}/a.stl"/></geometry></visual>' for scheme in ("http", "file")
    )
    file = tmp_path / "kitchen.urdf"
    file.write_text(robot_urdf(link_urdf("a", *meshes)), encoding="utf-8")
    assert supervisor.read(file).defect == ""
    assert connections == []


def test_the_sandbox_detects_network_and_file_access(
    tmp_path: Path, supervisor: WorkerSupervisor, tcp_server: tuple[str, list[str]]
) -> None:
    at, connections = tcp_server
    code = f"""
import sys
from pathlib import Path
from tests.maps.fuzz_worker import SandboxAudit
audit = SandboxAudit()
import socket
try:
    socket.create_connection(("127.0.0.1", {at.partition(":")[2]}), timeout=10)
except PermissionError:
    pass
open("/etc/passwd").close()
print(len(audit.attempts), audit.opened_files)
"""
    completed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert completed.stdout.split()[0] != "0"
    assert "/etc/passwd" in completed.stdout
    assert connections == []


@pytest.mark.parametrize(
    "iri",
    [
        *("package://../../etc/passwd", "package://a/../../../etc/passwd", "package://%2e%2e/%2e%2e/etc/passwd"),
        *("package:///etc/passwd", "package://..", "file:///etc/passwd", "file:/etc/passwd", "file:///dev/zero"),
        *("file:///proc/kcore", "file:///proc/kmsg", "file:///proc/self/mem", "file:///", "file:loop", "file:pipe"),
        *("file:../../../../../../../../etc/passwd", "data:text/turtle,a", "file:%00"),
    ],
)
def test_an_import_outside_of_packages_or_of_a_special_file_is_reported_and_skipped(
    iri: str, tmp_path: Path, supervisor: WorkerSupervisor
) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    os.mkfifo(tmp_path / "pipe")
    file = tmp_path / "map.owl"
    file.write_text(imports(iri), encoding="utf-8")
    answer = supervisor.read(file, ontologies=[tmp_path])
    assert (answer.defect, answer.error, answer.maps) == ("", "", 1)
    assert answer.exit_code == 1
    assert any("it imports" in finding and "it is skipped" in finding for finding in answer.findings)


@pytest.mark.parametrize(
    "name", ["/dev/zero", "file:///dev/zero", "pipe.stl", "/proc/kcore", "loop.obj", "package://../a.stl"]
)
def test_a_mesh_that_is_not_a_regular_file_has_no_size(name: str, tmp_path: Path, supervisor: WorkerSupervisor) -> None:
    (tmp_path / "loop.obj").symlink_to(tmp_path / "loop.obj")
    os.mkfifo(tmp_path / "pipe.stl")
    file = tmp_path / "kitchen.urdf"
    file.write_text(
        robot_urdf(link_urdf("a", f'<visual><geometry><mesh filename="{name}"/></geometry></visual>')), encoding="utf-8"
    )
    answer = supervisor.read(file)
    assert (answer.defect, answer.bodies) == ("", 1)


# -- exhaustion --------------------------------------------------------------------------------------------------------

LAUGHS = "".join(f'<!ENTITY a{n} "{f"&a{n - 1};" * 10}">' for n in range(1, 12))


@pytest.mark.parametrize(
    "text",
    [
        owl(f'[<!ENTITY a0 "lol">{LAUGHS}]', label="&a11;"),
        owl(f'[<!entity a0 "lol">{LAUGHS.lower()}]', label="&a11;"),
        owl(f'[<!ENTITY a "{"x" * 60_000}">]', label="&a;" * 20_000),
        owl('[<!ENTITY a "&b;"><!ENTITY b "&a;">]', label="&a;"),
        owl(f'[<!ENTITY a0"lol">{LAUGHS}]', label="&a11;"),
        owl(f"[<!ENTITY a0 'lol'>{LAUGHS}]", '<owl:Thing rdf:about="a" rdf:about="&a11;"/>'),
    ],
    ids=["many times ten", "in small letters", "one long one", "a circle", "not well-formed", "in an attribute"],
)
@pytest.mark.parametrize("suffix", [".owl", ".xml", ".urdf"])
def test_entities_that_expand_exponentially_are_refused(
    text: str, suffix: str, tmp_path: Path, supervisor: WorkerSupervisor
) -> None:
    file = tmp_path / f"map{suffix}"
    file.write_text(text.replace("rdf:RDF", "robot") if suffix == ".urdf" else text, encoding="utf-8")
    answer = supervisor.read(file)
    assert answer.defect == ""
    assert "SourceParseError" in answer.error
    assert answer.exit_code == 2


def web(levels: int = 6, width: int = 60) -> str:
    """Nested individuals with exponentially many paths between them."""
    lines = [f":cup soma:hasLocalization {', '.join(f':n0-{n}' for n in range(width))} ; soma:hasShape :n0-1 ."]
    for level in range(levels):
        below = ", ".join(f":n{level + 1}-{n}" for n in range(width))
        lines += [f":n{level}-{n} dul:hasRegion {below} ." for n in range(width)]
    return soma_map(":cup a owl:NamedIndividual, soma:Cup .", *lines)


def relative_frames() -> str:
    pose = '[ soma:isRelativeTo :c{} ; k:translation "1 0 0" ; k:quaternion "0 0 0 1" ]'
    return soma_map(*(f":c{n} a soma:Cup ; soma:hasLocalization {pose.format((n + 1) % MANY)} ." for n in range(MANY)))


def nested_individuals() -> str:
    return room_map(body_turtle("cup", f"k:child {'[ k:child ' * MANY}[]{']' * MANY}"))


LARGE: dict[str, Callable[[], str]] = {
    "a web of ways": web,
    "poses relative to one another in a circle": relative_frames,
    "nested individuals": nested_individuals,
    "parents in a circle": lambda: room_map(
        *(body_turtle(f"b{n}", f"k:child :b{(n + 1) % MANY}") for n in range(MANY))
    ),
    "an individual with all others as children": lambda: room_map(
        body_turtle("b0", f"k:child {', '.join(f':b{n}' for n in range(MANY))}"),
        *(body_turtle(f"b{n}") for n in range(1, MANY)),
    ),
    "joints between two bodies": lambda: room_map(
        body_turtle("a"), body_turtle("b"), *(slide_joint(f"j{n}", "a", "b") for n in range(MANY // 3))
    ),
    "bodies with one id": lambda: room_map(*(body_turtle(f"b{n}", 'ms:id "b"') for n in range(MANY))),
    "bodies with one local name": lambda: room_map(
        *(
            body_turtle("b").replace(":b ", f"<http://example.org/{n}#b> ").replace(":b-p", f":b{n}-p")
            for n in range(MANY)
        )
    ),
    "poses of one individual": lambda: room_map(
        body_turtle("a"), *(body_turtle("a").replace(":a-pose", f":p{n}") for n in range(MANY))
    ),
    "classes above one another": lambda: room_map(
        body_turtle("cup", cls="e:c0"), *(f"e:c{n} rdfs:subClassOf e:c{n + 1} ." for n in range(MANY))
    ),
    "classes of one individual": lambda: room_map(body_turtle("cup", f"a {', '.join(f'e:c{n}' for n in range(MANY))}")),
    "maps": lambda: room_map(*(f":m{n} a k:SemanticEnvironmentMap ." for n in range(20))),
    "a list": lambda: room_map(body_turtle("cup", f"e:list ({' '.join(map(str, range(MANY)))})")),
    "a long text": lambda: room_map(body_turtle("cup", f'rdfs:label "{"x" * 10_000_000}"')),
    "a long number": lambda: room_map(
        body_turtle("cup", f'k:mass "{"9" * 1_000_000}" ; k:tagsData "{"A,b;" * 100_000}"')
    ),
}


@pytest.mark.parametrize("name", LARGE)
def test_large_numbers_of_statements_are_read_in_time(name: str, tmp_path: Path, supervisor: WorkerSupervisor) -> None:
    file = tmp_path / "map.ttl"
    file.write_text(LARGE[name](), encoding="utf-8")
    answer = supervisor.read(file)
    assert (answer.defect, answer.error) == ("", "")
    assert answer.maps


def test_a_literal_that_exceeds_the_memory_is_refused(tmp_path: Path, supervisor: WorkerSupervisor) -> None:
    file = tmp_path / "map.ttl"
    file.write_text(room_map(body_turtle("cup", f'rdfs:label "{"x" * 20_000_000}"')), encoding="utf-8")
    answer = supervisor.read(file)
    assert (answer.defect, answer.exit_code) == ("", 2)
    assert "too long to be held in memory" in answer.error


@pytest.mark.parametrize(
    "text",
    [
        "<a>" * 100_000,
        owl("", "<owl:Thing>" * 50_000),
        owl("", "<owl:Thing><k:child>" * 2000, "</k:child></owl:Thing>" * 2000),
        owl("", "<!--" * 50_000),
        owl("", '<owl:Thing rdf:about="a" ' + 'rdf:about="b" ' * 20_000 + "/>"),
        owl("", "<owl:Thing>&" + "&a;" * 20_000 + "</owl:Thing>"),
        owl("[" + "<!ENTITY a" * 20_000 + "]"),
        owl("", "</owl:Thing>" * 20_000),
        "<!DOCTYPE " * 50_000,
        "<!-- -->" * 20_000 + "<robot",
        "\n" * 1_000_000 + "<rdf:RDF",
        "# a\n" * 200_000 + "x",
        "<a> <b> " * 100_000,
        "@prefix a: <a> .\n" * 20_000 + "a:" + "b" * 10_000_000,
        "[" * 100_000,
        "",
        "\0" * 100_000,
    ],
    ids=range(17),
)
@pytest.mark.parametrize("suffix", [".owl", ".ttl", ".urdf"])
def test_repeated_characters_are_read_in_time(
    text: str, suffix: str, tmp_path: Path, supervisor: WorkerSupervisor
) -> None:
    file = tmp_path / f"map{suffix}"
    file.write_text(text, encoding="utf-8")
    assert supervisor.read(file).defect == ""


def test_a_robot_with_many_links_is_read_in_time(tmp_path: Path, supervisor: WorkerSupervisor) -> None:
    many = MANY // 3
    links = [link_urdf(f"l{n}", box_urdf("1 1 1")) for n in range(many)]
    joints = [
        joint_urdf(f"j{n}", "revolute", f"l{n}", f"l{(n + 1) % many}", "<axis xyz='0 0 1'/>") for n in range(many)
    ]
    file = tmp_path / "kitchen.urdf"
    file.write_text(robot_urdf(*links, *joints), encoding="utf-8")
    answer = supervisor.read(file)
    assert (answer.defect, answer.bodies) == ("", many)


# -- supervisor --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("code", "message"), [("while True: pass", "it hangs"), ("os._exit(7)", "ended with 7")])
def test_a_failed_worker_is_replaced(code: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.maps.fuzz_supervisor.CPU_LIMIT_S", 1.0)
    good = tmp_path / "map.ttl"
    good.write_text(room_map(body_turtle("cup")), encoding="utf-8")
    with WorkerSupervisor(tmp_path) as supervisor:
        monkeypatch.setattr(
            supervisor, "_command", [sys.executable, "-c", f"import os, sys\nsys.stdin.readline()\n{code}"]
        )
        assert message in supervisor.read(good).defect
        monkeypatch.undo()
        assert supervisor.read(good).defect == ""


def test_the_command_line_ends_without_a_traceback(tmp_path: Path) -> None:
    file = tmp_path / "map.owl"
    file.write_text(owl(f'[<!ENTITY a0 "lol">{LAUGHS}]', label="&a11;"), encoding="utf-8")
    command = [sys.executable, "-m", "mindstage", "validate", str(file)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert result.returncode == 2
    assert "Traceback" not in result.stderr
    assert result.stderr.startswith("mindstage: error: cannot read")
