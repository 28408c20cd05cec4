"""The unreal profile, with a fake plugin that follows the service reference strictly.

It has not been tested with Unreal itself, which is not available here.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import msgspec
import numpy as np
import pytest

from mindstage.bridge import LocalNode, RosbridgeClient, RosbridgeServer
from mindstage.engines import SpawnNoteKind
from mindstage.engines.remote import RemoteProfile, connect
from mindstage.engines.remote.client import ServiceClient
from mindstage.engines.remote.unreal import UnrealEngine
from mindstage.errors import (
    EngineError,
    EngineUnavailableError,
    PoseUnreachableError,
    ServiceCallError,
    ServiceNotFoundError,
    UnsupportedByEngineError,
    WorldError,
)
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyId, BodyPhysics, Material, Mobility, Pose, World, diff
from mindstage.scene.edits import Attach, Delete, Detach, SetMaterials, SetPhysics, SetPoses, Spawn
from tests.bridge.raw_client import TIMEOUT_S
from tests.engines.contract import DescriptionContract, current_pose, displacement, gripper
from tests.engines.remote.fake_unreal import FakeUnrealPlugin
from tests.engines.scenes import FLOOR, attachment, body, prismatic_joint, room, world
from tests.maps.logged_maps import LoggedBody, individual_id, logged_map, yaw
from tests.maps.small_maps import knowledge_base_from

YAW_30 = (0.9659258262890683, 0.0, 0.0, 0.25881904510252074)


@pytest.fixture
def server() -> Iterator[RosbridgeServer]:
    with LocalNode() as hub, RosbridgeServer(hub, port=0) as server:
        yield server


@pytest.fixture
def plugin(server: RosbridgeServer) -> Iterator[FakeUnrealPlugin]:
    with closing(FakeUnrealPlugin(server.url)) as plugin:
        yield plugin


def address(server: RosbridgeServer, namespace: str = "unreal") -> str:
    return f"ros://127.0.0.1:{server.port}/{namespace}"


class FakeClock:
    """A wall clock that advances only by waiting."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def wait(self, duration_s: float) -> None:
        self.now_s += duration_s


@pytest.fixture
def clock() -> FakeClock:
    return FakeClock()


@pytest.fixture
def engine(server: RosbridgeServer, plugin: FakeUnrealPlugin, clock: FakeClock) -> Iterator[UnrealEngine]:
    with closing(connect(address(server))) as found:
        assert found.profile is RemoteProfile.UNREAL
        client = ServiceClient(found._client.address, timeout_s=20.0)
        with closing(UnrealEngine(client, now_s=lambda: clock.now_s, sleep=clock.wait)) as engine:
            yield engine


class TestUnrealEngine(DescriptionContract):
    """The part of the contract that the plugin supports, in single precision."""

    pose_tolerance = 1e-5

    @pytest.fixture
    def engine(self, engine: UnrealEngine) -> UnrealEngine:
        return engine

    @pytest.mark.parametrize("multiplier", [1.0])
    def test_a_joint_that_mimics_another_one_follows_poses_that_are_set(
        self, engine: UnrealEngine, multiplier: float
    ) -> None:
        """The plugin's protocol has no such joints; the report says that they move independently."""
        report = engine.apply(Spawn(gripper(multiplier))).report
        assert any("mimic" in note.text for note in report.notes if note.kind is SpawnNoteKind.UNSTATED)

    def test_attached_bodies_move_with_their_parent(self, engine: UnrealEngine) -> None:
        engine.apply(Spawn(world(body("table", (1, 2, 3), (1, 1, 0.1)), body("lamp", (1.3, 2, 3.2), (0.1, 0.1, 0.3)))))
        engine.apply(Attach(BodyId("table"), BodyId("lamp")))
        engine.apply(SetPoses({BodyId("table"): Pose((5, 5, 5), YAW_30)}))
        rotated = (5 + 0.3 * np.cos(np.pi / 6), 5 + 0.3 * np.sin(np.pi / 6), 5.2)
        np.testing.assert_allclose(current_pose(engine, "lamp")[:3], rotated, atol=self.pose_tolerance)
        np.testing.assert_allclose(current_pose(engine, "lamp")[3:], YAW_30, atol=self.pose_tolerance)

    def test_moving_an_attached_child_keeps_its_parent_and_the_attachment(self, engine: UnrealEngine) -> None:
        engine.apply(
            Spawn(
                world(
                    body("table", (0, 0, 1), (1, 1, 0.1)),
                    body("lamp", (0, 0, 1.2), (0.1, 0.1, 0.3)),
                    attachment("table", "lamp"),
                )
            )
        )
        engine.apply(SetPoses({BodyId("lamp"): Pose((0.4, 0, 1.2))}))
        assert displacement(engine, "table", np.array([0, 0, 1.0])) < self.pose_tolerance
        engine.apply(SetPoses({BodyId("table"): Pose((1, 0, 1))}))
        np.testing.assert_allclose(current_pose(engine, "lamp")[:3], (1.4, 0, 1.2), atol=self.pose_tolerance)

    def test_attaching_and_detaching_keep_poses(self, engine: UnrealEngine) -> None:
        engine.apply(Spawn(room()))
        before = {id: current_pose(engine, id) for id in ("crate", "mug")}
        engine.apply(Attach(BodyId("crate"), BodyId("mug")))
        assert max(displacement(engine, id, start) for id, start in before.items()) < self.pose_tolerance
        engine.apply(Detach(BodyId("crate")))  # it is not attached
        with pytest.raises(UnsupportedByEngineError, match="cannot detach; delete that body and spawn it again"):
            engine.apply(Detach(BodyId("mug")))
        assert "mug" in {attachment.child for attachment in engine.snapshot().attachments}


