@tool
class_name MindstageClient
extends Node
## A participant of a rosbridge: joins it, offers the services of the *mindstage* profile, and answers them.
##
## One call is answered after the other, on the main thread. A connection that broke is tried again until `leave`.

## The state of the connection changed.
signal changed(state: State)
## Something was said to or by it: one line, for people.
signal noted(line: String)

enum State { OFF, JOINING, JOINED, LOST }

const _BUFFER_BYTES: int = 64 << 20
const _QUEUE: int = 4096
const _AGAIN_S: float = 1.0
## So long after a message the next one is waited for without giving the processor away [µs].
const _KEEN_US: int = 2000
## So long after the last message nobody hurries any more [µs].
const _LIVELY_US: int = 500_000
const _QUICK_NAP_US: int = 200
const _SLOW_NAP_US: int = 5000
const _TELL_S: float = 0.1

var state: State = State.OFF
var name_space: String = "godot"
## Gives the stage that is to be served; it is asked when a call comes.
var find_stage: Callable

var _url: String = ""
var _token: String = ""
var _socket: WebSocketPeer
var _services: MindstageServices
var _offered: Dictionary[String, String] = {}
var _busy: bool = false
var _heard_us: int = 0
var _next_try_us: int = 0
var _told_us: int = 0


func _exit_tree() -> void:
	leave()


## Joins a rosbridge at an address such as `ws://127.0.0.1:9090`, and goes on trying.
func join(url: String, its_namespace: String, token: String = "") -> void:
	leave()
	_url = url
	_token = token
	name_space = its_namespace
	_try_to_join()


## Leaves it.
func leave() -> void:
	if _socket != null:
		_socket.close()
		_socket = null
	if _services != null:
		_services.close()
		_services = null
	_url = ""
	_set_state(State.OFF)


func _process(_delta: float) -> void:
	if _url.is_empty():
		return
	if _socket == null:
		if Time.get_ticks_usec() >= _next_try_us:
			_try_to_join()
		return
	_listen()
	_tell()
	var quiet_us: int = Time.get_ticks_usec() - _heard_us
	if not Engine.is_editor_hint():
		OS.low_processor_usage_mode_sleep_usec = _QUICK_NAP_US if quiet_us < _LIVELY_US else _SLOW_NAP_US


func _listen() -> void:
	var until_us: int = Time.get_ticks_usec()
	while _socket != null:
		_socket.poll()
		_follow_state()
		if _socket == null or _busy:
			return
		if _socket.get_available_packet_count() > 0:
			_hear(_socket.get_packet().get_string_from_utf8())
			_heard_us = Time.get_ticks_usec()
			until_us = _heard_us + _KEEN_US
		elif Time.get_ticks_usec() >= until_us:
			return


func _try_to_join() -> void:
	_socket = WebSocketPeer.new()
	_socket.inbound_buffer_size = _BUFFER_BYTES
	_socket.outbound_buffer_size = _BUFFER_BYTES
	_socket.max_queued_packets = _QUEUE
	var error: Error = _socket.connect_to_url(_url + ("/?token=" + _token.uri_encode() if _token else ""))
	if error != OK:
		_socket = null
		push_error("Mindstage: '%s' is no address of a rosbridge; write ws://HOST:PORT" % _url)
		_lose("it is no address: write ws://HOST:PORT")
		return
	_set_state(State.JOINING)


func _follow_state() -> void:
	match _socket.get_ready_state():
		WebSocketPeer.STATE_OPEN when state != State.JOINED:
			_offer()
		WebSocketPeer.STATE_CLOSED:
			var reason: String = _socket.get_close_reason()
			_socket = null
			_lose(reason if reason else "nobody is there, or the connection was lost")


func _lose(why: String) -> void:
	_next_try_us = Time.get_ticks_usec() + int(_AGAIN_S * 1e6)
	if state != State.LOST:
		noted.emit(why)
	_set_state(State.LOST)


func _set_state(now: State) -> void:
	if now != state:
		state = now
		changed.emit(now)


## Offers everything.
func _offer() -> void:
	_offered.clear()
	for service: String in MindstageMessages.SERVICES:
		var place: String = MindstageMessages.place(service, name_space)
		_offered[place] = service
		_send({"op": "advertise_service", "service": place, "type": MindstageMessages.SERVICES[service]["type"]})
	_send({"op": "advertise", "topic": _topic("overlaps"), "type": "std_msgs/String"})
	_send({"op": "advertise", "topic": _topic("tf"), "type": "tf2_msgs/TFMessage"})
	noted.emit("joined %s as /%s" % [_url, name_space])
	_set_state(State.JOINED)


func _hear(text: String) -> void:
	var message: Variant = MindstageJsonText.read(text)
	if not message is Dictionary:
		push_error("Mindstage: what came is no JSON object: %s" % text.left(80))
		return
	match message.get("op"):
		"call_service":
			_answer(message)
		"status" when message.get("level") in ["error", "warning"]:
			noted.emit("the rosbridge says: %s" % message.get("msg", ""))


func _answer(call: Dictionary) -> void:
	var place: String = str(call.get("service", ""))
	if not _offered.has(place):
		_reply(call, "there is no service %s here" % place, false)
		return
	var services: MindstageServices = _services_of_now()
	if services == null:
		_reply(call, "no scene is open here to put anything into", false)
		return
	_busy = true
	var start_us: int = Time.get_ticks_usec()
	var answer: MindstageServices.Answer = await services.answer(_offered[place], call.get("args", {}))
	_busy = false
	if answer.broke:
		_reply(call, answer.broke, false)
	else:
		_reply(call, answer.values, true)
	var how: String = answer.broke.get_slice("\n", 0) if answer.broke else "answered"
	noted.emit("%s: %s in %.1f ms" % [place, how, (Time.get_ticks_usec() - start_us) / 1000.0])


func _services_of_now() -> MindstageServices:
	var stage: MindstageStage = find_stage.call()
	if stage == null:
		return null
	if _services == null or _services.stage != stage:
		if _services != null:
			_services.close()
		_services = MindstageServices.new(stage)
		if not stage.overlapped.is_connected(_on_overlapped):
			stage.overlapped.connect(_on_overlapped)
	return _services


func _reply(call: Dictionary, values: Variant, result: bool) -> void:
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
		push_error("Mindstage: a message could not be sent: %s" % error_string(error))


# -- what is told unasked --------------------------------------------------------------------------------------------


func _on_overlapped(event: Dictionary) -> void:
	_send({"op": "publish", "topic": _topic("overlaps"), "msg": {"data": JSON.stringify(event)}})


## Tells where everything is, while time passes by itself.
func _tell() -> void:
	if _services == null or not is_instance_valid(_services.stage) or state != State.JOINED:
		return
	var stage: MindstageStage = _services.stage
	var now_us: int = Time.get_ticks_usec()
	if _busy or stage.clock.speed == 0.0 or now_us - _told_us < _TELL_S * 1e6:
		return
	_told_us = now_us
	_send({"op": "publish", "topic": _topic("tf"), "msg": {"transforms": MindstagePublisher.transforms(stage)}})


func _topic(name_of_topic: String) -> String:
	return "/" + "/".join(name_space.split("/", false) + PackedStringArray([name_of_topic]))
