"""Questions about maps in the terms of SOMA and DUL: the alignment with KnowRob's terms, and ambiguous names."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec
import pyoxigraph as ox
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from mindstage.errors import AmbiguousNameError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import AnswerRow, list_questions
from mindstage.maps import MapDialect, bundled_kitchen, save_map
from mindstage.maps.io.files import bundled_ontology, event_ontology, soma_alignment
from mindstage.maps.io.graph_diff import lost_statements
from mindstage.rdf.graphs import local_name
from mindstage.scene import Iri, diff
from tests.maps.dialect_maps import soma_map
from tests.maps.small_maps import KNOWROB, ROOM_NAMESPACE, body_turtle, knowledge_base_from, room_map

SOMA = "http://www.ease-crc.org/ont/SOMA.owl#"
DUL = "http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#"
EASE = "http://www.ease-crc.org/ont/"
TYPE = ox.NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")
EQUIVALENT = ox.NamedNode("http://www.w3.org/2002/07/owl#equivalentClass")
COUNTS = {"generality", "steps"}
"""Fields that count the classes between two others, of which SOMA has more."""
OTHER_STATEMENTS = {"facts", "label"}
"""Fields with statements in the vocabulary of the map."""
PART_MARK = ox.NamedNode(SOMA + "hasPhysicalComponent")
"""Marks a part that is stated in KnowRob's terms as well."""
COMPARED = {
    *("storage_place", "storage_place_in_environment", "device_for_action", "device_for_action_in_environment"),
    *(
        "part_of",
        "handle_of",
        "what_is",
        "maps",
        "everything_in_map",
        "individual_of_class",
        "where_is",
        "articulated_parts",
    ),
    *("analyze", "identical_maps", "differences"),
}
"""Questions whose answers do not count classes or measure free space."""
RELATIONS = [KNOWROB + name for name in ("parent", "child", "properPhysicalParts")]


def equivalents() -> dict[str, str]:
    """KnowRob's or the household ontology's class, by the class of SOMA that the alignment states to be equivalent."""
    quads = ox.parse(path=soma_alignment(), format=ox.RdfFormat.TURTLE)
    pairs = [(quad.subject.value, quad.object.value) for quad in quads if quad.predicate == EQUIVALENT]
    return {soma: other for soma, other in pairs if soma.startswith((EASE, DUL)) and not other.startswith((EASE, DUL))}


KNOWROB_CLASS = equivalents()
SOMA_CLASS = {other: soma for soma, other in sorted(KNOWROB_CLASS.items(), reverse=True)}


def in_knowrob_terms(value: Any) -> Any:
    """A value of an answer with KnowRob's class for each that has one."""
    if isinstance(value, str):
        return KNOWROB_CLASS.get(value, value)
    if isinstance(value, list | tuple):
        return tuple(in_knowrob_terms(each) for each in value)
    if isinstance(value, dict):
        return tuple(sorted((key, in_knowrob_terms(each)) for key, each in value.items()))
    return value


def mentions_soma(value: Any) -> bool:
    """Whether a value contains a class or property that only SOMA and DUL have."""
    if isinstance(value, tuple):
        return any(map(mentions_soma, value))
    return isinstance(value, str) and value.startswith((EASE, DUL))


def comparable(rows: Iterable[AnswerRow]) -> dict[tuple[Any, ...], AnswerRow]:
    """The answers by their fields in KnowRob's terms; those about terms that only SOMA has are left out."""
    found = {}
    for row in rows:
        fields = msgspec.to_builtins(row)
        cells = tuple(
            (name, in_knowrob_terms(value))
            for name, value in fields.items()
            if name not in COUNTS | OTHER_STATEMENTS and not (name == "classes" and not value)
        )
        if not mentions_soma(tuple(value for _, value in cells)):
            found.setdefault(cells, row)
    return found


