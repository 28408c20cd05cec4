"""Questions of ports, answered by processes of their own, in turns of the clients.

A `QuestionPool` answers in this process, one question after the other, until questions have to wait. From then on forks
of a process that holds the knowledge base answer them in parallel; see `mindstage.knowledge.question_worker`. They get
the world of a simulation when its bodies, joints or attachments change, poses and joint positions by shared memory, and
assertions one by one; after any other change of the knowledge base they are replaced. An answer is never about an older
state than that at the time of the question, and is kept until the state or the statements change.
"""

from __future__ import annotations

import logging
import mmap
import os
import pickle
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping, Sequence, Sized
from concurrent.futures import Future, InvalidStateError, ThreadPoolExecutor
from contextlib import suppress
from contextvars import Context, copy_context
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from math import ceil
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, ClassVar
from weakref import WeakKeyDictionary, ref

import msgspec
import numpy as np

from mindstage.access.fair_queue import FairQueue
from mindstage.access.limits import (
    CLIENT_QUESTIONS,
    QUESTION_CACHE,
    QUESTION_PROCESSES,
    QUESTION_STATEMENTS,
    QUESTION_TIME,
    QUESTION_WAIT,
    QUESTIONS,
)
from mindstage.access.resources import is_outside_request
from mindstage.errors import (
    MindstageError,
    QuestionProcessError,
    QuestionTimeoutError,
    RequestLimitError,
    SimulationError,
)
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.history import NOW, WorldState, time_arguments
from mindstage.knowledge.over_time import argument_names
from mindstage.knowledge.queries import Answers, answers_to_builtins, get_question
from mindstage.knowledge.question_worker import (
    COMMAND,
    FORK,
    KILL,
    QuestionReply,
    QuestionRequest,
    StateArrays,
    StatementChange,
    StateTemplate,
    holder_input,
    movable_joints,
)
from mindstage.knowledge.sentences import is_sentence
from mindstage.scene.bounding_boxes import Indices
from mindstage.simulation.simulation import Simulation
from mindstage.simulation.state import StateSnapshot

__all__ = ["PooledAnswers", "QuestionPool", "StateLabel", "WaitingQuestion"]

_POLL_S = 0.25
"""Interval at which questions that wait too long are looked for [s]."""
_START_TIMEOUT_S = 60.0
_MAX_STARTS = 3
"""Failed starts in a row after which no process is started any more."""
_MAX_CHANGES = 1000
"""Changes of the knowledge base after which the processes are replaced."""
_ELSEWHERE_THREADS = 4
_log = logging.getLogger("mindstage.simulation.questions")


class StateLabel(msgspec.Struct, frozen=True):
    """Which state answers are about."""

    time_s: float
    """The simulated time [s]."""
    revision: int
    """See `StateSnapshot.revision`."""


@dataclass(frozen=True, slots=True, eq=False)
class PooledAnswers:
    """The answers to a question, and the state that they are about."""

    json: bytes
    """As `answers_to_builtins`; empty if it was not wanted."""
    state: StateLabel | None
    """The state that they are about; None if they are about the statements only."""
    _knowledge: KnowledgeBase
    _answers: Answers[Any] | None = None
    _rows: bytes = b""

    def json_with(self, **further: object) -> bytes:
        """The JSON with further fields."""
        return self.json[:-1] + b"," + msgspec.json.encode(further)[1:]

    @property
    def answers(self) -> Answers[Any]:
        """The answers as objects; they must have been wanted."""
        if self._answers is not None:
            return self._answers
        name, args, rows, missing, classes, notes, conclusion = pickle.loads(self._rows)
        kb = self._knowledge
        return Answers(
            get_question(name), args, rows, missing, kb=kb, classes=classes, notes=notes, conclusion=conclusion
        )


