@tool
class_name MindstageMover
extends RefCounted
## What moves along when a body is put somewhere, where nobody told it: all that hangs on it.


## The change of the plan that puts a body there, and all that hangs on it with it.
static func change(stage: MindstageStage, id: String, pose: Dictionary) -> Dictionary:
	var inventory: MindstageInventory = stage.inventory
	var body: MindstageBody = inventory.bodies[id]
	var target: Transform3D = MindstageFrames.transform_from(pose)
	var there_from_here: Transform3D = target * body.last.affine_inverse()
	var poses: Dictionary = {id: pose}
	var waiting: Array[String] = [id]
	while waiting:
		var holder: String = waiting.pop_back()
		for child: String in inventory.parents:
			if inventory.parents[child] == holder and not poses.has(child):
				poses[child] = pose_of(there_from_here * inventory.bodies[child].last)
				waiting.append(child)
	var parts: Dictionary = {}
	for each: String in poses:
		var moved: MindstageBody = inventory.bodies[each]
		if moved.top() != each and not poses.has(moved.top()):
			var hold: Transform3D = inventory.bodies[moved.top()].last.affine_inverse()
			var place: Transform3D = MindstageFrames.transform_from(poses[each])
			parts[each] = moved.part.merged({"hold": pose_of(hold * place)}, true)
	return {"poses": poses, "bodies": parts}


## A transform as a pose in ROS's axes.
static func pose_of(place: Transform3D) -> Dictionary:
	var row: PackedFloat64Array = []
	row.resize(MindstageFrames.ROW)
	MindstageFrames.write_row(row, 0, place.orthonormalized())
	return MindstageFrames.pose_from_row(row, 0)
