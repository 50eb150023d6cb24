from __future__ import annotations

from gcs_mosaic.triggers.counters import OffsetVotes


def after(*votes: int) -> int | None:
    learnt = OffsetVotes()
    for vote in votes:
        learnt.vote(vote)
    return learnt.offset


def test_a_few_pairs_may_be_chance() -> None:
    assert after(5, 5, 5) is None
    assert after(5, 6, 5, 6, 5, 6) is None
    assert after(5, 6, 5, 5, 5) == 5


def test_what_has_proven_itself_is_not_moved_by_a_few_late_messages() -> None:
    assert after(5, 5, 5, 5, 6, 6, 6) == 5
    assert after(5, 5, 5, 5, 6, 6, 5, 6) == 5


def test_four_in_a_row_move_it() -> None:
    assert after(5, 5, 5, 5, 6, 6, 6, 6) == 6


def test_counters_that_no_longer_go_together_are_not_relied_on() -> None:
    assert after(5, 5, 5, 5, 6, 7, 8, 9, 10) is None


def test_what_is_certain_needs_no_votes() -> None:
    learnt = OffsetVotes()
    learnt.settle(5)
    assert learnt.offset == 5
