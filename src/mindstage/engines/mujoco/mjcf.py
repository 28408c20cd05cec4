"""Writes a world as an MJCF file, which simulates like `MujocoEngine`.

The file is written from the compiled model, since MuJoCo's own writer keeps six digits only. Each body becomes a body,
each joint one or more MuJoCo joints with its name; the classes of bodies are custom texts.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np

from mindstage.engines.actuators import ActuatedBodies
from mindstage.engines.base import SpawnNoteKind
from mindstage.engines.edits import SetActuators
from mindstage.engines.kinematic_tree import AXIS_NAMES
from mindstage.engines.mujoco.compiler import MeshAsset, compile_model, load_mesh
from mindstage.engines.mujoco.mjcf_visuals import VisualAssets, format_color
from mindstage.engines.mujoco.model_cache import ModelCache
from mindstage.engines.mujoco.state import CompiledModel, limit_stiffness
from mindstage.errors import MapWriteError
from mindstage.scene import NO_GEOMETRY, Body, BodyGeometry, BodyId, GeometryMap, Joint, Light, LightType, World
from mindstage.scene.edits import Spawn
from mindstage.scene.transforms import normalized_pose_array, quat_rotate

__all__ = ["MjcfExport", "world_to_mjcf"]

_MAX_DEPTH = 400
"""Nested bodies that MuJoCo's XML parser accepts."""
_GEOMS = {
    int(mujoco.mjtGeom.mjGEOM_BOX): ("box", 3),
    int(mujoco.mjtGeom.mjGEOM_SPHERE): ("sphere", 1),
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): ("ellipsoid", 3),
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): ("cylinder", 2),
}
_JOINTS = {
    int(mujoco.mjtJoint.mjJNT_SLIDE): "slide",
    int(mujoco.mjtJoint.mjJNT_HINGE): "hinge",
    int(mujoco.mjtJoint.mjJNT_BALL): "ball",
}
_FORBIDDEN_CHARACTERS = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_MIN_NUMBER = 2.3e-308
"""Smaller numbers are written as 0, since MuJoCo refuses them."""
_VISUAL_GROUP, _COLLISION_GROUP = "1", "3"
"""Geom groups: MuJoCo's viewer shows the first and hides the other."""
_VISUAL_GEOM = {"type": "mesh", "mass": "0", "contype": "0", "conaffinity": "0", "group": _VISUAL_GROUP}


class MjcfExport(NamedTuple):
    """An MJCF document, notes on what it leaves out, and the files that it refers to."""

    text: str
    notes: tuple[str, ...]
    files: Mapping[str, bytes]
    """Contents of meshes and textures by path, relative to the document; MuJoCo's `from_xml_string` takes them as
    `assets`."""


def world_to_mjcf(
    world: World,
    *,
    geometry: GeometryMap = NO_GEOMETRY,
    find_mesh: Callable[[str], Path | None] = lambda name: None,
    actuated: Iterable[ActuatedBodies] = (),
    visuals_folder: str | None = None,
) -> MjcfExport:
    """Writes a world as MJCF.

    Actuators are written as the servos that the engine simulates, with their limits; weight is compensated as there.
    The keyframe "commands" has the commands: load it to begin with them.

    Args:
        world: the world.
        geometry: geometry of its bodies; their collision shapes are written, hulls as points.
        find_mesh: returns the path of a body's mesh file, or None; the file is referenced, not copied.
        actuated: bodies with actuators; their geometry takes precedence.
        visuals_folder: the folder for visual meshes and textures, relative to the document; without it they are left
            out, and collision shapes are shown.

    Raises:
        MapWriteError: MuJoCo could not read the file.
        EngineUnavailableError: MuJoCo cannot compile the world.
    """
    actuated = tuple(actuated)
    geometry = {**geometry, **{id: each for bodies in actuated for id, each in bodies.geometry.items()}}
    cache = ModelCache(0.002)
    pairs = frozenset(pair for bodies in actuated for pair in bodies.excluded_pairs)
    report = cache.apply(Spawn(world, geometry=geometry, excluded_pairs=pairs)).report
    for bodies in actuated:
        cache.apply(SetActuators(bodies.actuators, tuple(bodies.without_weight)))
    failures = (*report.failed_bodies, *report.failed_joints, *report.failed_attachments)
    compiled = compile_model(replace(cache.model_input(), kinematics_driven=True, has_mocap_bodies=True), scenery=False)
    if compiled.actuators.names:
        limit_stiffness(compiled)
    document = _Document(world, compiled, find_mesh, geometry, visuals_folder)
    document.write()
    document.write_actuators({name: command for bodies in actuated for name, command in bodies.commands.items()})
    notes = [f"{failure.id} is left out: {failure.reason}" for failure in failures]
    notes += [note.text for note in report.notes if note.kind in (SpawnNoteKind.JOINT, SpawnNoteKind.SETTLED)]
    files = {} if document.visuals is None else document.visuals.files
    return MjcfExport(document.text(), (*notes, *document.notes), files)


