@tool
extends EditorPlugin
## Performs user actions in the editor: a test writes a command to `res://command.txt` and reads `res://done.txt`.

const _COMMAND: String = "res://command.txt"
const _DONE: String = "res://done.txt"

var _busy: bool = false
var _saved: bool = false


func _enter_tree() -> void:
	scene_saved.connect(_on_scene_saved)


func _exit_tree() -> void:
	scene_saved.disconnect(_on_scene_saved)


func _process(_delta: float) -> void:
	if _busy or not FileAccess.file_exists(_COMMAND):
		return
	_busy = true
	var words: PackedStringArray = FileAccess.get_file_as_string(_COMMAND).strip_edges().split(" ")
	DirAccess.remove_absolute(ProjectSettings.globalize_path(_COMMAND))
	var said: String = str(await call("_" + words[0], words.slice(1)))
	var file: FileAccess = FileAccess.open(_DONE + ".part", FileAccess.WRITE)
	file.store_string(said)
	file.close()
	DirAccess.rename_absolute(ProjectSettings.globalize_path(_DONE + ".part"), ProjectSettings.globalize_path(_DONE))
	_busy = false


func _open(words: PackedStringArray) -> String:
	EditorInterface.open_scene_from_path(words[0])
	await get_tree().process_frame
	return EditorInterface.get_edited_scene_root().name


func _connect_dock(words: PackedStringArray) -> String:
	var dock: MindstageDock = _dock()
	dock.set_fields(words[0], words[1])
	dock.toggle()
	return "toggled"


func _status(_words: PackedStringArray) -> String:
	return MindstageRosbridgeClient.State.keys()[_dock().client.state]


func _move(words: PackedStringArray) -> String:
	var node: Node3D = _find(words[0])
	var undo: EditorUndoRedoManager = get_undo_redo()
	undo.create_action("Move by hand", UndoRedo.MERGE_DISABLE, node)
	undo.add_do_property(node, &"position", node.position + Vector3(0, 1, 0))
	undo.add_undo_property(node, &"position", node.position)
	undo.commit_action()
	return str(node.position)


func _undo(_words: PackedStringArray) -> String:
	return str(_history().undo())


func _redo(_words: PackedStringArray) -> String:
	return str(_history().redo())


func _save(_words: PackedStringArray) -> String:
	_saved = false
	var error: Error = EditorInterface.save_scene()
	while error == OK and not _saved:
		await get_tree().process_frame
	return error_string(error)


func _on_scene_saved(_path: String) -> void:
	_saved = true


func _reload(words: PackedStringArray) -> String:
	EditorInterface.reload_scene_from_path(words[0])
	await get_tree().process_frame
	return EditorInterface.get_edited_scene_root().name


func _nodes(_words: PackedStringArray) -> String:
	var found: PackedStringArray = []
	for node: Node in EditorInterface.get_edited_scene_root().find_children("*", "CollisionObject3D", true, true):
		if node.has_meta(MindstageTags.META):
			found.append(MindstageTags.id_of(node))
	found.sort()
	return " ".join(found)


func _find(id: String) -> Node3D:
	for node: Node in EditorInterface.get_edited_scene_root().find_children("*", "Node3D", true, false):
		if node.has_meta(MindstageTags.META) and MindstageTags.id_of(node) == id:
			return node
	return null


func _dock() -> MindstageDock:
	var found: Array[Node] = EditorInterface.get_base_control().find_children("*", "MindstageDock", true, false)
	return found[0] if found else null


func _history() -> UndoRedo:
	var manager: EditorUndoRedoManager = get_undo_redo()
	var scene: Node = EditorInterface.get_edited_scene_root()
	return manager.get_history_undo_redo(manager.get_object_history_id(scene))
