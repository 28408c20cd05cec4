"""Requests: what Prolog asks of Python, and the ends that each of them can have.

Prolog gets `told(Answer)`; `not_found_error(Name, Sentence)` where nobody knows a name, which is a no; `refused(Kind,
Sentence)` where the world, the engine or a source_xml is the cause; or `interrupted`. Whatever is raised here, Prolog
lives on.
"""

from __future__ import annotations

import re
import traceback
from collections.abc import Callable, Mapping

from mindstage.errors import MindstageError, NameNotFoundError
from mindstage.prolog.terms import Atom, Compound, Value

__all__ = ["Handler", "answer", "error_kind"]

Handler = Callable[..., Value]


def answer(handlers: Mapping[str, Handler], request: Value) -> Compound:
    """Answers one request; never raises."""
    name, arguments = (request.name, request.arguments) if isinstance(request, Compound) else (str(request), ())
    if name not in handlers:
        return _error_term("prolog_unavailable", f"nobody answers {name}: the console was closed")
    try:
        return Compound("answer", (handlers[name](*arguments),))
    except NameNotFoundError as error:
        return Compound("unknown_name", (Atom(error.name), str(error)))
    except MindstageError as error:
        return _error_term(error_kind(error), str(error))
    except KeyboardInterrupt:
        return Compound("interrupted", ())
    except Exception as error:  # a defect of ours must not take Prolog down with it
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{place.filename}, line {place.lineno}"
        return _error_term(
            "defect", f"{type(error).__name__}: {error} ({where}); please report this defect in Mindstage"
        )


def error_kind(error: MindstageError) -> str:
    """How Prolog calls an error: `body_unknown` for BodyUnknown, since a capital would begin a variable."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", error.code).lower()


def _error_term(error_name: str, message: str) -> Compound:
    return Compound("error_reply", (Atom(error_name), message))
