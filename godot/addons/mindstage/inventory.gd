@tool
class_name MindstageInventory
extends RefCounted
## What stands there, as it was described: the texts that came, so that the log gives back every digit and every fact.

const FORMAT_VERSION: int = 1
const _NOWHERE: String = "http://mindstage.org/maps/empty.owl#map"
const _NEAR: int = 3

## By id, in the order in which they came.
var bodies: Dictionary[String, MindstageBody] = {}
var constraints: Dictionary[String, String] = {}
var lights: Dictionary[String, String] = {}
## Whom each attached child hangs on.
var parents: Dictionary[String, String] = {}
## Which bodies are lit, and how.
var lit: Dictionary[String, Color] = {}
## Another one whenever a body comes or goes.
var revision: int = 1

## What each world said about itself.
var _heads: Array[Dictionary] = []


## What of a world went in, and what did not.
class Added:
	var bodies: Array[MindstageBody] = []
	var constraints: PackedStringArray = []
	var lights: PackedStringArray = []
	var attachments: PackedStringArray = []
	var failed_bodies: Array[Dictionary] = []
	var failed_constraints: Array[Dictionary] = []
	var failed_attachments: Array[Dictionary] = []
	var notes: Array[Dictionary] = []

	## As mindstage_msgs/SpawnReport.
	func report() -> Dictionary:
		return {
			"bodies": bodies.size(),
			"constraints": constraints.size(),
			"attachments": attachments.size(),
			"failed_bodies": failed_bodies,
			"failed_constraints": failed_constraints,
			"failed_attachments": failed_attachments,
			"notes": notes,
		}


## An inventory of its own with the same content.
func copy() -> MindstageInventory:
	var twin: MindstageInventory = MindstageInventory.new()
	for id: String in bodies:
		twin.bodies[id] = bodies[id].copy()
	twin.constraints = constraints.duplicate()
	twin.lights = lights.duplicate()
	twin.parents = parents.duplicate()
	twin.lit = lit.duplicate()
	twin.revision = revision
	twin._heads = _heads.duplicate()
	return twin


## What of it is not about single bodies, as plain values for a file.
func kept() -> Dictionary:
	return {"constraints": constraints, "lights": lights, "parents": parents, "lit": lit, "heads": _heads}


## An inventory without bodies from such values.
static func from_kept(told: Dictionary) -> MindstageInventory:
	var inventory: MindstageInventory = MindstageInventory.new()
	inventory.constraints.assign(told["constraints"])
	inventory.lights.assign(told["lights"])
	inventory.parents.assign(told["parents"])
	inventory.lit.assign(told["lit"])
	inventory._heads.assign(told["heads"])
	return inventory


## Takes in what can be taken in: bodies and lights, then constraints, then attachments. Gives why nothing can.
func add(text: String, added: Added) -> String:
	var read: Variant = MindstageJsonText.read(text)
	if not read is Dictionary:
		return "a world: it is no JSON"
	var world: Dictionary = read
	var version: Variant = world.get("format_version")
	if version != FORMAT_VERSION:
		return "a world: format_version: it is %s, and this addon reads %d" % [version, FORMAT_VERSION]
	var parts: Dictionary[String, String] = MindstageJsonText.members(text)
	_add_bodies(world.get("bodies", []), _texts(parts, "bodies"), added)
	_add_lights(world.get("lights", []), _texts(parts, "lights"), added)
	_add_constraints(world.get("constraints", []), _texts(parts, "constraints"), added)
	for attachment: Dictionary in world.get("attachments", []):
		_add_attachment(str(attachment.get("parent", "")), str(attachment.get("child", "")), added)
	(
		_heads
		. append(
			{
				"iri": parts.get("iri", JSON.stringify(_NOWHERE)),
				"name": parts.get("name", '""'),
				"facts": _texts(parts, "facts"),
				"resources": _texts(parts, "resources"),
			}
		)
	)
	revision += 1
	return ""


