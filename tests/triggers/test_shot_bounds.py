"""Where messages begin and cease to be about one shot, and clocks and counters to be believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_mosaic.messages import CaptureResult, Source, TriggerEvent
from gcs_mosaic.triggers.clocks import DRIFT, OffsetClock, SourceClocks
from gcs_mosaic.triggers.conduct import Conduct, Pace
from gcs_mosaic.triggers.counters import Counters, StreamKey
from gcs_mosaic.triggers.doubts import NONE, Doubts
from gcs_mosaic.triggers.shifted_positions import shift_by_positions
from gcs_mosaic.triggers.shots import Better, Duplicate, New, ShotMerger, Shots, ShotSettings
from tests.factories import trigger_event
from tests.triggers.test_shots import AUTOPILOT, CAMERA, FEEDBACK, TRIGGER, told, verdicts


@pytest.mark.parametrize(("apart", "one"), [(1.0, True), (1.01, False)])
def test_two_sources_a_second_apart_tell_of_one_shot(apart: float, one: bool) -> None:
    assert verdicts(told(TRIGGER, 1, 10.0), told(CAMERA, 7, 10.0 + apart)) == [New(), Better(0) if one else New()]


def test_the_nearest_shot_in_time_is_meant() -> None:
    assert verdicts(told(TRIGGER, 1, 10.0), told(TRIGGER, 2, 10.9), told(CAMERA, None, 11.0)) == [
        New(),
        New(),
        Better(1),
    ]


@pytest.mark.parametrize(("late", "one"), [(30.0, True), (30.1, False)])
def test_by_its_counter_a_message_may_be_half_a_minute_late(late: float, one: bool) -> None:
    learnt = [told(source, seq, 2.0 * seq + 0.1 * source) for seq in range(5) for source in (FEEDBACK, CAMERA)]
    last = verdicts(*learnt, told(FEEDBACK, 5, 10.0), told(CAMERA, 5, 10.0 + late))[-1]
    assert last == (Better(10) if one else New())


@pytest.mark.parametrize(("late", "one"), [(60.0, True), (60.1, False)])
def test_without_times_a_number_is_repeated_for_a_minute(late: float, one: bool) -> None:
    first = told(TRIGGER, 0, -2.0), told(TRIGGER, 1, 0.0)
    assert verdicts(*first, told(TRIGGER, 1, late))[-1] == (Duplicate(1) if one else New())


@pytest.mark.parametrize(("late", "one"), [(3.0, True), (3.1, False)])
def test_a_message_comes_by_a_slower_link_so_much_later(late: float, one: bool) -> None:
    """The first shot of all: whether its time ever differs is not known."""
    first = told(TRIGGER, 0, 10.0, 70.0)
    first = replace(first, clock="epoch")
    assert verdicts(first, replace(first, received=10.0 + late))[-1] == (Duplicate(0) if one else New())


@pytest.mark.parametrize(("late", "one"), [(1.0, True), (1.1, False)])
def test_a_message_without_time_comes_twice_within_a_second(late: float, one: bool) -> None:
    first = told(TRIGGER, 0, 10.0)
    assert verdicts(first, replace(first, received=10.0 + late))[-1] == (Duplicate(0) if one else New())


@pytest.mark.parametrize("field", ["file_hint", "result"])
def test_what_tells_of_another_file_or_outcome_is_another_shot(field: str) -> None:
    first = replace(told(CAMERA, 1, 10.0, 70.0), file_hint="a.jpg", result=CaptureResult.TAKEN)
    other = replace(first, **{field: "b.jpg" if field == "file_hint" else CaptureResult.FAILED})  # type: ignore[arg-type]
    assert verdicts(first, other) == [New(), New()]
    assert verdicts(first, replace(first, file_hint=None)) == [New(), Duplicate(0)]


def test_a_time_that_differs_tells_of_another_shot() -> None:
    shots = [told(TRIGGER, 7, 10.0, 70.0), told(TRIGGER, 7, 10.5, 70.5)]
    assert verdicts(*shots) == [New(), New()]
    assert verdicts(shots[0], replace(shots[0], received=10.5, source_time=None, clock="none")) == [New(), New()]


@pytest.mark.parametrize(("streams", "one"), [(4, True), (5, False)])
def test_of_a_flood_time_does_not_tell_which_shot_is_meant(streams: int, one: bool) -> None:
    crowd = [replace(told(TRIGGER, n, 10.0 + 0.01 * n), component=2 + n, vehicle=1) for n in range(streams)]
    merger = ShotMerger()
    for number, message in enumerate(crowd):
        assert merger.add(number, message) == New()
    last = merger.add(99, told(CAMERA, None, 10.2))
    assert last == (Better(streams - 1) if one else New())


@pytest.mark.parametrize(("unproven", "joined"), [(3, True), (4, False)])
def test_a_proven_source_joins_no_crowd_of_unproven_shots(unproven: int, joined: bool) -> None:
    merger, credible = ShotMerger(), frozenset([told(CAMERA, None, 0.0).teller])
    for number in range(unproven):
        merger.add(number, told(TRIGGER, number, 10.0 + 0.2 * number))
    last = merger.add(9, told(CAMERA, None, 10.1), credible)
    assert last == (Better(0) if joined else New())


def test_only_the_last_sixteen_shots_are_recent() -> None:
    shots = [told(TRIGGER, n, 10.0 + 0.01 * n) for n in range(17)]
    merger = ShotMerger(ShotSettings(window_s=0.0))
    for number, message in enumerate(shots):
        merger.add(number, message)
    assert merger.add(90, told(AUTOPILOT, 101, 10.16)) == Better(16)
    assert merger.add(91, told(AUTOPILOT, 102, 10.01)) == Better(1)
    assert merger.add(92, told(AUTOPILOT, 103, 10.0)) == New()


def test_messages_are_remembered_per_source_and_no_longer() -> None:
    merger = ShotMerger(ShotSettings(remembered=4))
    shots = [told(TRIGGER, n, 2.0 * n, 50 + 2.0 * n) for n in range(6)]
    for number, message in enumerate(shots):
        assert merger.add(number, message) == New()
    assert merger.add(90, replace(shots[2], received=12.0)) == Duplicate(2)
    assert merger.add(91, replace(shots[1], received=12.0)) == New()


def test_aircraft_are_told_apart_and_those_heard_last_remembered() -> None:
    shots = Shots(ShotSettings())
    first = replace(told(TRIGGER, 5, 0.0, 60.0), vehicle=1)
    shots.hear(first)
    for vehicle in range(2, 33):
        assert shots.hear(replace(first, vehicle=vehicle)).verdict == New()
    assert shots.hear(first).verdict == Duplicate(1)  # which makes it the one heard last
    shots.hear(replace(first, vehicle=33))
    assert shots.hear(first).verdict == Duplicate(1)
    assert isinstance(shots.hear(replace(first, vehicle=2)).verdict, New)


def message(at: float, sequence: int | None = 1, **fields: object) -> TriggerEvent:
    return trigger_event(sequence, at, **fields)


def test_a_counter_that_has_moved_tells_shots_apart_until_it_is_repeated_too_often() -> None:
    conduct = Conduct()
    assert not conduct.tells_by("sequence")
    conduct.shot(message(0.0, 1))
    conduct.shot(message(5.0, 2))
    for repeat in range(2):
        conduct.repeated(message(7.0 + 2 * repeat, 2), 1.0)
        conduct.repeated(message(7.5 + 2 * repeat, 2), 1.0)  # by another way
        assert conduct.tells_by("sequence")
    conduct.repeated(message(20.0, 2), 1.0)
    assert not conduct.tells_by("sequence")
    conduct.repeated(message(22.0, 1), 1.0)  # of the shot before: they do not follow one another
    assert conduct.tells_by("sequence")
    for repeat in range(9):
        conduct.repeated(message(30.0 + 2 * repeat, 2), 1.0)
    assert not conduct.tells_by("sequence")
    conduct.shot(message(60.0, 3))
    conduct.shot(message(65.0, 4))
    for repeat in range(9):
        conduct.repeated(message(70.0 + 2 * repeat, 4), 1.0)
    assert conduct.tells_by("sequence")  # it has moved three times


@pytest.mark.parametrize(("count", "stuck", "faults"), [(1, False, []), (2, True, []), (3, True, ["counter", "time"])])
def test_after_two_shots_a_counter_is_stuck_and_after_three_it_is_said(
    count: int, stuck: bool, faults: list[str]
) -> None:
    conduct = Conduct()
    for number in range(count):
        conduct.shot(message(5.0 * number))
    assert conduct.is_stuck is stuck
    assert [kind for kind, _ in conduct.faults()] == faults


def test_of_a_sender_that_counts_and_dates_nothing_is_said() -> None:
    conduct = Conduct()
    for number in range(4):
        conduct.shot(message(5.0 * number, number, source_time=50.0 + number if number < 3 else None))
    assert [*conduct.faults()] == []


def pace(*told_at: tuple[float, float], offset: float = 0.0) -> str | None:
    clock = Pace()
    for source_time, received in told_at:
        clock.heard(source_time, received, offset, jumped=False)
    return clock.fault()


@pytest.mark.parametrize(
    ("rate", "steps", "fault"),
    [
        (0.5, 4, "goes 0.5 s in a second"),
        (0.5, 2, None),  # two intervals tell too little
        (0.85, 9, None),  # a queue that grows
        (0.79, 9, "goes 0.79 s in a second"),
        (0.0, 9, "goes backwards or stands still"),
        (-1.0, 9, "goes backwards or stands still"),
        (1.0, 9, None),
    ],
)
def test_a_clock_goes_a_second_in_a_second(rate: float, steps: int, fault: str | None) -> None:
    assert pace(*((1000 + rate * 5 * k, 5.0 * k) for k in range(steps + 1))) == fault


def test_a_slow_clock_is_one_once_it_is_four_seconds_behind() -> None:
    assert pace(*((0.5 * k, 1.0 * k) for k in range(9))) is None
    assert pace(*((0.5 * k, 1.0 * k) for k in range(10))) is not None


@pytest.mark.parametrize(("went", "passed", "still"), [(0.04, 1.1, True), (0.04, 1.0, False), (0.06, 1.1, False)])
def test_a_clock_that_does_not_go_for_more_than_a_second_stands_still(went: float, passed: float, still: bool) -> None:
    assert pace((100.0, 10.0), (100.0 + went, 10.0 + passed)) == ("stands still" if still else None)
    assert pace((100.0, 10.0)) is None


@pytest.mark.parametrize(("jumps", "fault"), [(2, None), (3, "jumps")])
def test_a_clock_that_jumps_three_times_is_none(jumps: int, fault: str | None) -> None:
    clock = Pace()
    for k in range(12):
        clock.heard(5.0 * k, 5.0 * k, 0.0, jumped=k < jumps)
    assert clock.fault() == fault
    clock.heard(60.0, 60.0, 0.0, jumped=False)  # of twelve
    assert clock.fault() is None


def test_a_delayed_message_moves_no_clock_and_two_alike_do() -> None:
    clock = OffsetClock()
    clock.moment(0.0, 100.0)
    assert clock.moment(10.0, 118.0) == pytest.approx(110.0, abs=0.01)
    clock.moment(20.0, 128.4)  # as late as the one before, to half a second, and a second later: the clock was set back
    assert clock.moment(30.0, 138.0) == pytest.approx(138.0, abs=0.5)


@pytest.mark.parametrize(("apart", "alike", "leaps"), [(1.0, 0.0, True), (0.9, 0.0, False), (5.0, 0.51, False)])
def test_two_late_messages_agree_if_they_came_apart(apart: float, alike: float, leaps: bool) -> None:
    clock = OffsetClock()
    clock.moment(0.0, 100.0)
    clock.moment(10.0, 120.0)
    clock.moment(10.0 + apart, 120.0 + apart + alike)
    assert clock.offset == pytest.approx(110.0 + alike if leaps else 100.0, abs=0.01)


def test_an_offset_drifts_upwards_by_what_quartz_does() -> None:
    clock = OffsetClock()
    clock.moment(0.0, 100.0)
    assert clock.moment(1000.0, 1101.0) == pytest.approx(1100.0 + 1000 * DRIFT, abs=0.002)
    assert clock.moment(1001.0, 1100.0) == 1100.0  # by one that was quicker it falls at once


def test_only_so_many_clocks_are_remembered() -> None:
    clocks = SourceClocks()
    for component in range(70):
        clocks.moment(message(10.0, 1, source_time=5.0, clock="boot", component=component))
    assert len(clocks._clocks) == 64
    assert clocks.moment(message(10.0, 1, source_time=5.0)) == 10.0  # of no clock
    assert clocks.moment(message(20.0, 1, source_time=5.0, clock="boot", component=200, latest=12.0)) == 12.0


def key(source: Source, vehicle: int = 1) -> StreamKey:
    return StreamKey(vehicle, 1, 0, source)


def counted(*heard: tuple[Source, int, float]) -> Counters:
    counters = Counters(1.0)
    for source, sequence, moment in heard:
        counters.heard(key(source), sequence, moment)
    return counters


BOTH = [(source, seq + 5 * (source is CAMERA), 2.0 * seq) for seq in range(4) for source in (FEEDBACK, CAMERA)]


def test_the_offset_of_two_counters_is_known_both_ways() -> None:
    counters = counted(*BOTH)
    assert counters.expected(key(CAMERA), 20) == {key(FEEDBACK): 15}
    assert counters.expected(key(FEEDBACK), 15) == {key(CAMERA): 20}
    assert counted(*BOTH[:6]).expected(key(CAMERA), 20) == {}
    counters.forget(key(FEEDBACK))
    assert counters.expected(key(CAMERA), 20) == {}


@pytest.mark.parametrize(("sequence", "known"), [(9, True), (8, False), (1, False)])
def test_a_counter_that_does_not_go_on_has_begun_anew(sequence: int, known: bool) -> None:
    counters = counted(*BOTH, (CAMERA, sequence, 100.0))
    assert bool(counters.expected(key(FEEDBACK), 3)) is known


def test_counters_too_far_apart_in_time_or_of_other_aircraft_have_nothing_to_do_with_each_other() -> None:
    apart = [(source, seq, 4.0 * seq + 1.1 * (source is CAMERA)) for seq in range(6) for source in (FEEDBACK, CAMERA)]
    assert counted(*apart).expected(key(CAMERA), 3) == {}
    near = [(source, seq, 4.0 * seq + 1.0 * (source is CAMERA)) for seq in range(6) for source in (FEEDBACK, CAMERA)]
    assert counted(*near).expected(key(CAMERA), 3) == {key(FEEDBACK): 3}
    counters = Counters(1.0)
    for seq in range(6):
        counters.heard(key(FEEDBACK, vehicle=2), seq, 2.0 * seq)
        counters.heard(key(CAMERA), seq, 2.0 * seq)
    assert counters.expected(key(CAMERA), 3) == {}


def spiral(count: int) -> list[complex]:
    """Places of a map on which no shift fits like another."""
    return [complex(30 * k * np.cos(0.7 * k), 30 * k * np.sin(0.7 * k)) for k in range(count)]


def degrees(places: list[complex]) -> list[tuple[float, float] | None]:
    return [(44.0 - one.imag / 111_320, 7.0 + one.real / 111_320 / np.cos(np.radians(44))) for one in places]


@pytest.mark.parametrize("shift", [-2, -1, 0, 1, 2])
def test_positions_tell_by_how_many_shots_pictures_are_shifted(shift: int) -> None:
    spots = spiral(20)
    places: list[complex | None] = [spots[k + shift] * 3 if 0 <= k + shift < 20 else None for k in range(20)]
    assert shift_by_positions(degrees(spots), places) == shift


@pytest.mark.parametrize(("count", "told"), [(8, None), (9, 0), (3, None), (1, None)])
def test_positions_of_few_shots_tell_nothing(count: int, told: int | None) -> None:
    """Of eight pairs a similarity is found, and of one shift more."""
    spots = spiral(count)
    assert shift_by_positions(degrees(spots), list(spots)) == told


def test_positions_on_a_straight_line_or_in_one_place_or_unknown_tell_nothing() -> None:
    line = [complex(20.0 * k, 0) for k in range(20)]
    assert shift_by_positions(degrees(line), list(line)) is None
    assert shift_by_positions(degrees([0j] * 20), [0j] * 20) is None
    assert shift_by_positions([None] * 20, spiral(20)) is None
    small = [one / 3000 for one in spiral(20)]
    assert shift_by_positions(degrees(small), list(small)) is None  # all lie within a metre


def test_a_position_that_is_far_off_does_no_harm() -> None:
    spots = spiral(20)
    wrong = degrees(spots)
    wrong[3], wrong[9] = (44.5, 7.5), None
    assert shift_by_positions(wrong, [*spots[1:], None]) == 1


@pytest.mark.parametrize(
    ("doubts", "told"),
    [
        (
            Doubts((1,), 3, 4),
            "3 pictures of 4: each may as well belong 1 shot later; gcs-mosaic pair DIR --shift 1 chooses",
        ),
        (Doubts((-2, 1), 1, 4), "1 picture of 4: each may as well belong 2 shots earlier or 1 shot later; "),
        (Doubts((-2, 1), 1, 4), "gcs-mosaic pair DIR --shift -2 or --shift 1 chooses that"),
        (Doubts((-2, -1, 1, 2, 3), 4, 4), "belong to another shot, from 2 shots earlier to 3 shots later; "),
        (Doubts((-2, -1, 1, 2, 3), 4, 4), "gcs-mosaic pair DIR --shift N chooses that"),
        (Doubts((), 2, 4), "some were lost, and neither names nor times tell which"),
        (Doubts((), 2, 4, is_part=True), "Which triggers 2 pictures belong to is ambiguous, and they have none"),
    ],
)
def test_what_is_in_doubt_is_said(doubts: Doubts, told: str) -> None:
    assert told in doubts.text()
    assert doubts
    assert not NONE


@pytest.mark.parametrize(("ahead", "jumped"), [(5.0, False), (5.5, True)])
def test_a_clock_that_is_further_ahead_than_any_delay_has_jumped(ahead: float, jumped: bool) -> None:
    clock = OffsetClock()
    clock.moment(0.0, 100.0)
    clock.moment(ahead, 100.0)
    assert [*clock.paces[0]._jumps] == [False, jumped]
    assert clock.offset == 100.0 - ahead
