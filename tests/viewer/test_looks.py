"""How bodies are drawn: as their forms, and so that nothing hides the room."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase
from mindstage.scene import (
    AttachedLight,
    Attachment,
    Body,
    BodyGeometry,
    BodyId,
    BodyPhysics,
    CollisionShape,
    CollisionShapeType,
    Iri,
    Joint,
    Material,
    Mobility,
    PbrMaterial,
    Pose,
    PrimitiveShape,
    PrimitiveType,
    Vector,
    VisualMesh,
    World,
)
from mindstage.viewer.appearance import ASSUMED_SIZE_M, BodyAppearance, VisiblePart, compute_appearance, merge_visuals
from tests.kitchenette import KNOWROB, kitchenette

KNOWLEDGE = KnowledgeBase()
GREEN = (0.0, 1.0, 0.0)
TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
UPWARDS = np.array([[0, 1, 2]], dtype=np.uint32)


def body(
    id: str,
    cls: str,
    at: Vector,
    size: Vector | None,
    *,
    loose: bool = False,
    shape: PrimitiveType | None = None,
    materials: tuple[Material, ...] = (),
) -> Body:
    return Body(
        id=BodyId(id),
        iri=Iri(f"http://x.org#{id}"),
        cls=Iri(KNOWROB + cls),
        pose=Pose(at),
        size=size,
        shape=PrimitiveShape(type=shape) if shape else None,
        physics=BodyPhysics(mobility=Mobility.DYNAMIC if loose else Mobility.STATIC),
        materials=materials,
    )


def world(*bodies: Body, joints: tuple[tuple[str, str], ...] = (), holds: tuple[tuple[str, str], ...] = ()) -> World:
    return World(
        iri=Iri("http://x.org#map"),
        bodies=bodies,
        joints=tuple(
            Joint(
                id=BodyId(f"{a}-{b}"), iri=Iri(f"http://x.org#{a}-{b}"), parent=BodyId(a), child=BodyId(b), pose=Pose()
            )
            for a, b in joints
        ),
        attachments=tuple(Attachment(parent=BodyId(a), child=BodyId(b)) for a, b in holds),
    )


def looks_of(
    *bodies: Body,
    shells: tuple[str, ...] = (),
    forms: dict[str, BodyGeometry] | None = None,
    **joined: tuple[tuple[str, str], ...],
) -> dict[BodyId, BodyAppearance]:
    named = {BodyId(id): form for id, form in (forms or {}).items()}
    return compute_appearance(
        world(*bodies, **joined),
        KNOWLEDGE.shape_rule,
        KNOWLEDGE.ancestors,
        geometry=named,
        enclosing=[BodyId(id) for id in shells],
    )


def look_of(
    *bodies: Body, forms: dict[str, BodyGeometry] | None = None, **joined: tuple[tuple[str, str], ...]
) -> BodyAppearance:
    return looks_of(*bodies, forms=forms, **joined)[bodies[0].id]


def extents(look: BodyAppearance) -> np.ndarray:
    return np.ptp(merge_visuals(look.visuals).points, axis=0)


def sides(look: BodyAppearance) -> set[tuple[float, ...]]:
    """Where the triangles look to."""
    mesh = merge_visuals(look.visuals)
    a, b, c = (mesh.points[mesh.faces[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    return {tuple(row) for row in np.round(normals / np.linalg.norm(normals, axis=1, keepdims=True)).tolist()}


# -- forms -------------------------------------------------------------------------------------------------------------


def test_a_body_looks_like_its_form_and_gives_its_light() -> None:
    skins = (VisualMesh(TRIANGLE, UPWARDS, PbrMaterial(color=(0.2, 0.4, 0.6))),)
    form = BodyGeometry(key="k", visuals=skins, collision_shapes=(), lights=(AttachedLight(),))
    look = look_of(body("mug", "Cup", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), forms={"mug": form})
    assert look.visuals == skins
    assert look.lights == (AttachedLight(),)
    assert look.color == pytest.approx((0.2, 0.4, 0.6))


def test_bodies_of_one_form_look_alike_and_those_of_another_do_not() -> None:
    skins = (VisualMesh(TRIANGLE, UPWARDS, PbrMaterial()),)
    mugs = [body(f"mug{n}", "Cup", (n, 0.0, 0.0), (1.0, 1.0, 1.0)) for n in range(3)]
    forms = {
        "mug0": BodyGeometry("k", skins, ()),
        "mug1": BodyGeometry("k", skins, ()),
        "mug2": BodyGeometry("other", skins, ()),
    }
    keys = [look.key for look in looks_of(*mugs, forms=forms).values()]
    assert keys[0] == keys[1] != keys[2]


def test_a_materials_color_is_put_on_all_but_glass_and_pictures() -> None:
    picture = np.zeros((1, 1, 4), np.uint8)
    skins = (
        VisualMesh(TRIANGLE, UPWARDS, PbrMaterial()),
        VisualMesh(TRIANGLE, UPWARDS, PbrMaterial(opacity=0.3)),
        VisualMesh(TRIANGLE, UPWARDS, PbrMaterial(), uv=TRIANGLE[:, :2], image=picture),
    )
    form = BodyGeometry(key="k", visuals=skins, collision_shapes=())
    painted = body("mug", "Cup", (0.0, 0.0, 0.0), None, materials=(Material(name="M", color=GREEN),))
    plain = replace(painted, materials=())
    look = look_of(painted, forms={"mug": form})
    assert [skin.material.color for skin in look.visuals] == [GREEN, (0.8, 0.8, 0.8), (0.8, 0.8, 0.8)]
    assert look.key != look_of(plain, forms={"mug": form}).key


def test_a_form_without_skins_is_seen_as_what_can_be_touched() -> None:
    corners = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 2.0))
    solids = (
        CollisionShape(size=(0.2, 0.2, 0.2), pose=Pose((1.0, 0.0, 0.0))),
        CollisionShape(type=CollisionShapeType.HULL, size=(1.0, 1.0, 2.0), points=corners),
    )
    look = look_of(body("it", "Cup", (0.0, 0.0, 0.0), None), forms={"it": BodyGeometry("k", (), solids)})
    vertices = merge_visuals(look.visuals).points
    assert vertices.min(axis=0) == pytest.approx([0.0, -0.1, -0.1], abs=1e-6)
    assert vertices.max(axis=0) == pytest.approx([1.1, 1.0, 2.0], abs=1e-6)


@pytest.mark.parametrize("shape", [None, *PrimitiveType])
def test_a_body_without_a_form_is_its_shape_in_its_size(shape: PrimitiveType | None) -> None:
    look = look_of(body("it", "Cup", (0.0, 0.0, 0.0), (0.1, 0.2, 0.3), shape=shape))
    assert extents(look) == pytest.approx([0.1, 0.2, 0.3], rel=0.02)
    ceramic = KNOWLEDGE.shape_rule(Iri(KNOWROB + "Cup")).default_material.pbr_material
    assert look.visuals[0].material == ceramic, "what it is made of is known all the same"


def test_a_body_without_a_size_is_drawn_small() -> None:
    assert look_of(body("it", "Thing", (0.0, 0.0, 0.0), None)).size == ASSUMED_SIZE_M


# -- what would stand in the way ---------------------------------------------------------------------------------------


def test_only_the_floor_is_the_building() -> None:
    looks = compute_appearance(kitchenette(), KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors)
    assert [id for id, look in looks.items() if look.is_building] == ["Floor"]
    assert [id for id, look in looks.items() if look.is_floor] == ["Floor"]
    assert {look.part for look in looks.values()} == {VisiblePart.WHOLE}


@pytest.mark.parametrize(("at", "side"), [((-2.0, 0.0, 1.25), (1.0, 0.0, 0.0)), ((2.0, 0.0, 1.25), (-1.0, 0.0, 0.0))])
def test_a_wall_is_drawn_from_the_side_of_the_room(at: Vector, side: Vector) -> None:
    wall, table = body("wall", "Wall", at, (0.1, 4.0, 2.5)), body("table", "Table", (0.0, 0.0, 0.4), (1.0, 1.0, 0.8))
    look = look_of(wall, table)
    assert look.part is VisiblePart.INTERIOR
    assert sides(look) == {side}


def test_a_wall_is_known_by_the_class_above_it_too() -> None:
    wall = body("it", "WallOfAConstruction", (-2.0, 0.0, 1.25), (0.1, 4.0, 2.5))
    assert look_of(wall, body("table", "Table", (0.0, 0.0, 0.4), (1.0, 1.0, 0.8))).is_building
    clock = body("it", "WallClock", (-2.0, 0.0, 1.25), (0.03, 0.3, 0.3))
    assert not look_of(clock).is_building


def test_a_pillar_is_no_thin_wall() -> None:
    assert look_of(body("pillar", "Pillar", (0.0, 0.0, 1.0), (0.3, 0.3, 2.0))).part is VisiblePart.WHOLE


def test_a_lamp_up_there_is_drawn_from_below_only() -> None:
    things = [body(f"table{n}", "Table", (n, 0.0, 0.4), (0.5, 0.5, 0.8)) for n in range(9)]
    lamp = body("lamp", "CeilingLight", (0.0, 0.0, 2.5), (1.0, 0.2, 0.1))
    assert sides(look_of(lamp, *things)) == {(0.0, 0.0, -1.0)}
    assert look_of(replace(lamp, pose=Pose((0.0, 0.0, 0.3))), *things).part is VisiblePart.WHOLE


def test_the_door_of_a_room_is_drawn_like_its_wall_and_that_of_a_cupboard_is_not() -> None:
    wall = body("wall", "Wall", (0.0, 0.0, 1.2), (0.1, 1.0, 2.4))
    door = body("door", "Door", (0.0, 1.0, 1.0), (0.04, 0.9, 2.0), loose=True)
    latch = body("latch", "Handle", (0.0, 1.4, 1.0), (0.1, 0.12, 0.02))
    table = body("table", "Table", (2.0, 0.0, 0.4), (1.0, 1.0, 0.8))
    looks = looks_of(wall, door, latch, table, joints=(("wall", "door"),), holds=(("door", "latch"),))
    look = looks[BodyId("door")]
    assert (look.part, sides(look), look.is_building) == (VisiblePart.INTERIOR, {(1.0, 0.0, 0.0)}, True)
    assert (look_of(door).part, look_of(door).is_building) == (VisiblePart.WHOLE, False)
    assert looks[BodyId("latch")].part is VisiblePart.WHOLE, "by its handle it can be opened from outside, too"


def test_what_the_engine_calls_a_shell_is_an_outline() -> None:
    area = body("area", "Cupboard", (0.0, 0.0, 0.5), (2.0, 2.0, 1.0))
    assert looks_of(area, shells=("area",))[BodyId("area")].part is VisiblePart.OUTLINE


def test_what_is_as_large_as_a_room_is_an_outline_whatever_the_engine_says() -> None:
    assert look_of(body("cube", "Cube", (0.0, 0.0, 0.0), (13.0, 12.0, 5.5))).part is VisiblePart.OUTLINE
    assert look_of(body("floor", "Floor", (0.0, 0.0, 0.0), (13.0, 12.0, 0.2))).part is VisiblePart.WHOLE


def test_a_circle_of_attachments_and_an_end_that_is_not_there_do_no_harm() -> None:
    a, b = body("a", "Table", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), body("b", "Mug", (0.0, 0.0, 1.0), (0.1, 0.1, 0.1))
    looks = looks_of(a, b, joints=(("a", "gone"),), holds=(("a", "b"), ("b", "a"), ("gone", "a")))
    assert set(looks) == {"a", "b"}


def test_an_empty_world_has_no_looks() -> None:
    assert looks_of() == {}
