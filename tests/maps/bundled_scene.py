"""The bundled kitchen as boxes, read from its file independently of Mindstage."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pyoxigraph
from numpy.typing import NDArray

Array = NDArray[np.float64]

BUNDLED = Path(__file__).parents[2] / "src/mindstage/maps/bundled"
KITCHEN = BUNDLED / "kitchen.owl"
HOUSEHOLD = BUNDLED / "household.ttl"

KNOWROB = "http://knowrob.org/kb/knowrob.owl#"
MS = "http://mindstage.org/ontology#"
KITCHEN_NS = "http://mindstage.org/maps/kitchen.owl#"
RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
RDFS = "http://www.w3.org/2000/01/rdf-schema#"
OWL = "http://www.w3.org/2002/07/owl#"


@dataclass(frozen=True)
class Box:
    id: str
    cls: str
    size: Array
    center: Array
    rotation: Array
    mobility: str
    mass: float

    @property
    def bottom(self) -> float:
        return float(self.center[2] - self.size[2] / 2)

    @property
    def top(self) -> float:
        return float(self.center[2] + self.size[2] / 2)

    @cached_property
    def extent(self) -> Array:
        """Lower and upper corner in the world frame; exact for boxes aligned with it."""
        half = np.abs(self.rotation) @ self.size / 2
        return np.array([self.center - half, self.center + half])

    def transformed(self, rotation: Array, pivot: Array, translation: Array) -> Box:
        center = rotation @ (self.center - pivot) + pivot + translation
        return Box(self.id, self.cls, self.size, center, rotation @ self.rotation, self.mobility, self.mass)


@dataclass(frozen=True)
class Joint:
    id: str
    parent: str
    child: str
    position: Array
    rotation: Array
    motions: dict[str, int]
    limits: dict[str, float]
    middles: dict[str, float]
    """Middles of the ranges that are not symmetric about the closed position."""
    is_reversed: bool


class Scene:
    def __init__(self, path: Path) -> None:
        self.store = pyoxigraph.Store()
        self.store.load(path=str(path), format=pyoxigraph.RdfFormat.RDF_XML)
        self.boxes = {box.id: box for box in map(self._box, self._described_ids())}
        self.parents = self._parents()
        self.joints = [self._joint(id) for id in self._described_ids(constraints=True)]

    @cached_property
    def attached_to_root(self) -> dict[str, list[Box]]:
        children: dict[str, list[Box]] = defaultdict(list)
        for child, parent in self.parents.items():
            children[parent].append(self.boxes[child])
        return children

    @cached_property
    def fronts_with_joints(self) -> dict[str, Joint]:
        """Doors and drawers with their joints."""
        return {joint.child: joint for joint in self.joints}

    @cached_property
    def movable_boxes(self) -> list[Box]:
        """Dynamic bodies without a joint."""
        return [
            box for box in self.boxes.values() if box.mobility == "dynamic" and box.id not in self.fronts_with_joints
        ]

    def is_attached(self, one: str, other: str) -> bool:
        return self.parents.get(one) == other or self.parents.get(other) == one

    def are_jointed(self, one: str, other: str) -> bool:
        return any({joint.parent, joint.child} == {one, other} for joint in self.joints)

    def value(self, id: str, property: str) -> str:
        (quad,) = self.store.quads_for_pattern(_individual(id), _knowrob(property), None)
        return str(quad.object.value)

    def _described_ids(self, *, constraints: bool = False) -> list[str]:
        subjects = [quad.subject for quad in self.store.quads_for_pattern(None, _knowrob("describedInMap"), None)]
        is_constraint = (None, pyoxigraph.NamedNode(RDF + "type"), _knowrob("Constraint"))
        joints = {quad.subject for quad in self.store.quads_for_pattern(*is_constraint)}
        return sorted(local_name(subject.value) for subject in subjects if (subject in joints) == constraints)

    def _box(self, id: str) -> Box:
        types = self.store.quads_for_pattern(_individual(id), pyoxigraph.NamedNode(RDF + "type"), None)
        (cls,) = [quad.object for quad in types if quad.object.value != OWL + "NamedIndividual"]
        at, rotation = self._pose(id)
        size = np.array([self._size(cls, name) for name in ("depth", "width", "height")])
        mass = float(self.value(id, "mass"))
        return Box(id, local_name(cls.value), size, at, rotation, self.value(id, "mobility"), mass)

    def _size(self, cls: pyoxigraph.NamedNode, name: str) -> float:
        query = f"""SELECT ?value WHERE {{ {cls} <{RDFS}subClassOf> ?restriction .
            ?restriction <{OWL}onProperty> <{KNOWROB}{name}OfObject> ; <{OWL}hasValue> ?value }}"""
        (row,) = self.store.query(query)
        return float(row["value"].value)

    def _pose(self, id: str) -> tuple[Array, Array]:
        pose = local_name(self.value(id, "pose"))
        at = np.array([float(word) for word in self.value(pose, "translation").split()])
        quaternion = [float(word) for word in self.value(pose, "quaternion").split()]
        return at, rotation_matrix(quaternion)

    def _parents(self) -> dict[str, str]:
        parents: dict[str, str] = {}
        for property, swap in (("parent", False), ("child", True)):
            for quad in self.store.quads_for_pattern(None, _knowrob(property), None):
                child, parent = local_name(quad.subject.value), local_name(quad.object.value)
                if swap:
                    child, parent = parent, child
                if child in self.boxes and parent in self.boxes:
                    assert parents.setdefault(child, parent) == parent, f"{child} has two parents"
        return parents

    def _joint(self, id: str) -> Joint:
        parent, child = local_name(self.value(id, "parent")), local_name(self.value(id, "child"))
        upside_down = self.boxes[parent].mobility == "dynamic"
        case, part = (child, parent) if upside_down else (parent, child)
        at, rotation = self._pose(id)
        linear, angular = (
            local_name(self.value(id, "linearConstraint")),
            local_name(self.value(id, "angularConstraint")),
        )
        motions = {axis: int(self.value(linear, f"{axis}Motion")) for axis in "xyz"}
        motions |= {axis: int(self.value(angular, f"{axis}Motion")) for axis in ("swing1", "swing2", "twist")}
        limits = {"linear": float(self.value(linear, "limit"))}
        limits |= {axis: float(self.value(angular, f"{axis}Limit")) for axis in ("swing1", "swing2", "twist")}
        middles: dict[str, float] = {}
        for axis, node in (("x", linear), ("swing1", angular), ("swing2", angular)):
            for quad in self.store.quads_for_pattern(
                _individual(node), pyoxigraph.NamedNode(f"{MS}{axis}Middle"), None
            ):
                middles[axis] = float(str(quad.object.value))
        return Joint(id, case, part, at, rotation, motions, limits, middles, upside_down)


def separation(box: Box, others: list[Box]) -> Array:
    """How far each of the others is away along the best separating axis [m]; negative where it overlaps."""
    centers = np.array([other.center for other in others])
    rotations = np.array([other.rotation for other in others])
    halves = np.array([other.size for other in others]) / 2
    own = np.broadcast_to(box.rotation.T, (len(others), 3, 3))
    theirs = rotations.transpose(0, 2, 1)
    crosses = np.cross(own[:, :, None, :], theirs[:, None, :, :]).reshape(len(others), 9, 3)
    axes = np.concatenate([own, theirs, crosses], axis=1)
    length = np.linalg.norm(axes, axis=2)
    reach = np.abs(axes @ box.rotation) @ (box.size / 2)
    reach += np.einsum("nak,nk->na", np.abs(np.einsum("nai,nik->nak", axes, rotations)), halves)
    apart = np.abs(np.einsum("nai,ni->na", axes, centers - box.center)) - reach
    # Parallel edges have no cross product; the faces' own axes decide there.
    return np.where(length > 1e-9, apart / np.maximum(length, 1e-9), -np.inf).max(axis=1)


def rotation_matrix(quaternion: list[float]) -> Array:
    w, x, y, z = np.array(quaternion) / math.sqrt(sum(value * value for value in quaternion))
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def local_name(iri: str) -> str:
    return iri.rpartition("#")[2]


def _knowrob(name: str) -> pyoxigraph.NamedNode:
    return pyoxigraph.NamedNode(KNOWROB + name)


def _individual(id: str) -> pyoxigraph.NamedNode:
    return pyoxigraph.NamedNode(KITCHEN_NS + id)
