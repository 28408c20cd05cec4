@tool
class_name MindstagePhysicsScene
extends RefCounted
## Applies changes of the physics model to the scene: rigid groups, excluded collision pairs, joints and poses.
##
## Bodies that a change does not name keep their pose, velocity and sleep state.

const _MAX_REGIONS: int = 16
const _GROUND_THICKNESS_M: float = 0.2
## The fields of a body's model that the physics depends on.
const _PHYSICS_KEYS: Array[String] = [
	"top",
	"hold",
	"mobility",
	"gravity",
	"mass_kg",
	"ghost",
	"collision_shapes",
	"friction",
	"restitution",
	"on_ground",
	"inertia"
]

var simulation: MindstageSimulation
## Rigid groups by the id of their root body.
var groups: Dictionary[String, MindstageRigidGroup] = {}
var joints: Dictionary[String, MindstageJoint] = {}
## For each body id, the ids of the bodies that it does not collide with.
var excluded_pairs: Dictionary[String, Dictionary] = {}
## The ground, null if there is none.
var ground: StaticBody3D
## Its height [m] and its area (the JSON of a `GroundDelta`); without a height if there is none.
var ground_data: Dictionary = {}

var _joint_builder: MindstageJointBuilder
var _dynamic_groups: Array[MindstageRigidGroup] = []
var _dynamic_groups_valid: bool = false


func _init(owner_simulation: MindstageSimulation) -> void:
	simulation = owner_simulation
	_joint_builder = MindstageJointBuilder.new(self)


## The groups that are moved by the physics.
func dynamic_groups() -> Array[MindstageRigidGroup]:
	if not _dynamic_groups_valid:
		_dynamic_groups_valid = true
		_dynamic_groups.assign(
			groups.values().filter(func(each: MindstageRigidGroup) -> bool: return each.is_dynamic())
		)
	return _dynamic_groups


## Applies a change of the physics model (the JSON of `plan`, a `PlanChange`).
func apply(model_change: Dictionary) -> void:
	var changed_regions: Array[AABB] = []
	var motions: Dictionary[String, Array] = {}
	_dynamic_groups_valid = false
	if model_change.has("ground"):
		set_ground(model_change["ground"])
	var rebuilt_groups: Dictionary[String, bool] = _regroup(model_change.get("bodies", {}), motions, changed_regions)
	for id: String in rebuilt_groups:
		_rebuild(id, motions)
	_joint_builder.apply(model_change.get("joints", {}), rebuilt_groups)
	_update_exclusions(model_change.get("excluded_pairs", []), model_change.get("included_pairs", []), rebuilt_groups)
	_set_poses(model_change.get("poses", {}), changed_regions)
	_wake(changed_regions)


## Removes bodies. Other members of their groups get groups of their own until the next change.
func remove(bodies: Array[MindstageBody], removed_joints: PackedStringArray) -> void:
	var changed_regions: Array[AABB] = []
	_dynamic_groups_valid = false
	_joint_builder.remove(removed_joints)
	for body: MindstageBody in bodies:
		changed_regions.append(body.group.bounds())
		body.group.members.erase(body)
		for other: String in excluded_pairs.get(body.id, {}):
			excluded_pairs[other].erase(body.id)
		excluded_pairs.erase(body.id)
	var orphans: Dictionary = {}
	var motions: Dictionary[String, Array] = {}
	for body: MindstageBody in bodies:
		if body.group.id != body.id:
			discard(body.node)
			continue
		for member: MindstageBody in body.group.members:
			motions[member.id] = [body.group.velocity_at(member.last_transform.origin), body.group.angular_velocity()]
			orphans[member.id] = member
	for index: int in range(bodies.size() - 1, -1, -1):  # in reverse: removing the last child of a node is faster
		if bodies[index].group.id == bodies[index].id:
			_free(bodies[index].group, orphans)
	for id: String in orphans:
		_make_own_group(orphans[id], motions)
	_wake(changed_regions)


