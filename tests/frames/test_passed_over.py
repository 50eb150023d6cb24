"""What lies in a folder and is no frame: thumbnails of storage boxes and viewers, RAW files, files of old times.

In the field: @eaDir of Synology, .thumbnails, Thumbs; cameras that write RAW only; a camera's clock five hours behind.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.files import frames_in
from gcs_mosaic.frames.passed_over import PassedOver, in_words
from gcs_mosaic.messages import SourceReport
from tests.frames.image_files import encoded, picture
from tests.frames.test_directory import Watched

FOLDERS = (
    *("@eaDir", "thumbs", "Thumbnails", "PREVIEW", "proxy", ".thumbnails", ".@__thumb", "#recycle"),
    *("THMBNL", "#snapshot", "Recycled"),
)


def report(watched: Watched) -> SourceReport:
    return [item for item in watched.look(9) if isinstance(item, SourceReport)][-1]


def test_folders_of_small_copies_are_not_looked_into_which_is_said_once(tmp_path: Path) -> None:
    watched = Watched(tmp_path)
    for folder in FOLDERS:
        watched.write(f"DCIM/{folder}/IMG_1.jpg", encoded(".jpg", picture(40, 30)))
    watched.write("DCIM/100/IMG_1.jpg")
    assert watched.names(3) == ["DCIM/100/IMG_1.jpg"]
    again = Watched(tmp_path)
    texts = [text for text in again.texts(6) if "small copies" in text]
    assert len(texts) == len(set(texts)) == 9  # hidden ones are hidden


def test_the_watched_folder_itself_may_be_called_so(tmp_path: Path) -> None:
    (tmp_path / "preview").mkdir()
    watched = Watched(tmp_path / "preview")
    watched.write("a.jpg")
    assert watched.names() == ["a.jpg"]


def test_raw_files_without_a_picture_are_counted_from_the_start_of_the_watch(tmp_path: Path) -> None:
    watched = Watched(tmp_path)
    watched.write("old.ARW", b"raw", age_s=5 * 3600)
    assert report(watched).passed_over == ()
    for name in ("A1.ARW", "A2.DNG", "A3.NEF", "notes.txt"):
        watched.write(name, b"raw")
    watched.write("A3.JPG")  # its RAW file is that picture's
    assert dict(report(watched).passed_over) == {".arw": 1, ".dng": 1, ".txt": 1}


def test_pictures_in_a_folder_of_small_copies_are_counted(tmp_path: Path) -> None:
    watched = Watched(tmp_path)
    watched.look(2)
    for k in range(3):
        watched.write(f"preview/{k}.jpg")
    assert report(watched).passed_over == (("preview/", 3),)


def test_files_of_old_times_that_came_lately_are_told_apart(tmp_path: Path) -> None:
    watched = Watched(tmp_path)
    for k in range(5):
        watched.write(f"{k}.jpg", encoded(".jpg", picture(seed=k)), age_s=5 * 3600)
    told = report(watched)
    assert (told.left, told.left_lately, told.clock_off_s) == (5, 5, None)
    watched.write("new.jpg", age_s=5 * 3600)
    assert report(watched).clock_off_s == pytest.approx(5 * 3600, abs=60)


def test_a_good_clock_is_no_news(tmp_path: Path) -> None:
    watched = Watched(tmp_path)
    watched.look(2)
    watched.write("a.jpg")
    assert report(watched).clock_off_s is None


def test_a_folder_of_raw_files_says_what_is_in_it(tmp_path: Path) -> None:
    for k in range(2):
        (tmp_path / f"{k}.CR3").write_bytes(b"raw")
    with pytest.raises(UsageError, match=r"2 ending in \.CR3"):
        frames_in(tmp_path)
    (tmp_path / "a.jpg").write_bytes(encoded(".jpg"))
    assert "RAW files without a JPEG" in frames_in(tmp_path).passed_over[0]


def test_pictures_of_other_kinds_beside_images_are_told(tmp_path: Path) -> None:
    for name in ("a.heic", "b.HEIC", "c.webp"):
        (tmp_path / name).write_bytes(b"other")
    (tmp_path / "a.jpg").write_bytes(encoded(".jpg"))
    (said,) = frames_in(tmp_path).passed_over
    assert said.startswith("pictures of other kinds are left out (2 ending in .HEIC, 1 ending in .WEBP)")


def test_counts_in_words_are_few() -> None:
    kinds = PassedOver().kinds({f"{k}.{suffix}" for k in range(2) for suffix in "abcdef"}, set(), lambda name: False)
    assert in_words(kinds) == "2 ending in .A, 2 ending in .B, 2 ending in .C, 2 ending in .D, ..."
    assert in_words(((".arw", 1), ("thumbs/", 3), ("", 2))) == "1 ending in .ARW, 3 in thumbs/, 2 without an ending"


def test_a_link_to_a_folder_of_small_copies_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "thumbs").symlink_to(tmp_path / "elsewhere")
    watched = Watched(tmp_path)
    watched.write("elsewhere/a.jpg")
    assert watched.names() == ["elsewhere/a.jpg"]
