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

from mindstage.engines.contract import NoteKind
from mindstage.engines.joints import AXES
from mindstage.engines.mujoco.build import build
from mindstage.engines.mujoco.live import Live
from mindstage.engines.mujoco.meshes import Mesh, load_mesh
from mindstage.engines.mujoco.scene import SceneKeeper
from mindstage.errors import MapUnwritable
from mindstage.world import NO_FORMS, Body, BodyId, Constraint, Forms, Light, LightKind, World
from mindstage.world.geometry import rotate, unit_pose

__all__ = ["Mjcf", "mjcf"]

_DEEPEST = 400
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
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_LEAST = 2.3e-308
"""What is nearer to 0 is 0; MuJoCo refuses smaller numbers."""
_SEEN, _FELT = "1", "3"
"""Groups of geometry: MuJoCo's viewer shows the first and hides the other."""


class Mjcf(NamedTuple):
    """A model file, and what it does not say."""

    text: str
    notes: tuple[str, ...]


def mjcf(world: World, *, forms: Forms = NO_FORMS, find_mesh: Callable[[str], Path | None] = lambda name: None) -> Mjcf:
    """A world as MJCF.

    Args:
        world: what is written.
        forms: what its bodies are made of; what of them can be touched is in the file, hulls as points.
        find_mesh: the file that a body's mesh is, if it is at hand; such a file is named in the model, not copied.

    Raises:
        MapUnwritable: MuJoCo could not read what would come of it.
        EngineUnavailable: MuJoCo cannot compile the world.
    """
    keeper = SceneKeeper(0.002)
    report = keeper.add(world, forms=forms)
    failures = (*report.failed_bodies, *report.failed_constraints, *report.failed_attachments)
    document = _Document(world, build(replace(keeper.blueprint(), driven=True), scenery=False), find_mesh, forms)
    document.write()
    notes = [f"{failure.id} is not in it: {failure.reason}" for failure in failures]
    notes += [note.text for note in report.notes if note.kind is NoteKind.CONSTRAINT]
    return Mjcf(document.text(), (*notes, *document.notes))


