"""Adding robots to simulations.

robot = add_robot(sim, "mobile_manipulator", (0.6, 0.6, 0.0))
robot.do("open fridge_door")
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from itertools import count
from os import PathLike
from pathlib import Path

from mindstage.errors import RobotModelError
from mindstage.robots.controller import RobotController
from mindstage.robots.drives import drives_of
from mindstage.robots.model import RobotModel
from mindstage.robots.models.reading import load_model
from mindstage.robots.robot import Robot, RobotSession, contact_free_pairs
from mindstage.robots.skills.declaration import SkillResult, SkillStep
from mindstage.robots.world import robot_world
from mindstage.scene import IDENTITY, PoseLike

__all__ = ["add_robot"]


def add_robot(
    session: RobotSession,
    source: str | PathLike[str] | RobotModel,
    pose: PoseLike = IDENTITY,
    *,
    name: str = "",
    xacro: bool | None = None,
) -> Robot:
    """Spawns a robot with its drives: `add_robot(sim, "mobile_manipulator")`.

    Args:
        session: the simulation.
        source: the name of a known model, the path of a description (URDF, xacro, MJCF), or a model.
        pose: where it stands on the floor, in the world frame; three numbers are x, y and z, without a rotation.
        name: its name; by default that of the model, numbered if there are several.
        xacro: whether the description is expanded if it contains xacro; by default if its name ends in `.xacro`.
            Give False for a source that the user has not chosen.

    Raises:
        RobotNotFoundError: no model has that name.
        RobotModelError: the description cannot be read, or not all of it can be spawned.
    """
    model = (
        source
        if isinstance(source, RobotModel)
        else load_model(Path(source) if isinstance(source, PathLike) else source, xacro=xacro)
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
    pairs = contact_free_pairs(model, placed)
    existing = set(session.state.ids)
    report = session.spawn(placed.world, geometry=placed.geometry, excluded_pairs=pairs)
    if not report.ok:
        failures = (*report.failed_bodies, *report.failed_joints, *report.failed_attachments)
        spawned = {body.id for body in placed.world.bodies} & set(session.state.ids) - existing
        session.run_on_engine(lambda engine: engine.delete(spawned), label="delete", edits=True)
        first = failures[0]
        raise RobotModelError(
            model.source or model.name,
            cause=f"{first.id!r} cannot be spawned: {first.reason}",
            remedy="correct the description",
        )
    controller = RobotController(drives_of(model, placed, name=name))
    robot = Robot(name, model, placed, session=session, controller=controller, report=report, start_skill=_start_skill)
    session.keep_robot(robot)
    return robot


def _start_skill(
    robot: Robot,
    name: str,
    args: Mapping[str, object],
    *,
    deadline_s: float,
    seed: int,
    on_step: Callable[[SkillStep], object] | None,
) -> Generator[float, None, SkillResult]:
    """See `start_skill`, whose module takes a second to import: when the first skill is performed."""
    from mindstage.robots.skills.performance import start_skill

    return start_skill(robot, name, args, deadline_s=deadline_s, seed=seed, on_step=on_step)
