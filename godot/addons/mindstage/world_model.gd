@tool
class_name MindstageWorldModel
extends RefCounted
## The description of the world as received. The JSON texts are kept, so that all digits and facts are preserved.

const FORMAT_VERSION: int = 2
const _EMPTY_WORLD: String = "http://mindstage.org/maps/empty.owl#map"
const _MAX_SUGGESTIONS: int = 3

## Bodies by id, in the order of spawning.
var bodies: Dictionary[String, MindstageBody] = {}
var joints: Dictionary[String, String] = {}
var lights: Dictionary[String, String] = {}
## The parent of each attached child.
var parents: Dictionary[String, String] = {}
## The colors of highlighted bodies.
var highlights: Dictionary[String, Color] = {}
## Increases whenever bodies are added or removed.
var revision: int = 1

## IRI, name, facts and resources of each spawned world.
var _headers: Array[Dictionary] = []


## What was added from a world, and what failed.
class SpawnResult:
	var bodies: Array[MindstageBody] = []
	var joints: PackedStringArray = []
	var lights: PackedStringArray = []
	var attachments: PackedStringArray = []
	var failed_bodies: Array[Dictionary] = []
	var failed_joints: Array[Dictionary] = []
	var failed_attachments: Array[Dictionary] = []
	var notes: Array[Dictionary] = []

	## The fields of a mindstage_msgs/SpawnReport.
	func report() -> Dictionary:
		return {
			"bodies": bodies.size(),
			"joints": joints.size(),
			"attachments": attachments.size(),
			"failed_bodies": failed_bodies,
			"failed_joints": failed_joints,
			"failed_attachments": failed_attachments,
			"notes": notes,
		}


## A copy with copies of the bodies.
func copy() -> MindstageWorldModel:
	var copied: MindstageWorldModel = MindstageWorldModel.new()
	for id: String in bodies:
		copied.bodies[id] = bodies[id].copy()
	copied.joints = joints.duplicate()
	copied.lights = lights.duplicate()
	copied.parents = parents.duplicate()
	copied.highlights = highlights.duplicate()
	copied.revision = revision
	copied._headers = _headers.duplicate()
	return copied


## Everything except the bodies as plain values, for the scene file.
func to_dictionary() -> Dictionary:
	return {"joints": joints, "lights": lights, "parents": parents, "highlights": highlights, "headers": _headers}


## A model without bodies from such values.
static func from_dictionary(data: Dictionary) -> MindstageWorldModel:
	var world_model: MindstageWorldModel = MindstageWorldModel.new()
	world_model.joints.assign(data["joints"])
	world_model.lights.assign(data["lights"])
	world_model.parents.assign(data["parents"])
	world_model.highlights.assign(data["highlights"])
	world_model._headers.assign(data["headers"])
	return world_model


## Adds bodies, lights, joints and attachments from JSON. Returns why the text cannot be read, or an empty string.
func add(text: String, result: SpawnResult) -> String:
	var items: Variant = MindstageJsonText.read(text)
	if not items is Dictionary:
		return "the world is not a JSON object"
	var world: Dictionary = items
	var version: Variant = world.get("format_version")
	if version != FORMAT_VERSION:
		return "the world has format_version %s; this addon reads %d" % [version, FORMAT_VERSION]
	var parts: Dictionary[String, String] = MindstageJsonText.members(text)
	_add_bodies(world.get("bodies", []), _texts(parts, "bodies"), result)
	_add_lights(world.get("lights", []), _texts(parts, "lights"), result)
	_add_joints(world.get("joints", []), _texts(parts, "joints"), result)
	for attachment: Dictionary in world.get("attachments", []):
		_add_attachment(str(attachment.get("parent", "")), str(attachment.get("child", "")), result)
	(
		_headers
		. append(
			{
				"iri": parts.get("iri", JSON.stringify(_EMPTY_WORLD)),
				"name": parts.get("name", '""'),
				"facts": _texts(parts, "facts"),
				"resources": _texts(parts, "resources"),
			}
		)
	)
	revision += 1
	return ""


