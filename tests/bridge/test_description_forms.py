"""Forms and plans on the wire: what comes back is what was sent, and what cannot be built is refused with its place."""

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
from tests.msgs.golden import cases

KEY = "0123456789abcdef"
SKIN = VisualMesh(
    points=np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]),
    faces=np.array([[0, 1, 2]], dtype=np.uint32),
    material=PbrMaterial(name="oak", color=(0.5, 0.3, 0.1)),
)
TURNED = Pose((1.0, 2.0, 3.0), (0.9659258262890683, 0.0, 0.0, 0.25881904510252074))
FORM = BodyGeometry(
    key=KEY,
    visuals=(SKIN,),
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
    """A form as JSON, with something else in it."""
    told = json.loads(geometry_to_json({CUP: FORM}))
    told["forms"][KEY] |= changes
    return json.dumps(told)


def test_forms_come_back_as_they_were_but_for_their_skins() -> None:
    back = geometry_from_json(geometry_to_json({CUP: FORM, MUG: FORM}))
    assert set(back) == {CUP, MUG}
    assert back[CUP] is back[MUG]
    told = back[CUP]
    for field in GEOMETRY_FIELDS:
        assert getattr(told, field) == getattr(FORM, field), field
    assert told.visuals == ()


def test_skins_come_from_the_mesh_that_is_named() -> None:
    text = geometry_to_json({CUP: FORM}, mesh=lambda form: mesh_name(form.key))
    asked: list[str] = []
    back = geometry_from_json(text, load_visuals=lambda name: asked.append(name) or (SKIN,))  # type: ignore[func-returns-value]
    assert asked == [f"{KEY}.glb"]
    assert back[CUP].visuals == (SKIN,)


def test_no_forms_are_an_empty_text_both_ways() -> None:
    assert geometry_to_json({}) == ""
    assert geometry_from_json("") == {}


@pytest.mark.parametrize("key", ["", "short", "../../etc/passwd", "0123456789ABCDEF", "0" * 65, "0123456789abcde/"])
def test_only_a_digest_names_a_file(key: str) -> None:
    assert mesh_name(key) == ""


BOX = {"size": [1.0, 1.0, 1.0]}


@pytest.mark.parametrize(
    ("changes", "path"),
    [
        ({"mesh": "../secret.glb"}, f"forms.{KEY}.mesh"),
        ({"mesh": "fedcba9876543210.glb"}, f"forms.{KEY}.mesh"),
        ({"solids": [BOX, {"size": [1.0, 0.0, 1.0]}]}, f"forms.{KEY}.solids[1]"),
        ({"solids": [{"size": [1.0, -1.0, 1.0]}]}, f"forms.{KEY}.solids[0]"),
        ({"solids": [BOX | {"pose": {"quaternion": [1.0, 1.0, 0.0, 0.0]}}]}, f"forms.{KEY}.solids[0]"),
        ({"solids": [BOX | {"kind": "hull", "points": [[0, 0, 0]]}]}, f"forms.{KEY}.solids[0]"),
        ({"solids": [BOX | {"kind": "cloud"}]}, "forms[...].solids[0].kind"),
        ({"size": [1, 1, 1]}, "forms[...]"),
    ],
)
def test_what_cannot_be_built_is_refused_with_its_place(changes: dict[str, Any], path: str) -> None:
    with pytest.raises(MessageValidationError) as refused:
        geometry_from_json(written(**changes))
    assert refused.value.path == path


def test_a_body_of_a_form_that_is_not_there_is_refused() -> None:
    with pytest.raises(MessageValidationError, match=r"bodies\.cup.*no geometry has the key"):
        geometry_from_json('{"bodies": {"cup": "0123456789abcdef"}, "forms": {}}')


def test_a_form_that_json_cannot_say_is_refused() -> None:
    cloud = BodyGeometry(key=KEY, visuals=(), collision_shapes=(CollisionShape(size=(float("nan"), 1.0, 1.0)),))
    with pytest.raises(MessageValidationError):
        geometry_to_json({CUP: cloud})


def test_a_plan_says_only_what_is_not_usual() -> None:
    change = PhysicsModelDelta(
        bodies={
            CUP: BodyModelDelta(size=(0.1, 0.1, 0.1), top=MUG, hold=TURNED, mobility=Mobility.DYNAMIC, mass_kg=0.3)
        },
        apart=((CUP, MUG),),
        joints={BodyId("hinge"): JointModelDelta(parent=CUP, child=MUG), BodyId("slide"): None},
        poses={CUP: TURNED},
    )
    turned = {"position": [1.0, 2.0, 3.0], "quaternion": [0.9659258262890683, 0.0, 0.0, 0.25881904510252074]}
    assert json.loads(model_delta_to_json(change)) == {
        "bodies": {
            "cup": {"size": [0.1, 0.1, 0.1], "top": "mug", "hold": turned, "mobility": "dynamic", "mass_kg": 0.3}
        },
        "apart": [["cup", "mug"]],
        "joints": {"hinge": {"parent": "cup", "child": "mug"}, "slide": None},
        "poses": {"cup": turned},
    }
    assert model_delta_to_json(PhysicsModelDelta()) == "{}"


def test_the_golden_forms_and_plans_are_what_is_read_and_written() -> None:
    told = {case.values[0]["name"]: case.values[0]["json"] for case in cases()}
    golden = told["a world with forms and a plan"]
    assert geometry_from_json(golden["forms"])[BodyId("drawer")].shape_name == "drawer"
    for text in (golden["plan"], told["a handle on a drawer, as it was decided"]["plan"]):
        change = from_json(text, PhysicsModelDelta)
        assert change.bodies
        assert from_json(model_delta_to_json(change), PhysicsModelDelta) == change
