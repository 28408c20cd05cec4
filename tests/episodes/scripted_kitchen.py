"""A scripted episode in the bundled kitchen, executed in MuJoCo, with a hand-written list of what happens in it.

A gripper (a box that is moved by commands) opens the fridge, carries a carton of milk to the table, slides a plate,
pushes a mug off the table, tips the milk over, opens a drawer, lays a fork in it, and closes both. The list states for
each event what takes part, and when it begins and ends. Where the script commands a motion, these are times of its
schedule; where physics decides (when the mug leaves the table), they are read from instruments at every 8 ms: joint
positions, the engine's contact list, and the geometry of two boxes. Nothing in this module uses the detection.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise

import numpy as np

import mindstage as ms
from mindstage.engines import Engine
from mindstage.episodes import EpisodeEventKind, EpisodeFrame
from mindstage.scene import Body, BodyId, BodyPhysics, GeometryMap, Iri, Mobility, Pose, World
from mindstage.scene.edits import Attach, Detach, SetPoses, Spawn
from mindstage.scene.transforms import quat_angle, quat_conjugate, quat_rotate, rotation_matrix

__all__ = ["Expected", "ScriptedEpisode", "kitchen_episode"]

K = EpisodeEventKind
TICK_S = 0.008
"""The instruments are read this often [s]; it is 4 steps of the physics."""
FRAME_TICKS = 4
"""A frame is recorded at every 4th tick: 31.25 Hz."""

DOOR, DRAWER, MILK, PLATE, MUG, FORK = (
    "fridge_door", "drawer_left_4", "milk_carton_2", "plate_3", "coffee_mug_4", "table_fork_3",
)  # fmt: skip
GRIPPER, UNIT, HINGE, SLIDE = "gripper", "drawer_unit_left", "fridge_door_hinge", "drawer_left_4_slide"


@dataclass(frozen=True, slots=True, kw_only=True)
class Expected:
    """One event of the list."""

    kind: EpisodeEventKind
    thing: str
    other: str | None = None
    begin_s: float
    end_s: float | None = None
    joint: str | None = None


@dataclass(slots=True)
class Log:
    """What the instruments have shown, by tick."""

    times: list[float] = field(default_factory=list)
    joints: dict[str, list[float]] = field(default_factory=dict)
    poses: dict[str, list[np.ndarray]] = field(default_factory=dict)
    contacts: list[frozenset[frozenset[str]]] = field(default_factory=list)

    def touching(self, a: str, b: str) -> Iterator[tuple[float, float]]:
        """The intervals in which the engine reports a contact of two bodies; gaps below 0.1 s do not count."""
        pair, begin, last = frozenset((a, b)), None, -math.inf
        for time_s, contacts in zip(self.times, self.contacts, strict=True):
            if pair in contacts:
                if begin is not None and time_s - last > 0.1:
                    yield begin, last
                    begin = None
                begin = time_s if begin is None else begin
                last = time_s
        if begin is not None:
            yield begin, last

    def joint_motion(self, joint: str, since: float, until: float, still: float) -> tuple[float, float]:
        """When a joint leaves its position at one time, and reaches that at another time [s]."""
        times, positions = np.array(self.times), np.array(self.joints[joint])
        first, last = np.searchsorted(times, [since, until - 1e-6])
        begin = first + int(np.argmax(np.abs(positions[first:last] - positions[first]) > still))
        end = last - int(np.argmax(np.abs(positions[first:last][::-1] - positions[last - 1]) > still))
        return float(times[begin]), float(times[end])

    def tilting(self, id: str, since: float) -> tuple[float, float]:
        """When the vertical axis of a body leaves its direction by 3 degrees, and when it comes to rest [s]."""
        first = int(np.searchsorted(self.times, since))
        poses = np.array(self.poses[id][first:])
        up = quat_rotate(quat_conjugate(poses[0, 3:]), np.array([0.0, 0.0, 1.0]))
        axes = quat_rotate(poses[:, 3:], up)
        tilted = np.flatnonzero(axes[:, 2] < math.cos(math.radians(3)))
        moving = np.flatnonzero(quat_angle(poses[:, 3:], poses[-1, 3:]) > math.radians(3))
        return self.times[first + int(tilted[0])], self.times[first + int(moving[-1]) + 1]

    def inside(self, inner: str, outer: str, sizes: dict[BodyId, tuple[float, ...]]) -> list[tuple[float, float]]:
        """The intervals in which a box has at least 80 % of another one along each axis, by sampled corners."""
        fractions = _fractions_inside(
            np.array(self.poses[inner]), sizes[BodyId(inner)], np.array(self.poses[outer]), sizes[BodyId(outer)]
        )
        holds = fractions >= 0.8
        changes = np.flatnonzero(np.diff(holds.astype(int))) + 1
        edges = [0, *changes.tolist(), len(holds)]
        return [
            (self.times[start], self.times[end] if end < len(holds) else math.inf)
            for start, end in pairwise(edges)
            if holds[start]
        ]


def _fractions_inside(
    inner: np.ndarray, inner_size: tuple[float, ...], outer: np.ndarray, outer_size: tuple[float, ...]
) -> np.ndarray:
    """The least fraction of the inner box's extent along an axis of the outer box that is within the outer box."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = inner[:, None, :3] + quat_rotate(inner[:, None, 3:], signs * np.array(inner_size) / 2)
    local = (corners - outer[:, None, :3]) @ rotation_matrix(outer[:, 3:])
    low, high, half = local.min(axis=1), local.max(axis=1), np.array(outer_size) / 2
    return np.asarray(((np.minimum(high, half) - np.maximum(low, -half)) / (high - low)).min(axis=1))


