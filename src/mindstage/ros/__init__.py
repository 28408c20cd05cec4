"""ROS: the face of a stage for a robot's programs, over the bridge."""

__all__: list[str] = []
