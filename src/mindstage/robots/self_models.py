"""Self-models of robots in OWL, in the terms of KnowRob's SRDL: which components and capabilities a robot has.

A self-model names the links and joints of a URDF, groups of links such as an arm, sensors, software, and capabilities,
either of the robot or of its class. Its terms are those of `knowrob_srdl` (srdl2-comp.owl, srdl2-cap.owl); they need
not be loaded, since the bundled `robots.ttl` restates them.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from functools import cache

import msgspec

from mindstage.errors import RobotModelError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.owl import Expression, LiteralValue, UnionOf, named_classes
from mindstage.knowledge.questions import QuestionContext
from mindstage.knowledge.reasoner import Reasoner
from mindstage.maps.io.files import robot_ontology
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import knowrob
from mindstage.robots.models.grippers import analyze_gripper
from mindstage.robots.models.link_tree import LinkTree
from mindstage.robots.models.robot_model import (
    Arm,
    BaseType,
    Gripper,
    ModelNote,
    RobotComponent,
    RobotJoint,
    RobotModel,
)
from mindstage.scene import Iri, Literal

__all__ = [
    "ROBOT_CLASS",
    "ClassRules",
    "SelfModel",
    "add_self_model",
    "annotation_values",
    "bundled_rules",
    "capability_class",
    "component_class",
    "describe_robot",
    "find_robots",
    "read_self_model",
]

ROBOT_CLASS = knowrob("Robot")
_COMPONENTS = "http://knowrob.org/kb/srdl2-comp.owl#"
_CAPABILITIES = "http://knowrob.org/kb/srdl2-cap.owl#"


def component_class(name: str) -> Iri:
    """The IRI of a name in the namespace of SRDL's components."""
    return Iri(_COMPONENTS + name)


def capability_class(name: str) -> Iri:
    """The IRI of a name in the namespace of SRDL's capabilities."""
    return Iri(_CAPABILITIES + name)


_HAS_CAPABILITY = capability_class("hasCapability")
_STEPS = tuple(
    component_class(name) for name in ("subComponent", "successorInKinematicChain", "succeedingLink", "succeedingJoint")
)
"""The properties from a component to those that it consists of, or that follow it."""
_BASE_LINK, _END_LINK = component_class("baseLinkOfComposition"), component_class("endLinkOfComposition")
_URDF_NAME = component_class("urdfName")
_URDF_COMPONENT = component_class("UrdfComponent")
_ARM, _BASE = component_class("ArmComponent"), component_class("MobileBase")
_END_EFFECTOR = component_class("ManipulationEntity")
_STRUCTURE = frozenset(component_class(name) for name in ("ComponentComposition", "HardwareComponent", "Component"))
"""Classes that state nothing about what a component is good for."""


class SelfModel(msgspec.Struct, frozen=True, kw_only=True):
    """What an ontology states about a robot."""

    iri: Iri
    name: str
    """The local name of its IRI."""
    classes: tuple[Iri, ...]
    components: tuple[RobotComponent, ...]
    """Groups of links, sensors and software; not the links and joints themselves."""
    capabilities: tuple[Iri, ...]
    """The classes of the capabilities that are stated for it, or for its class."""
    source: str = ""
    """The path of the file; empty if it was read from a knowledge base."""