@dataclass(frozen=True, slots=True)
class ScriptedEpisode:
    """The frames, the geometry of the bodies, and what happens."""

    frames: tuple[EpisodeFrame, ...]
    geometry: GeometryMap
    expected: tuple[Expected, ...]
    log: Log


def smooth(share: float) -> float:
    """A minimum-jerk profile from 0 to 1 (Flash and Hogan 1985)."""
    x = min(max(share, 0.0), 1.0)
    return x**3 * (10 - 15 * x + 6 * x * x)


class Stage:
    """Runs the script, tick by tick."""

    def __init__(self, engine: Engine) -> None:
        gripper = Body(
            id=BodyId(GRIPPER),
            iri=Iri("http://example.org/script#gripper"),
            cls=Iri("http://example.org/script#Gripper"),
            pose=Pose((0.0, 0.6, 1.4)),
            size=(0.06, 0.06, 0.06),
            physics=BodyPhysics(mobility=Mobility.KINEMATIC, gravity=False),
        )
        engine.apply(Spawn(World(iri=Iri("http://example.org/script"), bodies=(gripper,))))
        self.engine = engine
        self.log = Log()
        self.frames: list[EpisodeFrame] = []
        self.structure = engine.snapshot()
        self.ids, _ = engine.poses()
        self.row = {id: row for row, id in enumerate(self.ids)}
        self.start_s = engine.time_s
        self.place = np.array([0.0, 0.6, 1.4])
        self.watched = (DOOR, DRAWER, MILK, PLATE, MUG, FORK, GRIPPER, "fridge", UNIT)
        _, self.first_poses = engine.poses()
        self.read()

    @property
    def now(self) -> float:
        """Time since the begin of the episode [s]."""
        return self.engine.time_s - self.start_s

    def read(self) -> None:
        """Reads the instruments, and records a frame if one is due."""
        poses, contacts = self.engine.poses()[1], self.engine.contacts()
        joints = self.joint_positions(poses)
        if len(self.log.times) % FRAME_TICKS == 0:
            self.frames.append(
                EpisodeFrame(
                    time_s=self.now,
                    structure=self.structure,
                    ids=self.ids,
                    poses=poses,
                    joint_positions=joints,
                    contacts=contacts,
                )
            )
        self.log.times.append(self.now)
        for name, position in joints.items():
            self.log.joints.setdefault(name, []).append(sum(position))
        for id in self.watched:
            self.log.poses.setdefault(id, []).append(poses[self.row[BodyId(id)]].copy())
        self.log.contacts.append(frozenset(frozenset((each.a, each.b or "")) for each in contacts))

    def joint_positions(self, poses: np.ndarray) -> dict[BodyId, tuple[float, ...]]:
        """The positions of the two joints of the script, as the engine states them; all of them take it 8 ms."""
        row, first = self.row[BodyId(DOOR)], self.first_poses
        w, _, _, z = (poses[row, 3:] * np.sign(poses[row, 3])).tolist()
        w0, _, _, z0 = (first[row, 3:] * np.sign(first[row, 3])).tolist()
        turn = 2 * (math.atan2(z, w) - math.atan2(z0, w0))
        row = self.row[BodyId(DRAWER)]
        shift = float(first[row, 1] - poses[row, 1])
        zeros = (0.0, 0.0, 0.0, 0.0, 0.0)
        return {BodyId(HINGE): (*zeros, turn), BodyId(SLIDE): (shift, *zeros)}

    def run(self, duration_s: float, act: Callable[[float], None] = lambda share: None) -> None:
        """Runs for a time, with an action before each tick that takes the share of the time that has passed."""
        ticks = round(duration_s / TICK_S)
        for tick in range(ticks):
            act((tick + 1) / ticks)
            self.engine.step(TICK_S)
            self.read()

    def until(self, time_s: float) -> None:
        """Waits until a time of the schedule."""
        self.run(time_s - self.now)

    def move(self, target: tuple[float, float, float], duration_s: float) -> None:
        """Moves the gripper on a straight line at a constant speed."""
        start, end = self.place, np.array(target)

        def act(share: float) -> None:
            self.place = start + share * (end - start)
            x, y, z = self.place.tolist()
            self.engine.apply(SetPoses({BodyId(GRIPPER): Pose((x, y, z))}))

        self.run(duration_s, act)

    def descend(self, target: tuple[float, float, float]) -> tuple[float, float]:
        """Moves the gripper down at about 0.25 m/s; returns when it is there, and the speed [m/s]."""
        height = float(self.place[2]) - target[2]
        duration_s = round(height / 0.25 / TICK_S) * TICK_S
        x, y, _ = target
        self.move((x, y, float(self.place[2])), TICK_S)
        self.move(target, duration_s)
        return self.now, height / duration_s

    def attach(self, thing: str) -> None:
        self.engine.apply(Attach(BodyId(GRIPPER), BodyId(thing)))
        self.structure = self.engine.snapshot()

    def detach(self, thing: str) -> None:
        self.engine.apply(Detach(BodyId(thing)))
        self.structure = self.engine.snapshot()

    def pull(self, handle: str, target: Callable[[float], np.ndarray], duration_s: float, stiffness: float) -> None:
        """Pulls a handle by a spring and a damper along a path, and for half a second at its end."""
        id, before = BodyId(handle), None

        def act(share: float) -> None:
            nonlocal before
            held = self.engine.poses()[1][self.row[id], :3]
            velocity = np.zeros(3) if before is None else (held - before) / TICK_S
            before = held
            force = stiffness * (target(smooth(share * (duration_s + 0.5) / duration_s)) - held)
            force -= 2 * (stiffness * 6.0) ** 0.5 * velocity
            self.engine.apply_force(id, (float(force[0]), float(force[1]), float(force[2])))

        self.run(duration_s + 0.5, act)


