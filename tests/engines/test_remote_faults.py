"""A far engine that is killed, cut off, late or mad: the right outcome within the timeout, and then it works."""

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

from mindstage.engines import Engine, NullEngine, RemoteEngine, connect
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
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, eventually
from tests.engines.far_side import ServedSimulation
from tests.engines.odd_far_side import (
    DESCRIBE_VALUES,
    NO_REFUSAL,
    REPORT,
    FakeRemote,
    failed,
    ok_response,
    poses,
    response,
)
from tests.engines.scenes import FLOOR, room, world

ROOT = Path(__file__).resolve().parents[2]


@contextmanager
def far_process(*args: object) -> Iterator[tuple[subprocess.Popen[str], str]]:
    command = [sys.executable, "-m", "tests.engines.slow_far_side", *map(str, args)]
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
def odd() -> Iterator[FakeRemote]:
    with FakeRemote() as odd:
        yield odd


@pytest.fixture
def odd_engine(odd: FakeRemote) -> Iterator[RemoteEngine]:
    with closing(connect(odd.address, timeout_s=TIMEOUT_S)) as engine:
        yield engine


# -- it is gone --------------------------------------------------------------------------------------------------------


def test_a_far_engine_that_is_killed_in_the_middle_of_a_spawn_is_lost_at_once_and_then_works_again() -> None:
    with far_process("--stuck") as (process, address), ThreadPoolExecutor(1) as other:
        engine = connect(address, timeout_s=600.0)
        spawning = other.submit(engine.spawn, room())
        assert process.stdout is not None
        assert process.stdout.readline() == "spawning\n"
        process.kill()
        with pytest.raises(EngineUnavailableError, match="no connection"):
            spawning.result(TIMEOUT_S)
        with pytest.raises(EngineUnavailableError):
            engine.ping()
    with closing(engine), far_process(address.rpartition(":")[2].partition("/")[0]):
        eventually(lambda: answers(engine))
        with pytest.raises(EngineUnavailableError, match="started anew since, and the world that it ran is gone"):
            engine.snapshot()
        assert engine.spawn(room()).ok
        assert diff(room(), engine.snapshot()).identical(0.0)


def answers(engine: RemoteEngine) -> bool:
    try:
        return engine.ping() >= 0.0
    except EngineUnavailableError:
        return False


def cut(far_side: ServedSimulation) -> None:
    """Cuts every socket without a word."""
    for client in list(far_side.server._clients):
        far_side.hub._loop.call(client.connection.abort, "it was cut")


def is_noticed(link: ServiceClient, meetings: int) -> bool:
    """Whether a loss is, or was, since so many meetings."""
    return link.connection_count > meetings or not link._transport.connected


def test_a_cut_socket_is_mended_before_the_next_call_and_the_world_is_still_there() -> None:
    with ServedSimulation(NullEngine) as far_side, closing(connect(far_side.address)) as engine:
        engine.spawn(room())
        state = engine.save_state()
        for meetings in (1, 2, 3):
            cut(far_side)
            eventually(partial(is_noticed, engine._client, meetings))
            assert diff(room(), engine.snapshot()).identical(0.0)
        engine.delete([BodyId("mug")])
        engine.restore_state(state)
        assert "mug" in engine.poses()[0]


class Blocked(NullEngine):
    """Steps only when it is let go."""

    def __init__(self) -> None:
        super().__init__()
        self.stepping, self.go = threading.Event(), threading.Event()

    def step(self, duration_s: float) -> None:
        self.stepping.set()
        assert self.go.wait(TIMEOUT_S)
        super().step(duration_s)


def test_a_socket_that_is_cut_during_a_call_ends_that_call_and_no_other() -> None:
    blocked = Blocked()
    with (
        ServedSimulation(lambda: blocked) as far_side,
        closing(connect(far_side.address, timeout_s=600.0)) as engine,
        ThreadPoolExecutor(1) as other,
    ):
        stepping = other.submit(engine.step, 1.0)
        assert blocked.stepping.wait(TIMEOUT_S)
        cut(far_side)
        with pytest.raises(EngineUnavailableError):
            stepping.result(TIMEOUT_S)
        blocked.go.set()
        assert engine.poses()[0] == ()
        assert engine.time_s == 1.0  # it was done all the same, and the next call tells


