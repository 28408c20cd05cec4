@tool
class_name MindstageServices
extends RefCounted
## Handlers of the services of the *mindstage* profile for one simulation.
##
## A service `name` is handled by the method `_name`.

const ENGINE: String = "godot"

var simulation: MindstageSimulation
var markers: MindstageMarkers
## Identifies this instance: clients see from another session id that the earlier world no longer exists.
var session: String = Crypto.new().generate_random_bytes(8).hex_encode()


## The response to a service call.
class Response:
	var values: Dictionary = {}
	## Why the call failed (`result` is false), or empty. Errors about the world are reported in `refusal` instead.
	var error: String = ""


func _init(owner_simulation: MindstageSimulation) -> void:
	simulation = owner_simulation
	markers = MindstageMarkers.new()
	simulation.add_child(markers, false, Node.INTERNAL_MODE_BACK)


## Removes the markers from the simulation.
func close() -> void:
	if is_instance_valid(markers):
		markers.queue_free()


## Handles a call; a coroutine, since stepping and rendering take several frames.
func respond(service: String, values: Variant) -> Response:
	var reading: MindstageMessages.ReadResult = MindstageMessages.request(service, values)
	if reading.error:
		push_error("Mindstage: invalid request for %s: %s" % [service, reading.error])
		return _failed("%s: %s" % [MindstageMessages.SERVICES[service]["type"], reading.error])
	var response: Response = await call("_" + service, reading.value)
	if not response.error:
		response.values = MindstageMessages.response(service, response.values)
	return response


# -- the world -------------------------------------------------------------------------------------------------------


func _describe(_request: Dictionary) -> Response:
	return _respond_with(
		{
			"engine": ENGINE,
			"abilities":
			(
				["actuators", "joints", "scenes", "pictures"]
				if MindstageScreenshot.is_available()
				else ["actuators", "joints", "scenes"]
			),
			"time_s": simulation.clock.time_s(),
			"format_version": MindstageWorldModel.FORMAT_VERSION,
			"session": session,
			"takes": ["geometries", "plan"],
		}
	)


func _spawn_world(request: Dictionary) -> Response:
	var result: MindstageWorldModel.SpawnResult = MindstageWorldModel.SpawnResult.new()
	var reason: String = simulation.spawn(request["world"], request["geometries"], request["plan"], result)
	if reason:
		return _failed(reason)
	var failed: bool = not (
		result.failed_bodies.is_empty() and result.failed_joints.is_empty() and result.failed_attachments.is_empty()
	)
	return _respond_with({"success": not failed, "report": result.report()})


func _log_world(_request: Dictionary) -> Response:
	return _respond_with({"success": true, "world": simulation.world_text()})


func _delete(request: Dictionary) -> Response:
	return _result(simulation.delete(request["ids"], request["plan"]))


func _clear(_request: Dictionary) -> Response:
	simulation.clear()
	return _result({})


func _attach(request: Dictionary) -> Response:
	return _result(simulation.attach(request["parent"], request["child"], request["plan"]))


func _detach(request: Dictionary) -> Response:
	return _result(simulation.detach(request["child"], request["plan"]))


# -- one body --------------------------------------------------------------------------------------------------------


func _set_pose(request: Dictionary) -> Response:
	var orientation: Dictionary = request["pose"]["orientation"]
	var at: Dictionary = request["pose"]["position"]
	var pose: Dictionary = {
		"position": [at["x"], at["y"], at["z"]],
		"quaternion": [orientation["w"], orientation["x"], orientation["y"], orientation["z"]]
	}
	return _result(simulation.set_pose(request["id"], pose, request["plan"]))


func _set_physics(request: Dictionary) -> Response:
	if not MindstageJsonText.read(request["physics"]) is Dictionary:
		return _failed("mindstage_msgs/SetPhysics: physics: it is not a JSON object")
	return _result(simulation.set_physics(request["id"], request["physics"], request["plan"]))


func _set_materials(request: Dictionary) -> Response:
	if not MindstageJsonText.read(request["materials"]) is Array:
		return _failed("mindstage_msgs/SetMaterials: materials: it is not a JSON array")
	return _result(simulation.set_materials(request["id"], request["materials"]))


func _set_label(request: Dictionary) -> Response:
	return _result(simulation.set_label(request["id"], request["label"]))


func _highlight(request: Dictionary) -> Response:
	var rgba: Dictionary = request["color"]
	var color: Color = Color(rgba["r"], rgba["g"], rgba["b"], 1.0) if request["highlighted"] else Color(0, 0, 0, 0)
	return _result(simulation.highlight(request["ids"], color))


func _get_highlights(_request: Dictionary) -> Response:
	var colors: Array = []
	for id: String in simulation.world_model.highlights:
		var color: Color = simulation.world_model.highlights[id]
		colors.append({"r": color.r, "g": color.g, "b": color.b, "a": 1.0})
	return _respond_with({"success": true, "ids": simulation.world_model.highlights.keys(), "colors": colors})


func _push(request: Dictionary) -> Response:
	return _result(_apply_force(request))


# -- time and poses --------------------------------------------------------------------------------------------------


func _step(request: Dictionary) -> Response:
	var duration_s: float = request["duration_s"]
	if duration_s < 0.0:
		return _failed("mindstage_msgs/Step: duration_s: it must not be negative (%s s)" % duration_s)
	if Engine.is_editor_hint():
		return _unsupported("simulate in the editor", "run the scene instead")
	for force: Dictionary in request["forces"]:
		var refusal: Dictionary = _apply_force(force)
		if refusal:
			return _result(refusal)
	var lost: String = await simulation.step(duration_s)
	if lost:
		return _unstable("the pose of '%s' is not a number or far too large" % lost)
	var values: Dictionary = {"success": true, "time_s": simulation.clock.time_s()}
	if request["packed"]:
		values["revision"] = simulation.world_model.revision
		values["rows"] = _packed(simulation.recorded_rows())
	return _respond_with(values)


