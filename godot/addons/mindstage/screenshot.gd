@tool
class_name MindstageScreenshot
extends RefCounted
## Renders a simulation from a given viewpoint to an image file.

const _MAX_PIXELS: int = 8192
const _FRAMES: int = 2


## Whether rendering is available.
static func is_available() -> bool:
	return DisplayServer.get_name() != "headless"


## Writes a PNG. Returns why it failed, or an empty string.
static func take(
	simulation: Node3D, path: String, size: Vector2i, eye: Vector3, target: Vector3, fov_deg: float
) -> String:
	if not is_available():
		return "rendering is disabled; start Godot with a window"
	if size.x < 1 or size.y < 1 or size.x > _MAX_PIXELS or size.y > _MAX_PIXELS:
		return (
			"the image size %d x %d is invalid; width and height are from 1 to %d pixels"
			% [size.x, size.y, _MAX_PIXELS]
		)
	if eye.is_equal_approx(target):
		return "the eye and the target are the same point"
	var viewport: SubViewport = SubViewport.new()
	viewport.size = size
	viewport.msaa_3d = Viewport.MSAA_4X
	viewport.render_target_update_mode = SubViewport.UPDATE_ALWAYS
	viewport.world_3d = simulation.get_viewport().find_world_3d()
	var camera: Camera3D = Camera3D.new()
	camera.fov = clampf(fov_deg if fov_deg > 0.0 else 50.0, 1.0, 170.0)
	camera.near = 0.02
	viewport.add_child(camera)
	simulation.add_child(viewport, false, Node.INTERNAL_MODE_BACK)
	var is_tilted: bool = absf((target - eye).normalized().dot(Vector3.UP)) < 0.999
	camera.look_at_from_position(eye, target, Vector3.UP if is_tilted else Vector3.FORWARD)
	var window: Viewport = simulation.get_viewport()
	window.disable_3d = true  # the window need not be rendered meanwhile
	for frame: int in _FRAMES:
		MindstageRenderThrottle.request_frame()
		await RenderingServer.frame_post_draw
	window.disable_3d = false
	var image: Image = viewport.get_texture().get_image()
	viewport.queue_free()
	var error: Error = image.save_png(path)
	return "" if error == OK else "the image cannot be written to '%s': %s" % [path, error_string(error)]
