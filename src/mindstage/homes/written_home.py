"""Homes as files in the dialects of semantic maps, with the habits of the programs that wrote such files.

A file hides what its dialect does not state, such as where a mesh has its pivot or which end of a joint is the door:
the truth is returned beside it. Equal homes give equal bytes. Nothing is shared with the readers and writers of
`mindstage.maps`, so that a misreading of a dialect there is not repeated here.
"""

from __future__ import annotations

import json
from base64 import urlsafe_b64encode
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from hashlib import sha256
from math import atan2, sqrt

from mindstage.errors import InvalidArgumentError
from mindstage.homes.friction import true_frictions
from mindstage.homes.household import KNOWROB, household
from mindstage.homes.styles import HomeDialect
from mindstage.scene import (
    AngularLimits,
    AxisMotion,
    Body,
    BodyId,
    Joint,
    LinearLimits,
    Mobility,
    Quaternion,
    Vector,
    World,
)
from mindstage.scene.transforms import quat_multiply, quat_rotate, rotation_matrix

__all__ = ["WrittenHome", "write_home"]

_AXES = {"x": 0, "y": 1, "z": 2, "twist": 0, "swing2": 1, "swing1": 2}
"""The axis of the joint frame that a degree of freedom moves along or about."""
_ROLL = (sqrt(0.5), sqrt(0.5), 0.0, 0.0)
_DEFAULT_SWING_RAD = 0.785398
"""What SemLog states for axes that are locked."""
_SOMA_CLASSES = {
    "Handle": "DesignedHandle",
    "ControlKnob": "DesignedHandle",
    "WallOfAConstruction": "Wall",
    "CounterTop": "Countertop",
    "StoveTop": "Stove",
    "Table-PieceOfFurniture": "Table",
    "Chair-PieceOfFurniture": "Chair",
    "Bowl": "Bowl",
    **{name: name for name in ("Drawer", "Door", "Cupboard", "Dishwasher", "Refrigerator", "Floor", "Cup", "Bottle")},
}
"""Classes of SOMA by those of KnowRob."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenHome:
    """A home in a dialect."""

    text: str
    """The map, RDF/XML."""
    truth: str
    """JSON: what is true of each individual of the map, by its local name.

    `bodies` have `id` (in the home), `class`, `size` (along the axes of the mesh [m]), `center` [m] and `quaternion`
    (w x y z) of the box, `pivot` (the origin of the mesh, from the center and along its axes [m]), `mobility`, `mass`
    ([kg] or null), `material` and `friction` (of things: the coefficient on what they stand on, else null; see
    `homes.friction`) and `attached_to`. `joints` have `id`, `kind` (slide or hinge), `base` and `moving` (the door or
    the drawer), `origin` [m], `axis` (of unit length; positive motions open) and `travel` ([m] or [rad]), all in the
    frame of the home, and `friction` ([N] or [N m]).
    `size_frame` is `world` where classes have the world-aligned bounds of their first individual.
    """
    urdf: str = ""
    """The robot description that the map needs, if any."""


def write_home(home: World, *, dialect: HomeDialect | str = HomeDialect.SEMLOG) -> WrittenHome:
    """Writes a generated home in a dialect of semantic maps; equal homes give equal bytes.

    Args:
        home: what `generate_home` returned.
        dialect: the dialect.

    Raises:
        InvalidArgumentError: the dialect is unknown, or the world has a body without a size or a joint that is neither
            a slide nor a hinge.
    """
    try:
        dialect = HomeDialect(dialect)
    except ValueError as error:
        known = ", ".join(HomeDialect)
        raise InvalidArgumentError("dialect", cause=f"{dialect!r} is unknown", remedy=f"use one of {known}") from error
    return {
        HomeDialect.SEMLOG: _SemlogWriter,
        HomeDialect.SEMLOG_2018: _EarlySemlogWriter,
        HomeDialect.AMEVA: _AmevaWriter,
        HomeDialect.KNOWROB1: _Knowrob1Writer,
        HomeDialect.SOMA: _SomaWriter,
        HomeDialect.SOMA_URDF: _LinkedSomaWriter,
    }[dialect](home, dialect).write()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Actor:
    """A body as the file has it: with a mesh that has its own axes and origin."""

    body: Body
    name: str
    cls: str
    """The local name of its class in the file."""
    size: Vector
    quaternion: Quaternion
    pivot: Vector

    @property
    def position(self) -> Vector:
        return _moved(self.body.pose.position, self.quaternion, self.pivot)

    def bounds(self) -> Vector:
        """The extents of the world-aligned bounds [m]."""
        x, y, z = abs(rotation_matrix(self.quaternion)) @ self.size
        return float(x), float(y), float(z)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Front:
    """A door or a drawer and its joint."""

    joint: Joint
    name: str
    base: _Actor
    moving: _Actor
    motion: str
    """The field of the joint's limits that is not locked."""
    axis: Vector
    travel: float
    stated: tuple[_Actor, _Actor]
    """Parent and child in the file; those of one joint of four are exchanged."""

    @property
    def slides(self) -> bool:
        return len(self.motion) == 1


