"""What the readers of Mindstage make of homes in each dialect, compared with the truth: kinds of misreadings, counted.

`python -m tests.homes.readings [SEED …]` prints the table of docs/how-to/homes.md.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mindstage.homes import HomeDialect, WrittenHome, generate_home, write_home
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import AxisMotion, Iri, Joint, World
from mindstage.scene.joint_kinematics import axis_ranges, handles_by_body, moving_body, outward_joints

__all__ = ["KINDS", "misreadings", "read_world", "rotation"]

KINDS = (
    *("bodies", "body missing", "center off by 1 cm", "of these without a finding", "box off by 1 cm"),
    *("mobility", "mass", "handle not on its front"),
    *(
        "joints",
        "joint missing",
        "kind of joint",
        "ends exchanged",
        "axis",
        "hinge off by 1 cm",
        "range",
        "opens inwards",
    ),
)
NOT_STATED = {
    HomeDialect.SEMLOG_2018: {"mobility", "mass"},
    HomeDialect.KNOWROB1: {"mobility", "mass"},
    HomeDialect.SOMA: {"mobility", "mass"},
    HomeDialect.SOMA_URDF: {"mobility"},
}
"""What a dialect does not state, so that a reader cannot misread it."""
_TOLERANCE_M = 0.01
_OUTWARDS = 0.05
"""Part of the travel by which a closed front may open inwards, and by which its range may differ."""


def read_world(home: WrittenHome, folder: Path) -> tuple[World, set[str]]:
    """The world of a written home, and what there are findings about."""
    path = folder / "home.owl"
    path.write_text(home.text, encoding="utf-8")
    knowledge = KnowledgeBase()
    description = folder / "home.urdf"
    description.write_text(home.urdf, encoding="utf-8")
    knowledge.load(path, urdf=description if home.urdf else ())
    return knowledge.world(), {each.individual for each in knowledge.findings()}


def misreadings(world: World, truth: dict[str, Any], doubted: set[str]) -> Counter[str]:
    """The numbers of bodies and joints of a home, and of those that are read wrongly, by kind.

    Args:
        world: the world as read.
        truth: the truth file.
        doubted: the individuals and classes with findings.
    """
    bodies = {body.iri.rpartition("#")[2]: body for body in world.bodies}
    found = Counter({"bodies": len(truth["bodies"]), "joints": len(truth["joints"])})
    parents = {each.child: each.parent for each in world.attachments}
    for name, true in truth["bodies"].items():
        body = bodies.get(name)
        if body is None or body.size is None:
            found["body missing"] += 1
            continue
        bounds = np.abs(rotation(body.pose.quaternion)) @ body.size
        true_bounds = np.abs(rotation(true["quaternion"])) @ true["size"]
        is_off = bool(np.abs(np.subtract(body.pose.position, true["center"])).max() > _TOLERANCE_M)
        found["center off by 1 cm"] += is_off
        found["of these without a finding"] += is_off and doubted.isdisjoint((body.iri, body.cls))
        found["box off by 1 cm"] += bool(np.abs(bounds - true_bounds).max() > _TOLERANCE_M)
        found["mobility"] += body.physics.mobility != true["mobility"]
        found["mass"] += abs((body.physics.mass_kg or 0.0) - (true["mass"] or 0.0)) > 1e-5
        if true["attached_to"] and bodies.get(true["attached_to"]) is not None:
            found["handle not on its front"] += parents.get(body.id) != bodies[true["attached_to"]].id
    _compare_joints(world, truth, found)
    return found


def _compare_joints(world: World, truth: dict[str, Any], found: Counter[str]) -> None:
    by_id = {body.id: body for body in world.bodies}
    outward = outward_joints(
        world.joints, by_id, handles_by_body(by_id, {e.child: e.parent for e in world.attachments})
    )
    joints = {frozenset((by_id[each.parent].iri, by_id[each.child].iri)): each for each in world.joints}
    namespace = world.bodies[0].iri.rpartition("#")[0]
    for true in truth["joints"].values():
        joint = joints.get(frozenset(Iri(f"{namespace}#{true[end]}") for end in ("base", "moving")))
        if joint is None:
            found["joint missing"] += 1
            continue
        joint = outward[joint.id].joint if joint.id in outward else joint
        moving, _ = moving_body(joint, by_id[joint.parent], by_id[joint.child])
        exchanged = not moving.iri.endswith(f"#{true['moving']}")
        found["ends exchanged"] += exchanged
        _compare_motion(joint, true, found, reverse=joint.child != moving.id)


def _compare_motion(joint: Joint, true: dict[str, Any], found: Counter[str], *, reverse: bool) -> None:
    free = [(number, each) for number, each in enumerate(axis_ranges(joint)) if each.motion is not AxisMotion.LOCKED]
    if len(free) != 1 or (free[0][0] < 3) != (true["kind"] == "slide"):
        found["kind of joint"] += 1
        return
    number, span = free[0]
    axis = rotation(joint.pose.quaternion)[:, number % 3] * (-1 if reverse else 1)
    along = float(axis @ true["axis"])
    if abs(along) < 0.99:
        found["axis"] += 1
        return
    offset = np.subtract(joint.pose.position, true["origin"])
    if (
        true["kind"] == "hinge"
        and np.linalg.norm(offset - (offset @ true["axis"]) * np.array(true["axis"])) > _TOLERANCE_M
    ):
        found["hinge off by 1 cm"] += 1
    if span.motion is AxisMotion.FREE:
        found["range"] += 1
        return
    ends = sorted(np.sign(along) * (span.middle + side * span.limit) for side in (-1, 1))
    found["range"] += bool(abs(ends[1] / true["travel"] - 1) > _OUTWARDS)
    found["opens inwards"] += bool(ends[0] < -_OUTWARDS * true["travel"])


def rotation(quaternion: Any) -> np.ndarray:
    """The matrix of a quaternion w x y z."""
    return np.asarray(Rotation.from_quat(quaternion, scalar_first=True).as_matrix())


def _main(seeds: list[int]) -> None:
    table: dict[str, Counter[str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for dialect in HomeDialect:
            total: Counter[str] = Counter()
            for seed in seeds:
                home = write_home(generate_home(seed=seed, clutter=0.3), dialect=dialect)
                world, doubted = read_world(home, Path(folder))
                total.update(misreadings(world, json.loads(home.truth), doubted))
            table[dialect] = total
    cells = {kind: [_cell(dialect, kind, total) for dialect, total in table.items()] for kind in KINDS}
    print("| kind |", " | ".join(table), "|")
    print("|---" * (len(table) + 1), "|", sep="")
    for kind in KINDS:
        print(f"| {kind} |", " | ".join(cells[kind]), "|")


def _cell(dialect: str, kind: str, total: Counter[str]) -> str:
    return "-" if kind in NOT_STATED.get(HomeDialect(dialect), ()) else str(total[kind])


if __name__ == "__main__":
    _main([int(seed) for seed in sys.argv[1:]] or [1, 2, 3])
