@tool
extends EditorPlugin
## Editor plugin: adds the Mindstage dock.

var _dock: MindstageDock


func _enter_tree() -> void:
	_dock = MindstageDock.new()
	_dock.name = "Mindstage"
	_dock.undo = get_undo_redo()
	add_control_to_dock(DOCK_SLOT_RIGHT_BL, _dock)


func _exit_tree() -> void:
	remove_control_from_docks(_dock)
	_dock.queue_free()
