"""The Prolog console: runs goals and files of rules against a simulation and its knowledge base.

SWI-Prolog runs in this process, and goals call back into Python for every answer.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from mindstage.access.limits import ANSWER_PARTS, REQUEST_PARTS, Deadline
from mindstage.access.policies import QUERY, TRUSTED, Cost, EntryKind, EntryPoint, Policy
from mindstage.access.resources import is_outside_request
from mindstage.errors import PrologGoalError, PrologTimeoutError, PrologUnavailableError, SourceParseError
from mindstage.prolog.episode_predicates import EpisodePredicates
from mindstage.prolog.object_predicates import ObjectPredicates
from mindstage.prolog.plan_predicates import PlanPredicates
from mindstage.prolog.predicates import Handler, QuestionPredicates, RdfPredicates, WorldPredicates, answer
from mindstage.prolog.robot_predicates import RobotPredicates
from mindstage.prolog.swipl import (
    Atom,
    Compound,
    ReadLimit,
    SwiProlog,
    Unbound,
    Value,
    load_library,
    read_term,
    write_term,
)
from mindstage.ranges import Count, checked
from mindstage.simulation import Simulation

__all__ = ["PrologConsole", "Solution", "Solutions", "solve_query"]

Solution = dict[str, Any]
"""The values of a goal's variables by name: texts, numbers, lists; None if a variable is unbound."""


class Solutions(list[Solution]):
    """The solutions of a goal, in Prolog's order."""

    __slots__ = ("complete",)

    def __init__(self, rows: Iterable[Solution] = (), *, complete: bool = True) -> None:
        super().__init__(rows)
        self.complete = complete
        """False if the search stopped at the limit of solutions, so that there may be more."""


_WAKE_DELAY_S = 0.05
"""Time after the end of a time limit at which a blocked goal is interrupted by a signal [s]."""
_SHORTEST_S = 0.1
"""The time limit of a query that has waited for others for nearly all of its time [s]."""
_CONSOLE_MODULE = "mindstage_console"
_CONSOLE_SOURCE = Path(__file__).with_name("console.pl")
_CLOSED_HANDLERS: Mapping[str, Handler] = {"halting": lambda status: False}
"""Requests that are answered while no console is open."""
_query_lock = threading.Lock()


