class_name MindstageTestCase
extends RefCounted
## Base class of test cases: each method whose name begins with `test_` is a test and may be a coroutine.

var tree: SceneTree
var failures: PackedStringArray = []
var checks: int = 0


## Records a failure unless the condition is true.
func check(is_true: bool, what: String) -> void:
	checks += 1
	if not is_true:
		failures.append(what)


## Records a failure unless two values have the same type and value.
func same(found: Variant, expected: Variant, what: String = "") -> void:
	check(typeof(found) == typeof(expected) and found == expected, "%s: %s is not %s" % [what, found, expected])


## Records a failure unless two numbers are equal within a tolerance.
func near(found: float, expected: float, within: float, what: String = "") -> void:
	check(absf(found - expected) <= within, "%s: %s is not %s within %s" % [what, found, expected, within])


## A paused simulation in the tree.
func new_simulation() -> MindstageSimulation:
	var simulation: MindstageSimulation = MindstageSimulation.new()
	simulation.clock.speed = 0.0
	tree.root.add_child(simulation)
	return simulation


## Frees a node and waits until it is gone.
func drop(node: Node) -> void:
	node.queue_free()
	await tree.process_frame
