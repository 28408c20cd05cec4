@tool
class_name MindstageLights
extends RefCounted
## A map's lights, and what glows.

const _REACH_M: float = 8.0
## A lamp of so many candela is as bright as Godot's own are at first; the sun of so many lux likewise.
const _CANDELA: float = 150.0
const _LUX: float = 3.0
const _BRIGHTEST: float = 0.7


## A light of a world's description.
static func make(light: Dictionary) -> Node3D:
	var lamp: Light3D = _lamp(str(light.get("kind", "point")))
	lamp.name = str(light.get("id", "light")).validate_node_name()
	MindstageTags.write(lamp, light)
	_shine(lamp, light)
	return lamp


## What shines with a body, from the glows of its form.
static func glow(body: MindstageBody) -> void:
	for told: Dictionary in body.form.get("glows", []):
		var lamp: Light3D = _lamp(str(told.get("kind", "point")))
		lamp.set_meta(MindstageLooks.NODE, true)
		_shine(lamp, told)
		body.node.add_child(lamp)


static func _lamp(kind: String) -> Light3D:
	match kind:
		"spot":
			var spot: SpotLight3D = SpotLight3D.new()
			spot.spot_range = _REACH_M
			return spot
		"directional":
			return DirectionalLight3D.new()
	var point: OmniLight3D = OmniLight3D.new()
	point.omni_range = _REACH_M
	return point


static func _shine(lamp: Light3D, told: Dictionary) -> void:
	# Along the negative z axis of ROS's own axes, as Godot's lamps shine along the negative z of theirs.
	lamp.transform = MindstageFrames.joint_frame(told.get("pose", {}))
	var colour: Array = told.get("colour", [1.0, 1.0, 1.0])
	lamp.light_color = Color(colour[0], colour[1], colour[2])
	var as_usual: float = _LUX if lamp is DirectionalLight3D else _CANDELA
	lamp.light_energy = minf(float(told.get("intensity", 1.0)) / as_usual, _BRIGHTEST)
