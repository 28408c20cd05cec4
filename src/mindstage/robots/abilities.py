"""Questions about abilities: which actions a robot is able to do, and what is missing for the others.

An action needs the capabilities and components that its class, a superclass or one of its sub-actions states (SRDL's
`dependsOnCapability` and `dependsOnComponent`). A capability is available if it is stated for the robot or its class,
or if all that it depends on is available. Unlike in SRDL, one that depends on nothing is not available for that.

The statements are those of all loaded ontologies and of the bundled `robots.ttl`. A robot is one of the running
simulation, an individual of a loaded self-model, or a model of the catalog.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache
from typing import NamedTuple

from mindstage.errors import KnowledgeError, RobotNotFoundError, suggestion
from mindstage.knowledge.claims import Claim, ClaimKind
from mindstage.knowledge.names import EntityType
from mindstage.knowledge.questions import (
    AnswerRow,
    AskedArguments,
    ClassName,
    MissingKnowledge,
    QuestionContext,
    StateAccess,
    question,
)
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import knowrob, ms
from mindstage.robots.models.catalog import list_models
from mindstage.robots.models.reading import load_model
from mindstage.robots.models.robot_model import BaseType, GripperType, RobotComponent, RobotModel, SensorType
from mindstage.robots.self_models import (
    ROBOT_CLASS,
    ClassRules,
    annotation_values,
    bundled_rules,
    capability_class,
    component_class,
    describe_robot,
    find_robots,
)
from mindstage.scene import Iri

__all__ = [
    "AbilityRow",
    "LackRow",
    "RequirementKind",
    "RobotProfile",
    "can",
    "missing_for_action",
    "profile_of_model",
]

_ON_CAPABILITY, _ON_COMPONENT = capability_class("dependsOnCapability"), component_class("dependsOnComponent")
_SUB_ACTION, _SKILL = knowrob("subAction"), ms("skill")
_ACTION = knowrob("Action")
_NO_ACTIONS = frozenset({capability_class("Capability"), component_class("Component")})
_SHOWN_NAMES = 5
"""Number of classes that a hint names at most."""


class RequirementKind(StrEnum):
    """What an action or a capability depends on."""

    CAPABILITY = "capability"
    COMPONENT = "component"


class RobotProfile(NamedTuple):
    """What is relevant to the abilities of one robot."""

    name: str
    components: tuple[RobotComponent, ...]
    capabilities: tuple[Iri, ...]
    source: str
    """Where this is stated."""


# -- what a model has --------------------------------------------------------------------------------------------------

_SENSORS: Mapping[SensorType, Iri] = {
    SensorType.CAMERA: component_class("Camera"),
    SensorType.DEPTH_CAMERA: ms("DepthCamera"),
    SensorType.LASER_SCANNER: component_class("LaserScanner"),
    SensorType.FORCE_TORQUE: ms("ForceTorqueSensor"),
    SensorType.IMU: component_class("InertialSensor"),
}
_BASES: Mapping[BaseType, Iri] = {
    BaseType.PLANAR: component_class("HolonomicBase"),
    BaseType.DIFFERENTIAL: component_class("WheeledBase"),
}
_SIMULATED = ("SemanticEnvironmentMap", "CollisionMap", "ObjectRecognitionComponent", "LocalizationComponent")
"""The software that every simulated robot has: the poses of all bodies are known."""


def profile_of_model(model: RobotModel, *, name: str = "", source: str = "its model") -> RobotProfile:
    """The components of a robot that is simulated here, and what a self-model has added to its model."""

    def part(name: str, cls: Iri, *links: str) -> RobotComponent:
        return RobotComponent(name=name, classes=(cls,), links=links)

    found = [part(arm.name, component_class("ArmComponent"), arm.base_link, arm.tip_link) for arm in model.arms]
    found += [part(f"{arm.name}_controller", component_class("ArmMotionController")) for arm in model.arms]
    for gripper in model.grippers:
        if gripper.max_opening_m <= 0.0:  # nothing fits between its fingers, as far as its model is understood
            continue
        is_parallel = gripper.type is GripperType.PARALLEL
        cls = component_class("GripperComponent" if is_parallel else "HandComponent")
        found += [part(gripper.name, cls, gripper.link), part(f"{gripper.name}_controller", _GRASP_CONTROLLER)]
    if model.base.type in _BASES:
        found += [part("base", _BASES[model.base.type], model.base.link)]
        found += [part("navigation", component_class("NavigationComponent"))]
    if model.head is not None:
        found.append(part("head", ms("MovableHead"), model.head.link))
    found += [part(sensor.name, _SENSORS[sensor.type], sensor.link) for sensor in model.sensors]
    found += [part(f"simulated {each}", component_class(each)) for each in _SIMULATED]
    return RobotProfile(name or model.name, (*found, *model.components), model.capabilities, source)


_GRASP_CONTROLLER = component_class("GraspController")


# -- what actions need -------------------------------------------------------------------------------------------------


class _Requirement(NamedTuple):
    kind: RequirementKind
    classes: tuple[Iri, ...]
    """One of these is enough."""
    stated_by: Iri


class _Lack(NamedTuple):
    kind: RequirementKind
    cls: Iri
    needed_by: Iri
    """The action or capability that depends on it."""
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class _Rules:
    """What depends on what, of all loaded ontologies."""

    classes: ClassRules
    needs: Mapping[Iri, tuple[_Requirement, ...]]
    sub_actions: Mapping[Iri, tuple[Iri, ...]]
    skills: Mapping[Iri, str]
    _above: dict[Iri, tuple[Iri, ...]] = field(default_factory=dict)

    @classmethod
    def of(cls, kb: QuestionContext) -> _Rules:
        """The rules of a knowledge base, which are kept until its statements change."""
        return kb.cached(("abilities",), lambda: cls._collect(kb))

    @classmethod
    def _collect(cls, kb: QuestionContext) -> _Rules:
        classes = bundled_rules(kb.reasoner)
        needs: dict[Iri, list[_Requirement]] = {}
        for kind, property in (
            (RequirementKind.CAPABILITY, _ON_CAPABILITY),
            (RequirementKind.COMPONENT, _ON_COMPONENT),
        ):
            for owner, filler in classes.restrictions(property):
                each = [_Requirement(kind, group, owner) for group in classes.alternatives(filler)]
                needs.setdefault(owner, []).extend(each)
        subs: dict[Iri, list[Iri]] = {}
        for owner, filler in classes.restrictions(_SUB_ACTION):
            subs.setdefault(owner, []).extend(named for group in classes.alternatives(filler) for named in group)
        return cls(
            classes,
            {owner: tuple(dict.fromkeys(found)) for owner, found in needs.items()},
            {owner: tuple(dict.fromkeys(found)) for owner, found in subs.items()},
            annotation_values(_SKILL, kb),
        )

    def above(self, cls: Iri) -> tuple[Iri, ...]:
        """The class and its superclasses, the nearest first."""
        if cls not in self._above:
            self._above[cls] = tuple(self.classes.above(cls))
        return self._above[cls]

    def requirements(self, cls: Iri) -> Iterator[_Requirement]:
        """What a class depends on, by itself or as a subclass; of an action also what its sub-actions depend on."""
        seen: set[_Requirement] = set()
        done, waiting = {cls}, [cls]
        for here in waiting:
            for owner in self.above(here):
                for each in self.needs.get(owner, ()):
                    if each not in seen:
                        seen.add(each)
                        yield each
                for sub in self.sub_actions.get(owner, ()):
                    if sub not in done:
                        done.add(sub)
                        waiting.append(sub)

    def skill(self, action: Iri) -> str:
        """The skill that performs an action; empty if there is none."""
        return next((self.skills[each] for each in self.above(action) if each in self.skills), "")

    def known_actions(self) -> list[Iri]:
        """The actions that state what they need."""
        stating = {*self.needs, *self.sub_actions}
        return sorted(cls for cls in stating if _NO_ACTIONS.isdisjoint(self.above(cls)))

    def lacks(self, robot: RobotProfile, cls: Iri, *, done: frozenset[Iri] = frozenset()) -> Iterator[_Lack]:
        """What a robot lacks for an action or a capability; the innermost reasons only."""
        for need in self.requirements(cls):
            if need.kind is RequirementKind.COMPONENT:
                if not any(self.components(robot, each) for each in need.classes):
                    names = " or ".join(map(local_name, need.classes))
                    yield _Lack(need.kind, need.classes[0], need.stated_by, f"it has no {names}")
            else:
                yield from self._missing_capability(robot, need, done | {cls})

    def _missing_capability(self, robot: RobotProfile, need: _Requirement, done: frozenset[Iri]) -> Iterator[_Lack]:
        """Nothing if one of the capabilities is available, else what is missing for the first one."""
        first: list[_Lack] = []
        for number, cls in enumerate(need.classes):
            if self.is_stated(robot, cls) or cls in done:
                return
            if not any(True for _ in self.requirements(cls)):
                reason = f"it is not stated to have {local_name(cls)}, and nothing states what that depends on"
                lacks = [_Lack(RequirementKind.CAPABILITY, cls, need.stated_by, reason)]
            else:
                lacks = list(self.lacks(robot, cls, done=done))
            if not lacks:
                return
            first = lacks if number == 0 else first
        yield from first

    def is_stated(self, robot: RobotProfile, capability: Iri) -> bool:
        """Whether a capability, or a more specific one, is stated for the robot."""
        return any(capability in self.above(each) for each in robot.capabilities)

    def components(self, robot: RobotProfile, cls: Iri) -> list[str]:
        """The names of the robot's components of a class."""
        return [each.name for each in robot.components if any(cls in self.above(own) for own in each.classes)]

    def used_components(self, robot: RobotProfile, cls: Iri, done: frozenset[Iri] = frozenset()) -> dict[str, None]:
        """The components that an action or a capability is done with."""
        found: dict[str, None] = {}
        for need in self.requirements(cls):
            for each in need.classes:
                if need.kind is RequirementKind.COMPONENT:
                    found |= dict.fromkeys(self.components(robot, each))
                elif each not in done:
                    found |= self.used_components(robot, each, done | {cls, each})
        return found


