@tool
class_name MindstageSceneFile
extends RefCounted
## Exports a simulation as a self-contained Godot scene file.
##
## The file does not depend on this addon.


## Writes the file. Returns why it failed, or an empty string.
static func save(simulation: MindstageSimulation, path: String) -> String:
	if not (path.ends_with(".tscn") or path.ends_with(".scn")):
		return "'%s' is not a scene file name; it must end with .tscn or .scn" % path
	simulation.build_all_visuals()
	var copy: Node = simulation.duplicate(0)  # 0: without scripts and signals
	if not Engine.is_editor_hint():
		for id: String in simulation.physics_scene.groups:
			var node: CollisionObject3D = simulation.physics_scene.groups[id].node
			MindstagePhysicsNodeBuilder.add_shape_nodes(node, copy.get_node(simulation.get_path_to(node)))
	set_owners(copy, copy)
	var packed: PackedScene = PackedScene.new()
	var error: Error = packed.pack(copy)
	copy.free()
	if error == OK:
		error = ResourceSaver.save(packed, path)
	return "" if error == OK else "the scene cannot be written to '%s': %s" % [path, error_string(error)]


## Sets the owner of all descendants of a node, so that they are saved with the scene.
static func set_owners(node: Node, scene: Node) -> void:
	for child: Node in node.get_children():
		child.owner = scene
		set_owners(child, scene)
