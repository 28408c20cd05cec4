"""ROS 2 as a transport: the node's process, the installation that it runs in, and message packages built for it."""

from mindstage.ros2.environment import Ros2Environment, find_environment
from mindstage.ros2.message_packages import build_message_packages

__all__ = ["Ros2Environment", "build_message_packages", "find_environment"]

__dir__ = __all__.copy
