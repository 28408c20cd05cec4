"""Shape rules of classes: ontology statements, inheritance, and guesses from class names."""

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
from tests.cases import each_case
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
"""Abstract classes without a shape of their own."""

LoadTurtle = Callable[[str], KnowledgeBase]


@pytest.fixture(scope="module")
def bundled_knowledge() -> KnowledgeBase:
    return KnowledgeBase()


@pytest.fixture
def load_turtle(tmp_path: Path) -> LoadTurtle:
    """A knowledge base that knows the bundled_knowledge, and some lines of Turtle."""

    def load(text: str, *, bundled: bool = True) -> KnowledgeBase:
        path = tmp_path / "mine.ttl"
        path.write_text(HEAD + text, encoding="utf-8")
        knowledge = KnowledgeBase(bundled_ontology=bundled)
        knowledge.load([], ontologies=path)
        return knowledge

    return load


def rule(knowledge: KnowledgeBase, name: str) -> ShapeRule:
    return knowledge.shape_rule(Iri(name if "//" in name else KNOWROB + name))


# -- statements --------------------------------------------------------------------------------------------------------


def test_a_shape_is_inherited_by_subclasses(bundled_knowledge: KnowledgeBase) -> None:
    stated, inherited = rule(bundled_knowledge, "Drawer"), rule(bundled_knowledge, "IAIDrawerW60H29")
    assert (stated.shape_type, stated.source) == ("drawer", GeometrySource.ONTOLOGY)
    assert stated.reason == "knowrob:Drawer is shaped as ms:DrawerForm"
    assert (inherited.shape_type, inherited.materials) == (stated.shape_type, stated.materials)
    assert inherited.reason == "it is a knowrob:Drawer, shaped as ms:DrawerForm"


def test_one_statement_defines_the_shape_of_a_new_class(load_turtle: LoadTurtle) -> None:
    known = rule(load_turtle("my:Schub ms:shapedAs ms:DrawerForm ."), MY + "Schub")
    assert (known.shape_type, known.source) == ("drawer", GeometrySource.ONTOLOGY)
    assert known.default_material.pbr_material.name == "wood"  # the default of drawers


def test_a_class_shaped_as_another_class_has_its_rule(load_turtle: LoadTurtle) -> None:
    known = rule(load_turtle("my:Kettle2000 ms:shapedAs knowrob:Milk ."), MY + "Kettle2000")
    milk = rule(KnowledgeBase(), "Milk")
    assert (known.shape_type, known.parameters, known.materials) == (milk.shape_type, milk.parameters, milk.materials)
    assert known.reason == "Kettle2000 is shaped as knowrob:Milk, which is shaped as ms:CartonForm"


