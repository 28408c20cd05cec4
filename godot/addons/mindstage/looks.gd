@tool
class_name MindstageLooks
extends RefCounted
## What is seen of a body: the mesh of its form, where there is one, else its solids.

const NODE: StringName = &"looks"
const _MESH_NAME: String = "^[0-9a-f]{8,64}\\.glb$"
const _LARGE_M: float = 2.0
const _SEEN_THROUGH: float = 0.06

## Set where looks are wanted although nothing is drawn, as when a scene is to be saved.
static var always: bool = false

static var _names: RegEx = RegEx.create_from_string(_MESH_NAME)
## The meshes of each file, with their places.
static var _files: Dictionary[String, Array] = {}
static var _materials: Dictionary[String, StandardMaterial3D] = {}
static var _by_class: Dictionary[String, StandardMaterial3D] = {}


## Whether anybody looks: nothing is made to be seen where nobody does.
static func is_watched() -> bool:
	return always or DisplayServer.get_name() != "headless" or Engine.is_editor_hint()


## Dresses a body's node anew; gives a note where its mesh cannot be read.
static func dress(body: MindstageBody) -> String:
	var file: String = body.form.get("mesh", "")
	if file.is_empty() and not is_watched():
		return ""
	var meshes: Array = meshes_of(file) if file else []
	if is_watched():
		strip(body.node)
		_show_all(body, meshes)
	if file and meshes.is_empty():
		return "the mesh %s of its form cannot be read, so its solids are shown" % file
	return ""


static func _show_all(body: MindstageBody, meshes: Array) -> void:
	if meshes.is_empty():
		var paint: StandardMaterial3D = _paint(body)
		for solid: Dictionary in body.solids():
			_show(body, MindstageSolids.mesh(solid), MindstageSolids.place(solid), paint)
	else:
		var paint: StandardMaterial3D = _named_paint(body)
		for each: Array in meshes:
			_show(body, each[0], each[1], paint)
	MindstageLights.glow(body)


## Takes away what is seen of a body.
static func strip(node: Node3D) -> void:
	for child: Node in node.get_children():
		if child.has_meta(NODE):
			node.remove_child(child)
			child.queue_free()


## The meshes that show a body.
static func parts(node: Node3D) -> Array[MeshInstance3D]:
	var found: Array[MeshInstance3D] = []
	for child: Node in node.get_children():
		if child is MeshInstance3D and child.has_meta(NODE):
			found.append(child)
	return found


## The meshes in a file of the forms' folder: each with its transform. None where it cannot be read.
static func meshes_of(file: String) -> Array:
	if not _files.has(file):
		_files[file] = _read(folder().path_join(file)) if _names.search(file) else []
		if _files[file].is_empty():
			push_error("Mindstage: the mesh '%s' cannot be read in %s" % [file, folder()])
	return _files[file]


## Where the files of forms are.
static func folder() -> String:
	var told: String = OS.get_environment("MINDSTAGE_FORMS")
	return told if told else OS.get_cache_dir().path_join("mindstage/forms")


static func _read(path: String) -> Array:
	if not FileAccess.file_exists(path):
		return []
	var document: GLTFDocument = GLTFDocument.new()
	var state: GLTFState = GLTFState.new()
	if document.append_from_file(path, state) != OK:
		return []
	var scene: Node = document.generate_scene(state)
	if scene == null:
		return []
	var found: Array = []
	_collect(scene, Transform3D(), found)
	scene.free()
	return found


static func _collect(node: Node, above: Transform3D, found: Array) -> void:
	var here: Transform3D = above
	if node is Node3D:
		here = above * (node as Node3D).transform
	if node is MeshInstance3D:
		found.append([(node as MeshInstance3D).mesh, here])
	elif node is ImporterMeshInstance3D:
		found.append([(node as ImporterMeshInstance3D).mesh.get_mesh(), here])
	for child: Node in node.get_children():
		_collect(child, here, found)


static func _show(body: MindstageBody, mesh: Mesh, place: Transform3D, paint: StandardMaterial3D) -> void:
	var part: MeshInstance3D = MeshInstance3D.new()
	part.mesh = mesh
	part.transform = place
	part.material_override = paint
	part.set_meta(NODE, true)
	body.node.add_child(part)


## The colour of the body's own material, if it tells one.
static func _named_paint(body: MindstageBody) -> StandardMaterial3D:
	for material: Dictionary in body.data.get("materials", []):
		var colour: Variant = material.get("colour")
		if colour is Array:
			return _material(Color(colour[0], colour[1], colour[2]), {})
	return null


static func _paint(body: MindstageBody) -> StandardMaterial3D:
	var named: StandardMaterial3D = _named_paint(body)
	if named != null:
		return named
	var size: Vector3 = MindstageFrames.extents(body.part.get("size", [0.1, 0.1, 0.1]))
	if body.part.get("ghost", false) and size[size.max_axis_index()] > _LARGE_M:
		return _material(Color(0.8, 0.8, 0.8, _SEEN_THROUGH), {})
	var surface: Variant = body.form.get("surface")
	if surface is Dictionary:
		var colour: Array = surface.get("colour", [0.8, 0.8, 0.8])
		return _material(Color(colour[0], colour[1], colour[2], surface.get("opacity", 1.0)), surface)
	return _paint_of_class(str(body.data.get("cls", "")))


## A quiet colour that is the same for all of a class.
static func _paint_of_class(name_of_class: String) -> StandardMaterial3D:
	if not _by_class.has(name_of_class):
		var hue: float = (name_of_class.hash() % 360) / 360.0
		_by_class[name_of_class] = _material(Color.from_hsv(hue, 0.18, 0.82), {})
	return _by_class[name_of_class]


static func _material(colour: Color, surface: Dictionary) -> StandardMaterial3D:
	var metalness: float = surface.get("metalness", 0.0)
	var roughness: float = surface.get("roughness", 0.8)
	var key: String = "%s %s %s" % [colour.to_html(), metalness, roughness]
	if not _materials.has(key):
		var material: StandardMaterial3D = StandardMaterial3D.new()
		material.albedo_color = colour
		material.metallic = metalness
		material.roughness = roughness
		if colour.a < 1.0:
			material.transparency = BaseMaterial3D.TRANSPARENCY_ALPHA
			material.cull_mode = BaseMaterial3D.CULL_FRONT
		_materials[key] = material
	return _materials[key]
