"""Procedural shapes: templates with parameters, by the name of their shape in ontologies."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mindstage.geometry.procedural.appliances import (
    Appliance,
    CoffeeMaker,
    CookerHood,
    Kettle,
    Radiator,
    Screen,
    WallClock,
)
from mindstage.geometry.procedural.architecture import Door, OpeningFrame, Picture, RoomShell, Wall, Window
from mindstage.geometry.procedural.builder import ShapeTemplate
from mindstage.geometry.procedural.containers import Basket, Bin, Crate, Sink, WireRack
from mindstage.geometry.procedural.furniture import Bed, Cabinet, Chair, Countertop, Drawer, Shelf, Sofa, TableShape
from mindstage.geometry.procedural.hardware import DoorLever, Handle, Hob, Knob, Tap
from mindstage.geometry.procedural.household import Book, Cushion, PaperRoll, Person, Plant, Towel
from mindstage.geometry.procedural.lamps import Lamp
from mindstage.geometry.procedural.packaging import Bag, Bottle, Can, Carton, Jar
from mindstage.geometry.procedural.primitives import BoxShape, Cylinder, Panel, Sphere, TableLeg
from mindstage.geometry.procedural.tableware import Bowl, Cutlery, DinnerPlate, DrinkingGlass, Lid, Mug, Pan, Pot

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
    {template.shape_name(): template for template in _TEMPLATES}
)
"""The template classes by the names of their shapes."""
