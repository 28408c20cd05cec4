"""Questions in words: the operators of `mindstage.knowledge.grammar`, evaluated on the answers of other questions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from operator import eq, ge, gt, le, lt
from typing import Any, ClassVar

import msgspec
from msgspec.structs import replace

from mindstage.errors import SentenceNotUnderstoodError
from mindstage.knowledge.grammar import (
    BelongsTo,
    Between,
    Comparison,
    Form,
    Has,
    IsPartOf,
    Joined,
    KindOf,
    MeasuredBy,
    MeasuredProperty,
    Negated,
    Opened,
    Phrase,
    Predicate,
    Quantifier,
    Related,
    Stated,
    Supports,
    WordedQuestion,
    parse_sentence,
)
from mindstage.knowledge.questions import (
    AnswerRow,
    Conclusion,
    IndividualName,
    QuestionContext,
    StateAccess,
    get_question,
    question,
)
from mindstage.knowledge.sentences import find_noun, is_only_map
from mindstage.rdf.graphs import local_name
from mindstage.scene import Body, Iri
from mindstage.scene.display import counted

__all__ = ["Evaluation", "WordedRow", "in_words", "read_question"]

_MAX_NAMED = 12
"""The number of individuals that a sentence names; the others are counted."""
_EQUAL = 1e-6
"""The relative difference below which two values are equal."""
_COUNTS: Mapping[str, Callable[[int, int], bool]] = {
    "at least": ge, "at most": le, "more than": gt, "fewer than": lt, "exactly": eq,
}  # fmt: skip
_CONTAINED = ("inside", "on")


class WordedRow(AnswerRow, frozen=True, kw_only=True):
    """An individual that a question in words is about."""

    default_column: ClassVar[str] = "thing"

    thing: IndividualName | None
    """None for a number that is not about one individual."""
    holds: bool | None
    """Whether what was asked holds for it; None if that is unknown."""
    relation: str = ""
    other: IndividualName | None = None
    """What it is in that relation to."""
    value: float | None = None
    """What was measured or counted, in `unit`."""
    unit: str = ""


@question(needs="text: what is asked")
def in_words(kb: QuestionContext, text: str | None = None, *, present: StateAccess) -> Iterator[WordedRow]:
    """A question in words with quantifiers, negation, and, or, comparisons, counts and superlatives.

    One row for each individual that was considered for a yes or no, or that is an answer. The answer itself is a
    sentence (`Answers.conclusion`). Doors, drawers and lids count for what they belong to; sizes are those of the
    boxes of a thing and its parts, and masses those that the map states.

    Examples:
        in_words "are all drawers closed?"
        in_words "how many plates are on the table?"
    """
    asked = read_question(kb, text or "", present.find_individual)
    if asked is None:
        raise SentenceNotUnderstoodError(text or "", cause="the grammar has no reading of it, or several")
    result = Evaluation(kb, present).answer(asked)
    present.memo["conclusion",] = Conclusion(result.sentence, result.truth)
    yield from result.rows


def read_question(
    kb: QuestionContext, text: str, find_body: Callable[[str], Iri | None] | None = None
) -> WordedQuestion | None:
    """The question that a text is by the grammar; None if it is none, or may be several."""
    readings = parse_sentence(text, partial(find_noun, kb, find_body), partial(is_only_map, kb))
    return readings[0] if len(readings) == 1 else None


class _Is(msgspec.Struct, frozen=True):
    """Being one of these."""

    things: set[Iri]


class _Result(msgspec.Struct, frozen=True):
    sentence: str
    truth: bool | None
    rows: Sequence[WordedRow] = ()


class Evaluation:
    """Answers worded questions about one state."""

    def __init__(self, kb: QuestionContext, present: StateAccess) -> None:
        self._kb = kb
        self._present = present
        self._relations: dict[str, dict[Iri, set[Iri]]] = {}

    def answer(self, asked: WordedQuestion) -> _Result:  # noqa: PLR0911 - one per form
        """The answer as a sentence, its truth value, and the individuals that it is about."""
        match asked.form:
            case Form.TRUTH:
                return self._truth(asked)
            case Form.WHICH:
                return self._which(asked)
            case Form.COUNT:
                found = self._matching(asked.subject, asked.predicate)
                where = f" {asked.predicate}" if asked.predicate else ""
                kinds = self._kinds(found)
                text = f"{_amount(len(found), asked.subject)}{where}{kinds}."
                return _Result(text, bool(found), self._rows(found, True))
            case Form.WHERE:
                return self._where(asked.subject)
            case Form.MEASURE if asked.order:
                return self._measured(asked.subject, asked.order)
            case Form.EXTREME if asked.order:
                return self._extreme(asked.subject, asked.order)
            case Form.NEAREST if asked.other:
                return self._nearest(asked.subject, asked.other)
            case Form.DISTANCE if asked.other:
                return self._distances(asked.subject, asked.other)
            case _:
                return self._more(asked)

    # -- answers -------------------------------------------------------------------------------------------------------

    def _truth(self, asked: WordedQuestion) -> _Result:
        if asked.clauses:
            results = [self._truth(each) for each in asked.clauses]
            truths = [each.truth for each in results]
            truth = _any(truths) if asked.operator == "or" else _all(truths)
            said = " ".join(each.sentence for each in results)
            return _Result(f"{_verdict(truth)}. {said}", truth, [row for each in results for row in each.rows])
        subject, predicate = asked.subject, asked.predicate
        truth, deciding = self._holds_for(subject, predicate)
        what = str(predicate) if predicate else "there"
        members = self.members(subject)
        rows = [WordedRow(thing=each, holds=self._holds(predicate, each)) for each in members]
        if truth is None:
            return _Result(f"Unknown: {self._reason(subject, predicate, members)}.", None, rows)
        named = _names(deciding)
        be = "is" if len(deciding) == 1 else "are"
        if truth:
            text = f"Yes: {named} {be} {what}." if deciding and predicate else f"Yes: {named}." if deciding else "Yes."
            if subject.quantifier.word == "no":
                text = f"Yes: none of {_amount(len(members), replace(subject, quantifier=Quantifier('')))} is {what}."
            elif subject.quantifier.word in {"all", "both", "the", ""} and len(members) > 1 and predicate:
                text = f"Yes: all {_amount(len(members), subject)} are {what}."
        elif not members:
            text = f"No: there {'are' if subject.plural else 'is'} no {_noun(subject)}."
        elif subject.quantifier.word in {"some", "a"} or (not deciding and subject.quantifier.word != "no"):
            searched = _amount(len(members), subject)
            text = f"No: none of {searched} is {what}." if len(members) > 1 else f"No: {_names(members)} is not {what}."
        elif subject.quantifier.word == "no":
            text = f"No: {named} {be} {what}."
        else:
            text = f"No: {named} {be} not {what}."
        return _Result(text, truth, rows)

    def _which(self, asked: WordedQuestion) -> _Result:
        found = self._matching(asked.subject, asked.predicate)
        if asked.subject.members is None and not asked.subject.parts and isinstance(asked.predicate, Related):
            others = {*self.members(asked.predicate.other)}
            parts = {each for other in others for each in self._parts_of(other)}
            found = [each for each in found if each not in others | parts]  # a door is not in its fridge
        searched = self.members(asked.subject)
        what = f" {asked.predicate}" if asked.predicate else ""
        if found:
            return _Result(f"{_names(found)}.", True, self._rows(found, True))
        if not searched:
            return _Result(f"There {'are' if asked.subject.plural else 'is'} no {_noun(asked.subject)}.", False)
        of = f"None of {_amount(len(searched), asked.subject)}" if len(searched) > 1 else f"Not {_names(searched)}"
        return _Result(f"{of} is{what}.", False)

    def _where(self, subject: Phrase) -> _Result:
        rows: list[WordedRow] = []
        groups: dict[str, list[Iri]] = {}
        for each in self.members(subject):
            relation, place = self._place(each)
            rows.append(WordedRow(thing=each, holds=None if place is None else True, relation=relation, other=place))
            where = "somewhere: nothing that it is on or in is known" if place is None else (
                f"{'in' if relation == 'inside' else relation} {local_name(place)}"
            )  # fmt: skip
            groups.setdefault(where, []).append(each)
        if not rows:
            return _Result(f"There is no {_noun(subject)}.", False)
        said = (f"{_names(each)} {'is' if len(each) == 1 else 'are'} {where}" for where, each in groups.items())
        return _Result("; ".join(said) + ".", any(row.other for row in rows), rows)

    def _measured(self, subject: Phrase, order: MeasuredBy) -> _Result:
        rows, said = list[WordedRow](), dict[str, list[Iri]]()
        for each in self.members(subject):
            value = self._value(each, order.measure)
            rows.append(WordedRow(thing=each, holds=None, value=value, unit=order.measure.unit))
            said.setdefault(_shown(value, order.measure), []).append(each)
        if not rows:
            return _Result(f"There is no {_noun(subject)}.", None)
        text = "; ".join(f"{order.measure} of {_names(each)}: {value}" for value, each in said.items())
        return _Result(f"{text}.", True if any(row.value is not None for row in rows) else None, rows)

    def _extreme(self, subject: Phrase, order: MeasuredBy) -> _Result:
        members = self.members(subject)
        values = {each: self._value(each, order.measure) for each in members}
        known = {each: value * order.sign for each, value in values.items() if value is not None}
        if not known:
            return _Result(f"Unknown: no {order.measure} of any {_noun(subject)} is stated.", None)
        best = max(known.values())
        found = [each for each, value in known.items() if value >= best - _EQUAL]
        rows = [WordedRow(thing=each, holds=True, value=values[each], unit=order.measure.unit) for each in found]
        unknown = len(members) - len(known)
        note = f"; the {order.measure} of {unknown} others is not stated" if unknown else ""
        text = f"{_names(found)}: {_shown(values[found[0]], order.measure)}, of {len(members)} compared{note}."
        return _Result(text, True, rows)

    def _nearest(self, subject: Phrase, other: Phrase) -> _Result:
        goals = self.members(other)
        gaps = {
            each: min((gap for goal in goals if (gap := self._gap(each, goal)) is not None), default=None)
            for each in self.members(subject)
            if each not in goals
        }
        known = {each: gap for each, gap in gaps.items() if gap is not None}
        if not known:
            return _Result(f"Unknown: there is no distance between {_noun(subject)} and {_noun(other)}.", None)
        best = min(known.values())
        found = [each for each, gap in known.items() if gap <= best + _EQUAL]
        rows = [WordedRow(thing=each, holds=True, value=known[each], unit="m") for each in found]
        return _Result(f"{_names(found)}: {best:.3g} m away.", True, rows)

    def _distances(self, subject: Phrase, other: Phrase) -> _Result:
        rows = [
            WordedRow(thing=one, holds=None, other=two, value=gap, unit="m", relation="distance")
            for one in self.members(subject)
            for two in self.members(other)
            if one != two and (gap := self._gap(one, two)) is not None
        ]
        said = (
            f"{local_name(row.thing or '')} is {row.value:.3g} m from {local_name(row.other or '')}" for row in rows
        )
        text = "; ".join(said) or f"Unknown: there is no distance between {_noun(subject)} and {_noun(other)}"
        return _Result(f"{text}.", True if rows else None, rows)

    def _more(self, asked: WordedQuestion) -> _Result:
        counts = [len(self.members(each)) for each in (asked.subject, asked.other) if each is not None]
        truth = counts[0] > counts[1]
        said = " and ".join(
            _amount(count, each) for count, each in zip(counts, (asked.subject, asked.other), strict=True) if each
        )
        return _Result(f"{'Yes' if truth else 'No'}: {said}.", truth)

    def _rows(self, found: Iterable[Iri], holds: bool) -> list[WordedRow]:
        return [WordedRow(thing=each, holds=holds) for each in found]

    def _kinds(self, found: Sequence[Iri]) -> str:
        """How many of each class there are, if there are several classes."""
        kinds: dict[Iri, int] = {}
        for each in found:
            cls = self._kb.reasoner.class_of(each)
            if cls is not None:
                kinds[cls] = kinds.get(cls, 0) + 1
        if not 1 < len(kinds) <= _MAX_NAMED:
            return ""
        return ": " + ", ".join(f"{count} {local_name(cls)}" for cls, count in sorted(kinds.items()))

    # -- sets ----------------------------------------------------------------------------------------------------------

    def members(self, phrase: Phrase) -> list[Iri]:
        """The individuals that a phrase stands for, without its quantifier."""
        if phrase.parts:
            return list(dict.fromkeys(each for part in phrase.parts for each in self.members(part)))
        found: Iterable[Iri] = self._bodies if phrase.members is None else phrase.members
        return [each for each in found if all(self._holds(test, each) for test in phrase.restrictions)]

    def _matching(self, subject: Phrase, predicate: Predicate | None) -> list[Iri]:
        return [each for each in self.members(subject) if self._holds(predicate, each)]

    def _holds_for(  # noqa: PLR0911 - one per quantifier
        self, phrase: Phrase, predicate: Predicate | _Is | None
    ) -> tuple[bool | None, list[Iri]]:
        """Whether a predicate holds for as many as a phrase says, and the individuals that decide it."""
        if phrase.parts:
            results = [self._holds_for(each, predicate) for each in phrase.parts]
            truth = _any(each for each, _ in results) if phrase.operator == "or" else _all(each for each, _ in results)
            return truth, list(dict.fromkeys(one for value, each in results if value is truth for one in each))
        members = self.members(phrase)
        values = {each: self._holds(predicate, each) for each in members}
        yes = [each for each, value in values.items() if value]
        no = [each for each, value in values.items() if value is False]
        word, number = phrase.quantifier.word, phrase.quantifier.number
        if word in _COUNTS and number is not None:
            return (_COUNTS[word](len(yes), number) if len(yes) + len(no) == len(members) else None), yes
        if word in {"some", "a"}:
            truth = _any(values.values())
            return (truth, yes) if truth else (truth, [])
        if word == "no":
            truth = _any(values.values())
            return (None if truth is None else not truth), yes
        if not members or (word == "both" and len(members) != 2) or (number is not None and len(members) != number):
            return None, []
        truth = _all(values.values())
        if truth is False and yes and word == "the" and not phrase.plural:
            return None, []  # "the" names one, and they differ
        return truth, yes if truth else no

    def _reason(self, subject: Phrase, predicate: Predicate | None, members: Sequence[Iri]) -> str:
        """Why a truth value is unknown."""
        parts = subject.parts or (subject,)
        for part in parts:
            found = self.members(part)
            if not found:
                return f"there {'are' if part.plural else 'is'} no {_noun(part)}"
            wanted = 2 if part.quantifier.word == "both" else part.quantifier.number
            if wanted is not None and part.quantifier.word in {"both", "the"} and len(found) != wanted:
                return f"there are {counted(len(found), _noun(part, plural=False))}, not {wanted}: {_names(found)}"
        yes = [each for each in members if self._holds(predicate, each)]
        no = [each for each in members if self._holds(predicate, each) is False]
        if yes and no:
            return f"{_names(yes)} {'is' if len(yes) == 1 else 'are'} {predicate}, {_names(no)} not; name one"
        unknown = [each for each in members if self._holds(predicate, each) is None]
        return f"nothing states whether {_names(unknown)} {'is' if len(unknown) == 1 else 'are'} {predicate}"

    # -- predicates ----------------------------------------------------------------------------------------------------

    def _holds(self, predicate: Predicate | _Is | None, thing: Iri) -> bool | None:  # noqa: PLR0911, PLR0912 - one per predicate
        match predicate:
            case None:
                return True
            case Negated(inner):
                value = self._holds(inner, thing)
                return None if value is None else not value
            case Joined(parts, operator):
                values = (self._holds(each, thing) for each in parts)
                return _any(values) if operator == "or" else _all(values)
            case Related(relation, other):
                return self._holds_for(_some_of_set(other), _Is(self._related(relation).get(thing, set())))[0]
            case _Is():
                return thing in predicate.things
            case Supports(relation, other):
                there = {each for each, places in self._related(relation).items() if thing in places}
                return self._holds_for(other, _Is(there))[0]
            case Opened(state):
                found = self._openness.get(thing)
                return None if found is None else (found > 0) is (state == "open")
            case Stated(state):
                return True if (thing, state) in self._stated else None
            case KindOf(kind):
                return thing in self.members(kind)
            case Has(other, verb):
                return self._holds_for(other, _Is(self._owned(thing, verb)))[0]
            case BelongsTo(whole, verb):
                return any(thing in self._owned(each, verb) for each in self.members(whole))
            case IsPartOf(whole):
                return any(thing in self._parts_of(each) for each in self.members(whole))
            case Between(one, other):
                return any(
                    thing in self._between(a, b) for a in self.members(one) for b in self.members(other) if a != b
                )
            case Comparison():
                return self._compared(predicate, thing)
            case _:
                raise TypeError(f"{predicate!r} is no predicate")

    def _compared(self, predicate: Comparison, thing: Iri) -> bool | None:
        value = self._value(thing, predicate.measure)
        if predicate.other is None:
            limits = [predicate.number]
        else:
            limits = [self._value(each, predicate.measure) for each in self.members(predicate.other) if each != thing]
        results: list[bool | None] = []
        for limit in limits:
            if value is None or limit is None:
                results.append(None)
            elif predicate.sign == 0:
                results.append(abs(value - limit) <= _EQUAL * max(abs(value), abs(limit)))
            else:
                results.append((value - limit) * predicate.sign > _EQUAL * max(abs(value), abs(limit)))
        any_is_enough = predicate.other is not None and predicate.other.quantifier.word in {"some", "any"}
        return None if not results else _any(results) if any_is_enough else _all(results)

    # -- facts ---------------------------------------------------------------------------------------------------------

    def _ask(self, name: str, args: Mapping[str, object]) -> Sequence[Any]:
        """The answers to a question, whose module is imported when it is asked first."""
        return get_question(name).ask(self._kb, args, present=self._present)

    @cached_property
    def _bodies(self) -> dict[Iri, Body]:
        states_now = self._present.states()
        return {body.iri: body for state in states_now for body in state.world.bodies}

    def _related(self, relation: str) -> dict[Iri, set[Iri]]:
        if relation not in self._relations:
            found: dict[Iri, set[Iri]] = {}
            for row in self._ask("where_is", {"relation": relation}):
                found.setdefault(row.thing, set()).add(row.other)
            if relation == "next_to":
                for thing, others in list(found.items()):
                    for other in others:
                        found.setdefault(other, set()).add(thing)
            if relation in {"above", "below"}:  # what touches counts, too
                for thing, places in self._related("on").items():
                    for place in places:
                        one, other = (thing, place) if relation == "above" else (place, thing)
                        found.setdefault(one, set()).add(other)
            self._relations[relation] = found
        return self._relations[relation]

    def _place(self, thing: Iri) -> tuple[str, Iri | None]:
        """What a thing is in, the innermost first, or else on, or part of."""
        for relation in _CONTAINED:
            places = self._related(relation).get(thing, set())
            if places:
                inner = sorted(places, key=lambda each: (self._value(each, MeasuredProperty.VOLUME) or 0.0, each))
                return relation, inner[0]
        return "part of", next((whole for whole, parts in self._parts.items() if thing in parts), None)

    @cached_property
    def _openness(self) -> Mapping[Iri, float]:
        """How far things are open: doors and drawers, and the widest of what belongs to them."""
        found: dict[Iri, float] = {}
        for row in self._ask("articulated_parts", {}):
            share = 0.0 if row.state == "closed" else row.share or 1.0
            for each in (row.part, row.thing):
                found[each] = max(share, found.get(each, 0.0))
        return found

    @cached_property
    def _stated(self) -> set[tuple[Iri, str]]:
        return {(row.thing, local_name(row.value)) for row in self._ask("states", {})}

    @cached_property
    def _parts(self) -> Mapping[Iri, set[Iri]]:
        found: dict[Iri, set[Iri]] = {}
        for row in self._ask("part_of", {}):
            found.setdefault(row.whole, set()).add(row.part)
        return found

    @cached_property
    def _opening_parts(self) -> Mapping[Iri, set[Iri]]:
        found: dict[Iri, set[Iri]] = {}
        for row in self._ask("articulated_parts", {}):
            found.setdefault(row.thing, set()).add(row.part)
        return found

    def _parts_of(self, whole: Iri) -> set[Iri]:
        """All parts, with its doors and drawers and what belongs to them."""
        opening = self._opening_parts.get(whole, set())
        found = self._parts.get(whole, set()) | opening
        for each in opening:
            found = found | self._parts.get(each, set())
        return found

    def _owned(self, whole: Iri, verb: str) -> set[Iri]:
        """What a thing contains, holds (also on it), or has (also as parts)."""
        relations = ("inside",) if verb == "contain" else ("inside", "on")
        found = self._parts_of(whole) if verb == "have" else set[Iri]()
        return found.union(
            *({each for each, places in self._related(name).items() if whole in places} for name in relations)
        )

    def _between(self, one: Iri, other: Iri) -> set[Iri]:
        rows: Sequence[Any] = self._ask("is_between", {"one": one, "other": other})
        return {row.thing for row in rows}

    def _gap(self, one: Iri, other: Iri) -> float | None:
        rows = self._ask("distance", {"thing": one, "other": other})
        return rows[0].gap if rows else None

    def _value(self, thing: Iri, measure: MeasuredProperty) -> float | None:
        """A measure of a thing in its unit; None if it is not stated."""
        if measure is MeasuredProperty.OPENNESS:
            return self._openness.get(thing)
        body = self._bodies.get(thing)
        if body is None:
            return None
        if measure is MeasuredProperty.MASS:
            return body.physics.mass_kg or None
        if body.size is None:
            return None
        depth, width, height = body.size
        if measure is MeasuredProperty.HEIGHT:
            parts = [self._bodies[each] for each in self._parts.get(thing, ()) if each in self._bodies]
            heights = [
                (each.pose.position[2] - each.size[2] / 2, each.pose.position[2] + each.size[2] / 2)
                for each in (body, *parts)
                if each.size is not None
            ]
            return round(max(top for _, top in heights) - min(bottom for bottom, _ in heights), 6)
        values = {MeasuredProperty.WIDTH: width, MeasuredProperty.DEPTH: depth, MeasuredProperty.LENGTH: max(body.size)}
        return values.get(measure, depth * width * height)


def _some_of_set(other: Phrase) -> Phrase:
    """The other end of a relation: it is enough to be on one of the counters, but "all" and "no" remain."""
    if other.parts:
        return replace(other, parts=tuple(map(_some_of_set, other.parts)))
    if other.quantifier.word in {"", "the", "a"}:
        return replace(other, quantifier=Quantifier("some"))
    return other


def _verdict(truth: bool | None) -> str:
    return "Unknown" if truth is None else "Yes" if truth else "No"


def _any(values: Iterable[bool | None]) -> bool | None:
    given = list(values)
    return True if True in given else None if None in given else False


def _all(values: Iterable[bool | None]) -> bool | None:
    given = list(values)
    return False if False in given else None if None in given else True


def _noun(phrase: Phrase, *, plural: bool | None = None) -> str:
    if phrase.parts:
        return f" {phrase.operator} ".join(map(_noun, phrase.parts))
    described = replace(phrase, quantifier=Quantifier(""))
    return str(described if plural is None else replace(described, plural=plural))


def _amount(count: int, phrase: Phrase) -> str:
    return f"{count} {_noun(phrase)}"


def _names(things: Sequence[Iri]) -> str:
    named = [local_name(each) for each in things[:_MAX_NAMED]]
    if len(things) > _MAX_NAMED:
        return f"{', '.join(named)} and {len(things) - _MAX_NAMED} more"
    return " and ".join([", ".join(named[:-1]), named[-1]] if len(named) > 1 else named)


def _shown(value: float | None, measure: MeasuredProperty) -> str:
    if value is None:
        return "unknown, it is not stated"
    return f"{value:.0%}" if measure is MeasuredProperty.OPENNESS else f"{value:.4g} {measure.unit}"
