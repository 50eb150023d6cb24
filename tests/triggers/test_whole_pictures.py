"""Events of shots whose file comes twice: a preview first, or the same picture once more."""

from __future__ import annotations

from dataclasses import replace

from gcs_mosaic.triggers import Matched, Orphan, Unmatched
from tests.sure import sure
from tests.triggers.test_matcher import Flight, file, shot


def test_the_event_of_a_preview_goes_over_to_the_whole_picture() -> None:
    flight = Flight().fly((1, shot(0.0)), file(1.0, "a.jpg"))
    flight.outcomes += flight.pairing.whole_of("a.jpg", file(2.5, "a.jpg#2"))
    flight.fly((2, shot(2.6)), file(4.0, "b.jpg"))
    assert flight.pairs() == {1: "a.jpg#2", 2: "b.jpg"}
    assert flight.pairing.accounts().orphans == 0


def test_a_whole_picture_of_what_is_not_known_or_has_no_event_is_an_orphan_at_most() -> None:
    flight = Flight().fly(file(1.0, "a.jpg"))
    assert flight.pairing.whole_of("x.jpg", file(2.0, "x.jpg#2")) == []
    whole = file(2.0, "a.jpg#2")
    assert flight.pairing.whole_of("a.jpg", whole) == [Orphan(replace(whole, received=1.0))]


def test_what_was_no_frame_of_its_own_gives_its_event_back() -> None:
    flight = Flight().fly((1, shot(0.0)), file(1.0, "a.jpg"), (2, shot(2.0)), file(2.5, "a.jpg#2"))
    assert flight.pairs() == {1: "a.jpg", 2: "a.jpg#2"}
    given_back = flight.pairing.withdraw("a.jpg#2")
    assert [type(one) for one in given_back] == [Unmatched]
    flight.outcomes += given_back
    flight.fly(file(3.0, "b.jpg"))
    assert flight.pairs() == {1: "a.jpg", 2: "b.jpg"}
    assert flight.pairing.withdraw("a.jpg#2") == []
    assert flight.pairing.accounts().frames == 2
    assert not [one for one in given_back if isinstance(one, Matched)]


def test_an_event_that_names_a_copy_is_about_the_frame_that_came_first() -> None:
    """Before the copy and after it, whatever the times had said."""
    flight = Flight().fly((1, shot(0.0, hint="a.jpg")), file(1.0, "upload-1.jpg"), file(3.0, "upload-2.jpg"))
    flight.outcomes += sure(flight.pairing.also_called("upload-1.jpg", "a.jpg"))
    flight.outcomes += sure(flight.pairing.also_called("upload-2.jpg", "b.jpg"))
    flight.fly((2, shot(4.0, hint="b.jpg")), (3, shot(30.0)), file(31.0, "upload-3.jpg"), (4, shot(31.5, hint="c.jpg")))
    assert flight.pairs() == {1: "upload-1.jpg", 2: "upload-2.jpg", 3: "upload-3.jpg"}
    flight.outcomes += sure(flight.pairing.also_called("upload-3.jpg", "c.jpg"))
    assert flight.pairs() == {1: "upload-1.jpg", 2: "upload-2.jpg", 4: "upload-3.jpg"}
    assert flight.pairing.accounts().orphans == 0


def test_copies_take_no_event_from_a_frame_that_it_names_and_are_not_all_remembered() -> None:
    flight = Flight().fly((1, shot(0.0, hint="a.jpg")), file(1.0, "a.jpg"))
    assert flight.pairing.also_called("a.jpg", "a.jpg") == []
    assert flight.pairing.also_called("unknown.jpg", "b.jpg") == []
    assert not any(flight.pairing.also_called("a.jpg", f"copy {number}.jpg") for number in range(20))
    flight.fly((2, shot(50.0, hint="copy 19.jpg")))
    assert flight.pairs() == {1: "a.jpg"}
