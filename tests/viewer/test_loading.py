"""What a page shows while its meshes arrive over a slow connection, and how often the sun's shadows are drawn."""

from __future__ import annotations

import secrets
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, BinaryIO

import pytest

from mindstage import Simulation
from mindstage.scene import Pose
from mindstage.viewer import Viewer
from tests.viewer.view_tab import SIZE, ViewTab, open_views
from tests.viewer.waiting import becomes_true, wait_until

_FRAME_S = 3.0
"""Time for which a page under load may process a frame."""
_STATE = "window.mindstageView?.placeholders?.state ?? null"
_COUNT_SHADOWS = """() => {
  const lights = __viserMutable.scene.children.filter((each) => each.isDirectionalLight && each.visible);
  const { shadow } = lights[0], update = shadow.updateMatrices;
  window.drawnShadows = 0;
  shadow.updateMatrices = (...values) => { window.drawnShadows += 1; update(...values); };
  return [lights.length, lights[0].intensity];
}"""
_DRAW = """(count) => {
  for (let frame = 0; frame < count; frame++) __viserMutable.scene.__r3f.root.getState().advance(performance.now());
  return window.drawnShadows;
}"""


class _Gate:
    """A connection to a server that forwards only as many frames of websockets as it is allowed to."""

    def __init__(self, listener: socket.socket, port: int) -> None:
        self._listener, self._port = listener, port
        self._allowed = threading.Semaphore(0)
        self._is_open = threading.Event()
        self.port = int(listener.getsockname()[1])
        threading.Thread(target=self._accept, daemon=True).start()

    def allow(self) -> None:
        """Lets a further frame pass."""
        self._allowed.release()

    def open(self) -> None:
        """Lets everything pass."""
        self._is_open.set()
        self._allowed.release()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                server = socket.create_connection(("127.0.0.1", self._port))
                threading.Thread(target=self._serve, args=(client, server), daemon=True).start()

    def _serve(self, client: socket.socket, server: socket.socket) -> None:
        with suppress(OSError), client, server:
            first = client.recv(65536)
            server.sendall(first)
            threading.Thread(target=_forward, args=(client, server), daemon=True).start()
            if b"upgrade: websocket" not in first.lower():
                _forward(server, client)
                return
            with server.makefile("rb") as reader:
                while (line := reader.readline()) != b"\r\n":
                    client.sendall(line)
                client.sendall(line)
                while frame := _read_frame(reader):
                    if not self._is_open.is_set():
                        self._allowed.acquire()
                    client.sendall(frame)


def _read_frame(reader: BinaryIO) -> bytes:
    """Returns a frame from a server, which is not masked (RFC 6455, section 5.2); nothing at the end."""
    head = reader.read(2)
    if len(head) < 2:
        return b""
    length = head[1] & 0x7F
    extended = reader.read({126: 2, 127: 8}.get(length, 0))
    return head + extended + reader.read(int.from_bytes(extended) if extended else length)


def _forward(source: socket.socket, target: socket.socket) -> None:
    with suppress(OSError):
        while part := source.recv(65536):
            target.sendall(part)


@contextmanager
def _gate(viewer: Viewer) -> Iterator[_Gate]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        gate = _Gate(listener, int(viewer.url.rpartition(":")[2]))
        try:
            yield gate
        finally:
            gate.open()


def test_boxes_are_shown_until_the_meshes_have_arrived(viewer: Viewer, browser: Any) -> None:
    wait_until(lambda: viewer.views.is_drawn, "the scene exists")
    page = browser.new_page(viewport=SIZE)
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    with _gate(viewer) as gate:
        page.goto(f"http://127.0.0.1:{gate.port}/view/{secrets.token_hex(8)}/?fixedDpr=1")

        def has_boxes() -> bool:
            state = page.evaluate(_STATE)
            return bool(state and state["count"])

        def has_boxes_after_a_frame() -> bool:
            gate.allow()
            return becomes_true(has_boxes, timeout_s=_FRAME_S)

        wait_until(has_boxes_after_a_frame, "the boxes have arrived")
        state = page.evaluate(_STATE)
        assert state["count"] == 8, "there is one for each body"
        assert state["loaded"] < 4, "most meshes are not there"
        wait_until(lambda: page.evaluate(_STATE)["isDrawn"], "the boxes are drawn")
        progress = page.locator(".mindstage-loading")

        def names_progress() -> bool:
            page.evaluate("__viserMutable.requestRender()")
            return progress.is_visible() and "of 8" in progress.inner_text()

        wait_until(names_progress, "the page says how far it is")
        nodes = "['Fridge', 'Mug'].map((name) => window.__viserMutable.nodePoseData[`/bodies/${name}`]?.position)"
        assert page.evaluate(nodes) == [pytest.approx([2.0, 1.0, 0.9]), pytest.approx([2.0, 0.0, 0.85])]
        gate.open()
        wait_until(lambda: page.evaluate(_STATE)["loaded"] == 8, "the meshes are there")
        wait_until(lambda: not page.evaluate(_STATE)["isDrawn"], "the boxes are removed")
        wait_until(lambda: not progress.is_visible(), "the progress is hidden")
    page.close()
    assert errors == []


@pytest.fixture
def open_view(browser: Any) -> Iterator[Callable[[Viewer], ViewTab]]:
    with open_views(browser) as open_view:
        yield open_view


def test_shadows_are_drawn_again_only_if_something_has_changed(
    simulation: Simulation, viewer: Viewer, open_view: Callable[[Viewer], ViewTab]
) -> None:
    ann = open_view(viewer)
    ann.wait_for("/bodies/Mug/textured")
    wait_until(lambda: ann.page.evaluate(f"({_STATE}).loaded") == 8, "all meshes are there")
    count, intensity = ann.page.evaluate(_COUNT_SHADOWS)
    assert (count, intensity) == (1, pytest.approx(2.3, abs=0.01)), "one light has the intensity of all"

    def is_idle() -> bool:
        before = ann.page.evaluate(_DRAW, 1)
        ann.page.wait_for_timeout(600)
        return bool(ann.page.evaluate(_DRAW, 2) == before)

    wait_until(is_idle, "nothing changes")
    drawn = ann.page.evaluate("window.drawnShadows")
    ann.page.mouse.move(320, 60)
    ann.page.mouse.wheel(0, 120)
    ann.page.wait_for_timeout(300)
    assert ann.page.evaluate(_DRAW, 2) == drawn, "the shadow map does not depend on the camera"
    simulation.edits.move("Mug", Pose((1.9, 0.1, 0.85)))  # type: ignore[arg-type]
    wait_until(lambda: ann.page.evaluate(_DRAW, 1) > drawn, "the shadow of the mug has moved")
