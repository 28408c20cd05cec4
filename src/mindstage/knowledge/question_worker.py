"""Processes that answer questions beside the one that simulates: the holder of the knowledge base, and its forks.

The holder reads a pickled `KnowledgeBase` from its standard input, builds what questions need, and has one thread; a
fork of it therefore holds no lock of another thread, takes milliseconds, and shares its memory. Each fork answers one
question at a time. It has a template of the state, and memory that it shares with the simulating process, from which it
reads the poses and joint positions. All of them end when the simulating process does.
"""

from __future__ import annotations

import gc
import mmap
import os
import pickle
import signal
import socket
import sys
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from struct import Struct
from typing import Any, NoReturn

import msgspec
import numpy as np
import pyoxigraph as ox
from msgspec.structs import replace

from mindstage.access.resources import from_outside
from mindstage.knowledge.history import NOW, WorldState, time_arguments
from mindstage.knowledge.knowledge_base import KnowledgeBase
from mindstage.knowledge.over_time import argument_names
from mindstage.knowledge.questions import StateAccess, answers_to_builtins
from mindstage.knowledge.sentences import resolve_question
from mindstage.sandbox import deny_network, end_with_parent
from mindstage.scene import BodyId, Pose
from mindstage.scene.bounding_boxes import Indices
from mindstage.scene.transforms import Array, pose_array

if sys.platform != "win32":
    import resource

__all__ = [
    "COMMAND",
    "FORK",
    "KILL",
    "QuestionReply",
    "QuestionRequest",
    "StateArrays",
    "StateTemplate",
    "StatementChange",
    "holder_input",
    "movable_joints",
    "run_holder",
]

StatementChange = tuple[ox.Quad, bool]
"""See `KnowledgeBase.repeat_changes`."""
COMMAND = Struct("<cQ")
"""A command to the holder: its letter, and the id of a process."""
FORK, KILL = b"F", b"K"
"""Commands: to fork, with two descriptors; to end a fork. The reply is the id of the process."""
_MEMORY_LIMIT = 2 * 1024**3
"""Memory for questions in addition to that of the knowledge base [bytes]."""
_HEADER = 8
"""The number of the arrays, at the begin of the shared memory [bytes]."""
_SHARED_PACKAGES = ("mindstage.knowledge", "mindstage.scene", "scipy")
"""The packages whose modules are imported before the process is forked, if they are loaded where it is started."""


@dataclass(frozen=True, slots=True)
class StateTemplate:
    """A state whose poses and joint positions are replaced by those of arrays of the same order."""

    number: int
    state: WorldState
    joint_ids: tuple[BodyId, ...]

    @classmethod
    def of(cls, number: int, state: WorldState) -> StateTemplate:
        """The template of a state, which can be pickled."""
        joints = None if state.joint_positions is None else dict(state.joint_positions)
        plain = replace(state, geometry=dict(state.geometry), joint_positions=joints)
        return cls(number, plain, movable_joints(state))


@dataclass(frozen=True, slots=True, eq=False)
class StateArrays:
    """What changes in a state by motion."""

    number: int
    """Counts the arrays that differ."""
    poses: Array
    """n x 7: x y z [m], then w x y z, in the order of the bodies of the world."""
    joints: Array
    """m x 6, see `WorldState.joint_positions`."""

    @classmethod
    def of(cls, number: int, state: WorldState) -> StateArrays:
        """The arrays of a state."""
        return cls(number, pose_array(body.pose for body in state.world.bodies), _joint_array(state))

    def moved(self, number: int, state: WorldState, rows: Indices) -> StateArrays:
        """The arrays of a state in which only some bodies, and joints, have moved."""
        poses = self.poses.copy()
        poses[rows] = pose_array(state.world.bodies[row].pose for row in rows.tolist())
        return StateArrays(number, poses, _joint_array(state))

    @property
    def size(self) -> int:
        """The shared memory that they need [bytes]."""
        return _HEADER + self.poses.nbytes + self.joints.nbytes

    def write(self, memory: mmap.mmap) -> None:
        """Writes them; the process that reads them must not be answering."""
        memory[: self.size] = self.number.to_bytes(_HEADER, "little") + self.poses.tobytes() + self.joints.tobytes()

    @classmethod
    def read(cls, memory: mmap.mmap, template: StateTemplate) -> StateArrays:
        """Reads those of a template."""
        count = len(template.state.world.bodies)
        numbers = np.frombuffer(memory[_HEADER : _HEADER + 8 * (7 * count + 6 * len(template.joint_ids))])
        poses, joints = numbers[: 7 * count].reshape(-1, 7), numbers[7 * count :].reshape(-1, 6)
        return cls(int.from_bytes(memory[:_HEADER], "little"), poses, joints)


