class_name MindstageTestCase
extends RefCounted
## Tests of one thing: every method whose name begins with `test_` is one, and may wait.

var tree: SceneTree
var failures: PackedStringArray = []
var checks: int = 0


## Notes a failure unless something is true.
func check(is_true: bool, what: String) -> void:
	checks += 1
	if not is_true:
		failures.append(what)


## Notes a failure unless two values are the same.
func same(found: Variant, wanted: Variant, what: String = "") -> void:
	check(typeof(found) == typeof(wanted) and found == wanted, "%s: %s is not %s" % [what, found, wanted])


## Notes a failure unless two numbers are as good as the same.
func near(found: float, wanted: float, within: float, what: String = "") -> void:
	check(absf(found - wanted) <= within, "%s: %s is not %s within %s" % [what, found, wanted, within])


## A stage in the tree, in which time passes by steps only.
func new_stage() -> MindstageStage:
	var stage: MindstageStage = MindstageStage.new()
	stage.clock.speed = 0.0
	tree.root.add_child(stage)
	return stage


## Takes it away again.
func drop(node: Node) -> void:
	node.queue_free()
	await tree.process_frame
