"""A node of ROS 2 that offers what a `LocalNode` offers: a process with rclpy, and the link to it.

The process is one more client of the node's broker, with the limits of every client. What the node advertises is sent
to it as the operations with which a rosbridge would be told, so that no list of names exists twice. Calls of each
service and goals of each action are those of one caller, since rclpy does not tell callers apart.
"""

from __future__ import annotations

import asyncio
import logging
import mmap
import os
import socket
import struct
import subprocess
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from mindstage.access.limits import CLOSE_TIME, Timeout
from mindstage.access.ports import Discovery
from mindstage.bridge import LocalNode, Refusal
from mindstage.bridge.broker import PLAIN_FORMAT, Peer, ReplyFormat
from mindstage.bridge.protocol import (
    ActionFeedback,
    ActionResult,
    Advertise,
    AdvertiseAction,
    AdvertiseService,
    CallService,
    CancelActionGoal,
    Compression,
    MessageEncoder,
    Operation,
    Publish,
    SendActionGoal,
    ServiceResponse,
    Status,
    StatusLevel,
    Subscribe,
    Unadvertise,
    UnadvertiseAction,
    UnadvertiseService,
    Unsubscribe,
    content,
)
from mindstage.engines import PoseArray
from mindstage.errors import BridgeError, MindstageError, Ros2Error
from mindstage.msgs import message_type
from mindstage.msgs.message_registry import field_layout, is_ros1_only
from mindstage.ranges import DomainId, checked
from mindstage.ros2.environment import Ros2Environment, find_environment
from mindstage.ros2.message_packages import build_message_packages

__all__ = ["PoseMemory", "Ros2Node", "Ros2Parameter"]

_FRAME = struct.Struct("<II")
_STATE = struct.Struct("<QQQ")
_MAX_FRAME_BYTES = 64 << 20
"""Largest header or payload from the process [B]."""
_START_TIME_S = 60.0
"""Longest time in which the process imports rclpy and makes its node [s]."""
_ROW_BYTES = 56
_MEMORY_BYTES = 4 << 20
"""Size of the shared memory; bodies beyond it are read over the link [B]."""
_log = logging.getLogger("mindstage.ros2")


@dataclass(frozen=True, kw_only=True)
class Ros2Parameter:
    """A parameter of the node."""

    name: str
    value: bool | float | str
    description: str
    range: tuple[float, float] | None = None
    set: Callable[[Any], object] | None = field(default=None, repr=False)
    """Called with a new value; raises a `MindstageError` if that is refused. None if it is read-only."""


