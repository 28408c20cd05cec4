"""The appearance of bodies: visual meshes, colors, and the parts that would hide the room."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase
from mindstage.rdf.vocabulary import URDF_LINK
from mindstage.rendering.appearance import (
    ASSUMED_SIZE_M,
    BodyAppearance,
    VisiblePart,
    compute_appearance,
    merge_visuals,
)
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
    dynamic: bool = False,
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
        physics=BodyPhysics(mobility=Mobility.DYNAMIC if dynamic else Mobility.STATIC),
        materials=materials,
    )


def world(
    *bodies: Body, joints: tuple[tuple[str, str], ...] = (), attachments: tuple[tuple[str, str], ...] = ()
) -> World:
    return World(
        iri=Iri("http://x.org#map"),
        bodies=bodies,
        joints=tuple(
            Joint(
                id=BodyId(f"{a}-{b}"), iri=Iri(f"http://x.org#{a}-{b}"), parent=BodyId(a), child=BodyId(b), pose=Pose()
            )
            for a, b in joints
        ),
        attachments=tuple(Attachment(parent=BodyId(a), child=BodyId(b)) for a, b in attachments),
    )


def appearances_of(
    *bodies: Body,
    enclosing: tuple[str, ...] = (),
    geometry: dict[str, BodyGeometry] | None = None,
    **links: tuple[tuple[str, str], ...],
) -> dict[BodyId, BodyAppearance]:
    named = {BodyId(id): geometry for id, geometry in (geometry or {}).items()}
    return compute_appearance(
        world(*bodies, **links),
        KNOWLEDGE.shape_rule,
        KNOWLEDGE.ancestors,
        geometry=named,
        enclosing=[BodyId(id) for id in enclosing],
    )


def appearance_of(
    *bodies: Body, geometry: dict[str, BodyGeometry] | None = None, **links: tuple[tuple[str, str], ...]
) -> BodyAppearance:
    return appearances_of(*bodies, geometry=geometry, **links)[bodies[0].id]


def extents(appearance: BodyAppearance) -> np.ndarray:
    return np.ptp(merge_visuals(appearance.visuals).points, axis=0)


def sides(appearance: BodyAppearance) -> set[tuple[float, ...]]:
    """The normals of the triangles."""
    mesh = merge_visuals(appearance.visuals)
    a, b, c = (mesh.points[mesh.faces[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    return {tuple(row) for row in np.round(normals / np.linalg.norm(normals, axis=1, keepdims=True)).tolist()}


# -- geometry ----------------------------------------------------------------------------------------------------------


def test_a_body_has_the_visuals_and_lights_of_its_geometry() -> None:
    visuals = (VisualMesh(TRIANGLE, UPWARDS, PbrMaterial(color=(0.2, 0.4, 0.6))),)
    geometry = BodyGeometry(key="k", visuals=visuals, collision_shapes=(), lights=(AttachedLight(),))
    appearance = appearance_of(body("mug", "Cup", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), geometry={"mug": geometry})
    assert appearance.visuals == visuals
    assert appearance.lights == (AttachedLight(),)
    assert appearance.color == pytest.approx((0.2, 0.4, 0.6))


def test_bodies_of_equal_geometry_have_equal_keys() -> None:
    visuals = (VisualMesh(TRIANGLE, UPWARDS, PbrMaterial()),)
    mugs = [body(f"mug{n}", "Cup", (n, 0.0, 0.0), (1.0, 1.0, 1.0)) for n in range(3)]
    geometry = {
        "mug0": BodyGeometry("k", visuals, ()),
        "mug1": BodyGeometry("k", visuals, ()),
        "mug2": BodyGeometry("other", visuals, ()),
    }
    keys = [appearance.key for appearance in appearances_of(*mugs, geometry=geometry).values()]
    assert keys[0] == keys[1] != keys[2]


def test_the_material_color_applies_to_opaque_untextured_meshes() -> None:
    picture = np.zeros((1, 1, 4), np.uint8)
    visuals = (
        VisualMesh(TRIANGLE, UPWARDS, PbrMaterial()),
        VisualMesh(TRIANGLE, UPWARDS, PbrMaterial(opacity=0.3)),
        VisualMesh(TRIANGLE, UPWARDS, PbrMaterial(), uv=TRIANGLE[:, :2], image=picture),
    )
    geometry = BodyGeometry(key="k", visuals=visuals, collision_shapes=())
    painted = body("mug", "Cup", (0.0, 0.0, 0.0), None, materials=(Material(name="M", color=GREEN),))
    plain = replace(painted, materials=())
    appearance = appearance_of(painted, geometry={"mug": geometry})
    assert [visual.material.color for visual in appearance.visuals] == [GREEN, (0.8, 0.8, 0.8), (0.8, 0.8, 0.8)]
    assert appearance.key != appearance_of(plain, geometry={"mug": geometry}).key


def test_the_material_color_applies_to_what_has_no_mesh_of_its_own() -> None:
    painted = body("mug", "Cup", (0.0, 0.0, 0.0), (0.1, 0.1, 0.1), materials=(Material(name="M", color=GREEN),))
    shapes = BodyGeometry(key="k", visuals=(), collision_shapes=(CollisionShape(size=(0.2, 0.2, 0.2)),))
    for geometry in ({}, {"mug": shapes}):
        appearance = appearance_of(painted, geometry=geometry)
        assert {visual.material.color for visual in appearance.visuals} == {GREEN}
        assert appearance.key != appearance_of(replace(painted, materials=()), geometry=geometry).key


def test_without_visuals_collision_shapes_are_drawn() -> None:
    corners = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 2.0))
    collision_shapes = (
        CollisionShape(size=(0.2, 0.2, 0.2), pose=Pose((1.0, 0.0, 0.0))),
        CollisionShape(type=CollisionShapeType.HULL, size=(1.0, 1.0, 2.0), points=corners),
    )
    appearance = appearance_of(
        body("it", "Cup", (0.0, 0.0, 0.0), None), geometry={"it": BodyGeometry("k", (), collision_shapes)}
    )
    vertices = merge_visuals(appearance.visuals).points
    assert vertices.min(axis=0) == pytest.approx([0.0, -0.1, -0.1], abs=1e-6)
    assert vertices.max(axis=0) == pytest.approx([1.1, 1.0, 2.0], abs=1e-6)


@pytest.mark.parametrize("type", [CollisionShapeType.BOX, CollisionShapeType.SPHERE, CollisionShapeType.CYLINDER])
def test_the_normals_of_collision_shapes_point_outwards_however_they_are_turned(type: CollisionShapeType) -> None:
    shape = CollisionShape(type=type, size=(0.2, 0.2, 0.2), pose=Pose((1.0, 2.0, 3.0), (0.8, 0.48, 0.36, 0.0)))
    geometry = BodyGeometry("k", (), (shape,))
    (visual,) = appearance_of(body("it", "Cup", (0.0, 0.0, 0.0), None), geometry={"it": geometry}).visuals
    assert visual.normals is not None
    outwards = ((visual.points - [1.0, 2.0, 3.0]) * visual.normals).sum(axis=1)
    assert outwards == pytest.approx(np.full(len(outwards), 0.1), abs=0.01)
    assert np.linalg.norm(visual.normals, axis=1) == pytest.approx(np.ones(len(outwards)))


@pytest.mark.parametrize("shape", [None, *PrimitiveType])
def test_without_geometry_the_primitive_shape_is_drawn(shape: PrimitiveType | None) -> None:
    appearance = appearance_of(body("it", "Cup", (0.0, 0.0, 0.0), (0.1, 0.2, 0.3), shape=shape))
    assert extents(appearance) == pytest.approx([0.1, 0.2, 0.3], rel=0.02)
    ceramic = KNOWLEDGE.shape_rule(Iri(KNOWROB + "Cup")).default_material.pbr_material
    assert appearance.visuals[0].material == ceramic, "the material is that of the class"


def test_a_body_without_a_size_is_drawn_small() -> None:
    assert appearance_of(body("it", "Thing", (0.0, 0.0, 0.0), None)).size == ASSUMED_SIZE_M


# -- bodies that would block the view ----------------------------------------------------------------------------------


def test_only_the_floor_is_the_building() -> None:
    appearances = compute_appearance(kitchenette(), KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors)
    assert [id for id, appearance in appearances.items() if appearance.is_building] == ["Floor"]
    assert [id for id, appearance in appearances.items() if appearance.is_floor] == ["Floor"]
    assert {appearance.part for appearance in appearances.values()} == {VisiblePart.WHOLE}


@pytest.mark.parametrize(("at", "side"), [((-2.0, 0.0, 1.25), (1.0, 0.0, 0.0)), ((2.0, 0.0, 1.25), (-1.0, 0.0, 0.0))])
def test_only_the_room_side_of_a_wall_is_drawn(at: Vector, side: Vector) -> None:
    wall, table = body("wall", "Wall", at, (0.1, 4.0, 2.5)), body("table", "Table", (0.0, 0.0, 0.4), (1.0, 1.0, 0.8))
    appearance = appearance_of(wall, table)
    assert appearance.part is VisiblePart.INTERIOR
    assert sides(appearance) == {side}


def test_a_wall_is_recognized_by_its_superclass() -> None:
    wall = body("it", "WallOfAConstruction", (-2.0, 0.0, 1.25), (0.1, 4.0, 2.5))
    assert appearance_of(wall, body("table", "Table", (0.0, 0.0, 0.4), (1.0, 1.0, 0.8))).is_building
    clock = body("it", "WallClock", (-2.0, 0.0, 1.25), (0.03, 0.3, 0.3))
    assert not appearance_of(clock).is_building


@pytest.mark.parametrize(
    ("at", "size", "is_wall"),
    [
        ((-2.0, 0.0, 1.25), (0.01, 4.0, 2.5), True),
        ((0.0, 2.0, 1.25), (4.0, 0.01, 2.5), True),
        ((0.0, 0.0, 1.25), (0.01, 4.0, 2.5), False),  # a partition
        ((-2.0, 0.0, 1.0), (0.01, 0.8, 2.0), False),  # the front of a wardrobe
        ((-2.0, 0.0, 0.5), (0.01, 4.0, 1.0), False),  # a counter
        ((-2.0, 0.0, 1.25), (1.5, 4.0, 2.5), False),  # a cabinet
        ((0.0, 0.0, 2.5), (4.0, 4.0, 0.01), False),
    ],
)
def test_a_link_of_a_robot_description_that_bounds_the_place_is_drawn_as_a_wall(
    at: Vector, size: Vector, is_wall: bool
) -> None:
    things = [body(f"table{x}", "Table", (x, 0.5 * x, 0.4), (0.3, 0.3, 0.8)) for x in (-1.0, 0.2, 1.0)]
    link = replace(body("link", "Table", at, size), cls=URDF_LINK)
    appearance = appearance_of(link, *things)
    assert (appearance.is_building, appearance.part is VisiblePart.INTERIOR) == (is_wall, is_wall)


def test_a_pillar_is_drawn_whole() -> None:
    assert appearance_of(body("pillar", "Pillar", (0.0, 0.0, 1.0), (0.3, 0.3, 2.0))).part is VisiblePart.WHOLE


def test_only_the_bottom_of_a_ceiling_lamp_is_drawn() -> None:
    tables = [body(f"table{n}", "Table", (n, 0.0, 0.4), (0.5, 0.5, 0.8)) for n in range(9)]
    lamp = body("lamp", "CeilingLight", (0.0, 0.0, 2.5), (1.0, 0.2, 0.1))
    assert sides(appearance_of(lamp, *tables)) == {(0.0, 0.0, -1.0)}
    assert appearance_of(replace(lamp, pose=Pose((0.0, 0.0, 0.3))), *tables).part is VisiblePart.WHOLE


def test_a_door_in_a_wall_is_drawn_like_the_wall_unlike_other_doors() -> None:
    wall = body("wall", "Wall", (0.0, 0.0, 1.2), (0.1, 1.0, 2.4))
    door = body("door", "Door", (0.0, 1.0, 1.0), (0.04, 0.9, 2.0), dynamic=True)
    latch = body("latch", "Handle", (0.0, 1.4, 1.0), (0.1, 0.12, 0.02))
    table = body("table", "Table", (2.0, 0.0, 0.4), (1.0, 1.0, 0.8))
    appearances = appearances_of(wall, door, latch, table, joints=(("wall", "door"),), attachments=(("door", "latch"),))
    appearance = appearances[BodyId("door")]
    assert (appearance.part, sides(appearance), appearance.is_building) == (
        VisiblePart.INTERIOR,
        {(1.0, 0.0, 0.0)},
        True,
    )
    assert (appearance_of(door).part, appearance_of(door).is_building) == (VisiblePart.WHOLE, False)
    assert appearances[BodyId("latch")].part is VisiblePart.WHOLE, "the handle is visible from outside, too"


def test_enclosures_reported_by_the_engine_are_outlines() -> None:
    area = body("area", "Cupboard", (0.0, 0.0, 0.5), (2.0, 2.0, 1.0))
    assert appearances_of(area, enclosing=("area",))[BodyId("area")].part is VisiblePart.OUTLINE


def test_bodies_as_large_as_a_room_are_outlines() -> None:
    assert appearance_of(body("cube", "Cube", (0.0, 0.0, 0.0), (13.0, 12.0, 5.5))).part is VisiblePart.OUTLINE
    assert appearance_of(body("floor", "Floor", (0.0, 0.0, 0.0), (13.0, 12.0, 0.2))).part is VisiblePart.WHOLE


def test_cycles_of_attachments_and_missing_bodies_are_ignored() -> None:
    a, b = body("a", "Table", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), body("b", "Mug", (0.0, 0.0, 1.0), (0.1, 0.1, 0.1))
    appearances = appearances_of(a, b, joints=(("a", "gone"),), attachments=(("a", "b"), ("b", "a"), ("gone", "a")))
    assert set(appearances) == {"a", "b"}


def test_an_empty_world_has_no_appearances() -> None:
    assert appearances_of() == {}