class _Writer:
    """What the dialects have in common: names, meshes, fronts, and the truth."""

    is_logged = True
    """Whether a logger of Unreal wrote the file: opaque ids, classes of meshes, pivots."""
    size_frame = "individual"

    def __init__(self, home: World, dialect: HomeDialect) -> None:
        self.home, self.dialect = home, dialect
        self.namespace = home.iri.rpartition("#")[0] + "#"
        self.moving = {joint.child for joint in home.joints}
        self.actors = {actor.body.id: actor for actor in self._meshes()}
        self.parents = {each.child: self.actors[each.parent] for each in home.attachments}
        self.children: dict[BodyId, list[_Actor]] = {}
        for each in home.attachments:
            self.children.setdefault(each.parent, []).append(self.actors[each.child])
        self.fronts = [self._front(joint) for joint in home.joints]

    def write(self) -> WrittenHome:
        """The file and its truth."""
        things, joint_frictions = true_frictions(self.home)
        bodies = {
            actor.name: {
                "id": id,
                "class": actor.body.cls,
                "size": actor.size,
                "center": actor.body.pose.position,
                "quaternion": _rounded(actor.quaternion, 9),
                "pivot": _rounded(actor.pivot, 6),
                "mobility": actor.body.physics.mobility,
                "mass": actor.body.physics.mass_kg,
                "material": None if id not in things else things[id].material,
                "friction": None if id not in things else things[id].coefficient,
                "attached_to": self.parents[id].name if id in self.parents else None,
            }
            for id, actor in self.actors.items()
        }
        joints = {
            front.name: {
                "id": front.joint.id,
                "kind": "slide" if front.slides else "hinge",
                "base": front.base.name,
                "moving": front.moving.name,
                "origin": front.joint.pose.position,
                "axis": _rounded(front.axis, 9),
                "travel": front.travel,
                "friction": joint_frictions[front.joint.id],
            }
            for front in self.fronts
        }
        truth = {
            "dialect": self.dialect,
            "map": self.map_name,
            "size_frame": self.size_frame,
            "bodies": bodies,
            "joints": joints,
        }
        return WrittenHome(text="".join(self.lines()), truth=json.dumps(truth, indent=1) + "\n", urdf=self.urdf())

    def urdf(self) -> str:
        """The robot description beside the file."""
        return ""

    def lines(self) -> Iterator[str]:
        """The text of the file."""
        raise NotImplementedError

    @property
    def map_name(self) -> str:
        """The local name of the map."""
        return self.name_of("home")

    def name_of(self, id: str) -> str:
        """The local name of an individual: in logged maps 128 bits in the alphabet of URLs."""
        if not self.is_logged:
            return id
        digest = sha256(f"{self.home.iri}/{self.dialect}/{id}".encode()).digest()
        return urlsafe_b64encode(digest[:16]).decode().rstrip("=")

    def class_of(self, body: Body) -> str:
        """The local name of the class of a body, or of the nearest class above it that KnowRob had."""
        found = (each for each in household().ancestors(body.cls) if each.startswith(KNOWROB))
        return next(found, body.cls).rpartition("#")[2]

    def _meshes(self) -> Iterator[_Actor]:
        """The actors; those of a class and a size have the same mesh."""
        if not self.is_logged:
            for body in self.home.bodies:
                yield _Actor(
                    body=body,
                    name=self.name_of(body.id),
                    cls=self.class_of(body),
                    size=_size_of(body),
                    quaternion=body.pose.quaternion,
                    pivot=(0.0, 0.0, 0.0),
                )
            return
        meshes: dict[str, dict[Vector, int]] = {}
        drawn = []
        for body in self.home.bodies:
            size, quaternion = _size_of(body), body.pose.quaternion
            stem = body.cls.rpartition("#")[2]
            if "Handle" in stem and size[2] > size[1]:  # an upright handle is the mesh of a level one, turned
                size, quaternion = (size[0], size[2], size[1]), _product(quaternion, _ROLL)
            number = meshes.setdefault(stem, {}).setdefault(size, len(meshes[stem]) + 1)
            drawn.append((body, stem, number, size, quaternion))
        for body, stem, number, size, quaternion in drawn:
            cls = f"{stem}{number:02d}" if len(meshes[stem]) > 1 else stem
            yield _Actor(
                body=body,
                name=self.name_of(body.id),
                cls=cls,
                size=size,
                quaternion=quaternion,
                pivot=self._pivot(body, f"{stem}/{size}", size),
            )

    def _pivot(self, body: Body, mesh: str, size: Vector) -> Vector:
        center, foot = (0.0, 0.0, 0.0), (0.0, 0.0, -size[2] / 2)
        edge = (0.0, -size[1] / 2, -size[2] / 2)
        if body.physics.mobility is Mobility.KINEMATIC:
            return center
        choices = (
            (foot, foot, edge, center) if body.id in self.moving or not body.physics.is_dynamic else (foot, center)
        )
        return choices[_draw(mesh, len(choices))]

    def _front(self, joint: Joint) -> _Front:
        limits: dict[str, LinearLimits | AngularLimits] = dict.fromkeys(("x", "y", "z"), joint.linear)
        limits |= dict.fromkeys(("twist", "swing2", "swing1"), joint.angular)
        motions = [name for name, each in limits.items() if getattr(each, name) is not AxisMotion.LOCKED]
        if len(motions) != 1:
            raise InvalidArgumentError(
                "home", cause=f"{joint.id!r} is neither a slide nor a hinge", remedy="pass a generated home"
            )
        middle = getattr(limits[motions[0]], f"{motions[0]}_middle")
        unit = [0.0, 0.0, 0.0]
        unit[_AXES[motions[0]]] = 1.0 if middle >= 0 else -1.0
        base, moving = self.actors[joint.parent], self.actors[joint.child]
        return _Front(
            joint=joint,
            name=self.name_of(joint.id),
            base=base,
            moving=moving,
            motion=motions[0],
            axis=_moved((0.0, 0.0, 0.0), joint.pose.quaternion, (unit[0], unit[1], unit[2])),
            travel=round(2 * abs(middle), 6),
            stated=(moving, base) if _draw(joint.iri, 4) == 0 else (base, moving),
        )


