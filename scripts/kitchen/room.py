"""The room and its fixed furniture: 4.5 m by 3.6 m, origin at the center of the floor, y points north.

The main run of cabinets with a window is on the north wall, a sideboard on the west wall, a dresser on the east wall.
The door is in the south wall and the table in the middle.
"""

from __future__ import annotations

from kitchen.furniture import QUARTER_TURN, TALL_HANDLE, WIDE_HANDLE, Cabinet, Hinge, cabinet
from kitchen.model import Body, BodyType, Frame, Mobility, Motion, Scene

__all__ = ["build_room"]

# The frame of each run is at the middle of its wall and faces into the room.
NORTH = Frame(0, 1800, 3)
WEST = Frame(-2250, 0, 0)
EAST = Frame(2250, 0, 2)
SOUTH = Frame(0, -1800, 1)

PLINTH = 100
COUNTER = 860
"""Height of the lower side of the counter tops [mm]."""
WALL_UNITS = 1400


def build_room(scene: Scene) -> None:
    """Adds everything except the movable items."""
    build_shell(scene)
    build_tall_units(scene)
    build_main_run(scene)
    build_sink(scene)
    build_wall_units(scene)
    build_sideboard(scene)
    build_dresser(scene)
    build_table(scene)
    build_lights(scene)


def against(run: Frame, depth: int, middle: int, *, gap: int = 0) -> Frame:
    """Returns the frame of a body of a given depth with its back to the wall of a run."""
    x, y = run.at(gap + depth / 2, middle)
    return Frame(x, y, run.turns)


def build_shell(scene: Scene) -> None:
    """Adds floor, walls, window and door."""

    def wall(id: str, run: Frame, middle: int, width: int, bottom: int = 0, top: int = 2500) -> Body:
        size = (100, width, top - bottom)
        body_type = BodyType(f"WallW{width // 10}H{size[2] // 10}", "knowrob:WallOfAConstruction", size)
        return scene.build(id, body_type, against(run, 100, middle, gap=-100), bottom)

    scene.build("floor", BodyType("TiledFloor", "knowrob:Floor", (4700, 3800, 100)), Frame(0, 0), -100)
    wall("north_wall_west", NORTH, -750, 3200)
    wall("north_wall_east", NORTH, 2000, 700)
    wall("north_wall_below_window", NORTH, 1250, 800, top=1100)
    wall("north_wall_above_window", NORTH, 1250, 800, bottom=2100)
    wall("west_wall", WEST, 0, 3600)
    wall("east_wall", EAST, 0, 3600)
    wall("south_wall_west", SOUTH, 625, 3450)
    beside_door = wall("south_wall_east", SOUTH, -2175, 350)
    wall("south_wall_above_door", SOUTH, -1550, 900, bottom=2050)

    window = BodyType("KitchenWindow", "knowrob:Window", (40, 800, 1000))
    scene.build("window", window, against(NORTH, 40, 1250, gap=-70), 1100)
    sill = BodyType("KitchenWindowSill", "ms:WindowSill", (160, 780, 20))
    scene.build("window_sill", sill, against(NORTH, 160, 1250), 1080)

    # The door is in the opening of the wall, flush with it, and opens into the room.
    body_type = BodyType("RoomDoorW90H205", "ms:RoomDoor", (40, 894, 2040), 14.0)
    x, y = SOUTH.at(-20, -1550)
    door = scene.add(Body("room_door", body_type, x, y, 5 + 1020, SOUTH.turns))
    scene.fix("room_door_handle", BodyType("LatchW12", "ms:DoorLatch", (50, 120, 20), 0.3), door, 20, 350, 1050)
    Cabinet(scene, beside_door).join("room_door_hinge", door, (20, -447), door.z, Motion.SWING, -QUARTER_TURN)


