"""The resolver: from what ontologies say of forms, materials and light to one rule for each class.

What is said of a class holds for all below it, the most special first, each statement on its own: a subclass of which
only a color is told keeps the form and the material that it inherits. What is shaped as another class has all that is
told of that one, and a form has defaults of its own. Where nobody says how a class is shaped, its name is searched for
the words for known classes: a guess, and called one.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from mindstage.knowledge.names import local_name
from mindstage.knowledge.shaping.notions import ShapeAnnotations
from mindstage.knowledge.shaping.rule import DEFAULT_SHAPE, LightRule, ShapeParameter, ShapeRule
from mindstage.knowledge.shaping.substances import MaterialResolver
from mindstage.knowledge.shaping.words import name_suffixes, name_tokens
from mindstage.knowledge.stores.triplestore import QuadSource
from mindstage.knowledge.taxonomy import ClassHierarchy
from mindstage.knowledge.vocabulary import KNOWROB, MS
from mindstage.world import GeometrySource, Iri

__all__ = ["ShapeRuleResolver"]

ClassLineage = tuple[Iri, ...]
"""Classes, and at last a form, whose statements hold for a class: the most special first."""


class ShapeRuleResolver:
    """One look at a store; after any change to the store another one is needed."""

    def __init__(self, store: QuadSource, hierarchy: ClassHierarchy) -> None:
        """Reads what is said about forms.

        Args:
            store: where it is said.
            hierarchy: of all its classes.
        """
        self._annotations = ShapeAnnotations(store)
        self._materials = MaterialResolver(self._annotations)
        self._hierarchy = hierarchy
        self._lineages: dict[Iri, ClassLineage] = {}
        self._rules: dict[Iri, ShapeRule] = {}

    def rule(self, cls: Iri) -> ShapeRule:
        """How things of a class are shaped."""
        if cls not in self._rules:
            self._rules[cls] = self._resolve(cls)
        return self._rules[cls]

    def _resolve(self, cls: Iri) -> ShapeRule:
        told = self._annotated_ancestor(cls)
        kind, line, why = (
            self._follow_shaped_as(cls, told)
            if told
            else (DEFAULT_SHAPE, self._lineage(cls), "nobody says how it is shaped")
        )
        source = GeometrySource.ONTOLOGY if told else GeometrySource.MAP
        if not told and (guess := self._guess_from_name(cls)):
            word, named = guess
            kind, of_named, _ = self._follow_shaped_as(named, self._annotated_ancestor(named) or named)
            line = tuple(dict.fromkeys((cls, *of_named, *line)))
            source, why = GeometrySource.CLASS_NAME, f'"{word}" in its name is the word for {_short_name(named)}'
        return ShapeRule(
            cls=cls,
            shape_type=kind,
            source=source,
            reason=why,
            parameters=self._parameters(line),
            materials=self._materials.for_class(cls, line),
            light=self._light(line),
            size=next((self._annotations.sizes[each] for each in line if each in self._annotations.sizes), None),
            issues=tuple(self._annotations.issues_of(line)),
        )

    # -- whose statements hold -----------------------------------------------------------------------------------------

    def _lineage(self, cls: Iri) -> ClassLineage:
        """A class and all above it: none before one that is below it; of two alike the nearer one first."""
        if cls not in self._lineages:
            above = self._hierarchy.ancestors(cls)
            self._lineages[cls] = (cls, *sorted(above, key=lambda each: -len(self._hierarchy.ancestors(each))))
        return self._lineages[cls]

    def _annotated_ancestor(self, cls: Iri) -> Iri | None:
        """The class of which it is told how it and all below it are shaped."""
        return next((each for each in self._lineage(cls) if each in self._annotations.shaped_as), None)

    def _follow_shaped_as(self, cls: Iri, annotated: Iri) -> tuple[str, ClassLineage, str]:
        """The kind of form, everything whose statements hold, and why."""
        line, trail = self._lineage(cls), [annotated]
        why = (
            f"{_short_name(annotated)} is shaped as "
            if annotated == cls
            else f"it is a {_short_name(annotated)}, shaped as "
        )
        while (target := self._annotations.shaped_as[trail[-1]]) not in self._annotations.shape_types:
            own = line[: line.index(trail[-1]) + 1]
            line = tuple(dict.fromkeys((*own, *self._lineage(target), *line)))
            above = self._annotated_ancestor(target)
            if above is None or above in trail:
                self._annotations.add_issue(
                    trail[-1], f"it is shaped as {_short_name(target)}, and nobody says how that is shaped"
                )
                return DEFAULT_SHAPE, line, why + f"{_short_name(target)}, of which nobody says how it is shaped"
            why += f"{_short_name(target)}, which is shaped as "
            trail.append(above)
        return self._annotations.shape_types[target], (*line, target), why + _short_name(target)

    def _guess_from_name(self, cls: Iri) -> tuple[str, Iri] | None:
        """A word in the name of a class, and the class that it stands for."""
        return next(
            (
                (word, self._words_for_classes[word])
                for word in name_suffixes(name_tokens(cls))
                if word in self._words_for_classes
            ),
            None,
        )

    @cached_property
    def _words_for_classes(self) -> dict[str, Iri]:
        """What classes of a known form are called."""
        found: dict[str, Iri] = {}
        for word, cls in self._annotations.all_words():
            if word not in found and self._annotated_ancestor(cls):
                found[word] = cls
        return found

    # -- what they say -------------------------------------------------------------------------------------------------

    def _parameters(self, lineage: Sequence[Iri]) -> dict[str, ShapeParameter]:
        found: dict[str, ShapeParameter] = {}
        for each in reversed(lineage):
            found |= self._annotations.parameters.get(each, {})
        return found

    def _light(self, lineage: Sequence[Iri]) -> LightRule | None:
        notions = self._annotations
        kind = next((notions.lights[each] for each in lineage if each in notions.lights), None)
        if kind is None:
            return None
        color = next((notions.light_colors[each] for each in lineage if each in notions.light_colors), (1.0, 1.0, 1.0))
        strength = (notions.light_intensities[each] for each in lineage if each in notions.light_intensities)
        return LightRule(kind, color, next(strength, 1.0))


def _short_name(iri: Iri) -> str:
    """An IRI as people write it."""
    prefix = next((name for name, start in (("ms:", MS), ("knowrob:", KNOWROB)) if iri.startswith(start)), "")
    return prefix + local_name(iri)
