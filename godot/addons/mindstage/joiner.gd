@tool
class_name MindstageJoiner
extends RefCounted
## Makes joints of constraints, and makes them anew whenever one of their ends was.

var assembler: MindstageAssembler
## What was decided about each constraint: its ends, and where its frame is in either.
var _joins: Dictionary[String, Dictionary] = {}


func _init(its_assembler: MindstageAssembler) -> void:
	assembler = its_assembler


## Takes in what changed, and joins anew what hangs on carriers that were made anew.
func change(changes: Dictionary, dirty: Dictionary[String, bool]) -> void:
	var again: Dictionary[String, bool] = {}
	if not _joins.is_empty():
		for carrier: String in dirty:
			for id: String in _joints_of(carrier):
				again[id] = true
	for id: String in changes:
		if changes[id] == null:
			remove([id])
			again.erase(id)
		else:
			_joins[id] = changes[id]
			again[id] = true
	for id: String in again:
		_join(id)


## Takes joints away.
func remove(ids: PackedStringArray) -> void:
	for id: String in ids:
		_joins.erase(id)
		var joint: MindstageJoint = assembler.joints.get(id)
		if joint != null:
			assembler.joints.erase(id)
			_forget(joint, id)
			MindstageAssembler.discard(joint)


func copy_joins() -> Dictionary[String, Dictionary]:
	return _joins.duplicate()


func set_joins(joins: Dictionary[String, Dictionary]) -> void:
	_joins = joins.duplicate()


func _joints_of(carrier: String) -> Array[String]:
	var found: Array[String] = []
	if assembler.carriers.has(carrier):
		for body: MindstageBody in assembler.carriers[carrier].members:
			for id: String in body.joints:
				found.append(id)
	return found


func _join(id: String) -> void:
	var inventory: MindstageInventory = assembler.stage.inventory
	var join: Dictionary = _joins[id]
	var parent: MindstageBody = inventory.bodies.get(join.get("parent", ""))
	var child: MindstageBody = inventory.bodies.get(join.get("child", ""))
	if parent == null or child == null or not inventory.constraints.has(id):
		push_error("Mindstage: the plan joins by '%s', but not everything of it is there" % id)
		return
	var old: MindstageJoint = assembler.joints.get(id)
	if old != null:
		_forget(old, id)
		MindstageAssembler.discard(old)
		assembler.joints.erase(id)
	parent.joints[id] = true
	child.joints[id] = true
	if parent.carrier == child.carrier or not (parent.carrier.simulates() or child.carrier.simulates()):
		return
	assembler.joints[id] = _made(id, join, parent, child)
	_hold(parent.carrier)
	_hold(child.carrier)


func _made(id: String, join: Dictionary, parent: MindstageBody, child: MindstageBody) -> MindstageJoint:
	var constraint: Dictionary = MindstageJsonText.read(assembler.stage.inventory.constraints[id])
	var joint: MindstageJoint = MindstageJoint.new()
	joint.name = id.validate_node_name()
	MindstageTags.write(joint, constraint)
	joint.end_a = parent.carrier
	joint.end_b = child.carrier
	joint.frame_a = parent.hold() * MindstageFrames.joint_frame(join.get("of_parent", {}))
	joint.frame_b = child.hold() * MindstageFrames.joint_frame(join.get("of_child", {}))
	joint.axes = MindstageJoint.axes_of(constraint)
	joint.lets_ends_collide = constraint.get("disable_collision") == false
	joint.transform = child.last * child.hold().affine_inverse() * joint.frame_b
	assembler.stage.add_child(joint)
	joint.name_ends()
	joint.join()
	return joint


func _forget(joint: MindstageJoint, id: String) -> void:
	for end: MindstageCarrier in [joint.end_a, joint.end_b]:
		for body: MindstageBody in end.members:
			body.joints.erase(id)
		_hold(end)


## Lets joints carry what they join to something that stands still.
func _hold(carrier: MindstageCarrier) -> void:
	var held: bool = false
	for id: String in _joints_of(carrier.id):
		var joint: MindstageJoint = assembler.joints.get(id)
		if joint != null:
			held = held or not (joint.end_a.simulates() and joint.end_b.simulates())
	carrier.set_held(held)
