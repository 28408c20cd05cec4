"""Trials: what a question tries in copies of the world, how often it holds there, and edits that are given as words.

Without a running simulation, the copies are of a MuJoCo simulation that is made from the map, once until the loaded
statements change.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from mindstage.engines import make_engine
from mindstage.errors import AmbiguousNameError, InvalidArgumentError, NameNotFoundError
from mindstage.imagination.confidence import confidence_sequence, wilson_interval
from mindstage.imagination.execution import PlanRunner, is_stopped, is_uncertain, named_bodies
from mindstage.imagination.guesses import Guesses
from mindstage.imagination.plan_files import PlanFile, load_plan
from mindstage.imagination.plans import GUESSES, Close, Open, Place, Plan, PlanStep, Uncertainty, Wait
from mindstage.imagination.results import EventKind, ImaginedEvent, Outcome, SampleResult
from mindstage.imagination.stated_uncertainty import stated_uncertainty
from mindstage.knowledge.names import EntityType
from mindstage.knowledge.queries.proximity import missing_about, missing_bodies
from mindstage.knowledge.questions import MAP_SOURCE, MissingKnowledge, QuestionContext, StateAccess, WorldState
from mindstage.rdf.graphs import local_name
from mindstage.scene import Body, BodyId, Iri, Joint
from mindstage.scene.display import counted
from mindstage.scene.edits import Attach, Detach
from mindstage.scene.joint_kinematics import is_robot_part
from mindstage.scene.transforms import Array, normalize, pose_inverse, quat_rotate
from mindstage.simulation import Simulation
from mindstage.simulation.image import SimulationImage

__all__ = [
    "DEFAULT_SAMPLES",
    "ImaginedScene",
    "Trial",
    "Trials",
    "body_pose",
    "events_of",
    "imagined_scenes",
    "is_probable",
    "parse_edit",
    "parse_uncertainty",
    "physical_simulation",
    "plan_from_text",
    "remember",
    "run_trials",
    "tilt_between",
    "why_not",
    "within",
]

DEFAULT_SAMPLES = 50
"""The number of samples of a question whose world is uncertain; without uncertainty it is one."""
SampleCount = Annotated[int, Meta(ge=1, le=10_000)]
ImaginedTime = Annotated[float, Meta(ge=0.0, le=600.0, extra={"unit": "s"})]
PushForce = Annotated[float, Meta(ge=0.0, le=10_000.0, extra={"unit": "N"})]
PullForce = Annotated[float, Meta(ge=0.5, le=10_000.0, extra={"unit": "N"})]
Tilt = Annotated[float, Meta(ge=0.0, le=90.0, extra={"unit": "degrees"})]
Heading = Annotated[float, Meta(ge=-36_000.0, le=36_000.0, extra={"unit": "degrees"})]
OpenShare = Annotated[float, Meta(ge=0.01, le=1.0)]
_BUDGET_S = 10.0
"""The time after which a question takes no more samples [s]."""
_FIRST_SAMPLE_S = 60.0
"""The longest time of the first sample, without which there is no answer [s]: a busy machine needs longer."""
_MAX_EDIT_CHARACTERS = 20_000


# -- the copied world ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=False, eq=False)
class ImaginedScene:
    """One state of the world, of which copies can be made."""

    image: SimulationImage
    map: Iri
    """The map, or the first one of a running simulation."""
    source: str
    """What simulates the copies, and what they are copies of."""

    @cached_property
    def state(self) -> WorldState:
        """The state from which each copy starts."""
        with self.image.restore() as copy:
            return copy.current_state()

    @cached_property
    def bodies(self) -> Mapping[Iri, Body]:
        """The bodies by IRI."""
        return {body.iri: body for body in self.state.world.bodies}

    @cached_property
    def joints(self) -> Mapping[Iri, Joint]:
        """The joints by IRI."""
        return {joint.iri: joint for joint in self.state.world.joints}

    def iri(self, id: BodyId | str) -> Iri:
        """The IRI of a body."""
        return next((body.iri for body in self.state.world.bodies if body.id == id), Iri(str(id)))

    def map_of(self, id: BodyId) -> Iri:
        """The map that a body came from."""
        return self.state.map_of_body.get(id, self.map)

    def joints_of_part(self, iri: Iri | None) -> tuple[Joint, ...]:
        """The joints that move a body or are that joint; those of its doors and drawers if it has none; or all.

        Those of robots are left out.
        """
        robots = {body.id for body in self.state.world.bodies if is_robot_part(body)}
        joints = tuple(joint for joint in self.state.world.joints if self.moving_body(joint) not in robots)
        if iri is None:
            return joints
        if iri in self.joints:
            return tuple(joint for joint in joints if joint.iri == iri)
        body = self.bodies.get(iri)
        if body is None:
            return ()
        world = self.state.world
        parents = {each.child: each.parent for each in world.attachments}
        id, visited = body.id, set[BodyId]()
        while id not in visited:  # a handle is attached to its door
            visited.add(id)
            if own := tuple(each for each in joints if self.moving_body(each) == id):
                return own
            id = parents.get(id, id)
        return tuple(each for each in joints if body.id in {each.parent, each.child})

    def moving_body(self, joint: Joint) -> BodyId:
        """The dynamic end of a joint."""
        ends = {body.id: body.physics.is_dynamic for body in self.state.world.bodies}
        moves_child = ends.get(joint.child, False) or not ends.get(joint.parent, False)
        return joint.child if moves_child else joint.parent


def imagined_scenes(
    kb: QuestionContext, present: StateAccess, map: Iri | None, *things: Iri | None
) -> Iterator[ImaginedScene]:
    """The running simulation, and the maps that it does not simulate, if they have all these bodies or joints."""
    with kb.lock:
        states = present.states(map)
    wanted = {thing for thing in things if thing is not None}
    for state in states:
        entities: tuple[Body | Joint, ...] = (*state.world.bodies, *state.world.joints)
        if wanted <= {each.iri for each in entities}:
            yield _scene(kb, present, state)


def _scene(kb: QuestionContext, present: StateAccess, state: WorldState) -> ImaginedScene:
    running = present.simulation
    home = state.spawned[0].iri if state.spawned else state.world.iri
    if state.source != MAP_SOURCE and isinstance(running, Simulation):
        if ("scene",) not in present.memo:
            image = SimulationImage.capture(running)
            source = f"{state.source}, a copy of the running simulation"
            if image.notes:
                source = "; ".join(("mujoco", *image.notes))
            present.memo["scene",] = ImaginedScene(image, home, source)
        return present.memo["scene",]  # type: ignore[no-any-return]

    if state.source != MAP_SOURCE and present.past is not None:
        if ("scene",) not in present.memo:
            history, time_s = present.past
            with history.resume(time_s) as resumed:
                source = f"{resumed.engine.name}, continued at {time_s:g} s of {history.name}"
                present.memo["scene",] = ImaginedScene(SimulationImage.capture(resumed), home, source)
        return present.memo["scene",]  # type: ignore[no-any-return]

    def simulate() -> ImaginedScene:
        # The knowledge base keeps the scene, which has the knowledge base: both are collected together.
        with Simulation(kb, make_engine("mujoco"), threaded=False) as simulation:  # type: ignore[arg-type]
            simulation.spawn(state.world)
            source = f"mujoco, a simulation made from the map {local_name(home)}, since none is running"
            return ImaginedScene(SimulationImage.capture(simulation), home, source)

    return kb.cached(("imagined", home), simulate)


@contextmanager
def physical_simulation(simulation: Simulation) -> Iterator[Simulation]:
    """The simulation itself, or a copy of it in MuJoCo if its engine has no physics."""
    if simulation.engine.name != "null":
        yield simulation
        return
    with simulation.fork(threaded=False, physics=True) as copy:
        yield copy


# -- trials ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """What was found in one copy."""

    holds: bool | None
    """Whether what is asked for is so; None if that is unknown."""
    why: str
    facts: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Trials:
    """What was found in all copies."""

    trials: tuple[Trial, ...]
    seed: int = 0
    is_uncertain: bool = False
    left_out: int = 0
    """The number of samples for which no time was left."""
    notes: tuple[str, ...] = ()
    """The uncertainty that is stated in the maps, and what the engine assumes, one sentence each."""

    @property
    def tried(self) -> int:
        """The number of samples that ended."""
        return sum(trial.holds is not None for trial in self.trials)

    @property
    def probability(self) -> float | None:
        """The share of those in which it holds; None if none ended."""
        return sum(trial.holds is True for trial in self.trials) / self.tried if self.tried else None

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the probability, which unknown samples widen: Wilson's if all samples were run.

        If the time ended them, it is `confidence_sequence`. Without uncertainty, each sample is the same.
        """
        unknown = len(self.trials) - self.tried
        if not self.tried:
            return 0.0, 1.0
        holds = sum(trial.holds is True for trial in self.trials)
        if not self.is_uncertain and not unknown:
            return (holds / self.tried,) * 2
        interval = confidence_sequence if self.left_out else wilson_interval
        low, _ = interval(holds, len(self.trials))
        _, high = interval(holds + unknown, len(self.trials))
        return round(low, 6), round(high, 6)

    @property
    def typical(self) -> Trial:
        """The first sample with the more frequent finding."""
        holds = (self.probability or 0.0) >= 0.5
        ended = [trial for trial in self.trials if trial.holds is not None]
        return next((trial for trial in ended if trial.holds is holds), (ended or list(self.trials))[0])

    @property
    def why(self) -> str:
        """The reason in the typical sample, that of the first other one, and what was not tried."""
        typical = self.typical
        parts = [typical.why]
        for at, trial in enumerate(self.trials):
            if trial.holds is not typical.holds:
                parts.append(f"but in sample {at} of seed {self.seed}, {trial.why}")
                break
        if self.left_out:
            parts.append(f"{counted(self.left_out, 'sample')} not tried within {_BUDGET_S:g} s")
        if not self.is_uncertain:
            parts.append("no uncertainty is stated, so one sample was tried")
        parts += self.notes
        return "; ".join(parts)


