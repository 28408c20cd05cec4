"""A `RenderScene` as a scene of Mitsuba 3: meshes, materials, sky, sun, lamps, ground and camera.

Meshes of one material are joined in world coordinates and read by Mitsuba's own PLY reader: a `mitsuba.Mesh` made in
Python calls Python for each ray, which is 15 times slower. Radiance is in cd/m², so that the intensities of lamps [cd]
and of directional lights [lx] are used as they are.
"""

from __future__ import annotations

import tempfile
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.files import atomic_write
from mindstage.rendering.appearance import HIGHLIGHT_OPACITY, Paint, dimmed
from mindstage.rendering.camera import CameraPose, find_occluders
from mindstage.rendering.render_scene import RenderItem, RenderLight, RenderScene
from mindstage.scene import BodyId, Color, LightType, PbrMaterial, Pose, Vector, VisualMesh
from mindstage.scene.colors import srgb_to_linear
from mindstage.scene.mesh import cut_above, face_cross_products
from mindstage.scene.transforms import Array, normalize, normalized_pose_array, pose_array, rotation_matrix
from mindstage.textures.baking import TextureSet, texture_set

__all__ = ["NORMAL_SCALE", "MitsubaScene", "Sky", "use_mitsuba"]


_GLASS_OPACITY = 0.95
"""Materials below this opacity are thin glass."""
_MIN_ROUGHNESS = 0.04
"""Smoother materials would be mirrors, whose reflections of lamps are noise."""
_EMISSION_CD_M2 = 4000.0
"""Luminance of a material of emission 1 that belongs to no lamp of known intensity, such as a lampshade."""
_LAMP_MARGIN_M = 0.06
_GROUND_GAP_M = 0.004
_GROUND_COLOR: Color = (0.72, 0.71, 0.69)
_SKY_SIZE_PX = (512, 256)
_SUN_LX = 30_000.0
_MIN_SUN_LX = 1000.0
"""A directional light of the map below it has no physical intensity; its direction and color are used."""
_FILL_FLUX_LM = 4000.0
_FILL_SIZE_M = 0.8
_PROBES = 400
_CLOSED_PART = 0.004
"""A camera that sees less than this part of the sky is in a closed room."""
_MAX_GLASS = 6
"""Largest number of panes that light passes."""
_SECTION_REFLECTANCE = 0.03
"""Of the inner side of what a section cuts open."""
_VERTICAL = 1e-6
"""A direction with smaller horizontal components is vertical; a fraction of the vertical one."""
_COINCIDENT_M = 1e-4
"""Nearer surfaces of two bodies coincide, and would be drawn as a mixture of both."""
_INSET_M = 1.5e-4
_MAX_INSETS = 6
"""Largest number of times that a surface is inset."""
_LEAST_OVERLAP_M = 1e-3
NORMAL_SCALE = 0.49
"""Factor of the normals that the scene of normals shows."""

Key = tuple[PbrMaterial, int, bool, bool, float]


def use_mitsuba() -> Any:
    """Imports Mitsuba with the variant that needs neither LLVM nor a GPU.

    Raises:
        ModuleNotFoundError: it is not installed.
    """
    import mitsuba

    mitsuba.set_variant("scalar_rgb")
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    return mitsuba


