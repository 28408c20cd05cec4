"""A server with the faults that a SPARQL client has to handle."""

from __future__ import annotations

import base64
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

__all__ = ["FaultyServerStarter", "start_faulty_server"]

FaultyServerStarter = Callable[[str], str]
"""Starts a server with one fault, and returns its URL."""

_TRUE = b'{"head": {}, "boolean": true}'


class _Handler(BaseHTTPRequestHandler):
    fault = ""
    stop = threading.Event()

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        match self.fault:
            case "silent":
                self.stop.wait()
            case "trickling":
                self._head(200, length=10**6)
                while not self.stop.wait(0.05):
                    self.wfile.write(b" ")
            case "hanging up":
                pass
            case "cut off":
                self._head(200, length=1000)
                self.wfile.write(b"{")
            case "no HTTP":
                self.wfile.write(b"220 mail.example ESMTP\r\n\r\n")
            case "a page":
                self._answer(200, b"<html>Hello</html>", "text/html")
            case "moved":
                self._answer(301, b"", Location="http://elsewhere.example/")
            case "locked":
                self._answer(401, b"who are you?")
            case "broken":
                self._answer(500, b"out of\n luck")
            case "endless":
                self._head(200, length=None)
                while not self.stop.is_set():
                    self.wfile.write(b" " * 65536)
            case "protected":
                expected = "Basic " + base64.b64encode(b"me:s ecret").decode()
                self._answer(200 if self.headers["Authorization"] == expected else 401, _TRUE)
            case "read-only":
                self._answer(405, b"no")
            case "echoing the path":
                self._answer(418, f"at {self.path.removeprefix('/endpoint')}".encode())
            case fault:
                raise AssertionError(fault)

    def _answer(
        self, status: int, body: bytes, content_type: str = "application/sparql-results+json", **headers: str
    ) -> None:
        self._head(status, length=len(body), content_type=content_type, **headers)
        self.wfile.write(body)

    def _head(self, status: int, *, length: int | None, content_type: str = "application/json", **headers: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", content_type)
        if length is not None:
            self.send_header("Content-Length", str(length))
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        pass


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, *_: object) -> None:
        """Clients close such connections, which is expected."""


@pytest.fixture
def start_faulty_server() -> Iterator[FaultyServerStarter]:
    servers: list[_Server] = []
    stop = threading.Event()

    def start(fault: str) -> str:
        handler = type("Handler", (_Handler,), {"fault": fault, "stop": stop})
        servers.append(_Server(("127.0.0.1", 0), handler))
        threading.Thread(target=servers[-1].serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()
        return f"http://127.0.0.1:{servers[-1].server_port}/endpoint"

    yield start
    stop.set()
    for server in servers:
        server.shutdown()
        server.server_close()
