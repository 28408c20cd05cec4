"""What the page shows of one body."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.stage import Joint, Spawned
from mindstage.viewport.details import Details, FactLine, Kept, MaterialDetails, details_of, live_of
from mindstage.world import Anonymous, Body, BodyId, Fact, Iri, Literal, Material, Physics, Reference, World
from mindstage.world.geometry import unit_pose
from tests.kitchenette import MAP, kitchenette

DOOR = BodyId("FridgeDoor")


def hinge(world: World) -> Joint:
    return Joint(world.constraints[1], {body.id: body for body in world.bodies}, Spawned.of([world]))


def details(id: str, body: Body | None = None) -> Details:
    world = kitchenette()
    ancestors = (Iri("http://x#Part"), Iri("http://x#Thing"))
    joints = [hinge(world)] if id == DOOR else []
    return details_of(body or world.body(id), world, ancestors=ancestors, joints=joints, storage_places=[])


def test_a_body_is_named_with_all_that_is_known() -> None:
    handle = details("DrawerHandle")
    assert (handle.id, handle.cls, handle.ancestors) == ("DrawerHandle", "Handle", ("Part", "Thing"))
    assert (handle.size, handle.mass, handle.mobility, handle.gravity) == ((0.04, 0.2, 0.02), 0.2, "kinematic", True)
    assert handle.tags == (("SemLog", "Class", "Handle"), ("SemLog", "Id", "DrawerHandle"))
    assert (handle.attached_to, handle.attached_bodies) == ("Drawer", ())
    assert details("Drawer").attached_bodies == ("DrawerHandle",)


def test_what_was_not_told_is_told_as_such() -> None:
    bare = details("Mug", replace(kitchenette().body("Mug"), size=None, physics=Physics(), tags=()))
    assert (bare.size, bare.mass, bare.mobility, bare.gravity, bare.tags) == (None, None, None, None, ())


def test_facts_are_in_short_names_and_lead_to_bodies() -> None:
    facts = (
        Fact(Iri("http://x#near"), Reference(Iri(f"{MAP}Fridge"))),
        Fact(Iri("http://x#madeOf"), Reference(Iri("http://y/China"))),
        Fact(Iri("http://x#said"), Literal("<b>hot</b>")),
        Fact(Iri("http://x#has"), Anonymous((Fact(Iri("http://x#part"), Literal("1")),))),
        Fact(Iri("http://x#is"), Anonymous()),
    )
    told = details("Mug", replace(kitchenette().body("Mug"), facts=facts)).facts
    assert told == (
        FactLine(property="near", value="Fridge", id=BodyId("Fridge")),
        FactLine(property="madeOf", value="China"),
        FactLine(property="said", value="<b>hot</b>"),
        FactLine(property="has", value="part"),
        FactLine(property="is", value="something"),
    )


def test_surfaces_have_their_colours_as_browsers_write_them() -> None:
    materials = (Material(name="gold", colour=(1.0, 0.8, 0.0)), Material(name="none"))
    told = details("Mug", replace(kitchenette().body("Mug"), materials=materials)).materials
    assert told == (MaterialDetails(name="gold", color="#ffcc00"), MaterialDetails(name="none", color=None))


def test_a_joint_is_told_with_its_other_end_and_its_range() -> None:
    (joint,) = details("FridgeDoor").joints
    assert (joint.id, joint.other_body, joint.moving) == ("FridgeHinge", "Fridge", "FridgeDoor")
    assert [(axis.name, axis.high) for axis in joint.axes] == [("swing1", pytest.approx(np.pi / 4))]


def test_where_things_are_kept_is_passed_on() -> None:
    world, kept = kitchenette(), Kept(class_name="Cupboard", ids=(BodyId("Cupboard"),))
    assert details_of(world.body("Mug"), world, ancestors=(), joints=(), storage_places=[kept]).storage_places == (
        kept,
    )


def test_what_trembles_is_told_in_the_same_digits() -> None:
    world = kitchenette()
    still = {body.id: unit_pose(body.pose) for body in world.bodies}
    trembling = {id: pose + 1e-6 for id, pose in still.items()}
    assert live_of(DOOR, still, [hinge(world)]) == live_of(DOOR, trembling, [hinge(world)])
    moved = still | {DOOR: unit_pose(hinge(world).pose_at("swing1", 0.25, still))}
    live = live_of(DOOR, moved, [hinge(world)])
    assert live.joints == {"FridgeHinge": {"swing1": 0.25}}
    assert live.pose != live_of(DOOR, still, []).pose
