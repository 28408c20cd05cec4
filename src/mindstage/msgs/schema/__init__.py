"""What every ROS message, service and action type has: base classes, primitive types, and the JSON codec."""

__all__: list[str] = []
