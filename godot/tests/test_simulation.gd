extends MindstageTestCase
## Simulations with the default physics model.


func test_a_world_is_returned_with_all_digits() -> void:
	var simulation: MindstageSimulation = new_simulation()
	var given: String = (
		'{"iri":"m","name":"é","bodies":[{"id":"a","iri":"x","cls":"c","facts":[{"o":"1.50"}],'
		+ '"pose":{"position":[0.10,1e-3,3],"quaternion":[0.999999,0.0,0.0,0.001]},"size":[1,2,3.50]}],"format_version":2}'
	)
	var result: MindstageWorldModel.SpawnResult = MindstageWorldModel.SpawnResult.new()
	same(simulation.spawn(given, "", "", result), "", "reason")
	same(result.bodies.size(), 1, "bodies")
	var bodies: String = MindstageJsonText.members(simulation.world_text())["bodies"]
	same(bodies, MindstageJsonText.members(given)["bodies"], "the very text")
	await drop(simulation)


func test_an_invalid_world_is_refused() -> void:
	var simulation: MindstageSimulation = new_simulation()
	var result: MindstageWorldModel.SpawnResult = MindstageWorldModel.SpawnResult.new()
	check("not a JSON object" in simulation.spawn("no", "", "", result), "no JSON")
	check("format_version" in simulation.spawn('{"format_version":9}', "", "", result), "another version")
	same(simulation.world_model.bodies.size(), 0, "nothing came")
	await drop(simulation)


func test_a_box_falls_and_rests() -> void:
	var simulation: MindstageSimulation = new_simulation()
	_spawn(simulation, [_floor(), MindstageExampleWorlds.body("box", [0.0, 0.0, 1.0], [0.2, 0.2, 0.2], "dynamic", 1.0)])
	await simulation.step(2.0)
	near(simulation.clock.time_s(), 2.0, 1e-9, "time")
	near(_row(simulation, "box")[2], 0.1, 0.002, "height")
	await drop(simulation)


func test_time_shorter_than_a_tick_accumulates() -> void:
	var simulation: MindstageSimulation = new_simulation()
	for step: int in 60:
		await simulation.step(0.001)
	near(simulation.clock.time_s(), 0.06, MindstageClock.TICK_S, "time")
	await drop(simulation)


func test_the_simulation_plays_at_the_given_speed() -> void:
	var simulation: MindstageSimulation = new_simulation()
	_spawn(simulation, [MindstageExampleWorlds.body("ball", [0.0, 0.0, 9.0], [0.2, 0.2, 0.2], "dynamic", 1.0)])
	same(simulation.clock.play(2.0), 0.0, "it stood still")
	while simulation.clock.time_s() < 0.3:
		await tree.process_frame
	same(simulation.clock.play(0.0), 2.0, "it went twice as fast as the clock on the wall")
	await tree.process_frame
	var time_s: float = simulation.clock.time_s()
	near(_row(simulation, "ball")[2], 9.0 - 0.5 * 9.81 * time_s * time_s, 0.05, "it fell all the while")
	for frame: int in 5:
		await tree.process_frame
	same(simulation.clock.time_s(), time_s, "now it stands still")
	await drop(simulation)


func test_a_drawer_moves_within_its_limits_with_its_handle() -> void:
	var simulation: MindstageSimulation = new_simulation()
	var result: MindstageWorldModel.SpawnResult = MindstageWorldModel.SpawnResult.new()
	simulation.spawn(MindstageExampleWorlds.drawer({"linear": {"x": 1, "limit": 0.2, "x_middle": 0.2}}), "", "", result)
	for end: Array in [[30.0, 0.4], [-30.0, 0.0]]:
		simulation.apply_force("handle", MindstageFrames.vector(end[0], 0.0, 0.0), null)
		await simulation.step(2.0)
		near(_row(simulation, "drawer")[0], end[1], 0.002, "the drawer")
		near(_row(simulation, "handle")[0], end[1] + 0.32, 0.002, "its handle")
		near(simulation.physics_scene.joints["slide"].joint_position()[0], end[1], 0.002, "the joint tells it")
	await drop(simulation)


func test_a_soft_limit_is_a_spring() -> void:
	var simulation: MindstageSimulation = new_simulation()
	var soft: Dictionary = {"enabled": true, "stiffness": 400.0, "damping": 60.0}
	var result: MindstageWorldModel.SpawnResult = MindstageWorldModel.SpawnResult.new()
	simulation.spawn(
		MindstageExampleWorlds.drawer({"linear": {"x": 1, "limit": 0.1, "soft_limit": soft}}), "", "", result
	)
	simulation.apply_force("drawer", MindstageFrames.vector(45.0, 0.0, 0.0), null)
	await simulation.step(3.0)
	near(_row(simulation, "drawer")[0], 0.1 + 40.0 / 400.0, 0.02, "beyond its limit by the force over the stiffness")
	await drop(simulation)


