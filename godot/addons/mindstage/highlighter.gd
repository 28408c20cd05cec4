@tool
class_name MindstageHighlighter
extends RefCounted
## Highlights bodies with a translucent overlay material on their visuals.

const _OPACITY: float = 0.55

static var _overlays: Dictionary[Color, StandardMaterial3D] = {}


## Highlights a body.
static func highlight(body: MindstageBody, color: Color) -> void:
	_set_overlay(body, _overlay_material(color))


## Clears the highlight of a body.
static func clear(body: MindstageBody) -> void:
	_set_overlay(body, null)


static func _set_overlay(body: MindstageBody, overlay: StandardMaterial3D) -> void:
	for part: MeshInstance3D in MindstageVisuals.mesh_instances(body.node):
		part.material_overlay = overlay


static func _overlay_material(color: Color) -> StandardMaterial3D:
	if not _overlays.has(color):
		var overlay: StandardMaterial3D = StandardMaterial3D.new()
		overlay.shading_mode = BaseMaterial3D.SHADING_MODE_UNSHADED
		overlay.transparency = BaseMaterial3D.TRANSPARENCY_ALPHA
		overlay.albedo_color = Color(color, _OPACITY)
		overlay.grow = true
		overlay.grow_amount = 0.004
		_overlays[color] = overlay
	return _overlays[color]
