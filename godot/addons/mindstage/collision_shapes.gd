@tool
class_name MindstageCollisionShapes
extends RefCounted
## Convex collision shapes as Godot shapes and meshes; equal ones are created once.

const _RINGS: int = 8

## By description: equal descriptions are equal keys.
static var _shapes: Dictionary[Dictionary, Shape3D] = {}
static var _meshes: Dictionary[Dictionary, Mesh] = {}


## The shape for the physics.
static func shape(data: Dictionary) -> Shape3D:
	var found: Shape3D = _shapes.get(data)
	if found == null:
		found = _make_shape(data)
		_shapes[data] = found
	return found


## The mesh that shows a shape.
static func mesh(data: Dictionary) -> Mesh:
	var found: Mesh = _meshes.get(data)
	if found == null:
		found = _make_mesh(data)
		_meshes[data] = found
	return found


## The transform of a shape in its body's frame.
static func shape_transform(data: Dictionary) -> Transform3D:
	return MindstageFrames.transform_from(data["pose"]) if data.has("pose") else Transform3D()


static func _make_shape(data: Dictionary) -> Shape3D:
	var size: Vector3 = MindstageFrames.extents(data["size"])
	match data.get("type", "box"):
		"sphere" when _is_equal(size.x, size.y) and _is_equal(size.y, size.z):
			var sphere: SphereShape3D = SphereShape3D.new()
			sphere.radius = size.x / 2.0
			return sphere
		"cylinder" when _is_equal(size.x, size.z):
			var cylinder: CylinderShape3D = CylinderShape3D.new()
			cylinder.radius = size.x / 2.0
			cylinder.height = size.y
			return cylinder
		"sphere", "cylinder", "hull":
			var hull: ConvexPolygonShape3D = ConvexPolygonShape3D.new()
			hull.points = _hull_points(data, size)
			return hull
	var box: BoxShape3D = BoxShape3D.new()
	box.size = size
	return box


static func _make_mesh(data: Dictionary) -> Mesh:
	var size: Vector3 = MindstageFrames.extents(data["size"])
	match data.get("type", "box"):
		"box":
			var box: BoxMesh = BoxMesh.new()
			box.size = size
			return box
		"cylinder" when _is_equal(size.x, size.z):
			var cylinder: CylinderMesh = CylinderMesh.new()
			cylinder.top_radius = size.x / 2.0
			cylinder.bottom_radius = size.x / 2.0
			cylinder.height = size.y
			return cylinder
		"sphere" when _is_equal(size.x, size.y) and _is_equal(size.y, size.z):
			var sphere: SphereMesh = SphereMesh.new()
			sphere.radius = size.x / 2.0
			sphere.height = size.x
			return sphere
	return shape(data).get_debug_mesh()


static func _hull_points(data: Dictionary, size: Vector3) -> PackedVector3Array:
	var corners: PackedVector3Array = []
	if data.get("type") == "hull":
		for point: Array in data.get("points", []):
			corners.append(MindstageFrames.vector_from(point))
		return corners
	for ring: int in _RINGS + 1:
		var height: float = cos(PI * ring / _RINGS)
		var radius: float = sin(PI * ring / _RINGS)
		if data.get("type") == "cylinder":
			height = 1.0 if ring % 2 == 0 else -1.0
			radius = 1.0
		for step: int in 2 * _RINGS:
			var angle: float = PI * step / _RINGS
			var unit: Vector3 = Vector3(cos(angle) * radius, height, sin(angle) * radius)
			corners.append(unit * size / 2.0)
	return corners


static func _is_equal(one: float, other: float) -> bool:
	return absf(one - other) <= 1e-6 * maxf(one, other)
