"""The page: time and size of updates, latency of edits, and the cost of ten clients for the simulation.

Clients are websockets in a process of their own that receive all messages without rendering them; `python -m
benchmarks.viewer URL COUNT` runs such a process, which prints the number of received bytes for each line on stdin.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np
import viser
from playwright.sync_api import Page, sync_playwright
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from benchmarks import Measure, median_runs
from mindstage import KnowledgeBase, MujocoEngine, NullEngine, Simulation
from mindstage.maps import bundled_kitchen
from mindstage.rendering.appearance import VisiblePart, visuals_to_glb
from mindstage.scene import Body, BodyId, BodyPhysics, Iri, Mobility, Pose, World
from mindstage.simulation import StateSnapshot
from mindstage.viewer import Viewer
from mindstage.viewer.scene import ViewerScene

UPDATES = 30
"""Number of measured updates, one second of them."""
FEW = 5
CLIENTS = 10
PAGE_REPEATS = 3
EDITS = 12
STEPPED_S = 4.0
"""Simulated time of a measurement [s]."""
_CLASSES = ("Cup", "Bowl", "DinnerPlate", "Box", "Table-PieceOfFurniture")


def measure() -> Iterator[Measure]:
    for alike, of_what in ((False, "all different"), (True, "of five shapes")):
        for count in (136, 500, 5000):
            yield from _updates(count, alike=alike, what=f"{count:,} bodies {of_what}")
    yield from _drawing(5000)
    yield _edit_latency()
    yield _cost_of_clients()
    yield _first_picture()
    yield from _compared_with_viser("bundled kitchen", bundled_kitchen())
    yield from _compared_with_viser("2,000 bodies of five shapes", _field(2000, alike=True))


def _updates(count: int, *, alike: bool, what: str) -> Iterator[Measure]:
    """The time and the size of updates with moving bodies."""
    with Simulation(KnowledgeBase(), NullEngine()) as simulation:
        simulation.spawn(_field(count, alike=alike), timeout_s=120.0)
        with Viewer(simulation, port=0) as viewer, _clients(viewer.url, 1) as received:
            _wait_until(lambda: len(viewer._scene.appearances) == count)
            viewer._closing.set()  # the benchmark itself updates the scene
            viewer._thread.join()
            for moving, which in ((FEW, f"{FEW} moving"), (count, "all moving")):
                seconds, sent = _moved(viewer, simulation.state.poses, moving, received)
                aim = 0.016 if count <= 500 else None
                yield Measure(
                    what=f"{what}, {which}: one update", ours=1000 * seconds, unit="ms", at_most=aim and 1000 * aim
                )
                yield Measure(what=f"{what}, {which}: size of an update", ours=sent / 1000, unit="kB")
            viewer._closing.clear()  # so that it can be closed


def _moved(viewer: Viewer, poses: np.ndarray, moving: int, received: _Received) -> tuple[float, float]:
    """The median time of an update [s], and its size [bytes]."""
    rows = np.linspace(0, len(poses) - 1, moving).astype(int)
    poses = poses.copy()
    received.settled()
    before, times, rng = received.count(), [], np.random.default_rng(0)
    for _ in range(UPDATES):
        poses[rows, :3] += 0.01 * rng.normal(size=(moving, 3))
        poses[rows, 3:] = rng.normal(size=(moving, 4))
        start = time.perf_counter()
        viewer._scene.move(poses)
        times.append(time.perf_counter() - start)
        received.settled(quick=True)  # otherwise superseded updates would not be sent
    return median(times), (received.settled() - before) / UPDATES


def _drawing(count: int) -> Iterator[Measure]:
    """The time until a spawned world can be displayed, and its size."""
    with Simulation(KnowledgeBase(), NullEngine()) as simulation:
        simulation.spawn(_field(count, alike=True), timeout_s=120.0)
        with Viewer(simulation, port=0) as viewer:
            start = time.perf_counter()
            _wait_until(lambda: len(viewer._scene.appearances) == count)
            yield Measure(
                what=f"{count:,} bodies of five shapes: prepared for display", ours=time.perf_counter() - start
            )
            with _clients(viewer.url, 1) as received:
                yield Measure(what="size of the scene", ours=received.settled() / 1e6, unit="MB")


def _edit_latency() -> Measure:
    """The time from an edit by one client until another client is notified, while the simulation plays."""
    knowledge = KnowledgeBase()
    knowledge.load([bundled_kitchen()])
    with Simulation(knowledge, MujocoEngine()) as simulation, Viewer(simulation, port=0) as viewer:
        mug = next(body.id for body in simulation.knowledge.world().bodies if "mug" in body.id)
        simulation.spawn()
        simulation.play()
        with _connect(viewer.url, 1) as one, _connect(viewer.url, 2) as other:
            times = []
            for turn in range(EDITS + 1):
                _drain(other)
                request = {"id": turn, "method": "set_physics", "params": {"id": mug, "mass_kg": 0.3 + 0.01 * turn}}
                start = time.perf_counter()
                one.send(json.dumps(request))
                while '"details_changed"' not in other.recv(timeout=60.0, decode=True):
                    pass
                times.append(time.perf_counter() - start)
    return Measure(
        what="edit by one client until another is notified", ours=1000 * median(times[1:]), unit="ms", at_most=200.0
    )


def _connect(url: str, number: int) -> ClientConnection:
    address = f"{url.replace('http', 'ws', 1)}/mindstage/channel?client=benchmark{number:04}"
    return connect(address, max_size=None)


def _drain(client: ClientConnection) -> None:
    """Receives pending messages for half a second."""
    end = time.monotonic() + 0.5
    while time.monotonic() < end:
        with suppress(TimeoutError):
            client.recv(timeout=0.05)


def _cost_of_clients() -> Measure:
    """The slow-down of the simulation with ten connected clients."""
    knowledge = KnowledgeBase()
    knowledge.load([bundled_kitchen()])
    with Simulation(knowledge, MujocoEngine()) as simulation, Viewer(simulation, port=0) as viewer:
        simulation.spawn()
        simulation.step(2.0)
        alone, connected = [], []
        for _ in range(5):
            alone.append(_stepped(simulation, knowledge.world()))
            with _clients(viewer.url, CLIENTS) as received:
                received.settled()
                connected.append(_stepped(simulation, knowledge.world()))
    return Measure(
        what=f"step the bundled kitchen with {CLIENTS} clients",
        ours=median(connected),
        peer="without clients",
        theirs=median(alone),
        at_most=1.10,
    )


def _stepped(simulation: Simulation, world: World) -> float:
    """The time of simulating while all handles are pulled back and forth, so that many bodies move [s]."""
    movable = {body.id for body in world.bodies if body.physics.is_dynamic}
    handles = [each.child for each in world.attachments if each.parent in movable]
    start = time.perf_counter()
    for offset in (0.3, -0.3, 0.3, -0.3):
        for handle in handles:
            x, y, z = world.body(handle).pose.position
            simulation.pull(handle, point=(0.0, 0.0, 0.0), target=(x + offset, y + offset, z))
        simulation.step(STEPPED_S / 4)
    simulation.release()
    return time.perf_counter() - start


def _first_picture() -> Measure:
    """The time of `mindstage shot`, compared with that of a page in a browser without a GPU."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "mindstage", "shot", bundled_kitchen(), "-o", Path(folder) / "kitchen.png"]
        (result,) = median_runs(list(map(str, command)), repeats=3)
    return Measure(
        what="mindstage shot bundled:kitchen",
        ours=result.seconds,
        peer="picture of an empty viser page",
        theirs=median(_empty_picture() for _ in range(3)),
        memory_mb=result.memory_mb,
    )


