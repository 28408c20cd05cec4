"""Writes docs/reference/shapes.md and its images: the shape of every physical class of the bundled ontology.

With --check the page is only compared. An image shows the geometry that a body of the class gets in a world, in the
typical size stated by the ontology, otherwise in the usual size of the shape.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import msgspec
from drawing.contact_sheet import save_sheet
from drawing.renderer import Renderer
from generated import is_check, write_or_compare
from PIL import Image
from pyoxigraph import NamedNode

from mindstage.geometry import SHAPE_TEMPLATES, ShapeTemplate
from mindstage.geometry.fit import fit_geometry
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import Body, BodyGeometry, BodyId, Iri, PbrMaterial, Pose, Vector, World

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGE = DOCS / "reference" / "shapes.md"
PICTURES = DOCS / "images" / "shapes"
PIXELS = 108
LOCALIZED_THING = Iri("http://knowrob.org/kb/knowrob.owl#EnduringThing-Localized")
"""Superclass of the classes that a body in a map can have."""
CUBE = Iri("http://knowrob.org/kb/knowrob.owl#Cube")
FAR_POSE = Pose((100.0, 0.0, 0.0))
"""The pose of a second body: too far away to influence the shape, but it determines the front of furniture."""

SIZE_BY_SHAPE_M: Mapping[str, Vector] = {
    "appliance": (0.5, 0.55, 0.6),
    "bag": (0.08, 0.12, 0.2),
    "book": (0.16, 0.04, 0.23),
    "bottle": (0.08, 0.08, 0.28),
    "bowl": (0.2, 0.2, 0.09),
    "case": (0.5, 0.6, 0.8),
    "chair": (0.45, 0.45, 0.9),
    "clock": (0.04, 0.3, 0.3),
    "counter": (0.6, 1.6, 0.9),
    "cushion": (0.12, 0.16, 0.06),
    "cutlery": (0.2, 0.04, 0.02),
    "door": (0.04, 0.6, 0.9),
    "drawer": (0.5, 0.5, 0.2),
    "figure": (0.35, 0.55, 1.75),
    "frame": (0.1, 0.8, 1.1),
    "handle": (0.04, 0.16, 0.014),
    "hob": (0.51, 0.58, 0.03),
    "hood": (0.5, 0.6, 0.45),
    "knob": (0.03, 0.04, 0.04),
    "lamp": (0.4, 0.4, 0.1),
    "leg": (0.06, 0.06, 0.7),
    "lever": (0.05, 0.12, 0.03),
    "lid": (0.2, 0.2, 0.05),
    "panel": (0.02, 0.4, 0.6),
    "picture": (0.02, 0.7, 0.5),
    "plant": (0.3, 0.3, 0.4),
    "rack": (0.42, 0.49, 0.13),
    "radiator": (0.1, 1.0, 0.6),
    "shelf": (0.22, 0.9, 0.12),
    "shell": (3.0, 4.0, 2.4),
    "sink": (0.5, 0.8, 0.2),
    "table": (0.8, 1.3, 0.74),
    "tap": (0.2, 0.08, 0.3),
    "towel": (0.2, 0.25, 0.05),
    "wall": (0.1, 3.0, 2.4),
    "window": (0.06, 0.9, 1.1),
    "cylinder": (0.1, 0.1, 0.05),
}
"""Sizes for classes without a typical size [m]."""
SIZE_BY_LAMP_STYLE_M: Mapping[str, Vector] = {
    "pendant": (0.35, 0.35, 0.4),
    "floor": (0.4, 0.4, 1.6),
    "table": (0.3, 0.3, 0.5),
    "bulb": (0.06, 0.06, 0.11),
    "tube": (0.04, 1.2, 0.04),
    "candle": (0.07, 0.07, 0.14),
    "torch": (0.18, 0.05, 0.05),
}
FLAT_SIZE_M: Vector = (0.5, 0.8, 0.03)
FLAT_SUFFIXES = (
    "Ceiling",
    "Floor",
    "FridgeShelf",
    "FridgeShelfGlas",
    "Bars",
    "OvenRack",
    "Sill",
    "RefrigeratorShelf",
    "WallShelf",
)
"""Suffixes of the names of classes of horizontal boards."""
DEFAULT_SIZE_M: Vector = (0.2, 0.24, 0.18)

HEAD = """# Shapes

<!-- Written by scripts/make_shapes.py: change the ontology, or the classes in src/mindstage/geometry/procedural. -->

A map gives the size and class of a body; its geometry follows from the class. Annotations in the ontology give the
**kind** of shape of a class, its materials, and the parameters of the kind; each is inherited by subclasses. One
statement defines the shape of a class, in any ontology that is loaded with the map:

```turtle
my:CutleryTray ms:shapedAs knowrob:Drawer ; ms:wall 0.006 .
```

A shape fits the size of its body exactly. Its visual meshes are closed, with normals facing outwards; its collision
shapes are a few convex parts (boxes, cylinders, hulls) that leave cavities free, so that a mug can be placed in a
drawer. Front, top and openings are inferred from the map: the positions of doors and drawers, and the directions in
which joints open. A body that is too small for its parts becomes a plain box, which its geometry states; so does a
body of an unknown class, unless a word in the name of its class is that of a known class.
[Give bodies geometry and place objects](../how-to/furnishing.md) has the details.

A shape in Python, without a map:

```python
from mindstage.geometry import build_geometry, template_by_name

geometry = build_geometry(template_by_name("drawer", {"wall": 0.01}), (0.5, 0.6, 0.2))
print(len(geometry.visuals), len(geometry.collision_shapes), geometry.support_surfaces[0].size)
```

