@tool
class_name MindstageBody
extends RefCounted
## One body of the world: how it was described, what was decided about it, and the node that it is here.

## The local name of the individual.
var id: String
## Its JSON as it came; an edit replaces the member that it is about, and no other.
var text: String
## The same, read.
var data: Dictionary
## Its number among all bodies, and in the table of poses.
var row: int
## Whether it is no longer where its description says.
var moved: bool = false
## What it is made of, where that was told.
var form: Dictionary = {}
## How it takes part in the physics: `BodyChange` of mindstage_msgs' plans.
var part: Dictionary = {}
## It in the scene.
var node: Node3D
## The body whose physics node its solids belong to: the top of an assembly that moves, else itself.
var carrier: MindstageCarrier
## The constraints that it is an end of.
var joints: Dictionary[String, bool] = {}
## Where its node was put, or seen, last.
var last: Transform3D


## Reads a description.
static func from_text(written: String, read: Dictionary) -> MindstageBody:
	var body: MindstageBody = MindstageBody.new()
	body.text = written
	body.data = read
	body.id = read["id"]
	return body


## A body of its own with the same content, for who keeps the past.
func copy() -> MindstageBody:
	var twin: MindstageBody = MindstageBody.new()
	for field: String in ["id", "text", "data", "row", "moved", "form", "part", "node", "last"]:
		twin.set(field, get(field))
	twin.joints = joints.duplicate()
	return twin


## Replaces a member of its description by the text of another value.
func replace(key: String, value: String) -> void:
	text = MindstageJsonText.with_member(text, key, value)
	data = data.duplicate()
	data[key] = MindstageJsonText.read(value)
	if node != null:
		MindstageTags.write(node, data)


## How it takes part in the physics, as the map says.
func physics() -> Dictionary:
	return data.get("physics", {})


## Whether the physics moves its assembly.
func simulates() -> bool:
	return part.get("mobility", "static") == "dynamic"


## The id of the body that its rigid assembly hangs on.
func top() -> String:
	return part.get("top", id)


## The id of the body whose physics node its solids belong to.
func carrier_id() -> String:
	return top() if simulates() else id


## Where it is in the frame of that body.
func hold() -> Transform3D:
	return MindstageFrames.transform_from(part.get("hold", {})) if simulates() and top() != id else Transform3D()


## What can be touched of it, in its own frame.
func solids() -> Array:
	return part.get("solids", [])
