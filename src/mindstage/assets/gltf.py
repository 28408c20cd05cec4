"""Writes worlds and geometry as binary glTF 2.0 (.glb).

Each body is a node below the body to which it is attached, with its id and class as extras. The root node rotates the
world to glTF's axes (y up, z forward); all nodes below have the world's axes.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from math import isfinite
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.errors import MapWriteError
from mindstage.scene import (
    NO_GEOMETRY,
    AttachedLight,
    Body,
    BodyGeometry,
    Color,
    GeometryMap,
    Light,
    LightType,
    PbrMaterial,
    Pose,
    PrimitiveShape,
    PrimitiveType,
    VisualMesh,
    World,
)
from mindstage.scene.colors import srgb_to_linear
from mindstage.scene.mesh import TriangleMesh, box, cylinder, sphere
from mindstage.scene.transforms import Array, normalized_pose_array, pose_inverse, pose_multiply, xyzw_from_wxyz
from mindstage.textures.images import TextureMap, TextureUri, image_png, texture_jpeg

__all__ = ["GlbExport", "GltfWriter", "geometry_to_glb", "world_to_glb"]


_FLOAT, _INDEX = 5126, 5125
_VERTICES, _ELEMENTS = 34962, 34963
"""These are codes of glTF."""
_LIGHTS, _STRENGTH = "KHR_lights_punctual", "KHR_materials_emissive_strength"
_MAX_TRANSPARENT_OPACITY = 0.999
_TYPES = {2: "VEC2", 3: "VEC3"}
_SAMPLER = {"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497}
"""Linear with mipmaps, repeated in both directions."""
_EMBEDDED_PIXELS = 512


class GltfWriter:
    """A binary glTF 2.0 document; equal meshes, materials and textures are stored once.

    A material with a procedural texture has its name as `texture` in `extras`.
    """

    def __init__(self, name: str, *, texture_uri: TextureUri | None = None) -> None:
        """Creates a document without nodes; the first node added is the root of its only scene.

        Args:
            name: the name of the scene.
            texture_uri: where the images of procedural textures are; None to embed them.
        """
        self._texture_uri = texture_uri
        self.nodes: list[dict[str, Any]] = []
        self._name = name
        self._lists: dict[str, list[dict[str, Any]]] = {}
        self._lights: list[dict[str, Any]] = []
        self._extensions: set[str] = set()
        self._binary = bytearray()
        self._cache: dict[object, Any] = {}

    def data(self) -> bytes:
        """The document as bytes: header, JSON chunk and binary chunk."""
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "Mindstage"},
            "scene": 0,
            "scenes": [{"name": self._name, "nodes": [0]}],
            "nodes": self.nodes,
        } | self._lists
        if self._binary:
            document["buffers"] = [{"byteLength": len(self._binary)}]
        if self._extensions:
            document["extensionsUsed"] = sorted(self._extensions)
        if self._lights:
            document["extensions"] = {_LIGHTS: {"lights": self._lights}}
        text = msgspec.json.encode(document)
        chunks = _chunk(b"JSON", text + b" " * (-len(text) % 4))
        if self._binary:
            chunks += _chunk(b"BIN\0", bytes(self._binary))
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    # -- meshes, materials and lights ----------------------------------------------------------------------------------

    def mesh(self, key: object, make: Callable[[], Iterable[dict[str, Any]]]) -> int:
        """The index of the mesh with a key; `make` returns its primitives when the key is new."""
        return int(self._cached(("mesh", key), lambda: self._add("meshes", {"primitives": list(make())})))

    def visual_primitive(self, visual: VisualMesh) -> dict[str, Any]:
        """A primitive with the material of a visual mesh."""
        primitive = self.mesh_primitive(TriangleMesh(visual.points, visual.faces, visual.normals))
        if visual.uv is not None:
            # texture coordinates start at the upper edge in glTF
            primitive["attributes"]["TEXCOORD_0"] = self._accessor(
                np.column_stack([visual.uv[:, 0], 1.0 - visual.uv[:, 1]])
            )
        image = None if visual.uv is None or visual.image is None else visual.image
        material = visual.material if visual.uv is not None else msgspec.structs.replace(visual.material, texture="")
        return primitive | {"material": self.material(material, image=image)}

    def mesh_primitive(self, mesh: TriangleMesh) -> dict[str, Any]:
        """A primitive without a material; its faces are flat-shaded if it has no normals."""
        attributes = {"POSITION": self._accessor(mesh.points, bounds=True)}
        if mesh.normals is not None:
            attributes["NORMAL"] = self._accessor(mesh.normals)
        view = self._append(mesh.faces.reshape(-1).astype("<u4"), _ELEMENTS)
        indices = {"bufferView": view, "componentType": _INDEX, "type": "SCALAR", "count": mesh.faces.size}
        return {"attributes": attributes, "indices": self._add("accessors", indices)}

    def material(self, pbr_material: PbrMaterial, *, image: NDArray[np.uint8] | None = None, name: str = "") -> int:
        """The index of a material; an image replaces all maps of its texture."""
        texture = None if image is None else self._texture(image)

        def make() -> int:
            light = srgb_to_linear(np.array(pbr_material.color)).tolist()
            pbr: dict[str, Any] = {
                "baseColorFactor": [*light, pbr_material.opacity],
                "metallicFactor": pbr_material.metalness,
                "roughnessFactor": pbr_material.roughness,
            }
            material: dict[str, Any] = {"pbrMetallicRoughness": pbr}
            if texture is not None:
                pbr["baseColorTexture"] = {"index": texture}
            elif pbr_material.texture:
                self._add_maps(material, pbr_material.texture)
            if title := name or pbr_material.name:
                material["name"] = title
            if pbr_material.opacity < _MAX_TRANSPARENT_OPACITY or (image is not None and image[..., 3].min() < 255):
                material["alphaMode"] = "BLEND"
            if pbr_material.emission > 0.0:
                material["emissiveFactor"] = [part * min(pbr_material.emission, 1.0) for part in light]
            if pbr_material.emission > 1.0:
                self._extensions.add(_STRENGTH)
                material["extensions"] = {_STRENGTH: {"emissiveStrength": pbr_material.emission}}
            return self._add("materials", material)

        return int(self._cached(("material", pbr_material, texture, name), make))

    def _add_maps(self, material: dict[str, Any], texture: str) -> None:
        """Adds the images of a procedural texture to a material."""
        material["extras"] = {"texture": texture}
        pbr = material["pbrMetallicRoughness"]
        for target, field, map in (
            (pbr, "baseColorTexture", TextureMap.COLOR),
            (pbr, "metallicRoughnessTexture", TextureMap.ROUGHNESS),
            (material, "normalTexture", TextureMap.NORMAL),
        ):
            if (index := self._procedural_texture(texture, map)) is not None:
                target[field] = {"index": index}

    def light(self, type: LightType, color: Color, intensity: float, *, name: str) -> dict[str, Any]:
        """The part of a node that makes it a light."""
        light: dict[str, Any] = {"type": type.value, "color": color, "intensity": intensity, "name": name}
        if type is LightType.SPOT:
            light["spot"] = {}
        self._extensions.add(_LIGHTS)
        self._lights.append(light)
        return {"extensions": {_LIGHTS: {"light": len(self._lights) - 1}}}

    # -- buffers -------------------------------------------------------------------------------------------------------

    def _cached(self, key: object, make: Callable[[], Any]) -> Any:
        if key not in self._cache:
            self._cache[key] = make()
        return self._cache[key]

    def _texture(self, pixels: NDArray[np.uint8]) -> int:
        def make() -> int:
            return self._embedded_texture(image_png(pixels), "image/png")

        return int(self._cached(("texture", pixels.shape, pixels.tobytes()), make))

    def _procedural_texture(self, name: str, map: TextureMap) -> int | None:
        """The index of an image of a procedural texture; None if it is left out."""

        def make() -> int | None:
            if self._texture_uri is None:
                return self._embedded_texture(texture_jpeg(name, map, _EMBEDDED_PIXELS), "image/jpeg")
            uri = self._texture_uri(name, map)
            return None if uri is None else self._add_texture({"uri": uri})

        index: int | None = self._cached(("texture", name, map), make)
        return index

    def _embedded_texture(self, content: bytes, type: str) -> int:
        return self._add_texture({"bufferView": self._append_bytes(content), "mimeType": type})

    def _add_texture(self, image: dict[str, Any]) -> int:
        sampler = self._cached("sampler", lambda: self._add("samplers", _SAMPLER))
        return self._add("textures", {"sampler": sampler, "source": self._add("images", image)})

    def _accessor(self, rows: Array, *, bounds: bool = False) -> int:
        numbers = rows.astype("<f4")
        view = self._append(numbers, _VERTICES)
        kind = _TYPES[rows.shape[1]]
        accessor: dict[str, Any] = {"bufferView": view, "componentType": _FLOAT, "type": kind, "count": len(rows)}
        if bounds:
            accessor |= {"min": numbers.min(axis=0).tolist(), "max": numbers.max(axis=0).tolist()}
        return self._add("accessors", accessor)

    def _append(self, numbers: NDArray[Any], target: int) -> int:
        view = self._append_bytes(numbers.tobytes())
        self._lists["bufferViews"][view]["target"] = target
        return view

    def _append_bytes(self, content: bytes) -> int:
        self._binary += b"\0" * (-len(self._binary) % 4)
        view = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": len(content)}
        self._binary += content
        return self._add("bufferViews", view)

    def _add(self, name: str, value: dict[str, Any]) -> int:
        values = self._lists.setdefault(name, [])
        values.append(value)
        return len(values) - 1


def _chunk(type: bytes, content: bytes) -> bytes:
    content += b"\0" * (-len(content) % 4)
    return struct.pack("<I4s", len(content), type) + content


_PRIMITIVES = {PrimitiveType.BOX: box, PrimitiveType.SPHERE: sphere, PrimitiveType.CYLINDER: cylinder}

_ROOT_ROTATION = (-0.5, -0.5, -0.5, 0.5)
"""Rotates x forward, y left, z up to z forward, x left, y up; x y z w."""
_GODOT_FROM_ROS = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Godot's axes are x right, y up, and negative z forward."""
_MAX_SIZE_M = 1e30
"""Limit that single precision represents with a margin [m]."""


