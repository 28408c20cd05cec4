"""PlannedEngine keeps the whole contract with whoever leaves decisions to it: here a MuJoCo that is told them all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import msgspec
import numpy as np
import pytest

from mindstage.engines import MujocoEngine, RemoteEngine, connect
from mindstage.engines.remote.compiled import CompiledRemoteEngine
from mindstage.errors import EngineUnavailableError
from mindstage.msgs import mindstage_msgs as wire
from mindstage.ros.engine_services import EngineServices
from mindstage.scene import BodyId, Pose
from tests.engines.contract import PhysicsContract, apply_force_for, current_pose
from tests.engines.served_simulation import ServedSimulation
from tests.engines.geometry_contract import GeometryContract
from tests.engines.scenes import FLOOR, attachment, body, prismatic_joint, room, world


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> Iterator[ServedSimulation]:
    """A Mindstage that says that it takes plans, and has nothing to add to what was decided for it."""
    describe, spawn = EngineServices.describe, EngineServices.spawn_world

    def described(self: EngineServices, request: wire.Describe.Request) -> wire.Describe.Response:
        return msgspec.structs.replace(describe(self, request), takes=("forms", "plan"))

    def spawned(self: EngineServices, request: wire.SpawnWorld.Request) -> wire.SpawnWorld.Response:
        plans.append(request.plan)
        reply = spawn(self, request)
        return msgspec.structs.replace(reply, report=msgspec.structs.replace(reply.report, notes=()))

    plans: list[str] = []
    monkeypatch.setattr(EngineServices, "describe", described)
    monkeypatch.setattr(EngineServices, "spawn_world", spawned)
    with ServedSimulation() as side:
        side.plans = plans  # type: ignore[attr-defined]
        yield side


class TestPlannedEngine(PhysicsContract, GeometryContract):
    @pytest.fixture
    def engine(self, served: ServedSimulation) -> Iterator[RemoteEngine]:
        with closing(connect(served.address)) as engine:
            assert isinstance(engine, CompiledRemoteEngine)
            yield engine


def test_joint_positions_agree_with_mujoco(served: ServedSimulation) -> None:
    with closing(connect(served.address)) as far, closing(MujocoEngine()) as near:
        for engine in (far, near):
            engine.spawn(room())
            apply_force_for(engine, "door_handle", (25.0, 0.0, 0.0), 0.6)
        told, known = far.joint_positions(), near.joint_positions()
        assert told.keys() == known.keys()
        for id, place in known.items():
            np.testing.assert_allclose(told[id], place, atol=1e-9)


def test_the_sent_model_has_roots_and_excluded_pairs(served: ServedSimulation) -> None:
    with closing(connect(served.address)) as engine:
        engine.spawn(
            world(
                FLOOR,
                body("case", (0, 0, 0.5), (0.6, 0.6, 1.0)),
                body("drawer", (0, 0, 0.5), (0.58, 0.5, 0.2), "dynamic", 5.0),
                body("handle", (0.3, 0, 0.5), (0.02, 0.2, 0.02), "dynamic"),
                attachment("drawer", "handle"),
                prismatic_joint("slide", "drawer", "case", (0.3, 0, 0.5)),
            )
        )
    plan = msgspec.json.decode(served.plans[-1])  # type: ignore[attr-defined]
    assert plan["bodies"]["handle"]["top"] == "drawer"
    assert plan["bodies"]["handle"]["hold"]["position"] == pytest.approx([0.3, 0, 0])
    assert plan["bodies"]["handle"]["mass_kg"] == pytest.approx(0.02 * 0.2 * 0.02 * 200, abs=0.01)
    assert plan["bodies"]["drawer"]["mobility"] == "dynamic"
    assert ["case", "drawer"] in plan["apart"]
    joint = plan["joints"]["slide"]
    assert (joint["parent"], joint["child"]) == ("drawer", "case")
    assert joint["of_child"]["position"] == pytest.approx([0.3, 0, 0])


def test_a_force_on_a_body_deleted_before_the_step_is_dropped(served: ServedSimulation) -> None:
    with closing(connect(served.address)) as engine:
        engine.spawn(room())
        engine.apply_force(BodyId("mug"), (1.0, 0.0, 0.0))
        engine.delete([BodyId("mug")])
        engine.step(0.1)
        assert "mug" not in engine.poses()[0]


def test_poses_read_twice_after_a_step_are_current(served: ServedSimulation) -> None:
    with closing(connect(served.address)) as engine:
        engine.spawn(room())
        for _ in range(3):  # from the second on, steps tell poses unasked
            engine.step(0.01)
            told = engine.poses()[1]
        np.testing.assert_allclose(told, served.stage.state.poses, atol=1e-12)
        served.stage.run_on_engine(lambda far: far.set_pose(BodyId("crate"), Pose((7, 7, 7))), label="set pose")
        assert current_pose(engine, "crate")[0] == 7


def test_bodies_spawned_by_other_clients_are_taken_over(served: ServedSimulation) -> None:
    with closing(connect(served.address)) as engine:
        engine.spawn(room())
        served.stage.spawn(world(body("guest", (3, 3, 1), (0.2, 0.2, 0.2), "dynamic", 1.0)))
        assert "guest" in engine.poses()[0]
        engine.attach(BodyId("crate"), BodyId("guest"))
        engine.set_pose(BodyId("crate"), Pose((0, 5, 1)))
        assert abs(current_pose(engine, "guest")[1] - 5) < 5
        assert engine.snapshot().body("guest").pose.position[1] != 3


def test_a_restarted_remote_world_can_be_spawned_into(served: ServedSimulation) -> None:
    with closing(connect(served.address, timeout_s=10.0)) as engine:
        engine.spawn(room())
        served.stop()
        served.start()
        with pytest.raises(EngineUnavailableError, match="started anew"):
            engine.poses()
        assert engine.spawn(room()).ok
        assert len(engine.poses()[0]) == len(room().bodies)
