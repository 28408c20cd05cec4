"""AMEVA maps: centimeters, left-handed frames, quaternions x y z w, and joints without axes and limits."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pyoxigraph as ox
import pytest

from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import Handedness, LengthUnit, MapFormat, QuaternionOrder, UnitConventions, save_map, write_map
from mindstage.maps.dialects.unit_conversion import original_property
from mindstage.rdf import Severity
from mindstage.scene import AxisMotion, Body, Iri, Pose, World
from mindstage.scene.bounding_boxes import world_bounds
from mindstage.scene.edits import Spawn
from tests.maps.small_maps import (
    KNOWROB,
    ReadMap,
    assert_worlds_equal,
    individual,
    knowledge_base_from,
    knowrob_iri,
    room_map,
)

MS = "http://mindstage.org/ontology#"
SIZES = {"k:IAIFridgeArea": (58.0, 60.0, 150.0), "k:IAIDoor": (6.0, 58.0, 86.0), "k:IAIDrawer": (51.0, 59.0, 28.0)}


def sized(cls: str, size: tuple[float, ...]) -> str:
    properties = ("depthOfObject", "widthOfObject", "heightOfObject")
    restrictions = ", ".join(
        f'[a owl:Restriction ; owl:onProperty k:{name} ; owl:hasValue "{extent}"^^xsd:float]'
        for name, extent in zip(properties, size, strict=True)
    )
    return f"{cls} a owl:Class ; rdfs:subClassOf {restrictions} ."


def placed_body(name: str, cls: str, at: str, *facts: str, turned: str = "0.0 0.0 0.0 1.0") -> str:
    more = "".join(f" ; {fact}" for fact in facts)
    return f""":{name} a owl:NamedIndividual, {cls} ; k:describedInMap :room ; k:pose :{name}-p{more} .
