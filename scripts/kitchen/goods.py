"""Movable items of the kitchen: types of food, dishes and tools, and their placement."""

from __future__ import annotations

from kitchen.model import Body, BodyType, Scene

__all__ = ["furnish"]

# name: class, depth x width x height [mm], mass [kg]
BODY_TYPES = {
    name: BodyType(name, base, size, mass)
    for name, base, size, mass in (
        ("MilkCarton", "knowrob:CowsMilk", (70, 70, 200), 1.05),
        ("OrangeJuiceCarton", "ms:OrangeJuice", (70, 90, 200), 1.05),
        ("WaterBottle", "knowrob:Water", (80, 80, 290), 1.1),
        ("ButterPack", "knowrob:Butter", (100, 76, 40), 0.25),
        ("CheeseBlock", "knowrob:Cheese", (120, 80, 50), 0.4),
        ("YogurtCup", "knowrob:Yogurt", (80, 80, 90), 0.2),
        ("HamPack", "ms:Ham", (160, 120, 30), 0.2),
        ("EggBox", "knowrob:CardboardBox-Eggs", (106, 260, 70), 0.65),
        ("LettuceHead", "ms:Lettuce", (180, 180, 140), 0.4),
        ("RedTomato", "knowrob:Tomato-Foodstuff", (70, 70, 60), 0.12),
        ("LeftoversBox", "ms:FoodStorageBox", (140, 180, 70), 0.5),
        ("FrozenPizzaBox", "ms:FrozenPizza", (280, 280, 40), 0.4),
        ("FrozenPeasBag", "ms:FrozenVegetables", (180, 100, 60), 0.45),
        ("IceCreamTub", "knowrob:IceCream", (120, 100, 110), 0.5),
        ("FlourBag", "knowrob:WheatFlour", (80, 100, 190), 1.0),
        ("SugarBag", "knowrob:Sugar", (80, 100, 160), 1.0),
        ("RiceBag", "knowrob:Rice", (80, 120, 200), 1.0),
        ("PastaBox", "knowrob:Pasta", (60, 140, 220), 0.5),
        ("CerealBox", "knowrob:BreakfastCereal", (80, 190, 300), 0.5),
        ("TomatoCan", "ms:CannedTomatoes", (76, 76, 110), 0.48),
        ("BeanCan", "ms:CannedBeans", (76, 76, 110), 0.46),
        ("CoffeePack", "ms:GroundCoffee", (70, 100, 180), 0.5),
        ("OilBottle", "ms:OliveOil", (70, 70, 290), 0.95),
        ("HoneyJar", "ms:Honey", (80, 80, 110), 0.7),
        ("JamJar", "knowrob:Jam-Foodstuff", (70, 70, 96), 0.55),
        ("PaprikaJar", "ms:Paprika", (50, 50, 100), 0.12),
        ("OreganoJar", "knowrob:Oregano", (50, 50, 100), 0.08),
        ("CocoaTin", "knowrob:Cocoa-ThePowder", (80, 80, 140), 0.3),
        ("SaltBox", "knowrob:TableSalt", (60, 100, 160), 0.55),
        ("BreadLoaf", "knowrob:LoafOfBread", (120, 240, 100), 0.75),
        ("Roll", "ms:BreadRoll", (80, 70, 60), 0.06),
        ("RedApple", "knowrob:Apple", (76, 76, 70), 0.18),
        ("NavelOrange", "ms:Orange", (80, 80, 76), 0.2),
        ("YellowLemon", "ms:Lemon", (60, 80, 58), 0.1),
        ("RedWineBottle", "knowrob:RedWine", (80, 80, 300), 1.25),
        ("TableFork", "knowrob:DinnerFork", (196, 26, 16), 0.05),
        ("DinnerKnife", "knowrob:TableKnife", (226, 22, 14), 0.08),
        ("TableSpoon", "knowrob:SoupSpoon", (196, 42, 16), 0.06),
        ("CoffeeSpoon", "knowrob:Teaspoon", (136, 30, 14), 0.03),
        ("WoodenSpoonLong", "knowrob:WoodenSpoon", (300, 50, 20), 0.04),
        ("BalloonWhisk", "knowrob:WireWhisk", (270, 60, 60), 0.1),
        ("WideSpatula", "knowrob:Spatula", (310, 80, 20), 0.12),
        ("TinOpener", "knowrob:CanOpener", (180, 50, 30), 0.15),
        ("WaiterCorkscrew", "ms:Corkscrew", (120, 50, 24), 0.1),
        ("Plate", "knowrob:DinnerPlate", (260, 260, 24), 0.6),
        ("SmallPlate", "ms:DessertPlate", (190, 190, 20), 0.35),
        ("CerealBowl", "knowrob:Bowl-Eating", (160, 160, 70), 0.35),
        ("CoffeeMug", "knowrob:DrinkingMug", (84, 84, 96), 0.32),
        ("Tumbler", "knowrob:DrinkingGlass", (72, 72, 120), 0.25),
        ("TallWineGlass", "ms:WineGlass", (80, 80, 200), 0.18),
        ("SmallSaucepan", "ms:Saucepan", (180, 180, 110), 1.2),
        ("SaucepanLid", "ms:PotLid", (176, 176, 30), 0.35),
        ("LargeStockPot", "ms:StockPot", (240, 240, 160), 2.2),
        ("FryingPan", "knowrob:Skillet", (280, 280, 50), 1.3),
        ("LargeMixingBowl", "knowrob:Bowl-Mixing", (260, 260, 130), 0.6),
        ("SteelColander", "knowrob:Colander", (240, 240, 110), 0.45),
        ("OvalCasserole", "ms:CasseroleDish", (220, 320, 90), 1.8),
        ("WideBakingTray", "ms:BakingTray", (360, 440, 24), 0.9),
        ("WashingUpLiquid", "knowrob:DishwashingSoap", (60, 90, 220), 0.6),
        ("TabletBox", "ms:DishwasherTablets", (100, 160, 180), 0.9),
        ("KitchenSponge", "knowrob:Sponge-CleaningImplement", (70, 110, 40), 0.02),
        ("FoldedTeaTowel", "ms:TeaTowel", (200, 200, 40), 0.12),
        ("FoldedTablecloth", "knowrob:TableCloth", (300, 340, 40), 0.5),
        ("PairOfPlaceMats", "knowrob:PlaceMat", (300, 420, 14), 0.2),
        ("WovenBreadbasket", "ms:Breadbasket", (260, 400, 150), 0.6),
        ("WideFruitBowl", "ms:FruitBowl", (300, 320, 120), 0.9),
        ("OakBoard", "knowrob:CuttingBoard", (240, 380, 20), 1.3),
        ("SerratedKnife", "ms:BreadKnife", (30, 320, 18), 0.15),
        ("BeechKnifeBlock", "ms:KnifeBlock", (120, 160, 220), 2.0),
        ("RoundSaltShaker", "ms:SaltShaker", (46, 46, 90), 0.15),
        ("WoodenPepperMill", "ms:PepperMill", (56, 56, 180), 0.25),
        ("KitchenRoll", "knowrob:PaperTowel", (120, 120, 250), 0.3),
        ("WaterKettle", "ms:ElectricKettle", (160, 220, 250), 1.1),
        ("TwinToaster", "ms:Toaster", (180, 300, 190), 1.5),
        ("FilterCoffeeMaker", "knowrob:CoffeeMaker", (250, 200, 340), 2.5),
        ("BasilPot", "ms:PottedPlant", (110, 110, 180), 0.6),
        ("GlassVase", "knowrob:Vase", (120, 120, 260), 0.9),
        ("KitchenRadio", "ms:Radio", (90, 220, 130), 0.8),
        ("ThickCookbook", "ms:Cookbook", (190, 44, 250), 0.9),
        ("TeaTin", "ms:TeaCaddy", (90, 90, 140), 0.2),
        ("BiscuitJar", "ms:CookieJar", (130, 130, 190), 0.9),
        ("StepOnBin", "ms:PedalBin", (300, 300, 500), 2.5),
    )
}

