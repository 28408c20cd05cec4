"""`python ours.py MAP FILE…` loads files into Mindstage and prints for each question its name, time [s] and answers."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median

from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import get_question
from mindstage.scene import Iri

__all__ = ["main"]

KNOWROB = "http://knowrob.org/kb/knowrob.owl#"


def main(map: str, files: list[str]) -> None:
    kb = KnowledgeBase(bundled_ontology=False)
    maps = [file for file in files if Path(file).name.startswith("map-")]
    show("load", once(lambda: kb.load(maps, ontologies=[file for file in files if file not in maps])), len(kb.store))
    if map == "-":
        return
    show("index", once(lambda: kb.ask("maps")), len(kb.reasoner.types))
    for name, (question, args) in questions(kb, Iri(map)).items():
        uncached = partial(get_question(question).ask, kb, args)
        show(name, typical(uncached), len(uncached()))
        show(f"{name}, again", typical(partial(kb.ask, question, **args)), len(uncached()))
    show("tell", median(once(partial(tell_and_ask, kb, number)) for number in range(9)), 1)


def questions(kb: KnowledgeBase, map: Iri) -> dict[str, tuple[str, dict[str, object]]]:
    """The questions about the first map, by the name that all programs use."""
    door, oven = (kb.reasoner.members(Iri(KNOWROB + name), map)[0] for name in ("IAIFridgeDoor", "IAIOvenCase"))
    part = kb.ask("part_of", whole=door)[0].part
    return {
        "maps": ("maps", {}),
        "everything_in_map": ("everything_in_map", {"map": map}),
        "individual_of_class": ("individual_of_class", {"cls": "knowrob:Handle", "map": map}),
        "individual_of_class, any map": ("individual_of_class", {"cls": "knowrob:Handle"}),
        "part_of": ("part_of", {"whole": door}),
        "part_of, wholes": ("part_of", {"part": part}),
        "handle_of": ("handle_of", {"individual": oven}),
        "subclass_of": ("subclass_of", {"cls": "knowrob:Refrigerator"}),
        "subclass_of, below": ("subclass_of", {"superclass": "knowrob:StorageConstruct"}),
        "siblings": ("siblings", {"cls": "knowrob:Refrigerator"}),
        "class_properties": ("class_properties", {"cls": "knowrob:Refrigerator"}),
        "storage_place": ("storage_place", {"item": "knowrob:CowsMilk"}),
        "storage_place_in_environment": ("storage_place_in_environment", {"item": "knowrob:CowsMilk", "map": map}),
        "device_for_action": ("device_for_action", {"action": "knowrob:BakingFood"}),
        "device_for_action_in_environment": (
            "device_for_action_in_environment",
            {"action": "knowrob:BakingFood", "map": map},
        ),
        "what_is": ("what_is", {"individual": door}),
        "analyze": ("analyze", {"map": map}),
    }


def tell_and_ask(kb: KnowledgeBase, number: int) -> None:
    """Asserts two statements and asks a question that they change."""
    kb.tell(f"ms:Rack{number}", "subClassOf", "knowrob:Refrigerator")
    kb.tell(f"ms:Rack{number}", "knowrob:typePrimaryFunction-containerFor", "knowrob:CowsMilk")
    kb.ask("storage_place", item="knowrob:CowsMilk")


def once(call: Callable[[], object]) -> float:
    """The time of one call [s]."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def typical(call: Callable[[], object]) -> float:
    """The median of nine samples, each of as many calls as fit into 10 ms [s]."""
    call()
    return median(sample(call) for _ in range(9))


def sample(call: Callable[[], object]) -> float:
    start, count, spent = time.perf_counter(), 0, 0.0
    while spent < 0.01:
        call()
        count += 1
        spent = time.perf_counter() - start
    return spent / count


def show(name: str, seconds: float, count: int) -> None:
    print(name, seconds, count, sep="\t")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
