"""Geometry of whole worlds: its sources, notes and special cases."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.geometry.fit import fit_geometry
from mindstage.geometry.orientation import CLOSING_SHAPES
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.scene import (
    Body,
    BodyGeometry,
    BodyId,
    GeometrySource,
    Iri,
    LinearLimits,
    Material,
    PrimitiveShape,
    PrimitiveType,
    World,
)
from mindstage.scene.transforms import (
    Array,
    normalize,
    pose_array,
    pose_multiply,
    quat_conjugate,
    quat_rotate,
    rotation_matrix,
)
from tests.geometry.fit_scenes import MY, box_of, fit, make_body, slide_joint, world
from tests.kitchenette import KNOWROB, kitchenette


@pytest.fixture(scope="module")
def bundled_knowledge() -> KnowledgeBase:
    return KnowledgeBase()


@pytest.fixture(scope="module")
def kitchen() -> World:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    return knowledge.world()


# -- sources -----------------------------------------------------------------------------------------------------------


def test_a_guess_from_a_class_name_is_one_note_for_all_bodies(bundled_knowledge: KnowledgeBase) -> None:
    mugs = [make_body(f"mug_{number}", MY + "FancyMug", (number, 0, 0), (0.08, 0.08, 0.1)) for number in range(5)]
    fitted = fit(bundled_knowledge, *mugs)
    assert {geometry.source for geometry in fitted.geometry.values()} == {GeometrySource.CLASS_NAME}
    (note,) = fitted.notes
    assert note.ids == tuple(mug.id for mug in mugs)
    assert note.text.startswith("mug_0, mug_1, mug_2 and 2 more: is shaped as a mug by a guess")


def test_the_primitive_shape_of_the_map_is_used_without_a_shape_rule(bundled_knowledge: KnowledgeBase) -> None:
    by_primitive = {
        shape: fit(
            bundled_knowledge, replace(make_body("it", MY + "Gizmo", (0, 0, 0), (0.1, 0.1, 0.1)), shape=shape)
        ).geometry
        for shape in (None, PrimitiveShape(type=PrimitiveType.CYLINDER), PrimitiveShape(type=PrimitiveType.SPHERE))
    }
    assert [geometries[BodyId("it")].shape_name for geometries in by_primitive.values()] == ["box", "cylinder", "ball"]
    assert {geometries[BodyId("it")].source for geometries in by_primitive.values()} == {GeometrySource.MAP}


def test_a_color_in_the_map_overrides_that_of_the_class(bundled_knowledge: KnowledgeBase) -> None:
    red = (1.0, 0.0, 0.0)
    mug = replace(
        make_body("mug", "DrinkingMug", (0, 0, 0), (0.08, 0.08, 0.1)), materials=(Material(name="red", color=red),)
    )
    assert fit(bundled_knowledge, mug).geometry[mug.id].visuals[0].material.color == red


def test_the_geometry_of_a_lamp_includes_its_light(bundled_knowledge: KnowledgeBase) -> None:
    geometry = fit(bundled_knowledge, make_body("lamp", "CeilingLight", (0, 0, 2.4), (0.4, 0.4, 0.06))).geometry[
        BodyId("lamp")
    ]
    assert [light.intensity for light in geometry.lights] == [120.0]


def test_geometry_has_the_physical_properties_of_its_material(bundled_knowledge: KnowledgeBase) -> None:
    geometry = fit(bundled_knowledge, make_body("mug", "DrinkingMug", (0, 0, 0), (0.08, 0.08, 0.1))).geometry[
        BodyId("mug")
    ]
    assert (geometry.friction, geometry.restitution, geometry.density) == (0.35, 0.4, 2400.0)


def test_meshes_take_precedence_and_are_requested_once(bundled_knowledge: KnowledgeBase) -> None:
    mug, plate = (
        make_body("mug", "DrinkingMug", (0, 0, 0), (0.08, 0.08, 0.1)),
        make_body("plate", "DinnerPlate", (1, 0, 0), (0.2, 0.2, 0.02)),
    )
    mesh = BodyGeometry(key="00", visuals=(), collision_shapes=(), source=GeometrySource.MESH, shape_name="mesh")
    requests = []

    class Meshes:
        def geometry_for(self, bodies: Sequence[Body]) -> FoundMeshes:
            requests.append(tuple(bodies))
            return FoundMeshes({mug.id: mesh}, ("mug.obj is scaled",))

    fitted = fit_geometry(world([mug, plate]), bundled_knowledge, meshes=Meshes())
    assert requests == [(mug, plate)]
    assert fitted.geometry[mug.id] is mesh
    assert fitted.geometry[plate.id].shape_name == "plate"
    assert [note.text for note in fitted.notes] == ["mug.obj is scaled"]


class FoundMeshes(NamedTuple):
    geometry: dict[BodyId, BodyGeometry]
    notes: tuple[str, ...]


def test_the_material_of_a_door_follows_from_its_cabinet(bundled_knowledge: KnowledgeBase) -> None:
    oven, door = (
        make_body("oven", "Oven", (0, 0, 0), (0.6, 0.6, 0.6)),
        make_body("door", "Door", (0.31, 0, 0), (0.02, 0.6, 0.6)),
    )
    fridge = replace(oven, cls=Iri(KNOWROB + "Refrigerator"))
    joint = replace(slide_joint("oven", "door"), linear=LinearLimits())
    names = [
        fit_geometry(world([holder, door], [joint]), bundled_knowledge).geometry[door.id].visuals[0].material.name
        for holder in (oven, fridge)
    ]
    assert names == ["black glass", "lacquer"]


@pytest.mark.parametrize("name", ["iai-kitchen-original", "ameva-task-two", "soma-iai-room", "knowrob1-ccrl"])
def test_maps_of_all_dialects_get_geometry_and_guesses_are_noted(shared_data: Path, name: str) -> None:
    knowledge = KnowledgeBase()
    knowledge.load(shared_data / "maps" / f"{name}.owl")
    scene = knowledge.world()
    fitted = fit_geometry(scene, knowledge)
    sized = {body.id for body in scene.bodies if body.size and min(body.size) > 0.0}
    assert fitted.geometry.keys() == sized
    guessed = {id for id, geometry in fitted.geometry.items() if geometry.source is GeometrySource.CLASS_NAME}
    assert guessed == {id for note in fitted.notes for id in note.ids if "by a guess" in note.text}
    assert not any("cannot be built" in note.text for note in fitted.notes)


# -- special cases -----------------------------------------------------------------------------------------------------


def test_a_world_without_bodies_has_no_geometry(bundled_knowledge: KnowledgeBase) -> None:
    assert (dict(fit(bundled_knowledge).geometry), fit(bundled_knowledge).notes) == ({}, ())


def test_bodies_without_a_size_or_extent_get_no_geometry(bundled_knowledge: KnowledgeBase) -> None:
    fitted = fit(
        bundled_knowledge,
        make_body("mug", "DrinkingMug", (0, 0, 0), None),
        make_body("door", "Door", (1, 0, 0), (0.0, 0.6, 0.8)),
    )
    assert dict(fitted.geometry) == {}
    assert [(note.ids, note.text) for note in fitted.notes] == [
        (("door",), "door: has no extent along one of its axes, so it keeps the shape of the map")
    ]


def test_an_unknown_shape_name_becomes_a_box_with_a_note(tmp_path: Path) -> None:
    (tmp_path / "mine.ttl").write_text(
        """@prefix ms: <http://mindstage.org/ontology#> . @prefix my: <http://example.org/my#> .
        my:Form ms:builtAs "drawr" . my:Thing ms:shapedAs my:Form .""",
        encoding="utf-8",
    )
    knowledge = KnowledgeBase()
    knowledge.load([], ontologies=tmp_path / "mine.ttl")
    fitted = fit(knowledge, make_body("it", MY + "Thing", (0, 0, 0), (0.1, 0.2, 0.3)))
    assert fitted.geometry[BodyId("it")].shape_name == "box"
    (note,) = fitted.notes
    assert "'drawr'" in note.text
    assert "drawer" in note.text


def test_bodies_with_too_many_neighbors_are_noted(bundled_knowledge: KnowledgeBase) -> None:
    drawers = [
        make_body(f"drawer_{number}", "Drawer", (0, 0, 0), (0.5, 0.5, 0.2), is_free=True) for number in range(600)
    ]
    fitted = fit(bundled_knowledge, *drawers)
    assert len(fitted.geometry) == 600
    assert [len(note.ids) for note in fitted.notes if "neighbors" in note.text] == [600]


def test_geometry_does_not_depend_on_the_order_of_bodies(bundled_knowledge: KnowledgeBase) -> None:
    scene = kitchenette()
    backwards = replace(scene, bodies=scene.bodies[::-1])
    geometries, again = (
        fit_geometry(scene, bundled_knowledge).geometry,
        fit_geometry(backwards, bundled_knowledge).geometry,
    )
    assert {id: geometry.key for id, geometry in geometries.items()} == {
        id: geometry.key for id, geometry in again.items()
    }


# -- the bundled kitchen -----------------------------------------------------------------------------------------------


def test_the_bundled_kitchen_needs_no_guesses_for_cabinets_and_doors(kitchen: World) -> None:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    fitted = fit_geometry(knowledge.world(), knowledge)
    assert set(fitted.geometry) == {body.id for body in kitchen.bodies}
    assert {geometry.source for geometry in fitted.geometry.values()} == {GeometrySource.ONTOLOGY}
    guessed = {id for note in fitted.notes for id in note.ids}
    assert not any(fitted.geometry[id].shape_name in (*CLOSING_SHAPES, "case", "shelf") for id in guessed)


def test_free_bodies_of_the_bundled_kitchen_do_not_penetrate_cabinet_walls(kitchen: World) -> None:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    geometries = fit_geometry(kitchen, knowledge).geometry
    hosts = [body for body in kitchen.bodies if geometries[body.id].shape_name in ("case", "drawer")]
    loose = [
        body
        for body in kitchen.bodies
        if body.physics.is_dynamic and geometries[body.id].shape_name not in CLOSING_SHAPES
    ]
    poses = pose_array(body.pose for body in kitchen.bodies)
    where = dict(
        zip((body.id for body in kitchen.bodies), np.hstack([poses[:, :3], normalize(poses[:, 3:])]), strict=True)
    )
    deepest = 0.0
    for host in hosts:
        boxes = [box_of(shape) for shape in geometries[host.id].collision_shapes]
        for body in loose:
            pose = pose_multiply(_inverse(where[host.id]), where[body.id])
            reach = np.abs(rotation_matrix(pose[3:])) @ np.array(body.size) / 2
            for low, high in boxes:
                overlap = np.minimum(high, pose[:3] + reach) - np.maximum(low, pose[:3] - reach)
                deepest = max(deepest, float(overlap.min()))
    assert deepest < 0.002


def _inverse(pose: Array) -> Array:
    back = quat_conjugate(pose[3:])
    return np.concatenate([-quat_rotate(back, pose[:3]), back])
