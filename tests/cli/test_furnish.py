"""`mindstage place_items`: a list of things, each put where it belongs, and a map that has them."""

from pathlib import Path

from mindstage.knowledge import KnowledgeBase
from tests.cli.typed import Run, json_output

GUIDE = (Path(__file__).resolve().parents[2] / "docs" / "how-to" / "furnishing.md").read_text(encoding="utf-8")
ITEMS = GUIDE.split("```turtle\n")[2].split("```")[0]


def test_things_go_where_they_belong_and_into_the_map(run: Run, tmp_path: Path) -> None:
    items, out = tmp_path / "items.ttl", tmp_path / "furnished.owl"
    items.write_text(ITEMS, encoding="utf-8")
    result = run("furnish", "bundled:kitchen", "--with", items, "-o", out, "--json")
    assert result.exit_code == 0, result.stderr
    where = {put["id"]: put["holder"] for put in json_output(result)["put"]}
    assert where == {"milk": "fridge", "plates_1": "table", "plates_2": "table", "parcel": "drawer_middle_1"}
    assert json_output(result)["unplaced"] == []
    knowledge = KnowledgeBase()
    knowledge.load(out)
    milk = knowledge.world().body("milk")
    assert milk.label == "tomorrow's milk"
    assert milk.iri == "http://example.org/shopping#milk"
    assert any(fact.property.endswith("#expires") for fact in milk.facts)
    assert len(knowledge.world().bodies) == 258
    (row,) = knowledge.ask("storage_place_in_environment", item="CowsMilk")
    assert row.individual.endswith("fridge")


def test_what_finds_no_place_is_told_and_the_answer_is_no(run: Run, tmp_path: Path) -> None:
    items = tmp_path / "items.ttl"
    items.write_text(
        ITEMS.partition(":milk")[0]
        + ":ladder a knowrob:HumanScaleObject ; ms:typicalSize '0.5 0.5 3' ; ms:putInto 'fridge' .\n"
        + ":ghost a :NoSuchClass ; ms:putOn 'table' .\n"
        + ":lost a knowrob:DinnerPlate ; ms:putOn 'no_such_table' .\n",
        encoding="utf-8",
    )
    result = run("furnish", "bundled:kitchen", "--with", items, "--no-viewport", "--json")
    assert result.exit_code == 1
    reasons = {each["id"]: each["reason"] for each in json_output(result)["unplaced"]}
    assert "there is room for" in reasons["ladder"] or "larger than the place" in reasons["ladder"]
    assert "nobody told how large" in reasons["ghost"]
    assert "no_such_table" in reasons["lost"]
    assert json_output(result)["put"] == []


def test_a_list_that_is_none_is_refused(run: Run, tmp_path: Path) -> None:
    items = tmp_path / "items.ttl"
    items.write_text("@prefix : <http://example.org/#> .\n:Mug a <http://www.w3.org/2002/07/owl#Class> .\n")
    result = run("furnish", "bundled:kitchen", "--with", items)
    assert result.exit_code == 2
    assert "there are no things in it" in result.stderr
    items.write_text(ITEMS.replace("ms:count 2", "ms:count 0"))
    result = run("furnish", "bundled:kitchen", "--with", items)
    assert result.exit_code == 2
    assert 'plates: ms:count "0" is no number from 1 to 1000' in result.stderr


def test_one_thing_needs_no_file(run: Run) -> None:
    things = ("--with", "CowsMilk", "--with", "DinnerPlate:table")
    result = run("furnish", "bundled:kitchen", *things, "--no-viewport", "--json")
    assert result.exit_code == 0, result.stderr
    assert [(put["id"], put["holder"]) for put in json_output(result)["put"]] == [
        ("CowsMilk_1", "fridge"),
        ("DinnerPlate_1", "table"),
    ]
    result = run("furnish", "bundled:kitchen", "--with", "CowMilk")
    assert result.exit_code == 2
    assert "near: 'CowsMilk'" in result.stderr
