"""The referee of skills, against hand-made worlds: it notices planted cheats, and nothing in an honest push."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from tests.referee import InterventionKind, SkillReferee

ROBOT = ("hand", "finger")

WORLD = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <geom name="floor" type="box" size="3 3 0.05" pos="0 0 -0.05"/>
    <body name="case" pos="0.6 0 0.3">
      <geom type="box" size="0.2 0.2 0.02" pos="0 0 -0.1"/>
      <geom type="box" size="0.02 0.2 0.1" pos="0.22 0 0"/>
    </body>
    <body name="drawer" pos="0.6 0 0.3">
      <joint name="slide" type="slide" axis="-1 0 0" range="0 0.3" damping="1" frictionloss="0.2"/>
      <geom type="box" size="0.18 0.18 0.05" mass="2"/>
      <body name="handle" pos="-0.21 0 0">
        <geom type="box" size="0.01 0.05 0.005" mass="0.1"/>
        <geom type="box" size="0.01 0.005 0.005" pos="0.02 0 0" mass="0.01"/>
      </body>
    </body>
    <body name="cup" pos="0 1 0.05">
      <freejoint/>
      <geom type="cylinder" size="0.04 0.05" mass="0.3"/>
    </body>
    <body name="hand" pos="0 {y} 0.3">
      <joint name="x" type="slide" axis="1 0 0" range="-3 3"/>
      <joint name="y" type="slide" axis="0 1 0" range="-3 3"/>
      <joint name="z" type="slide" axis="0 0 1" range="-3 3"/>
      <geom type="box" size="0.05 0.02 0.02" mass="1"/>
      <body name="finger" pos="0.08 0 0">
        <geom type="box" size="0.03 0.01 0.01" mass="0.2"/>
      </body>
    </body>
    {bodies}
  </worldbody>
  <actuator>
    <position joint="x" kp="2000" kv="200"/>
    <position joint="y" kp="2000" kv="200"/>
    <position joint="z" kp="2000" kv="200"/>
  </actuator>
  {rest}
</mujoco>
"""


def run(
    seconds: float = 1.0,
    *,
    y: float = 0.0,
    rest: str = "",
    bodies: str = "",
    at: Callable[[mujoco.MjModel, mujoco.MjData, int], None] = lambda model, data, step: None,
    targets: Callable[[float], tuple[float, float, float]] = lambda time_s: (0.0, 0.0, 0.0),
) -> tuple[SkillReferee, mujoco.MjModel, mujoco.MjData]:
    """A world in which the hand follows targets and something may cheat before each step, as the referee saw it."""
    model = mujoco.MjModel.from_xml_string(WORLD.format(y=y, rest=rest, bodies=bodies))
    model.body_gravcomp[[model.body(name).id for name in ROBOT]] = 1.0
    data = mujoco.MjData(model)
    referee = SkillReferee(ROBOT)
    referee.look(model, data)
    with referee.watching():
        for step in range(round(seconds / model.opt.timestep)):
            data.ctrl[:] = targets(data.time)
            at(model, data, step)
            mujoco.mj_step(model, data)
    return referee, model, data


def kinds(referee: SkillReferee, body: str) -> set[InterventionKind]:
    return {each.kind for each in referee.interventions if each.body == body}


def impulse(referee: SkillReferee, body: str, kind: InterventionKind) -> float:
    return next(each.impulse_ns for each in referee.interventions if (each.body, each.kind) == (body, kind))


def test_an_honest_push_has_no_intervention() -> None:
    """A finger that knocks a cup over."""
    referee, _, _ = run(
        3.0,
        y=1.0,
        targets=lambda time_s: (min(0.1 * time_s, 0.2), 0.0, -0.2),
    )
    assert referee.nearest_m["cup"] < 0.001
    assert np.linalg.norm(referee.poses()["cup"][:3] - referee.first["cup"][:3]) > 0.05
    assert referee.interventions == []


def test_a_drawer_that_is_pushed_shut_has_no_intervention() -> None:
    model = mujoco.MjModel.from_xml_string(WORLD.format(y=0.0, rest="", bodies=""))
    model.body_gravcomp[[model.body(name).id for name in ROBOT]] = 1.0
    data, referee = mujoco.MjData(model), SkillReferee(ROBOT)
    data.qpos[model.joint("slide").qposadr[0]] = 0.2
    referee.look(model, data)
    with referee.watching():
        for step in range(1500):
            data.ctrl[0] = min(0.0002 * step, 0.278)
            mujoco.mj_step(model, data)
    assert referee.openness("drawer", 0.0) < 0.05
    assert referee.interventions == []