def run_trials(
    scene: ImaginedScene,
    plan: Plan,
    judge: Callable[[Simulation, SampleResult], Mapping[BodyId, Trial]],
    *,
    samples: int | None = None,
    seed: int | None = None,
) -> Mapping[BodyId, Trials]:
    """Executes a plan in copies, and judges each one at its end.

    Args:
        scene: the world.
        plan: the plan; its check and forbidden events have no effect.
        judge: returns what was found of each thing.
        samples: the number of copies, if anything is uncertain.
        seed: with the number of a sample it determines its random numbers.

    Raises:
        PlanError: the plan is not possible in this world.
    """
    with scene.image.restore() as start:
        stated = stated_uncertainty(start)
        guesses, named = Guesses.of(start), named_bodies(plan, start)
        plan = msgspec.structs.replace(plan, uncertainty=(*stated.uncertainty, *plan.uncertainty))
        runner = PlanRunner(start, plan, seed=seed or 0)
    uncertain = is_uncertain(plan)
    count = (samples or DEFAULT_SAMPLES) if uncertain else 1
    begin_s, done = time.monotonic(), 0

    def is_over() -> bool:
        return time.monotonic() - begin_s > (_BUDGET_S if done else _FIRST_SAMPLE_S) or is_stopped()

    found: dict[BodyId, list[Trial]] = {}
    for index in range(count):
        with scene.image.restore() as copy:
            result = runner.run(copy, index, stop=is_over)
            trials = judge(copy, result)
            if result.outcome is Outcome.UNKNOWN:
                why = result.cause.text if result.cause else "the sample did not end"
                trials = {id: Trial(holds=None, why=why, facts=each.facts) for id, each in trials.items()}
            for id, trial in trials.items():
                found.setdefault(id, []).append(trial)
        done += 1
        if is_over():
            break
    about = guesses.sentences(named | found.keys(), only_named=True)
    notes = (*stated.notes, *scene.image.assumptions, *about)
    return {id: Trials(tuple(each), seed or 0, uncertain, count - done, notes) for id, each in found.items()}


