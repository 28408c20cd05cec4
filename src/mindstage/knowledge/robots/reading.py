"""Reading descriptions: from bytes to a `UrdfRobot`, whatever the bytes are.

No document type is allowed, so there are no entities to blow up or to fetch, and what is too long or too deep is
refused. Xacro is expanded by the package `xacro`, where that is installed.
"""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from mindstage.errors import SourceParseError
from mindstage.knowledge.robots.elements import parse_robot
from mindstage.knowledge.robots.robot import UrdfRobot
from mindstage.knowledge.sources.packages import RosPackagePath

__all__ = ["is_urdf", "read_urdf"]

LENGTH_LIMIT = 64 * 1024 * 1024
"""Bytes; the largest descriptions of robots have one or two million."""
DEPTH_LIMIT = 200
"""Elements inside elements; a description has six levels, and what simulators add a few more."""

_HEAD = 64 * 1024
_PROLOG = rb"(?>\s+|<\?.*?\?>|<!--.*?-->|<!DOCTYPE[^>\[]*(?:\[[^\]]*\]\s*)?>)*+"
"""What may stand before the outermost element; nothing is tried twice, or a thousand comments would take for ever."""
_ROBOT = re.compile(rb"\A(?:\xef\xbb\xbf)?" + _PROLOG + rb"<robot[\s/>]", re.DOTALL)
_XACRO = re.compile(rb"xmlns:xacro\s*=|<xacro:")


def is_urdf(path: Path) -> bool:
    """Whether the outermost element of a file is a robot's; whether it can be read shows only then."""
    try:
        with path.open("rb") as file:
            return _ROBOT.match(file.read(_HEAD)) is not None
    except OSError:
        return False  # who reads it says why it cannot be read


def read_urdf(path: Path, packages: RosPackagePath) -> UrdfRobot:
    """Reads a description.

    Args:
        path: the file, URDF or xacro.
        packages: where `package://` meshes and the files that xacro includes are looked up.

    Raises:
        SourceParseError: there is no such file, it is too long or not well-formed, names a document type, or needs
            xacro, and that is not installed or fails.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SourceParseError(str(path), cause=error.strerror or str(error)) from error
    root = _parse_xml(path, data)
    if root.tag != "robot":
        raise SourceParseError(str(path), cause=f"its outermost element is <{root.tag}>, not <robot>")
    if _XACRO.search(data):
        from mindstage.knowledge.robots.expansion import expand_xacro

        root = _parse_xml(path, expand_xacro(path, packages))
    return parse_robot(root, path, packages)


def _parse_xml(path: Path, data: bytes) -> ElementTree.Element:
    if len(data) > LENGTH_LIMIT:
        cause = f"it has {len(data):,} bytes; a robot's description may have {LENGTH_LIMIT:,}"
        raise SourceParseError(str(path), cause=cause)
    parser, builder, depth = expat.ParserCreate(), ElementTree.TreeBuilder(), 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEPTH_LIMIT:
            cause = f"elements stand in one another more than {DEPTH_LIMIT} deep"
            raise SourceParseError(str(path), cause=cause, line=parser.CurrentLineNumber)
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*_: object) -> None:
        cause = "it has a document type (DOCTYPE), which a robot's description has no use for; take it out"
        raise SourceParseError(str(path), cause=cause, line=parser.CurrentLineNumber)

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        cause = f"it is not well-formed XML: {expat.ErrorString(error.code)}"
        raise SourceParseError(str(path), cause=cause, line=error.lineno) from error
    return builder.close()
