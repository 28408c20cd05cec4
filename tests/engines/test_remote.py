"""RemoteEngine: who is met at an address, what travels, and whose time it is."""

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
from mindstage.engines import Capability, MujocoEngine, NullEngine, RemoteEngine, connect
from mindstage.engines.remote import RemoteProfile, RemoteUrl
from mindstage.errors import BodyNotFoundError, EngineUnavailableError, MessageValidationError, PoseUnreachableError
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
from tests.bridge.raw_client import eventually
from tests.engines.far_side import ServedSimulation
from tests.engines.scenes import BASE, FLOOR, body, prismatic_joint, room, world
from tests.worlds import worlds

NAN = float("nan")


@pytest.fixture
def far_side() -> Iterator[ServedSimulation]:
    with ServedSimulation(NullEngine) as far_side:
        yield far_side


@pytest.fixture
def engine(far_side: ServedSimulation) -> Iterator[RemoteEngine]:
    with closing(connect(far_side.address)) as engine:
        yield engine


# -- addresses ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
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
def test_an_address_is_read_as_it_is_typed_and_shown_without_its_token(
    text: str, address: RemoteUrl, shown: str
) -> None:
    assert RemoteUrl.parse(text) == address
    assert str(address) == shown
    assert address.url == f"ws://{shown.removeprefix('ros://').partition('/')[0]}"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("ros://", "it is no address; write ros://HOST"),
        ("ws://robot", "it is no address"),
        ("ros://robot:port/x?token=secret", "it is no address: .*port"),
        ("ros://robot:99999/x?token=secret", "it is no address: .*0-65535"),
        ("ros://me:secret@robot/x", "it is no address"),
        ("ros://robot/x?tokn=secret", "an address has no 'tokn'; there is token and profile"),
        ("ros://robot/x?token=secret&profile=unity", "no profile 'unity'; choose mindstage or unreal"),
    ],
)
def test_what_is_no_address_is_refused_with_the_form_of_one_and_keeps_the_token_secret(text: str, why: str) -> None:
    with pytest.raises(EngineUnavailableError, match=why) as refused:
        RemoteUrl.parse(text)
    assert "token=secret" not in str(refused.value)


@given(
    host=st.from_regex(r"[a-z][a-z0-9-]{0,10}", fullmatch=True),
    port=st.integers(0, 65535),
    names=st.lists(st.from_regex(r"[a-z]\w{0,8}", fullmatch=True), min_size=1, max_size=3),
    token=st.text(st.characters(exclude_categories=["Cs"]), max_size=20),
)
def test_any_address_is_read_back(host: str, port: int, names: list[str], token: str) -> None:
    address = RemoteUrl(host=host, port=port, namespace="/".join(names), token=token)
    assert RemoteUrl.parse(f"{address}?token={quote(token, safe='')}") == address


# -- meeting -----------------------------------------------------------------------------------------------------------


def test_another_mindstage_is_met_as_such_with_its_powers(far_side: ServedSimulation, engine: RemoteEngine) -> None:
    assert engine.profile is RemoteProfile.MINDSTAGE
    assert engine.name == far_side.address
    assert engine.capabilities == {Capability.SAVE}
    assert 0.0 <= engine.ping() < 20.0


def test_a_mindstage_can_be_met_as_if_it_were_unreal(far_side: ServedSimulation) -> None:
    with closing(connect(f"{far_side.address}?profile=unreal")) as engine:
        assert engine.profile is RemoteProfile.UNREAL
        assert engine.spawn(room()).ok
        assert diff(room(), engine.snapshot()).identical(0.0)
        assert {each.id for each in far_side.stage.snapshot().bodies} == {each.id for each in room().bodies}
        engine.clear()
    assert far_side.stage.snapshot().bodies == ()


def test_where_no_engine_is_it_is_told_where_one_is(far_side: ServedSimulation) -> None:
    with pytest.raises(EngineUnavailableError, match="no engine answers below /lab there; there is one below /unreal"):
        connect(far_side.address.replace("/unreal", "/lab"))


def test_a_rosbridge_without_any_engine_says_what_to_start() -> None:
    with LocalNode() as hub, RosbridgeServer(hub, port=0) as server:
        address = f"ros://127.0.0.1:{server.port}"
        with pytest.raises(EngineUnavailableError, match="start mindstage serve there"):
            connect(address)
        with pytest.raises(EngineUnavailableError, match="no engine of the profile unreal answers"):
            connect(address, profile=RemoteProfile.UNREAL)


def test_only_the_right_token_opens_and_no_text_tells_it() -> None:
    with ServedSimulation(NullEngine, token="open sesame") as far_side:
        with closing(connect(f"{far_side.address}?token=open%20sesame")) as engine:
            assert engine.spawn(room()).ok
            assert "sesame" not in engine.name
        for wrong in ("?token=close%20sesame", ""):
            with pytest.raises(EngineUnavailableError, match="token") as refused:
                connect(far_side.address + wrong, timeout_s=5.0)
            assert "sesame" not in str(refused.value)


# -- time --------------------------------------------------------------------------------------------------------------


def test_a_world_that_lives_by_itself_waits_while_it_is_driven_and_lives_on_afterwards(
    far_side: ServedSimulation,
) -> None:
    far_side.stage.spawn(room())
    far_side.stage.play(speed=2.0)
    with closing(connect(far_side.address)) as engine:
        began_s = engine.time_s
        engine.step(0.5)
        assert not far_side.stage.state.playing
        assert engine.time_s == pytest.approx(began_s + 0.5)
    eventually(lambda: far_side.stage.state.playing)
    assert far_side.stage.state.speed == 2.0