func _set_speed(request: Dictionary) -> Response:
	if request["speed"] < 0.0:
		return _failed("mindstage_msgs/SetSpeed: speed: it must not be negative (%s)" % request["speed"])
	return _respond_with({"success": true, "before": simulation.clock.play(request["speed"])})


func _get_poses(request: Dictionary) -> Response:
	var rows: PackedFloat64Array = simulation.rows()
	var revision: int = simulation.world_model.revision
	var values: Dictionary = {"success": true, "time_s": simulation.clock.time_s(), "revision": revision}
	if request["known"] != revision or not request["packed"]:
		values["ids"] = simulation.world_model.bodies.keys()
	if request["packed"]:
		values["rows"] = _packed(rows)
	else:
		values["poses"] = range(simulation.world_model.bodies.size()).map(
			func(row: int) -> Dictionary: return _pose_message(rows, row * MindstageFrames.ROW)
		)
	return _respond_with(values)


func _get_joint_positions(_request: Dictionary) -> Response:
	var response: Array = []
	for id: String in simulation.physics_scene.joints:
		var at: PackedFloat64Array = simulation.physics_scene.joints[id].joint_position()
		response.append(
			{"id": id, "x": at[0], "y": at[1], "z": at[2], "twist": at[3], "swing2": at[4], "swing1": at[5]}
		)
	return _respond_with({"success": true, "joints": response})


# -- actuators -------------------------------------------------------------------------------------------------------


func _set_actuators(request: Dictionary) -> Response:
	var actuators: Variant = MindstageJsonText.read(request["actuators"])
	if not actuators is Array:
		return _failed("mindstage_msgs/SetActuators: actuators: it is not a JSON array")
	var names: Array = actuators.map(func(each: Dictionary) -> String: return each.get("name", ""))
	return _result(simulation.set_actuators(names, request["plan"]))


func _set_commands(request: Dictionary) -> Response:
	return _world_error(simulation.drives.set_commands(request["names"], request["commands"]))


func _get_actuator_states(_request: Dictionary) -> Response:
	return _respond_with({"success": true, "actuators": simulation.drives.states()})


# -- pictures and scenes ---------------------------------------------------------------------------------------------


func _save_scene(request: Dictionary) -> Response:
	return _world_error(MindstageSceneFile.save(simulation, request["path"]))


func _photograph(request: Dictionary) -> Response:
	var eye: Vector3 = MindstageFrames.vector_from_message(request["eye"])
	var target: Vector3 = MindstageFrames.vector_from_message(request["target"])
	var size: Vector2i = Vector2i(request["width"], request["height"])
	return _world_error(
		await MindstageScreenshot.take(simulation, request["path"], size, eye, target, request["fov_deg"])
	)


func _display_basic_marker(request: Dictionary) -> Response:
	return _respond_with({"marker_id": markers.show_marker(request)})


func _display_trajectory(request: Dictionary) -> Response:
	return _respond_with({"marker_id": markers.show_trajectory(request)})


func _remove_marker(request: Dictionary) -> Response:
	return _respond_with({"success": markers.remove(request["marker_id"])})


# -- answers ---------------------------------------------------------------------------------------------------------


func _apply_force(request: Dictionary) -> Dictionary:
	var at: Variant = MindstageFrames.vector_from_message(request["point"]) if request["at_point"] else null
	return simulation.apply_force(request["id"], MindstageFrames.vector_from_message(request["force"]), at)


static func _packed(rows: PackedFloat64Array) -> String:
	return "" if rows.is_empty() else Marshalls.raw_to_base64(rows.to_byte_array())


static func _pose_message(rows: PackedFloat64Array, at: int) -> Dictionary:
	return {
		"position": {"x": rows[at], "y": rows[at + 1], "z": rows[at + 2]},
		"orientation": {"x": rows[at + 4], "y": rows[at + 5], "z": rows[at + 6], "w": rows[at + 3]},
	}


static func _respond_with(values: Dictionary) -> Response:
	var response: Response = Response.new()
	response.values = values
	return response


static func _result(refusal: Dictionary) -> Response:
	return _respond_with({"success": refusal.is_empty(), "refusal": refusal})


## A result that succeeded, or failed with a WorldError if there is a reason.
static func _world_error(reason: String) -> Response:
	return _result({"code": "WorldError", "text": reason} if reason else {})


static func _failed(text: String) -> Response:
	var response: Response = Response.new()
	response.error = text
	return response


## An error message followed by a line of JSON with its fields, see `mindstage.bridge.description.error_text`.
static func _unsupported(what: String, remedy: String) -> Response:
	var facts: Dictionary = {"code": "UnsupportedByEngineError", "engine": ENGINE, "what": what, "remedy": remedy}
	return _failed("the engine '%s' cannot %s; %s\n%s" % [ENGINE, what, remedy, JSON.stringify(facts)])


func _unstable(what: String) -> Response:
	var facts: Dictionary = {"code": "SimulationDivergedError", "time_s": simulation.clock.time_s(), "what": what}
	var text: String = "the simulation became unstable at %.3f s: %s" % [simulation.clock.time_s(), what]
	return _failed("%s\n%s" % [text, JSON.stringify(facts)])
