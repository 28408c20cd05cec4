@tool
class_name MindstageByHand
extends RefCounted
## What somebody did by hand in the editor: nodes that were moved, and nodes that were deleted.


## Writes down what is no longer where it was put; gives the ids of what is no longer there, as undo may bring it back.
static func refresh(stage: MindstageStage) -> Dictionary[String, bool]:
	var gone: Dictionary[String, bool] = {}
	for id: String in stage.inventory.bodies:
		var body: MindstageBody = stage.inventory.bodies[id]
		if body.node == null:
			continue
		if not is_instance_valid(body.node) or not stage.is_ancestor_of(body.node):
			gone[id] = true
			continue
		var place: Transform3D = place_of(stage, body.node)
		if not place.is_equal_approx(body.last):
			stage.note_pose(body, place.orthonormalized())
	return gone


## Where a node is in the stage's frame, in or out of the tree.
static func place_of(stage: Node3D, node: Node3D) -> Transform3D:
	var place: Transform3D = node.transform
	var above: Node = node.get_parent()
	while above is Node3D and above != stage:
		place = (above as Node3D).transform * place
		above = above.get_parent()
	return place
