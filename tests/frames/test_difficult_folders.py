"""Folders as card readers, cameras and network mounts leave them. No file event is ever waited for: only looking counts."""

from __future__ import annotations

import errno
import os
import resource
import shutil
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from gcs_mosaic.frames import directory, pending_file
from gcs_mosaic.frames import pending_file as candidate
from gcs_mosaic.frames.directory import FolderWatch, Item
from gcs_mosaic.frames.integrity import NotWhole, is_whole
from gcs_mosaic.frames.pending_file import read_whole
from gcs_mosaic.frames.scan import Look, Scan, scan
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.frames.structure import Whole
from gcs_mosaic.messages import DamagedFile, Frame, Notice, SourceReport
from tests.frames.image_files import encoded, many_bands, picture, with_thumbnail

JPEG, OTHER = with_thumbnail(encoded(".jpg")), encoded(".jpg", picture(seed=1))
MOST_S = 5.0  # for a look at 10,000 files on a busy machine: a fortieth of that is usual


class Card:
    """A folder and looks at it."""

    def __init__(self, folder: Path, **settings: float) -> None:
        self.folder, self.now = folder, 0.0
        self.watch = FolderWatch(folder, FolderSettings(**settings), time.time())  # type: ignore[arg-type]

    def put(self, name: str, data: bytes = JPEG) -> Path:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        return path

    def look(self, times: int = 2, step_s: float = 0.25) -> list[Item]:
        items: list[Item] = []
        for _ in range(times):
            self.now += step_s
            items += self.watch.poll(self.now)
        return items

    def names(self, times: int = 2) -> list[str]:
        return [item.name for item in self.look(times) if isinstance(item, Frame)]


@pytest.fixture
def card(tmp_path: Path) -> Card:
    (tmp_path / "card").mkdir()
    return Card(tmp_path / "card")


def test_a_file_that_is_renamed_into_place_is_taken_once(card: Card) -> None:
    beside = card.put("a.jpg.part")
    assert card.names(3) == []
    beside.rename(card.folder / "a.jpg")
    assert card.names(3) == ["a.jpg"]


def test_a_rename_over_a_known_name_is_a_new_frame(card: Card) -> None:
    card.put("a.jpg")
    assert card.names() == ["a.jpg"]
    card.put("a.jpg.tmp", OTHER).rename(card.folder / "a.jpg")
    assert card.names() == ["a.jpg#2"]


