"""Which shape a class gets is said by triples; what nobody says is guessed by name, and said to be a guess."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from pyoxigraph import NamedNode

from mindstage.geometry import SHAPE_TEMPLATES, template_by_name
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.shape_rules import DEFAULT_ROLE, ShapeRule
from mindstage.scene import GeometrySource, Iri, LightType
from mindstage.scene.colors import hex_color
from tests.kitchenette import KNOWROB

MS = "http://mindstage.org/ontology#"
MY = "http://example.org/my#"
HEAD = f"""
@prefix ms: <{MS}> .
@prefix my: <{MY}> .
@prefix knowrob: <{KNOWROB}> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
"""
TOO_GENERAL = {
    *("Artifact", "ConcaveTangibleObject", "ConstructionArtifact", "EnduringThing-Localized", "FluidTangibleThing"),
    *("FurniturePiece", "HumanScaleObject", "InanimateObject", "InanimateObject-NonNatural", "LiquidTangibleThing"),
    *("PhysicalPartOfObject", "TerrestrialFunctioningObject", "MechanicalDevice", "HeatSource"),
    *("PhysicalDevice", "NonPoweredDevice", "PoweredDevice", "ElectricalDevice", "ElectricalComponent"),
    *("CleaningDevice", "CleaningImplement"),
}
"""What things of these classes look like nobody can say; each is one of those below them."""

Teach = Callable[[str], KnowledgeBase]


@pytest.fixture(scope="module")
def household() -> KnowledgeBase:
    return KnowledgeBase()


@pytest.fixture
def teach(tmp_path: Path) -> Teach:
    """A knowledge base that knows the household, and some lines of Turtle."""

    def taught(text: str, *, bundled: bool = True) -> KnowledgeBase:
        path = tmp_path / "mine.ttl"
        path.write_text(HEAD + text, encoding="utf-8")
        knowledge = KnowledgeBase(bundled_ontology=bundled)
        knowledge.load([], ontologies=path)
        return knowledge

    return taught


def rule(knowledge: KnowledgeBase, name: str) -> ShapeRule:
    return knowledge.shape_rule(Iri(name if "//" in name else KNOWROB + name))


# -- what is told ------------------------------------------------------------------------------------------------------


def test_a_drawer_is_shaped_as_one_and_so_is_all_below_it(household: KnowledgeBase) -> None:
    told, inherited = rule(household, "Drawer"), rule(household, "IAIDrawerW60H29")
    assert (told.shape_type, told.source) == ("drawer", GeometrySource.ONTOLOGY)
    assert told.reason == "knowrob:Drawer is shaped as ms:DrawerForm"
    assert (inherited.shape_type, inherited.materials) == (told.shape_type, told.materials)
    assert inherited.reason == "it is a knowrob:Drawer, shaped as ms:DrawerForm"


def test_one_line_teaches_the_shape_of_a_new_class(teach: Teach) -> None:
    known = rule(teach("my:Schub ms:shapedAs ms:DrawerForm ."), MY + "Schub")
    assert (known.shape_type, known.source) == ("drawer", GeometrySource.ONTOLOGY)
    assert known.default_material.pbr_material.name == "wood"  # as drawers are, unless somebody says


def test_a_class_shaped_like_another_one_has_all_that_is_told_of_that(teach: Teach) -> None:
    known = rule(teach("my:Kettle2000 ms:shapedAs knowrob:Milk ."), MY + "Kettle2000")
    milk = rule(KnowledgeBase(), "Milk")
    assert (known.shape_type, known.parameters, known.materials) == (milk.shape_type, milk.parameters, milk.materials)
    assert known.reason == "Kettle2000 is shaped as knowrob:Milk, which is shaped as ms:CartonForm"


def test_each_statement_is_inherited_on_its_own(teach: Teach) -> None:
    knowledge = teach("""
        my:Cupboard ms:shapedAs ms:CaseForm ; ms:madeOf ms:SteelMaterial ; ms:shelves 3 ; ms:wall 0.02 .
        my:LowCupboard rdfs:subClassOf my:Cupboard ; ms:shelves 1 .
        my:RedLowCupboard rdfs:subClassOf my:LowCupboard ; ms:inColour "#cc0000" .
    """)
    known = rule(knowledge, MY + "RedLowCupboard")
    assert (known.shape_type, dict(known.parameters)) == ("case", {"shelves": 1, "wall": 0.02})
    assert (known.default_material.pbr_material.name, hex_color(known.default_material.pbr_material.color)) == (
        "steel",
        "#cc0000",
    )


def test_of_two_superclasses_the_more_special_one_counts_however_they_are_reached(teach: Teach) -> None:
    knowledge = teach("""
        my:General ms:shapedAs ms:BoxForm .
        my:Special rdfs:subClassOf my:General ; ms:shapedAs ms:BallForm .
        my:Between rdfs:subClassOf my:Special .
        my:Thing rdfs:subClassOf my:Between, my:General .
    """)
    assert rule(knowledge, MY + "Thing").shape_type == "ball"


def test_a_color_told_of_a_wider_class_than_the_material_says_nothing(teach: Teach) -> None:
    knowledge = teach("""
        my:Mug rdfs:subClassOf knowrob:DrinkingMug ; ms:madeOf ms:SteelMaterial .
    """)
    steel = rule(knowledge, MY + "Mug").default_material.pbr_material
    assert (steel.name, hex_color(steel.color)) == ("steel", "#c0c6ca")


def test_whoever_paints_a_drawer_paints_its_front(teach: Teach) -> None:
    knowledge = teach('my:Orange rdfs:subClassOf knowrob:Drawer ; ms:inColour "#ff8800" .')
    assert "front" in rule(knowledge, "Drawer").materials
    assert set(rule(knowledge, MY + "Orange").materials) == {DEFAULT_ROLE}


def test_what_a_user_says_of_a_known_class_comes_before_what_is_bundled(teach: Teach) -> None:
    knowledge = teach("knowrob:DrinkingMug ms:shapedAs ms:BowlForm .")
    assert rule(knowledge, "DrinkingMug").shape_type == "bowl"


def test_shapes_told_at_run_time_are_known_at_once_and_forgotten_when_taken_back() -> None:
    knowledge = KnowledgeBase()
    assert rule(knowledge, "DrinkingMug").shape_type == "mug"
    assert knowledge.tell("DrinkingMug", "shapedAs", "knowrob:Bowl")
    assert rule(knowledge, "DrinkingMug").shape_type == "bowl"
    assert knowledge.retract("DrinkingMug", "shapedAs", "knowrob:Bowl")
    assert rule(knowledge, "DrinkingMug").shape_type == "mug"


def test_materials_tell_how_things_weigh_slide_and_bounce(household: KnowledgeBase) -> None:
    mug, milk = rule(household, "DrinkingMug").default_material, rule(household, "CowsMilk").default_material
    assert (mug.density, mug.friction, mug.restitution) == (2400.0, 0.35, 0.4)
    assert milk.density == 1000.0  # it weighs what milk does, not what paper does


def test_lamps_give_light_and_their_kinds_differ(household: KnowledgeBase) -> None:
    ceiling, candle = rule(household, "CeilingLight").light, rule(household, "Candle").light
    assert ceiling is not None
    assert candle is not None
    assert (ceiling.light_type, ceiling.intensity, candle.intensity) == (LightType.POINT, 120.0, 1.0)
    assert rule(household, "Flashlight").light is None  # told to give none: it is switched off
    assert rule(household, "DrinkingMug").light is None


def test_typical_sizes_are_known(household: KnowledgeBase) -> None:
    assert rule(household, "CowsMilk").size == (0.07, 0.07, 0.2)
    assert rule(household, "Artifact").size is None


# -- what is guessed ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "kind", "word"),
    [
        ("BIGDrawerW60H29", "drawer", "drawer"),
        ("CoffeeTable", "table", "coffee table"),
        ("DoorUpperLeft", "door", "door"),
        ("Mugs", "mug", "mug"),
        ("Faucet-Chrome", "tap", "faucet"),
    ],
)
def test_a_word_in_the_name_of_an_unknown_class_is_the_last_resort(
    household: KnowledgeBase, name: str, kind: str, word: str
) -> None:
    guessed = rule(household, MY + name)
    assert (guessed.shape_type, guessed.source) == (kind, GeometrySource.CLASS_NAME)
    assert guessed.reason.startswith(f'"{word}" in its name is the word for ')


def test_what_is_known_comes_before_what_a_name_says(teach: Teach) -> None:
    knowledge = teach("my:DrawerLamp rdfs:subClassOf knowrob:Candle .")
    assert rule(knowledge, MY + "DrawerLamp").source is GeometrySource.ONTOLOGY
    assert rule(knowledge, MY + "DrawerLamp").shape_type == "lamp"


def test_a_material_in_the_name_comes_before_that_of_the_kind(teach: Teach) -> None:
    knowledge = teach("my:SteelBowl rdfs:subClassOf knowrob:Bowl . my:GlassCupboard rdfs:subClassOf knowrob:Cupboard .")
    assert rule(knowledge, MY + "SteelBowl").default_material.pbr_material.name == "steel"
    assert (
        rule(knowledge, MY + "GlassCupboard").default_material.pbr_material.name == "lacquer"
    )  # it is one for glasses


def test_what_nobody_knows_is_a_box_in_a_quiet_color_of_its_own(household: KnowledgeBase) -> None:
    one, other = rule(household, MY + "Gizmo"), rule(household, MY + "Qwertz")
    assert (one.shape_type, one.source, one.reason) == ("box", GeometrySource.MAP, "no annotation for its shape")
    assert one.default_material.pbr_material.color != other.default_material.pbr_material.color
    assert one.default_material.pbr_material == rule(KnowledgeBase(), MY + "Gizmo").default_material.pbr_material


def test_without_the_bundled_ontology_only_the_user_s_own_words_count(teach: Teach) -> None:
    knowledge = teach(
        'my:Form a owl:NamedIndividual ; ms:builtAs "ball" . my:Thing ms:shapedAs my:Form .', bundled=False
    )
    assert rule(knowledge, MY + "Thing").shape_type == "ball"
    assert rule(knowledge, "Drawer").source is GeometrySource.MAP


# -- what cannot be ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "doubt"),
    [
        ('ms:inColour "greenish"', "inColour cannot be"),
        ('ms:typicalSize "1 2"', 'typicalSize cannot be "1 2"; it is depth, width and height in meters'),
        ('ms:givesLight "yes"', 'givesLight cannot be "yes"; it is one of none, point, spot, directional'),
        ("ms:density -3", 'density cannot be "-3"; it is a number from 0'),
        ('ms:madeOf "wood"', 'madeOf cannot be "wood"; it is an IRI'),
    ],
)
def test_what_cannot_be_is_doubted_aloud_and_the_rest_counts(teach: Teach, line: str, doubt: str) -> None:
    known = rule(teach(f"my:Thing ms:shapedAs ms:BallForm ; {line} ."), MY + "Thing")
    assert known.shape_type == "ball"
    assert any(each.startswith(f"Thing: {doubt}") for each in known.issues), known.issues


def test_classes_shaped_like_one_another_end_as_boxes_and_it_is_said(teach: Teach) -> None:
    knowledge = teach("my:Hen ms:shapedAs my:Egg . my:Egg ms:shapedAs my:Hen .")
    assert rule(knowledge, MY + "Hen").shape_type == "box"
    assert "no annotation for its shape" in rule(knowledge, MY + "Hen").reason
    assert rule(knowledge, MY + "Hen").issues


# -- all of it ---------------------------------------------------------------------------------------------------------


def physical(knowledge: KnowledgeBase) -> list[Iri]:
    """The classes of the bundled ontology that a map may hold."""
    kinds = knowledge.store.quads_for_pattern(
        None,
        NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type"),
        NamedNode("http://www.w3.org/2002/07/owl#Class"),
    )
    named = {Iri(quad.subject.value) for quad in kinds if isinstance(quad.subject, NamedNode)}
    return sorted(cls for cls in named if knowledge.is_a(cls, Iri(KNOWROB + "EnduringThing-Localized")))


def test_every_class_that_a_map_may_hold_has_a_shape_that_can_be_built(household: KnowledgeBase) -> None:
    rules = {cls: household.shape_rule(cls) for cls in physical(household)}
    assert len(rules) > 500
    vague = {cls.rpartition("#")[2] for cls, known in rules.items() if known.source is not GeometrySource.ONTOLOGY}
    assert vague == TOO_GENERAL
    assert {known.shape_type for known in rules.values()} <= SHAPE_TEMPLATES.keys()
    assert [known.issues for known in rules.values() if known.issues] == []


def test_every_parameter_that_is_told_can_be_read_by_some_builder_that_it_is_told_for(household: KnowledgeBase) -> None:
    used = set()
    for cls in physical(household):
        known = household.shape_rule(cls)
        fields = SHAPE_TEMPLATES[known.shape_type].__struct_fields__
        template_by_name(known.shape_type, {name: value for name, value in known.parameters.items() if name in fields})
        used |= known.parameters.keys() & set(fields)
    told = {name for cls in physical(household) for name in household.shape_rule(cls).parameters}
    assert told - used == set()


def test_all_that_can_be_seen_is_made_of_something(household: KnowledgeBase) -> None:
    made = {cls.rpartition("#")[2]: rule(household, cls).default_material.pbr_material for cls in physical(household)}
    bare = {name for name, surface in made.items() if not surface.name}
    assert bare - TOO_GENERAL == {"Cube"}  # of which nobody knows anything


def test_forms_and_materials_are_no_individuals_that_questions_could_find(household: KnowledgeBase) -> None:
    known = household.reasoner.individuals
    assert [name for name in known.types if name.endswith(("Form", "Material"))] == []


def test_the_community_s_ontologies_beside_ours_change_no_shape(shared_data: Path) -> None:
    map = shared_data / "maps" / "iai-kitchen-original.owl"
    alone, beside = KnowledgeBase(), KnowledgeBase()
    alone.load(map)
    beside.load(map, ontologies=sorted((shared_data / "ontology").rglob("*.owl")))
    for cls in {body.cls for body in alone.world().bodies}:
        ours, both = alone.shape_rule(cls), beside.shape_rule(cls)
        assert (ours.shape_type, ours.materials, ours.light) == (both.shape_type, both.materials, both.light), cls
