"""Questions about other times: every question at a time answers what the live simulation answered then."""

from __future__ import annotations

import random
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mindstage.engines import make_engine
from mindstage.engines.base import Contact
from mindstage.episodes import EpisodeFrame, FrameRecording, Recorder
from mindstage.episodes.episode import Episode
from mindstage.episodes.episode_questions import HeldRelation
from mindstage.errors import EpisodeError, EpisodeTimeError, InvalidArgumentError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries.spatial import OpenState
from mindstage.knowledge.questions import Answers, Question, list_questions
from mindstage.maps import write_map
from mindstage.scene import BodyId, Pose
from mindstage.scene.edits import Attach, Detach, SetPoses
from mindstage.scene.spatial import SpatialRelation
from mindstage.scene.transforms import pose_array
from mindstage.simulation import Simulation
from tests.cases import each_case
from tests.kitchenette import MAP, kitchenette

TIMES_S = (0.0, 0.5, 1.0, 1.5)
ARGUMENTS: dict[str, dict[str, object]] = {
    "distance": {"thing": "Mug", "other": "Fridge"},
    "nearest": {"thing": "Mug", "count": 3},
    "path": {"start": "Cupboard", "goal": "Fridge"},
    "reachable": {"start": "Cupboard"},
    "visible_from": {"viewer": "Mug"},
    "is_between": {"one": "Mug", "other": "Fridge"},
    "free_place": {"support": "Cupboard", "cls": "Cup"},
    "fits": {"thing": "Mug"},
    "similar_to": {"thing": "DrawerHandle"},
    "direction_of": {"thing": "Mug"},
    "larger_than": {"thing": "Fridge"},
    "can_open": {"thing": "Drawer"},
    "reachable_by_pull": {"handle": "DrawerHandle"},
    "would_spill": {"vessel": "Mug", "tilt_deg": 85},
    "stays": {"thing": "Mug", "for_s": 0.3},
    "fits_now": {"thing": "Mug", "place": "Cupboard"},
    "would_tip": {"thing": "Mug", "push_n": 8.0, "height_m": 0.09},
    "what_if": {"edit": "open Drawer", "question": "where_is Mug", "wait_s": 0.1},
}
"""Arguments of the questions that have no answers, or very many, without them."""


@dataclass
class Run:
    """A recorded simulation, and what it answered while it ran."""

    recording: FrameRecording
    knowledge: KnowledgeBase
    live: dict[tuple[str, float], Answers[Any]]
    file: Path | None = None
    """The same episode as a file."""
    file_times: dict[float, float] = field(default_factory=dict)
    """The time in the file, for each time of `live`."""


def frame_of(simulation: Simulation, time_s: float) -> EpisodeFrame:
    """The present state as a frame."""
    state = simulation.current_state()
    snapshot = simulation.state
    return EpisodeFrame(
        time_s=time_s,
        structure=state.world,
        ids=snapshot.ids,
        poses=snapshot.poses.copy(),
        joint_positions=state.joint_positions,
        contacts=simulation.engine.run(lambda engine: engine.contacts()),
    )


def knowledge_of_kitchenette(folder: Any) -> KnowledgeBase:
    """A knowledge base with the kitchenette as its map."""
    path = folder / "kitchenette.owl"
    path.write_text(write_map(kitchenette()))
    knowledge = KnowledgeBase()
    knowledge.load(path)
    return knowledge


def state_questions(*, imagines: bool) -> list[Question[Any]]:
    """All questions that look at the present."""
    return [each for each in list_questions() if each.uses_current_state and each.imagines is imagines]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """The drawer is pulled out, the mug is moved onto the fridge, and everything is asked at some times."""
    folder = tmp_path_factory.mktemp("map")
    knowledge = knowledge_of_kitchenette(folder)
    live = {}
    frames = []
    times = {}
    with Simulation(knowledge, make_engine("mujoco")) as simulation:
        simulation.spawn()
        recorder = Recorder(simulation, folder / "file.mcap", rate_hz=120.0)
        for step in range(46):
            time_s = step / 30
            if step == 10:
                simulation.pull(BodyId("Drawer"), point=(0.0, 0.0, 0.0), target=(1.0, 0.0, 0.65))
            if step == 25:
                simulation.release()
                pose = Pose((2.0, 1.0, 1.9))
                simulation.engine.run(
                    lambda engine, pose=pose: engine.apply(SetPoses({BodyId("Mug"): pose})), edits=True
                )
            if time_s in TIMES_S:
                times[time_s] = recorder.time_s
                for question in state_questions(imagines=False):
                    live[question.name, time_s] = simulation.ask(question, **ARGUMENTS.get(question.name, {}))
            frames.append(frame_of(simulation, time_s))
            simulation.step(1 / 30)
        recorder.stop()
        recording = FrameRecording(
            frames, name="run", geometry=simulation.geometry, spawned=simulation.worlds, source="mujoco"
        )
    knowledge.add_episode(recording)
    yield Run(recording, knowledge, live, folder / "file.mcap", times)
    knowledge.close()


