"""The unreal profile, against a stand-in that follows the plugin's services to the letter.

It was not run against Unreal itself: neither is there an Unreal here.
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
from mindstage.engines import SpawnNoteKind, connect
from mindstage.engines.remote import RemoteProfile
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
from tests.bridge.raw_client import TIMEOUT_S
from tests.engines.contract import DescriptionContract, current_pose, displacement
from tests.engines.scenes import FLOOR, attachment, body, prismatic_joint, room, world
from tests.engines.unreal_peer import FakeUnrealPlugin

YAW_30 = (0.9659258262890683, 0.0, 0.0, 0.25881904510252074)


@pytest.fixture
def server() -> Iterator[RosbridgeServer]:
    with LocalNode() as hub, RosbridgeServer(hub, port=0) as server:
        yield server


@pytest.fixture
def peer(server: RosbridgeServer) -> Iterator[FakeUnrealPlugin]:
    with closing(FakeUnrealPlugin(server.url)) as peer:
        yield peer


def address(server: RosbridgeServer, namespace: str = "unreal") -> str:
    return f"ros://127.0.0.1:{server.port}/{namespace}"


class Wall:
    """A clock on the wall that only moves when somebody waits."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def wait(self, duration_s: float) -> None:
        self.now_s += duration_s


@pytest.fixture
def wall() -> Wall:
    return Wall()


@pytest.fixture
def engine(server: RosbridgeServer, peer: FakeUnrealPlugin, wall: Wall) -> Iterator[UnrealEngine]:
    with closing(connect(address(server))) as found:
        assert found.profile is RemoteProfile.UNREAL
        link = ServiceClient(found._client.address, timeout_s=20.0)
        with closing(UnrealEngine(link, now_s=lambda: wall.now_s, sleep=wall.wait)) as engine:
            yield engine


class TestUnrealEngine(DescriptionContract):
    """All of the contract that the plugin can keep, in single precision."""

    pose_tolerance = 1e-5

    @pytest.fixture
    def engine(self, engine: UnrealEngine) -> UnrealEngine:
        return engine

    def test_attached_bodies_follow_when_their_parent_is_put_elsewhere(self, engine: UnrealEngine) -> None:
        engine.spawn(world(body("table", (1, 2, 3), (1, 1, 0.1)), body("lamp", (1.3, 2, 3.2), (0.1, 0.1, 0.3))))
        engine.attach(BodyId("table"), BodyId("lamp"))
        engine.set_pose(BodyId("table"), Pose((5, 5, 5), YAW_30))
        turned = (5 + 0.3 * np.cos(np.pi / 6), 5 + 0.3 * np.sin(np.pi / 6), 5.2)
        np.testing.assert_allclose(current_pose(engine, "lamp")[:3], turned, atol=self.pose_tolerance)
        np.testing.assert_allclose(current_pose(engine, "lamp")[3:], YAW_30, atol=self.pose_tolerance)

    def test_a_child_put_elsewhere_leaves_its_parent_alone_and_stays_attached(self, engine: UnrealEngine) -> None:
        engine.spawn(
            world(
                body("table", (0, 0, 1), (1, 1, 0.1)),
                body("lamp", (0, 0, 1.2), (0.1, 0.1, 0.3)),
                attachment("table", "lamp"),
            )
        )
        engine.set_pose(BodyId("lamp"), Pose((0.4, 0, 1.2)))
        assert displacement(engine, "table", np.array([0, 0, 1.0])) < self.pose_tolerance
        engine.set_pose(BodyId("table"), Pose((1, 0, 1)))
        np.testing.assert_allclose(current_pose(engine, "lamp")[:3], (1.4, 0, 1.2), atol=self.pose_tolerance)

    def test_attaching_keeps_both_where_they_are_and_detaching_too(self, engine: UnrealEngine) -> None:
        engine.spawn(room())
        before = {id: current_pose(engine, id) for id in ("crate", "mug")}
        engine.attach(BodyId("crate"), BodyId("mug"))
        assert max(displacement(engine, id, start) for id, start in before.items()) < self.pose_tolerance
        engine.detach(BodyId("crate"))  # it hangs nowhere
        with pytest.raises(UnsupportedByEngineError, match="cannot detach; delete that body and spawn it again"):
            engine.detach(BodyId("mug"))
        assert "mug" in {attachment.child for attachment in engine.snapshot().attachments}


def kitchen_of_the_thesis(shared_data: Path) -> World:
    with KnowledgeBase() as knowledge:
        knowledge.load(shared_data / "maps" / "iai-kitchen-original.owl")
        return knowledge.world()