@dataclass(frozen=True, slots=True, kw_only=True)
class Sky:
    """The light of the day: a clear sky that is lighter at the horizon, and a slightly veiled sun."""

    sun_azimuth_rad: float
    """Direction of the sun, about z."""
    sun_elevation_rad: float = 0.85
    sun_lx: float = _SUN_LX
    """Illuminance of the sun on a surface that faces it; a veiled sun has less than the 100,000 lx of a clear one."""
    sky_lx: float = 9_000.0
    """Horizontal illuminance of the sky."""
    sun_color: Color = (1.0, 0.93, 0.82)
    """Linear."""
    sun_radius_rad: float = 0.035
    """Larger than the real one (0.0047), as behind thin clouds: shadows have soft edges."""

    def image(self) -> NDArray[np.float32]:
        """The radiance by direction [cd/m²], h x w x 3: rows from the zenith down, columns about z from +x."""
        width, height = _SKY_SIZE_PX
        elevation = np.pi / 2 - (np.arange(height) + 0.5) * np.pi / height
        azimuth = (np.arange(width) + 0.5) * 2 * np.pi / width
        up = np.clip(np.sin(elevation), 0.0, 1.0)[:, None, None]
        zenith, horizon = np.array([0.80, 0.92, 1.10]), np.array([1.12, 1.10, 1.05])
        above = zenith * up**0.6 + horizon * (1.0 - up**0.6)
        below = srgb_to_linear(np.array(_GROUND_COLOR)) * 0.7
        image = np.where((elevation > 0)[:, None, None], above, below) * np.ones((1, width, 1))
        solid = np.cos(elevation)[:, None] * (np.pi / height) * (2 * np.pi / width)
        weight = (solid * np.clip(np.sin(elevation), 0, None)[:, None])[..., None]
        image *= self.sky_lx / float((luminance(image)[..., None] * weight).sum())
        if self.sun_lx > 0.0:
            direction = self.sun_direction
            towards = (
                np.cos(elevation)[:, None] * np.cos(azimuth) * direction[0]
                + np.cos(elevation)[:, None] * np.sin(azimuth) * direction[1]
                + np.sin(elevation)[:, None] * direction[2]
            )
            disk = np.exp(-((np.arccos(np.clip(towards, -1, 1)) / self.sun_radius_rad) ** 2))
            color = np.array(self.sun_color) / luminance(np.array(self.sun_color))
            image += (disk / float((disk * solid).sum()) * self.sun_lx)[..., None] * color
        return image.astype(np.float32)

    @property
    def sun_direction(self) -> Array:
        """The unit vector towards the sun."""
        flat = np.cos(self.sun_elevation_rad)
        return np.array(
            [flat * np.cos(self.sun_azimuth_rad), flat * np.sin(self.sun_azimuth_rad), np.sin(self.sun_elevation_rad)]
        )


def luminance(image: Array) -> Array:
    """The luminance of linear sRGB colors (Rec. 709)."""
    weighted: Array = image @ np.array([0.2126, 0.7152, 0.0722])
    return weighted


