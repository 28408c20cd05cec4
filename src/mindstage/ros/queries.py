"""Queries of the shell on a running simulation: questions, SPARQL and Prolog as one service, and where it is found.

`QueryServices` is the service `mindstage/query`, a part of every ROS interface. `QueryServer` offers only that service,
at a free port of the loopback interface with a token of its own, and writes a `RunRecord`, by which `mindstage ask
--running` finds it. Queries have the limits of the viewer: none can change anything but highlights, SPARQL cannot call
other servers, and Prolog is limited to questions and their combinations.
"""

from __future__ import annotations

import logging
import secrets
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar
from weakref import WeakKeyDictionary

import msgspec

from mindstage.access.fair_queue import current_caller
from mindstage.access.limits import DEFAULT_SOLUTIONS, QUERY_CHARACTERS, QUERY_DEFAULT_TIME, QUERY_TIME, SOLUTIONS
from mindstage.access.policies import QUERY, EntryPoint
from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.errors import MessageValidationError
from mindstage.knowledge.history import time_arguments
from mindstage.knowledge.queries import answers_to_builtins
from mindstage.msgs import RosVersion, diagnostic_msgs, mindstage_msgs, type_name
from mindstage.prolog import solve_query
from mindstage.rdf.graphs import findings_to_builtins, local_name
from mindstage.ros.diagnostics import DiagnosticsPublisher, Publisher
from mindstage.ros.service import ServiceSpec, mapped, service_handler
from mindstage.run_records import HOST, QUERY_SERVICE, RunRecord
from mindstage.scene.colors import NO_COLOR, color_name, parse_color
from mindstage.simulation import Simulation
from mindstage.simulation.question_pool import PooledAnswers, QuestionPool

__all__ = ["QueryServer", "QueryServices", "parse_arguments"]

_LANGUAGES = ("question", "sparql", "prolog")
_log = logging.getLogger("mindstage.ros")