def _empty_picture() -> float:
    """The time of starting a server and a browser and taking a picture of an empty scene [s]."""
    start = time.perf_counter()
    with redirect_stdout(StringIO()):
        server = viser.ViserServer(port=0, verbose=False)
    try:
        with _browser_page((1280, 800)) as page:
            page.goto(f"http://127.0.0.1:{server.get_port()}/?fixedDpr=1")
            _wait_until(server.get_clients)
            page.screenshot()
    finally:
        with redirect_stdout(StringIO()):
            server.stop()
    return time.perf_counter() - start


@contextmanager
def _browser_page(size: tuple[int, int]) -> Iterator[Page]:
    """A page [px] in a new headless browser."""
    if (chromium := shutil.which("chromium")) is None:
        raise SystemExit("Chromium is not installed")
    arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=arguments)
        page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        page.set_default_timeout(300_000)
        yield page
        browser.close()


_VIEW = "(document.getElementById('view')?.contentWindow ?? window)"
_DRAWN = """(() => {
  const view = %s, names = view.__viserMutable?.nodeRefFromName ?? {};
  let count = 0;
  for (const name in names) {
    if (!/^[/](bodies|batches)[/]/.test(name)) continue;
    let drawn = 0;
    if (/[/]textured$/.test(name)) names[name]?.traverse((mesh) => {
      if (mesh.isMesh) drawn = Math.max(drawn, mesh.instancesCount ?? 1);
    });
    count += drawn;
  }
  return count;
})()"""
"""Number of bodies whose meshes exist in the page."""
_FRAMES = 9
_DRAW_FRAMES = """(async () => {
  const view = %s, state = view.__viserMutable.scene.__r3f.root.getState(), pixel = new Uint8Array(4);
  for (let turn = 0; turn < %d; turn++) {
    state.advance(performance.now());
    state.gl.getContext().readPixels(0, 0, 1, 1, 6408, 5121, pixel);
  }
})()"""
"""Draws frames one after the other, each until its pixels can be read."""


