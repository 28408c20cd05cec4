"""Kinds: every shape there is, by its name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mindstage.shapes.design import Design
from mindstage.shapes.kinds.building import Door, Frame, Picture, Shell, Wall, Window
from mindstage.shapes.kinds.containers import Basket, Bin, Sink, Tub
from mindstage.shapes.kinds.devices import Appliance, Brewer, Clock, Hood, Kettle, Radiator, Screen
from mindstage.shapes.kinds.fittings import Handle, Hob, Knob, Lever, Tap
from mindstage.shapes.kinds.furniture import Bed, Chair, Counter, Shelf, Sofa, Table
from mindstage.shapes.kinds.lights import Lamp
from mindstage.shapes.kinds.packages import Bag, Bottle, Can, Carton, Jar
from mindstage.shapes.kinds.plain import Ball, Box, Cylinder, Leg, Panel
from mindstage.shapes.kinds.racks import Rack
from mindstage.shapes.kinds.storage import Case, Drawer
from mindstage.shapes.kinds.things import Book, Cushion, Figure, Plant, Roll, Towel
from mindstage.shapes.kinds.utensils import Cutlery
from mindstage.shapes.kinds.vessels import Bowl, Glass, Lid, Mug, Pan, Plate, Pot

__all__ = ["DESIGNS"]

_ALL: tuple[type[Design], ...] = (
    *(Box, Panel, Ball, Cylinder, Leg),
    *(Case, Drawer, Basket, Rack, Tub, Sink, Bin),
    *(Door, Window, Frame, Wall, Shell, Picture),
    *(Counter, Table, Shelf, Chair, Bed, Sofa),
    *(Handle, Knob, Lever, Tap, Hob),
    *(Screen, Lamp, Radiator, Hood, Appliance, Brewer, Kettle, Clock),
    *(Plate, Bowl, Mug, Glass, Pot, Pan, Lid, Cutlery),
    *(Bottle, Jar, Can, Carton, Bag),
    *(Book, Cushion, Towel, Roll, Plant, Figure),
)

DESIGNS: Mapping[str, type[Design]] = MappingProxyType({design.kind(): design for design in _ALL})
"""The classes of designs by the names of their kinds."""
