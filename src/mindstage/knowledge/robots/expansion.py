"""Expansion: xacro's macros, by the package that defines what they mean, in a process that can be ended.

A macro may hold any Python expression: one that never ends, or that takes all memory.
"""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from mindstage.errors import SourceParseError
from mindstage.knowledge.sources.packages import RosPackagePath

__all__ = ["expand_xacro"]

_TIMEOUT_S = 60.0
"""How long a description may take to expand; a whole robot takes one second."""


def expand_xacro(path: Path, packages: RosPackagePath, *, timeout_s: float = _TIMEOUT_S) -> bytes:
    """A description without macros.

    Raises:
        SourceParseError: xacro is not installed, gives up, or does not end in time.
    """
    if not _is_installed():
        cause = "it is written in xacro, which is not installed; try pip install mindstage[xacro]"
        raise SourceParseError(str(path), cause=cause)
    # -P: nothing that lies in the working directory is taken for a library.
    command = [sys.executable, "-P", "-m", "mindstage.knowledge.robots.expansion_process", str(path)]
    try:
        done = subprocess.run(
            [*command, *map(str, packages.folders)],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        cause = f"xacro did not expand it within {timeout_s:g} s"
        raise SourceParseError(str(path), cause=cause) from error
    if done.returncode:
        told = done.stderr.decode(errors="replace").strip().splitlines()
        why = told[-1] if told else f"the process that did it ended with {done.returncode}"
        raise SourceParseError(str(path), cause=f"xacro cannot expand it: {why}")
    return done.stdout


def _is_installed() -> bool:
    try:
        return find_spec("xacro") is not None
    except ValueError:  # it was taken away on purpose
        return False
