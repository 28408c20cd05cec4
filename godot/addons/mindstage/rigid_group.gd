@tool
class_name MindstageRigidGroup
extends RefCounted
## A rigid group: a physics node and the bodies whose collision shapes it has.
##
## A static or kinematic body has a group of its own. Bodies that are rigidly attached to a dynamic one share
## its group.

## Collision layers of dynamic and of fixed bodies. All bodies collide with dynamic ones.
const MOVING: int = 1
const FIXED: int = 2
## Collision layer of the ground plane. Only bodies that nothing connects with a fixed one collide with it.
const GROUND: int = 4
## Number of contacts that are observed of a group that actuators move.
const MAX_CONTACTS: int = 16
## Damping of groups that are connected to a fixed body by a joint [1/s].
const JOINT_DAMPING: float = 1.0

var id: String
var node: CollisionObject3D:
	set(its_node):
		node = its_node
		body = node.get_rid()
## The node's RID on the physics server.
var body: RID
var members: Array[MindstageBody] = []
## Gravity scale while it is not connected to a fixed body.
var gravity_factor: float = 1.0
## Its transform when the poses of its bodies were last recorded.
var last_transform: Transform3D


## Whether it is moved by the physics.
func is_dynamic() -> bool:
	return node is RigidBody3D


## Its current transform on the physics server.
func current_transform() -> Transform3D:
	if is_dynamic() and not Engine.is_editor_hint():
		return PhysicsServer3D.body_get_state(node.get_rid(), PhysicsServer3D.BODY_STATE_TRANSFORM)
	return node.transform


## Places it at rest. A kinematic body is made static meanwhile, so that it does not sweep other bodies along.
func put(there: Transform3D) -> void:
	if node is AnimatableBody3D and not Engine.is_editor_hint():
		PhysicsServer3D.body_set_mode(node.get_rid(), PhysicsServer3D.BODY_MODE_STATIC)
		node.transform = there
		node.force_update_transform()
		PhysicsServer3D.body_set_mode(node.get_rid(), PhysicsServer3D.BODY_MODE_KINEMATIC)
	else:
		node.transform = there
		node.force_update_transform()
	var rigid: RigidBody3D = node as RigidBody3D
	if rigid != null:
		rigid.linear_velocity = Vector3.ZERO
		rigid.angular_velocity = Vector3.ZERO
		wake()
	last_transform = current_transform()


## Wakes it from sleep.
func wake() -> void:
	var rigid: RigidBody3D = node as RigidBody3D
	if rigid != null:
		PhysicsServer3D.body_set_state(rigid.get_rid(), PhysicsServer3D.BODY_STATE_SLEEPING, false)


## The velocity at a point, both in world coordinates [m/s].
func velocity_at(point: Vector3) -> Vector3:
	var rigid: RigidBody3D = node as RigidBody3D
	if rigid == null:
		return Vector3.ZERO
	var center: Vector3 = current_transform() * MindstageMassProperties.center_of_mass(self)
	return linear_velocity() + angular_velocity().cross(point - center)


## The velocity of its center of mass [m/s].
func linear_velocity() -> Vector3:
	return _physics_state(PhysicsServer3D.BODY_STATE_LINEAR_VELOCITY) if is_dynamic() else Vector3.ZERO


## Its angular velocity [rad/s].
func angular_velocity() -> Vector3:
	return _physics_state(PhysicsServer3D.BODY_STATE_ANGULAR_VELOCITY) if is_dynamic() else Vector3.ZERO


## Sets whether a joint connects it to a fixed body. The joint then carries its weight: with gravity, a door whose lower
## edge touches the floor would be held by friction.
func set_fixed_joint(fixed: bool) -> void:
	var rigid: RigidBody3D = node as RigidBody3D
	if rigid != null:
		rigid.gravity_scale = 0.0 if fixed else gravity_factor
		rigid.linear_damp = JOINT_DAMPING if fixed else 0.0
		rigid.angular_damp = JOINT_DAMPING if fixed else 0.0


## Sets whether actuators move it. It does not sleep then, and wakes what it lets go: a body that it held at rest would
## fall asleep in the air.
func set_driven(driven: bool) -> void:
	var rigid: RigidBody3D = node as RigidBody3D
	if rigid == null or rigid.contact_monitor == driven:
		return
	rigid.can_sleep = not driven
	rigid.max_contacts_reported = MAX_CONTACTS if driven else 0
	rigid.contact_monitor = driven
	if driven and not Engine.is_editor_hint():
		rigid.body_exited.connect(_wake_released)
	elif rigid.body_exited.is_connected(_wake_released):
		rigid.body_exited.disconnect(_wake_released)


static func _wake_released(other: Node) -> void:
	var rigid: RigidBody3D = other as RigidBody3D
	if rigid != null:
		PhysicsServer3D.body_set_state(rigid.get_rid(), PhysicsServer3D.BODY_STATE_SLEEPING, false)


## The mass of all members [kg].
func mass_kg() -> float:
	var sum: float = 0.0
	for body: MindstageBody in members:
		sum += float(body.physics_model.get("mass_kg", 0.0))
	return sum


## Its bounding box in world coordinates.
func bounds() -> AABB:
	var box: AABB = AABB(node.transform.origin, Vector3.ZERO)
	for body: MindstageBody in members:
		var size: Vector3 = MindstageFrames.extents(body.physics_model.get("size", [0.1, 0.1, 0.1]))
		box = box.merge(node.transform * body.transform_in_group() * AABB(-size / 2.0, size))
	return box


func _physics_state(which: PhysicsServer3D.BodyState) -> Vector3:
	return PhysicsServer3D.body_get_state(node.get_rid(), which)
