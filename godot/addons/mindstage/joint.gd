@tool
class_name MindstageJoint
extends Generic6DOFJoint3D
## A joint of the map: the motion, limits, soft limits and friction of its six axes.
##
## Joint positions are measured from where the two frames coincide, so that the joint can be recreated at any time. Axes
## are those of ROS: twist rotates about x, swing 2 about y, swing 1 about z.

const FREE: int = 0
const LIMITED: int = 1
const LOCKED: int = 2
## Friction of linear axes: the acceleration that it resists in addition to weight [m/s²].
const SLIDE_FRICTION: float = 1.0
## The same for angular axes [rad/s²].
const HINGE_FRICTION: float = 2.0
## Factor of the weight that joint friction can hold.
const WEIGHT_HELD: float = 1.25
## Share of the error of a coupled joint that is removed in one tick.
const MIMIC_GAIN: float = 0.3
## Largest force [N] or torque [Nm] that moves a coupled joint.
const MIMIC_FORCE: float = 1000.0

## Smallest ratio of the masses of two weightless bodies that are locked to each other.
const LOCKED_MASS_RATIO: float = 0.2
## Parameters of springs: stiffness, damping, equilibrium.
const LINEAR_SPRING: Array[int] = [
	PhysicsServer3D.G6DOF_JOINT_LINEAR_SPRING_STIFFNESS,
	PhysicsServer3D.G6DOF_JOINT_LINEAR_SPRING_DAMPING,
	PhysicsServer3D.G6DOF_JOINT_LINEAR_SPRING_EQUILIBRIUM_POINT,
]
const ANGULAR_SPRING: Array[int] = [
	PhysicsServer3D.G6DOF_JOINT_ANGULAR_SPRING_STIFFNESS,
	PhysicsServer3D.G6DOF_JOINT_ANGULAR_SPRING_DAMPING,
	PhysicsServer3D.G6DOF_JOINT_ANGULAR_SPRING_EQUILIBRIUM_POINT,
]
## The flags that enable springs and motors, of linear and of angular axes.
const SPRING_FLAGS: Array[int] = [
	PhysicsServer3D.G6DOF_JOINT_FLAG_ENABLE_LINEAR_SPRING, PhysicsServer3D.G6DOF_JOINT_FLAG_ENABLE_ANGULAR_SPRING
]
const MOTOR_FLAGS: Array[int] = [
	PhysicsServer3D.G6DOF_JOINT_FLAG_ENABLE_LINEAR_MOTOR, PhysicsServer3D.G6DOF_JOINT_FLAG_ENABLE_MOTOR
]

## The joint's frame relative to the nodes of its two groups.
@export var frame_a: Transform3D
@export var frame_b: Transform3D
## For x, y, z, twist, swing 2, swing 1: motion, limit, center of the range, stiffness and damping of a soft limit. A
## limit with stiffness 0 is hard.
@export var axes: Array[PackedFloat64Array] = []
@export var collide_connected: bool = false
## The id of the joint that this one follows, or an empty string.
@export var mimics: String = ""
## The position is this factor times that of the followed joint, plus the offset.
@export var mimic_multiplier: float = 1.0
@export var mimic_offset: float = 0.0

## The actuators of its axes.
var drives: Array[MindstageDrive] = []
## Whether it has actuators, or follows a joint that has some: then it has no friction of its own.
var is_driven: bool = false

var group_a: MindstageRigidGroup
var group_b: MindstageRigidGroup


## Whether any limit is soft; its spring force is applied at each tick.
func is_soft() -> bool:
	return axes.any(func(axis: PackedFloat64Array) -> bool: return axis[0] == LIMITED and axis[3] > 0.0)


## The parameters of the six axes from a joint's description.
static func axes_of(joint_data: Dictionary) -> Array[PackedFloat64Array]:
	var linear: Dictionary = joint_data.get("linear", {})
	var angular: Dictionary = joint_data.get("angular", {})
	var found: Array[PackedFloat64Array] = []
	for name: String in ["x", "y", "z"]:
		found.append(_axis(linear, name, "limit", linear.get("soft_limit", {})))
	for name: String in ["twist", "swing2", "swing1"]:
		var soft: Dictionary = angular.get("twist_soft_limit" if name == "twist" else "swing_soft_limit", {})
		found.append(_axis(angular, name, name + "_limit", soft))
	return found


