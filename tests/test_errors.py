"""Errors: messages, similar names, and copies through pickle and copy."""

from __future__ import annotations

import copy
import pickle

from mindstage.errors import (
    AmbiguousMapError,
    AmbiguousNameError,
    BodyNotFoundError,
    EndpointError,
    EngineTimeoutError,
    InvalidColorError,
    InvalidRequestError,
    MapNotFoundError,
    MapRejectedError,
    MessageValidationError,
    MindstageError,
    NothingToUndoError,
    QuestionNotFoundError,
    ServiceNotFoundError,
    ShapeNotFoundError,
    SourceParseError,
    WorldError,
    closest_names,
    suggestion,
)
from tests.cases import each_case

MESSAGES: list[tuple[MindstageError, str]] = [
    (BodyNotFoundError("cupp", known=["cup", "pot"], world="kitchen"), "no body 'cupp' in 'kitchen'; near: 'cup'"),
    (BodyNotFoundError("{x}", known=iter(["table"])), "no body '{x}'"),
    (NothingToUndoError(redo=True), "there is nothing to redo"),
    (SourceParseError("a.owl", cause="{broken", line=3), "cannot read a.owl, line 3: {broken"),
    (MapNotFoundError(requested="a", known=["b", "c"]), "no map 'a'; there is b, c"),
    (
        MapNotFoundError(requested="a.owl"),
        "no semantic map in a.owl: nothing there is a knowrob:SemanticEnvironmentMap or has a pose; "
        "if it is an ontology, load it as --ontology FILE (in Python ontologies), together with a map",
    ),
    (AmbiguousMapError(["a", "b"]), "2 maps are loaded (a, b); name one of them"),
    (MapRejectedError("m", findings=["odd"]), "m is rejected for 1 finding: odd; fix them, or leave out --strict"),
    (
        AmbiguousNameError("cup", entity_type="class", candidates=["a#cup", "b#cup"]),
        "'cup' may be any of 2 class names: a#cup, b#cup; give one of them in full",
    ),
    (
        QuestionNotFoundError("zzz", known={"what_is": 0}.keys()),
        "no question 'zzz'; `mindstage questions` lists all of them",
    ),
    (QuestionNotFoundError("what_i", known=["what_is"]), "no question 'what_i'; near: 'what_is'"),
    (ShapeNotFoundError("zzz", known=["mug", "bag"]), "no shape 'zzz'; there is bag, mug"),
    (EndpointError("e", cause="c", remedy="r", status=400), "the endpoint e returned an error: c; r"),
    (
        EngineTimeoutError("mujoco", call="step", timeout_s=0.5),
        "the engine 'mujoco' did not answer step within 0.5 s; "
        "it may have been executed all the same: check the poses, or increase the timeout",
    ),
    (ServiceNotFoundError("/a", known=[]), "Service /a does not exist"),
    (MessageValidationError("Pose", path="x.y", cause="c"), "Pose: x.y: c"),
    (InvalidColorError("x", known=["red"]), "no color 'x'; there is red, #rrggbb, or r,g,b from 0 to 1"),
    (InvalidRequestError("x", cause="c"), "x is not a valid request: c; reload the page"),
    (WorldError("just a text"), "just a text"),
]

each_error = each_case(("error", "message"), MESSAGES, ids=lambda value: type(value).__name__)


@each_error
def test_a_message_is_built_from_the_fields(error: MindstageError, message: str) -> None:
    assert str(error) == message


@each_error
def test_an_error_can_be_pickled_and_copied(error: MindstageError, message: str) -> None:
    for restored in (pickle.loads(pickle.dumps(error)), copy.copy(error), copy.deepcopy(error)):
        assert type(restored) is type(error)
        assert str(restored) == message
        assert vars(restored) == vars(error)


def test_an_error_does_not_keep_all_known_names() -> None:
    assert vars(BodyNotFoundError("cupp", known=["cup"] * 10_000)) == {
        "body": "cupp",
        "world": "",
        "suggestions": ("cup",),
    }


def test_errors_with_equal_fields_are_not_equal() -> None:
    one, other = BodyNotFoundError("x"), BodyNotFoundError("x")
    assert one != other
    assert len({one, other}) == 2


def test_similar_spellings_come_before_superstrings() -> None:
    assert closest_names("CUP", ["MyTeacup", "cups", "Cup", "table"]) == ("Cup", "cups", "MyTeacup")
    assert closest_names("cu", ["xcuxxxxxxxxx"]) == ()


def test_a_suggestion_lists_what_exists_where_nothing_is_similar() -> None:
    assert suggestion("widht", ["width", "height"]).startswith("near: 'width'")
    assert suggestion("q", ["width", "height"]) == "there is width, height"
    assert suggestion("q", map(str, range(4800))).endswith(", 38, 39 and 4,760 more")
    assert suggestion("q", [], none="it has none") == "it has none"
