"""Writing in the dialect of the source is exact: an unchanged map gives the same statements, text by text."""

from __future__ import annotations

import re
from itertools import islice
from pathlib import Path

import pyoxigraph as ox
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from mindstage.maps import MapFormat, save_map
from mindstage.maps.io.files import read_file
from mindstage.scene import Pose, World
from tests.maps.dialect_maps import knowrob1_map, perception
from tests.maps.small_maps import assert_worlds_equal, body_turtle, knowledge_base_from, room_map
from tests.maps.test_write_original import HINGE, SMALL, SUFFIXES

Statements = frozenset[ox.Quad]
each_format = pytest.mark.parametrize("format", MapFormat)


def statements(path: Path) -> Statements:
    """The statements of a file with the text of each literal; blank nodes have canonical labels."""
    file = read_file(path)
    try:
        quads = list(ox.parse(file.data, file.format, base_iri="http://example.org/base"))
    except SyntaxError as error:
        file = file.repair(error)
        quads = list(ox.parse(file.data, file.format, base_iri="http://example.org/base"))
    dataset = ox.Dataset(quads)
    dataset.canonicalize(ox.CanonicalizationAlgorithm.UNSTABLE)
    return frozenset(dataset)


def assert_same(back: Path, source: Path) -> None:
    """Compares two files; a difference is shown by a few statements, since that of all of them takes minutes."""
    here, there = statements(back), statements(source)
    lost, added = ([str(quad) for quad in islice(some, 5)] for some in (there - here, here - there))
    assert (lost, added) == ([], [])


def written_again(path: Path, format: MapFormat) -> Path:
    """The file that a map is written to in its own dialect, after its world was read."""
    knowledge = knowledge_base_from(path)
    back = path.with_name(f"back{SUFFIXES[format]}")
    notes = save_map(knowledge.world(), back, format=format, source_view=knowledge.source_view())
    assert notes == ()
    return back


@each_format
@pytest.mark.parametrize(
    "name",
    ["ameva-task-two", "iai-kitchen-original", "iai-kitchen-spawned", "knowrob1-ccrl", "soma-iai-room"],
)
def test_a_real_map_keeps_each_statement_and_its_text(
    name: str, format: MapFormat, shared_data: Path, tmp_path: Path
) -> None:
    source = tmp_path / f"{name}.owl"
    source.write_bytes((shared_data / "maps" / source.name).read_bytes())
    assert_same(written_again(source, format), source)


# -- spellings ---------------------------------------------------------------------------------------------------------

_SPELLINGS = st.sampled_from(("{0}", "{0:.6f}", "{0:+}", "{0:e}", "{0:.3E}", "{0:+.2f}"))
_PADDING = st.sampled_from(("", " ", "  ", "\t"))


@st.composite
def respelled(draw: st.DrawFn, text: str) -> str:
    """A map whose literals in quotes have other spellings of numbers: signs, digits, exponents and white space."""

    def spell(quoted: re.Match[str]) -> str:
        inner = quoted[1]
        if not re.fullmatch(r"[\s\d.+-]+", inner) or not any(letter.isdigit() for letter in inner):
            return quoted[0]
        numbers = [draw(_SPELLINGS).format(float(number)) for number in inner.split()]
        return f'"{draw(_PADDING)}{"  ".join(numbers)}{draw(_PADDING)}"'.replace("\t", "\\t")

    return re.sub(r'"([^"\n]*)"', spell, text)


@given(data=st.data(), format=st.sampled_from(MapFormat))
@pytest.mark.parametrize("dialect", SMALL)
def test_any_spelling_of_a_number_is_kept(
    tmp_path_factory: pytest.TempPathFactory, dialect: str, data: st.DataObject, format: MapFormat
) -> None:
    source = tmp_path_factory.mktemp("same", numbered=True) / "map.ttl"
    source.write_text(data.draw(respelled(SMALL[dialect])), encoding="utf-8")
    assert_same(written_again(source, format), source)


def odd_map(*more: str) -> str:
    return room_map(
        body_turtle("cup", 'k:mass "1.50"^^xsd:float, "1.5"^^xsd:float ; k:depthOfObject " +2 "^^xsd:float'),
        body_turtle("jar", 'k:mass "1e-3"^^xsd:float ; k:widthOfObject "0.10"^^xsd:double'),
        *more,
    )


@each_format
def test_two_spellings_of_one_number_are_both_kept(format: MapFormat, tmp_path: Path) -> None:
    source = tmp_path / "map.ttl"
    source.write_text(odd_map(), encoding="utf-8")
    assert_same(written_again(source, format), source)


