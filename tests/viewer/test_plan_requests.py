"""Requests and topics of the plan panel, without a browser: progress, verdicts, errors, and what is done."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from mindstage import KnowledgeBase, MujocoEngine, NullEngine, Simulation
from mindstage.scene import BodyId, Pose
from mindstage.viewer import Viewer
from mindstage.viewer import plans as panel
from tests.kitchenette import kitchenette
from tests.viewer.fake_page import FakePage, RequestFailedError
from tests.viewer.waiting import wait_until

MUG = BodyId("Mug")
FALLS = """
name: over the edge
steps:
  - {do: move, thing: Mug, to: {position: [1.0, 0.0, 1.2]}}
  - {do: wait, duration_s: 1}
"""
STAYS = "name: wait\nsteps:\n  - {do: wait, duration_s: 0.2}\nuncertainty:\n  - {thing: Mug, yaw_rad: 0.1}\n"
LONG = "steps:\n  - {do: wait, duration_s: 3000, deadline_s: 4000}\ndeadline_s: 5000\n"


@pytest.fixture
def sim() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        yield sim


@pytest.fixture
def page(sim: Simulation) -> Iterator[FakePage]:
    with Viewer(sim, port=0) as viewer:
        yield FakePage(viewer.channel)


def state(page: FakePage) -> dict[str, Any]:
    return dict(page.latest_value("plan"))


def ended(page: FakePage) -> dict[str, Any]:
    wait_until(lambda: state(page)["state"] not in {"running", "acting"}, "it has ended")
    return state(page)


def test_a_verdict_has_its_numbers_its_causes_and_its_ghosts(page: FakePage, sim: Simulation) -> None:
    before = sim.snapshot()
    assert state(page) == {"state": "idle"}
    assert page.ask("plan.evaluate", plan=FALLS, samples=5, threshold=0.5) == {"steps": 2}
    found = ended(page)
    assert (found["state"], found["outcome"], found["probability"]) == ("done", "failed", 0.0)
    assert (found["samples"], found["succeeded"], found["failed"], found["unknown"]) == (1, 0, 1, 0)
    assert found["interval"] == [0.0, 0.0]
    assert found["stopped"] == "all samples were run"
    ((cause),) = found["causes"]
    assert (cause["kind"], cause["thing"], cause["count"]) == ("fell", "Mug", 1)
    assert "Mug fell" in found["why"]
    assert any("no uncertainty is stated" in each for each in found["assumptions"])
    assert (found["drawn"], found["shown"], found["failing_sample"]) == (["Mug"], 1, 0)
    assert found["replay_s"] == page.ask("plan.replay") > 0.1
    assert sim.snapshot() == before
    page.ask("plan.clear")
    assert state(page) == {"state": "idle"}
    with pytest.raises(RequestFailedError, match="the failing sample: there is none; try a plan that fails"):
        page.ask("plan.replay")


def test_a_plan_that_succeeds_has_no_failing_sample(page: FakePage) -> None:
    page.ask("plan.evaluate", plan=STAYS, samples=12, seed=3, threshold=0.5)
    found = ended(page)
    assert (found["outcome"], found["succeeded"], found["failing_sample"], found["replay_s"]) == (
        "succeeded",
        10,  # of 12: these show that it is at least 0.5
        None,
        None,
    )
    assert found["shown"] == 10
    with pytest.raises(RequestFailedError, match="there is none"):
        page.ask("plan.replay")


def test_a_plan_that_runs_is_published_refuses_others_and_is_canceled(page: FakePage) -> None:
    page.ask("plan.evaluate", plan=LONG, samples=5)
    assert (state(page)["state"], state(page)["done"], state(page)["samples"]) == ("running", 0, 5)
    with pytest.raises(RequestFailedError, match="a plan is running already, on this or another page"):
        page.ask("plan.evaluate", plan=STAYS)
    with pytest.raises(RequestFailedError, match="a plan is running already"):
        page.ask("plan.act", plan=STAYS)
    page.ask("plan.clear")
    assert state(page)["state"] == "running"
    page.ask("plan.cancel")
    found = ended(page)
    assert (found["outcome"], found["stopped"]) == ("unknown", "canceled")
    page.ask("plan.evaluate", plan=STAYS, samples=1)
    assert ended(page)["succeeded"] == 1, "the cancelation is forgotten"


def test_a_plan_is_done_in_the_world_as_one_step_that_can_be_undone(page: FakePage, sim: Simulation) -> None:
    before = sim.snapshot().body(MUG).pose
    plan = "steps:\n  - {do: move, thing: Mug, to: {position: [0.0, -1.0, 0.05]}}\n  - {do: wait, duration_s: 0.2}\n"
    assert page.ask("plan.act", plan=plan) == {"steps": 2}
    found = ended(page)
    assert (found["state"], found["outcome"]) == ("acted", "succeeded")
    assert re.match(r"done in 0\.[23] s$", found["why"])
    assert sim.snapshot().body(MUG).pose.position == pytest.approx((0.0, -1.0, 0.05), abs=0.01)
    sim.edits.undo()
    assert sim.snapshot().body(MUG).pose.position == pytest.approx(before.position, abs=0.01)
    page.ask("plan.act", plan=FALLS)
    found = ended(page)
    assert (found["outcome"], "Mug fell" in found["why"]) == ("failed", True)


@pytest.mark.parametrize("method", ["plan.evaluate", "plan.act"])
@pytest.mark.parametrize(
    ("plan", "message"),
    [
        ("steps:\n  - {do: move, thing: Mugg, by: [0, 0, 1]}\n", r":2: steps\[0\].thing: .*'Mugg'"),
        ("steps: [", "neither JSON nor YAML"),
        ("steps:\n  - {do: fly}\n", "'fly'"),
    ],
)
def test_a_plan_that_does_not_fit_is_refused_with_its_line(
    page: FakePage, method: str, plan: str, message: str
) -> None:
    with pytest.raises(RequestFailedError, match=message):
        page.ask(method, plan=plan)
    assert state(page) == {"state": "idle"}


def test_more_processes_than_the_machine_has_are_refused(page: FakePage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(panel.os, "cpu_count", lambda: 3)
    with pytest.raises(RequestFailedError, match="4 processes: this machine has 3 processors; at most 3"):
        page.ask("plan.evaluate", plan=STAYS, workers=4)


@pytest.mark.parametrize("method", ["plan.evaluate", "plan.act"])
@pytest.mark.parametrize(
    ("error", "text"),
    [
        (KeyError("spoon"), "KeyError: 'spoon'; this is a defect of Mindstage"),
        (
            panel.InvalidArgumentError("the spoon", cause="it is bent", remedy="take another"),
            "the spoon: it is bent; take another",
        ),
    ],
    ids=["defect", "refusal"],
)
def test_an_error_while_a_plan_runs_is_shown_and_another_plan_can_be_run(
    page: FakePage, monkeypatch: pytest.MonkeyPatch, method: str, error: Exception, text: str
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    is_over = threading.Event()
    monkeypatch.setattr(threading, "excepthook", lambda _: is_over.wait(60.0))  # a thread that ends slowly
    with monkeypatch.context() as patch:
        patch.setattr(panel, "evaluate_plan" if method == "plan.evaluate" else "act", fail)
        page.ask(method, plan=STAYS)
        assert ended(page) == {"state": "error", "error": text}
    page.ask("plan.evaluate", plan=STAYS, samples=1)
    assert ended(page)["succeeded"] == 1
    is_over.set()


def test_an_engine_without_physics_is_imagined_by_one_with_it() -> None:
    with Simulation(KnowledgeBase(), NullEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        with Viewer(sim, port=0) as viewer:
            page = FakePage(viewer.channel)
            page.ask("plan.evaluate", plan=FALLS)
            found = ended(page)
    assert found["outcome"] == "failed"
    assert "null has no physics: the copy is simulated by mujoco, from a snapshot at rest" in found["assumptions"]


def test_open_copies_are_listed_with_how_many_bodies_are_elsewhere(page: FakePage, sim: Simulation) -> None:
    with sim.fork() as copy:
        copy.edits.move(MUG, Pose((0.0, -1.0, 0.05)))
        wait_until(lambda: (page.latest_value("copies") or {}).get("copies"), "it is listed")
        wait_until(lambda: page.latest_value("copies")["copies"][0]["differing"] == 1, "the mug is elsewhere")
        (found,) = page.latest_value("copies")["copies"]
        assert (found["number"], found["color"][0], len(found["color"])) == (1, "#", 7)
        page.ask("plan.show_copies", shown=False)
        wait_until(lambda: not page.latest_value("copies")["shown"], "they are hidden")
    wait_until(lambda: not page.latest_value("copies")["copies"], "it is closed")
