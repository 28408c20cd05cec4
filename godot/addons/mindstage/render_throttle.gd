class_name MindstageRenderThrottle
extends Node
## Limits the frame rate of the window, so that slow rendering does not slow down the simulation.

const _PERIOD_US: int = 33_000
## Minimum pause after a frame, as a multiple of its rendering time.
const _IDLE_RATIO: int = 4

var _began_us: int = 0
var _next_us: int = 0


## Renders the next frame in any case.
static func request_frame() -> void:
	RenderingServer.render_loop_enabled = true


func _enter_tree() -> void:
	RenderingServer.frame_pre_draw.connect(_on_pre_draw)
	RenderingServer.frame_post_draw.connect(_on_post_draw)


func _exit_tree() -> void:
	RenderingServer.frame_pre_draw.disconnect(_on_pre_draw)
	RenderingServer.frame_post_draw.disconnect(_on_post_draw)
	RenderingServer.render_loop_enabled = true


func _process(_delta: float) -> void:
	if Time.get_ticks_usec() >= _next_us:
		RenderingServer.render_loop_enabled = true


func _on_pre_draw() -> void:
	_began_us = Time.get_ticks_usec()


func _on_post_draw() -> void:
	var frame_us: int = Time.get_ticks_usec() - _began_us
	_next_us = _began_us + maxi(_PERIOD_US, (1 + _IDLE_RATIO) * frame_us)
	RenderingServer.render_loop_enabled = false
