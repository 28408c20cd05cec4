"""What is fuzzed: the readers of files, and the ports of servers.

A target gives valid inputs and processes one input at a time. An error that it raises is a defect; refusals that the
documentation promises are caught here.
"""

from __future__ import annotations

import json
import logging
import os
import random
import shutil
import socket
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from inspect import signature
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

import pyoxigraph as ox

from mindstage.errors import MindstageError
from tests.conftest import ROOT

__all__ = ["TARGETS", "FuzzTarget"]

_REPLY_TIMEOUT_S = 20.0
_SAMPLES = Path(os.environ.get("MINDSTAGE_DATA") or ROOT.parent / "shared" / "data") / "maps"
_PROCESS_INTERVAL = 50
"""Every so many mesh files are imported as a user does it, in the worker process."""
_MAX_SEED_BYTES = 300_000
"""Larger samples are left to `tests/maps/test_fuzz_files.py`: here an input should take milliseconds."""


class FuzzTarget(ABC):
    """One reader or port."""

    uses_network: ClassVar[bool] = False
    """Whether it needs sockets; others are forbidden to open one."""
    memory_limit: ClassVar[int | None] = 2 * 10**9
    """Limit of the address space [bytes]."""

    def __init__(self, folder: Path) -> None:
        """Prepares the target; it may write into the folder."""
        self.folder = folder

    @abstractmethod
    def seeds(self) -> Iterator[bytes]:
        """Yields valid inputs."""

    @abstractmethod
    def process(self, data: bytes) -> None:
        """Processes an input; an exception is a defect."""

    def random_input(self, chooser: random.Random) -> bytes | None:
        """Returns an input of the target's own generator, if it has one."""
        return None

    def close(self) -> None:  # noqa: B027
        """Releases what the target holds."""


# -- files ---------------------------------------------------------------------------------------------------------


class MapFiles(FuzzTarget):
    """Maps of each dialect: read, written in each format, read again, and compared."""

    suffix = ".ttl"

    def seeds(self) -> Iterator[bytes]:
        from tests.maps.fuzz_maps import MAPS_BY_DIALECT

        yield from (text.encode() for text in MAPS_BY_DIALECT.values())

    def process(self, data: bytes) -> None:
        from tests.maps.fuzz_worker import round_trip

        path = self.folder / f"map{self.suffix}"
        path.write_bytes(data)
        round_trip(path, (), (), self.folder)


class XmlMapFiles(MapFiles):
    """The same as RDF/XML, where the repairs of malformed XML are."""

    suffix = ".owl"

    def seeds(self) -> Iterator[bytes]:
        for data in super().seeds():
            quads = ox.parse(data, ox.RdfFormat.TURTLE)
            yield ox.serialize((quad.triple for quad in quads), format=ox.RdfFormat.RDF_XML)
        for sample in sorted(_SAMPLES.glob("*.owl")):
            if sample.stat().st_size <= _MAX_SEED_BYTES:
                yield sample.read_bytes()


class RobotFiles(FuzzTarget):
    """URDF files as maps."""

    def seeds(self) -> Iterator[bytes]:
        from tests.maps.small_urdf import KITCHEN_URDF

        yield KITCHEN_URDF.encode()

    def process(self, data: bytes) -> None:
        from tests.maps.fuzz_worker import round_trip

        path = self.folder / "robot.urdf"
        path.write_bytes(data)
        round_trip(path, (), (), self.folder)


