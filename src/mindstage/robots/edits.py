"""Edits that add and remove robots: everything about them as data, so that they can be made elsewhere, too."""

from __future__ import annotations

from collections.abc import Collection, Generator, Mapping
from itertools import count
from os import PathLike
from pathlib import Path
from typing import Any, cast

import msgspec
from msgspec.structs import replace

from mindstage.engines.base import Actuator, Capability, Engine
from mindstage.engines.edits import RestoreBodies, SetActuators
from mindstage.errors import RobotModelError, SpawnRefusedError
from mindstage.maps.urdf.xacro_process import XacroRequest
from mindstage.robots.controller import RobotController
from mindstage.robots.drives import drives_of
from mindstage.robots.models.reading import load_model
from mindstage.robots.models.robot_model import RobotLink, RobotModel
from mindstage.robots.robot import Robot, contact_free_pairs
from mindstage.robots.skill_declaration import SkillResult
from mindstage.robots.world import RobotWorld, robot_world
from mindstage.scene import IDENTITY, BodyGeometry, BodyId, PoseLike, World
from mindstage.scene.edits import Delete, Edit, GeometryEdit, Spawn
from mindstage.scene.geometry import Inertia
from mindstage.simulation.replacing import edit_timeout_s
from mindstage.simulation.simulation import Simulation
from mindstage.simulation.state import SessionEdit

__all__ = ["AddRobot", "RemoveRobot", "RobotDescription", "add_robot"]

CONTROLLERS = {"robot": RobotController}
"""The controllers of robots by name; each is made from the drives of the robot, and parameters."""


class _Link(msgspec.Struct, frozen=True, kw_only=True):
    """A link of a model in JSON."""

    name: str
    inertia: Inertia | None = None
    geometry: str = ""
    """The digest of its geometry; empty if it has none."""


_OTHERS = [each for each in msgspec.structs.fields(RobotModel) if each.name != "links"]
_ModelData = msgspec.defstruct("_ModelData", [(each.name, each.type) for each in _OTHERS], kw_only=True)
"""A model in JSON without its links: msgspec cannot read their meshes."""


class RobotDescription:
    """The model of a robot in an edit; as JSON, of the geometry of its links the digests."""

    __slots__ = ("model",)

    def __init__(self, model: RobotModel) -> None:
        self.model = model

    def to_edit_json(self) -> dict[str, Any]:
        """The model as plain data; see `scene.edits`."""
        links = [
            _Link(name=each.name, inertia=each.inertia, geometry=each.geometry.key if each.geometry else "")
            for each in self.model.links
        ]
        return {
            "model": msgspec.to_builtins(
                {each.name: getattr(self.model, each.name) for each in _OTHERS}, order="deterministic"
            ),
            "links": msgspec.to_builtins(links),
        }

    @classmethod
    def from_edit_json(cls, value: Any, stored: Mapping[str, BodyGeometry]) -> RobotDescription:
        """The description of plain data; a link whose geometry is not stored has none."""
        data = msgspec.convert(value["model"], _ModelData)
        links = (
            RobotLink(name=each.name, inertia=each.inertia, geometry=stored.get(each.geometry))
            for each in msgspec.convert(value["links"], list[_Link])
        )
        return cls(RobotModel(links=tuple(links), **msgspec.structs.asdict(data)))


class AddRobot(GeometryEdit, SessionEdit, frozen=True, kw_only=True):
    """Spawns a robot with its drives, and adds what commands them.

    Raises `SpawnRefusedError` if a part of it cannot be spawned; nothing is added then.
    """

    name: str
    world: World
    """Its bodies, joints and attachments."""
    excluded_pairs: frozenset[tuple[BodyId, BodyId]] = frozenset()
    """The pairs of its bodies that do not collide with each other."""
    actuators: tuple[Actuator, ...] = ()
    without_weight: tuple[BodyId, ...] = ()
    """The bodies whose weight the drives compensate."""
    controller: str = "robot"
    """The name of what commands the actuators."""
    parameters: Mapping[str, Any] = {}
    """Its parameters, as JSON values."""
    description: RobotDescription
    link_ids: Mapping[str, BodyId]
    """The body of each link."""
    joint_ids: Mapping[str, BodyId]
    base_joint_id: BodyId | None = None
    """The planar joint of a base that drives."""
    zero: Mapping[str, float] = {}
    """The position of each movable joint when spawned [m or rad]."""
    restored: RestoreBodies | None = None
    """The bodies as they were when the robot was removed; None to spawn them."""

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """See `Edit`."""
        return tuple(body.id for body in self.world.bodies)

    @property
    def label(self) -> str:
        """See `Edit`."""
        return self.title or f"robot {self.name} added"

    def geometries(self) -> tuple[BodyGeometry, ...]:
        """See `Edit`."""
        links = (each.geometry for each in self.description.model.links if each.geometry is not None)
        return tuple(dict.fromkeys((*self.geometry.values(), *links)))

    def parts(self) -> tuple[Edit, ...]:
        """See `Edit`."""
        if self.restored is not None:
            return (self.restored,)
        spawn = Spawn(self.world, geometry=self.geometry, excluded_pairs=self.excluded_pairs, ground=True, whole=True)
        return (spawn, SetActuators(self.actuators, self.without_weight)) if self.actuators else (spawn,)

    def inverse_of_parts(self, inverses: tuple[Edit, ...]) -> Edit:
        """See `Edit`."""
        return RemoveRobot(robot=replace(self, restored=None), bodies=self.ids)

    def complete(self, session: Any, engine: Engine) -> None:
        """See `SessionEdit`."""
        former = session.robots.former(self.name)
        is_same = isinstance(former, Robot) and former.placed.world is self.world
        session.robots.keep(former if is_same else self._robot(session))

    def removal(self, present: Collection[BodyId]) -> RemoveRobot:
        """The edit that removes the robot.

        Args:
            present: the bodies of the simulation.
        """
        existing = set(present)
        return RemoveRobot(robot=self, bodies=tuple(id for id in self.ids if id in existing))

    def _robot(self, session: Simulation) -> Robot:
        placed = RobotWorld(
            world=self.world,
            geometry=self.geometry,
            link_ids=self.link_ids,
            joint_ids=self.joint_ids,
            base_joint_id=self.base_joint_id,
            zero=self.zero,
        )
        model = self.description.model
        controller = CONTROLLERS[self.controller](drives_of(model, placed, name=self.name), **self.parameters)
        report = session.reports[-1]
        return Robot(
            self.name,
            model,
            placed,
            edit=self,
            session=session,
            controller=controller,
            report=report,
            start_skill=_start_skill,
        )


