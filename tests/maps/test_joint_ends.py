"""Which end of a joint moves, in every dialect and with both orders of its ends. The truth stands in each case."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import pytest
import rdflib

from mindstage.maps import MapFormat
from mindstage.maps.io.write import MapDialect, save_map
from mindstage.scene import World, diff
from mindstage.scene.joint_kinematics import axis_ranges, is_moving_part_class, moving_body
from tests.cases import each_case
from tests.kitchenette import KNOWROB
from tests.maps.dialect_maps import finding_texts, joint_range, knowrob1_map, matrix_turtle, soma_map
from tests.maps.small_maps import ReadMap, body_turtle, knowledge_base_from, room_map, slide_joint
from tests.maps.test_ameva import CLASSES, placed_body
from tests.maps.test_same_statements import assert_same, written_again

SIZE = 'k:depthOfObject "{}"^^xsd:float ; k:widthOfObject "{}"^^xsd:float ; k:heightOfObject "{}"^^xsd:float'


def ends(world: World) -> list[tuple[str, str]]:
    """The end that holds and the end that moves of each joint, in the order of the world."""
    bodies = {body.id: body for body in world.bodies}
    pairs = []
    for joint in world.joints:
        moving, holder = moving_body(joint, bodies[joint.parent], bodies[joint.child])
        pairs.append((holder.id, moving.id))
    return pairs


def attached(world: World) -> set[tuple[str, str]]:
    return {(each.parent, each.child) for each in world.attachments}


@each_case(
    ("name", "moves"),
    [
        ("IAIFridgeDoor", True),
        ("IAIDrawerW60H29", True),
        ("IAIDrawer_60_29", True),
        ("CoolBoxDoor", True),
        ("http://knowrob.org/kb/knowrob.owl#TrashBinLid", True),
        ("DishwasherUpperRack", True),
        ("DoorFrame", False),
        ("IAIDoorHandle", False),
        ("DrawerCabinet", False),
        ("ChestOfDrawers", False),
        ("Doorway", False),
        ("Refrigerator", False),
    ],
)
def test_the_last_noun_of_a_class_decides_whether_it_moves(name: str, moves: bool) -> None:
    assert is_moving_part_class(name) is moves


# -- KnowRob 1 ---------------------------------------------------------------------------------------------------------


def thing(name: str, cls: str, x: float, *facts: str, size: tuple[float, float, float] | None = None) -> str:
    given = [*facts, *([SIZE.format(*size)] if size else [])]
    more = "".join(f" ; {fact}" for fact in given)
    matrix = matrix_turtle(f"m-{name}", x, 0, 1)
    return f":{name} a k:{cls} ; k:describedInMap :old ; k:orientation :m-{name}{more} .\n{matrix}"


def hinge(*connected: str, facts: str = "") -> str:
    joined = "".join(f" ; k:connectedTo-Rigidly :{each}" for each in connected)
    return f""":hinge a k:HingedJoint ; k:describedInMap :old{joined}{facts} ;
        k:minJointValue "0.0"^^xsd:float ; k:maxJointValue "1.5"^^xsd:float ."""


SMALL, LARGE = (0.02, 0.5, 0.5), (0.6, 0.6, 1.0)
EVIDENCE = {
    "doorHingedWith": (thing("a", "Thing", 0), thing("b", "Thing", 0.3, "k:doorHingedWith :hinge")),
    "doorHingedTo": (thing("a", "Thing", 0), thing("b", "Thing", 0.3, "k:doorHingedTo :a")),
    "part": (thing("a", "Thing", 0, "k:properPhysicalParts :b"), thing("b", "Thing", 0.3)),
    "class": (thing("a", "CoolBox", 0), thing("b", "CoolBoxDoor", 0.3)),
    "class above": (thing("a", "Thing", 0), thing("b", "Panel", 0.3) + "\nk:Panel rdfs:subClassOf k:Door ."),
    "handle": (
        thing("a", "Thing", 0),
        thing("b", "Thing", 0.3, "k:properPhysicalParts :grip") + thing("grip", "Handle", 0.35),
    ),
    "size": (thing("a", "Thing", 0, size=LARGE), thing("b", "Thing", 0.3, size=SMALL)),
    "class against a size of one only": (thing("a", "CoolBox", 0), thing("b", "CoolBoxDoor", 0.3, size=SMALL)),
}


@each_case("evidence", EVIDENCE)
def test_the_door_of_a_knowrob_1_map_moves_in_either_order(evidence: str, read: ReadMap) -> None:
    for order in permutations(("a", "b")):
        for things in permutations(EVIDENCE[evidence]):
            world, findings = read(knowrob1_map(*things, hinge(*order)))
            assert ends(world) == [("a", "b")], order
            assert [(joint.parent, joint.child) for joint in world.joints] == [("a", "b")]
            assert "moves" not in finding_texts(findings, "hinge")


def test_without_evidence_the_order_of_the_file_counts_and_is_reported(read: ReadMap) -> None:
    for first, second in permutations(("a", "b")):
        world, findings = read(knowrob1_map(thing("a", "Thing", 0), thing("b", "Thing", 0.3), hinge(first, second)))
        assert ends(world) == [(first, second)]
        text = finding_texts(findings, "hinge")
        assert f"nothing decides which of {first} and {second} moves" in text
        assert f"{second} moves" in text


def test_evidence_for_both_ends_is_reported(read: ReadMap) -> None:
    wrong = thing("a", "CoolBox", 0, "k:doorHingedWith :hinge")
    world, findings = read(knowrob1_map(wrong, thing("b", "CoolBoxDoor", 0.3), hinge("a", "b")))
    assert ends(world) == [("b", "a")]
    text = finding_texts(findings, "hinge")
    assert "a seems to move (doorHingedWith is stated of it), and b too (it is a CoolBoxDoor); a moves" in text


def test_a_child_that_is_stated_counts_less_than_the_class_of_a_door(read: ReadMap) -> None:
    stated = hinge(facts=" ; k:parent :b ; k:child :a")
    world, findings = read(knowrob1_map(thing("a", "CoolBox", 0), thing("b", "CoolBoxDoor", 0.3), stated))
    assert ends(world) == [("a", "b")]
    assert "and a too (it is the child); b moves" in finding_texts(findings, "hinge")
    plain = knowrob1_map(thing("a", "Thing", 0), thing("b", "Thing", 0.3), stated)
    world, findings = read(plain)
    assert (ends(world), "moves" in finding_texts(findings, "hinge")) == ([("b", "a")], False)


@each_case("joint", ["PrismaticJoint", "HingedJoint"])
def test_only_a_slide_of_a_handle_moves_its_drawer(joint: str, read: ReadMap) -> None:
    world, _ = read(
        knowrob1_map(
            thing("cupboard", "Cupboard", 0, "k:properPhysicalParts :drawer", size=LARGE),
            thing("drawer", "Drawer", 0.05, "k:properPhysicalParts :grip, :slide", size=(0.5, 0.5, 0.2)),
            thing("grip", "Handle", 0.32, size=(0.02, 0.2, 0.02)),
            f""":slide a k:{joint} ; k:describedInMap :old ; k:connectedTo-Rigidly :drawer, :grip ;
                k:minJointValue "0.0"^^xsd:float ; k:maxJointValue "0.4"^^xsd:float .""",
        )
    )
    slides = joint == "PrismaticJoint"
    assert ends(world) == [("cupboard", "drawer") if slides else ("drawer", "grip")]
    assert attached(world) == {("drawer", "grip") if slides else ("cupboard", "drawer")}


# -- SOMA --------------------------------------------------------------------------------------------------------------


def soma_thing(name: str, cls: str, x: float, size: tuple[float, float, float], *facts: str) -> str:
    more = "".join(f" ; {fact}" for fact in facts)
    depth, width, height = size
    return f""":{name} a owl:NamedIndividual, soma:{cls} ; soma:hasShape [ a soma:Shape ; dul:hasRegion [
            a soma:BoxShape ; soma:hasDepth {depth} ; soma:hasWidth {width} ; soma:hasHeight {height} ] ] ;
        soma:hasLocalization [ a soma:Localization ; soma:hasSpaceRegion [ a soma:6DPose ;
            k:quaternion "0 0 0 1"^^soma:array_double ; k:translation "{x} 0 1"^^soma:array_double ] ]{more} ."""


def soma_joint(kind: str, parent: str, child: str, *facts: str) -> str:
    more = "".join(f" ; {fact}" for fact in facts)
    return f"""urdf:hasJoint [ a urdf:{kind} ; urdf:hasParentLink :{parent} ; urdf:hasChildLink :{child} ;
        urdf:hasJointLimits [ urdf:hasLowerLimit 0.0 ; urdf:hasUpperLimit 0.4 ]{more} ]"""


@each_case("kind", ["RevoluteJoint", "PrismaticJoint"])
def test_the_door_of_a_soma_map_moves_in_either_order(kind: str, read: ReadMap) -> None:
    for parent, child in permutations(("case", "panel")):
        joint = soma_joint(kind, parent, child)
        facts = {parent: (joint,), child: ()}
        world, findings = read(
            soma_map(
                soma_thing("case", "Refrigerator", 0, LARGE, *facts["case"]),
                soma_thing("panel", "Door", 0.31, SMALL, *facts["panel"]),
            )
        )
        assert [(each.parent, each.child) for each in world.joints] == [("case", "panel")]
        reported = "case too (it is the child); panel moves" in finding_texts(findings, "panel")
        assert reported is (child == "case")


def test_the_axis_of_swapped_ends_points_the_other_way(read: ReadMap) -> None:
    """A case that slides 0.4 m along x, seen from its drawer, is a drawer that slides 0.4 m along -x."""
    for parent, child, direction in (("case", "drawer", 1.0), ("drawer", "case", -1.0)):
        facts = {parent: (soma_joint("PrismaticJoint", parent, child, 'urdf:hasAxisVector "1 0 0"'),), child: ()}
        world, _ = read(
            soma_map(
                soma_thing("case", "Cupboard", 0, LARGE, *facts["case"]),
                soma_thing("drawer", "Drawer", 0.1, SMALL, *facts["drawer"]),
            )
        )
        (joint,) = world.joints
        _, _, y, z = joint.pose.quaternion
        along_x = 1 - 2 * (y * y + z * z)
        assert (joint.parent, joint.child, along_x) == ("case", "drawer", pytest.approx(direction))
        assert joint_range(joint) == pytest.approx((0.0, 0.4))


DRAWER = soma_thing(
    "drawer",
    "Drawer",
    0,
    (0.5, 0.5, 0.2),
    "soma:hasPhysicalComponent :grip",
    soma_joint("PrismaticJoint", "drawer", "grip"),
)
GRIP = soma_thing("grip", "DesignedHandle", 0.27, (0.04, 0.3, 0.02))


@each_case(
    ("others", "joint", "text"),
    [
        (
            [soma_thing("block", "Cupboard", 0, LARGE, "soma:hasPhysicalComponent :drawer")],
            ("block", "drawer"),
            "drawer with grip out of block: it is a part of it",
        ),
        (
            [soma_thing("stove", "Stove", -0.6, LARGE), soma_thing("wall", "Wall", -5, LARGE)],
            ("stove", "drawer"),
            "drawer with grip out of stove: it is 50 mm away, and no whole is given",
        ),
        ([soma_thing("wall", "Wall", -5, LARGE)], ("drawer", "grip"), "nothing holds drawer; the handle moves alone"),
    ],
)
def test_a_slide_of_a_handle_moves_the_drawer_that_carries_it(
    others: list[str], joint: tuple[str, str], text: str, tmp_path: Path
) -> None:
    path = tmp_path / "map.ttl"
    path.write_text(soma_map(DRAWER, GRIP, *others), encoding="utf-8")
    knowledge = knowledge_base_from(path)
    world = knowledge.world()
    assert ends(world) == [joint]
    assert (("drawer", "grip") in attached(world)) is (joint[1] == "drawer")
    reported = [*(each.evidence for each in knowledge.assumptions()), *map(str, knowledge.findings())]
    assert any(text in each for each in reported)
    (own,) = world.joints
    assert max(each.limit + abs(each.middle) for each in axis_ranges(own)) == pytest.approx(0.4)
    assert ("parent" in own.assumed) is (joint[1] == "drawer")


@each_case("dialect", [*MapDialect])
def test_what_is_assumed_to_hold_a_drawer_is_not_written_as_stated(dialect: MapDialect, tmp_path: Path) -> None:
    path, copy = tmp_path / "map.ttl", tmp_path / "copy.owl"
    path.write_text(soma_map(DRAWER, GRIP, soma_thing("stove", "Stove", -0.6, LARGE)), encoding="utf-8")
    before = knowledge_base_from(path)
    save_map(before.world(), copy, dialect=dialect)
    after = knowledge_base_from(copy)
    assert diff(before.world(), after.world()).identical(1e-12)
    assert [joint.assumed for joint in before.world().joints] == [joint.assumed for joint in after.world().joints]
    owners = [{(row.individual, row.handle) for row in each.ask("handle_of")} for each in (before, after)]
    assert owners[0] == owners[1]
    graph = rdflib.Graph().parse(copy, format="xml")
    joints = set(graph.subjects(rdflib.RDF.type, rdflib.URIRef(KNOWROB + "Constraint")))
    assert joints
    assert not [parent for joint in joints for parent in graph.objects(joint, rdflib.URIRef(KNOWROB + "parent"))]


# -- AMEVA and SemLog --------------------------------------------------------------------------------------------------


@each_case(("joint", "moving"), [("RevoluteJoint", "door"), ("LinearJoint", "drawer")])
def test_the_door_of_an_ameva_map_moves_in_either_order(joint: str, moving: str, read: ReadMap) -> None:
    for parent, child in permutations(("fridge", moving)):
        world, findings = read(
            room_map(
                *CLASSES,
                placed_body("fridge", "k:IAIFridgeArea", "100.0 200.0 75.0", 'k:maskColor "FD1ACDFF"'),
                placed_body("door", "k:IAIDoor", "126.0 200.0 96.0"),
                placed_body("drawer", "k:IAIDrawer", "104.0 200.0 35.0"),
                placed_body("joint", f"k:{joint}", "126.0 172.0 97.0", f"k:parent :{parent}", f"k:child :{child}"),
            )
        )
        assert ends(world) == [("fridge", moving)]
        assert [(each.parent, each.child) for each in world.joints] == [("fridge", moving)]
        assert (f"{moving} moves" in finding_texts(findings, "joint")) is (child == "fridge")


@each_case(
    ("case", "panel"),
    [
        ((), ()),
        (('k:mobility "dynamic"',), ('k:mobility "dynamic"',)),
        (('k:mobility "static"',), ('k:mobility "dynamic"',)),
    ],
)
def test_the_drawer_of_a_semlog_map_moves_in_either_order_and_the_order_is_kept(
    case: tuple[str, ...], panel: tuple[str, ...], read: ReadMap
) -> None:
    for parent, child in permutations(("case", "panel")):
        world, _ = read(
            room_map(
                body_turtle("case", *case, cls="k:CoolBox"),
                body_turtle("panel", *panel, cls="k:CoolBoxDrawer"),
                slide_joint("slide", parent, child),
            )
        )
        assert ends(world) == [("case", "panel")]
        assert [(each.parent, each.child) for each in world.joints] == [(parent, child)]


# -- written back ------------------------------------------------------------------------------------------------------


def reversed_maps() -> dict[str, str]:
    """Maps of each dialect in which the door is not where the reader expects it."""
    return {
        "KnowRob 1": knowrob1_map(*EVIDENCE["class"], hinge("b", "a")),
        "SOMA": soma_map(
            soma_thing("case", "Refrigerator", 0, LARGE),
            soma_thing("panel", "Door", 0.31, SMALL, soma_joint("RevoluteJoint", "panel", "case")),
        ),
        "SOMA, handle": soma_map(DRAWER, GRIP, soma_thing("stove", "Stove", -0.6, LARGE)),
        "AMEVA": room_map(
            *CLASSES,
            placed_body("fridge", "k:IAIFridgeArea", "100.0 200.0 75.0", 'k:maskColor "FD1ACDFF"', "k:parent :door"),
            placed_body("door", "k:IAIDoor", "126.0 200.0 96.0", "k:child :fridge"),
            placed_body("joint", "k:RevoluteJoint", "126.0 172.0 97.0", "k:parent :door", "k:child :fridge"),
        ),
        "SemLog": room_map(
            body_turtle("case", cls="k:CoolBox"),
            body_turtle("panel", cls="k:CoolBoxDrawer"),
            slide_joint("slide", "panel", "case"),
        ),
    }


@each_case("dialect", reversed_maps())
def test_the_order_of_the_file_is_written_back_text_by_text(dialect: str, tmp_path: Path) -> None:
    source = tmp_path / f"{dialect}.ttl"
    source.write_text(reversed_maps()[dialect], encoding="utf-8")
    back = written_again(source, MapFormat.TURTLE)
    assert_same(back, source)
    assert ends(knowledge_base_from(back).world()) == ends(knowledge_base_from(source).world())
