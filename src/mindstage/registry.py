"""What installed packages add to Mindstage: questions, skills, engines, dialects, formats, verbs and sensors.

A package declares each of them as an entry point in its metadata, with the access class in brackets:

    [project.entry-points."mindstage.questions"]
    shelf_life = "pantry.questions:shelf_life [read]"

So it is listed, and it is decided whether clients of ports may use it, before any code of the package runs. Mindstage
declares its own in the same way. What cannot be loaded is a problem that is logged once, and stops nothing else.
"""

from __future__ import annotations

import logging
import os
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from enum import StrEnum
from functools import cache
from hashlib import blake2b
from importlib import import_module
from pathlib import Path
from threading import RLock
from typing import Any, Generic, TypeVar

import msgspec

from mindstage.access.policies import Access
from mindstage.access.resources import is_outside_request
from mindstage.errors import ExtensionError
from mindstage.files import atomic_write, cache_dir, delete_least_recently_used

__all__ = ["Extension", "Group", "added", "catalog", "extensions", "fingerprint", "load_all", "problems", "reporting"]

T = TypeVar("T")
L = TypeVar("L")

_OWN = "mindstage"
_REFERENCE = re.compile(r"(?P<module>[\w.]+)\s*:\s*(?P<name>[\w.]+)\s*(?:\[\s*(?P<access>\w+)\s*\])?")
_CHECKOUT = Path(__file__).parents[2] / "pyproject.toml"
"""Of a source tree, which need not be installed, and whose installed metadata may be older than it is."""
_CACHE_BYTES = 8_000_000
_STARTED_NS = time.time_ns()
_log = logging.getLogger("mindstage.registry")


class Group(StrEnum):
    """The groups of entry points."""

    QUESTIONS = "mindstage.questions"
    """Each is a `mindstage.knowledge.questions.Question`."""
    SKILLS = "mindstage.skills"
    """Each is a `mindstage.robots.skill_declaration.Skill`."""
    ENGINES = "mindstage.engines"
    """Each is an `mindstage.engines.EngineFactory`."""
    DIALECTS = "mindstage.dialects"
    """Each is a `mindstage.maps.dialects.source_map.Dialect`."""
    FORMATS = "mindstage.formats"
    """Each is a `mindstage.maps.io.formats.WorldFormat`."""
    VERBS = "mindstage.verbs"
    """Each is a function whose signature is that of the command; NAME.VERB is a verb of the group NAME."""
    SENSORS = "mindstage.sensors"
    """Each is a `mindstage.robots.sensors.Sensor`."""


_OFFERED: Mapping[Group, frozenset[Access]] = {
    Group.SKILLS: frozenset(Access),
    **dict.fromkeys((Group.QUESTIONS, Group.DIALECTS, Group.FORMATS, Group.SENSORS), frozenset({Access.READ})),
}
"""What ports offer of each group, by the policies of their requests; no engines and no verbs."""


class Extension(msgspec.Struct, frozen=True):
    """An entry point of an installed package."""

    group: Group
    name: str
    module: str
    attribute: str
    package: str
    """The name of the distribution."""
    access: Access | None
    """None if none is declared."""
    value: Any = None
    """What a program has added itself; see `added`."""

    @property
    def is_offered(self) -> bool:
        """Whether clients of ports may use it."""
        return self.access in _OFFERED.get(self.group, ())

    def load(self, kind: type[T]) -> T:
        """What it names; its module is imported.

        Args:
            kind: the class of which it must be.

        Raises:
            ExtensionError: it cannot be imported, is not there, or is of another class.
        """
        with self.failing():
            found = self.value
            if found is None:
                found = import_module(self.module)
                for name in self.attribute.split("."):
                    found = getattr(found, name)
            if not isinstance(found, kind):
                raise TypeError(f"{self.module}:{self.attribute} is no {kind.__name__}")
            return found
        raise AssertionError

    @contextmanager
    def failing(self) -> Iterator[None]:
        """In the context, what its package raises becomes an `ExtensionError`."""
        try:
            yield
        except ExtensionError:
            raise
        except (Exception, SystemExit) as error:
            if isinstance(error, SystemExit) and type(error) is not SystemExit:
                raise  # SIGTERM during the import, see `mindstage.cli.termination`
            cause = f"{type(error).__name__}: {error}"
            raise ExtensionError(self.name, group=self.group.value, package=self.package, cause=cause) from error


