"""ROS: the face of a stage for a robot's programs, over the bridge."""

from mindstage.msgs import RosVersion
from mindstage.ros.interface import RosInterface
from mindstage.ros.publishers import PublishRates

__all__ = ["PublishRates", "RosInterface", "RosVersion"]