## Takes bodies away, and the constraints and attachments that they are part of. Gives those constraints.
func remove(ids: Dictionary[String, bool]) -> PackedStringArray:
	for id: String in ids:
		bodies.erase(id)
		lit.erase(id)
		parents.erase(id)
	for child: String in parents.keys():
		if ids.has(parents[child]):
			parents.erase(child)
	var gone: PackedStringArray = []
	for id: String in constraints.keys():
		var ends: Dictionary = MindstageJsonText.read(constraints[id])
		if ids.has(ends["parent"]) or ids.has(ends["child"]):
			gone.append(id)
			constraints.erase(id)
	var row: int = 0
	for id: String in bodies:
		bodies[id].row = row
		row += 1
	revision += 1
	return gone


## The world as JSON, without bodies that are absent, and what joins them.
func world_text(rows: PackedFloat64Array, absent: Dictionary[String, bool]) -> String:
	var written: PackedStringArray = []
	for id: String in bodies:
		var body: MindstageBody = bodies[id]
		if absent.has(id):
			continue
		var text: String = body.text
		if body.moved:
			var pose: Dictionary = MindstageFrames.pose_from_row(rows, body.row)
			text = MindstageJsonText.with_member(text, "pose", MindstageJsonText.write(pose))
		written.append(text)
	var hung: PackedStringArray = []
	for child: String in parents:
		if absent.has(child) or absent.has(parents[child]):
			continue
		hung.append(JSON.stringify({"parent": parents[child], "child": child}, "", false))
	var resources: Dictionary[String, bool] = {}
	var facts: PackedStringArray = []
	for head: Dictionary in _heads:
		facts.append_array(head["facts"])
		for resource: String in head["resources"]:
			resources[resource] = true
	var parts: Dictionary[String, String] = {
		"iri": _heads[0]["iri"] if _heads else JSON.stringify(_NOWHERE),
		"name": _heads[0]["name"] if _heads else '""',
		"bodies": MindstageJsonText.array(written),
		"constraints": MindstageJsonText.array(_constraint_texts(absent)),
		"attachments": MindstageJsonText.array(hung),
		"lights": MindstageJsonText.array(PackedStringArray(lights.values())),
		"facts": MindstageJsonText.array(facts),
		"resources": MindstageJsonText.array(PackedStringArray(resources.keys())),
		"format_version": str(FORMAT_VERSION),
	}
	return MindstageJsonText.object(parts)


func _constraint_texts(absent: Dictionary[String, bool]) -> PackedStringArray:
	var texts: PackedStringArray = PackedStringArray(constraints.values())
	if absent.is_empty():
		return texts
	var kept: PackedStringArray = []
	for text: String in texts:
		var ends: Dictionary = MindstageJsonText.read(text)
		if not (absent.has(ends["parent"]) or absent.has(ends["child"])):
			kept.append(text)
	return kept


## What refuses a call for a body that is not there; empty where all are there.
func refuse_unknown(ids: Array) -> Dictionary:
	for id: String in ids:
		if not bodies.has(id):
			return _unknown(id)
	return {}


## Why a child cannot hang on a parent, or an empty string.
func why_not_hang(parent: String, child: String) -> String:
	var above: String = parent
	while above != "":
		if above == child:
			return "it is itself" if parent == child else "a circle: '%s' already hangs on it" % parent
		above = parents.get(above, "")
	return ""


func _unknown(id: String) -> Dictionary:
	var near: Array = bodies.keys().filter(func(known: String) -> bool: return known.similarity(id) >= 0.6)
	near.sort_custom(func(a: String, b: String) -> bool: return a.similarity(id) > b.similarity(id))
	near = near.slice(0, _NEAR)
	var world: String = MindstageJsonText.read(_heads[0]["name"]) if _heads else ""
	var text: String = "no body '%s'%s" % [id, " in '%s'" % world if world else ""]
	if near:
		text += "; near: " + ", ".join(near.map(func(each: String) -> String: return "'%s'" % each))
	return {"kind": "BodyUnknown", "text": text, "body": id, "world": world, "near": near}


