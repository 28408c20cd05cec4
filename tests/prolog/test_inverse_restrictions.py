"""Restrictions on the inverse of a property as terms: `inverse_of(Property)`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from mindstage.engines import NullEngine
from mindstage.prolog import PrologConsole
from mindstage.rdf.graphs import local_name
from mindstage.simulation import Simulation
from tests.cases import each_case
from tests.knowledge.test_inverse_restrictions import EXAMPLE, knowledge_of_lids


@pytest.fixture
def console(prolog: Path, tmp_path: Path) -> Iterator[PrologConsole]:
    with Simulation(knowledge_of_lids(tmp_path), NullEngine()) as simulation, PrologConsole(simulation) as console:
        yield console


@each_case(
    ("goal", "answers"),
    [
        ("{p}(o:'Lid', P, V)", {("inverse_of(holds)", "Crate"), ("holds", "Screw")}),
        ("P = o:holds, {p}(o:'Lid', P, V)", {("holds", "Screw")}),
        ("P = inverse_of(o:holds), {p}(o:'Lid', P, V)", {("inverse_of(holds)", "Crate")}),
        ("P = inverse_of(_), {p}(o:'Lid', P, V)", {("inverse_of(holds)", "Crate")}),
        ("P = o:holds, {p}(o:'RoundLid', P, V)", {("holds", "Screw")}),
        ("P = o:grips, {p}(o:'RoundLid', P, V)", set()),
    ],
)
def test_prolog_has_a_functor_for_the_inverse(console: PrologConsole, goal: str, answers: set[tuple[str, str]]) -> None:
    assert console.holds(f"rdf_register_prefix(o, '{EXAMPLE}')")
    for predicate in ("class_properties", "owl_class_properties"):
        query = f"{goal.format(p=predicate)}, term_to_atom(P, Shown)"
        rows = list(console.solutions(query))
        found = {(plain(row["Shown"]), local_name(str(row["V"]))) for row in rows}
        assert found == answers, predicate


def plain(term: object) -> str:
    return str(term).replace(EXAMPLE, "").replace("o:", "").replace("'", "")


def test_prolog_finds_what_satisfies_a_restriction_on_an_inverse(console: PrologConsole) -> None:
    restricted = f"restriction(inverse_of('{EXAMPLE}holds'), some_values_from('{EXAMPLE}Crate'))"
    assert [row["X"] for row in console.solutions(f"owl_satisfies({restricted}, X)")] == [f"{EXAMPLE}top"]
    nested = f"owl_class_properties('{EXAMPLE}Odd', '{EXAMPLE}holds', restriction(inverse_of(P), _, _))"
    assert [row["P"] for row in console.solutions(nested)] == [f"{EXAMPLE}grips"]