class ClassRules:
    """The classes of several reasoners as one hierarchy, with their restrictions."""

    def __init__(self, reasoners: Sequence[Reasoner]) -> None:
        self._reasoners = tuple(reasoners)

    def above(self, cls: Iri) -> dict[Iri, None]:
        """The class and its superclasses, the nearest first."""
        found, waiting = {cls: None}, [cls]
        for here in waiting:
            for parent in self._parents(here):
                if parent not in found:
                    found[parent] = None
                    waiting.append(parent)
        return found

    def children(self, cls: Iri) -> dict[Iri, None]:
        """The direct subclasses."""
        return dict.fromkeys(child for reasoner in self._reasoners for child in reasoner.classes.children(cls))

    def is_a(self, cls: Iri, ancestor: Iri) -> bool:
        """Whether a class is another class or one of its subclasses."""
        return ancestor in self.above(cls)

    def restrictions(self, property: Iri) -> Iterator[tuple[Iri, Expression]]:
        """The classes that need a value of a property, and the class of that value."""
        seen = set()
        for reasoner in self._reasoners:
            for owned in reasoner.restrictions_on(property):
                filler = owned.restriction.filler
                if owned.restriction.implies_existence() and filler is not None and (owned.cls, filler) not in seen:
                    seen.add((owned.cls, filler))
                    yield owned.cls, filler

    def alternatives(self, filler: Expression) -> tuple[tuple[Iri, ...], ...]:
        """What a filler needs: each group of classes of which one is enough."""
        if isinstance(filler, UnionOf):
            return (tuple(named_classes(filler)),)
        return tuple((cls,) for cls in named_classes(filler))

    def _parents(self, cls: Iri) -> Iterator[Iri]:
        for reasoner in self._reasoners:
            yield from reasoner.classes.parents(cls)


@cache
def _bundled_knowledge() -> KnowledgeBase:
    knowledge = KnowledgeBase()
    knowledge.load((), ontologies=robot_ontology())
    return knowledge


def bundled_rules(reasoner: Reasoner | None = None) -> ClassRules:
    """The bundled ontologies' classes, with those of another reasoner."""
    bundled = _bundled_knowledge()
    with bundled.lock:
        own = bundled.reasoner
    return ClassRules((own,) if reasoner is None else (reasoner, own))


def annotation_values(property: Iri, knowledge: QuestionContext) -> dict[Iri, str]:
    """The text that a property has for each subject, in a knowledge base and in the bundled ontologies."""
    bundled = _bundled_knowledge()
    with bundled.lock:
        statements = [*bundled.statements(property=property), *knowledge.statements(property=property)]
    return {subject: each.value.text for subject, each in statements if isinstance(each.value, Literal)}


# -- reading -----------------------------------------------------------------------------------------------------------


def read_self_model(path: str | os.PathLike[str], *, name: str = "") -> SelfModel:
    """Reads the self-model of a robot.

    Args:
        path: an OWL file; imports that are not found are left out.
        name: the local name or IRI of the robot, if the file describes several.

    Raises:
        RobotModelError: it describes no robot, several, or none of that name.
        SourceError: it cannot be read.
    """
    knowledge = KnowledgeBase()
    knowledge.load((), ontologies=[os.fspath(path), str(robot_ontology())])
    with knowledge.lock:
        reasoner = knowledge.reasoner
        found = find_robots(reasoner)
        wanted = [iri for iri in found if name in {"", iri, local_name(iri)}]
        if len(wanted) != 1:
            names = ", ".join(map(local_name, found))
            if not found:
                cause = "it describes no robot"
                remedy = "an individual has to be a knowrob:Robot, or to have components of SRDL"
            else:
                cause = f"it describes no robot {name!r}" if name else "it describes several robots"
                remedy = f"name one of {names}"
            raise RobotModelError(os.fspath(path), cause=cause, remedy=remedy)
        return msgspec.structs.replace(describe_robot(reasoner, wanted[0]), source=os.fspath(path))


def find_robots(reasoner: Reasoner) -> list[Iri]:
    """The individuals that are robots, or are at the top of a kinematic chain."""
    rules = bundled_rules(reasoner)
    robots = [iri for iri, types in reasoner.types.items() if any(rules.is_a(cls, ROBOT_CLASS) for cls in types)]
    if robots:
        return sorted(robots)
    owners = {each for step in _STEPS for each in reasoner.properties.candidate_subjects(step)}
    parts = {each for owner in owners for step in _STEPS for each in reasoner.properties.values(step, owner)}
    compositions = {each for each in owners if reasoner.properties.values(_BASE_LINK, each)}
    return sorted(owners - parts - compositions)


