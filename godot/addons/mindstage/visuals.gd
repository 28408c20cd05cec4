@tool
class_name MindstageVisuals
extends RefCounted
## The visual meshes of a body: the mesh file of its geometry if there is one, else its collision shapes.

const NODE: StringName = &"mindstage_visual"
const _MESH_NAME: String = "^[0-9a-f]{8,64}\\.glb$"
const _TEXTURE_NAME: String = "^[a-z_]{1,64}$"
const _GENERATE_TANGENTS: int = 8  ## of EditorSceneFormatImporter, for normal maps
const _LARGE_M: float = 2.0
const _TRANSPARENT_ALPHA: float = 0.06

## Builds visuals even if rendering is disabled, for saving a scene.
static var always_enabled: bool = false

static var _names: RegEx = RegEx.create_from_string(_MESH_NAME)
## The meshes of each file with their transforms.
static var _files: Dictionary[String, Array] = {}
static var _texture_names: RegEx = RegEx.create_from_string(_TEXTURE_NAME)
## The images of procedural textures by file name; null for those that cannot be read.
static var _images: Dictionary[String, PortableCompressedTexture2D] = {}
static var _materials: Dictionary[String, StandardMaterial3D] = {}
## Materials of mesh files in the colors of maps.
static var _tinted: Dictionary[String, BaseMaterial3D] = {}
static var _by_class: Dictionary[String, StandardMaterial3D] = {}


## Whether visuals are built: not in headless mode, where nothing is rendered.
static func is_enabled() -> bool:
	return always_enabled or DisplayServer.get_name() != "headless" or Engine.is_editor_hint()


## Rebuilds the visuals of a body. Returns a warning if its mesh cannot be read, or an empty string.
static func build(body: MindstageBody) -> String:
	var file: String = body.geometry.get("mesh", "")
	if file.is_empty() and not is_enabled():
		return ""
	var meshes: Array = load_meshes(file) if file else []
	if is_enabled():
		remove(body.node)
		_add_meshes(body, meshes)
	if file and meshes.is_empty():
		return "the mesh %s cannot be read, so the collision shapes are shown" % file
	return ""


static func _add_meshes(body: MindstageBody, meshes: Array) -> void:
	if meshes.is_empty():
		var material: StandardMaterial3D = _default_material(body)
		for shape_data: Dictionary in body.collision_shapes():
			_show(
				body,
				MindstageCollisionShapes.mesh(shape_data),
				MindstageCollisionShapes.shape_transform(shape_data),
				material
			)
	else:
		var color: Variant = _map_color(body)
		for each: Array in meshes:
			var part: MeshInstance3D = _show(body, each[0], each[1], null)
			if color is Color:
				_tint(part, color)
	MindstageLights.add_emitted_lights(body)


## Removes the visuals of a body's node.
static func remove(node: Node3D) -> void:
	for child: Node in node.get_children():
		if child.has_meta(NODE):
			node.remove_child(child)
			child.queue_free()


## The visual meshes of a body's node.
static func mesh_instances(node: Node3D) -> Array[MeshInstance3D]:
	var found: Array[MeshInstance3D] = []
	for child: Node in node.get_children():
		if child is MeshInstance3D and child.has_meta(NODE):
			found.append(child)
	return found


## The meshes in a file of the geometry folder, each with its transform; empty if it cannot be read.
static func load_meshes(file: String) -> Array:
	if not _files.has(file):
		_files[file] = _read(folder().path_join(file)) if _names.search(file) else []
		if _files[file].is_empty():
			push_error("Mindstage: the mesh '%s' cannot be read in %s" % [file, folder()])
	return _files[file]


## The folder of the geometry files.
static func folder() -> String:
	var path: String = OS.get_environment("MINDSTAGE_FORMS")
	return path if path else OS.get_cache_dir().path_join("mindstage/meshes")


static func _read(path: String) -> Array:
	if not FileAccess.file_exists(path):
		return []
	var document: GLTFDocument = GLTFDocument.new()
	var state: GLTFState = GLTFState.new()
	if document.append_from_file(path, state, _GENERATE_TANGENTS) != OK:
		return []
	var scene: Node = document.generate_scene(state)
	if scene == null:
		return []
	var found: Array = []
	_collect(scene, Transform3D(), found)
	scene.free()
	for each: Array in found:
		_add_textures(each[0])
	return found


static func _collect(node: Node, parent_transform: Transform3D, found: Array) -> void:
	var node_transform: Transform3D = parent_transform
	if node is Node3D:
		node_transform = parent_transform * (node as Node3D).transform
	if node is MeshInstance3D:
		found.append([(node as MeshInstance3D).mesh, node_transform])
	elif node is ImporterMeshInstance3D:
		found.append([(node as ImporterMeshInstance3D).mesh.get_mesh(), node_transform])
	for child: Node in node.get_children():
		_collect(child, node_transform, found)


