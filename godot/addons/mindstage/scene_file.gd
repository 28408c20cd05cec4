@tool
class_name MindstageSceneFile
extends RefCounted
## A stage as a scene file of Godot's own, with all that it is made of in it.
##
## Nothing of this addon is in it, so it opens anywhere.


## Writes it; gives why it cannot, or an empty string.
static func save(stage: MindstageStage, path: String) -> String:
	if not (path.ends_with(".tscn") or path.ends_with(".scn")):
		return "'%s' is no scene file; its name ends with .tscn or .scn" % path
	stage.dress_all()
	var plain: Node = stage.duplicate(0)  # without scripts
	if not Engine.is_editor_hint():
		for id: String in stage.assembler.carriers:
			var node: CollisionObject3D = stage.assembler.carriers[id].node
			MindstageSpawner.show_shapes(node, plain.get_node(stage.get_path_to(node)))
	own(plain, plain)
	var packed: PackedScene = PackedScene.new()
	var error: Error = packed.pack(plain)
	plain.free()
	if error == OK:
		error = ResourceSaver.save(packed, path)
	return "" if error == OK else "the scene cannot be written to '%s': %s" % [path, error_string(error)]


## Makes everything below a node part of a scene, so that it is saved with it.
static func own(node: Node, scene: Node) -> void:
	for child: Node in node.get_children():
		child.owner = scene
		own(child, scene)
