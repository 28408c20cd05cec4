"""Random scripts of a hand at a table, with the actions that they consist of, by seed.

The mechanics are those of boxes that are pushed without inertia, carried, and fall freely, in steps of a millisecond; a
contact is reported while one of its bodies has moved within half a second, as engines do whose bodies fall asleep. The
list of actions is made from the commands, and from the places and contacts of all steps, before any noise is added.
Nothing in this module uses the detection.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from mindstage.engines.base import Contact
from mindstage.episodes import EpisodeEventKind, EpisodeFrame
from mindstage.scene import Attachment, Body, BodyId, BodyPhysics, Iri, Mobility, Pose, World

__all__ = ["Action", "noisy", "script"]

K = EpisodeEventKind
TICK_S = 0.001
FRAME_TICKS = 16
SLEEP_S = 0.5
G = 9.81
TERMS = "http://example.org/script#"
TOP = 0.7
HAND = BodyId("manipulator")
HALF = 0.03
SIZES = {"cup": (0.08, 0.08, 0.1), "carton": (0.07, 0.07, 0.16), "tray": (0.24, 0.16, 0.02), "lid": (0.06, 0.06, 0.03)}


_LIFTED_M = 0.0006
"""A held thing that is higher above its support has no contact with it [m]."""


@dataclass(frozen=True, slots=True)
class Action:
    """What happens, to what, from when to when [s]."""

    kind: EpisodeEventKind
    thing: str
    begin_s: float
    end_s: float


def _body(id: str, position: tuple[float, ...], size: tuple[float, ...], mobility: Mobility) -> Body:
    return Body(
        id=BodyId(id),
        iri=Iri(TERMS + id),
        cls=Iri(TERMS + "Thing"),
        pose=Pose((position[0], position[1], position[2])),
        size=(size[0], size[1], size[2]),
        physics=BodyPhysics(mobility=mobility, mass_kg=0.3 if mobility is Mobility.DYNAMIC else None),
    )


class _Stage:
    """The running script: where everything is, what was read at each step, and the actions so far."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        places = {"cup": (-0.4, 0.1), "carton": (-0.1, -0.15), "tray": (0.3, 0.1)}
        self.at = {id: np.array((x, y, TOP + SIZES[id][2] / 2)) for id, (x, y) in places.items()}
        self.at["lid"] = np.array((0.3, 0.1, TOP + SIZES["tray"][2] + SIZES["lid"][2] / 2))
        self.hand = np.array([0.0, 0.45, 1.0])
        self.held: str | None = None
        self._world = World(
            iri=Iri(TERMS + "map"),
            bodies=(
                _body("floor", (0.0, 0.0, -0.05), (6.0, 6.0, 0.1), Mobility.STATIC),
                _body("table", (0.0, 0.0, TOP / 2), (1.6, 1.0, TOP), Mobility.STATIC),
                *(_body(id, tuple(place), SIZES[id], Mobility.DYNAMIC) for id, place in self.at.items()),
                _body(HAND, tuple(self.hand), (2 * HALF, 2 * HALF, 2 * HALF), Mobility.KINEMATIC),
            ),
        )
        self._ids = tuple(body.id for body in self._world.bodies)
        self._structure = self._world
        self._fall_m_s = dict.fromkeys(SIZES, 0.0)
        self._moved_s = dict.fromkeys((*SIZES, HAND), 0.0)
        self._last = self.at | {HAND: self.hand}
        self.frames: list[EpisodeFrame] = []
        self.times: list[float] = []
        self.places: dict[str, list[np.ndarray]] = {id: [] for id in SIZES}
        self.on_table: dict[str, list[bool]] = {id: [] for id in SIZES}
        self.actions: list[Action] = []
        self._tick = 0

    @property
    def time_s(self) -> float:
        return self._tick * TICK_S

    def _support(self, id: str) -> tuple[str, float]:
        """What is below a thing, and the height of its top."""
        x, y, z = self.at[id]
        tray = self.at["tray"]
        if id == "lid" and z > tray[2] and abs(x - tray[0]) < 0.12 and abs(y - tray[1]) < 0.08:
            return "tray", float(tray[2]) + SIZES["tray"][2] / 2
        return "table", TOP

    def _contacts(self) -> tuple[Contact, ...]:
        found: list[tuple[str, str, tuple[float, float, float]]] = []
        for id, size in SIZES.items():
            support, top = self._support(id)
            if self.at[id][2] - size[2] / 2 - top < (_LIFTED_M if id == self.held else 0.0001):
                found.append((support, id, (0.0, 0.0, 1.0)))
            gap = np.abs(self.at[id] - self.hand) - np.array(size) / 2 - HALF
            if gap.max() <= 0.0001:
                axis = int(gap.argmax())
                normal = [0.0, 0.0, 0.0]
                normal[axis] = float(np.sign(self.hand[axis] - self.at[id][axis]))
                found.append((id, HAND, (normal[0], normal[1], normal[2])))
        return tuple(
            Contact(a=BodyId(a), b=BodyId(b), position=(0.0, 0.0, 0.0), normal=normal, force_n=3.0, depth_m=0.0001)
            for a, b, normal in found
            if self.time_s - max(self._moved_s.get(a, 0.0), self._moved_s.get(b, 0.0)) < SLEEP_S
        )

    def step(self) -> None:
        """Reads everything, and goes on by a millisecond."""
        for id in SIZES:
            rest = self._support(id)[1] + SIZES[id][2] / 2
            if id != self.held and self.at[id][2] > rest:
                self._fall_m_s[id] += G * TICK_S
                z = max(float(self.at[id][2]) - self._fall_m_s[id] * TICK_S, rest)
                self.at[id] = np.array((*self.at[id][:2], z))
            else:
                self._fall_m_s[id] = 0.0
        for id, place in (self.at | {HAND: self.hand}).items():
            if (place != self._last[id]).any():
                self._moved_s[id] = self.time_s
            self._last[id] = place
        self.times.append(self.time_s)
        for id in SIZES:
            self.places[id].append(self.at[id])
            self.on_table[id].append(bool(self.at[id][2] - SIZES[id][2] / 2 - TOP < _LIFTED_M))
        if self._tick % FRAME_TICKS == 0:
            poses = np.zeros((len(self._ids), 7))
            poses[:, 3] = 1.0
            fixed = [body.pose.position for body in self._world.bodies[:2]]
            poses[:, :3] = [*fixed, *(self.at[id] for id in self.at), self.hand]
            self.frames.append(
                EpisodeFrame(
                    time_s=self.time_s,
                    structure=self._structure,
                    ids=self._ids,
                    poses=poses,
                    contacts=self._contacts(),
                )
            )
        self._tick += 1

    def wait(self, duration_s: float) -> None:
        for _ in range(round(duration_s / TICK_S)):
            self.step()

    def move(self, target: tuple[float, float, float], speed_m_s: float = 0.25) -> None:
        start, end = self.hand, np.array(target)
        count = max(round(float(np.linalg.norm(end - start)) / speed_m_s / TICK_S), 1)
        for number in range(count):
            before, self.hand = self.hand, start + (number + 1) / count * (end - start)
            shift = self.hand - before
            for id, size in SIZES.items():
                if id == self.held:
                    self._shift(id, shift)
                elif abs(shift[0]) > 0.0:
                    gap = np.abs(self.at[id] - self.hand) - np.array(size) / 2 - HALF
                    if gap.max() < 0.0 and int(gap.argmax()) == 0:
                        self._shift(id, np.array((-gap[0] * np.sign(shift[0]), 0.0, 0.0)))
            self.step()

    def _shift(self, id: str, shift: np.ndarray) -> None:
        load = id == "tray" and self._support("lid")[0] == "tray"
        for each in (id, "lid") if load else (id,):
            self.at[each] = self.at[each] + shift

    def place(self, id: str) -> np.ndarray:
        return self.at[id]

    def above(self, id: str, gap_m: float) -> tuple[float, float, float]:
        x, y, z = self.at[id].tolist()
        return x, y, z + SIZES[id][2] / 2 + HALF + gap_m

    def hold(self, id: str, *, holds: bool) -> float:
        self.held = id if holds else None
        held = (Attachment(parent=HAND, child=BodyId(id)),) if holds else ()
        self._structure = replace(self._world, attachments=held)
        self.step()
        return self.time_s

    def add(self, kind: EpisodeEventKind, thing: str, begin_s: float, end_s: float) -> None:
        self.actions.append(Action(kind, thing, begin_s, end_s))

    # -- what is acted ------------------------------------------------------------------------------------------------

    def approach(self, id: str, gap_m: float) -> None:
        x, y, z = self.above(id, gap_m)
        self.move((float(self.hand[0]), float(self.hand[1]), 1.0))
        self.move((x, y, 1.0))
        self.move((x, y, z), 0.15)

    def retreat(self) -> None:
        self.move((float(self.hand[0]), float(self.hand[1]), 1.0))

    def carry(
        self,
        id: str,
        target: tuple[float, float] | None,
        *,
        drop_m: float = 0.0,
        load_m: float = 0.0,
        leave: bool = True,
    ) -> None:
        """Picks a thing up, carries it and puts it down, or lets it fall; without a target it is put back."""
        self.approach(id, load_m + float(self.random.uniform(0.0, 0.01)))
        self.wait(0.3)
        held_s = self.hold(id, holds=True)
        start = len(self.times)
        self.wait(0.3)
        x, y, z = self.hand.tolist()
        self.move((x, y, z + 0.12))
        if target is not None:
            self.move((*target, z + 0.12))
            x, y = target
        self.move((x, y, z + drop_m + 0.0005), 0.12)
        self.wait(0.2)
        released_s = self.hold(id, holds=False)
        self.wait(float(self.random.uniform(0.3, 0.8)))
        self.add(K.GRASP, id, held_s, released_s)
        self._add_lift(id, start, released_s, is_dropped=drop_m > 0.0, is_moved=target is not None)
        if leave:
            self.retreat()

    def _add_lift(self, id: str, start: int, released_s: float, *, is_dropped: bool, is_moved: bool) -> None:
        places, times = np.array(self.places[id][start:]), np.array(self.times[start:])
        on_table = np.array(self.on_table[id][start:])
        left = int(np.flatnonzero(~on_table & (places[:, 2] > places[0, 2] + 0.0005))[0])
        away = int(np.flatnonzero(np.linalg.norm(places - places[left], axis=1) >= 0.05)[0])
        self.add(K.PICK_UP, id, times[left], times[away])
        landed = away + int(np.flatnonzero(on_table[away:])[0])
        if is_dropped:
            self.add(K.FALL, id, released_s, times[landed])
            end_s = released_s
        else:
            near = np.flatnonzero(np.linalg.norm(places[away:landed] - places[landed], axis=1) >= 0.05)
            end_s = times[away + int(near[-1])]
            self.add(K.PUT_DOWN, id, end_s, times[landed])
        if is_moved:
            self.add(K.TRANSPORT, id, times[away], end_s)

    def touch(self, id: str) -> None:
        self.approach(id, -0.0003)
        self.wait(1.0)
        self.retreat()

    def near_miss(self, id: str) -> None:
        self.approach(id, float(self.random.uniform(0.002, 0.01)))
        self.wait(0.5)
        self.retreat()

    def push(self, id: str) -> None:
        """Pushes a thing along x."""
        x, y, _ = self.place(id).tolist()
        speed, distance = float(self.random.uniform(0.005, 0.05)), float(self.random.uniform(0.05, 0.12))
        way = -1.0 if x > 0.0 else 1.0
        side = x - way * (SIZES[id][0] / 2 + HALF + 0.005)
        self.move((float(self.hand[0]), float(self.hand[1]), 1.0))
        self.move((side, y, 1.0))
        self.move((side, y, TOP + HALF + 0.005))
        self.wait(0.3)
        start = len(self.times)
        self.move((side + way * (distance + 0.005), y, TOP + HALF + 0.005), speed)
        self.wait(0.5)
        self.move((side + way * distance - way * 0.02, y, TOP + HALF + 0.005), 0.1)
        self.retreat()
        places, times = np.array(self.places[id][start:]), np.array(self.times[start:])
        begin = int(np.flatnonzero(np.abs(places[:, 0] - places[0, 0]) > 0.0005)[0])
        end = int(np.flatnonzero(np.abs(places[:, 0] - places[-1, 0]) > 0.0005)[-1])
        self.add(K.SLIDE, id, times[begin], times[end])

    def free_place(self, id: str) -> tuple[float, float]:
        """A place on the table that is far from where the thing is and from the other things."""
        others = [self.place(each)[:2] for each in SIZES if each not in {id, "lid"}]
        here = self.place(id)[:2]
        while True:
            found = self.random.uniform((-0.55, -0.3), (0.55, 0.3))
            if np.linalg.norm(found - here) > 0.2 and all(np.linalg.norm(found - each) > 0.32 for each in others):
                return float(found[0]), float(found[1])


