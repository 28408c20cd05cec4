"""Mechanics on paper: what engines with physics are compared with, as a reusable test class.

Nothing here is computed by an engine: the expected values follow from Newton's and Coulomb's laws for rigid bodies, in
the docstring of each test. The tolerances are class attributes, relative where nothing else is said. A body is moved by
edits and forces only, and looked at by its pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
import pytest

from mindstage.engines import Actuator, ActuatorMode, Capability, Engine
from mindstage.engines.edits import SetActuators
from mindstage.scene import (
    Body,
    BodyGeometry,
    BodyId,
    CollisionShape,
    CollisionShapeType,
    Joint,
    Pose,
    PrimitiveShape,
    PrimitiveType,
)
from mindstage.scene.edits import Attach, SetPoses, Spawn
from mindstage.scene.transforms import quat_angle, quat_rotate
from tests.engines.actuator_contract import hinge
from tests.engines.contract import apply_force_for, current_pose
from tests.engines.geometries import geometry, single_shape_geometry
from tests.engines.scenes import FLOOR, body, world

G = 9.81
UP = np.array([0.0, 0.0, 1.0])


def about_y(angle_rad: float) -> tuple[float, float, float, float]:
    """A rotation that lowers what is in front, by an angle."""
    return (math.cos(angle_rad / 2), 0.0, math.sin(angle_rad / 2), 0.0)


def spawn(engine: Engine, *parts: Body | Joint, friction: Mapping[str, float] | None = None) -> None:
    """Spawns boxes, some of them with a stated friction."""
    bodies = {part.id: part for part in parts if isinstance(part, Body)}
    stated: dict[BodyId, BodyGeometry] = {}
    for name, value in (friction or {}).items():
        size = bodies[BodyId(name)].size
        assert size is not None
        stated[BodyId(name)] = single_shape_geometry(CollisionShapeType.BOX, size, friction=value)
    assert engine.apply(Spawn(world(*parts), geometry=stated)).report.ok


def on_ramp(angle_rad: float, size: tuple[float, float, float], mass_kg: float) -> tuple[Body, Body]:
    """A ramp that falls towards x, and a box on it, whose lower side touches the ramp."""
    turned = about_y(angle_rad)
    up = quat_rotate(np.array(turned), UP)
    ramp = body("ramp", (0.0, 0.0, 0.0), (8.0, 2.0, 0.2), quaternion=turned)
    x, y, z = (up * (0.1 + size[2] / 2)).tolist()
    return ramp, body("box", (x, y, z), size, "dynamic", mass_kg, quaternion=turned)


def move(engine: Engine, id: str, pose_at: Callable[[float], Pose], duration_s: float, cycle_s: float = 0.02) -> None:
    """Moves a kinematic body on a path of minimum jerk, given from 0 to 1, as a program that sets poses in cycles."""
    cycles = round(duration_s / cycle_s)
    for cycle in range(1, cycles + 1):
        share = cycle / cycles
        pose = pose_at(share**3 * (10 - 15 * share + 6 * share**2))
        engine.apply(SetPoses({BodyId(id): pose}))
        engine.step(cycle_s)


def require_kinematic_velocities(engine: Engine) -> None:
    if Capability.KINEMATIC_VELOCITIES not in engine.capabilities:
        pytest.skip("in the engine, a kinematic body whose pose is set has no velocity")


def relative(engine: Engine, id: str, base: str) -> np.ndarray:
    """The position of a body in the frame of another one [m]."""
    inner, outer = current_pose(engine, id), current_pose(engine, base)
    return quat_rotate(outer[3:] * (1.0, -1.0, -1.0, -1.0), inner[:3] - outer[:3])


class MechanicsContract:
    """The mechanics of rigid bodies with dry friction."""

    tolerance = 0.01
    """Of distances, times and angles."""
    carried_tolerance_m = 0.001
    """How far what stands on a kinematic body slips on it while that moves."""
    turned_tolerance_m = 0.001
    """How far it slips outwards on one that turns by 180 degrees in 4 s."""
    depth_tolerance_m = 0.0005
    """How deep 2 kg get into a thing of 20 g; twice as much of 5 g."""
    line_tolerance_m = 0.005
    """How far a ball is beside its straight line after 5 m."""
    commanded_tolerance = 0.0
    """Of the pose of a kinematic body, against the one that was set [m]."""

    @pytest.mark.parametrize("friction", [0.2, 0.5, 0.8])
    def test_a_box_slides_from_the_angle_whose_tangent_is_the_friction(self, engine: Engine, friction: float) -> None:
        """m g sin(a) > mu m g cos(a) from tan(a) = mu on: then it moves by g (sin(a) - mu cos(a)) t²/2."""
        for factor in (1.0 - 2 * self.tolerance, 1.0 + 2 * self.tolerance):
            angle, duration_s = math.atan(friction) * factor, 2.0
            engine.clear()
            spawn(engine, *on_ramp(angle, (0.3, 0.3, 0.05), 1.0), friction={"ramp": friction, "box": friction})
            engine.step(0.2)  # until the contact has taken up the weight
            start = current_pose(engine, "box")
            engine.step(duration_s)
            moved = float(np.linalg.norm(current_pose(engine, "box")[:3] - start[:3]))
            slides = max(0.0, G * (math.sin(angle) - friction * math.cos(angle))) * duration_s**2 / 2
            assert (moved > slides / 2 > 0.0) if slides else moved < 0.002, (factor, moved)

    @pytest.mark.parametrize(("angle_deg", "friction"), [(30.0, 0.2), (20.0, 0.1), (40.0, 0.5)])
    def test_a_box_slides_down_an_incline(self, engine: Engine, angle_deg: float, friction: float) -> None:
        """With a = g (sin - mu cos), it moves by a t²/2."""
        angle, duration_s = math.radians(angle_deg), 0.6
        spawn(engine, *on_ramp(angle, (0.3, 0.3, 0.05), 1.0), friction={"ramp": friction, "box": friction})
        start = current_pose(engine, "box")
        engine.step(duration_s)
        moved = current_pose(engine, "box")[:3] - start[:3]
        expected = G * (math.sin(angle) - friction * math.cos(angle)) * duration_s**2 / 2
        assert float(np.linalg.norm(moved)) == pytest.approx(expected, rel=self.tolerance)

    @pytest.mark.parametrize("friction", [0.8, 0.3])
    def test_a_pushed_box_comes_to_rest_by_its_friction(self, engine: Engine, friction: float) -> None:
        """F for t: v = (F/m - mu g) t; it slides by v t/2 under the force, and by v²/(2 mu g) after it."""
        mass_kg, force_n, duration_s = 2.0, 40.0, 0.2
        stated = {} if friction == 0.8 else {"box": friction}
        spawn(engine, FLOOR, body("box", (0, 0, 0.05), (0.4, 0.4, 0.1), "dynamic", mass_kg), friction=stated)
        engine.step(0.5)
        start = current_pose(engine, "box")
        for _ in range(round(duration_s / 0.02)):  # at the height of the floor, so that it does not tip
            x, y, _ = current_pose(engine, "box")[:3].tolist()
            engine.apply_force(BodyId("box"), (force_n, 0.0, 0.0), (x, y, 0.0))
            engine.step(0.02)
        engine.step(2.0)
        speed = (force_n / mass_kg - friction * G) * duration_s
        expected = speed * duration_s / 2 + speed**2 / (2 * friction * G)
        assert current_pose(engine, "box")[0] - start[0] == pytest.approx(expected, rel=self.tolerance)

    @pytest.mark.parametrize("height_m", [0.3, 0.5])
    def test_a_box_on_a_slope_tips_from_the_angle_whose_tangent_is_its_base_by_its_height(
        self, engine: Engine, height_m: float
    ) -> None:
        """It tips once the line of its weight, from h/2 above the slope, passes beside its base b: tan(a) = b/h."""
        base_m = 0.2
        for factor, tips in ((1.0 - 2 * self.tolerance, False), (1.0 + 2 * self.tolerance, True)):
            engine.clear()
            angle = math.atan(base_m / height_m) * factor
            spawn(engine, *on_ramp(angle, (base_m, 0.3, height_m), 1.0), friction={"ramp": 5.0, "box": 5.0})
            start = current_pose(engine, "box")
            engine.step(3.0)
            turned = quat_angle(current_pose(engine, "box")[3:], start[3:])
            assert bool(turned > 0.5) is tips, (factor, turned)

    def test_a_body_falls_with_the_acceleration_of_gravity(self, engine: Engine) -> None:
        """h = g t²/2, whatever the mass."""
        for x, mass_kg in ((0.0, 0.01), (1.0, 50.0)):
            spawn(engine, body(f"box{x:.0f}", (x, 0, 10.0), (0.1, 0.1, 0.1), "dynamic", mass_kg))
        engine.step(1.0)
        for id in ("box0", "box1"):
            assert 10.0 - current_pose(engine, id)[2] == pytest.approx(G / 2, rel=self.tolerance)

    @pytest.mark.parametrize("amplitude_rad", [0.1, 0.6])
    def test_a_rod_swings_with_the_period_of_a_physical_pendulum(self, engine: Engine, amplitude_rad: float) -> None:
        """T = 2 pi sqrt(I / (m g d)) (1 + a²/16 + 11 a⁴/3072), with I = m (l²/3 + w²/12) and d = l/2 for a rod.

        It is released at rest, so that it is vertical after T/4, 3 T/4 and 5 T/4.
        """
        if Capability.ACTUATORS not in engine.capabilities:
            pytest.skip("the engine has no joint without friction")
        length, width = 0.6, 0.02
        turned = about_y(math.pi / 2 - amplitude_rad)  # its x axis points down
        x, y, z = (2.0 * UP + quat_rotate(np.array(turned), np.array([length / 2, 0.0, 0.0]))).tolist()
        rod = body("rod", (x, y, z), (length, width, width), "dynamic", 0.7, quaternion=turned)
        post = body("post", (0, 0.2, 2.0), (0.1, 0.1, 0.1))
        spawn(engine, post, rod, hinge("axle", "post", "rod", (0, 0, 2.0)))
        free = Actuator(name="free", joint=BodyId("axle"), mode=ActuatorMode.EFFORT, effort_limit=1.0)
        engine.apply(SetActuators((free,)))
        crossings, before, cycle_s = list[float](), x, 0.01
        for cycle in range(round(2.5 / cycle_s)):
            engine.step(cycle_s)
            now = float(current_pose(engine, "rod")[0])
            if before * now < 0.0:
                crossings.append((cycle + before / (before - now)) * cycle_s)
            before = now
        series = 1 + amplitude_rad**2 / 16 + 11 * amplitude_rad**4 / 3072
        period_s = 2 * math.pi * math.sqrt((length**2 / 3 + width**2 / 12) / (G * length / 2)) * series
        assert crossings[0] == pytest.approx(period_s / 4, rel=self.tolerance)
        assert crossings[2] - crossings[0] == pytest.approx(period_s, rel=self.tolerance)

    @pytest.mark.parametrize("depth_m", [0.2, 0.4])
    def test_a_box_falls_off_an_edge_if_more_than_half_of_it_overhangs(self, engine: Engine, depth_m: float) -> None:
        """Its weight then passes beside the edge."""
        for overhang, falls in ((0.5 - self.tolerance, False), (0.5 + self.tolerance, True)):
            engine.clear()
            table = body("table", (-1.0, 0.0, 0.35), (2.0, 1.0, 0.7))
            box = body("box", ((overhang - 0.5) * depth_m, 0, 0.75), (depth_m, 0.1, 0.1), "dynamic", 1.0)
            spawn(engine, FLOOR, table, box)
            engine.step(3.0)
            assert bool(current_pose(engine, "box")[2] < 0.6) is falls, overhang

    def test_a_stack_of_ten_boxes_stands_and_carries_its_weight(self, engine: Engine) -> None:
        """Each box is as high as those below it together; the lowest contact carries 10 m g."""
        boxes = [body(f"box{n}", (0, 0, 0.05 + 0.1 * n), (0.1, 0.1, 0.1), "dynamic", 0.5) for n in range(10)]
        spawn(engine, FLOOR, *boxes)
        forces_n = list[float]()
        for _ in range(20):
            engine.step(0.02)
            if Capability.CONTACTS in engine.capabilities:  # of bodies that are not asleep
                forces_n += [each.force_n for each in engine.contacts() if {each.a, each.b} == {"floor", "box0"}]
        assert not forces_n or forces_n[-1] == pytest.approx(10 * 0.5 * G, rel=self.tolerance)
        engine.step(5.0)
        for number in range(10):
            expected = (0.0, 0.0, 0.05 + 0.1 * number)
            slack_m = (number + 1) * self.depth_tolerance_m
            assert np.abs(current_pose(engine, f"box{number}")[:3] - expected).max() < slack_m, number

    @pytest.mark.parametrize("mass_kg", [0.3, 5.0])
    @pytest.mark.parametrize("is_attached", [True, False])
    def test_a_cup_is_carried_on_a_tray_that_is_lifted_and_moved(
        self, engine: Engine, mass_kg: float, is_attached: bool
    ) -> None:
        """The largest acceleration, 5.77 s/T² of a path of minimum jerk, is below mu g: the cup does not slip.

        The tray is kinematic itself, or attached to a kinematic hand.
        """
        require_kinematic_velocities(engine)
        mover, start = ("hand", (-0.25, 0.0, 0.71)) if is_attached else ("tray", (0.0, 0.0, 0.71))
        tray = body("tray", (0, 0, 0.71), (0.4, 0.3, 0.02), "dynamic" if is_attached else "kinematic", 0.6)
        cup = body("cup", (0.05, 0, 0.77), (0.08, 0.08, 0.1), "dynamic", mass_kg)
        hand = body("hand", (-0.25, 0, 0.71), (0.04, 0.1, 0.04), "kinematic")
        spawn(engine, FLOOR, body("table", (0, 0, 0.35), (1.2, 0.8, 0.7)), tray, cup, hand)
        engine.step(1.0)
        if is_attached:
            engine.apply(Attach(BodyId("hand"), BodyId("tray")))
        before, commanded = relative(engine, "cup", "tray"), Pose(start)

        def slip_after(delta: tuple[float, float, float], duration_s: float) -> float:
            nonlocal commanded
            first, slip_m = commanded, 0.0

            def pose_at(share: float) -> Pose:
                nonlocal commanded, slip_m
                if share > 0.0:
                    slip_m = max(slip_m, float(np.abs(relative(engine, "cup", "tray") - before).max()))
                commanded = Pose(tuple((np.array(first.position) + share * np.array(delta)).tolist()))
                return commanded

            move(engine, mover, pose_at, duration_s)
            error = np.abs(current_pose(engine, mover)[:3] - commanded.position).max()
            assert error <= self.commanded_tolerance
            return max(slip_m, float(np.abs(relative(engine, "cup", "tray") - before).max()))

        assert slip_after((0.0, 0.0, 0.1), 1.0) < self.carried_tolerance_m
        assert slip_after((0.5, 0.0, 0.0), 2.5) < self.carried_tolerance_m
        assert slip_after((0.0, 0.0, -0.05), 0.5) < self.carried_tolerance_m
        engine.step(1.0)
        assert float(np.abs(relative(engine, "cup", "tray") - before).max()) < self.carried_tolerance_m
        error = np.abs(current_pose(engine, mover)[:3] - commanded.position).max()
        assert error <= self.commanded_tolerance, "the load has moved it"
        if Capability.STATISTICS in engine.capabilities:
            engine.step(1.0)
            assert engine.stats().awake == 0

    def test_a_cup_turns_with_the_turntable_that_carries_it(self, engine: Engine) -> None:
        """At r = 0.15 m, w² r stays below mu g."""
        require_kinematic_velocities(engine)
        spawn(
            engine, FLOOR, body("table", (0, 0, 0.5), (0.5, 0.5, 0.02), "kinematic"),
            body("cup", (0.15, 0, 0.56), (0.06, 0.06, 0.1), "dynamic", 0.3),
        )  # fmt: skip
        engine.step(1.0)
        before = relative(engine, "cup", "table")

        def pose_at(share: float) -> Pose:
            angle = share * math.pi
            return Pose((0.0, 0.0, 0.5), (math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)))

        move(engine, "table", pose_at, 4.0)
        engine.step(0.5)
        slip = relative(engine, "cup", "table") - before
        assert float(np.abs(slip[1:]).max()) < self.carried_tolerance_m
        assert abs(float(slip[0])) < self.turned_tolerance_m

    def test_a_tray_that_accelerates_faster_than_friction_allows_leaves_the_cup_behind(self, engine: Engine) -> None:
        """At 4 m/s² and mu 0.2, the cup is accelerated by mu g only: it has moved by mu g t²/2 when the tray stops."""
        require_kinematic_velocities(engine)
        tray = body("tray", (0, 0, 0.5), (2.0, 0.3, 0.02), "kinematic")
        cup = body("cup", (0.5, 0, 0.56), (0.1, 0.1, 0.1), "dynamic", 0.3)
        spawn(engine, FLOOR, tray, cup, friction={"cup": 0.2})
        engine.step(1.0)
        start = current_pose(engine, "cup")
        for cycle in range(1, 21):
            engine.apply(SetPoses({BodyId("tray"): Pose((2.0 * (0.02 * cycle) ** 2, 0.0, 0.5))}))
            engine.step(0.02)
        moved = float(current_pose(engine, "cup")[0] - start[0])
        assert moved == pytest.approx(0.2 * G * 0.4**2 / 2, rel=3 * self.tolerance)

    def test_a_body_that_is_put_elsewhere_has_no_velocity(self, engine: Engine) -> None:
        """What stood on it stays and falls; what it is put below is not thrown up."""
        tray = body("tray", (0, 0, 0.5), (0.4, 0.4, 0.02), "kinematic")
        left, other = (
            body(name, (x, 0, 0.56), (0.1, 0.1, 0.1), "dynamic", 0.3) for name, x in (("left", 0.0), ("other", 3.0))
        )
        spawn(engine, FLOOR, tray, left, other, body("shelf", (3.0, 0, 0.25), (0.05, 0.05, 0.5)))
        engine.step(1.0)
        engine.apply(SetPoses({BodyId("tray"): Pose((3.0, 0.0, 0.5 - 0.0005))}))
        highest_m = 0.0
        for _ in range(50):
            engine.step(0.02)
            highest_m = max(highest_m, float(current_pose(engine, "other")[2]))
        assert current_pose(engine, "left")[2] == pytest.approx(0.05, abs=0.005)
        assert np.abs(current_pose(engine, "left")[:2]).max() < 0.01
        assert highest_m < 0.57
        assert np.abs(current_pose(engine, "tray")[:3] - (3.0, 0.0, 0.4995)).max() <= self.commanded_tolerance

    @pytest.mark.parametrize("stated", [(), ("floor",), ("mat",), ("floor", "mat", "pot")])
    def test_a_heavy_pot_does_not_sink_into_a_light_mat(self, engine: Engine, stated: tuple[str, ...]) -> None:
        """Rigid bodies do not sink in; whoever states a friction."""
        for mat_kg, depth_m in (
            (0.5, self.depth_tolerance_m),
            (0.02, self.depth_tolerance_m),
            (0.005, 2 * self.depth_tolerance_m),
        ):
            engine.clear()
            floor = body("floor", (0, 0, -0.05), (4, 4, 0.1))
            mat = body("mat", (0, 0, 0.005), (0.2, 0.2, 0.01), "dynamic", mat_kg)
            pot = body("pot", (0, 0, 0.06), (0.16, 0.16, 0.1), "dynamic", 2.0)
            spawn(engine, floor, mat, pot, friction=dict.fromkeys(stated, 0.5))
            engine.step(3.0)
            assert abs(0.06 - current_pose(engine, "pot")[2]) < depth_m, mat_kg
            assert abs(0.005 - current_pose(engine, "mat")[2]) < depth_m, mat_kg

    def test_a_ball_rolls_down_an_incline_slower_than_it_would_slide(self, engine: Engine) -> None:
        """A solid ball moves by 5/7 g sin(a) t²/2, less the rolling friction."""
        angle, duration_s, radius = math.radians(10.0), 0.8, 0.05
        turned = about_y(angle)
        x, y, z = (quat_rotate(np.array(turned), UP) * (0.1 + radius)).tolist()
        spawn(engine, body("ramp", (0, 0, 0), (8, 2, 0.2), quaternion=turned), ball("ball", (x, y, z), radius, 0.3))
        engine.step(duration_s)
        moved = float(np.linalg.norm(current_pose(engine, "ball")[:3] - (x, y, z)))
        assert moved == pytest.approx(5 / 7 * G * math.sin(angle) * duration_s**2 / 2, rel=2 * self.tolerance)

    @pytest.mark.parametrize("floor", ["box", "hull", "plane"])
    @pytest.mark.parametrize("direction_deg", [0, 45, 80, 135, 180, 217, 270, 315])
    def test_a_ball_rolls_straight_and_gains_no_energy(self, engine: Engine, floor: str, direction_deg: int) -> None:
        """On a level floor its speed never grows, and it stays on its line."""
        direction = np.array([math.cos(math.radians(direction_deg)), math.sin(math.radians(direction_deg)), 0.0])
        spawn_on(engine, floor, ball("ball", (0, 0, 0.05), 0.05, 0.3))
        positions = roll(engine, "ball", direction, force_n=3.0)
        offsets = positions - positions[0]
        along, beside = offsets @ direction, offsets @ np.cross(UP, direction)
        assert along[-1] > 5.0
        assert np.abs(beside[along <= 5.0]).max() < self.line_tolerance_m
        speeds = np.diff(along[::5])
        assert speeds[1:].max() <= speeds[0] * (1.0 + self.tolerance / 2)  # twice as much in energy

    @pytest.mark.parametrize("floor", ["box", "hull", "plane"])
    @pytest.mark.parametrize("direction_deg", [0, 45, 80, 135, 180, 217, 270, 315])
    def test_a_lying_can_gains_no_energy(self, engine: Engine, floor: str, direction_deg: int) -> None:
        """On a level floor its speed never grows."""
        angle = math.radians(direction_deg)
        direction = np.array([math.cos(angle), math.sin(angle), 0.0])
        axis = math.pi / 2 + angle  # its own z axis lies across the direction
        lying = (math.sqrt(0.5) * np.array([1.0, -math.sin(axis), math.cos(axis), 0.0])).tolist()
        can = body(
            "can", (0, 0, 0.033), (0.066, 0.066, 0.12), "dynamic", 0.35,
            quaternion=tuple(lying), shape=PrimitiveShape(type=PrimitiveType.CYLINDER),
        )  # fmt: skip
        spawn_on(engine, floor, can)
        positions = roll(engine, "can", direction, force_n=3.5)
        along = (positions - positions[0]) @ direction
        speeds = np.diff(along[::5])
        assert along[-1] > 1.0
        assert speeds[1:].max() <= speeds[0] * (1.0 + self.tolerance / 2)

    @pytest.mark.parametrize(
        ("size", "mass_kg", "drop_m"),
        [
            pytest.param((0.015, 0.015, 0.015), 0.003, 1.0, id="a cube of 3 g"),
            pytest.param((0.2, 0.02, 0.002), 0.08, 1.5, id="a knife of 2 mm"),
            pytest.param((0.2, 0.2, 0.2), 5.0, 2.0, id="a cube of 5 kg"),
        ],
    )
    @pytest.mark.parametrize("shelf_m", [0.018, 0.005])
    def test_what_falls_on_a_shelf_stops_on_it(
        self, engine: Engine, size: tuple[float, float, float], mass_kg: float, drop_m: float, shelf_m: float
    ) -> None:
        """A rigid body does not pass through another one, however fast it is."""
        shelf = body("shelf", (0, 0, 1.0 - shelf_m / 2), (0.8, 0.4, shelf_m))
        spawn(engine, FLOOR, shelf, body("thing", (0, 0, 1.0 + size[2] / 2 + drop_m), size, "dynamic", mass_kg))
        engine.step(3.0)
        assert current_pose(engine, "thing")[2] == pytest.approx(1.0 + size[2] / 2, abs=2 * self.depth_tolerance_m)


def ball(id: str, position: tuple[float, float, float], radius_m: float, mass_kg: float) -> Body:
    """A loose ball."""
    shape = PrimitiveShape(type=PrimitiveType.SPHERE)
    return body(id, position, (2 * radius_m,) * 3, "dynamic", mass_kg, shape=shape)


def spawn_on(engine: Engine, floor: str, thing: Body) -> None:
    """Spawns a thing on a level floor of a kind: a box, a hull, or the ground that the engine adds."""
    if floor == "plane":
        assert engine.apply(Spawn(world(thing), ground=True)).report.ok
        return
    size = (100.0, 100.0, 0.1)
    corners = tuple((x, y, z) for x in (-50.0, 50.0) for y in (-50.0, 50.0) for z in (-0.05, 0.05))
    hull = CollisionShape(type=CollisionShapeType.HULL, size=size, points=corners)
    stated = {BodyId("floor"): geometry(hull)} if floor == "hull" else {}
    assert engine.apply(Spawn(world(body("floor", (0, 0, -0.05), size), thing), geometry=stated)).report.ok


def roll(engine: Engine, id: str, direction: np.ndarray, *, force_n: float) -> np.ndarray:
    """Pushes a round thing for 0.15 s; its positions from 0.3 s later on, for 60 s, at most 20 m away [m]."""
    engine.step(0.5)
    x, y, z = (force_n * direction).tolist()
    apply_force_for(engine, id, (x, y, z), 0.15)
    engine.step(0.3)
    positions = [current_pose(engine, id)[:3]]
    for _ in range(round(60.0 / 0.02)):
        engine.step(0.02)
        positions.append(current_pose(engine, id)[:3])
        if np.linalg.norm(positions[-1][:2]) > 20.0 or np.array_equal(positions[-1], positions[-2]):
            break
    return np.array(positions)
