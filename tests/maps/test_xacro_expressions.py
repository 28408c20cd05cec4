"""Expressions of xacro files: the same values as Python's, no way out of the interpreter, and bounded work."""

from __future__ import annotations

import math
from typing import Any
from warnings import catch_warnings

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mindstage.maps.urdf.xacro_expressions import MATH, PYTHON, ExpressionError, Interpreter
from tests.cases import each_case

VARIABLES: dict[str, Any] = {
    "width": 0.5,
    "count": 3,
    "side": "left",
    "names": ["a", "b", "c"],
    "limits": {"lower": -1.5, "upper": 1.5},
    "pair": (1, 2),
    "flag": True,
    "nothing": None,
}
NAMES = {**MATH, **PYTHON, "math": MATH, "python": PYTHON, **VARIABLES}
PYTHON_NAMES = {**vars(math), **VARIABLES, "math": math}


def evaluate(expression: str) -> Any:
    return Interpreter(steps=200_000).evaluate(expression, NAMES)


def outcome(function: Any, *arguments: Any) -> Any:
    """The value, or the type of the error."""
    try:
        with catch_warnings(action="ignore"):  # Python's compiler warns of operations that can only fail
            return repr(function(*arguments))
    except Exception as error:
        return type(error)


EXPRESSIONS = """
1 + 2 * 3 - 4 / 5 // 2 % 3
2**10 - 2**-1 + 2.0**0.5
-count + +count + ~count
7 & 3 | 8 ^ 2 << 1 >> 1
width * sin(pi / 2) + cos(0) + math.atan2(1, 2)
math.factorial(5) + math.comb(5, 2) + math.perm(5) + math.gcd(12, 18) + math.lcm(4, 6)
math.isclose(1, 1 + 1e-12, rel_tol=1e-9) and math.fsum([0.1] * 10) and math.dist([0, 0], [3, 4]) and math.prod([2, 3])
1 < count <= 3 != 4 and not flag or nothing is None
count in (1, 3) and 'ef' in side and 'z' not in names and 'lower' in limits
'yes' if flag else 'no'
names[0] + names[-1] + side[1:3] + side[::-1]
limits['lower'] + limits['upper']
[n.upper() for n in names if n != 'b']
[(x, y) for x in range(3) for y in range(x)]
{n: i for i, n in enumerate(names)}
sorted({x % 3 for x in range(10)})
sum(x * x for x in range(10))
any(1 / x for x in [1, 0]) and all(x for x in [0, 1]) or max(3, 1, 2)
max(names, key=lambda_free) if False else max(names, key=len)
min([3, 1, 2]) + max([], default=5) + abs(-3) + round(2.567, 1) + round(2.5) + divmod(7, 2)[0]
[*names, *pair] + list(pair)
{**limits, 'effort': 3}
dict(limits, effort=3) | {'x': 1}
dict([('a', 1)], b=2).get('c', 'none') + str(list(limits.items())) + str(sorted(limits.keys()))
'%s_%d_%5.2f_%-4s|%05d|%x|%%' % (side, count, width, 'x', 42, 255)
'%(lower)s to %(upper).3f' % limits
'{}_{:.3f}_{!r}_{:>6}'.format(side, width, 'q', count)
'{1}{0}{1} {name:{n}} {{}}'.format('a', 'b', name='c', n=4)
'{:{}}|{}'.format(1.5, 6, 'end')
f'{side}_{width:.2f}_{count!r}_{count + 1:>{count}}'
', '.join(str(x) for x in pair) + side.replace('l', 'L') + ' x '.strip() + 'a b'.split()[1] + side.center(9, '*')
[side.startswith('le'), side.find('f'), side.count('e'), side.title(), side.zfill(6), 'a,b'.partition(',')]
list(map(str, [1, 2])) + list(filter(None, [0, 1])) + list(zip(names, pair)) + list(reversed(pair))
list(map(float, '1 2 3'.split()))
int('12') + int('ff', 16) + int(3.7) + float('1e3') + len(names) + ord('a') + bool('x')
isinstance(count, int) and isinstance(side, (int, str)) and not isinstance(width, list)
set(names) - set(['a']) == {'b', 'c'} and {1, 2}.union([3], range(5)) and {1} <= {1, 2}
limits.keys() & {'lower'} == {'lower'} and limits.keys() - {'lower'}
1.5 in range(3) or 2.0 in range(3) or 'x' in range(3)
sorted([(2, 'b'), (1, 'z')], reverse=True) + sorted(names, key=len)
[[1, 2], [3]][0][1] * 'ab'
sum([[1], [2, 3]], [])
range(5)[1:3]
(1).is_integer if False else (2.0).is_integer()
True + True
inf > 1e308 and isnan(nan) and degrees(pi)
-2 ** 2
(-2) ** 3 ** 2
'a' 'b'
0x1F + 0b11 + 0o17 + 1_000
1 / 0
side + 1
undefined
names[7]
limits['missing']
side.index('z')
[] < 1
int('x')
""".strip().splitlines()