class RemoveRobot(SessionEdit, frozen=True, kw_only=True):
    """Deletes the bodies of a robot, and removes what commands it."""

    robot: AddRobot
    bodies: tuple[BodyId, ...]
    """Those of its bodies that exist."""

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """See `Edit`."""
        return self.bodies

    @property
    def label(self) -> str:
        """See `Edit`."""
        return self.title or f"robot {self.robot.name} removed"

    def geometries(self) -> tuple[BodyGeometry, ...]:
        """See `Edit`."""
        return self.robot.geometries()

    def parts(self) -> tuple[Edit, ...]:
        """See `Edit`."""
        return (Delete(self.bodies),)

    def inverse_of_parts(self, inverses: tuple[Edit, ...]) -> Edit:
        """See `Edit`."""
        (restored,) = inverses
        assert isinstance(restored, RestoreBodies)
        return replace(self.robot, restored=restored)

    def complete(self, session: Any, engine: Engine) -> None:
        """See `SessionEdit`."""
        session.robots.drop(self.robot.name)


def add_robot(
    session: Simulation,
    source: str | PathLike[str] | RobotModel,
    pose: PoseLike = IDENTITY,
    *,
    name: str = "",
    xacro: XacroRequest = None,
) -> Robot:
    """Spawns a robot with its drives: `add_robot(sim, "mobile_manipulator")`.

    Args:
        source: the name of a known model, the path of a description (URDF, xacro, MJCF), or a model.
        pose: where it stands on the floor, in the world frame; three numbers are x, y and z, without a rotation.
        name: its name; by default that of the model, numbered if there are several.
        xacro: whether the description is expanded if it contains xacro; by default if its name ends in `.xacro`.
            A mapping gives the values of its arguments (`xacro:arg`). Give False for a source that the user has not
            chosen.

    Raises:
        RobotNotFoundError: no model has that name.
        RobotModelError: the description cannot be read, or not all of it can be spawned.
    """
    model = (
        source
        if isinstance(source, RobotModel)
        else load_model(Path(source) if isinstance(source, PathLike) else source, xacro=xacro, divide=True)
    )
    taken = set(session.robots)
    if not name:
        numbers = (model.name if number == 1 else f"{model.name}_{number}" for number in count(1))
        prefixes = {id.partition(".")[0] for id in session.state.ids if "." in id}
        name = next(each for each in numbers if each not in taken | prefixes)
    elif name in taken:
        raise RobotModelError(model.source or model.name, cause=f"a robot {name!r} exists", remedy="give another name")
    world_ids = {joint.id for world in session.worlds for joint in world.joints}
    placed = robot_world(model, pose, name=name, taken={*session.state.ids, *world_ids})
    drives = drives_of(model, placed, name=name)
    has_drives = Capability.ACTUATORS in session.engine.capabilities
    edit = AddRobot(
        name=name,
        world=placed.world,
        geometry=placed.geometry,
        excluded_pairs=contact_free_pairs(model, placed),
        actuators=drives.records if has_drives else (),
        without_weight=tuple(drives.link_of_body) if has_drives else (),
        description=RobotDescription(model),
        link_ids=placed.link_ids,
        joint_ids=placed.joint_ids,
        base_joint_id=placed.base_joint_id,
        zero=placed.zero,
    )
    try:
        session.edits.apply(edit, timeout_s=edit_timeout_s(edit, 3 * session.timeout_s))
    except SpawnRefusedError as error:
        raise RobotModelError(
            model.source or model.name,
            cause=f"{error.id!r} cannot be spawned: {error.reason}",
            remedy="correct the description",
        ) from error
    return cast("Robot", session.robots[name])


def _start_skill(*args: Any, **options: Any) -> Generator[float, None, SkillResult]:
    """See `start_skill`, whose module takes a second to import: when the first skill is performed."""
    from mindstage.robots.skill_performance import start_skill

    return start_skill(*args, **options)
