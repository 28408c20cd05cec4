"""The details of one body."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.scene import (
    BlankNode,
    Body,
    BodyId,
    BodyPhysics,
    Iri,
    IriRef,
    Literal,
    Material,
    PropertyAssertion,
    World,
)
from mindstage.scene.transforms import normalized_pose_array
from mindstage.simulation import JointHandle, SpawnRecord
from mindstage.viewer.inspector import BodyDetails, FactRow, MaterialDetails, StorageHint, body_details, live_details
from tests.kitchenette import MAP, kitchenette

DOOR = BodyId("FridgeDoor")


def hinge(world: World) -> JointHandle:
    return JointHandle(world.joints[1], {body.id: body for body in world.bodies}, SpawnRecord.from_worlds([world]))


def details(id: str, body: Body | None = None) -> BodyDetails:
    world = kitchenette()
    ancestors = (Iri("http://x#Part"), Iri("http://x#Thing"))
    joints = [hinge(world)] if id == DOOR else []
    return body_details(body or world.body(id), world, ancestors=ancestors, joints=joints, storage_places=[])


def test_details_contain_the_properties_of_a_body() -> None:
    handle = details("DrawerHandle")
    assert (handle.id, handle.cls, handle.ancestors) == ("DrawerHandle", "Handle", ("Part", "Thing"))
    assert (handle.size, handle.mass, handle.mobility, handle.gravity) == ((0.04, 0.2, 0.02), 0.2, "kinematic", True)
    assert handle.tags == (("SemLog", "Class", "Handle"), ("SemLog", "Id", "DrawerHandle"))
    assert (handle.attached_to, handle.attached_bodies) == ("Drawer", ())
    assert details("Drawer").attached_bodies == ("DrawerHandle",)


def test_unknown_properties_are_none() -> None:
    bare = details("Mug", replace(kitchenette().body("Mug"), size=None, physics=BodyPhysics(), tags=()))
    assert (bare.size, bare.mass, bare.mobility, bare.gravity, bare.tags) == (None, None, None, None, ())


def test_facts_have_local_names_and_refer_to_bodies() -> None:
    facts = (
        PropertyAssertion(Iri("http://x#near"), IriRef(Iri(f"{MAP}Fridge"))),
        PropertyAssertion(Iri("http://x#madeOf"), IriRef(Iri("http://y/China"))),
        PropertyAssertion(Iri("http://x#said"), Literal("<b>hot</b>")),
        PropertyAssertion(Iri("http://x#has"), BlankNode((PropertyAssertion(Iri("http://x#part"), Literal("1")),))),
        PropertyAssertion(Iri("http://x#is"), BlankNode()),
    )
    shown = details("Mug", replace(kitchenette().body("Mug"), facts=facts)).facts
    assert shown == (
        FactRow(property="near", value="Fridge", id=BodyId("Fridge")),
        FactRow(property="madeOf", value="China"),
        FactRow(property="said", value="<b>hot</b>"),
        FactRow(property="has", value="part"),
        FactRow(property="is", value="a blank node"),
    )


def test_colors_of_materials_are_hexadecimal() -> None:
    materials = (Material(name="gold", color=(1.0, 0.8, 0.0)), Material(name="none"))
    shown = details("Mug", replace(kitchenette().body("Mug"), materials=materials)).materials
    assert shown == (MaterialDetails(name="gold", color="#ffcc00"), MaterialDetails(name="none", color=None))


def test_joints_have_the_other_body_and_their_limits() -> None:
    (joint,) = details("FridgeDoor").joints
    assert (joint.id, joint.other_body, joint.moving) == ("FridgeHinge", "Fridge", "FridgeDoor")
    assert [(axis.name, axis.lower) for axis in joint.axes] == [("swing1", pytest.approx(-np.pi / 4))]


def test_storage_places_are_passed_on() -> None:
    world, kept = kitchenette(), StorageHint(class_name="Cupboard", ids=(BodyId("Cupboard"),))
    assert body_details(world.body("Mug"), world, ancestors=(), joints=(), storage_places=[kept]).storage_places == (
        kept,
    )


def test_live_details_are_rounded_so_that_noise_changes_nothing() -> None:
    world = kitchenette()
    still = {body.id: normalized_pose_array(body.pose) for body in world.bodies}
    trembling = {id: pose + 1e-6 for id, pose in still.items()}
    assert live_details(DOOR, still, [hinge(world)]) == live_details(DOOR, trembling, [hinge(world)])
    moved = still | {DOOR: normalized_pose_array(hinge(world).pose_for("swing1", 0.25, still))}
    live = live_details(DOOR, moved, [hinge(world)])
    assert live.joints == {"FridgeHinge": {"swing1": 0.25}}
    assert live.pose != live_details(DOOR, still, []).pose
