"""Questions of ports, which processes answer: as in the process of the simulation, in turns, and with an end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

import mindstage as ms
from mindstage.access.limits import QUESTION_STATEMENTS
from mindstage.episodes import Recorder
from mindstage.episodes.episode import Episode
from mindstage.errors import MindstageError, QuestionProcessError, QuestionTimeoutError, RequestLimitError
from mindstage.knowledge.queries import answers_to_builtins, list_questions
from mindstage.scene import Pose
from mindstage.simulation import Simulation, question_pool
from mindstage.simulation.question_pool import QuestionPool

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no fork")

TIMEOUT_S = 60.0
QUESTIONS: tuple[tuple[str, dict[str, object]], ...] = (
    ("where_is", {}),
    ("where is the milk?", {}),
    ("where_is", {"thing": "milk_carton_1"}),
    ("pose_of", {}),
    ("articulated_parts", {}),
    ("articulated_parts", {"state": "open"}),
    ("path", {"start": "fridge", "goal": "table"}),
    ("nearest", {"thing": "fridge", "count": 3}),
    ("visible_from", {"viewer": "fridge"}),
    ("how_many", {"cls": "Cup"}),
    ("misplaced", {}),
    ("storage_place", {"item": "Door"}),
    ("storage_place_in_environment", {"item": "CowsMilk"}),
    ("fits", {"thing": "milk_carton_1"}),
    ("what_is", {"individual": "nobody"}),
    ("where_is", {"relation": "nowhere"}),
)


@contextmanager
def running(simulation: Simulation, **options: Any) -> Iterator[QuestionPool]:
    """A pool whose processes run."""
    pool = QuestionPool(simulation, **options)
    try:
        start(pool)
        yield pool
    finally:
        pool.close()


def start(pool: QuestionPool) -> None:
    pool.submit("maps", {}, client="start").result.result(TIMEOUT_S)
    pool.start_processes()
    until(lambda: pool.has_processes)


def until(condition: Callable[[], bool]) -> None:
    end_s = time.monotonic() + TIMEOUT_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.02)


def is_running(pid: int) -> bool:
    """Whether a process exists, and has not ended."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return text.rpartition(")")[2].split()[0] != "Z"


def in_pool(pool: QuestionPool, question: str, args: Mapping[str, object]) -> Any:
    """The answers, or the text of the error."""
    try:
        assert pool.accepts(question, args)
        return json.loads(pool.submit(question, args, client="test").result.result(TIMEOUT_S).json)
    except MindstageError as error:
        return str(error)


def in_simulation(simulation: Simulation, question: str, args: Mapping[str, object]) -> Any:
    try:
        answers = answers_to_builtins(simulation.knowledge, simulation.ask(question, **args))
    except MindstageError as error:
        return str(error)
    return json.loads(msgspec.json.encode(answers))


def assert_same(simulation: Simulation, pool: QuestionPool) -> None:
    for question, args in QUESTIONS:
        assert in_pool(pool, question, args) == in_simulation(simulation, question, args), (question, args)
    assert pool.process_ids


@pytest.fixture(scope="module")
def kitchen() -> Iterator[Simulation]:
    with ms.open("bundled:kitchen") as simulation:
        simulation.step(0.1)
        yield simulation


@pytest.fixture(scope="module")
def pool(kitchen: Simulation) -> Iterator[QuestionPool]:
    with running(kitchen) as pool:
        yield pool


def test_every_question_has_the_same_answers_as_in_the_simulation(kitchen: Simulation, pool: QuestionPool) -> None:
    asked = 0
    for question in list_questions():
        if pool.accepts(question.name, {}):
            assert in_pool(pool, question.name, {}) == in_simulation(kitchen, question.name, {}), question.name
            asked += 1
    assert asked > 30
    assert_same(kitchen, pool)


