extends MindstageTestCase
## Responses to valid and invalid service calls.


func test_describe_returns_a_unique_session() -> void:
	var simulation: MindstageSimulation = new_simulation()
	var one: Dictionary = (await MindstageServices.new(simulation).respond("describe", {})).values
	var other: Dictionary = (await MindstageServices.new(simulation).respond("describe", {})).values
	same(one["engine"], "godot", "engine")
	same(one["takes"], ["geometries", "plan"], "takes")
	check(one["session"] != other["session"] and one["session"].length() == 16, "session")
	await drop(simulation)


func test_invalid_requests_fail_with_the_cause() -> void:
	var simulation: MindstageSimulation = new_simulation()
	var services: MindstageServices = MindstageServices.new(simulation)
	for each: Array in [
		["step", {"duration_s": -1.0}, "must not be negative"],
		["set_speed", {"speed": -2.0}, "must not be negative"],
		["spawn_world", {"world": "{"}, "not a JSON object"],
		["set_physics", {"id": "a", "physics": "[]"}, "not a JSON object"],
		["set_materials", {"id": "a", "materials": "{}"}, "not a JSON array"],
		["delete", {"ids": [1]}, "ids[0]: expected string"],
	]:
		var answer: MindstageServices.Response = await services.respond(each[0], each[1])
		check(each[2] in answer.error, "%s: %s" % [each[0], answer.error])
	await drop(simulation)


func test_refused_edits_are_successful_calls_with_a_refusal() -> void:
	var simulation: MindstageSimulation = new_simulation()
	var services: MindstageServices = MindstageServices.new(simulation)
	for call: Array in [
		["delete", {"ids": ["x"]}], ["push", {"id": "x"}], ["highlight", {"ids": ["x"]}], ["detach", {"child": "x"}]
	]:
		var answer: MindstageServices.Response = await services.respond(call[0], call[1])
		same(answer.error, "", call[0])
		same([answer.values["success"], answer.values["refusal"]["code"]], [false, "BodyNotFoundError"], call[0])
	var seen: Dictionary = (
		(await services.respond("photograph", {"path": "user://x.png", "width": 8, "height": 8})).values
	)
	check("window" in seen["refusal"]["text"], "nothing is drawn without a window")
	await drop(simulation)


func test_packed_poses_have_ids_only_for_a_new_revision() -> void:
	var simulation: MindstageSimulation = new_simulation()
	var services: MindstageServices = MindstageServices.new(simulation)
	var box: Dictionary = MindstageExampleWorlds.body("box", [0.1, 0.2, 0.3], [1.0, 1.0, 1.0])
	await services.respond("spawn_world", {"world": MindstageExampleWorlds.world([box])})
	var first: Dictionary = (await services.respond("get_poses", {"packed": true})).values
	same(first["ids"], ["box"], "ids")
	var rows: PackedFloat64Array = Marshalls.base64_to_raw(first["rows"]).to_float64_array()
	same(rows, PackedFloat64Array([0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0]), "the very numbers")
	var again: Dictionary = (await services.respond("get_poses", {"packed": true, "known": first["revision"]})).values
	same(again["ids"], [], "known ids")
	await drop(simulation)


func test_an_arrow_points_along_x_from_its_origin() -> void:
	var box: AABB = MindstageMarkers._mesh(MindstageMarkers.Kind.ARROW, 2.0).get_aabb()
	near(box.position.z, -2.0, 1e-4, "its tip")
	near(box.end.z, 0.0, 1e-4, "its end")
	check(box.size.x < 0.5 and box.size.y < 0.5, "it is thin")


func test_markers_are_added_replaced_and_removed() -> void:
	var simulation: MindstageSimulation = new_simulation()
	var services: MindstageServices = MindstageServices.new(simulation)
	var named: Dictionary = (
		(await services.respond("display_basic_marker", {"marker_type": 1, "scale": 0.1, "marker_id": "a"})).values
	)
	same(named["marker_id"], "a", "its own name")
	var points: Array = [{"x": 0.0, "y": 0.0, "z": 0.0}, {"x": 1.0, "y": 0.0, "z": 0.0}]
	var trajectory: Dictionary = (await services.respond("display_trajectory", {"points": points})).values
	same(trajectory["marker_id"], "trajectory_1", "a name is made")
	same((await services.respond("remove_marker", {"marker_id": "a"})).values["success"], true, "it goes")
	same((await services.respond("remove_marker", {"marker_id": "a"})).values["success"], false, "it is gone")
	await drop(simulation)
