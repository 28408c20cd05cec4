@tool
class_name MindstageDrive
extends RefCounted
## The actuator of one axis of a joint: `DriveModelDelta` of a plan, and its last effort.
##
## Godot's joints have motors with a target velocity and a largest force. Each tick the force is set to the effort of
## the servo, and the target to the velocity at which that effort would vanish within the tick: so the motor acts as the
## servo does, and however stiff it is, it does not overshoot.

const POSITION: String = "position"
const VELOCITY: String = "velocity"
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
var friction: float
## The last effort [N or Nm].
var effort: float = 0.0
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
		drive.friction = data.get("friction", 0.0)
		found.append(drive)
	return found


## The target velocity and the largest force of the motor for one tick; sets `effort`.
func motor(command: float, position: float, velocity: float) -> Vector2:
	var tick: float = MindstageClock.TICK_S
	var target: float = signf(command) * _UNREACHED
	effort = command
	if mode == POSITION:
		var rate: float = stiffness * tick + damping
		target = stiffness * (command - position) / rate if rate > 0.0 else 0.0
		effort = rate * (target - velocity)
	elif mode == VELOCITY:
		target = command
		effort = damping * (command - velocity)
	effort = clampf(effort, -effort_limit, effort_limit)
	return _with_friction(target, velocity)


func _with_friction(target: float, velocity: float) -> Vector2:
	if friction <= 0.0:
		return Vector2(target, absf(effort))
	if absf(velocity) < _STILL and absf(effort) <= friction:
		return Vector2(0.0, friction)
	var direction: float = signf(effort if absf(velocity) < _STILL else velocity)
	var rest: float = effort - direction * friction
	return Vector2(target if rest * effort > 0.0 else 0.0, absf(rest))
