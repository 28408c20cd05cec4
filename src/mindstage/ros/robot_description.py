"""`robot_description`: the bodies of a simulation, of a spawned robot without drives, or a robot's own, as URDF.

Links and their frames are those of tf; the links of joints have no geometry. A joint with one degree of freedom is
`prismatic`, `revolute` or `continuous`, with the name and the positions of `joint_states`; one with several, and a
loose body, is `floating`. Links have the collision shapes of the bodies, in their colors; the hull of points and an
ellipsoid is its bounding box. URDF requires limits of effort and velocity, which are 1000, since a map has none.
"""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Iterable, Iterator, Mapping
from math import atan2, hypot
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from mindstage.bridge import Node
from mindstage.errors import MindstageError
from mindstage.msgs import RosVersion, std_msgs
from mindstage.rdf.vocabulary import URDF_TEXT
from mindstage.robots import robots_of
from mindstage.robots.models.robot_model import RobotJoint, RobotModel
from mindstage.ros.diagnostics import Publisher
from mindstage.ros.frames import ROOT_FRAME, FrameTransforms, JointFrame
from mindstage.ros.rosapi import ParameterServer
from mindstage.ros.state import StateReader
from mindstage.scene import (
    AxisMotion,
    Body,
    BodyGeometry,
    CollisionShape,
    CollisionShapeType,
    Color,
    GeometryMap,
    Pose,
    PrimitiveType,
    Vector,
    World,
)
from mindstage.scene.joint_kinematics import axis_ranges
from mindstage.scene.transforms import Array, pose_from_array
from mindstage.simulation import Simulation
from mindstage.simulation.observation import as_client

if TYPE_CHECKING:  # it is loaded with the first robot
    from mindstage.robots.robot import Robot

__all__ = [
    "DescriptionPublisher",
    "description_of",
    "entity_description",
    "place_description",
    "robot_description",
    "robot_entities",
]

_DEFAULT_SIZE_M: Vector = (0.05, 0.05, 0.05)
_DEFAULT_COLOR: Color = (0.7, 0.7, 0.7)
_UNBOUNDED = 1000.0
"""Limit of efforts [N or Nm], velocities [m/s or rad/s] and free translations [m]."""
_ROUND_TOLERANCE = 0.01
"""Relative difference up to which two extents are equal."""
_LEVEL_EPSILON = 1e-9
"""Cosine of the pitch below which roll and yaw are about the same axis."""
_INTERVAL_S = 1.0
"""Interval at which changes are published [s]."""
_JOIN_WAIT_S = 10.0
_log = logging.getLogger("mindstage.ros")
_TOPIC = "robot_description"
_PRIMITIVES = {
    PrimitiveType.SPHERE: CollisionShapeType.SPHERE,
    PrimitiveType.CYLINDER: CollisionShapeType.CYLINDER,
}


def place_description(state_reader: StateReader) -> str:
    """Returns the URDF of all bodies but those of robots, with the root link `map`."""
    worlds = state_reader.simulation.worlds
    return _Writer(state_reader).write(worlds[0].name or "place" if worlds else "place", None)


def robot_description(robot: Robot) -> str:
    """Returns the URDF of a robot: its own, or one that is made if it was described otherwise."""
    return robot.model.urdf or description_of(robot.model)


def description_of(model: RobotModel) -> str:
    """Returns a URDF of a model, with its collision shapes."""
    robot = ElementTree.Element("robot", name=model.name)
    for link in model.links:
        element = ElementTree.SubElement(robot, "link", name=link.name)
        if link.inertia is not None:
            inertial = ElementTree.SubElement(element, "inertial")
            _add_origin(inertial, Pose(link.inertia.center))
            ElementTree.SubElement(inertial, "mass", value=_number(link.inertia.mass_kg))
            names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
            moments = {name: _number(value) for name, value in zip(names, link.inertia.tensor, strict=True)}
            ElementTree.SubElement(inertial, "inertia", moments)
        for tag in ("visual", "collision"):
            for shape in () if link.geometry is None else link.geometry.collision_shapes:
                part = ElementTree.SubElement(element, tag)
                _add_origin(part, shape.pose)
                _add_geometry(part, shape)
    for joint in model.joints:
        element = ElementTree.SubElement(robot, "joint", name=joint.name, type=joint.type.value)
        _add_origin(element, joint.origin)
        ElementTree.SubElement(element, "parent", link=joint.parent)
        ElementTree.SubElement(element, "child", link=joint.child)
        if joint.is_movable:
            _add_model_motion(element, joint)
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode")


