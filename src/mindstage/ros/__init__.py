"""ROS: the face of a stage for a robot's programs, over the bridge."""

from mindstage.msgs import RosVersion
from mindstage.ros.broadcast import Rates
from mindstage.ros.face import RosFace

__all__ = ["Rates", "RosFace", "RosVersion"]
