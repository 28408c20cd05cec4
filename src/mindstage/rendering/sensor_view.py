"""Images as the cameras of robots take them: color, depths, numbers of bodies and normals of one state of a world.

Unlike a picture, an image leaves nothing out, and its sun stands still. Meshes are uploaded once, in the frames of
their bodies, and only poses change between images. Color has one sample per pixel, a shadow map that is drawn again
only if something has moved, and no ambient occlusion. Depths and numbers are those at the centers of pixels, drawn in
one pass; transparent surfaces count as opaque there.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mindstage.ranges import Angle, NotNegative, check_fields
from mindstage.rendering import gl_codes as codes
from mindstage.rendering import shaders
from mindstage.rendering.gl_context import OpenGL
from mindstage.rendering.gl_drawing import (
    VERTEX,
    Bytes,
    Drawing,
    Program,
    TextureKey,
    merged_vertices,
    mesh_part,
)
from mindstage.rendering.render_scene import RenderItem, RenderLight
from mindstage.scene import PbrMaterial, VisualMesh
from mindstage.scene.colors import srgb_to_linear
from mindstage.scene.mesh import box
from mindstage.scene.transforms import Array, rotation_matrix
from mindstage.textures.baking import texture_levels

__all__ = ["PinholeView", "SensorImages", "SensorLighting", "SensorRasterizer"]

_TEXELS = 512
"""Texels along a repeat of a procedural texture, and along the longer side of other ones."""
_SHADOW_SIZE_PX = 1024
_POSES_PER_ROW = 4096
"""Poses in a row of the texture that has them, of three texels each."""
_OPAQUE_SHARE = 0.995
"""Opacity, as a fraction, from which on a material is opaque."""
_GROUND_M = (400.0, 400.0, 0.2)
_GROUND_MATERIAL = PbrMaterial(name="ground", color=(0.80, 0.80, 0.79), roughness=0.9)
_SKY = (0.82, 0.87, 0.91)
"""The color of what nothing is in front of, sRGB."""
_COARSE_SIZE_PX = (32, 24)
_ENCLOSED_SHARE = 0.9
"""The part of an image that shows the back of a body around the camera."""
_LAMP_SUM_CD = 2.2
"""Sum of the intensities of the lamps: by day they only add warmth."""


class PinholeView(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Where a pinhole camera is, and how it projects: u = fx x / z + cx, v = fy y / z + cy, 0 at a pixel's center."""

    position: Array
    """In the world frame [m]."""
    rotation: Array
    """Of the optical frame (x right, y down, z forward) in the world frame, 3 x 3."""
    size: tuple[int, int]
    """Width and height [px]."""
    focal: tuple[float, float]
    """fx and fy [px]."""
    center: tuple[float, float]
    """cx and cy [px]."""
    near: float
    """Nothing nearer along the axis is seen [m]."""
    far: float
    """Nothing farther along the axis is seen [m]."""

    def clip_from_eye(self) -> Array:
        """The projection of OpenGL, 4 x 4, from a frame at the eye with the axes of the world; row 0 is the upper."""
        (width, height), (fx, fy), (cx, cy) = self.size, self.focal, self.center
        projection = np.zeros((4, 4))
        projection[0, 0], projection[0, 2] = 2 * fx / width, 2 * (cx + 0.5) / width - 1
        projection[1, 1], projection[1, 2] = 2 * fy / height, 2 * (cy + 0.5) / height - 1
        span = self.far - self.near
        projection[2, 2], projection[2, 3] = (self.far + self.near) / span, -2 * self.far * self.near / span
        projection[3, 2] = 1.0
        camera = np.eye(4)
        camera[:3, :3] = self.rotation.T
        product: Array = projection @ camera
        return product

    def sees(self, centers: Array, radii: Array) -> NDArray[np.bool_]:
        """Which spheres may be in the image.

        Args:
            centers: n x 3, relative to the eye, with the axes of the world [m].
            radii: n [m].
        """
        x, y, z = (centers @ self.rotation).T
        found = (z > self.near - radii) & (z < self.far + radii)
        for along, focal, center, size in zip((x, y), self.focal, self.center, self.size, strict=True):
            for sign, edge in ((1.0, (center + 0.5) / focal), (-1.0, (size - 0.5 - center) / focal)):
                found &= sign * along + edge * z > -radii * np.hypot(1.0, edge)
        return np.asarray(found)


