"""Records of running simulations: files in the user's cache by which the shell finds what runs on this machine.

A record has a token and is readable by the user only. It is removed when the simulation is closed; one of a process
that was killed is recognized by the process's id and start.
"""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import msgspec

from mindstage.files import atomic_file, cache_dir, is_own_folder
from mindstage.ranges import Port, checked

__all__ = ["HOST", "QUERY_SERVICE", "RunRecord", "running_simulations"]

HOST = "127.0.0.1"
QUERY_SERVICE = "mindstage/query"
"""Name of the service that answers queries, relative to the root or to the namespace of a simulation."""
_DIRECTORY = "running"
_START_FIELD = 19
"""Index of the start of a process in `/proc/PID/stat` (field 22 of proc_pid_stat(5)), after the name of the program."""


class RunRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A simulation of this user that answers queries."""

    process: int
    """Id of the process."""
    started: str
    """What distinguishes the process from a later one with the same id; empty if the system does not say."""
    machine: str
    """Name of the machine, since several can share a home directory."""
    port: int
    token: str
    maps: tuple[str, ...]
    """Local names of the maps when it started."""
    page: str = ""
    """Address of the page; empty without one."""

    @classmethod
    @checked
    def of_this_process(cls, *, port: Port, token: str, maps: Sequence[str], page: str = "") -> RunRecord:
        """Makes the record of a simulation in this process."""
        process = os.getpid()
        return cls(
            process=process,
            started=_start_of(process),
            machine=socket.gethostname(),
            port=port,
            token=token,
            maps=tuple(maps),
            page=page,
        )

    @property
    def url(self) -> str:
        """Of the websocket."""
        return f"ws://{HOST}:{self.port}"

    @property
    def is_stale(self) -> bool:
        """Whether the process has ended without removing its record."""
        try:
            os.kill(self.process, 0)
        except OSError:  # none, or one of another user, with the same id
            return True
        return self.started != _start_of(self.process)

    def write(self) -> Path:
        """Writes the file.

        Raises:
            OSError: it cannot be written, or others may write to its folder.
        """
        file = _folder() / f"{self.process}-{self.port}.json"
        with atomic_file(file) as part:
            part.chmod(0o600)  # before it has a content
            part.write_bytes(msgspec.json.encode(self))
        return file

    def __str__(self) -> str:
        maps = ", ".join(self.maps) or "no map"
        return f"{self.process} ({maps}{f', {self.page}' if self.page else ''})"


def running_simulations() -> tuple[RunRecord, ...]:
    """Returns the simulations of this user on this machine, the oldest first, and removes stale records."""
    found: list[tuple[float, RunRecord]] = []
    try:
        files = list(_folder().glob("*.json"))
    except OSError:  # records in it may be those of others
        return ()
    for file in files:
        try:
            modified_s, record = file.stat().st_mtime, msgspec.json.decode(file.read_bytes(), type=RunRecord)
        except (OSError, msgspec.MsgspecError):  # removed meanwhile, or of another version
            continue
        if record.machine != socket.gethostname():
            continue
        if record.is_stale:
            with suppress(OSError):
                file.unlink()
        else:
            found.append((modified_s, record))
    return tuple(record for _, record in sorted(found, key=lambda each: (each[0], each[1].port)))


def _folder() -> Path:
    """The folder of the records, which only the user can read and change.

    Raises:
        OSError: it belongs to someone else, or is a link.
    """
    folder = cache_dir(_DIRECTORY)
    if not is_own_folder(folder):
        raise OSError(errno.EPERM, "it is a link, or the folder of another user", str(folder))
    return folder


def _start_of(process: int) -> str:
    """The time at which a process started, in clock ticks since the system did; empty without /proc."""
    try:
        text = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    return text.rpartition(")")[2].split()[_START_FIELD]
