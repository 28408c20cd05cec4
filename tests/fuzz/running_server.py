"""A fuzzer of a running `mindstage serve`: all of its ports at once, and then whether it still works.

Requests are made from the types that the running servers declare, with odd numbers, names of files and code, and a part
of them is corrupted. What is sent follows from the seed; what happens depends on timing, too.
"""

from __future__ import annotations

import base64
import json
import os
import random
import secrets
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec
import viser
from msgspec import inspect
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from mindstage.episodes.mcap_file import CONTENTS_FOLDER
from mindstage.maps.io.files import bundled_kitchen
from mindstage.msgs.message_registry import action_types, message_types, service_types
from tests.bridge.test_hostile import random_frame
from tests.conftest import ROOT
from tests.maps.corruption import corrupted
from tests.viewer.page_client import PageClient, RequestFailedError

__all__ = ["RunningServer", "ServerFuzzer"]

START_TIMEOUT_S = 180.0
ANSWER_TIMEOUT_S = 60.0
"""Within this time the server answers after a burst, on a machine that does other things, too [s]."""
STRINGS = (
    "", "fridge", "milk_carton", "Cup", "Mug", "map", "base_link", "no_such_body", "/etc/passwd", "../../etc/passwd",
    "file:///etc/passwd", "package://../x.stl", "http://127.0.0.1:9/x.owl", "x" * 3000, "\x00", "\u2028", "é\U0001f600",
    "<img src=x onerror=alert(1)>", "red", "#12345", "0.1 0.2 0.3", "storage_place", "member(X, [1,2])", "ASK {}",
    "SELECT * { ?s ?p ?o } LIMIT 3", "shell('touch PWNED')", "LOAD <http://127.0.0.1:9/x>", "nan", "1e999",
    "SELECT * { SERVICE <http://192.0.2.1/> { ?s ?p ?o } }", "<robot name='r'><link name='${(lambda: 1)()}'/></robot>",
    "@prefix owl: <http://www.w3.org/2002/07/owl#> . <a:x> a owl:Ontology ; owl:imports <http://192.0.2.1/y> .",
)  # fmt: skip
NUMBERS = (0.0, 1.0, -1.0, 0.5, 0.01, 3.0, 1e308, -1e308, 1e-308, 5e-324, 2.0**53, 1e9, -0.0)
INTEGERS = (0, 1, -1, 2, 3, 7, 255, 256, 65536, 2**31 - 1, -(2**31), 2**63 - 1, 2**64, 10**40)
QUITTING = 3
"""The state by which a client is allowed to end the server."""


