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


## The moments of inertia about the axes of the group's frame through the center of mass [kg m²].
static func moments(group: MindstageRigidGroup) -> Vector3:
	var center: Vector3 = center_of_mass(group)
	return Vector3(
		inertia_about(group, center, Vector3.RIGHT),
		inertia_about(group, center, Vector3.UP),
		inertia_about(group, center, Vector3.BACK)
	)


## The principal moments of its node, with what drives have added [kg m²].
static func current_moments(group: MindstageRigidGroup) -> Vector3:
	var rigid: RigidBody3D = group.node as RigidBody3D
	return rigid.inertia if rigid.inertia != Vector3.ZERO else moments(group)


## Raises the principal moments of a weightless body to a least value [kg m²].
static func raise_moments(group: MindstageRigidGroup, least: float) -> void:
	if not group.is_dynamic() or group.gravity_factor > 0.0:
		return
	var own: Vector3 = current_moments(group)
	if own[own.min_axis_index()] < least:
		(group.node as RigidBody3D).inertia = own.maxf(least)


## A collision shape with its share of the body's mass.
class Part:
	var xform: Transform3D
	var size: Vector3
	var mass: float


static func _parts(group: MindstageRigidGroup) -> Array[Part]:
	var found: Array[Part] = []
	for body: MindstageBody in group.members:
		if not body.inertia().is_empty():
			found.append(_part_of_inertia(body))
			continue
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


## A box with the center of mass and the moments of inertia of a body, without those that are not along its axes.
static func _part_of_inertia(body: MindstageBody) -> Part:
	var given: Dictionary = body.inertia()
	var tensor: Array = given.get("tensor", [0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
	var scale: float = 6.0 / maxf(float(given["mass_kg"]), 1e-9)
	var squares: PackedFloat64Array = []
	for index: int in 3:
		var own: float = tensor[index]
		squares.append(scale * maxf(float(tensor[0]) + float(tensor[1]) + float(tensor[2]) - 2.0 * own, 0.0))
	var part: Part = Part.new()
	part.size = MindstageFrames.extents([sqrt(squares[0]), sqrt(squares[1]), sqrt(squares[2])])
	var center: Vector3 = MindstageFrames.vector_from(given.get("center", [0.0, 0.0, 0.0]))
	part.xform = body.transform_in_group() * Transform3D(Basis(), center)
	part.mass = body.physics_model.get("mass_kg", 0.0)
	return part
