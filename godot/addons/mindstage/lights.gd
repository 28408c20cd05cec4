@tool
class_name MindstageLights
extends RefCounted
## Lights of the map, and lights emitted by bodies.

const _RANGE_M: float = 8.0
## The intensity that corresponds to Godot's light energy 1.0, for lamps [cd] and for directional lights [lx].
const _CANDELA: float = 150.0
const _LUX: float = 3.0
const _MAX_ENERGY: float = 0.7


## Creates the node of a light from its description.
static func make(data: Dictionary) -> Node3D:
	var node: Light3D = _new_light(str(data.get("type", "point")))
	node.name = str(data.get("id", "light")).validate_node_name()
	MindstageTags.write(node, data)
	_configure(node, data)
	return node


## Adds the lights that the geometry of a body emits.
static func add_emitted_lights(body: MindstageBody) -> void:
	for data: Dictionary in body.geometry.get("lights", []):
		var node: Light3D = _new_light(str(data.get("type", "point")))
		node.set_meta(MindstageVisuals.NODE, true)
		_configure(node, data)
		body.node.add_child(node)


static func _new_light(kind: String) -> Light3D:
	match kind:
		"spot":
			var spot: SpotLight3D = SpotLight3D.new()
			spot.spot_range = _RANGE_M
			return spot
		"directional":
			return DirectionalLight3D.new()
	var point: OmniLight3D = OmniLight3D.new()
	point.omni_range = _RANGE_M
	return point


static func _configure(node: Light3D, data: Dictionary) -> void:
	# Light shines along the negative z axis, in ROS and in Godot.
	node.transform = MindstageFrames.joint_frame(data.get("pose", {}))
	var color: Array = data.get("color", [1.0, 1.0, 1.0])
	node.light_color = Color(color[0], color[1], color[2])
	var unit_intensity: float = _LUX if node is DirectionalLight3D else _CANDELA
	node.light_energy = minf(float(data.get("intensity", 1.0)) / unit_intensity, _MAX_ENERGY)