def entity_description(state_reader: StateReader, entity: World) -> str:
    """Returns the URDF of the bodies of a spawned robot, with its root body as the root link."""
    return _Writer(state_reader).write(entity.bodies[0].id, {body.id for body in entity.bodies})


def robot_entities(simulation: Simulation) -> dict[str, World]:
    """Returns the robots without drives that were spawned after the start and exist, by the id of their root body."""
    start, present = simulation.start_ids, frozenset(simulation.state.ids)
    driven = frozenset(id for robot in robots_of(simulation).values() for id in robot.link_ids.values())
    return {
        world.bodies[0].id: world
        for world in simulation.worlds
        if _is_urdf(world)
        and world.bodies[0].id not in start | driven
        and all(body.id in present for body in world.bodies)
    }


def _is_urdf(world: World) -> bool:
    """Whether a world was read from a URDF."""
    return any(fact.property == URDF_TEXT for body in world.bodies for fact in body.facts)


class DescriptionPublisher:
    """Publishes `robot_description` of the place and of each spawned robot, latched, and sets the parameters.

    The topic of the place is in the namespace, that of a robot is `/ENTITY/robot_description`. A description is created
    while its topic has a subscriber, or when its parameter is read.
    """

    def __init__(
        self, node: Node, state_reader: StateReader, parameters: ParameterServer, *, namespace: str, ros: RosVersion
    ) -> None:
        self._node = node
        self._state_reader = state_reader
        self._parameters = parameters
        self._ros = ros
        self._place = "/".join(("", *filter(None, namespace.split("/"))))
        self._entities: dict[str, World] = {}
        self._publishers: dict[str, Publisher[std_msgs.String]] = {}
        self._published: dict[str, tuple[object, str]] = {}
        """Version of the world of the last description of each topic, and its text."""
        self._version: object = None
        self._add(self._place)
        self._parameters.set_computed(f"/{_TOPIC}", self._default_description)
        self._closing = threading.Event()
        # A thread of its own, since a large description would delay the other topics.
        self._thread = threading.Thread(target=self._run, name="mindstage-ros-descriptions", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._closing.wait(_INTERVAL_S):
            try:
                with as_client("ROS"):
                    self._publish_changes()
            except MindstageError as error:
                _log.debug("robot_description was not published: %s", error)  # the health has the error
            except Exception:
                _log.exception("robot_description could not be published")

    def _publish_changes(self) -> None:
        self._state_reader.state()  # raises the error of an engine that has failed
        version = self._state_reader.version()
        if version != self._version:
            self._update_entities()
            self._version = version
        for topic, publisher in self._publishers.items():
            before, text = self._published.get(topic, (None, ""))
            if before != version and publisher.has_subscribers:
                description = self._describe(topic)
                self._published[topic] = version, description
                if description != text:
                    publisher.publish(std_msgs.String(data=description))

    def close(self) -> None:
        """Ends the publication; calling it again is harmless."""
        self._closing.set()
        self._thread.join(_JOIN_WAIT_S)
        for topic in list(self._publishers):
            self._remove(topic)

    def _update_entities(self) -> None:
        found = {_entity_topic(id): world for id, world in robot_entities(self._state_reader.simulation).items()}
        found.pop(self._place, None)
        for topic in self._entities.keys() - found.keys():
            self._remove(topic)
        for topic in found.keys() - self._entities.keys():
            self._add(topic)
        self._entities = found

    def _default_description(self) -> str:
        """Returns the description of the robot without a namespace, or that of the place if there is none."""
        robots = robots_of(self._state_reader.simulation)
        for name, namespace in self._state_reader.robot_namespaces().items():
            if not namespace and name in robots:
                return robot_description(robots[name])
        return place_description(self._state_reader)

    def _add(self, topic: str) -> None:
        name = f"{topic}/{_TOPIC}"
        self._publishers[topic] = Publisher(self._node, name, std_msgs.String, ros=self._ros, latch=True)
        self._parameters.set_computed(name, lambda: self._describe(topic))

    def _remove(self, topic: str) -> None:
        self._publishers.pop(topic).close()
        self._published.pop(topic, None)
        self._parameters.delete(f"{topic}/{_TOPIC}")

    def _describe(self, topic: str) -> str:
        entity = self._entities.get(topic)
        return (
            place_description(self._state_reader) if entity is None else entity_description(self._state_reader, entity)
        )


def _entity_topic(id: str) -> str:
    """Returns the namespace of the topics of an entity: its id, in the characters of names in ROS."""
    parts = (re.sub(r"[^A-Za-z0-9_]", "_", part) for part in id.split("/") if part)
    return "".join(f"/{part if part[0].isalpha() else f'entity_{part}'}" for part in parts)


class _Writer:
    def __init__(self, state_reader: StateReader) -> None:
        state = state_reader.state()
        tree = state_reader.frame_tree()
        self._bodies: dict[str, Body] = {}
        world = state_reader.world()
        for body, frame in zip(
            world.bodies, state_reader.frame_names.assign(body.id for body in world.bodies), strict=True
        ):
            self._bodies[frame] = body
        robots = robots_of(state_reader.simulation).values()
        parts = {body.id for robot in robots for body in robot.placed.world.bodies}
        self._of_robots = {frame for frame, body in self._bodies.items() if body.id in parts}
        self._geometry: GeometryMap = state_reader.simulation.geometry
        self._joints: Mapping[str, JointFrame] = tree.joints
        moving, static = tree.transforms(state.ids, state.poses)
        self._edges = [*_edges(static), *_edges(moving)]

    def write(self, name: str, ids: set[str] | None) -> str:
        """Returns the URDF of some bodies and the joints between them, or of all."""
        frames = {frame for frame, body in self._bodies.items() if ids is None or body.id in ids}
        frames -= self._of_robots
        if ids is None:
            frames.add(ROOT_FRAME)
        frames |= {
            frame for frame, each in self._joints.items() if ids is None or (each.moving in ids and each.fixed in ids)
        }
        robot = ElementTree.Element("robot", name=name)
        used: set[str] = {each.joint.id for frame, each in self._joints.items() if frame in frames}
        for frame in [ROOT_FRAME] * (ids is None) + [child for _, child, _ in self._edges if child in frames]:
            self._add_link(robot, frame)
        for parent, child, pose in self._edges:
            if child in frames and parent in frames:
                self._add_joint(robot, parent, child, pose, used)
        ElementTree.indent(robot)
        return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode")

    def _add_link(self, robot: ElementTree.Element, frame: str) -> None:
        link = ElementTree.SubElement(robot, "link", name=frame)
        body = self._bodies.get(frame)
        if body is None:
            return
        geometry = self._geometry.get(body.id)
        color = _color(body, geometry)
        shapes = list(_shapes(body, geometry))
        if body.physics.mass_kg:
            _add_inertial(link, body.physics.mass_kg, body.size or _DEFAULT_SIZE_M)
        for tag in ("visual", "collision"):
            for shape in shapes:
                part = ElementTree.SubElement(link, tag)
                _add_origin(part, shape.pose)
                _add_geometry(part, shape)
                if tag == "visual":
                    material = ElementTree.SubElement(part, "material", name=f"{frame}/color")
                    ElementTree.SubElement(material, "color", rgba=_numbers((*color, 1.0)))

    def _add_joint(self, robot: ElementTree.Element, parent: str, child: str, pose: Array, used: set[str]) -> None:
        each = self._joints.get(child)
        type, axis, limit = ("fixed", None, None) if each is None else _motion(each)
        body = self._bodies.get(child)
        if body is not None and parent == ROOT_FRAME and body.physics.is_dynamic:
            type = "floating"
        name = each.joint.id if each is not None else _unused(f"{child}_{type}", used)
        joint = ElementTree.SubElement(robot, "joint", name=name, type=type)
        _add_origin(joint, pose_from_array(pose if each is None else each.fixed_from_joint))
        ElementTree.SubElement(joint, "parent", link=parent)
        ElementTree.SubElement(joint, "child", link=child)
        if axis is not None:
            ElementTree.SubElement(joint, "axis", xyz=_numbers(axis))
        if limit is not None:
            ends = {"lower": _number(limit[0]), "upper": _number(limit[1])}
            ElementTree.SubElement(joint, "limit", ends, effort=_number(_UNBOUNDED), velocity=_number(_UNBOUNDED))


def _add_model_motion(element: ElementTree.Element, joint: RobotJoint) -> None:
    ElementTree.SubElement(element, "axis", xyz=_numbers(joint.axis))
    ends = {
        name: _number(value) for name, value in (("lower", joint.lower), ("upper", joint.upper)) if value is not None
    }
    velocity = _UNBOUNDED if joint.velocity is None else joint.velocity
    effort = _UNBOUNDED if joint.effort is None else joint.effort
    ElementTree.SubElement(element, "limit", ends, effort=_number(effort), velocity=_number(velocity))
    if joint.damping or joint.friction:
        ElementTree.SubElement(element, "dynamics", damping=_number(joint.damping), friction=_number(joint.friction))
    if joint.mimic is not None:
        mimic = ElementTree.SubElement(element, "mimic", joint=joint.mimic.joint)
        mimic.set("multiplier", _number(joint.mimic.multiplier))
        mimic.set("offset", _number(joint.mimic.offset))


def _edges(transforms: FrameTransforms) -> Iterator[tuple[str, str, Array]]:
    yield from zip(transforms.parents, transforms.children, transforms.poses, strict=True)


def _motion(each: JointFrame) -> tuple[str, Vector | None, tuple[float, float] | None]:
    """Returns the type, the axis and the limits of a joint."""
    free = [axis for axis, (motion, _, _) in enumerate(axis_ranges(each.joint)) if motion is not AxisMotion.LOCKED]
    if len(free) != 1:
        return "floating", None, None
    motion, limit, middle = axis_ranges(each.joint)[free[0]]
    # Positions are those of the child relative to the parent of the map, which may be the body that moves.
    sign = 1.0 if each.moving == each.joint.child else -1.0
    direction = [0.0, 0.0, 0.0]
    direction[free[0] % 3] = sign
    axis = (direction[0], direction[1], direction[2])
    is_limited = motion is AxisMotion.LIMITED
    if free[0] < 3:
        return "prismatic", axis, (middle - limit, middle + limit) if is_limited else (-_UNBOUNDED, _UNBOUNDED)
    return ("revolute", axis, (middle - limit, middle + limit)) if is_limited else ("continuous", axis, None)


def _shapes(body: Body, geometry: BodyGeometry | None) -> Iterable[CollisionShape]:
    if geometry is not None and geometry.collision_shapes:
        return geometry.collision_shapes
    size = body.size or _DEFAULT_SIZE_M
    if not all(size):
        return ()
    type = _PRIMITIVES.get(body.shape.type, CollisionShapeType.BOX) if body.shape else CollisionShapeType.BOX
    return (CollisionShape(type=type, size=size),)


def _color(body: Body, geometry: BodyGeometry | None) -> Color:
    if body.color is not None or geometry is None or not geometry.visuals:
        return body.color or _DEFAULT_COLOR
    return geometry.visuals[0].material.color


def _add_inertial(link: ElementTree.Element, mass_kg: float, size: Vector) -> None:
    """Adds the inertia of a homogeneous box."""
    x, y, z = (extent**2 for extent in size)
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "mass", value=_number(mass_kg))
    moments = {"ixx": y + z, "iyy": x + z, "izz": x + y}
    values = {key: _number(mass_kg * value / 12) for key, value in moments.items()}
    ElementTree.SubElement(inertial, "inertia", {**values, "ixy": "0", "ixz": "0", "iyz": "0"})


