"""Abilities follow from components, capabilities and what actions depend on."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from mindstage.errors import RobotModelError, RobotNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.questions import StateAccess, get_question
from mindstage.rdf.graphs import local_name
from mindstage.robots.abilities import AbilityRow, profile_of_model
from mindstage.robots.models.reading import load_model
from mindstage.robots.models.robot_model import (
    Arm,
    BaseType,
    Gripper,
    GripperType,
    Head,
    RobotBase,
    RobotJoint,
    RobotJointType,
    RobotLink,
    RobotModel,
    RobotSensor,
    SensorType,
)
from mindstage.robots.self_models import add_self_model, component_class, read_self_model
from mindstage.robots.skill_declaration import SkillNeed
from mindstage.robots.skills import skill_specs
from mindstage.scene import IDENTITY
from tests.cases import each_case

SELF_MODEL = """<?xml version="1.0"?>
<!DOCTYPE rdf:RDF [
    <!ENTITY comp "http://knowrob.org/kb/srdl2-comp.owl#" >
    <!ENTITY cap "http://knowrob.org/kb/srdl2-cap.owl#" >
    <!ENTITY knowrob "http://knowrob.org/kb/knowrob.owl#" >
    <!ENTITY r "http://e.org/robot.owl#" >
]>
<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:rdfs="http://www.w3.org/2000/01/rdf-schema#"
     xmlns:owl="http://www.w3.org/2002/07/owl#" xmlns:comp="http://knowrob.org/kb/srdl2-comp.owl#">
    <owl:Ontology rdf:about="http://e.org/robot.owl">
        <owl:imports rdf:resource="package://knowrob_srdl/owl/srdl2-comp.owl"/>
    </owl:Ontology>
    <owl:Class rdf:about="&r;Helper">
        <rdfs:subClassOf rdf:resource="&knowrob;Robot"/>
        <rdfs:subClassOf>
            <owl:Class>
                <owl:intersectionOf rdf:parseType="Collection">
                    <owl:Restriction>
                        <owl:onProperty rdf:resource="&cap;hasCapability"/>
                        <owl:someValuesFrom rdf:resource="&cap;move_base"/>
                    </owl:Restriction>
                    <owl:Restriction>
                        <owl:onProperty rdf:resource="&cap;hasCapability"/>
                        <owl:someValuesFrom rdf:resource="&cap;NavigationCapability"/>
                    </owl:Restriction>
                </owl:intersectionOf>
            </owl:Class>
        </rdfs:subClassOf>
    </owl:Class>
    <owl:NamedIndividual rdf:about="&r;Helper1">
        <rdf:type rdf:resource="&r;Helper"/>
        <comp:subComponent rdf:resource="&r;right_arm"/>
        <comp:subComponent rdf:resource="&r;ArmController"/>
        <comp:succeedingLink rdf:resource="&r;base_link"/>
    </owl:NamedIndividual>
    <owl:NamedIndividual rdf:about="&r;ArmController">
        <rdf:type rdf:resource="&comp;ArmMotionController"/>
    </owl:NamedIndividual>
    <owl:NamedIndividual rdf:about="&r;right_arm">
        <rdf:type rdf:resource="&comp;ComponentComposition"/>
        <rdf:type rdf:resource="&knowrob;RightArm"/>
        <comp:baseLinkOfComposition rdf:resource="&r;shoulder"/>
        <comp:endLinkOfComposition rdf:resource="&r;elbow"/>
        <comp:endLinkOfComposition rdf:resource="&r;wrist"/>
    </owl:NamedIndividual>
    <owl:NamedIndividual rdf:about="&r;base_link">
        <rdf:type rdf:resource="&comp;UrdfLink"/><comp:urdfName>base_link</comp:urdfName>
        <comp:succeedingJoint rdf:resource="&r;j1"/>
        <comp:succeedingJoint rdf:resource="&r;camera_joint"/>
    </owl:NamedIndividual>
    <owl:NamedIndividual rdf:about="&r;camera_joint">
        <rdf:type rdf:resource="&comp;FixedUrdfJoint"/><comp:succeedingLink rdf:resource="&r;eye"/>
    </owl:NamedIndividual>
    <owl:NamedIndividual rdf:about="&r;eye">
        <rdf:type rdf:resource="&comp;UrdfLink"/><rdf:type rdf:resource="&comp;Camera"/>
        <comp:urdfName>eye</comp:urdfName>
    </owl:NamedIndividual>
    <owl:NamedIndividual rdf:about="&r;j1">
        <rdf:type rdf:resource="&comp;RevoluteUrdfJoint"/><comp:succeedingLink rdf:resource="&r;shoulder"/>
    </owl:NamedIndividual>
    <owl:NamedIndividual rdf:about="&r;shoulder">
        <rdf:type rdf:resource="&comp;UrdfLink"/><comp:urdfName>r_shoulder_link</comp:urdfName>
    </owl:NamedIndividual>
    <owl:NamedIndividual rdf:about="&r;elbow">
        <rdf:type rdf:resource="&comp;UrdfLink"/><comp:urdfName>r_elbow_link</comp:urdfName>
    </owl:NamedIndividual>
    <owl:NamedIndividual rdf:about="&r;wrist">
        <rdf:type rdf:resource="&comp;UrdfLink"/><comp:urdfName>r_wrist_link</comp:urdfName>
    </owl:NamedIndividual>
