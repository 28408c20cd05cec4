"""Actuators in MuJoCo: the same motion as MuJoCo's own, stiff servos, given inertia, and pickled states."""

from __future__ import annotations

import pickle

import msgspec
import mujoco
import numpy as np
import pytest

from mindstage.engines import ActuatorMode, ActuatorState, SpawnNoteKind
from mindstage.engines.edits import SetActuators
from mindstage.engines.mujoco import MujocoEngine
from mindstage.scene import BodyGeometry, BodyId, CollisionShapeType, Mobility, PrimitiveShape, PrimitiveType, World
from mindstage.scene.edits import Delete, SetPhysics, Spawn
from mindstage.scene.geometry import Inertia
from mindstage.scene.transforms import quat_angle
from tests.engines.actuator_contract import arm_world, gripper_world, position_of, servo, state, step
from tests.engines.geometries import box_shape, single_shape_geometry
from tests.engines.scenes import body, prismatic_joint, revolute_joint, world

_TWO_LINKS = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast" cone="elliptic" impratio="100"/>
  <worldbody>
    <body pos="0 0 1">
      <joint name="shoulder" type="hinge" axis="0 0 1" range="-0.78539816 0.78539816" armature="0.05"
             solreflimit="0.005 1" solimplimit="0.95 0.999 0.0005 0.5 2"/>
      <inertial pos="0.25 0 0" mass="2" diaginertia="{first}"/>
      <body pos="0.5 0 0">
        <joint name="slide" type="slide" axis="1 0 0" range="-0.45 0.45"
               solreflimit="0.005 1" solimplimit="0.95 0.999 0.0005 0.5 2"/>
        <inertial pos="0.2 0 0" mass="1" diaginertia="{second}"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="shoulder" kp="300" kv="30" forcerange="-40 40"/>
    <velocity joint="slide" kv="50" forcerange="-20 20"/>
  </actuator>