class GlbExport(NamedTuple):
    """A glTF document, and notes on what it leaves out."""

    data: bytes
    notes: tuple[str, ...]


def world_to_glb(world: World, *, geometry: GeometryMap = NO_GEOMETRY) -> GlbExport:
    """Writes a world as binary glTF 2.0.

    Args:
        geometry: geometry of its bodies; a body without any is its primitive shape in its size.

    Raises:
        MapWriteError: a pose or size is invalid.
    """
    document = _Document(world, geometry)
    document.write()
    return GlbExport(document.file.data(), tuple(document.notes))


def geometry_to_glb(geometry: BodyGeometry) -> bytes:
    """Writes the visual meshes of a geometry in Godot's axes: x right, y up, negative z forward.

    Materials name their procedural textures in `extras`; the images are left out, since all geometries share them.
    """
    file = GltfWriter(geometry.shape_name, texture_uri=lambda _name, _map: None)
    rotated = (_rotated_visual(visual, _GODOT_FROM_ROS) for visual in geometry.visuals)
    file.nodes.append(
        {"name": geometry.shape_name, "mesh": file.mesh(geometry.key, lambda: map(file.visual_primitive, rotated))}
    )
    return file.data()


class _Document:
    def __init__(self, world: World, geometry: GeometryMap) -> None:
        self.world, self.geometry = world, geometry
        self.file = GltfWriter(world.name)
        self.notes: list[str] = []

    def write(self) -> None:
        """Builds the document."""
        world, nodes = self.world, self.file.nodes
        rows = {body.id: self._pose_array(body.id, body.pose) for body in world.bodies}
        numbers = {body.id: number for number, body in enumerate(world.bodies, 1)}
        parents = {attachment.child: attachment.parent for attachment in world.attachments}
        nodes.append({"name": world.name, "rotation": _ROOT_ROTATION, "extras": {"iri": world.iri, "name": world.name}})
        for body in world.bodies:
            row = rows[body.id]
            if body.id in parents:
                row = pose_multiply(pose_inverse(rows[parents[body.id]]), row)
            nodes.append(self._body_node(body, row))
        for child, number in numbers.items():
            self._add_child(number, numbers[parents[child]] if child in parents else 0)
        for light in world.lights:
            self._add_child(len(nodes), 0)
            nodes.append(self._light_node(light))
        for body in world.bodies:
            for attached_light in self.geometry[body.id].lights if body.id in self.geometry else ():
                self._add_child(len(nodes), numbers[body.id])
                nodes.append(self._attached_light_node(body, attached_light))
        self._add_omission_notes()

    # -- nodes ---------------------------------------------------------------------------------------------------------

    def _add_child(self, number: int, parent: int) -> None:
        self.file.nodes[parent].setdefault("children", []).append(number)

    def _pose_array(self, id: str, pose: Pose) -> Array:
        row = normalized_pose_array(pose)
        if not np.isfinite(row).all():
            raise MapWriteError(repr(id), cause="its pose is not finite")
        return row

    def _body_node(self, body: Body, row: Array) -> dict[str, Any]:
        extras: dict[str, Any] = {"id": body.id, "class": body.cls, "iri": body.iri}
        physics = body.physics
        if physics.mobility is not None:
            extras["mobility"] = physics.mobility.value
        if physics.mass_kg is not None and isfinite(physics.mass_kg):
            extras["mass_kg"] = physics.mass_kg
        if body.label:
            extras["label"] = body.label
        node = {"name": body.id, "extras": extras} | _node_transform(row)
        mesh = self._mesh(body)
        return node if mesh is None else node | {"mesh": mesh}

    def _light_node(self, light: Light) -> dict[str, Any]:
        node = {"name": light.id, "extras": {"id": light.id, "iri": light.iri}}
        node |= self.file.light(light.type, light.color, light.intensity, name=light.id)
        return node | _node_transform(self._pose_array(light.id, light.pose))

    def _attached_light_node(self, body: Body, light: AttachedLight) -> dict[str, Any]:
        name = f"{body.id} light"
        node = {"name": name} | self.file.light(light.type, light.color, light.intensity, name=name)
        return node | _node_transform(normalized_pose_array(light.pose))

    def _add_omission_notes(self) -> None:
        world = self.world
        unsized = sum(body.size is None and body.id not in self.geometry for body in world.bodies)
        omissions = [
            (unsized, "bodies have neither size nor mesh; they are nodes without a mesh"),
            (len(world.joints), "joints cannot be expressed in glTF; they are left out"),
            (sum(len(body.facts) for body in world.bodies) + len(world.resources), "facts and resources are left out"),
            (sum(len(body.tags) for body in world.bodies), "tags are left out"),
        ]
        self.notes += [f"{count} {text}" for count, text in omissions if count]

    # -- meshes --------------------------------------------------------------------------------------------------------

    def _mesh(self, body: Body) -> int | None:
        if (geometry := self.geometry.get(body.id)) is not None:
            return (
                self.file.mesh(geometry.key, lambda: map(self.file.visual_primitive, geometry.visuals))
                if geometry.visuals
                else None
            )
        if body.size is None:
            return None
        size, kind = body.size, (body.shape or PrimitiveShape()).type
        if not all(0.0 <= extent <= _MAX_SIZE_M for extent in size):
            raise MapWriteError(repr(body.id), cause=f"its size {size} is invalid")
        material = next((material for material in body.materials if material.color), None)
        surface = PbrMaterial() if material is None or material.color is None else PbrMaterial(color=material.color)
        name = material.name if material else ""
        return self.file.mesh((kind, size, surface, name), lambda: self._primitive_mesh(kind, size, surface, name))

    def _primitive_mesh(
        self, type: PrimitiveType, size: tuple[float, float, float], material: PbrMaterial, name: str
    ) -> Iterator[dict[str, Any]]:
        primitive = self.file.mesh_primitive(_PRIMITIVES[type](size))
        yield primitive | {"material": self.file.material(material, name=name)}


def _rotated_visual(visual: VisualMesh, rotation: Array) -> VisualMesh:
    normals = None if visual.normals is None else visual.normals @ rotation.T
    return VisualMesh(visual.points @ rotation.T, visual.faces, visual.material, normals, visual.uv, visual.image)


def _node_transform(row: Array) -> dict[str, Sequence[float]]:
    return {"translation": (row[:3] + 0.0).tolist(), "rotation": (xyzw_from_wxyz(row[3:]) + 0.0).tolist()}
