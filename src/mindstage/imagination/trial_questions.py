"""Questions that imagine: what would stay, tip, fit, open or spill, and what the answers were after an edit.

Each is tried in copies of the running simulation, or of a MuJoCo simulation that is made from the map; the world itself
never changes. A row says how probable it is, in how many samples it was tried, and why. If the world is not uncertain,
one sample is tried, and its interval is one point. Unless `min_probability` is given, only what holds in at least half
of the samples is an answer; otherwise the missing knowledge has the reason.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator
from functools import partial
from typing import Any

import msgspec
import numpy as np

from mindstage.errors import InvalidArgumentError
from mindstage.imagination.articulation_questions import (
    OpenableRow,
    PullRow,
    SpillRow,
    can_open,
    reachable_by_pull,
    would_spill,
)
from mindstage.imagination.plans import Place, Plan, PlanStep, Push, Wait
from mindstage.imagination.results import EventKind, SampleResult
from mindstage.imagination.trials import (
    Heading,
    ImaginedScene,
    ImaginedTime,
    PushForce,
    SampleCount,
    Trial,
    Trials,
    body_pose,
    events_of,
    imagined_scenes,
    is_probable,
    parse_edit,
    parse_uncertainty,
    remember,
    run_trials,
    tilt_between,
    why_not,
    within,
)
from mindstage.knowledge.queries.proximity import missing_arguments
from mindstage.knowledge.queries.visibility import PlaceRelation
from mindstage.knowledge.questions import (
    AnswerRow,
    Answers,
    AskedArguments,
    IndividualName,
    MapName,
    MissingKnowledge,
    QuestionContext,
    StateAccess,
    cell_text,
    question,
    question_names,
)
from mindstage.ranges import Fraction, Length, Seed
from mindstage.rdf.graphs import local_name
from mindstage.scene import Body, BodyId, Iri, Pose, World
from mindstage.scene.proximity import BodyBoxes
from mindstage.scene.spatial import SpatialRelation, SpatialRelations
from mindstage.scene.transforms import normalized_pose_array, pose_from_array, pose_inverse, quat_rotate
from mindstage.simulation import Simulation

__all__ = [
    "AnswerField",
    "OpenableRow",
    "PlacementRow",
    "PullRow",
    "SpillRow",
    "StayRow",
    "TipRow",
    "WhatIfRow",
    "can_open",
    "fits_now",
    "reachable_by_pull",
    "stays",
    "what_if",
    "would_spill",
    "would_tip",
]

_TIPPED_RAD = math.radians(45)
_STAYS_WITHIN_M = 0.05
"""A thing without a given place has left its place if its center is farther away at the end [m]."""
_MAX_DURATION_S = 600.0


# -- stays -----------------------------------------------------------------------------------------------------------


class StayRow(AnswerRow, frozen=True, kw_only=True):
    """A thing that stays where it is, or where it is put."""

    thing: IndividualName
    place: IndividualName | None
    """What it is on or in at the end; None if that is nothing."""
    probability: float
    """The share of the samples in which it stays."""
    interval: tuple[float, float]
    """The 95 % interval of the probability."""
    tried: int
    """The number of samples."""
    moved_m: float
    """How far it moves, in the typical sample [m]."""
    tilted_deg: float
    """By how much it tilts [degrees]."""
    why: str
    map: MapName
    """The map that `thing` is described in."""
    source: str
    """What was copied to try it, and what simulated the copies."""


@question(
    sentences=(
        "(would|will|does) {thing} stay [for {for_s}]",
        "(would|will|does) {thing} (stay|remain) {relation} {place} [for {for_s}]",
        "(would|will|does) {thing} stay (in place|there|put)",
        "is {thing} safe {relation} {place}",
    ),
    imagines=True,
)
def stays(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    place: IndividualName | None = None,
    for_s: ImaginedTime | None = None,
    relation: PlaceRelation | None = None,
    uncertainty: str | None = None,
    samples: SampleCount | None = None,
    seed: Seed | None = None,
    min_probability: Fraction | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[StayRow]:
    """Whether a thing stays where it is, or on or in a place, for some seconds of physics (2 if left out).

    With `place`, the thing is first put there at a free pose, unless it is there already: onto it, or into it if it has
    no surface on top, unless `relation` is given. It stays if it neither falls, nor tips by more than 45 degrees, nor
    leaves the place (without one: moves by more than 5 cm). `uncertainty` has standard deviations of the thing:
    "position_m=0.01 yaw_rad=0.1 mass=0.2 friction=0.3", the last two relative. If it holds in fewer than
    `min_probability` of the samples (half, if left out), there is no answer, and the reason is the missing knowledge.

    Examples:
        stays milk_carton_1
        stays coffee_mug_1 uncertainty='position_m=0.01 friction=0.2' samples=5
    """
    if thing is None:
        return
    duration_s = 2.0 if for_s is None else for_s
    for scene in imagined_scenes(kb, present, map, thing, place):
        body = scene.bodies.get(thing)
        if body is None:
            continue
        holder = scene.bodies.get(place) if place is not None else None
        steps: tuple[PlanStep, ...] = ()
        if holder is not None and holder.iri not in _places_of(scene.state.world, body.id):
            inside = _has_only_inside(scene, holder) if relation is None else relation is PlaceRelation.INTO
            steps = (_place(body, holder, inside=inside),)
        plan = Plan(
            steps=(*steps, Wait(duration_s=duration_s)),
            uncertainty=parse_uncertainty(body.id, uncertainty),
            forbid=(),
        )
        judge = partial(_judge_stay, body=body, place=place, is_placed=bool(steps), for_s=duration_s)
        trials = run_trials(scene, plan, judge, samples=samples, seed=seed)[body.id]
        typical = trials.typical.facts
        if is_probable(trials, min_probability):
            yield StayRow(
                thing=thing,
                place=place if place is not None else typical["place"],
                probability=trials.probability or 0.0,
                interval=trials.interval,
                tried=trials.tried,
                moved_m=round(typical["moved_m"], 4),
                tilted_deg=round(math.degrees(typical["tilted"]), 2),
                why=trials.why,
                map=scene.map_of(body.id),
                source=scene.source,
            )
        else:
            remember(present, thing, trials)


def _place(body: Body, holder: Body, *, inside: bool) -> Place:
    return Place(thing=body.id, into=holder.id) if inside else Place(thing=body.id, on=holder.id)


def _places_of(world: World, id: BodyId) -> tuple[Iri, ...]:
    """What a body is on or in."""
    relations = (SpatialRelation.ON, SpatialRelation.INSIDE)
    return tuple(pair.other.iri for pair in SpatialRelations(world).related(subjects=[id], relations=relations))


def _has_only_inside(scene: ImaginedScene, holder: Body) -> bool:
    """Whether the support surfaces of a body are all inside of it, such as those of a drawer."""
    geometry = scene.state.geometry.get(holder.id)
    surfaces = geometry.support_surfaces if geometry is not None else ()
    return bool(surfaces) and all(each.is_inside for each in surfaces)


def _judge_stay(
    copy: Simulation, result: SampleResult, *, body: Body, place: Iri | None, is_placed: bool, for_s: float
) -> dict[BodyId, Trial]:
    now = _places_of(copy.snapshot(), body.id)
    start, end = normalized_pose_array(body.pose), body_pose(copy, body.id)
    moved = 0.0 if is_placed else float(np.linalg.norm(end[:3] - start[:3]))
    tilted = tilt_between(start, end)
    refused = next((event for event in result.events if event.kind is EventKind.REFUSED), None)
    broken = events_of(result, body.id, EventKind.FELL, EventKind.TIPPED, EventKind.LEFT)
    on = f" on {local_name(now[0])}" if now else ""
    if refused is not None:
        holds, why = False, refused.text
    elif broken:
        holds, why = False, broken[0].text
    elif tilted > _TIPPED_RAD:
        holds, why = False, f"it tips by {math.degrees(tilted):.0f} degrees"
    elif place is not None and place not in now:
        holds, why = False, f"it is{on or ' on nothing'} at the end"
    elif place is None and moved > _STAYS_WITHIN_M:
        holds, why = False, f"it moves by {moved:.2g} m"
    else:
        way = f"it moves by {moved * 100:.1f} cm and " if moved > 5e-4 else "it "
        holds, why = True, f"{way}rests{on} after {for_s:g} s"
    facts = {"moved_m": moved, "tilted": tilted, "place": next(iter(now), None)}
    return {body.id: Trial(holds=holds, why=why, facts=facts)}


@stays.explain
def _explain_stay(kb: QuestionContext, row: StayRow) -> Iterator[str]:
    yield f"{local_name(row.thing)}: {row.why}"
    yield f"tried in {row.source}"


@stays.missing
def _missing_stay(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    if asked.thing is None:
        yield missing_arguments("give thing: all things are not watched; mindstage check lists what does not rest")
        return
    yield from why_not(kb, asked.present, (asked.thing, asked.place), asked.map, "does not stay")


# -- fits now --------------------------------------------------------------------------------------------------------


class PlacementRow(AnswerRow, frozen=True, kw_only=True):
    """A thing for which there is room on or in a body, where it stays."""

    thing: IndividualName
    relation: PlaceRelation
    place: IndividualName
    pose: Pose
    """Where it is at the end, in the typical sample."""
    probability: float
    interval: tuple[float, float]
    tried: int
    why: str
    map: MapName
    """The map that `place` is described in."""
    source: str


@question(
    sentences=(
        "(would|can) {thing} fit and stay {relation} {place}",
        "can (i|robot) (put|place) {thing} {relation} {place}",
    ),
    imagines=True,
)
def fits_now(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    place: IndividualName | None = None,
    relation: PlaceRelation | None = None,
    uncertainty: str | None = None,
    samples: SampleCount | None = None,
    seed: Seed | None = None,
    min_probability: Fraction | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[PlacementRow]:
    """Whether a thing can be put on or in a body as it is now, and stays there: it is put there in copies of the world.

    `fits` compares sizes only, whether or not there is room. The thing is put at a free pose with the largest margin,
    2 s pass, and it must not fall, tip or leave. For `uncertainty` see `stays`; it also applies to the pose at which
    the thing is put.

    Examples:
        fits_now milk_carton_1 table
    """
    if thing is None or place is None:
        return
    for scene in imagined_scenes(kb, present, map, thing, place):
        body, holder = scene.bodies.get(thing), scene.bodies.get(place)
        if body is None or holder is None:
            continue
        for each in PlaceRelation if relation is None else (relation,):
            steps = (_place(body, holder, inside=each is PlaceRelation.INTO), Wait(duration_s=2.0))
            plan = Plan(steps=steps, uncertainty=parse_uncertainty(body.id, uncertainty), forbid=())
            judge = partial(_judge_placement, body=body)
            trials = run_trials(scene, plan, judge, samples=samples, seed=seed)[body.id]
            if is_probable(trials, min_probability):
                yield PlacementRow(
                    thing=thing,
                    relation=each,
                    place=place,
                    pose=trials.typical.facts["pose"],
                    probability=trials.probability or 0.0,
                    interval=trials.interval,
                    tried=trials.tried,
                    why=trials.why,
                    map=scene.map_of(holder.id),
                    source=scene.source,
                )
            else:
                remember(present, thing, trials)


def _judge_placement(copy: Simulation, result: SampleResult, *, body: Body) -> dict[BodyId, Trial]:
    end = body_pose(copy, body.id)
    events = events_of(result, body.id, EventKind.FELL, EventKind.TIPPED, EventKind.LEFT)
    broken = next((event for event in result.events if event.kind is EventKind.REFUSED), next(iter(events), None))
    why = broken.text if broken is not None else "it rests 2 s after it was put there"
    facts = {"pose": pose_from_array(end.round(4))}
    return {body.id: Trial(holds=broken is None, why=why, facts=facts)}


@fits_now.explain
def _explain_placement(kb: QuestionContext, row: PlacementRow) -> Iterator[str]:
    yield f"{local_name(row.thing)} {row.relation} {local_name(row.place)}: {row.why}"
    yield f"tried in {row.source}"


@fits_now.missing
def _missing_placement(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    if asked.thing is None or asked.place is None:
        yield missing_arguments("give thing and place: all pairs of bodies are not tried")
        return
    yield from why_not(
        kb,
        asked.present,
        (asked.thing, asked.place),
        asked.map,
        f"cannot be put {asked.relation or 'onto or into'} {local_name(asked.place)}",
    )


# -- tips ------------------------------------------------------------------------------------------------------------


class TipRow(AnswerRow, frozen=True, kw_only=True):
    """A thing that a push tips over."""

    thing: IndividualName
    push_n: float
    """The force [N]."""
    height_m: float
    """Where it acts, above the lowest point of the thing [m]."""
    heading_deg: float
    """Its horizontal direction, from the x axis of the map counterclockwise [degrees]."""
    probability: float
    interval: tuple[float, float]
    tried: int
    tilted_deg: float
    """The tilt at the end, in the typical sample [degrees]."""
    why: str
    map: MapName
    source: str


@question(
    sentences=(
        "would {thing} tip [over] [with {push_n}]",
        "(would|does) a push [of {push_n}] tip {thing} [over]",
        "would {thing} (fall|tip|topple) [over] if (i|robot) push it [with {push_n}]",
    ),
    imagines=True,
)
def would_tip(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    push_n: PushForce | None = None,
    height_m: Length | None = None,
    heading_deg: Heading | None = None,
    uncertainty: str | None = None,
    samples: SampleCount | None = None,
    seed: Seed | None = None,
    min_probability: Fraction | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[TipRow]:
    """Whether a horizontal push of half a second tips a thing over, by more than 45 degrees, and in which directions.

    The push is 5 N if it is left out, and acts at the top of the thing's box unless its height above the lowest point
    is given. Without a direction, the four horizontal directions along the sides of the box are tried. For
    `uncertainty` see `stays`.

    Examples:
        would_tip milk_carton_1 20 heading_deg=90
    """
    if thing is None:
        return
    force = 5.0 if push_n is None else push_n
    for scene in imagined_scenes(kb, present, map, thing):
        body = scene.bodies.get(thing)
        if body is None or body.size is None:
            continue
        for heading in _headings(body) if heading_deg is None else (heading_deg,):
            plan, height = _push_plan(body, force, height_m, heading)
            plan = msgspec.structs.replace(plan, uncertainty=parse_uncertainty(body.id, uncertainty))
            trials = run_trials(scene, plan, partial(_judge_tip, body=body), samples=samples, seed=seed)[body.id]
            if is_probable(trials, min_probability):
                yield TipRow(
                    thing=thing,
                    push_n=force,
                    height_m=height,
                    heading_deg=heading,
                    probability=trials.probability or 0.0,
                    interval=trials.interval,
                    tried=trials.tried,
                    tilted_deg=round(math.degrees(trials.typical.facts["tilted"]), 2),
                    why=trials.why,
                    map=scene.map_of(body.id),
                    source=scene.source,
                )
            else:
                remember(present, thing, trials)


def _headings(body: Body) -> tuple[float, ...]:
    """The horizontal directions of the most nearly horizontal axis of a box, and across it [degrees]."""
    pose = normalized_pose_array(body.pose)
    axes = [quat_rotate(pose[3:], axis) for axis in np.eye(3)]
    x, y, _ = min(axes, key=lambda axis: round(abs(float(axis[2])), 6))
    first = math.degrees(math.atan2(y, x))
    return tuple(round((first + turn + 180.0) % 360.0 - 180.0, 3) + 0.0 for turn in (0.0, 90.0, 180.0, 270.0))


def _push_plan(body: Body, force: float, height_m: float | None, heading_deg: float) -> tuple[Plan, float]:
    placed = BodyBoxes.from_bodies([body])
    low, high = float(placed.low[0, 2]), float(placed.high[0, 2])
    height = round(high - low, 6) if height_m is None else within("height_m", height_m, 0.0, round(high - low, 6), "m")
    pose = normalized_pose_array(body.pose)
    offset = np.array([0.0, 0.0, low + height - pose[2]])
    x, y, z = quat_rotate(pose_inverse(pose)[3:], offset).tolist()
    heading = math.radians(heading_deg)
    vector = (force * math.cos(heading), force * math.sin(heading), 0.0)
    push = Push(thing=body.id, force=vector, point=(x, y, z), duration_s=0.5)
    return Plan(steps=(push, Wait(duration_s=1.5)), forbid=()), height


def _judge_tip(copy: Simulation, result: SampleResult, *, body: Body) -> dict[BodyId, Trial]:
    start, end = normalized_pose_array(body.pose), body_pose(copy, body.id)
    tilted, moved = tilt_between(start, end), float(np.linalg.norm(end[:2] - start[:2]))
    tips = tilted > _TIPPED_RAD or bool(events_of(result, body.id, EventKind.TIPPED))
    events = events_of(result, body.id, EventKind.TIPPED)
    why = events[0].text if events else f"it tilts by {math.degrees(tilted):.1f} degrees and moves {moved:.2g} m"
    return {body.id: Trial(holds=tips, why=why, facts={"tilted": tilted})}


@would_tip.explain
def _explain_tip(kb: QuestionContext, row: TipRow) -> Iterator[str]:
    yield f"{row.push_n:g} N at a height of {row.height_m:g} m towards {row.heading_deg:g} degrees: {row.why}"
    yield f"tried in {row.source}"


@would_tip.missing
def _missing_tip(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    if asked.thing is None:
        yield missing_arguments("give thing: all things are not pushed")
        return
    push_n = asked.plain("push_n", float)
    yield from why_not(
        kb,
        asked.present,
        (asked.thing,),
        asked.map,
        f"is not tipped by {5.0 if push_n is None else push_n:g} N",
    )


# -- after an edit ---------------------------------------------------------------------------------------------------


class AnswerField(msgspec.Struct, frozen=True):
    """A column of an answer, and its value."""

    name: str
    value: Any

    def __str__(self) -> str:
        return f"{self.name} {cell_text(self.value)}"


class WhatIfRow(AnswerRow, frozen=True, kw_only=True):
    """An answer to a question in the world after an edit."""

    edit: str
    question: str
    answer: tuple[AnswerField, ...]
    """The row of the other question: its columns with their values."""
    asked: str
    """The name of the other question."""
    probability: float
    """The share of the samples with this answer; numbers may differ, those of the first one are shown."""
    interval: tuple[float, float]
    tried: int
    why: str
    source: str


_NOT_IMAGINED_TWICE = "what_if"
_MAX_WAIT_S = 600.0


@question(sentences=("what if {edit} and i ask {question}",), imagines=True)
def what_if(
    kb: QuestionContext,
    edit: str | None = None,
    question: str | None = None,
    wait_s: ImaginedTime | None = None,
    samples: SampleCount | None = None,
    seed: Seed | None = None,
    min_probability: Fraction | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[WhatIfRow]:
    """The answers to any question in the world after an edit and some seconds of physics (2 if left out).

    `edit` is a plan, one step, or a list of steps as JSON or YAML, as `mindstage evaluate` takes them, or words: "open
    the fridge", "put milk_carton_1 on table", several of them separated by "then". `question` is a plain sentence, or
    the name of a question with its arguments as for `mindstage ask`. If the plan has uncertainty, each answer has the
    share of the samples in which it is given.

    Examples:
        what_if 'open the fridge' 'where_is fridge_door'
        what_if 'put milk_carton_1 on table' 'where is milk_carton_1?'
    """
    if edit is None or question is None:
        return
    duration_s = 2.0 if wait_s is None else wait_s
    scenes = imagined_scenes(kb, present, map)
    scene = next(scenes, None)
    if scene is None:
        return
    if map is None and present.running() is None and next(scenes, None) is not None:
        raise InvalidArgumentError("what_if", cause="several maps are loaded", remedy="give map")
    plan = parse_edit(kb, scene, edit, wait_s=duration_s)
    answers: list[Answers[Any]] = []
    trials = run_trials(scene, plan, partial(_ask_at_end, text=question, answers=answers), samples=samples, seed=seed)
    ended = [each for each in trials[_WHOLE].trials if each.holds is not None]
    kinds = dict.fromkeys(key for each in ended for key in each.facts["rows"])
    whole = trials[_WHOLE]
    for key in kinds:
        having = tuple(_has_row(each, key) for each in whole.trials)
        of_row = Trials(having, whole.seed, whole.is_uncertain, whole.left_out, whole.notes)
        if is_probable(of_row, min_probability):
            first = next(each.facts["rows"][key] for each in ended if key in each.facts["rows"])
            yield WhatIfRow(
                edit=edit,
                question=question,
                answer=first,
                asked=answers[0].question.name,
                probability=of_row.probability or 0.0,
                interval=of_row.interval,
                tried=of_row.tried,
                why=of_row.why,
                source=scene.source,
            )
    present.memo["what if",] = (trials[_WHOLE], answers)


_WHOLE = BodyId("")


def _ask_at_end(
    copy: Simulation, result: SampleResult, *, text: str, answers: list[Answers[Any]]
) -> dict[BodyId, Trial]:
    found = _ask(copy, text)
    answers.append(found)
    broken = next((event for event in result.events if event.kind is EventKind.REFUSED), None)
    rows = {} if broken is not None else {_key(row): _fields(row) for row in found}
    happened = "; ".join(event.text for event in result.events[:3]) or "the edit was made, and nothing fell or tipped"
    return {_WHOLE: Trial(holds=broken is None, why=happened, facts={"rows": rows})}


def _has_row(trial: Trial, key: tuple[object, ...]) -> Trial:
    if trial.holds is None:
        return trial
    has = key in trial.facts["rows"]
    return Trial(holds=has, why=trial.why if has else f"there is another answer, or none: {trial.why}")


def _ask(simulation: Simulation, text: str) -> Answers[Any]:
    """The answers to a plain sentence, or to a question by name with its arguments.

    Raises:
        InvalidArgumentError: it is `what_if` itself, or an argument is wrong.
        KnowledgeError: the question does not exist, or is not understood.
    """
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise InvalidArgumentError("question", cause=str(error), remedy="close the quotation") from error
    name = words[0].replace("-", "_") if words else ""
    if not text.strip().endswith("?") and name in question_names():
        if name == _NOT_IMAGINED_TWICE:
            raise InvalidArgumentError("question", cause="what_if cannot be asked in what_if", remedy="give more steps")
        named = dict(word.split("=", 1) for word in words[1:] if "=" in word)
        positional = [None if word == "_" else word for word in words[1:] if "=" not in word]
        return simulation.ask(name, *positional, **named)
    return simulation.ask(text if text.strip().endswith("?") else f"{text}?")


def _key(row: AnswerRow) -> tuple[object, ...]:
    """What identifies an answer in all samples: its values that are no measured numbers or texts about them."""
    names = (name for name in row.__struct_fields__ if name not in {"why", "reason", "source"})
    values = ((name, getattr(row, name)) for name in names)
    return tuple(
        (name, value) for name, value in values if not isinstance(value, float | Pose) and not _has_numbers(value)
    )


def _has_numbers(value: object) -> bool:
    return isinstance(value, tuple) and any(isinstance(each, float) for each in value)


def _fields(row: AnswerRow) -> tuple[AnswerField, ...]:
    return tuple(AnswerField(name, getattr(row, name)) for name in row.__struct_fields__)


@what_if.explain
def _explain_what_if(kb: QuestionContext, row: WhatIfRow) -> Iterator[str]:
    yield f"after {row.edit!r}: {row.why}"
    yield f"tried in {row.source}"


@what_if.missing
def _missing_what_if(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    if asked.edit is None or asked.question is None:
        yield missing_arguments("give edit and question")
        return
    if ("what if",) not in asked.present.memo:
        yield missing_arguments("no map or simulation is loaded, so there is nothing to edit")
        return
    trials, answers = asked.present.memo["what if",]
    if trials.probability is None:
        yield missing_arguments(f"no sample ended: {trials.why}")
        return
    if trials.probability == 0.0:
        yield missing_arguments(f"the edit cannot be made: {trials.why}")
        return
    for found in answers[:1]:
        for lack in found.missing:
            yield msgspec.structs.replace(lack, reason=f"after the edit, {lack.reason}", claims=())
        if not found and not found.missing:
            yield missing_arguments(f"after the edit, {found.question.name} has no answer: {trials.why}")
        elif found:
            yield missing_arguments("no answer is given in enough of the samples: set min_probability=0 to see all")
