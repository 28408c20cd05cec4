extends MindstageTestCase
## The golden messages in `wire/`, which the Python tests read too.

const _FILES: Array[String] = ["mindstage_msgs", "unreal_vis_msgs"]


func test_golden_requests_round_trip() -> void:
	_compare("request")


func test_golden_responses_round_trip() -> void:
	_compare("response")


func test_missing_request_fields_have_defaults() -> void:
	var reading: MindstageMessages.ReadResult = MindstageMessages.request("set_pose", {"id": "mug"})
	same(reading.error, "", "cause")
	same(reading.value["pose"]["orientation"]["w"], 1.0, "no turn")
	same(reading.value["plan"], "", "no plan")


func test_values_of_another_type_are_errors_with_the_path() -> void:
	for each: Array in [
		["delete", {"ids": "mug"}, "ids: expected array"],
		["step", {"duration_s": "long"}, "duration_s: expected float"],
		["step", {"forces": [{"force": {"x": null}}]}, "forces[0].force.x: expected float"],
		["get_poses", {"known": -1}, "known: expected int"],
		["describe", 7, "values: expected dictionary"],
	]:
		var cause: String = MindstageMessages.request(each[0], each[1]).error
		check(cause.begins_with(each[2]), "%s: %s" % [each[0], cause])


func test_services_have_paths_below_the_namespace() -> void:
	same(MindstageMessages.service_path("spawn_world", "/godot/"), "/godot/mindstage/spawn_world", "an engine's")
	same(MindstageMessages.service_path("remove_marker", "a/b"), "/a/b/remove_marker", "a marker's")


func _compare(part: String) -> void:
	var by_type: Dictionary = {}
	for service: String in MindstageMessages.SERVICES:
		by_type[MindstageMessages.SERVICES[service]["type"]] = service
	for file: String in _FILES:
		var path: String = ProjectSettings.globalize_path("res://").path_join("../wire/%s.json" % file)
		var cases: Variant = JSON.parse_string(FileAccess.get_file_as_string(path))
		check(cases is Array, "%s cannot be read" % path)
		for case: Dictionary in cases if cases is Array else []:
			if case["part"] != part or not by_type.has(case["type"]):
				continue
			var type: Dictionary = MindstageMessages.SERVICES[by_type[case["type"]]][part]
			var reading: MindstageMessages.ReadResult = MindstageMessages.read(type, case["json"])
			same(reading.error, "", case["name"])
			var again: Variant = JSON.parse_string(MindstageJsonText.write(reading.value))
			check(again == case["json"], "%s: %s is not %s" % [case["name"], again, case["json"]])
