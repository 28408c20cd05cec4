"""Uncertainty that the maps and ontologies themselves state, of individuals and of classes.

| statement about a body or a class | value |
|---|---|
| `ms:positionDeviation` | one number, for x and y, or three, for x, y and z [m] |
| `ms:yawDeviation` | rotation about the vertical axis [rad] |
| `ms:massDeviation`, `ms:frictionDeviation`, `ms:jointFrictionDeviation` | relative to the value |

A perception of KnowRob (`knowrob:objectActedOn` with `knowrob:covariance`) states that of the pose: the variances of x,
y and z are the elements `m00`, `m11` and `m22` of its `knowrob:CovarianceMatrix`, as `set_perception_cov/2` writes it,
and that of yaw is `m55`. Of several perceptions of a body the one with the smallest deviation counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import msgspec

from mindstage.imagination.plans import Uncertainty
from mindstage.knowledge import KnowledgeBase
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import KNOWROB, ms
from mindstage.scene import FactValue, Iri, IriRef, Literal
from mindstage.simulation import Simulation

__all__ = ["StatedUncertainty", "stated_uncertainty"]

_FIELDS = {
    "position_m": ms("positionDeviation"),
    "yaw_rad": ms("yawDeviation"),
    "mass": ms("massDeviation"),
    "friction": ms("frictionDeviation"),
    "joint_friction": ms("jointFrictionDeviation"),
}
_VARIANCES = {0: "m00", 1: "m11", 2: "m22", 3: "m55"}
_Value = float | tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class StatedUncertainty:
    """What the loaded maps and ontologies state about the bodies of a simulation."""

    uncertainty: tuple[Uncertainty, ...] = ()
    """Of classes first, then of individuals; a later one precedes."""
    notes: tuple[str, ...] = ()
    """What was taken from which statement, and what was ignored and why; one sentence each."""


def stated_uncertainty(simulation: Simulation) -> StatedUncertainty:
    """The uncertainty that the knowledge base states about the bodies that a simulation has now."""
    knowledge, ids = simulation.knowledge, set(simulation.state.ids)
    stated: dict[Iri, dict[str, _Value]] = {}
    notes: list[str] = []
    for subject, values in _perceived(knowledge):
        current = stated.get(subject)
        if current is None or _spread(values) < _spread(current):
            stated[subject] = values
    for name, property in _FIELDS.items():
        for subject, assertion in knowledge.statements(property=property):
            value = _number(assertion.value, vector=name == "position_m")
            if value is None:
                cause = f"{_text(assertion.value)!r} is no standard deviation"
                notes.append(f"ms:{local_name(property)} of {local_name(subject)} is ignored: {cause}")
            else:
                stated[subject] = {**stated.get(subject, {}), name: value}
    if not stated:
        return StatedUncertainty(notes=tuple(notes))
    bodies = [body for world in simulation.worlds for body in world.bodies if body.id in ids]
    individuals, classes = {body.iri for body in bodies}, {Iri(body.cls) for body in bodies}
    of_classes, of_bodies = [], []
    for subject, values in sorted(stated.items()):
        if subject in individuals:
            of_bodies.append(Uncertainty(thing=subject, **values))  # type: ignore[arg-type]
        elif any(cls == subject or knowledge.is_a(cls, subject) for cls in classes):
            of_classes.append(Uncertainty(thing=subject, **values))  # type: ignore[arg-type]
    used = (*of_classes, *of_bodies)
    return StatedUncertainty(used, (*(_sentence(each) for each in used), *notes))


def _perceived(knowledge: KnowledgeBase) -> Iterator[tuple[Iri, dict[str, _Value]]]:
    """The deviations of pose of each perception that has a covariance, with the perceived object."""
    for perception, covariance in knowledge.statements(property=Iri(KNOWROB + "covariance")):
        if not isinstance(covariance.value, IriRef):
            continue
        variances: dict[int, float] = {}
        facts = knowledge.facts_of(covariance.value.iri)
        for axis, name in _VARIANCES.items():
            for fact in facts:
                number = _number(fact.value) if fact.property == KNOWROB + name else None
                if isinstance(number, float):
                    variances[axis] = number
        if not variances.keys() >= {0, 1, 2}:
            continue
        values: dict[str, _Value] = {
            "position_m": (math.sqrt(variances[0]), math.sqrt(variances[1]), math.sqrt(variances[2]))
        }
        if 3 in variances:
            values["yaw_rad"] = math.sqrt(variances[3])
        for fact in knowledge.facts_of(perception):
            if fact.property == KNOWROB + "objectActedOn" and isinstance(fact.value, IriRef):
                yield fact.value.iri, values


def _spread(values: dict[str, _Value]) -> float:
    position = values.get("position_m", 0.0)
    return sum(position) if isinstance(position, tuple) else 2 * position


def _number(value: FactValue, *, vector: bool = False) -> _Value | None:
    """A number of at least 0, or three; None if it is neither."""
    if not isinstance(value, Literal):
        return None
    try:
        numbers = [float(part) for part in value.text.split()]
    except ValueError:
        return None
    if not all(math.isfinite(each) and each >= 0.0 for each in numbers):
        return None
    if vector and len(numbers) == 3:
        return numbers[0], numbers[1], numbers[2]
    return numbers[0] if len(numbers) == 1 else None


def _text(value: FactValue) -> str:
    return value.text if isinstance(value, Literal) else str(getattr(value, "iri", value))


def _sentence(each: Uncertainty) -> str:
    values = {name: value for name, value in msgspec.structs.asdict(each).items() if name != "thing" and value}
    parts = (f"{name} {' '.join(f'{part:.3g}' for part in _parts(value))}" for name, value in values.items())
    return f"stated in the loaded maps or ontologies, of {local_name(Iri(each.thing))}: {', '.join(parts)}"


def _parts(value: _Value) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)
