"""Ten lines of Turtle define a class with the shape of a drawer, which works in simulation with a mug in it."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from mindstage.engines import Engine, SpawnNoteKind
from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import (
    AxisMotion,
    Body,
    BodyId,
    BodyPhysics,
    Iri,
    Joint,
    LinearLimits,
    Mobility,
    Pose,
    Vector,
    World,
)
from mindstage.simulation import Simulation
from tests.kitchenette import KNOWROB

MY = "http://example.org/my#"
GUIDE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "furnishing.md"
TEN_LINES = GUIDE.read_text(encoding="utf-8").split("```turtle\n")[1].split("```")[0]


@pytest.fixture
def knowledge(tmp_path: Path) -> KnowledgeBase:
    assert len(TEN_LINES.strip().splitlines()) <= 10
    (tmp_path / "mine.ttl").write_text(TEN_LINES, encoding="utf-8")
    knowledge = KnowledgeBase()
    knowledge.load([], ontologies=tmp_path / "mine.ttl")
    return knowledge


def body(id: str, cls: str, at: Vector, size: Vector, mobility: Mobility, mass: float | None = None) -> Body:
    physics = BodyPhysics(mobility=mobility, mass_kg=mass)
    return Body(id=BodyId(id), iri=Iri(MY + id), cls=Iri(cls), pose=Pose(at), size=size, physics=physics)


def scene() -> World:
    """A cupboard with one pullout, which opens along x and contains a mug."""
    limits = LinearLimits(x=AxisMotion.LIMITED, limit=0.2, x_middle=0.2)
    slide = Joint(
        id=BodyId("slide"),
        iri=Iri(MY + "slide"),
        parent=BodyId("cupboard"),
        child=BodyId("pullout"),
        pose=Pose((0.04, 0, 0.4)),
        linear=limits,
    )
    return World(
        iri=Iri(MY + "map"),
        bodies=(
            body("cupboard", KNOWROB + "Cupboard", (0, 0, 0.4), (0.6, 0.6, 0.4), Mobility.STATIC),
            body("pullout", MY + "Pullout", (0.04, 0, 0.4), (0.5, 0.56, 0.2), Mobility.DYNAMIC, 4.0),
            body("mug", KNOWROB + "DrinkingMug", (0.04, 0, 0.365), (0.08, 0.08, 0.1), Mobility.DYNAMIC, 0.3),
        ),
        joints=(slide,),
    )


def test_ten_lines_of_turtle_define_a_working_drawer(knowledge: KnowledgeBase) -> None:
    with Simulation(knowledge, MujocoEngine()) as simulation:
        report = simulation.spawn(scene())
        assert simulation.geometry[BodyId("pullout")].shape_name == "drawer"
        assert simulation.geometry[BodyId("pullout")].reason.startswith("Pullout is shaped as ms:DrawerForm")
        assert [note for note in report.notes if note.kind is SpawnNoteKind.OVERLAP] == []
        start = positions(simulation)
        for force, reached in ((6.0, 0.4), (-6.0, 0.0)):
            for _ in range(80):
                simulation.engine.run(partial(push, force=force))
                simulation.step(0.05)
            moved = positions(simulation) - start
            assert moved[1, 0] == pytest.approx(reached, abs=0.01)
            assert np.all(np.abs(moved[2] - moved[1]) < (0.24, 0.27, 0.02)), "the mug is in the drawer, upright"
        assert float(np.abs(positions(simulation)[0] - start[0]).max()) == 0.0


def push(engine: Engine, force: float) -> None:
    engine.apply_force(BodyId("pullout"), (force, 0.0, 0.0))


def positions(simulation: Simulation) -> np.ndarray:
    """Returns the positions of cupboard, pullout and mug."""
    snapshot = simulation.state
    rows = [snapshot.ids.index(BodyId(id)) for id in ("cupboard", "pullout", "mug")]
    return snapshot.poses[rows, :3].copy()