def test_saved_states_go_with_the_world_they_were_of() -> None:
    with ServedSimulation(NullEngine) as far_side, closing(connect(far_side.address)) as engine:
        engine.spawn(room())
        state = engine.save_state()
        far_side.stop()
        far_side.start()
        eventually(lambda: answers(engine))
        engine.clear()
        with pytest.raises(EngineUnavailableError, match="the state went with its world"):
            engine.restore_state(state)
        engine.save_state()
        assert engine.spawn(room()).ok


def test_a_stage_on_a_far_engine_tells_of_its_loss_and_goes_on_when_it_is_back() -> None:
    with ServedSimulation(NullEngine) as far_side, KnowledgeBase() as knowledge:
        engine = connect(far_side.address)
        with Simulation(knowledge, engine, timeout_s=TIMEOUT_S) as stage:
            assert stage.spawn(room()).ok
            stage.play()
            eventually(lambda: stage.state.time_s > 0.05)
            far_side.stop()
            eventually(lambda: stage.engine_error is not None)
            assert "no connection" in stage.state.error
            with pytest.raises(EngineError):
                stage.ping()
            far_side.start()
            eventually(lambda: answers(engine))
            assert stage.spawn(room()).ok
            assert stage.engine_error is None
            assert diff(room(), stage.snapshot()).identical(0.0)


# -- it is slow --------------------------------------------------------------------------------------------------------


@contextmanager
def in_a_hurry(engine: RemoteEngine) -> Iterator[None]:
    """Calls have but a moment meanwhile; to meet has taken as long as it took."""
    usual_s, engine._client.timeout_s = engine._client.timeout_s, 0.2
    try:
        yield
    finally:
        engine._client.timeout_s = usual_s


def test_a_late_answer_is_a_timeout_and_the_next_call_gets_its_own() -> None:
    blocked = Blocked()
    with ServedSimulation(lambda: blocked) as far_side, closing(connect(far_side.address)) as engine:
        late = r"did not answer .*/step within 0\.2 s; it may have been executed"
        with in_a_hurry(engine), pytest.raises(EngineTimeoutError, match=late):
            engine.step(0.0)
        blocked.go.set()
        assert engine.spawn(room()).ok
        assert len(engine.poses()[0]) == len(room().bodies)


def test_a_far_stage_that_is_busy_says_so_as_an_error_of_the_engine() -> None:
    blocked = Blocked()
    with ServedSimulation(lambda: blocked) as far_side, closing(connect(far_side.address)) as engine:
        far_side.stage.timeout_s = 0.1
        with pytest.raises(EngineError, match=r"ros://.* failed: step did not finish within 0\.1 s") as told:
            engine.step(0.0)
        assert not isinstance(told.value, EngineTimeoutError)
        blocked.go.set()
        far_side.stage.timeout_s = TIMEOUT_S
        engine.step(0.5)
        assert engine.time_s == 0.5


# -- it answers twice, or nonsense -------------------------------------------------------------------------------------


def test_the_second_of_two_answers_does_no_harm(odd: FakeRemote, odd_engine: RemoteEngine) -> None:
    for name in ("a", "b", "c"):
        told = {
            "success": True,
            "refusal": NO_REFUSAL,
            "time_s": 0.0,
            "ids": [name],
            "poses": list(poses(name)),
            "revision": 1,
            "rows": "",
        }
        odd.respond["get_poses"] = lambda call, told=told: [response(call, told), response(call, {"ids": ["never"]})]
        assert odd_engine.poses()[0] == (name,)


NONSENSE: dict[str, tuple[str, Callable[[RemoteEngine], object], Any]] = {
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
        lambda engine: engine.spawn(world(FLOOR)),
        ok_response(report={**REPORT, "notes": [{"kind": "mood", "ids": [], "text": ""}]}),
    ),
    "more colours than bodies": (
        "get_highlights",
        lambda engine: engine.highlights(),
        ok_response(ids=["a"], colors=[]),
    ),
}