class MeshFiles(FuzzTarget):
    """Mesh files: the name of the format, a zero byte, the content."""

    memory_limit = 4 * 10**9
    uses_network = True  # the importer is a process
    _count = 0

    def seeds(self) -> Iterator[bytes]:
        import numpy as np
        import trimesh

        scene = trimesh.Scene([trimesh.creation.box((1, 2, 3)), trimesh.creation.icosphere(subdivisions=1)])
        box = trimesh.creation.box((1, 1, 1))
        box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(box.vertices), 2)))
        for suffix in ("glb", "obj", "stl", "dae", "ply", "off"):
            for content in (scene, box):
                with suppress(ValueError, TypeError, AttributeError, KeyError):
                    data = content.export(file_type=suffix)
                    yield suffix.encode() + b"\0" + (data.encode() if isinstance(data, str) else data)

    def process(self, data: bytes) -> None:
        from mindstage.assets import mesh_worker
        from mindstage.assets.mesh_import import import_meshes

        suffix, _, content = data.partition(b"\0")
        path = self.folder / ("mesh." + "".join(filter(str.isalnum, suffix.decode("ascii", "ignore")))[:8])
        path.write_bytes(content)
        # In this process, where an exception of a library is a reason to reject the file, but a crash is a defect.
        options: dict[str, Any] = {"decompose": False, "hull_reason": "", "keep_axes": False}
        signature(mesh_worker._import_mesh).bind(path, path, **options)  # a wrong call is no reason to reject a file
        with suppress(Exception):
            mesh_worker._import_mesh(path, self.folder / "mesh.npz", **options)
        self._count += 1
        if self._count % _PROCESS_INTERVAL == 0:
            with TemporaryDirectory(dir=self.folder) as cache:
                imported, rejected = import_meshes([path], folder=Path(cache), timeout_s=20.0)
            assert path in imported or rejected[path], "neither imported nor rejected with a reason"
            assert "Traceback" not in rejected.get(path, ""), rejected[path]


class OntologyFiles(FuzzTarget):
    """Ontologies with annotations of shapes, lists of items, and files of assertions, all in Turtle."""

    def seeds(self) -> Iterator[bytes]:
        yield b"""@prefix : <http://example.org/own.owl#> . @prefix ms: <http://mindstage.org/ontology#> .
            @prefix k: <http://knowrob.org/kb/knowrob.owl#> . @prefix owl: <http://www.w3.org/2002/07/owl#> .
            @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> . @prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
            :Tub a owl:Class ; rdfs:subClassOf k:Cup ; ms:typicalSize "0.2 0.2 0.1" .
            :mug a :Tub ; ms:count 2 ; k:pose :p . :in a owl:ObjectProperty ; owl:inverseOf :has ; rdfs:domain :Tub .
            :Full a owl:Class ; owl:equivalentClass [ a owl:Restriction ; owl:onProperty :in ;
                owl:someValuesFrom [ a owl:Class ; owl:unionOf ( :Tub k:Door ) ] ] .
            :chain a owl:ObjectProperty ; owl:propertyChainAxiom ( :in :has ) ."""

    def process(self, data: bytes) -> None:
        from mindstage.knowledge import KnowledgeBase
        from mindstage.knowledge.assertion_file import AssertionFile
        from mindstage.simulation.placement_list import load_items

        path = self.folder / "own.ttl"
        path.write_bytes(data)
        for use in (
            lambda knowledge: load_items(path, knowledge),
            lambda knowledge: AssertionFile(path, knowledge),
            lambda knowledge: _ask_everything(knowledge, path),
        ):
            with KnowledgeBase(bundled_ontology=False) as knowledge, suppress(MindstageError):
                use(knowledge)


def _ask_everything(knowledge: Any, path: Path) -> None:
    knowledge.load((), ontologies=path)
    for question in ("subclasses", "what_is", "maps"):
        with suppress(MindstageError):
            for _, _ in zip(knowledge.ask(question), range(50), strict=False):
                pass


class QueryTexts(FuzzTarget):
    """SPARQL queries and updates: they never reach another server, and end in time."""

    uses_network = True  # the pipes of the query process are sockets
    memory_limit = None  # the query process has its own

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        from mindstage.knowledge import KnowledgeBase

        self._knowledge = KnowledgeBase()
        self._internal_server = socket.create_server(("127.0.0.1", 0))
        self._internal_server.setblocking(False)
        self._address = b"127.0.0.1:%d" % self._internal_server.getsockname()[1]

    def seeds(self) -> Iterator[bytes]:
        yield from (text.replace(b"127.0.0.1:9", self._address) for text in self._queries())

    def _queries(self) -> Iterator[bytes]:
        yield from (
            b"SELECT * WHERE { ?s a ?c ; ?p ?o } LIMIT 5",
            b"PREFIX k: <http://knowrob.org/kb/knowrob.owl#> SELECT ?x (COUNT(*) AS ?n) { ?x k:pose/k:x* ?y "
            b"FILTER(?y > 1.0 && REGEX(STR(?x), 'a')) } GROUP BY ?x HAVING (?n > 1) ORDER BY DESC(?n)",
            b"SELECT * { SERVICE <http://127.0.0.1:9/sparql> { ?s ?p ?o } }",
            b"SELECT * { SERVICE SILENT <http://127.0.0.1:9/> { ?s ?p ?o } UNION { GRAPH ?g { ?s ?p ?o } } }",
            b"CONSTRUCT { ?s ?p ?o } FROM <http://127.0.0.1:9/x> WHERE { ?s ?p ?o . MINUS { ?s a [] } } LIMIT 3",
            b"ASK { BIND('SERVICE <http://127.0.0.1:9/>' AS ?x) # SERVICE <http://127.0.0.1:9/>\n }",
            b"LOAD <http://127.0.0.1:9/x>",
            b"DESCRIBE <http://knowrob.org/kb/knowrob.owl#Door>",
        )

    def process(self, data: bytes) -> None:
        with suppress(MindstageError):
            result = self._knowledge.sparql(data.decode("utf-8", "replace"), timeout_s=2.0)
            str(result)
        with suppress(BlockingIOError):
            self._internal_server.accept()[0].close()
            raise AssertionError("the query contacted another server")

    def close(self) -> None:
        self._internal_server.close()
        self._knowledge.close()


