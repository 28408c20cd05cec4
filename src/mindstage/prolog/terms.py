"""Terms: what Prolog says as Python values, and back.

An atom is an `Atom`, a string a `str`, a list a `list`, a variable `FREE`, every other term a `Compound`. Values keep
nothing of Prolog's: they may be kept as long as one likes.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from enum import Enum
from typing import Final

import msgspec

from mindstage.prolog.library import SwiProlog

__all__ = ["FREE", "Atom", "Compound", "Unbound", "Value", "read_term", "write_term"]


class Atom(str):
    """A name."""

    __slots__ = ()


class Unbound(Enum):
    """The type of `FREE`."""

    FREE = "_"


FREE: Final = Unbound.FREE
"""A variable; which one does not matter here."""


class Compound(msgspec.Struct, frozen=True):
    """A name with arguments."""

    name: str
    arguments: tuple[Value, ...]


Value = str | bool | int | float | None | Sequence["Value"] | Compound | Unbound
"""Python's None is the atom `none`, its truths are the atoms `true` and `false`."""

_MAX_DEPTH = 100
_INT64_RANGE = range(-(2**63), 2**63)


def read_term(library: SwiProlog, term: int, *, depth: int = 0) -> Value:
    """A term as a value; what has no form here (a stream, a dict) as the text that Prolog writes for it.

    Raises:
        ValueError: it is nested too deeply, or contains itself.
    """
    if depth > _MAX_DEPTH:
        raise ValueError("a term is nested too deeply")
    kind = library.term_type(term)
    if kind == library.VARIABLE:
        return FREE
    if kind == library.FLOAT:
        number = ctypes.c_double()
        library.get_float(term, ctypes.byref(number))
        return number.value
    if kind in {library.PAIR, library.NIL}:
        return _read_list(library, term, depth + 1)
    if kind == library.TERM:
        return _read_compound(library, term, depth + 1)
    text = library.text(term)
    if kind == library.INTEGER:
        return int(text)
    return Atom(text) if kind == library.ATOM else text


def write_term(library: SwiProlog, term: int, value: Value) -> None:
    """Makes a term a value.

    Raises:
        TypeError: Prolog has no form for it.
    """
    match value:
        case Unbound():
            return  # a new term is a variable
        case None:
            _write_text(library, term, library.ATOM, "none")
        case bool():
            _write_text(library, term, library.ATOM, "true" if value else "false")
        case int() if int(value) in _INT64_RANGE:  # a range looks for an int of another class one by one
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
            raise TypeError(f"Prolog has no form for {value!r}")


def _read_list(library: SwiProlog, term: int, depth: int) -> Value:
    values: list[Value] = []
    rest, head = library.copy(term), library.new_terms(1)
    while library.get_list(rest, head, rest):
        with library.frame():
            values.append(read_term(library, head, depth=depth))
    if not library.get_nil(rest):  # a list whose end is not known yet
        return Compound("[|]", (*values, read_term(library, rest, depth=depth)))
    return values


def _read_compound(library: SwiProlog, term: int, depth: int) -> Value:
    name, arity = ctypes.c_size_t(), ctypes.c_size_t()
    library.get_compound(term, ctypes.byref(name), ctypes.byref(arity))
    with library.frame():
        argument = library.new_terms(1)
        library.put_atom(argument, name.value)
        called = library.text(argument)
        values = []
        for at in range(1, arity.value + 1):
            library.get_argument(at, term, argument)
            values.append(read_term(library, argument, depth=depth))
    return Compound(called, tuple(values))


def _write_text(library: SwiProlog, term: int, kind: int, text: str) -> None:
    encoded = text.encode(errors="replace")
    library.put_text(term, kind | library.UTF8, len(encoded), encoded)
