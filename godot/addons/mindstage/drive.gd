@tool
class_name MindstageDrive
extends RefCounted
## The actuator of one axis of a joint: `DriveModelDelta` of a plan, and its last effort.
##
## Godot's joints have springs without a largest force, which are integrated implicitly so that stiff ones are stable,
## and motors with a target velocity and a largest force. A servo is a spring, unless its effort is limited: then it is
## a motor with that force, whose target is the velocity at which the effort of the servo would vanish within a tick.

const POSITION: String = "position"
const VELOCITY: String = "velocity"
const EFFORT: String = "effort"
## A velocity that is not reached within a tick [m/s or rad/s].
const _UNREACHED: float = 1000.0
## Below this velocity dry friction holds a joint [m/s or rad/s].
const _STILL: float = 1e-3

var name: String
## 0 to 5: x, y, z, twist, swing 2, swing 1.
var axis: int
## The meaning of the command: "position", "velocity" or "effort".
var mode: String
var effort_limit: float
var stiffness: float
var damping: float
## Inertia of the drive, as seen at the joint [kg] or [kg m²].
var armature: float
var friction: float
## The last effort [N or Nm].
var effort: float = 0.0
## Whether it is a spring in this tick, otherwise a motor.
var is_spring: bool = false
var spring_stiffness: float = 0.0
var spring_damping: float = 0.0
## The position of the spring without load [m or rad].
var equilibrium: float = 0.0
## The target of the motor [m/s or rad/s], and its largest force [N or Nm].
var target_velocity: float = 0.0
var force: float = 0.0
## The last position [m or rad]; NaN before the first tick.
var last_position: float = NAN


## Reads the actuators of a joint.
static func from_frames(frames: Dictionary) -> Array[MindstageDrive]:
	var found: Array[MindstageDrive] = []
	for data: Dictionary in frames.get("drives", []):
		var drive: MindstageDrive = MindstageDrive.new()
		drive.name = data["name"]
		drive.axis = int(data["axis"])
		drive.mode = data["mode"]
		drive.effort_limit = data["effort_limit"]
		drive.stiffness = data.get("stiffness", 0.0)
		drive.damping = data.get("damping", 0.0)
		drive.armature = data.get("armature", 0.0)
		drive.friction = data.get("friction", 0.0)
		found.append(drive)
	return found


## Computes what the joint exerts in the next tick: `effort`, and either a spring or a motor.
func update(command: float, position: float, velocity: float) -> void:
	var tick: float = MindstageClock.TICK_S
	target_velocity = signf(command) * _UNREACHED
	effort = command
	if mode == POSITION:
		spring_stiffness = stiffness
		spring_damping = damping
		equilibrium = command
		var rate: float = stiffness * tick + damping
		target_velocity = stiffness * (command - position) / rate if rate > 0.0 else 0.0
		effort = stiffness * (command - position) - damping * velocity
	elif mode == VELOCITY:
		# With the velocity v after the tick, this spring exerts damping * (command - v).
		spring_stiffness = damping / tick
		spring_damping = 0.0
		equilibrium = position + command * tick
		target_velocity = command
		effort = damping * (command - velocity)
	is_spring = mode != EFFORT and absf(effort) <= effort_limit and friction <= 0.0
	effort = clampf(effort, -effort_limit, effort_limit)
	force = absf(effort)
	if friction > 0.0:
		_add_friction(velocity)


func _add_friction(velocity: float) -> void:
	if absf(velocity) < _STILL and absf(effort) <= friction:
		target_velocity = 0.0
		force = friction
		return
	var direction: float = signf(effort if absf(velocity) < _STILL else velocity)
	var rest: float = effort - direction * friction
	target_velocity = target_velocity if rest * effort > 0.0 else 0.0
	force = absf(rest)
