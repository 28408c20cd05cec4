"""Remote engines that crash, disconnect, delay or send invalid responses: the right error in time, and recovery."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from mindstage.engines import Engine, NullEngine
from mindstage.engines.remote import RemoteEngine, connect
from mindstage.engines.remote.client import ServiceClient
from mindstage.errors import (
    EngineClosedError,
    EngineError,
    EngineTimeoutError,
    EngineUnavailableError,
    SimulationDivergedError,
    SimulationTimeoutError,
    WorldError,
)
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyId, diff
from mindstage.scene.edits import Delete, Spawn
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, eventually
from tests.cases import each_case
from tests.engines.remote.fake_remote import (
    DESCRIBE_VALUES,
    NO_REFUSAL,
    REPORT,
    FakeRemote,
    failed,
    ok_response,
    poses,
    response,
)
from tests.engines.remote.served_simulation import ServedSimulation
from tests.engines.scenes import FLOOR, room, world

ROOT = Path(__file__).resolve().parents[3]


@contextmanager
def server_process(*args: object) -> Iterator[tuple[subprocess.Popen[str], str]]:
    command = [sys.executable, "-m", "tests.engines.remote.stuck_server", *map(str, args)]
    process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        assert address.startswith("ros://")
        yield process, address
    finally:
        process.kill()
        process.communicate(timeout=TIMEOUT_S)


@pytest.fixture
def fake() -> Iterator[FakeRemote]:
    with FakeRemote() as fake:
        yield fake


@pytest.fixture
def fake_engine(fake: FakeRemote) -> Iterator[RemoteEngine]:
    with closing(connect(fake.address, timeout_s=TIMEOUT_S)) as engine:
        yield engine


# -- disconnections ----------------------------------------------------------------------------------------------------


def test_an_engine_killed_during_a_spawn_is_reported_at_once_and_usable_after_a_restart() -> None:
    with server_process("--stuck") as (process, address), ThreadPoolExecutor(1) as other:
        engine = connect(address, timeout_s=600.0)
        spawning = other.submit(engine.apply, Spawn(room()))
        assert process.stdout is not None
        assert process.stdout.readline() == "spawning\n"
        process.kill()
        with pytest.raises(EngineUnavailableError, match="no connection"):
            spawning.result(TIMEOUT_S)
        with pytest.raises(EngineUnavailableError):
            engine.ping()
    with closing(engine), server_process(address.rpartition(":")[2].partition("/")[0]):
        eventually(lambda: answers(engine))
        with pytest.raises(EngineUnavailableError, match="it was restarted, and its world is lost"):
            engine.snapshot()
        assert engine.apply(Spawn(room())).report.ok
        assert diff(room(), engine.snapshot()).identical(0.0)


def answers(engine: RemoteEngine) -> bool:
    try:
        return engine.ping() >= 0.0
    except EngineUnavailableError:
        return False


def abort_connections(served: ServedSimulation) -> None:
    """Aborts every connection."""
    for client in list(served.server._clients):
        served.hub._loop.call(client.connection.abort, "aborted by the test")


def is_noticed(client: ServiceClient, connection_count: int) -> bool:
    """Whether a loss was noticed since a number of connections."""
    return client.connection_count > connection_count or not client._transport.connected


def test_a_broken_connection_is_restored_before_the_next_call_and_the_world_is_kept() -> None:
    with ServedSimulation(NullEngine) as served, closing(connect(served.address)) as engine:
        engine.apply(Spawn(room()))
        state = engine.save_state()
        for connection_count in (1, 2, 3):
            abort_connections(served)
            eventually(partial(is_noticed, engine._client, connection_count))
            assert diff(room(), engine.snapshot()).identical(0.0)
        engine.apply(Delete((BodyId("mug"),)))
        engine.restore_state(state)
        assert "mug" in engine.poses()[0]


class Blocked(NullEngine):
    """An engine whose `step` waits for an event."""

    def __init__(self) -> None:
        super().__init__()
        self.stepping, self.go = threading.Event(), threading.Event()

    def step(self, duration_s: float) -> None:
        self.stepping.set()
        assert self.go.wait(TIMEOUT_S)
        super().step(duration_s)


def test_a_connection_broken_during_a_call_fails_only_that_call() -> None:
    blocked = Blocked()
    with (
        ServedSimulation(lambda: blocked) as served,
        closing(connect(served.address, timeout_s=600.0)) as engine,
        ThreadPoolExecutor(1) as other,
    ):
        stepping = other.submit(engine.step, 1.0)
        assert blocked.stepping.wait(TIMEOUT_S)
        abort_connections(served)
        with pytest.raises(EngineUnavailableError):
            stepping.result(TIMEOUT_S)
        blocked.go.set()
        assert engine.poses()[0] == ()
        assert engine.time_s == 1.0  # the step was executed all the same, as the next call shows


def test_saved_states_are_lost_with_their_world() -> None:
    with ServedSimulation(NullEngine) as served, closing(connect(served.address)) as engine:
        engine.apply(Spawn(room()))
        state = engine.save_state()
        served.stop()
        served.start()
        eventually(lambda: answers(engine))
        engine.clear()
        with pytest.raises(EngineUnavailableError, match="its saved states are lost"):
            engine.restore_state(state)
        engine.save_state()
        assert engine.apply(Spawn(room())).report.ok


def test_a_simulation_reports_the_loss_of_its_engine_and_continues_after_it_is_restored() -> None:
    with ServedSimulation(NullEngine) as served, KnowledgeBase() as knowledge:
        engine = connect(served.address)
        with Simulation(knowledge, engine, timeout_s=TIMEOUT_S) as simulation:
            assert simulation.spawn(room()).ok
            simulation.play()
            eventually(lambda: simulation.state.time_s > 0.05)
            served.stop()
            eventually(lambda: simulation.engine.error is not None)
            assert "no connection" in simulation.state.error
            with pytest.raises(EngineError):
                simulation.engine.ping()
            served.start()
            eventually(lambda: answers(engine))
            assert simulation.spawn(room()).ok
            assert simulation.engine.error is None
            assert diff(room(), simulation.snapshot()).identical(0.0)


# -- delays ------------------------------------------------------------------------------------------------------------


@contextmanager
def short_timeout(engine: RemoteEngine) -> Iterator[None]:
    """Shortens the timeout of calls, after connecting with the usual one."""
    usual_s, engine._client.timeout_s = engine._client.timeout_s, 0.2
    try:
        yield
    finally:
        engine._client.timeout_s = usual_s


def test_a_late_response_is_a_timeout_and_is_not_taken_for_the_next() -> None:
    blocked = Blocked()
    with ServedSimulation(lambda: blocked) as served, closing(connect(served.address)) as engine:
        late = r"did not answer .*/step within 0\.2 s; it may have been executed"
        with short_timeout(engine), pytest.raises(EngineTimeoutError, match=late):
            engine.step(0.0)
        blocked.go.set()
        assert engine.apply(Spawn(room())).report.ok
        assert len(engine.poses()[0]) == len(room().bodies)


def test_a_busy_remote_simulation_is_an_engine_error() -> None:
    blocked = Blocked()
    with ServedSimulation(lambda: blocked) as served, closing(connect(served.address)) as engine:
        served.simulation.timeout_s = 0.1
        with pytest.raises(EngineError, match=r"ros://.* failed: step did not finish within 0\.1 s") as message:
            engine.step(0.0)
        assert not isinstance(message.value, EngineTimeoutError)
        blocked.go.set()
        served.simulation.timeout_s = TIMEOUT_S
        engine.step(0.5)
        assert engine.time_s == 0.5


# -- duplicate and invalid responses -----------------------------------------------------------------------------------


def test_a_duplicate_response_is_ignored(fake: FakeRemote, fake_engine: RemoteEngine) -> None:
    for name in ("a", "b", "c"):
        message = {
            "success": True,
            "refusal": NO_REFUSAL,
            "time_s": 0.0,
            "ids": [name],
            "poses": list(poses(name)),
            "revision": 1,
            "rows": "",
        }
        fake.respond["get_poses"] = lambda call, message=message: [
            response(call, message),
            response(call, {"ids": ["never"]}),
        ]
        assert fake_engine.poses()[0] == (name,)


INVALID_RESPONSES: dict[str, tuple[str, Callable[[RemoteEngine], object], Any]] = {
    "nothing in it": ("get_poses", lambda engine: engine.poses(), lambda call: [response(call, {})]),
    "no object": ("get_poses", lambda engine: engine.poses(), lambda call: [response(call, [1, 2])]),
    "more ids than poses": (
        "get_poses",
        lambda engine: engine.poses(),
        ok_response(time_s=0.0, ids=["a"], poses=[], revision=1, rows=""),
    ),
    "ids that are none": (
        "get_poses",
        lambda engine: engine.poses(),
        ok_response(time_s=0.0, ids=7, poses=[], revision=1, rows=""),
    ),
    "no world": ("log_world", lambda engine: engine.snapshot(), ok_response(world="no JSON")),
    "another world": ("log_world", lambda engine: engine.snapshot(), ok_response(world='{"format_version": 99}')),
    "a note of no kind": (
        "spawn_world",
        lambda engine: engine.apply(Spawn(world(FLOOR))).report,
        ok_response(report={**REPORT, "notes": [{"kind": "mood", "ids": [], "text": ""}]}),
    ),
    "more colors than bodies": (
        "get_highlights",
        lambda engine: engine.highlights(),
        ok_response(ids=["a"], colors=[]),
    ),
}


@pytest.mark.parametrize("case", INVALID_RESPONSES)
def test_an_invalid_response_is_an_engine_error_and_the_next_call_works(
    case: str, fake: FakeRemote, fake_engine: RemoteEngine
) -> None:
    service, call, behave = INVALID_RESPONSES[case]
    usual = dict(fake.respond)
    fake.respond[service] = behave
    with pytest.raises(EngineUnavailableError, match=rf"the response of \S*{service} is invalid"):
        call(fake_engine)
    fake.respond = usual
    assert fake_engine.poses()[0] == ()


def test_messages_that_are_not_json_are_no_response(fake: FakeRemote) -> None:
    fake.respond["get_poses"] = lambda call: ["no JSON", b"\xff", "[]", '{"op":"zip"}', '{"op":"service_response"}']
    with closing(connect(fake.address)) as engine:
        with short_timeout(engine), pytest.raises(EngineTimeoutError):
            engine.poses()
        fake.respond["get_poses"] = ok_response(time_s=0.0, ids=[], poses=[], revision=0, rows="")
        assert engine.poses()[0] == ()


def test_a_failure_without_a_reason_is_a_world_error(fake: FakeRemote, fake_engine: RemoteEngine) -> None:
    fake.respond["clear"] = ok_response(success=False, expected_rebuild_s=0.0)
    with pytest.raises(WorldError, match="without a reason"):
        fake_engine.clear()
    fake.respond["clear"] = ok_response(
        success=False,
        refusal={**NO_REFUSAL, "code": "GravityOffended", "text": "not on Sundays"},
        expected_rebuild_s=0.0,
    )
    with pytest.raises(WorldError, match="not on Sundays"):
        fake_engine.clear()


def test_unknown_capabilities_are_ignored(fake_engine: RemoteEngine) -> None:
    assert fake_engine.capabilities == frozenset()


def test_another_world_format_is_refused_on_connection(fake: FakeRemote) -> None:
    fake.respond["describe"] = lambda call: [response(call, DESCRIBE_VALUES | {"format_version": 1})]
    with pytest.raises(EngineUnavailableError, match="its world format is 1, and this Mindstage's is 2; use the same"):
        connect(fake.address)


def test_a_peer_whose_description_fails_is_not_taken_for_unreal(fake: FakeRemote) -> None:
    fake.respond["describe"] = failed("out of order")
    with pytest.raises(EngineError, match="failed: out of order"):
        connect(fake.address)
    assert "get_model_pose" not in fake.calls


# -- errors of the remote engine ---------------------------------------------------------------------------------------


class Breaking(NullEngine):
    """An engine that fails in all possible ways."""

    error: Exception = ZeroDivisionError("an unforeseen thing")

    def step(self, duration_s: float) -> None:
        raise self.error


@each_case(
    ("error", "comes_as"),
    [
        (SimulationDivergedError(time_s=1.25, what="velocities"), SimulationDivergedError),
        (EngineClosedError("null"), EngineClosedError),
        (EngineUnavailableError("null", cause="it fell off the table"), EngineUnavailableError),
        (SimulationTimeoutError("step", timeout_s=3.0), EngineError),
        (ZeroDivisionError("an unforeseen thing"), EngineError),
    ],
    ids=lambda value: getattr(value, "__name__", type(value).__name__),
)
def test_a_remote_engine_error_is_reported_and_the_world_continues(
    error: Exception, comes_as: type[EngineError]
) -> None:
    breaking = Breaking()
    breaking.error = error
    with ServedSimulation(lambda: breaking) as served, closing(connect(served.address)) as engine:
        engine.apply(Spawn(room()))
        with pytest.raises(EngineError, match=str(error)) as message:
            engine.step(0.1)
        assert type(message.value) is comes_as
        assert diff(room(), engine.snapshot()).identical(0.0)


def test_closing_leaves_no_threads_or_states() -> None:
    before = set(threading.enumerate())

    def remaining_threads() -> list[str]:
        return [thread.name for thread in set(threading.enumerate()) - before if thread.name.startswith("mindstage")]

    with ServedSimulation(NullEngine) as served:
        engines: list[Engine] = [connect(served.address) for _ in range(3)]
        for engine in engines:
            engine.close()
        for address in (f"{served.address}/elsewhere", "ros://127.0.0.1:1/unreal"):
            with pytest.raises(EngineUnavailableError):
                connect(address, timeout_s=0.3)
    eventually(lambda: not remaining_threads())
