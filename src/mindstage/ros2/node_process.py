"""The program of the process that is the ROS 2 node; `Ros2Node` starts it with the Python of a ROS 2 installation.

It imports only the standard library, numpy and rclpy, and nothing of Mindstage: that Python may be 3.10 to 3.14. It has
no list of names. All services, actions, topics and parameters arrive over the link, as the operations of rosbridge with
which the simulation's node advertises them; calls and goals go back as operations. Poses are read from shared memory.

A frame of the link is the length of the header and of the payload (two little-endian uint32), the header (JSON), and
the payload: a message as JSON, or as CDR where the installed type has the fields of the simulation's.
"""

from __future__ import annotations

import base64
import importlib
import json
import mmap
import queue
import signal
import socket
import struct
import sys
import threading
import time
from array import array
from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np

try:
    import rclpy
    from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
    from rclpy.action import ActionServer, CancelResponse, GoalResponse
    from rclpy.impl.implementation_singleton import rclpy_implementation as rclpy_core
    from rclpy.node import Node
    from rclpy.parameter import Parameter
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
except ImportError:  # documentation tools read this file without ROS 2
    rclpy = None

__all__ = ["main"]

FRAME = struct.Struct("<II")
SERVICE_DEPTH = 1000
"""Requests that wait in the middleware; with rmw's default of 10, those of many clients at once are lost."""
STATE = struct.Struct("<QQQ")
"""Begin of the shared memory: a sequence number, which is odd during a write, the generation of ids, and the count."""
TURN = 64
"""Requests of one service, or messages of one topic, that are handled before others."""
FLUSH_S = 0.2
"""Time for the middleware to send the last answers [s]."""
ANSWER_TIME_S = 2.0
"""Longest time for which setting a parameter waits for the simulation [s]."""


# -- messages and plain values -----------------------------------------------------------------------------------------


def interface_class(type_name: Any, kind: Any) -> Any:
    """Returns the class of an interface such as `std_msgs/String` or `std_msgs/msg/String`."""
    package, short = type_name.split("/")[0], type_name.split("/")[-1]
    return getattr(importlib.import_module(f"{package}.{kind}"), short)


def layout(cls: Any) -> list[Any]:
    """Returns the fields of a message type as nested lists of name and type, to be compared with another's."""
    return [
        [name, type_name, layout(nested) if (nested := _nested_class(cls, type_name)) else None]
        for name, type_name in cls.get_fields_and_field_types().items()
    ]


def wire_layout(fields: Any) -> Any:
    """Returns a layout without differences that CDR does not have: signs, and whether eight bits are a number."""
    signless = {"uint32": "int32", "octet": "uint8"}
    return [
        [name, signless.get(type_name, type_name), nested and wire_layout(nested)] for name, type_name, nested in fields
    ]


def _element(type_name: Any) -> tuple[str, bool]:
    """The type of the elements of an array, or the type itself, and whether it is an array."""
    if type_name.startswith("sequence<"):
        return type_name[9:-1].split(",")[0].strip(), True
    if type_name.endswith("]"):
        return type_name[: type_name.rindex("[")], True
    return type_name, False


def _nested_class(cls: Any, type_name: Any) -> Any:
    element = _element(type_name)[0]
    return interface_class(element, "msg") if "/" in element else None


_codecs: dict[Any, list[Any]] = {}


def _octet(value: Any) -> bytes:
    return value if isinstance(value, bytes) else bytes([int(value)])


def _conversion(element: str) -> Any:
    """The function that makes a value of a primitive type from one of JSON."""
    if element.startswith(("string", "wstring")):
        return str
    return {"boolean": bool, "float": float, "double": float, "octet": _octet}.get(element, int)


def _fields(cls: Any) -> list[Any]:
    """Of each field: the name, the class of a message, whether it is an array, whether it has bytes, the conversion."""
    found = _codecs.get(cls)
    if found is None:
        found = []
        for name, type_name in cls.get_fields_and_field_types().items():
            element, is_array = _element(type_name)
            convert = _conversion(element)
            found.append((name, _nested_class(cls, type_name), is_array, element in ("uint8", "octet"), convert))
        _codecs[cls] = found
    return found


