extends MindstageTestCase
## Conversion between ROS and Godot axes, on an asymmetric pose.

const POSE: Dictionary = {
	"position": [1.0, 2.0, 3.0], "quaternion": [0.9659258262890683, 0.0, 0.0, 0.25881904510252074]
}


func test_forward_left_and_up_are_converted() -> void:
	same(MindstageFrames.vector(1, 0, 0), Vector3.FORWARD, "forward")
	same(MindstageFrames.vector(0, 1, 0), Vector3.LEFT, "left")
	same(MindstageFrames.vector(0, 0, 1), Vector3.UP, "up")


func test_a_literal_pose_is_converted() -> void:
	var xform: Transform3D = MindstageFrames.transform_from(POSE)
	same(xform.origin, Vector3(-2, 3, -1), "origin")
	near(xform.basis.get_euler().y, deg_to_rad(30), 1e-6, "a turn to the left about up")
	near((xform.basis * Vector3.FORWARD).x, -0.5, 1e-6, "forward now looks to the left")


func test_a_pose_round_trip() -> void:
	var row: PackedFloat64Array = MindstageFrames.row_from({})
	var pose: Dictionary = {"position": [1.0, -2.0, 3.0], "quaternion": [0.5, -0.5, 0.1, 0.7]}
	MindstageFrames.write_row(row, 0, MindstageFrames.transform_from(pose))
	var given: PackedFloat64Array = MindstageFrames.row_from(pose)
	for axis: int in 3:
		near(row[axis], given[axis], 1e-6, "position %d" % axis)
	var orientation: Quaternion = Quaternion(row[4], row[5], row[6], row[3])
	near(absf(orientation.dot(Quaternion(-0.5, 0.1, 0.7, 0.5).normalized())), 1.0, 1e-6, "turn")


func test_a_joint_frame_has_the_axes_of_ros() -> void:
	var frame: Transform3D = MindstageFrames.joint_frame({})
	check((frame.basis * Vector3.RIGHT).is_equal_approx(Vector3.FORWARD), "twist is about forward")
	check((frame.basis * Vector3.UP).is_equal_approx(Vector3.LEFT), "swing 2 is about left")
	check((frame.basis * Vector3.BACK).is_equal_approx(Vector3.UP), "swing 1 is about up")


func test_extents_have_no_sign() -> void:
	same(MindstageFrames.extents([1.0, 2.0, 3.0]), Vector3(2, 3, 1), "extents")
