"""Worlds as JSON, spawn reports, and errors, which survive a round trip."""

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
    EngineMemoryError,
    EngineTimeoutError,
    EngineUnavailableError,
    HistoryChangedError,
    MessageValidationError,
    NoFreePlacementError,
    NothingToUndoError,
    PoseUnreachableError,
    ResourceRefusedError,
    SimulationDivergedError,
    SpawnRefusedError,
    UnreachableError,
    UnsupportedByEngineError,
    WorldError,
)
from mindstage.msgs import decode, encode, mindstage_msgs
from mindstage.ros.engine_services import spawn_report
from mindstage.scene import BodyPhysics, Iri, Literal, Material, Mobility, PropertyAssertion, World
from tests.cases import each_case
from tests.kitchenette import KNOWROB, kitchenette
from tests.worlds import materials, physics, worlds

# -- worlds ------------------------------------------------------------------------------------------------------------


@given(world=worlds(wild_tags=True, labels=True))
def test_any_world_survives_a_round_trip_exactly(world: World) -> None:
    back = world_from_json(world_to_json(world))
    assert back == world
    assert repr(back) == repr(world)  # zeros keep their sign, tuples stay tuples


def test_the_format_version_is_always_written() -> None:
    part = json.loads(world_to_json(kitchenette()))
    assert part["format_version"] == 2
    assert part["iri"] == kitchenette().iri


@each_case(
    ("text", "cause"),
    [
        ("", "it is not JSON"),
        ("{", "it is not JSON"),
        ("[]", "expected object, got array"),
        ('{"iri": "x"}', "missing required field format_version"),
        ('{"iri": "x", "format_version": 1}', "this version of Mindstage reads 2"),
        ('{"format_version": 2}', "missing required field iri"),
        ('{"iri": "x", "format_version": 2, "boddies": []}', "unknown field boddies"),
        ('{"iri": "x", "format_version": 2, "name": NaN}', "it is not JSON"),
        ('{"iri":"x","format_version":2,"facts":' + '[{"property":"p","value":{"type":"anonymous","facts":' * 5000, ""),
    ],
)
def test_invalid_worlds_are_rejected(text: str, cause: str) -> None:
    with pytest.raises(MessageValidationError) as refused:
        world_from_json(text)
    assert cause in str(refused.value)


def test_a_wrong_value_is_rejected_with_the_path() -> None:
    part = json.loads(world_to_json(kitchenette()))
    part["bodies"][3]["pose"]["position"][1] = "0"
    with pytest.raises(
        MessageValidationError, match=r"a world: bodies\[3\]\.pose\.position\[1\]: expected float, got str"
    ):
        world_from_json(json.dumps(part))


@pytest.mark.parametrize("number", [nan, inf])
def test_a_world_with_a_number_that_is_not_finite_is_rejected(number: float) -> None:
    world = kitchenette()
    broken = replace(world, bodies=(replace(world.bodies[0], size=(1.0, number, 1.0)), *world.bodies[1:]))
    with pytest.raises(MessageValidationError, match=r"bodies\[0\]\.size"):
        world_to_json(broken)


def test_numpy_numbers_are_written_as_numbers() -> None:
    world = kitchenette()
    body = replace(world.bodies[0], size=tuple(np.array([1.0, 0.1, 3.0])))
    back = world_from_json(world_to_json(replace(world, bodies=(body,))))
    assert repr(back.bodies[0].size) == "(1.0, 0.1, 3.0)"


def test_text_that_json_cannot_represent_is_rejected() -> None:
    fact = PropertyAssertion(Iri(KNOWROB + "note"), Literal("\ud800"))
    with pytest.raises(MessageValidationError):
        world_to_json(replace(kitchenette(), facts=(fact,)))


@given(part=physics())
def test_missing_physics_properties_stay_missing(part: BodyPhysics) -> None:
    assert from_json(to_json(part), BodyPhysics) == part


@given(part=st.lists(materials(), max_size=3).map(tuple))
def test_materials_keep_their_colors(part: tuple[Material, ...]) -> None:
    assert from_json(to_json(part, tuple[Material, ...]), tuple[Material, ...]) == part


def test_an_invalid_part_is_rejected_with_the_path() -> None:
    assert to_json(BodyPhysics(mobility=Mobility.DYNAMIC)) == '{"mobility":"dynamic"}'
    with pytest.raises(MessageValidationError, match="Physics: mobility: invalid enum value 'flying'"):
        from_json('{"mobility":"flying"}', BodyPhysics)
    with pytest.raises(MessageValidationError, match="mass_kg"):
        from_json('{"mass_kg":"heavy"}', BodyPhysics)


# -- engines -----------------------------------------------------------------------------------------------------------


def test_a_spawn_report_has_the_fields_of_its_message() -> None:
    report = SpawnReport(
        bodies=3,
        joints=2,
        attachments=1,
        failed_bodies=(SpawnFailure("mug", "the id is taken"),),
        failed_attachments=(SpawnFailure("lid", "no such parent"),),
        notes=(SpawnNote(SpawnNoteKind.HOLLOW, ("drawer", "spoon"), "it got an inside"),),
    )
    message = spawn_report(report)
    sent = decode(mindstage_msgs.SpawnReport, json.loads(json.dumps(encode(message))), strict=True)
    assert sent.notes[0].kind == "hollow"
    assert msgspec.convert(encode(sent), SpawnReport) == report