def to_values(message: Any) -> dict[str, Any]:
    """Converts a message to values for JSON; byte arrays are base64, as in rosbridge."""
    values: dict[str, Any] = {}
    for name, nested, is_array, is_bytes, _ in _fields(type(message)):
        value = getattr(message, name)
        if nested is not None:
            values[name] = [to_values(each) for each in value] if is_array else to_values(value)
        elif is_array and is_bytes:
            data = (
                b"".join(value) if isinstance(value, list) and value and isinstance(value[0], bytes) else bytes(value)
            )
            values[name] = base64.b64encode(data).decode()
        elif is_array:
            values[name] = value.tolist() if isinstance(value, (np.ndarray, array)) else list(value)
        else:
            values[name] = value[0] if isinstance(value, bytes) else value
    return values


def to_message(cls: Any, values: Any) -> Any:
    """Converts values to a message; a missing field keeps its default, and one that the type lacks is left out."""
    message = cls()
    for name, nested, is_array, is_bytes, convert in _fields(cls):
        if name not in values:
            continue
        value = values[name]
        if nested is not None:
            value = [to_message(nested, each) for each in value] if is_array else to_message(nested, value)
        elif is_array and is_bytes and isinstance(value, str):
            value = array("B", base64.b64decode(value))
        elif is_array:
            value = [convert(each) for each in value]
        else:
            value = convert(value)
        setattr(message, name, value)
    return message


# -- the link ----------------------------------------------------------------------------------------------------------


class Link:
    """Frames to and from the simulation; sending never blocks the executor."""

    def __init__(self, fd: Any) -> None:
        self._socket = socket.socket(fileno=fd)
        self._outgoing: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._writer = threading.Thread(target=self._write, name="link-writer", daemon=True)
        self._writer.start()

    def send(self, header: Any, payload: bytes = b"") -> None:
        """Queues a frame."""
        data = json.dumps(header, separators=(",", ":")).encode()
        self._outgoing.put(FRAME.pack(len(data), len(payload)) + data + payload)

    def frames(self) -> Iterator[tuple[dict[str, Any], bytes]]:
        """Yields the frames until the simulation has ended."""
        file = self._socket.makefile("rb", buffering=1 << 16)
        while True:
            try:
                sizes = file.read(FRAME.size)
                if len(sizes) < FRAME.size:
                    return
                length, more = FRAME.unpack(sizes)
                header, payload = file.read(length), file.read(more)
            except OSError:
                return
            if len(header) + len(payload) < length + more:
                return
            yield json.loads(header), payload

    def _write(self) -> None:
        while True:
            try:
                self._socket.sendall(self._outgoing.get())
            except OSError:
                return


class SharedPoses:
    """The poses of the latest state, in shared memory with a sequence lock."""

    def __init__(self, fd: Any) -> None:
        self._memory = mmap.mmap(fd, 0, prot=mmap.PROT_READ)
        self._rows: dict[str, int] = {}
        self._generation = -1

    def set_ids(self, generation: Any, ids: Any) -> None:
        """Sets the ids of the rows, and the generation of the poses that have these rows."""
        self._rows, self._generation = {id: row for row, id in enumerate(ids)}, generation

    def row(self, id: Any) -> Any:
        """Returns position and quaternion (w, x, y, z) of a body; None if the simulation has to be asked."""
        index = self._rows.get(id)
        if index is None:
            return None
        for _ in range(100):
            before, generation, count = STATE.unpack_from(self._memory, 0)
            if generation != self._generation or index >= count:
                return None
            row = struct.unpack_from("<7d", self._memory, STATE.size + 56 * index)
            if not before % 2 and STATE.unpack_from(self._memory, 0)[0] == before:
                return row
        return None


# -- the node ----------------------------------------------------------------------------------------------------------


def run(coroutine: Any) -> None:
    """Runs a coroutine of rclpy that never waits, since all callbacks are plain functions."""
    try:
        coroutine.send(None)
    except StopIteration:
        return
    coroutine.close()
    raise RuntimeError("a callback waits")


class _Deferred:
    """The answer of a service that the simulation sends later."""

    def __init__(self, request: Any) -> None:
        self.request = request


