"""Robot descriptions that run a shell command, if anything evaluates the Python in them."""

from __future__ import annotations

from pathlib import Path

__all__ = ["HOSTILE", "hostile_urdf"]

_COMMAND = (
    "(lambda: [c for c in ().__class__.__base__.__subclasses__() if c.__name__=='_wrap_close'][0]"
    ".__init__.__globals__['system']('touch {marker}'))()"
)
_LINK = '<link name="base"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>'
_TEXTS = {
    "an expression": '<robot name="r${{{command}}}">{link}</robot>',
    "an expression in a link": '<robot name="r"><link name="${{{command}}}"/>{link}</robot>',
    "an escaped expression": '<robot name="$${{${{{command}}}}}">{link}</robot>',
    "a substitution": '<robot name="$(eval {command})">{link}</robot>',
    "an entity": '<robot name="r&#36;{{{command}}}">{link}</robot>',
    "a hexadecimal entity": '<robot name="r&#x24;{{{command}}}">{link}</robot>',
    "a text": '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><a>${{{command}}}</a>{link}</robot>',
    "a character section": (
        '<robot name="r" xmlns:xacro="http://ros.org/wiki/xacro"><a><![CDATA[${{{command}}}]]></a>{link}</robot>'
    ),
    "an element": (
        '<robot name="r" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:property name="a" value="${{{command}}}"/>'
        "{link}</robot>"
    ),
    "an undeclared element": '<robot name="r"><xacro:if value="${{{command}}}"/>{link}</robot>',
    "an include": '<robot name="r"><xacro:include filename="/etc/passwd"/>{link}</robot>',
    "another prefix": (
        '<robot name="r" xmlns:x="http://wiki.ros.org/xacro"><x:property name="a" value="${{{command}}}"/>{link}'
        "</robot>"
    ),
    "the default namespace": '<robot xmlns="http://www.ros.org/wiki/xacro" name="${{{command}}}">{link}</robot>',
    "a name of an attribute": '<robot name="r" xacro:if="1">{link}</robot>',
    "after a comment": '<?xml version="1.0"?><!-- plain --><robot name="${{{command}}}">{link}</robot>',
}
HOSTILE = tuple(_TEXTS)
"""What the texts have."""


def hostile_urdf(kind: str, marker: Path) -> str:
    """A description that creates a file, written in one way of `HOSTILE`."""
    return _TEXTS[kind].format(command=_COMMAND.format(marker=marker), link=_LINK)
