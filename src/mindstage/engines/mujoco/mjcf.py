"""Export: a world as a model file of MuJoCo's (MJCF), which simulates as it does in here.

Written from the compiled model and not by MuJoCo itself, which writes six digits. Each body is a body of its own, each
constraint a joint of its own name; what a body is (its class) stands among the file's texts.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np

from mindstage.engines.base import SpawnNoteKind
from mindstage.engines.kinematic_tree import AXIS_NAMES
from mindstage.engines.mujoco.compiler import TriangleMesh, compile_model, load_mesh
from mindstage.engines.mujoco.engine import ModelCache
from mindstage.engines.mujoco.state import CompiledModel
from mindstage.errors import MapWriteError
from mindstage.scene import NO_GEOMETRY, Body, BodyId, GeometryMap, Joint, Light, LightType, World
from mindstage.scene.transforms import normalized_pose_array, quat_rotate

__all__ = ["MjcfExport", "world_to_mjcf"]

_MAX_DEPTH = 400
"""Bodies within bodies that MuJoCo's parser of XML follows."""
_GEOMS = {
    int(mujoco.mjtGeom.mjGEOM_BOX): ("box", 3),
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
"""What is nearer to 0 is 0; MuJoCo refuses smaller numbers."""
_SEEN, _FELT = "1", "3"
"""Groups of geometry: MuJoCo's viewer shows the first and hides the other."""


class MjcfExport(NamedTuple):
    """A model file, and what it does not say."""

    text: str
    notes: tuple[str, ...]


def world_to_mjcf(
    world: World, *, geometry: GeometryMap = NO_GEOMETRY, find_mesh: Callable[[str], Path | None] = lambda name: None
) -> MjcfExport:
    """A world as MJCF.

    Args:
        world: what is written.
        forms: what its bodies are made of; what of them can be touched is in the file, hulls as points.
        find_mesh: the file that a body's mesh is, if it is at hand; such a file is named in the model, not copied.

    Raises:
        MapWriteError: MuJoCo could not read what would come of it.
        EngineUnavailableError: MuJoCo cannot compile the world.
    """
    keeper = ModelCache(0.002)
    report = keeper.add(world, geometry=geometry)
    failures = (*report.failed_bodies, *report.failed_joints, *report.failed_attachments)
    document = _Document(
        world, compile_model(replace(keeper.model_input(), kinematics_driven=True), scenery=False), find_mesh, geometry
    )
    document.write()
    notes = [f"{failure.id} is not in it: {failure.reason}" for failure in failures]
    notes += [note.text for note in report.notes if note.kind is SpawnNoteKind.JOINT]
    return MjcfExport(document.text(), (*notes, *document.notes))


class _Document:
    def __init__(
        self, world: World, compiled: CompiledModel, find_mesh: Callable[[str], Path | None], geometry: GeometryMap
    ) -> None:
        self.world, self.compiled, self.find_mesh, self.geometry = world, compiled, find_mesh, geometry
        self.model: Any = compiled.model
        self.bodies: dict[int, Body] = {}
        by_id = {body.id: body for body in world.bodies}
        for id, number in compiled.body_ids.items():
            self.bodies[number] = by_id[id]
        self.notes: list[str] = []
        self.root = ElementTree.Element("mujoco", model=_xml_text(world.name) or "world")
        self.assets = ElementTree.Element("asset")
        self.meshes: dict[tuple[Path, tuple[float, ...]], str] = {}
        self.mesh_cache: dict[Path, TriangleMesh | None] = {}
        self.names = self._names()

    def text(self) -> str:
        """The file."""
        ElementTree.indent(self.root)
        return ElementTree.tostring(self.root, encoding="unicode") + "\n"

    def write(self) -> None:
        """Fills the document."""
        ElementTree.SubElement(self.root, "compiler", angle="radian")
        timestep = repr(float(self.model.opt.timestep))
        option = {"timestep": timestep, "integrator": "implicitfast", "cone": "elliptic", "impratio": "10"}
        ElementTree.SubElement(self.root, "option", option)
        self._add_custom_texts()
        self.root.append(self.assets)
        self._add_hull_meshes()
        self._add_bodies()
        self._add_excludes()
        if not len(self.assets):
            self.root.remove(self.assets)
        self._add_omission_notes()

    # -- names ---------------------------------------------------------------------------------------------------------

    def _names(self) -> dict[int, str]:
        """What each of MuJoCo's bodies is called: as in the world, unless MuJoCo or XML has something against it."""
        names: dict[int, str] = {0: "world"}
        taken = {"world"}
        for number in range(1, self.model.nbody):
            body = self.bodies.get(number)
            wanted = _xml_text(body.id if body else self.model.body(number).name) or "body"
            name, count = wanted, 2
            while name in taken:
                name, count = f"{wanted}-{count}", count + 1
            if body and name != body.id:
                self.notes.append(f"{body.id!r} is called {name!r}")
            names[number] = name
            taken.add(name)
        return names

    def _add_custom_texts(self) -> None:
        custom = ElementTree.SubElement(self.root, "custom")
        ElementTree.SubElement(custom, "text", name="map", data=_xml_text(self.world.iri))
        for number, body in self.bodies.items():
            ElementTree.SubElement(custom, "text", name=f"class of {self.names[number]}", data=_xml_text(body.cls))

    def _add_omission_notes(self) -> None:
        """What there is no place for."""
        world = self.world
        things: list[Body | Joint | Light] = [*world.bodies, *world.joints, *world.lights]
        facts = sum(len(thing.facts) for thing in things) + len(world.resources) + len(world.facts)
        tags = sum(len(thing.tags) for thing in things)
        if facts or tags:
            self.notes.append(f"MJCF has no place for {facts} facts and resources and {tags} tags; they are left out")

    # -- bodies --------------------------------------------------------------------------------------------------------

    def _add_bodies(self) -> None:
        model = self.model
        worldbody = ElementTree.SubElement(self.root, "worldbody")
        for light in self.world.lights:
            ElementTree.SubElement(worldbody, "light", dict(_light(light)))
        elements, depths = {0: worldbody}, {0: 0}
        for number in range(1, model.nbody):
            parent = int(model.body_parentid[number])
            depths[number] = depths[parent] + 1
            if depths[number] > _MAX_DEPTH:
                cause = f"more than {_MAX_DEPTH} bodies hang one on another, at {self.names[number]!r}"
                raise MapWriteError(self.world.name, cause=cause, remedy="glTF (.glb) has no such bounds")
            elements[number] = self._add_body(elements[parent], number)
        joints = self._joint_names()
        for joint in range(model.njnt):
            self._add_joint(elements[int(model.jnt_bodyid[joint])], joint, joints.get(joint))
        for geom in range(model.ngeom):
            self._add_geom(elements[int(model.geom_bodyid[geom])], geom)
        for number, body in self.bodies.items():
            self._add_visual_mesh(elements[number], body)

    def _add_body(self, parent: ElementTree.Element, number: int) -> ElementTree.Element:
        model = self.model
        told = {
            "name": self.names[number],
            "pos": _format_numbers(model.body_pos[number]),
            "quat": _format_numbers(model.body_quat[number]),
        }
        if model.body_mocapid[number] >= 0:
            told["mocap"] = "true"
        if model.body_gravcomp[number]:
            told["gravcomp"] = _format_numbers([model.body_gravcomp[number]])
        element = ElementTree.SubElement(parent, "body", told)
        if model.body_mass[number] > 0.0:
            inertia = {
                "pos": _format_numbers(model.body_ipos[number]),
                "quat": _format_numbers(model.body_iquat[number]),
                "mass": _format_numbers([model.body_mass[number]]),
                "diaginertia": _format_numbers(model.body_inertia[number]),
            }
            ElementTree.SubElement(element, "inertial", inertia)
        return element

    def _add_geom(self, element: ElementTree.Element, geom: int) -> None:
        model = self.model
        told = {
            "pos": _format_numbers(model.geom_pos[geom]),
            "quat": _format_numbers(model.geom_quat[geom]),
            "mass": "0",
        }
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            told |= {"type": "mesh", "mesh": model.mesh(int(model.geom_dataid[geom])).name}
        else:
            kind, count = _GEOMS[int(model.geom_type[geom])]
            told |= {"type": kind, "size": _format_numbers(model.geom_size[geom][:count])}
        told |= {"contype": str(model.geom_contype[geom]), "conaffinity": str(model.geom_conaffinity[geom])}
        if model.geom_contype[geom]:
            told |= {
                "friction": _format_numbers(model.geom_friction[geom]),
                "priority": str(int(model.geom_priority[geom])),
                "solref": _format_numbers(model.geom_solref[geom]),
                "margin": _format_numbers([model.geom_margin[geom]]),
            }
        body = self.bodies.get(int(model.geom_bodyid[geom]))
        if body and self._mesh_of(body):
            told["group"] = _FELT
        ElementTree.SubElement(element, "geom", told | self._color_attributes(body))

    def _add_hull_meshes(self) -> None:
        """The corners of what is neither box nor round; MuJoCo makes the hull."""
        model = self.model
        for number in range(model.nmesh):
            first, count = int(model.mesh_vertadr[number]), int(model.mesh_vertnum[number])
            corners = model.mesh_vert[first : first + count].reshape(-1)
            ElementTree.SubElement(self.assets, "mesh", name=model.mesh(number).name, vertex=_format_numbers(corners))

    def _color_attributes(self, body: Body | None) -> dict[str, str]:
        """The body's own color, else that of its form's first skin."""
        color = next((material.color for material in body.materials if material.color), None) if body else None
        if color is not None:
            return {"rgba": _format_color(*color, 1.0)}
        form = self.geometry.get(body.id) if body else None
        if form is None or not form.visuals:
            return {}
        surface = form.visuals[0].material
        return {"rgba": _format_color(*surface.color, surface.opacity)}

    def _add_visual_mesh(self, element: ElementTree.Element, body: Body) -> None:
        mesh = self._mesh_of(body)
        if mesh is None:
            return
        scale = mesh.scale_to(body.size)
        name = self.meshes.get((mesh.path, scale))
        if name is None:
            name = self.meshes[mesh.path, scale] = f"{_xml_text(mesh.path.stem)}-{len(self.meshes) + 1}"
            told = {"name": name, "file": str(mesh.path), "scale": _format_numbers(scale), "inertia": "shell"}
            ElementTree.SubElement(self.assets, "mesh", told)
        look = {"type": "mesh", "mesh": name, "mass": "0", "contype": "0", "conaffinity": "0", "group": _SEEN}
        ElementTree.SubElement(element, "geom", look | self._color_attributes(body))

    def _mesh_of(self, body: Body) -> TriangleMesh | None:
        path = self.find_mesh(body.mesh) if body.mesh else None
        if path is None:
            return None
        if path not in self.mesh_cache:
            self.mesh_cache[path] = load_mesh(path)
            if self.mesh_cache[path] is None:
                self.notes.append(f"MuJoCo reads no mesh from {path}; boxes and the like stand for it")
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
                wanted = _xml_text(id if len(kinds) == 1 else f"{id}:{kind}") or "joint"
                name, count = wanted, 2
                while name in taken:
                    name, count = f"{wanted}-{count}", count + 1
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
        told = {"type": kind, "pos": _format_numbers(model.jnt_pos[joint])} | ({"name": name} if name else {})
        if kind != "ball":
            told["axis"] = _format_numbers(model.jnt_axis[joint])
        if model.jnt_limited[joint]:
            told |= {
                "limited": "true",
                "range": _format_numbers(model.jnt_range[joint]),
                "solreflimit": _format_numbers(model.jnt_solref[joint]),
                "solimplimit": _format_numbers(model.jnt_solimp[joint]),
            }
        told |= {
            "damping": _format_numbers([model.dof_damping[dof]]),
            "frictionloss": _format_numbers([model.dof_frictionloss[dof]]),
            "solreffriction": _format_numbers(model.dof_solref[dof]),
            "solimpfriction": _format_numbers(model.dof_solimp[dof]),
        }
        ElementTree.SubElement(element, "joint", told)

    def _add_excludes(self) -> None:
        """Who never collides with whom, and what closes loops."""
        model = self.model
        if model.nexclude:
            contact = ElementTree.SubElement(self.root, "contact")
            for signature in model.exclude_signature.tolist():
                one, other = self.names[signature >> 16], self.names[signature & 0xFFFF]
                ElementTree.SubElement(contact, "exclude", body1=one, body2=other)
        if model.neq:
            equality = ElementTree.SubElement(self.root, "equality")
            for number in range(model.neq):
                ends = {
                    "body1": self.names[int(model.eq_obj1id[number])],
                    "body2": self.names[int(model.eq_obj2id[number])],
                }
                data = model.eq_data[number]
                if model.eq_type[number] == mujoco.mjtEq.mjEQ_WELD:
                    told = {
                        "anchor": _format_numbers(data[:3]),
                        "relpose": _format_numbers(data[3:10]),
                        "torquescale": _format_numbers(data[10:11]),
                    }
                    ElementTree.SubElement(equality, "weld", ends | told)
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
    yield "diffuse", _format_color(*light.color)


def _format_numbers(numbers: Iterable[float]) -> str:
    """Numbers with all their digits."""
    return " ".join(repr(float(number) if abs(number) > _MIN_NUMBER else 0.0) for number in numbers)


def _format_color(*parts: float) -> str:
    """A color, of which MuJoCo keeps single precision only, and refuses what that has no number for."""
    return " ".join(f"{part:.7f}" for part in parts)


def _xml_text(text: str | BodyId) -> str:
    """A text without the letters that XML forbids."""
    return _FORBIDDEN_CHARACTERS.sub("", text)
