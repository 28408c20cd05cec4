"""The verb `place`: a list of items, and the resulting map."""

from pathlib import Path

from mindstage.knowledge import KnowledgeBase
from tests.cli.runner import Run, json_output

GUIDE = (Path(__file__).resolve().parents[2] / "docs" / "how-to" / "furnishing.md").read_text(encoding="utf-8")
ITEMS = GUIDE.split("```turtle\n")[2].split("```")[0]


def test_items_are_placed_and_written_to_the_map(run: Run, tmp_path: Path) -> None:
    items, out = tmp_path / "items.ttl", tmp_path / "furnished.owl"
    items.write_text(ITEMS, encoding="utf-8")
    result = run("place", "bundled:kitchen", "--with", items, "-o", out, "--json")
    assert result.exit_code == 0, result.stderr
    holders = {each["id"]: each["support_id"] for each in json_output(result)["placed"]}
    assert holders == {"milk": "fridge", "plates_1": "table", "plates_2": "table", "parcel": "drawer_middle_1"}
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


def test_unplaced_items_have_a_reason_and_exit_1(run: Run, tmp_path: Path) -> None:
    items = tmp_path / "items.ttl"
    items.write_text(
        ITEMS.partition(":milk")[0]
        + ":ladder a knowrob:HumanScaleObject ; ms:typicalSize '0.5 0.5 3' ; ms:putInto 'fridge' .\n"
        + ":ghost a :NoSuchClass ; ms:putOn 'table' .\n"
        + ":lost a knowrob:DinnerPlate ; ms:putOn 'no_such_table' .\n",
        encoding="utf-8",
    )
    result = run("place", "bundled:kitchen", "--with", items, "--no-viewer", "--json")
    assert result.exit_code == 1
    reasons = {each["id"]: each["reason"] for each in json_output(result)["unplaced"]}
    assert "and the clearance is" in reasons["ladder"] or "larger than the support surface" in reasons["ladder"]
    assert "the size of its instances is unknown" in reasons["ghost"]
    assert "no_such_table" in reasons["lost"]
    assert json_output(result)["placed"] == []


def test_a_map_without_some_of_the_items_is_named_so(run: Run, tmp_path: Path) -> None:
    items, out = tmp_path / "items.ttl", tmp_path / "out.owl"
    items.write_text(
        ITEMS.partition(":milk")[0]
        + ":plate a knowrob:DinnerPlate ; ms:putOn 'table' .\n"
        + ":lost a knowrob:DinnerPlate ; ms:putOn 'no_such_table' .\n",
        encoding="utf-8",
    )
    result = run("place", "bundled:kitchen", "--with", items, "--out", out)
    assert result.exit_code == 1
    assert "out.owl, without 1 of 2 items" in " ".join(result.stdout.split())


def test_an_invalid_list_is_rejected(run: Run, tmp_path: Path) -> None:
    items = tmp_path / "items.ttl"
    items.write_text("@prefix : <http://example.org/#> .\n:Mug a <http://www.w3.org/2002/07/owl#Class> .\n")
    result = run("place", "bundled:kitchen", "--with", items)
    assert result.exit_code == 2
    assert "there are no items in it" in result.stderr
    items.write_text(ITEMS.replace("ms:count 2", "ms:count 0"))
    result = run("place", "bundled:kitchen", "--with", items)
    assert result.exit_code == 2
    assert 'plates: ms:count "0" is not an integer from 1 to 1000' in result.stderr


def test_items_can_be_given_without_a_file(run: Run) -> None:
    items = ("--with", "CowsMilk", "--with", "DinnerPlate:table")
    result = run("place", "bundled:kitchen", *items, "--no-viewer", "--json")
    assert result.exit_code == 0, result.stderr
    assert [(each["id"], each["support_id"]) for each in json_output(result)["placed"]] == [
        ("CowsMilk_1", "fridge"),
        ("DinnerPlate_1", "table"),
    ]
    result = run("place", "bundled:kitchen", "--with", "CowMilk")
    assert result.exit_code == 2
    assert "near: 'CowsMilk'" in result.stderr
