"""Over a rosbridge connection: pauses are executed soon at any speed, numbers have ranges, errors are in the health."""

from __future__ import annotations

import threading
import time
from typing import Any

import pytest

from mindstage.bridge import RosbridgeClient
from mindstage.errors import ServiceCallError
from mindstage.scene import BodyId, BodyPhysics
from mindstage.scene.edits import SetLabel, SetPhysics
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, eventually

SOON_S = 2.0
"""Far more than the aim of 0.2 s, since tests run beside each other."""


class StuckController:
    """Calls a function at each update."""

    period_s = 0.01
    is_active = True

    def __init__(self, on_update: Any) -> None:
        self.on_update = on_update

    def update(self, engine: object, time_s: float) -> None:
        self.on_update()

    def copy(self) -> StuckController:
        return self

    def reset(self, engine: object) -> None:
        pass


@pytest.mark.parametrize("speed", ["1e308", "1000.5", "-1.0", "-1e-300"])
def test_a_speed_beyond_the_limit_is_refused_with_its_range(
    client: RosbridgeClient, simulation: Simulation, speed: str
) -> None:
    with pytest.raises(ServiceCallError, match=r"speed.*it must be a number from 0 to 1000"):
        client.call_service("/unreal/mindstage/set_speed", {"speed": float(speed)})
    assert not simulation.state.playing


def test_pauses_and_edits_are_executed_soon_at_the_largest_speed(
    client: RosbridgeClient, simulation: Simulation
) -> None:
    def call(service: str, **args: Any) -> Any:
        start_s = time.monotonic()
        reply = client.call_service(f"/unreal/mindstage/{service}", args, timeout_s=TIMEOUT_S)
        assert time.monotonic() - start_s < SOON_S
        return reply

    for _ in range(5):
        call("set_speed", speed=1000.0)
        eventually(lambda: simulation.state.real_time_factor > 0.0)
        call("set_label", id="Mug", label="My mug")
        call("set_speed", speed=0.0)
        simulation.engine.ping()  # on a busy machine the last tick may still be running
        time_s = simulation.state.time_s
        time.sleep(0.05)
        assert (simulation.state.playing, simulation.state.time_s) == (False, time_s)


@pytest.mark.parametrize("duration_s", [1e308, 3600.5, -1.0])
def test_a_step_beyond_the_limit_is_refused(client: RosbridgeClient, simulation: Simulation, duration_s: float) -> None:
    with pytest.raises(ServiceCallError, match=r"step duration.*from 0 to 3600 s"):
        client.call_service("/unreal/mindstage/step", {"duration_s": duration_s})
    assert simulation.state.time_s == 0.0


@pytest.mark.parametrize("steps", [2**63 - 1, 2**40, 1_800_001])
def test_too_many_steps_are_refused(client: RosbridgeClient, simulation: Simulation, steps: int) -> None:
    with pytest.raises(ServiceCallError, match=r"step duration.*from 0 to 3600 s"):
        client.call_service("/unreal/step_simulation", {"steps": steps})
    with pytest.raises(ServiceCallError, match="steps"):  # 64 bits with a sign are all that is decoded
        client.call_service("/unreal/step_simulation", {"steps": steps + 2**63})
    assert simulation.state.time_s == 0.0


def test_other_calls_are_executed_while_a_long_step_runs(client: RosbridgeClient, simulation: Simulation) -> None:
    long = threading.Thread(
        target=lambda: client.call_service("/unreal/mindstage/step", {"duration_s": 30.0}, timeout_s=10 * TIMEOUT_S)
    )
    long.start()
    eventually(lambda: simulation.state.time_s > 0.0)
    start_s, state = time.monotonic(), simulation.state
    simulation.engine.run(lambda engine: engine.apply(SetLabel(BodyId("Mug"), "M")), edits=True)
    simulation.pause()
    assert time.monotonic() - start_s < SOON_S
    long.join(10 * TIMEOUT_S)
    assert simulation.state.time_s == pytest.approx(30.0)
    assert state.time_s < 30.0


def test_a_controller_that_raises_is_in_the_health(client: RosbridgeClient, simulation: Simulation) -> None:
    health: list[Any] = []
    client.subscribe("/mindstage/health", health.append, type="diagnostic_msgs/DiagnosticArray")

    def fail() -> None:
        raise KeyError("elbow")

    simulation.add_controller("arm", StuckController(fail))
    client.call_service("/unreal/mindstage/set_speed", {"speed": 1.0})
    eventually(lambda: "the controller 'arm' raised KeyError: 'elbow'" in str(health))
    assert not simulation.state.playing
    client.call_service("/unreal/mindstage/set_speed", {"speed": 1.0})
    eventually(lambda: simulation.state.playing)


def test_the_health_has_the_expected_time_of_a_rebuild(client: RosbridgeClient, simulation: Simulation) -> None:
    health: list[Any] = []
    client.subscribe("/mindstage/health", health.append, type="diagnostic_msgs/DiagnosticArray")
    simulation.step(0.1)

    def expected_s() -> float:
        if not health:
            return -1.0
        return float({each["key"]: each["value"] for each in health[-1]["status"][0]["values"]}["expected_rebuild_s"])

    eventually(lambda: expected_s() == 0.0)
    simulation.engine.run(lambda engine: engine.apply(SetPhysics(BodyId("Mug"), BodyPhysics())), edits=True)
    eventually(lambda: expected_s() > 0.0)
