"""Boxes of bodies in maps of Unreal's loggers: class sizes along the world's axes, and poses of mesh pivots.

Until its commit 864439a of 2021-06-15, robcog-iai/USemLog wrote as the size of a class the world-aligned bounds of the
first individual that it met: |R| b for the box b of the body and the rotation R of that individual. `with_body_boxes`
finds b, and states it with each individual of the class, so that every reader uses it; the statements about the class
stay as they are. The pose in these maps is the origin of a mesh, which is not always its center: where the evidence
says that it is the bottom or the top, the pose becomes that of the center of the box.

Each decision is an assumption with its evidence. A map with derived boxes states it (`ms:givenSizes`),
and nothing is inferred of it again.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, lru_cache
from hashlib import blake2b
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.files import cache_dir, cached_content, modules_of
from mindstage.maps.dialects.conventions import SizeFrame, UnitConventions
from mindstage.maps.dialects.map_statistics import is_constraint
from mindstage.maps.dialects.membership import pose_facts, references, types_of
from mindstage.maps.dialects.mesh_faces import Anchors, SideChoice, choose_sides
from mindstage.maps.dialects.mesh_pivots import PivotChoice, find_pivots
from mindstage.maps.dialects.source_map import SourceMap, ignore_finding
from mindstage.maps.dialects.unit_conversion import center_poses, pivot_of
from mindstage.maps.rdf_mapping.fields import ClassGeometry, parse_tags
from mindstage.maps.rdf_mapping.properties import ANGULAR_LIMITS, MESH, QUATERNION, SIZE, TRANSLATION, literal_text
from mindstage.rdf.graphs import Severity, local_name
from mindstage.rdf.vocabulary import (
    CHILD,
    GIVEN_SIZES,
    HAS_ANGULAR,
    JOINT_CLASSES,
    ONTOLOGY,
    PARENT,
    PIVOT,
    SIZES,
    TAGS_DATA,
)
from mindstage.scene import AxisMotion, Iri, Literal, PropertyAssertion
from mindstage.scene.bounding_boxes import Indices, OrientedBoxes, overlapping_pairs
from mindstage.scene.transforms import Array, normalize, rotation_matrix

__all__ = ["boxes_with_bounds", "with_body_boxes"]


_LAST_WORLD_ALIGNED = (2021, 6, 15)
"""Date of the commit since which sizes are measured along the axes of the body."""
_RIGHT_ANGLE_TOLERANCE = 1e-5
"""Difference of the elements of |R| from 0 and 1 below which R turns by right angles; maps round to 6 digits."""
_SINGULAR = 2e-3
"""Smallest singular value of |R| for which its inverse is used; it is 0 for a turn by 45 degrees."""
_SAME_BOX = 1e-3
"""Relative difference of extents below which two boxes are the same."""
_PANE_THICKNESS_M = 0.01
"""Thickness of a pane of which only the sum of width and thickness is known [m]."""
_PANE_RATIO = 0.35
"""A pane is thinner than this fraction of its second extent."""
_PANE_WORD = re.compile(r"door|drawer|front|panel|pane|window|poster|picture|frame|glass|mirror|wall|board|shel", re.I)
_ROUND_WORD = re.compile(r"(plate|saucer|bowl)s?(?![a-z])", re.I)
_MIN_ROUND_RATIO = 0.6
"""Horizontal extents of round tableware differ by no more than this factor."""
_MAX_ROUND_HEIGHT = 1.5
"""Its largest height, relative to the diameter."""
_MAX_CANDIDATES = 8
"""Number of different boxes of a class that are compared."""
_MAX_ORIENTATIONS = 64
"""Number of different orientations of a class that are tried."""
_SAME_PLACE = 0.3
"""Distance of centers, relative to the smaller of the largest extents, up to which two bodies are at one place."""
_SIMILAR_SIZE = 4.0
"""Factor of largest extents up to which bodies at one place are compared."""
_SAME_PLANE_M = 0.05
_TOUCHING, _TOUCHING_M = 0.1, 0.001
"""How much it counts that all bodies of a class touch their neighbors, and how exactly [m]."""
_CLEAR_COST, _SIMILAR_BOX_M = 0.05, 0.01
"""Difference of costs from which a box fits clearly better, and of extents from which that matters [m]."""
_MESH_CENTER_TOLERANCE = 0.01
"""Distance of a mesh's center from its origin, relative to its extent, up to which the origin counts as the center."""
_MESH_TOLERANCE = 0.05
"""Relative difference of scale factors up to which a mesh has the proportions of a box."""
_CLEAR_DIFFERENCE = 0.05
"""Difference of two protrusions, relative to the extent of a body, that counts as evidence."""
_MAX_EVIDENCE = 10.0
"""Largest weight of one kind of evidence, a logarithm of odds."""
_LOGGER_ODDS, _OTHER_ODDS = 0.8, 3.0
"""Logarithm of the odds from which sizes are along the world's axes, in maps of loggers and of others."""
_LOGGER_ID = re.compile(r"[\w-]{22}", re.ASCII)
"""SemLog's ids: 128 bits in the Base64 of URLs."""
_DATE = re.compile(r"(?<!\d)(20[12]\d)[-._/]?(0[1-9]|1[0-2])[-._/]?([0-2]\d|3[01])(?!\d)")


