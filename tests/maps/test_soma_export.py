"""Writing of any world as a SOMA map: reading gives the same world, and the SOMA statements alone describe it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyoxigraph as ox
import pytest
from hypothesis import given
from msgspec.structs import replace

from mindstage.maps import MapDialect, MapFormat, bundled_kitchen, save_map, write_map
from mindstage.scene import AxisMotion, BodyId, Iri, Joint, Pose, PrimitiveShape, PrimitiveType, World
from mindstage.scene.transforms import normalized_pose_array, rotation_matrix
from tests.kitchenette import kitchenette
from tests.maps.small_maps import KNOWROB, assert_worlds_equal, knowledge_base_from
from tests.maps.test_arbitrary_maps import mutated_maps, normalized
from tests.worlds import worlds

MS = "http://mindstage.org/ontology#"
SOMA = "http://www.ease-crc.org/ont/SOMA.owl#"
OURS = {KNOWROB + name for name in ("pose", "parent", "child", "linearConstraint", "angularConstraint", "mobility")}
SUFFIXES = {MapFormat.RDF_XML: ".owl", MapFormat.TURTLE: ".ttl"}
each_format = pytest.mark.parametrize("format", MapFormat)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of files that Hypothesis writes, which may overwrite one another."""
    return tmp_path_factory.mktemp("soma")


def through_soma(world: World, folder: Path, format: MapFormat = MapFormat.TURTLE) -> World:
    path = folder / f"soma{SUFFIXES[format]}"
    path.write_text(write_map(world, format=format, dialect=MapDialect.SOMA), encoding="utf-8", newline="")
    return knowledge_base_from(path).world(world.iri)


def world_of_soma_statements(path: Path, folder: Path) -> World:
    """The world of a file's SOMA statements, without those about poses and joints in other vocabularies."""
    quads = ox.parse(path=path, format=ox.RdfFormat.TURTLE)
    known = [quad.triple for quad in quads if _is_known(quad)]
    plain = folder / "plain.nt"
    ox.serialize(known, plain, ox.RdfFormat.N_TRIPLES)
    knowledge = knowledge_base_from(plain)
    assert knowledge.source_view().dialect == "SOMA"
    return knowledge.world()


def _is_known(quad: ox.Quad) -> bool:
    is_joint = quad.object == ox.NamedNode(KNOWROB + "Constraint")
    return not (quad.predicate.value.startswith(MS) or quad.predicate.value in OURS or is_joint)


@each_format
@given(world=worlds(wild_tags=True))
def test_any_world_survives_a_round_trip(world: World, format: MapFormat, folder: Path) -> None:
    assert_worlds_equal(world, through_soma(world, folder, format))


@given(world=worlds(labels=True))
def test_a_world_that_was_read_survives_a_round_trip_exactly(world: World, folder: Path) -> None:
    once = through_soma(world, folder)
    assert normalized(through_soma(once, folder)) == normalized(once)


@given(quads=mutated_maps())
def test_any_statements_survive_a_round_trip(quads: list[ox.Quad], folder: Path) -> None:
    path = folder / "map.ttl"
    ox.serialize(quads, path, ox.RdfFormat.TURTLE)
    knowledge = knowledge_base_from(path)
    for map in knowledge.maps():
        world = knowledge.world(map)
        assert normalized(through_soma(world, folder)) == normalized(world)


def test_poses_sizes_parts_and_joints_are_written_in_soma(tmp_path: Path) -> None:
    world = knowledge_base_from(bundled_kitchen(), bundled_ontology=True).world()
    path = tmp_path / "soma.ttl"
    save_map(world, path, dialect=MapDialect.SOMA)
    seen = world_of_soma_statements(path, tmp_path)
    bodies = {body.id: body for body in seen.bodies}
    assert len(bodies) == len(world.bodies)
    for body in world.bodies:
        assert (bodies[body.id].pose, bodies[body.id].size) == (body.pose, body.size)
    assert set(seen.attachments) == set(world.attachments)
    joints = {(joint.parent, joint.child): joint for joint in seen.joints}
    # Two joints of the kitchen have their door as parent. Read from SOMA, the door is the child, and the axis opposite.
    swapped = {("microwave_door", "microwave"), ("drawer_middle_1", "drawer_unit_middle")}
    assert joints.keys() == {
        (joint.parent, joint.child)[:: -1 if (joint.parent, joint.child) in swapped else 1] for joint in world.joints
    }
    for joint in world.joints:
        sign = -1 if (joint.parent, joint.child) in swapped else 1
        other = joints[(joint.parent, joint.child)[::sign]]
        np.testing.assert_allclose(_axis(other), sign * _axis(joint), atol=1e-9)
        assert _range(other) == pytest.approx(_range(joint))
        if joint.angular.swing1 is AxisMotion.LIMITED:  # the position along a sliding axis is arbitrary
            np.testing.assert_allclose(other.pose.position, joint.pose.position, atol=1e-9)


