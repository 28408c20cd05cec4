"""Furniture by the use of a room, and things in and on it.

Sizes follow EN 1116 (kitchens: modules of 100 mm, depth 600 mm, worktops at 850 to 950 mm, plinths of at least 100 mm),
EN 527-1 (desks: 720 to 760 mm high, 800 mm deep), EN 13150 (benches of laboratories: 900 mm high, 600 to 900 mm deep),
EN 1335-1 (office chairs: seats at 400 to 510 mm) and EN 1725 (beds); free floor before furniture DIN 18040-2 (1.20 m in
kitchens and baths, 0.90 m elsewhere).
"""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType

from mindstage.homes.fronts import Front, FrontedCase, Grip, add_lid
from mindstage.homes.rooms import Room, RoomKind
from mindstage.homes.scenery import Frame, Scenery, Space, class_iri
from mindstage.scene import Iri, Mobility, Vector

__all__ = ["fill_spaces", "furnish"]

KITCHEN_CLEARANCE_M = 1.2
CLEARANCE_M = 0.9
_WORKTOP_OVERHANG_M = 0.04
_WALL_CUPBOARD_DEPTH_M = 0.35
_THING_GAP_M = 0.012
_SHELF_BOARD_M, _SHELF_SPACING_M = 0.03, 0.34
"""These are the parameters of the shape of shelves in `geometry`."""
_MAX_MISSES_COUNT = 4
"""Things that do not fit, after which a row is full."""
_FILLER_M = 0.06
"""Distance between a wall and the first door, which its handle needs when it is open."""
_GRIPS = (Grip.BAR, Grip.BAR, Grip.KNOB, Grip.RECESS, Grip.NONE)
_TABLEWARE = ("knowrob:EatingVessel", "knowrob:DrinkingVessel", "knowrob:Drink")
_COUNTER = (
    *("ms:KnifeBlock", "knowrob:CuttingBoard", "ms:SaltShaker", "ms:PepperMill", "knowrob:PaperTowel", "ms:TeaCaddy"),
    *("ms:ElectricKettle", "ms:Toaster", "knowrob:CoffeeMaker", "ms:CookieJar", "ms:PottedPlant", "knowrob:Spice"),
    *("knowrob:BreakfastCereal", "knowrob:DrinkingMug", "knowrob:Bowl-Eating"),
)
_DESK = ("knowrob:BookCopy", "knowrob:DrinkingMug", "ms:PottedPlant", "knowrob:CellularTelephone", "ms:Radio")
_LIVING = ("knowrob:BookCopy", "ms:PottedPlant", "knowrob:Vase", "knowrob:Candle", "ms:Radio", "knowrob:DrinkingGlass")
_BATH = ("knowrob:CleaningSubstance", "ms:Medicine", "knowrob:ClothTowel", "knowrob:DrinkingGlass")
_GOODS = ("ms:DryGoods", "knowrob:CannedFood", "knowrob:Drink", "knowrob:CleaningSubstance", "knowrob:Sauce")
_LAB = ("knowrob:Bottle", "knowrob:MeasuringCup", "ms:KitchenScale", "knowrob:Box-Container", "ms:FoodStorageBox")


def furnish(scenery: Scenery, room: Room) -> None:
    """Adds the furniture of a room, as much as there is place for."""
    _FURNISHERS[room.kind](scenery, room)


def _cabinet(
    scenery: Scenery,
    cls: str,
    size: Vector,
    frame: Frame,
    *,
    base: float = 0.0,
    plinth: float = 0.1,
    grip: Grip,
    door_class: str = "ms:CupboardDoor",
    thickness: float = 0.019,
) -> FrontedCase:
    case = scenery.add(cls, size, frame, base)
    gap = scenery.random.choice((0.001, 0.002, 0.003, 0.004))
    return FrontedCase(
        scenery=scenery,
        case=case,
        frame=frame,
        size=size,
        base=base,
        plinth=plinth,
        grip=grip,
        gap=gap,
        door_class=door_class,
        thickness=thickness,
    )


def _surface(
    scenery: Scenery,
    frame: Frame,
    top: float,
    depth: float,
    width: float,
    kinds: tuple[str, ...],
    *,
    height: float = 0.42,
) -> None:
    """A space on top of something."""
    classes = scenery.household.leaves(*map(class_iri, kinds))
    scenery.spaces.append(Space(frame, top, depth, width, height, classes))