def with_body_boxes(source_map: SourceMap, conventions: UnitConventions) -> SourceMap:
    """Returns the map with the boxes of its bodies: sizes along their own axes, poses of their centers.

    The time is linear in the number of bodies and of pairs of bodies at one place.

    Args:
        source_map: a map of an Unreal logger, in the vocabulary of dialect 1, in SI units and ROS axes.
        conventions: the conventions that it was converted from.
    """
    stated = list(_stated_pivots(source_map))
    if stated:
        source_map = replace(source_map, graph=dict(source_map.graph))
        center_poses(source_map.graph, conventions, stated)  # type: ignore[arg-type]
    if any(fact.property == GIVEN_SIZES for fact in source_map.graph.get(source_map.map, ())):
        return _without_marker(source_map)
    bodies = _observe(source_map)
    if not bodies.groups:
        return source_map
    _add_meshes(source_map, bodies)
    graph = dict(source_map.graph)
    solver = _SizeSolver(source_map, bodies)
    if solver.frame() is SizeFrame.WORLD:
        for row, box in solver.changed_boxes():
            member = bodies.members[row]
            graph[member] = [*graph[member], *_extent_facts(box, bodies.stated[row])]
            bodies.sizes[row] = box
        graph[source_map.map] = [
            *graph.get(source_map.map, ()),
            PropertyAssertion(GIVEN_SIZES, Literal(SizeFrame.WORLD.value)),
        ]
    if any(fact.property == SIZES for fact in graph.get(source_map.map, ())):
        graph[source_map.map] = [fact for fact in graph[source_map.map] if fact.property != SIZES]
    if solver.is_logged:
        known = {member for member, _ in stated}
        offsets = _PivotFinder(source_map, bodies).offsets()
        center_poses(graph, conventions, [each for each in offsets if each[0] not in known])
    return replace(source_map, graph=graph)


def _stated_pivots(source_map: SourceMap) -> Iterator[tuple[Iri, list[float]]]:
    """Yields the individuals whose pose states a pivot, and the center in the frame of the pivot [m]."""
    for member in source_map.members:
        pose = pose_facts(source_map.graph, source_map.graph.get(member, ()))
        pivot = None if pose is None else pivot_of(pose)
        if pivot is not None:
            yield member, [-part for part in pivot]


def _without_marker(source_map: SourceMap) -> SourceMap:
    """Returns a map without the statement that its sizes are along the axes of bodies, which is the default."""
    marker = PropertyAssertion(GIVEN_SIZES, Literal(SizeFrame.BODY.value))
    facts = source_map.graph[source_map.map]
    if marker not in facts:
        return source_map
    return replace(source_map, graph={**source_map.graph, source_map.map: [fact for fact in facts if fact != marker]})


def _extent_facts(box: Array, stated: Array) -> Iterator[PropertyAssertion]:
    for codec, extent, of_class in zip(SIZE, box.tolist(), stated.tolist(), strict=True):
        if extent != of_class:
            yield PropertyAssertion(codec.property, codec.encode(extent))


# -- observation -------------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class _Group:
    """The individuals of a class, in the order of the map."""

    cls: Iri
    rows: Indices
    stated: Array
    """The extents that the map gives for the class."""
    mesh: tuple[Array, Array] | None = None
    """Extents and center of the bounds of its mesh, in the units and the frame of the mesh."""


@dataclass(slots=True)
class _Bodies:
    """The bodies with a pose and a size."""

    members: Sequence[Iri]
    positions: Array
    """n x 3 [m]."""
    rotations: Array
    """n x 3 x 3."""
    stated: Array
    """n x 3, the sizes as in the map [m]."""
    sizes: Array
    """n x 3, the sizes that have been derived [m]."""
    groups: Sequence[_Group]
    """The classes that have a size."""
    links: Indices
    """m x 2, rows of parents and children."""

    @property
    def absolute(self) -> Array:
        """|R| of each body, n x 3 x 3; exact for turns by right angles."""
        absolute = np.abs(self.rotations)
        whole = np.rint(absolute)
        right = np.abs(absolute - whole).max(axis=(1, 2), initial=0.0) < _RIGHT_ANGLE_TOLERANCE
        absolute[right] = whole[right]
        return absolute


def _observe(source_map: SourceMap) -> _Bodies:
    own = ClassGeometry([source_map.graph], source_map.hierarchy, ignore_finding)
    rows: dict[Iri, int] = {}
    positions: list[tuple[float, ...]] = []
    quaternions: list[tuple[float, ...]] = []
    sizes: list[tuple[float, ...]] = []
    groups: dict[tuple[Iri, ...], list[int]] = {}
    for member in source_map.members:
        facts = source_map.graph.get(member, ())
        types = types_of(facts)
        extents, size = [codec.first_value(facts) for codec in SIZE], own.of(facts, types)
        pose = pose_facts(source_map.graph, facts)
        complete = [extent for extent in size if extent is not None]
        if pose is None or len(complete) < len(SIZE) or is_constraint(types, source_map.hierarchy):
            continue
        if extents == [None] * len(SIZE) and any(complete):
            groups.setdefault(types, []).append(len(rows))
        rows[member] = len(rows)
        positions.append(TRANSLATION.first_value(pose) or ())
        quaternions.append(QUATERNION.first_value(pose) or ())
        sizes.append(tuple(complete))
    stated = np.array(sizes, dtype=np.float64).reshape(-1, 3)
    specific = {types: source_map.hierarchy.most_specific(types) for types in groups}
    return _Bodies(
        members=tuple(rows),
        positions=np.array(positions, dtype=np.float64).reshape(-1, 3),
        rotations=rotation_matrix(normalize(np.array(quaternions, dtype=np.float64).reshape(-1, 4))),
        stated=stated,
        sizes=stated.copy(),
        groups=[_Group(specific[types], np.array(at), stated[at[0]]) for types, at in groups.items()],
        links=_links(source_map, rows),
    )


def _add_meshes(source_map: SourceMap, bodies: _Bodies) -> None:
    """Adds the bounds of the meshes of classes, as far as files are at hand."""
    if source_map.mesh_bounds is None:
        return
    graph = source_map.graph
    names = [
        MESH.first_value([*graph.get(bodies.members[group.rows[0]], ()), *graph.get(group.cls, ())])
        for group in bodies.groups
    ]
    found = source_map.mesh_bounds([(name, group.cls) for name, group in zip(names, bodies.groups, strict=True)])
    for group, bounds in zip(bodies.groups, found, strict=True):
        if bounds is not None:
            low, high = np.array(bounds)
            group.mesh = high - low, (low + high) / 2


