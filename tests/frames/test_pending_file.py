"""Files of which more may come: waited for while they may, then taken or refused by what they decode to.

In the field whole flights were refused because the camera writes no end marker (FF D9), with and without a trailer behind; an
upload that stalls looks the same until it is decoded.
"""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest

from gcs_mosaic.frames.decoding.proof import Proof, decodes_here
from gcs_mosaic.frames.directory import FolderWatch, Item, watch
from gcs_mosaic.frames.files import frames_in
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.messages import DamagedFile, Frame, Notice
from tests.frames.image_files import encoded, textured

JPEG = encoded(".jpg", textured())
OPEN_ENDED = JPEG[:-2]
WAIT_S = FolderSettings().damaged_after_s
STEP_S = 0.25


class Looks:
    """A folder that is looked at four times a second; what was decoded to decide is counted."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.now, self.decoded = folder, 0.0, 0
        self.watched = FolderWatch(folder, FolderSettings(), time.time(), prove=self._prove)

    def _prove(self, data: bytes, content_hash: str) -> str | None:
        self.decoded += 1
        return decodes_here(data, content_hash)

    def put(self, data: bytes, name: str = "a.jpg") -> None:
        (self.folder / name).write_bytes(data)

    def after(self, seconds: float) -> list[Item]:
        """What came in that time."""
        items: list[Item] = []
        until = self.now + seconds
        while self.now < until:
            self.now += STEP_S
            items += [item for item in self.watched.poll(self.now) if isinstance(item, Frame | DamagedFile)]
        return items


@pytest.fixture
def looks(tmp_path: Path) -> Looks:
    return Looks(tmp_path)


@pytest.mark.parametrize("behind", [b"", b"\0\0\0\x18ftypmp42" + bytes(range(256)) * 40])
def test_a_picture_without_an_end_marker_is_taken_after_the_wait(looks: Looks, behind: bytes) -> None:
    looks.put(OPEN_ENDED + behind)
    assert looks.after(WAIT_S) == []
    (frame,) = looks.after(1.0)
    assert isinstance(frame, Frame)
    assert frame.data == OPEN_ENDED + behind
    assert frame.received <= 2 * STEP_S  # when it came, not when it was believed: events are paired by it
    assert looks.after(60.0) == []


def test_why_frames_come_late_is_said_once(looks: Looks) -> None:
    for number in range(3):
        looks.put(encoded(".jpg", textured(200 + number))[:-2], f"{number}.jpg")
    said = list[str]()
    while looks.now < WAIT_S + 1.0:
        looks.now += STEP_S
        said += [item.text for item in looks.watched.poll(looks.now) if isinstance(item, Notice)]
    assert [text for text in said if "end marker" in text] == [
        "0.jpg decodes whole, but it has no end marker: such files are taken when they have not changed for 5 s"
        " (frames: {damaged_after_s: …})"
    ]


def test_a_whole_picture_does_not_wait_and_is_not_decoded_for_it(looks: Looks) -> None:
    looks.put(JPEG + b"a maker's trailer")
    assert len(looks.after(2 * STEP_S)) == 1
    assert looks.decoded == 0


def test_a_file_that_grows_is_taken_when_it_has_grown_and_never_before(looks: Looks) -> None:
    """A slow link pauses, but not for as long as the wait; the picture is complete long before the trailer is."""
    data = OPEN_ENDED + b"\0\0\0\x18ftypmp42" + bytes(range(256)) * 100
    for end in range(len(data) // 8, len(data), len(data) // 8):
        looks.put(data[:end])
        assert looks.after(WAIT_S - 1.0) == []
    looks.put(data)
    (frame,) = looks.after(WAIT_S + 1.0)
    assert isinstance(frame, Frame)
    assert (frame.name, frame.size) == ("a.jpg", len(data))


def test_an_upload_that_stands_still_is_damaged_once_and_taken_when_it_goes_on(looks: Looks) -> None:
    looks.put(JPEG[: len(JPEG) // 2])
    (damaged,) = looks.after(100.0)
    assert isinstance(damaged, DamagedFile)
    assert damaged.reason.endswith("of 300 rows are missing")
    assert looks.decoded == 1  # what has been refused is not decoded at every look
    looks.put(JPEG)
    (frame,) = looks.after(1.0)
    assert isinstance(frame, Frame)
    assert frame.name == "a.jpg"


def test_what_cannot_be_told_now_is_left_to_the_flight(looks: Looks, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(looks.watched, "_prove", lambda data, content_hash: None)
    looks.put(JPEG[: len(JPEG) // 2])
    assert [type(item) for item in looks.after(WAIT_S + 1.0)] == [Frame]


def test_a_camera_without_end_markers_is_heard_by_a_process_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(OPEN_ENDED)
    (tmp_path / "b.jpg").write_bytes(JPEG[: len(JPEG) // 2])
    stop, found = threading.Event(), list[Frame | DamagedFile]()
    for item in watch(tmp_path, stop, FolderSettings(poll_s=0.02, damaged_after_s=0.1)):
        found += [item] if isinstance(item, Frame | DamagedFile) else []
        if len(found) == 2:
            stop.set()
    assert [(type(item), item.name) for item in found] == [(Frame, "a.jpg"), (DamagedFile, "b.jpg")]


def test_a_process_that_is_not_needed_is_not_started() -> None:
    proof = Proof()
    proof.close()
    assert proof._decoders is None


def test_files_that_are_given_are_left_to_decoding(tmp_path: Path) -> None:
    """They stand still: nothing is waited for, and nothing decoded twice."""
    (tmp_path / "a.jpg").write_bytes(OPEN_ENDED)
    (tmp_path / "b.jpg").write_bytes(b"404 not found")
    assert [type(item) for item in frames_in(tmp_path).frames] == [Frame, DamagedFile]