# -- kitchens ----------------------------------------------------------------------------------------------------------


def _kitchen(scenery: Scenery, room: Room) -> None:
    grip = scenery.random.choice(_GRIPS)
    worktop = scenery.between(0.85, 0.95)
    modules = _modules(scenery)
    while modules:
        width = round(sum(each for _, each in modules), 4)
        frame = room.along(scenery, (0.66, width, worktop), KITCHEN_CLEARANCE_M, gap=_FILLER_M)
        if frame is not None:
            _run(scenery, room, modules, frame.at(-0.33, -width / 2), worktop, grip)
            break
        modules.pop()
    for kind in ("fridge", "pantry"):
        _tall(scenery, room, kind, grip)
    second = [("drawers", 0.6), ("double", 0.8), ("left", 0.6)]
    while second:
        width = round(sum(each for _, each in second), 4)
        frame = room.along(scenery, (0.66, width, worktop), KITCHEN_CLEARANCE_M, gap=_FILLER_M)
        if frame is not None:
            _run(scenery, room, second, frame.at(-0.33, -width / 2), worktop, grip)
            break
        second.pop()
    _table(scenery, room, "knowrob:KitchenTable", _TABLEWARE)
    _stand(scenery, room, "ms:PedalBin")


def _modules(scenery: Scenery) -> list[tuple[str, float]]:
    """The base units of a kitchen from one end to the other, and their widths; the last ones are the least needed."""
    widths = (0.4, 0.45, 0.5, 0.6, 0.8, 0.9)
    modules = [("sink", scenery.random.choice((0.6, 0.8))), ("dishwasher", scenery.random.choice((0.45, 0.6)))]
    modules += [("drawers", scenery.random.choice(widths)), ("oven", 0.6)]
    rest = [("drawers", 0.0), ("double", 0.0), ("left", 0.0), ("right", 0.0)]
    scenery.random.shuffle(rest)
    return modules + [
        (kind, scenery.random.choice(widths if kind != "double" else (0.8, 0.9, 1.0))) for kind, _ in rest
    ]


def _run(
    scenery: Scenery, room: Room, modules: list[tuple[str, float]], start: Frame, worktop: float, grip: Grip
) -> None:
    """Adds base units side by side, with a counter top and cupboards above them; `start` is at the wall."""
    slab = scenery.random.choice((0.03, 0.038, 0.04))
    counter = worktop - slab
    across = 0.0
    for kind, width in modules:
        frame = start.at(0.3, across + width / 2)
        _BASE_UNITS.get(kind, _base_unit)(scenery, kind, (0.6, width, counter), frame, grip)
        if kind != "sink":
            at = start.at(0.32, across + width / 2)
            scenery.add("knowrob:CounterTop", (0.6 + _WORKTOP_OVERHANG_M, width, slab), at, counter)
        if kind == "oven":
            scenery.add("ms:ElectricHob", (0.51, width - 0.02, 0.008), start.at(0.32, across + width / 2), worktop)
            above = start.at(0.25, across + width / 2)
            if not _behind_window(room, above, width):
                scenery.add("ms:CookerHood", (0.5, width, 0.45), above, worktop + 0.65)
        elif kind != "sink":
            _surface(scenery, start.at(0.3, across + width / 2), worktop, 0.48, width - 0.06, _COUNTER)
        if kind != "oven":
            _wall_cupboard(scenery, room, start, across + width / 2, width, worktop, grip)
        across += width


def _behind_window(room: Room, frame: Frame, width: float) -> bool:
    """Whether a body of a width on the wall covers a window."""
    for side in room.sides:
        if side.frame.turns != frame.turns:
            continue
        middle = side.frame.rect(0.0, 0.0)
        own = (frame.x - middle[0], frame.y - middle[1])
        _, axis = (0, 1) if frame.turns % 2 == 0 else (1, 0)
        direction = side.frame.at(0.0, 1.0)
        sign = direction.y - side.frame.y if axis else direction.x - side.frame.x
        across = own[axis] * sign
        return any(
            across - width / 2 < end + 0.02 and across + width / 2 > begin - 0.02 for begin, end, _ in side.windows
        )
    return False