# -- SemLog ------------------------------------------------------------------------------------------------------------

_LOGGED_HEAD = """<?xml version="1.0" encoding="utf-8"?>

<!DOCTYPE rdf:RDF[
	<!ENTITY owl{blank}"http://www.w3.org/2002/07/owl#">
	<!ENTITY xsd{blank}"http://www.w3.org/2001/XMLSchema#">
	<!ENTITY knowrob{blank}"http://knowrob.org/kb/knowrob.owl#">
	<!ENTITY rdfs{blank}"http://www.w3.org/2000/01/rdf-schema#">
	<!ENTITY rdf{blank}"http://www.w3.org/1999/02/22-rdf-syntax-ns#">
	<!ENTITY home{blank}"{namespace}">
]>

<rdf:RDF xmlns="{namespace}"
	xml:base="{namespace}"
	xmlns:owl="http://www.w3.org/2002/07/owl#"
	xmlns:xsd="http://www.w3.org/2001/XMLSchema#"
	xmlns:knowrob="http://knowrob.org/kb/knowrob.owl#"
	xmlns:rdfs="http://www.w3.org/2000/01/rdf-schema#"
	xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"
	xmlns:home="{namespace}">

	<!-- Ontologies -->
	<owl:Ontology {ontology}>
		<owl:imports rdf:resource="package://{package}/owl/knowrob.owl"/>
	</owl:Ontology>

	<!-- Property Definitions -->
	<owl:ObjectProperty rdf:about="&knowrob;describedInMap"/>
	<owl:ObjectProperty rdf:about="&knowrob;pathToCadModel"/>

	<!-- Property Definitions -->
	<owl:DatatypeProperty rdf:about="&knowrob;quaternion"/>
	<owl:DatatypeProperty rdf:about="&knowrob;translation"/>

	<!-- Class Definitions -->
	<owl:Class rdf:about="&knowrob;SemanticEnvironmentMap"/>
	<owl:Class rdf:about="&knowrob;Pose"/>
"""


class _SemlogWriter(_Writer):
    """The thesis's dialect."""

    size_frame = "world"
    package = "knowrob_common"
    is_early = False
    has_map = True

    def lines(self) -> Iterator[str]:
        yield self._head()
        for cls, size in self._class_sizes().items():
            yield f'\n\t<!-- Class {cls} -->\n\t<owl:Class rdf:about="&knowrob;{cls}">\n{self.class_values(cls, size)}'
            yield "\t</owl:Class>\n"
        yield "\n\t<!-- Individuals -->\n"
        if self.has_map:
            yield f"\n\t<!-- Semantic Map {self.map_name} -->\n"
            yield _individual(self.map_name, _type("&knowrob;SemanticEnvironmentMap"))
        for actor in self.actors.values():
            yield f"\n\t<!-- Individual {actor.cls} -->\n"
            yield _individual(actor.name, *self.statements(actor))
            yield self.pose(f"{actor.body.id}/pose", actor.position, actor.quaternion)
        for front in self.fronts:
            yield from self.joint(front)
        yield "</rdf:RDF>\n"

    def _head(self) -> str:
        about = f'rdf:about="{self.namespace.removesuffix("#")}"'
        return _LOGGED_HEAD.format(
            blank="" if self.is_early else " ",
            namespace=self.namespace,
            package=self.package,
            ontology=f"{about} {about}" if self.is_early else about,
        )

    def _class_sizes(self) -> dict[str, Vector]:
        """The numbers of each class: those of the first individual that the logger met."""
        sizes: dict[str, Vector] = {}
        for actor in self.actors.values():
            sizes.setdefault(actor.cls, actor.bounds() if self.size_frame == "world" else actor.size)
        return sizes

    def class_values(self, cls: str, size: Vector) -> str:
        """The statements of a class."""
        del cls
        names = ("depthOfObject", "widthOfObject", "heightOfObject")
        return "".join(_restriction(name, _number(extent)) for name, extent in zip(names, size, strict=True))

    def statements(self, actor: _Actor) -> Iterator[str]:
        """The statements of an actor but its pose's."""
        yield _type(f"&knowrob;{actor.cls}")
        yield self.in_map()
        yield from self.links(actor)
        yield from self.physics(actor)
        yield self.link("knowrob:pose", self.name_of(f"{actor.body.id}/pose"))
        yield from self.model(actor)
        yield self.tags(actor)

    def links(self, actor: _Actor) -> Iterator[str]:
        """Handles are children of their fronts."""
        for child in self.children.get(actor.body.id, ()):
            yield self.link("knowrob:child", child.name)
        if parent := self.parents.get(actor.body.id):
            yield self.link("knowrob:parent", parent.name)

    def physics(self, actor: _Actor) -> Iterator[str]:
        """Masses of 0 stand beside gravity."""
        physics = actor.body.physics
        if not self.is_early:
            yield _literal("knowrob:mobility", physics.mobility or "static", "string")
            yield _literal("knowrob:mass", _number(physics.mass_kg or 0.0))
        yield _literal("knowrob:overlapEvents", "false", "boolean")
        if not self.is_early:
            yield _literal("knowrob:gravity", "true", "boolean")

    def model(self, actor: _Actor) -> Iterator[str]:
        yield _literal("knowrob:pathToCadModel", _mesh_path(actor.cls), "string")

    def tags(self, actor: _Actor) -> str:
        return self.tagged(f"Class,{actor.cls};Id,{actor.name};")

    def in_map(self) -> str:
        return self.link("knowrob:describedInMap", self.map_name)

    def tagged(self, pairs: str) -> str:
        return _literal("knowrob:tagsData", f"SemLog;{pairs}", "string")

    def link(self, property: str, name: str) -> str:
        return f'<{property} rdf:resource="&home;{name}"/>'

    def pose(self, id: str, position: Vector, quaternion: Quaternion) -> str:
        """The individual of a pose."""
        return _individual(
            self.name_of(id),
            _type("&knowrob;Pose"),
            _literal("knowrob:quaternion", _row(quaternion), "string"),
            _literal("knowrob:translation", _row(position), "string"),
        )

    def joint(self, front: _Front) -> Iterator[str]:
        """A constraint; its limit is symmetric, and the case stops the front on the other side."""
        parent, child = front.stated
        id = front.joint.id
        parts = {"linearConstraint": f"{id}/linear", "angularConstraint": f"{id}/angular"}
        yield "\n\t<!-- Constraint -->\n"
        yield _individual(
            front.name,
            _type("&knowrob;Constraint"),
            self.link("knowrob:parent", parent.name),
            self.link("knowrob:child", child.name),
            *(() if self.is_early else (self.in_map(),)),
            self.tagged(f"Id,{front.name};"),
            self.link("knowrob:pose", self.name_of(f"{id}/pose")),
            *(self.link(f"knowrob:{name}", self.name_of(part)) for name, part in parts.items()),
        )
        yield self.pose(f"{id}/pose", front.joint.pose.position, front.joint.pose.quaternion)
        motions = {name: 1 if name == front.motion else 2 for name in _AXES}  # limited, locked
        yield _individual(
            self.name_of(parts["linearConstraint"]),
            _type("&knowrob;LinearConstraint"),
            *(_literal(f"knowrob:{name}Motion", motions[name], "integer") for name in ("x", "y", "z")),
            _literal("knowrob:limit", _number(front.travel if front.slides else 0.0)),
            *_soft_limit("softConstraint", "stiffness", "damping"),
        )
        swings = ("swing1", "swing2", "twist")
        limits = {name: front.travel if name == front.motion else _DEFAULT_SWING_RAD for name in swings}
        yield _individual(
            self.name_of(parts["angularConstraint"]),
            _type("&knowrob;AngularConstraint"),
            *(_literal(f"knowrob:{name}Motion", motions[name], "integer") for name in swings),
            *(_literal(f"knowrob:{name}Limit", _number(limit)) for name, limit in limits.items()),
            *_soft_limit("softSwingConstraint", "swingStiffness", "swingDamping"),
            *_soft_limit("softTwistConstraint", "twistStiffness", "twistDamping"),
        )


