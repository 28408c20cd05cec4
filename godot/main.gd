extends Node3D
## Main scene: one simulation and a rosbridge client that offers its services. Started by `GodotEngine`.
##
## Options after `--`: `--mindstage-url=ws://HOST:PORT`; `--mindstage-namespace=NAME`; `--mindstage-quit-when-lost` ends
## the process when the connection is lost; `--mindstage-verbose` prints each service call with its duration. The
## access token is read from the environment variable MINDSTAGE_TOKEN.

const _WAIT_S: float = 60.0
const _BAD_ARGUMENTS: int = 2

var _client: MindstageRosbridgeClient = MindstageRosbridgeClient.new()
var _quit_when_lost: bool = false
var _was_connected: bool = false
var _waited_s: float = 0.0

@onready var _simulation: MindstageSimulation = $Simulation


func _ready() -> void:
	var options: Dictionary[String, String] = {
		"--mindstage-url": "",
		"--mindstage-namespace": "godot",
		"--mindstage-quit-when-lost": "",
		"--mindstage-verbose": "",
	}
	for argument: String in OS.get_cmdline_user_args():
		var name_of_option: String = argument.get_slice("=", 0)
		if not options.has(name_of_option):
			_fail("there is no option %s; available: %s" % [name_of_option, ", ".join(options.keys())])
			return
		options[name_of_option] = argument.substr(name_of_option.length() + 1)
		_quit_when_lost = _quit_when_lost or name_of_option == "--mindstage-quit-when-lost"
		if name_of_option == "--mindstage-verbose":
			_client.logged.connect(func(line: String) -> void: print(line))
	var url: String = options["--mindstage-url"]
	if url.is_empty():
		return
	if not url.begins_with("ws://") and not url.begins_with("wss://"):
		_fail("'%s' is not the URL of a rosbridge; use --mindstage-url=ws://HOST:PORT" % url)
		return
	_simulation.clock.play(0.0)  # the clients of the rosbridge start the simulation
	add_child(_client)
	_client.find_simulation = func() -> MindstageSimulation: return _simulation
	_client.state_changed.connect(_on_state_changed)
	_client.connect_to(url, options["--mindstage-namespace"], OS.get_environment("MINDSTAGE_TOKEN"))


func _exit_tree() -> void:
	if not _client.is_inside_tree():
		_client.free()


func _process(_delta: float) -> void:
	if _quit_when_lost and not _was_connected:
		_waited_s = Time.get_ticks_msec() / 1000.0
		if _waited_s > _WAIT_S:
			get_tree().quit(0)


func _on_state_changed(state: MindstageRosbridgeClient.State) -> void:
	if state == MindstageRosbridgeClient.State.CONNECTED:
		_was_connected = true
		print("mindstage: ready")
	elif state == MindstageRosbridgeClient.State.LOST and _was_connected and _quit_when_lost:
		get_tree().quit(0)


func _fail(message: String) -> void:
	printerr("mindstage: %s" % message)
	get_tree().quit(_BAD_ARGUMENTS)