Below are all kinds, each with its parameters (lengths in meters, with default values), its material roles, and every
class of the bundled ontology that has the shape.
"""


class Sample(NamedTuple):
    """A class and the geometry of its bodies."""

    class_name: str
    geometry: BodyGeometry


def main() -> int:
    """Writes or checks the page; returns 0, or 1 if it is out of date."""
    knowledge = KnowledgeBase()
    samples = all_samples(knowledge)
    text = "\n".join([HEAD, *(line for module in modules() for line in chapter(module, samples))])
    if not is_check():
        for module in modules():
            draw(module, samples)
    return write_or_compare({PAGE: text})


def all_samples(knowledge: KnowledgeBase) -> list[Sample]:
    """Returns all physical classes with their geometry, sorted by shape and name."""
    shape_names = list(SHAPE_TEMPLATES)
    samples = [sample(knowledge, body(knowledge, cls)) for cls in physical_classes(knowledge)]
    return sorted(samples, key=lambda each: (shape_names.index(each.geometry.shape_name), each.class_name.lower()))


def sample(knowledge: KnowledgeBase, body: Body) -> Sample:
    """Returns the geometry of a single body that faces the center of the scene."""
    far = Body(id=BodyId("far"), iri=Iri("urn:shapes:far"), cls=CUBE, pose=FAR_POSE, size=DEFAULT_SIZE_M)
    fitted = fit_geometry(World(iri=Iri("urn:shapes:all"), name="shapes", bodies=(body, far)), knowledge)
    return Sample(body.id, fitted.geometry[body.id])


def physical_classes(knowledge: KnowledgeBase) -> list[Iri]:
    """Returns the classes that a body in a map can have."""
    type_ = NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")
    quads = knowledge.store.quads_for_pattern(None, type_, NamedNode("http://www.w3.org/2002/07/owl#Class"))
    named = {Iri(quad.subject.value) for quad in quads if isinstance(quad.subject, NamedNode)}
    return sorted(cls for cls in named if knowledge.is_a(cls, LOCALIZED_THING))


def body(knowledge: KnowledgeBase, cls: Iri) -> Body:
    """Returns a body of a class, in its typical or default size."""
    rule = knowledge.shape_rule(cls)
    name = cls.rpartition("#")[2]
    default = FLAT_SIZE_M if name.endswith(FLAT_SUFFIXES) else SIZE_BY_SHAPE_M.get(rule.shape_type, DEFAULT_SIZE_M)
    if style := rule.parameters.get("style"):
        default = SIZE_BY_LAMP_STYLE_M.get(str(style), default)
    return Body(id=BodyId(name), iri=Iri(f"urn:shapes:{name}"), cls=cls, pose=Pose(), size=rule.size or default)


# -- the page ----------------------------------------------------------------------------------------------------------


def modules() -> list[ModuleType]:
    """Returns the modules of shape templates, in the order of `SHAPE_TEMPLATES`."""
    found = [inspect.getmodule(template) for template in SHAPE_TEMPLATES.values()]
    return list(dict.fromkeys(module for module in found if module is not None))


def chapter(module: ModuleType, samples: list[Sample]) -> Iterator[str]:
    """Yields the shapes of one module, and the image of all classes that have them."""
    title, _, text = (module.__doc__ or "").partition("\n")[0].partition(": ")
    yield from (f"## {title}", "", f"{text[:1].upper()}{text[1:]}", "")
    here = [template for template in SHAPE_TEMPLATES.values() if inspect.getmodule(template) is module]
    for template in here:
        yield from section(template)
    own = [each for each in samples if SHAPE_TEMPLATES[each.geometry.shape_name] in here]
    if own:
        yield from ("", f"![{title}](../images/shapes/{short_name(module)}.png)", "")
    for template in here:
        if classes := [each.class_name for each in own if each.geometry.shape_name == template.shape_name()]:
            yield f"- as a {template.shape_name()}: {', '.join(classes)}"
    yield ""


def section(template: type[ShapeTemplate]) -> Iterator[str]:
    """Yields the description, the parameters and the material roles of one shape."""
    parameters = ", ".join(
        f"`{field.name}` {default_text(field.default)}" for field in msgspec.structs.fields(template)
    )
    roles = ", ".join(f"`{role}`{material_text(material)}" for role, material in template.roles.items())
    yield f"- **{template.shape_name()}**. {(inspect.getdoc(template) or '').splitlines()[0]}"
    yield f"  {f'Parameters: {parameters}. ' if parameters else ''}Roles: {roles}."


def default_text(value: Any) -> str:
    """Returns a default value as text."""
    match value:
        case None:
            return "(none)"
        case bool():
            return "yes" if value else "no"
        case ():
            return "(none)"
        case float() | int():
            return f"{value:g}"
    return str(getattr(value, "value", value))


def material_text(material: PbrMaterial | str) -> str:
    """Returns the default material of a role as text."""
    return f" (as {material})" if isinstance(material, str) else f" ({material.name})" if material.name else ""


def short_name(module: ModuleType) -> str:
    """Returns the last part of the name of a module."""
    return module.__name__.rpartition(".")[2]


def draw(module: ModuleType, samples: list[Sample]) -> None:
    """Writes the contact sheet of the shapes of a module; equal geometries are rendered once."""
    renderer = Renderer(pixels=PIXELS)
    images: dict[str, Image.Image] = {}
    pictures = []
    for each in samples:
        if inspect.getmodule(SHAPE_TEMPLATES[each.geometry.shape_name]) is module:
            if each.geometry.key not in images:
                images[each.geometry.key] = renderer.image(each.geometry)
            pictures.append((each.class_name, images[each.geometry.key]))
    if pictures:
        save_sheet(PICTURES / f"{short_name(module)}.png", pictures, background=renderer.background)


if __name__ == "__main__":
    sys.exit(main())
