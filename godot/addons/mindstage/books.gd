@tool
class_name MindstageBooks
extends RefCounted
## What a saved scene keeps beside its nodes: each description, each decision. So a scene that was saved, edited by hand
## and opened again is still the world that it was, and can be logged.


## All of it, as plain values.
static func of(stage: MindstageStage) -> Dictionary:
	var bodies: Dictionary = {}
	for id: String in stage.inventory.bodies:
		var body: MindstageBody = stage.inventory.bodies[id]
		bodies[id] = {
			"row": body.row,
			"text": body.text,
			"moved": body.moved,
			"form": body.form,
			"part": body.part,
			"node": stage.get_path_to(body.node) if stage.is_ancestor_of(body.node) else NodePath(),
			"last": body.last,
		}
	var joints: Dictionary = {}
	for id: String in stage.assembler.joints:
		joints[id] = stage.get_path_to(stage.assembler.joints[id])
	var lights: Dictionary = {}
	for id: String in stage.lights:
		lights[id] = stage.get_path_to(stage.lights[id])
	var kept: Dictionary = stage.inventory.kept()
	(
		kept
		. merge(
			{
				"bodies": bodies,
				"rows": stage.rows_as_written(),
				"joints": joints,
				"joins": stage.assembler.copy_joins(),
				"apart": stage.assembler.apart,
				"light_nodes": lights,
			}
		)
	)
	return kept


## Takes a stage over that was just opened from a file.
static func open(stage: MindstageStage) -> void:
	var kept: Dictionary = stage.books
	var lights: Dictionary[String, Node3D] = {}
	for id: String in kept["light_nodes"]:
		lights[id] = stage.get_node_or_null(kept["light_nodes"][id])
	stage.bring_back(MindstageInventory.from_kept(kept), kept["rows"], lights)
	# A file has them in another order than the table of poses.
	var ids: Array = kept["bodies"].keys()
	ids.sort_custom(func(a: String, b: String) -> bool: return kept["bodies"][a]["row"] < kept["bodies"][b]["row"])
	for id: String in ids:
		var told: Dictionary = kept["bodies"][id]
		var body: MindstageBody = MindstageBody.from_text(told["text"], MindstageJsonText.read(told["text"]))
		body.row = told["row"]
		body.moved = told["moved"]
		body.form = told["form"]
		body.part = told["part"]
		body.last = told["last"]
		body.node = stage.get_node_or_null(told["node"])
		stage.inventory.bodies[id] = body
	stage.assembler.apart.assign(kept["apart"])
	_seat(stage)
	_join(stage, kept)


static func _seat(stage: MindstageStage) -> void:
	for id: String in stage.inventory.bodies:
		var body: MindstageBody = stage.inventory.bodies[id]
		var carrier: MindstageCarrier = stage.assembler.carriers.get(body.carrier_id())
		if carrier == null:
			carrier = MindstageCarrier.new()
			carrier.id = body.carrier_id()
			stage.assembler.carriers[carrier.id] = carrier
		carrier.members.insert(0 if carrier.id == id else carrier.members.size(), body)
		body.carrier = carrier
		if carrier.id == id:
			carrier.node = body.node as CollisionObject3D
			carrier.last = body.last


static func _join(stage: MindstageStage, kept: Dictionary) -> void:
	stage.assembler.set_joins(kept["joins"])
	for id: String in kept["joints"]:
		var joint: MindstageJoint = stage.get_node_or_null(kept["joints"][id])
		var join: Dictionary = kept["joins"].get(id, {})
		if joint == null or join.is_empty():
			continue
		var parent: MindstageBody = stage.inventory.bodies[join["parent"]]
		var child: MindstageBody = stage.inventory.bodies[join["child"]]
		joint.end_a = parent.carrier
		joint.end_b = child.carrier
		parent.joints[id] = true
		child.joints[id] = true
		stage.assembler.joints[id] = joint
		if joint.end_a.node != null and joint.end_b.node != null:
			joint.join()
	for one: String in stage.assembler.apart:
		for other: String in stage.assembler.apart[one]:
			stage.assembler.except([one, other])
