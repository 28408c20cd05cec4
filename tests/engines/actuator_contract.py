"""The contract of engines with actuators: position, velocity and effort, limits, and a gripper that holds a carton."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mindstage.engines import Actuator, ActuatorMode, ActuatorState, Capability, Engine
from mindstage.engines.edits import SetActuators
from mindstage.errors import BodyNotFoundError, UnsupportedByEngineError
from mindstage.scene import AngularLimits, AxisMotion, BodyId, Iri, Joint, JointMimic, LinearLimits, Pose, World
from mindstage.scene.edits import Attach, Delete, Detach, Spawn
from tests.engines.scenes import BASE, FLOOR, body, prismatic_joint, world

GRAVITY = 9.81
UP = (math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0)
"""Turns the x axis of a joint upwards."""
ALONG_Y = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
"""Turns the x axis of a joint to the left."""


def hinge(id: str, parent: str, child: str, at: tuple[float, float, float], limit: float = 1.5) -> Joint:
    """A joint about y: a positive angle lowers what is in front."""
    angular = AngularLimits(swing2=AxisMotion.LIMITED, swing2_limit=limit)
    return Joint(
        id=BodyId(id), iri=Iri(BASE + id), parent=BodyId(parent), child=BodyId(child), pose=Pose(at), angular=angular
    )


def arm_world() -> World:
    """A horizontal beam of 2 kg, whose center is 0.3 m in front of its hinge, beside a cart on a rail."""
    return world(
        body("post", (0, 0, 1.0), (0.1, 0.1, 2.0)),
        body("beam", (0.3, 0.1, 1.5), (0.5, 0.05, 0.05), "dynamic", 2.0),
        body("rail", (0, -2, 0.5), (0.2, 0.2, 0.1)),
        body("cart", (0, -2, 0.7), (0.2, 0.2, 0.2), "dynamic", 4.0),
        hinge("shoulder", "post", "beam", (0, 0.1, 1.5)),
        prismatic_joint("slide", "rail", "cart", (0, -2, 0.7), limit=1.0),
    )


def base_world() -> World:
    """A base that moves over the floor in every direction."""
    free = AxisMotion.FREE
    joint = Joint(
        id=BodyId("drive"), iri=Iri(BASE + "drive"), parent=BodyId("odom"), child=BodyId("base"),
        pose=Pose((1, 2, 0.3)), linear=LinearLimits(x=free, y=free), angular=AngularLimits(swing1=free),
    )  # fmt: skip
    return world(
        FLOOR,
        body("odom", (1, 2, 0.3), (0.01, 0.01, 0.01)),
        body("base", (1, 2, 0.3), (0.4, 0.4, 0.4), "dynamic", 40.0),
        joint,
    )


def gripper_world() -> World:
    """A parallel gripper on a lift, around a carton of 1 kg that stands on a table."""
    mimic = JointMimic(joint=BodyId("left_slide"), multiplier=-1.0)
    return world(
        FLOOR,
        body("table", (0, 0, 0.35), (0.6, 0.6, 0.7)),
        body("carton", (0, 0, 0.8), (0.07, 0.07, 0.2), "dynamic", 1.0),
        body("post", (-0.5, 0, 1.0), (0.05, 0.05, 2.0)),
        body("hand", (-0.2, 0, 0.85), (0.1, 0.1, 0.05), "dynamic", 1.0),
        body("left", (-0.05, 0.055, 0.85), (0.2, 0.01, 0.03), "dynamic", 0.1),
        body("right", (-0.05, -0.055, 0.85), (0.2, 0.01, 0.03), "dynamic", 0.1),
        prismatic_joint("lift", "post", "hand", (-0.2, 0, 0.85), quaternion=UP, limit=0.5),
        prismatic_joint("left_slide", "hand", "left", (-0.05, 0.055, 0.85), quaternion=ALONG_Y, limit=0.05),
        prismatic_joint(
            "right_slide", "hand", "right", (-0.05, -0.055, 0.85), quaternion=ALONG_Y, limit=0.05, mimic=mimic
        ),
    )  # fmt: skip


def servo(name: str, joint: str, **more: object) -> Actuator:
    """A stiff position servo."""
    settings = {"effort_limit": 200.0, "stiffness": 2000.0, "damping": 100.0} | more
    return Actuator(name=name, joint=BodyId(joint), **settings)  # type: ignore[arg-type]


def drive(name: str, joint: str, **more: object) -> Actuator:
    """A velocity servo."""
    settings = {"mode": ActuatorMode.VELOCITY, "effort_limit": 200.0, "damping": 400.0} | more
    return Actuator(name=name, joint=BodyId(joint), **settings)  # type: ignore[arg-type]


def state(engine: Engine, name: str) -> ActuatorState:
    return engine.actuator_states()[name]


def position_of(engine: Engine, id: str) -> np.ndarray:
    ids, poses = engine.poses()
    return np.array(poses[ids.index(BodyId(id)), :3])


def step(engine: Engine, duration_s: float) -> None:
    for _ in range(round(duration_s / 0.02)):
        engine.step(0.02)


class ActuatorContract:
    """The contract of engines with the capability ACTUATORS; engines without it refuse the calls."""

    servo_tolerance = 1e-3
    """Maximum deviation from a commanded position without load [m, rad]."""
    speed_tolerance = 0.01
    """Relative error of a commanded velocity."""
    effort_tolerance = 0.02
    """Relative error of efforts."""
    has_armature = True
    """Whether the inertia of drives is simulated."""
    measures_efforts = True
    """Whether the reported effort of a velocity servo is the one exerted, and not its bound."""
    grip_tolerance_m = 1e-3
    """How far a carton slips while it is lifted and held for 5 s [m]."""

    @pytest.fixture(autouse=True)
    def _require_actuators(self, engine: Engine, request: pytest.FixtureRequest) -> None:
        if "without_the_capability" not in request.node.name and Capability.ACTUATORS not in engine.capabilities:
            pytest.skip("the engine has no ACTUATORS capability")

    def test_without_the_capability_every_call_is_refused(self, engine: Engine) -> None:
        if Capability.ACTUATORS in engine.capabilities:
            pytest.skip("the engine has the ACTUATORS capability")
        engine.apply(Spawn(arm_world()))
        for call in (
            lambda: engine.apply(SetActuators((servo("a", "shoulder"),))),
            lambda: engine.set_commands({"a": 0.0}),
            engine.actuator_states,
        ):
            with pytest.raises(UnsupportedByEngineError, match="drive joints"):
                call()

    def test_a_new_servo_holds_the_current_position(self, engine: Engine) -> None:
        engine.apply(Spawn(arm_world()))
        engine.step(0.02)
        engine.apply(SetActuators((servo("shoulder", "shoulder"),), (BodyId("beam"),)))
        before = state(engine, "shoulder")
        assert before.command == pytest.approx(before.position, abs=1e-6)
        step(engine, 1.0)
        after = state(engine, "shoulder")
        assert after.position == pytest.approx(before.position, abs=self.servo_tolerance)
        assert after.command == before.command

    @pytest.mark.parametrize("target", [0.6, -0.9])
    def test_a_servo_reaches_its_command_and_reports_what_joint_positions_report(
        self, engine: Engine, target: float
    ) -> None:
        engine.apply(Spawn(arm_world()))
        engine.apply(SetActuators((servo("arm", "shoulder"), servo("cart", "slide", damping=300.0)), (BodyId("beam"),)))
        engine.set_commands({"arm": target, "cart": -target / 2})
        step(engine, 2.0)
        arm, cart = state(engine, "arm"), state(engine, "cart")
        assert arm.position == pytest.approx(target, abs=self.servo_tolerance)
        assert cart.position == pytest.approx(-target / 2, abs=self.servo_tolerance)
        assert max(abs(arm.velocity), abs(cart.velocity)) < 0.01
        positions = engine.joint_positions()
        assert positions[BodyId("shoulder")][4] == pytest.approx(arm.position, abs=1e-5)
        assert positions[BodyId("slide")][0] == pytest.approx(cart.position, abs=1e-5)
        beam = position_of(engine, "beam")
        np.testing.assert_allclose(beam, (0.3 * math.cos(target), 0.1, 1.5 - 0.3 * math.sin(target)), atol=2e-3)

    def test_the_effort_carries_the_weight_and_the_servo_yields_as_a_spring_does(self, engine: Engine) -> None:
        engine.apply(Spawn(arm_world()))
        engine.apply(SetActuators((servo("arm", "shoulder", stiffness=200.0, damping=20.0),)))
        step(engine, 3.0)
        at = state(engine, "arm")
        moment = 2.0 * GRAVITY * 0.3 * math.cos(at.position)
        assert at.effort == pytest.approx(-moment, rel=self.effort_tolerance)
        assert at.position == pytest.approx(moment / 200.0, rel=self.effort_tolerance)

    def test_without_weight_a_drive_carries_nothing(self, engine: Engine) -> None:
        engine.apply(Spawn(arm_world()))
        engine.apply(SetActuators((servo("arm", "shoulder"),), (BodyId("beam"),)))
        engine.set_commands({"arm": 0.3})
        step(engine, 2.0)
        assert abs(state(engine, "arm").effort) < 0.2

    def test_a_drive_that_is_too_weak_falls_at_its_limit(self, engine: Engine) -> None:
        engine.apply(Spawn(arm_world()))
        engine.apply(SetActuators((servo("arm", "shoulder", effort_limit=2.0),)))
        states = []
        for _ in range(50):
            engine.step(0.02)
            states.append(state(engine, "arm"))
        assert max(each.position for each in states) > 1.2, "5.9 Nm are needed"
        assert max(abs(each.effort) for each in states) == pytest.approx(2.0, rel=1e-4)

    def test_a_velocity_is_held_against_a_load(self, engine: Engine) -> None:
        engine.apply(Spawn(arm_world()))
        engine.apply(SetActuators((drive("cart", "slide", damping=5000.0),)))
        engine.set_commands({"cart": 0.25})
        step(engine, 0.5)
        start = state(engine, "cart").position
        for _ in range(50):
            engine.apply_force(BodyId("cart"), (-10.0, 0.0, 0.0))
            engine.step(0.02)
        now = state(engine, "cart")
        assert now.velocity == pytest.approx(0.25 - 10.0 / 5000.0, rel=self.speed_tolerance)
        assert now.position - start == pytest.approx(now.velocity, rel=self.speed_tolerance)
        if self.measures_efforts:
            assert now.effort == pytest.approx(10.0, rel=0.1)

    def test_an_effort_accelerates_the_mass_and_the_armature(self, engine: Engine) -> None:
        engine.apply(Spawn(arm_world()))
        pushed = {"mode": ActuatorMode.EFFORT, "effort_limit": 20.0}
        armature = 2.0 if self.has_armature else 0.0
        engine.apply(SetActuators((servo("cart", "slide", armature=armature, stiffness=0.0, damping=0.0, **pushed),)))
        engine.set_commands({"cart": 50.0})
        step(engine, 0.2)
        now = state(engine, "cart")
        assert now.effort == pytest.approx(20.0), "limited"
        assert now.command == 50.0
        assert now.velocity == pytest.approx(20.0 / (4.0 + armature) * 0.2, rel=0.05)

    def test_friction_of_a_drive_holds_what_is_below_it(self, engine: Engine) -> None:
        engine.apply(Spawn(arm_world()))
        effort = {"mode": ActuatorMode.EFFORT, "stiffness": 0.0, "damping": 0.0, "friction": 6.0}
        engine.apply(SetActuators((servo("cart", "slide", **effort),)))
        engine.set_commands({"cart": 5.0})
        step(engine, 0.5)
        assert abs(state(engine, "cart").position) < 2e-3
        engine.set_commands({"cart": 8.0})
        step(engine, 0.5)
        assert state(engine, "cart").velocity == pytest.approx((8.0 - 6.0) / 4.0 * 0.5, rel=0.1)

    def test_three_drives_of_one_joint_move_a_base_over_the_floor(self, engine: Engine) -> None:
        engine.apply(Spawn(base_world()))
        engine.apply(
            SetActuators(
                (
                    servo("x", "drive", axis="x", stiffness=2e4, damping=2e3, effort_limit=500.0),
                    servo("y", "drive", axis="y", stiffness=2e4, damping=2e3, effort_limit=500.0),
                    servo("yaw", "drive", axis="swing1", stiffness=2e3, damping=2e2, effort_limit=200.0),
                )
            )
        )
        engine.set_commands({"x": 0.5, "y": -0.3, "yaw": 2.0})
        step(engine, 2.0)
        found = [state(engine, name).position for name in ("x", "y", "yaw")]
        assert found == pytest.approx([0.5, -0.3, 2.0], abs=5e-3)
        np.testing.assert_allclose(position_of(engine, "base"), (1.5, 1.7, 0.3), atol=5e-3)

    def test_full_turns_are_counted(self, engine: Engine) -> None:
        engine.apply(Spawn(base_world()))
        engine.apply(
            SetActuators(
                (
                    servo("x", "drive", axis="x", stiffness=2e4, damping=2e3),
                    servo("y", "drive", axis="y", stiffness=2e4, damping=2e3),
                    drive("yaw", "drive", axis="swing1", damping=2e2),
                )
            )
        )
        engine.set_commands({"yaw": 2.0})
        step(engine, 5.0)
        assert state(engine, "yaw").position == pytest.approx(10.0, rel=0.02)

    def test_positions_refer_to_the_parent_of_the_map(self, engine: Engine) -> None:
        engine.apply(
            Spawn(
                world(
                    body("rail", (0, 0, 0.5), (0.2, 0.2, 0.1)),
                    body("cart", (0, 0, 0.7), (0.2, 0.2, 0.2), "dynamic", 4.0),
                    prismatic_joint("slide", "cart", "rail", (0, 0, 0.7), limit=1.0),
                )
            )
        )
        engine.apply(SetActuators((servo("cart", "slide", damping=300.0),)))
        engine.set_commands({"cart": 0.4})
        step(engine, 1.5)
        assert state(engine, "cart").position == pytest.approx(0.4, abs=self.servo_tolerance)
        assert engine.joint_positions()[BodyId("slide")][0] == pytest.approx(0.4, abs=self.servo_tolerance)
        assert position_of(engine, "cart")[0] == pytest.approx(-0.4, abs=self.servo_tolerance)

    def test_an_edit_keeps_commands_and_positions(self, engine: Engine) -> None:
        engine.apply(Spawn(arm_world()))
        engine.apply(SetActuators((servo("arm", "shoulder"),), (BodyId("beam"),)))
        engine.set_commands({"arm": 0.5})
        step(engine, 2.0)
        before = state(engine, "arm")
        engine.apply(Spawn(world(body("crate", (5, 5, 1), (0.2, 0.2, 0.2), "dynamic", 1.0))))
        step(engine, 0.5)
        engine.apply(Attach(BodyId("beam"), BodyId("crate")))
        engine.apply(Detach(BodyId("crate")))
        step(engine, 0.5)
        after = state(engine, "arm")
        assert after.command == 0.5
        assert after.position == pytest.approx(before.position, abs=self.servo_tolerance)

    def test_a_command_before_the_next_step_of_an_edited_world_counts(self, engine: Engine) -> None:
        engine.apply(Spawn(arm_world()))
        engine.apply(SetActuators((servo("arm", "shoulder"),), (BodyId("beam"),)))
        engine.apply(Spawn(world(body("crate", (5, 5, 1), (0.2, 0.2, 0.2), "dynamic", 1.0))))
        engine.set_commands({"arm": -0.4})
        step(engine, 2.0)
        assert state(engine, "arm").position == pytest.approx(-0.4, abs=self.servo_tolerance)

    def test_a_restored_state_has_the_actuators_and_commands_of_then(self, engine: Engine) -> None:
        if Capability.SAVE not in engine.capabilities:
            pytest.skip("the engine has no SAVE capability")
        engine.apply(Spawn(arm_world()))
        without = engine.save_state()
        engine.apply(SetActuators((servo("arm", "shoulder"),), (BodyId("beam"),)))
        engine.set_commands({"arm": 0.5})
        step(engine, 0.1)
        saved, before = engine.save_state(), engine.actuator_states()
        step(engine, 1.0)
        expected = engine.actuator_states()
        engine.set_commands({"arm": -0.7})
        step(engine, 1.0)
        engine.restore_state(saved)
        assert state(engine, "arm").position == pytest.approx(before["arm"].position, abs=1e-5)
        assert state(engine, "arm").command == 0.5
        step(engine, 1.0)
        assert state(engine, "arm").position == pytest.approx(expected["arm"].position, abs=1e-5)
        engine.restore_state(without)
        assert engine.actuator_states() == {}

    def test_a_fork_has_drives_of_its_own(self, engine: Engine) -> None:
        if Capability.FORK not in engine.capabilities:
            pytest.skip("the engine has no FORK capability")
        engine.apply(Spawn(arm_world()))
        engine.apply(SetActuators((servo("arm", "shoulder"),), (BodyId("beam"),)))
        engine.set_commands({"arm": 0.5})
        step(engine, 0.1)
        forked = engine.fork()
        forked.set_commands({"arm": -0.5})
        step(engine, 2.0)
        step(forked, 2.0)
        assert state(engine, "arm").position == pytest.approx(0.5, abs=self.servo_tolerance)
        assert state(forked, "arm").position == pytest.approx(-0.5, abs=self.servo_tolerance)

    def test_replacing_a_servo_by_a_velocity_keeps_the_motion(self, engine: Engine) -> None:
        engine.apply(Spawn(arm_world()))
        engine.apply(SetActuators((servo("cart", "slide", damping=300.0),)))
        engine.set_commands({"cart": 0.3})
        step(engine, 1.5)
        engine.apply(SetActuators((drive("cart", "slide"),)))
        assert state(engine, "cart").command == 0.0
        step(engine, 0.5)
        assert state(engine, "cart").position == pytest.approx(0.3, abs=2 * self.servo_tolerance)
        engine.set_commands({"cart": -0.2})
        step(engine, 1.0)
        assert state(engine, "cart").velocity == pytest.approx(-0.2, rel=self.speed_tolerance)

    def test_actuators_are_removed_with_their_joints(self, engine: Engine) -> None:
        engine.apply(Spawn(arm_world()))
        engine.apply(SetActuators((servo("arm", "shoulder"), servo("cart", "slide"))))
        engine.step(0.1)
        engine.apply(Delete((BodyId("beam"),)))
        engine.step(0.1)
        assert set(engine.actuator_states()) == {"cart"}
        with pytest.raises(KeyError, match="arm"):
            engine.set_commands({"arm": 0.0})
        engine.clear()
        assert engine.actuator_states() == {}

    def test_invalid_actuators_and_commands_are_refused_and_change_nothing(self, engine: Engine) -> None:
        engine.apply(Spawn(arm_world()))
        engine.apply(SetActuators((servo("arm", "shoulder"),)))
        engine.step(0.02)
        before = engine.actuator_states()
        good = servo("cart", "slide")
        for bad, error, words in (
            (servo("b", "sholder"), BodyNotFoundError, "shoulder"),
            (servo("b", "slide", axis="y"), ValueError, "moves along x"),
            (servo("b", "slide", axis="up"), ValueError, "'up'"),
            (servo("b", "shoulder"), ValueError, "'arm' drives already"),
        ):
            with pytest.raises(error, match=words):
                engine.apply(SetActuators((good, bad)))
        with pytest.raises(BodyNotFoundError, match="beam"):
            engine.apply(SetActuators((good,), (BodyId("beem"),)))
        with pytest.raises(ValueError, match="finite"):
            engine.set_commands({"arm": math.inf})
        with pytest.raises(KeyError, match="hand"):
            engine.set_commands({"arm": 0.3, "hand": 0.0})
        assert engine.actuator_states() == before

    def test_an_arm_wakes_a_body_that_sleeps(self, engine: Engine) -> None:
        crate = body("crate", (0.62, -2, 0.701), (0.2, 0.2, 0.2), "dynamic", 1.0)
        engine.apply(
            Spawn(
                world(*arm_world().bodies, *arm_world().joints, body("plate", (0.9, -2, 0.49), (1.0, 0.6, 0.2)), crate)
            )
        )
        engine.apply(SetActuators((servo("cart", "slide", damping=300.0),)))
        step(engine, 4.0)
        start = position_of(engine, "crate")
        engine.set_commands({"cart": 0.7})
        step(engine, 2.0)
        moved = position_of(engine, "crate") - start
        assert moved[0] == pytest.approx(0.7 - 0.42, abs=0.05)

    def test_excluded_pairs_do_not_collide(self, engine: Engine) -> None:
        crate = body("crate", (0.45, -2, 0.7), (0.2, 0.2, 0.2))
        parts = (*arm_world().bodies, *arm_world().joints)
        pair = (BodyId("crate"), BodyId("cart"))
        for excluded, reached in ((frozenset[tuple[BodyId, BodyId]](), 0.25), (frozenset({pair}), 0.6)):
            engine.clear()
            engine.apply(Spawn(world(*parts, crate), excluded_pairs=excluded))
            engine.apply(SetActuators((servo("cart", "slide", damping=300.0),)))
            engine.set_commands({"cart": 0.6})
            step(engine, 2.0)
            assert position_of(engine, "cart")[0] == pytest.approx(reached, abs=0.01)
            engine.apply(Attach(BodyId("rail"), BodyId("beam")))  # another edit
            engine.set_commands({"cart": 0.0})
            step(engine, 2.0)
            engine.set_commands({"cart": 0.6})
            step(engine, 2.0)
            assert position_of(engine, "cart")[0] == pytest.approx(reached, abs=0.01)

    def test_a_gripper_lifts_a_carton_by_friction_and_lets_it_fall(self, engine: Engine) -> None:
        engine.apply(Spawn(gripper_world()))
        engine.apply(
            SetActuators(
                (
                    servo("lift", "lift", stiffness=2e4, damping=1e3),
                    servo("grip", "left_slide", stiffness=2e3, damping=50.0, effort_limit=40.0),
                ),
                tuple([BodyId(id) for id in ("hand", "left", "right")]),
            )
        )
        step(engine, 0.5)
        engine.set_commands({"grip": -0.04})
        step(engine, 1.0)
        hand_start, carton_start = position_of(engine, "hand"), position_of(engine, "carton")
        for number in range(1, 201):
            part = number / 200
            engine.set_commands({"lift": 0.3 * (3 * part**2 - 2 * part**3)})
            engine.step(0.01)
        step(engine, 5.0)
        lifted = position_of(engine, "hand") - hand_start
        carried = position_of(engine, "carton") - carton_start
        assert lifted[2] == pytest.approx(0.3, abs=5e-3)
        assert carried == pytest.approx(lifted, abs=self.grip_tolerance_m)
        engine.set_commands({"grip": 0.0})
        step(engine, 1.0)
        assert position_of(engine, "carton")[2] < 0.9
