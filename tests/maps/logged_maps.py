"""Maps as Unreal's loggers wrote them until June 2021: class sizes are world-aligned bounds, poses are mesh pivots."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from mindstage.scene.transforms import Array, normalize, quat_rotate, rotation_matrix
from tests.maps.small_maps import room_map

__all__ = ["LoggedBody", "individual_id", "logged_map", "world_bounds_of", "yaw"]


def individual_id(name: str) -> str:
    """Returns an id of 128 bits in the form that SemLog gives individuals."""
    return "A" + base64.urlsafe_b64encode(hashlib.md5(name.encode()).digest()).decode()[:21]


def yaw(degrees: float) -> tuple[float, ...]:
    """Returns the quaternion w x y z of a turn about the vertical."""
    half = np.radians(degrees) / 2
    return (float(np.cos(half)), 0.0, 0.0, float(np.sin(half)))


@dataclass(frozen=True)
class LoggedBody:
    """An actor in Unreal: its box along its own axes, and the pose of its center."""

    name: str
    cls: str
    box: tuple[float, float, float]
    position: tuple[float, float, float]
    quaternion: Sequence[float] = (1.0, 0.0, 0.0, 0.0)
    parent: str = ""
    pivot: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The origin of the mesh, relative to the center of the box."""

    @property
    def rotation(self) -> Array:
        """The rotation matrix."""
        return rotation_matrix(normalize(self.quaternion))


def world_bounds_of(body: LoggedBody) -> Array:
    """Returns the extents of the world-aligned bounds of a body."""
    return np.asarray(np.abs(body.rotation) @ np.array(body.box))


def logged_map(
    bodies: Iterable[LoggedBody], *statements: str, in_body_frame: bool = False, with_ids: bool = True
) -> str:
    """Returns the map that a logger would have written.

    Args:
        bodies: the bodies; the first of a class gives the class its size.
        statements: further statements.
        in_body_frame: whether the logger is one of after June 2021.
        with_ids: whether the individuals have SemLog's ids and tags; otherwise the map may be of any origin.
    """
    parts: list[str] = []
    sized: set[str] = set()

    def iri(name: str) -> str:
        return f":{individual_id(name) if with_ids else name}"

    for body in bodies:
        if body.cls not in sized:
            sized.add(body.cls)
            size = body.box if in_body_frame else world_bounds_of(body)
            parts += [
                f"k:{body.cls} rdfs:subClassOf [ a owl:Restriction ; owl:onProperty k:{axis}OfObject ; "
                f'owl:hasValue "{extent:.6f}"^^xsd:float ] .'
                for axis, extent in zip(("depth", "width", "height"), size, strict=True)
            ]
        place = np.add(body.position, quat_rotate(normalize(body.quaternion), body.pivot))
        numbers = [" ".join(f"{number:.6f}" for number in row) for row in (place, body.quaternion)]
        tags = f'k:tagsData "SemLog;Class,{body.cls};Id,{individual_id(body.name)};" ;' if with_ids else ""
        relation = f"k:parent {iri(body.parent)} ;" if body.parent else ""
        parts.append(
            f"{iri(body.name)} a owl:NamedIndividual, k:{body.cls} ; {tags} {relation} k:describedInMap :room ; "
            f"k:pose {iri(body.name + '-pose')} .\n{iri(body.name + '-pose')} a owl:NamedIndividual, k:Pose ; "
            f'k:translation "{numbers[0]}" ; k:quaternion "{numbers[1]}" .'
        )
    return room_map(*parts, *statements)
