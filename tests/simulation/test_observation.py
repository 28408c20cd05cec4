"""What observers of a simulation see: every edit with its client, its bodies and its details, and every question."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.engines import Engine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import SimulationFaultError
from mindstage.scene import BodyId, BodyPhysics, Material, Mobility, Pose
from mindstage.scene.edits import Attach, Delete, Detach, Edit, SetLabel, SetMaterials, SetPhysics, SetPoses
from mindstage.simulation import ConnectedClient
from mindstage.simulation.observation import as_client
from tests.kitchenette import kitchenette

MUG, DRAWER, FRIDGE = BodyId("Mug"), BodyId("Drawer"), BodyId("Fridge")
ALL = tuple(body.id for body in kitchenette().bodies)
Report = tuple[str, str, tuple[str, ...], dict[str, Any]]


class Log:
    """An observer that keeps what it sees."""

    interval_s = 0.5

    def __init__(self) -> None:
        self.reports: list[Report] = []
        self.states: list[tuple[float, bool]] = []
        """The time of each state [s], and whether it may have been edited."""

    def on_state(self, state: Any, engine: Engine, *, edited: bool, rebuild_pending: bool) -> None:
        self.states.append((round(state.time_s, 6), edited))

    def on_edit(self, kind: str, *, client: str, ids: Iterable[BodyId], details: Mapping[str, Any]) -> None:
        self.reports.append((kind, client, tuple(ids), dict(details)))

    def times(self) -> list[float]:
        """The times of the states, each once [s]."""
        return list(dict.fromkeys(time for time, _ in self.states))

    def taken(self) -> list[Report]:
        """The reports since the last call."""
        found, self.reports = self.reports, []
        return found


class Failing(Log):
    """An observer that raises when a body is moved."""

    def on_edit(self, kind: str, *, client: str, ids: Iterable[BodyId], details: Mapping[str, Any]) -> None:
        super().on_edit(kind, client=client, ids=ids, details=details)
        if kind == "set poses":
            raise ValueError("no")


@pytest.fixture
def sim() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), NullEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        yield sim


PHYSICS = BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=7.0)
STEEL = Material(name="steel", color=(0.5, 0.5, 0.6))
EDITS: list[tuple[Edit, str, tuple[str, ...]]] = [
    (SetLabel(MUG, "My mug"), "set label", (MUG,)),
    (Attach(FRIDGE, MUG), "attach", (MUG, FRIDGE)),
    (Detach(BodyId("DrawerHandle")), "detach", ("DrawerHandle",)),
    (Delete((MUG, DRAWER)), "delete", (MUG, DRAWER)),
    (SetPoses({MUG: Pose((1.0, 2.0, 3.0))}), "set poses", (MUG,)),
    (SetPhysics(MUG, PHYSICS), "set physics", (MUG,)),
    (SetMaterials(MUG, (STEEL,)), "set materials", (MUG,)),
]


@pytest.mark.parametrize(("edit", "kind", "ids"), EDITS, ids=[kind for _, kind, _ in EDITS])
def test_every_edit_is_reported_to_every_observer_with_its_client(
    sim: Simulation, edit: Edit, kind: str, ids: tuple[str, ...]
) -> None:
    logs = [Log(), Log(), Log()]
    for log in logs:
        sim.observers.add(log)
    with as_client("ROS: /cook"):
        sim.apply(edit)
    for log in logs:
        assert log.taken() == [(kind, "ROS: /cook", ids, {"edit": edit})]


def test_a_highlight_is_reported_with_its_color(sim: Simulation) -> None:
    log = Log()
    sim.observers.add(log)
    sim.engine.run(lambda engine: engine.highlight(iter([MUG, FRIDGE]), (1.0, 0.0, 0.0)), edits=True)
    assert log.taken() == [("highlight", "Python", (MUG, FRIDGE), {"color": (1.0, 0.0, 0.0)})]


def test_a_pull_and_its_end_are_reported_with_where_it_acts() -> None:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        log = Log()
        sim.observers.add(log)
        with as_client("viewer"):
            sim.pull(DRAWER, point=(-0.25, 0.0, 0.0), target=(1.2, 0.0, 0.65))
        sim.release(DRAWER)
        (pull, release) = log.taken()
    assert pull[:3] == ("pull", "viewer", (DRAWER,))
    assert pull[3] == {"point": (-0.25, 0.0, 0.0), "target": (1.2, 0.0, 0.65)}
    assert release[:3] == ("release", "Python", (DRAWER,))


def test_several_edits_of_one_call_are_reported_in_their_order(sim: Simulation) -> None:
    log = Log()
    sim.observers.add(log)

    def edit(engine: Engine) -> None:
        for id in (MUG, DRAWER, MUG):
            engine.apply(SetPoses({id: Pose((float(len(id)), 0.0, 0.0))}))

    sim.engine.run(edit, edits=True)
    assert [(kind, client, ids) for kind, client, ids, _ in log.taken()] == [
        ("set poses", "Python", (MUG,)),
        ("set poses", "Python", (DRAWER,)),
        ("set poses", "Python", (MUG,)),
    ]


def test_a_spawn_names_what_was_spawned_and_what_was_not(sim: Simulation) -> None:
    sim.clear()
    log = Log()
    sim.observers.add(log)
    sim.spawn(kitchenette())
    ((kind, _, ids, details),) = log.taken()
    assert (kind, ids) == ("spawn", ALL)
    assert details["edit"].world == kitchenette()
    assert "failed" not in details
    world = kitchenette()
    sim.edits.delete([DRAWER, MUG])
    log.taken()
    sim.spawn(replace(world, joints=(), attachments=()))
    ((kind, _, ids, details),) = log.taken()
    assert (kind, ids) == ("spawn", (DRAWER, MUG))
    assert details["failed"] == sorted({*ALL} - {DRAWER, MUG})


def test_what_consists_of_several_edits_is_reported_as_one_with_all_bodies(sim: Simulation) -> None:
    log = Log()
    moved = SetPoses({MUG: Pose((1.0, 1.0, 1.0))})
    before = sim.snapshot().body(MUG).pose
    sim.edits.apply(moved)
    sim.observers.add(log)
    sim.edits.undo()
    sim.edits.redo()
    assert log.taken() == [
        ("undo", "Python", (MUG,), {"edits": [SetPoses({MUG: before}, {})]}),
        ("redo", "Python", (MUG,), {"edits": [moved]}),
    ]
    sim.clear()
    ((kind, _, ids, _),) = log.taken()
    assert (kind, ids) == ("clear", ALL)


def test_a_question_is_reported_with_its_arguments_and_all_answers(sim: Simulation) -> None:
    log = Log()
    sim.observers.add(log)
    with as_client("viewer"):
        answers = sim.ask("where_is", thing="Mug")
    ((kind, client, ids, details),) = log.taken()
    assert (kind, client, ids) == ("question", "viewer", ())
    assert (details["question"], details["count"]) == ("where_is", 2)
    assert details["args"] == {"thing": "http://example.org/maps/M.owl#Mug"}
    expected = [("on", "Cupboard"), ("above", "Floor")]
    assert [(row["relation"], row["other"].split("#")[-1]) for row in details["answers"]] == expected
    assert len(answers) == 2


def test_of_several_observers_only_the_one_that_was_removed_or_failed_gets_no_more(sim: Simulation) -> None:
    before, removed, failing, after = Log(), Log(), Failing(), Log()
    sim.observers.add(before)
    remove = sim.observers.add(removed)
    sim.observers.add(failing)
    sim.observers.add(after)

    def label(text: str) -> None:
        sim.engine.run(lambda engine: engine.apply(SetLabel(MUG, text)), edits=True)

    label("one")
    remove()
    remove()
    label("two")
    assert [len(each.taken()) for each in (before, removed, failing, after)] == [2, 1, 2, 2]
    sim.engine.run(lambda engine: engine.apply(SetPoses({MUG: Pose((1.0, 0.0, 1.0))})), edits=True)
    with pytest.raises(SimulationFaultError, match="the observer Failing raised ValueError: no"):
        sim.snapshot()
    label("three")
    kinds = [[kind for kind, *_ in each.taken()] for each in (before, removed, failing, after)]
    assert kinds == [["set poses", "set label"], [], ["set poses"], ["set poses", "set label"]]


def test_one_observer_that_is_added_twice_is_removed_entirely_and_others_stay(sim: Simulation) -> None:
    log, other = Log(), Log()
    remove = sim.observers.add(log)
    sim.observers.add(other)
    sim.observers.add(log)
    remove()
    sim.engine.run(lambda engine: engine.apply(SetLabel(MUG, "x")), edits=True)
    assert (len(log.taken()), len(other.taken())) == (0, 1)


def test_states_come_at_the_shortest_interval_and_say_whether_something_was_edited(sim: Simulation) -> None:
    slow, quick = Log(), Log()
    quick.interval_s = 0.05
    sim.observers.add(slow)
    sim.step(1.0)
    assert slow.times() == [pytest.approx(0.1 * count) for count in range(1, 11)]
    remove = sim.observers.add(quick)
    sim.step(1.0)
    assert quick.times() == [pytest.approx(1.0 + 0.05 * count) for count in range(1, 21)]
    assert not any(edited for _, edited in slow.states)
    remove()
    slow.states.clear()
    sim.step(1.0)
    assert slow.times() == [pytest.approx(2.0 + 0.1 * count) for count in range(1, 11)]
    sim.engine.run(lambda engine: engine.apply(SetLabel(MUG, "x")), edits=True)
    assert slow.states[-1] == (3.0, True)
    assert len(quick.times()) == 20


# -- clients -----------------------------------------------------------------------------------------------------------


def test_the_clients_of_all_sources_are_listed_until_their_source_is_removed(sim: Simulation) -> None:
    def clients(*names: str) -> Callable[[], list[ConnectedClient]]:
        return lambda: [ConnectedClient(name=name, transport="ROS") for name in names]

    def listed() -> list[str]:
        return [client.name for client in sim.clients.clients()]

    removes = [sim.clients.add_client_source(each) for each in (clients("a", "b"), clients(), clients("c"))]
    removes.append(sim.clients.add_client_source(clients("d")))
    assert listed() == ["a", "b", "c", "d"]
    removes[2]()
    assert listed() == ["a", "b", "d"]
    removes[2]()
    removes[0]()
    assert listed() == ["d"]


def test_of_several_callbacks_of_edits_only_the_removed_one_is_not_called(sim: Simulation) -> None:
    called: list[str] = []
    removes = [sim.clients.on_edit(lambda name=name: called.append(name)) for name in "abc"]
    removes[1]()
    sim.engine.run(lambda engine: engine.apply(SetLabel(MUG, "x")), edits=True)
    assert called == ["a", "c"]
