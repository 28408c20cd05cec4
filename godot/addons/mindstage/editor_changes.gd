@tool
class_name MindstageEditorChanges
extends RefCounted
## Detects nodes that were moved or deleted in the editor.


## Records the poses of moved nodes. Returns the ids of deleted ones, which are not removed since undo may restore them.
static func update_poses(simulation: MindstageSimulation) -> Dictionary[String, bool]:
	var removed: Dictionary[String, bool] = {}
	for id: String in simulation.world_model.bodies:
		var body: MindstageBody = simulation.world_model.bodies[id]
		if body.node == null:
			continue
		if not is_instance_valid(body.node) or not simulation.is_ancestor_of(body.node):
			removed[id] = true
			continue
		var xform: Transform3D = transform_of(simulation, body.node)
		if not xform.is_equal_approx(body.last_transform):
			simulation.record_pose(body, xform.orthonormalized())
	return removed


## The transform of a node relative to the simulation, in or out of the tree.
static func transform_of(simulation: Node3D, node: Node3D) -> Transform3D:
	var xform: Transform3D = node.transform
	var parent: Node = node.get_parent()
	while parent is Node3D and parent != simulation:
		xform = (parent as Node3D).transform * xform
		parent = parent.get_parent()
	return xform