class PrologConsole:
    """A Prolog system with a predicate for every declared question, and predicates that spawn and highlight bodies.

    SWI-Prolog exists once in a process, so only one console can be open at a time. Consulted files stay loaded after it
    is closed.

    >>> from mindstage.engines import NullEngine
    >>> from mindstage.knowledge import KnowledgeBase
    >>> from mindstage.simulation import Simulation
    >>> with Simulation(KnowledgeBase(), NullEngine()) as sim, PrologConsole(sim) as console:
    ...     console.solutions("likely_storage_place(knowrob:'CowsMilk', Place)")
    [{'Place': 'http://knowrob.org/kb/knowrob.owl#Refrigerator'}]
    """

    _instance: PrologConsole | None = None

    def __init__(self, simulation: Simulation, *, at_halt: Callable[[], None] = lambda: None) -> None:
        """Starts SWI-Prolog, or reuses the one of an earlier console.

        Args:
            simulation: the simulation that the predicates query and change.
            at_halt: called when Prolog's `halt` is about to exit the process.

        Raises:
            PrologUnavailableError: pyswip or SWI-Prolog is not installed, or another console is open.
        """
        if PrologConsole._instance is not None:
            raise PrologUnavailableError("another console is open in this process", remedy="close it first")
        self._library = load_library()
        self.simulation = simulation
        self._at_halt = at_halt
        rdf = RdfPredicates(simulation.knowledge)
        groups: tuple[tuple[Mapping[str, Handler], Policy], ...] = (
            (QuestionPredicates(simulation).handlers, QUERY),
            (rdf.handlers, TRUSTED),
            (WorldPredicates(simulation).handlers, TRUSTED),
            (ObjectPredicates(simulation).handlers, TRUSTED),
            (PlanPredicates(simulation).handlers, TRUSTED),
            (RobotPredicates(simulation).handlers, TRUSTED),
            (EpisodePredicates(simulation).handlers, TRUSTED),
            ({"halting": self._on_halt}, TRUSTED),
        )
        self.handlers: Mapping[str, Handler] = {name: each for handlers, _ in groups for name, each in handlers.items()}
        """The requests that Prolog can send to Python, by name."""
        self.policies = {name: policy for handlers, policy in groups for name in handlers}
        """Which of them the queries of clients can send."""
        self._feed = rdf.feed
        self._busy = set[int]()
        PrologConsole._instance = self
        try:
            with self._library.thread():
                _load_console_source(self._library)
                self._feed.on_change = self._mark_mirror_stale
                self._can_wake = self._call("start") == "nudge"
        except BaseException:
            self.close()
            raise

    def allowed_handlers(self) -> Mapping[str, Handler]:
        """The handlers of the requests that this thread may send: all, or those of queries of a client of a port."""
        if not is_outside_request():
            return self.handlers
        policies = self.policies
        allowed = (name for name in self.handlers if name in policies and policies[name].cost is not Cost.TRUSTED)
        return {name: self.handlers[name] for name in allowed}

    def entry_points(self) -> tuple[EntryPoint, ...]:
        """The requests that Prolog can send to Python."""
        return tuple(EntryPoint(EntryKind.PREDICATE, name, self.policies.get(name)) for name in self.handlers)

    @checked
    def solutions(self, goal: str, *, limit: Count = 1000, timeout_s: Deadline = 30.0) -> Solutions:
        """Finds the solutions of a goal, in Prolog's order; empty if it fails. May be called from any thread.

        Args:
            goal: the goal, with or without the full stop.
            limit: the maximum number of solutions; `Solutions.complete` is False if there may be more.
            timeout_s: the time limit [s].

        Raises:
            PrologGoalError: the goal has a syntax error, threw an exception, or has solutions that are too large.
            PrologTimeoutError: the time limit was exceeded, which includes the conversion of the solutions.
            KeyboardInterrupt: Ctrl-C was pressed.
        """
        return self._solve("solve", goal, limit, timeout_s)

    @checked
    def answers(self, query: str, *, limit: Count = 1000, timeout_s: Deadline = 10.0) -> Solutions:
        """Finds the solutions of an untrusted query. May be called from any thread.

        Only questions and their combinations are allowed (`line_queries.pl`): a query cannot call, change, read or
        write anything else, and its memory, the size of its terms and the text of its answers are limited.

        Args:
            query: the query, with or without the full stop.
            limit: the maximum number of solutions; `Solutions.complete` is False if there may be more.
            timeout_s: the time limit [s].

        Raises:
            PrologGoalError: the query has a syntax error, contains a goal that is not allowed, or threw an exception.
            PrologTimeoutError: the time limit was exceeded.
        """
        return self._solve("solve_query", query, limit, timeout_s)

    def _solve(self, predicate: str, goal: str, limit: int, timeout_s: float) -> Solutions:
        reading = ReadLimit(max_parts=ANSWER_PARTS.count, deadline_s=time.monotonic() + timeout_s)
        try:
            with _wake_after(timeout_s=timeout_s if self._can_wake else None):
                end = self._run(predicate, goal, limit, float(timeout_s), reading=reading)
            if isinstance(end, Compound) and end.name == "found":
                names, rows, complete = end.arguments
                return _solutions(names, rows, complete, reading=reading)
        except TimeoutError:
            raise PrologTimeoutError(goal, timeout_s=timeout_s) from None
        except ValueError as error:
            raise PrologGoalError(goal, error_type="PrologGoalError", cause=str(error)) from error
        match end:
            case Compound("error_reply", (kind, cause)):
                raise PrologGoalError(goal, error_type=str(kind), cause=str(cause))
            case "timed_out":
                raise PrologTimeoutError(goal, timeout_s=timeout_s)
            case _:
                raise KeyboardInterrupt

    @checked
    def holds(self, goal: str, *, timeout_s: Deadline = 30.0) -> bool:
        """Whether a goal has a solution.

        Raises:
            PrologGoalError: the goal has a syntax error or threw an exception.
            PrologTimeoutError: the time limit was exceeded.
            KeyboardInterrupt: Ctrl-C was pressed.
        """
        return bool(self.solutions(goal, limit=1, timeout_s=timeout_s))

    def consult(self, path: str | os.PathLike[str]) -> int:
        """Loads a file of facts and rules. Prolog prints the errors in it.

        Returns:
            The number of errors.

        Raises:
            SourceParseError: the file does not exist.
        """
        file = Path(path)
        if not file.is_file():
            raise SourceParseError(str(path), cause="there is no such file")
        errors = self._run("consult_file", Atom(str(file.resolve())))
        if not isinstance(errors, int):
            raise KeyboardInterrupt
        return errors

    def toplevel(self) -> None:
        """Runs Prolog's toplevel on standard input until it ends."""
        with self._library.thread(), self._interrupt_handling(at_interrupt="debug"):
            self._library.toplevel()

    def close(self) -> None:
        """Closes the console; calling it again is harmless."""
        if PrologConsole._instance is self:
            PrologConsole._instance = None
            self._feed.on_change = lambda: None

    def __enter__(self) -> PrologConsole:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- calls into Prolog ---------------------------------------------------------------------------------------------

    def _run(self, predicate: str, *arguments: Value, reading: ReadLimit | None = None) -> Value:
        with self._library.thread(), self._interrupt_handling(at_interrupt="throw"):
            return self._call(predicate, *arguments, reading=reading)

    @contextmanager
    def _interrupt_handling(self, *, at_interrupt: str) -> Iterator[None]:
        """While goals run, Prolog handles Ctrl-C, because Python handlers run only after the goal, and `halt` exits."""
        sys.stdout.flush()  # before the output of Prolog
        self._busy.add(threading.get_ident())
        if threading.current_thread() is not threading.main_thread():
            try:
                yield
            finally:
                self._busy.discard(threading.get_ident())
            return
        handler = signal.getsignal(signal.SIGINT)
        self._call("on_interrupt", Atom(at_interrupt))
        try:
            yield
        finally:
            self._call("on_interrupt", Atom("default"))
            if handler is not None:  # None if it was not installed from Python
                signal.signal(signal.SIGINT, handler)
            self._busy.discard(threading.get_ident())

    def _call(self, predicate: str, *arguments: Value, reading: ReadLimit | None = None) -> Value:
        """Calls a predicate of `console.pl`, whose last argument is the result; such predicates never throw."""
        library = self._library
        with library.frame():
            terms = library.new_terms(len(arguments) + 1)
            for at, argument in enumerate(arguments):
                write_term(library, terms + at, argument)
            if not library.call(_CONSOLE_MODULE, predicate, len(arguments) + 1, terms):
                raise RuntimeError(f"{predicate}/{len(arguments) + 1} in console.pl failed")
            return read_term(library, terms + len(arguments), limit=reading)

    def _mark_mirror_stale(self) -> None:
        """Called in the thread that has changed the store, which may be within a goal."""
        with self._library.thread(), self._library.frame():
            self._library.call("mindstage_rdf_mirror", "mark_stale", 0, 0)

    def _on_halt(self, status: Value) -> Value:
        """Exits the process after Prolog's `halt`; returns if Prolog halts because Python exits."""
        if not self._busy:
            return False
        try:
            self._at_halt()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            # Without clean-up: SWI-Prolog may wait for its alarms forever, and Python's threads still use its memory.
            os._exit(status if isinstance(status, int) else 2)


