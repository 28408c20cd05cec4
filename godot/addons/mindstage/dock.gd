@tool
class_name MindstageDock
extends VBoxContainer
## Editor dock: connects to a rosbridge, and shows the connection state and a log of service calls.
##
## Maps are spawned into the open scene, where they can be edited, undone, saved and read back.

const _MAX_LINES: int = 200
const _SETTING: String = "mindstage/%s"

var undo: EditorUndoRedoManager
var client: MindstageRosbridgeClient = MindstageRosbridgeClient.new()

var _address: LineEdit = LineEdit.new()
var _name_space: LineEdit = LineEdit.new()
var _token: LineEdit = LineEdit.new()
var _button: Button = Button.new()
var _status: Label = Label.new()
var _log: RichTextLabel = RichTextLabel.new()


func _enter_tree() -> void:
	if get_child_count() == 0:
		_build()
	client.find_simulation = find_simulation
	client.state_changed.connect(_on_state_changed)
	client.logged.connect(_on_logged)
	_button.pressed.connect(_on_pressed)
	_on_state_changed(client.state)


func _exit_tree() -> void:
	client.disconnect_from_server()
	client.state_changed.disconnect(_on_state_changed)
	client.logged.disconnect(_on_logged)
	_button.pressed.disconnect(_on_pressed)


## Connects to the rosbridge given by the fields, or disconnects.
func toggle() -> void:
	if client.state != MindstageRosbridgeClient.State.DISCONNECTED:
		client.disconnect_from_server()
		return
	for field: String in ["address", "name_space"]:
		EditorInterface.get_editor_settings().set_setting(_SETTING % field, (get("_" + field) as LineEdit).text)
	client.connect_to(_address.text.strip_edges(), _name_space.text.strip_edges(), _token.text)


## Sets the input fields.
func set_fields(address: String, name_space_text: String, token: String = "") -> void:
	_address.text = address
	_name_space.text = name_space_text
	_token.text = token


## Returns the simulation node of the open scene, which is added if missing; null if no scene is open.
func find_simulation() -> MindstageSimulation:
	var scene: Node = EditorInterface.get_edited_scene_root()
	if scene == null:
		return null
	if scene is MindstageSimulation:
		return _watched(scene)
	for child: Node in scene.find_children("*", "Node3D"):
		if child is MindstageSimulation:
			return _watched(child)
	var simulation: MindstageSimulation = MindstageSimulation.new()
	simulation.name = "Mindstage"
	scene.add_child(simulation)
	simulation.owner = scene
	return _watched(simulation)


func _watched(simulation: MindstageSimulation) -> MindstageSimulation:
	if not simulation.edited.is_connected(_on_edited):
		simulation.edited.connect(_on_edited.bind(simulation))
	return simulation


## Registers an edit that was made with the editor's undo history.
func _on_edited(what: String, before: MindstageUndoSnapshot, simulation: MindstageSimulation) -> void:
	MindstageSceneFile.set_owners(simulation, EditorInterface.get_edited_scene_root())
	var after: MindstageUndoSnapshot = MindstageUndoSnapshot.capture(simulation)
	undo.create_action("Mindstage: " + what, UndoRedo.MERGE_DISABLE, simulation)
	undo.add_do_method(self, &"restore", simulation, after)
	undo.add_undo_method(self, &"restore", simulation, before)
	for node: Node3D in after.nodes():
		if not node in before.nodes():
			undo.add_do_reference(node)
	for node: Node3D in before.nodes():
		if not node in after.nodes():
			undo.add_undo_reference(node)
	undo.commit_action(false)


## Restores a snapshot; called by undo and redo.
func restore(simulation: MindstageSimulation, snapshot: MindstageUndoSnapshot) -> void:
	snapshot.restore(simulation)
	MindstageSceneFile.set_owners(simulation, EditorInterface.get_edited_scene_root())


func _build() -> void:
	var settings: EditorSettings = EditorInterface.get_editor_settings()
	var setting: Callable = func(field: String, otherwise: String) -> String:
		var path: String = _SETTING % field
		return str(settings.get_setting(path)) if settings.has_setting(path) else otherwise
	set_fields(setting.call("address", "ws://127.0.0.1:9090"), setting.call("name_space", "godot"))
	_token.secret = true
	_token.placeholder_text = "if the server requires one"
	_add_field("Server URL", _address)
	_add_field("Namespace", _name_space)
	_add_field("Token", _token)
	add_child(_button)
	_status.autowrap_mode = TextServer.AUTOWRAP_WORD_SMART
	add_child(_status)
	_log.size_flags_vertical = Control.SIZE_EXPAND_FILL
	_log.scroll_following = true
	_log.custom_minimum_size.y = 120.0
	add_child(_log)
	add_child(client)


func _add_field(caption: String, field: LineEdit) -> void:
	var label: Label = Label.new()
	label.text = caption
	add_child(label)
	add_child(field)


func _on_pressed() -> void:
	toggle()


func _on_state_changed(state: MindstageRosbridgeClient.State) -> void:
	_button.text = "Connect" if state == MindstageRosbridgeClient.State.DISCONNECTED else "Disconnect"
	match state:
		MindstageRosbridgeClient.State.DISCONNECTED:
			_status.text = "not connected"
		MindstageRosbridgeClient.State.CONNECTING:
			_status.text = "connecting to %s" % _address.text
		MindstageRosbridgeClient.State.CONNECTED:
			_status.text = "connected; services below /%s" % _name_space.text
		MindstageRosbridgeClient.State.LOST:
			_status.text = "no connection to %s; reconnecting" % _address.text


func _on_logged(line: String) -> void:
	_log.add_text(line + "\n")
	while _log.get_paragraph_count() > _MAX_LINES:
		_log.remove_paragraph(0)