def kitchen_of_the_thesis(shared_data: Path) -> World:
    with KnowledgeBase() as knowledge:
        knowledge.load(shared_data / "maps" / "iai-kitchen-original.owl")
        return knowledge.world()


def test_the_thesis_map_is_spawned_completely_and_in_order(
    server: RosbridgeServer, plugin: FakeUnrealPlugin, shared_data: Path
) -> None:
    kitchen = kitchen_of_the_thesis(shared_data)
    with closing(connect(address(server))) as engine:
        report = engine.apply(Spawn(kitchen)).report
        assert report.ok
        assert (report.bodies, report.joints, report.attachments) == (114, 22, len(kitchen.attachments))
        bodies, joints = [body.id for body in kitchen.bodies], [each.id for each in kitchen.joints]
        relations = [f"{each.parent}<-{each.child}" for each in kitchen.attachments]
        assert plugin.order[:114] == bodies
        assert plugin.order[114:136] == joints
        assert sorted(plugin.order[136:]) == sorted(relations)
        assert plugin.calls.count("spawn_semantic_map") == 2
        not_transferred = {note.text.split(":")[0] for note in report.notes if note.kind is SpawnNoteKind.UNSTATED}
        assert "facts not sent to Unreal" in not_transferred
        assert diff(kitchen, engine.snapshot()).identical(0.0)


def test_a_model_has_unreals_axes_and_all_properties_of_the_map(engine: UnrealEngine, plugin: FakeUnrealPlugin) -> None:
    mug = body("mug", (1, 2, 3), (0.1, 0.1, 0.2), "dynamic", 0.3, quaternion=YAW_30, mesh="/Game/Models/SM_Mug.uasset")
    engine.apply(Spawn(world(msgspec.structs.replace(mug, materials=(Material(name="Blue", path="/Game/Looks"),)))))
    actor = plugin.actors["mug"]
    np.testing.assert_allclose(actor.unreal_pose, (100, -200, 300, YAW_30[0], 0, 0, -YAW_30[3]), rtol=1e-6)
    assert actor.model["name"] == "Mug"
    assert actor.model["physics_properties"] == {
        "mobility": 2, "gravity": True, "generate_overlap_events": False, "mass": 0.3,
    }  # fmt: skip
    assert (actor.model["material_names"], actor.model["material_paths"]) == (["Blue"], ["/Game/Looks"])