def describe_robot(reasoner: Reasoner, robot: Iri) -> SelfModel:
    """What is stated about a robot, an individual."""
    rules = bundled_rules(reasoner)
    types = reasoner.types_of(robot)
    capabilities = dict.fromkeys(
        cls
        for value in reasoner.properties.values(_HAS_CAPABILITY, robot)
        for cls in ((value,) if reasoner.is_class(value) else reasoner.types_of(value) or (value,))
    )
    own_classes = {above for cls in types for above in rules.above(cls)}
    for owner, filler in rules.restrictions(_HAS_CAPABILITY):
        if owner in own_classes:
            capabilities |= dict.fromkeys(named_classes(filler))
    components = []
    for part in _parts(reasoner, robot):
        classes = tuple(cls for cls in reasoner.types_of(part) if _says_something(rules, cls))
        if classes:
            components.append(RobotComponent(name=local_name(part), classes=classes, links=_links(reasoner, part)))
    return SelfModel(
        iri=robot,
        name=local_name(robot),
        classes=tuple(types),
        components=tuple(components),
        capabilities=tuple(sorted(capabilities)),
    )


def _parts(reasoner: Reasoner, robot: Iri) -> list[Iri]:
    """The components of a robot, those of its components included."""
    seen, waiting = {robot}, [robot]
    for here in waiting:
        for step in (*_STEPS, _BASE_LINK):
            for part in sorted(reasoner.properties.values(step, here)):
                if part not in seen:
                    seen.add(part)
                    waiting.append(part)
    return waiting[1:]


def _says_something(rules: ClassRules, cls: Iri) -> bool:
    return cls not in _STRUCTURE and not rules.is_a(cls, _URDF_COMPONENT) and not cls.endswith("#NamedIndividual")


def _links(reasoner: Reasoner, part: Iri) -> tuple[str, ...]:
    """The names in the URDF of the links that bound a composition; of a link itself, its own."""
    ends = [
        *sorted(reasoner.properties.values(_BASE_LINK, part)),
        *sorted(reasoner.properties.values(_END_LINK, part)),
    ]
    if ends:
        return tuple(_urdf_name(reasoner, each) or local_name(each) for each in ends)
    own = _urdf_name(reasoner, part)
    return (own,) if own else ()


def _urdf_name(reasoner: Reasoner, link: Iri) -> str:
    for value, _ in reasoner.properties.values_with_paths(_URDF_NAME, link):
        if isinstance(value, LiteralValue):
            return value.literal.text
    return ""


# -- joining it with a description -------------------------------------------------------------------------------------


def add_self_model(model: RobotModel, self_model: SelfModel) -> RobotModel:
    """Adds to a model what an ontology states about the robot: components, capabilities, arms and grippers it lacks.

    An arm is a group of links of the class `ArmComponent`; its joints are those from the joint that moves the first
    link to the last link. A gripper is a group of the class `ManipulationEntity`, whose first link carries the fingers.
    What does not agree with the description becomes a note.

    Args:
        model: the model, from a URDF or another description.
        self_model: the self-model of the same robot.
    """
    rules = bundled_rules()
    links = {link.name for link in model.links}
    notes = list(model.notes)
    known: list[RobotComponent] = []
    for component in self_model.components:
        if unknown := [link for link in component.links if link not in links]:
            text = f"the self-model's {component.name} has links that the description lacks: {', '.join(unknown)}"
            notes.append(ModelNote(subject=component.name, text=text, is_guess=False))
        elif component.links:
            known.append(component)
    grippers = list(model.grippers)
    for component in known:
        if _is_a(rules, component, _END_EFFECTOR) and not _has_gripper(model, grippers, component):
            grippers += _gripper_of(model, component, notes)
    arms = [_with_gripper(model, arm, grippers) for arm in model.arms]
    for component in known:
        if _is_a(rules, component, _ARM) and len(component.links) > 1:
            arms += _missing_arm(model, component, grippers, arms, notes)
    stated_mobile = any(_is_a(rules, each, _BASE) for each in self_model.components)
    if stated_mobile and model.base.type is BaseType.FIXED:
        text = "the self-model states a mobile base, and the description a fixed one"
        notes.append(ModelNote(subject="", text=text, is_guess=False))
    return msgspec.structs.replace(
        model,
        arms=tuple(arms),
        grippers=tuple(grippers),
        notes=tuple(notes),
        components=(*model.components, *self_model.components),
        capabilities=tuple(dict.fromkeys((*model.capabilities, *self_model.capabilities))),
    )


