@tool
class_name MindstageMarkers
extends Node3D
## Markers and trajectories that somebody wants to be seen; they are no part of the world.

enum Kind { POINT, CUBE, SPHERE, CYLINDER, CONE, ARROW }

const _POINT_M: float = 0.02
const _LINE_M: float = 0.008

var _shown: Dictionary[String, Node3D] = {}
var _made: int = 0


## Shows unreal_vis_msgs/DisplayBasicMarker; gives its id. One of an id that is there already replaces it.
func show_marker(told: Dictionary) -> String:
	var marker: MeshInstance3D = MeshInstance3D.new()
	marker.mesh = _mesh(told["marker_type"], maxf(told["scale"], 0.001))
	marker.material_override = _paint(_colour(told["color"]))
	var pose: Dictionary = told["pose"]
	var at: Dictionary = pose["position"]
	var turn: Dictionary = pose["orientation"]
	marker.transform = MindstageFrames.transform_from(
		{"position": [at["x"], at["y"], at["z"]], "quaternion": [turn["w"], turn["x"], turn["y"], turn["z"]]}
	)
	return _show(marker, told["marker_id"], "marker")


## Shows unreal_vis_msgs/DisplayTrajectory: a dot for each point, in colours that run from the first to the last.
func show_trajectory(told: Dictionary) -> String:
	var points: Array = told["points"]
	var dots: MultiMesh = MultiMesh.new()
	dots.transform_format = MultiMesh.TRANSFORM_3D
	dots.use_colors = true
	dots.mesh = _mesh(Kind.SPHERE, 2.0 * _LINE_M)
	dots.instance_count = points.size()
	var from: Color = _colour(told["color_begin"])
	var to: Color = _colour(told["color_end"])
	for index: int in points.size():
		var place: Transform3D = Transform3D(Basis(), MindstageFrames.vector_from_message(points[index]))
		dots.set_instance_transform(index, place)
		dots.set_instance_color(index, from.lerp(to, index / maxf(1.0, points.size() - 1.0)))
	var trail: MultiMeshInstance3D = MultiMeshInstance3D.new()
	trail.multimesh = dots
	var paint: StandardMaterial3D = _paint(Color.WHITE)
	paint.vertex_color_use_as_albedo = true
	trail.material_override = paint
	return _show(trail, told["marker_id"], "trajectory")


## Takes one away; false if there is none.
func remove(id: String) -> bool:
	if not _shown.has(id):
		return false
	_shown[id].queue_free()
	return _shown.erase(id)


func _show(node: Node3D, told_id: String, kind: String) -> String:
	var id: String = told_id
	while id.is_empty() or (told_id.is_empty() and _shown.has(id)):
		_made += 1
		id = "%s_%d" % [kind, _made]
	remove(id)
	_shown[id] = node
	add_child(node)
	return id


static func _mesh(kind: int, scale_m: float) -> Mesh:
	match kind:
		Kind.CUBE:
			var box: BoxMesh = BoxMesh.new()
			box.size = Vector3.ONE * scale_m
			return box
		Kind.CYLINDER:
			return _round(scale_m, scale_m / 2.0, scale_m / 2.0)
		Kind.CONE:
			return _round(scale_m, scale_m / 2.0, 0.0)
		Kind.ARROW:
			return _arrow(scale_m)
	var ball: SphereMesh = SphereMesh.new()
	ball.radius = _POINT_M / 2.0 if kind == Kind.POINT else scale_m / 2.0
	ball.height = 2.0 * ball.radius
	return ball


static func _round(height_m: float, bottom_m: float, top_m: float) -> CylinderMesh:
	var made: CylinderMesh = CylinderMesh.new()
	made.height = height_m
	made.bottom_radius = bottom_m
	made.top_radius = top_m
	return made


## An arrow from where it is along ROS's x axis, as in every other view.
static func _arrow(length_m: float) -> Mesh:
	var forward: Basis = Basis(Vector3.RIGHT, -PI / 2.0)
	var shaft: Mesh = _round(0.75 * length_m, length_m / 24.0, length_m / 24.0)
	var head: Mesh = _round(0.25 * length_m, length_m / 10.0, 0.0)
	var both: SurfaceTool = SurfaceTool.new()
	both.append_from(shaft, 0, Transform3D(forward, Vector3.FORWARD * 0.375 * length_m))
	both.append_from(head, 0, Transform3D(forward, Vector3.FORWARD * 0.875 * length_m))
	return both.commit()


static func _paint(colour: Color) -> StandardMaterial3D:
	var paint: StandardMaterial3D = StandardMaterial3D.new()
	paint.shading_mode = BaseMaterial3D.SHADING_MODE_UNSHADED
	paint.albedo_color = colour
	if colour.a < 1.0:
		paint.transparency = BaseMaterial3D.TRANSPARENCY_ALPHA
	return paint


static func _colour(told: Dictionary) -> Color:
	return Color(told["r"], told["g"], told["b"], told["a"] if told["a"] > 0.0 else 1.0)