static func _axis(motions: Dictionary, name: String, limit: String, soft: Dictionary) -> PackedFloat64Array:
	var stiffness: float = soft.get("stiffness", 0.0) if soft.get("enabled", false) else 0.0
	var axis: PackedFloat64Array = [
		motions.get(name, LOCKED),
		motions.get(limit, 0.0),
		motions.get(name + "_middle", 0.0),
		stiffness,
		soft.get("damping", 0.0),
	]
	if axis[0] == LIMITED and axis[1] <= 0.0:
		axis[0] = LOCKED
	return axis


## Sets the node paths that are stored in the scene.
func set_node_paths() -> void:
	node_a = get_path_to(group_a.node)
	node_b = get_path_to(group_b.node)


## Creates the joint on the physics server.
func create() -> void:
	_set_own_limits()
	if Engine.is_editor_hint() or group_a == null or group_b == null:
		return
	var joint: RID = get_rid()
	PhysicsServer3D.joint_make_generic_6dof(joint, group_a.node.get_rid(), frame_a, group_b.node.get_rid(), frame_b)
	PhysicsServer3D.joint_disable_collisions_between_bodies(joint, not collide_connected)
	var frictions: PackedFloat64Array = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0] if is_driven else _frictions()
	for axis: int in 3:
		_limit_on_server(joint, axis, axes[axis], axes[3 + axis])
		_resist(joint, axis, frictions)


## The joint position: x, y, z [m], twist, swing 2, swing 1 [rad].
func joint_position() -> PackedFloat64Array:
	var relative: Transform3D = (
		(group_a.current_transform() * frame_a).affine_inverse() * (group_b.current_transform() * frame_b)
	)
	var orientation: Quaternion = relative.basis.get_rotation_quaternion()
	var angles: Vector3 = _angles(orientation)
	var at: Vector3 = relative.origin
	return [at.x, at.y, at.z, angles.x, angles.y, angles.z]


## The first axis that is not locked, or -1.
func first_axis() -> int:
	for index: int in axes.size():
		if axes[index][0] != LOCKED:
			return index
	return -1


## Drives the motor of the first axis towards the position that the followed joint gives it, for one tick.
func follow(master: MindstageJoint) -> void:
	var axis: int = first_axis()
	if master == null or axis < 0 or master.first_axis() < 0 or not get_rid().is_valid():
		return
	var target: float = mimic_multiplier * master.joint_position()[master.first_axis()] + mimic_offset
	var error: float = target - joint_position()[axis]
	_set_motor(axis, MIMIC_GAIN * error / MindstageClock.TICK_S, MIMIC_FORCE)
	if absf(error) > 1e-5:
		wake()


## Wakes both ends from sleep.
func wake() -> void:
	for end: MindstageRigidGroup in [group_a, group_b]:
		end.wake()


## Exerts the effort of an actuator for one tick.
func exert(drive: MindstageDrive, command: float) -> void:
	if not get_rid().is_valid():
		return
	drive.last_position = drive_position(drive)
	drive.update(command, drive.last_position, velocity_along(drive.axis))
	var kind: int = 0 if drive.axis < 3 else 1
	var flag: Callable = PhysicsServer3D.generic_6dof_joint_set_flag
	flag.call(get_rid(), drive.axis % 3, MOTOR_FLAGS[kind], not drive.is_spring)
	flag.call(get_rid(), drive.axis % 3, SPRING_FLAGS[kind], drive.is_spring)
	if drive.is_spring:
		_set_spring(drive)
	else:
		_set_motor(drive.axis, drive.target_velocity, drive.force)


## The position of an actuator, in which full turns are counted [m or rad].
func drive_position(drive: MindstageDrive) -> float:
	var now: float = joint_position()[drive.axis]
	if drive.axis < 3 or is_nan(drive.last_position):
		return now
	return drive.last_position + wrapf(now - drive.last_position, -PI, PI)


