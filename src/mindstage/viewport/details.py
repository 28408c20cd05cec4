"""Details: what the page says about the world and about one body, as small pieces of HTML."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from mindstage.stage import Frame, Lit
from mindstage.viewport.palette import local_name
from mindstage.world import Body, BodyId, Iri, Vector
from mindstage.world.colours import colour_text, hex_text
from mindstage.world.geometry import Array, rotation_matrix, unit

__all__ = ["body_html", "fault_html", "hint_html", "legend_html", "status_html"]

_ANCESTORS = 5
"""So many are named; what comes after them says little."""
_NAMED = 3
"""A group of so many lit bodies is named one by one, a larger one by its classes."""
_COUNTED = 5
"""So many classes of a larger group are named."""
_SMALL = "font-size:0.82em;line-height:1.5;"
_BLOCK = f"{_SMALL}padding:0.35em 0.9em;"
_FAINT = "opacity:0.6;"
_RED = "color:#c92a2a;font-weight:600;"


def status_html(frame: Frame, *, engine: str) -> str:
    """The line about the world as a whole."""
    state = f"playing at {frame.real_time_factor:.2f} x real time" if frame.playing else "paused"
    parts = (f"{frame.time_s:.1f} s", state, f"{len(frame.ids)} bodies", escape(engine))
    line = f'<div style="{_BLOCK}">{" · ".join(parts)}</div>'
    return line + (fault_html(frame.fault) if frame.fault else "")


def fault_html(text: str) -> str:
    """Something that went wrong."""
    return f'<div style="{_BLOCK}{_RED}" role="alert">{escape(text)}</div>' if text else ""


def legend_html(groups: Sequence[Lit], bodies: Mapping[BodyId, Body]) -> str:
    """What is lit and why, the latest first.

    Args:
        groups: bodies that are lit together, the latest last.
        bodies: what is known of them.
    """
    return "".join(_lit_html(group, bodies) for group in reversed(groups))


def _lit_html(group: Lit, bodies: Mapping[BodyId, Body]) -> str:
    swatch = (
        f'<span role="img" aria-label="{colour_text(group.colour)}" style="display:inline-block;width:0.8em;'
        f'height:0.8em;border-radius:0.2em;margin-right:0.5em;background:{hex_text(group.colour)}"></span>'
    )
    names = f'<div style="{_FAINT}overflow-wrap:anywhere">{escape(_names(group.ids, bodies))}</div>'
    title = f'<span style="font-weight:600;overflow-wrap:anywhere">{escape(group.label or "lit")}</span>'
    return f'<div data-lit="{len(group.ids)}" style="{_BLOCK}">{swatch}{title}{names}</div>'


def _names(ids: Sequence[BodyId], bodies: Mapping[BodyId, Body]) -> str:
    kinds = {id: bodies[id].label or local_name(bodies[id].cls) for id in ids if id in bodies}
    if len(ids) <= _NAMED:
        return ", ".join(f"{kinds[id]} {id}" if id in kinds else id for id in ids)
    counts = Counter(kinds.values()).most_common()
    named = ", ".join(f"{count} {kind}" for kind, count in counts[:_COUNTED])
    return f"{named} … {len(ids)} in all" if len(counts) > _COUNTED else named


def hint_html(text: str) -> str:
    """Something that helps."""
    return f'<div style="{_BLOCK}{_FAINT}">{escape(text)}</div>'


def body_html(body: Body, *, ancestors: Sequence[Iri], pose: Array, hangs_on: BodyId | None = None) -> str:
    """A body by name, and what there is to know about it.

    Args:
        body: as it is described.
        ancestors: of its class, nearest first.
        pose: where it is now, seven numbers.
        hangs_on: what it is attached to.
    """
    above = ", ".join(local_name(cls) for cls in ancestors[:_ANCESTORS])
    physics = body.physics
    x, y, z = pose[:3]
    rows = {
        "id": body.id,
        "is a": f"{above} …" if len(ancestors) > _ANCESTORS else above,
        "size": _metres(body.size) if body.size else "not told",
        "mass": f"{physics.mass_kg:g} kg" if physics.mass_kg else "not told",
        "mobility": physics.mobility.value if physics.mobility else "not told",
        "position": f"{x:.3f}, {y:.3f}, {z:.3f} m",
        "turned": _turned(pose),
        "hangs on": hangs_on or "",
    }
    cells = "".join(
        f'<tr><td style="{_FAINT}padding-right:0.8em;white-space:nowrap;vertical-align:top">{name}</td>'
        f'<td style="overflow-wrap:anywhere">{escape(text)}</td></tr>'
        for name, text in rows.items()
        if text
    )
    title = f'<div style="font-size:1.15em;font-weight:600">{escape(body.label or local_name(body.cls))}</div>'
    table = f'<table style="border-spacing:0">{cells}</table>'
    return f'<div data-body="{escape(body.id)}" style="{_BLOCK}">{title}{table}</div>'


def _metres(size: Vector) -> str:
    return " x ".join(f"{extent:.3g}" for extent in size) + " m"


def _turned(pose: Array) -> str:
    """Roll, pitch and yaw (fixed axes x, y, z) as people say them."""
    turn = rotation_matrix(unit(pose[3:]))
    roll, yaw = np.arctan2(turn[2, 1], turn[2, 2]), np.arctan2(turn[1, 0], turn[0, 0])
    pitch = np.arcsin(np.clip(-turn[2, 0], -1.0, 1.0))
    degrees = [round(float(np.degrees(angle)), 1) + 0.0 for angle in (roll, pitch, yaw)]
    return "roll {:g}°, pitch {:g}°, yaw {:g}°".format(*degrees)