class MitsubaScene:
    """A scene of Mitsuba; a context manager, which removes the files that it needs while it is made."""

    def __init__(self, scene: RenderScene, *, sky: Sky) -> None:
        """Converts the scene.

        Args:
            scene: what the picture shows.
            sky: the light of the day; a directional light of the map replaces the sun.
        """
        self.notes: list[str] = []
        """What was added or assumed, one sentence each."""
        self._mi, self._scene = use_mitsuba(), scene
        self._bsdfs: dict[object, Any] = {}
        self._bitmaps: dict[object, Any] = {}
        shown = [item for item in scene.items if item.shown and item.visuals]
        if scene.clip_height is not None:
            shown = [_clipped(item, scene.clip_height) for item in shown]
        self._low, self._high = _bounds(shown)
        shown = _separated(shown)
        with tempfile.TemporaryDirectory(prefix="mindstage-render-") as folder:
            self._albedo_shapes: dict[str, Any] = {}
            self._normal_shapes: dict[str, Any] = {}
            parts = dict(self._shapes(shown, Path(folder)))
            parts |= self._lights(scene.lights) | {"sky": self._sky(sky)}
            if (ground := self._ground()) is not None:
                parts["ground"] = ground
                shape = {name: ground[name] for name in ("type", "to_world")}
                self._albedo_shapes["ground"] = _emitting(shape, ground["bsdf"]["reflectance"])
                self._normal_shapes["ground"] = _emitting(shape, _rgb(_encoded(np.array([0.0, 0.0, 1.0]))))
            if (fill := self._fill(parts, scene.camera)) is not None:
                parts["fill"] = fill
            self.native = self._mi.load_dict({"type": "scene", **parts})
            self.albedo = self._mi.load_dict({"type": "scene", **self._albedo_shapes})
            """A scene whose surfaces emit their albedo, without glass: the colors behind it are seen.

            Mitsuba's integrator for such features is 60 times slower.
            """
            self.normal = self._mi.load_dict({"type": "scene", **self._normal_shapes})
            """A scene whose surfaces, also those of glass, emit their normal in the world frame, times `NORMAL_SCALE`,
            plus a half."""
            self.masks = self._masks(shown, Path(folder))
            """A scene of the highlighted bodies alone, by color."""

    def sensor(self, camera: CameraPose, size: tuple[int, int], *, alpha: bool = False) -> Any:
        """A sensor of Mitsuba for a camera and a size [px]."""
        transform = self._mi.ScalarTransform4f().look_at(list(camera.position), list(camera.look_at), _up(camera))
        return self._mi.load_dict(
            {
                "type": "perspective",
                "fov_axis": "y",
                "fov": float(np.degrees(camera.field_of_view_rad)),
                "near_clip": 0.02,
                "far_clip": 1e5,
                "principal_point_offset_y": camera.vertical_shift,
                "to_world": transform,
                "sampler": {"type": "independent"},
                "film": {
                    "type": "hdrfilm",
                    "width": size[0],
                    "height": size[1],
                    "pixel_format": "rgba" if alpha else "rgb",
                    "component_format": "float32",
                    "rfilter": {"type": "box"},  # the noise of neighbors is independent, as the denoiser requires
                },
            }
        )

    # -- bodies --------------------------------------------------------------------------------------------

    def _shapes(self, items: Sequence[RenderItem], folder: Path) -> Iterator[tuple[str, Any]]:
        groups: dict[Key, list[tuple[VisualMesh, RenderItem]]] = defaultdict(list)
        paints, lamps = _paints(items, self._scene.camera), self._lamps(items)
        for item in items:
            for visual in item.visuals:
                if not visual.faces.size:
                    continue
                paint = Paint(visual.material.color, visual.material.opacity) if item.is_marker else paints.get(item.id)
                drawn = visual if paint is None else _painted(visual, paint)
                radiance = lamps.get(item.id, _EMISSION_CD_M2 * drawn.material.emission)
                glow = radiance if drawn.material.emission > 0.0 and paint is None else 0.0
                image = 0 if drawn.image is None else id(drawn.image)
                key = (drawn.material, image, drawn.normals is not None, drawn.uv is not None, glow)
                groups[key].append((drawn, item))
        for number, (key, members) in enumerate(groups.items()):
            path = folder / f"{number}.ply"
            _write_ply(path, members, smooth=key[2], with_uv=key[3])
            shape: dict[str, Any] = {"type": "ply", "filename": str(path), "face_normals": not key[2]}
            turned = {"type": "mesh_attribute", "name": "vertex_color" if key[2] else "face_color"}
            self._normal_shapes[f"shape_{number}"] = _emitting(shape, turned)
            if not _is_glass(key[0], members[0][0].image):
                albedo = self._albedo(key[0], members[0][0].image, textured=key[3])
                self._albedo_shapes[f"shape_{number}"] = _emitting(shape, albedo)
            shape["bsdf"] = self._bsdf(key[0], members[0][0].image, textured=key[3])
            if key[4] > 0.0:
                color = srgb_to_linear(np.array(key[0].color))
                rgb = color / max(float(luminance(color)), 1e-6) * key[4]
                shape["emitter"] = {"type": "area", "radiance": _rgb(rgb)}
            yield f"shape_{number}", self._mi.load_dict(shape)

    def _lamps(self, items: Sequence[RenderItem]) -> dict[BodyId, float]:
        """The luminance of lamps with glowing materials, from the intensity of the light that is in them [cd/m²].

        A point light inside a lampshade would be shut in; instead its flux leaves the shade.
        """
        found: dict[BodyId, float] = {}
        self._inside: set[int] = set()
        for number, light in enumerate(self._scene.lights):
            if light.type is LightType.DIRECTIONAL:
                continue
            for item in items:
                glowing = [visual for visual in item.visuals if visual.material.emission > 0.0]
                if glowing and _is_in(item, light.pose.position):
                    area = sum(_area(visual) for visual in glowing)
                    flux = 4 * np.pi * light.intensity
                    found[item.id] = found.get(item.id, 0.0) + flux / (np.pi * max(area, 1e-4))
                    self._inside.add(number)
                    break
        return found

    def _masks(self, items: Sequence[RenderItem], folder: Path) -> dict[Color, Any]:
        colors: dict[Color, list[tuple[VisualMesh, RenderItem]]] = defaultdict(list)
        for item in items:
            if item.highlight is not None:
                colors[item.highlight] += [(visual, item) for visual in item.visuals if visual.faces.size]
        masks = {}
        for number, (color, members) in enumerate(colors.items()):
            path = folder / f"mask_{number}.ply"
            _write_ply(path, members, smooth=False, with_uv=False)
            masks[color] = self._mi.load_dict({"type": "scene", "shape": {"type": "ply", "filename": str(path)}})
        return masks

    # -- materials -----------------------------------------------------------------------------------------

    def _bsdf(self, material: PbrMaterial, image: NDArray[np.uint8] | None, *, textured: bool) -> Any:
        key = (replace(material, emission=0.0), None if image is None else id(image), textured)
        if key not in self._bsdfs:
            self._bsdfs[key] = self._mi.load_dict(self._describe(material, image, textured=textured))
        return self._bsdfs[key]

    def _describe(self, material: PbrMaterial, image: NDArray[np.uint8] | None, *, textured: bool) -> dict[str, Any]:
        color = srgb_to_linear(np.array(material.color))
        if _is_glass(material, image):
            # The denser the glass, the more of its color the light takes on; each pane has two surfaces.
            through = (1.0 - material.opacity + material.opacity * color) * (1 - 0.5 * material.opacity)
            through = np.sqrt(np.clip(through, 0.0, 1.0))
            return {"type": "thindielectric", "int_ior": 1.5, "specular_transmittance": _rgb(through)}
        texture = texture_set(material.texture) if material.texture and textured else None
        surface: dict[str, Any] = {
            "type": "principled",
            "base_color": self._albedo(material, image, textured=textured),
            "roughness": max(material.roughness, _MIN_ROUGHNESS),
            "metallic": material.metalness,
            "specular": 0.5,
        }
        if texture is not None:
            surface["roughness"] = self._bitmap(
                np.clip(texture.roughness.astype(np.float32) / 255.0 * material.roughness, _MIN_ROUGHNESS, 1.0)[
                    ..., None
                ],
                key=(texture.name, "roughness", material.roughness),
            )
        if texture is not None and image is None:
            surface = {"type": "normalmap", "normalmap": self._normals(texture), "bsdf": surface}
        both: dict[str, Any] = {"type": "twosided", "bsdf": surface}
        if self._scene.clip_height is not None:  # the insides of what is cut open
            both["back"] = {"type": "diffuse", "reflectance": _rgb(np.full(3, _SECTION_REFLECTANCE))}
        if image is not None and textured and image.shape[2] == 4 and image[..., 3].min() < 255:
            opacity = image[..., 3:].astype(np.float32) / 255.0
            return {"type": "mask", "opacity": self._bitmap(opacity, key=(id(image), "opacity")), "bsdf": both}
        if material.name == _VEIL and material.opacity < 1.0:
            return {"type": "mask", "opacity": material.opacity, "bsdf": both}
        return both

    def _albedo(self, material: PbrMaterial, image: NDArray[np.uint8] | None, *, textured: bool) -> Any:
        color = srgb_to_linear(np.array(material.color))
        if image is not None and textured:
            return self._color_bitmap(image[..., :3], color, key=id(image))
        if material.texture and textured:
            return self._color_bitmap(texture_set(material.texture).color, color, key=material.texture)
        return _rgb(color)

    def _color_bitmap(self, image: NDArray[np.uint8], color: Array, *, key: object) -> Any:
        """A texture that is multiplied by a color, in linear light."""
        levels = srgb_to_linear(np.arange(256) / 255.0).astype(np.float32)
        return self._bitmap(levels[image] * color.astype(np.float32), key=(key, tuple(color.tolist())))

    def _normals(self, texture: TextureSet) -> Any:
        # Mitsuba's second tangent is normal x tangent, which points upwards in the image as in glTF.
        return self._bitmap(texture.normal.astype(np.float32) / 255.0, key=(texture.name, "normal"))

    def _bitmap(self, image: NDArray[np.float32], *, key: object) -> Any:
        if key not in self._bitmaps:
            bitmap = self._mi.Bitmap(np.ascontiguousarray(image, dtype=np.float32))
            self._bitmaps[key] = self._mi.load_dict(
                {"type": "bitmap", "bitmap": bitmap, "raw": True, "wrap_mode": "repeat", "format": "fp16"}
            )
        return self._bitmaps[key]

    # -- light and ground ----------------------------------------------------------------------------------

    def _sky(self, sky: Sky) -> Any:
        shines = [light for light in self._scene.lights if light.type is LightType.DIRECTIONAL and light.intensity > 0]
        if shines:
            sky = Sky(sun_azimuth_rad=0.0, sun_lx=0.0, sky_lx=sky.sky_lx)
        # Mitsuba's environment maps have y up and begin at -z; seen from inside they are mirrored.
        matrix = [[0.0, 0.0, -1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
        to_world = self._mi.ScalarTransform4f(matrix)
        bitmap = self._mi.Bitmap(sky.image()[:, ::-1].copy())
        return {"type": "envmap", "bitmap": bitmap, "to_world": to_world}

    def _lights(self, lights: Sequence[RenderLight]) -> dict[str, Any]:
        made: dict[str, Any] = {}
        for number, light in enumerate(lights):
            if number in self._inside or light.intensity <= 0.0:
                continue
            color = srgb_to_linear(np.array(light.color))
            value = color / max(float(luminance(color)), 1e-6) * light.intensity
            position, down = _frame(light)
            if light.type is LightType.DIRECTIONAL:
                if light.intensity < _MIN_SUN_LX:
                    value *= _SUN_LX / light.intensity
                    self.notes.append(
                        f"a directional light of {light.intensity:g} lx shines with {_SUN_LX:g} lx, as a sun"
                    )
                made[f"light_{number}"] = {
                    "type": "directional",
                    "direction": down.tolist(),
                    "irradiance": _rgb(value),
                }
            elif light.type is LightType.SPOT:
                transform = self._mi.ScalarTransform4f().look_at(
                    position.tolist(), (position + down).tolist(), _across(down)
                )
                made[f"light_{number}"] = {"type": "spot", "to_world": transform, "intensity": _rgb(value)}
            else:
                made[f"light_{number}"] = {
                    "type": "point",
                    "position": position.tolist(),
                    "intensity": _rgb(value),
                }
        return made

    def _ground(self) -> dict[str, Any] | None:
        if not np.all(np.isfinite(self._low)):
            return None
        height = self._scene.ground_height
        z = float(self._low[2]) - _GROUND_GAP_M if height is None else height
        center, extent = (self._low + self._high) / 2, float(np.linalg.norm(self._high - self._low))
        transform = self._mi.ScalarTransform4f().translate([float(center[0]), float(center[1]), z])
        return {
            "type": "disk",
            "to_world": transform.scale(60.0 * extent + 20.0),
            "bsdf": {"type": "diffuse", "reflectance": _rgb(srgb_to_linear(np.array(_GROUND_COLOR)))},
        }

    def _fill(self, parts: dict[str, Any], camera: CameraPose) -> dict[str, Any] | None:
        """A lamp below the ceiling, if the camera is in a closed room without one."""
        if any(name.startswith("light_") for name in parts) or self._inside:
            return None
        bare = self._mi.load_dict({"type": "scene", **{k: v for k, v in parts.items() if k not in {"sky", "ground"}}})
        rng = np.random.default_rng(0)
        directions = normalize(rng.normal(size=(_PROBES, 3)))
        directions = directions[directions[:, 2] > 0.0]
        if np.mean([self._hit(bare, camera.position, each) is None for each in directions]) > _CLOSED_PART:
            return None
        ceiling = self._hit(bare, camera.look_at, np.array([0.0, 0.0, 1.0]))
        x, y, z = ceiling if ceiling is not None else camera.position
        transform = self._mi.ScalarTransform4f().translate([x, y, z - 0.03])
        self.notes.append(
            f"the room is closed and has no lamp: one of {_FILL_FLUX_LM:g} lm was added below the ceiling"
        )
        radiance = _FILL_FLUX_LM / (np.pi * _FILL_SIZE_M**2)
        return {
            "type": "rectangle",
            "to_world": transform.rotate([1, 0, 0], 180.0).scale(_FILL_SIZE_M / 2),
            "emitter": {"type": "area", "radiance": _rgb(np.full(3, radiance))},
        }

    def _hit(self, native: Any, origin: Vector, direction: Array) -> Vector | None:
        """Where a ray ends, through glass; None if it leaves the scene."""
        ray = self._mi.Ray3f(list(origin), direction.tolist())
        for _ in range(_MAX_GLASS):
            hit = native.ray_intersect(ray)
            if not hit.is_valid():
                return None
            if not self._mi.has_flag(hit.bsdf(ray).flags(), self._mi.BSDFFlags.Null):
                x, y, z = np.array(hit.p).ravel().tolist()
                return x, y, z
            ray = hit.spawn_ray(ray.d)
        return None


_VEIL = "occluder of a highlight"
"""The name of the material of bodies that are drawn transparent, although they are not of glass."""


def _is_glass(material: PbrMaterial, image: NDArray[np.uint8] | None) -> bool:
    return material.opacity < _GLASS_OPACITY and image is None and material.name != _VEIL


def _paints(items: Sequence[RenderItem], camera: CameraPose) -> dict[BodyId, Paint]:
    """The colors of highlighted bodies and of all others, if there are highlighted ones, as on the page."""
    rows = [row for row, item in enumerate(items) if item.highlight is not None]
    if not rows:
        return {}
    poses, sizes = pose_array(item.pose for item in items), np.array([item.size for item in items])
    blocking = set(find_occluders(np.array(camera.position), poses, sizes, np.array(rows)).tolist())
    paints = {}
    for row, item in enumerate(items):
        if item.highlight is not None:
            paints[item.id] = Paint(item.highlight)
        elif not item.is_marker:
            color = _mean_color(item.visuals)
            opacity = min((visual.material.opacity for visual in item.visuals), default=1.0)
            can_block = row in blocking and not item.is_building
            paints[item.id] = dimmed(Paint(color, max(opacity, 0.3)), as_occluder=can_block)
    return paints


def _painted(visual: VisualMesh, paint: Paint) -> VisualMesh:
    opaque = paint.opacity >= HIGHLIGHT_OPACITY
    material = PbrMaterial(
        name="" if opaque else _VEIL, color=paint.color, roughness=0.6, opacity=1.0 if opaque else paint.opacity
    )
    return VisualMesh(visual.points, visual.faces, material, visual.normals)


def _mean_color(visuals: Iterable[VisualMesh]) -> Color:
    colors = np.array([visual.material.color for visual in visuals])
    weights = np.array([_area(visual) for visual in visuals]) + 1e-9
    red, green, blue = np.average(colors, axis=0, weights=weights).tolist()
    return red, green, blue


def _write_ply(path: Path, members: Sequence[tuple[VisualMesh, RenderItem]], *, smooth: bool, with_uv: bool) -> None:
    """Writes joined meshes in world coordinates, as binary PLY."""
    names = ["x", "y", "z", *(["nx", "ny", "nz"] if smooth else []), *(["u", "v"] if with_uv else [])]
    names += ["r", "g", "b"] if smooth else []
    vertices, faces, normals, start = [], [], [], 0
    for visual, item in members:
        pose = normalized_pose_array(item.pose)
        rotation = rotation_matrix(pose[None, 3:])[0]
        columns = [visual.points @ rotation.T + pose[:3]]
        if smooth and visual.normals is not None:
            columns.append(visual.normals @ rotation.T)
        if with_uv and visual.uv is not None:
            # The first row of an image is its upper one here, and v counts from it.
            columns.append(np.column_stack([visual.uv[:, 0], 1.0 - visual.uv[:, 1]]))
        if smooth:
            columns.append(_encoded(columns[1]))
        else:
            normals.append(_face_normals(columns[0], visual.faces))
        vertices.append(np.concatenate(columns, axis=1).astype("<f4"))
        faces.append(visual.faces.astype("<u4") + np.uint32(start))
        start += len(visual.points)
    joined = np.concatenate(faces)
    color = [] if smooth else [("color", "<f4", 3)]
    table = np.empty(len(joined), dtype=[("count", "u1"), ("corners", "<u4", 3), *color])
    table["count"], table["corners"] = 3, joined
    if not smooth:
        table["color"] = _encoded(np.concatenate(normals))
    colors = "" if smooth else "".join(f"property float {name}\n" for name in "rgb")
    properties = "".join(f"property float {name}\n" for name in names)
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {start}\n{properties}"
        f"element face {len(joined)}\nproperty list uchar int vertex_indices\n{colors}end_header\n"
    )
    atomic_write(path, header.encode() + np.concatenate(vertices).tobytes() + table.tobytes())


def _encoded(normals: Array) -> Array:
    """Normals as positive colors; interpolated ones stay positive too."""
    lengths = np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1.0)
    colors: Array = 0.5 + NORMAL_SCALE * normals / lengths
    return colors