# -- robots ------------------------------------------------------------------------------------------------------------


def _profiles(kb: QuestionContext, present: StateAccess, name: str | None) -> Iterator[RobotProfile]:
    """The robots of a question: of that name, or all that are running or described.

    Raises:
        RobotNotFoundError: there is none of that name.
    """
    running = getattr(present.simulation, "robots", {})
    models = {
        id: model for id, robot in running.items() if isinstance(model := getattr(robot, "model", None), RobotModel)
    }
    described = find_robots(kb.reasoner) if name is None else _described(kb, name)
    if name is None:
        for id, model in models.items():
            yield profile_of_model(model, name=id, source="the running simulation")
        for iri in described:
            yield _profile_of_individual(kb, iri, local_name(iri))
    elif name in models:
        yield profile_of_model(models[name], name=name, source="the running simulation")
    elif described:
        yield _profile_of_individual(kb, described[0], name)
    else:
        yield _profile_of_catalog(name, known=[*models, *map(local_name, find_robots(kb.reasoner))])


def _described(kb: QuestionContext, name: str) -> list[Iri]:
    """The individual of that name, if it is a robot."""
    try:
        iri = kb.names.find(name, EntityType.INDIVIDUAL)
    except KnowledgeError:
        return []
    return [iri] if iri in find_robots(kb.reasoner) else []


