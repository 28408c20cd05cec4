"""Rooms of plain boxes with the bundled robot in them, for tests of motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np

from mindstage.engines.base import Contact, Engine
from mindstage.engines.mujoco.engine import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.robots import add_robot
from mindstage.robots.models.robot_model import RobotModel
from mindstage.robots.robot import Robot
from mindstage.robots.robot_kinematics import RobotKinematics
from mindstage.scene import Body, BodyId, BodyPhysics, Iri, Mobility, Pose, Vector, World
from mindstage.simulation.simulation import Simulation

__all__ = ["box", "contacts_with", "joint_array", "reaching", "robot_in"]

FLOOR = (6.0, 6.0)


def box(
    name: str,
    position: Vector,
    size: Vector,
    mobility: Mobility = Mobility.STATIC,
    mass: float = 1.0,
    *,
    floats: bool = False,
) -> Body:
    """A box of no class."""
    return Body(
        id=BodyId(name),
        iri=Iri(f"http://example.org/room#{name}"),
        cls=Iri("http://example.org/room#Block"),
        pose=Pose(position),
        size=size,
        physics=BodyPhysics(mobility=mobility, mass_kg=mass, gravity=not floats),
    )


@contextmanager
def robot_in(
    *bodies: Body,
    at: Vector = (0.0, 0.0, 0.0),
    robot: str | RobotModel = "mobile_manipulator",
    floor: tuple[float, float] = FLOOR,
    engine: Engine | None = None,
) -> Iterator[Robot]:
    """A simulation of a floor around the origin, some bodies and a robot."""
    ground = box("floor", (0.0, 0.0, -0.05), (*floor, 0.1))
    world = World(iri=Iri("http://example.org/room#map"), name="room", bodies=(ground, *bodies))
    with Simulation(KnowledgeBase(), engine or MujocoEngine(), primitive_shapes=True, threaded=False) as simulation:
        report = simulation.spawn(world)
        assert report.ok, report
        yield add_robot(simulation, robot, Pose(at))


def contacts_with(robot: Robot, ids: set[str]) -> list[Contact]:
    """The present contacts of a robot with some bodies."""
    own = set(robot.link_ids.values())
    contacts = robot.session.engine.run(lambda engine: engine.contacts())
    return [each for each in contacts if (each.a in own and each.b in ids) or (each.b in own and each.a in ids)]


def reaching(robot: Robot, x: float, y: float, z: float) -> dict[str, float]:
    """Positions of the arm with the hand at a point of the world frame, horizontal, in the direction of the x axis."""
    found = RobotKinematics(robot.model).solve_ik(
        "gripper", Pose((x, y, z)), seed=robot.joint_positions(), root_pose=robot.link_pose(robot.model.root)
    )
    assert found, found.reason
    return dict(found.positions)


def joint_array(robot: Robot, positions: Mapping[str, float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Positions of the first arm's joints as an array."""
    return np.array([positions[name] for name in robot.model.arms[0].joints])
