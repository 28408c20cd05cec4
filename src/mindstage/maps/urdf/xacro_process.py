"""Expansion of xacro files by the package `xacro`, in a process that can only compute.

A file is expanded only if the user has named it and asked for it. The process opens no file: it asks this one for each,
which sends the contents of files in the folders that are granted.
"""

from __future__ import annotations

import contextlib
import glob
import json
import os
import struct
import subprocess
import sys
import threading
from collections.abc import Mapping
from importlib.util import find_spec
from itertools import islice, takewhile
from pathlib import Path
from types import MappingProxyType
from typing import IO

import msgspec

from mindstage.errors import SourceParseError
from mindstage.maps.io.ros_packages import RosPackagePath

__all__ = [
    "Expansion",
    "FileRequest",
    "PackageRequest",
    "PatternRequest",
    "Reply",
    "Request",
    "Task",
    "XacroRequest",
    "expand_xacro",
    "read_message",
    "requested_arguments",
    "write_message",
]

_TIMEOUT_S = 60.0
"""Time limit for the expansion of a file; a whole robot takes about one second."""
_RESULT_LIMIT = 64 * 1024 * 1024
"""Maximum size of the expanded file, and of a message [bytes]."""
_FILE_LIMIT = 16 * 1024 * 1024
"""Maximum size of one file that is read [bytes]."""
_TOTAL_LIMIT = 64 * 1024 * 1024
"""Maximum size of all files that are read [bytes]; a file that is read again counts again."""
_REQUEST_LIMIT = 10_000
"""Maximum number of files, patterns and packages that are asked for."""
_PACKAGE_LEVELS = 5
"""The number of folders above the file among which the package with it is searched."""
_NO_ARGUMENTS: Mapping[str, str] = MappingProxyType({})
_LENGTH = struct.Struct("<Q")
_KEPT_VARIABLES = ("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "SYSTEMROOT")
"""What the interpreter may need of the environment to start."""
_START = (
    "import json, sys; sys.path += json.loads(sys.argv[1]); from mindstage.maps.urdf.xacro_worker import main; main()"
)


class Task(msgspec.Struct, frozen=True, kw_only=True):
    """What the process expands, and within which limits; the first message to it."""

    path: str
    cpu_s: int
    result_limit: int
    arguments: Mapping[str, str] = {}


class FileRequest(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Asks for the contents of a file."""

    path: str


class PatternRequest(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Asks for the paths of the files that match a pattern of `glob`."""

    pattern: str


class PackageRequest(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Asks for the folder of a ROS package."""

    name: str


class Expansion(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """The end of the expansion."""

    text: bytes = b""
    problem: str = ""
    """Why the file cannot be expanded; empty if it is."""
    is_unconfined: bool = False
    """Whether the problem is that the process cannot be confined."""


Request = FileRequest | PatternRequest | PackageRequest | Expansion
"""A message from the process."""


class Reply(msgspec.Struct, frozen=True, kw_only=True):
    """The answer to a request."""

    data: bytes = b""
    """The contents of the file."""
    paths: tuple[str, ...] = ()
    """The matching files, or the folder of the package."""
    problem: str = ""
    """Why there is no answer; empty if there is one."""


def write_message(pipe: IO[bytes], message: msgspec.Struct) -> None:
    """Writes a message to a pipe."""
    data = msgspec.msgpack.encode(message)
    pipe.write(_LENGTH.pack(len(data)) + data)
    pipe.flush()


def read_message(pipe: IO[bytes], limit: int = 2 * _RESULT_LIMIT) -> bytes:
    """Reads a message from a pipe.

    Raises:
        EOFError: the pipe has ended.
        ValueError: the message is larger than the limit [bytes].
    """
    head = pipe.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        raise EOFError
    (length,) = _LENGTH.unpack(head)
    if length > limit:
        raise ValueError(f"a message of {length:,} bytes")
    data = pipe.read(length)
    if len(data) < length:
        raise EOFError
    return data


XacroRequest = bool | Mapping[str, str] | None
"""Whether the descriptions that the user names are expanded if they contain xacro: None for those whose name ends in
`.xacro`; values of their `xacro:arg` elements, by name, ask for it too."""


def requested_arguments(path: str | os.PathLike[str], xacro: XacroRequest) -> Mapping[str, str] | None:
    """The values of the `xacro:arg` elements of a file that the user has named; None if it is not to be expanded.

    Never call this for a name that comes from a port or is found in a file.
    """
    if isinstance(xacro, Mapping):
        return xacro
    asked = os.fspath(path).lower().endswith(".xacro") if xacro is None else xacro
    return {} if asked else None


def expand_xacro(
    path: Path, packages: RosPackagePath, arguments: Mapping[str, str] = _NO_ARGUMENTS, *, timeout_s: float = _TIMEOUT_S
) -> bytes:
    """Expands the macros of a xacro file and returns URDF.

    Files are read from the folder of the file, the package that it is in, and the folders of packages. `arguments` are
    the values of `xacro:arg` elements, by name.

    Raises:
        SourceParseError: xacro is not installed, fails, exceeds a limit, or its process cannot be confined.
    """
    if not _is_installed():
        cause = "it is written in xacro, which is not installed; try pip install mindstage[xacro]"
        raise SourceParseError(str(path), cause=cause)
    files = _GrantedFiles(path, packages)
    process = _start()
    expired = threading.Event()

    def expire() -> None:
        expired.set()
        process.kill()

    timer = threading.Timer(timeout_s, expire)
    timer.daemon = True
    timer.start()
    outcome: Expansion | None = None
    reason = ""
    task = Task(path=str(path), arguments=dict(arguments), cpu_s=int(timeout_s) + 1, result_limit=_RESULT_LIMIT)
    try:
        outcome = _serve(process, task, files)
    except ValueError as error:  # msgspec.DecodeError is one too
        reason = f"its process has sent {error}"
    except (EOFError, OSError):
        pass  # it has ended
    finally:
        timer.cancel()
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):  # of a request that the process did not read
                    pipe.close()
    if outcome is None:
        if expired.is_set():
            raise SourceParseError(str(path), cause=f"xacro did not expand it within {timeout_s:g} s")
        reason = reason or f"its process ended with {process.returncode}, as it does beyond its limit of memory or time"
        raise SourceParseError(str(path), cause=f"xacro cannot expand it: {reason}")
    if outcome.is_unconfined:
        cause = f"it is written in xacro, which is expanded only in a confined process: {outcome.problem}"
        raise SourceParseError(str(path), cause=cause)
    if outcome.problem:
        raise SourceParseError(str(path), cause=f"xacro cannot expand it: {outcome.problem}")
    return outcome.text


def _is_installed() -> bool:
    try:
        return find_spec("xacro") is not None
    except ValueError:  # sys.modules["xacro"] is None
        return False


def _start() -> subprocess.Popen[bytes]:
    """Starts the process, without the environment, the working directory and the module path of this one."""
    specs = [find_spec(name) for name in ("mindstage", "msgspec", "xacro", "yaml")]
    folders = [str(Path(spec.origin).resolve().parents[1]) for spec in specs if spec is not None and spec.origin]
    return subprocess.Popen(
        [sys.executable, "-I", "-S", "-B", "-X", "utf8", "-c", _START, json.dumps(list(dict.fromkeys(folders)))],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        cwd=os.path.abspath(os.sep),
        env={name: os.environ[name] for name in _KEPT_VARIABLES if name in os.environ},
    )


def _serve(process: subprocess.Popen[bytes], task: Task, files: _GrantedFiles) -> Expansion:
    """Answers the requests of the process until it has ended."""
    assert process.stdin is not None
    assert process.stdout is not None
    write_message(process.stdin, task)
    for _ in range(_REQUEST_LIMIT):
        request: Request = msgspec.msgpack.decode(read_message(process.stdout), type=Request)
        if isinstance(request, Expansion):
            return request
        try:
            reply = files.answer(request)
        except (OSError, ValueError, RuntimeError) as error:  # a loop of symbolic links; a name with a zero byte
            reply = Reply(problem=getattr(error, "strerror", None) or str(error))
        write_message(process.stdin, reply)
    return Expansion(problem=f"it reads more than {_REQUEST_LIMIT:,} files")


class _GrantedFiles:
    """The files that the expansion of one file may read."""

    def __init__(self, path: Path, packages: RosPackagePath) -> None:
        self._path, self._packages = path.resolve(), packages
        above = list(self._path.parents)[:_PACKAGE_LEVELS]
        own = next((folder for folder in above if (folder / "package.xml").is_file()), self._path.parent)
        self._folders = [self._path.parent, own, *packages.folders]
        self._remaining = _TOTAL_LIMIT

    def answer(self, request: FileRequest | PatternRequest | PackageRequest) -> Reply:
        """Answers a request; a refusal has the reason.

        Raises:
            OSError: the file cannot be read.
            ValueError: the name is not one of a file.
        """
        match request:
            case FileRequest(path=path):
                return self._read(Path(path))
            case PatternRequest(pattern=pattern):
                return self._matching(pattern)
            case PackageRequest(name=name):
                folder = self._packages.package_folder(name)
                if folder is None:
                    searched = ", ".join(map(str, self._packages.folders)) or "none; give one with --ontology"
                    return Reply(problem=f"no package folder contains {name!r}; searched: {searched}")
                return Reply(paths=(str(folder),))

    def _is_granted(self, path: Path) -> bool:
        real = path.resolve()
        return any(real.is_relative_to(folder) for folder in self._folders)

    def _refusal(self, path: Path) -> Reply:
        folder = path.resolve().parent
        cause = f"it is outside of the folders that may be read; to grant its folder, give --ontology {folder}"
        return Reply(problem=cause)

    def _matching(self, pattern: str) -> Reply:
        parts = Path(pattern).parts
        plain = list(takewhile(lambda part: not glob.has_magic(part), parts))
        if ".." in parts[len(plain) :] or not self._is_granted(base := self._path.parent.joinpath(*plain)):
            return self._refusal(Path(pattern))
        found = map(Path, glob.iglob(str(base.joinpath(*parts[len(plain) :]))))
        granted = (each for each in found if self._is_granted(each))
        return Reply(paths=tuple(sorted(map(str, islice(granted, _REQUEST_LIMIT)))))

    def _read(self, path: Path) -> Reply:
        real = (self._path.parent / path).resolve()
        if real != self._path and not self._is_granted(real):
            return self._refusal(path)
        if not real.is_file():  # reading a pipe or a device might never end
            return Reply(problem="there is no such file")
        limit = min(_FILE_LIMIT, self._remaining)
        with real.open("rb") as file:
            data = file.read(limit + 1)
        if len(data) > limit:
            whole = f"all files together have more than {_TOTAL_LIMIT:,} bytes"
            return Reply(problem=f"it has more than {limit:,} bytes" if limit == _FILE_LIMIT else whole)
        self._remaining -= len(data)
        return Reply(data=data)
