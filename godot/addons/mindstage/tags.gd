@tool
class_name MindstageTags
extends RefCounted
## What a map says of a body, as metadata of its node: whoever writes a game on top of it finds bodies by their tags.

## The whole description, as it is in the world: `id`, `cls`, `tags`, `facts` and what else there is.
const META: StringName = &"mindstage"


## Writes a description to a node.
static func write(node: Node, description: Dictionary) -> void:
	node.set_meta(META, description)


## The id of what a node is; its own name where it is nothing of a map.
static func id_of(node: Node) -> String:
	return node.get_meta(META, {}).get("id", str(node.name))


## The value of a node's tag, or null.
static func value(node: Node, type: String, key: String) -> Variant:
	for tag: Dictionary in node.get_meta(META, {}).get("tags", []):
		if tag.get("type") == type and tag.get("key") == key:
			return tag.get("value")
	return null


## All nodes below one that have a tag; with a value, only those whose tag has it.
static func find(below: Node, type: String, key: String, wanted: Variant = null) -> Array[Node]:
	var found: Array[Node] = []
	for node: Node in below.find_children("*", "Node3D", true, false):
		var has: Variant = value(node, type, key)
		if has != null and (wanted == null or has == wanted):
			found.append(node)
	return found
