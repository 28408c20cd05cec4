"""Which end of a joint moves: the door, not the casing.

Maps name the two ends in any order. What speaks for an end, strongest first: that the map says so (`doorHingedWith`),
that it is a part of the other, that its class is that of a door or drawer, that it has the handle, that the map names
it as the child, and that it is smaller. Evidence for both ends is reported, and so is none: then the order of the file
counts.

A slide that moves the handle of a drawer, but not the drawer, is read as that of the drawer, which carries the handle.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mindstage.maps.dialects.joints import JointType
from mindstage.maps.dialects.normalize import DialectNormalizer, abbreviated_texts
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import CHILD, DOOR_HINGED_TO, DOOR_HINGED_WITH, HINGED_TO, TO_PARTS, TO_WHOLES
from mindstage.scene import Iri, IriRef
from mindstage.scene.joint_kinematics import ObservedBox, is_handle_class, is_moving_part_class
from mindstage.scene.transforms import Array

__all__ = ["DescribedEnd", "EndOrder", "JointEnds", "order_of_ends"]


_STATED, _PART, _CLASS, _HANDLE, _CHILD, _HINGED_TO, _SMALLER = 4.0, 3.0, 3.0, 2.0, 1.5, 1.0, 1.0
"""How much each kind of evidence counts."""
_MAX_HOLDER_GAP_M = 0.2
"""A drawer without a whole is held by the nearest fixed body, which is at most this far away [m]."""
_AXES: Array = np.eye(3)


@dataclass(frozen=True, slots=True, kw_only=True)
class DescribedEnd:
    """What a map says about a body at one end of a joint."""

    name: str
    class_names: Sequence[str] = ()
    """Local names of its classes and of their superclasses."""
    statements: Sequence[str] = ()
    """Names of the properties by which the map says that it is the one that moves."""
    is_part: bool = False
    """Whether it is a part of the other end."""
    has_handle: bool = False
    is_child: bool = False
    """Whether the map names it as the child."""
    is_hinged_to: bool = False
    """Whether the other end is `hingedTo` it, which maps state of casings."""
    volume: float | None = None
    """Volume of its box [m^3], if the size is known."""

    def evidence_against(self, other: DescribedEnd) -> Iterator[tuple[float, str]]:
        """What speaks for it as the moving end, rather than the other, with its weight."""
        yield from ((_STATED, f"{name} is stated of it") for name in self.statements)
        if self.is_part:
            yield _PART, f"it is a part of {other.name}"
        if self._is_moving_part and not other._is_moving_part:
            yield _CLASS, f"it is a {self.class_names[0]}"
        if self.has_handle and not other.has_handle:
            yield _HANDLE, "it has a handle"
        if self.is_child:
            yield _CHILD, "it is the child"
        if self.is_hinged_to:
            yield _HINGED_TO, f"{other.name} is hingedTo it"
        if self.volume is not None and other.volume is not None and self.volume < other.volume:
            yield _SMALLER, "it is smaller"

    @property
    def _is_moving_part(self) -> bool:
        return any(map(is_moving_part_class, self.class_names))


@dataclass(frozen=True, slots=True)
class EndOrder:
    """Which end of a joint moves."""

    is_second: bool
    """Whether it is the second of the two ends."""
    evidence: str
    """What speaks for it; empty if nothing does."""
    problem: str
    """What speaks against it, or that nothing decides; empty otherwise."""


def order_of_ends(first: DescribedEnd, second: DescribedEnd) -> EndOrder:
    """Decides which end moves; the second one, if the evidence for both is equal."""
    reasons = [list(one.evidence_against(other)) for one, other in ((first, second), (second, first))]
    totals = [sum(weight for weight, _ in each) for each in reasons]
    is_second = totals[1] >= totals[0]
    texts = ["; ".join(text for _, text in each) for each in reasons]
    moving, other = (second, first) if is_second else (first, second)
    against, least = texts[not is_second], totals[not is_second]
    problem = ""
    if totals[0] == totals[1]:
        what = "" if not against else f": {first.name}: {texts[0]}; {second.name}: {texts[1]}"
        problem = f"nothing decides which of {first.name} and {second.name} moves{what}"
    elif other.is_child or 2 * least >= totals[is_second]:
        problem = f"{moving.name} seems to move ({texts[is_second]}), and {other.name} too ({against})"
    return EndOrder(is_second, texts[is_second], problem)


class JointEnds:
    """The ends of the joints of one map, decided by evidence."""

    def __init__(self, normalizer: DialectNormalizer) -> None:
        self._normalizer = normalizer
        self._parts: dict[Iri, dict[Iri, None]] = {}
        self._wholes: dict[Iri, dict[Iri, None]] = {}
        for member in normalizer.members:
            for part in normalizer.references(member, *TO_PARTS):
                self._add_part(member, part)
            for whole in normalizer.references(member, *TO_WHOLES):
                self._add_part(whole, member)
        self._carried: list[str] = []

    def _add_part(self, whole: Iri, part: Iri) -> None:
        self._parts.setdefault(whole, {})[part] = None
        self._wholes.setdefault(part, {})[whole] = None

    def ordered(
        self, joint: Iri | None, first: Iri, second: Iri, *, property: str, child: Iri | None
    ) -> tuple[Iri, Iri]:
        """Returns the end that holds and the one that moves; contradictions are reported.

        Args:
            joint: the joint, if it has a name.
            first: one end.
            second: the other, which moves if nothing decides.
            property: what a finding is about.
            child: the end that the map names as the child, if it does.
        """
        order = order_of_ends(self._end(joint, first, second, child), self._end(joint, second, first, child))
        holding, moving = (first, second) if order.is_second else (second, first)
        if order.problem:
            self._normalizer.warn(joint or first, property, order.problem, f"{local_name(moving)} moves")
        return holding, moving

    def _end(self, joint: Iri | None, body: Iri, other: Iri, child: Iri | None) -> DescribedEnd:
        references, size = self._normalizer.references, self._normalizer.sizes.get(body)
        statements = [DOOR_HINGED_WITH] if joint is not None and joint in references(body, DOOR_HINGED_WITH) else []
        statements += [DOOR_HINGED_TO] if other in references(body, DOOR_HINGED_TO) else []
        return DescribedEnd(
            name=local_name(body),
            class_names=self._normalizer.class_names(body),
            statements=[local_name(each) for each in statements],
            is_part=body in self._parts.get(other, ()),
            has_handle=any(self._is_handle(part) for part in self._parts.get(body, ()) if part != other),
            is_child=body == child,
            is_hinged_to=body in references(other, HINGED_TO),
            volume=None if size is None else float(np.prod(size)),
        )

    def _is_handle(self, body: Iri) -> bool:
        return any(map(is_handle_class, self._normalizer.class_names(body)))

    def carrier(self, joint_type: JointType | None, parent: Iri, child: Iri) -> tuple[Iri, Iri]:
        """Returns the ends of a joint; those of its drawer, to which the handle is fixed, if the joint moves a handle.

        The drawer is held by its whole, or by the nearest body that is none of the parts that move.
        """
        classes = self._normalizer.class_names(parent)
        if joint_type is not JointType.PRISMATIC or not self._is_handle(child) or self._is_handle(parent):
            return parent, child
        if not any(map(is_moving_part_class, classes)):
            return parent, child
        holder, evidence = self._holder(parent, child)
        if holder is None:
            problem = f"its joint moves the handle {local_name(child)}, and nothing holds {local_name(parent)}"
            self._normalizer.warn(parent, "", problem, "the handle moves alone")
            return parent, child
        self._normalizer.assumed.setdefault(parent, []).append("parent")
        self._normalizer.add(parent, CHILD, IriRef(child))
        self._normalizer.carried_pairs.add(frozenset((parent, child)))
        self._carried.append(f"{local_name(parent)} with {local_name(child)} out of {local_name(holder)}: {evidence}")
        return holder, parent

    def _holder(self, drawer: Iri, handle: Iri) -> tuple[Iri | None, str]:
        poses = self._normalizer.poses
        wholes = [whole for whole in self._wholes.get(drawer, ()) if whole in poses and whole not in (drawer, handle)]
        if wholes:
            return wholes[0], "it is a part of it"
        box, gaps = self._normalizer.box(drawer), {}
        for body in poses:
            names = self._normalizer.class_names(body)
            can_hold = not any(is_handle_class(name) or is_moving_part_class(name) for name in names)
            if body != drawer and can_hold and self._normalizer.sizes.get(body) is not None:
                gaps[body] = _gap(box, self._normalizer.box(body))
        nearest = min(gaps, key=lambda body: gaps[body], default=None)
        if nearest is None or gaps[nearest] > _MAX_HOLDER_GAP_M:
            return None, ""
        return nearest, f"it is {1000 * gaps[nearest]:.0f} mm away, and no whole is given"

    def record_carried(self) -> None:
        """Records as an assumption which drawers move with their handles."""
        if self._carried:
            value = "what moves the handle of a drawer moves the drawer"
            self._normalizer.source_map.record_assumption("joints: handles", value, abbreviated_texts(self._carried))


def _gap(one: ObservedBox, other: ObservedBox) -> float:
    """Distance between the world-aligned bounds of two boxes [m]."""
    half = [one.half_extent_along(axis) + other.half_extent_along(axis) for axis in _AXES]
    return float(np.linalg.norm(np.maximum(np.abs(one.center - other.center) - half, 0.0)))
