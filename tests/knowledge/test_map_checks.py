"""Findings about what a map cannot mean, in files that are written and read."""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from pathlib import Path

import msgspec
import pytest

from mindstage.knowledge import KnowledgeBase
from mindstage.maps import save_map
from mindstage.rdf import Finding
from mindstage.scene import AngularLimits, Attachment, AxisMotion, Body, Joint, LinearLimits
from tests.cases import each_case
from tests.engines.scenes import BASE, attachment, body, prismatic_joint, revolute_joint, world
from tests.maps.small_maps import knowrob_iri

FindingsOf = Callable[..., list[Finding]]
CASE = body("case", (0.0, 0.0, 0.5), (0.6, 0.6, 1.0))


@pytest.fixture
def findings_of(tmp_path: Path) -> FindingsOf:
    """Writes a world, reads it with the bundled ontology, and returns the findings."""

    def read(*parts: Body | Joint | Attachment) -> list[Finding]:
        save_map(world(*parts), tmp_path / "map.ttl")
        knowledge = KnowledgeBase()
        knowledge.load(tmp_path / "map.ttl")
        knowledge.world()
        return list(knowledge.findings())

    return read


def door(y: float = 0.0, x: float = 0.31, name: str = "door") -> Body:
    """A door in front of the case, which is at smaller x."""
    made = body(name, (x, y, 0.5), (0.02, 0.58, 0.96), "dynamic", 3.0)
    return msgspec.structs.replace(made, cls=knowrob_iri("Door"))


def hinge(at: tuple[float, float, float], middle: float, *, child: str = "door") -> Joint:
    """A hinge about z whose range begins at the closed position."""
    limits = AngularLimits(swing1=AxisMotion.LIMITED, swing1_limit=abs(middle), swing1_middle=middle)
    return msgspec.structs.replace(revolute_joint("hinge", "case", child, at), angular=limits)


def test_a_door_that_opens_outwards_has_no_finding(findings_of: FindingsOf) -> None:
    assert findings_of(CASE, door(), hinge((0.31, 0.29, 0.5), pi / 4)) == []


def test_a_hinge_that_opens_inwards_is_reported(findings_of: FindingsOf) -> None:
    (finding,) = findings_of(CASE, door(), hinge((0.31, 0.29, 0.5), -pi / 4))
    assert finding.individual == BASE + "hinge"
    assert finding.problem == "it opens door inwards: half open, its middle is 0.20 m inside of case"


@each_case(("distance", "is_reported"), [(0.9, False), (1.3, True)])
def test_a_hinge_far_from_its_door_is_reported(findings_of: FindingsOf, distance: float, is_reported: bool) -> None:
    found = findings_of(CASE, door(), hinge((0.31, 0.29 + distance, 0.5), pi / 4))
    assert [f"its axis is {distance:.2f} m from door, which it moves" == each.problem for each in found] == (
        [True] if is_reported else []
    )


def test_a_hinge_above_its_door_is_not_far(findings_of: FindingsOf) -> None:
    assert findings_of(CASE, door(), hinge((0.31, 0.29, 3.5), pi / 4)) == []


@each_case(("limit", "is_reported"), [(0.01, True), (0.3, False)])
def test_a_door_that_slides_by_its_thickness_is_reported(
    findings_of: FindingsOf, limit: float, is_reported: bool
) -> None:
    slide = prismatic_joint("slide", "case", "door", (0.31, 0.0, 0.5))
    slide = msgspec.structs.replace(slide, linear=LinearLimits(x=AxisMotion.LIMITED, limit=limit, x_middle=limit))
    found = findings_of(CASE, door(), slide)
    assert [each.problem for each in found] == (["it lets the door door slide by 0.02 m only"] if is_reported else [])


def test_doors_with_one_pose_are_reported(findings_of: FindingsOf) -> None:
    (finding,) = findings_of(CASE, *(door(name=f"door{n}", x=2.0) for n in range(3)), door(y=1.0, x=2.0))
    assert finding.problem == "door0, door1, door2 have the identical pose"


def test_a_drawer_in_another_cupboard_is_reported(findings_of: FindingsOf) -> None:
    drawer = body("drawer", (0.0, 0.25, 0.8), (0.5, 0.5, 0.2), "dynamic", 2.0)
    other = body("other", (0.0, 0.6, 0.5), (0.6, 0.6, 1.0))
    slide = prismatic_joint("slide", "case", "drawer", (0.0, 0.25, 0.8))
    (finding,) = findings_of(CASE, drawer, other, slide)
    assert finding.individual == BASE + "drawer"
    assert finding.problem == "drawer moves, and is partly in what does not move: other"


def test_a_drawer_in_its_own_cupboard_is_not_reported(findings_of: FindingsOf) -> None:
    drawer = body("drawer", (0.2, 0.0, 0.8), (0.5, 0.5, 0.2), "dynamic", 2.0)
    board = body("board", (0.0, 0.0, 0.69), (0.58, 0.58, 0.3))
    slide = prismatic_joint("slide", "case", "drawer", (0.2, 0.0, 0.8))
    assert findings_of(CASE, drawer, board, attachment("case", "board"), slide) == []


@each_case(("name", "near"), [("Cupp", "'Cup'"), ("Refrigeratr", "'Refrigerator'")])
def test_a_class_that_no_ontology_has_is_reported_with_near_ones(findings_of: FindingsOf, name: str, near: str) -> None:
    cup = msgspec.structs.replace(body("cup", (0.0, 0.0, 1.05), (0.1, 0.1, 0.1)), cls=knowrob_iri(name))
    (finding,) = findings_of(CASE, cup)
    assert finding.individual == knowrob_iri(name)
    assert finding.problem.startswith(f"no loaded ontology has the class {name!r}; near: {near}")


def test_a_class_of_the_same_name_in_another_namespace_is_named_in_full(findings_of: FindingsOf) -> None:
    door = msgspec.structs.replace(body("door", (0.0, 0.0, 1.0), (0.1, 0.5, 0.8)), cls=knowrob_iri("CupboardDoor"))
    (finding,) = findings_of(CASE, door)
    assert "the class 'CupboardDoor'; near: http://mindstage.org/ontology#CupboardDoor" in finding.problem


def test_known_classes_are_not_reported(findings_of: FindingsOf) -> None:
    cup = msgspec.structs.replace(body("cup", (0.0, 0.0, 1.05), (0.1, 0.1, 0.1)), cls=knowrob_iri("Cup"))
    assert findings_of(CASE, cup) == []


def test_three_doors_of_the_room_with_one_pose_are_found(shared_data: Path) -> None:
    knowledge = KnowledgeBase()
    knowledge.load(shared_data / "maps" / "soma-iai-room.owl")
    knowledge.world()
    (finding,) = [each for each in knowledge.findings() if "identical pose" in each.problem]
    assert "drawer_sinkblock_dishwasher_door, drawer_fridge_upper_door, drawer_oven_upper_door" in finding.problem
