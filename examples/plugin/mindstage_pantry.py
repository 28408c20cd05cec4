"""A plug-in of Mindstage: one question, skill, engine, dialect, format, verb and sensor, declared in pyproject.toml.

pip install examples/plugin
mindstage plugins
mindstage ask how long does the milk keep --map bundled:kitchen
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from mindstage.cli.options import ExitCode, MapArgument
from mindstage.engines import Engine, EngineFactory, EngineSettings, NullEngine
from mindstage.errors import SourceParseError
from mindstage.files import atomic_write
from mindstage.knowledge.questions import AnswerRow, IndividualName, QuestionContext, question
from mindstage.maps.dialects.source_map import Dialect, SourceMap
from mindstage.maps.io.formats import WorldFormat, WrittenWorld
from mindstage.rdf.graphs import local_name
from mindstage.robots.robot import Robot
from mindstage.robots.sensors import Sensor
from mindstage.robots.skill_declaration import SkillMotion, SkillNeed, skill
from mindstage.robots.skill_task import SkillTask
from mindstage.scene import Body, BodyId, BodyPhysics, Iri, IriRef, Literal, Mobility, Pose, World
from mindstage.scene.edits import SetPoses

NAMESPACE = "https://pantry.example/vocabulary#"
DAYS = {"CowsMilk": 7, "Milk": 7, "Juice": 14, "Bread": 3}


# -- a question --------------------------------------------------------------------------------------------------------


class ShelfLife(AnswerRow, frozen=True, kw_only=True):
    """How long a thing keeps."""

    thing: IndividualName
    days: int
    """At the temperature at which it is sold [d]."""


@question(sentences=("how long does {thing} keep",))
def shelf_life(kb: QuestionContext, thing: IndividualName | None = None) -> Iterator[ShelfLife]:
    """How long food keeps.

    Examples:
        shelf_life milk_carton_1
    """
    for map in kb.maps():
        for body in kb.world(map).bodies:
            classes = (body.cls, *kb.reasoner.classes.above(body.cls))
            days = next((DAYS[name] for cls in classes if (name := local_name(cls)) in DAYS), None)
            if days is not None:
                yield ShelfLife(thing=body.iri, days=days)


# -- a skill -----------------------------------------------------------------------------------------------------------


@skill(needs=(SkillNeed.GRIPPER,))
def wave(task: SkillTask) -> SkillMotion:
    """Opens and closes the gripper twice."""
    (gripper, *_) = task.robot.model.grippers
    for opening_m in (gripper.max_opening_m, 0.0) * 2:
        with task.step("wave", f"open {gripper.name} by {opening_m:.2f} m"):
            yield from task.robot.gripping(gripper.name, opening_m)


# -- an engine ---------------------------------------------------------------------------------------------------------


class ConveyorEngine(NullEngine):
    """An engine without forces, in which what is not fixed moves along the x axis by 0.1 m/s."""

    name = "conveyor"

    def step(self, duration_s: float) -> None:
        """See `Engine`."""
        super().step(duration_s)
        loose = (body for body in self.snapshot().bodies if body.physics.mobility is Mobility.DYNAMIC)
        poses = {body.id: moved_along_x(body.pose, 0.1 * duration_s) for body in loose}
        self.apply(SetPoses(poses=poses))


def moved_along_x(pose: Pose, distance_m: float) -> Pose:
    """A pose that is moved along the x axis of the world frame."""
    x, y, z = pose.position
    return Pose((x + distance_m, y, z), pose.quaternion)


def make_conveyor(name: str, settings: EngineSettings) -> Engine:
    """The engine of that name."""
    return ConveyorEngine()


CONVEYOR = EngineFactory(("conveyor",), make_conveyor)


# -- a dialect of maps: the place of a thing is a text "x y z" ---------------------------------------------------------


def is_pantry(source_map: SourceMap) -> bool:
    """Whether a map has places of this dialect."""
    return any(fact.property == f"{NAMESPACE}place" for id in source_map.members for fact in source_map.graph[id])


def read_pantry(source_map: SourceMap) -> World:
    """Reads a map of this dialect; other statements about a thing are kept."""
    return World(iri=source_map.map, name=local_name(source_map.map), bodies=tuple(_bodies(source_map)))


def _bodies(source_map: SourceMap) -> Iterator[Body]:
    for id in source_map.members:
        facts = source_map.graph[id]
        texts = {fact.property: fact.value.text for fact in facts if isinstance(fact.value, Literal)}
        types = [fact.value.iri for fact in facts if isinstance(fact.value, IriRef) and fact.property.endswith("#type")]
        if (place := texts.get(Iri(f"{NAMESPACE}place"))) is not None:
            x, y, z = map(float, place.split())
            rest = tuple(fact for fact in facts if fact.property != f"{NAMESPACE}place")
            yield Body(id=BodyId(local_name(id)), iri=id, cls=types[0], pose=Pose((x, y, z)), facts=rest)


PANTRY = Dialect("pantry", is_pantry, read_pantry)


# -- a format of files: a line "name class x y z" for each body --------------------------------------------------------


LOOSE = BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=1.0)


def read_stock(path: Path) -> World:
    """Reads a list of things.

    Raises:
        SourceParseError: a line has another form.
    """
    bodies: list[Body] = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        try:
            name, cls, *place = line.split()
            x, y, z = map(float, place)
        except ValueError as error:
            raise SourceParseError(str(path), cause="a line is: name class x y z", line=number) from error
        iri = Iri(f"{NAMESPACE}{name}")
        bodies.append(
            Body(id=BodyId(name), iri=iri, cls=Iri(cls), pose=Pose((x, y, z)), size=(0.1, 0.1, 0.1), physics=LOOSE)
        )
    return World(iri=Iri(f"{NAMESPACE}{path.stem}"), name=path.stem, bodies=tuple(bodies))


def write_stock(written: WrittenWorld) -> tuple[str, ...]:
    """Writes a list of things."""
    places = {body: " ".join(f"{part:.3f}" for part in body.pose.position) for body in written.world.bodies}
    lines = [f"{body.id} {body.cls} {place}\n" for body, place in places.items()]
    atomic_write(written.path, "".join(lines).encode())
    return ("the list has no sizes",)


STOCK = WorldFormat(suffixes=(".stock",), title="Stock list", read=read_stock, write=write_stock)


# -- a verb ------------------------------------------------------------------------------------------------------------


def stock(map: MapArgument) -> ExitCode:
    """Count the things of a map by class."""
    import mindstage as ms

    for cls, count in Counter(local_name(body.cls) for body in ms.load(map).bodies).most_common():
        print(count, cls)
    return ExitCode.OK


# -- a sensor ----------------------------------------------------------------------------------------------------------


def weigh(robot: Robot, link: str) -> dict[str, float]:
    """The mass of what the grippers hold [kg]."""
    world = robot.session.snapshot()
    return {gripper: world.body(id).physics.mass_kg or 0.0 for gripper, id in robot.held.items()}


SCALE = Sensor("mass of what each gripper holds [kg]", weigh)
