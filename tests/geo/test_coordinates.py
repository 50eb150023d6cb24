"""Coordinates as people write them."""

from __future__ import annotations

import random

import pytest
from pyproj import Transformer

from gcs_mosaic.errors import UsageError
from gcs_mosaic.geo.coordinates import decimal_text, dms_text, mgrs_text, read_coordinate, utm_text


@pytest.mark.parametrize(
    ("text", "latitude", "longitude"),
    [
        ("44.51234, 7.12345", 44.51234, 7.12345),
        ("44.51234 7.12345", 44.51234, 7.12345),
        ("-33.5;-70.25", -33.5, -70.25),
        ("44,51234 7,12345", 44.51234, 7.12345),  # commas, as many countries write them
        ("-33,5; -70,25", -33.5, -70.25),
        ("44,51234° N, 7,12345° E", 44.51234, 7.12345),
        ("44°30'12,5\"N 7°07'24,0\"E", 44 + 30 / 60 + 12.5 / 3600, 7 + 7 / 60 + 24 / 3600),
        ("32T 500000,0 4649776,0", 41.9999991, 9.0),
        ("44.51234\t7.12345", 44.51234, 7.12345),  # two cells of a spreadsheet
        ("44.512345, 7.123456 ± 91 m", 44.512345, 7.123456),  # as the page tells it
        ("44.512345, 7.123456 ± 3,5 m (95 %)", 44.512345, 7.123456),
        ("44,512345 7,123456 +/- 4m", 44.512345, 7.123456),
        ("44.512345, 7.123456 (within 91 m)", 44.512345, 7.123456),  # a message of a find
        ("geo:44.512345,7.123456;u=91", 44.512345, 7.123456),
        ("geo:44.512345,7.123456,850?z=17", 44.512345, 7.123456),
        ("(44.51234, 7.12345)", 44.51234, 7.12345),
        ("44.5N 7.25W", 44.5, -7.25),
        ("N44.5 W7.25", 44.5, -7.25),
        ("7.25 E, 44.5 N", 44.5, 7.25),
        ("44°30'12.5\"N 7°07'24\"E", 44 + 30 / 60 + 12.5 / 3600, 7 + 7 / 60 + 24 / 3600),
        ("44° 30′ 12.5″ S, 7° 7′ 24″ W", -(44 + 30 / 60 + 12.5 / 3600), -(7 + 7 / 60 + 24 / 3600)),
        ("44 30 12.5 7 7 24", 44 + 30 / 60 + 12.5 / 3600, 7 + 7 / 60 + 24 / 3600),
        ("N 44° 30.205' E 007° 07.4'", 44 + 30.205 / 60, 7 + 7.4 / 60),
        ("-0 30 0, 7 0 0", -0.5, 7.0),
        ("32T 500000 4649776", 41.9999991, 9.0),
        ("32 T 500000mE 4649776mN", 41.9999991, 9.0),
        ("56S 334000 6252000", -33.859262, 151.205515),  # Sydney: many write S for south of the equator
        ("11S 500000 3700000", 33.439395, -117.0),  # and here it is the band
        ("32TNM 00000 49776", 41.999999, 9.0),
        ("4QFJ 12345 67890", 21.409801, -157.916076),  # the example of NGA's standard
    ],
)  # fmt: skip
def test_is_read(text: str, latitude: float, longitude: float) -> None:
    found = read_coordinate(text)
    assert (found.latitude_deg, found.longitude_deg) == pytest.approx((latitude, longitude), abs=2e-5)


@pytest.mark.parametrize(
    "text",
    [
        "", "x" * 101, "somewhere", "44.5", "44.5, 7.1, 3", "91, 7", "44, 181", "120.5, 44.1", "44.5N 7.1N", "44.5E, 7.1W",
        "44 61 0, 7 0 0", "44.5 30, 7 0", "-44.5N, 7E", "0, 0", "nan, nan", "1e3, 2", "61T 500000 4649776",
        "32I 500000 4649776", "32T 50000 4649776", "32C 500000 4649776", "32TAM 00000 49776", "32TNM 000 49776",
        "32CNM 00000 49776 1", "44..5, 7", "٤٤, 7", "44,51234", "44,5,7,1", "44,30,12 7,7,24", "32T 350,123 4,649,776",
        "± 3 m", "geo:44.5", "geo:", "()", "44.5, 7.1 ± 1234567 m",
    ],
)  # fmt: skip
def test_is_refused_in_a_sentence(text: str) -> None:
    with pytest.raises(UsageError) as raised:
        read_coordinate(text)
    assert str(raised.value).endswith(".")
    assert "\n" not in str(raised.value)


def test_what_is_written_is_read_again_everywhere() -> None:
    chance = random.Random(1)
    for _ in range(3000):
        longitude, latitude = chance.uniform(-180, 179.999), chance.uniform(-79.9, 83.9)
        for text, off_m in (
            (decimal_text(longitude, latitude), 0.12),
            (dms_text(longitude, latitude), 2.3),
            (utm_text(longitude, latitude), 0.75),
            (mgrs_text(longitude, latitude), 0.75),
        ):
            assert text is not None
            found = read_coordinate(text)
            assert abs(found.latitude_deg - latitude) * 111_200 < off_m, text
            assert abs((found.longitude_deg - longitude + 180) % 360 - 180) * 111_200 < max(off_m * 12, 0.2), text


def test_utm_agrees_with_proj() -> None:
    chance = random.Random(2)
    for _ in range(40):
        zone, easting, northing = chance.randint(1, 60), chance.uniform(3e5, 7e5), chance.uniform(1e6, 9e6)
        found = read_coordinate(f"{zone}N {easting:.4f} {northing:.4f}")
        expected = Transformer.from_crs(32600 + zone, 4326, always_xy=True).transform(
            round(easting, 4), round(northing, 4)
        )
        assert (found.longitude_deg, found.latitude_deg) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "half_m"),
    [
        ("32TNM 00 49", 500.0),
        ("44.5, 7.1", 5566.0),
        ("44.51234, 7.12345", 0.56),
        ("44.51234, 7.12345 ± 24 m", 17.0),  # of 95 %
        ("geo:44.51234,7.12345;u=24", 17.0),
    ],
)
def test_tells_how_precise_it_was(text: str, half_m: float) -> None:
    assert read_coordinate(text).precision_m == pytest.approx(half_m, rel=0.01)


def test_what_surrounds_the_map_has_no_utm() -> None:
    assert utm_text(10.0, 85.0) is None
    assert mgrs_text(10.0, -81.0) is None