def _wall_cupboard(
    scenery: Scenery, room: Room, start: Frame, across: float, width: float, worktop: float, grip: Grip
) -> None:
    base, height = worktop + scenery.random.choice((0.5, 0.55, 0.6)), scenery.random.choice((0.6, 0.7, 0.72))
    frame = start.at(_WALL_CUPBOARD_DEPTH_M / 2, across)
    if _behind_window(room, frame, width) or base + height > room.height - 0.1 or scenery.random.random() < 0.15:
        return
    front = Front.DOUBLE if width >= 0.8 else scenery.random.choice((Front.LEFT, Front.RIGHT, Front.FLAP))
    if front is Front.FLAP:
        height = 0.36
    cls = scenery.random.choice(("ms:CrockeryCupboard", "ms:GlassCupboard", "ms:SpiceCupboard"))
    size = (_WALL_CUPBOARD_DEPTH_M, width, height)
    unit = _cabinet(scenery, cls, size, frame, base=base, plinth=0.0, grip=grip)
    unit.close(front)
    unit.shelves(1 if front is Front.FLAP else 2, cls)


def _base_unit(scenery: Scenery, kind: str, size: Vector, frame: Frame, grip: Grip) -> None:
    front = Front(kind)
    if front is Front.DRAWERS:
        unit = _cabinet(scenery, "ms:DrawerCupboard", size, frame, grip=grip)
        heights = unit.split(scenery.random.randrange(2, 6))
        kinds = ("ms:PotDrawer", "ms:LinenDrawer", "ms:CupDrawer", "ms:UtensilDrawer", "ms:CutleryDrawer")
        unit.drawers(heights, list(kinds[-len(heights) :]), framed=scenery.random.random() < 0.4)
        return
    unit = _cabinet(scenery, "ms:BaseCupboard", size, frame, grip=grip)
    unit.close(front)
    unit.shelves(2, "ms:PantryCupboard")


def _sink_unit(scenery: Scenery, _kind: str, size: Vector, frame: Frame, grip: Grip) -> None:
    deep = 0.2
    unit = _cabinet(scenery, "ms:SinkCupboard", (size[0], size[1], size[2] - deep), frame, grip=grip)
    unit.close(Front.DOUBLE if size[1] >= 0.8 else Front.LEFT)
    unit.shelves(1, "ms:SinkCupboard")
    scenery.add("knowrob:Sink", (size[0] + 0.03, size[1], deep + 0.03), frame.at(0.015, 0.0), size[2] - deep)
    scenery.add("knowrob:Tap-PlumbingFixture", (0.22, 0.05, 0.06), frame.at(-size[0] / 2 + 0.11, 0.0), size[2] + 0.15)


def _dishwasher(scenery: Scenery, _kind: str, size: Vector, frame: Frame, grip: Grip) -> None:
    grip = Grip.BAR if grip is Grip.NONE else grip
    unit = _cabinet(scenery, "knowrob:Dishwasher", size, frame, grip=grip, door_class="ms:ApplianceDoor")
    unit.close(Front.FOOT)
    unit.shelves(1, "ms:CrockeryCupboard")


def _oven(scenery: Scenery, _kind: str, size: Vector, frame: Frame, _grip: Grip) -> None:
    drawer = (size[0], size[1], 0.18)
    base = _cabinet(scenery, "ms:DrawerCupboard", drawer, frame, plinth=0.0, grip=Grip.NONE)
    base.drawers([drawer[2] - 0.04], ["ms:BakewareDrawer"], framed=True)
    panel = 0.1
    above = (size[0], size[1], size[2] - drawer[2])
    case = scenery.add("ms:ElectricOven", above, frame, drawer[2])
    doors = (above[0], above[1], above[2] - panel)
    unit = FrontedCase(
        scenery=scenery,
        case=case,
        frame=frame,
        size=doors,
        base=drawer[2],
        plinth=0.03,
        grip=Grip.BAR,
        gap=0.004,
        door_class="ms:ApplianceDoor",
        thickness=0.03,
    )
    unit.close(Front.FOOT)
    if "handles" not in scenery.without:
        for number in range(-2, 3):
            at = frame.at(size[0] / 2 + 0.015, number * 0.1)
            scenery.add(
                "knowrob:ControlKnob", (0.03, 0.04, 0.04), at, size[2] - 0.07, mobility=Mobility.KINEMATIC, parent=case
            )