@pytest.fixture(scope="module")
def file_knowledge(run: Run) -> Iterator[KnowledgeBase]:
    """What the file of the same episode contains."""
    assert run.file is not None
    with Episode(run.file) as episode, episode.knowledge() as knowledge:
        knowledge.add_episode(episode)
        yield knowledge


def plain(answers: Answers[Any]) -> list[dict[str, Any]]:
    """Rows with numbers that may differ in the last digits."""
    return [rounded(msgspec.to_builtins(row)) for row in answers]


def rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 8) + 0.0
    if isinstance(value, dict):
        return {name: rounded(each) for name, each in value.items()}
    return [rounded(each) for each in value] if isinstance(value, list | tuple) else value


@each_case("question", state_questions(imagines=False), ids=lambda each: each.name)
def test_a_question_at_a_time_answers_what_the_live_simulation_answered_then(run: Run, question: Question[Any]) -> None:
    for time_s in TIMES_S:
        now = run.live[question.name, time_s]
        then = run.knowledge.ask(question, **ARGUMENTS.get(question.name, {}), at=time_s)
        assert plain(then) == plain(now)
        assert [each.reason for each in then.missing] == [each.reason for each in now.missing]


@each_case("question", state_questions(imagines=False), ids=lambda each: each.name)
def test_a_question_about_a_file_answers_what_the_live_simulation_answered(
    run: Run, file_knowledge: KnowledgeBase, question: Question[Any]
) -> None:
    for time_s in TIMES_S:
        now = run.live[question.name, time_s]
        then = file_knowledge.ask(question, **ARGUMENTS.get(question.name, {}), at=run.file_times[time_s])
        assert plain(then) == plain(now)


def test_the_questions_have_answers_to_compare_and_they_change(run: Run) -> None:
    empty = {
        each.name
        for each in state_questions(imagines=False)
        if not any(run.live[each.name, time_s] for time_s in TIMES_S)
    }
    assert empty <= {"in_room", "in_words", "misplaced", "is_between", "can", "missing_for_action"}
    for name in ("where_is", "pose_of", "articulated_parts", "distance"):
        assert plain(run.live[name, 0.0]) != plain(run.live[name, 1.5]), name


@each_case("question", state_questions(imagines=True), ids=lambda each: each.name)
def test_a_question_that_imagines_continues_from_that_time(run: Run, question: Question[Any]) -> None:
    answers = run.knowledge.ask(question, **ARGUMENTS[question.name], at=0.0)
    assert answers
    assert all("continued at 0 s of run" in row.source for row in answers)


def test_what_is_imagined_depends_on_the_time(run: Run) -> None:
    asked = {"edit": "wait", "question": "where_is Mug on", "wait_s": 0.1}
    places = []
    for time_s in (0.0, 1.5):
        (row,) = run.knowledge.ask(
            "what_if",
            edit='[{"do": "wait", "duration_s": 0.1}]',
            **{name: asked[name] for name in ("question", "wait_s")},
            at=time_s,
        )
        places.append({field.name: field.value for field in row.answer}["other"])
    assert [place.rpartition("#")[2] for place in places] == ["Cupboard", "Fridge"]


# -- intervals -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def random_run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """Things are put at random places, 40 times, and some bodies are attached, deleted and spawned."""
    knowledge = knowledge_of_kitchenette(tmp_path_factory.mktemp("random"))
    numbers = random.Random(7)
    frames = []
    with Simulation(knowledge, make_engine("mujoco")) as simulation:
        simulation.spawn()
        for step in range(40):
            x, y, z = numbers.uniform(1.2, 2.6), numbers.choice([0.0, 0.5, 1.0]), numbers.choice([0.05, 0.85, 1.85])
            pose = Pose((x, y, z))
            simulation.engine.run(lambda engine, pose=pose: engine.apply(SetPoses({BodyId("Mug"): pose})), edits=True)
            if step == 20:
                simulation.engine.run(lambda engine: engine.apply(Attach(BodyId("Drawer"), BodyId("Mug"))), edits=True)
            if step == 30:
                simulation.engine.run(lambda engine: engine.apply(Detach(BodyId("Mug"))), edits=True)
            simulation.step(0.02)
            frames.append(frame_of(simulation, round(step * 0.1, 6)))
        recording = FrameRecording(frames, name="random", spawned=simulation.worlds, source="mujoco")
    knowledge.add_episode(recording)
    yield Run(recording, knowledge, {})
    knowledge.close()