## Takes over the full turns that the actuators of an earlier node of this joint have counted.
func keep_turns(earlier: MindstageJoint) -> void:
	for drive: MindstageDrive in drives:
		for other: MindstageDrive in earlier.drives:
			if other.axis == drive.axis:
				drive.last_position = other.last_position


## Moves the frames of a joint with a linear drive to the height of the center of mass, if that changes nothing else: a
## base that was pushed at its foot would tilt within the solver's accuracy.
func center_frames() -> void:
	if not drives.any(func(each: MindstageDrive) -> bool: return each.axis < 3):
		return
	var free: Array = range(3).filter(func(index: int) -> bool: return axes[3 + index][0] != LOCKED)
	if free.size() > 1:
		return
	var end: MindstageRigidGroup = group_b if group_b.is_dynamic() else group_a
	var frame: Transform3D = frame_b if end == group_b else frame_a
	var center: Vector3 = frame.affine_inverse() * MindstageMassProperties.center_of_mass(end)
	if free.size() == 1:
		var axis: Vector3 = Vector3.ZERO
		axis[free[0]] = 1.0
		center = axis * center.dot(axis)
	frame_a = frame_a.translated_local(center)
	frame_b = frame_b.translated_local(center)


## Adds the inertia of the drives to the weightless body that they move, about all axes, and has a part of it in the
## one that carries them: without it, the light links at the end of an arm tremble.
func add_armature() -> void:
	if not group_b.is_dynamic() or group_b.gravity_factor > 0.0:
		return
	var rigid: RigidBody3D = group_b.node as RigidBody3D
	for drive: MindstageDrive in drives:
		if drive.axis < 3:
			rigid.mass += drive.armature
		elif drive.armature > 0.0:
			rigid.inertia = MindstageMassProperties.current_moments(group_b) + drive.armature * Vector3.ONE
			MindstageMassProperties.raise_moments(group_a, LOCKED_MASS_RATIO * drive.armature)


## Makes a light weightless body heavier that is locked to a heavy one, as links of robots are that only carry
## others. The solver cannot hold bodies together whose masses or moments differ by orders of magnitude, least of all if
## the drive of the next link acts on the light one.
func balance_locked() -> void:
	if axes.any(func(axis: PackedFloat64Array) -> bool: return axis[0] != LOCKED):
		return
	if not (group_a.is_dynamic() and group_b.is_dynamic()):
		return
	if group_a.gravity_factor <= 0.0 and group_b.gravity_factor <= 0.0:
		_balance(group_a, group_b)
		_balance(group_b, group_a)


## Raises mass and moments of one body to a part of those of another.
static func _balance(light: MindstageRigidGroup, heavy: MindstageRigidGroup) -> void:
	var rigid: RigidBody3D = light.node as RigidBody3D
	var other: RigidBody3D = heavy.node as RigidBody3D
	# The axes of the two may differ.
	var moments: Vector3 = MindstageMassProperties.current_moments(heavy)
	MindstageMassProperties.raise_moments(light, LOCKED_MASS_RATIO * moments[moments.max_axis_index()])
	rigid.mass = maxf(rigid.mass, LOCKED_MASS_RATIO * other.mass)


## The velocity along or about an axis [m/s or rad/s].
func velocity_along(axis: int) -> float:
	var direction: Vector3 = (group_a.current_transform() * frame_a).basis[axis % 3]
	if axis >= 3:
		return direction.dot(group_b.angular_velocity() - group_a.angular_velocity())
	var point: Vector3 = group_b.current_transform() * frame_b.origin
	return direction.dot(group_b.velocity_at(point) - group_a.velocity_at(point))


func _set_spring(drive: MindstageDrive) -> void:
	var is_linear: bool = drive.axis < 3
	# Godot's angles are of the first body relative to the second.
	var rest: float = drive.equilibrium if is_linear else -wrapf(drive.equilibrium, -PI, PI)
	var values: PackedFloat64Array = [drive.spring_stiffness, drive.spring_damping, rest]
	for index: int in 3:
		var param: int = LINEAR_SPRING[index] if is_linear else ANGULAR_SPRING[index]
		PhysicsServer3D.generic_6dof_joint_set_param(get_rid(), drive.axis % 3, param, values[index])


