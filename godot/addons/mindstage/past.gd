@tool
class_name MindstagePast
extends RefCounted
## How a stage was: what was described and decided, and which nodes stood where. The editor's undo brings it back.

var inventory: MindstageInventory
var _rows: PackedFloat64Array
var _carriers: Dictionary[String, MindstageCarrier] = {}
var _joints: Dictionary[String, MindstageJoint]
var _joins: Dictionary[String, Dictionary]
var _apart: Dictionary[String, Dictionary]
var _lights: Dictionary[String, Node3D]
var _places: Dictionary[Node3D, Transform3D] = {}


## How a stage is now.
static func of(stage: MindstageStage) -> MindstagePast:
	var past: MindstagePast = MindstagePast.new()
	past.inventory = stage.inventory.copy()
	past._rows = stage.rows_as_written().duplicate()
	past._joints = stage.assembler.joints.duplicate()
	past._joins = stage.assembler.copy_joins()
	past._apart = stage.assembler.apart.duplicate(true)
	past._lights = stage.lights.duplicate()
	for id: String in stage.assembler.carriers:
		past._carriers[id] = past._copied(stage.assembler.carriers[id])
	for child: Node in stage.get_children():
		if child is Node3D:
			past._places[child as Node3D] = (child as Node3D).transform
	return past


## All nodes that stood there.
func nodes() -> Array[Node3D]:
	return _places.keys()


## Makes a stage as it was.
func bring_back(stage: MindstageStage) -> void:
	for child: Node in stage.get_children():
		if child is Node3D and not _places.has(child as Node3D):
			stage.remove_child(child)
	for node: Node3D in _places:
		if node.get_parent() == null:
			stage.add_child(node)
		node.transform = _places[node]
	stage.bring_back(inventory.copy(), _rows.duplicate(), _lights.duplicate())
	stage.assembler.joints = _joints.duplicate()
	stage.assembler.set_joins(_joins)
	stage.assembler.apart = _apart.duplicate(true)
	stage.assembler.carriers = {}
	for id: String in _carriers:
		var carrier: MindstageCarrier = _copied(_carriers[id])
		stage.assembler.carriers[id] = carrier
		carrier.members.assign(
			carrier.members.map(func(body: MindstageBody) -> MindstageBody: return stage.inventory.bodies[body.id])
		)
		for body: MindstageBody in carrier.members:
			body.carrier = carrier
	for id: String in stage.assembler.joints:
		var joint: MindstageJoint = stage.assembler.joints[id]
		joint.end_a = stage.assembler.carriers[joint.end_a.id]
		joint.end_b = stage.assembler.carriers[joint.end_b.id]


static func _copied(carrier: MindstageCarrier) -> MindstageCarrier:
	var twin: MindstageCarrier = MindstageCarrier.new()
	twin.id = carrier.id
	if is_instance_valid(carrier.node):
		twin.node = carrier.node
	twin.members = carrier.members.duplicate()
	twin.last = carrier.last
	twin.falls = carrier.falls
	return twin