def parse_uncertainty(thing: str, text: str | None) -> tuple[Uncertainty | Literal["guesses"], ...]:
    """The uncertainty of a thing from words such as "position_m=0.01,0.02,0 mass=0.1", and "guesses".

    Raises:
        InvalidArgumentError: a word is not a field of `Uncertainty` with a number.
    """
    if text is None:
        return ()
    known = [name for name in Uncertainty.__struct_fields__ if name != "thing"]
    values: dict[str, object] = {"thing": thing}
    words = re.split(r"[\s,]+(?![\d.+-])", text.strip())  # commas divide words, or the numbers of one
    guesses = (GUESSES,) if GUESSES in words else ()
    for word in [each for each in words if each != GUESSES]:
        name, _, value = word.partition("=")
        try:
            numbers = tuple(map(float, value.split(",")))
            values[name] = numbers if len(numbers) > 1 else numbers[0]
        except ValueError:
            name = ""
        if name not in known:
            remedy = f"as in position_m=0.01 mass=0.1; there is {', '.join(known)}, and guesses"
            raise InvalidArgumentError("uncertainty", cause=f"{word!r} is no standard deviation", remedy=remedy)
    try:
        return (*guesses, *([msgspec.convert(values, Uncertainty)] if len(values) > 1 else []))
    except msgspec.ValidationError as error:
        raise InvalidArgumentError("uncertainty", cause=str(error), remedy="give numbers of at least 0") from error