def test_questions_that_imagine_or_are_about_the_past_are_not_accepted(pool: QuestionPool) -> None:
    assert not pool.accepts("stays", {"thing": "milk_carton_1"})
    assert not pool.accepts("last_seen", {"thing": "milk_carton_1"})
    assert not pool.accepts("where_is", {"at": 1.0})
    assert pool.accepts("where_is", {})


def test_answers_follow_every_change_of_the_world_and_of_the_statements() -> None:
    with ms.open("bundled:kitchen") as simulation, running(simulation) as pool:
        undo = simulation.edits
        undo.move("milk_carton_1", Pose((1.0, 0.5, 1.5)))
        assert_same(simulation, pool)
        before = pool.process_ids
        simulation.joint("fridge_door").open()
        assert_same(simulation, pool)
        simulation.place("Cup", on="table")
        assert_same(simulation, pool)
        undo.delete(["plate_3"])
        assert_same(simulation, pool)
        undo.undo()
        assert_same(simulation, pool)
        assert simulation.knowledge.tell("ToolBox", "typePrimaryFunction-containerFor", "Door")
        assert_same(simulation, pool)
        assert "ToolBox" in str(in_pool(pool, "storage_place", {"item": "Door"}))
        assert simulation.knowledge.retract("ToolBox", "typePrimaryFunction-containerFor", "Door")
        assert_same(simulation, pool)
        assert "ToolBox" not in str(in_pool(pool, "storage_place", {"item": "Door"}))
        assert pool.process_ids == before, "the processes were replaced, although they could follow"


def test_the_processes_are_replaced_when_more_is_loaded(tmp_path: Path) -> None:
    further = tmp_path / "further.ttl"
    further.write_text(
        "@prefix knowrob: <http://knowrob.org/kb/knowrob.owl#> .\n@prefix owl: <http://www.w3.org/2002/07/owl#> .\n"
        "@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .\n"
        "<http://example.org/Teapot> a owl:Class ; rdfs:subClassOf knowrob:Cup .\n"
    )
    with ms.open("bundled:kitchen") as simulation, running(simulation) as pool:
        asked = ("subclass_of", {"superclass": "Cup"})
        assert "Teapot" not in str(in_pool(pool, *asked))
        simulation.knowledge.load((), ontologies=further)
        assert "Teapot" in str(in_pool(pool, *asked))  # at once, in whatever process
        until(lambda: pool.has_processes)
        assert "Teapot" in str(in_pool(pool, *asked))
        assert_same(simulation, pool)


def test_an_answer_is_never_older_than_the_state_at_the_question(kitchen: Simulation, pool: QuestionPool) -> None:
    revisions = []
    for number in range(20):
        x = 0.5 + 0.01 * number
        kitchen.edits.move("milk_carton_2", Pose((x, 0.0, 1.5)))
        asked = pool.submit("pose_of", {"thing": "milk_carton_2"}, client=number)
        answered = asked.result.result(TIMEOUT_S)
        assert json.loads(answered.json)["answers"][0]["position"][0] == pytest.approx(x)
        assert answered.state is not None
        revisions.append(answered.state.revision)
        assert revisions[-1] == kitchen.state.revision
    assert revisions == sorted(revisions)


def test_answers_as_objects_are_those_of_the_simulation(kitchen: Simulation, pool: QuestionPool) -> None:
    asked = pool.submit("storage_place_in_environment", {"item": "CowsMilk"}, client="test", as_rows=True)
    answers = asked.result.result(TIMEOUT_S).answers
    expected = kitchen.ask("storage_place_in_environment", item="CowsMilk")
    assert answers.to_dicts() == expected.to_dicts()
    assert (answers.args, answers.missing, answers.notes) == (expected.args, expected.missing, expected.notes)
    assert answers[0].individual == expected[0].individual
    assert kitchen.knowledge.explain(answers.question, answers[0]) == kitchen.knowledge.explain(
        expected.question, expected[0]
    )


