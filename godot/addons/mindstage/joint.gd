@tool
class_name MindstageJoint
extends Generic6DOFJoint3D
## A constraint of the map: what may move along and about which axis, how far, and how hard it is to move.
##
## Its ranges are about where the two frames coincide, so it can be made anew at any time without losing count. Its
## axes are ROS's: twist turns about x, swing 2 about y, swing 1 about z.

const FREE: int = 0
const LIMITED: int = 1
const LOCKED: int = 2
## A slide holds against what would accelerate it by this [m/s²], beside the weight that hangs on it.
const SLIDE_FRICTION: float = 1.0
## The same for hinges [rad/s²].
const HINGE_FRICTION: float = 2.0
## So much of its weight a joint can hold, to be on the safe side.
const WEIGHT_HELD: float = 1.25

## The joint's frame in either end's node.
@export var frame_a: Transform3D
@export var frame_b: Transform3D
## For x, y, z, twist, swing 2, swing 1: motion, limit, middle, stiffness, damping; no stiffness is a hard limit.
@export var axes: Array[PackedFloat64Array] = []
@export var lets_ends_collide: bool = false

var end_a: MindstageCarrier
var end_b: MindstageCarrier


## Whether any of its limits is a spring, which has to be held at each tick.
func is_soft() -> bool:
	return axes.any(func(axis: PackedFloat64Array) -> bool: return axis[0] == LIMITED and axis[3] > 0.0)


## Reads what a constraint says of its six axes.
static func axes_of(constraint: Dictionary) -> Array[PackedFloat64Array]:
	var linear: Dictionary = constraint.get("linear", {})
	var angular: Dictionary = constraint.get("angular", {})
	var found: Array[PackedFloat64Array] = []
	for name: String in ["x", "y", "z"]:
		found.append(_axis(linear, name, "limit", linear.get("soft", {})))
	for name: String in ["twist", "swing2", "swing1"]:
		var soft: Dictionary = angular.get("twist_soft" if name == "twist" else "swing_soft", {})
		found.append(_axis(angular, name, name + "_limit", soft))
	return found


static func _axis(motions: Dictionary, name: String, limit: String, soft: Dictionary) -> PackedFloat64Array:
	var spring: float = soft.get("stiffness", 0.0) if soft.get("enabled", false) else 0.0
	var axis: PackedFloat64Array = [
		motions.get(name, LOCKED),
		motions.get(limit, 0.0),
		motions.get(name + "_middle", 0.0),
		spring,
		soft.get("damping", 0.0),
	]
	if axis[0] == LIMITED and axis[1] <= 0.0:
		axis[0] = LOCKED
	return axis


## Says in the scene whom it joins.
func name_ends() -> void:
	node_a = get_path_to(end_a.node)
	node_b = get_path_to(end_b.node)


## Joins the two ends as they are now.
func join() -> void:
	_set_own_limits()
	if Engine.is_editor_hint() or end_a == null or end_b == null:
		return
	var joint: RID = get_rid()
	PhysicsServer3D.joint_make_generic_6dof(joint, end_a.node.get_rid(), frame_a, end_b.node.get_rid(), frame_b)
	PhysicsServer3D.joint_disable_collisions_between_bodies(joint, not lets_ends_collide)
	var frictions: PackedFloat64Array = _frictions()
	for axis: int in 3:
		_limit_on_server(joint, axis, axes[axis], axes[3 + axis])
		_resist(joint, axis, frictions)


## How far it has moved: x, y, z [m], twist, swing 2, swing 1 [rad].
func position_of_axes() -> PackedFloat64Array:
	var relative: Transform3D = (end_a.place() * frame_a).affine_inverse() * (end_b.place() * frame_b)
	var turn: Quaternion = relative.basis.get_rotation_quaternion()
	var angles: Vector3 = _angles(turn)
	var at: Vector3 = relative.origin
	return [at.x, at.y, at.z, angles.x, angles.y, angles.z]


## Pushes back what is beyond a soft limit, for one tick.
func hold_softly() -> void:
	var now: PackedFloat64Array = position_of_axes()
	var frame: Transform3D = end_a.place() * frame_a
	var point: Vector3 = end_b.place() * frame_b.origin
	var speed: Vector3 = end_b.velocity_at(point) - end_a.velocity_at(point)
	var spin: Vector3 = end_b.angular_velocity() - end_a.angular_velocity()
	for index: int in 6:
		var axis: PackedFloat64Array = axes[index]
		var beyond: float = now[index] - axis[2]
		if axis[0] != LIMITED or axis[3] <= 0.0 or absf(beyond) <= axis[1]:
			continue
		var direction: Vector3 = frame.basis[index % 3]
		var rate: float = direction.dot(speed if index < 3 else spin)
		var push: float = -axis[3] * (beyond - signf(beyond) * axis[1]) - axis[4] * rate
		_push_ends(direction * push, point, index < 3)


func _push_ends(push: Vector3, point: Vector3, slides: bool) -> void:
	for end: MindstageCarrier in [end_b, end_a]:
		if end.simulates():
			var signed: Vector3 = push if end == end_b else -push
			var state: PhysicsDirectBodyState3D = PhysicsServer3D.body_get_direct_state(end.node.get_rid())
			if slides:
				state.apply_force(signed, point - state.transform.origin)
			else:
				state.apply_torque(signed)


