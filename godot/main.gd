extends Node3D
## Runs a stage that serves a rosbridge: what Mindstage starts when it is told to use Godot.
##
## After `--`: `--mindstage-url=ws://HOST:PORT`, `--mindstage-namespace=NAME`, and `--mindstage-quit-when-lost`, with
## which it ends as soon as nobody is there any more; `--mindstage-talk` prints each call and how long it took. A token
## is read from MINDSTAGE_TOKEN.

const _WAIT_S: float = 60.0
const _BAD_ARGUMENTS: int = 2

var _client: MindstageClient = MindstageClient.new()
var _quits: bool = false
var _met: bool = false
var _waited_s: float = 0.0

@onready var _stage: MindstageStage = $Stage


func _ready() -> void:
	var options: Dictionary[String, String] = {
		"--mindstage-url": "",
		"--mindstage-namespace": "godot",
		"--mindstage-quit-when-lost": "",
		"--mindstage-talk": "",
	}
	for argument: String in OS.get_cmdline_user_args():
		var name_of_option: String = argument.get_slice("=", 0)
		if not options.has(name_of_option):
			_refuse("there is no option %s; there are %s" % [name_of_option, ", ".join(options.keys())])
			return
		options[name_of_option] = argument.substr(name_of_option.length() + 1)
		_quits = _quits or name_of_option == "--mindstage-quit-when-lost"
		if name_of_option == "--mindstage-talk":
			_client.noted.connect(func(line: String) -> void: print(line))
	var url: String = options["--mindstage-url"]
	if url.is_empty():
		return
	if not url.begins_with("ws://") and not url.begins_with("wss://"):
		_refuse("'%s' is no address of a rosbridge; write --mindstage-url=ws://HOST:PORT" % url)
		return
	_stage.clock.play(0.0)  # whoever joins says when time shall pass
	add_child(_client)
	_client.find_stage = func() -> MindstageStage: return _stage
	_client.changed.connect(_on_changed)
	_client.join(url, options["--mindstage-namespace"], OS.get_environment("MINDSTAGE_TOKEN"))


func _exit_tree() -> void:
	if not _client.is_inside_tree():
		_client.free()


func _process(_delta: float) -> void:
	if _quits and not _met:
		_waited_s = Time.get_ticks_msec() / 1000.0
		if _waited_s > _WAIT_S:
			get_tree().quit(0)


func _on_changed(state: MindstageClient.State) -> void:
	if state == MindstageClient.State.JOINED:
		_met = true
		print("mindstage: ready")
	elif state == MindstageClient.State.LOST and _met and _quits:
		get_tree().quit(0)


func _refuse(why: String) -> void:
	printerr("mindstage: %s" % why)
	get_tree().quit(_BAD_ARGUMENTS)