def questions_about(individual: str) -> Iterable[tuple[str, Mapping[str, str]]]:
    """Every question about an individual, as each of the arguments that may be one, except those that measure all."""
    for question in list_questions():
        for argument in question.arguments:
            if argument.type_text == "individual" and question.name in COMPARED - {"where_is"}:
                yield question.name, {argument.name: individual}


def assert_same_answers(
    one: KnowledgeBase, other: KnowledgeBase, individuals: Iterable[str], *, without: Container[str] = ("analyze",)
) -> None:
    """Compares all answers about a map in KnowRob's terms with those about it in SOMA's.

    Two differences are meant: `analyze` counts statements as the file has them, and SOMA's dispositions state devices
    for actions that KnowRob has none for.
    """
    asked: list[tuple[str, Mapping[str, str]]] = [
        (question.name, {}) for question in list_questions() if question.name in COMPARED
    ]
    asked += [each for individual in individuals for each in questions_about(individual)]
    for name, args in asked:
        if name not in without:
            expected, found = comparable(one.ask(name, **args)), comparable(other.ask(name, **args))
            assert not expected.keys() - found.keys(), (name, args)
            for cells in found.keys() - expected.keys():
                assert any("hasDisposition" in line for line in other.explain(name, found[cells])), (name, args, cells)


@pytest.fixture(scope="module")
def kitchen() -> KnowledgeBase:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    return kb


@pytest.fixture(scope="module")
def kitchen_in_soma(kitchen: KnowledgeBase, tmp_path_factory: pytest.TempPathFactory) -> KnowledgeBase:
    """The kitchen as `mindstage convert` writes it for SOMA."""
    path = tmp_path_factory.mktemp("soma") / "kitchen.ttl"
    save_map(kitchen.world(), path, dialect=MapDialect.SOMA)
    return knowledge_base_from(path, bundled_ontology=True)


@pytest.fixture(scope="module")
def room(shared_data: Path) -> KnowledgeBase:
    """The room of KnowRob 2's tutorial."""
    return knowledge_base_from(shared_data / "maps" / "soma-iai-room.owl", bundled_ontology=True)


# -- the alignment -----------------------------------------------------------------------------------------------------


def test_the_alignment_is_loaded_with_the_first_source_that_uses_soma(tmp_path: Path) -> None:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    assert soma_alignment() not in kb.sources()
    assert not [each for each in kb.assumptions() if each.topic == "vocabulary"]
    (tmp_path / "lab.ttl").write_text(soma_map(":cup a soma:Cup ."), encoding="utf-8")
    kb.load((), ontologies=tmp_path / "lab.ttl")
    assert kb.sources()[-1] == soma_alignment()
    (assumption,) = [each for each in kb.assumptions() if each.topic == "vocabulary"]
    assert "it uses Cup; the bundled soma.ttl, loaded as a source," in assumption.evidence


def test_a_prefix_that_is_declared_and_not_used_loads_nothing(tmp_path: Path) -> None:
    (tmp_path / "map.ttl").write_text(f"@prefix soma: <{SOMA}> ." + room_map(body_turtle("cup")), encoding="utf-8")
    kb = knowledge_base_from(tmp_path / "map.ttl", bundled_ontology=True)
    assert kb.sources() == (bundled_ontology(), (tmp_path / "map.ttl").resolve())


def test_without_the_household_ontology_nothing_is_aligned(shared_data: Path) -> None:
    kb = knowledge_base_from(shared_data / "maps" / "soma-iai-room.owl")
    assert soma_alignment() not in kb.sources()


def test_a_folder_keeps_the_alignment(tmp_path: Path) -> None:
    (tmp_path / "lab.ttl").write_text(soma_map(":cup a soma:Cup ."), encoding="utf-8")
    with KnowledgeBase(store=tmp_path / "store") as kb:
        kb.load((), ontologies=tmp_path / "lab.ttl")
    with KnowledgeBase(store=tmp_path / "store") as kb:
        assert kb.sources()[-1] == soma_alignment()
        assert kb.is_a(Iri(SOMA + "Cup"), Iri(KNOWROB + "DrinkingVessel"))
        assert [each.topic for each in kb.assumptions()] == ["vocabulary"]
        assert kb.findings() == ()