func _angles(turn: Quaternion) -> Vector3:
	var moving: Array[int] = []
	for index: int in 3:
		if axes[3 + index][0] != LOCKED:
			moving.append(index)
	var whole: Vector3 = Vector3.ZERO
	if moving.size() == 1:
		var about: int = moving[0]
		whole[about] = wrapf(2.0 * atan2([turn.x, turn.y, turn.z][about], turn.w), -PI, PI)
	elif moving.size() > 1:
		whole = Vector3(
			atan2(2.0 * (turn.w * turn.x + turn.y * turn.z), 1.0 - 2.0 * (turn.x * turn.x + turn.y * turn.y)),
			asin(clampf(2.0 * (turn.w * turn.y - turn.z * turn.x), -1.0, 1.0)),
			atan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y * turn.y + turn.z * turn.z))
		)
	return whole


## Lower and upper end of an axis; lower above upper where it is free.
static func _range(axis: PackedFloat64Array, sign_of_axis: float) -> Vector2:
	if axis[0] == LOCKED:
		return Vector2.ZERO
	if axis[0] == FREE or axis[3] > 0.0:
		return Vector2(1.0, -1.0)
	var middle: float = sign_of_axis * axis[2]
	return Vector2(middle - axis[1], middle + axis[1])


static func _limit_on_server(joint: RID, axis: int, linear: PackedFloat64Array, angular: PackedFloat64Array) -> void:
	var way: Vector2 = _range(linear, 1.0)
	var turn: Vector2 = _range(angular, -1.0)  # Godot turns the first end against the second
	var param: Callable = PhysicsServer3D.generic_6dof_joint_set_param
	param.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_LINEAR_LOWER_LIMIT, way.x)
	param.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_LINEAR_UPPER_LIMIT, way.y)
	param.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_ANGULAR_LOWER_LIMIT, turn.x)
	param.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_ANGULAR_UPPER_LIMIT, turn.y)
	var flag: Callable = PhysicsServer3D.generic_6dof_joint_set_flag
	flag.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_FLAG_ENABLE_LINEAR_LIMIT, way.x <= way.y)
	flag.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_FLAG_ENABLE_ANGULAR_LIMIT, turn.x <= turn.y)


func _resist(joint: RID, axis: int, frictions: PackedFloat64Array) -> void:
	var param: Callable = PhysicsServer3D.generic_6dof_joint_set_param
	param.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_LINEAR_MOTOR_TARGET_VELOCITY, 0.0)
	param.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_LINEAR_MOTOR_FORCE_LIMIT, frictions[axis])
	param.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_ANGULAR_MOTOR_TARGET_VELOCITY, 0.0)
	param.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_ANGULAR_MOTOR_FORCE_LIMIT, frictions[3 + axis])
	var flag: Callable = PhysicsServer3D.generic_6dof_joint_set_flag
	flag.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_FLAG_ENABLE_LINEAR_MOTOR, axes[axis][0] != LOCKED)
	flag.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_FLAG_ENABLE_MOTOR, axes[3 + axis][0] != LOCKED)


## What each axis holds against by itself [N or Nm].
func _frictions() -> PackedFloat64Array:
	var frictions: PackedFloat64Array = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
	var gravity: Vector3 = (
		ProjectSettings.get_setting("physics/3d/default_gravity", 9.81)
		* ProjectSettings.get_setting("physics/3d/default_gravity_vector", Vector3.DOWN)
	)
	for index: int in 6:
		var least: float = INF
		for end: MindstageCarrier in [end_a, end_b]:
			if end.simulates():
				least = minf(least, _friction_of(end, frame_a if end == end_a else frame_b, index, gravity))
		frictions[index] = least if is_finite(least) else 0.0
	return frictions


func _friction_of(end: MindstageCarrier, frame: Transform3D, index: int, gravity: Vector3) -> float:
	var place: Transform3D = end.place()
	var axis: Vector3 = place.basis * frame.basis[index % 3]
	var mass: float = end.mass_kg()
	var weight: Vector3 = gravity * mass * (end.node as RigidBody3D).gravity_scale
	if index < 3:
		return SLIDE_FRICTION * mass + WEIGHT_HELD * absf(axis.dot(weight))
	var lever: Vector3 = place * MindstageMatter.middle(end) - place * frame.origin
	var inertia: float = MindstageMatter.inertia_about(end, frame.origin, frame.basis[index % 3])
	return HINGE_FRICTION * inertia + WEIGHT_HELD * absf(axis.dot(lever.cross(weight)))


## What the inspector shows, and what a saved scene has.
func _set_own_limits() -> void:
	exclude_nodes_from_collision = not lets_ends_collide
	for index: int in 3:
		var name_of_axis: String = ["x", "y", "z"][index]
		var way: Vector2 = _range(axes[index], 1.0)
		var turn: Vector2 = _range(axes[3 + index], -1.0)
		set("linear_limit_%s/enabled" % name_of_axis, way.x <= way.y)
		set("linear_limit_%s/lower_distance" % name_of_axis, way.x)
		set("linear_limit_%s/upper_distance" % name_of_axis, way.y)
		set("angular_limit_%s/enabled" % name_of_axis, turn.x <= turn.y)
		set("angular_limit_%s/lower_angle" % name_of_axis, turn.x)
		set("angular_limit_%s/upper_angle" % name_of_axis, turn.y)
