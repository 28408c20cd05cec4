"""What the page says in words."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from mindstage import NullEngine, Stage
from mindstage.stage import Lit
from mindstage.viewport.details import body_html, fault_html, legend_html, status_html
from mindstage.world import Body, BodyId, Iri, Physics
from mindstage.world.colours import COLOURS
from mindstage.world.geometry import pose_array
from tests.kitchenette import kitchenette


def html_of(body: Body, **more: object) -> str:
    return body_html(body, **({"ancestors": (), "pose": pose_array([body.pose])[0]} | more))


def test_a_body_is_named_with_all_that_is_known() -> None:
    html = html_of(
        kitchenette().body("DrawerHandle"), ancestors=(Iri("http://x#Part"), Iri("http://x#Thing")), hangs_on="Drawer"
    )
    for text in (
        "Handle",
        "DrawerHandle",
        "Part, Thing",
        "0.04 x 0.2 x 0.02 m",
        "0.2 kg",
        "kinematic",
        "1.680",
        "Drawer",
    ):
        assert text in html


def test_what_was_not_told_is_said_so() -> None:
    bare = replace(kitchenette().body("Mug"), size=None, physics=Physics())
    assert html_of(bare).count("not told") == 3


def test_a_long_line_of_ancestors_ends_in_dots() -> None:
    html = html_of(kitchenette().body("Mug"), ancestors=[Iri(f"http://x#A{n}") for n in range(9)])
    assert "A4 …" in html
    assert "A5" not in html


def test_a_turn_is_told_in_degrees() -> None:
    mug = kitchenette().body("Mug")
    quarter = np.array([0.0, 0.0, 0.0, np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)])
    assert "roll 0°, pitch 0°, yaw 90°" in html_of(mug, pose=quarter)
    assert "-0" not in html_of(mug, pose=np.array([0.0, 0.0, 0.0, 1.0, -1e-9, 0.0, 0.0])).split("turned")[1]


def test_the_legend_says_what_is_lit_and_why_the_latest_first() -> None:
    ids = tuple(BodyId(f"cup_{n}") for n in range(9))
    classes = ["Cup", "Cup", "Cup", "Bowl", "Plate", "Pan", "Pot", "Fork", "Fork"]
    mug = kitchenette().body("Mug")
    bodies = {id: replace(mug, id=id, cls=Iri(f"http://x#{cls}")) for id, cls in zip(ids, classes, strict=True)}
    first, second = Lit(ids=ids[:2], colour=COLOURS["red"], label="first reason"), Lit(ids=ids, colour=(0.0, 0.5, 1.0))
    html = legend_html((first, second), bodies)
    assert html.index("3 Cup, 2 Fork, 1 Bowl, 1 Plate, 1 Pan … 9 in all") < html.index("first reason")
    assert html.index("first reason") < html.index("Cup cup_0, Cup cup_1")
    assert "cup_5" not in html
    assert "3 Cup, 1 Bowl<" in legend_html([Lit(ids=ids[:4], colour=(1.0, 0.0, 0.0))], bodies)
    assert ">cup_0, cup_1<" in legend_html([first], {}), "what is not known yet has an id"
    assert 'aria-label="red"' in html
    assert "background:#0080ff" in html
    assert legend_html((), bodies) == ""


def test_a_map_cannot_write_into_the_page() -> None:
    evil = "<img src=x onerror=alert(1)>"
    mug = replace(kitchenette().body("Mug"), id=BodyId(evil), label=evil, cls=Iri(f"http://x#{evil}"))
    lit = legend_html([Lit(ids=(mug.id,), colour=(1.0, 0.0, 0.0), label=evil)], {mug.id: mug})
    for html in (html_of(mug, ancestors=(Iri(f"http://x#{evil}"),), hangs_on=BodyId(evil)), fault_html(evil), lit):
        assert "<img" not in html
        assert "&lt;img" in html


def test_the_status_says_what_the_world_does(stage: Stage) -> None:
    assert "paused" in status_html(stage.frame, engine="null")
    assert "8 bodies" in status_html(stage.frame, engine="null")
    assert "<b" not in status_html(stage.frame, engine="<b>")
    stage.play(speed=2.0)
    stage.call(lambda engine: None)
    assert "playing" in status_html(stage.frame, engine="null")
    stage.pause()


def test_a_fault_is_red_and_no_fault_is_nothing(stage: Stage) -> None:
    broken = replace(stage.frame, fault="the solver gave up")
    assert "the solver gave up" in status_html(broken, engine="null")
    assert 'role="alert"' in status_html(broken, engine="null")
    assert 'role="alert"' not in status_html(stage.frame, engine=NullEngine.name)
    assert fault_html("") == ""