class PrologQueries(FuzzTarget):
    """Prolog lines of visitors of the page: they end in time, and call nothing but questions."""

    uses_network = True  # the library is in this process
    memory_limit = None  # Prolog has its own

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        from mindstage.engines import NullEngine
        from mindstage.knowledge import KnowledgeBase
        from mindstage.simulation import Simulation
        from tests.kitchenette import kitchenette

        self._stack = ExitStack()
        self._simulation = self._stack.enter_context(Simulation(KnowledgeBase(), NullEngine()))
        self._simulation.spawn(kitchenette())

    def seeds(self) -> Iterator[bytes]:
        yield from (
            b"storage_place('CowsMilk', P), findall(X, member(X, [1, 2, P]), L), length(L, N)",
            b"( subclasses('Cup', C) -> X = C ; X = f(\"text\", 'A b', -1.5e3) ), \\+ X = 1",
            b"X = f(Y, Y), Y = g(Z, Z), Z = h(1, 2)",
            b"aggregate_all(count, member(_, [a, b]), N), N > 1, atom_length(abc, K)",
            b"open('/etc/passwd', read, S)",
        )

    def process(self, data: bytes) -> None:
        from mindstage.prolog.console import solve_query

        with suppress(MindstageError):
            solve_query(self._simulation, data.decode("utf-8", "replace"), limit=50, timeout_s=2.0)

    def close(self) -> None:
        self._stack.close()


class RandomEditRuns(FuzzTarget):
    """Lists of random edits of running worlds, of which each can be undone: the input is the seed of one."""

    uses_network = True  # the readers of robots are processes
    memory_limit = None

    def seeds(self) -> Iterator[bytes]:
        yield from (bytes([number]) for number in range(4))

    def random_input(self, chooser: random.Random) -> bytes:
        return chooser.randbytes(8)

    def process(self, data: bytes) -> None:
        from tests.simulation.random_edits import STARTS, random_steps, run, shrunk

        start = list(STARTS)[(data[0] if data else 0) % len(STARTS)]
        steps = random_steps(random.Random(data), 8 if start == "kitchen" else 25)
        try:
            run(start, steps, self.folder)
        except AssertionError:
            run(start, shrunk(start, steps, self.folder, runs=20), self.folder)
            raise


# -- ports ---------------------------------------------------------------------------------------------------------


