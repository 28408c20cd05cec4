@tool
class_name MindstageStage
extends Node3D
## A world: what stands there as it was described, and the nodes that it is here.
##
## Each call either succeeds or is refused; what refuses it is a dictionary, as mindstage_msgs/Refusal has it, and then
## nothing has changed.

## Something with overlap events began or ceased to touch something else.
signal overlapped(event: Dictionary)
## An edit was made; `before` is what undoes it, in the editor, and null elsewhere.
signal edited(what: String, before: MindstagePast)

## What a saved scene has of what was described and decided; made when it is saved, read when it is opened.
@export_storage var books: Dictionary = {}

var inventory: MindstageInventory = MindstageInventory.new()
var clock: MindstageClock = MindstageClock.new()
var assembler: MindstageAssembler = MindstageAssembler.new(self)
## The map's own lights, by id.
var lights: Dictionary[String, Node3D] = {}

## Seven doubles a body: x y z, then w x y z, in ROS's axes.
var _rows: PackedFloat64Array = []
## What somebody deleted by hand, in the editor.
var _absent: Dictionary[String, bool] = {}
var _pushed: Array[RID] = []


func _init() -> void:
	add_child(clock, false, INTERNAL_MODE_BACK)
	clock.ticking.connect(_hold_softly)


func _ready() -> void:
	if books and inventory.bodies.is_empty():
		MindstageBooks.open(self)


func _notification(what: int) -> void:
	if what == NOTIFICATION_PREDELETE:
		assembler.let_go()
	elif what == NOTIFICATION_EDITOR_PRE_SAVE:
		refresh()
		keep_books()


# -- the world -------------------------------------------------------------------------------------------------------


## Adds a world. Gives why nothing of it can be read, or an empty string; what became of it goes into `added`.
func spawn(world: String, forms: String, plan: String, added: MindstageInventory.Added) -> String:
	var before: MindstagePast = _past()
	refresh()
	var reason: String = inventory.add(world, added)
	if reason:
		return reason
	_rows.resize(inventory.bodies.size() * MindstageFrames.ROW)
	for body: MindstageBody in added.bodies:
		write_pose(body, body.data.get("pose", {}))
	_give_forms(forms, added)
	assembler.apply(_change(plan))
	for body: MindstageBody in added.bodies:
		var note: String = MindstageLooks.dress(body)
		if note:
			added.notes.append({"kind": "untold", "ids": [body.id], "text": note})
		MindstageOverlaps.watch(self, body)
	for id: String in added.lights:
		lights[id] = MindstageLights.make(MindstageJsonText.read(inventory.lights[id]))
		add_child(lights[id])
	edited.emit("Spawn %d bodies" % added.bodies.size(), before)
	return ""


## The world as it is now, as JSON.
func world_text() -> String:
	refresh()
	return inventory.world_text(_rows, _absent)


func delete(ids: Array, plan: String) -> Dictionary:
	var refusal: Dictionary = inventory.refuse_unknown(ids)
	if refusal:
		return refusal
	var before: MindstagePast = _past()
	refresh()
	_remove(ids)
	assembler.apply(_change(plan))
	edited.emit("Delete %d bodies" % ids.size(), before)
	return {}


func clear() -> void:
	var before: MindstagePast = _past()
	_remove(inventory.bodies.keys())
	for id: String in lights:
		MindstageAssembler.discard(lights[id])
	lights.clear()
	var revision: int = inventory.revision
	inventory = MindstageInventory.new()
	inventory.revision = revision + 1
	edited.emit("Clear", before)


func attach(parent: String, child: String, plan: String) -> Dictionary:
	var refusal: Dictionary = inventory.refuse_unknown([parent, child])
	if refusal:
		return refusal
	var reason: String = inventory.why_not_hang(parent, child)
	if reason:
		var text: String = "'%s' cannot be attached to '%s': %s" % [child, parent, reason]
		return {"kind": "AttachmentRefused", "text": text, "parent": parent, "child": child, "reason": reason}
	var before: MindstagePast = _past()
	refresh()
	inventory.parents.erase(child)
	inventory.parents[child] = parent
	assembler.apply(_change(plan))
	edited.emit("Attach %s to %s" % [child, parent], before)
	return {}


