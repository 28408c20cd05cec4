@tool
class_name MindstageMessages
extends RefCounted
## Message definitions of the services: field names, types and defaults.
##
## The golden messages in `wire/` are tested in GDScript and in Python.
##
## A type is given by its default value, an array type by one element. Missing fields of a request get their defaults,
## as in ROS; a value of another type is an error with the path to it.

const POINT: Dictionary = {"x": 0.0, "y": 0.0, "z": 0.0}
const QUATERNION: Dictionary = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
const POSE: Dictionary = {"position": POINT, "orientation": QUATERNION}
const COLOR: Dictionary = {"r": 0.0, "g": 0.0, "b": 0.0, "a": 0.0}
const FORCE: Dictionary = {"id": "", "force": POINT, "at_point": false, "point": POINT}
const REFUSAL: Dictionary = {
	"code": "", "text": "", "body": "", "parent": "", "child": "", "reason": "", "world": "", "suggestions": [""]
}
const FAILURE: Dictionary = {"id": "", "reason": ""}
const NOTE: Dictionary = {"kind": "", "ids": [""], "text": ""}
const REPORT: Dictionary = {
	"bodies": 0,
	"joints": 0,
	"attachments": 0,
	"failed_bodies": [FAILURE],
	"failed_joints": [FAILURE],
	"failed_attachments": [FAILURE],
	"notes": [NOTE],
}
const JOINT: Dictionary = {"id": "", "x": 0.0, "y": 0.0, "z": 0.0, "twist": 0.0, "swing2": 0.0, "swing1": 0.0}
const ACTUATOR: Dictionary = {"name": "", "position": 0.0, "velocity": 0.0, "effort": 0.0, "command": 0.0}
const RESULT: Dictionary = {"success": false, "refusal": REFUSAL}
const EDITED: Dictionary = {"success": false, "refusal": REFUSAL, "expected_rebuild_s": 0.0}

## Type, request and response of each service.
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
		"request": {"world": "", "geometries": "", "plan": ""},
		"response": {"success": false, "refusal": REFUSAL, "report": REPORT, "expected_rebuild_s": 0.0},
	},
	"log_world":
	{
		"type": "mindstage_msgs/LogWorld",
		"request": {},
		"response": {"success": false, "refusal": REFUSAL, "world": ""},
	},
	"delete": {"type": "mindstage_msgs/Delete", "request": {"ids": [""], "plan": ""}, "response": EDITED},
	"clear": {"type": "mindstage_msgs/Clear", "request": {}, "response": EDITED},
	"attach":
	{
		"type": "mindstage_msgs/Attach",
		"request": {"parent": "", "child": "", "plan": ""},
		"response": EDITED,
	},
	"detach": {"type": "mindstage_msgs/Detach", "request": {"child": "", "plan": ""}, "response": EDITED},
	"set_pose": {"type": "mindstage_msgs/SetPose", "request": {"id": "", "pose": POSE, "plan": ""}, "response": EDITED},
	"set_physics":
	{
		"type": "mindstage_msgs/SetPhysics",
		"request": {"id": "", "physics": "", "plan": ""},
		"response": EDITED,
	},
	"set_materials":
	{"type": "mindstage_msgs/SetMaterials", "request": {"id": "", "materials": ""}, "response": EDITED},
	"set_label": {"type": "mindstage_msgs/SetLabel", "request": {"id": "", "label": ""}, "response": EDITED},
	"highlight":
	{
		"type": "mindstage_msgs/Highlight",
		"request": {"ids": [""], "highlighted": false, "color": COLOR},
		"response": RESULT,
	},
	"get_highlights":
	{
		"type": "mindstage_msgs/GetHighlights",
		"request": {},
		"response": {"success": false, "refusal": REFUSAL, "ids": [""], "colors": [COLOR]},
	},
	"push": {"type": "mindstage_msgs/Push", "request": FORCE, "response": RESULT},
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
	"set_actuators":
	{
		"type": "mindstage_msgs/SetActuators",
		"request": {"actuators": "", "without_weight": [""], "plan": ""},
		"response": EDITED,
	},
	"set_commands":
	{
		"type": "mindstage_msgs/SetCommands",
		"request": {"names": [""], "commands": [0.0]},
		"response": RESULT,
	},
	"get_actuator_states":
	{
		"type": "mindstage_msgs/GetActuatorStates",
		"request": {},
		"response": {"success": false, "refusal": REFUSAL, "actuators": [ACTUATOR]},
	},
	"save_scene": {"type": "mindstage_msgs/SaveScene", "request": {"path": ""}, "response": RESULT},
	"photograph":
	{
		"type": "mindstage_msgs/Photograph",
		"request": {"path": "", "width": 0, "height": 0, "eye": POINT, "target": POINT, "fov_deg": 0.0},
		"response": RESULT,
	},
	"display_basic_marker":
	{
		"type": "unreal_vis_msgs/DisplayBasicMarker",
		"request": {"marker_type": 0, "pose": POSE, "color": COLOR, "scale": 0.0, "marker_id": ""},
		"response": {"marker_id": ""},
	},
	"display_trajectory":
	{
		"type": "unreal_vis_msgs/DisplayTrajectory",
		"request": {"points": [POINT], "color_begin": COLOR, "color_end": COLOR, "marker_id": ""},
		"response": {"marker_id": ""},
	},
	"remove_marker":
	{
		"type": "unreal_vis_msgs/RemoveMarker",
		"request": {"marker_id": ""},
		"response": {"success": false},
	},
}