class _Document:
    def __init__(self, world: World, live: Live, find_mesh: Callable[[str], Path | None], forms: Forms) -> None:
        self.world, self.live, self.find_mesh, self.forms = world, live, find_mesh, forms
        self.model: Any = live.model
        self.bodies: dict[int, Body] = {}
        by_id = {body.id: body for body in world.bodies}
        for id, number in live.numbers.items():
            self.bodies[number] = by_id[id]
        self.notes: list[str] = []
        self.root = ElementTree.Element("mujoco", model=_plain(world.name) or "world")
        self.assets = ElementTree.Element("asset")
        self.meshes: dict[tuple[Path, tuple[float, ...]], str] = {}
        self.measured: dict[Path, Mesh | None] = {}
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
        self._texts()
        self.root.append(self.assets)
        self._hulls()
        self._tree()
        self._pairs()
        if not len(self.assets):
            self.root.remove(self.assets)
        self._tell()

    # -- names ---------------------------------------------------------------------------------------------------------

    def _names(self) -> dict[int, str]:
        """What each of MuJoCo's bodies is called: as in the world, unless MuJoCo or XML has something against it."""
        names: dict[int, str] = {0: "world"}
        taken = {"world"}
        for number in range(1, self.model.nbody):
            body = self.bodies.get(number)
            wanted = _plain(body.id if body else self.model.body(number).name) or "body"
            name, count = wanted, 2
            while name in taken:
                name, count = f"{wanted}-{count}", count + 1
            if body and name != body.id:
                self.notes.append(f"{body.id!r} is called {name!r}")
            names[number] = name
            taken.add(name)
        return names

    def _texts(self) -> None:
        custom = ElementTree.SubElement(self.root, "custom")
        ElementTree.SubElement(custom, "text", name="map", data=_plain(self.world.iri))
        for number, body in self.bodies.items():
            ElementTree.SubElement(custom, "text", name=f"class of {self.names[number]}", data=_plain(body.cls))

    def _tell(self) -> None:
        """What there is no place for."""
        world = self.world
        things: list[Body | Constraint | Light] = [*world.bodies, *world.constraints, *world.lights]
        facts = sum(len(thing.facts) for thing in things) + len(world.resources) + len(world.facts)
        tags = sum(len(thing.tags) for thing in things)
        if facts or tags:
            self.notes.append(f"MJCF has no place for {facts} facts and resources and {tags} tags; they are left out")

    # -- bodies --------------------------------------------------------------------------------------------------------

    def _tree(self) -> None:
        model = self.model
        worldbody = ElementTree.SubElement(self.root, "worldbody")
        for light in self.world.lights:
            ElementTree.SubElement(worldbody, "light", dict(_light(light)))
        elements, depths = {0: worldbody}, {0: 0}
        for number in range(1, model.nbody):
            parent = int(model.body_parentid[number])
            depths[number] = depths[parent] + 1
            if depths[number] > _DEEPEST:
                cause = f"more than {_DEEPEST} bodies hang one on another, at {self.names[number]!r}"
                raise MapUnwritable(self.world.name, cause=cause, remedy="glTF (.glb) has no such bounds")
            elements[number] = self._body(elements[parent], number)
        joints = self._joint_names()
        for joint in range(model.njnt):
            self._joint(elements[int(model.jnt_bodyid[joint])], joint, joints.get(joint))
        for geom in range(model.ngeom):
            self._geom(elements[int(model.geom_bodyid[geom])], geom)
        for number, body in self.bodies.items():
            self._mesh(elements[number], body)

    def _body(self, parent: ElementTree.Element, number: int) -> ElementTree.Element:
        model = self.model
        told = {
            "name": self.names[number],
            "pos": _row(model.body_pos[number]),
            "quat": _row(model.body_quat[number]),
        }
        if model.body_mocapid[number] >= 0:
            told["mocap"] = "true"
        if model.body_gravcomp[number]:
            told["gravcomp"] = _row([model.body_gravcomp[number]])
        element = ElementTree.SubElement(parent, "body", told)
        if model.body_mass[number] > 0.0:
            inertia = {
                "pos": _row(model.body_ipos[number]),
                "quat": _row(model.body_iquat[number]),
                "mass": _row([model.body_mass[number]]),
                "diaginertia": _row(model.body_inertia[number]),
            }
            ElementTree.SubElement(element, "inertial", inertia)
        return element

    def _geom(self, element: ElementTree.Element, geom: int) -> None:
        model = self.model
        told = {"pos": _row(model.geom_pos[geom]), "quat": _row(model.geom_quat[geom]), "mass": "0"}
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            told |= {"type": "mesh", "mesh": model.mesh(int(model.geom_dataid[geom])).name}
        else:
            kind, count = _GEOMS[int(model.geom_type[geom])]
            told |= {"type": kind, "size": _row(model.geom_size[geom][:count])}
        told |= {"contype": str(model.geom_contype[geom]), "conaffinity": str(model.geom_conaffinity[geom])}
        if model.geom_contype[geom]:
            told |= {
                "friction": _row(model.geom_friction[geom]),
                "priority": str(int(model.geom_priority[geom])),
                "solref": _row(model.geom_solref[geom]),
                "margin": _row([model.geom_margin[geom]]),
            }
        body = self.bodies.get(int(model.geom_bodyid[geom]))
        if body and self._mesh_of(body):
            told["group"] = _FELT
        ElementTree.SubElement(element, "geom", told | self._colour(body))

    def _hulls(self) -> None:
        """The corners of what is neither box nor round; MuJoCo makes the hull."""
        model = self.model
        for number in range(model.nmesh):
            first, count = int(model.mesh_vertadr[number]), int(model.mesh_vertnum[number])
            corners = model.mesh_vert[first : first + count].reshape(-1)
            ElementTree.SubElement(self.assets, "mesh", name=model.mesh(number).name, vertex=_row(corners))

    def _colour(self, body: Body | None) -> dict[str, str]:
        """The body's own colour, else that of its form's first skin."""
        colour = next((material.colour for material in body.materials if material.colour), None) if body else None
        if colour is not None:
            return {"rgba": _shade(*colour, 1.0)}
        form = self.forms.get(body.id) if body else None
        if form is None or not form.skins:
            return {}
        surface = form.skins[0].surface
        return {"rgba": _shade(*surface.colour, surface.opacity)}

    def _mesh(self, element: ElementTree.Element, body: Body) -> None:
        mesh = self._mesh_of(body)
        if mesh is None:
            return
        scale = mesh.scale_to(body.size)
        name = self.meshes.get((mesh.path, scale))
        if name is None:
            name = self.meshes[mesh.path, scale] = f"{_plain(mesh.path.stem)}-{len(self.meshes) + 1}"
            told = {"name": name, "file": str(mesh.path), "scale": _row(scale), "inertia": "shell"}
            ElementTree.SubElement(self.assets, "mesh", told)
        look = {"type": "mesh", "mesh": name, "mass": "0", "contype": "0", "conaffinity": "0", "group": _SEEN}
        ElementTree.SubElement(element, "geom", look | self._colour(body))

    def _mesh_of(self, body: Body) -> Mesh | None:
        path = self.find_mesh(body.mesh) if body.mesh else None
        if path is None:
            return None
        if path not in self.measured:
            self.measured[path] = load_mesh(path)
            if self.measured[path] is None:
                self.notes.append(f"MuJoCo reads no mesh from {path}; boxes and the like stand for it")
        return self.measured[path]

    # -- joints --------------------------------------------------------------------------------------------------------

    def _joint_names(self) -> dict[int, str]:
        names: dict[int, str] = {}
        taken: set[str] = set()
        for id, joint in self.live.joints.items():
            single = [axis for axis in joint.axes if axis.slides or not joint.ball]
            kinds = [AXES[axis.index] for axis in single] + (["ball"] if joint.ball else [])
            first = int(self.model.dof_jntid[joint.velocity])
            for offset, kind in enumerate(kinds):
                wanted = _plain(id if len(kinds) == 1 else f"{id}:{kind}") or "joint"
                name, count = wanted, 2
                while name in taken:
                    name, count = f"{wanted}-{count}", count + 1
                taken.add(name)
                names[first + offset] = name
        return names

    def _joint(self, element: ElementTree.Element, joint: int, name: str | None) -> None:
        model = self.model
        kind = _JOINTS.get(int(model.jnt_type[joint]))
        if kind is None:
            ElementTree.SubElement(element, "freejoint")
            return
        dof = int(model.jnt_dofadr[joint])
        told = {"type": kind, "pos": _row(model.jnt_pos[joint])} | ({"name": name} if name else {})
        if kind != "ball":
            told["axis"] = _row(model.jnt_axis[joint])
        if model.jnt_limited[joint]:
            told |= {
                "limited": "true",
                "range": _row(model.jnt_range[joint]),
                "solreflimit": _row(model.jnt_solref[joint]),
                "solimplimit": _row(model.jnt_solimp[joint]),
            }
        told |= {
            "damping": _row([model.dof_damping[dof]]),
            "frictionloss": _row([model.dof_frictionloss[dof]]),
            "solreffriction": _row(model.dof_solref[dof]),
            "solimpfriction": _row(model.dof_solimp[dof]),
        }
        ElementTree.SubElement(element, "joint", told)

    def _pairs(self) -> None:
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
                    told = {"anchor": _row(data[:3]), "relpose": _row(data[3:10]), "torquescale": _row(data[10:11])}
                    ElementTree.SubElement(equality, "weld", ends | told)
                else:
                    ElementTree.SubElement(equality, "connect", ends | {"anchor": _row(data[:3])})


def _light(light: Light) -> Iterator[tuple[str, str]]:
    row = unit_pose(light.pose)
    yield "name", _plain(light.id)
    yield "pos", _row(row[:3])
    if light.kind is not LightKind.POINT:
        yield "dir", _row(rotate(row[3:], np.array([0.0, 0.0, -1.0])))
    yield "directional", str(light.kind is LightKind.DIRECTIONAL).lower()
    yield "cutoff", "180" if light.kind is LightKind.POINT else "45"
    yield "diffuse", _shade(*light.colour)


def _row(numbers: Iterable[float]) -> str:
    """Numbers with all their digits."""
    return " ".join(repr(float(number) if abs(number) > _LEAST else 0.0) for number in numbers)


def _shade(*parts: float) -> str:
    """A colour, of which MuJoCo keeps single precision only, and refuses what that has no number for."""
    return " ".join(f"{part:.7f}" for part in parts)


def _plain(text: str | BodyId) -> str:
    """A text without the letters that XML forbids."""
    return _FORBIDDEN.sub("", text)
