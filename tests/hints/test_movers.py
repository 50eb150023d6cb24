"""What changes place from look to look is found as a track; what lies still, brightens, or lies a little off, is not."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_mosaic.hints import movers
from gcs_mosaic.hints.mover_tracks import SeenBlob, tracks_of
from gcs_mosaic.hints.movers import Movers, MoverSearch
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import ImageBGR
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.views import ground_window, pictures
from gcs_mosaic.views.flight_view import FlightView, FrameTable
from gcs_mosaic.views.pictures import NoPicture
from tests.views.drawn_flight import Drawn, Things, drawn_flight, laid_at

LOOKS = 7
STEP = 40.0  # canvas units between looks: each ground is seen by six of them
LIGHTS = (1.0, 1.0, 0.6, 0.6, 1.2, 1.0, 0.8)


def flight(root: Path, things: list[Things], off: float = 0.0) -> FlightView:
    frames = [
        Drawn(f"{n}.png", Pose(150.0 + STEP * n, 250.0, yaw=0.1 * (n % 3)), LIGHTS[n], things[n]) for n in range(LOOKS)
    ]
    return FlightView(drawn_flight(root / "flight", frames, off))


def searched(view: FlightView) -> Movers:
    search = MoverSearch(view)
    found = search.ask(0)
    while found.searched < found.frames:
        found = search.ask(0)
    return found


def both(*things: Things) -> Things:
    def lay(ground: ImageBGR) -> None:
        for thing in things:
            thing(ground)

    return lay


@pytest.mark.long
def test_who_walks_is_one_track_with_times_and_places(tmp_path: Path) -> None:
    ways = [(200.0 + 24 * n, 240.0 + 6 * n) for n in range(LOOKS)]
    still, dark = laid_at(300, 300, 5), laid_at(260, 200, 5, (10, 10, 10))
    found = searched(flight(tmp_path, [both(laid_at(*way), still, dark) for way in ways], off=1.0))
    (track,) = found.tracks
    assert len(track) >= 5
    for one in track:
        assert np.hypot(*np.subtract((one.x, one.y), ways[one.turn])) < 5
        assert one.contrast > 0
    assert [one.time for one in track] == sorted(one.time for one in track)


@pytest.mark.long
@pytest.mark.parametrize("off", [0.0, 1.5])
def test_where_nothing_moves_nothing_is_found(tmp_path: Path, off: float) -> None:
    """Light changes, frames lie a pixel or two beside where they are told to, small things lie still."""
    still = both(*(laid_at(180 + 30 * k, 200 + 17 * (k % 5), 3) for k in range(8)))
    assert searched(flight(tmp_path, [still] * LOOKS, off)).tracks == []


@pytest.mark.long
def test_a_question_works_for_a_while_and_the_next_goes_on(tmp_path: Path) -> None:
    search = MoverSearch(flight(tmp_path, [laid_at(0, 0)] * LOOKS))
    assert search.ask(0, work_s=0.0).searched == 0
    while (found := search.ask(0, work_s=0.01)).searched < LOOKS:
        assert found.frames == LOOKS
    assert search.ask(5).frames == 0


@pytest.mark.long
def test_an_original_that_is_gone_stops_nothing(tmp_path: Path) -> None:
    view = flight(tmp_path, [laid_at(200.0 + 24 * n, 240.0) for n in range(LOOKS)])
    (view.root / "frames" / "3.png").unlink()
    assert searched(view).searched == LOOKS


@pytest.mark.long
def test_what_a_passing_trouble_kept_from_being_searched_is_searched_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor are those beside it, which would be compared with less than there is; and it is not tried with each question."""
    view, away, asked = flight(tmp_path, [laid_at(200.0 + 24 * n, 240.0) for n in range(LOOKS)]), {1}, list[int]()
    shown = pictures.displayed

    def displayed(of: FlightView, number: int, reduction: int) -> ImageBGR:
        asked.append(number)
        if number in away:
            raise NoPicture("It took too long.", passing=True)
        return shown(of, number, reduction)

    monkeypatch.setattr(ground_window, "displayed", displayed)
    search = MoverSearch(view)
    assert search.ask(0, work_s=60.0).searched == LOOKS - 1 - movers.BESIDE
    before = list(asked)
    assert search.ask(0, work_s=60.0).searched == LOOKS - 1 - movers.BESIDE
    assert asked == before
    monkeypatch.setattr(movers, "RETRY_S", 0.0)
    monkeypatch.setattr(movers, "REST", 0.0)
    search = MoverSearch(view)
    search.ask(0, work_s=60.0)
    away.clear()
    found = search.ask(0, work_s=60.0)
    assert found.searched == LOOKS
    assert len(found.tracks) == 1


