"""What the reasons for missing answers state: each claim is checked against the statements, without the reasoner."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from itertools import combinations, permutations, product
from pathlib import Path
from random import Random

import mujoco
import numpy as np
import pyoxigraph as ox
import pytest
from scipy.spatial import ConvexHull, Delaunay
from scipy.spatial.transform import Rotation

from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.claims import Claim, ClaimKind
from mindstage.knowledge.names import EntityType
from mindstage.knowledge.queries import MissingKnowledge, Question, get_question, list_questions
from mindstage.maps import bundled_kitchen
from mindstage.maps.rdf_mapping.nested import NESTED_RESOURCES
from mindstage.scene import Body, BodyId, Iri, World
from tests.cases import each_case
from tests.maps.small_maps import KNOWROB, OWL, RDFS, body_turtle, knowledge_base_from, room_map

TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"
FIRST, REST = (f"http://www.w3.org/1999/02/22-rdf-syntax-ns#{name}" for name in ("first", "rest"))
DUL = "http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#"
SOMA = "http://www.ease-crc.org/ont/SOMA.owl#"
DESCRIBED_IN_MAP = KNOWROB + "describedInMap"
TO_PARTS = [KNOWROB + name for name in ("child", "parts", "physicalParts", "properPhysicalParts")]
TO_PARTS += [DUL + "hasPart", DUL + "hasProperPart", DUL + "hasComponent", SOMA + "hasPhysicalComponent"]
TO_WHOLES = [KNOWROB + "parent", DUL + "isPartOf", DUL + "isComponentOf", SOMA + "isPhysicalComponentOf"]
QUALIFIED = ("qualifiedCardinality", "minQualifiedCardinality", "cardinality", "minCardinality")
ARGUMENTS_ARE_MISSING = ("give ", "the frame viewer needs")
"""Beginnings of reasons that state no fact: the question needs more arguments."""


class Statements:
    """The statements of a knowledge base, and what follows from them by the definitions of OWL, computed anew."""

    def __init__(self, kb: KnowledgeBase) -> None:
        self.kb = kb
        self.values: dict[str, dict[str, set[str]]] = {}
        self.inverse: dict[str, dict[str, set[str]]] = {}
        for quad in kb.store.quads_for_pattern(None, None, None):
            one, other = name_of(quad.subject), name_of(quad.object)
            self.values.setdefault(quad.predicate.value, {}).setdefault(one, set()).add(other)
            self.inverse.setdefault(quad.predicate.value, {}).setdefault(other, set()).add(one)
        self.nested = {str(part.cls) for part in NESTED_RESOURCES}
        self.superclasses: dict[str, set[str]] = {}
        self.worlds = [(map, kb.world(map)) for map in sorted(kb.reasoner.members_by_map) if kb.maps().count(map)]

    def bodies(self, claim: Claim) -> list[Body]:
        """The bodies of the subject of a claim, in its map or in all maps."""
        worlds = [world for map, world in self.worlds if claim.map in {None, map}]
        return [body for world in worlds for body in world.bodies if body.iri == claim.subject]

    def get(self, node: str, property: str) -> set[str]:
        return self.values.get(property, {}).get(node, set())

    def subjects(self, property: str, node: str) -> set[str]:
        return self.inverse.get(property, {}).get(node, set())

    # -- classes

    def expressions_above(self, cls: str) -> set[str]:
        """The classes and nodes of expressions that a class is directly below."""
        found = self.get(cls, RDFS + "subClassOf") | self.get(cls, OWL + "equivalentClass")
        found |= self.subjects(OWL + "equivalentClass", cls)
        for node in (*found, cls):
            for members in self.get(node, OWL + "intersectionOf"):
                found |= set(self.items(members))
        for member_of in self.lists_with(cls):
            for union in self.subjects(OWL + "unionOf", member_of):
                found |= {union, *self.subjects(OWL + "equivalentClass", union)}
        return found - {cls}

    def above(self, cls: str) -> set[str]:
        if cls not in self.superclasses:
            found = [cls]
            for each in found:
                found += sorted(self.expressions_above(each) - {*found})
            self.superclasses[cls] = {*found}
        return self.superclasses[cls]

    def items(self, head: str) -> Iterator[str]:
        while head and not head.endswith("#nil"):
            yield from self.get(head, FIRST)
            head = next(iter(self.get(head, REST)), "")

    def lists_with(self, item: str) -> Iterator[str]:
        for cell in self.subjects(FIRST, item):
            head = cell
            while before := next(iter(self.subjects(REST, head)), None):
                head = before
            yield head

    def classes_of(self, individual: str) -> set[str]:
        return {above for cls in self.get(individual, TYPE) for above in self.above(cls)}

    # -- restrictions

    def below(self, property: str) -> set[str]:
        found = [property]
        for each in found:
            lower = self.subjects(RDFS + "subPropertyOf", each) | self.get(each, OWL + "equivalentProperty")
            found += sorted((lower | self.subjects(OWL + "equivalentProperty", each)) - {*found})
        return {*found}

    def restrictions(self, cls: str | None, property: str | None, direction: str | None = None) -> Iterator[str]:
        """The nodes of restrictions on a property or a subproperty, of a class with its superclasses, or of all."""
        wanted = None if property is None else self.below(property)
        owned = self.above(cls) if cls else {node for nodes in self.all_supers() for node in nodes}
        for node in owned:
            for stated in self.get(node, OWL + "onProperty"):
                inverted = self.get(stated, OWL + "inverseOf") if stated.startswith("_:") else set()
                is_wanted = wanted is None or bool(wanted & (inverted or {stated}))
                if is_wanted and direction in (None, "inverse" if inverted else "forward"):
                    yield node

    def all_supers(self) -> Iterator[set[str]]:
        for axiom in (RDFS + "subClassOf", OWL + "equivalentClass"):
            yield from (self.expressions_above(cls) for cls in self.values.get(axiom, {}) if not cls.startswith("_:"))

    def existential_fillers(self, node: str) -> set[str]:
        found = self.get(node, OWL + "someValuesFrom")
        if any(int(count) > 0 for name in QUALIFIED for count in self.get(node, OWL + name)):
            found = found | self.get(node, OWL + "onClass")
        return found

    def fillers(self, node: str) -> set[str]:
        found = self.existential_fillers(node)
        for name in ("allValuesFrom", "hasValue", "onClass", "onDataRange"):
            found = found | self.get(node, OWL + name)
        return found

    def named_in(self, filler: str) -> Iterator[str]:
        if not filler.startswith("_:"):
            yield filler
        for name in ("unionOf", "intersectionOf"):
            for members in self.get(filler, OWL + name):
                for member in self.items(members):
                    yield from self.named_in(member)

    def subsumes(self, filler: str, cls: str) -> bool:
        return filler in self.above(cls)

    # -- parts

    def direct_parts(self, whole: str) -> set[str]:
        found = {part for property in TO_PARTS for part in self.get(whole, property)}
        found |= {part for property in TO_WHOLES for part in self.subjects(property, whole)}
        return found

    def is_joint(self, individual: str) -> bool:
        return KNOWROB + "Constraint" in self.classes_of(individual)

    def parts(self, whole: str, *, through_joints: bool) -> set[str]:
        """All parts; the two bodies of a joint are its parent and child, and no parts of one another."""
        found = [whole]
        for each in found:
            direct = () if self.is_joint(each) and not through_joints else self.direct_parts(each)
            found += sorted({part for part in direct if through_joints or not self.is_joint(part)} - {*found})
        return {*found} - {whole}


def name_of(node: object) -> str:
    """A node as text; blank nodes by their label."""
    return f"_:{node.value}" if isinstance(node, ox.BlankNode) else str(getattr(node, "value", node))


# -- one check per kind ------------------------------------------------------------------------------------------------


def no_statement(data: Statements, claim: Claim) -> bool:
    subjects = data.values.get(claim.property or "", {})
    return not any(
        claim.object in {None, value}
        for subject, values in subjects.items()
        for value in values
        if claim.subject in {None, subject} and value != subject and not data.get(subject, TYPE) & data.nested
    )


def no_source(data: Statements, claim: Claim) -> bool:
    return claim.subject not in data.kb.maps()


def fewer_maps(data: Statements, claim: Claim) -> bool:
    return len(data.kb.maps()) < int(claim.object or 0)


def no_class(data: Statements, claim: Claim) -> bool:
    return all(cls.startswith(("_:", OWL)) for cls in data.get(claim.subject or "", TYPE))


def not_instance(data: Statements, claim: Claim) -> bool:
    return claim.object not in data.classes_of(claim.subject or "")


def no_instance(data: Statements, claim: Claim) -> bool:
    described = data.values.get(DESCRIBED_IN_MAP, {})
    return not any(
        claim.object in data.classes_of(individual)
        for individual, maps in described.items()
        if (claim.map is None or claim.map in maps) and not data.get(individual, TYPE) & data.nested
    )


def not_subclass(data: Statements, claim: Claim) -> bool:
    if claim.subject is None:
        return not any(claim.object in data.above(cls) - {cls} for cls in data.values.get(RDFS + "subClassOf", {}))
    above = {each for each in data.above(claim.subject) - {claim.subject} if not each.startswith("_:")}
    return claim.object not in above if claim.object else not above


def not_sibling(data: Statements, claim: Claim) -> bool:
    subject = claim.subject or ""
    same = {each for each in data.above(subject) if subject in data.above(each)}
    parents = {each for cls in same for each in data.expressions_above(cls) - same if not each.startswith("_:")}
    others = {claim.object} if claim.object else {*data.values.get(RDFS + "subClassOf", {})}
    return not any(parents & data.get(other, RDFS + "subClassOf") for other in others - same)


def no_restriction(data: Statements, claim: Claim) -> bool:
    fillers = (each for node in data.restrictions(claim.subject, claim.property)
               for each in data.existential_fillers(node))  # fmt: skip
    return not any(claim.object is None or data.subsumes(filler, claim.object) for filler in fillers)


def no_narrower_restriction(data: Statements, claim: Claim) -> bool:
    nodes = data.restrictions(claim.subject, claim.property)
    named = (name for node in nodes for filler in data.existential_fillers(node) for name in data.named_in(filler))
    return not any(claim.object is None or claim.object in data.above(name) for name in named)


def no_stated_restriction(data: Statements, claim: Claim) -> bool:
    return not any(
        claim.object is None or claim.object in data.fillers(node)
        for node in data.restrictions(claim.subject, claim.property, claim.detail)
    )


def restriction(data: Statements, claim: Claim) -> bool:
    nodes = data.restrictions(claim.subject, claim.property)
    return any(claim.object in data.named_in(filler) for node in nodes for filler in data.fillers(node))


def not_part(data: Statements, claim: Claim) -> bool:
    if claim.subject is None:
        return not any(
            claim.object in data.parts(whole, through_joints=False)
            for property in (*TO_PARTS, *TO_WHOLES)
            for pair in data.values.get(property, {}).items()
            for whole in (pair[0], *pair[1])
        )
    found = data.parts(claim.subject, through_joints=False)
    return claim.object not in found if claim.object else not found


def part(data: Statements, claim: Claim) -> bool:
    if claim.subject is None:
        everything = data.values.get(TYPE, {})
        return any(claim.object in data.parts(whole, through_joints=True) for whole in everything)
    found = data.parts(claim.subject, through_joints=True)
    return claim.object in found if claim.object else bool(found)


def body(data: Statements, claim: Claim) -> bool:
    return bool(data.bodies(claim))


def no_body(data: Statements, claim: Claim) -> bool:
    return not data.bodies(claim)


def no_size(data: Statements, claim: Claim) -> bool:
    found = data.bodies(claim)
    return bool(found) and all(each.size is None for each in found)


def no_joint(data: Statements, claim: Claim) -> bool:
    ids = {each.id for each in data.bodies(claim)}
    worlds = [world for map, world in data.worlds if claim.map in {None, map}]
    return not any(ids & {joint.parent, joint.child} for world in worlds for joint in world.joints)


# -- relations of boxes, computed from their corners -------------------------------------------------------------------


class Box:
    """The bounding box of a body."""

    def __init__(self, body: Body) -> None:
        w, x, y, z = body.pose.quaternion
        self.center, self.turn = np.array(body.pose.position), Rotation.from_quat([x, y, z, w]).as_matrix()
        self.half = np.array(body.size or (0.0, 0.0, 0.0)) / 2
        signs = np.array(list(product((-1.0, 1.0), repeat=3)))
        self.corners = self.center + (signs * self.half) @ self.turn.T
        self.low, self.high = self.corners.min(axis=0), self.corners.max(axis=0)

    def entry(self, origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Where rays enter the box, as a fraction of their length; infinite where they miss it."""
        start, along = (origin - self.center) @ self.turn, rays @ self.turn
        ends = np.sort(np.stack([(-self.half - start) / along, (self.half - start) / along]), axis=0)
        near, far = ends[0].max(axis=1), ends[1].min(axis=1)
        return np.where((near <= far) & (far >= 0.0), np.maximum(near, 0.0), np.inf)

    def covers(self, points: np.ndarray) -> np.ndarray:
        """Which points of the floor are in the vertical projection."""
        return np.asarray(Delaunay(self.corners[:, :2]).find_simplex(points) >= 0)


