"""Episodes: size of files against a plain rosbag of all transforms, cost of recording, time of seeking."""

from __future__ import annotations

import math
import os
import random
import shutil
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from rosbags.rosbag2 import CompressionFormat, CompressionMode, Writer
from rosbags.typesys import Stores, get_typestore

import mindstage as ms
from benchmarks import Measure
from mindstage.engines import Engine
from mindstage.episodes import recorder as recording
from mindstage.episodes.episode import Episode
from mindstage.episodes.recorder import Recorder
from mindstage.scene import BodyId, Pose
from mindstage.scene.edits import SetPoses
from mindstage.simulation import Simulation

_RATE_HZ = 30.0
_MINUTES = float(os.environ.get("MINDSTAGE_EPISODE_MINUTES", "10"))


def measure() -> Iterator[Measure]:
    with TemporaryDirectory() as folder:
        yield from _sizes(Path(folder))
    with TemporaryDirectory() as folder:
        yield from _seeking(Path(folder))
        yield from _cost(Path(folder))


class _Movers:
    """Pulls bodies around in circles."""

    def __init__(self, simulation: Simulation, count: int) -> None:
        world = simulation.snapshot()
        parents = {each.child for each in world.attachments} | {each.child for each in world.joints}
        loose = [
            body.id for body in world.bodies
            if body.physics.is_dynamic and body.id not in parents and body.id not in simulation.immovable
        ]  # fmt: skip
        self._simulation = simulation
        self._homes = {id: simulation.state.poses[simulation.state.ids.index(id), :3].copy() for id in loose[:count]}

    def step(self, number: int) -> None:
        for id, (x, y, z) in self._homes.items():
            angle = number / 15
            target = (float(x) + 0.1 * math.cos(angle), float(y) + 0.1 * math.sin(angle), float(z) + 0.02)
            self._simulation.pull(BodyId(id), point=(0.0, 0.0, 0.0), target=target)
        self._simulation.step(1 / _RATE_HZ)


def _record(path: Path, *, movers: int, seconds: float, bags: Sequence[_PlainBag] = ()) -> None:
    with ms.open("bundled:kitchen") as simulation:
        simulation.step(3.0)
        moved = _Movers(simulation, movers)
        with Recorder(simulation, path):
            for number in range(round(seconds * _RATE_HZ)):
                moved.step(number)
                for bag in bags:
                    bag.add(simulation)
        for bag in bags:
            bag.close()


class _PlainBag:
    """What `ros2 bag record /tf` writes: every transform in every frame."""

    def __init__(self, path: Path, *, compressed: bool) -> None:
        self._types = get_typestore(Stores.ROS2_HUMBLE)
        self._writer = Writer(path, version=9)
        if compressed:
            self._writer.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
        self._writer.open()
        self._tf = self._writer.add_connection("/tf", "tf2_msgs/msg/TFMessage", typestore=self._types)

    def add(self, simulation: Simulation) -> None:
        types: Any = self._types.types
        state = simulation.state
        time_ns = round(state.time_s * 1e9)
        stamp = types["builtin_interfaces/msg/Time"](sec=time_ns // 10**9, nanosec=time_ns % 10**9)
        header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="world")
        transforms = []
        for id, (x, y, z, w, i, j, k) in zip(state.ids, state.poses.tolist(), strict=True):
            moved = types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)
            turned = types["geometry_msgs/msg/Quaternion"](x=i, y=j, z=k, w=w)
            transform = types["geometry_msgs/msg/Transform"](translation=moved, rotation=turned)
            each = types["geometry_msgs/msg/TransformStamped"](header=header, child_frame_id=id, transform=transform)
            transforms.append(each)
        message = types["tf2_msgs/msg/TFMessage"](transforms=transforms)
        self._writer.write(self._tf, time_ns, self._types.serialize_cdr(message, "tf2_msgs/msg/TFMessage"))

    def close(self) -> None:
        self._writer.close()


def _size_mb(path: Path) -> float:
    files = [path] if path.is_file() else [each for each in path.rglob("*") if each.is_file()]
    return sum(each.stat().st_size for each in files) / 1e6