@cache
def kitchen_episode() -> ScriptedEpisode:
    """Executes the script once; the result is shared by the tests."""
    with ms.open("bundled:kitchen") as simulation:
        simulation.step(3.0)  # the food comes to rest
        geometry = dict(simulation.geometry)
        engine = simulation.engine.run(lambda engine: engine.fork())
    stage = Stage(engine)
    try:
        expected = tuple(perform(stage))
    finally:
        engine.close()
    return ScriptedEpisode(tuple(stage.frames), geometry, expected, stage.log)


def perform(stage: Stage) -> Iterator[Expected]:
    """Plays the script and yields what happens, in the order in which it is scheduled."""
    sizes = {body.id: body.size or (0.0, 0.0, 0.0) for body in stage.structure.bodies}
    yield from open_fridge(stage)
    yield from carry_milk(stage)
    yield from slide_plate(stage)
    yield from push_mug_off(stage)
    yield from tip_milk(stage)
    yield from open_drawer(stage)
    yield from lay_fork_into_drawer(stage)
    yield from close_drawer_and_fridge(stage)
    yield from containment(stage.log, sizes)


def around_hinge(stage: Stage, turn: float) -> Callable[[float], np.ndarray]:
    """The path of the handle of the fridge's door, as it turns by an angle [rad]."""
    hinge = np.array([-1.6485, 1.168])
    arm = stage.engine.poses()[1][stage.row[BodyId("fridge_door_handle")], :3].copy()
    radius, angle = float(np.linalg.norm(arm[:2] - hinge)), math.atan2(arm[1] - hinge[1], arm[0] - hinge[0])

    def at(share: float) -> np.ndarray:
        a = angle + turn * share
        return np.array([hinge[0] + radius * math.cos(a), hinge[1] + radius * math.sin(a), arm[2]])

    return at


