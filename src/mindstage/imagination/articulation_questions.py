"""Questions that imagine doors, drawers and vessels: how far a part opens, with what force, and when liquid spills."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from math import radians

import msgspec
import numpy as np

from mindstage.engines.base import Capability, Engine
from mindstage.imagination.plans import Open, Plan, Wait
from mindstage.imagination.results import EventKind, SampleResult
from mindstage.imagination.trials import (
    DEFAULT_SAMPLES,
    Heading,
    ImaginedScene,
    OpenShare,
    PullForce,
    SampleCount,
    Tilt,
    Trial,
    Trials,
    body_pose,
    imagined_scenes,
    is_probable,
    parse_uncertainty,
    remember,
    run_trials,
    why_not,
)
from mindstage.knowledge.queries.proximity import missing_about, missing_arguments
from mindstage.knowledge.queries.spatial import body_claims
from mindstage.knowledge.questions import (
    AnswerRow,
    AskedArguments,
    IndividualName,
    MapName,
    MissingKnowledge,
    QuestionContext,
    StateAccess,
    question,
)
from mindstage.ranges import Fraction, Seed
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import CHILD, THING
from mindstage.scene import Body, BodyId, Iri, Joint, Vector
from mindstage.scene.joint_kinematics import is_robot_part
from mindstage.scene.proximity import BodyBoxes
from mindstage.scene.ray_casting import Depressions, ShapeScene, find_depressions
from mindstage.scene.transforms import (
    Array,
    normalized_pose_array,
    pose_inverse,
    quat_rotate,
)
from mindstage.simulation import Simulation
from mindstage.simulation.interaction import SpringPerturbation
from mindstage.simulation.joint_motion import SimulationJoint

__all__ = ["OpenableRow", "PullRow", "SpillRow", "can_open", "reachable_by_pull", "would_spill"]

_OPEN_SHARE = 0.95
"""A part is open if it is at least so far open."""
_SHUT_SHARE = 0.02
"""A part is shut if it is less far open."""
_PROBE_S = 0.05
_PULL_STEP_S = 0.04
_PULL_LIMIT_S = 4.0
_FORCE_ACCURACY = 1.1
"""The ratio of the smallest force that opens a part to the largest that does not."""
_MIN_FORCE_N = 0.5
_HEADINGS = 8
_TILTS_DEG = tuple(range(0, 95, 5))


# -- articulated parts -----------------------------------------------------------------------------------------------


def _group(copy: Simulation, id: BodyId) -> frozenset[BodyId]:
    """A body and what is attached to it."""
    children: dict[BodyId, list[BodyId]] = {}
    for each in copy.snapshot().attachments:
        children.setdefault(each.parent, []).append(each.child)
    found, open_ids = set[BodyId](), [id]
    while open_ids:
        at = open_ids.pop()
        if at not in found:
            found.add(at)
            open_ids += children.get(at, ())
    return frozenset(found)


def _direction(joint: SimulationJoint, point: Array, target: float) -> tuple[Array, Array]:
    """A point of the part in the world [m], and the unit vector in which it moves towards a position."""
    now = joint.position
    step = math.copysign(1e-3, target - now)
    here, there = normalized_pose_array(joint.pose_at(now)), normalized_pose_array(joint.pose_at(now + step))
    start = here[:3] + quat_rotate(here[3:], point)
    moved = there[:3] + quat_rotate(there[3:], point) - start
    return start, moved / max(float(np.linalg.norm(moved)), 1e-12)


def _farthest_point(copy: Simulation, joint: SimulationJoint, target: float) -> Array:
    """The point of a part, in its frame, that moves most: the center of a side of its box [m]."""
    body = copy.snapshot().body(joint.body)
    half = np.asarray(body.size or (0.0, 0.0, 0.0)) / 2
    candidates = [sign * half * axis for axis in np.eye(3) for sign in (-1.0, 1.0)]
    now, then = (normalized_pose_array(joint.pose_at(at)) for at in (joint.position, target))

    def way(point: Array) -> float:
        start, end = (pose[:3] + quat_rotate(pose[3:], point) for pose in (now, then))
        return float(np.linalg.norm(end - start))

    return max(candidates, key=way)


def _obstacles(copy: Simulation, joint: SimulationJoint, target: float, force_n: float) -> tuple[BodyId | None, ...]:
    """What a part is pressed against if it is pushed on towards a position; None is the ground. Strongest first."""
    if Capability.CONTACTS not in copy.engine.capabilities:
        return ()
    point, group = _farthest_point(copy, joint, target), _group(copy, joint.body)
    start, direction = _direction(joint, point, target)
    force, at = tuple((force_n * direction).tolist()), tuple(start.tolist())
    for _ in range(round(_PROBE_S / 0.01)):
        copy.engine.run(partial(_apply_force, joint.body, force, at), label="push")
        copy.step(0.01)
    pressed: dict[BodyId | None, float] = {}
    for contact in copy.engine.run(lambda engine: engine.contacts(), label="contacts"):
        if (contact.a in group) is not (contact.b in group):
            sign = 1.0 if contact.a in group else -1.0
            other = contact.b if contact.a in group else contact.a
            along = sign * float(np.dot(contact.normal, _velocity(joint, np.asarray(contact.position), target)))
            if along > 0.1 and contact.force_n > 0.0:
                pressed[other] = pressed.get(other, 0.0) + along * contact.force_n
    return tuple(sorted(pressed, key=lambda each: -pressed[each]))


def _apply_force(id: BodyId, force: Vector, at: Vector, engine: Engine) -> None:
    engine.apply_force(id, force, at)


def _velocity(joint: SimulationJoint, position: Array, target: float) -> Array:
    """The unit vector in which the point of the part at a position of the world moves [m]."""
    pose = normalized_pose_array(joint.pose_at(joint.position))
    return _direction(joint, quat_rotate(pose_inverse(pose)[3:], position - pose[:3]), target)[1]


def _name(scene: ImaginedScene, id: BodyId | None) -> str:
    return "the ground" if id is None else local_name(scene.iri(id))


class OpenableRow(AnswerRow, frozen=True, kw_only=True):
    """A door, drawer or lid that can be opened."""

    thing: IndividualName
    """What was asked about."""
    part: IndividualName
    """What moves."""
    share: float
    """How far it opens, from 0 to 1 of its range, in the typical sample."""
    way: float
    """The position of the joint then, in `unit`."""
    unit: str
    """m or rad."""
    obstacles: tuple[IndividualName, ...]
    """What is in the way then, what is pressed most first; empty if it opens as far as was asked, or if only its own
    friction stops it.
    """
    probability: float
    """The share of the samples in which it opens as far as was asked."""
    interval: tuple[float, float]
    tried: int
    why: str
    map: MapName
    source: str


@question(
    sentences=(
        "can {thing} be opened",
        "can (i|robot) open {thing}",
        "how far (can|does|would) {thing} open",
        "how far can (i|robot) open {thing}",
        "what (is in the way of|blocks) {thing}",
    ),
    imagines=True,
)
def can_open(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    to_share: OpenShare | None = None,
    uncertainty: str | None = None,
    samples: SampleCount | None = None,
    seed: Seed | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[OpenableRow]:
    """How far a door, drawer or lid opens until something is in the way, and what that is.

    `thing` is what moves, its handle, its joint, or a piece of furniture with doors or drawers. It is pulled with the
    force of an arm (150 N at most), to its limit or to a share of its range. What does not open at all is no answer.
    For `uncertainty`, which is that of the part, see `stays`; "joint_friction=0.3" varies the friction of its joint.

    Examples:
        can_open fridge
    """
    if thing is None:
        return
    fraction = 1.0 if to_share is None else to_share
    for scene in imagined_scenes(kb, present, map, thing):
        for joint in scene.joints_of_part(thing):
            moving = scene.moving_body(joint)
            plan = Plan(steps=(Open(thing=joint.id, fraction=fraction),), forbid=())
            plan = msgspec.structs.replace(plan, uncertainty=parse_uncertainty(moving, uncertainty))
            judge = partial(_judge_opening, scene=scene, joint=joint, fraction=fraction)
            trials = run_trials(scene, plan, judge, samples=samples, seed=seed)[moving]
            facts = trials.typical.facts
            if facts["share"] >= _SHUT_SHARE:
                yield OpenableRow(
                    thing=thing,
                    part=scene.iri(moving),
                    share=round(facts["share"], 4),
                    way=round(facts["way"], 4),
                    unit=facts["unit"],
                    obstacles=tuple(scene.iri(each) for each in facts["obstacles"] if each is not None),
                    probability=trials.probability or 0.0,
                    interval=trials.interval,
                    tried=trials.tried,
                    why=trials.why,
                    map=scene.map_of(moving),
                    source=scene.source,
                )
            else:
                remember(present, thing, trials)


def _judge_opening(
    copy: Simulation, result: SampleResult, *, scene: ImaginedScene, joint: Joint, fraction: float
) -> dict[BodyId, Trial]:
    moved = scene.moving_body(joint)
    refused = next((event for event in result.events if event.kind is EventKind.REFUSED), None)
    if refused is not None:
        facts: Mapping[str, object] = {"share": 0.0, "way": 0.0, "unit": "", "obstacles": ()}
        return {moved: Trial(holds=False, why=refused.text, facts=facts)}
    handle = copy.joint(joint.id)
    share, way = handle.openness, handle.position
    arrived = share >= fraction - 0.02
    obstacles = () if arrived else _obstacles(copy, handle, handle.open_position, _arm_force_n() / 3)
    unit = "m" if handle.is_prismatic else "rad"
    why = f"it opens to {share:.0%} of its range ({way:.3g} {unit})"
    if obstacles:
        why += f": {', '.join(_name(scene, each) for each in obstacles[:3])} is in the way"
    elif not arrived:
        why += ": nothing touches it, its own friction or weight stops it"
    facts = {"share": share, "way": way, "unit": unit, "obstacles": obstacles}
    return {moved: Trial(holds=arrived, why=why, facts=facts)}


def _arm_force_n() -> float:
    """The largest force with which things are pulled [N]."""
    return SpringPerturbation(id=BodyId(""), point=(0.0, 0.0, 0.0), target=(0.0, 0.0, 0.0)).max_force


@can_open.explain
def _explain_openable(kb: QuestionContext, row: OpenableRow) -> Iterator[str]:
    yield f"{local_name(row.part)}: {row.why}"
    yield f"tried in {row.source}"


@can_open.missing
def _missing_openable(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    if asked.thing is None:
        yield missing_arguments("give thing: all doors and drawers are not pulled; articulated_parts lists them")
        return
    yield from _missing_parts(kb, asked.present, asked.thing, asked.map)


def _missing_parts(
    kb: QuestionContext, present: StateAccess, thing: Iri, map: Iri | None
) -> Iterator[MissingKnowledge]:
    scenes = list(imagined_scenes(kb, present, map, thing))
    if scenes and not any(scene.joints_of_part(thing) for scene in scenes):
        with kb.lock:
            cls = kb.reasoner.class_of(thing) or THING
        claims = body_claims((thing,), present.states(map), map)
        why = f"no joint moves {local_name(thing)}, or a part of it"
        if any(is_robot_part(scene.bodies[thing]) for scene in scenes if thing in scene.bodies):
            why = f"{local_name(thing)} is a part of a robot, whose joints move no door or drawer"
        yield MissingKnowledge(cls, CHILD, why, claims=claims)
        return
    known = thing if not any(thing in scene.joints for scene in scenes) else None
    yield from why_not(kb, present, (known,), map, "does not open")


# -- pulls -----------------------------------------------------------------------------------------------------------


class PullRow(AnswerRow, frozen=True, kw_only=True):
    """A door or drawer that a pull at its handle opens."""

    handle: IndividualName
    part: IndividualName
    """What it opens."""
    share: float
    """How far it opens, from 0 to 1 of its range."""
    force_n: float
    """The smallest force at the handle that opens it so far, at most 10 % too large [N]."""
    probability: float
    interval: tuple[float, float]
    tried: int
    why: str
    map: MapName
    source: str


@question(
    sentences=(
        "can {handle} be reached by (pull|pulling)",
        "does (a pull at|pulling) {handle} open (something|it)",
        "what does (a pull at|pulling) {handle} open",
        "how hard (do i|must i|must robot) pull {handle}",
        "(what|which) force (opens|is needed to pull) {handle}",
    ),
    imagines=True,
)
def reachable_by_pull(
    kb: QuestionContext,
    handle: IndividualName | None = None,
    max_force_n: PullForce | None = None,
    uncertainty: str | None = None,
    samples: SampleCount | None = None,
    seed: Seed | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[PullRow]:
    """Whether a pull at a handle opens its door or drawer, how far, and with what force.

    A constant force acts at the center of the handle, always along its path, for up to 4 s. Of the forces up to
    `max_force_n` (150 N if it is left out, that of an arm) the smallest is searched that opens the part by 95 % of its
    range, or as far as the largest does. For `uncertainty`, which is that of the part, see `stays`.

    Examples:
        reachable_by_pull drawer_left_1_handle max_force_n=20
    """
    if handle is None:
        return
    limit_n = _arm_force_n() if max_force_n is None else max_force_n
    for scene in imagined_scenes(kb, present, map, handle):
        for joint in scene.joints_of_part(handle) if handle in scene.bodies else ():
            moving = scene.moving_body(joint)
            plan = Plan(steps=(Wait(duration_s=0.01),), forbid=(), uncertainty=parse_uncertainty(moving, uncertainty))
            judge = partial(_judge_pull, scene=scene, joint=joint, handle=scene.bodies[handle], limit_n=limit_n)
            trials = run_trials(scene, plan, judge, samples=samples, seed=seed)[moving]
            if is_probable(trials, None):
                yield PullRow(
                    handle=handle,
                    part=scene.iri(moving),
                    share=round(trials.typical.facts["share"], 4),
                    force_n=round(trials.typical.facts["force_n"], 2),
                    probability=trials.probability or 0.0,
                    interval=trials.interval,
                    tried=trials.tried,
                    why=trials.why,
                    map=scene.map_of(moving),
                    source=scene.source,
                )
            else:
                remember(present, handle, trials)


def _judge_pull(
    copy: Simulation, result: SampleResult, *, scene: ImaginedScene, joint: Joint, handle: Body, limit_n: float
) -> dict[BodyId, Trial]:
    """Pulls in further copies of this one, since each force begins with the same state."""
    moved = scene.moving_body(joint)

    def share_with(force_n: float) -> tuple[float, tuple[BodyId | None, ...]]:
        with copy.fork(threaded=False) as pulled:
            return _pull_constantly(pulled, joint, handle, force_n)

    share, obstacles = share_with(limit_n)
    way = ", ".join(_name(scene, each) for each in obstacles[:3])
    if share < _SHUT_SHARE:
        why = f"{limit_n:g} N open {local_name(scene.iri(moved))} by {share:.0%} only" + (
            f", {way} is in the way" if way else ""
        )
        return {moved: Trial(holds=False, why=why, facts={"share": share, "force_n": limit_n})}
    wanted = min(_OPEN_SHARE, share * _OPEN_SHARE)
    low, high = _MIN_FORCE_N, limit_n
    if share_with(low)[0] >= wanted:
        high = low
    while high / low > _FORCE_ACCURACY:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if share_with(middle)[0] >= wanted else (middle, high)
    what = local_name(scene.iri(moved))
    why = f"{high:.2g} N at {local_name(scene.iri(handle.id))} open {what} by {share:.0%}" + (
        f", then {way} is in the way" if way else ""
    )
    return {moved: Trial(holds=True, why=why, facts={"share": share, "force_n": high})}


def _pull_constantly(
    copy: Simulation, joint: Joint, handle: Body, force_n: float
) -> tuple[float, tuple[BodyId | None, ...]]:
    """How far a part is open after a constant force at its handle, and what is in the way if it is not open."""
    part = copy.joint(joint.id)
    target, best, still = part.open_position, 0.0, 0
    pose = normalized_pose_array(part.pose_at(part.position))
    point = quat_rotate(pose_inverse(pose)[3:], body_pose(copy, handle.id)[:3] - pose[:3])
    for _ in range(round(_PULL_LIMIT_S / _PULL_STEP_S)):
        before = part.position
        start, direction = _direction(part, point, target)
        force, at = tuple((force_n * direction).tolist()), tuple(start.tolist())
        copy.engine.run(partial(_apply_force, part.body, force, at), label="pull")
        copy.step(_PULL_STEP_S)
        best = max(best, part.openness)
        still = still + 1 if abs(part.position - before) < 1e-5 else 0
        if best >= _OPEN_SHARE or still >= 10:
            break
    obstacles = () if best >= _OPEN_SHARE else _obstacles(copy, part, target, force_n)
    return best, obstacles


@reachable_by_pull.explain
def _explain_pull(kb: QuestionContext, row: PullRow) -> Iterator[str]:
    yield row.why
    yield f"tried in {row.source}"


@reachable_by_pull.missing
def _missing_pull(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    if asked.handle is None:
        yield missing_arguments("give handle: all handles are not pulled")
        return
    yield from _missing_parts(kb, asked.present, asked.handle, asked.map)


# -- vessels ---------------------------------------------------------------------------------------------------------


class SpillRow(AnswerRow, frozen=True, kw_only=True):
    """A vessel that spills liquid if it is tilted."""

    vessel: IndividualName
    tilt_deg: float
    """The tilt that was asked about; without one, that from which on it spills [degrees]."""
    capacity_l: float
    """What it holds as it stands [l]."""
    fill_share: float
    """How full it is, from 0 to 1 of its capacity."""
    fill_height_m: float
    """The height of the liquid above the deepest point of the inside [m]."""
    spills_from_deg: float
    """The tilt from which on it spills, in the direction in which it spills first [degrees]."""
    spilled_l: float
    """How much has left it at that tilt [l]."""
    probability: float
    interval: tuple[float, float]
    tried: int
    why: str
    map: MapName
    source: str


@question(
    sentences=(
        "would {vessel} spill [at {tilt_deg} degrees]",
        "when (would|does) {vessel} spill",
        "(would|does) {vessel} spill if (i|robot) tilt it [by {tilt_deg} degrees]",
        "how far can (i|robot) tilt {vessel}",
    ),
    imagines=True,
)
def would_spill(
    kb: QuestionContext,
    vessel: IndividualName | None = None,
    tilt_deg: Tilt | None = None,
    fill_share: Fraction | None = None,
    heading_deg: Heading | None = None,
    tilt_std_deg: Tilt | None = None,
    fill_std: Fraction | None = None,
    seed: Seed | None = None,
    min_probability: Fraction | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[SpillRow]:
    """Whether a vessel spills if it is tilted slowly, how much, and from which tilt on.

    No liquid is simulated: its level is compared with the rim of the collision shapes, which are sampled on a grid as
    for `can_hold_liquid`, at tilts of 0 to 90 degrees, so that waves and drops are left out. The vessel is filled to
    `fill_share` of what it holds (0.8 if it is left out: how full a thing is, is not part of a map). `heading_deg` is
    the horizontal direction, in the map, to which it is tilted; without it, the worst of eight. The standard deviations
    of tilt [degrees] and of `fill_share` give a probability.

    Examples:
        would_spill coffee_mug_1 60
    """
    if vessel is None:
        return
    tilt = tilt_deg
    share = 0.8 if fill_share is None else fill_share
    deviations = (tilt_std_deg or 0.0, fill_std or 0.0)
    for scene in imagined_scenes(kb, present, map, vessel):
        body = scene.bodies.get(vessel)
        if body is None:
            continue
        headings = (
            (heading_deg,) if heading_deg is not None else tuple(360.0 * at / _HEADINGS for at in range(_HEADINGS))
        )
        curve = _retained_curve(scene, body, headings)
        if curve is None or curve.volumes[0] <= 0.0:
            continue
        asked = curve.spills_from(share) if tilt is None else tilt
        filled = "assumed to be filled to" if fill_share is None else "filled to"
        trials = _spill_trials(curve, tilt, share, deviations, seed=seed or 0, filled=filled)
        if is_probable(trials, min_probability):
            volume = curve.volumes[0] * share
            yield SpillRow(
                vessel=vessel,
                tilt_deg=round(asked, 2) if tilt is None else tilt,
                capacity_l=round(curve.volumes[0] * 1000, 4),
                fill_share=share,
                fill_height_m=round(curve.upright.surface_of(volume) - curve.bottom, 4),
                spills_from_deg=round(curve.spills_from(share), 2),
                spilled_l=round(max(0.0, volume - curve.retained(asked)) * 1000, 4),
                probability=trials.probability or 0.0,
                interval=trials.interval,
                tried=trials.tried,
                why=trials.why,
                map=scene.map_of(body.id),
                source=f"{scene.source}; no liquid is simulated, its level is compared with the rim",
            )
        else:
            remember(present, vessel, trials)


class _RetainedCurve(msgspec.Struct, frozen=True):
    """What a vessel retains when it is tilted slowly, in the direction in which it retains least."""

    upright: Depressions
    volumes: tuple[float, ...]
    """For each of `_TILTS_DEG` [m³]; never rising, since what was spilled does not return."""

    @property
    def bottom(self) -> float:
        """The deepest point of the inside [m]."""
        wet = np.isfinite(self.upright.height) & (self.upright.level > self.upright.height)
        return float(self.upright.height[wet].min())

    def retained(self, tilt_deg: float) -> float:
        """What is retained at a tilt [m³]."""
        return float(np.interp(tilt_deg, _TILTS_DEG, self.volumes))

    def spills_from(self, share: float) -> float:
        """The smallest tilt at which less is retained than a share of the capacity [degrees]; 90 if there is none."""
        wanted = self.volumes[0] * share
        low, high = 0.0, float(_TILTS_DEG[-1])
        for _ in range(30):
            middle = (low + high) / 2
            low, high = (low, middle) if self.retained(middle) < wanted else (middle, high)
        return high


def _retained_curve(scene: ImaginedScene, body: Body, headings: Sequence[float]) -> _RetainedCurve | None:
    geometry = scene.state.geometry
    if body.id not in geometry:
        return None
    shapes = ShapeScene([body], {body.id: geometry[body.id]})
    placed = BodyBoxes.from_bodies([body])
    upright = find_depressions(shapes, 0, placed.low[0], placed.high[0])
    if upright is None or upright.volume <= 0.0:
        return None
    volumes, least = [upright.volume], upright.volume
    for tilt in _TILTS_DEG[1:]:
        least = min(least, *(upright.tilted_volume(radians(tilt), radians(heading)) for heading in headings))
        volumes.append(least)
    return _RetainedCurve(upright, tuple(volumes))


def _spill_trials(
    curve: _RetainedCurve, tilt_deg: float | None, share: float, deviations: Sequence[float], *, seed: int, filled: str
) -> Trials:
    """Draws tilts and fill levels; without a tilt it is asked from which one on the vessel spills."""
    rng = np.random.default_rng([seed])
    uncertain = any(deviations)
    trials = []
    for _ in range(DEFAULT_SAMPLES if uncertain else 1):
        noise = rng.standard_normal(2) if uncertain else np.zeros(2)
        full = float(np.clip(share + deviations[1] * noise[1], 0.0, 1.0))
        volume, limit = curve.volumes[0] * full, curve.spills_from(full)
        spills = volume > 0.0
        why = f"{filled} {full:.0%} ({volume * 1000:.3g} l), it spills from a tilt of {limit:.0f} degrees on"
        if tilt_deg is not None:
            tilted = float(np.clip(tilt_deg + deviations[0] * noise[0], 0.0, 90.0))
            lost = max(0.0, volume - curve.retained(tilted))
            spills = lost > 0.0
            why += f", and {lost * 1000:.2g} l at {tilted:.0f} degrees"
        trials.append(Trial(holds=spills, why=why))
    return Trials(tuple(trials), seed, uncertain)


@would_spill.explain
def _explain_spill(kb: QuestionContext, row: SpillRow) -> Iterator[str]:
    yield f"{local_name(row.vessel)} holds {row.capacity_l:g} l; {row.why}"
    yield f"tried in {row.source}"


@would_spill.missing
def _missing_spill(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    if asked.vessel is None:
        yield missing_arguments("give vessel: all things are not tilted")
        return
    reasons = list(why_not(kb, asked.present, (asked.vessel,), asked.map, "does not spill"))
    yield from reasons
    if not reasons:
        reason = (
            f"{local_name(asked.vessel)} holds no liquid: its collision shapes have no depression at its present pose"
        )
        with kb.lock:
            yield missing_about(kb, asked.vessel, reason, present=asked.present, map=asked.map)