_BASE_UNITS: MappingProxyType[str, Callable[[Scenery, str, Vector, Frame, Grip], None]] = MappingProxyType(
    {"sink": _sink_unit, "dishwasher": _dishwasher, "oven": _oven}
)


def _tall(scenery: Scenery, room: Room, kind: str, grip: Grip) -> None:
    """Adds a refrigerator on a freezer, or a pantry."""
    height = scenery.between(1.9, 2.2, 0.05)
    frame = room.along(scenery, (0.65, 0.6, height), KITCHEN_CLEARANCE_M, gap=_FILLER_M)
    if frame is None:
        return
    frame = frame.at(-0.025, 0.0)
    hinge = scenery.random.choice((Front.LEFT, Front.RIGHT))
    if kind == "pantry":
        unit = _cabinet(scenery, "ms:PantryCupboard", (0.6, 0.6, height), frame, grip=grip)
        unit.close(hinge)
        unit.shelves(4, "ms:PantryCupboard")
        return
    low = scenery.between(0.6, 0.8)
    for cls, base, top, plinth in (
        ("knowrob:Refrigerator-Freezer", 0.0, low, 0.06),
        ("knowrob:Refrigerator", low, height - 0.2, 0.0),
    ):
        size = (0.6, 0.6, round(top - base, 3))
        unit = _cabinet(
            scenery,
            cls,
            size,
            frame,
            base=base,
            plinth=plinth,
            grip=Grip.BAR,
            door_class="ms:ApplianceDoor",
            thickness=0.04,
        )
        unit.close(hinge)
        unit.shelves(2 if base == 0.0 else 4, cls)


def _table(scenery: Scenery, room: Room, cls: str, kinds: tuple[str, ...]) -> None:
    """Adds a table with chairs where there is place."""
    depth, width = scenery.between(0.7, 0.9), scenery.between(0.9, 1.8, 0.1)
    height = scenery.between(0.72, 0.76)
    frame = room.in_the_middle(scenery, depth, width, 0.75) or room.along(scenery, (depth, width, height), 0.75)
    if frame is None:
        return
    scenery.add(cls, (depth, width, height), frame, 0.0)
    _surface(scenery, frame, height, depth - 0.1, width - 0.1, kinds)
    for across in (-width / 4, width / 4) if width >= 1.2 else (0.0,):
        chair = frame.at(depth / 2 + 0.35, across, turns=2)
        _dynamic(scenery, "knowrob:Chair-PieceOfFurniture", (0.45, 0.45, scenery.between(0.8, 0.95)), chair)


def _dynamic(scenery: Scenery, cls: str, size: Vector, frame: Frame) -> None:
    scenery.add(cls, size, frame, 0.0, mobility=Mobility.DYNAMIC)


def _stand(scenery: Scenery, room: Room, cls: str, *, mobility: Mobility = Mobility.DYNAMIC) -> None:
    """Adds something that stands alone at a wall."""
    size = scenery.household.size(class_iri(cls))
    frame = room.along(scenery, size, 0.0)
    if frame is not None:
        scenery.add(cls, size, frame, 0.0, mobility=mobility)


# -- other rooms -------------------------------------------------------------------------------------------------------


def _closet(
    scenery: Scenery,
    room: Room,
    cls: str,
    size: Vector,
    front: Front,
    *,
    shelves: int = 3,
    stored: str | None = None,
    on_top: tuple[str, ...] = (),
    clearance: float = CLEARANCE_M,
    gap: float = _FILLER_M,
) -> None:
    """Adds a cabinet at a wall."""
    frame = room.along(scenery, (size[0] + 0.08, size[1], size[2]), clearance, gap=gap)
    if frame is None:
        return
    frame = frame.at(-0.04, 0.0)
    unit = _cabinet(
        scenery, cls, size, frame, plinth=scenery.random.choice((0.0, 0.06)), grip=scenery.random.choice(_GRIPS)
    )
    if front is Front.DRAWERS:
        heights = unit.split(scenery.random.randrange(2, 5))
        unit.drawers(heights, [stored or "ms:LinenDrawer"] * len(heights), framed=scenery.random.random() < 0.5)
    else:
        unit.close(front)
        unit.shelves(shelves, stored or cls)
    if on_top:
        _surface(scenery, frame, size[2], size[0] - 0.08, size[1] - 0.1, on_top)