class _Service:
    """A service of the simulation."""

    def __init__(self, process: Any, name: Any, type_name: Any) -> None:
        self.name = name
        self._process = process
        self._type = interface_class(type_name, "srv")
        self._pending: dict[str, Any] = {}
        # The response of a read is filled in here; all others are sent by `answer`.
        self._reads_pose = (type_name.split("/")[0], type_name.split("/")[-1]) == ("world_control_msgs", "GetModelPose")
        qos = QoSProfile(depth=SERVICE_DEPTH, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.RELIABLE)
        self.entity = process.node.create_service(self._type, name, self._on_request, qos_profile=qos)
        self._send = self.entity.send_response
        self.entity.send_response = self._respond

    def _on_request(self, request: Any, response: Any) -> Any:
        if self._reads_pose and (row := self._process.poses.row(request.id)) is not None:
            pose = response.pose
            pose.position.x, pose.position.y, pose.position.z = row[0], row[1], row[2]
            rotation = pose.orientation
            rotation.w, rotation.x, rotation.y, rotation.z = row[3], row[4], row[5], row[6]
            response.success = True
            return response
        return _Deferred(request)

    def _respond(self, response: Any, header: Any) -> None:
        if not isinstance(response, _Deferred):
            self._send(response, header)
            return
        id = self._process.next_id()
        self._pending[id] = header
        payload = json.dumps(to_values(response.request)).encode()
        self._process.link.send({"op": "call_service", "id": id, "service": self.name}, payload)

    def answer(self, id: Any, payload: Any) -> None:
        """Sends the response of the simulation, whose values are an object unless the call failed."""
        header = self._pending.pop(id, None)
        if header is not None:
            values = json.loads(payload or b"{}")
            if not isinstance(values, dict):
                self._process.node.get_logger().error(f"{self.name}: {values}")
                values = {}
            self._send(to_message(self._type.Response, values), header)

    def fail_all(self, reason: Any) -> None:
        """Answers all calls that wait, since no answer will come."""
        waiting, self._pending = self._pending, {}
        for header in waiting.values():
            self._send(to_message(self._type.Response, _failure(self._type.Response, reason)), header)


def _failure(cls: Any, reason: Any) -> dict[str, Any]:
    """The values of a response that says why there is none, as far as its type can."""
    fields = cls.get_fields_and_field_types()
    if fields.get("result") == "simulation_interfaces/Result":
        return {"result": {"result": 4, "error_message": reason}}
    if fields.get("refusal") == "mindstage_msgs/Refusal":
        return {"refusal": {"code": "connection_lost", "text": reason}}
    return {"message": reason} if fields.get("message") == "string" else {}


class _Action:
    """An action of the simulation."""

    def __init__(self, process: Any, name: Any, type_name: Any) -> None:
        self.name = name
        self._process = process
        self._type_name = type_name
        self._type = interface_class(type_name, "action")
        self._goals: dict[str, Any] = {}
        self.entity = ActionServer(
            process.node,
            self._type,
            name,
            execute_callback=lambda goal: self._type.Result(),
            goal_callback=lambda _: GoalResponse.ACCEPT,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
        )

    def _on_accepted(self, goal: Any) -> None:
        id = bytes(goal.goal_id.uuid).hex()
        self._goals[id] = goal
        goal._update_state(rclpy_core.GoalEvent.EXECUTE)
        header = {"op": "send_action_goal", "id": id, "action": self.name, "action_type": self._type_name}
        self._process.link.send(header | {"feedback": True}, json.dumps(to_values(goal.request)).encode())

    def _on_cancel(self, goal: Any) -> Any:
        id = bytes(goal.goal_id.uuid).hex()
        if id not in self._goals:
            return CancelResponse.REJECT
        self._process.link.send({"op": "cancel_action_goal", "id": id, "action": self.name})
        return CancelResponse.ACCEPT

    def feedback(self, id: Any, payload: Any) -> None:
        """Sends feedback of a goal."""
        goal = self._goals.get(id)
        if goal is not None:
            goal.publish_feedback(to_message(self._type.Feedback, json.loads(payload or b"{}")))

    def end(self, id: Any, status: Any, payload: Any) -> None:
        """Ends a goal with its result."""
        goal = self._goals.pop(id, None)
        if goal is None:
            return
        values = json.loads(payload or b"{}")
        if not isinstance(values, dict):
            self._process.node.get_logger().error(f"{self.name}: {values}")
            values = {}

        def finish(goal_handle: Any) -> Any:
            if status == 4:
                goal_handle.succeed()
            elif status == 5 and goal_handle.is_cancel_requested:
                goal_handle.canceled()
            else:
                goal_handle.abort()
            return to_message(self._type.Result, values)

        run(self.entity._execute_goal(finish, goal))

    def fail_all(self, reason: Any) -> None:
        """Aborts all goals, since no result will come."""
        for id in list(self._goals):
            self.end(id, 6, json.dumps(reason).encode())