def test_every_method_of_an_engine_has_a_service() -> None:
    services = {
        "apply": "ApplyEdit", "clear": "Clear",
        "highlight": "Highlight", "highlights": "GetHighlights", "apply_force": "Push", "step": "Step",
        "poses": "GetPoses", "joint_positions": "GetJointPositions", "snapshot": "LogWorld", "save_state": "SaveState",
        "restore_state": "RestoreState", "set_commands": "SetCommands",
        "actuator_states": "GetActuatorStates",
        "name": "Describe", "capabilities": "Describe", "time_s": "Describe",
    }  # fmt: skip
    contract = {name for name, _ in inspect.getmembers(Engine) if not name.startswith("_")}
    # Statistics and notes are read after each tick; the diagnostics have the notes.
    contract -= {"close", "stats", "notes", "fork", "scale_dynamics", "contacts", "state_key"}  # in the same process
    assert set(services) == contract
    for name in services.values():
        assert name in mindstage_msgs.__all__
    local = {"statistics", "fork", "contacts", "scale dynamics"}
    assert {ability.value for ability in Capability} - local == {"save", "joints", "actuators", "kinematic velocities"}


# -- errors ------------------------------------------------------------------------------------------------------------

WORLD_ERRORS = [
    BodyNotFoundError("cupp", known=["cup", "cups", "table"], world="kitchen"),
    BodyNotFoundError("x"),
    BodyExistsError("cup"),
    PoseUnreachableError("door", reason="its hinge does not let it"),
    AttachmentError("handle", "door", reason="it would close a circle"),
]


@each_case("error", WORLD_ERRORS, ids=str)
def test_a_world_error_survives_a_round_trip(error: WorldError) -> None:
    message = error_to_message(error)
    sent = decode(mindstage_msgs.Refusal, json.loads(json.dumps(encode(message))), strict=True)
    back = message_to_error(sent)
    assert type(back) is type(error)
    assert str(back) == str(error) == message.text
    assert vars(back) == vars(error)


SIMULATION_ERRORS = [
    NoFreePlacementError("cup", "on table", reason="it is full"),
    ResourceRefusedError("file:///a.stl"),
    SpawnRefusedError("cup", reason="its id is taken"),
    NothingToUndoError(),
    HistoryChangedError(),
    UnreachableError("robot", target="the handle", reason="it is 0.3 m beyond its reach"),
]
"""Errors of the simulation, which no engine raises; the message has no fields for them."""


def test_every_world_error_can_be_converted() -> None:
    kinds = {cls for _, cls in inspect.getmembers(errors, inspect.isclass) if issubclass(cls, WorldError)}
    assert kinds - {WorldError} == {type(error) for error in [*WORLD_ERRORS, *SIMULATION_ERRORS]}


@each_case("error", SIMULATION_ERRORS, ids=str)
def test_a_world_error_of_the_simulation_keeps_its_message(error: WorldError) -> None:
    back = message_to_error(error_to_message(error))
    assert type(back) is WorldError
    assert str(back) == str(error)


def test_a_refusal_of_an_unknown_kind_is_a_world_error() -> None:
    error = message_to_error(mindstage_msgs.Refusal(code="GravityOffended", text="not on Sundays"))
    assert type(error) is WorldError
    assert str(error) == "not on Sundays"


ENGINE_ERRORS = [
    SimulationDivergedError(time_s=1.25, what="velocities"),
    EngineClosedError("mujoco"),
    EngineMemoryError(what="6 bodies", needed_mb=1024.0, cap_mb=1.5),
    EngineUnavailableError("mujoco", cause="not installed", remedy="install it"),
    EngineTimeoutError("ros://127.0.0.1:9090/unreal", call="step", timeout_s=10.0),
    UnsupportedByEngineError("ros://127.0.0.1:9090/unreal", what="push bodies", remedy="set their poses"),
]


@each_case("error", ENGINE_ERRORS, ids=str)
def test_an_engine_error_survives_a_round_trip(error: EngineError) -> None:
    text = error_text(error)
    assert text.splitlines()[0] == str(error)
    back = error_from_text(text)
    assert type(back) is type(error)
    assert str(back) == str(error)


def test_every_engine_error_can_be_converted() -> None:
    kinds = {cls for _, cls in inspect.getmembers(errors, inspect.isclass) if issubclass(cls, EngineError)}
    assert kinds - {EngineError} == {type(error) for error in ENGINE_ERRORS}


@each_case(
    "text",
    [
        "out of order",
        "out of order\n{",
        "out of order\n[]",
        'out of order\n{"code": "EngineClosedError"}',
        'out of order\n{"code": "os.system", "engine": "x"}',
        'out of order\n{"code": "EngineClosedError", "engine": {}}',
        'out of order\n{"code": "EngineClosedError", "engine": "x", "more": 1}',
    ],
)
def test_any_other_text_is_an_engine_error_with_that_message(text: str) -> None:
    error = error_from_text(text)
    assert type(error) is EngineError
    assert str(error) == "out of order"
