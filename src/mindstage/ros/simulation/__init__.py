"""Simulation: the services of simulation_interfaces 2.1, ROS 2's standard for simulators."""

from mindstage.ros.simulation.entities import EntityServices
from mindstage.ros.simulation.running import SimulationControlServices
from mindstage.ros.simulation.spawning import SpawnServices
from mindstage.ros.simulation.worlds import WorldServices

__all__ = ["EntityServices", "SimulationControlServices", "SpawnServices", "WorldServices"]