@pytest.mark.long
def test_a_frame_that_cannot_be_searched_stops_nothing_and_is_tried_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    search, tried = MoverSearch(flight(tmp_path, [laid_at(0, 0)] * LOOKS)), list[int]()

    def fail(self: MoverSearch, table: FrameTable, index: int, beside: tuple[int, ...]) -> None:
        tried.append(index)
        raise ZeroDivisionError

    monkeypatch.setattr(MoverSearch, "_search", fail)
    while search.ask(0).searched < LOOKS:
        assert len(tried) <= LOOKS
    assert tried == list(range(LOOKS))
    assert "frame 1 cannot be searched" in caplog.text


@pytest.mark.long
def test_what_has_not_changed_is_not_linked_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    search = MoverSearch(flight(tmp_path, [laid_at(0, 0)] * LOOKS))
    while (found := search.ask(0)).searched < LOOKS:
        pass
    monkeypatch.setattr(movers, "tracks_of", lambda seen: pytest.fail("nothing has changed"))
    assert search.ask(0) is found


@pytest.mark.long
def test_found_things_follow_their_frames_and_their_frames_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An island that joins another is laid at another scale; a flight flown again into the folder has other frames."""
    view = flight(tmp_path, [laid_at(200.0 + 24 * n, 240.0) for n in range(LOOKS)])
    monkeypatch.setattr(movers, "REST", 0.0)
    search = MoverSearch(view)
    (before,) = search.ask(0, work_s=60.0).tracks
    table, painted = view.table(), FlightView.painted

    def twice_as_large(of: FlightView, number: int) -> RenderItem | None:
        one = painted(of, number)
        if one is None:
            return None
        pose = replace(one.pose, x=2 * one.pose.x, y=2 * one.pose.y, log_gsd=one.pose.log_gsd + math.log(2))
        return replace(one, pose=pose)

    monkeypatch.setattr(FlightView, "painted", twice_as_large)
    monkeypatch.setattr(FlightView, "table", lambda *_: replace(table, revision=table.revision + 1))
    (after,) = search.ask(0, work_s=60.0).tracks
    assert [one.x for one in after] == pytest.approx([2 * one.x for one in before])
    assert [one.size for one in after] == pytest.approx([2 * one.size for one in before])
    others = [replace(one, content_hash=f"{one.content_hash}, another") for one in table.frames]
    monkeypatch.setattr(FlightView, "table", lambda *_: replace(table, revision=table.revision + 2, frames=others))
    found = search.ask(0, work_s=0.0)
    assert (found.searched, found.tracks) == (0, [])


@pytest.mark.long
def test_linking_again_waits_for_many_times_what_it_costs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    view, linked = flight(tmp_path, [laid_at(0, 0)] * LOOKS), list[int]()

    def link(seen: Sequence[SeenBlob]) -> list[list[SeenBlob]]:
        linked.append(len(seen))
        end = time.thread_time() + 0.1
        while time.thread_time() < end:
            pass
        return []

    monkeypatch.setattr(movers, "tracks_of", link)
    monkeypatch.setattr(movers, "REST", 1000.0)
    search = MoverSearch(view)
    for _ in range(LOOKS + 1):
        search.ask(0, work_s=1e-9)
    assert len(linked) == 1
    monkeypatch.setattr(movers, "REST", 0.0)
    search = MoverSearch(view)
    for _ in range(LOOKS + 1):
        found = search.ask(0, work_s=0.05)
    assert len(linked) > 2
    assert found.searched > 0


def seen(turn: int, x: float, contrast: float = 1.0, size: float = 4.0) -> SeenBlob:
    return SeenBlob(turn, float(turn), x, 0.0, size, contrast, turn, (0.0, 0.0))


def test_a_track_is_an_even_way_of_things_that_are_alike() -> None:
    walk = [seen(turn, 20.0 * turn) for turn in range(4)]
    assert tracks_of(walk) == [walk]
    swaying = [seen(turn, 20.0 * turn + (3.0 if turn == 2 else 0.0)) for turn in range(6)]
    assert tracks_of(swaying) == [swaying]  # wherever its evenest part is
    for spoilt in (
        [seen(0, 0), seen(1, 20), seen(2, 75)],  # not even
        [seen(0, 0), seen(1, 20, -1.0), seen(2, 40)],  # bright, dark, bright
        [seen(0, 0), seen(1, 20, size=12.0), seen(2, 40)],  # of another size
        [seen(0, 0), seen(1, 2), seen(2, 4)],  # at one place
        [seen(0, 0), seen(1, 20)],  # two only
        [seen(0, 0), seen(1, 80), seen(2, 160)],  # faster than anybody
    ):
        assert tracks_of(spoilt) == []
