"""Worlds that cannot be written are refused with a message that names the problem."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest
from msgspec.structs import replace

from mindstage.errors import MapWriteError
from mindstage.maps import MapFormat, save_map, write_map
from mindstage.scene import Attachment, BodyId, BodyPhysics, Iri, IriRef, Literal, Pose, PropertyAssertion
from tests.cases import each_case
from tests.kitchenette import kitchenette
from tests.maps.small_maps import individual, knowledge_base_from
from tests.maps.test_round_trip import CUP, TABLE, world_of

A = BodyId("a")
REFUSED = {
    "two entities with one id": (world_of(CUP, replace(TABLE, id=CUP.id)), "'cup'"),
    "two entities with one name": (world_of(CUP, replace(TABLE, iri=CUP.iri)), "'table'.*'cup'"),
    "an entity with the name of the map": (world_of(replace(CUP, iri=individual("room"))), "'cup'.*map"),
    "a missing child": (world_of(CUP, attachments=(Attachment(parent=CUP.id, child=A),)), "'a'"),
    "an endless mass": (world_of(replace(CUP, physics=BodyPhysics(mass_kg=float("inf")))), "inf.*mass"),
    "a negative mass": (world_of(replace(CUP, physics=BodyPhysics(mass_kg=-1.0))), "-1.0.*mass"),
    "an invalid pose": (world_of(replace(CUP, pose=Pose((float("nan"), 0.0, 0.0)))), "nan.*translation"),
    "no rotation": (world_of(replace(CUP, pose=Pose(quaternion=(0.0, 0.0, 0.0, 0.0)))), "quaternion"),
    "a name with a blank": (world_of(replace(CUP, iri=Iri("http://e/a cup"))), "a cup"),
    "a class that is no name": (world_of(replace(CUP, cls=Iri("Cup"))), "<Cup>"),
    "a language that is none": (
        world_of(facts=(PropertyAssertion(individual("a"), Literal("x", language="x y")),)),
        "'x y'",
    ),
    "a property without name": (world_of(facts=(PropertyAssertion(Iri("_:a"), Literal("x")),)), "_:a"),
}


@each_case("format", MapFormat)
@each_case("name", REFUSED)
def test_an_invalid_world_is_refused(name: str, format: MapFormat) -> None:
    world, message = REFUSED[name]
    with pytest.raises(MapWriteError, match=message):
        write_map(world, format=format)


ONLY_TURTLE = {
    "a property that ends in digits": (PropertyAssertion(Iri("http://e/123"), Literal("x")), "http://e/123"),
    "a property that ends in nothing": (PropertyAssertion(Iri("http://e/#"), Literal("x")), "http://e/#"),
    "a property that RDF/XML needs itself": (
        PropertyAssertion(Iri("http://www.w3.org/1999/02/22-rdf-syntax-ns#about"), IriRef(individual("a"))),
        "about",
    ),
    "a property of XML itself": (PropertyAssertion(Iri("http://www.w3.org/2000/xmlns/a"), Literal("x")), "xmlns"),
    "a letter that XML forbids": (PropertyAssertion(individual("a"), Literal("bell: \x07")), "U\\+0007"),
}


@pytest.mark.parametrize("name", ONLY_TURTLE)
def test_turtle_is_recommended_if_xml_cannot_express_a_name(name: str, tmp_path: Path) -> None:
    fact, message = ONLY_TURTLE[name]
    world = world_of(facts=(fact,))
    with pytest.raises(MapWriteError, match=f"{message}.*Turtle"):
        write_map(world)
    save_map(world, tmp_path / "map.ttl")
    assert knowledge_base_from(tmp_path / "map.ttl").world() == world


@pytest.mark.parametrize("suffix", [".owl", ".rdf", ".xml", ".ttl", ".OWL"])
def test_the_suffix_selects_the_format(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"map{suffix}"
    save_map(kitchenette(), path)
    assert path.read_text(encoding="utf-8").startswith("@prefix" if suffix == ".ttl" else "<?xml")
    assert knowledge_base_from(path).world().bodies == kitchenette().bodies


def test_another_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MapWriteError, match=r"\.docx.*\.owl"):
        save_map(kitchenette(), tmp_path / "map.docx")


def test_a_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MapWriteError, match="No such file"):
        save_map(kitchenette(), tmp_path / "nowhere" / "map.owl")


def test_a_folder_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "map.owl").mkdir()
    with pytest.raises(MapWriteError, match="directory"):
        save_map(kitchenette(), tmp_path / "map.owl")
    assert os.listdir(tmp_path) == ["map.owl"]


def test_a_lone_surrogate_is_refused_and_leaves_nothing_behind(tmp_path: Path) -> None:
    path = tmp_path / "map.ttl"
    path.write_text("before", encoding="utf-8")
    with pytest.raises(MapWriteError, match=r"U\+D800"):
        save_map(world_of(facts=(PropertyAssertion(individual("a"), Literal("\ud800")),)), path)
    assert os.listdir(tmp_path) == ["map.ttl"]
    assert path.read_text(encoding="utf-8") == "before"


def test_a_file_is_replaced_with_default_permissions(tmp_path: Path) -> None:
    path, usual = tmp_path / "map.owl", tmp_path / "usual"
    usual.touch()
    path.write_text("before", encoding="utf-8")
    save_map(kitchenette(), path)
    assert knowledge_base_from(path).world().bodies == kitchenette().bodies
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE(usual.stat().st_mode)


@pytest.mark.parametrize("suffix", [".owl", ".ttl"])
def test_a_name_cannot_end_its_comment(suffix: str, tmp_path: Path) -> None:
    world = world_of(
        replace(CUP, iri=individual("--"), id=BodyId("--")), name="--><evil/>\n<http://e#a> a <http://e#b> .\n<!--"
    )
    save_map(world, tmp_path / f"map{suffix}")
    assert knowledge_base_from(tmp_path / f"map{suffix}").world() == world
