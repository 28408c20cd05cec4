"""Ports of servers: a port that was asked for is that one, and the default port may be the next free one."""

from __future__ import annotations

import errno
import os
from collections.abc import Sequence
from contextlib import suppress
from enum import StrEnum
from pathlib import Path

from mindstage.access.limits import PORT_TRIES

__all__ = ["PAGE_PORT", "ROSBRIDGE_PORT", "Discovery", "is_taken", "moved_text", "ports_to_try", "unavailable_text"]

PAGE_PORT = 8080
"""The default port of the page."""
ROSBRIDGE_PORT = 9090
"""The default port of the rosbridge, which is that of rosbridge_server."""
_LISTENING = "0A"
_LOCAL_ADDRESS, _STATE, _INODE = 1, 3, 9
"""Columns of `/proc/net/tcp` (proc_net_tcp in the kernel's documentation)."""


class Discovery(StrEnum):
    """How far participants of ROS 2 find each other (ROS_AUTOMATIC_DISCOVERY_RANGE)."""

    LOCALHOST = "localhost"
    SUBNET = "subnet"
    SYSTEM = "system"
    """The middleware's own default."""


def ports_to_try(port: int | None, *, default: int) -> Sequence[int]:
    """The ports that a server tries one after the other: the given one, or the default and those after it."""
    return (port,) if port is not None else range(default, min(default + PORT_TRIES.count, 65536))


def is_taken(error: OSError) -> bool:
    """Whether a server cannot listen since the port is in use, or reserved."""
    return error.errno in (errno.EADDRINUSE, errno.EACCES)


def unavailable_text(error: OSError, port: int) -> str:
    """Why a server cannot listen, with the process that uses the port if it is one of the user's."""
    text = os.strerror(error.errno) if error.errno else str(error)
    user = _user_of(port) if is_taken(error) else ""
    return f"{text} ({user})" if user else text


def moved_text(what: str, *, default: int, port: int) -> str:
    """A sentence for the user about a server whose default port is in use."""
    user = _user_of(default)
    return f"port {default} is in use{f' ({user})' if user else ''}; {what} is served at port {port}"


def _user_of(port: int) -> str:
    """The process that listens at a port, if `/proc` shows it; else an empty text."""
    inodes: set[str] = set()
    for table in ("tcp", "tcp6"):
        with suppress(OSError):
            rows = [line.split() for line in Path("/proc/net", table).read_text("ascii").splitlines()[1:]]
            inodes |= {
                f"socket:[{row[_INODE]}]"
                for row in rows
                if row[_STATE] == _LISTENING and int(row[_LOCAL_ADDRESS].rpartition(":")[2], 16) == port
            }
    for process in Path("/proc").glob("[0-9]*") if inodes else ():
        with suppress(OSError):  # of another user, or it has ended
            if any(os.readlink(each) in inodes for each in os.scandir(process / "fd")):
                name = (process / "comm").read_text("utf-8", "replace").strip()
                return f"by process {process.name}, {name}"
    return ""