def _clipped(item: RenderItem, height: float) -> RenderItem:
    """The part of a body below a height in the world."""
    pose = normalized_pose_array(item.pose)
    up = rotation_matrix(pose[None, 3:])[0][2]
    return replace(item, visuals=tuple(_clipped_mesh(visual, up, height - pose[2]) for visual in item.visuals))


def _clipped_mesh(visual: VisualMesh, up: Array, height: float) -> VisualMesh:
    heights = visual.points @ up
    if not len(heights) or heights.max() <= height:
        return visual
    parts = [visual.points, visual.normals, visual.uv]
    columns = np.concatenate([part for part in parts if part is not None], axis=1)
    columns, faces = cut_above(columns, visual.faces, heights, height)
    normals = columns[:, 3:6] if visual.normals is not None else None
    uv = columns[:, -2:] if visual.uv is not None else None
    return VisualMesh(columns[:, :3], faces.astype(np.uint32), visual.material, normals, uv, visual.image)


def _face_normals(points: Array, faces: NDArray[np.uint32]) -> Array:
    across = face_cross_products(points, faces)
    normals: Array = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    return normals


def _bounds(items: Sequence[RenderItem]) -> tuple[Array, Array]:
    points = [
        visual.points @ rotation_matrix(normalized_pose_array(item.pose)[None, 3:])[0].T + item.pose.position
        for item in items
        for visual in item.visuals
        if len(visual.points)
    ]
    if not points:
        return np.full(3, np.inf), np.full(3, -np.inf)
    return np.min([each.min(axis=0) for each in points], axis=0), np.max([each.max(axis=0) for each in points], axis=0)


