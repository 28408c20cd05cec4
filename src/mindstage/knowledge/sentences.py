"""Plain sentences as questions: "where is the milk?" is `where_is` with `thing=Milk`.

A local matcher of templates and names, without a model and without the network. Each question declares templates:

    @question(sentences=("where is {thing}", "(what|which things) (is|are) {relation} {other}"))

`{thing}` is an argument, `[word]` is optional, `(a|b c)` are alternatives, and `{relation=on}` binds an argument
without a word. `{front:Drawer,Door}` is an argument that belongs to one of these classes, which is preferred to any
other. Articles, plurals, case and punctuation do not matter. A question with an argument `map` may always end with "in
{map}". A name is found by `NameIndex.things`; a word of an enumeration by its value or a synonym; a number may have a
unit. A sentence is matched as a whole: of several readings, the one with the most words of a template and the most
exact names is taken, and two that are equally good are an error that lists both.

The time is bounded: by the length of a sentence, the number of its words, and the number of readings that are tried.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import SequenceMatcher, get_close_matches
from enum import Enum
from functools import lru_cache, partial
from itertools import islice, product
from types import MappingProxyType
from typing import Any

from mindstage.errors import AmbiguousSentenceError, SentenceNotUnderstoodError
from mindstage.knowledge.grammar import (
    EXAMPLE_FORMS,
    FUTURE_WORDS,
    GRAMMAR_WORDS,
    IGNORED_WORDS,
    OPERATORS,
    PAST_WORDS,
    names_nothing,
    parse_sentence,
    sentence_words,
)
from mindstage.knowledge.names import EntityType, NameQuality, Noun, name_words
from mindstage.knowledge.questions import (
    Question,
    QuestionArgument,
    QuestionContext,
    get_question,
    list_questions,
    question_names,
)
from mindstage.rdf.graphs import PREFIXES, local_name
from mindstage.registry import Group, catalog, extensions
from mindstage.scene import Iri

__all__ = [
    "MAX_LENGTH",
    "SentencePattern",
    "Understanding",
    "find_noun",
    "is_only_map",
    "is_sentence",
    "questions_with_words",
    "resolve_question",
    "sentence_patterns",
    "understand",
]

MAX_LENGTH = 1000
"""The maximum number of characters of a sentence."""
_WORDED = "in_words"
"""The question that the grammar asks."""
_MAX_WORDS = 60
_MAX_NAME_WORDS = 12
_MAX_STEPS = 200_000
"""The maximum number of comparisons for one sentence."""
_MAX_EXPANSIONS = 256
_LITERAL_WEIGHT = 2
_MAX_CANDIDATES = 20
_NEAREST = 3
"""The number of unknown words, and of questions, for which something similar is shown."""
_MAX_NEAREST_NAMES = 5

FindBody = Callable[[str], Iri | None]
_Span = tuple[int, int]

_MAP_SUFFIX = " [in {map}]"
_SAME_WORDS = {
    "are": "is",
    "was": "is",
    "were": "is",
    "be": "is",
    "does": "do",
    "doe": "do",
    "did": "do",
    "has": "have",
    "had": "have",
    "could": "can",
    "whats": "what",
    "metre": "meter",
}
"""Words that templates and sentences may exchange, after the plural was removed."""
_CONTRACTIONS = {f"{word}'s": word for word in ("where", "what", "which", "who", "there", "how")}
_CLOSINGS = (("right", "now"), ("at", "the", "moment"), ("at", "present"), ("today",), ("right", "this", "moment"))
"""Words at the end of a sentence that mean the present, in which all questions are asked."""
_DROPPED = frozenset(["the", "a", "an", "some", "my", "our", "your", "these", "those"])
_OPENINGS = tuple(
    tuple(words.split())
    for words in ("can you tell me", "can you say", "tell me", "do you know", "i want to know", "i would like to know")
)
_ASKING = frozenset(("where", "what", "which", "how", "who", "whose", "is", "do", "can", "if", "whether"))
"""Words after which an opening is left out."""
_PUNCTUATION = "\"'`\u201c\u201d\u2018\u2019«»\u201e.,;:!?()[]…"
_CHOICE_SYNONYMS = {
    "on": ("on top of", "onto", "upon", "standing on", "lying on"),
    "inside": ("in", "into", "within", "inside of"),
    "above": ("over",),
    "below": ("under", "beneath", "underneath"),
    "next_to": ("beside", "near", "by"),
    "onto": ("on", "on top of"),
    "into": ("in", "inside"),
    "left": ("left of", "to the left of", "on the left of", "on the left side of"),
    "right": ("right of", "to the right of", "on the right of", "on the right side of"),
    "front": ("in front of",),
    "behind": ("in back of",),
    "open": ("opened",),
    "closed": ("shut",),
}
"""Words for values of enumerations, besides their own."""
_NUMBERS = {
    word: at
    for at, word in enumerate(
        ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
    )
}
_UNITS = {
    **dict.fromkeys(("", "m", "meter", "rad", "radian", "kg", "kilogram", "s", "second", "n", "newton"), 1.0),
    **dict.fromkeys(("cm", "centimeter"), 0.01),
    **dict.fromkeys(("mm", "millimeter", "g", "gram"), 0.001),
    **dict.fromkeys(("deg", "degree", "°"), math.pi / 180.0),
    **dict.fromkeys(("%", "percent"), 0.01),
    **dict.fromkeys(("min", "minute"), 60.0),
}
"""Factors to the units of arguments: m, rad, kg, s, and shares from 0 to 1."""


@dataclass(frozen=True, slots=True)
class Understanding:
    """How a sentence was understood."""

    sentence: str
    question: Question[Any]
    args: Mapping[str, object]
    """Names as IRIs; numbers in the unit of the argument."""
    names: tuple[str, ...] = ()
    """What each name refers to that was not given exactly."""
    reading: str = ""
    """The sentence as the grammar understood it, which is understood in the same way; empty for a declared wording."""

    def __str__(self) -> str:
        return self.reading or _call_text(self.question, self.args)

    @property
    def notes(self) -> tuple[str, ...]:
        """The question, and what each name refers to."""
        return (f"understood: {self}", *self.names)


@dataclass(frozen=True, slots=True)
class Slot:
    """The place of an argument in a template."""

    argument: QuestionArgument
    classes: tuple[str, ...] = ()
    """Names of classes, to one of which the argument belongs; any if empty."""


@dataclass(frozen=True, slots=True)
class SentencePattern:
    """One wording of a template, without options."""

    items: tuple[str | Slot, ...]
    shown: tuple[str | Slot, ...]
    """The items as they are written, with articles and inflections."""
    constants: Mapping[str, str] = field(default_factory=dict)
    """Arguments that the wording implies."""
    template: str = ""

    @property
    def words(self) -> frozenset[str]:
        """The words that a sentence must have."""
        return frozenset(each for each in self.items if isinstance(each, str))

    def word_sets(self) -> set[frozenset[str]]:
        """Sets of words, one of which a sentence has: `words`, with those of a choice for each enumeration."""
        sets = {self.words}
        for slot in self.items:
            if not isinstance(slot, str) and slot.argument.choices:
                chosen = {words for choice in slot.argument.choices for words in _words_of_choice(choice)}
                sets = {words | choice for words in sets for choice in chosen}
        return sets

    def text(self, values: Mapping[str, str] | None = None) -> str:
        """The wording; with values, the sentence that asks for them."""
        filled = values or {}
        shown = (
            each if isinstance(each, str) else filled.get(each.argument.name, f"<{each.argument.name}>")
            for each in self.shown
        )
        return " ".join(shown)


def _words_of_choice(choice: str) -> Iterator[frozenset[str]]:
    """The words by which a value of an enumeration is given, also if they are written together."""
    for text in (choice, *_CHOICE_SYNONYMS.get(choice, ())):
        words = [_same_word(word) for word in name_words(text)]
        yield frozenset(word for word in words if word not in _DROPPED)
        yield frozenset({"".join(name_words(text))})


@dataclass(frozen=True, slots=True)
class _Token:
    word: str
    start: int
    end: int
    """The place of the whole chunk without punctuation, such as `milk_carton_1`, in the sentence."""


@dataclass(frozen=True, slots=True)
class _Candidate:
    value: object
    quality: NameQuality = NameQuality.EXACT
    note: str = ""


@dataclass(frozen=True, slots=True)
class _Reading:
    question: Question[Any]
    constants: Mapping[str, str]
    slots: Mapping[str, Sequence[_Candidate]]
    weight: int
    """How much of the sentence the wording determines."""

    @property
    def rank(self) -> tuple[bool, int, int]:
        """The smaller, the better."""
        qualities = [max(each.quality for each in candidates) for candidates in self.slots.values()]
        return (NameQuality.PARTIAL in qualities, -self.weight, sum(qualities))

    def meanings(self) -> Iterator[tuple[Question[Any], dict[str, object], tuple[str, ...]]]:
        for chosen in product(*self.slots.values()):
            args = {**self.constants, **dict(zip(self.slots, (each.value for each in chosen), strict=True))}
            yield self.question, args, tuple(each.note for each in chosen if each.note)


def is_sentence(text: str) -> bool:
    """Whether a text is a sentence, rather than the name of a question: it has several words, or a question mark."""
    stripped = text.strip()
    return stripped.endswith("?") or any(char.isspace() for char in stripped)


def understand(
    kb: QuestionContext, sentence: str, *, find_body: FindBody | None = None, is_past: bool = False
) -> Understanding:
    """Maps a plain sentence to a question.

    Args:
        kb: the knowledge base with the names.
        sentence: a sentence of at most `MAX_LENGTH` characters.
        find_body: finds the IRI of a body by its id, for bodies without a map.
        is_past: whether a time of a recording is asked about, in the past tense or the present.

    Raises:
        SentenceNotUnderstoodError: no question is put like this, or a name is unknown.
        AmbiguousSentenceError: there are several readings that are equally good.
    """
    tokens = _checked_tokens(sentence)
    first, _, rest = sentence.strip().partition(" ")
    # The name of a question, as in "where_is milk", is words, too.
    is_name = "_" in first and first in set(question_names())
    spoken = f"{first.replace('_', ' ')} {rest}" if is_name else sentence
    with kb.lock:
        worded = parse_sentence(spoken, partial(find_noun, kb, find_body), partial(is_only_map, kb), is_past=is_past)
        if len(worded) > 1:
            raise AmbiguousSentenceError(sentence, candidates=tuple(map(str, worded)))
        matcher = _Matcher(kb, sentence, tokens, find_body)
        may_be_declared = not worded or names_nothing(worded[0])  # such as "which room", if no map has rooms
        readings = list(matcher.readings()) if may_be_declared else []
        if worded and not readings:
            return Understanding(
                sentence, get_question(_WORDED), {"text": str(worded[0]) if is_past else spoken}, (), str(worded[0])
            )
        if not readings and PAST_WORDS & {*sentence_words(sentence)}:
            cause = "it is about the past, and is none of the questions about recordings (--episode)"
            raise SentenceNotUnderstoodError(sentence, cause=cause, questions=matcher.not_understood().questions)
        if not readings:
            raise matcher.not_understood()
    best = min(each.rank for each in readings)
    meanings: dict[str, tuple[Question[Any], dict[str, object], tuple[str, ...]]] = {}
    for reading in readings:
        if reading.rank == best:
            for meaning in islice(reading.meanings(), _MAX_CANDIDATES):
                meanings.setdefault(_call_text(meaning[0], meaning[1], full=True), meaning)
    if len(meanings) > 1:
        short = dict.fromkeys(_call_text(question, args) for question, args, _ in meanings.values())
        raise AmbiguousSentenceError(sentence, candidates=tuple(short if len(short) == len(meanings) else meanings))
    question, args, notes = next(iter(meanings.values()))
    return Understanding(sentence, question, MappingProxyType(args), notes)


def resolve_question(
    kb: QuestionContext,
    question: Question[Any] | str,
    args: Mapping[str, object],
    *,
    positional: Sequence[object] = (),
    find_body: FindBody | None = None,
    is_past: bool = False,
) -> tuple[Question[Any], Mapping[str, object], tuple[str, ...]]:
    """The question that a name or a plain sentence refers to, its arguments, and how a sentence was understood.

    Args:
        kb: the knowledge base.
        question: a question, its name, or a sentence.
        args: arguments that are given by name, which supersede those of a sentence.
        positional: arguments in the order of the question.
        find_body: see `understand`.
        is_past: see `understand`.

    Raises:
        QuestionNotFoundError: no question has that name.
        SentenceNotUnderstoodError: see `understand`.
        AmbiguousSentenceError: see `understand`.
    """
    if not isinstance(question, str) or not is_sentence(question):
        declared = get_question(question) if isinstance(question, str) else question
        return declared, declared.bind(positional, args), ()
    understood = understand(kb, question, find_body=find_body, is_past=is_past)
    given = understood.question.bind(positional, args)
    return understood.question, {**understood.args, **given}, understood.notes


@lru_cache(maxsize=512)
def sentence_patterns(question: Question[Any]) -> tuple[SentencePattern, ...]:
    """All wordings of the templates of a question.

    Raises:
        ValueError: a template has an unbalanced bracket, an unknown argument, or too many wordings.
    """
    arguments = {argument.name: argument for argument in question.arguments}
    suffix = _MAP_SUFFIX if "map" in arguments else ""
    found: dict[tuple[object, ...], SentencePattern] = {}
    for template in question.sentences:
        expansions = _expand(template + ("" if "{map}" in template else suffix))
        for words in sorted(expansions, key=lambda each: "{map}" in each):
            pattern = _pattern(template, words, arguments)
            found.setdefault((pattern.items, tuple(pattern.constants.items())), pattern)
    return tuple(found.values())


def questions_with_words(words: Collection[str]) -> Iterator[Question[Any]]:
    """The questions with a sentence that consists of some of these words and of arguments; others are not imported.

    Args:
        words: words as in `SentencePattern.word_sets`.
    """
    known = catalog(Group.QUESTIONS, Question, _smallest_word_sets, tuple[str, ...])
    for name in question_names():
        if name in known:
            if any(all(word in words for word in wording.split()) for wording in known[name]):
                yield get_question(name)
        elif name not in extensions(Group.QUESTIONS):
            yield get_question(name)


def _smallest_word_sets(question: Question[Any]) -> tuple[str, ...]:
    """The words of its sentences, with those of enumerations and no other arguments; none contains all of another."""
    sets = {words for pattern in sentence_patterns(question) for words in pattern.word_sets()}
    smallest = (each for each in sets if not any(other < each for other in sets))
    return tuple(sorted(" ".join(sorted(words)) for words in smallest))


def _pattern(template: str, words: Sequence[str], arguments: Mapping[str, QuestionArgument]) -> SentencePattern:
    items: list[str | Slot] = []
    shown: list[str | Slot] = []
    constants: dict[str, str] = {}
    for word in words:
        if word.startswith("{"):
            name, equals, value = word[1:-1].partition("=")
            name, _, classes = name.partition(":")
            if name not in arguments:
                raise ValueError(f"the template {template!r} has an unknown argument {name!r}")
            if equals:
                constants[name] = value
            else:
                slot = Slot(arguments[name], tuple(classes.split(",")) if classes else ())
                items.append(slot)
                shown.append(slot)
        else:
            shown.append(word)
            items += [same for same in map(_same_word, name_words(word)) if same not in _DROPPED]
    return SentencePattern(tuple(items), tuple(shown), MappingProxyType(constants), template)


def _expand(template: str) -> list[tuple[str, ...]]:
    """The wordings of a template with optional parts and alternatives."""
    tokens = template
    for sign in "[]()|":
        tokens = tokens.replace(sign, f" {sign} ")
    wordings, rest = _alternatives(tokens.split(), template)
    if rest:
        raise ValueError(f"the template {template!r} has an unbalanced bracket")
    return list(dict.fromkeys(wordings))


def _alternatives(tokens: list[str], template: str) -> tuple[list[tuple[str, ...]], list[str]]:
    """The wordings up to a closing bracket, and the tokens from there."""
    finished: list[tuple[str, ...]] = []
    wordings: list[tuple[str, ...]] = [()]
    while tokens and tokens[0] not in {")", "]"}:
        token, tokens = tokens[0], tokens[1:]
        if token == "|":
            finished, wordings = finished + wordings, [()]
            continue
        options: list[tuple[str, ...]] = [(token,)]
        if token in {"(", "["}:
            options, tokens = _alternatives(tokens, template)
            if tokens[:1] != [")" if token == "(" else "]"]:
                raise ValueError(f"the template {template!r} has an unbalanced bracket")
            tokens = tokens[1:]
            options += [()] if token == "[" else []
        wordings = [(*before, *option) for before in wordings for option in options]
        if len(wordings) > _MAX_EXPANSIONS:
            raise ValueError(f"the template {template!r} has more than {_MAX_EXPANSIONS} wordings")
    return finished + wordings, tokens


def _checked_tokens(sentence: str) -> list[_Token]:
    if len(sentence) > MAX_LENGTH:
        cause = f"it has {len(sentence):,} characters, more than {MAX_LENGTH:,}"
        raise SentenceNotUnderstoodError(sentence, cause=cause)
    tokens = _tokens(sentence)
    if len(tokens) > _MAX_WORDS:
        raise SentenceNotUnderstoodError(sentence, cause=f"it has {len(tokens)} words, more than {_MAX_WORDS}")
    if not tokens:
        raise SentenceNotUnderstoodError(sentence, cause="it has no words")
    return tokens


def _tokens(sentence: str) -> list[_Token]:
    """The words of a sentence, without articles, politeness and punctuation."""
    tokens: list[_Token] = []
    at = 0
    for chunk in sentence.split():
        start = sentence.index(chunk, at)
        at = start + len(chunk)
        bare = chunk.strip(_PUNCTUATION)
        if not bare:
            continue
        begin = start + chunk.index(bare)
        tokens += [_Token(word, begin, begin + len(bare)) for word in _chunk_words(bare)]
    for opening in _OPENINGS:
        rest = tokens[len(opening) :]
        if tuple(token.word for token in tokens[: len(opening)]) == opening and rest and rest[0].word in _ASKING:
            tokens = rest[1:] if rest[0].word in {"if", "whether"} else rest
    for closing in _CLOSINGS:
        if tuple(token.word for token in tokens[-len(closing) :]) == closing:
            tokens = tokens[: -len(closing)]
    kept = [each for each in tokens if each.word not in IGNORED_WORDS]
    return [each for at, each in enumerate(kept) if each.word not in _DROPPED or at == len(kept) - 1]


def _chunk_words(chunk: str) -> Iterable[str]:
    plain = chunk.replace("\u2019", "'").lower()
    if plain in _CONTRACTIONS:
        return (_CONTRACTIONS[plain], "is")
    if "://" in chunk or chunk.partition(":")[0] in PREFIXES or _number(chunk) is not None:
        return (chunk,)
    return map(_same_word, name_words(chunk))


def _same_word(word: str) -> str:
    return _SAME_WORDS.get(word, word)


def _number(text: str) -> float | None:
    """A number with or without a unit, in the unit of arguments; None for anything else."""
    stripped = text.strip().lower().replace(" ", "")
    digits = len(stripped) - len(stripped.lstrip("+-.0123456789"))
    unit = stripped[digits:]
    factor = _UNITS.get(unit, _UNITS.get(unit.removesuffix("s")))
    try:
        value = float(stripped[:digits]) if digits else float(_NUMBERS[stripped])
    except (ValueError, KeyError):
        return None
    return None if (factor is None and digits) or not math.isfinite(value) else value * (factor or 1.0)


class _Matcher:
    """Matches one sentence with all templates."""

    def __init__(
        self, kb: QuestionContext, sentence: str, tokens: Sequence[_Token], find_body: FindBody | None
    ) -> None:
        self._kb = kb
        self._sentence = sentence
        self._tokens = tokens
        self._words = [token.word for token in tokens]
        self._find_body = find_body
        self._steps = 0
        self._candidates: dict[object, Sequence[_Candidate]] = {}

    def readings(self) -> Iterator[_Reading]:
        """All readings of the sentence in which every name is known."""
        for question, pattern in self._possible_patterns():
            for spans in self._matches(pattern.items, 0, 0, known_only=True):
                slots = {slot.argument.name: self._resolve(slot, span) for slot, span in spans}
                weight = sum(_LITERAL_WEIGHT for item in pattern.items if isinstance(item, str))
                weight += sum(end - start for slot, (start, end) in spans if slot.argument.choices)
                weight += sum(bool(slot.classes) for slot, _ in spans)
                yield _Reading(question, pattern.constants, slots, weight)

    def not_understood(self) -> SentenceNotUnderstoodError:
        """Why there is no reading: the unknown words, or the unknown name in the nearest wording."""
        by_words = self._unknown_wording()
        if by_words.unknown:
            return by_words
        failures: list[tuple[int, int, int, list[tuple[QuestionArgument, _Span]], SentencePattern, Question[Any]]] = []
        for question, pattern in self._possible_patterns():
            for spans in islice(self._matches(pattern.items, 0, 0, known_only=False), _MAX_CANDIDATES):
                unknown = [(slot.argument, span) for slot, span in spans if not self._resolve(slot, span)]
                literal = len(pattern.items) - len(spans)
                size = sum(end - start for _, (start, end) in unknown)
                failures.append((size, -literal, len(failures), unknown, pattern, question))
        if failures:
            *_, unknown, pattern, question = min(failures, key=lambda each: each[:3])
            phrases = [self._raw(span) for _, span in unknown]
            names = (
                name
                for argument, span in unknown
                if isinstance(argument.value_type, EntityType)
                for name in self._kb.names.nearest(self._raw(span), argument.value_type, limit=_MAX_NEAREST_NAMES)
            )
            near = tuple(dict.fromkeys(names))[:_MAX_NEAREST_NAMES]
            asked = f"{question.name}: {pattern.text()}"
            return SentenceNotUnderstoodError(self._sentence, unknown=phrases, names=near, questions=(asked,))
        return by_words

    def _unknown_wording(self) -> SentenceNotUnderstoodError:
        patterns = [(question, pattern) for question in list_questions() for pattern in sentence_patterns(question)]
        vocabulary = {word for _, pattern in patterns for word in pattern.words}
        forms = {form: {_same_word(word) for word in form.split() if word[0] != "<"} for form in EXAMPLE_FORMS}
        vocabulary |= (
            {word for words in forms.values() for word in words} | OPERATORS | {*map(_same_word, GRAMMAR_WORDS)}
        )
        unknown = [
            word
            for word in dict.fromkeys(self._words)
            if word not in vocabulary and not self._kb.names.things(word, EntityType.VALUE, partial=True)
        ]
        meant = {word: get_close_matches(word, vocabulary, n=1) for word in unknown}
        words = {similar for word in self._words for similar in (meant.get(word) or [word])}
        nearest: dict[str, tuple[float, int, str]] = {}
        for question, pattern in patterns:
            shared = len(pattern.words & words)
            score = (-shared / len(pattern.words | words), len(pattern.items), f"{question.name}: {pattern.text()}")
            if shared and score < nearest.get(question.name, (1.0, 0, "")):
                nearest[question.name] = score
        for form, own in forms.items():
            shared = len(own & words)
            score = (-shared / len(own | words), len(form.split()), form)
            if shared:
                nearest[form] = score
        names = [
            name
            for word in unknown[:_NEAREST]
            for name in sorted(
                (*meant[word], *self._kb.names.nearest(word, EntityType.VALUE, limit=2)),
                key=lambda each: -SequenceMatcher(None, word, each.lower()).ratio(),
            )
        ]
        return SentenceNotUnderstoodError(
            self._sentence,
            unknown=unknown[:_MAX_NEAREST_NAMES],
            names=tuple(dict.fromkeys(names))[:_MAX_NEAREST_NAMES],
            questions=tuple(text for *_, text in sorted(nearest.values())[:_NEAREST]),
        )

    def _possible_patterns(self) -> Iterator[tuple[Question[Any], SentencePattern]]:
        present = {*self._words}
        said = {*sentence_words(self._sentence)}
        for question in questions_with_words(present):
            if said & PAST_WORDS and not question.about_past:
                continue
            for pattern in sentence_patterns(question):
                if pattern.words <= present and len(pattern.items) <= len(self._words):
                    shown = {word for item in pattern.shown if isinstance(item, str) for word in sentence_words(item)}
                    if said & (OPERATORS | FUTURE_WORDS) <= shown:
                        yield question, pattern

    def _matches(
        self, items: tuple[str | Slot, ...], at: int, start: int, *, known_only: bool
    ) -> Iterator[tuple[tuple[Slot, _Span], ...]]:
        """The places of the arguments, for each way in which the words from `start` match the items from `at`."""
        self._steps += 1
        if self._steps > _MAX_STEPS:
            raise SentenceNotUnderstoodError(self._sentence, cause="it has too many readings: use fewer words")
        if at == len(items):
            if start == len(self._words):
                yield ()
            return
        item = items[at]
        if isinstance(item, str):
            if start < len(self._words) and self._words[start] == item:
                yield from self._matches(items, at + 1, start + 1, known_only=known_only)
            return
        last = min(start + _MAX_NAME_WORDS, len(self._words) - (len(items) - at - 1))
        for end in range(start + 1, last + 1):
            if self._is_whole((start, end)) and (not known_only or self._resolve(item, (start, end))):
                for rest in self._matches(items, at + 1, end, known_only=known_only):
                    yield ((item, (start, end)), *rest)

    def _is_whole(self, span: _Span) -> bool:
        """Whether a place begins and ends with a chunk, so that `milk_carton_1` is not divided."""
        start, end = span
        begins = start == 0 or self._tokens[start - 1].start != self._tokens[start].start
        return begins and (end == len(self._tokens) or self._tokens[end - 1].start != self._tokens[end].start)

    def _raw(self, span: _Span) -> str:
        return self._sentence[self._tokens[span[0]].start : self._tokens[span[1] - 1].end]

    def _resolve(self, slot: Slot, span: _Span) -> Sequence[_Candidate]:
        key = slot.argument.value_type, slot.classes, span
        if key not in self._candidates:
            found = self._find(slot.argument, self._raw(span))
            self._candidates[key] = tuple(islice((each for each in found if self._fits(slot, each)), _MAX_CANDIDATES))
        return self._candidates[key]

    def _fits(self, slot: Slot, candidate: _Candidate) -> bool:
        if not slot.classes:
            return True
        reasoner, iri = self._kb.reasoner, Iri(str(candidate.value))
        wanted = [each.iri for name in slot.classes for each in self._kb.names.things(name, EntityType.CLASS)]
        if reasoner.is_individual(iri):
            return any(reasoner.is_member(iri, cls) for cls in wanted)
        return any(reasoner.is_a(iri, cls) for cls in wanted)

    def _find(self, argument: QuestionArgument, text: str) -> Iterator[_Candidate]:
        value_type = argument.value_type
        if isinstance(value_type, EntityType):
            found = self._kb.names.things(text, value_type, partial=value_type is not EntityType.MAP)
            if value_type is EntityType.INDIVIDUAL and all(each.quality or each.members == () for each in found):
                body = self._find_body(text) if self._find_body else None  # one that was spawned without a map
                if body:
                    yield _Candidate(body)
                    return
            for each in found:
                if value_type is EntityType.INDIVIDUAL and each.iri in self._kb.reasoner.members_by_map:
                    continue  # a map is no thing in it
                exact = each.quality is NameQuality.EXACT
                yield _Candidate(each.iri, each.quality, "" if exact else each.note)
        elif argument.choices:
            key = "".join(name_words(text))
            for choice in argument.choices:
                if any("".join(name_words(each)) == key for each in (choice, *_CHOICE_SYNONYMS.get(choice, ()))):
                    yield _Candidate(choice)
        elif value_type is bool:
            return
        elif value_type in {int, float}:
            number = _number(text)
            if number is not None and (value_type is float or number.is_integer()):
                yield _Candidate(number if value_type is float else int(number))
        elif value_type is str:
            yield _Candidate(text)


def is_only_map(kb: QuestionContext, text: str) -> bool:
    """Whether a noun names the only map, and nothing in it."""
    maps = kb.maps()
    noun = kb.names.noun(text)
    is_thing = noun is not None and (noun.individuals or noun.members)
    return len(maps) == 1 and not is_thing and [each.iri for each in kb.names.things(text, EntityType.MAP)] == [*maps]


def find_noun(kb: QuestionContext, find_body: FindBody | None, text: str) -> Noun | None:
    """What a noun stands for, also a body that was spawned without a map."""
    found = kb.names.noun(text)
    if find_body is not None and not (found and found.individuals):
        names = (text, text[:1].upper() + text[1:])  # words are in lower case, but ids may begin with a capital
        if (body := next(filter(None, map(find_body, names)), None)) is not None:
            return Noun((body,), found.members if found else ())
    return found


def _call_text(question: Question[Any], args: Mapping[str, object], *, full: bool = False) -> str:
    def shown(value: object) -> str:
        text = str(value.value if isinstance(value, Enum) else value)
        return text if full else local_name(text) if "://" in text else text

    return " ".join([question.name, *(f"{name}={shown(value)}" for name, value in args.items())])
