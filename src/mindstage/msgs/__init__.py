"""Messages: every ROS type that is spoken here, as a frozen struct, and the way to its JSON object and back.

A ROS package is a module: `geometry_msgs.Pose`, `world_control_msgs.SpawnModel.Request`. `decode` and `encode` go
between a message and JSON, `message_type` and its siblings find a type by its name on the wire.
"""

from mindstage.msgs import (
    actionlib_msgs,
    builtin_interfaces,
    diagnostic_msgs,
    geometry_msgs,
    mindstage_msgs,
    modul_spawner_msgs,
    rosapi,
    rosgraph_msgs,
    sensor_msgs,
    simulation_interfaces,
    std_msgs,
    std_srvs,
    tf2_msgs,
    unreal_vis_msgs,
    visualization_msgs,
    world_control_msgs,
)
from mindstage.msgs.codec import decode, decode_arguments, encode
from mindstage.msgs.definitions import definition_text, type_definitions
from mindstage.msgs.message import Action, Message, Ros, Service
from mindstage.msgs.naming import engine_service, snake_case, type_name
from mindstage.msgs.registry import (
    ActionTypes,
    ServiceTypes,
    action_type,
    action_types,
    message_type,
    message_types,
    service_type,
    service_types,
)

__all__ = [
    "Action",
    "ActionTypes",
    "Message",
    "Ros",
    "Service",
    "ServiceTypes",
    "action_type",
    "action_types",
    "actionlib_msgs",
    "builtin_interfaces",
    "decode",
    "decode_arguments",
    "definition_text",
    "diagnostic_msgs",
    "encode",
    "engine_service",
    "geometry_msgs",
    "message_type",
    "message_types",
    "mindstage_msgs",
    "modul_spawner_msgs",
    "rosapi",
    "rosgraph_msgs",
    "sensor_msgs",
    "service_type",
    "service_types",
    "simulation_interfaces",
    "snake_case",
    "std_msgs",
    "std_srvs",
    "tf2_msgs",
    "type_definitions",
    "type_name",
    "unreal_vis_msgs",
    "visualization_msgs",
    "world_control_msgs",
]
