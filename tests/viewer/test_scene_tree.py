"""The scene tree of the page."""

from __future__ import annotations

from msgspec.structs import replace

from mindstage.scene import Attachment, BodyId, World
from mindstage.viewer.inspector import ParentLink, SceneTree, scene_tree
from tests.kitchenette import kitchenette


def above(outline: SceneTree, id: str) -> tuple[str | None, ParentLink, str | None]:
    row = next(each for each in outline.rows if each.id == id)
    return outline.rows[row.parent].id if row.parent >= 0 else None, row.link, row.joint


def test_attached_and_jointed_bodies_are_children() -> None:
    outline = scene_tree(kitchenette(), engine="null")
    assert above(outline, "Cupboard") == (None, ParentLink.NONE, None)
    assert above(outline, "Drawer") == ("Cupboard", ParentLink.JOINT, "DrawerSlide")
    assert above(outline, "DrawerHandle") == ("Drawer", ParentLink.ATTACHED, None)
    assert above(outline, "FridgeDoor") == ("Fridge", ParentLink.JOINT, "FridgeHinge")
    assert (outline.name, outline.engine, outline.joints) == ("map", "null", 2)


def test_each_class_is_listed_once() -> None:
    outline = scene_tree(kitchenette(), engine="null")
    handles = [row for row in outline.rows if outline.classes[row.cls] == "Handle"]
    assert [row.id for row in handles] == ["DrawerHandle", "FridgeHandle"]
    assert len(set(outline.classes)) == len(outline.classes) == 7


def test_the_dynamic_body_of_a_joint_is_the_child() -> None:
    world = kitchenette()
    turned = tuple(replace(joint, parent=joint.child, child=joint.parent) for joint in world.joints)
    assert above(scene_tree(replace(world, joints=turned), engine="null"), "Drawer")[0] == "Cupboard"


def test_cycles_of_joints_are_broken() -> None:
    world = kitchenette()
    slide = world.joints[0]
    back = replace(slide, id=BodyId("Back"), parent=BodyId("Drawer"), child=BodyId("Cupboard"))
    holds = (*world.attachments, Attachment(parent=BodyId("DrawerHandle"), child=BodyId("Cupboard")))
    for circular in (replace(world, joints=(slide, back)), replace(world, attachments=holds)):
        outline = scene_tree(circular, engine="null")
        assert any(row.parent == -1 for row in outline.rows)
        for row in outline.rows:
            steps = 0
            while row.parent >= 0:
                row, steps = outline.rows[row.parent], steps + 1
                assert steps < len(outline.rows), "there is no cycle"


def test_links_to_missing_bodies_are_ignored() -> None:
    world = kitchenette()
    without = replace(world, bodies=tuple(body for body in world.bodies if body.id not in {"Cupboard", "Drawer"}))
    assert above(scene_tree(without, engine="null"), "DrawerHandle") == (None, ParentLink.NONE, None)


def test_enclosing_and_movable_bodies_are_marked() -> None:
    outline = scene_tree(kitchenette(), engine="null", enclosing={BodyId("Floor")})
    assert [row.id for row in outline.rows if row.encloses] == ["Floor"]
    assert {row.id for row in outline.rows if row.movable} == {"Drawer", "FridgeDoor", "Mug"}


def test_an_empty_world_has_a_scene_tree() -> None:
    assert scene_tree(World(iri=kitchenette().iri), engine="null").rows == ()