def _free(joint: Joint) -> tuple[int, float, float]:
    """Its only free axis: the index, the limit and the middle."""
    linear, angular = joint.linear, joint.angular
    ways = [
        (linear.x, linear.limit, linear.x_middle),
        (linear.y, linear.limit, linear.y_middle),
        (linear.z, linear.limit, linear.z_middle),
        (angular.twist, angular.twist_limit, angular.twist_middle),
        (angular.swing2, angular.swing2_limit, angular.swing2_middle),
        (angular.swing1, angular.swing1_limit, angular.swing1_middle),
    ]
    ((at, (_, limit, middle)),) = [(at, way) for at, way in enumerate(ways) if way[0] is not AxisMotion.LOCKED]
    return at, limit, middle


def _axis(joint: Joint) -> np.ndarray:
    return rotation_matrix(normalized_pose_array(joint.pose)[3:])[:, _free(joint)[0] % 3]


def _range(joint: Joint) -> tuple[float, float]:
    _, limit, middle = _free(joint)
    return middle - limit, middle + limit


def test_a_pose_is_written_only_in_soma() -> None:
    text = write_map(kitchenette(), format=MapFormat.TURTLE, dialect=MapDialect.SOMA)
    bodies = {body.id for body in kitchenette().bodies}
    assert text.count("soma:hasLocalization") == len(bodies)
    quads = ox.parse(text.encode(), ox.RdfFormat.TURTLE)
    placed = {quad.subject.value.split("#")[1] for quad in quads if quad.predicate.value == KNOWROB + "pose"}
    assert placed.isdisjoint(bodies)


def test_a_pose_that_was_edited_is_used(tmp_path: Path) -> None:
    world, path = kitchenette(), tmp_path / "map.ttl"
    body = world.bodies[0]
    text = write_map(world, format=MapFormat.TURTLE, dialect=MapDialect.SOMA)
    position = " ".join(map(repr, body.pose.position))
    assert text.count(f'"{position}"') >= 1
    path.write_text(text.replace(f'"{position}"', '"[7.0, 8.5, -9.0]"'), encoding="utf-8")
    assert knowledge_base_from(path).world().body(body.id).pose == replace(body.pose, position=(7.0, 8.5, -9.0))


def test_a_shape_that_was_edited_is_reported(tmp_path: Path) -> None:
    world, path = kitchenette(), tmp_path / "map.ttl"
    body = next(body for body in world.bodies if body.size is not None)
    assert body.size is not None
    text = write_map(world, format=MapFormat.TURTLE, dialect=MapDialect.SOMA)
    path.write_text(text.replace(f'soma:hasWidth "{body.size[1]}"', 'soma:hasWidth "99.0"'), encoding="utf-8")
    knowledge = knowledge_base_from(path)
    assert knowledge.world().body(body.id).size == body.size
    assert "99" in "\n".join(finding.problem for finding in knowledge.findings() if finding.individual == body.iri)


def test_spheres_and_cylinders_have_radii(tmp_path: Path) -> None:
    ball = replace(
        kitchenette().bodies[0], size=(0.2, 0.2, 0.2), shape=PrimitiveShape(type=PrimitiveType.SPHERE), facts=()
    )
    tin = replace(
        ball,
        id=BodyId("tin"),
        iri=Iri(ball.iri + "2"),
        size=(0.1, 0.1, 0.3),
        shape=PrimitiveShape(type=PrimitiveType.CYLINDER),
    )
    world = World(iri=kitchenette().iri, name=kitchenette().name, bodies=(ball, tin))
    path = tmp_path / "map.ttl"
    save_map(world, path, dialect=MapDialect.SOMA)
    assert_worlds_equal(world, knowledge_base_from(path).world())
    seen = {body.iri: body for body in world_of_soma_statements(path, tmp_path).bodies}
    for body in (ball, tin):
        assert (seen[body.iri].size, seen[body.iri].shape) == (body.size, body.shape)


def test_values_that_soma_cannot_express_are_reported(tmp_path: Path) -> None:
    notes = save_map(kitchenette(), tmp_path / "map.owl", dialect=MapDialect.SOMA)
    assert any("tags" in note for note in notes)
    assert save_map(kitchenette(), tmp_path / "map.owl") == ()


def test_no_pose_is_written_twice(shared_data: Path, tmp_path: Path) -> None:
    knowledge = knowledge_base_from(shared_data / "maps" / "soma-iai-room.owl")
    world, path = knowledge.world(), tmp_path / "map.ttl"
    save_map(world, path, dialect=MapDialect.SOMA)
    assert path.read_text(encoding="utf-8").count("soma:hasLocalization") == 49
    assert_worlds_equal(world, knowledge_base_from(path).world())
    moved = replace(world, bodies=(replace(world.bodies[0], pose=Pose((1.0, 2.0, 3.0))), *world.bodies[1:]))
    save_map(moved, path, dialect=MapDialect.SOMA)
    assert path.read_text(encoding="utf-8").count("soma:hasLocalization") == 49
    assert_worlds_equal(moved, knowledge_base_from(path).world())
    assert world_of_soma_statements(path, tmp_path).body(world.bodies[0].id).pose == Pose((1.0, 2.0, 3.0))
