"""`mindstage` in a process that is watched: python -m tests.fuzz.served FOLDER serve --json …

Attempts to write outside of FOLDER and of the temporary folder, to reach another machine, and exceptions that end a
thread are appended to FOLDER/offences.txt. SIGUSR1 writes FOLDER/running.json: the live threads, and what the running
servers have, with the types of all requests.
"""

from __future__ import annotations

import ipaddress
import json
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from types import FrameType
from typing import Any

from mindstage.bridge import LocalNode
from mindstage.cli import main
from mindstage.ros.queries import QueryServer
from mindstage.simulation import Simulation
from mindstage.viewer import Viewer

LOCAL_NAMES = {"", "localhost", "localhost.localdomain"}
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_TRUNC
CHANGES = {"os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.symlink", "os.link", "os.truncate", "os.chmod"}


class Watch:
    """Records what the process must not do."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._allowed = (str(folder.resolve()), os.path.realpath(tempfile.gettempdir()), "/dev", "/proc")
        self._file = os.open(folder / "offences.txt", os.O_CREAT | os.O_WRONLY | os.O_APPEND)
        sys.addaudithook(self._audit)
        threading.excepthook = self._thread_ended
        signal.signal(signal.SIGUSR1, self._describe)

    def _report(self, text: str) -> None:
        os.write(self._file, f"{text}\n".encode("utf-8", "replace"))

    def _audit(self, event: str, args: tuple[Any, ...]) -> None:
        if event == "open":
            path, mode, flags = args
            if isinstance(path, str | bytes) and (flags & WRITING or any(each in (mode or "") for each in "wax+")):
                self._check_path(event, path)
        elif event in CHANGES:
            for path in args[: 2 if event in {"os.rename", "os.link", "os.symlink"} else 1]:
                if isinstance(path, str | bytes):
                    self._check_path(event, path)
        elif event in {"socket.connect", "socket.sendto"} and isinstance(args[1], tuple):
            self._check_host(event, str(args[1][0]))
        elif event == "socket.getaddrinfo" and args[0] is not None:
            self._check_host(event, args[0].decode() if isinstance(args[0], bytes) else str(args[0]))

    def _check_path(self, event: str, path: str | bytes) -> None:
        real = os.path.realpath(os.fsdecode(path))
        if not any(real == each or real.startswith(f"{each}/") for each in self._allowed):
            self._report(f"{event}: {real}")

    def _check_host(self, event: str, host: str) -> None:
        if host in LOCAL_NAMES:
            return
        try:
            is_local = ipaddress.ip_address(host).is_loopback or host in {"0.0.0.0", "::"}
        except ValueError:
            is_local = False
        if not is_local:
            self._report(f"{event}: {host}")

    def _thread_ended(self, args: threading.ExceptHookArgs) -> None:
        name = args.thread.name if args.thread is not None else "a thread"
        self._report(f"{name} ended: {args.exc_type.__name__}: {args.exc_value}")

    def _describe(self, _: int, __: FrameType | None) -> None:
        place = self._folder / "running.json"
        part = place.with_suffix(".part")
        part.write_text(json.dumps(describe()))
        part.replace(place)


def remember(*classes: type) -> None:
    """Keeps all objects of some classes, in `made`."""

    def remembering(initialize: Callable[..., None]) -> Callable[..., None]:
        @wraps(initialize)
        def remembered(self: object, *args: Any, **options: Any) -> None:
            made.append(self)
            initialize(self, *args, **options)

        return remembered

    for each in classes:
        each.__init__ = remembering(each.__init__)  # type: ignore[misc]


made: list[Any] = []


def describe() -> dict[str, Any]:
    """The live threads, and what the servers of this process offer."""
    graphs = [each.graph_info() for each in made if isinstance(each, LocalNode)]
    graph = max(graphs, key=lambda each: len(each.services))
    (viewer,) = (each for each in made if isinstance(each, Viewer))
    (shell,) = (each for each in made if isinstance(each, QueryServer))
    (simulation,) = (each for each in made if isinstance(each, Simulation) and each.origin is None)
    methods = {
        name: f"{method.request_type.__module__}:{method.request_type.__qualname__}"
        for name, method in viewer.channel._methods.items()
    }
    return {
        "threads": sorted(thread.name for thread in threading.enumerate()),
        "services": {each.name: each.type for each in graph.services},
        "actions": {each.name: each.type for each in graph.actions},
        "topics": {each.name: each.type for each in graph.topics},
        "methods": methods,
        "bodies": list(simulation.state.ids),
        "shell": {"url": shell.url, "token": shell.record.token},
    }


if __name__ == "__main__":
    folder = Path(sys.argv.pop(1)).resolve()
    remember(LocalNode, QueryServer, Simulation, Viewer)
    Watch(folder)
    main()
