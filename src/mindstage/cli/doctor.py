"""The verb `doctor`: what of Mindstage works on this machine, what is missing, and how to get it."""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from enum import StrEnum
from importlib.metadata import PackageNotFoundError, distribution, requires, version

from mindstage.cli.options import AsJson, ExitCode
from mindstage.cli.output import print_json, print_line, print_table, progress_spinner

__all__ = ["doctor"]

_PACKAGE = "mindstage"
_PROBE_TIMEOUT_S = 60.0
"""Longest time of one component [s]; the first import of a library of graphics can take half of it."""
_OTHER_EXTRAS = frozenset({"all", "bench", "dev", "docs"})
"""Extras of extras, and those for developers."""
_NOT_FOUND = "NOT FOUND: "
"""Begin of the last line of a probe whose component is not installed."""


class _State(StrEnum):
    WORKS = "works"
    MISSING = "missing"
    BROKEN = "broken"


@dataclass(frozen=True, slots=True)
class _Finding:
    """What was found out about one component."""

    component: str
    purpose: str
    state: _State
    detail: str
    """Its version, or why it does not work."""
    remedy: str = ""
    """What to do if it does not work."""


@dataclass(frozen=True, slots=True)
class _Probe:
    """A component that is tried in a process of its own, since libraries of graphics and Prolog can end theirs."""

    component: str
    purpose: str
    code: str
    """Prints the version; prints `NOT FOUND: ` with the cause if it is not installed."""
    remedy: str
    extra: str = ""
    """The extra that it needs."""


_TRY_OPENGL = """
from mindstage.rendering.gl_context import OffscreenContext
with OffscreenContext() as context:
    print(context.platform)
"""
_TRY_GODOT = """
from mindstage.engines.remote.godot_process import find_godot
from mindstage.errors import EngineUnavailableError
try:
    found = find_godot()
    print(found.version, "at", found.path)
except EngineUnavailableError as error:
    if "not found" not in error.cause:
        raise SystemExit(error.cause)
    print("NOT FOUND:", error.cause)
"""
_TRY_PROLOG = """
import shutil
if (program := shutil.which("swipl")) is None:
    print("NOT FOUND: there is no swipl on the PATH")
else:
    from mindstage.prolog.swipl import load_library
    load_library()
    import subprocess
    print(subprocess.run([program, "--version"], capture_output=True, text=True).stdout.strip(), "at", program)
"""
_TRY_BROWSER = """
import webbrowser
try:
    print(webbrowser.get().name)
except webbrowser.Error as error:
    print("NOT FOUND:", error)
"""
_TRY_ROS = """
import os
try:
    import rclpy
except ModuleNotFoundError as error:
    print(f"NOT FOUND: {error}")
else:
    print(f"rclpy at {os.path.dirname(rclpy.__file__)}, ROS_DISTRO={os.environ.get('ROS_DISTRO', 'not set')}")
"""
_TRY_GPU = """
import warp
warp.config.quiet = True
warp.init()
devices = [f"{each.name} ({each.total_memory / 2**30:.0f} GiB)" for each in warp.get_cuda_devices()]
print(", ".join(devices) if devices else "NOT FOUND: no device with CUDA")
"""
_PROBES = (
    _Probe(
        "MuJoCo",
        "physics",
        "import mujoco\nfrom mindstage.engines.mujoco import MujocoEngine\n"
        "engine = MujocoEngine()\nengine.step(0.01)\nprint(mujoco.__version__)",
        "reinstall mindstage",
    ),
    _Probe(
        "page",
        "the viewer",
        "import viser\nimport mindstage.viewer.viewer\nprint('viser', viser.__version__)",
        "reinstall mindstage",
    ),
    _Probe("browser", "demo and spawn --open", _TRY_BROWSER, "install one, or open the printed address elsewhere"),
    _Probe("OpenGL", "shot, cameras of robots", _TRY_OPENGL, "Debian: apt-get install libegl1 libgl1-mesa-dri"),
    _Probe("Godot", "--engine godot", _TRY_GODOT, "see docs/how-to/godot.md; a checkout has scripts/install_godot.sh"),
    _Probe("SWI-Prolog", "prolog, Prolog queries", _TRY_PROLOG, "Debian: apt-get install swi-prolog-nox", "prolog"),
    _Probe("ROS 2", "only for programs beside Mindstage", _TRY_ROS, "not needed: serve speaks rosbridge without ROS"),
    _Probe("GPU", "samples of plans on a GPU", _TRY_GPU, "needs an NVIDIA GPU with its driver", "gpu"),
)