class _EarlySemlogWriter(_SemlogWriter):
    """Mobility stands in tags, and most of what is static is called dynamic."""

    is_early = True

    def tags(self, actor: _Actor) -> str:
        is_static = actor.body.physics.mobility is Mobility.STATIC and _draw(actor.name, 4) == 0
        mobility = "Static" if is_static else "Dynamic"
        return self.tagged(f"Class,{actor.cls};Id,{actor.name};Mobility,{mobility};")


class _AmevaWriter(_SemlogWriter):
    """Some homes are as before the logger's change of June 2021; later ones have body boxes and values of classes."""

    package = "knowrob"

    def __init__(self, home: World, dialect: HomeDialect) -> None:
        super().__init__(home, dialect)
        self.is_recent = _draw(home.iri, 2) == 0
        self.has_map = not self.is_recent
        self.size_frame = "body" if self.is_recent else "world"
        self.fronts_of: dict[BodyId, list[_Front]] = {}
        for front in self.fronts:
            self.fronts_of.setdefault(front.base.body.id, []).append(front)
        self.front_by_body = {front.moving.body.id: front for front in self.fronts}
        self.masses = {actor.cls: actor.body.physics.mass_kg for actor in self.actors.values()}

    def class_values(self, cls: str, size: Vector) -> str:
        values = super().class_values(cls, (100 * size[0], 100 * size[1], 100 * size[2]))
        if not self.is_recent:
            return values
        mass = self.masses[cls]
        path = _restriction("pathToCadModel", _mesh_path(cls), "string")
        return values + path + (_restriction("mass", _number(mass)) if mass else "")

    def links(self, actor: _Actor) -> Iterator[str]:
        """What moves is a child of its case, and the joint one of what moves."""
        for front in self.fronts_of.get(actor.body.id, ()):
            yield self.link("knowrob:child", front.moving.name)
        if own := self.front_by_body.get(actor.body.id):
            yield self.link("knowrob:child", own.name)
            yield self.link("knowrob:parent", own.base.name)
        yield from super().links(actor)

    def physics(self, actor: _Actor) -> Iterator[str]:
        """What has no mass lacks it."""
        physics = actor.body.physics
        yield _literal("knowrob:mobility", physics.mobility or "static", "string")
        if physics.mass_kg and not self.is_recent:
            yield _literal("knowrob:mass", _number(physics.mass_kg))
        yield _literal("knowrob:overlapEvents", "true" if actor.body.id in self.fronts_of else "false", "boolean")
        yield _literal("knowrob:gravity", "true", "boolean")
        yield _literal("knowrob:maskColor", _mask(actor.name), "string")

    def model(self, actor: _Actor) -> Iterator[str]:
        yield from ()

    def tags(self, actor: _Actor) -> str:
        return self.tagged(f"Class,{actor.cls};Id,{actor.name};VisMask,{_mask(actor.name)};")

    def pose(self, id: str, position: Vector, quaternion: Quaternion) -> str:
        """In centimeters and with the y axis mirrored."""
        (x, y, z), (w, i, j, k) = position, quaternion
        return super().pose(id, (100 * x, -100 * y, 100 * z), (-i, j, -k, w))

    def joint(self, front: _Front) -> Iterator[str]:
        cls = "LinearJoint" if front.slides else "RevoluteJoint"
        id = f"{front.joint.id}/pose"
        yield f"\n\t<!-- Individual {cls} -->\n"
        yield _individual(
            front.name,
            _type(f"&knowrob;{cls}"),
            self.in_map(),
            self.link("knowrob:parent", front.moving.name),
            _literal("knowrob:mobility", "kinematic", "string"),
            self.link("knowrob:pose", self.name_of(id)),
            self.tagged(f"Class,{cls};Id,{front.name};"),
        )
        quaternion = front.joint.pose.quaternion
        if front.motion == "y":  # the x axis of a slide's joint is the direction of its motion
            quaternion = _product(quaternion, (sqrt(0.5), 0.0, 0.0, sqrt(0.5)))
        yield self.pose(id, front.joint.pose.position, quaternion)


