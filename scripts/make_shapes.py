"""Writes docs/reference/shapes.md and its images: the shape of every physical class of the bundled ontology.

With --check the page is only compared. An image shows the geometry that a body of the class gets in a world, in the
typical size stated by the ontology, otherwise in the usual size of the shape.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator, Mapping
from itertools import groupby
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import msgspec
from drawing.painter import Painter
from drawing.sheet import save_sheet
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
THING = Iri("http://knowrob.org/kb/knowrob.owl#EnduringThing-Localized")
"""What a map may hold; the classes above it are abstract."""
CUBE = Iri("http://knowrob.org/kb/knowrob.owl#Cube")
THERE = Pose((100.0, 0.0, 0.0))
"""Too far away for anything to fit itself to it, but where furniture turns its front to."""

# The sizes of shapes whose classes have no typical one [m].
USUAL_M: Mapping[str, Vector] = {
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
LAMPS_M: Mapping[str, Vector] = {
    "pendant": (0.35, 0.35, 0.4),
    "floor": (0.4, 0.4, 1.6),
    "table": (0.3, 0.3, 0.5),
    "bulb": (0.06, 0.06, 0.11),
    "tube": (0.04, 1.2, 0.04),
    "candle": (0.07, 0.07, 0.14),
    "torch": (0.18, 0.05, 0.05),
}
FLAT_M: Vector = (0.5, 0.8, 0.03)
FLAT = (
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
"""Ends of the names of classes whose things lie."""
ELSE_M: Vector = (0.2, 0.24, 0.18)

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


class Seen(NamedTuple):
    """A class and what its things look like."""

    name: str
    form: BodyGeometry


def main() -> int:
    """Writes or checks the page; 0 when all is well, 1 when it is stale."""
    knowledge = KnowledgeBase()
    seen = all_seen(knowledge)
    text = "\n".join([HEAD, *(line for module in modules() for line in chapter(module, seen))])
    if "--check" in sys.argv[1:]:
        if PAGE.is_file() and PAGE.read_text(encoding="utf-8") == text:
            return 0
        print(f"{PAGE} is out of date: run scripts/make_shapes.py", file=sys.stderr)
        return 1
    for module in modules():
        draw(module, seen)
    PAGE.write_text(text, encoding="utf-8")
    return 0


def all_seen(knowledge: KnowledgeBase) -> list[Seen]:
    """Every class that a map may hold, with the form of a body of it, kind by kind."""
    kinds = list(SHAPE_TEMPLATES)
    seen = [look(knowledge, body(knowledge, cls)) for cls in physical(knowledge)]
    return sorted(seen, key=lambda one: (kinds.index(one.form.shape_name), one.name.lower()))


def look(knowledge: KnowledgeBase, body: Body) -> Seen:
    """What a body gets that stands by itself, its face towards the middle of the place."""
    there = Body(id=BodyId("there"), iri=Iri("urn:shapes:there"), cls=CUBE, pose=THERE, size=ELSE_M)
    fitted = fit_geometry(World(iri=Iri("urn:shapes:all"), name="shapes", bodies=(body, there)), knowledge)
    return Seen(body.id, fitted.geometry[body.id])


def physical(knowledge: KnowledgeBase) -> list[Iri]:
    """The classes that a map may hold."""
    type_ = NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")
    quads = knowledge.store.quads_for_pattern(None, type_, NamedNode("http://www.w3.org/2002/07/owl#Class"))
    named = {Iri(quad.subject.value) for quad in quads if isinstance(quad.subject, NamedNode)}
    return sorted(cls for cls in named if knowledge.is_a(cls, THING))


def body(knowledge: KnowledgeBase, cls: Iri) -> Body:
    """Something of a class, in the size that is typical or usual for it."""
    rule = knowledge.shape_rule(cls)
    name = cls.rpartition("#")[2]
    usual = FLAT_M if name.endswith(FLAT) else USUAL_M.get(rule.shape_type, ELSE_M)
    if style := rule.parameters.get("style"):
        usual = LAMPS_M.get(str(style), usual)
    return Body(id=BodyId(name), iri=Iri(f"urn:shapes:{name}"), cls=cls, pose=Pose(), size=rule.size or usual)


# -- the page ----------------------------------------------------------------------------------------------------------


def modules() -> list[ModuleType]:
    """The modules of kinds, in the order in which the kinds are listed."""
    found = [inspect.getmodule(design) for design in SHAPE_TEMPLATES.values()]
    return [module for module, _ in groupby(module for module in found if module is not None)]


def chapter(module: ModuleType, seen: list[Seen]) -> Iterator[str]:
    """One module's kinds, and the picture of all classes that have them."""
    title, _, text = (module.__doc__ or "").partition("\n")[0].partition(": ")
    yield from (f"## {title}", "", f"{text[:1].upper()}{text[1:]}", "")
    here = [design for design in SHAPE_TEMPLATES.values() if inspect.getmodule(design) is module]
    for design in here:
        yield from section(design)
    names = [one for one in seen if SHAPE_TEMPLATES[one.form.shape_name] in here]
    if names:
        yield from ("", f"![{title}](../images/shapes/{short_name(module)}.png)", "")
    for design in here:
        if classes := [one.name for one in names if one.form.shape_name == design.shape_name()]:
            yield f"- as a {design.shape_name()}: {', '.join(classes)}"
    yield ""


def section(design: type[ShapeTemplate]) -> Iterator[str]:
    """One kind: what it is, its parameters and its roles."""
    parameters = ", ".join(f"`{field.name}` {told(field.default)}" for field in msgspec.structs.fields(design))
    roles = ", ".join(f"`{role}`{told_role(surface)}" for role, surface in design.roles.items())
    yield f"- **{design.shape_name()}**. {(inspect.getdoc(design) or '').splitlines()[0]}"
    yield f"  {f'Parameters: {parameters}. ' if parameters else ''}Roles: {roles}."


def told(value: Any) -> str:
    """A default in words."""
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


def told_role(surface: PbrMaterial | str) -> str:
    """What a role is unless somebody says."""
    return f" (as {surface})" if isinstance(surface, str) else f" ({surface.name})" if surface.name else ""


def short_name(module: ModuleType) -> str:
    """The last part of a module's name."""
    return module.__name__.rpartition(".")[2]


def draw(module: ModuleType, seen: list[Seen]) -> None:
    """The contact sheet of a module's kinds; forms that are the same are painted once."""
    painter = Painter(pixels=PIXELS)
    painted: dict[str, Image.Image] = {}
    pictures = []
    for one in seen:
        if inspect.getmodule(SHAPE_TEMPLATES[one.form.shape_name]) is module:
            if one.form.key not in painted:
                painted[one.form.key] = painter.picture(one.form)
            pictures.append((one.name, painted[one.form.key]))
    if pictures:
        save_sheet(PICTURES / f"{short_name(module)}.png", pictures, paper=painter.paper)


if __name__ == "__main__":
    sys.exit(main())