def _profile_of_individual(kb: QuestionContext, iri: Iri, name: str) -> RobotProfile:
    found = describe_robot(kb.reasoner, iri)
    return RobotProfile(name, found.components, found.capabilities, f"the self-model of {local_name(iri)}")


def _profile_of_catalog(name: str, *, known: list[str]) -> RobotProfile:
    """The profile of a model that is known by name; paths of descriptions are not read, since anyone may ask.

    Raises:
        RobotNotFoundError: there is no robot, individual or model of that name, or its package is not installed.
    """
    names = [each.name for each in list_models()]
    if name not in names:
        raise RobotNotFoundError(name, remedy=suggestion(name, [*known, *names]))
    return _known_profile(name)


@cache
def _known_profile(name: str) -> RobotProfile:
    return profile_of_model(load_model(name, xacro=False), name=name, source="the model of that name")


# -- questions ---------------------------------------------------------------------------------------------------------


class AbilityRow(AnswerRow, frozen=True, kw_only=True):
    """An action that a robot is able to do."""

    default_column = "action"

    robot: str
    action: ClassName
    skill: str
    """The skill that performs it; empty if there is none."""
    components: tuple[str, ...]
    """The components that it is done with."""
    source: str
    """Where the components and capabilities of the robot are stated."""


@question(
    sentences=(
        "what can (i|robot) do",
        "what (is|are) (i|robot) able to do",
        "which (action|task|skill) can (i|robot) (do|perform)",
        "can (i|robot) (do|perform) {action}",
        "(is|am) (i|robot) able to (do|perform) {action}",
    )
)
def can(
    kb: QuestionContext, robot: str | None = None, action: ClassName | None = None, *, present: StateAccess
) -> Iterator[AbilityRow]:
    """Which actions a robot is able to do, by its components and capabilities.

    An action is possible if everything that its class, its superclasses and its sub-actions depend on is available. It
    is not tried: whether something is in reach is no matter of knowledge. `robot` is the name of a robot of the running
    simulation, of a self-model that is loaded, or of the catalog; without it, all robots of the first two kinds.

    Examples:
        can mobile_manipulator
        can mobile_manipulator OpeningADrawer
        can panda PickingUpAnObject
    """
    rules = _Rules.of(kb)
    for profile in _profiles(kb, present, robot):
        for each in rules.known_actions() if action is None else (action,):
            stated = any(True for _ in rules.requirements(each))
            if stated and not any(True for _ in rules.lacks(profile, each)):
                yield AbilityRow(
                    robot=profile.name,
                    action=each,
                    skill=rules.skill(each),
                    components=tuple(rules.used_components(profile, each)),
                    source=profile.source,
                )


