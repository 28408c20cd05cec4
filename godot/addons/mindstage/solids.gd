@tool
class_name MindstageSolids
extends RefCounted
## The convex solids of a description as Godot's shapes and meshes; equal ones are made once.

const _RINGS: int = 8

## By their descriptions: equal ones are one key.
static var _shapes: Dictionary[Dictionary, Shape3D] = {}
static var _meshes: Dictionary[Dictionary, Mesh] = {}


## What is touched.
static func shape(solid: Dictionary) -> Shape3D:
	var found: Shape3D = _shapes.get(solid)
	if found == null:
		found = _make_shape(solid)
		_shapes[solid] = found
	return found


## What is seen, where nothing better is known.
static func mesh(solid: Dictionary) -> Mesh:
	var found: Mesh = _meshes.get(solid)
	if found == null:
		found = _make_mesh(solid)
		_meshes[solid] = found
	return found


## Where it is in its body's frame.
static func place(solid: Dictionary) -> Transform3D:
	return MindstageFrames.transform_from(solid["pose"]) if solid.has("pose") else Transform3D()


static func _make_shape(solid: Dictionary) -> Shape3D:
	var size: Vector3 = MindstageFrames.extents(solid["size"])
	match solid.get("kind", "box"):
		"sphere" when _is_even(size.x, size.y) and _is_even(size.y, size.z):
			var ball: SphereShape3D = SphereShape3D.new()
			ball.radius = size.x / 2.0
			return ball
		"cylinder" when _is_even(size.x, size.z):
			var can: CylinderShape3D = CylinderShape3D.new()
			can.radius = size.x / 2.0
			can.height = size.y
			return can
		"sphere", "cylinder", "hull":
			var hull: ConvexPolygonShape3D = ConvexPolygonShape3D.new()
			hull.points = _corners(solid, size)
			return hull
	var box: BoxShape3D = BoxShape3D.new()
	box.size = size
	return box


static func _make_mesh(solid: Dictionary) -> Mesh:
	var size: Vector3 = MindstageFrames.extents(solid["size"])
	match solid.get("kind", "box"):
		"box":
			var box: BoxMesh = BoxMesh.new()
			box.size = size
			return box
		"cylinder" when _is_even(size.x, size.z):
			var can: CylinderMesh = CylinderMesh.new()
			can.top_radius = size.x / 2.0
			can.bottom_radius = size.x / 2.0
			can.height = size.y
			return can
		"sphere" when _is_even(size.x, size.y) and _is_even(size.y, size.z):
			var ball: SphereMesh = SphereMesh.new()
			ball.radius = size.x / 2.0
			ball.height = size.x
			return ball
	return shape(solid).get_debug_mesh()


static func _corners(solid: Dictionary, size: Vector3) -> PackedVector3Array:
	var corners: PackedVector3Array = []
	if solid.get("kind") == "hull":
		for point: Array in solid.get("points", []):
			corners.append(MindstageFrames.vector_from(point))
		return corners
	for ring: int in _RINGS + 1:
		var up: float = cos(PI * ring / _RINGS)
		var round_the_axis: float = sin(PI * ring / _RINGS)
		if solid.get("kind") == "cylinder":
			up = 1.0 if ring % 2 == 0 else -1.0
			round_the_axis = 1.0
		for step: int in 2 * _RINGS:
			var angle: float = PI * step / _RINGS
			var unit: Vector3 = Vector3(cos(angle) * round_the_axis, up, sin(angle) * round_the_axis)
			corners.append(unit * size / 2.0)
	return corners


static func _is_even(one: float, other: float) -> bool:
	return absf(one - other) <= 1e-6 * maxf(one, other)
