"""Designators: actions as CRAM describes them, read as skills with their arguments.

    {"an": "action", "type": "transporting",
     "object": {"an": "object", "type": "Milk", "location": {"a": "location", "on": "kitchen_table"}},
     "target": {"a": "location", "in": {"the": "object", "type": "Refrigerator"}}}

Three notations are read: JSON objects as above; nested lists, as of Lisp and Prolog,
`["an", "action", ["type", "transporting"], …]`; and objects whose key is the article, `{"anAction": {…}}`, as KnowRob's
designator interface has them. Keys and types may be written as `picking-up`, `:PICKING-UP` or `pickingUp`.

"a" and "an" mean any object that fits the description; if several do, the first one is taken, and the others are
reported. "the" means the only one; if several fit, that is an error.

Sources: github.com/cram2/cram (cram_fetch_deliver_plans, cram_mobile_pick_place_plans) for the types of actions and
their keys; github.com/sasjonge/knowrob_designator for the third notation.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import msgspec

from mindstage.errors import AmbiguousNameError, InvalidArgumentError, KnowledgeError, NameNotFoundError, suggestion
from mindstage.knowledge.names import EntityType
from mindstage.rdf.graphs import local_name
from mindstage.robots.skill_declaration import SkillValue, skill_specs
from mindstage.scene import Body, BodyId, Iri
from mindstage.simulation.simulation import Simulation

__all__ = ["ACTION_TYPES", "DesignatedSkill", "DesignatorChoice", "read_designator"]

_MAX_DEPTH = 10
"""Number of levels to which designators may be nested."""
_MAX_CHARACTERS = 20_000
"""Largest length of a designator in characters."""


class DesignatorChoice(msgspec.Struct, frozen=True, kw_only=True):
    """An object that several bodies fit."""

    key: str
    """The argument of the skill."""
    chosen: BodyId
    others: tuple[BodyId, ...]


class DesignatedSkill(msgspec.Struct, frozen=True, kw_only=True):
    """The skill that an action designator describes."""

    skill: str
    args: dict[str, SkillValue]
    """The arguments of the skill; objects are ids of bodies."""
    choices: tuple[DesignatorChoice, ...] = ()
    """Where the description fits several bodies."""
    ignored: tuple[str, ...] = ()
    """Keys of the designator that the skill does not use, such as the arm."""


class _Description(NamedTuple):
    """A designator of any notation."""

    kind: str
    """Such as "action"; empty if it is not given."""
    is_definite: bool
    properties: dict[str, Any]


def read_designator(designator: str | Mapping[str, Any] | Sequence[Any], world: Simulation) -> DesignatedSkill:
    """The skill and the arguments that an action designator describes.

    Args:
        designator: the designator, or JSON text with it.
        world: where its objects are.

    Raises:
        InvalidArgumentError: it is no action designator, its type is unknown, or something is missing.
        NameNotFoundError: no body fits the description of an object.
        AmbiguousNameError: several bodies fit the description of "the" object.
    """
    action = _parse(_decoded(designator), "action")
    if action.kind not in {"action", ""}:
        raise InvalidArgumentError("the designator", cause=f"it describes {action.kind}", remedy="give an action")
    if "type" not in action.properties:
        raise InvalidArgumentError("the action", cause="it has no type", remedy=f"there is {_known_types()}")
    type = _word(action.properties["type"])
    if type not in ACTION_TYPES:
        near = suggestion(type, ACTION_TYPES)
        raise InvalidArgumentError("the action", cause=f"its type {type!r} is unknown", remedy=near)
    reading = _Reading(world, {key: value for key, value in action.properties.items() if key != "type"}, type)
    skill = ACTION_TYPES[type](reading)
    args = skill_specs()[skill].check(reading.args)
    ignored = tuple(key for key in action.properties if key not in {*reading.used, "type"})
    return DesignatedSkill(skill=skill, args=args, choices=tuple(reading.choices), ignored=ignored)


# -- notations ---------------------------------------------------------------------------------------------------------

_ARTICLES = ("an", "a", "the", "some")
_ARTICLE_KEY = re.compile(r"(an|a|the|some)-(\w+)")


def _decoded(designator: str | Mapping[str, Any] | Sequence[Any]) -> object:
    if not isinstance(designator, str):
        return designator
    if len(designator) > _MAX_CHARACTERS:
        raise InvalidArgumentError("the designator", cause=f"it has more than {_MAX_CHARACTERS:,} characters")
    try:
        return json.loads(designator)
    except (ValueError, RecursionError) as error:
        raise InvalidArgumentError("the designator", cause=f"it is no JSON: {error}") from error


def _parse(value: object, place: str, depth: int = 0) -> _Description:
    """A designator in any of the notations.

    Raises:
        InvalidArgumentError: it is none.
    """
    if depth > _MAX_DEPTH:
        raise InvalidArgumentError(place, cause=f"it has more than {_MAX_DEPTH} levels")
    if isinstance(value, Mapping):
        return _parse_object(value, place, depth)
    if isinstance(value, Sequence) and not isinstance(value, str) and value:
        words = [_word(each) if isinstance(each, str) else each for each in value]
        article = words[0] if words[0] in _ARTICLES else None
        kind = words[1] if article and len(words) > 1 and isinstance(words[1], str) else ""
        pairs = words[(2 if kind else 1) :] if article else words
        properties = {}
        for pair in pairs:
            if not (isinstance(pair, Sequence) and not isinstance(pair, str) and len(pair) >= 2):
                raise InvalidArgumentError(place, cause=f"{pair!r} is no key with a value", remedy="as in [type, milk]")
            properties[_word(pair[0])] = pair[1] if len(pair) == 2 else list(pair[1:])
        return _Description(kind, article == "the", properties)
    raise InvalidArgumentError(place, cause=f"{value!r} is no designator", remedy="give an object with keys")


def _parse_object(value: Mapping[Any, Any], place: str, depth: int) -> _Description:
    content = {_word(key): each for key, each in value.items()}
    if len(content) == 1:
        ((key, inner),) = content.items()
        if (match := _ARTICLE_KEY.fullmatch(key)) and isinstance(inner, Mapping | list | tuple):
            found = _parse(inner, place, depth + 1)
            return _Description(match[2], match[1] == "the", found.properties)
    articles = [each for each in _ARTICLES if each in content]
    if len(articles) > 1:
        raise InvalidArgumentError(place, cause=f"it has {' and '.join(articles)}", remedy="give one of them")
    kind = _word(content.pop(articles[0])) if articles else ""
    return _Description(kind, articles == ["the"], content)


def _word(value: object) -> str:
    """A key or a type in one notation: `picking-up` for `:PICKING-UP`, `picking_up` and `pickingUp`."""
    text = str(value).strip().lstrip(":")
    text = text if text.isupper() else re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", text)
    return re.sub(r"[\s_]+", "-", text).lower()


# -- actions -----------------------------------------------------------------------------------------------------------


class _Reading:
    """The properties of an action while they are turned into arguments."""

    def __init__(self, world: Simulation, properties: Mapping[str, Any], type: str) -> None:
        self.world, self.type = world, type
        self.properties = dict(properties)
        self.used: set[str] = set()
        self.args: dict[str, SkillValue] = {}
        self.choices: list[DesignatorChoice] = []

    def value(self, *keys: str) -> Any:
        """The first given property of these; None if there is none."""
        for key in keys:
            if key in self.properties:
                self.used.add(key)
                return self.properties[key]
        return None

    def required(self, *keys: str) -> Any:
        """The first given property of these.

        Raises:
            InvalidArgumentError: there is none.
        """
        found = self.value(*keys)
        if found is None:
            raise InvalidArgumentError(f"the action {self.type}", cause=f"it has no {keys[0]}", remedy=f"add {keys[0]}")
        return found

    def take(self, argument: str, description: object) -> None:
        """Sets an argument to the body that a description fits.

        Raises:
            NameNotFoundError: there is none.
            AmbiguousNameError: there are several, and the description is definite.
        """
        found, is_definite, text = _bodies(self.world, description, argument)
        if not found:
            raise NameNotFoundError(
                text, entity_type="object", known=[body.id for body in self.world.snapshot().bodies]
            )
        if len(found) > 1:
            if is_definite:
                raise AmbiguousNameError(text, entity_type="object", candidates=[str(id) for id in found])
            self.choices.append(DesignatorChoice(key=argument, chosen=found[0], others=tuple(found[1:])))
        self.args[argument] = found[0]

    def take_place(self, location: object, *, default: str = "on") -> None:
        """Sets `on` or `into` from a location."""
        if isinstance(location, Mapping | list | tuple):
            found = _parse(location, "the location")
            for key, argument in _PLACES.items():
                if key in found.properties:
                    self.take(argument, found.properties[key])
                    return
            if found.kind == "location":
                remedy = f"give {', '.join(_PLACES)} an object"
                raise InvalidArgumentError("the location", cause="it names no object", remedy=remedy)
        self.take(default, location)

    def take_pose(self, location: object) -> bool:
        """Sets x, y and yaw from a location with a pose; whether it has one."""
        numbers = _pose_numbers(location)
        if numbers is None and isinstance(location, Mapping | list | tuple):
            numbers = _pose_numbers(_parse(location, "the location").properties.get("pose"))
        if numbers is None:
            return False
        self.args |= {"x": numbers[0], "y": numbers[1], "yaw": numbers[2]}
        return True


_PLACES = {"on": "on", "onto": "on", "in": "into", "into": "into", "inside": "into"}
_OBJECT = ("object", "object-acted-on", "objects", "item")
_TARGET = ("target", "location", "goal", "destination", "to", "to-location", "target-location")


def _pose_numbers(pose: object) -> tuple[float, float, float] | None:
    """x, y and yaw of a pose: [x, y, yaw], [[x, y, z], [qx, qy, qz, qw]] as in ROS, or a stamped one; or None.

    Raises:
        InvalidArgumentError: its numbers are no pose.
    """
    if isinstance(pose, Mapping):
        inner: Mapping[str, Any] = {_word(key): each for key, each in pose.items()}
        inner = stamped if isinstance(stamped := inner.get("pose"), Mapping) else inner
        position, orientation = inner.get("position"), inner.get("orientation")
        if not isinstance(position, Mapping):
            return None
        turned = orientation if isinstance(orientation, Mapping) else {"w": 1.0}
        parts: Any = [[position.get(axis, 0.0) for axis in "xyz"], [turned.get(axis, 0.0) for axis in "xyzw"]]
    elif isinstance(pose, Sequence) and not isinstance(pose, str) and pose:
        parts = list(pose)
        if _is_vector(parts[-1], 4) and _is_vector(parts[-2:][0], 3):
            parts = parts[-2:]  # before them, a stamped pose has its frame and time
        elif isinstance(parts[0], str) or _is_vector(parts[0], 2):
            return None  # a designator as a list
    else:
        return None
    try:
        if len(parts) == 2:
            (x, y, _), (qx, qy, qz, qw) = ([float(number) for number in each] for each in parts)
            return x, y, math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
        x, y, yaw = (float(number) for number in parts)
    except (TypeError, ValueError) as error:
        remedy = "give [x, y, yaw] or [[x, y, z], [qx, qy, qz, qw]]"
        raise InvalidArgumentError("the pose", cause=f"{pose!r} is no pose", remedy=remedy) from error
    return x, y, yaw


def _is_vector(value: object, count: int) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str) and len(value) == count


def _go(reading: _Reading) -> str:
    place = reading.required(*_TARGET, *_OBJECT)
    if not reading.take_pose(place):
        reading.take("thing", _located(place))
    return "go_to"


def _located(location: object) -> object:
    """The object at, on or in which a location is; the description itself if it is an object."""
    if isinstance(location, Mapping | list | tuple):
        properties = _parse(location, "the location").properties
        for key in (*_PLACES, "at", "near", "object", "of"):
            if key in properties:
                return properties[key]
    return location


def _look(reading: _Reading) -> str:
    reading.take("thing", _located(reading.required(*_OBJECT, *_TARGET, "at")))
    return "look_at"


def _reach(reading: _Reading) -> str:
    reading.take("thing", reading.required(*_OBJECT, *_TARGET))
    return "reach"


def _open(reading: _Reading) -> str:
    reading.take("thing", reading.required(*_OBJECT, "container", "container-object"))
    if (fraction := reading.value("fraction", "degree", "opening-degree")) is not None:
        reading.args["fraction"] = fraction
    return "open"


def _close(reading: _Reading) -> str:
    reading.take("thing", reading.required(*_OBJECT, "container", "container-object"))
    return "close"


def _with_thing(skill: str) -> Callable[[_Reading], str]:
    def read(reading: _Reading) -> str:
        reading.take("thing", reading.required(*_OBJECT))
        return skill

    return read


def _alone(skill: str) -> Callable[[_Reading], str]:
    return lambda reading: skill


def _place(reading: _Reading) -> str:
    reading.take("thing", reading.required(*_OBJECT))
    reading.take_place(reading.required(*_TARGET))
    return "place"


def _pour(reading: _Reading) -> str:
    reading.take("thing", reading.required("source", *_OBJECT))
    reading.take("into", _located(reading.required(*_TARGET, "into")))
    return "pour"


def _transport(reading: _Reading) -> str:
    if any(key in reading.properties for key in _TARGET[:1] + _TARGET[2:]):
        reading.take("thing", reading.required(*_OBJECT))
        reading.take_place(reading.required(*_TARGET[:1], *_TARGET[2:]))
        return "place"
    reading.take("thing", _at_location(reading))
    return "put_away"


def _fetch(reading: _Reading) -> str:
    wanted = reading.required(*_OBJECT)
    properties = _parse(wanted, "the object").properties if isinstance(wanted, Mapping | list | tuple) else {}
    if set(properties) == {"type"} and "location" not in reading.properties:
        reading.args["kind"] = local_name(_class(reading.world, properties["type"]))
        return "fetch"
    reading.take("thing", _at_location(reading))
    return "pick"


def _at_location(reading: _Reading) -> object:
    """The object of an action, with the action's `location` as its own if it has none."""
    wanted, place = reading.required(*_OBJECT), reading.value("location")
    if place is None or not isinstance(wanted, Mapping | list | tuple):
        return wanted
    found = _parse(wanted, "the object")
    article = "the" if found.is_definite else "a"
    return {article: found.kind or "object", "location": place, **found.properties}


