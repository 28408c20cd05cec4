class_name MindstageExampleWorlds
extends RefCounted
## Small worlds for tests, as JSON.


## A box; `more` are further members.
static func body(
	id: String, at: Array, size: Array, mobility: String = "static", mass: float = 0.0, more: Dictionary = {}
) -> Dictionary:
	var physics: Dictionary = {"mobility": mobility}
	if mass > 0.0:
		physics["mass_kg"] = mass
	var data: Dictionary = {
		"id": id,
		"iri": "http://example.org/maps/scene.owl#" + id,
		"cls": "http://example.org/maps/scene.owl#Thing",
		"pose": {"position": at, "quaternion": [1.0, 0.0, 0.0, 0.0]},
		"size": size,
		"physics": physics,
	}
	data.merge(more, true)
	return data


## A joint between two bodies.
static func joint(id: String, parent: String, child: String, at: Array, motions: Dictionary) -> Dictionary:
	var data: Dictionary = {
		"id": id,
		"iri": "http://example.org/maps/scene.owl#" + id,
		"parent": parent,
		"child": child,
		"pose": {"position": at, "quaternion": [1.0, 0.0, 0.0, 0.0]},
	}
	data.merge(motions)
	return data


static func world(bodies: Array, joints: Array = [], attachments: Array = []) -> String:
	var data: Dictionary = {
		"iri": "http://example.org/maps/scene.owl#scene",
		"name": "scene",
		"bodies": bodies,
		"joints": joints,
		"attachments": attachments,
		"format_version": 2,
	}
	return MindstageJsonText.write(data)


## A cabinet with a drawer and a handle.
static func drawer(motions: Dictionary) -> String:
	return world(
		[
			body("case", [0.0, 0.0, 0.5], [0.6, 0.6, 1.0]),
			body("drawer", [0.0, 0.0, 0.5], [0.58, 0.5, 0.2], "dynamic", 5.0),
			body("handle", [0.32, 0.0, 0.5], [0.05, 0.3, 0.02], "kinematic", 0.2),
		],
		[joint("slide", "case", "drawer", [0.3, 0.0, 0.5], motions)],
		[{"parent": "drawer", "child": "handle"}]
	)