@settings(max_examples=60, deadline=None)
@given(share=st.floats(0.0, 1.0))
def test_what_holds_at_a_time_is_what_where_is_answers_about_that_time(random_run: Run, share: float) -> None:
    kb, time_s = random_run.knowledge, share * random_run.recording.end_s
    expected = {(row.relation.value, row.thing, row.other) for row in kb.ask("where_is", at=time_s)}
    held = kb.ask("holds", at=time_s)
    assert {
        (row.relation.value, row.a, row.b) for row in held if row.relation.value in set(SpatialRelation)
    } == expected
    openness = {(row.state.value, row.thing, row.part) for row in kb.ask("articulated_parts", at=time_s)}
    assert {(row.relation.value, row.a, row.b) for row in held if row.relation.value in set(OpenState)} == openness
    attached = [row for row in held if row.relation is HeldRelation.ATTACHED and row.a.endswith("Mug")]
    assert bool(attached) == (2.0 <= time_s < 3.0)


def test_intervals_of_a_relation_are_maximal(random_run: Run) -> None:
    rows = random_run.knowledge.ask("holds")
    by_fact: dict[tuple[str, str, str], list[tuple[float, float]]] = {}
    for row in rows:
        by_fact.setdefault((row.relation, row.a, row.b), []).append((row.begin, row.end))
    assert any(len(each) > 1 for each in by_fact.values())
    for each in by_fact.values():
        assert all(first[1] < second[0] for first, second in pairwise(each))


def test_where_is_during_an_interval_has_the_intervals_of_holds(random_run: Run) -> None:
    kb, end_s = random_run.knowledge, random_run.recording.end_s
    during = kb.ask("where_is", "Mug", during=(0.0, end_s))
    spatial = [row for row in kb.ask("holds", a="Mug") if row.relation.value in set(SpatialRelation)]
    expected = {(row.relation.value, row.b, row.begin, row.end) for row in spatial}
    assert {(row.relation.value, row.other, row.begin, row.end) for row in during} == expected
    assert len(during) > 5


def test_an_interval_cuts_the_answers_of_a_question_about_the_state(random_run: Run) -> None:
    for row in random_run.knowledge.ask("where_is", "Mug", during="1.05..2.95"):
        assert 1.05 <= row.begin < row.end <= 2.95
        at = random_run.knowledge.ask("where_is", "Mug", row.relation, row.other, at=(row.begin + row.end) / 2)
        assert len(at) == 1
    since = random_run.knowledge.ask("where_is", "Mug", since=3.5)
    assert min(row.begin for row in since) == 3.5
    assert random_run.knowledge.explain("where_is", since[0])


def test_measured_values_that_change_are_answers_of_their_own(run: Run) -> None:
    rows = run.knowledge.ask("distance", "Mug", "Fridge", during=(0.0, 1.5))
    for row in rows:
        (then,) = run.knowledge.ask("distance", "Mug", "Fridge", at=row.begin)
        assert then.center_distance == pytest.approx(row.center_distance, abs=1e-9)
    assert rows[0].center_distance > 1.0 > 0.0
    assert len(rows) > 1


# -- errors ----------------------------------------------------------------------------------------------------------


@each_case(
    ("args", "error", "words"),
    [
        ({"at": 99.0}, EpisodeTimeError, "run has no state at 99 s; it lasts from 0 to 1.5 s"),
        ({"at": -1.0}, EpisodeTimeError, "no state at -1 s"),
        ({"at": "noon"}, InvalidArgumentError, "at 'noon': it must be a number"),
        ({"at": float("nan")}, InvalidArgumentError, "at nan: it must be a number"),
        ({"at": 1.0, "since": 0.5}, InvalidArgumentError, "together with an interval"),
        ({"during": (1.0, 0.5)}, InvalidArgumentError, "0.5 s is before 1 s"),
        ({"during": "1"}, InvalidArgumentError, "no interval"),
        ({"during": (5.0, 6.0)}, EpisodeError, "run lasts from 0 to 1.5 s"),
        ({"at": 1.0, "episode": "walk"}, InvalidArgumentError, "none named 'walk'; there is run"),
    ],
)
def test_a_wrong_time_is_refused(run: Run, args: dict[str, object], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=re.escape(words)):
        run.knowledge.ask("where_is", "Mug", **args)


