"""Copies of a running simulation: they start equal, stay apart, and their edits can be made in the original."""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

import mindstage as ms
from mindstage.engines import Capability, Engine, NullEngine
from mindstage.engines.base import Applied, DynamicsScale
from mindstage.engines.mujoco import MujocoEngine
from mindstage.engines.remote.godot import GodotEngine
from mindstage.errors import BodyNotFoundError, CommitError, ImaginationError, SimulationError
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.scene import BodyId, BodyPhysics, Material, Mobility, Pose, diff
from mindstage.scene.edits import Attach, Delete, Edit, SetLabel, SetMaterials, SetPoses, Spawn
from mindstage.simulation import Simulation, SimulationImage
from mindstage.simulation.imagined import match_world
from tests.engines.remote.served_simulation import ServedSimulation
from tests.kitchenette import kitchenette

MUG, DRAWER, FRIDGE, DOOR = BodyId("Mug"), BodyId("Drawer"), BodyId("Fridge"), BodyId("FridgeDoor")


@pytest.fixture
def sim() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        sim.step(0.5)
        yield sim


@pytest.fixture(scope="module")
def kitchen() -> Iterator[Simulation]:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with knowledge, Simulation(knowledge, MujocoEngine()) as sim:
        sim.spawn()
        sim.step(3.0)
        yield sim


class SlowEngine(MujocoEngine):
    """An engine that cannot be forked, as that of another process."""

    name = "slow"
    capabilities = MujocoEngine.capabilities - {Capability.FORK, Capability.SAVE}


def state_bits(sim: Simulation) -> bytes:
    """Everything that a MuJoCo engine will continue from."""

    def read(engine: MujocoEngine) -> bytes:
        compiled = engine._cache.model()
        names = ("qpos", "qvel", "qacc_warmstart", "xpos", "xquat", "tree_asleep", "body_awake", "time")
        return b"".join(np.asarray(getattr(compiled.data, name)).tobytes() for name in names)

    return sim.engine.run(read)


@pytest.mark.parametrize("threaded", [True, False])
def test_everything_works_in_a_copy_and_the_original_stays_bit_for_bit_the_same(
    kitchen: Simulation, threaded: bool
) -> None:
    before, bits = kitchen.snapshot(), state_bits(kitchen)
    worlds, reports, revision = kitchen.worlds, kitchen.reports, kitchen.state.revision
    with kitchen.fork(threaded=threaded) as copy:
        assert state_bits(copy) == bits
        assert (dict(copy.robots), copy.worlds, copy.reports) == ({}, worlds, reports)
        mug = copy.place("CoffeeMug", on="table")
        assert copy.ask("where_is", mug.id)[0].other.endswith("table")
        assert copy.joint("fridge_door").open().arrived
        copy.edits.move(BodyId("chair_1"), Pose((0.0, 0.0, 3.0)))
        copy.step(1.0)
        assert copy.state.poses[copy.state.ids.index(BodyId("chair_1"))][2] < 2.0
        copy.reset()
        assert mug.id not in copy.state.ids
    assert copy.closed
    assert diff(before, kitchen.snapshot()).identical(0.0)
    assert state_bits(kitchen) == bits
    assert (kitchen.worlds, kitchen.reports, kitchen.state.revision) == (worlds, reports, revision)
    with pytest.raises(BodyNotFoundError):
        kitchen.place("CoffeeMug", on=mug.id)


def test_a_copy_continues_exactly_as_its_original(sim: Simulation) -> None:
    with sim.fork() as copy, copy.fork(threaded=False) as copy_of_copy:
        for each in (sim, copy, copy_of_copy):
            each.edits.move(MUG, Pose((0.5, -2.0, 1.0)))
            each.step(1.0)
        assert state_bits(sim) == state_bits(copy) == state_bits(copy_of_copy)


def test_a_copy_can_play_in_real_time_only_with_a_thread(sim: Simulation) -> None:
    with sim.fork(threaded=False) as copy, pytest.raises(SimulationError, match="without a thread"):
        copy.play()
    with sim.fork() as copy:
        copy.play()
        assert copy.state.playing
        assert not sim.state.playing


