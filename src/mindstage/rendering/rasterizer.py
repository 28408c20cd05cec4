"""Pictures of scenes by OpenGL, without a display or a browser.

All meshes are in one buffer, in the world frame, with the material of each vertex, and are drawn in a few passes:
depths from the sun, depths and normals for ambient occlusion, and surfaces in their light with multisampling. The
renderer of MuJoCo is not used: it lights vertices, of which a wall has few, and has no roughness, normal maps or
bias of shadows.
"""

from __future__ import annotations

import ctypes
import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mindstage.rendering import gl_codes as codes
from mindstage.rendering import shaders
from mindstage.rendering.annotations import Outline, annotate
from mindstage.rendering.camera import CameraPose, ViewFrame, corners
from mindstage.rendering.gl_context import OffscreenContext, OpenGL
from mindstage.rendering.gl_drawing import (
    VERTEX,
    Drawing,
    FramedMesh,
    Program,
    TextureKey,
    merged_vertices,
    mesh_part,
    repeat_length,
)
from mindstage.rendering.render_scene import RenderItem, RenderLight, RenderScene
from mindstage.scene import PbrMaterial
from mindstage.scene.colors import srgb_to_linear
from mindstage.scene.transforms import Array, normalized_pose_array, pose_array, rotation_matrix
from mindstage.textures.baking import texture_levels

__all__ = ["render_picture", "sun_direction"]

Bytes = NDArray[np.uint8]

_SAMPLES = 4
"""Samples of each pixel, which smooth the edges."""
_SHADOW_SIZE_PX = 2048
_OCCLUSION_STEP = 2
"""Ambient occlusion is smooth, and is computed for every so many pixels in both directions."""
_SMALL_PX = 8.0
_MIN_NEAR_M = 0.02
_NEAR_PART = 0.9
"""Distance of the near plane, as a part of that of the nearest thing."""
_GROUND_RADII = 12.0
"""Half the side of the ground, in radii of the scene."""
_GROUND_GAP_M = 1e-3
_GROUND_MATERIAL = PbrMaterial(name="ground", color=(0.80, 0.80, 0.79), roughness=0.9)
_OPAQUE_SHARE = 0.995
_TEXTURE_PX = 1024
"""Longest side of images."""
_TEXELS_PER_PIXEL = 1.0
"""Resolution of textures where they are nearest; lower ones are read from smaller levels."""
_LAMP_SUM_CD = 2.2
"""Sum of the intensities of the lamps: by day they only add warmth."""
_SUN_AZIMUTH_RAD = np.radians(38.0)
"""Angle between the sun and the camera, about z: shadows fall beside what casts them."""
_SUN_ELEVATION_RAD = np.radians(52.0)


def sun_direction(camera: CameraPose) -> Array:
    """The unit vector to the sun: behind the camera and beside it, so that it shines into the room."""
    away = np.subtract(camera.position, camera.look_at)
    azimuth = float(np.arctan2(away[1], away[0])) + _SUN_AZIMUTH_RAD
    flat = np.cos(_SUN_ELEVATION_RAD)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(_SUN_ELEVATION_RAD)])


def render_picture(scene: RenderScene, size: tuple[int, int]) -> Bytes:
    """Renders a picture.

    Args:
        scene: what it shows.
        size: width and height [px].

    Returns:
        h x w x 3, sRGB.

    Raises:
        RendererUnavailableError: there is no OpenGL library.
    """
    highlighted = [item for item in scene.items if item.shown and (item.highlight or item.id == scene.selected)]
    meshes, view = _SceneMeshes(scene), ViewFrame(scene.camera, size)
    with OffscreenContext() as context:
        rasterizer = _Rasterizer(context.gl, meshes, view, scene)
        picture = rasterizer.picture()
        depth = rasterizer.depths() if scene.labels else np.zeros((0, 0))
        masks = rasterizer.masks(highlighted)
    outlines = [
        Outline(color=item.highlight, visible=visible, whole=whole, selected=item.id == scene.selected)
        for item, (visible, whole) in zip(highlighted, masks, strict=True)
    ]
    return annotate(picture, scene, view, depth, outlines)