class RunningServer:
    """`mindstage serve` in another process, with the page."""

    def __init__(self, folder: Path) -> None:
        """Starts it, and waits until it serves.

        Args:
            folder: where the server may write.
        """
        self.folder = folder
        for name in ("home", "tmp", "cwd"):
            (folder / name).mkdir(parents=True, exist_ok=True)
        environment = os.environ | {
            "HOME": str(folder / "home"), "TMPDIR": str(folder / "tmp"), "XDG_RUNTIME_DIR": str(folder / "home"),
            "XDG_CACHE_HOME": str(folder / "home" / "cache"), "PYTHONDONTWRITEBYTECODE": "1", "PYTHONFAULTHANDLER": "1",
            "PYTHONPATH": os.pathsep.join((str(ROOT / "src"), str(ROOT))),
        }  # fmt: skip
        environment.pop("MINDSTAGE_CACHE", None)
        command = [sys.executable, "-m", "tests.fuzz.served", str(folder), "serve", "--json", "bundled:kitchen"]
        command += ["--port", "0", "--viewer", "--viewer-port", "0", "--robot", "mobile_manipulator"]
        self._errors = (folder / "errors.txt").open("wb")
        self.process = subprocess.Popen(
            command, cwd=folder / "cwd", env=environment, stdout=subprocess.PIPE, stderr=self._errors, text=True
        )
        assert self.process.stdout is not None
        lines: list[str] = []
        while not lines or lines[-1] != "}\n":
            lines.append(self.process.stdout.readline())
            assert lines[-1], f"the server has ended: {self.errors()}"
        output = json.loads("".join(lines))
        self.bridge, self.page = output["url"], output["viewer"].rstrip("/")
        self.running = self.describe()
        self._files = dict(self._watched_files())

    def describe(self) -> dict[str, Any]:
        """What the running servers offer now, and the live threads."""
        place = self.folder / "running.json"
        place.unlink(missing_ok=True)
        self.process.send_signal(signal.SIGUSR1)
        end = time.monotonic() + START_TIMEOUT_S
        while not place.exists():
            assert self.process.poll() is None, f"the server has ended with {self.process.returncode}: {self.errors()}"
            assert time.monotonic() < end, "the main thread of the server does not answer"
            time.sleep(0.05)
        found: dict[str, Any] = json.loads(place.read_text())
        return found

    def errors(self) -> str:
        """The end of what the server has written to stderr."""
        return (self.folder / "errors.txt").read_text(errors="replace")[-5000:]

    def check_intact(self) -> None:
        """Checks that the process and its threads live, and that it has done nothing that it must not."""
        assert self.process.poll() is None, f"the server has ended with {self.process.returncode}: {self.errors()}"
        offences = (self.folder / "offences.txt").read_text(errors="replace")
        assert not offences, offences
        assert "Traceback" not in self.errors(), self.errors()
        missing = set(self.running["threads"]) - set(self.describe()["threads"])
        assert not missing, f"threads have ended: {sorted(missing)}"
        now = dict(self._watched_files())
        changed = sorted(
            str(path) for path in now.keys() | self._files.keys() if now.get(path) != self._files.get(path)
        )
        assert not changed, f"files were written outside of the temporary folders: {changed}"

    def _watched_files(self) -> Iterator[tuple[str, int]]:
        """Files that the server must not change, with their times: its working directory, and the package."""
        for folder in (self.folder / "cwd", ROOT / "src", ROOT / "scripts", ROOT / "wire"):
            for path in sorted(folder.rglob("*")):
                is_recorded = path.suffix == ".mcap" or path.parent.name == CONTENTS_FOLDER  # by the page
                if path.is_file() and path.suffix != ".pyc" and not is_recorded:
                    yield str(path), path.stat().st_mtime_ns

    def measure(self) -> dict[str, float]:
        """How long a new client waits for each of some requests, all of which succeed [s]."""
        times: dict[str, float] = {}
        with self.page_client() as client:

            def ask(method: str, **arguments: Any) -> None:
                began_s = time.monotonic()
                client.ask(method, **arguments)
                times[method] = round(time.monotonic() - began_s, 3)

            ask("pause")
            ask("step", duration_s=0.02)
            ask("add", cls="Cup", position=[0.0, 0.0, 4.0])
            ask("undo")
            ask("save")
            ask("ask", question="what_is Cup")
        return times

    def page_client(self) -> Any:
        """A connected client of the page's channel, as a context."""
        return _page_client(f"{self.page.replace('http', 'ws', 1)}/mindstage/channel?client={secrets.token_hex(8)}")

    def stop(self) -> None:
        """Ends the process."""
        self.process.kill()
        self.process.communicate(timeout=START_TIMEOUT_S)
        self._errors.close()


class _page_client:  # noqa: N801 - used like a function
    def __init__(self, address: str) -> None:
        self._socket = connect(address, open_timeout=ANSWER_TIMEOUT_S, max_size=None)

    def __enter__(self) -> PageClient:
        return PageClient(self._socket)

    def __exit__(self, *_: object) -> None:
        self._socket.close()


