"""What lasts is said as long as it is so."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.app.live.left_behind import unpainted_words
from gcs_mosaic.app.status.conditions import Conditions, Facts
from gcs_mosaic.messages import Aircraft, CameraCount, LinkReport, Refusals, SourceReport
from gcs_mosaic.stitch.graph.tearing import HeldOut
from gcs_mosaic.store.records import Accounts, FrameState
from gcs_mosaic.store.status import AircraftStatus, Behind
from gcs_mosaic.store.told_documents import EventAccount, FrameAccount

HEARD = LinkReport(address="udp:14550", state="heard", last_heard_utc=1000.0)
FLYING = Facts(
    utc=1000.0,
    started_utc=900.0,
    links=(HEARD,),
    source=SourceReport(kind="folder", name="DCIM", state="watching"),
    accounts=Accounts(frames=FrameAccount(placed=9), events=EventAccount(matched=9)),
    islands=1,
)


def heard(*last: tuple[int, float], until: float = 1000.0) -> LinkReport:
    """A link of several aircraft: their numbers, and when each was heard last."""
    aircraft = tuple(Aircraft(system=system, last_heard_utc=utc) for system, utc in last)
    return replace(HEARD, last_heard_utc=until, counted=(1, 2), aircraft=aircraft)


def account(system: int, *, matched: int) -> AircraftStatus:
    source = SourceReport(kind="folder", name=f"{system}", state="watching", vehicle=system)
    accounts = Accounts(frames=FrameAccount(placed=9), events=EventAccount(matched=matched))
    return AircraftStatus(system=system, source=source, accounts=accounts)


def keys(conditions: Conditions, facts: Facts) -> list[str]:
    """After it has lasted."""
    conditions.so_now(facts)
    return [one.key for one in conditions.so_now(replace(facts, utc=facts.utc + 11))]


def test_a_good_flight_has_none() -> None:
    assert keys(Conditions(), FLYING) == []


FOLDER = SourceReport(kind="folder", name="DCIM", state="watching", taken=9)
CAMERAS = (CameraCount("_w", 9, mapped=True), CameraCount("_t", 9, mapped=False))
UNLIKE = (CameraCount("64x48", 9, mapped=True), CameraCount("96x72", 8, mapped=True))
CHOSEN = (CameraCount("*_T.*", 9, mapped=True), CameraCount("*", 9, mapped=False))


def beside(**told: Any) -> Facts:
    """A flight with such a watched folder."""
    return replace(FLYING, source=replace(FOLDER, **told))


def streamed(**told: Any) -> Facts:
    """A flight with such a stream."""
    return replace(FLYING, source=SourceReport(**{"kind": "stream", "name": "cam", "state": "connected"} | told))


def refusing(**counts: int) -> Facts:
    """Pictures come, and of the packets not one was let in."""
    link = LinkReport(address="udp:14550", state="listening", refused=Refusals(**counts))
    return replace(FLYING, links=(link,), accounts=Accounts(frames=FrameAccount(placed=9)))


ONLY_A_GROUND_STATION = replace(
    FLYING, links=(replace(HEARD, hears_ground_station=True),), accounts=Accounts(frames=FrameAccount(placed=9))
)
NEWS = {
    "raw": ("raw", beside(passed_over=((".arw", 6),))),
    "two cameras": ("cameras, 64x48, 96x72", beside(cameras=UNLIKE)),
    "only others": ("only others", beside(taken=0, passed_over=((".mp4", 6),))),
    "only copies": ("only others", beside(taken=0, passed_over=(("preview/", 6),))),
    "left": ("left", beside(left=5, left_lately=5)),
    "one left": ("left", beside(left=1, left_lately=1)),
    "left, and a clock": ("left", beside(left=5, clock_off_s=7200.0)),
    "clock behind": ("clock", beside(clock_off_s=7200.0)),
    "clock ahead": ("clock", beside(clock_off_s=-7200.0)),
    "cameras": ("cameras, _w", beside(cameras=CAMERAS)),
    "chosen": ("cameras, *_T.*", beside(cameras=CHOSEN)),
    "islands": ("islands", replace(FLYING, islands=2)),
    "behind": ("behind", replace(FLYING, behind=Behind(frames=4, seconds=12.0))),
    "one behind": ("behind", replace(FLYING, behind=Behind(frames=1, seconds=12.0))),
    "never heard": ("link udp:14550", replace(FLYING, links=(LinkReport(address="udp:14550", state="listening"),))),
    "silent": ("link udp:14550", replace(FLYING, links=(replace(HEARD, state="silent"),))),
    "failed": ("link udp:14550", replace(FLYING, links=(replace(HEARD, state="failed"),))),
    "source": ("source", replace(FLYING, source=SourceReport(kind="folder", name="DCIM", state="missing"))),
    "video": (
        "video",
        replace(
            FLYING, source=SourceReport(kind="folder", name="D", state="watching", reading="A.MP4, 0:00:07 of 0:01:00")
        ),
    ),
    "stream silent": ("source", replace(FLYING, source=SourceReport(kind="stream", name="cam", state="silent"))),
    "stream lost": ("source", replace(FLYING, source=SourceReport(kind="stream", name="cam", state="lost"))),
    "stream never came": ("source", streamed(state="connecting")),
    "stream never announced": ("source", streamed(state="connecting", name="auto")),
    "stream not asked": ("unasked", replace(streamed(seen=90), accounts=Accounts())),
    "stream frozen": ("frozen", streamed(taken=8, same_since_utc=970.0)),
    "no picture of the stream": (
        "missing",
        replace(streamed(taken=8), accounts=Accounts(events=EventAccount(missing=1))),
    ),
    "no pictures": ("missing", replace(streamed(taken=8), accounts=Accounts(events=EventAccount(missing=3)))),
    "one is silent": ("silence of aircraft 2", replace(FLYING, links=(heard((1, 999.0), (2, 985.0)),))),
    "no trigger of one": (
        "triggers of aircraft 2",
        replace(FLYING, aircraft=(account(1, matched=9), account(2, matched=0))),
    ),
    "refused, not signed": ("refused udp:14550", refusing(unsigned=60)),
    "refused, another key": ("refused udp:14550", refusing(unsigned=3, forged=60)),
    "refused, old": ("refused udp:14550", refusing(replayed=60)),
    "only a ground station": ("aircraft", ONLY_A_GROUND_STATION),
    "triggers": ("triggers", replace(FLYING, accounts=Accounts(frames=FrameAccount(placed=9)))),
    "orphan": ("orphans", replace(FLYING, accounts=replace(FLYING.accounts, orphans=1))),
    "orphans": ("orphans", replace(FLYING, accounts=replace(FLYING.accounts, orphans=3))),
    "missing": (
        "missing",
        replace(FLYING, accounts=replace(FLYING.accounts, events=EventAccount(matched=8, missing=1))),
    ),
    "not paired": (
        "missing",
        replace(FLYING, accounts=Accounts(events=EventAccount(missing=16), frames=FrameAccount(placed=14), orphans=14)),
    ),
    "of other cameras": (
        "shots of other cameras",
        replace(
            FLYING, of_other_cameras=3, accounts=replace(FLYING.accounts, events=EventAccount(matched=3, missing=3))
        ),
    ),
    "several": (
        "missing",
        replace(FLYING, accounts=replace(FLYING.accounts, events=EventAccount(matched=8, missing=3))),
    ),
}


STAY = {
    "of other cameras",
    *(
        "raw",
        "left",
        "one left",
        "left, and a clock",
        "islands",
        "orphan",
        "orphans",
        "missing",
        "several",
        "not paired",
    ),
    *("refused, not signed", "refused, another key", "refused, old"),
    *("only a ground station", "triggers", "no trigger of one"),
    *("stream not asked", "no picture of the stream", "no pictures"),
}


@pytest.mark.parametrize(("key", "facts"), NEWS.values(), ids=NEWS.keys())
def test_what_is_so_is_told(key: str, facts: Facts) -> None:
    assert keys(Conditions(), facts) == [key]


TORN = {0: HeldOut(median_px=3.0, p95_px=60.0, matches=99), 1: HeldOut(median_px=3.0, p95_px=math.inf, matches=99)}
NOT_ON_THE_MAP = FrameAccount(placed=9, rejected=2, damaged=1, duplicate=4)
# What is left of each of NEWS once the flight has ended, and what is certain only then.
ENDED = {
    **{name: (key if name in STAY else None, facts) for name, (key, facts) in NEWS.items()},
    "not mapped": ("not mapped", replace(FLYING, accounts=replace(FLYING.accounts, frames=FrameAccount(rejected=2)))),
    "not read": ("not read", replace(FLYING, accounts=replace(FLYING.accounts, frames=FrameAccount(damaged=1)))),
    "torn": ("torn island 0", replace(FLYING, held_out={0: TORN[0]})),
    "torn without end": ("torn island 1", replace(FLYING, held_out={1: TORN[1]})),
}


@pytest.mark.parametrize(("key", "facts"), ENDED.values(), ids=ENDED.keys())
def test_of_an_ended_flight_is_told_what_stays_so(key: str | None, facts: Facts) -> None:
    """At once, however briefly it was so before."""
    assert [one.key for one in Conditions().at_the_end(facts)] == ([key] if key else [])


def test_what_stays_is_told_since_it_is_so_and_said_once() -> None:
    conditions = Conditions()
    facts = replace(FLYING, islands=2, accounts=replace(FLYING.accounts, frames=NOT_ON_THE_MAP))
    keys(conditions, facts)
    conditions.left["unpainted"] = unpainted_words(Path("map"))
    conditions.pairing = "which is whose is not known"
    conditions.fresh()
    told = conditions.at_the_end(replace(facts, utc=1100.0))
    since = {one.key: one.since_utc for one in told}
    assert since == {"islands": 1000.0} | dict.fromkeys(("pairing", "not mapped", "not read", "unpainted"), 1100.0)
    assert "2 of 12 frames" in next(one.text for one in told if one.key == "not mapped")
    assert [notice.text.partition(":")[0] for notice in conditions.fresh()] == ["Not on the map"] * 2


def test_packets_beside_those_that_are_signed_are_told_as_long_as_they_come() -> None:
    conditions = Conditions()

    def told(seconds: float, unsigned: int) -> list[str]:
        link = replace(HEARD, refused=Refusals(unsigned=unsigned))
        found = conditions.so_now(replace(FLYING, utc=1000.0 + seconds, links=(link,)))
        return [f"{one.level} {one.key}" for one in found]

    assert [told(second, 5 * second) for second in range(11)] == [[]] * 11
    assert told(11, 60) == ["info refused udp:14550"]
    assert told(22, 60) == []


def test_a_link_that_is_silent_because_all_is_refused_is_told_so() -> None:
    conditions = Conditions()
    silent = replace(HEARD, state="silent", refused=Refusals(forged=9))
    (one,) = conditions.so_now(replace(FLYING, links=(silent,)))
    assert one.text.startswith("All packets on udp:14550 are refused, because they are signed with another key")
    (one,) = conditions.so_now(replace(FLYING, links=(silent,), utc=1020.0))
    assert one.text.startswith("The link udp:14550 is silent")


def test_pictures_that_wait_for_their_shots_are_not_sought_on_the_card() -> None:
    """Those of a card that is copied after landing, which are paired when all are there."""
    _, facts = NEWS["not paired"]
    (now,) = Conditions().so_now(facts)
    assert now.text.startswith(
        "Shots without a picture: 16, pictures without a trigger: 14. Which belong together is decided"
    )
    assert now.level == "warning"
    (fewer,) = Conditions().so_now(replace(facts, accounts=replace(facts.accounts, orphans=16)))
    assert fewer.level == "info"
    (ended,) = Conditions().at_the_end(facts)
    assert ended.text.startswith("16 shots have no picture: see whether it is on the camera's card")


def test_an_aircraft_on_another_link_suffices() -> None:
    ground = LinkReport(address="udp:14551", state="heard", last_heard_utc=1000.0, hears_ground_station=True)
    assert keys(Conditions(), replace(FLYING, links=(heard((1, 1000.0)), ground))) == []


def test_a_link_that_never_spoke_is_not_called_silent() -> None:
    conditions = Conditions()
    (one,) = conditions.so_now(replace(FLYING, links=(LinkReport(address="udp:14999", state="listening"),)))
    assert one.text.startswith("Nothing was ever heard on udp:14999")


def test_lost_overlap_is_said_once_and_over_once() -> None:
    conditions = Conditions()
    for _ in range(3):
        conditions.frame(FrameState.WAITING)
        conditions.so_now(FLYING)
    (one,) = conditions.so_now(FLYING)
    assert "The last 3 frames match nothing" in one.text
    conditions.frame(FrameState.PLACED)
    assert conditions.so_now(FLYING) == ()
    assert [notice.level for notice in conditions.fresh()] == ["warning", "info"]
    assert conditions.fresh() == []


def test_an_aircraft_that_leaves_the_map_is_told_though_another_s_frames_match() -> None:
    conditions = Conditions()
    for _ in range(3):
        conditions.frame(FrameState.WAITING, 2)
        conditions.frame(FrameState.PLACED, 1)
    (one,) = conditions.so_now(FLYING)
    assert one.text.startswith("The last 3 frames of aircraft 2 match nothing on the map")
    conditions.frame(FrameState.PLACED, 2)
    assert conditions.so_now(FLYING) == ()
    assert [notice.text for notice in conditions.fresh()][-1] == "frames of aircraft 2 match the map again"


def test_an_aircraft_is_silent_on_a_link_that_goes_on_without_it() -> None:
    """Not one that another link still hears, nor one whose own link has fallen silent, which is said of that link."""
    conditions = Conditions()
    gone, alone = heard((1, 999.0), (2, 985.0)), heard((2, 999.5))
    assert conditions.so_now(replace(FLYING, links=(gone, alone))) == ()
    alone = replace(heard((2, 985.0), until=985.0), state="silent")
    assert [one.key for one in conditions.so_now(replace(FLYING, links=(heard((1, 999.0)), alone)))] == [
        "link udp:14550"
    ]
    conditions = Conditions()
    for state in ("heard", "silent"):  # once all are silent it is heard no more than before
        found = conditions.so_now(replace(FLYING, links=(replace(gone, state=state),)))
        assert "silence of aircraft 2" in [one.key for one in found]
    conditions.so_now(replace(FLYING, links=(heard((1, 999.0), (2, 998.0)),)))
    assert [notice.text for notice in conditions.fresh()][-1] == "aircraft 2 is heard again"


def test_a_frozen_stream_is_told_as_long_as_it_is_and_over_once() -> None:
    conditions = Conditions()
    (one,) = conditions.so_now(streamed(taken=8, same_since_utc=970.0))
    assert one.text.startswith("The stream cam has shown the same picture for 30 s")
    assert keys(conditions, streamed(taken=8)) == []
    assert [notice.level for notice in conditions.fresh()] == ["warning", "info"]


def test_a_single_frame_that_matches_nothing_is_no_news() -> None:
    conditions = Conditions()
    conditions.frame(FrameState.WAITING)
    assert conditions.so_now(FLYING) == ()


def test_what_passes_by_itself_is_not_said_at_once() -> None:
    """A file comes before its trigger, and a part of the map may join with the next frame."""
    conditions = Conditions()
    early = replace(FLYING, islands=2)
    assert conditions.so_now(early) == ()
    assert conditions.so_now(FLYING) == ()
    assert conditions.so_now(replace(early, utc=1011.0)) == ()  # it begins anew
    assert [one.key for one in conditions.so_now(replace(early, utc=1022.0))] == ["islands"]


def test_joined_islands_are_said() -> None:
    conditions = Conditions()
    keys(conditions, replace(FLYING, islands=2))
    conditions.so_now(replace(FLYING, utc=1030.0))
    assert [notice.text for notice in conditions.fresh()][
        -1
    ] == "the parts of the map are joined: it is in one piece again"


def test_the_worst_comes_first_and_the_disk_lasts_as_long_as_its_trouble() -> None:
    conditions = Conditions()
    conditions.disk = "the disk of map is full: make room"
    found = conditions.so_now(replace(FLYING, behind=Behind(frames=4, seconds=12.0)))
    assert [one.level for one in found] == ["error", "warning"]
    conditions.disk = None
    assert conditions.so_now(FLYING) == ()


def test_an_old_range_of_counts_is_told_until_all_is_painted_anew() -> None:
    conditions = Conditions()
    conditions.old_range = True
    (found,) = conditions.so_now(FLYING)
    assert (found.key, found.level) == ("range", "warning")
    assert "painted anew" in found.text
    conditions.old_range = False
    assert conditions.so_now(FLYING) == ()
    assert len(conditions.fresh()) == 2
