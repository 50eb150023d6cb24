from __future__ import annotations

import shutil
import sqlite3
import subprocess
import threading
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_mosaic.errors import UsageError
from gcs_mosaic.messages import DamagedFile, Notice, Position
from gcs_mosaic.render.compositor import CompositorSettings
from gcs_mosaic.render.display import PLAIN, Display
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER, DeadBorder
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from gcs_mosaic.store.disk import DiskFull
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import EventState, FlightRecord, FrameState
from tests.store.ledger_parts import a_frame, a_painted, an_estimate, an_event
from tests.sure import sure

finite = st.floats(allow_nan=False, allow_infinity=False)


def test_event_comes_back_as_it_was(ledger: Ledger) -> None:
    event = an_event(
        position=Position(latitude_deg=48.1, longitude_deg=-11.5, altitude_m=None), file_hint="b\udcff.jpg"
    )
    ledger.record_event(event)
    assert [record.event for record in ledger.events()] == [event]


def test_event_without_position_has_none(ledger: Ledger) -> None:
    ledger.record_event(an_event(position=None))
    assert ledger.events()[0].event.position is None


def test_matched_event_names_its_frame_and_frame_is_no_orphan(ledger: Ledger) -> None:
    event = ledger.record_event(an_event())
    ledger.record_frame(a_frame("x/a.jpg"))
    assert ledger.accounts().orphans == 1
    ledger.settle_event(event, EventState.MATCHED, frame="x/a.jpg")
    assert ledger.events(EventState.MATCHED)[0].frame == "x/a.jpg"
    assert ledger.frames()[0].had_event
    assert ledger.accounts().orphans == 0


def test_duplicate_names_the_event_that_counts(ledger: Ledger) -> None:
    first = ledger.record_event(an_event(1))
    ledger.record_event(an_event(2), duplicate_of=first)
    assert ledger.events(EventState.DUPLICATE)[0].duplicate_of == first


@pytest.mark.parametrize("state", [EventState.MATCHED, EventState.DUPLICATE])
def test_state_that_refers_to_nothing_is_refused(ledger: Ledger, state: EventState) -> None:
    event = ledger.record_event(an_event())
    with pytest.raises(sqlite3.IntegrityError):
        ledger.settle_event(event, state)


def test_frame_comes_back_with_what_became_of_it(ledger: Ledger) -> None:
    ledger.record_frame(a_frame("b\udcff.jpg", data=b"12345"))
    ledger.record_original("b\udcff.jpg", "frames/b.jpg")
    ledger.record_size("b\udcff.jpg", 4000, 3000)
    ledger.settle_frame("b\udcff.jpg", FrameState.REJECTED, "matches nothing, \udcff")
    (frame,) = ledger.frames(FrameState.REJECTED)
    assert (frame.name, frame.original, frame.size) == ("b\udcff.jpg", "frames/b.jpg", 5)
    assert (frame.width, frame.height, frame.reason) == (4000, 3000, "matches nothing, ?")


def test_rejection_without_reason_is_refused(ledger: Ledger) -> None:
    ledger.record_frame(a_frame())
    with pytest.raises(sqlite3.IntegrityError):
        ledger.settle_frame("a.jpg", FrameState.REJECTED)


def test_name_is_taken_once(ledger: Ledger) -> None:
    ledger.record_frame(a_frame())
    with pytest.raises(sqlite3.IntegrityError):
        ledger.record_frame(a_frame())
    with pytest.raises(sqlite3.IntegrityError):
        ledger.record_damaged(DamagedFile(name="a.jpg", reason="cut off"))


def test_unknown_name_is_a_surprise(ledger: Ledger) -> None:
    with pytest.raises(LookupError):
        ledger.settle_frame("never.jpg", FrameState.PLACED)
    with pytest.raises(LookupError):
        ledger.record_painted(a_painted("never.jpg"))


def test_damaged_file_that_becomes_whole_is_a_frame(ledger: Ledger) -> None:
    ledger.record_damaged(DamagedFile(name="a.jpg", reason="no end"))
    ledger.record_damaged(DamagedFile(name="a.jpg", reason="still no end"))
    assert ledger.frames(FrameState.DAMAGED)[0].reason == "still no end"
    ledger.record_frame(a_frame("a.jpg"))
    assert [(f.state, f.reason) for f in ledger.frames()] == [(FrameState.PENDING, None)]