def test_recorded_episodes_have_the_questions(tmp_path: Path) -> None:
    with ms.open("bundled:kitchen") as simulation, running(simulation, processes=1) as pool:
        in_pool(pool, "where_is", {"thing": "fridge"})  # its answers are kept
        recorder = Recorder(simulation, tmp_path / "run.mcap")
        for _ in range(2):
            in_pool(pool, "where_is", {"thing": "fridge"})
        recorder.stop()
    with Episode(tmp_path / "run.mcap") as episode:
        asked = [edit.details for edit in episode.edits() if edit.kind == "question"]
    assert [each["question"] for each in asked] == ["where_is", "where_is"]
    assert asked[0]["count"] == asked[1]["count"] > 0


# -- turns -------------------------------------------------------------------------------------------------------------


def test_a_client_with_many_questions_does_not_delay_another(kitchen: Simulation) -> None:
    with running(kitchen, processes=1) as pool:
        in_pool(pool, "maps", {})
        (pid,) = pool.process_ids
        os.kill(pid, signal.SIGSTOP)
        ended: list[str] = []
        things = [body.id for body in kitchen.worlds[0].bodies[:40]]
        asked = [pool.submit("where_is", {"thing": thing}, client="many") for thing in things]
        asked.append(pool.submit("distance", {"thing": "fridge", "other": "oven"}, client="one"))
        for name, each in zip([*["many"] * 40, "one"], asked, strict=True):
            each.result.add_done_callback(lambda _, name=name: ended.append(name))
        assert pool.place(asked[-1])[0] <= 2
        os.kill(pid, signal.SIGCONT)
        for each in asked:
            each.result.result(TIMEOUT_S)
        assert ended.index("one") <= 2


def test_the_same_question_of_many_clients_is_answered_once(kitchen: Simulation) -> None:
    with running(kitchen, processes=1) as pool:
        in_pool(pool, "maps", {})
        os.kill(pool.process_ids[0], signal.SIGSTOP)
        first = pool.submit("distance", {"thing": "fridge", "other": "oven"}, client=0)
        same = [pool.submit("nearest", {"thing": "fridge"}, client=client) for client in range(1, 30)]
        os.kill(pool.process_ids[0], signal.SIGCONT)
        first.result.result(TIMEOUT_S)
        assert len({each.result.result(TIMEOUT_S).json for each in same}) == 1


def test_a_question_that_waits_too_long_is_refused_with_its_place(kitchen: Simulation) -> None:
    with running(kitchen, processes=1, wait_s=0.5, time_s=10.0) as pool:
        in_pool(pool, "maps", {})
        os.kill(pool.process_ids[0], signal.SIGSTOP)
        first = pool.submit("where_is", {"thing": "fridge"}, client=0)
        until(lambda: pool.place(first)[0] == 0)
        others = [pool.submit("where_is", {"thing": "oven"}, client=client) for client in (1, 2)]
        assert [pool.place(each) for each in others] == [(1, 2), (2, 2)]
        for place, each in enumerate(others, 1):
            text = rf"where_is.* waited 0.5 s, the limit, and was at place {place} of 2 waiting questions"
            with pytest.raises(RequestLimitError, match=text):
                each.result.result(TIMEOUT_S)
        os.kill(pool.process_ids[0], signal.SIGCONT)
        assert first.result.result(TIMEOUT_S).json


# -- processes that end ------------------------------------------------------------------------------------------------


def test_a_process_that_does_not_answer_is_replaced(kitchen: Simulation) -> None:
    with running(kitchen, processes=1, time_s=1.0) as pool:
        in_pool(pool, "maps", {})
        (pid,) = pool.process_ids
        os.kill(pid, signal.SIGSTOP)
        with pytest.raises(QuestionTimeoutError, match="where_is was not answered within 1 s"):
            pool.submit("where_is", {"thing": "oven"}, client=0).result.result(TIMEOUT_S)
        assert not is_running(pid)
        assert in_pool(pool, "pose_of", {"thing": "oven"}) == in_simulation(kitchen, "pose_of", {"thing": "oven"})
        assert pid not in pool.process_ids


