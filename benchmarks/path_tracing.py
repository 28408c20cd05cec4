"""Path-traced pictures of the bundled kitchen, compared with bare Mitsuba: the exported glTF with plain materials.

Both render the same meshes from the same camera with the same size, samples and light paths, and remove the noise with
Open Image Denoise. The peer has gray diffuse materials, opaque panes, a uniform sky and no features for the denoiser.
Times are processor times of one process, in turn.
"""

from __future__ import annotations

import importlib.metadata
import io
import math
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import mindstage as ms
from benchmarks import Measure
from mindstage.assets.gltf import world_to_glb
from mindstage.rendering.camera import CameraPose
from mindstage.rendering.mitsuba_scene import MitsubaScene, Sky, use_mitsuba
from mindstage.rendering.path_tracing import PathTracingSettings, path_trace
from mindstage.rendering.render_scene import RenderScene
from mindstage.simulation.pictures import ScenePhotographer

REPEATS = 3
SIZE = (240, 150)
SAMPLES = 4
CAMERA = CameraPose((3.6, -3.2, 2.2), (-0.2, 0.4, 0.8), math.radians(45.0))
"""Through the open side of the room, from eye height; without a shifted lens, which the peer does not have."""


def measure() -> Iterator[Measure]:
    import trimesh

    with ms.open("bundled:kitchen", engine="null") as simulation:
        scene = ScenePhotographer.of(simulation).scene(CAMERA, aspect=SIZE[0] / SIZE[1])
        data, _ = world_to_glb(simulation.snapshot(), geometry=simulation.geometry)
    shown = {item.id for item in scene.items if item.shown}
    loaded = trimesh.load(io.BytesIO(data), file_type="glb")
    settings = PathTracingSettings(size=SIZE, samples=SAMPLES)
    version = f"Mitsuba {importlib.metadata.version('mitsuba')}, plain"
    ours, theirs = _medians(lambda: path_trace(scene, settings), lambda: _bare(loaded, shown))
    what = f"bundled kitchen, {SIZE[0]} x {SIZE[1]}, {SAMPLES} samples"
    yield Measure(what=f"{what}: picture", ours=ours, peer=version, theirs=theirs, at_most=3.0)
    (conversion,) = _medians(lambda: _convert(scene))
    yield Measure(what=f"{what}: conversion of the scene alone", ours=conversion)


def _medians(*functions: Callable[[], object]) -> list[float]:
    """The median processor times of functions, which alternate, after a first call of each [s]."""
    for function in functions:
        function()
    rounds = []
    for _ in range(REPEATS):
        times = []
        for function in functions:
            start = time.process_time()
            function()
            times.append(time.process_time() - start)
        rounds.append(times)
    return [median(times) for times in zip(*rounds, strict=True)]


def _convert(scene: RenderScene) -> None:
    MitsubaScene(scene, sky=Sky(sun_azimuth_rad=0.0))


def _bare(loaded: Any, shown: set[str]) -> None:
    """Writes the meshes of a glTF scene as PLY, renders them, and removes the noise."""
    import pyoidn

    mitsuba = use_mitsuba()
    gray = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.6, 0.6, 0.6]}}}
    parts: dict[str, Any] = {"type": "scene", "sky": {"type": "constant"}}
    turn = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # glTF has y up
    with tempfile.TemporaryDirectory() as folder:
        for number, node in enumerate(loaded.graph.nodes_geometry):
            transform, name = loaded.graph[node]
            if not any(part in shown for part in loaded.graph.transforms.shortest_path(loaded.graph.base_frame, node)):
                continue
            mesh = loaded.geometry[name].copy()
            mesh.apply_transform(turn @ transform)
            path = Path(folder) / f"{number}.ply"
            mesh.export(path)
            parts[f"mesh_{number}"] = {"type": "ply", "filename": str(path), "bsdf": gray}
        if len(parts) < 100:
            raise AssertionError(f"only {len(parts)} meshes of the glTF are drawn")
        native = mitsuba.load_dict(parts)
    sensor = mitsuba.load_dict(
        {
            "type": "perspective",
            "fov_axis": "y",
            "fov": math.degrees(CAMERA.field_of_view_rad),
            "to_world": mitsuba.ScalarTransform4f().look_at(
                list(CAMERA.position), list(CAMERA.look_at), [0.0, 0.0, 1.0]
            ),
            "film": {"type": "hdrfilm", "width": SIZE[0], "height": SIZE[1], "component_format": "float32"},
        }
    )
    integrator = mitsuba.load_dict({"type": "path", "max_depth": 7, "rr_depth": 4})
    image = np.array(mitsuba.render(native, sensor=sensor, integrator=integrator, spp=SAMPLES), dtype=np.float32)
    pyoidn.denoise(np.ascontiguousarray(image[..., :3]), hdr=True)