def _chest(scenery: Scenery, room: Room, cls: str, size: Vector, stored: str) -> None:
    """Adds a chest with a lid."""
    frame = room.along(scenery, size, CLEARANCE_M, gap=0.05)
    if frame is not None:
        add_lid(scenery, cls, size, frame, stored)


def _shelves(scenery: Scenery, room: Room, width: float, kinds: tuple[str, ...], *, middle: bool = False) -> None:
    """Adds shelves that are open at the front."""
    size = (0.4 if middle else 0.3, width, scenery.between(1.5, 2.0, 0.1))
    frame = (
        room.in_the_middle(scenery, size[0], width, CLEARANCE_M) if middle else room.along(scenery, size, CLEARANCE_M)
    )
    if frame is None:
        return
    scenery.add("knowrob:ShelfInABuilding" if middle else "ms:Bookshelf", size, frame, 0.0)
    classes = scenery.household.leaves(*map(class_iri, kinds))
    board = _SHELF_BOARD_M
    count = round(size[2] / _SHELF_SPACING_M)
    spacing = (size[2] - 2 * board) / count
    for number in range(count):
        bottom = round(board + number * spacing, 4)
        scenery.spaces.append(Space(frame, bottom, size[0] - 0.1, width - 0.1, spacing - board - 0.02, classes))


def _desk(scenery: Scenery, room: Room) -> None:
    width, height = scenery.random.choice((1.2, 1.4, 1.6, 1.8)), scenery.between(0.72, 0.76)
    frame = room.along(scenery, (0.8, width, height), CLEARANCE_M)
    if frame is None:
        return
    scenery.add("knowrob:Desk-PieceOfFurniture", (0.8, width, height), frame, 0.0)
    scenery.add("knowrob:TelevisionSet", (0.06, 0.55, 0.4), frame.at(-0.28, 0.0), height)
    _surface(scenery, frame.at(0.08, 0.0), height, 0.5, width - 0.15, _DESK)
    chair = frame.at(0.75, 0.0, turns=2)
    _dynamic(scenery, "knowrob:Chair-PieceOfFurniture", (0.48, 0.48, scenery.between(0.85, 1.05)), chair)


def _living(scenery: Scenery, room: Room) -> None:
    _closet(
        scenery,
        room,
        "knowrob:Cabinet-PieceOfFurniture",
        (0.45, scenery.between(1.2, 1.8, 0.1), 0.75),
        Front.SLIDING,
        shelves=2,
        stored="ms:CrockeryCupboard",
        on_top=_LIVING,
    )
    width = scenery.between(1.6, 2.2, 0.1)
    frame = room.along(scenery, (0.9, width, 0.8), CLEARANCE_M)
    if frame is not None:
        scenery.add("knowrob:Sofa-PieceOfFurniture", (0.9, width, 0.8), frame, 0.0)
    _shelves(scenery, room, scenery.between(0.6, 1.0, 0.1), ("knowrob:BookCopy",))
    _closet(scenery, room, "ms:GlassCupboard", (0.4, 0.8, 1.4), Front.DOUBLE)
    frame = room.in_the_middle(scenery, 0.6, 1.0, 0.5)
    if frame is not None:
        scenery.add("knowrob:CoffeeTable-PieceOfFurniture", (0.6, 1.0, 0.42), frame, 0.0)
        _surface(scenery, frame, 0.42, 0.5, 0.9, _LIVING)
    _table(scenery, room, "knowrob:Table-PieceOfFurniture", _TABLEWARE)
    _stand(scenery, room, "ms:FloorLamp", mobility=Mobility.STATIC)


