"""A client that connects while a server starts is refused, or finds everything."""

from __future__ import annotations

import socket
import threading
import urllib.error
import urllib.request
from collections.abc import Callable
from contextlib import closing, suppress

import pytest
from websockets.exceptions import InvalidMessage, InvalidStatus

import mindstage as ms
from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.ros import RosInterface
from mindstage.viewer import Viewer
from tests.bridge.raw_client import RawClient
from tests.viewer.page_client import RequestFailedError, connect_page_client


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]
    return port


def first_success(connect: Callable[[], list[str]], results: list[list[str]], statuses: set[int]) -> threading.Thread:
    """Connects again and again in a thread until it succeeds once."""

    def loop() -> None:
        while not results:
            try:
                results.append(connect())
            except InvalidStatus as error:
                statuses.add(error.response.status_code)
            except urllib.error.HTTPError as error:
                statuses.add(error.code)
            except (OSError, InvalidMessage, EOFError):
                continue

    thread = threading.Thread(target=loop, daemon=True)
    thread.start()
    return thread


def test_the_first_client_of_the_page_finds_every_method() -> None:
    port, unknown, statuses = free_port(), list[list[str]](), set[int]()
    names: list[str] = []

    def ask_all() -> list[str]:
        with connect_page_client(f"http://127.0.0.1:{port}") as page:
            found = []
            for name in names or ["ping"]:
                try:
                    page.ask(name, nonsense=1)
                except RequestFailedError as error:
                    found += [name] if "there is no such method" in str(error) else []
            return found

    with ms.open("bundled:kitchen", engine="null") as simulation:
        with Viewer(simulation, port=0) as before:
            names += [each.name for each in before.channel.entry_points()]
        thread = first_success(ask_all, unknown, statuses)
        with Viewer(simulation, port=port):
            thread.join(120)
    assert len(names) > 60
    assert unknown == [[]]
    assert statuses <= {503}


def test_requests_to_a_page_that_starts_are_answered_with_503(monkeypatch: pytest.MonkeyPatch) -> None:
    port, statuses = free_port(), list[int]()
    create = threading.Thread.start

    def ask_first(thread: threading.Thread) -> None:
        if thread.name == "mindstage-viewer":  # the last thing that a viewer does before it is open
            with pytest.raises(urllib.error.HTTPError) as raised:
                urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=60)
            statuses.append(raised.value.code)
            assert raised.value.read() == b"starting\n"
        create(thread)

    with ms.open("bundled:kitchen", engine="null") as simulation:
        monkeypatch.setattr(threading.Thread, "start", ask_first)
        with Viewer(simulation, port=port), urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=60) as page:
            assert page.status == 200
    assert statuses == [503]


def test_a_client_of_the_rosbridge_finds_all_services_or_none() -> None:
    seen, began, stop = list[int](), threading.Event(), threading.Event()

    def count_services(url: str) -> None:
        while not stop.is_set():
            was_begun = began.is_set()
            with suppress(OSError, InvalidStatus, InvalidMessage, EOFError), closing(RawClient(url)) as client:
                answer = client.call_service("/rosapi/services")
                if began.is_set() and not was_begun:  # it may have connected before
                    continue
                seen.append(len(answer["values"]["services"]) if answer["result"] else 0)

    with (
        ms.open("bundled:kitchen", engine="null") as simulation,
        LocalNode() as node,
        RosbridgeServer(node, port=0) as server,
    ):
        clients = [threading.Thread(target=count_services, args=(server.url,), daemon=True) for _ in range(4)]
        for client in clients:
            client.start()
        began.set()
        with RosInterface(simulation, node) as interface:
            expected = len(interface.service_names)
            before = len(seen)
            threading.Event().wait(0.5)
            stop.set()
            for client in clients:
                client.join(60)
    assert expected > 60
    assert len(seen) > before
    assert set(seen) <= {0, max(seen)}
    assert max(seen) >= expected
