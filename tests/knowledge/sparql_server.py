"""An Oxigraph server on a free local port."""

from __future__ import annotations

import socket
import subprocess
import time
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import quote

__all__ = ["SparqlServer"]


class SparqlServer:
    """A running Oxigraph server."""

    def __init__(self, program: Path, *options: str) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        command = [program, "serve", *options, "--bind", f"127.0.0.1:{self.port}"]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.url = f"http://127.0.0.1:{self.port}/query"
        deadline = time.monotonic() + 60.0
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.port), timeout=1.0).close()
                return
            except OSError:
                assert self._process.poll() is None, "the server has ended"
                assert time.monotonic() < deadline, "the server does not start"
                time.sleep(0.02)

    def load_files(self, *files: Path, default: bool = False) -> None:
        """Uploads files, each into a named graph or all into the default graph."""
        for file in files:
            kind = "text/turtle" if file.suffix == ".ttl" else "application/rdf+xml"
            where = "default" if default else f"graph={quote(file.as_uri(), safe='')}"
            connection = HTTPConnection("127.0.0.1", self.port, timeout=60)
            connection.request("POST", f"/store?{where}", file.read_bytes(), {"Content-Type": kind})
            assert connection.getresponse().status < 300
            connection.close()

    def stop(self) -> None:
        self._process.kill()
        self._process.wait(60)