# -- KnowRob 1 ---------------------------------------------------------------------------------------------------------

_KNOWROB1_HEAD = """<?xml version="1.0"?>

<!DOCTYPE rdf:RDF [
    <!ENTITY owl "http://www.w3.org/2002/07/owl#" >
    <!ENTITY xsd "http://www.w3.org/2001/XMLSchema#" >
    <!ENTITY rdfs "http://www.w3.org/2000/01/rdf-schema#" >
    <!ENTITY rdf "http://www.w3.org/1999/02/22-rdf-syntax-ns#" >
    <!ENTITY knowrob "http://knowrob.org/kb/knowrob.owl#" >
]>

<rdf:RDF xmlns="{namespace}"
     xml:base="{base}"
     xmlns:rdfs="http://www.w3.org/2000/01/rdf-schema#"
     xmlns:owl="http://www.w3.org/2002/07/owl#"
     xmlns:xsd="http://www.w3.org/2001/XMLSchema#"
     xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"
     xmlns:knowrob="http://knowrob.org/kb/knowrob.owl#">
    <owl:Ontology rdf:about="">
      <owl:imports rdf:resource="package://knowrob_common/owl/knowrob.owl"/>
    </owl:Ontology>

    <owl:ObjectProperty rdf:about="&knowrob;properPhysicalParts"/>
"""
_SEEN_S, _SEEN_BEFORE_S = 1361536619, 1361450219
"""Times of perceptions [s]."""


class _Knowrob1Writer(_Writer):
    """Objects are perceived, some of them twice; the later perception counts, wherever it stands in the file."""

    is_logged = False

    def lines(self) -> Iterator[str]:
        yield _KNOWROB1_HEAD.format(namespace=self.namespace, base=self.namespace.removesuffix("#"))
        for name in ("depth", "height", "width"):
            yield f'    <owl:DatatypeProperty rdf:about="&knowrob;{name}OfObject"/>\n'
        yield _element("SemanticEnvironmentMap", self.map_name)
        for cls in sorted({actor.cls for actor in self.actors.values()}):
            yield f'    <owl:Class rdf:about="&knowrob;{cls}"/>\n'
        for time_s in (_SEEN_BEFORE_S, _SEEN_S):
            yield _element("TimePoint", f"timepoint_{time_s}")
        for actor in self.actors.values():
            yield _element(actor.cls, actor.name, *self._statements(actor))
            perceptions = list(self._perceptions(actor))
            yield from reversed(perceptions) if _draw(actor.body.id, 2) else perceptions
        for front in self.fronts:
            yield from self._joint(front)
        yield "</rdf:RDF>\n"

    def _statements(self, actor: _Actor) -> Iterator[str]:
        for name, extent in zip(("depth", "width", "height"), actor.size, strict=True):
            yield _literal(f"knowrob:{name}OfObject", _number(extent))
        id = actor.body.id
        if id not in self.moving and id not in self.parents:  # a part is in the map of its whole
            yield _reference("describedInMap", self.map_name)
        for child in self.children.get(id, ()):
            yield _reference("properPhysicalParts", child.name)
        for front in self.fronts:
            if front.base is actor:
                yield _reference("properPhysicalParts", front.moving.name)
                yield _reference("properPhysicalParts", front.name)
            if front.stated[0] is actor:
                relation = "prismaticallyConnectedTo" if front.slides else "hingedTo"
                yield _reference(relation, front.stated[1].name)

    def _perceptions(self, actor: _Actor) -> Iterator[str]:
        x, y, z = actor.position
        if _draw(actor.body.id, 3) == 0:
            yield self._perception(actor.name, _SEEN_BEFORE_S, (x + 0.25, y - 0.4, z), actor.quaternion)
        yield self._perception(actor.name, _SEEN_S, (x, y, z), actor.quaternion)

    def _perception(self, name: str, time_s: int, position: Vector, quaternion: Quaternion) -> str:
        event, matrix = f"SemanticMapPerception_{name}_{time_s}", f"rotationmatrix3d_{name}_{time_s}"
        seen = _element(
            "SemanticMapPerception",
            event,
            _reference("objectActedOn", name),
            _reference("eventOccursAt", matrix),
            _reference("startTime", f"timepoint_{time_s}"),
        )
        rows = [[*map(float, row), at] for row, at in zip(rotation_matrix(quaternion), position, strict=True)]
        rows.append([0.0, 0.0, 0.0, 1.0])
        values = (
            _literal(f"knowrob:m{row}{column}", _number(rows[row][column])) for row in range(4) for column in range(4)
        )
        return seen + _element("RotationMatrix3D", matrix, *values)

    def _joint(self, front: _Front) -> Iterator[str]:
        quaternion = front.joint.pose.quaternion
        if not front.slides:  # a hinge turns about the z axis of its own frame
            quaternion = _about_z(front)
        yield _element(
            "PrismaticJoint" if front.slides else "HingedJoint",
            front.name,
            _literal("knowrob:minJointValue", _number(0.0)),
            _literal("knowrob:maxJointValue", _number(front.travel)),
            *(_reference("connectedTo-Rigidly", actor.name) for actor in front.stated),
            *(
                (_reference("direction", f"{front.name}_direction"),)
                if front.slides
                else (_literal("knowrob:turnRadius", _number(front.moving.size[_WIDTH[front.motion]])),)
            ),
        )
        yield self._perception(front.name, _SEEN_S, front.joint.pose.position, quaternion)
        if front.slides:
            vector = zip("XYZ", front.axis, strict=True)
            values = (_literal(f"knowrob:vector{axis}", _number(value)) for axis, value in vector)
            yield _element("Vector", f"{front.name}_direction", *values)


