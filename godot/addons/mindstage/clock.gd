@tool
class_name MindstageClock
extends Node
## Simulation time: runs freely at a given speed, or for a given number of ticks.
##
## Godot has no function that steps its physics. But its main loop runs as many ticks per frame as the tick rate
## requires, regardless of the wall time. For a run the rate is set very high, with a time scale that keeps the length
## of a tick, and the physics space is inactive except for the requested ticks.

## A run has finished.
signal finished
## Emitted before each physics tick.
signal ticking

## Length of a tick [s].
const TICK_S: float = 1.0 / 240.0
const _RATE: int = 1_000_000
## With more ticks in one frame Jolt runs out of jobs.
const _MAX_TICKS_PER_FRAME: int = 16

## Number of ticks since the start.
var ticks: int = 0
## Simulated seconds per second of wall time; 0 is paused.
var speed: float = 1.0

var _remaining_ticks: int = 0
var _running: bool = false
var _remainder_s: float = 0.0
var _rate_before: int
var _max_steps_before: int


func _enter_tree() -> void:
	_rate_before = Engine.physics_ticks_per_second
	_max_steps_before = Engine.max_physics_steps_per_frame
	_update_tick_rate()


func _exit_tree() -> void:
	Engine.physics_ticks_per_second = _rate_before
	Engine.max_physics_steps_per_frame = _max_steps_before
	Engine.time_scale = 1.0
	_remaining_ticks = 0
	_set_paused(false)


## Simulation time [s].
func time_s() -> float:
	return ticks * TICK_S


## Simulates a duration [s]; a remainder shorter than a tick is added to the next run. Returns when it has finished.
func run(duration_s: float) -> void:
	_remainder_s += duration_s
	var count: int = int(_remainder_s / TICK_S + 1e-6)
	if count <= 0:
		return
	_remainder_s = maxf(0.0, _remainder_s - count * TICK_S)
	_remaining_ticks = count
	_running = true
	Engine.physics_ticks_per_second = _RATE
	Engine.max_physics_steps_per_frame = mini(count, _MAX_TICKS_PER_FRAME)
	Engine.time_scale = _RATE * TICK_S
	_set_paused(false)
	await finished


## Runs at a speed [simulated seconds per second], 0 to pause. Returns the previous speed.
func play(new_speed: float) -> float:
	var before: float = speed
	speed = new_speed
	_update_tick_rate()
	return before


func _physics_process(_delta: float) -> void:
	if Engine.is_editor_hint():
		return
	if _remaining_ticks == 0 and (speed == 0.0 or _running):
		_set_paused(true)
		return
	ticks += 1
	_remaining_ticks = maxi(0, _remaining_ticks - 1)
	ticking.emit()


func _process(_delta: float) -> void:
	if _remaining_ticks == 0 and _running:
		_running = false
		_update_tick_rate()
		finished.emit()


func _update_tick_rate() -> void:
	if Engine.is_editor_hint():
		return
	var pace: float = speed if speed > 0.0 else 1.0
	Engine.physics_ticks_per_second = roundi(pace / TICK_S)
	Engine.time_scale = Engine.physics_ticks_per_second * TICK_S
	Engine.max_physics_steps_per_frame = maxi(8, ceili(pace * 16.0))
	_set_paused(speed == 0.0)


func _set_paused(paused: bool) -> void:
	if not Engine.is_editor_hint() and is_inside_tree():
		PhysicsServer3D.space_set_active(get_viewport().find_world_3d().space, not paused)