@pytest.mark.parametrize("with_knowrob", [False, True])
def test_the_alignment_makes_no_class_of_knowrob_a_subclass_of_another(
    with_knowrob: bool, request: pytest.FixtureRequest
) -> None:
    plain, aligned = KnowledgeBase(), KnowledgeBase()
    folders = [request.getfixturevalue("shared_data") / "ontology"] if with_knowrob else []
    ontologies = [path for folder in folders for path in sorted(folder.rglob("*.owl"))]
    plain.load((), ontologies=ontologies)
    aligned.load((), ontologies=[*ontologies, soma_alignment()])
    before, after = plain.reasoner.classes, aligned.reasoner.classes
    for cls in list(plain.reasoner.declared_classes()):
        added = set(after.above(cls)) - set(before.above(cls))
        assert all(each.startswith((EASE, DUL)) for each in added), cls


def test_every_class_of_knowrob_in_the_alignment_exists() -> None:
    household = KnowledgeBase()
    household.load((), ontologies=event_ontology())
    quads = list(ox.parse(path=soma_alignment(), format=ox.RdfFormat.TURTLE))
    nodes = {node.value for quad in quads for node in quad.triple if isinstance(node, ox.NamedNode)}
    own = {node for node in nodes if node.startswith((KNOWROB, "http://mindstage.org/ontology#"))}
    assert len(own) > 90
    for name in own:
        assert household.reasoner.is_class(Iri(name)) or household.reasoner.is_property(Iri(name)), name


def test_files_written_back_have_no_statement_of_the_alignment(room: KnowledgeBase, tmp_path: Path) -> None:
    again = tmp_path / "room.owl"
    save_map(room.world(), again, source_view=room.source_view())
    copy = knowledge_base_from(again, bundled_ontology=True)
    assert not lost_statements(room.source_view(), copy.source_view())
    assert diff(room.world(), copy.world()).identical(0.0)
    text = again.read_text(encoding="utf-8")
    assert "Graspability" not in text
    assert "equivalentClass" not in text


# -- the same answers --------------------------------------------------------------------------------------------------


def test_a_kitchen_exported_to_soma_gives_the_same_answers(
    kitchen: KnowledgeBase, kitchen_in_soma: KnowledgeBase
) -> None:
    assert soma_alignment() in kitchen_in_soma.sources()
    individuals = [row.individual for row in kitchen.ask("everything_in_map")]
    assert_same_answers(kitchen, kitchen_in_soma, individuals[::20])


@pytest.mark.parametrize("dialect", [MapDialect.SOMA, MapDialect.SEMLOG])
def test_a_map_of_soma_answers_the_same_after_its_export(
    dialect: MapDialect, room: KnowledgeBase, tmp_path: Path
) -> None:
    """Joints get names in the file, so that they are individuals of the map there; unnamed bodies get other labels.

    Five drawers have no whole in the map. What is assumed to hold them is not stated in the exported map.
    """
    path = tmp_path / "room.owl"
    save_map(room.world(), path, dialect=dialect)
    exported = knowledge_base_from(path, bundled_ontology=True)
    joints = {joint.iri for joint in room.world().joints}
    assert len(joints) == 17
    assert not joints & {row.individual for row in room.ask("everything_in_map")}
    counted = {"maps", "analyze", "how_many"}
    for question in list_questions():
        if question.name not in counted:
            before, after = (
                sorted(without_labels(row) for row in kb.ask(question) if not joints & names_in(row))
                for kb in (room, exported)
            )
            assert after == before, question.name
    for name, least in (("handle_of", 30), ("storage_place_in_environment", 100), ("articulated_parts", 15)):
        assert len(exported.ask(name)) >= least
    for row in exported.ask("handle_of"):
        args = {"individual": row.individual, "handle": row.handle}
        assert list(map(without_labels, room.ask("handle_of", **args))) == [without_labels(row)]


