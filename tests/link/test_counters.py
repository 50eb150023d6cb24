from __future__ import annotations

from gcs_mosaic.link.counters import OffsetVotes


def after(*votes: int) -> int | None:
    learnt = OffsetVotes()
    for vote in votes:
        learnt.vote(vote)
    return learnt.offset


def test_one_pair_may_be_chance() -> None:
    assert after(5) is None
    assert after(5, 6, 5) is None
    assert after(5, 5) == 5


def test_what_has_proven_itself_is_not_moved_by_two_late_messages() -> None:
    assert after(5, 5, 6, 6) == 5
    assert after(5, 5, 6, 6, 5, 6, 6) == 5


def test_three_in_a_row_move_it() -> None:
    assert after(5, 5, 6, 6, 6) == 6
    assert after(5, 5, 6, 7, 8) == 5