# -- what questions have in common -----------------------------------------------------------------------------------


def is_probable(trials: Trials, min_probability: float | None) -> bool:
    """Whether it is an answer: it holds in at least that share of the samples, by default half."""
    limit = 0.5 if min_probability is None else min_probability
    return trials.probability is not None and trials.probability >= limit


def within(name: str, value: float, low: float, high: float, unit: str = "") -> float:
    """An argument that is a number.

    Raises:
        InvalidArgumentError: it is out of range.
    """
    if not low <= value <= high:
        cause = f"{value:g} is out of range"
        raise InvalidArgumentError(name, cause=cause, remedy=f"give {low:g} to {high:g}{unit and ' ' + unit}")
    return value


def remember(present: StateAccess, about: str, trials: Trials) -> None:
    """Keeps why there is no row, for the missing knowledge."""
    present.memo.setdefault(("why",), {})[about] = trials


def why_not(
    kb: QuestionContext, present: StateAccess, things: Sequence[Iri | None], map: Iri | None, negated: str
) -> Iterator[MissingKnowledge]:
    """The missing poses; else what was found instead, of what was tried."""
    with kb.lock:
        found = list(missing_bodies(kb, tuple(things), map, present))
    yield from found
    tried: Mapping[str, Trials] = present.memo.get(("why",), {})
    for about, trials in tried.items() if not found else ():
        low, high = trials.interval
        share = "unknown" if trials.probability is None else f"{trials.probability:.0%} ({low:.0%} to {high:.0%})"
        reason = f"{local_name(about)} {negated}: {trials.why} (probability {share}, tried {trials.tried} times)"
        with kb.lock:
            yield missing_about(kb, Iri(about), reason, present=present, map=map)


def events_of(result: SampleResult, thing: BodyId, *kinds: EventKind) -> list[ImaginedEvent]:
    """What happened to a thing."""
    return [event for event in result.events if event.thing == thing and event.kind in kinds]


