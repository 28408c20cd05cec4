"""Pictures of a map and its shapes, against a bare MuJoCo renderer and against trimesh with the same meshes.

`python -m benchmarks.pictures MODEL PICTURE` is the peer of `mindstage shot`: it loads a model with the visual meshes,
materials and textures of the map, which `mindstage convert` has written before, and renders it with `mujoco.Renderer`,
with shadows and in the same size. It neither reads a map nor builds a shape, so that the ratio contains both.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from statistics import median

from benchmarks import Measure, median_runs, median_s

SIZE = (1280, 800)
REPEATS = 5
_EMPTY_CACHE_REPEATS = 3
_MUJOCO = f"mujoco.Renderer of mujoco {version('mujoco')}"


def measure() -> Iterator[Measure]:
    with tempfile.TemporaryDirectory() as folder:
        yield from _whole_processes(Path(folder))
        yield from _rendering(Path(folder))
        yield from _cameras(Path(folder))
        yield from _shapes(Path(folder))


def _shot(picture: Path) -> list[str]:
    return [sys.executable, "-m", "mindstage", "shot", "bundled:kitchen", "-o", str(picture)]


def _whole_processes(folder: Path) -> Iterator[Measure]:
    """From the start of the process to the file."""
    from benchmarks import run

    model = folder / "kitchen.xml"
    run([sys.executable, "-m", "mindstage", "convert", "bundled:kitchen", str(model)])
    peer = [sys.executable, "-m", "benchmarks.pictures", str(model), str(folder / "peer.png")]
    ours, theirs = median_runs(_shot(folder / "ours.png"), peer, repeats=REPEATS)
    yield Measure(
        what="shot of the bundled kitchen, 254 bodies, 1280 x 800: whole process",
        ours=ours.seconds,
        peer=f"{_MUJOCO}, of a model that was compiled before",
        theirs=theirs.seconds,
        memory_mb=ours.memory_mb,
        their_memory_mb=theirs.memory_mb,
    )
    first = []
    for number in range(_EMPTY_CACHE_REPEATS):
        os.environ["MINDSTAGE_CACHE"] = str(folder / f"cache {number}")
        try:
            first.append(run(_shot(folder / "ours.png")).seconds)
        finally:
            del os.environ["MINDSTAGE_CACHE"]
    yield Measure(what="the same with an empty cache", ours=median(first))


def _rendering(folder: Path) -> Iterator[Measure]:
    """A picture of what is in memory, with a context and buffers of its own."""
    import mindstage as ms
    from mindstage.pictures import simulation_scene
    from mindstage.rendering import Screenshot
    from mindstage.rendering.rasterizer import render_picture

    with ms.open("bundled:kitchen", engine="null") as sim:
        scene = simulation_scene(sim, Screenshot(size=SIZE))
        ours = median_s(lambda: render_picture(scene, SIZE), repeats=REPEATS)
    theirs = median(_peer_renders(folder / "kitchen.xml", REPEATS))
    yield Measure(
        what="rendering of the bundled kitchen, 1280 x 800", ours=ours, peer=_MUJOCO, theirs=theirs, at_most=2.0
    )


def _cameras(folder: Path) -> Iterator[Measure]:
    """Images of a camera, of which the meshes are uploaded, by CPU time: OpenGL in software uses all cores."""
    os.environ.setdefault("MUJOCO_GL", "egl")
    import mujoco
    import numpy as np

    import mindstage as ms
    from mindstage.scene.transforms import quaternion_from_matrix

    eye, middle = np.array([1.5, -0.6, 1.6]), np.array([-0.5, 1.5, 0.8])
    away = middle - eye
    right = np.cross(away, [0.0, 0.0, 1.0])
    axes = [each / np.linalg.norm(each) for each in (right, np.cross(away, right), away)]
    path, distance = folder / "cameras.xml", float(np.linalg.norm(away))
    with ms.open("bundled:kitchen") as sim:
        sim.save(path)
        camera = sim.add_camera("benchmark", at=[*eye, *quaternion_from_matrix(np.stack(axes, axis=1))])
        camera.capture()
        model = mujoco.MjModel.from_xml_path(str(path))
        data, view = mujoco.MjData(model), mujoco.MjvCamera()
        mujoco.mj_forward(model, data)
        view.lookat[:], view.distance = middle, distance
        view.azimuth, view.elevation = np.degrees([np.arctan2(away[1], away[0]), np.arcsin(away[2] / distance)])
        renderer = mujoco.Renderer(model, 480, 640)

        def peer() -> None:
            renderer.update_scene(data, view)
            renderer.render()

        what = "of a camera in the bundled kitchen, 640 x 480, CPU time"
        yield Measure(what=f"color {what}", ours=_cpu_s(camera.rgb), peer=_MUJOCO, theirs=_cpu_s(peer), at_most=1.2)
        renderer.enable_depth_rendering()
        depth_s = _cpu_s(peer)
        renderer.disable_depth_rendering()
        renderer.enable_segmentation_rendering()
        both = f"{_MUJOCO}, depth and segmentation"
        yield Measure(what=f"depth and ids {what}", ours=_cpu_s(camera.depth), peer=both, theirs=depth_s + _cpu_s(peer))
        renderer.close()


def _cpu_s(function: Callable[[], object]) -> float:
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        function()
        times.append(time.process_time() - start)
    return median(times)


def _shapes(folder: Path) -> Iterator[Measure]:
    """Visual meshes of all shapes of the kitchen: stored ones, and built ones."""
    import trimesh

    import mindstage as ms
    from mindstage.geometry.procedural import build
    from mindstage.rendering.appearance import visuals_to_glb
    from mindstage.scene import GeometryMap

    def made() -> tuple[float, GeometryMap]:
        build._build_cached.cache_clear()
        with ms.open("bundled:kitchen", engine="null") as sim:
            start = time.perf_counter()
            for each in sim.geometry.values():
                assert each.visuals is not None
            return time.perf_counter() - start, dict(sim.geometry)

    _, geometry = made()
    different = {each.key: each for each in geometry.values() if each.visuals}
    files = []
    for key, each in different.items():
        files.append(folder / f"{key}.glb")
        files[-1].write_bytes(visuals_to_glb(each.visuals))
    loaded = median_s(lambda: [trimesh.load(path, process=False) for path in files], repeats=REPEATS)
    peer = f"trimesh {trimesh.__version__}, the same meshes from glTF"
    yield Measure(
        what=f"visual meshes of the bundled kitchen, {len(files)} shapes, from an earlier run",
        ours=median(made()[0] for _ in range(REPEATS)),
        peer=peer,
        theirs=loaded,
        at_most=1.0,
    )
    os.environ["MINDSTAGE_CACHE"] = str(folder / "no shapes")
    try:
        times = []
        for number in range(_EMPTY_CACHE_REPEATS):
            os.environ["MINDSTAGE_CACHE"] = str(folder / f"no shapes {number}")
            times.append(made()[0])
    finally:
        del os.environ["MINDSTAGE_CACHE"]
    yield Measure(what="the same, built and stored", ours=median(times), peer=peer, theirs=loaded)


def _peer_renders(model: Path, repeats: int, picture: Path | None = None) -> list[float]:
    """Loads a model, renders it several times with a renderer of its own each time, and returns the times [s]."""
    os.environ["MUJOCO_GL"] = "egl"
    import mujoco

    loaded = mujoco.MjModel.from_xml_path(str(model))
    width, height = SIZE
    loaded.vis.global_.offwidth, loaded.vis.global_.offheight = width, height
    data = mujoco.MjData(loaded)
    mujoco.mj_forward(loaded, data)
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        with mujoco.Renderer(loaded, height, width) as renderer:
            renderer.update_scene(data)
            pixels = renderer.render()
        times.append(time.perf_counter() - start)
    if picture is not None:
        from PIL import Image

        Image.fromarray(pixels).save(picture)
    return times


if __name__ == "__main__":
    _peer_renders(Path(sys.argv[1]), 1, Path(sys.argv[2]))
