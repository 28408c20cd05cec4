"""Loads each file in a fork of one console, and prints the numbers of errors and the messages as JSON."""

from __future__ import annotations

import json
import os
import sys
import tempfile

from mindstage.engines import NullEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.prolog import PrologConsole
from mindstage.simulation import Simulation


def load(console: PrologConsole, file: str) -> tuple[int, str]:
    """Loads a file in a fork, so that the files do not see each other's predicates."""
    with tempfile.TemporaryFile() as messages:
        if not (child := os.fork()):
            os.dup2(messages.fileno(), 1)
            os.dup2(messages.fileno(), 2)
            errors = 255
            try:
                errors = min(console.consult(file), 254)
            finally:
                os._exit(errors)
        errors = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        messages.seek(0)
        return errors, messages.read().decode(errors="replace")


if __name__ == "__main__":
    knowledge = KnowledgeBase(bundled_ontology=False)
    with Simulation(knowledge, NullEngine()) as simulation, PrologConsole(simulation) as console:
        console.holds("rdf(_, _, _) ; true")
        json.dump({file: load(console, file) for file in sys.argv[1:]}, sys.stdout)