@pytest.mark.parametrize("what", NONSENSE)
def test_nonsense_is_an_error_of_the_engine_and_the_next_call_works(
    what: str, odd: FakeRemote, odd_engine: RemoteEngine
) -> None:
    service, call, behave = NONSENSE[what]
    usual = dict(odd.respond)
    odd.respond[service] = behave
    with pytest.raises(EngineUnavailableError, match=f"{service} answered makes no sense"):
        call(odd_engine)
    odd.respond = usual
    assert odd_engine.poses()[0] == ()


def test_frames_that_are_no_json_are_no_answer(odd: FakeRemote) -> None:
    odd.respond["get_poses"] = lambda call: ["no JSON", b"\xff", "[]", '{"op":"zip"}', '{"op":"service_response"}']
    with closing(connect(odd.address)) as engine:
        with in_a_hurry(engine), pytest.raises(EngineTimeoutError):
            engine.poses()
        odd.respond["get_poses"] = ok_response(time_s=0.0, ids=[], poses=[], revision=0, rows="")
        assert engine.poses()[0] == ()


def test_a_no_without_a_reason_is_a_no_of_the_world(odd: FakeRemote, odd_engine: RemoteEngine) -> None:
    odd.respond["clear"] = ok_response(success=False)
    with pytest.raises(WorldError, match="does not say why"):
        odd_engine.clear()
    odd.respond["clear"] = ok_response(
        success=False, refusal={**NO_REFUSAL, "kind": "GravityOffended", "text": "not on Sundays"}
    )
    with pytest.raises(WorldError, match="not on Sundays"):
        odd_engine.clear()


def test_abilities_that_are_not_known_here_are_none(odd_engine: RemoteEngine) -> None:
    assert odd_engine.capabilities == frozenset()


def test_worlds_of_another_format_are_refused_when_one_meets(odd: FakeRemote) -> None:
    odd.respond["describe"] = lambda call: [response(call, DESCRIBE_VALUES | {"format_version": 2})]
    with pytest.raises(
        EngineUnavailableError, match="worlds of the format 2, and this Mindstage writes 1; use the same"
    ):
        connect(odd.address)


def test_a_peer_that_fails_to_describe_itself_is_not_taken_for_another(odd: FakeRemote) -> None:
    odd.respond["describe"] = failed("out of order")
    with pytest.raises(EngineError, match="failed: out of order"):
        connect(odd.address)
    assert "get_model_pose" not in odd.calls


# -- it breaks over there ----------------------------------------------------------------------------------------------


class Breaking(NullEngine):
    """Breaks in every way that there is."""

    error: Exception = ZeroDivisionError("an unforeseen thing")

    def step(self, duration_s: float) -> None:
        raise self.error


@pytest.mark.parametrize(
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
def test_what_breaks_there_is_told_here_and_the_world_goes_on(error: Exception, comes_as: type[EngineError]) -> None:
    breaking = Breaking()
    breaking.error = error
    with ServedSimulation(lambda: breaking) as far_side, closing(connect(far_side.address)) as engine:
        engine.spawn(room())
        with pytest.raises(EngineError, match=str(error)) as told:
            engine.step(0.1)
        assert type(told.value) is comes_as
        assert diff(room(), engine.snapshot()).identical(0.0)


def test_nothing_is_left_behind() -> None:
    before = set(threading.enumerate())

    def left() -> list[str]:
        return [thread.name for thread in set(threading.enumerate()) - before if thread.name.startswith("mindstage")]

    with ServedSimulation(NullEngine) as far_side:
        engines: list[Engine] = [connect(far_side.address) for _ in range(3)]
        for engine in engines:
            engine.close()
        for address in (f"{far_side.address}/elsewhere", "ros://127.0.0.1:1/unreal"):
            with pytest.raises(EngineUnavailableError):
                connect(address, timeout_s=0.3)
    eventually(lambda: not left())