def _sizes(folder: Path) -> Iterator[Measure]:
    _record(folder / "long.mcap", movers=1, seconds=60 * _MINUTES)
    what = f"{_MINUTES:g} minutes of the kitchen at 30 Hz, one mover"
    yield Measure(what=what, ours=_size_mb(folder / "long.mcap"), unit="MB", at_most=5.0 * max(1.0, _MINUTES / 10))
    for movers in (1, 50):
        path, plain, compressed = folder / f"{movers}.mcap", folder / f"plain{movers}", folder / f"zstd{movers}"
        bags = (_PlainBag(plain, compressed=False), _PlainBag(compressed, compressed=True))
        _record(path, movers=movers, seconds=60.0, bags=bags)
        what = f"a minute of the kitchen with {movers} movers"
        for bag, peer in ((plain, "rosbags, /tf of all bodies"), (compressed, "the same, compressed as one piece")):
            yield Measure(what=what, ours=_size_mb(path), unit="MB", theirs=_size_mb(bag), peer=peer)
            shutil.rmtree(bag)


def _seeking(folder: Path) -> Iterator[Measure]:
    """The time to read the state at a random time, from a file that was just opened."""

    def seek_ms(path: Path) -> float:
        times = []
        generator = random.Random(1)
        for _ in range(15):
            with Episode(path) as episode:
                at = generator.uniform(0.5, 1.0) * episode.end_s
                begin = time.perf_counter()
                episode.frame_at(at).world()
                times.append(1000 * (time.perf_counter() - begin))
        return median(times)

    short, long = folder / "short.mcap", folder / "long.mcap"
    _record_circle(short, seconds=60.0)
    _record_circle(long, seconds=600.0)
    ours, theirs = seek_ms(long), seek_ms(short)
    yield Measure(what="seek in 10 minutes", ours=ours, unit="ms", theirs=theirs, peer="in one minute", at_most=1.5)


def _record_circle(path: Path, *, seconds: float) -> None:
    """A carton of the kitchen on a circle, without physics, so that all minutes have the same content."""
    with ms.open("bundled:kitchen", engine="null") as simulation, Recorder(simulation, path, events=False):
        for number in range(round(seconds * _RATE_HZ)):
            pose = Pose((math.cos(number / 15), math.sin(number / 15), 1.0))
            simulation.engine.run(partial(_set_pose, pose=pose))
            simulation.step(1 / _RATE_HZ)


def _set_pose(engine: Engine, *, pose: Pose) -> None:
    engine.apply(SetPoses({BodyId("milk_carton_1"): pose}))


def _cost(folder: Path) -> Iterator[Measure]:
    """The processor time of recording against real time: in the process of the simulation, and in that of the events.

    It is measured by thread, since wall time, and the time of the steps, are too noisy.
    """
    for movers, at_most in ((0, 2.0), (10, 2.0), (50, 5.0)):
        here, beside, loop = _cost_shares(folder / f"{movers}.mcap", movers)
        what = f"cost of recording with {movers} movers, of real time"
        yield Measure(what=f"{what}, in the simulating process", ours=100 * here, unit="%", at_most=at_most)
        yield Measure(what=f"{what}, in the process that detects events", ours=100 * beside, unit="%")
        yield Measure(
            what=f"{what}, against the simulation", ours=100 * here, unit="%", theirs=100 * loop, peer="steps"
        )


def _cost_shares(path: Path, movers: int, *, frames: int = 900) -> tuple[float, float, float]:
    """The processor times of recording here, of the detection of events, and of all else here, by simulated time."""
    observed_s = 0.0
    on_state = Recorder.on_state

    def timed_state(self: Recorder, *args: Any, **options: Any) -> None:
        nonlocal observed_s
        begin = time.thread_time()
        on_state(self, *args, **options)
        observed_s += time.thread_time() - begin

    with ms.open("bundled:kitchen") as simulation:
        simulation.step(3.0)
        moved = _Movers(simulation, movers)
        with Recorder(simulation, path) as recorder:
            recorder.flush()
            assert recorder._cpu_clock is not None
            assert recorder._detection is not None
            assert recorder._detection._interpreter is not None
            pid = recorder._detection._interpreter.process.pid
            clocks = (recorder._cpu_clock, (~pid << 3) | 2)  # of the thread that writes, and of a process (Linux)
            recording.Recorder.on_state = timed_state  # type: ignore[method-assign]
            try:
                before = (time.process_time(), *map(time.clock_gettime, clocks))
                for number in range(frames):
                    moved.step(number)
                recorder.flush()
                after = (time.process_time(), *map(time.clock_gettime, clocks))
            finally:
                recording.Recorder.on_state = on_state  # type: ignore[method-assign]
    whole, writing, beside = (end - begin for begin, end in zip(before, after, strict=True))
    here, time_s = observed_s + writing, frames / _RATE_HZ
    return here / time_s, beside / time_s, (whole - here) / time_s
