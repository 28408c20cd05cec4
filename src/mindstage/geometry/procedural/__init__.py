"""Kinds: every shape there is, by its name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mindstage.shapes.design import ShapeTemplate
from mindstage.shapes.kinds.building import Door, OpeningFrame, Picture, RoomShell, Wall, Window
from mindstage.shapes.kinds.containers import Basket, Bin, Crate, Sink
from mindstage.shapes.kinds.devices import Appliance, CoffeeMaker, CookerHood, Kettle, Radiator, Screen, WallClock
from mindstage.shapes.kinds.fittings import DoorLever, Handle, Hob, Knob, Tap
from mindstage.shapes.kinds.furniture import Bed, Chair, Countertop, Shelf, Sofa, TableShape
from mindstage.shapes.kinds.lights import Lamp
from mindstage.shapes.kinds.packages import Bag, Bottle, Can, Carton, Jar
from mindstage.shapes.kinds.plain import BoxShape, Cylinder, Panel, Sphere, TableLeg
from mindstage.shapes.kinds.racks import WireRack
from mindstage.shapes.kinds.storage import Cabinet, Drawer
from mindstage.shapes.kinds.things import Book, Cushion, PaperRoll, Person, Plant, Towel
from mindstage.shapes.kinds.utensils import Cutlery
from mindstage.shapes.kinds.vessels import Bowl, DinnerPlate, DrinkingGlass, Lid, Mug, Pan, Pot

__all__ = ["SHAPE_TEMPLATES"]

_TEMPLATES: tuple[type[ShapeTemplate], ...] = (
    *(BoxShape, Panel, Sphere, Cylinder, TableLeg),
    *(Cabinet, Drawer, Basket, WireRack, Crate, Sink, Bin),
    *(Door, Window, OpeningFrame, Wall, RoomShell, Picture),
    *(Countertop, TableShape, Shelf, Chair, Bed, Sofa),
    *(Handle, Knob, DoorLever, Tap, Hob),
    *(Screen, Lamp, Radiator, CookerHood, Appliance, CoffeeMaker, Kettle, WallClock),
    *(DinnerPlate, Bowl, Mug, DrinkingGlass, Pot, Pan, Lid, Cutlery),
    *(Bottle, Jar, Can, Carton, Bag),
    *(Book, Cushion, Towel, PaperRoll, Plant, Person),
)

SHAPE_TEMPLATES: Mapping[str, type[ShapeTemplate]] = MappingProxyType(
    {design.shape_name(): design for design in _TEMPLATES}
)
"""The classes of designs by the names of their kinds."""
