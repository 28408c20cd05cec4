"""Base classes of ROS messages, services and actions, their primitive types, and the JSON codec.

A message is a frozen `msgspec.Struct` in a module that is named like its ROS package: `geometry_msgs.Pose` is
`geometry_msgs/Pose`. Field defaults are those of ROS (zero, empty) unless the definition sets another. A service is a
class with two nested messages, an action a class with three:

    class DeleteModel(Service):
        class Request(Message, frozen=True):
            id: String = ""

        class Response(Message, frozen=True):
            success: Bool = False

`decode` and `encode` convert between a message and a JSON object and check every field:

- *lenient* decoding, as in rosbridge: a missing field gets its default.
- *strict* decoding, as in the Unreal plugin: every field is required.
- encoding writes every field, with the same type and range checks as decoding.

A wrong type, a number out of range, an unknown key and a field given under two names are errors that hold the path:
`joints[3].constraint_details.linear_limits.limit: expected float, got str`. Decoding accepts the field names of
ROS 1 and of ROS 2; the caller of `encode` chooses which are written.

Numbers are finite, since JSON has no NaN and no infinity. A float32 keeps the digits that it was given.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from numbers import Integral, Real
from typing import Annotated, Any, ClassVar, Final, Self, TypeVar, cast

import msgspec
from msgspec import Meta, inspect

from mindstage.errors import MessageValidationError, suggestion
from mindstage.ranges import Time, checked

__all__ = [
    "FLOAT64_MAX",
    "Action",
    "Bool",
    "Bytes",
    "FieldInfo",
    "Float32",
    "Float64",
    "Int8",
    "Int16",
    "Int32",
    "Int32Enum",
    "Int64",
    "Message",
    "RosVersion",
    "Service",
    "String",
    "TimeMessage",
    "Uint8",
    "Uint8Enum",
    "Uint16",
    "Uint32",
    "Uint64",
    "constants_of",
    "decode",
    "decode_arguments",
    "encode",
    "engine_service",
    "fields_of",
    "short_name",
    "snake_case",
    "struct_of",
    "to_python_number",
    "type_name",
    "type_of",
    "validation_error_details",
]

M = TypeVar("M", bound="Message")
JsonObject = dict[str, Any]

MISSING = "it is missing"

# -- primitive types ---------------------------------------------------------------------------------------------------

FLOAT32_MAX: Final = 3.4028234663852886e38
"""The largest float32; a number of any unit."""
FLOAT64_MAX: Final = 1.7976931348623157e308
"""The largest float64; a number of any unit."""

Bool = Annotated[bool, Meta(extra={"ros": "bool"})]
String = Annotated[str, Meta(extra={"ros": "string"})]
Bytes = Annotated[bytes, Meta(extra={"ros": "uint8"})]
"""uint8[]: base64 in JSON, as rosbridge encodes it, and a byte string in CBOR."""
Float32 = Annotated[float, Meta(ge=-FLOAT32_MAX, le=FLOAT32_MAX, extra={"ros": "float32"})]
Float64 = Annotated[float, Meta(ge=-FLOAT64_MAX, le=FLOAT64_MAX, extra={"ros": "float64"})]
Int8 = Annotated[int, Meta(ge=-(2**7), le=2**7 - 1, extra={"ros": "int8"})]
Int16 = Annotated[int, Meta(ge=-(2**15), le=2**15 - 1, extra={"ros": "int16"})]
Int32 = Annotated[int, Meta(ge=-(2**31), le=2**31 - 1, extra={"ros": "int32"})]
Int64 = Annotated[int, Meta(ge=-(2**63), le=2**63 - 1, extra={"ros": "int64"})]
Uint8 = Annotated[int, Meta(ge=0, le=2**8 - 1, extra={"ros": "uint8"})]
Uint16 = Annotated[int, Meta(ge=0, le=2**16 - 1, extra={"ros": "uint16"})]
Uint32 = Annotated[int, Meta(ge=0, le=2**32 - 1, extra={"ros": "uint32"})]
Uint64 = Annotated[int, Meta(ge=0, le=2**63 - 1, extra={"ros": "uint64"})]
"""Limited to 2**63 - 1, the largest integer that msgspec can constrain; JSON readers lose digits above 2**53."""


class Uint8Enum(IntEnum):
    """Base class of enumerations that are encoded as uint8."""


class Int32Enum(IntEnum):
    """Base class of enumerations that are encoded as int32."""


# -- messages ----------------------------------------------------------------------------------------------------------


class RosVersion(IntEnum):
    """ROS 1 or ROS 2; some messages have other fields or field names in the other one."""

    ONE = 1
    TWO = 2


class Message(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base class of messages: immutable, hashable, with typed fields."""

    ros_name: ClassVar[str] = ""
    """Name of the type in its ROS package, where it is not the name of the class."""
    constants: ClassVar[tuple[type[IntEnum], ...]] = ()
    """Enumerations whose values are constants of the definition, but that are the type of none of its fields."""
    aliases: ClassVar[Mapping[str, str]] = {}
    """Additional names of fields that `decode` accepts, each with the name of its field; `encode` never writes them."""
    ros1_names: ClassVar[Mapping[str, str]] = {}
    """Fields with another name in ROS 1: `decode` accepts both, `encode` writes it for ROS 1."""
    only_in: ClassVar[Mapping[str, RosVersion]] = {}
    """Fields that only one version of ROS has: always optional, and not written for the other version."""


