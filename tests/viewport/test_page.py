"""The page in a real browser, by what a person does there."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from mindstage import KnowledgeBase, MujocoEngine, Stage
from mindstage.viewport import Viewport
from mindstage.viewport.framing import View
from mindstage.world import BodyId
from tests.kitchenette import kitchenette
from tests.viewport.visiting import Visit, opening_view
from tests.viewport.waiting import wait_until

Visiting = Callable[[Viewport], Visit]

ON_THE_HANDLE = (1.66, 0.0, 0.65)
PULLED_OUT = (1.36, 0.0, 0.65)


@pytest.fixture
def view(stage: Stage) -> View:
    return opening_view(kitchenette(), stage.knowledge.ancestors)


@pytest.fixture
def alive() -> Iterator[Stage]:
    with Stage(KnowledgeBase(), MujocoEngine()) as stage:
        stage.spawn(kitchenette())
        yield stage


def position(stage: Stage, id: str) -> np.ndarray:
    return stage.frame.poses[stage.frame.ids.index(BodyId(id))][:3]


def test_the_kitchen_is_drawn_and_described(viewport: Viewport, visit: Visiting) -> None:
    visitor = visit(viewport)
    wait_until(lambda: visitor.colours() > 200, "there is much to see")
    assert visitor.says("8 bodies")
    assert visitor.says("null")
    assert visitor.says("paused")


def test_clicking_on_a_thing_names_it_and_clicking_again_does_not(
    viewport: Viewport, visit: Visiting, view: View
) -> None:
    visitor = visit(viewport)
    visitor.click(view, ON_THE_HANDLE)
    wait_until(lambda: viewport.selected == "DrawerHandle", "the handle is selected")
    wait_until(lambda: visitor.says("DrawerHandle") and visitor.says("kinematic"), "the panel names the handle")
    visitor.click(view, ON_THE_HANDLE)
    wait_until(lambda: viewport.selected is None and visitor.says("Nothing is selected"), "nothing is selected")


def test_a_thing_is_found_by_a_part_of_its_name(viewport: Viewport, visit: Visiting) -> None:
    visitor = visit(viewport)
    visitor.field("Find").fill("fridge")
    wait_until(lambda: visitor.field("Found").is_visible(), "the page offers what it found")
    wait_until(lambda: visitor.field("Found").input_value() == "3 found", "it found the fridge, its door and handle")
    visitor.field("Find").fill("mug")
    wait_until(lambda: viewport.selected == "Mug", "the only mug is selected")
    wait_until(lambda: visitor.says("0.3 kg"), "the panel names the mug")


def test_the_buttons_play_pause_step_and_reset(stage: Stage, viewport: Viewport, visit: Visiting) -> None:
    visitor = visit(viewport)
    start = stage.frame.time_s
    visitor.press("Step")
    wait_until(lambda: stage.frame.time_s == pytest.approx(start + 0.1), "a tenth of a second has passed")
    visitor.press("Play")
    wait_until(lambda: stage.frame.playing and stage.frame.time_s > start + 0.2, "time passes")
    wait_until(lambda: visitor.says("playing"), "the page says that it plays")
    visitor.press("Pause")
    wait_until(lambda: not stage.frame.playing, "time stands still")
    wait_until(lambda: visitor.says("paused"), "the page says that it is paused")
    pose = kitchenette().body("Fridge").pose
    stage.call(lambda engine: engine.set_pose(BodyId("Mug"), pose))
    visitor.press("Reset")
    wait_until(lambda: np.allclose(position(stage, "Mug"), (2.0, 0.0, 0.85)), "the mug is back in its place")


def test_the_speed_is_what_was_chosen(stage: Stage, viewport: Viewport, visit: Visiting) -> None:
    visitor = visit(viewport)
    visitor.press("Play")
    wait_until(lambda: stage.frame.playing, "time passes")
    visitor.field("Speed").click()
    visitor.page.get_by_role("option", name="2 x", exact=True).click()
    wait_until(lambda: stage.frame.speed == 2.0, "time passes twice as fast")
    stage.play(speed=0.5)
    wait_until(lambda: visitor.field("Speed").input_value() == "0.5 x", "the page follows the stage")


def test_a_thing_that_moves_moves_in_the_picture(stage: Stage, viewport: Viewport, visit: Visiting) -> None:
    visitor = visit(viewport)
    wait_until(lambda: np.array_equal(visitor.pixels(), visitor.pixels()), "the picture stands still")
    still = visitor.pixels()
    pose = kitchenette().body("DrawerHandle").pose
    stage.call(lambda engine: engine.set_pose(BodyId("Drawer"), pose))
    wait_until(lambda: not np.array_equal(still, visitor.pixels()), "the picture has changed")


def test_a_late_visitor_sees_the_world_as_it_is_now(stage: Stage, viewport: Viewport, visit: Visiting) -> None:
    visit(viewport).click(opening_view(kitchenette(), stage.knowledge.ancestors), ON_THE_HANDLE)
    wait_until(lambda: viewport.selected == "DrawerHandle", "the handle is selected")
    stage.call(lambda engine: engine.delete([BodyId("Mug")]), edits=True)
    late = visit(viewport)
    wait_until(lambda: late.says("7 bodies") and late.says("DrawerHandle"), "the late visitor sees the same")


def test_a_drawer_is_pulled_open_with_the_mouse(alive: Stage, visit: Visiting) -> None:
    alive.play()
    with Viewport(alive, port=0) as viewport:
        visitor = visit(viewport)
        visitor.grab(opening_view(kitchenette(), alive.knowledge.ancestors), ON_THE_HANDLE, PULLED_OUT)
        wait_until(lambda: position(alive, "Drawer")[0] < 1.75, "the drawer has come out by 20 cm or more")
        assert [pull.id for pull in viewport._hands.pulls] == ["DrawerHandle"]
        visitor.let_go()
        wait_until(lambda: not viewport._hands.pulls, "the hand is open")
        _, y, z = position(alive, "Drawer")
        assert (y, z) == pytest.approx((0.0, 0.65), abs=1e-3)
        visitor.press("Reset")
        wait_until(lambda: position(alive, "Drawer")[0] == pytest.approx(1.95, abs=1e-6), "the drawer is closed")


def test_a_visitor_who_leaves_lets_go(alive: Stage, visit: Visiting) -> None:
    alive.play()
    with Viewport(alive, port=0) as viewport:
        visitor = visit(viewport)
        visitor.grab(opening_view(kitchenette(), alive.knowledge.ancestors), ON_THE_HANDLE, PULLED_OUT)
        wait_until(lambda: viewport._hands.pulls, "the handle is held")
        visitor.page.close()
        wait_until(lambda: not viewport._hands.pulls, "nothing is held any more")
        time_s = alive.frame.time_s
        wait_until(lambda: alive.frame.time_s > time_s + 0.5, "the world goes on")


def test_pulling_in_a_paused_world_says_why_nothing_moves(alive: Stage, visit: Visiting) -> None:
    with Viewport(alive, port=0) as viewport:
        visitor = visit(viewport)
        visitor.grab(opening_view(kitchenette(), alive.knowledge.ancestors), ON_THE_HANDLE, PULLED_OUT)
        wait_until(lambda: visitor.says("press Play"), "the page says that the world is paused")
        visitor.let_go()
    assert position(alive, "Drawer")[0] == 1.95


def test_what_the_stage_refuses_is_said_to_the_visitor(stage: Stage, viewport: Viewport, visit: Visiting) -> None:
    visitor = visit(viewport)
    stage.close()
    visitor.press("Step")
    wait_until(lambda: visitor.says("the stage is closed"), "the page says why nothing happens")