def boxes_of(data: Statements, claim: Claim, name: str | None) -> list[tuple[World, Body]]:
    found = [(world, body) for map, world in data.worlds if claim.map in {None, map} for body in world.bodies]
    return [(world, body) for world, body in found if name in {None, body.iri}]


def measure_of(body: Body, measure: str) -> float:
    if measure == "mass":
        return body.physics.mass_kg or np.nan
    if body.size is None:
        return np.nan
    box = Box(body)
    return {
        "volume": float(np.prod(body.size)),
        "height": float(box.high[2] - box.low[2]),
        "length": max(body.size),
        "footprint": float(ConvexHull(box.corners[:, :2]).volume),
    }[measure]


def not_larger(data: Statements, claim: Claim) -> bool:
    measure = claim.detail or ""
    return not any(
        measure_of(one, measure) > measure_of(other, measure) * (1 + 1e-5)
        for world, one in boxes_of(data, claim, claim.subject)
        for place, other in boxes_of(data, claim, claim.object)
        if place is world
    )


def not_between(data: Statements, claim: Claim) -> bool:
    random = np.random.default_rng(0)
    for world, one in boxes_of(data, claim, claim.object):
        other = next((each for place, each in boxes_of(data, claim, claim.other) if place is world), None)
        if other is None:
            continue
        ends = [Box(one), Box(other)]
        hull = Delaunay(np.concatenate([end.corners[:, :2] for end in ends]))
        low, high = min(end.low[2] for end in ends), max(end.high[2] for end in ends)
        for _, each in boxes_of(data, claim, claim.subject):
            if each in {one, other} or each.size is None or each not in world.bodies:
                continue
            box = Box(each)
            points = box.center[:2] + (random.uniform(-1, 1, (4000, 3)) * box.half @ box.turn.T)[:, :2]
            spanned = min(box.high[2], high) - max(box.low[2], low)
            if (
                (hull.find_simplex(points) >= 0).mean() > 0.55
                and all(end.covers(points).mean() < 0.05 for end in ends)
                and spanned > 0.55 * (box.high[2] - box.low[2])
            ):
                return False
    return True