class SensorLighting(msgspec.Struct, frozen=True, kw_only=True):
    """The light outdoors and in rooms: a sun that stands still, and the sky; lamps are those of the world."""

    sun_azimuth_rad: Angle = 0.9
    """Direction to the sun, about z from x."""
    sun_elevation_rad: Angle = 0.9
    sun: NotNegative = 1.25
    """Brightness of what faces the sun, as a factor of its color."""
    sky: NotNegative = 0.62
    """Brightness of what faces up, in the shadow."""
    lamps: NotNegative = 1.0
    """Factor of the light of lamps."""

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def to_sun(self) -> Array:
        """The unit vector to the sun."""
        flat, up = np.cos(self.sun_elevation_rad), np.sin(self.sun_elevation_rad)
        return np.array([flat * np.cos(self.sun_azimuth_rad), flat * np.sin(self.sun_azimuth_rad), up])


class SensorImages(NamedTuple):
    """What a camera sees, all from one state; None for what was not asked for."""

    rgb: Bytes | None
    """h x w x 3, sRGB."""
    depth: NDArray[np.float32] | None
    """Distance along the axis of the camera, h x w [m]; infinite where nothing is."""
    numbers: NDArray[np.uint32] | None
    """Which item is seen, from 1 in their order, h x w; 0 for the ground and for nothing."""
    normals: NDArray[np.float32] | None
    """Unit normals of the surfaces in the optical frame, h x w x 3; 0 where nothing is."""


class _Range(NamedTuple):
    """Triangles of one item and one texture."""

    texture: TextureKey
    casts_shadow: bool
    is_opaque: bool
    item: int
    first: int
    length: int