@each_case("expression", EXPRESSIONS)
def test_an_expression_has_the_value_that_python_gives(expression: str) -> None:
    assert outcome(evaluate, expression) == outcome(eval, expression, dict(PYTHON_NAMES))


numbers = st.integers(-50, 50).map(str) | st.floats(-1e3, 1e3, allow_nan=False).map(repr)
strings = st.text("ab {}%$é", max_size=4).map(repr)


binary = st.sampled_from(
    [
        "+",
        "-",
        "*",
        "/",
        "//",
        "%",
        "**",
        "<<",
        ">>",
        "&",
        "|",
        "^",
        "<",
        "==",
        "!=",
        ">=",
        "in",
        "not in",
        "is",
        "and",
        "or",
    ]
)
functions = st.sampled_from(
    [
        "abs",
        "len",
        "str",
        "int",
        "float",
        "bool",
        "round",
        "min",
        "max",
        "sum",
        "sorted",
        "list",
        "tuple",
        "set",
        "repr",
        "sqrt",
        "floor",
        "any",
        "all",
    ]
)
methods = st.sampled_from(["upper", "strip", "split", "title", "isdigit", "keys", "items", "values", "copy"])
slices = st.sampled_from(["[0]", "[-1]", "[1:]", "[::-1]", "[:2]", "['a']"])


@st.composite  # which is shown by its name: the texts of strategies inside one another would be too long for the memory
def _operations(draw: st.DrawFn, inner: st.SearchStrategy[str]) -> str:
    operation = st.one_of(
        st.tuples(inner, binary, inner).map(lambda parts: "({} {} {})".format(*parts)),
        st.tuples(st.sampled_from(["-", "+", "~", "not "]), inner).map(lambda parts: "({}{})".format(*parts)),
        st.tuples(functions, inner).map(lambda parts: "{}({})".format(*parts)),
        st.tuples(inner, methods).map(lambda parts: "({}).{}()".format(*parts)),
        st.tuples(inner, slices).map(lambda parts: "({}){}".format(*parts)),
        st.tuples(inner, inner, inner).map(lambda parts: "({} if {} else {})".format(*parts)),
        st.lists(inner, max_size=3).map(lambda parts: f"[{', '.join(parts)}]"),
        st.lists(inner, max_size=3).map(lambda parts: f"({''.join(part + ', ' for part in parts)})"),
        st.lists(inner, max_size=2).map(lambda parts: "{" + ", ".join(f"{part!r}: {part}" for part in parts) + "}"),
        st.tuples(inner, inner, inner).map(lambda parts: "[({}, x) for x in {} if {}]".format(*parts)),
        st.tuples(inner, inner).map(lambda parts: "'%s-%5s' % ({}, {})".format(*parts)),
        st.tuples(inner, inner).map(lambda parts: "'{{}} {{!r}}'.format({}, {})".format(*parts)),
    )
    return draw(operation)


expressions = st.recursive(numbers | strings | st.sampled_from([*VARIABLES, "pi", "True", "x"]), _operations)


@settings(max_examples=400)
@given(expressions)
def test_a_random_expression_has_the_value_that_python_gives(expression: str) -> None:
    limited = outcome(evaluate, expression)
    if (
        limited is not ExpressionError
    ):  # a limit, complex numbers, or a method in a place where Python has one more type
        assert limited == outcome(eval, expression, dict(PYTHON_NAMES))


FORBIDDEN = r"""
(lambda: 1)()
().__class__.__bases__[0].__subclasses__()
''.__class__
'{0.__class__}'.format(1)
'{0[__class__]}'.format(limits)
'{x.real}'.format(x=1)
'{0:{0.__class__}}'.format(1)
f'{side.__class__}'
f'{count!r:{side.__class__}}'
'%(__class__)s'.__mod__(limits)
side.format_map(limits)
str.format('{0.__class__}', 1)
(x for x in names).gi_frame
(x for x in names).gi_frame.f_back.f_globals
[x for x in names].append(1)
names.append(1)
names.sort()
limits.update({})
limits.pop('lower')
limits.lower
limits._hidden
(y := 5)
[y := 1, y]
[[a := x] for x in names]
[0 for names[0] in [1]]
[0 for math.pi in [1]]
__import__('os')
__builtins__
__builtins__['eval']
math.__dict__
math.__loader__
math.factorial.__self__
sin.__call__(1)
sin.call
python.type(1)
python.vars(1)
python.hash(1)
python.int.mro()
python.dict.fromkeys([1])
getattr(1, 'real')
setattr(limits, 'a', 1)
eval('1')
exec('1')
compile('1', '', 'eval')
open('/etc/passwd')
globals()
locals()
breakpoint()
print(1)
input()
object
type(1)
type('X', (), {})
super()
side.encode()
side.translate({})
side.maketrans('a', 'b')
count.to_bytes(1)
count.real
(1).__add__(2)
b'bytes'
1j
(-8) ** 0.5
complex(1)
...
names @ names
await side
sin
math
[sin, cos]
{'f': sin}
str(sin)
'%s' % sin
f'{math}'
sin == cos
not sin
sin[0]
math['__name__']
dict(**{1: 2})
sorted(names, key=eval)
map(eval, names)
list(map('x', names))
isinstance(1, 'int')
yield 1
import os
x = 1
"""