_WIDTH = {"swing1": 1, "swing2": 2, "twist": 2}
"""The extent of a door from its hinge, by the axis that it turns about."""


def _about_z(front: _Front) -> Quaternion:
    """The frame whose z axis is that of a hinge; positive angles open."""
    quaternion = front.joint.pose.quaternion
    turned = {"swing1": quaternion, "swing2": _product(quaternion, (sqrt(0.5), -sqrt(0.5), 0.0, 0.0))}
    quaternion = turned.get(front.motion, _product(quaternion, (sqrt(0.5), 0.0, sqrt(0.5), 0.0)))
    up = _moved((0.0, 0.0, 0.0), quaternion, (0.0, 0.0, 1.0))
    opens = sum(one * other for one, other in zip(up, front.axis, strict=True)) > 0
    return quaternion if opens else _product(quaternion, (0.0, 1.0, 0.0, 0.0))


# -- SOMA --------------------------------------------------------------------------------------------------------------

_SOMA_HEAD = """<?xml version="1.0"?>
<!DOCTYPE rdf:RDF [
    <!ENTITY owl "http://www.w3.org/2002/07/owl#" >
    <!ENTITY xsd "http://www.w3.org/2001/XMLSchema#" >
    <!ENTITY knowrob "http://knowrob.org/kb/knowrob.owl#" >
    <!ENTITY SOMA "http://www.ease-crc.org/ont/SOMA.owl#" >
    <!ENTITY dul "http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#" >
    <!ENTITY map "{namespace}" >
    <!ENTITY urdf "http://knowrob.org/kb/urdf.owl#" >
    <!ENTITY rdfs "http://www.w3.org/2000/01/rdf-schema#" >
    <!ENTITY rdf "http://www.w3.org/1999/02/22-rdf-syntax-ns#" >
]>

<rdf:RDF xmlns="{namespace}"
    xml:base="{base}"
    xmlns:rdfs="http://www.w3.org/2000/01/rdf-schema#"
    xmlns:owl="http://www.w3.org/2002/07/owl#"
    xmlns:xsd="http://www.w3.org/2001/XMLSchema#"
    xmlns:map="{namespace}"
    xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"
    xmlns:SOMA="http://www.ease-crc.org/ont/SOMA.owl#"
    xmlns:dul="http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#"
    xmlns:urdf="http://knowrob.org/kb/urdf.owl#"
    xmlns:knowrob="http://knowrob.org/kb/knowrob.owl#">
    <owl:Ontology rdf:about="{base}">
        <owl:imports rdf:resource="package://knowrob/owl/knowrob.owl"/>
    </owl:Ontology>
"""