# -- meshes ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Batch:
    """Triangles that are drawn by one call."""

    texture: TextureKey
    casts_shadow: bool
    is_opaque: bool
    first: int
    """The first index."""
    count: int


_BatchKey = tuple[TextureKey, bool, bool]
"""The texture, whether a shadow is cast, and whether the material is opaque."""


class _SceneMeshes:
    """All triangles of a scene, in the world frame."""

    def __init__(self, scene: RenderScene) -> None:
        """Transforms, merges and clips the meshes.

        Args:
            scene: the scene; its items are numbered from 1 in their order.
        """
        self.images: dict[TextureKey, Bytes] = {}
        """The images that are no procedural textures."""
        self.repeats: dict[TextureKey, tuple[float, float]] = {}
        """The depth of the nearest vertex with a texture, and the length over which the texture repeats [m]."""
        self.center, self.radius = _bounds(scene)
        self.nearest = math.inf
        """Depth of the nearest vertex, without the ground; negative behind the camera [m]."""
        self.batches: list[_Batch] = []
        view, start, first = ViewFrame(scene.camera, (1, 1)), 0, 0
        vertices, faces, casters = [np.zeros(0, VERTEX)], [np.zeros((0, 3), np.uint32)], [np.zeros((0, 3))]
        for (texture, casts_shadow, is_opaque), parts in self._parts(scene, view.eye):
            part_vertices, indices = merged_vertices(parts, scene.clip_height)
            if not len(indices):
                continue
            depth = float(((part_vertices["position"] - view.eye) @ view.forward).min())
            self.nearest = min(self.nearest, depth)
            if texture:
                before = self.repeats.get(texture, (math.inf, 0.0))
                self.repeats[texture] = min(before[0], depth), max(before[1], repeat_length(part_vertices, indices))
            if casts_shadow:
                casters.append(part_vertices["position"])
            self.batches.append(_Batch(texture, casts_shadow, is_opaque, first, indices.size))
            vertices.append(part_vertices)
            faces.append(indices.astype(np.uint32) + np.uint32(start))
            start, first = start + len(part_vertices), first + indices.size
        self.casters = np.concatenate(casters)
        """Points that cast shadows."""
        if scene.ground_height is not None:
            ground, square = _ground(scene.ground_height, self.center, self.radius)
            vertices.append(ground)
            faces.append(square + np.uint32(start))
            self.batches.insert(0, _Batch("", False, True, first, square.size))
        self.vertices, self.faces = np.concatenate(vertices), np.concatenate(faces)

    def _parts(self, scene: RenderScene, eye: Array) -> Iterator[tuple[_BatchKey, list[FramedMesh]]]:
        """What is drawn by one call each: opaque parts, then transparent ones from the farthest to the nearest."""
        groups: dict[_BatchKey, list[FramedMesh]] = {}
        for number, item in enumerate(scene.items, start=1):
            if not item.shown:
                continue
            pose = normalized_pose_array(item.pose)
            rotation = rotation_matrix(pose[3:]).T
            for visual in item.visuals:
                if not len(visual.faces):
                    continue
                image = visual.image if visual.uv is not None else None
                texture = id(image) if image is not None else visual.material.texture if visual.uv is not None else ""
                if image is not None:
                    self.images[texture] = image
                has_holes = image is not None and image.shape[2] == 4 and bool((image[..., 3] < 255).any())
                is_opaque = visual.material.opacity >= _OPAQUE_SHARE and not has_holes
                key = texture, item.casts_shadow and is_opaque, is_opaque
                groups.setdefault(key, []).append(mesh_part(visual, rotation, pose[:3], number))
        yield from ((key, parts) for key, parts in groups.items() if key[2])
        transparent = [(key, part) for key, parts in groups.items() if not key[2] for part in parts]
        transparent.sort(key=lambda each: -float(np.linalg.norm(each[1].columns[:, :3].mean(axis=0) - eye)))
        yield from ((key, [part]) for key, part in transparent)


