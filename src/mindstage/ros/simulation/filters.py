r"""Entity filters of simulation_interfaces: by name, category, tags and bounds; all conditions must hold.

Names are matched by RE2, in time linear in the name whatever the pattern is, with its POSIX syntax: `.`,
`[a-z[:digit:]]`, `^`, `$`, `*`, `+`, `?`, `{2,5}`, `|`, groups, and `\` before a literal. It differs from POSIX
extended expressions as RE2 documents: a backslash escapes inside brackets too, an interval that is not one (`a{x`) is
literal, intervals go up to 1000, and the classes are those of ASCII.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import re2
from numpy.typing import NDArray

from mindstage.bridge.description import vector_from_message
from mindstage.knowledge.names import local_name
from mindstage.msgs import simulation_interfaces
from mindstage.ros.results import failed, unsupported
from mindstage.ros.sight import StateReader
from mindstage.world import Body, BodyId, Mobility
from mindstage.world.boxes import OrientedBoxes
from mindstage.world.geometry import Array, normalize

__all__ = ["category_of", "filter_entities", "has_tags", "name_matcher", "tags_of"]

_MAX_PATTERN = 4096
"""Characters of a pattern."""
_MAX_PROGRAM = 1 << 20
"""Bytes of a compiled pattern and of its automaton."""
_COLLATING = re.compile(r"\[[^\]]*\[[.=]")
"""Collating symbols and equivalence classes, which RE2 reads as plain characters."""


def filter_entities(state_reader: StateReader, filters: simulation_interfaces.EntityFilters) -> tuple[BodyId, ...]:
    """The entities that pass, in the order of the frame.

    Raises:
        ResultError: the name's pattern is none, or the bounds are of a kind that cannot be compared.
    """
    ids: tuple[BodyId, ...] = state_reader.state().ids
    if filters.filter:
        matches = name_matcher(filters.filter)
        ids = tuple(id for id in ids if matches(id))
    categories = {each.category for each in filters.categories}
    if categories or filters.tags.tags:
        bodies = {body.id: body for body in state_reader.world().bodies}
        ids = tuple(id for id in ids if id in bodies and not (categories and category_of(bodies[id]) not in categories))
        ids = tuple(id for id in ids if has_tags(tags_of(bodies[id]), filters.tags))
    return (
        _overlapping_bounds(state_reader, ids, filters.bounds)
        if filters.bounds.type is not simulation_interfaces.BoundsType.TYPE_EMPTY
        else ids
    )


def name_matcher(pattern: str) -> Callable[[str], bool]:
    """Compiles a POSIX extended regular expression; the result returns whether it is found anywhere in a text.

    Raises:
        ResultError: it is not such an expression, or it is too large.
    """
    options = re2.Options()
    options.posix_syntax = options.one_line = options.dot_nl = options.never_capture = True
    options.log_errors = False
    options.max_mem = _MAX_PROGRAM
    try:
        if len(pattern) > _MAX_PATTERN:
            raise re2.error(f"longer than {_MAX_PATTERN} characters")
        if _COLLATING.search(pattern):
            raise re2.error("collating symbols are not supported")
        compiled = re2.compile(pattern, options)
    except (re2.error, UnicodeEncodeError) as error:
        cause = error.args[0].decode(errors="replace") if isinstance(error.args[0], bytes) else str(error)
        raise failed(f"{pattern[:100]!r} is not an extended regular expression: {cause[:200]}") from error
    return lambda text: compiled.search(text) is not None


def category_of(body: Body) -> simulation_interfaces.Category:
    """What kind of thing a body is: whether it moves by itself is all that is known for sure."""
    match body.physics.mobility:
        case Mobility.DYNAMIC:
            return simulation_interfaces.Category.CATEGORY_DYNAMIC_OBJECT
        case Mobility.KINEMATIC:
            return simulation_interfaces.Category.CATEGORY_OBJECT
    return simulation_interfaces.Category.CATEGORY_STATIC_OBJECT


def tags_of(body: Body) -> tuple[str, ...]:
    """A body's class in short, and its tags as `type/key=value`."""
    return (local_name(body.cls), *(f"{tag.type}/{tag.key}={tag.value}" for tag in body.tags))


def has_tags(tags: tuple[str, ...], wanted: simulation_interfaces.TagsFilter) -> bool:
    """Whether tags are what a filter wants; without any, everything is."""
    if not wanted.tags:
        return True
    found = [tag in tags for tag in wanted.tags]
    return all(found) if wanted.filter_mode is simulation_interfaces.FilterMode.FILTER_MODE_ALL else any(found)


def _overlapping_bounds(
    state_reader: StateReader, ids: tuple[BodyId, ...], bounds: simulation_interfaces.Bounds
) -> tuple[BodyId, ...]:
    """Those whose upright box meets the bounds."""
    if not ids:
        return ids
    frame = state_reader.state()
    rows = state_reader.row_by_id(frame)
    bodies = {body.id: body for body in state_reader.world().bodies}
    ids = tuple(id for id in ids if id in bodies and id in rows)
    poses = frame.poses[[rows[id] for id in ids]].reshape(-1, 7).copy()
    poses[:, 3:] = normalize(poses[:, 3:])
    sizes = np.array([bodies[id].size or (0.0, 0.0, 0.0) for id in ids], dtype=np.float64).reshape(-1, 3)
    low, high = OrientedBoxes.from_poses(poses, sizes).bounds()
    meets = _bounds_overlap(bounds, low, high)
    return tuple(id for id, kept in zip(ids, meets, strict=True) if kept)


def _bounds_overlap(bounds: simulation_interfaces.Bounds, low: Array, high: Array) -> NDArray[np.bool_]:
    points = np.array([vector_from_message(point) for point in bounds.points], dtype=np.float64).reshape(-1, 3)
    match bounds.type:
        case simulation_interfaces.BoundsType.TYPE_BOX | simulation_interfaces.BoundsType.TYPE_SPHERE if (
            len(points) != 2
        ):
            raise failed(f"a {bounds.type.name} has two points, not {len(points)}")
        case simulation_interfaces.BoundsType.TYPE_BOX:
            inside = np.all((low <= points.max(axis=0)) & (high >= points.min(axis=0)), axis=1)
        case simulation_interfaces.BoundsType.TYPE_SPHERE:
            nearest = np.clip(points[0], low, high)
            inside = np.linalg.norm(nearest - points[0], axis=1) <= points[1, 0]
        case _:
            raise unsupported("entities can be chosen by a box or a sphere, not by a convex hull")
    return np.asarray(inside)
