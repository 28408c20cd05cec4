@tool
class_name MindstageJointBuilder
extends RefCounted
## Creates joints, and recreates them whenever the node of one of their groups is replaced.

var physics_scene: MindstagePhysicsScene
## For each joint, its bodies and its frame relative to each: `PlanChange.joints`.
var _joint_frames: Dictionary[String, Dictionary] = {}


func _init(owner_scene: MindstagePhysicsScene) -> void:
	physics_scene = owner_scene


## Applies changed joints, and recreates the joints of rebuilt groups.
func apply(changed_joints: Dictionary, rebuilt_groups: Dictionary[String, bool]) -> void:
	var rebuilt: Dictionary[String, bool] = {}
	if not _joint_frames.is_empty():
		for group: String in rebuilt_groups:
			for id: String in _joints_of(group):
				rebuilt[id] = true
	for id: String in changed_joints:
		if changed_joints[id] == null:
			remove([id])
			rebuilt.erase(id)
		else:
			_joint_frames[id] = changed_joints[id]
			rebuilt[id] = true
	for id: String in rebuilt:
		_build(id)


## Removes joints.
func remove(ids: PackedStringArray) -> void:
	for id: String in ids:
		_joint_frames.erase(id)
		var joint: MindstageJoint = physics_scene.joints.get(id)
		if joint != null:
			physics_scene.joints.erase(id)
			_disconnect_ends(joint, id)
			MindstagePhysicsScene.discard(joint)


func copy_joint_frames() -> Dictionary[String, Dictionary]:
	return _joint_frames.duplicate()


func set_joint_frames(joint_frames: Dictionary[String, Dictionary]) -> void:
	_joint_frames = joint_frames.duplicate()


func _joints_of(group: String) -> Array[String]:
	var found: Array[String] = []
	if physics_scene.groups.has(group):
		for body: MindstageBody in physics_scene.groups[group].members:
			for id: String in body.joints:
				found.append(id)
	return found


func _build(id: String) -> void:
	var world_model: MindstageWorldModel = physics_scene.simulation.world_model
	var frames: Dictionary = _joint_frames[id]
	var parent: MindstageBody = world_model.bodies.get(frames.get("parent", ""))
	var child: MindstageBody = world_model.bodies.get(frames.get("child", ""))
	if parent == null or child == null or not world_model.joints.has(id):
		push_error("Mindstage: the plan has a joint '%s' whose bodies or description do not exist" % id)
		return
	var old: MindstageJoint = physics_scene.joints.get(id)
	if old != null:
		_disconnect_ends(old, id)
		MindstagePhysicsScene.discard(old)
		physics_scene.joints.erase(id)
	parent.joints[id] = true
	child.joints[id] = true
	if parent.group == child.group or not (parent.group.is_dynamic() or child.group.is_dynamic()):
		return
	physics_scene.joints[id] = _new_joint(id, frames, parent, child, old)
	_update_fixed_joint(parent.group)
	_update_fixed_joint(child.group)


func _new_joint(
	id: String, frames: Dictionary, parent: MindstageBody, child: MindstageBody, old: MindstageJoint
) -> MindstageJoint:
	var joint_data: Dictionary = MindstageJsonText.read(physics_scene.simulation.world_model.joints[id])
	var joint: MindstageJoint = MindstageJoint.new()
	joint.name = id.validate_node_name()
	MindstageTags.write(joint, joint_data)
	joint.group_a = parent.group
	joint.group_b = child.group
	joint.frame_a = parent.transform_in_group() * MindstageFrames.joint_frame(frames.get("of_parent", {}))
	joint.frame_b = child.transform_in_group() * MindstageFrames.joint_frame(frames.get("of_child", {}))
	joint.axes = MindstageJoint.axes_of(_simulated_limits(joint_data, frames))
	var mimic: Variant = joint_data.get("mimic")
	if mimic is Dictionary:
		var follows: Dictionary = mimic
		joint.mimics = follows.get("joint", "")
		joint.mimic_multiplier = follows.get("multiplier", 1.0)
		joint.mimic_offset = follows.get("offset", 0.0)
	joint.drives = MindstageDrive.from_frames(frames)
	joint.is_driven = frames.get("is_driven", false)
	joint.center_frames()
	if old != null:
		joint.keep_turns(old)
	joint.collide_connected = joint_data.get("disable_collision") == false
	joint.transform = child.last_transform * child.transform_in_group().affine_inverse() * joint.frame_b
	physics_scene.simulation.add_child(joint)
	joint.set_node_paths()
	joint.add_armature()
	joint.balance_locked()
	joint.create()
	return joint


## The limits to simulate: those of the physics model where it has some, otherwise those of the world.
static func _simulated_limits(joint_data: Dictionary, frames: Dictionary) -> Dictionary:
	var limits: Dictionary = {}
	for key: String in ["linear", "angular"]:
		var own: Variant = frames.get(key)
		limits[key] = own if own is Dictionary else joint_data.get(key, {})
	return limits


func _disconnect_ends(joint: MindstageJoint, id: String) -> void:
	for end: MindstageRigidGroup in [joint.group_a, joint.group_b]:
		for body: MindstageBody in end.members:
			body.joints.erase(id)
		_update_fixed_joint(end)


## Updates whether a group is connected to a fixed body by a joint, and whether actuators move it.
func _update_fixed_joint(group: MindstageRigidGroup) -> void:
	var fixed: bool = false
	var driven: bool = false
	for id: String in _joints_of(group.id):
		var joint: MindstageJoint = physics_scene.joints.get(id)
		if joint != null:
			fixed = fixed or not (joint.group_a.is_dynamic() and joint.group_b.is_dynamic())
			driven = driven or joint.is_driven
	group.set_fixed_joint(fixed and not driven)
	if group.is_dynamic():
		group.set_driven(driven)
