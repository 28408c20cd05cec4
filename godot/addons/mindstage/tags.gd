@tool
class_name MindstageTags
extends RefCounted
## The description of a body as metadata of its node, so that game code can find bodies by their tags.

## Key of the metadata: the description with `id`, `cls`, `tags`, `facts` and all other members.
const META: StringName = &"mindstage"


## Sets the description of a node.
static func write(node: Node, description: Dictionary) -> void:
	node.set_meta(META, description)


## The id of the body or joint of a node; the node's name if it has no description.
static func id_of(node: Node) -> String:
	return node.get_meta(META, {}).get("id", str(node.name))


## The value of a node's tag, or null.
static func value(node: Node, type: String, key: String) -> Variant:
	for tag: Dictionary in node.get_meta(META, {}).get("tags", []):
		if tag.get("type") == type and tag.get("key") == key:
			return tag.get("value")
	return null


## All descendants of a node with a tag, optionally only those with a given value.
static func find(below: Node, type: String, key: String, expected: Variant = null) -> Array[Node]:
	var found: Array[Node] = []
	for node: Node in below.find_children("*", "Node3D", true, false):
		var has: Variant = value(node, type, key)
		if has != null and (expected == null or has == expected):
			found.append(node)
	return found