def rigid_group(world: World, id: BodyId) -> set[BodyId]:
    found = [id]
    for each in found:
        pairs = [(pair.parent, pair.child) for pair in world.attachments if each in {pair.parent, pair.child}]
        found += sorted({other for pair in pairs for other in pair} - {*found})
    return {*found}


def not_nearest(data: Statements, claim: Claim) -> bool:
    for world, start in boxes_of(data, claim, claim.other):
        mine = rigid_group(world, start.id)
        others = [each for each in world.bodies if each.size is not None and each.id not in mine]
        if not any(each.iri == claim.subject for each in others):
            continue
        spec = mujoco.MjSpec()
        for each in (start, *others):
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=[max(extent / 2, 1e-4) for extent in each.size or ()],
                pos=list(each.pose.position),
                quat=list(each.pose.quaternion),
            )
        model = spec.compile()
        state = mujoco.MjData(model)
        mujoco.mj_forward(model, state)
        apart = [max(0.0, mujoco.mj_geomDistance(model, state, 0, at + 1, 100.0, None)) for at in range(len(others))]
        limit = next(far for far, each in zip(apart, others, strict=True) if each.iri == claim.subject)
        nearer = sum(far <= limit + 1e-3 for far, each in zip(apart, others, strict=True) if each.iri != claim.subject)
        if nearer < int(claim.detail or 0):
            return False
    return True


