"""Finds handlers that decide by themselves who may do something, how much of it, or what a text may name.

The rules, for the packages that handle requests:

- no constant with `MAX`, `LIMIT`, `TIMEOUT` or `DEADLINE` in its name that is a number: it belongs to the table;
- no comparison of tokens, origins and hosts: `compare_digest`, `is_loopback`, and the headers `Origin`, `Host`,
  `Authorization` and `Cookie` are of the gate;
- no search for schemes of URLs (`"file:" in text`, `startswith("http://")`): `access.resources` decides what is named;
- no `resolve`, `is_relative_to`, `open` or `read_text` of a path that is made of a field of a request;
- no error of a limit (`RequestLimitError`, `ResourceRefusedError`) that is raised by a handler.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from tests.conftest import ROOT

__all__ = ["private_checks"]

_PACKAGES = ("bridge", "prolog", "ros", "viewer")
_LIMIT = re.compile(r"(^|_)(MAX|LIMIT|TIMEOUT|DEADLINE)(_|$)")
_SCHEME = re.compile(r"^(file|https?|ftp|data):")
_GATE_CALLS = {"compare_digest", "is_loopback"}
_GATE_HEADERS = {"Origin", "Host", "Authorization", "Cookie"}
_FILE_CALLS = {"resolve", "is_relative_to", "open", "read_text", "read_bytes", "is_file", "exists"}
_LIMIT_ERRORS = {"RequestLimitError", "ResourceRefusedError"}

ALLOWED: Mapping[str, str] = {
    "viewer/scene.py": "limits of drawing",
    "viewer/view_tools.py": "lengths of rays",
    "viewer/drag.py": "angles and lengths of drags",
    "viewer/adding.py": "a distance from the pointer",
    "ros/named_poses.py": "the height of a box",
    "ros/robot_controllers.py": "a step of an iteration",
}
"""Modules with constants that limit no request, each with the reason; the other rules hold for them too."""
NOT_SERVED: Mapping[str, str] = {
    "bridge/client.py": "a client",
    "viewer/html_export.py": "writes a file for the command line",
}
"""Modules that handle no request of a client."""
DISPATCHERS = {"bridge/calls.py", "bridge/broker.py", "bridge/server.py", "viewer/server.py", "viewer/http.py"}
"""Modules that apply policies, and so may answer with their errors."""


def private_checks(package: Path = ROOT / "src" / "mindstage") -> list[str]:
    """What handlers decide by themselves: a line for each.

    Args:
        package: the folder with these packages.
    """
    sources = {
        path.relative_to(package).as_posix(): path for name in _PACKAGES for path in (package / name).rglob("*.py")
    }
    return [
        f"{module}:{line}: {problem}"
        for module, path in sorted(sources.items())
        if module not in NOT_SERVED
        for line, problem in _problems(ast.parse(path.read_text(encoding="utf-8")), module)
    ]


def _problems(tree: ast.Module, module: str) -> Iterator[tuple[int, str]]:
    if module not in ALLOWED:
        yield from ((node.lineno, f"the limit {name} is not in the table") for node, name in _constants(tree))
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) if name in _GATE_CALLS:
                yield node.lineno, f"{name} is of the gate"
            case ast.Call(func=ast.Attribute(attr="get"), args=[ast.Constant(value=str(name)), *_]) if (
                name in _GATE_HEADERS and not _is_for_policy(node, tree)
            ):
                yield node.lineno, f"the header {name} is of the gate"
            case ast.Compare(left=ast.Constant(value=str(text)), ops=[ast.In() | ast.NotIn()]) if _SCHEME.match(text):
                yield node.lineno, f"{text!r} is searched in a text"
            case ast.Call(func=ast.Attribute(attr="startswith"), args=[ast.Constant(value=str(text)), *_]) if (
                _SCHEME.match(text)
            ):
                yield node.lineno, f"{text!r} is searched in a text"
            case ast.Call(func=ast.Attribute(attr=name, value=value)) if name in _FILE_CALLS and _has_request(value):
                yield node.lineno, f"{name} of a path in a request"
            case ast.Call(func=ast.Name(id="open"), args=[value, *_]) if _has_request(value):
                yield node.lineno, "open of a path in a request"
            case ast.Raise(exc=ast.Call(func=ast.Name(id=name))) if name in _LIMIT_ERRORS and module not in DISPATCHERS:
                yield node.lineno, f"{name} is raised by a handler"


def _constants(tree: ast.Module) -> Iterator[tuple[ast.stmt, str]]:
    for node in tree.body:
        match node:
            case (
                ast.Assign(targets=[ast.Name(id=name)], value=value)
                | ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value)
            ) if _LIMIT.search(name) and _is_number(value):
                yield node, name


def _is_number(value: ast.expr) -> bool:
    return all(isinstance(each, ast.Constant | ast.BinOp | ast.operator) for each in ast.walk(value)) and any(
        isinstance(each, ast.Constant) and isinstance(each.value, int | float) for each in ast.walk(value)
    )


def _has_request(value: ast.AST) -> bool:
    """Whether an expression contains a field of a request or a goal."""
    return any(
        isinstance(each, ast.Attribute) and isinstance(each.value, ast.Name) and each.value.id in {"request", "goal"}
        for each in ast.walk(value)
    )


def _is_for_policy(node: ast.Call, tree: ast.Module) -> bool:
    """Whether a header is only put into a content security policy, which names the page's own websocket."""
    return any(
        isinstance(each, ast.Call)
        and isinstance(each.func, ast.Name)
        and each.func.id in {"_page_policy", "_view_policy"}
        and node in ast.walk(each)
        for each in ast.walk(tree)
    )
