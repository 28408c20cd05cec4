"""Questions and assertions from several threads: each answer was correct at some point in time."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event

import pytest

from mindstage.engines import NullEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.rdf.graphs import local_name
from mindstage.scene import Iri
from mindstage.simulation import Simulation
from tests.maps.small_maps import ROOM_NAMESPACE, body_turtle, room_map

CONTAINER_FOR = "typePrimaryFunction-containerFor"
ROUNDS = 24
PATIENCE_S = 120.0


@pytest.fixture
def often() -> Iterator[None]:
    """Makes Python switch threads as often as possible."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(before)


@pytest.fixture
def kitchen() -> KnowledgeBase:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    return kb


def superclasses(kb: KnowledgeBase, cls: str) -> set[str]:
    return {local_name(row.superclass) for row in kb.ask("subclass_of", cls=cls)}


def asking(kb: KnowledgeBase, over: Event) -> set[frozenset[str]]:
    """Asks questions repeatedly until the test is over."""
    found = set()
    while not over.is_set():
        found.add(frozenset(superclasses(kb, "PantryCupboard")))
        kb.ask("subclass_of")
        assert kb.ask("handle_of", individual="fridge_door")
        assert kb.ask("what_is", individual="fridge")[0].pose
    return found


def test_assertions_are_seen_at_once_during_concurrent_questions(often: None, kitchen: KnowledgeBase) -> None:
    before = superclasses(kitchen, "PantryCupboard")
    below = [local_name(row.cls) for row in kitchen.ask("subclass_of", superclass="Cupboard")]
    over = Event()
    with ThreadPoolExecutor(3) as threads:
        askers = [threads.submit(asking, kitchen, over) for _ in range(3)]
        try:
            for number in range(ROUNDS):
                new = f"Kind{number}"
                kitchen.tell(f"ms:{new}", "subClassOf", "Container")
                kitchen.tell("Cupboard", "subClassOf", new)
                assert all(new in superclasses(kitchen, cls) for cls in below)
                kitchen.retract("Cupboard", "subClassOf", new)
                assert not any(new in superclasses(kitchen, cls) for cls in below)
        finally:
            over.set()
        found = {each for asker in askers for each in asker.result(timeout=PATIENCE_S)}
    assert found <= {frozenset(before), *(frozenset({*before, f"Kind{number}"}) for number in range(ROUNDS))}


def test_a_change_waits_for_a_running_question(kitchen: KnowledgeBase, monkeypatch: pytest.MonkeyPatch) -> None:
    looking, go_on = Event(), Event()
    descend = kitchen.reasoner.classes.below

    def slowly(cls: Iri) -> Mapping[Iri, int]:
        looking.set()
        assert go_on.wait(PATIENCE_S)
        return descend(cls)

    monkeypatch.setattr(kitchen.reasoner.classes, "below", slowly)
    with ThreadPoolExecutor(2) as threads:
        question = threads.submit(kitchen.ask, "subclass_of", superclass="Cupboard")
        assert looking.wait(PATIENCE_S)
        assertion = threads.submit(kitchen.tell, "ms:Locker", "subClassOf", "Cupboard")
        try:
            with pytest.raises(TimeoutError):
                assertion.result(timeout=0.3)
        finally:
            go_on.set()
        assert "Locker" not in {local_name(row.cls) for row in question.result(timeout=PATIENCE_S)}
        assert assertion.result(timeout=PATIENCE_S)
    assert "Locker" in {local_name(row.cls) for row in kitchen.ask("subclass_of", superclass="Cupboard")}


def test_maps_are_loaded_during_concurrent_questions(often: None, kitchen: KnowledgeBase, tmp_path: Path) -> None:
    over = Event()
    with ThreadPoolExecutor(2) as threads:
        askers = [threads.submit(asking, kitchen, over) for _ in range(2)]
        try:
            for number in range(5):
                path = tmp_path / f"room{number}.ttl"
                path.write_text(
                    room_map(body_turtle("cup")).replace(ROOM_NAMESPACE, f"{ROOM_NAMESPACE[:-1]}{number}#"),
                    encoding="utf-8",
                )
                kitchen.load(path)
                assert len(kitchen.ask("maps")) == number + 2
                assert len(kitchen.ask("what_is", map=f"{ROOM_NAMESPACE[:-1]}{number}#room")) == 1
        finally:
            over.set()
        assert all(asker.result(timeout=PATIENCE_S) for asker in askers)


def test_a_slow_engine_does_not_block_other_questions(kitchen: KnowledgeBase) -> None:
    with Simulation(kitchen, NullEngine()) as sim, ThreadPoolExecutor(2) as threads:
        sim.spawn()
        busy, free = Event(), Event()
        held = threads.submit(sim.engine.run, lambda _: (busy.set(), free.wait(PATIENCE_S)), timeout_s=PATIENCE_S)
        assert busy.wait(PATIENCE_S)
        try:
            waiting = threads.submit(sim.ask, "articulated_parts", thing="fridge")
            assert kitchen.ask("storage_place", item="CowsMilk")
            assert kitchen.tell("KitchenTable", CONTAINER_FOR, "Robot")
            assert not waiting.done()
        finally:
            free.set()
        assert waiting.result(timeout=PATIENCE_S)
        held.result(timeout=PATIENCE_S)
