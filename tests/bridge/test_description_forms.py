"""Forms and plans on the wire: what comes back is what was sent, and what cannot be built is refused with its place."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from mindstage.bridge.description import (
    BodyChange,
    JointChange,
    PlanChange,
    forms_from_json,
    forms_to_json,
    from_json,
    mesh_name,
    plan_to_json,
)
from mindstage.errors import MessageRefused
from mindstage.world import (
    BodyId,
    Form,
    FormSource,
    Glow,
    Mobility,
    Place,
    Pose,
    Skin,
    Solid,
    SolidKind,
    Surface,
)
from tests.msgs.golden import cases

KEY = "0123456789abcdef"
SKIN = Skin(
    points=np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]),
    faces=np.array([[0, 1, 2]], dtype=np.uint32),
    surface=Surface(material="oak", colour=(0.5, 0.3, 0.1)),
)
TURNED = Pose((1.0, 2.0, 3.0), (0.9659258262890683, 0.0, 0.0, 0.25881904510252074))
FORM = Form(
    key=KEY,
    skins=(SKIN,),
    solids=(
        Solid(size=(0.1, 0.2, 0.3), pose=TURNED),
        Solid(kind=SolidKind.HULL, size=(1.0, 1.0, 1.0), points=((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))),
    ),
    source=FormSource.KNOWLEDGE,
    why="a drawer",
    kind="drawer",
    friction=0.4,
    density=700.0,
    places=(Place(centre=(0.0, 0.0, 0.1), size=(0.5, 0.4), inside=True),),
    glows=(Glow(intensity=3.0),),
)
CUP, MUG = BodyId("cup"), BodyId("mug")


def written(**changes: Any) -> str:
    """A form as JSON, with something else in it."""
    told = json.loads(forms_to_json({CUP: FORM}))
    told["forms"][KEY] |= changes
    return json.dumps(told)


def test_forms_come_back_as_they_were_but_for_their_skins() -> None:
    back = forms_from_json(forms_to_json({CUP: FORM, MUG: FORM}))
    assert set(back) == {CUP, MUG}
    assert back[CUP] is back[MUG]
    told = back[CUP]
    for field in ("key", "solids", "source", "why", "kind", "friction", "restitution", "density", "places", "glows"):
        assert getattr(told, field) == getattr(FORM, field), field
    assert told.skins == ()


def test_skins_come_from_the_mesh_that_is_named() -> None:
    text = forms_to_json({CUP: FORM}, mesh=lambda form: mesh_name(form.key))
    asked: list[str] = []
    back = forms_from_json(text, skins=lambda name: asked.append(name) or (SKIN,))  # type: ignore[func-returns-value]
    assert asked == [f"{KEY}.glb"]
    assert back[CUP].skins == (SKIN,)


def test_no_forms_are_an_empty_text_both_ways() -> None:
    assert forms_to_json({}) == ""
    assert forms_from_json("") == {}


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
    with pytest.raises(MessageRefused) as refused:
        forms_from_json(written(**changes))
    assert refused.value.path == path


def test_a_body_of_a_form_that_is_not_there_is_refused() -> None:
    with pytest.raises(MessageRefused, match=r"bodies\.cup.*no form"):
        forms_from_json('{"bodies": {"cup": "0123456789abcdef"}, "forms": {}}')


def test_a_form_that_json_cannot_say_is_refused() -> None:
    cloud = Form(key=KEY, skins=(), solids=(Solid(size=(float("nan"), 1.0, 1.0)),))
    with pytest.raises(MessageRefused):
        forms_to_json({CUP: cloud})


def test_a_plan_says_only_what_is_not_usual() -> None:
    change = PlanChange(
        bodies={CUP: BodyChange(size=(0.1, 0.1, 0.1), top=MUG, hold=TURNED, mobility=Mobility.DYNAMIC, mass_kg=0.3)},
        apart=((CUP, MUG),),
        joints={BodyId("hinge"): JointChange(parent=CUP, child=MUG), BodyId("slide"): None},
        poses={CUP: TURNED},
    )
    turned = {"position": [1.0, 2.0, 3.0], "quaternion": [0.9659258262890683, 0.0, 0.0, 0.25881904510252074]}
    assert json.loads(plan_to_json(change)) == {
        "bodies": {
            "cup": {"size": [0.1, 0.1, 0.1], "top": "mug", "hold": turned, "mobility": "dynamic", "mass_kg": 0.3}
        },
        "apart": [["cup", "mug"]],
        "joints": {"hinge": {"parent": "cup", "child": "mug"}, "slide": None},
        "poses": {"cup": turned},
    }
    assert plan_to_json(PlanChange()) == "{}"


def test_the_golden_forms_and_plans_are_what_is_read_and_written() -> None:
    told = {case.values[0]["name"]: case.values[0]["json"] for case in cases()}
    golden = told["a world with forms and a plan"]
    assert forms_from_json(golden["forms"])[BodyId("drawer")].kind == "drawer"
    for text in (golden["plan"], told["a handle on a drawer, as it was decided"]["plan"]):
        change = from_json(text, PlanChange)
        assert change.bodies
        assert from_json(plan_to_json(change), PlanChange) == change
