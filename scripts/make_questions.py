"""Writes docs/reference/questions.md from the declared questions; with --check only compares."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from generated import write_or_compare

from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import Answers, Question, cell_text, list_questions
from mindstage.knowledge.sentences import SentencePattern, sentence_patterns
from mindstage.maps import bundled_kitchen

__all__ = ["main"]

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "reference" / "questions.md"
SHOWN = 3
"""The number of answers shown for each example; the others are counted."""
SHOWN_WORDINGS = 6
"""The number of sentences shown for each question."""

HEAD = """# Questions

<!-- Written by scripts/make_questions.py: change the declarations in src/mindstage/knowledge/queries instead. -->

All declared questions. [Ask questions](../how-to/asking.md) shows how to ask them in Python, the shell and Prolog:

```sh
mindstage ask storage_place CowsMilk --map bundled:kitchen
```

    knowledge.ask("storage_place", item="CowsMilk")

Arguments are positional or named (`item=CowsMilk`). Arguments that are left out are the unknowns; `_` leaves out a
positional one. Names are short (`CowsMilk`), prefixed (`knowrob:CowsMilk`), full IRIs or words (`"cow's milk"`);
a class stands for all its individuals. `--why` (`knowledge.explain(question, row)`) explains an answer. Without an
answer, `missing` lists the statements that would give one; `knowledge.tell` and `knowledge.retract` change them.

Each answer is a row with the columns listed below. The examples are answered for the bundled kitchen.
"""


def page() -> str:
    """The complete document."""
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    return "\n".join([HEAD, *(line for each in list_questions() for line in section(kb, each))])


def section(kb: KnowledgeBase, question: Question[Any]) -> Iterator[str]:
    """The section of one question."""
    arguments = ", ".join(f"`{argument.name}` ({argument.type_text})" for argument in question.arguments)
    columns = ", ".join(f"`{name}`" for name in question.columns)
    yield from (f"## {question.name}", "", question.text, "")
    yield from (f"- arguments: {arguments}", f"- answers: {columns}")
    yield from (f"- in words: {', '.join(f'`{each.text()}`' for each in wordings(question))}", "")
    for example in question.examples:
        if question.about_past:
            yield f"    mindstage ask {example} --episode run.mcap"
            continue
        yield f"    mindstage ask {example} --map bundled:kitchen"
        yield from (f"        {line}" for line in answer_lines(kb, kb.ask(question, **args(question, example))))
        yield ""
    if question.about_past:
        yield ""


def wordings(question: Question[Any]) -> list[SentencePattern]:
    """The first wording of each template, without an ending that all templates have."""
    first: dict[str, SentencePattern] = {}
    for each in sentence_patterns(question):
        first.setdefault(each.template, each)
    return list(first.values())[:SHOWN_WORDINGS]


def answer_lines(kb: KnowledgeBase, answers: Answers[Any]) -> Iterator[str]:
    """The first answers with short names, and the explanation of the first one."""
    for at, row in enumerate(answers[:SHOWN]):
        cells = ((name, cell_text(getattr(row, name))) for name in answers.question.columns)
        yield ", ".join(f"{name} {short(cell)}" for name, cell in cells if cell not in {None, ""})
        if at == 0:
            yield from (f"    why: {line}" for line in kb.explain(answers.question, row))
    if not answers:
        yield "no answer"
    if len(answers) > SHOWN:
        yield f"… {len(answers)} answers in all"


def short(cell: object) -> str:
    """A cell of at most 60 characters."""
    text = f"{cell:.6g}" if isinstance(cell, float) else str(cell)
    return text if len(text) <= 60 else f"{text[:59]}…"


def args(question: Question[Any], example: str) -> dict[str, str]:
    """The arguments of an example, as the shell command would pass them."""
    names = iter([argument.name for argument in question.arguments])
    pairs = (word.split("=", 1) if "=" in word else (next(names), word) for word in shlex.split(example)[1:])
    return {name: value for name, value in pairs if value != "_"}


def main() -> int:
    """Writes or checks the page; returns 0 if it is up to date, otherwise 1."""
    return write_or_compare({PAGE: page()})


if __name__ == "__main__":
    sys.exit(main())
