extends SceneTree
## Runs all tests in this folder: `godot --headless --path godot --script tests/run.gd [-- WORD]`. The exit code is 1
## if a test fails.

const _FOLDER: String = "res://tests"


func _initialize() -> void:
	await process_frame
	var words: PackedStringArray = OS.get_cmdline_user_args()
	var failed: int = 0
	var passed: int = 0
	for file: String in DirAccess.get_files_at(_FOLDER):
		if not file.begins_with("test_") or not file.ends_with(".gd") or file == "test_case.gd":
			continue
		for name_of_test: String in _tests_in(file):
			if not words.is_empty() and not words[0] in name_of_test:
				continue
			if await _passes(file, name_of_test):
				passed += 1
			else:
				failed += 1
	print("%d passed, %d failed" % [passed, failed])
	quit(1 if failed > 0 or passed == 0 else 0)


func _tests_in(file: String) -> PackedStringArray:
	var script: GDScript = load(_FOLDER.path_join(file))
	var found: PackedStringArray = []
	for method: Dictionary in script.get_script_method_list():
		if (method["name"] as String).begins_with("test_"):
			found.append(method["name"])
	return found


func _passes(file: String, name_of_test: String) -> bool:
	var test: MindstageTestCase = (load(_FOLDER.path_join(file)) as GDScript).new()
	test.tree = self
	await test.call(name_of_test)
	if test.checks == 0:
		test.failures.append("the test has no checks, or was aborted by an error")
	for failure: String in test.failures:
		print("%s: %s: %s" % [file, name_of_test, failure])
	return test.failures.is_empty()