## A message that was read, or why it is invalid.
class ReadResult:
	var value: Dictionary = {}
	var error: String = ""


## The path of a service below a namespace.
static func service_path(service: String, name_space: String) -> String:
	var parts: PackedStringArray = name_space.split("/", false)
	if (SERVICES[service]["type"] as String).begins_with("mindstage_msgs/"):
		parts.append("mindstage")
	parts.append(service)
	return "/" + "/".join(parts)


## Reads a request, with defaults for missing fields.
static func request(service: String, values: Variant) -> ReadResult:
	return read(SERVICES[service]["request"], values)


## A complete response, with defaults for missing fields.
static func response(service: String, values: Dictionary) -> Dictionary:
	return read(SERVICES[service]["response"], values).value


## Reads a message of a type given by its defaults.
static func read(type: Dictionary, values: Variant) -> ReadResult:
	var result: ReadResult = ReadResult.new()
	var value: Variant = _read(type, values, "", result)
	if not result.error:
		result.value = value
	return result


static func _read(type: Variant, value: Variant, path: String, result: ReadResult) -> Variant:
	match typeof(type):
		TYPE_DICTIONARY when value is Dictionary:
			return _read_fields(type, value, path, result)
		TYPE_ARRAY when value is Array or value is PackedStringArray:
			var found: Array = []
			for index: int in value.size():
				found.append(_read(type[0], value[index], "%s[%d]" % [path, index], result))
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
	if not result.error:
		var expected: String = type_string(typeof(type)).to_lower()
		result.error = "%s: expected %s, got %s" % [path if path else "values", expected, _type_name(value)]
	return type


static func _read_fields(type: Dictionary, values: Dictionary, path: String, result: ReadResult) -> Dictionary:
	var found: Dictionary = {}
	for key: String in type:
		if values.has(key):
			found[key] = _read(type[key], values[key], key if path.is_empty() else path + "." + key, result)
		else:
			found[key] = default_of(type[key])
	return found


## The default of a type; an array defaults to an empty one.
static func default_of(type: Variant) -> Variant:
	if type is Array:
		return []
	if type is Dictionary:
		var found: Dictionary = {}
		for key: String in type:
			found[key] = default_of(type[key])
		return found
	return type


static func _type_name(value: Variant) -> String:
	return "null" if value == null else type_string(typeof(value)).to_lower()
