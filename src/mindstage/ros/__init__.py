"""ROS: the face of a stage for a robot's programs, over the bridge."""

from mindstage.msgs import RosVersion
from mindstage.ros.broadcast import PublishRates
from mindstage.ros.face import RosInterface

__all__ = ["PublishRates", "RosInterface", "RosVersion"]