def script(seed: int) -> tuple[list[EpisodeFrame], list[Action]]:
    """The frames of a script at 62.5 Hz without noise, and its actions."""
    stage = _Stage(seed)
    stage.wait(1.0)
    acts: list[Callable[[], None]] = [
        lambda: stage.carry("cup", stage.free_place("cup")),
        lambda: stage.carry("tray", stage.free_place("tray"), load_m=SIZES["lid"][2]),
        lambda: stage.carry("carton", None),
        lambda: stage.carry("carton", stage.free_place("carton"), leave=False),
        lambda: stage.carry("cup", None, drop_m=0.1),
        lambda: stage.touch("carton"),
        lambda: stage.near_miss("cup"),
        lambda: stage.push("cup"),
        lambda: stage.push("carton"),
    ]
    for number in stage.random.permutation(len(acts)).tolist():
        acts[number]()
        stage.wait(float(stage.random.uniform(0.3, 1.0)))
    return stage.frames, stage.actions


def noisy(
    frames: list[EpisodeFrame],
    *,
    seed: int,
    noise_m: float,
    every: int = 2,
    dropped: float = 0.0,
    jitter_s: float = 0.0,
) -> list[EpisodeFrame]:
    """Every few frames, with Gaussian noise on the positions of all bodies that can move.

    Args:
        seed: of the noise.
        noise_m: its standard deviation along each axis [m].
        every: of how many frames one is kept.
        dropped: the share of frames that are left out at random.
        jitter_s: standard deviation of the times [s].
    """
    random = np.random.default_rng(seed)
    fixed = {"floor", "table"}
    found: list[EpisodeFrame] = []
    for frame in frames[::every]:
        if random.random() < dropped:
            continue
        poses = frame.poses.copy()
        rows = [row for row, id in enumerate(frame.ids) if id not in fixed]
        poses[rows, :3] += random.normal(0.0, noise_m, (len(rows), 3))
        time_s = frame.time_s + (random.normal(0.0, jitter_s) if jitter_s else 0.0)
        if not found or time_s > found[-1].time_s:
            found.append(replace(frame, time_s=time_s, poses=poses))
    return found