</mujoco>
"""


def _two_links() -> World:
    return world(
        body("base", (0, 0, 0.5), (0.1, 0.1, 0.8)),
        body("upper", (0.25, 0, 1.0), (0.4, 0.06, 0.06), "dynamic", 2.0),
        body("lower", (0.7, 0, 1.0), (0.3, 0.04, 0.04), "dynamic", 1.0),
        revolute_joint("shoulder", "base", "upper", (0, 0, 1.0)),
        prismatic_joint("slide", "upper", "lower", (0.5, 0, 1.0)),
    )


def _box_moments(mass: float, x: float, y: float, z: float) -> str:
    return " ".join(str(mass / 12 * each) for each in (y * y + z * z, x * x + z * z, x * x + y * y))


def test_the_motion_is_that_of_the_same_drives_in_mjcf() -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(_two_links()))
    engine.apply(
        SetActuators(
            (
                servo("arm", "shoulder", stiffness=300.0, damping=30.0, effort_limit=40.0, armature=0.05),
                servo("rod", "slide", mode=ActuatorMode.VELOCITY, stiffness=0.0, damping=50.0, effort_limit=20.0),
            )
        )
    )
    text = _TWO_LINKS.format(first=_box_moments(2.0, 0.4, 0.06, 0.06), second=_box_moments(1.0, 0.3, 0.04, 0.04))
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    for number in range(200):
        commands = (0.6 * np.sin(number / 20), 0.4 * np.cos(number / 15))
        engine.set_commands({"arm": commands[0], "rod": commands[1]})
        data.ctrl[:] = commands
        engine.step(0.01)
        mujoco.mj_step(model, data, nstep=5)
        arm, rod = state(engine, "arm"), state(engine, "rod")
        np.testing.assert_allclose((arm.position, rod.position), data.qpos, atol=1e-8)
        np.testing.assert_allclose((arm.velocity, rod.velocity), data.qvel, atol=1e-7)
        np.testing.assert_allclose((arm.effort, rod.effort), data.actuator_force, atol=1e-5)


def test_a_servo_too_stiff_for_the_time_step_is_limited_and_reported_once() -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(_two_links()))
    engine.apply(SetActuators((servo("arm", "shoulder", stiffness=1e9, damping=0.0, effort_limit=1e4),)))
    engine.set_commands({"arm": 0.2})
    for _ in range(100):
        engine.step(0.002)
        assert abs(state(engine, "arm").position) < 0.5
    engine.apply(Spawn(world(body("other", (5, 5, 1), (0.1, 0.1, 0.1)))))
    engine.step(0.1)
    (note,) = (note for note in engine.notes if note.kind is SpawnNoteKind.CLAMPED)
    assert note.ids == ("shoulder",)
    assert "unstable" in note.text
    assert MujocoEngine().notes == ()


def test_a_stiff_servo_with_damping_is_exact() -> None:
    """As stiff as the drives of an industrial arm: nothing is limited, and it does not tremble."""
    engine = MujocoEngine()
    engine.apply(Spawn(_two_links()))
    engine.apply(SetActuators((servo("arm", "shoulder", stiffness=5e4, damping=800.0, effort_limit=300.0),)))
    engine.set_commands({"arm": 0.5})
    engine.step(2.0)
    assert state(engine, "arm").position == pytest.approx(0.5, abs=1e-9)
    assert abs(state(engine, "arm").velocity) < 1e-9
    assert not engine.notes


def test_a_pickled_state_has_its_actuators_and_commands() -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(arm_world()))
    engine.apply(SetActuators((servo("arm", "shoulder"),), (BodyId("beam"),)))
    engine.set_commands({"arm": 0.5})
    engine.step(0.1)
    other = MujocoEngine()
    other.restore_state(pickle.loads(pickle.dumps(engine.save_state())))
    engine.step(0.3)
    other.step(0.3)
    assert other.actuator_states() == engine.actuator_states()
    assert state(other, "arm").command == 0.5


def test_a_world_without_actuators_is_simulated_as_before() -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(arm_world()))
    assert engine.compiled().model.opt.impratio == 10.0
    assert engine.compiled().model.nu == 0
    engine.apply(SetActuators((servo("arm", "shoulder"),)))
    assert engine.compiled().model.opt.impratio == 100.0
    friction = engine.compiled().model.dof_frictionloss
    arm, cart = (engine.compiled().joints[BodyId(id)].dof_address for id in ("shoulder", "slide"))
    assert friction[arm] == 0.0
    assert friction[cart] > 0.0


def test_fingers_hold_a_ball_without_letting_it_spin() -> None:
    round_world = gripper_world()
    ball = PrimitiveShape(type=PrimitiveType.SPHERE)
    bodies = tuple(
        msgspec.structs.replace(each, shape=ball, size=(0.07, 0.07, 0.07), pose=msgspec.structs.replace(
            each.pose, position=(0.0, 0.0, 0.735))) if each.id == "carton" else
        msgspec.structs.replace(each, pose=msgspec.structs.replace(
            each.pose, position=(*each.pose.position[:2], 0.745))) if each.id in {"hand", "left", "right"} else each
        for each in round_world.bodies
    )  # fmt: skip
    engine = MujocoEngine()
    engine.apply(Spawn(msgspec.structs.replace(round_world, bodies=bodies)))
    engine.apply(
        SetActuators(
            (
                servo("lift", "lift", stiffness=2e4, damping=1e3),
                servo("grip", "left_slide", damping=50.0, effort_limit=40.0),
            ),
            tuple([BodyId(id) for id in ("hand", "left", "right")]),
        )
    )
    engine.set_commands({"grip": -0.04})
    step(engine, 1.0)
    for number in range(1, 101):
        engine.set_commands({"lift": 0.2 * number / 100})
        engine.step(0.01)
    step(engine, 1.0)
    turned = [engine.poses()[1][engine.poses()[0].index(BodyId("carton")), 3:]]
    height_m = position_of(engine, "carton")[2]
    step(engine, 5.0)
    turned.append(engine.poses()[1][engine.poses()[0].index(BodyId("carton")), 3:])
    assert height_m > 0.9
    assert position_of(engine, "carton")[2] == pytest.approx(height_m, abs=2e-3)
    assert float(quat_angle(*turned)) < 0.01


# -- inertia -----------------------------------------------------------------------------------------------------------

_INERTIA = Inertia(mass_kg=3.0, center=(0.02, -0.01, 0.03), tensor=(0.03, 0.04, 0.05, 0.002, -0.003, 0.001))


def _spawned(inertia: Inertia, *, mass: float | None = None) -> tuple[MujocoEngine, list[str]]:
    engine = MujocoEngine()
    shape = BodyGeometry(
        key="k", visuals=(), collision_shapes=(box_shape((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1)),), inertia=inertia
    )
    part = body("part", (0, 0, 1), (0.2, 0.2, 0.2), "dynamic", mass)
    report = engine.apply(Spawn(world(part), geometry={BodyId("part"): shape})).report
    return engine, [f"{note.kind.value}: {note.text}" for note in report.notes]


def test_a_given_inertia_is_that_of_mujocos_fullinertia() -> None:
    engine, notes = _spawned(_INERTIA)
    assert notes == []
    text = (
        '<mujoco><worldbody><body><freejoint/><inertial pos="0.02 -0.01 0.03" mass="3" '
        'fullinertia="0.03 0.04 0.05 0.002 -0.003 0.001"/></body></worldbody></mujoco>'
    )
    expected, found = mujoco.MjModel.from_xml_string(text), engine.compiled().model
    number = engine.compiled().body_ids[BodyId("part")]
    assert found.body_mass[number] == 3.0
    np.testing.assert_allclose(found.body_ipos[number], expected.body_ipos[1])
    matrices = []
    for model, row in ((found, number), (expected, 1)):
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.body_iquat[row])
        axes = rotation.reshape(3, 3)
        matrices.append(axes @ np.diag(model.body_inertia[row]) @ axes.T)
    np.testing.assert_allclose(matrices[0], matrices[1], atol=1e-12)


def test_the_mass_of_the_map_scales_a_given_inertia() -> None:
    engine, _ = _spawned(_INERTIA, mass=6.0)
    single, _ = _spawned(_INERTIA)
    number = engine.compiled().body_ids[BodyId("part")]
    assert engine.compiled().model.body_mass[number] == 6.0
    np.testing.assert_allclose(
        engine.compiled().model.body_inertia[number], 2.0 * single.compiled().model.body_inertia[number]
    )


def test_moments_that_no_body_has_are_raised_and_invalid_ones_are_reported() -> None:
    engine, _ = _spawned(Inertia(mass_kg=1.0, tensor=(1.0, 1e-3, 1e-3, 0.0, 0.0, 0.0)))
    engine.step(0.1)
    moments = np.sort(engine.compiled().model.body_inertia[engine.compiled().body_ids[BodyId("part")]])
    assert moments[2] <= moments[0] + moments[1] + 1e-12
    for invalid in (
        Inertia(mass_kg=0.0),
        Inertia(mass_kg=1.0, tensor=(-1.0, 1.0, 1.0, 0.0, 0.0, 0.0)),
        Inertia(mass_kg=1.0, center=(float("nan"), 0.0, 0.0)),
    ):
        engine, notes = _spawned(invalid)
        assert any("inertia" in note and "left out" in note for note in notes)
        engine.step(0.1)


# -- excluded pairs ----------------------------------------------------------------------------------------------------


def test_excluded_pairs_that_overlap_are_not_reported_as_overlaps() -> None:
    links = [body(name, (0.1 * row, 0, 1), (0.3, 0.1, 0.1), "dynamic", 1.0) for row, name in enumerate("abc")]
    joints = [revolute_joint("ab", "a", "b", (0.05, 0, 1)), revolute_joint("bc", "b", "c", (0.15, 0, 1))]
    described = world(*links, *joints)
    pair = (BodyId("c"), BodyId("a"))
    reports = []
    for pairs in (frozenset[tuple[BodyId, BodyId]](), frozenset({pair})):
        engine = MujocoEngine()
        reports.append(engine.apply(Spawn(described, settle=False, excluded_pairs=pairs)).report)
        engine.step(0.1)
        assert not any({each.a, each.b} == set(pair) for each in engine.contacts())
    assert reports[0].ids_with_note(SpawnNoteKind.OVERLAP) == {"a", "c"}
    assert not reports[1].ids_with_note(SpawnNoteKind.OVERLAP)


def test_excluded_pairs_end_with_their_bodies() -> None:
    engine = MujocoEngine()
    pair = frozenset({(BodyId("box"), BodyId("floor"))})
    floor, box = body("floor", (0, 0, -0.05), (2, 2, 0.1)), body("box", (0, 0, 0.1), (0.2, 0.2, 0.2), "dynamic", 1.0)
    engine.apply(Spawn(world(floor, box), excluded_pairs=pair))
    forked = engine.fork()
    forked.apply(Spawn(world(body("other", (5, 0, 1), (0.2, 0.2, 0.2)))))
    for each in (engine, forked):
        each.step(0.3)
        assert position_of(each, "box")[2] < 0.0
    engine.apply(Delete((BodyId("box"),)))
    engine.apply(Spawn(world(box)))
    engine.step(0.3)
    assert position_of(engine, "box")[2] == pytest.approx(0.1, abs=2e-3)


def test_an_actuator_of_a_joint_that_is_not_simulated_rests_and_keeps_its_command() -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(arm_world()))
    engine.apply(SetActuators((servo("cart", "slide", damping=300.0),)))
    engine.set_commands({"cart": 0.1})
    cart, physics = BodyId("cart"), arm_world().body("cart").physics
    engine.apply(SetPhysics(cart, msgspec.structs.replace(physics, mobility=Mobility.STATIC)))
    engine.step(0.1)
    assert state(engine, "cart") == ActuatorState(position=0.0, velocity=0.0, effort=0.0, command=0.1)
    engine.apply(SetPhysics(cart, physics))
    step(engine, 2.0)
    assert state(engine, "cart").position == pytest.approx(0.1, abs=1e-4)


def test_a_strong_drive_presses_the_tip_of_a_light_finger_hardly_into_a_wall() -> None:
    engine = MujocoEngine()
    tip = {BodyId("finger"): single_shape_geometry(CollisionShapeType.SPHERE, (0.02, 0.02, 0.02))}
    parts = world(
        body("base", (-0.2, 0, 0.5), (0.1, 0.1, 0.1)),
        body("finger", (0, 0, 0.5), (0.02, 0.02, 0.02), "dynamic", 0.12),
        body("wall", (0.07, 0, 0.5), (0.1, 0.2, 0.2)),
        prismatic_joint("slide", "base", "finger", (0, 0, 0.5)),
    )
    engine.apply(Spawn(parts, geometry=tip))
    engine.apply(SetActuators((servo("press", "slide", stiffness=6000.0, effort_limit=60.0, armature=0.03),)))
    engine.set_commands({"press": 0.1})
    step(engine, 0.4)
    (contact,) = engine.contacts()
    assert contact.force_n == pytest.approx(60.0, rel=0.05)
    assert contact.depth_m < 0.0025  # 10 mm with MuJoCo's default impedances