def _cpu_s() -> float:
    """The processor time of all processes below this one: other load on the machine does not count [s]."""
    children: dict[int, list[tuple[int, int]]] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = path.read_text().rpartition(")")[2].split()
            children.setdefault(int(fields[1]), []).append((int(path.parent.name), int(fields[11]) + int(fields[12])))
    total, waiting = 0, [os.getpid()]
    while waiting:
        for child, ticks in children.get(waiting.pop(), ()):
            total += ticks
            waiting.append(child)
    return total / os.sysconf("SC_CLK_TCK")


class _PageCost(NamedTuple):
    first_picture_s: float
    frame_ms: float
    heap_mb: float


def _compared_with_viser(what: str, content: str | World) -> Iterator[Measure]:
    """First picture, frame time and memory of the page, and of a viser page with the same meshes and lights."""
    knowledge = KnowledgeBase()
    world = content if isinstance(content, World) else None
    if world is None:
        knowledge.load([content])
    with Simulation(knowledge, NullEngine()) as simulation:
        simulation.spawn(world, timeout_s=120.0)
        with Viewer(simulation, port=0) as viewer:
            _wait_until(lambda: viewer.views.is_drawn)
            count = len([each for each in viewer._scene.appearances.values() if each.part is not VisiblePart.OUTLINE])
            bare = _bare_server(viewer, simulation.state)
            try:
                plain = f"http://127.0.0.1:{bare.get_port()}/"
                pairs = [
                    (
                        _page_cost(f"{viewer.url}/", f"{viewer.url}/view/{secrets.token_hex(8)}/", count),
                        _page_cost(plain, plain, count),
                    )
                    for _ in range(PAGE_REPEATS)
                ]
            finally:
                with redirect_stdout(StringIO()):
                    bare.stop()
    ours, theirs = (
        _PageCost(*(median(values) for values in zip(*side, strict=True))) for side in zip(*pairs, strict=True)
    )
    peer = f"viser {viser.__version__} with the same meshes and lights"
    for name, unit, aim, mine, other in (
        ("first picture", "s", 1.5, ours.first_picture_s, theirs.first_picture_s),
        ("processor time of a frame without a GPU", "ms", 1.2, ours.frame_ms, theirs.frame_ms),
        ("JavaScript heap of the tab", "MB", 1.5, ours.heap_mb, theirs.heap_mb),
    ):
        yield Measure(what=f"{what}: {name}", ours=mine, unit=unit, peer=peer, theirs=other, at_most=aim)


def _bare_server(viewer: Viewer, state: StateSnapshot) -> viser.ViserServer:
    """A server of viser with one node for each body, and with the lights and the camera of the viewer."""
    with redirect_stdout(StringIO()):
        server = viser.ViserServer(port=0, verbose=False)
    ViewerScene(server, on_node=lambda node, pick, *, draggable: None, has_scripts=False)  # the lights
    rows = dict(zip(state.ids, state.poses, strict=True))
    with server.atomic():
        for number, (id, appearance) in enumerate(viewer._scene.appearances.items()):
            if appearance.part is not VisiblePart.OUTLINE:
                content = visuals_to_glb(appearance.visuals)
                name = f"/bodies/{number}/textured"
                server.scene.add_glb(name, content, position=rows[id][:3], wxyz=rows[id][3:])
    camera = viewer._server.initial_camera
    server.initial_camera.position, server.initial_camera.look_at = camera.position, camera.look_at
    server.initial_camera.fov = camera.fov
    return server


