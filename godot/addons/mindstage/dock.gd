@tool
class_name MindstageDock
extends VBoxContainer
## The editor's dock: where the rosbridge is, whether it is joined, and what was asked.
##
## A map that somebody spawns goes into the open scene. There it can be edited by hand, undone, saved, and logged back.

const _LINES: int = 200
const _SETTING: String = "mindstage/%s"

var undo: EditorUndoRedoManager
var client: MindstageClient = MindstageClient.new()

var _address: LineEdit = LineEdit.new()
var _name_space: LineEdit = LineEdit.new()
var _token: LineEdit = LineEdit.new()
var _button: Button = Button.new()
var _status: Label = Label.new()
var _log: RichTextLabel = RichTextLabel.new()


func _enter_tree() -> void:
	if get_child_count() == 0:
		_build()
	client.find_stage = find_stage
	client.changed.connect(_on_changed)
	client.noted.connect(_on_noted)
	_button.pressed.connect(_on_pressed)
	_on_changed(client.state)


func _exit_tree() -> void:
	client.leave()
	client.changed.disconnect(_on_changed)
	client.noted.disconnect(_on_noted)
	_button.pressed.disconnect(_on_pressed)


## Joins the rosbridge that the fields tell, or leaves it.
func toggle() -> void:
	if client.state != MindstageClient.State.OFF:
		client.leave()
		return
	for field: String in ["address", "name_space"]:
		EditorInterface.get_editor_settings().set_setting(_SETTING % field, (get("_" + field) as LineEdit).text)
	client.join(_address.text.strip_edges(), _name_space.text.strip_edges(), _token.text)


## Fills the fields.
func fill(address: String, its_name_space: String, token: String = "") -> void:
	_address.text = address
	_name_space.text = its_name_space
	_token.text = token


## The stage of the open scene; made there if there is none. Null if no scene is open.
func find_stage() -> MindstageStage:
	var scene: Node = EditorInterface.get_edited_scene_root()
	if scene == null:
		return null
	if scene is MindstageStage:
		return _followed(scene)
	for child: Node in scene.find_children("*", "Node3D"):
		if child is MindstageStage:
			return _followed(child)
	var stage: MindstageStage = MindstageStage.new()
	stage.name = "Mindstage"
	scene.add_child(stage)
	stage.owner = scene
	return _followed(stage)


func _followed(stage: MindstageStage) -> MindstageStage:
	if not stage.edited.is_connected(_on_edited):
		stage.edited.connect(_on_edited.bind(stage))
	return stage


## Makes an edit that just happened one that can be undone.
func _on_edited(what: String, before: MindstagePast, stage: MindstageStage) -> void:
	MindstageSceneFile.own(stage, EditorInterface.get_edited_scene_root())
	var after: MindstagePast = MindstagePast.of(stage)
	undo.create_action("Mindstage: " + what, UndoRedo.MERGE_DISABLE, stage)
	undo.add_do_method(self, &"bring_back", stage, after)
	undo.add_undo_method(self, &"bring_back", stage, before)
	for node: Node3D in after.nodes():
		if not node in before.nodes():
			undo.add_do_reference(node)
	for node: Node3D in before.nodes():
		if not node in after.nodes():
			undo.add_undo_reference(node)
	undo.commit_action(false)


## Makes a stage as it was once; for undo and redo.
func bring_back(stage: MindstageStage, past: MindstagePast) -> void:
	past.bring_back(stage)
	MindstageSceneFile.own(stage, EditorInterface.get_edited_scene_root())


func _build() -> void:
	var settings: EditorSettings = EditorInterface.get_editor_settings()
	var told: Callable = func(field: String, otherwise: String) -> String:
		var path: String = _SETTING % field
		return str(settings.get_setting(path)) if settings.has_setting(path) else otherwise
	fill(told.call("address", "ws://127.0.0.1:9090"), told.call("name_space", "godot"))
	_token.secret = true
	_token.placeholder_text = "only where one is needed"
	_add_field("Address", _address)
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


func _on_changed(state: MindstageClient.State) -> void:
	_button.text = "Connect" if state == MindstageClient.State.OFF else "Disconnect"
	match state:
		MindstageClient.State.OFF:
			_status.text = "not connected"
		MindstageClient.State.JOINING:
			_status.text = "connecting to %s" % _address.text
		MindstageClient.State.JOINED:
			_status.text = "connected; services below /%s" % _name_space.text
		MindstageClient.State.LOST:
			_status.text = "nobody answers at %s; trying again" % _address.text


func _on_noted(line: String) -> void:
	_log.add_text(line + "\n")
	while _log.get_paragraph_count() > _LINES:
		_log.remove_paragraph(0)
