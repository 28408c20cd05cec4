"""The C interface of SWI-Prolog (libswipl), and conversion between Prolog terms and Python values.

SWI-Prolog is loaded once and stays until the process ends, because it cannot be initialized twice. pyswip locates and
initializes it; the functions that are used are declared here with their C signatures. An atom is an `Atom`, a string a
`str`, a list a `list`, a variable `FREE`, every other term a `Compound`. Values hold no references into Prolog.
"""

from __future__ import annotations

import atexit
import ctypes
import math
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from ctypes import c_char_p, c_double, c_int, c_int64, c_size_t, c_uint, c_void_p
from enum import Enum
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Final

import msgspec

from mindstage.access.limits import TERM_DEPTH
from mindstage.errors import PrologUnavailableError, without_surrogates

__all__ = [
    "FREE",
    "Atom",
    "Compound",
    "ReadLimit",
    "SwiProlog",
    "Unbound",
    "Value",
    "is_installed",
    "load_library",
    "read_term",
    "write_term",
]


_TERM = c_size_t  # also the type of atoms, functors, foreign frames and foreign_t
_PREDICATE = ctypes.CFUNCTYPE(_TERM, _TERM, _TERM)
_UNKNOWN_THREAD = -1
"""`PL_thread_self()` of a thread without a Prolog engine."""


class SwiProlog:
    """The C functions of SWI-Prolog. Terms are `term_t` handles, valid within the foreign frame that created them."""

    def __init__(self) -> None:
        """Starts SWI-Prolog.

        Raises:
            ImportError: pyswip is not installed.
            Exception: pyswip does not find SWI-Prolog, or no version that it supports.
        """
        given, sys.argv = sys.argv, [without_surrogates(each) for each in sys.argv]  # pyswip encodes them
        try:
            core: Any = import_module("pyswip.core")
        finally:
            sys.argv = given
        self._native = ctypes.CDLL(core._path)
        self._callbacks: list[object] = []
        atexit.unregister(core.cleanupProlog)
        atexit.register(self._cleanup)
        self.UTF8: int = core.REP_UTF8
        self.VARIABLE, self.ATOM, self.STRING = core.PL_VARIABLE, core.PL_ATOM, core.PL_STRING
        self.INTEGER, self.FLOAT, self.NIL = core.PL_INTEGER, core.PL_FLOAT, core.PL_NIL
        self.TERM, self.PAIR = core.PL_TERM, core.PL_LIST_PAIR
        # Not on Prolog's stack of strings, which has a fixed size and is not released before the goal has ended.
        self._text_flags = core.CVT_ATOMIC | core.CVT_WRITEQ | core.REP_UTF8 | core.BUF_MALLOC
        self._call_flags = core.PL_Q_NODEBUG | core.PL_Q_CATCH_EXCEPTION

        self.new_terms = self._function("PL_new_term_refs", _TERM, c_size_t)
        self.copy = self._function("PL_copy_term_ref", _TERM, _TERM)
        self.unify = self._function("PL_unify", c_int, _TERM, _TERM)
        self.term_type = self._function("PL_term_type", c_int, _TERM)
        self.get_float = self._function("PL_get_float", c_int, _TERM, c_void_p)
        self.get_int64 = self._function("PL_get_int64", c_int, _TERM, c_void_p)
        self.get_compound = self._function("PL_get_compound_name_arity_sz", c_int, _TERM, c_void_p, c_void_p)
        self.get_argument = self._function("PL_get_arg_sz", c_int, c_size_t, _TERM, _TERM)
        self.get_list = self._function("PL_get_list", c_int, _TERM, _TERM, _TERM)
        self.get_nil = self._function("PL_get_nil", c_int, _TERM)
        self.put_atom = self._function("PL_put_atom", c_int, _TERM, _TERM)
        self.put_text = self._function("PL_put_chars", c_int, _TERM, c_int, c_size_t, c_char_p)
        self.put_int = self._function("PL_put_int64", c_int, _TERM, c_int64)
        self.put_float = self._function("PL_put_float", c_int, _TERM, c_double)
        self.put_nil = self._function("PL_put_nil", c_int, _TERM)
        self.put_pair = self._function("PL_cons_list", c_int, _TERM, _TERM, _TERM)
        self.put_compound = self._function("PL_cons_functor_v", c_int, _TERM, _TERM, _TERM)

        self._free = self._function("PL_free", None, c_void_p)
        self._get_text = self._function("PL_get_nchars", c_int, _TERM, c_void_p, c_void_p, c_uint)
        self._new_atom = self._function("PL_new_atom_mbchars", _TERM, c_int, c_size_t, c_char_p)
        self._new_functor = self._function("PL_new_functor_sz", _TERM, _TERM, c_size_t)
        self._open = self._function("PL_open_foreign_frame", _TERM)
        self._close = self._function("PL_close_foreign_frame", None, _TERM)
        self._discard = self._function("PL_discard_foreign_frame", None, _TERM)
        self._predicate = self._function("PL_predicate", c_void_p, c_char_p, c_int, c_char_p)
        self._call = self._function("PL_call_predicate", c_int, c_void_p, c_int, c_void_p, _TERM)
        self._thread = self._function("PL_thread_self", c_int)
        self._attach = self._function("PL_thread_attach_engine", c_int, c_void_p)
        self._detach = self._function("PL_thread_destroy_engine", c_int)
        self.toplevel = self._function("PL_toplevel", c_int)

    def _function(self, name: str, result: Any, *arguments: Any) -> Callable[..., int]:
        function = self._native[name]  # a new object, so that the signature of pyswip's own is not changed
        function.restype, function.argtypes = result, arguments
        return function

    def text(self, term: int) -> str:
        """The text of an atomic term; any other term as `writeq/1` prints it."""
        length, start = c_size_t(), c_void_p()
        if not self._get_text(term, ctypes.byref(length), ctypes.byref(start), self._text_flags):
            raise ValueError("the term has no text")
        try:
            return ctypes.string_at(start.value or 0, length.value).decode(errors="replace")
        finally:
            self._free(start)

    @cache  # noqa: B019 (the library lives as long as the process)
    def functor(self, name: str, arity: int) -> int:
        """The functor of a name and an arity."""
        encoded = name.encode(errors="replace")
        return self._new_functor(self._new_atom(self.UTF8, len(encoded), encoded), arity)

    @contextmanager
    def frame(self, *, keep: bool = False) -> Iterator[None]:
        """A foreign frame: terms created in it are discarded with their bindings; with `keep` the bindings are kept."""
        opened = self._open()
        try:
            yield
        finally:
            (self._close if keep else self._discard)(opened)

    @contextmanager
    def thread(self) -> Iterator[None]:
        """Attaches the calling thread to a Prolog engine for the duration, if it has none."""
        is_new = self._thread() == _UNKNOWN_THREAD
        if is_new and self._attach(None) < 0:
            raise PrologUnavailableError("no further thread can be attached")
        try:
            yield
        finally:
            if is_new:
                self._detach()

    def call(self, module: str, name: str, arity: int, arguments: int) -> bool:
        """Calls a predicate once; False if it fails or throws an exception."""
        predicate = self._predicate(name.encode(), arity, module.encode())
        return bool(self._call(None, self._call_flags, predicate, arguments))

    def register(self, module: str, name: str, function: Callable[[int, int], bool]) -> None:
        """Registers a function as a foreign predicate of arity 2. It must not raise."""
        foreign = _PREDICATE(function)
        self._callbacks.append(foreign)  # Prolog keeps only its address
        register = self._function("PL_register_foreign_in_module", c_int, c_char_p, c_char_p, c_int, c_void_p, c_int)
        register(module.encode(), name.encode(), 2, ctypes.cast(foreign, c_void_p), 0)

    def _cleanup(self) -> None:
        """Runs the `at_halt` hooks, such as saving the history of the toplevel, and nothing else.

        pyswip would call `PL_cleanup`, in which SWI-Prolog can wait for its alarms forever.
        """
        with self.thread():
            self.call("system", "$run_at_halt", 0, 0)


