@tool
class_name MindstageUndoSnapshot
extends RefCounted
## A snapshot of a simulation for undo in the editor: description, physics model, nodes and transforms.

var world_model: MindstageWorldModel
var _rows: PackedFloat64Array
var _groups: Dictionary[String, MindstageRigidGroup] = {}
var _joints: Dictionary[String, MindstageJoint]
var _joint_frames: Dictionary[String, Dictionary]
var _excluded_pairs: Dictionary[String, Dictionary]
var _lights: Dictionary[String, Node3D]
var _transforms: Dictionary[Node3D, Transform3D] = {}


## Takes a snapshot.
static func capture(simulation: MindstageSimulation) -> MindstageUndoSnapshot:
	var snapshot: MindstageUndoSnapshot = MindstageUndoSnapshot.new()
	snapshot.world_model = simulation.world_model.copy()
	snapshot._rows = simulation.recorded_rows().duplicate()
	snapshot._joints = simulation.physics_scene.joints.duplicate()
	snapshot._joint_frames = simulation.physics_scene.copy_joint_frames()
	snapshot._excluded_pairs = simulation.physics_scene.excluded_pairs.duplicate(true)
	snapshot._lights = simulation.lights.duplicate()
	for id: String in simulation.physics_scene.groups:
		snapshot._groups[id] = snapshot._copy_group(simulation.physics_scene.groups[id])
	for child: Node in simulation.get_children():
		if child is Node3D:
			snapshot._transforms[child as Node3D] = (child as Node3D).transform
	return snapshot


## All nodes of the snapshot.
func nodes() -> Array[Node3D]:
	return _transforms.keys()


## Restores the simulation.
func restore(simulation: MindstageSimulation) -> void:
	for child: Node in simulation.get_children():
		if child is Node3D and not _transforms.has(child as Node3D):
			simulation.remove_child(child)
	for node: Node3D in _transforms:
		if node.get_parent() == null:
			simulation.add_child(node)
		node.transform = _transforms[node]
	simulation.restore(world_model.copy(), _rows.duplicate(), _lights.duplicate())
	simulation.physics_scene.joints = _joints.duplicate()
	simulation.physics_scene.set_joint_frames(_joint_frames)
	simulation.physics_scene.excluded_pairs = _excluded_pairs.duplicate(true)
	simulation.physics_scene.groups = {}
	for id: String in _groups:
		var group: MindstageRigidGroup = _copy_group(_groups[id])
		simulation.physics_scene.groups[id] = group
		group.members.assign(
			group.members.map(func(body: MindstageBody) -> MindstageBody: return simulation.world_model.bodies[body.id])
		)
		for body: MindstageBody in group.members:
			body.group = group
	for id: String in simulation.physics_scene.joints:
		var joint: MindstageJoint = simulation.physics_scene.joints[id]
		joint.group_a = simulation.physics_scene.groups[joint.group_a.id]
		joint.group_b = simulation.physics_scene.groups[joint.group_b.id]


static func _copy_group(group: MindstageRigidGroup) -> MindstageRigidGroup:
	var copy: MindstageRigidGroup = MindstageRigidGroup.new()
	copy.id = group.id
	if is_instance_valid(group.node):
		copy.node = group.node
	copy.members = group.members.duplicate()
	copy.last_transform = group.last_transform
	copy.gravity_factor = group.gravity_factor
	return copy
