"""When a frame was taken, by its camera's clock, whatever nonsense the file may hold."""

from __future__ import annotations

import io
import struct
from datetime import datetime
from pathlib import Path

import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_mosaic.frames import exif
from gcs_mosaic.frames.exif import capture_time
from tests.frames.image_files import counts, encoded, photographed, with_exif, with_thumbnail

DATE = b"2021:06:05 14:03:59\0"
MOMENT = datetime(2021, 6, 5, 14, 3, 59)
JPEG = encoded(".jpg")


def read(folder: Path, data: bytes) -> datetime | None:
    path = folder / "frame"
    path.write_bytes(data)
    return capture_time(path)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("big", [False, True])
def test_of_a_jpeg_and_of_a_tiff_in_both_byte_orders(tmp_path: Path, order: str, big: bool) -> None:
    structure = photographed(DATE, b"25\0", order, big)
    quarter = MOMENT.replace(microsecond=250_000)
    assert read(tmp_path, structure) == quarter
    assert read(tmp_path, with_exif(JPEG, structure)) == quarter


@pytest.mark.parametrize("kind", [16, 18])
def test_of_a_bigtiff_with_long_pointers(tmp_path: Path, kind: int) -> None:
    structure = photographed(DATE, big=True)
    pointer, long = (struct.pack("<HHQ", 0x8769, one, 1) for one in (4, kind))
    assert pointer in structure
    assert read(tmp_path, structure.replace(pointer, long)) == MOMENT


@pytest.mark.parametrize("fill", [1, 6, 7, 20])
def test_of_a_jpeg_with_fill_bytes_before_its_markers(tmp_path: Path, fill: int) -> None:
    jpeg = with_exif(JPEG, photographed(DATE))
    assert jpeg.count(b"\xff\xe1") == 2
    assert read(tmp_path, jpeg.replace(b"\xff\xe1", b"\xff" * (1 + fill) + b"\xe1")) == MOMENT
    assert read(tmp_path, jpeg[:2] + b"\xff" * 100_000) is None


def test_of_a_tiff_whose_directory_comes_after_its_pixels(tmp_path: Path) -> None:
    file = io.BytesIO()
    tifffile.imwrite(file, counts(1)[..., 0], metadata=None)
    data = bytearray(file.getvalue())
    inner = len(data)
    data += struct.pack("<HHHIII", 1, 0x9003, 2, len(DATE), inner + 18, 0) + DATE
    data += bytes(len(data) % 2)
    (old,) = struct.unpack_from("<I", data, 4)
    (entries,) = struct.unpack_from("<H", data, old)
    struct.pack_into("<I", data, 4, len(data))
    data += struct.pack("<H", entries + 1) + data[old + 2 : old + 2 + 12 * entries]
    data += struct.pack("<HHIII", 0x8769, 13, 1, inner, 0)
    assert read(tmp_path, bytes(data)) == MOMENT


@pytest.mark.parametrize(
    ("fraction", "microseconds"),
    [(b"5\0", 500_000), (b"007\0", 7_000), (b"1234567\0", 123_456), (b"  \0", 0), (b"-1\0", 0), (b"x\0", 0)],
)
def test_fractions_of_a_second(tmp_path: Path, fraction: bytes, microseconds: int) -> None:
    assert read(tmp_path, photographed(DATE, fraction)) == MOMENT.replace(microsecond=microseconds)


@pytest.mark.parametrize(
    "date",
    [b"0000:00:00 00:00:00\0", b"2021:02:30 10:00:00\0", b"    :  :     :  :  \0", b"\xff" * 20, b"soon\0", b"9" * 99],
)
def test_a_date_that_is_none(tmp_path: Path, date: bytes) -> None:
    assert read(tmp_path, photographed(date)) is None


@pytest.mark.parametrize("data", [b"", JPEG, with_thumbnail(JPEG), encoded(".png"), encoded(".tif")])
def test_pictures_without_a_time(tmp_path: Path, data: bytes) -> None:
    assert read(tmp_path, data) is None


def test_a_file_that_is_gone_has_none(tmp_path: Path) -> None:
    notes: list[str] = []
    assert capture_time(tmp_path / "gone.jpg", notes.append) is None
    assert capture_time(tmp_path) is None
    assert notes == [
        f"gone.jpg: when it was taken cannot be read: [Errno 2] No such file or directory: '{tmp_path / 'gone.jpg'}'"
    ]


def test_exif_may_not_point_beyond_its_segment(tmp_path: Path) -> None:
    """Else a picture's own bytes could be taken for a date."""
    structure = photographed(DATE)
    cut = with_exif(JPEG, structure[: -len(DATE)])
    at = cut.index(JPEG[2:8])
    assert read(tmp_path, cut[:at] + DATE + cut[at:]) is None


def test_directories_that_lead_to_themselves_end(tmp_path: Path) -> None:
    looped = b"II*\0" + struct.pack("<IHHHIII", 8, 1, 0x8769, 4, 1, 8, 8)
    assert read(tmp_path, looped) is None


@pytest.mark.parametrize("lie", ["text", "directory"])
@pytest.mark.parametrize("big", [False, True])
def test_no_more_is_read_than_a_head(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, big: bool, lie: str) -> None:
    """Whatever a file of gigabytes says of the length of its texts and directories."""
    taken = []

    def counting(block: exif._Block, offset: int, count: int) -> bytes:
        taken.append(count)
        return plain(block, offset, count)

    plain = exif._Block.read
    monkeypatch.setattr(exif._Block, "read", counting)
    data = bytearray(photographed(DATE, big=big))
    if lie == "text":
        at = data.index(struct.pack("<HH", 0x9003, 2)) + 4
        struct.pack_into("<Q" if big else "<I", data, at, 2**32 - 1)
    else:  # as many entries as can be written, or as the file has room for
        struct.pack_into("<Q" if big else "<H", data, 16 if big else 8, 10**8 if big else 2**16 - 1)
    path = tmp_path / "sparse.tif"
    with path.open("wb") as file:
        file.write(data)
        file.truncate(1 << 33)
    assert capture_time(path) is None
    assert taken
    assert max(taken) <= exif.LONGEST_TEXT


def test_cut_off_anywhere_it_is_read_or_not_but_never_fails(tmp_path: Path) -> None:
    for sound in (photographed(DATE), with_exif(JPEG, photographed(DATE))[:400]):
        assert {read(tmp_path, sound[:length]) for length in range(len(sound))} <= {None, MOMENT}


@settings(max_examples=300, deadline=None)
@given(data=st.binary(max_size=40), at=st.integers(0, 250), big=st.booleans())
def test_nonsense_is_never_an_error(data: bytes, at: int, big: bool, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.getbasetemp()
    for sound in (photographed(DATE, b"12345\0", big=big), with_exif(JPEG, photographed(DATE, big=big))):
        read(folder, sound[:at] + data + sound[at + len(data) :])
