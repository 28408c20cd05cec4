r"""Patterns: POSIX extended regular expressions, in time that grows with the text alone.

A pattern comes over the wire, and Python's own matcher can be made to think for years. This one walks a text once, with
all states at a time that it could be in (Thompson's construction). It knows what POSIX knows: `.`, `[a-z[:digit:]]`,
`^`, `$`, `*`, `+`, `?`, `{2,5}`, `|`, groups, and `\` before what is meant literally.
"""

from __future__ import annotations

import string
from collections.abc import Callable

__all__ = ["Pattern", "PatternRefused"]

_MOST_STATES = 5000
_MOST_REPEATS = 255
"""POSIX's RE_DUP_MAX."""
_MOST_NESTED = 100
_CLASSES: dict[str, Callable[[str], bool]] = {
    "alnum": str.isalnum,
    "alpha": str.isalpha,
    "blank": " \t".__contains__,
    "cntrl": lambda letter: not letter.isprintable(),
    "digit": string.digits.__contains__,
    "graph": lambda letter: letter.isprintable() and not letter.isspace(),
    "lower": str.islower,
    "print": str.isprintable,
    "punct": string.punctuation.__contains__,
    "space": str.isspace,
    "upper": str.isupper,
    "xdigit": string.hexdigits.__contains__,
}

Test = Callable[[str], bool]
Part = Callable[[int], int]
"""Adds its states in front of the one that it is given, and gives the first of them."""


class PatternRefused(ValueError):
    """It is no extended regular expression."""


