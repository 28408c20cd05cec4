@tool
class_name MindstageClock
extends Node
## Time: it passes by itself at some speed, or tick by tick and only when asked to.
##
## Godot has no call that steps its physics. But its main loop runs as many ticks in a frame as the tick rate asks for,
## whatever time has really passed. So for a run the rate is set very high, with a time scale that keeps each tick as
## long as it shall be, and the physics space is switched off but for the ticks that were asked for.

## A run is over.
signal finished
## A tick of the physics is about to be made.
signal ticking

## How long a tick is [s].
const TICK_S: float = 1.0 / 240.0
const _RATE: int = 1_000_000
## More in a frame, and Jolt runs out of jobs.
const _MOST_A_FRAME: int = 16

## How many ticks have passed.
var ticks: int = 0
## How fast time passes by itself; 0 is not at all.
var speed: float = 1.0

var _left: int = 0
var _running: bool = false
var _owed_s: float = 0.0
var _rate_before: int
var _most_before: int


func _enter_tree() -> void:
	_rate_before = Engine.physics_ticks_per_second
	_most_before = Engine.max_physics_steps_per_frame
	_set_pace()


func _exit_tree() -> void:
	Engine.physics_ticks_per_second = _rate_before
	Engine.max_physics_steps_per_frame = _most_before
	Engine.time_scale = 1.0
	_left = 0
	_keep_still(false)


## What time it is [s].
func time_s() -> float:
	return ticks * TICK_S


## Lets so much time pass; what is less than a tick is kept for the next time. Returns when it has passed.
func run(duration_s: float) -> void:
	_owed_s += duration_s
	var count: int = int(_owed_s / TICK_S + 1e-6)
	if count <= 0:
		return
	_owed_s = maxf(0.0, _owed_s - count * TICK_S)
	_left = count
	_running = true
	Engine.physics_ticks_per_second = _RATE
	Engine.max_physics_steps_per_frame = mini(count, _MOST_A_FRAME)
	Engine.time_scale = _RATE * TICK_S
	_keep_still(false)
	await finished


## Lets time pass by itself, so many seconds in a second; gives how fast it passed before.
func play(how_fast: float) -> float:
	var before: float = speed
	speed = how_fast
	_set_pace()
	return before


func _physics_process(_delta: float) -> void:
	if Engine.is_editor_hint():
		return
	if _left == 0 and (speed == 0.0 or _running):
		_keep_still(true)
		return
	ticks += 1
	_left = maxi(0, _left - 1)
	ticking.emit()


func _process(_delta: float) -> void:
	if _left == 0 and _running:
		_running = false
		_set_pace()
		finished.emit()


func _set_pace() -> void:
	if Engine.is_editor_hint():
		return
	var pace: float = speed if speed > 0.0 else 1.0
	Engine.physics_ticks_per_second = roundi(pace / TICK_S)
	Engine.time_scale = Engine.physics_ticks_per_second * TICK_S
	Engine.max_physics_steps_per_frame = maxi(8, ceili(pace * 16.0))
	_keep_still(speed == 0.0)


func _keep_still(still: bool) -> void:
	if not Engine.is_editor_hint() and is_inside_tree():
		PhysicsServer3D.space_set_active(get_viewport().find_world_3d().space, not still)