class RosbridgeFrames(FuzzTarget):
    """Frames to the rosbridge server of a simulation; afterwards a valid call is answered."""

    uses_network = True
    memory_limit = None

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        from mindstage.bridge import LocalNode, RosbridgeServer
        from mindstage.engines import NullEngine
        from mindstage.knowledge import KnowledgeBase
        from mindstage.ros import RosInterface
        from mindstage.simulation import Simulation
        from tests.kitchenette import kitchenette

        self._errors = ErrorRecords()
        self._stack = ExitStack()
        simulation = self._stack.enter_context(Simulation(KnowledgeBase(), NullEngine()))
        simulation.spawn(kitchenette())
        self.node = self._stack.enter_context(LocalNode())
        self._stack.enter_context(RosInterface(simulation, self.node))
        self._server = self._stack.enter_context(RosbridgeServer(self.node, port=0))
        self._hostile: Any = None
        self._valid: Any = None

    def seeds(self) -> Iterator[bytes]:
        for service in self.node.graph_info().services:
            yield json.dumps({"op": "call_service", "id": "1", "service": service.name, "args": {"id": "Mug"}}).encode()
        for topic in self.node.graph_info().topics:
            yield json.dumps({"op": "subscribe", "id": "1", "topic": topic.name, "type": topic.type}).encode()
            yield json.dumps({"op": "publish", "topic": topic.name, "msg": {}}).encode()

    def random_input(self, chooser: random.Random) -> bytes:
        from tests.bridge.test_hostile import random_frame

        frame = random_frame(chooser)
        return frame.encode("utf-8", "surrogatepass") if isinstance(frame, str) else b"\0" + frame

    def process(self, data: bytes) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            self._socket("_hostile").send(data[1:] if data[:1] == b"\0" else data.decode("utf-8", "replace"))
        except ConnectionClosed:
            self._hostile = None  # the server may disconnect it
        self._drain()
        self._assert_answered()
        self._errors.raise_if_any()

    def _socket(self, name: str) -> Any:
        from websockets.sync.client import connect

        if getattr(self, name) is None:
            setattr(self, name, self._stack.enter_context(connect(self._server.url, max_queue=None, compression=None)))
        return getattr(self, name)

    def _drain(self) -> None:
        from websockets.exceptions import ConnectionClosed

        with suppress(TimeoutError, ConnectionClosed):
            while self._hostile is not None:
                self._hostile.recv(timeout=0)

    def _assert_answered(self) -> None:
        request = {"op": "call_service", "id": "ping", "service": "/rosapi/get_time", "args": {}}
        valid = self._socket("_valid")
        valid.send(json.dumps(request))
        while json.loads(valid.recv(timeout=_REPLY_TIMEOUT_S)).get("id") != "ping":
            pass

    def close(self) -> None:
        self._stack.close()


class PageRequests(FuzzTarget):
    """Requests on the page's websocket; afterwards a valid one is answered."""

    uses_network = True
    memory_limit = None

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        from mindstage.engines import NullEngine
        from mindstage.knowledge import KnowledgeBase
        from mindstage.simulation import Simulation
        from mindstage.viewer import Viewer
        from tests.kitchenette import kitchenette
        from tests.viewer.page_client import connect_page_client

        self._errors = ErrorRecords()
        self._stack = ExitStack()
        simulation = self._stack.enter_context(Simulation(KnowledgeBase(), NullEngine()))
        simulation.spawn(kitchenette())
        self.viewer = self._stack.enter_context(Viewer(simulation, port=0))
        self.port = int(self.viewer.url.rpartition(":")[2].strip("/"))
        self._connect: Callable[[], Any] = lambda: self._stack.enter_context(connect_page_client(self.viewer.url))
        self._hostile: Any = None
        self._valid: Any = None

    def seeds(self) -> Iterator[bytes]:
        for method in sorted(self.viewer.channel._methods):
            for params in ({}, {"id": "Mug"}, {"ids": ["Mug"], "color": "red"}, {"text": "Cup", "query": "ASK {}"}):
                yield json.dumps({"id": 1, "method": method, "params": params}).encode()

    def process(self, data: bytes) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            self._hostile = self._hostile or self._connect()
            self._hostile.socket.send(data.decode("utf-8", "replace"))
            with suppress(TimeoutError):
                self._hostile.socket.recv(timeout=0)
        except ConnectionClosed:
            self._hostile = None
        self._valid = self._valid or self._connect()
        with suppress(Exception):
            self._valid.ask("no_such_method")
        self._errors.raise_if_any()

    def close(self) -> None:
        self._stack.close()