ACTION_TYPES: Mapping[str, Callable[[_Reading], str]] = {
    **dict.fromkeys(("going", "navigating", "moving-base", "driving"), _go),
    **dict.fromkeys(("looking", "looking-at", "perceiving", "detecting", "turning-towards"), _look),
    **dict.fromkeys(("reaching", "reaching-for"), _reach),
    **dict.fromkeys(("opening", "accessing", "opening-container", "pulling"), _open),
    **dict.fromkeys(("closing", "sealing", "closing-container"), _close),
    **dict.fromkeys(("grasping", "gripping"), _with_thing("grasp")),
    **dict.fromkeys(("releasing", "opening-gripper"), _alone("release")),
    **dict.fromkeys(("picking-up", "lifting"), _with_thing("pick")),
    **dict.fromkeys(("placing", "putting-down", "putting", "delivering"), _place),
    "pouring": _pour,
    "transporting": _transport,
    **dict.fromkeys(("storing", "putting-away", "tidying-up"), _with_thing("put_away")),
    "fetching": _fetch,
    **dict.fromkeys(("parking-arms", "park-arms", "parking", "positioning-arm"), _alone("park")),
}
"""What reads each type of action; it sets the arguments and returns the skill."""


def _known_types() -> str:
    return ", ".join(ACTION_TYPES)