@checked
def solve_query(simulation: Simulation, query: str, *, limit: Count, timeout_s: Deadline) -> Solutions:
    """Finds the solutions of an untrusted query; concurrent calls wait for one another.

    It uses the open console of the same simulation if there is one, and otherwise a console of its own.

    Args:
        simulation: the simulation that is queried.
        query: the query, see `PrologConsole.answers`.
        limit: the maximum number of solutions; `Solutions.complete` is False if there may be more.
        timeout_s: the time limit [s].

    Raises:
        PrologUnavailableError: Prolog is not installed, or a console of another simulation is open.
        PrologGoalError: the query has a syntax error, contains a goal that is not allowed, or threw an exception.
        PrologTimeoutError: the time limit was exceeded, or other queries took all of the time.
    """
    end_s = time.monotonic() + timeout_s
    if not _query_lock.acquire(timeout=timeout_s):
        raise PrologTimeoutError(query, timeout_s=timeout_s)
    try:
        open_console = PrologConsole._instance
        with ExitStack() as closing:
            if open_console is not None and open_console.simulation is simulation:
                console = open_console
            else:
                console = closing.enter_context(PrologConsole(simulation))
            return console.answers(query, limit=limit, timeout_s=max(end_s - time.monotonic(), _SHORTEST_S))
    finally:
        _query_lock.release()


@contextmanager
def _wake_after(*, timeout_s: float | None) -> Iterator[None]:
    """Sends this thread a signal at the end of a goal's time limit.

    Prolog sets a flag when the time is over, but as pyswip starts it, a goal that sleeps or reads does not check the
    flag. The signal is the one that Prolog's alarms use.
    """
    if timeout_s is None:
        yield
        return
    timer = threading.Timer(timeout_s + _WAKE_DELAY_S, signal.pthread_kill, (threading.get_ident(), signal.SIGUSR2))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@cache
def _load_console_source(library: SwiProlog) -> None:
    """Loads `console.pl`, once in a process."""

    def handle(request: int, reply: int) -> bool:
        console = PrologConsole._instance
        with library.frame(keep=True):
            return bool(
                library.unify(
                    reply,
                    _handle_request(request, library, console.allowed_handlers() if console else _CLOSED_HANDLERS),
                )
            )

    with library.frame():
        arguments = library.new_terms(2)
        write_term(library, arguments, Atom(str(_CONSOLE_SOURCE)))
        write_term(library, arguments + 1, [Compound("silent", (True,))])
        library.call("user", "load_files", 2, arguments)
    library.register("mindstage_questions", "python", handle)


def _handle_request(request: int, library: SwiProlog, handlers: Mapping[str, Handler]) -> int:
    """Returns a term with the reply; exceptions must not propagate through Prolog's stack frames."""
    try:
        reply = answer(handlers, read_term(library, request, limit=ReadLimit(max_parts=REQUEST_PARTS.count)))
    except ValueError as error:
        reply = Compound("error_reply", (Atom("InvalidArgumentError"), str(error)))
    term, other = library.new_terms(2), library.new_terms(1)
    try:
        write_term(library, term, reply)
    except TypeError as error:
        write_term(library, other, Compound("error_reply", (Atom("defect"), str(error))))
        return other
    return term


def _solutions(names: Value, rows: Value, complete: Value, *, reading: ReadLimit) -> Solutions:
    """The solutions in the reply of `console.pl`.

    Raises:
        TimeoutError: the time of the limit is over.
    """
    columns, found = _to_python(names), Solutions(complete=complete != "false")
    for row in rows if isinstance(rows, list) else ():
        reading.check_time()
        found.append({name: _to_python(value) for name, value in zip(columns, row, strict=True)})
    return found


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
