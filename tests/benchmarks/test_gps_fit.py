"""Positions are read from EXIF as they are, and maps are laid over them as far as they are right."""

import math
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from tests.benchmarks.exif import position_of
from tests.benchmarks.gps_fit import LatLon, fits, island_fit, metres

pytestmark = pytest.mark.long


def exif(order: str, sides: bytes, parts: Sequence[tuple[int, int]]) -> bytes:
    """A TIFF with nothing but a GPS directory: six fractions, latitude before longitude."""
    head = (b"II" if order == "<" else b"MM") + struct.pack(order + "HI", 42, 8)
    directory = struct.pack(order + "H", 1) + struct.pack(order + "HHII", 0x8825, 4, 1, 26) + bytes(4)
    at = 26 + 2 + 4 * 12 + 4
    gps = struct.pack(order + "H", 4)
    for tag, side, place in ((1, sides[:1], at), (3, sides[1:], at + 24)):
        gps += struct.pack(order + "HHI", tag, 2, 2) + side.ljust(4, b"\0")
        gps += struct.pack(order + "HHII", tag + 1, 5, 3, place)
    values = [number for part in parts for number in part]
    return head + directory + gps + bytes(4) + struct.pack(order + "12I", *values)


def as_jpeg(tiff: bytes) -> bytes:
    segments = [b"JFIF\0" + bytes(9), b"Exif\0\0" + tiff]
    markers = (0xFFE0, 0xFFE1)
    return b"\xff\xd8" + b"".join(
        struct.pack(">HH", marker, len(segment) + 2) + segment
        for marker, segment in zip(markers, segments, strict=True)
    )


PARTS = [(51, 1), (30, 1), (3600, 100), (7, 1), (15, 1), (0, 0)]


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize(("sides", "signs"), [(b"NE", (1, 1)), (b"SW", (-1, -1))])
def test_a_position_is_read_from_exif(order: str, sides: bytes, signs: tuple[int, int]) -> None:
    tiff = exif(order, sides, PARTS)
    for data in (tiff, as_jpeg(tiff)):
        assert position_of(data) == pytest.approx((signs[0] * 51.51, signs[1] * 7.25))


def test_what_has_no_position_has_none() -> None:
    tiff = exif("<", b"NE", PARTS)
    nothing = [(0, 1)] * 6
    for data in (
        b"",
        b"\xff\xd8",
        tiff[:60],
        as_jpeg(tiff)[:40],
        as_jpeg(exif("<", b"NE", nothing)),
        b"II*\0" + bytes(90),
    ):
        assert position_of(data) is None


def flown_over(count: int, mirrored: bool = False) -> tuple[list[dict[str, Any]], dict[str, LatLon]]:
    """Entries of an island whose frames' middles lie exactly over their positions, by a known similarity."""
    rng = np.random.default_rng(1)
    east_north = rng.uniform(-100, 100, (count, 2))
    latitude = 50.0 + east_north[:, 1] / 110_574
    longitude = 8.0 + east_north[:, 0] / (111_320 * math.cos(math.radians(float(latitude.mean()))))
    turn = 3.0 * np.exp(0.7j)  # pixels per metre
    canvas = turn * (east_north[:, 0] + 1j * east_north[:, 1])
    y = canvas.imag if mirrored else -canvas.imag  # of the canvas, downwards
    entries = [
        {
            "name": str(k),
            "island": 0,
            "width": 641,
            "height": 481,
            "canvas_from_frame": [[1, 0, canvas.real[k] - 320], [0, 1, y[k] - 240], [0, 0, 1]],
        }
        for k in range(count)
    ]
    return entries, {str(k): (latitude[k], longitude[k]) for k in range(count)}


def test_a_map_that_is_right_lies_over_its_positions() -> None:
    (fit,) = fits(*flown_over(20))
    assert fit.frames == 20
    assert fit.rms_m == pytest.approx(0, abs=1e-3)
    assert not fit.mirrored


def test_a_mirrored_map_is_found() -> None:
    (fit,) = fits(*flown_over(20, mirrored=True))
    assert fit.mirrored
    assert fit.rms_m > 10


def test_one_frame_in_a_wrong_place_does_not_turn_the_others() -> None:
    entries, positions = flown_over(20)
    entries[3]["canvas_from_frame"][0][2] += 3 * 200.0
    (fit,) = fits(entries, positions)
    assert fit.rms_m == pytest.approx(200 / math.sqrt(20), rel=0.02)


def test_islands_are_fitted_each_by_itself_and_only_where_that_says_something() -> None:
    entries, positions = flown_over(12)
    for number, entry in enumerate(entries):
        entry["island"] = 0 if number < 7 else 1 if number < 10 else 2
    del positions["0"]
    assert [fit.frames for fit in fits(entries, positions)] == [6, 3]


def test_metres_are_metres() -> None:
    east_north = metres([(60.0, 10.0), (60.0, 10.001), (60.001, 10.0)])
    assert abs(east_north[1] - east_north[0]) == pytest.approx(55.66, rel=1e-3)
    assert abs(east_north[2] - east_north[0]) == pytest.approx(110.57, rel=1e-3)
    assert island_fit(east_north * 5, east_north).rms_m == pytest.approx(0, abs=1e-9)