def test_the_thesis_map_arrives_complete_bodies_first_then_constraints_then_attachments(
    server: RosbridgeServer, peer: FakeUnrealPlugin, shared_data: Path
) -> None:
    kitchen = kitchen_of_the_thesis(shared_data)
    with closing(connect(address(server))) as engine:
        report = engine.spawn(kitchen)
        assert report.ok
        assert (report.bodies, report.joints, report.attachments) == (114, 22, len(kitchen.attachments))
        bodies, constraints = [body.id for body in kitchen.bodies], [each.id for each in kitchen.joints]
        relations = [f"{each.parent}<-{each.child}" for each in kitchen.attachments]
        assert peer.order[:114] == bodies
        assert peer.order[114:136] == constraints
        assert sorted(peer.order[136:]) == sorted(relations)
        assert peer.calls.count("spawn_semantic_map") == 2
        untold = {note.text.split(":")[0] for note in report.notes if note.kind is SpawnNoteKind.NOT_TRANSFERRED}
        assert "Unreal does not know its facts" in untold
        assert diff(kitchen, engine.snapshot()).identical(0.0)


def test_a_model_stands_in_unreals_own_frame_with_all_that_the_map_says(
    engine: UnrealEngine, peer: FakeUnrealPlugin
) -> None:
    mug = body("mug", (1, 2, 3), (0.1, 0.1, 0.2), "dynamic", 0.3, quaternion=YAW_30, mesh="/Game/Models/SM_Mug.uasset")
    engine.spawn(world(msgspec.structs.replace(mug, materials=(Material(name="Blue", path="/Game/Looks"),))))
    actor = peer.actors["mug"]
    np.testing.assert_allclose(actor.unreal_pose, (100, -200, 300, YAW_30[0], 0, 0, -YAW_30[3]), rtol=1e-6)
    assert actor.model["name"] == "Mug"
    assert actor.model["physics_properties"] == {
        "mobility": 2, "gravity": True, "generate_overlap_events": False, "mass": 0.3,
    }  # fmt: skip
    assert (actor.model["material_names"], actor.model["material_paths"]) == (["Blue"], ["/Game/Looks"])


