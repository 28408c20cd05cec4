@tool
class_name MindstageSavedState
extends RefCounted
## The state that is saved in a scene file in addition to the nodes: descriptions and physics models. A scene that was
## saved, edited and opened again can still be read back as a map.


## The state as plain values.
static func capture(simulation: MindstageSimulation) -> Dictionary:
	var bodies: Dictionary = {}
	for id: String in simulation.world_model.bodies:
		var body: MindstageBody = simulation.world_model.bodies[id]
		bodies[id] = {
			"row": body.row,
			"text": body.text,
			"moved": body.moved,
			"geometry": body.geometry,
			"physics_model": body.physics_model,
			"node": simulation.get_path_to(body.node) if simulation.is_ancestor_of(body.node) else NodePath(),
			"last_transform": body.last_transform,
		}
	var joints: Dictionary = {}
	for id: String in simulation.physics_scene.joints:
		joints[id] = simulation.get_path_to(simulation.physics_scene.joints[id])
	var lights: Dictionary = {}
	for id: String in simulation.lights:
		lights[id] = simulation.get_path_to(simulation.lights[id])
	var state: Dictionary = simulation.world_model.to_dictionary()
	(
		state
		. merge(
			{
				"bodies": bodies,
				"rows": simulation.recorded_rows(),
				"joint_nodes": joints,
				"joint_frames": simulation.physics_scene.copy_joint_frames(),
				"excluded_pairs": simulation.physics_scene.excluded_pairs,
				"ground": simulation.physics_scene.ground_data,
				"light_nodes": lights,
			}
		)
	)
	return state


## Restores a simulation that was opened from a file.
static func restore(simulation: MindstageSimulation) -> void:
	var state: Dictionary = simulation.saved_state
	var lights: Dictionary[String, Node3D] = {}
	for id: String in state["light_nodes"]:
		lights[id] = simulation.get_node_or_null(state["light_nodes"][id])
	simulation.restore(MindstageWorldModel.from_dictionary(state), state["rows"], lights)
	# The order in the file differs from the table of poses.
	var ids: Array = state["bodies"].keys()
	ids.sort_custom(func(a: String, b: String) -> bool: return state["bodies"][a]["row"] < state["bodies"][b]["row"])
	for id: String in ids:
		var data: Dictionary = state["bodies"][id]
		var body: MindstageBody = MindstageBody.from_text(data["text"], MindstageJsonText.read(data["text"]))
		body.row = data["row"]
		body.moved = data["moved"]
		body.geometry = data["geometry"]
		body.physics_model = data["physics_model"]
		body.last_transform = data["last_transform"]
		body.node = simulation.get_node_or_null(data["node"])
		simulation.world_model.bodies[id] = body
	simulation.physics_scene.excluded_pairs.assign(state["excluded_pairs"])
	simulation.physics_scene.set_ground(state.get("ground", {}))
	_restore_groups(simulation)
	_restore_joints(simulation, state)


static func _restore_groups(simulation: MindstageSimulation) -> void:
	for id: String in simulation.world_model.bodies:
		var body: MindstageBody = simulation.world_model.bodies[id]
		var group: MindstageRigidGroup = simulation.physics_scene.groups.get(body.group_id())
		if group == null:
			group = MindstageRigidGroup.new()
			group.id = body.group_id()
			simulation.physics_scene.groups[group.id] = group
		group.members.insert(0 if group.id == id else group.members.size(), body)
		body.group = group
		if group.id == id:
			group.node = body.node as CollisionObject3D
			group.last_transform = body.last_transform


static func _restore_joints(simulation: MindstageSimulation, state: Dictionary) -> void:
	simulation.physics_scene.set_joint_frames(state["joint_frames"])
	for id: String in state["joint_nodes"]:
		var joint: MindstageJoint = simulation.get_node_or_null(state["joint_nodes"][id])
		var frames: Dictionary = state["joint_frames"].get(id, {})
		if joint == null or frames.is_empty():
			continue
		var parent: MindstageBody = simulation.world_model.bodies[frames["parent"]]
		var child: MindstageBody = simulation.world_model.bodies[frames["child"]]
		joint.group_a = parent.group
		joint.group_b = child.group
		parent.joints[id] = true
		child.joints[id] = true
		simulation.physics_scene.joints[id] = joint
		if joint.group_a.node != null and joint.group_b.node != null:
			joint.create()
	for one: String in simulation.physics_scene.excluded_pairs:
		for other: String in simulation.physics_scene.excluded_pairs[one]:
			simulation.physics_scene.update_collision_exception([one, other])
