@tool
class_name MindstageRosbridgeClient
extends Node
## Client of a rosbridge server: advertises the services of the *mindstage* profile and responds to their calls.
##
## Calls are handled one after the other on the main thread. A lost connection is retried until
## `disconnect_from_server`.

## The connection state changed.
signal state_changed(state: State)
## A line for the log: a handled call, or an error.
signal logged(line: String)

enum State { DISCONNECTED, CONNECTING, CONNECTED, LOST }

const _BUFFER_BYTES: int = 64 << 20
const _QUEUE: int = 4096
const _RECONNECT_S: float = 1.0
## Time to poll without sleeping after a message [µs].
const _BUSY_WAIT_US: int = 2000
## Time after the last message until the process sleeps longer between frames [µs].
const _ACTIVE_US: int = 500_000
const _ACTIVE_SLEEP_US: int = 200
const _IDLE_SLEEP_US: int = 5000
const _TF_PERIOD_S: float = 0.1
const _WORLD_FRAME: String = "map"

var state: State = State.DISCONNECTED
var name_space: String = "godot"
## Returns the simulation to serve; called for each service call.
var find_simulation: Callable

var _url: String = ""
var _token: String = ""
var _socket: WebSocketPeer
var _services: MindstageServices
var _advertised: Dictionary[String, String] = {}
var _busy: bool = false
var _received_us: int = 0
var _next_try_us: int = 0
var _published_us: int = 0


func _exit_tree() -> void:
	disconnect_from_server()


## Connects to a rosbridge such as `ws://127.0.0.1:9090`, and reconnects when the connection is lost.
func connect_to(url: String, new_name_space: String, token: String = "") -> void:
	disconnect_from_server()
	_url = url
	_token = token
	name_space = new_name_space
	_try_to_connect()


## Closes the connection and stops reconnecting.
func disconnect_from_server() -> void:
	if _socket != null:
		_socket.close()
		_socket = null
	if _services != null:
		_services.close()
		_services = null
	_url = ""
	_set_state(State.DISCONNECTED)


func _process(_delta: float) -> void:
	if _url.is_empty():
		return
	if _socket == null:
		if Time.get_ticks_usec() >= _next_try_us:
			_try_to_connect()
		return
	_poll()
	_publish_transforms()
	var idle_us: int = Time.get_ticks_usec() - _received_us
	if not Engine.is_editor_hint():
		OS.low_processor_usage_mode_sleep_usec = _ACTIVE_SLEEP_US if idle_us < _ACTIVE_US else _IDLE_SLEEP_US


func _poll() -> void:
	var deadline_us: int = Time.get_ticks_usec()
	while _socket != null:
		_socket.poll()
		_update_state()
		if _socket == null or _busy:
			return
		if _socket.get_available_packet_count() > 0:
			_receive(_socket.get_packet().get_string_from_utf8())
			_received_us = Time.get_ticks_usec()
			deadline_us = _received_us + _BUSY_WAIT_US
		elif Time.get_ticks_usec() >= deadline_us:
			return


func _try_to_connect() -> void:
	_socket = WebSocketPeer.new()
	_socket.inbound_buffer_size = _BUFFER_BYTES
	_socket.outbound_buffer_size = _BUFFER_BYTES
	_socket.max_queued_packets = _QUEUE
	var error: Error = _socket.connect_to_url(_url + ("/?token=" + _token.uri_encode() if _token else ""))
	if error != OK:
		_socket = null
		push_error("Mindstage: '%s' is not the URL of a rosbridge; use ws://HOST:PORT" % _url)
		_connection_lost("invalid URL; use ws://HOST:PORT")
		return
	_set_state(State.CONNECTING)


func _update_state() -> void:
	match _socket.get_ready_state():
		WebSocketPeer.STATE_OPEN when state != State.CONNECTED:
			_advertise()
		WebSocketPeer.STATE_CLOSED:
			var reason: String = _socket.get_close_reason()
			_socket = null
			_connection_lost(reason if reason else "no server, or the connection was lost")


func _connection_lost(why: String) -> void:
	_next_try_us = Time.get_ticks_usec() + int(_RECONNECT_S * 1e6)
	if state != State.LOST:
		logged.emit(why)
	_set_state(State.LOST)


func _set_state(new_state: State) -> void:
	if new_state != state:
		state = new_state
		state_changed.emit(new_state)


