@tool
class_name MindstageSpawner
extends RefCounted
## Makes the physics nodes of carriers, and makes them anew where their bodies changed.
##
## A node that can stay what it is stays: its pose, its velocity and its sleep with it. In the editor each change makes
## a new one, so that undo can bring the old one back.

## Of what nobody said anything about; of two that touch, the more slippery counts.
const FRICTION: float = 0.7

static var _surfaces: Dictionary[String, PhysicsMaterial] = {}


## Makes a carrier's node agree with its members; a new one stands at `place`.
static func build(carrier: MindstageCarrier, stage: Node3D, place: Transform3D) -> void:
	var body: MindstageBody = carrier.members[0]
	var mobility: String = body.part.get("mobility", "static")
	var node: CollisionObject3D = carrier.node
	if node == null or not _suits(node, mobility) or Engine.is_editor_hint():
		node = _new_node(mobility)
		node.name = body.id.validate_node_name()
		node.transform = place
		carrier.node = node
	else:
		_clear(node)
	_give_solids(carrier, node)
	if node is RigidBody3D:
		_give_mass(carrier, node as RigidBody3D)
	_give_surface(body, node)
	if node.get_parent() == null:
		stage.add_child(node)


static func _new_node(mobility: String) -> CollisionObject3D:
	match mobility:
		"dynamic":
			var moving: RigidBody3D = RigidBody3D.new()
			moving.continuous_cd = true  # walls and shelves are thin
			return moving
		"kinematic":
			var moved: AnimatableBody3D = AnimatableBody3D.new()
			moved.sync_to_physics = false
			return moved
	return StaticBody3D.new()


static func _suits(node: CollisionObject3D, mobility: String) -> bool:
	if node is RigidBody3D:
		return mobility == "dynamic"
	return (node is AnimatableBody3D) == (mobility == "kinematic") and mobility != "dynamic"


static func _clear(node: CollisionObject3D) -> void:
	for child: Node in node.get_children():
		if child is CollisionShape3D:  # of a scene that was saved
			node.remove_child(child)
			child.queue_free()
	for owner_of_shapes: int in node.get_shape_owners():
		node.remove_shape_owner(owner_of_shapes)


static func _give_solids(carrier: MindstageCarrier, node: CollisionObject3D) -> void:
	var touchable: bool = false
	for body: MindstageBody in carrier.members:
		touchable = touchable or not body.part.get("ghost", false)
	for body: MindstageBody in carrier.members:
		if touchable and body.part.get("ghost", false):
			continue
		var hold: Transform3D = body.hold()
		for solid: Dictionary in body.solids():
			var place: Transform3D = hold * MindstageSolids.place(solid)
			if Engine.is_editor_hint():
				_add_shape_node(node, MindstageSolids.shape(solid), place)
			else:
				_add_shape(node, MindstageSolids.shape(solid), place)
	var layer: int = MindstageCarrier.MOVING if node is RigidBody3D else MindstageCarrier.STILL
	node.collision_layer = layer if touchable else 0
	node.collision_mask = MindstageCarrier.STILL | MindstageCarrier.MOVING if touchable else 0


## What runs needs no nodes for its shapes, and is quicker without.
static func _add_shape(node: CollisionObject3D, shape: Shape3D, place: Transform3D) -> void:
	var owner_of_shapes: int = node.create_shape_owner(node)
	if place != Transform3D.IDENTITY:
		node.shape_owner_set_transform(owner_of_shapes, place)
	node.shape_owner_add_shape(owner_of_shapes, shape)


## Gives a node that is to be saved or edited the nodes of the shapes that another one has.
static func show_shapes(of: CollisionObject3D, to: Node) -> void:
	for owner_of_shapes: int in of.get_shape_owners():
		var place: Transform3D = of.shape_owner_get_transform(owner_of_shapes)
		for index: int in of.shape_owner_get_shape_count(owner_of_shapes):
			_add_shape_node(to, of.shape_owner_get_shape(owner_of_shapes, index), place)


static func _add_shape_node(node: Node, shape: Shape3D, place: Transform3D) -> void:
	var part: CollisionShape3D = CollisionShape3D.new()
	part.shape = shape
	part.transform = place
	node.add_child(part)


static func _give_mass(carrier: MindstageCarrier, node: RigidBody3D) -> void:
	var mass: float = 0.0
	var falling: float = 0.0
	for body: MindstageBody in carrier.members:
		var own: float = body.part.get("mass_kg", 0.0)
		mass += own
		falling += own if body.part.get("gravity", true) else 0.0
	node.mass = maxf(mass, 0.001)
	carrier.falls = falling / mass if mass > 0.0 else 1.0
	if node.gravity_scale != carrier.falls:
		node.gravity_scale = carrier.falls
	if carrier.members.size() > 1:
		node.center_of_mass_mode = RigidBody3D.CENTER_OF_MASS_MODE_CUSTOM
		node.center_of_mass = MindstageMatter.middle(carrier)
	elif node.center_of_mass_mode != RigidBody3D.CENTER_OF_MASS_MODE_AUTO:
		node.center_of_mass_mode = RigidBody3D.CENTER_OF_MASS_MODE_AUTO


static func _give_surface(body: MindstageBody, node: CollisionObject3D) -> void:
	var friction: Variant = body.part.get("friction")
	var restitution: Variant = body.part.get("restitution")
	var key: String = "%s %s" % [friction, restitution]
	if not _surfaces.has(key):
		var surface: PhysicsMaterial = PhysicsMaterial.new()
		surface.friction = FRICTION if friction == null else float(friction)
		surface.bounce = 0.0 if restitution == null else clampf(restitution, 0.0, 1.0)
		_surfaces[key] = surface
	node.set("physics_material_override", _surfaces[key])