def attached(data: Statements, claim: Claim) -> bool:
    pairs = [(world, body.id) for world, body in boxes_of(data, claim, claim.object)]
    return any(body.id in rigid_group(world, id)
               for world, id in pairs for _, body in boxes_of(data, claim, claim.subject))  # fmt: skip


def hidden(data: Statements, claim: Claim) -> bool:
    subject, hider, viewer = (
        Box(boxes_of(data, claim, name)[0][1]) for name in (claim.subject, claim.object, claim.other)
    )
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (20_000, 3))
    points /= np.abs(points).max(axis=1, keepdims=True)
    rays = subject.center + (points * subject.half) @ subject.turn.T - viewer.center
    hit = hider.entry(viewer.center, rays)
    return bool(np.any(np.isfinite(hit) & (hit <= subject.entry(viewer.center, rays))))


def in_direction(data: Statements, claim: Claim) -> bool:
    for world, one in boxes_of(data, claim, claim.subject):
        for place, other in boxes_of(data, claim, claim.object):
            x, y = np.subtract(one.pose.position, other.pose.position)[:2]
            ahead = {"front": (x, y), "behind": (-x, y), "left": (y, x), "right": (-y, x)}[claim.detail or ""]
            if place is world and ahead[0] >= abs(ahead[1]) - 1e-6:
                return True
    return False


