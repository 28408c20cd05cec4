class_name MindstagePainter
extends Node
## Draws the window often enough to be watched, and no more: where drawing is slow, the world must not wait for it.

const _PERIOD_US: int = 33_000
## At least so many times as long as a picture takes is not drawn after it.
const _REST: int = 4

var _began_us: int = 0
var _next_us: int = 0


## Lets the next frame be drawn, whenever it comes.
static func hurry() -> void:
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
	var took_us: int = Time.get_ticks_usec() - _began_us
	_next_us = _began_us + maxi(_PERIOD_US, (1 + _REST) * took_us)
	RenderingServer.render_loop_enabled = false
