"""Many calls in flight: each gets its own true answer, in order, and what was answered is what stands."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest

from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.engines import NullEngine
from mindstage.engines.base import Applied
from mindstage.engines.mujoco import MujocoEngine, model_cache, model_files
from mindstage.knowledge import KnowledgeBase
from mindstage.ros import RosInterface
from mindstage.scene import BodyId
from mindstage.scene.edits import Edit, Spawn
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, RawClient, eventually
from tests.kitchenette import kitchenette

COUNT = 60


def model(id: str, number: int = 0, **fields: Any) -> dict[str, Any]:
    """A loose cube beside the kitchen."""
    position = {"x": 4.0 + 0.2 * (number % 10), "y": 0.2 * (number // 10), "z": 0.05}
    pose = {"position": position, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
    return {"id": id, "name": "Cube", "pose": pose, "physics_properties": {"mobility": 2, "mass": 0.1}, **fields}


def send(client: RawClient, service: str, number: int, args: dict[str, Any], **fields: Any) -> None:
    client.send_operation(op="call_service", id=number, service=f"/unreal/{service}", args=args, **fields)


def answers(client: RawClient, count: int) -> list[dict[str, Any]]:
    received = [client.receive("service_response") for _ in range(count)]
    assert [each["id"] for each in received] == list(range(count)), "the responses are out of order"
    return received


def succeeded(response: dict[str, Any]) -> bool:
    return bool(response["result"] and response["values"]["success"])


@pytest.fixture
def raw_client(server: RosbridgeServer, ros_interface: RosInterface) -> Iterator[RawClient]:
    with closing(RawClient(server.url)) as client:
        yield client


@pytest.fixture
def rebuilds(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The number of bodies of each model that is compiled."""
    counts: list[int] = []
    compile_model = model_cache.compile_model

    def counting(model_input: Any, **options: Any) -> Any:
        counts.append(len(model_input.bodies))
        return compile_model(model_input, **options)

    for module in (model_cache, model_files):  # one for models that are not stored, one for those that are
        monkeypatch.setattr(module, "compile_model", counting)
    return counts


@pytest.mark.parametrize("playing", [False, True], ids=["paused", "playing"])
def test_all_pipelined_spawns_succeed_in_order(raw_client: RawClient, simulation: Simulation, playing: bool) -> None:
    if playing:
        simulation.play()
    before = len(simulation.state.ids)
    for number in range(COUNT):
        send(raw_client, "spawn_model", number, model(f"cube{number}", number))
    assert all(map(succeeded, answers(raw_client, COUNT)))
    assert simulation.state.ids[before:] == tuple(f"cube{number}" for number in range(COUNT))


def test_one_bad_call_in_a_group_fails_alone(raw_client: RawClient, simulation: Simulation) -> None:
    before = len(simulation.state.ids)
    bad = {3: model("cube0"), 7: model("orphan", parent_id="ghost"), 9: model("flat")}
    bad[9]["pose"]["orientation"]["w"] = 0.0
    for number in range(12):
        send(raw_client, "spawn_model", number, bad.get(number) or model(f"cube{number}", number))
    received = answers(raw_client, 12)
    assert [number for number, each in enumerate(received) if not succeeded(each)] == [3, 7, 9]
    assert received[3]["values"]["etype"] == "1"
    assert len(simulation.state.ids) == before + 9


def test_pipelined_deletes_are_answered_truly(raw_client: RawClient, simulation: Simulation) -> None:
    simulation.spawn(kitchenette_with(COUNT))
    before = set(simulation.state.ids)
    ids = [f"cube{number}" for number in range(COUNT)]
    ids[10], ids[20] = "ghost", "cube0"  # one that never existed, and one that is deleted already
    for number, id in enumerate(ids):
        send(raw_client, "delete_model", number, {"id": id})
    received = answers(raw_client, COUNT)
    assert [number for number, each in enumerate(received) if not succeeded(each)] == [10, 20]
    deleted = {id for id, each in zip(ids, received, strict=True) if succeeded(each)}
    assert set(simulation.state.ids) == before - deleted