def build_tall_units(scene: Scene) -> None:
    """Adds the pantry, and the fridge on top of the freezer."""
    body_type = BodyType("PantryW60H210", "ms:PantryCupboard", (600, 600, 2100))
    pantry = cabinet(scene, "pantry", body_type, NORTH, -2250)
    pantry.door("pantry_door", PLINTH, 2000, Hinge.RIGHT, handle=TALL_HANDLE, handle_height=1050)

    body_type = BodyType("FreezerW60H70", "knowrob:Refrigerator-Freezer", (600, 600, 700))
    freezer = cabinet(scene, "freezer", body_type, NORTH, -1650)
    freezer.door("freezer_door", 60, 640, Hinge.LEFT, use="ms:ApplianceDoor", thickness=30, handle_height=560)

    body_type = BodyType("FridgeW60H140", "knowrob:Refrigerator", (600, 600, 1400))
    fridge = cabinet(scene, "fridge", body_type, NORTH, -1650, 700)
    fridge.door(
        "fridge_door",
        700,
        1400,
        Hinge.LEFT,
        use="ms:ApplianceDoor",
        thickness=30,
        handle=TALL_HANDLE,
        handle_height=1150,
    )


def base_unit(scene: Scene, id: str, run: Frame, start: int, width: int) -> Cabinet:
    """Adds a cabinet for drawers below a counter top."""
    body_type = BodyType(f"DrawerCupboardW{width // 10}H86", "ms:DrawerCupboard", (600, width, COUNTER))
    return cabinet(scene, id, body_type, run, start)


def three_drawers(unit: Cabinet, stem: str, uses: tuple[str, str, str]) -> None:
    """Adds a flat drawer above two deep ones; `uses` are their classes from top to bottom."""
    unit.drawer(f"{stem}_1", 658, 200, use=uses[0])
    unit.drawer(f"{stem}_2", 379, 279, use=uses[1])
    unit.drawer(f"{stem}_3", PLINTH, 279, use=uses[2])


def double_door(unit: Cabinet, stem: str, bottom: int, height: int, handle_height: int) -> None:
    """Adds two doors that open away from each other."""
    half = unit.case.body_type.size[1] // 2
    unit.door(f"{stem}_left", bottom, height, Hinge.LEFT, width=half, handle_height=handle_height)
    unit.door(f"{stem}_right", bottom, height, Hinge.RIGHT, start=half, width=half, handle_height=handle_height)


def build_main_run(scene: Scene) -> None:
    """Adds the cabinets to the right of the fridge: drawers, oven and hob; the dishwasher is after the sink."""
    unit = base_unit(scene, "drawer_unit_left", NORTH, -1050, 500)
    unit.drawer("drawer_left_1", 718, 140, use="ms:CutleryDrawer")
    unit.drawer("drawer_left_2", 538, 180, use="ms:UtensilDrawer")
    unit.drawer("drawer_left_3", 319, 219, use="ms:LinenDrawer")
    unit.drawer("drawer_left_4", PLINTH, 219)

    body_type = BodyType("OvenPlinthW60H14", "ms:DrawerCupboard", (600, 600, 140))
    cabinet(scene, "oven_plinth", body_type, NORTH, -550).drawer("drawer_oven_1", 30, 100, use="ms:BakewareDrawer")
    oven = cabinet(scene, "oven", BodyType("OvenW60H72", "ms:ElectricOven", (600, 600, 720)), NORTH, -550, 140)
    oven.door("oven_door", 160, 540, Hinge.FOOT, use="ms:ApplianceDoor", handle=WIDE_HANDLE, handle_height=650)
    knob = BodyType("OvenKnob", "knowrob:ControlKnob", (30, 40, 40), 0.03)
    for number in range(1, 6):
        scene.fix(f"oven_knob_{number}", knob, oven.case, 300, 100 * (number - 3), 780)

    unit = base_unit(scene, "drawer_unit_right", NORTH, 50, 800)
    three_drawers(unit, "drawer_right", ("ms:CupDrawer", "ms:PotDrawer", "ms:PotDrawer"))

    body_type = BodyType("DishwasherW60H86", "knowrob:Dishwasher", (600, 600, COUNTER))
    dishwasher = cabinet(scene, "dishwasher", body_type, NORTH, 1650)
    dishwasher.door(
        "dishwasher_door", PLINTH, 758, Hinge.FOOT, use="ms:ApplianceDoor", handle=WIDE_HANDLE, handle_height=800
    )

    counter_top(scene, "counter_left", NORTH, -1050, 850)
    counter_top(scene, "counter_right", NORTH, 1650, 2250)
    hob = BodyType("HobW58", "ms:ElectricHob", (510, 580, 10))
    scene.build("hob", hob, against(NORTH, 510, -250, gap=70), COUNTER + 40)