def _is_a(rules: ClassRules, component: RobotComponent, cls: Iri) -> bool:
    return any(rules.is_a(each, cls) for each in component.classes)


def _has_gripper(model: RobotModel, grippers: Iterable[Gripper], component: RobotComponent) -> bool:
    below = _below(model, component.links[0])
    return any(gripper.link in below for gripper in grippers)


def _gripper_of(model: RobotModel, component: RobotComponent, notes: list[ModelNote]) -> list[Gripper]:
    """The gripper that a group of links is, if its fingers have drives and shapes."""
    palm = component.links[0]
    below = _below(model, palm)
    joints = [joint for joint in model.joints if joint.is_movable and joint.parent in below]
    tree = LinkTree(model.links, model.joints)
    found = analyze_gripper(tree, component.name, palm, joints, notes) if joints else None
    if found is None:
        text = "it is a gripper in the self-model, but no joint beyond its first link moves fingers with shapes"
        notes.append(ModelNote(subject=component.name, text=text, is_guess=False))
    return [] if found is None else [found]


def _with_gripper(model: RobotModel, arm: Arm, grippers: Sequence[Gripper]) -> Arm:
    """The arm with the gripper beyond its tip."""
    below = _below(model, arm.tip_link)
    found = next((each.name for each in grippers if each.link in below), None)
    return arm if arm.gripper is not None else msgspec.structs.replace(arm, gripper=found)


def _missing_arm(
    model: RobotModel,
    component: RobotComponent,
    grippers: Sequence[Gripper],
    arms: Sequence[Arm],
    notes: list[ModelNote],
) -> list[Arm]:
    """The arm from the first link of a group to that of its last links to which most drives lead, if it is new."""
    base, *ends = component.links
    chains = {end: _chain(model, base, end) for end in ends}
    tip = max(chains, key=lambda end: (len(_actuated(chains[end])), -ends.index(end)))
    joints = tuple(joint.name for joint in _actuated(chains[tip]))
    if not joints:
        text = "no joint of the self-model's arm has a drive"
        notes.append(ModelNote(subject=component.name, text=text, is_guess=False))
    if not joints or any(set(joints) <= set(arm.joints) for arm in arms):
        return []
    arm = Arm(name=component.name, joints=joints, base_link=chains[tip][0].parent, tip_link=tip)
    return [_with_gripper(model, arm, grippers)]


def _chain(model: RobotModel, base: str, end: str) -> list[RobotJoint]:
    """The joints from the one that moves the base link to the end link; empty if that is not below it."""
    by_child = {joint.child: joint for joint in model.joints}
    chain: list[RobotJoint] = []
    link = end
    while link in by_child:
        chain.insert(0, by_child[link])
        if link == base:
            return chain
        link = by_child[link].parent
    return chain if link == base else []


def _actuated(joints: Iterable[RobotJoint]) -> list[RobotJoint]:
    return [joint for joint in joints if joint.is_actuated]


def _below(model: RobotModel, link: str) -> set[str]:
    """The link and those that its joints carry."""
    found = {link}
    for joint in model.joints:  # parents come before their children
        if joint.parent in found:
            found.add(joint.child)
    return found