class QueryServices:
    """The service that answers questions, SPARQL and Prolog for the shell."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._pool = QuestionPool.of(simulation)

    def services(self) -> Iterator[ServiceSpec]:
        """Yields the service under its absolute name and under its name in the namespace."""
        for name in (f"/{QUERY_SERVICE}", QUERY_SERVICE):
            yield ServiceSpec(mindstage_msgs.Query, self.handle_query, QUERY, name=name)

    def handle_query(
        self, request: mindstage_msgs.Query.Request
    ) -> mindstage_msgs.Query.Response | Future[mindstage_msgs.Query.Response]:
        """Runs a query; no answer is a success.

        Raises:
            MessageValidationError: the language is unknown, or the text too long.
            MindstageError: the query cannot be answered.
        """
        if len(request.query) > QUERY_CHARACTERS.count:
            cause = f"it has {len(request.query):,} characters, and a query at most {QUERY_CHARACTERS.count:,}"
            raise MessageValidationError("mindstage_msgs/QueryRequest", path="query", cause=cause)
        timeout_s = min(
            request.timeout_s if request.timeout_s > 0.0 else QUERY_DEFAULT_TIME.maximum, QUERY_TIME.maximum
        )
        match request.language:
            case "question":
                args = parse_arguments(request.args)
                if not request.highlight and not request.explain and self._pool.accepts(request.query, args):
                    asked = self._pool.submit(request.query, args, client=current_caller())
                    return mapped(asked.result, self._pooled_response)
                result = self._ask(request)
            case "sparql":
                when = _time_of(request)
                table = self._simulation.sparql(request.query, timeout_s=timeout_s, **when)
                result = {"columns": table.columns, "rows": table.rows, "truth": table.boolean} | self._findings()
            case "prolog":
                limit = min(request.limit or DEFAULT_SOLUTIONS.count, SOLUTIONS.count)
                found = solve_query(self._simulation, request.query, limit=limit, timeout_s=timeout_s)
                result = {"goal": request.query, "solutions": found, "complete": found.complete} | self._findings()
            case other:
                cause, remedy = f"{other!r} is no language of queries", f"the languages are {', '.join(_LANGUAGES)}"
                raise MessageValidationError("mindstage_msgs/QueryRequest", path="language", cause=cause, remedy=remedy)
        return mindstage_msgs.Query.Response(success=True, answers=msgspec.json.encode(result).decode())

    def _ask(self, request: mindstage_msgs.Query.Request) -> dict[str, Any]:
        color = parse_color(request.highlight) if request.highlight else None
        answers = self._simulation.ask(request.query, **parse_arguments(request.args))
        knowledge = self._simulation.knowledge
        result = answers_to_builtins(knowledge, answers, explain=request.explain)
        if request.highlight:
            highlighted = self._simulation.highlight(answers, color)
            result |= {
                "color": NO_COLOR if color is None else color_name(color),
                "highlighted": [] if color is None else list(highlighted.highlighted),
                "not_highlighted": msgspec.to_builtins(highlighted.unhighlighted),
            }
        return result | self._assumptions() | self._findings()

    def _pooled_response(self, done: Future[PooledAnswers]) -> mindstage_msgs.Query.Response:
        json = done.result().json_with(**self._assumptions(), **self._findings())
        return mindstage_msgs.Query.Response(success=True, answers=json.decode())

    def _assumptions(self) -> dict[str, object]:
        return {"assumptions": [msgspec.to_builtins(each) for each in self._simulation.knowledge.assumptions()]}

    def _findings(self) -> dict[str, object]:
        """The problems that were found in the maps, as in the output of the shell."""
        return {"findings": findings_to_builtins(self._simulation.knowledge.findings())}


def _time_of(request: mindstage_msgs.Query.Request) -> dict[str, Any]:
    """The time and the episode that a SPARQL query is about.

    Raises:
        MessageValidationError: there are other arguments.
        InvalidArgumentError: the time is no number.
    """
    time, others = time_arguments(parse_arguments(request.args))
    if others or time.is_span:
        cause = f"a query in SPARQL has no argument {next(iter(others), 'during')!r}"
        remedy = 'there is {"at": SECONDS, "episode": "NAME"}'
        raise MessageValidationError("mindstage_msgs/QueryRequest", path="args", cause=cause, remedy=remedy)
    return {"at": time.at_s, "episode": time.episode}


def parse_arguments(text: str) -> dict[str, object]:
    """Decodes the arguments of a question.

    Raises:
        MessageValidationError: the text is not a JSON object.
    """
    try:
        args = msgspec.json.decode(text or "{}", type=dict[str, object])
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        remedy = 'send an object in a string, such as {"item": "CowsMilk"}'
        raise MessageValidationError(
            "mindstage_msgs/AskRequest", path="args", cause=str(error), remedy=remedy
        ) from error
    return args


# -- the server of the shell -------------------------------------------------------------------------------------------


class QueryServer:
    """Answers the queries of this user's shell on this machine until `close`; a simulation has at most one."""

    _servers: ClassVar[WeakKeyDictionary[Simulation, QueryServer]] = WeakKeyDictionary()
    _lock = threading.Lock()

    def __init__(self, simulation: Simulation, *, page: str = "") -> None:
        """Opens the port and writes the record; use `start`.

        Raises:
            BridgeUnavailableError: no port is free.
            OSError: the record cannot be written.
        """
        token = secrets.token_urlsafe(24)
        self._node = LocalNode()
        self._file: Path | None = None
        self._server = RosbridgeServer(self._node, host=HOST, port=0, token=token)
        try:
            diagnostics = Publisher(self._node, "/mindstage/diagnostics", diagnostic_msgs.DiagnosticArray)
            publisher = DiagnosticsPublisher(diagnostics, simulation)
            for spec in QueryServices(simulation).services():
                self._create_service(spec, publisher)
            self._server.start()
            maps = tuple(local_name(map) for map in simulation.knowledge.maps())
            self.record = RunRecord.of_this_process(port=self._server.port, token=token, maps=maps, page=page)
            self._file = self.record.write()
        except BaseException:
            self.close()
            raise

    @classmethod
    def start(cls, simulation: Simulation, *, page: str = "") -> QueryServer | None:
        """Makes a simulation answer queries until it is closed.

        Args:
            page: the address of its page.

        Returns:
            The server, which is that of an earlier call if there was one; None if it could not be started, which is
            logged, since the simulation runs without it as well.
        """
        with cls._lock:
            if (server := cls._servers.get(simulation)) is not None:
                return server
            try:
                server = cls(simulation, page=page)
            except Exception as error:
                _log.warning("the simulation is not found by --running: %s", error)
                return None
            cls._servers[simulation] = server
        simulation.on_close(server.close)
        return server

    @property
    def url(self) -> str:
        """URL for a client on this machine."""
        return self._server.url

    def entry_points(self) -> tuple[EntryPoint, ...]:
        """Everything that a client of the port can reach."""
        return self._node.entry_points()

    def close(self) -> None:
        """Removes the record and closes the port; calling it again is harmless."""
        if self._file is not None:
            with suppress(OSError):
                self._file.unlink()
            self._file = None
        self._server.close()
        self._node.close()

    def _create_service(self, spec: ServiceSpec, diagnostics: DiagnosticsPublisher) -> None:
        name = spec.full_name("unreal")
        handler = service_handler(name, spec.type, spec.handler, diagnostics=diagnostics, ros=RosVersion.TWO)
        self._node.create_service(name, type_name(spec.type), handler, policy=spec.policy)