def test_a_world_that_stands_still_is_left_so(far_side: ServedSimulation) -> None:
    connect(far_side.address).close()
    assert not far_side.stage.state.playing


def test_a_living_world_can_be_looked_at_without_holding_its_time(far_side: ServedSimulation) -> None:
    far_side.stage.spawn(room())
    far_side.stage.play()
    with closing(connect(far_side.address, control_time=False)) as engine:
        began_s = engine.time_s
        eventually(lambda: engine.time_s > began_s)
    assert far_side.stage.state.playing


# -- states ------------------------------------------------------------------------------------------------------------


def kept(far_side: ServedSimulation) -> int:
    """How many states the far side still has: it says so when it is asked for another one."""
    with pytest.raises(Exception, match="no state") as told:
        far_side.hub.call_service("/unreal/mindstage/restore_state", {"handle": "?"})
    names = str(told.value).partition("there is ")[2].splitlines()[0]
    return 0 if names == "none" else len(names.split(","))


def test_states_that_nobody_has_any_more_are_thrown_away_over_there(
    far_side: ServedSimulation, engine: RemoteEngine
) -> None:
    engine.spawn(room())
    first = engine.save_state()
    for _ in range(100):
        engine.save_state()
    gc.collect()
    engine.delete([BodyId("mug")])
    engine.restore_state(first)
    assert "mug" in engine.poses()[0]
    assert kept(far_side) <= 3
    engine.close()
    assert kept(far_side) == 0


def test_a_state_of_another_engine_is_refused(far_side: ServedSimulation, engine: RemoteEngine) -> None:
    with closing(connect(far_side.address)) as other:
        for foreign in (other.save_state(), NullEngine().save_state(), None):
            with pytest.raises(TypeError, match="this very engine"):
                engine.restore_state(foreign)  # type: ignore[arg-type]


# -- what travels ------------------------------------------------------------------------------------------------------


def test_what_json_cannot_hold_is_left_out_with_the_reason_and_the_rest_is_spawned(engine: RemoteEngine) -> None:
    lamp = Light(id=BodyId("lamp"), iri=Iri(BASE + "lamp"), type=LightType.POINT, pose=Pose(), intensity=NAN)
    painted = body("painted", (5, 0, 0), (1, 1, 1), materials=(Material(name="Sky", color=(0.0, 0.0, NAN)),))
    mad = world(
        FLOOR,
        body("nowhere", (NAN, 0, 0), (1, 1, 1)),
        body("box", (0, 0, 1), (1, 1, 1)),
        painted,
        msgspec.structs.replace(
            prismatic_joint("mad", "floor", "box", (0, 0, 0)), linear=LinearLimits(x=AxisMotion.LIMITED, limit=NAN)
        ),
        prismatic_joint("loose", "floor", "nowhere", (0, 0, 0)),
    )
    report = engine.spawn(msgspec.structs.replace(mad, lights=(lamp,)))
    assert {failure.id for failure in report.failed_bodies} == {"nowhere", "painted", "lamp"}
    reasons = {failure.id: failure.reason for failure in (*report.failed_bodies, *report.failed_joints)}
    assert "not finite" in reasons["nowhere"]
    assert "not all finite" in reasons["mad"]
    assert "materials" in reasons["painted"]
    assert "'nowhere', which is not there" in reasons["loose"]
    assert engine.poses()[0] == ("floor", "box")


def test_numbers_that_cannot_travel_change_nothing(engine: RemoteEngine) -> None:
    engine.spawn(room())
    mug = BodyId("mug")
    with pytest.raises(PoseUnreachableError, match="not finite"):
        engine.set_pose(mug, Pose((NAN, 0, 0)))
    with pytest.raises(MessageValidationError, match="force"):
        engine.apply_force(mug, (NAN, 0, 0))
    with pytest.raises(MessageValidationError, match="duration_s"):
        engine.step(NAN)
    assert diff(room(), engine.snapshot()).identical(0.0)


def test_a_world_too_large_for_one_message_is_refused_before_it_is_sent(engine: RemoteEngine) -> None:
    story = PropertyAssertion(Iri(BASE + "story"), Literal("x" * (33 << 20)))
    huge = World(iri=Iri(BASE + "huge"), facts=(story,))
    with pytest.raises(MessageValidationError, match="33 MiB, and 32 can travel in one message"):
        engine.spawn(huge)
    assert engine.snapshot().facts == ()


def test_a_world_of_a_thousand_bodies_comes_back_whole(engine: RemoteEngine) -> None:
    many: tuple[Body, ...] = tuple(body(f"box{i}", (i, i % 7, 0.1 * i), (0.1, 0.2, 0.3)) for i in range(1000))
    assert engine.spawn(world(*many)).bodies == 1000
    assert diff(world(*many), engine.snapshot()).identical(0.0)
    assert engine.poses()[1].shape == (1000, 7)


@pytest.fixture(scope="module")
def engine_of_all_examples() -> Iterator[RemoteEngine]:
    with ServedSimulation(MujocoEngine) as far_side, closing(connect(far_side.address)) as engine:
        yield engine


@settings(max_examples=25)
@given(described=worlds(max_bodies=6))
def test_any_world_comes_back_identical_over_the_socket(engine_of_all_examples: RemoteEngine, described: World) -> None:
    engine = engine_of_all_examples
    engine.clear()
    report = engine.spawn(described)
    assert report.ok, report
    found = diff(described, engine.snapshot())
    assert found.identical(0.0), found


def test_names_that_were_perhaps_meant_come_along(engine: RemoteEngine) -> None:
    engine.spawn(room())
    with pytest.raises(BodyNotFoundError, match="no body 'drawr' in 'scene'; near: 'drawer'"):
        engine.set_pose(BodyId("drawr"), Pose())
