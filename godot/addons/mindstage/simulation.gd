@tool
class_name MindstageSimulation
extends Node3D
## A simulated world: its description (`world_model`) and its physics nodes (`physics_scene`).
##
## Methods that edit the world return an empty dictionary on success. Otherwise they change nothing and return the
## fields of a mindstage_msgs/Refusal.

## A body with overlap events began or ended to overlap another body.
signal overlapped(event: Dictionary)
## An edit was made; `before` is the state to restore on undo in the editor, null when the scene runs.
signal edited(what: String, before: MindstageUndoSnapshot)

## The description and the physics model, stored in the scene file: see `MindstageSavedState`.
@export_storage var saved_state: Dictionary = {}

var world_model: MindstageWorldModel = MindstageWorldModel.new()
var clock: MindstageClock = MindstageClock.new()
var physics_scene: MindstagePhysicsScene = MindstagePhysicsScene.new(self)
var drives: MindstageDrives = MindstageDrives.new(physics_scene)
## The lights of the map by id.
var lights: Dictionary[String, Node3D] = {}

## The poses of all bodies: x y z, w x y z for each, in ROS axes.
var _rows: PackedFloat64Array = []
## Ids of the bodies whose nodes were deleted in the editor.
var _deleted_nodes: Dictionary[String, bool] = {}
var _forced_bodies: Array[RID] = []


func _init() -> void:
	add_child(clock, false, INTERNAL_MODE_BACK)
	clock.ticking.connect(_apply_soft_limits)
	clock.ticking.connect(_move_coupled_joints)
	clock.ticking.connect(_drive_joints)


func _ready() -> void:
	if saved_state and world_model.bodies.is_empty():
		MindstageSavedState.restore(self)


func _notification(what: int) -> void:
	if what == NOTIFICATION_PREDELETE:
		physics_scene.clear_references()
	elif what == NOTIFICATION_EDITOR_PRE_SAVE:
		update_poses()
		save_state()


# -- the world -------------------------------------------------------------------------------------------------------


## Adds a world given as JSON. Returns why it cannot be read, or an empty string; fills in `result`.
func spawn(world: String, geometries: String, plan: String, result: MindstageWorldModel.SpawnResult) -> String:
	var before: MindstageUndoSnapshot = _snapshot()
	update_poses()
	var reason: String = world_model.add(world, result)
	if reason:
		return reason
	_rows.resize(world_model.bodies.size() * MindstageFrames.ROW)
	for body: MindstageBody in result.bodies:
		write_pose(body, body.data.get("pose", {}))
	_assign_geometry(geometries, result)
	physics_scene.apply(_model_change(plan))
	for body: MindstageBody in result.bodies:
		var warning: String = MindstageVisuals.build(body)
		if warning:
			result.notes.append({"kind": "unstated", "ids": [body.id], "text": warning})
		MindstageOverlapArea.update(self, body)
	for id: String in result.lights:
		lights[id] = MindstageLights.make(MindstageJsonText.read(world_model.lights[id]))
		add_child(lights[id])
	edited.emit("Spawn %d bodies" % result.bodies.size(), before)
	return ""


## The current world as JSON.
func world_text() -> String:
	update_poses()
	return world_model.world_text(_rows, _deleted_nodes)


func delete(ids: Array, plan: String) -> Dictionary:
	var refusal: Dictionary = world_model.check_known(ids)
	if refusal:
		return refusal
	var before: MindstageUndoSnapshot = _snapshot()
	update_poses()
	_remove(ids)
	physics_scene.apply(_model_change(plan))
	edited.emit("Delete %d bodies" % ids.size(), before)
	return {}


func clear() -> void:
	var before: MindstageUndoSnapshot = _snapshot()
	_remove(world_model.bodies.keys())
	physics_scene.set_ground({})
	for id: String in lights:
		MindstagePhysicsScene.discard(lights[id])
	lights.clear()
	var revision: int = world_model.revision
	world_model = MindstageWorldModel.new()
	world_model.revision = revision + 1
	edited.emit("Clear", before)


func attach(parent: String, child: String, plan: String) -> Dictionary:
	var refusal: Dictionary = world_model.check_known([parent, child])
	if refusal:
		return refusal
	var reason: String = world_model.attachment_error(parent, child)
	if reason:
		var text: String = "'%s' cannot be attached to '%s': %s" % [child, parent, reason]
		return {"code": "AttachmentError", "text": text, "parent": parent, "child": child, "reason": reason}
	var before: MindstageUndoSnapshot = _snapshot()
	update_poses()
	world_model.parents.erase(child)
	world_model.parents[child] = parent
	physics_scene.apply(_model_change(plan))
	edited.emit("Attach %s to %s" % [child, parent], before)
	return {}


func detach(child: String, plan: String) -> Dictionary:
	var refusal: Dictionary = world_model.check_known([child])
	if refusal or not world_model.parents.has(child):
		return refusal
	var before: MindstageUndoSnapshot = _snapshot()
	update_poses()
	world_model.parents.erase(child)
	physics_scene.apply(_model_change(plan))
	edited.emit("Detach %s" % child, before)
	return {}