def _add_geometry(part: ElementTree.Element, shape: CollisionShape) -> None:
    geometry = ElementTree.SubElement(part, "geometry")
    x, y, z = shape.size
    is_round = abs(x - y) <= _ROUND_TOLERANCE * max(x, y)
    if shape.type is CollisionShapeType.SPHERE and is_round and abs(x - z) <= _ROUND_TOLERANCE * max(x, z):
        ElementTree.SubElement(geometry, "sphere", radius=_number(x / 2))
    elif shape.type is CollisionShapeType.CYLINDER and is_round:
        ElementTree.SubElement(geometry, "cylinder", radius=_number(x / 2), length=_number(z))
    else:
        ElementTree.SubElement(geometry, "box", size=_numbers(shape.size))


def _add_origin(element: ElementTree.Element, pose: Pose) -> None:
    ElementTree.SubElement(
        element, "origin", xyz=_numbers(pose.position), rpy=_numbers(_roll_pitch_yaw(pose.quaternion))
    )


def _roll_pitch_yaw(quaternion: tuple[float, float, float, float]) -> tuple[float, float, float]:
    """Returns the rotations about the fixed axes x, y and z, in this order, of a unit quaternion [rad]."""
    w, x, y, z = quaternion
    forward_x, forward_y = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)
    level = hypot(forward_x, forward_y)
    pitch = atan2(2.0 * (w * y - x * z), level)
    if level > _LEVEL_EPSILON:
        roll = atan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
        return roll, pitch, atan2(forward_y, forward_x)
    # Gimbal lock: any combination of roll and yaw.
    return atan2(-2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + z * z)), pitch, 0.0


def _numbers(values: Iterable[float]) -> str:
    return " ".join(map(_number, values))


def _number(value: float) -> str:
    return repr(float(value) + 0.0)  # without a negative zero


def _unused(name: str, used: set[str]) -> str:
    while name in used:
        name += "_"
    used.add(name)
    return name