@can.explain
def _explain_ability(kb: QuestionContext, row: AbilityRow) -> Iterator[str]:
    rules = _Rules.of(kb)
    for need in rules.requirements(row.action):
        names = " or ".join(map(local_name, need.classes))
        yield f"{local_name(need.stated_by)} depends on the {need.kind} {names}"
    if row.components:
        yield f"{row.robot} has {', '.join(row.components)}, by {row.source}"


@can.missing
def _missing_ability(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    rules = _Rules.of(kb)
    profiles = list(_profiles(kb, asked.present, asked.robot))
    if (unknown := _unknown(rules, profiles, asked.action)) is not None:
        yield unknown
        return
    for profile in profiles:
        for each in rules.known_actions() if asked.action is None else (asked.action,):
            for lack in rules.lacks(profile, each):
                reason = f"{profile.name} cannot do {local_name(each)}: {lack.reason}"
                if lack.needed_by != each:
                    reason += f", on which {local_name(lack.needed_by)} depends"
                property = _ON_COMPONENT if lack.kind is RequirementKind.COMPONENT else _ON_CAPABILITY
                yield MissingKnowledge(lack.cls, property, reason, is_filler=True)


def _unknown(rules: _Rules, profiles: Sequence[RobotProfile], action: Iri | None) -> MissingKnowledge | None:
    """What is missing to ask about any ability: a robot, or a statement about what the action needs."""
    if not profiles:
        return _no_robot()
    if action is not None and not any(True for _ in rules.requirements(action)):
        return _unstated(rules, action)
    return None


def _no_robot() -> MissingKnowledge:
    reason = "no robot is in the simulation, and no self-model is loaded; give robot, such as robot=mobile_manipulator"
    claim = Claim(kind=ClaimKind.NO_INSTANCE, object=ROBOT_CLASS)
    return MissingKnowledge(ROBOT_CLASS, component_class("subComponent"), reason, claims=(claim,))


def _unstated(rules: _Rules, action: Iri) -> MissingKnowledge:
    """The missing statement about what an action needs, with subclasses that state it."""
    narrower = [each for each in rules.known_actions() if action in rules.above(each)][:_SHOWN_NAMES]
    hint = f"; ask about {', '.join(map(local_name, narrower))}" if narrower else ""
    reason = f"nothing states what {local_name(action)} needs of a robot{hint}"
    absent = (
        Claim(kind=ClaimKind.NO_RESTRICTION, subject=action, property=property)
        for property in (_ON_CAPABILITY, _ON_COMPONENT)
    )
    return MissingKnowledge(action, _ON_CAPABILITY, reason, claims=tuple(absent))


class LackRow(AnswerRow, frozen=True, kw_only=True):
    """Something that a robot lacks for an action."""

    default_column = "missing"

    robot: str
    action: ClassName
    missing: ClassName
    """The class of the component or the capability."""
    kind: RequirementKind
    needed_by: ClassName
    """The action, sub-action or capability that depends on it."""
    source: str


@question(
    sentences=(
        "what (is missing|does robot lack|do i lack) for {action}",
        "what does robot (need|lack) to (do|perform) {action}",
        "why (can not|cannot|can t) (i|robot) (do|perform) {action}",
    )
)
def missing_for_action(
    kb: QuestionContext, robot: str | None = None, action: ClassName | None = None, *, present: StateAccess
) -> Iterator[LackRow]:
    """Which components and capabilities a robot lacks for an action, or for each action that it is not able to do.

    What can be followed further is: a capability is named only if nothing states what it depends on. For `robot` see
    `can`.

    Examples:
        missing_for_action panda GoingSomewhere
        missing_for_action panda
    """
    rules = _Rules.of(kb)
    for profile in _profiles(kb, present, robot):
        for each in rules.known_actions() if action is None else (action,):
            for lack in dict.fromkeys(rules.lacks(profile, each)):
                yield LackRow(
                    robot=profile.name,
                    action=each,
                    missing=lack.cls,
                    kind=lack.kind,
                    needed_by=lack.needed_by,
                    source=profile.source,
                )


@missing_for_action.explain
def _explain_lack(kb: QuestionContext, row: LackRow) -> Iterator[str]:
    rules = _Rules.of(kb)
    if row.needed_by != row.action:
        yield f"{local_name(row.action)} needs what {local_name(row.needed_by)} needs"
    yield f"{local_name(row.needed_by)} depends on the {row.kind} {local_name(row.missing)}"
    narrower = list(rules.classes.children(row.missing))[:_SHOWN_NAMES]
    kinds = f", nor a {' or '.join(map(local_name, narrower))}" if narrower else ""
    yield f"{row.source} states no {local_name(row.missing)}{kinds}"


@missing_for_action.missing
def _missing_lack(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    rules = _Rules.of(kb)
    profiles = list(_profiles(kb, asked.present, asked.robot))
    if (unknown := _unknown(rules, profiles, asked.action)) is not None:
        yield unknown
        return
    what = "every action that is described" if asked.action is None else local_name(asked.action)
    names = ", ".join(profile.name for profile in profiles)
    yield MissingKnowledge(asked.action or _ACTION, _ON_COMPONENT, f"nothing: {names} is able to do {what}")
