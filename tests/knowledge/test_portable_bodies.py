"""Bodies whose map does not give their mobility: what people carry is loose if it stands on something."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest
import rdflib

from mindstage.api import load_knowledge
from mindstage.cli.options import MapReading
from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import UnitConventions, UnstatedMobility
from mindstage.maps.io.write import MapDialect, save_map, write_map
from mindstage.scene import Attachment, Body, BodyId, BodyPhysics, Iri, Mobility, Pose, Vector, World, diff
from mindstage.scene.edits import SetPhysics
from mindstage.simulation import Simulation
from tests.kitchenette import KNOWROB, MAP


def body(id: str, cls: str, position: Vector, size: Vector | None, mobility: Mobility | None = None) -> Body:
    return Body(
        id=BodyId(id),
        iri=Iri(MAP + id),
        cls=Iri(KNOWROB + cls),
        pose=Pose(position),
        size=size,
        physics=BodyPhysics(mobility=mobility),
    )


TABLE = body("table", "Table-PieceOfFurniture", (0.0, 0.0, 0.35), (1.0, 1.0, 0.7))
CUP_SIZE = (0.08, 0.08, 0.1)


def cup(id: str, x: float, bottom: float, cls: str = "Cup", mobility: Mobility | None = None) -> Body:
    return body(id, cls, (x, 0.0, bottom + CUP_SIZE[2] / 2), CUP_SIZE, mobility)


def read(
    tmp_path: Path, *bodies: Body, attached: str = "", conventions: UnitConventions | None = None
) -> KnowledgeBase:
    links = (Attachment(parent=BodyId("table"), child=BodyId(attached)),) if attached else ()
    path = tmp_path / "map.owl"
    path.write_text(write_map(World(iri=Iri(MAP + "map"), bodies=bodies, attachments=links)), encoding="utf-8")
    return load_knowledge([path], conventions=conventions)


def mobilities(knowledge: KnowledgeBase) -> dict[str, Mobility | None]:
    return {each.id: each.physics.mobility for each in knowledge.world().bodies}


def test_what_people_carry_is_loose_if_it_stands_on_something(tmp_path: Path) -> None:
    knowledge = read(
        tmp_path,
        TABLE,
        cup("near", 0.0, 0.719),
        cup("sunk", 0.2, 0.681),
        cup("hanging", -0.2, 0.721),
        cup("deep", 0.4, 0.679),
        cup("beside", 0.6, 0.7),
        cup("inside", -0.4, 0.01),
        cup("stacked", 0.0, 0.82),
        cup("held", 0.3, 0.7, mobility=Mobility.STATIC),
        cup("stool", 0.1, 0.7, "Cupboard"),
    )
    loose = {"near", "sunk", "inside", "stacked"}
    found = mobilities(knowledge)
    assert {id for id, each in found.items() if each is Mobility.DYNAMIC} == loose
    assert (found["held"], found["stool"], found["hanging"]) == (Mobility.STATIC, None, None)
    reported = {each.individual for each in knowledge.findings() if "nothing is within 20 mm below it" in each.problem}
    assert reported == {MAP + id for id in ("hanging", "deep", "beside")}
    (assumption,) = (each for each in knowledge.assumptions() if each.topic == "mobility of portable bodies")
    assert "4 bodies near, sunk, inside, stacked" in assumption.evidence


def test_what_is_on_the_boards_of_a_shelf_is_loose(tmp_path: Path) -> None:
    """A map has the shelf as one box; its boards get where the things stand."""
    shelf = body("shelf", "Bookshelf", (0.0, 0.0, 0.9), (1.0, 0.4, 1.8))
    knowledge = read(tmp_path, shelf, cup("on_a_board", 0.1, 0.5), cup("in_front", 0.7, 0.5))
    found = mobilities(knowledge)
    assert (found["on_a_board"], found["in_front"]) == (Mobility.DYNAMIC, None)


def test_what_is_in_a_cupboard_is_loose_at_any_height_and_in_a_drawer_on_its_bottom_board(tmp_path: Path) -> None:
    knowledge = read(
        tmp_path,
        body("cupboard", "Cupboard", (0.0, 0.0, 1.0), (0.6, 0.5, 2.0)),
        body("drawer", "Drawer", (2.0, 0.0, 0.5), (0.5, 0.5, 0.15)),
        body("block", "Wall", (4.0, 0.0, 1.0), (0.6, 0.5, 2.0)),
        cup("shelved", 0.0, 1.2),
        cup("half", 0.3, 1.2),
        cup("in_drawer", 2.0, 0.425 + 0.03),
        cup("walled", 4.0, 1.2),
    )
    found = mobilities(knowledge)
    assert {id for id, each in found.items() if each is Mobility.DYNAMIC} == {"shelved", "in_drawer"}
    reported = {each.individual for each in knowledge.findings() if "nothing is within 20 mm below it" in each.problem}
    assert reported == {MAP + id for id in ("half", "walled")}


def test_an_attached_cup_stays_with_its_parent(tmp_path: Path) -> None:
    assert mobilities(read(tmp_path, TABLE, cup("cup", 0.0, 0.7), attached="cup"))["cup"] is None


def test_a_mobility_that_is_assumed_is_marked_and_not_written_as_stated(tmp_path: Path) -> None:
    knowledge = read(tmp_path, TABLE, cup("cup", 0.0, 0.7), cup("stated", 0.3, 0.7, mobility=Mobility.DYNAMIC))
    world = knowledge.world()
    assert [world.body(id).physics.assumed for id in ("table", "cup", "stated")] == [(), ("mobility",), ()]
    for dialect in ("semlog", "soma"):
        path = tmp_path / f"{dialect}.owl"
        save_map(world, path, dialect=MapDialect(dialect))
        graph = rdflib.Graph().parse(path, format="xml")
        stated = {str(subject) for subject, _ in graph.subject_objects(rdflib.URIRef(KNOWROB + "mobility"))}
        assert stated == {MAP + "stated"}
        assert diff(world, load_knowledge([path]).world()).identical(0.0)
    (row,) = answers = knowledge.ask("what_is", individual="cup")
    assert (row.mobility, row.assumed) == ("dynamic", ("mobility",))
    assert "no map states the mobility of cup: it is assumed" in list(knowledge.explain(answers.question, row))
    changed = SetPhysics(BodyId("cup"), BodyPhysics(mobility=Mobility.DYNAMIC)).changed(world.body("cup"))
    assert changed.physics.stated_mobility is Mobility.DYNAMIC


@pytest.mark.parametrize("option", [None, "static", "by-class"])
def test_an_option_restores_the_former_reading(tmp_path: Path, option: str | None) -> None:
    (conventions,) = MapReading(mobility=[option] if option else None).conventions(["map"])
    assert conventions.mobility == (UnstatedMobility(option) if option else None)
    knowledge = read(tmp_path, TABLE, cup("cup", 0.0, 0.7), cup("hanging", 0.2, 1.0), conventions=conventions)
    assert mobilities(knowledge)["cup"] is (None if option == "static" else Mobility.DYNAMIC)
    assert any("nothing is within" in each.problem for each in knowledge.findings()) is (option != "static")


def test_a_cup_without_a_size_has_that_of_its_class(tmp_path: Path) -> None:
    standing = body("standing", "Cup", (0.0, 0.0, 0.735), None)
    assert mobilities(read(tmp_path, TABLE, standing))["standing"] is Mobility.DYNAMIC


def test_the_cup_can_be_pushed_off_and_comes_back_in_the_map(tmp_path: Path) -> None:
    knowledge = read(tmp_path, TABLE, cup("cup", 0.45, 0.7), cup("hanging", 0.0, 1.5))
    with closing(Simulation(knowledge, MujocoEngine(), threaded=False)) as simulation:
        simulation.spawn()
        assert diff(knowledge.world(), simulation.snapshot()).identical(0.0)
        simulation.step(0.5)
        simulation.engine.run(lambda engine: engine.apply_force(BodyId("cup"), (5.0, 0.0, 0.0)))
        simulation.step(0.2)
        simulation.step(1.5)
        heights = dict(zip(simulation.state.ids, simulation.state.poses[:, 2].tolist(), strict=True))
        assert heights["cup"] < 0.1
        assert heights["hanging"] == pytest.approx(1.55)
        (tmp_path / "saved.owl").write_text(write_map(simulation.snapshot()), encoding="utf-8")
        assert diff(simulation.snapshot(), load_knowledge([tmp_path / "saved.owl"]).world()).identical(1e-6)