@settings(max_examples=40, deadline=None)
@given(
    place=st.lists(finite, min_size=2, max_size=2),
    log_gsd=st.floats(-50, 50),
    values=st.lists(finite, min_size=4, max_size=9),
    focal=st.floats(1e-300, 1e300),
    lens=st.lists(finite, min_size=4, max_size=4),
    fisheye=st.booleans(),
    shifts=st.sampled_from([b"", b"\x80" * 48]) | st.binary(min_size=48, max_size=48),
    display=st.sampled_from(
        [PLAIN, Display(factor=1.7, gamma=0.437), Display((4, 4, 4), (0, 3, 65_000), (65_535, 99, 65_100))]
    ),
    dead=st.sampled_from([NO_BORDER, DeadBorder(1, 0, 250, 2)]),
)
def test_painted_frame_comes_back_to_the_last_bit(
    place: list[float],
    log_gsd: float,
    values: list[float],
    focal: float,
    lens: list[float],
    fisheye: bool,
    shifts: bytes,
    display: Display,
    dead: DeadBorder,
) -> None:
    values = [*place, log_gsd, *values]
    painted = RenderItem(
        name="a.jpg",
        order=3,
        island=0,
        pose=Pose(*values[:6]),
        camera=Camera(40, 30, focal, lens[0], lens[1], lens[2], lens[3], fisheye),
        relief=ReliefDisplacement(3, 2, shifts) if shifts else None,
        gain=tuple(values[6:]),
        display=display,
        dead=dead,
        level=15,
    )
    with Ledger(Path(":memory:")) as ledger:
        ledger.record_island(0)
        ledger.record_frame(a_frame("a.jpg"))
        ledger.record_painted(painted)
        assert ledger.painted(0) == [painted]
        assert [repr(v) for v in asdict(ledger.painted(0)[0].pose).values()] == [repr(v) for v in values[:6]]


def test_painted_frames_come_in_order_with_the_lens_they_were_painted_with(ledger: Ledger) -> None:
    ledger.record_island(0)
    for name, order, focal in (("a", 2, 1.5), ("b", 1, 1.4), ("c", 3, 1.4)):
        ledger.record_frame(a_frame(name))
        ledger.record_painted(a_painted(name, order, focal=focal))
    ledger.record_painted(a_painted("c", 0, focal=1.6))
    assert [(p.name, p.camera.focal) for p in ledger.painted(0)] == [("c", 1.6), ("b", 1.4), ("a", 1.5)]


def test_pose_that_is_no_number_is_refused(ledger: Ledger) -> None:
    ledger.record_island(0)
    ledger.record_frame(a_frame("a.jpg"))
    with pytest.raises(ValueError, match="not a pose"):
        ledger.record_estimates([an_estimate(Pose(0.0, float("nan")))])


def test_newest_estimate_replaces_the_older(ledger: Ledger) -> None:
    ledger.record_island(0)
    ledger.record_frame(a_frame("a.jpg"))
    for estimate in (an_estimate(Pose(1, 0)), an_estimate(Pose(2, 0), residual_px=None, corner_deviation_px=None)):
        ledger.record_estimates([estimate])
        assert ledger.estimates() == [estimate]


def test_island_ids_are_never_used_again(ledger: Ledger) -> None:
    ledger.record_island(0)
    ledger.record_island(1)
    ledger.merge_island(1, into=0)
    assert [(i.id, i.merged_into) for i in ledger.islands()] == [(0, None), (1, 0)]
    with pytest.raises(sqlite3.IntegrityError):
        ledger.record_island(1)


def test_notices_come_back_oldest_first(ledger: Ledger) -> None:
    for text in ("one", "two", "three"):
        ledger.record_notice(Notice(source="link", level="warning", text=text), utc=5.0)
    assert [n.text for n in ledger.notices(last=2)] == ["two", "three"]


def test_transaction_is_all_or_nothing(ledger: Ledger) -> None:
    with pytest.raises(LookupError):
        one_frame_and_a_mistake(ledger)
    assert ledger.frames() == []


def one_frame_and_a_mistake(ledger: Ledger) -> None:
    with ledger.transaction():
        ledger.record_frame(a_frame("a.jpg"))
        with ledger.transaction():
            ledger.record_frame(a_frame("b.jpg"))
        ledger.settle_frame("never.jpg", FrameState.PLACED)


def test_everything_is_there_after_opening_again(tmp_path: Path) -> None:
    flight = FlightRecord(name="2024-05-01 12:00", started_utc=1.7e9, canvas=CompositorSettings(blend="first"))
    with Ledger(tmp_path / "flight.sqlite") as ledger:
        ledger.begin_flight(flight)
        ledger.record_frame(a_frame("a.jpg"))
    with Ledger(tmp_path / "flight.sqlite", read_only=True) as ledger:
        assert ledger.flight() == flight
        assert [f.name for f in ledger.frames()] == ["a.jpg"]
        with pytest.raises(sqlite3.OperationalError):
            ledger.record_frame(a_frame("b.jpg"))


def of_a_read_only_medium(folder: Path, *, ended: bool) -> Path:
    """The path of a ledger with one frame on a file system that is read-only from then on; `ended`: else its last changes are in
    its log."""
    with Ledger(folder / "written.sqlite") as ledger:
        ledger.record_frame(a_frame("a.jpg"))
        path = folder / "flight.sqlite"
        if not ended:
            for suffix in ("", "-wal"):
                shutil.copy(folder / f"written.sqlite{suffix}", f"{path}{suffix}")
    if ended:
        shutil.copy(folder / "written.sqlite", path)
    subprocess.run(["mount", "-o", "remount,ro", folder], check=True)
    return path