def doctor(*, as_json: AsJson = False) -> ExitCode:
    """Say what works here, what is missing and how to get it; exit 1 if something installed does not work."""
    extras = _missing_by_extra()
    with progress_spinner("trying each component"), ThreadPoolExecutor(max_workers=2) as pool:
        components = list(pool.map(lambda probe: _try(probe, extras), _PROBES))
    found = [*components, *_extra_findings(extras)]
    system = _system()
    if as_json:
        print_json({"system": system, "components": [asdict(each) for each in found]})
    else:
        print_line(", ".join(f"{name} {value}" for name, value in system.items()))
        print_table(
            "",
            ("component", "for", "state", "version or cause"),
            [(each.component, each.purpose, each.state.value, each.detail) for each in found],
        )
        for each in found:
            if each.state is not _State.WORKS:
                print_line(f"{each.component}: {each.remedy}")
    return ExitCode.NEGATIVE if any(each.state is _State.BROKEN for each in found) else ExitCode.OK


def _system() -> dict[str, str]:
    return {
        "mindstage": version(_PACKAGE),
        "Python": platform.python_version(),
        "on": platform.platform(terse=True),
        "cores": str(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()),
    }


def _try(probe: _Probe, missing_by_extra: dict[str, list[str]]) -> _Finding:
    if missing := missing_by_extra.get(probe.extra):
        detail = f"{', '.join(missing)} not installed"
        remedy = f"{_install(probe.extra)}; {probe.remedy}"
        return _Finding(probe.component, probe.purpose, _State.MISSING, detail, remedy)
    command = [sys.executable, "-X", "utf8", "-c", probe.code]
    try:
        ended = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace",
            timeout=_PROBE_TIMEOUT_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        cause = f"it did not answer within {_PROBE_TIMEOUT_S:g} s"
        return _Finding(probe.component, probe.purpose, _State.BROKEN, cause, probe.remedy)
    last = next(reversed(ended.stdout.strip().splitlines()), "")
    if ended.returncode == 0 and not last.startswith(_NOT_FOUND):
        return _Finding(probe.component, probe.purpose, _State.WORKS, last)
    if ended.returncode == 0:
        return _Finding(probe.component, probe.purpose, _State.MISSING, last.removeprefix(_NOT_FOUND), probe.remedy)
    said = next(reversed(ended.stderr.strip().splitlines()), "") or last
    cause = said or f"it ended with the code {ended.returncode}"
    return _Finding(probe.component, probe.purpose, _State.BROKEN, re.sub(r"^[\w.]+Error: ", "", cause), probe.remedy)


def _missing_by_extra() -> dict[str, list[str]]:
    """The distributions that each extra needs and that are not installed."""
    missing: dict[str, list[str]] = {}
    for requirement in requires(_PACKAGE) or ():
        found = re.fullmatch(r"([\w.-]+).*;.*extra == ['\"]([\w-]+)['\"].*", requirement)
        if found is not None and found[2] not in _OTHER_EXTRAS:
            names = missing.setdefault(found[2], [])
            if not _is_installed(found[1]):
                names.append(found[1])
    return missing


def _is_installed(name: str) -> bool:
    try:
        return distribution(name) is not None
    except PackageNotFoundError:
        return False


def _extra_findings(missing_by_extra: dict[str, list[str]]) -> Iterable[_Finding]:
    for extra, missing in missing_by_extra.items():
        state = _State.MISSING if missing else _State.WORKS
        detail = f"{', '.join(missing)} not installed" if missing else "installed"
        yield _Finding(f"extra {extra}", "docs/reference/extras.md", state, detail, _install(extra) if missing else "")


def _install(extra: str) -> str:
    return f"pip install '{_PACKAGE}[{extra}]'"