def counter_top(scene: Scene, id: str, run: Frame, start: int, end: int) -> None:
    """Adds a slab of 40 mm that extends 40 mm beyond its cabinets."""
    body_type = BodyType(f"CounterTopW{(end - start) // 10}", "knowrob:CounterTop", (640, end - start, 40))
    scene.build(id, body_type, against(run, 640, (start + end) // 2), COUNTER)


def build_sink(scene: Scene) -> None:
    """Adds a deep sink on a cupboard, and the tap on the wall above it."""
    body_type = BodyType("SinkCupboardW80H68", "ms:SinkCupboard", (600, 800, 680))
    double_door(cabinet(scene, "sink_cupboard", body_type, NORTH, 850), "sink_cupboard_door", PLINTH, 578, 560)
    sink = BodyType("ButlerSinkW80", "knowrob:Sink", (620, 800, 220))
    scene.build("sink", sink, against(NORTH, 620, 1250), 680)
    body_type = BodyType("WallTap", "knowrob:Tap-PlumbingFixture", (220, 60, 60))
    tap = scene.build("tap", body_type, against(NORTH, 220, 1250), 980)
    lever = BodyType("WallTapLever", "ms:TapLever", (40, 40, 30), 0.1)
    scene.fix("tap_lever", lever, tap, 110, 0, tap.z)


def build_wall_units(scene: Scene) -> None:
    """Adds the wall cupboards, and the hood above the hob."""

    def unit(id: str, use: str, start: int, width: int) -> Cabinet:
        name = f"{use.partition(':')[2]}W{width // 10}H70"
        return cabinet(scene, id, BodyType(name, use, (350, width, 700)), NORTH, start, WALL_UNITS)

    spices = unit("spice_cupboard", "ms:SpiceCupboard", -1050, 500)
    spices.door("spice_cupboard_door", WALL_UNITS, 700, Hinge.LEFT, handle_height=1520)
    scene.build("hood", BodyType("HoodW60", "ms:CookerHood", (500, 600, 450)), against(NORTH, 500, -250), 1650)
    crockery = unit("crockery_cupboard", "ms:CrockeryCupboard", 50, 800)
    double_door(crockery, "crockery_cupboard_door", WALL_UNITS, 700, 1520)
    glasses = unit("glass_cupboard", "ms:GlassCupboard", 1650, 600)
    glasses.door("glass_cupboard_door", WALL_UNITS, 700, Hinge.LEFT, handle_height=1520)


def build_sideboard(scene: Scene) -> None:
    """Adds drawers and a cupboard under one counter top, a microwave on it and a shelf above."""
    unit = base_unit(scene, "drawer_unit_south", WEST, -1500, 600)
    three_drawers(unit, "drawer_south", ("ms:LinenDrawer", "knowrob:Drawer", "knowrob:Drawer"))
    body_type = BodyType("BaseCupboardW60H86", "ms:BaseCupboard", (600, 600, COUNTER))
    double_door(cabinet(scene, "base_cupboard", body_type, WEST, -900), "base_cupboard_door", PLINTH, 758, 740)
    unit = base_unit(scene, "drawer_unit_middle", WEST, -300, 600)
    unit.drawer("drawer_middle_1", 658, 200, swapped_roles=True)
    unit.drawer("drawer_middle_2", 379, 279)
    unit.drawer("drawer_middle_3", PLINTH, 279)
    counter_top(scene, "counter_west", WEST, -1500, 300)

    body_type = BodyType("MicrowaveW50", "knowrob:MicrowaveOven", (380, 500, 300))
    place = against(WEST, 380, -1200, gap=40)
    microwave = Cabinet(scene, scene.build("microwave", body_type, place, COUNTER + 40))
    microwave.door("microwave_door", COUNTER + 45, 295, Hinge.LEFT, use="ms:ApplianceDoor", swapped_roles=True)
    scene.build(
        "wall_shelf", BodyType("WallShelfW120", "ms:WallShelf", (220, 1200, 30)), against(WEST, 220, -300), 1500
    )
    scene.build("wall_clock", BodyType("WallClockD30", "ms:WallClock", (40, 300, 300)), against(WEST, 40, -300), 2050)


def build_dresser(scene: Scene) -> None:
    """Adds a dresser with two drawers above two doors."""
    body_type = BodyType("DresserW90H90", "knowrob:Dresser-PieceOfFurniture", (560, 900, 900))
    dresser = cabinet(scene, "dresser", body_type, EAST, -300)
    double_door(dresser, "dresser_door", PLINTH, 558, 540)
    dresser.drawer("drawer_dresser_left", 658, 200, use="ms:LinenDrawer", width=450)
    dresser.drawer("drawer_dresser_right", 658, 200, start=450, width=450)


def build_table(scene: Scene) -> None:
    """Adds a table and four chairs."""
    body_type = BodyType("KitchenTableW140", "knowrob:KitchenTable", (800, 1400, 40))
    table = scene.build("table", body_type, Frame(-100, -550, 1), 710)
    leg = BodyType("TableLegH71", "ms:TableLeg", (60, 60, 710))
    for number, (forward, left) in enumerate(((330, 630), (330, -630), (-330, 630), (-330, -630)), start=1):
        x, y = table.frame.at(forward, left)
        scene.build(f"table_leg_{number}", leg, Frame(x, y, 1), 0, parent=table.id)

    seat = BodyType("ChairSeatH45", "knowrob:Chair-PieceOfFurniture", (420, 420, 450), 5.0)
    back = BodyType("ChairBackH45", "ms:ChairBack", (30, 420, 450), 1.2)
    places = (Frame(-450, -1060, 1), Frame(250, -1060, 1), Frame(-450, -40, 3), Frame(250, -40, 3))
    for number, place in enumerate(places, start=1):
        chair = scene.add(Body(f"chair_{number}", seat, place.x, place.y, 225, place.turns))
        x, y = place.at(-195, 0)
        scene.add(Body(f"chair_{number}_back", back, x, y, 675, place.turns, Mobility.KINEMATIC, chair.id))


def build_lights(scene: Scene) -> None:
    """Adds lamps, a radiator and a picture."""
    scene.build(
        "ceiling_light", BodyType("CeilingLightW40", "knowrob:CeilingLight", (400, 400, 60)), Frame(900, 700), 2440
    )
    scene.build(
        "pendant_lamp", BodyType("PendantLampD35", "knowrob:Lamp-Hanging", (350, 350, 250)), Frame(-100, -550), 1700
    )
    scene.build("floor_lamp", BodyType("FloorLampH160", "ms:FloorLamp", (260, 260, 1600)), Frame(-2080, -1650), 0)
    light = BodyType("UnderCabinetLightW50", "ms:UnderCabinetLight", (60, 500, 20))
    scene.build("under_cabinet_light_left", light, against(NORTH, 60, 450, gap=100), WALL_UNITS - 20)
    scene.build("under_cabinet_light_right", light, against(NORTH, 60, 1950, gap=100), WALL_UNITS - 20)
    radiator = BodyType("RadiatorW100", "ms:Radiator", (100, 1000, 600))
    scene.build("radiator", radiator, against(SOUTH, 100, 100, gap=30), 150)
    scene.build("poster", BodyType("PosterW70H50", "knowrob:Poster", (10, 700, 500)), against(EAST, 10, -900), 1300)
