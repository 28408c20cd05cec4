"""Settling: how a map's numbers are meant, decided once for each map and said aloud.

What the user says counts first, then what the map itself says, then the evidence where a dialect leaves it open, and
last what is usual in the dialect.
"""

from __future__ import annotations

from enum import Enum
from typing import Any, TypeVar

from mindstage.knowledge.findings import Severity
from mindstage.knowledge.reading.conventions import Conventions, Frame, QuaternionOrder, Units
from mindstage.knowledge.reading.evidence import Evidence, Guess, evidence_in
from mindstage.knowledge.reading.excerpt import Excerpt
from mindstage.knowledge.vocabulary import FRAME, QUATERNION_ORDER, UNITS
from mindstage.knowledge.wording.words import text_in
from mindstage.world import Iri

__all__ = ["conventions_by_evidence", "usual_conventions"]

Choice = TypeVar("Choice", bound=Enum)


def conventions_by_evidence(excerpt: Excerpt, usual: Conventions) -> Conventions:
    """The conventions of a map whose dialect leaves them open.

    Args:
        excerpt: the map.
        usual: what holds where nothing speaks for anything.
    """
    evidence = evidence_in(excerpt)
    units = _settle(excerpt, "units", UNITS, Units, usual.units, evidence.units())
    frame = _settle(excerpt, "frame", FRAME, Frame, usual.frame, _frame(units, evidence))
    order = evidence.quaternion()
    quaternion = _settle(excerpt, "quaternion", QUATERNION_ORDER, QuaternionOrder, usual.quaternion, order)
    return Conventions(units=units, frame=frame, quaternion=quaternion)


def usual_conventions(excerpt: Excerpt, usual: Conventions, *, dialect: str) -> Conventions:
    """The conventions of a map whose dialect settles them; evidence that speaks against that is reported.

    Args:
        excerpt: the map.
        usual: what holds in the dialect.
        dialect: its name.
    """
    evidence = evidence_in(excerpt)
    guesses: dict[str, Guess] = {"units": evidence.units(), "quaternion": evidence.quaternion()}
    settled: dict[str, Any] = {}
    for about, property, kind in (
        ("units", UNITS, Units),
        ("frame", FRAME, Frame),
        ("quaternion", QUATERNION_ORDER, QuaternionOrder),
    ):
        value = getattr(usual, about)
        guess = guesses.get(about) or Guess(None, evidence.levels(settled["units"]))
        so = f"{dialect} maps have it; {guess.evidence}"
        settled[about] = _settle(excerpt, about, property, kind, value, Guess(value, so))
        if guess.is_clear and guess.value not in (None, settled[about]) and getattr(excerpt.conventions, about) is None:
            _doubt(excerpt, about, property, settled[about], guess)
    return Conventions(**settled)


def _settle(
    excerpt: Excerpt, about: str, property: Iri, kind: type[Choice], usual: Choice | None, guess: Guess
) -> Choice:
    told = getattr(excerpt.conventions, about)
    declared = _declared(excerpt, property, kind)
    if told is not None:
        otherwise = f" would be {guess.value.value}" if guess.value is not None else ""
        value, evidence = told, f"the user says so; by evidence it{otherwise or ' is open'} ({guess.evidence})"
    elif declared is not None:
        value, evidence = declared, f"the map says so by {property}"
    elif guess.value is not None:
        value, evidence = kind(guess.value.value), guess.evidence
    else:
        value, evidence = usual, f"usual in this dialect; {guess.evidence}"
    assert isinstance(value, kind)
    excerpt.assume(about, str(value.value), evidence)
    return value


def _declared(excerpt: Excerpt, property: Iri, kind: type[Choice]) -> Choice | None:
    names = {str(choice.value): choice for choice in kind}
    for fact in excerpt.graph.get(excerpt.map, ()):
        if fact.property == property:
            text = text_in(fact.value)
            if text is not None and text.strip().lower() in names:
                return names[text.strip().lower()]
            what = f"{text if text is not None else 'its value'!r} is not one of {', '.join(names)}"
            excerpt.report(Severity.WARNING, excerpt.map, property, what, "it is decided by evidence")
    return None


def _frame(units: Units, evidence: Evidence) -> Guess:
    """Handedness cannot be seen in a mirror: a mirrored kitchen is a kitchen. What wrote the map gives it away."""
    levels = evidence.levels(units)
    if units is Units.CENTIMETRES:
        why = "centimetres are what Unreal counts in, and a logger that converts axes converts lengths as well"
        return Guess(Frame.UNREAL, f"{why}; z is up: {levels}")
    return Guess(Frame.ROS, f"whoever converts lengths to {units.value} converts axes as well; z is up: {levels}")


def _doubt(excerpt: Excerpt, about: str, property: Iri, settled: Enum, guess: Guess) -> None:
    assert guess.value is not None
    what = f"its numbers look like {guess.value.value}: {guess.evidence}"
    did = f"they are read as {settled.value}; --{about} {guess.value.value} would change that"
    excerpt.report(Severity.WARNING, excerpt.map, property, what, did)
