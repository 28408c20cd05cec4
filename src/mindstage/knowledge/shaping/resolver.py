"""The resolver: from what ontologies say of forms, materials and light to one rule for each class.

What is said of a class holds for all below it, the most special first, each statement on its own: a subclass of which
only a colour is told keeps the form and the material that it inherits. What is shaped as another class has all that is
told of that one, and a form has defaults of its own. Where nobody says how a class is shaped, its name is searched for
the words for known classes: a guess, and called one.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from mindstage.knowledge.names import local_name
from mindstage.knowledge.shaping.notions import Notions
from mindstage.knowledge.shaping.rule import PLAIN, Lighting, Parameter, ShapeRule
from mindstage.knowledge.shaping.substances import Substances
from mindstage.knowledge.shaping.words import endings, words
from mindstage.knowledge.stores.triplestore import Readable
from mindstage.knowledge.taxonomy import ClassHierarchy
from mindstage.knowledge.vocabulary import KNOWROB, MS
from mindstage.world import FormSource, Iri

__all__ = ["Shaping"]

Line = tuple[Iri, ...]
"""Classes, and at last a form, whose statements hold for a class: the most special first."""


class Shaping:
    """One look at a store; after any change to the store another one is needed."""

    def __init__(self, store: Readable, hierarchy: ClassHierarchy) -> None:
        """Reads what is said about forms.

        Args:
            store: where it is said.
            hierarchy: of all its classes.
        """
        self._notions = Notions(store)
        self._substances = Substances(self._notions)
        self._hierarchy = hierarchy
        self._lines: dict[Iri, Line] = {}
        self._rules: dict[Iri, ShapeRule] = {}

    def rule(self, cls: Iri) -> ShapeRule:
        """How things of a class are shaped."""
        if cls not in self._rules:
            self._rules[cls] = self._resolve(cls)
        return self._rules[cls]

    def _resolve(self, cls: Iri) -> ShapeRule:
        told = self._teller(cls)
        kind, line, why = self._told(cls, told) if told else (PLAIN, self._line(cls), "nobody says how it is shaped")
        source = FormSource.KNOWLEDGE if told else FormSource.MAP
        if not told and (guess := self._guess(cls)):
            word, named = guess
            kind, of_named, _ = self._told(named, self._teller(named) or named)
            line = tuple(dict.fromkeys((cls, *of_named, *line)))
            source, why = FormSource.NAME, f'"{word}" in its name is the word for {_short(named)}'
        return ShapeRule(
            cls=cls,
            kind=kind,
            source=source,
            why=why,
            parameters=self._parameters(line),
            substances=self._substances.of(cls, line),
            light=self._light(line),
            size=next((self._notions.sizes[each] for each in line if each in self._notions.sizes), None),
            doubts=tuple(self._notions.doubts_about(line)),
        )

    # -- whose statements hold -----------------------------------------------------------------------------------------

    def _line(self, cls: Iri) -> Line:
        """A class and all above it: none before one that is below it; of two alike the nearer one first."""
        if cls not in self._lines:
            above = self._hierarchy.ancestors(cls)
            self._lines[cls] = (cls, *sorted(above, key=lambda each: -len(self._hierarchy.ancestors(each))))
        return self._lines[cls]

    def _teller(self, cls: Iri) -> Iri | None:
        """The class of which it is told how it and all below it are shaped."""
        return next((each for each in self._line(cls) if each in self._notions.shaped_as), None)

    def _told(self, cls: Iri, teller: Iri) -> tuple[str, Line, str]:
        """The kind of form, everything whose statements hold, and why."""
        line, trail = self._line(cls), [teller]
        why = f"{_short(teller)} is shaped as " if teller == cls else f"it is a {_short(teller)}, shaped as "
        while (target := self._notions.shaped_as[trail[-1]]) not in self._notions.kinds:
            own = line[: line.index(trail[-1]) + 1]
            line = tuple(dict.fromkeys((*own, *self._line(target), *line)))
            above = self._teller(target)
            if above is None or above in trail:
                self._notions.doubt(trail[-1], f"it is shaped as {_short(target)}, and nobody says how that is shaped")
                return PLAIN, line, why + f"{_short(target)}, of which nobody says how it is shaped"
            why += f"{_short(target)}, which is shaped as "
            trail.append(above)
        return self._notions.kinds[target], (*line, target), why + _short(target)

    def _guess(self, cls: Iri) -> tuple[str, Iri] | None:
        """A word in the name of a class, and the class that it stands for."""
        return next(((word, self._words[word]) for word in endings(words(cls)) if word in self._words), None)

    @cached_property
    def _words(self) -> dict[str, Iri]:
        """What classes of a known form are called."""
        found: dict[str, Iri] = {}
        for word, cls in self._notions.words():
            if word not in found and self._teller(cls):
                found[word] = cls
        return found

    # -- what they say -------------------------------------------------------------------------------------------------

    def _parameters(self, line: Sequence[Iri]) -> dict[str, Parameter]:
        found: dict[str, Parameter] = {}
        for each in reversed(line):
            found |= self._notions.parameters.get(each, {})
        return found

    def _light(self, line: Sequence[Iri]) -> Lighting | None:
        notions = self._notions
        kind = next((notions.lights[each] for each in line if each in notions.lights), None)
        if kind is None:
            return None
        colour = next((notions.light_colours[each] for each in line if each in notions.light_colours), (1.0, 1.0, 1.0))
        strength = (notions.light_intensities[each] for each in line if each in notions.light_intensities)
        return Lighting(kind, colour, next(strength, 1.0))


def _short(iri: Iri) -> str:
    """An IRI as people write it."""
    prefix = next((name for name, start in (("ms:", MS), ("knowrob:", KNOWROB)) if iri.startswith(start)), "")
    return prefix + local_name(iri)
