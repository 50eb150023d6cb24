from __future__ import annotations

import errno
import os
import shutil
import threading
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_mosaic.messages import Frame, content_hash
from gcs_mosaic.store.disk import DiskFull
from gcs_mosaic.store.lost_originals import LostOriginals
from gcs_mosaic.store.originals import (
    KeptOriginal,
    NotKept,
    Originals,
    OriginalsSettings,
    is_intact,
    relative_place,
)
from tests.store.ledger_parts import a_frame, written_frame

COPY = OriginalsSettings(reserve_gb=0.0)
LINK = OriginalsSettings(keep="link", reserve_gb=0.0)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    (tmp_path / "out").mkdir()
    return tmp_path / "out"


def test_subfolders_and_overwritten_names_are_kept(tmp_path: Path, out: Path) -> None:
    frame = written_frame(tmp_path / "watched", "DCIM/100MEDIA/a.jpg#2")
    kept = Originals(out, COPY).keep(frame)
    assert kept == KeptOriginal(path="frames/DCIM/100MEDIA/a.jpg#2", linked=False, notice=None)
    assert (out / "frames/DCIM/100MEDIA/a.jpg#2").read_bytes() == b"picture"


def test_copy_survives_a_camera_that_writes_again(tmp_path: Path, out: Path) -> None:
    frame = written_frame(tmp_path / "watched")
    kept = Originals(out, COPY).keep(frame)
    frame.path.write_bytes(b"another")
    assert isinstance(kept, KeptOriginal)
    assert is_intact(out / kept.path, frame.content_hash)


@pytest.mark.parametrize("settings", [COPY, LINK])
def test_a_frame_of_a_stream_is_written_whatever_the_settings_say(out: Path, settings: OriginalsSettings) -> None:
    frame = replace(a_frame("stream/1.jpg"), data=b"picture", content_hash=content_hash(b"picture"))
    kept = Originals(out, settings).keep(frame)
    assert kept == KeptOriginal(path="frames/stream/1.jpg", linked=False, notice=None)
    assert (out / "frames/stream/1.jpg").read_bytes() == b"picture"


def test_link_takes_no_space_and_its_change_is_found_out(tmp_path: Path, out: Path) -> None:
    frame = written_frame(tmp_path / "watched")
    kept = Originals(out, LINK).keep(frame)
    assert isinstance(kept, KeptOriginal)
    assert kept.linked
    assert (out / kept.path).samefile(frame.path)
    frame.path.write_bytes(b"another")
    assert not is_intact(out / kept.path, frame.content_hash)


def test_what_is_in_memory_is_kept_whatever_the_file_has_become(tmp_path: Path, out: Path) -> None:
    frame = replace(written_frame(tmp_path / "watched"), data=b"picture")
    frame.path.write_bytes(b"another")
    assert Originals(out, COPY).keep(frame) == KeptOriginal(path="frames/a.jpg", linked=False, notice=None)
    assert (out / "frames/a.jpg").read_bytes() == b"picture"


def test_a_frame_kept_ahead_is_not_kept_again(tmp_path: Path, out: Path) -> None:
    frame, originals = written_frame(tmp_path / "watched"), Originals(out, COPY)
    ahead = originals.keep_ahead(frame)
    assert ahead == replace(frame, path=out / "frames/a.jpg")
    frame.path.unlink()
    assert originals.keep(ahead) == KeptOriginal(path="frames/a.jpg", linked=False, notice=None)


def test_what_does_not_fit_ahead_is_kept_when_it_is_its_turn(tmp_path: Path, out: Path, full: list[Path]) -> None:
    frame, originals = written_frame(tmp_path / "watched"), Originals(out, COPY)
    full.append(out)
    assert originals.keep_ahead(frame) == frame
    with pytest.raises(DiskFull):
        originals.keep(frame)
    full.clear()
    assert originals.keep(frame) == KeptOriginal(path="frames/a.jpg", linked=False, notice=None)


