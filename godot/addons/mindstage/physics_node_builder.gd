@tool
class_name MindstagePhysicsNodeBuilder
extends RefCounted
## Creates and updates the physics nodes of rigid groups.
##
## A node of the right type is reused and keeps its pose, velocity and sleep state. In the editor each change creates a
## new node, so that undo can restore the old one.

## Default friction coefficient, as in MuJoCo; a contact uses the smaller one of both bodies.
const FRICTION: float = 0.8

## Smallest given moment of inertia [kg m²].
const MIN_INERTIA: float = 1e-5

static var _physics_materials: Dictionary[String, PhysicsMaterial] = {}


## Updates the node of a group to match its members; a new node is placed at `xform`.
static func build(group: MindstageRigidGroup, simulation: Node3D, xform: Transform3D) -> void:
	var body: MindstageBody = group.members[0]
	var mobility: String = body.physics_model.get("mobility", "static")
	var node: CollisionObject3D = group.node
	if node == null or not _matches(node, mobility) or Engine.is_editor_hint():
		node = _new_node(mobility)
		node.name = body.id.validate_node_name()
		node.transform = xform
		group.node = node
	else:
		_clear(node)
	_add_collision_shapes(group, node)
	if node is RigidBody3D:
		_set_mass(group, node as RigidBody3D)
	_set_material(body, node)
	if node.get_parent() == null:
		simulation.add_child(node)


static func _new_node(mobility: String) -> CollisionObject3D:
	match mobility:
		"dynamic":
			var rigid: RigidBody3D = RigidBody3D.new()
			rigid.continuous_cd = true  # fast bodies would tunnel through thin walls and shelves
			return rigid
		"kinematic":
			var animatable: AnimatableBody3D = AnimatableBody3D.new()
			animatable.sync_to_physics = false
			return animatable
	return StaticBody3D.new()


static func _matches(node: CollisionObject3D, mobility: String) -> bool:
	if node is RigidBody3D:
		return mobility == "dynamic"
	return (node is AnimatableBody3D) == (mobility == "kinematic") and mobility != "dynamic"


static func _clear(node: CollisionObject3D) -> void:
	for child: Node in node.get_children():
		if child is CollisionShape3D:  # from a saved scene
			node.remove_child(child)
			child.queue_free()
	for owner_of_shapes: int in node.get_shape_owners():
		node.remove_shape_owner(owner_of_shapes)


static func _add_collision_shapes(group: MindstageRigidGroup, node: CollisionObject3D) -> void:
	var collides: bool = false
	for body: MindstageBody in group.members:
		collides = collides or not body.physics_model.get("ghost", false)
	for body: MindstageBody in group.members:
		if collides and body.physics_model.get("ghost", false):
			continue
		var group_from_body: Transform3D = body.transform_in_group()
		for shape_data: Dictionary in body.collision_shapes():
			var xform: Transform3D = group_from_body * MindstageCollisionShapes.shape_transform(shape_data)
			if Engine.is_editor_hint():
				_add_shape_node(node, MindstageCollisionShapes.shape(shape_data), xform)
			else:
				_add_shape(node, MindstageCollisionShapes.shape(shape_data), xform)
	var layer: int = MindstageRigidGroup.MOVING if node is RigidBody3D else MindstageRigidGroup.FIXED
	node.collision_layer = layer if collides else 0
	node.collision_mask = MindstageRigidGroup.FIXED | MindstageRigidGroup.MOVING if collides else 0
	if collides and group.members[0].physics_model.get("on_ground", false):
		node.collision_mask |= MindstageRigidGroup.GROUND


## Adds a shape without a node: faster than `CollisionShape3D` when the scene runs.
static func _add_shape(node: CollisionObject3D, shape: Shape3D, xform: Transform3D) -> void:
	var owner_of_shapes: int = node.create_shape_owner(node)
	if xform != Transform3D.IDENTITY:
		node.shape_owner_set_transform(owner_of_shapes, xform)
	node.shape_owner_add_shape(owner_of_shapes, shape)


## Adds a `CollisionShape3D` node for each shape of a physics node, for saving the scene.
static func add_shape_nodes(of: CollisionObject3D, to: Node) -> void:
	for owner_of_shapes: int in of.get_shape_owners():
		var xform: Transform3D = of.shape_owner_get_transform(owner_of_shapes)
		for index: int in of.shape_owner_get_shape_count(owner_of_shapes):
			_add_shape_node(to, of.shape_owner_get_shape(owner_of_shapes, index), xform)


static func _add_shape_node(node: Node, shape: Shape3D, xform: Transform3D) -> void:
	var node_of_shape: CollisionShape3D = CollisionShape3D.new()
	node_of_shape.shape = shape
	node_of_shape.transform = xform
	node.add_child(node_of_shape)


static func _set_mass(group: MindstageRigidGroup, node: RigidBody3D) -> void:
	var mass: float = 0.0
	var falling_mass: float = 0.0
	for body: MindstageBody in group.members:
		var body_mass: float = body.physics_model.get("mass_kg", 0.0)
		mass += body_mass
		falling_mass += body_mass if body.physics_model.get("gravity", true) else 0.0
	node.mass = maxf(mass, 0.001)
	group.gravity_factor = falling_mass / mass if mass > 0.0 else 1.0
	if node.gravity_scale != group.gravity_factor:
		node.gravity_scale = group.gravity_factor
	var has_inertia: bool = group.members.any(func(each: MindstageBody) -> bool: return not each.inertia().is_empty())
	node.inertia = MindstageMassProperties.moments(group).maxf(MIN_INERTIA) if has_inertia else Vector3.ZERO
	if group.members.size() > 1 or has_inertia:
		node.center_of_mass_mode = RigidBody3D.CENTER_OF_MASS_MODE_CUSTOM
		node.center_of_mass = MindstageMassProperties.center_of_mass(group)
	elif node.center_of_mass_mode != RigidBody3D.CENTER_OF_MASS_MODE_AUTO:
		node.center_of_mass_mode = RigidBody3D.CENTER_OF_MASS_MODE_AUTO


static func _set_material(body: MindstageBody, node: CollisionObject3D) -> void:
	var friction: Variant = body.physics_model.get("friction")
	var restitution: Variant = body.physics_model.get("restitution")
	var key: String = "%s %s" % [friction, restitution]
	if not _physics_materials.has(key):
		var surface: PhysicsMaterial = PhysicsMaterial.new()
		surface.friction = FRICTION if friction == null else float(friction)
		surface.bounce = 0.0 if restitution == null else clampf(restitution, 0.0, 1.0)
		_physics_materials[key] = surface
	node.set("physics_material_override", _physics_materials[key])
