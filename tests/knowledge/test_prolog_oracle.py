"""The same rules in plain Prolog, over SWI-Prolog's own store, give the same answers for every class."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen, bundled_ontology

ORACLE = Path(__file__).with_name("oracle.pl")

ENDS = {
    "subclass_of": ("cls", "superclass"),
    "storage_place": ("item", "place"),
    "storage_place_in_environment": ("item", "individual"),
    "device_for_action": ("action", "device"),
    "device_for_action_in_environment": ("action", "individual"),
    "handle_of": ("individual", "handle"),
    "individual_of_class": ("cls", "individual"),
    "part_of": ("part", "whole"),
    "siblings": ("cls", "sibling"),
}
"""The two columns of each question."""

Answers = dict[str, set[tuple[str, str]]]


def told_by_prolog(swipl: Path, files: list[Path]) -> Answers:
    done = subprocess.run([swipl, ORACLE, *files], capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    answers: Answers = {name: set() for name in (*ENDS, "class_properties")}
    for line in done.stdout.splitlines():
        question, one, other = line.split("\t")
        answers[question].add((one, other))
    return answers


def told_by_us(kb: KnowledgeBase) -> Answers:
    answers = {name: {tuple(getattr(row, end) for end in ends) for row in kb.ask(name)} for name, ends in ENDS.items()}
    properties = set()
    for row in kb.ask("class_properties"):
        property = f"{'^' * row.inverse}{row.property}"
        properties.add((row.cls, f"{property} {row.source} {row.kind} {row.value if '://' in row.value else '-'}"))
    return answers | {"class_properties": properties}


def assert_same(ours: Answers, theirs: Answers, *, at_least: dict[str, int]) -> None:
    for name, number in at_least.items():
        assert len(theirs[name]) >= number, f"the oracle itself has no more than {len(theirs[name])} for {name}"
    for name in ours:
        assert ours[name] == theirs[name], name


@pytest.fixture(scope="module")
def laboratory(shared_data: Path) -> KnowledgeBase:
    kb = KnowledgeBase(bundled_ontology=False)
    kb.load(shared_data / "maps" / "iai-kitchen-original.owl", ontologies=shared_data / "ontology")
    return kb


def test_the_laboratory_kitchen_with_the_community_ontologies(swipl: Path, laboratory: KnowledgeBase) -> None:
    files = laboratory.sources()
    least = {"subclass_of": 10_000, "storage_place": 100, "device_for_action": 10, "handle_of": 20}
    least |= {"part_of": 20, "class_properties": 1000, "siblings": 5000}
    assert_same(told_by_us(laboratory), told_by_prolog(swipl, files), at_least=least)


def test_the_bundled_kitchen_with_the_bundled_ontology(swipl: Path) -> None:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    least = {"subclass_of": 5000, "storage_place": 200, "device_for_action": 40, "handle_of": 10}
    least |= {"part_of": 20, "class_properties": 500, "siblings": 3000}
    assert_same(told_by_us(kb), told_by_prolog(swipl, [bundled_kitchen(), bundled_ontology()]), at_least=least)
