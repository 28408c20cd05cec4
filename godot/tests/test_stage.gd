extends MindstageTestCase
## A world that lives here, without anybody who decides for it.


func test_a_world_comes_back_to_the_last_digit() -> void:
	var stage: MindstageStage = new_stage()
	var given: String = (
		'{"iri":"m","name":"é","bodies":[{"id":"a","iri":"x","cls":"c","facts":[{"o":"1.50"}],'
		+ '"pose":{"position":[0.10,1e-3,3],"quaternion":[0.999999,0.0,0.0,0.001]},"size":[1,2,3.50]}],"format_version":1}'
	)
	var added: MindstageInventory.Added = MindstageInventory.Added.new()
	same(stage.spawn(given, "", "", added), "", "reason")
	same(added.bodies.size(), 1, "bodies")
	var bodies: String = MindstageJsonText.members(stage.world_text())["bodies"]
	same(bodies, MindstageJsonText.members(given)["bodies"], "the very text")
	await drop(stage)


func test_what_is_no_world_is_refused() -> void:
	var stage: MindstageStage = new_stage()
	var added: MindstageInventory.Added = MindstageInventory.Added.new()
	check("no JSON" in stage.spawn("no", "", "", added), "no JSON")
	check("format_version" in stage.spawn('{"format_version":9}', "", "", added), "another version")
	same(stage.inventory.bodies.size(), 0, "nothing came")
	await drop(stage)


func test_a_box_falls_and_rests() -> void:
	var stage: MindstageStage = new_stage()
	_spawn(stage, [_floor(), MindstageScenes.body("box", [0.0, 0.0, 1.0], [0.2, 0.2, 0.2], "dynamic", 1.0)])
	await stage.step(2.0)
	near(stage.clock.time_s(), 2.0, 1e-9, "time")
	near(_row(stage, "box")[2], 0.1, 0.002, "height")
	await drop(stage)


func test_time_is_kept_that_is_less_than_a_tick() -> void:
	var stage: MindstageStage = new_stage()
	for step: int in 60:
		await stage.step(0.001)
	near(stage.clock.time_s(), 0.06, MindstageClock.TICK_S, "time")
	await drop(stage)


func test_time_passes_by_itself_at_the_speed_that_it_is_told() -> void:
	var stage: MindstageStage = new_stage()
	_spawn(stage, [MindstageScenes.body("ball", [0.0, 0.0, 9.0], [0.2, 0.2, 0.2], "dynamic", 1.0)])
	same(stage.clock.play(2.0), 0.0, "it stood still")
	while stage.clock.time_s() < 0.3:
		await tree.process_frame
	same(stage.clock.play(0.0), 2.0, "it went twice as fast as the clock on the wall")
	await tree.process_frame
	var time_s: float = stage.clock.time_s()
	near(_row(stage, "ball")[2], 9.0 - 0.5 * 9.81 * time_s * time_s, 0.05, "it fell all the while")
	for frame: int in 5:
		await tree.process_frame
	same(stage.clock.time_s(), time_s, "now it stands still")
	await drop(stage)


func test_a_drawer_slides_between_the_ends_of_its_range_and_its_handle_with_it() -> void:
	var stage: MindstageStage = new_stage()
	var added: MindstageInventory.Added = MindstageInventory.Added.new()
	stage.spawn(MindstageScenes.drawer({"linear": {"x": 1, "limit": 0.2, "x_middle": 0.2}}), "", "", added)
	for end: Array in [[30.0, 0.4], [-30.0, 0.0]]:
		stage.push("handle", MindstageFrames.vector(end[0], 0.0, 0.0), null)
		await stage.step(2.0)
		near(_row(stage, "drawer")[0], end[1], 0.002, "the drawer")
		near(_row(stage, "handle")[0], end[1] + 0.32, 0.002, "its handle")
		near(stage.assembler.joints["slide"].position_of_axes()[0], end[1], 0.002, "the joint tells it")
	await drop(stage)


func test_a_soft_limit_gives_way_like_a_spring() -> void:
	var stage: MindstageStage = new_stage()
	var soft: Dictionary = {"enabled": true, "stiffness": 400.0, "damping": 60.0}
	var added: MindstageInventory.Added = MindstageInventory.Added.new()
	stage.spawn(MindstageScenes.drawer({"linear": {"x": 1, "limit": 0.1, "soft": soft}}), "", "", added)
	stage.push("drawer", MindstageFrames.vector(45.0, 0.0, 0.0), null)
	await stage.step(3.0)
	near(_row(stage, "drawer")[0], 0.1 + 40.0 / 400.0, 0.02, "beyond its limit by the force over the stiffness")
	await drop(stage)


