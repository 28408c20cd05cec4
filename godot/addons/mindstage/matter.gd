@tool
class_name MindstageMatter
extends RefCounted
## How the mass of a carrier lies: each body's is spread evenly over its solids, which count as boxes here.


## The centre of mass, in the carrier's frame.
static func middle(carrier: MindstageCarrier) -> Vector3:
	var sum: Vector3 = Vector3.ZERO
	var mass: float = 0.0
	for lump: Lump in _lumps(carrier):
		sum += lump.mass * lump.place.origin
		mass += lump.mass
	return sum / mass if mass > 0.0 else Vector3.ZERO


## The moment of inertia about an axis through a point, both in the carrier's frame [kg m²].
static func inertia_about(carrier: MindstageCarrier, point: Vector3, axis: Vector3) -> float:
	var sum: float = 0.0
	for lump: Lump in _lumps(carrier):
		var own: Vector3 = lump.place.basis.inverse() * axis
		var squares: Vector3 = lump.size * lump.size
		sum += (
			lump.mass
			/ 12.0
			* (
				own.x * own.x * (squares.y + squares.z)
				+ own.y * own.y * (squares.x + squares.z)
				+ own.z * own.z * (squares.x + squares.y)
			)
		)
		sum += lump.mass * (lump.place.origin - point).cross(axis).length_squared()
	return sum


## A solid with its share of a body's mass.
class Lump:
	var place: Transform3D
	var size: Vector3
	var mass: float


static func _lumps(carrier: MindstageCarrier) -> Array[Lump]:
	var found: Array[Lump] = []
	for body: MindstageBody in carrier.members:
		var solids: Array = body.solids()
		var volumes: PackedFloat64Array = []
		var volume: float = 0.0
		for solid: Dictionary in solids:
			var size: Vector3 = MindstageFrames.extents(solid["size"])
			volumes.append(size.x * size.y * size.z)
			volume += volumes[-1]
		for index: int in solids.size():
			var solid: Dictionary = solids[index]
			var lump: Lump = Lump.new()
			lump.size = MindstageFrames.extents(solid["size"])
			lump.place = body.hold() * MindstageSolids.place(solid)
			lump.mass = float(body.part.get("mass_kg", 0.0)) * volumes[index] / volume
			found.append(lump)
	return found
