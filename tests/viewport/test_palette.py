"""What colour a thing has."""

from __future__ import annotations

from colorsys import rgb_to_hls

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.viewport.palette import Paint, Surface, dimmed, lit, local_name, nouns, paint, surface, words
from mindstage.world import Iri, Material
from tests.kitchenette import KNOWROB

AFAR = "http://example.org/far#"


def knowrob(*names: str) -> tuple[Iri, ...]:
    return tuple(Iri(KNOWROB + name) for name in names)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("WallOfAConstruction", Surface.WALL),
        ("IAILabFloor", Surface.FLOOR),
        ("Cupboard", Surface.WOOD),
        ("Table-PieceOfFurniture", Surface.WOOD),
        ("IAIDrawerW60H29", Surface.FRONT),
        ("CounterTop", Surface.STONE),
        ("Refrigerator-Freezer", Surface.STEEL),
        ("StoveTop", Surface.BLACK_GLASS),
        ("IAIHandleW60", Surface.DARK_METAL),
        ("CowsMilk", Surface.FOOD),
        ("DinnerPlate", Surface.CERAMIC),
        ("IAICeilingLight", Surface.LAMP),
        ("DrinkingGlass", Surface.GLASS),
        ("Tomatoes", Surface.FOOD),
    ],
)
def test_the_last_word_of_a_class_says_what_it_is(name: str, expected: Surface) -> None:
    assert surface(*knowrob(name)) is expected


def test_an_ancestor_is_asked_before_a_word_inside_the_name() -> None:
    assert surface(*knowrob("TableThing")) is Surface.WOOD
    assert surface(knowrob("TableThing")[0], knowrob("Salt")) is Surface.FOOD


def test_the_nearest_ancestor_that_says_something_decides() -> None:
    assert surface(Iri(AFAR + "Xyz"), knowrob("Artifact", "DrinkingMug", "Handle")) is Surface.CERAMIC


def test_a_box_of_food_is_food_and_a_box_of_nothing_is_a_box() -> None:
    assert surface(knowrob("PastaBox")[0], knowrob("Pasta", "Food")) is Surface.FOOD
    assert surface(*knowrob("StorageBox")) is Surface.WOOD


def test_the_door_of_a_machine_is_made_like_the_machine_and_its_handle_is_not() -> None:
    assert surface(knowrob("IAIFridgeDoor")[0], knowrob("Door")) is Surface.STEEL
    assert surface(knowrob("IAIOvenDoorHandle")[0], knowrob("Handle")) is Surface.DARK_METAL
    assert surface(knowrob("CupboardDoor")[0], knowrob("Door")) is Surface.FRONT


def test_a_wooden_spoon_is_of_wood() -> None:
    assert surface(knowrob("WoodenSpoon")[0], knowrob("Spoon")) is Surface.WOOD


def test_a_colour_of_the_material_comes_before_all_guessing() -> None:
    materials = (Material(name="plain"), Material(name="pink", colour=(1.0, 0.5, 0.6)))
    assert paint(*knowrob("Refrigerator"), materials=materials) == Paint((1.0, 0.5, 0.6))


def test_glass_is_seen_through_and_wine_in_it_is_red() -> None:
    empty = paint(knowrob("WineGlass")[0], knowrob("DrinkingGlass"))
    bottle = paint(knowrob("RedWineBottle")[0], knowrob("RedWine", "Drink"))
    assert empty.opacity < 0.5 < bottle.opacity < 1.0
    assert bottle.colour[0] > 2 * bottle.colour[1]


@given(name=st.from_regex(r"[A-Z][a-z]{2,12}", fullmatch=True).map(lambda name: f"{name}qx"))
def test_a_class_that_says_nothing_has_a_quiet_colour_of_its_own(name: str) -> None:
    first, again = paint(Iri(AFAR + name)), paint(Iri(f"http://elsewhere.org/{name}"))
    assert first == again
    _, lightness, saturation = rgb_to_hls(*first.colour)
    assert saturation < 0.2
    assert 0.6 < lightness < 0.75


def test_things_of_one_class_have_one_colour() -> None:
    assert paint(*knowrob("Sofa")) == paint(*knowrob("Sofa"))


def test_a_highlight_is_seen_on_glass_too() -> None:
    glass = Paint((0.5, 0.5, 0.5), 0.3)
    assert lit(glass, None) == glass
    assert lit(glass, (1.0, 0.0, 0.0)).colour == (1.0, 0.0, 0.0)
    assert lit(glass, (1.0, 0.0, 0.0)).opacity > 0.8


def test_what_is_dimmed_is_paler_and_seen_through() -> None:
    oak = Paint((0.6, 0.4, 0.2))
    paler = dimmed(oak)
    assert paler.opacity < 0.5
    assert max(paler.colour) - min(paler.colour) < 0.5 * (max(oak.colour) - min(oak.colour))
    assert dimmed(Paint((0.5, 0.5, 0.5), 0.1)).opacity == 0.1


def test_codes_and_homonym_marks_are_no_words() -> None:
    assert words("http://x.org/a#IAIDrawerW60D56H29") == ("drawer",)
    assert words("http://x.org/a#Tap-PlumbingFixture") == ("tap",)
    assert words("http://x.org/kitchen_island_2") == ("kitchen", "island")
    assert words("http://x.org/2#") == ()


def test_nouns_come_in_the_order_of_the_classes() -> None:
    assert nouns(knowrob("DinnerPlate")[0], knowrob("EatingVessel"))[0] == "plate"
    assert "vessel" in nouns(knowrob("DinnerPlate")[0], knowrob("EatingVessel"))


def test_a_local_name_is_what_stands_last() -> None:
    assert local_name("http://x.org/maps/kitchen.owl#Mug_1") == "Mug_1"
    assert local_name("http://x.org/things/Mug") == "Mug"
