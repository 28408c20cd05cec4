"""The ROS interface of a simulation: services, topics and actions over rosbridge."""

from mindstage.msgs import RosVersion
from mindstage.ros.interface import RosInterface
from mindstage.ros.publishers import PublishRates

__all__ = ["PublishRates", "RosInterface", "RosVersion"]

__dir__ = __all__.copy