class _SomaWriter(_Writer):
    """Everything about an object is nested in it; a drawer's joint is between the drawer and its handle."""

    is_logged = False

    def lines(self) -> Iterator[str]:
        yield _SOMA_HEAD.format(namespace=self.namespace, base=self.namespace.removesuffix("#"))
        self.limits: dict[tuple[bool, float], str] = {}
        for front in self.fronts:
            kind = "drawer" if front.slides else "door"
            self.limits.setdefault((front.slides, front.travel), f"home_{kind}_joint{len(self.limits) + 1}")
        for (slides, travel), name in self.limits.items():
            yield _joint_class(name, "PrismaticJoint" if slides else "RevoluteJoint", travel)
        for actor in self.actors.values():
            body = "\n".join(self._statements(actor))
            yield f'\n    <owl:NamedIndividual rdf:about="&map;{actor.name}">\n{body}\n    </owl:NamedIndividual>\n'
        yield "</rdf:RDF>\n"

    @property
    def map_name(self) -> str:
        return ""

    def _statements(self, actor: _Actor) -> Iterator[str]:
        yield f'        <rdf:type rdf:resource="{self._class_iri(actor.body)}"/>'
        depth, width, height = actor.size
        extents = {"Height": height, "Depth": depth, "Width": width}
        lengths = (_literal(f"SOMA:has{name}", _number(value), "double") for name, value in extents.items())
        yield _nested("SOMA:hasShape", "&SOMA;Shape", _nested("dul:hasRegion", "&SOMA;BoxShape", *lengths))
        if actor.body.id in self.parents:
            region = _nested("dul:hasRegion", "&SOMA;ColorRegion", _array("SOMA:hasRGBValue", "0.2 0.2 0.2 1.0"))
            yield _nested("SOMA:hasColor", "&SOMA;Color", region)
        w, x, y, z = actor.quaternion
        pose = (
            _array("knowrob:quaternion", _row((x, y, z, w))),
            _array("knowrob:translation", _row(actor.position)),
        )
        place = _nested("SOMA:hasSpaceRegion", "&SOMA;6DPose", *pose)
        yield _nested("SOMA:hasLocalization", "&SOMA;Localization", place)
        children = self.children.get(actor.body.id, [])
        for child in children:
            yield self._link("SOMA:hasPhysicalComponent", child)
        for front in self.fronts:
            if front.base is actor:
                if not front.slides:
                    yield self._link("knowrob:hingedTo", front.moving)
                yield self._link("SOMA:hasPhysicalComponent", front.moving)
                if not front.slides or not self.children.get(front.moving.body.id):
                    yield self._joint(front, *front.stated)
            if front.moving is actor and front.slides and children:
                yield self._joint(front, actor, children[0])

    def _class_iri(self, body: Body) -> str:
        names = (each.rpartition("#")[2] for each in household().ancestors(body.cls))
        found = next((_SOMA_CLASSES[name] for name in names if name in _SOMA_CLASSES), None)
        return f"&SOMA;{found}" if found else f"&knowrob;{self.class_of(body)}"

    def _joint(self, front: _Front, parent: _Actor, child: _Actor) -> str:
        ends = (self._link("urdf:hasParentLink", parent), self._link("urdf:hasChildLink", child))
        cls = self.limits[front.slides, front.travel]
        return _nested("urdf:hasJoint", f"&map;{cls}", *ends, about=f"&map;{front.name}")

    @staticmethod
    def _link(property: str, actor: _Actor) -> str:
        return f'<{property} rdf:resource="&map;{actor.name}"/>'


class _LinkedSomaWriter(_SomaWriter):
    """Individuals name links; the frame of a front's link is at its joint, that of other links at the box's center."""

    def lines(self) -> Iterator[str]:
        yield _SOMA_HEAD.format(namespace=self.namespace, base=self.namespace.removesuffix("#"))
        for actor in self.actors.values():
            id = actor.body.id
            parts = [front.moving for front in self.fronts if front.base is actor] + self.children.get(id, [])
            statements = (
                _type(self._class_iri(actor.body)),
                _literal("urdf:hasBaseLinkName", f"{id}_link", "string"),
                *(self._link("SOMA:hasPhysicalComponent", part) for part in parts),
            )
            lines = "".join(f"        {statement}\n" for statement in statements)
            yield f'\n    <owl:NamedIndividual rdf:about="&map;{actor.name}">\n{lines}    </owl:NamedIndividual>\n'
        yield "</rdf:RDF>\n"

    def urdf(self) -> str:
        fronts = {front.moving.body.id: front for front in self.fronts}
        links = ['<?xml version="1.0"?>\n<robot name="home">\n  <link name="home_root"/>\n']
        for id, actor in self.actors.items():
            parent = fronts[id].base if id in fronts else self.parents.get(id)
            links += (_urdf_link(actor, fronts.get(id)), _urdf_joint(actor, parent, fronts))
        return "".join(links) + "</robot>\n"


def _link_origin(actor: _Actor, front: _Front | None) -> Vector:
    return front.joint.pose.position if front else actor.body.pose.position


def _urdf_link(actor: _Actor, front: _Front | None) -> str:
    center = _relative(actor.body.pose.position, _link_origin(actor, front), actor.quaternion)
    box = f'<origin xyz="{_row(center)}" rpy="0 0 0"/><geometry><box size="{_row(actor.size)}"/></geometry>'
    inertial, mass = "", actor.body.physics.mass_kg
    if mass:
        depth, width, height = (mass * extent**2 / 12 for extent in actor.size)
        moments = {"ixx": width + height, "iyy": depth + height, "izz": depth + width, "ixy": 0, "ixz": 0, "iyz": 0}
        inertia = " ".join(f'{name}="{value:.9f}"' for name, value in moments.items())
        at = f'<origin xyz="{_row(center)}" rpy="0 0 0"/>'
        inertial = f'<inertial>{at}<mass value="{_number(mass)}"/><inertia {inertia}/></inertial>'
    shapes = f"<visual>{box}</visual><collision>{box}</collision>"
    return f'  <link name="{actor.body.id}_link">{inertial}{shapes}</link>\n'


