"""Simulation: the services of simulation_interfaces 2.1, ROS 2's standard for simulators."""

from mindstage.ros.simulation.entities import Entities
from mindstage.ros.simulation.running import Running
from mindstage.ros.simulation.spawning import Spawning
from mindstage.ros.simulation.worlds import Worlds

__all__ = ["Entities", "Running", "Spawning", "Worlds"]