# -- one body --------------------------------------------------------------------------------------------------------


## Places a body at rest; with a plan, places all bodies named there.
func set_pose(id: String, pose: Dictionary, plan: String) -> Dictionary:
	var refusal: Dictionary = world_model.check_known([id])
	if refusal:
		return refusal
	var reason: String = MindstageWorldModel.pose_error(pose)
	if reason:
		var text: String = "'%s' cannot be placed there: %s" % [id, reason]
		return {"code": "PoseUnreachableError", "text": text, "body": id, "reason": reason}
	var before: MindstageUndoSnapshot = _snapshot()
	update_poses()
	physics_scene.apply(
		_model_change(plan) if plan else MindstageDefaultPhysicsModel.attached_poses_change(self, id, pose)
	)
	edited.emit("Move %s" % id, before)
	return {}


func set_physics(id: String, physics: String, plan: String) -> Dictionary:
	var refusal: Dictionary = _replace(id, "physics", physics, plan)
	if not refusal:
		MindstageOverlapArea.update(self, world_model.bodies[id])
	return refusal


func set_materials(id: String, materials: String) -> Dictionary:
	var refusal: Dictionary = _replace(id, "materials", materials, "{}")
	if not refusal:
		_rebuild_visuals(world_model.bodies[id])
	return refusal


## Sets the label of a body, its name for people; an empty one removes it.
func set_label(id: String, label: String) -> Dictionary:
	return _replace(id, "label", JSON.stringify(label) if label else "null", "{}")


## Highlights bodies; a fully transparent color clears the highlight.
func highlight(ids: Array, color: Color) -> Dictionary:
	var refusal: Dictionary = world_model.check_known(ids)
	if refusal:
		return refusal
	for id: String in ids:
		world_model.highlights.erase(id)
		if color.a > 0.0:
			world_model.highlights[id] = Color(color, 1.0)
			MindstageHighlighter.highlight(world_model.bodies[id], color)
		else:
			MindstageHighlighter.clear(world_model.bodies[id])
	return {}


## Applies a force [N] to a body during the next step, at a point in world coordinates or, if null, at the center of
## mass.
func apply_force(id: String, force: Vector3, at: Variant) -> Dictionary:
	var refusal: Dictionary = world_model.check_known([id])
	if refusal:
		return refusal
	var group: MindstageRigidGroup = world_model.bodies[id].group
	if not group.is_dynamic() or Engine.is_editor_hint():
		return {}
	var body: RID = group.node.get_rid()
	PhysicsServer3D.body_add_constant_central_force(body, force)
	if at is Vector3:
		var state: PhysicsDirectBodyState3D = PhysicsServer3D.body_get_direct_state(body)
		var center: Vector3 = group.current_transform() * MindstageMassProperties.center_of_mass(group)
		if group.members.size() == 1:
			center = state.transform * state.center_of_mass_local
		PhysicsServer3D.body_add_constant_torque(body, (at - center).cross(force))
	group.wake()
	_forced_bodies.append(body)
	return {}


## Adds actuators, which the plan has with their joints; those of the same names get their first command again.
func set_actuators(names: Array, plan: String) -> Dictionary:
	var before: MindstageUndoSnapshot = _snapshot()
	update_poses()
	physics_scene.apply(_model_change(plan))
	drives.forget(names)
	edited.emit("Add %d actuators" % names.size(), before)
	return {}


# -- time and poses --------------------------------------------------------------------------------------------------


## Simulates a duration [s] and then clears applied forces. Returns the id of a body with an invalid pose, or "".
func step(duration_s: float) -> String:
	var ticks: int = clock.ticks
	await clock.run(duration_s)
	if clock.ticks > ticks:
		for body: RID in _forced_bodies:
			PhysicsServer3D.body_set_constant_force(body, Vector3.ZERO)
			PhysicsServer3D.body_set_constant_torque(body, Vector3.ZERO)
		_forced_bodies.clear()
	return update_poses()


## The current poses of all bodies, seven doubles each. Bodies that never moved have exactly the numbers of the map.
func rows() -> PackedFloat64Array:
	update_poses()
	return _rows


## Records the poses of bodies that moved. Returns the id of a body with an invalid pose, or an empty string.
func update_poses() -> String:
	if Engine.is_editor_hint():
		_deleted_nodes = MindstageEditorChanges.update_poses(self)
		return ""
	var invalid_body: String = ""
	for group: MindstageRigidGroup in physics_scene.dynamic_groups():
		var xform: Transform3D = PhysicsServer3D.body_get_state(group.body, PhysicsServer3D.BODY_STATE_TRANSFORM)
		if xform == group.last_transform:
			continue
		group.last_transform = xform
		if not xform.is_finite():
			invalid_body = group.id
		for body: MindstageBody in group.members:
			record_pose(body, xform * body.transform_in_group())
	return invalid_body