def open_fridge(stage: Stage) -> Iterator[Expected]:
    """The door is pulled open by its handle, by 80 degrees."""
    stage.until(1.0)
    stage.pull("fridge_door_handle", around_hinge(stage, -math.radians(80)), 2.0, 1500.0)
    begin, end = stage.log.joint_motion(HINGE, 1.0, stage.now, 0.005)
    yield Expected(kind=K.OPEN, thing=DOOR, other="fridge", joint=HINGE, begin_s=begin, end_s=end)


def carry_milk(stage: Stage) -> Iterator[Expected]:
    """A carton of milk is carried from the fridge to the table."""
    x, y, z = stage.log.poses[MILK][-1][:3].tolist()
    stage.move((x, 0.8, z + 0.135), 0.8)
    stage.move((x, y, z + 0.135), 0.8)
    stage.run(0.4)
    grasp = stage.now
    stage.attach(MILK)
    stage.run(0.4)
    lift = stage.now
    stage.move((x, y, z + 0.235), 0.504)
    lift_speed = 0.1 / 0.504
    stage.move((x, 0.7, z + 0.235), 1.2)
    stage.move((0.40, -0.32, z + 0.235), 2.4)
    down_z = 0.75 + 0.1 + 0.135 - 0.0002
    landed, speed = stage.descend((0.40, -0.32, down_z))
    stage.run(0.4)
    release = stage.now
    stage.detach(MILK)
    stage.run(0.4)
    stage.move((0.40, -0.32, 1.4), 0.8)
    picked, put = lift + 0.05 / lift_speed, landed - 0.05 / speed
    yield Expected(kind=K.GRASP, thing=MILK, begin_s=grasp, end_s=release)
    yield Expected(kind=K.PICK_UP, thing=MILK, other="fridge", begin_s=lift, end_s=picked)
    yield Expected(kind=K.TRANSPORT, thing=MILK, other="fridge", begin_s=picked, end_s=put)
    yield Expected(kind=K.PUT_DOWN, thing=MILK, other="table", begin_s=put, end_s=landed)
    for kind in (K.CONTACT, K.SUPPORT):
        yield Expected(kind=kind, thing=MILK, other="fridge", begin_s=0.0, end_s=lift)
        yield Expected(kind=kind, thing=MILK, other="table", begin_s=landed)


