@tool
class_name MindstageBody
extends RefCounted
## One body: its description, its physics model and its nodes.

## The local name of the individual.
var id: String
## Its description as JSON text; an edit replaces only the member that changed.
var text: String
## The parsed description.
var data: Dictionary
## Its index among all bodies and in the table of poses.
var row: int
## Whether its pose differs from its description.
var moved: bool = false
## Its geometry (visual mesh, collision shapes, emitted lights), if given.
var geometry: Dictionary = {}
## Its physics model: `BodyChange` of a plan.
var physics_model: Dictionary = {}
## Its node in the scene.
var node: Node3D
## The rigid group whose physics node has its collision shapes.
var group: MindstageRigidGroup
## The ids of the joints that connect it.
var joints: Dictionary[String, bool] = {}
## The last known transform of its node.
var last_transform: Transform3D


## Creates a body from its description.
static func from_text(json_text: String, read: Dictionary) -> MindstageBody:
	var body: MindstageBody = MindstageBody.new()
	body.text = json_text
	body.data = read
	body.id = read["id"]
	return body


## A copy for a snapshot, without the group.
func copy() -> MindstageBody:
	var copied: MindstageBody = MindstageBody.new()
	for field: String in ["id", "text", "data", "row", "moved", "geometry", "physics_model", "node", "last_transform"]:
		copied.set(field, get(field))
	copied.joints = joints.duplicate()
	return copied


## Replaces a member of its description with a JSON value.
func replace(key: String, value: String) -> void:
	text = MindstageJsonText.with_member(text, key, value)
	data = data.duplicate()
	data[key] = MindstageJsonText.read(value)
	if node != null:
		MindstageTags.write(node, data)


## The physics properties of its description.
func physics() -> Dictionary:
	return data.get("physics", {})


## Whether its rigid group is moved by the physics.
func is_dynamic() -> bool:
	return physics_model.get("mobility", "static") == "dynamic"


## The id of the root body of its rigid group.
func root_id() -> String:
	return physics_model.get("top", id)


## The id of the body whose physics node has its collision shapes.
func group_id() -> String:
	return root_id() if is_dynamic() else id


## Its transform relative to that body.
func transform_in_group() -> Transform3D:
	return (
		MindstageFrames.transform_from(physics_model.get("hold", {}))
		if is_dynamic() and root_id() != id
		else Transform3D()
	)


## Its center of mass and its moments of inertia, if they are not those of its collision shapes.
func inertia() -> Dictionary:
	var given: Variant = physics_model.get("inertia")
	return given if given is Dictionary else {}


## Its collision shapes in its own frame.
func collision_shapes() -> Array:
	return physics_model.get("collision_shapes", [])