def test_failures_are_reported_with_reasons_and_the_rest_is_spawned(
    server: RosbridgeServer, plugin: FakeUnrealPlugin, engine: UnrealEngine
) -> None:
    with closing(connect(address(server))) as other:
        other.apply(Spawn(world(body("taken", (0, 0, 0), (1, 1, 1)))))
    plugin.obstructed, plugin.without_mesh = {"squeezed"}, {"Ghost"}
    plugin.unbreakable_failures = {"weak", "slippery"}
    boxes = [body(id, (i, 0, 0), (0.1, 0.1, 0.1)) for i, id in enumerate(("taken", "squeezed", "a", "b", "slippery"))]
    report = engine.apply(
        Spawn(
            world(
                *boxes,
                body("invisible", (9, 0, 0), (1, 1, 1), mesh="Ghost"),
                prismatic_joint("weak", "a", "b", (0, 0, 0)),
                prismatic_joint("strong", "a", "b", (0, 0, 0)),
                prismatic_joint("loose", "a", "taken", (0, 0, 0)),
                attachment("a", "slippery"),
                attachment("a", "b"),
            )
        )
    ).report
    reasons = {failure.id: failure.reason for failure in report.failed_bodies}
    assert reasons.keys() == {"taken", "squeezed", "invisible"}
    assert "the id 'taken' is taken" in reasons["taken"]
    assert "its place is obstructed" in reasons["squeezed"]
    assert "a mesh SM_Ghost" in reasons["invisible"]
    assert {failure.id for failure in report.failed_joints} == {"weak", "loose"}
    assert [failure.id for failure in report.failed_attachments] == ["slippery"]
    snapshot = engine.snapshot()
    assert {each.id for each in snapshot.bodies} == {"a", "b", "slippery"}
    assert {each.id for each in snapshot.joints} == {"strong"} == set(plugin.joints)


def test_a_request_refused_by_the_plugin_is_a_world_error_and_changes_nothing(
    engine: UnrealEngine, plugin: FakeUnrealPlugin
) -> None:
    engine.apply(Spawn(world(FLOOR, body("box", (0, 0, 1), (1, 1, 1), "dynamic", 1.0))))
    plugin.unbreakable_failures, plugin.obstructed = {"box"}, {"box"}
    box, before = BodyId("box"), engine.snapshot()
    with pytest.raises(PoseUnreachableError):
        engine.apply(SetPoses({box: Pose((5, 5, 5))}))
    for refused in (
        lambda: engine.apply(SetPhysics(box, BodyPhysics(mobility=Mobility.STATIC))),
        lambda: engine.apply(SetMaterials(box, (Material(name="Oak"),))),
        lambda: engine.apply(Attach(BodyId("floor"), box)),
        lambda: engine.highlight([box], (1, 0, 0)),
    ):
        with pytest.raises(WorldError, match="without a reason"):
            refused()
    assert diff(before, engine.snapshot()).identical(0.0)
    assert not engine.highlights()


def test_operations_without_a_service_are_unsupported(engine: UnrealEngine) -> None:
    engine.apply(Spawn(world(FLOOR, body("box", (0, 0, 1), (1, 1, 1), "dynamic", 1.0))))
    engine.apply_force(BodyId("floor"), (1, 0, 0))  # a static body ignores forces
    with pytest.raises(UnsupportedByEngineError, match="cannot apply forces; move bodies"):
        engine.apply_force(BodyId("box"), (1, 0, 0))
    with pytest.raises(UnsupportedByEngineError, match="cannot save its state"):
        engine.save_state()
    with pytest.raises(UnsupportedByEngineError, match="cannot restore a state"):
        engine.restore_state(None)  # type: ignore[arg-type]
    assert not engine.capabilities
    assert engine.joint_positions() == {}


@pytest.mark.parametrize(("color", "code"), [((1, 0, 0), 2), ((0, 0.9, 0.1), 4), ((0.1, 0.1, 0.1), 1), (None, 0)])
def test_bodies_are_outlined_in_the_nearest_available_color(
    color: tuple[float, float, float] | None, code: int, engine: UnrealEngine, plugin: FakeUnrealPlugin
) -> None:
    engine.apply(Spawn(world(FLOOR)))
    engine.highlight([BodyId("floor")], color)
    assert plugin.actors["floor"].color == code
    assert plugin.calls[-1] == "highlight_models"


def test_consecutive_steps_wait_for_the_wall_clock_and_not_longer(engine: UnrealEngine, clock: FakeClock) -> None:
    engine.step(2.0)
    assert clock.now_s == pytest.approx(1002.0)
    clock.now_s += 0.3  # poses are read in between
    engine.step(1.0)
    assert clock.now_s == pytest.approx(1003.0)
    clock.now_s += 60.0  # a long pause
    engine.step(1.0)
    assert clock.now_s == pytest.approx(1064.0)
    assert engine.time_s == pytest.approx(64.0)


