"""Episodes in Prolog: events, roles, Allen's relations, and poses and relations at times of an episode."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from mindstage.engines import make_engine
from mindstage.episodes.intervals import AllenRelation, Interval, allen_relation
from mindstage.errors import PrologGoalError
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import write_map
from mindstage.prolog import PrologConsole
from mindstage.simulation import Simulation
from tests.cases import each_case
from tests.kitchenette import MAP, kitchenette
from tests.knowledge.test_episode_graphs import EVENTS, recording

GRAPH = "urn:mindstage:episode:run#"


@pytest.fixture(scope="module")
def console(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PrologConsole]:
    path: Path = tmp_path_factory.mktemp("map") / "kitchenette.owl"
    path.write_text(write_map(kitchenette()))
    with KnowledgeBase() as knowledge, Simulation(knowledge, make_engine("null")) as simulation:
        knowledge.load(path)
        knowledge.add_episode(recording("run", start_unix_s=1_000_000.0))
        simulation.spawn()
        with PrologConsole(simulation) as console:
            yield console


def short(value: object) -> str:
    return str(value).rpartition("#")[2] or str(value)


def test_episodes_and_events_have_intervals(console: PrologConsole) -> None:
    assert [dict(row) for row in console.solutions("episode(Name, Interval)")] == [
        {"Name": "run", "Interval": [0.0, 3.0]}
    ]
    rows = console.solutions("occurs(Event, [Begin, End]), (var(End) -> End = none ; true)")
    found = {(short(row["Event"]), row["Begin"], row["End"]) for row in rows}
    assert found == {(each.id, each.begin_s, "none" if each.end_s is None else each.end_s) for each in EVENTS}


def test_an_event_has_its_short_name_and_a_time_is_within_it(console: PrologConsole) -> None:
    assert console.holds("occurs('PickingUp_1', [1.0, 1.5])")
    assert console.holds("occurs('PickingUp_1', 1.25)")
    assert not console.holds("occurs('PickingUp_1', 2.0)")
    (row,) = console.solutions("occurs(Event, 1.4)")
    assert row["Event"] == GRAPH + "PickingUp_1"


def test_types_of_events_are_classes_with_their_superclasses(console: PrologConsole) -> None:
    assert {short(row["C"]) for row in console.solutions("event_type('PickingUp_1', C)")} == {"PickingUp"}
    assert {short(row["E"]) for row in console.solutions("event_type(E, knowrob:'Action')")} == {
        "PickingUp_1",
        "Opening_1",
    }
    assert {short(row["E"]) for row in console.solutions("occurs(E, _, ms:'RelationEvent')")} == {"SupportedBy_1"}
    assert not console.holds("event_type('SupportedBy_1', knowrob:'Action')")


def test_tasks_have_roles_of_the_participants(console: PrologConsole) -> None:
    goal = "executes_task('urn:mindstage:episode:run#PickingUp_1', Task), task_role(Task, Role, Class)"
    assert {short(row["Class"]) for row in console.solutions(goal)} == {"Patient", "Supporter"}
    rows = console.solutions("has_participant('PickingUp_1', Thing, Class)")
    found = {(short(row["Thing"]), short(row["Class"])) for row in rows}
    assert found == {("Mug", "Cup"), ("Cupboard", "Cupboard")}
    assert {short(row["E"]) for row in console.solutions("has_participant(E, 'Cupboard')")} == {"PickingUp_1"}
    rows = console.solutions("event_agent(E, A)")
    assert {(short(row["E"]), row["A"]) for row in rows} == {("PickingUp_1", "viewer"), ("Opening_1", MAP + "Mug")}


@each_case("a", EVENTS, ids=lambda each: each.id)
@each_case("b", EVENTS, ids=lambda each: each.id)
def test_relations_of_events_are_those_of_allen(console: PrologConsole, a: object, b: object) -> None:
    one, other = (Interval(each.begin_s, 3.0 if each.end_s is None else each.end_s) for each in (a, b))  # type: ignore[attr-defined]
    found = console.solutions(f"temporal_relation('{a.id}', '{b.id}', R)")  # type: ignore[attr-defined]
    assert [row["R"] for row in found] == ([] if a is b else [allen_relation(one, other).value])


@each_case("relation", AllenRelation)
def test_every_relation_is_a_predicate_of_intervals(console: PrologConsole, relation: AllenRelation) -> None:
    times = [(0, 1), (0, 2), (1, 2), (1, 3), (2, 3), (0, 3), (2, 4), (3, 4)]
    related = {(a, b) for a in times for b in times if allen_relation(Interval(*a), Interval(*b)) is relation}
    held = {
        (a, b) for a in times for b in times if console.holds(f"{relation.value}([{a[0]}, {a[1]}], [{b[0]}, {b[1]}])")
    }
    assert held == related != set()


def test_poses_and_relations_are_those_of_a_time_of_the_episode(console: PrologConsole) -> None:
    def height(time: str) -> float:
        (row,) = console.solutions(f"object_pose_at_time('Mug', {time}, [_, _, Z], _)")
        return float(row["Z"])

    assert (height("1.0"), height("2.5"), height("1000002.5")) == (0.85, 1.85, 1.85)
    (row,) = console.solutions("current_object_pose('Mug', [map, _, [_, _, Z], _])")
    assert row["Z"] == 0.85
    assert console.holds("holds(on_Physical('Mug', 'Cupboard'), 1.0)")
    assert not console.holds("holds(on_Physical('Mug', 'Cupboard'), 2.5)")
    assert console.holds("holds('Mug', knowrob:'on-Physical', 'Fridge', 2.5)")
    assert console.holds("object_pose_at_time('Mug', 'SupportedBy_1', [_, _, 1.85], _)")


def test_intervals_of_relations_are_a_question(console: PrologConsole) -> None:
    rows = console.solutions("holds(on, 'Mug', Place, Begin, End)")
    assert {(short(row["Place"]), row["Begin"], row["End"]) for row in rows} == {
        ("Cupboard", 0.0, 2.0),
        ("Fridge", 2.0, 3.0),
    }


def test_statements_have_the_intervals_of_the_episode(console: PrologConsole) -> None:
    (row,) = console.solutions("kb_call(is_supported_by('Mug', 'Fridge') during [B, E])")
    assert (row["B"], row["E"]) == (2.0, 3.0)
    assert console.holds("is_supported_by('Mug', 'Cupboard') during [0.5, 1.5]")
    assert not console.holds("is_supported_by('Mug', 'Cupboard') during [0.5, 2.5]")
    (row,) = console.solutions("is_supported_by('Mug', Place) since T")
    assert (short(row["Place"]), row["T"]) == ("Fridge", 2.0)
    assert not console.holds("is_supported_by('Mug', 'Cupboard') since 1.0")
    assert console.holds("is_supported_by('Mug', 'Cupboard') until 1.5")
    assert not console.holds("is_supported_by('Mug', 'Cupboard') until 2.5")
    rows = console.solutions("occurs(Event) during [0.9, 2.0]")
    assert {short(row["Event"]) for row in rows} == {"PickingUp_1"}


def test_untrusted_queries_may_ask_about_episodes(console: PrologConsole) -> None:
    from mindstage.prolog import solve_query

    found = solve_query(console.simulation, "before(A, B), event_type(A, T)", limit=10, timeout_s=10.0)
    assert found


def test_a_name_that_several_episodes_have_is_ambiguous(console: PrologConsole) -> None:
    knowledge = console.simulation.knowledge
    knowledge.add_episode(recording("walk"))
    try:
        with pytest.raises(PrologGoalError, match="PickingUp_1"):
            console.holds("occurs('PickingUp_1', I)")
        assert console.holds("occurs('urn:mindstage:episode:walk#PickingUp_1', I)")
        with pytest.raises(PrologGoalError, match="several episodes have a state at 1 s"):
            console.holds("object_pose_at_time('Mug', 1.0, P)")
    finally:
        knowledge.remove_episode("walk")
