"""What lasts is said as long as it is so."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from gcs_mosaic.app.status.conditions import Conditions, Facts
from gcs_mosaic.messages import Aircraft, CameraCount, LinkReport, SourceReport
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
CHOSEN = (CameraCount("*_T.*", 9, mapped=True), CameraCount("*", 9, mapped=False))


def beside(**told: Any) -> Facts:
    """A flight with such a watched folder."""
    return replace(FLYING, source=replace(FOLDER, **told))


NEWS = {
    "raw": ("raw", beside(passed_over=((".arw", 6),))),
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
    "one is silent": ("silence of aircraft 2", replace(FLYING, links=(heard((1, 999.0), (2, 985.0)),))),
    "no trigger of one": (
        "triggers of aircraft 2",
        replace(FLYING, aircraft=(account(1, matched=9), account(2, matched=0))),
    ),
    "triggers": ("triggers", replace(FLYING, accounts=Accounts(frames=FrameAccount(placed=9)))),
    "orphan": ("orphans", replace(FLYING, accounts=replace(FLYING.accounts, orphans=1))),
    "orphans": ("orphans", replace(FLYING, accounts=replace(FLYING.accounts, orphans=3))),
    "missing": (
        "missing",
        replace(FLYING, accounts=replace(FLYING.accounts, events=EventAccount(matched=8, missing=1))),
    ),
    "several": (
        "missing",
        replace(FLYING, accounts=replace(FLYING.accounts, events=EventAccount(matched=8, missing=3))),
    ),
}


@pytest.mark.parametrize(("key", "facts"), NEWS.values(), ids=NEWS.keys())
def test_what_is_so_is_told(key: str, facts: Facts) -> None:
    assert keys(Conditions(), facts) == [key]


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
