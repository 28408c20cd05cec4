"""Samples on a real Ray cluster of two nodes on this machine: equal results, and nothing lost with a node."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mindstage.errors import ImaginationError
from mindstage.imagination import Move, Outcome, Plan, Uncertainty, Wait, evaluate_plan
from mindstage.imagination.ray_executor import RayExecutor
from mindstage.scene import Pose
from mindstage.simulation import Simulation
from tests.engines.scenes import body
from tests.imagination.scenes import TABLE_HEIGHT_M, on_table

pytestmark = pytest.mark.xdist_group("ray")

BOX_Z = TABLE_HEIGHT_M + 0.05
NEAR_EDGE = Plan(
    steps=(Move(thing="box", to=Pose((0.0, 0.0, BOX_Z))), Wait(duration_s=1.0)),
    uncertainty=(Uncertainty(thing="box", position_m=(0.02, 0.0, 0.0), mass=0.1),),
)


@pytest.fixture(scope="module")
def sim() -> Iterator[Simulation]:
    with on_table(body("box", (-0.5, 0.0, BOX_Z), (0.2, 0.1, 0.1), "dynamic", 1.0)) as sim:
        sim.step(0.5)
        yield sim


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """A cluster with a head without cores and two nodes of one core, to which this process is connected."""
    if "CI" not in os.environ:
        pytest.importorskip("ray")
    import ray
    from ray.cluster_utils import Cluster

    search_path = os.pathsep.join((str(Path(__file__).resolve().parents[2] / "src"), os.environ.get("PYTHONPATH", "")))
    before, os.environ["PYTHONPATH"] = os.environ.get("PYTHONPATH", ""), search_path
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    try:
        cluster.nodes_to_lose = [cluster.add_node(num_cpus=1)]
        cluster.add_node(num_cpus=1)
        cluster.wait_for_nodes(timeout=60)
        ray.init(address=cluster.address, log_to_driver=False, configure_logging=False)
        yield cluster
    finally:
        ray.shutdown()
        cluster.shutdown()
        os.environ["PYTHONPATH"] = before


def test_a_cluster_gives_the_verdict_of_this_process_and_loses_nothing_with_a_node(
    sim: Simulation, cluster: Any
) -> None:
    alone = evaluate_plan(sim, NEAR_EDGE, samples=200, fixed=True, seed=3)
    with RayExecutor() as executor:
        assert executor.name == "a Ray cluster of 2 cores"
        few = evaluate_plan(sim, NEAR_EDGE, samples=20, fixed=True, seed=3, workers=executor)
        assert few.results == alone.results[:20]
        begun = threading.Event()

        def remove() -> None:
            assert begun.wait(60.0)
            cluster.remove_node(cluster.nodes_to_lose.pop(), allow_graceful=False)

        remover = threading.Thread(target=remove)
        remover.start()
        verdict = evaluate_plan(
            sim,
            NEAR_EDGE,
            samples=200,
            fixed=True,
            seed=3,
            workers=executor,
            progress=lambda _: begun.set(),
            budget_s=300,
        )
        remover.join(60.0)
        assert not remover.is_alive()
        assert verdict.unknown == 0
        assert verdict.to_json() == alone.to_json()


def test_a_deadline_holds_on_a_cluster(sim: Simulation, cluster: Any) -> None:
    endless = Plan(steps=(Wait(duration_s=3600.0, deadline_s=1e7),), deadline_s=1e7, uncertainty=NEAR_EDGE.uncertainty)
    with RayExecutor() as executor:
        verdict = evaluate_plan(sim, endless, samples=100_000, budget_s=2.0, workers=executor)
    assert verdict.outcome is Outcome.UNKNOWN
    assert verdict.failed == 0
    assert verdict.samples < 100, "only what was given to the cluster"


def test_errors_of_a_job_are_raised(sim: Simulation, cluster: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mindstage.imagination.ray_executor._VERSION", "9.9.9")
    with RayExecutor() as executor, pytest.raises(ImaginationError, match=r"this machine has 9.9.9"):
        evaluate_plan(sim, NEAR_EDGE, samples=20, workers=executor)


def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ImaginationError, match=r"install mindstage\[ray\]"):
        RayExecutor()


@pytest.mark.parametrize(("file", "mode"), [("auth_token", "token"), ("other", None)])
def test_a_cluster_gets_the_token_that_ray_has_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, file: str, mode: str | None
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    monkeypatch.setenv("HOME", str(tmp_path))
    for name in ("RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    (tmp_path / ".ray").mkdir()
    (tmp_path / ".ray" / file).write_text("secret", encoding="utf-8")
    with pytest.raises(ImaginationError, match="Ray is not installed"):
        RayExecutor("ray://127.0.0.1:1")
    assert os.environ.get("RAY_AUTH_MODE") == mode


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.mark.slow
def test_the_shell_uses_a_cluster_that_ray_start_has_started_and_that_demands_a_token(tmp_path: Path) -> None:
    if "CI" not in os.environ:
        pytest.importorskip("ray")
    token, plan, port = tmp_path / "token", tmp_path / "plan.yaml", _free_port()
    token.write_text("0123456789abcdef" * 4, encoding="utf-8")
    plan.write_text(
        "steps: [{do: wait, duration_s: 0.1}]\nuncertainty: [{thing: milk_carton_1, position_m: 0.01}]",
        encoding="utf-8",
    )
    source = str(Path(__file__).resolve().parents[2] / "src")
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join((source, os.environ.get("PYTHONPATH", ""))),
        "RAY_AUTH_TOKEN_PATH": str(token),
        "RAY_USAGE_STATS_ENABLED": "0",
    }
    environment.pop("RAY_AUTH_MODE", None)
    options = [
        f"--port={_free_port()}",
        f"--ray-client-server-port={port}",
        "--num-cpus=1",
        "--include-dashboard=false",
    ]
    options += ["--min-worker-port=0", "--max-worker-port=0", "--block"]
    folder = tempfile.mkdtemp(prefix="ray")  # the path of a socket is limited to 107 characters
    with (tmp_path / "log").open("w+", encoding="utf-8") as log:
        start = [sys.executable, "-m", "ray.scripts.scripts", "start", "--head", f"--temp-dir={folder}", *options]
        head = subprocess.Popen(
            start, env=environment | {"RAY_AUTH_MODE": "token"}, stdout=log, stderr=subprocess.STDOUT
        )
        try:
            deadline = time.monotonic() + 60
            while "Ray runtime started" not in (tmp_path / "log").read_text(encoding="utf-8"):
                assert head.poll() is None, (tmp_path / "log").read_text(encoding="utf-8")
                assert time.monotonic() < deadline
                time.sleep(0.1)
            command = ["evaluate", str(plan), "bundled:kitchen", "--samples=5", "--json"]
            result = subprocess.run(
                [sys.executable, "-m", "mindstage", *command, f"--workers=ray://127.0.0.1:{port}"],
                env=environment,
                capture_output=True,
                text=True,
                timeout=180,
                check=False,
            )
            assert '"succeeded": 5' in result.stdout, result.stdout + result.stderr
        finally:
            head.terminate()
            head.wait(timeout=60)
            shutil.rmtree(folder, ignore_errors=True)