func test_each_hinge_turns_about_its_own_axis_the_way_it_says() -> void:
	for told: Array in [["twist", 3], ["swing2", 4], ["swing1", 5]]:
		var stage: MindstageStage = new_stage()
		var motions: Dictionary = {"angular": {told[0]: 1, told[0] + "_limit": 0.3, told[0] + "_middle": 0.1}}
		_spawn(
			stage,
			[
				MindstageScenes.body("base", [0.0, 0.0, 1.0], [0.2, 0.2, 0.2]),
				MindstageScenes.body("arm", [0.5, 0.0, 1.0], [0.4, 0.4, 0.4], "dynamic", 1.0),
			],
			[MindstageScenes.joint("pin", "base", "arm", [0.5, 0.0, 1.0], motions)]
		)
		var arm: RID = stage.inventory.bodies["arm"].carrier.node.get_rid()
		var axis: Vector3 = MindstageFrames.vector_from(
			[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]][told[1] - 3]
		)
		for way: Array in [[1.0, 0.4], [-1.0, -0.2]]:
			PhysicsServer3D.body_set_constant_torque(arm, axis * 5.0 * way[0])
			await stage.step(2.0)
			near(stage.assembler.joints["pin"].position_of_axes()[told[1]], way[1], 0.005, told[0])
		await drop(stage)


func test_what_is_put_elsewhere_takes_along_what_hangs_on_it() -> void:
	var stage: MindstageStage = new_stage()
	_spawn(
		stage,
		[
			MindstageScenes.body("table", [0.0, 0.0, 1.0], [1.0, 1.0, 0.1], "kinematic"),
			MindstageScenes.body("lamp", [0.3, 0.0, 1.2], [0.1, 0.1, 0.3], "kinematic"),
		],
		[],
		[{"parent": "table", "child": "lamp"}]
	)
	var half: float = sqrt(0.5)
	same(stage.set_pose("table", {"position": [5.0, 5.0, 5.0], "quaternion": [half, 0.0, 0.0, half]}, ""), {}, "put")
	var lamp: PackedFloat64Array = _row(stage, "lamp")
	near(lamp[0], 5.0, 1e-5, "x")
	near(lamp[1], 5.3, 1e-5, "y")
	near(lamp[2], 5.2, 1e-5, "z")
	near(lamp[6], half, 1e-5, "turned")
	await drop(stage)


func test_a_child_of_a_moving_body_can_be_let_go() -> void:
	var stage: MindstageStage = new_stage()
	_spawn(
		stage,
		[
			_floor(),
			MindstageScenes.body("cart", [0.0, 0.0, 1.0], [0.4, 0.4, 0.2], "dynamic", 5.0),
			MindstageScenes.body("cup", [0.0, 0.0, 1.15], [0.1, 0.1, 0.1], "dynamic", 0.2),
		],
		[],
		[{"parent": "cart", "child": "cup"}]
	)
	same(stage.inventory.bodies["cup"].carrier.id, "cart", "one physics node")
	stage.push("cup", MindstageFrames.vector(20.0, 0.0, 0.0), null)
	await stage.step(0.2)
	var speed: float = stage.inventory.bodies["cart"].carrier.linear_velocity().length()
	same(stage.detach("cup", ""), {}, "let go")
	same(stage.inventory.bodies["cup"].carrier.id, "cup", "one of its own")
	near(stage.inventory.bodies["cup"].carrier.linear_velocity().length(), speed, 0.2, "as fast as before")
	await drop(stage)


func test_unknown_bodies_circles_and_no_rotations_are_refused() -> void:
	var stage: MindstageStage = new_stage()
	_spawn(stage, [_floor(), MindstageScenes.body("drawer", [0.0, 0.0, 1.0], [1.0, 1.0, 1.0])])
	var refusal: Dictionary = stage.delete(["drawr"], "")
	same(refusal["kind"], "BodyUnknown", "kind")
	same(refusal["near"], ["drawer"], "near")
	same(stage.attach("drawer", "drawer", "")["kind"], "AttachmentRefused", "itself")
	stage.attach("floor", "drawer", "")
	check("circle" in stage.attach("drawer", "floor", "")["reason"], "a circle")
	var nowhere: Dictionary = {"position": [0.0, 0.0, 0.0], "quaternion": [0.0, 0.0, 0.0, 0.0]}
	same(stage.set_pose("drawer", nowhere, "")["kind"], "PoseUnreachable", "no rotation")
	same(stage.inventory.bodies.size(), 2, "nothing changed")
	await drop(stage)


func test_deleting_takes_constraints_and_attachments_along() -> void:
	var stage: MindstageStage = new_stage()
	stage.spawn(MindstageScenes.drawer({"linear": {"x": 1, "limit": 0.2}}), "", "", MindstageInventory.Added.new())
	same(stage.delete(["drawer"], ""), {}, "deleted")
	same(stage.inventory.bodies.keys(), ["case", "handle"], "what is left")
	same(stage.inventory.constraints.size() + stage.inventory.parents.size(), 0, "what joined it")
	same(stage.assembler.joints.size(), 0, "no joint")
	await stage.step(0.1)
	near(_row(stage, "handle")[0], 0.32, 1e-6, "its handle stays")
	await drop(stage)