# -- objects -----------------------------------------------------------------------------------------------------------


def _bodies(world: Simulation, description: object, place: str) -> tuple[list[BodyId], bool, str]:
    """The bodies that fit a description, whether it is definite, and the description in words."""
    bodies = world.snapshot().bodies
    if isinstance(description, str):
        return _named(world, bodies, description), True, description
    found = _parse(description, place)
    properties = dict(found.properties)
    name = next((properties.pop(key) for key in ("name", "urdf-name", "id", "iri") if key in properties), None)
    fitting: Iterable[BodyId] = (body.id for body in bodies) if name is None else _named(world, bodies, str(name))
    text = str(name or properties.get("type", found.kind or "object"))
    if (type := properties.pop("type", None)) is not None:
        cls, classes = _class(world, type), {body.id: body.cls for body in bodies}
        fitting = [id for id in fitting if world.knowledge.is_a(Iri(classes[id]), cls)]
    if (location := properties.pop("location", properties.pop("at", None))) is not None:
        inside = _contents(world, location)
        fitting = [id for id in fitting if id in inside]
    if (whole := properties.pop("part-of", None)) is not None:
        parts = _parts_of(world, whole)
        fitting = [id for id in fitting if id in parts]
    if properties:
        remedy = "give name, type, location or part-of"
        raise InvalidArgumentError(place, cause=f"objects are not searched by {', '.join(properties)}", remedy=remedy)
    if name is None and type is None and location is None and whole is None:
        raise InvalidArgumentError(place, cause="the object is not described", remedy="give its name or type")
    return list(fitting), found.is_definite, text