def names_in(row: AnswerRow) -> set[str]:
    """The texts of the fields of an answer."""
    return {*map(str, msgspec.to_builtins(row).values())}


def without_labels(row: AnswerRow) -> str:
    """An answer without the labels of blank nodes, and without statements in the vocabulary of the file."""
    fields = {name: value for name, value in msgspec.to_builtins(row).items() if name not in OTHER_STATEMENTS}
    return re.sub(r"_:\w+", "_:label", str(fields))


def test_inferences_about_affordances_are_marked_as_mindstage_s_own() -> None:
    quads = list(ox.parse(path=soma_alignment(), format=ox.RdfFormat.TURTLE))
    comment = ox.NamedNode("http://www.w3.org/2000/01/rdf-schema#comment")
    marked = {
        quad.subject for quad in quads if quad.predicate == comment and "inference of Mindstage" in str(quad.object)
    }
    owners = {quad.subject.value.partition("#")[2] for quad in quads if quad.object in marked}
    assert owners == {"Graspability", "Storage"}


def renamed(quads: Iterable[ox.Quad], classes: Mapping[str, str]) -> Iterable[ox.Triple]:
    """Statements of individuals with other classes."""
    for quad in quads:
        value = classes.get(quad.object.value) if quad.predicate == TYPE else None
        yield quad.triple if value is None else ox.Triple(quad.subject, quad.predicate, ox.NamedNode(value))


def test_a_kitchen_in_the_terms_of_soma_gives_the_same_answers(
    kitchen: KnowledgeBase, kitchen_in_soma: KnowledgeBase, tmp_path: Path
) -> None:
    """Both kitchens have the nearest classes that are aligned; one has KnowRob's terms, the other SOMA's."""
    quads = list(kitchen_in_soma.store.quads_for_pattern(None, None, None, graph_of(kitchen_in_soma)))
    nearest = {
        cls: next((above for above in kitchen.reasoner.classes.above(cls) if above in SOMA_CLASS), None)
        for cls in {kitchen.reasoner.class_of(row.individual) for row in kitchen.ask("everything_in_map")}
    }
    in_knowrob = {cls: above for cls, above in nearest.items() if cls and above}
    assert len(in_knowrob) > 60
    in_soma = {cls: SOMA_CLASS[above] for cls, above in in_knowrob.items()}
    found = []
    for name, classes in (("knowrob", in_knowrob), ("soma", in_soma)):
        statements = renamed(quads, classes)
        if name == "soma":  # parts are stated by hasPhysicalComponent alone
            joints = {quad.subject for quad in quads if quad.object.value == KNOWROB + "Constraint"}
            parts = {ox.NamedNode(relation) for relation in RELATIONS}
            statements = (
                each
                for each in statements
                if (each.predicate not in parts or each.subject in joints) and each.object != PART_MARK
            )
        (tmp_path / f"{name}.nt").write_bytes(ox.serialize(statements, format=ox.RdfFormat.N_TRIPLES))
        found.append(knowledge_base_from(tmp_path / f"{name}.nt", bundled_ontology=True))
    assert found[1].ask("handle_of")
    assert found[1].ask("storage_place_in_environment", item="CowsMilk")
    individuals = [row.individual for row in kitchen.ask("everything_in_map")]
    # An export declares by ms:dialect that its attachments are the statements that were left out here.
    assert_same_answers(*found, individuals[::16], without={"analyze", "where_is"})


def graph_of(kb: KnowledgeBase) -> ox.NamedNode:
    described = ox.NamedNode(KNOWROB + "describedInMap")
    return next(iter(kb.store.quads_for_pattern(None, described, None))).graph_name