func test_each_hinge_rotates_about_its_axis_within_its_limits() -> void:
	for case: Array in [["twist", 3], ["swing2", 4], ["swing1", 5]]:
		var simulation: MindstageSimulation = new_simulation()
		var motions: Dictionary = {"angular": {case[0]: 1, case[0] + "_limit": 0.3, case[0] + "_middle": 0.1}}
		_spawn(
			simulation,
			[
				MindstageExampleWorlds.body("base", [0.0, 0.0, 1.0], [0.2, 0.2, 0.2]),
				MindstageExampleWorlds.body("arm", [0.5, 0.0, 1.0], [0.4, 0.4, 0.4], "dynamic", 1.0),
			],
			[MindstageExampleWorlds.joint("pin", "base", "arm", [0.5, 0.0, 1.0], motions)]
		)
		var arm: RID = simulation.world_model.bodies["arm"].group.node.get_rid()
		var axis: Vector3 = MindstageFrames.vector_from(
			[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]][case[1] - 3]
		)
		for way: Array in [[1.0, 0.4], [-1.0, -0.2]]:
			PhysicsServer3D.body_set_constant_torque(arm, axis * 5.0 * way[0])
			await simulation.step(2.0)
			near(simulation.physics_scene.joints["pin"].joint_position()[case[1]], way[1], 0.005, case[0])
		await drop(simulation)


func test_set_pose_moves_attached_bodies() -> void:
	var simulation: MindstageSimulation = new_simulation()
	_spawn(
		simulation,
		[
			MindstageExampleWorlds.body("table", [0.0, 0.0, 1.0], [1.0, 1.0, 0.1], "kinematic"),
			MindstageExampleWorlds.body("lamp", [0.3, 0.0, 1.2], [0.1, 0.1, 0.3], "kinematic"),
		],
		[],
		[{"parent": "table", "child": "lamp"}]
	)
	var half: float = sqrt(0.5)
	same(
		simulation.set_pose("table", {"position": [5.0, 5.0, 5.0], "quaternion": [half, 0.0, 0.0, half]}, ""), {}, "put"
	)
	var lamp: PackedFloat64Array = _row(simulation, "lamp")
	near(lamp[0], 5.0, 1e-5, "x")
	near(lamp[1], 5.3, 1e-5, "y")
	near(lamp[2], 5.2, 1e-5, "z")
	near(lamp[6], half, 1e-5, "turned")
	await drop(simulation)


func test_a_child_of_a_moving_body_can_be_detached() -> void:
	var simulation: MindstageSimulation = new_simulation()
	_spawn(
		simulation,
		[
			_floor(),
			MindstageExampleWorlds.body("cart", [0.0, 0.0, 1.0], [0.4, 0.4, 0.2], "dynamic", 5.0),
			MindstageExampleWorlds.body("cup", [0.0, 0.0, 1.15], [0.1, 0.1, 0.1], "dynamic", 0.2),
		],
		[],
		[{"parent": "cart", "child": "cup"}]
	)
	same(simulation.world_model.bodies["cup"].group.id, "cart", "one physics node")
	simulation.apply_force("cup", MindstageFrames.vector(20.0, 0.0, 0.0), null)
	await simulation.step(0.2)
	var speed: float = simulation.world_model.bodies["cart"].group.linear_velocity().length()
	same(simulation.detach("cup", ""), {}, "let go")
	same(simulation.world_model.bodies["cup"].group.id, "cup", "one of its own")
	near(simulation.world_model.bodies["cup"].group.linear_velocity().length(), speed, 0.2, "as fast as before")
	await drop(simulation)


func test_unknown_bodies_circles_and_zero_quaternions_are_refused() -> void:
	var simulation: MindstageSimulation = new_simulation()
	_spawn(simulation, [_floor(), MindstageExampleWorlds.body("drawer", [0.0, 0.0, 1.0], [1.0, 1.0, 1.0])])
	var refusal: Dictionary = simulation.delete(["drawr"], "")
	same(refusal["code"], "BodyNotFoundError", "code")
	same(refusal["suggestions"], ["drawer"], "suggestions")
	same(simulation.attach("drawer", "drawer", "")["code"], "AttachmentError", "itself")
	simulation.attach("floor", "drawer", "")
	check("circle" in simulation.attach("drawer", "floor", "")["reason"], "a circle")
	var nowhere: Dictionary = {"position": [0.0, 0.0, 0.0], "quaternion": [0.0, 0.0, 0.0, 0.0]}
	same(simulation.set_pose("drawer", nowhere, "")["code"], "PoseUnreachableError", "no rotation")
	same(simulation.world_model.bodies.size(), 2, "nothing changed")
	await drop(simulation)


func test_deleting_removes_joints_and_attachments() -> void:
	var simulation: MindstageSimulation = new_simulation()
	simulation.spawn(
		MindstageExampleWorlds.drawer({"linear": {"x": 1, "limit": 0.2}}), "", "", MindstageWorldModel.SpawnResult.new()
	)
	same(simulation.delete(["drawer"], ""), {}, "deleted")
	same(simulation.world_model.bodies.keys(), ["case", "handle"], "what is left")
	same(simulation.world_model.joints.size() + simulation.world_model.parents.size(), 0, "what joined it")
	same(simulation.physics_scene.joints.size(), 0, "no joint")
	await simulation.step(0.1)
	near(_row(simulation, "handle")[0], 0.32, 1e-6, "its handle stays")
	await drop(simulation)