class HttpRequests(PageRequests):
    """Bytes on the page's port; afterwards the page is served."""

    def seeds(self) -> Iterator[bytes]:
        host = f"127.0.0.1:{self.port}".encode()
        for path in (b"/", b"/page.js", b"/%2e%2e/etc/passwd", b"/?token=x", b"/view?key=1"):
            yield b"GET " + path + b" HTTP/1.1\r\nHost: " + host + b"\r\nCookie: a=b\r\n\r\n"
        yield (
            b"GET / HTTP/1.1\r\nHost: " + host + b"\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nOrigin: http://"
            b"evil.example\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        )

    def process(self, data: bytes) -> None:
        for content in (data, b"GET / HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n\r\n" % self.port):
            with socket.create_connection(("127.0.0.1", self.port), timeout=_REPLY_TIMEOUT_S) as client:
                client.sendall(content)
                if content is data:
                    client.shutdown(socket.SHUT_WR)
                    client.settimeout(0.5)
                with suppress(TimeoutError, ConnectionError):
                    reply = client.recv(1 << 16)
                    if b"root:" in reply:
                        raise AssertionError("a file of this machine was served")
                    if content is not data and not reply.startswith(b"HTTP/1.1 200"):
                        raise AssertionError(f"the page is not served any more: {reply[:200]!r}")
        self._errors.raise_if_any()


class ServerPorts(FuzzTarget):
    """A running server with all of its ports, in a process of its own: the input seeds a burst of requests to them."""

    uses_network = True
    memory_limit = None

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._server: Any = None

    def seeds(self) -> Iterator[bytes]:
        yield from (b"0", b"1")

    def random_input(self, chooser: random.Random) -> bytes:
        return chooser.randbytes(8)

    def process(self, data: bytes) -> None:
        from tests.fuzz.running_server import RunningServer, ServerFuzzer

        if self._server is None:
            self._server = RunningServer(self.folder / "server")
        fuzzer = ServerFuzzer(self._server, data.hex())
        try:
            fuzzer.run(requests=100)
            fuzzer.close()
            self._server.measure()
            self._server.check_intact()
        except BaseException:
            self.close()
            shutil.rmtree(self.folder / "server")  # the next input has a new one
            raise

    def close(self) -> None:
        if self._server is not None:
            self._server.stop()
            self._server = None


class RemoteReplies(FuzzTarget):
    """Frames that a rosbridge server sends to our client."""

    uses_network = True
    memory_limit = None

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        from mindstage.access.limits import BridgeLimits
        from mindstage.bridge.protocol import MessageDecoder

        self._decoder = MessageDecoder(BridgeLimits())

    def seeds(self) -> Iterator[bytes]:
        for op in (
            {"op": "service_response", "id": "1", "service": "/a", "values": {"x": 1}, "result": True},
            {"op": "publish", "topic": "/tf", "msg": {"transforms": []}},
            {"op": "status", "level": "error", "msg": "refused", "id": "2"},
            {"op": "fragment", "id": "3", "data": '{"op":', "num": 0, "total": 2},
            {"op": "action_result", "id": "4", "action": "/a", "values": {}, "status": 4, "result": True},
        ):
            yield json.dumps(op).encode()

    def process(self, data: bytes) -> None:
        from mindstage.msgs.message_registry import message_types
        from mindstage.msgs.schema.base import decode

        with suppress(MindstageError):
            self._decoder.decode(data.decode("utf-8", "replace"), 0.0)
        with suppress(MindstageError):
            self._decoder.decode(data, 0.0)
        with suppress(ValueError, RecursionError):
            value = json.loads(data)
            types = list(message_types().values())
            with suppress(MindstageError):
                decode(types[len(data) % len(types)], value)


class ErrorRecords(logging.Handler):
    """Collects logged errors, which are internal errors of a server."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self._records: list[str] = []
        logging.getLogger().addHandler(self)
        formatter = logging.Formatter()
        self.setFormatter(formatter)

    def emit(self, record: logging.LogRecord) -> None:
        if record.name.endswith(".handshakes"):  # of clients that close the connection too early
            return
        self._records.append(self.format(record))

    def raise_if_any(self) -> None:
        """Raises the collected errors."""
        if self._records:
            text, self._records[:] = "\n".join(self._records), []
            raise AssertionError(f"an internal error was logged: {text}")


TARGETS: dict[str, type[FuzzTarget]] = {
    "maps": MapFiles,
    "xml-maps": XmlMapFiles,
    "robots": RobotFiles,
    "meshes": MeshFiles,
    "ontologies": OntologyFiles,
    "queries": QueryTexts,
    "prolog": PrologQueries,
    "edits": RandomEditRuns,
    "rosbridge": RosbridgeFrames,
    "page": PageRequests,
    "http": HttpRequests,
    "server": ServerPorts,
    "replies": RemoteReplies,
}
"""Everything that is fuzzed, by name."""
