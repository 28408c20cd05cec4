"""What mindstage_msgs carries: worlds as JSON, engines' reports, and errors that are the same on both sides."""

from __future__ import annotations

import inspect
import json
from math import inf, nan

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from mindstage import errors
from mindstage.bridge.conversions import (
    error_from_text,
    error_text,
    error_to_message,
    from_json,
    message_to_error,
    to_json,
    world_from_json,
    world_to_json,
)
from mindstage.engines import Capability, Engine, SpawnFailure, SpawnNote, SpawnNoteKind, SpawnReport
from mindstage.errors import (
    AttachmentError,
    BodyExistsError,
    BodyNotFoundError,
    EngineClosedError,
    EngineError,
    EngineTimeoutError,
    EngineUnavailableError,
    MessageValidationError,
    NoFreePlacementError,
    NothingToUndoError,
    PoseUnreachableError,
    RestoreError,
    SimulationDivergedError,
    UnsupportedByEngineError,
    WorldError,
)
from mindstage.msgs import decode, encode, mindstage_msgs
from mindstage.scene import BodyPhysics, Iri, Literal, Material, Mobility, PropertyAssertion, World
from tests.kitchenette import KNOWROB, kitchenette
from tests.worlds import materials, physics, worlds

# -- worlds ------------------------------------------------------------------------------------------------------------


@given(world=worlds(wild_tags=True, labels=True))
def test_any_world_comes_back_exactly(world: World) -> None:
    back = world_from_json(world_to_json(world))
    assert back == world
    assert repr(back) == repr(world)  # zeros keep their sign, tuples stay tuples


def test_the_version_is_always_told() -> None:
    told = json.loads(world_to_json(kitchenette()))
    assert told["format_version"] == 1
    assert told["iri"] == kitchenette().iri


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("", "it is not JSON"),
        ("{", "it is not JSON"),
        ("[]", "expected object, got array"),
        ('{"iri": "x"}', "missing required field format_version"),
        ('{"iri": "x", "format_version": 2}', "this version of Mindstage reads 1"),
        ('{"format_version": 1}', "missing required field iri"),
        ('{"iri": "x", "format_version": 1, "boddies": []}', "unknown field boddies"),
        ('{"iri": "x", "format_version": 1, "name": NaN}', "it is not JSON"),
        ('{"iri":"x","format_version":1,"facts":' + '[{"property":"p","value":{"type":"anonymous","facts":' * 5000, ""),
    ],
)
def test_what_is_no_world_is_refused(text: str, cause: str) -> None:
    with pytest.raises(MessageValidationError) as refused:
        world_from_json(text)
    assert cause in str(refused.value)


def test_a_wrong_value_is_refused_with_the_path() -> None:
    told = json.loads(world_to_json(kitchenette()))
    told["bodies"][3]["pose"]["position"][1] = "0"
    with pytest.raises(
        MessageValidationError, match=r"a world: bodies\[3\]\.pose\.position\[1\]: expected float, got str"
    ):
        world_from_json(json.dumps(told))


@pytest.mark.parametrize("number", [nan, inf])
def test_a_world_with_a_number_that_is_none_is_not_written(number: float) -> None:
    world = kitchenette()
    broken = replace(world, bodies=(replace(world.bodies[0], size=(1.0, number, 1.0)), *world.bodies[1:]))
    with pytest.raises(MessageValidationError, match=r"bodies\[0\]\.size"):
        world_to_json(broken)


def test_numbers_of_numpy_are_numbers() -> None:
    world = kitchenette()
    body = replace(world.bodies[0], size=tuple(np.array([1.0, 0.1, 3.0])))
    back = world_from_json(world_to_json(replace(world, bodies=(body,))))
    assert repr(back.bodies[0].size) == "(1.0, 0.1, 3.0)"


def test_a_text_that_no_json_holds_is_not_written() -> None:
    fact = PropertyAssertion(Iri(KNOWROB + "note"), Literal("\ud800"))
    with pytest.raises(MessageValidationError):
        world_to_json(replace(kitchenette(), facts=(fact,)))


@given(told=physics())
def test_parts_keep_what_is_not_told(told: BodyPhysics) -> None:
    assert from_json(to_json(told), BodyPhysics) == told


@given(told=st.lists(materials(), max_size=3).map(tuple))
def test_materials_keep_their_colors(told: tuple[Material, ...]) -> None:
    assert from_json(to_json(told, tuple[Material, ...]), tuple[Material, ...]) == told


def test_a_part_that_is_none_is_refused_with_the_path() -> None:
    assert to_json(BodyPhysics(mobility=Mobility.DYNAMIC)) == '{"mobility":"dynamic"}'
    with pytest.raises(MessageValidationError, match="Physics: mobility: invalid enum value 'flying'"):
        from_json('{"mobility":"flying"}', BodyPhysics)
    with pytest.raises(MessageValidationError, match="mass_kg"):
        from_json('{"mass_kg":"heavy"}', BodyPhysics)


# -- engines -----------------------------------------------------------------------------------------------------------


