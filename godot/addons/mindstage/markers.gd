@tool
class_name MindstageMarkers
extends Node3D
## Visualization markers and trajectories; not part of the world.

enum Kind { POINT, CUBE, SPHERE, CYLINDER, CONE, ARROW }

const _POINT_M: float = 0.02
const _LINE_M: float = 0.008

var _nodes: Dictionary[String, Node3D] = {}
var _id_count: int = 0


## Shows an unreal_vis_msgs/DisplayBasicMarker and returns its id. A marker with an existing id is replaced.
func show_marker(message: Dictionary) -> String:
	var marker: MeshInstance3D = MeshInstance3D.new()
	marker.mesh = _mesh(message["marker_type"], maxf(message["scale"], 0.001))
	marker.material_override = _material(_color(message["color"]))
	var pose: Dictionary = message["pose"]
	var at: Dictionary = pose["position"]
	var orientation: Dictionary = pose["orientation"]
	marker.transform = MindstageFrames.transform_from(
		{
			"position": [at["x"], at["y"], at["z"]],
			"quaternion": [orientation["w"], orientation["x"], orientation["y"], orientation["z"]]
		}
	)
	return _show(marker, message["marker_id"], "marker")


## Shows an unreal_vis_msgs/DisplayTrajectory: a sphere for each point, with interpolated colors. Returns its id.
func show_trajectory(message: Dictionary) -> String:
	var points: Array = message["points"]
	var multimesh: MultiMesh = MultiMesh.new()
	multimesh.transform_format = MultiMesh.TRANSFORM_3D
	multimesh.use_colors = true
	multimesh.mesh = _mesh(Kind.SPHERE, 2.0 * _LINE_M)
	multimesh.instance_count = points.size()
	var from: Color = _color(message["color_begin"])
	var to: Color = _color(message["color_end"])
	for index: int in points.size():
		var xform: Transform3D = Transform3D(Basis(), MindstageFrames.vector_from_message(points[index]))
		multimesh.set_instance_transform(index, xform)
		multimesh.set_instance_color(index, from.lerp(to, index / maxf(1.0, points.size() - 1.0)))
	var instance: MultiMeshInstance3D = MultiMeshInstance3D.new()
	instance.multimesh = multimesh
	var material: StandardMaterial3D = _material(Color.WHITE)
	material.vertex_color_use_as_albedo = true
	instance.material_override = material
	return _show(instance, message["marker_id"], "trajectory")


## Removes a marker; false if there is none.
func remove(id: String) -> bool:
	if not _nodes.has(id):
		return false
	_nodes[id].queue_free()
	return _nodes.erase(id)


func _show(node: Node3D, requested_id: String, kind: String) -> String:
	var id: String = requested_id
	while id.is_empty() or (requested_id.is_empty() and _nodes.has(id)):
		_id_count += 1
		id = "%s_%d" % [kind, _id_count]
	remove(id)
	_nodes[id] = node
	add_child(node)
	return id


static func _mesh(kind: int, scale_m: float) -> Mesh:
	match kind:
		Kind.CUBE:
			var box: BoxMesh = BoxMesh.new()
			box.size = Vector3.ONE * scale_m
			return box
		Kind.CYLINDER:
			return _cone(scale_m, scale_m / 2.0, scale_m / 2.0)
		Kind.CONE:
			return _cone(scale_m, scale_m / 2.0, 0.0)
		Kind.ARROW:
			return _arrow(scale_m)
	var sphere: SphereMesh = SphereMesh.new()
	sphere.radius = _POINT_M / 2.0 if kind == Kind.POINT else scale_m / 2.0
	sphere.height = 2.0 * sphere.radius
	return sphere


static func _cone(height_m: float, bottom_m: float, top_m: float) -> CylinderMesh:
	var mesh: CylinderMesh = CylinderMesh.new()
	mesh.height = height_m
	mesh.bottom_radius = bottom_m
	mesh.top_radius = top_m
	return mesh


## An arrow along the x axis of ROS, with its tail at the origin.
static func _arrow(length_m: float) -> Mesh:
	var forward: Basis = Basis(Vector3.RIGHT, -PI / 2.0)
	var shaft: Mesh = _cone(0.75 * length_m, length_m / 24.0, length_m / 24.0)
	var head: Mesh = _cone(0.25 * length_m, length_m / 10.0, 0.0)
	var surface: SurfaceTool = SurfaceTool.new()
	surface.append_from(shaft, 0, Transform3D(forward, Vector3.FORWARD * 0.375 * length_m))
	surface.append_from(head, 0, Transform3D(forward, Vector3.FORWARD * 0.875 * length_m))
	return surface.commit()


static func _material(color: Color) -> StandardMaterial3D:
	var material: StandardMaterial3D = StandardMaterial3D.new()
	material.shading_mode = BaseMaterial3D.SHADING_MODE_UNSHADED
	material.albedo_color = color
	if color.a < 1.0:
		material.transparency = BaseMaterial3D.TRANSPARENCY_ALPHA
	return material


static func _color(message: Dictionary) -> Color:
	return Color(message["r"], message["g"], message["b"], message["a"] if message["a"] > 0.0 else 1.0)
