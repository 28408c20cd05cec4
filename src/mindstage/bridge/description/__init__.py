"""Description: a world on the wire.

`spawn_request` and its siblings speak `world_control_msgs`, which Unreal understands and which holds less than a world;
`untranslatable_fields` says what stays behind. `world_to_json` and its siblings are exact, and mindstage_msgs carries what they write.
`geometry_to_json` and `model_delta_to_json` say what goes with a world to engines that take it.
Poses on the wire are those of the world: ROS's frame, meters.
"""

from mindstage.bridge.description.constraints import joint_from_message, joint_message
from mindstage.bridge.description.forms import geometry_from_json, geometry_to_json, mesh_name
from mindstage.bridge.description.geometry import (
    color_code,
    color_from_code,
    color_from_message,
    color_message,
    point_from_message,
    point_message,
    pose_array_from_messages,
    pose_array_messages,
    pose_from_message,
    pose_message,
    vector_from_message,
    vector_message,
)
from mindstage.bridge.description.maps import (
    attachment_from_message,
    relation_message,
    spawn_request,
    untranslatable_fields,
    world_from_request,
)
from mindstage.bridge.description.models import (
    body_from_box,
    body_from_message,
    materials_from_lists,
    model_message,
    physics_from_message,
    physics_message,
    spawn_model_request,
)
from mindstage.bridge.description.plans import BodyModelDelta, JointModelDelta, PhysicsModelDelta, model_delta_to_json
from mindstage.bridge.description.refusals import error_from_text, error_text, error_to_message, message_to_error
from mindstage.bridge.description.remarks import ConversionNote
from mindstage.bridge.description.worlds import from_json, to_json, world_from_json, world_to_json

__all__ = [
    "BodyModelDelta",
    "ConversionNote",
    "JointModelDelta",
    "PhysicsModelDelta",
    "attachment_from_message",
    "body_from_box",
    "body_from_message",
    "color_code",
    "color_from_code",
    "color_from_message",
    "color_message",
    "error_from_text",
    "error_text",
    "error_to_message",
    "from_json",
    "geometry_from_json",
    "geometry_to_json",
    "joint_from_message",
    "joint_message",
    "materials_from_lists",
    "mesh_name",
    "message_to_error",
    "model_delta_to_json",
    "model_message",
    "physics_from_message",
    "physics_message",
    "point_from_message",
    "point_message",
    "pose_array_from_messages",
    "pose_array_messages",
    "pose_from_message",
    "pose_message",
    "relation_message",
    "spawn_model_request",
    "spawn_request",
    "to_json",
    "untranslatable_fields",
    "vector_from_message",
    "vector_message",
    "world_from_json",
    "world_from_request",
    "world_to_json",
]
