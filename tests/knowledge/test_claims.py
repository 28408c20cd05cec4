"""What the reasons for missing answers state: each claim is checked against the statements, without the reasoner."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from itertools import combinations
from pathlib import Path
from random import Random

import pyoxigraph as ox
import pytest

from mindstage.knowledge import KnowledgeBase, bundled_kitchen
from mindstage.knowledge.names import EntityType
from mindstage.knowledge.queries import MissingKnowledge, Question, list_questions
from mindstage.knowledge.questions import Claim, ClaimKind
from mindstage.knowledge.rdf_mapping.nested import NESTED_RESOURCES
from mindstage.scene import Iri
from tests.knowledge.maps import KNOWROB, OWL, RDFS, body_turtle, knowledge_base_from, room_map

TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"
FIRST, REST = (f"http://www.w3.org/1999/02/22-rdf-syntax-ns#{name}" for name in ("first", "rest"))
DUL = "http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#"
SOMA = "http://www.ease-crc.org/ont/SOMA.owl#"
DESCRIBED_IN_MAP = KNOWROB + "describedInMap"
TO_PARTS = [KNOWROB + name for name in ("child", "parts", "physicalParts", "properPhysicalParts")]
TO_PARTS += [DUL + "hasPart", DUL + "hasProperPart", DUL + "hasComponent", SOMA + "hasPhysicalComponent"]
TO_WHOLES = [KNOWROB + "parent", DUL + "isPartOf", DUL + "isComponentOf", SOMA + "isPhysicalComponentOf"]
QUALIFIED = ("qualifiedCardinality", "minQualifiedCardinality", "cardinality", "minCardinality")
WITHOUT_CLAIMS = {"where_is", "openings"}
"""Questions about the current state, whose reasons are about poses and joints and not about statements."""


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

    def restrictions(self, cls: str | None, property: str | None) -> Iterator[str]:
        """The nodes of restrictions on a property or a subproperty, of a class with its superclasses, or of all."""
        wanted = None if property is None else self.below(property)
        owned = self.above(cls) if cls else {node for nodes in self.all_supers() for node in nodes}
        for node in owned:
            for on in self.get(node, OWL + "onProperty"):
                if wanted is None or on in wanted:
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
        for node in data.restrictions(claim.subject, claim.property)
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


CHECKS: Mapping[ClaimKind, Callable[[Statements, Claim], bool]] = {
    kind: globals()[name]
    for kind, name in zip(
        ClaimKind,
        (
            *("no_statement", "no_source", "fewer_maps", "no_class", "not_instance", "no_instance", "not_subclass"),
            *("not_sibling", "no_restriction", "no_narrower_restriction", "no_stated_restriction", "restriction"),
            *("not_part", "part"),
        ),
        strict=True,
    )
}


# -- all questions -----------------------------------------------------------------------------------------------------

DEFECTS = room_map(
    body_turtle("cup"),
    body_turtle("oven", cls="k:Oven"),
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


def arguments(kb: KnowledgeBase, question: Question, random: Random) -> Iterator[dict[str, str]]:
    """Some combinations of arguments, each of which is given in some and left out in others."""
    declared = sorted(kb.reasoner.declared_classes())
    classes = [name for name in declared if name.removeprefix(KNOWROB) in CLASSES or name.startswith("http://example")]
    classes += random.sample(declared, min(16, len(declared)))
    individuals = sorted({*kb.reasoner.individuals.types, *kb.reasoner.maps_of} - {*kb.reasoner.members_by_map})
    domains = {
        EntityType.CLASS: classes,
        EntityType.VALUE: classes,
        EntityType.INDIVIDUAL: random.sample(individuals, min(24, len(individuals))),
        EntityType.MAP: sorted(kb.reasoner.members_by_map),
        EntityType.PROPERTY: [name for name in PROPERTIES if kb.reasoner.is_property(Iri(name))],
    }
    named = {each.name: domains[each.value_type] for each in question.arguments if each.value_type in domains}
    yield {}
    for size in range(1, len(named) + 1):
        for names in combinations(named, size):
            for _ in range(16 if size < 3 else 6):
                if all(named[name] for name in names):
                    yield {name: random.choice(named[name]) for name in names}


def false_claims(kb: KnowledgeBase) -> tuple[list[str], Counter[ClaimKind]]:
    """All claims that the statements contradict, and the number of claims by kind."""
    data, random = Statements(kb), Random(7)
    wrong: dict[str, None] = {}
    kinds: Counter[ClaimKind] = Counter()
    checked: dict[Claim, bool] = {}
    for question in list_questions():
        if question.name in WITHOUT_CLAIMS or question.uses_current_state:
            continue
        for args in arguments(kb, question, random):
            missing: MissingKnowledge
            for missing in kb.ask(question, **args).missing:
                if not missing.claims:
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


def test_every_claim_about_incomplete_maps_is_true(tmp_path: Path) -> None:
    (tmp_path / "room.ttl").write_text(DEFECTS, encoding="utf-8")
    kb = knowledge_base_from(tmp_path / "room.ttl", bundled_ontology=True)
    kb.tell("http://example.org/room.owl#told", "type", "SemanticEnvironmentMap")
    wrong, kinds = false_claims(kb)
    wrong_alone, kinds_alone = false_claims(knowledge_base_from(tmp_path / "room.ttl"))
    assert wrong + wrong_alone == []
    assert {*kinds, *kinds_alone} >= {*ClaimKind} - {ClaimKind.FEWER_MAPS}


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
    ]
    assert [claim for claim in false if CHECKS[claim.kind](data, claim)] == []
    assert {claim.kind for claim in false} == {*ClaimKind}


@pytest.mark.parametrize(
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