class SensorRasterizer(Drawing):
    """Draws the bodies of a world, at poses that change; used in the thread in which its context is current."""

    def __init__(
        self, gl: OpenGL, items: Sequence[RenderItem], *, lights: Sequence[RenderLight], ground_height: float | None
    ) -> None:
        """Uploads meshes and textures.

        Args:
            items: what is drawn, numbered from 1; their poses are not used.
            lights: the lamps.
            ground_height: height of the ground plane [m]; None if the world has a floor.
        """
        super().__init__(gl)
        self._lights = sorted((each for each in lights if each.intensity > 0), key=lambda each: -each.intensity)
        self._ranges: list[_Range] = []
        self._images: dict[TextureKey, Bytes] = {}
        self._count = len(items) + 1
        self._ground = np.eye(3, 4)
        self._casters = np.zeros(self._count, dtype=bool)
        self._upload(items, ground_height)
        self._programs = {
            name: Program(gl, shader)
            for name, shader in (
                ("shadow", shaders.ITEM_SHADOWS),
                ("geometry", shaders.ITEM_GEOMETRY),
                ("color", shaders.ITEM_COLORS),
            )
        }
        self._poses_texture = self._texture(codes.RGBA32F, (1, 1), codes.RGBA, codes.FLOAT, None)
        self._shadow_texture = self._texture(
            codes.DEPTH_32F, (_SHADOW_SIZE_PX, _SHADOW_SIZE_PX), codes.DEPTH, codes.FLOAT, None
        )
        self._shadow_target = self._target(depth=self._shadow_texture)
        self._shadow_from_world, self._shadow_extents = np.eye(4), np.ones(3)
        self._shadow_state: tuple[Array, tuple[float, ...]] | None = None
        self._sampler = self._comparing_sampler()
        self._targets: dict[tuple[object, ...], int] = {}
        self._textures_of = {key: self._load(key) for key in {each.texture for each in self._ranges}}
        gl.glEnable(codes.DEPTH_TEST)
        gl.glDepthFunc(codes.LESS_EQUAL)
        gl.glPixelStorei(codes.PACK_ALIGNMENT, 1)

    # -- images --------------------------------------------------------------------------------------------------------

    def render(
        self,
        view: PinholeView,
        poses: Array,
        *,
        hidden: Iterable[int] = (),
        lighting: SensorLighting | None = None,
        color: bool = False,
        geometry: bool = False,
        normals: bool = False,
        facing: bool = True,
    ) -> SensorImages:
        """Takes an image.

        Args:
            view: the camera.
            poses: of the items in the world frame, with unit quaternions, n x 7.
            hidden: numbers of items that are not seen, such as the housing of the camera.
            lighting: the light; by default that of a sunny day.
            color: whether colors are drawn.
            geometry: whether depths and numbers are.
            normals: whether normals are, too.
            facing: whether normals of backs are turned to the camera.
        """
        matrices = np.concatenate([self._ground[None], np.zeros((len(poses), 3, 4))])
        matrices[1:, :, :3], matrices[1:, :, 3] = rotation_matrix(poses[:, 3:]), poses[:, :3]
        light = lighting or SensorLighting()
        if color:
            self._draw_shadows(matrices, light)
        relative = matrices.copy()
        relative[:, :, 3] -= view.position
        self._upload_poses(relative)
        centers = np.einsum("nij,nj->ni", relative[:, :, :3], self._spheres[:, :3]) + relative[:, :, 3]
        seen = view.sees(centers, self._spheres[:, 3])
        seen[list(hidden)] = False
        rgb = self._draw_colors(view, relative, centers, seen, light) if color else None
        if not (geometry or normals):
            return SensorImages(rgb, None, None, None)
        return SensorImages(rgb, *self._draw_geometry(view, seen, normals=normals, facing=facing))

    def around(self, point: Array, poses: Array) -> list[int]:
        """The numbers of the items whose bounding boxes contain a point.

        Args:
            point: in the world frame [m].
            poses: as for `render`.
        """
        local = np.einsum("nji,nj->ni", rotation_matrix(poses[:, 3:]), point - poses[:, :3])
        low, high = self._low[1:], self._high[1:]
        inside = (local >= low).all(axis=1) & (local <= high).all(axis=1)
        return [int(row) + 1 for row in np.flatnonzero(inside)]

    def enclosing(self, view: PinholeView, poses: Array, numbers: Iterable[int], *, hidden: Iterable[int]) -> int:
        """Which of some items a camera is inside of: the one of which it sees the back nearly everywhere; 0 for none.

        Args:
            view: the camera.
            poses: as for `render`.
            numbers: of the items.
            hidden: as for `render`.
        """
        scale = np.array(_COARSE_SIZE_PX) / view.size
        coarse = msgspec.structs.replace(
            view,
            size=_COARSE_SIZE_PX,
            focal=(view.focal[0] * scale[0], view.focal[1] * scale[1]),
            center=((view.center[0] + 0.5) * scale[0] - 0.5, (view.center[1] + 0.5) * scale[1] - 0.5),
        )
        found = self.render(coarse, poses, hidden=hidden, normals=True, facing=False)
        assert found.numbers is not None
        assert found.normals is not None
        columns, rows = np.meshgrid(*(np.arange(side) for side in coarse.size))
        rays = [(columns - coarse.center[0]) / coarse.focal[0], (rows - coarse.center[1]) / coarse.focal[1]]
        is_back = found.normals[..., 0] * rays[0] + found.normals[..., 1] * rays[1] + found.normals[..., 2] > 0
        for number in numbers:
            if np.mean((found.numbers == number) & is_back) > _ENCLOSED_SHARE:
                return number
        return 0

    def _draw_geometry(
        self, view: PinholeView, seen: NDArray[np.bool_], *, normals: bool, facing: bool
    ) -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.float32] | None]:
        gl, (width, height) = self._gl, view.size
        forms = (codes.R32F, codes.R32UI, codes.RGBA32F)[: 3 if normals else 2]
        self._use_target(view.size, forms)
        zero = (ctypes.c_uint * 4)()
        for number in range(len(forms)):
            clear = gl.glClearBufferuiv if number == 1 else gl.glClearBufferfv
            clear(codes.COLOR, number, ctypes.byref(zero))
        gl.glClear(codes.DEPTH_BIT)
        self._bind(0, self._poses_texture)
        self._programs["geometry"].use(poses=0, clip_from_eye=view.clip_from_eye(), is_facing=facing)
        self._draw(each for each in self._ranges if seen[each.item])
        depth = np.empty((height, width), dtype=np.float32)
        self._read(0, codes.RED, codes.FLOAT, depth)
        ids = np.empty((height, width), dtype=np.uint32)
        self._read(1, codes.RED_INTEGER, codes.UNSIGNED_INT, ids)
        depth[depth == 0.0] = np.inf
        if not normals:
            return depth, ids, None
        in_world = np.empty((height, width, 4), dtype=np.float32)
        self._read(2, codes.RGBA, codes.FLOAT, in_world)
        return depth, ids, in_world[..., :3] @ view.rotation.astype(np.float32)

    def _draw_colors(
        self, view: PinholeView, relative: Array, centers: Array, seen: NDArray[np.bool_], light: SensorLighting
    ) -> Bytes:
        gl, (width, height) = self._gl, view.size
        self._use_target(view.size, (codes.RGBA8,))
        gl.glClearColor(*_SKY, 1.0)
        gl.glClear(codes.COLOR_BIT | codes.DEPTH_BIT)
        shadow = self._shadow_from_world.copy()
        shadow[:3, 3] += shadow[:3, :3] @ view.position
        lamps = self._lights[: shaders.MAX_LAMPS]
        total = sum(lamp.intensity for lamp in lamps)
        for unit, texture in ((0, self._poses_texture), (2, self._shadow_texture)):
            self._bind(unit, texture)
        gl.glBindSampler(2, self._sampler)
        program = self._programs["color"]
        program.use(
            poses=0,
            color_map=1,
            shadow_map=2,
            clip_from_eye=view.clip_from_eye(),
            to_sun=light.to_sun,
            sun=float(light.sun),
            sky=float(light.sky),
            shadow_from_eye=shadow,
            shadow_scale=self._shadow_extents,
            shadow_texel=float(self._shadow_extents[:2].max()) / _SHADOW_SIZE_PX,
            lamp_count=len(lamps),
        )
        if lamps:
            program.set("lamp_points", np.array([lamp.pose.position for lamp in lamps]) - view.position)
            strength = light.lamps * _LAMP_SUM_CD / total
            colors = [strength * lamp.intensity * srgb_to_linear(np.array(lamp.color)) for lamp in lamps]
            program.set("lamp_colors", np.array(colors).reshape(-1, 3))
        visible = [each for each in self._ranges if seen[each.item]]
        # What is hidden by what was drawn before costs no light: large things are near the camera, not their centers.
        distances = np.linalg.norm(centers, axis=1) - self._spheres[:, 3]
        near_first = sorted((each for each in visible if each.is_opaque), key=lambda each: distances[each.item])
        self._draw_textured(program, near_first)
        behind = sorted(
            (each for each in visible if not each.is_opaque),
            key=lambda each: -distances[each.item],
        )
        if behind:
            gl.glEnable(codes.BLEND)
            gl.glBlendFunc(codes.ONE, codes.ONE_MINUS_ALPHA)
            gl.glDepthMask(0)
            for each in behind:
                self._draw_textured(program, [each])
            gl.glDepthMask(1)
            gl.glDisable(codes.BLEND)
        gl.glBindSampler(2, 0)
        pixels = np.empty((height, width, 4), dtype=np.uint8)
        self._read(0, codes.RGBA, codes.UNSIGNED_BYTE, pixels)
        return np.ascontiguousarray(pixels[..., :3])

    def _draw_shadows(self, matrices: Array, light: SensorLighting) -> None:
        """Draws the depths from the sun, unless they are those of the last image."""
        gl, sun = self._gl, light.to_sun
        state = matrices[self._casters], tuple(sun)
        last = self._shadow_state
        if last is not None and last[1] == state[1] and np.array_equal(last[0], state[0]):
            return
        self._shadow_state = state
        across = np.cross([0.0, 0.0, 1.0], sun)
        across = across / np.linalg.norm(across) if np.linalg.norm(across) > 1e-6 else np.array([1.0, 0.0, 0.0])
        axes = np.stack([across, np.cross(sun, across), -sun])
        spheres = self._spheres[self._casters]
        centers = np.einsum("nij,nj->ni", state[0][:, :, :3], spheres[:, :3]) + state[0][:, :, 3]
        if not len(centers):
            centers, spheres = np.zeros((1, 3)), np.ones((1, 4))
        along = centers @ axes.T
        low, high = (along - spheres[:, 3:]).min(axis=0) - 0.01, (along + spheres[:, 3:]).max(axis=0) + 0.01
        self._shadow_extents = extents = high - low
        scale = np.array([*extents[:2], 1.0])
        self._shadow_from_world = np.eye(4)
        self._shadow_from_world[:3, :3] = axes / scale[:, None]
        self._shadow_from_world[:3, 3] = -low / scale
        clip = np.diag([2.0, 2.0, 2.0 / extents[2], 1.0])
        clip[:3, 3] = -1.0
        self._upload_poses(matrices)
        gl.glBindFramebuffer(codes.FRAMEBUFFER, self._shadow_target)
        gl.glViewport(0, 0, _SHADOW_SIZE_PX, _SHADOW_SIZE_PX)
        gl.glClear(codes.DEPTH_BIT)
        self._bind(0, self._poses_texture)
        self._programs["shadow"].use(poses=0, clip_from_eye=clip @ self._shadow_from_world)
        gl.glEnable(codes.POLYGON_OFFSET)
        gl.glPolygonOffset(1.0, 1.0)
        self._draw(each for each in self._ranges if each.casts_shadow)
        gl.glDisable(codes.POLYGON_OFFSET)

    # -- drawing -------------------------------------------------------------------------------------------------------

    def _draw_textured(self, program: Program, ranges: Sequence[_Range]) -> None:
        groups: dict[TextureKey, list[_Range]] = {}
        for each in ranges:
            groups.setdefault(each.texture, []).append(each)
        for key, group in groups.items():
            program.set("is_textured", self._textures_of[key] != 0)
            self._bind(1, self._textures_of[key])
            self._draw(group)

    def _draw(self, ranges: Iterable[_Range]) -> None:
        chosen = [(4 * each.first, each.length) for each in ranges]
        if not chosen:
            return
        first, count = np.array(chosen, dtype=np.int64).T
        begins = np.concatenate([[True], first[1:] != first[:-1] + 4 * count[:-1]])  # neighbors are drawn together
        offsets = np.ascontiguousarray(first[begins], dtype=np.uintp)
        counts = np.ascontiguousarray(np.add.reduceat(count, np.flatnonzero(begins)), dtype=np.int32)
        self._gl.glBindVertexArray(self._array)
        self._gl.glMultiDrawElements(
            codes.TRIANGLES, counts.ctypes.data, codes.UNSIGNED_INT, offsets.ctypes.data, len(counts)
        )

    def _read(self, attachment: int, form: int, kind: int, pixels: NDArray[Any]) -> None:
        height, width = pixels.shape[:2]
        self._gl.glReadBuffer(codes.COLOR_ATTACHMENT + attachment)
        self._gl.glReadPixels(0, 0, width, height, form, kind, pixels.ctypes.data)

    def _use_target(self, size: tuple[int, int], forms: tuple[int, ...]) -> None:
        """Draws into a framebuffer of these formats from now on."""
        gl = self._gl
        if (size, forms) not in self._targets:
            target = self._targets[size, forms] = self._generate("glGenFramebuffers")
            gl.glBindFramebuffer(codes.FRAMEBUFFER, target)
            attachments = [codes.COLOR_ATTACHMENT + number for number in range(len(forms))]
            for at, stored in zip([*attachments, codes.DEPTH_ATTACHMENT], [*forms, codes.DEPTH_32F], strict=True):
                buffer = self._generate("glGenRenderbuffers")
                gl.glBindRenderbuffer(codes.RENDERBUFFER, buffer)
                gl.glRenderbufferStorageMultisample(codes.RENDERBUFFER, 0, stored, *size)
                gl.glFramebufferRenderbuffer(codes.FRAMEBUFFER, at, codes.RENDERBUFFER, buffer)
            listed = (ctypes.c_uint * len(forms))(*attachments)
            gl.glDrawBuffers(len(forms), ctypes.byref(listed))
            self._check_target()
        gl.glBindFramebuffer(codes.FRAMEBUFFER, self._targets[size, forms])
        gl.glViewport(0, 0, *size)

    # -- buffers -------------------------------------------------------------------------------------------------------

    def _upload(self, items: Sequence[RenderItem], ground_height: float | None) -> None:
        groups: dict[tuple[TextureKey, bool, bool], list[tuple[int, VisualMesh]]] = {}
        for number, item in enumerate(items, start=1):
            for visual in item.visuals:
                if not len(visual.faces):
                    continue
                image = visual.image if visual.uv is not None else None
                texture = id(image) if image is not None else visual.material.texture if visual.uv is not None else ""
                if image is not None:
                    self._images[texture] = image
                has_holes = image is not None and image.shape[2] == 4 and bool((image[..., 3] < 255).any())
                is_opaque = visual.material.opacity >= _OPAQUE_SHARE and not has_holes
                casts = item.casts_shadow and is_opaque
                groups.setdefault((texture, casts, is_opaque), []).append((number, visual))
                self._casters[number] |= casts
        if ground_height is not None:
            mesh = box(_GROUND_M)
            self._ground[2, 3] = ground_height - _GROUND_M[2] / 2
            ground = VisualMesh(mesh.points, mesh.faces, _GROUND_MATERIAL, mesh.normals)
            groups.setdefault(("", False, True), []).append((0, ground))
        vertices, faces, start, first = [np.zeros(0, VERTEX)], [np.zeros((0, 3), np.uint32)], 0, 0
        for (texture, casts, is_opaque), visuals in groups.items():
            for number, visual in visuals:
                part = mesh_part(visual, np.eye(3), np.zeros(3), number)
                part_vertices, indices = merged_vertices([part], None)
                vertices.append(part_vertices)
                faces.append(indices.astype(np.uint32) + np.uint32(start))
                self._ranges.append(_Range(texture, casts, is_opaque, number, first, indices.size))
                start, first = start + len(part_vertices), first + indices.size
        data, triangles = np.concatenate(vertices), np.ascontiguousarray(np.concatenate(faces))
        self._low, self._high = _bounds(data, self._count)
        radii = np.linalg.norm(self._high - self._low, axis=1) / 2 + 1e-6
        self._spheres = np.column_stack([(self._low + self._high) / 2, radii])
        gl = self._gl
        self._array = self._generate("glGenVertexArrays")
        gl.glBindVertexArray(self._array)
        gl.glBindBuffer(codes.ARRAY_BUFFER, self._generate("glGenBuffers"))
        gl.glBufferData(codes.ARRAY_BUFFER, data.nbytes, data.ctypes.data, codes.STATIC_DRAW)
        gl.glBindBuffer(codes.ELEMENT_BUFFER, self._generate("glGenBuffers"))
        gl.glBufferData(codes.ELEMENT_BUFFER, triangles.nbytes, triangles.ctypes.data, codes.STATIC_DRAW)
        self._enable_attributes()
        gl.glPixelStorei(codes.UNPACK_ALIGNMENT, 1)

    def _upload_poses(self, matrices: Array) -> None:
        rows = -(-len(matrices) // _POSES_PER_ROW)
        texels = np.zeros((rows * _POSES_PER_ROW, 3, 4), dtype=np.float32)
        texels[: len(matrices)] = matrices
        width = 3 * _POSES_PER_ROW
        if rows == 1:
            width = 3 * len(matrices)
            texels = texels[: len(matrices)]
        self._bind(0, self._poses_texture)
        data = np.ascontiguousarray(texels)
        form = (codes.RGBA32F, width, rows, 0, codes.RGBA, codes.FLOAT)
        self._gl.glTexImage2D(codes.TEXTURE_2D, 0, *form, data.ctypes.data)

    def _load(self, key: TextureKey) -> int:
        """The texture of the color; 0 for none."""
        if not key:
            return 0
        if isinstance(key, str):
            return self._repeating(level[0] for level in texture_levels(key, _TEXELS))
        image = Image.fromarray(self._images[key])
        reduced = image.reduce(max(max(image.size) // _TEXELS, 1))
        return self._repeating([np.asarray(reduced.convert("RGBA"))])


def _bounds(vertices: NDArray[np.void], count: int) -> tuple[Array, Array]:
    """The lowest and the highest coordinates of the vertices of each number, count x 3 [m]."""
    numbers, points = vertices["number"].astype(np.intp), vertices["position"].astype(float)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, numbers, points)
    np.maximum.at(high, numbers, points)
    empty = ~np.isfinite(low[:, 0])
    low[empty] = high[empty] = 0.0
    return low, high