## Removes bodies with their joints and attachments. Returns the ids of the removed joints.
func remove(ids: Dictionary[String, bool]) -> PackedStringArray:
	for id: String in ids:
		bodies.erase(id)
		highlights.erase(id)
		parents.erase(id)
	for child: String in parents.keys():
		if ids.has(parents[child]):
			parents.erase(child)
	var removed: PackedStringArray = []
	for id: String in joints.keys():
		var ends: Dictionary = MindstageJsonText.read(joints[id])
		if ids.has(ends["parent"]) or ids.has(ends["child"]):
			removed.append(id)
			joints.erase(id)
	var row: int = 0
	for id: String in bodies:
		bodies[id].row = row
		row += 1
	revision += 1
	return removed


## The world as JSON, without deleted bodies and their joints and attachments.
func world_text(rows: PackedFloat64Array, deleted: Dictionary[String, bool]) -> String:
	var body_texts: PackedStringArray = []
	for id: String in bodies:
		var body: MindstageBody = bodies[id]
		if deleted.has(id):
			continue
		var text: String = body.text
		if body.moved:
			var pose: Dictionary = MindstageFrames.pose_from_row(rows, body.row)
			text = MindstageJsonText.with_member(text, "pose", MindstageJsonText.write(pose))
		body_texts.append(text)
	var attachment_texts: PackedStringArray = []
	for child: String in parents:
		if deleted.has(child) or deleted.has(parents[child]):
			continue
		attachment_texts.append(JSON.stringify({"parent": parents[child], "child": child}, "", false))
	var resources: Dictionary[String, bool] = {}
	var facts: PackedStringArray = []
	for header: Dictionary in _headers:
		facts.append_array(header["facts"])
		for resource: String in header["resources"]:
			resources[resource] = true
	var parts: Dictionary[String, String] = {
		"iri": _headers[0]["iri"] if _headers else JSON.stringify(_EMPTY_WORLD),
		"name": _headers[0]["name"] if _headers else '""',
		"bodies": MindstageJsonText.array(body_texts),
		"joints": MindstageJsonText.array(_joint_texts(deleted)),
		"attachments": MindstageJsonText.array(attachment_texts),
		"lights": MindstageJsonText.array(PackedStringArray(lights.values())),
		"facts": MindstageJsonText.array(facts),
		"resources": MindstageJsonText.array(PackedStringArray(resources.keys())),
		"format_version": str(FORMAT_VERSION),
	}
	return MindstageJsonText.object(parts)


func _joint_texts(deleted: Dictionary[String, bool]) -> PackedStringArray:
	var texts: PackedStringArray = PackedStringArray(joints.values())
	if deleted.is_empty():
		return texts
	var to_dictionary: PackedStringArray = []
	for text: String in texts:
		var ends: Dictionary = MindstageJsonText.read(text)
		if not (deleted.has(ends["parent"]) or deleted.has(ends["child"])):
			to_dictionary.append(text)
	return to_dictionary


## The refusal for the first unknown id; empty if all bodies exist.
func check_known(ids: Array) -> Dictionary:
	for id: String in ids:
		if not bodies.has(id):
			return _unknown_body_error(id)
	return {}


## Why a child cannot be attached to a parent, or an empty string.
func attachment_error(parent: String, child: String) -> String:
	var ancestor: String = parent
	while ancestor != "":
		if ancestor == child:
			return "it is the same body" if parent == child else "a circle: '%s' is already attached to it" % parent
		ancestor = parents.get(ancestor, "")
	return ""


func _unknown_body_error(id: String) -> Dictionary:
	var suggestions: Array = bodies.keys().filter(func(known: String) -> bool: return known.similarity(id) >= 0.6)
	suggestions.sort_custom(func(a: String, b: String) -> bool: return a.similarity(id) > b.similarity(id))
	suggestions = suggestions.slice(0, _MAX_SUGGESTIONS)
	var world: String = MindstageJsonText.read(_headers[0]["name"]) if _headers else ""
	var text: String = "no body '%s'%s" % [id, " in '%s'" % world if world else ""]
	if suggestions:
		text += "; near: " + ", ".join(suggestions.map(func(each: String) -> String: return "'%s'" % each))
	return {"code": "BodyNotFoundError", "text": text, "body": id, "world": world, "suggestions": suggestions}