## Advertises all services and topics.
func _advertise() -> void:
	_advertised.clear()
	for service: String in MindstageMessages.SERVICES:
		var path: String = MindstageMessages.service_path(service, name_space)
		_advertised[path] = service
		_send({"op": "advertise_service", "service": path, "type": MindstageMessages.SERVICES[service]["type"]})
	_send({"op": "advertise", "topic": _topic("overlaps"), "type": "std_msgs/String"})
	_send({"op": "advertise", "topic": _topic("tf"), "type": "tf2_msgs/TFMessage"})
	logged.emit("connected to %s as /%s" % [_url, name_space])
	_set_state(State.CONNECTED)


func _receive(text: String) -> void:
	var message: Variant = MindstageJsonText.read(text)
	if not message is Dictionary:
		push_error("Mindstage: the message is not a JSON object: %s" % text.left(80))
		return
	match message.get("op"):
		"call_service":
			_handle_call(message)
		"status" when message.get("level") in ["error", "warning"]:
			logged.emit("status of the rosbridge: %s" % message.get("msg", ""))


func _handle_call(call: Dictionary) -> void:
	var path: String = str(call.get("service", ""))
	if not _advertised.has(path):
		_send_response(call, "there is no service %s" % path, false)
		return
	var services: MindstageServices = _current_services()
	if services == null:
		_send_response(call, "no scene is open in the editor", false)
		return
	_busy = true
	var start_us: int = Time.get_ticks_usec()
	var response: MindstageServices.Response = await services.respond(_advertised[path], call.get("args", {}))
	_busy = false
	if response.error:
		_send_response(call, response.error, false)
	else:
		_send_response(call, response.values, true)
	var outcome: String = response.error.get_slice("\n", 0) if response.error else "answered"
	logged.emit("%s: %s in %.1f ms" % [path, outcome, (Time.get_ticks_usec() - start_us) / 1000.0])


func _current_services() -> MindstageServices:
	var simulation: MindstageSimulation = find_simulation.call()
	if simulation == null:
		return null
	if _services == null or _services.simulation != simulation:
		if _services != null:
			_services.close()
		_services = MindstageServices.new(simulation)
		if not simulation.overlapped.is_connected(_on_overlapped):
			simulation.overlapped.connect(_on_overlapped)
	return _services


func _send_response(call: Dictionary, values: Variant, result: bool) -> void:
	var reply: Dictionary = {
		"op": "service_response", "service": call.get("service", ""), "values": values, "result": result
	}
	if call.has("id"):
		reply["id"] = call["id"]
	_send(reply)


func _send(message: Dictionary) -> void:
	if _socket == null or _socket.get_ready_state() != WebSocketPeer.STATE_OPEN:
		return
	var error: Error = _socket.send_text(MindstageJsonText.write(message))
	if error != OK:
		push_error("Mindstage: sending a message failed: %s" % error_string(error))


# -- published topics -------------------------------------------------------------------------------------------------


func _on_overlapped(event: Dictionary) -> void:
	_send({"op": "publish", "topic": _topic("overlaps"), "msg": {"data": JSON.stringify(event)}})


## Publishes the poses of all bodies while the simulation plays.
func _publish_transforms() -> void:
	if _services == null or not is_instance_valid(_services.simulation) or state != State.CONNECTED:
		return
	var simulation: MindstageSimulation = _services.simulation
	var now_us: int = Time.get_ticks_usec()
	if _busy or simulation.clock.speed == 0.0 or now_us - _published_us < _TF_PERIOD_S * 1e6:
		return
	_published_us = now_us
	_send({"op": "publish", "topic": _topic("tf"), "msg": {"transforms": _transforms(simulation)}})


func _topic(name_of_topic: String) -> String:
	return "/" + "/".join(name_space.split("/", false) + PackedStringArray([name_of_topic]))


## The poses of all bodies as the transforms of a tf2_msgs/TFMessage.
static func _transforms(simulation: MindstageSimulation) -> Array:
	var rows: PackedFloat64Array = simulation.rows()
	var time_s: float = simulation.clock.time_s()
	var stamp: Dictionary = {"secs": int(time_s), "nsecs": int(fposmod(time_s, 1.0) * 1e9)}
	var found: Array = []
	for id: String in simulation.world_model.bodies:
		var at: int = simulation.world_model.bodies[id].row * MindstageFrames.ROW
		(
			found
			. append(
				{
					"header": {"seq": 0, "stamp": stamp, "frame_id": _WORLD_FRAME},
					"child_frame_id": id,
					"transform":
					{
						"translation": {"x": rows[at], "y": rows[at + 1], "z": rows[at + 2]},
						"rotation": {"x": rows[at + 4], "y": rows[at + 5], "z": rows[at + 6], "w": rows[at + 3]},
					},
				}
			)
		)
	return found
