"""An upload that brings a whole small preview first: the whole picture takes its place."""

from __future__ import annotations

from pathlib import Path

import cv2

from gcs_mosaic.frames.previews import FINAL_WITHIN_S, WAIT_S
from gcs_mosaic.messages import Frame, SourceReport
from tests.frames.image_files import encoded, picture, with_thumbnail
from tests.frames.test_directory import Watched


def whole(seed: int) -> bytes:
    return encoded(".jpg", picture(seed=seed))


def preview(seed: int) -> bytes:
    return encoded(".jpg", picture(60, 45, seed=seed))


def frames(watched: Watched, times: int = 2) -> list[Frame]:
    return [item for item in watched.look(times) if isinstance(item, Frame)]


def test_the_first_preview_is_replaced_and_later_ones_are_waited_for(tmp_path: Path) -> None:
    watched = Watched(tmp_path)
    watched.write("a.jpg", preview(0))
    assert [frame.name for frame in frames(watched)] == ["a.jpg"]
    watched.write("a.jpg", whole(0))
    (final,) = frames(watched)
    assert (final.name, final.earlier, final.is_whole_of_earlier) == ("a.jpg#2", "a.jpg", True)
    watched.write("b.jpg", preview(1))
    assert frames(watched, 4) == []
    watched.write("b.jpg", whole(1))
    (final,) = frames(watched)
    assert (final.name, final.is_whole_of_earlier) == ("b.jpg", False)


def test_a_small_picture_that_stays_is_taken_after_the_wait(tmp_path: Path) -> None:
    watched = Watched(tmp_path)
    watched.write("a.jpg", whole(0))
    watched.write("b.jpg", preview(1))
    assert [frame.name for frame in frames(watched)] == ["a.jpg"]
    watched.now += WAIT_S
    assert [frame.name for frame in frames(watched)] == ["b.jpg"]


def test_a_larger_picture_much_later_is_another_one(tmp_path: Path) -> None:
    watched = Watched(tmp_path)
    watched.write("latest.jpg", preview(0))
    assert frames(watched)
    watched.now += FINAL_WITHIN_S + 1
    watched.write("latest.jpg", whole(1))
    assert [frame.is_whole_of_earlier for frame in frames(watched)] == [False]


def test_a_file_that_grows_is_the_same_shot(tmp_path: Path) -> None:
    """Half of a progressive JPEG decodes, in a worse picture; another picture in the same file does not begin alike."""
    progressive = encoded(".jpg", picture(), cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
    scan = progressive.rindex(b"\xff\xda")
    watched = Watched(tmp_path)
    watched.write("a.jpg", progressive[:scan] + b"\xff\xd9")
    assert len(frames(watched)) == 1
    watched.write("a.jpg", progressive)
    (final,) = frames(watched)
    assert (final.name, final.is_whole_of_earlier) == ("a.jpg#2", True)
    watched.write("a.jpg", encoded(".jpg", picture(seed=1), cv2.IMWRITE_JPEG_PROGRESSIVE, 1) + b"a trailer")
    assert [frame.is_whole_of_earlier for frame in frames(watched)] == [False]


def test_a_file_that_gets_tags_counts_once(tmp_path: Path) -> None:
    watched = Watched(tmp_path)
    watched.write("a.jpg", whole(0))
    (first,) = frames(watched)
    watched.write("a.jpg", with_thumbnail(whole(0)))
    items = watched.look(9)
    (again,) = [item for item in items if isinstance(item, Frame)]
    assert (again.earlier, again.picture) == ("a.jpg", first.picture)
    assert [item.taken for item in watched.look(9) + items if isinstance(item, SourceReport)][-1] == 1