def test_nothing_is_noted_where_nothing_happens_and_the_motion_is_the_same() -> None:
    model = mujoco.MjModel.from_xml_string(WORLD.format(y=1.0, rest="", bodies=""))
    plain, watched = mujoco.MjData(model), mujoco.MjData(model)
    mujoco.mj_step(model, plain, nstep=300)
    referee = SkillReferee(ROBOT)
    with referee.watching():
        mujoco.mj_step(model, watched, nstep=300)
    assert np.array_equal(plain.qpos, watched.qpos)
    assert mujoco.mj_step.__module__ != __name__
    assert referee.interventions == []


@pytest.mark.parametrize(
    "rest",
    [
        '<equality><weld body1="finger" body2="handle" relpose="0.25 0 0 1 0 0 0"/></equality>',
        '<equality><connect body1="finger" body2="handle" anchor="0.2 0 0"/></equality>',
    ],
)
def test_a_weld_over_a_gap_is_noticed(rest: str) -> None:
    referee, _, _ = run(2.0, rest=rest, targets=lambda time_s: (-0.1 * min(time_s, 1.0), 0.0, 0.0))
    assert referee.openness("drawer", 0.0) > 0.25
    assert InterventionKind.EQUALITY in kinds(referee, "drawer")
    assert impulse(referee, "drawer", InterventionKind.EQUALITY) > 0.1
    assert "handle" not in referee.nearest_m


def test_an_inactive_weld_is_no_intervention() -> None:
    rest = '<equality><weld body1="finger" body2="handle" active="false"/></equality>'
    assert run(0.2, rest=rest)[0].interventions == []


def test_a_coupling_of_the_robots_own_joints_is_no_intervention() -> None:
    rest = '<equality><joint joint1="x" joint2="z" polycoef="0 1 0 0 0"/></equality>'
    assert run(0.2, rest=rest, targets=lambda _: (0.05, 0.0, 0.05))[0].interventions == []


def test_a_spring_over_a_gap_is_noticed() -> None:
    sites = '<tendon><spatial stiffness="300" springlength="0"><site site="a"/><site site="b"/></spatial></tendon>'
    text = WORLD.replace('<body name="handle" pos="-0.21 0 0">', '<body name="handle" pos="-0.21 0 0"><site name="b"/>')
    text = text.replace('<body name="finger" pos="0.08 0 0">', '<body name="finger" pos="0.08 0 0"><site name="a"/>')
    model = mujoco.MjModel.from_xml_string(text.format(y=0.0, rest=sites, bodies=""))
    data, referee = mujoco.MjData(model), SkillReferee(ROBOT)
    with referee.watching():
        mujoco.mj_step(model, data, nstep=200)
    assert kinds(referee, "drawer") == {InterventionKind.SPRING}


def test_a_spring_of_the_places_own_joint_is_no_intervention() -> None:
    text = WORLD.replace('damping="1"', 'damping="1" stiffness="20" springref="0.1"')
    model = mujoco.MjModel.from_xml_string(text.format(y=0.0, rest="", bodies=""))
    data, referee = mujoco.MjData(model), SkillReferee(ROBOT)
    with referee.watching():
        mujoco.mj_step(model, data, nstep=200)
    assert referee.openness("drawer", 0.0) > 0.02
    assert referee.interventions == []


def test_a_hand_inside_a_box_is_noticed_whatever_pairs_are_excluded() -> None:
    rest = (
        '<contact><exclude body1="finger" body2="handle"/><exclude body1="finger" body2="drawer"/>'
        '<exclude body1="hand" body2="drawer"/><exclude body1="hand" body2="handle"/></contact>'
    )
    referee, _, _ = run(2.0, rest=rest, targets=lambda time_s: (0.5 * min(time_s, 1.0), 0.0, 0.0))
    assert {"handle", "drawer"} <= {
        each.body for each in referee.interventions if each.kind is InterventionKind.OVERLAP
    }
    assert referee.deepest["finger", "drawer"] > 0.02


