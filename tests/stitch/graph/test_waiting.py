"""Who waits is asked again when there is new ground, the longest unasked first."""

from gcs_mosaic.stitch.graph.waiting import TURN_AFTER, WaitingFrames


def placed(waiting: WaitingFrames, *frames: int) -> None:
    for frame in frames:
        waiting.note_placed(frame)


def test_nobody_has_a_turn_before_there_is_enough_new() -> None:
    waiting = WaitingFrames()
    waiting.add(0)
    placed(waiting, *range(1, TURN_AFTER))
    assert waiting.next_turn() is None
    placed(waiting, TURN_AFTER)
    assert waiting.next_turn() == (0, list(range(1, TURN_AFTER + 1)))
    assert waiting.next_turn() is None


def test_turns_go_to_whoever_has_most_new_ground() -> None:
    waiting = WaitingFrames()
    waiting.add(0)
    placed(waiting, 1)
    waiting.add(2)
    placed(waiting, *range(3, 3 + TURN_AFTER))
    turns = waiting.next_turn(), waiting.next_turn()
    assert [turn[0] for turn in turns if turn] == [0, 2]
    assert waiting.next_turn() is None


def test_a_join_makes_all_ground_new_again() -> None:
    waiting = WaitingFrames()
    placed(waiting, *range(TURN_AFTER))
    waiting.add(50)
    assert waiting.take_new(50) == []
    waiting.forget_comparisons()
    assert waiting.take_new(50) == list(range(TURN_AFTER))


def test_who_has_found_a_place_waits_no_more() -> None:
    waiting = WaitingFrames()
    waiting.add(3)
    waiting.add(5)
    waiting.remove(3)
    waiting.remove(4)
    assert list(waiting) == [5]
    assert 3 not in waiting
    assert len(waiting) == 1