class _Document:
    def __init__(
        self,
        world: World,
        compiled: CompiledModel,
        find_mesh: Callable[[str], Path | None],
        geometry: GeometryMap,
        visuals_folder: str | None,
    ) -> None:
        self.world, self.compiled, self.find_mesh, self.geometry = world, compiled, find_mesh, geometry
        self.model: Any = compiled.model
        self.bodies: dict[int, Body] = {}
        by_id = {body.id: body for body in world.bodies}
        for id, body_id in compiled.body_ids.items():
            self.bodies[body_id] = by_id[id]
        self.notes: list[str] = []
        self.root = ElementTree.Element("mujoco", model=_xml_text(world.name) or "world")
        self.assets = ElementTree.Element("asset")
        self.visuals = None if visuals_folder is None else VisualAssets(self.root, self.assets, visuals_folder)
        self.meshes: dict[tuple[Path, tuple[float, ...]], str] = {}
        self.mesh_cache: dict[Path, MeshAsset | None] = {}
        self.names = self._names()

    def text(self) -> str:
        """The document as text."""
        ElementTree.indent(self.root)
        return ElementTree.tostring(self.root, encoding="unicode") + "\n"

    def write(self) -> None:
        """Builds the document."""
        ElementTree.SubElement(self.root, "compiler", angle="radian")
        timestep = repr(float(self.model.opt.timestep))
        impratio = repr(float(self.model.opt.impratio))
        attributes = {"timestep": timestep, "integrator": "implicitfast", "cone": "elliptic", "impratio": impratio}
        option = ElementTree.SubElement(self.root, "option", attributes)
        ElementTree.SubElement(option, "flag", sleep="enable", autoreset="disable")
        self._add_custom_texts()
        self.root.append(self.assets)
        self._add_hull_meshes()
        self._add_bodies()
        self._add_excludes()
        if not len(self.assets):
            self.root.remove(self.assets)
        self._add_omission_notes()

    def write_actuators(self, commands: Mapping[str, float]) -> None:
        """Adds the actuators, and a keyframe with their commands."""
        model, joints = self.model, self._joint_names()
        if not model.nu:
            return
        parent = ElementTree.SubElement(self.root, "actuator")
        for number in range(model.nu):
            attributes = {
                "name": _xml_text(self.compiled.actuators.names[number]),
                "joint": joints[int(model.actuator_trnid[number, 0])],
                "gear": _format_numbers(model.actuator_gear[number][:1]),
                "forcelimited": "true",
                "forcerange": _format_numbers(model.actuator_forcerange[number]),
                "gaintype": "fixed",
                "gainprm": _format_numbers(model.actuator_gainprm[number][:1]),
                "biastype": "affine",
                "biasprm": _format_numbers(model.actuator_biasprm[number][:3]),
            }
            ElementTree.SubElement(parent, "general", attributes)
        keyframe = ElementTree.SubElement(self.root, "keyframe")
        values = [commands.get(name, 0.0) for name in self.compiled.actuators.names]
        ElementTree.SubElement(keyframe, "key", name="commands", ctrl=_format_numbers(values))

    # -- names ---------------------------------------------------------------------------------------------------------

    def _names(self) -> dict[int, str]:
        """Unique body names: the id, unless MuJoCo or XML does not allow it."""
        names: dict[int, str] = {0: "world"}
        taken = {"world"}
        for body_id in range(1, self.model.nbody):
            body = self.bodies.get(body_id)
            base = _xml_text(body.id if body else self.model.body(body_id).name) or "body"
            name, count = base, 2
            while name in taken:
                name, count = f"{base}-{count}", count + 1
            if body and name != body.id:
                self.notes.append(f"{body.id!r} is named {name!r}")
            names[body_id] = name
            taken.add(name)
        return names

    def _add_custom_texts(self) -> None:
        custom = ElementTree.SubElement(self.root, "custom")
        ElementTree.SubElement(custom, "text", name="map", data=_xml_text(self.world.iri))
        for body_id, body in self.bodies.items():
            ElementTree.SubElement(custom, "text", name=f"class of {self.names[body_id]}", data=_xml_text(body.cls))

    def _add_omission_notes(self) -> None:
        """Notes on properties that MJCF cannot express."""
        world = self.world
        entities: list[Body | Joint | Light] = [*world.bodies, *world.joints, *world.lights]
        facts = sum(len(entity.facts) for entity in entities) + len(world.resources) + len(world.facts)
        tags = sum(len(entity.tags) for entity in entities)
        if self.visuals is not None and self.visuals.left_out:
            count = self.visuals.left_out
            self.notes.append(f"{count} visual {'mesh' if count == 1 else 'meshes'} without an area left out")
        if facts or tags:
            self.notes.append(f"MJCF cannot express {facts} facts and resources and {tags} tags; they are left out")

    # -- bodies --------------------------------------------------------------------------------------------------------

    def _add_bodies(self) -> None:
        model = self.model
        worldbody = ElementTree.SubElement(self.root, "worldbody")
        for light in self.world.lights:
            ElementTree.SubElement(worldbody, "light", dict(_light(light)))
        elements, depths = {0: worldbody}, {0: 0}
        for body_id in range(1, model.nbody):
            parent = int(model.body_parentid[body_id])
            depths[body_id] = depths[parent] + 1
            if depths[body_id] > _MAX_DEPTH:
                cause = f"more than {_MAX_DEPTH} bodies are nested, at {self.names[body_id]!r}"
                raise MapWriteError(self.world.name, cause=cause, remedy="export glTF (.glb), which has no such limit")
            elements[body_id] = self._add_body(elements[parent], body_id)
        joints = self._joint_names()
        for joint in range(model.njnt):
            self._add_joint(elements[int(model.jnt_bodyid[joint])], joint, joints.get(joint))
        for geom in range(model.ngeom):
            self._add_geom(elements[int(model.geom_bodyid[geom])], geom)
        for body_id, body in self.bodies.items():
            self._add_visual_mesh(elements[body_id], body)

    def _add_body(self, parent: ElementTree.Element, body_id: int) -> ElementTree.Element:
        model = self.model
        attributes = {
            "name": self.names[body_id],
            "pos": _format_numbers(model.body_pos[body_id]),
            "quat": _format_numbers(model.body_quat[body_id]),
        }
        if model.body_mocapid[body_id] >= 0:
            attributes["mocap"] = "true"
        if model.body_gravcomp[body_id]:
            attributes["gravcomp"] = _format_numbers([model.body_gravcomp[body_id]])
        element = ElementTree.SubElement(parent, "body", attributes)
        if model.body_mass[body_id] > 0.0:
            inertia = {
                "pos": _format_numbers(model.body_ipos[body_id]),
                "quat": _format_numbers(model.body_iquat[body_id]),
                "mass": _format_numbers([model.body_mass[body_id]]),
                "diaginertia": _format_numbers(model.body_inertia[body_id]),
            }
            ElementTree.SubElement(element, "inertial", inertia)
        return element

    def _add_geom(self, element: ElementTree.Element, geom: int) -> None:
        model = self.model
        attributes = {
            "pos": _format_numbers(model.geom_pos[geom]),
            "quat": _format_numbers(model.geom_quat[geom]),
            "mass": "0",
        }
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            attributes |= {"type": "mesh", "mesh": model.mesh(int(model.geom_dataid[geom])).name}
        else:
            kind, count = _GEOMS[int(model.geom_type[geom])]
            attributes |= {"type": kind, "size": _format_numbers(model.geom_size[geom][:count])}
        attributes |= {"contype": str(model.geom_contype[geom]), "conaffinity": str(model.geom_conaffinity[geom])}
        if model.geom_contype[geom]:
            attributes |= {
                "friction": _format_numbers(model.geom_friction[geom]),
                "condim": str(int(model.geom_condim[geom])),
                "priority": str(int(model.geom_priority[geom])),
                "solref": _format_numbers(model.geom_solref[geom]),
                "solimp": _format_numbers(model.geom_solimp[geom]),
                "margin": _format_numbers([model.geom_margin[geom]]),
            }
        body = self.bodies.get(int(model.geom_bodyid[geom]))
        if body and (self._mesh_of(body) or self._geometry_with_visuals(body)):
            attributes["group"] = _COLLISION_GROUP
        ElementTree.SubElement(element, "geom", attributes | self._color_attributes(body))

    def _add_hull_meshes(self) -> None:
        """The points of hulls; MuJoCo computes their faces."""
        model = self.model
        for number in range(model.nmesh):
            first, count = int(model.mesh_vertadr[number]), int(model.mesh_vertnum[number])
            corners = model.mesh_vert[first : first + count].reshape(-1)
            ElementTree.SubElement(self.assets, "mesh", name=model.mesh(number).name, vertex=_format_numbers(corners))

    def _color_attributes(self, body: Body | None) -> dict[str, str]:
        """The body's own color, else that of its first visual mesh."""
        if body and body.color is not None:
            return {"rgba": format_color(*body.color, 1.0)}
        geometry = self.geometry.get(body.id) if body else None
        if geometry is None or not geometry.visuals:
            return {}
        surface = geometry.visuals[0].material
        return {"rgba": format_color(*surface.color, surface.opacity)}

    def _add_visual_mesh(self, element: ElementTree.Element, body: Body) -> None:
        mesh = self._mesh_of(body)
        if mesh is None:
            self._add_visuals(element, body)
            return
        scale = mesh.scale_to(body.size)
        name = self.meshes.get((mesh.path, scale))
        if name is None:
            name = self.meshes[mesh.path, scale] = f"{_xml_text(mesh.path.stem)}-{len(self.meshes) + 1}"
            attributes = {"name": name, "file": str(mesh.path), "scale": _format_numbers(scale), "inertia": "shell"}
            ElementTree.SubElement(self.assets, "mesh", attributes)
        attributes = {"mesh": name} | self._color_attributes(body)
        ElementTree.SubElement(element, "geom", _VISUAL_GEOM | attributes)

    def _add_visuals(self, element: ElementTree.Element, body: Body) -> None:
        """Visual geoms of the body's geometry."""
        geometry = self._geometry_with_visuals(body)
        if self.visuals is None or geometry is None:
            return
        for attributes in self.visuals.geoms(element.attrib["name"], geometry, body.color):
            ElementTree.SubElement(element, "geom", _VISUAL_GEOM | attributes)

    def _geometry_with_visuals(self, body: Body) -> BodyGeometry | None:
        """The body's geometry, if visual meshes are written and it has some."""
        geometry = self.geometry.get(body.id) if self.visuals is not None else None
        return geometry if geometry is not None and geometry.visuals else None

    def _mesh_of(self, body: Body) -> MeshAsset | None:
        path = self.find_mesh(body.mesh) if body.mesh else None
        if path is None:
            return None
        if path not in self.mesh_cache:
            self.mesh_cache[path] = load_mesh(path)
            if self.mesh_cache[path] is None:
                self.notes.append(f"MuJoCo reads no mesh from {path}; its collision shapes are shown instead")
        return self.mesh_cache[path]

    # -- joints --------------------------------------------------------------------------------------------------------

    def _joint_names(self) -> dict[int, str]:
        names: dict[int, str] = {}
        taken: set[str] = set()
        for id, joint in self.compiled.joints.items():
            single = [axis for axis in joint.axes if axis.is_prismatic or not joint.is_ball]
            kinds = [AXIS_NAMES[axis.index] for axis in single] + (["ball"] if joint.is_ball else [])
            first = int(self.model.dof_jntid[joint.dof_address])
            for offset, kind in enumerate(kinds):
                base = _xml_text(id if len(kinds) == 1 else f"{id}:{kind}") or "joint"
                name, count = base, 2
                while name in taken:
                    name, count = f"{base}-{count}", count + 1
                taken.add(name)
                names[first + offset] = name
        return names

    def _add_joint(self, element: ElementTree.Element, joint: int, name: str | None) -> None:
        model = self.model
        kind = _JOINTS.get(int(model.jnt_type[joint]))
        if kind is None:
            ElementTree.SubElement(element, "freejoint")
            return
        dof = int(model.jnt_dofadr[joint])
        attributes = {"type": kind, "pos": _format_numbers(model.jnt_pos[joint])} | ({"name": name} if name else {})
        if kind != "ball":
            attributes["axis"] = _format_numbers(model.jnt_axis[joint])
        if model.jnt_limited[joint]:
            attributes |= {
                "limited": "true",
                "range": _format_numbers(model.jnt_range[joint]),
                "solreflimit": _format_numbers(model.jnt_solref[joint]),
                "solimplimit": _format_numbers(model.jnt_solimp[joint]),
            }
        attributes |= {
            "damping": _format_numbers([model.dof_damping[dof]]),
            "frictionloss": _format_numbers([model.dof_frictionloss[dof]]),
            "solreffriction": _format_numbers(model.dof_solref[dof]),
            "solimpfriction": _format_numbers(model.dof_solimp[dof]),
        }
        if model.dof_armature[dof]:
            attributes["armature"] = _format_numbers([model.dof_armature[dof]])
        ElementTree.SubElement(element, "joint", attributes)

    def _add_excludes(self) -> None:
        """Excluded contact pairs, and equalities that close loops."""
        model = self.model
        if model.nexclude:
            contact = ElementTree.SubElement(self.root, "contact")
            for signature in model.exclude_signature.tolist():
                first, second = self.names[signature >> 16], self.names[signature & 0xFFFF]
                ElementTree.SubElement(contact, "exclude", body1=first, body2=second)
        if model.neq:
            equality = ElementTree.SubElement(self.root, "equality")
            joints = self._joint_names()
            for number in range(model.neq):
                if model.eq_type[number] == mujoco.mjtEq.mjEQ_JOINT:
                    follower, master = (
                        {"joint1": joints[int(model.eq_obj1id[number])]},
                        {"joint2": joints[int(model.eq_obj2id[number])]},
                    )
                    attributes = {
                        "polycoef": _format_numbers(model.eq_data[number][:5]),
                        "solref": _format_numbers(model.eq_solref[number]),
                    }
                    ElementTree.SubElement(equality, "joint", follower | master | attributes)
                    continue
                ends = {
                    "body1": self.names[int(model.eq_obj1id[number])],
                    "body2": self.names[int(model.eq_obj2id[number])],
                }
                data = model.eq_data[number]
                if model.eq_type[number] == mujoco.mjtEq.mjEQ_WELD:
                    attributes = {
                        "anchor": _format_numbers(data[:3]),
                        "relpose": _format_numbers(data[3:10]),
                        "torquescale": _format_numbers(data[10:11]),
                    }
                    ElementTree.SubElement(equality, "weld", ends | attributes)
                else:
                    ElementTree.SubElement(equality, "connect", ends | {"anchor": _format_numbers(data[:3])})


def _light(light: Light) -> Iterator[tuple[str, str]]:
    row = normalized_pose_array(light.pose)
    yield "name", _xml_text(light.id)
    yield "pos", _format_numbers(row[:3])
    if light.type is not LightType.POINT:
        yield "dir", _format_numbers(quat_rotate(row[3:], np.array([0.0, 0.0, -1.0])))
    yield "directional", str(light.type is LightType.DIRECTIONAL).lower()
    yield "cutoff", "180" if light.type is LightType.POINT else "45"
    yield "diffuse", format_color(*light.color)


def _format_numbers(numbers: Iterable[float]) -> str:
    """Numbers with all their digits."""
    return " ".join(repr(float(number) if abs(number) > _MIN_NUMBER else 0.0) for number in numbers)


def _xml_text(text: str | BodyId) -> str:
    """The text without characters that XML forbids."""
    return _FORBIDDEN_CHARACTERS.sub("", text)