def test_models_are_placed_by_the_origins_of_their_meshes(
    engine: UnrealEngine, plugin: FakeUnrealPlugin, tmp_path: Path
) -> None:
    """A wall whose mesh has its origin at the foot: Unreal gets the pose of the map, a world has that of the center."""
    wall = LoggedBody("wall", "LabWall", (0.2, 6.0, 2.5), (1.0, 2.0, 1.25), yaw(90), pivot=(0.0, 0.0, -1.25))
    cupboards = [LoggedBody(f"cupboard{n}", "Cupboard", (0.6, 0.6, 0.9), (n, 0.0, 0.45)) for n in range(3)]
    (tmp_path / "map.ttl").write_text(logged_map([wall, *cupboards]), encoding="utf-8")
    logged = knowledge_base_from(tmp_path / "map.ttl").world()
    engine.apply(Spawn(logged))
    id = BodyId(individual_id("wall"))
    model = plugin.actors[id].model["pose"]["position"]
    assert (model["x"], model["y"], model["z"]) == pytest.approx((1.0, 2.0, 0.0))
    assert engine.snapshot().body(id).pose == logged.body(id).pose
    engine.apply(SetPoses({id: Pose((3.0, 4.0, 1.25), YAW_30)}))
    assert current_pose(engine, id)[:3] == pytest.approx((3.0, 4.0, 1.25), abs=1e-5)


def test_clearing_deletes_only_what_mindstage_spawned(
    server: RosbridgeServer, engine: UnrealEngine, plugin: FakeUnrealPlugin
) -> None:
    engine.apply(Spawn(room()))
    with RosbridgeClient(server.url) as foreign:
        foreign.wait_connected(20.0)
        model = {**plugin.actors["mug"].model, "id": "lamp_of_the_level", "tags": []}
        more = {"override_name": "", "parent_id": "", "spawn_collision_check": False}
        assert foreign.call_service("/unreal/spawn_model", {**model, **more}, timeout_s=20.0)["success"]
    engine.clear()
    assert set(plugin.actors) == {"lamp_of_the_level"}
    assert not plugin.joints


def test_bodies_deleted_by_others_leave_the_snapshot_with_a_warning(
    engine: UnrealEngine, plugin: FakeUnrealPlugin, caplog: pytest.LogCaptureFixture
) -> None:
    engine.apply(Spawn(room()))
    del plugin.actors["mug"]
    assert "mug" not in {each.id for each in engine.snapshot().bodies}
    assert "no longer in the world: mug" in caplog.text


def test_a_restarted_level_is_reported_until_a_world_is_spawned(engine: UnrealEngine, plugin: FakeUnrealPlugin) -> None:
    engine.apply(Spawn(room()))
    plugin.actors.clear()
    plugin.joints.clear()
    for call in (engine.poses, engine.snapshot, lambda: engine.apply(Delete((BodyId("mug"),)))):
        with pytest.raises(EngineUnavailableError, match="restarted"):
            call()
    assert engine.apply(Spawn(room())).report.ok
    assert len(plugin.actors) == len(room().bodies)


def test_after_a_disconnection_during_a_spawn_the_same_world_can_be_spawned(
    engine: UnrealEngine, plugin: FakeUnrealPlugin
) -> None:
    plugin.stops_after = 4
    with ThreadPoolExecutor(1) as other:
        spawning = other.submit(engine.apply, Spawn(room()))
        assert plugin.stopped.wait(TIMEOUT_S)
        plugin.close()
        with pytest.raises(EngineError, match="the provider of /unreal/spawn_semantic_map disconnected"):
            spawning.result(TIMEOUT_S)
    with pytest.raises(EngineUnavailableError, match="does not exist"):
        engine.ping()
    plugin.connect()
    assert len(plugin.actors) == 4
    assert engine.apply(Spawn(room())).report.ok
    assert diff(room(), engine.snapshot()).identical(0.0)


# -- the fake itself ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["highlight_model", "set_material", "spawn_map"])
def test_the_fake_plugin_offers_only_the_plugins_services(
    name: str, server: RosbridgeServer, plugin: FakeUnrealPlugin
) -> None:
    with RosbridgeClient(server.url) as client, pytest.raises(ServiceNotFoundError):
        client.wait_connected(20.0).call_service(f"/unreal/{name}", {}, timeout_s=20.0)


@pytest.mark.parametrize("args", [{}, {"id": 1}, {"id": "x", "more": 1}])
def test_the_fake_plugin_reads_every_field_and_no_other(
    args: dict, server: RosbridgeServer, plugin: FakeUnrealPlugin
) -> None:
    with RosbridgeClient(server.url) as client, pytest.raises(ServiceCallError, match=r"expected|is no str"):
        client.wait_connected(20.0).call_service("/unreal/get_model_pose", args, timeout_s=20.0)
