"""Server: the web server of the page, on a free port, without what only viser's own demos need."""

from __future__ import annotations

import errno
import io
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout

import viser

from mindstage.errors import ViewportUnavailable

__all__ = ["address", "serve", "shut_down"]

_TRIES = 200
"""So many ports are tried, one after the other."""
_PANEL_WIDTH_PX = 320.0
_hushing = threading.Lock()


class _Server(viser.ViserServer):
    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuses: any visitor could ask for it, and the page would be open to the whole world."""
        return None


def serve(host: str, port: int, *, title: str) -> viser.ViserServer:
    """Starts a server at the port, or at the next one that is free.

    Raises:
        ViewportUnavailable: the host is not this machine, or no port is free.
    """
    free = _free_port(host, port)
    with _hushed():
        server = _Server(host=host, port=free, label=title, verbose=False)
    server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(232, 93, 4))
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(_PANEL_WIDTH_PX)
    return server


def shut_down(server: viser.ViserServer) -> None:
    """Ends a server; its visitors are told that the connection is lost."""
    with _hushed():
        server.stop()


def address(server: viser.ViserServer) -> str:
    """What to type into a browser."""
    host = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}.get(server.get_host(), server.get_host())
    return f"http://{f'[{host}]' if ':' in host else host}:{server.get_port()}"


def _free_port(host: str, port: int) -> int:
    cause: OSError | None = None
    for candidate in range(port, min(port + _TRIES, 65536)):
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            with socket.create_server((host, candidate), family=family):
                return candidate
        except OSError as error:
            cause = error
            if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                break
    reason = (cause.strerror or str(cause)) if cause else "there is no such port"
    raise ViewportUnavailable(host, port, cause=reason) from cause


@contextmanager
def _hushed() -> Iterator[None]:
    # viser greets and says goodbye on stdout, where a program's own output belongs. One at a time: two that overlap
    # would put back each other's stdout.
    with _hushing, redirect_stdout(io.StringIO()):
        yield
