@tool
class_name MindstageMassProperties
extends RefCounted
## Mass properties of a rigid group. Each body's mass is distributed uniformly over its collision shapes, which are
## taken as boxes.


## The center of mass in the group's frame.
static func center_of_mass(group: MindstageRigidGroup) -> Vector3:
	var sum: Vector3 = Vector3.ZERO
	var mass: float = 0.0
	for part: Part in _parts(group):
		sum += part.mass * part.xform.origin
		mass += part.mass
	return sum / mass if mass > 0.0 else Vector3.ZERO


## The moment of inertia about an axis through a point, both in the group's frame [kg m²].
static func inertia_about(group: MindstageRigidGroup, point: Vector3, axis: Vector3) -> float:
	var sum: float = 0.0
	for part: Part in _parts(group):
		var local_axis: Vector3 = part.xform.basis.inverse() * axis
		var squares: Vector3 = part.size * part.size
		sum += (
			part.mass
			/ 12.0
			* (
				local_axis.x * local_axis.x * (squares.y + squares.z)
				+ local_axis.y * local_axis.y * (squares.x + squares.z)
				+ local_axis.z * local_axis.z * (squares.x + squares.y)
			)
		)
		sum += part.mass * (part.xform.origin - point).cross(axis).length_squared()
	return sum


## A collision shape with its share of the body's mass.
class Part:
	var xform: Transform3D
	var size: Vector3
	var mass: float


static func _parts(group: MindstageRigidGroup) -> Array[Part]:
	var found: Array[Part] = []
	for body: MindstageBody in group.members:
		var shapes: Array = body.collision_shapes()
		var volumes: PackedFloat64Array = []
		var volume: float = 0.0
		for shape_data: Dictionary in shapes:
			var size: Vector3 = MindstageFrames.extents(shape_data["size"])
			volumes.append(size.x * size.y * size.z)
			volume += volumes[-1]
		for index: int in shapes.size():
			var shape_data: Dictionary = shapes[index]
			var part: Part = Part.new()
			part.size = MindstageFrames.extents(shape_data["size"])
			part.xform = body.transform_in_group() * MindstageCollisionShapes.shape_transform(shape_data)
			part.mass = float(body.physics_model.get("mass_kg", 0.0)) * volumes[index] / volume
			found.append(part)
	return found
