"""Commands in unusual environments: names and outputs in other encodings, no home, full disks, SIGTERM, taken ports."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import pytest

from tests.cli.runner import WriteMap

MINDSTAGE = [sys.executable, "-m", "mindstage"]
TIMEOUT_S = 180.0
posix = pytest.mark.skipif(os.name != "posix", reason="signals, limits and names of files as on Linux and macOS")

Done = subprocess.CompletedProcess[bytes]


def run(
    *arguments: str | Path,
    environment: dict[str, str] | None = None,
    prepare: Callable[[], None] | None = None,
    program: Iterable[str] = MINDSTAGE,
) -> Done:
    """Runs a command, in this environment with changes, after a preparation in its process."""
    return subprocess.run(
        [*program, *map(str, arguments)],
        capture_output=True,
        env=os.environ | (environment or {}),
        preexec_fn=prepare,
        timeout=TIMEOUT_S,
        check=False,
    )


def assert_ok(done: Done, *, codes: tuple[int, ...] = (0,)) -> Done:
    assert b"Traceback" not in done.stderr, done.stderr.decode(errors="replace")
    assert done.returncode in codes, done.stderr.decode(errors="replace")
    return done


# -- names of files that are not UTF-8 ---------------------------------------------------------------------------------


@pytest.fixture
def odd(tmp_path: Path, write_map: WriteMap) -> Path:
    """A map in a folder, the names of both of which are not UTF-8."""
    folder = tmp_path / os.fsdecode(b"f\xff")
    try:
        folder.mkdir()
    except OSError as error:
        pytest.skip(f"the file system has names in UTF-8 only: {error}")
    return write_map().rename(folder / os.fsdecode(b"m\xfe.owl"))


@posix
@pytest.mark.parametrize(
    "verb",
    [
        "analyze MAP --json",
        "validate MAP",
        "compare MAP MAP --json",
        "convert MAP OUT.ttl",
        "convert MAP OUT.xml --json",
        "log MAP --engine null --for 0 -o OUT.owl --json",
        "log MAP --engine null --for 0 -o OUT.ttl",
        "ask where_is Mug1 --map MAP --json",
        "tell Mug1 label cup --map MAP -o OUT.ttl",
        "shot MAP --engine null -o OUT.png --size 64x48 --json",
        "spawn MAP --engine null --port 0 --for 0",
        "serve MAP --engine null --port 0 --for 0 --worlds FOLDER --json",
    ],
)
def test_a_name_that_is_not_utf_8(odd: Path, verb: str) -> None:
    out = odd.with_name(os.fsdecode(b"o\xfd"))
    words = [
        word.replace("MAP", str(odd)).replace("OUT", str(out)).replace("FOLDER", str(odd.parent))
        for word in verb.split()
    ]
    done = assert_ok(run(*words), codes=(0, 1) if verb.startswith(("ask", "log", "serve", "spawn")) else (0,))
    if "--json" in verb:
        json.loads(done.stdout.decode("utf-8"))
    if "OUT" in verb:
        written = [each for each in odd.parent.iterdir() if each.stem == out.name and each.is_file()]
        assert written
        assert written[0].stat().st_size > 0


@posix
def test_an_episode_whose_name_is_not_utf_8(odd: Path) -> None:
    file = odd.with_suffix(".mcap")
    assert_ok(run("record", odd, "--engine", "null", "--for", "0.2", "-o", file, "--json"), codes=(0, 1))
    for verb in (
        ("episode", "info", file, "--json"),
        ("ask", "where_is", "Mug1", "--episode", file, "--json"),
        ("ask", "where_is", "Mug1", "--episodes", odd.parent, "--map", odd, "--json"),
        ("replay", file, "--port", "0", "--no-open", "--for", "0.5"),
        ("episode", "export", file, "-o", odd.with_suffix(".csv")),
        ("episode", "export", file, "-o", odd.with_suffix(".html")),
        ("episode", "export", file, "-o", odd.with_suffix(".neem")),
    ):
        assert_ok(run(*verb), codes=(0, 1))


@posix
@pytest.mark.parametrize("as_json", [False, True])
def test_a_missing_file_whose_name_is_not_utf_8_is_an_error_with_its_name(tmp_path: Path, as_json: bool) -> None:
    done = run("analyze", tmp_path / os.fsdecode(b"no\xff.owl"), *(["--json"] if as_json else []))
    assert_ok(done, codes=(2,))
    message = json.loads(done.stdout)["error"]["message"] if as_json else done.stderr.decode()
    assert "no\N{REPLACEMENT CHARACTER}.owl: there is no such file" in message or "no?.owl" in message


# -- output in other encodings -----------------------------------------------------------------------------------------

ENCODINGS = [
    {"PYTHONIOENCODING": "cp1252"},
    {"PYTHONIOENCODING": "ascii"},
    {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": ":strict"},
]


@pytest.mark.parametrize("encoding", ENCODINGS, ids=str)
def test_what_an_encoding_cannot_represent_is_no_error(
    write_map: WriteMap, tmp_path: Path, encoding: dict[str, str]
) -> None:
    room = write_map("küche→.owl")
    for verb in (
        ("log", room, "--engine", "null", "--for", "0", "-o", tmp_path / "z→.owl"),
        ("analyze", room),
        ("--help",),
    ):
        assert_ok(run(*verb, environment=encoding))
    assert_ok(run("analyze", tmp_path / "no→.owl", environment=encoding), codes=(2,))


@pytest.mark.parametrize("encoding", ENCODINGS, ids=str)
def test_json_is_the_same_in_every_encoding(encoding: dict[str, str]) -> None:
    expected = json.loads(assert_ok(run("questions", "--json", environment={"PYTHONIOENCODING": "utf-8"})).stdout)
    assert json.loads(assert_ok(run("questions", "--json", environment=encoding)).stdout.decode("ascii")) == expected


@posix
def test_output_that_is_closed_is_no_error(write_map: WriteMap) -> None:
    command = 'exec "$@" >&- 2>&-'
    assert run("-c", command, "sh", *MINDSTAGE, "analyze", write_map(), program=["sh"]).returncode == 0


# -- home --------------------------------------------------------------------------------------------------------------

NO_PASSWD = """
import os, pwd, runpy, sys
def missing(*_): raise KeyError("no entry")
pwd.getpwuid = pwd.getpwnam = missing
sys.argv[0] = "mindstage"
runpy.run_module("mindstage", run_name="__main__")
"""


@posix
@pytest.mark.parametrize("home", [None, "/dev/null"])
def test_a_user_without_a_home(write_map: WriteMap, tmp_path: Path, home: str | None) -> None:
    room, temporary = write_map(), tmp_path / "tmp"
    temporary.mkdir()
    environment = {"PATH": os.defpath, "PYTHONPATH": os.environ.get("PYTHONPATH", ""), "TMPDIR": str(temporary)}
    if home is not None:
        environment["HOME"] = home
    for verb in (
        ["analyze", room],
        ["shot", room, "--size", "64x48", "-o", tmp_path / "a.png"],
        ["spawn", room, "--port", "0", "--for", "0.2"],
    ):
        done = subprocess.run(
            [sys.executable, "-c", NO_PASSWD, *map(str, verb)],
            capture_output=True,
            env=environment,
            cwd=tmp_path,
            timeout=TIMEOUT_S,
            check=False,
        )
        assert_ok(done)


@posix
@pytest.mark.parametrize("kind", ["link", "open", "file"])
def test_the_cache_among_temporary_files_is_the_user_s_own(tmp_path: Path, kind: str) -> None:
    elsewhere, expected = tmp_path / "elsewhere", tmp_path / f"mindstage-{os.getuid()}"
    elsewhere.mkdir()
    if kind == "link":
        expected.symlink_to(elsewhere)
    elif kind == "open":
        expected.mkdir()
        expected.chmod(0o777)
    else:
        expected.touch()
    code = (
        "from mindstage.files import cache_dir; folder = cache_dir('worlds'); (folder / 'x').touch();"
        "print(folder, oct(folder.parent.stat().st_mode & 0o777))"
    )
    environment = {"TMPDIR": str(tmp_path), "MINDSTAGE_CACHE": "/dev/null/none"}
    folder, mode = assert_ok(run("-c", code, program=[sys.executable], environment=environment)).stdout.split()
    assert mode == b"0o700"
    assert not list(elsewhere.iterdir())
    assert (Path(os.fsdecode(folder)).parent == expected) is (kind == "open")
    left = [each for each in tmp_path.iterdir() if each not in (elsewhere, expected)]
    assert not left, "the folder of the process is removed"


# -- full disks --------------------------------------------------------------------------------------------------------


def disk_of_4_kib() -> None:
    import resource

    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))


@posix
@pytest.mark.parametrize(
    "verb",
    [
        "convert bundled:kitchen OUT.owl",
        "convert bundled:kitchen OUT.ttl",
        "convert bundled:kitchen OUT.xml",
        "convert bundled:kitchen OUT.glb",
        "log bundled:kitchen --engine null --for 0 -o OUT.owl",
        "shot bundled:kitchen --engine null -o OUT.png",
        "shot bundled:kitchen --engine null -o OUT.jpg",
        "shot bundled:kitchen --engine null -o OUT.webp",
        "episode export EPISODE -o OUT.csv",
        "episode export EPISODE -o OUT.html",
    ],
)
def test_a_full_disk_is_named_and_leaves_the_old_file(verb: str, tmp_path: Path) -> None:
    if "EPISODE" in verb:
        episode = tmp_path / "run.mcap"
        assert_ok(run("record", "bundled:kitchen", "--for", "0.1", "-o", episode))
        verb = verb.replace("EPISODE", str(episode))
    folder = tmp_path / "out"
    folder.mkdir()
    out = folder / ("file" + verb.rpartition("OUT")[2].split()[0])
    out.write_bytes(b"old")
    words = [str(out) if word.startswith("OUT") else word for word in verb.split()]
    done = run(*words, prepare=disk_of_4_kib)
    assert_ok(done, codes=(2,))
    last = done.stderr.decode().strip().splitlines()[-1]
    assert last.startswith("mindstage: error: ")
    assert out.name.partition(".")[0] in last
    assert last.endswith("File too large")
    assert out.read_bytes() == b"old"
    assert [each.name for each in folder.iterdir()] == [out.name]


# -- SIGTERM -----------------------------------------------------------------------------------------------------------


@posix
@pytest.mark.parametrize("moments", [range(0, 12, 3), pytest.param(range(12), marks=pytest.mark.slow)])
def test_sigterm_at_any_time_exits_with_143_and_leaves_nothing(tmp_path: Path, moments: Sequence[int]) -> None:
    command = [*MINDSTAGE, "log", "bundled:kitchen", "--for", "3600", "-o", str(tmp_path / "out.owl")]
    for moment in moments:
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
        ) as process:
            time.sleep(0.12 * moment)
            process.send_signal(signal.SIGTERM)
            _, stderr = process.communicate(timeout=TIMEOUT_S)
        # Before the first line of Mindstage, Python has no handler; a shell shows 143 in this case too.
        assert process.returncode in (143, -signal.SIGTERM), stderr
        assert stderr == b""
        with pytest.raises(ProcessLookupError):
            os.killpg(process.pid, 0)
        assert os.listdir(tmp_path) == []


@posix
@pytest.mark.parametrize("swallowed", ["try: kill()\nexcept BaseException: pass", "class A:\n __del__ = kill\nA()"])
def test_sigterm_is_not_lost_where_its_exception_is_swallowed(tmp_path: Path, swallowed: str) -> None:
    (tmp_path / "yaml.py").write_text(
        "import os, signal, time\ndef kill(*_):\n os.kill(os.getpid(), signal.SIGTERM)\n for _ in range(9): pass\n"
        f"{swallowed}\ntime.sleep(60)\n"
    )
    (tmp_path / "plan.yaml").write_text("steps: []\n")
    done = run("evaluate", tmp_path / "plan.yaml", "bundled:kitchen", environment={"PYTHONPATH": _with_path(tmp_path)})
    assert done.returncode == 143
    assert b"bug" not in done.stderr


@posix
def test_sigterm_while_a_plug_in_is_imported_is_no_problem_of_the_plug_in(tmp_path: Path) -> None:
    (tmp_path / "ending.py").write_text(
        "import os, signal\nos.kill(os.getpid(), signal.SIGTERM)\nfor _ in range(9): pass\n"
    )
    metadata = tmp_path / "ending-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: ending\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[mindstage.dialects]\nending = ending:dialect [read]\n")
    done = run("check", "bundled:kitchen", environment={"PYTHONPATH": _with_path(tmp_path)})
    assert done.returncode == 143
    assert done.stderr == b""


def _with_path(folder: Path) -> str:
    return os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])


# -- ports -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "verb", ["spawn MAP --port PORT --for 1", "serve MAP --port PORT --for 1", "serve MAP --port 0 --viewer-port PORT"]
)
def test_a_port_that_was_given_and_is_taken_is_an_error(write_map: WriteMap, verb: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        words = verb.replace("MAP", str(write_map())).replace("PORT", port).split()
        done = run(*words, "--engine", "null", *(["--viewer"] if "--viewer-port" in words else []))
    assert_ok(done, codes=(2,))
    assert f"port {port}: Address already in use" in done.stderr.decode()
    if sys.platform == "linux":
        assert f"by process {os.getpid()}, " in done.stderr.decode()


@pytest.mark.parametrize(("verb", "default"), [("spawn", 8080), ("serve", 9090)])
def test_a_default_port_that_is_taken_is_replaced_and_that_is_said(
    write_map: WriteMap, verb: str, default: int
) -> None:
    try:
        taken = socket.create_server(("127.0.0.1", default))
    except OSError:
        taken = socket.socket()  # another program has it, which is as good
    with taken:
        done = run(verb, write_map(), "--engine", "null", "--for", "0.2")
    assert_ok(done)
    assert f"port {default} is in use" in done.stderr.decode()
    assert f"served at port {default + 1}" in done.stderr.decode() or "served at port" in done.stderr.decode()


def test_the_lock_of_told_statements_leaves_no_file_even_if_the_process_is_killed(tmp_path: Path) -> None:
    told = tmp_path / "told.ttl"
    code = (
        "import os, signal, sys; from pathlib import Path; from mindstage.files import file_lock\n"
        "with file_lock(Path(sys.argv[1])): os.kill(os.getpid(), signal.SIGKILL)"
    )
    subprocess.run([sys.executable, "-c", code, str(told)], timeout=TIMEOUT_S, check=False)
    assert_ok(run("tell", "milk_carton_1", "colour", "red", "--map", "bundled:kitchen", "-o", told))
    assert os.listdir(tmp_path) == ["told.ttl"]
    assert tempfile.gettempdir() not in told.read_text()