func detach(child: String, plan: String) -> Dictionary:
	var refusal: Dictionary = inventory.refuse_unknown([child])
	if refusal or not inventory.parents.has(child):
		return refusal
	var before: MindstagePast = _past()
	refresh()
	inventory.parents.erase(child)
	assembler.apply(_change(plan))
	edited.emit("Detach %s" % child, before)
	return {}


# -- one body --------------------------------------------------------------------------------------------------------


## Puts a body somewhere, at rest; with a plan, all that is named there.
func set_pose(id: String, pose: Dictionary, plan: String) -> Dictionary:
	var refusal: Dictionary = inventory.refuse_unknown([id])
	if refusal:
		return refusal
	var reason: String = MindstageInventory.why_not_pose(pose)
	if reason:
		var text: String = "'%s' cannot be put there: %s" % [id, reason]
		return {"kind": "PoseUnreachable", "text": text, "body": id, "reason": reason}
	var before: MindstagePast = _past()
	refresh()
	assembler.apply(_change(plan) if plan else MindstageMover.change(self, id, pose))
	edited.emit("Move %s" % id, before)
	return {}


func set_physics(id: String, physics: String, plan: String) -> Dictionary:
	var refusal: Dictionary = _replace(id, "physics", physics, plan)
	if not refusal:
		MindstageOverlaps.watch(self, inventory.bodies[id])
	return refusal


func set_materials(id: String, materials: String) -> Dictionary:
	var refusal: Dictionary = _replace(id, "materials", materials, "{}")
	if not refusal:
		_dress_again(inventory.bodies[id])
	return refusal


## Lights bodies up; a colour that is wholly transparent puts out.
func highlight(ids: Array, colour: Color) -> Dictionary:
	var refusal: Dictionary = inventory.refuse_unknown(ids)
	if refusal:
		return refusal
	for id: String in ids:
		inventory.lit.erase(id)
		if colour.a > 0.0:
			inventory.lit[id] = Color(colour, 1.0)
			MindstageHighlighter.light(inventory.bodies[id], colour)
		else:
			MindstageHighlighter.put_out(inventory.bodies[id])
	return {}


## Pushes a body throughout the next step; `at` is a point of the world, or null for the centre of mass.
func push(id: String, force: Vector3, at: Variant) -> Dictionary:
	var refusal: Dictionary = inventory.refuse_unknown([id])
	if refusal:
		return refusal
	var carrier: MindstageCarrier = inventory.bodies[id].carrier
	if not carrier.simulates() or Engine.is_editor_hint():
		return {}
	var body: RID = carrier.node.get_rid()
	PhysicsServer3D.body_add_constant_central_force(body, force)
	if at is Vector3:
		var state: PhysicsDirectBodyState3D = PhysicsServer3D.body_get_direct_state(body)
		var middle: Vector3 = carrier.place() * MindstageMatter.middle(carrier)
		if carrier.members.size() == 1:
			middle = state.transform * state.center_of_mass_local
		PhysicsServer3D.body_add_constant_torque(body, (at - middle).cross(force))
	carrier.wake()
	_pushed.append(body)
	return {}


# -- time and poses --------------------------------------------------------------------------------------------------


## Lets time pass, and then forgets what was pushed. Gives the id of a body whose pose stopped making sense, or "".
func step(duration_s: float) -> String:
	var ticks: int = clock.ticks
	await clock.run(duration_s)
	if clock.ticks > ticks:
		for body: RID in _pushed:
			PhysicsServer3D.body_set_constant_force(body, Vector3.ZERO)
			PhysicsServer3D.body_set_constant_torque(body, Vector3.ZERO)
		_pushed.clear()
	return refresh()


## Where all bodies are: seven doubles each. What never moved has the very numbers that it was given.
func rows() -> PackedFloat64Array:
	refresh()
	return _rows


## Writes down what moved. Gives the id of a body whose pose stopped making sense, or an empty string.
func refresh() -> String:
	if Engine.is_editor_hint():
		_absent = MindstageByHand.refresh(self)
		return ""
	var lost: String = ""
	for carrier: MindstageCarrier in assembler.moving():
		var place: Transform3D = PhysicsServer3D.body_get_state(carrier.body, PhysicsServer3D.BODY_STATE_TRANSFORM)
		if place == carrier.last:
			continue
		carrier.last = place
		if not place.is_finite():
			lost = carrier.id
		for body: MindstageBody in carrier.members:
			note_pose(body, place * body.hold())
	return lost