# container: height of its floor and shelves above its own bottom [mm], items on each of them from left to right
INSIDE = {
    "fridge": {
        20: "LettuceHead RedTomato RedTomato LeftoversBox",
        420: "EggBox ButterPack CheeseBlock",
        800: "MilkCarton MilkCarton OrangeJuiceCarton YogurtCup YogurtCup",
    },
    "freezer": {20: "FrozenPizzaBox FrozenPeasBag IceCreamTub"},
    "pantry": {
        120: "WaterBottle WaterBottle OilBottle HoneyJar",
        720: "TomatoCan TomatoCan BeanCan CoffeePack CerealBox",
        1120: "FlourBag SugarBag RiceBag PastaBox",
    },
    "drawer_left_1": {20: "TableFork TableFork DinnerKnife DinnerKnife TableSpoon TableSpoon CoffeeSpoon CoffeeSpoon"},
    "drawer_left_2": {20: "WoodenSpoonLong BalloonWhisk WideSpatula TinOpener WaiterCorkscrew"},
    "drawer_left_3": {20: "FoldedTeaTowel FoldedTeaTowel"},
    "drawer_oven_1": {20: "WideBakingTray"},
    "oven": {100: "OvalCasserole"},
    "drawer_right_1": {20: "CoffeeMug CoffeeMug CoffeeMug"},
    "drawer_right_2": {20: "LargeStockPot FryingPan"},
    "drawer_right_3": {20: "LargeMixingBowl SteelColander"},
    "sink_cupboard": {20: "WashingUpLiquid TabletBox KitchenSponge"},
    "sink": {20: "SmallPlate CerealBowl"},
    "dishwasher": {140: "Plate Tumbler Tumbler"},
    "spice_cupboard": {20: "PaprikaJar OreganoJar CocoaTin SaltBox", 340: "JamJar JamJar"},
    "crockery_cupboard": {20: "Plate CerealBowl CerealBowl", 340: "SmallPlate SmallPlate"},
    "glass_cupboard": {20: "TallWineGlass TallWineGlass Tumbler Tumbler"},
    "drawer_south_1": {20: "PairOfPlaceMats"},
    "base_cupboard": {120: "KitchenRoll KitchenRoll"},
    "drawer_dresser_left": {20: "FoldedTablecloth"},
    "microwave": {20: "CerealBowl"},
}

