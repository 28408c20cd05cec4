@tool
class_name MindstageDefaultPhysicsModel
extends RefCounted
## A simple physics model for clients that send none: attached bodies are rigid groups, bodies connected by a joint do
## not collide, and an unknown mass is estimated from the size.
##
## Mindstage computes a better one and sends it as `plan`.

const DEFAULT_SIZE_M: float = 0.1
const DEFAULT_DENSITY: float = 200.0
const MIN_KG: float = 0.01
const MAX_KG: float = 100.0


## The change of the physics model that brings all bodies and joints up to date.
static func plan(world_model: MindstageWorldModel, rows: PackedFloat64Array, known: Dictionary) -> Dictionary:
	var joint_ends: Dictionary[String, bool] = {}
	var joints: Dictionary = {}
	var excluded_pairs: Array = []
	for id: String in world_model.joints:
		var joint_data: Dictionary = MindstageJsonText.read(world_model.joints[id])
		joint_ends[joint_data["parent"]] = true
		joint_ends[joint_data["child"]] = true
	var bodies: Dictionary = {}
	for id: String in world_model.bodies:
		var model: Dictionary = _body_model(world_model, id, joint_ends, rows)
		if not _is_same(model, world_model.bodies[id].physics_model):
			bodies[id] = model
	for id: String in world_model.joints:
		if known.has(id):
			continue
		var joint_data: Dictionary = MindstageJsonText.read(world_model.joints[id])
		joints[id] = _joint(world_model, joint_data, rows)
		if joint_data.get("disable_collision") != false:
			excluded_pairs.append([joint_data["parent"], joint_data["child"]])
	return {"bodies": bodies, "joints": joints, "excluded_pairs": excluded_pairs}


## The root body of a body's rigid group.
static func root_of(world_model: MindstageWorldModel, id: String, joint_ends: Dictionary[String, bool]) -> String:
	var current: String = id
	while world_model.parents.has(current) and not (_is_dynamic(world_model, current) and joint_ends.has(current)):
		current = world_model.parents[current]
	return current


static func _body_model(
	world_model: MindstageWorldModel, id: String, joint_ends: Dictionary[String, bool], rows: PackedFloat64Array
) -> Dictionary:
	var body: MindstageBody = world_model.bodies[id]
	var given_size: Variant = body.data.get("size")
	var size: Array = given_size if given_size is Array else [DEFAULT_SIZE_M, DEFAULT_SIZE_M, DEFAULT_SIZE_M]
	size = size.map(func(model: float) -> float: return maxf(model, 0.001))
	var top: String = root_of(world_model, id, joint_ends)
	var mobility: Variant = world_model.bodies[top].physics().get("mobility")
	var kind: String = "static" if mobility == null or mobility == "stationary" else str(mobility)
	var shape: Dictionary = body.data.get("shape", {})
	var mass: float = MindstageFrames.number(body.physics().get("mass_kg", 0.0))
	if not mass > 0.0:
		mass = clampf(size[0] * size[1] * size[2] * DEFAULT_DENSITY, MIN_KG, MAX_KG)
	var model: Dictionary = {
		"size": size,
		"top": top,
		"mobility": kind,
		"gravity": body.physics().get("gravity") != false,
		"mass_kg": mass if kind == "dynamic" else 0.0,
		"collision_shapes": body.geometry.get("collision_shapes", [{"type": shape.get("type", "box"), "size": size}]),
	}
	if top != id:
		model["hold"] = relative(rows, world_model.bodies[top].row, body.row)
	return model


## The pose of a body relative to another one.
static func relative(rows: PackedFloat64Array, parent: int, child: int) -> Dictionary:
	var xform: Transform3D = (
		MindstageFrames.transform_at(rows, parent).affine_inverse() * MindstageFrames.transform_at(rows, child)
	)
	var row: PackedFloat64Array = []
	row.resize(MindstageFrames.ROW)
	MindstageFrames.write_row(row, 0, xform.orthonormalized())
	return MindstageFrames.pose_from_row(row, 0)


static func _joint(world_model: MindstageWorldModel, joint_data: Dictionary, rows: PackedFloat64Array) -> Dictionary:
	var ends: Array[String] = [joint_data["parent"], joint_data["child"]]
	var rows_of_ends: PackedFloat64Array = []
	for end: String in ends:
		var at: int = world_model.bodies[end].row * MindstageFrames.ROW
		rows_of_ends.append_array(rows.slice(at, at + MindstageFrames.ROW))
	rows_of_ends.append_array(MindstageFrames.row_from(joint_data["pose"]))
	return {
		"parent": ends[0],
		"child": ends[1],
		"of_parent": relative(rows_of_ends, 0, 2),
		"of_child": relative(rows_of_ends, 1, 2)
	}


static func _is_dynamic(world_model: MindstageWorldModel, id: String) -> bool:
	return world_model.bodies[id].physics().get("mobility") == "dynamic"


static func _is_same(one: Dictionary, other: Dictionary) -> bool:
	# The relative pose is kept while the root body stays the same.
	for key: String in one:
		if key != "hold" and one[key] != other.get(key):
			return false
	return one.size() == other.size()


## The change that places a body and moves everything attached to it along.
static func attached_poses_change(simulation: MindstageSimulation, id: String, pose: Dictionary) -> Dictionary:
	var world_model: MindstageWorldModel = simulation.world_model
	var body: MindstageBody = world_model.bodies[id]
	var target: Transform3D = MindstageFrames.transform_from(pose)
	var new_from_old: Transform3D = target * body.last_transform.affine_inverse()
	var poses: Dictionary = {id: pose}
	var waiting: Array[String] = [id]
	while waiting:
		var parent: String = waiting.pop_back()
		for child: String in world_model.parents:
			if world_model.parents[child] == parent and not poses.has(child):
				poses[child] = pose_of(new_from_old * world_model.bodies[child].last_transform)
				waiting.append(child)
	var parts: Dictionary = {}
	for each: String in poses:
		var moved: MindstageBody = world_model.bodies[each]
		if moved.root_id() != each and not poses.has(moved.root_id()):
			var root_from_world: Transform3D = world_model.bodies[moved.root_id()].last_transform.affine_inverse()
			var xform: Transform3D = MindstageFrames.transform_from(poses[each])
			parts[each] = moved.physics_model.merged({"hold": pose_of(root_from_world * xform)}, true)
	return {"poses": poses, "bodies": parts}


## Converts a transform to a ROS pose.
static func pose_of(xform: Transform3D) -> Dictionary:
	var row: PackedFloat64Array = []
	row.resize(MindstageFrames.ROW)
	MindstageFrames.write_row(row, 0, xform.orthonormalized())
	return MindstageFrames.pose_from_row(row, 0)