def _links(source_map: SourceMap, rows: Mapping[Iri, int]) -> Indices:
    """Returns the rows of parts and their wholes, and of the two bodies of each joint, the parent first."""
    found: dict[tuple[int, int], None] = {}
    for member in source_map.members:
        facts = source_map.graph.get(member, ())
        parents, children = references(facts, PARENT), references(facts, CHILD)
        if member in rows:
            pairs = [*((each, member) for each in parents), *((member, each) for each in children)]
        else:
            pairs = list(zip(parents[:1], children[:1], strict=False))
        for parent, child in pairs:
            if parent in rows and child in rows and parent != child:
                found[rows[parent], rows[child]] = None
    return np.array(list(found), dtype=np.intp).reshape(-1, 2)


# -- boxes with given bounds -------------------------------------------------------------------------------------------


def boxes_with_bounds(absolute: Array, extents: Array, *, proportions: Array | None = None) -> Array:
    """Returns the boxes that have given world-aligned bounds, n x 3 [m].

    There is one, none if every solution of |R| b = s has a negative extent, and three if |R| is singular (a turn by 45
    degrees gives only the sum of two extents): the one with equal extents, then the two that are panes. With
    proportions, the one that is closest to them comes instead.

    Args:
        absolute: |R|, 3 x 3: the absolute values of the rotation from the body to the world.
        extents: the extents s of the bounds along the axes of the world [m].
        proportions: the extents of the body's mesh, in any unit.
    """
    if np.array_equal(absolute, np.rint(absolute)):
        return np.asarray(extents[np.argmax(absolute, axis=0)][None])
    left, singular, right = np.linalg.svd(absolute)
    largest = float(extents.max())
    if singular[2] > _SINGULAR:
        box = np.asarray(np.linalg.solve(absolute, extents), dtype=np.float64)
        return _nonnegative(box[None], 5e-6 * largest / float(singular[2]))
    rank = int(np.sum(singular > _SINGULAR))
    box = right[:rank].T @ ((left[:, :rank].T @ extents) / singular[:rank])
    if np.abs(absolute @ box - extents).max() > 5e-3 * largest:
        return np.zeros((0, 3))
    if proportions is not None and proportions.any():
        bounds = absolute @ proportions
        like = proportions * (bounds @ extents / (bounds @ bounds))
        box = box + right[rank:].T @ (right[rank:] @ (like - box))
        return _nonnegative(np.asarray(box)[None], 1e-2 * largest)
    return _nonnegative(np.asarray(box)[None] if rank < 2 else _family(box, right[2]), 1e-4 * largest)


def _family(box: Array, direction: Array) -> Array:
    """Returns boxes on the line of solutions through one of them: with equal extents, and as panes."""
    known = np.abs(direction) > 0.1
    axes = np.flatnonzero(known)
    first, second = axes[:2]
    turn = direction[first] - direction[second]
    middle = box + direction * ((box[second] - box[first]) / turn if abs(turn) > 0.1 else 0.0)
    total = float(middle[first] + middle[second])
    thickness = min(_PANE_THICKNESS_M, 0.1 * total)
    panes = [middle + direction * ((thickness - middle[axis]) / direction[axis]) for axis in axes[:2]]
    return np.array([middle, *panes])


def _nonnegative(boxes: Array, tolerance: float) -> Array:
    kept = boxes[boxes.min(axis=1) >= -max(tolerance, 1e-6)]
    return np.asarray(np.round(np.maximum(kept, 0.0), 9))


@lru_cache(maxsize=1)
def _random_boxes() -> Array:
    """Returns boxes of many proportions, 3 x n; the generator is seeded."""
    return np.asarray(np.exp(np.random.default_rng(0).uniform(math.log(0.02), 0.0, size=(3, 400))))


def _chance_of_solution(absolute: Array) -> float:
    """Returns the fraction of all boxes that could be world-aligned bounds of a body of this rotation."""
    if np.linalg.svd(absolute, compute_uv=False)[2] <= _SINGULAR:
        return 0.0
    return float((np.linalg.solve(absolute, _random_boxes()).min(axis=0) >= 0.0).mean())


# -- sizes -------------------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class _Choice:
    """The possible boxes of a class."""

    group: _Group
    boxes: Array
    """n x 3; empty if no individual can have the bounds that are given."""
    priors: Array
    """n costs, higher for individuals that come later in the map."""
    costs: Array = field(default_factory=lambda: np.zeros(0))
    """n costs with those of the neighbors; empty for a single box."""
    is_repaired: bool = False
    """Whether the boxes have only two of the three extents that are given."""
    chosen: int = 0

    @property
    def box(self) -> Array:
        """The chosen box, or the extents as given."""
        return np.asarray(self.boxes[self.chosen] if len(self.boxes) else self.group.stated)

    @property
    def is_open(self) -> bool:
        """Whether the frame of the numbers matters."""
        return bool(np.abs(self.boxes - self.group.stated).max(initial=0.0) > _SAME_BOX * self.group.stated.max())

    @property
    def differs(self) -> bool:
        """Whether the box is not the one that the map gives for the class."""
        return bool(np.abs(self.box - self.group.stated).max() > _SAME_BOX * self.group.stated.max())


@dataclass(slots=True)
class _Evidence:
    """What speaks for sizes along the axes of the world."""

    total: float = 0.0
    """Logarithm of the odds."""
    reasons: list[str] = field(default_factory=list)

    def add(self, weight: float, reason: str) -> None:
        self.total += weight
        self.reasons.append(reason)