def test_a_hand_without_contact_bits_is_noticed() -> None:
    model = mujoco.MjModel.from_xml_string(WORLD.format(y=0.0, rest="", bodies=""))
    model.geom_contype[:] = model.geom_conaffinity[:] = 0
    model.opt.gravity[:] = 0.0
    data, referee = mujoco.MjData(model), SkillReferee(ROBOT)
    with referee.watching():
        data.ctrl[0] = 0.5
        mujoco.mj_step(model, data, nstep=1000)
    assert InterventionKind.OVERLAP in kinds(referee, "drawer")


def test_a_hand_that_begins_inside_something_may_leave_it() -> None:
    block = '<body name="block" pos="0.005 0.01 0.31"><geom type="box" size="0.04 0.1 0.1"/></body>'
    rest = '<contact><exclude body1="hand" body2="block"/><exclude body1="finger" body2="block"/></contact>'
    referee, _, _ = run(1.0, bodies=block, rest=rest, targets=lambda time_s: (-0.3 * min(time_s, 1.0), 0.0, 0.0))
    assert kinds(referee, "block") == set()


@pytest.mark.parametrize("distance_m", [0.3, 1e-5])
def test_a_teleport_is_noticed(distance_m: float) -> None:
    def teleport(model: mujoco.MjModel, data: mujoco.MjData, step: int) -> None:
        if step == 100:
            data.qpos[model.jnt_qposadr[model.body("cup").jntadr[0]] + 1] += distance_m

    referee, _, _ = run(0.5, at=teleport)
    assert [(each.kind, each.body, each.steps) for each in referee.interventions] == [(InterventionKind.JUMP, "cup", 1)]
    assert referee.interventions[0].largest_m == pytest.approx(distance_m, rel=0.01)
    assert referee.interventions[0].impulse_ns == pytest.approx(0.3 * distance_m / 0.002, rel=0.01)


def test_a_front_that_is_set_open_is_noticed_also_in_a_new_model() -> None:
    text = WORLD.format(y=0.0, rest="", bodies="")
    first = mujoco.MjModel.from_xml_string(text)
    second = mujoco.MjModel.from_xml_string(text.replace('<body name="cup"', '<body name="new"/><body name="cup"'))
    data, other = mujoco.MjData(first), mujoco.MjData(second)
    referee = SkillReferee(ROBOT)
    with referee.watching():
        mujoco.mj_step(first, data, nstep=20)
        other.qpos[:], other.qvel[:], other.time = data.qpos, data.qvel, data.time
        other.qpos[second.joint("slide").qposadr[0]] += 0.1
        mujoco.mj_step(second, other, nstep=20)
    assert [(each.kind, each.body) for each in referee.interventions] == [(InterventionKind.JUMP, "drawer")]


def test_a_push_by_nothing_is_noticed_with_its_impulse() -> None:
    def push(model: mujoco.MjModel, data: mujoco.MjData, step: int) -> None:
        data.xfrc_applied[model.body("handle").id, 0] = -5.0 if step < 100 else 0.0

    referee, _, _ = run(0.5, at=push)
    assert [(each.kind, each.body, each.steps) for each in referee.interventions] == [
        (InterventionKind.EXTERNAL_FORCE, "handle", 100)
    ]
    assert referee.interventions[0].impulse_ns == pytest.approx(5.0 * 0.2)


def test_forces_of_joints_and_actuators_and_set_velocities_are_noticed() -> None:
    def push(model: mujoco.MjModel, data: mujoco.MjData, step: int) -> None:
        dof = int(model.joint("slide").dofadr[0])
        data.qfrc_applied[dof] = 3.0 if step < 10 else 0.0
        if step == 50:
            data.qvel[dof] = 0.5

    referee, _, _ = run(0.2, at=push)
    assert kinds(referee, "drawer") == {InterventionKind.JOINT_FORCE, InterventionKind.SPEED_JUMP}
    motor = '<actuator><motor joint="slide" gear="1" ctrlrange="-1 1"/></actuator>'
    referee, _, _ = run(0.2, rest=motor, targets=lambda _: (0.0, 0.0, 0.0, 1.0))  # type: ignore[return-value, arg-type]
    assert kinds(referee, "drawer") == {InterventionKind.ACTUATOR}


