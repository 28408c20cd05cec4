@tool
class_name MindstageOverlaps
extends Area3D
## Feels what touches a body whose map asks for overlap events, and tells the stage.

const _MARGIN_M: float = 0.003

var stage: MindstageStage
var body_id: String


## Begins to watch a body that asks for it, or ceases to.
static func watch(its_stage: MindstageStage, body: MindstageBody) -> void:
	var asks: bool = body.physics().get("overlap_events") == true
	if not asks and body.node.get_child_count() == 0:
		return
	for child: Node in body.node.get_children():
		if child is MindstageOverlaps:
			MindstageAssembler.discard(child)
	if not asks:
		return
	var area: MindstageOverlaps = MindstageOverlaps.new()
	area.stage = its_stage
	area.body_id = body.id
	area.name = "overlaps"
	area.collision_layer = 0
	area.collision_mask = MindstageCarrier.MOVING
	if body.carrier.simulates():
		area.collision_mask |= MindstageCarrier.STILL
	for solid: Dictionary in body.solids():
		var part: CollisionShape3D = CollisionShape3D.new()
		part.shape = MindstageSolids.shape(_grown(solid))
		part.transform = MindstageSolids.place(solid)
		area.add_child(part)
	body.node.add_child(area)


## What only touches does not stand in it, so what feels it is a little larger.
static func _grown(solid: Dictionary) -> Dictionary:
	var larger: Dictionary = solid.duplicate(true)
	for axis: int in 3:
		var share: float = 1.0 + 2.0 * _MARGIN_M / maxf(solid["size"][axis], _MARGIN_M)
		larger["size"][axis] *= share
		for point: Array in larger.get("points", []):
			point[axis] *= share
	return larger


func _enter_tree() -> void:
	body_entered.connect(_on_body_entered)
	body_exited.connect(_on_body_exited)


func _exit_tree() -> void:
	body_entered.disconnect(_on_body_entered)
	body_exited.disconnect(_on_body_exited)


func _on_body_entered(other: Node3D) -> void:
	_tell(other, true)


func _on_body_exited(other: Node3D) -> void:
	_tell(other, false)


func _tell(other: Node3D, began: bool) -> void:
	var other_id: String = MindstageTags.id_of(other)
	if stage == null or other == get_parent() or other.is_ancestor_of(self):
		return
	stage.overlapped.emit({"body": body_id, "other": other_id, "began": began, "time_s": stage.clock.time_s()})