def test_what_cannot_be_spawned_is_told_with_the_reason_and_the_rest_stands(
    server: RosbridgeServer, peer: FakeUnrealPlugin, engine: UnrealEngine
) -> None:
    with closing(connect(address(server))) as other:
        other.spawn(world(body("taken", (0, 0, 0), (1, 1, 1))))
    peer.obstructed, peer.without_mesh = {"squeezed"}, {"Ghost"}
    peer.unbreakable_failures = {"weak", "slippery"}
    boxes = [body(id, (i, 0, 0), (0.1, 0.1, 0.1)) for i, id in enumerate(("taken", "squeezed", "a", "b", "slippery"))]
    report = engine.spawn(
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
    reasons = {failure.id: failure.reason for failure in report.failed_bodies}
    assert reasons.keys() == {"taken", "squeezed", "invisible"}
    assert "the id 'taken' is taken" in reasons["taken"]
    assert "something stands in its place" in reasons["squeezed"]
    assert "a mesh SM_Ghost" in reasons["invisible"]
    assert {failure.id for failure in report.failed_joints} == {"weak", "loose"}
    assert [failure.id for failure in report.failed_attachments] == ["slippery"]
    log = engine.snapshot()
    assert {each.id for each in log.bodies} == {"a", "b", "slippery"}
    assert {each.id for each in log.joints} == {"strong"} == set(peer.joints)


def test_what_the_plugin_refuses_is_a_no_of_the_world_and_nothing_is_noted_as_done(
    engine: UnrealEngine, peer: FakeUnrealPlugin
) -> None:
    engine.spawn(world(FLOOR, body("box", (0, 0, 1), (1, 1, 1), "dynamic", 1.0)))
    peer.unbreakable_failures, peer.obstructed = {"box"}, {"box"}
    box, before = BodyId("box"), engine.snapshot()
    with pytest.raises(PoseUnreachableError):
        engine.set_pose(box, Pose((5, 5, 5)))
    for refused in (
        lambda: engine.set_physics(box, BodyPhysics(mobility=Mobility.STATIC)),
        lambda: engine.set_materials(box, (Material(name="Oak"),)),
        lambda: engine.attach(BodyId("floor"), box),
        lambda: engine.highlight([box], (1, 0, 0)),
    ):
        with pytest.raises(WorldError, match="gives no reason"):
            refused()
    assert diff(before, engine.snapshot()).identical(0.0)
    assert not engine.highlights()


def test_what_the_plugin_has_no_service_for_is_said_to_be_impossible(engine: UnrealEngine) -> None:
    engine.spawn(world(FLOOR, body("box", (0, 0, 1), (1, 1, 1), "dynamic", 1.0)))
    engine.apply_force(BodyId("floor"), (1, 0, 0))  # which is static and feels nothing
    with pytest.raises(UnsupportedByEngineError, match="cannot push bodies; put them"):
        engine.apply_force(BodyId("box"), (1, 0, 0))
    with pytest.raises(UnsupportedByEngineError, match="cannot keep its state"):
        engine.save_state()
    with pytest.raises(UnsupportedByEngineError, match="cannot bring a state back"):
        engine.restore_state(None)  # type: ignore[arg-type]
    assert not engine.capabilities
    assert engine.joint_positions() == {}


@pytest.mark.parametrize(("color", "code"), [((1, 0, 0), 2), ((0, 0.9, 0.1), 4), ((0.1, 0.1, 0.1), 1), (None, 0)])
def test_bodies_are_outlined_in_the_nearest_color_that_there_is(
    color: tuple[float, float, float] | None, code: int, engine: UnrealEngine, peer: FakeUnrealPlugin
) -> None:
    engine.spawn(world(FLOOR))
    engine.highlight([BodyId("floor")], color)
    assert peer.actors["floor"].color == code
    assert peer.calls[-1] == "highlight_models"


def test_steps_in_a_row_wait_for_the_clock_on_the_wall_and_no_longer(engine: UnrealEngine, wall: Wall) -> None:
    engine.step(2.0)
    assert wall.now_s == pytest.approx(1002.0)
    wall.now_s += 0.3  # somebody looked at poses, say
    engine.step(1.0)
    assert wall.now_s == pytest.approx(1003.0)
    wall.now_s += 60.0  # somebody had lunch
    engine.step(1.0)
    assert wall.now_s == pytest.approx(1064.0)
    assert engine.time_s == pytest.approx(64.0)


def test_clearing_takes_only_what_mindstage_spawned(
    server: RosbridgeServer, engine: UnrealEngine, peer: FakeUnrealPlugin
) -> None:
    engine.spawn(room())
    with RosbridgeClient(server.url) as human:
        human.wait_connected(20.0)
        model = {**peer.actors["mug"].model, "id": "lamp_of_the_level", "tags": []}
        more = {"override_name": "", "parent_id": "", "spawn_collision_check": False}
        assert human.call_service("/unreal/spawn_model", {**model, **more}, timeout_s=20.0)["success"]
    engine.clear()
    assert set(peer.actors) == {"lamp_of_the_level"}
    assert not peer.joints


def test_what_others_take_away_leaves_the_log_with_a_warning(
    engine: UnrealEngine, peer: FakeUnrealPlugin, caplog: pytest.LogCaptureFixture
) -> None:
    engine.spawn(room())
    del peer.actors["mug"]
    assert "mug" not in {each.id for each in engine.snapshot().bodies}
    assert "no longer there: mug" in caplog.text


def test_a_level_that_was_started_anew_is_said_until_something_is_spawned(
    engine: UnrealEngine, peer: FakeUnrealPlugin
) -> None:
    engine.spawn(room())
    peer.actors.clear()
    peer.joints.clear()
    for call in (engine.poses, engine.snapshot, lambda: engine.delete([BodyId("mug")])):
        with pytest.raises(EngineUnavailableError, match="started anew"):
            call()
    assert engine.spawn(room()).ok
    assert len(peer.actors) == len(room().bodies)


def test_a_plugin_that_leaves_in_the_middle_of_a_spawn_is_gone_and_later_the_same_world_can_be_spawned(
    engine: UnrealEngine, peer: FakeUnrealPlugin
) -> None:
    peer.stops_after = 4
    with ThreadPoolExecutor(1) as other:
        spawning = other.submit(engine.spawn, room())
        assert peer.stopped.wait(TIMEOUT_S)
        peer.close()
        with pytest.raises(EngineError, match="the provider of /unreal/spawn_semantic_map disconnected"):
            spawning.result(TIMEOUT_S)
    with pytest.raises(EngineUnavailableError, match="does not exist"):
        engine.ping()
    peer.connect()
    assert len(peer.actors) == 4
    assert engine.spawn(room()).ok
    assert diff(room(), engine.snapshot()).identical(0.0)


# -- the stand-in itself -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["highlight_model", "set_material", "spawn_map"])
def test_the_stand_in_knows_only_the_plugins_names(name: str, server: RosbridgeServer, peer: FakeUnrealPlugin) -> None:
    with RosbridgeClient(server.url) as client, pytest.raises(ServiceNotFoundError):
        client.wait_connected(20.0).call_service(f"/unreal/{name}", {}, timeout_s=20.0)


@pytest.mark.parametrize("args", [{}, {"id": 1}, {"id": "x", "more": 1}])
def test_the_stand_in_reads_every_field_and_no_other(
    args: dict, server: RosbridgeServer, peer: FakeUnrealPlugin
) -> None:
    with RosbridgeClient(server.url) as client, pytest.raises(ServiceCallError, match=r"expected|is no str"):
        client.wait_connected(20.0).call_service("/unreal/get_model_pose", args, timeout_s=20.0)
