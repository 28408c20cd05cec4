"""CompiledRemoteEngine fulfills the contract with a MuJoCo server that takes compiled models."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import msgspec
import numpy as np
import pytest

from mindstage.engines.mujoco import MujocoEngine
from mindstage.engines.remote import RemoteEngine, connect
from mindstage.engines.remote.compiled import CompiledRemoteEngine
from mindstage.errors import EngineUnavailableError
from mindstage.msgs import mindstage_msgs as wire
from mindstage.ros.engine_services import EngineServices
from mindstage.scene import BodyId, Mobility, Pose
from mindstage.scene.edits import Attach, Delete, SetPoses, Spawn
from tests.engines.actuator_contract import ActuatorContract
from tests.engines.contract import PhysicsContract, apply_force_for, current_pose
from tests.engines.geometry_contract import GeometryContract
from tests.engines.remote.served_simulation import ServedSimulation
from tests.engines.scenes import FLOOR, attachment, body, prismatic_joint, room, world


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> Iterator[ServedSimulation]:
    """A server that claims to take compiled models, and returns no decisions of its own."""
    describe, spawn = EngineServices.describe, EngineServices.spawn_world

    def described(self: EngineServices, request: wire.Describe.Request) -> wire.Describe.Response:
        return msgspec.structs.replace(describe(self, request), takes=("geometries", "plan"))

    def spawned(self: EngineServices, request: wire.SpawnWorld.Request) -> wire.SpawnWorld.Response:
        models.append(request.plan)
        reply = spawn(self, request)
        return msgspec.structs.replace(reply, report=msgspec.structs.replace(reply.report, notes=()))

    models: list[str] = []
    monkeypatch.setattr(EngineServices, "describe", described)
    monkeypatch.setattr(EngineServices, "spawn_world", spawned)
    with ServedSimulation() as served:
        served.models = models  # type: ignore[attr-defined]
        yield served


class TestCompiledRemoteEngine(PhysicsContract, ActuatorContract, GeometryContract):
    @pytest.fixture
    def engine(self, served: ServedSimulation) -> Iterator[RemoteEngine]:
        with closing(connect(served.address)) as engine:
            assert isinstance(engine, CompiledRemoteEngine)
            yield engine

    def test_an_immovable_body_stays_and_keeps_its_described_mobility(self, engine: RemoteEngine) -> None:
        """Unlike in the contract, only the sent model is tested: the MuJoCo at the other end makes its own."""
        wall = body("wall", (0, 0, 1.5), (0.2, 4, 3), "dynamic", 500.0)
        engine.apply(Spawn(world(wall), immovable=frozenset({BodyId("wall")}), ground=True))
        assert isinstance(engine, CompiledRemoteEngine)
        (model,) = engine._sent_state.bodies.values()
        assert (model.mobility, model.mass_kg) == (Mobility.STATIC, 500.0)
        assert engine._sent_state.ground.height_m is None
        assert engine.snapshot().body("wall").physics.mobility is Mobility.DYNAMIC

    def test_excluded_pairs_do_not_collide(self, engine: RemoteEngine) -> None:
        """Unlike in the contract, only the sent model is tested: the MuJoCo at the other end makes its own."""
        pair = (BodyId("box"), BodyId("floor"))
        box = body("box", (0, 0, 0.2), (0.2, 0.2, 0.2), "dynamic", 1.0)
        engine.apply(Spawn(world(FLOOR, box), excluded_pairs=frozenset({pair[::-1]})))
        assert isinstance(engine, CompiledRemoteEngine)
        assert engine._sent_state.excluded_pairs == {pair}

    def test_a_body_that_falls_out_of_the_place_is_stopped_and_reported_once(self, engine: RemoteEngine) -> None:
        """Unlike in the contract, the MuJoCo at the other end has a ground; only the sent model is tested."""
        engine.apply(Spawn(world(body("box", (3, 0, 0.5), (0.2, 0.2, 0.2), "dynamic", 1.0)), ground=True))
        assert isinstance(engine, CompiledRemoteEngine)
        assert engine._sent_state.ground.height_m == pytest.approx(0.4)
        assert [model.on_ground for model in engine._sent_state.bodies.values()] == [True]


def test_joint_positions_agree_with_mujoco(served: ServedSimulation) -> None:
    with closing(connect(served.address)) as remote, closing(MujocoEngine()) as local:
        for engine in (remote, local):
            engine.apply(Spawn(room()))
            apply_force_for(engine, "door_handle", (25.0, 0.0, 0.0), 0.6)
        remote_positions, local_positions = remote.joint_positions(), local.joint_positions()
        assert remote_positions.keys() == local_positions.keys()
        for id, position in local_positions.items():
            np.testing.assert_allclose(remote_positions[id], position, atol=1e-9)


def test_the_sent_model_has_roots_and_excluded_pairs(served: ServedSimulation) -> None:
    with closing(connect(served.address)) as engine:
        engine.apply(
            Spawn(
                world(
                    FLOOR,
                    body("case", (0, 0, 0.5), (0.6, 0.6, 1.0)),
                    body("drawer", (0, 0, 0.5), (0.58, 0.5, 0.2), "dynamic", 5.0),
                    body("handle", (0.3, 0, 0.5), (0.02, 0.2, 0.02), "dynamic"),
                    attachment("drawer", "handle"),
                    prismatic_joint("slide", "drawer", "case", (0.3, 0, 0.5)),
                )
            )
        )
    model = msgspec.json.decode(served.models[-1])  # type: ignore[attr-defined]
    assert model["bodies"]["handle"]["top"] == "drawer"
    assert model["bodies"]["handle"]["hold"]["position"] == pytest.approx([0.3, 0, 0])
    assert model["bodies"]["handle"]["mass_kg"] == pytest.approx(0.02 * 0.2 * 0.02 * 200, abs=0.01)
    assert model["bodies"]["drawer"]["mobility"] == "dynamic"
    assert ["case", "drawer"] in model["excluded_pairs"]
    joint = model["joints"]["slide"]
    assert (joint["parent"], joint["child"]) == ("drawer", "case")
    assert joint["of_child"]["position"] == pytest.approx([0.3, 0, 0])


def test_a_force_on_a_body_deleted_before_the_step_is_dropped(served: ServedSimulation) -> None:
    with closing(connect(served.address)) as engine:
        engine.apply(Spawn(room()))
        engine.apply_force(BodyId("mug"), (1.0, 0.0, 0.0))
        engine.apply(Delete((BodyId("mug"),)))
        engine.step(0.1)
        assert "mug" not in engine.poses()[0]


def test_poses_read_twice_after_a_step_are_current(served: ServedSimulation) -> None:
    with closing(connect(served.address)) as engine:
        engine.apply(Spawn(room()))
        for _ in range(3):  # from the second read on, responses of steps contain poses
            engine.step(0.01)
            poses = engine.poses()[1]
        np.testing.assert_allclose(poses, served.simulation.state.poses, atol=1e-12)
        served.simulation.engine.run(
            lambda remote: remote.apply(SetPoses({BodyId("crate"): Pose((7, 7, 7))})), label="set pose"
        )
        assert current_pose(engine, "crate")[0] == 7


def test_bodies_spawned_by_other_clients_are_taken_over(served: ServedSimulation) -> None:
    with closing(connect(served.address)) as engine:
        engine.apply(Spawn(room()))
        served.simulation.spawn(world(body("added", (3, 3, 1), (0.2, 0.2, 0.2), "dynamic", 1.0)))
        assert "added" in engine.poses()[0]
        engine.apply(Attach(BodyId("crate"), BodyId("added")))
        engine.apply(SetPoses({BodyId("crate"): Pose((0, 5, 1))}))
        assert abs(current_pose(engine, "added")[1] - 5) < 5
        assert engine.snapshot().body("added").pose.position[1] != 3


def test_a_restarted_remote_world_can_be_spawned_into(served: ServedSimulation) -> None:
    with closing(connect(served.address, timeout_s=10.0)) as engine:
        engine.apply(Spawn(room()))
        served.stop()
        served.start()
        with pytest.raises(EngineUnavailableError, match="it was restarted"):
            engine.poses()
        assert engine.apply(Spawn(room())).report.ok
        assert len(engine.poses()[0]) == len(room().bodies)
