@tool
class_name MindstageCarrier
extends RefCounted
## What moves as one: a physics node, and the bodies whose solids it has.
##
## A body that stands still, or that a program moves, has one of its own. Bodies that hang rigidly on one that the
## physics moves share that one's.

## Collision layers: what moves, what stands still. All of it touches what moves.
const MOVING: int = 1
const STILL: int = 2
## Of the speed of what a joint holds, this part is lost in a second [1/s].
const HELD_DAMPING: float = 1.0

var id: String
var node: CollisionObject3D:
	set(its_node):
		node = its_node
		body = node.get_rid()
## What the physics calls it.
var body: RID
var members: Array[MindstageBody] = []
## How much of gravity it feels where nothing holds it.
var falls: float = 1.0
## Where the physics had it when its bodies' poses were written down.
var last: Transform3D


## Whether the physics moves it.
func simulates() -> bool:
	return node is RigidBody3D


## Where it is now, as the physics has it.
func place() -> Transform3D:
	if simulates() and not Engine.is_editor_hint():
		return PhysicsServer3D.body_get_state(node.get_rid(), PhysicsServer3D.BODY_STATE_TRANSFORM)
	return node.transform


## Puts it somewhere, at rest. What is kinematic is not dragged there: it is there.
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
	last = place()


## Lets it feel what changed around it.
func wake() -> void:
	var rigid: RigidBody3D = node as RigidBody3D
	if rigid != null:
		PhysicsServer3D.body_set_state(rigid.get_rid(), PhysicsServer3D.BODY_STATE_SLEEPING, false)


## The velocity of a point of it, in the world.
func velocity_at(point: Vector3) -> Vector3:
	var rigid: RigidBody3D = node as RigidBody3D
	if rigid == null:
		return Vector3.ZERO
	var middle: Vector3 = place() * MindstageMatter.middle(self)
	return linear_velocity() + angular_velocity().cross(point - middle)


## Of its centre of mass.
func linear_velocity() -> Vector3:
	return _state(PhysicsServer3D.BODY_STATE_LINEAR_VELOCITY) if simulates() else Vector3.ZERO


## How fast it turns, and about what.
func angular_velocity() -> Vector3:
	return _state(PhysicsServer3D.BODY_STATE_ANGULAR_VELOCITY) if simulates() else Vector3.ZERO


## Lets a joint to something that stands still carry it, or not. A held one does not lean on what it only touches: a
## door whose lower edge is on the floor would be held there by its weight.
func set_held(held: bool) -> void:
	var rigid: RigidBody3D = node as RigidBody3D
	if rigid != null:
		rigid.gravity_scale = 0.0 if held else falls
		rigid.linear_damp = HELD_DAMPING if held else 0.0
		rigid.angular_damp = HELD_DAMPING if held else 0.0


## The effective mass of all that moves with it [kg].
func mass_kg() -> float:
	var sum: float = 0.0
	for body: MindstageBody in members:
		sum += float(body.part.get("mass_kg", 0.0))
	return sum


## The box round it, in the world.
func bounds() -> AABB:
	var box: AABB = AABB(node.transform.origin, Vector3.ZERO)
	for body: MindstageBody in members:
		var size: Vector3 = MindstageFrames.extents(body.part.get("size", [0.1, 0.1, 0.1]))
		box = box.merge(node.transform * body.hold() * AABB(-size / 2.0, size))
	return box


func _state(which: PhysicsServer3D.BodyState) -> Vector3:
	return PhysicsServer3D.body_get_state(node.get_rid(), which)