class _SizeSolver:
    """Decides which frame the sizes of a map are given in, and finds the boxes of bodies."""

    def __init__(self, source_map: SourceMap, bodies: _Bodies) -> None:
        self.source_map, self.bodies = source_map, bodies
        self.absolute = bodies.absolute
        turned = np.abs(self.absolute - np.eye(3)).max(axis=(1, 2), initial=0.0) > 0.0
        self.choices = [_choice(group, self.absolute) for group in bodies.groups if turned[group.rows].any()]
        self.is_logged, self._prior = _logger_evidence(source_map, bodies)

    def frame(self) -> SizeFrame:
        """Decides the frame, and reports it unless it makes no difference."""
        declared = _declared_frame(self.source_map)
        chosen = self.source_map.conventions.sizes
        if chosen is None and not any(choice.is_open for choice in self.choices):
            return SizeFrame.BODY
        self._settle()
        evidence = self._evidence()
        inferred = (
            SizeFrame.WORLD if evidence.total > (_LOGGER_ODDS if self.is_logged else _OTHER_ODDS) else SizeFrame.BODY
        )
        why = "; ".join(evidence.reasons) or "no body is turned"
        if chosen is not None:
            frame, text = chosen, f"chosen by the user; the evidence indicates {inferred.value} ({why})"
        elif declared is not None:
            frame, text = declared, f"declared in the map by {SIZES}"
        else:
            frame, text = inferred, why
        if frame is SizeFrame.WORLD:
            text = f"{text}; {self._outcome()}"
            self._report_impossible()
            self._report_similar()
        self.source_map.record_assumption("sizes", frame.value, text)
        return frame

    def changed_boxes(self) -> Iterator[tuple[int, Array]]:
        """Yields the row and the box of each body whose box is not the one that its class gives."""
        for choice in self.choices:
            if not np.array_equal(choice.box, choice.group.stated):
                for row in choice.group.rows.tolist():
                    yield row, choice.box

    def _settle(self) -> None:
        """Chooses the box of each class that leaves a choice; two passes, since choices depend on each other."""
        for _ in range(2):
            for choice in self.choices:
                if len(choice.boxes) > 1:
                    protruding, touching = np.transpose(
                        [self._fit(choice.group, box, self._chosen_sizes) for box in choice.boxes]
                    )
                    coplanar = [self._coplanar(choice.group, box) for box in choice.boxes]
                    choice.costs = choice.priors + protruding - _TOUCHING * touching - np.multiply(0.04, coplanar)
                    choice.chosen = int(np.argmin(choice.costs))
                    self._chosen_sizes[choice.group.rows] = choice.box

    # -- neighbors -----------------------------------------------------------------------------------------------------

    @cached_property
    def _chosen_sizes(self) -> Array:
        """The boxes of all bodies, n x 3 [m], with those that have been chosen so far."""
        sizes = self.bodies.stated.copy()
        for choice in self.choices:
            sizes[choice.group.rows] = choice.box
        return sizes

    @cached_property
    def _neighbors(self) -> tuple[Indices, Indices]:
        """Offsets and rows of the neighbors of each body: its parts, its whole, and bodies at the same place."""
        bodies = self.bodies
        largest = bodies.stated.max(axis=1, initial=0.0)
        count = len(largest)
        cubes = OrientedBoxes(
            bodies.positions, np.broadcast_to(np.eye(3), (count, 3, 3)), np.repeat(largest[:, None] / 4, 3, axis=1)
        )
        concerned = np.zeros(count, dtype=bool)
        for choice in self.choices:
            concerned[choice.group.rows] = True
        pairs = [bodies.links]
        for a, b in overlapping_pairs(cubes, concerned, np.ones(count, dtype=bool)):
            small, large = np.minimum(largest[a], largest[b]), np.maximum(largest[a], largest[b])
            distance = np.linalg.norm(bodies.positions[a] - bodies.positions[b], axis=1)
            near = (distance < _SAME_PLACE * small) & (large < _SIMILAR_SIZE * small)
            pairs.append(np.stack([a[near], b[near]], axis=1))
        both = np.concatenate([*pairs, *(pair[:, ::-1] for pair in pairs)])
        both = both[np.lexsort((both[:, 1], both[:, 0]))]
        both = both[np.diff(both, axis=0, prepend=-1).any(axis=1)]  # np.unique would load numpy.ma, which is slow
        return np.searchsorted(both[:, 0], np.arange(count + 1)), both[:, 1]

    def _fit(self, group: _Group, box: Array, sizes: Array) -> tuple[float, float]:
        """Returns how far the bodies of a class, with this box, stick out of their neighbors, and how often they touch.

        Parts of one thing and things at one place lie along each other: a handle along its door, a poster in its frame.
        The measure is the sum of the extents of the common bounds, along the axes of the neighbor, less that of the
        larger one's bounds, relative to their size. They touch where opposite faces are in one plane, as those of a
        handle and its door.

        Args:
            group: the class.
            box: its box [m].
            sizes: the boxes of all bodies, n x 3 [m].
        """
        starts, others = self._neighbors
        first, last = starts[group.rows], starts[group.rows + 1]
        number = last - first
        if not number.any():
            return 0.0, 0.0
        row = np.repeat(group.rows, number)
        other = others[np.repeat(first - np.cumsum(number) + number, number) + np.arange(number.sum())]
        to_other = np.swapaxes(self.bodies.rotations[other], 1, 2)
        mine = np.abs(to_other @ self.bodies.rotations[row]) @ box / 2
        its = np.where(np.isin(other, group.rows)[:, None], box, sizes[other]) / 2
        at = np.einsum("nij,nj->ni", to_other, self.bodies.positions[row] - self.bodies.positions[other])
        common = np.maximum(at + mine, its) - np.minimum(at - mine, -its)
        excess = common.sum(axis=1) - 2 * np.maximum(mine.sum(axis=1), its.sum(axis=1))
        size = np.minimum(mine.max(axis=1), its.max(axis=1)) * 2
        protruding = np.divide(excess, size, out=np.zeros_like(excess), where=size > 0.0)
        touching = (np.abs(np.abs(at) - mine - its) < _TOUCHING_M).any(axis=1)
        return float(protruding.mean()), float(touching.mean())

    def _coplanar(self, group: _Group, box: Array) -> float:
        """Returns the fraction of the bodies of a class that would be panes in the plane of another class's pane."""
        found = 0
        for key in self._plane_keys(group.rows, box):
            near = (self._planes.get((*key[:3], key[3] + step), set[Iri]()) for step in (-1, 0, 1))
            found += any(classes - {group.cls} for classes in near)
        return found / len(group.rows)

    @cached_property
    def _planes(self) -> Mapping[tuple[int, ...], set[Iri]]:
        """The classes of panes, by plane."""
        boxes = {id(choice.group): choice.box for choice in self.choices if len(choice.boxes) == 1}
        ambiguous = {id(choice.group) for choice in self.choices if len(choice.boxes) != 1}
        found: dict[tuple[int, ...], set[Iri]] = {}
        for group in self.bodies.groups:
            if id(group) not in ambiguous:
                for key in self._plane_keys(group.rows, boxes.get(id(group), group.stated)):
                    found.setdefault(key, set()).add(group.cls)
        return found

    def _plane_keys(self, rows: Indices, box: Array) -> list[tuple[int, ...]]:
        """Returns the rounded normal and offset of each pane; none if the box is no pane."""
        thin, middle, _ = np.argsort(box)
        if box[thin] >= _PANE_RATIO * box[middle] or box[middle] < 0.1:
            return []
        normal = np.round(self.bodies.rotations[rows][:, :, thin], 2)
        leading = np.take_along_axis(normal, np.argmax(np.abs(normal), axis=1)[:, None], axis=1)
        normal = normal * np.where(leading < 0.0, -1.0, 1.0)
        offset = np.sum(normal * self.bodies.positions[rows], axis=1)
        keys = np.concatenate([normal * 100, offset[:, None] / _SAME_PLANE_M], axis=1)
        return [tuple(key) for key in np.rint(keys).astype(int).tolist()]

    # -- evidence ------------------------------------------------------------------------------------------------------

    def _evidence(self) -> _Evidence:
        weight, reasons = self._prior
        evidence = _Evidence(weight, [*reasons])
        self._add_tilted(evidence)
        self._add_protruding(evidence)
        self._add_meshes(evidence)
        return evidence

    def _add_meshes(self, evidence: _Evidence) -> None:
        """Adds which reading gives boxes the proportions of their meshes."""
        fits: dict[SizeFrame, int] = dict.fromkeys(SizeFrame, 0)
        for choice in self.choices:
            if choice.group.mesh is not None and choice.differs:
                as_body = _unevenness(choice.group.stated, choice.group.mesh[0]) < _MESH_TOLERANCE
                as_world = _unevenness(choice.box, choice.group.mesh[0]) < _MESH_TOLERANCE
                if as_body != as_world:
                    fits[SizeFrame.BODY if as_body else SizeFrame.WORLD] += 1
        if any(fits.values()):
            world, body = fits[SizeFrame.WORLD], fits[SizeFrame.BODY]
            text = f"boxes of {world} classes have the proportions of their meshes with sizes along the world's axes"
            text = f"{text}, of {body} with sizes along their own"
            evidence.add(4.0 * (world - body), text)

    def _add_tilted(self, evidence: _Evidence) -> None:
        """Adds whether numbers of classes whose bodies are all tilted are bounds of a box at all.

        The loggers took the bounds of the first individual; that of random boxes may have them by chance.
        """
        possible: list[str] = []
        impossible: list[str] = []
        weight = 0.0
        for choice in self.choices:
            absolute, stated = self.absolute[choice.group.rows], choice.group.stated
            if (absolute == np.rint(absolute)).all(axis=(1, 2)).any():
                continue
            if abs(stated[0] - stated[1]) <= 0.01 * stated[:2].max():
                continue  # two equal horizontal extents, as those of cups, are so in both frames
            (possible if len(choice.boxes) and not choice.is_repaired else impossible).append(
                local_name(choice.group.cls)
            )
            chance = float(np.clip(_chance_of_solution(absolute[0]), 0.02, 0.95))
            if len(boxes_with_bounds(absolute[0], stated)):
                weight += math.log(0.9 / chance)
            else:
                weight += math.log((0.1 if len(choice.boxes) else 0.02) / (1.0 - chance))
        if possible or impossible:
            text = f"the sizes of {len(possible)} of {len(possible) + len(impossible)} classes of tilted bodies"
            evidence.add(weight, f"{text} are world-aligned bounds of a box{_examples(impossible, ' (not {})')}")

    def _add_protruding(self, evidence: _Evidence) -> None:
        """Adds which reading makes parts lie along each other."""
        votes: dict[SizeFrame, list[str]] = {frame: [] for frame in SizeFrame}
        weight = 0.0
        for choice in self.choices:
            if choice.differs:
                as_body, _ = self._fit(choice.group, choice.group.stated, self.bodies.stated)
                difference = as_body - self._fit(choice.group, choice.box, self._chosen_sizes)[0]
                if abs(difference) > _CLEAR_DIFFERENCE:
                    weight += float(np.clip(4.0 * difference, -2.0, 2.0))
                    votes[SizeFrame.WORLD if difference > 0.0 else SizeFrame.BODY].append(local_name(choice.group.cls))
        across, along = votes[SizeFrame.WORLD], votes[SizeFrame.BODY]
        if across:
            text = f"along their own axes, bodies of {_counted_classes(across)} would lie across their neighbors"
            evidence.add(min(weight, _MAX_EVIDENCE), f"{text}{_examples(across, ' ({})')}")
        if along:
            text = f"along the world's axes, bodies of {_counted_classes(along)} would lie across their neighbors"
            evidence.add(0.0 if across else max(weight, -_MAX_EVIDENCE), f"{text}{_examples(along, ' ({})')}")

    # -- reports -------------------------------------------------------------------------------------------------------

    def _outcome(self) -> str:
        changed = [choice for choice in self.choices if choice.differs]
        parts = [f"{_counted_classes(changed)} changed{_examples(map(_described, changed), ': {}')}"]
        open_choices = [choice for choice in self.choices if len(choice.boxes) > 1]
        if open_choices:
            names = _examples((local_name(choice.group.cls) for choice in open_choices), " ({})")
            parts.append(f"{len(open_choices)} had several solutions{names}, chosen by neighbors, else the first body")
        return "; ".join(parts)

    def _report_impossible(self) -> None:
        for choice in self.choices:
            if not len(choice.boxes) or choice.is_repaired:
                extents = " x ".join(f"{extent:g}" for extent in choice.group.stated)
                kind, action = "box", "the numbers are read along the axes of the body"
                if choice.is_repaired:
                    box = " x ".join(f"{extent:.3g}" for extent in choice.box)
                    kind, action = "round box", f"two of them are those of a round one, {box} m, which is used"
                problem = f"no {kind} has the world-aligned bounds {extents} m at the orientation of any of its bodies"
                self.source_map.report(Severity.WARNING, choice.group.cls, SIZE[0].property, problem, action)

    def _report_similar(self) -> None:
        """Reports classes that another box fits about as well, which differs from the chosen one."""
        for choice in self.choices:
            if not len(choice.costs):
                continue
            apart = np.abs(choice.boxes - choice.box).max(axis=1) > _SIMILAR_BOX_M
            likely = np.flatnonzero(apart & (choice.costs < choice.costs[choice.chosen] + _CLEAR_COST))
            if len(likely):
                other = choice.boxes[likely[np.argmin(choice.costs[likely])]]
                one, two = (" x ".join(f"{extent:.3g}" for extent in box) for box in (choice.box, other))
                problem = f"{one} m and {two} m have its world-aligned bounds at the orientations of its bodies"
                problem = f"{problem}, and fit about equally well"
                action = "the first one is used"
                self.source_map.report(Severity.WARNING, choice.group.cls, SIZE[0].property, problem, action)


