"""Pictures of scenes with MuJoCo's renderer, without a display or a browser.

The model has visual meshes only: those of one material are one mesh in the world frame, so that a map costs a few dozen
draw calls. The renderer writes what `rendering.shading` needs (color, normals, depth, sunlight, material), because its
own light is computed at the vertices, of which a wall has few.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import mujoco
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.engines.mujoco.gl_context import OffscreenContext
from mindstage.rendering.annotations import Outline, annotate
from mindstage.rendering.render_scene import RenderScene
from mindstage.rendering.shading import PixelBuffers, ViewFrame, shade, sun_direction
from mindstage.scene import BodyId, PbrMaterial, VisualMesh
from mindstage.scene.mesh import cut_above, face_normals
from mindstage.scene.transforms import Array, normalized_pose_array, quat_rotate
from mindstage.textures.baking import load_textures, texture_set

__all__ = ["MeshGroup", "mesh_groups", "render_picture", "visual_model"]


_SAMPLES = 4
"""Samples of each pixel, which smooth the edges."""
_SHADOW_SIZE_PX = 2048
_SUNS = 4
"""Directions whose shadows are averaged: the sun has an extent, so shadows have soft edges."""
_SUN_RADIUS = 0.012
_NEAR_PART = 0.02
"""Distance of the near plane, as a part of that of the nearest thing."""
_MIN_NEAR_M = 0.02
_GROUND_RADII = 12.0
"""Half the side of the ground, in radii of the scene."""
_GROUND_MATERIAL = PbrMaterial(name="ground", color=(0.80, 0.80, 0.79), roughness=0.9)
_BACKDROP_GRAY = 0.93
_OPAQUE = 0.995
"""Opacity from which MuJoCo draws a geom as an opaque one."""
_TEXTURE_PX = 1024
"""Longest side of textures."""

Bytes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class MeshGroup:
    """All triangles of one material, in the world frame."""

    points: Array
    normals: Array
    uv: Array | None
    faces: NDArray[np.int64]
    material: PbrMaterial
    image: Bytes | None
    body: BodyId | None
    """The body, for those that are outlined and therefore not merged with others."""
    casts_shadow: bool


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
    outlined = [item.id for item in highlighted]
    center, radius = _bounds(scene)
    groups = [*mesh_groups(scene, separate=outlined)]
    if scene.ground_height is not None:
        groups.append(_ground(scene.ground_height, center, radius))
    with OffscreenContext():
        rasterizer = _Rasterizer(groups, scene, size, center, radius)
        try:
            buffers = rasterizer.buffers()
            visible, whole = rasterizer.bodies(outlined)
        finally:
            rasterizer.close()
    view = ViewFrame(scene.camera, size)
    picture = shade(
        buffers,
        view,
        sun=sun_direction(scene.camera),
        lamps=scene.lights,
        ground=None if scene.ground_height is None else (scene.ground_height, center, radius),
        cut=scene.clip_height is not None,
    )
    outlines = [
        Outline(color=item.highlight, visible=visible == at, whole=whole[item.id], selected=item.id == scene.selected)
        for at, item in enumerate(highlighted, start=1)
    ]
    return annotate(picture, scene, view, buffers.depth, outlines)


# -- meshes ------------------------------------------------------------------------------------------------------------


def mesh_groups(scene: RenderScene, *, separate: Iterable[BodyId] = ()) -> Iterator[MeshGroup]:
    """Merges the meshes of what is shown by material, and clips them.

    Args:
        scene: the scene.
        separate: bodies that are not merged with others.
    """
    apart = frozenset(separate)
    parts: dict[tuple[PbrMaterial, int, BodyId | None, bool], list[tuple[Array, VisualMesh]]] = {}
    for item in scene.items:
        if not item.shown:
            continue
        pose = normalized_pose_array(item.pose)
        own = item.id if item.id in apart else None
        for visual in item.visuals:
            picture = 0 if visual.image is None else id(visual.image)
            material = replace(visual.material, name="")
            parts.setdefault((material, picture, own, item.casts_shadow), []).append((pose, visual))
    for (material, _, own, casts_shadow), members in parts.items():
        meshes = [_in_world(pose, visual) for pose, visual in members]
        starts = np.cumsum([0, *(len(points) for points, _, _, _ in meshes)])
        points, normals, uv = (np.concatenate([mesh[column] for mesh in meshes]) for column in range(3))
        faces = np.concatenate([mesh[3] + start for mesh, start in zip(meshes, starts, strict=False)])
        if scene.clip_height is not None:
            columns = np.concatenate([points, normals, uv], axis=1)
            columns, faces = cut_above(columns, faces, points[:, 2], scene.clip_height)
            points, normals, uv = columns[:, :3], columns[:, 3:6], columns[:, 6:]
        if len(faces):
            image = members[0][1].image
            textured = image is not None or bool(material.texture)
            yield MeshGroup(points, normals, uv if textured else None, faces, material, image, own, casts_shadow)


def _in_world(pose: Array, visual: VisualMesh) -> tuple[Array, Array, Array, NDArray[np.int64]]:
    """Points, normals, texture coordinates and faces; corners of flat faces are not shared."""
    points, normals, faces = visual.points, visual.normals, visual.faces.astype(np.int64)
    uv = np.zeros((len(points), 2)) if visual.uv is None else visual.uv
    if normals is None:
        normals = face_normals(points, faces).repeat(3, axis=0)
        points, uv = points[faces.reshape(-1)], uv[faces.reshape(-1)]
        faces = np.arange(len(points)).reshape(-1, 3)
    return quat_rotate(pose[3:], points) + pose[:3], quat_rotate(pose[3:], normals), uv, faces


def _ground(height: float, center: Array, radius: float) -> MeshGroup:
    half = _GROUND_RADII * radius
    corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]]) + center[:2]
    points = np.column_stack([corners, np.full(4, height - 1e-3)])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return MeshGroup(points, np.tile([0.0, 0.0, 1.0], (4, 1)), None, faces, _GROUND_MATERIAL, None, None, False)


def _bounds(scene: RenderScene) -> tuple[Array, float]:
    """The center of what is shown and the radius of a sphere around it [m]."""
    shown = [item for item in scene.items if item.shown]
    if not shown:
        return np.zeros(3), 1.0
    centers = np.array([item.pose.position for item in shown])
    reach = np.linalg.norm(np.array([item.size for item in shown]), axis=1)[:, None] / 2
    low, high = (centers - reach).min(axis=0), (centers + reach).max(axis=0)
    return (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 0.1)


# -- the model ---------------------------------------------------------------------------------------------------------


def visual_model(groups: Sequence[MeshGroup], size: tuple[int, int]) -> mujoco.MjModel:
    """Compiles a model of visual meshes, one geom for each group, in their order; without collision and dynamics.

    Args:
        groups: the meshes.
        size: width and height of the pictures [px].
    """
    spec: Any = mujoco.MjSpec()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = size
    spec.visual.quality.offsamples, spec.visual.quality.shadowsize = _SAMPLES, _SHADOW_SIZE_PX
    spec.compiler.balanceinertia = True
    materials: dict[object, str] = {}
    load_textures(group.material.texture for group in groups if group.uv is not None and group.image is None)
    for index, group in enumerate(groups):
        mesh = spec.add_mesh(name=f"mesh {index}")
        mesh.uservert, mesh.usernormal = group.points.ravel(), group.normals.ravel()
        mesh.userface = mesh.userfacenormal = group.faces.ravel()
        if group.uv is not None:
            mesh.usertexcoord, mesh.userfacetexcoord = group.uv.ravel(), group.faces.ravel()
        # The volume may be 0, and a shell needs no convex hull.
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        geom = spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name, contype=0, conaffinity=0, mass=0
        )
        if group.uv is not None:
            key: object = group.material.texture if group.image is None else id(group.image)
            if key not in materials:
                materials[key] = _add_texture(spec, group, f"texture {len(materials)}")
            geom.material = materials[key]
    model: mujoco.MjModel = spec.compile()
    return model


def _add_texture(spec: Any, group: MeshGroup, name: str) -> str:
    """Adds the picture of a group, and a white material with it."""
    image = texture_set(group.material.texture).color if group.image is None else group.image[..., :3]
    image = image[:: 1 + max(image.shape) // _TEXTURE_PX, :: 1 + max(image.shape) // _TEXTURE_PX]
    pixels = np.ascontiguousarray(image)
    texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, nchannel=3)
    texture.height, texture.width = pixels.shape[:2]
    texture.data = pixels.tobytes()
    roles = [""] * int(mujoco.mjtTextureRole.mjNTEXROLE)
    roles[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = name
    material = spec.add_material(name=name)
    material.textures = roles
    return name


# -- rendering ---------------------------------------------------------------------------------------------------------


class _Rasterizer:
    """Draws the meshes of a scene into buffers."""

    def __init__(
        self, groups: Sequence[MeshGroup], scene: RenderScene, size: tuple[int, int], center: Array, radius: float
    ) -> None:
        self._groups, self._size, self._sun = groups, size, sun_direction(scene.camera)
        self._view = ViewFrame(scene.camera, size)
        distance = float(np.linalg.norm(self._view.eye - center))
        self._near = max(_MIN_NEAR_M, _NEAR_PART * max(distance - radius, 0.0))
        self._far = 4 * (distance + (_GROUND_RADII if scene.ground_height is not None else 2.0) * radius)
        self._center, self._radius = center, radius
        self._model = visual_model([*groups, _backdrop(self._view.eye, self._far / 3)], size)
        self._model.stat.extent = 1.0
        self._model.vis.map.shadowclip = radius
        self._data = mujoco.MjData(self._model)
        mujoco.mj_kinematics(self._model, self._data)
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_50)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._scene = mujoco.MjvScene(self._model, maxgeom=len(groups) + 8)
        option, camera = mujoco.MjvOption(), mujoco.MjvCamera()
        mujoco.mjv_updateScene(
            self._model, self._data, option, None, camera, int(mujoco.mjtCatBit.mjCAT_ALL), self._scene
        )
        self._order = [self._scene.geoms[row].objid for row in range(self._scene.ngeom)]
        """The group of each geom; the backdrop follows the last group."""
        self._materials = [self._scene.geoms[row].matid for row in range(self._scene.ngeom)]
        self._set_camera()

    def close(self) -> None:
        """Frees the buffers of the renderer."""
        self._context.free()

    def buffers(self) -> PixelBuffers:
        """Draws everything that the shading needs."""
        flags = self._scene.flags
        for flag in mujoco.mjtRndFlag.__members__.values():
            if int(flag) < len(flags):
                flags[int(flag)] = 0
        self._paint_colors()
        self._set_lights([(None, 1.0)])
        color, _ = self._draw()
        self._paint_material()
        material, depth = self._draw(with_depth=True)
        self._paint_white()
        axes = [(sign * axis, sign * 0.5) for axis in np.eye(3) for sign in (1.0, -1.0)]
        self._set_axis_lights(axes)
        normal, _ = self._draw()
        flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 1
        self._set_suns()
        sun, _ = self._draw()
        flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        return PixelBuffers(color=color, normal=normal, depth=depth, sun=sun[..., 0].copy(), material=material)

    def bodies(self, outlined: Sequence[BodyId]) -> tuple[NDArray[np.int32], dict[BodyId, NDArray[np.bool_]]]:
        """Where bodies are drawn.

        Returns:
            The number of the visible body at each pixel (1 for the first of `outlined`, 0 for none), and for each body
            all pixels that it would cover if nothing were in front of it.
        """
        height, width = self._size[1], self._size[0]
        visible = np.zeros((height, width), dtype=np.int32)
        whole: dict[BodyId, NDArray[np.bool_]] = {}
        if not outlined:
            return visible, whole
        numbers = {id: number for number, id in enumerate(outlined, start=1)}
        flags = self._scene.flags
        flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
        bodies = [self._groups[at].body if at < len(self._groups) else None for at in self._order]
        for row, body in enumerate(bodies):
            opaque = self._is_opaque(row) or body is not None
            self._scene.geoms[row].segid = numbers.get(body, 0) if body is not None else (0 if opaque else -1)
        visible = self._numbers() - 1
        for id, number in numbers.items():
            for row, body in enumerate(bodies):
                self._scene.geoms[row].segid = number if body == id else -1
            whole[id] = self._numbers() - 1 == number
        flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 0
        return visible, whole

    def _numbers(self) -> NDArray[np.int32]:
        pixels, _ = self._draw()
        parts = pixels.astype(np.int32)
        numbers: NDArray[np.int32] = parts[..., 0] + 256 * parts[..., 1] + 65536 * parts[..., 2]
        return numbers

    def _set_camera(self) -> None:
        view = self._view
        for camera in self._scene.camera:
            camera.pos, camera.forward, camera.up = view.eye, view.forward, view.up
            camera.frustum_near, camera.frustum_far = self._near, self._far
            camera.frustum_center, camera.frustum_width = 0.0, view.half_width * self._near
            camera.frustum_bottom, camera.frustum_top = view.bottom * self._near, view.top * self._near

    def _is_opaque(self, row: int) -> bool:
        at = self._order[row]
        return bool(at < len(self._groups) and self._groups[at].material.opacity >= _OPAQUE)

    def _paint_colors(self) -> None:
        for row, at in enumerate(self._order):
            geom = self._scene.geoms[row]
            _reset_surface(geom)
            if at < len(self._groups):
                material = self._groups[at].material
                geom.rgba = (*material.color, material.opacity)
                if not self._groups[at].casts_shadow or material.opacity < _OPAQUE:
                    geom.category = mujoco.mjtCatBit.mjCAT_DECOR
            else:
                geom.rgba = (_BACKDROP_GRAY, _BACKDROP_GRAY, _BACKDROP_GRAY, 1.0)

    def _paint_material(self) -> None:
        """Draws roughness, metalness and emission as colors, of opaque bodies only."""
        for row, at in enumerate(self._order):
            geom = self._scene.geoms[row]
            geom.matid = -1
            if self._is_opaque(row):
                material = self._groups[at].material
                geom.rgba = (max(material.roughness, 0.01), material.metalness, min(material.emission, 1.0), 1.0)
            else:
                geom.rgba, geom.type = (0.0, 0.0, 0.0, 0.0), mujoco.mjtGeom.mjGEOM_NONE
                geom.category = mujoco.mjtCatBit.mjCAT_DECOR

    def _paint_white(self) -> None:
        for row in range(len(self._order)):
            if self._is_opaque(row):
                self._scene.geoms[row].rgba = (1.0, 1.0, 1.0, 1.0)

    def _set_lights(self, lights: Sequence[tuple[None, float]]) -> None:
        self._scene.nlight = len(lights)
        for light, (_, ambient) in zip(self._scene.lights, lights, strict=False):
            _reset_light(light)
            light.ambient = (ambient, ambient, ambient)

    def _set_axis_lights(self, axes: Sequence[tuple[Array, float]]) -> None:
        """Lights whose sum is the normal, mapped from -1…1 to 0…1."""
        self._scene.nlight = len(axes)
        for light, (axis, strength) in zip(self._scene.lights, axes, strict=False):
            _reset_light(light)
            light.dir = -axis
            light.diffuse = np.abs(axis) * strength
            light.ambient = np.abs(axis) * 0.25
        assert self._scene.nlight == len(axes)

    def _set_suns(self) -> None:
        """Several lights that cast shadows, in slightly different directions."""
        across = np.cross(self._sun, [0.0, 0.0, 1.0])
        across /= np.linalg.norm(across)
        along = np.cross(across, self._sun)
        self._scene.nlight = _SUNS
        for number, light in enumerate(list(self._scene.lights)[:_SUNS]):
            angle = (number + 0.5) * 2 * np.pi / _SUNS
            direction = self._sun + _SUN_RADIUS * (np.cos(angle) * across + np.sin(angle) * along)
            direction /= np.linalg.norm(direction)
            _reset_light(light)
            light.dir, light.castshadow = -direction, 1
            light.pos = self._center + direction * (self._near + 1.5 * self._radius)
            light.diffuse = (1 / _SUNS, 1 / _SUNS, 1 / _SUNS)

    def _draw(self, *, with_depth: bool = False) -> tuple[Bytes, NDArray[np.float32]]:
        """Draws the scene, and returns colors and depths [m] from the upper row down."""
        width, height = self._size
        viewport = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(viewport, self._scene, self._context)
        pixels = np.empty((height, width, 3), dtype=np.uint8)
        depth = np.empty((height, width), dtype=np.float32) if with_depth else None
        mujoco.mjr_readPixels(pixels, depth, viewport, self._context)
        if depth is None:
            return pixels[::-1], np.zeros((0, 0), dtype=np.float32)
        with np.errstate(divide="ignore"):
            near, far = np.float32(self._near), np.float32(self._far)
            meters = near * far / (near + depth[::-1] * (far - near))
        meters[depth[::-1] <= 0.0] = np.inf
        return pixels[::-1], meters.astype(np.float32)


def _reset_surface(geom: mujoco.MjvGeom) -> None:
    geom.emission = geom.specular = geom.reflectance = geom.shininess = 0.0


def _reset_light(light: mujoco.MjvLight) -> None:
    light.type, light.castshadow, light.headlight = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, 0, 0
    light.pos, light.dir = (0.0, 0.0, 0.0), (0.0, 0.0, -1.0)
    light.ambient = light.diffuse = light.specular = (0.0, 0.0, 0.0)


def _backdrop(eye: Array, half: float) -> MeshGroup:
    """A box around everything, seen from inside, whose color surrounds the edges of bodies."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array(list(chain.from_iterable(((a, b, c), (a, c, d)) for a, b, c, d in quads)))
    material = PbrMaterial(color=(_BACKDROP_GRAY,) * 3)
    return MeshGroup(eye + half * corners, -corners / np.sqrt(3), None, faces, material, None, None, False)
