"""Cabinets with articulated fronts: doors, double doors, flaps, lids, sliding doors and drawers, with their handles.

Every front is closed in its given pose and opens outwards only. There is a gap of 2 mm between a front and its case. A
swinging door turns about its outer front edge, which leaves its neighbors free. A door that tilts down turns about a
line before its center of mass, so that its weight keeps it closed; a flap that opens upwards about its rear edge.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from mindstage.homes.scenery import Frame, Motion, Scenery, Space, class_iri
from mindstage.scene import Body, Mobility

__all__ = ["Front", "FrontedCase", "Grip", "add_lid"]

QUARTER_TURN_RAD = 1.570796
LID_TURN_RAD = 1.4
FRONT_GAP_M = 0.002
BOARD_M = 0.016
"""Thickness of the boards of a case, which is that of the bundled ontology's shape rule."""
FLOOR_M = 0.02
"""Height of contents above the lower side of a case or a drawer."""
RECESS_M = 0.025
"""Height of the gap above a front that is opened by its edge."""
DRAWER_BACK_GAP_M = 0.04
DRAWER_FRONT_M = 0.022
"""How far a closed drawer stands out of its case."""
_MIN_DRAWER_M = 0.09
_RAIL_M = 0.012
"""Distance between drawers of which each has its own frame."""
_SLIDING_OVERLAP_M = 0.04


class Front(StrEnum):
    """The kinds of fronts."""

    LEFT = "left"
    RIGHT = "right"
    DOUBLE = "double"
    FOOT = "foot"
    """It tilts down, as those of ovens and dishwashers."""
    FLAP = "flap"
    """It tilts up."""
    SLIDING = "sliding"
    DRAWERS = "drawers"
    OPEN = "open"


class Grip(StrEnum):
    """What a front is opened with."""

    BAR = "bar"
    KNOB = "knob"
    RECESS = "recess"
    NONE = "none"


