"""The process that expands one xacro file. It asks its parent for each file, and can do nothing but compute itself."""

from __future__ import annotations

import codecs
import errno
import gc
import os
import sys
from collections.abc import Sequence
from contextlib import suppress

import msgspec

from mindstage.errors import SourceParseError
from mindstage.maps.urdf.xacro_process import (
    Expansion,
    FileRequest,
    PackageRequest,
    PatternRequest,
    Reply,
    Task,
    read_message,
    write_message,
)
from mindstage.sandbox import confine

__all__ = ["main"]

_MEMORY_LIMIT = 2 * 1024**3
"""Address space limit [bytes]."""
_ENCODINGS = ("ascii", "cp1252", "iso8859_15", "latin_1", "utf_8", "utf_8_sig", "utf_16", "utf_16_be", "utf_16_le")
"""The encodings of files, whose codecs are loaded on first use."""


def main() -> None:
    """Expands the file that the parent names, and ends the process."""
    try:
        task = msgspec.msgpack.decode(read_message(sys.stdin.buffer), type=Task)
        outcome = _outcome(task)
    except MemoryError:
        gc.collect()
        outcome = Expansion(problem="it needs too much memory")
    except Exception as error:  # a library may raise anything
        outcome = Expansion(problem=" ".join(f"{type(error).__name__}: {error}".split())[:2000])
    with suppress(OSError, EOFError):  # the parent has ended
        write_message(sys.stdout.buffer, outcome)
    os._exit(0)


def _outcome(task: Task) -> Expansion:
    from mindstage.maps.urdf.xacro_expansion import XacroExpander

    expander = XacroExpander(read_file=_read_file, list_files=_list_files, find_package=_find_package)
    for encoding in _ENCODINGS:
        codecs.lookup(encoding)
    if problem := _limit_resources(task) or confine():
        return Expansion(problem=problem, is_unconfined=True)
    try:
        data = expander.expand(task.path, task.arguments).encode()
    except SourceParseError as error:
        return Expansion(problem=error.cause)
    except RecursionError:
        return Expansion(problem="its macros are nested too deep")
    if len(data) > task.result_limit:
        return Expansion(problem=f"it has {len(data):,} bytes when expanded; at most {task.result_limit:,} are allowed")
    return Expansion(text=data)


def _limit_resources(task: Task) -> str | None:
    """Limits memory and processor time; returns why it cannot."""
    try:
        import resource
    except ImportError:
        return "this system has no limits of resources"
    for limit, wanted in ((resource.RLIMIT_AS, _MEMORY_LIMIT), (resource.RLIMIT_CPU, task.cpu_s)):
        _, hard = resource.getrlimit(limit)
        value = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        with suppress(ValueError, OSError):  # not every system has the limit of the address space
            resource.setrlimit(limit, (value, value))
    return None


# -- the parent --------------------------------------------------------------------------------------------------------


class _RefusedError(OSError):
    """The parent has not read a file."""

    def __str__(self) -> str:
        return str(self.strerror)


def _ask(request: FileRequest | PatternRequest | PackageRequest) -> Reply:
    write_message(sys.stdout.buffer, request)
    return msgspec.msgpack.decode(read_message(sys.stdin.buffer), type=Reply)


def _read_file(path: str) -> bytes:
    reply = _ask(FileRequest(path=path))
    if reply.problem:
        raise _RefusedError(errno.EACCES, reply.problem)
    return reply.data


def _list_files(pattern: str) -> Sequence[str]:
    reply = _ask(PatternRequest(pattern=pattern))
    if reply.problem:
        raise _RefusedError(errno.EACCES, reply.problem)
    return reply.paths


def _find_package(name: str) -> str:
    reply = _ask(PackageRequest(name=name))
    if reply.problem:
        raise LookupError(reply.problem)
    return reply.paths[0]
