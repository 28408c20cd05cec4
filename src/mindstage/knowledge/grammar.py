"""A small English grammar of questions: "are all drawers closed?" as operators over sets of individuals.

    question  := is PHRASE PREDICATE? | is there PHRASE | do we have PHRASE | which PHRASE PREDICATE | what PREDICATE
               | how many PHRASE PREDICATE | where is PHRASE | how heavy is PHRASE | list PHRASE | …
    phrase    := [quantifier] [article] [state] noun (place | that is PREDICATE | with PHRASE)*, joined by and, or
    predicate := [not] (on | in | … PHRASE | open | closed | a noun | heavier than PHRASE | …), joined by and, or

A noun is looked up in `NameIndex.noun`: it stands for one individual, or for the individuals of classes. Nothing is
evaluated here; `mindstage.knowledge.queries.worded` does that. Every word of a sentence must be used: apart from those
in `IGNORED_WORDS`, which can change no answer, a word that is not covered makes the sentence not understood.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import msgspec
from msgspec.structs import replace

from mindstage.knowledge.names import Noun, is_plural
from mindstage.scene import Iri

__all__ = [
    "EXAMPLE_FORMS",
    "FUTURE_WORDS",
    "GRAMMAR_WORDS",
    "IGNORED_WORDS",
    "OPERATORS",
    "PAST_WORDS",
    "BelongsTo",
    "Between",
    "Comparison",
    "Form",
    "Has",
    "IsPartOf",
    "Joined",
    "KindOf",
    "MeasuredBy",
    "MeasuredProperty",
    "Negated",
    "Opened",
    "Phrase",
    "Predicate",
    "Quantifier",
    "Related",
    "Stated",
    "Supports",
    "WordedCommand",
    "WordedQuestion",
    "names_nothing",
    "parse_command",
    "parse_sentence",
    "sentence_words",
    "the_number",
]

IGNORED_WORDS = frozenset(
    ("please", "now", "currently", "still", "just", "hello", "hey", "thanks", "also", "really", "actually",
     "here", "own", "kindly", "well", "ok", "okay", "so")
)  # fmt: skip
"""Words that change no answer. None is a quantifier, negation, number, comparison, tense or preposition."""
PAST_WORDS = frozenset(("was", "were", "did", "had", "been", "yesterday", "ago", "earlier", "before"))
"""Words of the past, which only questions about recordings have."""
_PRESENT = {"was": "is", "were": "are"}
FUTURE_WORDS = frozenset(("will", "would", "tomorrow", "later", "soon"))
"""Words of what may happen, which only questions that imagine have."""
OPERATORS = frozenset(
    (
        "all",
        "every",
        "each",
        "any",
        "none",
        "no",
        "not",
        "both",
        "either",
        "neither",
        "never",
        "only",
        "except",
        "without",
        "more",
        "less",
        "fewer",
        "most",
        "least",
        "nothing",
        "anything",
        "something",
        "everything",
        "or",
    )
)
"""Words that change an answer, and that the declared wordings of questions may not leave out."""
_OPENINGS = (
    "can you tell me if", "could you tell me if", "tell me if", "do you know if", "can you tell me whether",
    "can you tell me", "could you tell me", "can you say", "tell me", "do you know", "i want to know",
    "i would like to know", "show me", "can you show me", "can you",
)  # fmt: skip
_CONTRACTIONS = {
    "what's": "what is", "where's": "where is", "who's": "who is", "which's": "which is", "there's": "there is",
    "how's": "how is", "isn't": "is not", "aren't": "are not", "don't": "do not", "doesn't": "does not",
    "can't": "can not", "cannot": "can not", "won't": "will not", "wasn't": "was not", "weren't": "were not",
    "didn't": "did not", "whats": "what is", "wheres": "where is", "haven't": "have not", "hasn't": "has not",
}  # fmt: skip
_ARTICLES = frozenset(("the", "a", "an", "my", "our", "your", "this", "that", "these", "those", "some"))
_GENERAL = frozenset(("thing", "things", "object", "objects", "item", "items", "stuff"))
_PRONOUNS = {"something": "some", "anything": "some", "everything": "all", "nothing": "no"}
_NUMBERS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
_RELATIONS = {
    "on": ("on top of", "on", "upon"),
    "inside": ("inside of", "inside", "within", "in"),
    "above": ("above", "over"),
    "below": ("underneath", "beneath", "below", "under"),
    "next_to": ("next to", "beside", "near", "by", "close to"),
}
_POSTURES = ("standing", "lying", "sitting", "placed", "located")
_VERBS = ("stands", "stand", "lies", "lie", "sits", "sit", "hangs", "hang")
_CONTAIN = ("contains", "contain", "holds", "hold")
_STATED = ("clean", "dirty", "on", "off", "full", "empty", "hot", "cold", "warm", "broken")
_MAX_NOUN_WORDS = 6
_NEVER_IN_NOUNS = (
    _ARTICLES
    | OPERATORS
    | {*_PRONOUNS, *_CONTAIN, *_VERBS, *_POSTURES}
    | {
        word
        for texts in _RELATIONS.values()
        for text in texts
        for word in text.split()
        if word not in {"top", "of", "close"}
    }
    | {
        "and",
        "or",
        "is",
        "are",
        "which",
        "who",
        "with",
        "have",
        "has",
        "do",
        "does",
        "than",
        "as",
        "from",
        "between",
        "how",
        "what",
        "where",
        "there",
        "to",
    }
)
"""Words that end a noun."""


EXAMPLE_FORMS = (
    "where is <thing>", "is <thing> in <place>", "is <thing> on <place>", "is <thing> open", "are all <things> closed",
    "is there <thing> in <place>", "do we have <thing>", "which <things> are in <place>", "which <things> are open",
    "what is in <place>", "what is on <place>", "how many <things> are there", "how many <things> are in <place>",
    "how heavy is <thing>", "how tall is <thing>", "how far is <thing> from <other>", "is <thing> heavier than <other>",
    "which <thing> is the heaviest", "which <thing> is the nearest to <other>", "are there more <things> than <others>",
    "what are the parts of <thing>", "list <things>",
)  # fmt: skip
"""Questions that the grammar covers, of which the nearest are shown for a sentence that it does not."""


class MeasuredProperty(StrEnum):
    """What individuals are measured by."""

    MASS = "mass"
    HEIGHT = "height"
    WIDTH = "width"
    DEPTH = "depth"
    LENGTH = "length"
    VOLUME = "volume"
    OPENNESS = "openness"

    @property
    def unit(self) -> str:
        """The unit of its values."""
        return {"mass": "kg", "volume": "m³", "openness": ""}.get(self.value, "m")


_ADJECTIVES = {
    "heavy": (MeasuredProperty.MASS, 1),
    "light": (MeasuredProperty.MASS, -1),
    "tall": (MeasuredProperty.HEIGHT, 1),
    "high": (MeasuredProperty.HEIGHT, 1),
    "short": (MeasuredProperty.HEIGHT, -1),
    "low": (MeasuredProperty.HEIGHT, -1),
    "wide": (MeasuredProperty.WIDTH, 1),
    "narrow": (MeasuredProperty.WIDTH, -1),
    "deep": (MeasuredProperty.DEPTH, 1),
    "long": (MeasuredProperty.LENGTH, 1),
    "large": (MeasuredProperty.VOLUME, 1),
    "big": (MeasuredProperty.VOLUME, 1),
    "small": (MeasuredProperty.VOLUME, -1),
}
_MEASURE_NOUNS = {"weight": "mass", "mass": "mass", "height": "height", "width": "width", "depth": "depth",
                  "length": "length", "volume": "volume"}  # fmt: skip
_UNITS = {"kg": 1.0, "kilogram": 1.0, "kilograms": 1.0, "kilo": 1.0, "kilos": 1.0, "g": 0.001, "gram": 0.001,
          "grams": 0.001, "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "cm": 0.01,
          "centimeters": 0.01, "centimeter": 0.01, "mm": 0.001}  # fmt: skip
_MASS_UNITS = frozenset(("kg", "kilogram", "kilograms", "kilo", "kilos", "g", "gram", "grams"))


def _inflected(adjective: str, ending: str) -> str:
    """The comparative ("er") or superlative ("est") of an adjective."""
    stem = adjective[:-1] + "i" if adjective.endswith("y") else adjective.removesuffix("e")
    return (stem + stem[-1] if adjective in {"big"} else stem) + ending


_COMPARATIVES = {_inflected(each, "er"): each for each in _ADJECTIVES}
_SUPERLATIVES = {_inflected(each, "est"): each for each in _ADJECTIVES}


GRAMMAR_WORDS = frozenset(
    {
        *_NEVER_IN_NOUNS,
        *_GENERAL,
        *_ADJECTIVES,
        *_COMPARATIVES,
        *_SUPERLATIVES,
        *_MEASURE_NOUNS,
        *_UNITS,
        *_STATED,
        *_NUMBERS,
    }
    | {
        "open",
        "opened",
        "closed",
        "shut",
        "nearest",
        "closest",
        "weigh",
        "weighs",
        "parts",
        "part",
        "list",
        "find",
        "count",
    }
)
"""Words that have a meaning in the grammar."""


class Form(StrEnum):
    """What a question asks for."""

    TRUTH = "truth"
    WHICH = "which"
    COUNT = "count"
    WHERE = "where"
    MEASURE = "measure"
    EXTREME = "extreme"
    NEAREST = "nearest"
    DISTANCE = "distance"
    MORE = "more"


class Quantifier(msgspec.Struct, frozen=True):
    """How many of a set a predicate must hold for."""

    word: str
    """the, a, all, some, no, both, or "at least", "at most", "more than", "fewer than", "exactly" with a number."""
    number: int | None = None

    def __str__(self) -> str:
        return self.word if self.number is None else f"{self.word} {self.number}"


class Phrase(msgspec.Struct, frozen=True):
    """A noun phrase: a set of individuals, of which a predicate holds for as many as the quantifier says."""

    text: str
    """The noun as it is shown; empty for things of any kind."""
    members: tuple[Iri, ...] | None
    """The individuals that the noun stands for; None for all."""
    quantifier: Quantifier
    plural: bool = False
    restrictions: tuple[Predicate, ...] = ()
    parts: tuple[Phrase, ...] = ()
    """The phrases that are joined; the other fields are then empty."""
    operator: str = ""

    def __str__(self) -> str:
        if self.parts:
            return f" {self.operator} ".join(map(str, self.parts))
        noun = self.text or ("things" if self.plural else "thing")
        described = " ".join([noun, *(f"that {'are' if self.plural else 'is'} {each}" for each in self.restrictions)])
        return described if not self.quantifier.word else f"{self.quantifier} {described}"


class Related(msgspec.Struct, frozen=True):
    """A spatial relation to things."""

    relation: str
    other: Phrase

    def __str__(self) -> str:
        return f"{'in' if self.relation == 'inside' else self.relation.replace('_', ' ')} {self.other}"


class Opened(msgspec.Struct, frozen=True):
    """Being open or closed."""

    state: str

    def __str__(self) -> str:
        return self.state


class Stated(msgspec.Struct, frozen=True):
    """A state that must be asserted, such as clean."""

    state: str

    def __str__(self) -> str:
        return self.state


class KindOf(msgspec.Struct, frozen=True):
    """Being one of the individuals that a noun stands for."""

    kind: Phrase

    def __str__(self) -> str:
        return str(self.kind if self.kind.plural or self.kind.parts else f"a {self.kind}")


class Has(msgspec.Struct, frozen=True):
    """Containing things, or having them as parts."""

    other: Phrase
    verb: str
    """contain, hold (in or on it), or have (its parts, too)."""

    def __str__(self) -> str:
        return f"{'hav' if self.verb == 'have' else self.verb}ing {self.other}"


class Comparison(msgspec.Struct, frozen=True):
    """Being more, less or as much by a measure than things or a number."""

    measure: MeasuredProperty
    sign: int
    """1 for more, -1 for less, 0 for as much."""
    other: Phrase | None = None
    number: float | None = None
    adjective: str = ""

    def __str__(self) -> str:
        than = str(self.other) if self.other else f"{self.number:g} {self.measure.unit}"
        return f"as {self.adjective} as {than}" if self.sign == 0 else f"{_inflected(self.adjective, 'er')} than {than}"


class MeasuredBy(msgspec.Struct, frozen=True):
    """The order of a superlative or of a measure."""

    measure: MeasuredProperty
    sign: int = 1
    adjective: str = ""


class Between(msgspec.Struct, frozen=True):
    """Being between two things."""

    one: Phrase
    other: Phrase

    def __str__(self) -> str:
        return f"between {self.one} and {self.other}"


class IsPartOf(msgspec.Struct, frozen=True):
    """Being a part of a whole, at any depth."""

    whole: Phrase

    def __str__(self) -> str:
        return f"part of {self.whole}"


class BelongsTo(msgspec.Struct, frozen=True):
    """Being what a whole has, holds or contains."""

    whole: Phrase
    verb: str

    def __str__(self) -> str:
        return f"that {self.whole} {'has' if self.verb == 'have' else self.verb + 's'}"


class Supports(msgspec.Struct, frozen=True):
    """Having things in a spatial relation to it."""

    relation: str
    other: Phrase

    def __str__(self) -> str:
        return f"with {self.other} {self.relation.replace('_', ' ')} it"


class Negated(msgspec.Struct, frozen=True):
    """The opposite of a predicate."""

    inner: Predicate

    def __str__(self) -> str:
        return f"not {self.inner}"


class Joined(msgspec.Struct, frozen=True):
    """Predicates joined by and, or."""

    parts: tuple[Predicate, ...]
    operator: str

    def __str__(self) -> str:
        return f" {self.operator} ".join(map(str, self.parts))


Predicate = (
    Related | Opened | Stated | KindOf | Has | Comparison | Between | IsPartOf | BelongsTo | Supports | Negated | Joined
)


class WordedQuestion(msgspec.Struct, frozen=True):
    """A question as it was understood."""

    form: Form
    subject: Phrase
    predicate: Predicate | None = None
    order: MeasuredBy | None = None
    other: Phrase | None = None
    clauses: tuple[WordedQuestion, ...] = ()
    """Questions for a yes or no that are joined; the other fields then say nothing."""
    operator: str = ""

    def __str__(self) -> str:  # noqa: PLR0911 - one per form
        """The question as a sentence, which is understood as the same question."""
        if self.clauses:
            return f" {self.operator} ".join(str(each).rstrip("?") for each in self.clauses) + "?"
        subject, plural = self.subject, self.subject.plural or self.subject.operator == "and"
        be = "are" if plural else "is"
        rest = f" {self.predicate}" if self.predicate else ""
        match self.form:
            case Form.TRUTH:
                return f"{be} {subject}{rest}?" if self.predicate else f"{be} there {subject}?"
            case Form.WHICH:
                return f"which {subject} {be}{rest}?" if self.predicate else f"list {subject}."
            case Form.COUNT:
                if isinstance(self.predicate, BelongsTo):
                    return f"how many {subject} does {self.predicate.whole} {self.predicate.verb}?"
                return f"how many {subject} are{rest or ' there'}?"
            case Form.WHERE:
                return f"where {be} {subject}?"
            case Form.MEASURE if self.order:
                return f"how {self.order.adjective} {be} {subject}?"
            case Form.EXTREME if self.order:
                return f"which {subject} is the {_inflected(self.order.adjective, 'est')}?"
            case Form.NEAREST:
                return f"which {subject} is the nearest to {self.other}?"
            case Form.DISTANCE:
                return f"how far is {subject} from {self.other}?"
            case _:
                return f"are there more {subject} than {self.other}?"


def names_nothing(question: WordedQuestion) -> bool:
    """Whether a noun of a question stands for nothing in the loaded maps."""
    phrases = [question.subject, *(each for each in (question.other,) if each)]
    while phrases:
        phrase = phrases.pop()
        phrases += phrase.parts
        if not phrase.parts and phrase.members == ():
            return True
    return False


FindNoun = Callable[[str], Noun | None]


class _NoReadingError(Exception):
    """The words from here are no phrase of this kind."""


def sentence_words(sentence: str) -> list[str]:
    """The words of a sentence without politeness and punctuation; in lower case, but not names such as blueBottle."""
    plain = re.sub(r"[\u2018\u2019]", "'", sentence.strip())
    chunks = [chunk.strip('"`\u201c\u201d«»\u201e.,;:!?()[]…') for chunk in plain.split()]
    chunks = [chunk if ":" in chunk or chunk[1:] != chunk[1:].lower() else chunk.lower() for chunk in chunks]
    text = " ".join(_CONTRACTIONS.get(chunk, chunk) for chunk in chunks if chunk)
    for opening in _OPENINGS:
        if text.startswith(f"{opening} "):
            text = text.removeprefix(f"{opening} ")
            break
    for closing in (" right now", " at the moment", " at present", " today", " if you please"):
        text = text.removesuffix(closing)
    return [word for word in text.split() if word not in IGNORED_WORDS]


def the_number(text: str) -> float | None:
    """A number in digits or as a word up to twelve; None for anything else."""
    if text in _NUMBERS:
        return float(_NUMBERS.index(text))
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def parse_sentence(
    sentence: str,
    find_noun: FindNoun,
    is_map: Callable[[str], bool] = lambda text: False,
    *,
    is_past: bool = False,
) -> list[WordedQuestion]:
    """All different readings of a sentence as a question; none if the grammar does not cover it.

    Args:
        sentence: what was asked.
        find_noun: what the words of a noun stand for.
        is_map: whether a noun names the only map, in which everything is.
        is_past: whether a time of a recording is asked about, so that "was" is meant.
    """
    words = [_PRESENT.get(word, word) if is_past else word for word in sentence_words(sentence)]
    if not words or (PAST_WORDS | FUTURE_WORDS) & {*words}:
        return []
    if words[-3:-1] in (["in", "the"], ["in", "this"], ["in", "our"], ["in", "my"]) and is_map(words[-1]):
        words = words[:-3]
    elif words[-2:-1] == ["in"] and is_map(words[-1]):
        words = words[:-2]
    parser = _Parser(words, find_noun)
    return list(dict.fromkeys(parser.questions()))


class WordedCommand(msgspec.Struct, frozen=True):
    """A command, or a question about what it would do, as it was understood."""

    skill: str
    phrases: tuple[tuple[str, Phrase], ...]
    """The arguments by name."""
    template: str
    """The wording that was used."""
    is_hypothetical: bool = False
    """Whether it asks what would happen."""

    def __str__(self) -> str:
        text = self.template
        for name, phrase in self.phrases:
            text = text.replace(f"{{{name}}}", str(phrase))
        return f"what happens if i {text}?" if self.is_hypothetical else text


def parse_command(
    sentence: str, templates: Sequence[tuple[str, str]], find_noun: FindNoun, is_map: Callable[[str], bool]
) -> list[WordedCommand]:
    """All different readings of a sentence as a command; none unless every word is part of it.

    Args:
        sentence: what is to be done, or "what happens if I" and that.
        templates: pairs of a skill and a wording, such as "put {thing} on {on}".
        find_noun: what the words of a noun stand for.
        is_map: whether a noun names the only map.
    """
    words = sentence_words(sentence)
    is_hypothetical = False
    for opening in _HYPOTHETICAL:
        if words[: len(opening)] == opening:
            words, is_hypothetical = [_base_form(word) for word in words[len(opening) :]], True
    words = words[next((len(each) for each in _POLITE if words[: len(each)] == each), 0) :]
    if words[-3:-1] in (["in", "the"], ["in", "this"]) and is_map(words[-1]):
        words = words[:-3]
    elif words[-2:-1] == ["in"] and is_map(words[-1]):
        words = words[:-2]
    parser = _Parser(words, find_noun)
    found = (parser.command(skill, template, is_hypothetical) for skill, template in templates)
    return list(dict.fromkeys(each for each in found if each is not None))


_HYPOTHETICAL = [
    text.split()
    for start in ("what happens if", "what happens when", "what would happen if", "what will happen if", "what if")
    for text in (f"{start} i", f"{start} we", f"{start} you", f"{start} the robot")
]
_POLITE = [text.split() for text in ("could you", "would you", "can you", "i want you to", "robot", "go and")]


def _base_form(word: str) -> str:
    """The base form of a verb in a condition: what would happen if I opened it."""
    return {"opened": "open", "closed": "close", "took": "take", "went": "go", "placed": "place", "picked": "pick"}.get(
        word, word
    )


@dataclass
class _Parser:
    """Recursive descent without a grammar file: each method returns what it read and the place after it."""

    words: Sequence[str]
    find_noun: FindNoun
    found: dict[str, Noun | None] = field(default_factory=dict)

    def questions(self) -> Iterator[WordedQuestion]:
        for rule in (
            self._there_is, self._truth, self._have, self._has, self._count, self._where, self._measure, self._distance,
            self._extreme, self._nearest, self._what, self._which, self._which_place, self._list, self._fragment,
        ):  # fmt: skip
            try:
                question, end = rule()
            except _NoReadingError:
                continue
            if end == len(self.words):
                yield question

    def command(self, skill: str, template: str, is_hypothetical: bool) -> WordedCommand | None:
        """The sentence by one wording of a command; None if it is another one."""
        at, phrases = 0, list[tuple[str, Phrase]]()
        for item in template.split():
            if not item.startswith("{"):
                if not self._is((item,), at):
                    return None
                at += 1
                continue
            try:
                phrase, at = self._phrase(at)
            except _NoReadingError:
                return None
            phrases.append((item[1:-1], phrase))
        return WordedCommand(skill, tuple(phrases), template, is_hypothetical) if at == len(self.words) else None

    # -- questions -----------------------------------------------------------------------------------------------------

    def _there_is(self) -> tuple[WordedQuestion, int]:
        at = self._any(("is there", "are there"), 0)
        if self._is(("more",), at) and not self._is(("more than",), at):
            return self._more(at + 1)
        subject, at = self._phrase(at)
        predicate, at = self._optional_predicate(at)
        subject = self._indefinite(subject)
        return WordedQuestion(Form.TRUTH, subject, predicate), at

    def _more(self, at: int) -> tuple[WordedQuestion, int]:
        one, at = self._phrase(at, joined=False)
        place, at = self._optional_predicate(at)
        at = self._any(("than",), at)
        self._skip(("there are",), at)
        other, at = self._phrase(at, joined=False)
        if place is None:
            place, at = self._optional_predicate(at)
        if place is not None:
            one = replace(one, restrictions=(*one.restrictions, place))
            other = replace(other, restrictions=(*other.restrictions, place))
        return WordedQuestion(Form.MORE, one, other=other), at

    def _truth(self) -> tuple[WordedQuestion, int]:
        at = self._any(("is", "are"), 0)
        is_denied = self._is(("not",), at)
        subject, at = self._phrase(at + is_denied)
        predicate, at = self._predicate(at)
        question = WordedQuestion(Form.TRUTH, subject, predicate)
        while self._is(("and", "or"), at) and question.operator in {"", self.words[at]}:
            operator = self.words[at]
            subject, at = self._phrase(self._skip(("is", "are"), at + 1))
            predicate, at = self._predicate(at)
            clauses = (*(question.clauses or (question,)), WordedQuestion(Form.TRUTH, subject, predicate))
            question = WordedQuestion(Form.TRUTH, subject, clauses=clauses, operator=operator)
        return question, at

    def _have(self) -> tuple[WordedQuestion, int]:
        at = self._any(
            ("do we have", "do you have", "do i have", "have we got", "have you got", "does this kitchen have",
             "does the kitchen have", "have we", "does it have"), 0)  # fmt: skip
        subject, at = self._phrase(at)
        predicate, at = self._optional_predicate(at)
        at = self._skip(("left",), at)
        return WordedQuestion(Form.TRUTH, self._indefinite(subject), predicate), at

    def _has(self) -> tuple[WordedQuestion, int]:
        at = self._any(("does", "do"), 0)
        subject, at = self._phrase(at)
        verb, at = self._verb(at, (*_CONTAIN, "have"))
        other, at = self._phrase(at)
        return WordedQuestion(Form.TRUTH, subject, Has(self._indefinite(other), verb)), at

    def _count(self) -> tuple[WordedQuestion, int]:
        at = self._any(("how many", "number of", "what is the number of", "count the", "count"), 0)
        subject, at = self._phrase(at, joined=True)
        for ending in ("are there", "is there", "do we have", "do you have", "do i have", "do we", "are in the kitchen",
                       "does this kitchen have", "does the kitchen have", "in the kitchen", "stand in the kitchen",
                       "there are", "exist"):  # fmt: skip
            if self._is((ending,), at):
                after = at + len(ending.split())
                predicate, after = self._optional_predicate(after)
                return WordedQuestion(Form.COUNT, self._bare(subject), predicate), after
        if self._is(("does", "do"), at):
            whole, at = self._phrase(at + 1)
            verb, at = self._verb(at, (*_CONTAIN, "have"))
            return WordedQuestion(Form.COUNT, self._bare(subject), BelongsTo(whole, verb)), at
        at = self._skip(("are", "is"), at)
        predicate, at = self._optional_predicate(at)
        return WordedQuestion(Form.COUNT, self._bare(subject), predicate), at

    def _where(self) -> tuple[WordedQuestion, int]:
        for opening in ("where is", "where are", "where can i find", "where do i find", "where can we find", "locate",
                        "find"):  # fmt: skip
            if self._is((opening,), 0):
                subject, at = self._phrase(len(opening.split()))
                return WordedQuestion(Form.WHERE, subject), self._skip(_POSTURES[:4], at)
        subject, at = self._phrase(self._any(("where",), 0))
        return WordedQuestion(Form.WHERE, subject), self._any(("is", "are"), at)

    def _which_place(self) -> tuple[WordedQuestion, int]:
        """In which drawer are the mugs?"""
        relation, at = self._relation(0)
        at = self._any(("which", "what"), at)
        place, at = self._phrase(at, joined=False)
        at = self._any(("is", "are", "do i find", "can i find"), at)
        subject, at = self._phrase(at)
        if relation != "inside":
            return WordedQuestion(Form.WHICH, self._bare(place), Supports(relation, self._existential(subject))), at
        return WordedQuestion(Form.WHICH, self._bare(place), Has(self._existential(subject), "contain")), at

    def _measure(self) -> tuple[WordedQuestion, int]:
        if self._is(("how",), 0):
            if self._is(("how much does", "how much do"), 0):
                subject, at = self._phrase(3)
                return WordedQuestion(
                    Form.MEASURE, subject, None, MeasuredBy(MeasuredProperty.MASS, 1, "heavy")
                ), self._any(("weigh",), at)
            at = 1
            if self._is(("wide open", "far open", "open"), at):
                at = self._any(("wide open", "far open", "open"), at)
                order = MeasuredBy(MeasuredProperty.OPENNESS, 1, "open")
            else:
                adjective = self._word(
                    at, {each for each, (_, sign) in _ADJECTIVES.items() if sign > 0} - {"big", "large"}
                )
                order, at = MeasuredBy(_ADJECTIVES[adjective][0], 1, adjective), at + 1
            subject, at = self._phrase(self._any(("is", "are"), at))
            return WordedQuestion(Form.MEASURE, subject, None, order), at
        if self._is(("what does", "what do"), 0):
            subject, at = self._phrase(2)
            return WordedQuestion(
                Form.MEASURE, subject, None, MeasuredBy(MeasuredProperty.MASS, 1, "heavy")
            ), self._any(("weigh",), at)
        at = self._any(("what is the",), 0)
        measure = MeasuredProperty(_MEASURE_NOUNS[self._word(at, _MEASURE_NOUNS)])
        subject, at = self._phrase(self._any(("of",), at + 1))
        adjective = next(each for each, (of, sign) in _ADJECTIVES.items() if of is measure and sign > 0)
        return WordedQuestion(Form.MEASURE, subject, None, MeasuredBy(measure, 1, adjective)), at

    def _distance(self) -> tuple[WordedQuestion, int]:
        if self._is(("how far apart are", "what is the distance between"), 0):
            at = self._any(("how far apart are", "what is the distance between"), 0)
            one, at = self._phrase(at, joined=False)
            other, at = self._phrase(self._any(("and",), at), joined=False)
            return WordedQuestion(Form.DISTANCE, one, other=other), at
        at = self._any(("how far away is", "how far is", "how far are", "what is the distance from", "how close is"), 0)
        is_reversed = self._is(("it from",), at)
        one, at = self._phrase(at + 2 * is_reversed, joined=False)
        at = self._any(("to",) if is_reversed else ("away from", "from", "to"), at)
        other, at = self._phrase(at, joined=False)
        return WordedQuestion(Form.DISTANCE, one, other=other), at

    def _extreme(self) -> tuple[WordedQuestion, int]:
        at = self._any(("what", "which"), 0)
        if not self._is(("is", "are"), at):  # which knife is the longest
            subject, at = self._phrase(at)
            at = self._skip(("the",), self._any(("is", "are"), at))
            adjective = _SUPERLATIVES[self._word(at, _SUPERLATIVES)]
            subject, at = self._bare(subject), at + 1
        else:
            at = self._skip(("the",), at + 1)
            adjective = _SUPERLATIVES[self._word(at, _SUPERLATIVES)]
            subject, at = self._phrase(at + 1)
        measure, sign = _ADJECTIVES[adjective]
        return WordedQuestion(Form.EXTREME, self._bare(subject), None, MeasuredBy(measure, sign, adjective)), at

    def _nearest(self) -> tuple[WordedQuestion, int]:
        near = ("nearest", "closest")
        at = self._any(("what", "which", "where"), 0)
        if self._is(("is the", "are the"), at):
            self._word(at + 2, near)
            subject, at = self._phrase(at + 3)
        else:
            subject, at = self._phrase(at)
            at = self._skip(("the",), self._any(("is", "are"), at))
            self._word(at, near)
            at += 1
        other, at = self._phrase(self._any(("to", "from"), at), joined=False)
        return WordedQuestion(Form.NEAREST, self._bare(subject), other=other), at

    def _what(self) -> tuple[WordedQuestion, int]:
        things = Phrase("", None, Quantifier(""), plural=True)
        if self._is(("what does", "what do"), 0) and not self._is(("what do we", "what do you", "what do i"), 0):
            whole, at = self._phrase(2)
            _, at = self._verb(at, _CONTAIN)
            return WordedQuestion(Form.WHICH, things, Related("inside", whole)), at
        for opening in ("what do we have", "what do you have", "what can i find", "what is there", "what do i find",
                        "what is", "what are"):  # fmt: skip
            if self._is((opening,), 0):
                predicate, at = self._predicate(len(opening.split()), kinds=False)
                return WordedQuestion(Form.WHICH, things, predicate), at
        at = self._any(("what",), 0)
        predicate, at = self._verbal(at)
        return WordedQuestion(Form.WHICH, things, predicate), at

    def _which(self) -> tuple[WordedQuestion, int]:
        at = self._any(("which of", "which", "what"), 0)
        if self._is(("can", "could"), at):  # the verb, not a can of beans
            raise _NoReadingError
        subject, at = self._phrase(at)
        subject = self._bare(subject)
        for ending in ("are there", "is there", "do we have", "do you have", "does the kitchen have", "exist"):
            if self._is((ending,), at) and at + len(ending.split()) == len(self.words):
                return WordedQuestion(Form.WHICH, subject), len(self.words)
        if self._is(("belongs to", "belong to"), at):
            whole, at = self._phrase(at + 2)
            return WordedQuestion(Form.WHICH, subject, IsPartOf(whole)), at
        if self._is(("is", "are"), at):
            predicate, at = self._predicate(self._any(("is", "are"), at))
            return WordedQuestion(Form.WHICH, subject, predicate), at
        predicate, at = self._verbal(at)
        return WordedQuestion(Form.WHICH, subject, predicate), at

    def _list(self) -> tuple[WordedQuestion, int]:
        if self._is(("what are the parts of",), 0):
            whole, at = self._phrase(5)
            return WordedQuestion(Form.WHICH, Phrase("", None, Quantifier(""), plural=True), IsPartOf(whole)), at
        at = self._skip(("list all", "list", "show all", "show", "name"), 0)
        if at == 0 and not self._is(("all", "every", "everything"), 0):
            raise _NoReadingError
        subject, at = self._phrase(at)
        return WordedQuestion(Form.WHICH, self._bare(subject)), at

    def _fragment(self) -> tuple[WordedQuestion, int]:
        if not self._is(("any", "anything", "something"), 0):
            raise _NoReadingError
        subject, at = self._phrase(0)
        predicate, at = self._optional_predicate(at)
        return WordedQuestion(Form.TRUTH, self._indefinite(subject), predicate), at

    # -- predicates ----------------------------------------------------------------------------------------------------

    def _optional_predicate(self, at: int) -> tuple[Predicate | None, int]:
        try:
            return self._predicate(at)
        except _NoReadingError:
            return None, at

    def _predicate(self, at: int, *, kinds: bool = True) -> tuple[Predicate, int]:
        first, at = self._single(at, kinds=kinds)
        parts, operator = [first], ""
        while self._is(("and", "or"), at) and operator in {"", self.words[at]}:
            try:
                after = at + 1 + self._is(("is", "are"), at + 1)
                following, end = self._single(after, kinds=False)
            except _NoReadingError:
                break
            operator = self.words[at]
            parts.append(following)
            at = end
        return (Joined(tuple(parts), operator), at) if len(parts) > 1 else (first, at)

    def _single(self, at: int, *, kinds: bool = True) -> tuple[Predicate, int]:  # noqa: PLR0911, PLR0912 - one per predicate
        if self._is(("not",), at):
            inner, at = self._single(at + 1, kinds=kinds)
            return Negated(inner), at
        if self._is(("neither",), at):
            inner, at = self._predicate(at + 1, kinds=kinds)
            return Negated(inner), at
        at = self._skip(_POSTURES, at)
        if self._is(("open", "opened", "closed", "shut"), at) and not self._is(("open to",), at):
            return Opened("open" if self.words[at].startswith("open") else "closed"), at + 1
        if self._is(("between",), at):
            one, at = self._phrase(at + 1, joined=False)
            other, at = self._phrase(self._any(("and",), at), joined=False)
            return Between(one, other), at
        if self._is(("with",), at):
            other, at = self._phrase(at + 1)
            relation, at = self._relation(at)
            return Supports(relation, other), self._any(("it",), at)
        for verb, participle in (("contain", "containing"), ("hold", "holding"), ("have", "having")):
            if self._is((participle,), at):
                other, at = self._phrase(at + 1)
                return Has(other, verb), at
        if self._is(("part of", "a part of", "parts of"), at):
            whole, at = self._phrase(self._any(("part of", "a part of", "parts of"), at))
            return IsPartOf(whole), at
        try:
            return self._comparison(at)
        except _NoReadingError:
            pass
        try:
            relation, after = self._relation(at)
            other, after = self._phrase(after)
        except _NoReadingError:
            pass
        else:
            return Related(relation, other), after
        if self._is(_STATED, at):
            return Stated(self.words[at]), at + 1
        if kinds:
            kind, at = self._phrase(at)
            return KindOf(self._bare(kind)), at
        raise _NoReadingError

    def _comparison(self, at: int) -> tuple[Predicate, int]:
        if self._is(("as",), at):
            adjective = self._word(at + 1, _ADJECTIVES)
            other, at = self._phrase(self._any(("as",), at + 2))
            return Comparison(_ADJECTIVES[adjective][0], 0, other, None, adjective), at
        adjective = _COMPARATIVES[self._word(at, _COMPARATIVES)]
        measure, sign = _ADJECTIVES[adjective]
        at = self._any(("than",), at + 1)
        number, after = self._quantity(at, measure)
        if number is not None:
            return Comparison(measure, sign, None, number, adjective), after
        other, at = self._phrase(at)
        return Comparison(measure, sign, other, None, adjective), at

    def _quantity(self, at: int, measure: MeasuredProperty) -> tuple[float | None, int]:
        """A number with the unit of a measure; None if there is none."""
        text = self.words[at] if at < len(self.words) else ""
        match = re.fullmatch(r"(\d+(?:\.\d+)?)([a-z]*)", text)
        digits, unit, after = (match[1], match[2], at + 1) if match else (text, "", at + 1)
        if not unit and after < len(self.words):
            unit, after = self.words[after], after + 1
        number = the_number(digits)
        if number is None or unit not in _UNITS or (unit in _MASS_UNITS) is not (measure is MeasuredProperty.MASS):
            return None, at
        return number * _UNITS[unit], after

    def _verbal(self, at: int) -> tuple[Predicate, int]:
        """A predicate with its own verb: contains eggs, stands on the table, weighs more than 1 kg."""
        if self._is(("do not", "does not"), at):
            inner, at = self._verbal(at + 2)
            return Negated(inner), at
        if self._is(("weighs more than", "weigh more than", "weighs less than", "weigh less than"), at):
            sign = 1 if self.words[at + 1] == "more" else -1
            number, end = self._quantity(at + 3, MeasuredProperty.MASS)
            adjective = "heavy" if sign > 0 else "light"
            if number is not None:
                return Comparison(MeasuredProperty.MASS, sign, None, number, adjective), end
            other, at = self._phrase(at + 3)
            return Comparison(MeasuredProperty.MASS, sign, other, None, adjective), at
        if self._is(_VERBS, at):
            predicate, at = self._single(at + 1, kinds=False)
            if not isinstance(predicate, Related | Between):
                raise _NoReadingError
            return predicate, at
        verb, at = self._verb(at, (*_CONTAIN, "has", "have"))
        other, at = self._phrase(at)
        if self._is(("in it", "inside it", "inside", "in them", "inside them"), at):
            verb, at = "contain", self._any(("in it", "inside it", "in them", "inside them", "inside"), at)
        return Has(self._existential(other), verb), at

    def _relation(self, at: int) -> tuple[str, int]:
        for relation, texts in _RELATIONS.items():
            for text in texts:
                if self._is((text,), at):
                    return relation, at + len(text.split())
        raise _NoReadingError

    def _verb(self, at: int, verbs: Sequence[str]) -> tuple[str, int]:
        word = self._word(at, verbs)
        return ("have" if word == "has" else word.removesuffix("s")), at + 1

    # -- noun phrases --------------------------------------------------------------------------------------------------

    def _phrase(self, at: int, *, joined: bool = True) -> tuple[Phrase, int]:
        first, at = self._single_phrase(at)
        parts, operator = [first], ""
        while joined and self._is(("and", "or"), at) and operator in {"", self.words[at]}:
            try:
                following, end = self._single_phrase(at + 1)
            except _NoReadingError:
                break
            if self._is(("is", "are"), at + 1):
                break
            operator = self.words[at]
            if following.quantifier.word == "" and first.quantifier.word:
                following = replace(following, quantifier=first.quantifier)
            parts.append(following)
            at = end
        return (
            (Phrase("", (), Quantifier(""), parts=tuple(parts), operator=operator), at)
            if len(parts) > 1
            else (first, at)
        )

    def _single_phrase(self, at: int) -> tuple[Phrase, int]:
        quantifier, at = self._quantifier(at)
        state: Predicate | None = None
        pronoun = self.words[at] if at < len(self.words) else ""
        if pronoun in _PRONOUNS and not quantifier.word:
            phrase, at = Phrase("", None, Quantifier(_PRONOUNS[pronoun])), at + 1
        else:
            state, at = self._adjective(at)
            text, members, plural, at = self._noun(at)
            phrase = Phrase(text, members, quantifier, plural)
        if state is not None:
            phrase = replace(phrase, restrictions=(state,))
        while True:
            restriction, end = self._restriction(at)
            if restriction is None:
                return phrase, at
            phrase, at = replace(phrase, restrictions=(*phrase.restrictions, restriction)), end

    def _quantifier(self, at: int) -> tuple[Quantifier, int]:  # noqa: PLR0911 - one per kind
        for texts, word in (
            (("all of the", "all the", "all of", "all", "every", "each of the", "each"), "all"),
            (("none of the", "none of", "no"), "no"), (("both of the", "both the", "both"), "both"),
            (("any of the", "any", "some of the", "some"), "some"),
        ):  # fmt: skip
            for text in texts:
                if self._is((text,), at):
                    return Quantifier(word), self._skip(tuple(_ARTICLES), at + len(text.split()))
        for text, word in (
            ("at least", "at least"),
            ("at most", "at most"),
            ("more than", "more than"),
            ("less than", "fewer than"),
            ("fewer than", "fewer than"),
            ("exactly", "exactly"),
        ):
            after = at + len(text.split())
            if self._is((text,), at) and after < len(self.words):
                number = the_number(self.words[after])
                if number is None or not number.is_integer():
                    raise _NoReadingError
                return Quantifier(word, int(number)), after + 1
        if at < len(self.words) - 1 and (number := the_number(self.words[at])) is not None and number.is_integer():
            return Quantifier("at least", int(number)), at + 1
        if self._is(("a", "an"), at):
            return Quantifier("a"), at + 1
        if at < len(self.words) and self.words[at] in _ARTICLES:
            word = "some" if self.words[at] == "some" else "the"
            at += 1
            if at < len(self.words) - 1 and (number := the_number(self.words[at])) is not None and number.is_integer():
                return Quantifier("the", int(number)), at + 1
            return Quantifier(word), at
        return Quantifier(""), at

    def _adjective(self, at: int) -> tuple[Predicate | None, int]:
        """A state before a noun: the open drawers."""
        if self._is(("open", "closed", "shut"), at):
            return Opened("open" if self.words[at] == "open" else "closed"), at + 1
        if self._is(tuple(set(_STATED) - {"on", "off"}), at):
            return Stated(self.words[at]), at + 1
        return None, at

    def _noun(self, at: int) -> tuple[str, tuple[Iri, ...] | None, bool, int]:
        """The longest words from here that are a noun."""
        for end in range(min(len(self.words), at + _MAX_NOUN_WORDS), at, -1):
            text = " ".join(self.words[at:end])
            if _NEVER_IN_NOUNS & {*self.words[at:end]} or "of" in {self.words[at], self.words[end - 1]}:
                continue
            if end == at + 1 and text in _GENERAL:
                return "", None, text.endswith("s"), end
            if text not in self.found:
                self.found[text] = self.find_noun(text)
            noun = self.found[text]
            if noun is not None:
                plural = is_plural(self.words[end - 1])
                return text, noun.of(plural=plural), plural, end
        raise _NoReadingError

    def _restriction(self, at: int) -> tuple[Predicate | None, int]:
        """What follows a noun and restricts it, where it cannot be the predicate of the sentence."""
        try:
            if self._is(("that", "which", "who"), at):
                if self._is(("is", "are"), at + 1):
                    return self._predicate(at + 2)
                return self._verbal(at + 1)
            if self._is(("with",), at):
                other, at = self._phrase(at + 1)
                return Has(self._existential(other), "have"), at
            if self._is(("of the", "of a"), at):
                whole, at = self._phrase(at + 1)
                return IsPartOf(whole), at
            if self._has_predicate_after(at):
                relation, after = self._relation(at)
                other, after = self._phrase(after, joined=False)
                return Related(relation, other), after
        except _NoReadingError:
            pass
        return None, at

    def _has_predicate_after(self, at: int) -> bool:
        """Whether a place here must belong to the noun: a verb or a predicate follows it, or it began the sentence."""
        if not any(self._is((text,), at) for texts in _RELATIONS.values() for text in texts):
            return False
        try:
            _, after = self._relation(at)
            _, after = self._single_phrase(after)
        except _NoReadingError:
            return False
        rest = self.words[after:]
        opens_list = self.words[0] in {
            "list",
            "show",
            "all",
            "everything",
            "what",
            "which",
            "how",
            "where",
            "is",
            "are",
        }
        is_asked = self.words[0] in {"where", "how"} and self.words[1:2] != ["many"] and not rest
        is_extreme = any(word in _SUPERLATIVES for word in self.words[:at]) and not rest
        is_list = self.words[0] in {"list", "show", "all", "everything"} and not rest
        begins_predicate = bool(rest) and (
            rest[0]
            in {
                "is",
                "are",
                "open",
                "closed",
                "shut",
                "weigh",
                "weighs",
                "not",
                "as",
                "than",
                "from",
                "to",
                "contain",
                "contains",
                "do",
                "does",
                *_STATED,
                *_COMPARATIVES,
                *_POSTURES,
            }
            or any(self._is((text,), after) for texts in _RELATIONS.values() for text in texts)
        )
        return is_asked or is_extreme or is_list or (opens_list and begins_predicate)

    # -- words ---------------------------------------------------------------------------------------------------------

    @staticmethod
    def _bare(phrase: Phrase) -> Phrase:
        """A phrase of which the members are asked for."""
        if phrase.parts:
            return replace(phrase, parts=tuple(map(_Parser._bare, phrase.parts)))
        if phrase.quantifier.word in {"no", "both"} or phrase.quantifier.number is not None:
            raise _NoReadingError
        return replace(phrase, quantifier=Quantifier(""))

    @staticmethod
    def _indefinite(phrase: Phrase) -> Phrase:
        """A phrase of which one member is enough, unless a number or a negation says otherwise."""
        if phrase.parts:
            return replace(phrase, parts=tuple(map(_Parser._indefinite, phrase.parts)))
        if phrase.quantifier.word in {"", "a", "the"} and phrase.quantifier.number is None:
            return replace(phrase, quantifier=Quantifier("some"))
        return phrase

    @staticmethod
    def _existential(phrase: Phrase) -> Phrase:
        return _Parser._indefinite(phrase)

    def _is(self, texts: Sequence[str], at: int) -> bool:
        """Whether one of some texts stands here."""
        return any(list(self.words[at : at + len(words)]) == words for words in map(str.split, texts))

    def _any(self, texts: Sequence[str], at: int) -> int:
        """The place after the longest of some texts that stands here."""
        after = self._skip(texts, at)
        if after == at:
            raise _NoReadingError
        return after

    def _skip(self, texts: Sequence[str], at: int) -> int:
        """The place after the longest of some texts, if one stands here."""
        return at + max((len(text.split()) for text in texts if self._is((text,), at)), default=0)

    def _word(self, at: int, known: object) -> str:
        if at < len(self.words) and self.words[at] in known:  # type: ignore[operator]
            return self.words[at]
        raise _NoReadingError