class _Publication:
    """A topic that the simulation publishes; it is asked for messages while there are subscribers."""

    def __init__(self, process: Any, header: Any) -> None:
        self.topic = header["topic"]
        self._process = process
        self._type = interface_class(header["type"], "msg")
        self._is_raw = wire_layout(layout(self._type)) == wire_layout(header["layout"])
        self.is_latched = header.get("latch", False)
        self._is_wanted = False
        self.entity = process.node.create_publisher(self._type, self.topic, _qos(header["qos"]))
        if not self._is_raw:
            process.note_different_fields(header["type"], self._type, header["layout"])
        if self.is_latched:
            self._ask(True)

    def update(self) -> None:
        """Asks for messages if there are subscribers, and else for none."""
        if not self.is_latched:
            self._ask(self.entity.get_subscription_count() > 0)

    def _ask(self, is_wanted: Any) -> None:
        if is_wanted != self._is_wanted:
            self._is_wanted = is_wanted
            header = {"op": "subscribe" if is_wanted else "unsubscribe", "topic": self.topic}
            self._process.link.send(header | {"raw": self._is_raw})

    def publish(self, header: Any, payload: Any) -> None:
        """Publishes a message of the simulation."""
        self.entity.publish(payload if header["raw"] else to_message(self._type, json.loads(payload)))


def _qos(options: Any) -> Any:
    return QoSProfile(
        depth=options["depth"],
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE if options["reliable"] else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if options["latched"] else DurabilityPolicy.VOLATILE,
    )


