@tool
class_name MindstageHighlighter
extends RefCounted
## Lights bodies up: a glowing coat of any colour over all that is seen of them.

const _STRENGTH: float = 0.55

static var _coats: Dictionary[Color, StandardMaterial3D] = {}


## Lights a body up.
static func light(body: MindstageBody, colour: Color) -> void:
	_coat(body, _coat_of(colour))


## Puts it out.
static func put_out(body: MindstageBody) -> void:
	_coat(body, null)


static func _coat(body: MindstageBody, coat: StandardMaterial3D) -> void:
	for part: MeshInstance3D in MindstageLooks.parts(body.node):
		part.material_overlay = coat


static func _coat_of(colour: Color) -> StandardMaterial3D:
	if not _coats.has(colour):
		var coat: StandardMaterial3D = StandardMaterial3D.new()
		coat.shading_mode = BaseMaterial3D.SHADING_MODE_UNSHADED
		coat.transparency = BaseMaterial3D.TRANSPARENCY_ALPHA
		coat.albedo_color = Color(colour, _STRENGTH)
		coat.grow = true
		coat.grow_amount = 0.004
		_coats[colour] = coat
	return _coats[colour]
