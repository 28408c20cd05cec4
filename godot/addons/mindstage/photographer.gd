@tool
class_name MindstagePhotographer
extends RefCounted
## Takes a picture of a stage from anywhere, where something is drawn at all.

const _MOST_PIXELS: int = 8192
const _FRAMES: int = 2


## Whether anything is drawn here.
static func can_see() -> bool:
	return DisplayServer.get_name() != "headless"


## Writes a PNG; gives why it cannot, or an empty string.
static func take(stage: Node3D, path: String, size: Vector2i, eye: Vector3, target: Vector3, fov_deg: float) -> String:
	if not can_see():
		return "nothing is drawn here; start it with a window"
	if size.x < 1 or size.y < 1 or size.x > _MOST_PIXELS or size.y > _MOST_PIXELS:
		return "a picture of %d x %d is none; it has from 1 to %d pixels each way" % [size.x, size.y, _MOST_PIXELS]
	if eye.is_equal_approx(target):
		return "the eye is where it looks to"
	var view: SubViewport = SubViewport.new()
	view.size = size
	view.msaa_3d = Viewport.MSAA_4X
	view.render_target_update_mode = SubViewport.UPDATE_ALWAYS
	view.world_3d = stage.get_viewport().find_world_3d()
	var camera: Camera3D = Camera3D.new()
	camera.fov = clampf(fov_deg if fov_deg > 0.0 else 50.0, 1.0, 170.0)
	camera.near = 0.02
	view.add_child(camera)
	stage.add_child(view, false, Node.INTERNAL_MODE_BACK)
	var level: bool = absf((target - eye).normalized().dot(Vector3.UP)) < 0.999
	camera.look_at_from_position(eye, target, Vector3.UP if level else Vector3.FORWARD)
	var window: Viewport = stage.get_viewport()
	window.disable_3d = true  # one picture at a time is enough
	for frame: int in _FRAMES:
		MindstagePainter.hurry()
		await RenderingServer.frame_post_draw
	window.disable_3d = false
	var picture: Image = view.get_texture().get_image()
	view.queue_free()
	var error: Error = picture.save_png(path)
	return "" if error == OK else "the picture cannot be written to '%s': %s" % [path, error_string(error)]
