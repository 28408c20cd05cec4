"""Settling: how a map's numbers are meant, decided once for each map and said aloud.

What the user says counts first, then what the map itself says, then the evidence where a dialect leaves it open, and
last what is usual in the dialect.
"""

from __future__ import annotations

from enum import Enum
from typing import Any, TypeVar

from mindstage.knowledge.findings import Severity
from mindstage.knowledge.reading.conventions import Handedness, LengthUnit, QuaternionOrder, UnitConventions
from mindstage.knowledge.reading.evidence import ConventionEvidence, ConventionGuess, collect_evidence
from mindstage.knowledge.reading.excerpt import SourceMap
from mindstage.knowledge.vocabulary import FRAME, QUATERNION_ORDER, UNITS
from mindstage.knowledge.wording.words import literal_text
from mindstage.world import Iri

__all__ = ["default_conventions", "infer_conventions"]

ConventionT = TypeVar("ConventionT", bound=Enum)


def infer_conventions(source_map: SourceMap, defaults: UnitConventions) -> UnitConventions:
    """The conventions of a map whose dialect leaves them open.

    Args:
        excerpt: the map.
        usual: what holds where nothing speaks for anything.
    """
    evidence = collect_evidence(source_map)
    units = _decide(source_map, "units", UNITS, LengthUnit, defaults.units, evidence.guess_units())
    frame = _decide(source_map, "frame", FRAME, Handedness, defaults.frame, _guess_handedness(units, evidence))
    order = evidence.guess_quaternion_order()
    quaternion = _decide(source_map, "quaternion", QUATERNION_ORDER, QuaternionOrder, defaults.quaternion, order)
    return UnitConventions(units=units, frame=frame, quaternion=quaternion)


def default_conventions(source_map: SourceMap, defaults: UnitConventions, *, dialect: str) -> UnitConventions:
    """The conventions of a map whose dialect settles them; evidence that speaks against that is reported.

    Args:
        excerpt: the map.
        usual: what holds in the dialect.
        dialect: its name.
    """
    evidence = collect_evidence(source_map)
    guesses: dict[str, ConventionGuess] = {
        "units": evidence.guess_units(),
        "quaternion": evidence.guess_quaternion_order(),
    }
    settled: dict[str, Any] = {}
    for about, property, kind in (
        ("units", UNITS, LengthUnit),
        ("frame", FRAME, Handedness),
        ("quaternion", QUATERNION_ORDER, QuaternionOrder),
    ):
        value = getattr(defaults, about)
        guess = guesses.get(about) or ConventionGuess(None, evidence.height_range(settled["units"]))
        so = f"{dialect} maps have it; {guess.evidence}"
        settled[about] = _decide(source_map, about, property, kind, value, ConventionGuess(value, so))
        if (
            guess.is_conclusive
            and guess.value not in (None, settled[about])
            and getattr(source_map.conventions, about) is None
        ):
            _report_contradiction(source_map, about, property, settled[about], guess)
    return UnitConventions(**settled)


def _decide(
    source_map: SourceMap,
    topic: str,
    property: Iri,
    enum_type: type[ConventionT],
    default: ConventionT | None,
    guess: ConventionGuess,
) -> ConventionT:
    told = getattr(source_map.conventions, topic)
    declared = _declared_value(source_map, property, enum_type)
    if told is not None:
        otherwise = f" would be {guess.value.value}" if guess.value is not None else ""
        value, evidence = told, f"the user says so; by evidence it{otherwise or ' is open'} ({guess.evidence})"
    elif declared is not None:
        value, evidence = declared, f"the map says so by {property}"
    elif guess.value is not None:
        value, evidence = enum_type(guess.value.value), guess.evidence
    else:
        value, evidence = default, f"usual in this dialect; {guess.evidence}"
    assert isinstance(value, enum_type)
    source_map.record_assumption(topic, str(value.value), evidence)
    return value


def _declared_value(source_map: SourceMap, property: Iri, enum_type: type[ConventionT]) -> ConventionT | None:
    names = {str(choice.value): choice for choice in enum_type}
    for fact in source_map.graph.get(source_map.map, ()):
        if fact.property == property:
            text = literal_text(fact.value)
            if text is not None and text.strip().lower() in names:
                return names[text.strip().lower()]
            what = f"{text if text is not None else 'its value'!r} is not one of {', '.join(names)}"
            source_map.report(Severity.WARNING, source_map.map, property, what, "it is decided by evidence")
    return None


def _guess_handedness(units: LengthUnit, evidence: ConventionEvidence) -> ConventionGuess:
    """Handedness cannot be seen in a mirror: a mirrored kitchen is a kitchen. What wrote the map gives it away."""
    levels = evidence.height_range(units)
    if units is LengthUnit.CENTIMETERS:
        why = "centimetres are what Unreal counts in, and a logger that converts axes converts lengths as well"
        return ConventionGuess(Handedness.UNREAL, f"{why}; z is up: {levels}")
    return ConventionGuess(
        Handedness.ROS, f"whoever converts lengths to {units.value} converts axes as well; z is up: {levels}"
    )


def _report_contradiction(
    source_map: SourceMap, topic: str, property: Iri, chosen: Enum, guess: ConventionGuess
) -> None:
    assert guess.value is not None
    what = f"its numbers look like {guess.value.value}: {guess.evidence}"
    did = f"they are read as {chosen.value}; --{topic} {guess.value.value} would change that"
    source_map.report(Severity.WARNING, source_map.map, property, what, did)