def _joint_array(state: WorldState) -> Array:
    positions = list((state.joint_positions or {}).values()) if movable_joints(state) else []
    return np.array(positions, dtype=np.float64).reshape(-1, 6)


def movable_joints(state: WorldState) -> tuple[BodyId, ...]:
    """The joints whose positions are in the arrays: all, if each has six."""
    positions = state.joint_positions or {}
    return tuple(positions) if all(len(each) == 6 for each in positions.values()) else ()


@dataclass(frozen=True, slots=True, kw_only=True)
class QuestionRequest:
    """A question, and what the process needs to be up to date."""

    question: str
    args: Mapping[str, object]
    as_json: bool
    """Whether the answers are wanted as JSON."""
    as_rows: bool
    """Whether the rows are wanted as objects."""
    is_outside: bool
    """Whether a client of a port asks, to whom not all questions are offered."""
    changes: Sequence[StatementChange] = ()
    """See `KnowledgeBase.repeat_changes`."""
    template_size: int = 0
    """The size of a new pickled `StateTemplate`, which is at the end of the shared memory; 0 if there is none [bytes].
    """
    memory_size: int = 0
    """The size of the shared memory, if there is a new template [bytes]."""
    arrays: int | None = None
    """The number of the arrays in the shared memory; None if the question does not use the state."""


@dataclass(frozen=True, slots=True, kw_only=True)
class QuestionReply:
    """The answers, an error, or neither if the question must be answered where the simulation is."""

    json: bytes = b""
    rows: bytes = b""
    """The arguments of `Answers`, pickled."""
    error: Exception | None = None
    is_elsewhere: bool = False


class _ElsewhereError(Exception):
    """A question needs more than the state."""


class _TransferredState(StateAccess):
    """The state of a simulation in another process."""

    @property
    def simulation(self) -> NoReturn:
        """Not there.

        Raises:
            _ElsewhereError: always.
        """
        raise _ElsewhereError

    @simulation.setter
    def simulation(self, _: object) -> None:
        pass


class _QuestionProcess:
    """Answers questions in a fork."""

    def __init__(self, knowledge: KnowledgeBase, memory_fd: int) -> None:
        self._knowledge = knowledge
        self._memory_fd = memory_fd
        self._memory: mmap.mmap | None = None
        self._template: StateTemplate | None = None
        self._state: WorldState | None = None
        self._poses: Array | None = None
        self._arrays = -1

    def answer(self, request: QuestionRequest) -> QuestionReply:
        """Answers one question."""
        try:
            self._update(request)
            with from_outside(request.is_outside):
                return self._ask(request)
        except _ElsewhereError:
            return QuestionReply(is_elsewhere=True)
        except Exception as error:
            error.add_note("".join(traceback.format_exception(error)))
            return QuestionReply(error=error)

    def _update(self, request: QuestionRequest) -> None:
        if request.changes:
            self._knowledge.repeat_changes(request.changes)
        if request.template_size:
            self._memory = mmap.mmap(self._memory_fd, request.memory_size)
            self._template, self._poses = pickle.loads(self._memory[-request.template_size :]), None
            self._state = self._template.state
        if request.arrays is None or self._memory is None or self._template is None:
            return
        if self._poses is None or request.arrays != self._arrays:
            assert self._state is not None
            arrays = StateArrays.read(self._memory, self._template)
            self._state = _moved(self._state, self._poses, self._template.joint_ids, arrays)
            self._poses, self._arrays = arrays.poses, request.arrays

    def _ask(self, request: QuestionRequest) -> QuestionReply:
        kb, state = self._knowledge, self._state
        time, args = time_arguments(request.args, declared=argument_names(request.question))
        present = _TransferredState(kb, None if state is None else lambda: state)
        question, known, notes = resolve_question(
            kb, request.question, args, find_body=present.find_individual, is_past=time != NOW
        )
        if time != NOW or question.about_past or question.imagines:
            raise _ElsewhereError
        answers = question.ask(kb, known, present=present, notes=notes)
        json = rows = b""
        if request.as_json:
            json = msgspec.json.encode(answers_to_builtins(kb, answers))
        if request.as_rows:
            plain = [msgspec.structs.replace(row) for row in answers]  # without the link to these answers
            classes = {name: tuple(each) for name, each in answers.classes.items()}
            told = (answers.notes, answers.conclusion)
            rows = pickle.dumps((question.name, dict(answers.args), plain, answers.missing, classes, *told))
        return QuestionReply(json=json, rows=rows)


