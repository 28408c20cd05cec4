"""Forms of whole worlds: where they come from, what is told of them, and what becomes of odd bodies."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.knowledge import KnowledgeBase, bundled_kitchen
from mindstage.shapes.fitting import forms_for
from mindstage.shapes.fitting.facing import CLOSING
from mindstage.world import (
    Body,
    BodyId,
    Form,
    FormSource,
    Iri,
    LinearMotion,
    Material,
    Shape,
    ShapeKind,
    World,
)
from mindstage.world.geometry import Array, compose, conjugate, pose_array, rotate, rotation_matrix, unit
from tests.kitchenette import KNOWROB, kitchenette
from tests.shapes.fitting_scenes import (
    MY,
    box_of,
    fit,
    slide,
    thing,
    world,
)


@pytest.fixture(scope="module")
def household() -> KnowledgeBase:
    return KnowledgeBase()


@pytest.fixture(scope="module")
def kitchen() -> World:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    return knowledge.world()


# -- what it is taken from ---------------------------------------------------------------------------------------------


def test_an_unknown_class_guessed_by_its_name_is_reported_once_for_all(household: KnowledgeBase) -> None:
    mugs = [thing(f"mug_{number}", MY + "FancyMug", (number, 0, 0), (0.08, 0.08, 0.1)) for number in range(5)]
    fitted = fit(household, *mugs)
    assert {form.source for form in fitted.forms.values()} == {FormSource.NAME}
    (note,) = fitted.notes
    assert note.ids == tuple(mug.id for mug in mugs)
    assert note.text.startswith("mug_0, mug_1, mug_2 and 2 more: is shaped as a mug by a guess")


def test_the_map_s_own_shape_counts_where_nobody_knows_better(household: KnowledgeBase) -> None:
    kinds = {
        shape: fit(household, replace(thing("it", MY + "Gizmo", (0, 0, 0), (0.1, 0.1, 0.1)), shape=shape)).forms
        for shape in (None, Shape(kind=ShapeKind.CYLINDER), Shape(kind=ShapeKind.SPHERE))
    }
    assert [forms[BodyId("it")].kind for forms in kinds.values()] == ["box", "cylinder", "ball"]
    assert {forms[BodyId("it")].source for forms in kinds.values()} == {FormSource.MAP}


def test_a_colour_that_the_map_tells_is_the_body_s(household: KnowledgeBase) -> None:
    red = (1.0, 0.0, 0.0)
    mug = replace(
        thing("mug", "DrinkingMug", (0, 0, 0), (0.08, 0.08, 0.1)), materials=(Material(name="red", colour=red),)
    )
    assert fit(household, mug).forms[mug.id].skins[0].surface.colour == red


def test_a_lamp_s_light_is_a_part_of_its_form(household: KnowledgeBase) -> None:
    form = fit(household, thing("lamp", "CeilingLight", (0, 0, 2.4), (0.4, 0.4, 0.06))).forms[BodyId("lamp")]
    assert [glow.intensity for glow in form.glows] == [120.0]


def test_forms_feel_as_their_material_does(household: KnowledgeBase) -> None:
    form = fit(household, thing("mug", "DrinkingMug", (0, 0, 0), (0.08, 0.08, 0.1))).forms[BodyId("mug")]
    assert (form.friction, form.restitution, form.density) == (0.35, 0.4, 2400.0)


def test_meshes_come_first_and_are_asked_for_once(household: KnowledgeBase) -> None:
    mug, plate = (
        thing("mug", "DrinkingMug", (0, 0, 0), (0.08, 0.08, 0.1)),
        thing("plate", "DinnerPlate", (1, 0, 0), (0.2, 0.2, 0.02)),
    )
    mesh = Form(key="00", skins=(), solids=(), source=FormSource.MESH, kind="mesh")
    asked = []

    class Meshes:
        def forms(self, bodies: Sequence[Body]) -> FoundMeshes:
            asked.append(tuple(bodies))
            return FoundMeshes({mug.id: mesh}, ("mug.obj is scaled",))

    fitted = forms_for(world([mug, plate]), household, meshes=Meshes())
    assert asked == [(mug, plate)]
    assert fitted.forms[mug.id] is mesh
    assert fitted.forms[plate.id].kind == "plate"
    assert [note.text for note in fitted.notes] == ["mug.obj is scaled"]


class FoundMeshes(NamedTuple):
    forms: dict[BodyId, Form]
    notes: tuple[str, ...]


def test_the_door_of_an_oven_is_of_glass_because_the_oven_says_so(household: KnowledgeBase) -> None:
    oven, door = (
        thing("oven", "Oven", (0, 0, 0), (0.6, 0.6, 0.6)),
        thing("door", "Door", (0.31, 0, 0), (0.02, 0.6, 0.6)),
    )
    fridge = replace(oven, cls=Iri(KNOWROB + "Refrigerator"))
    joint = replace(slide("oven", "door"), linear=LinearMotion())
    made = [
        forms_for(world([holder, door], [joint]), household).forms[door.id].skins[0].surface.material
        for holder in (oven, fridge)
    ]
    assert made == ["black glass", "lacquer"]


@pytest.mark.parametrize("name", ["iai-kitchen-original", "ameva-task-two", "soma-iai-room", "knowrob1-ccrl"])
def test_maps_of_all_dialects_get_forms_and_what_is_guessed_is_told(shared_data: Path, name: str) -> None:
    knowledge = KnowledgeBase()
    knowledge.load(shared_data / "maps" / f"{name}.owl")
    described = knowledge.world()
    fitted = forms_for(described, knowledge)
    sized = {body.id for body in described.bodies if body.size and min(body.size) > 0.0}
    assert fitted.forms.keys() == sized
    guessed = {id for id, form in fitted.forms.items() if form.source is FormSource.NAME}
    assert guessed == {id for note in fitted.notes for id in note.ids if "by a guess" in note.text}
    assert not any("cannot be built" in note.text for note in fitted.notes)


# -- odd worlds --------------------------------------------------------------------------------------------------------


def test_a_world_without_bodies_has_no_forms(household: KnowledgeBase) -> None:
    assert (dict(fit(household).forms), fit(household).notes) == ({}, ())


def test_what_has_no_size_or_no_extent_stays_as_it_is(household: KnowledgeBase) -> None:
    fitted = fit(
        household, thing("mug", "DrinkingMug", (0, 0, 0), None), thing("door", "Door", (1, 0, 0), (0.0, 0.6, 0.8))
    )
    assert dict(fitted.forms) == {}
    assert [(note.ids, note.text) for note in fitted.notes] == [
        (("door",), "door: has no extent along one of its axes, so it stays as the map has it")
    ]


def test_a_form_that_no_builder_makes_becomes_a_box_and_it_is_said(tmp_path: Path) -> None:
    (tmp_path / "mine.ttl").write_text(
        """@prefix ms: <http://mindstage.org/ontology#> . @prefix my: <http://example.org/my#> .
        my:Form ms:builtAs "drawr" . my:Thing ms:shapedAs my:Form .""",
        encoding="utf-8",
    )
    knowledge = KnowledgeBase()
    knowledge.load([], ontologies=tmp_path / "mine.ttl")
    fitted = fit(knowledge, thing("it", MY + "Thing", (0, 0, 0), (0.1, 0.2, 0.3)))
    assert fitted.forms[BodyId("it")].kind == "box"
    (note,) = fitted.notes
    assert "'drawr'" in note.text
    assert "drawer" in note.text


def test_a_crowd_is_told_of_and_left_alone(household: KnowledgeBase) -> None:
    drawers = [thing(f"drawer_{number}", "Drawer", (0, 0, 0), (0.5, 0.5, 0.2), loose=True) for number in range(600)]
    fitted = fit(household, *drawers)
    assert len(fitted.forms) == 600
    assert [len(note.ids) for note in fitted.notes if "crowd" in note.text] == [600]


def test_forms_do_not_depend_on_the_order_of_bodies(household: KnowledgeBase) -> None:
    described = kitchenette()
    backwards = replace(described, bodies=described.bodies[::-1])
    forms, again = forms_for(described, household).forms, forms_for(backwards, household).forms
    assert {id: form.key for id, form in forms.items()} == {id: form.key for id, form in again.items()}


# -- the whole kitchen -------------------------------------------------------------------------------------------------


def test_in_the_bundled_kitchen_nobody_has_to_guess_how_to_open_something(kitchen: World) -> None:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    fitted = forms_for(knowledge.world(), knowledge)
    assert set(fitted.forms) == {body.id for body in kitchen.bodies}
    assert {form.source for form in fitted.forms.values()} == {FormSource.KNOWLEDGE}
    guessed = {id for note in fitted.notes for id in note.ids}
    assert not any(fitted.forms[id].kind in (*CLOSING, "case", "shelf") for id in guessed)


def test_in_the_bundled_kitchen_nothing_loose_stands_in_the_walls_of_a_case_or_drawer(kitchen: World) -> None:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    forms = forms_for(kitchen, knowledge).forms
    hosts = [body for body in kitchen.bodies if forms[body.id].kind in ("case", "drawer")]
    loose = [body for body in kitchen.bodies if body.physics.simulates and forms[body.id].kind not in CLOSING]
    poses = pose_array(body.pose for body in kitchen.bodies)
    where = dict(zip((body.id for body in kitchen.bodies), np.hstack([poses[:, :3], unit(poses[:, 3:])]), strict=True))
    deepest = 0.0
    for host in hosts:
        boxes = [box_of(solid) for solid in forms[host.id].solids]
        for body in loose:
            pose = compose(_inverse(where[host.id]), where[body.id])
            reach = np.abs(rotation_matrix(pose[3:])) @ np.array(body.size) / 2
            for low, high in boxes:
                overlap = np.minimum(high, pose[:3] + reach) - np.maximum(low, pose[:3] - reach)
                deepest = max(deepest, float(overlap.min()))
    assert deepest < 0.002


def _inverse(pose: Array) -> Array:
    back = conjugate(pose[3:])
    return np.concatenate([-rotate(back, pose[:3]), back])