def kitchenette_with(count: int) -> Any:
    """Cubes as a world of their own."""
    from mindstage.bridge.conversions_unreal import world_from_request
    from mindstage.msgs import decode, world_control_msgs
    from mindstage.ros.state import map_iri

    models = [model(f"cube{number}", number) for number in range(count)]
    request = decode(world_control_msgs.SpawnSemanticMap.Request, {"models": models})
    return world_from_request(request, iri=map_iri("cubes"), name="cubes", taken=frozenset())[0]


def test_spawns_in_a_row_are_compiled_together(
    raw_client: RawClient, simulation: Simulation, rebuilds: list[int]
) -> None:
    simulation.play()
    simulation.step(0.01)
    rebuilds.clear()
    stood = len(simulation.state.ids)
    for number in range(COUNT):
        send(raw_client, "spawn_model", number, model(f"cube{number}", number))
    assert all(map(succeeded, answers(raw_client, COUNT)))
    simulation.step(0.01)
    assert rebuilds[-1] == stood + COUNT
    assert len(rebuilds) < COUNT / 4


def test_reading_a_spawned_world_does_not_compile_it(simulation: Simulation, rebuilds: list[int]) -> None:
    rebuilds.clear()
    simulation.spawn(kitchenette_with(3))
    assert [body.id for body in simulation.snapshot().bodies][-3:] == ["cube0", "cube1", "cube2"]
    assert simulation.state.poses.shape == (len(simulation.state.ids), 7)
    assert rebuilds == []


def test_undo_of_spawns_in_a_row_is_per_call(simulation: Simulation) -> None:
    before = simulation.state.ids
    for number in range(5):
        world = kitchenette_with(5)
        one = type(world)(iri=world.iri, bodies=(world.bodies[number],))
        simulation.spawn(one, persistent=False, title=f"cube{number} added")
    for number in reversed(range(5)):
        assert simulation.edits.undo() == f"cube{number} added"
        assert simulation.state.ids == (*before, *(f"cube{each}" for each in range(number)))
    assert simulation.edits.redo() == "cube0 added"
    assert simulation.state.ids == (*before, "cube0")


def test_reset_restores_the_state_after_the_last_of_several_spawns(simulation: Simulation) -> None:
    cubes = kitchenette_with(3)
    for cube in cubes.bodies:
        simulation.spawn(type(cubes)(iri=cubes.iri, bodies=(cube,)))
    ids = simulation.state.ids
    simulation.step(0.5)
    simulation.spawn(kitchenette_with(5), persistent=False)
    simulation.reset()
    assert simulation.state.ids == ids
    assert [body.pose for body in simulation.snapshot().bodies[-3:]] == [cube.pose for cube in cubes.bodies]


class HeldEngine(NullEngine):
    """An engine whose spawn of the body "held" blocks until the test allows it to end."""

    def __init__(self) -> None:
        super().__init__()
        self.begun, self.may_end = threading.Event(), threading.Event()
        self.spawned: list[int] = []
        """Number of bodies of each spawn."""

    def apply(self, edit: Edit) -> Applied:
        if isinstance(edit, Spawn):
            self.spawned.append(len(edit.ids))
        if isinstance(edit, Spawn) and "held" in edit.ids:
            self.begun.set()
            assert self.may_end.wait(TIMEOUT_S)
        return super().apply(edit)


@pytest.fixture
def held(knowledge: KnowledgeBase) -> Iterator[tuple[HeldEngine, Simulation, str]]:
    engine = HeldEngine()
    with (
        Simulation(knowledge, engine, timeout_s=TIMEOUT_S) as simulation,
        LocalNode() as node,
        RosbridgeServer(node, port=0) as server,
        RosInterface(simulation, node),
    ):
        simulation.spawn(kitchenette())
        yield engine, simulation, server.url
        engine.may_end.set()


def test_a_reader_goes_on_while_a_spawn_is_held(held: tuple[HeldEngine, Simulation, str]) -> None:
    engine, _, url = held
    with closing(RawClient(url)) as writer, closing(RawClient(url)) as reader:
        send(writer, "spawn_model", 0, model("held"))
        assert engine.begun.wait(TIMEOUT_S)
        for _ in range(20):
            assert reader.call_service("/unreal/get_model_pose", {"id": "Mug"})["values"]["success"] is True
        assert not engine.may_end.is_set()
        engine.may_end.set()
        assert succeeded(answers(writer, 1)[0])