@cache
def is_installed() -> bool:
    """Whether SWI-Prolog and pyswip are installed; checked without loading them."""
    return find_spec("pyswip") is not None and shutil.which("swipl") is not None


@cache
def load_library() -> SwiProlog:
    """Returns SWI-Prolog; the first call starts it.

    Raises:
        PrologUnavailableError: pyswip or SWI-Prolog is not installed, or their versions are not compatible.
    """
    try:
        return SwiProlog()
    except ImportError as error:
        raise PrologUnavailableError(f"pyswip cannot be loaded ({error})") from error
    except Exception as error:  # pyswip raises exceptions of many types
        raise PrologUnavailableError(str(error) or type(error).__name__) from error


class Atom(str):
    """A Prolog atom."""

    __slots__ = ()


class Unbound(Enum):
    """The type of `FREE`."""

    FREE = "_"


FREE: Final = Unbound.FREE
"""An unbound variable; the identity of variables is not preserved."""


class Compound(msgspec.Struct, frozen=True):
    """A compound term."""

    name: str
    arguments: tuple[Value, ...]


Value = str | bool | int | float | None | Sequence["Value"] | Compound | Unbound
"""A term as a Python value. None, True and False are the atoms `none`, `true` and `false`."""

_CLOCK_INTERVAL = 256
"""The number of parts of a term between two looks at the clock."""
_INT64_RANGE = range(-(2**63), 2**63)


