from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.directory import AGAIN_S, FolderWatch, Item, Taken, watch
from gcs_mosaic.frames.scan import Scan, scan
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.messages import DamagedFile, Frame, Notice, SourceReport, Topic
from tests.frames.image_files import encoded, picture

JPEG, OTHER = encoded(".jpg"), encoded(".jpg", picture(seed=1))


class Watched:
    """A real folder, and as many looks at it as a test wants; a look costs no waiting."""

    def __init__(self, folder: Path, **settings: float) -> None:
        self.folder, self.now = folder, 0.0
        self.watch = FolderWatch(folder, FolderSettings(**settings), time.time())  # type: ignore[arg-type]

    def write(self, name: str, data: bytes = JPEG, age_s: float = 0.0) -> Path:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        os.utime(path, (time.time() - age_s,) * 2)
        return path

    def look(self, times: int = 2, step_s: float = 0.25) -> list[Item]:
        items = []
        for _ in range(times):
            self.now += step_s
            items += list(self.watch.poll(self.now))
        return items

    def names(self, times: int = 2) -> list[str]:
        return [item.name for item in self.look(times) if isinstance(item, Frame)]

    def damaged(self, times: int = 2, step_s: float = 0.25) -> list[str]:
        return [item.name for item in self.look(times, step_s) if isinstance(item, DamagedFile)]

    def texts(self, times: int = 2) -> list[str]:
        return [item.text for item in self.look(times) if isinstance(item, Notice)]


@pytest.fixture
def watched(tmp_path: Path) -> Watched:
    return Watched(tmp_path)


def test_a_file_is_taken_at_the_second_look_and_once(watched: Watched) -> None:
    watched.write("a.jpg")
    assert watched.names(1) == []
    assert watched.names(1) == ["a.jpg"]
    assert watched.names(5) == []


