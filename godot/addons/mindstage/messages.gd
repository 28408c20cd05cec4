@tool
class_name MindstageMessages
extends RefCounted
## The messages of the wire: which fields each has, and of which kind.
##
## The golden messages in `wire/` hold for both ends.
##
## A type is told by an example of its defaults; an array by one element. What is left out of a request has its default,
## as ROS has it; what is of another kind is refused, with the path to it.

const POINT: Dictionary = {"x": 0.0, "y": 0.0, "z": 0.0}
const TURN: Dictionary = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
const POSE: Dictionary = {"position": POINT, "orientation": TURN}
const COLOUR: Dictionary = {"r": 0.0, "g": 0.0, "b": 0.0, "a": 0.0}
const FORCE: Dictionary = {"id": "", "force": POINT, "at_point": false, "point": POINT}
const REFUSAL: Dictionary = {
	"kind": "", "text": "", "body": "", "parent": "", "child": "", "reason": "", "world": "", "near": [""]
}
const FAILURE: Dictionary = {"id": "", "reason": ""}
const NOTE: Dictionary = {"kind": "", "ids": [""], "text": ""}
const REPORT: Dictionary = {
	"bodies": 0,
	"constraints": 0,
	"attachments": 0,
	"failed_bodies": [FAILURE],
	"failed_constraints": [FAILURE],
	"failed_attachments": [FAILURE],
	"notes": [NOTE],
}
const JOINT: Dictionary = {"id": "", "x": 0.0, "y": 0.0, "z": 0.0, "twist": 0.0, "swing2": 0.0, "swing1": 0.0}
const DONE: Dictionary = {"success": false, "refusal": REFUSAL}

## Of each service that is offered: its package, and its two parts.
const SERVICES: Dictionary = {
	"describe":
	{
		"type": "mindstage_msgs/Describe",
		"request": {},
		"response": {"engine": "", "abilities": [""], "time_s": 0.0, "format_version": 0, "session": "", "takes": [""]},
	},
	"spawn_world":
	{
		"type": "mindstage_msgs/SpawnWorld",
		"request": {"world": "", "forms": "", "plan": ""},
		"response": {"success": false, "refusal": REFUSAL, "report": REPORT},
	},
	"log_world":
	{
		"type": "mindstage_msgs/LogWorld",
		"request": {},
		"response": {"success": false, "refusal": REFUSAL, "world": ""},
	},
	"delete": {"type": "mindstage_msgs/Delete", "request": {"ids": [""], "plan": ""}, "response": DONE},
	"clear": {"type": "mindstage_msgs/Clear", "request": {}, "response": DONE},
	"attach":
	{
		"type": "mindstage_msgs/Attach",
		"request": {"parent": "", "child": "", "plan": ""},
		"response": DONE,
	},
	"detach": {"type": "mindstage_msgs/Detach", "request": {"child": "", "plan": ""}, "response": DONE},
	"set_pose": {"type": "mindstage_msgs/SetPose", "request": {"id": "", "pose": POSE, "plan": ""}, "response": DONE},
	"set_physics":
	{
		"type": "mindstage_msgs/SetPhysics",
		"request": {"id": "", "physics": "", "plan": ""},
		"response": DONE,
	},
	"set_materials": {"type": "mindstage_msgs/SetMaterials", "request": {"id": "", "materials": ""}, "response": DONE},
	"highlight":
	{
		"type": "mindstage_msgs/Highlight",
		"request": {"ids": [""], "lit": false, "color": COLOUR},
		"response": DONE,
	},
	"get_highlights":
	{
		"type": "mindstage_msgs/GetHighlights",
		"request": {},
		"response": {"success": false, "refusal": REFUSAL, "ids": [""], "colors": [COLOUR]},
	},
	"push": {"type": "mindstage_msgs/Push", "request": FORCE, "response": DONE},
	"step":
	{
		"type": "mindstage_msgs/Step",
		"request": {"duration_s": 0.0, "forces": [FORCE], "packed": false},
		"response": {"success": false, "refusal": REFUSAL, "time_s": 0.0, "revision": 0, "rows": ""},
	},
	"set_speed":
	{
		"type": "mindstage_msgs/SetSpeed",
		"request": {"speed": 0.0},
		"response": {"success": false, "refusal": REFUSAL, "before": 0.0},
	},
	"get_poses":
	{
		"type": "mindstage_msgs/GetPoses",
		"request": {"packed": false, "known": 0},
		"response":
		{
			"success": false,
			"refusal": REFUSAL,
			"time_s": 0.0,
			"ids": [""],
			"poses": [POSE],
			"revision": 0,
			"rows": "",
		},
	},
	"get_joint_positions":
	{
		"type": "mindstage_msgs/GetJointPositions",
		"request": {},
		"response": {"success": false, "refusal": REFUSAL, "joints": [JOINT]},
	},
	"save_scene": {"type": "mindstage_msgs/SaveScene", "request": {"path": ""}, "response": DONE},
	"photograph":
	{
		"type": "mindstage_msgs/Photograph",
		"request": {"path": "", "width": 0, "height": 0, "eye": POINT, "target": POINT, "fov_deg": 0.0},
		"response": DONE,
	},
	"display_basic_marker":
	{
		"type": "unreal_vis_msgs/DisplayBasicMarker",
		"request": {"marker_type": 0, "pose": POSE, "color": COLOUR, "scale": 0.0, "marker_id": ""},
		"response": {"marker_id": ""},
	},
	"display_trajectory":
	{
		"type": "unreal_vis_msgs/DisplayTrajectory",
		"request": {"points": [POINT], "color_begin": COLOUR, "color_end": COLOUR, "marker_id": ""},
		"response": {"marker_id": ""},
	},
	"remove_marker":
	{
		"type": "unreal_vis_msgs/RemoveMarker",
		"request": {"marker_id": ""},
		"response": {"success": false},
	},
}


