"""The rules of the detection, one by one, on made-up motions of few bodies whose mechanics is known exactly."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.engines.base import Contact
from mindstage.engines.mujoco import MujocoEngine
from mindstage.episodes import (
    DetectionThresholds,
    EpisodeEvent,
    EpisodeEventKind,
    EpisodeFrame,
    EventDetector,
    FrameRecording,
    detect_events,
)
from mindstage.errors import EpisodeError
from mindstage.scene import (
    AngularLimits,
    Attachment,
    AxisMotion,
    Body,
    BodyId,
    BodyPhysics,
    Iri,
    Joint,
    LinearLimits,
    Mobility,
    Pose,
    Vector,
    World,
)
from mindstage.scene.edits import SetPoses, Spawn
from mindstage.simulation.interaction import Perturbations
from tests.cases import each_case

K = EpisodeEventKind
TERMS = "http://example.org/things#"
RATE_HZ = 30.0
G = 9.81

Place = Vector | tuple[Vector, float]
"""A position [m], or one and an angle about x [rad]."""
Motion = Callable[[float], Place]


def body(
    id: str,
    position: Vector,
    size: Vector,
    mobility: Mobility = Mobility.DYNAMIC,
    *,
    mass: float = 0.5,
    gravity: bool = True,
) -> Body:
    return Body(
        id=BodyId(id),
        iri=Iri(TERMS + id),
        cls=Iri(TERMS + "Thing"),
        pose=Pose(position),
        size=size,
        physics=BodyPhysics(mobility=mobility, gravity=gravity, mass_kg=mass),
    )


FLOOR = body("floor", (0.0, 0.0, -0.05), (10.0, 10.0, 0.1), Mobility.STATIC)
TABLE = body("table", (0.0, 0.0, 0.4), (1.0, 1.0, 0.8), Mobility.STATIC)
BOX_SIZE = (0.1, 0.1, 0.2)


def world(*bodies: Body, joints: Iterable[Joint] = (), attachments: Iterable[Attachment] = ()) -> World:
    return World(iri=Iri(TERMS + "world"), bodies=bodies, joints=tuple(joints), attachments=tuple(attachments))


def touching(a: str, b: str | None, normal: Vector = (0.0, 0.0, -1.0), force: float = 5.0) -> Contact:
    return Contact(
        a=BodyId(a),
        b=None if b is None else BodyId(b),
        position=(0.0, 0.0, 0.0),
        normal=normal,
        force_n=force,
        depth_m=0.0001,
    )


def made_up(
    world_at: World | Callable[[float], World],
    motions: Mapping[str, Motion],
    duration_s: float,
    *,
    contacts: Callable[[float], tuple[Contact, ...]] | None = None,
    joints: Callable[[float], dict[str, tuple[float, ...]]] | None = None,
    rate_hz: float = RATE_HZ,
) -> list[EpisodeFrame]:
    """Frames in which bodies move as functions of time state; contacts are unknown unless they are given."""
    frames = []
    for number in range(round(duration_s * rate_hz) + 1):
        time_s = number / rate_hz
        structure = world_at(time_s) if callable(world_at) else world_at
        rows = []
        for each in structure.bodies:
            place: Place = motions[each.id](time_s) if each.id in motions else each.pose.position
            position, angle = (place, 0.0) if len(place) == 3 else place
            rows.append((*position, math.cos(angle / 2), math.sin(angle / 2), 0.0, 0.0))
        frames.append(
            EpisodeFrame(
                time_s=time_s,
                structure=structure,
                ids=tuple(each.id for each in structure.bodies),
                poses=np.array(rows, dtype=np.float64),
                contacts=None if contacts is None else contacts(time_s),
                joint_positions=None if joints is None else {BodyId(id): at for id, at in joints(time_s).items()},
            )
        )
    return frames


def events_of(frames: Iterable[EpisodeFrame], *kinds: EpisodeEventKind) -> list[EpisodeEvent]:
    return [event for event in detect_events(FrameRecording(frames)) if not kinds or event.kind in kinds]


def ramp(start: float, end: float, begin_s: float, end_s: float) -> Callable[[float], float]:
    return lambda t: start + (end - start) * min(max((t - begin_s) / (end_s - begin_s), 0.0), 1.0)


def simulated(
    structure: World, duration_s: float, act: Callable[[MujocoEngine, float], None] | None = None
) -> list[EpisodeFrame]:
    engine = MujocoEngine()
    engine.apply(Spawn(structure))
    frames: list[EpisodeFrame] = []
    structure = engine.snapshot()
    for _ in range(round(duration_s * RATE_HZ)):
        ids, poses = engine.poses()
        if ids != tuple(each.id for each in structure.bodies):
            structure = engine.snapshot()
        frames.append(
            EpisodeFrame(time_s=engine.time_s, structure=structure, ids=ids, poses=poses, contacts=engine.contacts())
        )
        for _ in range(4):
            if act is not None:
                act(engine, engine.time_s)
            engine.step(1 / RATE_HZ / 4)
    engine.close()
    return frames


# -- falls -------------------------------------------------------------------------------------------------------------


@each_case("height", [0.1, 0.5, 1.5])
@each_case("with_contacts", [True, False])
def test_a_fall_lasts_as_long_as_mechanics_says_and_ends_with_its_momentum(height: float, with_contacts: bool) -> None:
    frames = simulated(world(FLOOR, body("box", (0.0, 0.0, 0.1 + height), BOX_SIZE)), 1.5)
    if not with_contacts:
        frames = [replace(frame, contacts=None) for frame in frames]
    [fall] = events_of(frames, K.FALL)
    assert fall.begin_s == pytest.approx(0.0, abs=0.05)
    assert fall.end_s == pytest.approx(math.sqrt(2 * height / G), abs=0.05)
    assert fall.amount == pytest.approx(height, abs=0.03)  # the contact of the engine is soft
    [hit] = events_of(frames, K.COLLISION)
    assert hit.begin_s == fall.end_s
    assert (hit.thing, hit.other) == ("box", "floor")
    assert hit.amount == pytest.approx(0.5 * math.sqrt(2 * G * height), rel=0.2)
    [support] = events_of(frames, K.SUPPORT)
    assert (support.thing, support.other, support.end_s) == ("box", "floor", None)
    assert support.begin_s == pytest.approx(fall.end_s, abs=0.05)


def test_a_thrown_body_falls_from_where_it_left_the_hand() -> None:
    def height(t: float) -> float:
        flight = max(t - 0.5, 0.0)
        return max(1.0 + 2.0 * flight - G / 2 * flight**2, 0.1)

    frames = made_up(
        world(FLOOR, body("ball", (0.0, 0.0, 1.0), (0.1, 0.1, 0.2))), {"ball": lambda t: (0.0, 0.0, height(t))}, 2.0
    )
    [fall] = events_of(frames, K.FALL)
    lands = 0.5 + (2.0 + math.sqrt(4.0 + 2 * G * 0.9)) / G
    assert fall.begin_s == pytest.approx(0.5, abs=0.07)
    assert fall.end_s == pytest.approx(lands, abs=0.05)
    assert fall.amount == pytest.approx(0.9 + 2.0**2 / (2 * G), abs=0.03)


def test_a_fall_that_a_force_stops_ends_there() -> None:
    def height(t: float) -> float:
        fallen, caught = min(max(t - 0.5, 0.0), 0.4), min(max(t - 0.9, 0.0), 0.4)
        speed = G * 0.4
        return 3.0 - G / 2 * fallen**2 - speed * caught + G / 2 * caught**2

    frames = made_up(
        world(FLOOR, body("box", (0.0, 0.0, 3.0), BOX_SIZE)), {"box": lambda t: (0.0, 0.0, height(t))}, 2.5
    )
    [fall] = events_of(frames, K.FALL)
    assert (fall.begin_s, fall.end_s) == (pytest.approx(0.5, abs=0.1), pytest.approx(0.9, abs=0.1))


@pytest.mark.parametrize("acceleration", [1.0, 3.0])
def test_a_body_that_is_lowered_does_not_fall(acceleration: float) -> None:
    frames = made_up(
        world(FLOOR, body("box", (0.0, 0.0, 2.0), BOX_SIZE)),
        {"box": lambda t: (0.0, 0.0, 2.0 - acceleration / 2 * min(t, 1.0) ** 2)},
        1.0,
    )
    assert events_of(frames, K.FALL) == []


def test_a_hatch_on_a_vertical_slide_moves_down_and_does_not_fall() -> None:
    slide = Joint(
        id=BodyId("slide"),
        iri=Iri(TERMS + "slide"),
        parent=BodyId("frame"),
        child=BodyId("hatch"),
        pose=Pose((0.0, 0.0, 1.0)),
        linear=LinearLimits(z=AxisMotion.LIMITED, limit=0.4),
    )
    structure = world(
        body("frame", (0.0, 0.1, 1.0), (0.6, 0.05, 2.0), Mobility.STATIC),
        body("hatch", (0.0, 0.0, 1.0), (0.5, 0.05, 0.5)),
        joints=[slide],
    )
    frames = made_up(structure, {"hatch": lambda t: (0.0, 0.0, 1.0 - min(G / 2 * max(t - 0.5, 0.0) ** 2, 0.4))}, 1.5)
    assert [event.kind for event in events_of(frames, K.FALL, K.SLIDE, K.GRASP, K.OPEN, K.CLOSE)] == [K.OPEN]


def test_a_body_without_gravity_neither_falls_nor_is_held() -> None:
    frames = made_up(
        world(FLOOR, body("balloon", (0.0, 0.0, 1.0), BOX_SIZE, gravity=False)),
        {"balloon": lambda t: (0.3 * t, 0.0, 1.0)},
        2.0,
    )
    assert events_of(frames) == []


# -- jumps, spawns and deletions ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("target", [(0.4, 0.3, 0.9), (1.5, 0.0, 0.1)], ids=["same support", "other support"])
def test_a_body_that_is_put_elsewhere_neither_falls_nor_slides_nor_is_carried(target: Vector) -> None:
    structure = world(FLOOR, TABLE, body("box", (0.0, 0.0, 0.9), BOX_SIZE))
    frames = made_up(structure, {"box": lambda t: (0.0, 0.0, 0.9) if t < 1.0 else target}, 2.0)
    events = events_of(frames)
    assert {event.kind for event in events} == {K.CONTACT, K.SUPPORT}
    before, after = (event for event in events if event.kind is K.SUPPORT)
    assert (before.other, before.begin_s) == ("table", 0.0)
    assert before.end_s == pytest.approx(1.0, abs=0.04)
    assert after.other == ("table" if target[2] > 0.5 else "floor")
    assert after.begin_s == pytest.approx(1.0, abs=0.04)
    assert after.begin_s >= before.end_s


def test_a_body_that_an_edit_puts_elsewhere_has_the_contacts_of_the_new_place() -> None:
    def act(engine: MujocoEngine, time_s: float) -> None:
        if 1.0 <= time_s < 1.004:
            engine.apply(SetPoses({BodyId("box"): Pose((2.0, 0.0, 0.1))}))

    structure = world(FLOOR, TABLE, body("box", (0.0, 0.0, 0.9), BOX_SIZE))
    supports = events_of(simulated(structure, 3.0, act), K.SUPPORT, K.FALL, K.SLIDE, K.TRANSPORT)
    assert [(event.kind, event.other) for event in supports] == [(K.SUPPORT, "table"), (K.SUPPORT, "floor")]
    assert supports[0].end_s == pytest.approx(1.0, abs=0.07)


def test_relations_of_a_deleted_body_end_and_those_of_a_new_one_begin() -> None:
    first = world(FLOOR, TABLE, body("box", (0.0, 0.0, 0.9), BOX_SIZE))
    second = world(FLOOR, TABLE)
    third = world(body("cup", (0.3, 0.0, 0.85), (0.1, 0.1, 0.1)), FLOOR, TABLE)
    frames = made_up(lambda t: first if t < 1.0 else second if t < 2.0 else third, {}, 3.0)
    box, cup = events_of(frames, K.SUPPORT)
    assert (box.thing, box.other, cup.thing, cup.other) == ("box", "table", "cup", "table")
    assert box.end_s == pytest.approx(1.0, abs=0.04)
    assert cup.begin_s == pytest.approx(2.0, abs=0.04)
    assert cup.end_s is None


# -- contacts ----------------------------------------------------------------------------------------------------------


def test_a_contact_goes_on_when_its_bodies_fall_asleep() -> None:
    structure = world(FLOOR, body("box", (0.0, 0.0, 0.3), BOX_SIZE))
    frames = simulated(structure, 8.0)
    assert frames[-1].contacts == ()  # it sleeps
    kinds = [(event.kind, event.end_s) for event in events_of(frames, K.CONTACT, K.SUPPORT)]
    assert sorted(kinds) == [(K.CONTACT, None), (K.SUPPORT, None)]


@pytest.mark.parametrize("gap_s", [1 / 30, 2 / 30])
def test_a_short_gap_does_not_divide_a_contact(gap_s: float) -> None:
    structure = world(FLOOR, body("ball", (0.0, 0.0, 0.5), (0.1, 0.1, 0.1)))

    def contacts(t: float) -> tuple[Contact, ...]:
        return () if t < 0.99 or 1.49 < t < 1.49 + gap_s or t > 2.49 else (touching("ball", "floor"),)

    lifted = {"ball": lambda t: (0.0, 0.0, 0.05 if contacts(t) else 0.07)}
    [contact] = events_of(made_up(structure, lifted, 3.0, contacts=contacts), K.CONTACT)
    assert contact.begin_s == pytest.approx(1.0, abs=1e-9)
    assert contact.end_s == pytest.approx(2.5, abs=1e-9)


def test_a_contact_goes_on_while_its_bodies_hop_by_less_than_a_millimeter() -> None:
    # An engine reports no contact during such a hop, though the body is awake, as its other contact shows.
    post = body("post", (0.1, 0.0, 0.9), BOX_SIZE, Mobility.STATIC)
    structure = world(FLOOR, TABLE, body("box", (0.0, 0.0, 0.9), BOX_SIZE), post)

    def rests(t: float) -> bool:
        return t % 0.5 < 0.2

    def contacts(t: float) -> tuple[Contact, ...]:
        side = touching("box", "post", (1.0, 0.0, 0.0))
        return (side, touching("box", "table")) if rests(t) else (side,)

    moves = {"box": lambda t: (0.0, 0.0, 0.9 if rests(t) else 0.9003)}
    found = events_of(made_up(structure, moves, 5.0, contacts=contacts), K.CONTACT, K.SUPPORT)
    assert [(event.kind, event.other, event.end_s) for event in found if event.other == "table"] == [
        (K.CONTACT, "table", None),
        (K.SUPPORT, "table", None),
    ]


def test_a_blip_is_no_contact_and_a_longer_one_is_dated_exactly() -> None:
    structure = world(FLOOR, body("ball", (0.0, 0.0, 0.5), (0.1, 0.1, 0.1)))

    def contacts(t: float) -> tuple[Contact, ...]:
        return (touching("ball", "floor"),) if 0.99 < t < 1.05 or 1.99 < t < 2.21 else ()

    def high(t: float) -> Vector:
        return (0.0, 0.0, 0.05 if contacts(t) else 0.5 if not 0.9 < t < 1.1 else 0.08)

    [contact] = events_of(made_up(structure, {"ball": high}, 3.0, contacts=contacts), K.CONTACT)
    assert contact.begin_s == pytest.approx(2.0, abs=1e-9)
    assert contact.end_s == pytest.approx(67 / 30, abs=1e-6)


def test_the_ground_of_an_engine_is_a_support_without_a_name() -> None:
    structure = world(body("box", (0.0, 0.0, 0.1), BOX_SIZE))
    frames = made_up(structure, {}, 1.0, contacts=lambda t: (touching("box", None),))
    [support] = events_of(frames, K.SUPPORT)
    assert (support.thing, support.other) == ("box", None)


@pytest.mark.parametrize(("degrees", "supports"), [(0, True), (40, True), (50, False), (90, False)])
def test_a_support_is_below_within_45_degrees(degrees: float, supports: bool) -> None:
    angle = math.radians(degrees)
    structure = world(
        FLOOR, body("box", (0.0, 0.0, 0.1), BOX_SIZE), body("post", (0.3, 0.0, 0.1), BOX_SIZE, Mobility.STATIC)
    )
    normal = (math.sin(angle), 0.0, -math.cos(angle))
    frames = made_up(
        structure, {"box": lambda t: (0.0, 0.0, 0.15)}, 1.0, contacts=lambda t: (touching("box", "post", normal),)
    )
    assert [event.other for event in events_of(frames, K.SUPPORT)] == (["post"] if supports else [])


def test_a_slow_touch_is_no_collision_and_the_rebounds_of_one_are_not_counted() -> None:
    def contacts(t: float) -> tuple[Contact, ...]:
        on = t > 1.0 if speed < 0.3 else any(begin < t < begin + 0.05 for begin in (0.99, 1.16, 1.29)) or t > 1.4
        return (touching("cart", "wall", (1.0, 0.0, 0.0), 20.0),) if on else ()

    structure = world(
        FLOOR,
        body("wall", (1.0, 0.0, 0.5), (0.1, 1.0, 1.0), Mobility.STATIC),
        body("cart", (0.0, 0.0, 0.05), (0.1, 0.1, 0.1), mass=1.0),
    )
    counts = {}
    for speed in (0.1, 1.0):
        start = 0.9 - speed
        frames = made_up(
            structure, {"cart": lambda t, s=start, v=speed: (min(s + v * t, 0.9), 0.0, 0.05)}, 2.0, contacts=contacts
        )
        hits = events_of(frames, K.COLLISION)
        counts[speed] = len(hits)
    assert counts == {0.1: 0, 1.0: 1}
    assert hits[0].begin_s == pytest.approx(1.0, abs=0.04)
    assert hits[0].amount == pytest.approx(1.0, rel=0.2)  # 1 kg that had 1 m/s


def test_the_impulse_of_bodies_of_unknown_mass_is_the_sum_of_the_forces() -> None:
    cart = body("cart", (0.0, 0.0, 0.05), (0.1, 0.1, 0.1))
    structure = world(
        FLOOR,
        body("wall", (1.0, 0.0, 0.5), (0.1, 1.0, 1.0), Mobility.STATIC),
        replace(cart, physics=replace(cart.physics, mass_kg=None)),
    )

    def contacts(t: float) -> tuple[Contact, ...]:
        force = {27: 10.0, 28: 20.0, 29: 30.0}.get(round(t * RATE_HZ))
        return () if force is None else (touching("cart", "wall", (1.0, 0.0, 0.0), force),)

    frames = made_up(structure, {"cart": lambda t: (min(t, 0.9), 0.0, 0.05)}, 2.0, contacts=contacts)
    (hit,) = events_of(frames, K.COLLISION)
    assert hit.amount == pytest.approx((10.0 + 20.0 + 30.0) / RATE_HZ)
    assert "up to 30.0 N" in " ".join(hit.evidence)


# -- slides and tips ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0), (2, 3, 0, 1)], ids=str)
def test_what_stands_on_a_moving_tray_does_not_slide_but_the_tray_does(order: tuple[int, ...]) -> None:
    bodies = (
        FLOOR,
        TABLE,
        body("tray", (-0.3, 0.0, 0.81), (0.4, 0.3, 0.02)),
        body("cup", (-0.3, 0.0, 0.87), (0.08, 0.08, 0.1)),
    )
    structure = world(*(bodies[index] for index in order))
    x = ramp(-0.3, 0.2, 1.0, 3.0)
    frames = made_up(structure, {"tray": lambda t: (x(t), 0.0, 0.81), "cup": lambda t: (x(t), 0.0, 0.87)}, 4.0)
    [slide] = events_of(frames, K.SLIDE, K.FALL, K.TRANSPORT)
    assert (slide.thing, slide.other) == ("tray", "table")
    assert slide.begin_s == pytest.approx(1.0, abs=0.05)
    assert slide.end_s == pytest.approx(3.0, abs=0.05)
    assert slide.amount == pytest.approx(0.5, abs=0.01)


def test_two_pushes_are_two_slides_and_a_short_stop_divides_none() -> None:
    structure = world(FLOOR, TABLE, body("box", (-0.3, 0.0, 0.9), BOX_SIZE))
    parts = [ramp(0.0, 0.1, 1.0, 1.5), ramp(0.0, 0.1, 1.56, 2.0), ramp(0.0, 0.1, 3.0, 3.5)]
    frames = made_up(structure, {"box": lambda t: (-0.3 + sum(part(t) for part in parts), 0.0, 0.9)}, 4.5)
    slides = events_of(frames, K.SLIDE)
    assert [(round(slide.begin_s, 1), round(slide.end_s or 0.0, 1)) for slide in slides] == [(1.0, 2.0), (3.0, 3.5)]


@pytest.mark.parametrize("degrees", [30.0, 90.0])
def test_a_box_tips_over_from_45_degrees_on(degrees: float) -> None:
    # It turns about its lower edge, which stays where it is.
    angle_at = ramp(0.0, math.radians(degrees), 1.0, 1.5)

    def place(t: float) -> Place:
        angle = angle_at(t)
        corner = np.array([0.0, -0.05, 0.8])
        offset = np.array(
            [0.0, 0.05 * math.cos(angle) - 0.1 * math.sin(angle), 0.05 * math.sin(angle) + 0.1 * math.cos(angle)]
        )
        x, y, z = (corner + offset).tolist()
        return (x, y, z), angle

    frames = made_up(world(FLOOR, TABLE, body("box", (0.0, 0.0, 0.9), BOX_SIZE)), {"box": place}, 2.5)
    tips = events_of(frames, K.TIP_OVER)
    assert len(tips) == (1 if degrees > 45 else 0)
    for tip in tips:
        assert (tip.begin_s, tip.end_s) == (pytest.approx(1.0, abs=0.07), pytest.approx(1.5, abs=0.07))
        assert tip.amount == pytest.approx(math.radians(degrees), abs=0.01)
    assert events_of(frames, K.SLIDE, K.FALL, K.GRASP) == []


# -- hands -------------------------------------------------------------------------------------------------------------


GRIPPER = body("gripper", (0.0, 0.0, 1.04), (0.06, 0.06, 0.06), Mobility.KINEMATIC, gravity=False)


def carried(*, release_height: float = 0.0, attached: bool = True) -> list[EpisodeFrame]:
    """A box is lifted by 0.2 m from 1.0 s, carried 0.4 m from 2.0 s, lowered from 3.0 to 4.0 s, released at 4.5 s."""
    structure = world(
        FLOOR, TABLE, body("box", (-0.2, 0.0, 0.9), BOX_SIZE), replace(GRIPPER, pose=Pose((-0.2, 0.0, 1.04)))
    )
    up, down = ramp(0.0, 0.2, 1.0, 2.0), ramp(0.0, 0.2 - release_height, 3.0, 4.0)
    along = ramp(-0.2, 0.2, 2.0, 3.0)

    def box(t: float) -> Vector:
        z = 0.9 + up(t) - down(t)
        fall = G / 2 * max(t - 4.5, 0.0) ** 2
        return (along(t), 0.0, max(z - fall, 0.9))

    def gripper(t: float) -> Vector:
        return (along(t), 0.0, 1.04 + up(t) - down(t))

    held = replace(structure, attachments=(Attachment(parent=BodyId("gripper"), child=BodyId("box")),))
    return made_up(
        lambda t: held if attached and 0.5 <= t < 4.5 else structure,
        {"box": box, "gripper": gripper if attached else lambda t: (-3.0, 0.0, 1.0)},
        6.0,
    )


def test_a_body_that_is_attached_to_a_mover_is_picked_up_transported_and_put_down() -> None:
    grasp, lift, way, put = events_of(carried(), K.GRASP, K.PICK_UP, K.TRANSPORT, K.PUT_DOWN, K.FALL, K.SLIDE)
    assert [each.kind for each in (grasp, lift, way, put)] == [K.GRASP, K.PICK_UP, K.TRANSPORT, K.PUT_DOWN]
    assert {each.agent for each in (grasp, lift, way, put)} == {"gripper"}
    assert (grasp.begin_s, grasp.end_s) == (pytest.approx(0.5, abs=0.04), pytest.approx(4.5, abs=0.04))
    assert (lift.begin_s, lift.end_s) == (pytest.approx(1.0, abs=0.07), pytest.approx(1.25, abs=0.07))
    assert (way.begin_s, way.end_s) == (pytest.approx(1.25, abs=0.07), pytest.approx(3.75, abs=0.07))
    assert (put.begin_s, put.end_s) == (pytest.approx(3.75, abs=0.07), pytest.approx(4.0, abs=0.07))
    assert way.amount == pytest.approx(0.4, abs=0.02)
    assert (lift.other, put.other) == ("table", "table")


def test_a_body_that_a_force_carries_is_recognized_by_its_motion_against_gravity() -> None:
    events = events_of(carried(attached=False), K.GRASP, K.PICK_UP, K.TRANSPORT, K.PUT_DOWN, K.FALL, K.SLIDE)
    assert [event.kind for event in events] == [K.GRASP, K.PICK_UP, K.TRANSPORT, K.PUT_DOWN]
    assert {event.agent for event in events} == {None}
    grasp, lift, _, put = events
    assert grasp.begin_s == pytest.approx(1.0, abs=0.07)
    assert grasp.end_s == pytest.approx(4.0, abs=0.1)
    assert (lift.begin_s, put.end_s) == (pytest.approx(1.0, abs=0.07), pytest.approx(4.0, abs=0.07))


def test_a_body_that_a_client_pulls_through_the_air_is_held() -> None:
    pulls, structure = Perturbations(), world(FLOOR, TABLE, body("box", (-0.2, 0.0, 0.85), (0.1, 0.1, 0.1)))
    up, along, down = ramp(0.0, 0.3, 1.0, 2.0), ramp(0.0, 0.3, 2.0, 3.0), ramp(0.0, 0.29, 3.0, 4.5)

    def act(engine: MujocoEngine, time_s: float) -> None:
        if 1.0 <= time_s < 5.0:
            target = (-0.2 + along(time_s), 0.0, 0.9 + up(time_s) - down(time_s))
            pulls.pull(BodyId("box"), point=(0.0, 0.0, 0.05), target=target, worlds=[structure])
            [pull] = pulls.values()
            force, point = pull.force(engine.poses()[1][engine.poses()[0].index(BodyId("box"))], 1 / RATE_HZ / 8)
            engine.apply_force(BodyId("box"), force, point)

    events = events_of(simulated(structure, 6.0, act), K.GRASP, K.PICK_UP, K.TRANSPORT, K.PUT_DOWN, K.FALL)
    assert sorted(event.kind for event in events) == sorted([K.GRASP, K.PICK_UP, K.TRANSPORT, K.PUT_DOWN])
    by_kind = {event.kind: event for event in events}
    lift, put = by_kind[K.PICK_UP], by_kind[K.PUT_DOWN]
    assert lift.begin_s == by_kind[K.GRASP].begin_s == pytest.approx(1.05, abs=0.1)  # the spring sags by 7 mm
    assert put.end_s == pytest.approx(4.4, abs=0.2)
    assert by_kind[K.TRANSPORT].amount == pytest.approx(0.3, abs=0.03)


def hinge(id: str, parent: str, child: str) -> Joint:
    angular = AngularLimits(swing1=AxisMotion.LIMITED, swing1_limit=1.0)
    return Joint(
        id=BodyId(id), iri=Iri(TERMS + id), parent=BodyId(parent), child=BodyId(child), pose=Pose(), angular=angular
    )


@pytest.mark.parametrize(("holder", "grasped"), [("hand", True), ("door", False)])
def test_the_links_of_a_robot_hold_things_and_doors_do_not(holder: str, grasped: bool) -> None:
    structure = world(
        FLOOR,
        body("base", (2.0, 0.0, 0.2), (0.3, 0.3, 0.4), Mobility.STATIC),
        body("arm", (2.0, 0.0, 0.6), (0.1, 0.1, 0.4)),
        body("hand", (2.0, 0.0, 0.9), (0.1, 0.1, 0.1)),
        body("frame", (-2.0, 0.0, 1.0), (0.6, 0.1, 2.0), Mobility.STATIC),
        body("door", (-2.0, 0.2, 1.0), (0.5, 0.05, 1.8)),
        body("hook", (0.0, 2.0, 0.05), (0.1, 0.1, 0.1)),
        joints=[hinge("shoulder", "base", "arm"), hinge("wrist", "arm", "hand"), hinge("hinge", "frame", "door")],
    )
    held = replace(structure, attachments=(Attachment(parent=BodyId(holder), child=BodyId("hook")),))
    frames = made_up(lambda t: structure if t < 1.0 else held, {}, 2.0)
    assert [event.agent for event in events_of(frames, K.GRASP)] == ([holder] if grasped else [])


def test_a_body_that_is_released_a_finger_above_the_table_is_put_down_and_from_higher_up_it_falls() -> None:
    kinds = {}
    for height in (0.01, 0.15):
        events = events_of(carried(release_height=height), K.PUT_DOWN, K.FALL)
        kinds[height] = [event.kind for event in events]
    assert kinds == {0.01: [K.PUT_DOWN], 0.15: [K.FALL]}


def test_lifting_a_little_and_setting_down_again_is_not_picking_up() -> None:
    structure = world(
        FLOOR,
        TABLE,
        body("box", (0.0, 0.0, 0.9), BOX_SIZE),
        GRIPPER,
        attachments=[Attachment(parent=BodyId("gripper"), child=BodyId("box"))],
    )
    up, down = ramp(0.0, 0.03, 1.0, 1.3), ramp(0.0, 0.03, 1.6, 1.9)
    moves = {
        "box": lambda t: (0.0, 0.0, 0.9 + up(t) - down(t)),
        "gripper": lambda t: (0.0, 0.0, 1.04 + up(t) - down(t)),
    }
    events = events_of(made_up(structure, moves, 3.0))
    assert {event.kind for event in events} == {K.CONTACT, K.SUPPORT, K.GRASP}


def test_a_body_between_two_fingers_is_grasped_and_one_that_is_pushed_is_not() -> None:
    fingers = [
        body(f"finger_{n}", (0.08 * n, 0.0, 0.9), (0.04, 0.04, 0.1), Mobility.KINEMATIC, gravity=False) for n in (-1, 1)
    ]
    structure = world(FLOOR, TABLE, body("box", (0.0, 0.0, 0.9), BOX_SIZE), *fingers)

    def contacts(t: float) -> tuple[Contact, ...]:
        left = touching("box", "finger_-1", (-1.0, 0.0, 0.0))
        right = touching("box", "finger_1", (1.0, 0.0, 0.0))
        return (touching("box", "table"), *((left, right) if 0.99 < t < 2.01 else (left,) if t < 3.0 else ()))

    [grasp] = events_of(made_up(structure, {}, 4.0, contacts=contacts), K.GRASP)
    assert (grasp.begin_s, grasp.end_s) == (pytest.approx(1.0, abs=0.04), pytest.approx(2.0, abs=0.07))
    assert grasp.thing == "box"
    assert grasp.agent in {"finger_-1", "finger_1"}


def test_attachments_of_the_map_and_to_furniture_are_no_grasps() -> None:
    lid, pot = body("lid", (0.0, 0.0, 1.01), (0.2, 0.2, 0.02)), body("pot", (0.0, 0.0, 0.9), (0.2, 0.2, 0.2))
    apart = world(FLOOR, TABLE, pot, lid)
    glued = replace(
        apart,
        attachments=(
            Attachment(parent=BodyId("pot"), child=BodyId("lid")),
            Attachment(parent=BodyId("table"), child=BodyId("pot")),
        ),
    )
    frames = made_up(lambda t: apart if t < 1.0 else glued, {}, 2.0)
    assert events_of(frames, K.GRASP) == []


# -- joints ------------------------------------------------------------------------------------------------------------


DRAWER = Joint(
    id=BodyId("slide"),
    iri=Iri(TERMS + "slide"),
    parent=BodyId("case"),
    child=BodyId("drawer"),
    pose=Pose((0.0, 0.0, 0.5)),
    linear=LinearLimits(x=AxisMotion.LIMITED, limit=0.2, x_middle=0.2),
)


@pytest.mark.parametrize("known", [True, False], ids=["known position", "from poses"])
def test_each_monotone_motion_of_a_joint_is_one_event(known: bool) -> None:
    structure = world(
        body("case", (0.0, 0.0, 0.5), (0.6, 0.6, 0.4), Mobility.STATIC),
        body("drawer", (0.0, 0.0, 0.5), (0.5, 0.5, 0.2)),
        joints=[DRAWER],
    )
    parts = [ramp(0.0, 0.3, 1.0, 2.0), ramp(0.0, -0.1, 2.0, 2.5), ramp(0.0, 0.2, 4.0, 5.0), ramp(0.0, -0.4, 6.0, 7.0)]

    def x(t: float) -> float:
        return sum(part(t) for part in parts)

    frames = made_up(
        structure,
        {"drawer": lambda t: (x(t), 0.0, 0.5)},
        8.0,
        joints=(lambda t: {"slide": (x(t), 0.0, 0.0, 0.0, 0.0, 0.0)}) if known else None,
    )
    found = events_of(frames, K.OPEN, K.CLOSE)
    assert [event.kind for event in found] == [K.OPEN, K.CLOSE, K.OPEN, K.CLOSE]
    assert [event.amount for event in found] == pytest.approx([0.3, 0.1, 0.2, 0.4], abs=0.01)
    for event, (begin_s, end_s) in zip(found, ((1.0, 2.0), (2.0, 2.5), (4.0, 5.0), (6.0, 7.0)), strict=True):
        assert (event.begin_s, event.end_s) == (pytest.approx(begin_s, abs=0.07), pytest.approx(end_s, abs=0.07))
        assert (event.thing, event.other, event.joint) == ("drawer", "case", "slide")
    if known:  # smoothing takes the last frame before it turns back
        assert "75% of its range" in found[0].evidence[0]
    for before, after in pairwise(found):
        assert after.begin_s >= (before.end_s or 0.0)


@pytest.mark.parametrize("shake", [0.001, 0.01])
def test_play_of_a_joint_is_no_opening(shake: float) -> None:
    structure = world(
        body("case", (0.0, 0.0, 0.5), (0.6, 0.6, 0.4), Mobility.STATIC),
        body("drawer", (0.0, 0.0, 0.5), (0.5, 0.5, 0.2)),
        joints=[DRAWER],
    )
    frames = made_up(structure, {"drawer": lambda t: (shake * (1 - math.cos(3 * t)) / 2, 0.0, 0.5)}, 6.0)
    assert events_of(frames, K.OPEN, K.CLOSE) == []


# -- noise, rates, errors ----------------------------------------------------------------------------------------------


@each_case("asleep", [True, False], ids=["asleep", "contacts unknown"])
@each_case("seed", range(3))
def test_noise_of_a_millimeter_on_bodies_at_rest_is_no_event(seed: int, asleep: bool) -> None:
    random = np.random.default_rng(seed)
    structure = world(FLOOR, TABLE, *(body(f"box_{n}", (0.12 * n - 0.3, 0.0, 0.9), BOX_SIZE) for n in range(6)))
    frames = made_up(structure, {}, 20.0, contacts=(lambda t: ()) if asleep else None)
    noisy = []
    for frame in frames:
        poses = frame.poses.copy()
        hit = random.random(len(poses)) < (0.2 if asleep else 0.05)
        poses[hit, :3] += random.normal(0.0, 0.001, (hit.sum(), 3))
        noisy.append(replace(frame, poses=poses))
    calm = {(event.kind, event.thing, event.other) for event in events_of(frames)}
    events = events_of(noisy)
    assert {(event.kind, event.thing, event.other) for event in events} == calm
    assert all(event.begin_s == 0.0 and event.end_s is None for event in events)


@pytest.mark.parametrize("rate_hz", [15.0, 60.0, 250.0])
def test_the_rate_of_the_recording_does_not_matter(rate_hz: float) -> None:
    structure = world(FLOOR, TABLE, body("box", (-0.3, 0.0, 0.9), BOX_SIZE))

    def place(t: float) -> Vector:
        x = -0.3 + min(max(t - 1.0, 0.0), 0.9)  # it has left the table at 1.85 s, and falls from 1.9 s on
        return (x, 0.0, 0.9 if t < 1.9 else max(0.9 - G / 2 * (t - 1.9) ** 2, 0.1))

    frames = made_up(structure, {"box": place}, 3.5, rate_hz=rate_hz)
    slide, fall = events_of(frames, K.SLIDE, K.FALL)
    assert (slide.begin_s, slide.end_s) == (pytest.approx(1.0, abs=0.1), pytest.approx(1.85, abs=0.1))
    lands = 1.9 + math.sqrt(1.6 / G)
    assert (fall.begin_s, fall.end_s) == (pytest.approx(1.9, abs=0.1), pytest.approx(lands, abs=0.1))


def test_of_two_frames_of_the_same_time_the_last_one_counts() -> None:
    structure = world(FLOOR, TABLE, body("box", (0.0, 0.0, 0.9), BOX_SIZE))
    frames = made_up(structure, {}, 2.0)
    wrong = [replace(frame, poses=frame.poses + np.array([0, 0, 1.0, 0, 0, 0, 0])) for frame in frames]
    doubled = [frame for pair in zip(wrong, frames, strict=True) for frame in pair]
    assert events_of(doubled) == events_of(frames)


def test_a_pose_that_is_not_finite_leaves_the_body_where_it_was() -> None:
    structure = world(FLOOR, TABLE, body("box", (0.0, 0.0, 0.9), BOX_SIZE))
    frames = made_up(structure, {}, 3.0)
    for frame in frames[30:45]:
        frame.poses[2] = np.nan
    for frame in frames[60:62]:
        frame.poses[2, 3:] = 0.0
    frames[0].poses[2, 0] = np.inf
    assert events_of(frames) == events_of(made_up(structure, {}, 3.0))


@pytest.mark.parametrize("rate_hz", [2.0, 5.0, 10.0])
def test_a_recording_with_few_frames_gives_what_it_shows_and_no_error(rate_hz: float) -> None:
    structure = world(FLOOR, TABLE, body("box", (0.0, 0.0, 0.9), BOX_SIZE))
    places = {"box": lambda t: (0.8, 0.0, max(0.9 - G / 2 * (t - 1.0) ** 2, 0.1)) if t > 1.0 else (0.0, 0.0, 0.9)}
    supports = events_of(made_up(structure, places, 4.0, rate_hz=rate_hz), K.SUPPORT)
    assert [event.other for event in supports] == ["table", "floor"]


def test_a_frame_from_the_past_and_one_after_the_end_are_refused() -> None:
    first, second = made_up(world(FLOOR), {}, 0.03)
    detector = EventDetector()
    detector.update(second)
    with pytest.raises(EpisodeError, match=r"a frame at 0 s came after one at 0\.0333333 s"):
        detector.update(first)
    detector.finish()
    assert detector.finish() == ()
    with pytest.raises(EpisodeError, match="create another EventDetector"):
        detector.update(second)


@pytest.mark.parametrize("seed", range(20))
def test_noise_on_a_fall_without_contacts_is_no_error(seed: int, caplog: pytest.LogCaptureFixture) -> None:
    noise = np.random.default_rng(seed)
    places = {"box": lambda t: (0.0, 0.0, 2.0 if t < 0.5 else max(0.1, 2.0 - G / 2 * (t - 0.5) ** 2))}
    frames = made_up(world(FLOOR, body("box", (0.0, 0.0, 2.0), BOX_SIZE)), places, 2.0)
    for frame in frames:
        frame.poses[1, :3] += noise.normal(0.0, 0.005, 3)
    detect_events(FrameRecording(frames))
    assert not caplog.records


def _with_poses(frame: EpisodeFrame, poses: np.ndarray) -> EpisodeFrame:
    return EpisodeFrame(time_s=frame.time_s, structure=frame.structure, ids=frame.ids, poses=poses)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda frame: _with_poses(frame, frame.poses[:2]),
        lambda frame: _with_poses(frame, frame.poses[:, :6]),
        lambda frame: _with_poses(frame, np.full((3, 7), "cup")),
        lambda frame: _with_poses(frame, np.full((3, 7), 1e308)),
        lambda frame: EpisodeFrame(
            time_s=frame.time_s, structure=world(FLOOR), ids=frame.ids, poses=frame.poses, contacts=()
        ),
        lambda frame: EpisodeFrame(
            time_s=frame.time_s,
            structure=frame.structure,
            ids=frame.ids,
            poses=frame.poses,
            contacts=(touching("box", "table", (math.nan, 0.0, 0.0), math.nan),),
        ),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_frames_that_make_no_sense_are_a_fault_and_the_detection_goes_on(
    spoil: Callable[[EpisodeFrame], EpisodeFrame],
) -> None:
    places = {"box": lambda t: (0.0, 0.0, 0.9) if t < 3.0 else (0.8, 0.0, max(0.9 - G / 2 * (t - 3.0) ** 2, 0.1))}
    frames = made_up(world(FLOOR, TABLE, body("box", (0.0, 0.0, 0.9), BOX_SIZE)), places, 5.0)
    frames[40:50] = [spoil(frame) for frame in frames[40:50]]
    detector = EventDetector()
    for frame in frames:
        detector.update(frame)
    detector.finish()
    assert [event.other for event in detector.events if event.kind is K.SUPPORT][-1] == "floor"
    supports = [event for event in detector.events if event.kind is K.SUPPORT and event.other == "table"]
    assert all(event.end_s is not None for event in supports)
    for fault in detector.faults:
        assert frames[38].time_s <= fault.begin_s <= fault.end_s <= frames[51].time_s
        assert fault.cause
    if detector.faults:
        assert any("failed" in " ".join(event.evidence) for event in supports)


def test_a_recording_without_movable_bodies_has_no_events() -> None:
    assert events_of(made_up(world(FLOOR, TABLE), {}, 1.0)) == []
    assert EventDetector().finish() == ()


def test_thresholds_can_be_changed() -> None:
    frames = carried()
    strict = DetectionThresholds(transport_min_m=1.0)
    kinds = {event.kind for event in detect_events(FrameRecording(frames), thresholds=strict)}
    assert K.TRANSPORT not in kinds
    assert K.PICK_UP in kinds