def _separated(items: Sequence[RenderItem]) -> list[RenderItem]:
    """The bodies, of which those with surfaces in the same plane are smaller by fractions of a millimeter.

    Otherwise rays hit one or the other by rounding: maps describe doors in one place, and inserts flush with their
    cases. The smaller of two bodies keeps its surface; parts of the building all do.
    """
    bounds = [_bounds([item]) for item in items]
    volumes = [float(np.prod(np.maximum(high - low, _COINCIDENT_M))) for low, high in bounds]
    order = sorted((row for row in range(len(items)) if np.isfinite(volumes[row])), key=volumes.__getitem__)
    low, high = (np.array([bounds[row][end] for row in order]).reshape(-1, 3) for end in (0, 1))
    insets = np.zeros(len(order), dtype=int)
    result = list(items)
    for at, row in enumerate(order):
        overlap = np.minimum(high[:at], high[at]) - np.maximum(low[:at], low[at])
        same = (np.abs(low[:at] - low[at]) < _COINCIDENT_M) | (np.abs(high[:at] - high[at]) < _COINCIDENT_M)
        # Two faces fight only where they overlap, so along both other axes.
        wide = overlap > _LEAST_OVERLAP_M
        meets = np.stack([same[:, axis] & wide[:, axis - 1] & wide[:, axis - 2] for axis in range(3)]).any(axis=0)
        if not meets.any() or items[row].is_building:
            continue
        insets[at] = min(int(insets[:at][meets].max()) + 1, _MAX_INSETS)
        result[row] = _inset(items[row], _INSET_M * insets[at])
    return result