def body_pose(simulation: Simulation, id: BodyId) -> Array:
    """The current pose of a body: seven numbers with a unit quaternion."""
    state = simulation.state
    pose: Array = state.poses[state.ids.index(id)].copy()
    pose[3:] = normalize(pose[3:])
    return pose


def tilt_between(before: Array, after: Array) -> float:
    """The angle by which the axis of a body that was vertical is not so any more [rad]."""
    up = np.array([0.0, 0.0, 1.0])
    axis = quat_rotate(pose_inverse(before)[3:], up)
    return float(np.arccos(np.clip(quat_rotate(after[3:], axis) @ up, -1.0, 1.0)))


# -- edits as words --------------------------------------------------------------------------------------------------

_ARTICLES = re.compile(r"\b(?:the|a|an)\s+", re.IGNORECASE)
_CLAUSES = re.compile(r"\s*(?:;|,?\s*\band then\b|,?\s*\bthen\b|\n)\s*", re.IGNORECASE)
_WORDED_STEPS = (
    (re.compile(r"(?:open|pull open)\s+(?P<part>.+?)(?:\s+(?:by|to)\s+(?P<percent>[\d.]+)\s*%)?$", re.I), "open"),
    (re.compile(r"(?:close|shut)\s+(?P<part>.+)$", re.I), "close"),
    (re.compile(r"(?:place|put|set)\s+(?P<thing>.+?)\s+(?P<how>on|onto|in|into)\s+(?P<holder>.+)$", re.I), "place"),
    (re.compile(r"wait\s+(?:for\s+)?(?P<duration>[\d.]+)\s*(?:s|sec|seconds?)?$", re.I), "wait"),
    (re.compile(r"attach\s+(?P<child>.+?)\s+to\s+(?P<parent>.+)$", re.I), "attach"),
    (re.compile(r"detach\s+(?P<child>.+)$", re.I), "detach"),
)


def parse_edit(kb: QuestionContext, scene: ImaginedScene, text: str, *, wait_s: float) -> Plan:
    """The plan that a text describes: a plan, a step or a list of steps as JSON or YAML, or words.

    Words are "open PART [to 50 %]", "close PART", "put THING on|in HOLDER", "wait 2 s", "attach CHILD to PARENT" and
    "detach CHILD", several of them separated by "then" or ";". Things are named as in questions.

    Args:
        kb: has the names.
        scene: the world.
        text: the edit.
        wait_s: simulated time after the last step [s].

    Raises:
        PlanError: the JSON or YAML is no plan; it names the place.
        InvalidArgumentError: the words are no edit, or name nothing in this world.
    """
    if len(text) > _MAX_EDIT_CHARACTERS:
        raise InvalidArgumentError("edit", cause=f"it has more than {_MAX_EDIT_CHARACTERS:,} characters")
    if re.match(r"\s*[\[{]|\s*(?:steps|name|format_version|check|until|uncertainty)\s*:", text):
        plan = plan_from_text(text, name="the edit").plan
        steps: tuple[PlanStep, ...] = plan.steps
    else:
        plan = Plan(steps=())
        clauses = [clause for clause in _CLAUSES.split(text.strip().rstrip(".?!")) if clause]
        steps = tuple(step for clause in clauses for step in _worded_steps(kb, scene, clause))
    if not steps:
        raise InvalidArgumentError("edit", cause="it has no step", remedy="as in 'open the fridge then wait 2 s'")
    waits = (Wait(duration_s=wait_s),) if wait_s > 0 else ()
    deadline_s = None if plan.deadline_s is None else plan.deadline_s + sum(each.time_limit_s for each in waits)
    return msgspec.structs.replace(plan, steps=(*steps, *waits), forbid=(), check=None, deadline_s=deadline_s)