## Adds the ground, replaces it, or removes it if the data have no height; without an area it is a plane.
func set_ground(data: Dictionary) -> void:
	if ground != null:
		discard(ground)
		ground = null
	ground_data = data
	if data.get("height_m") == null:
		return
	ground = StaticBody3D.new()
	ground.name = "Ground"
	ground.collision_layer = MindstageRigidGroup.GROUND
	ground.collision_mask = 0
	var height: float = data["height_m"]
	var shape: CollisionShape3D = CollisionShape3D.new()
	if data.get("area") == null:
		shape.shape = WorldBoundaryShape3D.new()
		ground.position = Vector3(0.0, height, 0.0)
	else:
		var area: Array = data["area"]
		var low: Vector3 = MindstageFrames.vector(area[0], area[1], height - _GROUND_THICKNESS_M)
		var high: Vector3 = MindstageFrames.vector(area[2], area[3], height)
		var box: BoxShape3D = BoxShape3D.new()
		box.size = (high - low).abs()
		shape.shape = box
		ground.position = (low + high) / 2.0
	ground.add_child(shape)
	simulation.add_child(ground, false, Node.INTERNAL_MODE_BACK)


## A copy of the joint frames of the physics model, for snapshots.
func copy_joint_frames() -> Dictionary[String, Dictionary]:
	return _joint_builder.copy_joint_frames()


## Restores such a copy.
func set_joint_frames(joint_frames: Dictionary[String, Dictionary]) -> void:
	_joint_builder.set_joint_frames(joint_frames)


## Clears reference cycles so that all objects are freed.
func clear_references() -> void:
	for id: String in groups:
		groups[id].members.clear()
	groups.clear()
	_dynamic_groups.clear()
	_joint_builder = null


## Whether collisions between two groups are excluded.
func _is_excluded(one: MindstageRigidGroup, other: MindstageRigidGroup) -> bool:
	for body: MindstageBody in one.members:
		var partners: Dictionary = excluded_pairs.get(body.id, {})
		for partner: MindstageBody in other.members:
			if partners.has(partner.id):
				return true
	return false


func _regroup(
	models: Dictionary, motions: Dictionary[String, Array], changed_regions: Array[AABB]
) -> Dictionary[String, bool]:
	var rebuilt_groups: Dictionary[String, bool] = {}
	for id: String in models:
		var body: MindstageBody = simulation.world_model.bodies.get(id)
		if body == null:
			push_error("Mindstage: the plan names a body '%s' that does not exist" % id)
			continue
		var old: MindstageRigidGroup = body.group
		var unchanged: bool = old != null and _has_same_physics(body.physics_model, models[id])
		body.physics_model = models[id]
		if unchanged:
			continue
		if old != null:
			motions[id] = [old.velocity_at(body.last_transform.origin), old.angular_velocity()]
			changed_regions.append(old.bounds())
			rebuilt_groups[old.id] = true
			old.members.erase(body)
		var group: MindstageRigidGroup = _group(body.group_id())
		group.members.insert(0 if group.id == id else group.members.size(), body)
		body.group = group
		rebuilt_groups[group.id] = true
	return rebuilt_groups


## Whether two physics models of a body are equivalent for the physics.
static func _has_same_physics(one: Dictionary, other: Dictionary) -> bool:
	var both_fixed: bool = one.get("mobility", "static") != "dynamic" and other.get("mobility", "static") != "dynamic"
	for key: String in _PHYSICS_KEYS:
		if both_fixed and key in ["top", "hold"]:
			continue
		if one.get(key) != other.get(key):
			return false
	return true


func _group(id: String) -> MindstageRigidGroup:
	if not groups.has(id):
		groups[id] = MindstageRigidGroup.new()
		groups[id].id = id
	return groups[id]


func _rebuild(id: String, motions: Dictionary[String, Array]) -> void:
	var group: MindstageRigidGroup = groups[id]
	if group.members.is_empty():
		_free(group, {})
		return
	var old: CollisionObject3D = group.node
	MindstagePhysicsNodeBuilder.build(group, simulation, group.members[0].last_transform)
	for body: MindstageBody in group.members:
		_assign_node(body, group)
	if group.node == old:
		return
	var motion: Array = motions.get(id, [])
	var rigid: RigidBody3D = group.node as RigidBody3D
	if rigid != null and motion:
		rigid.linear_velocity = motion[0]
		rigid.angular_velocity = motion[1]
		var lever: Vector3 = rigid.basis * MindstageMassProperties.center_of_mass(group)
		rigid.linear_velocity += (motion[1] as Vector3).cross(lever)
	group.last_transform = group.current_transform()
	if old != null:
		discard(old)