def _bed(scenery: Scenery, room: Room) -> None:
    width = scenery.random.choice((0.95, 1.45, 1.65, 1.85))
    frame = room.along(scenery, (2.05, width, 0.8), 0.6)
    if frame is not None:
        scenery.add("knowrob:Bed-PieceOfFurniture", (2.05, width, 0.8), frame, 0.0)
    front = scenery.random.choice((Front.SLIDING, Front.DOUBLE))
    _closet(scenery, room, "ms:Wardrobe", (0.6, scenery.between(0.9, 1.6, 0.1), 2.1), front, stored="ms:LinenDrawer")
    for _ in range(2):
        _closet(
            scenery,
            room,
            "knowrob:Dresser-PieceOfFurniture",
            (0.4, 0.45, 0.5),
            Front.DRAWERS,
            on_top=_LIVING,
            clearance=0.5,
        )
    _closet(scenery, room, "knowrob:Dresser-PieceOfFurniture", (0.5, 0.9, 0.9), Front.DRAWERS, on_top=_LIVING)
    _chest(scenery, room, "knowrob:Box-Container", (0.5, 0.9, 0.5), "ms:LinenDrawer")


def _bath(scenery: Scenery, room: Room) -> None:
    size = (0.5, scenery.random.choice((0.6, 0.8)), 0.62)
    frame = room.along(scenery, (0.58, size[1], 1.9), KITCHEN_CLEARANCE_M, gap=_FILLER_M)
    if frame is not None:
        frame = frame.at(-0.04, 0.0)
        unit = _cabinet(scenery, "ms:SinkCupboard", size, frame, grip=Grip.KNOB)
        unit.close(Front.DOUBLE)
        unit.shelves(1, "ms:SinkCupboard")
        scenery.add("knowrob:Sink", (0.52, size[1], 0.22), frame.at(0.01, 0.0), size[2])
        cabinet = frame.at(-0.17, 0.0)
        cls = "ms:MedicineCabinet"
        unit = _cabinet(scenery, cls, (0.16, size[1], 0.6), cabinet, base=1.25, plinth=0.0, grip=Grip.NONE)
        unit.close(scenery.random.choice((Front.LEFT, Front.RIGHT)))
        unit.shelves(3, cls)
    frame = room.along(scenery, (0.6, 0.6, 0.85), CLEARANCE_M)
    if frame is not None:
        scenery.add("knowrob:ClothesWasher", (0.6, 0.6, 0.85), frame, 0.0)
        _surface(scenery, frame, 0.85, 0.5, 0.5, _BATH)
    frame = room.along(scenery, (0.75, 1.7, 0.56), 0.6)
    if frame is not None:
        scenery.add("knowrob:Bathtub", (0.75, 1.7, 0.56), frame, 0.0)
    _stand(scenery, room, "ms:LaundryBasket")
    _closet(scenery, room, "ms:BroomCupboard", (0.4, 0.5, 1.9), Front.RIGHT, stored="ms:LinenDrawer")


def _office(scenery: Scenery, room: Room) -> None:
    for _ in range(2 if room.rect[2] - room.rect[0] < 4 else 4):
        _desk(scenery, room)
        _closet(scenery, room, "knowrob:Dresser-PieceOfFurniture", (0.55, 0.43, 0.6), Front.DRAWERS, clearance=0.6)
    _shelves(scenery, room, scenery.between(0.8, 1.2, 0.1), ("knowrob:BookCopy",))
    front = scenery.random.choice((Front.SLIDING, Front.DOUBLE))
    _closet(scenery, room, "ms:TallCupboard", (0.45, 1.0, 1.95), front, stored="ms:Bookshelf")
    _stand(scenery, room, "knowrob:WasteBasket")


def _lab(scenery: Scenery, room: Room) -> None:
    for _ in range(3):
        modules = [(kind, scenery.random.choice((0.6, 0.9))) for kind in ("drawers", "double", "left", "drawers")]
        width = round(sum(each for _, each in modules), 4)
        frame = room.along(scenery, (0.66, width, 0.9), KITCHEN_CLEARANCE_M, gap=_FILLER_M)
        if frame is not None:
            across = -width / 2
            for kind, each in modules:
                at = frame.at(-0.03, across + each / 2)
                _base_unit(scenery, kind, (0.6, each, 0.87), at, scenery.random.choice((Grip.BAR, Grip.RECESS)))
                scenery.add("knowrob:CounterTop", (0.64, each, 0.03), at.at(0.02, 0.0), 0.87)
                _surface(scenery, at, 0.9, 0.5, each - 0.08, _LAB)
                across += each
    frame = room.in_the_middle(scenery, 0.9, 1.8, KITCHEN_CLEARANCE_M)
    if frame is not None:
        scenery.add("knowrob:Table-PieceOfFurniture", (0.9, 1.8, 0.9), frame, 0.0)
        _surface(scenery, frame, 0.9, 0.8, 1.7, _LAB)
    _closet(scenery, room, "ms:TallCupboard", (0.5, 1.0, 1.95), Front.SLIDING, stored="ms:PantryCupboard")
    _tall(scenery, room, "fridge", Grip.BAR)
    _chest(scenery, room, "knowrob:Box-Container", (0.6, 1.0, 0.85), "knowrob:Refrigerator-Freezer")


