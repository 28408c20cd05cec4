@tool
class_name MindstageServices
extends RefCounted
## Answers the services of the *mindstage* profile, for one stage.

const ENGINE: String = "godot"

var stage: MindstageStage
var markers: MindstageMarkers
## Made anew with each: another one means that the world of before is gone.
var session: String = Crypto.new().generate_random_bytes(8).hex_encode()


## What came of a call.
class Answer:
	var values: Dictionary = {}
	## Why the call itself broke, if it did: for what lies outside of the world.
	var broke: String = ""


func _init(its_stage: MindstageStage) -> void:
	stage = its_stage
	markers = MindstageMarkers.new()
	stage.add_child(markers, false, Node.INTERNAL_MODE_BACK)


## Takes away what it put into the stage.
func close() -> void:
	if is_instance_valid(markers):
		markers.queue_free()


## Answers a call; it may take a while.
func answer(service: String, values: Variant) -> Answer:
	var reading: MindstageMessages.Reading = MindstageMessages.request(service, values)
	if reading.cause:
		push_error("Mindstage: %s is refused: %s" % [service, reading.cause])
		return _broken("%s: %s" % [MindstageMessages.SERVICES[service]["type"], reading.cause])
	var found: Answer = await call("_" + service, reading.value)
	if not found.broke:
		found.values = MindstageMessages.response(service, found.values)
	return found


# -- the world -------------------------------------------------------------------------------------------------------


func _describe(_request: Dictionary) -> Answer:
	return _given(
		{
			"engine": ENGINE,
			"abilities": ["joints", "scenes", "pictures"] if MindstagePhotographer.can_see() else ["joints", "scenes"],
			"time_s": stage.clock.time_s(),
			"format_version": MindstageInventory.FORMAT_VERSION,
			"session": session,
			"takes": ["forms", "plan"],
		}
	)


func _spawn_world(request: Dictionary) -> Answer:
	var added: MindstageInventory.Added = MindstageInventory.Added.new()
	var reason: String = stage.spawn(request["world"], request["forms"], request["plan"], added)
	if reason:
		return _broken(reason)
	var failed: bool = not (
		added.failed_bodies.is_empty() and added.failed_constraints.is_empty() and added.failed_attachments.is_empty()
	)
	return _given({"success": not failed, "report": added.report()})


func _log_world(_request: Dictionary) -> Answer:
	return _given({"success": true, "world": stage.world_text()})


func _delete(request: Dictionary) -> Answer:
	return _done(stage.delete(request["ids"], request["plan"]))


func _clear(_request: Dictionary) -> Answer:
	stage.clear()
	return _done({})


func _attach(request: Dictionary) -> Answer:
	return _done(stage.attach(request["parent"], request["child"], request["plan"]))


func _detach(request: Dictionary) -> Answer:
	return _done(stage.detach(request["child"], request["plan"]))


# -- one body --------------------------------------------------------------------------------------------------------


func _set_pose(request: Dictionary) -> Answer:
	var turn: Dictionary = request["pose"]["orientation"]
	var at: Dictionary = request["pose"]["position"]
	var pose: Dictionary = {
		"position": [at["x"], at["y"], at["z"]], "quaternion": [turn["w"], turn["x"], turn["y"], turn["z"]]
	}
	return _done(stage.set_pose(request["id"], pose, request["plan"]))


func _set_physics(request: Dictionary) -> Answer:
	if not MindstageJsonText.read(request["physics"]) is Dictionary:
		return _broken("mindstage_msgs/SetPhysics: physics: it is no JSON object")
	return _done(stage.set_physics(request["id"], request["physics"], request["plan"]))


func _set_materials(request: Dictionary) -> Answer:
	if not MindstageJsonText.read(request["materials"]) is Array:
		return _broken("mindstage_msgs/SetMaterials: materials: it is no JSON array")
	return _done(stage.set_materials(request["id"], request["materials"]))


func _highlight(request: Dictionary) -> Answer:
	var told: Dictionary = request["color"]
	var colour: Color = Color(told["r"], told["g"], told["b"], 1.0) if request["lit"] else Color(0, 0, 0, 0)
	return _done(stage.highlight(request["ids"], colour))


func _get_highlights(_request: Dictionary) -> Answer:
	var colours: Array = []
	for id: String in stage.inventory.lit:
		var colour: Color = stage.inventory.lit[id]
		colours.append({"r": colour.r, "g": colour.g, "b": colour.b, "a": 1.0})
	return _given({"success": true, "ids": stage.inventory.lit.keys(), "colors": colours})


func _push(request: Dictionary) -> Answer:
	return _done(_apply_force(request))


# -- time and poses --------------------------------------------------------------------------------------------------


