"""The process that reads a video, as the program uses it: each frame once, whatever happens to process and file."""

from __future__ import annotations

import os
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_mosaic.frames.pending_file import versioned
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.scan import scan
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.frames.video import reading as reading_module
from gcs_mosaic.frames.video import watched as watched_module
from gcs_mosaic.frames.video.names import frame_name, video_and_ms
from gcs_mosaic.frames.video.reading import VideoReading, describe, known_by_video, read_all
from gcs_mosaic.frames.video.watched import Room, WatchedVideos
from gcs_mosaic.messages import Frame, Notice
from tests.frames.video.films import MOST_PIXELS, flight, klv_packet, place, reading, sound, write_film

LONGEST_S = 60.0


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of six frames."""
    klv = [(k / 5, klv_packet(1.7e9 + k / 5, *place(k / 5), 320.0)) for k in range(25)]
    return write_film(tmp_path_factory.mktemp("film") / "FLIGHT.TS", flight(5.0), klv=klv)


def frames_of(one: VideoReading) -> list[Frame]:
    return [item for item in read_all([one]) if isinstance(item, Frame)]


@pytest.mark.parametrize("name", ["FLIGHT.MP4", "100MEDIA/a.b.mov", "2/x.ts", "a#b.mkv"])
def test_a_frames_name_tells_its_video_and_its_time(name: str) -> None:
    for version, ms in ((1, 0), (1, 12_345), (3, 100 * 3_600_000 + 1)):
        assert video_and_ms(frame_name(name, version, ms)) == (versioned(name, version), ms)


@pytest.mark.parametrize("name", ["a.jpg", "DCIM/000001.000.jpg", "FLIGHT.MP4/x.jpg", "stream/20240101-000000.000.jpg"])
def test_other_frames_are_of_no_video(name: str) -> None:
    assert video_and_ms(name) is None


@pytest.mark.long
def test_frames_have_times_and_places_of_the_recording(film: Path) -> None:
    frames = frames_of(reading(film))
    assert len(frames) == 6
    for frame in frames:
        found = video_and_ms(frame.name)
        assert found is not None
        assert found[0] == "FLIGHT.TS"
        assert frame.modified == pytest.approx(1.7e9 + found[1] / 1000, abs=0.1)
        assert frame.recorded is not None
        assert frame.recorded.time_s == pytest.approx(frame.modified)
        assert not frame.path.exists()


@pytest.mark.long
def test_a_second_reading_brings_what_is_new(film: Path, tmp_path: Path) -> None:
    """A transport stream that was read while the recorder paused, and has grown since."""
    growing = tmp_path / "FLIGHT.TS"
    growing.write_bytes(film.read_bytes()[: film.stat().st_size // 2 // 188 * 188])
    first = reading(growing)
    some = frames_of(first)
    assert 1 < len(some) < 6
    shutil.copy(film, growing)
    rest = frames_of(reading(growing, first.known))
    names = [frame.name for frame in (*some, *rest)]
    assert names == sorted(set(names))
    assert len(names) in (6, 7)  # the last of the first reading had no later pictures to be chosen from
    assert frames_of(reading(growing, {frame.name: frame.content_hash for frame in (*some, *rest)})) == []


@pytest.mark.long
def test_another_recording_of_the_same_name_is_another_version(film: Path, tmp_path: Path) -> None:
    known = reading(film)
    frames_of(known)
    other = write_film(tmp_path / "FLIGHT.TS", flight(2.0, 5.0))
    frames = frames_of(reading(other, known.known))
    assert frames[0].name == "FLIGHT.TS#2/000000.000.jpg"
    everything = known.known | {frame.name: frame.content_hash for frame in frames}
    assert set(known_by_video(everything.items())) == {"FLIGHT.TS"}
    assert frames_of(reading(other, everything)) == []


@pytest.mark.long
def test_a_process_that_is_killed_is_started_again_and_no_frame_comes_twice(film: Path) -> None:
    one = reading(film)
    names = list[str]()
    for item in read_all([one]):
        if isinstance(item, Frame):
            names.append(item.name)
            if len(names) == 3 and one._process is not None:
                os.kill(one._process.pid, signal.SIGKILL)
    assert len(names) == len(set(names)) == 6


@pytest.mark.long
def test_what_brings_its_process_down_is_given_up(film: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading_module, "read_video", _crash)
    one = reading(film)
    said = list(read_all([one]))
    assert len(said) == 1
    assert isinstance(said[0], Notice)
    assert "SIGSEGV" in said[0].text


def _crash(*_: object) -> None:
    signal.signal(signal.SIGSEGV, signal.SIG_DFL)
    os.kill(os.getpid(), signal.SIGSEGV)


def test_videos_are_described_whatever_is_among_them(film: Path, tmp_path: Path) -> None:
    (tmp_path / "cut.mp4").write_bytes(write_film(tmp_path / "b.mp4", flight(0.2)).read_bytes()[:-500])
    told = describe([film, sound(tmp_path / "a.mp4"), tmp_path / "cut.mp4"], MOST_PIXELS)
    assert not isinstance(told[0], str)
    assert "sound only" in str(told[1])
    assert "not finished" in str(told[2])


class Watching:
    """A folder that is looked at as the program does."""

    def __init__(self, folder: Path, known: dict[str, dict[str, str]] | None = None) -> None:
        self.folder, self.room, self.oldest_ns = folder, Room(), 0.0
        settings = FolderSettings(damaged_after_s=0.5)
        self.videos = WatchedVideos(settings, StreamSettings(), known or {}, self.room)
        self.frames, self.said = list[Frame](), list[str]()

    def look(self) -> None:
        for item in self.videos.items(scan(self.folder).videos, self.oldest_ns, time.monotonic()):
            if isinstance(item, Frame):
                self.frames.append(item)
            elif isinstance(item, Notice):
                self.said.append(item.text)

    def until(self, words: str) -> None:
        """Look until that is said."""
        end = time.monotonic() + LONGEST_S
        while not any(words in text for text in self.said):
            assert time.monotonic() < end, self.said
            self.look()
            time.sleep(0.02)


@pytest.fixture
def watching(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Watching]:
    monkeypatch.setattr(watched_module, "STILL_S", 0.3)
    watched = Watching(tmp_path)
    yield watched
    watched.videos.close()


@pytest.mark.long
def test_a_video_is_read_when_it_stands_still_and_read_on_when_it_has_grown(film: Path, watching: Watching) -> None:
    target, data = watching.folder / "FLIGHT.TS", film.read_bytes()
    for part in range(1, 6):  # while it is copied
        target.write_bytes(data[: len(data) * part // 10])
        watching.look()
        time.sleep(0.1)
    assert watching.frames == []
    watching.until("are read")
    some = len(watching.frames)
    watching.said.clear()
    target.write_bytes(data)
    watching.until("are read")
    names = [frame.name for frame in watching.frames]
    assert 0 < some < len(names)
    assert names == sorted(set(names))
    watching.look()
    assert watching.videos.close() == ""


@pytest.mark.long
def test_a_recording_that_is_not_finished_is_waited_for(watching: Watching) -> None:
    whole = write_film(watching.folder / "a.mp4", flight(1.0)).read_bytes()
    (watching.folder / "a.mp4").write_bytes(whole[:-900])
    watching.until("not finished")
    assert len(watching.said) == 1
    (watching.folder / "a.mp4").write_bytes(whole)
    watching.until("are read")
    assert [frame.name for frame in watching.frames] == ["a.mp4/000000.000.jpg", "a.mp4/000000.920.jpg"]


@pytest.mark.long
def test_a_video_waits_while_there_is_no_room(film: Path, watching: Watching) -> None:
    shutil.copy(film, watching.folder)
    watching.room.note(100)
    for _ in range(10):
        watching.look()
        time.sleep(0.05)
    assert watching.frames == []
    watching.room.note(watched_module.MOST_WAITING - 2)
    end = time.monotonic() + LONGEST_S
    while len(watching.frames) < 2 and time.monotonic() < end:
        watching.look()
    for _ in range(10):
        watching.look()
        time.sleep(0.02)
    assert len(watching.frames) == 2
    assert "--resume goes on" in watching.videos.close()


def test_an_older_video_is_left_alone_unless_the_flight_has_some_of_it(film: Path, watching: Watching) -> None:
    shutil.copy(film, watching.folder)
    watching.oldest_ns = 9e18
    watching.look()
    assert watching.videos.left == 1
    again = Watching(watching.folder, {"FLIGHT.TS": {"FLIGHT.TS/000000.000.jpg": "0"}})
    again.oldest_ns = 9e18
    again.look()
    assert again.videos.left == 0
