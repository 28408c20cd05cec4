"""Export to glTF: a node for each body, with its pose, size and color."""

from __future__ import annotations

import io
import json
import struct
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from msgspec.structs import replace

from mindstage.assets.gltf import _PRIMITIVES, GltfWriter, geometry_to_glb, world_to_glb
from mindstage.errors import MapWriteError
from mindstage.geometry import build_geometry, template_by_name
from mindstage.scene import (
    AttachedLight,
    Attachment,
    Body,
    BodyGeometry,
    BodyId,
    Iri,
    Light,
    LightType,
    Material,
    PbrMaterial,
    Pose,
    PrimitiveShape,
    PrimitiveType,
    VisualMesh,
    World,
)
from mindstage.scene.transforms import normalized_pose_array, rotation_matrix
from mindstage.textures import TextureMap, texture_set
from tests.kitchenette import kitchenette
from tests.worlds import worlds

M = "http://example.org/m.owl#"
GLTF_FROM_ROS = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""Forward (x) is z in glTF, and up (z) is y."""
CUP = Body(
    id=BodyId("cup"),
    iri=Iri(M + "cup"),
    cls=Iri(M + "Cup"),
    pose=Pose((1.0, 2.0, 3.0), (0.9659258, 0.0, 0.0, 0.258819)),
    size=(0.1, 0.2, 0.3),
    label="The cup",
)


CORNER = (
    np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 3.0)]),
    np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)], dtype=np.uint32),
)
"""Points and faces of the corner of a box."""


def world_of(*bodies: Body, **more: object) -> World:
    return replace(World(iri=Iri(M + "map"), name="map", bodies=bodies), **more)


def json_chunk(data: bytes) -> dict[str, Any]:
    """The JSON chunk of a file, after checking its header."""
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    assert size % 4 == 0
    return json.loads(data[20 : 20 + size])


def loaded_scene(world: World) -> trimesh.Scene:
    scene = trimesh.load(io.BytesIO(world_to_glb(world).data), file_type="glb")
    assert isinstance(scene, trimesh.Scene)
    return scene


def test_every_body_is_a_node_with_its_pose_and_size() -> None:
    world = kitchenette()
    scene = loaded_scene(world)
    for body in world.bodies:
        transform, name = scene.graph[body.id]
        row = normalized_pose_array(body.pose)
        np.testing.assert_allclose(transform[:3, 3], GLTF_FROM_ROS @ row[:3], atol=1e-9)
        np.testing.assert_allclose(transform[:3, :3], GLTF_FROM_ROS @ rotation_matrix(row[3:]), atol=1e-9)
        if body.size is not None:
            np.testing.assert_allclose(scene.geometry[name].extents, body.size, rtol=1e-6)


@settings(max_examples=30)
@given(world=worlds())
def test_any_world_can_be_exported(world: World) -> None:
    file = json_chunk(world_to_glb(world).data)
    nodes = file["nodes"]
    extras = [node["extras"]["id"] for node in nodes if "class" in node.get("extras", {})]
    assert sorted(extras) == sorted(body.id for body in world.bodies)
    children = [child for node in nodes for child in node.get("children", ())]
    assert sorted(children) == list(range(1, len(nodes)))
    assert file["scenes"][0]["nodes"] == [0]


def test_a_node_has_id_and_class_as_extras() -> None:
    _, node = json_chunk(world_to_glb(world_of(CUP)).data)["nodes"]
    assert node["name"] == "cup"
    assert node["extras"] == {"id": "cup", "class": M + "Cup", "iri": M + "cup", "label": "The cup"}


def test_attached_bodies_are_child_nodes() -> None:
    handle = replace(CUP, id=BodyId("handle"), iri=Iri(M + "handle"), pose=Pose((0.0, 0.0, 5.0)))
    world = world_of(handle, CUP, attachments=(Attachment(parent=CUP.id, child=handle.id),))
    root, child, cup = json_chunk(world_to_glb(world).data)["nodes"]
    assert (child["name"], cup["name"]) == ("handle", "cup")
    assert (root["children"], cup["children"]) == ([2], [1])
    transform, _ = loaded_scene(world).graph["handle"]
    np.testing.assert_allclose(transform[:3, 3], (0.0, 5.0, 0.0), atol=1e-7)


def test_colors_are_those_of_materials() -> None:
    red = Material(name="glaze", color=(1.0, 0.5, 0.0))
    other = replace(CUP, id=BodyId("other"), iri=Iri(M + "other"))
    file = json_chunk(world_to_glb(world_of(replace(CUP, materials=(red,)), other)).data)
    first, second = (file["meshes"][node["mesh"]]["primitives"][0]["material"] for node in file["nodes"][1:])
    assert file["materials"][first]["name"] == "glaze"
    factor = file["materials"][first]["pbrMetallicRoughness"]["baseColorFactor"]
    assert factor == pytest.approx([1.0, 0.2140411, 0.0, 1.0], abs=1e-6)  # half in sRGB is a fifth in linear units
    assert first != second


def test_equal_meshes_are_stored_once() -> None:
    cups = [replace(CUP, id=BodyId(str(n)), iri=Iri(f"{M}{n}")) for n in range(50)]
    file = json_chunk(world_to_glb(world_of(*cups)).data)
    assert (len(file["meshes"]), len(file["nodes"])) == (1, 51)


@pytest.mark.parametrize("kind", PrimitiveType)
def test_primitive_meshes_are_closed_and_face_outwards(kind: PrimitiveType) -> None:
    surface = _PRIMITIVES[kind]((1.0, 2.0, 3.0))
    mesh = trimesh.Trimesh(surface.points, surface.faces)
    mesh.merge_vertices(merge_norm=True)
    assert mesh.is_watertight
    full = {PrimitiveType.BOX: 6.0, PrimitiveType.SPHERE: np.pi, PrimitiveType.CYLINDER: 1.5 * np.pi}[kind]
    assert mesh.volume == pytest.approx(full, rel=0.04)
    assert surface.normals is not None
    corners = surface.points[surface.faces]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ikj->ik", facing, surface.normals[surface.faces]) > 0.0).all()


def test_an_empty_world_can_be_exported() -> None:
    written = world_to_glb(world_of())
    assert [node["name"] for node in json_chunk(written.data)["nodes"]] == ["map"]
    assert written.notes == ()


def test_bodies_without_a_mesh_are_reported() -> None:
    written = world_to_glb(world_of(replace(CUP, size=None)))
    assert "mesh" not in json_chunk(written.data)["nodes"][1]
    assert "1 bodies have neither size nor mesh" in written.notes[0]


def test_lights_are_exported() -> None:
    lamp = Light(
        id=BodyId("lamp"), iri=Iri(M + "lamp"), type=LightType.SPOT, pose=Pose((0.0, 0.0, 2.0)), intensity=40.0
    )
    file = json_chunk(world_to_glb(world_of(lights=(lamp,))).data)
    (light,) = file["extensions"]["KHR_lights_punctual"]["lights"]
    assert (light["type"], light["intensity"]) == ("spot", 40.0)
    assert file["nodes"][1]["extensions"]["KHR_lights_punctual"] == {"light": 0}


def test_geometry_is_exported_as_meshes() -> None:
    glass = VisualMesh(*CORNER, material=PbrMaterial(name="glass", color=(0.5, 1.0, 1.0), opacity=0.25, roughness=0.1))
    steel = VisualMesh(*CORNER, material=PbrMaterial(name="steel", metalness=1.0))
    geometry = BodyGeometry(key="jar", visuals=(glass, steel), collision_shapes=())
    other = replace(CUP, id=BodyId("other"), iri=Iri(M + "other"))
    file = json_chunk(world_to_glb(world_of(CUP, other), geometry={CUP.id: geometry, other.id: geometry}).data)
    assert file["nodes"][1]["mesh"] == file["nodes"][2]["mesh"]
    primitives = file["meshes"][0]["primitives"]
    visible = [file["materials"][primitive["material"]] for primitive in primitives]
    assert [material["name"] for material in visible] == ["glass", "steel"]
    assert visible[0]["alphaMode"] == "BLEND"
    assert visible[0]["pbrMetallicRoughness"]["baseColorFactor"][3] == 0.25
    assert visible[1]["pbrMetallicRoughness"]["metallicFactor"] == 1.0


def test_textures_are_exported_upright() -> None:
    image = np.zeros((2, 2, 4), dtype=np.uint8)
    image[0, 1] = (255, 0, 0, 255)  # the upper right corner
    points, faces = CORNER
    uv = np.array([(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)])
    visual = VisualMesh(points, faces, PbrMaterial(color=(1.0, 1.0, 1.0)), uv=uv, image=image)
    scene = trimesh.load(
        io.BytesIO(world_to_glb(world_of(CUP), geometry={CUP.id: BodyGeometry("k", (visual,), ())}).data),
        file_type="glb",
    )
    assert isinstance(scene, trimesh.Scene)
    (mesh,) = scene.geometry.values()
    np.testing.assert_allclose(mesh.visual.uv, uv, atol=1e-6)
    assert np.asarray(mesh.visual.material.baseColorTexture)[0, 1].tolist() == [255, 0, 0, 255]


def test_attached_lights_are_exported() -> None:
    light = AttachedLight(pose=Pose((0.0, 0.0, -0.1)), color=(1.0, 0.9, 0.8), intensity=60.0)
    geometry = BodyGeometry("lamp", (VisualMesh(*CORNER, material=PbrMaterial(emission=1.0)),), (), lights=(light,))
    file = json_chunk(world_to_glb(world_of(CUP), geometry={CUP.id: geometry}).data)
    assert file["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"] == 60.0
    assert file["nodes"][1]["children"] == [2]
    assert "emissiveFactor" in file["materials"][0]


def test_geometry_is_exported_in_godots_axes() -> None:
    """Forward (x) is negative z in Godot, left (y) is negative x, and up is y."""
    data = geometry_to_glb(BodyGeometry("corner", (VisualMesh(*CORNER, material=PbrMaterial()),), ()))
    scene = trimesh.load(io.BytesIO(data), file_type="glb")
    assert isinstance(scene, trimesh.Scene)
    np.testing.assert_allclose(scene.bounds, [(-2.0, 0.0, -1.0), (0.0, 3.0, 0.0)], atol=1e-6)
    (mesh,) = scene.geometry.values()
    assert mesh.volume == pytest.approx(1.0), "it is still turned outside out"


def test_an_invalid_pose_is_refused() -> None:
    with pytest.raises(MapWriteError, match="its pose is not finite"):
        world_to_glb(world_of(replace(CUP, pose=Pose((float("nan"), 0.0, 0.0)))))
    with pytest.raises(MapWriteError, match="its size"):
        world_to_glb(world_of(replace(CUP, size=(1.0, float("inf"), 1.0), shape=PrimitiveShape())))


def test_the_header_has_the_version_and_the_length_of_the_binary_chunk() -> None:
    data = world_to_glb(world_of(CUP)).data
    document = json_chunk(data)
    (json_length,) = struct.unpack_from("<I", data, 12)
    (binary_length,) = struct.unpack_from("<I", data, 20 + json_length)
    assert document["asset"]["version"] == "2.0"
    assert document["buffers"] == [{"byteLength": binary_length}]


# -- procedural textures -----------------------------------------------------------------------------------------------


def board(size: tuple[float, float, float], texture: str = "oak_board") -> BodyGeometry:
    material = PbrMaterial(name="wood", color=(0.7, 0.5, 0.3), roughness=0.6, texture=texture)
    return build_geometry(template_by_name("panel"), size, materials={"body": material})


def test_procedural_textures_are_embedded_once_per_file() -> None:
    other = replace(CUP, id=BodyId("other"), iri=Iri(M + "other"))
    geometry = {CUP.id: board((0.1, 0.5, 0.02)), other.id: board((0.2, 0.3, 0.02))}
    data = world_to_glb(world_of(CUP, other), geometry=geometry).data
    file = json_chunk(data)
    (material,) = file["materials"]
    assert len(file["meshes"]) == 2
    assert len(file["images"]) == len(file["textures"]) == 3
    assert file["samplers"] == [{"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497}]
    pbr = material["pbrMetallicRoughness"]
    indices = [
        each["index"] for each in (pbr["baseColorTexture"], pbr["metallicRoughnessTexture"], material["normalTexture"])
    ]
    assert sorted(indices) == [0, 1, 2]
    assert material["extras"] == {"texture": "oak_board"}
    for index in indices:
        image = file["images"][file["textures"][index]["source"]]
        view = file["bufferViews"][image["bufferView"]]
        start = data.index(b"BIN\0") + 4 + view["byteOffset"]
        assert image["mimeType"] == "image/jpeg"
        assert data[start : start + 2] == b"\xff\xd8"
        assert data[start + view["byteLength"] - 2 : start + view["byteLength"]] == b"\xff\xd9"
    for mesh in file["meshes"]:
        for primitive in mesh["primitives"]:
            counts = {file["accessors"][index]["count"] for index in primitive["attributes"].values()}
            assert len(counts) == 1
            assert "TEXCOORD_0" in primitive["attributes"]


def test_an_importer_reads_the_maps_of_a_procedural_texture() -> None:
    geometry = board((0.1, 0.5, 0.02))
    scene = trimesh.load(io.BytesIO(world_to_glb(world_of(CUP), geometry={CUP.id: geometry}).data), file_type="glb")
    assert isinstance(scene, trimesh.Scene)
    (mesh,) = scene.geometry.values()
    material = mesh.visual.material
    texture = texture_set("oak_board")
    for image, expected in (
        (material.baseColorTexture, texture.color),
        (material.normalTexture, texture.normal),
        (np.asarray(material.metallicRoughnessTexture)[..., 1], texture.roughness),
    ):
        assert np.abs(np.asarray(image, dtype=float) - expected).mean() < 6.0, "JPEG is nearly exact"
    assert np.asarray(material.metallicRoughnessTexture)[..., 2].mean() > 250
    uv = geometry.visuals[0].uv
    assert uv is not None
    np.testing.assert_allclose(mesh.visual.uv, uv, atol=1e-5)


def test_textures_of_other_files_are_named_by_their_address() -> None:
    def address(name: str, map: TextureMap) -> str | None:
        return f"/t/{name}-{map}.jpg" if map is TextureMap.COLOR else None

    file = GltfWriter("board", texture_uri=address)
    file.nodes.append({})
    file.visual_primitive(board((0.1, 0.5, 0.02)).visuals[0])
    document = json_chunk(file.data())
    assert document["images"] == [{"uri": "/t/oak_board-color.jpg"}]
    assert "normalTexture" not in document["materials"][0]


def test_a_texture_without_texture_coordinates_is_left_out() -> None:
    plain = VisualMesh(*CORNER, material=PbrMaterial(texture="oak_board"))
    file = json_chunk(world_to_glb(world_of(CUP), geometry={CUP.id: BodyGeometry("k", (plain,), ())}).data)
    assert "images" not in file
    assert "extras" not in file["materials"][0]
