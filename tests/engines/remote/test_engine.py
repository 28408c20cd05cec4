"""RemoteEngine: addresses, profiles, time control, saved states, and data on the wire."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import closing
from urllib.parse import quote

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.engines import Capability, NullEngine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.engines.remote import RemoteEngine, RemoteProfile, RemoteUrl, connect
from mindstage.errors import (
    BodyNotFoundError,
    EngineUnavailableError,
    MessageValidationError,
    NumberRefusedError,
    PoseUnreachableError,
)
from mindstage.scene import (
    AxisMotion,
    Body,
    BodyId,
    Iri,
    Light,
    LightType,
    LinearLimits,
    Literal,
    Material,
    Pose,
    PropertyAssertion,
    World,
    diff,
)
from mindstage.scene.edits import Delete, SetPoses, Spawn
from tests.bridge.raw_client import eventually
from tests.cases import each_case
from tests.engines.remote.served_simulation import ServedSimulation
from tests.engines.scenes import BASE, FLOOR, body, prismatic_joint, room, world
from tests.worlds import worlds

NAN = float("nan")


@pytest.fixture
def served() -> Iterator[ServedSimulation]:
    with ServedSimulation(NullEngine) as served:
        yield served


@pytest.fixture
def engine(served: ServedSimulation) -> Iterator[RemoteEngine]:
    with closing(connect(served.address)) as engine:
        yield engine


# -- addresses ---------------------------------------------------------------------------------------------------------


@each_case(
    ("text", "address", "shown"),
    [
        ("ros://robot", RemoteUrl(host="robot"), "ros://robot:9090/unreal"),
        ("ros://robot/", RemoteUrl(host="robot"), "ros://robot:9090/unreal"),
        ("ros://1.2.3.4:80/a/b/", RemoteUrl(host="1.2.3.4", port=80, namespace="a/b"), "ros://1.2.3.4:80/a/b"),
        ("ros://[::1]:80/lab", RemoteUrl(host="::1", port=80, namespace="lab"), "ros://[::1]:80/lab"),
        ("ros://robot/lab?token=a%26b", RemoteUrl(host="robot", namespace="lab", token="a&b"), "ros://robot:9090/lab"),
        (
            "ros://robot?profile=unreal",
            RemoteUrl(host="robot", profile=RemoteProfile.UNREAL),
            "ros://robot:9090/unreal",
        ),
    ],
)
def test_an_address_is_parsed_and_shown_without_its_token(text: str, address: RemoteUrl, shown: str) -> None:
    assert RemoteUrl.parse(text) == address
    assert str(address) == shown
    assert address.url == f"ws://{shown.removeprefix('ros://').partition('/')[0]}"


@each_case(
    ("text", "reason"),
    [
        ("ros://", r"it is not a valid address; write ros:// or ros\+tls://HOST"),
        ("ws://robot", "it is not a valid address"),
        ("ros://robot:port/x?token=secret", "it is not a valid address: .*port"),
        ("ros://robot:99999/x?token=secret", "it is not a valid address: .*0-65535"),
        ("ros://me:secret@robot/x", "it is not a valid address"),
        ("ros://robot/x?tokn=secret", "unknown parameter 'tokn'; the parameters are token, profile and ca"),
        ("ros://robot/x?token=secret&profile=unity", "unknown profile 'unity'; choose mindstage or unreal"),
    ],
)
def test_an_invalid_address_is_refused_without_revealing_the_token(text: str, reason: str) -> None:
    with pytest.raises(EngineUnavailableError, match=reason) as refused:
        RemoteUrl.parse(text)
    assert "token=secret" not in str(refused.value)


@given(
    host=st.from_regex(r"[a-z][a-z0-9-]{0,10}", fullmatch=True),
    port=st.integers(0, 65535),
    names=st.lists(st.from_regex(r"[a-z]\w{0,8}", fullmatch=True), min_size=1, max_size=3),
    token=st.text(st.characters(exclude_categories=["Cs"]), max_size=20),
)
def test_any_address_is_parsed_from_its_text(host: str, port: int, names: list[str], token: str) -> None:
    address = RemoteUrl(host=host, port=port, namespace="/".join(names), token=token)
    assert RemoteUrl.parse(f"{address}?token={quote(token, safe='')}") == address


# -- profiles ----------------------------------------------------------------------------------------------------------


def test_another_mindstage_is_detected_with_its_capabilities(served: ServedSimulation, engine: RemoteEngine) -> None:
    assert engine.profile is RemoteProfile.MINDSTAGE
    assert engine.name == served.address
    assert engine.capabilities == {Capability.SAVE}
    assert 0.0 <= engine.ping() < 20.0


def test_a_mindstage_can_be_used_through_the_unreal_profile(served: ServedSimulation) -> None:
    with closing(connect(f"{served.address}?profile=unreal")) as engine:
        assert engine.profile is RemoteProfile.UNREAL
        assert engine.apply(Spawn(room())).report.ok
        assert diff(room(), engine.snapshot()).identical(0.0)
        assert {each.id for each in served.simulation.snapshot().bodies} == {each.id for each in room().bodies}
        engine.clear()
    assert served.simulation.snapshot().bodies == ()


def test_a_wrong_namespace_is_answered_with_the_right_one(served: ServedSimulation) -> None:
    with pytest.raises(EngineUnavailableError, match="no engine answers below /lab there; engines there: /unreal"):
        connect(served.address.replace("/unreal", "/lab"))


def test_a_rosbridge_without_an_engine_names_what_to_start() -> None:
    with LocalNode() as hub, RosbridgeServer(hub, port=0) as server:
        address = f"ros://127.0.0.1:{server.port}"
        with pytest.raises(EngineUnavailableError, match="start mindstage serve there"):
            connect(address)
        with pytest.raises(EngineUnavailableError, match="no engine of the profile unreal answers"):
            connect(address, profile=RemoteProfile.UNREAL)


def test_only_the_right_token_connects_and_no_text_reveals_it() -> None:
    with ServedSimulation(NullEngine, token="open sesame") as served:
        with closing(connect(f"{served.address}?token=open%20sesame")) as engine:
            assert engine.apply(Spawn(room())).report.ok
            assert "sesame" not in engine.name
        for wrong in ("?token=close%20sesame", ""):
            with pytest.raises(EngineUnavailableError, match="token") as refused:
                connect(served.address + wrong, timeout_s=5.0)
            assert "sesame" not in str(refused.value)


# -- time --------------------------------------------------------------------------------------------------------------


def test_a_running_world_is_paused_while_its_time_is_controlled(
    served: ServedSimulation,
) -> None:
    served.simulation.spawn(room())
    served.simulation.play(speed=2.0)
    with closing(connect(served.address)) as engine:
        began_s = engine.time_s
        engine.step(0.5)
        assert not served.simulation.state.playing
        assert engine.time_s == pytest.approx(began_s + 0.5)
    eventually(lambda: served.simulation.state.playing)
    assert served.simulation.state.speed == 2.0


def test_a_paused_world_stays_paused(served: ServedSimulation) -> None:
    connect(served.address).close()
    assert not served.simulation.state.playing


def test_a_running_world_can_be_observed_without_controlling_its_time(served: ServedSimulation) -> None:
    served.simulation.spawn(room())
    served.simulation.play()
    with closing(connect(served.address, control_time=False)) as engine:
        began_s = engine.time_s
        eventually(lambda: engine.time_s > began_s)
    assert served.simulation.state.playing


# -- states ------------------------------------------------------------------------------------------------------------


def saved_state_count(served: ServedSimulation) -> int:
    """The number of states on the remote side, from its error message on an unknown handle."""
    with pytest.raises(Exception, match="no saved state") as error:
        served.hub.call_service("/unreal/mindstage/restore_state", {"handle": "?"})
    names = str(error.value).partition("there is ")[2].splitlines()[0]
    return 0 if names == "none" else len(names.split(","))


def test_unreferenced_states_are_deleted_remotely(served: ServedSimulation, engine: RemoteEngine) -> None:
    engine.apply(Spawn(room()))
    first = engine.save_state()
    for _ in range(100):
        engine.save_state()
    gc.collect()
    engine.apply(Delete((BodyId("mug"),)))
    engine.restore_state(first)
    assert "mug" in engine.poses()[0]
    assert saved_state_count(served) <= 3
    engine.close()
    assert saved_state_count(served) == 0


def test_a_state_of_another_engine_is_refused(served: ServedSimulation, engine: RemoteEngine) -> None:
    with closing(connect(served.address)) as other:
        for foreign in (other.save_state(), NullEngine().save_state(), None):
            with pytest.raises(TypeError, match="this engine's save_state"):
                engine.restore_state(foreign)  # type: ignore[arg-type]


# -- data on the wire --------------------------------------------------------------------------------------------------


def test_entities_that_json_cannot_express_fail_and_the_rest_is_spawned(engine: RemoteEngine) -> None:
    lamp = Light(id=BodyId("lamp"), iri=Iri(BASE + "lamp"), type=LightType.POINT, pose=Pose(), intensity=NAN)
    painted = body("painted", (5, 0, 0), (1, 1, 1), materials=(Material(name="Sky", color=(0.0, 0.0, NAN)),))
    invalid = world(
        FLOOR,
        body("nowhere", (NAN, 0, 0), (1, 1, 1)),
        body("box", (0, 0, 1), (1, 1, 1)),
        painted,
        msgspec.structs.replace(
            prismatic_joint("mad", "floor", "box", (0, 0, 0)), linear=LinearLimits(x=AxisMotion.LIMITED, limit=NAN)
        ),
        prismatic_joint("loose", "floor", "nowhere", (0, 0, 0)),
    )
    report = engine.apply(Spawn(msgspec.structs.replace(invalid, lights=(lamp,)))).report
    assert {failure.id for failure in report.failed_bodies} == {"nowhere", "painted", "lamp"}
    reasons = {failure.id: failure.reason for failure in (*report.failed_bodies, *report.failed_joints)}
    assert "not finite" in reasons["nowhere"]
    assert "not all finite" in reasons["mad"]
    assert "materials" in reasons["painted"]
    assert "'nowhere', which does not exist" in reasons["loose"]
    assert engine.poses()[0] == ("floor", "box")


def test_numbers_that_json_cannot_express_change_nothing(engine: RemoteEngine) -> None:
    engine.apply(Spawn(room()))
    mug = BodyId("mug")
    with pytest.raises(PoseUnreachableError, match="not finite"):
        engine.apply(SetPoses({mug: Pose((NAN, 0, 0))}))
    with pytest.raises(NumberRefusedError, match="force"):
        engine.apply_force(mug, (NAN, 0, 0))
    with pytest.raises(NumberRefusedError, match="duration_s"):
        engine.step(NAN)
    assert diff(room(), engine.snapshot()).identical(0.0)


def test_a_world_too_large_for_one_message_is_refused_before_it_is_sent(engine: RemoteEngine) -> None:
    story = PropertyAssertion(Iri(BASE + "story"), Literal("x" * (33 << 20)))
    too_large = World(iri=Iri(BASE + "huge"), facts=(story,))
    with pytest.raises(MessageValidationError, match="33 MiB, and one message can have 32 MiB"):
        engine.apply(Spawn(too_large))
    assert engine.snapshot().facts == ()


def test_a_world_of_a_thousand_bodies_is_returned_completely(engine: RemoteEngine) -> None:
    bodies: tuple[Body, ...] = tuple(body(f"box{i}", (i, i % 7, 0.1 * i), (0.1, 0.2, 0.3)) for i in range(1000))
    assert engine.apply(Spawn(world(*bodies))).report.bodies == 1000
    assert diff(world(*bodies), engine.snapshot()).identical(0.0)
    assert engine.poses()[1].shape == (1000, 7)


@pytest.fixture(scope="module")
def engine_of_all_examples() -> Iterator[RemoteEngine]:
    with ServedSimulation(MujocoEngine) as served, closing(connect(served.address)) as engine:
        yield engine


@settings(max_examples=25)
@given(described=worlds(max_bodies=6))
def test_any_world_is_returned_unchanged_over_the_socket(
    engine_of_all_examples: RemoteEngine, described: World
) -> None:
    engine = engine_of_all_examples
    engine.clear()
    report = engine.apply(Spawn(described)).report
    assert report.ok, report
    found = diff(described, engine.snapshot())
    assert found.identical(0.0), found


def test_similar_names_are_suggested(engine: RemoteEngine) -> None:
    engine.apply(Spawn(room()))
    with pytest.raises(BodyNotFoundError, match="no body 'drawr' in 'scene'; near: 'drawer'"):
        engine.apply(SetPoses({BodyId("drawr"): Pose()}))