## What was read, or why it cannot be.
class Reading:
	var value: Dictionary = {}
	var cause: String = ""


## Where a service is offered below a namespace.
static func place(service: String, name_space: String) -> String:
	var parts: PackedStringArray = name_space.split("/", false)
	if (SERVICES[service]["type"] as String).begins_with("mindstage_msgs/"):
		parts.append("mindstage")
	parts.append(service)
	return "/" + "/".join(parts)


## Reads a request: each field, with its default where it is left out.
static func request(service: String, values: Variant) -> Reading:
	return read(SERVICES[service]["request"], values)


## A whole response: what is not told has its default.
static func response(service: String, values: Dictionary) -> Dictionary:
	return read(SERVICES[service]["response"], values).value


## Reads a message of a type that is told by its defaults.
static func read(type: Dictionary, values: Variant) -> Reading:
	var reading: Reading = Reading.new()
	var read_value: Variant = _read(type, values, "", reading)
	if not reading.cause:
		reading.value = read_value
	return reading


static func _read(type: Variant, value: Variant, path: String, reading: Reading) -> Variant:
	match typeof(type):
		TYPE_DICTIONARY when value is Dictionary:
			return _read_fields(type, value, path, reading)
		TYPE_ARRAY when value is Array or value is PackedStringArray:
			var found: Array = []
			for index: int in value.size():
				found.append(_read(type[0], value[index], "%s[%d]" % [path, index], reading))
			return found
		TYPE_STRING when value is String:
			return value
		TYPE_BOOL when value is bool:
			return value
		TYPE_FLOAT when value is float or value is int:
			return float(value)
		TYPE_INT when value is int or (value is float and value == floorf(value)):
			if value >= 0 and value < 4294967296.0:
				return int(value)
	if not reading.cause:
		var wanted: String = type_string(typeof(type)).to_lower()
		reading.cause = "%s: expected %s, got %s" % [path if path else "values", wanted, _called(value)]
	return type


static func _read_fields(type: Dictionary, values: Dictionary, path: String, reading: Reading) -> Dictionary:
	var found: Dictionary = {}
	for key: String in type:
		if values.has(key):
			found[key] = _read(type[key], values[key], key if path.is_empty() else path + "." + key, reading)
		else:
			found[key] = default_of(type[key])
	return found


## The default of a type: an array has no element.
static func default_of(type: Variant) -> Variant:
	if type is Array:
		return []
	if type is Dictionary:
		var found: Dictionary = {}
		for key: String in type:
			found[key] = default_of(type[key])
		return found
	return type


static func _called(value: Variant) -> String:
	return "null" if value == null else type_string(typeof(value)).to_lower()