def not_fitting(data: Statements, claim: Claim) -> bool:
    for _, thing in boxes_of(data, claim, claim.subject):
        for _, place in boxes_of(data, claim, claim.object):
            if thing.size is None or place.size is None:
                continue
            box = Box(place)
            up = int(np.argmax(np.abs(box.turn[2])))
            top = [extent for axis, extent in enumerate(place.size) if axis != up]
            onto = any(a <= c and b <= d for a, b in permutations(thing.size[:2]) for c, d in [top])
            inside = any(np.all(np.less_equal(size, place.size)) for size in permutations(thing.size))
            if onto or (inside and KNOWROB + "Container" in data.classes_of(place.iri)):
                return False
    return True


def on_or_in(data: Statements, claim: Claim) -> bool:
    """Whether it is at least over the place, and not below it."""
    for _, thing in boxes_of(data, claim, claim.subject):
        for _, place in boxes_of(data, claim, claim.object):
            one, other = Box(thing), Box(place)
            over = np.all(one.high[:2] >= other.low[:2]) and np.all(one.low[:2] <= other.high[:2])
            if over and other.low[2] - 0.03 <= one.low[2] <= other.high[2] + 1.0:
                return True
    return False


CHECKS: Mapping[ClaimKind, Callable[[Statements, Claim], bool]] = {
    kind: globals()[name]
    for kind, name in zip(
        ClaimKind,
        (
            *("no_statement", "no_source", "fewer_maps", "no_class", "not_instance", "no_instance", "not_subclass"),
            *("not_sibling", "no_restriction", "no_narrower_restriction", "no_stated_restriction", "restriction"),
            *("not_part", "part", "body", "no_body", "no_size", "no_joint", "not_larger", "not_between"),
            *("not_nearest", "attached", "hidden", "in_direction", "not_fitting", "on_or_in"),
        ),
        strict=True,
    )
}


# -- all questions -----------------------------------------------------------------------------------------------------

DEFECTS = room_map(
    body_turtle("cup"),
    body_turtle("oven", cls="k:RegularOven"),
    body_turtle("fridge", cls="k:Refrigerator"),
    ":case a k:Cupboard ; k:describedInMap :room . :door a k:Door ; k:describedInMap :room .",
    ":grip a k:Handle ; k:describedInMap :room . :loose a k:Handle ; k:describedInMap :room .",
    ":hinge a k:RevoluteJoint ; k:describedInMap :room ; k:parent :case ; k:child :door .",
    ":door k:properPhysicalParts :grip . :nowhere a k:Cupboard ; k:properPhysicalParts :loose .",
    ":other a k:SemanticEnvironmentMap . :posed a k:Pose ; k:describedInMap :third .",
    ":nameless a owl:NamedIndividual ; k:describedInMap :room .",
    ":Lonely a owl:Class . :Bounded a owl:Class ; rdfs:subClassOf [ a owl:Restriction ;"
    " owl:onProperty k:typePrimaryFunction-containerFor ; owl:allValuesFrom k:Water ] .",
    ":Choosy a owl:Class ; rdfs:subClassOf k:Refrigerator , [ a owl:Restriction ; owl:someValuesFrom"
    " [ a owl:Class ; owl:unionOf ( k:Tea-Beverage k:Spice ) ] ; owl:onProperty k:typePrimaryFunction-containerFor ] .",
)
CLASSES = [
    *("Water", "Oven", "Kettle", "Refrigerator", "Handle", "Bread", "Robot", "Cup", "Door", "Tea-Beverage", "Spice"),
    *("BakingFood", "CuttingSomething"),
]
PROPERTIES = [KNOWROB + "deviceUsed", KNOWROB + "typePrimaryFunction-containerFor"]