def _choice(group: _Group, absolute: Array) -> _Choice:
    """Returns the different boxes that the individuals of a class may have."""
    flat = bool(_PANE_WORD.search(local_name(group.cls)))
    boxes: list[Array] = []
    priors: list[float] = []
    rounded = (np.round(absolute[group.rows], 6) + 0.0).reshape(len(group.rows), -1).tolist()
    first = dict(zip(map(tuple, reversed(rounded)), range(len(rounded) - 1, -1, -1), strict=True))
    for rank, at in enumerate(sorted(first.values())[:_MAX_ORIENTATIONS]):
        if len(boxes) >= _MAX_CANDIDATES:
            break
        proportions = None if group.mesh is None else group.mesh[0]
        solutions = boxes_with_bounds(absolute[group.rows[at]], group.stated, proportions=proportions)
        for number, box in enumerate(solutions):
            limit = _SAME_BOX * max(float(group.stated.max()), 1e-9)
            if all(np.abs(box - other).max() > limit for other in boxes):
                boxes.append(box)
                unlikely = len(solutions) > 1 and (number > 0) != flat
                unlike_mesh = 0.0 if proportions is None else _unevenness(box, proportions)
                priors.append((0.02 if rank else 0.0) + (0.05 if unlikely else 0.0) + 5.0 * unlike_mesh)
    choice = _Choice(group, np.array(boxes).reshape(-1, 3), np.array(priors))
    if _ROUND_WORD.search(local_name(group.cls)) and not _is_round(choice.boxes).any():
        repaired = [
            box
            for at in sorted(first.values())[:_MAX_CANDIDATES]
            for box in _round_boxes(absolute[group.rows[at]], group.stated)
        ]
        if repaired:
            return _Choice(
                group, np.array(repaired), 0.02 * np.arange(len(repaired), dtype=np.float64), is_repaired=True
            )
    return choice