func test_overlap_events_are_emitted_if_enabled() -> void:
	var simulation: MindstageSimulation = new_simulation()
	var enabled: Dictionary = {"physics": {"mobility": "static", "overlap_events": true}}
	_spawn(
		simulation,
		[
			MindstageExampleWorlds.body("pad", [0.0, 0.0, 0.0], [1.0, 1.0, 0.2], "static", 0.0, enabled),
			MindstageExampleWorlds.body("ball", [0.0, 0.0, 0.5], [0.2, 0.2, 0.2], "dynamic", 1.0),
		]
	)
	var events: Array[Dictionary] = []
	simulation.overlapped.connect(func(event: Dictionary) -> void: events.append(event))
	await simulation.step(1.0)
	await simulation.step(0.1)
	check(events.size() > 0, "something was told")
	if events:
		same([events[0]["body"], events[0]["other"], events[0]["began"]], ["pad", "ball", true], "what")
	await drop(simulation)


func _spawn(simulation: MindstageSimulation, bodies: Array, joints: Array = [], attachments: Array = []) -> void:
	var result: MindstageWorldModel.SpawnResult = MindstageWorldModel.SpawnResult.new()
	same(simulation.spawn(MindstageExampleWorlds.world(bodies, joints, attachments), "", "", result), "", "spawned")
	same(result.bodies.size(), bodies.size(), "bodies")
	same(result.joints.size(), joints.size(), "joints")


static func _floor() -> Dictionary:
	return MindstageExampleWorlds.body("floor", [0.0, 0.0, -0.05], [20.0, 20.0, 0.1])


static func _row(simulation: MindstageSimulation, id: String) -> PackedFloat64Array:
	var at: int = simulation.world_model.bodies[id].row * MindstageFrames.ROW
	return simulation.rows().slice(at, at + MindstageFrames.ROW)


func test_a_scene_file_is_complete_and_independent_of_the_addon() -> void:
	var simulation: MindstageSimulation = new_simulation()
	simulation.spawn(
		MindstageExampleWorlds.drawer({"linear": {"x": 1, "limit": 0.2}}), "", "", MindstageWorldModel.SpawnResult.new()
	)
	var path: String = "user://scene_test.tscn"
	same(MindstageSceneFile.save(simulation, path), "", "saved")
	check("not a scene file name" in MindstageSceneFile.save(simulation, "user://scene.png"), "another name")
	var text: String = FileAccess.get_file_as_string(path)
	check("RigidBody3D" in text and "Generic6DOFJoint3D" in text and "BoxMesh" in text, "its nodes")
	check(not "gdscript" in text.to_lower() and not "res://addons" in text, "no script")
	var scene: Node = (load(path) as PackedScene).instantiate()
	same(scene.find_children("*", "CollisionObject3D").size(), 2, "physics nodes")
	scene.free()
	DirAccess.remove_absolute(ProjectSettings.globalize_path(path))
	await drop(simulation)


func test_bodies_are_found_by_their_tags() -> void:
	var simulation: MindstageSimulation = new_simulation()
	var tag: Dictionary = {"type": "SemLog", "key": "Class", "value": "Cup"}
	_spawn(
		simulation,
		[_floor(), MindstageExampleWorlds.body("cup", [0.0, 0.0, 1.0], [0.1, 0.1, 0.1], "static", 0.0, {"tags": [tag]})]
	)
	var found: Array[Node] = MindstageTags.find(simulation, "SemLog", "Class", "Cup")
	same(found.size(), 1, "one cup")
	same(MindstageTags.value(found[0], "SemLog", "Class"), "Cup", "its value")
	same(MindstageTags.find(simulation, "SemLog", "Class", "Plate").size(), 0, "no plate")
	await drop(simulation)


func test_a_highlight_survives_rebuilding_a_body() -> void:
	MindstageVisuals.always_enabled = true
	var simulation: MindstageSimulation = new_simulation()
	_spawn(simulation, [_floor(), MindstageExampleWorlds.body("cup", [0.0, 0.0, 1.0], [0.1, 0.1, 0.1])])
	same(simulation.highlight(["cup"], Color.RED), {}, "lit")
	simulation.set_materials("cup", '[{"name":"oak"}]')
	simulation.set_physics("cup", '{"mobility":"dynamic"}', "")
	var parts: Array[MeshInstance3D] = MindstageVisuals.mesh_instances(simulation.world_model.bodies["cup"].node)
	same(parts.size(), 1, "parts")
	check(parts[0].material_overlay != null, "a coat")
	same(simulation.highlight(["cup"], Color.TRANSPARENT), {}, "put out")
	check(parts[0].material_overlay == null, "no coat")
	same(simulation.world_model.highlights.size(), 0, "nothing is lit")
	await drop(simulation)