def arguments(kb: KnowledgeBase, question: Question, random: Random, limit: int) -> Iterator[dict[str, str]]:
    """Some combinations of arguments, each of which is given in some and left out in others."""
    declared = sorted(kb.reasoner.declared_classes())
    classes = [name for name in declared if name.removeprefix(KNOWROB) in CLASSES or name.startswith("http://example")]
    classes += random.sample(declared, min(4, len(declared)))
    individuals = sorted({*kb.reasoner.individuals.types, *kb.reasoner.maps_of} - {*kb.reasoner.members_by_map})
    domains = {
        EntityType.CLASS: classes,
        EntityType.VALUE: classes,
        EntityType.INDIVIDUAL: random.sample(individuals, min(14, len(individuals))),
        EntityType.MAP: sorted(kb.reasoner.members_by_map),
        EntityType.PROPERTY: [name for name in PROPERTIES if kb.reasoner.is_property(Iri(name))],
    }
    named = {each.name: domains[each.value_type] for each in question.arguments if each.value_type in domains}
    yield {}
    for size in range(1, len(named) + 1):
        for names in combinations(named, size):
            values = list(product(*(named[name] for name in names)))
            for chosen in random.sample(values, min(limit, len(values))):
                yield dict(zip(names, chosen, strict=True))


def false_claims(kb: KnowledgeBase, *, limit: int = 100) -> tuple[list[str], Counter[ClaimKind]]:
    """All claims that the statements contradict, and the number of claims by kind.

    Args:
        kb: the knowledge base.
        limit: how many combinations of values to try for the same arguments of a question.
    """
    data, random = Statements(kb), Random(7)
    wrong: dict[str, None] = {}
    kinds: Counter[ClaimKind] = Counter()
    checked: dict[Claim, bool] = {}
    for question in list_questions():
        if question.about_past:  # no episode is added, which is the reason for all of them
            continue
        for args in arguments(kb, question, random, min(limit, 4) if question.uses_current_state else limit):
            missing: MissingKnowledge
            for missing in kb.ask(question, **args).missing:
                is_open = question.uses_current_state and not {*args} - {"map"}  # about no individual
                if not missing.claims and not is_open and not missing.reason.startswith(ARGUMENTS_ARE_MISSING):
                    wrong[f"{question.name} {args}: no claim: {missing.reason}"] = None
                for claim in missing.claims:
                    kinds[claim.kind] += 1
                    if claim not in checked:
                        checked[claim] = CHECKS[claim.kind](data, claim)
                    if not checked[claim]:
                        wrong[f"{question.name} {args}: {missing.reason}: {claim}"] = None
    return list(wrong), kinds


@pytest.fixture(scope="module")
def kitchen() -> KnowledgeBase:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    return kb


def test_every_claim_about_a_kitchen_is_true(kitchen: KnowledgeBase) -> None:
    wrong, kinds = false_claims(kitchen)
    assert wrong == []
    assert len(kinds) >= 9