def slide_plate(stage: Stage) -> Iterator[Expected]:
    """A plate is pushed along the table by 70 mm, at 0.1 m/s."""
    x, y, _ = stage.log.poses[PLATE][-1][:3].tolist()
    rim = y - 0.13 - 0.03
    stage.move((x, rim - 0.1, 1.4), 1.0)
    stage.move((x, rim - 0.1, 0.785), 0.8)
    stage.move((x, rim - 0.02, 0.785), 0.4)
    stage.move((x, rim, 0.785), 0.2)
    touch = stage.now
    stage.move((x, rim + 0.07, 0.785), 0.704)
    stop = stage.now
    stage.run(0.4)
    retreat = stage.now
    stage.move((x, rim - 0.1, 0.785), 0.4)
    stage.move((x, rim - 0.1, 1.4), 0.8)
    yield Expected(kind=K.SLIDE, thing=PLATE, other="table", begin_s=touch, end_s=stop)
    yield Expected(kind=K.CONTACT, thing=PLATE, other=GRIPPER, begin_s=touch, end_s=retreat)


def push_mug_off(stage: Stage) -> Iterator[Expected]:
    """A mug is pushed off the table at 0.25 m/s: it tips over the edge, falls to the floor and stays there."""
    x, y, _ = stage.log.poses[MUG][-1][:3].tolist()
    stage.move((x + 0.15, y, 1.4), 0.8)
    stage.move((x + 0.15, y, 0.785), 0.8)
    begin = stage.now
    stage.move((-0.8 + 0.03, y, 0.785), (x + 0.15 + 0.77) / 0.25)
    stage.run(2.0)
    log = stage.log
    [(touch, parted)] = log.touching(MUG, GRIPPER)
    left = max(end for _, end in log.touching(MUG, "table"))
    landed = min(start for start, _ in log.touching(MUG, "floor"))
    tips, lies = log.tilting(MUG, begin)
    yield Expected(kind=K.CONTACT, thing=MUG, other=GRIPPER, begin_s=touch, end_s=parted)
    yield Expected(kind=K.SLIDE, thing=MUG, other="table", begin_s=touch, end_s=tips)
    yield Expected(kind=K.TIP_OVER, thing=MUG, begin_s=tips, end_s=lies)
    yield Expected(kind=K.FALL, thing=MUG, begin_s=left, end_s=landed)
    yield Expected(kind=K.COLLISION, thing=MUG, other="floor", begin_s=landed, end_s=landed + 0.1)
    for kind in (K.CONTACT, K.SUPPORT):
        yield Expected(kind=kind, thing=MUG, other="table", begin_s=0.0, end_s=left)
        yield Expected(kind=kind, thing=MUG, other="floor", begin_s=landed)


def tip_milk(stage: Stage) -> Iterator[Expected]:
    """The milk on the table is pushed near its top, at 0.2 m/s, and tips over."""
    x, y, z = stage.log.poses[MILK][-1][:3].tolist()
    stage.move((x, y + 0.15, 1.4), 0.8)
    stage.move((x, y + 0.15, z + 0.06), 0.8)
    begin = stage.now
    stage.move((x, y - 0.02, z + 0.06), 0.85)
    stage.run(0.2)
    stage.move((x, y + 0.15, z + 0.06), 0.6)
    stage.move((x, y + 0.15, 1.4), 0.8)
    [(touch, parted)] = stage.log.touching(MILK, GRIPPER)
    tips, lies = stage.log.tilting(MILK, begin)
    yield Expected(kind=K.CONTACT, thing=MILK, other=GRIPPER, begin_s=touch, end_s=parted)
    yield Expected(kind=K.TIP_OVER, thing=MILK, begin_s=tips, end_s=lies)


def pull_drawer(stage: Stage, distance: float) -> tuple[float, float]:
    """Pulls the drawer by its handle by a distance [m]; returns when it moves and stops."""
    begin = stage.now
    handle = stage.engine.poses()[1][stage.row[BodyId(DRAWER + "_handle")], :3].copy()
    stage.pull(DRAWER + "_handle", lambda share: handle - np.array([0.0, distance * share, 0.0]), 1.6, 1500.0)
    return stage.log.joint_motion(SLIDE, begin, stage.now, 0.002)


