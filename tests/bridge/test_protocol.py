"""The protocol without I/O: decoding, encoding and errors."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.access.limits import BridgeLimits
from mindstage.bridge import protocol
from mindstage.bridge.protocol import Compression, MessageDecoder, MessageEncoder, Operation, StatusLevel
from mindstage.errors import MessageValidationError
from tests.cases import each_case

Raw = msgspec.Raw

# One of each operation, as the protocol document, roslibpy and roslibjs write them.
GOLDEN: list[tuple[str, Operation]] = [
    ('{"op":"advertise","id":"a:1","topic":"/clock","type":"rosgraph_msgs/Clock"}',
     protocol.Advertise(id="a:1", topic="/clock", type="rosgraph_msgs/Clock")),
    ('{"op":"unadvertise","topic":"/clock"}', protocol.Unadvertise(topic="/clock")),
    ('{"op":"publish","topic":"/words","msg":{"data":"1.50"},"latch":false}',
     protocol.Publish(topic="/words", msg=Raw(b'{"data":"1.50"}'), latch=False)),
    ('{"op":"subscribe","id":"s:1","topic":"/tf","type":"tf2_msgs/TFMessage","throttle_rate":100,"queue_length":1,'
     '"compression":"cbor"}',
     protocol.Subscribe(id="s:1", topic="/tf", type="tf2_msgs/TFMessage", throttle_rate=100, queue_length=1,
                        compression=Compression.CBOR)),
    ('{"op":"unsubscribe","id":"s:1","topic":"/tf"}', protocol.Unsubscribe(id="s:1", topic="/tf")),
    ('{"op":"advertise_service","service":"/add","type":"x/Add"}',
     protocol.AdvertiseService(service="/add", type="x/Add")),
    ('{"op":"unadvertise_service","service":"/add"}', protocol.UnadvertiseService(service="/add")),
    ('{"op":"call_service","id":7,"service":"/add","args":[1,2],"timeout":2.5}',
     protocol.CallService(id=7, service="/add", args=Raw(b"[1,2]"), timeout=2.5)),
    ('{"op":"service_response","id":7,"service":"/add","values":{"sum":3},"result":true}',
     protocol.ServiceResponse(id=7, service="/add", values=Raw(b'{"sum":3}'), result=True)),
    ('{"op":"advertise_action","action":"/go","type":"x/Go"}', protocol.AdvertiseAction(action="/go", type="x/Go")),
    ('{"op":"unadvertise_action","action":"/go"}', protocol.UnadvertiseAction(action="/go")),
    ('{"op":"send_action_goal","id":"g","action":"/go","action_type":"x/Go","args":{"to":[1]},"feedback":true}',
     protocol.SendActionGoal(id="g", action="/go", action_type="x/Go", args=Raw(b'{"to":[1]}'), feedback=True)),
    ('{"op":"cancel_action_goal","id":"g","action":"/go"}', protocol.CancelActionGoal(id="g", action="/go")),
    ('{"op":"action_feedback","id":"g","action":"/go","values":{"left":2.0}}',
     protocol.ActionFeedback(id="g", action="/go", values=Raw(b'{"left":2.0}'))),
    ('{"op":"action_result","id":"g","action":"/go","values":{},"status":4,"result":true}',
     protocol.ActionResult(id="g", action="/go", values=Raw(b"{}"), status=4, result=True)),
    ('{"op":"status","id":"x","level":"error","msg":"no"}', protocol.Status(id="x", level=StatusLevel.ERROR, msg="no")),
    ('{"op":"set_level","level":"none"}', protocol.SetLevel(level=StatusLevel.NONE)),
    ('{"op":"auth","mac":"0f","client":"c","dest":"d","rand":"r","t":1,"level":"admin","end":2}',
     protocol.Auth(mac="0f", client="c", dest="d", rand="r", t=1, level="admin", end=2)),
]  # fmt: skip

REFUSED = [
    ("", "message", "", "truncated"),
    ("no JSON", "message", "", "malformed"),
    ("[]", "message", "", "Expected `object`, got `array`"),
    ("{}", "message", "", "missing required field `op`"),
    ('{"op":"zip","a":01}', "message", "op", "Invalid value 'zip'"),
    ('{"op":"zip","id":"q"}', "zip", "op", "Invalid value 'zip'"),
    ('{"op":"publish","id":"q","topic":5,"msg":{}}', "publish", "topic", "Expected `str`, got `int`"),
    ('{"op":"publish","id":"q","topic":"","msg":{}}', "publish", "topic", "length >= 1"),
    ('{"op":"publish","id":"q","topic":"/a"}', "publish", "", "missing required field `msg`"),
    ('{"op":"publish","topic":"/a","msg":{"a":01}}', "message", "", "malformed"),
    ('{"op":"subscribe","id":"q","topic":"/a","throttle_rate":-1}', "subscribe", "throttle_rate", ">= 0"),
    ('{"op":"subscribe","id":"q","topic":"/a","compression":"zip"}', "subscribe", "compression", "'zip'"),
    ('{"op":"cancel_action_goal","action":"/go"}', "cancel_action_goal", "", "`id`"),
    ('{"op":"service_response","id":"q","service":"/a","values":{}}', "service_response", "", "`result`"),
    ('{"op":"publish","topic":"/a","msg":{"a":"\ud800"}}', "publish", "", "surrogates"),
    ('{"op":"png","id":"q","data":"no base64"}', "png", "", "not a PNG"),
    (b"\xff\xfe\x00garbage", "binary frame", "", "not CBOR"),
    (b"", "binary frame", "", "not CBOR"),
    (b"\x80", "message", "", "Expected `object`, got `array`"),
]


def reader(**limits: float) -> MessageDecoder:
    return MessageDecoder(msgspec.structs.replace(BridgeLimits(), **limits))


def contents(operation: Operation | None) -> object:
    """Returns an operation as plain values, for comparison."""
    return msgspec.json.decode(msgspec.json.encode(operation))


@each_case(("text", "operation"), GOLDEN, ids=lambda value: value[:30] if isinstance(value, str) else "")
def test_each_operation_is_decoded_and_encoded(text: str, operation: Operation) -> None:
    assert type(reader().decode(text, 0.0)) is type(operation)
    assert contents(reader().decode(text, 0.0)) == contents(operation)
    (frame,) = MessageEncoder(operation).frames()
    assert msgspec.json.decode(frame) == msgspec.json.decode(text)


def test_every_operation_has_a_golden_text() -> None:
    wrappings = {protocol.Fragment, protocol.Png}
    assert {type(operation) for _, operation in GOLDEN} == set(Operation.__args__) - wrappings  # type: ignore[attr-defined]


@each_case(("frame", "what", "path", "cause"), REFUSED)
def test_errors_name_the_operation_and_the_path(frame: str | bytes, what: str, path: str, cause: str) -> None:
    with pytest.raises(MessageValidationError) as refused:
        reader().decode(frame, 0.0)
    assert refused.value.subject == what
    assert refused.value.path == path
    assert cause in refused.value.cause
    assert refused.value.id == ("q" if isinstance(frame, str) and '"id":"q"' in frame else None)


def test_unknown_fields_are_ignored() -> None:
    text = '{"op":"advertise","topic":"/a","type":"x/A","latch":false,"queue_size":100,"qos":{"depth":1}}'
    assert contents(reader().decode(text, 0.0)) == contents(protocol.Advertise(topic="/a", type="x/A"))


def test_null_means_that_a_field_is_missing() -> None:
    text = '{"op":"subscribe","id":null,"topic":"/a","type":null,"throttle_rate":null,"compression":null}'
    assert reader().decode(text, 0.0) == protocol.Subscribe(topic="/a")
    call = reader().decode('{"op":"call_service","service":"/a","args":null}', 0.0)
    assert isinstance(call, protocol.CallService)
    assert bytes(protocol.content(call.args)) == b"{}"


def test_the_payload_keeps_its_digits() -> None:
    carried = b'{"a": 1.50, "b": 1e2, "c": 123456789012345678901234567890, "d": "\\u00e9"}'
    message = reader().decode('{"op":"publish","topic":"/a","msg":' + carried.decode() + "}", 0.0)
    assert isinstance(message, protocol.Publish)
    assert bytes(message.msg) == carried


def test_the_nesting_depth_is_limited() -> None:
    def nested(depth: int) -> str:
        return '{"op":"publish","topic":"/a","msg":' + "[" * depth + "]" * depth + "}"

    assert reader(depth=10).decode(nested(9), 0.0)
    for depth in (10, 500, 100_000):
        with pytest.raises(MessageValidationError, match="deeper than 10"):
            reader(depth=10).decode(nested(depth), 0.0)


def test_brackets_in_strings_do_not_count_as_nesting() -> None:
    carried = msgspec.json.encode(["[[{{" * 50, '"[\\"[' * 50, "\\"]).decode()
    assert reader(depth=3).decode('{"op":"publish","topic":"/a","msg":' + carried + "}", 0.0)


def test_a_frame_that_is_too_large_is_rejected_without_decoding() -> None:
    with pytest.raises(MessageValidationError, match="it has 101 bytes; at most 100"):
        reader(message_bytes=100).decode("x" * 101, 0.0)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(exclude_categories=["Cs"])),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=20,
)  # fmt: skip


@given(
    message=st.dictionaries(st.text(max_size=5), json_values, max_size=4),
    compression=st.sampled_from(Compression),
    fragment_size=st.none() | st.integers(1, 200),
)
def test_every_encoding_survives_a_round_trip(
    message: dict[str, object], compression: Compression, fragment_size: int | None
) -> None:
    operation = protocol.Publish(topic="/ä", msg=Raw(msgspec.json.encode(message)))
    frames = MessageEncoder(operation).frames(compression, fragment_size)
    reading = reader()
    *before, last = [reading.decode(frame, 0.0) for frame in frames]
    assert before == [None] * (len(frames) - 1)
    assert isinstance(last, protocol.Publish)
    assert last.topic == "/ä"
    assert msgspec.json.decode(last.msg) == message


@given(st.text() | st.binary() | json_values.map(lambda value: msgspec.json.encode(value).decode()))
def test_any_frame_is_decoded_or_rejected(frame: str | bytes) -> None:
    try:
        operation = reader().decode(frame, 0.0)
    except MessageValidationError:
        return
    assert operation is None or isinstance(operation, Operation)


def test_each_encoding_is_computed_once() -> None:
    outgoing = MessageEncoder(protocol.Publish(topic="/a", msg=Raw(b"{}")))
    assert outgoing.frames() is outgoing.frames()
    assert outgoing.frames(Compression.CBOR) is outgoing.frames(Compression.CBOR)
