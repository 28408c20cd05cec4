@tool
class_name MindstageFrames
extends RefCounted
## Conversion between the axes of ROS (x forward, y left, z up) and Godot (-z forward, y up). Both are right-handed, in
## meters.
##
## A vector (x, y, z) of ROS is (-y, z, -x) in Godot. Poses are seven doubles: x y z, then the quaternion w x y z.

## Numbers per pose.
const ROW: int = 7
## The rotation from ROS axes to Godot axes.
const GODOT_FROM_ROS: Quaternion = Quaternion(-0.5, 0.5, 0.5, 0.5)


## Converts a ROS vector to Godot.
static func vector(x: float, y: float, z: float) -> Vector3:
	return Vector3(-y, z, -x)


## The same for three numbers in an array.
static func vector_from(numbers: Array) -> Vector3:
	return vector(number(numbers[0]), number(numbers[1]), number(numbers[2]))


## The same for a message with x, y and z.
static func vector_from_message(message: Dictionary) -> Vector3:
	return vector(number(message["x"]), number(message["y"]), number(message["z"]))


## Converts extents along ROS axes to extents along Godot axes.
static func extents(numbers: Array) -> Vector3:
	return vector_from(numbers).abs()


## Converts a ROS pose ({"position": [x, y, z], "quaternion": [w, x, y, z]}) to the transform of a node.
static func transform_from(pose: Dictionary) -> Transform3D:
	return transform_at(row_from(pose), 0)


## The seven numbers of a pose; missing members default to the identity.
static func row_from(pose: Dictionary) -> PackedFloat64Array:
	var position: Array = pose.get("position", [0.0, 0.0, 0.0])
	return PackedFloat64Array(position + pose.get("quaternion", [1.0, 0.0, 0.0, 0.0]))


## The pose from the seven numbers of a row.
static func pose_from_row(rows: PackedFloat64Array, row: int) -> Dictionary:
	var at: int = row * ROW
	return {
		"position": Array(rows.slice(at, at + 3)),
		"quaternion": Array(rows.slice(at + 3, at + ROW)),
	}


## The transform of a node from the seven numbers of a row.
static func transform_at(rows: PackedFloat64Array, row: int) -> Transform3D:
	var at: int = row * ROW
	# Normalized in double precision first, since maps have rounded quaternions.
	var norm: float = sqrt(
		(
			rows[at + 3] * rows[at + 3]
			+ rows[at + 4] * rows[at + 4]
			+ rows[at + 5] * rows[at + 5]
			+ rows[at + 6] * rows[at + 6]
		)
	)
	var orientation: Quaternion = Quaternion(
		-rows[at + 5] / norm, rows[at + 6] / norm, -rows[at + 4] / norm, rows[at + 3] / norm
	)
	return Transform3D(Basis(orientation.normalized()), vector(rows[at], rows[at + 1], rows[at + 2]))


## Writes the transform of a node as the seven numbers of a row.
static func write_row(rows: PackedFloat64Array, row: int, xform: Transform3D) -> void:
	var at: int = row * ROW
	var orientation: Quaternion = xform.basis.get_rotation_quaternion()
	rows[at] = -xform.origin.z
	rows[at + 1] = -xform.origin.x
	rows[at + 2] = xform.origin.y
	rows[at + 3] = orientation.w
	rows[at + 4] = -orientation.z
	rows[at + 5] = -orientation.x
	rows[at + 6] = orientation.y


## The frame of a joint. Its axes are those of ROS, so that twist is about x, swing 2 about y and swing 1 about z.
static func joint_frame(pose: Dictionary) -> Transform3D:
	var xform: Transform3D = transform_from(pose)
	return Transform3D(xform.basis * Basis(GODOT_FROM_ROS), xform.origin)


## Converts a Godot vector to ROS.
static func to_ros(here: Vector3) -> Vector3:
	return Vector3(-here.z, -here.x, here.y)


## A JSON number as a float; NaN if it is none.
static func number(value: Variant) -> float:
	return float(value) if value is float or value is int else NAN