def _moved(state: WorldState, poses: Array | None, joint_ids: Sequence[BodyId], arrays: StateArrays) -> WorldState:
    """A state with other poses, of which it had these; a body that has not moved is the same object."""
    bodies = list(state.world.bodies)
    before = pose_array(body.pose for body in bodies) if poses is None else poses
    has_moved = (before != arrays.poses).any(axis=1)
    for row in np.flatnonzero(has_moved).tolist():
        x, y, z, *quaternion = arrays.poses[row].tolist()
        bodies[row] = replace(bodies[row], pose=Pose((x, y, z), tuple(quaternion)))
    positions: Mapping[BodyId, Any] | None = state.joint_positions
    if joint_ids:
        positions = dict(zip(joint_ids, map(tuple, arrays.joints.tolist()), strict=True))
    moved = replace(state, world=replace(state.world, bodies=tuple(bodies)), joint_positions=positions)
    return moved.following(state)


def _serve(knowledge: KnowledgeBase, connection: Connection, memory_fd: int) -> None:
    """Answers requests until the connection is closed."""
    _limit_resources()
    process = _QuestionProcess(knowledge, memory_fd)
    while True:
        try:
            request = connection.recv()
        except (EOFError, ConnectionError):
            return
        reply = process.answer(request)
        try:
            connection.send(reply)
        except (EOFError, ConnectionError):
            return
        except Exception as error:  # the error of a question that cannot be pickled
            text = f"{type(reply.error).__name__}: {reply.error}; {error}"
            connection.send(QuestionReply(error=RuntimeError(text)))


def _limit_resources() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    deny_network(no_new_files=False)  # modules are imported when a question needs them
    if sys.platform == "linux":  # other systems do not enforce the limit
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        limit = pages * resource.getpagesize() + _MEMORY_LIMIT
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        if hard == resource.RLIM_INFINITY or limit < hard:
            resource.setrlimit(resource.RLIMIT_AS, (limit, hard))


# -- the process that holds the knowledge base -------------------------------------------------------------------------


def holder_input(knowledge: KnowledgeBase) -> bytes:
    """The standard input of a process that holds an equal knowledge base.

    Raises:
        TypeError: it cannot be copied, since it is at a SPARQL endpoint.
    """
    modules = [name for name in tuple(sys.modules) if name.startswith(_SHARED_PACKAGES)]
    return pickle.dumps((modules, knowledge), protocol=pickle.HIGHEST_PROTOCOL)


def run_holder(control_fd: int) -> None:
    """Holds the knowledge base of the standard input, and executes commands until the control socket is closed."""
    control = socket.socket(fileno=control_fd)
    modules, knowledge = pickle.load(sys.stdin.buffer)
    for module in modules:
        with suppress(ImportError):
            import_module(module)
    with knowledge.lock:
        knowledge.reasoner, knowledge.names  # noqa: B018 - cached from now on
    gc.collect()
    gc.freeze()  # so that collections of the forks do not copy its memory
    control.sendall(COMMAND.pack(FORK, os.getpid()))
    children: set[int] = set()
    while True:
        data, fds, _, _ = socket.recv_fds(control, COMMAND.size, 2)
        if len(data) < COMMAND.size:
            return
        letter, pid = COMMAND.unpack(data)
        for child in tuple(children):
            if os.waitpid(child, os.WNOHANG)[0]:
                children.discard(child)
        if letter == FORK:
            pid = _fork(knowledge, control, *fds)
            children.add(pid)
            for fd in fds:
                os.close(fd)
        elif pid in children:  # else it has ended, and the id may be that of another process
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            children.discard(pid)
        control.sendall(COMMAND.pack(letter, pid))


def _fork(knowledge: KnowledgeBase, control: socket.socket, connection_fd: int, memory_fd: int) -> int:
    pid = os.fork()
    if not pid:
        try:
            control.close()
            _serve(knowledge, Connection(connection_fd), memory_fd)
        finally:
            os._exit(0)
    return pid