@each_case("expression", FORBIDDEN.strip().splitlines())
def test_there_is_no_way_out_of_an_expression(expression: str) -> None:
    with pytest.raises((ExpressionError, NameError, TypeError, KeyError, SyntaxError)):
        evaluate(expression)


EXCESSIVE = r"""
10 ** 10 ** 10
2 ** -(-10 ** 6)
1 << 10 ** 9
1 << (1 << 4000)
10 ** 1000 * 10 ** 1000
'x' * 10 ** 9
10 ** 9 * [0]
(1,) * 10 ** 9
[[[[[[[[0] * 10] * 10] * 10] * 10] * 10] * 10] * 10] * 10
[[0] * 1000] * 1000 * 1000
list(range(10 ** 12))
[*range(10 ** 12)]
max(*range(10 ** 12))
sum(range(10 ** 12))
any(False for x in range(10 ** 12))
[x for x in range(10 ** 12)]
[0 for a in range(1000) for b in range(1000) for c in range(1000)]
{x for x in range(10 ** 12)}
{x: x for x in range(10 ** 12)}
sorted(range(10 ** 12))
tuple(zip(range(10 ** 12)))
list(map(str, range(10 ** 12)))
list(filter(None, range(10 ** 12)))
list(enumerate(range(10 ** 12)))
list(reversed(range(10 ** 12)))
{1}.union(range(10 ** 12))
int('9' * 10 ** 5)
int('z' * 10 ** 5, 36)
side.center(10 ** 9)
side.ljust(10 ** 9)
side.rjust(10 ** 9)
side.zfill(10 ** 9)
'%1000000000d' % 1
'%.1000000000f' % 1
'%*d' % (10 ** 9, 1)
'%(a(b))1000000000d' % limits
'{:1000000000}'.format(1)
'{:{}}'.format(1, 10 ** 9)
f'{1:1000000000}'
f'{1:.{10 ** 9}f}'
'%(a)s' * 10000 % {'a': 'x' * 10000}
'%s' % ([[['x' * 100] * 100] * 100] * 100)
factorial(10 ** 6)
math.comb(10 ** 6, 5 * 10 ** 5)
math.perm(10 ** 6, 10 ** 5)
math.prod(range(1, 10 ** 6))
math.lcm(*[2 ** 4000 + i for i in range(10000)])
round(5, -10 ** 9)
('a' * 1000).replace('a', 'b' * 10000)
('a' * 900000).replace('', 'bb')
('a' * 100000).join(['a'] * 10000)
''.join('a' * 1000 for x in range(10 ** 6))
repr(['x' * 1000] * 10000)
"""
EXCESSIVE_TEXTS = [
    pytest.param("-" * 9000 + "1", id="signs"),
    pytest.param("1" + "+1" * 4900, id="sum"),
    pytest.param("not " * 2400 + "1", id="negations"),
    pytest.param("side" + "[0]" * 3000, id="subscripts"),
    pytest.param("side" + ".lower()" * 1200, id="calls"),
    pytest.param("[" * 150 + "]" * 150, id="lists"),
    pytest.param("1" * 20000, id="long"),
]


@each_case("expression", [*EXCESSIVE.strip().splitlines(), *EXCESSIVE_TEXTS])
def test_work_beyond_a_limit_is_refused(expression: str) -> None:
    with pytest.raises(ExpressionError, match=r"more than|nested too deeply|is not supported"):
        evaluate(expression)


def test_the_steps_of_all_expressions_are_counted_together() -> None:
    interpreter = Interpreter(steps=100_000)
    interpreter.evaluate("sum(range(10000))", NAMES)
    with pytest.raises(ExpressionError, match="more than 100,000 steps"):
        interpreter.evaluate("[each for each in range(90000)]", NAMES)
    with pytest.raises(ExpressionError, match="more than 100,000 steps"):
        interpreter.evaluate("1", NAMES)


def test_numbers_that_collide_as_keys_are_limited() -> None:
    with pytest.raises(ExpressionError, match="more than 20,000 entries"):
        Interpreter().evaluate("{x * (2 ** 61 - 1) for x in range(100000)}", NAMES)


def test_a_long_sum_needs_no_depth() -> None:
    assert evaluate("0" + " + 1" * 600) == 600


def test_an_iterator_becomes_a_list() -> None:
    assert evaluate("map(len, names)") == [1, 1, 1]
    assert evaluate("(x for x in pair)") == [1, 2]


def test_a_list_can_be_emptied_from_its_front() -> None:
    names = NAMES | {"levels": ["1", "2"]}
    assert Interpreter().evaluate("levels.pop(0) + levels.pop()", names) == "12"
    assert names["levels"] == []


def test_the_error_of_a_function_that_is_not_called_names_the_kind() -> None:
    with pytest.raises(ExpressionError, match="plain data, not a function"):
        evaluate("sin")