func _set_motor(axis: int, velocity: float, force: float) -> void:
	var param: Callable = PhysicsServer3D.generic_6dof_joint_set_param
	if axis < 3:
		param.call(get_rid(), axis, PhysicsServer3D.G6DOF_JOINT_LINEAR_MOTOR_TARGET_VELOCITY, velocity)
		param.call(get_rid(), axis, PhysicsServer3D.G6DOF_JOINT_LINEAR_MOTOR_FORCE_LIMIT, force)
	else:
		# Godot's angles are of the first body relative to the second.
		param.call(get_rid(), axis - 3, PhysicsServer3D.G6DOF_JOINT_ANGULAR_MOTOR_TARGET_VELOCITY, -velocity)
		param.call(get_rid(), axis - 3, PhysicsServer3D.G6DOF_JOINT_ANGULAR_MOTOR_FORCE_LIMIT, force)


## Applies the spring and damping forces of exceeded soft limits for one tick.
func apply_soft_limits() -> void:
	var now: PackedFloat64Array = joint_position()
	var frame: Transform3D = group_a.current_transform() * frame_a
	var point: Vector3 = group_b.current_transform() * frame_b.origin
	var speed: Vector3 = group_b.velocity_at(point) - group_a.velocity_at(point)
	var spin: Vector3 = group_b.angular_velocity() - group_a.angular_velocity()
	for index: int in 6:
		var axis: PackedFloat64Array = axes[index]
		var offset: float = now[index] - axis[2]
		if axis[0] != LIMITED or axis[3] <= 0.0 or absf(offset) <= axis[1]:
			continue
		var direction: Vector3 = frame.basis[index % 3]
		var rate: float = direction.dot(speed if index < 3 else spin)
		var force: float = -axis[3] * (offset - signf(offset) * axis[1]) - axis[4] * rate
		_apply_soft_force(direction * force, point, index < 3)


func _apply_soft_force(force: Vector3, point: Vector3, is_linear: bool) -> void:
	for end: MindstageRigidGroup in [group_b, group_a]:
		if end.is_dynamic():
			var signed_force: Vector3 = force if end == group_b else -force
			var state: PhysicsDirectBodyState3D = PhysicsServer3D.body_get_direct_state(end.node.get_rid())
			if is_linear:
				state.apply_force(signed_force, point - state.transform.origin)
			else:
				state.apply_torque(signed_force)


func _angles(orientation: Quaternion) -> Vector3:
	var free_axes: Array[int] = []
	for index: int in 3:
		if axes[3 + index][0] != LOCKED:
			free_axes.append(index)
	var angles: Vector3 = Vector3.ZERO
	if free_axes.size() == 1:
		var axis: int = free_axes[0]
		angles[axis] = wrapf(2.0 * atan2([orientation.x, orientation.y, orientation.z][axis], orientation.w), -PI, PI)
	elif free_axes.size() > 1:
		angles = Vector3(
			atan2(
				2.0 * (orientation.w * orientation.x + orientation.y * orientation.z),
				1.0 - 2.0 * (orientation.x * orientation.x + orientation.y * orientation.y)
			),
			asin(clampf(2.0 * (orientation.w * orientation.y - orientation.z * orientation.x), -1.0, 1.0)),
			atan2(
				2.0 * (orientation.w * orientation.z + orientation.x * orientation.y),
				1.0 - 2.0 * (orientation.y * orientation.y + orientation.z * orientation.z)
			)
		)
	return angles


## Lower and upper limit of an axis; lower is greater than upper if it is unlimited.
static func _range(axis: PackedFloat64Array, sign_of_axis: float) -> Vector2:
	if axis[0] == LOCKED:
		return Vector2.ZERO
	if axis[0] == FREE or axis[3] > 0.0:
		return Vector2(1.0, -1.0)
	var middle: float = sign_of_axis * axis[2]
	return Vector2(middle - axis[1], middle + axis[1])


