"""glTF: a world as one binary file (.glb) that viewers, browsers and game engines show.

A node is a body; what hangs on it are the nodes below. Its extras hold its id and class. The file's own axes are
glTF's (y up, z forward), all of which its one root turns; below that everything is as the world has it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from mindstage.errors import MapWriteError
from mindstage.exports.gltf_file import GltfWriter
from mindstage.world import (
    NO_GEOMETRY,
    AttachedLight,
    Body,
    BodyGeometry,
    GeometryMap,
    Light,
    PbrMaterial,
    Pose,
    PrimitiveShape,
    PrimitiveType,
    VisualMesh,
    World,
)
from mindstage.world.frames import xyzw_from_wxyz
from mindstage.world.geometry import Array, normalized_pose_array, pose_inverse, pose_multiply
from mindstage.world.meshes import box, cylinder, sphere

__all__ = ["GlbExport", "geometry_to_glb", "world_to_glb"]

_PRIMITIVES = {PrimitiveType.BOX: box, PrimitiveType.SPHERE: sphere, PrimitiveType.CYLINDER: cylinder}

_ROOT_ROTATION = (-0.5, -0.5, -0.5, 0.5)
"""From x forward, y left, z up to z forward, x left, y up; x y z w."""
_GODOT_FROM_ROS = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Godot looks along negative z, with x to the right and y up."""
_MAX_SIZE_M = 1e30
"""What single precision, which all of glTF's numbers have, can hold with ease [m]."""


class GlbExport(NamedTuple):
    """A file, and what it does not say."""

    data: bytes
    notes: tuple[str, ...]


def world_to_glb(world: World, *, geometry: GeometryMap = NO_GEOMETRY) -> GlbExport:
    """A world as binary glTF 2.0.

    Args:
        world: what is written.
        forms: what its bodies are made of; one without a form is its shape, in its size.

    Raises:
        MapWriteError: something stands where no number leads.
    """
    document = _Document(world, geometry)
    document.write()
    return GlbExport(document.file.data(), tuple(document.notes))


def geometry_to_glb(form: BodyGeometry) -> bytes:
    """One form as a file of its own, in Godot's axes: x right, y up, forward along negative z."""
    file = GltfWriter(form.shape_name)
    turned = (_rotated_visual(skin, _GODOT_FROM_ROS) for skin in form.visuals)
    file.nodes.append(
        {"name": form.shape_name, "mesh": file.mesh(form.key, lambda: map(file.visual_primitive, turned))}
    )
    return file.data()


class _Document:
    def __init__(self, world: World, geometry: GeometryMap) -> None:
        self.world, self.geometry = world, geometry
        self.file = GltfWriter(world.name)
        self.notes: list[str] = []

    def write(self) -> None:
        """Fills the file."""
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
            for glow in self.geometry[body.id].lights if body.id in self.geometry else ():
                self._add_child(len(nodes), numbers[body.id])
                nodes.append(self._attached_light_node(body, glow))
        self._add_omission_notes()

    # -- nodes ---------------------------------------------------------------------------------------------------------

    def _add_child(self, number: int, above: int) -> None:
        self.file.nodes[above].setdefault("children", []).append(number)

    def _pose_array(self, id: str, pose: Pose) -> Array:
        row = normalized_pose_array(pose)
        if not np.isfinite(row).all():
            raise MapWriteError(repr(id), cause="its pose is none")
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
        shown = [
            (unsized, "bodies have no size; those without a mesh are nodes that show nothing"),
            (len(world.joints), "constraints have no place in glTF; they are left out"),
            (sum(len(body.facts) for body in world.bodies) + len(world.resources), "facts and resources are left out"),
            (sum(len(body.tags) for body in world.bodies), "tags are left out"),
        ]
        self.notes += [f"{count} {what}" for count, what in shown if count]

    # -- looks ---------------------------------------------------------------------------------------------------------

    def _mesh(self, body: Body) -> int | None:
        if (form := self.geometry.get(body.id)) is not None:
            return (
                self.file.mesh(form.key, lambda: map(self.file.visual_primitive, form.visuals))
                if form.visuals
                else None
            )
        if body.size is None:
            return None
        size, kind = body.size, (body.shape or PrimitiveShape()).type
        if not all(0.0 <= extent <= _MAX_SIZE_M for extent in size):
            raise MapWriteError(repr(body.id), cause=f"its size {size} is none")
        named = next((material for material in body.materials if material.color), None)
        surface = PbrMaterial() if named is None or named.color is None else PbrMaterial(color=named.color)
        name = named.name if named else ""
        return self.file.mesh((kind, size, surface, name), lambda: self._primitive_mesh(kind, size, surface, name))

    def _primitive_mesh(
        self, type: PrimitiveType, size: tuple[float, float, float], material: PbrMaterial, name: str
    ) -> Iterator[dict[str, Any]]:
        primitive = self.file.mesh_primitive(_PRIMITIVES[type](size))
        yield primitive | {"material": self.file.material(material, name=name)}


def _rotated_visual(visual: VisualMesh, turn: Array) -> VisualMesh:
    normals = None if visual.normals is None else visual.normals @ turn.T
    return VisualMesh(visual.points @ turn.T, visual.faces, visual.material, normals, visual.uv, visual.image)


def _node_transform(row: Array) -> dict[str, Sequence[float]]:
    return {"translation": (row[:3] + 0.0).tolist(), "rotation": (xyzw_from_wxyz(row[3:]) + 0.0).tolist()}
