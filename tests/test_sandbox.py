"""What a confined process cannot do."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows cannot confine a process")

_ATTEMPTS = """
import ctypes, json, os, resource, signal, socket, sys, threading
from pathlib import Path
from mindstage.sandbox import confine

folder = sys.argv[1]
opened, change = threading.Event(), {}

def later():
    opened.wait()
    attempt("a file in another thread", lambda: os.open(__file__, os.O_RDONLY))

def attempt(name, action):
    try:
        action()
    except (OSError, RuntimeError, ValueError):
        change[name] = "denied"
    else:
        change[name] = "done"

other = threading.Thread(target=later)
other.start()
problem = confine()
attempt("read a file", lambda: os.open(__file__, os.O_RDONLY))
attempt("write a file", lambda: Path(folder, "new").write_text("x"))
attempt("list a folder", lambda: os.listdir(folder))
attempt("look for a file", lambda: os.stat(folder))
attempt("delete a file", lambda: os.unlink(f"{folder}/kept"))
attempt("rename a file", lambda: os.rename(f"{folder}/kept", f"{folder}/moved"))
attempt("change a mode", lambda: os.chmod(f"{folder}/kept", 0))
attempt("a socket", socket.socket)
attempt("a pair of sockets", socket.socketpair)
attempt("a pipe", os.pipe)
attempt("a copy of a descriptor", lambda: os.dup(0))
attempt("a process", os.fork)
attempt("a program", lambda: os.execv("/bin/true", ["true"]))
attempt("a posix_spawn", lambda: os.posix_spawn("/bin/true", ["true"], {}))
attempt("a signal", lambda: os.kill(os.getppid(), 0))
attempt("a thread", lambda: threading.Thread(target=print).start())
attempt("a raised limit", lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (9, 9)))
libc = ctypes.CDLL(None, use_errno=True)
change["trace"] = "denied" if libc.ptrace(0, 0, 0, 0) == -1 else "done"
opened.set()
other.join()
change["computing"] = "done" if sum(range(1000)) == 499500 and bytes(10_000_000) else "denied"
print(json.dumps([problem, change]), flush=True)
os._exit(0)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux denies all of it")
def test_a_confined_process_can_only_compute_and_use_its_open_files(tmp_path: Path) -> None:
    script = tmp_path / "attempts.py"
    script.write_text(_ATTEMPTS, encoding="utf-8")
    (tmp_path / "kept").write_text("kept", encoding="utf-8")
    completed = subprocess.run(
        [sys.executable, str(script), str(tmp_path)], capture_output=True, text=True, timeout=120, check=False
    )
    assert completed.returncode == 0, completed.stderr
    problem, change = json.loads(completed.stdout)
    assert problem is None
    assert {name for name, result in change.items() if result == "done"} == {"computing"}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["attempts.py", "kept"]