:{name}-p a owl:NamedIndividual, k:Pose ; k:translation "{at}" ; k:quaternion "{turned}" ."""


CLASSES = [sized(cls, size) for cls, size in SIZES.items()]
FRIDGE = [
    placed_body("fridge", "k:IAIFridgeArea", "100.0 200.0 75.0", "k:child :door, :drawer", 'k:maskColor "FD1ACDFF"'),
    placed_body("door", "k:IAIDoor", "126.0 200.0 96.0", "k:parent :fridge", 'k:mobility "dynamic"'),
    placed_body("drawer", "k:IAIDrawer", "104.0 200.0 35.0", "k:parent :fridge", 'k:mobility "dynamic"'),
    placed_body("hinge", "k:RevoluteJoint", "126.0 172.0 97.0", "k:parent :door", 'k:mobility "kinematic"'),
    placed_body("slide", "k:LinearJoint", "130.0 200.0 36.0", "k:parent :drawer"),
]


def fridge(*more: str) -> str:
    return room_map(*CLASSES, *FRIDGE, *more)


def at(world: World, id: str) -> Body:
    return world.body(id)


def test_centimeters_in_a_mirrored_frame_become_meters_in_ros(read: ReadMap) -> None:
    half = math.sqrt(0.5)
    cup = placed_body("cup", "k:Cup", "10.0 20.0 30.0", turned=f"0.0 0.0 {half} {half}")
    world, _ = read(fridge(cup))
    assert at(world, "fridge").pose == Pose((1.0, -2.0, 0.75), (1.0, 0.0, 0.0, 0.0))
    assert at(world, "fridge").size == (0.58, 0.6, 1.5)
    assert at(world, "cup").pose == Pose((0.1, -0.2, 0.3), (half, 0.0, 0.0, -half))


def test_assumptions_are_reported_with_evidence(tmp_path: Path) -> None:
    (tmp_path / "map.ttl").write_text(fridge(), encoding="utf-8")
    knowledge = knowledge_base_from(tmp_path / "map.ttl")
    assert knowledge.assumptions() == ()
    knowledge.world()
    assumptions = {assumption.topic: assumption for assumption in knowledge.assumptions()}
    assert {about: assumptions[about].value for about in ("units", "frame", "quaternion")} == {
        "units": "cm",
        "frame": "unreal",
        "quaternion": "xyzw",
    }
    assert "0.86 m large" in assumptions["units"].evidence
    assert "heights go from 0.35 to 0.97 m" in assumptions["frame"].evidence
    assert "as xyzw 5 of 5 are upright and 5 are not rotated" in assumptions["quaternion"].evidence
    assert not any(assumption.overridden for assumption in assumptions.values())
    assert all(assumption.map == individual("room") for assumption in assumptions.values())


def test_a_copy_as_bytes_has_the_assumptions_and_findings_of_its_worlds(tmp_path: Path) -> None:
    (tmp_path / "map.ttl").write_text(fridge(), encoding="utf-8")
    knowledge = knowledge_base_from(tmp_path / "map.ttl")
    world = knowledge.world()
    copy = KnowledgeBase.from_bytes(knowledge.to_bytes())
    assert len(copy.assumptions()) >= 3
    assert (copy.assumptions(), copy.findings()) == (knowledge.assumptions(), knowledge.findings())
    assert copy.world() == world
    assert KnowledgeBase.from_bytes(copy.to_bytes()).assumptions() == knowledge.assumptions()


def test_conventions_of_the_user_take_precedence(tmp_path: Path) -> None:
    (tmp_path / "map.ttl").write_text(fridge(), encoding="utf-8")
    knowledge = KnowledgeBase(bundled_ontology=False)
    chosen = UnitConventions(units=LengthUnit.MILLIMETERS, frame=Handedness.ROS, quaternion=QuaternionOrder.WXYZ)
    knowledge.load(tmp_path / "map.ttl", conventions=chosen)
    world = knowledge.world()
    assert world.body("fridge").pose == Pose((0.1, 0.2, 0.075), (0.0, 0.0, 0.0, 1.0))
    assumptions = {assumption.topic: assumption for assumption in knowledge.assumptions()}
    assert assumptions["units"].overridden
    assert "the evidence indicates cm" in assumptions["units"].evidence
    assert not assumptions["joints"].overridden


def test_maps_in_meters_are_recognized(read: ReadMap) -> None:
    """As written by a logger that converts units."""
    small = [sized("k:IAIFridgeArea", (0.58, 0.6, 1.5))]
    box = placed_body("fridge", "k:IAIFridgeArea", "1.0 2.0 0.75", 'k:maskColor "FD1ACDFF"', turned="1.0 0.0 0.0 0.0")
    world, _ = read(room_map(*small, box))
    assert at(world, "fridge").pose == Pose((1.0, 2.0, 0.75), (1.0, 0.0, 0.0, 0.0))
    assert not any("given" in fact.property for fact in world.facts)


# -- joints ------------------------------------------------------------------------------------------------------------


def test_a_joint_connects_its_parent_to_the_parent_of_that(read: ReadMap) -> None:
    world, findings = read(fridge())
    joints = {constraint.id: constraint for constraint in world.joints}
    assert {id: (joint.parent, joint.child) for id, joint in joints.items()} == {
        "hinge": ("fridge", "door"),
        "slide": ("fridge", "drawer"),
    }
    assert world.attachments == (), "what a joint moves does not go where its parent goes"
    reported = [finding for finding in findings if "neither an axis nor limits" in finding.problem]
    assert {finding.individual for finding in reported} == {individual("hinge"), individual("slide")}


def test_a_door_turns_about_the_edge_at_its_joint(read: ReadMap) -> None:
    world, _ = read(fridge())
    hinge = next(joint for joint in world.joints if joint.id == "hinge")
    assert (hinge.angular.swing1, hinge.angular.swing2, hinge.angular.twist) == (
        AxisMotion.LIMITED,
        AxisMotion.LOCKED,
        AxisMotion.LOCKED,
    )
    # In Unreal's frame the hinge is on the side of smaller y, so the door opens towards positive angles about z.
    assert (hinge.angular.swing1_middle, hinge.angular.swing1_limit) == (math.pi / 4, math.pi / 4)
    below = placed_body("hinge", "k:RevoluteJoint", "126.0 199.0 54.0", "k:parent :door")
    world, _ = read(room_map(*CLASSES, *FRIDGE[:3], below))
    assert world.joints[0].angular.swing2 is AxisMotion.LIMITED


def test_a_knob_turns_about_its_axis_without_limits(read: ReadMap) -> None:
    knob = placed_body("knob", "k:Knob", "131.0 200.0 140.0", "k:parent :fridge", 'k:mobility "dynamic"')
    joint = placed_body("turn", "k:RevoluteJoint", "131.0 200.0 140.0", "k:parent :knob")
    world, _ = read(fridge(sized("k:Knob", (2.5, 4.0, 4.0)), knob, joint))
    turn = next(joint for joint in world.joints if joint.id == "turn")
    assert turn.angular.twist is AxisMotion.FREE
    assert turn.angular.swing1 is turn.angular.swing2 is AxisMotion.LOCKED


def test_a_drawer_slides_by_its_own_depth(read: ReadMap) -> None:
    world, _ = read(fridge())
    slide = next(joint for joint in world.joints if joint.id == "slide")
    assert (slide.linear.x, slide.linear.y, slide.linear.z) == (
        AxisMotion.LIMITED,
        AxisMotion.LOCKED,
        AxisMotion.LOCKED,
    )
    assert (slide.linear.x_middle, slide.linear.limit) == pytest.approx((0.255, 0.255)), "as the door faces x"


def test_a_joint_without_a_parent_is_omitted_and_reported(read: ReadMap) -> None:
    world, findings = read(fridge(placed_body("lost", "k:LinearJoint", "1.0 2.0 3.0")))
    assert all(joint.id != "lost" for joint in world.joints)
    assert any(finding.individual == individual("lost") and finding.severity is Severity.ERROR for finding in findings)
    assert any(resource.iri == individual("lost") for resource in world.resources)


def test_a_second_joint_between_two_bodies_is_free(read: ReadMap) -> None:
    second = placed_body("second", "k:LinearJoint", "126.0 228.0 97.0", "k:parent :door")
    world, findings = read(fridge(second))
    joint = next(joint for joint in world.joints if joint.id == "second")
    assert {joint.linear.x, joint.linear.y, joint.angular.twist} == {AxisMotion.FREE}
    assert any(finding.individual == individual("second") and "another joint" in finding.action for finding in findings)


# -- values of classes -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "of_class",
    [
        'k:Cup a owl:Class ; k:pathToCadModel "package://cups/cup.dae" ; k:mass "0.25"^^xsd:float .',
        "k:Cup a owl:Class ; rdfs:subClassOf "
        '[a owl:Restriction ; owl:onProperty k:pathToCadModel ; owl:hasValue "package://cups/cup.dae"], '
        '[a owl:Restriction ; owl:onProperty k:mass ; owl:hasValue "0.25"^^xsd:float] .',
    ],
    ids=["plainly", "by restrictions"],
)
def test_mass_and_mesh_of_a_class_apply_to_its_members(of_class: str, read: ReadMap) -> None:
    own = placed_body("own", "k:Cup", "1.0 2.0 3.0", 'k:mass "0.5"^^xsd:float')
    text = room_map(of_class, placed_body("cup", "k:Cup", "10.0 20.0 30.0"), own)
    world, _ = read(text)
    assert (at(world, "cup").physics.mass_kg, at(world, "cup").mesh) == (0.25, "package://cups/cup.dae")
    assert at(world, "own").physics.mass_kg == 0.5
    again, _ = read(write_map(world, format=MapFormat.TURTLE))
    assert_worlds_equal(world, again)


def test_members_of_a_map_without_a_declaration_are_read(read: ReadMap) -> None:
    text = fridge().replace(":room a owl:NamedIndividual, k:SemanticEnvironmentMap .", "")
    world, findings = read(text)
    assert len(world.bodies) == 3
    assert any("it has no map class" in finding.problem for finding in findings)


# -- writing -----------------------------------------------------------------------------------------------------------


def test_original_values_are_kept_beside_converted_ones(read: ReadMap) -> None:
    world, _ = read(fridge())
    kept = {fact.property.removeprefix(MS): getattr(fact.value, "text", "") for fact in world.facts}
    assert kept == {
        "givenDialect": "AMEVA",
        "givenUnits": "cm",
        "givenFrame": "unreal",
        "givenQuaternionOrder": "xyzw",
    }
    text = write_map(world, format=MapFormat.TURTLE)
    assert 'ms:givenTranslation "100.0 200.0 75.0"' in text
    again, _ = read(text)
    assert_worlds_equal(world, again)


@pytest.fixture(scope="module")
def task_two(shared_data: Path) -> tuple[World, KnowledgeBase]:
    knowledge = knowledge_base_from(shared_data / "maps" / "ameva-task-two.owl")
    return knowledge.world(), knowledge


def test_a_real_map_has_the_size_of_its_kitchen(task_two: tuple[World, KnowledgeBase]) -> None:
    world, knowledge = task_two
    assert (len(world.bodies), len(world.joints), len(world.attachments)) == (78, 31, 36)
    extent = world_bounds(world)
    assert extent is not None
    assert extent.tallest_class == knowrob_iri("IAIFridgeArea")
    assert extent.height_m == pytest.approx(1.4992, abs=1e-3)
    assert all(1.0 < length < 5.0 for length in extent.size)
    assert not [finding for finding in knowledge.findings() if finding.severity is Severity.ERROR]


def test_a_real_map_is_not_mirrored(task_two: tuple[World, KnowledgeBase], shared_data: Path) -> None:
    """The same kitchen was logged twice: once with the frame converted, once without."""
    other = knowledge_base_from(shared_data / "maps" / "iai-kitchen-original.owl").world()

    def turn(world: World) -> float:
        places = {body.cls.removeprefix(KNOWROB): np.array(body.pose.position) for body in world.bodies}
        fridge, oven, island = (places[f"IAI{name}Area"] for name in ("Fridge", "Oven", "Island"))
        return float(np.cross(oven - fridge, island - fridge)[2])

    assert turn(task_two[0]) == pytest.approx(turn(other), rel=0.25)


def test_every_statement_of_a_real_map_is_kept(
    task_two: tuple[World, KnowledgeBase], shared_data: Path, tmp_path: Path
) -> None:
    world, _ = task_two
    save_map(world, tmp_path / "out.owl")
    assert_worlds_equal(world, knowledge_base_from(tmp_path / "out.owl").world())
    before, after = (statements(path) for path in (shared_data / "maps" / "ameva-task-two.owl", tmp_path / "out.owl"))
    assert len(before) > 1500
    lost = {(s, p, o) for s, p, o in before if (s, p, o) not in after and (s, original_property(p), o) not in after}
    assert lost == set()


def statements(path: Path) -> set[tuple[str, Iri, str]]:
    """The statements of a file about named resources; those of a restriction count for the class that it restricts."""
    quads = list(ox.parse(path=str(path), format=ox.RdfFormat.RDF_XML, base_iri=path.as_uri()))
    owners = {quad.object: str(quad.subject) for quad in quads if isinstance(quad.object, ox.BlankNode)}
    properties = {quad.subject: quad.object for quad in quads if quad.predicate.value.endswith("#onProperty")}
    found = set()
    for quad in quads:
        owner = f"{owners[quad.subject]} {properties[quad.subject]}" if quad.subject in owners else str(quad.subject)
        if not isinstance(quad.object, ox.BlankNode):
            found.add((owner, Iri(quad.predicate.value), as_value(quad.object)))
    return found


def as_value(term: ox.NamedNode | ox.Literal | ox.BlankNode | ox.Triple) -> str:
    """Numbers by value, everything else as text."""
    try:
        return " ".join(repr(float(number)) for number in term.value.split())  # type: ignore[union-attr]
    except ValueError:
        return str(term)


def test_a_real_map_is_stable_for_ten_seconds(task_two: tuple[World, KnowledgeBase]) -> None:
    world, _ = task_two
    engine = MujocoEngine()
    assert engine.apply(Spawn(world)).report.ok
    ids, before = engine.poses()
    engine.step(10.0)
    _, after = engine.poses()
    engine.close()
    assert len(ids) == len(world.bodies)
    assert np.isfinite(after).all()
    assert np.abs(after[:, :3] - before[:, :3]).max() < 1.5, "nothing flies away, though a door may open"
