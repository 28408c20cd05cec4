"""Description: a world on the wire.

`spawn_request` and its siblings speak `world_control_msgs`, which Unreal understands and which holds less than a world;
`unsaid` says what stays behind. `world_to_json` and its siblings are exact, and mindstage_msgs carries what they write.
`forms_to_json` and `plan_to_json` say what goes with a world to engines that take it.
Poses on the wire are those of the world: ROS's frame, metres.
"""

from mindstage.bridge.description.constraints import constraint_description, constraint_from
from mindstage.bridge.description.forms import forms_from_json, forms_to_json, mesh_name
from mindstage.bridge.description.geometry import (
    colour_code,
    colour_from,
    colour_from_code,
    colour_message,
    point_from,
    point_message,
    pose_from,
    pose_message,
    pose_messages,
    pose_rows,
    vector_from,
    vector_message,
)
from mindstage.bridge.description.maps import (
    attachment_from,
    relation_description,
    spawn_request,
    unsaid,
    world_from_request,
)
from mindstage.bridge.description.models import (
    body_from,
    body_from_box,
    materials_from,
    model_description,
    model_request,
    physics_from,
    physics_message,
)
from mindstage.bridge.description.plans import BodyChange, JointChange, PlanChange, plan_to_json
from mindstage.bridge.description.refusals import error_from_text, error_text, refusal, world_error
from mindstage.bridge.description.remarks import Remark
from mindstage.bridge.description.worlds import from_json, to_json, world_from_json, world_to_json

__all__ = [
    "BodyChange",
    "JointChange",
    "PlanChange",
    "Remark",
    "attachment_from",
    "body_from",
    "body_from_box",
    "colour_code",
    "colour_from",
    "colour_from_code",
    "colour_message",
    "constraint_description",
    "constraint_from",
    "error_from_text",
    "error_text",
    "forms_from_json",
    "forms_to_json",
    "from_json",
    "materials_from",
    "mesh_name",
    "model_description",
    "model_request",
    "physics_from",
    "physics_message",
    "plan_to_json",
    "point_from",
    "point_message",
    "pose_from",
    "pose_message",
    "pose_messages",
    "pose_rows",
    "refusal",
    "relation_description",
    "spawn_request",
    "to_json",
    "unsaid",
    "vector_from",
    "vector_message",
    "world_error",
    "world_from_json",
    "world_from_request",
    "world_to_json",
]