class TimeMessage(Message, frozen=True):
    """Base class of `Time` and `Duration`: seconds and nanoseconds."""

    sec: Int32 = 0
    nanosec: Int32 = 0

    @classmethod
    @checked
    def at(cls, time_s: Time) -> Self:
        """Converts from one number [s]; after decades since the epoch, a float resolves about 0.1 us."""
        seconds, nanoseconds = divmod(round(time_s * 1_000_000_000), 1_000_000_000)
        return cls(sec=seconds, nanosec=nanoseconds)

    @property
    def seconds(self) -> float:
        """As one number [s]."""
        return self.sec + self.nanosec / 1_000_000_000


class Service:
    """Base class of services; subclasses have the nested messages `Request` and `Response`."""

    Request: ClassVar[type[Message]]
    Response: ClassVar[type[Message]]


class Action:
    """Base class of actions; subclasses have the nested messages `Goal`, `Result` and `Feedback`."""

    Goal: ClassVar[type[Message]]
    Result: ClassVar[type[Message]]
    Feedback: ClassVar[type[Message]]


# -- type names --------------------------------------------------------------------------------------------------------


def type_name(cls: Any, ros: RosVersion = RosVersion.ONE) -> str:
    """Returns the ROS name of a message, a service, an action, or a part of a service or an action.

    Args:
        cls: the class; a parametrized `ActionGoal`, `ActionResult` or `ActionFeedback` is named after its action.
        ros: ROS 1 writes `geometry_msgs/Pose`, ROS 2 `geometry_msgs/msg/Pose`.
    """
    package, name = _package_and_name(cls, "" if ros is RosVersion.ONE else "_")
    return f"{package}/{name}" if ros is RosVersion.ONE else f"{package}/{_kind(cls)}/{name}"


def short_name(cls: Any, ros: RosVersion = RosVersion.ONE) -> str:
    """Returns the name without `msg`, `srv` or `action`, as rosapi writes it in both versions of ROS."""
    package, name = _package_and_name(cls, "" if ros is RosVersion.ONE else "_")
    return f"{package}/{name}"