def open_drawer(stage: Stage) -> Iterator[Expected]:
    """The drawer is pulled open by 0.42 m."""
    begin, end = pull_drawer(stage, 0.42)
    yield Expected(kind=K.OPEN, thing=DRAWER, other=UNIT, joint=SLIDE, begin_s=begin, end_s=end)


def lay_fork_into_drawer(stage: Stage) -> Iterator[Expected]:
    """A fork is carried from the table into the open drawer."""
    x, y, z = stage.log.poses[FORK][-1][:3].tolist()
    stage.move((x, y, 1.4), 0.8)
    stage.move((x, y, z + 0.043), 0.8)
    stage.run(0.2)
    grasp = stage.now
    stage.attach(FORK)
    stage.run(0.4)
    lift = stage.now
    stage.move((x, y, z + 0.343), 1.504)
    lift_speed = 0.3 / 1.504
    stage.move((-0.8, 0.95, z + 0.343), 2.0)
    drawer = stage.log.poses[DRAWER][-1]
    bottom = float(drawer[2]) + BOTTOM_M
    landed, speed = stage.descend((-0.8, 0.95, bottom + 0.008 + 0.043 - 0.0002))
    stage.run(0.4)
    release = stage.now
    stage.detach(FORK)
    stage.run(0.4)
    stage.move((-0.8, 0.95, 1.0), 1.6)
    picked, put = lift + 0.05 / lift_speed, landed - 0.05 / speed
    yield Expected(kind=K.GRASP, thing=FORK, begin_s=grasp, end_s=release)
    yield Expected(kind=K.PICK_UP, thing=FORK, other="table", begin_s=lift, end_s=picked)
    yield Expected(kind=K.TRANSPORT, thing=FORK, other="table", begin_s=picked, end_s=put)
    yield Expected(kind=K.PUT_DOWN, thing=FORK, other=DRAWER, begin_s=put, end_s=landed)
    for kind in (K.CONTACT, K.SUPPORT):
        yield Expected(kind=kind, thing=FORK, other="table", begin_s=0.0, end_s=lift)
        yield Expected(kind=kind, thing=FORK, other=DRAWER, begin_s=landed)


def close_drawer_and_fridge(stage: Stage) -> Iterator[Expected]:
    """Both are closed again by their handles."""
    begin, end = pull_drawer(stage, -0.42)
    yield Expected(kind=K.CLOSE, thing=DRAWER, other=UNIT, joint=SLIDE, begin_s=begin, end_s=end)
    start = stage.now
    stage.pull("fridge_door_handle", around_hinge(stage, math.radians(79)), 2.0, 1500.0)
    begin, end = stage.log.joint_motion(HINGE, start, stage.now, 0.005)
    yield Expected(kind=K.CLOSE, thing=DOOR, other="fridge", joint=HINGE, begin_s=begin, end_s=end)
    stage.run(0.8)


BOTTOM_M = -0.094
"""The upper side of the drawer's bottom relative to its center [m]: it is 8 mm thick and 6 mm above the lower edge."""


def containment(log: Log, sizes: dict[BodyId, tuple[float, ...]]) -> Iterator[Expected]:
    """What gets into, or out of, the fridge, the drawer, and the unit that the drawer is in."""
    changing = (
        (MILK, "fridge"), (GRIPPER, "fridge"), (DRAWER, UNIT), (GRIPPER, DRAWER), (FORK, DRAWER), (FORK, UNIT),
    )  # fmt: skip
    for inner, outer in changing:
        for begin, end in log.inside(inner, outer, sizes):
            if begin > 0.0 or math.isfinite(end):
                ends = end if math.isfinite(end) else None
                yield Expected(kind=K.CONTAINMENT, thing=inner, other=outer, begin_s=begin, end_s=ends)