def _shop(scenery: Scenery, room: Room) -> None:
    frame = room.along(scenery, (0.7, 1.6, 0.95), KITCHEN_CLEARANCE_M)
    if frame is not None:
        unit = _cabinet(scenery, "ms:DrawerCupboard", (0.6, 1.6, 0.91), frame, grip=Grip.KNOB)
        unit.drawers(unit.split(3), ["knowrob:Drawer"] * 3, framed=True)
        scenery.add("knowrob:CounterTop", (0.64, 1.6, 0.04), frame.at(0.02, 0.0), 0.91)
        _surface(scenery, frame, 0.95, 0.5, 1.4, ("knowrob:SnackFood", "knowrob:Drink"))
    for _ in range(2):
        _tall(scenery, room, "fridge", Grip.BAR)
        _chest(
            scenery,
            room,
            "knowrob:Box-Container",
            (0.7, scenery.between(1.0, 1.6, 0.1), 0.9),
            "knowrob:Refrigerator-Freezer",
        )
    for number in range(10):
        _shelves(scenery, room, scenery.random.choice((1.0, 1.25)), _GOODS, middle=number % 3 == 2)


def _hall(scenery: Scenery, room: Room) -> None:
    _closet(
        scenery,
        room,
        "knowrob:Cabinet-PieceOfFurniture",
        (0.18, 0.6, 0.9),
        Front.LEFT,
        clearance=0.6,
        on_top=("ms:PottedPlant",),
    )


_FURNISHERS: MappingProxyType[RoomKind, Callable[[Scenery, Room], None]] = MappingProxyType(
    {
        RoomKind.KITCHEN: _kitchen,
        RoomKind.LIVING: _living,
        RoomKind.BED: _bed,
        RoomKind.BATH: _bath,
        RoomKind.OFFICE: _office,
        RoomKind.LAB: _lab,
        RoomKind.SHOP: _shop,
        RoomKind.HALL: _hall,
    }
)


# -- things ------------------------------------------------------------------------------------------------------------


def fill_spaces(scenery: Scenery, clutter: float) -> None:
    """Puts things into all spaces, in rows from the back to the front."""
    for space in scenery.spaces:
        classes = space.classes or scenery.household.leaves(class_iri("ms:DryGoods"))
        _fill(scenery, space, classes, min(0.4 * clutter, 0.95))


def _fill(scenery: Scenery, space: Space, classes: tuple[Iri, ...], share: float) -> None:
    """Puts things into a space until a share of its width is used in each row."""
    back = -space.depth / 2
    while back < space.depth / 2:
        across, deepest = -space.width / 2, 0.0
        misses = 0
        while misses < _MAX_MISSES_COUNT:
            cls = scenery.random.choice(classes)
            scale = scenery.random.uniform(0.9, 1.1)
            typical = scenery.household.size(cls)
            depth, width, height = (round(each * scale, 3) for each in typical)
            gap = _THING_GAP_M + scenery.random.expovariate(share / (1 - share)) * width
            fits = height <= space.height and back + depth <= space.depth / 2
            if not fits or across + gap + width > space.width / 2:
                misses += 1
                continue
            frame = space.frame.at(back + depth / 2, across + gap + width / 2)
            scenery.add(cls, (depth, width, height), frame, space.bottom, mobility=Mobility.DYNAMIC)
            across += gap + width
            deepest = max(deepest, depth)
        back += max(deepest, 0.08) + _THING_GAP_M