def test_open_copies_are_listed_until_they_are_closed(sim: Simulation) -> None:
    with sim.fork() as first:
        second = sim.fork()
        assert sim.forks == (first, second)
        assert second.origin is not None
        assert second.origin.original is sim
        second.close()
        second.close()
        assert sim.forks == (first,)
    assert sim.forks == ()
    assert sim.origin is None


class TestCommit:
    def test_the_edits_of_a_copy_are_made_in_the_original(self, sim: Simulation) -> None:
        with sim.fork() as copy:
            copy.edits.move(MUG, Pose((0.5, -2.0, 0.05)))
            copy.edits.set_physics(MUG, BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=7.0), label="mass")
            put = copy.place(copy.make_body("Bowl", size=(0.1, 0.1, 0.05)), on="Fridge")
            copy.step(2.0)
            opened = copy.joint(DOOR).open(0.5)
            time_s = sim.state.time_s
            done = copy.commit()
        assert opened.arrived
        assert done == ("pose of Mug", "mass of Mug", f"{put.id} added", done[-1])
        assert done[-1].startswith("move joint")
        assert sim.snapshot().body(MUG).physics.mass_kg == 7.0
        assert put.id in sim.state.ids
        assert sim.joint(DOOR).openness == pytest.approx(0.5, abs=0.02)
        assert sim.state.time_s < time_s + opened.duration_s + 0.1, "waiting is no edit"

    def test_undone_edits_are_not_made(self, sim: Simulation) -> None:
        before = sim.snapshot()
        with sim.fork() as copy:
            copy.edits.delete([MUG])
            copy.edits.undo()
            copy.edits.move(FRIDGE, Pose((4.0, 4.0, 1.0)))
            copy.edits.undo()
            copy.commit()
        assert diff(before, sim.snapshot()).identical(1e-6)

    @pytest.mark.parametrize(
        ("change", "reason"),
        [
            (lambda sim: sim.edits.move(MUG, Pose((0.5, -2.0, 1.0))), "'Mug' has moved meanwhile"),
            (lambda sim: sim.edits.delete([MUG]), "added or removed meanwhile: Mug"),
            (lambda sim: sim.highlight(MUG, "green"), "edited meanwhile"),
            (lambda sim: sim.close(), "closed"),
        ],
    )
    def test_it_is_refused_if_the_original_has_changed(self, sim: Simulation, change: object, reason: str) -> None:
        with sim.fork() as copy:
            copy.edits.move(DRAWER, copy.snapshot().body(DRAWER).pose)
            change(sim)  # type: ignore[operator]
            with pytest.raises(CommitError, match=reason):
                copy.commit()

    def test_time_that_passed_in_the_original_is_no_change_if_nothing_moved(self, sim: Simulation) -> None:
        sim.step(5.0)
        with sim.fork() as copy:
            copy.edits.set_physics(MUG, BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=3.0), label="mass")
            sim.step(1.0)
            assert len(copy.commit()) == 1

    def test_it_is_refused_without_an_original_and_after_a_reset(self, sim: Simulation) -> None:
        with pytest.raises(CommitError, match="not a copy"):
            sim.commit()
        with sim.fork() as copy:
            copy.reset()
            with pytest.raises(CommitError, match="reset"):
                copy.commit()

    def test_a_copy_of_a_copy_is_reset_to_before_it_was_made(self, sim: Simulation) -> None:
        with sim.fork() as copy:
            copy.edits.move(MUG, Pose((0.5, -2.0, 0.05)))
            copy.mark_start()
            with copy.fork() as copy_of_copy:
                copy_of_copy.reset()
                with pytest.raises(CommitError, match="the copy was reset to a state before it was made"):
                    copy_of_copy.commit()
            assert len(copy.commit()) == 1

    def test_an_impossible_edit_is_refused_with_all_others(self, sim: Simulation) -> None:
        bits, before = state_bits(sim), sim.snapshot()
        apply = sim.engine.run(lambda engine: engine.apply)

        def refuse(edit: Edit) -> Applied:
            if isinstance(edit, SetPoses) and FRIDGE in edit.ids:
                raise BodyNotFoundError("Fridge", known=[])
            return apply(edit)

        with sim.fork() as copy:
            copy.edits.set_physics(MUG, BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=7.0), label="mass")
            copy.edits.move(MUG, Pose((0.5, -2.0, 0.05)))
            put = copy.place("CoffeeMaker", on="Fridge")
            copy.joint(DOOR).open(0.3)
            copy.edits.move(FRIDGE, Pose((4.0, 4.0, 1.0)))
            sim.engine.run(lambda engine: setattr(engine, "apply", refuse))
            with pytest.raises(CommitError, match=r"pose of Fridge: no body .* \(nothing was done\)"):
                copy.commit()
        assert put.id not in sim.state.ids
        assert diff(before, sim.snapshot()).identical(0.0)
        assert state_bits(sim) == bits

    def test_an_error_names_what_an_engine_without_saved_states_cannot_undo(self) -> None:
        with Simulation(KnowledgeBase(), SlowEngine()) as sim:
            sim.spawn(kitchenette())
            with sim.fork() as copy:
                copy.joint("Drawer").open(0.3)
                copy.edits.move(MUG, Pose((0.5, -2.0, 1.0)))
                copy.step(1.0)
                copy.edits.attach("Fridge", "Mug")
                with pytest.raises(CommitError, match=r"\(what cannot be undone was: .*Drawer.*\)"):
                    copy.commit()

    def test_what_time_has_moved_in_the_copy_is_not_attached_elsewhere(self, sim: Simulation) -> None:
        before = sim.snapshot()
        with sim.fork() as copy:
            copy.edits.move(MUG, Pose((0.5, -2.0, 1.0)))
            copy.step(1.0)
            copy.edits.attach("Fridge", "Mug")
            with pytest.raises(CommitError, match="Mug attached to Fridge: 'Mug' is not where it was in the copy"):
                copy.commit()
        assert diff(before, sim.snapshot()).identical(0.0)

    def test_a_joint_that_does_not_get_there_again_is_refused(self, sim: Simulation) -> None:
        """In the copy, what is in the way has been pushed aside by time and forces, which are not repeated."""
        sim.joint(DOOR).open(0.6)
        with sim.fork() as copy:
            stopped = copy.joint(DOOR).move_to(0.0, timeout_s=0.3)
            assert not stopped.arrived
            with pytest.raises(CommitError, match="it comes to another position than in the copy"):
                copy.commit()
        assert sim.joint(DOOR).openness == pytest.approx(0.6, abs=0.02)

    def test_scaled_masses_are_refused(self, sim: Simulation) -> None:
        with sim.fork() as copy:
            copy.engine.run(lambda engine: engine.scale_dynamics({MUG: DynamicsScale(mass=2.0)}), edits=True)
            copy.edits.move(MUG, Pose((0.5, -2.0, 0.05)))
            with pytest.raises(CommitError, match="masses or frictions were scaled"):
                copy.commit()


