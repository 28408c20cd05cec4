"""Reading of SRDF."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.errors import RobotModelError
from mindstage.robots.models.reading import load_model
from mindstage.robots.models.robot_model import BaseType
from mindstage.robots.models.srdf import read_srdf

TEXT = """
<robot name="r">
  <virtual_joint name="world" type="planar" parent_frame="odom" child_link="base"/>
  <joint_property joint_name="world" property_name="motion_model" value="diff_drive"/>
  <group name="arm"><chain base_link="base" tip_link="tool"/><joint name="extra"/></group>
  <group name="all"><group name="arm"/><link name="camera"/></group>
  <end_effector name="hand" parent_link="tool" group="fingers" parent_group="arm"/>
  <group_state name="home" group="arm">
    <joint name="a" value="0.5"/><joint name="floating" value="0 0 0 0 0 0 1"/><joint name="bad" value="x"/>
  </group_state>
  <disable_collisions link1="b" link2="a" reason="Adjacent"/>
  <disable_collisions link1="c" link2="c"/>
</robot>
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "robot.srdf"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_contents_of_a_file(tmp_path: Path) -> None:
    srdf = read_srdf(written(tmp_path, TEXT))
    arm = srdf.group("arm")
    assert arm is not None
    assert (arm.chains, arm.joints) == ((("base", "tool"),), ("extra",))
    everything = srdf.group("all")
    assert everything is not None
    assert (everything.groups, everything.links) == (("arm",), ("camera",))
    assert srdf.group("nothing") is None
    (effector,) = srdf.end_effectors
    assert (effector.name, effector.parent_link, effector.group, effector.parent_group) == (
        "hand", "tool", "fingers", "arm",
    )  # fmt: skip
    assert srdf.states == (("arm", "home", (("a", 0.5),)),)
    assert srdf.disabled_collisions == {("a", "b")}
    assert srdf.virtual_joints[0].motion_model == "diff_drive"


@pytest.mark.parametrize(
    ("text", "cause"), [("<sdf/>", "<sdf>"), ("<robot>", "not well-formed"), ("<!DOCTYPE r><robot/>", "document type")]
)
def test_a_file_that_is_no_srdf(tmp_path: Path, text: str, cause: str) -> None:
    with pytest.raises(RobotModelError, match=cause):
        read_srdf(written(tmp_path, text))


def test_a_file_that_does_not_exist(tmp_path: Path) -> None:
    with pytest.raises(RobotModelError, match="No such file"):
        read_srdf(tmp_path / "robot.srdf")


CHAIN = "".join(
    f'<link name="l{number}"><collision><geometry><box size=".1 .1 .1"/></geometry></collision></link>'
    + (
        f'<joint name="j{number}" type="revolute"><parent link="l{number - 1}"/><child link="l{number}"/>'
        '<origin xyz="0 0 .2"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="9" velocity="1"/></joint>'
        if number
        else ""
    )
    for number in range(7)
)


def test_an_end_effector_is_a_gripper_whatever_its_fingers_are_called(tmp_path: Path) -> None:
    box = '<collision><origin xyz="0.05 0 0"/><geometry><box size="0.1 0.01 0.02"/></geometry></collision>'
    sides = "".join(
        f'<link name="{name}">{box}</link><joint name="{name}_j" type="prismatic"><parent link="l6"/>'
        f'<child link="{name}"/><origin xyz="0.05 {side * 0.006} 0"/><axis xyz="0 {side} 0"/>'
        f'<limit lower="0" upper="0.04" effort="20" velocity="1"/></joint>'
        for name, side in (("one", 1), ("two", -1))
    )
    (tmp_path / "robot.urdf").write_text(f'<robot name="r">{CHAIN}{sides}</robot>', encoding="utf-8")
    effector = '<end_effector name="e" parent_link="l6" group="tongs" parent_group="arm"/>'
    groups = '<group name="arm"><chain base_link="l0" tip_link="l6"/></group>'
    tongs = '<group name="tongs"><joint name="one_j"/><joint name="two_j"/></group>'
    written(tmp_path, f'<robot name="r">{groups}{tongs}{effector}</robot>')
    (gripper,) = load_model(tmp_path / "robot.urdf").grippers
    assert (gripper.name, gripper.link, gripper.finger_links) == ("tongs", "l6", ("one", "two"))
    assert gripper.max_opening_m == pytest.approx(0.08, abs=0.01)
    assert gripper.max_force_n == 20.0
    assert gripper.grasp_pose.position[1] == pytest.approx(0.0, abs=1e-6)
    # Only both states together replace what was found by the shapes.
    states = {
        name: f'<group_state name="{name}" group="tongs">'
        f'<joint name="one_j" value="{value}"/><joint name="two_j" value="{value}"/></group_state>'
        for name, value in (("open", 0.03), ("closed", 0.01))
    }
    for stated in (("open",), ("closed",), ("open", "closed")):
        text = "".join(states[name] for name in stated)
        written(tmp_path, f'<robot name="r">{groups}{tongs}{effector}{text}</robot>')
        (other,) = load_model(tmp_path / "robot.urdf").grippers
        found = (other.open_positions, other.closed_positions)
        if len(stated) == 2:
            assert found == ((0.03, 0.03), (0.01, 0.01))
        else:
            assert found == (gripper.open_positions, gripper.closed_positions)


def test_groups_that_contain_each_other_end(tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_text(f'<robot name="r">{CHAIN}</robot>', encoding="utf-8")
    written(
        tmp_path,
        '<robot name="r"><virtual_joint name="w" type="planar" parent_frame="odom" child_link="l0"/>'
        '<group name="arm"><group name="both"/><chain base_link="l0" tip_link="l6"/></group>'
        '<group name="both"><group name="arm"/></group>'
        '<group_state name="rest" group="arm">'
        + "".join(f'<joint name="j{number}" value="9"/>' for number in range(1, 7))
        + "</group_state></robot>",
    )
    model = load_model(tmp_path / "robot.urdf")
    assert model.base.type is BaseType.PLANAR
    (arm,) = model.arms
    assert arm.joints == tuple(f"j{number}" for number in range(1, 7))
    assert arm.rest_positions == (2.0,) * 6  # not beyond the limits
    assert dict(model.home_positions) == dict(zip(arm.joints, arm.rest_positions, strict=True))