func _step(request: Dictionary) -> Answer:
	var duration_s: float = request["duration_s"]
	if duration_s < 0.0:
		return _broken("mindstage_msgs/Step: duration_s: time does not pass backwards (%s s)" % duration_s)
	if Engine.is_editor_hint():
		return _unable("let time pass in the editor", "run the scene to see it move")
	for force: Dictionary in request["forces"]:
		var refusal: Dictionary = _apply_force(force)
		if refusal:
			return _done(refusal)
	var lost: String = await stage.step(duration_s)
	if lost:
		return _unstable("the pose of '%s' is not a number or far too large" % lost)
	var values: Dictionary = {"success": true, "time_s": stage.clock.time_s()}
	if request["packed"]:
		values["revision"] = stage.inventory.revision
		values["rows"] = _packed(stage.rows_as_written())
	return _given(values)


func _set_speed(request: Dictionary) -> Answer:
	if request["speed"] < 0.0:
		return _broken("mindstage_msgs/SetSpeed: speed: time does not pass backwards (%s)" % request["speed"])
	return _given({"success": true, "before": stage.clock.play(request["speed"])})


func _get_poses(request: Dictionary) -> Answer:
	var rows: PackedFloat64Array = stage.rows()
	var revision: int = stage.inventory.revision
	var values: Dictionary = {"success": true, "time_s": stage.clock.time_s(), "revision": revision}
	if request["known"] != revision or not request["packed"]:
		values["ids"] = stage.inventory.bodies.keys()
	if request["packed"]:
		values["rows"] = _packed(rows)
	else:
		values["poses"] = range(stage.inventory.bodies.size()).map(
			func(row: int) -> Dictionary: return _pose_message(rows, row * MindstageFrames.ROW)
		)
	return _given(values)


func _get_joint_positions(_request: Dictionary) -> Answer:
	var found: Array = []
	for id: String in stage.assembler.joints:
		var at: PackedFloat64Array = stage.assembler.joints[id].position_of_axes()
		found.append({"id": id, "x": at[0], "y": at[1], "z": at[2], "twist": at[3], "swing2": at[4], "swing1": at[5]})
	return _given({"success": true, "joints": found})


# -- pictures and scenes ---------------------------------------------------------------------------------------------


func _save_scene(request: Dictionary) -> Answer:
	return _said(MindstageSceneFile.save(stage, request["path"]))


func _photograph(request: Dictionary) -> Answer:
	var eye: Vector3 = MindstageFrames.vector_from_message(request["eye"])
	var target: Vector3 = MindstageFrames.vector_from_message(request["target"])
	var size: Vector2i = Vector2i(request["width"], request["height"])
	return _said(await MindstagePhotographer.take(stage, request["path"], size, eye, target, request["fov_deg"]))


func _display_basic_marker(request: Dictionary) -> Answer:
	return _given({"marker_id": markers.show_marker(request)})


func _display_trajectory(request: Dictionary) -> Answer:
	return _given({"marker_id": markers.show_trajectory(request)})


func _remove_marker(request: Dictionary) -> Answer:
	return _given({"success": markers.remove(request["marker_id"])})


# -- answers ---------------------------------------------------------------------------------------------------------


func _apply_force(push: Dictionary) -> Dictionary:
	var at: Variant = MindstageFrames.vector_from_message(push["point"]) if push["at_point"] else null
	return stage.push(push["id"], MindstageFrames.vector_from_message(push["force"]), at)


static func _packed(rows: PackedFloat64Array) -> String:
	return "" if rows.is_empty() else Marshalls.raw_to_base64(rows.to_byte_array())


static func _pose_message(rows: PackedFloat64Array, at: int) -> Dictionary:
	return {
		"position": {"x": rows[at], "y": rows[at + 1], "z": rows[at + 2]},
		"orientation": {"x": rows[at + 4], "y": rows[at + 5], "z": rows[at + 6], "w": rows[at + 3]},
	}


static func _given(values: Dictionary) -> Answer:
	var found: Answer = Answer.new()
	found.values = values
	return found


static func _done(refusal: Dictionary) -> Answer:
	return _given({"success": refusal.is_empty(), "refusal": refusal})


## Done, or not for a reason in words.
static func _said(reason: String) -> Answer:
	return _done({"kind": "WorldError", "text": reason} if reason else {})


static func _broken(text: String) -> Answer:
	var found: Answer = Answer.new()
	found.broke = text
	return found


## A text whose second line holds the facts, as `mindstage.bridge.description.error_text` writes it.
static func _unable(what: String, remedy: String) -> Answer:
	var facts: Dictionary = {"kind": "EngineUnable", "engine": ENGINE, "what": what, "remedy": remedy}
	return _broken("the engine '%s' cannot %s; %s\n%s" % [ENGINE, what, remedy, JSON.stringify(facts)])


func _unstable(what: String) -> Answer:
	var facts: Dictionary = {"kind": "SimulationUnstable", "time_s": stage.clock.time_s(), "what": what}
	var text: String = "the simulation became unstable at %.3f s: %s" % [stage.clock.time_s(), what]
	return _broken("%s\n%s" % [text, JSON.stringify(facts)])