def _is_round(boxes: Array) -> NDArray[np.bool_]:
    """Whether boxes are plausible for tableware: about as wide as deep, and not much higher."""
    least, most = boxes[:, :2].min(axis=1), boxes[:, :2].max(axis=1)
    return np.asarray((least >= _MIN_ROUND_RATIO * most) & (boxes[:, 2] <= _MAX_ROUND_HEIGHT * most))


def _round_boxes(absolute: Array, extents: Array) -> Iterator[Array]:
    """Yields the round boxes that have two of the three world-aligned extents that are given."""
    for rows in ((0, 1), (0, 2), (1, 2)):
        equations = np.stack([absolute[rows, 0] + absolute[rows, 1], absolute[rows, 2]], axis=1)
        if abs(np.linalg.det(equations)) > _SINGULAR:
            diameter, height = np.linalg.solve(equations, extents[list(rows)]).tolist()
            if 0.0 < height <= _MAX_ROUND_HEIGHT * diameter:
                yield np.round([diameter, diameter, height], 9)


def _unevenness(extents: Array, proportions: Array) -> float:
    """Returns the relative difference of the scale factors between a mesh and a box; 0 if they have the same shape."""
    if not proportions.all():
        return 0.0
    scale = extents / proportions
    return float(np.ptp(scale) / max(scale.max(), 1e-12))


def _described(choice: _Choice) -> str:
    before, after = (" x ".join(f"{extent:.3g}" for extent in extents) for extents in (choice.group.stated, choice.box))
    return f"{local_name(choice.group.cls)} {before} to {after} m"


def _counted_classes(classes: Sequence[object]) -> str:
    return f"{len(classes)} class{'' if len(classes) == 1 else 'es'}"


def _examples(names: Iterable[str], template: str) -> str:
    listed = list(names)
    more = f" and {len(listed) - 3} more" if len(listed) > 3 else ""
    return template.format(", ".join(listed[:3]) + more) if listed else ""


def _declared_frame(source_map: SourceMap) -> SizeFrame | None:
    """Returns the frame that a map declares; an invalid declaration is reported."""
    names = {frame.value: frame for frame in SizeFrame}
    for fact in source_map.graph.get(source_map.map, ()):
        if fact.property == SIZES:
            text = (literal_text(fact.value) or "").strip().lower()
            if text in names:
                return names[text]
            problem = f"{text!r} is not one of {', '.join(names)}"
            source_map.report(Severity.WARNING, source_map.map, SIZES, problem, "it is ignored, and evidence decides")
    return None