def snake_case(cls: type[Service] | type[Action]) -> str:
    """Returns the default name of a service or an action: `spawn_model` for `SpawnModel`."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", cls.__name__).lower()


def engine_service(cls: type[Service] | type[Action], namespace: str) -> str:
    """Returns the full name of a service or an action of mindstage_msgs in a namespace.

    `SpawnWorld` in the namespace `unreal` is `/unreal/mindstage/spawn_world`.
    """
    return "/".join(("", *filter(None, namespace.split("/")), "mindstage", snake_case(cls)))


def _package_and_name(cls: Any, separator: str) -> tuple[str, str]:
    if arguments := getattr(cls, "__args__", None):
        package, name = _package_and_name(arguments[0], separator)
        return package, name[: -len(separator + arguments[0].__name__)] + cls.__origin__.__name__
    package = cls.__module__.rpartition(".")[2]
    return package, getattr(cls, "ros_name", "") or cls.__qualname__.replace(".", separator)


def _kind(cls: Any) -> str:
    if hasattr(cls, "__args__"):
        return "action"
    if issubclass(cls, Message) and "." in cls.__qualname__:
        return "srv" if cls.__name__ in {"Request", "Response"} else "action"
    return "srv" if issubclass(cls, Service) else "action" if issubclass(cls, Action) else "msg"


# -- fields ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class FieldInfo:
    """One field of a message."""

    name: str
    primitive: str
    """The ROS name of its primitive type, such as `float64`; empty if its type is a message."""
    message: Any
    """The message type of its value or its elements, else None; may be a parametrized generic class."""
    length: int | None
    """None for a single value, 0 for an unbounded array, else the length of the array."""
    enum: type[IntEnum] | None
    """The enumeration of its values, if it has one."""


@cache
def fields_of(cls: Any) -> tuple[FieldInfo, ...]:
    """Returns the fields of a message type in their order."""
    info = cast(inspect.StructType, inspect.type_info(cls))
    return tuple(_field_info(field.encode_name, field.type) for field in info.fields)


def struct_of(cls: Any) -> type[Message]:
    """Returns the class of a message type, without the argument of a parametrized one."""
    return cast(type[Message], getattr(cls, "__origin__", cls))


def type_of(message: Message) -> Any:
    """Returns the type of a message; a generic one is parametrized with the type of its last field."""
    cls = type(message)
    if not getattr(cls, "__parameters__", ()):
        return cls
    return cast(Any, cls)[type(getattr(message, cls.__struct_fields__[-1]))]


def constants_of(cls: Any) -> Iterator[tuple[str, int]]:
    """Yields name and value of the constants of a message type."""
    enums = [field.enum for field in fields_of(cls) if field.enum]
    for enum in dict.fromkeys([*enums, *struct_of(cls).constants]):
        yield from ((name, member.value) for name, member in enum.__members__.items())


def _field_info(name: str, info: inspect.Type) -> FieldInfo:
    length: int | None = None
    if isinstance(info, inspect.VarTupleType):
        length = info.max_length or 0
        info = info.item_type
    ros = ""
    if isinstance(info, inspect.Metadata):
        ros, info = (info.extra or {}).get("ros", ""), info.type
    match info:
        case inspect.BytesType():
            return FieldInfo(name, ros, None, 0, None)
        case inspect.EnumType(cls=enum):
            return FieldInfo(name, _enum_primitive(cast(type[IntEnum], enum)), None, length, cast(type[IntEnum], enum))
        case inspect.StructType():
            return FieldInfo(name, "", info.cls, length, None)
        case _:
            return FieldInfo(name, ros, None, length, None)


def _enum_primitive(enum: type[IntEnum]) -> str:
    for base, primitive in ((Uint8Enum, "uint8"), (Int32Enum, "int32")):
        if issubclass(enum, base):
            return primitive
    raise TypeError(f"{enum.__name__} is neither a Uint8Enum nor an Int32Enum")


# -- codec -------------------------------------------------------------------------------------------------------------


def decode(cls: type[M], value: object, *, strict: bool = False) -> M:
    """Converts a JSON object to a message.

    Args:
        cls: the message type.
        value: the parsed JSON; byte strings, which CBOR has, are accepted for uint8[].
        strict: require every field.

    Raises:
        MessageValidationError: the value is not a valid message of this type.
    """
    if _has_other_names(cls):
        value = _to_field_names(cls, value, "")
    try:
        message = msgspec.convert(value, cls)
    except msgspec.ValidationError as error:
        raise _message_error(cls, error) from error
    except (UnicodeError, RecursionError) as error:
        raise MessageValidationError(type_name(cls), cause=str(error)) from error
    if strict and (path := _missing_field(cls, cast(JsonObject, value))):
        raise MessageValidationError(type_name(cls), path=path, cause=MISSING, remedy="every field is required")
    return message


def decode_arguments(cls: type[M], args: object, *, strict: bool = False) -> M:
    """Converts the arguments of a service call: an object, a list of values in the order of the fields, or None.

    Args:
        cls: the request type.
        args: the parsed JSON.
        strict: require every field.

    Raises:
        MessageValidationError: the arguments are not a valid request of this type.
    """
    if isinstance(args, list | tuple):
        names = [field.name for field in fields_of(cls)]
        if len(args) > len(names):
            cause = f"{len(args)} arguments, and it has {len(names)} fields"
            raise MessageValidationError(type_name(cls), cause=cause, remedy="send an object with named fields")
        args = dict(zip(names, args, strict=False))
    return decode(cls, {} if args is None else args, strict=strict)


def encode(message: Message, *, ros: RosVersion = RosVersion.TWO) -> JsonObject:
    """Converts a message to a JSON object with every field.

    Args:
        ros: the version of ROS whose fields are written where they differ: `sec` or `secs`, headers with `seq`.

    Raises:
        MessageValidationError: a field has a value that its type does not allow, such as NaN.
    """
    cls = type_of(message)
    try:
        encoded: JsonObject = msgspec.to_builtins(message, enc_hook=to_python_number)
        msgspec.convert(encoded, cls)
    except msgspec.ValidationError as error:
        raise _message_error(cls, error) from error
    except TypeError as error:
        raise MessageValidationError(type_name(cls), cause=str(error)) from error
    if _has_other_names(cls):
        _to_names_of(ros, cls, encoded)
    return encoded


def to_python_number(number: object) -> int | float:
    """Converts a number of NumPy or a similar library to int or float (an `enc_hook` of msgspec).

    Raises:
        TypeError: it is not a number.
    """
    match number:
        case Integral():
            return int(number)
        case Real():
            return float(number)
    raise TypeError(f"{type(number).__name__} cannot be written")


def validation_error_details(error: Exception) -> tuple[str, str]:
    """Splits msgspec's error text into cause and path: "expected float, got str", "models[3].pose.position.x"."""
    found = re.fullmatch(r"(.*?)(?: - at (`key` in )?`\$\.?(.*?)`)?", str(error), re.DOTALL)
    cause, key, path = found.groups() if found else (str(error), None, None)
    if key:
        return "a key is not a string", path or ""
    return (cause[:1].lower() + cause[1:]).replace("`", ""), path or ""


