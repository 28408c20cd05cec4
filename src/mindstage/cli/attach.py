"""Queries that a running simulation answers: `--running` of `ask`, `sparql` and `prolog`, or `ros://` instead of a map.

Without an address, the simulation is found by the records of this user's simulations on this machine. The running
simulation evaluates everything, with its knowledge base, its state and its limits; only the output is made here.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import typer

from mindstage.cli.options import REMOTE_SCHEMES, ExitCode, options_given
from mindstage.cli.output import print_json, print_line, print_table, progress_spinner, warn
from mindstage.errors import (
    AuthenticationError,
    BridgeError,
    ConnectionLostError,
    InvalidArgumentError,
    MindstageError,
    ServiceCallError,
    ServiceNotFoundError,
    ServiceTimeoutError,
)

if TYPE_CHECKING:
    from mindstage.bridge import RosbridgeClient
    from mindstage.engines.remote.client import RemoteUrl
    from mindstage.run_records import RunRecord

__all__ = [
    "RunningSimulation",
    "open_running",
    "print_running_solutions",
    "prolog_lines",
    "running_target",
    "warn_of_limit",
]

_CONNECT_TIMEOUT_S = 5.0
_CALL_MARGIN_S = 5.0
"""Added to the time limit of a query, so that the limit of the simulation ends first [s]."""
_STALL_S = 20.0
"""A skill is canceled if simulated time does not pass for this wall time [s]."""
_POLL_S = 0.2
_NAMESPACE = "unreal"
"""The default of servers."""
_PERFORM_TYPE = "mindstage_msgs/Perform"
_CALL_TIMEOUT_S = 60.0
"""Longest time for a question, which has no time limit of its own [s]."""
_MAX_MESSAGE_BYTES = 64 << 20
_START_HINT = "start one with mindstage demo, spawn, serve or prolog --viewer, or give its address: ros://HOST:PORT"


class RunningSimulation:
    """A connection to a running simulation that answers queries."""

    def __init__(self, client: RosbridgeClient, *, address: str, service: str, namespace: str) -> None:
        self.address = address
        """For display, without the token."""
        self._client = client
        self._service = service
        self._namespace = namespace

    def query(self, language: str, query: str, *, timeout_s: float | None = None, **fields: object) -> dict[str, Any]:
        """Runs a query.

        Args:
            language: question, sparql or prolog.
            query: the name of a question, or a text.
            timeout_s: the time limit [s]; None for that of the simulation.
            fields: further fields of the request, see `Query.srv`.

        Returns:
            The result, as the verb prints it with `--json`.

        Raises:
            MindstageError: the query cannot be answered; the message is that of the simulation.
            BridgeError: the simulation does not answer, or is none of Mindstage.
        """
        import msgspec

        from mindstage.msgs import decode, encode, mindstage_msgs

        request = mindstage_msgs.Query.Request(
            language=language,
            query=query,
            timeout_s=timeout_s or 0.0,
            **fields,  # type: ignore[arg-type]
        )
        wait_s = _CALL_TIMEOUT_S if timeout_s is None else timeout_s + _CALL_MARGIN_S
        try:
            values = self._client.call_service(self._service, encode(request), timeout_s=wait_s)
            response = decode(mindstage_msgs.Query.Response, values, strict=True)
            result = msgspec.json.decode(response.answers) if response.success else None
        except ServiceNotFoundError as error:
            cause = f"the rosbridge there has no service {self._service}; is it Mindstage of this version?"
            raise ConnectionLostError(self.address, cause=cause) from error
        except ServiceCallError as error:
            raise MindstageError(error.cause) from error
        except msgspec.DecodeError as error:
            raise ConnectionLostError(self.address, cause=f"its response cannot be read: {error}") from error
        if not isinstance(result, dict):
            raise MindstageError(response.refusal.text or "the simulation rejected the query without a reason")
        return result

    def perform(
        self,
        skill: str,
        args: Mapping[str, object],
        *,
        robot: str = "",
        deadline_s: float = 0.0,
        on_step: Callable[[str], object] = lambda step: None,
        cancel: Callable[[], bool] = lambda: False,
    ) -> dict[str, Any]:
        """Lets a robot of the simulation perform a skill, and waits for its end.

        Args:
            skill: the name of the skill.
            args: its arguments.
            robot: the name of the robot; empty for the only one.
            deadline_s: limit of the simulated time [s]; 0 for none.
            on_step: called with what the robot does, when that changes.
            cancel: asked a few times a second; true cancels the skill.

        Returns:
            The fields of the result of `mindstage_msgs/Perform`.

        Raises:
            MindstageError: the skill was refused, or simulated time stands still.
            BridgeError: the simulation does not answer, or has no robots.
        """
        from mindstage.msgs import decode, encode, mindstage_msgs

        name = f"/{self._namespace}/mindstage/perform"
        progress = _Progress(on_step)
        given = json.dumps(dict(args))
        goal = mindstage_msgs.Perform.Goal(skill=skill, args=given, robot=robot, deadline_s=deadline_s)
        handle = self._client.send_goal(name, _PERFORM_TYPE, encode(goal), on_feedback=progress.update)
        is_canceled = False
        while True:
            try:
                values = handle.wait(_POLL_S).values
                break
            except ServiceNotFoundError as error:
                cause = f"the rosbridge there has no action {name}; robots are served by mindstage serve"
                raise ConnectionLostError(self.address, cause=cause) from error
            except ServiceTimeoutError:
                stalled = progress.stands_still_s > _STALL_S
                if not is_canceled and (cancel() or stalled):
                    is_canceled = True
                    handle.cancel()
                    deadline = time.monotonic() + _CALL_MARGIN_S
                if is_canceled and time.monotonic() > deadline:
                    raise
        if is_canceled and not cancel():
            raise MindstageError(f"simulated time has stood still for {_STALL_S:g} s; let the simulation play")
        result = decode(mindstage_msgs.Perform.Result, values, strict=True)
        if result.refusal.text:
            raise MindstageError(result.refusal.text)
        fields: dict[str, Any] = encode(result)
        return fields


class _Progress:
    """What the feedback of a skill says, and since when simulated time stands still."""

    def __init__(self, on_step: Callable[[str], object]) -> None:
        self._on_step, self._step, self._elapsed_s = on_step, "", -1.0
        self._changed_s = time.monotonic()

    def update(self, values: Mapping[str, Any]) -> None:
        """Takes feedback; called in another thread."""
        if values.get("elapsed_s") != self._elapsed_s:
            self._elapsed_s, self._changed_s = values.get("elapsed_s", 0.0), time.monotonic()
        if (step := values.get("step", "")) and step != self._step:
            self._step = step
            self._on_step(step)

    @property
    def stands_still_s(self) -> float:
        """Wall time since simulated time has changed [s]."""
        return time.monotonic() - self._changed_s


def running_target(
    context: typer.Context, running: str | None, maps: Sequence[str] | None, *, allowed: Collection[str]
) -> str | None:
    """The value of `--running`, or an address that was given instead of a map; None for a query that is answered here.

    Args:
        context: the context of the verb.
        running: the value of the option; empty to find the simulation.
        maps: the maps of the command line.
        allowed: the parameters of the verb that such a query can have.

    Raises:
        InvalidArgumentError: there are other options, which the running simulation determines, or several addresses.
    """
    addresses = [map for map in maps or () if map.startswith(REMOTE_SCHEMES)]
    if running is None and not addresses:
        return None
    if len(addresses) > 1 or (addresses and (running is not None or len(maps or ()) > 1)):
        raise InvalidArgumentError(
            addresses[0], cause="it takes the place of all maps", remedy="give one address, and no maps"
        )
    options = {
        parameter.name: (parameter.opts or [parameter.name])[0]
        for parameter in context.command.params
        if parameter.name is not None and parameter.name not in allowed
    }
    if addresses:
        options.pop("maps", None)
    for option in options_given(context, options):
        cause = "it has no effect on a simulation that is running"
        raise InvalidArgumentError(option, cause=cause, remedy="omit it, or omit --running")
    return addresses[0] if addresses else running


@contextmanager
def open_running(target: str) -> Iterator[RunningSimulation]:
    """Connects to a running simulation for the duration of the `with` block.

    Args:
        target: `ros://HOST:PORT` or `ros+tls://…`; or the process id or the map of a simulation on this machine; or
            empty for the only one.

    Raises:
        InvalidArgumentError: there is none on this machine, or the target fits several or none.
        ConnectionLostError: there is no simulation at the address.
        AuthenticationError: a token is required.
    """
    from mindstage.access.limits import BridgeLimits
    from mindstage.bridge import RosbridgeClient
    from mindstage.engines.remote.client import RemoteUrl
    from mindstage.run_records import QUERY_SERVICE

    if target.startswith(REMOTE_SCHEMES):
        remote = RemoteUrl.parse(target)
        token = remote.token or os.environ.get("MINDSTAGE_TOKEN", "")
        address, url, service = str(remote), remote.url, _service_name(target, remote)
        hint = "add ?token=… to the address, or set MINDSTAGE_TOKEN"
        authorities, namespace = remote.authorities, remote.namespace
    else:
        record = _choose(target)
        address, url, service, token = str(record), record.url, f"/{QUERY_SERVICE}", record.token
        hint, authorities, namespace = "", None, _NAMESPACE
    limits = BridgeLimits(message_bytes=_MAX_MESSAGE_BYTES, waiting_bytes=_MAX_MESSAGE_BYTES)
    client = RosbridgeClient(url, token=token or None, tls_authorities=authorities, limits=limits)
    try:
        try:
            client.wait_connected(_CONNECT_TIMEOUT_S)
        except AuthenticationError as error:
            raise AuthenticationError(address, cause="; ".join(filter(None, (error.cause, hint)))) from error
        except ConnectionLostError as error:
            cause = f"{error.cause}; is mindstage serve running there, and is the port that of its rosbridge?"
            raise ConnectionLostError(address, cause=cause) from error
        yield RunningSimulation(client, address=address, service=service, namespace=namespace)
    finally:
        client.close()


def _service_name(target: str, remote: RemoteUrl) -> str:
    """The name of the service: in a namespace only if the address has one, since each server has the absolute name."""
    from urllib.parse import urlsplit

    from mindstage.run_records import QUERY_SERVICE

    has_namespace = urlsplit(target).path.strip("/") != ""
    return f"/{remote.namespace}/{QUERY_SERVICE}" if has_namespace else f"/{QUERY_SERVICE}"


def _choose(name: str) -> RunRecord:
    """The simulation of this user on this machine with a process id or a map.

    Raises:
        InvalidArgumentError: there is none, or there are several.
    """
    from mindstage.run_records import running_simulations

    records = running_simulations()
    fitting = [record for record in records if not name or name in _names(record)]
    if not records:
        raise InvalidArgumentError("--running", cause="no simulation is running on this machine", remedy=_START_HINT)
    listed = "; ".join(map(str, records[-_LISTED_LINES:]))
    if not fitting:
        cause = f"no simulation with the process id or map {name!r} is running"
        raise InvalidArgumentError("--running", cause=cause, remedy=f"running are {listed}")
    if len(fitting) > 1:
        cause = f"{len(fitting)} simulations are running"
        remedy = f"choose one by its process id, such as --running={fitting[-1].process}: {listed}"
        raise InvalidArgumentError("--running", cause=cause, remedy=remedy)
    return fitting[0]


def _names(record: RunRecord) -> set[str]:
    """By what a simulation is chosen; the port too, since a process can have several simulations."""
    return {str(record.process), str(record.port), *filter(None, (*record.maps, record.page))}


_LISTED_LINES = 8


# -- Prolog ------------------------------------------------------------------------------------------------------------


def prolog_lines(simulation: RunningSimulation, *, timeout_s: float, limit: int) -> ExitCode:
    """Runs the queries on standard input, each of which ends with a full stop at the end of a line.

    Returns:
        ERROR if one of them could not be answered and the input is not a terminal.
    """
    is_terminal = sys.stdin.isatty()
    if is_terminal:
        print_line(f"Queries are answered by {simulation.address}. Ctrl-D exits.")
    failed = False
    for query in _queries(is_terminal=is_terminal):
        if query in {"halt", "quit"}:
            break
        try:
            with progress_spinner("solving"):
                result = simulation.query("prolog", query, timeout_s=timeout_s, limit=limit)
        except MindstageError as error:
            if isinstance(error, BridgeError):
                raise
            failed = True
            warn(str(error))
            continue
        _print_solutions(result["solutions"], complete=result["complete"])
    return ExitCode.ERROR if failed and not is_terminal else ExitCode.OK


def _queries(*, is_terminal: bool) -> Iterator[str]:
    lines: list[str] = []
    while True:
        try:
            line = input(("|    " if lines else "?- ") if is_terminal else "")
        except EOFError:
            break
        lines.append(line)
        if line.rstrip().endswith("."):
            yield "\n".join(lines).strip().removesuffix(".").strip()
            lines.clear()
    if rest := "\n".join(lines).strip():
        yield rest


def _print_solutions(solutions: Sequence[Mapping[str, Any]], *, complete: bool) -> None:
    """Prints the solutions of a query as a table of its variables, or true or false if it has none."""
    columns = list(solutions[0]) if solutions else []
    if not columns:
        print_line("true." if solutions else "false.")
    else:
        print_table("", columns, [[_cell(row[name]) for name in columns] for row in solutions])
    if not complete:
        warn_of_limit(solutions)


def print_running_solutions(simulation: RunningSimulation, result: Mapping[str, Any]) -> None:
    """Prints the solutions of one goal as JSON, as `prolog --goal --json` does."""
    print_json({**result, "running": simulation.address})
    if not result["complete"]:
        warn_of_limit(result["solutions"])


def warn_of_limit(solutions: Sequence[object]) -> None:
    """Prints that there may be more solutions than the limit."""
    from mindstage.scene.display import counted

    warn(f"the search stopped after {counted(len(solutions), 'solution')}; there may be more (--limit)")


def _cell(value: object) -> str | int | float | None:
    from mindstage.knowledge.queries import cell_text

    return cell_text(tuple(value) if isinstance(value, list) else value)