class NodeProcess:
    """The node, and everything that the simulation offers by it."""

    POLL_S = 0.1
    """Interval at which subscribers are counted [s]; rclpy has no event for them in all distributions."""

    def __init__(self, link: Any, memory_fd: Any) -> None:
        self.link = link
        self.poses = SharedPoses(memory_fd)
        self.node: Any = None
        self._ids = iter(range(1, sys.maxsize))
        self._services: dict[str, Any] = {}
        self._actions: dict[str, Any] = {}
        self._publications: dict[str, Any] = {}
        self._subscriptions: dict[str, Any] = {}
        self._parameters: dict[str, Any] = {}
        self._answers: dict[str, Any] = {}
        self._different: set[str] = set()
        self._updating = False
        self._operations: deque[tuple[dict[str, Any], bytes]] = deque()
        self._guard: Any = None
        self._handlers = {name[4:]: getattr(self, name) for name in dir(self) if name.startswith("_op_")}

    def next_id(self) -> str:
        """Returns the id of a new call."""
        return str(next(self._ids))

    def run(self) -> None:
        """Runs the node until the simulation closes it, or has ended."""
        frames = self.link.frames()
        setup, _ = next(frames)
        rclpy.init(args=["mindstage", *setup["ros_args"]], domain_id=setup["domain"])
        self.node = Node(
            setup["name"], namespace=setup["namespace"], automatically_declare_parameters_from_overrides=False
        )
        self.node.add_on_set_parameters_callback(self._on_set_parameters)
        self._guard = rclpy_core.GuardCondition(self.node.context.handle)
        self.node.context.on_shutdown(self._guard.trigger_guard_condition)
        reader = threading.Thread(target=self._read, args=(frames,), name="link-reader", daemon=True)
        reader.start()
        self.link.send(
            {
                "op": "ready",
                "node": self.node.get_fully_qualified_name(),
                "domain": self.node.context.get_domain_id(),
            }
        )
        try:
            self._spin()
        finally:
            rclpy.try_shutdown()

    def _read(self, frames: Any) -> None:
        """Queues the operations of the simulation for the thread of the node; on a thread of its own."""
        for header, payload in frames:
            if header["op"] == "parameter_set":  # the node's thread waits for it
                if (answer := self._answers.get(header["id"])) is not None:
                    answer.put(header["reason"])
                continue
            self._operations.append((header, payload))
            self._guard.trigger_guard_condition()
        self._operations.append(({"op": "close"}, b""))
        self._guard.trigger_guard_condition()

    def _spin(self) -> None:
        """Handles operations, calls, messages and goals, until the simulation has ended.

        rclpy's executors visit every entity in Python for each event, which costs milliseconds with hundreds of
        services; the executor that does not is new, and blocks when another thread creates an entity.
        """
        wait_set: Any = None
        sizes: list[int] = []
        next_poll_s = 0.0
        while rclpy.ok():
            while self._operations:
                header, payload = self._operations.popleft()
                if header["op"] == "close":
                    self._fail_all("the simulation has ended")
                    return
                self._handle(header, payload)
            node = self.node
            services, subscriptions, waitables = list(node.services), list(node.subscriptions), list(node.waitables)
            counts = [len(subscriptions), 1, 0, 0, len(services), 0]
            for waitable in waitables:
                each = waitable.get_num_entities()
                counts = [
                    counts[0] + each.num_subscriptions,
                    counts[1] + each.num_guard_conditions,
                    counts[2] + each.num_timers,
                    counts[3] + each.num_clients,
                    counts[4] + each.num_services,
                    counts[5] + each.num_events,
                ]
            if counts != sizes:
                wait_set, sizes = rclpy_core.WaitSet(*counts, node.context.handle), counts
            wait_set.clear_entities()
            for each in subscriptions:
                wait_set.add_subscription(each.handle)
            for each in services:
                wait_set.add_service(each.handle)
            wait_set.add_guard_condition(self._guard)
            for each in waitables:
                each.add_to_wait_set(wait_set)
            now_s = time.monotonic()
            if now_s >= next_poll_s:
                next_poll_s = now_s + self.POLL_S
                for publication in list(self._publications.values()):
                    publication.update()
            if not self._operations:
                wait_set.wait(int(max(0.0, next_poll_s - time.monotonic()) * 1e9))
                self._run_ready(wait_set, services, subscriptions, waitables)

    def _run_ready(self, wait_set: Any, services: Any, subscriptions: Any, waitables: Any) -> None:
        ready_services = wait_set.get_ready_entities("service")
        ready_subscriptions = wait_set.get_ready_entities("subscription")
        for waitable in [each for each in waitables if each.is_ready(wait_set)]:
            self._guarded(waitable, lambda each=waitable: run(each.execute(each.take_data())))
        for service in services if ready_services else ():
            if service.handle.pointer in ready_services:
                self._guarded(service, lambda each=service: self._take_requests(each))
        for subscription in subscriptions if ready_subscriptions else ():
            if subscription.handle.pointer in ready_subscriptions:
                self._guarded(subscription, lambda each=subscription: self._take_messages(each))

    def _guarded(self, entity: Any, function: Any) -> None:
        try:
            function()
        except Exception as error:  # one request must not end the node
            name = getattr(entity, "srv_name", getattr(entity, "topic_name", type(entity).__name__))
            self.node.get_logger().error(f"{name}: {type(error).__name__}: {error}")

    def _take_requests(self, service: Any) -> None:
        for _ in range(TURN):
            request, header = service.handle.service_take_request(service.srv_type.Request)
            if header is None:
                return
            service.send_response(service.callback(request, service.srv_type.Response()), header)

    def _take_messages(self, subscription: Any) -> None:
        for _ in range(TURN):
            found = subscription.handle.take_message(subscription.msg_type, subscription.raw)
            if found is None:
                return
            subscription.callback(found[0])

    def _fail_all(self, reason: Any) -> None:
        for each in (*self._services.values(), *self._actions.values()):
            self._guarded(each, lambda each=each: each.fail_all(reason))
        time.sleep(FLUSH_S)

    def _handle(self, header: Any, payload: Any) -> None:
        handler = self._handlers.get(header["op"])
        try:
            if handler is not None:
                handler(header, payload)
        except Exception as error:  # one name or message must not end the node
            self._refuse(header, error)

    def _refuse(self, header: Any, error: Any) -> None:
        name = header.get("service") or header.get("action") or header.get("topic") or header.get("name", "")
        package = getattr(error, "name", "") or "" if isinstance(error, ModuleNotFoundError) else ""
        cause = f"{type(error).__name__}: {error}"
        if package:
            cause = f"the package {package.partition('.')[0]} is not installed"
        self.link.send(
            {"op": "refused", "operation": header["op"], "name": name, "cause": cause, "package": package.split(".")[0]}
        )

    def note_different_fields(self, name: Any, cls: Any, known: Any) -> None:
        """Reports once which fields an installed type has more or less than the simulation's."""
        if name in self._different:
            return
        self._different.add(name)
        own, other = cls.get_fields_and_field_types(), {field[0] for field in known}
        less, more = sorted(other - set(own)), sorted(set(own) - other)
        self.link.send({"op": "fields", "type": name, "missing": less, "defaulted": more})

    # -- operations of the simulation; on the reader's thread ----------------------------------------------------------

    def _op_advertise_service(self, header: Any, _: Any) -> None:
        if header["service"] not in self._services:
            self._services[header["service"]] = _Service(self, header["service"], header["type"])

    def _op_unadvertise_service(self, header: Any, _: Any) -> None:
        service = self._services.pop(header["service"], None)
        if service is not None:
            service.fail_all("the service was withdrawn")
            self.node.destroy_service(service.entity)

    def _op_advertise_action(self, header: Any, _: Any) -> None:
        if header["action"] not in self._actions:
            self._actions[header["action"]] = _Action(self, header["action"], header["type"])

    def _op_unadvertise_action(self, header: Any, _: Any) -> None:
        action = self._actions.pop(header["action"], None)
        if action is not None:
            action.fail_all("the action was withdrawn")
            action.entity.destroy()

    def _op_advertise(self, header: Any, _: Any) -> None:
        known = self._publications.get(header["topic"])
        if known is None:
            self._publications[header["topic"]] = _Publication(self, header)

    def _op_unadvertise(self, header: Any, _: Any) -> None:
        publication = self._publications.pop(header["topic"], None)
        if publication is not None:
            self.node.destroy_publisher(publication.entity)

    def _op_subscribe(self, header: Any, _: Any) -> None:
        topic = header["topic"]
        if topic in self._subscriptions:
            return
        cls = interface_class(header["type"], "msg")

        def on_message(message: Any) -> None:
            self.link.send({"op": "publish", "topic": topic}, json.dumps(to_values(message)).encode())

        self._subscriptions[topic] = self.node.create_subscription(cls, topic, on_message, _qos(header["qos"]))

    def _op_unsubscribe(self, header: Any, _: Any) -> None:
        subscription = self._subscriptions.pop(header["topic"], None)
        if subscription is not None:
            self.node.destroy_subscription(subscription)

    def _op_publish(self, header: Any, payload: Any) -> None:
        publication = self._publications.get(header["topic"])
        if publication is not None:
            publication.publish(header, payload)

    def _op_service_response(self, header: Any, payload: Any) -> None:
        service = self._services.get(header["service"])
        if service is not None:
            service.answer(header["id"], payload)

    def _op_action_feedback(self, header: Any, payload: Any) -> None:
        action = self._actions.get(header["action"])
        if action is not None:
            action.feedback(header["id"], payload)

    def _op_action_result(self, header: Any, payload: Any) -> None:
        action = self._actions.get(header["action"])
        if action is not None:
            action.end(header["id"], header["status"], payload)

    def _op_ids(self, header: Any, payload: Any) -> None:
        self.poses.set_ids(header["generation"], json.loads(payload))

    def _op_parameter(self, header: Any, _: Any) -> None:
        name, value = header["name"], header["value"]
        self._updating = True
        try:
            if name in self._parameters:
                self.node.set_parameters([Parameter(name, value=value)])
                return
            descriptor = ParameterDescriptor(description=header["description"], read_only=header["read_only"])
            if header["range"] is not None:
                low, high = header["range"]
                descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
            self._parameters[name] = header
            self.node.declare_parameter(name, value, descriptor)
        finally:
            self._updating = False

    def _on_set_parameters(self, parameters: Any) -> Any:
        if self._updating:
            return SetParametersResult(successful=True)
        for each in parameters:
            if each.name not in self._parameters:
                continue
            answer: queue.SimpleQueue[str] = queue.SimpleQueue()
            id = self.next_id()
            self._answers[id] = answer
            self.link.send({"op": "set_parameter", "id": id, "name": each.name, "value": each.value})
            try:
                reason = answer.get(timeout=ANSWER_TIME_S)
            except queue.Empty:
                reason = "the simulation does not respond"
            finally:
                del self._answers[id]
            if reason:
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)


def main() -> int:
    """Runs the node; the file descriptors of the link and of the shared memory are the arguments."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the simulation, which closes this process
    NodeProcess(Link(int(sys.argv[1])), int(sys.argv[2])).run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