def _urdf_joint(actor: _Actor, parent: _Actor | None, fronts: dict[BodyId, _Front]) -> str:
    body, front = actor.body, fronts.get(actor.body.id)
    base: Quaternion = (1.0, 0.0, 0.0, 0.0)
    name, origin = "home_root", (0.0, 0.0, 0.0)
    if parent is not None:
        base, name = parent.quaternion, f"{parent.body.id}_link"
        origin = _link_origin(parent, fronts.get(parent.body.id))
    kind, motion = "floating" if body.physics.is_dynamic else "fixed", ""
    if front is not None:
        axis = _relative(front.axis, (0.0, 0.0, 0.0), actor.quaternion)
        kind = "prismatic" if front.slides else "revolute"
        motion = (
            f'<axis xyz="{_row(axis)}"/><limit lower="0" upper="{_number(front.travel)}" effort="100" velocity="1"/>'
        )
    at = _row(_relative(_link_origin(actor, front), origin, base))
    yaw = 2 * (atan2(actor.quaternion[3], actor.quaternion[0]) - atan2(base[3], base[0]))
    ends = f'<parent link="{name}"/><child link="{body.id}_link"/><origin xyz="{at}" rpy="0 0 {yaw:.9f}"/>'
    joint = front.joint.id if front else f"{body.id}_joint"
    return f'  <joint name="{joint}" type="{kind}">{ends}{motion}</joint>\n'


def _joint_class(name: str, kind: str, travel: float) -> str:
    limits = _nested(
        "owl:hasValue",
        "&urdf;JointLimits",
        _literal("urdf:hasLowerLimit", _number(0.0), "double"),
        _literal("urdf:hasUpperLimit", _number(travel), "double"),
    )
    return f"""
    <owl:Class rdf:about="&map;{name}">
        <rdfs:subClassOf rdf:resource="&urdf;{kind}"/>
        <rdfs:subClassOf>
            <owl:Restriction>
                <owl:onProperty rdf:resource="&urdf;hasJointLimits"/>
                {limits}
            </owl:Restriction>
        </rdfs:subClassOf>
    </owl:Class>
"""


def _nested(property: str, cls: str, *statements: str, about: str = "") -> str:
    subject = f' rdf:about="{about}"' if about else ""
    inner = "".join(statements)
    type = f'<rdf:type rdf:resource="{cls}"/>'
    return f"<{property}><owl:NamedIndividual{subject}>{type}{inner}</owl:NamedIndividual></{property}>"


def _array(property: str, row: str) -> str:
    return f'<{property} rdf:datatype="&SOMA;array_double">{row}</{property}>'


# -- XML and numbers ---------------------------------------------------------------------------------------------------


def _individual(name: str, *statements: str) -> str:
    lines = "".join(f"\t\t{statement}\n" for statement in statements)
    return f'\t<owl:NamedIndividual rdf:about="&home;{name}">\n{lines}\t</owl:NamedIndividual>\n'


def _element(cls: str, name: str, *statements: str) -> str:
    lines = "".join(f"        {statement}\n" for statement in statements)
    return f'\n    <knowrob:{cls} rdf:about="#{name}">\n{lines}    </knowrob:{cls}>\n'


def _reference(property: str, name: str) -> str:
    return f'<knowrob:{property} rdf:resource="#{name}"/>'


def _type(cls: str) -> str:
    return f'<rdf:type rdf:resource="{cls}"/>'


def _literal(property: str, value: object, kind: str = "float") -> str:
    return f'<{property} rdf:datatype="&xsd;{kind}">{value}</{property}>'


def _restriction(property: str, value: object, kind: str = "float") -> str:
    return f"""\t\t<rdfs:subClassOf>
\t\t\t<owl:Restriction>
\t\t\t\t<owl:onProperty rdf:resource="&knowrob;{property}"/>
\t\t\t\t{_literal("owl:hasValue", value, kind)}
\t\t\t</owl:Restriction>
\t\t</rdfs:subClassOf>
"""


def _soft_limit(soft: str, stiffness: str, damping: str) -> Iterator[str]:
    yield _literal(f"knowrob:{soft}", "false", "boolean")
    yield _literal(f"knowrob:{stiffness}", "0.0")
    yield _literal(f"knowrob:{damping}", "0.0")


def _mesh_path(cls: str) -> str:
    return f"package://mindstage_homes/{cls}/{cls}.dae"


def _mask(name: str) -> str:
    return f"{sha256(name.encode()).hexdigest()[:6].upper()}FF"


def _draw(text: str, count: int) -> int:
    """A number below a count that depends on a text only."""
    return int.from_bytes(sha256(text.encode()).digest()[:4], "big") % count


def _number(value: float) -> str:
    return repr(round(value, 6) + 0.0)


def _row(values: Iterable[float]) -> str:
    return " ".join(f"{round(float(value), 6) + 0.0:.6f}" for value in values)


def _rounded(values: Iterable[float], digits: int) -> list[float]:
    return [round(float(value), digits) + 0.0 for value in values]


def _size_of(body: Body) -> Vector:
    if body.size is None:
        raise InvalidArgumentError("home", cause=f"{body.id!r} has no size", remedy="pass a generated home")
    return body.size


def _product(one: Quaternion, other: Quaternion) -> Quaternion:
    w, x, y, z = map(float, quat_multiply(one, other))
    return w, x, y, z


def _relative(position: Vector, origin: Vector, quaternion: Quaternion) -> Vector:
    """A position in the frame at an origin."""
    w, x, y, z = quaternion
    offset = (position[0] - origin[0], position[1] - origin[1], position[2] - origin[2])
    return _moved((0.0, 0.0, 0.0), (w, -x, -y, -z), offset)


def _moved(position: Vector, quaternion: Quaternion, offset: Vector) -> Vector:
    x, y, z = (at + float(by) for at, by in zip(position, quat_rotate(quaternion, offset), strict=True))
    return x, y, z
