"""What happens to things in a sample: bodies are put where they are to be, and each event is written by hand."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from mindstage.engines import NullEngine
from mindstage.imagination import EventKind
from mindstage.imagination.watch import EventWatch, WatchBasis
from mindstage.scene import Attachment, BodyId, Pose, Vector
from mindstage.scene.edits import Delete, Detach, SetPoses
from mindstage.scene.transforms import pose_from_array, quat_multiply
from mindstage.simulation import Simulation
from tests.engines.scenes import body
from tests.imagination.scenes import TABLE_HEIGHT_M, on_table

A, B, LID = BodyId("a"), BodyId("b"), BodyId("lid")
TOP = TABLE_HEIGHT_M + 0.05


@pytest.fixture
def sim() -> Iterator[Simulation]:
    """Two boxes on a table, and one on the first of them, to which a lid is attached."""
    boxes = (
        body("a", (-0.3, 0.0, TOP), (0.1, 0.1, 0.1), "dynamic", 1.0),
        body("b", (-0.6, 0.0, TOP), (0.1, 0.1, 0.1), "dynamic", 1.0),
        body("c", (-0.3, 0.0, TOP + 0.1), (0.1, 0.1, 0.1), "dynamic", 1.0),
        body("lid", (-0.3, 0.0, TOP + 0.16), (0.1, 0.1, 0.02), "dynamic", 0.1),
    )
    with on_table(*boxes, Attachment(parent=BodyId("c"), child=LID), engine=NullEngine()) as sim:
        yield sim


@pytest.fixture
def watch(sim: Simulation) -> EventWatch:
    return EventWatch(sim, WatchBasis.of(sim))


def put(sim: Simulation, id: str, position: Vector, *, tilt: float = 0.0, yaw: float = 0.0) -> None:
    """Puts a body somewhere, turned about the vertical and then tilted about the x axis of the world."""
    cosine, sine, c, s = math.cos(tilt / 2), math.sin(tilt / 2), math.cos(yaw / 2), math.sin(yaw / 2)
    pose = Pose(position, (cosine * c, sine * c, -sine * s, cosine * s))
    sim.engine.run(lambda engine: engine.apply(SetPoses({BodyId(id): pose})), edits=True)


def events(watch: EventWatch) -> list[tuple[str, str | None, str | None]]:
    watch.update()
    return [(event.kind.value, event.thing, event.other) for event in watch.events]


def test_nothing_happens_to_what_stays_or_is_moved_a_little(sim: Simulation, watch: EventWatch) -> None:
    assert events(watch) == []
    put(sim, "a", (-0.3, 0.5, TOP - 0.049), tilt=0.7)
    put(sim, "b", (-0.6, 0.0, TOP + 3.0), yaw=3.0)
    assert events(watch) == []


def test_all_of_several_falls_are_reported_once_with_what_they_fell_from(sim: Simulation, watch: EventWatch) -> None:
    watch.step = 4
    sim.step(0.5)
    put(sim, "a", (0.3, 0.0, 0.05))
    put(sim, "b", (0.6, 0.0, TOP - 0.2))
    put(sim, "c", (0.3, 0.3, 0.05))
    assert sorted(events(watch), key=str) == [("fell", "a", "table"), ("fell", "b", "table"), ("fell", "c", "a")]
    amounts = {event.thing: event.amount for event in watch.events}
    assert amounts == {"a": pytest.approx(0.7), "b": pytest.approx(0.2), "c": pytest.approx(0.8)}
    assert {(event.step, event.time_s) for event in watch.events} == {(4, 0.5)}
    texts = {event.thing: event.text for event in watch.events}
    assert texts["b"] == "b fell by 0.20 m from table"
    put(sim, "b", (0.6, 0.0, 0.05))
    assert len(events(watch)) == 3, "it still falls"
    watch.finish()
    b = next(event for event in watch.events if event.thing == "b")
    assert (b.text, b.amount) == ("b fell by 0.70 m from table", pytest.approx(0.7)), "the whole height"
    put(sim, "b", (0.6, 0.0, TOP))
    watch.finish()
    b = next(event for event in watch.events if event.thing == "b")
    assert b.amount == pytest.approx(0.7), "the largest one"


@pytest.mark.parametrize("yaw", [0.0, 1.0, 2.5])
@pytest.mark.parametrize(("tilt", "is_tipped"), [(0.78, False), (0.79, True), (-0.79, True), (3.0, True)])
def test_a_thing_tips_over_when_its_vertical_turns_by_45_degrees(
    sim: Simulation, watch: EventWatch, yaw: float, tilt: float, is_tipped: bool
) -> None:
    put(sim, "a", (-0.3, 0.0, TOP), tilt=tilt, yaw=yaw)
    assert events(watch) == ([("tipped", "a", None)] if is_tipped else [])
    if is_tipped:
        (event,) = watch.events
        assert event.amount == pytest.approx(abs(tilt))
        assert event.text == f"a tipped over, by {math.degrees(abs(tilt)):.0f} degrees"
        assert len(events(watch)) == 1


def test_what_turns_while_it_falls_fell(sim: Simulation, watch: EventWatch) -> None:
    put(sim, "a", (0.3, 0.0, 0.05), tilt=1.5)
    assert events(watch) == [("fell", "a", "table")]
    put(sim, "a", (0.3, 0.0, 0.05), tilt=3.0)
    assert events(watch) == [("fell", "a", "table")]


def test_what_falls_after_it_tipped_over_tipped_and_fell(sim: Simulation, watch: EventWatch) -> None:
    put(sim, "a", (-0.1, 0.0, TOP), tilt=1.5)
    assert events(watch) == [("tipped", "a", None)]
    put(sim, "a", (0.3, 0.0, 0.05), tilt=1.5)
    assert events(watch) == [("tipped", "a", None), ("fell", "a", "table")]


def test_the_vertical_is_that_of_the_pose_in_which_it_was_put(sim: Simulation, watch: EventWatch) -> None:
    put(sim, "a", (-0.3, 0.0, TOP), tilt=1.5, yaw=1.0)
    watch.set_reference([A])
    assert events(watch) == []
    lying = sim.snapshot().body(A).pose
    turned = quat_multiply((math.cos(0.6), 0.0, 0.0, math.sin(0.6)), lying.quaternion)
    turned_pose = pose_from_array(np.array([*lying.position, *turned]))
    sim.engine.run(lambda engine: engine.apply(SetPoses({A: turned_pose})), edits=True)
    assert events(watch) == [], "turned about the vertical"
    put(sim, "a", (-0.3, 0.0, TOP))
    assert events(watch) == [("tipped", "a", None)]


def test_what_was_put_elsewhere_falls_from_there_and_may_fall_again(sim: Simulation, watch: EventWatch) -> None:
    put(sim, "a", (0.3, 0.0, 0.05))
    put(sim, "b", (0.6, 0.0, 0.05))
    assert len(events(watch)) == 2
    put(sim, "a", (-0.8, 0.0, TOP + 1.0))
    watch.set_reference([A])
    assert len(events(watch)) == 2
    put(sim, "a", (-0.8, 0.0, TOP + 0.5))
    assert events(watch)[2:] == [("fell", "a", None)], "of the other one it is known already"
    assert watch.events[2].amount == pytest.approx(0.5)


def test_what_is_attached_falls_with_what_it_is_attached_to(sim: Simulation, watch: EventWatch) -> None:
    assert watch.group_of(LID) == watch.group_of(BodyId("c")) == {"c", "lid"}
    assert watch.group_of(A) == {"a"}
    assert watch.group_of(BodyId("unknown")) == {"unknown"}
    put(sim, "c", (0.3, 0.0, 0.05))
    assert events(watch) == [("fell", "c", "a")], "one fall, of both"
    sim.engine.run(lambda engine: engine.apply(Detach(LID)), edits=True)
    watch.refresh()
    put(sim, "lid", (0.3, 0.0, 0.01))
    assert events(watch)[1:] == [("fell", "lid", "c")]


def test_what_leaves_the_place_is_reported_and_what_falls_within_is_not(sim: Simulation, watch: EventWatch) -> None:
    put(sim, "a", (0.3, 0.0, 0.05))
    put(sim, "b", (0.0, 0.0, -50.0))
    assert set(events(watch)) == {("fell", "a", "table"), ("fell", "b", "table"), ("left", "b", None)}
    assert next(event.text for event in watch.events if event.kind is EventKind.LEFT) == "b left the place"


def test_bodies_that_come_and_go_keep_the_references_of_the_others(sim: Simulation, watch: EventWatch) -> None:
    new = body("new", (-0.9, 0.0, TOP), (0.1, 0.1, 0.1), "dynamic", 1.0)
    sim.engine.run(lambda engine: engine.apply(Delete((A,))), edits=True)
    sim.spawn(type(sim.worlds[0])(iri=sim.worlds[0].iri, bodies=(new,)))
    assert events(watch) == []
    put(sim, "b", (0.3, 0.0, 0.05))
    put(sim, "new", (0.3, 0.3, 0.05))
    assert set(events(watch)) == {("fell", "b", "table"), ("fell", "new", "table")}
    assert set(watch.moved_ids()) == {"b", "new"}


def test_what_robots_carry_neither_falls_nor_tips_until_they_let_it_go(sim: Simulation, watch: EventWatch) -> None:
    watch.carried = lambda: [A]
    put(sim, "a", (0.3, 0.0, 0.5), tilt=2.0)
    put(sim, "b", (0.6, 0.0, 0.05))
    assert events(watch) == [("fell", "b", "table")]
    watch.carried = tuple
    put(sim, "a", (0.3, 0.0, 0.05), tilt=2.0)
    assert events(watch)[1:] == [("fell", "a", None)]
    assert watch.events[1].amount == pytest.approx(0.45), "from where it was let go"


@pytest.mark.parametrize(("distance", "is_moved"), [(0.009, False), (0.011, True)])
def test_moved_bodies_are_those_that_are_elsewhere(
    sim: Simulation, watch: EventWatch, distance: float, is_moved: bool
) -> None:
    put(sim, "a", (-0.3 + distance, 0.0, TOP), yaw=1.0)
    assert watch.moved_ids() == (["a"] if is_moved else [])
    put(sim, "b", (-0.6, 0.02, TOP))
    assert watch.moved_ids() == (["a", "b"] if is_moved else ["b"])
    watch.set_reference([A, B])
    assert "b" in watch.moved_ids(), "since the start"
