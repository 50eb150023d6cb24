"""What was reviewed, by whom, at which zoom."""

from __future__ import annotations

import pytest

from gcs_mosaic.notes.search import reviews as module
from gcs_mosaic.notes.search.reviews import Question, ReviewedView, Reviews, cells_within
from gcs_mosaic.notes.search.seen_ground import CELL, COUNT, seen_cells
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.notes.storage.checked import Unfit
from gcs_mosaic.render.tile_grid import HALF_SPAN, Box
from gcs_mosaic.views.flight_view import FlightView

BOX: Box = (0.0, 0.0, 512.0, 256.0)


def look(who: str, box: Box = BOX, level: int = 16, seconds: float = 1.0) -> ReviewedView:
    return ReviewedView(0, box, level, seconds, who)


def test_a_cell_counts_when_its_middle_was_in_view() -> None:
    first = int(HALF_SPAN / CELL)
    assert cells_within((0.0, 0.0, 2 * CELL, CELL)) == [(first, first), (first + 1, first)]
    assert cells_within((0.4 * CELL, 0.0, 0.6 * CELL, CELL)) == [(first, first)]
    assert cells_within((0.6 * CELL, 0.0, CELL, CELL)) == []


@pytest.mark.parametrize("written", [False, True])
def test_two_review_at_once_each_at_a_zoom_for_some_seconds(book: NotesBook, written: bool) -> None:
    reviews = Reviews(book)
    left, right = (0.0, 0.0, 256.0, 256.0), (256.0, 0.0, 512.0, 256.0)
    assert reviews.report(look("Kim", left, level=17)) == 4
    reviews.report(look("Kim", left, level=17))
    reviews.report(look("Lou", right, level=15))
    if written:
        reviews.flush()
        reviews = Reviews(book)
    asked = {
        "anybody": Question(island=0, box=BOX, level=15),
        "fine": Question(island=0, box=BOX, level=16),
        "Lou": Question(island=0, box=BOX, level=0, who="Lou"),
        "long": Question(island=0, box=BOX, level=0, seconds=1.5),
        "later": Question(island=0, box=BOX, level=0, since_utc=4e9),
        "island": Question(island=1, box=BOX, level=0),
    }
    found = {name: len(reviews.reviewed(question, {})) for name, question in asked.items()}
    assert found == {"anybody": 8, "fine": 4, "Lou": 4, "long": 4, "later": 0, "island": 0}
    assert reviews.reviewers().keys() == {"Kim", "Lou"}


ONE: Box = (0.0, 0.0, CELL, CELL)
AT = (int(HALF_SPAN / CELL),) * 2


def stamped(stamp: int, seconds: float, who: str = "Kim") -> ReviewedView:
    return ReviewedView(0, ONE, 16, seconds, who, {AT: stamp})


@pytest.mark.parametrize("written", [False, True])
def test_seconds_of_what_was_there_before_are_not_those_of_what_came(book: NotesBook, written: bool) -> None:
    """Nobody's: neither one person's earlier look nor another's."""
    reviews, before, now = Reviews(book), COUNT + 3, 2 * COUNT + 4

    def report(look: ReviewedView) -> None:
        reviews.report(look)
        if written:
            reviews.flush()

    for look in (stamped(before, 5.0), stamped(now, 0.5), stamped(before, 5.0, "Lou")):
        report(look)
    for seconds, cells in ((0.5, {AT}), (1.0, set())):
        assert reviews.reviewed(Question(island=0, box=ONE, level=16, seconds=seconds), {AT: now}) == cells
    report(stamped(now, 0.5))
    assert reviews.reviewed(Question(island=0, box=ONE, level=16, seconds=1.0), {AT: now}) == {AT}
    assert reviews.reviewed(Question(island=0, box=ONE, level=16, seconds=6.0), {AT: before}) == {AT}


def test_from_far_away_nobody_reviews(book: NotesBook) -> None:
    reviews = Reviews(book)
    assert reviews.report(look("Kim", (-1e6, -1e6, 1e6, 1e6))) == 0
    assert reviews.reviewers() == {}


def test_it_is_bounded(book: NotesBook, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_REVIEWERS", 2)
    monkeypatch.setattr(module, "MOST_ROWS", 4)
    reviews = Reviews(book)
    reviews.report(look("Kim", (0.0, 0.0, 128.0, 128.0)))
    reviews.report(look("Lou", (0.0, 0.0, 128.0, 128.0)))
    with pytest.raises(Unfit, match="2 people"):
        reviews.report(look("Max"))
    reviews.report(look("Lou"))
    with pytest.raises(Unfit, match="No more"):
        reviews.report(look("Lou"))


def test_ground_that_was_painted_is_told_in_cells(view: FlightView) -> None:
    seen = seen_cells(view.table(), 1, (-1000.0, -1000.0, 1000.0, 1000.0))
    middle = int(HALF_SPAN / CELL)
    assert {x - middle for x, _ in seen} == {-2, -1, 0, 1}
    assert {y - middle for _, y in seen} == {-2, -1, 0, 1}  # 300 high: of the outer ones a strip
    with pytest.raises(Unfit):
        seen_cells(view.table(), 1, (-1e6, -1e6, 1e6, 1e6))