@dataclass(frozen=True, kw_only=True)
class FrontedCase:
    """A case whose front can be closed; `frame` is at its center, `bottom` and `top` bound the part with fronts."""

    scenery: Scenery
    case: Body
    frame: Frame
    size: tuple[float, float, float]
    base: float
    """Height of the lower side of the case [m]."""
    plinth: float
    """Height of the lower side of the fronts above the base [m]."""
    grip: Grip
    gap: float
    """Distance between neighboring fronts [m]."""
    door_class: str = "ms:CupboardDoor"
    thickness: float = 0.019

    def close(self, front: Front) -> None:
        """Adds the doors of a kind; a case without them stays open."""
        if "doors" in self.scenery.without:
            return
        bottom, height, width = self.base + self.plinth, self.size[2] - self.plinth, self.size[1]
        match front:
            case Front.LEFT | Front.RIGHT | Front.FOOT | Front.FLAP:
                self._hinged(front, 0.0, width - self.gap, bottom, height - self.gap)
            case Front.DOUBLE:
                for side, hinge in ((-1, Front.LEFT), (1, Front.RIGHT)):
                    self._hinged(hinge, side * width / 4, width / 2 - self.gap, bottom, height - self.gap)
            case Front.SLIDING:
                self._sliding(bottom, height - self.gap)
            case Front.DRAWERS | Front.OPEN:
                pass

    def shelves(self, count: int, cls: str) -> None:
        """Adds spaces on the floor of the case and on shelves, for what a class of containers is for."""
        low, depth = self.plinth + FLOOR_M if self.plinth else FLOOR_M, self.size[0] - 2 * BOARD_M - 0.02
        room = (self.size[2] - BOARD_M - low) / count
        stored = self.scenery.household.stored_in(class_iri(cls))
        for number in range(count):
            bottom = self.base + round(low + number * room, 3)
            frame = self.frame.at(0.0, 0.0)
            space = Space(frame, bottom, depth, self.size[1] - 2 * BOARD_M - 0.02, room - 0.04, stored)
            self.scenery.spaces.append(space)

    def drawers(self, heights: list[float], classes: list[str], *, framed: bool) -> None:
        """Adds drawers in the case, from the bottom to the top; without doors the case is a frame without drawers."""
        spacing = _RAIL_M if framed else self.gap
        bottom = self.base + max(self.plinth, BOARD_M) + spacing
        for height, cls in zip(heights, classes, strict=True):
            self._drawer(cls, bottom, height - spacing)
            bottom += height

    def split(self, count: int) -> list[float]:
        """Heights for drawers that fill the case, the upper ones lower than the lower ones [m]."""
        room = self.size[2] - max(self.plinth, BOARD_M) - BOARD_M - _RAIL_M
        count = max(min(count, int(room / _MIN_DRAWER_M)), 1)
        weights = [1.0 + 0.35 * (count - number) for number in range(count)]
        return [round(room * weight / sum(weights) - 0.0005, 3) for weight in weights]

    def _drawer(self, cls: str, bottom: float, height: float) -> None:
        depth, width = self.size[0] - DRAWER_BACK_GAP_M, self.size[1] - 2 * BOARD_M - 2 * self.gap
        frame = self.frame.at(self.size[0] / 2 + DRAWER_FRONT_M - depth / 2, 0.0)
        if "doors" in self.scenery.without:
            return
        if self.grip is Grip.RECESS:
            height -= RECESS_M
        drawer = self.scenery.add(cls, (depth, width, height), frame, bottom, mobility=Mobility.DYNAMIC)
        self._handle(drawer, frame.at(depth / 2, 0.0), bottom + height * 0.5, wide=True, room=width)
        travel = round(0.8 * depth, 3)
        z = bottom + height / 2
        self.scenery.join(self.case, drawer, frame.at(depth / 2, 0.0), z, Motion("x", travel))
        stored = self.scenery.household.stored_in(class_iri(cls))
        space = Space(frame, bottom + FLOOR_M, depth - 0.06, width - 0.05, height - FLOOR_M - 0.01, stored)
        self.scenery.spaces.append(space)

    def _hinged(self, hinge: Front, across: float, width: float, bottom: float, height: float) -> None:
        thick = self.thickness
        if self.grip is Grip.RECESS:
            height -= RECESS_M
        frame = self.frame.at(self.size[0] / 2 + FRONT_GAP_M + thick / 2, across)
        door = self.scenery.add(self.door_class, (thick, width, height), frame, bottom, mobility=Mobility.DYNAMIC)
        reach = max(width / 2 - 0.05, 0.0)
        side = {Front.LEFT: reach, Front.RIGHT: -reach}.get(hinge, 0.0)
        tilts = hinge in {Front.FOOT, Front.FLAP}
        level = {Front.FOOT: 0.9, Front.FLAP: 0.12}.get(hinge, 0.15 if self.base > 1.0 else 0.82)
        if self.size[2] > 1.5:
            level = (1.05 - bottom) / height
        level = min(max(height * level, 0.09), height - 0.09) if not tilts else height * level
        handle = self._handle(
            door, frame.at(thick / 2, side), bottom + level, wide=tilts, room=width if tilts else height
        )
        z = bottom + height / 2
        if hinge is Front.LEFT:
            at, motion = frame.at(thick / 2, -width / 2), Motion("swing1", -QUARTER_TURN_RAD)
        elif hinge is Front.RIGHT:
            at, motion = frame.at(thick / 2, width / 2), Motion("swing1", QUARTER_TURN_RAD)
        elif hinge is Front.FLAP:
            at, motion, z = frame.at(-thick / 2, 0.0), Motion("swing2", -LID_TURN_RAD), bottom + height
        else:
            weights = [part.physics.mass_kg or 0.0 for part in (door, handle) if part is not None]
            forward = 0.0 if handle is None else 0.03 * weights[1] / sum(weights)
            at, motion, z = frame.at(forward + 0.004, 0.0), Motion("swing2", QUARTER_TURN_RAD), bottom
        self.scenery.join(self.case, door, at, z, motion)

    def _sliding(self, bottom: float, height: float) -> None:
        """Two leaves on two tracks; the rear one has no bar that would hit the other one."""
        width = self.size[1] / 2 + _SLIDING_OVERLAP_M / 2
        travel = round(self.size[1] - width - 0.002, 4)
        for side, track in ((-1, 0), (1, 1)):
            forward = self.size[0] / 2 + FRONT_GAP_M + self.thickness / 2 + track * (self.thickness + 0.004)
            frame = self.frame.at(forward, side * (self.size[1] - width) / 2)
            size = (self.thickness, width, height)
            leaf = self.scenery.add(self.door_class, size, frame, bottom, mobility=Mobility.DYNAMIC)
            if track:
                z = bottom + min(max(1.05 - bottom, 0.3 * height), 0.7 * height)
                self._handle(leaf, frame.at(self.thickness / 2, side * (width / 2 - 0.06)), z, wide=False, room=height)
            self.scenery.join(self.case, leaf, frame, bottom + height / 2, Motion("y", -side * travel))

    def _handle(self, front: Body, frame: Frame, z: float, *, wide: bool, room: float) -> Body | None:
        """Adds a handle at a point of the outer side of a front."""
        if self.grip not in {Grip.BAR, Grip.KNOB} or "handles" in self.scenery.without:
            return None
        if self.grip is Grip.KNOB:
            cls, size = "knowrob:ControlKnob", (0.028, 0.03, 0.03)
        else:
            cls, length = "ms:BarHandle", round(min(0.4, 0.55 * room, 0.16 if room < 1.0 else 0.4), 3)
            size = (0.035, length, 0.012) if wide else (0.035, 0.012, length)
        size = (size[0], size[1], min(size[2], 0.8 * (front.size or size)[2]))
        at = frame.at(size[0] / 2, 0.0)
        return self.scenery.add(cls, size, at, z - size[2] / 2, mobility=Mobility.KINEMATIC, parent=front)


def add_lid(scenery: Scenery, cls: str, size: tuple[float, float, float], frame: Frame, stored: str) -> None:
    """Adds a chest and its lid, which turns about its rear upper edge."""
    thick = BOARD_M + 0.004
    depth, width, height = size
    chest = scenery.add(cls, (depth, width, height - thick), frame, 0.0)
    if "doors" not in scenery.without:
        bottom = height - thick + FRONT_GAP_M
        lid = scenery.add("knowrob:ContainerLid", (depth, width, thick), frame, bottom, mobility=Mobility.DYNAMIC)
        scenery.join(chest, lid, frame.at(-depth / 2, 0.0), bottom + thick, Motion("swing2", -LID_TURN_RAD))
    classes = scenery.household.stored_in(class_iri(stored))
    scenery.spaces.append(Space(frame, FLOOR_M, depth - 0.1, width - 0.1, height - thick - FLOOR_M - 0.05, classes))
