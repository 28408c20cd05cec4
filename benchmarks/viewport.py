"""The view in the browser: what an update costs, in time and on the wire, and what ten visitors cost the world.

Visitors are websockets in a process of their own that take all that comes and draw nothing; `python -m
benchmarks.viewport URL COUNT` is such a process, which prints how many bytes it took whenever it reads a line.
"""

from __future__ import annotations

import json
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

import numpy as np
import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from benchmarks import Measure, median_runs
from mindstage import KnowledgeBase, MujocoEngine, NullEngine, Simulation
from mindstage.knowledge import bundled_kitchen
from mindstage.scene import Body, BodyId, BodyPhysics, Iri, Mobility, Pose, World
from mindstage.viewer import Viewer
from mindstage.viewer.screenshot import HeadlessBrowser

UPDATES = 30
"""A second of them."""
FEW = 5
VISITORS = 10
EDITS = 12
STEPPED_S = 4.0
"""So much of the world's time is stepped at once."""
_CLASSES = ("Cup", "Bowl", "DinnerPlate", "Box", "Table-PieceOfFurniture")


def measure() -> Iterator[Measure]:
    for alike, of_what in ((False, "all different"), (True, "of five kinds")):
        for count in (136, 500, 5000):
            yield from _updates(count, alike=alike, what=f"{count:,} bodies {of_what}")
    yield from _drawing(5000)
    yield _edit_seen_by_another()
    yield _cost_of_visitors()
    yield _first_picture()


def _updates(count: int, *, alike: bool, what: str) -> Iterator[Measure]:
    """What moving bodies costs until it is on the wire, and how much that is."""
    with Simulation(KnowledgeBase(), NullEngine()) as stage:
        stage.spawn(_field(count, alike=alike), timeout_s=120.0)
        with Viewer(stage, port=0) as viewport, _visitors(viewport.url, 1) as taken:
            _wait_until(lambda: len(viewport._scene.appearances) == count)
            viewport._closing.set()  # from now on we move what is seen ourselves
            viewport._thread.join()
            for moving, who in ((FEW, f"{FEW} moving"), (count, "all moving")):
                seconds, sent = _moved(viewport, stage.state.poses, moving, taken)
                aim = 1 / 30 if count <= 500 else None
                yield Measure(
                    what=f"{what}, {who}: one update", ours=1000 * seconds, unit="ms", at_most=aim and 1000 * aim
                )
                yield Measure(what=f"{what}, {who}: on the wire", ours=sent / 1000, unit="kB")
            viewport._closing.clear()  # so that it can be closed


def _moved(viewport: Viewer, poses: np.ndarray, moving: int, taken: _Taken) -> tuple[float, float]:
    """The median time of an update [s], and its bytes."""
    rows = np.linspace(0, len(poses) - 1, moving).astype(int)
    poses = poses.copy()
    taken.settled()
    before, times, chance = taken.count(), [], np.random.default_rng(0)
    for _ in range(UPDATES):
        poses[rows, :3] += 0.01 * chance.normal(size=(moving, 3))
        poses[rows, 3:] = chance.normal(size=(moving, 4))
        start = time.perf_counter()
        viewport._scene.move(poses)
        times.append(time.perf_counter() - start)
        taken.settled(quick=True)  # else what is overtaken by what is newer would never be sent
    return median(times), (taken.settled() - before) / UPDATES


def _drawing(count: int) -> Iterator[Measure]:
    """From a spawned world to the last byte of its picture."""
    with Simulation(KnowledgeBase(), NullEngine()) as stage:
        stage.spawn(_field(count, alike=True), timeout_s=120.0)
        with Viewer(stage, port=0) as viewport:
            start = time.perf_counter()
            _wait_until(lambda: len(viewport._scene.appearances) == count)
            yield Measure(what=f"{count:,} bodies of five kinds: ready to be seen", ours=time.perf_counter() - start)
            with _visitors(viewport.url, 1) as taken:
                yield Measure(what="the whole of it on the wire", ours=taken.settled() / 1e6, unit="MB")


def _edit_seen_by_another() -> Measure:
    """From one visitor's edit of the kitchen until another one is told, while time passes."""
    knowledge = KnowledgeBase()
    knowledge.load([bundled_kitchen()])
    with Simulation(knowledge, MujocoEngine()) as stage, Viewer(stage, port=0) as viewport:
        mug = next(body.id for body in stage.knowledge.world().bodies if "mug" in body.id)
        stage.spawn()
        stage.play()
        with _guest(viewport.url, 1) as one, _guest(viewport.url, 2) as other:
            times = []
            for turn in range(EDITS + 1):
                _hear(other)
                request = {"id": turn, "method": "set_physics", "params": {"id": mug, "mass_kg": 0.3 + 0.01 * turn}}
                start = time.perf_counter()
                one.send(json.dumps(request))
                while '"details_changed"' not in other.recv(timeout=60.0, decode=True):
                    pass
                times.append(time.perf_counter() - start)
    return Measure(
        what="one visitor's edit until another is told", ours=1000 * median(times[1:]), unit="ms", at_most=200.0
    )


def _guest(url: str, number: int) -> ClientConnection:
    address = f"{url.replace('http', 'ws', 1)}/mindstage/channel?client=benchmark{number:04}"
    return connect(address, max_size=None)


def _hear(guest: ClientConnection) -> None:
    """Takes all that has come so far, until nothing but the clock ticks."""
    end = time.monotonic() + 0.5
    while time.monotonic() < end:
        with suppress(TimeoutError):
            guest.recv(timeout=0.05)


