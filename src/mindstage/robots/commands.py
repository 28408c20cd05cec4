"""Commands in words: "put the milk into the fridge" is the skill `place` with its arguments.

A command is read by the grammar of questions and the wordings that skills declare. Each of its phrases must stand for
one thing: if several fit, or a word is not covered, nothing is done.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from types import MappingProxyType

from mindstage.errors import AmbiguousSentenceError, SentenceNotUnderstoodError, suggestion
from mindstage.knowledge.grammar import Phrase, parse_command
from mindstage.knowledge.queries.worded import Evaluation
from mindstage.knowledge.questions import QuestionContext, StateAccess
from mindstage.knowledge.sentences import find_noun, is_only_map
from mindstage.rdf.graphs import local_name
from mindstage.robots.skill_declaration import ParameterType, skill_specs
from mindstage.scene import Iri

__all__ = ["UnderstoodCommand", "understand_command"]

_MAX_CHARACTERS = 200
"""The maximum length of a command."""


@dataclass(frozen=True, slots=True)
class UnderstoodCommand:
    """A skill with the things that a command is about."""

    skill: str
    things: Mapping[str, Iri]
    """The arguments by name."""
    args: Mapping[str, str]
    """The arguments as the skill takes them: ids, and the name of a class where one is asked for."""
    reading: str
    """The command as a sentence."""
    is_hypothetical: bool
    """Whether it asks what would happen."""

    def __str__(self) -> str:
        return " ".join([self.skill, *(f"{name}={local_name(each)}" for name, each in self.things.items())])


def understand_command(kb: QuestionContext, sentence: str, *, present: StateAccess | None = None) -> UnderstoodCommand:
    """Reads a command.

    Args:
        kb: the knowledge base with the names.
        sentence: what is to be done, or "what happens if I" and that.
        present: the state in which phrases such as "the open drawer" are evaluated; by default that of the maps.

    Raises:
        SentenceNotUnderstoodError: it is no command, or not all of it is understood.
        AmbiguousSentenceError: it may mean several things.
    """
    now = present or StateAccess(kb)
    if len(sentence) > _MAX_CHARACTERS:
        raise SentenceNotUnderstoodError(sentence, cause=f"it has more than {_MAX_CHARACTERS} characters")
    specs = skill_specs()
    templates = [(name, wording) for name, spec in specs.items() for wording in spec.wordings]
    with kb.lock:
        readings = parse_command(
            sentence, templates, partial(find_noun, kb, now.find_individual), partial(is_only_map, kb)
        )
        found: dict[str, UnderstoodCommand] = {}
        for reading in readings:
            choices = [(name, _things(Evaluation(kb, now), phrase, sentence)) for name, phrase in reading.phrases]
            for chosen in product(*(things for _, things in choices)):
                things = dict(zip((name for name, _ in choices), chosen, strict=True))
                args = {
                    name: _argument(kb, each, specs[reading.skill].parameter(name).type)
                    for name, each in things.items()
                }
                command = UnderstoodCommand(
                    reading.skill, MappingProxyType(things), args, str(reading), reading.is_hypothetical
                )
                found.setdefault(str(command), command)
    if len(found) > 1:
        raise AmbiguousSentenceError(sentence, candidates=tuple(found))
    if not found:
        verb = sentence.split(maxsplit=1)[0] if sentence.split() else ""
        is_verb = any(wording.split()[0] == verb for _, wording in templates)
        cause = "not every word of it is part of a command" if is_verb else f"there is no skill {verb!r}"
        near = tuple(sorted({wording.partition(" ")[0] for _, wording in templates}))
        raise SentenceNotUnderstoodError(
            sentence, cause=f"{cause}; {suggestion(verb, near)}", questions=_nearest(sentence, templates)
        )
    return next(iter(found.values()))


def _things(evaluation: Evaluation, phrase: Phrase, sentence: str) -> list[Iri]:
    """The things that a phrase may stand for, of which one is meant."""
    if phrase.parts or phrase.plural or phrase.quantifier.word not in {"the", "a", ""} or phrase.members is None:
        cause = f"{str(phrase)!r} is not one thing, and a command is about one"
        raise SentenceNotUnderstoodError(sentence, cause=cause)
    members = evaluation.members(phrase)
    if not members:
        raise SentenceNotUnderstoodError(sentence, cause=f"there is no {phrase.text}")
    return members


def _argument(kb: QuestionContext, thing: Iri, kind: ParameterType) -> str:
    if kind is ParameterType.CLASS:
        return kb.reasoner.class_of(thing) or thing
    return thing


def _nearest(sentence: str, templates: list[tuple[str, str]]) -> tuple[str, ...]:
    """The three wordings that share most words with a sentence."""
    words = {*sentence.lower().split()}
    ranked = sorted(templates, key=lambda each: (-len(words & {*each[1].split()}), len(each[1])))
    return tuple(f"{skill}: {wording.replace('{', '<').replace('}', '>')}" for skill, wording in ranked[:3])