def _other_names(cls: type[Message]) -> dict[str, str]:
    """Maps aliases and names of ROS 1 to the names of the fields."""
    return {**cls.aliases, **{other: name for name, other in cls.ros1_names.items()}}


@cache
def _has_other_names(cls: Any) -> bool:
    """Whether a field of the message, or of a message in it, has several names or exists in one version of ROS only."""
    struct = struct_of(cls)
    return bool(_other_names(struct) or struct.only_in or _fields_with_other_names(cls))


@cache
def _fields_with_other_names(cls: Any) -> tuple[FieldInfo, ...]:
    return tuple(field for field in fields_of(cls) if field.message and _has_other_names(field.message))


def _to_field_names(cls: Any, value: Any, path: str) -> Any:
    """Returns a copy with the names of the fields as keys; anything but an object is returned as it is."""
    if not isinstance(value, dict):
        return value
    names = _other_names(struct_of(cls))
    renamed = {names.get(key, key): part for key, part in value.items()}
    if len(renamed) != len(value):
        twice = next(key for key in value if key in names and names[key] in value)
        raise MessageValidationError(type_name(cls), path=_joined(path, twice), cause=f"{names[twice]} is given too")
    for field in _fields_with_other_names(cls):
        part, here = renamed.get(field.name), _joined(path, field.name)
        if field.length is None and part is not None:
            renamed[field.name] = _to_field_names(field.message, part, here)
        elif isinstance(part, list | tuple):
            renamed[field.name] = [
                _to_field_names(field.message, item, f"{here}[{at}]") for at, item in enumerate(part)
            ]
    return renamed


def _to_names_of(ros: RosVersion, cls: Any, value: JsonObject) -> None:
    """Renames keys, in place, to their names in a version of ROS, and removes fields that it does not have."""
    struct = struct_of(cls)
    for field in _fields_with_other_names(cls):
        part = value[field.name]
        for item in (part,) if field.length is None else part:
            _to_names_of(ros, field.message, item)
    for name, only in struct.only_in.items():
        if only is not ros:
            del value[name]
    if ros is RosVersion.ONE:
        for name, other in struct.ros1_names.items():
            value[other] = value.pop(name)


def _missing_field(cls: Any, value: JsonObject) -> str:
    """Returns the path of the first required field that a valid object does not have; empty if it has all."""
    optional = struct_of(cls).only_in
    for field in fields_of(cls):
        if field.name not in value:
            if field.name in optional:
                continue
            return field.name
        if field.message is None:
            continue
        part = value[field.name]
        for at, item in enumerate((part,) if field.length is None else part):
            if deeper := _missing_field(field.message, item):
                return f"{field.name}.{deeper}" if field.length is None else f"{field.name}[{at}].{deeper}"
    return ""


def _message_error(cls: Any, error: Exception) -> MessageValidationError:
    """Converts an error of msgspec, and adds the names or values that would have been valid."""
    cause, path = validation_error_details(error)
    inner, field = _field_at(cls, path)
    remedy = ""
    if unknown := re.fullmatch(r"object contains unknown field (.*)", cause, re.DOTALL):
        known = [each.name for each in fields_of(inner)]
        remedy = suggestion(unknown[1], known, none="it has no fields")
        path, cause = _joined(path, unknown[1]), f"{type_name(inner)} has no such field"
    elif missing := re.fullmatch(r"object missing required field (.*)", cause):
        path, cause = _joined(path, missing[1]), MISSING
    elif field and field.enum and (number := re.fullmatch(r"invalid enum value (.*)", cause)):
        remedy = "valid: " + ", ".join(f"{each.value} {name}" for name, each in field.enum.__members__.items())
        cause = f"{number[1]} is not a valid value"
    elif re.match(r"expected float [<>]=|number out of range", cause):
        cause = f"expected a finite {field.primitive if field else 'number'}, got NaN or one that is too large"
    return MessageValidationError(type_name(cls), path=path, cause=cause, remedy=remedy)


def _field_at(cls: Any, path: str) -> tuple[Any, FieldInfo | None]:
    """Returns the innermost message type at a path, and the field of it; None where the path ends at a message."""
    field: FieldInfo | None = None
    for name in re.sub(r"\[[^\]]*\]", "", path).split(".") if path else ():
        field = next((each for each in fields_of(cls) if each.name == name), None)
        if field is None:
            break
        if field.message:
            cls, field = field.message, None
    return cls, field


def _joined(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name
