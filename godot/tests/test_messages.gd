extends MindstageTestCase
## The golden messages of the wire: what the other end reads and writes, this end reads and writes too.

const _FILES: Array[String] = ["mindstage_msgs", "unreal_vis_msgs"]


func test_every_golden_request_is_read_as_it_is_written() -> void:
	_compare("request")


func test_every_golden_response_is_written_as_it_is_read() -> void:
	_compare("response")


func test_what_is_left_out_of_a_request_has_its_default() -> void:
	var reading: MindstageMessages.Reading = MindstageMessages.request("set_pose", {"id": "mug"})
	same(reading.cause, "", "cause")
	same(reading.value["pose"]["orientation"]["w"], 1.0, "no turn")
	same(reading.value["plan"], "", "no plan")


func test_what_is_of_another_kind_is_refused_with_its_path() -> void:
	for each: Array in [
		["delete", {"ids": "mug"}, "ids: expected array"],
		["step", {"duration_s": "long"}, "duration_s: expected float"],
		["step", {"forces": [{"force": {"x": null}}]}, "forces[0].force.x: expected float"],
		["get_poses", {"known": -1}, "known: expected int"],
		["describe", 7, "values: expected dictionary"],
	]:
		var cause: String = MindstageMessages.request(each[0], each[1]).cause
		check(cause.begins_with(each[2]), "%s: %s" % [each[0], cause])


func test_services_have_their_places() -> void:
	same(MindstageMessages.place("spawn_world", "/godot/"), "/godot/mindstage/spawn_world", "an engine's")
	same(MindstageMessages.place("remove_marker", "a/b"), "/a/b/remove_marker", "a marker's")


func _compare(part: String) -> void:
	var by_type: Dictionary = {}
	for service: String in MindstageMessages.SERVICES:
		by_type[MindstageMessages.SERVICES[service]["type"]] = service
	for file: String in _FILES:
		var path: String = ProjectSettings.globalize_path("res://").path_join("../wire/%s.json" % file)
		var cases: Variant = JSON.parse_string(FileAccess.get_file_as_string(path))
		check(cases is Array, "%s cannot be read" % path)
		for told: Dictionary in cases if cases is Array else []:
			if told["part"] != part or not by_type.has(told["type"]):
				continue
			var type: Dictionary = MindstageMessages.SERVICES[by_type[told["type"]]][part]
			var reading: MindstageMessages.Reading = MindstageMessages.read(type, told["json"])
			same(reading.cause, "", told["name"])
			var again: Variant = JSON.parse_string(MindstageJsonText.write(reading.value))
			check(again == told["json"], "%s: %s is not %s" % [told["name"], again, told["json"]])
