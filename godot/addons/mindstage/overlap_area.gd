@tool
class_name MindstageOverlapArea
extends Area3D
## Area that emits the overlap events of a body (`overlap_events` in the map).

const _MARGIN_M: float = 0.003

var simulation: MindstageSimulation
var body_id: String


## Adds or removes the area of a body, according to its physics properties.
static func update(owner_simulation: MindstageSimulation, body: MindstageBody) -> void:
	var enabled: bool = body.physics().get("overlap_events") == true
	if not enabled and body.node.get_child_count() == 0:
		return
	for child: Node in body.node.get_children():
		if child is MindstageOverlapArea:
			MindstagePhysicsScene.discard(child)
	if not enabled:
		return
	var area: MindstageOverlapArea = MindstageOverlapArea.new()
	area.simulation = owner_simulation
	area.body_id = body.id
	area.name = "overlaps"
	area.collision_layer = 0
	area.collision_mask = MindstageRigidGroup.MOVING
	if body.group.is_dynamic():
		area.collision_mask |= MindstageRigidGroup.FIXED
	for shape: Dictionary in body.collision_shapes():
		var shape_node: CollisionShape3D = CollisionShape3D.new()
		shape_node.shape = MindstageCollisionShapes.shape(_enlarged(shape))
		shape_node.transform = MindstageCollisionShapes.shape_transform(shape)
		area.add_child(shape_node)
	body.node.add_child(area)


## Slightly larger than the body, since bodies in contact do not overlap.
static func _enlarged(shape: Dictionary) -> Dictionary:
	var enlarged: Dictionary = shape.duplicate(true)
	for axis: int in 3:
		var factor: float = 1.0 + 2.0 * _MARGIN_M / maxf(shape["size"][axis], _MARGIN_M)
		enlarged["size"][axis] *= factor
		for point: Array in enlarged.get("points", []):
			point[axis] *= factor
	return enlarged


func _enter_tree() -> void:
	body_entered.connect(_on_body_entered)
	body_exited.connect(_on_body_exited)


func _exit_tree() -> void:
	body_entered.disconnect(_on_body_entered)
	body_exited.disconnect(_on_body_exited)


func _on_body_entered(other: Node3D) -> void:
	_publish_transforms(other, true)


func _on_body_exited(other: Node3D) -> void:
	_publish_transforms(other, false)


func _publish_transforms(other: Node3D, began: bool) -> void:
	var other_id: String = MindstageTags.id_of(other)
	if simulation == null or other == get_parent() or other.is_ancestor_of(self):
		return
	simulation.overlapped.emit(
		{"body": body_id, "other": other_id, "began": began, "time_s": simulation.clock.time_s()}
	)