class Pattern:
    """A pattern, ready to be held against any number of texts."""

    def __init__(self, text: str) -> None:
        """Reads it.

        Raises:
            PatternRefused: it is none, or too long.
        """
        self._text = text
        self._at = 0
        self._depth = 0
        self._tests: list[Test | None] = [None]
        """One state each; None consumes nothing."""
        self._next: list[tuple[int, ...]] = [()]
        self._anchors: dict[int, str] = {}
        part = self._alternatives()
        if self._at < len(text):
            raise self._refused("a ) without its (")
        self._start = part(0)

    def found_in(self, text: str) -> bool:
        """Whether it stands anywhere in a text."""
        states = self._closed({self._start}, at=0, length=len(text))
        for at, letter in enumerate(text, 1):
            if 0 in states:
                return True
            moved = {
                after
                for state in states
                if (test := self._tests[state]) is not None and test(letter)
                for after in self._next[state]
            }
            states = self._closed(moved | {self._start}, at=at, length=len(text))
        return 0 in states

    def _closed(self, states: set[int], *, at: int, length: int) -> set[int]:
        """The states with all that can be reached from them without a letter."""
        found: set[int] = set()
        waiting = list(states)
        while waiting:
            state = waiting.pop()
            if state in found:
                continue
            found.add(state)
            anchor = self._anchors.get(state)
            if self._tests[state] is None and (anchor is None or at == (0 if anchor == "^" else length)):
                waiting += self._next[state]
        return found

    # -- building ------------------------------------------------------------------------------------------------------

    def _state(self, test: Test | None, *after: int) -> int:
        if len(self._tests) >= _MOST_STATES:
            raise self._refused("it is too long")
        self._tests.append(test)
        self._next.append(after)
        return len(self._tests) - 1

    def _letter(self, test: Test) -> Part:
        return lambda after: self._state(test, after)

    def _anchor(self, sign: str) -> Part:
        def build(after: int) -> int:
            state = self._state(None, after)
            self._anchors[state] = sign
            return state

        return build

    def _repeated(self, part: Part, least: int, most: int | None) -> Part:
        def build(after: int) -> int:
            if most is None:
                loop = self._state(None)
                self._next[loop] = (part(loop), after)
                after = loop
            else:
                end = after
                for _ in range(most - least):
                    after = self._state(None, part(after), end)
            for _ in range(least):
                after = part(after)
            return after

        return build

    # -- reading -------------------------------------------------------------------------------------------------------

    def _alternatives(self) -> Part:
        parts = [self._sequence()]
        while self._takes("|"):
            parts.append(self._sequence())
        if len(parts) == 1:
            return parts[0]
        return lambda after: self._state(None, *(part(after) for part in parts))

    def _sequence(self) -> Part:
        parts: list[Part] = []
        while self._at < len(self._text) and self._text[self._at] not in "|)":
            parts.append(self._counted(self._one()))

        def build(after: int) -> int:
            for part in reversed(parts):
                after = part(after)
            return after

        return build

    def _counted(self, part: Part) -> Part:
        while self._at < len(self._text):
            if self._takes("*"):
                part = self._repeated(part, 0, None)
            elif self._takes("+"):
                part = self._repeated(part, 1, None)
            elif self._takes("?"):
                part = self._repeated(part, 0, 1)
            elif self._takes("{"):
                part = self._repeated(part, *self._bounds())
            else:
                break
        return part

    def _bounds(self) -> tuple[int, int | None]:
        inside, brace, _ = self._text[self._at :].partition("}")
        low, comma, high = inside.partition(",")
        numbers = [each for each in (low, high) if each]
        if not brace or not low or not all(each.isascii() and each.isdigit() and len(each) <= 3 for each in numbers):
            raise self._refused("a { without numbers and its }")
        least, most = int(low), int(high) if high else None if comma else int(low)
        if max(least, most or 0) > _MOST_REPEATS or (most is not None and most < least):
            raise self._refused(f"{{{inside}}} is out of order, or more than {_MOST_REPEATS}")
        self._at += len(inside) + 1
        return least, most

    def _one(self) -> Part:
        letter = self._text[self._at]
        self._at += 1
        match letter:
            case "(":
                return self._group()
            case "[":
                return self._letter(self._bracket())
            case ".":
                return self._letter(lambda _: True)
            case "^" | "$":
                return self._anchor(letter)
            case "*" | "+" | "?" | "{":
                raise self._refused(f"a {letter} with nothing before it")
            case "\\":
                if self._at == len(self._text):
                    raise self._refused("a \\ with nothing behind it")
                letter = self._text[self._at]
                self._at += 1
                if letter.isalnum():
                    raise self._refused(f"\\{letter} means nothing in POSIX")
        return self._letter(letter.__eq__)

    def _group(self) -> Part:
        self._depth += 1
        if self._depth > _MOST_NESTED:
            raise self._refused("its groups are nested too deeply")
        part = self._alternatives()
        if not self._takes(")"):
            raise self._refused("a ( without its )")
        self._depth -= 1
        return part

    def _bracket(self) -> Test:
        negated = self._takes("^")
        tests: list[Test] = []
        while not tests or not self._takes("]"):
            if self._at >= len(self._text):
                raise self._refused("a [ without its ]")
            tests.append(self._bracketed())
        return lambda letter: any(test(letter) for test in tests) != negated

    def _bracketed(self) -> Test:
        rest = self._text[self._at :]
        if rest.startswith("[:"):
            name, colon, _ = rest[2:].partition(":]")
            if not colon or name not in _CLASSES:
                raise self._refused(f"no class [:{name}:]; there is {', '.join(_CLASSES)}")
            self._at += len(name) + 4
            return _CLASSES[name]
        if rest[:2] in {"[.", "[="}:
            raise self._refused("collating symbols mean nothing here")
        self._at += 1
        if rest[1:2] == "-" and rest[2:3] not in {"", "]"}:
            low, high = rest[0], rest[2]
            if low > high:
                raise self._refused(f"{low}-{high} is out of order")
            self._at += 2
            return lambda letter: low <= letter <= high
        return rest[0].__eq__

    def _takes(self, sign: str) -> bool:
        if self._text.startswith(sign, self._at):
            self._at += 1
            return True
        return False

    def _refused(self, why: str) -> PatternRefused:
        return PatternRefused(f"{self._text[:100]!r} is no extended regular expression: {why}")