class ServerFuzzer:
    """Sends random requests to all ports of a server."""

    def __init__(self, server: RunningServer, seed: object) -> None:
        """Connects to nothing yet.

        Args:
            server: the server.
            seed: of all choices.
        """
        self.server, self.rng = server, random.Random(str(seed))
        self.sent: dict[str, int] = {}
        self._stack, self._sockets = ExitStack(), dict[str, ClientConnection]()
        running = server.running
        self._services = sorted(running["services"].items())
        self._actions, self._topics = sorted(running["actions"].items()), sorted(running["topics"].items())
        self._methods, self._bodies = sorted(running["methods"].items()), running["bodies"]

    def run(self, seconds: float = float("inf"), *, requests: float = float("inf")) -> None:
        """Sends requests for a time [s], or so many."""
        kinds: tuple[tuple[Callable[[], None], int], ...] = (
            (self.call_service, 30), (self.call_method, 30), (self.publish, 10), (self.send_goal, 5),
            (self.send_operation, 10), (self.show_view, 5), (self.query_shell, 5), (self.send_bytes, 3),
            (self.flood, 1), (self.vanish, 2),
        )  # fmt: skip
        names, weights = [each for each, _ in kinds], [weight for _, weight in kinds]
        end_s, number = time.monotonic() + seconds, 0
        while time.monotonic() < end_s and number < requests:
            number += 1
            (kind,) = self.rng.choices(names, weights)
            with suppress(ConnectionClosed, InvalidHandshake, ConnectionError, TimeoutError):
                kind()
            self.sent[kind.__name__] = self.sent.get(kind.__name__, 0) + 1
            if number % 25 == 0:
                self._drain()
                self._wait(loads=number % 600 == 0)
                assert self.server.process.poll() is None, f"the server has ended: {self.server.errors()}"

    def close(self) -> None:
        """Disconnects."""
        for each in self._sockets.values():
            with suppress(Exception):
                each.close()
        self._stack.close()

    # -- requests ------------------------------------------------------------------------------------------------

    def call_service(self) -> None:
        """Calls a service of the running server with arguments of its type."""
        name, type = self.rng.choice(self._services)
        request = service_types()[type].request if type in service_types() else None
        arguments = {} if request is None else self._value(request)
        message = {"op": "call_service", "id": str(self.rng.random()), "service": name, "args": arguments}
        self._send("bridge", message, may_corrupt=not name.endswith("set_simulation_state"))

    def publish(self) -> None:
        """Publishes a message on a topic of the running server."""
        name, type = self.rng.choice(self._topics)
        message = self._value(message_types()[type]) if type in message_types() else {"data": self._odd()}
        if self.rng.random() < 0.3:
            self._send("bridge", {"op": "advertise", "topic": name, "type": type})
        self._send(
            "bridge", {"op": self.rng.choice(("publish", "publish", "subscribe")), "topic": name, "msg": message}
        )

    def send_goal(self) -> None:
        """Sends a goal to an action of the running server, and cancels it at times."""
        name, type = self.rng.choice(self._actions)
        goal = self._value(action_types()[type].goal) if type in action_types() else {}
        message = {"op": "send_action_goal", "id": str(self.rng.random()), "action": name, "action_type": type}
        self._send("bridge", message | {"args": goal, "feedback": True})
        if self.rng.random() < 0.7:
            self._send("bridge", {"op": "cancel_action_goal", "id": message["id"], "action": name})

    def send_operation(self) -> None:
        """Sends a frame that may be no message at all."""
        self._socket("bridge").send(random_frame(self.rng))

    def call_method(self) -> None:
        """Calls a method of the page."""
        name, place = self.rng.choice(self._methods)
        module, _, qualified = place.partition(":")
        request: Any = import_module(module)
        for part in qualified.split("."):
            request = getattr(request, part)
        message = {"id": self.rng.randrange(10**6), "method": name, "params": self._value(request)}
        self._send("page", message)

    def show_view(self) -> None:
        """Sends a message of a 3D view, or bytes that are none."""
        camera = {
            "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0.0, -9.0, 5.0], "fov": 0.8,
            "near": 0.1, "far": 99.0, "image_height": 300, "image_width": 400, "look_at": [0.0, 0.0, 0.0],
            "up_direction": [0.0, 0.0, 1.0],
        }  # fmt: skip
        for key in self.rng.sample(sorted(camera), self.rng.randrange(3)):
            odd = self._odd()
            camera[key] = str(odd) if isinstance(odd, int) else odd  # msgpack has no integers of 128 bits
        data = msgspec.msgpack.encode(camera)
        self._socket("view").send(corrupted(data, self.rng.randrange(1, 2**31)) if self.rng.random() < 0.4 else data)

    def query_shell(self) -> None:
        """Calls the service of the shell."""
        language = self.rng.choice(("question", "sparql", "prolog", "python", ""))
        arguments = {"language": language, "query": self.rng.choice(STRINGS), "timeout_s": self._number()}
        self._send("shell", {"op": "call_service", "id": "1", "service": "/mindstage/query", "args": arguments})

    def send_bytes(self) -> None:
        """Sends bytes to a port, and disconnects."""
        port = int(self.rng.choice((self.server.page, self.server.bridge)).rpartition(":")[2])
        path = self.rng.choice(
            ("/", "/%2e%2e/%2e%2e/etc/passwd", "/mindstage/../../x", "/?token=x", "/view/0", "/" + "x" * 9000)
        )
        text = f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode()
        data = self.rng.choice((text, corrupted(text, self.rng.randrange(1, 2**31)), self.rng.randbytes(300)))
        with socket.create_connection(("127.0.0.1", port), timeout=5.0) as client:
            client.sendall(data)
            client.settimeout(0.05)
            with suppress(TimeoutError):
                assert b"root:" not in client.recv(1 << 16), "a file of this machine was served"

    def flood(self) -> None:
        """Sends one message many times, without reading what comes back."""
        message = self.rng.choice(
            (
                {"op": "publish", "topic": "/cmd_vel", "msg": {"linear": {"x": 0.1}}},
                {"op": "call_service", "service": "/rosapi/topics", "args": {}},
                {"op": "subscribe", "topic": "/joint_states"},
            )
        )
        socket = self._socket("bridge")
        for _ in range(200):
            socket.send(json.dumps(message))

    def vanish(self) -> None:
        """Ends a connection without a word, in the middle of what it has asked for."""
        if self._sockets:
            name = self.rng.choice(sorted(self._sockets))
            with suppress(OSError):
                self._sockets.pop(name).socket.shutdown(socket.SHUT_RDWR)

    # -- values --------------------------------------------------------------------------------------------------

    def _value(self, type: Any) -> Any:
        return self._of(_type_info(type), 0)

    def _of(self, info: inspect.Type, depth: int) -> Any:
        """A value of a type as JSON has it, or now and then one that is none."""
        if self.rng.random() < 0.03:
            return self._odd()
        match info:
            case inspect.StructType(fields=fields):
                wanted = (each for each in fields if each.required or self.rng.random() < 0.7)
                return {each.encode_name: self._of(each.type, depth + 1) for each in wanted}
            case inspect.FloatType():
                return self._number()
            case inspect.IntType():
                return self.rng.choice(INTEGERS)
            case inspect.BoolType():
                return self.rng.random() < 0.5
            case inspect.BytesType():
                return base64.b64encode(self.rng.randbytes(self.rng.randrange(40))).decode()
            case inspect.EnumType(cls=enum):
                values = [each.value for each in enum if not (isinstance(each.value, int) and each.value == QUITTING)]
                return self.rng.choice(values) if values else 0
            case inspect.LiteralType(values=values):
                return self.rng.choice(values)
            case inspect.UnionType(types=types):
                return self._of(self.rng.choice(types), depth + 1)
            case inspect.NoneType():
                return None
            case (
                inspect.VarTupleType(item_type=item)
                | inspect.ListType(item_type=item)
                | inspect.SetType(item_type=item)
            ):
                return [self._of(item, depth + 1) for _ in range(self.rng.randrange(3 if depth < 6 else 1))]
            case inspect.TupleType(item_types=items):
                return [self._of(each, depth + 1) for each in items]
            case inspect.DictType(key_type=key, value_type=value):
                return {str(self._of(key, depth)): self._of(value, depth + 1) for _ in range(self.rng.randrange(3))}
            case inspect.CustomType() | inspect.AnyType():
                return self._odd()
            case _:
                return self.rng.choice(self._bodies if self.rng.random() < 0.5 else STRINGS)

    def _number(self) -> float:
        return self.rng.choice(NUMBERS) if self.rng.random() < 0.5 else self.rng.uniform(-3.0, 3.0)

    def _odd(self) -> Any:
        kinds = (
            self.rng.choice(STRINGS),
            self.rng.choice(NUMBERS),
            self.rng.choice(INTEGERS),
            None,
            [],
            {},
            [[[]]],
            True,
        )
        return self.rng.choice(kinds)

    # -- sockets -------------------------------------------------------------------------------------------------

    def _send(self, name: str, message: dict[str, Any], *, may_corrupt: bool = True) -> None:
        if "set_simulation_state" in str(message.get("service")):
            message["args"] = {"state": {"state": self.rng.choice((0, 1, 2, 99))}}
        text = json.dumps(message)
        if may_corrupt and self.rng.random() < 0.1:
            text = corrupted(text.encode(), self.rng.randrange(1, 2**31)).decode("utf-8", "replace")
        self._socket(name).send(text)

    def _socket(self, name: str) -> ClientConnection:
        if name not in self._sockets:
            page = self.server.page.replace("http", "ws", 1)
            key = f"{self.rng.randrange(16**8):016x}"
            shell = self.server.running["shell"]
            addresses = {
                "bridge": self.server.bridge,
                "page": f"{page}/mindstage/channel?client={key}",
                "view": f"{page}/view/{key}",
                "shell": f"{shell['url']}/?token={shell['token']}",
            }
            protocols = [Subprotocol(f"viser-v{viser.__version__}")] if name == "view" else None
            self._sockets[name] = connect(
                addresses[name], subprotocols=protocols, open_timeout=ANSWER_TIMEOUT_S, max_size=None, max_queue=None
            )
        return self._sockets[name]

    def _drain(self) -> None:
        for name, each in list(self._sockets.items()):
            try:
                while True:
                    each.recv(timeout=0)
            except TimeoutError:
                pass
            except ConnectionClosed:
                del self._sockets[name]

    def _wait(self, *, loads: bool = False) -> None:
        """Waits until the server answers another client, which may load the map again: requests delete bodies."""
        with self.server.page_client() as client, suppress(RequestFailedError):
            client.ask("ping")
            if loads:
                client.ask("load", name="kitchen.owl", text=bundled_kitchen().read_text(encoding="utf-8"), discard=True)


@cache
def _type_info(type: Any) -> inspect.Type:
    return inspect.type_info(type)
