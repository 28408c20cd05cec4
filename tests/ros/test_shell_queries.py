"""The port by which the shell asks a running simulation."""

from __future__ import annotations

import json

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from mindstage.ros.queries import QueryServer
from mindstage.simulation import Simulation


def test_a_simulation_answers_the_shell_by_its_record_until_it_is_closed(simulation: Simulation) -> None:
    server = QueryServer.start(simulation, page="http://127.0.0.1:1/")
    assert server is not None
    assert QueryServer.start(simulation) is server
    assert server.record.page == "http://127.0.0.1:1/"
    request = {"language": "question", "query": "where_is Mug", "timeout_s": 30.0}
    with connect(f"{server.url}/?token={server.record.token}", max_size=None) as socket:
        socket.send(json.dumps({"op": "call_service", "service": "/mindstage/query", "args": request}))
        answer = json.loads(socket.recv(timeout=60.0))
    assert answer["result"], answer
    assert "Cupboard" in json.dumps(answer["values"])
    with pytest.raises(InvalidStatus), connect(f"{server.url}/?token=wrong"):
        pass
    simulation.close()
    with pytest.raises(OSError), connect(f"{server.url}/?token={server.record.token}"):  # noqa: PT011 - refused
        pass
