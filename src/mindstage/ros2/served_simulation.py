"""A simulation as a node of ROS 2: its reads, its parameters, and the node's end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from typing import Any

import msgspec

from mindstage.access.limits import SPEED
from mindstage.bridge import LocalNode
from mindstage.errors import MindstageError
from mindstage.ros import RosInterface
from mindstage.ros.publishers import PublishRates
from mindstage.ros2.ros2_node import Ros2Node, Ros2Parameter
from mindstage.simulation import Simulation, StateSnapshot

__all__ = ["ServedSimulation", "node_parameters", "serve_simulation"]


def node_parameters(simulation: Simulation, interface: RosInterface | None = None) -> tuple[Ros2Parameter, ...]:
    """Returns the parameters of the node of a simulation, with their values now.

    Args:
        interface: has the description of the place; None for none.
    """
    state = simulation.state

    def set_paused(value: bool) -> None:
        simulation.pause() if value else simulation.play(speed=simulation.state.speed or 1.0)

    def set_speed(value: float) -> None:
        was_playing = simulation.state.playing
        simulation.play(speed=float(value))
        if not was_playing:
            simulation.pause()

    rates = PublishRates()
    description = ""
    if interface is not None and interface.parameters.has("robot_description"):
        description = str(interface.parameters.get("robot_description"))
    return (
        Ros2Parameter(name="paused", value=not state.playing, description="Whether time stands still.", set=set_paused),
        Ros2Parameter(
            name="speed",
            value=float(state.speed or 1.0),
            description="Simulated time per real time while playing.",
            range=(SPEED.minimum, SPEED.maximum),
            set=set_speed,
        ),
        *(
            Ros2Parameter(name=f"rates.{name}", value=float(getattr(rates, name)), description="Rate of topics [Hz].")
            for name in msgspec.structs.asdict(rates)
        ),
        Ros2Parameter(name="stamped_cmd_vel", value=False, description="Whether cmd_vel is a TwistStamped."),
        Ros2Parameter(name="robot_description", value=description, description="The place as URDF."),
    )


class ServedSimulation:
    """A simulation with its node of ROS 2, until `close`."""

    def __init__(self, node: Ros2Node, resources: ExitStack) -> None:
        self.node = node
        self._resources = resources

    def close(self) -> None:
        """Ends the node; calling it again is harmless. The simulation continues."""
        self._resources.close()

    def __enter__(self) -> ServedSimulation:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def serve_simulation(
    simulation: Simulation,
    *,
    local_node: LocalNode | None = None,
    interface: RosInterface | None = None,
    namespace: str = "unreal",
    ros_args: Sequence[str] = (),
    **options: Any,
) -> ServedSimulation:
    """Makes a simulation a node of ROS 2.

    Args:
        local_node: the node that offers the simulation already, with its `interface`; None for a new one.
        namespace: namespace of the names of a new interface.
        ros_args: what may follow `--ros-args`.
        options: as of `Ros2Node`.

    Raises:
        Ros2Error: there is no ROS 2, or its process does not start.
    """
    with ExitStack() as resources:
        if local_node is None:
            local_node = resources.enter_context(LocalNode())
            interface = resources.enter_context(RosInterface(simulation, local_node, namespace=namespace))
        parameters = node_parameters(simulation, interface)
        node = resources.enter_context(Ros2Node(local_node, parameters=parameters, ros_args=ros_args, **options))
        resources.callback(simulation.on_state(_follower(node)))
        with suppress(MindstageError):
            node.write_poses(simulation.state.ids, simulation.state.poses)
        return ServedSimulation(node, resources.pop_all())


def _follower(node: Ros2Node) -> Callable[[StateSnapshot], None]:
    """Returns a function that tells the node of each state."""
    before: tuple[bool, float] | None = None

    def follow(state: StateSnapshot) -> None:
        nonlocal before
        node.write_poses(state.ids, state.poses)
        if before != (state.playing, state.speed):
            before = (state.playing, state.speed)
            node.set_parameter("paused", not state.playing)
            node.set_parameter("speed", float(state.speed or 1.0))

    return follow