def _page_cost(page: str, view: str, count: int) -> _PageCost:
    """The cost of a page, and the time of a frame of its view alone, which has the size of the window."""
    with _browser_page((640, 420)) as tab:
        start = time.perf_counter()
        _open(tab, page, count)
        first_picture_s = time.perf_counter() - start
        devtools = tab.context.new_cdp_session(tab)
        devtools.send("HeapProfiler.collectGarbage")
        devtools.send("Performance.enable")
        metrics = {each["name"]: each["value"] for each in devtools.send("Performance.getMetrics")["metrics"]}
        if view != page:
            _open(tab, view, count)
        before = _cpu_s()
        tab.evaluate(_DRAW_FRAMES % (_VIEW, _FRAMES))
        frame_ms = 1000 * (_cpu_s() - before) / _FRAMES
    return _PageCost(first_picture_s, frame_ms, metrics["JSHeapUsedSize"] / 1e6)


def _open(tab: Page, url: str, count: int) -> None:
    """Opens a page and waits until all bodies are drawn."""
    tab.goto(f"{url}?fixedDpr=1")
    _wait_until(lambda: tab.evaluate(_DRAWN % _VIEW) >= count, timeout_s=300.0)
    tab.screenshot()


def _field(count: int, *, alike: bool) -> World:
    """Bodies of five classes on a grid; with `alike` all bodies of a class have the same size."""
    side = int(np.ceil(np.sqrt(count)))
    bodies = []
    for number in range(count):
        row, column = divmod(number, side)
        cls = Iri(f"http://knowrob.org/kb/knowrob.owl#{_CLASSES[number % len(_CLASSES)]}")
        extent = 0.2 if alike else 0.2 + 0.1 * number / count
        bodies.append(
            Body(
                id=BodyId(f"body{number}"),
                iri=Iri(f"http://example.org/field.owl#body{number}"),
                cls=cls,
                pose=Pose((float(row), float(column), 0.2)),
                size=(extent, extent, extent),
                physics=BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=1.0),
            )
        )
    return World(iri=Iri("http://example.org/field.owl#map"), bodies=tuple(bodies))


def _wait_until(condition: object, timeout_s: float = 120.0) -> None:
    end = time.monotonic() + timeout_s
    while not condition():  # type: ignore[operator]
        if time.monotonic() > end:
            raise TimeoutError(f"the condition is not true after {timeout_s:g} s")
        time.sleep(0.005)


# -- clients -----------------------------------------------------------------------------------------------------------


class _Received:
    """The number of bytes that the clients received."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def count(self) -> int:
        """The number until now."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(file=self._process.stdin, flush=True)
        return int(self._process.stdout.readline())

    def settled(self, *, quick: bool = False) -> int:
        """The number when no more bytes arrive for a while."""
        last, pause = -1, 0.03 if quick else 0.5
        while (now := self.count()) != last:
            last = now
            time.sleep(pause)
        return now


@contextmanager
def _clients(url: str, count: int) -> Iterator[_Received]:
    command = [sys.executable, "-m", "benchmarks.viewer", url, str(count)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield _Received(process)
        finally:
            process.kill()


def _run_clients(url: str, count: int) -> None:
    received = [0] * count

    def receive(number: int) -> None:
        address = f"{url.replace('http', 'ws', 1)}/view/benchmark{number:04}/"
        subprotocol = Subprotocol(f"viser-v{viser.__version__}")
        with connect(address, subprotocols=[subprotocol], max_size=None) as socket:
            try:
                while True:
                    received[number] += len(socket.recv())
            except ConnectionClosed:
                return

    for number in range(count):
        threading.Thread(target=receive, args=[number], daemon=True).start()
    for _ in sys.stdin:
        print(sum(received), flush=True)


if __name__ == "__main__":
    _run_clients(sys.argv[1], int(sys.argv[2]))
