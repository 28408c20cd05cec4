"""The console: Prolog, in this process, that knows what a stage knows."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from mindstage.errors import PrologGoalError, PrologTimeoutError, PrologUnavailableError, SourceParseError
from mindstage.prolog.predicates import Handler, QuestionPredicates, RdfPredicates, WorldPredicates, answer
from mindstage.prolog.swipl import Atom, Compound, SwiProlog, Unbound, Value, load_library, read_term, write_term
from mindstage.simulation import Simulation

__all__ = ["PrologConsole", "Solution"]

Solution = dict[str, Any]
"""A goal's variables and what they stand for: texts, numbers, lists; None where one stays free."""

_NUDGE_INTERVAL_S = 0.05
_CONSOLE_MODULE = "mindstage_console"
_CONSOLE_SOURCE = Path(__file__).with_name("console.pl")
_CLOSED_HANDLERS: Mapping[str, Handler] = {"halting": lambda status: False}
"""What may be asked while no console is open."""


class PrologConsole:
    """Every declared question as a predicate, and the stage's world to spawn and to light up.

    There is one Prolog in a process, so there can be one open console at a time; what was consulted stays in it.

    >>> from mindstage.engines import NullEngine
    >>> from mindstage.knowledge import KnowledgeBase
    >>> from mindstage.stage import Stage
    >>> with Stage(KnowledgeBase(), NullEngine()) as stage, PrologConsole(stage) as console:
    ...     console.solutions("likely_storage_place(knowrob:'CowsMilk', Place)")
    [{'Place': 'http://knowrob.org/kb/knowrob.owl#Refrigerator'}]
    """

    _instance: PrologConsole | None = None

    def __init__(self, simulation: Simulation, *, at_halt: Callable[[], None] = lambda: None) -> None:
        """Opens it.

        Args:
            stage: what is asked, spawned into and lit.
            at_halt: called where Prolog's `halt` is about to end the process, which then ends at once.

        Raises:
            PrologUnavailableError: pyswip or SWI-Prolog is not installed, or another console is open.
        """
        if PrologConsole._instance is not None:
            raise PrologUnavailableError("another console is open in this process", remedy="close it first")
        self._library = load_library()
        self._at_halt = at_halt
        self.handlers: Mapping[str, Handler] = {
            **QuestionPredicates(simulation).handlers,
            **RdfPredicates(simulation.knowledge).handlers,
            **WorldPredicates(simulation).handlers,
            "halting": self._on_halt,
        }
        """What Prolog may ask of Python."""
        self._busy = set[int]()
        PrologConsole._instance = self
        try:
            with self._library.thread():
                _load_console_source(self._library)
                self._can_wake = self._call("start") == "nudge"
        except BaseException:
            self.close()
            raise

    def solutions(self, goal: str, *, limit: int = 1000, timeout_s: float = 30.0) -> list[Solution]:
        """What makes a goal true, in Prolog's own order; empty where nothing does. Any thread may ask.

        Args:
            goal: as one types it, the full stop left out or not.
            limit: how many solutions are enough.
            timeout_s: how long it may take [s].

        Raises:
            PrologGoalError: it is no Prolog, or an error was thrown.
            PrologTimeoutError: it did not end in time.
            KeyboardInterrupt: Ctrl-C was pressed.
        """
        return self._solve("solve", goal, limit, timeout_s)

    def answers(self, line: str, *, limit: int = 1000, timeout_s: float = 10.0) -> list[Solution]:
        """What makes a line true that a stranger wrote, such as a visitor of a page. Any thread may ask.

        Only questions and their combinations are allowed (`line_queries.pl`): a query cannot call, change, read or
        write anything else, and it has a memory limit.

        Args:
            line: as one types it, the full stop left out or not.
            limit: how many solutions are enough.
            timeout_s: how long it may take [s].

        Raises:
            PrologGoalError: it is no Prolog, more than that, or an error was thrown.
            PrologTimeoutError: it did not end in time.
        """
        return self._solve("solve_query", line, limit, timeout_s)

    def _solve(self, predicate: str, goal: str, limit: int, timeout_s: float) -> list[Solution]:
        if limit < 1 or not 0.0 < timeout_s < float("inf"):
            raise ValueError(f"a goal gets at least one solution and some time, not {limit} and {timeout_s} s")
        with _wake_after(timeout_s=timeout_s if self._can_wake else None):
            end = self._run(predicate, goal, limit, float(timeout_s))
        match end:
            case Compound("found", (rows,)):
                return [dict(row) for row in _to_python(rows)]
            case Compound("error_reply", (kind, cause)):
                raise PrologGoalError(goal, error_type=str(kind), cause=str(cause))
            case "timed_out":
                raise PrologTimeoutError(goal, timeout_s=timeout_s)
            case _:
                raise KeyboardInterrupt

    def holds(self, goal: str, *, timeout_s: float = 30.0) -> bool:
        """Whether a goal is true; it is run until its first solution.

        Raises:
            PrologGoalError: it is no Prolog, or an error was thrown.
            PrologTimeoutError: it did not end in time.
            KeyboardInterrupt: Ctrl-C was pressed.
        """
        return bool(self.solutions(goal, limit=1, timeout_s=timeout_s))

    def consult(self, path: str | os.PathLike[str]) -> int:
        """Loads a file of facts and rules, and says how many errors there were in it; Prolog prints them.

        Raises:
            SourceParseError: there is no such file.
        """
        file = Path(path)
        if not file.is_file():
            raise SourceParseError(str(path), cause="there is no such file")
        errors = self._run("consult_file", Atom(str(file.resolve())))
        if not isinstance(errors, int):
            raise KeyboardInterrupt
        return errors

    def toplevel(self) -> None:
        """Gives the terminal, or whatever standard input is, to Prolog's own toplevel until that ends."""
        with self._library.thread(), self._interrupt_handling(at_interrupt="debug"):
            self._library.toplevel()

    def close(self) -> None:
        """Ends it; any number of times."""
        if PrologConsole._instance is self:
            PrologConsole._instance = None

    def __enter__(self) -> PrologConsole:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- between the two -----------------------------------------------------------------------------------------------

    def _run(self, predicate: str, *arguments: Value) -> Value:
        with self._library.thread(), self._interrupt_handling(at_interrupt="throw"):
            return self._call(predicate, *arguments)

    @contextmanager
    def _interrupt_handling(self, *, at_interrupt: str) -> Iterator[None]:
        """While goals run: Ctrl-C is Prolog's, since Python would hear of it only after the goal, and so is `halt`."""
        sys.stdout.flush()  # whatever Prolog writes comes after it
        self._busy.add(threading.get_ident())
        if threading.current_thread() is not threading.main_thread():
            try:
                yield
            finally:
                self._busy.discard(threading.get_ident())
            return
        python_s = signal.getsignal(signal.SIGINT)
        self._call("on_interrupt", Atom(at_interrupt))
        try:
            yield
        finally:
            self._call("on_interrupt", Atom("default"))
            if python_s is not None:  # whoever set it did so past Python
                signal.signal(signal.SIGINT, python_s)
            self._busy.discard(threading.get_ident())

    def _call(self, predicate: str, *arguments: Value) -> Value:
        """Calls a predicate of our own, which gives its answer in a last argument and throws nothing."""
        library = self._library
        with library.frame():
            terms = library.new_terms(len(arguments) + 1)
            for at, argument in enumerate(arguments):
                write_term(library, terms + at, argument)
            if not library.call(_CONSOLE_MODULE, predicate, len(arguments) + 1, terms):
                raise RuntimeError(f"{predicate} in console.pl failed, which it must not")
            return read_term(library, terms + len(arguments))

    def _on_halt(self, status: Value) -> Value:
        """Ends the process as Prolog's `halt` asks it; comes back where it is Python that ends, and Prolog with it."""
        if not self._busy:
            return False
        try:
            self._at_halt()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            # At once: SWI-Prolog may wait for its own alarms for ever, and Python's threads must not find memory gone.
            os._exit(status if isinstance(status, int) else 2)


