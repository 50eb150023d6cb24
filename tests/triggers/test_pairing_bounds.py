"""Where what is known of events and frames begins and ceases to count."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gcs_mosaic.messages import CaptureResult, Source, Teller
from gcs_mosaic.triggers import How, Matched, Missing, Orphan, PairingSettings, stretch
from gcs_mosaic.triggers.candidates import FrameSearch, keys_of
from gcs_mosaic.triggers.counters import StreamKey
from gcs_mosaic.triggers.credibility import Credibility
from gcs_mosaic.triggers.delay import UsualDelay
from gcs_mosaic.triggers.index import Index, PendingEvent, PendingFrame, State
from gcs_mosaic.triggers.names import numbers_in, stem_of
from gcs_mosaic.triggers.sequence_offsets import Learnt
from gcs_mosaic.triggers.stretch import is_odd, may_change
from tests.factories import frame, trigger_event
from tests.triggers.test_matcher import Flight, file, shot

SETTINGS = PairingSettings()
NEAR, FAR = SETTINGS.window_s, SETTINGS.window_s + 0.01


def event(number: int = 0, at: float = 0.0, hint: str | None = None) -> PendingEvent:
    told = trigger_event(received=at, file_hint=hint)
    held = PendingEvent(number, told, at, at, tellers=[told.teller])
    held.hints += [(told.teller, hint)] if hint else []
    return held


def picture(name: str = "a.jpg", at: float = 0.0, *, fresh: bool = True, captured: float | None = None) -> PendingFrame:
    return PendingFrame(frame(name, at, captured=captured), numbers_in(name), fresh)


class Held:
    """Events and frames that are held, and what searches them."""

    def __init__(self, *held: PendingEvent | PendingFrame) -> None:
        self.events, self.frames = Index[PendingEvent](50), Index[PendingFrame](50)
        self.search = FrameSearch(self.events, self.frames, SETTINGS)
        for one in held:
            if isinstance(one, PendingEvent):
                self.events.put(one, [key for _, hint in one.hints for key in keys_of(hint)])
            else:
                self.frames.put(one, keys_of(one.frame.path.name))


@pytest.mark.parametrize(("late", "found"), [(NEAR, True), (FAR, False), (-2.0, True), (-2.01, False)])
def test_by_time_a_file_comes_so_long_before_or_after_its_shot(late: float, found: bool) -> None:
    shown, came = event(at=100.0), picture(at=100.0 + late)
    assert (Held(shown).search.event_by_time(came) is shown) is found
    assert (Held(came).search.frame_by_time(shown) is came) is found


def test_while_the_usual_delay_is_unknown_the_oldest_event_and_the_nearest_frame_are_taken() -> None:
    first, second = event(0, at=1.0), event(1, at=4.0)
    assert Held(first, second).search.event_by_time(picture(at=5.0)) is first
    late, later = picture("a.jpg", 2.0), picture("b.jpg", 9.0)
    assert Held(late, later).search.frame_by_time(first) is late


@pytest.mark.parametrize(("early", "found"), [(10.0, True), (10.01, False)])
@pytest.mark.parametrize("fresh", [True, False])
def test_a_message_that_names_a_file_comes_so_much_later_than_it(early: float, found: bool, fresh: bool) -> None:
    """What was there at the start has come at any time."""
    named, came = event(at=100.0, hint="a.jpg"), picture("a.jpg", 100.0 - early, fresh=fresh)
    assert (Held(named).search.naming(came) is named) is (found or not fresh)
    assert (Held(came).search.named(named) is came) is (found or not fresh)


@pytest.mark.parametrize("state", list(State))
def test_a_name_finds_every_event_but_one_that_failed(state: State) -> None:
    named = event(hint="a.jpg")
    named.state = state
    assert (Held(named).search.naming(picture("a.jpg")) is named) is (state is not State.FAILED)


def test_an_event_that_a_name_has_settled_is_not_named_again() -> None:
    named, came, other = event(hint="a.jpg"), picture("a.jpg"), picture("a.png")
    named.how, named.frame, came.event = How.NAME, came, named
    assert Held(named).search.naming(other) is None
    assert Held(came, other).search.named(named) is None
    named.frame, other.event = other, named  # only a companion has it: the file itself comes before
    assert Held(named).search.naming(came) is named


def test_where_names_are_reliable_an_event_that_names_another_file_is_not_matched_otherwise() -> None:
    named, plain, came = event(0, hint="z.jpg"), event(1, at=3.0), picture("a.jpg", 5.0)
    held = Held(named, plain)
    assert held.search.event_by_time(came) is named
    held.search.learnt.names_work = True
    assert held.search.event_by_time(came) is plain


@pytest.mark.parametrize(
    ("apart", "odd"), [((5, 5, 5, 5), False), ((5, 5, 7, 8), True), ((5, 5, 5, 8), False), ((5, 5, 5, 6, 4), False)]
)
def test_a_stretch_is_odd_if_two_pairs_differ_by_the_cameras_clock(apart: tuple[float, ...], odd: bool) -> None:
    shots = []
    for number, off in enumerate(apart):
        held = event(number, at=10.0 * number)
        held.frame = picture(f"{number}.jpg", captured=10.0 * number + off)
        shots.append(held)
    assert is_odd(shots) is odd
    assert not is_odd(shots[-3:])
    assert not is_odd([*shots[-3:], event(9)])


@pytest.mark.parametrize("how", [None, *How])
def test_what_a_name_or_a_request_has_settled_is_not_changed(how: How | None) -> None:
    held, came = event(), picture()
    held.how, held.frame, came.event = how, came, held if how else None
    may = how in (None, How.TIME, How.SEQUENCE)
    assert may_change(held) is may
    assert may_change(came) is may
    came.fresh = False
    assert not may_change(came)
    held.state = State.FAILED
    assert not may_change(held)


def test_an_index_gives_up_the_oldest_beyond_its_room() -> None:
    index = Index[PendingEvent](2)
    first, second, third = (event(number) for number in range(3))
    index.put(first, ["a", "b"])
    index.put(second, ["a"])
    assert index.overflow() == []
    index.put(first, ["c"])  # known already: it stays the oldest
    index.put(third, ["a", "a"])
    assert index.overflow() == [first]
    assert (index.evicted, first in index, third in index) == (1, False, True)
    assert [*index.under("a")] == [third, second]
    assert [*index.under("b")] == [*index.under("c")] == []
    assert ([*index.oldest_first()], [*index.newest_first()]) == ([second, third], [third, second])


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("IMG_0042.JPG", {("img_#", 0): 42}),
        ("7x8", {("#x#", 0): 7, ("#x#", 1): 8}),
        ("a123456789012.jpg", {("a#", 0): 123456789012}),
        ("a1234567890123-5.jpg", {("a#-#", 1): 5}),
        ("1_2_3_4_5_6_7.jpg", {("#_#_#_#_#_#_#", place): place + 2 for place in range(6)}),
        (".7", {("#", 0): 7} if stem_of(".7") == "7" else {(".#", 0): 7}),
    ],
)
def test_the_numbers_of_a_name(name: str, numbers: dict[tuple[str, int], int]) -> None:
    assert numbers_in(name) == numbers


def learnt(*pairs: tuple[int, str], by_name: bool = False) -> Learnt:
    found = Learnt()
    for count, name in pairs:
        held = event()
        held.counts = [(STREAM, count)]
        (found.named if by_name else found.vote)(held, picture(name))
    return found


STREAM = StreamKey(1, 1, 0, Source.CAMERA_TRIGGER)


def test_the_offset_of_a_number_is_learnt_by_four_pairs_or_by_two_names() -> None:
    pairs = [(count, f"IMG_{count + 7:04}.JPG") for count in range(4)]
    assert learnt(*pairs[:3]).offset(STREAM) is None
    assert learnt(*pairs).offset(STREAM) == 7
    assert not learnt(*pairs).names_work
    assert learnt(pairs[0], by_name=True).offset(STREAM) is None
    assert learnt(*pairs[:2], by_name=True).offset(STREAM) == 7
    assert learnt(*pairs[:2], by_name=True).names_work


def test_a_number_or_counter_that_stays_the_same_tells_nothing() -> None:
    assert learnt(*[(count, "IMG_7.JPG") for count in range(6)]).offset(STREAM) is None
    assert learnt(*[(3, f"IMG_{number}.JPG") for number in range(6)]).offset(STREAM) is None


def test_a_number_contradicts_if_no_counter_agrees_with_it() -> None:
    known = learnt(*[(count, f"IMG_{count + 7:04}.JPG") for count in range(4)])
    held = event()
    held.counts = [(STREAM, 20)]
    other = STREAM._replace(component=100)
    assert not known.contradicts(held, picture("IMG_0027.JPG"))
    assert known.contradicts(held, picture("IMG_0028.JPG"))
    assert not known.contradicts(held, picture("DSC_0028.JPG"))
    held.counts = [(other, 20)]
    assert not known.contradicts(held, picture("IMG_0028.JPG"))


def test_only_so_many_rulers_are_remembered() -> None:
    known = learnt(*[(count, f"IMG_{count + 7:04}.JPG") for count in range(4)])
    for number in range(256):
        assert known.offset(STREAM) == 7
        held = event()
        held.counts = [(STREAM._replace(component=2 + number), 5)]
        known.vote(held, picture("X_1.JPG"))
    assert known.offset(STREAM) is None


def usual() -> UsualDelay:
    return UsualDelay(SETTINGS.early_s, SETTINGS.window_s, SETTINGS.spread_s)


def test_the_first_delay_is_that_to_the_oldest_shot_in_reach() -> None:
    """A slow link is likelier than a lost first picture."""
    delay = usual()
    delay.shot(0.0)
    delay.shot(3.0)
    delay.file(14.9)
    assert delay.value == pytest.approx(14.9)
    delay = usual()
    delay.shot(0.0)
    delay.shot(3.0)
    delay.file(15.1)
    assert delay.value == pytest.approx(12.1)
    delay = usual()
    delay.shot(10.0)
    delay.file(7.9)
    assert delay.value is None
    delay.file(8.1)
    assert delay.value == pytest.approx(-1.9)


def test_how_far_from_the_usual_delay_a_file_may_come() -> None:
    delay = usual()
    assert (delay.tolerance_s, delay.usual_gap_s, delay.shots) == (4.0, 0.0, 0)
    for moment in (0.0, 3.0, 6.0, 9.0):
        delay.shot(moment)
        delay.file(moment + 1)
    assert (delay.tolerance_s, delay.usual_gap_s, delay.shots) == (1.5, 3.0, 4)
    delay = usual()
    for moment in (0.0, 30.0, 60.0):
        delay.shot(moment)
        delay.file(moment + 1)
    assert delay.tolerance_s == 4.0


def test_a_source_agrees_by_the_files_that_its_shots_explain() -> None:
    delay = usual()
    assert delay.agreement() == 0.0
    for moment in range(0, 50, 5):
        delay.shot(float(moment))
        delay.file(moment + 2.0)
    assert delay.agreement() == pytest.approx(10.0)
    for moment in range(0, 50, 5):
        delay.shot(moment + 0.4)  # as many again that bring none of their own
    assert delay.agreement() == pytest.approx(0.0, abs=1.0)


def teller(component: int) -> Teller:
    return trigger_event(component=component).teller


def heard(*, true: int, false: int) -> Credibility:
    """One source whose shots bring files, one that tells four times as many."""
    sources = Credibility(SETTINGS)
    for number in range(true):
        sources.shot(teller(1), 5.0 * number)
        if number < false:
            for k in range(4):
                sources.shot(teller(2), 5.0 * number + 1.2 * k)
        sources.file(5.0 * number + 1.0)
    return sources


def test_a_source_has_proved_true_after_three_files() -> None:
    assert [heard(true=count, false=0).rank(teller(1)) for count in (1, 2, 3, 9)] == [1, 1, 2, 2]
    assert heard(true=9, false=0).credible() == {teller(1)}
    assert heard(true=9, false=0).rank(teller(7)) == 0
    assert heard(true=2, false=0).rank(teller(7)) == 1


def test_a_source_that_tells_more_than_comes_is_doubted_beside_one_that_does_not() -> None:
    sources = heard(true=9, false=9)
    assert (sources.rank(teller(1)), sources.rank(teller(2))) == (2, 0)
    assert sources.is_doubtful(teller(2))
    assert not sources.is_doubtful(teller(1))


def test_of_many_sources_those_that_agree_least_are_forgotten() -> None:
    sources = heard(true=9, false=0)
    for component in range(2, 40):
        sources.shot(teller(component), 46.0 + component)
    assert sources.rank(teller(1)) == 2
    assert len(sources._sources) == len(sources._last) == 32
    assert set(sources._judged) == set(sources._sources)


@pytest.mark.parametrize("late", [59.9, 60.0])
def test_an_event_is_missing_after_a_minute(late: float) -> None:
    flight = Flight().fly((0, shot(0.0)))
    assert flight.pairing.tick(late) == ([Missing(0, shot(0.0))] if late >= 60 else [])


def test_of_what_was_told_before_nothing_is_made_again() -> None:
    """Which frame an event had is known from before a restart; here it has failed, is not there, or has it."""
    flight = Flight().fly((0, shot(0.0)), file(1.0, "a.jpg"), (1, shot(40.0, result=CaptureResult.FAILED)))
    pairing = flight.pairing
    assert pairing.known(0, "a.jpg") == pairing.known(0, "b.jpg") == pairing.known(7, "a.jpg") == []
    assert pairing.known(1, "a.jpg") == []
    flight.fly(file(50.0, "b.jpg"))
    moved = pairing.known(0, "b.jpg")
    assert isinstance(moved[-1], Matched)
    assert (moved[-1].event_id, moved[-1].frame.name, moved[-1].how) == (0, "b.jpg", How.SEQUENCE)


def test_messages_about_events_that_are_not_known_are_counted_and_nothing_else() -> None:
    flight = Flight().fly((0, shot(0.0)))
    assert flight.pairing.improve(9, shot(0.1), 0.1) == []
    flight.pairing.duplicate()
    flight.pairing.duplicate(9, shot(0.1))
    accounts = flight.pairing.accounts()
    assert (accounts.duplicate, accounts.pending, accounts.events) == (3, 1, 4)


def test_who_repeats_a_shot_knows_of_it() -> None:
    flight = Flight().fly((0, shot(0.0)))
    repeated = replace(shot(0.2), component=100)
    failed = replace(shot(0.2, result=CaptureResult.FAILED), component=101)
    for message in (repeated, repeated, failed):
        flight.pairing.duplicate(0, message)
    (held,) = flight.pairing._events.oldest_first()
    assert held.tellers == [shot(0.0).teller, repeated.teller]


def test_the_frame_that_is_withdrawn_was_none_and_its_event_takes_another() -> None:
    flight = Flight().fly((0, shot(0.0)), file(1.0, "a.jpg"), file(1.5, "b.jpg"))
    outcomes = flight.pairing.withdraw("a.jpg")
    assert [type(one).__name__ for one in outcomes] == ["Unmatched", "Matched"]
    accounts = flight.pairing.accounts()
    assert (accounts.frames, accounts.orphans, accounts.matched) == (1, 0, 1)
    assert flight.pairing.withdraw("c.jpg") == []


def test_a_whole_picture_is_told_with_what_its_preview_was_matched_by() -> None:
    flight = Flight().fly((0, shot(0.0, hint="a.jpg")), file(1.0, "a.jpg"), file(40.0, "z.jpg"))
    (told,) = flight.pairing.whole_of("a.jpg", file(2.0, "a.jpg#2"))
    assert isinstance(told, Matched)
    assert (told.how, told.frame.received) == (How.NAME, 1.0)
    (alone,) = flight.pairing.whole_of("z.jpg", file(41.0, "z.jpg#2"))
    assert alone == Orphan(replace(file(41.0, "z.jpg#2"), received=40.0))


def row(*told: tuple[str, float, float | None]) -> list[PendingFrame]:
    return [picture(name, at, captured=captured) for name, at, captured in told]


def test_the_cameras_clock_orders_files_or_else_arrival_and_numbers() -> None:
    dated = row(("a1.jpg", 3.0, 20.0), ("a2.jpg", 1.0, 30.0), ("a3.jpg", 2.0, 10.0))
    (only,) = stretch._orders(dated)
    assert [held.frame.name for held in only] == ["a3.jpg", "a1.jpg", "a2.jpg"]
    undated = [*dated[:2], *row(("a3.jpg", 2.0, None))]
    assert [[held.frame.name for held in one] for one in stretch._orders(undated)] == [
        ["a2.jpg", "a3.jpg", "a1.jpg"],
        ["a1.jpg", "a2.jpg", "a3.jpg"],
    ]
    assert len(stretch._orders(row(("a1.jpg", 1.0, None), ("a2.jpg", 2.0, None)))) == 1
