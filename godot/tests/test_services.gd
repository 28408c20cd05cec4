extends MindstageTestCase
## What is answered to calls, good ones and bad ones.


func test_who_is_there_is_told_with_a_session_of_its_own() -> void:
	var stage: MindstageStage = new_stage()
	var one: Dictionary = (await MindstageServices.new(stage).answer("describe", {})).values
	var other: Dictionary = (await MindstageServices.new(stage).answer("describe", {})).values
	same(one["engine"], "godot", "engine")
	same(one["takes"], ["forms", "plan"], "takes")
	check(one["session"] != other["session"] and one["session"].length() == 16, "session")
	await drop(stage)


func test_bad_input_is_answered_with_what_is_wrong() -> void:
	var stage: MindstageStage = new_stage()
	var services: MindstageServices = MindstageServices.new(stage)
	for each: Array in [
		["step", {"duration_s": -1.0}, "backwards"],
		["set_speed", {"speed": -2.0}, "backwards"],
		["spawn_world", {"world": "{"}, "no JSON"],
		["set_physics", {"id": "a", "physics": "[]"}, "no JSON object"],
		["set_materials", {"id": "a", "materials": "{}"}, "no JSON array"],
		["delete", {"ids": [1]}, "ids[0]: expected string"],
	]:
		var answer: MindstageServices.Answer = await services.answer(each[0], each[1])
		check(each[2] in answer.broke, "%s: %s" % [each[0], answer.broke])
	await drop(stage)


func test_what_the_world_refuses_is_no_breakdown() -> void:
	var stage: MindstageStage = new_stage()
	var services: MindstageServices = MindstageServices.new(stage)
	for call: Array in [
		["delete", {"ids": ["x"]}], ["push", {"id": "x"}], ["highlight", {"ids": ["x"]}], ["detach", {"child": "x"}]
	]:
		var answer: MindstageServices.Answer = await services.answer(call[0], call[1])
		same(answer.broke, "", call[0])
		same([answer.values["success"], answer.values["refusal"]["kind"]], [false, "BodyUnknown"], call[0])
	var seen: Dictionary = (
		(await services.answer("photograph", {"path": "user://x.png", "width": 8, "height": 8})).values
	)
	check("window" in seen["refusal"]["text"], "nothing is drawn without a window")
	await drop(stage)


func test_poses_come_packed_and_ids_only_to_whom_they_are_new() -> void:
	var stage: MindstageStage = new_stage()
	var services: MindstageServices = MindstageServices.new(stage)
	var box: Dictionary = MindstageScenes.body("box", [0.1, 0.2, 0.3], [1.0, 1.0, 1.0])
	await services.answer("spawn_world", {"world": MindstageScenes.world([box])})
	var first: Dictionary = (await services.answer("get_poses", {"packed": true})).values
	same(first["ids"], ["box"], "ids")
	var rows: PackedFloat64Array = Marshalls.base64_to_raw(first["rows"]).to_float64_array()
	same(rows, PackedFloat64Array([0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0]), "the very numbers")
	var again: Dictionary = (await services.answer("get_poses", {"packed": true, "known": first["revision"]})).values
	same(again["ids"], [], "known ids")
	await drop(stage)


func test_an_arrow_points_along_x_from_where_it_is() -> void:
	var box: AABB = MindstageMarkers._mesh(MindstageMarkers.Kind.ARROW, 2.0).get_aabb()
	near(box.position.z, -2.0, 1e-4, "its tip")
	near(box.end.z, 0.0, 1e-4, "its end")
	check(box.size.x < 0.5 and box.size.y < 0.5, "it is thin")


func test_markers_come_are_replaced_and_go() -> void:
	var stage: MindstageStage = new_stage()
	var services: MindstageServices = MindstageServices.new(stage)
	var named: Dictionary = (
		(await services.answer("display_basic_marker", {"marker_type": 1, "scale": 0.1, "marker_id": "a"})).values
	)
	same(named["marker_id"], "a", "its own name")
	var points: Array = [{"x": 0.0, "y": 0.0, "z": 0.0}, {"x": 1.0, "y": 0.0, "z": 0.0}]
	var trail: Dictionary = (await services.answer("display_trajectory", {"points": points})).values
	same(trail["marker_id"], "trajectory_1", "a name is made")
	same((await services.answer("remove_marker", {"marker_id": "a"})).values["success"], true, "it goes")
	same((await services.answer("remove_marker", {"marker_id": "a"})).values["success"], false, "it is gone")
	await drop(stage)