## Records the transform of a body that was moved.
func record_pose(body: MindstageBody, xform: Transform3D) -> void:
	body.last_transform = xform
	body.moved = true
	MindstageFrames.write_row(_rows, body.row, xform)


## Stores the state that is not in the nodes, for the scene file: see `MindstageSavedState`.
func save_state() -> void:
	saved_state = MindstageSavedState.capture(self)


## The poses as of the last `update_poses`.
func recorded_rows() -> PackedFloat64Array:
	return _rows


## Replaces the description, poses and lights; for undo.
func restore(
	old_world_model: MindstageWorldModel, old_rows: PackedFloat64Array, old_lights: Dictionary[String, Node3D]
) -> void:
	world_model = old_world_model
	_rows = old_rows
	lights = old_lights


# -- inside ----------------------------------------------------------------------------------------------------------


func _replace(id: String, key: String, value: String, plan: String) -> Dictionary:
	var refusal: Dictionary = world_model.check_known([id])
	if refusal:
		return refusal
	var before: MindstageUndoSnapshot = _snapshot()
	update_poses()
	world_model.bodies[id].replace(key, value)
	physics_scene.apply(_model_change(plan))
	edited.emit("Change the %s of %s" % [key, id], before)
	return {}


## Parses the change of the physics model; without one, the default model is computed.
func _model_change(plan: String) -> Dictionary:
	if plan:
		var model_change: Variant = MindstageJsonText.read(plan)
		if model_change is Dictionary:
			return model_change
		push_error("Mindstage: the plan is not a JSON object; the physics model is unchanged")
		return {}
	return MindstageDefaultPhysicsModel.plan(world_model, _rows, physics_scene.joints)


## Records a given pose without changing its numbers.
func write_pose(body: MindstageBody, pose: Dictionary) -> void:
	var row: PackedFloat64Array = MindstageFrames.row_from(pose)
	for index: int in MindstageFrames.ROW:
		_rows[body.row * MindstageFrames.ROW + index] = row[index]
	body.last_transform = MindstageFrames.transform_at(_rows, body.row)


func _assign_geometry(text: String, result: MindstageWorldModel.SpawnResult) -> void:
	if text.is_empty():
		return
	var data: Variant = MindstageJsonText.read(text)
	if not data is Dictionary:
		push_error("Mindstage: the geometries are not a JSON object; collision shapes are shown instead")
		return
	var keys: Dictionary = data.get("bodies", {})
	var geometries: Dictionary = data.get("geometries", {})
	for body: MindstageBody in result.bodies:
		body.geometry = geometries.get(keys.get(body.id, ""), {})


func _snapshot() -> MindstageUndoSnapshot:
	return MindstageUndoSnapshot.capture(self) if Engine.is_editor_hint() else null


func _remove(ids: Array) -> void:
	var removed_ids: Dictionary[String, bool] = {}
	for id: String in ids:
		removed_ids[id] = true
	var removed: Array[MindstageBody] = []
	var table: PackedFloat64Array = []
	for id: String in world_model.bodies:
		if removed_ids.has(id):
			removed.append(world_model.bodies[id])
		elif removed_ids.size() < world_model.bodies.size():
			var at: int = world_model.bodies[id].row * MindstageFrames.ROW
			table.append_array(_rows.slice(at, at + MindstageFrames.ROW))
	physics_scene.remove(removed, world_model.remove(removed_ids))
	_rows = table


## Moves each joint that mimics another one towards the position that its master gives it.
func _move_coupled_joints() -> void:
	for id: String in physics_scene.joints:
		var joint: MindstageJoint = physics_scene.joints[id]
		if joint.mimics != "":
			joint.follow(physics_scene.joints.get(joint.mimics))


func _drive_joints() -> void:
	drives.apply()


func _apply_soft_limits() -> void:
	for id: String in physics_scene.joints:
		if physics_scene.joints[id].is_soft():
			physics_scene.joints[id].apply_soft_limits()


## Builds the visuals of all bodies even when rendering is disabled.
func build_all_visuals() -> void:
	if not MindstageVisuals.is_enabled():
		MindstageVisuals.always_enabled = true
		for id: String in world_model.bodies:
			_rebuild_visuals(world_model.bodies[id])


## Moves the visuals of a body to its new node.
func move_visuals(body: MindstageBody, from: Node3D) -> void:
	if Engine.is_editor_hint():
		_rebuild_visuals(body)
		MindstageOverlapArea.update(self, body)
		return
	for child: Node in from.get_children():
		if child.has_meta(MindstageVisuals.NODE) or child is MindstageOverlapArea:
			from.remove_child(child)
			body.node.add_child(child)


func _rebuild_visuals(body: MindstageBody) -> void:
	MindstageVisuals.build(body)
	if world_model.highlights.has(body.id):
		MindstageHighlighter.highlight(body, world_model.highlights[body.id])