def test_what_has_no_room_ahead_is_kept_if_there_is_when_it_is_its_turn(
    tmp_path: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame, originals = written_frame(tmp_path / "watched"), Originals(out, COPY)
    with monkeypatch.context() as patch:
        patch.setattr(originals, "_shortage", lambda size: "only 0.0 GB are free on the disk")
        assert originals.keep_ahead(frame) == frame
    assert originals.keep(frame) == KeptOriginal(path="frames/a.jpg", linked=False, notice=None)


@pytest.fixture
def full(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """While anything is in this list, no picture can be written."""
    disks: list[Path] = []

    def sync(descriptor: int) -> None:
        if disks:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", sync)
    return disks


def test_kept_again_is_the_same_original(tmp_path: Path, out: Path) -> None:
    frame = written_frame(tmp_path / "watched")
    first, second = (Originals(out, COPY).keep(frame) for _ in range(2))
    assert first == second
    assert Originals(out, COPY).used == len(b"picture")


def test_another_picture_of_the_same_name_overwrites_nothing(tmp_path: Path, out: Path) -> None:
    originals = Originals(out, COPY)
    first = originals.keep(written_frame(tmp_path / "one", data=b"first"))
    second = originals.keep(written_frame(tmp_path / "two", data=b"second"))
    assert isinstance(first, KeptOriginal)
    assert isinstance(second, KeptOriginal)
    assert (out / first.path).read_bytes() == b"first"
    assert (out / second.path).read_bytes() == b"second"


def test_file_written_again_before_it_was_kept_is_not_taken_for_the_frame(tmp_path: Path, out: Path) -> None:
    frame = written_frame(tmp_path / "watched")
    frame.path.write_bytes(b"another")
    kept = Originals(out, COPY).keep(frame)
    assert isinstance(kept, NotKept)
    assert "written again" in kept.reason
    assert not (out / "frames" / "a.jpg").exists()


def test_file_taken_away_is_a_reason(tmp_path: Path, out: Path) -> None:
    kept = Originals(out, COPY).keep(a_frame("gone.jpg", tmp_path))
    assert isinstance(kept, NotKept)
    assert "No such file" in kept.reason


def test_budget_is_said_once_and_frames_are_linked_from_then_on(tmp_path: Path, out: Path) -> None:
    originals = Originals(out, OriginalsSettings(reserve_gb=0.0, budget_gb=10e-9))
    kept = [originals.keep(written_frame(tmp_path / "watched", f"{n}.jpg")) for n in range(3)]
    assert [one.linked for one in kept if isinstance(one, KeptOriginal)] == [False, True, True]
    assert [one.notice is not None for one in kept] == [False, True, False]
    assert kept[1].notice is not None
    assert "budget" in kept[1].notice.text


def test_on_a_disk_smaller_than_the_reserve_originals_are_kept_while_half_of_it_is_free(
    tmp_path: Path, tiny_disk: Path
) -> None:
    """What has no room is told once, and once more when there is room again."""
    originals = Originals(tiny_disk, OriginalsSettings(reserve_gb=2.0))

    def keep(number: int) -> KeptOriginal | NotKept:
        data = bytes([number]) * 100_000
        return originals.keep(written_frame(tmp_path / "watched", f"{number}.jpg", data))

    kept = [keep(number) for number in range(10)]
    places = [one for one in kept if isinstance(one, KeptOriginal)]
    assert 4 <= len(places) <= 5
    assert all((tiny_disk / one.path).stat().st_size == 100_000 for one in places)
    assert all(isinstance(one, NotKept) and one.for_lack_of_room for one in kept[len(places) :])
    told = [one.notice.text for one in kept if one.notice]
    assert len(told) == 1
    assert "not kept until there is room: leave the frames where they are" in told[0]
    for one in places[:3]:
        (tiny_disk / one.path).unlink()
    again = [keep(number) for number in (10, 11)]
    assert [one.notice.text for one in again if one.notice] == ["there is room again: originals are copied as before"]
    assert all(isinstance(one, KeptOriginal) for one in again)


@pytest.mark.parametrize("number", [errno.EIO, errno.EROFS, errno.ENOENT])
def test_a_disk_that_fails_is_waited_for_not_done_without(
    tmp_path: Path, out: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    frame, originals = written_frame(tmp_path / "watched"), Originals(out, COPY)

    def fail(descriptor: int) -> None:
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", fail)
        with pytest.raises(OSError, match=os.strerror(number)):
            originals.keep(frame)
    assert originals.keep(frame) == KeptOriginal(path="frames/a.jpg", linked=False, notice=None)


def test_a_folder_that_is_gone_is_not_made_anew_by_an_original(tmp_path: Path, out: Path) -> None:
    frame, originals = written_frame(tmp_path / "watched"), Originals(out, COPY)
    out.rmdir()
    with pytest.raises(FileNotFoundError):
        originals.keep(frame)
    assert not out.exists()


def test_lost_originals_are_found_by_their_content(tmp_path: Path, out: Path) -> None:
    """One is where it was, one was written over, one comes back later."""
    watched, originals = tmp_path / "watched", Originals(out, COPY)
    frames = [written_frame(watched, f"{name}.jpg", name.encode()) for name in "abc"]
    (watched / "b.jpg").write_bytes(b"another")
    (watched / "c.jpg").unlink()
    lost = LostOriginals(originals, lambda name: watched / name)
    lost.add(frames)
    found = {frame.name: kept for frame, kept in [lost.next(0.0) for _ in range(3)]}
    assert {name for name, kept in found.items() if isinstance(kept, KeptOriginal)} == {"a.jpg"}
    assert (out / "frames/a.jpg").read_bytes() == b"a"
    assert not lost.is_due(1.0)
    assert lost.is_due(31.0)
    (watched / "c.jpg").write_bytes(b"c")
    assert {name for name, kept in _of([lost.next(31.0) for _ in range(2)]) if isinstance(kept, KeptOriginal)} == {
        "c.jpg"
    }
    assert len(lost) == 1


def _of(tried: list[tuple[Frame, KeptOriginal | NotKept | None]]) -> list[tuple[str, KeptOriginal | NotKept | None]]:
    return [(frame.name, kept) for frame, kept in tried]


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("../../etc/passwd", "frames/etc/passwd"),
        ("/etc/passwd", "frames/etc/passwd"),
        ("a/./b//c.jpg", "frames/a/b/c.jpg"),
        ("..\\..\\a.jpg", "frames/.._.._a.jpg"),
        ("a\0.jpg", "frames/a_.jpg"),
        ("..", "frames/unnamed"),
    ],
)
def test_hostile_name_stays_inside(name: str, place: str) -> None:
    assert relative_place(name).as_posix() == place


@given(st.text(max_size=600))
def test_any_name_can_be_written_inside_the_folder(name: str) -> None:
    place = relative_place(name)
    assert place.parts[0] == "frames"
    assert not {"..", ".", "/"} & set(place.parts)
    assert all(len(part.encode("utf-8", "surrogateescape")) < 240 for part in place.parts)


def test_very_long_names_stay_different(tmp_path: Path, out: Path) -> None:
    originals = Originals(out, COPY)
    for letter in "ab":
        source = written_frame(tmp_path, letter, data=letter.encode())
        long = a_frame("é" * 400 + letter + ".jpg", tmp_path, letter.encode())
        kept = originals.keep(type(long)(**{f: getattr(long, f) for f in long.__slots__} | {"path": source.path}))
        assert isinstance(kept, KeptOriginal)
        assert kept.path.endswith(".jpg")
    assert len(list((out / "frames").iterdir())) == 2


def test_what_was_kept_ahead_waits_for_no_other(tmp_path: Path, out: Path) -> None:
    originals, frame = Originals(out, COPY), written_frame(tmp_path / "watched")
    originals.keep_ahead(frame)
    found: list[KeptOriginal | NotKept] = []
    with originals._lock:  # another one is being copied
        thread = threading.Thread(target=lambda: found.append(originals.keep(frame)), daemon=True)
        thread.start()
        thread.join(5.0)
    assert [type(kept) for kept in found] == [KeptOriginal]


def test_a_source_does_not_end_when_the_folder_is_gone(tmp_path: Path, out: Path) -> None:
    originals, frame = Originals(out, COPY), written_frame(tmp_path / "watched")
    shutil.rmtree(out)
    assert originals.keep_ahead(frame) == frame
