"""Server: the web server of the page, on a free port: our page and its channel, and viser's view in it."""

from __future__ import annotations

import errno
import io
import socket
import threading
from collections.abc import Collection, Iterator
from contextlib import contextmanager, redirect_stdout

import viser

from mindstage.errors import ViewerUnavailableError
from mindstage.viewport.channel import RpcChannel
from mindstage.viewport.gate import RequestFilter, view_key
from mindstage.viewport.sockets import HttpRoutes, patched_viser

__all__ = ["address", "serve", "session_key_of", "shut_down"]

_MAX_PORT_TRIES = 200
"""So many ports are tried, one after the other."""
_output_lock = threading.Lock()


class _Server(viser.ViserServer):
    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuses: any visitor could ask for it, and the page would be open to the whole world."""
        return None


def serve(
    host: str,
    port: int,
    *,
    title: str,
    channel: RpcChannel,
    token: str | None = None,
    origins: Collection[str] = (),
) -> viser.ViserServer:
    """Starts a server at the port, or at the next one that is free.

    Args:
        host: where to listen; others than this machine's own need a token.
        port: where to listen; 0 lets the system choose.
        title: of the page.
        channel: keeps the visitors' websockets.
        token: what visitors must know.
        origins: addresses under which the page may be opened beside its own.

    Raises:
        AuthenticationError: others could reach it, and there is no token.
        ViewerUnavailableError: the host is not this machine, or no port is free.
    """
    doors = HttpRoutes(RequestFilter(host=host, token=token, origins=origins), channel=channel.serve_session)
    free = _free_port(host, port)
    with _without_output(), patched_viser(doors):
        server = _Server(host=host, port=free, label=title, verbose=False)
    if not doors.patched:
        shut_down(server)
        raise ViewerUnavailableError(host, port, cause="this release of viser has no place for the gate before it")
    server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(232, 93, 4))
    return server


def session_key_of(client: viser.ClientHandle, server: viser.ViserServer) -> str | None:
    """The key of the visitor in whose page a view is; None where somebody opened the view by itself."""
    connection = server._websock_server._live_connections.get(client.client_id)
    return view_key(connection.request.path) if connection is not None and connection.request is not None else None


def shut_down(server: viser.ViserServer) -> None:
    """Ends a server; its visitors are told that the connection is lost."""
    with _without_output():
        server.stop()


def address(server: viser.ViserServer) -> str:
    """What to type into a browser."""
    host = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}.get(server.get_host(), server.get_host())
    return f"http://{f'[{host}]' if ':' in host else host}:{server.get_port()}"


def _free_port(host: str, port: int) -> int:
    cause: OSError | None = None
    for candidate in range(port, min(port + _MAX_PORT_TRIES, 65536)):
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            with socket.create_server((host, candidate), family=family):
                return candidate
        except OSError as error:
            cause = error
            if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                break
    reason = (cause.strerror or str(cause)) if cause else "there is no such port"
    raise ViewerUnavailableError(host, port, cause=reason) from cause


@contextmanager
def _without_output() -> Iterator[None]:
    # viser greets and says goodbye on stdout, where a program's own output belongs. One at a time: two that overlap
    # would put back each other's stdout.
    with _output_lock, redirect_stdout(io.StringIO()):
        yield