def test_an_engines_report_has_the_very_fields_of_the_message() -> None:
    report = SpawnReport(
        bodies=3,
        joints=2,
        attachments=1,
        failed_bodies=(SpawnFailure("mug", "the id is taken"),),
        failed_attachments=(SpawnFailure("lid", "no such parent"),),
        notes=(SpawnNote(SpawnNoteKind.HOLLOW, ("drawer", "spoon"), "it got an inside"),),
    )
    message = msgspec.convert(msgspec.to_builtins(report), mindstage_msgs.SpawnReport)
    sent = decode(mindstage_msgs.SpawnReport, json.loads(json.dumps(encode(message))), strict=True)
    assert sent.notes[0].kind == "hollow"
    assert msgspec.convert(encode(sent), SpawnReport) == report


def test_every_method_of_an_engine_has_a_service() -> None:
    services = {
        "spawn": "SpawnWorld", "delete": "Delete", "clear": "Clear", "attach": "Attach", "detach": "Detach",
        "set_pose": "SetPose", "set_physics": "SetPhysics", "set_materials": "SetMaterials", "highlight": "Highlight",
        "highlights": "GetHighlights", "apply_force": "Push", "step": "Step", "poses": "GetPoses",
        "joint_positions": "GetJointPositions", "snapshot": "LogWorld", "save_state": "SaveState", "restore_state": "RestoreState",
        "name": "Describe", "capabilities": "Describe", "time_s": "Describe",
    }  # fmt: skip
    contract = {name for name, _ in inspect.getmembers(Engine) if not name.startswith("_")}
    contract -= {"close", "stats"}  # statistics are read after each tick, and not sent to other processes
    assert set(services) == contract
    for name in services.values():
        assert name in mindstage_msgs.__all__
    assert {ability.value for ability in Capability} - {"statistics"} == {"save", "joints"}


# -- errors ------------------------------------------------------------------------------------------------------------

REFUSALS = [
    BodyNotFoundError("cupp", known=["cup", "cups", "table"], world="kitchen"),
    BodyNotFoundError("x"),
    BodyExistsError("cup"),
    PoseUnreachableError("door", reason="its hinge does not let it"),
    AttachmentError("handle", "door", reason="it would close a circle"),
]


@pytest.mark.parametrize("error", REFUSALS, ids=str)
def test_what_the_world_refused_there_is_the_same_error_here(error: WorldError) -> None:
    said = error_to_message(error)
    sent = decode(mindstage_msgs.Refusal, json.loads(json.dumps(encode(said))), strict=True)
    back = message_to_error(sent)
    assert type(back) is type(error)
    assert str(back) == str(error) == said.text
    assert vars(back) == vars(error)


OF_STAGES = [
    NoFreePlacementError("cup", "on table", reason="it is full"),
    RestoreError("cup", reason="its id is taken"),
    NothingToUndoError(),
]
"""No engine refuses with these, so no engine's reply has fields for them."""


def test_every_refusal_of_an_engines_world_can_travel() -> None:
    kinds = {cls for _, cls in inspect.getmembers(errors, inspect.isclass) if issubclass(cls, WorldError)}
    assert kinds - {WorldError} == {type(error) for error in [*REFUSALS, *OF_STAGES]}


@pytest.mark.parametrize("error", OF_STAGES, ids=str)
def test_what_a_stage_refuses_arrives_with_its_sentence(error: WorldError) -> None:
    back = message_to_error(error_to_message(error))
    assert type(back) is WorldError
    assert str(back) == str(error)


def test_a_refusal_of_a_kind_unknown_here_is_still_a_no_of_the_world() -> None:
    error = message_to_error(mindstage_msgs.Refusal(kind="GravityOffended", text="not on Sundays"))
    assert type(error) is WorldError
    assert str(error) == "not on Sundays"


BREAKS = [
    SimulationDivergedError(time_s=1.25, what="velocities"),
    EngineClosedError("mujoco"),
    EngineUnavailableError("mujoco", cause="not installed", remedy="install it"),
    EngineTimeoutError("ros://127.0.0.1:9090/unreal", call="step", timeout_s=10.0),
    UnsupportedByEngineError("ros://127.0.0.1:9090/unreal", what="push bodies", remedy="set their poses"),
]


@pytest.mark.parametrize("error", BREAKS, ids=str)
def test_what_broke_there_is_the_same_error_here(error: EngineError) -> None:
    text = error_text(error)
    assert text.splitlines()[0] == str(error)
    back = error_from_text(text)
    assert type(back) is type(error)
    assert str(back) == str(error)


def test_every_way_an_engine_breaks_can_travel() -> None:
    kinds = {cls for _, cls in inspect.getmembers(errors, inspect.isclass) if issubclass(cls, EngineError)}
    assert kinds - {EngineError} == {type(error) for error in BREAKS}


@pytest.mark.parametrize(
    "text",
    [
        "out of order",
        "out of order\n{",
        "out of order\n[]",
        'out of order\n{"kind": "EngineClosed"}',
        'out of order\n{"kind": "os.system", "engine": "x"}',
        'out of order\n{"kind": "EngineClosed", "engine": {}}',
        'out of order\n{"kind": "EngineClosed", "engine": "x", "more": 1}',
    ],
)
def test_anybodys_text_is_an_error_that_says_it(text: str) -> None:
    error = error_from_text(text)
    assert type(error) is EngineError
    assert str(error) == "out of order"