def test_a_hard_link_to_elsewhere_is_a_frame_like_any_other(card: Card, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere.jpg"
    elsewhere.write_bytes(JPEG)
    (card.folder / "a.jpg").hardlink_to(elsewhere)
    assert card.names() == ["a.jpg"]


def test_a_folder_that_is_renamed_brings_its_frames_under_their_new_names_with_the_same_content(card: Card) -> None:
    """The flight knows them by their content: see the account of duplicates."""
    card.put("new/a.jpg")
    (before,) = [item for item in card.look() if isinstance(item, Frame)]
    (card.folder / "new").rename(card.folder / "100MEDIA")
    (after,) = [item for item in card.look() if isinstance(item, Frame)]
    assert (after.name, after.content_hash) == ("100MEDIA/a.jpg", before.content_hash)


def test_a_file_that_is_preallocated_at_full_size_is_taken_when_its_end_is_written(card: Card) -> None:
    """Size and time may both stand still meanwhile."""
    path = card.put("a.jpg", JPEG[:1000].ljust(len(JPEG), b"\0"))
    assert card.names(10) == []
    stamp = path.stat().st_mtime_ns
    path.write_bytes(JPEG)
    os.utime(path, ns=(stamp, stamp))
    assert card.names(40) == ["a.jpg"]


def test_a_file_that_cannot_be_read_is_reported_once_and_taken_when_it_can(
    card: Card, monkeypatch: pytest.MonkeyPatch
) -> None:
    card.put("a.jpg")
    card.put("b.jpg", OTHER)
    read = pending_file.bytes_of

    def refuse(path: Path) -> bytes:
        if path.name == "a.jpg":
            raise PermissionError(13, "Permission denied")
        return read(path)

    with monkeypatch.context() as patched:
        patched.setattr(pending_file, "bytes_of", refuse)
        items = card.look(60)
    assert [item.name for item in items if isinstance(item, Frame)] == ["b.jpg"]
    reported = [item for item in items if isinstance(item, DamagedFile)]
    assert reported == [DamagedFile(name="a.jpg", reason="cannot be read (Permission denied)")]
    assert card.names(150) == ["a.jpg"]


def test_a_file_that_cannot_be_read_for_a_passing_reason_is_not_damaged_and_taken_later(
    card: Card, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That is told once, whatever the number of files; a sector that stays bad is told as damage after a minute."""
    for name in "abc":
        card.put(f"{name}.jpg", encoded(".jpg", picture(seed=ord(name))))
    reasons = [errno.EIO, errno.EMFILE]
    read = pending_file.bytes_of

    def fail(path: Path) -> bytes:
        if reasons and path.name == "a.jpg":
            raise OSError(reasons[0], os.strerror(reasons[0]))
        return read(path)

    monkeypatch.setattr(pending_file, "bytes_of", fail)
    items = card.look(60)
    assert [item.name for item in items if isinstance(item, Frame)] == ["b.jpg", "c.jpg"]
    assert not [item for item in items if isinstance(item, DamagedFile)]
    said = [item.text for item in items if isinstance(item, Notice) and item.level == "warning"]
    assert said == [f"files in {card.folder} cannot be read (Input/output error): they are tried again"]
    reported = [item for item in card.look(400) if isinstance(item, DamagedFile)]
    assert reported == [DamagedFile(name="a.jpg", reason="cannot be read (Input/output error)")]
    reasons.clear()
    assert card.names(150) == ["a.jpg"]


def test_a_folder_that_cannot_be_read_is_told_as_such(card: Card) -> None:
    """Once, by its reason, and that it is back; what came meanwhile is not lost."""
    card.look(2)
    card.put("a.jpg")
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, limits[1]))
    try:
        items = card.look(4)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    (text,) = [item.text for item in items if isinstance(item, Notice)]
    assert f"{card.folder} cannot be read (Too many open files)" in text
    items = card.look(4)
    assert [item.name for item in items if isinstance(item, Frame)] == ["a.jpg"]
    (text,) = [item.text for item in items if isinstance(item, Notice)]
    assert f"{card.folder} is back" in text


def test_the_empty_folder_below_a_lost_mount_is_told_as_gone(tiny_disk: Path) -> None:
    card = Card(tiny_disk)
    card.put("a.jpg")
    assert card.names() == ["a.jpg"]
    subprocess.run(["umount", "--lazy", tiny_disk], check=True)
    try:
        items = card.look(3)
        texts = [item.text for item in items if isinstance(item, Notice)]
        assert texts == [
            f"the folder {tiny_disk} is empty, its disk is gone: bring it back; the flight goes on, and takes what it missed"
        ]
        assert [item.state for item in items if isinstance(item, SourceReport)] == ["missing"]
    finally:
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", tiny_disk], check=True)
    card.put("a.jpg")
    card.put("b.jpg", OTHER)
    items = card.look(3)
    assert f"the folder {tiny_disk} is back" in [item.text for item in items if isinstance(item, Notice)]
    assert "b.jpg" in [item.name for item in items if isinstance(item, Frame)]


def test_a_disk_that_is_lost_over_files_below_its_mount_is_told_each_time(tiny_disk: Path) -> None:
    """A camera's program writes on while the card is away."""
    card = Card(tiny_disk)
    card.put("a.jpg")
    assert card.names() == ["a.jpg"]

    def lost() -> list[str]:
        subprocess.run(["umount", "--lazy", tiny_disk], check=True)
        return [item.text for item in card.look(3) if isinstance(item, Notice)]

    def mounted_again() -> list[str]:
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", tiny_disk], check=True)
        card.put("a.jpg")
        return [item.text for item in card.look(3) if isinstance(item, Notice)]

    try:
        assert "is empty, its disk is gone" in lost()[0]
        card.put("below.jpg", OTHER)
        assert "below.jpg" in card.names(3)
        mounted_again()
        (told,) = lost()
        assert "shows what lies below its mount, its disk is gone: bring it back" in told
        assert mounted_again() == [f"the folder {tiny_disk} is back"]
    finally:
        subprocess.run(["umount", "--lazy", tiny_disk], check=False)
        (tiny_disk / "below.jpg").unlink(missing_ok=True)
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", tiny_disk], check=True)


def test_the_empty_folder_of_another_card_is_none_that_is_gone(tiny_disk: Path, tmp_path: Path) -> None:
    """Cards are changed in flight, and frames come into a folder below where they are mounted, or by a link to it."""
    (tiny_disk / "DCIM").mkdir()
    (tmp_path / "link").symlink_to(tiny_disk / "DCIM")
    cards = [Card(tiny_disk / "DCIM"), Card(tmp_path / "link")]
    cards[0].put("a.jpg")
    assert [card.names() for card in cards] == [["a.jpg"]] * 2
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", tiny_disk], check=True)
    try:
        (tiny_disk / "DCIM").mkdir()
        for card in cards:
            assert not [item for item in card.look(3) if isinstance(item, Notice)]
        cards[0].put("b.jpg", OTHER)
        assert [card.names() for card in cards] == [["b.jpg"]] * 2
    finally:
        subprocess.run(["umount", "--lazy", tiny_disk], check=True)


def test_a_file_that_goes_between_being_found_and_being_read_does_no_harm(
    card: Card, monkeypatch: pytest.MonkeyPatch
) -> None:
    card.put("a.jpg")
    card.put("b.jpg", OTHER)
    read = candidate.read_whole

    def gone(look: Look, settings: FolderSettings) -> candidate.FileRead | NotWhole | candidate.Unread | None:
        if look.name == "a.jpg":
            look.path.unlink(missing_ok=True)
        return read(look, settings)

    monkeypatch.setattr(candidate, "read_whole", gone)
    assert card.names(4) == ["b.jpg"]


def test_a_card_that_is_pulled_out_while_it_is_read_and_put_back_loses_nothing(card: Card, tmp_path: Path) -> None:
    card.put("a.jpg")
    card.look(1)
    away = card.folder.rename(tmp_path / "away")
    card.look(3)
    away.rename(card.folder)
    card.put("b.jpg", OTHER)
    assert sorted(card.names(3)) == ["a.jpg", "b.jpg"]


@pytest.mark.long
def test_ten_thousand_old_files_are_left_quickly_and_new_ones_are_found_among_them(card: Card) -> None:
    old = time.time() - 7200
    first = card.put("old/0.jpg")
    os.utime(first, (old, old))
    for number in range(1, 10_000):
        (first.parent / f"{number}.jpg").hardlink_to(first)
    start = time.monotonic()
    said = [getattr(item, "text", "") for item in card.look(3)]
    assert (time.monotonic() - start) / 3 < MOST_S
    assert any("0 frames were there; 10000 older ones are left" in text for text in said)
    card.put("old/new.jpg", OTHER)
    assert card.names() == ["old/new.jpg"]


def test_with_from_start_old_files_are_taken(tmp_path: Path) -> None:
    card = Card(tmp_path, from_age_s=float("inf"))
    os.utime(card.put("a.jpg"), (1e9, 1e9))
    assert card.names() == ["a.jpg"]


def test_the_source_tells_how_it_is_in_one_place(card: Card, tmp_path: Path) -> None:
    card.put("a.jpg")
    card.put("b.jpg", JPEG[:-200])
    card.look(60)
    shutil.move(card.folder, tmp_path / "away")
    gone = reports(card.look(8))[-1]
    assert (gone.state, gone.seen, gone.taken, gone.damaged, gone.gaps) == ("missing", 0, 1, 1, 1)
    shutil.move(tmp_path / "away", card.folder)
    back = reports(card.look(8))[-1]
    assert (back.state, back.seen, back.taken, back.damaged, back.gaps) == ("watching", 2, 1, 1, 1)
    assert reports(card.look(8)) == []  # nothing new


def reports(items: list[Item]) -> list[SourceReport]:
    return [item for item in items if isinstance(item, SourceReport)]


def test_a_tiff_with_an_empty_end_is_waited_for_and_taken(card: Card) -> None:
    """Its room may have been taken before it is written; or its border is black."""
    whole = many_bands(3, kind=np.uint8)  # its directory comes first
    begun = whole[: len(whole) // 2].ljust(len(whole), b"\0")
    assert isinstance(is_whole(begun), Whole)
    path = card.put("a.tiff", begun)
    assert card.names(8) == []
    path.write_bytes(whole)
    assert card.names(8) == ["a.tiff"]
    card.put("black.tiff", begun)
    assert card.names(30) == ["black.tiff"]


def test_a_version_of_the_same_size_and_time_is_a_new_frame(card: Card) -> None:
    """The clock of the card's file system has steps of two seconds."""
    path = card.put("a.jpg", JPEG)
    assert card.names() == ["a.jpg"]
    times = path.stat().st_mtime_ns
    other = JPEG[:-40] + bytes(byte ^ 1 if byte < 0xFE else byte for byte in JPEG[-40:-2]) + JPEG[-2:]
    assert len(other) == len(JPEG)
    path.write_bytes(other)
    os.utime(path, ns=(times, times))
    assert card.names() == ["a.jpg#2"]


def test_a_file_that_becomes_a_pipe_holds_up_nothing(card: Card) -> None:
    path = card.put("a.jpg")
    card.look(1)
    (look,) = scan(card.folder).images
    path.unlink()
    os.mkfifo(path)
    assert isinstance(read_whole(look, FolderSettings()), NotWhole)


def test_no_failure_ends_the_watching(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.jpg").write_bytes(JPEG)
    failures: list[BaseException] = [RuntimeError("something unforeseen"), MemoryError()]

    def failing(folder: Path) -> Scan:
        if failures:
            raise failures.pop()
        return scan(folder)

    monkeypatch.setattr(directory, "scan", failing)
    monkeypatch.setattr(directory, "AGAIN_AFTER_FAILURE_S", 0.01)
    stop = threading.Event()
    items = directory.watch(tmp_path, stop)
    said = list[str]()
    for item in items:
        if isinstance(item, Notice):
            said.append(item.text)
        if isinstance(item, Frame):
            stop.set()
            break
    assert [text for text in said if "looked at again" in text] == [
        f"{tmp_path} could not be looked at ({kind}); it is looked at again" for kind in ("MemoryError", "RuntimeError")
    ]


def test_what_comes_in_flight_does_not_wait_for_a_whole_card(card: Card, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(directory, "SLICE_S", 0.0)
    for number in range(20):
        path = card.put(f"{number:02d}.jpg", encoded(".jpg", picture(seed=number)))
        os.utime(path, (1e9 + number,) * 2)
    card.watch = FolderWatch(card.folder, FolderSettings(from_age_s=1e12), time.time())
    assert card.names(3) == ["00.jpg", "19.jpg"]
    card.put("new.jpg", OTHER)
    names = card.names(3)
    assert "new.jpg" in names
    assert len(names) <= 3
    assert len(card.names(40)) == 21 - 2 - len(names)


def test_a_suffix_cannot_steer_the_terminal(card: Card) -> None:
    card.put("a.\x1b[2J")
    said = [item.text for item in card.look() if isinstance(item, Notice)]
    assert not any("\x1b" in text for text in said)
    assert any("[2j" in text for text in said)