def _cost_of_visitors() -> Measure:
    """How much longer the kitchen's world takes to be stepped while ten watch."""
    knowledge = KnowledgeBase()
    knowledge.load([bundled_kitchen()])
    with Simulation(knowledge, MujocoEngine()) as stage, Viewer(stage, port=0) as viewport:
        stage.spawn()
        stage.step(2.0)
        alone, watched = [], []
        for _ in range(5):
            alone.append(_stepped(stage, knowledge.world()))
            with _visitors(viewport.url, VISITORS) as taken:
                taken.settled()
                watched.append(_stepped(stage, knowledge.world()))
    return Measure(
        what=f"stepping the bundled kitchen with {VISITORS} visitors",
        ours=median(watched),
        peer="nobody looking",
        theirs=median(alone),
        at_most=1.10,
    )


def _stepped(stage: Simulation, world: World) -> float:
    """How long the world takes while all of its handles are pulled to and fro, so that much is seen to move [s]."""
    movable = {body.id for body in world.bodies if body.physics.is_dynamic}
    handles = [hold.child for hold in world.attachments if hold.parent in movable]
    start = time.perf_counter()
    for way in (0.3, -0.3, 0.3, -0.3):
        for handle in handles:
            x, y, z = world.body(handle).pose.position
            stage.pull(handle, point=(0.0, 0.0, 0.0), target=(x + way, y + way, z))
        stage.step(STEPPED_S / 4)
    stage.release()
    return time.perf_counter() - start


def _first_picture() -> Measure:
    """From a command in the shell to a picture of the kitchen, through a browser without a GPU."""
    if shutil.which("chromium") is None:
        raise SystemExit("no chromium: install it, or leave this benchmark out")
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "mindstage", "shot", bundled_kitchen(), "-o", Path(folder) / "kitchen.png"]
        (taken,) = median_runs(list(map(str, command)), repeats=3)
    return Measure(
        what="from the command to a picture of the kitchen",
        ours=taken.seconds,
        peer="the same browser's picture of viser's page with nothing in it",
        theirs=median(_empty_picture() for _ in range(3)),
        memory_mb=taken.memory_mb,
    )


def _empty_picture() -> float:
    """From starting a server and a browser to a picture of an empty scene [s]."""
    start = time.perf_counter()
    with redirect_stdout(StringIO()):
        server = viser.ViserServer(port=0, verbose=False)
    try:
        with HeadlessBrowser(size=(1280, 800)) as browser:
            browser.navigate(f"http://127.0.0.1:{server.get_port()}/?fixedDpr=1")
            _wait_until(server.get_clients)
            browser.screenshot()
    finally:
        with redirect_stdout(StringIO()):
            server.stop()
    return time.perf_counter() - start


def _field(count: int, *, alike: bool) -> World:
    """Things of five kinds on a grid; each of a size of its own, or all of a kind of the same."""
    side = int(np.ceil(np.sqrt(count)))
    bodies = []
    for number in range(count):
        row, column = divmod(number, side)
        cls = Iri(f"http://knowrob.org/kb/knowrob.owl#{_CLASSES[number % len(_CLASSES)]}")
        extent = 0.2 if alike else 0.2 + 0.1 * number / count
        bodies.append(
            Body(
                id=BodyId(f"thing{number}"),
                iri=Iri(f"http://example.org/field.owl#thing{number}"),
                cls=cls,
                pose=Pose((float(row), float(column), 0.2)),
                size=(extent, extent, extent),
                physics=BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=1.0),
            )
        )
    return World(iri=Iri("http://example.org/field.owl#map"), bodies=tuple(bodies))


def _wait_until(condition: object, patience_s: float = 120.0) -> None:
    end = time.monotonic() + patience_s
    while not condition():  # type: ignore[operator]
        if time.monotonic() > end:
            raise TimeoutError(f"not so after {patience_s:g} s")
        time.sleep(0.005)


# -- visitors ----------------------------------------------------------------------------------------------------------


class _Taken:
    """What the visitors have taken."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def count(self) -> int:
        """So many bytes until now."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(file=self._process.stdin, flush=True)
        return int(self._process.stdout.readline())

    def settled(self, *, quick: bool = False) -> int:
        """So many, once nothing more has come for a while."""
        last, pause = -1, 0.03 if quick else 0.5
        while (now := self.count()) != last:
            last = now
            time.sleep(pause)
        return now


@contextmanager
def _visitors(url: str, count: int) -> Iterator[_Taken]:
    command = [sys.executable, "-m", "benchmarks.viewport", url, str(count)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield _Taken(process)
        finally:
            process.kill()


def _visit(url: str, count: int) -> None:
    taken = [0] * count

    def watch(number: int) -> None:
        address = f"{url.replace('http', 'ws', 1)}/view/benchmark{number:04}/"
        subprotocol = Subprotocol(f"viser-v{viser.__version__}")
        with connect(address, subprotocols=[subprotocol], max_size=None) as socket:
            try:
                while True:
                    taken[number] += len(socket.recv())
            except ConnectionClosed:
                return

    for number in range(count):
        threading.Thread(target=watch, args=[number], daemon=True).start()
    for _ in sys.stdin:
        print(sum(taken), flush=True)


if __name__ == "__main__":
    _visit(sys.argv[1], int(sys.argv[2]))