def test_a_flight_on_a_read_only_medium_is_read(tiny_disk: Path) -> None:
    with Ledger(of_a_read_only_medium(tiny_disk, ended=True), read_only=True) as ledger:
        assert [record.name for record in ledger.frames()] == ["a.jpg"]


def test_what_a_read_only_medium_has_in_the_log_alone_is_not_left_out(tiny_disk: Path) -> None:
    with pytest.raises(UsageError, match="copy the folder to a disk that can be written"):
        Ledger(of_a_read_only_medium(tiny_disk, ended=False), read_only=True)


def test_other_threads_are_refused(ledger: Ledger) -> None:
    errors: list[Exception] = []

    def use() -> None:
        try:
            ledger.accounts()
        except sqlite3.ProgrammingError as error:
            errors.append(error)

    thread = threading.Thread(target=use)
    thread.start()
    thread.join(5)
    assert len(errors) == 1


event_step = st.tuples(st.sampled_from(EventState), st.integers(0, 9), st.integers(0, 9))
frame_step = st.tuples(st.sampled_from(FrameState), st.integers(0, 9))


@settings(max_examples=40, deadline=None)
@given(n_events=st.integers(2, 9), n_frames=st.integers(1, 9), steps=st.lists(event_step | frame_step, max_size=40))
def test_accounts_close_whatever_happens(n_events: int, n_frames: int, steps: list[tuple[object, ...]]) -> None:
    with Ledger(Path(":memory:")) as ledger:
        events = [ledger.record_event(an_event(n)) for n in range(n_events)]
        for n in range(n_frames):
            ledger.record_frame(a_frame(str(n)))
        for step in steps:
            one_transition(ledger, events, n_frames, step)
            accounts = ledger.accounts()
            assert sum(asdict(accounts.events).values()) == n_events
            assert sum(asdict(accounts.frames).values()) == n_frames
            alone = [frame.state for frame in ledger.frames() if not frame.had_event]
            assert accounts.orphans == sum(state not in (FrameState.DUPLICATE, FrameState.DAMAGED) for state in alone)


def one_transition(ledger: Ledger, events: list[int], n_frames: int, step: tuple[object, ...]) -> None:
    """Apply a drawn step; one that the ledger refuses must leave everything as it was."""
    state, which, *rest = step
    assert isinstance(which, int)
    try:
        if isinstance(state, FrameState):
            ledger.settle_frame(str(which), state, "a reason" if which % 2 else None)
        elif isinstance(state, EventState) and isinstance(rest[0], int):
            frame = str(rest[0]) if state is EventState.MATCHED else None
            twin = events[rest[0] % len(events)] if state is EventState.DUPLICATE else None
            ledger.settle_event(events[which % len(events)], state, frame=frame, duplicate_of=twin)
    except (sqlite3.IntegrityError, LookupError):
        pass


def test_full_disk_is_said_and_survived(tiny_disk: Path) -> None:
    with Ledger(tiny_disk / "flight.sqlite") as ledger:
        ledger.record_frame(a_frame("before.jpg"))
        filler = tiny_disk / "filler"
        with pytest.raises(OSError, match="No space left"):
            filler.write_bytes(b"x" * 2_000_000)
        with pytest.raises(DiskFull, match=r"disk is full: .*flight\.sqlite"):
            fill(ledger)
        known = [frame.name for frame in ledger.frames()]
        assert known[0] == "before.jpg"
        filler.unlink()
        ledger.record_frame(a_frame("after.jpg"))
        assert [frame.name for frame in ledger.frames()] == [*known, "after.jpg"]


def fill(ledger: Ledger) -> None:
    for n in range(5000):
        with ledger.transaction():
            ledger.record_frame(a_frame(f"{n}.jpg"))
            ledger.record_notice(Notice(source="test", level="info", text="x" * 1000), utc=0.0)


@pytest.mark.parametrize("deviation", [None, 0.05])
def test_what_is_known_of_the_focal_length_is_kept(ledger: Ledger, deviation: float | None) -> None:
    estimate = replace(an_estimate(Pose(1, 0)), focal_log_deviation=deviation)
    ledger.record_island(0)
    ledger.record_frame(a_frame("a.jpg"))
    ledger.record_estimates([estimate])
    assert ledger.estimates() == [estimate]


def test_a_canvas_that_is_chosen_later_is_the_one_that_is_known(ledger: Ledger) -> None:
    ledger.begin_flight(FlightRecord(name="any", started_utc=1.0))
    chosen = CompositorSettings(blend="newest")
    assert sure(ledger.flight()).canvas != chosen
    ledger.set_canvas(chosen)
    assert sure(ledger.flight()).canvas == chosen