def extensions(group: Group) -> Mapping[str, Extension]:
    """The entry points of a group by name, those of Mindstage first; for a client of a port those that are offered."""
    found = _installed().extensions[group] | _added.get(group, {})
    if is_outside_request():
        return {name: each for name, each in found.items() if each.is_offered}
    return found


@contextmanager
def added(group: Group, name: str, value: object, *, access: Access | None = None) -> Iterator[None]:
    """In the context, this process has one more of a group, such as a skill that is being written.

    Args:
        group: the group.
        name: its name; one of an installed package is hidden.
        value: what an entry point would name.
        access: its access class; None does not offer it to clients of ports.
    """
    before = _added.get(group, {})
    _added[group] = before | {name: Extension(group, name, "", "", "this program", access, value)}
    try:
        yield
    finally:
        _added[group] = before


_added: dict[Group, dict[str, Extension]] = {}


def load_all(group: Group, kind: type[T]) -> dict[str, T]:
    """What the entry points of a group name, without those that cannot be loaded."""
    found: dict[str, T] = {}
    for name, each in extensions(group).items():
        with reporting():
            found[name] = each.load(kind)
    return found


def fingerprint(*groups: Group) -> list[tuple[str, str, str, tuple[int, int]]]:
    """What the entry points of groups are: names, references, and the state of their modules in other packages."""
    found = []
    for each in (each for group in groups for each in extensions(group).values()):
        file = ""
        if each.package != _OWN and each.value is None:
            with reporting():
                each.load(object)
            file = getattr(sys.modules.get(each.module), "__file__", None) or ""
        found.append((each.name, f"{each.module}:{each.attribute}", file, _file_state(file)))
    return found


def problems() -> tuple[str, ...]:
    """What is wrong with entry points; those that were not loaded yet may have more."""
    return (*_installed().problems, *_failures)


_failures: dict[str, None] = {}


@contextmanager
def reporting() -> Iterator[None]:
    """In the context, an `ExtensionError` is logged, once, instead of being raised."""
    try:
        yield
    except ExtensionError as error:
        if str(error) not in _failures:
            _failures[str(error)] = None
            _log.warning("%s", error)


def catalog(group: Group, loaded: type[L], describe: Callable[[L], T], kind: type[T]) -> Mapping[str, T]:
    """What is known of each entry point of a group without loading it, such as the words of questions.

    It is made by loading them and kept in the cache directory, until a source file of these packages, or what is
    installed, has changed.

    Args:
        group: the group.
        loaded: the class of what its entry points name.
        describe: makes the description of what was loaded.
        kind: the type of the descriptions, which msgspec can encode.
    """
    with _lock:
        if (known := _catalogs.get(group)) is None:
            known = _catalogs[group] = _read_catalog(group, kind)
        count, found = len(known), {}
        for name, each in extensions(group).items():
            kept = known if each.value is None else {}
            with reporting(), each.failing():
                if name not in kept:
                    kept[name] = describe(each.load(loaded))
                found[name] = kept[name]
        if len(known) > count:
            _write_catalog(group, known)
    return found


_catalogs: dict[Group, dict[str, Any]] = {}
_lock = RLock()


class _Catalog(msgspec.Struct, Generic[T]):
    files: dict[str, tuple[int, int]]
    """Modification time [ns] and size of each source file that was loaded to make it."""
    entries: dict[str, T]


def _read_catalog(group: Group, kind: type[T]) -> dict[str, T]:
    with suppress(OSError, msgspec.MsgspecError):
        stored = msgspec.json.decode(_cache_file(group).read_bytes(), type=_Catalog[kind])  # type: ignore[valid-type]
        if all(_file_state(path) == state for path, state in stored.files.items()):
            return stored.entries
    return {}


