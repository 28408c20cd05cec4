"""Cabinets and appliances: a case with doors and drawers.

Doors and drawers open outwards only, from their closed position: drawers by 45 cm, doors by a right angle. There is a
gap of 2 mm between a front and its case, and of 3 mm between neighboring fronts. A swinging door turns about
its outer front edge, so that it does not collide with its neighbors. A tilting door turns about a line at its foot,
below its center of mass, so that it is balanced.

Left and right are as seen from the front of the furniture, so right is the direction of a body's own y axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from kitchen.model import Body, BodyType, Frame, Joint, Motion, Scene

__all__ = ["QUARTER_TURN", "TALL_HANDLE", "WIDE_HANDLE", "Cabinet", "Hinge", "cabinet"]

QUARTER_TURN = 1.570796
PULL = 0.45
FRONT_GAP = 2
NEIGHBOR_GAP = 3
DRAWER_FRONT = 20
DRAWER_CLEARANCE = 40

DRAWER_HANDLE = BodyType("BarHandleW16", "ms:BarHandle", (40, 160, 12), 0.15)
DOOR_HANDLE = BodyType("BarHandleH16", "ms:BarHandle", (40, 12, 160), 0.15)
TALL_HANDLE = BodyType("BarHandleH40", "ms:BarHandle", (40, 20, 400), 0.4)
WIDE_HANDLE = BodyType("BarHandleW40", "ms:BarHandle", (40, 400, 20), 0.4)


class Hinge(Enum):
    """The edge that a door turns about."""

    LEFT = "left"
    RIGHT = "right"
    FOOT = "foot"


@dataclass(frozen=True)
class Cabinet:
    """A case to which doors and drawers can be added."""

    scene: Scene
    case: Body

    def drawer(
        self,
        id: str,
        bottom: int,
        height: int,
        *,
        use: str = "knowrob:Drawer",
        start: int = 0,
        width: int | None = None,
        swapped_roles: bool = False,
    ) -> Body:
        """Adds a drawer with a handle to a slot; `start` is the distance of the slot from the left end."""
        depth, case_width, _ = self.case.body_type.size
        width = width or case_width
        size = (depth - DRAWER_CLEARANCE, width - NEIGHBOR_GAP, height - NEIGHBOR_GAP)
        body_type = BodyType(f"{local(use)}W{width // 10}D{size[0] // 10}H{height // 10}", use, size, drawer_mass(size))
        front = depth / 2 + FRONT_GAP + DRAWER_FRONT
        x, y = self.case.frame.at(front - size[0] / 2, start + width / 2 - case_width / 2)
        drawer = self.scene.add(Body(id, body_type, x, y, bottom + size[2] / 2, self.case.turns))
        self.scene.fix(f"{id}_handle", DRAWER_HANDLE, drawer, size[0] / 2, 0, drawer.z)
        self.join(f"{id}_slide", drawer, (size[0] / 2, 0), drawer.z, Motion.SLIDE, PULL, swapped_roles=swapped_roles)
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
        handle: BodyType = DOOR_HANDLE,
        handle_height: int | None = None,
        swapped_roles: bool = False,
    ) -> Body:
        """Adds a door with a handle in front of a slot; `start` is the distance of the slot from the left end."""
        depth, case_width, _ = self.case.body_type.size
        width = width or case_width
        size = (thickness, width - NEIGHBOR_GAP, height - NEIGHBOR_GAP)
        body_type = BodyType(f"{local(use)}W{width // 10}H{height // 10}", use, size, door_mass(size))
        forward = depth / 2 + FRONT_GAP + thickness / 2
        x, y = self.case.frame.at(forward, start + width / 2 - case_width / 2)
        door = self.scene.add(Body(id, body_type, x, y, bottom + size[2] / 2, self.case.turns))
        height_of_handle = door.z if handle_height is None else handle_height
        self.scene.fix(
            f"{id}_handle", handle, door, thickness / 2, handle_side(body_type, handle, hinge), height_of_handle
        )
        line = hinge_line(body_type, handle, hinge)
        motion, z = (Motion.TILT, door.bottom) if hinge is Hinge.FOOT else (Motion.SWING, door.z)
        # A door on a left hinge turns clockwise, seen from above.
        opening = -QUARTER_TURN if hinge is Hinge.LEFT else QUARTER_TURN
        self.join(f"{id}_hinge", door, line, z, motion, opening, swapped_roles=swapped_roles)
        return door

    def join(
        self,
        id: str,
        part: Body,
        at: tuple[float, float],
        height: float,
        motion: Motion,
        opening: float,
        *,
        swapped_roles: bool = False,
    ) -> None:
        """Adds a joint between the case and a part, at a point given relative to the part's center."""
        x, y = part.frame.at(*at)
        joint = Joint(id, self.case.id, part.id, x, y, height, part.turns, motion, opening, swapped_roles)
        self.scene.joints.append(joint)


def cabinet(scene: Scene, id: str, body_type: BodyType, run: Frame, start: int, bottom: int = 0) -> Cabinet:
    """Adds a case with its back on the line of a run; `start` is the position of its left end on that line."""
    depth, width, _ = body_type.size
    x, y = run.at(depth / 2, start + width / 2)
    return Cabinet(scene, scene.build(id, body_type, Frame(x, y, run.turns), bottom))


def local(name: str) -> str:
    """Returns a name without its prefix."""
    return name.partition(":")[2]


def handle_side(door: BodyType, handle: BodyType, hinge: Hinge) -> float:
    """Returns the distance of a door's handle from the door's center, to the right."""
    reach = door.size[1] / 2 - 34 - handle.size[1] / 2
    return {Hinge.LEFT: reach, Hinge.RIGHT: -reach, Hinge.FOOT: 0.0}[hinge]


def hinge_line(door: BodyType, handle: BodyType, hinge: Hinge) -> tuple[float, float]:
    """Returns the position of a door's hinge relative to its center: to the front and to the right."""
    thickness, width, _ = door.size
    if hinge is Hinge.FOOT:
        handle_offset = thickness / 2 + handle.size[0] / 2
        return round(handle_offset * handle.mass_kg / (door.mass_kg + handle.mass_kg), 3), 0.0
    return thickness / 2, -width / 2 if hinge is Hinge.LEFT else width / 2


def door_mass(size: tuple[int, int, int]) -> float:
    """Returns the mass of a board of 650 kg/m3 [kg]."""
    depth, width, height = size
    return round(depth * width * height * 650e-9, 2)


def drawer_mass(size: tuple[int, int, int]) -> float:
    """Returns the mass of a front of 20 mm, a bottom of 8 mm and three sides of 12 mm [kg]."""
    depth, width, height = size
    volume = 20 * width * height + 8 * depth * width + 12 * height * (2 * depth + width)
    return round(volume * 650e-9, 2)