def test_every_claim_about_places_of_bodies_is_true(kitchen: KnowledgeBase) -> None:
    data, random = Statements(kitchen), Random(3)
    names = sorted(body.iri for body in kitchen.world().bodies)
    pairs = {
        "thing": names,
        "other": names,
        "one": names,
        "place": names,
        "viewer": names,
        "cls": CLASSES,
        "count": [1],
    }
    kinds: Counter[ClaimKind] = Counter()
    rounds = {"direction_of": 25, "distance": 10, "nearest": 25, "is_between": 30, "larger_than": 25}
    rounds |= {"visible_from": 40, "fits": 40, "misplaced": 60}
    options = {"direction_of": {"frame": ["map"], "direction": ["left", "front"]}}
    for name, count in rounds.items():
        question = get_question(name)
        known = {each.name for each in question.arguments}
        domains = {key: values for key, values in pairs.items() if key in known} | options.get(name, {})
        for _ in range(count):
            chosen = sorted(key for key in domains if key in {"thing", "other", "one"} or random.random() < 0.7)
            args = {key: random.choice(domains[key]) for key in chosen}
            for missing in kitchen.ask(question, **args).missing:
                for claim in missing.claims:
                    kinds[claim.kind] += 1
                    assert CHECKS[claim.kind](data, claim), f"{name} {args}: {missing.reason}: {claim}"
    assert {ClaimKind.NOT_LARGER, ClaimKind.NOT_BETWEEN, ClaimKind.NOT_NEAREST, ClaimKind.HIDDEN} <= {*kinds}
    assert {ClaimKind.IN_DIRECTION, ClaimKind.NOT_FITTING, ClaimKind.ON_OR_IN} <= {*kinds}


def test_every_claim_about_incomplete_maps_is_true(tmp_path: Path) -> None:
    (tmp_path / "room.ttl").write_text(DEFECTS, encoding="utf-8")
    kb = knowledge_base_from(tmp_path / "room.ttl", bundled_ontology=True)
    kb.tell("http://example.org/room.owl#told", "type", "SemanticEnvironmentMap")
    wrong, kinds = false_claims(kb, limit=800)
    wrong_alone, kinds_alone = false_claims(knowledge_base_from(tmp_path / "room.ttl"))
    assert wrong + wrong_alone == []
    of_places = {kind for kind in ClaimKind if [*ClaimKind].index(kind) >= [*ClaimKind].index(ClaimKind.NOT_LARGER)}
    assert {*kinds, *kinds_alone} >= {*ClaimKind} - {ClaimKind.FEWER_MAPS} - of_places


def test_every_claim_about_a_map_of_soma_is_true(shared_data: Path) -> None:
    kb = knowledge_base_from(shared_data / "maps" / "soma-iai-room.owl", bundled_ontology=True)
    wrong, _ = false_claims(kb)
    assert wrong == []