func test_overlaps_are_told_where_a_body_asks_for_it() -> void:
	var stage: MindstageStage = new_stage()
	var asks: Dictionary = {"physics": {"mobility": "static", "overlap_events": true}}
	_spawn(
		stage,
		[
			MindstageScenes.body("pad", [0.0, 0.0, 0.0], [1.0, 1.0, 0.2], "static", 0.0, asks),
			MindstageScenes.body("ball", [0.0, 0.0, 0.5], [0.2, 0.2, 0.2], "dynamic", 1.0),
		]
	)
	var events: Array[Dictionary] = []
	stage.overlapped.connect(func(event: Dictionary) -> void: events.append(event))
	await stage.step(1.0)
	await stage.step(0.1)
	check(events.size() > 0, "something was told")
	if events:
		same([events[0]["body"], events[0]["other"], events[0]["began"]], ["pad", "ball", true], "what")
	await drop(stage)


func _spawn(stage: MindstageStage, bodies: Array, constraints: Array = [], attachments: Array = []) -> void:
	var added: MindstageInventory.Added = MindstageInventory.Added.new()
	same(stage.spawn(MindstageScenes.world(bodies, constraints, attachments), "", "", added), "", "spawned")
	same(added.bodies.size(), bodies.size(), "bodies")
	same(added.constraints.size(), constraints.size(), "constraints")


static func _floor() -> Dictionary:
	return MindstageScenes.body("floor", [0.0, 0.0, -0.05], [20.0, 20.0, 0.1])


static func _row(stage: MindstageStage, id: String) -> PackedFloat64Array:
	var at: int = stage.inventory.bodies[id].row * MindstageFrames.ROW
	return stage.rows().slice(at, at + MindstageFrames.ROW)


func test_a_scene_file_holds_all_and_nothing_of_the_addon() -> void:
	var stage: MindstageStage = new_stage()
	stage.spawn(MindstageScenes.drawer({"linear": {"x": 1, "limit": 0.2}}), "", "", MindstageInventory.Added.new())
	var path: String = "user://scene_test.tscn"
	same(MindstageSceneFile.save(stage, path), "", "saved")
	check("no scene file" in MindstageSceneFile.save(stage, "user://scene.png"), "another name")
	var text: String = FileAccess.get_file_as_string(path)
	check("RigidBody3D" in text and "Generic6DOFJoint3D" in text and "BoxMesh" in text, "its nodes")
	check(not "gdscript" in text.to_lower() and not "res://addons" in text, "no script")
	var scene: Node = (load(path) as PackedScene).instantiate()
	same(scene.find_children("*", "CollisionObject3D").size(), 2, "physics nodes")
	scene.free()
	DirAccess.remove_absolute(ProjectSettings.globalize_path(path))
	await drop(stage)


func test_bodies_are_found_by_their_tags() -> void:
	var stage: MindstageStage = new_stage()
	var tag: Dictionary = {"type": "SemLog", "key": "Class", "value": "Cup"}
	_spawn(
		stage, [_floor(), MindstageScenes.body("cup", [0.0, 0.0, 1.0], [0.1, 0.1, 0.1], "static", 0.0, {"tags": [tag]})]
	)
	var found: Array[Node] = MindstageTags.find(stage, "SemLog", "Class", "Cup")
	same(found.size(), 1, "one cup")
	same(MindstageTags.value(found[0], "SemLog", "Class"), "Cup", "its value")
	same(MindstageTags.find(stage, "SemLog", "Class", "Plate").size(), 0, "no plate")
	await drop(stage)


func test_a_lit_body_stays_lit_when_it_is_made_anew() -> void:
	MindstageLooks.always = true
	var stage: MindstageStage = new_stage()
	_spawn(stage, [_floor(), MindstageScenes.body("cup", [0.0, 0.0, 1.0], [0.1, 0.1, 0.1])])
	same(stage.highlight(["cup"], Color.RED), {}, "lit")
	stage.set_materials("cup", '[{"name":"oak"}]')
	stage.set_physics("cup", '{"mobility":"dynamic"}', "")
	var parts: Array[MeshInstance3D] = MindstageLooks.parts(stage.inventory.bodies["cup"].node)
	same(parts.size(), 1, "parts")
	check(parts[0].material_overlay != null, "a coat")
	same(stage.highlight(["cup"], Color.TRANSPARENT), {}, "put out")
	check(parts[0].material_overlay == null, "no coat")
	same(stage.inventory.lit.size(), 0, "nothing is lit")
	await drop(stage)
