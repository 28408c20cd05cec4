"""Body geometries and physics model deltas as JSON: round trips, and errors with paths."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from mindstage.bridge.conversions import (
    BodyModelDelta,
    JointModelDelta,
    PhysicsModelDelta,
    from_json,
    geometry_from_json,
    geometry_to_json,
    mesh_name,
    model_delta_to_json,
)
from mindstage.errors import MessageValidationError
from mindstage.scene import (
    AttachedLight,
    BodyGeometry,
    BodyId,
    CollisionShape,
    CollisionShapeType,
    GeometrySource,
    Mobility,
    PbrMaterial,
    Pose,
    SupportSurface,
    VisualMesh,
)
from tests.cases import each_case
from tests.msgs.golden import cases

KEY = "0123456789abcdef"
VISUAL_MESH = VisualMesh(
    points=np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]),
    faces=np.array([[0, 1, 2]], dtype=np.uint32),
    material=PbrMaterial(name="oak", color=(0.5, 0.3, 0.1)),
)
TURNED = Pose((1.0, 2.0, 3.0), (0.9659258262890683, 0.0, 0.0, 0.25881904510252074))
GEOMETRY = BodyGeometry(
    key=KEY,
    visuals=(VISUAL_MESH,),
    collision_shapes=(
        CollisionShape(size=(0.1, 0.2, 0.3), pose=TURNED),
        CollisionShape(
            type=CollisionShapeType.HULL, size=(1.0, 1.0, 1.0), points=((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
        ),
    ),
    source=GeometrySource.ONTOLOGY,
    reason="a drawer",
    shape_name="drawer",
    friction=0.4,
    density=700.0,
    support_surfaces=(SupportSurface(center=(0.0, 0.0, 0.1), size=(0.5, 0.4), is_inside=True),),
    lights=(AttachedLight(intensity=3.0),),
)
GEOMETRY_FIELDS = (
    "key",
    "collision_shapes",
    "source",
    "reason",
    "shape_name",
    "friction",
    "restitution",
    "density",
    "support_surfaces",
    "lights",
)
CUP, MUG = BodyId("cup"), BodyId("mug")


def written(**changes: Any) -> str:
    """Returns a geometry as JSON, with changed fields."""
    fields = json.loads(geometry_to_json({CUP: GEOMETRY}))
    fields["geometries"][KEY] |= changes
    return json.dumps(fields)


def test_geometries_survive_a_round_trip_without_visual_meshes() -> None:
    back = geometry_from_json(geometry_to_json({CUP: GEOMETRY, MUG: GEOMETRY}))
    assert set(back) == {CUP, MUG}
    assert back[CUP] is back[MUG]
    fields = back[CUP]
    for field in GEOMETRY_FIELDS:
        assert getattr(fields, field) == getattr(GEOMETRY, field), field
    assert fields.visuals == ()


def test_visual_meshes_are_loaded_from_the_named_file() -> None:
    text = geometry_to_json({CUP: GEOMETRY}, mesh=lambda geometry: mesh_name(geometry.key))
    loaded: list[str] = []
    back = geometry_from_json(text, load_visuals=lambda name: loaded.append(name) or (VISUAL_MESH,))  # type: ignore[func-returns-value]
    assert loaded == [f"{KEY}.glb"]
    assert back[CUP].visuals == (VISUAL_MESH,)


def test_no_geometries_are_an_empty_text() -> None:
    assert geometry_to_json({}) == ""
    assert geometry_from_json("") == {}


@each_case("key", ["", "short", "../../etc/passwd", "0123456789ABCDEF", "0" * 65, "0123456789abcde/"])
def test_only_a_digest_is_a_mesh_name(key: str) -> None:
    assert mesh_name(key) == ""


BOX = {"size": [1.0, 1.0, 1.0]}


@each_case(
    ("changes", "path"),
    [
        ({"mesh": "../secret.glb"}, f"geometries.{KEY}.mesh"),
        ({"mesh": "fedcba9876543210.glb"}, f"geometries.{KEY}.mesh"),
        ({"collision_shapes": [BOX, {"size": [1.0, 0.0, 1.0]}]}, f"geometries.{KEY}.collision_shapes[1]"),
        ({"collision_shapes": [{"size": [1.0, -1.0, 1.0]}]}, f"geometries.{KEY}.collision_shapes[0]"),
        (
            {"collision_shapes": [BOX | {"pose": {"quaternion": [1.0, 1.0, 0.0, 0.0]}}]},
            f"geometries.{KEY}.collision_shapes[0]",
        ),
        (
            {"collision_shapes": [BOX | {"type": "hull", "points": [[0, 0, 0]]}]},
            f"geometries.{KEY}.collision_shapes[0]",
        ),
        ({"collision_shapes": [BOX | {"type": "cloud"}]}, "geometries[...].collision_shapes[0].type"),
        ({"size": [1, 1, 1]}, "geometries[...]"),
    ],
)
def test_invalid_geometries_are_rejected_with_the_path(changes: dict[str, Any], path: str) -> None:
    with pytest.raises(MessageValidationError) as refused:
        geometry_from_json(written(**changes))
    assert refused.value.path == path


def test_an_unknown_geometry_key_is_rejected() -> None:
    with pytest.raises(MessageValidationError, match=r"bodies\.cup.*no geometry has the key"):
        geometry_from_json('{"bodies": {"cup": "0123456789abcdef"}, "geometries": {}}')


def test_a_geometry_that_json_cannot_represent_is_rejected() -> None:
    cloud = BodyGeometry(key=KEY, visuals=(), collision_shapes=(CollisionShape(size=(float("nan"), 1.0, 1.0)),))
    with pytest.raises(MessageValidationError):
        geometry_to_json({CUP: cloud})


def test_a_model_delta_leaves_out_defaults() -> None:
    change = PhysicsModelDelta(
        bodies={
            CUP: BodyModelDelta(size=(0.1, 0.1, 0.1), top=MUG, hold=TURNED, mobility=Mobility.DYNAMIC, mass_kg=0.3)
        },
        excluded_pairs=((CUP, MUG),),
        joints={BodyId("hinge"): JointModelDelta(parent=CUP, child=MUG), BodyId("slide"): None},
        poses={CUP: TURNED},
    )
    turned = {"position": [1.0, 2.0, 3.0], "quaternion": [0.9659258262890683, 0.0, 0.0, 0.25881904510252074]}
    assert json.loads(model_delta_to_json(change)) == {
        "bodies": {
            "cup": {"size": [0.1, 0.1, 0.1], "top": "mug", "hold": turned, "mobility": "dynamic", "mass_kg": 0.3}
        },
        "excluded_pairs": [["cup", "mug"]],
        "joints": {"hinge": {"parent": "cup", "child": "mug"}, "slide": None},
        "poses": {"cup": turned},
    }
    assert model_delta_to_json(PhysicsModelDelta()) == "{}"


def test_golden_geometries_and_model_deltas_are_read_and_written() -> None:
    fields = {case["name"]: case["json"] for case in cases()}
    golden = fields["a world with geometries and a plan"]
    assert geometry_from_json(golden["geometries"])[BodyId("drawer")].shape_name == "drawer"
    for text in (golden["plan"], fields["a handle on a drawer, as it was decided"]["plan"]):
        change = from_json(text, PhysicsModelDelta)
        assert change.bodies
        assert from_json(model_delta_to_json(change), PhysicsModelDelta) == change
