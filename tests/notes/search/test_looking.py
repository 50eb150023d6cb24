"""Patches of ground that are looked at, shared out among pages."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gcs_mosaic.notes.search.looking import LENT_S, Cell, GroundPatch, Looking, Place
from gcs_mosaic.notes.search.reviews import Question, ReviewedView, Reviews
from gcs_mosaic.notes.search.seen_ground import COUNT, StampedGround, is_as_seen
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.render.tile_grid import HALF_SPAN

GROUND: set[Cell] = {(x, y) for x in range(100, 117) for y in range(50, 61)}


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


class Helpers:
    """Some pages that ask for patches of one flight and look at them."""

    def __init__(self, book: NotesBook) -> None:
        self.clock = Clock()
        self.reviews = Reviews(book)
        self.looking = Looking(book, self.reviews, self.clock)

    def open(self) -> set[Cell]:
        whole = Question(island=0, box=(-HALF_SPAN, -HALF_SPAN, HALF_SPAN, HALF_SPAN), level=15)
        return GROUND - self.reviews.reviewed(whole, {})

    def ask(self, session: str, columns: int = 4, lines: int = 3, put_off: bool = False) -> GroundPatch | None:
        place = Place(session=session, who=session, island=0, columns=columns, lines=lines, put_off=put_off)
        return self.looking.next(place, self.open())

    def look(self, session: str) -> None:
        patch = self.looking.looked(session)
        assert patch is not None
        assert self.reviews.report(ReviewedView(0, patch.box, 16, 2.0, session)) == len(patch.cells())


def test_several_pages_look_at_all_of_it_and_at_nothing_twice(book: NotesBook) -> None:
    """Of different screens, in any order."""
    helpers, rng = Helpers(book), np.random.default_rng(1)
    pages = {"a": (4, 3), "b": (2, 7), "c": (9, 2)}
    looked: list[Cell] = []
    for _ in range(400):
        session = str(rng.choice(list(pages)))
        patch = helpers.ask(session, *pages[session])
        if patch is None:
            continue
        lent = [one.cells() for one in helpers.looking.lent()]
        assert sum(map(len, lent)) == len(set().union(*lent))
        if rng.random() < 0.6:
            looked += sorted(patch.cells() & helpers.open())
            helpers.look(session)
    assert sorted(looked) == sorted(GROUND)
    assert helpers.ask("a") is None


def test_a_page_that_goes_on_has_the_patch_that_it_had(book: NotesBook) -> None:
    helpers = Helpers(book)
    first = helpers.ask("a")
    assert helpers.ask("a") == first
    assert helpers.ask("b") != first


def test_the_patch_of_a_page_that_is_gone_is_lent_again_after_a_while(book: NotesBook) -> None:
    helpers = Helpers(book)
    first = helpers.ask("a")
    helpers.clock.now = LENT_S - 1
    assert helpers.looking.keep("a")
    helpers.clock.now = 2 * LENT_S - 2
    assert helpers.ask("b") != first
    helpers.looking.give_back("b")
    helpers.clock.now = 3 * LENT_S
    assert not helpers.looking.keep("a")
    assert helpers.ask("b") == replaced(first, "b")


def test_what_is_given_back_is_free_at_once(book: NotesBook) -> None:
    helpers = Helpers(book)
    first = helpers.ask("a")
    helpers.looking.give_back("a")
    assert helpers.ask("b") == replaced(first, "b")


def test_what_is_put_off_comes_again_once_nothing_else_is_left(book: NotesBook) -> None:
    helpers = Helpers(book)
    first = helpers.ask("a")
    assert first is not None
    assert helpers.ask("a", put_off=True) != first
    met = 0
    while (patch := helpers.ask("a")) is not None and patch != first:
        helpers.look("a")
        met += 1
    assert met > 5
    assert patch == first


def test_a_server_that_is_started_again_lends_nothing_twice(book: NotesBook) -> None:
    """For as long as pages from before may still be there."""
    before = Helpers(book)
    first = before.ask("a")
    before.reviews.flush()
    book.close()
    again = NotesBook(Path(book.root))
    helpers = Helpers(again)
    assert helpers.looking.lent() == [first]
    assert helpers.ask("b") != first
    assert helpers.ask("a") == first
    helpers.looking.give_back("b")
    helpers.clock.now = LENT_S + 1
    assert helpers.looking.lent() == []
    again.close()


def test_a_patch_is_no_wider_than_the_ground_in_it(book: NotesBook) -> None:
    """Which would lie in a corner of the screen else, beside nothing that can be looked at."""
    helpers = Helpers(book)
    for _ in range(40):
        patch = helpers.ask("a")
        if patch is None:
            break
        assert patch.cells() <= GROUND
        helpers.look("a")
    assert helpers.open() == set()


def test_somebody_goes_on_where_they_looked_last(book: NotesBook) -> None:
    helpers = Helpers(book)
    helpers.reviews.report(ReviewedView(0, box_of(112, 57, 2, 2), 16, 3.0, "a"))
    patch = helpers.ask("a", 3, 3)
    assert patch is not None
    assert min(abs(x - 113) + abs(y - 58) for x, y in patch.cells()) <= 2


def test_ground_over_which_something_was_painted_since_is_open_again(book: NotesBook) -> None:
    """By a newer frame, or by an older one that was placed late; not where one was taken away."""
    looked, now = (
        StampedGround(5, 9, np.array([[COUNT * count + newest for count, newest in cells]]))
        for cells in (((1, 3), (2, 6), (2, 6), (2, 6), (0, 0)), ((1, 3), (2, 7), (3, 6), (1, 6), (1, 2)))
    )
    reviews = Reviews(book)
    cells = {(5 + x, 9) for x in range(5)}
    reviews.report(ReviewedView(0, looked.box, 16, 2.0, "a", looked.within(cells)))
    for written in (False, True):
        if written:
            reviews.flush()
        assert reviews.open_in(now, 0, 16).tolist() == [[False, True, True, False, True]]
        assert reviews.open_in(now, 0, 17).all()
        whole = Question(island=0, box=looked.box, level=16)
        assert reviews.reviewed(whole, now.within(cells)) == {(5, 9), (8, 9)}


def test_of_looks_from_before_frames_were_counted_the_newest_is_known() -> None:
    looked, now = np.array([7, 7]), np.array([3 * COUNT + 7, COUNT + 8])
    assert is_as_seen(looked, now).tolist() == [True, False]


def box_of(x: int, y: int, columns: int, lines: int) -> tuple[float, float, float, float]:
    return GroundPatch(session="", who="", island=0, x=x, y=y, columns=columns, lines=lines).box


def replaced(patch: GroundPatch | None, session: str) -> GroundPatch:
    assert patch is not None
    x, y, columns, lines = patch.x, patch.y, patch.columns, patch.lines
    return GroundPatch(session=session, who=session, island=0, x=x, y=y, columns=columns, lines=lines)
