from __future__ import annotations

import struct
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sitl.exif import HEAD, exif_segments, located_at, taken_at
from tests.sitl.sitl_parts import photograph, photograph_at

MOMENT = datetime(2021, 6, 5, 14, 3, 59, tzinfo=UTC).timestamp()


def read(folder: Path, data: bytes) -> float | None:
    path = folder / "a.jpg"
    path.write_bytes(data)
    return taken_at(path)


@pytest.mark.parametrize("order", ["<", ">"])
def test_the_date_is_read_in_both_byte_orders(order: str, tmp_path: Path) -> None:
    assert read(tmp_path, photograph(order)) == MOMENT


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("latitude", "longitude"), [(47.123456, 8.5), (-33.9, -70.654321)])
def test_the_place_is_read(order: str, latitude: float, longitude: float, tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    path.write_bytes(photograph_at(latitude, longitude, 512.5, order))
    assert located_at(path) == pytest.approx((latitude, longitude, 512.5), abs=2e-6)
    assert taken_at(path) is None
    path.write_bytes(photograph(order))
    assert located_at(path) is None


def test_a_place_that_is_none_is_none(tmp_path: Path) -> None:
    """Too far north, without a denominator, and cut off anywhere."""
    path, data = tmp_path / "a.jpg", photograph_at(47.0, 8.0, 500.0)
    wrong = [photograph_at(91.0, 8.0, 500.0), data.replace(struct.pack("<2I", 47, 1), struct.pack("<2I", 47, 0))]
    for cut in (*wrong, *(data[:length] for length in range(0, len(data) - 52, 7))):
        path.write_bytes(cut)
        assert located_at(path) is None


def test_fractions_of_a_second_count(tmp_path: Path) -> None:
    assert read(tmp_path, photograph(sub=b"25\0\0")) == pytest.approx(MOMENT + 0.25)


def test_other_segments_may_come_first(tmp_path: Path) -> None:
    jfif = b"\xff\xe0" + struct.pack(">H", 16) + b"JFIF\0".ljust(14, b"\0")
    xmp = b"\xff\xe1" + struct.pack(">H", 12) + b"http://ns\0"
    assert read(tmp_path, photograph(before=jfif + xmp)) == MOMENT


@pytest.mark.parametrize("date", [b"0000:00:00 00:00:00\0", b"    :  :     :  :  \0", b"\xff" * 20, b"soon\0"])
def test_a_date_that_is_none_is_none(date: bytes, tmp_path: Path) -> None:
    assert read(tmp_path, photograph(date=date)) is None


def test_cut_off_anywhere_it_is_read_or_not_but_never_fails(tmp_path: Path) -> None:
    data = photograph()
    found = [read(tmp_path, data[:length]) for length in range(len(data))]
    assert set(found) == {None, MOMENT}
    assert found[0] is None


@settings(max_examples=300)
@given(data=st.binary(max_size=120), at=st.integers(0, 130))
def test_nonsense_is_never_an_error(data: bytes, at: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.getbasetemp()
    sound = photograph()
    read(folder, b"\xff\xd8\xff\xe1" + data)
    read(folder, sound[:at] + data + sound[at + len(data) :])


def test_only_the_head_of_a_large_file_is_looked_at() -> None:
    assert list(exif_segments(photograph() + bytes(HEAD)))
    assert not list(exif_segments(b"\x89PNG" + bytes(100)))