# support surface: type, distance from its center to the front and to the right [mm]
ON_TOP = {
    "floor": (("StepOnBin", 700, -1600),),
    "counter_left": (
        ("BeechKnifeBlock", -180, -850),
        ("OakBoard", 60, -700),
        ("KitchenRoll", -200, 250),
        ("RoundSaltShaker", -180, 400),
        ("WoodenPepperMill", -180, 500),
        ("WideFruitBowl", -60, 760),
    ),
    "hob": (("SmallSaucepan", -110, -130), ("FryingPan", 90, 120)),
    "counter_right": (("WashingUpLiquid", -200, -220), ("KitchenSponge", -60, -210), ("FoldedTeaTowel", 0, 100)),
    "window_sill": (("BasilPot", 0, -200),),
    "counter_west": (
        ("FilterCoffeeMaker", -150, -200),
        ("WaterKettle", -170, 50),
        ("TwinToaster", -180, 330),
        ("WovenBreadbasket", -140, 690),
    ),
    "wall_shelf": (
        ("ThickCookbook", 0, -500),
        ("ThickCookbook", 0, -440),
        ("ThickCookbook", 0, -380),
        ("TeaTin", 0, -100),
        ("BiscuitJar", 0, 60),
        ("KitchenRadio", 0, 400),
    ),
    "table": (
        ("Plate", -250, 350),
        ("TableFork", -250, 190),
        ("DinnerKnife", -250, 510),
        ("Tumbler", -60, 480),
        ("Plate", -250, -350),
        ("TableFork", -250, -510),
        ("DinnerKnife", -250, -190),
        ("Tumbler", -60, -220),
        ("WaterBottle", 60, 0),
        ("CoffeeMug", 220, 350),
        ("JamJar", 150, -300),
    ),
    "dresser": (("GlassVase", -60, 0), ("RedWineBottle", -120, -320), ("RedWineBottle", -120, -200)),
    "small_saucepan_1": (("SaucepanLid", 0, 0),),
    "oak_board_1": (("SerratedKnife", 60, 0),),
}

# Contents of movable containers.
IN_BOWLS = {
    "wide_fruit_bowl_1": {20: "RedApple RedApple NavelOrange"},
    "woven_breadbasket_1": {20: "BreadLoaf Roll"},
}

WALL = 20
"""Free space along the walls of a container [mm]."""


def furnish(scene: Scene) -> None:
    """Adds all movable items."""
    for container, shelves in INSIDE.items():
        fill(scene, container, shelves)
    for surface, goods in ON_TOP.items():
        for name, forward, left in goods:
            scene.put(BODY_TYPES[name], scene.bodies[surface], forward, left)
    for container, shelves in IN_BOWLS.items():
        fill(scene, container, shelves)


def fill(scene: Scene, container: str, shelves: dict[int, str]) -> None:
    """Places items side by side on the shelves of a container."""
    for level, names in shelves.items():
        row(scene, scene.bodies[container], level, [BODY_TYPES[name] for name in names.split()])


def row(scene: Scene, container: Body, level: int, body_types: list[BodyType]) -> None:
    """Places items side by side with equal gaps.

    Raises:
        ValueError: they do not fit.
    """
    width = container.body_type.size[1] - 2 * WALL
    gap = (width - sum(body_type.size[1] for body_type in body_types)) // (len(body_types) + 1)
    if gap < 4:
        raise ValueError(f"the items at {level} mm in {container.id!r} need {4 - gap} mm more between them")
    left = WALL + gap - container.body_type.size[1] / 2
    for body_type in body_types:
        scene.put(body_type, container, 0, left + body_type.size[1] / 2, level=level)
        left += body_type.size[1] + gap