def test_an_engine_that_cannot_be_forked_is_copied_to_mujoco_from_its_snapshot() -> None:
    with Simulation(KnowledgeBase(), SlowEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        sim.step(0.5)
        assert sim.joint(DOOR).open(0.5)
        sim.edits.move(MUG, Pose((0.5, -2.0, 0.05)))
        sim.edits.attach("Fridge", "Mug")
        sim.edits.set_physics(DRAWER, BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=9.0), label="mass")
        before = sim.snapshot()
        with sim.fork() as copy:
            assert copy.engine.name == "mujoco"
            assert copy.origin is not None
            assert "slow cannot be forked" in copy.origin.notes[0]
            assert len(copy.origin.notes) == 1
            assert diff(before, copy.snapshot()).identical(1e-4)
            assert copy.joint(DOOR).openness == pytest.approx(0.5, abs=0.02)
            assert copy.joint(DOOR).close().arrived
        assert diff(before, sim.snapshot()).identical(0.0)


def test_a_running_godot_world_is_imagined_in_mujoco(godot: Path) -> None:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with knowledge, Simulation(knowledge, GodotEngine(godot, timeout_s=60.0)) as sim:
        sim.spawn()
        sim.step(0.5)
        assert sim.joint("fridge_door").open(0.5).arrived
        before = sim.snapshot()
        with sim.fork() as copy:
            assert copy.origin is not None
            assert "godot cannot be forked" in copy.origin.notes[0]
            found = diff(before, copy.snapshot())
            assert found.identical(1e-4), found
            assert copy.joint("fridge_door").openness == pytest.approx(0.5, abs=0.02)
            mug = copy.place("CoffeeMug", on="table")
            assert copy.joint("fridge_door").close().arrived
            assert diff(before, sim.snapshot()).identical(0.0)
            sim.step(0.1)
        with sim.fork() as copy:
            copy.edits.delete([BodyId("chair_1")])
            copy.commit()
        assert BodyId("chair_1") not in sim.state.ids
        assert mug.id not in sim.state.ids