class ReadLimit:
    """How much of a term is converted, and for how long. A subterm that Prolog shares counts at each occurrence."""

    def __init__(self, *, max_parts: int = sys.maxsize, deadline_s: float = math.inf) -> None:
        """Creates the limit of one term.

        Args:
            max_parts: the maximum number of atomic and compound terms in it.
            deadline_s: the time at which the conversion ends, of the monotonic clock [s].
        """
        self._parts_left = max_parts
        self._deadline_s = deadline_s

    def count_part(self) -> None:
        """Counts one part.

        Raises:
            ValueError: the term has too many parts.
            TimeoutError: the time is over.
        """
        self._parts_left -= 1
        if self._parts_left < 0:
            raise ValueError("the term is too large")
        if self._parts_left % _CLOCK_INTERVAL == 0:
            self.check_time()

    def check_time(self) -> None:
        """Reads the clock.

        Raises:
            TimeoutError: the time is over.
        """
        if time.monotonic() > self._deadline_s:
            raise TimeoutError


def read_term(library: SwiProlog, term: int, *, limit: ReadLimit | None = None, depth: int = 0) -> Value:
    """Converts a term to a value; terms of other types (streams, dicts) become the text that Prolog prints for them.

    Args:
        term: the handle of the term.
        limit: the limit of its size and of the time.
        depth: the number of terms around it.

    Raises:
        ValueError: the term is nested too deeply, cyclic, or too large.
        TimeoutError: the time of the limit is over.
    """
    if depth > TERM_DEPTH.count:
        raise ValueError("the term is nested too deeply or cyclic")
    limit = limit or ReadLimit()
    limit.count_part()
    kind = library.term_type(term)
    if kind == library.VARIABLE:
        return FREE
    if kind == library.FLOAT:
        number = ctypes.c_double()
        library.get_float(term, ctypes.byref(number))
        return number.value
    if kind in {library.PAIR, library.NIL}:
        return _read_list(library, term, limit, depth + 1)
    if kind == library.TERM:
        return _read_compound(library, term, limit, depth + 1)
    if kind == library.INTEGER:
        return _read_integer(library, term)
    text = library.text(term)
    return Atom(text) if kind == library.ATOM else text


def _read_integer(library: SwiProlog, term: int) -> int | str:
    """The value of an integer; one with more digits than Python converts (`sys.set_int_max_str_digits`) is its text."""
    number = c_int64()
    if library.get_int64(term, ctypes.byref(number)):
        return number.value
    text = library.text(term)
    try:
        return int(text)
    except ValueError:
        return text


def write_term(library: SwiProlog, term: int, value: Value) -> None:
    """Writes a value to a new term.

    Raises:
        TypeError: the value has no type that Prolog has.
    """
    match value:
        case Unbound():
            return  # a new term is an unbound variable
        case None:
            _write_text(library, term, library.ATOM, "none")
        case bool():
            _write_text(library, term, library.ATOM, "true" if value else "false")
        case int() if int(value) in _INT64_RANGE:  # `in` searches a range linearly for subclasses of int
            library.put_int(term, value)
        case int() | float():
            library.put_float(term, float(value))
        case Atom():
            _write_text(library, term, library.ATOM, value)
        case str():
            _write_text(library, term, library.STRING, value)
        case Compound(name, arguments):
            inner = library.new_terms(len(arguments))
            for at, argument in enumerate(arguments):
                write_term(library, inner + at, argument)
            library.put_compound(term, library.functor(name, len(arguments)), inner)
        case Sequence():
            library.put_nil(term)
            for each in reversed(value):
                with library.frame(keep=True):
                    head = library.new_terms(1)
                    write_term(library, head, each)
                    library.put_pair(term, head, term)
        case _:
            raise TypeError(f"{value!r} cannot be converted to a Prolog term")


def _read_list(library: SwiProlog, term: int, limit: ReadLimit, depth: int) -> Value:
    values: list[Value] = []
    with library.frame():
        rest, head = library.copy(term), library.new_terms(1)
        while library.get_list(rest, head, rest):
            values.append(read_term(library, head, limit=limit, depth=depth))
        if not library.get_nil(rest):  # a partial list
            return Compound("[|]", (*values, read_term(library, rest, limit=limit, depth=depth)))
    return values


def _read_compound(library: SwiProlog, term: int, limit: ReadLimit, depth: int) -> Value:
    name, arity = ctypes.c_size_t(), ctypes.c_size_t()
    library.get_compound(term, ctypes.byref(name), ctypes.byref(arity))
    with library.frame():
        argument = library.new_terms(1)
        library.put_atom(argument, name.value)
        functor = library.text(argument)
        values = []
        for at in range(1, arity.value + 1):
            library.get_argument(at, term, argument)
            values.append(read_term(library, argument, limit=limit, depth=depth))
    return Compound(functor, tuple(values))


def _write_text(library: SwiProlog, term: int, kind: int, text: str) -> None:
    encoded = text.encode(errors="replace")
    library.put_text(term, kind | library.UTF8, len(encoded), encoded)