def _write_catalog(group: Group, entries: Mapping[str, Any]) -> None:
    packages = {each.module.partition(".")[0] for each in _installed().extensions[group].values()}
    modules = [each for name, each in tuple(sys.modules.items()) if name.partition(".")[0] in packages]
    files = {path: _file_state(path) for each in modules if (path := getattr(each, "__file__", None)) is not None}
    if all(changed_ns < _STARTED_NS for changed_ns, _ in files.values()):  # else what was loaded may be older
        with suppress(OSError):
            path = _cache_file(group)
            atomic_write(path, msgspec.json.encode({"files": files, "entries": entries}))
            delete_least_recently_used(path, max_bytes=_CACHE_BYTES)


def _file_state(path: str) -> tuple[int, int]:
    try:
        status = os.stat(path)
    except OSError:
        return (0, 0)
    return (status.st_mtime_ns, status.st_size)


# -- what is installed -------------------------------------------------------------------------------------------------


class _Installed(msgspec.Struct):
    extensions: dict[Group, dict[str, Extension]]
    problems: list[str]


@cache
def _installed() -> _Installed:
    """All entry points, from the cache directory if nothing was installed or removed since."""
    with suppress(OSError, msgspec.MsgspecError):
        return msgspec.json.decode(_cache_file("installed").read_bytes(), type=_Installed)
    found = _Installed({group: {} for group in Group}, [])
    for package, group, name, reference in _declared():
        match = _REFERENCE.fullmatch(reference)
        shown = f"{group} {name} of {package}"
        if match is None:
            found.problems.append(f"{shown}: {reference!r} is not like 'module:name [read]'")
        elif name in found.extensions[group]:
            other = found.extensions[group][name].package
            found.problems.append(f"{shown}: {other} has declared one of this name, which is used instead")
        else:
            access = match["access"]
            if access is not None and access not in set(Access):
                found.problems.append(f"{shown}: {access!r} is no access class; there is {', '.join(Access)}")
                access = None
            found.extensions[group][name] = Extension(
                group, name, match["module"], match["name"], package, None if access is None else Access(access)
            )
    for group, unsorted in found.extensions.items():
        found.extensions[group] = dict(sorted(unsorted.items(), key=lambda each: (each[1].package != _OWN, each[0])))
    for problem in found.problems:
        _log.warning("%s", problem)
    with suppress(OSError):
        path = _cache_file("installed")
        atomic_write(path, msgspec.json.encode(found))
        delete_least_recently_used(path, max_bytes=_CACHE_BYTES)
    return found


def _declared() -> Iterator[tuple[str, Group, str, str]]:
    """Yields the package, the group, the name and the reference of each entry point, those of Mindstage first."""
    from importlib.metadata import entry_points

    in_checkout = _is_checkout()
    if in_checkout:
        from tomllib import loads

        declared = loads(_CHECKOUT.read_text(encoding="utf-8"))["project"]["entry-points"]
        yield from ((_OWN, group, *each) for group in Group for each in declared.get(group, {}).items())
    found = entry_points()
    listed = [
        (each.dist.name if each.dist else "", group, each.name, each.value)
        for group in Group
        for each in found.select(group=group)
    ]
    for package, group, name, reference in sorted(listed, key=lambda each: (each[0] != _OWN, each[0])):
        if not (in_checkout and package == _OWN):
            yield package, group, name, reference


def _is_checkout() -> bool:
    """Whether this module is in the source tree of Mindstage, with or without its being installed from there."""
    try:
        is_ours = f'\nname = "{_OWN}"\n' in _CHECKOUT.read_text(encoding="utf-8")
        return is_ours and _CHECKOUT.parent / "src" == Path(__file__).parents[1]
    except OSError:
        return False


@cache
def _environment() -> str:
    """A digest of the installed distributions: their folders, which contain the versions, and their entry points."""
    state = [sys.version, str(_CHECKOUT), repr(_file_state(str(_CHECKOUT)))]
    for folder in dict.fromkeys(sys.path):
        with suppress(OSError), os.scandir(folder or ".") as entries:
            paths = sorted(each.path for each in entries if each.name.endswith((".dist-info", ".egg-info")))
            state += (f"{path} {_file_state(f'{path}/entry_points.txt')}" for path in paths)
    return blake2b("\n".join(state).encode(errors="surrogateescape"), digest_size=16).hexdigest()


def _cache_file(name: str) -> Path:
    return cache_dir("registry") / f"{name}-{_environment()}.json"