def test_each_statement_is_inherited_separately(load_turtle: LoadTurtle) -> None:
    knowledge = load_turtle("""
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


def test_the_most_specific_superclass_takes_precedence(load_turtle: LoadTurtle) -> None:
    knowledge = load_turtle("""
        my:General ms:shapedAs ms:BoxForm .
        my:Special rdfs:subClassOf my:General ; ms:shapedAs ms:BallForm .
        my:Between rdfs:subClassOf my:Special .
        my:Thing rdfs:subClassOf my:Between, my:General .
    """)
    assert rule(knowledge, MY + "Thing").shape_type == "ball"


def test_a_color_of_a_wider_class_than_the_material_is_ignored(load_turtle: LoadTurtle) -> None:
    knowledge = load_turtle("""
        my:Mug rdfs:subClassOf knowrob:DrinkingMug ; ms:madeOf ms:SteelMaterial .
    """)
    steel = rule(knowledge, MY + "Mug").default_material.pbr_material
    assert (steel.name, hex_color(steel.color)) == ("steel", "#c0c6ca")


def test_the_color_of_a_drawer_applies_to_its_front(load_turtle: LoadTurtle) -> None:
    knowledge = load_turtle('my:Orange rdfs:subClassOf knowrob:Drawer ; ms:inColour "#ff8800" .')
    assert "front" in rule(knowledge, "Drawer").materials
    assert set(rule(knowledge, MY + "Orange").materials) == {DEFAULT_ROLE}


def test_user_statements_override_the_bundled_ontology(load_turtle: LoadTurtle) -> None:
    knowledge = load_turtle("knowrob:DrinkingMug ms:shapedAs ms:BowlForm .")
    assert rule(knowledge, "DrinkingMug").shape_type == "bowl"


def test_shape_statements_at_run_time_take_effect_and_can_be_retracted() -> None:
    knowledge = KnowledgeBase()
    assert rule(knowledge, "DrinkingMug").shape_type == "mug"
    assert knowledge.tell("DrinkingMug", "shapedAs", "knowrob:Bowl")
    assert rule(knowledge, "DrinkingMug").shape_type == "bowl"
    assert knowledge.retract("DrinkingMug", "shapedAs", "knowrob:Bowl")
    assert rule(knowledge, "DrinkingMug").shape_type == "mug"


def test_materials_define_density_friction_and_restitution(bundled_knowledge: KnowledgeBase) -> None:
    mug, milk = (
        rule(bundled_knowledge, "DrinkingMug").default_material,
        rule(bundled_knowledge, "CowsMilk").default_material,
    )
    assert (mug.density, mug.friction, mug.restitution) == (2400.0, 0.35, 0.4)
    assert milk.density == 1000.0  # it weighs what milk does, not what paper does


def test_lamps_have_lights_of_different_types(bundled_knowledge: KnowledgeBase) -> None:
    ceiling, candle = rule(bundled_knowledge, "CeilingLight").light, rule(bundled_knowledge, "Candle").light
    assert ceiling is not None
    assert candle is not None
    assert (ceiling.light_type, ceiling.intensity, candle.intensity) == (LightType.POINT, 120.0, 1.0)
    assert rule(bundled_knowledge, "Flashlight").light is None  # stated to be off
    assert rule(bundled_knowledge, "DrinkingMug").light is None


def test_typical_sizes_are_known(bundled_knowledge: KnowledgeBase) -> None:
    assert rule(bundled_knowledge, "CowsMilk").size == (0.07, 0.07, 0.2)
    assert rule(bundled_knowledge, "Artifact").size is None


# -- guesses -----------------------------------------------------------------------------------------------------------


@each_case(
    ("name", "kind", "word"),
    [
        ("BIGDrawerW60H29", "drawer", "drawer"),
        ("CoffeeTable", "table", "coffee table"),
        ("DoorUpperLeft", "door", "door"),
        ("Mugs", "mug", "mug"),
        ("Faucet-Chrome", "tap", "faucet"),
        ("DishWasher", "case", "dishwasher"),
        ("PKDishWasherLowerHolder", "case", "dishwasher"),
        ("CupBoards", "case", "cupboard"),
        ("DishWasherDoor", "door", "door"),
    ],
)
def test_the_shape_of_an_unknown_class_is_guessed_from_its_name(
    bundled_knowledge: KnowledgeBase, name: str, kind: str, word: str
) -> None:
    guessed = rule(bundled_knowledge, MY + name)
    assert (guessed.shape_type, guessed.source) == (kind, GeometrySource.CLASS_NAME)
    assert guessed.reason.startswith(f'"{word}" in its name is the word for ')


def test_a_shape_rule_takes_precedence_over_the_class_name(load_turtle: LoadTurtle) -> None:
    knowledge = load_turtle("my:DrawerLamp rdfs:subClassOf knowrob:Candle .")
    assert rule(knowledge, MY + "DrawerLamp").source is GeometrySource.ONTOLOGY
    assert rule(knowledge, MY + "DrawerLamp").shape_type == "lamp"


def test_a_material_in_the_class_name_overrides_that_of_the_shape(load_turtle: LoadTurtle) -> None:
    knowledge = load_turtle(
        "my:SteelBowl rdfs:subClassOf knowrob:Bowl . my:GlassCupboard rdfs:subClassOf knowrob:Cupboard ."
    )
    assert rule(knowledge, MY + "SteelBowl").default_material.pbr_material.name == "steel"
    assert (
        rule(knowledge, MY + "GlassCupboard").default_material.pbr_material.name == "lacquer"
    )  # it is one for glasses


def test_an_unknown_class_is_a_box_in_its_own_color(bundled_knowledge: KnowledgeBase) -> None:
    one, other = rule(bundled_knowledge, MY + "Gizmo"), rule(bundled_knowledge, MY + "Qwertz")
    assert (one.shape_type, one.source, one.reason) == ("box", GeometrySource.MAP, "no annotation for its shape")
    assert one.default_material.pbr_material.color != other.default_material.pbr_material.color
    assert one.default_material.pbr_material == rule(KnowledgeBase(), MY + "Gizmo").default_material.pbr_material


def test_without_the_bundled_ontology_only_user_statements_apply(load_turtle: LoadTurtle) -> None:
    knowledge = load_turtle(
        'my:Form a owl:NamedIndividual ; ms:builtAs "ball" . my:Thing ms:shapedAs my:Form .', bundled=False
    )
    assert rule(knowledge, MY + "Thing").shape_type == "ball"
    assert rule(knowledge, "Drawer").source is GeometrySource.MAP


# -- invalid statements------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "issue"),
    [
        ('ms:inColour "greenish"', "inColour cannot be"),
        ('ms:typicalSize "1 2"', 'typicalSize cannot be "1 2"; expected depth, width and height in meters'),
        ('ms:givesLight "yes"', 'givesLight cannot be "yes"; expected one of none, point, spot, directional'),
        ("ms:density -3", 'density cannot be "-3"; expected a number from 0'),
        ('ms:madeOf "wood"', 'madeOf cannot be "wood"; expected an IRI'),
    ],
)
def test_invalid_statements_are_reported_and_the_rest_applies(load_turtle: LoadTurtle, line: str, issue: str) -> None:
    known = rule(load_turtle(f"my:Thing ms:shapedAs ms:BallForm ; {line} ."), MY + "Thing")
    assert known.shape_type == "ball"
    assert any(each.startswith(f"Thing: {issue}") for each in known.issues), known.issues


def test_circular_shape_statements_give_a_box_with_an_issue(load_turtle: LoadTurtle) -> None:
    knowledge = load_turtle("my:Hen ms:shapedAs my:Egg . my:Egg ms:shapedAs my:Hen .")
    assert rule(knowledge, MY + "Hen").shape_type == "box"
    assert "no annotation for its shape" in rule(knowledge, MY + "Hen").reason
    assert rule(knowledge, MY + "Hen").issues


# -- all classes -------------------------------------------------------------------------------------------------------


def physical_classes(knowledge: KnowledgeBase) -> list[Iri]:
    """Returns the classes of the bundled ontology that a body can have."""
    kinds = knowledge.store.quads_for_pattern(
        None,
        NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type"),
        NamedNode("http://www.w3.org/2002/07/owl#Class"),
    )
    named = {Iri(quad.subject.value) for quad in kinds if isinstance(quad.subject, NamedNode)}
    return sorted(cls for cls in named if knowledge.is_a(cls, Iri(KNOWROB + "EnduringThing-Localized")))


def test_every_physical_class_has_a_valid_shape(bundled_knowledge: KnowledgeBase) -> None:
    rules = {cls: bundled_knowledge.shape_rule(cls) for cls in physical_classes(bundled_knowledge)}
    assert len(rules) > 500
    vague = {cls.rpartition("#")[2] for cls, known in rules.items() if known.source is not GeometrySource.ONTOLOGY}
    assert vague == TOO_GENERAL
    assert {known.shape_type for known in rules.values()} <= SHAPE_TEMPLATES.keys()
    assert [known.issues for known in rules.values() if known.issues] == []


def test_every_stated_parameter_is_valid_for_its_shape(bundled_knowledge: KnowledgeBase) -> None:
    used = set()
    for cls in physical_classes(bundled_knowledge):
        known = bundled_knowledge.shape_rule(cls)
        fields = SHAPE_TEMPLATES[known.shape_type].__struct_fields__
        template_by_name(known.shape_type, {name: value for name, value in known.parameters.items() if name in fields})
        used |= known.parameters.keys() & set(fields)
    stated = {
        name for cls in physical_classes(bundled_knowledge) for name in bundled_knowledge.shape_rule(cls).parameters
    }
    assert stated - used == set()


def test_every_physical_class_has_a_material(bundled_knowledge: KnowledgeBase) -> None:
    made = {
        cls.rpartition("#")[2]: rule(bundled_knowledge, cls).default_material.pbr_material
        for cls in physical_classes(bundled_knowledge)
    }
    bare = {name for name, surface in made.items() if not surface.name}
    assert bare - TOO_GENERAL == {"Cube"}  # without a stated material


def test_shapes_and_materials_are_not_individuals_for_queries(bundled_knowledge: KnowledgeBase) -> None:
    known = bundled_knowledge.reasoner.individuals
    assert [name for name in known.types if name.endswith(("Form", "Material"))] == []


def test_additional_community_ontologies_change_no_shape(shared_data: Path) -> None:
    map = shared_data / "maps" / "iai-kitchen-original.owl"
    alone, beside = KnowledgeBase(), KnowledgeBase()
    alone.load(map)
    beside.load(map, ontologies=sorted((shared_data / "ontology").rglob("*.owl")))
    for cls in {body.cls for body in alone.world().bodies}:
        ours, both = alone.shape_rule(cls), beside.shape_rule(cls)
        assert (ours.shape_type, ours.materials, ours.light) == (both.shape_type, both.materials, both.light), cls


# -- textures ----------------------------------------------------------------------------------------------------------


def texture(knowledge: KnowledgeBase, name: str, role: str = DEFAULT_ROLE) -> str:
    return rule(knowledge, name).materials[role].pbr_material.texture


@each_case(
    ("name", "expected"),
    [
        ("Floor", "floor_tiles"),
        ("WallOfAConstruction", "plaster"),
        ("CounterTop", "granite"),
        ("Table-PieceOfFurniture", "oak_staves"),
        ("Refrigerator", "enamel"),
        ("Dishwasher", "enamel"),
        ("Sofa-PieceOfFurniture", "upholstery"),
        ("WindowCurtain", "linen"),
        ("Bread", "bread_crust"),
        ("CerealBowl", "glazed_ceramic"),
    ],
)
def test_bundled_classes_have_textures_of_their_substance(
    bundled_knowledge: KnowledgeBase, name: str, expected: str
) -> None:
    assert texture(bundled_knowledge, name if name != "CerealBowl" else MS + "CerealBowl") == expected


def test_a_texture_is_inherited_until_a_more_specific_material(load_turtle: LoadTurtle) -> None:
    knowledge = load_turtle(
        """
        my:Bench a owl:Class ; rdfs:subClassOf knowrob:Table-PieceOfFurniture .
        my:SteelBench2 a owl:Class ; rdfs:subClassOf my:Bench ; ms:madeOf ms:SteelMaterial .
        my:PlainBench a owl:Class ; rdfs:subClassOf my:Bench ; ms:texture "none" .
        my:OwnMaterial a owl:NamedIndividual ; ms:texture "walnut_board" ; ms:inColour "#8a6242" .
        my:OwnBench a owl:Class ; rdfs:subClassOf my:Bench ; ms:madeOf my:OwnMaterial ; ms:inColour "#102030" .
        """
    )
    found = {name: rule(knowledge, MY + name).default_material.pbr_material for name in ("Bench", "OwnBench")}
    assert found["Bench"].texture == "oak_staves"
    assert texture(knowledge, MY + "SteelBench2") == "brushed_steel"
    assert texture(knowledge, MY + "PlainBench") == ""
    assert found["OwnBench"].texture == "walnut_board"
    assert hex_color(found["OwnBench"].color) == "#102030", "the color is the class's own"


@pytest.mark.parametrize("subject", ["my:Thing", "my:Stuff"])
def test_an_unknown_texture_is_reported_with_similar_names(load_turtle: LoadTurtle, subject: str) -> None:
    knowledge = load_turtle(
        f"""
        my:Thing a owl:Class ; rdfs:subClassOf knowrob:Table-PieceOfFurniture ; ms:madeOf my:Stuff .
        my:Stuff a owl:NamedIndividual ; ms:inColour "#8a6242" .
        {subject} ms:texture "oak_bord" .
        """
    )
    (issue,) = rule(knowledge, MY + "Thing").issues
    assert subject[3:] in issue
    assert "oak_board" in issue


def test_the_word_on_a_package_is_the_label_of_its_class(load_turtle: LoadTurtle) -> None:
    knowledge = load_turtle(
        """
        my:MilkPack a owl:Class ; rdfs:subClassOf ms:OrangeJuice .
        my:Brand a owl:Class ; rdfs:subClassOf ms:OrangeJuice ; ms:word "sunny" .
        """
    )
    assert rule(knowledge, MY + "MilkPack").word == "orange juice"
    assert rule(knowledge, MY + "Brand").parameters["word"] == "sunny"
    assert rule(knowledge, "CowsMilk").parameters["word"] == "milk"