@contextmanager
def _wake_after(*, timeout_s: float | None) -> Iterator[None]:
    """Wakes this thread when a goal's time is over, if it still waits for something then.

    Prolog notes by itself that the time is over, but the way pyswip starts it, it does not look at that while it sleeps
    or reads. The signal is the one that Prolog's own alarms use.
    """
    if timeout_s is None:
        yield
        return
    timer = threading.Timer(timeout_s + _NUDGE_INTERVAL_S, signal.pthread_kill, (threading.get_ident(), signal.SIGUSR2))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@cache
def _load_console_source(library: SwiProlog) -> None:
    """Loads what is written in Prolog, once for all consoles."""

    def answered(request: int, reply: int) -> bool:
        console = PrologConsole._instance
        with library.frame(keep=True):
            return bool(
                library.unify(
                    reply, _handle_request(request, library, console.handlers if console else _CLOSED_HANDLERS)
                )
            )

    with library.frame():
        arguments = library.new_terms(2)
        write_term(library, arguments, Atom(str(_CONSOLE_SOURCE)))
        write_term(library, arguments + 1, [Compound("silent", (True,))])
        library.call("user", "load_files", 2, arguments)
    library.register("mindstage_questions", "python", answered)


def _handle_request(request: int, library: SwiProlog, handlers: Mapping[str, Handler]) -> int:
    """A new term; nothing may be raised past Prolog's own frames."""
    try:
        reply = answer(handlers, read_term(library, request))
    except ValueError as error:
        reply = Compound("error_reply", (Atom("argument_refused"), str(error)))
    term, other = library.new_terms(2), library.new_terms(1)
    try:
        write_term(library, term, reply)
    except TypeError as error:
        write_term(library, other, Compound("error_reply", (Atom("defect"), str(error))))
        return other
    return term


def _to_python(value: Value) -> Any:
    match value:
        case Unbound():
            return None
        case str():
            return str(value)
        case Sequence():
            return [_to_python(each) for each in value]
        case _:
            return value