def _named(world: Simulation, bodies: Sequence[Body], name: str) -> list[BodyId]:
    """The bodies with an id, IRI or name, or of a class."""
    exact = [body.id for body in bodies if name in {body.id, body.iri, local_name(body.iri)}]
    if exact:
        return exact
    with world.knowledge.lock:
        try:
            found = world.knowledge.names.find_thing(name.lstrip(":"), EntityType.INDIVIDUAL)
        except KnowledgeError:
            return []
    iris = {found.iri} if found.members is None else {*found.members}
    return [body.id for body in bodies if body.iri in iris]


def _class(world: Simulation, type: object) -> Iri:
    """The class that a type names, such as `Milk`, `:milk` or `an IRI`.

    Raises:
        NameNotFoundError: there is none.
        AmbiguousNameError: there are several.
    """
    text = str(type).strip().lstrip(":")
    words = text.lower().replace("-", " ") if text.isupper() else text
    with world.knowledge.lock:
        return world.knowledge.names.find_thing(words, EntityType.CLASS).iri


def _contents(world: Simulation, location: object) -> set[BodyId]:
    """The bodies on or in something."""
    properties = _parse(location, "the location").properties if not isinstance(location, str) else {"at": location}
    iris = {body.iri: body.id for body in world.snapshot().bodies}
    for key in (*_PLACES, "at"):
        if key in properties:
            holders, _, _ = _bodies(world, properties[key], "the location")
            relations = {"on": {"on"}, "into": {"inside"}}.get(_PLACES.get(key, ""), {"on", "inside"})
            by_id = {id: iri for iri, id in iris.items()}
            rows = [row for holder in holders for row in world.ask("where_is", other=by_id[holder])]
            return {iris[row.thing] for row in rows if row.relation in relations and row.thing in iris}
    raise InvalidArgumentError(
        "the location", cause="it names no object", remedy=f"give {', '.join(_PLACES)} an object"
    )


def _parts_of(world: Simulation, whole: object) -> set[BodyId]:
    """The bodies that are parts of something."""
    wholes, _, _ = _bodies(world, whole, "part-of")
    iris = {body.iri: body.id for body in world.snapshot().bodies}
    by_id = {id: iri for iri, id in iris.items()}
    rows = [row for each in wholes for row in world.ask("part_of", whole=by_id[each])]
    return {iris[row.part] for row in rows if row.part in iris}
