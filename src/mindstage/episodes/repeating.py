"""Makes the edits of a recording again, in another simulation."""

from __future__ import annotations

from mindstage.episodes.recording import Recording
from mindstage.robots import edits as robot_edits
from mindstage.simulation.imagined import make_edit
from mindstage.simulation.simulation import Simulation

__all__ = ["repeat_edits"]

KNOWN_EDITS = (robot_edits.AddRobot, robot_edits.RemoveRobot)
"""The edits that can be read, beside those of scenes and engines, which every simulation imports."""


def repeat_edits(recording: Recording, simulation: Simulation) -> tuple[str, ...]:
    """Makes the edits of a recording again, each after as much simulated time as in the recording.

    Questions, commands of robots and states that were restored are no edits; they are left out.

    Args:
        recording: the recording.
        simulation: a simulation in the state in which the recording began.

    Returns:
        The edits that were made, in words.

    Raises:
        InvalidArgumentError: an edit is not known here, or its geometry is missing.
        WorldError: the world does not allow an edit; those before it were made.
    """
    done, time_s, geometry = list[str](), recording.begin_s, tuple(recording.geometry.values())
    for each in recording.edits():
        edits = each.edits(geometry)
        if not edits and each.kind not in {"reset", "clear"}:
            continue
        if each.time_s > time_s:
            simulation.step(each.time_s - time_s)
            time_s = each.time_s
        if each.kind == "reset":
            simulation.reset()
        elif each.kind == "clear":
            simulation.clear()
        for edit in edits:
            make_edit(simulation, edit)
        done += [edit.label for edit in edits] or [each.kind]
    return tuple(done)