def plan_from_text(text: str, *, name: str = "the plan") -> PlanFile:
    """A plan from JSON or YAML text, never from a file: a whole plan, or as JSON one step or a list of steps.

    Raises:
        PlanError: it is none; the error names the line and the part.
    """
    stripped = text.strip()
    if stripped.startswith("["):
        stripped = f'{{"steps": {stripped}}}'
    elif re.match(r"\{\s*\"?do\"?\s*:", stripped):
        stripped = f'{{"steps": [{stripped}]}}'
    return load_plan(f"{stripped}\n", name=name)  # a text with a line break is not a path


def _worded_steps(kb: QuestionContext, scene: ImaginedScene, clause: str) -> Iterator[PlanStep]:
    match, kind = next(
        ((found, kind) for pattern, kind in _WORDED_STEPS if (found := pattern.match(clause))), (None, "")
    )
    if match is None:
        remedy = "an edit is a plan as JSON or YAML, or: open, close, put … on|in …, wait 2 s, attach … to …, detach …"
        raise InvalidArgumentError("edit", cause=f"{clause!r} is no step", remedy=remedy)
    words = match.groupdict()
    match kind:
        case "open" | "close":
            part = _find(kb, scene, words["part"])
            joints = scene.joints_of_part(part)
            if not joints:
                raise InvalidArgumentError("edit", cause=f"{local_name(part)} is no door or drawer, and has none")
            fraction = _number(words.get("percent") or "100", "percentage") / 100.0
            if fraction > 1.0:
                raise InvalidArgumentError("edit", cause=f"{words['percent']} % is too much", remedy="up to 100 %")
            for joint in joints:
                yield Open(thing=joint.id, fraction=fraction) if kind == "open" else Close(thing=joint.id)
        case "place":
            holder = _body_id(scene, _find(kb, scene, words["holder"]))
            thing = _thing_or_class(kb, scene, words["thing"])
            into = words["how"].lower().startswith("in")
            yield Place(thing=thing, into=holder) if into else Place(thing=thing, on=holder)
        case "wait":
            yield Wait(duration_s=_number(words["duration"], "duration"))
        case "attach":
            parent, child = (_body_id(scene, _find(kb, scene, words[name])) for name in ("parent", "child"))
            yield Attach(parent=parent, child=child)
        case _:
            yield Detach(child=_body_id(scene, _find(kb, scene, words["child"])))


def _number(text: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not value > 0.0:
        raise InvalidArgumentError("edit", cause=f"{text!r} is no {what}", remedy="give a number")
    return value


def _body_id(scene: ImaginedScene, iri: Iri) -> BodyId:
    body = scene.bodies.get(iri)
    if body is None:
        raise InvalidArgumentError("edit", cause=f"{local_name(iri)} is no body of {local_name(scene.map)}")
    return body.id


def _thing_or_class(kb: QuestionContext, scene: ImaginedScene, words: str) -> str:
    """The id of a body, or the name of a class of which there is none."""
    try:
        return _body_id(scene, _find(kb, scene, words))
    except NameNotFoundError:
        with kb.lock:
            return kb.names.find_thing(_ARTICLES.sub("", words), EntityType.CLASS).iri


def _find(kb: QuestionContext, scene: ImaginedScene, words: str) -> Iri:
    """The body or joint of this world that words name; a class stands for its only individual there."""
    name = _ARTICLES.sub("", words).strip()
    known: Sequence[Body | Joint] = (*scene.state.world.bodies, *scene.state.world.joints)
    if exact := next((each.iri for each in known if name in {each.id, each.iri}), None):
        return exact
    with kb.lock:
        found = kb.names.find_thing(name, EntityType.INDIVIDUAL)
    here = {each.iri for each in known}
    members = [iri for iri in (found.members if found.members is not None else (found.iri,)) if iri in here]
    if len(members) > 1:
        raise AmbiguousNameError(name, entity_type="individual", candidates=members)
    if not members:
        raise NameNotFoundError(name, entity_type="body or joint", known=[each.id for each in known])
    return members[0]