def _logger_evidence(source_map: SourceMap, bodies: _Bodies) -> tuple[bool, tuple[float, list[str]]]:
    """Returns whether an Unreal logger wrote the map, and what its date and kind say about the frame of sizes."""
    members = [bodies.members[row] for group in bodies.groups for row in group.rows.tolist()]
    with_ids = sum(_LOGGER_ID.fullmatch(local_name(member)) is not None for member in members)
    with_tags = sum(_has_semlog_tag(source_map.graph[member]) for member in members)
    if 2 * max(with_ids, with_tags) < len(members):
        return False, (0.0, [])
    date = _logged_date(source_map)
    if date is not None:
        weight = _MAX_EVIDENCE if date < _LAST_WORLD_ALIGNED else -_MAX_EVIDENCE
        when = "before" if weight > 0.0 else "since"
        return True, (weight, [f"dated {date[0]}-{date[1]:02}-{date[2]:02}, {when} the logger's change of 2021-06-15"])
    graph = source_map.graph
    ameva = any(JOINT_CLASSES.intersection(types_of(graph.get(member, ()))) for member in source_map.members)
    ameva = ameva or any(local_name(f.property) in ("maskColor", "levelName") for m in members for f in graph[m])
    if not ameva and 2 * with_ids >= len(members):
        return True, (2.0, ["SemLog's ids without AMEVA's terms: logged before 2020"])
    return True, (0.0, [])


def _has_semlog_tag(facts: Sequence[PropertyAssertion]) -> bool:
    return any(tag.type == "SemLog" for fact in facts if fact.property == TAGS_DATA for tag in parse_tags(fact.value))


def _logged_date(source_map: SourceMap) -> tuple[int, int, int] | None:
    """Returns the first date in the map's header: in its name, or in statements about it or its ontology."""
    header = [source_map.map, *(iri for iri, facts in source_map.graph.items() if ONTOLOGY in types_of(facts))]
    texts = (
        text
        for iri in header
        for text in (iri, *(literal_text(fact.value) or "" for fact in source_map.graph.get(iri, ())))
    )
    match = next((match for text in texts if (match := _DATE.search(text))), None)
    return None if match is None else (int(match[1]), int(match[2]), int(match[3]))


# -- pivots ------------------------------------------------------------------------------------------------------------

_MIN_STORED_BODIES = 50
"""What is decided about smaller maps is not kept, since it takes a few milliseconds."""
_MAX_STORED_BYTES = 64 << 20
"""Total size of the decisions, from which the least recently used files are deleted."""
_LEVEL_SINE = 0.02
"""Sine of the largest slope of an axis along which the height does not depend on the origin of a mesh."""
_SIDE_NAMES = (("back", "front"), ("right", "left"), ("bottom", "top"))
"""Sides of a box along its axes, the one at the lower coordinate first."""


class _StoredChoices(msgspec.Struct, frozen=True, array_like=True):
    """What was decided before, as in the tuples of the modules that decide."""

    pivots: list[tuple[list[float], float, bool, tuple[int, ...]]]
    sides: list[tuple[list[float], list[float], list[list[float]], tuple[int, ...]]]


def _stored_choices(
    boxes: OrientedBoxes, classes: Indices, links: Indices, anchors: Anchors
) -> tuple[list[PivotChoice], list[SideChoice]]:
    """The origins of the meshes of classes, by both kinds of evidence; see `find_pivots` and `choose_sides`.

    Those of large maps are kept in the cache directory, by all that they depend on.
    """

    def decide() -> tuple[list[PivotChoice], list[SideChoice]]:
        pivots = find_pivots(boxes, classes, links)
        given = np.array([choice.sides for choice in pivots]).reshape(-1, 3)
        return pivots, choose_sides(boxes, classes, links, anchors, given)

    def make() -> bytes:
        pivots, sides = decide()
        rows = [(each.sides.tolist(), float(each.margin), each.holds_others, each.tied) for each in pivots]
        others = [(*(values.tolist() for values in each[:3]), each.undecided) for each in sides]
        return msgspec.msgpack.encode((rows, others))

    if len(classes) < _MIN_STORED_BODIES:
        return decide()
    arrays = (
        boxes.center, boxes.rotation, boxes.half_extents, classes, links, anchors.rows, anchors.points, anchors.axes,
    )  # fmt: skip
    known = blake2b(repr((_program(), [each.shape for each in arrays])).encode(), digest_size=16)
    for each in arrays:
        known.update(np.ascontiguousarray(each).tobytes())
    path = cache_dir("pivots") / f"{known.hexdigest()}.msgpack"
    content = cached_content(path, make, max_bytes=_MAX_STORED_BYTES)
    try:
        stored = msgspec.msgpack.decode(content, type=_StoredChoices)
    except msgspec.DecodeError:  # the file is damaged
        path.unlink(missing_ok=True)
        return decide()
    pivots = [PivotChoice(np.array(sides), margin, holds, tied) for sides, margin, holds, tied in stored.pivots]
    sides = [
        SideChoice(np.array(sides), np.array(margins), np.array(chances), undecided)
        for sides, margins, chances, undecided in stored.sides
    ]
    return pivots, sides


@cache
def _program() -> tuple[object, ...]:
    return np.__version__, modules_of(Path(__file__).parents[2], ("maps/dialects", "scene"))


