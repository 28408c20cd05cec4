extends SceneTree
## The peer of benchmarks/godot.py: the same boxes as a hand-written scene.
##
## `godot --headless --path PROJECT --script bare_boxes.gd -- COUNT TICKS` prints the times of building, stepping and
## reading poses as JSON. Every tenth box is dynamic; a floor is added.

const TICK_S: float = 1.0 / 240.0
const RATE: int = 1_000_000
const RUNS: int = 5

var _nodes: Array[Node3D] = []
var _root: Node3D


func _initialize() -> void:
	var arguments: PackedStringArray = OS.get_cmdline_user_args()
	_measure.call_deferred(int(arguments[0]), int(arguments[1]))


func _measure(count: int, ticks: int) -> void:
	var building: PackedFloat64Array = []
	for _run: int in RUNS:
		if _root != null:
			_root.free()
			await process_frame
		var start: int = Time.get_ticks_usec()
		_build(count)
		building.append((Time.get_ticks_usec() - start) / 1000.0)
	await physics_frame
	Engine.physics_ticks_per_second = RATE
	Engine.max_physics_steps_per_frame = 48
	Engine.time_scale = RATE * TICK_S
	var begin: int = Time.get_ticks_usec()
	for _tick: int in ticks:
		await physics_frame
	var stepping: float = (Time.get_ticks_usec() - begin) / 1000.0 / ticks
	var reading: PackedFloat64Array = []
	for _run: int in RUNS:
		var start: int = Time.get_ticks_usec()
		var poses: Array[Transform3D] = []
		for node: Node3D in _nodes:
			poses.append(node.global_transform)
		reading.append((Time.get_ticks_usec() - start) / 1000.0)
	building.sort()
	reading.sort()
	print(JSON.stringify({"build_ms": building[2], "tick_ms": stepping, "read_ms": reading[2]}))
	quit(0)


func _build(count: int) -> void:
	_nodes.clear()
	_root = Node3D.new()
	var side: int = ceili(sqrt(count))
	_add(Vector3(side / 2.0, -0.05, -side / 2.0), Vector3(side + 2.0, 0.1, side + 2.0), false)
	for index: int in count:
		var place: Vector3 = Vector3(index % side, 0.25, -floori(float(index) / side))
		_add(place, Vector3(0.5, 0.5, 0.5), index % 10 == 0)
	root.add_child(_root)


func _add(at: Vector3, size: Vector3, moves: bool) -> void:
	var body: PhysicsBody3D = StaticBody3D.new()
	if moves:
		var rigid: RigidBody3D = RigidBody3D.new()
		rigid.mass = 3.0
		body = rigid
	body.position = at
	var touched: CollisionShape3D = CollisionShape3D.new()
	var box: BoxShape3D = BoxShape3D.new()
	box.size = size
	touched.shape = box
	body.add_child(touched)
	var seen: MeshInstance3D = MeshInstance3D.new()
	var mesh: BoxMesh = BoxMesh.new()
	mesh.size = size
	seen.mesh = mesh
	body.add_child(seen)
	_root.add_child(body)
	_nodes.append(body)
