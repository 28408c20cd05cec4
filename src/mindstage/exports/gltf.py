"""glTF: a world as one binary file (.glb) that viewers, browsers and game engines show.

A node is a body; what hangs on it are the nodes below. Its extras hold its id and class. The file's own axes are
glTF's (y up, z forward), all of which its one root turns; below that everything is as the world has it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from mindstage.errors import MapUnwritable
from mindstage.exports.gltf_file import GltfFile
from mindstage.world import NO_FORMS, Body, Form, Forms, Glow, Light, Pose, Shape, ShapeKind, Skin, Surface, World
from mindstage.world.frames import xyzw_from_wxyz
from mindstage.world.geometry import Array, compose, invert, unit_pose
from mindstage.world.meshes import box, cylinder, sphere

__all__ = ["Glb", "form_glb", "glb"]

_PRIMITIVES = {ShapeKind.BOX: box, ShapeKind.SPHERE: sphere, ShapeKind.CYLINDER: cylinder}

_ROOT_ROTATION = (-0.5, -0.5, -0.5, 0.5)
"""From x forward, y left, z up to z forward, x left, y up; x y z w."""
_GODOT_FROM_ROS = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Godot looks along negative z, with x to the right and y up."""
_LARGEST = 1e30
"""What single precision, which all of glTF's numbers have, can hold with ease [m]."""


class Glb(NamedTuple):
    """A file, and what it does not say."""

    data: bytes
    notes: tuple[str, ...]


def glb(world: World, *, forms: Forms = NO_FORMS) -> Glb:
    """A world as binary glTF 2.0.

    Args:
        world: what is written.
        forms: what its bodies are made of; one without a form is its shape, in its size.

    Raises:
        MapUnwritable: something stands where no number leads.
    """
    document = _Document(world, forms)
    document.write()
    return Glb(document.file.data(), tuple(document.notes))


def form_glb(form: Form) -> bytes:
    """One form as a file of its own, in Godot's axes: x right, y up, forward along negative z."""
    file = GltfFile(form.kind)
    turned = (_turned(skin, _GODOT_FROM_ROS) for skin in form.skins)
    file.nodes.append({"name": form.kind, "mesh": file.mesh(form.key, lambda: map(file.skin, turned))})
    return file.data()


class _Document:
    def __init__(self, world: World, forms: Forms) -> None:
        self.world, self.forms = world, forms
        self.file = GltfFile(world.name)
        self.notes: list[str] = []

    def write(self) -> None:
        """Fills the file."""
        world, nodes = self.world, self.file.nodes
        rows = {body.id: self._row(body.id, body.pose) for body in world.bodies}
        numbers = {body.id: number for number, body in enumerate(world.bodies, 1)}
        parents = {attachment.child: attachment.parent for attachment in world.attachments}
        nodes.append({"name": world.name, "rotation": _ROOT_ROTATION, "extras": {"iri": world.iri, "name": world.name}})
        for body in world.bodies:
            row = rows[body.id]
            if body.id in parents:
                row = compose(invert(rows[parents[body.id]]), row)
            nodes.append(self._body(body, row))
        for child, number in numbers.items():
            self._hang(number, numbers[parents[child]] if child in parents else 0)
        for light in world.lights:
            self._hang(len(nodes), 0)
            nodes.append(self._light(light))
        for body in world.bodies:
            for glow in self.forms[body.id].glows if body.id in self.forms else ():
                self._hang(len(nodes), numbers[body.id])
                nodes.append(self._glow(body, glow))
        self._tell()

    # -- nodes ---------------------------------------------------------------------------------------------------------

    def _hang(self, number: int, above: int) -> None:
        self.file.nodes[above].setdefault("children", []).append(number)

    def _row(self, id: str, pose: Pose) -> Array:
        row = unit_pose(pose)
        if not np.isfinite(row).all():
            raise MapUnwritable(repr(id), cause="its pose is none")
        return row

    def _body(self, body: Body, row: Array) -> dict[str, Any]:
        extras: dict[str, Any] = {"id": body.id, "class": body.cls, "iri": body.iri}
        physics = body.physics
        if physics.mobility is not None:
            extras["mobility"] = physics.mobility.value
        if physics.mass_kg is not None and isfinite(physics.mass_kg):
            extras["mass_kg"] = physics.mass_kg
        if body.label:
            extras["label"] = body.label
        node = {"name": body.id, "extras": extras} | _placed(row)
        mesh = self._mesh(body)
        return node if mesh is None else node | {"mesh": mesh}

    def _light(self, light: Light) -> dict[str, Any]:
        node = {"name": light.id, "extras": {"id": light.id, "iri": light.iri}}
        node |= self.file.light(light.kind, light.colour, light.intensity, name=light.id)
        return node | _placed(self._row(light.id, light.pose))

    def _glow(self, body: Body, glow: Glow) -> dict[str, Any]:
        name = f"{body.id} light"
        node = {"name": name} | self.file.light(glow.kind, glow.colour, glow.intensity, name=name)
        return node | _placed(unit_pose(glow.pose))

    def _tell(self) -> None:
        world = self.world
        unsized = sum(body.size is None and body.id not in self.forms for body in world.bodies)
        shown = [
            (unsized, "bodies have no size; those without a mesh are nodes that show nothing"),
            (len(world.constraints), "constraints have no place in glTF; they are left out"),
            (sum(len(body.facts) for body in world.bodies) + len(world.resources), "facts and resources are left out"),
            (sum(len(body.tags) for body in world.bodies), "tags are left out"),
        ]
        self.notes += [f"{count} {what}" for count, what in shown if count]

    # -- looks ---------------------------------------------------------------------------------------------------------

    def _mesh(self, body: Body) -> int | None:
        if (form := self.forms.get(body.id)) is not None:
            return self.file.mesh(form.key, lambda: map(self.file.skin, form.skins)) if form.skins else None
        if body.size is None:
            return None
        size, kind = body.size, (body.shape or Shape()).kind
        if not all(0.0 <= extent <= _LARGEST for extent in size):
            raise MapUnwritable(repr(body.id), cause=f"its size {size} is none")
        named = next((material for material in body.materials if material.colour), None)
        surface = Surface() if named is None or named.colour is None else Surface(colour=named.colour)
        name = named.name if named else ""
        return self.file.mesh((kind, size, surface, name), lambda: self._shape(kind, size, surface, name))

    def _shape(
        self, kind: ShapeKind, size: tuple[float, float, float], surface: Surface, name: str
    ) -> Iterator[dict[str, Any]]:
        primitive = self.file.triangles(_PRIMITIVES[kind](size))
        yield primitive | {"material": self.file.material(surface, name=name)}


def _turned(skin: Skin, turn: Array) -> Skin:
    normals = None if skin.normals is None else skin.normals @ turn.T
    return Skin(skin.points @ turn.T, skin.faces, skin.surface, normals, skin.uv, skin.image)


def _placed(row: Array) -> dict[str, Sequence[float]]:
    return {"translation": (row[:3] + 0.0).tolist(), "rotation": (xyzw_from_wxyz(row[3:]) + 0.0).tolist()}