def _ground(height: float, center: Array, radius: float) -> tuple[NDArray[np.void], NDArray[np.uint32]]:
    half = _GROUND_RADII * radius
    vertices = np.zeros(4, VERTEX)
    square = np.array([[-half, -half], [half, -half], [half, half], [-half, half]]) + center[:2]
    vertices["position"] = np.column_stack([square, np.full(4, height - _GROUND_GAP_M)])
    vertices["normal"] = (0.0, 0.0, 1.0)
    vertices["color"] = np.rint(np.multiply((*_GROUND_MATERIAL.color, 1.0), 255))
    vertices["material"] = np.rint(np.multiply((_GROUND_MATERIAL.roughness, 0.0, 0.0, 1.0), 255))
    return vertices, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)


def _bounds(scene: RenderScene) -> tuple[Array, float]:
    """The center of what is shown and the radius of a sphere around it [m]."""
    shown = [item for item in scene.items if item.shown]
    if not shown:
        return np.zeros(3), 1.0
    points = corners(pose_array(item.pose for item in shown), np.array([item.size for item in shown], dtype=float))
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 0.1)


# -- rendering ---------------------------------------------------------------------------------------------------------


class _Rasterizer(Drawing):
    """Draws the meshes of a scene; its buffers are freed together with the context."""

    def __init__(self, gl: OpenGL, meshes: _SceneMeshes, view: ViewFrame, scene: RenderScene) -> None:
        super().__init__(gl)
        self._meshes, self._view, self._scene = meshes, view, scene
        self._near, self._far = _planes(meshes, view, scene)
        self._clip_from_world = view.clip_from_world(self._near, self._far)
        self._levels = self._load_levels()
        self._upload()
        gl.glEnable(codes.DEPTH_TEST)
        gl.glDepthFunc(codes.LESS_EQUAL)
        self._empty_array = self._generate("glGenVertexArrays")

    # -- pictures --

    def picture(self) -> Bytes:
        """Draws the scene in its light, h x w x 3."""
        gl, view = self._gl, self._view
        sun = sun_direction(self._scene.camera)
        shadow_map, shadow_from_world, extents = self._shadow_map(sun)
        occlusion, seen = self._occlusion()
        batches = self._keep_seen(seen)
        for batch in batches:  # before anything is drawn: software renderers draw all that is pending for each upload
            if batch.count:
                self._maps(batch.texture)
        samples = ctypes.c_int()
        gl.glGetIntegerv(codes.MAX_SAMPLES, ctypes.byref(samples))
        self._canvas = self._framebuffer(min(_SAMPLES, samples.value), codes.RGBA8)
        gl.glViewport(0, 0, view.width, view.height)
        gl.glClear(codes.COLOR_BIT | codes.DEPTH_BIT)
        gl.glDepthMask(0)
        self._fill(Program(gl, shaders.BACKDROP), camera=view.ray_axes(), rise=view.rise)
        gl.glDepthMask(1)
        gl.glColorMask(0, 0, 0, 0)
        Program(gl, shaders.DEPTH_ONLY).use(clip_from_world=self._clip_from_world)
        self._draw(batch for batch in batches if batch.is_opaque)
        gl.glColorMask(1, 1, 1, 1)
        gl.glDepthMask(0)
        surface = self._surface_program(sun, shadow_from_world, extents)
        self._bind(2, occlusion)
        self._bind(3, shadow_map)
        self._bind(4, shadow_map)
        gl.glBindSampler(3, self._comparing_sampler())
        self._draw_textured(surface, (batch for batch in batches if batch.is_opaque))
        gl.glEnable(codes.BLEND)
        gl.glBlendFunc(codes.ONE, codes.ONE_MINUS_ALPHA)
        self._draw_textured(surface, (batch for batch in batches if not batch.is_opaque))
        gl.glDisable(codes.BLEND)
        gl.glBindSampler(3, 0)
        gl.glDepthMask(1)
        self._resolved = self._framebuffer(0, codes.RGBA8)
        self._upload_indices(self._meshes.faces)
        self._blit(codes.COLOR_BIT)
        pixels = np.empty((view.height, view.width, 4), dtype=np.uint8)
        gl.glReadPixels(0, 0, view.width, view.height, codes.RGBA, codes.UNSIGNED_BYTE, pixels.ctypes.data)
        return np.ascontiguousarray(pixels[::-1, :, :3])

    def depths(self) -> NDArray[np.floating[Any]]:
        """Distances along the axis of the camera in the picture, h x w [m]; infinite where nothing is."""
        view = self._view
        self._blit(codes.DEPTH_BIT)
        depth = np.empty((view.height, view.width), dtype=np.float32)
        self._gl.glReadPixels(0, 0, view.width, view.height, codes.DEPTH, codes.FLOAT, depth.ctypes.data)
        meters = self._near * self._far / (self._far - depth[::-1] * (self._far - self._near))
        return np.where(depth[::-1] >= 1.0, np.inf, meters)

    def masks(self, items: Sequence[RenderItem]) -> list[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
        """Where some items are visible, and where they would be if nothing were in front of them, h x w."""
        if not items:
            return []
        gl, rows = self._gl, {id(item): number for number, item in enumerate(self._scene.items, start=1)}
        self._framebuffer(0, codes.R32F)
        gl.glClearColor(0.0, 0.0, 0.0, 0.0)
        gl.glClear(codes.COLOR_BIT | codes.DEPTH_BIT)
        Program(gl, shaders.NUMBERS).use(clip_from_world=self._clip_from_world)
        self._draw(batch for batch in self._meshes.batches if batch.is_opaque)
        # Glass hides nothing, but is seen itself.
        numbers = [rows[id(item)] for item in items]
        ranges = self._upload_by_number(numbers)
        for first, length in ranges:
            self._draw_range(first, length)
        visible = self._read_numbers()
        gl.glDisable(codes.DEPTH_TEST)
        masks = []
        for number, (first, length) in zip(numbers, ranges, strict=True):
            gl.glClear(codes.COLOR_BIT)
            self._draw_range(first, length)
            masks.append((visible == number, self._read_numbers() == number))
        gl.glEnable(codes.DEPTH_TEST)
        return masks

    def _read_numbers(self) -> NDArray[np.int32]:
        view = self._view
        pixels = np.empty((view.height, view.width), dtype=np.float32)
        self._gl.glReadPixels(0, 0, view.width, view.height, codes.RED, codes.FLOAT, pixels.ctypes.data)
        return np.rint(pixels[::-1]).astype(np.int32)

    # -- passes --

    def _shadow_map(self, sun: Array) -> tuple[int, Array, Array]:
        """Depths from the sun: the texture, the matrix that leads to it, and the extents of what it covers [m]."""
        gl = self._gl
        across = np.cross([0.0, 0.0, 1.0], sun)
        across /= np.linalg.norm(across)
        axes = np.stack([across, np.cross(sun, across), -sun])
        points = (self._meshes.casters if len(self._meshes.casters) else np.zeros((1, 3))) @ axes.T
        low, high = points.min(axis=0) - 0.01, points.max(axis=0) + 0.01
        extents = high - low
        shadow_from_world = np.eye(4)
        shadow_from_world[:3, :3] = axes / np.array([*extents[:2], 1.0])[:, None]
        shadow_from_world[:3, 3] = -low / np.array([*extents[:2], 1.0])
        clip = np.diag([2.0, 2.0, 2.0 / extents[2], 1.0])
        clip[:3, 3] = -1.0
        texture = self._texture(codes.DEPTH_32F, (_SHADOW_SIZE_PX, _SHADOW_SIZE_PX), codes.DEPTH, codes.FLOAT, None)
        self._target(depth=texture)
        gl.glViewport(0, 0, _SHADOW_SIZE_PX, _SHADOW_SIZE_PX)
        gl.glClear(codes.DEPTH_BIT)
        Program(gl, shaders.DEPTH_ONLY).use(clip_from_world=clip @ shadow_from_world)
        gl.glEnable(codes.POLYGON_OFFSET)
        gl.glPolygonOffset(1.0, 1.0)
        self._draw(batch for batch in self._meshes.batches if batch.casts_shadow)
        gl.glDisable(codes.POLYGON_OFFSET)
        return texture, shadow_from_world, extents

    def _occlusion(self) -> tuple[int, NDArray[np.bool_]]:
        """A texture of the part of the sky light that each pixel receives; and which items are seen, by number."""
        gl, view = self._gl, self._view
        size = (-(-view.width // _OCCLUSION_STEP), -(-view.height // _OCCLUSION_STEP))
        depths = self._texture(codes.DEPTH_32F, size, codes.DEPTH, codes.FLOAT, None)
        normals = self._texture(codes.RGBA32F, size, codes.RGBA, codes.FLOAT, None)
        self._target(color=normals, depth=depths)
        gl.glViewport(0, 0, *size)
        gl.glClearColor(0.0, 0.0, 0.0, 0.0)
        gl.glClear(codes.COLOR_BIT | codes.DEPTH_BIT)
        Program(gl, shaders.NORMALS).use(clip_from_world=self._clip_from_world)
        self._draw(batch for batch in self._meshes.batches if batch.is_opaque)
        pixels = np.empty((size[1], size[0], 4), dtype=np.float32)
        gl.glReadPixels(0, 0, *size, codes.RGBA, codes.FLOAT, pixels.ctypes.data)
        seen = self._are_small()
        seen[np.unique(pixels[..., 3]).astype(np.intp)] = True
        planes = (self._near, self._far)
        raw = self._texture(codes.R8, size, codes.RED, codes.UNSIGNED_BYTE, None)
        self._target(color=raw)
        self._bind(0, depths)
        self._bind(1, normals)
        self._fill(
            Program(gl, shaders.AMBIENT_OCCLUSION),
            depths=0,
            normals=1,
            camera=view.ray_axes(),
            rise=view.rise,
            planes=planes,
            size=size,
            pixels_per_tangent=size[0] / (2 * view.half_width),
        )
        blurred = self._texture(codes.R8, size, codes.RED, codes.UNSIGNED_BYTE, None, filter=codes.LINEAR)
        self._target(color=blurred)
        self._bind(1, raw)
        self._fill(Program(gl, shaders.BLUR), depths=0, values=1, planes=planes, size=size)
        return blurred, seen

    def _are_small(self) -> NDArray[np.bool_]:
        """Which items are so small in the picture that they may be between the pixels of a coarse one, by number.

        Items with transparent parts count as such: what is behind glass is seen, but not the glass itself.
        """
        items = self._scene.items
        found = np.ones(len(items) + 1, dtype=bool)
        if items:
            centers, sizes = pose_array(item.pose for item in items)[:, :3], np.array([item.size for item in items])
            depth = np.maximum((centers - self._view.eye) @ self._view.forward, self._near)
            extents = np.linalg.norm(sizes, axis=1) / depth * self._view.width / (2 * self._view.half_width)
            found[1:] = extents < _SMALL_PX
        for batch in self._meshes.batches:
            if not batch.is_opaque:
                faces = self._meshes.faces[batch.first // 3 : (batch.first + batch.count) // 3]
                found[self._meshes.vertices["number"][faces[:, 0]].astype(np.intp)] = True
        return found

    def _surface_program(self, sun: Array, shadow_from_world: Array, extents: Array) -> Program:
        view, scene = self._view, self._scene
        program = Program(self._gl, shaders.SURFACE)
        lamps = _brightest(scene.lights)
        total = sum(lamp.intensity for lamp in lamps)
        program.use(
            clip_from_world=self._clip_from_world,
            eye=view.eye,
            to_sun=sun,
            is_cut=scene.clip_height is not None,
            color_map=0,
            surface_map=1,
            occlusion_map=2,
            shadow_map=3,
            shadow_depths=4,
            pixel_size=(1.0 / view.width, 1.0 / view.height),
            shadow_from_world=shadow_from_world,
            shadow_scale=extents,
            shadow_texel=float(extents[:2].max()) / _SHADOW_SIZE_PX,
            lamp_count=len(lamps),
            ground=np.array([*self._meshes.center[:2], scene.ground_height or 0.0, self._meshes.radius]),
        )
        if lamps:
            program.set("lamp_points", np.array([lamp.pose.position for lamp in lamps]).reshape(-1, 3))
            strengths = [_LAMP_SUM_CD * lamp.intensity / total * srgb_to_linear(np.array(lamp.color)) for lamp in lamps]
            program.set("lamp_colors", np.array(strengths).reshape(-1, 3))
        return program

    def _draw_textured(self, program: Program, batches: Iterable[_Batch]) -> None:
        for batch in batches:
            if not batch.count:
                continue
            color, relief = self._maps(batch.texture)
            program.set("is_textured", color != 0)
            program.set("has_relief", relief != 0)
            self._bind(0, color)
            self._bind(1, relief)
            self._draw_range(batch.first, batch.count)

    def _draw(self, batches: Iterable[_Batch]) -> None:
        for batch in batches:
            self._draw_range(batch.first, batch.count)

    def _draw_range(self, first: int, count: int) -> None:
        self._gl.glBindVertexArray(self._array)
        self._gl.glDrawElements(codes.TRIANGLES, count, codes.UNSIGNED_INT, 4 * first)

    def _fill(self, program: Program, **uniforms: object) -> None:
        """Draws all pixels."""
        program.use(**uniforms)
        self._gl.glDisable(codes.DEPTH_TEST)
        self._gl.glBindVertexArray(self._empty_array)
        self._gl.glDrawArrays(codes.TRIANGLES, 0, 3)
        self._gl.glEnable(codes.DEPTH_TEST)

    # -- buffers --

    def _upload(self) -> None:
        gl, meshes = self._gl, self._meshes
        self._array = self._generate("glGenVertexArrays")
        gl.glBindVertexArray(self._array)
        gl.glBindBuffer(codes.ARRAY_BUFFER, self._generate("glGenBuffers"))
        gl.glBufferData(codes.ARRAY_BUFFER, meshes.vertices.nbytes, meshes.vertices.ctypes.data, codes.STATIC_DRAW)
        gl.glBindBuffer(codes.ELEMENT_BUFFER, self._generate("glGenBuffers"))
        self._upload_indices(meshes.faces)
        self._enable_attributes()
        gl.glPixelStorei(codes.UNPACK_ALIGNMENT, 1)
        self._loaded: dict[TextureKey, tuple[int, int]] = {"": (0, 0)}

    def _upload_by_number(self, numbers: Sequence[int]) -> list[tuple[int, int]]:
        """Replaces the indices by those of the faces of some items; the first index and the count of each."""
        of_faces = self._meshes.vertices["number"][self._meshes.faces[:, 0]]
        parts = [self._meshes.faces[of_faces == number] for number in numbers]
        self._upload_indices(np.concatenate(parts))
        counts = [part.size for part in parts]
        return list(zip(np.cumsum([0, *counts]).tolist(), counts, strict=False))

    def _keep_seen(self, seen: NDArray[np.bool_]) -> list[_Batch]:
        """Replaces the indices by those of the faces of the items that are seen.

        Args:
            seen: whether each item is seen, by number.
        """
        meshes, kept, batches, first = self._meshes, [], [], 0
        for batch in meshes.batches:
            faces = meshes.faces[batch.first // 3 : (batch.first + batch.count) // 3]
            faces = faces[seen[meshes.vertices["number"][faces[:, 0]].astype(np.intp)]]
            kept.append(faces)
            batches.append(dataclasses.replace(batch, first=first, count=faces.size))
            first += faces.size
        self._upload_indices(np.concatenate([np.zeros((0, 3), np.uint32), *kept]))
        return batches

    def _upload_indices(self, faces: NDArray[np.uint32]) -> None:
        gl, faces = self._gl, np.ascontiguousarray(faces)
        gl.glBindVertexArray(self._array)
        gl.glBufferData(codes.ELEMENT_BUFFER, faces.nbytes, faces.ctypes.data, codes.STATIC_DRAW)

    def _maps(self, key: TextureKey) -> tuple[int, int]:
        """The textures of color and of relief; 0 for none."""
        if key not in self._loaded:
            texels = self._texels(key)
            if isinstance(key, str):
                levels = self._levels[key]
                self._loaded[key] = (
                    self._repeating(level[0] for level in levels),
                    self._repeating(level[1] for level in levels),
                )
            else:
                image = self._meshes.images[key]
                reduced = Image.fromarray(image).reduce(max(max(image.shape) // min(texels, _TEXTURE_PX), 1))
                self._loaded[key] = self._repeating([np.asarray(reduced.convert("RGBA"))]), 0
        return self._loaded[key]

    def _texels(self, key: TextureKey) -> int:
        """How many texels along a repeat of a texture are as large as a pixel where it is nearest."""
        distance, repeat = self._meshes.repeats[key]
        pixel = max(distance, self._near) * 2 * self._view.half_width / self._view.width
        return max(math.ceil(_TEXELS_PER_PIXEL * repeat / pixel), 1)

    def _load_levels(self) -> dict[str, list[Bytes]]:
        """The procedural textures; several at a time, since some may have to be computed."""
        names = [key for key in self._meshes.repeats if isinstance(key, str)]
        with ThreadPoolExecutor() as pool:
            levels = pool.map(lambda name: texture_levels(name, self._texels(name)), names)
            return dict(zip(names, levels, strict=True))

    def _framebuffer(self, samples: int, form: int) -> int:
        """A framebuffer of the size of the picture, which is drawn into from now on."""
        gl, target = self._gl, self._generate("glGenFramebuffers")
        gl.glBindFramebuffer(codes.FRAMEBUFFER, target)
        for attachment, stored in ((codes.COLOR_ATTACHMENT, form), (codes.DEPTH_ATTACHMENT, codes.DEPTH_32F)):
            buffer = self._generate("glGenRenderbuffers")
            gl.glBindRenderbuffer(codes.RENDERBUFFER, buffer)
            size = (self._view.width, self._view.height)
            gl.glRenderbufferStorageMultisample(codes.RENDERBUFFER, samples, stored, *size)
            gl.glFramebufferRenderbuffer(codes.FRAMEBUFFER, attachment, codes.RENDERBUFFER, buffer)
        self._check_target()
        return target

    def _blit(self, part: int) -> None:
        """Averages the samples of the picture into a framebuffer that can be read."""
        gl, box = self._gl, (0, 0, self._view.width, self._view.height)
        gl.glBindFramebuffer(codes.READ_FRAMEBUFFER, self._canvas)
        gl.glBindFramebuffer(codes.DRAW_FRAMEBUFFER, self._resolved)
        gl.glBlitFramebuffer(*box, *box, part, codes.NEAREST)
        gl.glBindFramebuffer(codes.FRAMEBUFFER, self._resolved)


def _planes(meshes: _SceneMeshes, view: ViewFrame, scene: RenderScene) -> tuple[float, float]:
    """Distances of the near and the far plane [m]."""
    nearest = min(meshes.nearest, meshes.radius)
    if scene.ground_height is not None:
        # Where the lowest rays meet the ground.
        down = max(float(-(view.forward + edge * view.up)[2]) for edge in (view.bottom, view.top))
        above = view.eye[2] - scene.ground_height
        if down > 0 and above > 0:
            nearest = min(nearest, above / down)
    distance = float(np.linalg.norm(view.eye - meshes.center))
    far = 4 * (distance + (_GROUND_RADII if scene.ground_height is not None else 2.0) * meshes.radius)
    return max(_MIN_NEAR_M, _NEAR_PART * nearest), far


def _brightest(lights: Iterable[RenderLight]) -> list[RenderLight]:
    bright = (light for light in lights if light.intensity > 0)
    return sorted(bright, key=lambda light: -light.intensity)[: shaders.MAX_LAMPS]