class _PivotFinder:
    """Finds the classes whose pose is not that of the center of a box, by their meshes, otherwise by evidence."""

    def __init__(self, source_map: SourceMap, bodies: _Bodies) -> None:
        self.source_map, self.bodies = source_map, bodies

    def offsets(self) -> Iterator[tuple[Iri, list[float]]]:
        """Yields the individuals with another pivot, and the center of their box in the frame of the mesh [m]."""
        bodies, groups = self.bodies, self.bodies.groups
        centers, classes = bodies.positions.copy(), np.full(len(bodies.members), -1)
        found: list[tuple[_Group, Array, str]] = []
        unknown: list[_Group] = []
        for group in groups:
            size = bodies.sizes[group.rows[0]]
            offset = _mesh_offset(group, size)
            if offset is None:
                classes[group.rows] = len(unknown)
                unknown.append(group)
            elif np.abs(offset).max() > _MESH_CENTER_TOLERANCE * size.max():
                centers[group.rows] += bodies.rotations[group.rows] @ offset
                found.append((group, offset, "its mesh has the origin there"))
        boxes = OrientedBoxes(centers, bodies.rotations, bodies.sizes / 2)
        choices, refined = _stored_choices(boxes, classes, bodies.links, _anchors(self.source_map, bodies))
        for group, choice, chosen in zip(unknown, choices, refined, strict=True):
            offset = chosen.sides * bodies.sizes[group.rows[0]] / 2
            if choice.tied and not chosen.sides[list(choice.tied)].any() and not chosen.undecided:
                self._report_tie(group, choice)
            if chosen.undecided:
                self._report_undecided(group, chosen)
            if offset.any():
                better = "what is around it is then held better" if choice.holds_others else "it is then held better"
                moved = np.where(choice.sides == chosen.sides, choice.margin, chosen.margins)[offset != 0.0]
                found.append((group, offset, f"{better}, margin {moved.min():.1f}"))
        if not found:
            return
        evidence = "; ".join(f"{_group_text(group)}: {reason}" for group, _, reason in found)
        sides = [f"{_side_text(offset)} of {local_name(group.cls)}" for group, offset, _ in found]
        self.source_map.record_assumption("pivots", f"{', '.join(sides)}; center of all others", evidence)
        for group, offset, _ in found:
            for row in group.rows.tolist():
                yield bodies.members[row], offset.tolist()

    def _report_tie(self, group: _Group, choice: PivotChoice) -> None:
        sides = " and ".join(f"{low} and {high}" for low, high in (_SIDE_NAMES[axis] for axis in choice.tied))
        problem = f"{sides} of its box fit equally well as the origin of its mesh, and better than the center"
        action = "along this axis, its bodies are where they are with the center"
        self.source_map.report(Severity.WARNING, group.cls, PIVOT, problem, action)

    def _report_undecided(self, group: _Group, choice: SideChoice) -> None:
        texts, kept = [], []
        for axis in choice.undecided:
            names = [_SIDE_NAMES[axis][1], "center", _SIDE_NAMES[axis][0]]
            first, second = np.argsort(-choice.chances[axis], kind="stable")[:2].tolist()
            chances = choice.chances[axis, [first, second]]
            texts.append(f"{names[first]} and {names[second]} ({chances[0]:.2f} and {chances[1]:.2f})")
            kept.append(names[int(choice.sides[axis]) + 1])
        bodies = _examples([local_name(self.bodies.members[row]) for row in group.rows.tolist()], "{}")
        problem = f"{', '.join(texts)} of its box may be the origin of its mesh, by faces in common planes"
        action = f"{' and '.join(kept)} of the box counts, for {bodies}"
        rises = np.abs(self.bodies.rotations[group.rows][:, 2, list(choice.undecided)]).max() > _LEVEL_SINE
        property = PIVOT if rises else TRANSLATION.property  # the height does not depend on what is level
        self.source_map.report(Severity.WARNING, group.cls, property, problem, action)


def _anchors(source_map: SourceMap, bodies: _Bodies) -> Anchors:
    """Returns the points of joints, which are on the smaller one of their bodies."""
    at = {member: row for row, member in enumerate(bodies.members)}
    volumes = np.prod(bodies.sizes, axis=1)
    rows: list[int] = []
    points: list[tuple[float, ...]] = []
    axes: list[Array] = []
    for member in source_map.members:
        facts = source_map.graph.get(member, ())
        types = types_of(facts)
        ends = [at[each] for each in (*references(facts, PARENT), *references(facts, CHILD)) if each in at]
        pose = pose_facts(source_map.graph, facts) if ends and member not in at else None
        point = None if pose is None else TRANSLATION.first_value(pose)
        if point is not None and (is_constraint(types, source_map.hierarchy) or JOINT_CLASSES.intersection(types)):
            rows.append(min(ends, key=volumes.__getitem__))
            points.append(point)
            axes.append(_hinge_axis(source_map, facts, QUATERNION.first_value(pose or ())))
    return Anchors(np.array(rows, dtype=np.intp), np.array(points).reshape(-1, 3), np.array(axes).reshape(-1, 3))


def _hinge_axis(source_map: SourceMap, facts: Sequence[PropertyAssertion], quaternion: Sequence[float] | None) -> Array:
    """Returns the direction that a joint turns about, if it is the only motion that its map gives; otherwise 0."""
    limits = [source_map.graph.get(node, ()) for node in references(facts, HAS_ANGULAR)]
    motions = [ANGULAR_LIMITS[name].first_value(limits[0]) for name in ("twist", "swing2", "swing1")] if limits else []
    free = [axis for axis, motion in enumerate(motions) if motion not in (None, AxisMotion.LOCKED)]
    if quaternion is None or len(free) != 1:
        return np.zeros(3)
    return np.asarray(rotation_matrix(normalize(np.array([quaternion], dtype=np.float64)))[0][:, free[0]])


def _mesh_offset(group: _Group, size: Array) -> Array | None:
    """Returns the center of a mesh in its own frame [m], or None without a mesh that has the proportions of the box."""
    if group.mesh is None or _unevenness(size, group.mesh[0]) > _MESH_TOLERANCE or not group.mesh[0].any():
        return None
    extents, center = group.mesh
    return np.asarray(center * float(size.max() / extents.max()))


def _side_text(offset: Array) -> str:
    """Returns the sides of a box that are opposite to the direction of its center, the one of z first."""
    axes = [axis for axis in (2, 0, 1) if abs(offset[axis]) > 0.05 * np.abs(offset).max()]
    return " ".join(_SIDE_NAMES[axis][int(offset[axis] < 0.0)] for axis in axes)


def _group_text(group: _Group) -> str:
    return f"{local_name(group.cls)} ({len(group.rows)} bod{'y' if len(group.rows) == 1 else 'ies'})"