def test_a_mocap_body_that_drags_is_noticed() -> None:
    block = '<body name="ghost" mocap="true" pos="0 1.2 0.05"><geom type="box" size="0.05 0.05 0.05"/></body>'

    def drag(model: mujoco.MjModel, data: mujoco.MjData, step: int) -> None:
        data.mocap_pos[0, 1] -= 0.0005

    referee, _, _ = run(0.6, bodies=block, at=drag)
    assert np.linalg.norm(referee.poses()["cup"][:3] - referee.first["cup"][:3]) > 0.02
    assert InterventionKind.MOCAP in kinds(referee, "ghost")


def test_a_thing_that_loses_its_weight_is_noticed() -> None:
    text = WORLD.format(y=0.0, rest="", bodies="")
    first = mujoco.MjModel.from_xml_string(text)
    second = mujoco.MjModel.from_xml_string(text.replace('<body name="cup"', '<body gravcomp="1" name="cup"'))
    data, other, referee = mujoco.MjData(first), mujoco.MjData(second), SkillReferee(ROBOT)
    with referee.watching():
        mujoco.mj_step(first, data, nstep=20)
        other.qpos[:], other.qvel[:], other.time = data.qpos, data.qvel, data.time
        mujoco.mj_step(second, other, nstep=20)
    assert kinds(referee, "cup") == {InterventionKind.WEIGHT}


def test_a_thing_that_becomes_a_part_of_the_robot_is_noticed() -> None:
    cup = '<body name="cup" pos="0.3 0 0.1"><geom type="cylinder" size="0.04 0.05" mass="0.3"/></body>'
    first = mujoco.MjModel.from_xml_string(WORLD.format(y=0.0, rest="", bodies=""))
    free = WORLD[WORLD.index('<body name="cup"') : WORLD.index('<body name="hand"')]
    text = WORLD.replace(free, "").replace(
        '<body name="finger" pos="0.08 0 0">', f'<body name="finger" pos="0.08 0 0">{cup}'
    )
    second = mujoco.MjModel.from_xml_string(text.format(y=0.0, rest="", bodies=""))
    data, other, referee = mujoco.MjData(first), mujoco.MjData(second), SkillReferee(ROBOT)
    with referee.watching():
        mujoco.mj_step(first, data, nstep=10)
        other.time = data.time
        mujoco.mj_step(second, other, nstep=500)
    assert InterventionKind.FIXED in kinds(referee, "cup")
    assert impulse(referee, "cup", InterventionKind.FIXED) == pytest.approx(0.3 * 9.81, rel=0.1)


def test_steps_that_are_repeated_for_want_of_memory_count_once() -> None:
    model = mujoco.MjModel.from_xml_string(WORLD.format(y=1.0, rest="", bodies=""))
    data, referee = mujoco.MjData(model), SkillReferee(ROBOT)
    with referee.watching():
        mujoco.mj_step(model, data, nstep=20)
        before = mujoco.MjData(model)
        mujoco.mj_copyData(before, model, data)
        mujoco.mj_step(model, data, nstep=20)
        mujoco.mj_step(model, before, nstep=20)
    assert referee.interventions == []


def test_promises_are_compared_with_the_state() -> None:
    referee, _, _ = run(0.5)
    assert referee.openness("drawer", 0.0) < 0.01
    assert "the robot is" in referee.why_not_lifted("cup")
    assert referee.why_not_on("cup", "world") == ""
    assert referee.why_not_on("cup", "case") == "cup rests on world"


def test_reasons_that_the_geometry_contradicts_are_false() -> None:
    shelf = '<body name="{}" pos="{} 0 0.3"><geom type="box" size="0.1 0.3 0.05"/></body>'
    bodies = shelf.format("near", 0.0) + shelf.format("far", -0.5) + shelf.format("very_far", -2.5)
    referee, _, _ = run(0.1, y=0.5, bodies=bodies)

    def false(reason: str) -> list[str]:
        return referee.false_reasons(reason, "drawer", 0.0)

    assert false("drawer is 0% open instead of 100%: there drawer is 3 mm inside near") == []
    assert len(false("drawer is 40% open instead of 100%")) == 1
    assert len(false("drawer is 0% open instead of 100%: there handle is 3 mm inside far")) == 1
    assert len(false("there hand is 3 mm inside very_far")) == 1
    assert len(false("hand is pressed 3.1 mm into case")) == 1
    assert false("there hand is 3 mm inside finger") == []
    assert false("the fingers slipped") == []
