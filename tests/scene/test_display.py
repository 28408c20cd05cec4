"""Formatting of values: one-line reprs, and escaped tables for notebooks."""

from __future__ import annotations

from html import unescape
from html.parser import HTMLParser

from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.kitchenette import kitchenette

from mindstage.engines import SpawnFailure, SpawnNote, SpawnNoteKind, SpawnReport
from mindstage.scene import BodyId, Iri, Pose, World, diff
from mindstage.scene.display import counted, html_table, short_name

TEXTS = st.text(max_size=20)


class Texts(HTMLParser):
    """Collects the tags and the text of table cells; no tag may come from data."""

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[str] = []
        self.cells: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: object) -> None:
        assert not attrs
        self.tags.append(tag)
        if tag == "td":
            self.cells.append("")

    def handle_data(self, data: str) -> None:
        if self.tags[-1] == "td":
            self.cells[-1] += data


@given(title=TEXTS, rows=st.lists(st.tuples(TEXTS, TEXTS), max_size=5), notes=st.lists(TEXTS, max_size=3))
def test_all_text_in_a_table_is_escaped(title: str, rows: list[tuple[str, str]], notes: list[str]) -> None:
    page = html_table(title, ("a", "<b>"), rows, notes=notes)
    assert set(Texts(page).tags) <= {"table", "caption", "thead", "tbody", "tr", "th", "td", "p"}
    cells = [part.partition("</td>")[0] for part in page.split("<td>")[1:]]
    assert [unescape(cell) for cell in cells] == [cell for row in rows for cell in row]
    assert not any(mark in cell for cell in cells for mark in '<>"')


def test_an_empty_cell_is_empty_and_numbers_have_six_digits() -> None:
    page = html_table("t", ("a", "b", "c"), [(None, 1.23456789, 12345678)])
    assert Texts(page).cells == ["", "1.23457", "12345678"]


def test_the_table_of_a_world_has_positions_and_sizes() -> None:
    mug = kitchenette().body("Mug")
    page = replace(kitchenette(), bodies=(mug, replace(mug, id=BodyId("dot"), size=None)))._repr_html_()
    cup, dot = (Texts(page).cells[start : start + 5] for start in (0, 5))
    assert cup[2:4] == ["2.000 0.000 0.850", "0.080 0.080 0.100"]
    assert dot[2:4] == ["2.000 0.000 0.850", ""]


def test_a_long_table_is_truncated_with_a_note() -> None:
    page = html_table("t", ("n",), [(n,) for n in range(250)])
    assert page.count("<td>") == 100
    assert "and 150 more rows" in page


def test_the_repr_of_a_large_world_is_one_line() -> None:
    mug = kitchenette().body("Mug")
    world = replace(kitchenette(), bodies=tuple(replace(mug, id=f"{mug.id}{n}") for n in range(10_000)))  # type: ignore[arg-type]
    assert repr(world).startswith("<World map: 10,000 bodies, ")
    assert len(repr(world)) < 80
    assert len(world._repr_html_()) < 50_000


def test_the_repr_of_bodies_and_joints_identifies_them() -> None:
    world = kitchenette()
    mug = replace(world.body("Mug"), pose=Pose((1.0, 2.0, 3.0)))
    assert repr(mug) == f"<Body Mug ({short_name(mug.cls)}) at (1.000, 2.000, 3.000) m>"
    joint = world.joints[0]
    assert repr(joint).endswith(f"{joint.id}: {joint.parent} -> {joint.child}>")


def test_a_spawn_report_counts_and_lists_failures() -> None:
    report = SpawnReport(
        bodies=1,
        failed_bodies=(SpawnFailure("<b>", "it is & bad"),),
        notes=(SpawnNote(SpawnNoteKind.ENCLOSURE, ("a", "b"), "encloses"),),
    )
    assert repr(report) == "<SpawnReport: 1 body, 0 joints, 0 attachments, 1 failed, 1 note>"
    assert "&lt;b&gt;" in report._repr_html_()
    assert "it is &amp; bad" in report._repr_html_()
    assert "<b>" not in report._repr_html_()


def test_a_diff_is_formatted_with_errors_and_changes() -> None:
    a = kitchenette()
    assert (str(diff(a, a)), repr(diff(a, a))) == ("identical", "<WorldDiff: identical>")
    moved = replace(a.body("Mug"), pose=Pose((9.0, 9.0, 9.0)), physics=replace(a.body("Mug").physics, mass_kg=None))
    b = replace(a, bodies=(moved, *(body for body in a.bodies if body.id not in ("Mug", "Floor"))))
    found = diff(a, b)
    assert "\n" not in repr(found)
    text = str(found)
    assert "only in a: Floor" in text
    assert "Mug pose.position" in text
    assert f"translation_m {found.max_error['translation_m']:.4g}" in text
    assert "Mug" in found._repr_html_()
    many = diff(a, World(iri=Iri("http://example.org/empty")))
    assert len(str(many).splitlines()) < 60


def test_counted_formats_numbers_with_their_noun() -> None:
    assert [counted(n, "body") for n in (0, 1, 1200)] == ["0 bodies", "1 body", "1,200 bodies"]