def test_the_check_finds_claims_that_are_false(kitchen: KnowledgeBase) -> None:
    data = Statements(kitchen)
    container_for = KNOWROB + "typePrimaryFunction-containerFor"
    milk, fridge = KNOWROB + "CowsMilk", KNOWROB + "Refrigerator"
    house = "http://mindstage.org/maps/kitchen.owl#"
    false = [
        Claim(kind=ClaimKind.NO_RESTRICTION, property=container_for, object=milk),
        Claim(kind=ClaimKind.NO_RESTRICTION, subject=fridge, property=container_for, object=milk),
        Claim(kind=ClaimKind.RESTRICTION, subject=fridge, property=container_for, object=milk),
        Claim(kind=ClaimKind.NO_NARROWER_RESTRICTION, property=KNOWROB + "deviceUsed", object=KNOWROB + "Oven"),
        Claim(kind=ClaimKind.NO_STATED_RESTRICTION, property=container_for, object=KNOWROB + "Water"),
        Claim(kind=ClaimKind.NO_INSTANCE, object=fridge),
        Claim(kind=ClaimKind.NOT_INSTANCE, subject=house + "fridge_door_handle", object=KNOWROB + "Handle"),
        Claim(kind=ClaimKind.NOT_PART, subject=house + "fridge_door", object=house + "fridge_door_handle"),
        Claim(kind=ClaimKind.PART, subject=house + "fridge_door_handle", object=house + "fridge_door"),
        Claim(kind=ClaimKind.NOT_SUBCLASS, subject=milk, object=KNOWROB + "Drink"),
        Claim(kind=ClaimKind.NOT_SIBLING, subject=KNOWROB + "Freezing", object=KNOWROB + "Boiling"),
        Claim(kind=ClaimKind.NO_STATEMENT, subject=house + "fridge_door", property=DESCRIBED_IN_MAP),
        Claim(kind=ClaimKind.NO_SOURCE, subject=house + "kitchen"),
        Claim(kind=ClaimKind.NO_CLASS, subject=house + "fridge_door"),
        Claim(kind=ClaimKind.FEWER_MAPS, object="1"),
        Claim(kind=ClaimKind.NO_BODY, subject=house + "fridge_door"),
        Claim(kind=ClaimKind.BODY, subject=house + "fridge_door_hinge"),
        Claim(kind=ClaimKind.NO_SIZE, subject=house + "fridge_door"),
        Claim(kind=ClaimKind.NO_JOINT, subject=house + "fridge_door"),
        Claim(kind=ClaimKind.NOT_LARGER, subject=house + "fridge", object=house + "oven", detail="height"),
        Claim(kind=ClaimKind.NOT_LARGER, object=house + "oven", detail="volume"),
        Claim(kind=ClaimKind.NOT_BETWEEN, object=house + "fridge", other=house + "table"),
        Claim(kind=ClaimKind.NOT_NEAREST, subject=house + "milk_carton_2", other=house + "milk_carton_1", detail="9"),
        Claim(kind=ClaimKind.ATTACHED, subject=house + "fridge", object=house + "oven"),
        Claim(kind=ClaimKind.HIDDEN, subject=house + "table", object=house + "fridge", other=house + "tap"),
        Claim(kind=ClaimKind.IN_DIRECTION, subject=house + "fridge", object=house + "fridge_door", detail="right"),
        Claim(kind=ClaimKind.NOT_FITTING, subject=house + "milk_carton_1", object=house + "table"),
        Claim(kind=ClaimKind.ON_OR_IN, subject=house + "milk_carton_1", object=house + "oven"),
    ]
    assert [claim for claim in false if CHECKS[claim.kind](data, claim)] == []
    assert {claim.kind for claim in false} == {*ClaimKind}


@each_case(
    ("name", "args", "reason"),
    [
        ("storage_place", {"item": "Water"}, "; Kettle (typePrimaryFunction-containerFor only Water), "),
        ("storage_place", {"item": "Water"}, "may contain it, which makes no storage place"),
        ("siblings", {"cls": "Cup", "sibling": "Cup"}, "Cup is no sibling of itself"),
        ("subclass_of", {"cls": "Cup", "superclass": "Cup"}, "Cup is the class itself"),
        ("part_of", {"whole": "fridge_door_hinge"}, "only joints connect it to other bodies"),
        ("handle_of", {"individual": "fridge_door_hinge"}, "it is a joint, which has no parts"),
        ("device_for_action", {"action": "BakingACake", "device": "HeatingDevice"}, ""),
    ],
)
def test_reasons_say_what_is_so(name: str, args: dict[str, str], reason: str, kitchen: KnowledgeBase) -> None:
    answers = kitchen.ask(name, **args)
    assert bool(answers) == (not reason)
    assert all(reason in missing.reason for missing in answers.missing)


def test_an_action_is_done_with_the_superclasses_of_the_devices_that_it_names(kitchen: KnowledgeBase) -> None:
    ovens = kitchen.ask("device_for_action", device="Oven")
    assert {row.action.rpartition("#")[2] for row in ovens} == {"Microwaving", "BakingACake", "BakingBread"}
    assert kitchen.explain("device_for_action", ovens[0])[-1].endswith(" is a Oven")
    assert [row.action for row in kitchen.ask("device_for_action", action="BakingBread", device="Oven")]


def test_a_place_without_a_purpose_of_its_own_inherits_one(tmp_path: Path) -> None:
    (tmp_path / "room.ttl").write_text(DEFECTS, encoding="utf-8")
    kb = knowledge_base_from(tmp_path / "room.ttl", bundled_ontology=True)
    casing = kb.ask("storage_place", item="CowsMilk", place="IAIFridgeCasing")
    assert kb.explain("storage_place", casing[0])[1] == "IAIFridgeCasing is a Refrigerator"
    (missing,) = kb.ask("storage_place", item="CowsMilk", place="Choosy").missing
    assert missing.reason == (
        "Choosy itself is not stated to store CowsMilk, but Refrigerator, which it is: ask for place=Refrigerator"
    )