func _add_bodies(items: Array, texts: PackedStringArray, result: SpawnResult) -> void:
	for index: int in items.size():
		var data: Dictionary = items[index]
		var id: String = str(data.get("id", ""))
		var reason: String = _body_error(id, data)
		if reason:
			result.failed_bodies.append({"id": id, "reason": reason})
			continue
		var body: MindstageBody = MindstageBody.from_text(texts[index], data)
		body.row = bodies.size()
		bodies[id] = body
		result.bodies.append(body)


func _add_lights(items: Array, texts: PackedStringArray, result: SpawnResult) -> void:
	for index: int in items.size():
		var id: String = str((items[index] as Dictionary).get("id", ""))
		var reason: String = _id_error(id)
		if reason:
			result.failed_bodies.append({"id": id, "reason": reason})
		else:
			lights[id] = texts[index]
			result.lights.append(id)


func _add_joints(items: Array, texts: PackedStringArray, result: SpawnResult) -> void:
	for index: int in items.size():
		var data: Dictionary = items[index]
		var id: String = str(data.get("id", ""))
		var reason: String = _joint_error(id, data)
		if reason:
			result.failed_joints.append({"id": id, "reason": reason})
		else:
			joints[id] = texts[index]
			result.joints.append(id)


func _add_attachment(parent: String, child: String, result: SpawnResult) -> void:
	var reason: String = ""
	for end: String in [parent, child]:
		if not bodies.has(end):
			reason = "there is no body '%s'" % end
	if not reason and parents.has(child):
		reason = "it is already attached to '%s' and cannot be attached to '%s' too" % [parents[child], parent]
	if not reason:
		reason = attachment_error(parent, child)
	if reason:
		result.failed_attachments.append({"id": child, "reason": reason})
	else:
		parents[child] = parent
		result.attachments.append(child)


func _id_error(id: String) -> String:
	if id.is_empty():
		return "it has no id"
	if bodies.has(id) or joints.has(id) or lights.has(id):
		return "the id '%s' is already taken; delete that body first or choose another id" % id
	return ""


func _body_error(id: String, data: Dictionary) -> String:
	var reason: String = _id_error(id)
	if reason:
		return reason
	var size: Variant = data.get("size")
	if size is Array and (size.size() != 3 or not (size[0] >= 0.0 and size[1] >= 0.0 and size[2] >= 0.0)):
		return "its size %s is not three finite lengths" % [size]
	return pose_error(data.get("pose", {}))


func _joint_error(id: String, data: Dictionary) -> String:
	var ends: Array[String] = [str(data.get("parent", "")), str(data.get("child", ""))]
	var unknown: Array[String] = ends.filter(func(end: String) -> bool: return not bodies.has(end))
	if unknown:
		return "it connects '%s', which does not exist" % "' and '".join(unknown)
	if ends[0] == ends[1]:
		return "it connects '%s' to itself" % ends[0]
	var reason: String = _id_error(id)
	return reason if reason else pose_error(data.get("pose", {}))


## Why a pose is invalid, or an empty string.
static func pose_error(pose: Variant) -> String:
	if not pose is Dictionary:
		return "its pose is not a position and a quaternion"
	var position: Variant = pose.get("position", [0.0, 0.0, 0.0])
	var quaternion: Variant = pose.get("quaternion", [1.0, 0.0, 0.0, 0.0])
	if not position is Array or not quaternion is Array or position.size() != 3 or quaternion.size() != 4:
		return "its pose is not a position and a quaternion"
	for number: Variant in position + quaternion:
		if not (number is float and is_finite(number)):
			return "its pose has numbers that are not finite"
	if quaternion[0] == 0.0 and quaternion[1] == 0.0 and quaternion[2] == 0.0 and quaternion[3] == 0.0:
		return "its quaternion is all zeros, which is not a rotation"
	return ""


static func _texts(parts: Dictionary[String, String], key: String) -> PackedStringArray:
	return MindstageJsonText.elements(parts[key]) if parts.has(key) else PackedStringArray()