class PoseMemory:
    """The poses of the latest state in shared memory, written with a sequence lock."""

    def __init__(self) -> None:
        self.fd = os.memfd_create("mindstage-poses")
        os.ftruncate(self.fd, _MEMORY_BYTES)
        self._memory = mmap.mmap(self.fd, _MEMORY_BYTES)
        self._sequence = 0
        self._generation = 0
        self._ids: tuple[str, ...] | None = None
        self._lock = threading.Lock()

    def write(self, ids: tuple[str, ...], poses: PoseArray) -> tuple[int, tuple[str, ...]] | None:
        """Writes poses; returns the generation of the ids if they have changed."""
        with self._lock:
            is_new = ids is not self._ids and ids != self._ids
            self._generation += is_new
            self._ids = ids
            rows = min(len(ids), (_MEMORY_BYTES - _STATE.size) // _ROW_BYTES)
            self._sequence += 1
            _STATE.pack_into(self._memory, 0, self._sequence, self._generation, rows)
            self._memory[_STATE.size : _STATE.size + rows * _ROW_BYTES] = np.ascontiguousarray(
                poses[:rows], dtype="<f8"
            ).tobytes()
            self._sequence += 1
            _STATE.pack_into(self._memory, 0, self._sequence, self._generation, rows)
            return (self._generation, ids) if is_new else None

    def close(self) -> None:
        """Releases the memory."""
        with self._lock:
            self._memory.close()
            os.close(self.fd)


class _Caller(Peer):
    """All callers of one service or action, or the node itself for topics."""

    def __init__(self, owner: Ros2Node, name: str) -> None:
        super().__init__(name)
        self.needs_messages = True
        self._owner = owner
        self._held: deque[tuple[Operation, int]] = deque()

    @property
    def congested(self) -> bool:
        return self._owner.congested

    def deliver(
        self, outgoing: MessageEncoder, reply_format: ReplyFormat = PLAIN_FORMAT, *, sender: Peer | None = None
    ) -> None:
        self._owner.send_operation(outgoing, is_raw=reply_format.compression is Compression.CBOR_RAW)

    def receive(self, operation: Operation, size: int) -> None:
        """Handles a call or goal, in its turn."""
        if self.is_paused:
            self._held.append((operation, size))
        else:
            self._owner.node.broker.handle(self, operation, size)

    def set_paused(self, paused: bool) -> None:
        super().set_paused(paused)
        while self._held and not self.is_paused:
            self.receive(*self._held.popleft())


class Ros2Node:
    """Offers a node's services, actions and topics in ROS 2, from its creation until `close`."""

    @checked
    def __init__(
        self,
        node: LocalNode,
        *,
        environment: Ros2Environment | None = None,
        name: str = "mindstage",
        namespace: str = "/",
        domain: DomainId | None = None,
        discovery: Discovery = Discovery.LOCALHOST,
        ros_args: Sequence[str] = (),
        build_messages: bool = True,
        poses: PoseMemory | None = None,
        parameters: Sequence[Ros2Parameter] = (),
        on_refusal: Callable[[Refusal], object] | None = None,
        on_end: Callable[[str], object] | None = None,
        start_timeout_s: Timeout = _START_TIME_S,
    ) -> None:
        """Starts the process and waits until its node exists; names follow within a second.

        Args:
            environment: the installation of ROS 2; None for the one that `find_environment` finds.
            name: name of the node.
            namespace: its namespace, in which names without a slash are.
            domain: the domain; None for that of ROS_DOMAIN_ID.
            discovery: how far it is seen; the user's ROS_AUTOMATIC_DISCOVERY_RANGE wins.
            ros_args: what may follow `--ros-args`, such as `("-r", "/tf:=/sim/tf")`.
            build_messages: whether message packages that the installation lacks are built (once; some minutes).
            poses: poses from which reads are answered; the caller writes and closes them.
            parameters: parameters of the node.
            on_refusal: called with what cannot be offered, on the bridge's thread; by default it is logged.
            on_end: called with the reason if the process ends before `close`, on the bridge's thread.

        Raises:
            Ros2Error: there is no ROS 2, messages cannot be built, or the process does not start.
        """
        self.node = node
        self.environment = environment or find_environment()
        self.error = ""
        """Why the process has ended; empty while it runs."""
        self.refusals: list[Refusal] = []
        self._on_refusal = on_refusal or (lambda refusal: _log.warning("ROS 2: %s", refusal))
        self._on_end = on_end or (lambda reason: _log.error("ROS 2: %s", reason))
        self._own_poses = poses is None
        self._poses = poses or PoseMemory()
        self._parameters = {each.name: each for each in parameters}
        self._callers: dict[str, _Caller] = {}
        self._peer = _Caller(self, "/ros2")
        self._closed = False
        self._ready: Future[dict[str, Any]] = Future()
        self._writer: asyncio.StreamWriter | None = None
        self._stop_mirroring: Callable[[], None] = lambda: None
        ours, self._process = self._start_process(discovery, build_messages=build_messages)
        self._last_errors: deque[str] = deque(maxlen=20)
        self._log_reader = threading.Thread(target=self._read_log, name="mindstage-ros2-log", daemon=True)
        self._log_reader.start()
        arguments = ["--ros-args", *ros_args] if ros_args and ros_args[0] != "--ros-args" else list(ros_args)
        setup = {"op": "setup", "name": name, "namespace": namespace, "ros_args": arguments, "domain": domain}
        try:
            node.run(self._open(ours, setup))
            self.facts: Mapping[str, Any] = self._ready.result(start_timeout_s)
        except TimeoutError:
            self.close()
            raise Ros2Error(f"the process of the node did not start within {start_timeout_s:g} s") from None
        except BaseException:
            self.close()
            raise

    def _start_process(
        self, discovery: Discovery, *, build_messages: bool
    ) -> tuple[socket.socket, subprocess.Popen[bytes]]:
        """Starts the process; returns this side of the link to it."""
        packages: tuple[Path, ...] = ()
        if build_messages:
            packages = tuple(dict.fromkeys(build_message_packages(self.environment).values()))
        variables = self.environment.variables(*packages)
        variables.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", _RANGES[discovery])
        variables.pop("PYTHONHOME", None)
        ours, theirs = socket.socketpair()
        program = Path(__file__).with_name("node_process.py")
        with theirs:
            process = subprocess.Popen(
                (str(self.environment.python), "-u", str(program), str(theirs.fileno()), str(self._poses.fd)),
                env=variables,
                pass_fds=(theirs.fileno(), self._poses.fd),
                stdin=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                start_new_session=True,
            )
        return ours, process

    # -- any thread ----------------------------------------------------------------------------------------------------

    @property
    def pid(self) -> int:
        """The id of the process."""
        return self._process.pid

    def write_poses(self, ids: tuple[str, ...], poses: PoseArray) -> None:
        """Sets the poses from which reads are answered."""
        if self._closed:
            return
        if (new := self._poses.write(ids, poses)) is not None:
            generation, ids = new
            self.node.call_soon(self._send, {"op": "ids", "generation": generation}, msgspec.json.encode(ids))

    def set_parameter(self, name: str, value: bool | float | str) -> None:
        """Sets the value of a parameter that has changed in the simulation."""
        self.node.call_soon(self._send, {"op": "parameter", "name": name, "value": value})

    def close(self) -> None:
        """Ends the process: calls are answered, goals aborted; calling it again is harmless."""
        if self._closed:
            return
        self._closed = True
        if not self.node.closed:
            with suppress(BridgeError):
                self.node.run(self._shut())
        try:
            self._process.wait(CLOSE_TIME.maximum)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(CLOSE_TIME.maximum)
        self._log_reader.join(CLOSE_TIME.maximum)
        if self._own_poses:
            self._poses.close()

    def __enter__(self) -> Ros2Node:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- on the loop ---------------------------------------------------------------------------------------------------

    @property
    def congested(self) -> bool:
        """Whether the process reads more slowly than messages are sent to it."""
        return self._writer is not None and self._writer.transport.get_write_buffer_size() > 1 << 20

    def send_operation(self, outgoing: MessageEncoder, *, is_raw: bool) -> None:
        """Sends an operation of the broker to the process."""
        match outgoing.operation:
            case Publish() as message:
                payload = outgoing.serialized if is_raw else bytes(message.msg)
                self._send({"op": "publish", "topic": message.topic, "raw": is_raw}, payload)
            case ServiceResponse() as response:
                self._send(
                    {"op": "service_response", "id": response.id, "service": response.service},
                    bytes(content(response.values)),
                )
            case ActionFeedback() as feedback:
                self._send(
                    {"op": "action_feedback", "id": feedback.id, "action": feedback.action},
                    bytes(content(feedback.values)),
                )
            case ActionResult() as result:
                self._send(
                    {"op": "action_result", "id": result.id, "action": result.action, "status": int(result.status)},
                    bytes(content(result.values)),
                )
            case Status() as status if status.level is StatusLevel.ERROR:
                _log.warning("ROS 2: %s", status.msg)

    def _mirror(self, operation: Operation) -> None:
        """Tells the process what the node advertises now."""
        header: dict[str, Any] | None = None
        match operation:
            case AdvertiseService(service=name, type=type):
                header = {"service": name, "type": type}
            case UnadvertiseService(service=name):
                header, type = {"service": name}, ""
            case AdvertiseAction(action=name, type=type):
                header = {"action": name, "type": type}
            case UnadvertiseAction(action=name):
                header, type = {"action": name}, ""
            case Advertise(topic=name, type=type, latch=latch) if not is_ros1_only(type):
                layout = field_layout(message_type(type))
                header = {"topic": name, "type": type, "latch": latch, "layout": layout, "qos": _qos(type, latch=latch)}
            case Subscribe(topic=name, type=str(type)) if not is_ros1_only(type):
                header = {"topic": name, "type": type, "qos": _qos(type, latch=False)}
            case Unadvertise(topic=name) | Unsubscribe(topic=name):
                header, type = {"topic": name}, ""
        if header is not None and not is_ros1_only(type):
            self._send({"op": str(operation.__struct_config__.tag), **header})

    def _send(self, header: Mapping[str, Any], payload: bytes = b"") -> None:
        if self._writer is not None and not self._writer.is_closing():
            data = msgspec.json.encode(header)
            self._writer.write(_FRAME.pack(len(data), len(payload)) + data + payload)

    async def _open(self, link: socket.socket, setup: Mapping[str, Any]) -> None:
        link.setblocking(False)
        reader, self._writer = await asyncio.open_connection(sock=link, limit=1 << 20)
        self._send(setup)
        for each in self._parameters.values():
            header = {"op": "parameter", "name": each.name, "value": each.value, "description": each.description}
            self._send(header | {"range": each.range, "read_only": False})
        self.node.broker.add_peer(self._peer)
        self._task = asyncio.get_running_loop().create_task(self._read(reader))

    async def _read(self, reader: asyncio.StreamReader) -> None:
        try:
            while True:
                length, more = _FRAME.unpack(await reader.readexactly(_FRAME.size))
                if max(length, more) > _MAX_FRAME_BYTES:
                    break
                header = msgspec.json.decode(await reader.readexactly(length))
                payload = await reader.readexactly(more)
                try:
                    self._handle(header, payload)
                except MindstageError as error:
                    _log.warning("ROS 2: %s", error)
                    self._answer_refused(header, str(error))
        except (asyncio.IncompleteReadError, OSError):
            pass
        finally:
            self._end()

    def _handle(self, header: dict[str, Any], payload: bytes) -> None:
        size = len(payload)
        match header["op"]:
            case "call_service":
                call = CallService(id=header["id"], service=header["service"], args=msgspec.Raw(payload))
                self._caller(header["service"]).receive(call, size)
            case "send_action_goal":
                goal = SendActionGoal(
                    id=header["id"],
                    action=header["action"],
                    action_type=header["action_type"],
                    args=msgspec.Raw(payload),
                    feedback=True,
                )
                self._caller(header["action"]).receive(goal, size)
            case "cancel_action_goal":
                cancel = CancelActionGoal(id=header["id"], action=header["action"])
                self._caller(header["action"]).receive(cancel, size)
            case "publish":
                name = header["topic"]
                self._caller(name).receive(Publish(topic=name, msg=msgspec.Raw(payload)), size)
            case "subscribe":
                compression = Compression.CBOR_RAW if header["raw"] else Compression.NONE
                request = Subscribe(id=header["topic"], topic=header["topic"], compression=compression)
                self.node.broker.handle(self._peer, request, size)
            case "unsubscribe":
                request_end = Unsubscribe(id=header["topic"], topic=header["topic"])
                self.node.broker.handle(self._peer, request_end, size)
            case "ready":
                self._stop_mirroring = self.node.mirror(self._mirror)
                self._ready.set_result(header)
            case "refused":
                self._report(
                    Refusal(
                        operation=header["operation"],
                        name=header["name"],
                        cause=header["cause"],
                        package=header["package"],
                    )
                )
            case "fields":
                _log.info("ROS 2: %s", header)
            case "set_parameter":
                threading.Thread(target=self._set, args=(header,), name="mindstage-ros2-set", daemon=True).start()

    def _caller(self, name: str) -> _Caller:
        return self._callers.setdefault(name, _Caller(self, f"/ros2{name}"))

    def _answer_refused(self, header: Mapping[str, Any], cause: str) -> None:
        values = msgspec.json.encode(cause)
        if header["op"] == "call_service":
            self._send({"op": "service_response", "id": header["id"], "service": header["service"]}, values)
        elif header["op"] == "send_action_goal":
            end = {"op": "action_result", "id": header["id"], "action": header["action"], "status": 6}
            self._send(end, values)

    def _set(self, header: Mapping[str, Any]) -> None:
        """Sets a parameter on request of a client; in a thread, since the simulation may be busy."""
        parameter, reason = self._parameters.get(header["name"]), ""
        if parameter is None or parameter.set is None:
            reason = f"{header['name']} is read-only"
        else:
            try:
                parameter.set(header["value"])
            except MindstageError as error:
                reason = str(error)
        self.node.call_soon(self._send, {"op": "parameter_set", "id": header["id"], "reason": reason})

    def _report(self, refusal: Refusal) -> None:
        if refusal.package and any(each.package == refusal.package for each in self.refusals):
            return  # a missing package is reported once
        self.refusals.append(refusal)
        self._on_refusal(refusal)

    def _end(self) -> None:
        """Withdraws the calls and cancels the goals of a process that has ended."""
        self._stop_mirroring()
        self.node.broker.remove_peer(self._peer)
        for caller in self._callers.values():
            caller.has_left = True
            self.node.broker.services.remove_peer(caller)
            self.node.broker.actions.remove_peer(caller)
            self.node.broker.topics.remove_peer(caller)
        self._callers.clear()
        if self._writer is not None:
            self._writer.close()
        if self._closed:
            return
        errors = [line for line in self._last_errors if "Error" in line or "error" in line] or list(self._last_errors)
        self.error = f"the process of the node has ended{f': {errors[-1]}' if errors else ''}"
        if not self._ready.done():
            self._ready.set_exception(Ros2Error(self.error))
        else:
            self._on_end(self.error)

    async def _shut(self) -> None:
        self._stop_mirroring()
        self._send({"op": "close"})
        if self._writer is not None:
            with suppress(OSError, TimeoutError):
                await asyncio.wait_for(self._writer.drain(), CLOSE_TIME.maximum)
        with suppress(TimeoutError, asyncio.CancelledError):
            await asyncio.wait_for(asyncio.shield(self._task), CLOSE_TIME.maximum)

    def _read_log(self) -> None:
        """Logs what the process prints."""
        assert self._process.stderr is not None
        with self._process.stderr as lines:
            for line in lines:
                text = line.decode(errors="replace").rstrip()
                self._last_errors.append(text)
                _log.info("node: %s", text)


_RANGES = {Discovery.LOCALHOST: "LOCALHOST", Discovery.SUBNET: "SUBNET", Discovery.SYSTEM: "SYSTEM_DEFAULT"}


@cache
def _qos(type: str, *, latch: bool) -> Mapping[str, object]:
    """The quality of service of a topic, by the conventions of REP 2003 and of rclcpp's ClockQoS."""
    short = type.partition("/")[0], type.rpartition("/")[2]
    if latch:
        return {"depth": 1, "reliable": True, "latched": True}
    if short == ("rosgraph_msgs", "Clock"):
        return {"depth": 1, "reliable": False, "latched": False}
    if short[0] == "sensor_msgs" and short[1] != "JointState":
        return {"depth": 5, "reliable": False, "latched": False}
    return {"depth": 100 if short == ("tf2_msgs", "TFMessage") else 10, "reliable": True, "latched": False}
