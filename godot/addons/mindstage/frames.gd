@tool
class_name MindstageFrames
extends RefCounted
## ROS's axes (x forward, y left, z up) and Godot's (-z forward, y up), both right-handed and in metres.
##
## A vector (x, y, z) of ROS is (-y, z, -x) in Godot. Poses are seven doubles: x y z, then the quaternion w x y z.

## How many numbers a pose has.
const ROW: int = 7
## Turns ROS's axes into Godot's.
const GODOT_FROM_ROS: Quaternion = Quaternion(-0.5, 0.5, 0.5, 0.5)


## A vector of ROS in Godot.
static func vector(x: float, y: float, z: float) -> Vector3:
	return Vector3(-y, z, -x)


## The same for three numbers in an array.
static func vector_from(numbers: Array) -> Vector3:
	return vector(number(numbers[0]), number(numbers[1]), number(numbers[2]))


## The same for a wire message with x, y and z.
static func vector_from_message(message: Dictionary) -> Vector3:
	return vector(number(message["x"]), number(message["y"]), number(message["z"]))


## Extents along ROS's axes, as extents along Godot's.
static func extents(numbers: Array) -> Vector3:
	return vector_from(numbers).abs()


## A pose of ROS ({"position": [x, y, z], "quaternion": [w, x, y, z]}) as the transform of a node.
static func transform_from(pose: Dictionary) -> Transform3D:
	return transform_at(row_from(pose), 0)


## Seven numbers from a pose; what is left out is nowhere and not turned.
static func row_from(pose: Dictionary) -> PackedFloat64Array:
	var position: Array = pose.get("position", [0.0, 0.0, 0.0])
	return PackedFloat64Array(position + pose.get("quaternion", [1.0, 0.0, 0.0, 0.0]))


## A pose from seven numbers in an array.
static func pose_from_row(rows: PackedFloat64Array, row: int) -> Dictionary:
	var at: int = row * ROW
	return {
		"position": Array(rows.slice(at, at + 3)),
		"quaternion": Array(rows.slice(at + 3, at + ROW)),
	}


## The transform of a node from seven numbers in an array.
static func transform_at(rows: PackedFloat64Array, row: int) -> Transform3D:
	var at: int = row * ROW
	# With norm 1 in double precision first: a map may round its quaternions.
	var norm: float = sqrt(
		(
			rows[at + 3] * rows[at + 3]
			+ rows[at + 4] * rows[at + 4]
			+ rows[at + 5] * rows[at + 5]
			+ rows[at + 6] * rows[at + 6]
		)
	)
	var turn: Quaternion = Quaternion(
		-rows[at + 5] / norm, rows[at + 6] / norm, -rows[at + 4] / norm, rows[at + 3] / norm
	)
	return Transform3D(Basis(turn.normalized()), vector(rows[at], rows[at + 1], rows[at + 2]))


## Writes the transform of a node as seven numbers into an array.
static func write_row(rows: PackedFloat64Array, row: int, place: Transform3D) -> void:
	var at: int = row * ROW
	var turn: Quaternion = place.basis.get_rotation_quaternion()
	rows[at] = -place.origin.z
	rows[at + 1] = -place.origin.x
	rows[at + 2] = place.origin.y
	rows[at + 3] = turn.w
	rows[at + 4] = -turn.z
	rows[at + 5] = -turn.x
	rows[at + 6] = turn.y


## The frame of a joint. Its own axes stay those of ROS, so that twist is about x, swing 2 about y and swing 1 about z.
static func joint_frame(pose: Dictionary) -> Transform3D:
	var place: Transform3D = transform_from(pose)
	return Transform3D(place.basis * Basis(GODOT_FROM_ROS), place.origin)


## A vector of Godot in ROS.
static func to_ros(here: Vector3) -> Vector3:
	return Vector3(-here.z, -here.x, here.y)


## A number of JSON.
static func number(value: Variant) -> float:
	return float(value) if value is float or value is int else NAN