def test_after_a_file_has_come_or_changed_the_next_look_comes_soon(watched: Watched) -> None:
    watched.look(1)
    assert watched.watch.look_again_s >= FolderSettings().poll_s > AGAIN_S
    for end in (len(JPEG) // 2, len(JPEG)):
        watched.write("a.jpg", JPEG[:end])
        watched.look(1)
        assert AGAIN_S <= watched.watch.look_again_s < 10
    assert watched.names(1) == ["a.jpg"]
    assert watched.watch.look_again_s >= FolderSettings().poll_s


def test_a_file_that_still_changes_is_waited_for(watched: Watched) -> None:
    for end in (0.2, 0.5, 0.9):
        watched.write("a.jpg", JPEG[: int(end * len(JPEG))])
        assert watched.names(2) == []
    watched.write("a.jpg")
    assert watched.names(2) == ["a.jpg"]


def test_new_folders_are_looked_into(watched: Watched) -> None:
    watched.look()
    watched.write("DCIM/100MEDIA/IMG_1.JPG")
    watched.write("DCIM/101MEDIA/deep/IMG_2.png", encoded(".png"))
    assert set(watched.names()) == {"DCIM/100MEDIA/IMG_1.JPG", "DCIM/101MEDIA/deep/IMG_2.png"}


def test_a_whole_folder_that_is_renamed_into_place_is_found(
    watched: Watched, tmp_path_factory: pytest.TempPathFactory
) -> None:
    elsewhere = Watched(tmp_path_factory.mktemp("elsewhere"))
    elsewhere.write("flight/a.jpg")
    (elsewhere.folder / "flight").rename(watched.folder / "flight")
    assert watched.names() == ["flight/a.jpg"]


def test_frames_of_one_look_come_in_the_order_of_their_times_then_names(watched: Watched) -> None:
    for name, age in (("b", 5), ("a", 5), ("c", 9), ("d", 1)):
        os.utime(watched.write(f"{name}.jpg"), (time.time() // 1 - age,) * 2)
    assert watched.names() == ["c.jpg", "a.jpg", "b.jpg", "d.jpg"]


def test_of_files_written_at_once_names_count_naturally_and_a_copy_comes_after_its_original(watched: Watched) -> None:
    written = time.time()
    for name in ("frame10.jpg", "frame2 - Copy.jpg", "frame2.jpg", "frame1.jpg"):
        os.utime(watched.write(name), (written, written))
    assert watched.names() == ["frame1.jpg", "frame2.jpg", "frame2 - Copy.jpg", "frame10.jpg"]


def test_a_name_that_is_overwritten_is_a_new_frame(watched: Watched) -> None:
    frames: list[Frame] = []
    for data in (JPEG, OTHER, JPEG):
        watched.write("a.jpg", data, age_s=len(frames))
        frames += [item for item in watched.look() if isinstance(item, Frame)]
    assert [frame.name for frame in frames] == ["a.jpg", "a.jpg#2", "a.jpg#3"]
    assert frames[0].content_hash == frames[2].content_hash != frames[1].content_hash


def test_a_file_that_is_only_touched_is_no_new_frame(watched: Watched) -> None:
    watched.write("a.jpg", age_s=9)
    assert watched.names() == ["a.jpg"]
    watched.write("a.jpg", age_s=1)
    assert watched.names(3) == []


def test_a_file_that_vanishes_and_comes_back_is_no_new_frame(watched: Watched) -> None:
    watched.write("a.jpg")
    assert watched.names() == ["a.jpg"]
    (watched.folder / "a.jpg").unlink()
    assert watched.names() == []
    watched.write("a.jpg")
    assert watched.names() == []


def test_files_that_vanish_between_two_looks_do_no_harm(watched: Watched) -> None:
    paths = [watched.write(f"x/{number}.jpg") for number in range(3)]
    watched.look(1)
    for path in paths:
        path.unlink()
    paths[0].parent.rmdir()
    assert watched.names() == []


def test_hidden_unfinished_and_foreign_files_are_left_alone(watched: Watched) -> None:
    for name in (".a.jpg", ".thumbs/a.jpg", "a.jpg.part", "b.TMP", "c.jpg.tmp", "clip.lrv", "notes"):
        watched.write(name)
    items = watched.look(4)
    assert [item for item in items if not isinstance(item, Notice | SourceReport)] == []
    assert sum(".lrv" in item.text for item in items if isinstance(item, Notice)) == 1


def test_links_and_pipes_are_not_followed(watched: Watched, tmp_path_factory: pytest.TempPathFactory) -> None:
    outside = Watched(tmp_path_factory.mktemp("outside"))
    outside.write("secret.jpg")
    (watched.folder / "folder").symlink_to(outside.folder)
    (watched.folder / "file.jpg").symlink_to(outside.folder / "secret.jpg")
    (watched.folder / "loop").symlink_to(watched.folder)
    os.mkfifo(watched.folder / "pipe.jpg")
    items = watched.look(3)
    assert [item for item in items if isinstance(item, Frame)] == []
    assert sum("symbolic link" in item.text for item in items if isinstance(item, Notice)) == 1


def test_a_flight_of_ours_is_not_eaten(watched: Watched) -> None:
    watched.write("mosaic/flight.sqlite", b"")
    watched.write("mosaic/frames/a.jpg")
    assert watched.names() == []


def test_a_damaged_file_is_reported_once_and_taken_when_it_is_whole(watched: Watched) -> None:
    watched.write("a.jpg", JPEG[:-200])
    assert watched.damaged(4) == []
    assert watched.damaged(60) == ["a.jpg"]
    assert watched.damaged(60) == []
    watched.write("a.jpg", JPEG)
    assert watched.names() == ["a.jpg"]


def test_a_damaged_file_that_becomes_whole_without_a_trace_is_taken(watched: Watched) -> None:
    path = watched.write("a.jpg", JPEG[:-200].ljust(len(JPEG), b"\0"))
    assert watched.damaged(40) == ["a.jpg"]
    times = path.stat().st_mtime_ns
    path.write_bytes(JPEG)
    os.utime(path, ns=(times, times))
    assert watched.names(150) == ["a.jpg"]


def test_text_that_is_named_like_an_image_is_damaged(watched: Watched) -> None:
    watched.write("a.jpg", b"404 not found")
    assert watched.damaged(40) == ["a.jpg"]


def test_an_image_that_is_too_large_is_refused(tmp_path: Path) -> None:
    watched = Watched(tmp_path, max_pixels=1000, max_file_bytes=len(JPEG), damaged_after_s=0)
    watched.write("a.jpg")
    watched.write("b.jpg", JPEG + b"!")
    reasons = [item.reason for item in watched.look() if isinstance(item, DamagedFile)]
    assert "160 x 120 pixels" in reasons[0]
    assert "bytes, more than the limit" in reasons[1]


def test_old_files_are_left_counted_and_said(watched: Watched) -> None:
    watched.write("old.jpg", age_s=3600)
    watched.write("fresh.jpg", age_s=600)
    (notice,) = [item for item in watched.look(3) if isinstance(item, Notice)]
    assert notice.topic is Topic.FIRST_LOOK
    assert "1 frame was there; 1 older one is left alone (--from start takes it)" in notice.text


def test_an_old_file_that_is_copied_in_later_is_taken(watched: Watched) -> None:
    watched.look()
    watched.write("late.jpg", age_s=1e6)
    assert watched.names() == ["late.jpg"]


def test_that_a_card_with_an_earlier_flight_may_have_been_put_in_is_said_once(watched: Watched) -> None:
    watched.look()
    watched.write("now.jpg")
    assert not any("earlier flight" in text for text in watched.texts())
    for name in ("a.jpg", "b.jpg"):
        watched.write(name, age_s=24 * 3600)
    said = [text for text in watched.texts() if "earlier flight" in text]
    assert len(said) == 1
    assert said[0].startswith("a.jpg was written 24 h before this flight began")


def test_how_old_a_card_is_is_told_in_days(watched: Watched) -> None:
    watched.look()
    watched.write("a.jpg", age_s=1234 * 86400)
    (said,) = [text for text in watched.texts() if "earlier flight" in text]
    assert said.startswith("a.jpg was written 1,234 days before this flight began")


def test_a_file_that_has_come_whole_is_no_damaged_one_any_more(watched: Watched) -> None:
    watched.write("a.jpg", b"")
    assert watched.damaged(40) == ["a.jpg"]
    watched.write("a.jpg")
    reports = [item for item in watched.look(40) if isinstance(item, SourceReport)]
    assert (reports[-1].taken, reports[-1].damaged) == (1, 0)


def test_files_of_a_computer_whose_clock_was_set_back_are_of_no_earlier_flight(
    watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    watched.look()
    now = time.time
    monkeypatch.setattr(time, "time", lambda: now() - 5 * 3600)
    watched.write("now.jpg")
    assert not any("earlier flight" in text for text in watched.texts())
    watched.write("a.jpg", age_s=24 * 3600)
    assert any("earlier flight" in text for text in watched.texts())


def test_a_folder_that_goes_is_said_and_what_was_in_it_is_known_when_it_comes_back(watched: Watched) -> None:
    watched.write("a.jpg")
    watched.write("old.jpg", age_s=3600)
    watched.look()
    away = watched.folder.with_name("unplugged")
    watched.folder.rename(away)
    assert sum("is gone" in text for text in watched.texts(3)) == 1
    away.rename(watched.folder)
    watched.write("b.jpg")
    assert watched.names() == ["b.jpg"]


def test_names_that_are_no_text_can_be_printed_and_stored(watched: Watched) -> None:
    (watched.folder / os.fsdecode(b"a\xff.jpg")).write_bytes(JPEG)
    (watched.folder / "b\x1b[31m\n.jpg").write_bytes(JPEG)
    names = watched.names()
    assert sorted(names) == ["a\\xff.jpg", "b\\x1b[31m\\x0a.jpg"]
    assert all(name.isprintable() and name.encode() for name in names)


def test_watching_makes_the_folder_and_stops_when_told(tmp_path: Path) -> None:
    stop, folder = threading.Event(), tmp_path / "new" / "frames"
    items = watch(folder, stop, FolderSettings(poll_s=0.01))
    assert "made the folder" in getattr(next(items), "text", "")
    assert isinstance(next(items), SourceReport)
    assert getattr(next(items), "topic", None) is Topic.FIRST_LOOK
    (folder / "a.jpg").write_bytes(JPEG)
    frame = next(items)
    assert isinstance(frame, Frame)
    assert (frame.name, frame.size) == ("a.jpg", len(JPEG))
    assert 0 <= time.monotonic() - frame.received < 5
    stop.set()
    assert list(items) == []


def test_a_path_that_can_be_no_folder_is_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(UsageError, match="give a folder"):
        watch(tmp_path / "file" / "frames", threading.Event())


def test_many_files_are_looked_at_less_often(watched: Watched, monkeypatch: pytest.MonkeyPatch) -> None:
    def slow(folder: Path) -> Scan:
        time.sleep(0.05)
        return scan(folder)

    monkeypatch.setattr("gcs_mosaic.frames.directory.scan", slow)
    watched.look(1)
    assert watched.watch.look_again_s >= 0.5


def test_a_flight_that_goes_on_leaves_files_that_are_older_than_itself(tmp_path: Path) -> None:
    """Also when the camera's clock is a year behind."""
    year = 365 * 86400.0
    flown = time.time() - year
    for name, age in (("earlier.png", 3600.0), ("taken.png", 0.0), ("meanwhile.png", -60.0)):
        (tmp_path / name).write_bytes(encoded(".png", picture()))
        os.utime(tmp_path / name, (flown - age, flown - age))
    stat = (tmp_path / "taken.png").stat()
    taken = {"taken.png": Taken(1, stat.st_size, stat.st_mtime_ns / 1e9)}
    watch = FolderWatch(tmp_path, FolderSettings(), time.time(), taken)
    found = [item for look in range(3) for item in watch.poll(10.0 * look)]
    assert [item.name for item in found if isinstance(item, Frame)] == ["meanwhile.png"]
