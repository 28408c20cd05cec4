"""Cabinets and appliances: a case, and the doors and drawers in front of it.

A front keeps 2 mm from its case and 3 mm from the next front. A door that swings turns about its outer front edge,
so that it passes its neighbors. A door that tilts turns about a line at its foot right below its center of mass, so
that gravity leaves it where it is.

Left and right are those of somebody who stands before the furniture, which is why right is a thing's own left (its y).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from kitchen.model import Frame, Joint, Kind, Motion, Scene, Thing

__all__ = ["QUARTER_TURN", "TALL_HANDLE", "WIDE_HANDLE", "Cabinet", "Hinge", "cabinet"]

QUARTER_TURN = 1.570796
PULL = 0.45
FRONT_GAP = 2
NEIGHBOR_GAP = 3
DRAWER_FRONT = 20
DRAWER_CLEARANCE = 40

DRAWER_HANDLE = Kind("BarHandleW16", "ms:BarHandle", (40, 160, 12), 0.15)
DOOR_HANDLE = Kind("BarHandleH16", "ms:BarHandle", (40, 12, 160), 0.15)
TALL_HANDLE = Kind("BarHandleH40", "ms:BarHandle", (40, 20, 400), 0.4)
WIDE_HANDLE = Kind("BarHandleW40", "ms:BarHandle", (40, 400, 20), 0.4)


class Hinge(Enum):
    """The side that a door turns about."""

    LEFT = "left"
    RIGHT = "right"
    FOOT = "foot"


@dataclass(frozen=True)
class Cabinet:
    """A case that takes doors and drawers."""

    scene: Scene
    case: Thing

    def drawer(
        self,
        id: str,
        bottom: int,
        height: int,
        *,
        use: str = "knowrob:Drawer",
        start: int = 0,
        width: int | None = None,
        upside_down: bool = False,
    ) -> Thing:
        """A drawer with its handle in a slot of that height; `start` is how far the slot is from the left end."""
        depth, case_width, _ = self.case.kind.size
        width = width or case_width
        size = (depth - DRAWER_CLEARANCE, width - NEIGHBOR_GAP, height - NEIGHBOR_GAP)
        kind = Kind(f"{local(use)}W{width // 10}D{size[0] // 10}H{height // 10}", use, size, drawer_mass(size))
        front = depth / 2 + FRONT_GAP + DRAWER_FRONT
        x, y = self.case.frame.at(front - size[0] / 2, start + width / 2 - case_width / 2)
        drawer = self.scene.add(Thing(id, kind, x, y, bottom + size[2] / 2, self.case.turns))
        self.scene.fix(f"{id}_handle", DRAWER_HANDLE, drawer, size[0] / 2, 0, drawer.z)
        self.join(f"{id}_slide", drawer, (size[0] / 2, 0), drawer.z, Motion.SLIDE, PULL, upside_down=upside_down)
        return drawer

    def door(
        self,
        id: str,
        bottom: int,
        height: int,
        hinge: Hinge,
        *,
        use: str = "ms:CupboardDoor",
        start: int = 0,
        width: int | None = None,
        thickness: int = 20,
        handle: Kind = DOOR_HANDLE,
        handle_height: int | None = None,
        limit: float = QUARTER_TURN,
        upside_down: bool = False,
    ) -> Thing:
        """A door with its handle before a slot of that height; `start` as for drawers."""
        depth, case_width, _ = self.case.kind.size
        width = width or case_width
        size = (thickness, width - NEIGHBOR_GAP, height - NEIGHBOR_GAP)
        kind = Kind(f"{local(use)}W{width // 10}H{height // 10}", use, size, door_mass(size))
        forward = depth / 2 + FRONT_GAP + thickness / 2
        x, y = self.case.frame.at(forward, start + width / 2 - case_width / 2)
        door = self.scene.add(Thing(id, kind, x, y, bottom + size[2] / 2, self.case.turns))
        height_of_handle = door.z if handle_height is None else handle_height
        self.scene.fix(f"{id}_handle", handle, door, thickness / 2, handle_side(kind, handle, hinge), height_of_handle)
        line = hinge_line(kind, handle, hinge)
        motion, z = (Motion.TILT, door.bottom) if hinge is Hinge.FOOT else (Motion.SWING, door.z)
        self.join(f"{id}_hinge", door, line, z, motion, limit, upside_down=upside_down)
        return door

    def join(
        self,
        id: str,
        part: Thing,
        at: tuple[float, float],
        height: float,
        motion: Motion,
        limit: float,
        *,
        upside_down: bool = False,
    ) -> None:
        """Holds a part on the case, at a point in front of and to the right of the part's middle."""
        x, y = part.frame.at(*at)
        joint = Joint(id, self.case.id, part.id, x, y, height, part.turns, motion, limit, upside_down)
        self.scene.joints.append(joint)


def cabinet(scene: Scene, id: str, kind: Kind, run: Frame, start: int, bottom: int = 0) -> Cabinet:
    """A case with its back on the line of a run; `start` is where its left end is along that line."""
    depth, width, _ = kind.size
    x, y = run.at(depth / 2, start + width / 2)
    return Cabinet(scene, scene.build(id, kind, Frame(x, y, run.turns), bottom))


def local(name: str) -> str:
    """A name without its prefix."""
    return name.partition(":")[2]


def handle_side(door: Kind, handle: Kind, hinge: Hinge) -> float:
    """How far to the right of a door's middle its handle is."""
    reach = door.size[1] / 2 - 34 - handle.size[1] / 2
    return {Hinge.LEFT: reach, Hinge.RIGHT: -reach, Hinge.FOOT: 0.0}[hinge]


def hinge_line(door: Kind, handle: Kind, hinge: Hinge) -> tuple[float, float]:
    """Where a door turns: how far in front of its middle, and how far to the right of it."""
    thickness, width, _ = door.size
    if hinge is Hinge.FOOT:
        grip = thickness / 2 + handle.size[0] / 2
        return round(grip * handle.mass_kg / (door.mass_kg + handle.mass_kg), 3), 0.0
    return thickness / 2, -width / 2 if hinge is Hinge.LEFT else width / 2


def door_mass(size: tuple[int, int, int]) -> float:
    """A board of 650 kg/m3 [kg]."""
    depth, width, height = size
    return round(depth * width * height * 650e-9, 2)


def drawer_mass(size: tuple[int, int, int]) -> float:
    """A front of 20 mm, a bottom of 8 mm and three sides of 12 mm of the same board [kg]."""
    depth, width, height = size
    volume = 20 * width * height + 8 * depth * width + 12 * height * (2 * depth + width)
    return round(volume * 650e-9, 2)
