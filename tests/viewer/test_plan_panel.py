"""Plans on the page, in a real browser: form, progress, verdict, ghosts; and open copies of the simulation."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.access.limits import GHOSTS
from mindstage.imagination import Verdict, evaluate_plan
from mindstage.scene import BodyId, Pose
from mindstage.scene.edits import SetPoses
from mindstage.viewer import Viewer
from mindstage.viewer import plans as panel
from mindstage.viewer.ghosts import FAILED_COLOR, end_pose_ghosts
from tests.kitchenette import kitchenette
from tests.viewer.page_tab import PageTab
from tests.viewer.waiting import wait_until

EDGE = """steps:
  - {do: move, thing: Mug, to: {position: [1.72, 0.2, 0.85]}}
  - {do: wait, duration_s: 0.5}
uncertainty:
  - {thing: Mug, position_m: 0.03}
"""
"""The mug is 8 cm wide, and the edge of the cupboard is at x = 1.7."""


@pytest.fixture(scope="module")
def simulation() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        simulation.step(0.2)
        yield simulation


@pytest.fixture(scope="module")
def viewer(simulation: Simulation) -> Iterator[Viewer]:
    with Viewer(simulation, port=0) as viewer:
        yield viewer


@pytest.fixture(scope="module")
def verdict(simulation: Simulation) -> Verdict:
    return evaluate_plan(simulation, EDGE, samples=12, fixed=True, seed=4)


@pytest.fixture
def tab(viewer: Viewer, open_page: Callable[..., PageTab]) -> Iterator[PageTab]:
    tab = open_page(viewer, view=False)
    tab.open_panel("plan")
    yield tab
    viewer.channel._methods["plan.cancel"].handler(None, None)
    wait_until(lambda: viewer._plans._thread is None or not viewer._plans._thread.is_alive(), "no plan runs")
    viewer.channel._methods["plan.clear"].handler(None, None)
    wait_until(lambda: not layers(viewer), "the ghosts are removed")


def layers(viewer: Viewer) -> frozenset[str]:
    return viewer._plans._nodes.layers


def result(tab: PageTab) -> str:
    return str(tab.page.locator("[data-role=verdict]").inner_text())


def test_a_plan_is_tried_and_its_end_poses_and_failing_sample_are_shown(
    tab: PageTab, viewer: Viewer, simulation: Simulation
) -> None:
    before, revision = simulation.state.poses.copy(), simulation.state.revision
    tab.page.locator("[data-role=plan]").fill(EDGE)
    tab.page.get_by_label("Samples", exact=True).fill("20")
    tab.click_button("plan-evaluate")
    wait_until(lambda: "Mug" in result(tab) and "samples succeeded" in result(tab), "the verdict is shown")
    outcome = tab.page.locator("[data-outcome]").get_attribute("data-outcome")
    assert outcome in {"failed", "unknown"}
    wait_until(lambda: layers(viewer) == {"end poses"}, "the end poses are drawn")
    node, _, count = viewer._plans._nodes._nodes["end poses", BodyId("Mug")]
    assert count == 20
    heights = np.array(node.batched_positions)[:, 2]
    assert heights.max() > 0.8
    assert heights.min() < 0.5
    tab.click_button("plan-replay")
    wait_until(lambda: "replay" in layers(viewer), "the failing sample is played")
    ghost = viewer._plans._nodes._nodes["replay", BodyId("Mug")][0]
    wait_until(lambda: float(np.array(ghost.batched_positions)[0, 2]) < 0.5, "the ghost falls")
    assert np.array_equal(simulation.state.poses, before)
    assert simulation.state.revision == revision
    tab.click_button("plan-clear")
    wait_until(lambda: not layers(viewer) and not result(tab), "everything is removed")


def test_a_verdict_is_cleared_when_the_world_changes(tab: PageTab, viewer: Viewer, simulation: Simulation) -> None:
    tab.page.locator("[data-role=plan]").fill("steps:\n  - {do: wait, duration_s: 0.1}\n")
    tab.click_button("plan-evaluate")
    wait_until(lambda: "1 of 1 samples succeeded" in result(tab), "the verdict is shown")
    simulation.edits.move("Mug", Pose((0.5, -2.0, 0.05)))
    wait_until(lambda: "The world has changed" in result(tab), "the verdict is not shown any more")
    assert not layers(viewer)
    simulation.edits.undo()


def test_steps_and_uncertainty_are_added_by_form(tab: PageTab) -> None:
    tab.select_in_tree("Mug")
    tab.open_panel("plan")
    tab.page.get_by_role("combobox", name="Where").fill("Fridge")
    tab.click_button("add-step")
    tab.click_button("add-uncertainty")
    tab.page.locator("[data-role=step]").select_option("wait")
    tab.page.get_by_label("Value").fill("0.2")
    tab.click_button("add-step")
    text = tab.page.locator("[data-role=plan]").input_value()
    assert text == (
        "steps:\n  - {do: place, thing: Mug, on: Fridge}\n  - {do: wait, duration_s: 0.2}\n"
        "uncertainty:\n  - {thing: Mug, position_m: 0.01}\n"
    )
    tab.page.get_by_label("Samples", exact=True).fill("3")
    tab.click_button("plan-evaluate")
    wait_until(lambda: "3 of 3 samples succeeded" in result(tab), "the plan of the form is tried")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("steps:\n  - {do: fly}\n", "the plan:2: steps[0].do"),
        ("steps:\n  - {do: wait, duration_s: 1}\n  - {do: open, thing: Frdge}\n", "the plan:3: steps[1].thing"),
        ("/etc/passwd", "the plan:1"),
        ("", "the plan:1: it is empty"),
        ("steps: []\n", "the plan has neither steps nor a check"),
    ],
)
def test_an_invalid_plan_is_refused_with_its_line(tab: PageTab, text: str, message: str) -> None:
    tab.page.locator("[data-role=plan]").fill(text)
    tab.click_button("plan-evaluate")
    wait_until(lambda: message in result(tab), "the error names the line")


def test_a_plan_is_canceled_from_another_page(
    tab: PageTab, viewer: Viewer, open_page: Callable[..., PageTab], monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = threading.Event()

    def slow(simulation: Simulation, plan: object, **options: object) -> Verdict:
        begun.set()
        return evaluate_plan(simulation, plan, **{**options, "fixed": True, "samples": 100_000})  # type: ignore[arg-type]

    monkeypatch.setattr(panel, "evaluate_plan", slow)
    tab.page.locator("[data-role=plan]").fill(EDGE)
    tab.click_button("plan-evaluate")
    assert begun.wait(60.0)
    wait_until(lambda: "succeeded" in result(tab), "the progress is shown")
    other = open_page(viewer, view=False)
    other.open_panel("plan")
    wait_until(lambda: other.page.locator("[data-action=plan-cancel]").is_visible(), "it is known there, too")
    assert other.page.locator("[data-action=plan-evaluate]").is_disabled()
    other.click_button("plan-cancel")
    wait_until(lambda: "canceled" in tab.page.locator("[data-role=verdict]").inner_html(), "it has ended")


def test_open_copies_are_drawn_as_ghosts_until_they_are_closed(
    tab: PageTab, viewer: Viewer, simulation: Simulation
) -> None:
    with simulation.fork() as first, simulation.fork() as second:
        first.engine.run(lambda engine: engine.apply(SetPoses({BodyId("Mug"): Pose((0.5, 0.0, 1.0))})))
        second.place("Mug", on="Fridge")
        wait_until(lambda: len([each for each in layers(viewer) if each.startswith("copy")]) == 2, "both are drawn")
        names = sorted(layers(viewer))
        node = viewer._plans._nodes._nodes[names[0], BodyId("Mug")][0]
        assert np.array(node.batched_positions)[0] == pytest.approx((0.5, 0.0, 1.0), abs=1e-6)
        wait_until(lambda: "1 body elsewhere" in tab.page.locator("[data-role=copies]").inner_text(), "they are listed")
        tab.page.locator("[data-action=show-copies]").uncheck()
        wait_until(lambda: not layers(viewer), "the ghosts are hidden")
        tab.page.locator("[data-action=show-copies]").check()
        wait_until(lambda: len(layers(viewer)) == 2, "they are shown again")
    wait_until(lambda: not layers(viewer), "the copies are closed")
    wait_until(lambda: not tab.page.locator("[data-role=copies]").is_visible(), "nothing is listed")


def test_ghosts_are_seen_in_the_view(
    viewer: Viewer, verdict: Verdict, open_page: Callable[..., PageTab], tab: PageTab
) -> None:
    points = viewer.show_verdict(verdict)
    assert verdict.first_failure is not None
    wait_until(lambda: layers(viewer) == {"end poses", "replay"}, "the ghosts are drawn")
    assert len(points) == len(verdict.end_poses("Mug")) + 8
    page = open_page(viewer)
    viewer.views.focus_points(points)

    def red() -> int:
        pixels = page.pixels().astype(int)
        return int(np.count_nonzero((pixels[..., 0] > pixels[..., 1] + 40) & (pixels[..., 0] > pixels[..., 2] + 40)))

    wait_until(lambda: red() > 200, "failed samples are red")
    node = viewer._plans._nodes._nodes["replay", BodyId("Mug")][0]
    assert not node._impl.click_cb


def test_what_a_plan_adds_is_drawn_as_a_member_of_its_class(
    viewer: Viewer, simulation: Simulation, tab: PageTab
) -> None:
    verdict = evaluate_plan(simulation, "{steps: [{do: place, thing: CoffeeMaker, on: Fridge}]}")
    viewer.show_verdict(verdict)
    wait_until(lambda: layers(viewer) == {"end poses"}, "the mug is drawn")
    drawn = {id for _, id in viewer._plans._nodes._nodes}
    assert [id.partition("_")[0] for id in drawn - set(simulation.state.ids)] == ["CoffeeMaker"]


def test_at_most_so_many_end_poses_are_drawn(verdict: Verdict) -> None:
    many = type(verdict)(**{field: getattr(verdict, field) for field in verdict.__dataclass_fields__} | {
        "results": verdict.results * 100
    })  # fmt: skip
    (mug,) = end_pose_ghosts(many)
    assert len(mug.poses) == GHOSTS.count
    assert any(np.allclose(color, FAILED_COLOR) for color in mug.colors)


def test_a_plan_is_done_and_undone(tab: PageTab, simulation: Simulation) -> None:
    before = simulation.snapshot().body("Mug").pose.position
    tab.page.locator("[data-role=plan]").fill("steps:\n  - {do: move, thing: Mug, by: [0.0, 0.1, 0.0]}\n")
    tab.click_button("plan-act")
    wait_until(lambda: "done in" in result(tab), "the outcome is shown")
    assert tab.page.locator("[data-outcome]").get_attribute("data-outcome") == "succeeded"
    moved = simulation.snapshot().body("Mug").pose.position
    assert np.subtract(moved, before) == pytest.approx([0.0, 0.1, 0.0], abs=2e-3)
    assert simulation.edits.history.undo[:1] == ("plan",)
    tab.click_button("plan-undo")
    wait_until(
        lambda: np.allclose(simulation.snapshot().body("Mug").pose.position, before, atol=1e-4), "the mug is back"
    )