@dataclass(slots=True, eq=False)
class WaitingQuestion:
    """A question that was asked of a pool."""

    question: str
    args: Mapping[str, object]
    as_json: bool
    as_rows: bool
    uses_state: bool
    key: bytes
    context: Context
    result: Future[PooledAnswers] = field(default_factory=Future)
    asked_s: float = field(default_factory=time.monotonic)


# -- the state ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """A state as the processes get it."""

    template_number: int
    template: bytes
    arrays: StateArrays
    label: StateLabel


class _StateSource:
    """Reads the state of a simulation, at most once for each published state."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._lock = threading.Lock()
        self._numbers = count(1)
        self._last: tuple[StateSnapshot, WorldState, _State] | None = None

    def known(self) -> _State | None:
        """The present state, if it has been read already; does not wait."""
        last, now = self._last, self._simulation.state
        if last is None or now.error:
            return None
        then = last[0]
        is_same = (now.time_s, now.revision, now.ids) == (then.time_s, then.revision, then.ids)
        return last[2] if is_same and np.array_equal(now.poses, then.poses) else None

    def read(self) -> _State:
        """The present state.

        Raises:
            SimulationError: the simulation does not give it.
            EngineError: the engine does not give it.
        """
        with self._lock:
            if (known := self.known()) is not None:
                return known
            snapshot, now = self._simulation.engine.run(
                lambda _: (self._simulation.state, self._simulation.current_state()), label="current state"
            )
            state = self._encoded(now, StateLabel(snapshot.time_s, snapshot.revision))
            self._last = snapshot, now, state
            return state

    def _encoded(self, now: WorldState, label: StateLabel) -> _State:
        moved = None if self._last is None else _moved_rows(now, self._last[1])
        if moved is not None and self._last is not None:
            last = self._last[2]
            before = last.arrays
            arrays = before.moved(next(self._numbers), now, moved)
            if np.array_equal(arrays.poses, before.poses) and np.array_equal(arrays.joints, before.joints):
                arrays = before
            return _State(last.template_number, last.template, arrays, label)
        arrays, number = StateArrays.of(next(self._numbers), now), next(self._numbers)
        template = pickle.dumps(StateTemplate.of(number, now), protocol=pickle.HIGHEST_PROTOCOL)
        return _State(number, template, arrays, label)


def _moved_rows(now: WorldState, then: WorldState) -> Indices | None:
    """The rows of the bodies that have moved; None if more than what is in the arrays has changed."""
    rows = now.moved_rows(then)
    if rows is None or now.world.joints != then.world.joints:
        return None
    same_joints = movable_joints(now) == movable_joints(then)
    return rows if same_joints and (movable_joints(now) or now.joint_positions == then.joint_positions) else None


# -- processes ---------------------------------------------------------------------------------------------------------


class _Holder:
    """The process that holds a knowledge base, as it was at the start."""

    def __init__(self, knowledge: bytes, generation: int) -> None:
        """Starts the process, and waits until it can be forked.

        Raises:
            OSError: it does not start.
        """
        self.generation = generation
        self._lock = threading.Lock()
        self._control, theirs = socket.socketpair()
        package_folder = str(Path(__file__).resolve().parents[2])
        search_path = os.pathsep.join(filter(None, (package_folder, os.environ.get("PYTHONPATH", ""))))
        code = f"from mindstage.knowledge.question_worker import run_holder; run_holder({theirs.fileno()})"
        self._process = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            pass_fds=(theirs.fileno(),),
            env={**os.environ, "PYTHONPATH": search_path, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            start_new_session=True,  # Ctrl-C is handled by this process
        )
        theirs.close()
        try:
            assert self._process.stdin is not None
            with self._process.stdin as stream:
                stream.write(knowledge)
            self._control.settimeout(_START_TIMEOUT_S)
            self._receive()
        except BaseException:
            self.close()
            raise

    def fork(self) -> _Worker:
        """Starts a process that answers questions.

        Raises:
            OSError: the holder has ended.
        """
        ours, theirs = socket.socketpair()
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", ceil(QUESTION_TIME.maximum), 0))
        memory_fd = _anonymous_file()
        with self._lock, theirs:
            socket.send_fds(self._control, [COMMAND.pack(FORK, 0)], [theirs.fileno(), memory_fd])
            pid = self._receive()
        return _Worker(self, pid, Connection(ours.detach()), memory_fd)

    def kill(self, pid: int) -> None:
        """Ends a process that was forked."""
        with self._lock, suppress(OSError):
            self._control.sendall(COMMAND.pack(KILL, pid))
            self._receive()

    def close(self) -> None:
        """Ends the process and its forks."""
        self._control.close()
        self._process.kill()
        self._process.wait()

    def _receive(self) -> int:
        data = self._control.recv(COMMAND.size, socket.MSG_WAITALL)
        if len(data) < COMMAND.size:
            raise ConnectionError("the process that holds the knowledge base has ended")
        pid: int = COMMAND.unpack(data)[1]
        return pid


class _Worker:
    """A process that answers one question at a time."""

    def __init__(self, holder: _Holder, pid: int, connection: Connection, memory_fd: int) -> None:
        self.holder, self.pid = holder, pid
        self.changes = 0
        """How many changes of the knowledge base it has got."""
        self._connection, self._memory_fd = connection, memory_fd
        self._memory: mmap.mmap | None = None
        self._template_number = self._arrays_number = 0

    def ask(
        self,
        asked: WaitingQuestion,
        state: _State | None,
        changes: list[StatementChange],
        *,
        timeout_s: float,
        while_waiting: Callable[[], None],
    ) -> QuestionReply:
        """Sends a question, and waits for the reply.

        Raises:
            QuestionTimeoutError: there is none in time; the process must be ended.
            QuestionProcessError: the process has ended.
        """
        template_size = size = 0
        if state is not None and state.template_number != self._template_number:
            template_size = len(state.template)
            size = state.arrays.size + template_size
            os.ftruncate(self._memory_fd, size)
            self._memory, self._arrays_number = mmap.mmap(self._memory_fd, size), 0
            self._memory[-template_size:] = state.template
        if state is not None and self._memory is not None and state.arrays.number != self._arrays_number:
            state.arrays.write(self._memory)
        request = QuestionRequest(
            question=asked.question,
            args=asked.args,
            as_json=asked.as_json,
            as_rows=asked.as_rows,
            is_outside=asked.context.run(is_outside_request),
            changes=changes,
            template_size=template_size,
            memory_size=size,
            arrays=None if state is None else state.arrays.number,
        )
        end_s = time.monotonic() + timeout_s
        try:
            self._connection.send(request)
            while not self._connection.poll(_POLL_S):
                while_waiting()
                if time.monotonic() > end_s:
                    raise QuestionTimeoutError(asked.question, timeout_s=timeout_s)
            reply: QuestionReply = self._connection.recv()
        except BlockingIOError:  # it did not read
            raise QuestionTimeoutError(asked.question, timeout_s=timeout_s) from None
        except (EOFError, ConnectionError):
            raise QuestionProcessError(asked.question) from None
        self.changes += len(changes)
        if state is not None:
            self._template_number, self._arrays_number = state.template_number, state.arrays.number
        return reply

    def close(self) -> None:
        """Ends the process."""
        self._connection.close()
        self.holder.kill(self.pid)
        if self._memory is not None:
            self._memory.close()
        os.close(self._memory_fd)


def _anonymous_file() -> int:
    """The descriptor of a file without a name, which needs no removal."""
    if sys.platform == "linux":
        return os.memfd_create("mindstage-state")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())


# -- the pool ----------------------------------------------------------------------------------------------------------


class QuestionPool:
    """Answers the questions that come to a simulation from ports; see the module. May be used from any thread."""

    _pools: ClassVar[WeakKeyDictionary[Simulation, QuestionPool]] = WeakKeyDictionary()
    _pools_lock = threading.Lock()

    def __init__(
        self,
        simulation: Simulation,
        *,
        processes: int = QUESTION_PROCESSES.count,
        time_s: float = QUESTION_TIME.maximum,
        wait_s: float = QUESTION_WAIT.maximum,
    ) -> None:
        """Starts no thread and no process yet.

        Args:
            simulation: the simulation that is asked.
            processes: the number of processes that answer.
            time_s: time for the answer to a question after which its process is ended [s].
            wait_s: time that a question waits before it is refused [s].
        """
        self._time_s, self._wait_s = time_s, wait_s
        self._simulation = simulation
        self._states = _StateSource(simulation)
        self._queue: FairQueue[WaitingQuestion] = FairQueue(per_client=CLIENT_QUESTIONS, total=QUESTIONS)
        self._lanes = [_Lane() for _ in range(processes)]
        self._has_work = threading.Condition()
        self._closed = False
        self._busy = 0
        self._here = threading.Lock()
        """Held while a question is answered in this process."""
        self._elsewhere = ThreadPoolExecutor(_ELSEWHERE_THREADS, thread_name_prefix="mindstage-asking")
        self._holder: _Holder | None = None
        self._is_starting = False
        self._failed_starts = 0
        self._cache: OrderedDict[bytes, tuple[object, QuestionReply]] = OrderedDict()
        self._cached_bytes = 0
        self._cache_lock = threading.Lock()
        self._knowledge: KnowledgeBase | None = None
        self._generation = 0
        self._changes: list[StatementChange] = []
        self._knowledge_lock = threading.Lock()

    @classmethod
    def of(cls, simulation: Simulation) -> QuestionPool:
        """The pool of a simulation, which all its ports share; closed with the simulation."""
        with cls._pools_lock:
            if (pool := cls._pools.get(simulation)) is None:
                pool = cls._pools[simulation] = cls(simulation)
                simulation.on_close(pool.close)
            return pool

    # -- questions -----------------------------------------------------------------------------------------------------

    def accepts(self, question: str, args: Mapping[str, object]) -> bool:
        """Whether a question may be asked of the pool: it is about the present, and imagines nothing.

        A sentence, or an unknown question, may be; one that turns out to imagine is answered in this process.

        Raises:
            InvalidArgumentError: a time is invalid.
        """
        if time_arguments(args, declared=argument_names(question))[0] != NOW:
            return False
        if is_sentence(question):
            return True
        declared = get_question(question)
        return not (declared.imagines or declared.about_past)

    def submit(
        self, question: str, args: Mapping[str, object], *, client: Hashable, as_rows: bool = False
    ) -> WaitingQuestion:
        """Asks a question that is accepted.

        Args:
            question: its name, or a sentence.
            args: its arguments.
            client: who asks; clients take turns.
            as_rows: whether the answers are wanted as objects, instead of as JSON.

        Returns:
            The question, with its future `result`.

        Raises:
            RequestLimitError: too many questions wait.
            SimulationError: the simulation is closed.
            QuestionNotFoundError: no question has that name.
        """
        self._follow_knowledge()
        asked = WaitingQuestion(
            question=question,
            args=args,
            as_json=not as_rows,
            as_rows=as_rows or bool(self._simulation.observers),
            uses_state=is_sentence(question) or get_question(question).uses_current_state,
            key=msgspec.json.encode((question, sorted(args.items()), as_rows, is_outside_request())),
            context=copy_context(),
        )
        state = self._states.known() if asked.uses_state else None
        if (state or not asked.uses_state) and (reply := self._cached(asked, state)) is not None:
            asked.result.set_result(self._answers(asked, reply, state))
            return asked
        with self._has_work:
            if self._closed:
                raise SimulationError("the simulation is closed; make a new one")
            self._queue.put(client, asked, subject=question)
            needs_processes = self._busy + len(self._queue) > 1
            for lane in self._lanes:
                if lane.thread is None:
                    lane.thread = threading.Thread(
                        target=self._run, args=(lane,), name="mindstage-questions", daemon=True
                    )
                    lane.thread.start()
            self._has_work.notify()
        if needs_processes:
            self.start_processes()
        return asked

    def place(self, asked: WaitingQuestion) -> tuple[int, int]:
        """The place of a question in the queue, 0 if it does not wait any more; and how many questions wait."""
        with self._has_work:
            return self._queue.place(asked) or 0, len(self._queue)

    @property
    def has_processes(self) -> bool:
        """Whether processes answer questions, with the present statements."""
        with self._knowledge_lock:
            return self._holder is not None and self._holder.generation == self._generation

    @property
    def process_ids(self) -> tuple[int, ...]:
        """The processes that answer questions."""
        workers = (lane.worker for lane in self._lanes)
        return tuple(worker.pid for worker in workers if worker is not None)

    def close(self) -> None:
        """Refuses what waits, and ends the processes; calling it again is harmless."""
        with self._has_work:
            self._closed = True
            waiting = self._queue.remove_if(lambda _: True)
            self._has_work.notify_all()
        _fail(waiting, SimulationError("the simulation was closed"))
        with self._pools_lock:
            if self._pools.get(self._simulation) is self:
                del self._pools[self._simulation]
        self._elsewhere.shutdown(wait=False, cancel_futures=True)
        with self._knowledge_lock:
            holder, self._holder = self._holder, None
        if holder is not None:
            holder.close()

    # -- in the threads of the pool ------------------------------------------------------------------------------------

    def _run(self, lane: _Lane) -> None:
        while True:
            with self._has_work:
                while not self._closed and not self._queue:
                    self._has_work.wait()
                if self._closed:
                    break
                asked = self._queue.pop()
                key = asked.key if asked else b""
                # The same question of others gets the same answer, whose state is read from now on.
                is_observed = bool(self._simulation.observers)  # then each is reported
                same = [] if is_observed else self._queue.remove_if(lambda each: each.key == key)  # noqa: B023
                self._busy += 1
            try:
                self._refuse_late()
                group = [each for each in (asked, *same) if each and each.result.set_running_or_notify_cancel()]
                if group:
                    self._answer(lane, group)
            finally:
                with self._has_work:
                    self._busy -= 1
        if lane.worker is not None:
            lane.worker.close()
            lane.worker = None

    def _answer(self, lane: _Lane, same: list[WaitingQuestion]) -> None:
        try:
            found = self._answer_in_process(lane, same)
        except Exception as error:
            _fail(same, error)
            return
        if found is not None:
            _end(same, found)
        else:
            self._elsewhere.submit(self._complete_here, same)

    def _answer_in_process(self, lane: _Lane, same: list[WaitingQuestion]) -> PooledAnswers | None:
        """Answers a question in the process of a lane, or here if there is none; None if it is to be answered here."""
        asked = same[0]
        self._follow_knowledge()
        while (worker := self._worker(lane)) is None:
            if self._here.acquire(timeout=_POLL_S):
                try:
                    return self._answer_here(same)
                finally:
                    self._here.release()
            self._refuse_late()
        state = asked.context.run(self._states.read) if asked.uses_state else None
        with self._knowledge_lock:
            is_current = worker.holder.generation == self._generation
            changes, version = self._changes[worker.changes :], self._version
        if not is_current:
            return self._answer_in_process(lane, same)
        reply = self._cached(asked, state)
        if reply is None:
            try:
                reply = worker.ask(asked, state, changes, timeout_s=self._time_s, while_waiting=self._refuse_late)
            except (QuestionTimeoutError, QuestionProcessError):
                lane.worker = None
                worker.close()
                raise
            if reply.error is None and not reply.is_elsewhere:
                self._keep(asked, state, version, reply)
        if reply.error is not None:
            raise reply.error
        return None if reply.is_elsewhere else self._answers(asked, reply, state)

    def _answer_here(self, same: list[WaitingQuestion]) -> PooledAnswers:
        asked = same[0]
        simulation = self._simulation
        before = simulation.state  # the answers are about this state, or a newer one
        late = QuestionTimeoutError(asked.question, timeout_s=self._time_s)
        timer = threading.Timer(self._time_s, _fail, (same, late))
        timer.daemon = True
        timer.start()  # a thread cannot be ended, but its client gets an answer
        try:
            answers = asked.context.run(partial(simulation.ask, asked.question, **asked.args))
        finally:
            timer.cancel()
        knowledge, json = simulation.knowledge, b""
        if asked.as_json:
            json = msgspec.json.encode(answers_to_builtins(knowledge, answers))
        label = StateLabel(before.time_s, before.revision) if asked.uses_state else None
        return PooledAnswers(json, label, knowledge, _answers=answers)

    def _complete_here(self, same: list[WaitingQuestion]) -> None:
        try:
            _end(same, self._answer_here(same))
        except Exception as error:
            _fail(same, error)

    def _answers(self, asked: WaitingQuestion, reply: QuestionReply, state: _State | None) -> PooledAnswers:
        label = None if state is None else state.label
        found = PooledAnswers(reply.json, label, self._simulation.knowledge, _rows=reply.rows)
        if reply.rows and self._simulation.observers:
            asked.context.run(self._simulation.observers.report_answers, found.answers)
        return found

    def _refuse_late(self) -> None:
        """Refuses the questions that have waited too long."""
        limit_s = self._wait_s
        before_s = time.monotonic() - limit_s
        with self._has_work:
            waiting = len(self._queue)
            late = [(asked, self._queue.place(asked)) for asked in self._queue if asked.asked_s < before_s]
            self._queue.remove_if(lambda asked: asked.asked_s < before_s)
        for asked, place in late:
            cause = f"it has waited {limit_s:g} s, the limit, and was at place {place} of {waiting} waiting questions"
            _fail([asked], RequestLimitError(asked.question, cause=f"{cause}; ask again later"))

    # -- kept answers --------------------------------------------------------------------------------------------------

    @property
    def _version(self) -> tuple[int, int]:
        """Differs after each change of the knowledge base."""
        return self._generation, len(self._changes)

    def _cached(self, asked: WaitingQuestion, state: _State | None) -> QuestionReply | None:
        with self._cache_lock:
            of, reply = self._cache.get(asked.key, (None, None))
            if reply is None or of != (self._version, _content(state)) or (asked.as_rows and not reply.rows):
                return None
            return reply

    def _keep(
        self, asked: WaitingQuestion, state: _State | None, version: tuple[int, int], reply: QuestionReply
    ) -> None:
        size = len(reply.json) + len(reply.rows)
        with self._cache_lock:
            _, old = self._cache.pop(asked.key, (None, None))
            self._cached_bytes -= 0 if old is None else len(old.json) + len(old.rows)
            if size > QUESTION_CACHE.maximum:
                return
            self._cache[asked.key] = (version, _content(state)), reply
            self._cached_bytes += size
            while self._cached_bytes > QUESTION_CACHE.maximum or len(self._cache) > QUESTIONS.count:
                _, (_, oldest) = self._cache.popitem(last=False)
                self._cached_bytes -= len(oldest.json) + len(oldest.rows)

    # -- the knowledge base and the processes --------------------------------------------------------------------------

    def _follow_knowledge(self) -> None:
        """Observes the knowledge base of the simulation, which may have been replaced."""
        knowledge = self._simulation.knowledge
        if self._knowledge is knowledge:
            return
        with knowledge.lock, self._knowledge_lock:
            if self._knowledge is not knowledge:
                self._knowledge = knowledge
                self._generation, self._changes = self._generation + 1, []
                knowledge.on_change(partial(_note_change, ref(self), ref(knowledge)))

    def note_change(self, knowledge: KnowledgeBase, quads: Sequence[Any] | None) -> None:
        """Notes a change of the knowledge base, whose lock is held."""
        with self._knowledge_lock:
            if knowledge is not self._knowledge:
                return
            if quads is None or len(self._changes) + len(quads) > _MAX_CHANGES:
                self._generation, self._changes = self._generation + 1, []
            else:
                self._changes = [*self._changes, *((quad, knowledge.is_stated(quad)) for quad in quads)]

    def start_processes(self) -> None:
        """Starts the processes, unless they run, in the background: questions are answered here meanwhile."""
        with self._knowledge_lock:
            is_current = self._holder is not None and self._holder.generation == self._generation
            if is_current or self._is_starting or self._failed_starts >= _MAX_STARTS or sys.platform == "win32":
                return
            self._is_starting = True
        threading.Thread(target=self._start, name="mindstage-questions-start", daemon=True).start()

    def _start(self) -> None:
        holder: _Holder | None = None
        try:
            self._follow_knowledge()
            knowledge = self._simulation.knowledge
            with knowledge.lock:
                with self._knowledge_lock:
                    self._generation, self._changes = self._generation + 1, []
                    generation = self._generation
                store = knowledge.store
                if isinstance(store, Sized) and len(store) > QUESTION_STATEMENTS.count:
                    raise OverflowError(f"there are more than {QUESTION_STATEMENTS.count:,} statements")
                data = holder_input(knowledge)
            holder = _Holder(data, generation)
            self._failed_starts = 0
        except Exception as error:  # the simulation runs without them as well
            self._failed_starts += 1 if isinstance(error, OSError) else _MAX_STARTS
            _log.warning("questions are answered in this process: %s", error)
        with self._has_work:
            closed = self._closed
        with self._knowledge_lock:
            old = None
            if holder is not None and not closed:
                old, self._holder = self._holder, holder
            self._is_starting = False
        for ended in (old, holder if closed else None):
            if ended is not None:
                ended.close()

    def _worker(self, lane: _Lane) -> _Worker | None:
        """The process of a lane, in the present generation; None if there is none."""
        with self._knowledge_lock:
            holder, generation = self._holder, self._generation
        if lane.worker is not None and (lane.worker.holder is not holder or holder.generation != generation):
            lane.worker.close()
            lane.worker = None
        if holder is None:
            return None
        if holder.generation != generation:
            self.start_processes()
            return None
        if lane.worker is None:
            try:
                lane.worker = holder.fork()
            except OSError:  # it was killed
                with self._knowledge_lock:
                    if self._holder is holder:
                        self._holder = None
                holder.close()
                self.start_processes()
        return lane.worker


@dataclass(slots=True, eq=False)
class _Lane:
    """A thread that answers one question at a time, and its process."""

    thread: threading.Thread | None = None
    worker: _Worker | None = None


def _note_change(pool: ref[QuestionPool], knowledge: ref[KnowledgeBase], quads: Sequence[Any] | None) -> None:
    """Notes a change for a pool that still exists."""
    if (existing := pool()) is not None and (changed := knowledge()) is not None:
        existing.note_change(changed, quads)


def _content(state: _State | None) -> tuple[int, int] | None:
    return None if state is None else (state.template_number, state.arrays.number)


def _fail(same: list[WaitingQuestion], error: Exception) -> None:
    if not isinstance(error, MindstageError):
        _log.error("the question %s failed", same[0].question, exc_info=error)
    for asked in same:
        with suppress(InvalidStateError):  # its time was over
            asked.result.set_exception(error)


def _end(same: list[WaitingQuestion], answers: PooledAnswers) -> None:
    for asked in same:
        with suppress(InvalidStateError):
            asked.result.set_result(answers)