## Writes down where a body was found.
func note_pose(body: MindstageBody, place: Transform3D) -> void:
	body.last = place
	body.moved = true
	MindstageFrames.write_row(_rows, body.row, place)


## Writes what nodes do not show into the scene, so that it can be read from its file: see `MindstageBooks`.
func keep_books() -> void:
	books = MindstageBooks.of(self)


## The same as they were written down last.
func rows_as_written() -> PackedFloat64Array:
	return _rows


## Takes over what stood there once; for undo.
func bring_back(
	old_inventory: MindstageInventory, old_rows: PackedFloat64Array, old_lights: Dictionary[String, Node3D]
) -> void:
	inventory = old_inventory
	_rows = old_rows
	lights = old_lights


# -- inside ----------------------------------------------------------------------------------------------------------


func _replace(id: String, key: String, value: String, plan: String) -> Dictionary:
	var refusal: Dictionary = inventory.refuse_unknown([id])
	if refusal:
		return refusal
	var before: MindstagePast = _past()
	refresh()
	inventory.bodies[id].replace(key, value)
	assembler.apply(_change(plan))
	edited.emit("Change the %s of %s" % [key, id], before)
	return {}


## What was decided elsewhere, or else here.
func _change(plan: String) -> Dictionary:
	if plan:
		var told: Variant = MindstageJsonText.read(plan)
		if told is Dictionary:
			return told
		push_error("Mindstage: the plan is no JSON; what stands there stays as it is")
		return {}
	return MindstagePlanner.plan(inventory, _rows, assembler.joints)


## Writes down where a body is put, in the very numbers.
func write_pose(body: MindstageBody, pose: Dictionary) -> void:
	var row: PackedFloat64Array = MindstageFrames.row_from(pose)
	for index: int in MindstageFrames.ROW:
		_rows[body.row * MindstageFrames.ROW + index] = row[index]
	body.last = MindstageFrames.transform_at(_rows, body.row)


func _give_forms(text: String, added: MindstageInventory.Added) -> void:
	if text.is_empty():
		return
	var read: Variant = MindstageJsonText.read(text)
	if not read is Dictionary:
		push_error("Mindstage: the forms are no JSON; bodies are shown as their solids")
		return
	var keys: Dictionary = read.get("bodies", {})
	var forms: Dictionary = read.get("forms", {})
	for body: MindstageBody in added.bodies:
		body.form = forms.get(keys.get(body.id, ""), {})


func _past() -> MindstagePast:
	return MindstagePast.of(self) if Engine.is_editor_hint() else null


func _remove(ids: Array) -> void:
	var going: Dictionary[String, bool] = {}
	for id: String in ids:
		going[id] = true
	var gone: Array[MindstageBody] = []
	var table: PackedFloat64Array = []
	for id: String in inventory.bodies:
		if going.has(id):
			gone.append(inventory.bodies[id])
		elif going.size() < inventory.bodies.size():
			var at: int = inventory.bodies[id].row * MindstageFrames.ROW
			table.append_array(_rows.slice(at, at + MindstageFrames.ROW))
	assembler.remove(gone, inventory.remove(going))
	_rows = table


func _hold_softly() -> void:
	for id: String in assembler.joints:
		if assembler.joints[id].is_soft():
			assembler.joints[id].hold_softly()


## Lets everything be seen, also where nothing is drawn.
func dress_all() -> void:
	if not MindstageLooks.is_watched():
		MindstageLooks.always = true
		for id: String in inventory.bodies:
			_dress_again(inventory.bodies[id])


## Lets a body be seen where it now has its node.
func move_looks(body: MindstageBody, from: Node3D) -> void:
	if Engine.is_editor_hint():
		_dress_again(body)
		MindstageOverlaps.watch(self, body)
		return
	for child: Node in from.get_children():
		if child.has_meta(MindstageLooks.NODE) or child is MindstageOverlaps:
			from.remove_child(child)
			body.node.add_child(child)


func _dress_again(body: MindstageBody) -> void:
	MindstageLooks.dress(body)
	if inventory.lit.has(body.id):
		MindstageHighlighter.light(body, inventory.lit[body.id])