def test_a_remote_world_is_imagined_in_mujoco() -> None:
    with ServedSimulation() as served:
        served.simulation.spawn(kitchenette())
        with ms.connect(served.address) as sim:
            before = sim.snapshot()
            with sim.fork() as copy:
                assert copy.origin is not None
                assert "cannot be forked" in copy.origin.notes[0]
                assert diff(before, copy.snapshot()).identical(1e-4)
                copy.edits.delete([MUG])
                assert MUG in served.simulation.state.ids
                copy.commit()
            assert MUG not in served.simulation.state.ids


class TestImages:
    def test_each_restored_simulation_is_equal_and_independent(self, kitchen: Simulation) -> None:
        bits = state_bits(kitchen)
        image = SimulationImage.capture(kitchen)
        first, second = image.restore(), image.restore(threaded=True)
        assert state_bits(first) == state_bits(second) == bits
        first.step(1.0)
        first.edits.delete([BodyId("chair_1")])
        assert state_bits(second) == state_bits(image.restore()) == bits
        second.close()

    def test_a_pickled_image_gives_an_equal_simulation_in_another_process(
        self, kitchen: Simulation, tmp_path: Path
    ) -> None:
        """The other process steps, places and asks, and comes to the same bits and answers."""
        kitchen.knowledge.tell("milk_carton_1", "rdfs:comment", "is sour")
        image = SimulationImage.capture(kitchen)
        (tmp_path / "image").write_bytes(pickle.dumps(image))
        program = (
            "import pickle, pathlib, sys\n"
            "from tests.simulation.test_imagine import what_happens\n"
            "image = pickle.loads(pathlib.Path(sys.argv[1], 'image').read_bytes())\n"
            "result = image.key, what_happens(image.restore())\n"
            "pathlib.Path(sys.argv[1], 'result').write_bytes(pickle.dumps(result))\n"
        )
        subprocess.run([sys.executable, "-c", program, str(tmp_path)], check=True, timeout=120)
        key, there = pickle.loads((tmp_path / "result").read_bytes())
        assert key == image.key
        assert there == what_happens(image.restore())
        assert "sour" in str(there[2])

    def test_what_cannot_be_pickled_is_named(self, sim: Simulation) -> None:
        image = SimulationImage.capture(sim)
        image.restore().knowledge._mesh_bounds = lambda name: None  # type: ignore[assignment]
        with pytest.raises(ImaginationError, match="cannot be copied to another process"):
            pickle.dumps(image)
        with pytest.raises(TypeError, match="threaded=False"):
            pickle.dumps(sim)

    def test_engines_without_physics_have_images(self) -> None:
        with Simulation(KnowledgeBase(bundled_ontology=False), NullEngine(), primitive_shapes=True) as sim:
            sim.spawn(kitchenette())
            image = pickle.loads(pickle.dumps(SimulationImage.capture(sim)))
            assert diff(sim.snapshot(), image.restore().snapshot()).identical(0.0)