@st.composite
def small_maps(draw: st.DrawFn) -> tuple[dict[str, str], dict[str, str]]:
    """The class in KnowRob's terms of a few individuals, and the whole that some are a part of."""
    names = [f"thing_{number}" for number in range(draw(st.integers(2, 5)))]
    classes = {name: draw(st.sampled_from(sorted(SOMA_CLASS))) for name in names}
    wholes = {name: draw(st.sampled_from(names[:at])) for at, name in enumerate(names) if at and draw(st.booleans())}
    return classes, wholes


@settings(max_examples=6, phases=(Phase.explicit, Phase.generate))  # each loads the household ontology twice
@given(described=small_maps(), part=st.sampled_from(("hasPart", "hasComponent", "isComponentOf")))
def test_any_map_gives_the_same_answers_in_both_vocabularies(
    described: tuple[dict[str, str], dict[str, str]], part: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    classes, wholes = described
    found = []
    for is_soma in (False, True):
        lines = [f"@prefix dul: <{DUL}> . :room a k:SemanticEnvironmentMap ."]
        for name, cls in classes.items():
            lines.append(f":{name} a <{SOMA_CLASS[cls] if is_soma else cls}> ; k:describedInMap :room .")
        for name, whole in wholes.items():
            one, other = (name, whole) if part.startswith("is") else (whole, name)
            lines.append(f":{one} dul:{part} :{other} ." if is_soma else f":{whole} k:properPhysicalParts :{name} .")
        path = tmp_path_factory.mktemp("pair") / "room.ttl"
        path.write_text(room_map(*lines), encoding="utf-8")
        found.append(knowledge_base_from(path, bundled_ontology=True))
    assert_same_answers(*found, (ROOM_NAMESPACE + name for name in classes))


def test_a_room_of_knowrob_2_has_handles_storage_places_and_devices(room: KnowledgeBase) -> None:
    handles = room.ask("handle_of", individual="drawer_fridge_upper")
    assert [local_name(row.handle) for row in handles] == ["drawer_fridge_upper_handle"]
    (place,) = room.ask("storage_place_in_environment", item="CowsMilk")
    assert local_name(place.individual) == "drawer_fridge_upper"
    (device,) = room.ask("device_for_action_in_environment", action="BakingFood")
    assert local_name(device.individual) == "drawer_oven_upper"
    assert len(room.ask("articulated_parts")) == 17
    why = room.explain("storage_place_in_environment", place)
    assert why[-1] == "soma:Refrigerator is a knowrob:Refrigerator"


# -- dispositions ------------------------------------------------------------------------------------------------------

LAB = f"""
@prefix : <http://lab.org/lab.owl#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix k: <{KNOWROB}> .
@prefix soma: <{SOMA}> .
@prefix dul: <{DUL}> .
:Piercing a owl:Class ; rdfs:subClassOf soma:Cutting .
:Piercer a owl:Class ; rdfs:subClassOf soma:Variability ,
    [ a owl:Restriction ; owl:onProperty soma:affordsTask ; owl:someValuesFrom :Piercing ] .
:Awl a owl:Class ; rdfs:subClassOf dul:DesignedArtifact ,
    [ a owl:Restriction ; owl:onProperty soma:hasDisposition ; owl:onClass :Piercer ; owl:qualifiedCardinality 1 ] .
:FruitTray a owl:Class ; rdfs:subClassOf soma:DesignedContainer ,
    [ a owl:Restriction ; owl:onProperty soma:hasDisposition ; owl:someValuesFrom [ a owl:Class ; owl:intersectionOf (
        soma:Storage [ a owl:Restriction ; owl:onProperty soma:affordsTrigger ; owl:allValuesFrom
            [ a owl:Restriction ; owl:onProperty dul:classifies ; owl:allValuesFrom soma:Fruit ] ] ) ] ] .
:lab a k:SemanticEnvironmentMap .
:awl a :Awl ; k:describedInMap :lab .
:tray a :FruitTray ; k:describedInMap :lab .
:stone a dul:PhysicalObject ; k:describedInMap :lab ; soma:hasDisposition :edge .
:edge a soma:CanCut .
"""


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> KnowledgeBase:
    path = tmp_path_factory.mktemp("lab") / "lab.ttl"
    path.write_text(LAB, encoding="utf-8")
    return knowledge_base_from(path, bundled_ontology=True)


def test_devices_are_found_by_the_task_that_their_disposition_affords(lab: KnowledgeBase) -> None:
    assert [local_name(row.device) for row in lab.ask("device_for_action", action="Piercing")] == ["Awl", "CuttingTool"]
    awl = lab.ask("device_for_action", device="Awl")
    assert [local_name(row.action) for row in awl] == ["Piercing"]
    assert lab.explain("device_for_action", awl[0]) == (
        "every Awl: hasDisposition exactly 1 Piercer",
        "every Piercer: affordsTask some Piercing",
    )
    handles = lab.ask("device_for_action", action="GraspingSomething")
    assert [local_name(row.device) for row in handles] == ["DesignedHandle"]


def test_individuals_with_a_disposition_of_their_own_are_found(lab: KnowledgeBase) -> None:
    rows = lab.ask("device_for_action_in_environment", action="Cutting")
    assert [(local_name(row.individual), local_name(row.device)) for row in rows] == [("stone", "PhysicalObject")]
    assert lab.explain("device_for_action_in_environment", rows[0])[0] == "stone hasDisposition edge"
    everything = lab.ask("device_for_action_in_environment")
    assert {local_name(row.individual) for row in everything} == {"awl", "stone"}
    assert set(rows) <= set(everything)


def test_storage_places_are_found_by_the_disposition_to_store(lab: KnowledgeBase) -> None:
    places = [local_name(row.place) for row in lab.ask("storage_place", item="Apple")]
    assert "FruitTray" in places
    (tray,) = lab.ask("storage_place_in_environment", item="Apple")
    assert local_name(tray.individual) == "tray"
    assert any("hasDisposition some" in line for line in lab.explain("storage_place_in_environment", tray))


# -- names -------------------------------------------------------------------------------------------------------------


def test_an_ambiguous_class_is_the_one_that_the_maps_use(room: KnowledgeBase, kitchen_in_soma: KnowledgeBase) -> None:
    assert room.ask("individual_of_class", cls="Refrigerator").args["cls"] == SOMA + "Refrigerator"
    assert room.ask("storage_place", item="Bread").args["item"] == SOMA + "Bread"
    assert room.ask("storage_place", place="Refrigerator")
    assert room.ask("class_properties", property="typePrimaryFunction-containerFor", value="Perishable")
    assert kitchen_in_soma.ask("storage_place", item="Bread").args["item"] == KNOWROB + "Bread"


def test_of_several_used_classes_with_one_meaning_any_is_taken(tmp_path: Path) -> None:
    statements = f":one a <{SOMA}Cup> ; k:describedInMap :room . :two a k:Cup ; k:describedInMap :room ."
    (tmp_path / "room.ttl").write_text(room_map(statements), encoding="utf-8")
    kb = knowledge_base_from(tmp_path / "room.ttl", bundled_ontology=True)
    assert {local_name(row.individual) for row in kb.ask("individual_of_class", cls="Cup")} == {"one", "two"}


def test_classes_of_different_meaning_that_maps_use_remain_ambiguous(tmp_path: Path) -> None:
    statements = ":Cup a owl:Class . :one a :Cup ; k:describedInMap :room . :two a k:Cup ; k:describedInMap :room ."
    (tmp_path / "room.ttl").write_text(room_map(statements), encoding="utf-8")
    kb = knowledge_base_from(tmp_path / "room.ttl", bundled_ontology=True)
    with pytest.raises(AmbiguousNameError, match=f"{ROOM_NAMESPACE}Cup"):
        kb.ask("individual_of_class", cls="Cup")
    assert len(kb.ask("individual_of_class", cls="knowrob:Cup")) == 1