func _add_bodies(read: Array, texts: PackedStringArray, added: Added) -> void:
	for index: int in read.size():
		var data: Dictionary = read[index]
		var id: String = str(data.get("id", ""))
		var reason: String = _why_not_body(id, data)
		if reason:
			added.failed_bodies.append({"id": id, "reason": reason})
			continue
		var body: MindstageBody = MindstageBody.from_text(texts[index], data)
		body.row = bodies.size()
		bodies[id] = body
		added.bodies.append(body)


func _add_lights(read: Array, texts: PackedStringArray, added: Added) -> void:
	for index: int in read.size():
		var id: String = str((read[index] as Dictionary).get("id", ""))
		var reason: String = _why_not_id(id)
		if reason:
			added.failed_bodies.append({"id": id, "reason": reason})
		else:
			lights[id] = texts[index]
			added.lights.append(id)


func _add_constraints(read: Array, texts: PackedStringArray, added: Added) -> void:
	for index: int in read.size():
		var data: Dictionary = read[index]
		var id: String = str(data.get("id", ""))
		var reason: String = _why_not_constraint(id, data)
		if reason:
			added.failed_constraints.append({"id": id, "reason": reason})
		else:
			constraints[id] = texts[index]
			added.constraints.append(id)


func _add_attachment(parent: String, child: String, added: Added) -> void:
	var reason: String = ""
	for end: String in [parent, child]:
		if not bodies.has(end):
			reason = "there is no body '%s'" % end
	if not reason and parents.has(child):
		reason = "it already hangs on '%s', so it cannot hang on '%s' too" % [parents[child], parent]
	if not reason:
		reason = why_not_hang(parent, child)
	if reason:
		added.failed_attachments.append({"id": child, "reason": reason})
	else:
		parents[child] = parent
		added.attachments.append(child)


func _why_not_id(id: String) -> String:
	if id.is_empty():
		return "it has no id"
	if bodies.has(id) or constraints.has(id) or lights.has(id):
		return "the id '%s' is already taken; delete that body first or choose another id" % id
	return ""


func _why_not_body(id: String, data: Dictionary) -> String:
	var reason: String = _why_not_id(id)
	if reason:
		return reason
	var size: Variant = data.get("size")
	if size is Array and (size.size() != 3 or not (size[0] >= 0.0 and size[1] >= 0.0 and size[2] >= 0.0)):
		return "its size %s is not three finite lengths" % [size]
	return why_not_pose(data.get("pose", {}))


func _why_not_constraint(id: String, data: Dictionary) -> String:
	var ends: Array[String] = [str(data.get("parent", "")), str(data.get("child", ""))]
	var unknown: Array[String] = ends.filter(func(end: String) -> bool: return not bodies.has(end))
	if unknown:
		return "it joins '%s', which is not there" % "' and '".join(unknown)
	if ends[0] == ends[1]:
		return "it joins '%s' to itself" % ends[0]
	var reason: String = _why_not_id(id)
	return reason if reason else why_not_pose(data.get("pose", {}))


## Why nothing can be put at that pose, or an empty string.
static func why_not_pose(pose: Variant) -> String:
	if not pose is Dictionary:
		return "its pose is none"
	var position: Variant = pose.get("position", [0.0, 0.0, 0.0])
	var turn: Variant = pose.get("quaternion", [1.0, 0.0, 0.0, 0.0])
	if not position is Array or not turn is Array or position.size() != 3 or turn.size() != 4:
		return "its pose is none"
	for number: Variant in position + turn:
		if not (number is float and is_finite(number)):
			return "its pose has numbers that are not finite"
	if turn[0] == 0.0 and turn[1] == 0.0 and turn[2] == 0.0 and turn[3] == 0.0:
		return "its quaternion is all zeros, which is no rotation"
	return ""


static func _texts(parts: Dictionary[String, String], key: String) -> PackedStringArray:
	return MindstageJsonText.elements(parts[key]) if parts.has(key) else PackedStringArray()