static func _limit_on_server(joint: RID, axis: int, linear: PackedFloat64Array, angular: PackedFloat64Array) -> void:
	var linear_range: Vector2 = _range(linear, 1.0)
	var orientation: Vector2 = _range(angular, -1.0)  # Godot's angles are of the first body relative to the second
	var param: Callable = PhysicsServer3D.generic_6dof_joint_set_param
	param.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_LINEAR_LOWER_LIMIT, linear_range.x)
	param.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_LINEAR_UPPER_LIMIT, linear_range.y)
	param.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_ANGULAR_LOWER_LIMIT, orientation.x)
	param.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_ANGULAR_UPPER_LIMIT, orientation.y)
	var flag: Callable = PhysicsServer3D.generic_6dof_joint_set_flag
	flag.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_FLAG_ENABLE_LINEAR_LIMIT, linear_range.x <= linear_range.y)
	flag.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_FLAG_ENABLE_ANGULAR_LIMIT, orientation.x <= orientation.y)


func _resist(joint: RID, axis: int, frictions: PackedFloat64Array) -> void:
	var param: Callable = PhysicsServer3D.generic_6dof_joint_set_param
	param.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_LINEAR_MOTOR_TARGET_VELOCITY, 0.0)
	param.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_LINEAR_MOTOR_FORCE_LIMIT, frictions[axis])
	param.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_ANGULAR_MOTOR_TARGET_VELOCITY, 0.0)
	param.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_ANGULAR_MOTOR_FORCE_LIMIT, frictions[3 + axis])
	var flag: Callable = PhysicsServer3D.generic_6dof_joint_set_flag
	flag.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_FLAG_ENABLE_LINEAR_MOTOR, axes[axis][0] != LOCKED)
	flag.call(joint, axis, PhysicsServer3D.G6DOF_JOINT_FLAG_ENABLE_MOTOR, axes[3 + axis][0] != LOCKED)


## The friction of each axis [N or Nm].
func _frictions() -> PackedFloat64Array:
	var frictions: PackedFloat64Array = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
	var gravity: Vector3 = (
		ProjectSettings.get_setting("physics/3d/default_gravity", 9.81)
		* ProjectSettings.get_setting("physics/3d/default_gravity_vector", Vector3.DOWN)
	)
	for index: int in 6:
		var smallest: float = INF
		for end: MindstageRigidGroup in [group_a, group_b]:
			if end.is_dynamic():
				smallest = minf(smallest, _friction_of(end, frame_a if end == group_a else frame_b, index, gravity))
		frictions[index] = smallest if is_finite(smallest) else 0.0
	return frictions


func _friction_of(end: MindstageRigidGroup, frame: Transform3D, index: int, gravity: Vector3) -> float:
	var xform: Transform3D = end.current_transform()
	var axis: Vector3 = xform.basis * frame.basis[index % 3]
	var mass: float = end.mass_kg()
	var weight: Vector3 = gravity * mass * (end.node as RigidBody3D).gravity_scale
	if index < 3:
		return SLIDE_FRICTION * mass + WEIGHT_HELD * absf(axis.dot(weight))
	var lever: Vector3 = xform * MindstageMassProperties.center_of_mass(end) - xform * frame.origin
	var inertia: float = MindstageMassProperties.inertia_about(end, frame.origin, frame.basis[index % 3])
	return HINGE_FRICTION * inertia + WEIGHT_HELD * absf(axis.dot(lever.cross(weight)))


## Sets the node's own limits, which are shown in the inspector and saved.
func _set_own_limits() -> void:
	exclude_nodes_from_collision = not collide_connected
	for index: int in 3:
		var name_of_axis: String = ["x", "y", "z"][index]
		var linear_range: Vector2 = _range(axes[index], 1.0)
		var orientation: Vector2 = _range(axes[3 + index], -1.0)
		set("linear_limit_%s/enabled" % name_of_axis, linear_range.x <= linear_range.y)
		set("linear_limit_%s/lower_distance" % name_of_axis, linear_range.x)
		set("linear_limit_%s/upper_distance" % name_of_axis, linear_range.y)
		set("angular_limit_%s/enabled" % name_of_axis, orientation.x <= orientation.y)
		set("angular_limit_%s/lower_angle" % name_of_axis, orientation.x)
		set("angular_limit_%s/upper_angle" % name_of_axis, orientation.y)