def test_spawns_that_wait_become_few_edits_with_an_answer_each(held: tuple[HeldEngine, Simulation, str]) -> None:
    engine, simulation, url = held
    before = simulation.state.ids
    unnamed = model("")
    waiting = [
        *(model(f"cube{number}", number) for number in range(5)),
        model("cube2"),  # an id that is taken by then
        {"id": 5},  # no valid request
        unnamed,
        unnamed,
        model("child", parent_id="cube4"),
        model("orphan", parent_id="ghost"),
        model("last", 9),
    ]
    with closing(RawClient(url)) as client:
        send(client, "spawn_model", 100, model("held"))
        assert engine.begun.wait(TIMEOUT_S)
        engine.spawned.clear()
        for number, args in enumerate(waiting):
            send(client, "spawn_model", number, args)
        send(client, "get_model_pose", len(waiting), {"id": "last"})
        client.flush()
        engine.may_end.set()
        assert succeeded(client.receive("service_response", id=100))
        *received, pose = answers(client, len(waiting) + 1)
    assert [number for number, each in enumerate(received) if not succeeded(each)] == [5, 6, 10]
    assert received[5]["values"]["etype"] == "1"
    assert "ghost" in str(received[10]["values"]) or not received[10]["values"]["success"]
    assert succeeded(pose)
    ids = [received[number]["values"]["id"] for number in (0, 1, 2, 3, 4, 7, 8, 9, 11)]
    assert simulation.state.ids == (*before, BodyId("held"), *ids)
    assert len(set(ids)) == len(ids)
    assert engine.spawned == [5, 4], "the second begins with what depends on the first"
    assert [(each.parent, each.child) for each in simulation.snapshot().attachments][-1] == ("cube4", "child")


@pytest.mark.parametrize("service", ["spawn_model", "delete_model"])
def test_what_timed_out_at_a_stuck_engine_never_happens(held: tuple[HeldEngine, Simulation, str], service: str) -> None:
    engine, simulation, url = held
    ids = simulation.state.ids
    with closing(RawClient(url)) as client:
        send(client, "spawn_model", 100, model("held"), timeout=2.0)
        assert engine.begun.wait(TIMEOUT_S)
        for number in range(20):
            args = model(f"cube{number}") if service == "spawn_model" else {"id": ids[number % len(ids)]}
            send(client, service, number, args, timeout=2.5)  # the first one's time ends before
        late = answers(client, 20)
        assert not any(each["result"] for each in late)
        assert all("it was withdrawn" in each["values"] for each in late)
        engine.may_end.set()
        assert succeeded(client.receive("service_response", id=100)), "what began reports its end"
        client.call_service("/unreal/mindstage/describe")
    assert simulation.state.ids == (*ids, BodyId("held"))


def test_a_client_that_leaves_with_calls_queued_takes_them_along(held: tuple[HeldEngine, Simulation, str]) -> None:
    engine, simulation, url = held
    ids = simulation.state.ids
    with closing(RawClient(url)) as stays:
        with closing(RawClient(url)) as leaves:
            send(leaves, "spawn_model", 0, model("held"))
            assert engine.begun.wait(TIMEOUT_S)
            for number in range(1, 10):
                send(leaves, "spawn_model", number, model(f"cube{number}"))
        eventually(lambda: len(simulation.clients.clients()) == 1)
        engine.may_end.set()
        stays.call_service("/unreal/mindstage/describe")
    assert set(simulation.state.ids) - set(ids) == {"held"}


def test_moving_bodies_keep_their_state_through_edits_in_a_row(knowledge: KnowledgeBase) -> None:
    """Each spawn alone and all at once lead to the same motion of what was there."""

    def run(batches: list[int]) -> Any:
        with Simulation(knowledge, MujocoEngine()) as simulation:
            simulation.spawn(kitchenette())
            simulation.step(0.2)
            cubes, start = kitchenette_with(sum(batches)), 0
            for count in batches:
                simulation.spawn(type(cubes)(iri=cubes.iri, bodies=cubes.bodies[start : start + count]))
                start += count
            simulation.step(0.2)
            return simulation.state

    single, whole = run([1] * 6), run([6])
    assert single.ids == whole.ids
    assert single.poses.tobytes() == whole.poses.tobytes()
