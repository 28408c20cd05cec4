"""Answers as sentences: what people read before the table."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

import mindstage as ms
from mindstage.scene import BodyId
from mindstage.viewer import Viewer
from mindstage.viewer.answer_sentences import answer_sentence, listed, name_in_words
from tests.viewer.page_tab import PageTab
from tests.viewer.waiting import wait_until


@pytest.fixture(scope="module")
def kitchen() -> Iterator[ms.Simulation]:
    with ms.open("bundled:kitchen") as simulation:
        yield simulation


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("BaseCupboardW60H86", "base cupboard"),
        ("milk_carton_1", "milk carton 1"),
        ("FridgeDoor", "fridge door"),
        ("TVStand", "TV stand"),
        ("W60", "W60"),
        ("Ofen", "ofen"),
    ],
)
def test_names_are_said_in_words(name: str, words: str) -> None:
    assert name_in_words(name) == words


def test_lists_name_a_few_things_and_count_the_others() -> None:
    assert [listed(list(names)) for names in ("a", "ab", "abcd", "abcde", "aab")] == [
        "a",
        "a and b",
        "a, b, c and d",
        "a, b, c and 2 more",
        "a and b",
    ]


@pytest.mark.parametrize(
    ("question", "sentence"),
    [
        ("where is milk kept?", "Milk is kept in the fridge."),
        ("where is the milk?", "Milk carton 1 and milk carton 2 are in fridge."),
        (
            "what is on the table?",
            "Plate 3, table fork 3, dinner knife 3, tumbler 5, plate 4, table fork 4, dinner knife 4, tumbler 6, "
            "water bottle 3, coffee mug 4 and jam jar 3.",
        ),
        ("how many cups are there?", "4 cups."),
        ("is the fridge open?", "No: fridge is not open."),
        ("is the fridge closed?", "Yes: fridge is closed."),
        ("what is a fridge?", "Fridge is of the class fridge."),
    ],
)
def test_questions_about_the_kitchen(kitchen: ms.Simulation, question: str, sentence: str) -> None:
    assert answer_sentence(kitchen.ask(question), {}, asked=question) == sentence


def test_what_may_be_a_no_is_not_answered_with_yes(kitchen: ms.Simulation) -> None:
    question = "can the fridge be opened?"
    sentence = answer_sentence(kitchen.ask(question), {}, asked=question)
    assert sentence.startswith("Fridge: it opens to")


def test_labels_are_said_instead_of_ids(kitchen: ms.Simulation) -> None:
    fridge = kitchen.snapshot().body("fridge").iri
    answers = kitchen.ask("where is the milk?")
    assert answer_sentence(answers, {fridge: "cold box"}, asked="where is the milk?").endswith("in cold box.")


def test_a_question_in_words_is_answered_with_a_sentence_and_highlighted_at_once(
    kitchen: ms.Simulation, open_page: Any
) -> None:
    with Viewer(kitchen, port=0) as viewer:
        tab: PageTab = open_page(viewer, view=False)
        page = tab.page
        page.get_by_role("tab", name="Ask").click()
        field = page.get_by_role("textbox", name="Question in words")
        field.fill("where is milk kept?")
        field.press("Enter")
        page.get_by_text("Milk is kept in the fridge.").wait_for()
        wait_until(lambda: set(kitchen.state.highlights) == {"fridge"}, "the answer is highlighted")
        assert not page.get_by_label("Question", exact=True).is_visible(), "forms are under More"

        field.fill("what is on the table?")
        field.press("Enter")
        page.get_by_text("Plate 3, table fork 3").wait_for()
        wait_until(lambda: BodyId("coffee_mug_4") in kitchen.state.highlights, "the new answer is highlighted")
        assert "fridge" not in kitchen.state.highlights

        page.get_by_text("Earlier questions").click()
        page.get_by_role("button", name="where is milk kept?").click()
        page.get_by_text("Milk is kept in the fridge.").wait_for()
        kitchen.clear_highlights()
        table = page.locator(".answers-scroll")
        assert table.evaluate("each => each.scrollWidth <= each.clientWidth"), "the columns fit"