@each_format
def test_moving_one_body_respells_no_other(format: MapFormat, tmp_path: Path) -> None:
    source = tmp_path / "map.ttl"
    source.write_text(odd_map(), encoding="utf-8")
    knowledge = knowledge_base_from(source)
    world, moved = knowledge.world(), Pose((4.0, 5.0, 6.0))
    cup, jar = (next(body for body in world.bodies if body.id == id) for id in ("cup", "jar"))
    world = replace(world, bodies=tuple(replace(jar, pose=moved) if body == jar else body for body in world.bodies))
    back = tmp_path / f"back{SUFFIXES[format]}"
    save_map(world, back, format=format, source_view=knowledge.source_view())
    assert_worlds_equal(world, knowledge_base_from(back).world())
    lost = statements(source) - statements(back)
    assert {quad.predicate.value.rpartition("#")[2] for quad in lost} <= {"translation", "quaternion", "pose"}
    assert not any(str(cup.iri) in str(quad.subject) for quad in lost)


# -- membership --------------------------------------------------------------------------------------------------------


def implied_map() -> str:
    """A KnowRob 1 map of which only the case states the map; door and handle belong to it by their whole."""
    return knowrob1_map(HINGE, *(perception(name, "5", n, 0, 1) for n, name in enumerate(("case", "door", "handle"))))


def members(path: Path) -> set[str]:
    property = "http://knowrob.org/kb/knowrob.owl#describedInMap"
    return {str(quad.subject) for quad in statements(path) if quad.predicate.value == property}


@each_format
def test_membership_that_follows_from_the_whole_is_not_written(format: MapFormat, tmp_path: Path) -> None:
    source = tmp_path / "map.ttl"
    source.write_text(implied_map(), encoding="utf-8")
    back = written_again(source, format)
    assert members(back) == members(source)
    assert len(knowledge_base_from(back).world().bodies) == 3
    assert_worlds_equal(knowledge_base_from(source).world(), knowledge_base_from(back).world())


def test_membership_is_written_with_a_change_that_stops_its_inference(tmp_path: Path) -> None:
    source = tmp_path / "map.ttl"
    source.write_text(implied_map(), encoding="utf-8")
    knowledge = knowledge_base_from(source)
    world: World = knowledge.world()
    first, *others = world.bodies
    world = replace(world, bodies=(replace(first, pose=Pose((7.0, 8.0, 9.0))), *others))
    back = tmp_path / "back.owl"
    save_map(world, back, source_view=knowledge.source_view())
    assert_worlds_equal(world, knowledge_base_from(back).world())


def test_stated_membership_of_a_part_is_kept(tmp_path: Path) -> None:
    source = tmp_path / "map.ttl"
    source.write_text(implied_map() + "\n:door k:describedInMap :old .\n", encoding="utf-8")
    back = written_again(source, MapFormat.TURTLE)
    assert members(back) == members(source)
    assert any("door" in member for member in members(back))


def test_a_map_of_two_files_states_what_one_of_them_implies(tmp_path: Path) -> None:
    """Merged into one file, the cupboard of the second file would become a member too."""
    source, other = tmp_path / "map.ttl", tmp_path / "other.ttl"
    source.write_text(implied_map(), encoding="utf-8")
    other.write_text(implied_map().replace(":case ", ":shelf ").replace(":handle", ":knob"), encoding="utf-8")
    knowledge = knowledge_base_from(source, other)
    world = knowledge.world()
    back = tmp_path / "back.owl"
    save_map(world, back, source_view=knowledge.source_view())
    assert_worlds_equal(world, knowledge_base_from(back).world())


def test_a_pose_cannot_be_marked_as_set_by_nothing(tmp_path: Path) -> None:
    """`ms:untold` says that a property of a body sets no field; on a pose it is a statement like any other."""
    source, back = tmp_path / "map.ttl", tmp_path / "back.ttl"
    mark = ":cup-pose <http://mindstage.org/ontology#untold> k:translation ."
    source.write_text(room_map(body_turtle("cup"), mark), encoding="utf-8")
    knowledge = knowledge_base_from(source)
    assert knowledge.world().body("cup").pose == Pose((1.0, 2.0, 3.0))
    assert knowledge.findings() == ()
    save_map(knowledge.world(), back, source_view=knowledge.source_view())
    assert_same(back, source)


def test_a_store_folder_gives_the_same_statements_as_the_file(tmp_path: Path) -> None:
    from mindstage.knowledge import KnowledgeBase

    source, back = tmp_path / "map.ttl", tmp_path / "back.ttl"
    source.write_text(implied_map(), encoding="utf-8")
    for load in (True, False):
        with KnowledgeBase(store=tmp_path / "store", bundled_ontology=False) as knowledge:
            if load:
                knowledge.load(source)
            save_map(knowledge.world(), back, source_view=knowledge.source_view())
        assert_same(back, source)