def what_happens(sim: Simulation) -> tuple[bytes, list[str], list[str], tuple[object, ...]]:
    """What can be observed in the copy of the bundled kitchen after some edits and a second."""
    sim.place("CoffeeMug", on="table")
    sim.edits.move(BodyId("chair_1"), Pose((0.0, 0.0, 3.0)))
    sim.step(1.0)
    answers = [*sim.ask("where_is", "chair_1"), *sim.ask("storage_place_in_environment", "Milk")]
    milk = sim.snapshot().body(BodyId("milk_carton_1")).iri
    told = [str(fact) for fact in sim.knowledge.facts_of(milk, runtime_only=True)]
    return state_bits(sim), list(map(str, answers)), told, sim.knowledge.findings()


# -- the same state in another engine ----------------------------------------------------------------------------------

STEEL = Material(name="steel", color=(0.5, 0.5, 0.6))


def edited(sim: Simulation) -> None:
    """Edits of every kind."""
    sim.edits.move(MUG, Pose((0.5, -2.0, 0.3), (0.0, 0.0, 0.0, 1.0)))
    sim.joint(DRAWER).move_to(-0.2)
    sim.edits.detach("FridgeHandle")
    sim.edits.attach("Drawer", "Mug")
    sim.edits.set_physics(DRAWER, BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=9.0), label="mass")

    def label_and_paint(engine: Engine) -> None:
        engine.apply(SetLabel(MUG, "My mug"))
        engine.apply(SetMaterials(MUG, (STEEL,)))

    sim.engine.run(label_and_paint, edits=True)


@pytest.mark.parametrize("engine", [NullEngine, MujocoEngine])
def test_every_kind_of_edit_of_a_copy_is_made_in_the_original(engine: type[Engine]) -> None:
    with Simulation(KnowledgeBase(), engine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        with sim.fork() as copy:
            edited(copy)
            copy.edits.delete([BodyId("FridgeHandle")])
            done = copy.commit()
            assert diff(copy.snapshot(), sim.snapshot()).identical(1e-3)
        assert "FridgeHandle detached" in done
        assert "Mug attached to Drawer" in done
        assert done[-3:] == ("label of Mug", "materials of Mug", "FridgeHandle deleted")
        mug = sim.snapshot().body(MUG)
        assert (mug.label, mug.materials) == ("My mug", (STEEL,))
        with sim.fork() as copy:
            copy.engine.run(lambda engine: engine.clear(), edits=True)
            assert copy.commit() == ("clear world",)
        assert sim.state.ids == ()


@pytest.mark.parametrize("engine", [NullEngine, MujocoEngine])
def test_an_engine_is_given_the_state_of_another_world(engine: type[Engine]) -> None:
    with Simulation(KnowledgeBase(), NullEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        edited(sim)
        present, worlds = sim.snapshot(), sim.worlds
    other = engine()
    other.apply(Spawn(kitchenette()))
    other.apply(Attach(BodyId("Cupboard"), MUG))
    assert match_world(other, present, worlds=worlds) == ()
    assert diff(present, other.snapshot()).identical(1e-6)
    other.apply(Delete((MUG,)))
    assert match_world(other, present, worlds=worlds) == ("'Mug' is not in the copy: it cannot be spawned",)
    other.close()


@pytest.mark.parametrize(("position", "expected"), [(-0.455, -0.45), (0.004, 0.0), (-0.3, -0.3)])
def test_a_joint_that_physics_had_pushed_beyond_its_limit_is_at_the_limit(position: float, expected: float) -> None:
    world = kitchenette()
    moved = Pose((1.95 + position, 0.0, 0.65))
    present = replace(world, bodies=tuple(replace(b, pose=moved) if b.id == DRAWER else b for b in world.bodies))
    engine = MujocoEngine()
    engine.apply(Spawn(world))
    assert match_world(engine, present, worlds=[world]) == ()
    assert engine.snapshot().body(DRAWER).pose.position[0] == pytest.approx(1.95 + expected, abs=2e-3)
    far = Pose((1.95 - 0.9, 0.0, 0.65))
    present = replace(world, bodies=tuple(replace(b, pose=far) if b.id == DRAWER else b for b in world.bodies))
    (note,) = match_world(engine, present, worlds=[world])
    assert note.startswith("'Drawer' has another pose in the copy: ")
    engine.close()