## Sets the node of a body: the node of its group, or a child of it.
func _assign_node(body: MindstageBody, group: MindstageRigidGroup) -> void:
	var old: Node3D = body.node
	if body.id == group.id:
		body.node = group.node
	elif old == null or old is CollisionObject3D or old.get_parent() != group.node:
		body.node = Node3D.new()
		body.node.name = body.id.validate_node_name()
		group.node.add_child(body.node)
	if body.node != group.node:
		body.node.transform = body.transform_in_group()
	if old != body.node:
		MindstageTags.write(body.node, body.data)
		if old != null:
			simulation.move_visuals(body, old)
			if not old is CollisionObject3D:
				discard(old)


func _make_own_group(body: MindstageBody, motions: Dictionary[String, Array]) -> void:
	body.physics_model = body.physics_model.merged({"top": body.id, "hold": {}}, true)
	body.group = _group(body.id)
	body.group.members.assign([body])
	_rebuild(body.id, motions)


func _free(group: MindstageRigidGroup, kept: Dictionary) -> void:
	groups.erase(group.id)
	for id: String in kept:
		var body: MindstageBody = kept[id]
		if body.group == group and body.node.get_parent() == group.node and not Engine.is_editor_hint():
			group.node.remove_child(body.node)
	discard(group.node)


func _update_exclusions(pairs: Array, together: Array, rebuilt_groups: Dictionary[String, bool]) -> void:
	for pair: Array in pairs:
		_exclusions_of(pair[0])[pair[1]] = true
		_exclusions_of(pair[1])[pair[0]] = true
		update_collision_exception(pair)
	for pair: Array in together:
		_exclusions_of(pair[0]).erase(pair[1])
		_exclusions_of(pair[1]).erase(pair[0])
		update_collision_exception(pair)
	if excluded_pairs.is_empty():
		return
	for id: String in rebuilt_groups:
		if groups.has(id):
			for body: MindstageBody in groups[id].members:
				for other: String in excluded_pairs.get(body.id, {}):
					update_collision_exception([body.id, other])


func _exclusions_of(id: String) -> Dictionary:
	if not excluded_pairs.has(id):
		excluded_pairs[id] = {}
	return excluded_pairs[id]


## Adds or removes the collision exception between the groups of two bodies.
func update_collision_exception(pair: Array) -> void:
	var one: MindstageBody = simulation.world_model.bodies.get(pair[0])
	var other: MindstageBody = simulation.world_model.bodies.get(pair[1])
	if one == null or other == null or one.group == other.group:
		return
	if not (one.group.is_dynamic() or other.group.is_dynamic()):
		return
	var a: PhysicsBody3D = one.group.node as PhysicsBody3D
	var b: PhysicsBody3D = other.group.node as PhysicsBody3D
	a.remove_collision_exception_with(b)  # first in any case: Jolt keeps one for each time that it was added
	b.remove_collision_exception_with(a)
	if _is_excluded(one.group, other.group):
		a.add_collision_exception_with(b)
		b.add_collision_exception_with(a)


func _set_poses(poses: Dictionary, changed_regions: Array[AABB]) -> void:
	for id: String in poses:
		var body: MindstageBody = simulation.world_model.bodies.get(id)
		if body == null:
			push_error("Mindstage: the plan places a body '%s' that does not exist" % id)
			continue
		changed_regions.append(body.group.bounds())
		simulation.write_pose(body, poses[id])
		body.moved = true
		if body.group.id == id:
			body.group.put(body.last_transform)
		changed_regions.append(body.group.bounds())


## Wakes sleeping groups near changes.
func _wake(changed_regions: Array[AABB]) -> void:
	if changed_regions.is_empty() or Engine.is_editor_hint():
		return
	var regions: Array[AABB] = []
	for box: AABB in changed_regions:
		if regions.size() < _MAX_REGIONS:
			regions.append(box.grow(0.02))
		else:
			regions[-1] = regions[-1].merge(box.grow(0.02))
	for group: MindstageRigidGroup in dynamic_groups():
		var box: AABB = group.bounds()
		if regions.any(func(region: AABB) -> bool: return region.intersects(box)):
			group.wake()


## Removes a node; in the editor it is kept for undo.
static func discard(node: Node) -> void:
	if node.get_parent() != null:
		node.get_parent().remove_child(node)
	if not Engine.is_editor_hint():
		node.queue_free()