def _inset(item: RenderItem, by: float) -> RenderItem:
    """A body whose bounding box is smaller by a length on all sides [m]."""
    low, high = _bounds([replace(item, pose=Pose())])
    middle, scale = (low + high) / 2, 1.0 - 2 * by / np.maximum(high - low, 4 * by)
    visuals = (
        VisualMesh(
            middle + (each.points - middle) * scale, each.faces, each.material, each.normals, each.uv, each.image
        )
        for each in item.visuals
    )
    return replace(item, visuals=tuple(visuals))


def _is_in(item: RenderItem, point: Vector) -> bool:
    pose = normalized_pose_array(item.pose)
    local = (np.array(point) - pose[:3]) @ rotation_matrix(pose[None, 3:])[0]
    return bool(np.all(np.abs(local) < np.array(item.size) / 2 + _LAMP_MARGIN_M))


def _area(visual: VisualMesh) -> float:
    return float(np.linalg.norm(face_cross_products(visual.points, visual.faces), axis=1).sum() / 2)


def _frame(light: RenderLight) -> tuple[Array, Array]:
    """The position of a light, and the direction in which it shines."""
    pose = normalized_pose_array(light.pose)
    return pose[:3], -rotation_matrix(pose[None, 3:])[0][:, 2]


def _across(direction: Array) -> list[float]:
    """Any direction that is not parallel."""
    return [0.0, 0.0, 1.0] if abs(direction[2]) < 0.9 else [1.0, 0.0, 0.0]


def _up(camera: CameraPose) -> list[float]:
    """The vertical; for a camera that looks straight down or up, north."""
    x, y, z = np.abs(np.subtract(camera.look_at, camera.position)).tolist()
    return [0.0, 0.0, 1.0] if max(x, y) > _VERTICAL * z else [0.0, 1.0, 0.0]


def _emitting(shape: Mapping[str, Any], radiance: Any) -> dict[str, Any]:
    return {**shape, "emitter": {"type": "area", "radiance": radiance}}


def _rgb(value: Array) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(part) for part in value]}