def test_without_an_episode_a_time_is_refused_and_nothing_happened() -> None:
    knowledge = KnowledgeBase()
    with pytest.raises(EpisodeError, match="no episode to ask about"):
        knowledge.ask("where_is", at=1.0)
    answers = knowledge.ask("occurs", "PickingUp")
    assert not answers
    assert "no episode" in answers.missing[0].reason


def test_of_several_episodes_one_is_named(run: Run, random_run: Run) -> None:
    knowledge = run.knowledge
    assert knowledge.add_episode(random_run.recording) == "random"
    try:
        with pytest.raises(EpisodeError, match=r"2 episodes \(run, random\)"):
            knowledge.ask("where_is", "Mug", at=1.0)
        rows = knowledge.ask("where_is", "Mug", at=1.0, episode="random")
        assert plain(rows) == plain(random_run.knowledge.ask("where_is", "Mug", at=1.0))
        assert {row.episode for row in knowledge.ask("holds", "on", "Mug")} == {"run", "random"}
        with pytest.raises(InvalidArgumentError, match="there is an episode of that name"):
            knowledge.add_episode(random_run.recording)
    finally:
        knowledge.remove_episode("random")
    assert {row.episode for row in knowledge.ask("holds", "on", "Mug")} == {"run"}


def test_a_question_about_the_ontology_says_that_time_is_of_no_effect(run: Run) -> None:
    then, now = run.knowledge.ask("part_of", at=1.0), run.knowledge.ask("part_of")
    assert plain(then) == plain(now)
    assert "same answers at any time" in then.notes[-1]


def test_a_running_simulation_answers_about_an_episode_too(run: Run) -> None:
    with Simulation(run.knowledge, make_engine("null")) as simulation:
        simulation.spawn()
        now = {row.other for row in simulation.ask("where_is", "Mug", "on")}
        then = {row.other for row in simulation.ask("where_is", "Mug", "on", at=1.5)}
        assert now != then == {row.other for row in run.live["where_is", 1.5] if row.thing.endswith("Mug")} & then
        assert simulation.ask("changed")


def test_a_simulation_that_is_recorded_can_be_asked_about_what_was_recorded_so_far(run: Run, tmp_path: Path) -> None:
    live = {}
    with Simulation(run.knowledge, make_engine("mujoco")) as simulation:
        simulation.spawn()
        with pytest.raises(InvalidArgumentError, match="none named 'live'"):
            simulation.ask("where_is", "Mug", at=0.1, episode="live")
        with Recorder(simulation, tmp_path / "live.mcap", rate_hz=50.0) as recorder:
            for _ in range(4):
                x = 1.9 + 0.04 * len(live)
                simulation.engine.run(lambda engine, x=x: engine.apply(SetPoses({BodyId("Mug"): Pose((x, 0.0, 0.85))})))
                simulation.step(0.1)
                live[recorder.time_s] = plain(simulation.ask("pose_of", "Mug"))
                for time_s, then in live.items():
                    assert plain(simulation.ask("pose_of", "Mug", at=time_s, episode="live")) == then
        assert len({str(each) for each in live.values()}) == 4
    with Episode(tmp_path / "live.mcap") as episode:
        run.knowledge.add_episode(episode)
        try:
            for time_s, then in live.items():
                assert plain(run.knowledge.ask("pose_of", "Mug", at=time_s, episode="live")) == then
        finally:
            run.knowledge.remove_episode("live")


def test_bodies_that_sleep_still_touch_until_one_of_them_moves() -> None:
    world = kitchenette()
    ids = tuple(body.id for body in world.bodies)
    poses = np.array(pose_array(body.pose for body in world.bodies))
    moved = poses.copy()
    moved[ids.index(BodyId("Mug")), 0] += 0.5
    contact = Contact(
        a=BodyId("Mug"),
        b=BodyId("Cupboard"),
        position=(2.0, 0.0, 0.8),
        normal=(0.0, 0.0, 1.0),
        force_n=3.0,
        depth_m=0.0,
    )
    steps = [(0.0, poses, ()), (1.0, poses, (contact,)), (2.0, poses, ()), (3.0, moved, ()), (4.0, moved, ())]
    frames = [
        EpisodeFrame(time_s=time_s, structure=world, ids=ids, poses=now, contacts=contacts)
        for time_s, now, contacts in steps
    ]
    with KnowledgeBase() as knowledge:
        knowledge.add_episode(FrameRecording(frames, name="sleep"))
        rows = knowledge.ask("holds", "touching", "Mug")
        assert [(row.b, row.begin, row.end) for row in rows] == [(MAP + "Cupboard", 1.0, 3.0)]
        assert len(knowledge.ask("holds", "touching", "Cupboard", "Mug", at=2.5)) == 1
