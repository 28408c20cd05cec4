"""Interpreter of the Python expressions in xacro files.

An expression is parsed to a syntax tree, which is walked here: nothing is compiled to code or evaluated by Python.
Values are plain data: numbers, strings, booleans, None, dates, ranges, lists, tuples, sets and mappings. Supported are

- literals, names, arithmetic, comparisons, `and`, `or`, `not`, conditional expressions, subscripts, slices,
- comprehensions and generator expressions, `*` and `**` in calls and displays, f-strings, `%` and `str.format`,
- calls of the listed functions and of the listed methods of strings, numbers, lists, tuples, sets and mappings,
- a dot for a name of a namespace (`math`, `python`, `xacro`, an included file) and for a key of a YAML mapping.

Refused are `lambda`, assignments (`:=`), bytes, complex numbers, every other attribute, and what begins with `_` after
a dot. Steps, the length of expressions, the size of values and the bits of integers are limited (`mindstage.access`),
each before the work is done; the steps are counted over all expressions that an interpreter evaluates.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections import ChainMap
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from datetime import date, datetime
from itertools import chain, count
from string import Formatter
from types import GeneratorType
from typing import Any, NamedTuple, TypeAlias

from mindstage.access.limits import (
    XACRO_EXPRESSION_LENGTH,
    XACRO_FORMAT_WIDTH,
    XACRO_INTEGER_BITS,
    XACRO_STEPS,
    XACRO_VALUE_SIZE,
)

__all__ = ["MATH", "PYTHON", "ExpressionError", "Function", "Interpreter", "Namespace"]

Value: TypeAlias = Any
"""A value of an expression: plain data, or, within an expression only, a function, a namespace or an iterator."""
Scope: TypeAlias = Mapping[str, Value]

_NUMBERS = frozenset({bool, int, float})
_SCALARS = _NUMBERS | {type(None), str, date, datetime}
_VIEWS = frozenset({type({}.keys()), type({}.values()), type({}.items())})
_CHARACTERS_PER_STEP = 16
"""How many characters are copied or compared in about the time of one step."""
_DEPTH_LIMIT = 50
"""How deep containers may be nested; no description needs ten."""
_DIGITS_LIMIT = 4_000
"""Length of a text that is read as an integer, and the digits to which a number is rounded."""
_ENTRIES = (20_000, "entries of a set or mapping")
"""Of one that an expression makes, since hashes that collide take quadratic time."""
_SIZE = (XACRO_VALUE_SIZE.maximum, "characters and elements of a value")
_BITS = (XACRO_INTEGER_BITS.maximum, "bits of an integer")
_FACTOR_LIMIT = 1_000
"""Factors of `factorial`, `comb` and `perm`."""


class ExpressionError(ValueError):
    """An expression that is not supported, or that exceeds a limit."""


class Function(NamedTuple):
    """A function that expressions may call; `call` gets the interpreter and the arguments."""

    name: str
    call: Callable[..., Value]
    type: type | None = None
    """The type that the name stands for as the second argument of `isinstance`."""


class Namespace(dict[str, Value]):
    """Names that expressions reach through a dot."""


class Interpreter:
    """Evaluates expressions, with a budget of steps for all of them together."""

    def __init__(
        self,
        *,
        steps: int = int(XACRO_STEPS.maximum),
        namespace_types: Iterable[type] = (),
        mapping_types: Iterable[type[dict[Any, Any]]] = (),
        list_types: Iterable[type[list[Any]]] = (),
    ) -> None:
        """Initializes an interpreter.

        Args:
            steps: the budget.
            namespace_types: more types of namespaces, beside `Namespace`.
            mapping_types: subclasses of `dict` whose keys are reached through a dot.
            list_types: subclasses of `list`.
        """
        self._budget = self._steps = steps
        self._namespaces = frozenset({Namespace, *namespace_types})
        self._dotted = frozenset(mapping_types)
        self._lists = frozenset({list, *list_types})
        self._mappings = frozenset({dict, *mapping_types})
        self._sequences = self._lists | {tuple, set, frozenset}
        self._containers = self._sequences | self._mappings
        self._plain = _SCALARS | self._containers | _VIEWS | {range}
        self._nodes: dict[type[ast.AST], Callable[[Any, Scope], Value]] = {
            ast.Attribute: lambda node, scope: self._member(self._evaluate(node.value, scope), node.attr),
            ast.BinOp: self._binary_chain,
            ast.BoolOp: self._bool_op,
            ast.Call: self._call,
            ast.Compare: self._compare,
            ast.Constant: self._constant,
            ast.Dict: lambda node, scope: self.mapping(self._pairs(node, scope)),
            ast.DictComp: lambda node, scope: self.mapping(
                (self._evaluate(node.key, inner), self._evaluate(node.value, inner))
                for inner in self._rounds(node.generators, scope)
            ),
            ast.FormattedValue: self._formatted_value,
            ast.GeneratorExp: self._generator,
            ast.IfExp: lambda node, scope: self._evaluate(
                node.body if self.truth(self._evaluate(node.test, scope)) else node.orelse, scope
            ),
            ast.JoinedStr: lambda node, scope: self.join("", (self._evaluate(each, scope) for each in node.values)),
            ast.List: lambda node, scope: self.new(self._elements(node.elts, scope)),
            ast.ListComp: lambda node, scope: self.new(self.collect(self._generator(node, scope))),
            ast.Name: self._name,
            ast.Set: lambda node, scope: self.hashed(self._elements(node.elts, scope)),
            ast.SetComp: lambda node, scope: self.hashed(self._generator(node, scope)),
            ast.Subscript: self._subscript,
            ast.Tuple: self._tuple,
            ast.UnaryOp: self._unary,
        }

    def evaluate(self, expression: str, names: Scope) -> Value:
        """Returns the value of an expression: plain data; an iterator becomes a list.

        Args:
            expression: the text; white space around it is ignored.
            names: the values of the names: plain data, functions and namespaces.

        Raises:
            ExpressionError: it is not supported, or exceeds a limit.
            SyntaxError: it is not a Python expression.
            Exception: what Python raises for the same operation, such as `ZeroDivisionError`.
        """
        text = expression.strip()
        _check(len(text), XACRO_EXPRESSION_LENGTH.maximum, "characters of an expression")
        self.spend(1 + len(text) // 4)
        try:
            value = self._evaluate(ast.parse(text, mode="eval").body, names)
            if type(value) is GeneratorType:
                return self.new(self.collect(value))
        except (RecursionError, MemoryError):
            raise ExpressionError("an expression is nested too deeply or needs too much memory") from None
        if type(value) not in self._plain:
            kind = "function" if isinstance(value, Function) else "namespace"
            raise ExpressionError(f"the value of an expression must be plain data, not a {kind}")
        return value

    # -- limits, also for functions ------------------------------------------------------------------------------------

    def spend(self, steps: float) -> None:
        """Takes steps from the budget.

        Raises:
            ExpressionError: the budget is used up; every later call fails as well.
        """
        self._steps -= max(0, int(steps))
        if self._steps < 0:  # without a call otherwise, since this is done at every step
            _check(1 - self._steps + self._budget, self._budget, "steps to expand it")

    def copy(self, length: float) -> None:
        """Checks the length of a text that is about to be made, and takes the steps for it."""
        _check(length, *_SIZE)
        self.spend(length // _CHARACTERS_PER_STEP)

    def size(self, value: Value) -> int:
        """Returns the number of characters and elements of plain data, with all that it contains, as it is printed.

        Raises:
            ExpressionError: it is not plain data, or too large, or nested too deeply.
        """
        size, stack = 0, [(value, 0)]
        while stack:
            each, depth = stack.pop()
            kind = type(each)
            size += len(each) if kind is str else each.bit_length() // 4 + 1 if kind is int else 1
            _check(depth, _DEPTH_LIMIT, "levels of nested lists")
            _check(size + len(stack), *_SIZE)
            if kind in self._mappings:
                stack += [(item, depth + 1) for pair in dict.items(each) for item in pair]
            elif kind in self._lists:  # a subclass would copy its elements
                stack += [(item, depth + 1) for item in list.__iter__(each)]
            elif kind in self._containers or kind in _VIEWS:
                stack += [(item, depth + 1) for item in each]
            elif kind is int:
                _check(each.bit_length(), *_BITS)
            elif kind not in _SCALARS and kind is not range:
                raise ExpressionError(f"values of the type {kind.__name__} are not supported")
        return size

    def new(self, value: Value) -> Value:
        """Returns a value that was computed, after a check of its type and size.

        Raises:
            ExpressionError: it is not plain data, or exceeds a limit.
        """
        kind = type(value)
        if kind is float or kind is bool:
            return value
        size = self.size(value)
        self.spend(size // _CHARACTERS_PER_STEP if kind is str else size)
        return value

    def plain(self, value: Value) -> Value:
        """Returns the value if it is plain data.

        Raises:
            ExpressionError: it is a function, a namespace or an iterator.
        """
        if type(value) not in self._plain:
            kind = {Function: "function", GeneratorType: "iterator"}.get(type(value), "namespace")
            raise ExpressionError(f"a {kind} cannot be used as a value here")
        return value

    def truth(self, value: Value) -> bool:
        """Returns `bool(value)` of plain data."""
        return bool(self.plain(value))

    def iterate(self, value: Value) -> Iterator[Value]:
        """Yields the elements of a value, one step each."""
        if type(value) is not GeneratorType and (type(value) not in self._plain or type(value) in _SCALARS - {str}):
            raise TypeError(f"{type(value).__name__!r} object is not iterable")
        for item in value:
            self.spend(1)
            yield item

    def collect(self, value: Value) -> list[Value]:
        """Returns the elements of a value as a list."""
        items = []
        for item in self.iterate(value):
            items.append(item)
            _check(len(items), *_SIZE)
        return items

    def hashed(self, value: Value) -> set[Value]:
        """Returns the elements of a value as a set."""
        items: set[Value] = set()
        for item in self.iterate(value):
            items.add(self.key(item))
            _check(len(items), *_ENTRIES)
        return self.new(items)  # type: ignore[no-any-return]

    def mapping(self, pairs: Iterable[Iterable[Value]]) -> dict[Value, Value]:
        """Returns a mapping of keys and values."""
        result: dict[Value, Value] = {}
        for key, value in pairs:
            result[self.key(key)] = value
            _check(len(result), *_ENTRIES)
        return self.new(result)  # type: ignore[no-any-return]

    def key(self, value: Value) -> Value:
        """Returns plain data that is about to be hashed."""
        if type(value) is tuple:
            self.spend(self.size(value))
        return self.plain(value)

    def text(self, value: Value) -> str:
        """Returns `str(value)` of plain data."""
        if type(value) is not str:
            self.spend(self.size(self.plain(value)) // 4)
        text = str(value)
        self.copy(len(text))
        return text

    def operate(self, operation: type[ast.operator], left: Value, right: Value) -> Value:
        """Returns the value of a binary operation."""
        self.plain(left)
        self.plain(right)
        function = _OPERATORS.get(operation)
        if function is None:
            raise ExpressionError("the operator @ is not supported")
        if operation is ast.Mod and type(left) is str:
            return self._percent(left, right)
        if type(left) in _VIEWS or type(right) in _VIEWS:  # a view would accept any iterable
            left, right = (set(each) if type(each) in _VIEWS else each for each in (left, right))
        if isinstance(left, set | frozenset | dict) and isinstance(right, set | frozenset | dict):
            _check(len(left) + len(right), *_ENTRIES)
        if operation is ast.Mult:
            for count, items in ((left, right), (right, left)):
                if type(count) in (int, bool) and type(items) not in _NUMBERS and hasattr(items, "__len__"):
                    self.copy(count * len(items))
        elif operation is ast.Pow and type(left) is not float and type(right) in (int, bool):
            _check(max(0, abs(left) - 1).bit_length() * right if type(left) in (int, bool) else 0, *_BITS)
        elif operation is ast.LShift and type(left) in (int, bool) and type(right) in (int, bool):
            _check(left.bit_length() + right, *_BITS)
        else:
            self.spend(_weight(left) + _weight(right))
        return self.new(function(left, right))

    # -- nodes of the syntax tree --------------------------------------------------------------------------------------

    def _evaluate(self, node: ast.AST, scope: Scope) -> Value:
        self.spend(1)
        evaluate = self._nodes.get(type(node))
        if evaluate is None:
            raise ExpressionError(f"{_NODE_NAMES.get(type(node), type(node).__name__)} are not supported")
        return evaluate(node, scope)

    def _constant(self, node: ast.Constant, _: Scope) -> Value:
        if type(node.value) not in _SCALARS:
            raise ExpressionError(f"literals of the type {type(node.value).__name__} are not supported")
        return self.new(node.value)

    def _name(self, node: ast.Name, scope: Scope) -> Value:
        if node.id.startswith("__"):
            raise ExpressionError(f"the name {node.id!r} begins with __")
        return self._looked_up(node.id, scope)

    def _looked_up(self, name: str, names: Scope) -> Value:
        try:
            value = names[name]
        except KeyError:
            raise NameError(f"name {name!r} is not defined") from None
        return self._admitted(name, value)

    def _admitted(self, name: str, value: Value) -> Value:
        kind = type(value)
        if kind in self._plain or kind is Function or kind in self._namespaces:
            return value
        raise ExpressionError(f"{name!r} is a {kind.__name__}, which expressions cannot use")

    def _member(self, owner: Value, name: str) -> Value:
        """Returns what a dot means."""
        if name.startswith("_"):
            raise ExpressionError(f"the name {name!r} after a dot begins with _")
        if type(owner) in self._namespaces:
            return self._looked_up(name, owner)
        if type(owner) in self._dotted:
            value = owner[name]
            self.spend(_weight(value))  # a copy
            return self._admitted(name, value)
        raise ExpressionError(
            f".{name} is not supported: a dot is for names of math, python, xacro and of included files, "
            "for keys of a YAML mapping, and for the listed methods"
        )

    def _call(self, node: ast.Call, scope: Scope) -> Value:
        function: Value
        first: list[Value] = []
        if isinstance(node.func, ast.Attribute):
            owner = self._evaluate(node.func.value, scope)
            function = self._method(type(owner), node.func.attr)
            if function is None:
                function = self._member(owner, node.func.attr)
            else:
                first = [owner]
        else:
            function = self._evaluate(node.func, scope)
        keywords: dict[str, Value] = {}
        arguments = first + self._elements(node.args, scope)
        for keyword in node.keywords:
            value = self._evaluate(keyword.value, scope)
            if keyword.arg is None and type(value) not in self._mappings:
                raise TypeError("the argument after ** must be a mapping")
            for name, each in [(keyword.arg, value)] if keyword.arg else dict.items(value):
                if type(name) is not str or name in keywords:
                    raise TypeError(f"invalid or repeated keyword argument {name!r}")
                self.spend(1)
                keywords[name] = each
        return self.apply(function, *arguments, **keywords)

    def apply(self, function: Function, /, *arguments: Value, **keywords: Value) -> Value:
        """Calls a function that expressions may call.

        Raises:
            TypeError: it is no function, or does not have such arguments.
        """
        if type(function) is not Function:
            raise TypeError(f"{type(function).__name__!r} object is not callable")
        self.spend(1)
        return function.call(self, *arguments, **keywords)

    def _method(self, kind: type, name: str) -> Function | None:
        kind = list if kind in self._lists else dict if kind in self._mappings else kind
        if name in _METHODS.get(kind, ()):
            return Function(name, _SPECIAL_METHODS.get((kind, name)) or _plain_method(getattr(kind, name)))
        return None

    def _elements(self, nodes: Sequence[ast.expr], scope: Scope) -> list[Value]:
        elements: list[Value] = []
        for node in nodes:
            if isinstance(node, ast.Starred):
                elements += self.collect(self._evaluate(node.value, scope))
            else:
                elements.append(self._evaluate(node, scope))
        return elements

    def _tuple(self, node: ast.Tuple, scope: Scope) -> Value:
        elements = tuple(self._elements(node.elts, scope))
        # The second argument of isinstance.
        return elements if elements and all(type(each) is Function for each in elements) else self.new(elements)

    def _pairs(self, node: ast.Dict, scope: Scope) -> Iterator[tuple[Value, Value]]:
        for key, value_node in zip(node.keys, node.values, strict=True):
            if key is not None:
                yield self._evaluate(key, scope), self._evaluate(value_node, scope)
                continue
            other = self._evaluate(value_node, scope)
            if type(other) not in self._mappings:
                raise TypeError(f"{type(other).__name__!r} object is not a mapping")
            self.spend(len(other))
            yield from dict.items(other)

    def _generator(self, node: ast.GeneratorExp | ast.ListComp | ast.SetComp, scope: Scope) -> Iterator[Value]:
        rounds = self._rounds(node.generators, scope)
        return (self._evaluate(node.elt, inner) for inner in rounds)

    def _rounds(self, generators: Sequence[ast.comprehension], scope: Scope) -> Iterator[Scope]:
        # As in Python, the first iterable is evaluated at once and outside of the comprehension.
        source = self.iterate(self._evaluate(generators[0].iter, scope))
        return self._nested_rounds(generators, source, ChainMap({}, scope))  # type: ignore[arg-type]

    def _nested_rounds(
        self, generators: Sequence[ast.comprehension], source: Iterator[Value], scope: ChainMap[str, Value]
    ) -> Iterator[Scope]:
        generator, *inner = generators
        if generator.is_async:
            raise ExpressionError("asynchronous comprehensions are not supported")
        for item in source:
            self._assign(generator.target, item, scope)
            if all(self.truth(self._evaluate(condition, scope)) for condition in generator.ifs):
                if inner:
                    next_source = self.iterate(self._evaluate(inner[0].iter, scope))
                    yield from self._nested_rounds(inner, next_source, scope)
                else:
                    yield scope

    def _assign(self, target: ast.expr, value: Value, scope: ChainMap[str, Value]) -> None:
        if isinstance(target, ast.Name):
            scope[target.id] = value
        elif isinstance(target, ast.Tuple | ast.List):
            items = self.collect(value)
            if len(items) != len(target.elts):
                raise ValueError(f"{len(items)} values to unpack, expected {len(target.elts)}")
            for each, item in zip(target.elts, items, strict=True):
                self._assign(each, item, scope)
        else:
            raise ExpressionError("a comprehension assigns to names only")

    def _bool_op(self, node: ast.BoolOp, scope: Scope) -> Value:
        value: Value = None
        for each in node.values:
            value = self._evaluate(each, scope)
            if each is not node.values[-1] and self.truth(value) is isinstance(node.op, ast.Or):
                break
        return value

    def _compare(self, node: ast.Compare, scope: Scope) -> Value:
        left, result = self.plain(self._evaluate(node.left, scope)), True
        for operation, other in zip(node.ops, node.comparators, strict=True):
            right = self.plain(self._evaluate(other, scope))
            for each in (left, right):
                self.spend(_weight(each) if type(each) in _SCALARS or type(each) is range else self.size(each))
            if isinstance(operation, ast.In | ast.NotIn) and type(right) is range and type(left) not in (int, bool):
                left = int(left) if type(left) is float and left.is_integer() else None  # else each is compared
                right = right if left is not None else ()
            result = _COMPARISONS[type(operation)](left, right)
            if not result:
                break
            left = right
        return result

    def _unary(self, node: ast.UnaryOp, scope: Scope) -> Value:
        value = self.plain(self._evaluate(node.operand, scope))
        return not value if isinstance(node.op, ast.Not) else self.new(_UNARY[type(node.op)](value))

    def _binary_chain(self, node: ast.BinOp, scope: Scope) -> Value:
        # A sum of many terms is a tree as deep as it is long; its left side is walked without recursion.
        chain: list[ast.BinOp] = []
        left: ast.expr = node
        while isinstance(left, ast.BinOp):
            chain.append(left)
            left = left.left
        value = self._evaluate(left, scope)
        for each in reversed(chain):
            value = self.operate(type(each.op), value, self._evaluate(each.right, scope))
        return value

    def _subscript(self, node: ast.Subscript, scope: Scope) -> Value:
        owner = self._evaluate(node.value, scope)
        if type(owner) in self._namespaces:
            key = self._evaluate(node.slice, scope)
            return self._admitted(self.text(key), owner[key])
        self.plain(owner)
        if isinstance(node.slice, ast.Slice):
            parts = (node.slice.lower, node.slice.upper, node.slice.step)
            bounds = [None if part is None else self.plain(self._evaluate(part, scope)) for part in parts]
            if type(owner) in self._mappings:
                raise TypeError("a mapping has no slices")
            return self.new(owner[slice(*bounds)])
        value = owner[self.key(self._evaluate(node.slice, scope))]
        self.spend(_weight(value))  # elements of YAML values are copied
        return value

    # -- text ----------------------------------------------------------------------------------------------------------

    def join(self, separator: str, parts: Iterable[Value]) -> str:
        """Returns `separator.join(parts)`."""
        texts: list[str] = []
        length = 0
        for part in parts:
            if type(part) is not str:
                raise TypeError(f"sequence item {len(texts)}: expected str instance, {type(part).__name__} found")
            texts.append(part)
            length += len(part) + len(separator)
            _check(length, *_SIZE)
        self.copy(length)
        return separator.join(texts)

    def _formatted_value(self, node: ast.FormattedValue, scope: Scope) -> str:
        value = self._evaluate(node.value, scope)
        spec = "" if node.format_spec is None else self._evaluate(node.format_spec, scope)
        return self._formatted(value, "" if node.conversion < 0 else chr(node.conversion), spec)

    def _formatted(self, value: Value, conversion: str, spec: str) -> str:
        if conversion:
            text = self.text(value)
            if conversion not in ("a", "r", "s"):
                raise ValueError(f"unknown conversion {conversion!r}")
            value = text if conversion == "s" else repr(value) if conversion == "r" else ascii(value)
        if not spec:
            return self.text(value)
        match = _FORMAT_SPEC.fullmatch(spec)
        if match is None or type(value) not in _NUMBERS | {str}:
            raise ValueError(f"invalid format {spec!r} for an object of type {type(value).__name__!r}")
        self._check_widths(match.groups())
        text = format(value, spec)
        self.copy(len(text))
        return text

    def _check_widths(self, numbers: Iterable[str | None]) -> int:
        widths = [int(number[:9]) for number in numbers if number]
        _check(max(widths, default=0), XACRO_FORMAT_WIDTH.maximum, "characters of a formatted number")
        return sum(widths)

    def _percent(self, template: str, values: Value) -> str:
        position, length, formats = 0, len(template), 0
        while (position := template.find("%", position)) >= 0:
            match = _PERCENT.match(template, position)
            if match is None:
                raise ExpressionError(f"the format {template[position : position + 20]!r} is not supported")
            length += self._check_widths(match.groups())
            position, formats = match.end(), formats + 1
        size = self.size(values)
        self.copy(length + size * (formats if type(values) in self._mappings else 1))
        text = template % (dict(dict.items(values)) if type(values) in self._mappings else values)
        self.copy(len(text))
        return text

    def format(
        self,
        template: str,
        arguments: Sequence[Value],
        keywords: Mapping[str, Value],
        *,
        counter: Iterator[int] | None = None,
    ) -> str:
        """Returns `template.format(*arguments, **keywords)`, where a field is a number or a name, without dots."""
        parts, numbers = [], counter or count()
        for literal, field, spec, conversion in Formatter().parse(template):
            self.spend(1)
            parts.append(literal)
            if field is None:
                continue
            field = field or str(next(numbers))
            if not _FIELD.fullmatch(field):
                raise ExpressionError(
                    f"the field {field!r} of a format is not supported: it must be a number or a name"
                )
            value = arguments[int(field)] if field.isdecimal() else keywords[field]
            if spec and "{" in spec:
                if counter is not None:
                    raise ValueError("Max string recursion exceeded")
                spec = self.format(spec, arguments, keywords, counter=numbers)
            parts.append(self._formatted(value, conversion or "", spec or ""))
        return self.join("", parts)


def _check(amount: float, maximum: float, what: str) -> None:
    if amount > maximum:
        raise ExpressionError(f"more than {maximum:,.0f} {what}")


def _weight(value: Value) -> int:
    """The steps that copying or comparing a value takes, without what its elements contain."""
    if type(value) is str:
        return len(value) // _CHARACTERS_PER_STEP
    return len(value) if isinstance(value, Collection) and type(value) is not range else 0


_FIELD = re.compile(r"[0-9]{1,6}|[A-Za-z][A-Za-z0-9_]*")
_FORMAT_SPEC = re.compile(
    r"(?:.?[<>=^])?[-+ ]?z?#?0?([0-9]*)[_,]?(?:\.([0-9]+))?[bcdeEfFgGnosxX%]?", re.DOTALL | re.ASCII
)
_PERCENT = re.compile(r"%(?:\([^()]*\))?[#0 +-]*([0-9]*)(?:\.([0-9]*))?[hlL]?[diouxXeEfFgGcrsa%]")
_OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.BitAnd: operator.and_,
    ast.BitOr: operator.or_,
    ast.BitXor: operator.xor,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.LShift: operator.lshift,
    ast.Mod: operator.mod,
    ast.Mult: operator.mul,
    ast.Pow: operator.pow,
    ast.RShift: operator.rshift,
    ast.Sub: operator.sub,
}
_COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Eq: operator.eq,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda left, right: left in right,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.NotEq: operator.ne,
    ast.NotIn: lambda left, right: left not in right,
}
_UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.Invert: operator.invert,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
_NODE_NAMES: dict[type[ast.AST], str] = {
    ast.Await: "await expressions",
    ast.Lambda: "lambda functions",
    ast.NamedExpr: "assignments (:=)",
    ast.Slice: "slices of several dimensions",
    ast.Starred: "starred elements here",
    ast.Yield: "yield expressions",
    ast.YieldFrom: "yield expressions",
}


# -- methods -----------------------------------------------------------------------------------------------------------

_SET_METHODS = "copy difference intersection isdisjoint issubset issuperset symmetric_difference union"
_METHODS: dict[type, frozenset[str]] = {
    kind: frozenset(names.split())
    for kind, names in {
        str: "capitalize casefold center count endswith find format index isalnum isalpha isascii isdecimal isdigit "
        "isidentifier islower isnumeric isprintable isspace istitle isupper join ljust lower lstrip partition "
        "removeprefix removesuffix replace rfind rindex rjust rpartition rsplit rstrip split splitlines startswith "
        "strip swapcase title upper zfill",
        float: "is_integer",
        list: "copy count index pop",
        tuple: "count index",
        dict: "copy get items keys values",
        set: _SET_METHODS,
        frozenset: _SET_METHODS,
    }.items()
}
"""The methods that expressions may call."""


def _plain_method(method: Callable[..., Value]) -> Callable[..., Value]:
    """A method of a built-in type whose time and result grow with its arguments at most."""

    def call(run: Interpreter, *arguments: Value, **keywords: Value) -> Value:
        for each in (*arguments, *keywords.values()):
            run.spend(_weight(run.plain(each)) if type(each) in _SCALARS else run.size(each))
        return run.new(method(*arguments, **keywords))

    return call


def _padding_method(method: Callable[..., str]) -> Callable[..., Value]:
    def call(run: Interpreter, text: str, width: Value, *fill: Value) -> str:
        run.copy(width if type(width) is int else 0)
        return run.new(method(text, run.plain(width), *map(run.plain, fill)))  # type: ignore[no-any-return]

    return call


def _replace(run: Interpreter, text: str, old: Value, new: Value, count: Value = -1) -> str:
    if type(old) is not str or type(new) is not str or type(count) is not int:
        raise TypeError("replace() takes two strings and a count")
    run.copy(len(text) + text.count(old) * len(new))
    return text.replace(old, new, count)


def _pop(run: Interpreter, items: list[Value], *index: Value) -> Value:
    run.spend(len(items) // _CHARACTERS_PER_STEP)
    return items.pop(*map(run.plain, index))


def _set_method(method: Callable[..., Value]) -> Callable[..., Value]:
    def call(run: Interpreter, *sets: Value) -> Value:
        others = [run.hashed(each) for each in sets[1:]]
        _check(sum(map(len, (sets[0], *others))), *_ENTRIES)
        return run.new(method(sets[0], *others))

    return call


_SPECIAL_METHODS: dict[tuple[type, str], Callable[..., Value]] = {
    (str, "format"): lambda run, text, /, *arguments, **keywords: run.format(text, arguments, keywords),
    (str, "join"): lambda run, text, items: run.join(text, run.iterate(items)),
    (str, "replace"): _replace,
    (list, "pop"): _pop,
    (dict, "get"): lambda run, mapping, key, default=None: dict.get(mapping, run.key(key), default),
    **{(str, name): _padding_method(getattr(str, name)) for name in ("center", "ljust", "rjust", "zfill")},
    **{(kind, name): _set_method(getattr(kind, name)) for kind in (set, frozenset) for name in _SET_METHODS.split()},
}


# -- functions ---------------------------------------------------------------------------------------------------------


def _number(value: Value) -> Value:
    if type(value) not in _NUMBERS:
        raise TypeError(f"must be real number, not {type(value).__name__}")
    return value


def _numeric(function: Callable[..., Value]) -> Callable[..., Value]:
    """A function of numbers whose time does not depend on their values."""
    return lambda run, *numbers, **options: run.new(
        function(*map(_number, numbers), **{name: _number(value) for name, value in options.items()})
    )


def _of_numbers(function: Callable[..., Value]) -> Callable[..., Value]:
    """A function of lists of numbers."""
    return lambda run, *lists: run.new(function(*(list(map(_number, run.collect(each))) for each in lists)))


def _of_factors(function: Callable[..., int], steps: Callable[..., int]) -> Callable[..., Value]:
    def call(run: Interpreter, *numbers: Value) -> Value:
        values = list(map(_number, numbers))
        if any(type(each) is float for each in values):
            raise TypeError("'float' object cannot be interpreted as an integer")
        _check(steps(*values), _FACTOR_LIMIT, "factors")
        run.spend(_FACTOR_LIMIT)
        return run.new(function(*values))

    return call


def _product(run: Interpreter, items: Value, *, start: Value = 1) -> Value:
    for item in run.iterate(items):
        start = run.operate(ast.Mult, _number(start), _number(item))
    return start


def _least_common_multiple(run: Interpreter, *numbers: Value) -> Value:
    result = 1
    for number in numbers:
        result = run.new(math.lcm(result, _number(number)))
    return result


_PLAIN_MATH = (
    "acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh degrees erf erfc exp exp2 expm1 fabs "
    "floor fmod frexp gamma gcd hypot isclose isfinite isinf isnan isqrt ldexp lgamma log log10 log1p log2 modf "
    "nextafter pow radians remainder sin sinh sqrt tan tanh trunc ulp"
)


def _math_namespace() -> Namespace:
    plain: dict[str, Callable[..., Value]] = {name: _numeric(getattr(math, name)) for name in _PLAIN_MATH.split()}

    more: dict[str, Callable[..., Value]] = {
        "comb": _of_factors(math.comb, lambda n, k: min(k, n - k)),
        "dist": _of_numbers(math.dist),
        "factorial": _of_factors(math.factorial, lambda n: n),
        "fsum": _of_numbers(math.fsum),
        "lcm": _least_common_multiple,
        "perm": _of_factors(math.perm, lambda n, k=None: n if k is None else k),
        "prod": _product,
    }
    constants = {name: getattr(math, name) for name in ("e", "inf", "nan", "pi", "tau")}
    return Namespace({name: Function(name, call) for name, call in (plain | more).items()} | constants)


def _int(run: Interpreter, value: Value = 0, *base: Value, **keywords: Value) -> Value:
    _check(len(value) if type(value) is str else 0, _DIGITS_LIMIT, "digits of an integer")
    return run.new(int(run.plain(value), *base, **keywords))


def _float(run: Interpreter, value: Value = 0.0) -> float:
    run.spend(_weight(run.plain(value)))
    return float(value)


def _repr(run: Interpreter, value: Value) -> str:
    run.spend(run.size(run.plain(value)))
    return run.new(repr(value))  # type: ignore[no-any-return]


def _len(run: Interpreter, value: Value) -> int:
    if type(value) is GeneratorType:
        raise TypeError("object of type 'generator' has no len()")
    return len(run.plain(value))


def _dict(run: Interpreter, items: Value = (), /, **keywords: Value) -> Value:
    is_mapping = isinstance(items, dict)
    pairs = dict.items(run.plain(items)) if is_mapping else map(run.collect, run.iterate(items))
    return run.mapping(chain(pairs, keywords.items()))


_MISSING = object()


def _extreme(better: Callable[[Any, Any], bool], name: str) -> Callable[..., Value]:
    def call(run: Interpreter, *items: Value, key: Value = None, default: Value = _MISSING) -> Value:
        if not items:
            raise TypeError(f"{name} expected at least 1 argument, got 0")
        best, best_key = default, _MISSING
        for item in run.iterate(items[0]) if len(items) == 1 else items:
            item_key = run.plain(item if key is None else run.apply(key, item))
            run.spend(1 + (_weight(item_key) if type(item_key) in _SCALARS else run.size(item_key)))
            if best_key is _MISSING or better(item_key, best_key):
                best, best_key = item, item_key
        if best is _MISSING:
            raise ValueError(f"{name}() arg is an empty sequence")
        return best

    return call


def _sorted(run: Interpreter, items: Value, *, key: Value = None, reverse: Value = False) -> Value:
    elements = run.new(run.collect(items))
    keys = elements if key is None else run.new([run.apply(key, each) for each in elements])
    run.spend(run.size(keys) * max(1, len(keys)).bit_length() // 4)
    order = sorted(range(len(keys)), key=keys.__getitem__, reverse=bool(reverse))
    return [elements[index] for index in order]


def _sum(run: Interpreter, items: Value, start: Value = 0) -> Value:
    if type(start) is str:
        raise TypeError("sum() can't sum strings [use ''.join(seq) instead]")
    for item in run.iterate(items):
        start = run.operate(ast.Add, start, item)
    return start


def _round(run: Interpreter, number: Value, ndigits: Value = None) -> Value:
    _check(abs(ndigits) if type(ndigits) in (int, bool) else 0, XACRO_FORMAT_WIDTH.maximum, "digits to round to")
    return run.new(round(_number(number), run.plain(ndigits)))


def _map(run: Interpreter, function: Value, *sources: Value) -> Iterator[Value]:
    rows = zip(*map(run.iterate, sources), strict=False)
    return (run.apply(function, *row) for row in rows)


def _filter(run: Interpreter, function: Value, items: Value) -> Iterator[Value]:
    source = run.iterate(items)
    return (each for each in source if run.plain(each if function is None else run.apply(function, each)))


def _zip(run: Interpreter, *sources: Value, strict: Value = False) -> Iterator[Value]:
    rows = zip(*map(run.iterate, sources), strict=bool(strict))
    return (row for row in rows)


def _enumerate(run: Interpreter, items: Value, start: Value = 0) -> Iterator[Value]:
    rows = enumerate(run.iterate(items), run.plain(start))
    return (row for row in rows)


def _reversed(run: Interpreter, items: Value) -> Iterator[Value]:
    if type(items) is GeneratorType or type(items) in (set, frozenset):
        raise TypeError(f"{type(items).__name__!r} object is not reversible")
    elements = run.plain(items) if type(items) is range else run.collect(items)
    return run.iterate(each for each in reversed(elements))


def _isinstance(run: Interpreter, value: Value, kinds: Value) -> bool:
    functions = kinds if type(kinds) is tuple else (kinds,)
    if not all(type(each) is Function and each.type for each in functions):
        raise TypeError("isinstance() arg 2 must be a type or a tuple of types")
    return isinstance(run.plain(value), tuple(each.type for each in functions))


_TYPES: dict[type, Callable[..., Value]] = {
    bool: lambda run, value=False: run.truth(value),
    dict: _dict,
    float: _float,
    frozenset: lambda run, items=(): frozenset(run.hashed(items)),
    int: _int,
    list: lambda run, items=(): run.new(run.collect(items)),
    set: lambda run, items=(): run.hashed(items),
    str: lambda run, value="": run.text(value),
    tuple: lambda run, items=(): run.new(tuple(run.collect(items))),
}
_FUNCTIONS: dict[str, Callable[..., Value]] = {
    "abs": _numeric(abs),
    "all": lambda run, items: all(map(run.truth, run.iterate(items))),
    "any": lambda run, items: any(map(run.truth, run.iterate(items))),
    "divmod": _numeric(divmod),
    "enumerate": _enumerate,
    "filter": _filter,
    "isinstance": _isinstance,
    "len": _len,
    "map": _map,
    "max": _extreme(operator.gt, "max"),
    "min": _extreme(operator.lt, "min"),
    "ord": lambda run, character: ord(run.plain(character)),
    "range": _numeric(range),
    "repr": _repr,
    "reversed": _reversed,
    "round": _round,
    "sorted": _sorted,
    "sum": _sum,
    "zip": _zip,
}

MATH = _math_namespace()
"""The functions and constants of Python's module `math`."""
PYTHON = Namespace(
    {kind.__name__: Function(kind.__name__, call, kind) for kind, call in _TYPES.items()}
    | {name: Function(name, call) for name, call in _FUNCTIONS.items()}
    | {"True": True, "False": False}
)
"""The built-in functions of Python that expressions may call."""