## Adds the images of the procedural textures that the materials of a mesh name.
static func _add_textures(mesh: Mesh) -> void:
	for surface: int in mesh.get_surface_count():
		var material: BaseMaterial3D = mesh.surface_get_material(surface) as BaseMaterial3D
		if material == null:
			continue
		var extras: Variant = material.get_meta(&"extras", {})
		var texture: String = extras.get("texture", "") if extras is Dictionary else ""
		if _texture_names.search(texture) == null:
			continue
		material.albedo_texture = _image(texture + "-color.jpg")
		material.roughness_texture = _image(texture + "-roughness.jpg")
		material.roughness_texture_channel = BaseMaterial3D.TEXTURE_CHANNEL_GREEN
		material.normal_texture = _image(texture + "-normal.jpg")
		material.normal_enabled = material.normal_texture != null
		material.texture_filter = BaseMaterial3D.TEXTURE_FILTER_LINEAR_WITH_MIPMAPS_ANISOTROPIC


## An image in the geometry folder, which all materials share; null if it cannot be read.
static func _image(file: String) -> PortableCompressedTexture2D:
	if not _images.has(file):
		var path: String = folder().path_join(file)
		var image: Image = Image.load_from_file(path) if FileAccess.file_exists(path) else null
		if image == null:
			push_warning("Mindstage: the texture '%s' cannot be read" % path)
			_images[file] = null
		else:
			image.generate_mipmaps()
			# Compressed, since a saved scene contains the images.
			var texture: PortableCompressedTexture2D = PortableCompressedTexture2D.new()
			texture.keep_compressed_buffer = true
			texture.create_from_image(image, PortableCompressedTexture2D.COMPRESSION_MODE_LOSSY, false, 0.85)
			_images[file] = texture
	return _images[file]


## Gives the opaque materials of a mesh the color of the map; pictures and glass keep theirs.
static func _tint(part: MeshInstance3D, color: Color) -> void:
	for surface: int in part.mesh.get_surface_count():
		var material: BaseMaterial3D = part.mesh.surface_get_material(surface) as BaseMaterial3D
		if material == null or material.transparency != BaseMaterial3D.TRANSPARENCY_DISABLED:
			continue
		if material.albedo_texture != null and not material.has_meta(&"extras"):
			continue
		var key: String = "%d %s" % [material.get_instance_id(), color.to_html()]
		if not _tinted.has(key):
			_tinted[key] = material.duplicate()
			_tinted[key].albedo_color = color
		part.set_surface_override_material(surface, _tinted[key])


static func _show(body: MindstageBody, mesh: Mesh, xform: Transform3D, material: StandardMaterial3D) -> MeshInstance3D:
	var part: MeshInstance3D = MeshInstance3D.new()
	part.mesh = mesh
	part.transform = xform
	part.material_override = material
	part.set_meta(NODE, true)
	body.node.add_child(part)
	return part


## The color given in the map, or null.
static func _map_color(body: MindstageBody) -> Variant:
	for material: Dictionary in body.data.get("materials", []):
		var color: Variant = material.get("color")
		if color is Array:
			return Color(color[0], color[1], color[2])
	return null


static func _default_material(body: MindstageBody) -> StandardMaterial3D:
	var named: Variant = _map_color(body)
	if named is Color:
		return _material(named, {})
	var size: Vector3 = MindstageFrames.extents(body.physics_model.get("size", [0.1, 0.1, 0.1]))
	if body.physics_model.get("ghost", false) and size[size.max_axis_index()] > _LARGE_M:
		return _material(Color(0.8, 0.8, 0.8, _TRANSPARENT_ALPHA), {})
	var surface: Variant = body.geometry.get("material")
	if surface is Dictionary:
		var color: Array = surface.get("color", [0.8, 0.8, 0.8])
		return _material(Color(color[0], color[1], color[2], surface.get("opacity", 1.0)), surface)
	return _class_material(str(body.data.get("cls", "")))


## A pale color derived from the class name.
static func _class_material(name_of_class: String) -> StandardMaterial3D:
	if not _by_class.has(name_of_class):
		var hue: float = (name_of_class.hash() % 360) / 360.0
		_by_class[name_of_class] = _material(Color.from_hsv(hue, 0.18, 0.82), {})
	return _by_class[name_of_class]


static func _material(color: Color, surface: Dictionary) -> StandardMaterial3D:
	var metalness: float = surface.get("metalness", 0.0)
	var roughness: float = surface.get("roughness", 0.8)
	var key: String = "%s %s %s" % [color.to_html(), metalness, roughness]
	if not _materials.has(key):
		var material: StandardMaterial3D = StandardMaterial3D.new()
		material.albedo_color = color
		material.metallic = metalness
		material.roughness = roughness
		if color.a < 1.0:
			material.transparency = BaseMaterial3D.TRANSPARENCY_ALPHA
			material.cull_mode = BaseMaterial3D.CULL_FRONT
		_materials[key] = material
	return _materials[key]