</rdf:RDF>
"""

ARM = Arm(name="arm", joints=("j1", "j2"), base_link="base_link", tip_link="r_wrist_link", gripper="gripper")
GRIPPER = Gripper(
    name="gripper",
    type=GripperType.PARALLEL,
    link="r_wrist_link",
    joints=(),
    finger_links=(),
    grasp_pose=IDENTITY,
    open_positions=(),
    closed_positions=(),
    max_opening_m=0.1,
)


def model(
    *,
    base: BaseType = BaseType.FIXED,
    arms: tuple[Arm, ...] = (),
    grippers: tuple[Gripper, ...] = (),
    head: Head | None = None,
    sensors: tuple[RobotSensor, ...] = (),
) -> RobotModel:
    """A robot with an arm-like chain, of which a description names no more than is given."""
    chain = ("base_link", "r_shoulder_link", "r_elbow_link", "r_wrist_link")
    joints = tuple(
        RobotJoint(name=f"j{at}", type=RobotJointType.REVOLUTE, parent=parent, child=child, lower=-1.0, upper=1.0)
        for at, (parent, child) in enumerate(pairwise(chain), 1)
    )
    eye = RobotJoint(name="camera_joint", type=RobotJointType.FIXED, parent="base_link", child="eye")
    return RobotModel(
        name="helper",
        links=tuple(RobotLink(name=each) for each in (*chain, "eye")),
        joints=(*joints, eye),
        base=RobotBase(type=base, link="base_link"),
        arms=arms,
        grippers=grippers,
        head=head,
        sensors=sensors,
    )


@pytest.fixture(scope="module")
def kb() -> KnowledgeBase:
    return KnowledgeBase()


@pytest.fixture
def self_model(tmp_path: Path) -> Path:
    path = tmp_path / "helper.owl"
    path.write_text(SELF_MODEL, encoding="utf-8")
    return path


def ask(kb: KnowledgeBase, question: str, models: Mapping[str, RobotModel] = {}, **args: Any) -> Any:
    """The answers with these robots in a simulation."""
    running = SimpleNamespace(robots={name: SimpleNamespace(model=each) for name, each in models.items()})
    return get_question(question).ask(kb, args, present=StateAccess(kb, simulation=running))


def actions(kb: KnowledgeBase, each: RobotModel, name: str = "helper") -> set[str]:
    return {local_name(row.action) for row in ask(kb, "can", {name: each}, robot=name)}


# -- robots of the simulation ------------------------------------------------------------------------------------------


def test_a_fixed_arm_without_a_gripper_reaches_and_parks_only(kb: KnowledgeBase) -> None:
    assert actions(kb, model(arms=(ARM,))) == {"ReachingForSomething", "Reaching", "ParkingArms"}


def test_a_gripper_adds_manipulation_and_a_base_adds_going(kb: KnowledgeBase) -> None:
    fixed = actions(kb, model(arms=(ARM,), grippers=(GRIPPER,)))
    mobile = actions(kb, model(arms=(ARM,), grippers=(GRIPPER,), base=BaseType.DIFFERENTIAL))
    assert {"PickingUpAnObject", "OpeningADoor", "Pouring"} <= fixed
    assert {"GoingSomewhere", "StoringSomething", "FetchingSomething"} == mobile & {
        "GoingSomewhere",
        "StoringSomething",
        "FetchingSomething",
    }
    assert mobile - fixed >= {"GoingSomewhere", "StoringSomething", "FetchingSomething", "CarryingWhileLocomoting"}
    assert fixed < mobile


def test_the_needs_of_each_skill_are_those_that_the_ontology_states(kb: KnowledgeBase) -> None:
    every = {
        SkillNeed.ARM: {"arms": (ARM,)},
        SkillNeed.GRIPPER: {"grippers": (GRIPPER,)},
        SkillNeed.MOBILE_BASE: {"base": BaseType.PLANAR},
        SkillNeed.HEAD: {"head": Head(joints=("j1",), link="eye")},
    }
    camera = RobotSensor(name="camera", type=SensorType.CAMERA, link="eye")
    complete: dict[str, Any] = {name: value for part in every.values() for name, value in part.items()}
    rows: list[AbilityRow] = list(ask(kb, "can", {"all": model(**complete, sensors=(camera,))}))
    by_skill = {row.skill: row.action for row in rows if row.skill}
    assert set(by_skill) == set(skill_specs())
    for need, part in every.items():
        rest: dict[str, Any] = {name: value for name, value in complete.items() if name not in part}
        without = model(**rest, sensors=(camera,))
        able = {row.skill for row in ask(kb, "can", {"part": without})}
        needing = {name for name, spec in skill_specs().items() if need in spec.needs}
        assert set(skill_specs()) - able == needing, need


def test_what_is_missing_is_named_with_what_depends_on_it(kb: KnowledgeBase) -> None:
    robots = {"helper": model(arms=(ARM,))}
    found = ask(kb, "missing_for_action", robots, robot="helper", action="PickingUpAnObject")
    lacks = {(local_name(row.missing), local_name(row.needed_by)) for row in found}
    assert lacks == {
        ("PressingManipulationEntity", "GripperMotionCapability"),
        ("GraspController", "GraspingCapability"),
    }
    reasons = [each.reason for each in ask(kb, "can", robots, robot="helper", action="PickingUpAnObject").missing]
    assert reasons == [
        "helper cannot do PickingUpAnObject: it has no GraspController, on which GraspingCapability depends",
        "helper cannot do PickingUpAnObject: it has no PressingManipulationEntity, "
        "on which GripperMotionCapability depends",
    ]


def test_a_subclass_of_an_action_needs_what_the_action_needs(kb: KnowledgeBase) -> None:
    robots = {"helper": model(arms=(ARM,))}
    lacking = {local_name(row.missing) for row in ask(kb, "missing_for_action", robots, action="CoolingFood")}
    assert {"MobileBase", "GraspController", "NavigationComponent"} <= lacking


def test_an_action_of_which_nothing_is_stated_is_not_assumed_to_be_possible(kb: KnowledgeBase) -> None:
    found = ask(kb, "can", {"helper": model(arms=(ARM,))}, robot="helper", action="BakingFood")
    assert not found
    assert found.missing[0].reason == "nothing states what BakingFood needs of a robot"
    narrower = ask(kb, "can", {"helper": model()}, robot="helper", action="OpeningSomething").missing[0].reason
    assert "ask about" in narrower
    assert "OpeningADoor" in narrower


def test_answers_are_explained_by_the_components(kb: KnowledgeBase) -> None:
    (row,) = ask(kb, "can", {"helper": model(arms=(ARM,))}, action="ReachingForSomething")
    why = get_question("can").explain_answer(kb, row)
    assert "ReachingForSomething depends on the capability CollisionFreeArmMotionCapability" in why
    assert why[-1] == "helper has simulated CollisionMap, arm, arm_controller, by the running simulation"


def test_a_robot_that_does_not_exist_is_an_error_with_those_that_do(kb: KnowledgeBase) -> None:
    with pytest.raises(RobotNotFoundError, match="helper"):
        ask(kb, "can", {"helper": model()}, robot="helpr")
    assert "give robot" in ask(kb, "can").missing[0].reason


def test_statements_of_other_ontologies_count(kb: KnowledgeBase, tmp_path: Path) -> None:
    path = tmp_path / "own.ttl"
    path.write_text(
        """@prefix owl: <http://www.w3.org/2002/07/owl#> . @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
        @prefix knowrob: <http://knowrob.org/kb/knowrob.owl#> . @prefix comp: <http://knowrob.org/kb/srdl2-comp.owl#> .
        <http://e.org/own> a owl:Ontology .
        knowrob:BakingFood rdfs:subClassOf [ a owl:Restriction ; owl:onProperty comp:dependsOnComponent ;
            owl:someValuesFrom [ a owl:Class ; owl:unionOf ( comp:GripperComponent comp:Camera ) ] ] .""",
        encoding="utf-8",
    )
    own = KnowledgeBase()
    own.load((), ontologies=path)
    assert ask(own, "can", {"h": model(grippers=(GRIPPER,))}, action="BakingFood")
    assert not ask(own, "can", {"h": model(arms=(ARM,))}, action="BakingFood")


# -- self-models -------------------------------------------------------------------------------------------------------


def test_a_self_model_is_read_with_groups_sensors_software_and_capabilities(self_model: Path) -> None:
    found = read_self_model(self_model)
    assert found.name == "Helper1"
    components = {each.name: each for each in found.components}
    assert set(components) == {"right_arm", "ArmController", "eye"}
    assert components["right_arm"].links == ("r_shoulder_link", "r_elbow_link", "r_wrist_link")
    assert components["eye"].links == ("eye",)
    assert [local_name(each) for each in found.capabilities] == ["NavigationCapability", "move_base"]


def test_a_loaded_self_model_answers_for_its_robot(kb: KnowledgeBase, self_model: Path) -> None:
    own = KnowledgeBase()
    own.load((), ontologies=self_model)
    able = {local_name(row.action) for row in ask(own, "can", robot="Helper1")}
    assert able == {"Reaching", "ParkingArms", "Translation-LocationChange", "VisualPerception"}
    # Moving the base is stated for its class, but not what navigation without collisions depends on.
    lacks = {
        local_name(row.missing) for row in ask(own, "missing_for_action", robot="Helper1", action="GoingSomewhere")
    }
    assert lacks == {"EnvironmentMap", "LocalizationComponent", "NavigationComponent"}
    assert ask(own, "can", action="ParkingArms")[0].robot == "Helper1"


def test_a_self_model_adds_its_arms_to_a_description(self_model: Path) -> None:
    joined = add_self_model(model(), read_self_model(self_model))
    (arm,) = joined.arms
    assert (arm.name, arm.joints, arm.tip_link) == ("right_arm", ("j1", "j2", "j3"), "r_wrist_link")
    assert arm.base_link == "base_link"
    assert any("mobile" in note.text for note in joined.notes) is False
    profile = profile_of_model(joined)
    assert any(component_class("Camera") in each.classes for each in profile.components)


def test_the_parts_of_a_robot_are_at_its_links() -> None:
    known = load_model("mobile_manipulator")
    found = {each.name: (each.classes[0].rpartition("#")[2], each.links) for each in profile_of_model(known).components}
    arm, gripper, head = known.arms[0], known.grippers[0], known.head
    assert found["base"] == ("HolonomicBase", (known.base.link,))
    assert found[arm.name] == ("ArmComponent", (arm.base_link, arm.tip_link))
    assert found[gripper.name] == ("GripperComponent", (gripper.link,))
    assert found["head"] == ("MovableHead", (head.link,))
    assert {each.name: (each.link,) for each in known.sensors}.items() <= {
        name: links for name, (_, links) in found.items()
    }.items()


def test_arm_and_gripper_of_a_robot_are_those_of_its_srdf(tmp_path: Path) -> None:
    known = load_model("mobile_manipulator")
    path = tmp_path / "manipulator.ttl"
    names = {"arm": ("lift_link", "hand_link"), "gripper": ("gripper_link", "left_finger_link", "right_finger_link")}
    classes = {"arm": "ArmComponent", "gripper": "GripperComponent"}
    links = {link for each in names.values() for link in each}
    path.write_text(
        """@prefix comp: <http://knowrob.org/kb/srdl2-comp.owl#> . @prefix r: <http://e.org/r#> .
        @prefix knowrob: <http://knowrob.org/kb/knowrob.owl#> . @prefix owl: <http://www.w3.org/2002/07/owl#> .
        <http://e.org/r> a owl:Ontology . r:robot a knowrob:Robot ; comp:subComponent r:arm, r:gripper .
        """
        + "".join(
            f"r:{name} a comp:ComponentComposition, comp:{classes[name]} ; comp:baseLinkOfComposition r:{first} ; "
            f"comp:endLinkOfComposition {', '.join(f'r:{end}' for end in ends)} .\n"
            for name, (first, *ends) in names.items()
        )
        + "".join(f'r:{link} a comp:UrdfLink ; comp:urdfName "{link}" .\n' for link in sorted(links)),
        encoding="utf-8",
    )
    bare = msgspec.structs.replace(known, arms=(), grippers=())
    fixed = tuple(
        msgspec.structs.replace(joint, type=RobotJointType.FIXED) if "finger" in joint.name else joint
        for joint in known.joints
    )
    without = add_self_model(msgspec.structs.replace(bare, joints=fixed), read_self_model(path))
    assert without.grippers == ()
    text = "it is a gripper in the self-model, but no joint beyond its first link moves fingers with shapes"
    assert [note.subject for note in without.notes if note.text == text] == ["gripper"]
    joined = add_self_model(bare, read_self_model(path))
    (arm,), (gripper,) = joined.arms, joined.grippers
    assert (arm.joints, arm.tip_link, arm.gripper) == (known.arms[0].joints, "hand_link", "gripper")
    expected = known.grippers[0]
    assert (gripper.type, gripper.joints) == (expected.type, expected.joints)
    assert gripper.max_opening_m == pytest.approx(expected.max_opening_m, abs=0.005)
    without = msgspec.structs.replace(known, arms=(msgspec.structs.replace(known.arms[0], gripper=None),), grippers=())
    assert add_self_model(without, read_self_model(path)).arms[0].gripper == "gripper"


def test_an_arm_that_the_description_names_is_not_added_again(self_model: Path) -> None:
    whole = Arm(name="arm", joints=("j1", "j2", "j3"), base_link="base_link", tip_link="r_wrist_link")
    assert add_self_model(model(arms=(whole,)), read_self_model(self_model)).arms == (whole,)


def test_an_arm_of_one_link_adds_no_arm(self_model: Path) -> None:
    found = read_self_model(self_model)
    short = msgspec.structs.replace(
        found, components=tuple(msgspec.structs.replace(each, links=each.links[:1]) for each in found.components)
    )
    joined = add_self_model(model(), short)
    assert joined.arms == ()
    assert "right_arm" in {each.name for each in joined.components}


def test_an_arm_whose_tip_is_not_below_its_base_adds_no_arm(self_model: Path) -> None:
    found = read_self_model(self_model)
    turned = tuple(msgspec.structs.replace(each, links=each.links[::-1]) for each in found.components)
    joined = add_self_model(model(), msgspec.structs.replace(found, components=turned))
    assert joined.arms == ()
    assert "no joint of the self-model's arm has a drive" in [note.text for note in joined.notes]


def test_links_that_the_description_lacks_are_noted(self_model: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.owl"
    other.write_text(SELF_MODEL.replace("r_elbow_link", "l_elbow_link"), encoding="utf-8")
    joined = add_self_model(model(), read_self_model(other))
    assert joined.arms == ()
    assert [note.text for note in joined.notes] == [
        "the self-model's right_arm has links that the description lacks: l_elbow_link"
    ]


def test_a_file_without_a_robot_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "none.owl"
    path.write_text(
        "@prefix owl: <http://www.w3.org/2002/07/owl#> . <http://e.org/n> a owl:Ontology .", encoding="utf-8"
    )
    with pytest.raises(RobotModelError, match="describes no robot"):
        read_self_model(path)
    path.write_text(SELF_MODEL, encoding="utf-8")
    with pytest.raises(RobotModelError, match="no robot 'Helper2'; name one of Helper1"):
        read_self_model(path, name="Helper2")


# -- the robots of the catalog -----------------------------------------------------------------------------------------

DRIVING = {"GoingSomewhere", "Translation-LocationChange"}
LOOKING = {"LookingAtSomething", "VisualPerception"}
REACHING = {"Reaching", "ParkingArms"}
GRASPING = {
    "GraspingSomething",
    "ReleasingGraspOfSomething",
    "PickingUpAnObject",
    "PuttingSomethingSomewhere",
    "Pouring",
}
OPENING = {"OpeningADoor", "OpeningADrawer", "ClosingADoor", "ClosingADrawer"}
FETCHING = {"FetchingSomething", "StoringSomething", "CarryingWhileLocomoting"}
EVERYTHING = DRIVING | LOOKING | REACHING | GRASPING | OPENING | FETCHING


@each_case(
    ("name", "able"),
    [
        ("panda", REACHING | GRASPING | OPENING),  # on a table, without a camera
        ("pr2", EVERYTHING),
        ("tiago", EVERYTHING),  # with the hand of five fingers
        ("tiago_no_hand", DRIVING | LOOKING | REACHING),
        ("ur5", REACHING),  # the arm is delivered without a gripper
        ("stretch", EVERYTHING),
        ("talos", LOOKING | REACHING | GRASPING | OPENING),  # nothing here lets it walk
        ("baxter", LOOKING | REACHING | GRASPING | OPENING),  # on a pedestal
    ],
)
def test_what_real_robots_are_able_to_do(name: str, able: set[str]) -> None:
    with KnowledgeBase() as kb:
        found = {local_name(row.action) for row in kb.ask("can", robot=name)}
        lacking = {local_name(row.action) for row in kb.ask("missing_for_action", robot=name)}
    assert found & EVERYTHING == able
    assert lacking & EVERYTHING == EVERYTHING - able, "what it cannot do has a reason"