def test_a_process_that_is_killed_is_replaced_and_its_question_has_an_error(kitchen: Simulation) -> None:
    with running(kitchen, processes=1) as pool:
        in_pool(pool, "maps", {})
        (pid,) = pool.process_ids
        os.kill(pid, signal.SIGSTOP)
        asked = pool.submit("where_is", {"thing": "oven"}, client=0)
        os.kill(pid, signal.SIGKILL)
        with pytest.raises(QuestionProcessError, match=r"where_is was not answered: the process .* has ended"):
            asked.result.result(TIMEOUT_S)
        assert in_pool(pool, "pose_of", {"thing": "oven"}) == in_simulation(kitchen, "pose_of", {"thing": "oven"})
        assert {*pool.process_ids} - {pid}


def test_closing_ends_the_processes_and_refuses_what_waits(kitchen: Simulation) -> None:
    with running(kitchen, processes=1) as pool:
        in_pool(pool, "maps", {})
        (pid,) = pool.process_ids
        os.kill(pid, signal.SIGSTOP)
        asked = [pool.submit("where_is", {"thing": thing}, client=0) for thing in ("oven", "fridge")]
        pool.close()
        for each in asked:
            with pytest.raises(MindstageError):
                each.result.result(TIMEOUT_S)
        until(lambda: not is_running(pid))
        with pytest.raises(MindstageError, match="closed"):
            pool.submit("where_is", {"thing": "oven"}, client=0)


KILLED = """
import time, mindstage as ms
from mindstage.simulation.question_pool import QuestionPool
from mindstage.episodes import Recorder
simulation = ms.open("bundled:kitchen", engine="null")
pool = QuestionPool.of(simulation)
pool.submit("maps", {}, client=0).result.result()
pool.start_processes()
while not pool.has_processes:
    time.sleep(0.02)
pool.submit("where_is", {}, client=0).result.result()
print(*pool.process_ids, flush=True)
pool.submit("can_hold_liquid", {}, client=0)
time.sleep(3600)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_the_processes_end_when_the_simulating_process_is_killed() -> None:
    with subprocess.Popen([sys.executable, "-c", KILLED], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        pids = [int(each) for each in process.stdout.readline().split()]
        parents = {int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1]) for pid in pids}
        process.kill()
    assert pids
    for pid in (*pids, *parents):
        until(lambda pid=pid: not is_running(pid))  # type: ignore[misc]


# -- without processes -------------------------------------------------------------------------------------------------


def test_one_client_alone_starts_no_process(kitchen: Simulation) -> None:
    pool = QuestionPool(kitchen)
    try:
        for _ in range(3):
            in_pool(pool, "where_is", {"thing": "oven"})
        assert not pool.has_processes
        assert not pool.process_ids
    finally:
        pool.close()


def test_many_statements_are_asked_where_they_are(kitchen: Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(question_pool, "QUESTION_STATEMENTS", replace(QUESTION_STATEMENTS, maximum=10))
    pool = QuestionPool(kitchen)
    try:
        asked = [pool.submit("where_is", {"thing": thing}, client=thing) for thing in ("oven", "fridge", "table")]
        for thing, each in zip(("oven", "fridge", "table"), asked, strict=True):
            answered = json.loads(each.result.result(TIMEOUT_S).json)
            expected = in_simulation(kitchen, "where_is", {"thing": thing})
            assert answered["answers"] == expected["answers"]
        assert not pool.process_ids
    finally:
        pool.close()


def test_processes_that_cannot_be_started_are_given_up_after_three_warnings(
    kitchen: Simulation, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError("no more processes")

    pool = QuestionPool(kitchen)
    try:
        with monkeypatch.context() as patch:
            patch.setattr(subprocess, "Popen", refuse)
            for _ in range(6):
                pool.start_processes()
                for thread in threading.enumerate():
                    if thread.name == "mindstage-questions-start":
                        thread.join(TIMEOUT_S)
        assert [record.message for record in caplog.records].count(
            "questions are answered in this process: no more processes"
        ) == 3
        assert not pool.has_processes
    finally:
        pool.close()
